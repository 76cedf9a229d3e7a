"""Positions and orientations of all bodies of a tree, with their first two time derivatives.

All arrays have the poses along their first axis. Vectors are in the axes of the world.
"""

from dataclasses import dataclass, replace
from math import atan2, cos, sin, sqrt

import numpy as np

from proofmass.analytic.mjcf import JointData, JointKind
from proofmass.analytic.numerics import IDENTITY_QUATERNION
from proofmass.analytic.spatial.mechanism import (
    Tree,
    quaternion_product,
    quaternion_product_parts,
)
from proofmass.base.arrays import Array


@dataclass(frozen=True)
class TreeMotion:
    """All bodies at n poses.

    Attributes
    ----------
    at, velocity, acceleration : ndarray (n, bodies, 3)
        Position, velocity and acceleration of the origins of the bodies [m, m/s, m/s^2].
    quaternion, turn : ndarray (n, bodies, 4), (n, bodies, 3, 3)
        Orientation of the bodies, as quaternion and as rotation matrix [1].
    spin, spin_rate : ndarray (n, bodies, 3)
        Angular velocity and acceleration [rad/s, rad/s^2].
    axes, anchors : ndarray (n, rates, 3)
        Direction of each rate [1], and a point on the axis of each angular rate [m].
    """

    at: Array
    velocity: Array
    acceleration: Array
    quaternion: Array
    turn: Array
    spin: Array
    spin_rate: Array
    axes: Array
    anchors: Array

    def point(self, body: int, local: Array) -> Array:
        """Position of a point of a body (n, 3) [m]."""
        return np.asarray(self.at[:, body] + self.turn[:, body] @ local)

    def point_velocity(self, body: int, local: Array) -> Array:
        """Velocity of a point of a body (n, 3) [m/s]."""
        arm = self.turn[:, body] @ local
        return np.asarray(self.velocity[:, body] + cross3(self.spin[:, body], arm))

    def point_acceleration(self, body: int, local: Array) -> Array:
        """Acceleration of a point of a body (n, 3) [m/s^2]."""
        arm, spin = self.turn[:, body] @ local, self.spin[:, body]
        return np.asarray(
            self.acceleration[:, body]
            + cross3(self.spin_rate[:, body], arm)
            + cross3(spin, cross3(spin, arm))
        )


@dataclass
class Frame:
    """The frame of one body at n poses, while the joints of its chain move it one by one."""

    at: Array
    velocity: Array
    acceleration: Array
    quaternion: Array
    turn: Array
    spin: Array
    spin_rate: Array

    def shift_origin(self, arm: Array) -> None:
        """Move the origin by an arm that is fixed in the frame (n, 3) [m]."""
        self.at = self.at + arm
        self.velocity = self.velocity + cross3(self.spin, arm)
        self.acceleration = (
            self.acceleration
            + cross3(self.spin_rate, arm)
            + cross3(self.spin, cross3(self.spin, arm))
        )

    def slide_along(self, axis: Array, value: Array, rate: Array, acceleration: Array) -> None:
        """Move the frame along an axis that is fixed in it (n, 3)."""
        value, rate, acceleration = (part[:, None] for part in (value, rate, acceleration))
        self.shift_origin(axis * value)
        self.velocity = self.velocity + axis * rate
        self.acceleration = (
            self.acceleration + 2.0 * cross3(self.spin, axis * rate) + axis * acceleration
        )

    def turned(self, quaternion: Array, rate: Array, acceleration: Array) -> None:
        """Turn the frame by a quaternion.

        `rate` and `acceleration` (n, 3) are relative to the frame, in the axes of the world.
        """
        self.quaternion = quaternion_product(self.quaternion, quaternion)
        self.turn = rotation_matrices(self.quaternion)
        self.spin_rate = self.spin_rate + cross3(self.spin, rate) + acceleration
        self.spin = self.spin + rate


AXIS_AFTER, AXIS_BEFORE = np.array([1, 2, 0]), np.array([2, 0, 1])
"""For each axis the next one, and the one before it, in cyclic order."""


def cross3(one: Array, two: Array) -> Array:
    """Vector product (..., 3)."""
    positive_part = one.take(AXIS_AFTER, -1) * two.take(AXIS_BEFORE, -1)
    return np.asarray(positive_part - one.take(AXIS_BEFORE, -1) * two.take(AXIS_AFTER, -1))


def rotation_matrices(quaternion: Array) -> Array:
    """Rotation matrices (..., 3, 3) [1] of unit quaternions."""
    w, x, y, z = (quaternion[..., k] for k in range(4))
    found = np.empty((*w.shape, 3, 3))
    found[..., 0, 0] = 1 - 2 * (y * y + z * z)
    found[..., 1, 1] = 1 - 2 * (x * x + z * z)
    found[..., 2, 2] = 1 - 2 * (x * x + y * y)
    found[..., 0, 1], found[..., 1, 0] = 2 * (x * y - w * z), 2 * (x * y + w * z)
    found[..., 0, 2], found[..., 2, 0] = 2 * (x * z + w * y), 2 * (x * z - w * y)
    found[..., 1, 2], found[..., 2, 1] = 2 * (y * z - w * x), 2 * (y * z + w * x)
    return found


def quaternion_about(axis: Array, angle: Array) -> Array:
    """Quaternions (n, 4) [1] of rotations by angles (n,) about an axis (3,)."""
    half = 0.5 * angle[:, None]
    return np.concatenate([np.cos(half), np.sin(half) * axis], axis=1)


def rotation_vector(quaternion: Array) -> Array:
    """Rotation vectors (axis times angle) (n, 3) [rad] of quaternions; the angle is at most pi."""
    sign = np.where(quaternion[:, :1] < 0, -1.0, 1.0)
    scalar, vector = sign * quaternion[:, :1], sign * quaternion[:, 1:]
    sine = np.linalg.norm(vector, axis=1, keepdims=True)
    angle = 2.0 * np.arctan2(sine, scalar)
    return np.asarray(vector * np.where(sine > 0, angle / np.where(sine > 0, sine, 1.0), 2.0))


def normalize_quaternions(quaternion: Array) -> Array:
    """Scale quaternions (..., 4) to length 1."""
    return np.asarray(quaternion / np.linalg.norm(quaternion, axis=-1, keepdims=True))


def move_tree(tree: Tree, q: Array, v: Array, a: Array) -> TreeMotion:
    """Find the motion of all bodies at poses q (n, poses), with rates v and accelerations a."""
    n = len(q)
    axes, anchors = np.zeros((n, v.shape[1], 3)), np.zeros((n, v.shape[1], 3))
    zeros, identity = np.zeros((n, 3)), np.tile(np.eye(3), (n, 1, 1))
    frames = [
        Frame(zeros, zeros, zeros, np.tile(IDENTITY_QUATERNION, (n, 1)), identity, zeros, zeros)
    ]
    for body in tree.bodies[1:]:
        frame = replace(frames[body.parent])
        frame.shift_origin(frame.turn @ body.place)
        if (body.turn != IDENTITY_QUATERNION).any():
            frame.turned(body.turn, zeros, zeros)
        for j in body.joints:
            move_by_joint(tree.joints[j], frame, q, v, a, axes, anchors)
        frames.append(frame)
    names = ("at", "velocity", "acceleration", "quaternion", "turn", "spin", "spin_rate")
    parts = {name: np.stack([getattr(one, name) for one in frames], axis=1) for name in names}
    return TreeMotion(**parts, axes=axes, anchors=anchors)


def move_by_joint(
    joint: JointData, frame: Frame, q: Array, v: Array, a: Array, axes: Array, anchors: Array
) -> None:
    """Move a frame by one joint, and write the joint's directions into `axes` and `anchors`."""
    pose_index, rate_index = joint.pose, joint.rate
    if joint.kind == JointKind.SLIDE:
        axis = frame.turn @ joint.axis
        axes[:, rate_index] = axis
        frame.slide_along(axis, q[:, pose_index] - joint.zero, v[:, rate_index], a[:, rate_index])
        return
    if joint.kind == JointKind.FREE:
        frame.at, frame.velocity = (
            q[:, pose_index : pose_index + 3],
            v[:, rate_index : rate_index + 3],
        )
        frame.acceleration = a[:, rate_index : rate_index + 3]
        frame.quaternion = np.tile(IDENTITY_QUATERNION, (len(q), 1))
        frame.spin = frame.spin_rate = np.zeros((len(q), 3))
        axes[:, rate_index : rate_index + 3] = np.eye(3)
        pose_index, rate_index = pose_index + 3, rate_index + 3
    elif joint.place.any():
        frame.shift_origin(frame.turn @ joint.place)
    if joint.kind == JointKind.HINGE:
        axis = frame.turn @ joint.axis
        axes[:, rate_index], anchors[:, rate_index] = axis, frame.at
        frame.turned(
            quaternion_about(joint.axis, q[:, pose_index] - joint.zero),
            axis * v[:, rate_index, None],
            axis * a[:, rate_index, None],
        )
    else:
        own = normalize_quaternions(q[:, pose_index : pose_index + 4])
        turn = rotation_matrices(quaternion_product(frame.quaternion, own))
        axes[:, rate_index : rate_index + 3] = np.swapaxes(turn, 1, 2)
        anchors[:, rate_index : rate_index + 3] = frame.at[:, None]
        rate, acceleration = (
            (turn @ part[:, rate_index : rate_index + 3, None])[..., 0] for part in (v, a)
        )
        frame.turned(own, rate, acceleration)
    if joint.kind != JointKind.FREE and joint.place.any():
        frame.shift_origin(-(frame.turn @ joint.place))


def advance_pose(tree: Tree, q: Array, step: Array) -> Array:
    """Pose (poses,) that a step (rates,) leads to from q: rates acting for a unit of time."""
    found = q.copy()
    places, rates = tree.scalars
    found[places] += step[rates]
    for pose_index, rate_index in tree.quaternions:
        x, y, z = step[rate_index : rate_index + 3].tolist()
        angle = sqrt(x * x + y * y + z * z)
        scale = sin(angle / 2) / angle if angle else 0.5
        half = cos(angle / 2), scale * x, scale * y, scale * z
        quaternion = quaternion_product_parts(q[pose_index : pose_index + 4].tolist(), half)
        length = sqrt(sum(part * part for part in quaternion))
        found[pose_index : pose_index + 4] = [part / length for part in quaternion]
    return found


def pose_difference(tree: Tree, one: Array, other: Array) -> Array:
    """The step (rates,) that leads from a pose (poses,) to another; inverse of `advance_pose`."""
    found = np.empty(tree.armature.size)
    places, rates = tree.scalars
    found[rates] = other[places] - one[places]
    for pose_index, rate_index in tree.quaternions:
        back = one[pose_index : pose_index + 4] * (1.0, -1.0, -1.0, -1.0)
        turn = quaternion_product_parts(back.tolist(), other[pose_index : pose_index + 4].tolist())
        w, *axis = turn if turn[0] >= 0.0 else [-part for part in turn]
        length = sqrt(sum(part * part for part in axis))
        angle = 2.0 * atan2(length, w)
        found[rate_index : rate_index + 3] = np.array(axis) * (angle / length if length else 2.0)
    return found


def pose_rate(tree: Tree, q: Array, v: Array) -> Array:
    """Time derivative (poses,) of a pose q with rates v (rates,)."""
    found = np.empty(q.size)
    places, rates = tree.scalars
    found[places] = v[rates]
    for pose_index, rate_index in tree.quaternions:
        w, x, y, z = q[pose_index : pose_index + 4].tolist()
        a, b, c = v[rate_index : rate_index + 3].tolist()
        found[pose_index : pose_index + 4] = (
            -0.5 * (x * a + y * b + z * c),
            0.5 * (w * a + y * c - z * b),
            0.5 * (w * b + z * a - x * c),
            0.5 * (w * c + x * b - y * a),
        )
    return found
