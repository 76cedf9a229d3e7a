"""slider_crank, dynamics: position within 1e-4 of its range.

pymunk, no bias, 30 iterations, timestep 5.82 ms: 1.3e-5 off in 0.026 s, 1081 steps
as a program that runs by itself, its drive moved by a gear: 1.3e-5 off in 0.026 s; 1.3e-5
from a shifted start
its drive moved by a motor instead: 1.3e-5 off in 0.026 s
2.5 times cheaper than the engine's defaults refined to the same error, 0.063 s at timestep
0.698 ms

Made by proofmass choose with pymunk 7.3.1.  It writes the curves of all channels, in SI units:

    python slider_crank_pymunk.py [curves.csv]
"""

import csv
import sys
import time

import numpy as np
import pymunk
from pymunk import batch

TIMESTEP = 0.005817764173314432  # [s]
ITERATIONS = 30  # of Chipmunk's solver in a step
FIRST_ITERATIONS = 3000  # of the first step, which has no impulses of another to begin with
ERROR_BIAS = 0.0  # share of a gap that is left after a second; 0: none after the next step
START_TIME, END_TIME = 0.0, 6.283185307179586  # [s]
SAMPLES, STEPS_PER_SAMPLE = 361, 3
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
coupler = add_body(mass=2.0, moment=0.666666666666667, x=2.0, y=0.0)
slider = add_body(mass=1.5, moment=0.01, x=3.0, y=0.0)
ground = space.static_body
bodies = [crank, coupler, slider, ground]

# hinge "crank": a pin of ground and crank
add(pymunk.PivotJoint(ground, crank, (0.0, 0.0), (-0.5, 0.0)))
# hinge "coupler": a pin of crank and coupler
add(pymunk.PivotJoint(crank, coupler, (0.5, 0.0), (-1.0, 0.0)))
# slide "slider": slider moves along a line of ground, 100 EXTENT each way, and does not turn
add(pymunk.GearJoint(ground, slider, 0.0, 1.0))
add(pymunk.GrooveJoint(ground, slider, (-297.0, 0.0), (303.0, 0.0), (0.0, 0.0)))
# loop "pin": a pin of coupler and slider
add(pymunk.PivotJoint(coupler, slider, (1.0, 0.0), (0.0, 0.0)))

pins = [joint for joint in space.constraints if isinstance(joint, pymunk.PivotJoint)]
slides = [joint for joint in space.constraints if isinstance(joint, pymunk.GrooveJoint)]

# ---- DRIVES ----------------------------------------------------------------------------------


def motion(t):
    """Values, rates and accelerations (drives, n) of the drives at times (n,) [s]."""
    one = np.ones_like(t)
    return (
        np.array([0.0 + 1.0 * t]),
        np.array([1.0 * one]),
        np.array([0.0 * one]))


def aim(values):
    """Let the driven joints have these values [rad or m] after the next step."""
    # hinge "crank", by a gear of ratio 1 whose phase is moved
    drives[0].phase = values[0]


# Last in the order, where constraints are met best.
drives = [
    pymunk.GearJoint(ground, crank, 0.0, 1.0),
]
for drive in drives:
    drive.error_bias = 0.0
    space.add(drive)

# Values after each step.  The one after the end follows from the acceleration there.
values, _, accelerations = motion(START_TIME + TIMESTEP * np.arange(STEPS))
after_end = 2 * values[:, -1] - values[:, -2] + TIMESTEP**2 * accelerations[:, -1]
targets = [*values.T[1:].tolist(), after_end.tolist()]

# ---- START -----------------------------------------------------------------------------------

# Chipmunk moves the bodies with the velocities that it has, and then finds new velocities for the
# next interval.  So this is the state one step before START_TIME: the pose there, and the velocity
# from there to the pose at START_TIME, as if the engine had been running all along.  A start at
# START_TIME itself, with the velocity of that instant, would be wrong by half a step.
# These numbers belong to this TIMESTEP and this motion, and not to another.
START = [  # x, y [m], angle [rad]; their rates
    # crank
    ((0.4999999996181443, -0.002908947722076558, -0.005817764173314432),
     (0.0014544943726229932, 0.5000056408533081, 1.0)),
    # coupler
    ((1.999999999045361, -0.0029089477220765585, 0.0029089313131800687),
     (0.0036362405465216524, 0.5000056408533082, -0.5000042306364012)),
    # slider
    ((2.9999999988544337, -1.6166432747536821e-31, -1.5220594728034684e-34),
     (0.004363492347778235, -8.936401158399176e-29, 2.6170420433117057e-32)),
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
        aim(targets[k])
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


def slid(pose, a, b, on_a, on_b, axis):
    """How far a point of b is from a point of a [m], along an axis of a."""
    (ax, ay), (bx, by) = point(pose, a, *on_a), point(pose, b, *on_b)
    x, y = direction(pose, a, *axis)
    return x * (bx - ax) + y * (by - ay)


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
        'coupler.angle': unwrapped(value(lambda pose: angle(pose, coupler))),
        'slide': value(lambda pose: 1.0 + slid(pose, ground, slider, (3.0, 0.0), (0.0, 0.0),
            (1.0, 0.0))),
        'slider.x': value(lambda pose: point(pose, slider, 0.0, 0.0)[0]),
        'coupler_rate.z': rate(lambda pose: angle(pose, coupler)),
        'slide_rate': rate(lambda pose: 1.0 + slid(pose, ground, slider, (3.0, 0.0), (0.0, 0.0),
            (1.0, 0.0))),
        'slider_velocity.x': rate(lambda pose: point(pose, slider, 0.0, 0.0)[0]),
        'coupler_acceleration.z': acceleration(lambda pose: angle(pose, coupler)),
        'slide_acceleration': acceleration(lambda pose: 1.0 + slid(pose, ground, slider, (3.0, 0.0),
            (0.0, 0.0), (1.0, 0.0))),
        'slider_acceleration.x': acceleration(lambda pose: point(pose, slider, 0.0, 0.0)[0]),
        'crank drive': value(lambda pose: angle(pose, crank)),
        'crank drive rate': rate(lambda pose: angle(pose, crank)),
        'crank drive acceleration': acceleration(lambda pose: angle(pose, crank)),
    }


def gaps(pose):
    """Largest distance [m] at each sample between points that a joint holds together."""
    widest = np.zeros(len(pose))
    for pin in pins:
        (ax, ay), (bx, by) = point(pose, pin.a, *pin.anchor_a), point(pose, pin.b, *pin.anchor_b)
        widest = np.maximum(widest, np.hypot(bx - ax, by - ay))
    for slide in slides:
        x, y = point(pose, slide.b, *slide.anchor_b)
        (ax, ay), (bx, by) = (point(pose, slide.a, *end) for end in (slide.groove_a, slide.groove_b))
        across = (bx - ax) * (y - ay) - (by - ay) * (x - ax)
        widest = np.maximum(widest, abs(across) / np.hypot(bx - ax, by - ay))
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
