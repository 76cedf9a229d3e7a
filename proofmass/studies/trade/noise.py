"""Noise of processor times: intervals of repeated timings, ties, and whether a machine was busy.

Repeated timings of a setting differ, most of all on a machine that has other work.  The interval of
a setting goes from its shortest to its longest processor time.  Settings whose intervals overlap
are tied: the study cannot say which of them is cheaper.
"""

import re
from collections.abc import Iterable, Sequence
from statistics import median
from typing import NamedTuple

from proofmass.base.wording import number
from proofmass.studies.record import StudyRow
from proofmass.studies.trade.verdict import comparable_settings

BUSY_LOAD = 1.25
"""Load average per processor above which runs wait; the study itself runs one on each processor."""
DISTURBED_SHARE = 0.05
"""Share of a run's time that its processor gave to others, above which the run was disturbed."""
BUSY_SPREAD = 1.5
"""Longest over shortest processor time of the median setting, above which the machine was busy;
settings next to each other in a series differ by a factor of two."""
BUSY_SHARE = 0.1
"""Share of the settings that must be disturbed for the machine to be called busy."""


class Interval(NamedTuple):
    """Shortest, stated and longest processor time of a setting [s]."""

    low: float
    stated: float
    high: float

    def overlaps(self, other: "Interval") -> bool:
        """Whether two intervals overlap, so that the settings are tied.

        >>> Interval(1.0, 1.0, 2.0).overlaps(Interval(1.9, 1.9, 3.0))
        True
        """
        return self.low <= other.high and other.low <= self.high


def usual_spread(rows: Iterable[StudyRow]) -> float:
    """Longest over shortest processor time, median of all settings that were repeated; 1 without
    any."""
    found = [max(row.repeats) / min(row.repeats) for row in rows if len(row.repeats) > 1]
    return median(found) if found else 1.0


def time_interval(row: StudyRow, spread: float) -> Interval:
    """Interval of a setting's processor times; a single one may be too long by the factor
    `spread`."""
    if len(row.repeats) > 1:
        return Interval(min(row.repeats), row.seconds, max(row.repeats))
    return Interval(row.seconds / spread, row.seconds, row.seconds)


def tied_settings(rows: Iterable[StudyRow], chosen: StudyRow, spread: float) -> list[StudyRow]:
    """Settings other than the chosen one that are tied with it."""
    own = time_interval(chosen, spread)
    return [
        row
        for row in rows
        if row is not chosen and row.seconds > 0 and own.overlaps(time_interval(row, spread))
    ]


def possible_front(rows: Iterable[StudyRow], kind: str, spread: float) -> list[StudyRow]:
    """Settings that may be on the front: no setting with an error as small is faster for certain.

    One setting is faster than another for certain if its longest processor time is below the
    other's shortest.  If each setting has one exact time, these settings are the front.
    """
    timed = [
        (row, row.errors[kind], time_interval(row, spread))
        for row in comparable_settings(rows, kind)
    ]
    return [
        row
        for row, error, own in timed
        if not any(
            e <= error and span.high <= own.low and (e < error or span.high < own.low)
            for _, e, span in timed
        )
    ]


def front_band(
    rows: Iterable[StudyRow], kind: str, spread: float
) -> list[tuple[float, float, float]]:
    """Band in which the front lies: rising errors, each with bounds of the cost to reach it [s].

    Of the intervals of all settings with an error as small, the bounds are the least lower end and
    the least upper end.
    """
    timed = sorted(
        (row.errors[kind], *time_interval(row, spread)) for row in comparable_settings(rows, kind)
    )
    found = list[tuple[float, float, float]]()
    low = high = float("inf")
    for error, shortest, _, longest in timed:
        if shortest < low or longest < high:
            low, high = min(low, shortest), min(high, longest)
            found.append((error, low, high))
    return found


PROCESSORS_PATTERN = re.compile(r" x (\d+)$")


def count_processors(machine: str) -> int:
    """Number of processors of a machine, from the text of `StudyRow.machine`; 0 if it has none.

    >>> count_processors("Some Processor x 2"), count_processors("")
    (2, 0)
    """
    found = PROCESSORS_PATTERN.search(machine)
    return int(found[1]) if found else 0


def explain_busy_machine(rows: Sequence[StudyRow]) -> list[str]:
    """Sentences on why the processor times of a study are uncertain; none if the machine was
    idle."""
    timed = [row for row in rows if row.repeats]
    words = []
    loaded = [
        row for row in timed if (n := count_processors(row.machine)) and row.load > BUSY_LOAD * n
    ]
    if len(loaded) > BUSY_SHARE * len(timed):
        most_loaded = max(loaded, key=lambda row: row.load)
        words.append(
            f"The load average was up to {number(most_loaded.load, 2)} on "
            f"{count_processors(most_loaded.machine)} processors while {len(loaded)} of "
            f"{len(timed)} settings were timed."
        )
    shares = [row.shared for row in timed if row.shared > DISTURBED_SHARE]
    if len(shares) > BUSY_SHARE * len(timed):
        words.append(
            f"Of the best runs of {len(shares)} of {len(timed)} settings the processor gave more "
            f"than {number(100 * DISTURBED_SHARE)} % of the time to others, at most "
            f"{number(100 * max(shares), 2)} %."
        )
    if (spread := usual_spread(timed)) > BUSY_SPREAD:
        words.append(
            "Repeated processor times of the same setting differ by a factor of "
            f"{number(spread, 2)} (median of all settings)."
        )
    return words
