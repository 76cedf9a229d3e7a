"""Holds, joints and energy as functions of the links' poses (..., links + 1, 3).

Derivatives are complex steps (value at ``pose + i h direction``): exact to rounding.  Only the
slope of the energy is written out, since chains of many links need it in each free motion.  Loops
are closed in a pose, or the error says by how much they miss; a pose has free motions with its
drives held, on the stops that its joints are pressed on.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from proofmass.analytic.numerics import Array
from proofmass.sim.protocol import BadModel
from proofmass.sim.pymunk.links import (
    QUARTER,
    Hold,
    HoldTable,
    JointTable,
    LinkJoint,
    Links,
    LinkSpring,
    Pull,
)

STEP = 1e-30


def turned(angle: Array, vector: Array) -> Array:
    """Vectors (..., 2) turned by angles (...), as (..., 2)."""
    c, s = np.cos(angle), np.sin(angle)
    x, y = vector[..., 0], vector[..., 1]
    across = c * x - s * y
    found = np.empty((*np.shape(across), 2), across.dtype)  # a third of the time of `np.stack`
    found[..., 0], found[..., 1] = across, s * x + c * y
    return found


def cross(one: Array, other: Array) -> Array:
    """The product x v - y u (...) of vectors (x, y) and (u, v), as (..., 2)."""
    return np.asarray(one[..., 0] * other[..., 1] - one[..., 1] * other[..., 0])


def apart(hold: Hold | HoldTable | LinkSpring, pose: Array) -> Array:
    """Vector from the anchor on a to the anchor on b, for poses (..., links + 1, 3)."""
    if isinstance(hold, HoldTable):
        ends = pose.take(hold.ends, axis=-2)
        points, count = turned(ends[..., 2], hold.on_ends), len(hold.a)
        points += ends[..., :2]
        return points[..., :count, :] - points[..., count:, :]
    a, b = pose[..., hold.a, :], pose[..., hold.b, :]
    return b[..., :2] + turned(b[..., 2], hold.on_b) - a[..., :2] - turned(a[..., 2], hold.on_a)


def _rows(links: Links, pose: Array) -> Array:
    """How far each hold is from held (..., holds, 2): both ways, or across a slide and turned."""
    table = links.table
    rows = apart(table, pose)
    if table.slide:
        slides, a, b, across = table.guides
        turns = pose[..., 2]
        from_a = turns[..., a]
        rows[..., slides, 0] = (turned(from_a, across) * rows[..., slides, :]).sum(-1)
        rows[..., slides, 1] = turns[..., b] - from_a
    return rows


def residual(links: Links, pose: Array) -> Array:
    """How far holds, then gears, are from held (..., rows), of poses (..., links + 1, 3)."""
    rows = _rows(links, pose)
    if not links.gears:
        return rows.reshape(*rows.shape[:-2], -1)
    turns = [
        (pose[..., gear.a, 2] - gear.ratio * pose[..., gear.b, 2] + gear.phase)[..., None]
        for gear in links.gears
    ]
    return np.concatenate([rows.reshape(*rows.shape[:-2], -1), *turns], axis=-1)


def gaps(links: Links, pose: Array) -> Array:
    """Distance by which each hold is open [m] (..., holds), of poses (..., links + 1, 3)."""
    rows = _rows(links, pose)
    return np.where(links.table.slides, np.abs(rows[..., 0]), np.linalg.norm(rows, axis=-1))


def joint_value(joint: LinkJoint, pose: Array) -> Array:
    """A joint's coordinate [rad or m] (...), continuous from its value in the start pose."""
    hold = joint.hold
    if hold.axis is None:
        return joint.value + joint.sign * (pose[..., hold.b, 2] - pose[..., hold.a, 2])
    along = turned(pose[..., hold.a, 2], hold.axis)
    return joint.value + (along * apart(hold, pose)).sum(-1)


def spring_length(spring: LinkSpring, pose: Array) -> Array:
    """Length of a spring between points [m] (...), of poses (..., links + 1, 3)."""
    return np.asarray(np.sqrt((apart(spring, pose) ** 2).sum(-1)))


def spring_line(spring: LinkSpring, pose: Array) -> tuple[Array, Array]:
    """The unit vector (..., 2) from end to end of a spring between points, and its length [m].

    Of no length the vector is 0.
    """
    length = spring_length(spring, pose)
    return apart(spring, pose) / np.where(length > 0, length, 1.0)[..., None], length


def damping(links: Links) -> tuple[Array, Callable[[Array], Array]]:
    """Coefficients (dampers,) of joints, then of springs between points, and what they damp.

    The latter is a function of poses (..., links + 1, 3): values and lengths (..., dampers).
    """
    springs = tuple(spring for spring in links.springs if spring.damping)

    def damped(pose: Array) -> Array:
        lengths = [spring_length(spring, pose)[..., None] for spring in springs]
        return np.concatenate([joint_values(links, pose), *lengths], axis=-1)

    coefficients = [joint.damping for joint in links.joints]
    return np.array([*coefficients, *(spring.damping for spring in springs)]), damped


def values(joints: tuple[LinkJoint, ...], pose: Array) -> Array:
    """The coordinates of some joints (..., joints), of poses (..., links + 1, 3)."""
    found = np.empty((*pose.shape[:-2], len(joints)), pose.dtype)
    for k, joint in enumerate(joints):
        found[..., k] = joint_value(joint, pose)
    return found


def joint_values(links: Links, pose: Array) -> Array:
    """The coordinates of all joints (..., joints), of poses (..., links + 1, 3)."""
    return _tabled(links.joint_table, pose)


def drive_values(links: Links, pose: Array) -> Array:
    """The coordinates of the driven joints (..., drives), of poses (..., links + 1, 3)."""
    return _tabled(links.drive_table, pose)


def _tabled(table: JointTable, pose: Array) -> Array:
    """The coordinates of the joints of a table (..., joints)."""
    turns = table.sign * (pose[..., table.b, 2] - pose[..., table.a, 2])
    if table.slide:
        axes = turned(pose[..., table.a, 2], table.axis)
        turns = np.where(table.slides, (axes * apart(table, pose)).sum(-1), turns)
    return np.asarray(table.value + turns)


def bound(links: Links, pose: Array) -> Array:
    """All that is prescribed (..., rows + drives): the residual, then the drives' values."""
    return np.concatenate([residual(links, pose), drive_values(links, pose)], axis=-1)


def along(function: Callable[[Array], Array], pose: Array, velocity: Array) -> Array:
    """Derivative of a function of the pose along a velocity."""
    return np.imag(function(pose + 1j * STEP * velocity)) / STEP


def jacobian(function: Callable[[Array], Array], pose: Array) -> Array:
    """Derivatives of a function of one pose with respect to the links' coordinates."""
    size = 3 * (len(pose) - 1)
    units = np.zeros((size, *pose.shape))
    units.reshape(size, -1)[:, :size] = np.eye(size)
    return np.moveaxis(along(function, pose, units), 0, -1)


def least(links: Links, rows: Array, wanted: Array) -> Array:
    """The least move (3 links,) by which rows change as wanted, lengths as shares of the extent."""
    rows, wanted = alike(links, rows, wanted)
    return np.asarray(np.linalg.lstsq(rows, wanted, rcond=1e-12)[0] * links.sizes)


def alike(links: Links, rows: Array, wanted: Array) -> tuple[Array, Array]:
    """Rows of a linear system of moves as shares of their sizes, all of them of length one.

    So that nothing is lost between radians and lengths of any size.
    """
    rows = rows * links.sizes
    long = np.linalg.norm(rows, axis=1)
    long[long == 0] = 1.0
    return rows / long[:, None], wanted / long


def potential(links: Links, pose: Array) -> Array:
    """Energy [J] (...) of gravity, springs, servos and loads, as the engine's links carry it.

    Loads that follow their links have no potential.  Here they keep the direction that they have in
    the real part of the pose, so that derivatives by complex steps are those of their work.
    """
    energy = -(pose[..., :-1, :2] * links.weight).sum((-1, -2))
    energy = energy + links.joint_table.energy(joint_values(links, pose))
    for spring in links.springs:
        energy = energy + spring.energy(spring_length(spring, pose))
    for pull in links.pulls:
        body = pose[..., pull.link, :]
        point = body[..., :2] + turned(body[..., 2], pull.at)
        force = force_of(pull, np.real(pose))
        energy = energy - (point * force).sum(-1) - pull.moment * body[..., 2]
    return energy


def force_of(pull: Pull, pose: Array) -> Array:
    """The force [N] of a load in poses (..., links + 1, 3)."""
    return turned(pose[..., pull.link, 2], pull.force) if pull.follows else pull.force


MOVE = 0.05
"""Largest move of a drive [rad, or extents] between two poses, so that a branch is kept."""
CLOSED = 1e-9
"""Gap [extents] and miss of a drive [extents or radians] of a pose that is closed."""


def stages(links: Links, now: Array, then: Array) -> Array:
    """Values of the drives (stages, drives) on the way to new ones, in moves of at most MOVE."""
    scale = [1.0 if joint.hold.axis is None else links.extent for joint in links.drives]
    count = int(np.max(abs(then - now) / scale, initial=0.0) / MOVE) + 1
    return np.linspace(now, then, count + 1)[1:] if count > 1 else then[None]


def close(links: Links, pose: Array, drives: Array, rest: Array | float = 0.0) -> Array:
    """Move a pose by Newton until all holds are closed and the drives have their values.

    Parameters
    ----------
    links : Links
    pose : ndarray (links + 1, 3) [m, m, rad]
    drives : ndarray (drives,)
        Values [rad or m] of the driven joints; approached in moves of at most `MOVE`.
    rest : ndarray (rows + drives,), optional
        What is to remain of each hold and drive [m or rad].

    Returns
    -------
    ndarray (links + 1, 3) [m, m, rad]

    Raises
    ------
    BadModel
        The loops cannot be closed here.
    """
    for stage in stages(links, drive_values(links, pose), drives):
        pose = _newton(links, pose, stage, rest)
    return pose


def chain_at(links: Links, drives: Array) -> Array:
    """The start pose (links + 1, 3) of links without loops, with the driven joints at other values.

    All other joints keep theirs: what hangs on a driven joint goes with it.
    """
    pose, ways = links.pose.copy(), np.zeros(len(links.joints))
    ways[list(links.driven)] = drives - drive_values(links, links.pose)
    for joint, way in zip(links.joints, ways.tolist(), strict=True):
        hold = joint.hold
        if not joint.holds:
            continue
        place, angle = pose[hold.a, :2], pose[hold.a, 2]
        on_a = hold.on_a
        if hold.axis is None:
            pose[hold.b, 2] = angle + joint.sign * way
        else:
            pose[hold.b, 2], on_a = angle, on_a + way * hold.axis
        anchor = place + turned(angle, on_a)
        pose[hold.b, :2] = anchor - turned(pose[hold.b, 2], hold.on_b)
    return pose


def _newton(links: Links, pose: Array, drives: Array, rest: Array | float) -> Array:
    best, off = pose, np.inf
    for _ in range(40):
        error = missing(links, pose, drives) - rest
        size = np.abs(error / links.bounds).max(initial=0.0)
        if not size < off:
            break
        best, off = pose, size
        step = least(links, jacobian(lambda p: bound(links, p), pose), error)
        pose = pose - np.append(step, np.zeros(3)).reshape(pose.shape)
    if off > CLOSED:
        missed = _missed(links, best, drives)
        raise BadModel(
            f"the loops cannot be closed at {named(links, drives) or 'the start'}"
            + (
                f", open by {missed:.2g} m"
                if missed > CLOSED * links.extent
                else ": a singular pose before it"
            )
        )
    return best


def named(links: Links, drives: Array) -> str:
    """Values of the drives with their names."""
    return ", ".join(f"{j.name} = {v:.6g}" for j, v in zip(links.drives, drives, strict=True))


def missing(links: Links, pose: Array, drives: Array) -> Array:
    """How far all that is prescribed is from held (..., rows + drives), of some poses."""
    error = bound(links, pose)
    error[..., error.shape[-1] - len(drives) :] -= drives
    return error


def _missed(links: Links, pose: Array, drives: Array) -> float:
    """The gap [m] of the loops at their closest, with joints and drives held."""
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
        lambda flat: weight * missing(links, moved(flat), drives),
        pose[:-1].ravel() / links.sizes,
        xtol=1e-12,
        ftol=1e-12,
        gtol=1e-12,
    )
    return float(gaps(links, moved(fit.x)).max())


def slope(links: Links, pose: Array, pull: Array, stops: tuple[LinkJoint, ...]) -> Array:
    """Derivatives of ``V - pull . held`` by the coordinates of poses (..., links + 1, 3).

    Each hold has a force u between its anchors and a moment t between its links:

        d/dp_b = u                              d/dp_a = -u
        d/da_b = t + u . R'(a_b) on_b           d/da_a = -t - u . R'(a_a) on_a + u' . apart

    with u' where u turns with the first link, along a slide and across it.

    Parameters
    ----------
    links : Links
    pose : ndarray (..., links + 1, 3) [m, m, rad]
    pull : ndarray (rows,)
        Forces in the holds, the gears, the drives and the joints on their stops [N or N m].
    stops : tuple of LinkJoint
        These joints.
    """
    table, count = links.table, len(links.table.a)
    force, moment = _between(links, pose, pull, stops)
    ends = pose.take(table.ends, axis=-2)
    points = turned(ends[..., 2], table.on_ends)
    on_b = moment + cross(points[..., :count, :], force)
    on_a = moment + cross(points[..., count:, :], force)
    if table.slide:
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
            found[..., link, 2] += sign * cross(turned(pose[..., link, 2], on), force)
    for load in links.pulls:
        arm, force = turned(pose[..., load.link, 2], load.at), force_of(load, pose)
        found[..., load.link, :2] -= force
        found[..., load.link, 2] -= cross(arm, force) + load.moment
    return found


def _between(
    links: Links, pose: Array, pull: Array, stops: tuple[LinkJoint, ...]
) -> tuple[Array, Array]:
    """Force (..., holds, 2) and moment (..., holds) of each hold, on its second link."""
    table, slides, rows = links.table, links.table.slides, links.rows
    forces = np.zeros((*pose.shape[:-2], len(links.holds)))
    forces[..., : len(links.joints)] = -links.joint_table.joint_forces(joint_values(links, pose))
    for pushed, push in zip([*links.drives, *stops], pull[rows:].tolist(), strict=True):
        forces[..., next(k for k, one in enumerate(links.joints) if one is pushed)] -= push
    held = -pull[: 2 * len(links.holds)].reshape(-1, 2)
    signs = np.append(links.joint_table.sign, np.zeros(len(links.loops)))
    if not table.slide:
        return np.broadcast_to(held, (*forces.shape, 2)), signs * forces
    axis = turned(pose[..., table.a, 2], table.axis)
    sliding = held[:, :1] * (axis @ QUARTER) + forces[..., None] * axis
    return (np.where(slides[:, None], sliding, held), np.where(slides, held[:, 1], signs * forces))


NUDGE = 1e-4
"""Displacement for differences of the energy's slope, in extents or radians."""


@dataclass(frozen=True)
class Modes:
    """Free motions of a pose, uncoupled to second order in the energy.

    Attributes
    ----------
    pose : ndarray (links + 1, 3) [m, m, rad]
    shapes : ndarray (n, links + 1, 3)
        Moves of unit mass [SI].
    squares : ndarray (n,)
        Curvature of the energy along them: their frequencies squared [1/s^2].
    twist : ndarray (n, n)
        What loads that follow their links add to the matrix of these curvatures, without symmetry
        [1/s^2].
    pull : ndarray (held,)
        What it takes to hold what is held [N or N m]: holds, gears, drives, then the joints on
        their stops.
    stops : tuple of LinkJoint
        These joints.
    """

    pose: Array
    shapes: Array
    squares: Array
    twist: Array
    pull: Array
    stops: tuple[LinkJoint, ...]

    def rise(self, links: Links, pose: Array, move: Array) -> Array:
        """By how much a move from the pose makes the energy's slope along each mode larger."""
        there, here = slope(links, np.stack([pose + move, pose]), self.pull, self.stops)
        return self.of(there - here)

    def of(self, push: Array) -> Array:
        """Products (n,) of the modes with what acts on the links (links + 1, 3)."""
        return np.asarray(np.einsum("nlk,lk->n", self.shapes, push))

    def sum(self, parts: Array) -> Array:
        """Sum (links + 1, 3) of as many parts (n,) of each mode."""
        return np.asarray(np.einsum("n,nlk->lk", parts, self.shapes))


def free_directions(links: Links, rows: Array) -> Array:
    """Moves (n, links + 1, 3) of unit mass that leave what is held as it is, by its Jacobian."""
    return _moves(links, _split(links, rows)[0])


REGULAR = 1e-6
"""Share of a row, of unit length, that lies off those before it: with more, QR tells the rank."""


def _split(links: Links, rows: Array, load: Array | None = None) -> tuple[Array, Array]:
    """Directions (n, 3 links) that rows leave free, and the least pull whose sum of rows is a load.

    Both in coordinates times the roots of their masses. Rows that are far from dependent are split
    by QR, which takes less time than singular values.
    """
    rows = rows / _root(links)
    long = np.linalg.norm(rows, axis=1)
    rows = rows / np.where(long == 0, 1.0, long)[:, None]
    load, count = np.zeros(rows.shape[1]) if load is None else load / _root(links), len(rows)
    q, r = np.linalg.qr(rows.T, mode="complete")
    if np.abs(np.diagonal(r)).min(initial=1.0) > REGULAR and count <= rows.shape[1]:
        return q[:, count:].T, np.linalg.solve(r[:count], q[:, :count].T @ load) / long
    _, sizes, modes = np.linalg.svd(rows)
    rank = int((sizes > 1e-9 * sizes.max(initial=0.0)).sum())
    pull = np.linalg.lstsq((rows * long[:, None]).T, load, rcond=1e-12)[0]
    return modes[rank:], np.asarray(pull, float)


def _moves(links: Links, directions: Array) -> Array:
    """Moves (n, links + 1, 3) of directions in coordinates times the roots of their masses."""
    moves = (directions / _root(links)).reshape(-1, len(links.mass), 3)
    return np.pad(moves, ((0, 0), (0, 1), (0, 0)))


def find_modes(links: Links, pose: Array, stops: tuple[LinkJoint, ...]) -> Modes:
    """The modes of a pose (links + 1, 3) whose joints `stops` stay on their stops.

    The curvature is that of ``V - pull . held``, so that it counts how the paths bend on which
    what is held stays as it is.
    """
    moves, pull = _free_and_pull(links, pose, stops)
    rise, size = _rise(links, pose, moves, pull, stops)
    flat = moves.reshape(len(moves), pose.size)
    bend = rise.reshape(flat.shape) @ flat.T * size[:, None]
    squares, modes = np.linalg.eigh((bend + bend.T) / (4 * NUDGE))
    twist = modes.T @ (bend.T - bend) @ modes / (4 * NUDGE)
    twist *= any(load.follows for load in links.pulls)
    return Modes(pose, (modes.T @ flat).reshape(moves.shape), squares, twist, pull, stops)


def bent(links: Links, pose: Array, moves: Array) -> Array:
    """How moves (n, links + 1, 3) change the slope of ``V - pull . held`` in a pose at rest."""
    _, pull = _free_and_pull(links, pose, ())
    rise, size = _rise(links, pose, moves, pull, ())
    return np.asarray(rise * (size / (2 * NUDGE))[:, None, None])


def _free_and_pull(links: Links, pose: Array, stops: tuple[LinkJoint, ...]) -> tuple[Array, Array]:
    """`free_directions` of a pose at rest, and what it takes to hold what is held."""
    rows = jacobian(partial(_held, links, stops), pose)
    load = slope(links, pose, np.zeros(len(rows)), stops)[:-1].ravel()
    directions, pull = _split(links, rows, load)
    return _moves(links, directions), pull


def _rise(
    links: Links, pose: Array, moves: Array, pull: Array, stops: tuple[LinkJoint, ...]
) -> tuple[Array, Array]:
    """By what the slope rises between `NUDGE` back and ahead along moves, and their sizes (n,)."""
    size = sizes(links, moves)
    nudge = moves * (NUDGE / size)[:, None, None]
    ahead, behind = slope(links, pose + np.stack([nudge, -nudge]), pull, stops)
    return ahead - behind, size


def sizes(links: Links, moves: Array) -> Array:
    """Largest part of each of some moves (..., links + 1, 3), in extents or radians."""
    return np.asarray(np.abs(moves / links.scale).max(axis=(-2, -1)))


def _held(links: Links, stops: tuple[LinkJoint, ...], pose: Array) -> Array:
    return np.concatenate([bound(links, pose), values(stops, pose)], axis=-1)


def _root(links: Links) -> Array:
    """Roots of the masses of all coordinates."""
    return np.asarray(np.sqrt(links.inertia[:-1]).ravel())
