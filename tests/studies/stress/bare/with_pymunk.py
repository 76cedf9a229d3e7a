"""Limits of Chipmunk, measured with pymunk and NumPy alone; see `with_mujoco.py`.

    python -I tests/studies/stress/bare/with_pymunk.py                     # all of them, as JSON
    python -I tests/studies/stress/bare/with_pymunk.py "pendulum, step"    # one

All mechanisms are built here.  Chipmunk moves positions with the velocity of the previous step, so
each run begins one step before its start, with the velocity that leads to the start pose.  Pins
remove their constraint violation in one step (`error_bias` 0), with enough iterations for that.
"""

import cmath
import json
import math
import sys
from functools import cache, partial

import numpy as np
import pymunk

LIMIT_TOLERANCE = 2e-3  # relative width at which a bisection ends
LARGEST_ERROR = 0.1
GRAVITY = 9.81
ITERATIONS = 3000


def find_limit(failed, low, high):
    """The first value that fails: in strides of a quarter from `low` on, then by bisection."""
    stride = 1.25 if high > low else 0.8
    assert not failed(low)
    while not failed(low * stride):
        low *= stride
        assert (low < high) is (stride > 1), "not failed at all"
    high = low * stride
    while max(high / low, low / high) > 1 + LIMIT_TOLERANCE:
        middle = math.sqrt(low * high)
        low, high = (low, middle) if failed(middle) else (middle, high)
    return math.sqrt(low * high)


def relative_error(found, reference):
    """Largest error of some curves (n, curves), as a share of the range of the reference curve."""
    if not np.isfinite(found).all():
        return math.inf
    return float((np.abs(found - reference).max(axis=0) / np.ptp(reference, axis=0)).max())


def advance(y, step, rate):
    """A state after a step with a constant rate."""
    return [p + step * q for p, q in zip(y, rate, strict=True)]


def integrate(slope, y, step, count):
    """States (count + 1, len(y)) by the Runge-Kutta method of order 4."""
    rows = [y]
    for _ in range(count):
        a = slope(y)
        b = slope(advance(y, 0.5 * step, a))
        c = slope(advance(y, 0.5 * step, b))
        d = slope(advance(y, step, c))
        y = [
            p + step / 6 * (q + 2 * r + 2 * s + t)
            for p, q, r, s, t in zip(y, a, b, c, d, strict=True)
        ]
        rows.append(y)
    return np.array(rows)


def space_of(gravity, iterations=ITERATIONS):
    """A pymunk space without bodies, with gravity downwards."""
    space = pymunk.Space()
    space.gravity = 0.0, -gravity
    space.iterations = iterations
    return space


def add_pin(space, one, other, at):
    """Add a pin between two bodies at a point of the world where both are now."""
    pin = pymunk.PivotJoint(one, other, at)
    pin.error_bias = 0.0
    space.add(pin)


def start_one_step_early(body, before, after, step):
    """Set a body to its pose one step before the start, with the velocity to the start pose.

    Both poses are a position (complex) and an angle.
    """
    (place, angle), (place_after, angle_after) = before, after
    way = (place_after - place) / step
    body.position, body.angle = (place.real, place.imag), angle
    body.velocity, body.angular_velocity = (way.real, way.imag), (angle_after - angle) / step


# -- a pendulum: a point mass on a rod of 1 m, released from its horizontal pose


def pendulum_angle(x, speed):
    """Angle of a pendulum at times x, by Jacobi's elliptic functions.

    sin(angle / 2) = -k cd(w t, k) with k = sin(pi / 4); cd by descending Landen steps.
    """
    moduli = [math.sqrt(0.5)]
    while moduli[-1] > 1e-9:
        rest = math.sqrt(1 - moduli[-1] ** 2)
        moduli.append((1 - rest) / (1 + rest))
    quarter = math.pi / 2 * np.prod([1 + k for k in moduli[1:]])
    u = speed * np.asarray(x) + quarter  # cd(u) = sn(u + K)
    s = np.sin(u / np.prod([1 + k for k in moduli[1:]]))
    for k in reversed(moduli[1:]):
        s = (1 + k) * s / (1 + k * s**2)
    return -2 * np.arcsin(math.sqrt(0.5) * s)


POINT_MASS = 1.0, 1.0, 1e-14
EQUIVALENT_BODY = 2.0, 0.5, 0.5
"""Mass, distance of its centre from the pin, and moment of inertia about its centre: of a point
mass, and of a body with the same motion, since its moment of inertia about the pin and its mass
times distance are the same.  Chipmunk's errors differ, since the centre of a body moves along a
straight line in a step, and is nearer to the pin here.  proofmass builds the second body for a link
on the ground that is nearly a point mass."""


def hanging_pose(angle, distance=1.0):
    """Position of the centre (complex) and rotation of a body that hangs at an angle."""
    return cmath.rect(distance, angle - math.pi / 2), angle


def pendulum_angles(step, steps, gravity, before, stiffness=0.0, built=EQUIVALENT_BODY):
    """Angles after each step, from the angle `before` one step before the start.

    A pin alone is solved in one iteration, a pin and a spring are not.
    """
    space = space_of(gravity, ITERATIONS if stiffness else 10)
    mass, distance, moment = built
    body = pymunk.Body(mass, moment)
    space.add(body)
    start = hanging_pose(-math.pi / 2, distance)
    body.position, body.angle = (start[0].real, start[0].imag), start[1]
    add_pin(space, space.static_body, body, (0.0, 0.0))
    if stiffness:
        space.add(pymunk.DampedRotarySpring(space.static_body, body, 0.0, stiffness, 0.0))
    start_one_step_early(body, hanging_pose(before, distance), start, step)
    rows = []
    for _ in range(steps + 1):
        space.step(step)
        rows.append(body.angle)
    assert math.isclose(space.current_time_step, step, rel_tol=1e-12)  # the step that was taken
    return np.array(rows)[:, None]


def pendulum_failed(step, gravity=1.0, seconds=10.0, built=EQUIVALENT_BODY):
    """Whether the error of the pendulum's angle is more than a tenth of its range."""
    steps, speed = round(seconds / step), math.sqrt(GRAVITY * gravity)
    wanted = pendulum_angle(step * np.arange(-1, steps + 1), speed)
    found = pendulum_angles(step, steps, GRAVITY * gravity, float(wanted[0]), built=built)
    return relative_error(found, wanted[1:, None]) > LARGEST_ERROR


def pendulum_step(built=EQUIVALENT_BODY):
    """Largest time step [s]."""
    return find_limit(lambda step: pendulum_failed(step, built=built), 0.01, 1.0)


def pendulum_gravity():
    """Largest factor on gravity, with steps of 1 ms."""
    return find_limit(lambda gravity: pendulum_failed(1e-3, gravity), 20.0, 1e4)


def pendulum_spring(seconds=0.1, step=1e-3):
    """Stiffest spring in the pivot [N m/rad], in a run of 0.1 s with steps of 1 ms."""

    def failed(stiffness):
        steps, fine_steps = (
            round(seconds / step),
            40,
        )  # steps of the reference in one step that is tried
        reference = integrate(
            lambda y: (y[1], -GRAVITY * math.sin(y[0]) - stiffness * y[0]),
            [-math.pi / 2, 0.0],
            step / fine_steps,
            fine_steps * steps,
        )[::fine_steps, 0]
        # released at rest: the angle is an even function of time
        found = pendulum_angles(step, steps, GRAVITY, float(reference[1]), stiffness)
        return relative_error(found, reference[:, None]) > LARGEST_ERROR

    return find_limit(failed, 1e4, 1e6)


# -- a four-bar: crank 1, coupler 2, rocker 2.5, ground 3 m; 1 kg/m


BAR_LENGTHS = 1.0, 2.0, 2.5, 3.0


def coupler_and_rocker(crank):
    """Angles of coupler and rocker in the open assembly mode."""
    a, b, c, ground = BAR_LENGTHS
    pin = cmath.rect(a, crank)
    diagonal = ground - pin
    angle = cmath.phase(diagonal) + math.acos(
        (b**2 + abs(diagonal) ** 2 - c**2) / (2 * b * abs(diagonal))
    )
    return angle, cmath.phase(pin + cmath.rect(b, angle) - ground)


def energies(crank):
    """Generalized inertia about the crank [kg m2] and potential energy [J] of a pose."""
    a, b, c, _ = BAR_LENGTHS
    beta, gamma = coupler_and_rocker(crank)
    # a i e^(ia) + b i e^(ib) b' = c i e^(ic) c'
    beta_rate = a * math.sin(crank - gamma) / (b * math.sin(gamma - beta))
    gamma_rate = a * math.sin(crank - beta) / (c * math.sin(gamma - beta))
    middle = cmath.rect(a, crank) * 1j + cmath.rect(b / 2, beta) * 1j * beta_rate
    inertia = a**3 / 3 + b * abs(middle) ** 2 + b**3 / 12 * beta_rate**2 + c**3 / 3 * gamma_rate**2
    height = (
        a * a / 2 * math.sin(crank)
        + b * (a * math.sin(crank) + b / 2 * math.sin(beta))
        + c * c / 2 * math.sin(gamma)
    )
    return inertia, GRAVITY * height


def slope(y):
    """Rates of crank angle and speed by Lagrange's equation, with differences of the energies."""
    crank, rate = y
    h = 1e-5
    (more, up), (less, down) = energies(crank + h), energies(crank - h)
    return rate, -(0.5 * (more - less) * rate**2 + up - down) / (2 * h) / energies(crank)[0]


FINE_STEP = 2.5e-4  # [s]


@cache
def released_crank():
    """Angle and speed of the crank, released at rest, at times FINE apart."""
    return integrate(slope, [0.0, 0.0], FINE_STEP, round(2.3 / FINE_STEP))


def crank_at(x):
    """Angle of the released crank at some times, by cubic interpolation."""
    place, rate = released_crank().T
    k = np.minimum((np.asarray(x) / FINE_STEP).astype(int), len(place) - 2)
    s = x / FINE_STEP - k
    return (
        place[k] * (1 + 2 * s) * (1 - s) ** 2
        + FINE_STEP * rate[k] * s * (1 - s) ** 2
        + place[k + 1] * s**2 * (3 - 2 * s)
        + FINE_STEP * rate[k + 1] * s**2 * (s - 1)
    )


def centre_poses(crank):
    """Positions of the centres (complex) and angles of crank, coupler and rocker."""
    beta, gamma = coupler_and_rocker(crank)
    return (
        (cmath.rect(0.5, crank), crank),
        (cmath.rect(1.0, crank) + cmath.rect(1.0, beta), beta),
        (3.0 + cmath.rect(1.25, gamma), gamma),
    )


def fourbar_step(seconds=2.0):
    """Largest time step [s] of a four-bar that is released at rest."""

    def failed(step):
        steps, space = round(seconds / step), space_of(GRAVITY)
        bodies = [pymunk.Body(m, m**3 / 12) for m in BAR_LENGTHS[:3]]  # 1 kg/m
        space.add(*bodies)
        crank, coupler, rocker = bodies
        # the angle of the crank is an even function of time
        start, before = centre_poses(0.0), centre_poses(float(crank_at(np.array([step]))[0]))
        for body, (place, angle) in zip(bodies, start, strict=True):
            body.position, body.angle = (place.real, place.imag), angle
        pin = cmath.rect(2.5, start[2][1]) + 3.0
        for one, other, at in (
            (space.static_body, crank, 0j),
            (crank, coupler, 1 + 0j),
            (space.static_body, rocker, 3 + 0j),
            (coupler, rocker, pin),
        ):
            add_pin(space, one, other, (at.real, at.imag))
        for body, here, there in zip(bodies, before, start, strict=True):
            start_one_step_early(body, here, there, step)
        rows = []
        for _ in range(steps + 1):
            space.step(step)
            end = rocker.local_to_world((1.25, 0.0))
            gap = abs(end - coupler.local_to_world((1.0, 0.0)))
            rows.append((rocker.angle, coupler.angle, end.x, end.y, gap))
        rows = np.array(rows)
        if not np.isfinite(rows).all() or rows[:, 4].max() > LARGEST_ERROR * 3.0:
            return True
        pairs = np.array([coupler_and_rocker(a) for a in crank_at(step * np.arange(steps + 1))])
        beta, gamma = np.unwrap(pairs, axis=0).T
        wanted = np.column_stack([gamma, beta, 3 + 2.5 * np.cos(gamma), 2.5 * np.sin(gamma)])
        return relative_error(rows[:, :4], wanted) > LARGEST_ERROR

    return find_limit(failed, 4e-3, 1.0)


# -- springs that are displaced by a thousandth at the start


def grows(space, body, step, steps=3000, bound=1.0):
    """Whether the angle or the displacement of a body is large after many steps."""
    began, largest = body.position.x, 0.0
    for k in range(steps):
        space.step(step)
        value = max(abs(body.angle), abs(body.position.x - began))
        if not value < 1e6:
            return True
        largest = max(largest, value) if k > 0.75 * steps else 0.0
    return largest > bound


def spring_step(zeta, high=50.0):
    """Largest dt omega of a wheel on a spring and a damper."""

    def failed(z):
        # a spring without a pin is solved in one iteration
        space, body = space_of(0.0, iterations=1), pymunk.Body(1.0, 1.0)
        body.angle = 1e-3
        space.add(body, pymunk.DampedRotarySpring(space.static_body, body, 0.0, 1.0, 2 * zeta))
        return grows(space, body, z)

    if zeta > 0.25:
        return math.inf if not any(map(failed, np.geomspace(0.3, high, 12).tolist())) else math.nan
    return find_limit(failed, 0.3, high)


def row_step(masses=5):
    """Largest dt sqrt(k/m) of masses in a row on springs."""

    def failed(z):
        space = space_of(0.0)
        last = space.static_body
        for k in range(masses):
            body = pymunk.Body(1.0, 1.0)
            body.position = k + 1.0 + (1e-3 if k == masses - 1 else 0.0), 0.0
            space.add(body, pymunk.DampedSpring(last, body, (0, 0), (0, 0), 1.0, 1.0, 0.0))
            last = body
        # the bound is well below 1 m, at which springs turn over
        return grows(space, last, z, steps=1000, bound=0.1)

    return find_limit(failed, 0.1, 10.0)


def hung_gravity():
    """Largest gravity dt2 / L of a hanging point mass."""

    def failed(gravity):
        space, body = space_of(gravity), pymunk.Body(1.0, 1e-12)
        place, body.angle = hanging_pose(1e-6)
        body.position = place.real, place.imag
        space.add(body)
        add_pin(space, space.static_body, body, (0.0, 0.0))
        return grows(space, body, 1.0, bound=1e-3)

    return find_limit(failed, 0.5, 50.0)


LIMITS = {
    "pendulum, step": pendulum_step,
    "pendulum, gravity": pendulum_gravity,
    "pendulum as a point mass, step": partial(pendulum_step, POINT_MASS),
    "pendulum, spring": pendulum_spring,
    "fourbar_released, step": fourbar_step,
    "spring, ζ = 0": partial(spring_step, 0.0),
    "spring, ζ = 0.1": partial(spring_step, 0.1),
    "spring, ζ = 0.3": partial(spring_step, 0.3),
    "row of 5 masses": row_step,
    "hung pendulum": hung_gravity,
}


if __name__ == "__main__":
    print(json.dumps({name: LIMITS[name]() for name in sys.argv[1:] or LIMITS}))
