"""Quasi-static sweep in pymunk: fix the drives at each sample until Chipmunk comes to rest.

**Joint limits.** Chipmunk's stops act only on a joint that is beyond them.  With an error bias of 0
they put the joint back exactly to the stop in one step, where they act no longer, so that the joint
falls in again.  Therefore a stop is placed a distance `STOP_MARGIN` before the limit, and its bias
has a bound so that a step leaves the joint on the limit.

**Rest.** A pose is at rest if a step of the engine from standstill gives it no velocity; nothing
else decides this.  Only the length of the moves toward the rest is computed by proofmass, from the
curvature of the energy in `proofmass.sim.pymunk.kinematics`.

All velocities are removed before each step.  A step of Chipmunk is then one step of Newton's method
for the constraints, in the metric of the masses, so a linkage without degrees of freedom is at rest
after a few steps.  Degrees of freedom (springs, hanging bodies) get a velocity down the gradient of
the engine's energy; `move_toward_rest` chooses how far they move along it.  Where their minimum of
energy ceases to exist they move to another one.

Degrees of freedom begin at a distance from the start pose.  Otherwise an engine that computes
nothing would pass a check whose right result is the start pose.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import compress

import numpy as np
import pymunk
from numpy.typing import NDArray

from proofmass.analytic.friction import (
    MAX_FRICTION_JOINTS,
    NOTHING_SLIPS,
    STUCK_RANK_TOLERANCE,
    PathEnds,
    SlipProblem,
    follow_stick_slip,
)
from proofmass.analytic.numerics import REST_RATE_SHARE
from proofmass.base.arrays import Array
from proofmass.base.clock import processor_time
from proofmass.sim.protocol.curves import Curves
from proofmass.sim.protocol.failures import BadModel, Diverged, NotSolved, Unsupported
from proofmass.sim.protocol.run import Run
from proofmass.sim.pymunk.dynamics import iterations_needed, step_seconds
from proofmass.sim.pymunk.kinematics import (
    Modes,
    close_loops,
    constraint_errors,
    constraint_values,
    constraint_violations,
    derivative_along,
    drive_stages,
    drive_values,
    find_modes,
    format_drives,
    free_directions,
    gradient_changes,
    jacobian,
    joint_value,
    joint_values,
    least_move,
    move_sizes,
    potential,
    rotate,
    spring_length,
    values_of,
)
from proofmass.sim.pymunk.links import STOP_MARGIN, LinkJoint, Links
from proofmass.sim.pymunk.loads import LoadedLinks
from proofmass.sim.pymunk.reactions import SampledMotion
from proofmass.sim.pymunk.read import Sensor, force_curves, kinetic_energy, unwrap_angle
from proofmass.sim.pymunk.space import (
    STOP_TYPES,
    FrictionMotor,
    LinkDrive,
    RestingBodies,
    Settings,
    add_drives,
    add_friction,
    aim_drives,
    build_space,
    make_drive,
)
from proofmass.sim.rods import Chain, RodPose, rod_curves

Stops = list[tuple[LinkJoint, pymunk.Constraint]]
Rest = tuple[list[float], Array]
"""Values of the drives [rad or m], and the pose (links + 1, 3) at rest."""
MIN_STOP_CORRECTION = 1e-30
"""Smallest correction [rad or m] in a step of a joint that rests on its stop: with a bias of 0 the
stop would exert no force."""


def way_to_stop(joint: LinkJoint, pose: Array) -> float:
    """Signed distance [rad or m] from a joint's value to its stop; zero if it is not beyond one."""
    value = float(joint_value(joint, pose))
    return float(np.clip(value, *joint.limits)) - value if joint.limits else 0.0


def joints_beyond_stops(stops: Stops, pose: Array) -> list[LinkJoint]:
    """The joints that are beyond a stop, on which the stop acts in the next step."""
    return [joint for joint, _ in stops if way_to_stop(joint, pose)]


def find_stops(links: Links, space: pymunk.Space) -> Stops:
    """The joints with limits and their stops in a space, with the bias of the stops set to 0.

    Such a stop corrects its violation in one step, up to the bound of `bound_stop_bias`.
    """
    stops = [constraint for constraint in space.constraints if isinstance(constraint, STOP_TYPES)]
    for stop in stops:
        stop.error_bias = 0.0
    return list(zip([joint for joint in links.joints if joint.limits], stops, strict=True))


def bound_stop_bias(stops: Stops, pose: Array, dt: float) -> None:
    """Bound the correction of the next step, so that joints stay `STOP_MARGIN` beyond stops."""
    for joint, stop in stops:
        stop.max_bias = max(abs(way_to_stop(joint, pose)) - STOP_MARGIN, MIN_STOP_CORRECTION) / dt


MIN_MODE_STIFFNESS = 1e-8
"""Smallest stiffness of a mode of unit mass that is assumed, as a share of 1 / dt^2."""
STOP_OVERSHOOT = 0.1
"""Largest overshoot of a stop in a move, as a share of the distance to the stop; the stop acts on
the joint afterwards."""
MIN_STOP_OVERSHOOT = 10 * STOP_MARGIN
"""Overshoot of a stop [rad or m] that is always allowed.  A joint more than `STOP_MARGIN` beyond
its stop is put back to the limit; one within `STOP_MARGIN` would stay where it is."""
MAX_MODE_MOVE = 0.1
"""Largest move of a mode [extents or radians]: its stiffness is that of the pose before it."""
MAX_CLOSING_MOVE = 0.3
"""Largest move that corrects constraints [extents or radians]: light links rotate far to reduce a
constraint violation."""
MIN_LEAVING_RATE = 1e-5
"""Smallest rate at which a joint counts as leaving its stop, as a share of the largest velocity:
smaller rates may be errors of the solver."""
MODE_REUSE_DISTANCE = 1e-4
"""Largest distance [extents or radians] of a pose from that of earlier modes with which these are
used again.  The next move is wrong by about this share; the rest is not affected, since the engine
determines it."""


def move_toward_rest(
    links: Links, pose: Array, velocity: Array, dt: float, last_modes: Modes | None = None
) -> tuple[Array, Modes]:
    """The move (links + 1, 3) toward rest from the engine's velocity, and the modes that it uses.

    A step from standstill gives each mode of unit mass a velocity of dt times its force.  With the
    angular frequency w of the mode, a move by that velocity over dt w^2 makes the force zero.  The
    rest of the velocity corrects constraints and drives, or moves a joint off its stop; this part
    moves the pose as in a step of dt.

    Parameters
    ----------
    links : Links
    pose : ndarray (links + 1, 3) [m, m, rad]
    velocity : ndarray (links + 1, 3) [m/s, m/s, rad/s]
        Velocity after a step of the engine from standstill.
    dt : float
        Length of the step [s].
    last_modes : Modes, optional
        Modes of an earlier pose.  They are used again if that pose is within `MODE_REUSE_DISTANCE`
        and has the same joints on stops.
    """
    beyond = tuple(joint for joint in links.joints if way_to_stop(joint, pose))
    fastest = float(move_sizes(links, velocity))
    margin = (
        MIN_LEAVING_RATE * fastest if dt * fastest > REST_TOLERANCE else np.inf
    )  # no joint leaves at rest
    stays = ~_leaves_stop(links, beyond, pose, velocity, dt, margin)
    while True:
        stops = tuple(compress(beyond, stays))
        if (
            last_modes is None
            or last_modes.stops != stops
            or move_sizes(links, pose - last_modes.pose) > MODE_REUSE_DISTANCE
        ):
            last_modes = find_modes(links, pose, stops)
        move = _move_with_modes(links, last_modes, pose, velocity, dt)
        pressed = stays | ~_leaves_stop(links, beyond, pose, move / dt, dt)
        if (pressed == stays).all():
            return move, last_modes
        stays = pressed  # a joint that leaves in the engine's step may return in the longer move


def _move_with_modes(links: Links, modes: Modes, pose: Array, velocity: Array, dt: float) -> Array:
    """The move of `move_toward_rest` if the joints `modes.stops` stay on their stops."""
    parts = modes.of(links.inertia * velocity)
    stiffness = np.maximum(
        np.abs(modes.squares), MIN_MODE_STIFFNESS / dt**2
    )  # positive, so that energy decreases
    closing = dt * (velocity - modes.sum(parts))
    closing /= max(1.0, float(move_sizes(links, closing)) / MAX_CLOSING_MOVE)
    pushes = parts / dt - modes.gradient_change(links, pose, closing)
    ways = (
        np.linalg.solve(np.diag(stiffness) + modes.twist, pushes)
        if modes.twist.any()
        else pushes / stiffness
    )
    largest = MAX_MODE_MOVE / move_sizes(
        links, modes.shapes
    )  # for each mode: soft ones do not slow stiff ones
    fall = modes.sum(np.clip(ways, -largest, largest))
    return closing + fall / max(1.0, _excess_factor(links, pose, fall))


def _leaves_stop(
    links: Links,
    beyond: tuple[LinkJoint, ...],
    pose: Array,
    velocity: Array,
    dt: float,
    margin: float = 0.0,
) -> NDArray[np.bool_]:
    """Which joints beyond their stops move back faster than `bound_stop_bias` makes them.

    The difference of the rates must be larger than `margin` [rad/s or m/s].
    """
    back = np.array([way_to_stop(joint, pose) for joint in beyond])
    rates = derivative_along(lambda p: values_of(beyond, p), pose, velocity)
    due = np.maximum(np.abs(back) - STOP_MARGIN, 0.0) / dt
    return np.sign(back) * rates - due > margin


def _excess_factor(links: Links, pose: Array, move: Array) -> float:
    """Factor by which a move is too long, for the overshoot of the first stop that it reaches.

    `STOP_OVERSHOOT` and `MIN_STOP_OVERSHOOT` give the overshoot that is allowed.  The move is too
    long if the factor is larger than 1.
    """
    joints = tuple(j for j in links.joints if j.limits and not way_to_stop(j, pose))
    value, rate = (
        values_of(joints, pose),
        derivative_along(lambda p: values_of(joints, p), pose, move),
    )
    low, high = np.array([joint.limits for joint in joints]).reshape(-1, 2).T
    room = np.where(rate < 0, value - low, high - value)
    beyond = np.abs(rate) / ((1 + STOP_OVERSHOOT) * room + MIN_STOP_OVERSHOOT)
    return float(beyond.max(initial=0.0))


MAX_EXTRAPOLATED_WAYS = 3.0
"""Longest way of the drives over which poses are extrapolated, in ways between the last two rests:
over longer ways extrapolation amplifies noise."""
KEPT_RESTS = 3
"""Number of rests before the present one that are kept for extrapolation, by a polynomial of third
degree at most."""
STRAIGHT_TOLERANCE = 1e-3
"""Largest deviation of a way of the drives from the direction of the way before, as a share of its
largest component, with which both count as one straight way."""
MAX_POLYNOMIAL_DEVIATION = 0.1
"""Largest deviation of the polynomial from the line through the last two rests, as a share of the
extrapolated move, with which the polynomial is used."""
REST_TOLERANCE = 1e-12
"""Largest move in a step [extents or radians] with which a pose at a sample counts as at rest."""
COARSE_TOLERANCE = 1e-6
"""The same between samples, where the pose only has to stay on its branch.  It is also the largest
constraint violation and error of a drive of a pose at rest."""
STEPS_AT_REST = 2
"""Number of successive steps with moves below `REST_TOLERANCE` after which a pose at a sample is at
rest; between samples one step with a move below `COARSE_TOLERANCE` is sufficient.

A single step is not sufficient even if it moves the pose by 1e-14 only: where the solver converges
slowly this may happen by chance, and the rates of the hacksaw with a slider of 0.45 kg were wrong
by 1e-12 of their range."""
STEPS_BEFORE_CHECK = 12
"""Number of steps without rest after which Newton's method checks that the loops can be closed."""
START_DISTANCE = 1e-3
"""Distance from the start pose at which degrees of freedom begin [extents or radians]."""
STEP_LIMITS = {True: 1000, False: 200}
"""Largest number of steps to a rest, by whether there are degrees of freedom."""
MAX_START_ITERATIONS = 500
"""Largest initial number of the solver's iterations in a step, if the run gives none."""
START_ERROR_SHARE = 1e-12
"""Share of an error that the iterations may leave in the start pose; it determines their initial
number if there are no degrees of freedom."""
REMAINING_REST_ERROR = 1e-3
"""Share of an error that the iterations of a step may leave, once their number is increased."""
MAX_REPEATED_ITERATIONS = 10**6
"""Largest number of iterations in a step together with its repetitions."""
MAX_UNSOLVED_STEPS = 10
"""Number of steps to a rest that may be left unsolved.  Near a stretched arm 500 iterations reduce
the error of the impulses by a share of 1e-5 only, and the next pose is further from the stretched
one."""
IMPULSE_TOLERANCE = 1e-15
"""Largest relative change of impulses in a repeated step with which they count as converged."""
STICKING_TOLERANCE = 1e-9
"""Largest move in a step [extents or radians] of joints that friction motors keep at rest."""
FORCE_REDUCTION = 1e-7
"""Reduction of a drive's force, as a share of the largest force, with which its sign is found."""
ROUNDING_PER_ITERATION = 1e-16
"""Rounding error that an iteration adds to the move in a step [extents or radians]."""
REPETITION_TOLERANCE = 1e-6
"""Largest relative difference of a step from its repetition: with stops, and with moves that are
longer than the step, the velocity must be more accurate than one step of the solver makes it."""


def ratio_of_ways(way: list[float], last_way: list[float]) -> float:
    """Ratio of a way of the drives to the way before it; NaN if their directions differ.

    The ratio is negative for opposite directions.
    """
    length = sum(part * part for part in last_way)
    share = sum(a * b for a, b in zip(way, last_way, strict=True)) / (length or 1.0)
    deviation = max((abs(a - share * b) for a, b in zip(way, last_way, strict=True)), default=0.0)
    return share if deviation <= STRAIGHT_TOLERANCE * max(map(abs, way), default=0.0) else np.nan


def rests_on_way(past_rests: Sequence[Rest], here: list[float]) -> tuple[list[float], list[Array]]:
    """Places and poses of earlier rests on the straight way of the drives that leads `here`.

    A place is counted from `here` in units of the way from the last rest, which is at -1.  Rests
    before a change of direction are left out.
    """
    before = subtract_values(here, past_rests[-1][0])
    places, poses = [-1.0], [past_rests[-1][1]]
    for value, pose in past_rests[-2::-1]:
        place = ratio_of_ways(subtract_values(value, here), before)
        if not place < places[-1]:
            break
        places.append(place)
        poses.append(pose)
    return places, poses


def subtract_values(one: list[float], other: list[float]) -> list[float]:
    """Differences of two lists of values of the drives."""
    return [a - b for a, b in zip(one, other, strict=True)]


def lagrange_weights(position: float, places: list[float]) -> list[float]:
    """Weights of the values at `places` in the value at `position` of the interpolating polynomial.

    The polynomial is 0 at 0.

    >>> lagrange_weights(1.0, [-1.0, -2.0])
    [-3.0, 1.0]
    """
    parts = []
    for place in places:
        part = position / place
        for other in places:
            if other != place:
                part *= (position - other) / (place - other)
        parts.append(part)
    return parts


@dataclass
class SweepState:
    """The state of a sweep: a space whose drives are fixed at values, and the present pose.

    ``free`` tells whether the drives leave degrees of freedom.  ``velocity`` is that after the last
    step of ``dt`` [s] from standstill.  ``usual`` is the initial number of iterations in a step,
    and ``most`` the largest number used so far.  ``past_rests`` are the drives' values and poses of
    up to `KEPT_RESTS` rests before the present pose.  ``friction`` are the motors of joints with
    dry friction, and ``rub`` is the signed friction of each [N m or N].  ``moving`` is a separate
    space for the computation of rates, if there are no degrees of freedom: Chipmunk begins each
    step with the impulses of the last step, and the impulses of a motion differ much from those of
    a rest.  ``largest`` is the largest force of a drive so far [N m or N].
    """

    links: Links
    space: pymunk.Space
    bodies: RestingBodies
    drives: list[LinkDrive]
    stops: Stops
    dt: float
    free: bool
    pose: Array
    usual: int
    velocity: Array = field(default_factory=lambda: np.zeros(1))
    most: int = 0
    past_rests: tuple[Rest, ...] = ()
    friction: list[FrictionMotor] = field(default_factory=list)
    rub: Array = field(default_factory=lambda: np.zeros(0))
    moving: "SweepState | None" = None
    largest: float = 0.0

    def replace_loads(self, links: Links, error_bias: float) -> None:
        """Replace the space by one whose links have other loads, at the present pose."""
        self.links, self.space = links, build_undamped(links, self.usual, error_bias)
        self.bodies = RestingBodies(self.space, links)
        self.drives, self.stops = add_drives(self.space, links), find_stops(links, self.space)

    @property
    def drive_count(self) -> int:
        """Number of the drives that the run prescribes."""
        return len(self.drives)

    @property
    def rounding_error(self) -> float:
        """Rounding error of the move in a step [extents or radians], from all iterations."""
        return ROUNDING_PER_ITERATION * self.space.iterations

    def step(self, target: Array) -> None:
        """Compute the velocity after a step of the engine from standstill with given drives.

        With degrees of freedom the step is repeated, and the solver goes on from its last impulses,
        until the velocity agrees with that of the repetition before.  A step that is not solved
        would move joints off their stops, and the next step would begin without the impulses of
        these stops.

        Raises
        ------
        NotSolved
            The velocity does not converge.
        """
        aim_drives(self.drives, target.tolist())
        bound_stop_bias(self.stops, self.pose, self.dt)
        if not self.free:
            self._solve()
            return
        noise = self.rounding_error / self.dt
        change = np.nan
        for _ in range(0, MAX_REPEATED_ITERATIONS, self.space.iterations):
            last, before = self.velocity, change
            self._solve()
            change = float(move_sizes(self.links, self.velocity - last))
            error = REPETITION_TOLERANCE * move_sizes(self.links, self.velocity) + noise
            # The sum of the last change and all later ones, if these fall as a geometric series, is
            # change before / (before - change).  Changes that no longer fall are rounding errors.
            small = change * before <= error * (before - change) or before <= change <= error
            if small:
                return
        raise NotSolved(
            f"drives at {np.round(target, 4).tolist()}: a step is not solved after "
            f"{MAX_REPEATED_ITERATIONS} iterations"
        )

    def _solve(self) -> None:
        """Step the engine once from standstill, and keep the velocity, solved or not."""
        self.velocity = self.bodies.step(self.pose, self.dt)

    def settle(self, target: Array, tolerance: float = REST_TOLERANCE) -> None:
        """Step until the pose is at rest with the drives at given values.

        Raises
        ------
        BadModel
            The loops cannot be closed at these values, or joint limits are in the way.
        Diverged
            The loops can be closed, but Chipmunk does not close them.
        NotSolved
            The pose is not at rest after the largest number of steps.
        """
        last = drive_values(self.links, self.pose).tolist(), self.pose
        self.ahead(target, last[0])
        settled, unsolved, began, modes = 0, 0, self.pose, None
        self.space.iterations = self.usual
        for count in range(STEP_LIMITS[self.free]):
            if count == STEPS_BEFORE_CHECK:
                self._check_closable(began, target)
            solved = True
            try:
                self.step(target)
            except NotSolved:
                solved, unsolved = False, unsolved + 1
                if unsolved > MAX_UNSOLVED_STEPS:
                    raise
            on_stops, move = joints_beyond_stops(self.stops, self.pose), self.dt * self.velocity
            if self.free and np.isfinite(move).all():
                move, modes = move_toward_rest(self.links, self.pose, self.velocity, self.dt, modes)
            self.pose = self.pose + move
            moved = float(move_sizes(self.links, move))
            if not moved < np.inf:
                break
            # A step that ends at a stop may be short although forces are large; it does not count.
            steady = (
                moved < max(tolerance, self.rounding_error)
                and joints_beyond_stops(self.stops, self.pose) == on_stops
            )
            settled = settled + 1 if steady and solved else 0
            if settled == STEPS_AT_REST or (settled and tolerance > REST_TOLERANCE):
                if not self._is_violated(target):
                    self.most = max(self.most, self.space.iterations)
                    self.past_rests = (*self.past_rests[1 - KEPT_RESTS :], last)
                    return
                if settled == STEPS_AT_REST:
                    raise self._rest_error(target, "at rest")
        close_loops(self.links, began, target)
        kind = NotSolved if np.isfinite(self.velocity).all() else Diverged
        raise self._rest_error(target, f"not at rest after {count + 1} steps", kind)

    def ahead(self, target: Array, here: list[float]) -> None:
        """Extrapolate the pose from the last rests, if the drives go on from `here` straight on.

        The extrapolated pose is nearer to the next rest, and lies on the smooth branch where two
        branches cross.  With degrees of freedom it is taken only if it violates constraints and
        drives less than the present pose, which is not the case after a snap to another
        equilibrium.  A polynomial through more than two rests is used where it is nearly a line and
        no joint is on its stop: the polynomial would leave or enter it by less than `STOP_MARGIN`.
        """
        if not self.past_rests:
            return
        share = ratio_of_ways(
            subtract_values(target.tolist(), here), subtract_values(here, self.past_rests[-1][0])
        )
        if not 0 < share <= MAX_EXTRAPOLATED_WAYS:  # the drives turn, or go much further
            return
        move = share * (self.pose - self.past_rests[-1][1])
        places, poses = rests_on_way(self.past_rests, here)
        parts = lagrange_weights(share, places)
        curved = (1.0 - sum(parts)) * self.pose
        for part, pose in zip(parts, poses, strict=True):
            curved += part * pose
        there = self.pose + move
        smooth = move_sizes(self.links, curved - there) < MAX_POLYNOMIAL_DEVIATION * move_sizes(
            self.links, move
        )
        if smooth and not joints_beyond_stops(self.stops, self.pose):
            there = curved
        if self.free:
            bounds = self.links.bounds
            violation = np.abs(constraint_errors(self.links, there, target) / bounds).max()
            if not violation < np.abs((target - here) / bounds[len(bounds) - len(here) :]).max():
                return
        self.pose = there

    def _check_closable(self, began: Array, target: Array) -> None:
        """Check that the loops can be closed; without degrees of freedom, restart more accurately.

        The restart is from the pose `began`, with the iterations that the closed pose needs.  With
        degrees of freedom the steps go on from the present pose, since each of them is solved.
        """
        there = close_loops(self.links, began, target)
        if not self.free:
            needed = iterations_needed(self.links, there[None], REMAINING_REST_ERROR)
            self.space.iterations = min(max(self.usual, needed), MAX_REPEATED_ITERATIONS)
            self.pose = began

    def _is_violated(self, target: Array) -> bool:
        """Whether a constraint violation or a drive's error is larger than `COARSE_TOLERANCE`."""
        violations = constraint_errors(self.links, self.pose, target) / self.links.bounds
        return bool(np.abs(violations).max(initial=0.0) > COARSE_TOLERANCE)

    def _rest_error(self, target: Array, how: str, kind: type[Diverged] = Diverged) -> Exception:
        """The error for a pose that does not come to rest at `target`.

        It is a `BadModel` if joints are on their stops and constraints or drives are violated, and
        otherwise of the type `kind`.
        """
        names = [f"'{joint.name}'" for joint in joints_beyond_stops(self.stops, self.pose)]
        if names and self._is_violated(target):
            return BadModel(
                f"joint {', '.join(names)} is on its stop before "
                f"{format_drives(self.links, target)}"
            )
        here = format_drives(self.links, drive_values(self.links, self.pose))
        return kind(
            f"drives at {np.round(target, 4).tolist()}: {how}, loops open by "
            f"{constraint_violations(self.links, self.pose).max():.3g} m"
            + (f", {here}" if here else "")
        )

    def rubs(self, rate: Array, fastest: float) -> None:
        """Apply dry friction against the motion of each joint at given rates of the drives.

        A joint that is slower than a share `REST_RATE_SHARE` of the fastest drive rate of the run
        keeps its friction.
        """
        if not self.friction:
            return
        joints = tuple(motor.joint for motor in self.friction)
        moved = derivative_along(lambda p: values_of(joints, p), self.pose, self.rates(rate))
        bounds = np.array([joint.friction for joint in joints])
        rub = np.where(np.abs(moved) > REST_RATE_SHARE * fastest, np.sign(moved) * bounds, self.rub)
        if (rub != self.rub).any():
            self.rub = rub
            self.push()
            self.settle(drive_values(self.links, self.pose))

    def push(self) -> None:
        """Set the friction motors to the signs of the friction `rub`."""
        for motor, rub in zip(self.friction, self.rub, strict=True):
            motor.slip(float(np.sign(rub)), float(joint_value(motor.joint, self.pose)))

    def drive_forces(self) -> Array:
        """Moments [N m] or forces [N] of the drives on their joints, in a pose at rest.

        Chipmunk gives only the size of an impulse.  Its sign is found by a step in which the force
        of the drive is limited to slightly less: the joint then moves against the force of the
        drive.  The first iteration shows this already, since it reduces the impulse of the drive
        and leaves the others as they are.  The force is reduced by `FORCE_REDUCTION` times the
        largest force, or to zero if it is smaller than that, so that the next rest begins with
        nearly right impulses.
        """
        here = drive_values(self.links, self.pose)
        self.step(here)
        size, fall = self.impulses() / self.dt, np.empty(self.drive_count)
        self.largest = max(self.largest, float(size.max(initial=0.0)))
        held = np.maximum(size - FORCE_REDUCTION * self.largest, 0.0)
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
            fallen = derivative_along(
                lambda p: drive_values(self.links, p), self.pose, self.velocity
            )
            fall[some] = fallen[some]
        return -size * np.sign(fall)

    @cached_property
    def together(self) -> list[list[int]]:
        """Groups of drives whose forces may be reduced at the same time.

        No two drives of a group have a moving link in common.  With degrees of freedom each drive
        is a group of its own, since more than the first iteration is needed.
        """
        turns, taken = list[list[int]](), list[set[int]]()
        for k, joint in enumerate(self.links.drives[: self.drive_count]):
            ends = {joint.constraint.a, joint.constraint.b} - {len(self.links.mass)}
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
        """Sizes (drives,) of the impulses of the drives in the step [N s or N m s].

        With friction motors, with which they converge slowly, the step is repeated until they do.
        """
        size = np.array([drive.impulse for drive in self.drives[: self.drive_count]])
        for _ in range(STEP_LIMITS[False] if self.friction else 0):
            last = size
            self._solve()
            size = np.array([drive.impulse for drive in self.drives[: self.drive_count]])
            if np.abs(size - last).max() <= IMPULSE_TOLERANCE * np.abs(size).max():
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
        for _ in range(1, STEP_LIMITS[False]):
            last = moving.velocity
            moving.step(ahead)
            change = move_sizes(self.links, moving.velocity - last)
            if change < REST_TOLERANCE * move_sizes(self.links, moving.velocity):
                break
        return size * moving.velocity


@dataclass
class FrictionSweepState(SweepState):
    """The state of a sweep with degrees of freedom and dry friction in joints without drive.

    The rest depends on the path that led to it: joints stick or slip, see
    `proofmass.analytic.friction`.  Against a joint that slips acts a motor of Chipmunk with a
    limited moment.  A joint that sticks is fixed like a drive; at each sample a step with its
    friction motor instead must give it no velocity.  A sweep begins at rest without friction.
    """

    senses: Array = field(default_factory=lambda: np.zeros(0))
    is_at_start: bool = True

    def __post_init__(self) -> None:
        self.own, self.real = self.links, list(self.drives)
        self.loose = list(self.own.rubbing_loose)
        names = [self.own.joints[j].name for j in self.loose]
        if len(names) > MAX_FRICTION_JOINTS:
            raise Unsupported(
                f"frictionloss of {len(names)} joints in a sweep with degrees of freedom left; up "
                f"to {MAX_FRICTION_JOINTS} are covered"
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
        """Raise `BadModel` if no joint without drive slipped in the whole sweep."""
        if not self.slipped.any():
            names = [repr(self.own.joints[j].name) for j in self.loose]
            raise BadModel(NOTHING_SLIPS.format(", ".join(names)))

    @property
    def drive_count(self) -> int:
        """Number of the drives that the run prescribes; others fix joints that stick."""
        return len(self.real)

    def rubs(self, rate: Array, fastest: float) -> None:
        """Apply the friction of driven joints, and check that motors keep others from slipping."""
        for k, (j, motor) in enumerate(zip(self.own.rubbing, self.friction, strict=True)):
            if j in self.own.driven:
                moved = rate[self.own.driven.index(j)]
                if abs(moved) > REST_RATE_SHARE * fastest:
                    self.rub[k] = np.sign(moved) * motor.joint.friction
                motor.slip(float(np.sign(self.rub[k])), float(joint_value(motor.joint, self.pose)))
        if not self.is_at_start:
            found = self.problem(self.way).solve_state(self.senses)
            assert found is not None
            self.rub[self.places] = found.friction
            self.check_sticking()
        self.settle(np.append(self.at(), self.fixed))

    def check_sticking(self) -> None:
        """Check by a step of the engine that friction motors alone keep sticking joints at rest.

        Raises
        ------
        NotSolved
            A joint slips in the step.
        """
        # The drives that fix stuck joints may have any force. In this step the motors alone, whose
        # force is limited by the friction, have to keep the joints at rest.
        for drive in self.drives[self.drive_count :]:
            drive.max_force = 0.0
        for motor in self.sticking_motors:
            motor.stick(float(joint_value(motor.joint, self.pose)))
        self.step(np.append(self.at(), self.fixed))
        moved = float(move_sizes(self.links, self.dt * self.velocity))
        for drive in self.drives[self.drive_count :]:
            drive.max_force = float("inf")
        for motor in self.sticking_motors:
            motor.slip(0.0, 0.0)
        if moved > STICKING_TOLERANCE:
            names = ", ".join(f"'{motor.joint.name}'" for motor in self.sticking_motors)
            raise NotSolved(f"joints {names} should stick, but slip by {moved:.2g} extents or rad")

    @property
    def sticking_motors(self) -> list[FrictionMotor]:
        """The friction motors of joints that stick."""
        return [motor for motor, sense in zip(self.motors, self.senses, strict=True) if sense == 0]

    def at(self) -> Array:
        """Values [rad or m] of the drives that the run prescribes."""
        return drive_values(self.own, self.pose)

    def kept(self) -> tuple[Array, Array]:
        """The pose and the engine's last velocity, for `back`."""
        return self.pose, self.velocity

    def back(self, kept: tuple[Array, Array]) -> None:
        """Return to a pose of `kept`."""
        (self.pose, self.velocity), self.past_rests = kept, ()

    def go(self, target: Array) -> None:
        """Come to rest at values of the drives, with the same joints sticking and slipping."""
        try:
            for stage in drive_stages(self.own, self.at(), target):
                self.settle(np.append(stage, self.fixed))
        except (BadModel, NotSolved) as error:
            raise PathEnds(str(error)) from None

    def problem(self, way: Array) -> SlipProblem:
        """The `SlipProblem` of the present rest for drives that move along a way (drives,)."""
        self.way, own, pose = way, self.own, self.pose
        rows = jacobian(lambda p: constraint_values(own, p), pose)
        free = free_directions(own, rows)
        # the least move of the bodies with which the drives go along their way
        wanted = np.append(np.zeros(len(rows) - way.size), way)
        lead = np.pad(least_move(own, rows, wanted).reshape(1, -1, 3), ((0, 0), (0, 1), (0, 0)))
        moves = np.concatenate([free, lead])
        slopes = gradient_changes(self.links, pose, moves)
        joints = tuple(own.joints[j] for j in self.loose)
        turned = derivative_along(lambda p: values_of(joints, p), pose, moves).T
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
        """Indices of sticking joints that are independent, and fix all joints that stick."""
        own, kept = self.own, list[int]()
        free = free_directions(own, jacobian(lambda p: constraint_values(own, p), self.pose))
        joints = tuple(own.joints[j] for j in self.loose)
        turn = derivative_along(lambda p: values_of(joints, p), self.pose, free).T
        for k in stuck.tolist():
            rows = turn[[*kept, k]]
            if np.linalg.matrix_rank(rows, rtol=STUCK_RANK_TOLERANCE) == len(rows):
                kept.append(k)
        return kept

    def enter(self, senses: Array) -> None:
        """Set which joints stick and in which senses the others slip, and come to rest."""
        # No pose is extrapolated from past rests: there other joints were stuck.
        self.senses, self.past_rests, self.is_at_start = senses, (), False
        self.slipped |= senses != 0
        self.space.remove(*self.drives[self.drive_count :])
        joints = list(self.own.joints)
        for j, motor, sense in zip(self.loose, self.motors, senses.tolist(), strict=True):
            joint = joints[j]
            # The motor gives the engine the friction of a joint that slips, a constant moment. As a
            # load of the links it is also in the energy by which `settle` moves toward the rest.
            joints[j] = replace(joint, load=joint.load - sense * joint.friction)
            motor.slip(sense, float(joint_value(joint, self.pose)))
        # A joint that cannot move while the others stick is not fixed as well: the forces of
        # constraints that depend on each other are not determined.
        stuck = [self.loose[k] for k in self.independent(np.flatnonzero(senses == 0))]
        self.links = replace(self.own, joints=tuple(joints), driven=(*self.own.driven, *stuck))
        holds = [make_drive(joints[j], self.own, self.space) for j in stuck]
        self.space.add(*holds)
        self.drives = [*self.real, *holds]
        # joints stick where they are, so that entering moves no joint but those that begin to slip
        self.fixed = values_of(tuple(joints[j] for j in stuck), self.pose)
        self.settle(np.append(self.at(), self.fixed))


def start_sweep(links: Links, settings: Settings) -> SweepState:
    """The state of a sweep at its beginning, in the start pose or near it.

    With degrees of freedom the pose is at the distance `START_DISTANCE` from the start pose.
    Without them the links get the masses of `replace_inertia`; otherwise they keep their own, to
    which the modes of `move_toward_rest` belong.

    The space has no dampers: they have no effect at rest, and Chipmunk's steps toward the rest
    would not be solved with them.

    Raises
    ------
    BadModel
        The loops cannot be closed in the start pose.
    """
    pose = close_loops(links, links.pose, drive_values(links, links.pose))
    moves = free_directions(links, jacobian(lambda p: constraint_values(links, p), pose))
    if not len(moves):
        links = replace_inertia(links)
    iterations = settings["iterations"]
    if iterations is None:
        needed = (
            MAX_START_ITERATIONS
            if len(moves)
            else iterations_needed(links, pose[None], START_ERROR_SHARE)
        )
        iterations = min(needed, MAX_START_ITERATIONS)
    loose = links.rubbing_loose
    dt, begin = _choose_step(links, pose), links.pose + _start_offset(links, moves)

    def held(kind: type[SweepState], rubs: bool) -> SweepState:
        space = build_undamped(links, iterations, settings["error_bias"])
        friction = add_friction(space, links, links.rubbing) if rubs else []
        return kind(
            links,
            space,
            RestingBodies(space, links),
            add_drives(space, links),
            find_stops(links, space),
            dt,
            len(moves) > 0,
            begin,
            iterations,
            friction=friction,
            rub=np.zeros(len(friction)),
        )

    made = held(FrictionSweepState if loose and len(moves) else SweepState, rubs=True)
    made.moving = None if made.free else held(SweepState, rubs=False)
    return made


def build_undamped(links: Links, iterations: int, error_bias: float) -> pymunk.Space:
    """The space of links without dampers, drives and gravity; `RestingBodies` adds the weights."""
    undamped = replace(
        links,
        joints=tuple(replace(joint, damping=0.0) for joint in links.joints),
        springs=tuple(replace(spring, damping=0.0) for spring in links.springs),
    )
    space = build_space(undamped, iterations, error_bias)
    space.gravity = 0.0, 0.0
    return space


DRIVEN_LINK_MASS = 100.0
"""Mass [kg] of links that chains of drives connect to the ground; all others have 1 kg."""
GYRATION_SHARE = 0.5
"""Square of the radius of gyration of a link, as a share of the mean square distance of its
constraints from its centre."""
MIN_CONSTRAINT_DISTANCE = 0.1
"""Smallest root mean square distance of a link's constraints from its centre that is used
[extents]."""


def replace_inertia(links: Links) -> Links:
    """The links with masses and moments of inertia with which Chipmunk's solver converges faster.

    A rest does not depend on masses, and the weights are kept.  An iteration of the solver treats
    one constraint after the other, and fewer iterations are needed the less the impulse of one
    constraint moves the other constraints of a link.  So the mass of a link is nearer to its
    constraints than in a uniform bar, and driven links are heavy.
    """
    ground = len(links.mass)
    mass, squares = np.ones(ground), [list[float]() for _ in range(ground + 1)]
    for constraint in links.holds:
        squares[constraint.a].append(float(constraint.on_a @ constraint.on_a))
        squares[constraint.b].append(float(constraint.on_b @ constraint.on_b))
    held = {ground}
    for _ in links.drives:
        for ends in ({joint.constraint.a, joint.constraint.b} for joint in links.drives):
            held |= ends if ends & held else set()
    mass[list(held - {ground})] = DRIVEN_LINK_MASS
    least = (MIN_CONSTRAINT_DISTANCE * links.extent) ** 2
    square = [max(float(np.mean(own)), least) for own in squares[:-1]]
    return replace(links, mass=mass, moment=GYRATION_SHARE * mass * square)


def _start_offset(links: Links, moves: Array) -> Array:
    """A move (links + 1, 3) of size `START_DISTANCE` with parts in all free directions.

    `moves` (n, links + 1, 3) are a basis of these directions that is orthonormal with respect to
    the masses; the result does not depend on the choice of the basis.
    """
    shares = np.pad(np.cos(np.arange(links.sizes.size)) * links.sizes, (0, 3))
    way = np.tensordot(np.tensordot(moves, links.inertia * shares.reshape(-1, 3), 2), moves, 1)
    return np.asarray(START_DISTANCE * way / (move_sizes(links, way) or 1.0))


def _choose_step(links: Links, pose: Array) -> float:
    """Choose the step [s], so that rounding of loads and of positions cause equal errors of a move.

    The force of a spring is taken at a deflection of a radian or an extent, since springs may be
    slack where the sweep begins.
    """
    wound = [
        abs(joint.acting[0]) * (links.extent if joint.constraint.axis is not None else 1.0)
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


NO_ACCELERATION = "Chipmunk has no inverse dynamics: no accelerations in a sweep"
NO_INERTIA = "Chipmunk has no inverse dynamics: moments and forces of a sweep are those at rest"
POSE_STEPS = 30
"""Steps that count as the solution of a pose."""
NO_RATE = "Chipmunk gives no quasi-static rates where the drives leave degrees of freedom"


def sweep(links: Links, run: Run, channels: dict[str, Sensor], settings: Settings) -> Curves:
    """Do a quasi-static sweep; see `proofmass.sim.pymunk.engine.simulate`.

    If the loops cannot be closed at a sample, the sweep ends and keeps the samples before it.
    """
    if not run.drives:
        raise Unsupported("a sweep without a driven joint")
    began = processor_time()
    profiles = np.array(
        [[curve * np.ones(len(run.x)) for curve in drive.profile(run.x)] for drive in run.drives]
    )  # drives, (value, rate, acceleration), samples
    sweep_state = start_sweep(links, settings)
    loaded = LoadedLinks.of(links, run)
    missing = {name: NO_ACCELERATION for name, c in channels.items() if c.order == 2}
    if sweep_state.free:
        missing |= {name: NO_RATE for name, c in channels.items() if c.order in (1, -1)}
    if run.inertia:
        missing |= {name: NO_INERTIA for name, c in channels.items() if c.order <= -2}
    wanted = {name: c for name, c in channels.items() if name not in missing}
    read, stopped = _follow_drives(
        sweep_state, profiles, {c.order for c in wanted.values()}, loaded, settings
    )
    if isinstance(sweep_state, FrictionSweepState) and not stopped:
        sweep_state.check_slipped()
    pose, velocity, force, friction = (np.array(part) for part in zip(*read, strict=True))
    curves = {
        name: unwrap_angle(name, _channel_curve(c, links, pose, velocity, force))
        for name, c in wanted.items()
        if c.order != -3
    }
    between = {name: c for name, c in wanted.items() if c.order == -3}
    n = len(pose)
    taken = np.zeros((n, len(links.joints)))
    taken[:, links.rubbing] = friction
    if run.loads:
        curves |= loaded.curves(wanted, SampledMotion.at_rest(pose, taken))
    else:
        curves |= force_curves(links, between, SampledMotion.at_rest(pose, taken))
    state = (drive_values(links, pose).T, profiles[:, 1, :n], profiles[:, 2, :n])
    return Curves(
        run.x[:n],
        curves,
        missing,
        state,
        float(constraint_violations(links, pose).max()),
        processor_time() - began,
        n,
        {"iterations": sweep_state.most, "error_bias": settings["error_bias"]},
        stopped,
        derivatives=0 if sweep_state.free else 1,
        work=n * POSE_STEPS * step_seconds(links, len(run.drives), sweep_state.most),
    )


def _follow_drives(
    sweep_state: SweepState,
    profiles: Array,
    orders: set[int],
    loaded: LoadedLinks,
    settings: Settings,
) -> tuple[list[tuple[Array, ...]], str]:
    """Pose, velocity, drive forces and friction at each sample, and the reason of an early end.

    The reason is empty if all samples were reached.
    """
    read: list[tuple[Array, ...]] = []
    fastest = float(np.abs(profiles[:, 1]).max())
    before = loaded.controls[0]
    for value, rate, controls in zip(
        profiles[:, 0].T, profiles[:, 1].T, loaded.controls, strict=True
    ):
        try:
            _drive_to(sweep_state, value, loaded, before, controls, settings)
            sweep_state.rubs(rate, fastest)
        except BadModel as error:
            if len(read) < 2:
                raise
            last = format_drives(loaded.links, profiles[:, 0, len(read) - 1])
            return read, f"stopped at {last}: {error}"
        pose, before = sweep_state.pose, controls
        force = sweep_state.drive_forces() if -2 in orders else np.zeros(len(value))
        velocity = sweep_state.rates(rate) if orders & {1, -1} else np.zeros_like(pose)
        read.append((pose, velocity, force, sweep_state.rub.copy()))
    return read, ""


def _drive_to(
    sweep_state: SweepState,
    target: Array,
    loaded: LoadedLinks,
    before: Array,
    controls: Array,
    settings: Settings,
) -> None:
    """Come to rest at values of the drives, in stages in which the controls change uniformly."""
    if isinstance(sweep_state, FrictionSweepState) and sweep_state.velocity.size > 1:
        try:
            follow_stick_slip(sweep_state, target)
        except PathEnds as error:
            raise BadModel(str(error)) from None
        return
    way = drive_stages(sweep_state.links, drive_values(sweep_state.links, sweep_state.pose), target)
    for k, stage in enumerate(way, 1):
        if controls.size:
            now = before + k / len(way) * (controls - before)
            sweep_state.replace_loads(loaded.at(now), settings["error_bias"])
        sweep_state.settle(stage, REST_TOLERANCE if k == len(way) else COARSE_TOLERANCE)


def _channel_curve(c: Sensor, links: Links, pose: Array, velocity: Array, force: Array) -> Array:
    """The curve of a channel in a sweep, except of forces between bodies."""
    if c.order == -2:
        return force[:, c.drive] * c.factor
    if c.order == -1:
        return kinetic_energy(links, velocity)
    return c.function(pose) if c.order == 0 else derivative_along(c.function, pose, velocity)


NO_MOTION = "nothing moves: no rates, no accelerations"


def equilibrium(links: Links, run: Run, channels: dict[str, Sensor], settings: Settings) -> Curves:
    """Find the equilibrium of a mechanism with its drives fixed at their first values.

    The shapes of rods are given at the arc lengths ``run.x``; sensors are constant along ``run.x``.
    """
    began, start = processor_time(), run.motion(run.x[:1])[0][:, 0]
    sweep_state = start_sweep(links, settings)
    sweep_state.settle(start)
    pose = sweep_state.pose
    forces = (
        sweep_state.drive_forces() if any(c.order == -2 for c in channels.values()) else np.empty(0)
    )
    curves = {
        name: np.full(run.x.size, forces[c.drive] * c.factor if c.order == -2 else c.function(pose))
        for name, c in channels.items()
        if c.order in (0, -2)
    }
    curves = {name: unwrap_angle(name, curve) for name, curve in curves.items()}
    between = {name: c for name, c in channels.items() if c.order == -3}
    at_rest = force_curves(links, between, SampledMotion.at_rest(pose[None]))
    curves |= {name: np.full(run.x.size, curve[0]) for name, curve in at_rest.items()}
    curves |= rod_curves(run, lambda one: rod_shape(links, pose, one))
    missing = {name: NO_MOTION for name in channels if name not in curves}
    return Curves(
        run.x,
        curves,
        missing,
        violation=float(constraint_violations(links, pose).max()),
        seconds=processor_time() - began,
        steps=1,
        settings={"iterations": sweep_state.most, "error_bias": settings["error_bias"]},
        work=POSE_STEPS * step_seconds(links, len(run.drives), sweep_state.most),
    )


def rod_shape(links: Links, pose: Array, one: Chain) -> RodPose:
    """Vertices [m], angles [rad] and joint values [rad] of the links of a rod in a pose."""
    bodies = [links.model.body(name).id for name in one.names]
    tip = links.model.site(f"{one.rod.name}.tip")
    places = [point_position(links, pose, b, links.data.xpos[b]) for b in bodies]
    places.append(point_position(links, pose, tip.bodyid[0], links.data.site_xpos[tip.id]))
    ahead = links.plane.flat(links.data.xmat[bodies].reshape(-1, 3, 3)[:, :, 0])
    angles = np.arctan2(ahead[:, 1], ahead[:, 0]) + pose[links.of_body[bodies], 2]
    bends = [
        joint_value(links.joints[links.model.joint(name).id], pose) if jointed else 0.0
        for name, jointed in zip(one.names, one.has_joint, strict=True)
    ]
    return np.array(places), angles, np.array(bends, float)


def point_position(links: Links, pose: Array, body: int, start: Array) -> Array:
    """World position (3,) [m] in a pose of a point of a body, given by that in the start pose."""
    link, plane = links.of_body[body], links.plane
    local = plane.flat(start) - links.centre[link]
    return plane.world(pose[link, :2] + rotate(pose[link, 2], local), float(start @ plane.normal))
