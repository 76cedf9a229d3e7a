"""Dampers in time: of second order, by the mean of the velocities before and after a step.

Chipmunk multiplies the relative velocity w of the two bodies of a damper by ``exp(-c h/m)`` in each
iteration of its solver, with their reduced mass m.  Where other constraints act on the bodies as
well, all iterations of a step together have the impulse::

    p = -m (exp(c h/m) - 1) w_after

so that the damper is of first order, and stronger than it should be.  With another coefficient and
a force that is known before the step, the impulse is that of the midpoint rule, which is of second
order in any mechanism::

    c' = m/h ln(1 + c h/(2 m)):    p = -c h/2 w_after
    a force before the step:       p = -c h/2 w_before

Bodies move before the forces of a step act.  A damper along a line therefore takes line, velocity
and reduced mass at the pose to which the bodies will have moved.
"""

from collections.abc import Callable
from math import cos, hypot, inf, log1p, sin

import pymunk

Damped = pymunk.DampedRotarySpring | pymunk.DampedSpring


def midpoint_dampers(space: pymunk.Space, dt: float) -> list[Callable[[], None]]:
    """Make the dampers of a space those of the midpoint rule for steps of `dt` [s].

    Returns functions that have to be called before each step.
    """
    damped = [one for one in space.constraints if isinstance(one, Damped) and one.damping]
    return [
        *(midpoint_turn(one, dt) for one in damped if isinstance(one, pymunk.DampedRotarySpring)),
        *(midpoint_line(one, dt) for one in damped if isinstance(one, pymunk.DampedSpring)),
    ]


def midpoint_turn(damper: pymunk.DampedRotarySpring, dt: float) -> Callable[[], None]:
    """A damper of a relative rotation; its reduced moment of inertia is that of every pose."""
    a, b, half = damper.a, damper.b, 0.5 * damper.damping
    inertia = 1.0 / (1.0 / a.moment + 1.0 / b.moment)
    damper.damping, ground = inertia / dt * log1p(half * dt / inertia), static_body(damper)

    def act() -> None:
        torque = half * (b.angular_velocity - a.angular_velocity)
        b.torque -= torque
        if a is not ground:
            a.torque += torque

    return act


def midpoint_line(damper: pymunk.DampedSpring, dt: float) -> Callable[[], None]:
    """A damper of a distance between two points."""
    a, b, half = damper.a, damper.b, 0.5 * damper.damping
    on_a, on_b = damper.anchor_a, damper.anchor_b
    by_force, turn_a, turn_b = 1.0 / a.mass + 1.0 / b.mass, 1.0 / a.moment, 1.0 / b.moment
    ground = static_body(damper)

    def act() -> None:
        xa, ya, pa, qa, ua, va = moved_point(a, on_a, dt)
        xb, yb, pb, qb, ub, vb = moved_point(b, on_b, dt)
        x, y = xb - xa, yb - ya
        length = hypot(x, y)
        x, y = x / length, y / length
        arm_a, arm_b = pa * y - qa * x, pb * y - qb * x
        compliance = by_force + turn_a * arm_a**2 + turn_b * arm_b**2
        damper.damping = log1p(half * dt * compliance) / (dt * compliance)
        force = half * ((ub - ua) * x + (vb - va) * y)
        if b is not ground:
            push(b, -force * x, -force * y, -force * arm_b)
        if a is not ground:
            push(a, force * x, force * y, force * arm_a)

    return act


def static_body(damper: Damped) -> pymunk.Body | None:
    """The one of two bodies that forces do not move."""
    return next((body for body in (damper.a, damper.b) if body.moment == inf), None)


def push(body: pymunk.Body, x: float, y: float, moment: float) -> None:
    """Add a force [N] and a moment [N m] to those of the next step."""
    before = body.force
    body.force = before.x + x, before.y + y
    body.torque += moment


def moved_point(
    body: pymunk.Body, local: pymunk.Vec2d, dt: float
) -> tuple[float, float, float, float, float, float]:
    """Place [m], arm from the centre [m] and velocity [m/s] of a point after the next move."""
    rate, (vx, vy), (x, y), (u, v) = body.angular_velocity, body.velocity, body.position, local
    angle = body.angle + dt * rate
    c, s = cos(angle), sin(angle)
    p, q = c * u - s * v, s * u + c * v
    return x + dt * vx + p, y + dt * vy + q, p, q, vx - rate * q, vy + rate * p
