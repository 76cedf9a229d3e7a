"""Time stepping in pymunk: the motion of a model in time, its curves and the state of its drives.

A run starts one step before its first sample, with rates and accelerations that are consistent with
loops and drives.  States are recorded at each sample and one step before it.  The number of
iterations in a step is computed from the rate at which Chipmunk's solver converges.
"""

from collections.abc import Callable, Sequence

import numpy as np
import pymunk
from pymunk import batch

from proofmass.analytic.joints_at_rest import RestRows, free_motions
from proofmass.analytic.numerics import motion_senses
from proofmass.base.arrays import Array
from proofmass.base.clock import processor_time
from proofmass.sim.protocol.curves import Curves
from proofmass.sim.protocol.failures import Diverged
from proofmass.sim.protocol.run import Run
from proofmass.sim.pymunk.dampers import midpoint_dampers
from proofmass.sim.pymunk.kinematics import (
    close_loops,
    constraint_values,
    constraint_violations,
    damping,
    derivative_along,
    drive_values,
    is_determined,
    jacobian,
    joint_values,
    move_sizes,
    potential,
    residual,
    scale_rows,
)
from proofmass.sim.pymunk.links import Links
from proofmass.sim.pymunk.loads import LoadedLinks, add_loads, control_changes, links_at_start
from proofmass.sim.pymunk.reactions import SampledMotion
from proofmass.sim.pymunk.read import (
    Sensor,
    force_curves,
    kinetic_energy,
    time_derivative,
    unwrap_angle,
)
from proofmass.sim.pymunk.space import (
    STATE_FIELDS,
    LinkDrive,
    Settings,
    add_contacts,
    add_drives,
    add_friction,
    build_space,
    empty_buffer,
    read_states,
    set_states,
)

EIGENVALUE_MARGIN = 1e-9
"""Margin below 1: larger eigenvalues of an iteration belong to coordinates without constraint."""


def contraction_factor(links: Links, pose: Array, stuck: Sequence[int] = ()) -> float:
    """Factor by which one iteration of the solver reduces the slowest part of a velocity error.

    In an iteration each constraint in turn removes its own part of the velocity error.  With
    coordinates scaled by the square roots of the masses this is an orthogonal projection.  The
    factor is the spectral radius of the product of the projections,

        (I - B_n^+ B_n) ... (I - B_1^+ B_1),

    without the eigenvalues 1, which belong to the coordinates that no constraint affects.  Joints
    that stick by dry friction (`stuck`, ids) are constraints as well.
    """
    root = np.sqrt(np.column_stack([links.mass, links.mass, links.moment]).ravel())
    rows = jacobian(lambda p: constraint_values(links, p), pose) / root
    held = jacobian(lambda p: joint_values(links, p), pose)[list(stuck)] / root
    product = np.eye(len(root))
    for block in [*np.split(rows, _constraint_starts(links)), *held[:, None]]:
        product = product - np.linalg.pinv(block) @ (block @ product)
    sizes = np.abs(np.linalg.eigvals(product))
    return float(sizes[sizes < 1 - EIGENVALUE_MARGIN].max(initial=0.0))


def _constraint_starts(links: Links) -> list[int]:
    """Indices of the first rows of all of Chipmunk's constraints except the first constraint.

    A pin is one constraint of two rows, a slide two constraints of one row each; gears and drives
    have one row.
    """
    starts: list[int] = []
    for k, constraint in enumerate(links.holds):
        starts += [2 * k] if constraint.axis is None else [2 * k, 2 * k + 1]
    count = 2 * len(links.holds)
    return [*starts[1:], *range(count, links.rows + len(links.drives))]


def iterations_needed(links: Links, poses: Array, remaining_share: float) -> int:
    """Number of iterations that reduce a velocity error to a given share in each of the poses.

    Parameters
    ----------
    links : Links
    poses : ndarray (poses, links + 1, 3) [m, m, rad]
    remaining_share : float
        Share of the error that may remain [1].
    """
    states = {(), links.rubbing_loose}  # of all joints with dry friction none sticks, or all do
    share = max(contraction_factor(links, pose, stuck) for pose in poses for stuck in states)
    return int(np.ceil(np.log(remaining_share) / np.log(share))) if share > 0 else 1


def start_motion(
    links: Links, pose: Array, rate: Array, acceleration: Array
) -> tuple[Array, Array]:
    """Velocity and acceleration (links + 1, 3) of a closed pose under loads, springs and drives.

    The rates of the joints are those of `links`; what they lack of the drives' rates is added by
    the least change.

    Parameters
    ----------
    links : Links
    pose : ndarray (links + 1, 3) [m, m, rad]
    rate, acceleration : ndarray (drives,)
        Rates [rad/s or m/s] and accelerations [rad/s^2 or m/s^2] of the drives.
    """

    def prescribed(p: Array) -> Array:
        return constraint_values(links, p)

    rows = jacobian(prescribed, pose)
    closed = np.zeros(len(rows) - len(rate))
    velocity = _velocity_of_joints(links, pose)
    lacking = np.append(closed, rate) - rows @ velocity
    velocity = velocity + _solve_constrained(links, rows, np.zeros(len(velocity)), lacking)
    full = _append_ground(velocity)
    h = 1e-5 / (1e-5 + move_sizes(links, full))
    turning = (jacobian(prescribed, pose + h * full) - jacobian(prescribed, pose - h * full)) / (
        2 * h
    )
    coefficients, damped = damping(links)
    slopes = jacobian(damped, pose)
    force = -jacobian(lambda p: potential(links, p), pose)
    force = force - slopes.T @ (coefficients * (slopes @ velocity))
    needed = np.append(closed, acceleration) - turning @ velocity
    if links.rubbing_loose:
        force, rows, needed = add_start_friction(links, pose, velocity, force, rows, needed)
    return full, _append_ground(_solve_constrained(links, rows, force, needed))


REST_RATE = 1e-12
"""Rate below which a joint with dry friction is at rest at the start [rad/s, or extents/s]."""


def add_start_friction(
    links: Links, pose: Array, velocity: Array, force: Array, rows: Array, needed: Array
) -> tuple[Array, Array, Array]:
    """Forces, rows and their accelerations at the start, with dry friction of loose joints.

    Joints that slip have their largest friction.  Those at rest begin to move, or are more rows;
    see `proofmass.analytic.joints_at_rest`.
    """
    loose = list(links.rubbing_loose)
    ways = jacobian(lambda p: joint_values(links, p), pose)[loose]
    bounds = links.frictions[loose]
    hinges = np.array([links.joints[j].constraint.axis is None for j in loose])
    rates = ways @ velocity
    moving = np.abs(rates) > REST_RATE * np.where(hinges, 1.0, links.extent)
    senses = np.where(moving, np.sign(rates), 0.0)
    force = force - ways.T @ (senses * bounds)
    motions = free_motions(np.diag(links.inertia[:-1].ravel()), rows)
    still = RestRows(ways[~moving] @ motions, bounds[~moving], np.zeros((~moving).sum(), bool))
    free = ways[~moving] @ _solve_constrained(links, rows, force, needed)
    senses[~moving] = begins = still.decide(free)
    force = force - ways[~moving].T @ (begins * bounds[~moving])
    stuck = ways[senses == 0]
    return force, np.vstack([rows, stuck]), np.append(needed, np.zeros(len(stuck)))


def _velocity_of_joints(links: Links, pose: Array) -> Array:
    """Velocity (3 links,) of a closed pose, from the rates of all joints at the start."""
    tree = jacobian(lambda p: residual(links, p), pose)[: links.joint_rows]
    chain = np.vstack([tree, jacobian(lambda p: joint_values(links, p), pose)])
    rates = np.array([joint.rate for joint in links.joints])
    wanted = np.append(np.zeros(len(tree)), rates)
    found = np.linalg.lstsq(chain * links.sizes, wanted, rcond=1e-14)[0]
    return np.asarray(found * links.sizes)


def _solve_constrained(links: Links, rows: Array, force: Array, needed: Array) -> Array:
    """Solve ``M a + J^T f = force`` with ``J a = needed`` for a (3 links,).

    The rows of J may be linearly dependent.
    """
    rows, needed = scale_rows(links, rows, needed)
    inertia = np.column_stack([links.mass, links.mass, links.moment]).ravel() * links.sizes**2
    largest = inertia.max()
    matrix = np.block(
        [[np.diag(inertia / largest), rows.T], [rows, np.zeros((len(rows), len(rows)))]]
    )
    right = np.append(force * links.sizes / largest, needed)
    return np.asarray(np.linalg.lstsq(matrix, right, rcond=1e-14)[0][: len(force)] * links.sizes)


def _append_ground(links_only: Array) -> Array:
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
    for instant, value in zip((-dt, 0.0), drives, strict=True):
        near = pose + instant * velocity + 0.5 * instant**2 * acceleration
        before = pose + (instant - dt) * velocity + 0.5 * (instant - dt) ** 2 * acceleration
        move = dt * (velocity + (instant - 0.5 * dt) * acceleration)
        remainder = (
            constraint_values(links, before + move)
            - constraint_values(links, before)
            - derivative_along(lambda p: constraint_values(links, p), before, move)
        )
        poses.append(close_loops(links, near, value, remainder))
    return poses[0], (poses[1] - poses[0]) / dt


MIN_FIRST_ITERATIONS = 3000
"""Smallest number of iterations in the first step, in which Chipmunk has no impulses of a step
before it to start from.  The first step takes ten times the iterations of the others if that is
more."""
States = tuple[Array, Array, Array]
"""Pose at each sample, velocity over the step before the sample and over the step after it."""


def simulate_states(links: Links, run: Run, steps_per_sample: int, settings: Settings) -> States:
    """Step through a run, and return the states at its samples.

    There are `steps_per_sample` steps from each sample to the next.
    """
    space, drives, targets, first_velocity = prepare_space(links, run, steps_per_sample, settings)
    feed = None
    if run.loads:
        times = run.x[0] + settings["timestep"] * np.arange(len(targets))
        feed = add_loads(space, links, run), control_changes(links, run, times).tolist()
    record = np.zeros(len(targets), bool)
    record[::steps_per_sample] = record[steps_per_sample - 1 :: steps_per_sample] = True
    buffer, dt = empty_buffer(), settings["timestep"]
    first = max(MIN_FIRST_ITERATIONS, 10 * settings["iterations"])
    dampers = midpoint_dampers(space, dt) if settings.get("midpoint_damping") else []
    step_through(space, dt, drives, targets, record, buffer, first, feed, dampers)
    return states_at_samples(*read_states(buffer, links), record, steps_per_sample, first_velocity)


def prepare_space(
    links: Links, run: Run, steps_per_sample: int, settings: Settings
) -> tuple[pymunk.Space, list[LinkDrive], Array, Array]:
    """Build the space of a run in its state one step before the start.

    Returns the space, its drives, their values after each step (steps, drives) [rad or m], and the
    velocity (links + 1, 3) of the step to the start.
    """
    space = build_space(links, settings["iterations"], settings["error_bias"])
    add_contacts(space, links, settings)
    for motor in add_friction(space, links, links.rubbing_loose):
        motor.resist()
    pose, velocity, targets = start_state(links, run, steps_per_sample, settings["timestep"])
    set_states(space, pose, velocity)
    return space, add_drives(space, links), targets, velocity


def start_state(
    links: Links, run: Run, steps_per_sample: int, dt: float
) -> tuple[Array, Array, Array]:
    """The state one step before the start, and the values of the drives after each step.

    Returns the pose (links + 1, 3), the velocity of the step to the start (links + 1, 3), and the
    values of the drives (steps, drives) [rad or m].
    """
    times = run.x[0] + dt * np.arange((len(run.x) - 1) * steps_per_sample + 1)
    profiles = np.zeros((3, len(times), len(run.drives)))
    for k, drive in enumerate(run.drives):
        for part, curve in zip(profiles, drive.profile(times), strict=True):
            part[:, k] = curve
    value, rate, acc = profiles
    value = _extend_values(value, acc, dt)
    pose = close_loops(links, links.pose, value[1])
    motion = start_motion(links, pose, rate[0], acc[0])
    pose, velocity = step_back(links, pose, motion, dt, value[:2])
    return pose, velocity, value[2:]


def _extend_values(value: Array, acc: Array, dt: float) -> Array:
    """Values of the drives, extended by one step at both ends by the accelerations there.

    Central differences of the values then exist at the ends too.
    """
    if len(value) < 2:
        return np.repeat(value, 3, axis=0)
    first = 2 * value[0] - value[1] + dt**2 * acc[0]
    last = 2 * value[-1] - value[-2] + dt**2 * acc[-1]
    return np.vstack([first, value, last])


LoadFeed = tuple[Callable[[list[float]], None], list[list[float]]]
"""A function that sets the changes of controls, and the changes for each step."""


def step_through(
    space: pymunk.Space,
    dt: float,
    drives: list[LinkDrive],
    targets: Array,
    record: Array,
    buffer: batch.Buffer,
    first: int,
    feed: LoadFeed | None = None,
    dampers: Sequence[Callable[[], None]] = (),
) -> None:
    """Step once for each row of `targets`, and record the state of all bodies in `buffer`.

    `targets` (steps, drives) are the values of the drives after each step, and `record` (steps,)
    marks the steps after which the state is recorded.  The first step must be marked, and takes
    `first` iterations.  `dampers` act before each step.
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
        for act in dampers:
            act()
        step(dt)
        if wanted:
            read(space, STATE_FIELDS, buffer)
            if first:
                space.iterations, first = usual, 0


def states_at_samples(
    pose: Array, velocity: Array, record: Array, steps_per_sample: int, first_velocity: Array
) -> States:
    """The states at the samples, from the recorded steps.

    `steps_per_sample` is the number of steps between samples, `record` marks the recorded steps,
    and `first_velocity` is the velocity before the first step.
    """
    place = np.cumsum(record) - 1
    samples = np.arange(0, len(record), steps_per_sample)
    before = np.concatenate([first_velocity[None], velocity[place[samples[1:] - 1]]])
    return pose[place[samples]], before, velocity[place[samples]]


MAX_LOOP_VIOLATION = 0.1
"""Constraint violation, as a share of the mechanism's extent, beyond which a run has failed."""
DEFAULT_ITERATIONS, MAX_ITERATIONS = 100, 3000
"""Iterations in a step: of the first attempt at a run, and the largest number that is chosen."""
STEP_SECONDS, DRIVE_SECONDS, LINK_SECONDS = 1.2e-6, 2e-6, 4e-7
"""Counted processor time of a step from Python, of each drive in it, and of each link [s]."""
TURN_DAMPER_SECONDS, LINE_DAMPER_SECONDS = 2e-6, 1.2e-5
"""Counted processor time of what a damper of the midpoint rule does before each step [s]: one of a
rotation, and one of a distance."""
ITERATION_SECONDS = 1.5e-8
"""Counted processor time of an iteration for each joint, loop, gear and drive [s]."""
REMAINING_ERROR = 0.1
"""Share of a velocity error that the iterations of a step may leave: the next step goes on from its
impulses."""
EXAMINED_POSES = 40
"""Approximate number of poses of a run from which the iterations are computed."""


def dynamics(links: Links, run: Run, channels: dict[str, Sensor], settings: Settings) -> Curves:
    """Step a mechanism through time; see `proofmass.sim.pymunk.engine.simulate`.

    If the settings give no number of iterations, a run is made with `DEFAULT_ITERATIONS` of them.
    It is repeated with the number that its poses need, if that is larger.
    """
    began, links = processor_time(), links_at_start(links, run)
    asked = settings["timestep"]
    steps_per_sample, dt = run.steps(asked)
    used = {**settings, "timestep": dt, "iterations": settings["iterations"] or DEFAULT_ITERATIONS}
    states = simulate_states(links, run, steps_per_sample, used)
    if (
        settings["iterations"] is None
        and (needed := _choose_iterations(links, states[0])) > DEFAULT_ITERATIONS
    ):
        used["iterations"] = needed
        states = simulate_states(links, run, steps_per_sample, used)
    violations, failed = _find_failures(links, states[0])
    with np.errstate(all="ignore"):  # samples after a failure may overflow; they are cut off
        shown = {n: c for n, c in channels.items() if c.order > -2}
        found = {n: unwrap_angle(n, _channel_curve(links, c, states, dt)) for n, c in shown.items()}
        pose, before, after = states
        drive = _drive_state(links, states, dt)
        motion = SampledMotion(
            pose,
            0.5 * (before + after),
            (after - before) / dt,
            _prescribed_friction(links, states, dt, drive),
        )
        if run.loads:
            found |= LoadedLinks.of(links, run).curves(channels, motion, drives=True)
        else:
            found |= force_curves(links, channels, motion)
    steps = (len(run.x) - 1) * steps_per_sample + 1
    damping_seconds = damper_seconds(links) if used.get("midpoint_damping") else 0.0
    curves = Curves(
        run.x,
        found,
        {},
        drive,
        float(violations.max()),
        processor_time() - began,
        steps,
        used,
        violations=violations,
        asked_step=asked,
        work=steps * (step_seconds(links, len(run.drives), used["iterations"]) + damping_seconds),
    )
    if failed.any():
        k = int(np.argmax(failed))
        raise Diverged(
            f"failed at time {run.x[k]:.4g} s: the loops are open by {violations[k]:.3g} m",
            curves.first(k) if k else None,
        )
    return curves


def step_seconds(links: Links, drives: int, iterations: int) -> float:
    """Processor time of a step [s], counted from its iterations and the size of the mechanism."""
    constraints = len(links.joints) + len(links.loops) + len(links.gears) + drives
    return (
        STEP_SECONDS
        + DRIVE_SECONDS * drives
        + LINK_SECONDS * len(links.joints)
        + ITERATION_SECONDS * iterations * constraints
    )


def damper_seconds(links: Links) -> float:
    """Processor time of the midpoint rule of all dampers in a step [s], counted by their kinds."""
    damped = [joint for joint in links.joints if joint.damping]
    turns = sum(joint.constraint.axis is None for joint in damped)
    lines = len(damped) - turns + sum(bool(spring.damping) for spring in links.springs)
    return TURN_DAMPER_SECONDS * turns + LINE_DAMPER_SECONDS * lines


def _choose_iterations(links: Links, pose: Array) -> int:
    """The iterations that the poses (n, links + 1, 3) of a run need, `MAX_ITERATIONS` at most."""
    if _find_failures(links, pose)[1].any():
        return MAX_ITERATIONS
    return min(
        iterations_needed(links, pose[:: len(pose) // EXAMINED_POSES + 1], REMAINING_ERROR),
        MAX_ITERATIONS,
    )


def _drive_state(links: Links, states: States, dt: float) -> tuple[Array, Array, Array] | None:
    """Values, rates and accelerations (drives, n) that the drives really had; None if none is."""

    def value(pose: Array) -> Array:
        return drive_values(links, pose)

    if not links.drives:
        return None
    place, rate, acceleration = (
        time_derivative(value, order, *states, dt).T for order in (0, 1, 2)
    )
    return place, rate, acceleration


def _prescribed_friction(
    links: Links, states: States, dt: float, drive: tuple[Array, Array, Array] | None
) -> Array | float:
    """Dry friction (n, joints) of joints whose motion drives prescribe, positive against it.

    Where drives leave degrees of freedom, these are the driven joints alone.
    """
    if drive is None or not links.rubbing:
        return 0.0
    rates = time_derivative(lambda p: joint_values(links, p), 1, *states, dt)
    senses = motion_senses(rates.T, float(np.abs(drive[1]).max(initial=0.0))).T
    prescribed = np.isin(np.arange(len(links.joints)), links.driven) | is_determined(links)
    return np.asarray(np.where(prescribed, links.frictions, 0.0) * senses)


def _find_failures(links: Links, pose: Array) -> tuple[Array, Array]:
    """Largest constraint violation [m] of each pose, and which poses show that the run failed.

    A pose has failed if it is not finite or violates constraints by more than `MAX_LOOP_VIOLATION`.
    """
    with np.errstate(all="ignore"):
        violation = constraint_violations(links, pose).max(axis=-1, initial=0.0)
    return violation, ~(
        np.isfinite(pose).all(axis=(1, 2)) & (violation <= MAX_LOOP_VIOLATION * links.extent)
    )


def _channel_curve(links: Links, c: Sensor, states: States, dt: float) -> Array:
    """The curve of a channel that is a function of the motion and not of forces."""
    if c.order == -1:
        return kinetic_energy(links, 0.5 * (states[1] + states[2]))
    return time_derivative(c.function, c.order, *states, dt)
