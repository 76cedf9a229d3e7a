r"""A motion that is integrated from event to event: stops, and dry friction of joints.

Between two events each joint with dry friction slips in one sense or sticks, and joints rest on
stops; such a part of a motion is a `Phase`.  It is smooth: the friction of a joint that slips is
constant, and joints that stick or rest are equalities.  The events are

    a joint reaches a stop      an impact, in which friction has no impulse and no joint sticks
    a slipping joint halts      its rate is zero
    the forces at rest end      a stop does not push any more, or friction reaches its bound

After an impact and a halt `proofmass.analytic.joints_at_rest` decides for all joints at rest
together, those that stuck before included.  Where forces at rest end, no decision is needed: the
motion that begins is known, and all joints that it moves begin to slip at the same time.  The work
of friction needs no integration, as a joint with the friction F loses F times its way.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cache, cached_property
from itertools import pairwise
from typing import Protocol

import numpy as np

from proofmass.analytic.joints_at_rest import (
    DEAD_POINT_MOBILITY,
    TIE_TOLERANCE,
    RestForces,
    RestRows,
    free_motions,
)
from proofmass.analytic.numerics import NotCovered, SingularHere
from proofmass.analytic.stops import (
    AT_STOP_DISTANCE,
    ZERO_RATE_SHARE,
    Balance,
    State,
    Step,
    Stop,
    apply_impacts,
    find_flat_rebounds,
    impact_times,
)
from proofmass.base.arrays import Array

MAX_EVENTS = 2000
"""Largest number of events in a motion."""
MAX_EVENTS_AT_ONCE = 50
"""Largest number of events in turn at one time: more joints than that do not stick."""
MAX_LISTED_TIMES = 4
"""Largest number of times of events that are listed for a joint."""
HALT_RATE_SHARE = 1e-11
"""Rate of a joint with friction that counts as zero, as a share of its fastest rate so far: errors
of rates are of the order of 1e-13 of it."""
SLOW_RATE = 1e-3
"""Smallest rate that counts as the fastest so far [rad/s, or sizes/s], so that rates of a joint
that has not moved yet are not measured by rounding."""
RATE_PROBES, EARLY_PROBES = np.linspace(0.25, 1.0, 4), np.geomspace(1e-6, 1e-2, 3)
"""Shares of a step at which rates are evaluated: near its start too where a joint begins to slip,
since one that breaks loose starts with no acceleration."""
FORCE_PROBES = np.linspace(0.0, 1.0, 3)
"""Shares of a step at which the forces at rest are evaluated."""
MIN_STEPS_IN_TIME = 256
"""Least number of steps of a motion under drives or changing controls while joints are at rest:
nothing else would limit the steps of a mechanism that does not move, and a peak of a load would be
missed.  Steps are not longer than the distance of the samples either."""
MINIMUM_TIME_SHARE = 1e-6
"""Share of the time between probes to which a minimum is located: its value is then right to the
square of that."""
SAME_TIME = 1e-12
"""Distance of events [s] that counts as none."""
HALT_TIME_ROUNDING = 1e-15
"""Correction of the time of a halt [s] that is rounding."""


@dataclass(frozen=True)
class FrictionJoint:
    """A hinge or slide with dry friction.

    Attributes
    ----------
    joint : str
    pose, rate : int
        Indices of the joint in a pose and in the rates.
    bound : float
        Largest friction, which is also that of slip [N m or N].
    size : float
        Unit of its motion: 1 rad, or the size of the model [m].
    """

    joint: str
    pose: int
    rate: int
    bound: float
    size: float = 1.0


@dataclass(frozen=True)
class StuckJoint:
    """A joint that sticks at a value [rad or m]."""

    friction: FrictionJoint
    value: float

    @property
    def joint(self) -> str:
        """Name of the joint."""
        return self.friction.joint

    @property
    def pose(self) -> int:
        """Index of the joint in a pose."""
        return self.friction.pose

    @property
    def rate(self) -> int:
        """Index of the joint in the rates."""
        return self.friction.rate


@dataclass(frozen=True)
class Phase:
    """What all joints do between two events.

    Attributes
    ----------
    resting : tuple of Stop
        Stops on which joints rest.
    stuck : tuple of StuckJoint
    slipping : tuple of (FrictionJoint, float)
        Joints that slip, with their senses, 1 or -1 [1].
    """

    resting: tuple[Stop, ...] = ()
    stuck: tuple[StuckJoint, ...] = ()
    slipping: tuple[tuple[FrictionJoint, float], ...] = ()

    @cached_property
    def held(self) -> tuple["Stop | StuckJoint", ...]:
        """Joints with a constant value: those that rest on stops, then those that stick."""
        return (*self.resting, *self.stuck)

    def friction(self, rates: int) -> Array:
        """Forces of the joints that slip (rates,) [N m or N]."""
        found = np.zeros(rates)
        for one, sense in self.slipping:
            found[one.rate] -= sense * one.bound
        return found

    def work(self, change: Array) -> float:
        """Work of friction for a change of the pose (poses,) during this phase [J]."""
        return -sum(sense * one.bound * float(change[one.pose]) for one, sense in self.slipping)

    def fix(self, q: Array, v: Array, a: Array) -> State:
        """The state with the values of joints at rest, which equalities keep up to rounding."""
        if not self.held:
            return q, v, a
        q, v, a = q.copy(), v.copy(), a.copy()
        for one in self.held:
            q[one.pose], v[one.rate], a[one.rate] = one.value, 0.0, 0.0
        return q, v, a


@dataclass(frozen=True)
class Event:
    """A time [s] at which stops are hit, the joint `halted` halts, or forces at rest end."""

    time: float
    halted: FrictionJoint | None = None
    ends_rest: bool = False


class MovingSystem(Protocol):
    """A moving mechanism with stops and dry friction."""

    @property
    def stops(self) -> Sequence[Stop]:
        """All stops."""

    @property
    def frictions(self) -> Sequence[FrictionJoint]:
        """All joints with dry friction that are not driven."""

    @property
    def changes_in_time(self) -> bool:
        """Whether drives or controls follow profiles in time."""

    def steps(
        self, phase: Phase, t: float, q: Array, v: Array, end: float, longest: float
    ) -> Iterator[Step]:
        """Iterate over the motion in a phase from a state on, in steps up to a length [s]."""

    def state(self, phase: Phase, t: float, q: Array, v: Array) -> State:
        """Add the accelerations to a pose and its rates."""

    def balance(self, t: float, q: Array, v: Array, a: Array) -> Balance:
        """Constraints of the mechanism in a state at a time, and the force they must exert."""


@dataclass
class MotionWithEvents:
    """States of a motion at samples, and its events.

    Attributes
    ----------
    states : list of (pose, rates, accelerations)
    forces : list of ndarray (rates,)
        Forces of stops and of dry friction on the joints, at the samples [N m or N]; NaN where the
        motion does not determine them.
    friction_work : list of float
        Work of the dry friction of joints that are not driven, from the start to the samples [J].
    prescribed : set of int
        Indices in the rates of joints with friction whose motion loops and drives prescribe: their
        friction acts on the drives alone and is in neither `forces` nor `friction_work`.
    impacts, releases : list of (float, str)
        Times [s] and names of joints.
    rested : set of str
        Joints that rested on a stop for a while.
    halts, slips : list of (float, str)
        Times [s] at which joints stick or turn back, and at which joints that stuck slip.
    stuck_at_end : tuple of str
        Joints that stick at the end.
    """

    states: list[State] = field(default_factory=list)
    forces: list[Array] = field(default_factory=list)
    friction_work: list[float] = field(default_factory=list)
    prescribed: set[int] = field(default_factory=set)
    impacts: list[tuple[float, str]] = field(default_factory=list)
    releases: list[tuple[float, str]] = field(default_factory=list)
    rested: set[str] = field(default_factory=set)
    halts: list[tuple[float, str]] = field(default_factory=list)
    slips: list[tuple[float, str]] = field(default_factory=list)
    stuck_at_end: tuple[str, ...] = ()

    def arrays(self) -> State:
        """Poses, rates and accelerations of all samples (n, poses), (n, rates), (n, rates)."""
        q, v, a = (np.array(part) for part in zip(*self.states, strict=True))
        return q, v, a

    def events(self) -> str:
        """Describe the events at stops in words; empty if there were none."""
        texts = list(list_times(self.impacts, "hits a stop"))
        texts += [f"{joint} rests on a stop" for joint in sorted(self.rested)]
        texts += [f"{joint} leaves its stop at t = {t:.6g} s" for t, joint in self.releases]
        return "; ".join(texts)

    def friction_events(self) -> str:
        """Describe the events of dry friction in words; empty without friction."""
        if not self.friction_work or not (self.halts or self.slips or self.stuck_at_end):
            return ""
        texts = list(list_times(self.halts, "halts"))
        texts += list_times(self.slips, "breaks loose")
        texts += [f"{joint} sticks at the end" for joint in self.stuck_at_end]
        return "; ".join([*texts, f"work of friction {self.friction_work[-1]:.6g} J"])


def rest_in_steps(t: float, end: float, state: State, longest: float) -> Iterator[Step]:
    """Iterate over steps up to a length in which nothing moves."""
    count = max(1, int(np.ceil((end - t) / longest)))
    for start, last in pairwise(np.linspace(t, end, count + 1).tolist()):
        yield Step(start, last, lambda _: state)


def list_times(events: Sequence[tuple[float, str]], what: str) -> Iterator[str]:
    """Describe the times of events of each joint in words.

    >>> list(list_times([(0.1, "pin"), (0.25, "pin")], "halts"))
    ['pin halts at t = 0.1, 0.25 s (2 in all)']
    """
    for joint in dict.fromkeys(name for _, name in events):
        times = [t for t, one in events if one == joint]
        listed = ", ".join(f"{t:.6g}" for t in times[:MAX_LISTED_TIMES])
        more = ", .." if len(times) > MAX_LISTED_TIMES else ""
        yield f"{joint} {what} at t = {listed}{more} s ({len(times)} in all)"


def integrate_with_events(
    system: MovingSystem, times: Array, q: Array, v: Array
) -> MotionWithEvents:
    """Integrate the motion from a closed pose with its rates, at rising times.

    Parameters
    ----------
    system : MovingSystem
    times : ndarray (n,)
        Times of the samples, rising [s].
    q, v : ndarray (poses,), (rates,)
        Pose and rates at the first time [SI].

    Raises
    ------
    NotCovered
        The start is beyond a stop, or there are too many events.
    SingularHere
        A joint with friction is at a dead point of its motion and at rest.
    """
    for stop in system.stops:
        if stop.gap(q) < -AT_STOP_DISTANCE:
            raise NotCovered(
                f"joint {stop.joint!r} starts at {q[stop.pose]:.6g}, beyond the end of its range, "
                f"{stop.value:.6g}"
            )
    return EventFollower(system, times, q, v).follow()


def phase_after(
    resting: Sequence[Stop],
    stuck: Sequence[StuckJoint],
    senses: Sequence[float],
    slipping: tuple[tuple[FrictionJoint, float], ...],
) -> Phase:
    """The phase in which joints at rest go on with these senses: 0 of those that stay at rest.

    The senses are those of the joints that rest on stops, then of those that stick; `slipping` are
    the joints that slip already.
    """
    of_stops, of_joints = senses[: len(resting)], senses[len(resting) :]
    return Phase(
        tuple(stop for stop, sense in zip(resting, of_stops, strict=True) if not sense),
        tuple(one for one, sense in zip(stuck, of_joints, strict=True) if not sense),
        slipping
        + tuple(
            (one.friction, sense) for one, sense in zip(stuck, of_joints, strict=True) if sense
        ),
    )


def mobility_of(motions: Array, mass: Array, rates: Sequence[int]) -> Array:
    """Motion of some rates with the free motions, as a share of that without loops."""
    moves = np.linalg.norm(motions[rates], axis=1)
    return np.asarray(moves / np.sqrt(np.diag(np.linalg.inv(mass))[rates]))


class EventFollower:
    """A motion that is followed from event to event, at a present time and state."""

    def __init__(self, system: MovingSystem, times: Array, q: Array, v: Array):
        self.system, self.times, self.found = system, times, MotionWithEvents()
        self.t, self.q, self.v, self.phase = float(times[0]), q, v, Phase()
        self.hardest_impacts = dict[Stop, float]()
        self.fastest = {one: SLOW_RATE * one.size for one in system.frictions}
        self.work, self.phase_start, self.stop_unit, self.events_at_once = 0.0, q, 1.0, 0
        steps = max(MIN_STEPS_IN_TIME, times.size - 1)
        self.longest = float(times[-1] - times[0]) / steps if system.changes_in_time else np.inf
        self.frictions = tuple(system.frictions)
        if self.frictions:
            balance = self.balance(Phase())
            motions = free_motions(balance.mass, balance.rows)
            mobility = mobility_of(motions, balance.mass, [one.rate for one in self.frictions])
            self.found.prescribed = {
                one.rate
                for one, share in zip(self.frictions, mobility, strict=True)
                if share < DEAD_POINT_MOBILITY
            }
        self.frictions = tuple(
            one for one in self.frictions if one.rate not in self.found.prescribed
        )

    def balance(self, phase: Phase) -> Balance:
        """The balance of the present state in a phase."""
        return self.system.balance(self.t, *self.system.state(phase, self.t, self.q, self.v))

    def follow(self) -> MotionWithEvents:
        """Follow the motion to the last sample."""
        self.enter(None)
        for _ in range(MAX_EVENTS):
            due = len(self.found.states)
            if due < self.times.size and self.times[due] <= self.t:
                state = self.system.state(self.phase, self.t, self.q, self.v)
                self.record([self.t], [state])
            if (event := self.go_to_event()) is None:
                self.found.stuck_at_end = tuple(one.joint for one in self.phase.stuck)
                return self.found
            self.enter(event)
        raise NotCovered(f"there are {MAX_EVENTS} events until t = {self.t:.6g} s")

    def go_to_event(self) -> Event | None:
        """Follow the present phase to its next event, and record the samples on the way."""
        end = float(self.times[-1])
        for step in self.system.steps(
            self.phase, self.t, self.q, self.v, end, self.longest if self.phase.held else np.inf
        ):
            states = cache(step.at)
            known = Step(step.start, step.end, states)
            event = self.first_event(known)
            left = self.times[len(self.found.states) :]
            inside = left[left <= step.end] if event is None else left[left < event.time]
            self.record(inside.tolist(), list(map(states, inside.tolist())))
            if event is not None:
                return self.arrive(event, known)
        return None

    def arrive(self, event: Event, step: Step) -> Event:
        """Integrate up to an event anew: dense output is less accurate than a step's end.

        The time of a halt is improved by a step of Newton's method with the state that is found.
        """
        before, self.t = self.t, event.time
        q, v, a = step.at(step.start)
        self.q, self.v = q, v
        for part in self.system.steps(self.phase, step.start, q, v, self.t, np.inf):
            self.q, self.v, a = part.at(part.end)
        if (one := event.halted) and self.t > step.start and a[one.rate]:
            change = float(self.v[one.rate] / a[one.rate])
            later = self.t - change
            if HALT_TIME_ROUNDING < abs(change) < 0.1 * (self.t - step.start):
                self.t = later
                for part in self.system.steps(self.phase, step.start, q, v, later, np.inf):
                    self.q, self.v, _ = part.at(part.end)
        self.events_at_once = self.events_at_once + 1 if self.t - before < SAME_TIME else 0
        if self.events_at_once > MAX_EVENTS_AT_ONCE:
            raise NotCovered(f"events follow each other without end at t = {self.t:.6g} s")
        return event

    def record(self, times: Sequence[float], states: Sequence[State]) -> None:
        """Record states at times, with the forces of stops and friction there."""
        self.found.states += states
        for t, state in zip(times, states, strict=True):
            joint_forces = self.phase.friction(state[1].size)
            if self.phase.held:
                rest = self.rest_forces(t, state)
                forces = rest.forces if rest.unique else np.full(rest.forces.size, np.nan)
                signs = rest_signs(self.phase.resting, self.phase.stuck)
                for one, force in zip(self.phase.held, signs * forces, strict=True):
                    joint_forces[one.rate] += force
            self.found.forces.append(joint_forces)
            self.found.friction_work.append(
                self.work + self.phase.work(state[0] - self.phase_start)
            )

    def rest_forces(self, t: float, state: State) -> RestForces:
        """Forces of the joints at rest in the present phase, in a state at a time."""
        balance = self.system.balance(t, *state)
        motions = free_motions(balance.mass, balance.rows)
        needed = motions.T @ (balance.needed - self.phase.friction(balance.needed.size))
        rows = self.rest_rows(
            self.phase.resting, [one.friction for one in self.phase.stuck], motions
        )
        return rows.find_forces(needed)

    def rest_rows(
        self, resting: Sequence[Stop], stuck: Sequence[FrictionJoint], motions: Array
    ) -> RestRows:
        """The rows of stops and of joints with friction that are at rest."""
        places = [*rates_of(resting), *rates_of(stuck)]
        return RestRows(
            rest_signs(resting, stuck)[:, None] * motions[places],
            np.array([self.stop_unit] * len(resting) + [one.bound for one in stuck]),
            np.arange(len(places)) < len(resting),
        )

    # --- what happens at an event

    def enter(self, event: Event | None) -> None:
        """Find the phase that follows an event at the present state, and the rates after it."""
        self.work += self.phase.work(self.q - self.phase_start)
        self.phase_start, before = self.q, self.phase
        hit = self.stops_hit()
        if event and event.ends_rest and not hit:
            self.phase = self.leave_rest()
        else:
            resting = self.rebound(hit) if hit else before.resting
            if event and event.halted:
                self.halt(event.halted, resting)
            self.phase = self.decide()
        self.found.rested |= {stop.joint for stop in self.phase.resting}
        self.list_changes(before, event)
        if self.phase.resting:
            self.stop_unit = self.find_stop_unit()

    def list_changes(self, before: Phase, event: Event | None) -> None:
        """Record what joints begin to do."""
        if event is None:
            return
        slip_before = {one.rate: sense for one, sense in before.slipping}
        for one, sense in self.phase.slipping:
            if one.rate not in slip_before:
                self.found.slips.append((self.t, one.joint))
            elif slip_before[one.rate] != sense:
                self.found.halts.append((self.t, one.joint))
        for stuck in self.phase.stuck:
            if stuck.rate in slip_before:
                self.found.halts.append((self.t, stuck.joint))

    def stops_hit(self) -> list[Stop]:
        """Stops that joints hit with the present rates."""
        return [
            stop
            for stop in self.system.stops
            if stop not in self.phase.resting
            and stop.gap(self.q) <= AT_STOP_DISTANCE
            and stop.gap_rate(self.v) < -ZERO_RATE_SHARE * self.hardest_impacts.get(stop, 1.0)
        ]

    def rebound(self, hit: Sequence[Stop]) -> tuple[Stop, ...]:
        """Change the rates by impacts on stops; return the stops on which joints still rest.

        Joints that stick are let go: friction is bounded and has no impulse.
        """
        v, resting = self.v, self.phase.resting
        rebound_rates = [-stop.restitution * v[stop.rate] for stop in hit]
        # a rate counts as zero relative to the hardest impact, as bounces become ever lower
        for stop in hit:
            hardest = self.hardest_impacts.get(stop, 0.0)
            self.hardest_impacts[stop] = max(hardest, -stop.gap_rate(v))
            self.found.impacts.append((self.t, stop.joint))
        balance = self.system.balance(self.t, self.q, v, np.zeros_like(v))
        while True:
            after, remaining = apply_impacts(balance, v, resting, hit, rebound_rates)
            phase = Phase(remaining, (), tuple(self.senses(after)))
            state = self.system.state(phase, self.t, self.q, after)
            too_low = find_flat_rebounds(hit, state, rebound_rates)
            if not too_low:
                self.v = after
                return remaining
            rebound_rates = [0.0 if k in too_low else rate for k, rate in enumerate(rebound_rates)]

    def senses(self, v: Array) -> Iterator[tuple[FrictionJoint, float]]:
        """Iterate over the joints that slip at rates v (rates,), with their senses."""
        for one in self.frictions:
            if abs(v[one.rate]) > HALT_RATE_SHARE * self.fastest[one]:
                yield one, float(np.sign(v[one.rate]))

    def halt(self, joint: FrictionJoint, resting: tuple[Stop, ...]) -> None:
        """Make the rate of a joint zero, by the least change of the rates in the metric of M.

        At its dead point a joint halts although the mechanism moves on, and its friction only
        changes sides.
        """
        held = [*rates_of(resting), *rates_of(self.phase.stuck)]
        balance = self.balance(Phase(slipping=self.phase.slipping))
        rows = np.vstack([balance.rows, np.eye(self.v.size)[held]])
        motions = free_motions(balance.mass, rows)
        if mobility_of(motions, balance.mass, [joint.rate])[0] > DEAD_POINT_MOBILITY:
            row = motions[joint.rate]
            self.v = self.v - motions @ row * (self.v[joint.rate] / (row @ row))

    def decide(self) -> Phase:
        """Decide which joints at rest stick or rest on stops, by the convex problem.

        Raises
        ------
        SingularHere
            A joint is at its dead point and at rest, so that its friction has no sense.
        """
        slipping = tuple(self.senses(self.v))
        moving = {one for one, _ in slipping}
        touched = [
            stop
            for stop in self.system.stops
            if stop.gap(self.q) <= AT_STOP_DISTANCE
            and abs(stop.gap_rate(self.v)) <= ZERO_RATE_SHARE * self.hardest_impacts.get(stop, 1.0)
        ]
        still = [one for one in self.frictions if one not in moving]
        if not touched and not still:
            return Phase(slipping=slipping)
        free = Phase(slipping=slipping)
        _, _, a = state = self.system.state(free, self.t, self.q, self.v)
        balance = self.system.balance(self.t, *state)
        motions = free_motions(balance.mass, balance.rows)
        if still:
            mobility = mobility_of(motions, balance.mass, [one.rate for one in still])
            dead = [
                one
                for one, share in zip(still, mobility, strict=True)
                if share < DEAD_POINT_MOBILITY
            ]
            slipping += tuple((one, self.sense_at_dead_point(one, a)) for one in dead)
            still = [one for one in still if one not in dead]
        signs = rest_signs(touched, still)
        acceleration = signs * a[[*rates_of(touched), *rates_of(still)]]
        self.stop_unit = self.unit_of_acceleration(motions, touched, still, acceleration)
        senses = self.rest_rows(touched, still, motions).decide(acceleration).tolist()
        # a joint that sticks at its stop is held by two rows, which must not differ by rounding
        ends = {stop.pose: stop.value for stop in touched}
        stuck = [StuckJoint(one, ends.get(one.pose, float(self.q[one.pose]))) for one in still]
        return phase_after(touched, stuck, senses, slipping)

    def sense_at_dead_point(self, joint: FrictionJoint, a: Array) -> float:
        """Sense in which a joint goes on from its dead point, through which others move it."""
        if not abs(a[joint.rate]) > HALT_RATE_SHARE * self.fastest[joint] * SLOW_RATE:
            raise SingularHere(
                f"the motion ends at t = {self.t:.6g} s: joint {joint.joint!r} with friction is at "
                f"a dead point of its motion, and at rest"
            )
        return float(np.sign(a[joint.rate]))

    def unit_of_acceleration(
        self,
        motions: Array,
        touched: Sequence[Stop],
        still: Sequence[FrictionJoint],
        acceleration: Array,
    ) -> float:
        """Unit of the forces of stops: what would cause the largest acceleration at rest."""
        if not touched:
            return 1.0
        rows = motions[[stop.rate for stop in touched]]
        force = float(np.abs(acceleration).max()) / float((rows**2).sum(axis=1).max() or 1.0)
        return max(force, max((one.bound for one in still), default=0.0)) or 1.0

    def find_stop_unit(self) -> float:
        """Unit of the forces of stops in the present phase: its largest force now."""
        state = self.system.state(self.phase, self.t, self.q, self.v)
        forces = self.rest_forces(self.t, state).forces
        return float(np.abs(forces).max()) or self.stop_unit

    def leave_rest(self) -> Phase:
        """The phase that follows where forces at rest end: the motion that begins."""
        state = self.system.state(self.phase, self.t, self.q, self.v)
        begins = self.rest_forces(self.t, state).begins.tolist()
        after = phase_after(self.phase.resting, self.phase.stuck, begins, self.phase.slipping)
        self.found.releases += [
            (self.t, stop.joint) for stop in self.phase.resting if stop not in after.resting
        ]
        return after

    # --- events in a step

    def first_event(self, step: Step) -> Event | None:
        """Find the first event of a step."""
        free = [stop for stop in self.system.stops if stop not in self.phase.resting]
        found = [Event(time) for time in impact_times(free, step)] if free else []
        found += self.halts(step)
        if self.phase.held and (time := self.end_of_rest(step)) is not None:
            found.append(Event(time, ends_rest=True))
        self.check_prescribed(step)
        return min(found, key=lambda one: one.time, default=None)

    def check_prescribed(self, step: Step) -> None:
        """Raise SingularHere if a joint counts as prescribed as it began at a dead point."""
        if self.found.prescribed:
            balance = self.system.balance(step.end, *step.at(step.end))
            rates = sorted(self.found.prescribed)
            motions = free_motions(balance.mass, balance.rows)
            moved = mobility_of(motions, balance.mass, rates) > DEAD_POINT_MOBILITY
            if moved.any():
                rate = rates[int(np.argmax(moved))]
                (name,) = {one.joint for one in self.system.frictions if one.rate == rate}
                raise SingularHere(
                    f"joint {name!r} with friction starts at a dead point of its motion, where its "
                    f"friction has no effect: start at another pose"
                )

    def halts(self, step: Step) -> Iterator[Event]:
        """Iterate over the first halt of each joint that slips in a step."""
        if not self.phase.slipping:
            return
        begin = step.at(step.start)[1]
        begins = any(
            abs(begin[one.rate]) <= HALT_RATE_SHARE * self.fastest[one]
            for one, _ in self.phase.slipping
        )
        shares = np.concatenate([[0.0], EARLY_PROBES if begins else [], RATE_PROBES])
        times = (step.start + (step.end - step.start) * shares).tolist()
        times[-1] = step.end
        states = [step.at(time) for time in times]
        for one, sense in self.phase.slipping:
            rates = sense * np.array([state[1][one.rate] for state in states])
            slopes = sense * np.array([state[2][one.rate] for state in states])
            self.fastest[one] = max(self.fastest[one], float(np.abs(rates).max()))

            def rate(time: float, one: FrictionJoint = one, sense: float = sense) -> float:
                return sense * float(step.at(time)[1][one.rate])

            def slope(time: float, one: FrictionJoint = one, sense: float = sense) -> float:
                return sense * float(step.at(time)[2][one.rate])

            small = HALT_RATE_SHARE * self.fastest[one]
            time = first_fall(
                rate, times, rates, small, minima_by_slope(rate, slope, times, rates, slopes)
            )
            if time is not None:
                yield Event(time, halted=one)

    def end_of_rest(self, step: Step) -> float | None:
        """First time in a step at which the forces at rest are not enough; None if they are."""

        @cache
        def reserve(time: float) -> float:
            return self.rest_forces(time, step.at(time)).reserve

        times = (step.start + (step.end - step.start) * FORCE_PROBES).tolist()
        times[-1] = step.end
        values = np.array([reserve(time) for time in times])
        return first_fall(
            reserve, times, values, TIE_TOLERANCE, minima_by_values(reserve, times, values)
        )


def rates_of(joints: Iterable[Stop | FrictionJoint | StuckJoint]) -> list[int]:
    """Indices in the rates of stops or joints."""
    return [one.rate for one in joints]


def rest_signs(resting: Sequence[Stop], stuck: Sequence[FrictionJoint | StuckJoint]) -> Array:
    """Signs of joint rates in the rows of joints at rest: a stop's row has the distance to it."""
    return np.array([-stop.side for stop in resting] + [1.0] * len(stuck))


def first_fall(
    function: Callable[[float], float],
    times: Sequence[float],
    values: Array,
    small: float,
    minima: Iterable[tuple[float, float]],
) -> float | None:
    """First time at which a function falls below zero, by its values at rising times.

    Values down to `-small` are rounding of zero.  `minima` has times and values of minima between
    the times.

    >>> first_fall(lambda t: 1.0 - t, [0.0, 3.0], np.array([1.0, -2.0]), 1e-12, ())
    1.0
    """
    from scipy.optimize import brentq  # slow to load

    low = [(times[k], float(values[k])) for k in range(len(times)) if values[k] < -small][:1]
    low += [one for one in minima if one[1] < -small]
    if not low:
        return None
    end, _ = min(low)
    before = [
        time for time, value in zip(times, values, strict=True) if time < end and value > small
    ]
    return float(brentq(function, before[-1], end, xtol=1e-15, rtol=1e-15)) if before else times[0]


def minima_by_slope(
    function: Callable[[float], float],
    slope: Callable[[float], float],
    times: Sequence[float],
    values: Array,
    slopes: Array,
) -> Iterator[tuple[float, float]]:
    """Iterate over minima of a function between times, where its tangents meet below zero.

    >>> list(minima_by_slope(lambda t: t * t - 0.25, lambda t: 2 * t, [-1.0, 1.0],
    ...                      np.array([0.75, 0.75]), np.array([-2.0, 2.0])))
    [(0.0, -0.25)]
    """
    from scipy.optimize import brentq  # slow to load

    for k, (one, two) in enumerate(pairwise(slopes.tolist())):
        if not one < 0.0 < two:
            continue
        width = times[k + 1] - times[k]
        meeting = (values[k + 1] - values[k] - two * width) / (one - two)
        if values[k] + one * meeting < 0.0:
            time = float(brentq(slope, times[k], times[k + 1], xtol=1e-15, rtol=1e-15))
            yield time, function(time)


def minima_by_values(
    function: Callable[[float], float], times: Sequence[float], values: Array
) -> Iterator[tuple[float, float]]:
    """Iterate over minima of a function near times at which it is lower than at both neighbours.

    Those near the ends count too.  Only minima are looked for that may be below zero, if the
    function falls to them by no more than it rises to a neighbour.

    >>> ((time, value),) = minima_by_values(lambda t: (t - 0.6) ** 2 - 0.01, [0.0, 0.5, 1.0],
    ...                                     np.array([0.35, 0.0, 0.15]))
    >>> round(time, 6), round(value, 6)
    (0.6, -0.01)
    """
    from scipy.optimize import minimize_scalar  # slow to load

    for k, one in enumerate(values.tolist()):
        first, last = max(k - 1, 0), min(k + 1, len(times) - 1)
        low, high = float(values[first]), float(values[last])
        if low >= one <= high and one < max(low, high) - one:
            ends = times[first], times[last]
            tolerance = {"xatol": MINIMUM_TIME_SHARE * (ends[1] - ends[0])}
            found = minimize_scalar(function, bounds=ends, method="bounded", options=tolerance)
            yield float(found.x), float(found.fun)
