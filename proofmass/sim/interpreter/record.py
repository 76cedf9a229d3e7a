"""Steps from sample to sample."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np

from .checks import LOST_SIZES, RunEnded, Stopwatch, check_motions
from .geometry import LinkMotion
from .joint_rates import follow_joints
from .mechanism import LinkStates, NeutralMechanism, PlainArray
from .rests import record_rests


def record(
    mechanism: NeutralMechanism,
    step: Callable[[int], None],
    read: Callable[[int], LinkMotion],
    joint: Callable[[int], tuple] | None = None,
) -> LinkStates:
    """Step through a run, and record the states of all links at its samples.

    A run that comes to rest at its samples is that of `record_rests`.

    Where `read` gives no accelerations, those at a sample are the difference quotients of the
    velocity over the step that begins at it.  Where the rates of the start are those half a step
    before it, `NeutralMechanism.rates_at`, the velocity at a sample is the mean of those before
    and behind it: steps of a semi-implicit Euler method are then leapfrog steps, of second order.

    Parameters
    ----------
    mechanism : NeutralMechanism
    step : callable
        ``step(i)`` makes step number i.
    read : callable
        ``read(k)`` is the `LinkMotion` of link number k, the ground excluded.
    joint : callable, optional
        ``joint(j)`` are the coordinate, 0 at the start, and the rate of hinge or slide number j, in
        an engine that has them; one with exact accelerations adds that of the joint.  Where rates
        are those in the middle of steps, the velocities of links then follow from those of joints,
        see `follow_joints`.

    Returns
    -------
    LinkStates
        They end before the first sample that is not finite or lost, or that a step raises
        `RunEnded` on the way to.
    """
    if mechanism.rest:
        return record_rests(mechanism, step, read, joint)
    states, links = LinkStates.empty(mechanism, joint is not None), range(1, len(mechanism.links))
    count, h, middle = mechanism.count, mechanism.step, mechanism.rates_at < 0
    number, whole, watch = 0, 0, Stopwatch()

    def read_joints() -> dict:
        return {j: joint(j) for j in mechanism.singles} if joint else {}

    def take_differences(sample: int) -> None:
        """Set accelerations at a sample from the rates behind the step that begins there."""
        for k in links:
            rates = (states.velocity, states.acceleration), (states.omega, states.alpha)
            for (rate, change), now in zip(rates, read(k)[2:]):
                take_difference(rate[sample, k], change[sample, k], now, h, middle)
        for j, (_, later, *_) in read_joints().items():
            _, rate, change = states.coordinates[:, sample, j, None]
            take_difference(rate, change, later, h, middle)

    with watch, np.errstate(all="ignore"):
        try:
            for sample in range(mechanism.samples):
                motions = [read(k) for k in links]
                if sample == 0:
                    check_motions(motions)
                check_places(mechanism, motions, sample)
                exact = len(motions[0]) > 4
                for k, one in zip(links, motions):
                    states.set(sample, k, one)
                for j, (value, *others) in read_joints().items():
                    row = value + mechanism.joints[j].value, *others
                    states.coordinates[: len(row), sample, j] = row
                whole = sample + exact
                last = sample == mechanism.samples - 1
                for c in range((0 if exact else 1) if last else count):
                    step(number)
                    number += 1
                    if c == 0 and not exact:
                        take_differences(sample)
                    whole = sample + 1
        except RunEnded as error:
            states = states.first(whole, str(error))
    if joint and middle:
        follow_joints(mechanism, states)
    states.seconds = watch.seconds
    return states


def check_places(mechanism: NeutralMechanism, motions: list, sample: int) -> None:
    """Raise `RunEnded` if a place is not finite, or too far away."""
    place = np.array([one[0] for one in motions])
    if not np.isfinite(place).all() or np.abs(place).max() > LOST_SIZES * mechanism.size:
        raise RunEnded(f"a position is not finite or lost at sample {sample}")


def without_steps(mechanism: NeutralMechanism) -> NeutralMechanism:
    """The mechanism with one step from sample to sample, for an engine that chooses its own.

    Steps of a run that comes to rest remain.
    """
    if mechanism.rest:
        return mechanism
    return replace(mechanism, step=mechanism.count * mechanism.step, count=1)


def rows_at_samples(mechanism: NeutralMechanism, tables: Iterable[PlainArray]) -> list:
    """Rows of tables of an engine that stores its samples itself, without their times.

    Parameters
    ----------
    mechanism : NeutralMechanism
    tables : iterable of ndarray (n, 1 + values)
        Each has the time [s] and values at each sample.

    Returns
    -------
    list of ndarray (m, values)
        Those before the first sample that the run did not hit.
    """
    found = []
    for table in tables:
        rows = np.atleast_2d(table)[: mechanism.samples]
        steps = mechanism.count * np.arange(len(rows))
        late = np.abs(rows[:, 0] / mechanism.step - steps) > 0.5
        found.append(rows[: int(np.argmax([*late, True])), 1:])
    return found


def take_difference(
    rate: PlainArray, change: PlainArray, later: PlainArray, step: float, middle: bool
) -> None:
    """Set an acceleration from rates before and behind a step, and the rate to their mean.

    The rate remains as it is unless the rates are those in the `middle` of steps.
    """
    change[...] = (later - rate) / step
    if middle:
        rate[...] = 0.5 * (later + rate)
