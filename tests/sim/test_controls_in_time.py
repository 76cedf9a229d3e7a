"""Tests of controls that change in time: both engines, their programs, sidecars, bad input."""

import re
from dataclasses import dataclass, replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from proofmass.analytic import planar, spatial
from proofmass.base.errors import InputError
from proofmass.batch.check import check
from proofmass.case.case import ProfileTable
from proofmass.case.drive import InProportion, Steady, Swing, motion_source
from proofmass.case.profile import controls_source, make_sampled_profile
from proofmass.reference.evaluate import evaluate
from proofmass.reference.profiles import load_profiles
from proofmass.reference.samples import run_samples
from proofmass.report import write_report
from proofmass.run.sidecar import format_sidecar, load_case
from proofmass.run.solve import plan_run, prescribed_run
from proofmass.sim.mujoco import dynamics as mujoco_dynamics
from proofmass.sim.mujoco.engine import ENGINE as MUJOCO
from proofmass.sim.mujoco.engine import simulate as in_mujoco
from proofmass.sim.protocol.failures import Unsupported
from proofmass.sim.protocol.run import ChangingLoad, Drive, Run
from proofmass.sim.pymunk.engine import ENGINE as PYMUNK
from proofmass.sim.pymunk.engine import simulate as in_pymunk
from proofmass.sim.smooth import SmoothTerms
from tests.programs import program_curves
from tests.report.whole import without_figures
from tests.shipped import shipped
from tests.verdicts import all_comparisons

CONTROLLED_AXES = shipped("axes_controlled.toml")
POLYLINE_TIMES, POLYLINE_FORCES = (0.0, 0.4, 0.6, 1.0), (1.0, 3.0, 3.0, -2.0)
"""Times [s] and forces [N] of a polyline whose last force is not its first."""
SAMPLE_TIMES = np.linspace(0.0, 1.0, 6)


@dataclass(frozen=True)
class Rows:
    """A control that is interpolated linearly between its rows."""

    times: tuple[float, ...]
    values: tuple[float, ...]

    def __call__(self, t):
        value = np.interp(t, self.times, self.values)
        return value, np.zeros_like(value), np.zeros_like(value)


def write_pushed_mass(folder: Path, actuator: str, joint: str = "", key: str = "") -> Path:
    """Write a model: a mass of 2 kg on a slide, with a motor of 2 N per unit of its control."""
    file = folder / "slide.xml"
    file.write_text(f"""<mujoco><compiler angle="radian"/><option gravity="0 0 0" timestep="1e-3">
      <flag contact="disable"/></option><worldbody><site name="ground"/>
      <body name="slide"><joint name="x" type="slide" axis="1 0 0" {joint}/>
        <geom type="box" size="0.1 0.05 0.05" mass="2"/><site name="middle"/></body>
      <body pos="0 0 1"><joint name="h" axis="0 -1 0"/><geom size="0.1" mass="1"/></body>
      </worldbody>
      <actuator>{actuator}</actuator>
      <sensor><jointpos name="x" joint="x"/><jointvel name="rate" joint="x"/>
      <actuatorfrc name="push" actuator="push"/>
      <jointactuatorfrc name="on_x" joint="x"/></sensor>
      <keyframe><key name="start" qpos="0.1 0" qvel="0.3 0" {key}/></keyframe></mujoco>""")
    return file


ON_JOINT = '<motor name="push" joint="x" gear="2"/>'
ON_SITE = '<motor name="push" site="middle" refsite="ground" gear="2 0 0 0 0 0"/>'
EITHER_ACTUATOR = pytest.mark.parametrize("actuator", [ON_JOINT, ON_SITE], ids=["joint", "site"])


def exact_motion(t: np.ndarray, times=POLYLINE_TIMES) -> tuple[np.ndarray, np.ndarray]:
    """Position and speed of the mass of `write_pushed_mass`: exact integrals of the polyline."""
    place, speed = [], []
    for one in t:
        x, v = 0.1, 0.3
        for a, b, f, g in zip(
            times[:-1], times[1:], POLYLINE_FORCES[:-1], POLYLINE_FORCES[1:], strict=True
        ):
            # times 2 N over 2 kg; no part of a piece that begins later
            h, slope = max(min(one, b) - a, 0.0), (g - f) / (b - a)
            x += h * v + f * h**2 / 2 + slope * h**3 / 6
            v += f * h + slope * h**2 / 2
        place.append(x)
        speed.append(v)
    return np.array(place), np.array(speed)


def polyline_profile(folder: Path):
    """The sampled profile of the polyline, read from a table."""
    table = ProfileTable(time=POLYLINE_TIMES, value=POLYLINE_FORCES, interpolation="linear")
    return make_sampled_profile(folder, table, 0.0, "1")


def polyline_run(step: float, times=POLYLINE_TIMES, **settings) -> Run:
    """A run of 1 s with the polyline as the control of the motor `push`."""
    loads = (ChangingLoad("push", Rows(times, POLYLINE_FORCES)),)
    return Run(
        "dynamics",
        SAMPLE_TIMES,
        ("x", "rate", "push", "on_x"),
        settings={"timestep": step, **settings},
        loads=loads,
    )


@EITHER_ACTUATOR
def test_mujoco_takes_a_control_to_the_second_order(actuator, tmp_path):
    """MuJoCo keeps a control constant in each step, at its value in the middle of the step.

    With RK4 the speed is exact at the ends of steps.  In a step the speed is a straight line
    instead of a parabola, which moves the position by h^3/12 times the slope of the force.  The
    error of the position is therefore h^2/12 times the change of the force since the start.
    """
    file, (place, speed) = write_pushed_mass(tmp_path, actuator), exact_motion(SAMPLE_TIMES)
    for step in (2e-2, 1e-2):
        found = in_mujoco(file, polyline_run(step, integrator="RK4")).channels
        rose = np.interp(SAMPLE_TIMES, POLYLINE_TIMES, POLYLINE_FORCES) - POLYLINE_FORCES[0]
        assert np.abs(found["x"] - place - step**2 / 12 * rose).max() < 1e-13
        assert np.abs(found["rate"] - speed).max() < 1e-13
        assert (
            np.abs(found["push"] - np.interp(SAMPLE_TIMES, POLYLINE_TIMES, POLYLINE_FORCES)).max()
            < 1e-13
        )


@pytest.mark.parametrize(
    ("simulate", "settings", "share"),
    [(in_mujoco, {"integrator": "RK4"}, -1 / 18), (in_pymunk, {}, 1 / 9)],
    ids=["mujoco", "pymunk"],
)
def test_kinks_inside_steps_keep_the_second_order(simulate, settings, share, tmp_path):
    """The control has kinks after a third or two thirds of a step, for all steps of the test.

    A kink changes the slope of the force by D, at the share s of a step.  In MuJoCo the impulse of
    this step is that of the control in its middle, which is off by D h^2 (1/2 - s - (1 - s)^2/2)
    or, for s > 1/2, by -D h^2 (1 - s)^2/2.  In pymunk the impulse is that of the trapezoidal rule,
    which is off by D h^2 s (1 - s)/2.  For both places this is -D h^2/18 and D h^2/9.
    """
    file, kinks = write_pushed_mass(tmp_path, ON_JOINT), (1 / 3, 2 / 3)
    times = (0.0, *kinks, 1.0)
    place, speed = exact_motion(SAMPLE_TIMES, times)
    slopes = np.diff(POLYLINE_FORCES) / np.diff(times)
    passed = np.diff(slopes) @ (np.array(kinks)[:, None] < SAMPLE_TIMES)  # times 2 N over 2 kg
    errors = []
    for count in (7, 14, 28, 56):  # steps between two samples
        step = 0.2 / count
        parts = np.array(kinks) / step % 1.0
        assert (np.abs(np.abs(parts - 0.5) - 1 / 6) < 1e-9).all()
        found = simulate(file, polyline_run(step, times, **settings)).channels
        # rounding
        assert np.abs(found["rate"] - speed - share * step**2 * passed).max() < 1e-12
        errors.append(np.abs(found["x"] - place).max())
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(orders, 2.0, atol=0.05)  # terms in h^3


def test_steps_of_first_order_stay_of_first_order(tmp_path):
    file, place = write_pushed_mass(tmp_path, ON_JOINT), exact_motion(SAMPLE_TIMES)[0]
    for integrator in ("Euler", "implicitfast"):
        errors = [
            np.abs(
                in_mujoco(file, polyline_run(h, integrator=integrator)).channels["x"] - place
            ).max()
            for h in (2e-2, 1e-2)
        ]
        assert errors[0] / errors[1] == pytest.approx(2.0, abs=0.1)


def test_controls_of_the_beginning_of_a_step_would_be_of_first_order(tmp_path, monkeypatch):
    """Mutation: a step has the control of its beginning instead of that of its middle."""
    file, place = write_pushed_mass(tmp_path, ON_JOINT), exact_motion(SAMPLE_TIMES)[0]
    original = mujoco_dynamics.HeldControls.of

    def controls_of_the_beginning(model, run, times, count):
        half = 0.5 * (times[1] - times[0])
        return original(model, run, np.append(times[:-1] - half, times[-1] - half), count)

    monkeypatch.setattr(mujoco_dynamics.HeldControls, "of", controls_of_the_beginning)
    errors = [
        np.abs(in_mujoco(file, polyline_run(h, integrator="RK4")).channels["x"] - place).max()
        for h in (2e-2, 1e-2)
    ]
    assert errors[0] / errors[1] == pytest.approx(2.0, abs=0.2)


@EITHER_ACTUATOR
def test_pymunk_takes_a_control_to_the_second_order(actuator, tmp_path):
    file, (place, speed) = write_pushed_mass(tmp_path, actuator), exact_motion(SAMPLE_TIMES)
    errors = []
    for step in (2e-2, 1e-2):
        found = in_pymunk(file, polyline_run(step)).channels
        errors.append(np.abs(found["x"] - place).max())
        # the speed at a sample is the mean of those half a step before and behind it
        assert np.abs(found["rate"] - speed).max() < 1e-12
        assert (
            np.abs(found["push"] - np.interp(SAMPLE_TIMES, POLYLINE_TIMES, POLYLINE_FORCES)).max()
            < 1e-13
        )
    assert errors[1] < 3e-4
    assert errors[0] / errors[1] == pytest.approx(4.0, abs=0.1)


@EITHER_ACTUATOR
@pytest.mark.parametrize("engine", ["mujoco", "pymunk"])
def test_programs_have_the_changing_controls(engine, actuator, tmp_path):
    file, simulate, writer = write_pushed_mass(tmp_path, actuator), in_mujoco, MUJOCO.programs
    engine_run = polyline_run(1e-2, integrator="RK4")
    if engine == "pymunk":
        simulate, writer, engine_run = in_pymunk, PYMUNK.programs, polyline_run(1e-2)
    wanted = simulate(file, engine_run)
    sampled = polyline_profile(tmp_path)
    assert sampled(np.array([0.2, 0.8]))[0] == pytest.approx([2.0, 0.5], abs=1e-14)
    text = writer.write_program(
        file,
        replace(engine_run, settings=wanted.settings),
        "",
        "",
        controls=controls_source([sampled], engine_run.x),
    )
    assert "np.interp(t, [" in text
    found = program_curves(text, tmp_path)
    for name, curve in wanted.channels.items():
        assert np.abs(found[name] - curve).max() < 1e-12, name


def test_a_pymunk_program_computes_the_holding_moment_under_changing_loads(tmp_path):
    """A program of pymunk computes the holding moment of a four-bar with two changing loads.

    The loads are a moment on the rocker and a force on the coupler.
    """
    text = shipped("fourbar.xml").read_text(encoding="utf-8")
    text = text.replace(
        "</actuator>",
        '<motor name="load" joint="rocker"/>'
        '<motor name="wind" site="point" refsite="crank_origin" gear="1 0.5 0 0 0 0"/></actuator>',
    ).replace("<worldbody>", '<worldbody><site name="crank_origin"/>')
    file = tmp_path / "fourbar.xml"
    file.write_text(text, encoding="utf-8")
    swing, t = Swing(0.0, 2.0, 2.0), np.linspace(0.0, 1.0, 21)
    profiles = Rows(POLYLINE_TIMES, POLYLINE_FORCES), InProportion(swing, 0.0, 3.0, -1.0)
    loads = ChangingLoad("load", profiles[0]), ChangingLoad("wind", profiles[1])
    names = ("rocker", "holding_moment")
    engine_run = Run("dynamics", t, names, (Drive("crank", swing),), loads=loads)
    wanted = in_pymunk(file, replace(engine_run, settings={"timestep": 1e-3}))
    sampled = make_sampled_profile(
        tmp_path,
        ProfileTable(time=POLYLINE_TIMES, value=POLYLINE_FORCES, interpolation="linear"),
        0.0,
        "1",
    )
    source = controls_source([sampled, profiles[1]], t)
    program = PYMUNK.programs.write_program(
        file,
        replace(engine_run, settings=wanted.settings),
        motion_source([swing], t),
        "",
        controls=source,
    )
    found = program_curves(program, tmp_path)
    in_other_engine = in_mujoco(
        file, replace(engine_run, settings={"timestep": 1e-3, "integrator": "RK4"})
    )
    unloaded = in_pymunk(file, replace(engine_run, loads=(), settings={"timestep": 1e-3}))
    for name in names:
        assert np.abs(found[name] - wanted.channels[name]).max() < 1e-9, name
        tolerance = 2e-3 * np.ptp(wanted.channels[name])
        assert np.abs(in_other_engine.channels[name] - wanted.channels[name]).max() < tolerance, (
            name
        )
    moments = wanted.channels["holding_moment"], unloaded.channels["holding_moment"]
    assert np.abs(moments[0] - moments[1]).max() > 1.0


PIECEWISE_CONSTANT_TABLE = ProfileTable(
    time=POLYLINE_TIMES, value=POLYLINE_FORCES, interpolation="held"
)


def exact_motion_under_constant_forces(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Position and speed under forces that are constant from row to row: exact integrals."""
    place, speed = [], []
    for one in t:
        x, v = 0.1, 0.3
        for a, b, force in zip(
            POLYLINE_TIMES, [*POLYLINE_TIMES[1:], np.inf], POLYLINE_FORCES, strict=True
        ):
            h = max(min(one, b) - a, 0.0)
            x, v = x + h * v + force * h**2 / 2, v + force * h
        place.append(x)
        speed.append(v)
    return np.array(place), np.array(speed)


def piecewise_constant_run(step: float, **settings) -> Run:
    """A run of 1.2 s with a piecewise constant control, beyond its last row at 1 s.

    The last row is valid for as long as the one before it.
    """
    profile, t = (
        make_sampled_profile(Path(), PIECEWISE_CONSTANT_TABLE, 0.0, "1"),
        np.linspace(0.0, 1.2, 7),
    )
    assert profile.covers(t)
    assert not profile.covers(np.array([0.0, 1.5]))
    loads = (ChangingLoad("push", profile),)
    names, settings = ("x", "rate", "push"), {"timestep": step, **settings}
    return Run("dynamics", t, names, settings=settings, loads=loads)


@EITHER_ACTUATOR
def test_a_control_is_constant_from_row_to_row(actuator, tmp_path):
    """A control with ``interpolation = "held"`` is piecewise constant in both engines.

    MuJoCo's RK4 is exact since steps end at the rows.  In pymunk each jump acts half a step early,
    which is an error of first order.
    """
    file, engine_run = (
        write_pushed_mass(tmp_path, actuator),
        piecewise_constant_run(2e-2, integrator="RK4"),
    )
    place, speed = exact_motion_under_constant_forces(engine_run.x)
    found = in_mujoco(file, engine_run).channels
    assert np.abs(found["x"] - place).max() < 1e-13
    assert np.abs(found["rate"] - speed).max() < 1e-13
    assert (found["push"] == engine_run.loads[0].profile(engine_run.x)[0]).all()
    assert set(found["push"]) == set(POLYLINE_FORCES)
    errors = [
        np.abs(in_pymunk(file, piecewise_constant_run(h)).channels["x"] - place).max()
        for h in (2e-2, 1e-2)
    ]
    assert errors[0] < 5e-2
    assert errors[0] / errors[1] == pytest.approx(2.0, abs=0.2)


@EITHER_ACTUATOR
def test_references_are_exact_across_jumps_of_a_control(actuator, tmp_path):
    model = mujoco.MjModel.from_xml_path(str(write_pushed_mass(tmp_path, actuator)))
    profile, t = (
        make_sampled_profile(Path(), PIECEWISE_CONSTANT_TABLE, 0.0, "1"),
        np.linspace(0.0, 1.2, 25),
    )
    place, speed = exact_motion_under_constant_forces(t)
    for found in (
        planar.solve(t, model=model, control_profiles={"push": profile}),
        spatial.solve(t, model=model, control_profiles={"push": profile}, terms=SmoothTerms(model)),
    ):
        assert np.abs(found["x"] - place).max() < 1e-13
        assert np.abs(found["rate"] - speed).max() < 1e-13


@pytest.mark.parametrize("engine", ["mujoco", "pymunk"])
def test_programs_have_piecewise_constant_controls(engine, tmp_path):
    file, simulate, writer = write_pushed_mass(tmp_path, ON_JOINT), in_mujoco, MUJOCO.programs
    engine_run = piecewise_constant_run(1e-2, integrator="RK4")
    if engine == "pymunk":
        simulate, writer, engine_run = in_pymunk, PYMUNK.programs, piecewise_constant_run(1e-2)
    wanted = simulate(file, engine_run)
    source = controls_source(
        [make_sampled_profile(Path(), PIECEWISE_CONSTANT_TABLE, 0.0, "1")], engine_run.x
    )
    same = replace(engine_run, settings=wanted.settings)
    found = program_curves(writer.write_program(file, same, "", "", controls=source), tmp_path)
    for name, curve in wanted.channels.items():
        assert np.abs(found[name] - curve).max() < 1e-12, name


def test_profiles_of_controls_are_written_exactly(tmp_path):
    table = ProfileTable(time=(0.0, 0.5, 1.0, 1.5, 2.0), value=(0.1, 0.15, 0.35, 0.5, 0.5))
    spline = make_sampled_profile(tmp_path, table, 0.0, "1")
    swing = InProportion(Swing(0.0, 2.0, 2.0), 0.0, 0.5, 1.0)
    t, names = np.linspace(0.0, 2.0, 401), {"np": np}
    exec(controls_source([spline, swing, Wave()], t[::20]), names)
    found = names["controls"](t)
    assert np.abs(found[0] - spline(t)[0]).max() < 1e-15
    assert np.abs(found[1] - swing(t)[0]).max() < 1e-15
    assert np.abs(found[2] - np.sin(3.0 * t)).max() < 1e-11  # written as a table


class Wave:
    """A profile that cannot be written as a formula."""

    def __call__(self, t):
        return np.sin(3.0 * t), 3.0 * np.cos(3.0 * t), -9.0 * np.sin(3.0 * t)


def test_the_shipped_case_agrees_in_both_engines():
    assert {c.outcome.value for c in all_comparisons(CONTROLLED_AXES) if c.allowed > 0} == {
        "agrees"
    }


def test_engines_that_ignore_changing_controls_are_wrong():
    """Mutation: engines run without the changing loads."""
    case = load_case(CONTROLLED_AXES)
    changing_run = prescribed_run(case, "dynamics")
    wanted = evaluate(case, "dynamics", changing_run.x, None).channels
    for simulate in (in_mujoco, in_pymunk):
        found = simulate(case.model_path, replace(changing_run, loads=())).channels
        for name in ("slide", "wheel", "lift"):
            assert np.abs(found[name] - wanted[name]).max() > 0.05 * np.ptp(wanted[name])


def test_a_sidecar_with_changing_loads_is_written_and_read_again(tmp_path):
    case = load_case(CONTROLLED_AXES)
    (tmp_path / "again.toml").write_text(format_sidecar(case))
    for name in (case.model, "axes_controlled.csv"):
        (tmp_path / name).write_bytes((CONTROLLED_AXES.parent / name).read_bytes())
    again = load_case(tmp_path / "again.toml")
    assert again.load == case.load
    for one, two in zip(
        load_profiles(case, "dynamics"), load_profiles(again, "dynamics"), strict=True
    ):
        assert np.array_equal(
            one(run_samples(case, "dynamics"))[0], two(run_samples(case, "dynamics"))[0]
        )


def test_a_load_that_follows_a_drive_agrees_in_dynamics(tmp_path):
    """A four-bar whose load grows with its drive agrees in dynamics, in both engines.

    The references are the closed form, whose parameter the control multiplies, and the general
    solvers of the plane and of space.
    """
    mjcf = shipped("fourbar.xml").read_text()
    mjcf = mjcf.replace("</actuator>", '<motor name="load" joint="rocker"/></actuator>')
    (tmp_path / "case.xml").write_text(mjcf)
    parameters = """
[parameters]
crank = 1.0
coupler = 2.0
rocker = 2.5
ground = 3.0
crank_mass = 1.0
coupler_mass = 2.0
rocker_mass = 2.5
gravity = 9.81
rocker_load = 1.0
"""
    for reference, scales in (
        ("fourbar", 'scales = "rocker_load"'),
        ("planar", ""),
        ("spatial", ""),
    ):
        (tmp_path / "case.toml").write_text(
            f"""
title = "Four-bar whose rocker carries a moment that grows"
source = "a test"
reference = "{reference}"
{parameters if scales else ""}
[drive]
joint = "crank"
from = 0.0
to = 6.283185307179586
rate = 3.0

[load]
actuator = "load"
from = -20.0
to = 60.0
{scales}

[run.dynamics]
n = 61
solvers = ["mujoco", "pymunk"]

[channels]
rocker = {{ equals = "rocker", unit = "rad" }}
holding_moment = {{ equals = "holding_moment", unit = "N m" }}
""".replace('equals = "rocker"', f'equals = "{"rocker_angle" if scales else "rocker"}"')
        )
        found = all_comparisons(tmp_path / "case.toml")
        assert {c.outcome.value for c in found} == {"agrees"}, reference
        assert {c.channel for c in found} == {"rocker", "holding_moment"}


def test_the_page_of_a_case_describes_its_controls(changed, tmp_path):
    """The page describes each changing control; the case runs for 0.5 s in MuJoCo."""
    changed(".toml", r"until = 2\.0", "until = 0.5")
    changed(".toml", "n = 201", "n = 51")
    file = changed(".toml", r"solvers = \[.*\]", 'solvers = ["mujoco"]')
    changed(".toml", r'(?s)\[\[tolerance\]\]\nsolver = "pymunk".*', "")
    result = check([file], detectable=False)
    assert result.exit_code == 0
    with without_figures():
        write_report(result, tmp_path)
    page = "".join(file.read_text(encoding="utf-8") for file in tmp_path.glob("axes*.html"))
    for words in (
        "value force of axes_controlled.csv",
        "value in a table of 4 rows",
        "value in a table of 5 rows, a cubic spline",
    ):
        assert words in page


BAD_LOADS = {
    "falls": ("0.3, 1.2, 2.0", "0.3, 0.2, 2.0", ["load.1.profile", "time does not rise (0.3 then"]),
    "nan": ("0.6, 0.6", "nan, 0.6", ["load.1.profile.value.1", "finite number"]),
    "lengths": ("0.3, 1.2, 2.0", "0.3, 2.0", ["load.1.profile", "3 numbers, and value has 4"]),
    "short": ("1.2, 2.0]", "1.2, 1.9]", ["load.1.profile", "from 0 to 1.9 s, the run from 0 to 2"]),
    "no actuator": ('"wind"', '"widn"', ["load.1.actuator", "did you mean 'wind'?"]),
    "no file": ('file = "axes_controlled.csv", ', "", ["load.0.profile", "file is missing"]),
    "both": (
        r"\{ time = \[0.0, 0.3",
        '{ file = "a.csv", time = [0.0, 0.3',
        ["load.1.profile", "time is a list, which goes without a file"],
    ),
    "no times": (r"time = \[0.0, 0.3, 1.2, 2.0\], ", "", ["load.1.profile", "time is missing"]),
    "one row": (
        r"time = \[0.0, 0.3, 1.2, 2.0\], value = \[0.0, 0.6, 0.6, -0.2\]",
        "time = [0.0], value = [0.0]",
        ["load.1.profile.time", "at least 2 items"],
    ),
    "few": (
        r'1.2, 2.0\], value = \[0.0, 0.6, 0.6, -0.2\], interpolation = "linear"',
        "2.0], value = [0.0, 0.6, 0.6]",
        ["load.1.profile", "3 rows; a spline needs 4"],
    ),
    "no drive": (
        "profile = { time = .* }",
        "to = 2.0",
        ["load.1.to", "follow the first drive, and there is none"],
    ),
    "word": ('"linear" }', '"liner" }', ["interpolation", "'spline', 'linear' or 'held'"]),
    "column": ('value = "force"', 'value = "farce"', ["load.0.profile", "farce"]),
    "rate": ('value = "force"', 'rate = "force"', ["load.0", "no rate"]),
}


@pytest.fixture
def changed(tmp_path: Path):
    """``changed(ending, old, new)`` replaces a regular expression in a file of a copy of the case.

    It returns the path of the sidecar.
    """
    for ending in (".toml", ".xml", ".csv"):
        (tmp_path / f"axes_controlled{ending}").write_bytes(
            CONTROLLED_AXES.with_suffix(ending).read_bytes()
        )

    def change(ending: str, old: str, new: str) -> Path:
        file = tmp_path / f"axes_controlled{ending}"
        text, hits = re.subn(old, new, file.read_text(encoding="utf-8"), count=1)
        assert hits
        file.write_text(text, encoding="utf-8")
        return file.with_suffix(".toml")

    return change


@pytest.mark.parametrize(("old", "new", "words"), BAD_LOADS.values(), ids=BAD_LOADS)
def test_bad_loads_are_refused_with_their_key(old, new, words, changed):
    result = check([changed(".toml", old, new)])
    assert result.exit_code == 2
    for word in words:
        assert word in str(result.errors[0])


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('joint="wheel"/>', 'joint="wheel" ctrlrange="-1 0.5"/>', ["within -1 to 0.5", "load.1"]),
        (
            '<motor name="wind" joint="wheel"/>',
            '<general name="wind" joint="wheel" dyntype="filter" dynprm="1"/>',
            ["load.1.actuator", "no motor and no servo"],
        ),
        (
            '<motor name="wind" joint="wheel"/>',
            '<motor name="wind" joint="wheel" group="3"/>',
            ["load.1.actuator", "is disabled in the model"],
        ),
    ],
)
def test_actuators_whose_control_may_not_change_are_refused(old, new, words, changed):
    file = changed(".xml", re.escape(old), new)
    if "group" in new:
        changed(".xml", "<option ", '<option actuatorgroupdisable="3" ')
    result = check([file])
    assert result.exit_code == 2
    for word in words:
        assert word in str(result.errors[0])


def test_loads_on_driven_joints_and_in_equilibria_are_refused(changed):
    drive = '[drive]\njoint = "wheel"\nfrom = 0.3\nto = 0.5\nrate = 0.1\n\n[run.dynamics]'
    changed(".toml", r"\[run.dynamics\]", drive)
    file = changed(".toml", r"until = 2.0.*", "")
    [error] = check([file]).errors
    assert "'wind' acts on joint 'wheel', which is driven" in str(error)
    changed(".toml", r"\[run.dynamics\]", "[run.equilibrium]")
    [error] = check([file]).errors
    assert "nothing changes in an equilibrium" in str(error)


def test_engines_and_references_refuse_loads_that_they_do_not_cover(changed, tmp_path):
    [error] = check([changed(".toml", '"planar"', '"pendulum"')]).errors
    assert "'pendulum' covers no load that changes" in str(error)
    file = write_pushed_mass(
        tmp_path,
        '<motor name="push" joint="x" gear="2"/><motor name="pull" joint="x"/>',
        'actuatorfrcrange="-9 9"',
    )
    both = polyline_run(1e-2)
    both = replace(both, loads=(*both.loads, replace(both.loads[0], actuator="pull")))
    with pytest.raises(Unsupported, match="range of actuator forces of joint 'x', on which actua"):
        in_pymunk(file, both)


FORCE_RANGES = {
    "its own": ('<motor name="push" joint="x" gear="2" forcerange="-1 2"/>', "", (-1.0, 2.0)),
    "of its joint": (
        '<motor name="push" joint="x" gear="2"/>',
        'actuatorfrcrange="-2 4"',
        (-9.0, 9.0),
    ),
    "of both": (
        '<motor name="push" joint="x" gear="-2" forcerange="-1.5 2"/>',
        'actuatorfrcrange="-4 2"',
        (-1.5, 2.0),
    ),
}


@pytest.mark.parametrize(("actuator", "joint", "own"), FORCE_RANGES.values(), ids=FORCE_RANGES)
def test_a_force_range_clips_the_force_of_a_changing_control(actuator, joint, own, tmp_path):
    """A motor's force is clipped to -1 N to 2 N, in both engines and in the planar reference.

    The speed is that of the clipped polyline, whose kinks are at ends of steps.  The sensor of the
    motor shows the force after the motor's own range and before that of the joint.
    """
    file, direction = (
        write_pushed_mass(tmp_path, actuator, joint),
        -1.0 if 'gear="-2"' in actuator else 1.0,
    )
    fine = np.linspace(0.0, 1.0, 100001)
    force = np.clip(np.interp(fine, POLYLINE_TIMES, POLYLINE_FORCES), -1.0, 2.0)
    speed = 0.3 + direction * np.append(0.0, np.cumsum(0.5 * (force[1:] + force[:-1])) * 1e-5)
    found = {
        "mujoco": in_mujoco(file, polyline_run(1e-3, integrator="RK4")).channels,
        "pymunk": in_pymunk(file, polyline_run(1e-3)).channels,
    }
    model = mujoco.MjModel.from_xml_path(str(file))
    found["planar"] = planar.solve(
        SAMPLE_TIMES, model=model, control_profiles={"push": Rows(POLYLINE_TIMES, POLYLINE_FORCES)}
    )
    for solver, curves in found.items():
        assert np.abs(curves["rate"] - speed[::20000]).max() < 2e-6, solver
        shown = np.clip(np.interp(SAMPLE_TIMES, POLYLINE_TIMES, POLYLINE_FORCES), *own)
        assert curves["push"] == pytest.approx(shown, abs=1e-9), solver
        assert curves["on_x"] == pytest.approx(2.0 * direction * force[::20000], abs=1e-9), solver


def test_a_joints_force_range_limits_the_sum_of_its_motors(tmp_path):
    """A joint with a range of 3 N has a motor of constant 1.5 N in addition to the changing one.

    The range limits the sum of both, so that the changing motor may push with 1.5 N, which is a
    force of 0.75 N times its gear of 2.  A range of 3.1 N gives another motion.
    """

    def ranged(most: float) -> Path:
        both = ON_JOINT + '<motor name="steady" joint="x" gear="1.5"/>'
        return write_pushed_mass(tmp_path, both, f'actuatorfrcrange="-{most} {most}"', 'ctrl="0 1"')

    wanted = in_mujoco(ranged(3.0), polyline_run(1e-3, integrator="RK4")).channels
    assert np.ptp(wanted["rate"]) > 0.1
    found = in_pymunk(ranged(3.0), polyline_run(1e-3)).channels
    assert np.abs(found["rate"] - wanted["rate"]).max() < 2e-6
    found = in_pymunk(ranged(3.1), polyline_run(1e-3)).channels
    assert np.abs(found["rate"] - wanted["rate"]).max() > 1e-3


def test_a_pymunk_program_has_the_force_ranges(tmp_path):
    file, engine_run = write_pushed_mass(tmp_path, *FORCE_RANGES["of both"][:2]), polyline_run(1e-2)
    wanted = in_pymunk(file, engine_run)
    engine_run = replace(engine_run, settings=wanted.settings)
    source = controls_source([polyline_profile(tmp_path)], SAMPLE_TIMES)
    with pytest.raises(Unsupported, match="sensor 'push', which shows a force beyond the"):
        PYMUNK.programs.write_program(file, engine_run, "", "", controls=source)
    engine_run = replace(engine_run, channels=("x", "rate", "on_x"))
    text = PYMUNK.programs.write_program(file, engine_run, "", "", controls=source)
    assert "np.clip(controls(t)" in text
    found = program_curves(text, tmp_path)
    for name in engine_run.channels:
        assert np.abs(found[name] - wanted.channels[name]).max() < 1e-12, name


@pytest.mark.parametrize(("gain", "ends"), [(0.7, "-0.36 1.5"), (-3.0, "-3.6 0.9")])
def test_a_pymunk_program_clips_the_sensor_of_a_motor_to_its_own_range(gain, ends, tmp_path):
    """This is exact also where the range, divided by the gain and multiplied again, is rounded."""
    actuator = f'<general name="push" joint="x" gear="2" gainprm="{gain}" forcerange="{ends}"/>'
    file, engine_run = write_pushed_mass(tmp_path, actuator), polyline_run(1e-2)
    wanted = in_pymunk(file, engine_run)
    force = gain * np.interp(SAMPLE_TIMES, POLYLINE_TIMES, POLYLINE_FORCES)
    shown = np.clip(force, *map(float, ends.split()))
    assert np.abs(shown - force).max() > 0.5
    assert wanted.channels["push"] == pytest.approx(shown, abs=1e-12)
    engine_run = replace(engine_run, settings=wanted.settings)
    text = PYMUNK.programs.write_program(
        file,
        engine_run,
        "",
        "",
        controls=controls_source([polyline_profile(tmp_path)], SAMPLE_TIMES),
    )
    found = program_curves(text, tmp_path)
    for name in engine_run.channels:
        assert np.abs(found[name] - wanted.channels[name]).max() < 1e-12, name


def test_a_steady_profile_is_written_as_a_formula():
    assert "0.5 + 2.0 * t" in controls_source([Steady(0.5, 2.0, x_is_time=True)], SAMPLE_TIMES)


def test_a_row_between_the_places_that_are_checked_must_lie_within_the_range(changed):
    """The places are 0.5 ms apart; the control passes its range for 0.1 ms at the row 1.2002 s."""
    changed(".xml", 'joint="wheel"/>', 'joint="wheel" ctrlrange="-1 0.8"/>')
    assert plan_run(load_case(changed(".toml", "title", "title")), "dynamics", "mujoco")
    rows = "time = [0.0, 0.3, 1.2001, 1.2002, 1.2003, 2.0], value = [0.0, 0.6, 0.6, 0.9, 0.6, -0.2]"
    file = changed(".toml", r"time = \[0.0, 0.3.*?\], value = \[.*?\]", rows)
    with pytest.raises(InputError, match=r"'wind' is 0.9 at x = 1.2002; it must lie within -1 to"):
        plan_run(load_case(file), "dynamics", "mujoco")
