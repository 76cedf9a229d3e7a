"""Build a pymunk space from links, and read or set the state of all its bodies at once.

An ideal drive is a constraint between two links whose target is moved before each step.  With an
error bias of 0 a step of Chipmunk corrects the whole error to the target, so drives do not drift,
even where several of them act on one link and only the last in order is satisfied exactly.
"""

import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

import numpy as np
import pymunk
from pymunk import batch

from proofmass.base.arrays import Array
from proofmass.sim.pymunk.contacts import ContactShape
from proofmass.sim.pymunk.links import (
    LinkConstraint,
    LinkGear,
    LinkJoint,
    LinkLoad,
    Links,
    LinkSpring,
)

Settings = dict[str, Any]
"""Keys timestep [s], iterations, error_bias; for contacts collision_slop [m] and collision_bias."""
VELOCITY_FIELDS = batch.BodyFields.VELOCITY | batch.BodyFields.ANGULAR_VELOCITY
STATE_FIELDS = batch.BodyFields.POSITION | batch.BodyFields.ANGLE | VELOCITY_FIELDS
STATE_AND_FORCE_FIELDS = STATE_FIELDS | batch.BodyFields.FORCE
STOP_TYPES = (pymunk.RotaryLimitJoint, pymunk.SlideJoint)
"""Types of the constraints that represent joint limits; those of a space are in joint order."""
HALF_GROOVE = 100.0
"""Half length of the groove of a slide [extents]."""


def build_space(links: Links, iterations: int, error_bias: float) -> pymunk.Space:
    """Build the space: a body for each link, in their order, and all constraints except drives.

    Parameters
    ----------
    links : Links
    iterations : int
        Number of passes of the engine's solver over the constraints in a step.
    error_bias : float
        Share of a constraint violation that is left after a second [1]; with 0 it is corrected in
        the next step.

    Returns
    -------
    pymunk.Space
        At rest in the start pose, without drives.
    """
    space = pymunk.Space()
    space.gravity = tuple(links.gravity)
    space.iterations = iterations
    bodies = []
    for centre, mass, moment in zip(links.centre, links.mass, links.moment, strict=False):
        body = pymunk.Body(mass, moment)
        body.position = tuple(centre)
        space.add(body)
        bodies.append(body)
    for pull in links.pulls:
        _add_link_load(pull, bodies[pull.link])
    bodies.append(space.static_body)
    for _, constraint in make_constraints(links, bodies):
        # A stop that corrected its violation in a single step would make the joint bounce.
        if not isinstance(constraint, STOP_TYPES):
            constraint.error_bias = error_bias
        space.add(constraint)
    return space


def make_constraints(
    links: Links, bodies: list[pymunk.Body]
) -> Iterator[tuple[LinkSpring | LinkJoint | LinkConstraint | LinkGear, pymunk.Constraint]]:
    """All constraints except drives, in the solver's order, each with the element it belongs to.

    The order is: springs between points; for each joint its spring, load, stop and pin or slide;
    loops; gears.
    """
    for spring in links.springs:
        if (spring.stiffness or spring.damping) and spring.a != spring.b:
            yield spring, _make_point_spring(spring, links, bodies)
    for joint in links.joints:
        for constraint in (
            *_make_springs(joint, links, bodies),
            *(
                _make_link_constraints(joint.constraint, links, bodies, joint)
                if joint.holds
                else ()
            ),
        ):
            yield joint, constraint
    for loop in links.loops:
        for constraint in _make_link_constraints(loop, links, bodies):
            yield loop, constraint
    for gear in links.gears:
        yield gear, pymunk.GearJoint(bodies[gear.a], bodies[gear.b], gear.phase, gear.ratio)


def _add_link_load(pull: LinkLoad, body: pymunk.Body) -> None:
    """Apply a load to its body in every step, in addition to the loads that the body has."""
    before = body.velocity_func

    def pulled(body: pymunk.Body, gravity: pymunk.Vec2d, damping: float, dt: float) -> None:
        if pull.follows:
            body.apply_force_at_local_point(tuple(pull.force), tuple(pull.at))
        else:
            point = body.local_to_world(tuple(pull.at))
            body.apply_force_at_world_point(tuple(pull.force), point)
        body.torque += pull.moment
        before(body, gravity, damping, dt)

    body.velocity_func = pulled


def add_changing_load(space: pymunk.Space, unit: LinkLoad, k: int, now: list[float]) -> None:
    """Apply a load to its body in every step: the load `unit` times ``now[k]``."""
    body = list(space.bodies)[unit.link]
    before, (x, y) = body.velocity_func, unit.force.tolist()

    def pulled(body: pymunk.Body, gravity: pymunk.Vec2d, damping: float, dt: float) -> None:
        force = (now[k] * x, now[k] * y)
        if unit.follows:
            body.apply_force_at_local_point(force, tuple(unit.at))
        else:
            body.apply_force_at_world_point(force, body.local_to_world(tuple(unit.at)))
        body.torque += now[k] * unit.moment
        before(body, gravity, damping, dt)

    body.velocity_func = pulled


def add_changing_spring(
    space: pymunk.Space, links: Links, joint: LinkJoint, k: int, unit: float, now: list[float]
) -> None:
    """Apply a force or torque to a joint in every step: `unit` [N or N m] times ``now[k]``."""
    bodies = [*space.bodies, space.static_body]
    space.add(_make_spring(joint, links, bodies, lambda _: unit * now[k]))


def body_point(links: Links, link: int, local: Array) -> tuple[float, float]:
    """A point in the coordinates of a link's body, from one relative to the link's centre.

    The coordinates of the ground's static body are those of the world.
    """
    return tuple(local + (links.centre[link] if link == len(links.mass) else 0.0))


def add_contacts(space: pymunk.Space, links: Links, settings: Settings) -> None:
    """Add shapes to the bodies of a space from `build_space`, with the contact law of each pair."""
    contacts = links.contacts
    if not contacts:
        return
    space.collision_slop = settings["collision_slop"]
    space.collision_bias = settings["collision_bias"]
    bodies, places = [*space.bodies, space.static_body], dict[pymunk.Shape, int]()
    for k, own in enumerate(contacts.shapes):
        shape = _make_shape(own, links, bodies[own.link])
        places[shape] = k
        space.add(shape)

    def meet(arbiter: pymunk.Arbiter, space: pymunk.Space, data: Any) -> None:
        one, two = arbiter.shapes
        law = contacts.between(places[one], places[two])
        if law is None:
            arbiter.process_collision = False
        else:
            arbiter.friction, arbiter.restitution = law.friction, law.restitution

    space.on_collision(pre_solve=meet)


def _make_shape(own: ContactShape, links: Links, body: pymunk.Body) -> pymunk.Shape:
    """The circle, segment or polygon of a section."""
    points = [body_point(links, own.link, point) for point in own.points]
    if len(points) == 1:
        return pymunk.Circle(body, own.radius, points[0])
    if len(points) == 2:
        return pymunk.Segment(body, points[0], points[1], own.radius)
    return pymunk.Poly(body, points, radius=own.radius)


def _make_link_constraints(
    constraint: LinkConstraint,
    links: Links,
    bodies: list[pymunk.Body],
    joint: LinkJoint | None = None,
) -> list[pymunk.Constraint]:
    """Make Chipmunk's constraints for a pin or slide; limits of its joint come first."""
    a, b = bodies[constraint.a], bodies[constraint.b]
    limits = tuple(e - joint.value for e in joint.limits) if joint and joint.limits else None
    if constraint.axis is None:
        pin = pymunk.PivotJoint(
            a,
            b,
            body_point(links, constraint.a, constraint.on_a),
            body_point(links, constraint.b, constraint.on_b),
        )
        if joint is None or limits is None:
            return [pin]
        low, high = sorted(joint.sign * limit for limit in limits)
        return [pymunk.RotaryLimitJoint(a, b, low, high), pin]
    reach = HALF_GROOVE * links.extent
    stops: list[pymunk.Constraint] = []
    if limits:
        low, high = (reach + limit for limit in limits)
        stops = [
            pymunk.SlideJoint(
                a,
                b,
                body_point(links, constraint.a, constraint.on_a - reach * constraint.axis),
                body_point(links, constraint.b, constraint.on_b),
                low,
                high,
            )
        ]
    start, end = (
        body_point(links, constraint.a, constraint.on_a + s * constraint.axis)
        for s in (-reach, reach)
    )
    # The groove's solution is correct only if neither anchor couples sliding with rotation;
    # proofmass.sim.pymunk.model chooses the anchors so.  A RotaryLimitJoint instead of the gear
    # would lock the rotation to one side only in each step.
    return [
        *stops,
        pymunk.GearJoint(a, b, 0.0, 1.0),
        pymunk.GrooveJoint(a, b, start, end, body_point(links, constraint.b, constraint.on_b)),
    ]


def _make_springs(
    joint: LinkJoint, links: Links, bodies: list[pymunk.Body]
) -> list[pymunk.Constraint]:
    """The spring of a joint, and its load as a spring with a constant force.

    A linear spring is computed by Chipmunk itself, which calls no Python function in a step.
    """
    springs: list[pymunk.Constraint] = []
    stiffness, *more = joint.acting
    if any(joint.acting) or joint.damping:
        own = _make_linear_spring(
            joint, links, bodies, 0.0 if any(more) else stiffness, joint.damping
        )
        springs.append(own)
        if any(more):
            _set_force(own, joint, links, joint.spring_force)
    if joint.load:
        springs.append(_make_spring(joint, links, bodies, lambda value: joint.load))
    return springs


def _make_spring(
    joint: LinkJoint, links: Links, bodies: list[pymunk.Body], force: Callable[[float], float]
) -> pymunk.Constraint:
    """A spring between two links whose force is a function of the joint's value."""
    spring = _make_linear_spring(joint, links, bodies, 0.0, 0.0)
    _set_force(spring, joint, links, force)
    return spring


def _make_linear_spring(
    joint: LinkJoint, links: Links, bodies: list[pymunk.Body], stiffness: float, damping: float
) -> pymunk.DampedRotarySpring | pymunk.DampedSpring:
    """A linear spring and damper between two links, slack at the rest value of the joint."""
    constraint, slack = joint.constraint, joint.rest - joint.value
    a, b = bodies[constraint.a], bodies[constraint.b]
    if constraint.axis is None:
        # Chipmunk's angle is that of a relative to b, and its torque acts on b.
        return pymunk.DampedRotarySpring(a, b, -joint.sign * slack, stiffness, damping)
    far = HALF_GROOVE * links.extent
    return pymunk.DampedSpring(
        a,
        b,
        body_point(links, constraint.a, constraint.on_a - far * constraint.axis),
        body_point(links, constraint.b, constraint.on_b),
        far + slack,
        stiffness,
        damping,
    )


def _set_force(
    spring: pymunk.DampedRotarySpring | pymunk.DampedSpring,
    joint: LinkJoint,
    links: Links,
    force: Callable[[float], float],
) -> None:
    """Set the force of a spring to a function of its joint's value."""
    if isinstance(spring, pymunk.DampedRotarySpring):
        spring.torque_func = lambda _, angle: joint.sign * force(joint.value - joint.sign * angle)
    else:
        far = HALF_GROOVE * links.extent
        spring.force_func = lambda _, length: force(joint.value + length - far)


def _make_point_spring(
    spring: LinkSpring, links: Links, bodies: list[pymunk.Body]
) -> pymunk.DampedSpring:
    """A spring between points of two links."""
    low, high = spring.slack
    made = pymunk.DampedSpring(
        bodies[spring.a],
        bodies[spring.b],
        body_point(links, spring.a, spring.on_a),
        body_point(links, spring.b, spring.on_b),
        low,
        spring.stiffness,
        spring.damping,
    )
    if high > low:
        made.force_func = lambda _, length: float(spring.push(np.asarray(length)))
    return made


def set_states(space: pymunk.Space, pose: Array, velocity: Array) -> None:
    """Set the state of all bodies from arrays (links + 1, 3); the ground is the last row."""
    buffer = batch.Buffer()  # sets all bodies at once, in half the time of setting attributes
    buffer.set_float_buf(np.hstack([pose, velocity]))
    batch.set_space_bodies(space, STATE_FIELDS, buffer)


thread_buffers = threading.local()


def empty_buffer() -> batch.Buffer:
    """The buffer of this thread, emptied, for reading states in a run.

    It is used again in each run, since pymunk never frees the memory of a buffer.
    """
    if not hasattr(thread_buffers, "buffer"):
        thread_buffers.buffer = batch.Buffer()
    buffer: batch.Buffer = thread_buffers.buffer
    buffer.clear()
    return buffer


def read_states(buffer: batch.Buffer, links: Links) -> tuple[Array, Array]:
    """Poses and velocities (reads, links + 1, 3) of all reads in a buffer.

    Chipmunk lists the static body, to which every mechanism is connected, after the moving bodies.
    """
    states = np.frombuffer(bytes(buffer.float_buf())).reshape(-1, len(links.mass) + 1, 6)
    return states[..., :3], states[..., 3:]


class RestingBodies:
    """All bodies of a space, for steps from standstill; their states are set and read at once.

    The ground is the last body.  The weights are set as forces together with the pose, so the space
    must have no gravity.
    """

    def __init__(self, space: pymunk.Space, links: Links):
        self.space, self.states = space, np.zeros((len(links.mass) + 1, 8))
        self.states[:-1, 6:] = links.weight
        self.given, self.found = batch.Buffer(), batch.Buffer()
        self.given.set_float_buf(self.states)

    def step(self, pose: Array, dt: float) -> Array:
        """The velocity (links + 1, 3) after a step of dt [s] from a pose at standstill."""
        self.states[:, :3] = pose
        batch.set_space_bodies(self.space, STATE_AND_FORCE_FIELDS, self.given)
        self.space.step(dt)
        self.found.clear()
        batch.get_space_bodies(self.space, VELOCITY_FIELDS, self.found)
        return np.frombuffer(self.found.float_buf()).reshape(-1, 3).copy()


class HingeDrive(pymunk.GearJoint):
    """The drive of a hinge: a gear of ratio 1, whose phase is the angle between two links."""

    def __init__(self, joint: LinkJoint, bodies: Sequence[pymunk.Body]):
        super().__init__(bodies[joint.constraint.a], bodies[joint.constraint.b], 0.0, 1.0)
        self.start, self.sign = joint.value, joint.sign
        self.error_bias = 0.0

    def aim(self, value: float) -> None:
        """Set the value [rad] that the joint is to have after the next step."""
        self.phase = self.sign * (value - self.start)


class SlideDrive(pymunk.GrooveJoint):
    """The drive of a slide: a groove at right angles to the slide that is moved along it.

    The groove belongs to the first link and guides the anchor of the second.
    Chipmunk has no linear motor.  The drive has the anchors of the slide's own groove, so that it
    carries only the force along the slide, and that groove only the force across.
    """

    def __init__(self, joint: LinkJoint, links: Links, bodies: Sequence[pymunk.Body]):
        constraint, axis = joint.constraint, joint.constraint.axis
        assert axis is not None
        across = links.extent * np.array([-axis[1], axis[0]])
        self.left, self.right = (
            body_point(links, constraint.a, constraint.on_a + across),
            body_point(links, constraint.a, constraint.on_a - across),
        )
        self.start, self.axis = joint.value, tuple(axis.tolist())
        super().__init__(
            bodies[constraint.a],
            bodies[constraint.b],
            self.left,
            self.right,
            body_point(links, constraint.b, constraint.on_b),
        )
        self.error_bias = 0.0

    def aim(self, value: float) -> None:
        """Set the value [m] that the joint is to have after the next step."""
        move = value - self.start
        dx, dy = move * self.axis[0], move * self.axis[1]
        self.groove_a = (self.left[0] + dx, self.left[1] + dy)
        self.groove_b = (self.right[0] + dx, self.right[1] + dy)


LinkDrive = HingeDrive | SlideDrive


def add_drives(space: pymunk.Space, links: Links) -> list[LinkDrive]:
    """Add the drives of a mechanism, last in the solver's order, where errors are smallest."""
    drives = [make_drive(joint, links, space) for joint in links.drives]
    space.add(*drives)
    return drives


def make_drive(joint: LinkJoint, links: Links, space: pymunk.Space) -> LinkDrive:
    """Make the drive of a joint, without adding it to the space."""
    bodies = [*space.bodies, space.static_body]
    if joint.constraint.axis is None:
        return HingeDrive(joint, bodies)
    return SlideDrive(joint, links, bodies)


def aim_drives(drives: Iterable[LinkDrive], values: Iterable[float]) -> None:
    """Set the values [rad or m] that all drives are to have after the next step."""
    for drive, value in zip(drives, values, strict=True):
        drive.aim(value)


FRICTION_RATE = 1e9
"""Target rate [rad/s] of a friction motor, so large that the motor applies its largest moment."""
FRICTION_DISTANCE = 1e3
"""Distance [extents] to the target of the friction of a slide, so large that it applies its largest
force."""


class HingeFriction(pymunk.SimpleMotor):
    """Dry friction of a hinge: a motor of rate zero whose moment is limited.

    That is all in a motion in time.  The bodies of a sweep are at standstill, so the motor of a
    joint that slips has a rate against the motion instead of zero, and the same limit.
    """

    def __init__(self, joint: LinkJoint, bodies: Sequence[pymunk.Body]):
        super().__init__(bodies[joint.constraint.a], bodies[joint.constraint.b], 0.0)
        self.joint, self.max_force = joint, 0.0

    def slip(self, sense: float, value: float) -> None:
        """Push against a motion of that sense, not at all if it is 0."""
        self.rate = FRICTION_RATE * sense * self.joint.sign
        self.max_force = abs(sense) * self.joint.friction

    def stick(self, value: float) -> None:
        """Hold the joint at its value, as far as it may."""
        self.rate, self.max_force = 0.0, self.joint.friction

    def resist(self) -> None:
        """Resist all motion in time."""
        self.rate, self.max_force = 0.0, self.joint.friction


class SlideFriction(SlideDrive):
    """Dry friction of a slide: a drive with a limited force, since Chipmunk has no linear motor.

    In a motion in time the groove stays where it is and corrects no deviation, with a bias of 1, so
    that it makes the rate along the slide zero.
    """

    def __init__(self, joint: LinkJoint, links: Links, bodies: Sequence[pymunk.Body]):
        super().__init__(joint, links, bodies)
        self.joint, self.far, self.max_force = joint, FRICTION_DISTANCE * links.extent, 0.0

    def slip(self, sense: float, value: float) -> None:
        """Push against a motion of that sense, not at all if it is 0."""
        self.aim(value - sense * self.far)
        self.max_force = abs(sense) * self.joint.friction

    def stick(self, value: float) -> None:
        """Hold the joint at its value, as far as it may."""
        self.aim(value)
        self.max_force = self.joint.friction

    def resist(self) -> None:
        """Resist all motion in time."""
        self.error_bias, self.max_force = 1.0, self.joint.friction


FrictionMotor = HingeFriction | SlideFriction


def make_friction(
    links: Links, joints: Iterable[int], bodies: Sequence[pymunk.Body]
) -> list[FrictionMotor]:
    """Make the motors of dry friction of joints by their ids, without adding them to a space."""
    return [
        HingeFriction(joint, bodies)
        if joint.constraint.axis is None
        else SlideFriction(joint, links, bodies)
        for joint in (links.joints[j] for j in joints)
    ]


def add_friction(space: pymunk.Space, links: Links, joints: Iterable[int]) -> list[FrictionMotor]:
    """Add the motors of dry friction of joints by their ids."""
    found = make_friction(links, joints, [*space.bodies, space.static_body])
    space.add(*found)
    return found
