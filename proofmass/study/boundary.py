"""How far something holds: a boundary between what held and what did not, bisected."""

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np

NAN = float("nan")
WITHIN = 0.01
"""A boundary is known when what failed is so little beyond what held."""
STRIDE = 4.0
"""Factor from one value to the next on the way to the extreme."""


class Failure(NamedTuple):
    """Why a value did not hold, and whether the engine itself said nothing of it."""

    message: str
    silent: bool = False


def told(message: str) -> bool:
    """Whether the engine itself said that a run diverged; otherwise only its curves show it.

    >>> told("MuJoCo warning badqacc; lost at some time"), told("not finite at t = 2 s")
    (True, False)
    """
    return message.startswith("MuJoCo warning")


Trial = Callable[[float], Failure | None]
"""Tries a value: why it did not hold, or None."""


@dataclass(frozen=True)
class Turned:
    """One knob, and between what it is turned.

    Attributes
    ----------
    what : str
        The case, or the specimen in words.
    engine, setting : str
        mujoco or pymunk, and its integrator or what else is set, in words.
    knob, unit : str
        What was turned.
    start, reach : float
        From where, and how far.
    """

    what: str
    engine: str
    setting: str
    knob: str
    unit: str
    start: float
    reach: float


@dataclass(frozen=True)
class Boundary(Turned):
    """How far one knob can be turned.

    Attributes
    ----------
    holds, breaks : float
        The furthest value that held, and the next that did not: NaN if all did up to `reach`, and
        if `start` did not.
    theory : float
        Where it must be: infinite (or zero, downwards) for nowhere, NaN if nothing is known.
    law : str
        What the theory says, in words.
    failure : str
        What went wrong at `breaks`.
    silent : bool
        Whether the engine itself said nothing of that.
    """

    holds: float = NAN
    breaks: float = NAN
    theory: float = NAN
    law: str = ""
    failure: str = ""
    silent: bool = False

    @property
    def found(self) -> bool:
        """Whether there is a boundary between `start` and `reach`."""
        return bool(np.isfinite(self.breaks))

    @property
    def judged(self) -> bool:
        """Whether it is the engine's: not where only the reference had no answer."""
        return self.found and not self.failure.startswith("no reference")

    @property
    def measured(self) -> float:
        """The boundary, between what held and what did not; infinite (or zero) if there is none."""
        if self.found:
            return float(np.sqrt(self.holds * self.breaks))
        if not np.isfinite(self.holds):
            return NAN
        return float("inf") if self.reach > self.start else 0.0

    @property
    def ratio(self) -> float:
        """Measured over theory; 1 where both say nowhere, NaN where only one does."""
        if self.measured == self.theory:
            return 1.0
        ratio = self.measured / self.theory if self.theory else NAN
        return ratio if np.isfinite(ratio) and ratio else NAN


@dataclass(frozen=True)
class Sought(Turned):
    """A boundary to be found: how to try a value, and what theory says; see `Boundary`."""

    trial: Trial
    theory: float = NAN
    law: str = ""

    def find(self, within: float = WITHIN) -> Boundary:
        """Bisect the boundary to a share of its value."""
        holds, breaks, failure = bisect(self.trial, self.start, self.reach, within)
        known = {f.name: getattr(self, f.name) for f in fields(self) if f.name != "trial"}
        message, silent = failure or ("", False)
        return Boundary(**known, holds=holds, breaks=breaks, failure=message, silent=silent)


def bisect(trial: Trial, start: float, reach: float, within: float = WITHIN
           ) -> tuple[float, float, Failure | None]:
    """Turn a knob from `start` towards `reach`, and close in on where it stops to hold.

    Strides are geometric, so all values are positive.  A boundary is the first one that a stride
    meets; an island of failure between two strides is not seen.

    Returns
    -------
    holds, breaks : float
        NaN for what there is not.
    failure : Failure or None
        Why `breaks` failed, or `start` already.

    Examples
    --------
    >>> holds, breaks, _ = bisect(lambda x: None if x < 2 else Failure("beyond"), 0.1, 100.0)
    >>> holds < 2 <= breaks, breaks / holds < 1.01
    (True, True)
    >>> bisect(lambda x: None if x > 1e-3 else Failure("below"), 1.0, 1e-2)
    (0.01, nan, None)
    """
    failure = trial(start)
    if failure:
        return NAN, NAN, failure._replace(message=f"at {start:g} already: {failure.message}")
    holds, breaks = start, NAN
    strides = max(1, int(np.ceil(abs(np.log(reach / start)) / np.log(STRIDE) - 1e-9)))
    for value in np.geomspace(start, reach, strides + 1)[1:].tolist():
        failure = trial(value)
        if failure:
            breaks = value
            break
        holds = value
    while max(holds / breaks, breaks / holds) > 1.0 + within:  # not with NaN
        middle = float(np.sqrt(holds * breaks))
        if found := trial(middle):
            breaks, failure = middle, found
        else:
            holds = middle
    return holds, breaks, failure
