"""Outcomes of runs and of compared channels, as tables, JSON and pages name them."""

from __future__ import annotations

import math
from enum import StrEnum

from proofmass.base.units import si_unit
from proofmass.base.worker import Crashed, OutOfMemory, TimedOut
from proofmass.sim.protocol.failures import Diverged, NotSolved, Unavailable, Unsupported


class Outcome(StrEnum):
    """An outcome: its value is the word that is shown, and `sentence` explains the word.

    >>> Outcome.TIMED_OUT, Outcome.TIMED_OUT.sentence
    ('timed out', 'the engine gave no answer in the processor time that the run has')
    """

    sentence: str

    def __new__(cls, word: str, sentence: str) -> Outcome:
        """Make a member that equals its word and carries its sentence."""
        member = str.__new__(cls, word)
        member._value_ = word
        member.sentence = sentence
        return member

    def __repr__(self) -> str:
        """Show the word, so that records that were read from a file look the same."""
        return repr(self.value)

    AGREES = "agrees", "every sample is as near to the reference as the tolerance asks for"
    DIFFERS = "differs", "a sample is further from the reference than the tolerance allows"
    UNDECIDED = (
        "undecided",
        "the curve is not known closely enough to tell whether it is within the tolerance",
    )
    NOTHING_MOVED = (
        "nothing moved",
        "no checked channel leaves its start by more than its tolerance, so that nothing is tested",
    )
    OTHER_STEP = (
        "other step",
        "the time step was not that of the model or its settings, so that theirs is not tested",
    )
    UNCHECKED = "unchecked", "no tolerance covers the channel of this solver"
    SELF_CONSISTENT = (
        "self-consistent",
        "two ways of solving the model's own equations agree until a time; nothing else judges it",
    )
    MEASURED = "measured", "the error is known, and no tolerance says how large it may be"
    UNSUPPORTED = "unsupported", "the engine does not deliver the channel in this run"
    UNAVAILABLE = "unavailable", "the engine is not installed here and cannot be had"
    DIVERGED = "diverged", "the engine lost the motion, or found no pose"
    CRASHED = "crashed", "the process of the run died, or the engine raised an error"
    TIMED_OUT = "timed out", "the engine gave no answer in the processor time that the run has"
    OUT_OF_MEMORY = "out of memory", "the run asked for more memory than it may have"
    RAN = "ran", "the run of a study came to its end"
    STOPPED = "stopped", "the run of a study ended early, at a limit position for one"
    NOT_FINITE = "not finite", "a curve of the engine has a value that is no number"
    NO_REFERENCE = "no reference", "the reference cannot be evaluated at what the engine did"
    NOT_SOLVED = "not solved", "iterations of proofmass's own did not find a pose"
    NO_START = "no start", "the model cannot be put into its start pose"


EMPTY_OUTCOMES = (Outcome.NOTHING_MOVED, Outcome.OTHER_STEP)
"""Outcomes of channels within their tolerance, in a run that tells nothing of the model."""
CHECKED_OUTCOMES = (Outcome.AGREES, Outcome.DIFFERS, Outcome.UNDECIDED, *EMPTY_OUTCOMES)
"""Outcomes of channels that were compared with a tolerance."""
NOT_RUN_OUTCOMES = (Outcome.UNSUPPORTED, Outcome.UNAVAILABLE)
"""Outcomes of runs that an engine cannot make."""
UNCHECKED_OUTCOMES = (
    Outcome.UNCHECKED,
    Outcome.SELF_CONSISTENT,
    Outcome.MEASURED,
    *NOT_RUN_OUTCOMES,
)
"""Outcomes of channels and models for which no tolerance decides between right and wrong."""
GOOD_OUTCOMES = (Outcome.AGREES, *UNCHECKED_OUTCOMES)
FAILED_OUTCOMES = (Outcome.DIVERGED, Outcome.CRASHED, Outcome.TIMED_OUT, Outcome.OUT_OF_MEMORY)
"""Outcomes of runs that gave no curves to compare.

`Diverged` is raised in three places: by `proofmass.case.drive.check_driven` if a driven joint is
far from its prescribed value; by the dynamics of an engine if a value is not finite or a loop is
open; and by its sweeps and equilibria if no pose at rest was found.
"""
OUTCOME_OF_EXCEPTION: dict[type[Exception], Outcome] = {
    Unsupported: Outcome.UNSUPPORTED,
    Unavailable: Outcome.UNAVAILABLE,
    Diverged: Outcome.DIVERGED,
    NotSolved: Outcome.DIVERGED,
    Crashed: Outcome.CRASHED,
    TimedOut: Outcome.TIMED_OUT,
    OutOfMemory: Outcome.OUT_OF_MEMORY,
}
"""Outcomes by the exceptions that engines and workers raise."""


def judge_error(error: float, allowed: float, unit: str, why: str) -> tuple[Outcome, str]:
    """Decide the outcome of a largest error, and word its message; NaN never agrees.

    >>> judge_error(1e-6, 1e-5, "m", "rounding")
    ('agrees', 'rounding')
    >>> judge_error(float("nan"), 1e-5, "m", "rounding")[0]
    'differs'
    """
    if not math.isfinite(error):
        return Outcome.DIFFERS, "not a number somewhere on the curve"
    if not why:
        return Outcome.UNCHECKED, "no tolerance covers this channel of this solver"
    if error <= allowed:
        return Outcome.AGREES, why
    if not allowed:
        return Outcome.DIFFERS, (
            "the reference is zero and the mechanism has no size of this "
            "quantity, so relative_to_range allows nothing: give the tolerance as abs"
        )
    quantity, factor = si_unit(unit or "1")
    turns = error * factor / (2 * math.pi)
    if quantity == "rad" and turns > 0.5 and abs(turns - round(turns)) < 1e-3:
        return Outcome.DIFFERS, (
            f"off by {round(turns)} whole turn(s): count the start pose's angle anew"
        )
    return Outcome.DIFFERS, f"{error / allowed:.3g} x the allowed error"
