"""Cases beside engines: sentences from rows, the page, the list and the command."""

import json
from pathlib import Path
from shutil import copy

import pytest
from typer.testing import CliRunner

from proofmass.base.errors import InputError
from proofmass.commands.cli import app
from proofmass.commands.engines import engine_table, list_engines, named_engines
from proofmass.studies.cells import CellResult, ChannelError, cells_of, measure_cells, stored_cell
from proofmass.studies.engines.page import dot_radius, readings_of, shown_cell, write_engines
from proofmass.studies.engines.summary import summarize_engine
from proofmass.studies.store import Store
from proofmass.studies.study import Study
from tests.shipped import shipped, shipped_case


def ran(case: str, solver: str, error: float, **more: object) -> CellResult:
    """A run with one position."""
    found = ChannelError("angle", "rad", "position", error, error, 1.0)
    return CellResult(case, "dynamics", solver, errors=(found,), seconds=0.1, **more)  # type: ignore


RESULTS = [
    ran("pendulum", "bullet", 4e-6, settings={"reading": "half step"}, versions={"pybullet": "3"}),
    ran("bricard", "bullet", 0.4),
    ran("fourbar", "bullet", 1e-4, settings={"reading": "plain"}),
    CellResult("andrews", "dynamics", "bullet", "unsupported", "springs between points"),
    CellResult("delta", "dynamics", "bullet", "crashed", "killed by signal 11 (SIGSEGV)"),
    CellResult("top", "dynamics", "bullet", "diverged", "a position is lost (t = 0.3 s)"),
    ran("pendulum", "mujoco", 5e-12),
]


def test_sentences_come_from_rows() -> None:
    """Best and worst, silently wrong, lost and refused runs are named with their cases."""
    found = summarize_engine("bullet", RESULTS)
    assert (found.filled, found.of, found.middle) == (3, 6, 1e-4)
    assert found.title == "Bullet"
    assert found.licence == "Zlib"
    assert found.versions == "pybullet 3"
    assert list(found.sentences) == [
        "Best: pendulum, 4e-6 of the range in position.",
        "Largest error: fourbar, 1e-4.",
        "Silently wrong, by more than 10% and without a word: bricard by 0.4 of the range.",
        "Crashed: delta: killed by signal 11 (SIGSEGV)",
        "Diverged: top: a position is lost",
        "Refused: andrews: springs between points",
    ]


def test_engine_that_ran_nothing_has_no_number() -> None:
    """Nothing is claimed of it."""
    only = [CellResult("a", "dynamics", "drake", "unavailable", "no uv here")]
    found = summarize_engine("drake", only)
    assert found.filled == 0
    assert found.middle != found.middle
    assert found.sentences == ("Unavailable: a: no uv here",)


def test_cells_show_dots_and_marks() -> None:
    """A dot grows by decades; what has no error has a mark and its reason."""
    good, silent, _, refused, crashed, lost, _ = (shown_cell(one) for one in RESULTS)
    assert (good.state, good.words, good.mark) == ("good", "4e-6", "")
    assert 0 < good.radius < dot_radius(0.05)
    assert (silent.mark, silent.state) == ("!", "silent")
    assert (refused.mark, refused.words, refused.state) == ("–", "refused", "none")
    assert (crashed.mark, lost.words) == ("✕", "diverged")
    assert "SIGSEGV" in crashed.title
    assert shown_cell(None).state == "none"
    assert [dot_radius(10.0**k) for k in (-12, -9, -6)] == sorted(
        dot_radius(10.0**k) for k in (-12, -9, -6)
    )
    assert readings_of(RESULTS) == "half step: Bullet; plain: Bullet"


def test_page(tmp_path: Path) -> None:
    """The page is written from its table, and refuses a file of others."""
    data = {"kinds": {"pendulum": "linkages"}, "results": [one.record() for one in RESULTS]}
    (tmp_path / "engines.json").write_text(json.dumps(data, allow_nan=False))
    pages = write_engines(tmp_path, tmp_path)
    text = pages.first.read_text(encoding="utf-8")
    assert "4 of 7 runs of 2 engines have errors against mathematics" in text
    assert "Silently wrong" in text
    assert 'data-group="linkages"' in text
    assert pages.parts["bricard"] == "index.html#bricard"
    (tmp_path / "engines.json").write_text("[]")
    with pytest.raises(InputError, match="not what proofmass engines wrote"):
        write_engines(tmp_path, tmp_path)


def test_cells_are_kept(tmp_path: Path) -> None:
    """A stored cell is read; one of another solver is made."""
    case = shipped_case(shipped("pendulum.toml"))
    study = Study(Store(tmp_path / "runs"))
    first = measure_cells(cells_of([case], ["mujoco"]), study)
    files = {file: file.stat().st_mtime_ns for file in study.store.folder.iterdir()}
    again = measure_cells(cells_of([case], ["mujoco", "mujoco:default"]), study)
    assert again[0] == first[0]
    assert all(file.stat().st_mtime_ns == time for file, time in files.items())
    assert again[1].position > again[0].position
    assert stored_cell(cells_of([case], ["mujoco:default"])[0], study.store) == again[1]


def test_list_of_engines() -> None:
    """Every engine is listed with its state; nothing is fetched."""
    found = {one.name: one for one in list_engines()}
    assert found["mujoco"].state == "runs here"
    assert found["box2d"].lacks == "motions in space, ball joint, free joint"
    assert "another program" in found["pinocchio"].trap
    assert all(
        one.licence for name, one in found.items() if name not in ("mujoco", "pymunk", "recorded")
    )
    shown = json.loads(CliRunner().invoke(app, ["engines", "--json"]).stdout)
    assert {one["name"] for one in shown} == set(found)


def test_all_stands_for_engines_that_compute() -> None:
    """A recorded party computes nothing."""
    names = named_engines([])
    assert names[:2] == ["mujoco", "pymunk"]
    assert "recorded" not in names
    assert "drake" in names
    assert named_engines(["mujoco==3.6.0", "mujoco==3.6.0"]) == ["mujoco==3.6.0"]


def test_table_counts_runs() -> None:
    """A row for each engine with what became of its runs."""
    table = engine_table(["bullet", "mujoco"], RESULTS)
    cells = [list(column.cells) for column in table.columns]
    assert [column[0] for column in cells] == ["Bullet", "3 of 6", "1.0e-04", "0.1", "1", "2", "1"]
    assert [column[1] for column in cells] == ["MuJoCo", "1 of 1", "5.0e-12", "0.1", "0", "0", "0"]


def test_unknown_engine_is_bad_input(tmp_path: Path) -> None:
    """The nearest names are suggested, and nothing runs."""
    words = [
        "engines",
        str(shipped("pendulum.toml")),
        "--engine",
        "drak",
        "-o",
        str(tmp_path / "o"),
    ]
    made = CliRunner().invoke(app, words)
    assert made.exit_code == 2
    assert "drake" in made.stderr


def test_sidecar_at_fault_costs_its_row_only(tmp_path: Path) -> None:
    """The other cases of a folder run, the fault is a line, and the exit code is that of check."""
    for name in ("pendulum.toml", "pendulum.xml", "fourbar.toml"):
        copy(shipped(name), tmp_path)
    words = [str(tmp_path), "--engine", "mujoco"]
    made = CliRunner().invoke(app, ["engines", *words, "-o", str(tmp_path / "o")])
    checked = CliRunner().invoke(app, ["check", *words])
    assert (made.exit_code, checked.exit_code) == (2, 2)
    faults = [
        [line for line in one.stderr.splitlines() if line.startswith("error: ")]
        for one in (made, checked)
    ]
    assert faults[0] == faults[1]
    assert "fourbar.xml" in faults[0][0]
    assert "1 of 1" in made.stdout
    table = json.loads((tmp_path / "o" / "engines.json").read_text())
    assert [one["case"] for one in table["results"]] == ["pendulum"]


def test_every_case_has_a_run(tmp_path: Path) -> None:
    """A case without a run in time has its sweep or its equilibrium, unless runs are asked for."""
    cases = ["pendulum", "springs_series", "rod_cantilever"]
    words = ["engines", *(str(shipped(f"{name}.toml")) for name in cases), "--engine", "mujoco"]
    made = CliRunner().invoke(app, [*words, "-o", str(tmp_path / "o")])
    assert made.exit_code == 0, made.output
    assert "3 of 3" in made.stdout
    table = json.loads((tmp_path / "o" / "engines.json").read_text())
    runs = {one["case"]: one["run"] for one in table["results"]}
    assert runs == dict(zip(cases, ("dynamics", "sweep", "equilibrium"), strict=True))
    page = (tmp_path / "o" / "index.html").read_text(encoding="utf-8")
    assert 'springs_series <span class="small soft">sweep</span>' in page


def test_case_without_the_run_is_named(tmp_path: Path) -> None:
    """Nothing of what was asked for is left out without a word."""
    words = ["engines", str(shipped("pendulum.toml")), str(shipped("springs_series.toml"))]
    words += ["--engine", "mujoco", "--run", "sweep", "-o", str(tmp_path / "o")]
    made = CliRunner().invoke(app, words)
    assert made.exit_code == 0, made.output
    assert "left out, since they have no run sweep: pendulum\n" in made.stderr
    assert "1 of 1" in made.stdout
