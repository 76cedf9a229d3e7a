"""The changes of a case's parameters that its comparisons would notice, parameter by parameter."""

import math
from collections.abc import Collection, Iterable
from typing import NamedTuple

from proofmass.verdict.comparison import Comparison, DetectableChange
from proofmass.verdict.outcome import Outcome


class NoticedChange(NamedTuple):
    """A change of a parameter, and the comparison that would notice it."""

    change: DetectableChange
    by: Comparison


def noticed_changes(
    comparisons: Iterable[Comparison], outcomes: Collection[Outcome]
) -> dict[str, list[NoticedChange]]:
    """The detectable changes of comparisons with given outcomes, by parameter."""
    found: dict[str, list[NoticedChange]] = {}
    for c in comparisons:
        if c.outcome in outcomes:
            for parameter, change in c.detectable.items():
                found.setdefault(parameter, []).append(NoticedChange(change, c))
    return found


def smallest_noticed(changes: Iterable[NoticedChange]) -> NoticedChange | None:
    """The smallest of some changes of one parameter; None if the size of none is known."""
    known = (one for one in changes if not math.isnan(one.change.size))
    return min(known, key=lambda one: one.change.size, default=None)
