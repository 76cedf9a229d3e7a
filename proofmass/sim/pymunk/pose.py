"""Holds, joints and energy as functions of the links' poses (..., links + 1, 3).

Derivatives are complex steps (value at ``pose + i h direction``): exact to rounding.
"""

from collections.abc import Callable

import numpy as np

from proofmass.analytic.numerics import Array
from proofmass.sim.pymunk.links import Hold, Joint, Links, Table

STEP = 1e-30
QUARTER = np.array([[0.0, 1.0], [-1.0, 0.0]])
"""Turns row vectors by a quarter turn."""


def turned(angle: Array, vector: Array) -> Array:
    """Vectors (..., 2) turned by angles (...), as (..., 2)."""
    c, s = np.cos(angle), np.sin(angle)
    x, y = vector[..., 0], vector[..., 1]
    across = c * x - s * y
    found = np.empty((*np.shape(across), 2), across.dtype)  # a third of the time of `np.stack`
    found[..., 0], found[..., 1] = across, s * x + c * y
    return found


def apart(hold: Hold | Table, pose: Array) -> Array:
    """Vector from the anchor on a to the anchor on b, for poses (..., links + 1, 3)."""
    a, b = pose[..., hold.a, :], pose[..., hold.b, :]
    return b[..., :2] + turned(b[..., 2], hold.on_b) - a[..., :2] - turned(a[..., 2], hold.on_a)


def _rows(links: Links, pose: Array) -> Array:
    """How far each hold is from held (..., holds, 2): both ways, or across a slide and turned."""
    table = links.table
    rows, slides = apart(table, pose), table.slides
    if slides.any():
        a, b = pose[..., table.a[slides], 2], pose[..., table.b[slides], 2]
        across = turned(a, table.axis[slides] @ QUARTER)
        rows[..., slides, :] = np.stack([(across * rows[..., slides, :]).sum(-1), b - a], axis=-1)
    return rows


def residual(links: Links, pose: Array) -> Array:
    """How far all holds are from held (..., rows), of poses (..., links + 1, 3)."""
    rows = _rows(links, pose)
    return rows.reshape(*rows.shape[:-2], -1)


def gaps(links: Links, pose: Array) -> Array:
    """Distance by which each hold is open [m] (..., holds), of poses (..., links + 1, 3)."""
    rows = _rows(links, pose)
    return np.where(links.table.slides, np.abs(rows[..., 0]), np.linalg.norm(rows, axis=-1))


def joint_value(joint: Joint, pose: Array) -> Array:
    """A joint's coordinate [rad or m] (...), continuous from its value in the start pose."""
    hold = joint.hold
    if hold.axis is None:
        return joint.value + joint.sign * (pose[..., hold.b, 2] - pose[..., hold.a, 2])
    along = turned(pose[..., hold.a, 2], hold.axis)
    return joint.value + (along * apart(hold, pose)).sum(-1)


def values(joints: tuple[Joint, ...], pose: Array) -> Array:
    """The coordinates of some joints (..., joints), of poses (..., links + 1, 3)."""
    columns = [joint_value(joint, pose)[..., None] for joint in joints]
    return np.concatenate([np.zeros((*pose.shape[:-2], 0)), *columns], axis=-1)


def bound(links: Links, pose: Array) -> Array:
    """All that is prescribed (..., rows + drives): the residual, then the drives' values."""
    return np.concatenate([residual(links, pose), values(links.drives, pose)], axis=-1)


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
    """Energy [J] (...) of gravity, joint springs and loads, as the engine's links carry it."""
    weight = links.mass[:, None] * links.gravity
    energy = -(pose[..., :-1, :2] * weight).sum((-1, -2))
    for joint in links.joints:
        value = joint_value(joint, pose)
        energy = energy + joint.spring_energy(value) - joint.load * value
    for pull in links.pulls:
        body = pose[..., pull.link, :]
        point = body[..., :2] + turned(body[..., 2], pull.at)
        energy = energy - point @ pull.force - pull.moment * body[..., 2]
    return energy
