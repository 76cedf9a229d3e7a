"""A model of an engine's own objects, judged by itself: with shorter and shorter steps.

It is run with its step, and with 1/2, 1/4 and 1/8 of it.  A curve is self-consistent until the
last time before which the three differences of neighbouring runs fall as those of a convergent
method do, and the last one is small; the numbers are those of
`proofmass.reference.self_consistency`.  This judges the time stepping alone: a wrong length is
wrong in all runs.
"""

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from proofmass.base.arrays import Array
from proofmass.base.wording import format_list, number
from proofmass.reference.self_consistency import (
    AGREEMENT_SHARE,
    MAX_JUMP,
    MIN_FALL,
    ROUNDING_SHARE,
    largest_until,
)
from proofmass.sim.protocol.engine import Engine
from proofmass.sim.protocol.object_run import ObjectRun
from proofmass.verdict.comparison import Comparison, Comparisons
from proofmass.verdict.outcome import Outcome

DIVISORS = 1, 2, 4, 8
"""Divisors of the step: three differences, of which two ratios show whether they fall."""


def judge_steps(engine: Engine, thing: Any, run: ObjectRun, name: str = "") -> Comparisons:
    """Compare the curves of a model with those of shorter steps.

    Parameters
    ----------
    engine : Engine
        The engine whose object it is.
    thing : object
    run : ObjectRun
        With the step that is judged.
    name : str
        Name of the case; that of the type of the object if empty.

    Returns
    -------
    Comparisons
        One for each channel.  `error_max` is its largest difference from the run with the shortest
        step, `at` the time until which it is self-consistent.

    Raises
    ------
    InputError
        The model cannot be run, or not from the same start again.
    """
    run = replace(run, copies=True)
    runs = [
        engine.record(thing, replace(run, step=run.step / k, every=run.every * k)) for k in DIVISORS
    ]
    called = name or type(thing).__name__.lower()
    steps = format_list(number(1e3 * run.step / k) for k in DIVISORS)
    found = []
    for channel in run.channels:
        one = Comparison(
            called,
            engine.title,
            "dynamics",
            channel,
            "1",
            seconds=runs[0].seconds,
            steps=runs[0].steps,
            violation=runs[0].violation,
        )
        curves = [each.channels[channel] for each in runs]
        found.append(judge_curve(one, runs[0].x, curves, f"steps of {steps} ms"))
    return Comparisons(found)


def judge_curve(one: Comparison, times: Array, curves: list[Array], steps: str) -> Comparison:
    """The comparison of a channel with the outcome of its curves; `steps` names these."""
    if not np.ptp(curves[-1]):
        return replace(one, outcome=Outcome.NOTHING_MOVED, message="it does not change")
    until, error, known = consistent_until(curves)
    if until < 1:
        return replace(one, message=f"{steps} do not converge")
    at = float(times[until])
    end = ", its end" if until == times.size - 1 else ""
    return replace(
        one,
        error_max=error,
        at=at,
        uncertainty=known,
        outcome=Outcome.SELF_CONSISTENT,
        message=f"until {number(at)} s{end}: {steps} converge; off by {number(error)}, known to "
        f"{number(known)}",
    )


def consistent_until(curves: list[Array]) -> tuple[int, float, float]:
    """Until which sample curves converge, the error of the first one there, and how it is known.

    >>> time = np.linspace(0.0, 1.0, 5)
    >>> curves = [np.sin(time) + error * time for error in (4e-4, 2e-4, 1e-4, 0.5e-4)]
    >>> consistent_until(curves)[0]
    4
    >>> consistent_until([np.sin(time) + error * time for error in (4e-4, 3e-4, 2e-4, 1e-4)])[0]
    0
    """
    size = float(np.ptp(curves[-1]))
    first, second, last = (largest_until((a - b)[:, None]) for a, b in pairwise(curves))
    rounding = ROUNDING_SHARE * size
    good = ((first >= MIN_FALL**2 * last) | (last <= rounding)) & (last <= AGREEMENT_SHARE * size)
    good &= ~(second > np.maximum(MAX_JUMP * first, rounding))
    good[0] = True
    until = int(np.argmin(good)) - 1 if not good.all() else good.size - 1
    error = float(np.abs(curves[0] - curves[-1])[: until + 1].max())
    return until, error, float(last[until])
