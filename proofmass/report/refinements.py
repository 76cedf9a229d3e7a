"""A refinement for the page: errors, orders and limits by numbers of segments, and the cost."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise

from proofmass.compare import Comparison
from proofmass.refine import Refine
from proofmass.refined import Row, limit, order
from proofmass.report.data import Shown
from proofmass.report.words import SYMBOLS
from proofmass.wording import number, pretty


@dataclass(frozen=True)
class Line:
    """One channel of one solver: its verdicts, and its numbers as words."""

    solver: str
    unit: str
    verdicts: tuple[tuple[str, str, str, str], ...]
    errors: tuple[str, ...]
    orders: tuple[str, ...]
    limits: tuple[str, ...]


def channels(view: Shown) -> dict[str, dict[str, list[Row]]]:
    """Rows by channel and solver, from few segments to many."""
    found: dict[str, dict[str, list[Row]]] = {}
    for row in view.refined:
        found.setdefault(row.channel, {}).setdefault(row.solver, []).append(row)
    return found


def table(view: Shown, refine: Refine) -> dict[str, list[Line]]:
    """Lines by channel."""
    found: dict[str, list[Line]] = {}
    for channel, solvers in channels(view).items():
        for solver, rows in solvers.items():
            own = [(c.channel.split()[0], SYMBOLS.get(c.outcome, "?"), c.outcome, c.message)
                   for c in view.verdicts if c.solver == solver and about(c, channel)]
            found.setdefault(channel, []).append(Line(
                solver, pretty(rows[0].unit), tuple(own), tuple(number(row.error) for row in rows),
                pairs(rows, lambda a, b: order(a, b, refine.wall), 4),
                pairs(rows, lambda a, b: abs(limit(a, b, refine.order)), 3)))
    return found


def about(verdict: Comparison, channel: str) -> bool:
    """Whether a verdict speaks of a channel, or of a solver as a whole."""
    return verdict.channel in ("order", f"order of {channel}", f"limit of {channel}")


def pairs(rows: list[Row], of: Callable[[Row, Row], float], digits: int) -> tuple[str, ...]:
    """Words on each row and the one before it."""
    return tuple(number(of(a, b), digits) for a, b in pairwise(rows))


def costs(view: Shown) -> Iterator[tuple[str, list[str]]]:
    """Seconds of each solver by numbers of segments."""
    for solver, rows in next(iter(channels(view).values()), {}).items():
        yield solver, [number(row.seconds) for row in rows]


def caption(refine: Refine) -> str:
    """What is asked for, and how it was sampled."""
    coarse, fine = refine.last
    samples = ", which have the same places on the links of all" * (refine.run == "rest")
    bound = "" if refine.richardson is None else f"; it may be {number(refine.richardson)} m off"
    return (f"Each rod in {', '.join(map(str, refine.segments))} segments: largest error over the "
            f"samples{samples}; triangles fall with order {number(refine.order)}, from which each "
            f"step may be {number(refine.within)} away: {refine.why}; open diamonds: the limit "
            f"that {coarse} and {fine} segments point to (Richardson), at the last sample{bound}.")
