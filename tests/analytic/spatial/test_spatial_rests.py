"""Driven mechanisms in space with joints that no drive determines: equilibria and motions."""

import copy
import re
from pathlib import Path

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from proofmass.analytic import planar, spatial
from proofmass.analytic.equilibrium import Unstable
from proofmass.analytic.numerics import NotCovered
from proofmass.analytic.spatial.equilibrium import TreeAtRest
from proofmass.analytic.spatial.kinematics import advance_pose
from proofmass.analytic.spatial.mechanism import read_tree
from proofmass.batch.check import check
from proofmass.reference.case_model import compiled_model
from proofmass.reference.evaluate import evaluate, properties
from proofmass.run.sidecar import load_case
from proofmass.run.solve import plan_run
from proofmass.sim.mujoco.engine import simulate as in_mujoco
from proofmass.sim.protocol.run import ChangingLoad, Drive, Run
from proofmass.sim.smooth import SmoothTerms
from tests.analytic.planar.test_planar_rests import ANGLES, bar_profile, random_chain, write_limbs
from tests.shipped import shipped

ARM_MODEL = """<mujoco><compiler angle="radian"/><option gravity="0.5 0.3 -9.81" integrator="RK4"
  timestep="5e-4">
  <flag contact="disable" energy="enable"/></option><worldbody><site name="ground" pos="0 .3 1"/>
  <body name="arm" pos="0 0 1"><joint name="arm" axis="0 .2 1"/>
    <inertial pos=".3 0 0" mass="1" diaginertia=".1 .1 .1"/>
    <body name="two" pos=".6 0 0"><joint name="ball" type="ball" stiffness="30" damping=".1"/>
      <inertial pos=".2 .05 0" mass=".7" diaginertia=".02 .03 .04"/>
      <body name="three" pos=".4 0 0">
        <joint name="hinge" axis="0 1 .3" stiffness="15" springref=".2" {hinge}/>
        <joint name="slide" type="slide" axis="1 0 .2" stiffness="200" {slide}/>
        <inertial pos=".1 0 .1" mass=".4" diaginertia=".01 .01 .01"/>
        <site name="end" pos=".2 .1 0"/></body></body></body></worldbody>
  <tendon><spatial name="cord" stiffness="12" springlength=".1 .3"><site site="ground"/>
    <site site="end"/></spatial></tendon>
  <actuator><motor name="drive" joint="arm"/>
    <motor name="pull" site="end" gear="1 .5 -.3 .1 .2 0"/></actuator>
  <sensor><actuatorfrc name="moment" actuator="drive"/><e_potential name="level"/>
    <jointpos name="hinge" joint="hinge"/><jointpos name="slide" joint="slide"/>
    <jointvel name="hinge_rate" joint="hinge"/><framequat name="turn" objtype="site" objname="end"/>
    <framepos name="end" objtype="site" objname="end"/>
    <framelinvel name="velocity" objtype="site" objname="end"/>
    <framelinacc name="acceleration" objtype="site" objname="end"/>
    <frameangvel name="spin" objtype="site" objname="end"/></sensor>
  <keyframe><key name="start" qpos="0 1 0 0 0 0 0" ctrl="0 {pull}"/></keyframe></mujoco>"""


def write_arm(folder: Path, hinge: str = "", slide: str = "", pull: float = 1.0) -> Path:
    """Write a driven arm with a ball, a hinge and a slide on springs, a cord, a follower load."""
    file = folder / f"arm{len(list(folder.iterdir()))}.xml"
    file.write_text(ARM_MODEL.format(hinge=hinge, slide=slide, pull=pull))
    return file


def sweep_equilibria(
    file: Path, angles: np.ndarray = ANGLES, **arguments: object
) -> dict[str, np.ndarray]:
    """The spatial reference of a sweep of the arm."""
    model = mujoco.MjModel.from_xml_path(str(file))
    return spatial.solve(angles, model=model, joints=("arm",), **arguments)


def test_ball_joints_are_moved_as_by_constant_rates(tmp_path):
    """The result is that of constant rates for a unit of time, also beyond half a turn."""
    tree = read_tree(mujoco.MjModel.from_xml_path(str(write_arm(tmp_path))), "start")
    ways = np.random.default_rng(0).normal(0.0, 2.0, (8, tree.armature.size))
    begin = advance_pose(tree, tree.start, ways[0])
    moved = TreeAtRest(tree, ("arm",)).moved(np.tile(begin, (8, 1)), ways)
    known = [advance_pose(tree, begin, way) for way in ways]
    np.testing.assert_allclose(moved, known, rtol=0, atol=1e-15)  # rounding of values below 8


STOP_RANGES = ('range="-.9 .28" limited="true"', 'range="-.04 .1" limited="true"')


@pytest.mark.parametrize("stops", [False, True])
def test_equilibria_are_those_of_mujoco(tmp_path, stops):
    """The arm has a ball, a tendon, a load, and stops that joints reach and leave; with rates."""
    file = write_arm(tmp_path, *(STOP_RANGES if stops else ()))
    known = sweep_equilibria(file)
    on = [np.isclose(known[name], end).sum() for name, end in (("hinge", 0.28), ("slide", -0.04))]
    assert [0 < count < ANGLES.size for count in on] == [stops, stops]
    names = tuple(name for name in known if "acceleration" not in name)
    found = in_mujoco(file, Run("sweep", ANGLES, names, (Drive("arm", bar_profile),)))
    assert not found.stopped
    for name in names:
        error = 1e-10 if name.split(".")[0] in ("hinge_rate", "velocity", "spin") else 1e-11
        assert np.abs(found.channels[name] - known[name]).max() < error, name
    assert np.isnan(known["acceleration.x"]).all()
    assert np.ptp(known["turn.y"]) > 0.1


def test_the_moment_of_the_drive_is_the_slope_of_the_energy(tmp_path):
    """Without a load the moment of the drive is the slope of the energy of springs and weights."""
    file, step = write_arm(tmp_path, pull=0.0), 1e-4
    for angle in (0.5, 2.0, 3.5):
        found = sweep_equilibria(file, np.array([angle - step, angle, angle + step]))
        slope = (found["level"][2] - found["level"][0]) / (2 * step)
        assert found["moment"][1] == pytest.approx(slope, abs=1e-6)
    assert abs(slope) > 0.1


def test_rates_are_slopes_of_the_path(tmp_path):
    step, file = 1e-4, write_arm(tmp_path)
    found = sweep_equilibria(file, np.array([1.0 - step, 1.0, 1.0 + step]))
    for name, rate in (("hinge", "hinge_rate"), ("end.x", "velocity.x"), ("end.z", "velocity.z")):
        slope = (found[name][2] - found[name][0]) / (2 * step)
        assert found[rate][1] == pytest.approx(slope, abs=1e-7)


def test_equilibria_under_a_changing_load_are_those_of_mujoco(tmp_path):
    """Values and rates agree with MuJoCo."""
    file = write_arm(tmp_path)

    def profile(t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return 0.5 * t**2, t, np.ones_like(t)

    angles = ANGLES[:13]
    size, rate, _ = profile(angles)
    known = sweep_equilibria(file, angles, controls={"pull": size}, control_rates={"pull": rate})
    names = ("hinge", "hinge_rate", "velocity.x", "velocity.z", "moment")
    load = (ChangingLoad("pull", profile),)
    run = Run("sweep", angles, names, (Drive("arm", bar_profile),), loads=load)
    found = in_mujoco(file, run).channels
    assert np.abs(known["hinge_rate"] - sweep_equilibria(file, angles)["hinge_rate"]).max() > 0.02
    for name in names:
        assert np.abs(found[name] - known[name]).max() < 1e-9


@pytest.mark.parametrize("ranges", [(), ('limited="true" range="-1 .1"',)])
def test_planar_equilibria_are_those_of_the_planar_reference(tmp_path, ranges):
    model = mujoco.MjModel.from_xml_path(str(write_limbs(tmp_path, *ranges)))
    angles = ANGLES[20::2]  # a joint reaches its stop in between
    one, two = (part.solve(angles, model=model, joints=("bar",)) for part in (planar, spatial))
    on = np.isclose(one["two"], 0.1)
    assert on.any() == bool(ranges)
    assert not on.all()
    for name in ("two", "three", "two_rate", "three_rate", "end.x", "velocity.y", "moment"):
        np.testing.assert_allclose(two[name], one[name], rtol=0, atol=1e-11)


def test_redundant_constraint_rows_are_allowed():
    """A `connect` of a planar linkage constrains the plane's normal twice; the load changes."""
    case = load_case(shipped("finger.toml"))
    run, model = plan_run(case, "sweep", "mujoco"), compiled_model(case)
    x = run.x[::4]
    state = tuple(part[0] for part in run.motion(x))
    controls, rates = ({"contact": part[0]} for part in run.controls(x))
    arguments = {
        "model": model,
        "joints": ("driver",),
        "controls": controls,
        "control_rates": rates,
    }
    one, two = (part.solve(*state, **arguments) for part in (planar, spatial))
    for name in case.channels:
        np.testing.assert_allclose(two[name], one[name], rtol=0, atol=1e-11)


def test_random_chains_have_the_equilibria_of_the_planar_reference():
    """Chains have slack springs, ranges and loads; both paths end at an unstable equilibrium."""
    x, ended = np.linspace(0.0, 1.5, 7), 0
    for seed in (2, 3, 129):
        model, results = mujoco.MjModel.from_xml_string(random_chain(seed)), []
        for part in (planar, spatial):
            try:
                results.append(part.solve(x, model=model, joints=("j0",)))
            except Unstable as error:
                results.append(str(error))
        one, two = results
        if isinstance(one, str):
            ended += 1
            places = [float(re.findall(r"drives at ([\d.]+)", said)[0]) for said in results]
            assert places[1] == pytest.approx(places[0], abs=1e-5)  # printed with six digits
            assert re.sub(r"at [\d.]+", "", one) == re.sub(r"at [\d.]+", "", two)
            continue
        assert one.keys() == two.keys()
        for name in one:
            np.testing.assert_allclose(two[name], one[name], rtol=0, atol=1e-9)
    assert 0 < ended < 3


def test_the_wrist_yields_about_its_compliance_centre():
    """Six springs along n at points p have the stiffness k Σ w wᵀ, w = (n, p x n), about a point.

    The compliance centre is the point about which a force along x causes no rotation about y: the
    tip of the peg.  If the tip is moved, the axis of the peg changes only in second order in its y
    component, and in third order in its x component.
    """
    model = compiled_model(load_case(shipped("compliant_wrist.toml")))
    model.opt.gravity[:] = 0.0
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    ends = [data.site(f"{part}_{k}").xpos for part in ("flange", "plate") for k in range(1, 7)]
    above, below = np.array(ends[:6]), np.array(ends[6:])
    along = (above - below) / np.linalg.norm(above - below, axis=1)[:, None]
    rows = np.hstack([along, np.cross(below, along)])  # about the tip, at the origin
    stiffness = model.tendon_stiffness[0] * rows.T @ rows
    assert abs(stiffness[0, 4]) < 1e-9 * np.abs(stiffness[:3, :3]).max()
    assert (
        abs(model.tendon_lengthspring[:, 0] - np.linalg.norm(above - below, axis=1)).max() < 1e-13
    )
    ways = np.array([-2e-4, -1e-4, 0.0, 1e-4, 2e-4])
    found = spatial.solve(ways, model=model, joints=("hand",))
    for name, power in (("axis.x", 3), ("axis.y", 2)):
        assert found[name][4] / found[name][3] == pytest.approx(2.0**power, rel=1e-3)
        assert abs(found[name][3]) < 1e-2 * 1e-4 / 0.035
    slope = (found["force"][3] - found["force"][1]) / 2e-4
    assert slope == pytest.approx(stiffness[0, 0], rel=1e-5)
    model = copy.copy(model)
    model.tendon_stiffness[:2] *= 2.0  # the springs are no longer equal: another centre
    found = spatial.solve(ways, model=model, joints=("hand",))
    assert found["axis.x"][4] / found["axis.x"][3] == pytest.approx(2.0, rel=1e-2)


@pytest.mark.parametrize(
    ("name", "long", "short", "how"),
    [
        ("compliant_wrist", "n = 361", "n = 9", "at equilibria for the drives' values"),
        ("tower_crane", r"until = 30\.0", "until = 3.0", "integrated with DOP853"),
    ],
)
def test_properties_state_the_method_without_solving_again(name, long, short, how, edit):
    """The properties use the path or the motion that was solved for the channels."""
    case = load_case(edit(f"{name}.toml", long, short, 1))
    (kind,) = case.run
    run = plan_run(case, kind, "mujoco")
    evaluate(case, kind, run.x, run.motion(run.x))
    kept = [
        spatial.follow_equilibria_cached.cache_info().misses,
        spatial.integrate_in_time_cached.cache_info().misses,
    ]
    assert how in properties(case)["equations of motion"]
    after = [
        spatial.follow_equilibria_cached.cache_info().misses,
        spatial.integrate_in_time_cached.cache_info().misses,
    ]
    assert after == kept


def test_sweeps_that_are_not_covered_are_refused(tmp_path):
    with pytest.raises(NotCovered, match="a path of equilibria has no inertia"):
        sweep_equilibria(write_arm(tmp_path), ANGLES[:2], inertia=True)
    text = ARM_MODEL.format(hinge="", slide="", pull=0.0).replace('stiffness="200"', "")
    model = mujoco.MjModel.from_xml_string(text.replace('stiffness="12"', ""))
    model.opt.gravity[:] = 0.0
    with pytest.raises(Unstable, match="the start pose leads to no stable equilibrium"):
        spatial.solve([0.0, 0.1], model=model, joints=("arm",))


CRANE = """<mujoco><compiler angle="radian"/><option gravity="0 0 -9.81"><flag contact="disable"/>
  </option><worldbody><body name="jib"><joint name="slew" axis="0 0 1"/>
    <inertial pos="1 0 0" mass="3" diaginertia="1 1 1"/>
    <body name="rope" pos="2 0 0"><joint name="rope" type="ball"/>
      <inertial pos="0 0 -1.5" mass="1" diaginertia=".01 .01 .01"/>
      <site name="load" pos="0 0 -1.5"/></body></body></worldbody>
  <actuator><motor name="drive" joint="slew"/></actuator>
  <sensor><framepos name="load" objtype="site" objname="load"/>
    <framelinacc name="acceleration" objtype="site" objname="load"/>
    <actuatorfrc name="moment" actuator="drive"/></sensor>
  <keyframe><key name="start" qpos="0 1 0 0 0"/></keyframe></mujoco>"""


def test_the_load_of_a_turning_crane_swings_outwards():
    """tan(angle) = rate² (jib + rope sin(angle)) / g, and the drive has no moment."""
    rate, model = 1.3, mujoco.MjModel.from_xml_string(CRANE)
    angle = 0.5
    for _ in range(200):
        angle = np.arctan(rate**2 * (2.0 + 1.5 * np.sin(angle)) / 9.81)
    model.key_qpos[0, 1:] = np.cos(angle / 2), 0.0, -np.sin(angle / 2), 0.0
    model.key_qvel[0, :] = rate, 0.0, 0.0, 0.0  # the rope turns with the jib
    times = np.linspace(0.0, 3.0, 31)

    def profile(t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return rate * t, np.full_like(t, rate), np.zeros_like(t)

    found = spatial.solve(
        *profile(times), model=model, joints=("slew",), in_time=(times, (profile,))
    )
    away = 2.0 + 1.5 * np.sin(angle)
    np.testing.assert_allclose(found["load.x"], away * np.cos(rate * times), rtol=0, atol=1e-11)
    np.testing.assert_allclose(found["load.z"], -1.5 * np.cos(angle), rtol=0, atol=1e-11)
    np.testing.assert_allclose(found["moment"], 0.0, rtol=0, atol=1e-9)


def test_the_load_of_the_crane_is_a_point_mass_on_a_rope():
    """In Cartesian coordinates, with l = r - p from the trolley's position p and the length L::

    r'' = g - (|l'|² + l·(g - p'')) / L² l
    """
    case = load_case(shipped("tower_crane.toml"))
    times = np.linspace(0.0, 12.0, 25)
    slew, run = (drive.profile for drive in plan_run(case, "dynamics", "mujoco").drives)
    gravity = np.array([0.0, 0.0, -9.81])

    def trolley(t: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        (turn, rate, bend), (x, speed, push) = (law(np.array(t)) for law in (slew, run))
        out = np.exp(1j * turn)
        parts = x, speed + 1j * x * rate, push + 2j * speed * rate + x * (1j * bend - rate**2)
        flat = [complex(part * out) for part in parts]
        heights = 40.0, 0.0, 0.0
        return tuple(np.array([f.real, f.imag, z]) for f, z in zip(flat, heights, strict=True))

    def slope(t: float, y: np.ndarray) -> np.ndarray:
        place, velocity, acceleration = trolley(t)
        rope, pace = y[:3] - place, y[3:] - velocity
        pull = (pace @ pace + rope @ (gravity - acceleration)) / (rope @ rope)
        return np.concatenate([y[3:], gravity - pull * rope])

    begin = np.concatenate([trolley(0.0)[0] - [0.0, 0.0, 25.0], np.zeros(3)])
    known = solve_ivp(slope, (0, 12), begin, "DOP853", times, rtol=1e-12, atol=1e-12).y
    joints = tuple(drive.joint for drive in case.drive)
    state = [np.array([law(times)[k] for law in (slew, run)]) for k in range(3)]
    in_time, model = (times, (slew, run)), compiled_model(case)
    found = spatial.solve(
        *state,
        model=model,
        joints=joints,
        inertia=True,
        in_time=in_time,
        terms=SmoothTerms(model),
    )
    for k, part in enumerate("xyz"):
        np.testing.assert_allclose(found[f"load.{part}"], known[k], rtol=0, atol=1e-8)
    assert np.ptp(found["load.z"]) > 0.05
    place, _, _ = trolley(6.0)
    assert np.linalg.norm(known[:3, 12] - place) == pytest.approx(25.0, abs=1e-9)


@pytest.mark.parametrize("stop", ["", 'range="-.4 .45" limited="true" solreflimit="0.01 1"'])
def test_a_driven_planar_motion_is_that_of_the_planar_reference(stop):
    """A driven cart with a double pendulum, without and with a stop on which it bounces or rests.

    The cart is driven beyond the end of its own range, which does not stop a drive.
    """
    text = shipped("driven_cart.xml").read_text(encoding="utf-8")
    joint = '<joint name="upper"'
    assert text.count(joint) == 1
    text = text.replace('axis="1 0 0"/>', 'axis="1 0 0" range="-1 .1" limited="true"/>', 1)
    model = mujoco.MjModel.from_xml_string(text.replace(joint, f"{joint} {stop}"))
    case = load_case(shipped("driven_cart.toml"))
    run, times = plan_run(case, "dynamics", "mujoco"), np.linspace(0.0, 1.2, 25)
    (profile,) = (drive.profile for drive in run.drives)
    state = profile(times)
    arguments = {
        "model": model,
        "start": case.start,
        "joints": tuple(drive.joint for drive in run.drives),
        "inertia": True,
        "in_time": (times, (profile,)),
    }
    one = planar.solve(*state, **arguments)
    two = spatial.solve(*state, **arguments, terms=SmoothTerms(model))
    assert len(one.keys() & two.keys()) > 5
    assert state[0].max() > 0.1
    for name in one.keys() & two.keys():
        np.testing.assert_allclose(two[name], one[name], rtol=0, atol=1e-9, err_msg=name)


def test_mujoco_converges_to_a_driven_spatial_motion(tmp_path):
    """Half the step divides the errors by more than four, also that of the drive's moment."""
    file, times = write_arm(tmp_path), np.linspace(0.0, 0.3, 7)
    model = mujoco.MjModel.from_xml_path(str(file))

    def profile(t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return 0.5 * np.sin(2 * t), np.cos(2 * t), -2 * np.sin(2 * t)

    arguments = {"joints": ("arm",), "in_time": (times, (profile,)), "inertia": True}
    known = spatial.solve(*profile(times), model=model, terms=SmoothTerms(model), **arguments)
    names = ("hinge", "slide", "end.x", "end.z", "turn.y", "spin.z", "moment")
    errors = []
    for step in (1e-3, 5e-4):
        settings = {"timestep": step, "integrator": "RK4"}
        run = Run("dynamics", times, names, (Drive("arm", profile),), settings=settings)
        found = in_mujoco(file, run).channels
        errors.append([np.abs(found[name] - known[name]).max() for name in names])
    assert max(errors[1]) < 1e-5
    assert (np.array(errors[1]) < np.array(errors[0]) / 4).all()


ARM_SIDECAR = """title = "Arm"
source = "of the tests"
reference = "spatial"
drive = { joint = "arm", from = 0.0, to = 1.0, rate = 1.0 }
run.sweep = { n = 16, solvers = ["mujoco"] }
run.dynamics = { solvers = ["mujoco"], n = 11 }
[channels]
moment = { unit = "N m" }
"acceleration.x" = { unit = "m/s^2" }
hinge = { unit = "rad" }
hinge_rate = { unit = "rad/s" }
"""


def test_a_sidecar_needs_only_the_drive(tmp_path):
    write_arm(tmp_path, pull=0.0).rename(tmp_path / "arm.xml")
    (tmp_path / "arm.toml").write_text(ARM_SIDECAR)
    case = load_case(tmp_path / "arm.toml")
    shares = [
        case.tolerance_for("sweep", "mujoco", name).relative_to_range
        for name in ("hinge", "hinge_rate")
    ]
    assert shares == [1e-12, 1e-10]  # rates contain differences of forces
    found = check([tmp_path], jobs=1, detectable=False).comparisons
    outcomes = {(c.run, c.channel): c.outcome for c in found}
    assert [outcomes["sweep", name] for name in ("moment", "hinge", "hinge_rate")] == ["agrees"] * 3
    assert outcomes["sweep", "acceleration.x"] == "unsupported"
    assert outcomes["dynamics", "hinge"] == "agrees"
