"""Tests of springs between two points, in both engines: dynamics, sweeps, programs, refusals."""

from functools import cache
from pathlib import Path

import mujoco
import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from proofmass.analytic.planar import solve
from proofmass.case.drive import Steady, motion_source
from proofmass.report.case_data import motion_data
from proofmass.sim.motion import motion
from proofmass.sim.mujoco.engine import ENGINE as MUJOCO
from proofmass.sim.protocol.failures import Unsupported
from proofmass.sim.protocol.run import Drive, Run
from proofmass.sim.pymunk.engine import ENGINE as PYMUNK
from tests.programs import program_curves
from tests.shipped import shipped

ENGINES = {"mujoco": MUJOCO, "pymunk": PYMUNK}
EXACT_SETTINGS = {"iterations": 2000, "error_bias": 0.0}
CHAIN = """<mujoco><compiler angle="radian"/>
  <option gravity="0 -9.81 0" timestep="1e-3" integrator="RK4"><flag contact="disable"/></option>
  <worldbody><site name="wall" pos="0.5 0.9 0"/>
    <body><joint name="a"/><inertial pos="0.3 0.1 0" mass="2" diaginertia="1 1 0.2"/>
      <site name="foot"/><site name="elbow" pos="0.1 0.2 0"/>
      <body pos="0.7 0 0"><joint name="b" axis="0 0 -1"/>
        <inertial pos="0.3 0 0" mass="1" diaginertia="1 1 0.1"/><site name="tip" pos="0.6 0.1 0"/>
      </body></body></worldbody>
  <tendon><spatial name="high" {high}><site site="wall"/><site site="tip"/></spatial>
    <spatial name="low" {low}><site site="tip"/><site site="elbow"/></spatial>
    <spatial name="ruler"><site site="wall"/><site site="elbow"/></spatial></tendon>
  <actuator><motor name="m" joint="a"/></actuator>
  <sensor><jointpos name="a" joint="a"/><jointpos name="b" joint="b"/><jointvel name="w" joint="b"/>
    <tendonpos name="length" tendon="high"/><tendonvel name="pace" tendon="low"/>
    <tendonpos name="ruler" tendon="ruler"/><e_potential name="potential"/>
    <actuatorfrc name="moment" actuator="m"/><force name="pin" site="foot"/></sensor>
  <keyframe><key name="start" qpos="0.3 0.9" qvel="1 -0.5"/></keyframe></mujoco>"""
TWO_SPRINGS = 'stiffness="60" springlength="0.5"', 'stiffness="35" springlength="0.3"'
TWO_SLACK_SPRINGS = (
    'stiffness="60" springlength="0.45 0.85"',
    'stiffness="35" springlength="0.3 0.5"',
)
TWO_DAMPED_SPRINGS = 'stiffness="60" springlength="0.5" damping="1.5"', 'damping="0.8"'
MOTION_CHANNELS = ("a", "b", "w", "length", "pace", "ruler", "potential")


def write_chain(folder: Path, springs: tuple[str, str]) -> Path:
    """Write a double pendulum with two springs and a tendon without stiffness, `ruler`."""
    file = folder / "chain.xml"
    file.write_text(CHAIN.format(high=springs[0], low=springs[1]))
    return file


def reference_curves(file: Path, run: Run, inertia: bool = False) -> dict[str, np.ndarray]:
    """Curves of the planar reference for a run."""
    model = mujoco.MjModel.from_xml_path(str(file))
    if not run.drives:
        return solve(run.x, model=model)
    joints = tuple(drive.joint for drive in run.drives)
    return solve(*run.motion(run.x), model=model, joints=joints, inertia=inertia)


def sample_times(until: float) -> np.ndarray:
    """Times of a free motion [s]."""
    return np.linspace(0, until, 51)


@cache
def released_motion(text: str, until: float) -> dict[str, np.ndarray]:
    """The planar reference of a free motion, computed once for both engines and all steps."""
    return solve(sample_times(until), model=mujoco.MjModel.from_xml_string(text))


def relative_errors(engine: str, file: Path, step: float, until: float = 1.0) -> dict[str, float]:
    """The largest error of each channel in a free motion, as a share of its range."""
    settings = {"timestep": step, **(EXACT_SETTINGS if engine == "pymunk" else {})}
    run = Run("dynamics", sample_times(until), MOTION_CHANNELS, settings=settings)
    found, truth = (
        ENGINES[engine].simulate(file, run).channels,
        released_motion(file.read_text(), until),
    )
    return {n: float(np.abs(found[n] - truth[n]).max() / np.ptp(truth[n])) for n in MOTION_CHANNELS}


@pytest.mark.parametrize("springs", [TWO_SPRINGS, TWO_SLACK_SPRINGS], ids=["springs", "slack"])
def test_point_springs_in_pymunk_are_of_second_order(springs, tmp_path):
    """Errors fall with the square of the time step.

    The tip passes the wall at less than 0.1 m, where the rate of the length changes within 0.02 s.
    """
    file = write_chain(tmp_path, springs)
    coarse, fine = (relative_errors("pymunk", file, step) for step in (1e-3, 5e-4))
    for name in MOTION_CHANNELS:
        assert coarse[name] < (2e-3 if name == "pace" else 5e-4)
        assert coarse[name] / fine[name] == pytest.approx(4, rel=0.15)


@pytest.mark.parametrize("sites", ["", "arm"])
def test_a_spring_between_two_points_of_one_body_moves_nothing(sites, tmp_path):
    """Pymunk refuses a constraint of a body with itself, such as the ground, so none is made."""
    file, points = tmp_path / "a.xml", '<site name="p"/><site name="q" pos=".7 -.1 0"/>'
    spring = '<tendon><spatial stiffness="1000"><site site="p"/><site site="q"/></spatial></tendon>'
    curves = []
    for tendon in ("", spring):
        file.write_text(
            f"""<mujoco><option gravity="0 -9.81 0"/><worldbody>{"" if sites else points}
            <body><joint name="j"/><inertial pos=".5 0 0" mass="1" diaginertia=".1 .1 .1"/>
            {points if sites else ""}</body></worldbody>{tendon}
            <sensor><jointpos name="j" joint="j"/></sensor></mujoco>"""
        )
        run = Run("dynamics", np.linspace(0, 0.1, 3), ("j",))
        curves.append(ENGINES["pymunk"].simulate(file, run).channels["j"])
    np.testing.assert_array_equal(*curves)


def test_dampers_of_pymunk_are_of_second_order(tmp_path):
    file = write_chain(tmp_path, TWO_DAMPED_SPRINGS)
    coarse, fine = (relative_errors("pymunk", file, step) for step in (1e-3, 5e-4))
    for name in ("a", "b", "length"):
        assert coarse[name] < 1e-4
        assert coarse[name] / fine[name] == pytest.approx(4, rel=0.1)


def test_point_springs_in_mujoco_are_of_fourth_order(tmp_path):
    file = write_chain(tmp_path, TWO_SPRINGS)
    coarse, fine = (relative_errors("mujoco", file, step) for step in (1e-3, 5e-4))
    for name in MOTION_CHANNELS:
        assert coarse[name] < 1e-7
        assert 9 < coarse[name] / fine[name] < 23  # 16, with terms of other orders at 1 ms


@pytest.mark.parametrize(
    ("springs", "allowed"), [(TWO_DAMPED_SPRINGS, 1e-8), (TWO_SLACK_SPRINGS, 5e-6)]
)
def test_mujoco_has_dampers_and_slack_springs(springs, allowed, tmp_path):
    """Slack springs have a larger tolerance: RK4 is of second order where they begin to pull."""
    assert max(relative_errors("mujoco", write_chain(tmp_path, springs), 1e-3).values()) < allowed


@pytest.mark.parametrize("engine", ENGINES)
def test_a_spring_one_percent_stiffer_exceeds_the_tolerance(engine, tmp_path):
    """Mutation: a stiffness that is wrong by 1 % exceeds the tolerances of the tests above."""
    run = Run("dynamics", sample_times(1.0), ("b",), settings={"timestep": 1e-3})
    stiffer = write_chain(tmp_path, (TWO_SPRINGS[0].replace("60", "60.6"), TWO_SPRINGS[1]))
    wrong = ENGINES[engine].simulate(stiffer, run)
    truth = released_motion(write_chain(tmp_path, TWO_SPRINGS).read_text(), 1.0)["b"]
    assert np.abs(wrong.channels["b"] - truth).max() > 1e-3 * np.ptp(truth)


@pytest.mark.parametrize("driven", [False, True], ids=["free", "driven"])
@pytest.mark.parametrize(
    "springs", [TWO_SLACK_SPRINGS, TWO_DAMPED_SPRINGS], ids=["slack", "damped"]
)
def test_a_pymunk_program_has_the_springs(springs, driven, tmp_path):
    """A pymunk program computes the same motion and the same moment of a drive."""
    file, profile = write_chain(tmp_path, springs), Steady(0.3, 1.0, True)
    settings = {"timestep": 1e-3, "iterations": 100, "error_bias": 0.0}
    drives = (Drive("a", profile),) if driven else ()
    names = (*MOTION_CHANNELS, "moment") if driven else MOTION_CHANNELS
    run = Run("dynamics", np.linspace(0, 0.5, 26), names, drives, settings=settings)
    wanted = PYMUNK.simulate(file, run).channels
    motion = motion_source([profile], run.x) if driven else ""
    found = program_curves(PYMUNK.programs.write_program(file, run, motion, ""), tmp_path)
    for name in names:  # 1e-9: rounding of rates, which accelerations divide by the step
        share = 1e-9 if name == "moment" else 1e-11
        assert np.abs(found[name] - wanted[name]).max() < share * np.ptp(wanted[name]), name


def write_sprung_four_bar(folder: Path, stiffness: float = 40.0) -> Path:
    """Write the model `fourbar_forces` with a spring and damper from coupler to ground."""
    text = shipped("fourbar_forces.xml").read_text()
    site = '<site name="hook" pos="1.5 2.5 0"/>'
    spring = (
        f'<tendon><spatial name="spring" stiffness="{stiffness}" damping="7" springlength="1.2">'
        '<site site="hook"/><site site="on_coupler"/></spatial></tendon>'
    )
    text = text.replace("<worldbody>", f"<worldbody>{site}", 1)
    text = text.replace("<equality>", f"{spring}<equality>", 1)
    text = text.replace(
        '<body name="coupler" pos="1 0 0">',
        '<body name="coupler" pos="1 0 0"><site name="on_coupler" pos="0.7 0.4 0"/>',
        1,
    )
    file = folder / "four_bar.xml"
    file.write_text(text)
    assert "on_coupler" in text.split("<tendon>")[0]
    return file


TURNING_CRANK = Drive("crank", lambda t: (t, 1 + 0 * t, 0 * t))


@pytest.mark.parametrize("engine", ENGINES)
def test_the_holding_moment_of_a_sweep_includes_a_spring(engine, tmp_path):
    """The holding moment equals the planar reference; the damper does nothing at rest.

    A spring that is 1 % stiffer changes the moment by more than 1e-3 of its range.
    """
    file = write_sprung_four_bar(tmp_path)
    run = Run("sweep", np.linspace(0, 6, 25), ("holding_moment",), (TURNING_CRANK,))
    found = ENGINES[engine].simulate(file, run).channels["holding_moment"]
    truth = reference_curves(file, run)["holding_moment"]
    without = reference_curves(write_sprung_four_bar(tmp_path, 0.0), run)["holding_moment"]
    assert np.ptp(truth - without) > 10.0  # [N m] the part of the moment that the spring causes
    assert np.abs(found - truth).max() < 1e-11 * np.ptp(truth)
    wrong = reference_curves(write_sprung_four_bar(tmp_path, 40.4), run)["holding_moment"]
    assert np.abs(found - wrong).max() > 1e-3 * np.ptp(truth)


def test_pin_forces_in_pymunk_include_a_spring(tmp_path):
    """Pin forces equal the planar reference at rest, and at 1 rad/s with the spring's damper.

    MuJoCo's force sensors leave tendons out, so that its channels are missing.
    """
    file = write_sprung_four_bar(tmp_path)
    model = mujoco.MjModel.from_xml_path(str(file))
    names = [
        f"{model.sensor(s).name}.{part}"
        for s in range(model.nsensor)
        if model.sensor_type[s] == mujoco.mjtSensor.mjSENS_FORCE
        for part in "xy"
    ]
    assert len(names) > 5
    for kind, allowed in (("sweep", 1e-10), ("dynamics", 1e-4)):
        run = Run(kind, np.linspace(0, 3, 13), tuple(names), (TURNING_CRANK,))
        found, truth = (
            PYMUNK.simulate(file, run).channels,
            reference_curves(file, run, kind == "dynamics"),
        )
        for name in names:
            assert np.abs(found[name] - truth[name]).max() < allowed * np.ptp(truth[name]), name
        assert not MUJOCO.simulate(file, run).channels
        assert "leave out tendon 'spring'" in MUJOCO.simulate(file, run).missing[names[0]]


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("springs", [TWO_SPRINGS, TWO_SLACK_SPRINGS], ids=["springs", "slack"])
def test_a_free_joint_between_springs_rests_at_the_least_energy(engine, springs, tmp_path):
    """The second arm rests between two springs at the angle of the least energy, found by a search.

    The moment of the drive is the derivative of that energy.
    """
    file = write_chain(tmp_path, springs)
    file.write_text(file.read_text().replace('qpos="0.3 0.9"', 'qpos="0.3 -2.3"'))
    run = Run(
        "sweep",
        np.linspace(0.3, 0.9, 13),
        ("b", "moment"),
        (Drive("a", lambda t: (t, 1 + 0 * t, 0 * t)),),
    )
    found = ENGINES[engine].simulate(file, run)
    (k_high, *high), (k_low, *low) = spring_numbers(springs)

    def total(a: float, b: float) -> float:
        arm = np.exp(1j * a)
        fore = np.exp(1j * (a - b))
        tip = 0.7 * arm + (0.6 + 0.1j) * fore
        weight = 9.81 * (2 * ((0.3 + 0.1j) * arm).imag + (0.7 * arm + 0.3 * fore).imag)
        return (
            weight
            + spring_energy(k_high, high, abs(tip - 0.5 - 0.9j))
            + spring_energy(k_low, low, abs(tip - (0.1 + 0.2j) * arm))
        )

    for a, b, moment in zip(run.x, found.channels["b"], found.channels["moment"], strict=True):
        best = minimize_scalar(lambda x, a=a: total(a, x), (b - 0.3, b, b + 0.2), tol=1e-12)
        assert b == pytest.approx(best.x, abs=3e-8)  # square root of the energy's rounding
        slope = (total(a + 1e-5, b) - total(a - 1e-5, b)) / 2e-5
        assert moment == pytest.approx(slope, abs=1e-6)


def spring_numbers(springs: tuple[str, str]) -> list[tuple[float, float, float]]:
    """Stiffness, and the two lengths between which they are slack, of two springs."""
    found = []
    for text in springs:
        parts = dict(zip(text.split('"')[0::2], text.split('"')[1::2], strict=False))
        slack = [float(x) for x in parts[" springlength="].split()]
        found.append((float(parts["stiffness="]), slack[0], slack[-1]))
    return found


def spring_energy(stiffness: float, slack: list[float], length: float) -> float:
    """Energy of a spring that is slack between two lengths."""
    return 0.5 * stiffness * (length - min(max(length, slack[0]), slack[1])) ** 2


@pytest.mark.parametrize(
    ("high", "words"),
    [
        ('range="0 1" limited="true"', "range of tendon 'high'"),
        ('frictionloss="1"', "frictionloss of tendon 'high'"),
        ('armature="1"', "armature of tendon 'high'"),
        ('stiffness="1 2"', "polynomial stiffness of tendon 'high'"),
        ('damping="1 2"', "polynomial damping of tendon 'high'"),
    ],
)
def test_pymunk_refuses_tendon_features_that_it_does_not_cover(high, words, tmp_path):
    with pytest.raises(Unsupported, match=words):
        PYMUNK.simulate(
            write_chain(tmp_path, (high, "")), Run("dynamics", np.linspace(0, 1, 3), ())
        )


def test_pymunk_refuses_a_spring_that_leaves_the_plane(tmp_path):
    file = write_chain(tmp_path, TWO_SPRINGS)
    file.write_text(file.read_text().replace('pos="0.5 0.9 0"', 'pos="0.5 0.9 0.1"'))
    with pytest.raises(Unsupported, match="tendon 'high', whose sites differ in height"):
        PYMUNK.simulate(file, Run("dynamics", np.linspace(0, 1, 3), ()))


def test_pictures_and_animations_show_the_ends_of_springs(tmp_path):
    """At all drawn poses, the distance of a spring's ends equals the sensor of its length.

    In the animation they are at fixed points of their bodies, at the places of the picture.
    """
    file = write_chain(tmp_path, TWO_SPRINGS)
    run = Run("dynamics", np.linspace(0, 1, 26), MOTION_CHANNELS)
    drawn = motion(file, run, {}).picture
    assert [coil.name for coil in drawn.coils] == ["high", "low"]  # the ruler is not drawn
    lengths = np.linalg.norm(np.diff(drawn.coils[0].ends, axis=1)[:, 0], axis=1)
    truth = released_motion(file.read_text(), 1.0)["length"][::2]
    assert np.abs(lengths - truth).max() < 1e-6
    moved = motion(file, run, {}, 26)
    for coil, drawn_coil in zip(moved.coils, moved.picture.coils, strict=True):
        for k, (body, at) in enumerate(zip(coil.body, coil.at, strict=True)):
            places = moved.places[:, body] if body >= 0 else np.zeros((26, 3))
            turn = np.exp(1j * places[:, 2]) * complex(*at)
            ends = places[:, :2] + np.column_stack([turn.real, turn.imag])
            assert np.abs(ends - drawn_coil.ends[:, k]).max() < 1e-12
    data = motion_data(moved)["coils"]
    assert [(one["name"], one["body"]) for one in data] == [("high", [-1, 1]), ("low", [1, 0])]


@pytest.mark.parametrize("engine", ENGINES)
def test_an_ideal_spring_balances_a_weight_in_a_sweep(engine, tmp_path):
    """A spring without free length balances a weight at every angle if k a b = m g c.

    A spring that is 1 % stiffer leaves 1 % of the weight's moment.
    """
    stiffness = 2 * 9.81 * 0.5 / (0.4 * 0.25)
    for wrong, share in ((1.0, 0.0), (1.01, 0.01)):
        file = tmp_path / "balanced.xml"
        file.write_text(f"""<mujoco><compiler angle="radian"/>
          <option gravity="0 -9.81 0"><flag contact="disable"/></option><worldbody>
          <site name="one" pos="0 0.4 0"/><body><joint name="arm"/>
          <inertial pos="0.5 0 0" mass="2" diaginertia="0.1 0.1 0.1"/>
          <site name="two" pos="0.25 0 0"/></body></worldbody>
          <tendon><spatial name="spring" stiffness="{wrong * stiffness!r}" springlength="0">
          <site site="one"/><site site="two"/></spatial></tendon>
          <actuator><motor name="m" joint="arm"/></actuator>
          <sensor><actuatorfrc name="moment" actuator="m"/></sensor></mujoco>""")
        drive = Drive("arm", lambda t: (t, 1 + 0 * t, 0 * t))
        run = Run("sweep", np.linspace(0, 6, 25), ("moment",), (drive,))
        found = ENGINES[engine].simulate(file, run).channels["moment"]
        assert np.abs(found + share * 9.81 * np.cos(run.x)).max() < 1e-12
