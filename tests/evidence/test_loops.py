"""``proofmass compare``: a measured loop beside a sine, a fit, another file and a case."""

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from proofmass.base.arrays import Array
from proofmass.base.errors import InputError
from proofmass.base.recorded import RecordedColumn, read_table
from proofmass.commands.cli import app
from proofmass.evidence.loops import case_loop, make_reference, read_loop
from proofmass.reference.evaluate import all_quantities
from proofmass.run.sidecar import load_case
from proofmass.run.solve import prescribed_run, solve_here
from proofmass.verdict.compare import compare

PROTOTYPE = Path(__file__).parents[2] / "models" / "balancers" / "balancer_prototype.toml"
SIZE, FRICTION = 58.64357552691, 1.6
"""Size of the sine and moment of friction [N mm]."""
WORK = 1e-3 * SIZE
"""Work of the sine over a quarter of a turn [J]."""


def write_loop(file: Path, angle: Array, moment: Array, head: str = "alpha [deg],M [N mm]") -> Path:
    """Write a loop."""
    rows = np.column_stack([angle, moment])
    np.savetxt(file, rows, "%.12g", ",", header=head, comments="")
    return file


@pytest.fixture
def loop_file(tmp_path: Path) -> Path:
    """A sine with friction, once up and down, in degrees and newton millimetres."""
    up = np.linspace(0.0, 90.0, 901)
    angle = np.concatenate([up, up[::-1]])
    side = np.repeat([1.0, -1.0], up.size)
    return write_loop(
        tmp_path / "loop.csv", angle, SIZE * np.sin(np.radians(angle)) + FRICTION * side
    )


def test_works_area_and_reduction_are_those_of_the_closed_form(loop_file: Path) -> None:
    own = read_loop(loop_file)
    way = np.pi / 2.0
    assert own.loop.area == pytest.approx(2e-3 * FRICTION * way, rel=1e-6)  # the digits written
    found = make_reference(own, f"sine={SIZE}").errors
    expected = 100.0 * (1.0 - 1e-3 * FRICTION * way / WORK)
    assert found.reductions["both"] == pytest.approx(expected, rel=1e-5)  # trapezoids of the sine
    assert found.rms == pytest.approx(1e-3 * FRICTION, rel=1e-6)
    assert make_reference(own, "sine").errors.rms == pytest.approx(found.rms, rel=1e-5)


def test_a_loop_about_zero_has_no_reduction_and_all_other_numbers(tmp_path: Path) -> None:
    """From -30 to 30 degrees a sine does no work, so that nothing can be reduced."""
    up = np.linspace(-30.0, 30.0, 601)
    angle = np.concatenate([up, up[::-1]])
    moment = SIZE * np.sin(np.radians(angle)) + FRICTION * np.repeat([1.0, -1.0], up.size)
    file = write_loop(tmp_path / "loop.csv", angle, moment)
    done = CliRunner().invoke(app, ["compare", str(file), "--with", f"sine={-SIZE}"])
    assert done.exit_code == 0
    assert "friction   1.6 N mm" in done.stdout
    half = write_loop(tmp_path / "half.csv", angle + 30.0, moment)
    found = make_reference(read_loop(half), f"sine={-SIZE}").errors  # it does negative work
    assert all(np.isnan(one) for one in found.reductions.values())
    assert found.largest > 0.0


def test_a_fit_goes_through_the_middle(loop_file: Path) -> None:
    """Degree 5 is off a quarter of a sine by at most 1e-4 of its size (Chebyshev)."""
    own = read_loop(loop_file)
    found = make_reference(own, "fit=5")
    angle = np.linspace(*own.loop.ends, 50)
    off = found.curves["up"](angle) - own.loop.middle(angle)
    assert np.abs(off).max() < 1e-4 * 1e-3 * SIZE


def test_the_loop_of_a_case_is_that_of_its_last_cycle(tmp_path: Path) -> None:
    """A file with the reference's own loop agrees with it, branch by branch."""
    exact = case_loop(PROTOTYPE, "holding_moment")
    assert [one.rises for one in exact.branches] == [True, False]
    file = write_loop(tmp_path / "own.csv", np.degrees(exact.angle), 1e3 * exact.moment)
    own = read_loop(file)
    found = make_reference(own, str(PROTOTYPE))
    assert found.errors.largest < 1e-11  # the digits written
    assert found.errors.reductions["both"] > 99.999999
    assert own.loop.area == pytest.approx(exact.area, rel=1e-9)


def test_another_file_is_compared_in_the_common_range(loop_file: Path, tmp_path: Path) -> None:
    angle = np.linspace(30.0, 120.0, 91)
    other = write_loop(tmp_path / "other.csv", angle, SIZE * np.sin(np.radians(angle)))
    found = make_reference(read_loop(loop_file), str(other))
    assert np.degrees(found.ends) == pytest.approx([30.0, 90.0])
    assert found.errors.largest == pytest.approx(
        1e-3 * (FRICTION + SIZE * np.radians(1.0) ** 2 / 8), rel=1e-2
    )  # a straight line between its rows
    off = write_loop(tmp_path / "off.csv", angle + 90.0, angle)
    with pytest.raises(InputError, match="nothing in common"):
        make_reference(read_loop(loop_file), str(off))


@pytest.mark.parametrize(
    ("head", "words"),
    [
        ("a [deg],b [s]", "no column is in N m or N"),
        ("a,b [N m]", "try proofmass import loop.csv"),
        ("a [N m],b [N m]", "no column is in rad or m"),
    ],
)
def test_columns_without_the_units_are_bad_input(head: str, words: str, loop_file: Path) -> None:
    text = loop_file.read_text(encoding="utf-8")
    loop_file.write_text(text.replace("alpha [deg],M [N mm]", head), encoding="utf-8")
    with pytest.raises(InputError, match=words):
        read_loop(loop_file)


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ("fit=many", "give a degree from 0 to 15"),
        ("fit=99", "give a degree from 0 to 15"),
        ("sine=x", "give a number"),
        ("sine=0", "give a number"),
        ("nothing.csv", "no such recorded curve"),
        ("nothing.toml", "no such"),
        (f"{PROTOTYPE}:holding", "no quantity 'holding'"),
    ],
)
def test_wrong_references_are_bad_input(asked: str, words: str, loop_file: Path) -> None:
    with pytest.raises(InputError, match=words):
        make_reference(read_loop(loop_file), asked)


def test_several_columns_are_asked_for(tmp_path: Path) -> None:
    file = tmp_path / "two.csv"
    file.write_text("a [deg],M [N m],F [N m]\n0,0,0\n1,1,1\n2,2,2\n", encoding="utf-8")
    with pytest.raises(InputError, match="give one of M, F"):
        read_loop(file)
    assert read_loop(file, y="F").y == "F"
    with pytest.raises(InputError, match="no column 'G'"):
        read_loop(file, y="G")
    with pytest.raises(InputError, match="is in deg, where N m or N is needed"):
        read_loop(file, y="a")


def test_the_command_writes_text_json_and_a_figure(loop_file: Path, tmp_path: Path) -> None:
    figure = tmp_path / "loop.svg"
    done = CliRunner().invoke(app, ["compare", str(loop_file), "-o", str(figure)])
    assert done.exit_code == 0
    assert "2 branches" in done.stdout
    assert "friction   1.6 N mm" in done.stdout
    assert figure.read_bytes().startswith(b"<?xml")
    done = CliRunner().invoke(app, ["compare", str(loop_file), "--json"])
    answer = json.loads(done.stdout)
    assert answer["half_width"] == pytest.approx(1e-3 * FRICTION, rel=1e-6)
    assert [one["name"] for one in answer["references"]] == ["sine", "fit"]
    assert answer["branches"][1] == {
        "rises": False,
        "rows": [902, 1802],
        "ends": pytest.approx([0.0, np.pi / 2.0]),
        "whole": True,
    }


def test_the_figure_never_replaces_an_input(loop_file: Path) -> None:
    before = loop_file.read_bytes()
    done = CliRunner().invoke(app, ["compare", str(loop_file), "-o", str(loop_file), "--force"])
    assert done.exit_code == 2
    assert loop_file.read_bytes() == before


SIDECAR = """title = "A measured loop"
source = "the closed form of the prototype with friction, with the digits of a file"
model = "balancer_prototype.xml"
reference = "loop.csv"
[recording]
x = "row"
[drive]
joint = "pendulum"
profile = { file = "loop.csv", time = "row", value = "alpha" }
[run.sweep]
solvers = ["mujoco"]
[channels]
holding_moment = { equals = "M", unit = "N mm" }
[[tolerance]]
abs = 1e-6
why = "digits of the file, and the rest of the engine"
"""


def test_a_loop_without_times_is_a_reference_by_its_rows(tmp_path: Path) -> None:
    """The engine follows the measured angle up and down; with less friction it differs."""
    case = load_case(PROTOTYPE)
    run = prescribed_run(case, "sweep")
    state = run.motion(run.x)
    known = all_quantities(case, "sweep", run.x, state, case.parameters)
    write_loop(tmp_path / "loop.csv", np.degrees(state[0][0]), 1e3 * known["holding_moment"])
    file = tmp_path / "loop.toml"
    file.write_text(SIDECAR, encoding="utf-8")
    model = PROTOTYPE.with_suffix(".xml").read_text(encoding="utf-8")
    assert 'frictionloss="0.00263"' in model
    outcomes = []
    for friction in ("0.00263", "0.0025"):
        text = model.replace('frictionloss="0.00263"', f'frictionloss="{friction}"')
        (tmp_path / "balancer_prototype.xml").write_text(text, encoding="utf-8")
        own = load_case(file)
        curves = solve_here(own, "sweep", "mujoco")
        outcomes += [one.outcome for one in compare(own, "sweep", "mujoco", curves)]
    assert outcomes == ["agrees", "differs"]


def test_rows_are_counted_unless_a_column_is_called_so(tmp_path: Path) -> None:
    file = tmp_path / "rows.csv"
    file.write_text("a [deg]\n3\n5\n9\n", encoding="utf-8")
    column = RecordedColumn(column="row", scale=0.01)  # a hundred rows a second
    assert read_table(file).curve(column).tolist() == [0.0, 0.01, 0.02]
    file.write_text("row [m]\n3\n5\n9\n", encoding="utf-8")
    assert read_table(file).curve(RecordedColumn(column="row")).tolist() == [3.0, 5.0, 9.0]
