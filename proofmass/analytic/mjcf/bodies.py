"""Bodies of a compiled model, the joints between them, and the pairs of them that may touch."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from typing import Any

import mujoco
import numpy as np

from proofmass.analytic.mjcf.options import (
    CONTACT_FLAGS,
    DAMPER_FLAGS,
    DISABLE,
    FRICTION_FLAGS,
    LIMIT_FLAGS,
    SPRING_FLAGS,
    UNLIMITED,
    is_disabled,
    read_range,
)
from proofmass.analytic.numerics import rotation_matrix
from proofmass.base.arrays import Array


class JointKind(StrEnum):
    """What a joint lets a body do."""

    HINGE = "hinge"
    SLIDE = "slide"
    BALL = "ball"
    FREE = "free"

    @property
    def is_scalar(self) -> bool:
        """Whether one number is the value of the joint: it is a hinge or a slide."""
        return self in (JointKind.HINGE, JointKind.SLIDE)


JOINT_KINDS = {
    int(mujoco.mjtJoint.mjJNT_HINGE): JointKind.HINGE,
    int(mujoco.mjtJoint.mjJNT_SLIDE): JointKind.SLIDE,
    int(mujoco.mjtJoint.mjJNT_BALL): JointKind.BALL,
    int(mujoco.mjtJoint.mjJNT_FREE): JointKind.FREE,
}
JOINT_SIZES = {
    JointKind.HINGE: (1, 1),
    JointKind.SLIDE: (1, 1),
    JointKind.BALL: (4, 3),
    JointKind.FREE: (7, 6),
}
"""How many numbers a joint has in a pose and in the rates, by its kind."""


@dataclass(frozen=True, eq=False)
class BodyData:
    """A rigid body.

    Attributes
    ----------
    name : str
    parent : int
    place, turn : ndarray (3,), (4,)
        Position [m] and orientation as a quaternion [1] in the parent's frame.
    joints : tuple of int
        Numbers of the joints between body and parent, in their order.
    mass : float
        Mass [kg].
    centre : ndarray (3,)
        Centre of mass in the body's frame [m].
    inertia_turn : ndarray (4,)
        Orientation of the principal axes of inertia as a quaternion in the body's frame [1].
    moments : ndarray (3,)
        Principal moments of inertia about the centre [kg m^2].
    weight_share : float
        Share of its weight that ``gravcomp`` takes away [1].
    is_mocap : bool
        Whether a program places it, and no joint.
    is_placed_by_key : bool
        Whether a key places it elsewhere than the MJCF.
    is_fixed : bool
        Whether no joint is between the body and the ground.
    """

    name: str
    parent: int
    place: Array
    turn: Array
    joints: tuple[int, ...]
    mass: float
    centre: Array
    inertia_turn: Array
    moments: Array
    weight_share: float
    is_mocap: bool
    is_placed_by_key: bool
    is_fixed: bool

    @cached_property
    def inertia(self) -> Array:
        """Moments of inertia about the centre, in the body's axes (3, 3) [kg m^2]."""
        axes = rotation_matrix(self.inertia_turn)
        return np.asarray(axes * self.moments @ axes.T)


@dataclass(frozen=True, eq=False)
class JointData:
    """A joint between a body and its parent, in the body's axes.

    What a flag of the model disables is left out: it is zero, or without a limit.

    Attributes
    ----------
    name, kind : str, JointKind
    body : int
        The body that it moves.
    pose, rate : int
        First index of its numbers in a pose and in the rates.
    place, axis : ndarray (3,)
        Its position [m] and direction [1].
    zero : float
        Value of a hinge or slide in the reference pose, in which the MJCF gives the bodies
        [rad or m].
    rest : ndarray
        Numbers of the joint in a pose at which the spring is slack [SI].
    stiffness : tuple of float
        Coefficients of the spring's stiffness, lowest power first [SI].
    spring_yields : bool
        Whether its spring yields, so that its force depends on the past.
    damping : ndarray (rates, 3)
        For each of its rates the coefficients of 1, of the speed and of its square [SI].
    armature : ndarray (rates,)
        Rotor inertia [kg m^2 or kg].
    friction : ndarray (rates,)
        Largest dry friction [N m or N].
    range : tuple of float
        Smallest and largest value of a hinge or slide; of a ball 0 and its largest angle
        [rad or m].
    margin : float
        Distance from the ends of the range at which the limit begins to act [rad or m].
    limit_solref : ndarray (2,)
        Time constant and damping ratio of the limit, or its negative stiffness and damping [SI].
    force_range : tuple of float
        Smallest and largest total force of the actuators on a hinge or slide [N m or N].
    takes_weight : bool
        Whether its actuators compensate the weight of bodies with ``gravcomp``.
    carrier : int
        The body that its body hangs on by this joint alone, 0 for the ground; -1 if it has others.
    """

    name: str
    kind: JointKind
    body: int
    pose: int
    rate: int
    place: Array
    axis: Array
    zero: float
    rest: Array
    stiffness: tuple[float, ...]
    spring_yields: bool
    damping: Array
    armature: Array
    friction: Array
    range: tuple[float, float]
    margin: float
    limit_solref: Array
    force_range: tuple[float, float]
    takes_weight: bool
    carrier: int

    @property
    def stop_range(self) -> tuple[float, float]:
        """Where its stops begin to act: the range without the margin at both ends [rad or m]."""
        return self.range[0] + self.margin, self.range[1] - self.margin

    @property
    def is_scalar(self) -> bool:
        """Whether it is a hinge or a slide."""
        return self.kind.is_scalar

    @property
    def is_limited(self) -> bool:
        """Whether it has a range."""
        return self.range != UNLIMITED

    @property
    def has_force_range(self) -> bool:
        """Whether the total force of its actuators has a range."""
        return self.force_range != UNLIMITED

    @property
    def is_hinge_on_ground(self) -> bool:
        """Whether it is the only joint of its body, a hinge on the ground."""
        return self.kind == JointKind.HINGE and self.carrier == 0


def read_body(model: Any, b: int) -> BodyData:
    """Read body number b."""
    first = int(model.body_jntadr[b])
    return BodyData(
        model.body(b).name,
        int(model.body_parentid[b]),
        np.array(model.body_pos[b]),
        np.array(model.body_quat[b]),
        tuple(range(first, first + int(model.body_jntnum[b]))) if first >= 0 else (),
        float(model.body_mass[b]),
        np.array(model.body_ipos[b]),
        np.array(model.body_iquat[b]),
        np.array(model.body_inertia[b]),
        float(model.body_gravcomp[b]),
        bool(model.body_mocapid[b] >= 0),
        is_placed_by_key(model, b),
        bool(model.body_weldid[b] == 0),
    )


def is_placed_by_key(model: Any, b: int) -> bool:
    """Whether a key places body b, if it is a mocap body, elsewhere than the MJCF."""
    number = int(model.body_mocapid[b])
    if number < 0 or not model.nkey:
        return False
    own = slice(3 * number, 3 * number + 3), slice(4 * number, 4 * number + 4)
    places, turns = (
        np.reshape(part, (model.nkey, -1)) for part in (model.key_mpos, model.key_mquat)
    )
    return bool(
        np.any(places[:, own[0]] != model.body_pos[b])
        or np.any(turns[:, own[1]] != model.body_quat[b])
    )


def read_joint(model: Any, j: int) -> JointData:
    """Read joint number j."""
    kind, body = JOINT_KINDS[int(model.jnt_type[j])], int(model.jnt_bodyid[j])
    pose, rate = int(model.jnt_qposadr[j]), int(model.jnt_dofadr[j])
    numbers, speeds = JOINT_SIZES[kind]
    own = slice(rate, rate + speeds)
    has_spring, has_damper, has_friction, has_limit = (
        not is_disabled(model, flags)
        for flags in (SPRING_FLAGS, DAMPER_FLAGS, FRICTION_FLAGS, LIMIT_FLAGS)
    )
    alone = model.body_jntnum[body] == 1
    return JointData(
        model.joint(j).name,
        kind,
        body,
        pose,
        rate,
        np.array(model.jnt_pos[j]),
        np.array(model.jnt_axis[j]),
        float(model.qpos0[pose]) if kind.is_scalar else 0.0,
        np.array(model.qpos_spring[pose : pose + numbers]),
        tuple(has_spring * c for c in (model.jnt_stiffness[j], *model.jnt_stiffnesspoly[j])),
        bool(has_spring and np.any(model.jnt_springyield[j])),
        np.concatenate([model.dof_damping[own, None], model.dof_dampingpoly[own]], 1) * has_damper,
        np.array(model.dof_armature[own]),
        np.array(model.dof_frictionloss[own]) * has_friction,
        read_range(model.jnt_range[j], has_limit and bool(model.jnt_limited[j])),
        float(model.jnt_margin[j]),
        np.array(model.jnt_solref[j]),
        read_range(model.jnt_actfrcrange[j], bool(model.jnt_actfrclimited[j])),
        bool(model.jnt_actgravcomp[j]),
        int(model.body_weldid[model.body_parentid[body]]) if alone else -1,
    )


def carried_bodies(parents: Sequence[int], body: int) -> set[int]:
    """Numbers of a body and of all bodies that it carries, by the parents of all bodies.

    >>> carried_bodies([0, 0, 1, 0, 2], 1)
    {1, 2, 4}
    """
    found = {body}
    for b, parent in enumerate(parents):
        if b and parent in found:
            found.add(b)
    return found


def may_touch(model: Any) -> bool:
    """Whether MuJoCo looks for contacts: of geoms, of a pair, or of a flex."""
    off = is_disabled(model, CONTACT_FLAGS)
    return not off and bool(touching_bodies(model).size or model.npair)


def touching_bodies(model: Any) -> Array:
    """The bodies (n, 2) of all pairs of geoms between which MuJoCo looks for contacts.

    Left out are the pairs that it filters out: by ``contype`` and ``conaffinity``, of one rigid
    group, of a group and its parent other than the ground, and of ``<exclude>``.
    """
    rigid = model.body_weldid
    parent = rigid[model.body_parentid[rigid]]
    matches = model.geom_contype[:, None] & model.geom_conaffinity != 0
    pairs = model.geom_bodyid[np.argwhere(np.triu(matches | matches.T, 1))]
    first, second = np.sort(pairs, axis=1).T
    one, two = rigid[first], rigid[second]
    # MuJoCo packs the two bodies of an <exclude> into one number
    filtered = (one == two) | np.isin((first << 16) + second, model.exclude_signature)
    if not is_disabled(model, DISABLE.mjDSBL_FILTERPARENT):
        filtered |= (one > 0) & (two > 0) & ((one == parent[two]) | (two == parent[one]))
    return np.stack([first, second], axis=1)[~filtered]
