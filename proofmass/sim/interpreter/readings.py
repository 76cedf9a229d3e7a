"""Coordinates and rates of joints, and motions of points, from the motions of links."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .geometry import LinkMotion
from .mechanism import NeutralMechanism, PlainArray


def joint_motion(
    mechanism: NeutralMechanism, joint: int, read: Callable[[int], LinkMotion], near: float = 0.0
) -> tuple[float, float]:
    """Coordinate, 0 at the start, and rate of a hinge or slide from the motions of its links.

    The coordinate of a hinge is, of those that differ by full turns, the one next to `near` [rad].
    """
    one, ground = mechanism.joints[joint], (np.zeros(3), np.eye(3), np.zeros(3), np.zeros(3))
    if one.kind == "slide":
        return slide_motion(mechanism, joint, read)
    base, moving = (read(k) if k else ground for k in (one.parent, one.child))
    turn = base[1].T @ moving[1]
    skew = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    angle = float(np.arctan2(one.axis @ skew, np.trace(turn) - 1.0))
    rate = float((moving[3] - base[3]) @ base[1] @ one.axis)
    return angle + 2.0 * np.pi * round((near - angle) / (2.0 * np.pi)), rate


def joint_reader(
    mechanism: NeutralMechanism, read: Callable[[int], LinkMotion]
) -> Callable[[int], tuple]:
    """The function `joint_motion` of each joint, whose hinges go on from where they were read."""
    values = dict.fromkeys(range(len(mechanism.joints)), 0.0)

    def joint(j: int) -> tuple[float, float]:
        motion = joint_motion(mechanism, j, read, values[j])
        values[j] = motion[0]
        return motion

    return joint


def slide_motion(
    mechanism: NeutralMechanism, joint: int, read: Callable[[int], LinkMotion]
) -> tuple[float, float]:
    """Coordinate, 0 at the start, and rate of a slide from the motions of its links."""
    one = mechanism.joints[joint]
    base, moving = (read(k) if k else None for k in (one.parent, one.child))
    near = point_motion(mechanism, base, one.parent, one.anchor)
    far = point_motion(mechanism, moving, one.child, one.anchor)
    gap, rate, axis = far[0] - near[0], far[1] - near[1], one.axis
    if base:
        axis = base[1] @ axis
        return float(gap @ axis), float(rate @ axis + gap @ np.cross(base[3], axis))
    return float(gap @ axis), float(rate @ axis)


def point_motion(
    mechanism: NeutralMechanism, motion: LinkMotion | None, link: int, at: PlainArray
) -> tuple:
    """Place and velocity of a point of a link, whose place in the start pose is `at`."""
    if motion is None:  # the ground
        return at, np.zeros(3)
    place, turn, velocity, omega = motion[:4]
    arm = turn @ (at - mechanism.links[link].centre)
    return place + arm, velocity + np.cross(omega, arm)
