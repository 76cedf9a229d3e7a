"""One set of rules for the x of a recorded file, whoever uses it.

The users are a reference, a party that is compared with a reference, and a profile, here that of a
load.  Every rule is tested with all three.  The file has the angle of the rocker of a four-bar,
over time or over the angle of its crank.  The truth is the law of cosines, written anew here.
"""

import re
import shutil
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from scipy.special import ellipj, ellipk

from proofmass.base.errors import InputError
from proofmass.base.recorded import RecordedColumn, RecordedTable, find_wrap
from proofmass.base.recording import Recording, RunAxis, SteadyDrive
from proofmass.batch.check import check
from proofmass.reference.evaluate import evaluate
from proofmass.run.sidecar import load_case
from proofmass.run.solve import call_engine, plan_run, prescribed_run, solve_here
from proofmass.run.validate import validate_case
from tests.shipped import shipped

USERS = ("reference", "party", "profile")
TURN = 2 * np.pi
SPLINE_ERROR = 2e-6  # rad, of the cubic spline with 401 rows over two turns: h^4 / 384 phi''''
Rows = dict[str, np.ndarray]


def rocker_angle(crank: np.ndarray) -> np.ndarray:
    """Angle of the rocker of 2.5 m, from the crank of 1 m, the coupler of 2 m, the ground of 3 m.

    The triangle of coupler, rocker and the line between their far ends is on the side of +y.
    """
    x, y = np.cos(crank) - 3.0, np.sin(crank)
    square = x**2 + y**2
    inside = np.arccos((2.5**2 + square - 2.0**2) / (5.0 * np.sqrt(square)))
    return np.arctan2(y, x) % TURN - inside


@dataclass(frozen=True)
class Motion:
    """A motion of the crank: what the sidecar says of it, and its formula."""

    drive: str
    crank: Callable[[np.ndarray], np.ndarray]
    duration: float
    steady: bool = True
    fields: dict[str, float] = field(default_factory=dict)


def steady(start: float = 0.0, end: float = 2 * TURN, rate: float = TURN) -> Motion:
    """A crank of constant rate."""
    return Motion(
        f"from = {start!r}\nto = {end!r}\nrate = {rate!r}",
        lambda t: start + rate * t,
        (end - start) / rate,
    )


SWING = Motion(
    "from = 0.25\nto = 1.25\nperiod = 2.0",
    lambda t: 0.75 - 0.5 * np.cos(np.pi * t),
    2.0,
    steady=False,
)
TWO_TURNS, BACK = steady(), steady(0.5, 0.5 - 2 * TURN, -TURN)
SIDECAR = """
title = "Recorded rows of the rocker of a four-bar"
source = "a test"
model = "fourbar.xml"
{reference}

[drive]
joint = "crank"
{drive}

{load}

[run.{kind}]
solvers = ["{solver}"]
{run}

{settings}

[channels]
rocker = {{ equals = "{equals}", unit = "deg" }}

[[tolerance]]
relative_to_range = 1e-4
why = "a test"
"""
CLOSED_FORM = """reference = "fourbar"
[parameters]
crank = 1.0
coupler = 2.0
rocker = 2.5
ground = 3.0
rocker_load = 1.0
"""


@pytest.fixture
def write(tmp_path: Path) -> Callable[..., Path]:
    """``write(user, kind, motion, text, x)`` writes a file and the sidecar of a case that uses it.

    `x` says in the sidecar how the x column is read.
    """
    mjcf = Path(shipped("fourbar.xml")).read_text()
    load = '<motor name="load" joint="rocker"/></actuator>'
    (tmp_path / "fourbar.xml").write_text(mjcf.replace("</actuator>", load))

    def written(user: str, kind: str, motion: Motion, text: str, x: str = "") -> Path:
        (tmp_path / "rig.csv").write_text(text)
        duration = motion.duration
        given = f"{{ column = {x} }}" if x else ""
        parts = {
            "reference": {
                "reference": 'reference = "rig.csv"' + (f"\nrecording.x = {given}" if x else ""),
                "equals": "rocker",
                "solver": "mujoco",
            },
            "party": {
                "reference": CLOSED_FORM,
                "run": "n = 321" if motion.steady else f"n = 321\nuntil = {duration}",
                "equals": "rocker_angle",
                "solver": "recorded:rig",
                "settings": '[settings."recorded:rig"]\nfile = "rig.csv"\n'
                'channels.rocker = "rocker"\n' + (f"x = {given}" if x else ""),
            },
            "profile": {
                "reference": CLOSED_FORM,
                "run": "n = 321" if motion.steady else f"n = 321\nuntil = {duration}",
                "equals": "rocker_angle",
                "solver": "mujoco",
                "load": '[load]\nactuator = "load"\nscales = "rocker_load"\n'
                'profile = { file = "rig.csv", value = "rocker"'
                + (f", time = {given} }}" if x else " }"),
            },
        }[user]
        filled = {"load": "", "run": "", "settings": ""} | parts
        file = tmp_path / "case.toml"
        file.write_text(SIDECAR.format(drive=motion.drive, kind=kind, **filled))
        return file

    return written


def table(columns: dict[str, np.ndarray], digits: str = ".12g") -> str:
    """A CSV file."""
    rows = zip(*columns.values(), strict=True)
    lines = [",".join(columns), *(",".join(format(c, digits) for c in row) for row in rows)]
    return "\n".join(lines) + "\n"


def curve_of(user: str, kind: str, file: Path) -> tuple[np.ndarray, np.ndarray]:
    """The x of the run of a case, and the curve that the user makes of the file there [rad]."""
    case = load_case(file)
    validate_case(case)
    if user == "reference":
        run = prescribed_run(case, kind)
        return run.x, evaluate(case, kind, run.x, run.motion(run.x)).channels["rocker"]
    if user == "party":
        run = plan_run(case, kind, "recorded:rig")
        return run.x, call_engine("recorded", case.model_path, run).channels["rocker"]
    run = prescribed_run(case, kind)
    return run.x, run.controls(run.x)[0][0]


def refusal_of(user: str, kind: str, file: Path) -> str:
    """The text of the error with which a case is refused."""
    with pytest.raises(InputError) as caught:
        curve_of(user, kind, file)
    return str(caught.value)


EVEN = np.linspace(0.0, 2.0, 401)
UNEVEN = np.sort(np.concatenate([EVEN, EVEN[100:140] + 0.0025]))
ROUNDED = np.round(np.linspace(0.0, 2.0, 400), 5)  # s, uneven by rounding
READ = {
    "times": (TWO_TURNS, "t [s]", lambda t, crank: t, EVEN, ""),
    "milliseconds": (TWO_TURNS, "t [ms]", lambda t, crank: 1e3 * t, EVEN, ""),
    "minutes": (TWO_TURNS, "t [min]", lambda t, crank: t / 60, EVEN, ""),
    "a late clock": (TWO_TURNS, "t [s]", lambda t, crank: t + 3.25, EVEN, "3.25 s"),
    "a clock late by a row": (TWO_TURNS, "t [s]", lambda t, crank: t + 0.005, EVEN, "0.005 s"),
    "an early clock": (TWO_TURNS, "t [s]", lambda t, crank: t - 0.5, EVEN, "-0.5 s"),
    "a clock before 0": (TWO_TURNS, "t [s]", lambda t, crank: t - 9.0, EVEN, "-9 s"),
    "seconds since 1970": (TWO_TURNS, "t [s]", lambda t, crank: t + 1.7e9, EVEN, "1700000000 s"),
    "degrees": (TWO_TURNS, "crank [deg]", lambda t, crank: np.degrees(crank), EVEN, ""),
    "radians": (TWO_TURNS, "crank [rad]", lambda t, crank: crank, EVEN, ""),
    "turns": (TWO_TURNS, "crank [rev]", lambda t, crank: crank / TURN, EVEN, ""),
    "times of a falling crank": (BACK, "t [s]", lambda t, crank: t, EVEN, ""),
    "a falling angle": (BACK, "crank [deg]", lambda t, crank: np.degrees(crank), EVEN, ""),
    "a late clock of a falling crank": (BACK, "t [s]", lambda t, crank: t + 7, EVEN, "7 s"),
    "uneven times": (TWO_TURNS, "t [s]", lambda t, crank: t, UNEVEN, ""),
    "rounded times": (TWO_TURNS, "t [s]", lambda t, crank: t, ROUNDED, ""),
    "uneven angles": (TWO_TURNS, "crank [deg]", lambda t, crank: np.degrees(crank), UNEVEN, ""),
    "times of a swing": (SWING, "t [s]", lambda t, crank: t, EVEN, ""),
    "a late clock of a swing": (SWING, "t [s]", lambda t, crank: t + 3.25, EVEN, "3.25 s"),
}
"""Files by their kind: motion, header and values of x, times of the rows, words of the note."""


@pytest.mark.parametrize("user", USERS)
@pytest.mark.parametrize("kind", ["sweep", "dynamics"])
@pytest.mark.parametrize("name", READ)
def test_rows_belong_to_the_same_x_for_every_user(name, kind, user, write) -> None:
    motion, head, x_of, times, words = READ[name]
    crank = motion.crank(times)
    rows = {head: x_of(times, crank), "rocker [deg]": np.degrees(rocker_angle(crank))}
    file = write(user, kind, motion, table(rows, ".16g"))
    x, curve = curve_of(user, kind, file)
    by_value = kind == "sweep" and motion.steady
    known = rocker_angle(x if by_value else motion.crank(x))
    # digits of a float at 1.7e9 s: 2.4e-7 s, and 1.1 rad/s of the rocker
    allowed = 1e-6 if "1970" in name else SPLINE_ERROR
    np.testing.assert_allclose(curve, known, rtol=0, atol=allowed)
    ends = [x[0], x[-1]] if by_value else motion.crank(np.array([x[0], x[-1]]))
    asked = motion.crank(np.array([0.0, motion.duration]))
    np.testing.assert_allclose(ends, asked, rtol=0, atol=1e-6)
    if words:
        notes = solve_here(load_case(file), kind, plan_solver(user)).notes
        assert f"the run begins at t = {words} of the file's clock" in " ".join(notes)


def plan_solver(user: str) -> str:
    """The solver of a user's case."""
    return "recorded:rig" if user == "party" else "mujoco"


def without(rows: slice) -> Callable[[list[str]], list[str]]:
    """An edit of a file's lines."""

    def edit(lines: list[str]) -> list[str]:
        return [line for k, line in enumerate(lines) if k not in range(*rows.indices(len(lines)))]

    return edit


def with_cell(text: str) -> Callable[[list[str]], list[str]]:
    """An edit: the x of line 51 is another text."""
    return lambda lines: [*lines[:50], text + "," + lines[50].split(",")[1], *lines[51:]]


def twice(lines: list[str]) -> list[str]:
    """An edit: line 50 stands twice."""
    return [*lines[:50], lines[49], *lines[50:]]


REFUSED = {
    "wrapped": ("crank [deg]", lambda t, a: np.degrees(a) % 360, None, "line 202", "wrapped"),
    "wrapped radians": ("a [rad]", lambda t, a: (a + 3) % TURN - 3, None, "line", "wrapped"),
    "a row twice": ("t [s]", lambda t, a: t, twice, "line 51", "t does not rise"),
    "an angle twice": ("a [rad]", lambda t, a: a, twice, "line 51", "a does not rise"),
    "not finite": ("t [s]", lambda t, a: t, with_cell("nan"), "line 51, t", "not finite"),
    "empty": ("t [s]", lambda t, a: t, with_cell(""), "line 51, t", "no number"),
    "no number": ("t [s]", lambda t, a: t, with_cell("--"), "line 51, t", "'--' is no number"),
    "no unit": ("t", lambda t, a: t, None, "column 't'", "no unit in its header"),
    "unknown unit": ("t [furlog]", lambda t, a: t, None, "column 't'", "unknown unit 'furlog'"),
    "a length": ("s [mm]", lambda t, a: t, None, "column 's'", "'mm'", "is needed"),
    "against the rate": ("a [rad]", lambda t, a: -a, None, "'a'", "against the drive's rate"),
    "falling times": ("t [s]", lambda t, a: -t, None, "line 3", "t does not rise"),
}
"""Files that nobody can use: header and values of x, an edit of the lines, words of the message."""


@pytest.mark.parametrize("user", USERS)
@pytest.mark.parametrize("kind", ["sweep", "dynamics"])
@pytest.mark.parametrize("name", REFUSED)
def test_files_are_refused_for_the_same_reason_for_every_user(name, kind, user, write) -> None:
    head, x_of, edit, *words = REFUSED[name]
    crank = TWO_TURNS.crank(EVEN)
    rows = {head: x_of(EVEN, crank), "rocker [deg]": np.degrees(rocker_angle(crank))}
    lines = table(rows).splitlines()
    text = "\n".join(edit(lines) if edit else lines) + "\n"
    message = refusal_of(user, kind, write(user, kind, TWO_TURNS, text))
    assert all(word in message for word in words), message


def rocker_table(x: dict[str, np.ndarray], crank: np.ndarray, digits: str = ".12g") -> str:
    """A file with x and the angle of the rocker."""
    return table({**x, "rocker [deg]": np.degrees(rocker_angle(crank))}, digits)


@pytest.mark.parametrize("user", USERS)
@pytest.mark.parametrize("kind", ["sweep", "dynamics"])
@pytest.mark.parametrize("every", [1, 40])
def test_a_wrapped_x_is_unwrapped_where_the_sidecar_says_so(every, kind, user, write) -> None:
    """With every 40th row the crank turns by 72 degrees from row to row."""
    times = EVEN[::every]
    crank = TWO_TURNS.crank(times)
    text = rocker_table({"crank [deg]": np.degrees(crank) % 360}, crank)
    message = refusal_of(user, kind, write(user, kind, TWO_TURNS, text))
    assert "jumps from 358.2 to 0 deg" in message or "jumps from 288 to 0 deg" in message
    assert "unwrap = true" in message
    file = write(user, kind, TWO_TURNS, text, '"crank", unwrap = true')
    if every > 1 and user == "party":  # 11 rows are too few to interpolate
        assert "too few to interpolate" in refusal_of(user, kind, file)
        return
    x, curve = curve_of(user, kind, file)
    known = rocker_angle(x if kind == "sweep" else TWO_TURNS.crank(x))
    if every == 1 or user == "reference":
        np.testing.assert_allclose(curve, known, rtol=0, atol=SPLINE_ERROR)


@pytest.mark.parametrize("user", USERS)
@pytest.mark.parametrize("kind", ["sweep", "dynamics"])
def test_a_wrapped_column_is_refused_with_its_line(kind, user, write) -> None:
    """The angle of another crank, which turns, stands where the rocker's should."""
    crank = TWO_TURNS.crank(EVEN)
    text = table({"t [s]": EVEN, "rocker [deg]": np.degrees(crank + 0.01) % 360})
    message = refusal_of(user, kind, write(user, kind, TWO_TURNS, text))
    assert "line 202: rocker jumps from 358.773 to 0.572958 deg" in message
    assert "the angle is wrapped; add" in message


@pytest.mark.parametrize("user", USERS)
def test_a_column_that_nothing_uses_may_have_anything(user, write) -> None:
    crank = TWO_TURNS.crank(EVEN)
    lines = rocker_table({"t [s]": EVEN}, crank).splitlines()
    state = ["state", *["ok", "", "nan"] * 133, "ok", "ok"]
    text = "\n".join(f"{line},{cell}" for line, cell in zip(lines, state, strict=True)) + "\n"
    x, curve = curve_of(user, "dynamics", write(user, "dynamics", TWO_TURNS, text))
    np.testing.assert_allclose(curve, rocker_angle(TWO_TURNS.crank(x)), rtol=0, atol=SPLINE_ERROR)


ENDS = {
    "to too small": (steady(end=TURN), "drive.to", "ends at 6.28319 rad", "12.5664 rad"),
    "to too large": (steady(end=3 * TURN), "drive.to", "ends at 18.8496 rad", "12.5664 rad"),
    "another rate": (steady(rate=3.0), "drive.to", "ends at 12.5664 rad", "is 6 rad"),
}


@pytest.mark.parametrize("kind", ["sweep", "dynamics"])
@pytest.mark.parametrize("name", ENDS)
def test_ends_that_contradict_a_reference_are_named_with_both_numbers(name, kind, write) -> None:
    motion, *words = ENDS[name]
    text = rocker_table({"t [s]": EVEN}, TWO_TURNS.crank(EVEN))
    message = refusal_of("reference", kind, write("reference", kind, motion, text))
    assert all(word in message for word in [*words, "line 402", "t = 2 s"]), message


@pytest.mark.parametrize("kind", ["sweep", "dynamics"])
def test_an_angle_that_contradicts_from_is_named_with_both_numbers(kind, write) -> None:
    crank = TWO_TURNS.crank(EVEN)
    text = rocker_table({"crank [deg]": np.degrees(crank) + 90}, crank)
    message = refusal_of("reference", kind, write("reference", kind, TWO_TURNS, text))
    for word in ("drive.from", "begins at 0 rad", "line 2", "crank = 90 deg", "1.5708 rad"):
        assert word in message


@pytest.mark.parametrize("kind", ["sweep", "dynamics"])
def test_an_end_with_few_digits_contradicts_nothing(kind, write) -> None:
    """A row is 5 ms, in which the crank turns by 0.031 rad; the stated end is off by 0.006 rad."""
    crank = TWO_TURNS.crank(EVEN)
    file = write("reference", kind, steady(end=12.56), rocker_table({"t [s]": EVEN}, crank))
    x, _ = curve_of("reference", kind, file)
    assert x[-1] == pytest.approx(2 * TURN if kind == "sweep" else 2.0)
    few = np.array([0.0, 1.0, 2.0]) / 8  # s: half of these rows is 0.39 rad, and 1 % is 0.016 rad
    text = rocker_table({"t [s]": few}, TWO_TURNS.crank(few))
    for end, fits in ((TURN / 4 + 0.015, True), (TURN / 4 + 0.017, False)):
        file = write("reference", kind, steady(end=end), text)
        if fits:
            assert curve_of("reference", kind, file)[0].size == 3
        else:
            assert "drive.to" in refusal_of("reference", kind, file)


@pytest.mark.parametrize("user", ["party", "profile"])
@pytest.mark.parametrize("kind", ["sweep", "dynamics"])
def test_rows_that_end_before_the_run_are_refused(kind, user, write) -> None:
    text = rocker_table({"t [s]": EVEN}, TWO_TURNS.crank(EVEN))
    message = refusal_of(user, kind, write(user, kind, steady(end=3 * TURN), text))
    assert "nothing is extrapolated" in message


@pytest.mark.parametrize("user", USERS)
@pytest.mark.parametrize("kind", ["sweep", "dynamics"])
def test_rows_longer_than_the_run_are_used_but_for_a_reference(kind, user, write) -> None:
    """The clock of the rows has its 0 at `from`; the run is the second of three turns."""
    times = np.linspace(-1.0, 2.0, 601)
    motion = steady(start=1.0, end=1.0 + TURN)
    text = rocker_table({"t [s]": times}, motion.crank(times))
    file = write(user, kind, motion, text)
    if user == "reference":
        assert "drive.from" in refusal_of(user, kind, file)
        return
    x, curve = curve_of(user, kind, file)
    known = rocker_angle(x if kind == "sweep" else motion.crank(x))
    np.testing.assert_allclose(curve, known, rtol=0, atol=SPLINE_ERROR)


@pytest.mark.parametrize("times", [EVEN, UNEVEN], ids=["even", "uneven"])
@pytest.mark.parametrize("user", USERS)
@pytest.mark.parametrize("kind", ["sweep", "dynamics"])
def test_a_lost_first_row_moves_no_other_row(kind, user, times, write) -> None:
    """A reference has the other rows where they were; nothing is extrapolated for the others."""
    crank = TWO_TURNS.crank(times)
    text = rocker_table({"t [s]": times[1:]}, crank[1:])
    file = write(user, kind, TWO_TURNS, text)
    if user != "reference":
        assert "nothing is extrapolated" in refusal_of(user, kind, file)
        return
    x, curve = curve_of(user, kind, file)
    assert x[0] == pytest.approx(crank[1] if kind == "sweep" else times[1])
    known = rocker_angle(x if kind == "sweep" else TWO_TURNS.crank(x))
    np.testing.assert_allclose(curve, known, rtol=0, atol=SPLINE_ERROR)


@pytest.mark.parametrize("user", USERS)
def test_an_angle_is_no_x_of_a_swing(user, write) -> None:
    """The crank of a swing has every value twice, so that its value does not tell the time."""
    half = EVEN[:200]
    text = rocker_table({"crank [deg]": np.degrees(SWING.crank(half))}, SWING.crank(half))
    message = refusal_of(user, "dynamics", write(user, "dynamics", SWING, text))
    assert "column 'crank' of rig.csv is in 'deg', where s is needed" in message


@pytest.mark.parametrize("user", USERS)
def test_the_sidecar_shifts_and_scales_x(user, write) -> None:
    """The clock counts backwards in milliseconds from 2500."""
    crank = TWO_TURNS.crank(EVEN)
    text = rocker_table({"left [ms]": 2500 - 1e3 * EVEN}, crank, ".16g")
    file = write(user, "dynamics", TWO_TURNS, text, '"left", scale = -1, shift = 2500')
    x, curve = curve_of(user, "dynamics", file)
    np.testing.assert_allclose(curve, rocker_angle(TWO_TURNS.crank(x)), rtol=0, atol=SPLINE_ERROR)


def outcomes(file: Path) -> dict[str, set[str]]:
    """The outcomes of a case by run and solver."""
    result = check([file], jobs=1, detectable=False, causes=False)
    assert not result.errors, result.errors
    found: dict[str, set[str]] = {}
    for c in result.comparisons:
        found.setdefault(f"{c.run} {c.solver}", set()).add(c.outcome)
    return found


END_TO_END = {
    "time column in a sweep": ("sweep", {"t [s]": EVEN}, EVEN),
    "late clock": ("dynamics", {"t [s]": EVEN + 3.25}, EVEN),
    "angle column in dynamics": ("dynamics", {"crank [deg]": 360 * EVEN}, EVEN),
    "uneven times": ("dynamics", {"t [s]": UNEVEN}, UNEVEN),
}


@pytest.mark.parametrize("wrong", [0.0, 0.01])
@pytest.mark.parametrize("name", END_TO_END)
def test_mujoco_agrees_with_a_recorded_formula_and_differs_where_it_is_wrong(
    name, wrong, write
) -> None:
    """The tolerance is 1e-4 of the range; a rocker that is off by 0.01 degrees of 54 differs."""
    kind, x, times = END_TO_END[name]
    rocker = np.degrees(rocker_angle(TWO_TURNS.crank(times)))
    wave = wrong * np.sin(7 * times)
    text = table({**x, "rocker [deg]": rocker + wave})
    found = outcomes(write("reference", kind, TWO_TURNS, text))
    assert found == {f"{kind} mujoco": {"differs" if wrong else "agrees"}}


def test_the_error_between_uneven_rows_counts_in_the_tolerance(write) -> None:
    """With a row every 0.1 s the spline is off by more than the tolerance: undecided, not green."""
    times = np.sort(np.append(np.linspace(0.0, 2.0, 21), 0.97))
    text = rocker_table({"t [s]": times}, TWO_TURNS.crank(times))
    file = write("reference", "dynamics", TWO_TURNS, text)
    assert outcomes(file) == {"dynamics mujoco": {"undecided"}}
    (c,) = check([file], jobs=1, detectable=False, causes=False).comparisons
    assert c.error_max < c.uncertainty  # the stated error is a bound
    assert c.uncertainty > c.allowed


FREE = """
title = "Recorded pendulum"
source = "a test"
model = "pendulum.xml"
reference = "rig.csv"
{recording}

[run.dynamics]
solvers = ["mujoco", "recorded:rig"]
{run}

[settings."recorded:rig"]
file = "rig.csv"
{x}
channels.angle = "angle"

[channels]
angle = {{ equals = "angle", unit = "rad" }}

[[tolerance]]
relative_to_range = 1e-6
why = "a test"
"""


def pendulum_angle(time: np.ndarray) -> np.ndarray:
    """Angle of a pendulum of 1 m that is let go at rest a quarter of a turn from straight down."""
    modulus = np.sin(np.pi / 4)
    phase = ellipk(modulus**2) + np.sqrt(9.81) * time
    return -2 * np.arcsin(modulus * ellipj(phase, modulus**2)[0])


@pytest.fixture
def write_free(tmp_path: Path) -> Callable[..., Path]:
    """``write_free(text, x, run)`` writes a recorded free motion, of which x is read as `x` says.

    The file is the reference and one of the parties.
    """
    shutil.copy(shipped("pendulum.xml"), tmp_path)

    def written(text: str, x: str = "", run: str = "") -> Path:
        (tmp_path / "rig.csv").write_text(text)
        file = tmp_path / "case.toml"
        recording = f"[recording]\n{x}" if x else ""
        file.write_text(FREE.format(recording=recording, x=x, run=run))
        return file

    return written


@pytest.mark.parametrize("until", ["until = 2.0", ""])
@pytest.mark.parametrize("clock", [0.0, 3.25, -9.0, 1.7e9])
@pytest.mark.parametrize("times", [EVEN, UNEVEN], ids=["even", "uneven"])
def test_a_free_motion_begins_at_the_first_row_of_any_clock(
    clock, times, until, write_free
) -> None:
    text = table({"t [s]": times + clock, "angle [rad]": pendulum_angle(times)}, ".17g")
    file = write_free(text, run=until)
    if clock == 1.7e9:  # the digits of the clock are 2.4e-7 s, in which the pendulum turns by 1e-6
        file.write_text(file.read_text().replace("1e-6", "1e-5"))
    assert outcomes(file) == {"dynamics mujoco": {"agrees"}, "dynamics recorded:rig": {"agrees"}}


@pytest.mark.parametrize(
    ("first", "words"), [(0.005, "is at t = 0.005 s"), (-0.5, "is at t = -0.5 s")]
)
def test_a_free_motion_that_does_not_begin_at_a_row_of_its_own_is_refused(
    first, words, write_free
) -> None:
    """The pose of the key is that of the first row, which may lie before the motion or after."""
    times = EVEN + first
    text = table({"t [s]": times, "angle [rad]": pendulum_angle(times)})
    with pytest.raises(InputError) as caught:
        validate_case(load_case(write_free(text)))
    assert caught.value.key == "run.dynamics"
    assert "the run begins at 0 s" in caught.value.wrong
    assert words in caught.value.wrong
    moved = table({"t [s]": times, "angle [rad]": pendulum_angle(EVEN)})
    validate_case(load_case(write_free(moved, f'x = {{ column = "t", shift = {-first} }}')))


@pytest.mark.parametrize(("until", "fits"), [(2.0, True), (2.001, True), (2.5, False)])
def test_a_last_time_that_contradicts_the_rows_is_named(until, fits, write_free) -> None:
    text = table({"t [s]": EVEN, "angle [rad]": pendulum_angle(EVEN)})
    file = write_free(text, run=f"until = {until}")
    if fits:
        validate_case(load_case(file))
        return
    with pytest.raises(InputError, match=r"run ends at 2\.5 s, and the last row .* t = 2 s") as one:
        validate_case(load_case(file))
    assert one.value.key == "run.dynamics.until"


def test_a_gap_of_a_reference_is_refused_unless_the_sidecar_allows_it(write_free) -> None:
    times = np.delete(EVEN, slice(100, 140))
    text = table({"t [s]": times, "angle [rad]": pendulum_angle(times)})
    with pytest.raises(InputError, match=r"line 102: t goes from 0\.495 to 0\.7 s, 41 times"):
        validate_case(load_case(write_free(text)))
    file = write_free(text, x="gap = 42")
    assert outcomes(file)["dynamics mujoco"] == {"undecided"}


def test_a_few_uneven_rows_are_not_interpolated(write_free) -> None:
    times = np.append(EVEN[::50], 2.01)
    text = table({"t [s]": times, "angle [rad]": pendulum_angle(times)})
    with pytest.raises(InputError, match="10 rows are too few to interpolate"):
        validate_case(load_case(write_free(text)))


def test_columns_of_a_reference_may_lack_a_header(write_free) -> None:
    rows = table({"t": 1e3 * EVEN, "angle": np.degrees(-pendulum_angle(EVEN))})
    text = rows.partition("\n")[2]
    file = write_free(
        text,
        'x = { column = "1", unit = "ms" }\n'
        'columns.angle = { column = "2", unit = "deg", scale = -1 }',
    )
    text = re.sub(r"(?s)\[settings.*?\[channels", "[channels", file.read_text())
    file.write_text(text.replace(', "recorded:rig"', ""))
    assert outcomes(file) == {"dynamics mujoco": {"agrees"}}


RECORDING_FAULTS = {
    "no such x": ('x = "time"', "no column 'time' in rig.csv"),
    "another unit of x": ('x = { column = "t", unit = "ms" }', "says 's'"),
    "no such column": ('columns.angle = "angel"', "no column 'angel' in rig.csv"),
    "an unknown key": ('y = "t"', "unknown key 'y'"),
    "an unknown key of a column": ("columns.angle = { unwarp = true }", "unknown key 'unwarp'"),
    "unwrap of a length": ('columns.r = { column = "t", unwrap = true }', "goes with an angle"),
    "a small gap": ("gap = 1", "greater than 1"),
}


@pytest.mark.parametrize("name", RECORDING_FAULTS)
def test_faults_of_the_table_recording_are_named(name, write_free) -> None:
    recording, words = RECORDING_FAULTS[name]
    text = table({"t [s]": EVEN, "angle [rad]": pendulum_angle(EVEN)})
    file = write_free(text)
    file.write_text(
        file.read_text().replace(
            'reference = "rig.csv"', f'reference = "rig.csv"\n[recording]\n{recording}'
        )
    )
    with pytest.raises(InputError) as caught:
        validate_case(load_case(file))
    assert caught.value.key.startswith("recording")
    assert words in caught.value.wrong


def test_only_a_recorded_reference_has_a_table_recording(models) -> None:
    file = models / "pendulum.toml"
    file.write_text(file.read_text().replace("[run.dynamics]", "[recording]\n[run.dynamics]"))
    with pytest.raises(InputError, match="the reference is 'pendulum'; leave it out"):
        load_case(file)


CLOCKS = {
    "one clock": (0.0, 3.25, 3.25, ""),
    "both late": (3.25, 3.25, 0.0, ""),
    "only the motor late": (3.25, 0.0, None, "nothing is extrapolated"),
    "the rig before the motor": (0.0, -1.0, None, "nothing is extrapolated"),
}


@pytest.mark.parametrize("kind", ["sweep", "dynamics"])
@pytest.mark.parametrize("name", CLOCKS)
def test_the_files_of_a_case_have_one_clock(name, kind, write, tmp_path) -> None:
    """The motor's file is 10 s long, the rig's 2 s; the crank swings as the motor's file says."""
    motor_first, rig_first, begins, words = CLOCKS[name]
    motor, rig = np.linspace(0.0, 10.0, 2001) + motor_first, EVEN + rig_first

    def crank(time: np.ndarray) -> np.ndarray:
        return 1.0 - np.cos(1.5 * time)

    angle = {"t [s]": motor, "crank [rad]": crank(motor)}
    (tmp_path / "motor.csv").write_text(table(angle))
    drive = Motion('profile = { file = "motor.csv", value = "crank" }', crank, 2.0)
    file = write("reference", kind, drive, rocker_table({"t [s]": rig}, crank(rig)))
    if words:
        assert words in refusal_of("reference", kind, file)
        return
    x, curve = curve_of("reference", kind, file)
    assert x[0] == pytest.approx(begins)
    np.testing.assert_allclose(curve, rocker_angle(crank(rig)), rtol=0, atol=SPLINE_ERROR)
    led = prescribed_run(load_case(file), kind).motion(x)[0][0]
    np.testing.assert_allclose(led, crank(rig), rtol=0, atol=1e-8)


@pytest.mark.parametrize("clock", [3.25, 0.0, 100.0])
@pytest.mark.parametrize("kind", ["sweep", "dynamics"])
def test_the_clock_of_a_party_is_its_own(clock, kind, write, tmp_path) -> None:
    """The run begins at 3.25 s of the motor's clock, whatever the party's clock says then."""
    motor, rig = np.linspace(0.0, 10.0, 2001), EVEN + 3.25

    def crank(time: np.ndarray) -> np.ndarray:
        return 1.0 - np.cos(1.5 * time)

    (tmp_path / "motor.csv").write_text(table({"t [s]": motor, "crank [rad]": crank(motor)}))
    drive = Motion('profile = { file = "motor.csv", value = "crank" }', crank, 2.0)
    file = write("reference", kind, drive, rocker_table({"t [s]": rig}, crank(rig)))
    (tmp_path / "own.csv").write_text(rocker_table({"t [s]": EVEN + clock}, crank(rig)))
    text = file.read_text().replace('["mujoco"]', '["recorded:own"]')
    settings = '[settings."recorded:own"]\nfile = "own.csv"\nchannels.rocker = "rocker"\n'
    file.write_text(text.replace("[channels]", f"{settings}\n[channels]"))
    assert outcomes(file) == {f"{kind} recorded:own": {"agrees"}}


@pytest.mark.parametrize("rate", [1.0, -0.5])
@pytest.mark.parametrize("head", ["t [s]", "left [deg]"])
@pytest.mark.parametrize("kind", ["sweep", "dynamics"])
def test_a_second_drive_follows_rows_beside_a_first_one_of_constant_rate(
    kind, head, rate, tmp_path
) -> None:
    """The right crank of a five-bar is led by rows over time, or over the angle of the left one."""
    times = np.linspace(0.0, 2.0, 201)
    left = 0.25 + rate * times
    x = times if head == "t [s]" else np.degrees(left)
    (tmp_path / "right.csv").write_text(table({head: x, "q [rad]": np.sin(times)}))
    shutil.copy(shipped("fivebar.xml"), tmp_path)
    text = re.sub(
        r"(?s)\[\[drive\]\].*?\[run\]",
        f'[[drive]]\njoint = "left"\nfrom = 0.25\nto = {float(left[-1])!r}\nrate = {rate}\n'
        '[[drive]]\njoint = "right"\nprofile = { file = "right.csv", value = "q" }\n[run]',
        shipped("fivebar.toml").read_text(),
    ).replace("dynamics = {}", "dynamics = { n = 91 }")
    (tmp_path / "fivebar.toml").write_text(text)
    run = prescribed_run(load_case(tmp_path / "fivebar.toml"), kind)
    value, speed, _ = run.motion(run.x)
    time = (value[0] - 0.25) / rate
    assert time[0] == 0.0
    assert time[-1] == pytest.approx(2.0)
    np.testing.assert_allclose(value[1], np.sin(time), rtol=0, atol=1e-9)
    np.testing.assert_allclose(speed[1], np.cos(time), rtol=0, atol=1e-6)


@pytest.mark.parametrize("lost", [0, 1])
@pytest.mark.parametrize("kind", ["sweep", "dynamics"])
def test_a_party_agrees_with_a_reference_whose_first_row_is_lost(
    kind, lost, write, tmp_path
) -> None:
    """The 0 of the party's clock is at `from`, also if the party lacks that row as well."""
    crank = TWO_TURNS.crank(EVEN)
    file = write("reference", kind, TWO_TURNS, rocker_table({"t [s]": EVEN[1:]}, crank[1:]))
    (tmp_path / "own.csv").write_text(rocker_table({"t [s]": EVEN[lost:]}, crank[lost:]))
    text = file.read_text().replace('["mujoco"]', '["recorded:own"]')
    settings = '[settings."recorded:own"]\nfile = "own.csv"\nchannels.rocker = "rocker"\n'
    file.write_text(text.replace("[channels]", f"{settings}\n[channels]"))
    assert outcomes(file) == {f"{kind} recorded:own": {"agrees"}}


def test_a_slide_moves_in_proportion_to_time() -> None:
    """A slide goes from 20 mm at -4 mm/s; lengths and times are those of this line."""
    rows = tuple((k, [repr(2.0 - 0.4 * k), repr(k / 10)]) for k in range(20))
    recorded = RecordedTable(Path("rig.csv"), {"s": "cm", "t": "s"}, rows)
    drive = SteadyDrive("m", 0.02, -0.04)
    length, time = (
        Recording(recorded, RecordedColumn(column=name)).place(RunAxis("dynamics", "s", drive)).x
        for name in ("s", "t")
    )
    np.testing.assert_allclose(length, time, rtol=0, atol=1e-15)
    length, time = (
        Recording(recorded, RecordedColumn(column=name)).place(RunAxis("sweep", "m", drive)).x
        for name in ("s", "t")
    )
    np.testing.assert_allclose(length, 0.02 - 0.004 * np.arange(20), rtol=0, atol=1e-16)
    np.testing.assert_allclose(length, time, rtol=0, atol=1e-16)


WRAPS = {
    "steady": (np.arange(0.0, 1000.0, 3.0), 119),
    "coarse": (np.arange(0.0, 1000.0, 100.0), 3),
    "falling": (np.arange(-1.0, -1000.0, -7.0), 51),
    "about 0": (10 * np.sin(np.arange(0.0, 20.0, 0.1)), 31),
    "growing": (np.arange(0.0, 30.0) ** 2, 18),
    "last row": (np.arange(350.0, 361.0, 1.0), 9),
    "first row": (np.arange(359.0, 390.0, 1.0), 0),
}
"""Angles [deg], and the row before the first at which they have another number of whole turns."""


@pytest.mark.parametrize("name", WRAPS)
def test_a_wrap_is_found_at_its_row_and_nothing_else_is_one(name) -> None:
    angle, row = WRAPS[name]
    assert find_wrap(angle, 360.0) is None
    assert find_wrap(angle % 360.0, 360.0) == row
    assert find_wrap(np.radians(angle % 360.0), TURN) == row
    assert find_wrap(angle % 360.0, 500.0) is None


def test_jumps_of_other_sizes_are_no_wraps() -> None:
    steps = np.where(np.arange(50) == 25, 1.0, 0.0).cumsum()
    slow = np.arange(50.0)
    for jump in (170.0, 290.0, 430.0, 720.0):
        assert find_wrap(slow + jump * steps, 360.0) is None
    for jump in (330.0, 360.0, 390.0, -360.0):
        assert find_wrap(slow + jump * steps, 360.0) == 24
    assert find_wrap(np.array([0.0, 360.0]), 360.0) is None  # two rows tell nothing of the speed


@pytest.mark.parametrize("kind", ["sweep", "dynamics"])
def test_a_wrapped_drive_of_a_reference_is_unwrapped_where_the_sidecar_says_so(kind, write) -> None:
    """The crank, its rate and its acceleration are columns of the reference."""
    crank = TWO_TURNS.crank(EVEN)
    columns = {"t [s]": EVEN, "crank [deg]": np.degrees(crank) % 360}
    rates = {"w [rad/s]": np.full(401, TURN), "a [rad/s^2]": np.zeros(401)}
    text = table({**columns, **rates, "rocker [deg]": np.degrees(rocker_angle(crank))})
    drive = Motion('profile = ["crank", "w", "a"]', TWO_TURNS.crank, 2.0)
    file = write("reference", kind, drive, text)
    message = refusal_of("reference", kind, file)
    assert "line 202: crank jumps from 358.2 to 0 deg" in message
    assert "[recording] columns.crank = { unwrap = true }" in message
    given = 'reference = "rig.csv"\nrecording.columns.crank = { unwrap = true }'
    file.write_text(file.read_text().replace('reference = "rig.csv"', given))
    led = prescribed_run(load_case(file), kind).motion(EVEN)[0][0]
    np.testing.assert_allclose(led, crank, rtol=0, atol=1e-12)


@pytest.mark.parametrize("kind", ["sweep", "dynamics"])
def test_a_load_has_the_clock_of_the_drives_file(kind, write, tmp_path) -> None:
    """The motor's file begins at 3.25 s, the load's at 0 s; at 3.25 s of both the run begins."""
    motor, rows = np.linspace(3.25, 5.25, 401), np.linspace(0.0, 10.0, 2001)
    (tmp_path / "motor.csv").write_text(table({"t [s]": motor, "q [rad]": 0.1 * motor}))
    drive = Motion('profile = { file = "motor.csv", value = "q" }', np.sin, 2.0, steady=False)
    file = write("profile", kind, drive, table({"t [s]": rows, "rocker [rad]": np.sin(rows)}))
    x, control = curve_of("profile", kind, file)
    assert (x[0], x[-1]) == pytest.approx((0.0, 2.0))
    np.testing.assert_allclose(control, np.sin(x + 3.25), rtol=0, atol=1e-9)
