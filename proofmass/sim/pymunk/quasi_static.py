"""Quasi-static sweep in pymunk: hold the drives at each sample until Chipmunk comes to rest.

**Stops.** Chipmunk's stops act only on a joint that is beyond them, and with an error bias of 0 put
it back in one step; to the last digit, where they let go, and it falls in anew.  So a joint meets
its stop a `HAIR` before the limit and is left on the limit, by a bias that may take it no further
back.

**Rest.** The engine alone says where the rest is: its velocity is zero there and nowhere else.  The
energy of `proofmass.sim.pymunk.kinematics` says how far to go: by how much the velocity of each
free motion would fall.

Every pose is at rest by the engine's own answer: a step from standstill gives it no velocity.
With all velocity taken out in every step, a step of Chipmunk is one Newton step of the holds in
the metric of the masses, so a linkage without free coordinates rests after a few of them.  Free
coordinates (springs, hanging bodies) get a velocity down the slope of the engine's energy;
`toward_rest` chooses how far they go along it, and so they fall into the next valley where theirs
ends.  They begin beside the start pose: an engine that does nothing stays
there, and is not at rest in the right pose by having been put into it.
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import compress

import numpy as np
import pymunk
from numpy.typing import NDArray

from proofmass.analytic.friction import (
    DEPENDENT,
    HOLDS_ALL,
    MOST_JOINTS,
    PathEnds,
    SlipProblem,
    advance,
)
from proofmass.analytic.numerics import STANDS, Array
from proofmass.sim.protocol import BadModel, Curves, Diverged, NotSolved, Run, Unsupported
from proofmass.sim.pymunk.dynamics import enough
from proofmass.sim.pymunk.kinematics import (
    Modes,
    along,
    bent,
    bound,
    close,
    drive_values,
    find_modes,
    free_directions,
    gaps,
    jacobian,
    joint_value,
    joint_values,
    least,
    missing,
    named,
    potential,
    sizes,
    spring_length,
    stages,
    turned,
    values,
)
from proofmass.sim.pymunk.links import HAIR, LinkJoint, Links
from proofmass.sim.pymunk.loads import Loaded
from proofmass.sim.pymunk.reactions import SampledMotion
from proofmass.sim.pymunk.read import Sensor, force_curves, kinetic, unwrapped
from proofmass.sim.pymunk.space import (
    STOPS,
    Friction,
    Motor,
    Settings,
    StillBodies,
    add_drives,
    add_friction,
    aim,
    build,
    new_drive,
)
from proofmass.sim.rods import Chain, RodPose, shapes

Stops = list[tuple[LinkJoint, pymunk.Constraint]]
Rest = tuple[list[float], Array]
"""Values of the drives [rad or m], and the pose (links + 1, 3)."""
STAY = 1e-30
"""Way back in a step [rad or m] of a joint that rests on its stop: with none the stop lets go."""


def way_back(joint: LinkJoint, pose: Array) -> float:
    """Way [rad or m] of a joint from beyond a stop back to it; zero between the stops."""
    value = float(joint_value(joint, pose))
    return float(np.clip(value, *joint.limits)) - value if joint.limits else 0.0


def beyond(stops: Stops, pose: Array) -> list[LinkJoint]:
    """The joints that are beyond a stop, and so held by it in the next step."""
    return [joint for joint, _ in stops if way_back(joint, pose)]


def find_stops(links: Links, space: pymunk.Space) -> Stops:
    """The joints with limits and their stops in a space, made to put a joint back in one step."""
    stops = [constraint for constraint in space.constraints if isinstance(constraint, STOPS)]
    for stop in stops:
        stop.error_bias = 0.0
    return list(zip([joint for joint in links.joints if joint.limits], stops, strict=True))


def ease(stops: Stops, pose: Array, dt: float) -> None:
    """Let the next step put no joint back further than to a hair beyond its stop."""
    for joint, stop in stops:
        stop.max_bias = max(abs(way_back(joint, pose)) - HAIR, STAY) / dt


SOFT = 1e-8
"""Least stiffness that a mode is taken to have, as a share of what makes the usual step."""
SLIP = 0.1
"""How far a joint may pass a stop, as a share of its way there: to be pressed on it thereafter."""
PAST = 10 * HAIR
"""The least that it may: to be put back to the limit, where a joint within a hair would stay."""
MOVE = 0.1
"""Largest move of a mode, in extents or radians: its stiffness is that of the pose it begins in."""
CLOSE = 0.3
"""Largest move of all that is held, in extents or radians: light links turn far to close a gap."""
LEAVES = 1e-5
"""Share of the fastest velocity with which a joint leaves its stop: less may be the solver's."""
NEAR = 1e-4
"""Distance [extents or radians] over which the modes of a pose serve for another: the next move
from there is wrong by that share of it, while what the engine calls rest stays what it is."""


def toward_rest(
    links: Links, pose: Array, velocity: Array, dt: float, last: Modes | None = None
) -> tuple[Array, Modes]:
    """The move (links + 1, 3) that the engine's velocity asks for, and the modes behind it.

    From standstill a step gives each free motion of unit mass a velocity of dt times its force; a
    move of that velocity over dt w^2 takes the force away.  All other velocity closes the holds,
    brings the drives to their values or leaves a stop, in one step of dt.

    Parameters
    ----------
    links : Links
    pose : ndarray (links + 1, 3) [m, m, rad]
    velocity : ndarray (links + 1, 3) [m/s, m/s, rad/s]
        What a step of the engine gives to the pose.
    dt : float
        That step [s].
    last : Modes, optional
        Those of an earlier pose, used again if it is `NEAR` and holds the same joints on stops.
    """
    beyond = tuple(joint for joint in links.joints if way_back(joint, pose))
    fastest = float(sizes(links, velocity))
    least = LEAVES * fastest if dt * fastest > STILL else np.inf  # at rest none leaves its stop
    kept = ~_leaving(links, beyond, pose, velocity, dt, least)
    while True:
        stops = tuple(compress(beyond, kept))
        if last is None or last.stops != stops or sizes(links, pose - last.pose) > NEAR:
            last = find_modes(links, pose, stops)
        move = _move(links, last, pose, velocity, dt)
        pressed = kept | ~_leaving(links, beyond, pose, move / dt, dt)
        if (pressed == kept).all():
            return move, last
        kept = pressed  # what the engine lets go in its step falls back in a longer one


def _move(links: Links, modes: Modes, pose: Array, velocity: Array, dt: float) -> Array:
    """The move if the joints that the modes hold stay on their stops."""
    parts = modes.of(links.inertia * velocity)
    stiff = np.maximum(np.abs(modes.squares), SOFT / dt**2)  # positive: it goes downhill
    closing = dt * (velocity - modes.sum(parts))
    closing /= max(1.0, float(sizes(links, closing)) / CLOSE)
    pushes = parts / dt - modes.rise(links, pose, closing)
    ways = (
        np.linalg.solve(np.diag(stiff) + modes.twist, pushes)
        if modes.twist.any()
        else pushes / stiff
    )
    most = MOVE / sizes(links, modes.shapes)  # of each: soft ones wait, stiff ones do not
    fall = modes.sum(np.clip(ways, -most, most))
    return closing + fall / max(1.0, _excess(links, pose, fall))


def _leaving(
    links: Links,
    beyond: tuple[LinkJoint, ...],
    pose: Array,
    velocity: Array,
    dt: float,
    least: float = 0.0,
) -> NDArray[np.bool_]:
    """Which joints beyond their stops move back faster than `sim.pymunk.stops.ease` asks."""
    back = np.array([way_back(joint, pose) for joint in beyond])
    rates = along(lambda p: values(beyond, p), pose, velocity)
    due = np.maximum(np.abs(back) - HAIR, 0.0) / dt
    return np.sign(back) * rates - due > least


def _excess(links: Links, pose: Array, move: Array) -> float:
    """How many times too long a move is: it is to end at the first stop."""
    joints = tuple(j for j in links.joints if j.limits and not way_back(j, pose))
    value, rate = values(joints, pose), along(lambda p: values(joints, p), pose, move)
    low, high = np.array([joint.limits for joint in joints]).reshape(-1, 2).T
    room = np.where(rate < 0, value - low, high - value)
    beyond = np.abs(rate) / ((1 + SLIP) * room + PAST)
    return float(beyond.max(initial=0.0))


FAR = 3.0
"""Longest way to begin ahead, in ways between the last two rests: noise must not be drawn out."""
BEFORE = 3
"""Rests before the present one that tell the way ahead, by a polynomial of third degree."""
STRAIGHT = 1e-3
"""Most that a way of the drives may be off the direction of the one before it, as a share of it."""
BENDS = 0.1
"""Most that the polynomial may be off the line through the last two, as a share of the way."""
STILL = 1e-12
"""Largest remaining move in a step, in extents or radians, that counts as rest at a sample."""
ROUGH = 1e-6
"""The same between samples, where the pose only has to stay on its branch."""
SETTLED = 2
"""Steps in turn that must leave so little at a sample; between samples one is enough.

One that leaves 1e-14 is not: where the solver is slow a step may do so by chance, and the rates of
the hacksaw with a slider of 0.45 kg were wrong by 1e-12 of their range."""
DOUBT = 12
"""Steps after which it is asked whether the loops can be closed at all."""
BESIDE = 1e-3
"""How far beside the start pose free coordinates begin, in extents or radians."""
MOST = {True: 1000, False: 200}
"""Steps after which a pose that still moves is given up, with and without free coordinates."""
ITERATIONS = 500
"""Iterations of the solver in a step at first, where the run sets none."""
SOLVED = 1e-12
"""Share of an error that fewer of them may leave in the start pose, if the drives leave nothing
free."""
LEFT = 1e-3
"""Share of an error that a solver with more iterations may leave in a step."""
MOST_ITERATIONS = 10**6
"""Iterations that it may have, in a step and its repetitions."""
UNSOLVED = 10
"""Steps on the way to a rest that may be left unsolved: beside a straight arm impulses approach
their values by 1e-5 of the rest in 500 iterations, and the next pose is further from it."""
CONVERGED = 1e-15
"""Share by which impulses may still change in a repeated step."""
HELD = 1e-9
"""Largest move in a step, in extents or radians, of joints that limited motors hold."""
LESS = 1e-7
"""Share of the largest force that a drive holds less, to see which way it holds."""
ROUNDING = 1e-16
"""What an iteration adds to the move in a step, in extents or radians."""
AGREED = 1e-6
"""Share by which a step may differ from its repetition: stops and steps of all lengths ask more of
the solver than it does at once."""


def ways_along(way: list[float], before: list[float]) -> float:
    """How many times as long a way of the drives is as the one before it; NaN if it turns."""
    length = sum(part * part for part in before)
    share = sum(a * b for a, b in zip(way, before, strict=True)) / (length or 1.0)
    off = max((abs(a - share * b) for a, b in zip(way, before, strict=True)), default=0.0)
    return share if off <= STRAIGHT * max(map(abs, way), default=0.0) else np.nan


def nodes(past: Sequence[Rest], here: list[float]) -> tuple[list[float], list[Array]]:
    """Places of rests on the straight way of the drives that comes `here`, in ways from the last of
    them, which is at -1; and their poses.  They end where the way turns."""
    before = apart(here, past[-1][0])
    places, poses = [-1.0], [past[-1][1]]
    for value, pose in past[-2::-1]:
        place = ways_along(apart(value, here), before)
        if not place < places[-1]:
            break
        places.append(place)
        poses.append(pose)
    return places, poses


def apart(one: list[float], other: list[float]) -> list[float]:
    """Differences of values of the drives."""
    return [a - b for a, b in zip(one, other, strict=True)]


def lagrange(at: float, places: list[float]) -> list[float]:
    """Parts of values in a polynomial that has them at these places, and 0 at 0.

    >>> lagrange(1.0, [-1.0, -2.0])
    [-3.0, 1.0]
    """
    parts = []
    for own in places:
        part = at / own
        for other in places:
            if other != own:
                part *= (at - other) / (own - other)
        parts.append(part)
    return parts


@dataclass
class HeldSpace:
    """A space whose drives are held: the state of a sweep between its samples.

    ``velocity`` is what the last step of ``dt`` [s] gave to the pose, which stood still; ``usual``
    and ``most`` are iterations of the solver in a step: at first, and used so far; ``past`` are the
    drives' values and poses of up to `BEFORE` rests before this one; ``friction`` are the motors of
    joints that rub, with what each has to give in ``rub`` [N m or N].  ``moving`` is a space of its
    own for rates, if the drives leave nothing free: Chipmunk begins each step with the impulses of
    the last one, and those of a motion are far from those of a rest.  ``largest`` is the largest
    force [N m or N] until now.
    """

    links: Links
    space: pymunk.Space
    bodies: StillBodies
    drives: list[Motor]
    stops: Stops
    dt: float
    free: bool
    pose: Array
    usual: int
    velocity: Array = field(default_factory=lambda: np.zeros(1))
    most: int = 0
    past: tuple[Rest, ...] = ()
    friction: list[Friction] = field(default_factory=list)
    rub: Array = field(default_factory=lambda: np.zeros(0))
    moving: "HeldSpace | None" = None
    largest: float = 0.0

    def carry(self, links: Links, error_bias: float) -> None:
        """Go on in a space whose links have other loads, at the present pose."""
        self.links, self.space = links, space_of(links, self.usual, error_bias)
        self.bodies = StillBodies(self.space, links)
        self.drives, self.stops = add_drives(self.space, links), find_stops(links, self.space)

    @property
    def driving(self) -> int:
        """How many drives are the run's own."""
        return len(self.drives)

    @property
    def rounding(self) -> float:
        """What the solver's iterations add to the move in a step, in extents or radians."""
        return ROUNDING * self.space.iterations

    def step(self, target: Array) -> None:
        """One engine step from rest with the drives aimed at their values: finds the velocity.

        With free coordinates it is repeated until the solver, which goes on from its last impulses,
        agrees with itself: a step that is not solved throws joints off the stops that hold them,
        and the next solution has to begin without the stops' impulses.

        Raises
        ------
        NotSolved
            It does not agree.
        """
        aim(self.drives, target.tolist())
        ease(self.stops, self.pose, self.dt)
        if not self.free:
            self._solve()
            return
        noise = self.rounding / self.dt
        change = np.nan
        for _ in range(0, MOST_ITERATIONS, self.space.iterations):
            last, before = self.velocity, change
            self._solve()
            change = float(sizes(self.links, self.velocity - last))
            error = AGREED * sizes(self.links, self.velocity) + noise
            # changes in a geometric row add up to change before / (before - change); at last they
            # do not fall any more, and are rounding
            small = change * before <= error * (before - change) or before <= change <= error
            if small:
                return
        raise NotSolved(
            f"drives at {np.round(target, 4).tolist()}: a step is not solved after "
            f"{MOST_ITERATIONS} iterations"
        )

    def _solve(self) -> None:
        """Let the engine step: the velocity as far as its iterations find it."""
        self.velocity = self.bodies.step(self.pose, self.dt)

    def settle(self, target: Array, still: float = STILL) -> None:
        """Step until nothing moves and the drives have their values.

        Raises
        ------
        BadModel
            The loops cannot be closed there, or stops are in the way.
        Diverged
            They can, but Chipmunk does not close them.
        NotSolved
            It does not come to rest in the steps that there are.
        """
        last = drive_values(self.links, self.pose).tolist(), self.pose
        self.ahead(target, last[0])
        settled, unsolved, began, modes = 0, 0, self.pose, None
        self.space.iterations = self.usual
        for count in range(MOST[self.free]):
            if count == DOUBT:
                self._doubt(began, target)
            solved = True
            try:
                self.step(target)
            except NotSolved:
                solved, unsolved = False, unsolved + 1
                if unsolved > UNSOLVED:
                    raise
            on, move = beyond(self.stops, self.pose), self.dt * self.velocity
            if self.free and np.isfinite(move).all():
                move, modes = toward_rest(self.links, self.pose, self.velocity, self.dt, modes)
            self.pose = self.pose + move
            moved = float(sizes(self.links, move))
            if not moved < np.inf:
                break
            # a step to a stop is as short as the way there, and small whatever the forces are
            steady = moved < max(still, self.rounding) and beyond(self.stops, self.pose) == on
            settled = settled + 1 if steady and solved else 0
            if settled == SETTLED or (settled and still > STILL):
                if not self._missed(target):
                    self.most = max(self.most, self.space.iterations)
                    self.past = (*self.past[1 - BEFORE :], last)
                    return
                if settled == SETTLED:
                    raise self._failed(target, "at rest")
        close(self.links, began, target)
        kind = NotSolved if np.isfinite(self.velocity).all() else Diverged
        raise self._failed(target, f"not at rest after {count + 1} steps", kind)

    def ahead(self, target: Array, here: list[float]) -> None:
        """Begin where the last rests point to, if the drives go `here` on in the same direction.

        Nearer to the next rest, and on the smooth branch where two of them cross; with free
        coordinates only if it is closer to closed and to the drives' values than here, as it is not
        after a snap to another equilibrium.  A polynomial through more
        than two of them is taken where it bends little, and no joint is on its stop, which it would
        leave or enter by less than a hair.
        """
        if not self.past:
            return
        share = ways_along(apart(target.tolist(), here), apart(here, self.past[-1][0]))
        if not 0 < share <= FAR:
            return
        move = share * (self.pose - self.past[-1][1])
        places, poses = nodes(self.past, here)
        parts = lagrange(share, places)
        curved = (1.0 - sum(parts)) * self.pose
        for part, pose in zip(parts, poses, strict=True):
            curved += part * pose
        there = self.pose + move
        smooth = sizes(self.links, curved - there) < BENDS * sizes(self.links, move)
        if smooth and not beyond(self.stops, self.pose):
            there = curved
        if self.free:
            bounds = self.links.bounds
            off = np.abs(missing(self.links, there, target) / bounds).max()
            if not off < np.abs((target - here) / bounds[len(bounds) - len(here) :]).max():
                return
        self.pose = there

    def _doubt(self, began: Array, target: Array) -> None:
        """Ask whether the loops can be closed; if so, begin again with more iterations.

        Free coordinates go on from where they are, since each of their steps is solved.
        """
        there = close(self.links, began, target)
        if not self.free:
            needed = enough(self.links, there[None], LEFT)
            self.space.iterations = min(max(self.usual, needed), MOST_ITERATIONS)
            self.pose = began

    def _missed(self, target: Array) -> bool:
        """Whether a loop is open or a drive not at its value by more than `ROUGH`."""
        off = missing(self.links, self.pose, target) / self.links.bounds
        return bool(np.abs(off).max(initial=0.0) > ROUGH)

    def _failed(self, target: Array, how: str, kind: type[Diverged] = Diverged) -> Exception:
        """The error of a pose that is not what it should be: stops are in the way, or nothing."""
        names = [f"'{joint.name}'" for joint in beyond(self.stops, self.pose)]
        if names and self._missed(target):
            return BadModel(
                f"joint {', '.join(names)} is on its stop before {named(self.links, target)}"
            )
        here = named(self.links, drive_values(self.links, self.pose))
        return kind(
            f"drives at {np.round(target, 4).tolist()}: {how}, loops open by "
            f"{gaps(self.links, self.pose).max():.3g} m" + (f", {here}" if here else "")
        )

    def rubs(self, rate: Array, fastest: float) -> None:
        """Let joints rub against their motion at rates of the drives; see `senses`."""
        if not self.friction:
            return
        joints = tuple(motor.joint for motor in self.friction)
        moved = along(lambda p: values(joints, p), self.pose, self.rates(rate))
        bounds = np.array([joint.friction for joint in joints])
        rub = np.where(np.abs(moved) > STANDS * fastest, np.sign(moved) * bounds, self.rub)
        if (rub != self.rub).any():
            self.rub = rub
            self.push()
            self.settle(drive_values(self.links, self.pose))

    def push(self) -> None:
        """Let the motors of friction push with what they have to give."""
        for motor, rub in zip(self.friction, self.rub, strict=True):
            motor.slip(float(np.sign(rub)), float(joint_value(motor.joint, self.pose)))

    def drive_forces(self) -> Array:
        """Moments [N m] or forces [N] of the drives on their joints, in a pose at rest.

        Chipmunk tells only the size of an impulse.  Its sign is found by letting one drive hold
        less for a step: the joint falls the way that the drive held it back from.  It does so in
        the first iteration already, which lessens the drive's impulse of the last step and leaves
        others.  The drive holds less by `LESS` of the largest force, so that the next rest begins
        with impulses that are nearly right, and nothing if its force is smaller than that.
        """
        here = drive_values(self.links, self.pose)
        self.step(here)
        size, fall = self.impulses() / self.dt, np.empty(self.driving)
        self.largest = max(self.largest, float(size.max(initial=0.0)))
        held = np.maximum(size - LESS * self.largest, 0.0)
        usual, first = self.space.iterations, 1 if not self.free else self.space.iterations
        for turn, some in enumerate(self.together):
            if turn:
                self.step(here)
            for k in some:
                self.drives[k].max_force = float(held[k])
            self.space.iterations = first
            self.step(here)
            self.space.iterations = usual
            for k in some:
                self.drives[k].max_force = float("inf")
            fallen = along(lambda p: drive_values(self.links, p), self.pose, self.velocity)
            fall[some] = fallen[some]
        return -size * np.sign(fall)

    @cached_property
    def together(self) -> list[list[int]]:
        """Drives that may hold less at a time: no two of them have a link in common that moves.

        With free coordinates more than the first iteration is asked for, and each is let go alone.
        """
        turns, taken = list[list[int]](), list[set[int]]()
        for k, joint in enumerate(self.links.drives[: self.driving]):
            ends = {joint.hold.a, joint.hold.b} - {len(self.links.mass)}
            for some, links in zip(turns, taken, strict=True):
                if not self.free and not ends & links:
                    some.append(k)
                    links |= ends
                    break
            else:
                turns.append([k])
                taken.append(ends)
        return turns

    def impulses(self) -> Array:
        """Impulses of the drives in the step, which motors of friction let converge slowly."""
        size = np.array([drive.impulse for drive in self.drives[: self.driving]])
        for _ in range(MOST[False] if self.friction else 0):
            last = size
            self._solve()
            size = np.array([drive.impulse for drive in self.drives[: self.driving]])
            if np.abs(size - last).max() <= CONVERGED * np.abs(size).max():
                break
        return size

    def rates(self, rate: Array) -> Array:
        """The engine's velocities (links + 1, 3) for rates of the drives, in a pose at rest."""
        size = np.abs(rate).max()
        if size == 0:
            return np.zeros_like(self.pose)
        moving = self.moving or self
        moving.pose, moving.space.iterations = self.pose, self.space.iterations
        ahead = drive_values(self.links, self.pose) + self.dt * rate / size
        moving.step(ahead)
        for _ in range(1, MOST[False]):
            last = moving.velocity
            moving.step(ahead)
            change = sizes(self.links, moving.velocity - last)
            if change < STILL * sizes(self.links, moving.velocity):
                break
        return size * moving.velocity


@dataclass
class HeldRubbing(HeldSpace):
    """A space whose free joints have dry friction: its rest depends on how it came there.

    Joints stick or slip, see `proofmass.analytic.friction`.  One that slips has Chipmunk's motor
    with its limited moment against it.  One that sticks is held as a drive is; at each sample the
    motor alone has to hold it, and a step to give it no velocity.  A sweep begins at rest without
    friction.
    """

    senses: Array = field(default_factory=lambda: np.zeros(0))
    begins: bool = True

    def __post_init__(self) -> None:
        self.own, self.real = self.links, list(self.drives)
        self.loose = [j for j in self.own.rubbing if j not in self.own.driven]
        names = [self.own.joints[j].name for j in self.loose]
        if len(names) > MOST_JOINTS:
            raise Unsupported(
                f"frictionloss of {len(names)} joints in a sweep with degrees of freedom left; up "
                f"to {MOST_JOINTS} are covered"
            )
        if self.stops:
            raise Unsupported(
                f"joint ranges and dry friction of {', '.join(names)} in one sweep with degrees of "
                "freedom left"
            )
        places = [self.own.rubbing.index(j) for j in self.loose]
        self.motors, self.places = [self.friction[k] for k in places], places
        self.bounds = np.array([self.own.joints[j].friction for j in self.loose])
        self.senses, self.fixed = np.zeros(len(self.loose)), np.zeros(0)
        self.slipped = np.zeros(len(self.loose), bool)

    def check_slipped(self) -> None:
        """Raise `BadModel` if dry friction held all joints that the drives leave."""
        if not self.slipped.any():
            names = [repr(self.own.joints[j].name) for j in self.loose]
            raise BadModel(HOLDS_ALL.format(", ".join(names)))

    @property
    def driving(self) -> int:
        """How many drives are the run's own; the others hold joints that stick."""
        return len(self.real)

    def rubs(self, rate: Array, fastest: float) -> None:
        """Let driven joints rub against their motion, and let motors hold what sticks."""
        for k, (j, motor) in enumerate(zip(self.own.rubbing, self.friction, strict=True)):
            if j in self.own.driven:
                moved = rate[self.own.driven.index(j)]
                if abs(moved) > STANDS * fastest:
                    self.rub[k] = np.sign(moved) * motor.joint.friction
                motor.slip(float(np.sign(self.rub[k])), float(joint_value(motor.joint, self.pose)))
        if not self.begins:
            found = self.problem(self.way).goes(self.senses)
            assert found is not None
            self.rub[self.places] = found.friction
            self.check_held()
        self.settle(np.append(self.at(), self.fixed))

    def check_held(self) -> None:
        """Ask the engine whether limited motors alone hold all joints that stick.

        Raises
        ------
        NotSolved
            They slip in its step.
        """
        for drive in self.drives[self.driving :]:
            drive.max_force = 0.0
        for motor in self.sticking:
            motor.stick(float(joint_value(motor.joint, self.pose)))
        self.step(np.append(self.at(), self.fixed))
        moved = float(sizes(self.links, self.dt * self.velocity))
        for drive in self.drives[self.driving :]:
            drive.max_force = float("inf")
        for motor in self.sticking:
            motor.slip(0.0, 0.0)
        if moved > HELD:
            names = ", ".join(f"'{motor.joint.name}'" for motor in self.sticking)
            raise NotSolved(f"joints {names} slip by {moved:.2g} of the mechanism where they stick")

    @property
    def sticking(self) -> list[Friction]:
        """The motors of joints that stick."""
        return [motor for motor, sense in zip(self.motors, self.senses, strict=True) if sense == 0]

    def at(self) -> Array:
        """Values of the run's drives."""
        return drive_values(self.own, self.pose)

    def kept(self) -> tuple[Array, Array]:
        """The pose, and the engine's last velocity."""
        return self.pose, self.velocity

    def back(self, kept: tuple[Array, Array]) -> None:
        """Come back to a pose."""
        (self.pose, self.velocity), self.past = kept, ()

    def go(self, target: Array) -> None:
        """Let the engine come to rest at values of the drives in the present state."""
        try:
            for stage in stages(self.own, self.at(), target):
                self.settle(np.append(stage, self.fixed))
        except (BadModel, NotSolved) as error:
            raise PathEnds(str(error)) from None

    def problem(self, way: Array) -> SlipProblem:
        """The present rest in coordinates of its free motions, without its friction."""
        self.way, own, pose = way, self.own, self.pose
        rows = jacobian(lambda p: bound(own, p), pose)
        free = free_directions(own, rows)
        wanted = np.append(np.zeros(len(rows) - way.size), way)
        lead = np.pad(least(own, rows, wanted).reshape(1, -1, 3), ((0, 0), (0, 1), (0, 0)))
        moves = np.concatenate([free, lead])
        slopes = bent(self.links, pose, moves)
        joints = tuple(own.joints[j] for j in self.loose)
        turned = along(lambda p: values(joints, p), pose, moves).T
        load = jacobian(lambda p: potential(own, p), pose).reshape(-1, 3)
        stiffness = np.tensordot(free, slopes, ((1, 2), (1, 2)))
        n = len(free)
        return SlipProblem(
            np.tensordot(free[:, :-1], load, 2),
            (stiffness[:, :n] + stiffness[:, :n].T) / 2,
            stiffness[:, n],
            turned[:, :n],
            turned[:, n],
            self.bounds,
        )

    def independent(self, stuck: NDArray[np.intp]) -> list[int]:
        """Joints of those that stick which hold all of them, as few as can be."""
        own, kept = self.own, list[int]()
        free = free_directions(own, jacobian(lambda p: bound(own, p), self.pose))
        joints = tuple(own.joints[j] for j in self.loose)
        turn = along(lambda p: values(joints, p), self.pose, free).T
        for k in stuck.tolist():
            rows = turn[[*kept, k]]
            if np.linalg.matrix_rank(rows, rtol=DEPENDENT) == len(rows):
                kept.append(k)
        return kept

    def enter(self, senses: Array) -> None:
        """Let joints stick where they are, or slip."""
        self.senses, self.past, self.begins = senses, (), False
        self.slipped |= senses != 0
        self.space.remove(*self.drives[self.driving :])
        joints = list(self.own.joints)
        for j, motor, sense in zip(self.loose, self.motors, senses.tolist(), strict=True):
            joint = joints[j]
            joints[j] = replace(joint, load=joint.load - sense * joint.friction)
            motor.slip(sense, float(joint_value(joint, self.pose)))
        stuck = [self.loose[k] for k in self.independent(np.flatnonzero(senses == 0))]
        self.links = replace(self.own, joints=tuple(joints), driven=(*self.own.driven, *stuck))
        holds = [new_drive(joints[j], self.own, self.space) for j in stuck]
        self.space.add(*holds)
        self.drives = [*self.real, *holds]
        self.fixed = values(tuple(joints[j] for j in stuck), self.pose)
        self.settle(np.append(self.at(), self.fixed))


def hold(links: Links, settings: Settings) -> HeldSpace:
    """The space in its start pose; with free coordinates beside it, see `BESIDE`.

    Links of which the drives leave none free get the inertia of `quick`; with free coordinates the
    modes of `toward_rest` are those of their own.

    It has no dampers: nothing moves at rest, and Chipmunk's steps to it would not be solved.

    Raises
    ------
    BadModel
        The loops cannot be closed there.
    """
    pose = close(links, links.pose, drive_values(links, links.pose))
    moves = free_directions(links, jacobian(lambda p: bound(links, p), pose))
    if not len(moves):
        links = quick(links)
    iterations = settings["iterations"]
    if iterations is None:
        needed = ITERATIONS if len(moves) else enough(links, pose[None], SOLVED)
        iterations = min(needed, ITERATIONS)
    loose = set(links.rubbing) - set(links.driven)
    dt, begin = _step(links, pose), links.pose + _beside(links, moves)

    def held(kind: type[HeldSpace], rubs: bool) -> HeldSpace:
        space = space_of(links, iterations, settings["error_bias"])
        friction = add_friction(space, links) if rubs else []
        return kind(
            links,
            space,
            StillBodies(space, links),
            add_drives(space, links),
            find_stops(links, space),
            dt,
            len(moves) > 0,
            begin,
            iterations,
            friction=friction,
            rub=np.zeros(len(friction)),
        )

    made = held(HeldRubbing if loose and len(moves) else HeldSpace, rubs=True)
    made.moving = None if made.free else held(HeldSpace, rubs=False)
    return made


def space_of(links: Links, iterations: int, error_bias: float) -> pymunk.Space:
    """The space of links without their dampers, their drives and gravity: `StillBodies` has it."""
    undamped = replace(
        links,
        joints=tuple(replace(joint, damping=0.0) for joint in links.joints),
        springs=tuple(replace(spring, damping=0.0) for spring in links.springs),
    )
    space = build(undamped, iterations, error_bias)
    space.gravity = 0.0, 0.0
    return space


HEAVY = 100.0
"""Mass [kg] of links that drives hold against the ground; of all others it is 1 kg."""
SPREAD = 0.5
"""Square of the radius of gyration of a link, in mean squares of the distances of its holds."""
WIDE = 0.1
"""Least distance of a hold from a centre of mass [extents] that is counted."""


def quick(links: Links) -> Links:
    """The links with masses and moments of inertia with which Chipmunk's solver converges sooner.

    Nothing at rest depends on them, and the weights stay.  An iteration of the solver goes from
    hold to hold; the less one of them moves what another holds, the fewer are needed.  So more of a
    link's mass is near its holds than in a uniform bar, and links that a drive holds are heavy.
    """
    ground = len(links.mass)
    mass, squares = np.ones(ground), [list[float]() for _ in range(ground + 1)]
    for hold in links.holds:
        squares[hold.a].append(float(hold.on_a @ hold.on_a))
        squares[hold.b].append(float(hold.on_b @ hold.on_b))
    held = {ground}
    for _ in links.drives:
        for ends in ({joint.hold.a, joint.hold.b} for joint in links.drives):
            held |= ends if ends & held else set()
    mass[list(held - {ground})] = HEAVY
    least = (WIDE * links.extent) ** 2
    square = [max(float(np.mean(own)), least) for own in squares[:-1]]
    return replace(links, mass=mass, moment=SPREAD * mass * square)


def _beside(links: Links, moves: Array) -> Array:
    """A move in all free directions (n, links + 1, 3), whatever basis they are given in."""
    shares = np.pad(np.cos(np.arange(links.sizes.size)) * links.sizes, (0, 3))
    way = np.tensordot(np.tensordot(moves, links.inertia * shares.reshape(-1, 3), 2), moves, 1)
    return np.asarray(BESIDE * way / (sizes(links, way) or 1.0))


def _step(links: Links, pose: Array) -> float:
    """The step [s] in which the loads' rounding and a gap of rounding size make equal noise.

    Springs count as if wound by a radian or an extent: they may be slack where the sweep begins.
    """
    wound = [
        abs(joint.acting[0]) * (links.extent if joint.hold.axis is not None else 1.0)
        for joint in links.joints
    ]
    wound += [links.extent * spring.stiffness for spring in links.springs]

    def coordinates(pose: Array) -> Array:
        lengths = [spring_length(spring, pose)[..., None] for spring in links.springs]
        return np.concatenate([joint_values(links, pose), *lengths], axis=-1)

    force = (
        np.abs(jacobian(coordinates, pose)).T @ wound
        + np.abs(jacobian(lambda p: potential(links, p), pose))
    ).reshape(-1, 3)
    pull = force / np.column_stack([links.mass, links.mass, links.moment / links.extent])
    return float(np.sqrt(links.extent / pull.max())) if pull.any() else 1.0


NO_ACC = "Chipmunk has no inverse dynamics: no accelerations in a sweep"
NO_INERTIA = "Chipmunk has no inverse dynamics: moments and forces of a sweep are those at rest"
NO_RATE = "Chipmunk gives no quasi-static rates of coordinates that springs or gravity hold"


def sweep(links: Links, run: Run, channels: dict[str, Sensor], settings: Settings) -> Curves:
    """Hold the drives at each sample until rest; see `proofmass.sim.pymunk.engine.simulate`.

    Where the loops cannot be closed any further the sweep stops and keeps what it has.
    """
    if not run.drives:
        raise Unsupported("a sweep without a driven joint")
    began = time.perf_counter()
    laws = np.array(
        [[curve * np.ones(len(run.x)) for curve in drive.law(run.x)] for drive in run.drives]
    )  # drives, (value, rate, acceleration), samples
    held = hold(links, settings)
    loaded = Loaded.of(links, run)
    missing = {name: NO_ACC for name, c in channels.items() if c.order == 2}
    if held.free:
        missing |= {name: NO_RATE for name, c in channels.items() if c.order in (1, -1)}
    if run.inertia:
        missing |= {name: NO_INERTIA for name, c in channels.items() if c.order <= -2}
    wanted = {name: c for name, c in channels.items() if name not in missing}
    read, stopped = _follow(held, laws, {c.order for c in wanted.values()}, loaded, settings)
    if isinstance(held, HeldRubbing) and not stopped:
        held.check_slipped()
    pose, velocity, force, rub = (np.array(part) for part in zip(*read, strict=True))
    curves = {
        name: unwrapped(name, _curve(c, links, pose, velocity, force))
        for name, c in wanted.items()
        if c.order != -3
    }
    between = {name: c for name, c in wanted.items() if c.order == -3}
    n = len(pose)
    taken = np.zeros((n, len(links.joints)))
    taken[:, links.rubbing] = rub
    if run.loads:
        curves |= loaded.curves(wanted, SampledMotion.at_rest(pose, taken))
    else:
        curves |= force_curves(links, between, SampledMotion.at_rest(pose, taken))
    state = (drive_values(links, pose).T, laws[:, 1, :n], laws[:, 2, :n])
    return Curves(
        run.x[:n],
        curves,
        missing,
        state,
        float(gaps(links, pose).max()),
        time.perf_counter() - began,
        n,
        {"iterations": held.most, "error_bias": settings["error_bias"]},
        stopped,
        derivatives=0 if held.free else 1,
    )


def _follow(
    held: HeldSpace, laws: Array, orders: set[int], loaded: Loaded, settings: Settings
) -> tuple[list[tuple[Array, ...]], str]:
    """Pose, velocity, forces and friction at each sample, and why the last were not reached."""
    read: list[tuple[Array, ...]] = []
    fastest = float(np.abs(laws[:, 1]).max())
    before = loaded.controls[0]
    for value, rate, controls in zip(laws[:, 0].T, laws[:, 1].T, loaded.controls, strict=True):
        try:
            _drive_to(held, value, loaded, before, controls, settings)
            held.rubs(rate, fastest)
        except BadModel as error:
            if len(read) < 2:
                raise
            last = named(loaded.links, laws[:, 0, len(read) - 1])
            return read, f"stopped at {last}: {error}"
        pose, before = held.pose, controls
        force = held.drive_forces() if -2 in orders else np.zeros(len(value))
        velocity = held.rates(rate) if orders & {1, -1} else np.zeros_like(pose)
        read.append((pose, velocity, force, held.rub.copy()))
    return read, ""


def _drive_to(
    held: HeldSpace,
    target: Array,
    loaded: Loaded,
    before: Array,
    controls: Array,
    settings: Settings,
) -> None:
    """Come to rest at values of the drives, in stages on which the loads change in proportion."""
    if isinstance(held, HeldRubbing) and held.velocity.size > 1:
        try:
            advance(held, target)
        except PathEnds as error:
            raise BadModel(str(error)) from None
        return
    way = stages(held.links, drive_values(held.links, held.pose), target)
    for k, stage in enumerate(way, 1):
        if controls.size:
            now = before + k / len(way) * (controls - before)
            held.carry(loaded.at(now), settings["error_bias"])
        held.settle(stage, STILL if k == len(way) else ROUGH)


def _curve(c: Sensor, links: Links, pose: Array, velocity: Array, force: Array) -> Array:
    if c.order == -2:
        return force[:, c.drive] * c.factor
    if c.order == -1:
        return kinetic(links, velocity)
    return c.function(pose) if c.order == 0 else along(c.function, pose, velocity)


NO_MOTION = "nothing moves: no rates, no accelerations"


def equilibrium(links: Links, run: Run, channels: dict[str, Sensor], settings: Settings) -> Curves:
    """Let a mechanism come to rest with its drives held at their first values.

    Rods are read at the arc lengths ``run.x``; sensors have the same value everywhere.
    """
    began, start = time.perf_counter(), run.motion(run.x[:1])[0][:, 0]
    held = hold(links, settings)
    held.settle(start)
    pose = held.pose
    forces = held.drive_forces() if any(c.order == -2 for c in channels.values()) else np.empty(0)
    curves = {
        name: np.full(run.x.size, forces[c.drive] * c.factor if c.order == -2 else c.function(pose))
        for name, c in channels.items()
        if c.order in (0, -2)
    }
    curves = {name: unwrapped(name, curve) for name, curve in curves.items()}
    between = {name: c for name, c in channels.items() if c.order == -3}
    at_rest = force_curves(links, between, SampledMotion.at_rest(pose[None]))
    curves |= {name: np.full(run.x.size, curve[0]) for name, curve in at_rest.items()}
    curves |= shapes(run, lambda one: shape(links, pose, one))
    missing = {name: NO_MOTION for name in channels if name not in curves}
    return Curves(
        run.x,
        curves,
        missing,
        violation=float(gaps(links, pose).max()),
        seconds=time.perf_counter() - began,
        steps=1,
        settings={"iterations": held.most, "error_bias": settings["error_bias"]},
    )


def shape(links: Links, pose: Array, one: Chain) -> RodPose:
    """Vertices, angles and bends of a rod's links."""
    bodies = [links.model.body(name).id for name in one.names]
    tip = links.model.site(f"{one.rod.name}.tip")
    places = [place(links, pose, b, links.data.xpos[b]) for b in bodies]
    places.append(place(links, pose, tip.bodyid[0], links.data.site_xpos[tip.id]))
    ahead = links.plane.flat(links.data.xmat[bodies].reshape(-1, 3, 3)[:, :, 0])
    angles = np.arctan2(ahead[:, 1], ahead[:, 0]) + pose[links.of_body[bodies], 2]
    bends = [
        joint_value(links.joints[links.model.joint(name).id], pose) if jointed else 0.0
        for name, jointed in zip(one.names, one.jointed, strict=True)
    ]
    return np.array(places), angles, np.array(bends, float)


def place(links: Links, pose: Array, body: int, start: Array) -> Array:
    """Where a point of a body (3,), given in the start pose, is in another pose."""
    link, plane = links.of_body[body], links.plane
    local = plane.flat(start) - links.centre[link]
    return plane.world(pose[link, :2] + turned(pose[link, 2], local), float(start @ plane.normal))
