"""Laws of the ranking of engines at equal cost, with errors and times that are formulas."""

from dataclasses import replace
from itertools import pairwise
from math import inf, isnan

import pytest

from proofmass.studies.engines.ranking import (
    CaseStanding,
    ComparedCase,
    error_in_time,
    points_by_series,
    rank_case,
    rank_engines,
    time_for_error,
    widened_time,
)
from proofmass.studies.record import StudyRow
from tests.studies.trade.trade_rows import SPAN, STEPS, series_rows

SCALE = 100.0
"""Error of a step of 1 s, so that the steps of the rows have errors from 2.6e-2 to 3.9e-7."""


def rows_of(
    engine: str, cost: float = 1e-5, case: str = "fourbar", **more: float
) -> list[StudyRow]:
    """The rows of an engine, of second order, with a cost of each step [s]."""
    return [
        replace(row, case=case)
        for row in series_rows(engine, engine, 2.0, SCALE, cost=cost, **more)
    ]


def failed(engine: str, outcome: str, message: str) -> StudyRow:
    """The row of an engine without a run."""
    row = StudyRow("trade", "fourbar", "dynamics", engine, engine, "timestep", 1e-3)
    return replace(row, outcome=outcome, message=message)


def standings(
    *rows: list[StudyRow], error: float = 1e-3, spread: float = 1.0
) -> list[CaseStanding]:
    """Where engines stand in a case."""
    case = ComparedCase("fourbar", SPAN, [row for own in rows for row in own])
    return rank_case(case, "position", error, spread)


@pytest.mark.parametrize("error", [1e-3, 1e-6, 3e-5])
def test_an_engine_that_is_twice_as_slow_with_equal_errors_ranks_behind(error: float) -> None:
    """Its time is twice that of the first, at every error."""
    fast, slow = standings(rows_of("drake", 2e-5), rows_of("mujoco", 1e-5), error=error)
    assert (fast.engine, slow.engine, fast.rank, slow.rank) == ("mujoco", "drake", 1, 2)
    assert slow.ratio.stated == pytest.approx(2.0)
    assert (fast.tied, slow.tied) == ((), ())
    assert fast.ratio == (1.0, 1.0, 1.0)
    # equal time is halfway between the two times, and both engines are of second order
    assert slow.in_equal_time.stated == pytest.approx(2 * error)
    assert fast.in_equal_time.stated == pytest.approx(error / 2)


def test_a_faster_engine_turns_the_ranking() -> None:
    """The same rows with other times have the other order."""
    slow = rows_of("drake", 2e-5)
    fast = [replace(r, seconds=r.seconds / 4, repeats=(r.seconds / 4,) * 5) for r in slow]
    assert [one.engine for one in standings(slow, rows_of("mujoco"))] == ["mujoco", "drake"]
    assert [one.engine for one in standings(fast, rows_of("mujoco"))] == ["drake", "mujoco"]


def test_smaller_errors_turn_the_ranking() -> None:
    """With equal times the engine whose errors are a sixteenth needs a quarter of the time."""
    better = [
        replace(row, errors={"position": row.errors["position"] / 16}) for row in rows_of("drake")
    ]
    first, second = standings(rows_of("mujoco"), better, error=1e-5)
    assert (first.engine, second.rank) == ("drake", 2)
    assert second.ratio.stated == pytest.approx(4.0)


@pytest.mark.parametrize(("noise", "ranks"), [(1.1, (1, 1)), (1.01, (1, 2))])
def test_what_lies_within_the_noise_is_a_tie(noise: float, ranks: tuple[int, int]) -> None:
    """An engine that is slower by 3 % is behind only if timings repeat more closely than that."""
    two = [
        [replace(row, repeats=(row.seconds, noise * row.seconds)) for row in rows_of(engine, cost)]
        for engine, cost in (("mujoco", 1e-5), ("drake", 1.03e-5))
    ]
    found = standings(*two)
    assert tuple(one.rank for one in found) == ranks
    assert [one.tied for one in found] == ([("drake",), ("mujoco",)] if ranks[1] == 1 else [(), ()])


def test_the_usual_noise_counts_for_settings_that_repeat_well_by_luck() -> None:
    """Times of one setting that are equal by chance do not make a difference of 3 % certain."""
    two = rows_of("mujoco", 1e-5), rows_of("drake", 1.03e-5)
    assert [one.rank for one in standings(*two, spread=1.0)] == [1, 2]
    assert [one.rank for one in standings(*two, spread=1.1)] == [1, 1]


@pytest.mark.parametrize("error", [7e-3, 1e-3, 2e-5, 1e-6])
def test_a_time_between_settings_is_that_of_the_formula(error: float) -> None:
    """Error = SCALE h^2 and time = cost / h have a straight line of logarithms."""
    case = ComparedCase("fourbar", SPAN, rows_of("mujoco"))
    lines = points_by_series(case, "mujoco", "position", 1.0)
    found, _ = time_for_error(lines, error)
    wanted = 1e-5 / (error / SCALE) ** 0.5
    assert found.stated == pytest.approx(wanted, rel=2e-3)  # whole numbers of steps
    assert error_in_time(lines, found.stated).stated == pytest.approx(error, rel=1e-9)


def test_smaller_errors_take_no_less_time() -> None:
    """Whatever the settings are: each engine has one falling line."""
    rows = [*rows_of("mujoco"), *series_rows("RK4", "mujoco", 4.0, 1e4, 1e-6, 4e-5)]
    lines = points_by_series(ComparedCase("a", SPAN, rows), "mujoco", "position", 1.2)
    errors = [10.0 ** (-k / 4) for k in range(4, 26)]
    found = [time_for_error(lines, error) for error in errors]
    for coarse, fine in pairwise(one[0] for one in found if one):
        assert coarse.stated <= fine.stated
        assert fine.low <= fine.stated <= fine.high
    times = [one[0].stated for one in found if one]
    reached = [error_in_time(lines, time).stated for time in times]
    assert reached == sorted(reached, reverse=True)
    assert all(have <= error * (1 + 1e-9) for have, error in zip(reached, errors, strict=False))


def test_a_sudden_drop_is_no_line() -> None:
    """Between a wrong motion and a constraint that is exact there are no settings to read off."""
    rows = [
        replace(row, errors={"position": error})
        for row, error in zip(rows_of("mujoco")[:2], (0.5, 1e-15), strict=True)
    ]
    case = ComparedCase("a", SPAN, rows)
    lines = points_by_series(case, "mujoco", "position", 1.0)
    found, row = time_for_error(lines, 1e-3)
    assert found.stated == rows[1].seconds / SPAN
    assert row is rows[1]


def test_engines_that_fail_keep_their_rows() -> None:
    """Each has a word and a reason, and no rank."""
    floor = series_rows("soft", "pymunk", 2.0, SCALE, floor=5e-3)
    found = standings(
        rows_of("mujoco"),
        floor,
        [failed("bullet", "unsupported", "contacts of geoms")],
        [failed("drake", "diverged", "a loop came open")],
        [failed("box2d", "crashed", "signal 11")],
    )
    by_engine = {one.engine: one for one in found}
    assert len(by_engine) == 5
    assert [by_engine[e].state for e in ("mujoco", "pymunk", "bullet", "drake", "box2d")] == [
        *("reached", "not reached", "unsupported", "diverged", "crashed")
    ]
    assert by_engine["bullet"].words == "contacts of geoms"
    assert by_engine["pymunk"].words.startswith("smallest error 5e-3: ")
    assert [one.rank for one in found] == [1, 0, 0, 0, 0]
    assert all(one.time.stated == inf for one in found[1:])
    assert found[0].engine == "mujoco"


def test_what_ends_a_series_is_said() -> None:
    """A floor, a run that takes too long, or the last setting."""
    case = ComparedCase("a", SPAN, rows_of("mujoco"))
    last = case.rows[-1]
    (slow,) = rank_case(case, "position", 1e-9, 1.0, budget=0.5 * last.seconds)
    (ended,) = rank_case(case, "position", 1e-9, 1.0, budget=2 * last.seconds)
    assert "after a run of more than" in slow.words
    assert "at the finest setting of its series" in ended.words
    worse = replace(last, errors={"position": 1.0})
    (flat,) = rank_case(ComparedCase("a", SPAN, [*case.rows, worse]), "position", 1e-9, 1.0)
    assert "finer settings have no smaller error" in flat.words
    (none,) = rank_case(case, "force", 1e-3, 1.0)
    assert (none.state, none.rank) == ("no such channel", 0)


def test_an_error_that_nobody_reaches_has_no_first() -> None:
    """No engine is ranked, and none is left out."""
    found = standings(rows_of("mujoco"), rows_of("drake"), error=1e-12)
    assert [one.rank for one in found] == [0, 0]
    assert all(isnan(one.equal_time) for one in found)
    assert all(one.rank == 0 for one in rank_engines(found))


def test_medians_over_cases_count_what_is_not_reached_as_infinite() -> None:
    """Twice as slow in two cases and refused in the third: 2 in the median, reached in two."""
    found = []
    for case in ("one", "two", "three"):
        slow = rows_of("drake", 2e-5, case)
        if case == "three":
            slow = [replace(failed("drake", "unsupported", "springs"), case=case)]
        rows = [*rows_of("mujoco", 1e-5, case), *slow]
        found += rank_case(ComparedCase(case, SPAN, rows), "position", 1e-3, 1.0)
    first, second = rank_engines(found)
    assert (first.engine, first.rank, first.first, first.reached) == ("mujoco", 1, 3, 3)
    assert second.ratio.stated == pytest.approx(2.0)
    assert (second.rank, second.first, second.reached, second.cases) == (2, 0, 2, 3)
    assert second.lost == {"unsupported": ["three"]}
    fewer = [one for one in found if one.case != "one"]
    assert rank_engines(fewer)[1].rank == 0  # reached in half of the cases alone


def test_an_engine_without_a_setting_as_fast_has_no_error_in_equal_time() -> None:
    """Its fastest setting takes longer than equal time: this is said, and is no number."""
    slow = rows_of("drake", 1e-2)
    found = standings(slow, rows_of("mujoco"), rows_of("pymunk", 1.1e-5))
    assert [isnan(one.in_equal_time.stated) for one in found] == [False, False, True]
    assert [one.in_equal_time == inf for one in rank_engines(found)] == [False, False, True]


def test_a_tie_in_the_median_is_a_tie_over_cases() -> None:
    """Engines within the noise of each other in all cases share the first place."""
    found = [
        one
        for case in ("one", "two")
        for one in rank_case(
            ComparedCase(
                case, SPAN, rows_of("mujoco", 1e-5, case) + rows_of("drake", 1.03e-5, case)
            ),
            "position",
            1e-3,
            1.1,
        )
    ]
    assert [(one.rank, one.tied) for one in rank_engines(found)] == [
        (1, ("drake",)),
        (1, ("mujoco",)),
    ]


def test_times_are_over_the_simulated_time() -> None:
    """A run of twice the duration at the same time is twice as fast."""
    row = rows_of("mujoco")[0]
    assert row.seconds == pytest.approx(1e-5 * SPAN / STEPS[0], rel=1e-2)
    one, two = (widened_time(row, 1.0, duration).stated for duration in (1.0, 2.0))
    assert one == 2 * two == row.seconds
