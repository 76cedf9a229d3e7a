"""Holds, joints and energy as functions of the links' poses (..., links + 1, 3).

Derivatives are complex steps (value at ``pose + i h direction``): exact to rounding.
"""

from collections.abc import Callable

import numpy as np

from sim.protocol import Array
from sim.pymunk_links import Hold, Joint, Links

STEP = 1e-30


def turned(angle: Array, vector: Array) -> Array:
    """A vector (2,) turned by angles (...), as (..., 2)."""
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([c * vector[0] - s * vector[1], s * vector[0] + c * vector[1]], axis=-1)


def _apart(hold: Hold, pose: Array) -> Array:
    """Vector from the anchor on a to the anchor on b, for poses (..., links + 1, 3)."""
    a, b = pose[..., hold.a, :], pose[..., hold.b, :]
    return b[..., :2] + turned(b[..., 2], hold.on_b) - a[..., :2] - turned(a[..., 2], hold.on_a)


def _rows(hold: Hold, pose: Array) -> Array:
    apart = _apart(hold, pose)
    if hold.axis is None:
        return apart
    across = turned(pose[..., hold.a, 2], np.array([-hold.axis[1], hold.axis[0]]))
    return np.stack([(across * apart).sum(-1), pose[..., hold.b, 2] - pose[..., hold.a, 2]], -1)


def residual(links: Links, pose: Array) -> Array:
    """How far all holds are from held (..., rows), of poses (..., links + 1, 3)."""
    return np.concatenate([_rows(hold, pose) for hold in links.holds], axis=-1)


def gaps(links: Links, pose: Array) -> Array:
    """Distance by which each hold is open [m] (..., holds), of poses (..., links + 1, 3)."""
    open_by = []
    for hold in links.holds:
        rows = _rows(hold, pose)
        open_by.append(np.linalg.norm(rows, axis=-1) if hold.axis is None else abs(rows[..., 0]))
    return np.stack(open_by, axis=-1)


def joint_value(joint: Joint, pose: Array) -> Array:
    """A joint's coordinate [rad or m] (...), continuous from its value in the start pose."""
    hold = joint.hold
    if hold.axis is None:
        return joint.value + joint.sign * (pose[..., hold.b, 2] - pose[..., hold.a, 2])
    along = turned(pose[..., hold.a, 2], hold.axis)
    return joint.value + (along * _apart(hold, pose)).sum(-1)


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


def potential(links: Links, pose: Array) -> Array:
    """Energy [J] (...) of gravity, joint springs and loads, as the engine's links carry it."""
    weight = links.mass[:, None] * links.gravity
    energy = -(pose[..., :-1, :2] * weight).sum((-1, -2))
    for joint in links.joints:
        value = joint_value(joint, pose)
        energy = energy + joint.spring_energy(value) - joint.load * value
    return energy
