"""Time stepping in pymunk: the motion of a model in time, its curves and the state of its drives.

A run starts one step before its first sample, with rates and accelerations that are consistent with
loops and drives.  States are recorded at each sample and one step before it.  The number of
iterations in a step is computed from the rate at which Chipmunk's solver converges.
"""

import time
from collections.abc import Callable

import numpy as np
import pymunk
from pymunk import batch

from proofmass.analytic.numerics import Array
from proofmass.sim.protocol import Curves, Diverged, Run
from proofmass.sim.pymunk.kinematics import (
    alike,
    along,
    bound,
    chain_at,
    close,
    damping,
    drive_values,
    gaps,
    jacobian,
    joint_values,
    potential,
    residual,
    sizes,
)
from proofmass.sim.pymunk.links import Links
from proofmass.sim.pymunk.loads import Loaded, add_loads, at_start, changes
from proofmass.sim.pymunk.reactions import SampledMotion
from proofmass.sim.pymunk.read import Sensor, force_curves, kinetic, moving, unwrapped
from proofmass.sim.pymunk.space import (
    FIELDS,
    Motor,
    Settings,
    add_contacts,
    add_drives,
    build,
    empty_buffer,
    put,
    taken,
)

CLEAR = 1e-9
"""Margin below 1: larger eigenvalues of an iteration belong to coordinates without constraint."""


def contraction(links: Links, pose: Array) -> float:
    """Factor by which one iteration of the solver reduces the slowest part of a velocity error.

    In an iteration each constraint in turn removes its own part of the velocity error.  With
    coordinates scaled by the square roots of the masses this is an orthogonal projection.  The
    factor is the spectral radius of the product of the projections,

        (I - B_n^+ B_n) ... (I - B_1^+ B_1),

    without the eigenvalues 1, which belong to the coordinates that no constraint affects.
    """
    root = np.sqrt(np.column_stack([links.mass, links.mass, links.moment]).ravel())
    rows = jacobian(lambda p: bound(links, p), pose) / root
    product = np.eye(len(root))
    for block in np.split(rows, _starts(links)):
        product = product - np.linalg.pinv(block) @ (block @ product)
    sizes = np.abs(np.linalg.eigvals(product))
    return float(sizes[sizes < 1 - CLEAR].max(initial=0.0))


def _starts(links: Links) -> list[int]:
    """Indices of the first rows of all of Chipmunk's constraints except the first constraint.

    A pin is one constraint of two rows, a slide two constraints of one row each; gears and drives
    have one row.
    """
    starts: list[int] = []
    for k, hold in enumerate(links.holds):
        starts += [2 * k] if hold.axis is None else [2 * k, 2 * k + 1]
    count = 2 * len(links.holds)
    return [*starts[1:], *range(count, links.rows + len(links.drives))]


def enough(links: Links, poses: Array, left: float) -> int:
    """Number of iterations that reduce a velocity error to a given share in each of the poses.

    Parameters
    ----------
    links : Links
    poses : ndarray (poses, links + 1, 3) [m, m, rad]
    left : float
        Share of the error that may remain [1].
    """
    share = max(contraction(links, pose) for pose in poses)
    return int(np.ceil(np.log(left) / np.log(share))) if share > 0 else 1


def start_motion(
    links: Links, pose: Array, rate: Array, acceleration: Array
) -> tuple[Array, Array]:
    """Velocity and acceleration (links + 1, 3) of a closed pose under loads, springs and drives.

    Joints without a drive start with the rates of the keyframe, as far as the loops allow.

    Parameters
    ----------
    links : Links
    pose : ndarray (links + 1, 3) [m, m, rad]
    rate, acceleration : ndarray (drives,)
        Rates [rad/s or m/s] and accelerations [rad/s^2 or m/s^2] of the drives.
    """

    def held(p: Array) -> Array:
        return bound(links, p)

    rows = jacobian(held, pose)
    closed = np.zeros(len(rows) - len(rate))
    velocity = _started(links, pose, rate)  # exact to rounding, except near a singular pose
    lacking = np.append(closed, rate) - rows @ velocity
    velocity = velocity + _held(links, rows, np.zeros(len(velocity)), lacking)
    full = _padded(velocity)
    h = 1e-5 / (1e-5 + sizes(links, full))
    turning = (jacobian(held, pose + h * full) - jacobian(held, pose - h * full)) / (2 * h)
    coefficients, damped = damping(links)
    slopes = jacobian(damped, pose)
    force = -jacobian(lambda p: potential(links, p), pose)
    force = force - slopes.T @ (coefficients * (slopes @ velocity))
    needed = np.append(closed, acceleration) - turning @ velocity
    return full, _padded(_held(links, rows, force, needed))


def _started(links: Links, pose: Array, rate: Array) -> Array:
    """Velocity (3 links,) of a closed pose that satisfies loops and drives.

    The rates of the joints differ from those of the keyframe as little as possible, in the least
    squares sense.
    """
    open_rows = jacobian(lambda p: residual(links, p), pose)
    tree = links.joint_rows
    chain = np.vstack([open_rows[:tree], jacobian(lambda p: joint_values(links, p), pose)])
    by_joints = np.linalg.lstsq(chain * links.sizes, np.eye(len(chain))[:, tree:], rcond=1e-14)[0]
    by_joints *= links.sizes[:, None]
    wanted = np.array([joint.rate for joint in links.joints])
    fixed = np.vstack([open_rows[tree:] @ by_joints, np.eye(wanted.size)[list(links.driven)]])
    asked = np.append(np.zeros(len(fixed) - rate.size), rate)
    change = np.linalg.lstsq(fixed, asked - fixed @ wanted, rcond=1e-9)[0]
    return np.asarray(by_joints @ (wanted + change))


def _held(links: Links, rows: Array, force: Array, needed: Array) -> Array:
    """Solve ``M a + J^T f = force`` with ``J a = needed`` for a (3 links,).

    The rows of J may be linearly dependent.
    """
    rows, needed = alike(links, rows, needed)
    inertia = np.column_stack([links.mass, links.mass, links.moment]).ravel() * links.sizes**2
    most = inertia.max()
    matrix = np.block([[np.diag(inertia / most), rows.T], [rows, np.zeros((len(rows), len(rows)))]])
    right = np.append(force * links.sizes / most, needed)
    return np.asarray(np.linalg.lstsq(matrix, right, rcond=1e-14)[0][: len(force)] * links.sizes)


def _padded(links_only: Array) -> Array:
    """A vector (3 links,) as an array (links + 1, 3), with zeros for the ground."""
    return np.append(links_only, np.zeros(3)).reshape(-1, 3)


def step_back(
    links: Links, pose: Array, motion: tuple[Array, Array], dt: float, drives: Array
) -> tuple[Array, Array]:
    """The state one step before the start, as if the engine had been stepping before it.

    Chipmunk satisfies constraints and drives to first order, ``C(x) + dt J(x) v = 0``.  In a motion
    the remainder of second order, a constant times dt^2, stays as a constraint violation.  A start
    without this violation would jump by it.

    Parameters
    ----------
    links : Links
    pose : ndarray (links + 1, 3) [m, m, rad]
        Closed pose at the start.
    motion : (velocity, acceleration) [m, m, rad, per s, per s^2]
        Derivatives of the pose at the start.
    dt : float
        Time step [s].
    drives : ndarray (2, drives)
        Values of the drives [rad or m] at -dt and at 0.

    Returns
    -------
    pose, velocity : ndarray (links + 1, 3)
        Pose at -dt [m, m, rad], and velocity over the step from -dt to 0 [m/s, m/s, rad/s].
    """
    velocity, acceleration = motion
    poses = []
    for at, value in zip((-dt, 0.0), drives, strict=True):
        near = pose + at * velocity + 0.5 * at**2 * acceleration
        before = pose + (at - dt) * velocity + 0.5 * (at - dt) ** 2 * acceleration
        move = dt * (velocity + (at - 0.5 * dt) * acceleration)
        rest = (
            bound(links, before + move)
            - bound(links, before)
            - along(lambda p: bound(links, p), before, move)
        )
        poses.append(close(links, near, value, rest))
    return poses[0], (poses[1] - poses[0]) / dt


SURE = 3000
"""Smallest number of iterations in the first step, in which Chipmunk has no impulses of a step
before it to start from.  The first step takes ten times the iterations of the others if that is
more."""
States = tuple[Array, Array, Array]
"""Pose at each sample, velocity over the step before the sample and over the step after it."""


def stepped(links: Links, run: Run, per: int, settings: Settings) -> States:
    """Step through a run, and return the states at its samples.

    There are `per` steps from each sample to the next.
    """
    space, drives, targets, back = prepared(links, run, per, settings)
    feed = None
    if run.loads:
        times = run.x[0] + settings["timestep"] * np.arange(len(targets))
        feed = add_loads(space, links, run), changes(links, run, times).tolist()
    record = np.zeros(len(targets), bool)
    record[::per] = record[per - 1 :: per] = True
    buffer = empty_buffer()
    first = max(SURE, 10 * settings["iterations"])
    step_through(space, settings["timestep"], drives, targets, record, buffer, first, feed)
    return at_samples(*taken(buffer, links), record, per, back)


def prepared(
    links: Links, run: Run, per: int, settings: Settings
) -> tuple[pymunk.Space, list[Motor], Array, Array]:
    """Build the space of a run in its state one step before the start.

    Returns the space, its drives, their values after each step (steps, drives) [rad or m], and the
    velocity (links + 1, 3) of the step to the start.
    """
    space = build(links, settings["iterations"], settings["error_bias"])
    add_contacts(space, links, settings)
    pose, velocity, targets = start_state(links, run, per, settings["timestep"])
    put(space, pose, velocity)
    return space, add_drives(space, links), targets, velocity


def start_state(links: Links, run: Run, per: int, dt: float) -> tuple[Array, Array, Array]:
    """The state one step before the start, and the values of the drives after each step.

    Returns the pose (links + 1, 3), the velocity of the step to the start (links + 1, 3), and the
    values of the drives (steps, drives) [rad or m].
    """
    times = run.x[0] + dt * np.arange((len(run.x) - 1) * per + 1)
    laws = np.zeros((3, len(times), len(run.drives)))
    for k, drive in enumerate(run.drives):
        for part, curve in zip(laws, drive.law(times), strict=True):
            part[:, k] = curve
    value, rate, acc = laws
    value = _one_more(value, acc, dt)
    chain = bool(links.driven) and not links.loops and not links.gears
    begin = chain_at(links, value[1]) if chain else links.pose
    pose = close(links, begin, value[1])
    motion = start_motion(links, pose, rate[0], acc[0])
    pose, velocity = step_back(links, pose, motion, dt, value[:2])
    return pose, velocity, value[2:]


def _one_more(value: Array, acc: Array, dt: float) -> Array:
    """Values of the drives, extended by one step at both ends by the accelerations there.

    Central differences of the values then exist at the ends too.
    """
    if len(value) < 2:
        return np.repeat(value, 3, axis=0)
    first = 2 * value[0] - value[1] + dt**2 * acc[0]
    last = 2 * value[-1] - value[-2] + dt**2 * acc[-1]
    return np.vstack([first, value, last])


Feed = tuple[Callable[[list[float]], None], list[list[float]]]
"""A function that sets the changes of controls, and the changes for each step."""


def step_through(
    space: pymunk.Space,
    dt: float,
    drives: list[Motor],
    targets: Array,
    record: Array,
    buffer: batch.Buffer,
    first: int,
    feed: Feed | None = None,
) -> None:
    """Step once for each row of `targets`, and record the state of all bodies in `buffer`.

    `targets` (steps, drives) are the values of the drives after each step, and `record` (steps,)
    marks the steps after which the state is recorded.  The first step must be marked, and takes
    `first` iterations.
    """
    step, read = space.step, batch.get_space_bodies
    usual, space.iterations = space.iterations, first
    set_loads, rows = feed or (None, [])
    aims = [drive.aim for drive in drives]
    for k, (target, wanted) in enumerate(zip(targets.tolist(), record.tolist(), strict=True)):
        for aim, value in zip(aims, target, strict=True):
            aim(value)
        if set_loads:
            set_loads(rows[k])
        step(dt)
        if wanted:
            read(space, FIELDS, buffer)
            if first:
                space.iterations, first = usual, 0


def at_samples(pose: Array, velocity: Array, record: Array, per: int, back: Array) -> States:
    """The states at the samples, from the recorded steps.

    `per` is the number of steps between samples, `record` marks the recorded steps,
    and `back` is the velocity before the first step.
    """
    place = np.cumsum(record) - 1
    samples = np.arange(0, len(record), per)
    before = np.concatenate([back[None], velocity[place[samples[1:] - 1]]])
    return pose[place[samples]], before, velocity[place[samples]]


OPEN_LOOP = 0.1
"""Constraint violation, as a share of the mechanism's extent, beyond which a run has failed."""
USUAL, MOST = 100, 3000
"""Iterations in a step: of the first attempt at a run, and the largest number that is chosen."""
LEFT = 0.1
"""Share of a velocity error that the iterations of a step may leave: the next step goes on from its
impulses."""
LOOKED_AT = 40
"""Approximate number of poses of a run from which the iterations are computed."""


def dynamics(links: Links, run: Run, channels: dict[str, Sensor], settings: Settings) -> Curves:
    """Step a mechanism through time; see `proofmass.sim.pymunk.engine.simulate`.

    If the settings give no number of iterations, a run is made with `USUAL` of them.
    It is repeated with the number that its poses need, if that is larger.
    """
    began, links = time.perf_counter(), at_start(links, run)
    per, dt = run.steps(settings["timestep"])
    used = {**settings, "timestep": dt, "iterations": settings["iterations"] or USUAL}
    states = stepped(links, run, per, used)
    if settings["iterations"] is None and (needed := _needed(links, states[0])) > USUAL:
        used["iterations"] = needed
        states = stepped(links, run, per, used)
    gaps, failed = _failed(links, states[0])
    with np.errstate(all="ignore"):  # samples after a failure may overflow; they are cut off
        shown = {n: c for n, c in channels.items() if c.order > -2}
        found = {n: unwrapped(n, _curve(links, c, states, dt)) for n, c in shown.items()}
        pose, before, after = states
        motion = SampledMotion(pose, 0.5 * (before + after), (after - before) / dt)
        if run.loads:
            found |= Loaded.of(links, run).curves(channels, motion, drives=True)
        else:
            found |= force_curves(links, channels, motion)
        drive = _drive_state(links, states, dt)
    steps = (len(run.x) - 1) * per + 1
    curves = Curves(
        run.x,
        found,
        {},
        drive,
        float(gaps.max()),
        time.perf_counter() - began,
        steps,
        used,
        violations=gaps,
    )
    if failed.any():
        k = int(np.argmax(failed))
        raise Diverged(
            f"failed at time {run.x[k]:.4g} s: the loops are open by {gaps[k]:.3g} m",
            curves.first(k) if k else None,
        )
    return curves


def _needed(links: Links, pose: Array) -> int:
    """The iterations that the poses (n, links + 1, 3) of a run need, `MOST` at most."""
    if _failed(links, pose)[1].any():
        return MOST
    return min(enough(links, pose[:: len(pose) // LOOKED_AT + 1], LEFT), MOST)


def _drive_state(links: Links, states: States, dt: float) -> tuple[Array, Array, Array] | None:
    """Values, rates and accelerations (drives, n) that the drives really had; None if none is."""

    def value(pose: Array) -> Array:
        return drive_values(links, pose)

    if not links.drives:
        return None
    place, rate, acceleration = (moving(value, order, *states, dt).T for order in (0, 1, 2))
    return place, rate, acceleration


def _failed(links: Links, pose: Array) -> tuple[Array, Array]:
    """Largest constraint violation [m] of each pose, and which poses show that the run failed.

    A pose has failed if it is not finite or violates constraints by more than `OPEN_LOOP`.
    """
    with np.errstate(all="ignore"):
        gap = gaps(links, pose).max(axis=-1, initial=0.0)
    return gap, ~(np.isfinite(pose).all(axis=(1, 2)) & (gap <= OPEN_LOOP * links.extent))


def _curve(links: Links, c: Sensor, states: States, dt: float) -> Array:
    """The curve of a channel that is a function of the motion and not of forces."""
    if c.order == -1:
        return kinetic(links, 0.5 * (states[1] + states[2]))
    return moving(c.function, c.order, *states, dt)
