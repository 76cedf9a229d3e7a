"""Engines at equal cost: the study and its store, the page, and the command."""

import json
import re
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import pytest
from typer.testing import CliRunner

from proofmass.base.errors import InputError
from proofmass.base.json_values import replace_nonfinite
from proofmass.commands.cli import app
from proofmass.run.asked import with_engines
from proofmass.studies.engines import cost as cost_module
from proofmass.studies.engines.cost import (
    EngineCosts,
    cost_record,
    describe_readings,
    measure_costs,
    start_of,
    write_costs,
)
from proofmass.studies.engines.cost_figure import spread_names
from proofmass.studies.engines.cost_page import read_costs, write_cost_page
from proofmass.studies.engines.cost_words import conclude
from proofmass.studies.engines.page import write_engines
from proofmass.studies.record import StudyRow
from proofmass.studies.store import Store
from proofmass.studies.study import Study
from tests.shipped import shipped, shipped_case
from tests.sim.hosts.test_host_process import SWING
from tests.studies.engines.cost_rows import compared, timed
from tests.studies.study_tasks import own_locks  # noqa: F401, a fixture of all tests

BUDGET = 0.01
"""Processor time after which a series of the tests ends [s]: some settings of the pendulum."""


@pytest.fixture
def costs() -> EngineCosts:
    """MuJoCo, Drake at three times the cost, and Box2D, which refuses."""
    return compared(timed("mujoco", 1e-5), timed("drake", 3e-5))


def page_text(costs: EngineCosts, folder: Path) -> str:
    """The page without the marks of its language."""
    write_costs(costs, folder)
    html = write_cost_page(folder, folder).read_text(encoding="utf-8")
    return " ".join(re.sub(r"<(style|title).*?</\1>|<[^>]+>", " ", html, flags=re.S).split())


def test_tables_are_read_as_they_were_written(costs: EngineCosts, tmp_path: Path) -> None:
    """Ranks of what is read are those of what was written."""
    write_costs(costs, tmp_path)
    again = read_costs(tmp_path)
    assert replace_nonfinite(cost_record(again)) == replace_nonfinite(cost_record(costs))
    assert again.rows == costs.rows


def test_json_has_the_ranks_of_the_page(costs: EngineCosts, tmp_path: Path) -> None:
    """All engines, ranked or not, with intervals, in strict JSON."""
    write_costs(costs, tmp_path)
    data = json.loads((tmp_path / "cost.json").read_text(encoding="utf-8"))
    ranks = data["ranks"]["position"]["1e-3"]
    assert [(one["engine"], one["rank"]) for one in ranks["engines"]] == [
        *(("mujoco", 1), ("drake", 2), ("box2d", 0))
    ]
    assert ranks["engines"][1]["ratio"][1] == pytest.approx(3.0)
    assert ranks["cases"][2]["words"] == "link <b> & its ball joint"
    assert data["machine"]["before"] == 1.5
    assert data["spread"] == pytest.approx(1.02)


def test_page_tells_ranks_noise_load_and_losers(costs: EngineCosts, tmp_path: Path) -> None:
    """What a stranger reads: who is first, how certain that is, and who is missing and why."""
    text = page_text(costs, tmp_path)
    for words in (
        "For an error of 1e-3 of the range in position MuJoCo needs the least time; then Drake "
        "3 times as long",
        "Load average 1.5 at the start of the command and 3.5 at its end, 4 to 4 at the timed "
        "runs, on 2 processors",
        "The machine was busy",
        "Repeated timings of a setting differ by a factor of 1.02 in the median of 18 settings",
        "refused in fourbar",
        "link &lt;b&gt; &amp; its ball joint",
        "Without a line: Box2D (refused)",
        "velocities read",
        "half step",
    ):
        assert words in text, words


def test_compilation_and_start_are_columns_of_their_own(costs: EngineCosts, tmp_path: Path) -> None:
    """They are no part of the time by which engines are ranked."""
    text = page_text(costs, tmp_path)
    assert "Drake 1.5 s 250 ms 9 in 1 series half step loops as springs; none" in text
    assert "MuJoCo runs here — 9 in 1 series as the engine gives them" in text
    compiled = compared(timed("mujoco", 1e-5), timed("drake", 3e-5, compile_seconds=9.0))
    assert [one.ratio for one in compiled.ranked("position", 1e-3)] == [
        one.ratio for one in costs.ranked("position", 1e-3)
    ]


def test_ties_are_said(tmp_path: Path) -> None:
    """Engines within the noise of their timings are tied on the page."""
    tied = compared(timed("mujoco", 1e-5), timed("drake", 1.01e-5))
    assert next(conclude(tied)).startswith(
        "For an error of 1e-3 of the range in position MuJoCo and Drake are tied"
    )
    text = page_text(tied, tmp_path)
    assert "1 ≈ Drake" in text  # over all cases
    assert re.search(r"s ≈ Drake", text)  # beside its time in the case


def test_lines_of_the_figure_fall_to_the_right(costs: EngineCosts, tmp_path: Path) -> None:
    """Each line has its engine's dash and ends at its smallest error."""
    write_costs(costs, tmp_path)
    html = write_cost_page(tmp_path, tmp_path).read_text(encoding="utf-8")
    lines = re.findall(r'<polyline class="line" points="([^"]*)"( stroke-dasharray)?', html)
    assert len(lines) >= 4  # two engines, over all cases and in the case, for each kind
    for points, _ in lines:
        places = [tuple(map(float, point.split(","))) for point in points.split()]
        assert places == sorted(places)
        assert [y for _, y in places] == sorted(y for _, y in places)
    assert {bool(dash) for _, dash in lines} == {True, False}


def test_names_beside_a_figure_do_not_overlap() -> None:
    """Nine engines that end at one error have nine places in the panel."""
    places = spread_names([300.0] * 9 + [14.0])
    assert all(one - two >= 15.0 for one, two in pairwise(places))
    assert min(places) > 12.0
    assert max(places) == 300.0


def test_readings_are_named_with_their_settings() -> None:
    """Defaults are read plainly, the settings of proofmass half a step later."""
    rows = [
        StudyRow("", "a", "dynamics", "bullet", f"Bullet{name}", "timestep", 1e-3, parameters)
        for name, parameters in (
            ("", {"timestep": 1e-3}),
            (", 50 iterations", {"timestep": 1e-3, "iterations": 50}),
            (", defaults", {"timestep": 1e-3, "defaults": True}),
        )
    ]
    assert describe_readings(rows) == "half step; plain: defaults"
    assert describe_readings(rows[:2]) == "half step"
    plain = [replace(row, engine="mujoco", parameters={}) for row in rows]
    assert describe_readings(plain) == ""


def test_start_of_an_interpreter_is_measured_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is kept in a file; an engine of this interpreter has none."""
    assert start_of("mujoco", tmp_path) != start_of("mujoco", tmp_path)  # NaN
    monkeypatch.setattr(cost_module, "engine_of", lambda name: SWING)
    first = start_of("swing", tmp_path)
    assert first > 1e-3
    assert start_of("swing", tmp_path) == first


def test_files_of_others_are_bad_input(costs: EngineCosts, tmp_path: Path) -> None:
    """The message names the command that writes them."""
    write_costs(costs, tmp_path)
    (tmp_path / "cost.json").write_text('{"cases": [1]}')
    with pytest.raises(InputError, match="not what proofmass engines --cost wrote"):
        read_costs(tmp_path)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--budget", "0"], "--budget 0: give a number of seconds above 0"),
        (["--budget", "nan"], "--budget nan: give a number of seconds above 0"),
        (["--engine", "drak"], "drake"),
    ],
)
def test_bad_words_end_in_a_line(tmp_path: Path, words: list[str], said: str) -> None:
    """Nothing is run."""
    command = ["engines", str(shipped("pendulum.toml")), "--cost", "-o", str(tmp_path / "o")]
    made = CliRunner().invoke(app, [*command, *words])
    assert made.exit_code == 2
    assert said in made.stderr
    assert len(made.stderr.strip().splitlines()) == 1


def test_a_comparison_needs_cases() -> None:
    """A list of engines has no cost."""
    made = CliRunner().invoke(app, ["engines", "--cost"])
    assert made.exit_code == 2
    assert "--cost ranks engines in cases" in made.stderr


def interrupt_after(count: int) -> object:
    """A progress that is stopped after some runs."""

    def advance(label: str, done: int, total: int) -> None:
        if done >= count:
            raise KeyboardInterrupt

    return advance


def test_a_stopped_comparison_goes_on(tmp_path: Path) -> None:
    """Runs that are stored are not made again, and the ranks are those of one that was not stopped.

    Errors do not depend on where it stopped.
    """
    case = with_engines(shipped_case(shipped("pendulum.toml")), ("mujoco",))
    study = Study(Store(tmp_path / "runs"), longest=10.0)
    stopped = replace(study, progress=interrupt_after(3))  # type: ignore[arg-type]
    with pytest.raises(KeyboardInterrupt):
        measure_costs([case], stopped, budget=BUDGET)
    stored = {file: file.stat().st_mtime_ns for file in study.store.folder.glob("*.json")}
    assert len(stored) >= 3
    whole = measure_costs([case], replace(study, store=Store(tmp_path / "runs")), budget=BUDGET)
    assert all(file.stat().st_mtime_ns == time for file, time in stored.items())
    files = set(study.store.folder.iterdir())
    again = measure_costs([case], replace(study, store=Store(tmp_path / "runs")), budget=BUDGET)
    assert set(study.store.folder.iterdir()) == files
    assert again.rows == whole.rows
    assert len(whole.rows) > 3


def test_command_writes_page_and_tables(tmp_path: Path) -> None:
    """One command, from cases to the ranks; the page of the cases links to them."""
    words = ["engines", str(shipped("pendulum.toml")), "--engine", "mujoco", "--cost", "--json"]
    made = CliRunner().invoke(app, [*words, "--budget", f"{BUDGET}", "-o", str(tmp_path / "o")])
    assert made.exit_code == 0, made.output
    shown = json.loads(made.stdout)
    (first,) = shown["cost"]["ranks"]["position"]["1e-3"]["engines"]
    assert (first["engine"], first["rank"], first["cases"]) == ("mujoco", 1, 1)
    assert shown["cost"] == json.loads((tmp_path / "o/cost.json").read_text(encoding="utf-8"))
    assert 'href="cost.html"' in (tmp_path / "o/index.html").read_text(encoding="utf-8")
    assert (tmp_path / "o/cost.csv").is_file()
    (tmp_path / "o/cost.json").unlink()
    write_engines(tmp_path / "o", tmp_path / "other")
    assert "cost.html" not in (tmp_path / "other/index.html").read_text(encoding="utf-8")
