"""Constraints, joints and energy as functions of the links' poses (..., links + 1, 3).

Derivatives are computed by complex steps (the function at ``pose + i h direction``), exact to
rounding.  Only the gradient of the energy is written out as formulas, since chains of many links
need it for each of their free motions.

`close_loops` moves a pose until its loops are closed; its error states the remaining constraint
violation.  `find_modes` computes the free motions of a pose with fixed drives and with joints that
stay on their limits.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from proofmass.base.arrays import Array
from proofmass.sim.protocol.failures import BadModel
from proofmass.sim.pymunk.links import (
    QUARTER_TURN,
    ConstraintTable,
    JointTable,
    LinkConstraint,
    LinkJoint,
    LinkLoad,
    Links,
    LinkSpring,
)

COMPLEX_STEP = 1e-30
"""Size of the complex step of derivatives."""


def rotate(angle: Array, vector: Array) -> Array:
    """Vectors (..., 2) rotated counter-clockwise by angles (...) [rad], as (..., 2)."""
    c, s = np.cos(angle), np.sin(angle)
    x, y = vector[..., 0], vector[..., 1]
    across = c * x - s * y
    found = np.empty((*np.shape(across), 2), across.dtype)  # a third of the time of `np.stack`
    found[..., 0], found[..., 1] = across, s * x + c * y
    return found


def cross(one: Array, other: Array) -> Array:
    """The cross product x v - y u (...) of vectors (x, y) and (u, v), both of shape (..., 2)."""
    return np.asarray(one[..., 0] * other[..., 1] - one[..., 1] * other[..., 0])


def anchor_offset(constraint: LinkConstraint | ConstraintTable | LinkSpring, pose: Array) -> Array:
    """Vector [m] from the anchor on link a to that on link b, for poses (..., links + 1, 3).

    Its shape is (..., 2), and (..., holds, 2) for a `ConstraintTable`.
    """
    if isinstance(constraint, ConstraintTable):
        ends = pose.take(constraint.ends, axis=-2)
        points, count = rotate(ends[..., 2], constraint.on_ends), len(constraint.a)
        points += ends[..., :2]
        return points[..., :count, :] - points[..., count:, :]
    a, b = pose[..., constraint.a, :], pose[..., constraint.b, :]
    return (
        b[..., :2]
        + rotate(b[..., 2], constraint.on_b)
        - a[..., :2]
        - rotate(a[..., 2], constraint.on_a)
    )


def _violation_rows(links: Links, pose: Array) -> Array:
    """Violation of each constraint of links (..., holds, 2).

    It is the vector between the two anchors of a pin [m], and for a slide the distance across its
    axis [m] and the angle between its links [rad].
    """
    table = links.table
    rows = anchor_offset(table, pose)
    if table.has_slides:
        slides, a, b, across = table.guides
        turns = pose[..., 2]
        from_a = turns[..., a]
        rows[..., slides, 0] = (rotate(from_a, across) * rows[..., slides, :]).sum(-1)
        rows[..., slides, 1] = turns[..., b] - from_a
    return rows


def residual(links: Links, pose: Array) -> Array:
    """Violations (..., rows) of constraints, then of gears, of poses (..., links + 1, 3)."""
    rows = _violation_rows(links, pose)
    if not links.gears:
        return rows.reshape(*rows.shape[:-2], -1)
    turns = [
        (pose[..., gear.a, 2] - gear.ratio * pose[..., gear.b, 2] + gear.phase)[..., None]
        for gear in links.gears
    ]
    return np.concatenate([rows.reshape(*rows.shape[:-2], -1), *turns], axis=-1)


def constraint_violations(links: Links, pose: Array) -> Array:
    """Constraint violation [m] of each constraint (..., holds), of poses (..., links + 1, 3).

    It is the distance between the anchors of a pin, and the distance across the axis of a slide.
    """
    rows = _violation_rows(links, pose)
    return np.where(links.table.slides, np.abs(rows[..., 0]), np.linalg.norm(rows, axis=-1))


def joint_value(joint: LinkJoint, pose: Array) -> Array:
    """A joint's coordinate [rad or m] (...), continuous from its value in the start pose."""
    constraint = joint.constraint
    if constraint.axis is None:
        return joint.value + joint.sign * (pose[..., constraint.b, 2] - pose[..., constraint.a, 2])
    axis = rotate(pose[..., constraint.a, 2], constraint.axis)
    return joint.value + (axis * anchor_offset(constraint, pose)).sum(-1)


def spring_length(spring: LinkSpring, pose: Array) -> Array:
    """Length of a spring between points [m] (...), of poses (..., links + 1, 3)."""
    return np.asarray(np.sqrt((anchor_offset(spring, pose) ** 2).sum(-1)))


def spring_line(spring: LinkSpring, pose: Array) -> tuple[Array, Array]:
    """The unit vector (..., 2) from end a to end b of a spring between points, and its length [m].

    The vector is 0 where the length is 0.
    """
    length = spring_length(spring, pose)
    return anchor_offset(spring, pose) / np.where(length > 0, length, 1.0)[..., None], length


def damping(links: Links) -> tuple[Array, Callable[[Array], Array]]:
    """Damping coefficients (dampers,), and the function of the coordinates that they damp.

    The dampers are those of all joints, then those of springs between points.  The function takes
    poses (..., links + 1, 3) and returns joint values and lengths (..., dampers) [rad or m].
    """
    springs = tuple(spring for spring in links.springs if spring.damping)

    def damped(pose: Array) -> Array:
        lengths = [spring_length(spring, pose)[..., None] for spring in springs]
        return np.concatenate([joint_values(links, pose), *lengths], axis=-1)

    coefficients = [joint.damping for joint in links.joints]
    return np.array([*coefficients, *(spring.damping for spring in springs)]), damped


def values_of(joints: tuple[LinkJoint, ...], pose: Array) -> Array:
    """Coordinates (..., joints) [rad or m] of given joints, of poses (..., links + 1, 3)."""
    found = np.empty((*pose.shape[:-2], len(joints)), pose.dtype)
    for k, joint in enumerate(joints):
        found[..., k] = joint_value(joint, pose)
    return found


def joint_values(links: Links, pose: Array) -> Array:
    """Coordinates (..., joints) [rad or m] of all joints, of poses (..., links + 1, 3)."""
    return _table_values(links.joint_table, pose)


def drive_values(links: Links, pose: Array) -> Array:
    """Coordinates (..., drives) [rad or m] of the driven joints, of poses (..., links + 1, 3)."""
    return _table_values(links.drive_table, pose)


def _table_values(table: JointTable, pose: Array) -> Array:
    """Coordinates (..., joints) [rad or m] of the joints of a table."""
    turns = table.sign * (pose[..., table.b, 2] - pose[..., table.a, 2])
    if table.has_slides:
        axes = rotate(pose[..., table.a, 2], table.axis)
        turns = np.where(table.slides, (axes * anchor_offset(table, pose)).sum(-1), turns)
    return np.asarray(table.value + turns)


def constraint_values(links: Links, pose: Array) -> Array:
    """All prescribed functions of the pose (..., rows + drives): residual, then drive values."""
    return np.concatenate([residual(links, pose), drive_values(links, pose)], axis=-1)


def derivative_along(function: Callable[[Array], Array], pose: Array, velocity: Array) -> Array:
    """Derivative of a function of the pose in the direction of a velocity, by a complex step."""
    return np.imag(function(pose + 1j * COMPLEX_STEP * velocity)) / COMPLEX_STEP


def jacobian(function: Callable[[Array], Array], pose: Array) -> Array:
    """Derivatives (..., 3 links) of a function of one pose by the links' coordinates."""
    size = 3 * (len(pose) - 1)
    units = np.zeros((size, *pose.shape))
    units.reshape(size, -1)[:, :size] = np.eye(size)
    return np.moveaxis(derivative_along(function, pose, units), 0, -1)


DETERMINED_RANK_TOLERANCE = 1e-9
"""Share of the largest singular value below which constraints and drives depend on each other."""


def is_determined(links: Links) -> bool:
    """Whether constraints and drives determine the motion of all links at the start pose."""
    rows = jacobian(lambda p: constraint_values(links, p), links.pose)
    scaled, _ = scale_rows(links, rows, np.zeros(len(rows)))
    rank = np.linalg.matrix_rank(scaled, rtol=DETERMINED_RANK_TOLERANCE)
    return bool(rank == rows.shape[1])


def least_move(links: Links, rows: Array, wanted: Array) -> Array:
    """The smallest move (3 links,) that solves ``rows move = wanted``.

    Its size is measured with lengths as shares of the extent.
    """
    rows, wanted = scale_rows(links, rows, wanted)
    return np.asarray(np.linalg.lstsq(rows, wanted, rcond=1e-12)[0] * links.sizes)


def scale_rows(links: Links, rows: Array, wanted: Array) -> tuple[Array, Array]:
    """Scale a linear system of moves: unknowns as shares of `Links.sizes`, rows of length one.

    The solution is then accurate whatever the ratio of lengths to radians is.
    """
    rows = rows * links.sizes
    lengths = np.linalg.norm(rows, axis=1)
    lengths[lengths == 0] = 1.0
    return rows / lengths[:, None], wanted / lengths


def potential(links: Links, pose: Array) -> Array:
    """Energy [J] (...) of gravity, springs, servos and loads, with the masses of the links.

    Loads that follow their links have no potential.  Here such a load keeps the direction that it
    has in the real part of the pose, so that a derivative by a complex step is minus its work.
    """
    energy = -(pose[..., :-1, :2] * links.weight).sum((-1, -2))
    energy = energy + links.joint_table.energy(joint_values(links, pose))
    for spring in links.springs:
        energy = energy + spring.energy(spring_length(spring, pose))
    for pull in links.pulls:
        body = pose[..., pull.link, :]
        point = body[..., :2] + rotate(body[..., 2], pull.at)
        force = force_of(pull, np.real(pose))
        energy = energy - (point * force).sum(-1) - pull.moment * body[..., 2]
    return energy


def force_of(pull: LinkLoad, pose: Array) -> Array:
    """The force [N] of a load in poses (..., links + 1, 3)."""
    return rotate(pose[..., pull.link, 2], pull.force) if pull.follows else pull.force


MAX_DRIVE_MOVE = 0.05
"""Largest move of a drive [rad, or extents] between two poses, so that the branch is kept."""
OPEN_LOOP_TOLERANCE = 1e-9
"""Largest constraint violation [extents or radians] and largest error of a drive [extents or
radians] of a pose that counts as closed."""


def drive_stages(links: Links, now: Array, then: Array) -> Array:
    """Values of the drives (stages, drives) on the way from `now` to `then`.

    They differ by at most `MAX_DRIVE_MOVE`.  The values `now` are not among them.
    """
    scale = [1.0 if joint.constraint.axis is None else links.extent for joint in links.drives]
    count = int(np.max(abs(then - now) / scale, initial=0.0) / MAX_DRIVE_MOVE) + 1
    return np.linspace(now, then, count + 1)[1:] if count > 1 else then[None]


def close_loops(links: Links, pose: Array, drives: Array, remainder: Array | float = 0.0) -> Array:
    """Move a pose by Newton's method until all constraints hold and the drives have their values.

    Parameters
    ----------
    links : Links
    pose : ndarray (links + 1, 3) [m, m, rad]
    drives : ndarray (drives,)
        Values [rad or m] of the driven joints; approached in moves of at most `MAX_DRIVE_MOVE`.
    remainder : ndarray (rows + drives,), optional
        Violation of each constraint and error of each drive that is to remain [m or rad].

    Returns
    -------
    ndarray (links + 1, 3) [m, m, rad]

    Raises
    ------
    BadModel
        The loops cannot be closed at these values.
    """
    for stage in drive_stages(links, drive_values(links, pose), drives):
        pose = _close_by_newton(links, pose, stage, remainder)
    return pose


def _close_by_newton(links: Links, pose: Array, drives: Array, remainder: Array | float) -> Array:
    """Newton's method of `close_loops`, for one stage of the drives."""
    best, best_size = pose, np.inf
    for _ in range(40):
        error = constraint_errors(links, pose, drives) - remainder
        size = np.abs(error / links.bounds).max(initial=0.0)
        if not size < best_size:
            break
        best, best_size = pose, size
        step = least_move(links, jacobian(lambda p: constraint_values(links, p), pose), error)
        pose = pose - np.append(step, np.zeros(3)).reshape(pose.shape)
    if best_size > OPEN_LOOP_TOLERANCE:
        violation = _least_violation(links, best, drives)
        raise BadModel(
            f"the loops cannot be closed at {format_drives(links, drives) or 'the start'}"
            + (
                f", open by {violation:.2g} m"
                if violation > OPEN_LOOP_TOLERANCE * links.extent
                else ": a singular pose before it"
            )
        )
    return best


def format_drives(links: Links, drives: Array) -> str:
    """Names and values of the drives in words, such as ``crank = 0.5``."""
    return ", ".join(f"{j.name} = {v:.6g}" for j, v in zip(links.drives, drives, strict=True))


def constraint_errors(links: Links, pose: Array, drives: Array) -> Array:
    """Violations of all constraints, then errors of the drives (..., rows + drives).

    The errors are the drives' values in the poses (..., links + 1, 3) less the values `drives`.
    """
    error = constraint_values(links, pose)
    error[..., error.shape[-1] - len(drives) :] -= drives
    return error


def _least_violation(links: Links, pose: Array, drives: Array) -> float:
    """Smallest possible constraint violation [m] of the loops, for the values of the drives.

    The joints of the tree and the drives have 1e4 times the weight of the loops in a least-squares
    fit.
    """
    if not np.isfinite(pose).all():
        return np.inf
    tree = links.joint_rows
    weight = 1e4 / links.bounds
    weight[tree : tree + 2 * len(links.loops)] /= 1e4
    ground = pose[-1:]

    def moved(flat: Array) -> Array:
        return np.vstack([(links.sizes * flat).reshape(-1, 3), ground])

    from scipy.optimize import least_squares  # slow to load

    fit = least_squares(
        lambda flat: weight * constraint_errors(links, moved(flat), drives),
        pose[:-1].ravel() / links.sizes,
        xtol=1e-12,
        ftol=1e-12,
        gtol=1e-12,
    )
    return float(constraint_violations(links, moved(fit.x)).max())


def energy_gradient(links: Links, pose: Array, pull: Array, stops: tuple[LinkJoint, ...]) -> Array:
    """Gradient of ``V - pull . g`` with respect to the coordinates of poses (..., links + 1, 3).

    V is the `potential`, and g are the constraints, gears, drives and joints on their limits, so
    that `pull` are the Lagrange multipliers.  Each constraint has a force u between its anchors and
    a moment t between its links:

        d/dp_b = u                              d/dp_a = -u
        d/da_b = t + u . R'(a_b) on_b           d/da_a = -t - u . R'(a_a) on_a + u' . apart

    Here apart is the vector from the anchor on a to that on b.  The term with u' is present for a
    slide only, whose u rotates with the first link.

    Parameters
    ----------
    links : Links
    pose : ndarray (..., links + 1, 3) [m, m, rad]
    pull : ndarray (rows,)
        Forces of the constraints, gears, drives and joints on their limits [N or N m].
    stops : tuple of LinkJoint
        The joints that are on their limits.
    """
    table, count = links.table, len(links.table.a)
    force, moment = _constraint_forces(links, pose, pull, stops)
    ends = pose.take(table.ends, axis=-2)
    points = rotate(ends[..., 2], table.on_ends)
    on_b = moment + cross(points[..., :count, :], force)
    on_a = moment + cross(points[..., count:, :], force)
    if table.has_slides:
        points += ends[..., :2]
        on_a += cross(points[..., :count, :] - points[..., count:, :], force) * table.slides
    first, second = links.incidence
    found = np.zeros_like(pose)
    found[..., :2] = (second - first).T @ force
    found[..., 2] = on_b @ second - on_a @ first
    found[..., :-1, :2] -= links.weight
    for gear, moment in zip(links.gears, pull[2 * len(links.holds) : links.rows], strict=True):
        found[..., gear.a, 2] -= moment
        found[..., gear.b, 2] += gear.ratio * moment
    for spring in links.springs:
        way, length = spring_line(spring, pose)
        force = spring.push(length)[..., None] * way
        for link, on, sign in ((spring.a, spring.on_a, 1.0), (spring.b, spring.on_b, -1.0)):
            found[..., link, :2] += sign * force
            found[..., link, 2] += sign * cross(rotate(pose[..., link, 2], on), force)
    for load in links.pulls:
        arm, force = rotate(pose[..., load.link, 2], load.at), force_of(load, pose)
        found[..., load.link, :2] -= force
        found[..., load.link, 2] -= cross(arm, force) + load.moment
    return found


def _constraint_forces(
    links: Links, pose: Array, pull: Array, stops: tuple[LinkJoint, ...]
) -> tuple[Array, Array]:
    """Force (..., holds, 2) [N] and moment (..., holds) [N m] of each constraint.

    They are those of `energy_gradient`, and contain the springs and loads of the joints as well as
    the forces `pull`.
    """
    table, slides, rows = links.table, links.table.slides, links.rows
    forces = np.zeros((*pose.shape[:-2], len(links.holds)))
    forces[..., : len(links.joints)] = -links.joint_table.joint_forces(joint_values(links, pose))
    for pushed, push in zip([*links.drives, *stops], pull[rows:].tolist(), strict=True):
        forces[..., next(k for k, one in enumerate(links.joints) if one is pushed)] -= push
    held = -pull[: 2 * len(links.holds)].reshape(-1, 2)
    signs = np.append(links.joint_table.sign, np.zeros(len(links.loops)))
    if not table.has_slides:
        return np.broadcast_to(held, (*forces.shape, 2)), signs * forces
    axis = rotate(pose[..., table.a, 2], table.axis)
    sliding = held[:, :1] * (axis @ QUARTER_TURN) + forces[..., None] * axis
    return (np.where(slides[:, None], sliding, held), np.where(slides, held[:, 1], signs * forces))


GRADIENT_STEP = 1e-4
"""Displacement for differences of the energy's gradient [extents or radians]."""


@dataclass(frozen=True)
class Modes:
    """Free motions of a pose that are uncoupled in the energy to second order: natural modes.

    Attributes
    ----------
    pose : ndarray (links + 1, 3) [m, m, rad]
    shapes : ndarray (n, links + 1, 3)
        Moves of unit modal mass [SI].
    squares : ndarray (n,)
        Curvatures of the energy along the moves: squares of their angular frequencies [1/s^2].
    twist : ndarray (n, n)
        Antisymmetric part of the matrix of curvatures, from loads that follow their links
        [1/s^2].
    pull : ndarray (rows,)
        Forces of the constraints, gears, drives, then of the joints on their limits [N or N m].
    stops : tuple of LinkJoint
        The joints that are on their limits.
    """

    pose: Array
    shapes: Array
    squares: Array
    twist: Array
    pull: Array
    stops: tuple[LinkJoint, ...]

    def gradient_change(self, links: Links, pose: Array, move: Array) -> Array:
        """Increase (n,) of the energy's gradient along each mode by a move from a pose."""
        there, here = energy_gradient(links, np.stack([pose + move, pose]), self.pull, self.stops)
        return self.of(there - here)

    def of(self, push: Array) -> Array:
        """Scalar products (n,) of the modes with forces or momenta of the links (links + 1, 3)."""
        return np.asarray(np.einsum("nlk,lk->n", self.shapes, push))

    def sum(self, parts: Array) -> Array:
        """The move (links + 1, 3) that consists of given amplitudes (n,) of the modes."""
        return np.asarray(np.einsum("n,nlk->lk", parts, self.shapes))


def free_directions(links: Links, rows: Array) -> Array:
    """Moves (n, links + 1, 3) of unit mass that violate no constraint to first order.

    `rows` is the Jacobian (rows, 3 links) of the constraints.
    """
    return _unscale_moves(links, _split_by_rows(links, rows)[0])


MIN_INDEPENDENT_PART = 1e-6
"""Smallest component of a row of unit length that is orthogonal to the rows before it, with which
the rows count as independent, so that a QR decomposition gives their rank."""


def _split_by_rows(links: Links, rows: Array, load: Array | None = None) -> tuple[Array, Array]:
    """The null space (n, 3 links) of rows, and the forces (rows,) whose sum of rows is a load.

    The null space is given in coordinates times the square roots of their masses.  The forces solve
    ``rows^T forces = load`` in the least squares sense of these coordinates, and are the smallest
    ones if rows are dependent.  Rows that are clearly independent are split by a QR decomposition,
    which takes less time than singular values.
    """
    rows = rows / _root_masses(links)
    lengths = np.linalg.norm(rows, axis=1)
    rows = rows / np.where(lengths == 0, 1.0, lengths)[:, None]
    load, count = np.zeros(rows.shape[1]) if load is None else load / _root_masses(links), len(rows)
    q, r = np.linalg.qr(rows.T, mode="complete")
    if np.abs(np.diagonal(r)).min(initial=1.0) > MIN_INDEPENDENT_PART and count <= rows.shape[1]:
        return q[:, count:].T, np.linalg.solve(r[:count], q[:, :count].T @ load) / lengths
    _, sizes, modes = np.linalg.svd(rows)
    rank = int((sizes > 1e-9 * sizes.max(initial=0.0)).sum())
    pull = np.linalg.lstsq((rows * lengths[:, None]).T, load, rcond=1e-12)[0]
    return modes[rank:], np.asarray(pull, float)


def _unscale_moves(links: Links, directions: Array) -> Array:
    """Moves (n, links + 1, 3) of directions that are given times the square roots of the masses."""
    moves = (directions / _root_masses(links)).reshape(-1, len(links.mass), 3)
    return np.pad(moves, ((0, 0), (0, 1), (0, 0)))


def find_modes(links: Links, pose: Array, stops: tuple[LinkJoint, ...]) -> Modes:
    """The modes of a pose (links + 1, 3) whose joints `stops` stay on their limits.

    The curvature is that of ``V - pull . g``, see `energy_gradient`.  It includes the curvature of
    the paths on which the constraints g stay satisfied.
    """
    moves, pull = _free_motions_and_forces(links, pose, stops)
    rise, size = _gradient_differences(links, pose, moves, pull, stops)
    flat = moves.reshape(len(moves), pose.size)
    curvature = rise.reshape(flat.shape) @ flat.T * size[:, None]
    squares, modes = np.linalg.eigh((curvature + curvature.T) / (4 * GRADIENT_STEP))
    twist = modes.T @ (curvature.T - curvature) @ modes / (4 * GRADIENT_STEP)
    twist *= any(load.follows for load in links.pulls)
    return Modes(pose, (modes.T @ flat).reshape(moves.shape), squares, twist, pull, stops)


def gradient_changes(links: Links, pose: Array, moves: Array) -> Array:
    """Change (n, links + 1, 3) of the gradient of ``V - pull . g`` by each of some moves.

    The moves (n, links + 1, 3) start from a pose at rest; see `energy_gradient`.
    """
    _, pull = _free_motions_and_forces(links, pose, ())
    rise, size = _gradient_differences(links, pose, moves, pull, ())
    return np.asarray(rise * (size / (2 * GRADIENT_STEP))[:, None, None])


def _free_motions_and_forces(
    links: Links, pose: Array, stops: tuple[LinkJoint, ...]
) -> tuple[Array, Array]:
    """`free_directions` of a pose at rest, and the forces (rows,) of its constraints."""
    rows = jacobian(partial(_all_constraint_values, links, stops), pose)
    load = energy_gradient(links, pose, np.zeros(len(rows)), stops)[:-1].ravel()
    directions, pull = _split_by_rows(links, rows, load)
    return _unscale_moves(links, directions), pull


def _gradient_differences(
    links: Links, pose: Array, moves: Array, pull: Array, stops: tuple[LinkJoint, ...]
) -> tuple[Array, Array]:
    """Differences of the gradient along moves, by `GRADIENT_STEP` in each direction.

    Returns the differences (n, links + 1, 3) and the sizes (n,) of the moves.
    """
    size = move_sizes(links, moves)
    nudge = moves * (GRADIENT_STEP / size)[:, None, None]
    ahead, behind = energy_gradient(links, pose + np.stack([nudge, -nudge]), pull, stops)
    return ahead - behind, size


def move_sizes(links: Links, moves: Array) -> Array:
    """Largest component [extents or radians] of each of some moves (..., links + 1, 3)."""
    return np.asarray(np.abs(moves / links.scale).max(axis=(-2, -1)))


def _all_constraint_values(links: Links, stops: tuple[LinkJoint, ...], pose: Array) -> Array:
    """All prescribed functions of the pose, then the values of the joints on their limits."""
    return np.concatenate([constraint_values(links, pose), values_of(stops, pose)], axis=-1)


def _root_masses(links: Links) -> Array:
    """Square roots (3 links,) of the masses and moments of inertia of all coordinates."""
    return np.asarray(np.sqrt(links.inertia[:-1]).ravel())
