"""Steps from sample to sample, and what the scripts of engines need of geometry."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from .mechanism import LinkStates, NeutralMechanism, PlainArray

LOST_SIZES = 1e3
"""Distance from the start, in sizes of the mechanism, beyond which a run is lost."""


class Refused(Exception):
    """The engine cannot express something of the mechanism; the message names it."""


class Stopwatch:
    """Processor time in a ``with`` block [s]."""

    def __enter__(self) -> Stopwatch:
        self.began, self.seconds = time.process_time(), 0.0
        return self

    def __exit__(self, *_: Any) -> None:
        self.seconds = time.process_time() - self.began


LinkMotion = tuple
"""Place (3,), rotation (3, 3), velocity (3,) and angular velocity (3,) of a link; engines with
exact accelerations add the acceleration (3,) and the angular acceleration (3,)."""


def record(
    mechanism: NeutralMechanism, step: Callable[[int], None], read: Callable[[int], LinkMotion]
) -> LinkStates:
    """Step through a run, and record the states of all links at its samples.

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

    Returns
    -------
    LinkStates
        They end before the first sample that is not finite or lost.
    """
    states, links = LinkStates.empty(mechanism), range(1, len(mechanism.links))
    count, h, middle = mechanism.count, mechanism.step, mechanism.rates_at < 0
    number, watch = 0, Stopwatch()
    with watch, np.errstate(all="ignore"):
        for sample in range(mechanism.samples):
            motions = [read(k) for k in links]
            place = np.array([one[0] for one in motions])
            if not np.isfinite(place).all() or np.abs(place).max() > LOST_SIZES * mechanism.size:
                found = states.first(sample, f"a position is not finite or lost at sample {sample}")
                break
            exact = len(motions[0]) > 4
            for k, one in zip(links, motions):
                states.place[sample, k], states.turn[sample, k] = one[0], one[1]
                states.velocity[sample, k], states.omega[sample, k] = one[2], one[3]
                if exact:
                    states.acceleration[sample, k], states.alpha[sample, k] = one[4], one[5]
            last = sample == mechanism.samples - 1
            for c in range((0 if exact else 1) if last else count):
                step(number)
                number += 1
                if c == 0 and not exact:
                    for k in links:
                        _, _, velocity, omega = read(k)
                        before = states.velocity[sample, k], states.omega[sample, k].copy()
                        states.acceleration[sample, k] = (velocity - before[0]) / h
                        states.alpha[sample, k] = (omega - before[1]) / h
                        if middle:
                            states.velocity[sample, k] = 0.5 * (velocity + before[0])
                            states.omega[sample, k] = 0.5 * (omega + before[1])
        else:
            found = states
    found.seconds = watch.seconds
    return found


def matrix_of(quaternion: PlainArray) -> PlainArray:
    """The rotation matrix (3, 3) of a quaternion (w, x, y, z).

    >>> matrix_of(np.array([1.0, 0.0, 0.0, 1.0])).round(12).tolist()
    [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    """
    w, x, y, z = np.asarray(quaternion, float) / np.linalg.norm(quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def turn_about(axis: PlainArray, angle: float) -> PlainArray:
    """The rotation matrix (3, 3) about a unit axis by an angle [rad]."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross


def frame_of_axis(axis: PlainArray) -> PlainArray:
    """A rotation matrix (3, 3) whose third column is an axis."""
    z = np.asarray(axis, float) / np.linalg.norm(axis)
    x = np.eye(3)[int(np.argmin(np.abs(z)))]
    x = x - (x @ z) * z
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


def in_space(
    mechanism: NeutralMechanism, link: int, at: PlainArray, angle: float, rates: PlainArray
) -> LinkMotion:
    """The motion of a link of a planar engine in the world.

    `at` is the centre in the plane (2,) [m], `angle` the rotation since the start [rad], and
    `rates` the velocity of the centre and the angular rate (3,).
    """
    e1, e2, normal = mechanism.plane
    height = mechanism.links[link].centre @ normal
    return (
        at[0] * e1 + at[1] * e2 + height * normal,
        turn_about(normal, angle),
        rates[0] * e1 + rates[1] * e2,
        rates[2] * normal,
    )
