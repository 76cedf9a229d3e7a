"""Rotations, and the motions of links in the world."""

from __future__ import annotations

import numpy as np

from .mechanism import NeutralMechanism, PlainArray

LOCKED_COSINE = 1e-9
"""Cosine of the second of three angles below which the first and the third are one rotation."""
LinkMotion = tuple
"""Place (3,), rotation (3, 3), velocity (3,) and angular velocity (3,) of a link; engines with
exact accelerations add the acceleration (3,) and the angular acceleration (3,)."""


def matrix_of(quaternion: PlainArray) -> PlainArray:
    """The rotation matrix (3, 3) of a quaternion (w, x, y, z).

    >>> matrix_of(np.array([1.0, 0.0, 0.0, 1.0])).round(12).tolist()
    [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    """
    w, x, y, z = np.asarray(quaternion, float) / np.linalg.norm(quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def matrix_of_xyzw(quaternion: PlainArray) -> PlainArray:
    """The rotation matrix (3, 3) of a quaternion (x, y, z, w), whose real part comes last."""
    return matrix_of(np.roll(quaternion, 1))


def turn_about(axis: PlainArray, angle: float) -> PlainArray:
    """The rotation matrix (3, 3) about a unit axis by an angle [rad]."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross


def angles_of(turn: PlainArray) -> PlainArray:
    """Angles (3,) about the fixed axes x, y and z, in this order, of a rotation matrix [rad].

    >>> angles_of(turn_about(np.array([0.0, 0.0, 1.0]), 0.5)).round(12).tolist()
    [0.0, -0.0, 0.5]
    """
    pitch = np.arctan2(-turn[2, 0], np.hypot(turn[0, 0], turn[1, 0]))
    if np.hypot(turn[0, 0], turn[1, 0]) < LOCKED_COSINE:
        return np.array([np.arctan2(-turn[1, 2], turn[1, 1]), pitch, 0.0])
    roll, yaw = np.arctan2(turn[2, 1], turn[2, 2]), np.arctan2(turn[1, 0], turn[0, 0])
    return np.array([roll, pitch, yaw])


def frame_of_axis(axis: PlainArray) -> PlainArray:
    """A rotation matrix (3, 3) whose third column is an axis."""
    z = np.asarray(axis, float) / np.linalg.norm(axis)
    x = np.eye(3)[int(np.argmin(np.abs(z)))]
    x = x - (x @ z) * z
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


def in_space(
    mechanism: NeutralMechanism, link: int, at: PlainArray, angle: float, rates: PlainArray
) -> LinkMotion:
    """The motion of a link of a planar engine in the world.

    `at` is the centre in the plane (2,) [m], `angle` the rotation since the start [rad], and
    `rates` the velocity of the centre and the angular rate (3,).
    """
    e1, e2, normal = mechanism.plane
    height = mechanism.links[link].centre @ normal
    return (
        at[0] * e1 + at[1] * e2 + height * normal,
        turn_about(normal, angle),
        rates[0] * e1 + rates[1] * e2,
        rates[2] * normal,
    )
