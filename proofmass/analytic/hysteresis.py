r"""Loops of a moment over an angle that goes up and down: branches, area, work against a reference.

A mechanism with dry friction needs another moment on its way up than on its way down::

    moment            .--<--.   down
       |          .-''  ,->-'   up            area = closed integral of M dalpha
       |      .-' ,-->-'                           = work that friction takes in a cycle
       |   .-'-->'
       +---------------------- angle

The rows are in the order in which they were measured; time is not needed.  A branch is a part of
them in which the angle rises or falls: it ends where the angle turns back by more than a share of
its range, so that noise of the angle makes none.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from proofmass.analytic.balancer.measures import work_reduction
from proofmass.base.arrays import Array

TURN_SHARE = 0.05
"""Share of the range of the angle by which it must turn back to begin another branch."""
WHOLE_SHARE = 0.8
"""Share of the range of the angle that a whole branch covers; others are left out of the means."""
MIN_BRANCH_ROWS = 3
"""Least number of rows of a branch."""
LoopCurve = Callable[[Array], Array]
"""Moment [N m] over angle [rad]."""


@dataclass(frozen=True)
class LoopBranch:
    """A part of a loop in which the angle rises or falls.

    Attributes
    ----------
    rises : bool
    first, last : int
        Its rows.
    angle, moment : ndarray (k,)
        Angles, rising and each once [rad], and moments [N m]; means of rows with the same angle.
    """

    rises: bool
    first: int
    last: int
    angle: Array
    moment: Array

    @property
    def ends(self) -> tuple[float, float]:
        """Its least and its largest angle [rad]."""
        return float(self.angle[0]), float(self.angle[-1])

    def at(self, angle: Array) -> Array:
        """The moment at angles within its ends [N m], straight between rows."""
        return np.interp(angle, self.angle, self.moment)

    def within(self, low: float, high: float) -> "LoopBranch":
        """The part of the branch between two of its angles."""
        inside = self.angle[(self.angle > low) & (self.angle < high)]
        angle = np.concatenate([[low], inside, [high]])
        return LoopBranch(self.rises, self.first, self.last, angle, self.at(angle))

    @property
    def work(self) -> float:
        """Integral of the moment over the rising angle [J]."""
        return float(np.trapezoid(self.moment, self.angle))


@dataclass(frozen=True)
class LoopErrors:
    """A loop against a reference.

    Attributes
    ----------
    rms, largest : float
        Of the differences of both branches, over the angle [N m].
    at : float
        The angle of the largest [rad].
    reductions : dict of str to float
        Reduction of the work against the reference by the branches ``up`` and ``down`` and by
        ``both`` [%].
    """

    rms: float
    largest: float
    at: float
    reductions: dict[str, float]


class HysteresisLoop:
    """A measured or computed loop.

    Parameters
    ----------
    angle, moment : array_like (n,)
        In the order of measurement [rad], [N m].

    Raises
    ------
    ValueError
        The angle does not move, no branch has three rows, or none covers most of its range.

    Examples
    --------
    A moment of 2 sin(angle) and friction of 0.1 N m, once up and down: the area is 0.2 N m times
    the way.

    >>> way = np.linspace(0.0, 1.5, 151)
    >>> angle = np.concatenate([way, way[::-1]])
    >>> loop = HysteresisLoop(angle, 2.0 * np.sin(angle) + np.repeat([0.1, -0.1], 151))
    >>> [branch.rises for branch in loop.branches], round(loop.area, 12)
    ([True, False], 0.3)
    """

    def __init__(self, angle: ArrayLike, moment: ArrayLike) -> None:
        self.angle, self.moment = np.asarray(angle, float), np.asarray(moment, float)
        if not np.ptp(self.angle) > 0.0:
            raise ValueError("the angle does not move, so that there is no branch")
        self.branches = find_branches(self.angle, self.moment)
        if not self.branches:
            raise ValueError(f"no branch has {MIN_BRANCH_ROWS} rows")
        if not self.whole:
            raise ValueError(
                f"no branch covers {WHOLE_SHARE:.0%} of the range of the angle: give a whole way "
                "up or down"
            )

    def last_cycle(self) -> "HysteresisLoop":
        """The loop of its last two whole branches: with friction the first way is another one."""
        some = self.whole[-2:]
        rows = slice(some[0].first, some[-1].last + 1)
        return HysteresisLoop(self.angle[rows], self.moment[rows])

    def between(self, low: float, high: float) -> "HysteresisLoop":
        """The loop whose means are cut to a range of angles [rad] that all whole branches have."""
        found = HysteresisLoop(self.angle, self.moment)
        found.ends = low, high
        return found

    @cached_property
    def whole(self) -> list[LoopBranch]:
        """The branches that cover most of the range of the angle."""
        least = WHOLE_SHARE * float(np.ptp(self.angle))
        return [one for one in self.branches if one.ends[1] - one.ends[0] >= least]

    @cached_property
    def ends(self) -> tuple[float, float]:
        """The range of angles that all whole branches have [rad]."""
        return max(one.ends[0] for one in self.whole), min(one.ends[1] for one in self.whole)

    def mean_branch(self, rises: bool) -> LoopBranch | None:
        """The mean of all whole branches that rise, or that fall, in their common range."""
        some = [one.within(*self.ends) for one in self.whole if one.rises == rises]
        if not some:
            return None
        angle = np.unique(np.concatenate([one.angle for one in some]))
        moment = np.mean([one.at(angle) for one in some], axis=0)
        return LoopBranch(rises, some[0].first, some[-1].last, angle, moment)

    @cached_property
    def sides(self) -> dict[str, LoopBranch]:
        """The mean branches by their names, ``up`` and ``down``."""
        found = {name: self.mean_branch(name == "up") for name in ("up", "down")}
        return {name: one for name, one in found.items() if one is not None}

    @property
    def area(self) -> float:
        """Work that a cycle takes between the common ends [J]; NaN without both branches."""
        if len(self.sides) < len(("up", "down")):
            return float("nan")
        return self.sides["up"].work - self.sides["down"].work

    @property
    def half_width(self) -> float:
        """Mean of half the distance of the branches: the moment of friction [N m]."""
        return self.area / (2.0 * (self.ends[1] - self.ends[0]))

    def middle(self, angle: Array) -> Array:
        """The mean of the branches at angles within the ends [N m]."""
        return np.asarray(np.mean([one.at(angle) for one in self.sides.values()], axis=0))

    def fit(self, degree: int) -> "np.polynomial.Polynomial":
        """The polynomial of the angle [rad] that fits both branches best, over the angle."""
        angle = np.concatenate([one.angle for one in self.sides.values()])
        moment = np.concatenate([one.moment for one in self.sides.values()])
        weights = np.sqrt(np.concatenate([spacings(one.angle) for one in self.sides.values()]))
        return np.polynomial.Polynomial.fit(angle, moment, degree, w=weights)

    def sine(self) -> float:
        """The size of the sine of the angle that fits both branches best [N m]."""
        square = product = 0.0
        for one in self.sides.values():
            wave = np.sin(one.angle)
            square += float(np.trapezoid(wave * wave, one.angle))
            product += float(np.trapezoid(wave * one.moment, one.angle))
        return product / square

    def errors(self, references: dict[str, LoopCurve]) -> LoopErrors:
        """The loop against a reference of each branch, by its name ``up`` or ``down``.

        The reduction of the work against a reference that does none is NaN.
        """
        squares, largest, at, reductions = 0.0, 0.0, float("nan"), {}
        missing, there = 0.0, 0.0
        for name, one in self.sides.items():
            wanted = references[name](one.angle)
            left = one.moment - wanted
            squares += float(np.trapezoid(left**2, one.angle))
            worst = int(np.argmax(np.abs(left)))
            if abs(left[worst]) >= largest:
                largest, at = float(abs(left[worst])), float(one.angle[worst])
            work, reductions[name] = float(np.trapezoid(wanted, one.angle)), float("nan")
            if work > 0.0:
                reductions[name] = float(work_reduction(one.moment, wanted, one.angle))
            missing, there = missing + float(np.trapezoid(np.abs(left), one.angle)), there + work
        reductions["both"] = 100.0 * (1.0 - missing / there) if there > 0.0 else float("nan")
        way = len(self.sides) * (self.ends[1] - self.ends[0])
        return LoopErrors(float(np.sqrt(squares / way)), largest, at, reductions)


def find_branches(angle: Array, moment: Array) -> list[LoopBranch]:
    """The branches of a loop with three rows or more.

    Parameters
    ----------
    angle, moment : ndarray (n,)
        In the order of measurement [rad], [N m].

    Examples
    --------
    >>> up, down = np.linspace(0.0, 1.0, 5), np.linspace(1.0, 0.5, 4)
    >>> found = find_branches(np.concatenate([up, down]), np.zeros(9))
    >>> [(one.rises, one.first, one.last) for one in found]
    [(True, 0, 4), (False, 5, 8)]
    """
    found = []
    for first, last in find_ways(angle, TURN_SHARE * float(np.ptp(angle))):
        rows = slice(first, last + 1)
        places, inverse, counts = np.unique(angle[rows], return_inverse=True, return_counts=True)
        if places.size >= MIN_BRANCH_ROWS:
            means = np.bincount(inverse, moment[rows]) / counts
            rises = bool(angle[last] > angle[first])
            found.append(LoopBranch(rises, first, last, places, means))
    return found


def find_ways(angle: Array, least: float) -> list[tuple[int, int]]:
    """First and last rows of the ways between turns, at which an angle goes back by a least size.

    Of several rows at a turn that have its angle, the first one ends a way, and the last one begins
    the next.

    Parameters
    ----------
    angle : ndarray (n,)
        [rad]
    least : float
        [rad]

    Examples
    --------
    >>> find_ways(np.array([0.0, 1.0, 0.95, 2.0, 2.0, 1.0, 0.0, 0.1]), 0.2)
    [(0, 3), (4, 7)]
    """
    values = angle.tolist()
    ways, begin, end, again, way = list[tuple[int, int]](), 0, 0, 0, 0
    for row, value in enumerate(values):
        ahead = value - values[end]
        if way == 0:
            if abs(ahead) > least:
                way, end, again = (1 if ahead > 0.0 else -1), row, row
        elif ahead * way > 0.0:
            end = again = row
        elif ahead == 0.0:
            again = row
        elif -ahead * way > least:
            ways.append((begin, end))
            begin, way, end, again = again, -way, row, row
    return [*ways, (begin, len(values) - 1)]


def spacings(angle: Array) -> Array:
    """Weights of the trapezoidal rule at rising angles (k,) [rad]."""
    step = np.diff(angle)
    return np.asarray(np.concatenate([step, [0.0]]) + np.concatenate([[0.0], step])) / 2.0
