"""What the clock can tell apart: intervals of wall times, ties, and whether a machine was busy.

Repeated timings of a setting differ, most of all on a machine that has other work.  The interval of
a setting goes from its least to its greatest wall time.  Settings whose intervals overlap are tied:
the study does not tell which of them is cheaper.
"""

import re
from collections.abc import Iterable, Sequence
from statistics import median
from typing import NamedTuple

from proofmass.studies.record import StudyRow
from proofmass.studies.trade.verdict import able
from proofmass.wording import number

LOADED = 1.25
"""Load average over processors from which on runs wait: a study itself has one run a processor."""
TAKEN = 0.05
"""Share of a run's time that its processor gave to others, from which on the run was disturbed."""
APART = 1.5
"""Greatest over least wall time of a usual setting from which on a machine was busy; settings along
a series are a factor of two apart."""
SEVERAL = 0.1
"""Share of the settings that must be disturbed before a machine is called busy."""


class Interval(NamedTuple):
    """Least, stated and greatest wall time of a setting [s]."""

    low: float
    stated: float
    high: float

    def overlaps(self, other: "Interval") -> bool:
        """Whether the clock does not tell the two apart.

        >>> Interval(1.0, 1.0, 2.0).overlaps(Interval(1.9, 1.9, 3.0))
        True
        """
        return self.low <= other.high and other.low <= self.high


def usual_spread(rows: Iterable[StudyRow]) -> float:
    """Greatest over least wall time of the middle one of all settings that were repeated; or 1."""
    found = [max(row.repeats) / min(row.repeats) for row in rows if len(row.repeats) > 1]
    return median(found) if found else 1.0


def interval(row: StudyRow, usual: float) -> Interval:
    """The wall times of a setting; a single one may be so much too long as is usual."""
    if len(row.repeats) > 1:
        return Interval(min(row.repeats), row.seconds, max(row.repeats))
    return Interval(row.seconds / usual, row.seconds, row.seconds)


def ties(rows: Iterable[StudyRow], chosen: StudyRow, usual: float) -> list[StudyRow]:
    """Settings that the clock does not tell from a chosen one, which is none of them."""
    own = interval(chosen, usual)
    return [
        row
        for row in rows
        if row is not chosen and row.seconds > 0 and own.overlaps(interval(row, usual))
    ]


def perhaps(rows: Iterable[StudyRow], kind: str, usual: float) -> list[StudyRow]:
    """Settings that no other betters for certain: none as close has all its times below theirs.

    Where times are known exactly these are the front.
    """
    timed = [(row, row.errors[kind], interval(row, usual)) for row in able(rows, kind)]
    return [
        row
        for row, error, own in timed
        if not any(
            e <= error and span.high <= own.low and (e < error or span.high < own.low)
            for _, e, span in timed
        )
    ]


def band(rows: Iterable[StudyRow], kind: str, usual: float) -> list[tuple[float, float, float]]:
    """Between what the front lies: errors, rising, each with least and greatest cost to reach it.

    The cost of an error lies between the least of the lower and the least of the upper ends of all
    intervals of settings that are as close.
    """
    timed = sorted((row.errors[kind], *interval(row, usual)) for row in able(rows, kind))
    found = list[tuple[float, float, float]]()
    low = high = float("inf")
    for error, least, _, most in timed:
        if least < low or most < high:
            low, high = min(low, least), min(high, most)
            found.append((error, low, high))
    return found


PROCESSORS = re.compile(r" x (\d+)$")


def processors(machine: str) -> int:
    """How many processors a machine has, by `StudyRow.machine`; 0 where that does not say.

    >>> processors("Some Processor x 2"), processors("")
    (2, 0)
    """
    found = PROCESSORS.search(machine)
    return int(found[1]) if found else 0


def busy(rows: Sequence[StudyRow]) -> list[str]:
    """Why the wall times of a study are uncertain, a sentence each; none of a machine at rest."""
    timed = [row for row in rows if row.repeats]
    words = []
    loaded = [row for row in timed if (n := processors(row.machine)) and row.load > LOADED * n]
    if len(loaded) > SEVERAL * len(timed):
        most = max(loaded, key=lambda row: row.load)
        words.append(
            f"The load average was up to {number(most.load, 2)} on {processors(most.machine)} "
            f"processors while {len(loaded)} of {len(timed)} settings were timed."
        )
    taken = [row.shared for row in timed if row.shared > TAKEN]
    if len(taken) > SEVERAL * len(timed):
        words.append(
            f"Of the best runs of {len(taken)} of {len(timed)} settings the processor gave more "
            f"than {number(100 * TAKEN)} % of the time to others, at most "
            f"{number(100 * max(taken), 2)} %."
        )
    if (usual := usual_spread(timed)) > APART:
        words.append(
            "Repeated wall times of the same setting differ by a factor of "
            f"{number(usual, 2)} (median of all settings)."
        )
    return words
