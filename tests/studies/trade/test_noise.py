"""Noise of processor times: intervals, tied settings, the possible front, and busy machines."""

from dataclasses import replace

import pytest

from proofmass.studies.record import StudyRow
from proofmass.studies.trade.noise import (
    Interval,
    explain_busy_machine,
    front_band,
    possible_front,
    tied_settings,
    time_interval,
    usual_spread,
)
from proofmass.studies.trade.verdict import pareto_front

MACHINE = "Processor x 2"


def timed_row(error: float, *seconds: float, **more: object) -> StudyRow:
    """A setting with an error and repeated processor times."""
    row = StudyRow("trade", "", "", "mujoco", "", "timestep", 1.0, machine=MACHINE)
    return replace(row, errors={"position": error}, seconds=min(seconds), repeats=seconds, **more)


def test_an_interval_goes_from_the_least_to_the_greatest_wall_time() -> None:
    assert time_interval(timed_row(1.0, 3.0, 2.0, 5.0), 9.0) == Interval(2.0, 2.0, 5.0)
    # a single processor time may be too long by the usual spread, but not too short
    assert time_interval(timed_row(1.0, 3.0), 1.5) == Interval(2.0, 3.0, 3.0)


def test_the_usual_spread_is_that_of_the_median_setting() -> None:
    rows = [
        timed_row(1.0, 1.0, 1.1),
        timed_row(1.0, 1.0, 1.3),
        timed_row(1.0, 1.0, 9.0),
        timed_row(1.0, 4.0),
    ]
    assert usual_spread(rows) == pytest.approx(1.3)
    assert usual_spread([timed_row(1.0, 4.0)]) == 1.0


def test_settings_whose_intervals_overlap_are_tied() -> None:
    best, near, far = timed_row(1.0, 1.0, 2.0), timed_row(1.0, 1.9, 3.0), timed_row(1.0, 2.1, 3.0)
    assert tied_settings([best, near, far], best, 1.0) == [near]
    assert tied_settings([best, near, far], near, 1.0) == [best, far]


def test_the_possible_front_includes_settings_tied_with_the_front() -> None:
    cheap, tied = timed_row(1e-3, 1.0, 1.5), timed_row(2e-3, 1.2, 1.6)
    worse, close = timed_row(2e-3, 1.6, 1.7), timed_row(1e-4, 9.0, 9.5)
    rows = [cheap, tied, worse, close]
    assert pareto_front(rows, "position") == [cheap, close]
    assert possible_front(rows, "position", 1.0) == [cheap, tied, close]
    assert set(map(id, pareto_front(rows, "position"))) <= set(
        map(id, possible_front(rows, "position", 1.0))
    )


def test_the_possible_front_of_exact_wall_times_is_the_front() -> None:
    times_and_errors = ((1.0, 1e-2), (2.0, 1e-2), (2.0, 1e-3), (3.0, 5e-3), (4.0, 1e-4))
    rows = [timed_row(error, seconds) for seconds, error in times_and_errors]
    assert possible_front(rows, "position", 1.0) == pareto_front(rows, "position")
    assert pareto_front(rows, "position") == [rows[0], rows[2], rows[4]]


def test_the_front_lies_in_its_band() -> None:
    rows = [timed_row(1e-3, 1.0, 3.0), timed_row(2e-3, 1.2, 1.6), timed_row(1e-4, 9.0, 9.5)]
    assert front_band(rows, "position", 1.0) == [
        (1e-4, 9.0, 9.5),
        (1e-3, 1.0, 3.0),
        (2e-3, 1.0, 1.6),
    ]


ROWS_OF_QUIET_MACHINE = [timed_row(1.0, 1.0, 1.1, load=2.2, shared=0.01) for _ in range(10)]


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"load": 5.0}, "The load average was up to 5 on 2 processors while 10 of 10"),
        ({"shared": 0.3}, "the processor gave more than 5 % of the time to others, at most 30 %"),
        ({"repeats": (1.0, 2.0)}, "differ by a factor of 2 (median of all settings)"),
    ],
)
def test_a_busy_machine_is_reported(changed: dict[str, object], words: str) -> None:
    assert explain_busy_machine(ROWS_OF_QUIET_MACHINE) == []
    (said,) = explain_busy_machine([replace(row, **changed) for row in ROWS_OF_QUIET_MACHINE])
    assert words in said


def test_a_single_disturbed_setting_does_not_make_a_machine_busy() -> None:
    assert (
        explain_busy_machine(
            [*ROWS_OF_QUIET_MACHINE, replace(ROWS_OF_QUIET_MACHINE[0], load=9.0, shared=0.5)]
        )
        == []
    )


def test_rows_without_a_load_report_no_busy_machine() -> None:
    assert (
        explain_busy_machine([replace(row, load=float("nan")) for row in ROWS_OF_QUIET_MACHINE])
        == []
    )
