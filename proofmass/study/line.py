"""One line from coarse to fine: when to stop, its order before the wall, and where the wall is."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from math import inf, isfinite, log

from proofmass.study.axes import Line
from proofmass.study.row import NAN, Row

FALLS = 0.5
"""Order over two refinements below which an error no longer falls."""
COARSE = 0.1
"""Errors of a larger share of the range are those of another motion and show no order."""
CLEAR = 10.0
"""Times the wall: errors nearer to it bend.  With a share 1/10 of wall, second order shows 1.9."""
ALIKE = 0.05
"""What two orders in turn may differ by, to be one order, of their sum: 0.1 of first order."""
LOST = ("diverged", "not finite", "crashed", "no reference")
"""Outcomes of settings that are no better than any error."""

Points = Sequence[tuple[float, float]]
"""Sizes and errors, from coarse to fine."""


@dataclass
class Track:
    """A line and the rows of its settings that were run, from the first on."""

    line: Line
    rows: list[Row] = field(default_factory=list)

    def done(self, budget: float) -> bool:
        """Whether another setting would tell nothing more, or the last one took a budget [s]."""
        if len(self.rows) == len(self.line.settings):
            return True
        if not self.rows:
            return False
        if self.rows[-1].outcome in ("timed out", "unsupported") or self.rows[-1].seconds > budget:
            return True
        return bool(self.kinds) and all(
            wall(self.points(kind)) is not None for kind in self.kinds)

    @property
    def kinds(self) -> list[str]:
        """Kinds of errors that were found."""
        return list(dict.fromkeys(kind for row in self.rows for kind in row.errors))

    def points(self, kind: str) -> list[tuple[float, float]]:
        """Sizes and errors of the settings, infinite where a run was lost.

        It begins where the motion is the right one, if it is so anywhere.
        """
        every = [(size, error) for size, row in zip(self.line.sizes, self.rows, strict=False)
                 if (error := inf if row.outcome in LOST else row.errors.get(kind, NAN)) > 0
                 and row.outcome in ("ran", *LOST)]
        first = next((k for k, (_, error) in enumerate(every) if error < COARSE), None)
        return [p for p in every if isfinite(p[1])] if first is None else every[first:]

    def place(self, size: float) -> int:
        """The number of the setting of that size."""
        return self.line.sizes.index(size)


def order(coarse: tuple[float, float], fine: tuple[float, float]) -> float:
    """The order that two sizes and their errors show.

    >>> order((0.2, 4e-4), (0.1, 1e-4))
    2.0
    """
    if fine[1] == inf:
        return -inf
    return log(coarse[1] / fine[1]) / log(coarse[0] / fine[0])


def wall(points: Points) -> int | None:
    """The first point from which two refinements or more do not let the error fall; None if all do.

    >>> wall([(0.4, 16e-5), (0.2, 4e-5), (0.1, 1.1e-5), (0.05, 1e-5), (0.025, 1.2e-5)])
    2
    """
    for k in range(len(points) - 2):
        if all(order(points[k], later) < FALLS for later in points[k + 2:]):
            return k
    return None


def deep(points: Points) -> int | None:
    """A point that is well in the wall: two refinements after it began, the least if that is lost.
    """
    first = wall(points)
    if first is None or isfinite(points[first + 2][1]):
        return None if first is None else first + 2
    return min(range(first, len(points)), key=lambda k: points[k][1])


def level(points: Points) -> float:
    """The least error from the wall on; NaN without a wall."""
    first = wall(points)
    return NAN if first is None else min(error for _, error in points[first:])


def clear(points: Points) -> Points:
    """The points before the wall, and not near it.

    An end that falls no further is none yet, and may become one.
    """
    first, low = wall(points), level(points)
    if first is None and len(points) > 1 and order(*points[-2:]) < FALLS:
        first, low = len(points) - 2, min(error for _, error in points[-2:])
    return [p for p in points[:first] if isfinite(p[1])
            and (first is None or p[1] > CLEAR * low)]


def observed(points: Points) -> float:
    """The order in the asymptotic range: the finest two refinements that show the same; NaN if no
    two that are clear of the wall do.

    >>> observed([(0.4, 9e-2), (0.2, 4e-3), (0.1, 1e-3), (0.05, 2.5e-4)])
    2.0
    """
    orders = [order(*pair) for pair in pairwise(clear(points))]
    return next(((one + two) / 2 for one, two in reversed(list(pairwise(orders)))
                 if abs(one - two) <= ALIKE * max(2.0, abs(one + two))), NAN)
