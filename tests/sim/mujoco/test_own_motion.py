"""Tests of a model's own motion, solved in several ways, against independent equations."""

import re
import time
from pathlib import Path
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from proofmass.reference.self_consistency import Rung, why_failed
from proofmass.screen.screen import screen_model
from proofmass.sim.mujoco import own_motion
from proofmass.sim.mujoco.engine import ENGINE, simulate
from proofmass.sim.mujoco.own_motion import (
    CoordinateRates,
    copy_with_changes,
)
from proofmass.sim.mujoco.work import StepWork
from proofmass.sim.protocol.failures import BadModel
from proofmass.sim.protocol.run import Run
from tests.shipped import shipped

EQUATIONS = ENGINE.own_equations
FREE_ROTOR = """<mujoco><option gravity="0 0 0"/><worldbody><body name="b" pos="0 0 1"><freejoint/>
  <inertial pos="0 0 0" mass="1" diaginertia="1 2 3"/><geom size="0.1"/></body></worldbody>
  <keyframe><key qpos="0 0 1 1 0 0 0" qvel="0.1 0 0 0.01 2 0.01"/></keyframe></mujoco>"""
PENDULUM = """<mujoco><option timestep="0.01"/><worldbody><body name="b"><joint name="j"
  axis="0 1 0"/><inertial pos="0 0 -1" mass="1" diaginertia="1e-9 1e-9 1e-9"/></body></worldbody>
  <keyframe><key qpos="1"/></keyframe></mujoco>"""
SERVO_IN_BALANCE = """<mujoco><option timestep="{step}" gravity="0 0 0"/><worldbody><body><joint
  name="j" axis="0 1 0"/><inertial pos="0 0 0" mass="1" diaginertia="1e-3 1.389e-3 1e-3"/></body>
  </worldbody><actuator><velocity joint="j" kv="2"/></actuator>
  <keyframe><key qvel="1" ctrl="1"/></keyframe></mujoco>"""
MODEL_WITH_ALL_JOINTS = """<mujoco><worldbody>
  <body name="a"><joint name="s" type="slide" axis="1 0 0"/><joint name="h"/><geom size=".1"/>
    <body name="c" pos="1 0 0"><joint name="b" type="ball"/><geom size=".1" pos=".1 0 0"/></body>
  </body><body name="f" pos="0 0 2"><freejoint/><geom size=".1"/></body></worldbody></mujoco>"""


def solved_motion(tmp_path, text, **asked):
    file = tmp_path / "model.xml"
    file.write_text(text)
    given = {"until": 1.0, "samples": 51, "seconds": 30.0, "choose": choose_rk4}
    return EQUATIONS.solve_motion(file, **{**given, **asked})


def choose_rk4(motion, ways):
    """RK4 with the model's own step."""
    solved = (way.solve(way.seconds) for way in ways if way.evaluations == 4 / motion.runs[0].step)
    return tuple(one for one in solved if one.name.startswith("RK4"))


def test_ways_cost_what_their_steps_evaluate(tmp_path):
    """One evaluation of the dynamics a step, four in RK4, and more in implicit."""
    costs = dict[str, float]()

    def solve_own_steps(motion, ways):
        coarse = [way for way in ways if way.evaluations <= 4 / motion.runs[0].step]
        found = [(way.solve(1.0), way.evaluations) for way in coarse]
        costs.update({run.name: cost * 0.01 for run, cost in found})
        assert all(run.evaluations == cost for run, cost in found)
        return ()

    motion = solved_motion(tmp_path, PENDULUM, choose=solve_own_steps)
    steps = {"implicitfast, 10 ms": 1, "implicitfast, 5 ms": 2, "implicitfast, 2.5 ms": 4}
    assert costs == pytest.approx({**steps, "RK4, 10 ms": 4})
    assert [run.evaluations for run in motion.runs[:3]] == pytest.approx([100, 200, 400])
    implicit = PENDULUM.replace("<option", '<option integrator="implicit"')
    assert 100 < solved_motion(tmp_path, implicit).runs[0].evaluations < 200


def test_rates_of_coordinates_equal_those_of_the_engine():
    """Rates of coordinates equal central differences of `mj_integratePos`."""
    model = mujoco.MjModel.from_xml_string(MODEL_WITH_ALL_JOINTS)
    chosen = np.random.default_rng(3)
    pose, speed = model.qpos0.copy(), chosen.normal(size=model.nv)
    mujoco.mj_integratePos(model, pose, chosen.normal(size=model.nv), 1.0)
    h = 1e-6
    ahead, back = pose.copy(), pose.copy()
    mujoco.mj_integratePos(model, ahead, speed, h)
    mujoco.mj_integratePos(model, back, speed, -h)
    slope = (ahead - back) / (2 * h)
    assert (
        np.abs(CoordinateRates(model).rates(pose, speed) - slope).max() < 1e-9
    )  # error of central differences


def test_a_spinning_body_follows_eulers_equations(tmp_path):
    """Euler's equations are written with a rotation matrix and integrated by another method."""
    motion = solved_motion(tmp_path, FREE_ROTOR)
    inertia = np.array([1.0, 2.0, 3.0])

    def slope(_, state):
        turn, rate = state[:9].reshape(3, 3), state[9:]
        x, y, z = rate
        across = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        return [*(turn @ across).ravel(), *(-np.cross(rate, inertia * rate) / inertia)]

    begin = [*np.eye(3).ravel(), 0.01, 2.0, 0.01]
    options = {"method": "Radau", "rtol": 1e-10, "atol": 1e-12, "t_eval": motion.times}
    true = solve_ivp(slope, (0.0, motion.times[-1]), begin, **options)
    radius = min(np.sqrt(inertia.sum() / 2), motion.extent)
    axes = true.y[:9].T.reshape(-1, 3, 3)
    points = motion.close.points[:, 0]
    assert np.abs(points[:, 0] - [0, 0, 1] - 0.1 * motion.times[:, None] * [1, 0, 0]).max() < 1e-9
    for k in (0, 1):
        assert np.abs(points[:, 1 + k] - points[:, 0] - radius * axes[:, :, k]).max() < 1e-7
    assert len(motion.runs) == 7


def test_a_pendulum_follows_its_equation_with_halved_steps(tmp_path):
    motion = solved_motion(tmp_path, PENDULUM)
    options = {"method": "Radau", "rtol": 1e-11, "atol": 1e-12, "t_eval": motion.times}
    true = solve_ivp(
        lambda _, y: [y[1], -9.81 * np.sin(y[0])], (0.0, motion.times[-1]), [1.0, 0.0], **options
    ).y[0]
    place = -np.stack([np.sin(true), 0 * true, np.cos(true)], axis=-1)
    errors = [np.abs(one.points[:, 0, 0] - place).max() for one in motion.runs]
    assert np.abs(motion.close.points[:, 0, 0] - place).max() < 1e-8
    assert [one.step for one in motion.runs] == [0.01 / 2**k for k in range(7)]
    assert np.allclose(np.array(errors[:-1]) / errors[1:], 2.0, rtol=0.1)  # Euler's order
    (rk4,) = motion.others
    assert np.abs(rk4.points[:, 0, 0] - place).max() < 1e-3 * errors[0]
    assert motion.stiffer is None
    parted = np.abs(motion.disturbed.points - motion.runs[motion.compared].points).max()
    assert 1e-11 < parted < 1e-8
    energy = motion.close.energy
    assert np.ptp(energy) < 1e-7  # of 9.81 J


DOUBLE = """<mujoco><option timestep="0.002"/><worldbody><body><joint axis="0 1 0"/>
  <inertial pos="0 0 -1" mass="1" diaginertia="1e-9 1e-9 1e-9"/><body pos="0 0 -1">
  <joint axis="0 1 0"/><inertial pos="0 0 -1" mass="1" diaginertia="1e-9 1e-9 1e-9"/></body></body>
  </worldbody><keyframe><key qpos="1 2"/></keyframe></mujoco>"""


def test_the_energy_of_a_double_pendulum_is_constant(tmp_path):
    """The energy is computed with the mass matrix of the pose.

    That of RK4's last stage would cause errors of 2e-5 J.
    """
    motion = solved_motion(tmp_path, DOUBLE)
    (rk4,) = motion.others
    for one in (motion.close, rk4):
        assert np.ptp(one.energy) < 1e-6  # of 20 J


def test_samples_are_whole_steps_apart_and_the_step_is_the_models_own(tmp_path):
    motion = solved_motion(tmp_path, PENDULUM.replace("0.01", "0.003"), samples=101)
    assert motion.runs[0].step == 0.003
    assert np.allclose(np.diff(motion.times), 0.009)
    assert motion.times[-1] == pytest.approx(0.999)
    slow = solved_motion(tmp_path, PENDULUM.replace("0.01", "0.2"))
    assert np.allclose(np.diff(slow.times), 0.2)


def test_a_short_computing_time_ends_runs_without_dropping_any(tmp_path, monkeypatch):
    """A step of 10 ms counts 1 ms of processor time in this test, one of 10 ms / m counts m ms.

    The first run takes 100 ms.  If a step took as long with every size, 14 samples with halved
    steps would fit into the 400 ms for each run: 51 * 400 / (2 + 4 + 8) / 100.  From one sample to
    the next the runs take 2, 8, 32 and 128 ms, so that the last two are late after 12 and 3
    intervals of the 13.
    """
    monkeypatch.setattr(
        own_motion,
        "StepWork",
        lambda model: SimpleNamespace(
            step=lambda _: 1e-3 * round(0.01 / model.opt.timestep),
            evaluation=lambda _: 1e-3,
            evaluations=1,
        ),
    )
    motion = solved_motion(tmp_path, PENDULUM, seconds=1.0)
    assert [one.step for one in motion.runs] == [0.01, 0.005, 0.0025, 0.00125]
    assert [len(one.points) for one in motion.runs] == [51, 14, 13, 4]
    assert [one.late for one in motion.runs] == [False, False, True, True]
    assert [bool(one.stopped) for one in motion.runs] == [False, False, True, True]
    assert motion.runs[2].stopped == "its steps reached 0.4 s of counted processor time"


@pytest.mark.parametrize("speed", [0.1, 10.0])
def test_a_motion_is_solved_alike_on_slow_and_on_fast_machines(speed, tmp_path, monkeypatch):
    """The processor time decides nothing: 10 ms are enough for a part of the runs alone."""
    slow = solved_motion(tmp_path, DOUBLE, seconds=0.01)
    real = time.thread_time
    monkeypatch.setattr(time, "thread_time", lambda: speed * real())
    fast = solved_motion(tmp_path, DOUBLE, seconds=0.01)
    assert len(slow.runs[1].points) < len(slow.times)  # the time ends the finer runs
    for one, other in zip((*slow.runs, slow.close), (*fast.runs, fast.close), strict=True):
        assert (one.name, one.work, one.stopped) == (other.name, other.work, other.stopped)
        assert np.array_equal(one.points, other.points)


def test_steps_that_cost_far_more_than_counted_are_ended_and_reported(tmp_path, monkeypatch):
    monkeypatch.setattr(own_motion, "SLOWNESS", 0.0)
    monkeypatch.setattr(own_motion, "MIN_SLOW_SECONDS", 0.0)
    motion = solved_motion(tmp_path, PENDULUM)
    assert motion.runs[0].late
    assert re.fullmatch(
        r"it used \S+ s of processor time for steps that count \S+ s", motion.runs[0].stopped
    )
    assert motion.runs[0].stopped in why_failed(motion)


FAILING = """
<mujoco><option gravity="0 0 0" timestep="{step}"/><worldbody><body><joint name="j" axis="0 1 0"/>
<inertial pos="0 0 0" mass="1" diaginertia=".01 .01 .01"/></body></worldbody>
<actuator><position joint="j" kp="3948" kv="2.5"/></actuator>
<keyframe><key qpos="0.1" ctrl="0"/></keyframe></mujoco>
"""


@pytest.mark.parametrize(("step", "halvings"), [(2e-3, 0), (4e-3, 1), (16e-3, 3)])
def test_a_model_that_fails_is_solved_from_the_first_halving_that_does_not(
    step, halvings, tmp_path
):
    # Euler breaks at 2 (sqrt(1 + zeta^2) - zeta) / omega = 2.6 ms
    motion = solved_motion(tmp_path, FAILING.format(step=step))
    assert motion.runs[0].step == pytest.approx(step / 2**halvings)
    assert not motion.runs[0].is_failure
    assert (motion.failed is not None) == bool(halvings)
    assert len(motion.runs) >= own_motion.MIN_HALVINGS
    if halvings:
        assert f"; with Euler, {1e3 * step / 2**halvings:.4g} ms it comes" in why_failed(motion)
    else:
        assert not why_failed(motion)


OPEN_WELD = """<mujoco><option gravity="0 0 0"/><worldbody><body name="a"><joint axis="0 1 0"/>
  <geom type="capsule" fromto="0 0 0 0 0 -1" size=".1"/></body></worldbody>
  <equality><weld body1="a" body2="world" torquescale="2"/></equality>
  <keyframe><key qpos="0.988"/></keyframe></mujoco>"""


@pytest.mark.parametrize(("step", "fails"), [(0.005, True), (0.00125, False)])
def test_a_step_that_is_too_long_is_noticed_though_the_start_is_in_balance(tmp_path, step, fails):
    # Euler multiplies a difference of speeds by 1 - h kv / I in each step; kv = 2, I = 1.389e-3
    motion = solved_motion(tmp_path, SERVO_IN_BALANCE.format(step=step))
    assert (abs(1 - step * 2.0 / 1.389e-3) > 1) is fails
    assert bool(motion.failed) is fails
    if fails:
        assert why_failed(motion).startswith("from a start that differs by 1e-9: ")
        assert motion.runs[0].step == 0.00125  # the first halving of 5 ms below 2 I / kv = 1.39 ms


def test_a_weld_is_open_by_its_angle(tmp_path):
    """The first screen says the same angle: one measure for both."""
    own = solved_motion(tmp_path, OPEN_WELD).runs[0]
    assert (own.gap[0], own.opening_unit) == (pytest.approx(0.988, abs=1e-9), "rad")
    [found, *_] = screen_model(tmp_path / "model.xml").findings
    assert found.value == pytest.approx(own.gap[0])


HELD_ARM = Path(__file__).parents[2] / "data" / "screen" / "hold565.xml"


def test_stiffer_friction_shows_how_far_joints_creep(tmp_path):
    """With a quarter of the time constant, and a quarter of what the impedance lets give way."""
    motion = solved_motion(tmp_path, HELD_ARM.read_text())
    creep = np.abs(motion.runs[motion.compared].points - motion.close.points[:1]).max()
    left = np.abs(motion.stiffer.points - motion.close.points[:1]).max()
    # the speed is (1 - d) / d D T: 0.1 T becomes 0.025 T / 4
    assert left / creep == pytest.approx(1 / 16, rel=0.05)
    words = Rung(motion).words()
    assert words.startswith("until 1 s, its end, contacts, loops, limits and dry friction 4 × as")
    assert "their softness matters more than the step, with which it is off by" in words


def test_contacts_of_distance_fields_are_counted_where_bodies_are_near():
    spec = mujoco.MjSpec()
    for name, place in (("one", 0.0), ("other", 0.1)):
        body = spec.worldbody.add_body(name=name, pos=[place, 0, 0])
        body.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[1, 0, 0])
        body.add_geom(size=[0.1, 0, 0])
    model = spec.compile()
    model.geom_type[0] = mujoco.mjtGeom.mjGEOM_SDF  # counted only, and never stepped
    work, near = StepWork(model), mujoco.MjData(model)
    near.geom_xpos[:] = [[0, 0, 0], [0.1, 0, 0]]
    far = mujoco.MjData(model)
    far.geom_xpos[:] = [[0, 0, 0], [0.3, 0, 0]]
    points = model.opt.sdf_initpoints * model.opt.sdf_iterations
    assert points > 0
    assert work.step(far) == work.fixed
    assert work.step(near) - work.fixed == pytest.approx(1e-6 * points, rel=1e-9)


def test_work_grows_with_all_that_costs_time():
    """RK4 evaluates the forces four times; bodies, constraints and implicit damping add to it."""
    text = (
        "<mujoco><worldbody><body><joint axis='0 1 0'/><geom size='.1' pos='1 0 0'/>{}</body>"
        "</worldbody><equality>{}</equality></mujoco>"
    )
    body = "<body pos='1 0 0'><joint axis='0 1 0'/><geom size='.1' pos='1 0 0'/></body>"
    loop = "<connect body1='world' body2='{}' anchor='1 0 0'/>"

    def work(integrator="EULER", body="", loop=""):
        model = mujoco.MjModel.from_xml_string(text.format(body, loop))
        model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator}")
        data = mujoco.MjData(model)
        mujoco.mj_step(model, data)
        return StepWork(model).step(data)

    held = loop.format("named")
    named = body.replace("<body ", "<body name='named' ")
    assert work("RK4") == pytest.approx(4 * work())
    assert work() < work("IMPLICIT") < work(body=named) < work(body=named, loop=held)


def test_runs_with_finer_steps_disable_sleeping():
    """MuJoCo puts a body to sleep after a number of steps in which it is slow.

    A run with finer steps would therefore put a body to sleep that starts slowly.
    """
    model = mujoco.MjModel.from_xml_string(
        MODEL_WITH_ALL_JOINTS.replace("<mujoco>", '<mujoco><option><flag sleep="enable"/></option>')
    )
    asleep = int(mujoco.mjtEnableBit.mjENBL_SLEEP)
    assert copy_with_changes(model, model.opt.timestep).opt.enableflags & asleep
    assert not copy_with_changes(model, model.opt.timestep / 2).opt.enableflags & asleep
    assert model.opt.enableflags & asleep


def test_a_stiffer_copy_has_stiffer_contacts():
    model = mujoco.MjModel.from_xml_string(MODEL_WITH_ALL_JOINTS)
    model.geom_solref[1] = -100.0, -2.0
    changed = copy_with_changes(model, 1e-3, stiffer=4.0)
    assert changed.geom_solref[0].tolist() == [0.005, 1.0]
    assert changed.geom_solref[1].tolist() == [-1600.0, -8.0]
    assert model.geom_solref[0].tolist() == [0.02, 1.0]
    assert (model.opt.timestep, changed.opt.timestep) == (0.002, 1e-3)


def test_a_model_that_does_not_compile_is_refused(tmp_path):
    with pytest.raises(BadModel):
        solved_motion(tmp_path, "<mujoco><worldbody><body><joint/></body></worldbody></mujoco>")


BALL = """<mujoco><option timestep="{}"/><worldbody><geom type="plane" size="1 1 1"/>
  <body pos="0 0 0.12"><freejoint/><geom size="0.1" solref="0.004 1"/></body></worldbody>
</mujoco>"""


def test_the_solution_without_steps_does_not_depend_on_the_step(tmp_path):
    """MuJoCo makes time constants of contacts at least two steps long, here of 10 ms and 1 ms."""
    one, two = (
        solved_motion(tmp_path, BALL.format(step), until=0.2, samples=11) for step in (0.01, 1e-3)
    )
    assert np.abs(one.close.points - two.close.points).max() < 1e-7
    assert np.abs(one.runs[0].points - two.runs[0].points).max() > 1e-4


def test_loops_are_closed_at_the_start_as_in_a_run_with_steps(tmp_path):
    text = shipped("fourbar.xml").read_text()
    key = re.search(r'<key name="start" +qpos="(\S+) +(\S+) ', text)
    opened = text.replace(key[0], key[0].replace(key[2], repr(float(key[2]) + 1e-3)))
    file = tmp_path / "fourbar.xml"
    file.write_text(opened)
    run = Run("dynamics", np.linspace(0.0, 0.01, 3), ("pin.x", "pin.y"))
    closely, stepped = EQUATIONS.solve_closely(file, run), simulate(file, run)
    for name in run.channels:
        assert closely.channels[name][0] == pytest.approx(stepped.channels[name][0], abs=1e-12)
    tight = EQUATIONS.solve_closely(shipped("fourbar.xml"), run)
    assert abs(closely.channels["pin.x"][0] - tight.channels["pin.x"][0]) > 1e-6
