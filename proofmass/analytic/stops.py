r"""Rigid joint limits (stops) in a motion that is integrated.

A joint that reaches the end of its range with a rate is thrown back by an impact, in which the
equalities of the mechanism stay closed:

    M (v' - v) = Rᵀ p,    R v' = (0, -e w)        R: equalities, stops that are rested on, stops hit
                                                  w: rates into the stops, e: restitutions

A joint whose bounces have died out rests on its stop: the stop is an equality as long as it pushes,
and the joint leaves it when the force has fallen to zero.  To find the stops on which joints rest
at first, the stop that pulls most is left out, again and again until no stop pulls.  Between the
events the motion is smooth; the times of the events are roots of the distances to the stops, or of
the forces of the stops, along the motion.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

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
MAX_EVENTS = 2000
"""Largest number of events in a motion."""
MAX_LISTED_TIMES = 4
"""Largest number of times of impacts that are listed for a joint."""


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
class Event:
    """A time [s] at which stops are hit, or at which the stop `left` is left."""

    time: float
    left: Stop | None = None


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


class SystemWithStops(Protocol):
    """A moving mechanism with stops."""

    @property
    def stops(self) -> Sequence[Stop]:
        """All stops."""

    def steps(
        self, held: tuple[Stop, ...], t: float, q: Array, v: Array, end: float
    ) -> Iterator[Step]:
        """Iterate over the motion from a state on, with joints resting on the stops `held`."""

    def state(self, held: tuple[Stop, ...], t: float, q: Array, v: Array) -> State:
        """Add the accelerations to a pose and its rates."""

    def balance(self, t: float, q: Array, v: Array, a: Array) -> Balance:
        """Constraints of the mechanism in a state at a time, and the force they must exert."""


@dataclass
class MotionWithStops:
    """States of a motion at samples, and the events at stops.

    Attributes
    ----------
    states : list of (pose, rates, accelerations)
    forces : list of ndarray (rates,)
        Forces of the stops on the joints, at the samples [N m or N].
    impacts, releases : list of (float, str)
        Times [s] and names of joints.
    rested : set of str
        Joints that rested on a stop for a while.
    """

    states: list[State] = field(default_factory=list)
    forces: list[Array] = field(default_factory=list)
    impacts: list[tuple[float, str]] = field(default_factory=list)
    releases: list[tuple[float, str]] = field(default_factory=list)
    rested: set[str] = field(default_factory=set)

    def arrays(self) -> State:
        """Poses, rates and accelerations of all samples (n, poses), (n, rates), (n, rates)."""
        q, v, a = (np.array(part) for part in zip(*self.states, strict=True))
        return q, v, a

    def events(self) -> str:
        """Describe the events at stops in words; empty if there were none."""
        joints = dict.fromkeys(joint for _, joint in self.impacts)
        texts = [
            f"{joint} hits a stop at t = "
            f"{', '.join(f'{t:.6g}' for t in times[:MAX_LISTED_TIMES])}"
            f"{', ..' if len(times) > MAX_LISTED_TIMES else ''} s ({len(times)} in all)"
            for joint in joints
            for times in ([t for t, one in self.impacts if one == joint],)
        ]
        texts += [f"{joint} rests on a stop" for joint in sorted(self.rested)]
        texts += [f"{joint} leaves its stop at t = {t:.6g} s" for t, joint in self.releases]
        return "; ".join(texts)


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

    Raises
    ------
    NotCovered
        The limit has a margin, so that it acts before it is reached, or has no damping ratio.
    """
    solref = joint.limit_solref
    for stop in make_stops(joint.name, joint.range, joint.pose, joint.rate, size):
        if joint.margin:
            raise NotCovered(f"joint {joint.name!r} has a margin of its range")
        if not (ratio := damping_ratio(solref)) >= 0.0:
            raise NotCovered(
                f"solreflimit of joint {joint.name!r} has no damping ratio: {solref.tolist()}"
            )
        yield replace(stop, restitution=restitution(ratio))


def integrate_with_stops(
    system: SystemWithStops, times: Array, q: Array, v: Array
) -> MotionWithStops:
    """Integrate the motion from a closed pose with its rates, at rising times.

    Parameters
    ----------
    system : SystemWithStops
    times : ndarray (n,)
        Times of the samples, rising [s].
    q, v : ndarray (poses,), (rates,)
        Pose and rates at the first time [SI].

    Raises
    ------
    NotCovered
        The start is beyond a stop, or stops are hit too often.
    """
    found, end = MotionWithStops(), float(times[-1])
    fastest: dict[Stop, float] = {}
    t, held = float(times[0]), tuple[Stop, ...]()
    event: Event | None = None
    for stop in system.stops:
        if stop.gap(q) < -AT_STOP_DISTANCE:
            raise NotCovered(
                f"joint {stop.joint!r} starts at {q[stop.pose]:.6g}, beyond the end of its range, "
                f"{stop.value:.6g}"
            )
    for _ in range(MAX_EVENTS):
        held, v = resolve_event(system, found, fastest, held, event, t, q, v)
        if len(found.states) < times.size and times[len(found.states)] <= t:
            record_states(system, found, held, [t], [system.state(held, t, q, v)])
        event = None
        for step in system.steps(held, t, q, v, end):
            event = find_first_event(system, held, step)
            left = times[len(found.states) :]
            inside = left[left <= step.end] if event is None else left[left < event.time]
            record_states(system, found, held, inside.tolist(), list(map(step.at, inside.tolist())))
            if event is not None:
                break
        if event is None:
            return found
        q, v, _ = step.at(step.start)
        # integrated up to the event anew: dense output is less accurate than a step's end
        for part in system.steps(held, step.start, q, v, event.time):
            q, v, _ = part.at(part.end)
        t = event.time
    raise NotCovered(f"stops are hit or left {MAX_EVENTS} times until t = {t:.6g} s")


def record_states(
    system: SystemWithStops,
    found: MotionWithStops,
    held: tuple[Stop, ...],
    times: Sequence[float],
    states: Sequence[State],
) -> None:
    """Record states at times, and the forces of the stops there."""
    found.states += states
    for t, (q, v, a) in zip(times, states, strict=True):
        joint_forces = np.zeros_like(v)
        if held:
            forces = stop_forces(system, held, t, (q, v, a))
            for stop, force in zip(held, forces, strict=True):
                joint_forces[stop.rate] -= stop.side * force
        found.forces.append(joint_forces)


def stop_forces(system: SystemWithStops, held: tuple[Stop, ...], t: float, state: State) -> Array:
    """Find the forces of stops into the ranges of their joints [N m or N]; negative: it pulls."""
    balance = system.balance(t, *state)
    rows = np.vstack([balance.rows, unit_rows(held, balance.needed.size)])
    solved = np.linalg.lstsq(rows.T, balance.needed, rcond=1e-12)[0]
    sides = np.array([stop.side for stop in held])
    return np.asarray(-sides * solved[len(rows) - len(held) :])


def unit_rows(stops: Sequence[Stop], rates: int) -> Array:
    """Jacobian of the values of the joints at some stops by the rates (stops, rates)."""
    return np.eye(rates)[[stop.rate for stop in stops]].reshape(-1, rates)


def resolve_event(
    system: SystemWithStops,
    found: MotionWithStops,
    fastest: dict[Stop, float],
    held: tuple[Stop, ...],
    event: Event | None,
    t: float,
    q: Array,
    v: Array,
) -> tuple[tuple[Stop, ...], Array]:
    """Find the stops on which joints rest from a state on, and the rates after impacts there."""
    left = event.left if event else None
    near = [stop for stop in system.stops if stop.gap(q) <= AT_STOP_DISTANCE and stop is not left]
    if left:
        found.releases.append((t, left.joint))
    held = tuple(stop for stop in held if stop is not left)
    hit = [
        s for s in near if s not in held and s.gap_rate(v) < -ZERO_RATE_SHARE * fastest.get(s, 1.0)
    ]
    if hit:
        rebound_rates = [-stop.restitution * v[stop.rate] for stop in hit]
        # a rate counts as zero relative to the fastest impact, as bounces become ever lower
        for stop in hit:
            fastest[stop] = max(fastest.get(stop, 0.0), -stop.gap_rate(v))
            found.impacts.append((t, stop.joint))
        while True:
            after, remaining = apply_impacts(system, t, q, v, held, hit, rebound_rates)
            too_low = find_flat_rebounds(hit, system.state(remaining, t, q, after), rebound_rates)
            if not too_low:
                break
            rebound_rates = [0.0 if k in too_low else rate for k, rate in enumerate(rebound_rates)]
        v, held = after, remaining
    resting = [s for s in near if abs(s.gap_rate(v)) <= ZERO_RATE_SHARE * fastest.get(s, 1.0)]
    # a stop cannot pull: the one that pulls most is left, which changes the forces of the others
    while resting:
        force = stop_forces(system, tuple(resting), t, system.state(tuple(resting), t, q, v))
        if force.min() >= 0.0:
            break
        resting.pop(int(np.argmin(force)))
    found.rested |= {stop.joint for stop in resting}
    return tuple(resting), v


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
    system: SystemWithStops,
    t: float,
    q: Array,
    v: Array,
    held: tuple[Stop, ...],
    hit: Sequence[Stop],
    rebound_rates: Sequence[float],
) -> tuple[Array, tuple[Stop, ...]]:
    """Find the rates after impacts, and the stops on which joints still rest.

    `rebound_rates` has the rates of the joints that hit the stops `hit`, after the impact.
    """
    balance = system.balance(t, q, v, np.zeros_like(v))
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


def find_first_event(system: SystemWithStops, held: tuple[Stop, ...], step: Step) -> Event | None:
    """Find the first event of a step: a stop is hit, or the force of a stop falls to zero."""
    if not system.stops:
        return None
    free = [stop for stop in system.stops if stop not in held]
    found = [Event(time) for time in impact_times(free, step)]
    if held and (release := find_release(system, held, step)):
        found.append(release)
    return min(found, key=lambda one: one.time, default=None)


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


def find_release(system: SystemWithStops, held: tuple[Stop, ...], step: Step) -> Event | None:
    """Find the first time at which the force of a stop that is rested on falls to zero."""
    from scipy.optimize import brentq  # slow to load

    def push(k: int) -> Callable[[float], float]:
        return lambda time: float(stop_forces(system, held, time, step.at(time))[k])

    found = []
    begin, end = (stop_forces(system, held, t, step.at(t)) for t in (step.start, step.end))
    for k in np.flatnonzero(end < 0.0).tolist():
        root = brentq(push(k), step.start, step.end, xtol=1e-15) if begin[k] > 0 else step.start
        found.append(Event(float(root), held[k]))
    return min(found, key=lambda one: one.time, default=None)
