"""Tendons in the general planar solver: springs between two points, and sums of joints."""

import mujoco
import numpy as np
import pytest

from proofmass.analytic import spatial
from proofmass.analytic.numerics import NotCovered
from proofmass.analytic.planar import read, solve
from proofmass.analytic.planar.dynamics import free_motion
from proofmass.analytic.planar.forces import (
    applied_forces,
    centre_jacobians,
    kinetic_energy,
    potential_energy,
)
from proofmass.analytic.planar.kinematics import move_bodies
from proofmass.sim.smooth import SmoothTerms
from tests.shipped import shipped

START_KEY = '<keyframe><key name="start" {}/></keyframe>'
SENSORS = '<tendonpos name="length" tendon="spring"/><tendonvel name="rate" tendon="spring"/>'


def model_with_spring(
    bodies: str, spring: str, more: str = "", gravity: str = "0 0 0"
) -> mujoco.MjModel:
    """A model with one tendon from the site `one` to the site `two`."""
    return mujoco.MjModel.from_xml_string(f"""<mujoco><compiler angle="radian"/>
      <option gravity="{gravity}"><flag contact="disable"/></option>
      <worldbody>{bodies}</worldbody>
      <tendon><spatial name="spring" {spring}><site site="one"/><site site="two"/></spatial>
      </tendon>{more}</mujoco>""")


def mass_on_a_slide(spring: str, start: str, wall: str = "0 0 0") -> mujoco.MjModel:
    """A mass of 2 kg that slides along x, and a spring from it to the wall."""
    return model_with_spring(
        f'<site name="one" pos="{wall}"/><body><joint name="x" type="slide" axis="1 0 0"/>'
        '<inertial pos="0 0 0" mass="2" diaginertia="1 1 1"/><site name="two"/></body>',
        spring,
        f'<sensor><jointpos name="x" joint="x"/><jointvel name="v" joint="x"/>{SENSORS}'
        f'<e_potential name="potential"/></sensor>{START_KEY.format(start)}',
    )


def arm_with_offset(slack: str, damping: float = 0.0) -> mujoco.MjModel:
    """A double pendulum with a slide in a tilted plane; its spring is not parallel to the plane."""
    arm = '<inertial pos="0.3 0.1 0" mass="1" diaginertia="0.1 0.1 0.1"/>'
    return model_with_spring(
        '<body pos="1 2 3" euler="0.3 -0.2 0.5"><site name="one" pos="0.9 0.4 0.35"/>'
        f'<body><joint name="a" damping="0.01"/>{arm}<body pos="0.6 0 0">'
        f'<joint name="s" type="slide" axis="1 0.5 0" stiffness="20"/>{arm}'
        f'<body pos="0.2 0 0"><joint name="b" axis="0 0 -1" pos="0 0.1 0"/>{arm}'
        '<site name="two" pos="0.4 -0.1 0.1"/></body></body></body></body>',
        f'stiffness="30" springlength="{slack}" damping="{damping}"',
        '<sensor><jointpos name="a" joint="a"/><jointpos name="s" joint="s"/>'
        f'<jointpos name="b" joint="b"/><jointvel name="w" joint="b"/>{SENSORS}'
        '<framepos name="end" objtype="site" objname="two"/><e_potential name="potential"/>'
        '</sensor><keyframe><key name="start" qpos="0.4 -0.05 1.1" qvel="1 0 -2"/></keyframe>',
        gravity="1 -2 -9",
    )


def test_a_mass_on_a_spring_swings_with_the_root_of_stiffness_over_mass():
    model = mass_on_a_slide('stiffness="18" springlength="0.7"', 'qpos="1.0" qvel="0.5"')
    t = np.linspace(0, 2.5, 51)
    found = solve(t, model=model)
    truth = 0.7 + 0.3 * np.cos(3 * t) + 0.5 / 3 * np.sin(3 * t)
    assert np.abs(found["x"] - truth).max() < 1e-12
    assert np.abs(found["length"] - truth).max() < 1e-12
    assert np.abs(found["rate"] - found["v"]).max() < 1e-15
    assert np.abs(found["potential"] - 9.0 * (truth - 0.7) ** 2).max() < 1e-11


def test_a_damped_spring_agrees_with_its_closed_form():
    model = mass_on_a_slide('stiffness="18" damping="1.6" springlength="0.7"', 'qpos="1.0"')
    t = np.linspace(0, 2, 41)
    decay, w = 0.4, np.sqrt(9 - 0.16)  # 2 x'' + 1.6 x' + 18 (x - 0.7) = 0
    truth = 0.7 + 0.3 * np.exp(-decay * t) * (np.cos(w * t) + decay / w * np.sin(w * t))
    assert np.abs(solve(t, model=model)["x"] - truth).max() < 1e-12


def test_a_spring_is_slack_between_two_lengths():
    """The spring pushes from 0.6 m on, is slack from 0.8 to 1.1 m, and pulls back beyond."""
    model = mass_on_a_slide('stiffness="18" springlength="0.8 1.1"', 'qpos="0.6"')
    quarter = np.pi / 6  # a quarter of the period at 3 rad/s
    speed, t = 0.2 * 3, np.linspace(0, 2.0, 81)
    free = 0.3 / speed
    truth = np.where(t < quarter, 0.8 - 0.2 * np.cos(3 * t), 0.8 + speed * (t - quarter))
    turn = t - quarter - free
    truth = np.where(turn > 0, 1.1 + 0.2 * np.sin(3 * turn), truth)
    assert t[-1] < quarter + free + 2 * quarter
    # at a kink of the force the error is the integrator's tolerance: no step ends exactly there
    assert np.abs(solve(t, model=model)["x"] - truth).max() < 1e-11


@pytest.mark.parametrize("slack", ["0.2", "0.75", "0.5 0.9", "0"])
def test_forces_are_the_slope_of_the_energy(slack):
    """By central differences at random poses, in which the spring pulls, pushes or is slack."""
    mechanism, _ = read(arm_with_offset(slack), "start")
    q = np.random.default_rng(3).uniform(-1.0, 1.0, (40, 3)) * [3.0, 0.2, 3.0]
    motion, h = move_bodies(mechanism, q), 1e-5
    found = applied_forces(mechanism, motion, centre_jacobians(mechanism, motion), q)
    for k, step in enumerate(h * np.eye(3)):
        there, back = (
            potential_energy(mechanism, move_bodies(mechanism, x), x) for x in (q + step, q - step)
        )
        # the error is the square of the step, and rounding of 100 J over the step
        assert np.abs(found[:, k] + (there - back) / (2 * h)).max() < 1e-8


def test_energy_changes_by_the_work_of_the_dampers():
    """Without dampers it is constant; the work of dampers is a Gauss-Legendre quadrature."""
    for damping in (0.0, 3.0):
        mechanism, _ = read(arm_with_offset("0.3", damping), "start")
        nodes, shares = np.polynomial.legendre.leggauss(60)
        t = np.concatenate([[0.0], 0.5 * (nodes + 1), [1.0]])
        q, v, _ = free_motion(mechanism, t).arrays()
        motion = move_bodies(mechanism, q, v)
        total = kinetic_energy(mechanism, motion, v) + potential_energy(mechanism, motion, q)
        spring = mechanism.point_springs[0]
        flat = motion.point(spring.one, spring.on_one) - motion.point(spring.two, spring.on_two)
        speed = motion.point(spring.one, spring.on_one, 1)
        speed = speed - motion.point(spring.two, spring.on_two, 1)
        rate = (flat.conj() * speed).real / np.hypot(np.abs(flat), 0.25)
        power = damping * rate**2 + 0.01 * v[:, 0] ** 2
        assert damping == 0.0 or total[0] - total[-1] > 0.5
        # 60 nodes integrate a second of this motion to 1e-11 of the energy
        assert total[-1] - total[0] == pytest.approx(-0.5 * shares @ power[1:-1], abs=2e-10)


@pytest.mark.parametrize("slack", ["0.2", "0.6 0.9", "0"])
def test_the_spatial_reference_has_the_same_motion(slack):
    """It has Newton's and Euler's balances of bodies in space, and its own tendons."""
    model = arm_with_offset(slack, 0.4)
    t = np.linspace(0, 0.5, 21)
    found, other = solve(t, model=model), spatial.solve(t, model=model)
    for name in ("a", "s", "b", "w", "length", "rate", "end.x", "end.y", "end.z", "potential"):
        apart = np.abs(found[name] - other[name]).max()
        assert apart < 2e-12 * max(1.0, np.ptp(found[name])), name  # accuracy of both


def test_a_four_bar_with_a_damped_spring_moves_as_in_the_spatial_reference():
    text = shipped("fourbar.xml").read_text()
    spring = (
        '<tendon><spatial name="spring" stiffness="40" damping="2" springlength="1.2">'
        '<site site="point"/><site site="rocker_end"/></spatial></tendon>'
    )
    model = mujoco.MjModel.from_xml_string(text.replace("<equality>", f"{spring}<equality>", 1))
    t = np.linspace(0, 0.4, 17)
    found, other = solve(t, model=model), spatial.solve(t, model=model)
    assert np.ptp(found["rocker"]) > 0.2
    for name in ("rocker", "pin.x", "pin.y", "rocker_rate", "pin_velocity.x"):
        assert np.abs(found[name] - other[name]).max() < 1e-10, name


BALANCED_ARM = (
    '<site name="one" pos="0 0.4 0"/><body><joint name="arm"/>'
    '<inertial pos="0.5 0 0" mass="2" diaginertia="0.1 0.1 0.1"/>'
    '<site name="two" pos="0.25 0 0"/><site name="foot"/></body>'
)
FORCE_SENSORS = (
    '<actuator><motor name="m" joint="arm"/></actuator><sensor>'
    '<actuatorfrc name="moment" actuator="m"/><force name="pin" site="foot"/>'
    f'<torque name="twist" site="foot"/>{SENSORS}</sensor>'
)


@pytest.mark.parametrize(("wrong", "share"), [(1.0, 0.0), (1.01, 0.01)])
def test_an_ideal_spring_balances_a_weight_at_every_angle(wrong, share):
    """With k a b = m g c the moments of weight and of a spring of zero free length cancel."""
    stiffness = wrong * 2 * 9.81 * 0.5 / (0.4 * 0.25)
    model = model_with_spring(
        BALANCED_ARM, f'stiffness="{stiffness!r}" springlength="0"', FORCE_SENSORS, "0 -9.81 0"
    )
    angle = np.linspace(-3, 3, 61)
    found = solve(angle, model=model, joints=("arm",))
    np.testing.assert_allclose(found["moment"], -share * 9.81 * np.cos(angle), atol=2e-14, rtol=0)
    length = np.abs(0.4j - 0.25 * np.exp(1j * angle))
    np.testing.assert_allclose(found["length"], length, atol=1e-15, rtol=0)
    # the pin carries the weight and the force of the spring, in the frame of the arm
    pin = (2 * 9.81j - stiffness * (0.4j - 0.25 * np.exp(1j * angle))) * np.exp(-1j * angle)
    np.testing.assert_allclose(found["pin.x"], pin.real, atol=1e-13, rtol=0)
    np.testing.assert_allclose(found["pin.y"], pin.imag, atol=1e-13, rtol=0)


def test_a_moving_damper_needs_a_moment_and_loads_the_pin():
    """A run with inertia at a constant rate needs the moment of the damping force c L'."""
    spring = 'stiffness="0" damping="3" springlength="0"'
    model = model_with_spring(BALANCED_ARM, spring, FORCE_SENSORS)
    angle, rate = np.linspace(-3, 3, 61), 2.0
    found = solve(angle, rate, 0.0, model=model, joints=("arm",), inertia=True)
    apart = 0.4j - 0.25 * np.exp(1j * angle)
    slope = (apart.conj() * -0.25j * np.exp(1j * angle)).real / np.abs(apart)
    np.testing.assert_allclose(found["rate"], slope * rate, atol=1e-15, rtol=0)
    np.testing.assert_allclose(found["moment"], 3 * slope**2 * rate, atol=1e-14, rtol=0)
    pull = 3 * slope * rate * apart / np.abs(apart)
    pin = -2 * 0.5 * rate**2 - pull * np.exp(-1j * angle)
    np.testing.assert_allclose(found["pin.x"], pin.real, atol=1e-14, rtol=0)
    np.testing.assert_allclose(found["pin.y"], pin.imag, atol=1e-14, rtol=0)
    # the torque sensor at the pin has the moment of the drive against the damper
    np.testing.assert_allclose(found["twist.z"], found["moment"], atol=1e-14, rtol=0)


@pytest.mark.parametrize(
    ("spring", "words"),
    [
        ('range="0 1" limited="true"', "range of"),
        ('frictionloss="1"', "frictionloss of"),
        ('armature="1"', "armature of"),
    ],
)
def test_unsupported_properties_of_springs_are_refused(spring, words):
    with pytest.raises(NotCovered, match=f"{words} tendon 'spring'"):
        read(mass_on_a_slide(spring, 'qpos="1"'), "start")


def test_a_tendon_over_three_sites_is_refused():
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><site name="a"/><site name="b" pos="0 1 0"/><body><joint/>'
        '<geom size="0.1"/><site name="c"/></body></worldbody><tendon><spatial name="belt">'
        '<site site="a"/><site site="b"/><site site="c"/></spatial></tendon></mujoco>'
    )
    with pytest.raises(NotCovered, match="tendon 'belt', which goes by several sites"):
        read(model, "")


def test_disabled_springs_and_dampers_do_nothing():
    text = 'stiffness="18" damping="3" springlength="0.7"'
    model = mass_on_a_slide(text, 'qpos="1.0" qvel="0.5"')
    for flag in ("mjDSBL_SPRING", "mjDSBL_DAMPER"):
        model.opt.disableflags |= int(getattr(mujoco.mjtDisableBit, flag))
    t = np.linspace(0, 1, 11)
    assert np.abs(solve(t, model=model)["x"] - (1 + 0.5 * t)).max() < 1e-14


POLYNOMIAL_MODEL = """<mujoco><compiler angle="radian"/><option gravity="0 -9.81 0"/><worldbody>
  <site name="wall" pos=".4 .5 0"/><body><joint name="a" stiffness="3 -2 4" springref=".3" {}/>
    <inertial pos=".5 0 0" mass="1" diaginertia=".1 .1 .1"/>
    <body pos="1 0 0"><joint name="b" stiffness="0 0 5" {}/>
      <inertial pos=".3 .1 0" mass=".7" diaginertia=".1 .1 .1"/><site name="end" pos=".5 .1 0"/>
    </body></body></worldbody>
  <tendon><spatial name="spring" stiffness="20 5 9" springlength=".5 .8" {}><site site="wall"/>
    <site site="end"/></spatial><fixed name="belt" stiffness="6 2 3" springlength="-.2 .1" {}>
    <joint joint="a" coef="1"/><joint joint="b" coef="-1.5"/></fixed></tendon>
  <sensor><jointpos name="a" joint="a"/><jointpos name="b" joint="b"/><e_kinetic name="kinetic"/>
    <e_potential name="potential"/></sensor>
  <keyframe><key name="start" qpos=".2 -.4" qvel="1 2"/></keyframe></mujoco>"""


@pytest.mark.parametrize("damped", [False, True])
def test_polynomial_springs_and_dampers_agree_with_the_spatial_reference(damped):
    """The spatial reference has MuJoCo's terms, and compares them with its own formulation."""
    dampers = ['damping=".1 .2 .3"', 'damping="0 0 .2"', 'damping=".5 1 2"', 'damping=".3 0 1"']
    text, t = POLYNOMIAL_MODEL.format(*dampers if damped else [""] * 4), np.linspace(0, 0.4, 9)
    model = mujoco.MjModel.from_xml_string(text)
    one, two = solve(t, model=model), spatial.solve(t, model=model, terms=SmoothTerms(model))
    for name in ("a", "b", "kinetic", "potential"):
        assert np.abs(one[name] - two[name]).max() < 1e-10
    energy = one["kinetic"] + one["potential"]
    assert np.ptp(one["potential"]) > 1.0
    assert np.ptp(energy) < 1e-10 if not damped else (np.diff(energy) < 0).all()


DIFFERENTIAL_MODEL = """<mujoco><compiler angle="radian"/><option gravity="0 0 0"/><worldbody>
  <body><joint name="cage"/><inertial pos="0 0 0" mass="1" diaginertia="3 3 3"/></body>
  <body><joint name="left" ref="0.2"/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body>
  <body><joint name="right"/><inertial pos="0 0 0" mass="1" diaginertia="2 2 2"/></body>
  <body><joint name="rail" type="slide" axis="1 0 0"/>
    <inertial pos="0 0 0" mass="5" diaginertia="1 1 1"/></body></worldbody>
  <tendon><fixed name="mean"><joint joint="left" coef="0.5"/><joint joint="right" coef="0.5"/>
    </fixed>
    <fixed name="own"><joint joint="cage" coef="1"/></fixed>
    <fixed name="rack"><joint joint="rail" coef="2"/></fixed></tendon>
  <equality><tendon name="gears" tendon1="own" tendon2="mean" polycoef="0 1 0 0 0"/>
    <tendon name="teeth" tendon1="rack" tendon2="own" polycoef="0.1 0.6 0.2 0 0"/></equality>
  <actuator><motor name="m" joint="cage"/><motor name="l" joint="left"/></actuator>
  <sensor><jointpos name="cage" joint="cage"/><jointpos name="left" joint="left"/>
    <jointpos name="right" joint="right"/><jointpos name="rail" joint="rail"/>
    <jointvel name="speed" joint="rail"/><tendonpos name="sum" tendon="mean"/>
    <tendonvel name="pace" tendon="mean"/></sensor>
  <keyframe><key name="start" qpos="0 0.2 0 0.05" qvel="0 1 -1 0" ctrl="0 0.7"/></keyframe>
  </mujoco>"""


def test_a_differential_of_fixed_tendons_turns_its_cage_by_the_mean():
    """A rack moves by a polynomial of the cage angle; formulas give both from the drives."""
    model, x = mujoco.MjModel.from_xml_string(DIFFERENTIAL_MODEL), np.linspace(0, 2, 21)
    left, right = x + 0.2, 0.5 * x
    found = solve(
        np.stack([left, right]), [[1.0], [0.5]], 0.0, model=model, joints=("left", "right")
    )
    cage = 0.5 * (left - 0.2 + right)
    np.testing.assert_allclose(found["cage"], cage, atol=1e-14, rtol=0)
    np.testing.assert_allclose(found["rail"], 0.05 + 0.3 * cage + 0.1 * cage**2, atol=1e-14, rtol=0)
    np.testing.assert_allclose(found["speed"], (0.3 + 0.2 * cage) * 0.75, atol=1e-14, rtol=0)
    np.testing.assert_allclose(found["sum"], 0.5 * (left + right), atol=1e-14, rtol=0)
    np.testing.assert_allclose(found["pace"], 0.75, atol=1e-14, rtol=0)


def test_a_released_differential_moves_as_in_the_spatial_reference():
    model, t = mujoco.MjModel.from_xml_string(DIFFERENTIAL_MODEL), np.linspace(0, 1.6, 17)
    found, other = solve(t, model=model), spatial.solve(t, model=model)
    for name in ("cage", "left", "right", "rail", "speed", "sum", "pace"):
        assert np.abs(found[name] - other[name]).max() < 1e-11, name
    assert np.ptp(found["rail"]) > 0.05


def test_tendon_equalities_of_springs_are_refused():
    text = '<tendon name="same" tendon1="spring" polycoef="0 1 0 0 0"/>'
    model = model_with_spring(
        '<site name="one"/><body><joint name="x" type="slide" axis="1 0 0"/><site name="two"/>'
        '<geom size="0.1"/></body>',
        "",
        f"<equality>{text}</equality>",
    )
    with pytest.raises(NotCovered, match="tendon equality 'same', of ways in space"):
        read(model, "")


@pytest.mark.parametrize("name", ["springs_series", "springs_parallel"])
def test_a_pin_between_slides_along_one_line_is_refused(name):
    """It would also constrain the motion normal to the line, which the guides do already."""
    model = mujoco.MjModel.from_xml_path(str(shipped(f"{name}.xml")))
    with pytest.raises(NotCovered, match="slides along one line"):
        solve([0.0, 1.0], model=model)
