"""Tests of the reference "refined", which solves a model's own equations.

It is compared with other references, and cases that it does not cover are refused.
"""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from proofmass.base.errors import InputError
from proofmass.base.read_once import forget_inputs
from proofmass.reference.evaluate import evaluate, properties
from proofmass.reference.samples import run_samples
from proofmass.reference.self_consistency import Rung
from proofmass.run.sidecar import load_case
from proofmass.run.solve import prescribed_run, solve
from proofmass.sim.mujoco import own_motion
from proofmass.sim.mujoco.engine import simulate as in_mujoco
from proofmass.sim.protocol.run import Run
from proofmass.verdict.compare import compare
from tests.shipped import shipped

BOX_SIDECAR = shipped("tumbling_box.toml")


def with_refined_reference(name, **run):
    """A shipped case with the reference "refined" instead of its own."""
    case = load_case(shipped(f"{name}.toml"))
    kept = case.run["dynamics"].model_copy(update=run)
    return case.model_copy(update={"reference": "refined", "run": {"dynamics": kept}})


def brief_tumbling_box(**changed):
    """The box's case with three quarters of its motion, in which its corners hit the floor."""
    case = load_case(BOX_SIDECAR)
    kept = case.run["dynamics"].model_copy(update={"n": 61, "until": 0.3})
    return case.model_copy(update={"run": {"dynamics": kept}, **changed})


@pytest.fixture
def fewer_steps(monkeypatch):
    """Steps are halved only down to an eighth.

    They decide until when a motion is known, and do not change its curves.
    """
    monkeypatch.setattr(own_motion, "MAX_HALVINGS", own_motion.MIN_HALVINGS)


@pytest.mark.parametrize("enabled", [False, True])
def test_the_sensor_of_kinetic_energy_is_an_evaluation_late_if_the_flag_energy_is_set(enabled):
    """MuJoCo 4.0.0 then shows the kinetic energy of the evaluation before."""
    model = mujoco.MjModel.from_xml_path(str(shipped("heavy_top.xml")))
    if enabled:
        model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    shown = []
    for factor in (1.0, 1.01, 1.01):
        data.qvel[:] = factor * model.key_qvel[0]
        mujoco.mj_forward(model, data)
        shown.append(float(data.sensor("kinetic").data[0]))
    first, second, third = shown
    assert third == pytest.approx(1.01**2 * first)
    assert second == (first if enabled else third)


@pytest.mark.parametrize("integrator", ["Euler", "RK4"])
def test_a_run_shows_the_kinetic_energy_of_its_samples(edit, integrator):
    """Of the rates that it shows at the same samples, also if the model sets the flag energy."""
    x, found = np.linspace(0.0, 0.2, 11), {}
    for flag in ("", ' energy="enable"'):
        file = edit("heavy_top.xml", "<flag .*/>", f'<flag contact="disable"{flag}/>')
        run = Run("dynamics", x, ("kinetic",), settings={"integrator": integrator})
        found[flag] = in_mujoco(file, run).channels["kinetic"]
    plain, with_flag = found.values()
    assert np.ptp(plain) > 0
    np.testing.assert_array_equal(with_flag, plain)


@pytest.mark.parametrize(
    "instrument", ['cutoff="1e-3"', 'nsample="9" delay="0.05"', 'nsample="9" interval="0.05"']
)
def test_a_sensor_shows_the_quantity_itself(edit, instrument):
    """Without the cutoff, the delay or the interval of an instrument that would measure it."""
    run = Run("dynamics", np.linspace(0.0, 0.5, 26), ("angle",))
    plain = in_mujoco(shipped("pendulum.xml"), run).channels["angle"]
    file = edit("pendulum.xml", '<jointpos name="angle"', rf"\g<0> {instrument}")
    np.testing.assert_array_equal(in_mujoco(file, run).channels["angle"], plain)
    assert np.ptp(plain) > 0.1


@pytest.mark.usefixtures("fewer_steps")
@pytest.mark.parametrize(("name", "until"), [("heavy_top", 0.5), ("euler_top", 2.0)])
def test_a_motion_without_contacts_equals_the_spatial_reference(name, until):
    """The spatial reference integrates the same equations with a tolerance of 3e-14."""
    case = with_refined_reference(name, until=until, n=41)
    x = run_samples(case, "dynamics")
    found = evaluate(case, "dynamics", x, None).channels
    other = case.model_copy(update={"reference": "spatial"})
    true = evaluate(other, "dynamics", x, None).channels
    for channel, curve in true.items():
        assert np.abs(found[channel] - curve).max() < 1e-6 * max(1.0, np.abs(curve).max()), channel


@pytest.mark.usefixtures("fewer_steps")
def test_steps_that_are_six_times_as_long_differ():
    case = brief_tumbling_box()
    slow = brief_tumbling_box(settings={"mujoco": {"timestep": 6e-3}})
    for one in (case, slow):
        curves = solve(one, "dynamics", "mujoco")
        found = compare(one, "dynamics", "mujoco", curves, detectable=False)
        assert ("differs" in {c.outcome for c in found}) == (one is slow)


@pytest.mark.usefixtures("fewer_steps")
def test_errors_fall_with_the_step():
    """Errors are of first order and scatter with the time of an impact within its step."""
    worst = []
    for step in (1e-3, 2e-5):
        one = brief_tumbling_box(settings={"mujoco": {"timestep": step}})
        curves = solve(one, "dynamics", "mujoco")
        found = compare(one, "dynamics", "mujoco", curves, detectable=False)
        worst.append(max(c.error_max for c in found if c.unit == "m"))
    assert worst[0] > 10 * worst[1]


@pytest.mark.usefixtures("fewer_steps")
def test_the_page_states_until_when_a_motion_is_known():
    """The page states the equations, and until when the motion is known and how exactly.

    This test is before the next one, which clears the stored motion of the box.
    """
    described = properties(brief_tumbling_box())
    assert "with soft contacts" in described["equations of motion"]
    known = described["self-consistent"]
    assert known.startswith("until 0.3 s, its end, ")
    assert "off by" in known


def test_a_motion_that_is_not_known_to_its_end_is_refused(monkeypatch):
    forget_inputs()
    monkeypatch.setattr(Rung, "is_sure", False)
    case = load_case(shipped("euler_top.toml")).model_copy(update={"reference": "refined"})
    with pytest.raises(InputError, match=r"motion is not known until 0.1 s: until 0.1 s, its end"):
        evaluate(case, "dynamics", np.linspace(0.0, 0.1, 3), None)
    forget_inputs()


def test_a_sweep_and_rods_are_refused():
    case = load_case(shipped("universal_joint.toml")).model_copy(update={"reference": "refined"})
    run = prescribed_run(case, "sweep")
    with pytest.raises(InputError, match="a run of sweep; it is a motion in time"):
        evaluate(case, "sweep", run.x, run.motion(run.x))
    case = load_case(shipped("rod_released.toml")).model_copy(update={"reference": "refined"})
    with pytest.raises(InputError, match="does not cover it: rods"):
        evaluate(case.model_copy(update={"parameters": {}}), "dynamics", np.linspace(0, 1, 3), None)


@pytest.mark.usefixtures("fewer_steps")
def test_a_motion_with_a_drive_equals_the_planar_reference():
    """The drive of the planar reference is exact.

    The reference "refined" has a flywheel of 1e9 times the inertia and a tolerance of 1e-9, whose
    errors are within 1e-7.
    """
    case = with_refined_reference("driven_cart", n=41, until=1.0)
    run = prescribed_run(case, "dynamics")
    found = evaluate(case, "dynamics", run.x, run.motion(run.x)).channels
    other = case.model_copy(update={"reference": "planar"})
    true = evaluate(other, "dynamics", run.x, run.motion(run.x)).channels
    for channel, curve in true.items():
        assert np.abs(found[channel] - curve).max() < 1e-7 * max(1.0, np.ptp(curve)), channel
    assert max(np.ptp(curve) for curve in true.values()) > 1.0


@pytest.mark.usefixtures("fewer_steps")
def test_fine_steps_with_soft_loops_converge_to_the_reference():
    """Runs with finer steps converge to the reference with soft loops, and not to the rigid one."""
    case = with_refined_reference("fourbar", n=31)
    leader = case.drive[0].model_copy(update={"to": 1.5, "rate": 5.0})
    names = ("rocker", "holding_moment")
    kept = {name: case.channels[name].model_copy(update={"equals": name}) for name in names}
    update = {"drive": (leader,), "parameters": {}, "channels": kept, "tolerance": ()}
    case = case.model_copy(update=update)
    run = prescribed_run(case, "dynamics")
    true = evaluate(case, "dynamics", run.x, run.motion(run.x)).channels
    rigid = case.model_copy(update={"reference": "planar"})
    rigid = evaluate(rigid, "dynamics", run.x, run.motion(run.x)).channels
    errors, errors_of_rigid = [], []
    for step in (5e-4, 2.5e-4):
        settings = {"timestep": step, "integrator": "RK4"}
        found = in_mujoco(case.model_path, replace(run, settings=settings)).channels
        errors.append(max(np.abs(found[name] - true[name]).max() for name in names))
        errors_of_rigid.append(max(np.abs(found[name] - rigid[name]).max() for name in names))
    assert errors[0] / errors[1] > 3.5
    assert errors[1] < 0.1 * errors_of_rigid[1]


@pytest.mark.usefixtures("fewer_steps")
def test_a_motion_with_changing_controls_equals_the_planar_reference():
    case = with_refined_reference("axes_controlled", n=11, until=0.5)
    x = run_samples(case, "dynamics")
    found = evaluate(case, "dynamics", x, None).channels
    true = evaluate(case.model_copy(update={"reference": "planar"}), "dynamics", x, None).channels
    for channel, curve in true.items():
        assert np.abs(found[channel] - curve).max() < 1e-7 * max(1.0, np.ptp(curve)), channel


STIFF_SERVO = """
<mujoco><option gravity="0 0 0" timestep="{step}"/><worldbody><body><joint name="j" axis="0 1 0"/>
<inertial pos="0 0 0" mass="1" diaginertia=".01 .01 .01"/></body></worldbody>
<actuator><position joint="j" kp="3948" kv="2.5"/></actuator><sensor><jointpos name="j" joint="j"/>
</sensor><keyframe><key name="start" qpos="0.1" ctrl="0"/></keyframe></mujoco>
"""
STIFF_SIDECAR = """
title = "A servo that needs finer steps than its model has"
source = "MuJoCo's issue 3443: kp 3948, kv 2.5 on 0.01 kg m2"
reference = "refined"
[run.dynamics]
until = 0.02
n = 41
solvers = ["mujoco"]
[settings.mujoco]
timestep = 2.5e-5
integrator = "RK4"
[[tolerance]]
run = "dynamics"
solver = "mujoco"
relative_to_range = 1e-4
why = "RK4 with 25 us and a frequency of 628 rad/s: (h omega)^4 is 6e-8 a step, over 800 steps"
"""


@pytest.mark.parametrize("step", [5e-4, 5e-3])
def test_a_model_that_fails_with_its_own_step_has_a_reference(step, tmp_path):
    # Euler breaks at 2 (sqrt(1 + zeta^2) - zeta) / omega = 2.6 ms: the first step runs
    (tmp_path / "stiff.xml").write_text(STIFF_SERVO.format(step=step), encoding="utf-8")
    (tmp_path / "stiff.toml").write_text(STIFF_SIDECAR, encoding="utf-8")
    case = load_case(tmp_path / "stiff.toml")
    t = run_samples(case, "dynamics")
    found = evaluate(case, "dynamics", t, None).channels["j"]
    omega = np.sqrt(3948 / 0.01)
    zeta = 2.5 / (2 * 0.01 * omega)
    damped = omega * np.sqrt(1 - zeta**2)
    exact = 0.1 * np.exp(-zeta * omega * t)
    exact *= np.cos(damped * t) + zeta * omega / damped * np.sin(damped * t)
    assert found == pytest.approx(exact, abs=1e-8)
    [compared] = compare(case, "dynamics", "mujoco", solve(case, "dynamics", "mujoco"))
    assert compared.outcome == "agrees"
