"""Tests of gears, joint equalities of hinges on the ground or of planets, in both engines."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from proofmass.analytic.planar import solve
from proofmass.sim.mujoco.engine import ENGINE as MUJOCO
from proofmass.sim.protocol.failures import Unsupported
from proofmass.sim.protocol.run import Drive, Run
from proofmass.sim.pymunk.engine import ENGINE as PYMUNK
from tests.programs import program_curves
from tests.shipped import shipped

ENGINES = {"mujoco": MUJOCO, "pymunk": PYMUNK}
GEAR_PAIR_FILE = shipped("gear_pair.xml")
PINION_RADIUS, WHEEL_RADIUS, AXLE_DISTANCE = 0.3, 0.5, 0.8  # m
WHEEL_MASS, WHEEL_CENTRE, WHEEL_INERTIA, PINION_INERTIA, G = 5.0, 0.2 + 0.1j, 0.6, 0.09, 9.81
"""Mass [kg], centre of mass [m] and moment of inertia [kg m^2] of the wheel; moment of inertia of
the pinion [kg m^2]; gravity [m/s^2]."""
CHANNELS = ("wheel", "wheel_tooth.x", "wheel_tooth.y", "wheel_rate", "moment")


def closed_form(pinion: np.ndarray) -> dict[str, np.ndarray]:
    """Angle of the wheel, position of its tooth, its rate at 1 rad/s of the pinion, and the
    pinion's holding moment."""
    ratio = -PINION_RADIUS / WHEEL_RADIUS
    wheel = ratio * pinion
    tooth = AXLE_DISTANCE - 0.5 * np.exp(1j * wheel)
    return {
        "wheel": wheel,
        "wheel_tooth.x": tooth.real,
        "wheel_tooth.y": tooth.imag,
        "wheel_rate": np.full_like(pinion, ratio),
        "moment": WHEEL_MASS * G * (WHEEL_CENTRE * np.exp(1j * wheel)).real * ratio,
    }


def turning_drive(joint: str = "pinion") -> Drive:
    return Drive(joint, lambda t: (t, 1 + 0 * t, 0 * t))


@pytest.mark.parametrize("engine", ENGINES)
def test_a_sweep_is_the_closed_form(engine):
    run = Run("sweep", np.linspace(0, 21, 64), CHANNELS, (turning_drive(),))
    found, truth = ENGINES[engine].simulate(GEAR_PAIR_FILE, run).channels, closed_form(run.x)
    for name in CHANNELS:
        assert np.abs(found[name] - truth[name]).max() < 1e-12 * max(1.0, np.ptp(truth[name])), name


@pytest.mark.parametrize("engine", ENGINES)
def test_a_ratio_wrong_in_the_ninth_decimal_differs(engine, tmp_path):
    """Mutation of the test above: the ratio is -0.600000001 instead of -0.6."""
    file = tmp_path / "wrong.xml"
    file.write_text(GEAR_PAIR_FILE.read_text().replace("0 -0.6 0", "0 -0.600000001 0"))
    run = Run("sweep", np.linspace(0, 21, 64), CHANNELS, (turning_drive(),))
    found, truth = ENGINES[engine].simulate(file, run).channels, closed_form(run.x)
    assert np.abs(found["wheel"] - truth["wheel"]).max() > 1e-8


def test_the_planar_reference_equals_the_closed_form():
    model, angle = mujoco.MjModel.from_xml_path(str(GEAR_PAIR_FILE)), np.linspace(0, 21, 64)
    found, truth = solve(angle, model=model, joints=("pinion",)), closed_form(angle)
    for name in CHANNELS:
        assert np.abs(found[name] - truth[name]).max() < 1e-13 * max(1.0, np.ptp(truth[name])), name


def released_wheel(start: float, until: float) -> tuple[np.ndarray, np.ndarray]:
    """Times and wheel angles of a pair that is released, from the inertia of wheel and pinion."""
    inertia = (
        WHEEL_INERTIA
        + WHEEL_MASS * abs(WHEEL_CENTRE) ** 2
        + PINION_INERTIA * (WHEEL_RADIUS / PINION_RADIUS) ** 2
    )

    def slope(_: float, y: np.ndarray) -> list[float]:
        return [y[1], -WHEEL_MASS * G * (WHEEL_CENTRE * np.exp(1j * y[0])).real / inertia]

    t = np.linspace(0, until, 41)
    return t, solve_ivp(slope, (0, until), [start, 0.0], "DOP853", t, rtol=1e-13, atol=1e-13).y[0]


def test_a_released_pair_swings_with_the_inertia_of_both_wheels():
    t, truth = released_wheel(0.0, 2.0)
    found = solve(t, model=mujoco.MjModel.from_xml_path(str(GEAR_PAIR_FILE)))["wheel"]
    assert np.abs(found - truth).max() < 1e-12
    errors = []
    for step in (2e-3, 1e-3):
        settings = {"timestep": step, "iterations": 200, "error_bias": 0.0}
        run = Run("dynamics", t, ("wheel",), settings=settings)
        errors.append(np.abs(PYMUNK.simulate(GEAR_PAIR_FILE, run).channels["wheel"] - truth).max())
    assert errors[1] < 1e-4
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.05)
    run = Run("dynamics", t, ("wheel",), settings={"timestep": 1e-3})
    # 1e-4: softness of MuJoCo's constraints
    assert np.abs(MUJOCO.simulate(GEAR_PAIR_FILE, run).channels["wheel"] - truth).max() < 1e-4


TURNED_PAIR = """<mujoco><compiler angle="radian"/>
  <option gravity="0 -9.81 0" timestep="1e-3"><flag contact="disable"/></option>
  <worldbody><body><joint name="other"/><inertial pos=".1 0 0" mass="1" diaginertia="1 1 1"/></body>
  <body pos="1 0 0" euler="0 0 0.4"><joint name="one" axis="0 0 -1" ref="0.3" stiffness="20"
    springref="0.5"/><inertial pos="0.3 0 0" mass="1" diaginertia="0.1 0.1 0.1"/></body>
  <body pos="2 0 0"><joint name="two" ref="-0.2" damping="0.1"/>
    <inertial pos="0.2 0.1 0" mass="2" diaginertia="0.1 0.1 0.1"/></body></worldbody>
  <equality><joint name="mesh" joint1="one" joint2="two" polycoef="0.05 1.7 0 0 0"/></equality>
  <sensor><jointpos name="one" joint="one"/><jointpos name="two" joint="two"/>
  <jointvel name="rate" joint="two"/></sensor>
  <keyframe><key name="start" qpos="0 {one!r} 0.2"/></keyframe></mujoco>""".replace(
    "{one!r}", repr(0.3 + 0.05 + 1.7 * 0.4)
)


@pytest.mark.parametrize("engine", ENGINES)
def test_a_gear_respects_axes_reference_angles_and_offset(engine, tmp_path):
    """A pair rests between a spring and two weights, while a third hinge is driven.

    Its joints have opposite axes and reference angles that are not zero, and the equality has a
    constant term.
    """
    file = tmp_path / "turned.xml"
    file.write_text(TURNED_PAIR)
    run = Run("sweep", np.linspace(0, 1, 5), ("one", "two"), (turning_drive("other"),))
    found = ENGINES[engine].simulate(file, run).channels

    def slope(two: float) -> float:
        """Derivative of the energy with respect to the second joint's value."""
        one = 0.3 + 0.05 + 1.7 * (two + 0.2)
        first, second = 0.4 - (one - 0.3), two + 0.2
        weights = G * (
            -0.3 * np.cos(first) * 1.7 + 2 * (0.2 * np.cos(second) - 0.1 * np.sin(second))
        )
        return 20 * (one - 0.5) * 1.7 + weights

    two = brentq(slope, -1.5, 0.5, xtol=1e-15)
    assert np.abs(found["two"] - two).max() < 1e-10
    assert np.abs(found["one"] - (0.35 + 1.7 * (two + 0.2))).max() < 1e-12


def test_a_pymunk_program_has_the_gear(tmp_path):
    file = tmp_path / "turned.xml"
    file.write_text(TURNED_PAIR)
    settings = {"timestep": 1e-3, "iterations": 100, "error_bias": 0.0}
    names = ("one", "two", "rate")
    run = Run("dynamics", np.linspace(0, 0.5, 26), names, settings=settings)
    wanted = PYMUNK.simulate(file, run).channels
    truth = solve(run.x, model=mujoco.MjModel.from_xml_path(str(file)))
    found = program_curves(PYMUNK.programs.write_program(file, run, "", ""), tmp_path)
    for name in names:
        assert np.abs(found[name] - wanted[name]).max() < 1e-11 * np.ptp(wanted[name]), name
        assert np.abs(wanted[name] - truth[name]).max() < 1e-3 * np.ptp(truth[name]), name


PAIR_WITH_EQUALITY = """<mujoco><option><flag contact="disable"/></option><worldbody>
  <body><joint name="a" {kind}/><geom size="0.1"/>{inner}</body>
  <body pos="1 0 0"><joint name="b"/><geom size="0.1"/></body></worldbody>
  <equality><joint name="mesh" joint1="{one}" joint2="b" polycoef="{poly}"/></equality></mujoco>"""
BODY_ON_A = '<body pos="1 0 0"><joint name="c"/><geom size="0.1"/></body>'


@pytest.mark.parametrize(
    ("kind", "inner", "one", "poly", "words"),
    [
        ("", "", "a", "0 1 0.1 0 0", "whose polycoef is not linear"),
        ("", "", "a", "0.2 0 0 0 0", "which locks a joint"),
        ('type="slide" axis="1 0 0"', "", "a", "0 1 0 0 0", "whose joints are no such hinges"),
        ("", BODY_ON_A, "c", "0 1 0 0 0", "whose joints are no such hinges"),
    ],
)
def test_pymunk_refuses_joint_equalities_that_are_no_gears(kind, inner, one, poly, words, tmp_path):
    file: Path = tmp_path / "pair.xml"
    file.write_text(PAIR_WITH_EQUALITY.format(kind=kind, inner=inner, one=one, poly=poly))
    with pytest.raises(Unsupported, match=f"joint equality 'mesh', .*{words}"):
        PYMUNK.simulate(file, Run("dynamics", np.linspace(0, 1, 3), ()))


PLANETARY = """<mujoco><option gravity="0 -9.81 0" timestep="{step}" integrator="RK4">
  <flag contact="disable"/></option>
  <default><equality solref="0.002 1" solimp="1 1 0.001"/></default>
  <worldbody><body name="arm"><joint name="arm" axis="0 0 {arm_axis}"/>
    <inertial pos="0.4 0 0" mass="1" diaginertia="0.1 0.1 0.1"/>
    <body name="planet" pos="0.8 0 0"><joint name="planet" axis="0 0 {planet_axis}"/>
      <inertial pos="0.1 0.05 0" mass="2" diaginertia="0.2 0.2 0.2"/>
      <site name="tooth" pos="0.3 0 0"/>
    </body></body></worldbody>
  <equality><joint name="mesh" joint1="{one}" joint2="{two}" polycoef="0 {ratio} 0 0 0"/></equality>
  <actuator><motor name="motor" joint="arm"/></actuator>
  <sensor><jointpos name="planet" joint="planet"/><jointpos name="turn" joint="arm"/>
    <framepos name="tooth" objtype="site" objname="tooth"/>
    <actuatorfrc name="moment" actuator="motor"/></sensor>
  <keyframe><key name="start" qpos="0 0"/></keyframe></mujoco>"""
SETTINGS = {"iterations": 100, "timestep": 1e-3, "error_bias": 0.0}
"""Settings with which a program is written, which states them all."""
SUN_RATIOS = -1.0, 5 / 3, -0.4, 2.0
"""Turn of a planet relative to its arm over that of the arm: with -1 it keeps its direction; round
a fixed sun of 0.5 m with a planet of 0.3 m it is 5/3."""


def write_planetary(folder: Path, ratio: float, inverse: bool = False, **more: object) -> Path:
    """A planet on an arm; with `inverse` the arm's angle is a multiple of the planet's."""
    one, two, given = ("arm", "planet", 1 / ratio) if inverse else ("planet", "arm", ratio)
    numbers = {"step": 1e-3, "arm_axis": 1, "planet_axis": 1, **more}
    file = folder / "planetary.xml"
    file.write_text(PLANETARY.format(one=one, two=two, ratio=repr(given), **numbers))
    return file


def planet_closed_form(arm: np.ndarray, ratio: float) -> dict[str, np.ndarray]:
    """Place of the tooth, and the arm's holding moment: the derivative of the energy of weight."""
    turn = (1 + ratio) * arm
    tooth = 0.8 * np.exp(1j * arm) + 0.3 * np.exp(1j * turn)
    centre = 0.1 + 0.05j  # of the planet
    lift = (2.0 * 0.8 + 1.0 * 0.4) * np.cos(arm)
    lift += 2.0 * (1 + ratio) * (centre * np.exp(1j * turn)).real
    return {
        "planet": ratio * arm,
        "tooth.x": tooth.real,
        "tooth.y": tooth.imag,
        "moment": G * lift,
    }


@pytest.mark.parametrize("inverse", [False, True])
@pytest.mark.parametrize("ratio", SUN_RATIOS)
def test_a_planet_on_its_arm_is_the_closed_form_in_pymunk(ratio, inverse, tmp_path):
    """A ratio that is wrong in the ninth decimal is noticed."""
    file = write_planetary(tmp_path, ratio, inverse)
    names = ("planet", "tooth.x", "tooth.y", "moment")
    run = Run("sweep", np.linspace(0, 7, 36), names, (turning_drive("arm"),))
    found, truth = PYMUNK.simulate(file, run).channels, planet_closed_form(run.x, ratio)
    for name in names:
        assert np.abs(found[name] - truth[name]).max() < 1e-10 * np.ptp(truth[name]), name
    wrong = planet_closed_form(run.x, ratio + 1e-9)
    assert np.abs(found["planet"] - wrong["planet"]).max() > 1e-9


def released_planet(ratio: float, until: float) -> float:
    """The angle of a released arm at a time, from its energy: one equation of motion."""
    centre, turn = 0.1 + 0.05j, 1 + ratio

    def inertia(arm: float) -> tuple[float, float]:
        """The inertia of the arm's angle, and its derivative."""
        speed = 0.8j * np.exp(1j * arm) + 1j * turn * centre * np.exp(1j * turn * arm)
        change = -0.8 * np.exp(1j * arm) - turn**2 * centre * np.exp(1j * turn * arm)
        own = 0.1 + 1.0 * 0.4**2 + 0.2 * turn**2
        return own + 2.0 * abs(speed) ** 2, 4.0 * (speed.conjugate() * change).real

    def slope(_: float, y: np.ndarray) -> list[float]:
        moment = planet_closed_form(np.array([y[0]]), ratio)["moment"][0]
        whole, change = inertia(y[0])
        return [y[1], (-moment - 0.5 * change * y[1] ** 2) / whole]

    found = solve_ivp(slope, (0, until), [0.0, 0.0], rtol=1e-11, atol=1e-12)
    return float(found.y[0, -1])


@pytest.mark.parametrize("ratio", [-1.0, 5 / 3])
def test_a_released_planet_moves_as_its_equation_of_motion(ratio, tmp_path):
    """The error falls with the square of pymunk's step; MuJoCo's model has the same motion."""
    truth, errors = released_planet(ratio, 0.5), []
    for step in (2e-3, 1e-3):
        file = write_planetary(tmp_path, ratio, step=step)
        run = Run("dynamics", np.array([0.0, 0.5]), ("turn",))
        errors.append(abs(PYMUNK.simulate(file, run).channels["turn"][-1] - truth))
    assert errors[1] < 2e-5
    assert errors[0] > 3.0 * errors[1]
    assert abs(MUJOCO.simulate(file, run).channels["turn"][-1] - truth) < 1e-4


def test_axes_in_opposite_directions_turn_the_sign(tmp_path):
    """A planet whose axis points down turns the other way; the closed form says by how much."""
    file = write_planetary(tmp_path, 5 / 3, planet_axis=-1)
    run = Run("sweep", np.linspace(0, 7, 36), ("tooth.x",), (turning_drive("arm"),))
    truth = planet_closed_form(run.x, -5 / 3)["tooth.x"]
    assert np.abs(PYMUNK.simulate(file, run).channels["tooth.x"] - truth).max() < 1e-10


@pytest.mark.parametrize("ratio", [-1.0, 5 / 3])
def test_a_program_has_the_planet(ratio, tmp_path):
    """The program that ``choose`` writes makes the same gear."""
    file = write_planetary(tmp_path, ratio)
    run = Run("dynamics", np.linspace(0, 0.5, 6), ("turn", "planet"), settings=SETTINGS)
    wanted = PYMUNK.simulate(file, run).channels
    found = program_curves(PYMUNK.programs.write_program(file, run, "", ""), tmp_path)
    for name in run.channels:
        assert np.abs(found[name] - wanted[name]).max() < 1e-11 * np.ptp(wanted[name]), name
