"""Controls that change in time, and forces with a range, in the references for any mechanism."""

from dataclasses import dataclass
from functools import cache, cached_property

import mujoco
import numpy as np
import pytest
from scipy.interpolate import CubicSpline, PPoly
from scipy.linalg import expm

from proofmass.analytic import planar, spatial
from proofmass.analytic.controls import ControlsInTime, smooth_pieces
from proofmass.analytic.numerics import NotCovered
from proofmass.reference.profiles import control_profiles
from proofmass.run.sidecar import load_case
from proofmass.sim.smooth import SmoothTerms
from tests.shipped import shipped

AXES_CASE = load_case(shipped("axes_controlled.toml"))
TIMES = np.linspace(0.0, 2.0, 201)
MODEL_HEAD = (
    '<mujoco><compiler angle="radian"/><option gravity="0 0 {g}"><flag contact="disable"/></option>'
)


@dataclass(frozen=True)
class PiecewiseLinearControl:
    """A control that is linear between rows, without `proofmass.case.profile`."""

    times: tuple[float, ...]
    values: tuple[float, ...]

    @property
    def breaks(self) -> np.ndarray:
        return np.array(self.times)

    def __call__(self, t):
        value = np.interp(t, self.times, self.values)
        return value, np.zeros_like(value), np.zeros_like(value)


def piecewise_linear(times, values) -> PPoly:
    """A piecewise linear function through some points."""
    times, values = np.array(times, float), np.array(values, float)
    return PPoly(np.array([np.diff(values) / np.diff(times), values[:-1]]), times)


def oscillator_motion(m, c, k, force: PPoly, x0, v0, t):
    """Solution and rate of m x'' + c x' + k x = force(t) by matrix exponentials.

    The force is a piecewise polynomial, and each piece is solved by itself.  The force and its
    derivatives, the last of which is constant in a piece, are part of the state.
    """
    order = len(force.c)
    a = np.zeros((2 + order, 2 + order))
    a[0, 1], a[1, :3] = 1.0, [-k / m, -c / m, 1.0 / m]
    a[np.arange(2, 1 + order), np.arange(3, 2 + order)] = 1.0
    derivatives = [force.derivative(n) if n else force for n in range(order)]
    found, at, state = np.empty((2, len(t))), float(t[0]), np.array([x0, v0])
    for start, end in zip(force.x[:-1], force.x[1:], strict=True):
        inside = (t >= start) & ((t < end) | ((t == end) & (end == force.x[-1])))
        middle = 0.5 * (start + end)  # the derivatives there are those of this piece
        pushes = np.array([d(middle) for d in derivatives])
        back = expm(a * (at - middle))
        begin = np.concatenate([state, (back[2:, 2:] @ pushes)])
        for n in np.flatnonzero(inside):
            found[:, n] = (expm(a * (t[n] - at)) @ begin)[:2]
        state, at = (expm(a * (end - at)) @ begin)[:2], float(end)
    return found


def closed_forms_of_axes() -> dict[str, np.ndarray]:
    """The closed forms of the three axes of the case, and of their rates."""
    model = mujoco.MjModel.from_xml_path(str(AXES_CASE.model_path))
    rows = np.loadtxt(shipped("axes_controlled.csv"), delimiter=",", comments=("#", "t"))
    push = piecewise_linear(rows[:, 0], rows[:, 1])
    # 0.3 N m are those of the spring: 3 N m/rad times its reference angle of 0.1 rad
    wind = piecewise_linear([0.0, 0.3, 1.2, 2.0], 0.3 + np.array([0.0, 0.6, 0.6, -0.2]))
    target = CubicSpline([0.0, 0.5, 1.0, 1.5, 2.0], [0.1, 0.15, 0.35, 0.5, 0.5])
    lift = PPoly(900.0 * target.c, target.x)
    lift.c[-1] -= 4.0 * 9.81
    moment = float(model.body_inertia[2][2])  # the cylinder about its axis
    assert moment == pytest.approx(1.5 * 0.2**2 / 2, rel=1e-12, abs=0)
    found = {}
    for name, one in {
        "slide": oscillator_motion(2.0, 0.0, 0.0, push, 0.1, 0.2, TIMES),
        "wheel": oscillator_motion(moment, 0.1, 3.0, wind, 0.3, 0.0, TIMES),
        "lift": oscillator_motion(4.0, 60.0, 900.0, lift, 0.05, 0.0, TIMES),
    }.items():
        found[name], found[f"{name}_rate"] = one
    return found


def solve_free_motion(name: str, model, profiles, t=TIMES, **arguments):
    """A free motion by one of the references; the spatial one has MuJoCo's terms."""
    if name == "planar":
        return planar.solve(t, model=model, control_profiles=profiles, **arguments)
    return spatial.solve(
        t, model=model, control_profiles=profiles, terms=SmoothTerms(model), **arguments
    )


@cache
def reference_of_axes(name: str) -> dict[str, np.ndarray]:
    """The motion of the case's three axes by one of the references."""
    model = mujoco.MjModel.from_xml_path(str(AXES_CASE.model_path))
    return solve_free_motion(name, model, control_profiles(AXES_CASE, "dynamics"))


BOTH_REFERENCES = pytest.mark.parametrize("reference", ["planar", "spatial"])


@BOTH_REFERENCES
def test_three_axes_move_as_their_linear_equations_state(reference):
    found = reference_of_axes(reference)
    for name, curve in closed_forms_of_axes().items():
        assert np.abs(found[name] - curve).max() < 1e-12, name  # about 20 pieces at 3e-14


def test_the_force_of_a_control_is_that_of_its_rows():
    rows = np.loadtxt(shipped("axes_controlled.csv"), delimiter=",", comments=("#", "t"))
    assert np.abs(reference_of_axes("planar")["pushing"] - np.interp(TIMES, *rows.T)).max() < 1e-14


@BOTH_REFERENCES
def test_a_constant_control_profile_acts_as_the_control_of_the_key(reference):
    """A constant profile gives the same motion as a key with the same control."""
    model = mujoco.MjModel.from_xml_path(str(shipped("arm_servos.xml")))
    t = np.linspace(0.0, 0.1, 7)
    changed = {
        "lift": PiecewiseLinearControl((0.0, 1.0), (0.4, 0.4)),
        "turn": PiecewiseLinearControl((0.0, 1.0), (-2.0, -2.0)),
    }
    found = solve_free_motion(reference, model, changed, t)
    other = solve_free_motion(reference, model, {}, t)
    model.key_ctrl[0, :2] = 0.4, -2.0
    other_start = planar.read(model, "start")[0]
    assert other_start.ctrl.tolist() == [0.4, -2.0, 0.05]
    fixed = mujoco.MjModel.from_xml_string(
        shipped("arm_servos.xml").read_text().replace('ctrl="0.9 1.5 0.05"', 'ctrl="0.4 -2 0.05"')
    )
    wanted = solve_free_motion(reference, fixed, {}, t)
    for name in ("shoulder", "elbow", "reach", "tip_velocity.x"):
        assert np.abs(found[name] - wanted[name]).max() < 1e-11, name
        assert np.abs(found[name] - other[name]).max() > 1e-4, name


def test_both_references_agree_on_an_arm_under_controls():
    model = mujoco.MjModel.from_xml_path(str(shipped("arm_servos.xml")))
    profiles = {
        "lift": PiecewiseLinearControl((0.0, 0.07, 0.15, 0.3), (0.9, 0.2, 1.4, 1.4)),
        "turn": PiecewiseLinearControl((0.0, 0.2, 0.3), (1.5, -3.0, 0.0)),
        "push": PiecewiseLinearControl((0.0, 0.05, 0.3), (0.05, 0.3, -0.1)),
    }
    t = np.linspace(0.0, 0.25, 251)
    one, two = (
        solve_free_motion("planar", model, profiles, t),
        solve_free_motion("spatial", model, profiles, t),
    )
    shared = one.keys() & two.keys()
    assert {"shoulder", "elbow", "reach", "tip.x", "kinetic", "potential"} <= shared
    assert max(np.abs(one[name] - two[name]).max() for name in shared) < 1e-11
    rate = np.gradient(one["elbow"], t, edge_order=2)
    asked = 0.8 * (profiles["turn"](t)[0] - rate)
    assert np.abs(one["turning"] - asked)[20:-2].max() < 0.02  # rates are differences of values


def test_steps_that_end_at_kinks_are_fewer(monkeypatch):
    """A step across a kink loses its order, so it is refused until it is short."""
    model = mujoco.MjModel.from_xml_path(str(AXES_CASE.model_path))
    tree = spatial.read_tree(model, "start")
    profiles, times = control_profiles(AXES_CASE, "dynamics"), np.linspace(0.0, 2.0, 3)
    places = {k: profiles[name] for k, name in enumerate(("push", "wind", "lift"))}
    controls = ControlsInTime(tree.ctrl, places)
    few = spatial.integrate_motion(tree, SmoothTerms(model), times, controls=controls).evaluations
    monkeypatch.setattr(ControlsInTime, "breaks", ())
    many = spatial.integrate_motion(tree, SmoothTerms(model), times, controls=controls).evaluations
    assert few < 0.6 * many


def test_the_pieces_of_a_motion_are_those_between_breaks():
    pieces = list(smooth_pieces(0.0, 1.0, (-1.0, 0.0, 1e-14, 0.25, 1.0, 7.0)))
    assert [(a, b) for a, b, _ in pieces] == [(0.0, 0.25), (0.25, 1.0)]
    assert pieces[0][2] < 0.25
    assert pieces[1][2] < 1.0
    assert list(smooth_pieces(0.0, 1.0, (2.0,))) == [(0.0, 1.0, np.inf)]


@dataclass(frozen=True)
class AccelerationSteps:
    """A drive whose acceleration is a step function, so that its rate is piecewise linear."""

    times: tuple[float, ...]
    steps: tuple[float, ...]

    @property
    def breaks(self) -> np.ndarray:
        return np.array(self.times)

    @cached_property
    def curves(self) -> tuple[PPoly, PPoly, PPoly]:
        bend = PPoly(np.array([self.steps]), np.array(self.times))
        return bend.antiderivative(2), bend.antiderivative(1), bend

    def __call__(self, t):
        return tuple(curve(np.asarray(t, float)) for curve in self.curves)


def test_a_mass_on_a_drive_whose_acceleration_jumps_has_its_closed_form():
    """A mass on a spring on a driven cart: m x'' + k x = -m a(t), where a(t) jumps at its rows."""
    model = mujoco.MjModel.from_xml_string(f"""{MODEL_HEAD.format(g=0)}<worldbody>
      <body><joint name="cart" type="slide" axis="1 0 0"/><geom size=".1" mass="3"/>
        <body><joint name="x" type="slide" axis="1 0 0" stiffness="40"/><geom size=".1" mass="0.5"/>
        </body></body>
      <body pos="0 0 1"><joint name="h" axis="0 1 0"/><geom size=".1" mass="1"/></body></worldbody>
      <sensor><jointpos name="x" joint="x"/><jointvel name="rate" joint="x"/></sensor></mujoco>""")
    profile = AccelerationSteps((0.0, 0.31, 0.5, 1.0), (2.0, -3.0, 1.0))
    t = np.linspace(0.0, 1.0, 51)
    found = planar.solve(*profile(t), model=model, joints=("cart",), in_time=(t, (profile,)))
    force = PPoly(-0.5 * np.array([profile.steps]), np.array(profile.times))
    x, rate = oscillator_motion(0.5, 0.0, 40.0, force, 0.0, 0.0, t)
    assert np.abs(found["x"] - x).max() < 1e-13
    assert np.abs(found["rate"] - rate).max() < 1e-12


def test_a_control_acts_in_addition_to_a_drive():
    """The same mass on a driven cart with a motor: m x'' + k x = -m a(t) + u(t)."""
    model = mujoco.MjModel.from_xml_string(f"""{MODEL_HEAD.format(g=0)}<worldbody>
      <body><joint name="cart" type="slide" axis="1 0 0"/><geom size=".1" mass="3"/>
        <body><joint name="x" type="slide" axis="1 0 0" stiffness="40"/><geom size=".1" mass="0.5"/>
        </body></body>
      <body pos="0 0 1"><joint name="h" axis="0 1 0"/><geom size=".1" mass="1"/></body></worldbody>
      <actuator><motor name="push" joint="x"/></actuator>
      <sensor><jointpos name="x" joint="x"/></sensor></mujoco>""")
    profile, push = (
        AccelerationSteps((0.0, 0.5, 1.0), (2.0, -3.0)),
        PiecewiseLinearControl((0.0, 0.3, 1.0), (0.0, 4.0, -2.0)),
    )
    t = np.linspace(0.0, 1.0, 51)
    arguments = {
        "joints": ("cart",),
        "in_time": (t, (profile,)),
        "control_profiles": {"push": push},
    }
    found = planar.solve(*profile(t), model=model, **arguments)
    slopes = 4.0 / 0.3, -6.0 / 0.7, -6.0 / 0.7
    values = -1.0, 4.0 - 1.0, 4.0 - 6.0 / 0.7 * 0.2 + 1.5
    force = PPoly(np.array([slopes, values]), np.array([0.0, 0.3, 0.5, 1.0]))
    assert (
        np.abs(found["x"] - oscillator_motion(0.5, 0.0, 40.0, force, 0.0, 0.0, t)[0]).max() < 1e-13
    )


@BOTH_REFERENCES
def test_a_joint_leaves_its_stop_when_the_control_changes_sign(reference):
    """The force 2 t - 1 [N] presses the joint on its stop until 0.5 s; then x = (t - 0.5)^3 / 6.

    The mass is 2 kg.
    """
    model = mujoco.MjModel.from_xml_string(
        (MODEL_HEAD.format(g=0) + SERVO_MODEL.format(more=""))
        .replace("<position", "<motor")
        .replace(' kp="50"', "")
        .replace('name="x" type', 'name="x" limited="true" range="0 9" type', 1)
    )
    t = np.linspace(0.0, 1.0, 41)
    found = solve_free_motion(
        reference, model, {"hold": PiecewiseLinearControl((0.0, 1.0), (-1.0, 1.0))}, t
    )
    assert np.abs(found["x"] - np.maximum(t - 0.5, 0.0) ** 3 / 6.0).max() < 1e-13
    assert found["x"][-1] > 0.02


SERVO_MODEL = """<worldbody>
  <body><joint name="x" type="slide" axis="1 0 0"/><geom size=".1" mass="2"/></body>
  <body pos="0 0 1"><joint name="h" axis="0 1 0"/><geom size=".1" mass="1"/></body></worldbody>
  <actuator><position name="hold" joint="x" kp="50" {more}/></actuator>
  <sensor><jointpos name="x" joint="x"/><jointvel name="rate" joint="x"/>
    <actuatorfrc name="push" actuator="hold"/></sensor>
  <keyframe><key name="start" qpos="0 0" ctrl="1"/></keyframe></mujoco>"""


def saturated_servo_motion(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Position and rate of a mass of 2 kg that a servo of 50 N/m, at most 8 N, pulls from 0 to 1 m.

    At first the force is 8 N and the motion a parabola, until 8 / 50 m before the target.  Then the
    mass swings until 8 / 50 m beyond the target, from where the force is -8 N.  The motion is
    symmetric about the time at which the mass turns back.
    """
    m, k, most = 2.0, 50.0, 8.0
    near, w = most / k, np.sqrt(k / m)
    first = np.sqrt(2.0 * m * (1.0 - near) / most)
    speed = most / m * first
    size, phase = np.hypot(near, speed / w), np.arctan2(near, speed / w)
    second = first + 2.0 * phase / w
    turn = second + first
    mirrored = np.minimum(t, 2.0 * turn - t)  # the motion back mirrors the motion there
    swing = w * (mirrored - first) - phase
    late = mirrored - second
    x = np.select(
        [mirrored < first, mirrored < second],
        [0.5 * most / m * mirrored**2, 1.0 + size * np.sin(swing)],
        1.0 + near + speed * late - 0.5 * most / m * late**2,
    )
    rate = np.select(
        [mirrored < first, mirrored < second],
        [most / m * mirrored, size * w * np.cos(swing)],
        speed - most / m * late,
    )
    return x, np.where(t < turn, rate, -rate)


@BOTH_REFERENCES
def test_a_servo_with_a_range_of_forces_saturates(reference):
    """The motion there and back has four kinks; each integration step has an error up to 1e-12."""
    model = mujoco.MjModel.from_xml_string(
        MODEL_HEAD.format(g=0) + SERVO_MODEL.format(more='forcerange="-8 8" forcelimited="true"')
    )
    t = np.linspace(0.0, 2.8, 141)
    x, rate = saturated_servo_motion(t)
    assert x.max() == pytest.approx(2.0, abs=1e-3)
    assert x[-20:].min() < 0.2
    found = solve_free_motion(reference, model, {}, t)
    assert np.abs(found["x"] - x).max() < 1e-11
    assert np.abs(found["rate"] - rate).max() < 1e-11 * np.ptp(rate)
    if reference == "planar":
        assert np.abs(found["push"] - np.clip(50.0 * (1.0 - x), -8.0, 8.0)).max() < 1e-9


def test_both_references_agree_on_an_arm_with_saturated_servos():
    text = shipped("arm_servos.xml").read_text()
    for old, new in (
        ('kp="120"', 'kp="120" forcerange="-15 20"'),
        ('kv="0.8"', 'kv="0.8" forcerange="-0.6 0.6"'),
    ):
        assert old in text
        text = text.replace(old, new)
    model, t = mujoco.MjModel.from_xml_string(text), np.linspace(0.0, 0.15, 11)
    profiles = {"lift": PiecewiseLinearControl((0.0, 0.2, 0.5), (0.9, 0.3, 1.1))}
    one, two = (
        solve_free_motion("planar", model, profiles, t),
        solve_free_motion("spatial", model, profiles, t),
    )
    shared = one.keys() & two.keys() - {"turning", "pushing"}
    assert max(np.abs(one[name] - two[name]).max() for name in shared) < 1e-11
    wide = mujoco.MjModel.from_xml_path(str(shipped("arm_servos.xml")))
    assert (
        np.abs(solve_free_motion("planar", wide, profiles, t)["elbow"] - one["elbow"]).max() > 1e-2
    )


def test_a_saturated_servo_adds_its_clipped_force_to_a_drive_at_rest():
    """The servo on the rocker of a four-bar does virtual work with its clipped moment."""
    text = shipped("fourbar.xml").read_text()
    servo = '<position name="hold" joint="rocker" kp="30" gear="2" forcerange="-140 5"/>'
    text = text.replace("</actuator>", f"{servo}</actuator>")
    model, plain = mujoco.MjModel.from_xml_string(text), shipped("fourbar.xml")
    angle = np.linspace(0.0, 6.0, 61)
    found = planar.solve(angle, model=model, joints=("crank",))
    free = planar.solve(angle, model=mujoco.MjModel.from_xml_path(str(plain)), joints=("crank",))
    force = np.clip(30.0 * (0.0 - 2.0 * found["rocker"]), -140.0, 5.0)
    assert 5 < (force == -140.0).sum() < 56
    more = -2.0 * force * found["rocker_rate"]
    assert np.abs(found["holding_moment"] - free["holding_moment"] - more).max() < 1e-11


def test_controls_that_may_not_change_are_refused():
    text = (
        (MODEL_HEAD.format(g=0) + SERVO_MODEL.format(more=""))
        .replace("<position", "<motor")
        .replace(' kp="50"', "")
    )
    limited = text.replace('name="x" type', 'name="x" actuatorfrcrange="-1 1" type', 1)
    limited = limited.replace("</actuator>", '<motor joint="x"/></actuator>')
    profiles = {"hold": PiecewiseLinearControl((0.0, 1.0), (0.0, 1.0))}
    with pytest.raises(NotCovered, match="'hold' changes, and its joint 'x' has a range of forces"):
        solve_free_motion("planar", mujoco.MjModel.from_xml_string(limited), profiles, TIMES[:3])
    model = mujoco.MjModel.from_xml_string(text)
    with pytest.raises(ValueError, match="no actuator 'hodl'; there are: hold"):
        solve_free_motion("planar", model, {"hodl": profiles["hold"]}, TIMES[:3])
