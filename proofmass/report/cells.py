"""A cell of the index: the worst errors of a case in an engine, on an axis that all cells share."""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from markupsafe import Markup

from proofmass.compare import Comparison
from proofmass.outcome import CHECKED, GOOD
from proofmass.report.changes import FACTOR
from proofmass.report.overview import place
from proofmass.report.record import History
from proofmass.report.words import kind_of
from proofmass.wording import format_solver, is_variant, number

NOTHING = Markup()
TREND = 3
"""Reports from which on a row has a trend."""


@dataclass(frozen=True)
class ErrorMark:
    """A solver of a cell: its worst error on the axis, and what it is allowed there.

    `at` and `allowed` are places in per cent of the axis; None where there is none.
    """

    solver: str
    hollow: bool
    over: bool
    at: float | None
    allowed: float | None
    words: str


@dataclass(frozen=True)
class IndexCell:
    """What a row says of the runs of one group in one engine; `sort` is the worst share."""

    lanes: list[ErrorMark]
    error: str
    kind: str
    bad: bool
    sort: float

    @property
    def words(self) -> str:
        """All lanes in words."""
        return "; ".join(lane.words for lane in self.lanes)


def ratio(c: Comparison) -> float:
    """The error over what is allowed; infinite of what failed without a number."""
    if math.isfinite(c.error_max) and c.allowed > 0:
        return c.error_max / c.allowed
    return 0.0 if c.outcome in GOOD else math.inf


def cell_of(rows: Sequence[Comparison]) -> IndexCell | None:
    """The cell of these comparisons, a lane a solver, the engine itself first."""
    solvers = sorted(dict.fromkeys(c.solver for c in rows), key=is_variant)
    groups = [[c for c in rows if c.solver == solver] for solver in solvers]
    if not groups:
        return None
    speakers = [speaker(group) for group in groups]
    first = next((c for c in speakers if c.outcome not in GOOD), speakers[0])
    lanes = [lane_of(c) for c in speakers]
    share = first.relative_to_range
    known = math.isfinite(share)
    kind = kind_of(first.unit) if known else "other"
    return IndexCell(
        lanes=lanes,
        error=number(share, 2) if known else str(first.outcome),
        kind="" if kind == "other" else kind,
        bad=first.outcome not in GOOD,
        sort=share if known else math.inf if first.outcome not in GOOD else -1.0,
    )


def speaker(group: Sequence[Comparison]) -> Comparison:
    """The comparison that stands for a solver: the worst failure, else the largest error."""

    def rank(c: Comparison) -> tuple[bool, float, float]:
        failed = c.outcome not in GOOD
        share = c.relative_to_range
        known = share if math.isfinite(share) else -1.0
        return failed, ratio(c) if failed else 0.0, known

    return max(group, key=rank)


def lane_of(c: Comparison) -> ErrorMark:
    """A solver's lane, by the comparison that stands for it."""
    share, judged = c.relative_to_range, math.isfinite(c.allowed)
    name = format_solver(c.solver)
    if not math.isfinite(share):
        return ErrorMark(
            c.solver,
            is_variant(c.solver),
            c.outcome not in GOOD,
            None,
            None,
            f"{name}: {c.outcome}",
        )
    allowed = c.allowed_of_range if judged and c.error_max else None
    words = f"{name}: {c.channel} {number(share, 2)} of the range"
    words += f", {number(allowed, 2)} allowed" if allowed else ", no tolerance" * (not judged)
    return ErrorMark(
        c.solver,
        is_variant(c.solver),
        c.outcome not in GOOD,
        place(share),
        None if allowed is None else place(allowed),
        words,
    )


def trend(history: History, rows: Sequence[Comparison]) -> Markup:
    """The error of the channel nearest to its allowance over the last reports, as a line."""
    judged = [c for c in rows if c.outcome in CHECKED]
    if len(history.reports) < TREND or not judged:
        return NOTHING
    c = max(judged, key=ratio)
    values = history.trend(c.case, c.run, c.solver, c.channel)
    powers = [math.log10(v) if v else None for v in values]
    known = [p for p in powers if p is not None]
    if len(known) < TREND or max(known) - min(known) < math.log10(FACTOR):
        return NOTHING
    low, high = min(known), max(known)
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    step = 56 / (len(powers) - 1)
    points = list(spread(powers, step, middle, half))
    where = f"{c.run} {format_solver(c.solver)}, {c.channel}"
    return Markup(
        '<svg class="trend" viewBox="0 0 60 18" role="img" aria-label="{}"><polyline '
        'points="{}"/></svg>'
    ).format(
        f"{where}: {len(known)} reports, {number(values_of(values)[0], 2)} to "
        f"{number(values_of(values)[-1], 2)} of the range",
        " ".join(points),
    )


def values_of(values: Iterable[float | None]) -> list[float]:
    """The values that there are."""
    return [value for value in values if value]


def spread(
    powers: Iterable[float | None], step: float, middle: float, half: float
) -> Iterator[str]:
    """Points of a trend."""
    for k, power in enumerate(powers):
        if power is not None:
            yield f"{2 + k * step:.1f},{9 - 7 * (power - middle) / half:.1f}"
