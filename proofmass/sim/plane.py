"""The plane in which a planar MJCF mechanism moves."""

from dataclasses import dataclass

import mujoco
import numpy as np

from proofmass.analytic.numerics import normal_of_slides
from proofmass.base.arrays import Array
from proofmass.sim.protocol.failures import Unsupported

BALL, FREE = int(mujoco.mjtJoint.mjJNT_BALL), int(mujoco.mjtJoint.mjJNT_FREE)
PARALLEL_TOLERANCE = 1e-9
"""Largest sine [-] of the angle at which two directions of an MJCF still count as parallel."""


@dataclass(frozen=True)
class MotionPlane:
    """A right-handed basis whose first two vectors span the plane of motion.

    Attributes
    ----------
    e1, e2, normal : ndarray (3,)
        Unit vectors [1] in world coordinates; ``e2 = normal x e1``.
    """

    e1: Array
    e2: Array
    normal: Array

    def flat(self, vectors: Array) -> Array:
        """Components in the plane: (..., 3) to (..., 2)."""
        return vectors @ np.stack([self.e1, self.e2], axis=1)

    def world(self, flat: Array, height: float = 0.0) -> Array:
        """Vectors in the world of components in the plane plus `height`: (..., 2) to (..., 3)."""
        return flat @ np.stack([self.e1, self.e2]) + height * self.normal


def find_plane(model: mujoco.MjModel, data: mujoco.MjData) -> MotionPlane:
    """Find the plane in which all joints of a model move.

    The normal is the axis of the first hinge; without a hinge it is normal to the slides.  The
    first basis vector is the world's x axis (its y axis if x is the normal), projected.

    Parameters
    ----------
    model : mujoco.MjModel
    data : mujoco.MjData
        With the kinematics of the start pose.

    Returns
    -------
    MotionPlane

    Raises
    ------
    Unsupported
        A joint moves out of the plane; the message names it.
    """
    for joint in np.flatnonzero(np.isin(model.jnt_type, (BALL, FREE))).tolist():
        kind = "ball" if model.jnt_type[joint] == BALL else "free"
        raise Unsupported(f"{kind} joint '{model.joint(joint).name}' leaves every plane")
    hinges = model.jnt_type == mujoco.mjtJoint.mjJNT_HINGE
    axes = data.xaxis
    normal = axes[hinges][0] if hinges.any() else normal_of_slides(axes, PARALLEL_TOLERANCE)
    off = np.where(hinges, np.linalg.norm(np.cross(normal, axes), axis=1), np.abs(axes @ normal))
    for joint in np.flatnonzero(off > PARALLEL_TOLERANCE).tolist():
        kind = "hinge" if hinges[joint] else "slide"
        raise Unsupported(
            f"{kind} joint '{model.joint(joint).name}' leaves the plane "
            f"normal to {np.round(normal, 6).tolist()}"
        )
    x = np.array([1.0, 0.0, 0.0])
    if np.linalg.norm(np.cross(normal, x)) < PARALLEL_TOLERANCE:
        x = np.array([0.0, 1.0, 0.0])
    e1 = x - (x @ normal) * normal
    e1 /= np.linalg.norm(e1)
    return MotionPlane(e1, np.cross(normal, e1), normal.copy())
