"""The pages of a trade study: snippets to paste, ties, fronts, and the data of the diagram."""

import json
import math
import re
from dataclasses import replace
from pathlib import Path

import pytest

from proofmass.base.files import LIST_NAME
from proofmass.report.figures import save
from proofmass.report.svg_markers import page_tones
from proofmass.studies.record import StudyRow
from proofmass.studies.trade import page as trade_page
from proofmass.studies.trade.figure import series_looks
from proofmass.studies.trade.page import list_advice, page_data, text_to_paste, write_trade
from proofmass.studies.trade.trade import Trade, write_study
from proofmass.studies.trade.verdict import pareto_front
from tests.studies.trade.trade_rows import example_study, series_rows


def test_advice_has_a_snippet_or_a_reason_why_there_is_none() -> None:
    rows, verdicts = example_study()
    asked = list_advice(rows, verdicts, "acceleration", 1.0)
    assert [one.wanted for one in asked] == ["1e-3", "1e-5", "1e-7"]
    # acceleration errors are 100 times as large: RK4 has a floor of 3e-6, pymunk without bias 2e-7
    reached = [{use.engine: use.reached for use in one.engines} for one in asked]
    assert reached == [
        {"MuJoCo": True, "pymunk": True},
        {"MuJoCo": True, "pymunk": True},
        {"pymunk": False, "MuJoCo": False},
    ]
    best = next(use for use in asked[1].engines if use.engine == "MuJoCo")
    assert '<option timestep="0.001" integrator="RK4"/>' in best.text
    assert best.error == format_error(rows[best.place], "acceleration")
    short = next(use for use in asked[2].engines if use.engine == "MuJoCo")
    assert "the error floor is 3e-6, cap of solimp" in short.more[0]
    (falls,) = list_advice(series_rows("falls")[:3], [], "acceleration", 1.0)[2].engines
    assert "falls would need a step of about" in falls.more[0]


@pytest.mark.parametrize("first", ["mujoco", "pymunk"])
def test_counted_times_decide_which_engine_is_first(first: str) -> None:
    """Both engines have the same errors, and the measured times say the opposite."""
    rows = [
        replace(
            row,
            engine=engine,
            series=engine,
            work=row.seconds * (1.0 if engine == first else 3.0),
            seconds=row.seconds * (3.0 if engine == first else 1.0),
        )
        for engine in ("mujoco", "pymunk")
        for row in series_rows("near")
    ]
    asked = list_advice(rows, [], "position", 1.0)
    assert {one.engines[0].tone for one in asked if one.engines[0].reached} == {first}


def format_error(row: StudyRow, kind: str) -> str:
    """An error to two digits."""
    return f"{row.errors[kind]:.1e}".replace("e-0", "e-")


def test_ties_are_named_among_good_enough_settings_only() -> None:
    near = [replace(row, repeats=(row.seconds, 1.5 * row.seconds)) for row in series_rows("near")]
    slow = [
        replace(row, series="slow", repeats=(1.2 * row.seconds,) * 5, seconds=1.2 * row.seconds)
        for row in near
    ]
    (one, *_) = list_advice([*near, *slow], [], "position", 1.0)
    (use,) = one.engines
    assert use.tied == "slow, timestep 2 ms"  # coarser settings are not good enough
    apart = [replace(row, repeats=(2 * row.seconds,) * 5, seconds=2 * row.seconds) for row in slow]
    (one, *_) = list_advice([*near, *apart], [], "position", 1.0)
    assert one.engines[0].tied == ""


def test_engines_with_overlapping_wall_times_are_tied() -> None:
    rows = [*series_rows("a"), *series_rows("b", "pymunk", cost=1.2e-5)]
    assert not list_advice(rows, [], "position", 1.0)[0].tied
    rows = [replace(row, repeats=(row.seconds, 1.5 * row.seconds)) for row in rows]
    assert list_advice(rows, [], "position", 1.0)[0].tied


def test_the_snippet_has_the_time_step_that_was_taken() -> None:
    row = StudyRow("", "", "", "mujoco", "", "timestep", 0.01, {"timestep": 0.01}, step=0.008)
    assert text_to_paste(row) == '<option timestep="0.008"/>'
    assert "timestep = 0.008" in text_to_paste(replace(row, engine="unheard of"))


def test_the_snippet_of_pymunk_defaults_has_their_numbers() -> None:
    parameters = {"timestep": 0.01, "defaults": True}
    row = StudyRow("", "", "", "pymunk", "", "timestep", 0.01, parameters, steps=100)
    assert "space.iterations = 10\n" in text_to_paste(row)


def test_the_data_of_the_diagram_are_those_of_the_table() -> None:
    rows, verdicts = example_study()
    looks = series_looks(rows)
    data = page_data(rows, verdicts, looks, page_tones(k.colour for k in looks.values()), 1.0)
    json.dumps(data, allow_nan=False)
    assert len(data["settings"]) == len(rows)
    for one, row in zip(data["settings"], rows, strict=True):
        assert one["errors"] == {k: e for k, e in row.errors.items() if math.isfinite(e)}
        assert data["series"][one["series"]]["name"] == row.series
        assert one["ran"] == (row.outcome == "ran")
        assert one["work"] == pytest.approx(6.28 / row.value, abs=1)  # the failed one has it too
    position = data["kinds"][0]
    assert [rows[k] for k in position["front"]] == pareto_front(rows, "position")
    assert position["tied"] == []
    assert [one["level"] for one in position["floors"]] == [
        v.floor for v in verdicts if v.kind == "position" and v.floor > 0
    ]
    fewest = [rows[k] for k in position["fewest"]]
    for row in fewest:
        assert not any(
            o.steps <= row.steps and o.errors["position"] < row.errors["position"]
            for o in rows
            if o.outcome == "ran"
        )


def test_the_page_contains_its_data_and_reports_a_busy_machine(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(trade_page, save.__name__, lambda figure, file: "")
    rows, verdicts = example_study()
    pages = []
    for load in (1.0, 6.0):
        shaken = [replace(row, load=load, machine="Processor x 2") for row in rows]
        write_study(Trade(shaken, [], verdicts), tmp_path)
        written = write_trade(tmp_path, tmp_path / "page").first
        pages.append(written.with_name("fourbar-dynamics-trade.html").read_text(encoding="utf-8"))
        assert ("busy machine" in written.read_text(encoding="utf-8")) == (load > 2)
    assert ["The machine was busy" in text for text in pages] == [False, True]
    assert "load average 6 to 6" in pages[1]
    found = re.search(r'<script type="application/json" id="data">(.*?)</script>', pages[1])
    assert found
    assert len(json.loads(found[1])["settings"]) == len(rows)
    names = {file.name for file in (tmp_path / "page" / "static").iterdir()}
    scripts = {"common.js", "study.js", "axes.js", "diagram.js", "trade.js"}
    assert names == {"common.css", "study.css", LIST_NAME, *scripts}
