"""How closely curves agree: a grade beside the verdict, which only says that a limit holds.

A grade is the largest error of curves that agree, over `scale_of` the reference curve, rounded up
to one of five steps::

    error / range   0 ...... 1e-11 ..... 1e-6 ..... 1e-3 ..... 1 % ....
    grade            rounding     to 1e-6    to 1e-3    to 1 %    coarse
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from enum import Enum

from proofmass.verdict.comparison import Comparison
from proofmass.verdict.outcome import Outcome

NOTABLE_SHARE = 1e-2
"""Error of a curve that is not checked, as a share of its range, from which on it is told first: it
is seen in a plot."""


class Grade(Enum):
    """A step of closeness: its largest error as a share of the range [1], its name, and its words.

    The limit of rounding is 1e-11: references and engines that pose a mechanism without time steps
    have errors of 1e-16 to 1e-12 of the range, and engines that step in time have more.

    >>> Grade.of(3e-15).words, Grade.of(5e-7).words, Grade.of(0.09).words
    ('to rounding', 'to 1e-6', 'coarsely')
    """

    ROUNDING = 1e-11, "rounding", "to rounding"
    MILLIONTH = 1e-6, "1e-6", "to 1e-6"
    THOUSANDTH = 1e-3, "1e-3", "to 1e-3"
    HUNDREDTH = 1e-2, "1 %", "to 1 %"
    COARSE = math.inf, "coarse", "coarsely"

    def __init__(self, limit: float, label: str, words: str) -> None:
        self.limit = limit
        self.label = label
        self.words = words

    @property
    def blocks(self) -> int:
        """The number of full blocks, of `count`, in a picture of it: 1 for the coarsest."""
        return self.count - [*Grade].index(self)

    @property
    def count(self) -> int:
        """The number of grades."""
        return len(Grade)

    @property
    def names(self) -> str:
        """The names of all grades, the coarsest first."""
        return ", ".join(one.label for one in [*Grade][::-1])

    @property
    def close(self) -> bool:
        """Whether it is 1e-3 or better, so that a plot does not show the error."""
        return self.limit <= Grade.THOUSANDTH.limit

    @classmethod
    def of(cls, share: float) -> Grade:
        """The grade of an error as a share of the range [1].

        >>> Grade.of(1e-2) is Grade.HUNDREDTH, Grade.of(float("nan")) is Grade.COARSE
        (True, True)
        """
        return next((one for one in cls if share <= one.limit), cls.COARSE)


def worst_agreeing(rows: Iterable[Comparison]) -> Comparison | None:
    """The curve that agrees with the largest error as a share of its range.

    None if none agrees, or none that does has a range.
    """
    there = (c for c in rows if c.outcome == Outcome.AGREES and c.channel)
    known = (c for c in there if math.isfinite(c.relative_to_range))
    return max(known, key=lambda c: c.relative_to_range, default=None)


def grade_of(rows: Iterable[Comparison]) -> Grade | None:
    """The grade of the curves that agree: that of the largest error; None if none agrees.

    Examples
    --------
    >>> row = Comparison("arm", "mujoco", "sweep", "tip.x", "m", error_max=2e-5, error_rms=1e-5,
    ...     nrmse=1e-5, allowed=1e-3, outcome="agrees")
    >>> grade_of([row]).words, grade_of([])
    ('to 1e-3', None)
    """
    worst = worst_agreeing(rows)
    return Grade.of(worst.relative_to_range) if worst else None


def worst_unchecked(rows: Iterable[Comparison]) -> Comparison | None:
    """The curve that is not checked with the largest error, if it is a `NOTABLE_SHARE` or more."""
    found = max(
        (
            c
            for c in rows
            if c.outcome in (Outcome.UNCHECKED, Outcome.MEASURED)
            and math.isfinite(c.relative_to_range)
        ),
        key=lambda c: c.relative_to_range,
        default=None,
    )
    return found if found is not None and found.relative_to_range >= NOTABLE_SHARE else None
