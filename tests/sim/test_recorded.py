"""Tests of recorded curves that are compared with a reference: wrong columns differ, bad files are
refused.

The rows of the hacksaw's export lie between the samples of the run, those of the balancer's export
at the samples.
"""

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from docs.make.shaped_exports import FILES, MODELS, text_of
from proofmass.base.errors import InputError
from proofmass.base.recorded import RecordedColumn, interpolate_recorded, read_table
from proofmass.batch.check import check
from proofmass.case.case import Case
from proofmass.commands.cli import app
from proofmass.commands.studies import load_cases
from proofmass.run.sidecar import load_case
from proofmass.run.solve import solve_here, with_computing_solvers
from proofmass.verdict.compare import compare
from proofmass.verdict.comparison import Comparison
from tests.shipped import shipped

HACKSAW_CASE, RECORDED_SOLVER = "hacksaw_inventor_shaped", "recorded:inventor-shaped"
SAM_CASE = "balancer4_sam_shaped"
Table = dict[str, list[str]]


def recorded_comparisons(
    case: Case, kind: str = "dynamics", solver: str = RECORDED_SOLVER
) -> dict[str, Comparison]:
    """The comparisons of recorded curves, by channel."""
    found = compare(case, kind, solver, solve_here(case, kind, solver), detectable=False)
    return {c.channel: c for c in found}


def columns_of(file: Path) -> Table:
    """The cells of a CSV file by header, without its comments."""
    lines = [line for line in file.read_text().splitlines() if not line.startswith("#")]
    heads, *rows = (line.split(",") for line in lines)
    return {head: [row[k] for row in rows] for k, head in enumerate(heads)}


def write_table(file: Path, table: Table) -> None:
    """Write cells by header as a CSV file."""
    rows = zip(*table.values(), strict=True)
    file.write_text("\n".join([",".join(table), *(",".join(row) for row in rows)]) + "\n")


@pytest.fixture
def spoil(models: Path) -> Callable[..., Case]:
    """``spoil(change, name)`` applies a change to the table of an export and loads its case."""

    def changed(change: Callable[[Table], object], name: str = HACKSAW_CASE) -> Case:
        file = models / f"{name}.csv"
        table = columns_of(file)
        change(table)
        write_table(file, table)
        return load_case(models / f"{name}.toml")

    return changed


@pytest.mark.parametrize("name", FILES)
def test_the_shipped_files_are_those_that_the_script_makes(name: str) -> None:
    """Numbers may differ by one in the last digit: another machine may round a sine otherwise."""
    shipped_lines, made_lines = (MODELS / name).read_text().splitlines(), text_of(name).splitlines()
    assert [line for line in shipped_lines if line[0] in "#tTa"] == [
        line for line in made_lines if line[0] in "#tTa"
    ]
    shipped_numbers, made_numbers = (
        np.array([line.split(",") for line in lines if line[0] not in "#tTa"], float)
        for lines in (shipped_lines, made_lines)
    )
    decimals = [len(cell.partition(".")[2]) for cell in shipped_lines[-1].split(",")]
    assert (np.abs(shipped_numbers - made_numbers) <= 1.01 * 10.0 ** -np.array(decimals)).all()


@pytest.mark.parametrize("name", ["hacksaw_inventor_shaped", "balancer4_sam_shaped"])
def test_made_up_files_say_so_in_their_first_line(name: str) -> None:
    first = shipped(f"{name}.csv").read_text().splitlines()[0]
    assert re.fullmatch(r"# MADE UP\. Shaped like an export of .*, and not from it\.", first)


def test_recorded_curves_and_both_engines_agree() -> None:
    result = check([shipped(f"{HACKSAW_CASE}.toml")], jobs=1, detectable=False)
    assert not result.errors
    assert result.exit_code == 0
    outcomes: dict[str, set[str]] = {}
    for c in result.comparisons:
        outcomes.setdefault(c.solver, set()).add(c.outcome)
    assert outcomes == {
        "mujoco": {"agrees"},
        "mujoco:default": {"unchecked"},
        "pymunk": {"agrees"},
        RECORDED_SOLVER: {"agrees"},
    }
    assert len(result.comparisons) == 4 * 12


def test_the_stated_offset_of_the_crank_is_found() -> None:
    """The zero of the crank is off by 0.02 degrees, as the file states.

    The file has no drive of its own, so that the reference is computed from the motion profile.
    """
    case = load_case(shipped(f"{HACKSAW_CASE}.toml"))
    curves = solve_here(case, "dynamics", RECORDED_SOLVER)
    assert curves.by_profile
    off = np.degrees(curves.channels["theta2"] - curves.drive[0][0])
    assert off == pytest.approx(0.02, abs=1e-4)  # both angles are rounded to 1e-4 degrees
    assert "972 rows, interpolated by a cubic spline, which may be off by" in curves.notes[0]
    # the acceleration has kinks at the thirds of the first turn
    assert "(theta2_acceleration)" in curves.notes[0]


def negated(name: str) -> Callable[[Table], object]:
    """A change of a table: a column with the opposite sign."""
    return lambda table: table.update({name: [str(-float(cell)) for cell in table[name]]})


def shifted_by_a_row(name: str) -> Callable[[Table], object]:
    """A change of a table: a column that is late by one row."""
    return lambda table: table.update({name: [table[name][0], *table[name][:-1]]})


def with_swapped_columns(one: str, other: str) -> Callable[[Table], object]:
    """A change of a table: two columns of the same unit are exchanged."""
    return lambda table: table.update({one: table[other], other: table[one]})


HEADERS = {
    "theta2": "Theta2 [deg]",
    "theta2_rate": "w2 [deg/s]",
    "theta2_acceleration": "A2 [deg/s^2]",
    "r1": "R1 [m]",
    "theta1": "Theta1 [deg]",
    "theta3": "Theta3 [deg]",
    "r1_rate": "Vr1 [m/s]",
    "theta1_rate": "w1 [deg/s]",
    "theta3_rate": "W3 [deg/s]",
    "r1_acceleration": "Ar1 [m/s^2]",
    "theta1_acceleration": "A1 [deg/s^2]",
    "theta3_acceleration": "A3 [deg/s^2]",
}


@pytest.mark.parametrize("how", [negated, shifted_by_a_row])
@pytest.mark.parametrize("channel", HEADERS)
def test_a_negated_or_shifted_column_differs_alone(channel, how, spoil) -> None:
    found = recorded_comparisons(spoil(how(HEADERS[channel])))
    assert [c.channel for c in found.values() if c.outcome != "agrees"] == [channel]
    assert found[channel].outcome == "differs"


@pytest.mark.parametrize(("one", "other"), [("theta1", "theta3"), ("theta1_rate", "theta2_rate")])
def test_swapped_columns_differ(one, other, spoil) -> None:
    found = recorded_comparisons(spoil(with_swapped_columns(HEADERS[one], HEADERS[other])))
    assert {c.channel for c in found.values() if c.outcome == "differs"} == {one, other}


def test_a_wrong_sign_or_shift_in_the_sidecar_differs(edit) -> None:
    """The channel of a wrong entry differs, and no other.

    The wrong entries are R1 without its factor -1, Theta3 without its shift of 180 degrees, and w1
    with a factor of -1.
    """
    for old, new, channel in (
        ('column = "R1", scale = -1', 'column = "R1"', "r1"),
        ('column = "Theta3", shift = 180', 'column = "Theta3"', "theta3"),
        ('theta1_rate = "w1"', 'theta1_rate = { column = "w1", scale = -1 }', "theta1_rate"),
    ):
        file = edit(f"{HACKSAW_CASE}.toml", re.escape(old), new)
        found = recorded_comparisons(load_case(file))
        outcomes = {name: c.outcome for name, c in found.items()}
        assert outcomes == dict.fromkeys(HEADERS, "agrees") | {channel: "differs"}
        edit(f"{HACKSAW_CASE}.toml", re.escape(new), old)


def test_a_wrong_unit_in_the_header_differs(spoil) -> None:
    def renamed(table: Table) -> None:
        table["Vr1 [mm/s]"] = table.pop("Vr1 [m/s]")

    assert recorded_comparisons(spoil(renamed))["r1_rate"].outcome == "differs"


def test_constant_columns_differ_in_all_channels(spoil) -> None:
    def with_constant_columns(table: Table) -> None:
        for name in table:
            table[name] = table[name] if "Tiempo" in name else [table[name][0]] * len(table[name])

    assert {c.outcome for c in recorded_comparisons(spoil(with_constant_columns)).values()} == {
        "differs"
    }


def test_channels_with_coarse_rows_are_undecided(spoil) -> None:
    """With a row every 64 ms all channels but the crank's angle are undecided.

    The errors of the spline are less than its uncertainty, which is larger than the tolerance.  The
    angle of the crank has almost no curvature.
    """

    def thinned(table: Table) -> None:
        for name, cells in table.items():
            table[name] = [*cells[:-1:16], cells[-1]]

    found = recorded_comparisons(spoil(thinned))
    assert {name: c.outcome for name, c in found.items()} == {
        name: "agrees" if name == "theta2" else "undecided" for name in HEADERS
    }
    offset = 0.02 + 1e-3  # deg, of the crank, which moves all curves; and the rounded digits
    for name, c in found.items():
        assert (c.uncertainty > c.allowed) == (name != "theta2")
        assert c.error_max < c.uncertainty + (offset if name == "theta2" else 0.0)
        assert ("too coarse to tell" in c.message) == (name != "theta2")


def test_an_undecided_case_has_exit_code_1(spoil, models: Path) -> None:
    spoil(lambda table: table.update({k: [*v[:-1:16], v[-1]] for k, v in table.items()}))
    result = check([models / f"{HACKSAW_CASE}.toml"], jobs=1, detectable=False, causes=False)
    assert not result.errors
    assert result.exit_code == 1


def test_rows_at_the_samples_are_not_interpolated() -> None:
    case = load_case(shipped(f"{SAM_CASE}.toml"))
    curves = solve_here(case, "sweep", "recorded:sam-shaped")
    table = read_table(shipped(f"{SAM_CASE}.csv"))
    assert np.array_equal(curves.channels["energy"], table.values("V"))
    assert curves.uncertainty == {}
    assert "nothing is interpolated" in curves.notes[0]
    assert curves.missing.keys() == {"segment4.angle"}
    found = recorded_comparisons(case, "sweep", "recorded:sam-shaped")
    assert found["segment4.angle"].outcome == "unsupported"
    assert {c.outcome for c in found.values()} == {"agrees", "unsupported"}


@pytest.mark.parametrize(
    ("head", "channel"),
    [
        ("theta1 [deg]", "deflection1"),
        ("theta2 [deg]", "segment2.angle"),
        ("M [N m]", "holding_moment"),
        ("V [J]", "energy"),
    ],
)
def test_a_shifted_column_of_the_balancer_differs_alone(head, channel, spoil) -> None:
    found = recorded_comparisons(
        spoil(shifted_by_a_row(head), SAM_CASE), "sweep", "recorded:sam-shaped"
    )
    wrong = {name: c.outcome for name, c in found.items() if c.outcome != "agrees"}
    assert wrong == {channel: "differs", "segment4.angle": "unsupported"}


SMOOTH_CURVES = {
    "sine": lambda x, at: np.sin(9.0 * x + at),
    "peak": lambda x, at: np.exp(-(((x - at) / 0.08) ** 2)),
    "fifth power": lambda x, at: (x - at) ** 5,
    "bend": lambda x, at: np.maximum(x - at, 0.0) + np.sin(9.0 * x),
    "bend of the slope": lambda x, at: np.maximum(x - at, 0.0) ** 2,
}


@pytest.mark.parametrize("unevenness", [0.0, 0.15])
@pytest.mark.parametrize("name", SMOOTH_CURVES)
def test_interpolation_errors_are_within_the_stated_uncertainty(
    name: str, unevenness: float
) -> None:
    """The rows are up to a share `unevenness` of their mean spacing off their even places."""
    rng = np.random.default_rng(5)
    rows, x = np.linspace(0.0, 1.0, 60), np.linspace(0.0, 1.0, 20_001)
    rows[1:-1] += unevenness * rng.uniform(-1.0, 1.0, 58) / 59
    shares = []
    for at in rng.uniform(0.1, 0.9, 40):
        found, error = interpolate_recorded(x, rows, SMOOTH_CURVES[name](rows, at))
        errors = np.abs(found - SMOOTH_CURVES[name](x, at))
        assert (errors <= error + 1e-14).all()
        shares.append(errors.max() / error.max())
    assert max(shares) > 0.05  # the stated error is not too large by orders of magnitude


def test_the_reference_is_computed_at_a_recorded_drive(edit) -> None:
    """The reference is computed at the drive that the file records, whose rows are at the samples.

    The wrong zero of the crank then causes no errors of the other angles.
    """
    edit(f"{HACKSAW_CASE}.toml", r"until = 3\.88\d*", "until = 3.884")
    edit(f"{HACKSAW_CASE}.toml", r"n = 1000", "n = 972")
    drive = '{ value = "Theta2", rate = "w2", acceleration = "A2" }'
    file = edit(
        f"{HACKSAW_CASE}.toml",
        r'x = "Tiempo"',
        f'x = "Tiempo"\ndrive.crank = {drive}',
    )
    found = recorded_comparisons(load_case(file))
    # theta2 itself is compared with the motion profile
    assert found["theta2"].error_max == pytest.approx(0.02, abs=1e-4)
    assert found["r1"].relative_to_range < 2e-6  # rounding of printed digits, instead of 2e-4
    assert found["theta3"].relative_to_range < 2e-6


def test_a_recorded_drive_between_the_samples_is_refused(edit, models: Path) -> None:
    drive = '{ value = "Theta2", rate = "w2", acceleration = "A2" }'
    edit(f"{HACKSAW_CASE}.toml", r'x = "Tiempo"', f'x = "Tiempo"\ndrive.crank = {drive}')
    (error,) = check([models / f"{HACKSAW_CASE}.toml"], jobs=1, causes=False).errors
    assert "used only if the file has rows at the samples of the run" in error.wrong


BAD_CELLS = {
    "another unit": ("R1 [m]", "R1 [deg]", ["column 'R1'", "channel r1", "'deg'", "m is needed"]),
    "unknown unit": ("R1 [m]", "R1 [furlog]", ["channels.r1", "unknown unit 'furlog'"]),
    "no unit": ("R1 [m]", "R1", ["channels.r1", "no unit in its header", "unit = "]),
    "missing column": ("R1 [m]", "Radius [m]", ["channels.r1", "no column 'R1'", "Radius"]),
    "no time": (
        "Tiempo [s]",
        "Tiempo [m]",
        ["column 'Tiempo'", "x of the dynamics", "s is needed"],
    ),
    "falling time": ("\n0.008,", "\n0.003,", ["line 10", "Tiempo does not rise"]),
    "a time twice": ("\n0.008,", "\n0.004,", ["line 10", "Tiempo does not rise"]),
    "NaN": ("0.0996790,", "nan,", ["line 12, R1", "'nan' is not finite"]),
    "no number": ("0.0996790,", "--,", ["line 12, R1", "'--' is no number"]),
    "a cell too few": ("0.0996790,", "", ["line 12", "12 cells, the header has 13"]),
    "twice the same head": ("Vr1 [m/s]", "R1 [m/s]", ["column 'R1'", "stands twice"]),
}


def refusal_output(models: Path) -> str:
    """Standard error of `proofmass check` on the hacksaw's case, which must have exit code 2."""
    found = CliRunner().invoke(app, ["check", str(models / f"{HACKSAW_CASE}.toml"), "--jobs", "1"])
    assert found.exit_code == 2
    assert "Traceback" not in found.output
    return " ".join(found.stderr.split())


@pytest.mark.parametrize("name", BAD_CELLS)
def test_bad_files_are_refused_with_what_would_be_right(name: str, models: Path) -> None:
    old, new, words = BAD_CELLS[name]
    file = models / f"{HACKSAW_CASE}.csv"
    text = file.read_text()
    assert text.count(old) >= 1
    file.write_text(text.replace(old, new, 1))
    output = refusal_output(models)
    assert all(word in output for word in words), output


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        (slice(8, 60), ["line 9", "times the usual spacing"]),
        (slice(-40, None), ["column 'Tiempo'", "nothing is extrapolated", "to 3.88325"]),
        (slice(7, 8), ["column 'Tiempo'", "from 0.004", "nothing is extrapolated"]),
        (slice(17, -1), ["times the usual spacing"]),
    ],
)
def test_missing_rows_are_refused(rows: slice, words: list[str], models: Path) -> None:
    file = models / f"{HACKSAW_CASE}.csv"
    lines = file.read_text().splitlines()
    del lines[rows]
    file.write_text("\n".join(lines) + "\n")
    output = refusal_output(models)
    assert all(word in output for word in words), output


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('file = "hacksaw_inventor_shaped.csv"', 'file = "inventor.csv"', ["no such recorded"]),
        ('file = "hacksaw_inventor_shaped.csv"\n', "", [".file", "missing; it is required"]),
        ('x = "Tiempo"', 'x = "Time"', [".x", "no column 'Time'", "Tiempo"]),
        ('r1 = { column = "R1"', 'r11 = { column = "R1"', ["channels.r11", "did you mean 'r1'"]),
        ("scale = -1 }", "sclae = -1 }", ["channels.r1", "unknown key 'sclae'", "scale"]),
        ('theta1 = "Theta1"', 'theta1 = { column = "Theta1", unit = "rad" }', ["says 'deg'"]),
        ('r1_rate = "Vr1"', 'r1_rate = { column = "Vr1", unwrap = true }', ["goes with an angle"]),
        ('x = "Tiempo"', 'x = "Tiempo"\ndrive.rocker.value = "Theta2"', ["drive.rocker.rate"]),
        ('x = "Tiempo"', 'x = "Tiempo"\ngap = 0.5', [".gap", "greater than 1"]),
        ('x = "Tiempo"', 'x = "Tiempo"\ntimestep = 1e-3', ["unknown setting 'timestep'"]),
    ],
)
def test_bad_settings_of_recorded_curves_are_refused(
    old: str, new: str, words: list[str], models: Path
) -> None:
    file = models / f"{HACKSAW_CASE}.toml"
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new, 1))
    output = refusal_output(models)
    assert all(word in output for word in words), output


def test_a_recorded_solver_without_settings_asks_for_its_file(edit) -> None:
    file = edit(f"{HACKSAW_CASE}.toml", r'"pymunk", "recorded:inventor-shaped"\]', '"recorded"]')
    text = file.read_text()
    file.write_text(
        re.sub(r'(?s)\[settings\."recorded.*?(?=\[channels\])', "", text)
        .replace("[settings.pymunk]\ntimestep = 5e-4", "")
        .split("[[tolerance]]")[0]
    )
    (error,) = check([file], jobs=1).errors
    assert (error.key, error.wrong) == ("settings.recorded.file", "missing; it is required")


def test_the_path_of_a_file_is_relative_to_the_sidecar(models: Path) -> None:
    folder = models / "exports"
    folder.mkdir()
    (models / f"{HACKSAW_CASE}.csv").rename(folder / f"{HACKSAW_CASE}.csv")
    text = (models / f"{HACKSAW_CASE}.toml").read_text()
    (folder / f"{HACKSAW_CASE}.toml").write_text(text.replace('"hacksaw.xml"', '"../hacksaw.xml"'))
    found = recorded_comparisons(load_case(folder / f"{HACKSAW_CASE}.toml"))
    assert {c.outcome for c in found.values()} == {"agrees"}


def test_another_unit_and_offset_of_time_are_mapped(spoil, edit, models: Path) -> None:
    """The times are milliseconds that begin at 250: the clock ran before the motion began."""

    def with_other_clock(table: Table) -> None:
        times = [f"{1e3 * float(cell) + 250.0:.0f}" for cell in table.pop("Tiempo [s]")]
        table["clock [ms]"] = times

    edit(f"{HACKSAW_CASE}.toml", 'x = "Tiempo"', 'x = { column = "clock", shift = -250 }')
    assert {c.outcome for c in recorded_comparisons(spoil(with_other_clock)).values()} == {"agrees"}
    edit(f"{HACKSAW_CASE}.toml", "shift = -250", "shift = -250.5")
    found = recorded_comparisons(load_case(models / f"{HACKSAW_CASE}.toml"))
    assert found["theta3_rate"].outcome == "differs"  # 0.5 ms at 1500 deg/s^2


def test_wrapped_angles_are_unwrapped(spoil, edit, models: Path) -> None:
    def wrapped(table: Table) -> None:
        name = HEADERS["theta2"]
        table[name] = [f"{(float(cell) + 180.0) % 360.0 - 180.0:.4f}" for cell in table[name]]

    with pytest.raises(InputError, match=r"Theta2 jumps from .* deg: the angle is wrapped"):
        recorded_comparisons(spoil(wrapped))
    edit(
        f"{HACKSAW_CASE}.toml", 'theta2 = "Theta2"', 'theta2 = { column = "Theta2", unwrap = true }'
    )
    assert (
        recorded_comparisons(load_case(models / f"{HACKSAW_CASE}.toml"))["theta2"].outcome
        == "agrees"
    )


def test_degrees_in_a_header_may_have_the_sign(tmp_path: Path) -> None:
    """The file may be in the encoding of Windows; the angle is in radians, as from deg."""
    rows = "".join(f"{k};{k / 2}\n" for k in range(20))
    file = tmp_path / "turn.csv"
    for unit in ("°", "deg"):
        file.write_bytes(f"t [s];angle [{unit}]\n{rows}".encode("cp1252"))
        np.testing.assert_allclose(
            read_table(file).curve(RecordedColumn(column="angle")),
            np.arange(20) * np.pi / 360,
            rtol=1e-15,
            atol=0,
        )


def test_columns_without_a_header_are_named_by_numbers(tmp_path: Path) -> None:
    file = tmp_path / "plain.txt"
    file.write_text("0.0\t1,5\n0.1\t2,5\n0.2\t3,5\n".replace(".", ","))
    table = read_table(file)
    assert list(table.units) == ["1", "2"]
    assert table.values("2").tolist() == [1.5, 2.5, 3.5]


def test_studies_leave_recorded_curves_out(edit, tmp_path: Path) -> None:
    case = load_case(shipped(f"{HACKSAW_CASE}.toml"))
    left, others = with_computing_solvers(case)
    assert left.run["dynamics"].solvers == ("mujoco", "mujoco:default", "pymunk")
    assert others == (RECORDED_SOLVER,)
    alone = edit(
        f"{HACKSAW_CASE}.toml", r'solvers = \["mujoco".*', 'solvers = ["recorded:inventor-shaped"]'
    )
    text = alone.read_text().replace("[settings.pymunk]\ntimestep = 5e-4", "")
    head, *tolerances = text.split("[[tolerance]]")
    kept = [t for t in tolerances if "recorded" in t]
    alone.write_text("[[tolerance]]".join([head, *kept]))
    for command in (
        ["trade", alone, "-o", tmp_path / "t"],
        ["choose", alone, "--error", "1e-3", "--store", tmp_path / "c"],
        ["stress", alone, "-o", tmp_path / "s"],
        ["explain", alone],
    ):
        found = CliRunner().invoke(app, [str(word) for word in command])
        assert found.exit_code == 2, (command, found.output)
        assert "recorded" in found.stderr
        assert "Traceback" not in found.output


def test_a_study_reports_the_recorded_curves_that_it_leaves_out(capsys) -> None:
    (case,) = load_cases([shipped(f"{SAM_CASE}.toml")])
    assert case.run["sweep"].solvers == ("mujoco", "pymunk")
    output = " ".join(capsys.readouterr().err.split())
    assert f"{SAM_CASE}: recorded:sam-shaped is left out" in output


def test_a_wrong_sign_of_a_column_is_named_as_the_cause(edit, models: Path) -> None:
    """The diagnosis of a recorded column names its sign as the cause.

    It tries no number of the model, since recorded curves do not depend on any.
    """
    edit(f"{HACKSAW_CASE}.toml", re.escape('{ column = "R1", scale = -1 }'), '"R1"')
    edit(
        f"{HACKSAW_CASE}.toml", r'solvers = \["mujoco", "mujoco:default", "pymunk", ', "solvers = ["
    )
    text = (models / f"{HACKSAW_CASE}.toml").read_text()
    text = text.replace("[settings.pymunk]\ntimestep = 5e-4", "")
    head, *tolerances = text.split("[[tolerance]]")
    kept = [t for t in tolerances if "recorded" in t]
    (models / f"{HACKSAW_CASE}.toml").write_text("[[tolerance]]".join([head, *kept]))
    (found,) = check([models / f"{HACKSAW_CASE}.toml"], jobs=1, detectable=False).diagnoses.values()
    assert found.causes[0].words == "r1 with the opposite sign"
    assert not any("numbers of the model" in words for words in found.tried)
