"""A pymunk space built from links, and reading all its bodies at once."""

import math
from typing import Any

import numpy as np
import pymunk
from pymunk import batch

from sim.protocol import Array
from sim.pymunk_links import Hold, Joint, Links

Settings = dict[str, Any]
"""timestep [s], iterations, error_bias."""
FIELDS = (batch.BodyFields.POSITION | batch.BodyFields.ANGLE
          | batch.BodyFields.VELOCITY | batch.BodyFields.ANGULAR_VELOCITY)
REACH = 100.0
"""Half length of a groove, in extents of the mechanism."""


def build(links: Links, iterations: int, error_bias: float) -> pymunk.Space:
    """Build the space: a body for each link, in order, a constraint for each hold and spring.

    Parameters
    ----------
    links : Links
    iterations : int
        Sweeps of the engine's solver over the constraints in a step.
    error_bias : float
        Share of a gap that is left after a second; 0 closes it in the next step.

    Returns
    -------
    pymunk.Space
        At rest in the start pose, without a motor.
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
    bodies.append(space.static_body)
    held = []
    for joint in links.joints:
        held += [*_spring(joint, links, bodies), *_hold(joint.hold, links, bodies, joint)]
    for loop in links.loops:
        held += _hold(loop, links, bodies)
    for constraint in held:
        # a stop that threw a joint out of it in one step would make it bounce
        if not isinstance(constraint, pymunk.RotaryLimitJoint | pymunk.SlideJoint):
            constraint.error_bias = error_bias
        space.add(constraint)
    return space


def _at(links: Links, link: int, local: Array) -> tuple[float, float]:
    """An anchor in the body's own coordinates; the static body's are the world's."""
    return tuple(local + (links.centre[link] if link == len(links.mass) else 0.0))


def _hold(hold: Hold, links: Links, bodies: list[pymunk.Body],
          joint: Joint | None = None) -> list[pymunk.Constraint]:
    a, b = bodies[hold.a], bodies[hold.b]
    limits = tuple(e - joint.value for e in joint.limits) if joint and joint.limits else None
    if hold.axis is None:
        pin = pymunk.PivotJoint(a, b, _at(links, hold.a, hold.on_a), _at(links, hold.b, hold.on_b))
        if joint is None or limits is None:
            return [pin]
        low, high = sorted(joint.sign * limit for limit in limits)
        return [pymunk.RotaryLimitJoint(a, b, low, high), pin]
    reach = REACH * links.extent
    stops: list[pymunk.Constraint] = []
    if limits:
        low, high = (reach + limit for limit in limits)
        stops = [pymunk.SlideJoint(a, b, _at(links, hold.a, hold.on_a - reach * hold.axis),
                                   _at(links, hold.b, hold.on_b), low, high)]
    start, end = (_at(links, hold.a, hold.on_a + s * hold.axis) for s in (-reach, reach))
    # The groove's own solve is only right if neither anchor couples sliding with turning; the
    # anchors of sim.pymunk_links are chosen so.  A RotaryLimitJoint would lock one side a step.
    return [*stops, pymunk.GearJoint(a, b, 0.0, 1.0),
            pymunk.GrooveJoint(a, b, start, end, _at(links, hold.b, hold.on_b))]


def _spring(joint: Joint, links: Links, bodies: list[pymunk.Body]) -> list[pymunk.Constraint]:
    if joint.stiffness == 0 and joint.damping == 0:
        return []
    hold = joint.hold
    a, b = bodies[hold.a], bodies[hold.b]
    rest = joint.rest - joint.value
    if hold.axis is None:
        # Chipmunk's rest angle is that of a against b.
        return [pymunk.DampedRotarySpring(a, b, -joint.sign * rest, joint.stiffness, joint.damping)]
    far = REACH * links.extent
    return [pymunk.DampedSpring(a, b, _at(links, hold.a, hold.on_a - far * hold.axis),
                                _at(links, hold.b, hold.on_b), far + rest,
                                joint.stiffness, joint.damping)]


class Carriage:
    """The ideal drive of a slide on the ground, with the `rate` of a motor [m/s].

    Chipmunk has no linear motor.  A pin to a body outside the space, which has a velocity and
    never moves, is one if it may not close its gap: an error bias of 1.
    """

    def __init__(self, space: pymunk.Space, links: Links, joint: Joint, body: pymunk.Body):
        assert joint.hold.axis is not None
        self.axis: Array = joint.hold.axis
        self.body = pymunk.Body(body_type=pymunk.Body.KINEMATIC)
        pin = pymunk.PivotJoint(body, self.body, _at(links, joint.hold.b, joint.hold.on_b), (0, 0))
        pin.error_bias = 1.0
        space.add(pin)

    @property
    def rate(self) -> float:
        """Speed along the slide's axis [m/s]."""
        return float(np.dot(self.axis, self.body.velocity))

    @rate.setter
    def rate(self, rate: float) -> None:
        self.body.velocity = tuple(rate * self.axis)


Motor = pymunk.SimpleMotor | Carriage


def add_motor(space: pymunk.Space, links: Links, joint: Joint) -> Motor:
    """Add the ideal drive of a joint, last in the solver's order, so that it is met exactly."""
    bodies = [*space.bodies, space.static_body]
    if joint.hold.axis is not None:
        return Carriage(space, links, joint, bodies[joint.hold.b])
    # rate is that of the first body against the second
    motor = pymunk.SimpleMotor(bodies[joint.hold.b], bodies[joint.hold.a], 0.0)
    motor.max_force = math.inf
    space.add(motor)
    return motor


def put(space: pymunk.Space, pose: Array, velocity: Array) -> None:
    """Set the state of all bodies from arrays (links + 1, 3); the ground is the last row."""
    for body, p, v in zip(space.bodies, pose.tolist(), velocity.tolist(), strict=False):
        body.position, body.angle = (p[0], p[1]), p[2]
        body.velocity, body.angular_velocity = (v[0], v[1]), v[2]


def taken(buffer: batch.Buffer, links: Links) -> tuple[Array, Array]:
    """Poses and velocities (reads, links + 1, 3) of all reads in a buffer.

    Chipmunk lists the static body, to which every mechanism is jointed, after the moving ones.
    """
    states = np.frombuffer(bytes(buffer.float_buf())).reshape(-1, len(links.mass) + 1, 6)
    return states[..., :3], states[..., 3:]
