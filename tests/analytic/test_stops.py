"""Joints that reach the ends of their ranges: closed forms, and MuJoCo's soft limits."""

from functools import cache

import mujoco
import numpy as np
import pytest

from proofmass.analytic import planar, spatial
from proofmass.analytic.contacts import bouncing_ball, restitution
from proofmass.analytic.numerics import NotCovered
from proofmass.analytic.planar import Overconstrained
from proofmass.analytic.stops import (
    MIN_REBOUND_HEIGHT,
    Step,
    Stop,
    find_flat_rebounds,
    impact_times,
)
from proofmass.sim.smooth import SmoothTerms
from tests.shipped import shipped

HEAD = '<mujoco><compiler autolimits="true" angle="radian"/><option><flag contact="disable"/>'
BOTH_SOLVERS = pytest.mark.parametrize(
    "solve", [planar.solve, spatial.solve], ids=["planar", "spatial"]
)


def falling_mass(ratio: float, more: str = "") -> mujoco.MjModel:
    """A mass on a vertical slide, with a stop 1 m below its start."""
    return mujoco.MjModel.from_xml_string(f"""{HEAD}</option><worldbody><body>
      <joint name="z" type="slide" axis="0 0 1" range="-1 9" solreflimit="0.01 {ratio}" {more}/>
      <geom size="0.1" mass="2"/></body></worldbody>
      <sensor><jointpos name="z" joint="z"/><jointvel name="rate" joint="z"/></sensor></mujoco>""")


@BOTH_SOLVERS
@pytest.mark.parametrize("ratio", [1e-9, 0.2, 1.0, 5.0])
def test_a_mass_bounces_on_a_stop_as_a_ball_on_the_ground(solve, ratio):
    """The closed form sums all bounces; the solvers leave out those lower than 1e-13 m."""
    t = np.linspace(0.0, 1.5, 151)
    found = solve(t, model=falling_mass(ratio))
    known = bouncing_ball.solve(t, height=1.0, restitution=restitution(ratio), gravity=9.81)
    assert np.ptp(known["height"]) > 0.99
    assert np.abs(found["z"] + 1.0 - known["height"]).max() < 1e-12
    assert np.abs(found["rate"] - known["velocity"]).max() < 1e-11


def two_discs(start: str) -> mujoco.MjModel:
    """The model of `two_masses` with discs of 1 and 3 kg m^2 on one axis instead of masses."""
    model = two_masses(start)
    model.jnt_type[:] = mujoco.mjtJoint.mjJNT_HINGE
    model.body_inertia[1:] = np.array([[1.0], [3.0]])
    return model


def two_masses(start: str, more: str = "") -> mujoco.MjModel:
    """Masses of 1 and 3 kg in line with a spring of 200 N/m between; the first has a stop at 0."""
    return mujoco.MjModel.from_xml_string(f"""{HEAD}</option><option gravity="0 0 0"/><worldbody>
      <body><joint name="a" type="slide" axis="1 0 0" range="0 9"/><geom size="0.1" mass="1"/>
        <body pos="1 0 0"><joint name="b" type="slide" axis="1 0 0" stiffness="200"/>
          <geom size="0.1" mass="3"/></body></body></worldbody>{more}
      <sensor><jointpos name="a" joint="a"/><jointpos name="b" joint="b"/></sensor>
      <keyframe><key name="start" {start}/></keyframe></mujoco>""")


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_rebound_is_left_out_below_the_least_height(side):
    """A rebound of rate v, in sizes, has the height v^2 / (2 g) before it comes back."""
    stop, g = Stop("s", 0, 0, 0.0, side, 0.5, size=0.2), 9.81
    state = np.zeros(1), np.zeros(1), np.array([side * g * stop.size])  # toward the stop
    for height, low in ((0.99 * MIN_REBOUND_HEIGHT, [1]), (1.01 * MIN_REBOUND_HEIGHT, [])):
        rate = -side * np.sqrt(2 * g * height) * stop.size
        assert find_flat_rebounds([stop, stop, stop], state, [0.0, rate, -side]) == low


@BOTH_SOLVERS
@pytest.mark.parametrize("two", [two_masses, two_discs])
def test_a_mass_leaves_its_stop_when_the_spring_pulls(solve, two):
    """The mass is pressed on its stop until the spring has no force; then both masses are free."""
    pressed, wide = np.sqrt(200.0 / 3.0), np.sqrt(200.0 / 0.75)
    off = np.pi / 2.0 / pressed
    t = np.linspace(0.0, off + np.pi / wide, 91)
    found = solve(t, model=two('qpos="0 -0.3"'))
    before, after = t < off, np.maximum(t - off, 0.0)
    speed = 0.3 * pressed
    apart = np.where(before, -0.3 * np.cos(pressed * t), speed / wide * np.sin(wide * after))
    first = np.where(before, 0.0, 0.75 * speed * after - 0.75 * apart)
    assert first.max() > 0.05
    assert np.abs(found["b"] - apart).max() < 1e-12
    assert np.abs(found["a"] - first).max() < 1e-12


@BOTH_SOLVERS
def test_a_mass_that_is_pulled_off_its_stop_leaves_it_at_once(solve):
    """The spring is stretched at the start, so both masses swing about the fixed centre of mass."""
    wide = np.sqrt(200.0 / 0.75)
    t = np.linspace(0.0, np.pi / wide, 41)
    found = solve(t, model=two_masses('qpos="0 0.3"'))
    apart = 0.3 * np.cos(wide * t)
    assert np.abs(found["b"] - apart).max() < 1e-12
    assert np.abs(found["a"] - 0.75 * (0.3 - apart)).max() < 1e-12


@BOTH_SOLVERS
def test_only_the_pulled_one_of_two_masses_leaves_its_stop(solve):
    """Each mass has its own spring: one is pressed on its stop, the other is pulled off it."""
    body = """<body><joint name="{}" type="slide" axis="1 0 0" range="0 9" stiffness="50"
      springref="{}"/><geom size="0.1" mass="2"/></body>"""
    model = mujoco.MjModel.from_xml_string(f"""{HEAD}</option><option gravity="0 0 0"/><worldbody>
      {body.format("pressed", -0.4)}{body.format("pulled", 0.3)}</worldbody>
      <sensor><jointpos name="pressed" joint="pressed"/><jointpos name="pulled" joint="pulled"/>
      </sensor></mujoco>""")
    t = np.linspace(0.0, 0.6, 31)
    found = solve(t, model=model)
    assert np.abs(found["pressed"]).max() < 1e-15
    assert np.abs(found["pulled"] - 0.3 * (1.0 - np.cos(5.0 * t))).max() < 1e-12


@BOTH_SOLVERS
def test_an_impact_on_one_stop_throws_another_mass_off_its_own(solve):
    """Momentum and restitution give the rates of two masses in line after the impact.

    The first mass leaves its stop, on which it rested.
    """
    model = two_masses('qpos="0 0" qvel="0 1.5"')
    model.opt.gravity[:] = (-2.0, 0.0, 0.0)
    model.jnt_stiffness[1], model.jnt_limited[1], model.jnt_range[1] = 0.0, 1, (-9.0, 0.4)
    speed = np.sqrt(1.5**2 - 2.0 * 2.0 * 0.4)  # of the 3 kg at its stop in the first mass
    hit = (1.5 - speed) / 2.0
    thrown = 0.75 * speed * (1.0 + restitution(1.0))  # rate of the first mass, of 1 kg
    t = hit + np.array([-0.1, -0.01, 0.0, 0.02, 0.05])
    found = solve(np.append(0.0, t), model=model)
    after = np.maximum(t - hit, 0.0)
    first = thrown * after - after**2
    assert first[-1] > 0.03
    assert np.abs(found["a"][1:] - first).max() < 1e-12
    second = np.where(t < hit, 1.5 * t - t**2, 0.4 - restitution(1.0) * speed * after)
    assert np.abs(found["b"][1:] - second).max() < 1e-12


@BOTH_SOLVERS
def test_samples_at_events_are_those_after_the_events(solve):
    """A rate 1e-12 s after an impact is that after it; a motion may end where a stop is left.

    At the impact itself, rounding of its time decides between the rates before and after it.
    """
    fall = np.sqrt(2.0 / 9.81) + 1e-12
    for times in ([0.0, fall], [0.0, fall, 0.5]):
        found = solve(times, model=falling_mass(1.0))
        assert len(found["rate"]) == len(times)
        assert abs(found["z"][1] + 1.0) < 1e-11  # 1e-12 s at 4.4 m/s
        after = fall * 9.81 * restitution(1.0)
        assert found["rate"][1] == pytest.approx(after, rel=1e-6)
    off = np.pi / 2.0 / np.sqrt(200.0 / 3.0)
    found = solve([0.0, 0.5 * off, off], model=two_masses('qpos="0 -0.3"'))
    assert found["b"].shape == (3,)
    assert abs(found["b"][2]) < 1e-12


@pytest.mark.parametrize("share", [0.01, 0.3, 0.6, 0.9, 0.999])
def test_a_stop_is_found_anywhere_in_a_step(share):
    """The joint moves at a constant rate, or along a parabola that turns back beyond the stop."""
    step = Step(2.0, 6.0, lambda t: (np.array([3.0 * t]), np.array([3.0]), np.zeros(1)))
    stop = Stop("x", 0, 0, 3.0 * (2.0 + 4.0 * share), 1.0, 0.5)
    assert list(impact_times([stop], step)) == pytest.approx([2.0 + 4.0 * share], abs=1e-14)
    assert not list(
        impact_times([Stop("x", 0, 0, 18.1, 1.0, 0.5), Stop("x", 0, 0, 5.9, -1.0, 0.5)], step)
    )

    def thrown(t):
        return np.array([t * (4.0 - t)]), np.array([4.0 - 2.0 * t]), np.array([-2.0])

    top = Stop("x", 0, 0, 4.0 - (2.0 * share) ** 2, 1.0, 0.5)  # the parabola rises to 4
    # distances are evaluated at the quarters of a step; the one at the top is beyond the stop
    found = list(impact_times([top], Step(0.0, 4.0, thrown)))
    assert found == pytest.approx([2.0 - 2.0 * share], abs=1e-12)  # rounding over the least rate


def test_properties_list_the_events_at_stops():
    model = two_masses('qpos="0 -0.3"')
    found = planar.properties(model=model, start="start", joints=(), motion=np.linspace(0, 0.25, 6))
    assert found["stops"] == "a rests on a stop; a leaves its stop at t = 0.192382 s"
    found = planar.properties(
        model=falling_mass(1.0), start="start", joints=(), motion=np.linspace(0.0, 0.59284, 6)
    )
    assert found["stops"] == (
        "z hits a stop at t = 0.451524, 0.573738, 0.590278, 0.592516, .. s (5 in all)"
    )
    free = two_masses('qpos="0.5 -0.1"')
    pulled = two_masses('qpos="0 0.3"')  # it leaves its stop at the start
    for model in (free, pulled):
        found = planar.properties(
            model=model, start="start", joints=(), motion=np.linspace(0, 0.1, 6)
        )
        assert found == {}


ARM_MODEL = f"""{HEAD}</option><option integrator="RK4"/><default><geom type="capsule" size="0.02"/>
  <joint axis="0 -1 0" solreflimit="TAU 1" solimplimit="0.9999 0.9999 0.001"/></default>
  <worldbody><body><joint name="shoulder"/><geom fromto="0 0 0 0.5 0 0" mass="2"/>
    <body pos="0.5 0 0"><joint name="elbow" range="-0.2 0.6"/>
      <geom fromto="0 0 0 0.4 0 0" mass="1"/>
      <body pos="0.4 0 0"><joint name="wrist"/><geom fromto="0 0 0 0.2 0 0" mass="0.5"/></body>
    </body></body></worldbody>
  <sensor><jointpos name="shoulder" joint="shoulder"/><jointpos name="elbow" joint="elbow"/>
    <jointpos name="wrist" joint="wrist"/></sensor>
  <keyframe><key name="start" qpos="0 0.2 1" qvel="-3 2 0"/></keyframe></mujoco>"""
JOINT_NAMES = "shoulder", "elbow", "wrist"
RIGID_ARM = mujoco.MjModel.from_xml_string(ARM_MODEL.replace("TAU", "0.01"))
TIMES = np.linspace(0.0, 0.36, 19)
"""Times until the elbow has hit both its stops [s]."""


@cache
def motion_between_rigid_stops() -> dict[str, np.ndarray]:
    """The motion of the arm with rigid stops, by the planar reference."""
    return planar.solve(TIMES, model=RIGID_ARM)


def step_in_mujoco(model: mujoco.MjModel, samples: int, count: int) -> np.ndarray:
    """Poses of the free motion of a model in MuJoCo, with `count` steps between samples."""
    data, found = mujoco.MjData(model), []
    mujoco.mj_resetDataKeyframe(model, data, 0)
    for _ in range(samples):
        found.append(data.qpos.copy())
        mujoco.mj_step(model, data, count)
    return np.array(found)


def test_mujoco_with_stiffer_limits_converges_to_rigid_stops():
    """MuJoCo's error falls with the time constant, for an elbow that hits both its stops."""
    known, errors = motion_between_rigid_stops(), []
    events = planar.properties(model=RIGID_ARM, start="start", joints=(), motion=TIMES)
    assert events["stops"] == "elbow hits a stop at t = 0.125401, 0.325648 s (2 in all)"
    for tau in (1e-3, 3e-4):
        model = mujoco.MjModel.from_xml_string(ARM_MODEL.replace("TAU", str(tau)))
        count = round(0.02 * 40 / tau)  # an impact needs about 40 steps per time constant
        model.opt.timestep = 0.02 / count
        q = step_in_mujoco(model, TIMES.size, count)
        errors.append(
            max(np.abs(q[:, k] - known[name]).max() for k, name in enumerate(JOINT_NAMES))
        )
    assert errors[0] < 0.03
    assert errors[1] < 0.4 * errors[0]  # 0.3 if the error is of first order in tau


def test_both_general_solvers_have_the_same_motion_between_stops():
    one = motion_between_rigid_stops()
    two = spatial.solve(TIMES, model=RIGID_ARM, terms=SmoothTerms(RIGID_ARM))
    assert max(np.abs(one[name] - two[name]).max() for name in JOINT_NAMES) < 1e-10


def test_a_wrong_restitution_changes_the_motion():
    """The restitution follows from the damping ratio of the limit, which is halved here."""
    text = ARM_MODEL.replace('solreflimit="TAU 1"', 'solreflimit="0.01 0.5"')
    soft = planar.solve(TIMES, model=mujoco.MjModel.from_xml_string(text))
    hard = motion_between_rigid_stops()
    assert max(np.abs(soft[name] - hard[name]).max() for name in JOINT_NAMES) > 1e-2


@BOTH_SOLVERS
def test_a_body_at_rest_on_a_stop_has_the_forces_of_statics(solve):
    """An arm of 2 kg and 0.8 m lies horizontally on its stop: its weight, and the hinge moment."""
    model = mujoco.MjModel.from_xml_string(f"""{HEAD}</option><worldbody><body>
      <joint name="hinge" axis="0 -1 0" range="0 1"/>
      <geom type="capsule" size="0.02" fromto="0 0 0 0.8 0 0" mass="2"/><site name="pin"/>
      </body></worldbody><sensor><jointpos name="hinge" joint="hinge"/>
      <force name="force" site="pin"/><torque name="torque" site="pin"/></sensor></mujoco>""")
    found = solve(np.linspace(0.0, 1.0, 11), model=model)
    assert np.abs(found["hinge"]).max() < 1e-15
    assert found["force.z"] == pytest.approx(2 * 9.81, rel=1e-12)
    assert np.abs(found["torque.y"]) == pytest.approx(2 * 9.81 * 0.4, rel=1e-12)


def test_pin_forces_on_a_stop_are_those_with_a_drive():
    """The crank of a four-bar rests on its stop, or a drive holds it there: equal pin forces."""
    file = str(shipped("fourbar_forces.xml"))
    held = planar.solve([0.0], model=mujoco.MjModel.from_xml_path(file), joints=("crank",))
    model = mujoco.MjModel.from_xml_path(file)
    model.jnt_limited[model.joint("crank").id] = 1
    model.jnt_range[model.joint("crank").id] = 0.0, 3.0
    lying = planar.solve([0.0, 0.5], model=model)
    forces = [name for s in range(model.nsensor) for name in planar_force_channels(model, s)]
    assert len(forces) >= 8
    assert max(np.ptp(lying[name]) for name in forces) < 1e-9
    assert max(np.abs(held[name]).max() for name in forces) > 10.0
    for name in forces:
        assert lying[name] == pytest.approx(held[name][0], abs=1e-9), name


def planar_force_channels(model: mujoco.MjModel, s: int) -> list[str]:
    """The channels x and y of sensor number s, if it measures a force between bodies."""
    of_force = model.sensor_type[s] == mujoco.mjtSensor.mjSENS_FORCE
    return [f"{model.sensor(s).name}.{part}" for part in "xy"] if of_force else []


@BOTH_SOLVERS
def test_a_start_beyond_a_stop_is_refused(solve):
    with pytest.raises(NotCovered, match=r"joint 'a' starts at -0.1, beyond the end of its range"):
        solve([0.0, 1.0], model=two_masses('qpos="-0.1 0"'))


@BOTH_SOLVERS
@pytest.mark.parametrize("ratio", [-1.0, 0.0])
def test_a_solref_of_mixed_format_is_replaced_as_mujoco_replaces_it(solve, ratio):
    """MuJoCo's default has the damping ratio 1."""
    t = np.linspace(0.0, 1.0, 21)
    found, default = (solve(t, model=falling_mass(one))["z"] for one in (ratio, 1.0))
    assert found.min() < -0.9
    assert (found == default).all()


def test_dependent_stops_are_refused():
    """An equality couples two slides, so the stops of both constrain the same motion."""
    tie = '<equality><joint joint1="a" joint2="b" polycoef="0 -1 0 0 0"/></equality>'
    text = two_masses('qpos="0 0" qvel="0 0"', tie)
    text.jnt_limited[1], text.jnt_range[1] = 1, (-9.0, 0.0)
    text.opt.gravity[:] = (-1.0, 0.0, 0.0)
    with pytest.raises(Overconstrained, match="rest on stops that are not independent: a, b"):
        planar.solve([0.0, 1.0], model=text)


@pytest.mark.parametrize("range_", [(0.0, 2.7), (2.1, 10.0)])
def test_a_sweep_that_moves_a_joint_beyond_its_range_is_refused(range_):
    """A sweep cannot pass a stop; without a range the rocker swings between 2.00 and 2.82 rad."""
    model = mujoco.MjModel.from_xml_path("models/linkages/fourbar.xml")
    model.jnt_limited[:], model.jnt_range[:] = 1, (-10.0, 10.0)
    model.jnt_range[model.joint("rocker").id] = range_
    for solve in (planar.solve, spatial.solve):
        with pytest.raises(ValueError, match="joint 'rocker' leaves its range"):
            solve(np.linspace(0.0, 6.0, 61), model=model, joints=("crank",))
