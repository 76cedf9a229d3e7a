"""Free motions of the general planar solver: closed forms, second formulations, energy."""

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from proofmass.analytic.linkages import fourbar, pendulum
from proofmass.analytic.mjcf.bodies import touching_bodies
from proofmass.analytic.planar import SingularHere, read, solve
from proofmass.analytic.planar.dynamics import TangentChart, free_motion
from proofmass.analytic.planar.forces import kinetic_energy, potential_energy
from proofmass.analytic.planar.kinematics import move_bodies
from tests.shipped import shipped

LENGTHS = {"crank": 1.0, "coupler": 2.0, "rocker": 2.5, "ground": 3.0}
MASSES = {"crank_mass": 1.0, "coupler_mass": 2.0, "rocker_mass": 2.5}


def hinged_body(attributes: str, more: str = "", key: str = 'qpos="0.4"') -> mujoco.MjModel:
    """A body of 2 kg m2 on a hinge, without gravity."""
    return mujoco.MjModel.from_xml_string(f"""<mujoco><compiler angle="radian"/>
      <option gravity="0 0 0"/><worldbody><body><joint name="a" {attributes}/>
      <inertial pos="0 0 0" mass="1" diaginertia="2 2 2"/></body></worldbody>{more}
      <sensor><jointpos name="a" joint="a"/><jointvel name="w" joint="a"/></sensor>
      <keyframe><key name="start" {key}/></keyframe></mujoco>""")


def test_a_pendulum_agrees_with_its_closed_form():
    model = mujoco.MjModel.from_xml_path(str(shipped("pendulum.xml")))
    t = np.linspace(0, 5, 51)
    found = solve(t, model=model)
    truth = pendulum.solve(t, length=1.0 + 1e-14, mass=1.0, gravity=9.81, amplitude=-np.pi / 2)
    # the length is that of the model's bob, whose inertia of 1e-14 kg m2 lengthens the pendulum
    # by inertia / (mass length); the error is that of two swings at 3e-14 per step, and of the
    # interpolation between steps
    assert np.abs(found["angle"] - truth["angle"]).max() < 3e-12
    assert np.abs(found["rate"] - truth["rate"]).max() < 1e-11


@pytest.mark.parametrize("n", [11, 126, 251, 321])
def test_parallelograms_pass_their_flat_poses_on_the_motion_of_a_pendulum(n):
    """Near a pose in which loops lose rank rounding makes steps shorter; a leap passes the pose.

    Which steps end there depends on the samples.  Accelerations have the rounding of the loops.
    """
    model = mujoco.MjModel.from_xml_path(str(shipped("parallelogram_chain.xml")))
    t = np.linspace(0, 2.5, n)
    found = solve(t, model=model, start="start")
    truth = pendulum.solve(t, length=6 / 7, mass=49 / 12, gravity=9.81, amplitude=2.0)
    assert np.abs(found["angle"] - truth["angle"]).max() < 1e-9
    assert np.abs(found["rate"] - truth["rate"]).max() < 1e-7
    assert np.abs(found["acceleration"] - truth["acceleration"]).max() < 1e-4


def test_a_damped_spring_agrees_with_its_closed_form():
    t = np.linspace(0, 4, 81)
    found = solve(t, model=hinged_body('stiffness="18" springref="0.1" damping="1.6"'))
    decay, w = 0.4, np.sqrt(9 - 0.16)  # 2 a'' + 1.6 a' + 18 (a - 0.1) = 0
    truth = 0.1 + 0.3 * np.exp(-decay * t) * (np.cos(w * t) + decay / w * np.sin(w * t))
    assert np.abs(found["a"] - truth).max() < 1e-13


def test_a_constant_motor_agrees_with_its_closed_form():
    motor = '<actuator><motor joint="a" gear="3"/></actuator>'
    t = np.linspace(0, 2, 21)
    found = solve(t, model=hinged_body("", motor, 'qpos="0.4" qvel="-1" ctrl="0.5"'))
    assert np.abs(found["a"] - (0.4 - t + 0.5 * (1.5 / 2) * t**2)).max() < 1e-13


def test_a_double_pendulum_obeys_the_textbook_equations():
    """Two point masses on massless rods, absolute angles from -y; Landau and Lifshitz, sect. 5."""
    bob = '<inertial pos="0 {y} 0" mass="{m}" diaginertia="1e-14 1e-14 1e-14"/>'
    model = mujoco.MjModel.from_xml_string(f"""<mujoco><compiler angle="radian"/>
      <option gravity="0 -9.81 0"/><worldbody><body><joint name="a"/>{bob.format(y=-1, m=2)}
      <body pos="0 -1 0"><joint name="b"/>{bob.format(y=-0.7, m=1)}</body></body></worldbody>
      <sensor><jointpos name="a" joint="a"/><jointpos name="b" joint="b"/></sensor>
      <keyframe><key name="start" qpos="1.2 -0.5" qvel="0 2"/></keyframe></mujoco>""")

    def slope(_: float, y: np.ndarray) -> list[float]:
        a, b, u, v = y
        matrix = np.array([[3.0, 0.7 * np.cos(a - b)], [0.7 * np.cos(a - b), 0.49]])
        right = np.array(
            [
                -0.7 * v * v * np.sin(a - b) - 3 * 9.81 * np.sin(a),
                0.7 * u * u * np.sin(a - b) - 0.7 * 9.81 * np.sin(b),
            ]
        )
        return [u, v, *np.linalg.solve(matrix, right)]

    t = np.linspace(0, 2, 21)
    truth = solve_ivp(slope, (0, 2), [1.2, 0.7, 0.0, 2.0], "DOP853", t, rtol=1e-13, atol=1e-13).y
    found = solve(t, model=model)
    # the inertia of 1e-14 kg m2 of the bobs, and the accuracy of both integrators, for a motion
    # that amplifies differences tenfold
    assert np.abs(found["a"] - truth[0]).max() < 1e-11
    assert np.abs(found["a"] + found["b"] - truth[1]).max() < 1e-11


@pytest.fixture(scope="module")
def released():
    """The four-bar and its free motion from its start pose for 1.2 s."""
    model = mujoco.MjModel.from_xml_path(str(shipped("fourbar.xml")))
    mechanism, _ = read(model, "start")
    return mechanism, free_motion(mechanism, np.linspace(0, 1.2, 25)).arrays()


def test_a_four_bar_conserves_its_energy_and_closes_its_loop(released):
    mechanism, (q, v, _) = released
    motion = move_bodies(mechanism, q, v)
    work = kinetic_energy(mechanism, motion, v)
    assert np.ptp(work) > 20.0  # J: the four-bar moves
    assert np.ptp(work + potential_energy(mechanism, motion, q)) < 1e-12 * np.ptp(work)
    pin = mechanism.pins[0]
    violation = motion.point(pin.one, pin.on_one) - motion.point(pin.two, pin.on_two)
    assert np.abs(violation).max() < 1e-14


def test_a_four_bar_obeys_the_equation_of_its_crank_alone(released):
    """Eksergian's equation with closed forms: I a + I'(angle)/2 w^2 + holding moment = 0."""
    _, (q, v, a) = released

    def inertia(angle: np.ndarray) -> np.ndarray:
        c = fourbar.solve(angle, **LENGTHS, **MASSES)
        middle = np.exp(1j * angle) + c["coupler_rate"] * np.exp(1j * c["coupler_angle"])
        return (
            1.0 / 3
            + 2.0 * (np.abs(middle) ** 2 + c["coupler_rate"] ** 2 * 4 / 12)
            + 2.5 * c["rocker_rate"] ** 2 * 2.5**2 / 3
        )

    angle, h = q[:, 0], 1e-3
    stencil = [inertia(angle + k * h) for k in (-2, -1, 1, 2)]
    slope = (stencil[0] - 8 * stencil[1] + 8 * stencil[2] - stencil[3]) / (12 * h)
    hold = fourbar.solve(angle, **LENGTHS, **MASSES)["holding_moment"]
    left = inertia(angle) * a[:, 0] + 0.5 * slope * v[:, 0] ** 2 + hold
    # five-point differences at 1e-3: h^4 / 30 times the fifth derivative, and eps / h
    assert np.abs(left).max() < 1e-9 * np.abs(hold).max()


def test_a_model_without_freedom_is_refused():
    more = '<equality><joint joint1="a" polycoef="0.4 0 0 0 0"/></equality>'
    with pytest.raises(SingularHere, match="no degree of freedom"):
        solve([0.0, 1.0], model=hinged_body("", more))


def test_bodies_that_may_touch_are_refused():
    geoms = '<geom size="0.1"/>'
    model = mujoco.MjModel.from_xml_string(f"""<mujoco><worldbody>{geoms}<body pos="1 0 0">
      <joint name="a"/>{geoms}</body></worldbody></mujoco>""")
    with pytest.raises(ValueError, match="contacts are not covered by a free motion"):
        solve([0.0, 1.0], model=model)


PILE = """<mujoco><option>{flag}</option><worldbody><geom size="1"/>
<body name="a"><joint axis="0 1 0"/><geom size="1"/><geom size="1" contype="0"/>
<body name="b"><joint axis="0 1 0"/><geom size="1" contype="2" conaffinity="3"/>
<body name="welded"><geom size="1"/>
<body name="c"><joint axis="0 1 0"/><geom size="1"/></body></body></body></body>
<body name="d"><joint axis="0 1 0"/><geom size="1" conaffinity="0"/></body>
</worldbody><contact>{exclude}</contact></mujoco>"""


@pytest.mark.parametrize("flag", ["", '<flag filterparent="disable"/>'])
@pytest.mark.parametrize("exclude", ["", '<exclude body1="d" body2="a"/>'])
def test_the_bodies_that_may_touch_are_those_that_mujoco_does_not_filter_out(flag, exclude):
    """All geoms are equal balls at one place, so that MuJoCo has a contact for each pair."""
    model = mujoco.MjModel.from_xml_string(PILE.format(flag=flag, exclude=exclude))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    touching = {tuple(sorted(model.geom_bodyid[list(one.geom)])) for one in data.contact}
    assert touching
    assert {tuple(pair) for pair in touching_bodies(model)} == touching


def test_a_chain_whose_neighbours_alone_could_touch_is_solved():
    """MuJoCo has no contacts between a body and its parent, so that geoms need no flags."""
    link = '<joint name="{0}" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 0 0 -1" size=".1"/>'
    chain = f"""<mujoco><worldbody><body>{link.format("a")}<body pos="0 0 -1">{link.format("b")}
      </body></body></worldbody><sensor><jointpos name="b" joint="b"/></sensor>
      <keyframe><key name="start" qpos="1 0"/></keyframe></mujoco>"""
    off = chain.replace("<worldbody>", '<option><flag contact="disable"/></option><worldbody>')
    own, without = (
        solve([0.0, 0.5], model=mujoco.MjModel.from_xml_string(text))["b"] for text in (chain, off)
    )
    assert np.array_equal(own, without)
    assert abs(own[1]) > 0.1  # it moves


def test_the_state_at_the_end_of_a_step_is_evaluated_once(monkeypatch):
    """The last stage of a step serves as its end, unless a new tangent plane begins there."""
    states, charts, motion = [], set(), TangentChart.motion

    def record(self, y, t):
        states.append((t, y.tobytes()))
        charts.add(self)
        return motion(self, y, t)

    monkeypatch.setattr(TangentChart, "motion", record)
    mechanism, _ = read(mujoco.MjModel.from_xml_path(str(shipped("fourbar.xml"))), "start")
    free_motion(mechanism, np.array([0.0, 1.0]))
    assert len(states) > 300
    # a state is evaluated twice at the end of each chart, and at the ends of the motion
    assert len(states) - len(set(states)) <= len(charts) + 3
