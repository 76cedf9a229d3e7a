"""Tests of several ideal drives in pymunk, of limit positions, and of the solver's iterations.

The mechanisms are a five-bar, a cylinder with a boom, and a serial arm.
"""

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from proofmass import load_case
from proofmass.analytic import planar
from proofmass.engines import engine_of
from proofmass.sim.protocol import BadModel, Drive, Run
from proofmass.sim.pymunk import quasi_static
from proofmass.sim.pymunk.dynamics import contraction_factor
from proofmass.sim.pymunk.engine import simulate
from proofmass.sim.pymunk.model import read_links, read_model
from proofmass.sim.pymunk.space import build_space, set_states
from proofmass.solve import plan_run
from tests.shipped import shipped

HEAD = (
    '<mujoco><compiler angle="radian"/><option gravity="0 -9.81 0"><flag contact="disable"/>'
    "</option>"
)
G = 9.81


def bar(length: float, mass: float) -> str:
    """The MJCF of the inertia of a uniform bar along x, from length [m] and mass [kg]."""
    turn = mass * length**2 / 12
    return (
        f'<inertial pos="{length / 2} 0 0" mass="{mass}" diaginertia="{turn / 100} {turn} {turn}"/>'
    )


FIVEBAR = f"""{HEAD}<worldbody>
  <body><joint name="left"/>{bar(1, 1)}
    <body pos="1 0 0"><joint name="rod"/>{bar(2, 2)}<site name="a" pos="2 0 0"/></body></body>
  <body pos="2 0 0"><joint name="right"/>{bar(1, 1)}
    <body pos="1 0 0"><joint/>{bar(2, 2)}<site name="b" pos="2 0 0"/></body></body></worldbody>
  <equality><connect site1="a" site2="b"/></equality>
  <actuator><motor name="l" joint="left"/><motor name="r" joint="right" gear="-2"/></actuator>
  <sensor><framepos name="tip" objtype="site" objname="a"/>
    <framelinvel name="speed" objtype="site" objname="a"/>
    <framelinacc name="rush" objtype="site" objname="a"/>
    <actuatorfrc name="l" actuator="l"/><actuatorfrc name="r" actuator="r"/></sensor>
  <keyframe><key name="start" qpos="1.5708 -.5236 1.5708 .5236"/></keyframe></mujoco>"""
TIP = ("tip.x", "tip.y", "speed.x", "speed.y", "rush.x", "rush.y")


def swing(joint: str, start: float, rate: float, far: float, w: float) -> Drive:
    """A drive with a steady motion plus an oscillation."""
    return Drive(
        joint,
        lambda t: (
            start + rate * t + far * np.sin(w * t),
            rate + far * w * np.cos(w * t),
            -far * w**2 * np.sin(w * t),
        ),
    )


def hold(joint: str, value: float) -> Drive:
    return Drive(joint, lambda t: (value + 0 * t, 0 * t, 0 * t))


BOTH = (swing("left", np.pi / 2, 0.5, 0.1, 2), swing("right", np.pi / 2, -0.3, 0.2, 3))


def five_tip(angle):
    """Tip of the five-bar: the upper intersection of circles of 2 m about the crank ends.

    Angles of the cranks are (2, n).
    """
    ends = np.stack([np.cos(angle), np.sin(angle)])
    ends[0, 1] = ends[0, 1] + 2
    apart = ends[:, 1] - ends[:, 0]
    rise = np.sqrt(4 / (apart**2).sum(0) - 0.25)
    return ends.mean(1) + rise * np.stack([-apart[1], apart[0]])


def five_weight(angle):
    """Potential energy of cranks of 1 kg and of rods of 2 kg between crank ends and tip."""
    pins = np.sin(angle)
    return G * (0.5 * pins.sum(0) + 2 * (0.5 * pins.sum(0) + five_tip(angle)[1]))


def along(function, place, rate):
    return np.imag(function(place + 1e-30j * rate)) / 1e-30


def five_truth(place, rate, acceleration):
    """Position, velocity and acceleration of the tip (6, n) at a state of the drives."""
    h = 1e-4  # error h^2 of the central difference: 1e-8
    late, early = (
        along(
            five_tip, place + s * h * rate + 0.5 * h**2 * acceleration, rate + s * h * acceleration
        )
        for s in (1, -1)
    )
    return np.concatenate([five_tip(place), along(five_tip, place, rate), (late - early) / (2 * h)])


@pytest.fixture
def write(tmp_path):
    def to_file(text: str) -> Path:
        file = tmp_path / "inline.xml"
        file.write_text(text)
        return file

    return to_file


def test_sweep_of_a_five_bar_with_both_forces(write):
    run = Run("sweep", np.linspace(0, 2, 41), (*TIP[:4], "l", "r"), BOTH)
    got = simulate(write(FIVEBAR), run)
    truth = five_truth(*got.drive)
    for k, name in enumerate(TIP[:4]):
        np.testing.assert_allclose(got.channels[name], truth[k], atol=1e-12, rtol=0)  # rounding
    units = np.eye(2)[:, :, None] * np.ones(41)
    left, right = (along(five_weight, got.drive[0], unit) for unit in units)
    # rounding of impulses: 3e-13 N m measured on 25 N m
    np.testing.assert_allclose(got.channels["l"], left, atol=1e-11, rtol=0)
    np.testing.assert_allclose(got.channels["r"], right / -2, atol=1e-11, rtol=0)


def five_errors(file: Path, dt: float):
    run = Run("dynamics", np.linspace(0, 2, 101), TIP, BOTH, settings={"timestep": dt})
    got = simulate(file, run)
    law = np.array([drive.profile(run.x)[0] for drive in BOTH])
    np.testing.assert_allclose(got.drive[0], law, atol=1e-14, rtol=0)  # met to rounding, both
    truth = five_truth(*got.drive)
    return np.array([np.abs(got.channels[n] - truth[k]).max() for k, n in enumerate(TIP)])


def test_a_five_bar_is_second_order(write):
    file = write(FIVEBAR)
    coarse, fine = five_errors(file, 2e-3), five_errors(file, 1e-3)
    assert np.all(np.log2(coarse / fine) > 1.9), coarse / fine
    # constraint violation that the first-order correction leaves: (rate dt)^2
    assert fine[:2].max() < 1e-6


def test_a_drive_about_the_opposite_axis_turns_the_other_way(write):
    turned = FIVEBAR.replace('name="right"/>', 'name="right" axis="0 0 -1"/>')
    turned = turned.replace("1.5708 .5236", "-1.5708 .5236")
    back = swing("right", -np.pi / 2, 0.3, -0.2, 3)
    for kind in ("dynamics", "sweep"):
        run = Run(kind, np.linspace(0, 1, 21), TIP[:4], BOTH)
        there = simulate(write(FIVEBAR), run).channels
        same = simulate(write(turned), replace(run, drives=(BOTH[0], back))).channels
        for name in TIP[:4]:
            np.testing.assert_allclose(same[name], there[name], atol=1e-12, rtol=0)


def test_a_drive_may_hold_still(write):
    run = Run("dynamics", np.linspace(0, 1, 51), TIP[:4], (BOTH[0], hold("right", 1.5)))
    got = simulate(write(FIVEBAR), run)
    np.testing.assert_allclose(got.drive[0][1], 1.5, atol=1e-14, rtol=0)
    np.testing.assert_allclose(got.drive[1][1], 0.0, atol=1e-11)  # rounding over a step
    truth = five_truth(*got.drive)
    for k, name in enumerate(TIP[:4]):
        np.testing.assert_allclose(got.channels[name], truth[k], atol=1e-5)  # dt^2, with 2 ms


CYLINDER = f"""{HEAD}<worldbody>
  <body><joint name="barrel"/>{bar(1, 2)}
    <body><joint name="stroke" type="slide" axis="1 0 0"/><site name="eye"/>
      <inertial pos="0 0 0" mass=".5" diaginertia=".01 .01 .01"/></body></body>
  <body pos="1 0 0"><joint name="boom"/>{bar(1.5, 3)}<site name="lug" pos="1.5 0 0"/></body>
  </worldbody><equality><connect site1="eye" site2="lug"/></equality>
  <actuator><motor name="force" joint="stroke"/></actuator>
  <sensor><jointpos name="boom" joint="boom"/><jointvel name="boom_rate" joint="boom"/>
    <user name="boom_rush" objtype="joint" objname="boom" datatype="real" needstage="acc" dim="1"/>
    <actuatorfrc name="force" actuator="force"/></sensor>
  <keyframe><key name="start" qpos=".98279 1.80278 1.5708"/></keyframe></mujoco>"""


def boom(length):
    """Angle of the boom by the law of cosines, with a base of 1 m and a boom of 1.5 m."""
    return np.pi - np.arccos((1 + 1.5**2 - length**2) / 3)


def cylinder_weight(length):
    """Potential energy: the eye is at a height of 1.5 sin(boom).

    The barrel's centre of mass is 0.5 m along the cylinder.
    """
    eye = 1.5 * np.sin(boom(length))
    return G * (3 * eye / 2 + 0.5 * eye + 2 * 0.5 * eye / length)


def test_a_driven_slide_between_moving_links_and_its_force(write):
    run = Run(
        "sweep",
        np.linspace(0, 1, 21),
        ("boom", "boom_rate", "force"),
        (swing("stroke", 1.8, 0.3, 0.1, 5),),
    )
    got = simulate(write(CYLINDER), run)
    place, rate, _ = (part[0] for part in got.drive)
    # rounding times the boom's transmission and the solver's
    np.testing.assert_allclose(got.channels["boom"], boom(place), atol=1e-11, rtol=0)
    np.testing.assert_allclose(
        got.channels["boom_rate"], along(boom, place, rate), atol=1e-10, rtol=0
    )
    np.testing.assert_allclose(
        got.channels["force"], along(cylinder_weight, place, 1), atol=1e-9, rtol=0
    )


def test_a_driven_slide_between_moving_links_is_second_order(write):
    file, errors = write(CYLINDER), []
    for dt in (2e-3, 1e-3):
        run = Run(
            "dynamics",
            np.linspace(0, 1, 51),
            ("boom", "boom_rate"),
            (swing("stroke", 1.8, 0.3, 0.1, 5),),
            settings={"timestep": dt},
        )
        got = simulate(file, run)
        place, rate, _ = (part[0] for part in got.drive)
        errors.append(
            [
                np.abs(got.channels["boom"] - boom(place)).max(),
                np.abs(got.channels["boom_rate"] - along(boom, place, rate)).max(),
                np.abs(place - run.drives[0].profile(run.x)[0]).max(),
            ]
        )
    assert np.all(np.log2(np.divide(*errors)) > 1.8), errors
    assert max(errors[1]) < 1e-5  # (rate of the slide's rotation dt)^2, and constraint violation


ARM = f"""{HEAD}<worldbody><body><joint name="shoulder"/>{bar(1, 3)}
  <body pos="1 0 0"><joint name="elbow"/>{bar(0.8, 2)}
  <body pos=".8 0 0"><joint name="wrist"/>{bar(0.3, 1)}</body></body></body></worldbody>
  <sensor><jointactuatorfrc name="m1" joint="shoulder"/><jointactuatorfrc name="m2" joint="elbow"/>
  <jointactuatorfrc name="m3" joint="wrist"/></sensor></mujoco>"""
ARM_DRIVES = (swing("shoulder", 0, 1, 0.3, 2), swing("elbow", 0, -1, 0.2, 3), hold("wrist", 0.3))


def test_drives_that_share_links_are_met_to_rounding_and_carry_their_own_moments(write):
    run = Run("sweep", np.linspace(0, 3, 31), ("m1", "m2", "m3"), ARM_DRIVES)
    got = simulate(write(ARM), run)
    sums = np.cos(np.cumsum(got.drive[0], axis=0))
    wrist = G * 0.15 * sums[2]
    elbow = G * (2 * 0.4 + 0.8) * sums[1] + wrist
    shoulder = G * (3 * 0.5 + 2 + 1) * sums[0] + elbow
    for name, moment in zip(("m1", "m2", "m3"), (shoulder, elbow, wrist), strict=True):
        np.testing.assert_allclose(
            got.channels[name], moment, atol=1e-10, rtol=0
        )  # rounding of impulses
    moved = simulate(write(ARM), Run("dynamics", run.x, (), ARM_DRIVES))
    law = np.array([drive.profile(run.x)[0] for drive in ARM_DRIVES])
    # only the last is met exactly in a step; what the others lack by the end of the iterations,
    # 1.2e-9 rad here, is made up for in the next
    np.testing.assert_allclose(moved.drive[0], law, atol=2e-9, rtol=0)


SHORT = FIVEBAR.replace(
    f'<joint name="right"/>{bar(1, 1)}\n    <body pos="1 0 0">',
    f'<joint name="right"/>{bar(0.2, 0.1)}<body pos=".2 0 0">',
).replace('qpos="1.5708 -.5236 1.5708 .5236"', 'qpos="1.570796 -0.949182 1.570796 0.188169"')
BENDING = SHORT.replace(
    f'{bar(2, 2)}<site name="a" pos="2 0 0"/></body></body>',
    f'{bar(1, 1)}<body pos="1 0 0"><joint stiffness="40"/>{bar(1, 1)}<site name="a" pos="1 0 0"/>'
    "</body></body></body>",
).replace('qpos="1.570796 -0.949182', 'qpos="1.570796 -0.949182 0')


@pytest.mark.parametrize("model", [SHORT, BENDING], ids=["rigid", "a rod bends"])
def test_each_of_two_drives_does_the_work_that_the_energy_gains(model, write):
    """Moments of two drives are derivatives of the energy, with signs that Chipmunk does not give.

    Each of them vanishes on the path while the other does not.  Where a rod bends, a joint of the
    heavy crank falls as the light one permits, so that the force of each drive must be reduced
    separately to find its sign.
    """
    h, left = 1e-4, np.linspace(1.3, 2.2, 19)
    moves = h * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]])
    place = (np.column_stack([left, 3.77 - 1.44 * left])[:, None] + moves).reshape(-1, 2)
    drives = tuple(
        Drive(name, lambda x, k=k: (place[x.astype(int), k], 0 * x, 0 * x))
        for k, name in enumerate(("left", "right"))
    )
    text = model.replace("<sensor>", '<sensor><e_potential name="energy"/>')
    run = Run("sweep", np.arange(len(place)) + 0.0, ("energy", "l", "r"), drives)
    got = simulate(write(text), run).channels
    energy = got["energy"].reshape(-1, 5)
    gained = (energy[:, 1::2] - energy[:, 2::2]) / (2 * h)
    done = np.column_stack([got["l"][::5], -2 * got["r"][::5]])  # the gear of the right motor
    np.testing.assert_allclose(done, gained, atol=2e-6)  # h^2, and rounding of the energy by h
    assert all(np.ptp(np.sign(moment)) == 2 for moment in done.T)


@pytest.mark.parametrize("name", ["fourbar", "hacksaw_forces", "threeprr_forces", "fivebar_forces"])
def test_nothing_at_rest_depends_on_inertia(name, monkeypatch):
    """Poses, rates, moments and forces of a sweep are the same with the masses of the model.

    With the replaced inertia fewer iterations are needed, as the factor by which an iteration
    reduces an error shows.
    """
    case = load_case(shipped(f"{name}.toml"))
    run = plan_run(case, "sweep", "pymunk")
    run = replace(run, x=run.x[:: len(run.x) // 12])
    found, shares = [], []
    for masses in (quasi_static.replace_inertia, lambda links: links):
        monkeypatch.setattr(quasi_static, "replace_inertia", masses)
        found.append(simulate(case.model_path, run).channels)
        links, settings = read_model(case.model_path, run)
        held = quasi_static.start_sweep(links, settings)
        shares.append(contraction_factor(held.links, held.pose))
    for channel, curve in found[0].items():
        np.testing.assert_allclose(curve, found[1][channel], rtol=1e-9, atol=1e-9)  # iterations
    assert np.log(shares[0]) < 2.5 * np.log(shares[1])


def test_a_sweep_takes_no_more_iterations_with_a_coupler_of_a_gram(tmp_path):
    """The crank has 1000 kg and the coupler 1 g.

    The number of iterations is that of the shipped masses, and the moment balances the weights.
    """
    case = load_case(shipped("fourbar.toml"))
    run = plan_run(case, "sweep", "pymunk")
    run = replace(run, x=run.x[::30])
    text = case.model_path.read_text()
    for mass, turn, factor in (("1", "0.0833333333333333", 1e3), ("2", "0.666666666666667", 5e-4)):
        old = f'mass="{mass}" diaginertia="0.001 {turn} {turn}"'
        assert text.count(old) == 1
        turn = factor * float(turn)
        text = text.replace(
            old, f'mass="{factor * float(mass)}" diaginertia="{turn} {turn} {turn}"'
        )
    uneven = tmp_path / "uneven.xml"
    uneven.write_text(text)
    even, got = (simulate(file, run) for file in (case.model_path, uneven))
    assert got.settings == even.settings
    pin, turn = got.channels["pin_velocity.y"], np.cos(run.x)  # 1 rad/s
    wanted = G * (1000 * turn / 2 + 0.001 * (turn + pin) / 2 + 2.5 * pin / 2)
    np.testing.assert_allclose(got.channels["holding_moment"], wanted, rtol=1e-10, atol=1e-8)
    np.testing.assert_allclose(got.channels["rocker"], even.channels["rocker"], atol=1e-12, rtol=0)


ROCKER = Drive("rocker", lambda x: (x, 1 + 0 * x, 0 * x))
LIMIT = np.pi - np.arccos((3**2 + 2.5**2 - (2 - 1) ** 2) / (2 * 3 * 2.5))  # folded onto the crank


def test_a_sweep_stops_at_a_limit_position_and_keeps_what_it_has():
    run = Run("sweep", np.linspace(2.25, LIMIT + 0.3, 101), ("rocker", "rocker_rate"), (ROCKER,))
    got = simulate(shipped("fourbar.xml"), run)
    done = got.x.size
    assert got.x[-1] < LIMIT < run.x[done]
    assert got.stopped.startswith(
        f"stopped at rocker = {got.x[-1]:.6g}: the loops cannot be "
        f"closed at rocker = {run.x[done]:.6g}, open by"
    )
    assert all(part.shape == (1, done) for part in got.drive)
    np.testing.assert_allclose(got.channels["rocker"], got.x, atol=1e-12, rtol=0)
    np.testing.assert_allclose(got.channels["rocker_rate"], 1, atol=1e-9, rtol=0)


def test_the_gap_beyond_a_limit_is_the_least_one(write):
    """A cylinder of 2.52 m between points at most 2.5 m apart leaves a violation of 0.02 m."""
    drives = (swing("stroke", 2.4, 1, 0, 0),)
    run = Run("sweep", np.array([0, 0.04, 0.12]), ("boom",), drives)
    assert simulate(write(CYLINDER), run).stopped.endswith(" = 2.52, open by 0.02 m")


def test_a_sweep_that_cannot_begin_is_a_bad_model():
    run = Run("sweep", LIMIT + np.array([-0.01, 0.02, 0.03]), (), (ROCKER,))
    with pytest.raises(BadModel, match=r"cannot be closed at rocker = .*, open by"):
        simulate(shipped("fourbar.xml"), run)


def test_contraction_is_what_the_engine_does():
    """From 60 to 120 iterations, errors of a step fall by the factor to the 60th power."""
    model = mujoco.MjModel.from_xml_path(str(shipped("fourbar.xml")))
    links, speeds = read_links(model, "start", ()), {}
    # the pins alone leave the linkage free to fall
    for count in (12, 24, 5000):
        space = build_space(links, count, 0.0)
        set_states(space, links.pose, np.zeros_like(links.pose))
        space.step(1e-3)
        speeds[count] = np.array([[*b.velocity, b.angular_velocity] for b in space.bodies])
    early, late = (np.abs(speeds[n] - speeds[5000]).max() for n in (12, 24))
    assert late > 1e-9  # far above rounding
    # other parts of the error contract faster, and are smaller by 2e-4 after 12 iterations
    contraction = contraction_factor(links, links.pose) ** 12
    assert late / early == pytest.approx(contraction, rel=1e-3, abs=0)


@pytest.mark.parametrize("engine", ["mujoco", "pymunk"])
def test_a_drive_that_begins_at_speed_carries_along_what_hangs_on_it(engine):
    """The pendulum's joints start with the angles and rates of the key, relative to the cart.

    The pendulum therefore starts with the velocity of the cart.
    """

    def law(t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        t = np.asarray(t, float)
        return 0.05 + 0.5 * t + 0.1 * t**2, 0.5 + 0.2 * t, 0.2 + 0.0 * t

    file, t = shipped("driven_cart.xml"), np.linspace(0.0, 0.5, 51)
    names = ("upper", "lower", "upper_rate")
    run = Run("dynamics", t, names, (Drive("cart", law),), settings={"timestep": 5e-4})
    found = engine_of(engine).simulate(file, run).channels
    model = mujoco.MjModel.from_xml_path(str(file))
    wanted = planar.solve(*law(t), model=model, joints=("cart",), in_time=(t, [law]))
    # the error is of second order in the step; the start speed of the cart has an effect of 0.1
    for name in names:
        assert np.abs(found[name] - wanted[name]).max() < 1e-4 * np.ptp(wanted[name])
