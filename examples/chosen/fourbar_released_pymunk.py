"""fourbar_released, dynamics: position within 1e-3 of its range.

pymunk, no bias, 3 iterations, timestep 2 ms: 3.1e-4 off in 6.7e-3 s, 1001 steps
as a program that runs by itself: 3.1e-4 off in 2.8e-3 s; 3.1e-4 from a shifted start
the engine's defaults are 0.018 off at best, 0.013 s at timestep 0.526 ms; of order 0.98
they would take 0.52 s, 77 times as long

Made by proofmass choose with pymunk 7.3.1.  It writes the curves of all channels, in SI units:

    python fourbar_released_pymunk.py [curves.csv]
"""

import csv
import sys
import time

import numpy as np
import pymunk
from pymunk import batch

TIMESTEP = 0.002  # [s]
ITERATIONS = 3  # of Chipmunk's solver in a step
FIRST_ITERATIONS = 3000  # of the first step, which has no impulses of another to begin with
ERROR_BIAS = 0.0  # share of a gap that is left after a second; 0: none after the next step
START_TIME, END_TIME = 0.0, 2.0  # [s]
SAMPLES, STEPS_PER_SAMPLE = 201, 5
STEPS = (SAMPLES - 1) * STEPS_PER_SAMPLE + 1

# ---- MODEL -----------------------------------------------------------------------------------

EXTENT = 3.0  # size of the mechanism [m]
space = pymunk.Space()
space.gravity = (0.0, -9.81)  # [m/s2]


def add_body(mass, moment, x, y):
    """Add a body: mass [kg], moment of inertia about its centre [kg m2], centre of mass [m]."""
    body = pymunk.Body(mass, moment)
    body.position = x, y
    space.add(body)
    return body


def add(constraint):
    """Add a constraint; Chipmunk solves them in the order in which they are added."""
    constraint.error_bias = ERROR_BIAS
    space.add(constraint)
    return constraint


# The pose in which the model is described: angles are 0 in it, and points of a body are given from
# its centre of mass, points of the ground from the origin.
crank = add_body(mass=1.0, moment=0.0833333333333333, x=0.5, y=0.0)
coupler = add_body(mass=2.0, moment=0.666666666666667, x=1.21875, y=0.9757809372497497)
rocker = add_body(mass=2.5, moment=1.3020833333333297, x=2.21875, y=0.9757809372497496)
ground = space.static_body
bodies = [crank, coupler, rocker, ground]

# hinge "crank": a pin of ground and crank
add(pymunk.PivotJoint(ground, crank, (0.0, 0.0), (-0.5, 0.0)))
# hinge "coupler": a pin of crank and coupler
add(pymunk.PivotJoint(crank, coupler, (0.5, 0.0), (-0.21875, -0.9757809372497497)))
# hinge "rocker": a pin of ground and rocker
add(pymunk.PivotJoint(ground, rocker, (3.0, 0.0), (0.78125, -0.9757809372497496)))
# loop "pin": a pin of coupler and rocker
add(pymunk.PivotJoint(coupler, rocker, (0.21875, 0.9757809372497497),
    (-0.7812499999999998, 0.9757809372497496)))

pins = [joint for joint in space.constraints if isinstance(joint, pymunk.PivotJoint)]

# ---- START -----------------------------------------------------------------------------------

# Chipmunk moves the bodies with the velocities that it has, and then finds new velocities for the
# next interval.  So this is the state one step before START_TIME: the pose there, and the velocity
# from there to the pose at START_TIME, as if the engine had been running all along.  A start at
# START_TIME itself, with the velocity of that instant, would be wrong by half a step.
# These numbers belong to this TIMESTEP, and not to another.
START = [  # x, y [m], angle [rad]; their rates
    # crank
    ((0.5000000005471109, -8.269705572826307e-06, -1.65394110853264e-05),
     (-2.3936108650701726e-07, 0.004134855606187213, 0.008269711182965397)),
    # coupler
    ((1.2187419310918541, 0.9757662072473561, 8.270362630953752e-06),
     (0.0040344888817545055, 0.007365031885753215, -0.004135143069394851)),
    # rocker
    ((2.218741930544743, 0.9757744769529287, 8.269521595640235e-06),
     (0.0040347282428410125, 0.003230176279678254, -0.004134775116315989)),
]
for body, ((x, y, angle), (vx, vy, turning)) in zip(bodies, START):
    body.position, body.angle = (x, y), angle
    body.velocity, body.angular_velocity = (vx, vy), turning

# ---- STEPS -----------------------------------------------------------------------------------

FIELDS = (batch.BodyFields.POSITION | batch.BodyFields.ANGLE
          | batch.BodyFields.VELOCITY | batch.BodyFields.ANGULAR_VELOCITY)


def run():
    """Step through the run.

    Returns the states of all bodies at each sample, those one step before each sample but the
    first, and the wall time [s].
    """
    at, before = batch.Buffer(), batch.Buffer()
    space.iterations = FIRST_ITERATIONS
    began = time.perf_counter()
    for k in range(STEPS):
        space.step(TIMESTEP)
        if k == 0:
            space.iterations = ITERATIONS
        if k % STEPS_PER_SAMPLE == 0:
            batch.get_space_bodies(space, FIELDS, at)
        if (k + 1) % STEPS_PER_SAMPLE == 0:
            batch.get_space_bodies(space, FIELDS, before)
    seconds = time.perf_counter() - began
    return read(at), read(before)[:SAMPLES - 1], seconds


def read(buffer):
    """States in a buffer (reads, bodies, 6); Chipmunk lists the ground after the moving bodies."""
    return np.frombuffer(bytes(buffer.float_buf())).reshape(-1, len(bodies), 6)


# ---- RECORDING -------------------------------------------------------------------------------

# Functions of poses (..., bodies, 3): x, y and angle of every body.


def angle(pose, body):
    """Angle of a body [rad]."""
    return pose[..., bodies.index(body), 2]


def direction(pose, body, x, y):
    """Components in the plane of a vector that is fixed in a body."""
    c, s = np.cos(angle(pose, body)), np.sin(angle(pose, body))
    return c * x - s * y, s * x + c * y


def point(pose, body, x, y):
    """Place of a point of a body [m], given from its centre."""
    dx, dy = direction(pose, body, x, y)
    k = bodies.index(body)
    return pose[..., k, 0] + dx, pose[..., k, 1] + dy


def along(function, pose, velocity):
    """Derivative of a function of the pose by time, by a complex step: exact to rounding."""
    return np.imag(function(pose + 1e-30j * velocity)) / 1e-30


def unwrapped(curve):
    """An angle shifted by whole turns so that it starts within (-pi, pi]."""
    return curve - 2 * np.pi * np.ceil(curve[0] / (2 * np.pi) - 0.5)


def curves(pose, before, after):
    """Curves of all channels, from the poses at the samples and the velocities around them.

    Chipmunk's velocity belongs to the interval between two poses.  So a rate is the mean of those
    half a step before and half a step after the sample, and an acceleration is their difference
    over the step.
    """
    def early(function):
        return along(function, pose - 0.5 * TIMESTEP * before, before)

    def late(function):
        return along(function, pose + 0.5 * TIMESTEP * after, after)

    def value(function):
        return function(pose)

    def rate(function):
        return 0.5 * (early(function) + late(function))

    def acceleration(function):
        return (late(function) - early(function)) / TIMESTEP

    return {
        'rocker': value(lambda pose: 2.2459278597319283 + angle(pose, rocker)),
        'coupler.angle': unwrapped(value(lambda pose: 1.3502630658740633 + angle(pose, coupler))),
        'pin.x': value(lambda pose: point(pose, rocker, -0.7812499999999998, 0.9757809372497496)[0]),
        'pin.y': value(lambda pose: point(pose, rocker, -0.7812499999999998, 0.9757809372497496)[1]),
        'rocker_rate': rate(lambda pose: 2.2459278597319283 + angle(pose, rocker)),
        'pin_velocity.x': rate(lambda pose: point(pose, rocker, -0.7812499999999998,
            0.9757809372497496)[0]),
        'pin_velocity.y': rate(lambda pose: point(pose, rocker, -0.7812499999999998,
            0.9757809372497496)[1]),
        'rocker_acceleration.z': acceleration(lambda pose: angle(pose, rocker)),
    }


def gaps(pose):
    """Largest distance [m] at each sample between points that a joint holds together."""
    widest = np.zeros(len(pose))
    for pin in pins:
        (ax, ay), (bx, by) = point(pose, pin.a, *pin.anchor_a), point(pose, pin.b, *pin.anchor_b)
        widest = np.maximum(widest, np.hypot(bx - ax, by - ay))
    return widest


def main(file="curves.csv"):
    """Run, check that nothing failed, write all curves to a CSV file."""
    at, earlier, seconds = run()
    t = np.linspace(START_TIME, END_TIME, SAMPLES)
    first = [[velocity for _, velocity in START] + [(0.0, 0.0, 0.0)]]
    pose, after = at[..., :3], at[..., 3:]
    before = np.concatenate([first, earlier[..., 3:]])
    with np.errstate(all="ignore"):
        gap = gaps(pose)
        failed = ~(np.isfinite(pose).all(axis=(1, 2)) & (gap <= 0.1 * EXTENT))
        if failed.any():
            k = int(np.argmax(failed))
            sys.exit(f"failed at time {t[k]:.4g} s: the loops are open by {gap[k]:.3g} m")
        found = curves(pose, before, after)
    for name, curve in found.items():
        if not np.isfinite(curve).all():
            sys.exit(f"{name} is not finite at time {t[np.argmin(np.isfinite(curve))]:.4g} s")
    with open(file, "w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(["t", *found])
        writer.writerows(zip(t.tolist(), *(curve.tolist() for curve in found.values())))
    print(f"{STEPS} steps in {seconds:.6g} s; curves in {file}")


if __name__ == "__main__":
    main(*sys.argv[1:2])
