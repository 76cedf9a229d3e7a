"""Holds and joints as functions of the links' poses, and closing the loops of a start pose.

Derivatives are complex steps (value at ``pose + i h direction``): exact to rounding.
"""

from collections.abc import Callable

import numpy as np

from sim.protocol import Array, BadModel
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


def along(function: Callable[[Array], Array], pose: Array, velocity: Array) -> Array:
    """Derivative of a function of the pose along a velocity."""
    return np.imag(function(pose + 1j * STEP * velocity)) / STEP


def jacobian(function: Callable[[Array], Array], pose: Array) -> Array:
    """Derivatives of a function of one pose with respect to the links' coordinates."""
    size = 3 * (len(pose) - 1)
    units = np.zeros((size, *pose.shape))
    units.reshape(size, -1)[:, :size] = np.eye(size)
    return np.moveaxis(along(function, pose, units), 0, -1)


def close(links: Links, pose: Array, drive: tuple[Joint, float] | None = None,
          target: Array | float = 0.0) -> Array:
    """Move a pose by Newton until the holds' residual is the target and the drive at its value.

    Parameters
    ----------
    links : Links
    pose : ndarray (links + 1, 3)
    drive : (Joint, float), optional
        Joint and value [rad] it must have; approached in steps of 0.05 rad.
    target : ndarray (rows,), optional

    Returns
    -------
    ndarray (links + 1, 3)

    Raises
    ------
    BadModel
        The loops cannot be closed here.
    """
    if drive is None:
        return _newton(lambda p: residual(links, p) - target, pose, links.extent)
    joint, value = drive
    now = float(joint_value(joint, pose))
    for part in np.linspace(now, value, int(abs(value - now) / 0.05) + 2)[1:]:
        def error(p: Array, part: float = float(part)) -> Array:
            driven = joint_value(joint, p)[..., None] - part
            return np.concatenate([residual(links, p) - target, driven], axis=-1)

        pose = _newton(error, pose, links.extent)
    return pose


def _newton(function: Callable[[Array], Array], pose: Array, extent: float) -> Array:
    best, least = pose, np.inf
    for _ in range(40):
        error = function(pose)
        size = np.abs(error).max(initial=0.0)
        if not size < least:
            break
        best, least = pose, size
        step = np.linalg.lstsq(jacobian(function, pose), error, rcond=1e-12)[0]
        pose = pose - np.append(step, np.zeros(3)).reshape(pose.shape)
    if least > 1e-9 * max(extent, 1.0):
        raise BadModel(f"the loops cannot be closed at the start: {least:.2g} m remain open")
    return best


def potential(links: Links, pose: Array) -> Array:
    """Energy [J] (...) of gravity and joint springs, as the engine's links carry it."""
    weight = links.mass[:, None] * links.gravity
    energy = -(pose[..., :-1, :2] * weight).sum((-1, -2))
    for joint in links.joints:
        energy = energy + 0.5 * joint.stiffness * (joint_value(joint, pose) - joint.rest) ** 2
    return energy
