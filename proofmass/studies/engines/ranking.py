"""Engines ranked at equal cost: the time that each needs for an error, and its error in equal time.

    case = ComparedCase("fourbar", 6.28, rows)             # all settings of all engines
    standings = rank_case(case, "position", 1e-3, spread)  # in one case
    ranked = rank_engines(standings)                       # over all cases

A time is the processor time of the steps over the simulated time.  It has an interval, from the
shortest to the longest of its repeats, and at least as wide as repeats usually differ.  Engines
whose intervals overlap are tied: an engine ranks behind those alone that are faster for certain.
An engine without a run, or without an error as small, keeps its row, with the reason.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import exp, inf, isfinite, log
from statistics import median

from proofmass.base.grouping import group_by
from proofmass.base.wording import number
from proofmass.studies.record import NAN, StudyRow
from proofmass.studies.trade.noise import Interval
from proofmass.studies.trade.words import format_setting_briefly
from proofmass.verdict.outcome import Outcome

SMALLEST_ERROR = 1e-17
"""Error that counts for a curve without any, of which there is no logarithm: less than a rounding
of the range."""
LARGEST_DROP = 100.0
"""Ratio of the errors of two neighbours in a series up to which settings between them are read off
a line.  Halving a step of fifth order divides the error by 32; a larger drop is a change of the
motion, or a constraint that becomes exact, and no order."""


@dataclass(frozen=True)
class ComparedCase:
    """A case with all measured settings of all engines.

    Attributes
    ----------
    case : str
    duration : float
        Simulated time, up to which errors are judged [s].
    rows : sequence of StudyRow
        The settings of a series follow each other, from coarse to fine.
    motion : str
        How its motion responds to a disturbed start, if it is chaotic or sensitive.
    """

    case: str
    duration: float
    rows: Sequence[StudyRow]
    motion: str = ""

    @property
    def engines(self) -> list[str]:
        """All engines, those without a run as well."""
        return list(dict.fromkeys(row.engine for row in self.rows))

    def of(self, engine: str) -> list[StudyRow]:
        """The settings of an engine."""
        return [row for row in self.rows if row.engine == engine]


@dataclass(frozen=True)
class SettingPoint:
    """A measured setting: error over the range [1], time per simulated second [s], and row."""

    error: float
    time: Interval
    row: StudyRow


@dataclass(frozen=True)
class CaseStanding:
    """Where an engine stands in a case, for an error.

    Attributes
    ----------
    case, engine : str
    error : float
        The error that is asked for, as a share of the range of the reference [1].
    state : str
        ``reached``, ``not reached``, ``no such channel``, or the outcome of its runs.
    words : str
        The setting that reaches the error, or why there is none.
    time : Interval
        Time for the error per simulated second [s]; infinite if it is not reached.
    ratio : Interval
        That time over the time of the first engine [1].
    rank : int
        1 + number of engines that are faster for certain; 0 if the error is not reached.
    tied : tuple of str
        Other engines of the same rank, or with a time that may be the same.
    equal_time : float
        The median of the times in which engines reach the error, per simulated second [s]; NaN if
        none does.
    in_equal_time : Interval
        Its error in that time, as a share of the range [1]; NaN if no setting is as fast.
    best, best_time : float
        Its smallest error [1], and the time of that setting per simulated second [s].
    """

    case: str
    engine: str
    error: float
    state: str
    words: str
    time: Interval
    ratio: Interval
    rank: int
    tied: tuple[str, ...]
    equal_time: float
    in_equal_time: Interval
    best: float
    best_time: float

    @property
    def is_reached(self) -> bool:
        """Whether a setting of the engine has an error as small."""
        return self.state == REACHED


REACHED, NOT_REACHED, NO_CHANNEL = "reached", "not reached", "no such channel"
NEVER = Interval(inf, inf, inf)
UNKNOWN = Interval(NAN, NAN, NAN)


def widened_time(row: StudyRow, spread: float, duration: float) -> Interval:
    """The time of a setting per simulated second [s], as uncertain as repeated timings show it.

    The interval goes from the shortest to the longest timing.  It is at least as wide as the
    factor `spread`, by which those of one setting usually differ: up from repeated ones, of which
    the least counts, and down from a single one.

    >>> row = StudyRow("", "", "", "", "", "", 1.0, seconds=2.0, repeats=(2.0, 2.1))
    >>> widened_time(row, 1.5, 4.0)
    Interval(low=0.5, stated=0.5, high=0.75)
    """
    low = high = row.seconds
    if len(row.repeats) > 1:
        high = max(*row.repeats, spread * row.seconds)
    else:
        low = row.seconds / spread
    return Interval(low / duration, row.seconds / duration, high / duration)


def points_by_series(
    case: ComparedCase, engine: str, kind: str, spread: float
) -> list[list[SettingPoint | None]]:
    """The settings of an engine by series, from coarse to fine; None for one without an error."""
    return [
        [
            SettingPoint(
                max(row.errors[kind], SMALLEST_ERROR),
                widened_time(row, spread, case.duration),
                row,
            )
            if row.outcome == Outcome.RAN and isfinite(row.errors.get(kind, NAN)) and row.seconds
            else None
            for row in own
        ]
        for own in group_by(case.of(engine), lambda row: row.series).values()
    ]


def neighbours(
    series: Sequence[SettingPoint | None],
) -> Iterator[tuple[SettingPoint, SettingPoint]]:
    """Neighbours between which settings are read off a line: the finer is better, and slower."""
    for coarse, fine in pairwise(series):
        if (
            coarse is not None
            and fine is not None
            and fine.error < coarse.error <= LARGEST_DROP * fine.error
            and coarse.time.stated < fine.time.stated
        ):
            yield coarse, fine


def between(one: float, two: float, share: float) -> float:
    """The number at a share of the way from one to the other on a logarithmic axis.

    >>> round(between(1.0, 100.0, 0.5), 12)
    10.0
    """
    return exp((1 - share) * log(one) + share * log(two))


def time_for_error(
    lines: Iterable[Sequence[SettingPoint | None]], error: float
) -> tuple[Interval, StudyRow] | None:
    """The least time in which series reach an error, and the setting next to it that does.

    Between neighbours of a series the time is read off a straight line of logarithms.  None if no
    setting has an error as small.
    """
    found = [
        (point.time, point.row)
        for series in lines
        for point in series
        if point is not None and point.error <= error
    ]
    for series in lines:
        for coarse, fine in neighbours(series):
            if fine.error <= error < coarse.error:
                share = log(coarse.error / error) / log(coarse.error / fine.error)
                pairs = zip(coarse.time, fine.time, strict=True)
                found.append((Interval(*(between(a, b, share) for a, b in pairs)), fine.row))
    if not found:
        return None
    stated, row = min(found, key=lambda one: one[0].stated)
    least, most = min(time.low for time, _ in found), min(time.high for time, _ in found)
    return Interval(least, stated.stated, most), row


def error_in_time(lines: Sequence[Sequence[SettingPoint | None]], time: float) -> Interval:
    """The smallest error that series have in a time per simulated second [s]; NaN without any.

    The interval is that with all timings the shortest and the longest that they may be.
    """
    found = [error_with(lines, time, which) for which in ("low", "stated", "high")]
    low, stated, high = (NAN if error == inf else error for error in found)
    return Interval(low, stated, high)


def error_with(lines: Iterable[Sequence[SettingPoint | None]], time: float, which: str) -> float:
    """The smallest error in a time, with one end of the intervals of the timings."""
    least = inf
    for series in lines:
        for point in series:
            if point is not None and getattr(point.time, which) <= time:
                least = min(least, point.error)
        for coarse, fine in neighbours(series):
            slow, fast = getattr(fine.time, which), getattr(coarse.time, which)
            if fast <= time < slow:
                share = log(time / fast) / log(slow / fast)
                least = min(least, between(coarse.error, fine.error, share))
    return least


def rank_case(
    case: ComparedCase, kind: str, error: float, spread: float, budget: float = inf
) -> list[CaseStanding]:
    """Where all engines stand in a case, for an error of a kind; the fastest first.

    Parameters
    ----------
    case : ComparedCase
    kind : str
        The kind of error, such as position.
    error : float
        As a share of the range of the reference [1].
    spread : float
        Usual ratio of the longest to the shortest timing of a setting [1].
    budget : float
        Processor time of a run after which a series ended [s].
    """
    lines = {one: points_by_series(case, one, kind, spread) for one in case.engines}
    found = {one: time_for_error(lines[one], error) for one in case.engines}
    times = {one: reached[0] for one, reached in found.items() if reached}
    first = min(times.values(), key=lambda time: time.stated, default=UNKNOWN)
    equal_time = log_median(time.stated for time in times.values())
    standings = []
    for engine in case.engines:
        own, best = times.get(engine, NEVER), smallest_error(lines[engine])
        others = {one: time for one, time in times.items() if one != engine}
        standings.append(
            CaseStanding(
                case.case,
                engine,
                error,
                *explain_time(found[engine], case.of(engine), kind, best, budget),
                own,
                ratio_to_first(own, first),
                rank_among(own, others.values()),
                tuple(one for one, time in others.items() if is_tied(own, time)),
                equal_time,
                error_in_time(lines[engine], equal_time),
                best.error if best else NAN,
                best.time.stated if best else NAN,
            )
        )
    return sorted(standings, key=lambda one: (one.time.stated, not one.best < inf, one.best))


def smallest_error(lines: Iterable[Sequence[SettingPoint | None]]) -> SettingPoint | None:
    """The setting with the smallest error, the fastest of equal ones; None if none has an error."""
    points = [point for series in lines for point in series if point is not None]
    return min(points, key=lambda point: (point.error, point.time.stated), default=None)


def explain_time(
    reached: tuple[Interval, StudyRow] | None,
    rows: Sequence[StudyRow],
    kind: str,
    best: SettingPoint | None,
    budget: float,
) -> tuple[str, str]:
    """A state, and the setting that reaches an error or the reason why there is none."""
    if reached:
        return REACHED, format_setting_briefly(reached[1])
    return explain_missing(rows, kind, best, budget)


def ratio_to_first(own: Interval, first: Interval) -> Interval:
    """A time over that of the first engine, whose interval counts as well.

    >>> ratio_to_first(Interval(2.0, 2.0, 3.0), Interval(1.0, 1.0, 1.5)).low
    1.3333333333333333
    """
    if own == first:
        return Interval(1.0, 1.0, 1.0)
    if not own.stated < inf:
        return NEVER
    return Interval(own.low / first.high, own.stated / first.stated, own.high / first.low)


def rank_among(own: Interval, others: Iterable[Interval]) -> int:
    """1 + number of times that are shorter for certain; 0 for an infinite one.

    >>> one, two = Interval(1.0, 1.0, 1.2), Interval(1.1, 1.1, 1.3)
    >>> rank_among(two, [one]), rank_among(Interval(1.5, 1.5, 1.6), [one, two])
    (1, 3)
    """
    if not own.stated < inf:
        return 0
    return 1 + sum(other.high < own.low for other in others)


def explain_missing(
    rows: Sequence[StudyRow], kind: str, best: SettingPoint | None, budget: float
) -> tuple[str, str]:
    """Why an engine does not reach an error: a state, and a sentence."""
    if best is None:
        failed = next((row for row in rows if row.outcome != Outcome.RAN), None)
        if failed is None:
            return NO_CHANNEL, f"it has no {kind} whose reference varies"
        return str(failed.outcome), failed.message
    series = [row for row in rows if row.series == best.row.series]
    last = series[-1]
    if best.row is not last and last.outcome == Outcome.RAN:
        end = "finer settings have no smaller error"
    elif last.outcome != Outcome.RAN:
        end = f"a finer setting: {last.outcome}"
    elif last.cost > budget:
        end = f"its series ends there, after a run of more than {number(budget)} s"
    else:
        end = "at the finest setting of its series"
    return NOT_REACHED, f"smallest error {number(best.error, 2)}: {end}"


@dataclass(frozen=True)
class EngineStanding:
    """Where an engine stands over all cases, for an error.

    Attributes
    ----------
    engine : str
    cases, reached, first : int
        All cases, those in which it reaches the error, and those in which no engine is faster for
        certain.
    ratio : Interval
        Median of its times over those of the first engines [1]; one that is not reached is
        infinite.
    rank : int
        1 + number of engines whose median is smaller for certain; 0 if it is infinite.
    tied : tuple of str
        Engines whose median may be the same.
    in_equal_time : float
        Median of its errors in the equal times of the cases [1]; a case in which it has no setting
        as fast counts as infinite.
    lost : dict of str to list of str
        The cases in which it does not reach the error, by their states.
    """

    engine: str
    cases: int
    reached: int
    first: int
    ratio: Interval
    rank: int
    tied: tuple[str, ...]
    in_equal_time: float
    lost: dict[str, list[str]]


def rank_engines(standings: Iterable[CaseStanding]) -> list[EngineStanding]:
    """Where all engines stand over all cases, for one error; the fastest first."""
    by_engine = group_by(standings, lambda one: one.engine)
    medians = {engine: median_interval(own) for engine, own in by_engine.items()}
    found = []
    for engine, own in by_engine.items():
        lost = group_by((one for one in own if not one.is_reached), lambda one: one.state)
        errors = [one.in_equal_time.stated for one in own if one.equal_time < inf]
        mine = medians[engine]
        others = {one: span for one, span in medians.items() if one != engine}
        found.append(
            EngineStanding(
                engine,
                len(own),
                sum(one.is_reached for one in own),
                sum(one.rank == 1 for one in own),
                mine,
                rank_among(mine, others.values()),
                tuple(one for one, span in others.items() if is_tied(mine, span)),
                log_median(error if error < inf else inf for error in errors),
                {state: [one.case for one in some] for state, some in lost.items()},
            )
        )
    return sorted(found, key=lambda one: (one.ratio.stated, -one.reached, -one.first))


def is_tied(one: Interval, other: Interval) -> bool:
    """Whether two finite intervals overlap."""
    return one.stated < inf and other.stated < inf and one.overlaps(other)


def median_interval(standings: Sequence[CaseStanding]) -> Interval:
    """The median of the ratios of an engine, and those of the ends of their intervals [1]."""
    ratios = [one.ratio for one in standings]
    low, stated, high = (log_median(one) for one in zip(*ratios, strict=True))
    return Interval(low, stated, high)


def log_median(values: Iterable[float]) -> float:
    """The median on a logarithmic axis, between two middle ones halfway there; NaN of none.

    >>> round(log_median([1.0, 100.0]), 12), log_median([2.0, inf]), log_median([inf, 2.0, 2.0])
    (10.0, inf, 2.0)
    """
    logarithms = [log(value) for value in values]
    return exp(median(logarithms)) if logarithms else NAN
