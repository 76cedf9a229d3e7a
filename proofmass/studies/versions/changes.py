"""What changed between two versions: channels whose error, or whose outcome, is another."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf, isnan

import numpy as np

from proofmass.base.arrays import Array
from proofmass.studies.cells import CellResult
from proofmass.verdict.outcome import Outcome

CHANGE_RATIO = 2.0
"""Ratio of two errors of a channel, or of the distance of its curves to the sum of both errors,
from which it counts as changed.  Curves with a reference are never further apart than that sum;
those of a model without one are known as closely as its step solves them."""
LEAST_ERROR = 1e-10
"""Error, as a share of the range, below which an error is rounding and its ratio means nothing."""
LEAST_MOVE = 1e-9
"""Distance of two curves, as a share of the range, below which the curves are the same: versions
that were compiled in another way differ by rounding, which grows along a run."""


@dataclass(frozen=True)
class VersionChange:
    """A change of a case between two versions.

    Attributes
    ----------
    case : str
    before, after : str
        The last version with the earlier result, and the first with the later one.
    channel : str
        The channel whose error changed by the largest factor; empty if the outcome changed.
        Of a model without a reference it may be the motion alone that changed, see `is_other`.
    error_before, error_after : float
        Its errors as shares of the range [1].
    moved : float
        Largest distance of its two curves as a share of the range [1].
    count, of : int
        Number of channels that changed, and of all that both versions have.
    outcome_before, outcome_after : str
    words : str
        What a version says that cannot run the case.
    adjacent : bool
        Whether no release lies between both.
    """

    case: str
    before: str
    after: str
    channel: str = ""
    error_before: float = float("nan")
    error_after: float = float("nan")
    moved: float = float("nan")
    count: int = 0
    of: int = 0
    outcome_before: str = Outcome.RAN
    outcome_after: str = Outcome.RAN
    words: str = ""
    adjacent: bool = True

    @property
    def ratio(self) -> float:
        """The error after over that before; infinite if there is no number."""
        return factor(self.error_before, self.error_after)

    @property
    def is_other(self) -> bool:
        """Whether the errors are as before, and the motion is another one."""
        return bool(self.channel) and 1 / CHANGE_RATIO <= self.ratio <= CHANGE_RATIO

    @property
    def is_worse(self) -> bool:
        """Whether the later version has the larger error, or runs the case no more."""
        if self.channel:
            return self.ratio > 1.0
        return self.outcome_after != Outcome.RAN


def factor(before: float, after: float) -> float:
    """The ratio of two errors, of which the smaller counts as `LEAST_ERROR` at least.

    >>> factor(1e-3, 1e-6), factor(0.0, 1e-13)
    (0.001, 1.0)
    """
    if isnan(before) or isnan(after):
        return inf
    return max(after, LEAST_ERROR) / max(before, LEAST_ERROR)


def find_change(
    before: CellResult,
    after: CellResult,
    curves_before: Mapping[str, Array],
    curves_after: Mapping[str, Array],
) -> VersionChange | None:
    """What changed between two results of a case; None if nothing did."""
    versions = version_of(before.solver), version_of(after.solver)
    if before.outcome != after.outcome:
        return VersionChange(
            before.case,
            *versions,
            outcome_before=before.outcome,
            outcome_after=after.outcome,
            words=before.message or after.message,
        )
    one = {error.channel: error for error in before.errors}
    two = {error.channel: error for error in after.errors}
    changed = list[tuple[float, str, float]]()
    both = [name for name in one if name in two]
    for name in both:
        ratio = factor(one[name].share, two[name].share)
        moved = distance(name, curves_before, curves_after, two[name].scale)
        known = one[name].share + two[name].share
        other_error = max(ratio, 1.0 / ratio) > CHANGE_RATIO and not moved <= LEAST_MOVE
        if other_error or moved > max(CHANGE_RATIO * known, LEAST_MOVE):
            changed.append((max(ratio, 1.0 / ratio), name, moved))
    if not changed:
        return None
    _, name, moved = max(changed)
    return VersionChange(
        before.case,
        *versions,
        name,
        one[name].share,
        two[name].share,
        moved,
        len(changed),
        len(both),
    )


def distance(
    name: str, before: Mapping[str, Array], after: Mapping[str, Array], scale: float
) -> float:
    """Largest distance of two curves as a share of a scale [SI].

    A channel that stands for all curves has the largest distance of them.  Where the scale is not
    known, it is the largest range of these curves.
    """
    names = [name] if name in before and name in after else [n for n in after if n != "x"]
    if any(n not in before or before[n].shape != after[n].shape for n in names):
        return inf
    if not scale > 0:
        scale = max((float(np.ptp(after[n])) for n in names), default=0.0) or 1.0
    gaps = (float(np.abs(before[n] - after[n]).max()) for n in names)
    return max(gaps, default=float("nan")) / scale


def version_of(solver: str) -> str:
    """The version in the name of a solver.

    >>> version_of("mujoco==3.3.7:default")
    '3.3.7'
    """
    return solver.partition("==")[2].partition(":")[0]
