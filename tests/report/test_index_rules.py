"""The rules of the index, its groups and the first table of a page, on made-up comparisons."""

import math
from dataclasses import replace
from typing import Any

import pytest

from proofmass.batch.check import Result
from proofmass.report import families
from proofmass.report.changes import Change, find_changes, format_changes
from proofmass.report.families import RECORDED_PART, describe_reference, group_cards
from proofmass.report.index_page import (
    CaseRow,
    case_row,
    columns_of,
    engine_looks,
    failure_remarks,
    format_failure,
    index_cell,
    is_only_shown,
    representative,
    total_seconds,
    trend_line,
    worst_outcome,
)
from proofmass.report.overview import error_cell, overview_table
from proofmass.report.record import History, Record, extend_history
from proofmass.report.style import solver_looks
from proofmass.report.trend import format_growth, trend_of, trend_order
from proofmass.verdict.outcome import Outcome
from tests.report.index_rows import (
    MADE,
    comparison_of,
    failed_comparison,
    index_text,
    load_cases,
    make_record,
    result_for_index,
)
from tests.shipped import MODELS

CASES = {case.name: case for case in load_cases()}


def row_of(rows: list, changes: list[Change] | None = None, case: str = "pendulum") -> CaseRow:
    """The row of a case with these comparisons and changes."""
    result = Result([CASES[case]], rows, paths=(MODELS,))
    return case_row(CASES[case], result, columns_of(result), changes or [], None, History(), {})


def angle(share: float, solver: str = "mujoco", **how: Any):
    """A comparison of the pendulum's angle."""
    return comparison_of("pendulum", "dynamics", solver, "angle", share, **how)


def change_of(growth: float) -> Change:
    return Change("pendulum", "dynamics", "mujoco", "angle", "a", "b", growth)


def test_changes_are_counted_as_worse_better_and_other():
    row = row_of([angle(1e-9)], [change_of(math.inf), change_of(0.5), change_of(1.0)])
    assert (row.worse, row.change) == (1, "1 worse, 1 better, 1 other")
    assert row_of([angle(1e-9)], [change_of(0.5)]).change == "1 better"
    assert row_of([angle(1e-9)], [Change("pendulum", "", "", "", "", "there")]).change == "new"


def test_a_case_without_a_tolerance_comes_after_those_with_one():
    names = "pendulum", "fourbar"
    rows = [
        comparison_of("pendulum", "dynamics", "mujoco", "angle", 1e-9, None, Outcome.UNCHECKED),
        comparison_of("fourbar", "sweep", "mujoco", "pin.x", 1e-7),
    ]
    cases = [CASES[name].model_copy(update={"unchecked": name == "pendulum"}) for name in names]
    page = index_text(Result(cases, rows, paths=(MODELS,)))
    assert page.index('<tr data-name="fourbar"') < page.index('<tr data-name="pendulum"')


def test_a_case_of_which_nothing_was_checked_has_the_sign_of_a_failure_unless_it_says_so():
    shown = [angle(1e-9, allowed=None, outcome=Outcome.UNCHECKED)]
    sign, word = worst_outcome("bad", shown, [])
    assert (sign, word) == (worst_outcome("bad", [], ["a fault"])[0], "unchecked")
    assert worst_outcome("open", shown, [])[0] != sign


def test_a_refinement_is_in_no_column():
    row = row_of(
        [
            comparison_of("rod_cantilever", "equilibrium", "mujoco", "x", 5e-7),
            comparison_of("rod_cantilever", "refine", "mujoco", "x", 1.0, 1e-1),
        ],
        case="rod_cantilever",
    )
    assert list(row.cells) == ["quasi-static/mujoco"]


def test_twelve_engines_have_markers_and_colours_of_their_own():
    solvers = [*"abcdefghijkl"]
    rows = [angle(1e-9, solver) for solver in solvers]
    looks = engine_looks(columns_of(Result(comparisons=rows)), solver_looks(solvers))
    assert len({looks[name].path for name in solvers}) == 12
    assert len({looks[name].colour for name in solvers}) == 12


def test_the_colour_of_an_engine_is_that_of_the_engine_as_in_the_model():
    looks = solver_looks(["mujoco:default", "mujoco"])
    rows = [angle(1e-9, solver) for solver in ("mujoco:default", "mujoco")]
    found = engine_looks(
        columns_of(Result(comparisons=rows)),
        {name: looks[name] for name in ("mujoco:default", "mujoco")},
    )
    assert found["mujoco"].colour == looks["mujoco"].colour != looks["mujoco:default"].colour


def test_the_margin_of_a_case_is_that_of_its_judged_curves():
    unjudged = angle(1.0, "mujoco:default", allowed=1e-6, outcome=Outcome.UNCHECKED)
    assert row_of([angle(5e-7), unjudged]).margin == pytest.approx(0.5)


def test_a_run_costs_once_whatever_its_channels_and_unknown_times_count_nothing():
    rows = [angle(1e-9), replace(angle(1e-9), channel="rate"), angle(1e-9, "pymunk")]
    assert total_seconds(rows) == 1.0  # two runs of 0.5 s
    assert total_seconds([*rows, replace(angle(1e-9, "adams"), seconds=math.nan)]) == 1.0


def test_a_cell_has_the_engine_first_and_shows_a_failure_of_other_settings():
    wrong = angle(1e-2, "mujoco:default", allowed=1e-3, outcome=Outcome.DIFFERS)
    cell = index_cell([wrong, angle(1e-9)])
    assert [lane.solver for lane in cell.lanes] == ["mujoco", "mujoco:default"]
    assert (cell.error, cell.bad) == ("0.01", True)


def test_a_cell_without_a_number_is_sorted_by_whether_it_failed():
    unknown = failed_comparison("pendulum", "dynamics", "adams", "rate", Outcome.UNSUPPORTED)
    assert index_cell([unknown]).sort == -1.0
    assert index_cell([replace(unknown, outcome=Outcome.CRASHED)]).sort == math.inf


def test_the_channel_that_fails_most_represents_a_solver():
    by_far = angle(1e-4, allowed=1e-6, outcome=Outcome.DIFFERS)
    barely = replace(angle(1e-1, allowed=5e-2, outcome=Outcome.DIFFERS), channel="rate")
    assert representative([barely, by_far], {}) is by_far
    words = format_failure([replace(barely, message="2 x"), replace(by_far, message="100 x")], 5)
    assert words == "2 of 5 differ, angle by 100 x"


def test_an_error_of_zero_has_a_bar_without_width():
    (mark,) = index_cell([angle(0.0)]).lanes
    assert mark.width == 0.0


def test_a_case_whose_input_is_at_fault_does_not_say_that_it_agrees():
    rows = [angle(1e-9)]
    assert worst_outcome("bad", rows, ["a fault"])[1] == "at fault"
    assert worst_outcome("good", rows, [])[1] == "agrees"
    both = [*rows, angle(1.0, outcome=Outcome.DIFFERS)]
    assert worst_outcome("bad", both, ["a fault"])[1] == "differs"


def test_curves_of_other_settings_are_only_shown_if_nothing_judges_their_run():
    shown = angle(1e-3, "mujoco:default", allowed=None, outcome=Outcome.UNCHECKED)
    rate = replace(shown, channel="rate")
    failed = replace(rate, outcome=Outcome.DIVERGED)
    assert is_only_shown(shown, [shown, rate])
    assert not is_only_shown(shown, [shown, failed])
    judged = replace(angle(1e-9, "mujoco:default"), run="sweep")  # of another run
    assert is_only_shown(shown, [shown, judged])
    assert not is_only_shown(angle(1e-3, allowed=None, outcome=Outcome.UNCHECKED), [])


def history_of(*shares: float) -> History:
    """A history with one error of the pendulum's angle in each report."""
    history = History()
    for share in shares:
        history = extend_history(history, make_record(Result(comparisons=[angle(share)]), MADE))
    return history


def test_the_line_of_a_row_is_drawn_for_errors_that_change_and_says_from_what_to_what():
    assert trend_line(history_of(1e-9, 1.5e-9, 1.2e-9), [angle(1.2e-9)]) == ""
    shown = angle(5e-8, allowed=None, outcome=Outcome.UNCHECKED)
    assert trend_line(history_of(1e-9, 3e-9, 5e-8), [shown]) == ""  # nothing is judged
    line = trend_line(history_of(1e-9, 3e-9, 5e-8), [angle(5e-8)])
    assert "3 reports, 1e-9 to 5e-8 of the range" in line


def test_a_case_without_any_check_says_so():
    open_case = CASES["pendulum"].model_copy(update={"unchecked": False})
    rows = [angle(1e-9, allowed=None, outcome=Outcome.UNCHECKED)]
    assert list(failure_remarks(open_case, rows)) == ["Nothing of it was checked."]
    said = open_case.model_copy(update={"unchecked": True})
    assert list(failure_remarks(said, rows)) == []
    assert list(failure_remarks(open_case, [angle(1e-9)])) == []


def record_of(cases: list[str], rows: list) -> Record:
    return make_record(Result([CASES[name] for name in cases], rows, paths=(MODELS,)), MADE)


def changed_number(page: str) -> str:
    """The number of changed cases above the table."""
    return page.partition('data-outcome="changed"')[2].partition("<b>")[2].partition("<")[0]


def test_changed_cases_are_counted_once_and_new_ones_are_not_gone():
    rows = [angle(1e-6), replace(angle(1e-6), channel="rate")]
    result = Result([CASES["pendulum"]], rows, paths=(MODELS,))
    before = record_of(["pendulum"], [replace(c, error_max=c.error_max / 100) for c in rows])
    assert changed_number(index_text(result, before)) == "1"
    page = index_text(result, record_of(["fourbar"], []))
    assert "Not in this one: fourbar." in page
    assert changed_number(page) == "2"  # one is new, one is gone


def test_cases_that_an_unfinished_report_misses_are_not_gone():
    result = Result([CASES["pendulum"]], [angle(1e-6)], paths=(MODELS,))
    before = record_of(["pendulum", "fourbar"], [angle(1e-6)])
    page = index_text(result, before, missing=["fourbar"])
    assert "Missing: fourbar." in page
    assert "Not in this one" not in page
    assert changed_number(page) == "0"


def test_many_names_are_folded():
    result = Result([CASES["pendulum"]], [angle(1e-6)], paths=(MODELS,))
    page = index_text(result, missing=[f"m{k}" for k in range(12)])
    assert "m8, m9 <details" in page
    assert "<summary>and 2 more</summary>m10, m11</details>" in page
    assert "<summary>and" not in index_text(result, missing=[f"m{k}" for k in range(10)])


# ---- The first table of a page


def channel_facts(share: float | None, outcome: str, **more: Any) -> dict[str, Any]:
    """The facts of a channel, as `proofmass.report.case_data.case_data` has them."""
    facts = {"share": share, "outcome": outcome, "ratio": None, "at": 0.5, "later": None}
    return facts | {"allowed_share": 1e-6} | more


def cell_of(failed: dict[str, Any] | None = None, **channels: dict[str, Any]):
    """The cell of MuJoCo for these channels of a sweep."""
    solvers = {"mujoco": {"comparisons": channels}}
    run = {"solvers": solvers, "failed": failed or {}}
    return error_cell({"runs": {"sweep": run}}, "sweep", "mujoco", list(channels))


def test_a_cell_of_the_table_shows_what_differs_most():
    one = channel_facts(0.1, "differs", ratio=5.0)
    other = channel_facts(0.01, "differs", ratio=50.0)
    without = channel_facts(0.001, "differs")  # nothing is allowed: the ratio is infinite
    unclear = channel_facts(0.5, "undecided", ratio=900.0)
    assert cell_of(a=one, b=other).text == "0.01"
    assert cell_of(a=one, b=other, c=without).text == "1e-3"
    assert cell_of(a=unclear, b=one).text == "0.1"
    assert (cell_of(a=unclear).text, cell_of(a=unclear).note) == ("0.5", "undecided")
    assert cell_of(a=one).bad
    assert cell_of(a=unclear).bad


def test_a_judged_channel_is_shown_before_one_that_is_not():
    judged, other = channel_facts(1e-9, "agrees", ratio=1e-3), channel_facts(1e-2, "unchecked")
    found = cell_of(a=other, b=judged)
    assert (found.text, found.note, found.bad) == ("1e-9", "allowed 1e-6", False)
    assert found.width == 0.07
    assert cell_of(a=other).width is None
    nearer = channel_facts(1e-12, "agrees", ratio=0.9)  # nearer to what is allowed, and smaller
    assert cell_of(a=judged, b=nearer).text == "1e-12"


def test_an_error_of_the_start_alone_is_said_to_be_one():
    assert cell_of(a=channel_facts(1e-2, "unchecked", later=1e-3)).note == "at the start"
    assert cell_of(a=channel_facts(1e-2, "unchecked", later=9e-3)).note == "not checked"
    assert cell_of(a=channel_facts(1e-2, "unchecked")).note == "not checked"


def test_a_curve_without_a_number_is_linked_first():
    broken = channel_facts(None, "differs", at=0.25)
    found = cell_of(a=channel_facts(1e-9, "agrees"), b=broken, c=channel_facts(None, "differs"))
    assert (found.text, found.note, found.bad) == ("no number", "in b", True)
    assert found.link == "#sweep/mujoco/b@0.25"
    assert cell_of({"mujoco": {"outcome": "crashed"}}, a=broken).note == "crashed"


def test_a_run_has_a_row_for_curves_only_if_nothing_of_it_has_a_kind():
    comparisons = {"a": channel_facts(1e-9, "agrees")}
    run = {
        "channels": {"a": {"kind": "position"}},
        "solvers": {"mujoco": {"comparisons": comparisons}, "pymunk": {"comparisons": {}}},
        "failed": {"pymunk": {"outcome": "crashed"}},
    }
    data = {"solvers": {"mujoco": {}, "pymunk": {}}, "runs": {"sweep": run}}
    (found,) = overview_table(data)
    assert [row.kind for row in found.rows] == ["position"]
    (found,) = overview_table({**data, "runs": {"sweep": {**run, "channels": {}}}})
    assert [row.kind for row in found.rows] == ["curves"]


# ---- Groups


def parts_of(states: dict[str, str]) -> list[tuple[str, str, list[str]]]:
    """Family, part and names of the cards of some cases with these states, in their order."""
    cards = [{"name": name, "state": state} for name, state in states.items()]
    found = group_cards([CASES[name] for name in states], cards, [MODELS])
    return [
        (group["name"], part["name"], [card["name"] for card in part["cards"]])
        for group in found
        for part in group["parts"]
    ]


def test_groups_with_a_failure_come_first_and_recorded_curves_last():
    good = dict.fromkeys(("slider_crank", "rod_cantilever", "hacksaw_recorded", "fourbar"), "good")
    names = [(family, part) for family, part, _ in parts_of(good)]
    assert names[:2] == [("linkages", "fourbar"), ("linkages", "slider_crank")]
    assert names[2] == ("linkages", RECORDED_PART)
    assert names[3][0] == "rods"
    first, *_ = parts_of({**good, "rod_cantilever": "bad"})
    assert first[0] == "rods"
    first, *_ = parts_of({**good, "slider_crank": "bad"})
    assert first[1] == "slider_crank"


def test_a_group_has_the_state_of_its_worst_case_which_comes_first():
    cards = [
        {"name": name, "state": state}
        for name, state in {"a": "good", "c": "open", "b": "good", "d": "bad"}.items()
    ]
    case = CASES["fourbar"]
    (group,) = group_cards([case] * 4, cards, [MODELS])
    assert (group["state"], group["parts"][0]["state"]) == ("bad", "bad")
    assert [card["name"] for card in group["parts"][0]["cards"]] == ["d", "c", "a", "b"]
    (group,) = group_cards([case] * 3, cards[:3], [MODELS])
    assert group["state"] == "open"
    assert families.worst_state(cards[:1]) == "good"


def test_recorded_curves_are_described_as_such():
    assert describe_reference(CASES["hacksaw_recorded"]).startswith("Measured, or computed")


# ---- Trend and changes


def test_channels_of_a_trend_are_judged_ones_first_and_nearest_to_what_is_allowed():
    exact = angle(0.0, allowed=0.0)
    lost = angle(math.nan, allowed=None, outcome=Outcome.UNCHECKED)
    assert trend_order(angle(5e-7)) == (True, pytest.approx(0.5))
    assert trend_order(exact)[0] is False  # nothing is allowed, so there is no ratio
    assert trend_order(lost) == (False, math.inf)
    rows = [angle(1e-8), replace(angle(9e-7), channel="rate")]
    history = History()
    for _ in range(2):
        history = extend_history(history, make_record(Result(comparisons=rows), MADE))
    assert [row.channel for row in trend_of(history, CASES["pendulum"], rows).rows] == [
        "rate",
        "angle",
    ]


def test_a_row_of_a_trend_has_the_last_error_that_is_known_and_the_largest():
    history = history_of(1e-9, 8e-8)
    history = extend_history(history, make_record(Result(), MADE))  # a report without the case
    history = extend_history(history, make_record(Result(comparisons=[angle(2e-8)]), MADE))
    (row,) = trend_of(history, CASES["pendulum"], [angle(2e-8)]).rows
    assert (row.first, row.before, row.now, row.largest) == ("1e-9", "8e-8", "2e-8", "8e-8")
    assert row.growth == "÷ 4"


def test_a_factor_of_two_is_no_growth():
    assert [format_growth(1e-6, now) for now in (2e-6, 5e-7)] == ["", ""]
    assert [format_growth(1e-6, now) for now in (2.1e-6, 4e-7)] == ["× 2.1", "÷ 2.5"]


def changes_between(before: list, now: list) -> list[Change]:
    return find_changes(record_of(["pendulum"], before), record_of(["pendulum"], now))


def test_a_change_needs_a_factor_of_more_than_two_of_an_error_that_is_no_rounding():
    assert changes_between([angle(1e-9)], [angle(2e-9)]) == []
    assert [c.growth for c in changes_between([angle(1e-9)], [angle(4e-9)])] == [pytest.approx(4)]
    assert changes_between([angle(1e-15)], [angle(1e-13)]) == []
    assert len(changes_between([angle(1e-15)], [angle(1e-9)])) == 1  # one of them is no rounding
    (from_zero,) = changes_between([angle(0.0)], [angle(1e-9)])
    assert from_zero.growth == math.inf


def test_the_growth_of_a_changed_outcome_says_whether_it_is_better():
    good, bad = angle(1e-9), angle(1e-9, outcome=Outcome.DIFFERS)
    other = angle(1e-9, outcome=Outcome.UNCHECKED)
    assert [c.growth for c in changes_between([good], [bad])] == [math.inf]
    assert [c.growth for c in changes_between([bad], [good])] == [0.0]
    assert [c.growth for c in changes_between([good], [other])] == [1.0]


def test_a_new_case_is_one_change_and_not_one_of_each_channel():
    before, now = record_of([], []), record_of(["pendulum"], [angle(1e-9)])
    assert [change.sentence for change in find_changes(before, now)] == ["pendulum is new"]
    empty = record_of(["pendulum"], [])  # a case without results is there all the same
    assert [change.sentence for change in find_changes(empty, empty)] == []
    assert [change.sentence for change in find_changes(record_of([], []), empty)] == [
        "pendulum is new"
    ]


def test_cases_that_are_gone_come_before_errors_that_grew():
    before = record_of(["pendulum", "fourbar"], [angle(1e-9)])
    now = record_of(["pendulum"], [angle(1e-6)])
    assert [change.case for change in find_changes(before, now)] == ["fourbar", "pendulum"]


def test_the_line_of_changes_names_five_clauses_and_counts_the_others():
    def one(case: str, channel: str, growth: float) -> Change:
        return Change(case, "sweep", "mujoco", channel, "1", "2", growth)

    found = [one(f"c{k}", "x", 9.0) for k in range(6)]
    found += [one("c0", "y", 9.0), one("c0", "z", 0.1)]
    line = format_changes(record_of([], []), found)
    assert "8 changes: c0 sweep mujoco x: 1 before, 2 now (and 1 more channel); c1" in line
    assert line.endswith("; and 2 more")  # c5, and what is better of c0


def test_the_index_of_the_shipped_rows_has_no_line_of_a_first_report():
    assert "trend-link" not in index_text(result_for_index())
