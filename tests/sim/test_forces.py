"""Tests of holding moments and of forces between bodies, in both engines, at rest and in motion."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from proofmass.analytic.linkages import pendulum
from proofmass.analytic.planar import solve
from proofmass.case.drive import Steady, Swing
from proofmass.run.sidecar import load_case
from proofmass.run.solve import solve as run_case
from proofmass.sim.engines import engine_of
from proofmass.sim.protocol.curves import Curves
from proofmass.sim.protocol.run import Drive, Run
from proofmass.sim.pymunk import dynamics, model, quasi_static
from proofmass.sim.pymunk.kinematics import values_of
from proofmass.sim.pymunk.reactions import SampledMotion, solve_forces
from proofmass.verdict.compare import compare
from tests.shipped import shipped

EITHER_ENGINE = pytest.mark.parametrize("engine", ["mujoco", "pymunk"])
FORCE_CHANNELS = tuple(
    f"{name}_force.{part}" for name in ("crank", "coupler", "pin", "rocker") for part in "xy"
)
CHANNELS = ("holding_moment", *FORCE_CHANNELS)
FOUR_BAR_FILE = shipped("fourbar_forces.xml")
G = 9.81
CASES_WITH_FORCES = sorted(file.stem for file in FOUR_BAR_FILE.parent.glob("*_forces.toml"))


def simulate(engine: str, file: Path, run: Run) -> Curves:
    """A run in an engine, in this process."""
    return engine_of(engine).simulate(file, run)


def four_bar_run(kind: str, profile, n: int = 61, **settings: object) -> Run:
    """A run of the four-bar whose crank has a motion profile."""
    return Run(
        kind, np.linspace(0.0, 6.0, n), CHANNELS, (Drive("crank", profile),), settings=settings
    )


def general_solver_curves(
    curves: Curves, file: Path = FOUR_BAR_FILE, **inertia: bool
) -> dict[str, np.ndarray]:
    """Curves of the general planar solver at the motion that the engine's drive really had."""
    assert curves.drive is not None
    compiled = mujoco.MjModel.from_xml_path(str(file))
    return solve(*curves.drive, model=compiled, joints=("crank",), **inertia)


def largest_relative_error(curves: Curves, truth: dict[str, np.ndarray]) -> float:
    """The largest error of all channels, each as a share of its range."""
    return max(
        float(np.abs(y - truth[n]).max() / np.ptp(truth[n])) for n, y in curves.channels.items()
    )


def write_model(folder: Path, text: str, option: str = "") -> Path:
    """Write an MJCF with these elements and gravity along -y, and return its path."""
    file = folder / "model.xml"
    file.write_text(
        f'<mujoco><compiler angle="radian"/><option gravity="0 -{G} 0" {option}>'
        f'<flag contact="disable"/></option>{text}</mujoco>'
    )
    return file


@EITHER_ENGINE
def test_a_sweep_at_rest_has_the_forces_of_the_general_solver(engine):
    curves = simulate(engine, FOUR_BAR_FILE, four_bar_run("sweep", Steady(0.0, 6.0, False)))
    assert not curves.missing
    assert (
        largest_relative_error(curves, general_solver_curves(curves)) < 1e-13
    )  # rounding of the pose


@EITHER_ENGINE
def test_the_ground_pins_carry_all_weight_at_rest(engine):
    """The forces at both ground pins add up to the weight of 5.5 kg, with no horizontal part.

    Their sensors are in the frames of crank and rocker.
    """
    run = four_bar_run("sweep", Steady(0.0, 6.0, False))
    run = Run(run.kind, run.x, (*CHANNELS, "rocker"), run.drives)
    found = simulate(engine, FOUR_BAR_FILE, run).channels
    crank, rocker = (
        (found[f"{name}_force.x"] + 1j * found[f"{name}_force.y"]) * np.exp(1j * angle)
        for name, angle in (("crank", run.x), ("rocker", found["rocker"]))
    )
    np.testing.assert_allclose(crank + rocker, 5.5j * G, atol=1e-11)  # rounding of 50 N


def test_a_sweep_with_inertia_has_the_forces_of_the_motion():
    run = four_bar_run("sweep", Swing(0.3, 4.0, 3.0))
    run = Run(run.kind, run.x, run.channels, run.drives, inertia=True)
    curves = simulate("mujoco", FOUR_BAR_FILE, run)
    assert (
        largest_relative_error(curves, general_solver_curves(curves, inertia=True)) < 1e-13
    )  # rounding of the pose
    assert largest_relative_error(curves, general_solver_curves(curves)) > 0.1


@pytest.mark.parametrize("inertia", [False, True], ids=["at rest", "in motion"])
@pytest.mark.parametrize("name", CASES_WITH_FORCES)
def test_mujoco_forces_equal_closed_forms_to_rounding(name, inertia):
    """The case's sweep is replaced by one of a hundred poses, with inertia and without."""
    case = load_case(shipped(f"{name}.toml"))
    sweep = case.run["sweep"].model_copy(update={"inertia": inertia, "n": 100})
    case = case.model_copy(update={"run": {"sweep": sweep}})
    found = compare(case, "sweep", "mujoco", run_case(case, "sweep", "mujoco"), detectable=False)
    assert {c.channel for c in found} >= {n for n in case.channels if "force" in n}
    # 1e-11 of the range: rounding of the pose, divided by the size of the triangle that the pins of
    # a loop span
    assert max(c.relative_to_range for c in found) < 1e-11


def test_pymunk_has_no_forces_in_a_sweep_with_inertia():
    run = four_bar_run("sweep", Steady(0.0, 6.0, False), 3)
    run = Run(run.kind, run.x, run.channels, run.drives, inertia=True)
    curves = simulate("pymunk", FOUR_BAR_FILE, run)
    assert curves.missing.keys() == set(CHANNELS)
    assert "those at rest" in curves.missing["pin_force.x"]


def test_pymunk_forces_are_of_second_order_in_the_step():
    errors = []
    for step in (4e-3, 2e-3, 1e-3):
        curves = simulate(
            "pymunk", FOUR_BAR_FILE, four_bar_run("dynamics", Swing(0.3, 4.0, 3.0), timestep=step)
        )
        errors.append(largest_relative_error(curves, general_solver_curves(curves, inertia=True)))
    ratios = np.array(errors[:-1]) / errors[1:]
    # terms of the next order, with steps of 2 and 1 ms, change the ratios by up to 5 %
    np.testing.assert_allclose(ratios, 4.0, rtol=0.05)


def test_softness_of_loops_is_the_error_floor_of_mujoco_forces():
    """The error floor is proportional to 1 - d, where d is the impedance of ``solimp``."""
    errors = []
    for soft in (1e-3, 1e-4):
        run = four_bar_run("dynamics", Swing(0.3, 4.0, 3.0), solimp=(1 - soft, 1 - soft, 1e-3))
        curves = simulate("mujoco", FOUR_BAR_FILE, run)
        errors.append(largest_relative_error(curves, general_solver_curves(curves, inertia=True)))
    assert errors[0] / errors[1] == pytest.approx(10.0, rel=0.02)  # the floor is linear in 1 - d


def test_loop_forces_have_the_sizes_of_chipmunks_impulses():
    """Computed forces of pins and drive have the sizes of Chipmunk's impulses over the step.

    Chipmunk gives the sizes of impulses only, without directions.
    """
    run = four_bar_run("sweep", Steady(0.0, 6.0, False), 5)
    links, settings = model.read_model(FOUR_BAR_FILE, run)
    quasi_static_space = quasi_static.start_sweep(links, settings)
    for value in run.x:
        quasi_static_space.settle(np.array([value]))
        quasi_static_space.step(values_of(links.drives, quasi_static_space.pose))
        impulse_forces = (
            np.array([each.impulse for each in quasi_static_space.space.constraints])
            / quasi_static_space.dt
        )
        found = solve_forces(links, SampledMotion.at_rest(quasi_static_space.pose[None]))[0]
        computed_forces = [*np.hypot(*found[:-1].reshape(-1, 2).T), abs(found[-1])]
        # 1e-9: Chipmunk's iterations
        np.testing.assert_allclose(sorted(impulse_forces), sorted(computed_forces), rtol=1e-9)


@EITHER_ENGINE
def test_the_pin_force_of_a_pendulum_equals_the_closed_form(engine, tmp_path):
    """The pin's force is the closed form's tension along the rod.

    The force across the rod and the moment are zero, since all mass is in a point.
    """
    file = write_model(
        tmp_path,
        '<worldbody><body name="rod"><joint name="rod"/><inertial pos="1 0 0" mass="2" '
        'diaginertia="1e-9 1e-9 1e-9"/><site name="pin"/></body></worldbody>'
        '<sensor><force name="pull" site="pin"/><torque name="twist" site="pin"/></sensor>'
        '<keyframe><key name="start" qpos="0"/></keyframe>',
        'integrator="RK4" timestep="2e-4"',
    )
    times = np.linspace(0.0, 2.0, 41)
    found = simulate(engine, file, Run("dynamics", times, ("pull.x", "pull.y", "twist.z"))).channels
    truth = pendulum.solve(times, length=1.0, mass=2.0, gravity=G, amplitude=np.pi / 2)
    # Chipmunk's phase lags by (omega dt)^2 / 24 per radian, 4e-7 here; the bob's moment of inertia
    # is 1e-9 kg m^2
    np.testing.assert_allclose(-found["pull.x"], truth["tension"], atol=1e-4)
    np.testing.assert_allclose(found["pull.y"], 0.0, atol=1e-5)
    np.testing.assert_allclose(found["twist.z"], 0.0, atol=1e-6)


SPRUNG = """<worldbody><body name="arm">
<joint name="arm" damping="{damping}" armature="{armature}"/>
<inertial pos=".5 0 0" mass="2" diaginertia=".1 .1 .1"/><site name="root"/>
<body name="end" pos="1 0 0"><joint name="end" stiffness="30"/>
<inertial pos=".3 0 0" mass="1" diaginertia=".02 .02 .02"/><site name="elbow"/></body></body>
</worldbody>
<sensor><jointactuatorfrc name="moment" joint="arm"/><torque name="twist" site="root"/>
<torque name="bend" site="elbow"/><force name="hang" site="elbow"/>
<jointpos name="end" joint="end"/></sensor><keyframe><key name="start" qpos="0 0"/></keyframe>"""


@EITHER_ENGINE
def test_the_elbow_of_a_sprung_arm_carries_its_spring_and_weight(engine, tmp_path):
    """At rest, the elbow's moment is that of its spring, and its force the weight of the end body.

    The force sensor is in the frame of the end body, whose angle is that of the arm plus the
    spring's.  The holding moment carries both weights.
    """
    file = write_model(tmp_path, SPRUNG.format(damping=0, armature=0))
    channels = ("moment", "twist.z", "bend.z", "hang.x", "hang.y", "end")
    run = Run("sweep", np.linspace(0.0, 1.0, 5), channels, (Drive("arm", Steady(0, 1, False)),))
    curves = simulate(engine, file, run)
    found, angle = curves.channels, run.x + curves.channels["end"]
    np.testing.assert_allclose(
        found["bend.z"], -30 * found["end"], atol=1e-9, rtol=0
    )  # rest to 1e-11 rad
    hang = (found["hang.x"] + 1j * found["hang.y"]) * np.exp(1j * angle)
    np.testing.assert_allclose(hang, 1j * G, atol=1e-12)
    moment = G * (2 * 0.5 * np.cos(run.x) + np.cos(run.x) + 0.3 * np.cos(angle))
    np.testing.assert_allclose(found["moment"], moment, atol=1e-9, rtol=0)
    np.testing.assert_allclose(found["twist.z"], moment, atol=1e-9, rtol=0)


@EITHER_ENGINE
def test_a_holding_moment_includes_armature_and_damping(engine, tmp_path):
    """A drive's moment includes the damping and the armature of its joint.

    The torque sensor between arm and ground shows neither.
    """
    profile = Swing(0.0, 1.0, 2.0)
    times = np.linspace(0.0, 2.0, 41)
    found = {}
    for damping, armature in ((0.0, 0.0), (3.0, 0.5)):
        text = SPRUNG.format(damping=damping, armature=armature).replace("30", "0")
        for element in ('<joint name="end" stiffness="0"/>', '<jointpos name="end" joint="end"/>'):
            text = text.replace(element, "")
        file = write_model(
            tmp_path, text.replace('qpos="0 0"', 'qpos="0"'), 'integrator="RK4" timestep="5e-4"'
        )
        run = Run("dynamics", times, ("moment", "twist.z"), (Drive("arm", profile),))
        found[damping] = simulate(engine, file, run).channels
    _, rate, acceleration = profile(times)
    added_moment = found[3.0]["moment"] - found[0.0]["moment"]
    # Chipmunk's damper acts on the velocity of half a step before; the step is 5e-4 s
    np.testing.assert_allclose(added_moment, 3.0 * rate + 0.5 * acceleration, atol=5e-3)
    np.testing.assert_allclose(found[3.0]["twist.z"], found[0.0]["twist.z"], atol=1e-3)


LOADED = """<worldbody><body name="arm"><joint name="arm"/>
<inertial pos=".5 0 0" mass="2" diaginertia=".1 .1 .1"/><site name="root"/>
<site name="end" pos="1 0 0"/></body><site name="world"/></worldbody>
<actuator><motor name="wind" site="end" refsite="world" gear="3 0 0 0 0 0"/></actuator>
<sensor><force name="foot" site="root"/></sensor>
<keyframe><key name="start" qpos="0" ctrl="1"/></keyframe>"""


def test_pymunk_forces_include_loads_on_sites_and_mujoco_omits_them(
    tmp_path,
):
    file = write_model(tmp_path, LOADED)
    drive = (Drive("arm", Steady(0, 1, False)),)
    run = Run("sweep", np.linspace(0.0, 1.0, 5), ("foot.x", "foot.y"), drive)
    found = simulate("pymunk", file, run).channels
    foot = (found["foot.x"] + 1j * found["foot.y"]) * np.exp(1j * run.x)
    np.testing.assert_allclose(foot, -3.0 + 2j * G, atol=1e-12)
    assert "'wind'" in simulate("mujoco", file, run).missing["foot.x"]


def test_a_driven_joint_with_friction_has_no_holding_moment(tmp_path):
    text = FOUR_BAR_FILE.read_text().replace(
        '<joint name="crank"/>', '<joint name="crank" frictionloss="1"/>'
    )
    file = tmp_path / "model.xml"
    file.write_text(text)
    curves = simulate("mujoco", file, four_bar_run("dynamics", Steady(0.0, 1.0, True), 7))
    assert "friction" in curves.missing["holding_moment"]
    assert set(curves.channels) == set(FORCE_CHANNELS)


def test_accelerations_of_the_sample_before_give_wrong_forces(monkeypatch):
    """Mutation: forces at each sample are computed with the accelerations of the sample before.

    Their errors are then more than 100 times as large.
    """
    step, errors = 1e-3, []
    for shifted in (False, True):
        if shifted:
            central = SampledMotion.__init__

            def with_accelerations_of_sample_before(
                self, pose, velocity, acceleration, *more, central=central
            ):
                central(self, pose, velocity, np.roll(acceleration, 1, axis=0), *more)

            monkeypatch.setattr(SampledMotion, "__init__", with_accelerations_of_sample_before)
        run = four_bar_run("dynamics", Swing(0.3, 4.0, 3.0), timestep=step)
        curves = simulate("pymunk", FOUR_BAR_FILE, run)
        errors.append(largest_relative_error(curves, general_solver_curves(curves, inertia=True)))
    assert errors[1] > 100 * errors[0]
    assert dynamics.SampledMotion is SampledMotion
