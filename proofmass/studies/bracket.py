"""The two values of a parameter between which an error crosses its limit.

`stress` increases a parameter until a run fails, and bisects; `trade` and `choose` shorten the time
step until an error is small enough, and look for a longer step that is so too.  Steps, loads and
speeds vary over decades, so that ratios count and not differences.

The first crossing counts, from where the values begin.  How the next value is found differs: the
error of a time step has an order of convergence, from which `choose` computes the step to try and
whether it is worth its cost, while a run of `stress` holds or fails without an order, so that its
steps are factors and each try halves the bracket.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from math import nan, sqrt


@dataclass(frozen=True)
class Bracket:
    """A value with an error within its limit, and one with an error beyond it.

    Attributes
    ----------
    holds, breaks : float
        The two values, both positive; NaN for one that is not known [its unit].
    """

    holds: float = nan
    breaks: float = nan

    @classmethod
    def find_first(cls, tried: Iterable[tuple[float, bool]]) -> "Bracket":
        """The first crossing on the way from value to value; no value is tried beyond it.

        Parameters
        ----------
        tried : iterable of (float, bool)
            Values [its unit] from one end on, and whether they hold; it is read up to the crossing.

        Returns
        -------
        Bracket
            The two values at the crossing.  Without a crossing the last value, on its side.

        >>> Bracket.find_first([(1.0, True), (4.0, True), (16.0, False), (64.0, True)])
        Bracket(holds=4.0, breaks=16.0)
        >>> Bracket.find_first([(0.4, False), (0.2, False), (0.1, True), (0.05, True)])
        Bracket(holds=0.1, breaks=0.2)
        >>> Bracket.find_first([(1.0, True), (4.0, True)])
        Bracket(holds=4.0, breaks=nan)
        """
        found = cls()
        for value, holds in tried:
            found = found.narrowed(value, holds)
            if found.ratio == found.ratio:
                break
        return found

    @property
    def ratio(self) -> float:
        """The larger value over the smaller one [1]; NaN if one is not known.

        >>> Bracket(2.0, 0.5).ratio, Bracket(0.5, 2.0).ratio
        (4.0, 4.0)
        """
        return max(self.holds / self.breaks, self.breaks / self.holds)

    @property
    def middle(self) -> float:
        """The geometric mean of the two values [its unit].

        >>> Bracket(2.0, 0.5).middle
        1.0
        """
        return sqrt(self.holds * self.breaks)

    def inside(self, value: float, margin: float) -> float:
        """The value nearest to a given one that is away from both ends [its unit].

        Its distance from each end is at least the share `margin` of the distance of the ends, on
        the logarithmic scale.

        >>> Bracket(1.0, 16.0).inside(1.5, 0.25), Bracket(1.0, 16.0).inside(5.0, 0.25)
        (2.0, 5.0)
        """
        away = self.ratio**margin
        low, high = sorted((self.holds, self.breaks))
        return min(max(value, low * away), high / away)

    def narrowed(self, value: float, holds: bool) -> "Bracket":
        """The bracket after a value between the two was tried, or one beyond the only known one."""
        return Bracket(value, self.breaks) if holds else Bracket(self.holds, value)
