r"""Rigid joint limits (stops) in a motion that is integrated.

A joint that reaches the end of its range with a rate is thrown back by an impact, in which the
equalities of the mechanism stay closed:

    M (v' - v) = Rᵀ p,    R v' = (0, -e w)        R: equalities, stops that are rested on, stops hit
                                                  w: rates into the stops, e: restitutions

A joint whose bounces have died out rests on its stop: the stop is an equality as long as it pushes,
and the joint leaves it when the force has fallen to zero (`proofmass.analytic.joints_at_rest`).
Between the events the motion is smooth (`proofmass.analytic.motion_events`); the times of impacts
are roots of the distances to the stops along the motion.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from proofmass.analytic.contacts import damping_ratio, restitution
from proofmass.analytic.mjcf import JointData
from proofmass.analytic.numerics import NotCovered
from proofmass.base.arrays import Array

AT_STOP_DISTANCE = 1e-10
"""Distance from a stop [rad, or sizes] below which a joint is at the stop."""
BEYOND_STOP_DISTANCE = 1e-12
"""Distance beyond a stop [rad, or sizes] above which it is not rounding."""
MIN_REBOUND_HEIGHT = 1e-13
"""Height of a rebound [rad, or sizes] below which it is left out: the joint rests on the stop."""
ZERO_RATE_SHARE = 1e-12
"""Rate that counts as zero, as a share of the fastest impact on the stop so far, or of 1 rad/s or
1 size/s if there was none."""
PROBE_SHARES = (0.25, 0.5, 0.75, 1.0)
"""Shares of a step at which the distances to stops are evaluated."""
DEPARTURE_SHARES = np.geomspace(1e-9, 0.5, 30)
"""Shares of a step at which a joint that starts at a stop is tested for having left it."""


@dataclass(frozen=True)
class Stop:
    """An end of the range of a joint.

    Attributes
    ----------
    joint : str
    pose, rate : int
        Indices of the joint in a pose and in the rates.
    value : float
        Joint value at the end of the range [rad or m].
    side : float
        1 for the upper end, -1 for the lower end [1].
    restitution : float
        Rate after an impact over the rate before it [1].
    size : float
        Unit of distances: 1 rad, or the size of the model [m].
    """

    joint: str
    pose: int
    rate: int
    value: float
    side: float
    restitution: float
    size: float = 1.0

    def gap(self, q: Array) -> float:
        """Distance of a pose from the stop, in sizes; negative beyond it."""
        return float(self.side * (self.value - q[self.pose]) / self.size)

    def gap_rate(self, v: Array) -> float:
        """Time derivative of `gap` for rates v [sizes/s]."""
        return float(-self.side * v[self.rate] / self.size)


State = tuple[Array, Array, Array]
"""Pose, rates and accelerations."""


@dataclass(frozen=True)
class Step:
    """A smooth part of a motion: its start and end [s], and the state as a function of time."""

    start: float
    end: float
    at: Callable[[float], State]


@dataclass(frozen=True)
class Balance:
    """Constraints of a mechanism in a state, without its stops, and the force they must exert.

    Attributes
    ----------
    rows : ndarray (rows, rates)
        Jacobian of the constraints [SI].
    mass : ndarray (rates, rates)
        Mass matrix [SI].
    needed : ndarray (rates,)
        Sum of the forces on the joints that constraints and stops must exert for the motion
        [N m or N].
    """

    rows: Array
    mass: Array
    needed: Array


def refuse_limit(name: str, limits: tuple[float, float], values: Array) -> None:
    """Raise ValueError if a driven joint leaves its range [rad or m] at one of the samples."""
    outside = (values < limits[0]) | (values > limits[1])
    if outside.any():
        raise ValueError(
            f"joint {name!r} leaves its range {limits} at sample {int(np.argmax(outside))}; "
            f"joint limits are not covered in driven motions"
        )


def make_stops(
    joint: str, limits: tuple[float, float], pose: int, rate: int, size: float
) -> Iterator[Stop]:
    """Make a stop for each finite end of a joint's range, with restitution 0."""
    for side, end in zip((-1.0, 1.0), limits, strict=True):
        if np.isfinite(end):
            yield Stop(joint, pose, rate, end, side, 0.0, size)


def stops_of_joint(joint: JointData, size: float) -> Iterator[Stop]:
    """Make the stops of a hinge or slide with the restitution of its limit.

    The restitution is the one that MuJoCo's soft limit approaches as it becomes stiffer.

    A limit with a margin acts at that distance from the end of the range.

    Raises
    ------
    NotCovered
        The limit has no damping ratio.
    """
    solref = joint.limit_solref
    for stop in make_stops(joint.name, joint.stop_range, joint.pose, joint.rate, size):
        if not (ratio := damping_ratio(solref)) >= 0.0:
            raise NotCovered(
                f"solreflimit of joint {joint.name!r} has no damping ratio: {solref.tolist()}"
            )
        yield replace(stop, restitution=restitution(ratio))


def unit_rows(stops: Sequence[Stop], rates: int) -> Array:
    """Jacobian of the values of the joints at some stops by the rates (stops, rates)."""
    return np.eye(rates)[[stop.rate for stop in stops]].reshape(-1, rates)


def find_flat_rebounds(
    hit: Sequence[Stop], state: State, rebound_rates: Sequence[float]
) -> list[int]:
    """Find rebounds (numbers of `hit`) lower than `MIN_REBOUND_HEIGHT`, by accelerations."""
    return [
        k
        for k, (stop, rate) in enumerate(zip(hit, rebound_rates, strict=True))
        if rate and (rate / stop.size) ** 2 < -2.0 * MIN_REBOUND_HEIGHT * stop.gap_rate(state[2])
    ]


def apply_impacts(
    balance: Balance,
    v: Array,
    held: tuple[Stop, ...],
    hit: Sequence[Stop],
    rebound_rates: Sequence[float],
) -> tuple[Array, tuple[Stop, ...]]:
    """Find the rates after impacts, and the stops on which joints still rest.

    `rebound_rates` has the rates of the joints that hit the stops `hit`, after the impact.
    """
    others, mass = balance.rows, balance.mass
    largest = np.abs(
        mass
    ).max()  # divides the mass, so that its rows are of the order of the others
    while True:
        rows = np.vstack([others, unit_rows([*held, *hit], v.size)])
        zeros = np.zeros((len(rows), len(rows)))
        matrix = np.block([[mass / largest, -rows.T], [rows, zeros]])
        wanted = np.concatenate(
            [mass @ v / largest, others @ v, np.zeros(len(held)), rebound_rates]
        )
        solved = np.linalg.lstsq(matrix, wanted, rcond=1e-13)[0]
        impulse = solved[v.size + len(others) :]
        stop_impulses = [-s.side * p for s, p in zip(held, impulse, strict=False)]
        if not stop_impulses or min(stop_impulses) >= 0.0:
            return np.asarray(solved[: v.size]), held
        held = tuple(s for k, s in enumerate(held) if k != int(np.argmin(stop_impulses)))


def impact_times(stops: Sequence[Stop], step: Step) -> Iterator[float]:
    """Iterate over the times at which the joints reach the stops that a step goes beyond."""
    duration = step.end - step.start
    states = {time: step.at(time) for time in (step.start, step.end)}
    (begin, *speeds), last = states[step.start], states[step.end]
    for stop in stops:
        gap = stop.gap(begin)
        max_rate = max(abs(stop.gap_rate(speeds[0])), abs(stop.gap_rate(last[1])))
        if (
            gap > AT_STOP_DISTANCE + 4.0 * duration * max_rate
        ):  # it cannot come near in so short a time
            continue
        for share in PROBE_SHARES:
            time = step.end if share == 1.0 else step.start + share * duration
            if time not in states:
                states[time] = step.at(time)
            if stop.gap(states[time][0]) < -BEYOND_STOP_DISTANCE:
                yield find_impact_time(stop, step, gap, time)
                break


def find_impact_time(stop: Stop, step: Step, start_gap: float, beyond: float) -> float:
    """Find the time at which a joint reaches a stop; at the time `beyond` it is beyond the stop.

    `start_gap` is the distance to the stop at the step's start.
    """
    from scipy.optimize import brentq  # slow to load

    if start_gap > AT_STOP_DISTANCE:
        return float(brentq(lambda s: stop.gap(step.at(s)[0]), step.start, beyond, xtol=1e-15))

    # the joint starts at the stop: the root after it has left the stop is looked for
    ahead = step.start + DEPARTURE_SHARES * (beyond - step.start)
    clear_times = (
        time for time in ahead.tolist() if stop.gap(step.at(time)[0]) > 0.1 * MIN_REBOUND_HEIGHT
    )
    if (clear := next(clear_times, None)) is None:
        return step.start
    return float(brentq(lambda s: stop.gap(step.at(s)[0]), clear, beyond, xtol=1e-15))
