"""fivebar_swing, dynamics: velocity within 1e-5 of its range.

pymunk, no bias, 30 iterations, timestep 2.22 ms: 3.3e-6 off in 0.02 s, 1351 steps
as a program that runs by itself, its drive moved by a gear: 4e-6 off in 7e-3 s; 3.3e-6 from
a shifted start
its drive moved by a motor instead: 4e-6 off in 0.011 s
the engine's defaults are 5.3e-5 off at best, 0.098 s at timestep 0.253 ms; of order 1 they
would take 0.93 s, 47 times as long

Made by proofmass choose with pymunk 7.3.1.  It writes the curves of all channels, in SI units:

    python fivebar_swing_pymunk.py [curves.csv]
"""

import csv
import sys
import time

import numpy as np
import pymunk
from pymunk import batch

TIMESTEP = 0.0022222222222222222  # [s]
ITERATIONS = 30  # of Chipmunk's solver in a step
FIRST_ITERATIONS = 3000  # of the first step, which has no impulses of another to begin with
ERROR_BIAS = 0.0  # share of a gap that is left after a second; 0: none after the next step
START_TIME, END_TIME = 0.0, 3.0  # [s]
SAMPLES, STEPS_PER_SAMPLE = 151, 9
STEPS = (SAMPLES - 1) * STEPS_PER_SAMPLE + 1

# ---- MODEL -----------------------------------------------------------------------------------

EXTENT = 1.2385745382757047  # size of the mechanism [m]
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
left_crank = add_body(mass=0.4, moment=0.00533333333333333, x=-0.08322936730942847, y=0.18185948536513638)
left_coupler = add_body(mass=0.9, moment=0.060749999999999985, x=0.21387519407686348, y=0.6042311381623564)
right_crank = add_body(mass=0.5, moment=0.0104166666666667, x=0.8302652485007213, y=0.09735458557716262)
right_coupler = add_body(mass=0.8, moment=0.04266666666666669, x=0.8273698098870131, y=0.5197262383743824)
ground = space.static_body
bodies = [left_crank, left_coupler, right_crank, right_coupler, ground]

# hinge "left": a pin of ground and left_crank
add(pymunk.PivotJoint(ground, left_crank, (0.0, 0.0), (0.08322936730942847, -0.18185948536513638)))
# hinge "left_coupler": a pin of left_crank and left_coupler
add(pymunk.PivotJoint(left_crank, left_coupler, (-0.08322936730942847, 0.18185948536513638),
    (-0.3803339286957204, -0.24051216743208365)))
# hinge "right": a pin of ground and right_crank
add(pymunk.PivotJoint(ground, right_crank, (0.6, 0.0),
    (-0.23026524850072128, -0.09735458557716262)))
# hinge "right_coupler": a pin of right_crank and right_coupler
add(pymunk.PivotJoint(right_crank, right_coupler, (0.2302652485007214, 0.09735458557716262),
    (0.2331606871144295, -0.32501706722005713)))
# loop "tip": a pin of left_coupler and right_coupler
add(pymunk.PivotJoint(left_coupler, right_coupler, (0.38033392869572036, 0.2405121674320836),
    (-0.2331606871144295, 0.32501706722005697)))

pins = [joint for joint in space.constraints if isinstance(joint, pymunk.PivotJoint)]

# ---- DRIVES ----------------------------------------------------------------------------------


def motion(t):
    """Values, rates and accelerations (drives, n) of the drives at times (n,) [s]."""
    return (
        np.array([2.0 + -0.44999999999999996 * (1 - np.cos(2.0943951023931953 * t)), 0.4 + -0.888888888888889 * (2.0 + -0.44999999999999996 * (1 - np.cos(2.0943951023931953 * t)) - 2.0)]),
        np.array([-0.9424777960769378 * np.sin(2.0943951023931953 * t), -0.888888888888889 * (-0.9424777960769378 * np.sin(2.0943951023931953 * t))]),
        np.array([-1.9739208802178712 * np.cos(2.0943951023931953 * t), -0.888888888888889 * (-1.9739208802178712 * np.cos(2.0943951023931953 * t))]))


def aim(values):
    """Let the driven joints have these values [rad or m] after the next step."""
    # hinge "left", by a gear of ratio 1 whose phase is moved
    drives[0].phase = values[0] - 2.0
    # hinge "right", by a gear of ratio 1 whose phase is moved
    drives[1].phase = values[1] - 0.4


# Last in the order, where constraints are met best.
drives = [
    pymunk.GearJoint(ground, left_crank, 0.0, 1.0),
    pymunk.GearJoint(ground, right_crank, 0.0, 1.0),
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
    # left_crank
    ((-0.08322848095466132, 0.1818598910329908, -4.873887515070524e-06),
     (-0.0003988600900686756, -0.0001825495624913076, 0.0021932493818201857)),
    # left_coupler
    ((0.21387630106128228, 0.6042330022683159, 2.767996226387477e-06),
     (-0.0004981427486255852, -0.0008388460724539915, -0.0012456002721295692)),
    # right_crank
    ((0.8302648267444095, 0.097355583172845, 4.33234445748267e-06),
     (0.00018979131271579242, -0.00044891764593782413, -0.0019495550058764072)),
    # right_coupler
    ((0.827369608760353, 0.5197286944081702, -1.9764796116831167e-06),
     (9.050865417137288e-05, -0.001105214155944223, 0.0008894160799834369)),
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


def along(function, pose, velocity):
    """Derivative of a function of the pose by time, by a complex step: exact to rounding."""
    return np.imag(function(pose + 1e-30j * velocity)) / 1e-30


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
        'tip.x': value(lambda pose: point(pose, left_coupler, 0.38033392869572036,
            0.2405121674320836)[0]),
        'tip.y': value(lambda pose: point(pose, left_coupler, 0.38033392869572036,
            0.2405121674320836)[1]),
        'tip_velocity.x': rate(lambda pose: point(pose, left_coupler, 0.38033392869572036,
            0.2405121674320836)[0]),
        'tip_velocity.y': rate(lambda pose: point(pose, left_coupler, 0.38033392869572036,
            0.2405121674320836)[1]),
        'tip_acceleration.x': acceleration(lambda pose: point(pose, left_coupler,
            0.38033392869572036, 0.2405121674320836)[0]),
        'tip_acceleration.y': acceleration(lambda pose: point(pose, left_coupler,
            0.38033392869572036, 0.2405121674320836)[1]),
        'left drive': value(lambda pose: 2.0 + angle(pose, left_crank)),
        'left drive rate': rate(lambda pose: 2.0 + angle(pose, left_crank)),
        'left drive acceleration': acceleration(lambda pose: 2.0 + angle(pose, left_crank)),
        'right drive': value(lambda pose: 0.4 + angle(pose, right_crank)),
        'right drive rate': rate(lambda pose: 0.4 + angle(pose, right_crank)),
        'right drive acceleration': acceleration(lambda pose: 0.4 + angle(pose, right_crank)),
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
