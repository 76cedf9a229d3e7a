"""Servos on joints: the planar solver, MuJoCo and pymunk, in time and at rest."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import mujoco
import numpy as np
import pytest

from proofmass.analytic import planar, spatial
from proofmass.analytic.numerics import NotCovered
from proofmass.sim.mujoco.engine import simulate as in_mujoco
from proofmass.sim.protocol.failures import Unsupported
from proofmass.sim.protocol.run import Drive, Run
from proofmass.sim.pymunk.engine import ENGINE as PYMUNK
from proofmass.sim.pymunk.engine import simulate as in_pymunk
from proofmass.sim.smooth import SmoothTerms
from tests.programs import program_curves
from tests.shipped import shipped

ARM_FILE = shipped("arm_servos.xml")
TIMES = np.linspace(0.0, 0.5, 51)


@cache
def planar_motion() -> dict[str, np.ndarray]:
    """The motion of the arm by the planar reference."""
    return planar.solve(TIMES, model=mujoco.MjModel.from_xml_path(str(ARM_FILE)))


def test_the_spatial_solver_has_the_same_motion():
    """It has its own actuator forces, which are compared with MuJoCo's at random states."""
    model = mujoco.MjModel.from_xml_path(str(ARM_FILE))
    one, two = planar_motion(), spatial.solve(TIMES, model=model, terms=SmoothTerms(model))
    shared = one.keys() & two.keys()
    assert {"shoulder", "elbow", "reach", "tip.x", "tip.z", "kinetic", "potential"} <= shared
    assert max(np.abs(one[name] - two[name]).max() for name in shared) < 1e-11


def test_forces_of_servos_follow_controls_positions_and_rates():
    """The moment is compared by differences, the force by sums, over samples 5e-4 s apart.

    So the errors are up to 1e-3 N m and 1e-4 m.
    """
    model, t = mujoco.MjModel.from_xml_path(str(ARM_FILE)), np.linspace(0.0, 0.25, 501)
    found = planar.solve(t, model=model)
    rate = np.gradient(found["elbow"], t, edge_order=2)
    assert np.abs(found["turning"] - 0.8 * (1.5 - rate))[100:].max() < 1e-3
    push = 200 * 0.05 + 1 - 300 * found["reach"]  # without -9 times the rate
    speed = (push - found["pushing"]) / 9.0
    assert speed[0] == pytest.approx(0.1, rel=1e-12, abs=0)  # the rate in the key
    way = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(t))])
    assert np.abs(way - (found["reach"] - found["reach"][0])).max() < 1e-4


@pytest.mark.parametrize(("midpoint", "ratio", "largest"), [(True, 4.0, 4e-6), (False, 2.0, 5e-3)])
def test_pymunk_converges_to_the_motion(midpoint, ratio, largest):
    """Forces that depend on rates are of second order, those of Chipmunk's dampers of first."""
    known, errors = planar_motion(), []
    for step in (2e-4, 1e-4):
        settings = {"timestep": step, "midpoint_damping": midpoint}
        run = Run("dynamics", TIMES, ("shoulder", "elbow", "reach"), settings=settings)
        found = in_pymunk(ARM_FILE, run).channels
        errors.append(max(np.abs(found[name] - known[name]).max() for name in found))
    assert errors[1] < largest
    assert errors[0] / errors[1] == pytest.approx(ratio, rel=0.1)


def test_a_pymunk_program_contains_the_servos(tmp_path: Path):
    run = Run("dynamics", TIMES[:21], ("shoulder", "elbow", "reach"), settings={"timestep": 1e-3})
    wanted = in_pymunk(ARM_FILE, run)
    text = PYMUNK.programs.write_program(
        ARM_FILE, Run(**{**vars(run), "settings": wanted.settings}), "", ""
    )
    found = program_curves(text, tmp_path)
    for name in run.channels:
        assert np.abs(found[name] - wanted.channels[name]).max() < 1e-9, name


def write_four_bar(folder: Path, actuators: str, ctrl: str) -> Path:
    """Write the four-bar with other actuators."""
    text = shipped("fourbar.xml").read_text(encoding="utf-8")
    text = text.replace('<motor name="motor" joint="crank"/>', actuators)
    text = text.replace("2.2459278597319283", f'2.2459278597319283" ctrl="{ctrl}')
    text = text.replace("-2.2459278", f'-2.2459278" ctrl="{ctrl}')
    file = folder / "fourbar.xml"
    file.write_text(text, encoding="utf-8")
    return file


def crank_sweep(file: Path, angle: np.ndarray) -> Run:
    """A sweep of the crank."""
    drive = Drive("crank", lambda x: (np.asarray(x), np.ones_like(x), np.zeros_like(x)))
    return Run("sweep", angle, ("rocker", "rocker_rate", "holding_moment"), (drive,))


MOTOR = '<motor name="motor" joint="crank"/>'
SERVO = '<position name="hold" joint="rocker" kp="30" kv="5" gear="2"/>'
CRANK_ANGLES = np.linspace(0.0, 6.0, 61)


def test_a_servo_on_the_rocker_adds_its_virtual_work_at_the_crank(tmp_path: Path):
    """At rest the moment gear kp (2 - gear rocker) acts with the rocker's rate by the crank."""
    plain = write_four_bar(tmp_path, MOTOR, "0")
    free = planar.solve(
        CRANK_ANGLES, model=mujoco.MjModel.from_xml_path(str(plain)), joints=("crank",)
    )
    file = write_four_bar(tmp_path, MOTOR + SERVO, "0 2")
    known = planar.solve(
        CRANK_ANGLES, model=mujoco.MjModel.from_xml_path(str(file)), joints=("crank",)
    )
    more = -2.0 * 30.0 * (2.0 - 2.0 * known["rocker"]) * known["rocker_rate"]
    assert np.ptp(more) > 50.0
    assert np.abs(known["holding_moment"] - free["holding_moment"] - more).max() < 1e-11
    for simulate in (in_mujoco, in_pymunk):
        found = simulate(file, crank_sweep(file, CRANK_ANGLES)).channels
        assert np.abs(found["holding_moment"] - known["holding_moment"]).max() < 1e-9


def test_a_servo_on_the_driven_joint_does_not_act(tmp_path: Path):
    """The servo itself does not act: its sensor has the moment that the drive needs."""
    servo = '<position name="motor" joint="crank" kp="50" kv="3" forcerange="-1 1"/>'
    file = write_four_bar(tmp_path, servo, "0")
    known = planar.solve(
        CRANK_ANGLES, model=mujoco.MjModel.from_xml_path(str(file)), joints=("crank",)
    )
    plain = mujoco.MjModel.from_xml_path(str(shipped("fourbar.xml")))
    motor = planar.solve(CRANK_ANGLES, model=plain, joints=("crank",))["holding_moment"]
    assert np.abs(known["holding_moment"] - motor).max() < 1e-12
    for simulate in (in_mujoco, in_pymunk):
        found = simulate(file, crank_sweep(file, CRANK_ANGLES)).channels
        assert np.abs(found["holding_moment"] - motor).max() < 1e-9


@pytest.mark.parametrize("option", ['actuatorgroupdisable="0"', "flag"])
def test_disabled_servos_do_not_act(option: str, tmp_path: Path):
    """In both engines and in the reference the arm falls freely."""
    off = (
        '<option><flag actuation="disable"/></option>'
        if option == "flag"
        else (f"<option {option}/>")
    )
    text = ARM_FILE.read_text(encoding="utf-8").replace("</mujoco>", f"{off}</mujoco>")
    file = tmp_path / "arm.xml"
    file.write_text(text, encoding="utf-8")
    known = planar.solve(TIMES[:21], model=mujoco.MjModel.from_xml_path(str(file)))
    assert np.abs(known["elbow"] - planar_motion()["elbow"][:21]).max() > 0.1
    run = Run("dynamics", TIMES[:21], ("shoulder", "elbow"), settings={"timestep": 1e-4})
    for simulate in (in_mujoco, in_pymunk):
        found = simulate(file, run).channels
        for name, curve in found.items():
            assert np.abs(curve - known[name]).max() < 1e-4 * np.ptp(known[name])


@pytest.mark.parametrize("kind", ["servo", "motor"])
@pytest.mark.parametrize(
    ("more", "what"),
    [
        ('damping="1"', "damping"),
        ('damping="0 1"', "polynomial damping"),
        ('armature="1"', "armature"),
        ('delay="0.1" nsample="20"', "delay"),
    ],
)
def test_unsupported_properties_of_actuators_are_refused(kind, more, what, tmp_path: Path):
    """On a driven joint they are not refused, since the actuator does not act there."""
    own = SERVO if kind == "servo" else '<motor name="hold" joint="rocker"/>'
    file = write_four_bar(tmp_path, MOTOR.replace("/>", f" {more}/>") + own, "0 2")
    model = mujoco.MjModel.from_xml_path(str(file))
    assert planar.solve(CRANK_ANGLES, model=model, joints=("crank",))
    file = write_four_bar(tmp_path, MOTOR + own.replace("/>", f" {more}/>"), "0 2")
    model = mujoco.MjModel.from_xml_path(str(file))
    with pytest.raises(NotCovered, match=f"^{what} of actuator 'hold'"):
        planar.solve(CRANK_ANGLES, model=model, joints=("crank",))
    with pytest.raises(Unsupported, match=f"^{what} of actuator 'hold'"):
        in_pymunk(file, crank_sweep(file, CRANK_ANGLES))


def test_force_ranges_are_refused_by_pymunk_only(tmp_path: Path):
    """MuJoCo and the reference agree; pymunk refuses a range.  See also `test_controls.py`."""
    more = SERVO.replace("/>", ' forcerange="-140 5"/>')
    file = write_four_bar(tmp_path, MOTOR + more, "0 0")
    known = planar.solve(
        CRANK_ANGLES, model=mujoco.MjModel.from_xml_path(str(file)), joints=("crank",)
    )
    wide = write_four_bar(tmp_path, MOTOR + SERVO, "0 0")
    free = planar.solve(
        CRANK_ANGLES, model=mujoco.MjModel.from_xml_path(str(wide)), joints=("crank",)
    )
    assert np.abs(known["holding_moment"] - free["holding_moment"]).max() > 1.0
    file = write_four_bar(tmp_path, MOTOR + more, "0 0")
    found = in_mujoco(file, crank_sweep(file, CRANK_ANGLES)).channels
    assert np.abs(found["holding_moment"] - known["holding_moment"]).max() < 1e-9
    with pytest.raises(Unsupported, match="forcerange of actuator 'hold'"):
        in_pymunk(file, crank_sweep(file, CRANK_ANGLES))


def test_a_wrong_gain_in_the_engine_exceeds_the_tolerance(tmp_path: Path):
    """An error of a thousandth of the gain exceeds the tolerance of 1e-4 of the range."""
    known, file = planar_motion(), tmp_path / "arm.xml"
    file.write_text(ARM_FILE.read_text(encoding="utf-8").replace('kp="120"', 'kp="120.12"'))
    found = in_mujoco(file, Run("dynamics", TIMES, ("shoulder",))).channels
    assert np.abs(found["shoulder"] - known["shoulder"]).max() > 1e-4 * np.ptp(known["shoulder"])


def test_sensors_of_a_driven_joint_with_gear_and_armature_match_mujoco(tmp_path: Path):
    """The sensor shows the moment before the gear; armatures have energy and need moments."""
    motor = '<motor name="motor" joint="crank" gear="2.5"/>'
    text = write_four_bar(tmp_path, motor, "0").read_text(encoding="utf-8")
    more = '<jointactuatorfrc name="whole" joint="crank"/><e_kinetic name="kinetic"/></sensor>'
    text = text.replace("</sensor>", more)
    text = text.replace('<joint name="rocker"', '<joint name="rocker" armature="0.7"')
    file = tmp_path / "geared.xml"
    file.write_text(text, encoding="utf-8")
    names = ("holding_moment", "whole", "kinetic")
    run = replace(crank_sweep(file, CRANK_ANGLES), channels=names, inertia=True)
    found, model = in_mujoco(file, run).channels, mujoco.MjModel.from_xml_path(str(file))
    known = planar.solve(CRANK_ANGLES, model=model, joints=("crank",), inertia=True)
    for name in names:
        # rounding of moments up to 100 N m
        np.testing.assert_allclose(known[name], found[name], rtol=0, atol=1e-11, err_msg=name)
    np.testing.assert_allclose(known["whole"], 2.5 * known["holding_moment"], rtol=1e-14)
    bare = planar.solve(
        CRANK_ANGLES,
        model=mujoco.MjModel.from_xml_path(str(shipped("fourbar.xml"))),
        joints=("crank",),
        inertia=True,
    )
    assert np.abs(known["whole"] - bare["holding_moment"]).max() > 0.1


@pytest.mark.parametrize("ranges", [(2.0, 9.0), (9.0, 2.0), (9.0, 9.0)])
def test_the_narrower_of_two_force_ranges_applies(ranges: tuple[float, float]):
    """The motor's range is before the gear, the joint's after it, for a disc of 0.5 kg m^2."""
    motor, joint = ranges
    model = mujoco.MjModel.from_xml_string(f"""<mujoco><worldbody><body>
      <joint name="a" actuatorfrcrange="{-joint} {joint}" actuatorfrclimited="true"/>
      <inertial pos="0 0 0" mass="1" diaginertia=".5 .5 .5"/></body></worldbody>
      <actuator><motor name="m" joint="a" gear="2" forcelimited="true"
        forcerange="{-motor} {motor}"/></actuator>
      <sensor><jointpos name="a" joint="a"/><actuatorfrc name="m" actuator="m"/></sensor>
      <keyframe><key name="start" ctrl="5"/></keyframe></mujoco>""")
    t = np.linspace(0.0, 1.0, 5)
    for solve in (planar.solve, spatial.solve):
        found = solve(t, model=model)
        moment = min(2.0 * min(5.0, motor), joint)
        np.testing.assert_allclose(found["a"], moment * t**2, rtol=0, atol=1e-13)


def test_a_drive_overcomes_dry_friction_in_its_direction():
    """Friction is 0.3 N m in its joint, and 0.2 in a joint that a gear of ratio -2 drives."""
    model = mujoco.MjModel.from_xml_string("""<mujoco><option gravity="0 0 0"/><worldbody>
      <body><joint name="a" frictionloss=".3"/><geom size="0.1"/></body>
      <body pos="1 0 0"><joint name="b" frictionloss=".2"/><geom size="0.1"/></body></worldbody>
      <equality><joint joint1="b" joint2="a" polycoef="0 -2 0 0 0"/></equality>
      <actuator><motor name="m" joint="a"/></actuator>
      <sensor><jointactuatorfrc name="m" joint="a"/></sensor></mujoco>""")
    angle, rate = np.array([0.0, 0.5, 1.0, 0.5, 0.0]), np.array([1.0, 1.0, 0.0, -1.0, -1.0])
    found = planar.solve(angle, rate, model=model, joints=("a",))["m"]
    # at rest the direction is that of the motion before
    np.testing.assert_allclose(
        found, 0.7 * np.array([1.0, 1.0, 1.0, -1.0, -1.0]), atol=1e-15, rtol=0
    )
