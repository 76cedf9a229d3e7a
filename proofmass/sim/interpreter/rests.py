"""Steps until a mechanism is at rest, sample by sample."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from .checks import LOST_SIZES, RunEnded, Stopwatch, check_motions
from .geometry import LinkMotion
from .mechanism import LinkStates, NeutralMechanism, WayToRest

SLOWER = 0.5
"""Share of the least speed so far that counts as slower."""
PATIENCE = 40
"""Checks after which a mechanism that has not become slower is as slow as it becomes.  Its speed
halves within a few checks as long as it is more than rounding, or what constraints leave open."""
CALM_CHECKS = 8
"""Successive checks, about a period of the slowest oscillation, whose largest speed counts: an
oscillation is slow where it turns."""


class NoRest(RunEnded):
    """A mechanism does not come to rest; the message says why."""


def record_rests(
    mechanism: NeutralMechanism,
    step: Callable[[int], None],
    read: Callable[[int], LinkMotion],
    joint: Callable[[int], tuple] | None = None,
) -> LinkStates:
    """Record the links at rest at the samples, see `WayToRest`; the arguments: see `record`.

    Returns
    -------
    LinkStates
        They end before the first sample at which the mechanism does not come to rest.
    """
    states, links = LinkStates.empty(mechanism, joint is not None), range(1, len(mechanism.links))
    check_motions([read(k) for k in links])
    whole, steps, watch = 0, 0, Stopwatch()
    with watch, np.errstate(all="ignore"):
        try:
            for sample in range(mechanism.samples):
                first = sample * mechanism.count
                speed = partial(fastest_link, mechanism, read)
                steps += come_to_rest(mechanism.rest, partial(step, first), speed)
                for k in links:
                    states.place[sample, k], states.turn[sample, k] = read(k)[:2]
                if joint is not None:
                    for j in mechanism.singles:
                        value = joint(j)[0] + mechanism.joints[j].value
                        states.coordinates[:, sample, j] = value, 0.0, 0.0
                whole = sample + 1
                for i in range(1, mechanism.count if whole < mechanism.samples else 1):
                    step(first + i)
                steps += mechanism.count - 1
        except RunEnded as error:
            states = states.first(whole, f"{error} at sample {whole}")
    states.seconds, states.steps = watch.seconds, steps
    return states


def come_to_rest(rest: WayToRest, step: Callable[[], None], speed: Callable[[], float]) -> int:
    """Repeat a step until a mechanism is at rest at all checks of a period.

    Parameters
    ----------
    rest : WayToRest
    step : callable
    speed : callable
        The largest speed after a step [m/s], or in the unit of the speeds of `rest`; not finite if
        the mechanism is lost.

    Returns
    -------
    int
        The number of steps.

    Raises
    ------
    NoRest
        They are still too fast when they do not become slower, or after `WayToRest.most` steps.
    """
    least, waited, recent = np.inf, 0, [np.inf] * CALM_CHECKS
    for steps in range(rest.block, rest.most + 1, rest.block):
        for _ in range(rest.block):
            step()
        recent = [*recent[1:], speed()]
        largest, waited = max(recent), waited + 1
        if not np.isfinite(recent[-1]):
            raise NoRest("a position is not finite or lost")
        if largest < rest.speed:
            return steps
        if largest < SLOWER * least:
            least, waited = largest, 0
        if waited >= PATIENCE:
            break
    if largest < rest.slow:
        return steps
    raise NoRest(f"not at rest after {steps} steps, what is fastest moves at {largest:.2g} m/s")


def fastest_link(mechanism: NeutralMechanism, read: Callable[[int], LinkMotion]) -> float:
    """Speed of the fastest link, see `WayToRest.speed`; infinite if the mechanism is lost [m/s]."""
    motions = [read(k) for k in range(1, len(mechanism.links))]
    places = np.array([one[0] for one in motions])
    if not np.abs(places).max() < LOST_SIZES * mechanism.size:
        return np.inf
    linear, turning = (np.linalg.norm([one[i] for one in motions], axis=1) for i in (2, 3))
    return float((linear + mechanism.size * turning).max())
