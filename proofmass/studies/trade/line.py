"""One line from coarse to fine: when to stop, its order, and where it might be at an error floor.

An error floor is claimed only where errors are asymptotic: less than 1e-2 of the range, and changed
by less than 5 % when the step is halved, twice in a row (`flat`, `halved`).  That an error of 0.8
of the range stays is no floor: the motion is another one, or out of phase.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from math import inf, isfinite, log

from proofmass.studies.row import NAN, Row
from proofmass.studies.trade.axes import Line

FALLS = 0.5
"""Order over two refinements below which an error no longer falls as a power of the step."""
COARSE = 0.1
"""Errors of a larger share of the range are those of another motion and show no order."""
ASYMPTOTIC = 0.01
"""Errors of a larger share of the range are no floor: their next term, of the square, is 1 %."""
FLAT = 0.05
"""Share that two halvings of the step may each change of an error that is at a floor.  An error of
first order with a share of 10 % that still falls changes by this."""
WORSE = 1.5
"""Times an error that a finer step must have to be called worse; less is a change of phase."""
CLEAR = 10.0
"""Times the least error: errors nearer to it bend.  With a share 1/10 of it, second order shows
1.9."""
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
        return bool(self.kinds) and all(self.settled(kind) for kind in self.kinds)

    def settled(self, kind: str) -> bool:
        """Whether two refinements in turn left an error as it is, or made it worse.

        It must be asymptotic, or of a motion whose positions are: jolts at the start may leave
        accelerations far off for any step.
        """
        points = self.points(kind)
        if not (still(points) or rising(points)):
            return False
        last = points[-1][1] if isfinite(points[-1][1]) else points[-3][1]
        places = self.points("position") if kind != "position" else []
        return last < ASYMPTOTIC or (bool(places) and places[-1][1] < ASYMPTOTIC)

    @property
    def kinds(self) -> list[str]:
        """Kinds of errors that were found."""
        return list(dict.fromkeys(kind for row in self.rows for kind in row.errors))

    def points(self, kind: str) -> list[tuple[float, float]]:
        """Sizes and errors of the settings, infinite where a run was lost.

        It begins where the motion is the right one, if it is so anywhere.
        """
        every = self.every(kind)
        first = next((k for k, (_, error) in enumerate(every) if error < COARSE), None)
        return [p for p in every if isfinite(p[1])] if first is None else every[first:]

    def every(self, kind: str) -> list[tuple[float, float]]:
        """The same from the first setting on."""
        return [(size, error) for size, row in zip(self.line.sizes, self.rows, strict=False)
                if (error := inf if row.outcome in LOST else row.errors.get(kind, NAN)) > 0
                and row.outcome in ("ran", *LOST)]

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


def alike(coarse: float, fine: float) -> bool:
    """Whether a refinement left an error as it is.

    >>> alike(1e-3, 1.04e-3), alike(1e-3, 0.94e-3)
    (True, False)
    """
    return isfinite(fine) and abs(fine / coarse - 1) < FLAT


def still(points: Points) -> bool:
    """Whether the last two refinements left the error as it is."""
    errors = [error for _, error in points[-3:]]
    return len(errors) == 3 and all(alike(*pair) for pair in pairwise(errors))


def rising(points: Points) -> bool:
    """Whether the last two refinements made the error worse, or were lost."""
    errors = [error for _, error in points[-3:]]
    return len(errors) == 3 and isfinite(errors[0]) and all(
        fine == inf or fine > (1 + FLAT) * coarse for coarse, fine in pairwise(errors))


def flat(points: Points) -> int | None:
    """The last point before a line's end that may be at an error floor; None if there is none.

    It is asymptotic and no later refinement changes it: two if there are so many, one if the line
    ends there.  Whether it is at a floor two halvings of its step tell.

    >>> flat([(0.4, 16e-5), (0.2, 4e-5), (0.1, 1e-5), (0.05, 1e-5), (0.025, 1e-5)])
    2
    >>> flat([(0.4, 0.80), (0.2, 0.81), (0.1, 0.80)])  # another motion
    """
    ends = len(points) - 1
    if not points or not points[-1][1] < ASYMPTOTIC:
        return None
    while ends > 0 and alike(points[ends - 1][1], points[ends][1]):
        ends -= 1
    ends = max(ends, len(points) - 3)
    return ends if ends < len(points) - 1 and points[ends][1] < ASYMPTOTIC else None


def least(points: Points) -> int | None:
    """The point of the least error, if it is asymptotic and all finer ones are worse: two at least.

    >>> least([(0.4, 1e-8), (0.2, 1e-10), (0.1, 4e-10), (0.05, 2e-9)])
    1
    """
    k = min(range(len(points)), key=lambda k: points[k][1], default=0)
    worse = [error for _, error in points[k + 1:]]
    return k if len(worse) > 1 and points[k][1] < ASYMPTOTIC and all(
        isfinite(error) and error > (1 + FLAT) * points[k][1] for error in worse) else None


def halved(errors: Sequence[float]) -> bool:
    """Whether an error and those of half and a quarter of its step are those of an error floor.

    >>> halved([1e-3, 1.01e-3, 1e-3]), halved([1e-3, 0.9e-3, 0.85e-3]), halved([0.5, 0.5, 0.5])
    (True, False, False)
    """
    return len(errors) == 3 and 0 < errors[0] < ASYMPTOTIC and all(
        alike(*pair) for pair in pairwise(errors))


def slowed(points: Points) -> int | None:
    """The first point from which two refinements or more do not let the error fall; None if all do.

    An order ends there; it is no error floor yet.

    >>> slowed([(0.4, 16e-5), (0.2, 4e-5), (0.1, 1.1e-5), (0.05, 1e-5), (0.025, 1.2e-5)])
    2
    """
    for k in range(len(points) - 2):
        if all(order(points[k], later) < FALLS for later in points[k + 2:]):
            return k
    return None


def level(points: Points) -> float:
    """The least error from where it slowed on; NaN if it did not."""
    first = slowed(points)
    return NAN if first is None else min(error for _, error in points[first:])


def clear(points: Points) -> Points:
    """The points before the error slows, and not near what it comes to.

    An end that falls no further is none yet, and may become one.
    """
    first, low = slowed(points), level(points)
    if first is None and len(points) > 1 and order(*points[-2:]) < FALLS:
        first, low = len(points) - 2, min(error for _, error in points[-2:])
    return [p for p in points[:first] if isfinite(p[1])
            and (first is None or p[1] > CLEAR * low)]


def observed(points: Points) -> float:
    """The order in the asymptotic range: the finest two refinements that show the same; NaN if no
    two that are clear of what the error comes to do.

    >>> observed([(0.4, 9e-2), (0.2, 4e-3), (0.1, 1e-3), (0.05, 2.5e-4)])
    2.0
    """
    orders = [order(*pair) for pair in pairwise(clear(points))]
    return next(((one + two) / 2 for one, two in reversed(list(pairwise(orders)))
                 if abs(one - two) <= ALIKE * max(2.0, abs(one + two))), NAN)


def still_falls(points: Points) -> float:
    """The order with which a line ends, to tell what finer settings will give; NaN if none is seen.

    The observed one where the last refinement shows it too, else that of the last refinement alone,
    if it is asymptotic or nearly so.

    >>> round(still_falls([(0.4, 4e-2), (0.2, 1e-2), (0.1, 2.6e-3)]), 2)
    1.97
    >>> still_falls([(0.4, 0.8), (0.2, 0.7)])
    nan
    """
    ends = [p for p in points if isfinite(p[1])][-2:]
    if len(ends) < 2 or ends != list(points[-2:]) or not ends[0][1] < COARSE:
        return NAN
    last = order(*ends)
    seen = observed(points)
    if abs(last - seen) <= 2 * ALIKE * max(1.0, seen):
        return seen
    return last if last > FALLS else NAN


def worse(points: Points) -> tuple[tuple[float, float], tuple[float, float]] | None:
    """The two settings in turn of which the finer one is worse by most; None if none is by much.

    A run that was lost has no error; it is told by its outcome.

    >>> worse([(1e-3, 1.9e-2), (0.5e-3, 6.8e-2), (0.25e-3, 4e-4)])
    ((0.001, 0.019), (0.0005, 0.068))
    """
    pairs = [(coarse, fine) for coarse, fine in pairwise(points) if coarse[1] < COARSE
             and isfinite(fine[1]) and fine[1] > WORSE * coarse[1]]
    return max(pairs, key=lambda pair: pair[1][1] / pair[0][1], default=None)
