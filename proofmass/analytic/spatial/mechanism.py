"""Data of a spatial mechanism: rigid bodies in a tree of joints, equalities, and forces.

`read_tree` makes a `Tree` from the numbers of a compiled MJCF; MuJoCo's kinematics is not used. A
pose is a row as in ``qpos``, and rates are a row as in ``qvel``: for a ball joint the angular
velocity in the axes of its body; for a free joint the velocity of its body's origin in the world,
and then the angular velocity in the axes of the body.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import mujoco
import numpy as np

from proofmass.analytic.controls import UNLIMITED, AffineActuator, SiteLoad
from proofmass.analytic.names import equality_name
from proofmass.analytic.numerics import NotCovered, without_rounding
from proofmass.analytic.planar.mechanism import (
    enabled_actuators,
    is_disabled,
    is_site_motor,
    read_actuator,
    read_site_load,
    refuse_contacts,
    rotation_matrix,
)
from proofmass.analytic.spatial.support import SUPPORT
from proofmass.analytic.support import refuse
from proofmass.base.arrays import Array, Index

DISABLE_FLAG, EQUALITY_TYPE, TRANSMISSION_TYPE = mujoco.mjtDisableBit, mujoco.mjtEq, mujoco.mjtTrn
JOINT_KINDS = {
    mujoco.mjtJoint.mjJNT_HINGE: "hinge",
    mujoco.mjtJoint.mjJNT_SLIDE: "slide",
    mujoco.mjtJoint.mjJNT_BALL: "ball",
    mujoco.mjtJoint.mjJNT_FREE: "free",
}
JOINT_SIZES = {"hinge": (1, 1), "slide": (1, 1), "ball": (4, 3), "free": (7, 6)}
"""How many numbers a joint has in a pose and in the rates, by its kind."""
IDENTITY_QUATERNION = np.array([1.0, 0.0, 0.0, 0.0])
"""Quaternion of no rotation."""


@dataclass(frozen=True)
class TreeJoint:
    """A joint of a body, in the body's axes.

    Attributes
    ----------
    name, kind : str
        Kind is hinge, slide, ball or free.
    pose, rate : int
        First index of its numbers in a pose and in the rates.
    place, axis : ndarray (3,)
        Its position [m] and direction [1].
    zero : float
        Value of a hinge or slide in the reference pose, in which the MJCF gives the bodies
        [rad or m].
    stiffness : tuple of float
        Coefficients of the spring's stiffness, lowest power first [SI].
    rest : ndarray
        Numbers of the joint in a pose at which the spring is slack [SI].
    range : tuple of float
        Smallest and largest value of a hinge or slide [rad or m].
    actuated : tuple of float
        Smallest and largest total force of the actuators on a hinge or slide [N m or N].
    """

    name: str
    kind: str
    pose: int
    rate: int
    place: Array
    axis: Array
    zero: float
    stiffness: tuple[float, ...]
    rest: Array
    range: tuple[float, float]
    actuated: tuple[float, float] = UNLIMITED


@dataclass(frozen=True)
class TreeBody:
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
    inertia : ndarray (3, 3)
        Moments of inertia about the centre, in the body's axes [kg m^2].
    """

    name: str
    parent: int
    place: Array
    turn: Array
    joints: tuple[int, ...]
    mass: float
    centre: Array
    inertia: Array


@dataclass(frozen=True)
class Tendon:
    """A fixed tendon, or a straight one from site to site.

    Attributes
    ----------
    name : str
    terms : tuple of (int, int, float)
        For each joint of a fixed tendon: index in a pose, index in the rates, coefficient [1].
    points : tuple of (int, ndarray)
        For each site of a straight tendon: body, and point in its frame [m].
    zero : float
        Length in the reference pose [m or rad].
    slack : tuple of float
        Shortest and longest length at which the spring is slack [m or rad].
    stiffness, damping : tuple of float
        Coefficients, lowest power first [SI].
    """

    name: str
    terms: tuple[tuple[int, int, float], ...]
    points: tuple[tuple[int, Array], ...]
    zero: float
    slack: tuple[float, float]
    stiffness: tuple[float, ...]
    damping: tuple[float, ...]


@dataclass(frozen=True)
class PointLoop:
    """A ``connect`` or ``weld``: a point of one body that coincides with a point of another.

    Attributes
    ----------
    name : str
    one, on_one : int, ndarray (3,)
        The first body, and the point in its frame [m].
    two, on_two : int, ndarray (3,)
        The second body, and the point in its frame [m].
    turns : ndarray (2, 4), optional
        For a weld: quaternions, in bodies one and two, of axes that are constrained to be parallel
        [1].
    scale : float
        Factor of the rows of these axes [1].
    """

    name: str
    one: int
    on_one: Array
    two: int
    on_two: Array
    turns: Array | None = None
    scale: float = 1.0


@dataclass(frozen=True)
class Tie:
    """An equality: the value of a joint or tendon is a polynomial of that of another one.

    Both values count from their zeros.

    Attributes
    ----------
    name : str
    tendons : bool
        Whether `one` and `two` are tendons, not joints.
    one, two : int
        Numbers of the joints or tendons; `two` is -1 if `one` is constant.
    polynomial : ndarray (5,)
        Coefficients, lowest power first [SI].
    """

    name: str
    tendons: bool
    one: int
    two: int
    polynomial: Array


@dataclass(frozen=True, eq=False)
class Tree:
    """A spatial mechanism: bodies, joints, forces and equalities; body 0 is the ground.

    Attributes
    ----------
    bodies, joints, tendons, actuators, loops, ties
        Its parts; `actuators` are those of joints and tendons, and `loops` and `ties` are its
        equalities.
    damping : ndarray (rates, 3)
        Damping of all rates: coefficients of 1, of the speed and of its square [SI].
    armature : ndarray (rates,)
        Armature of all rates [kg or kg m^2].
    gravity : ndarray (3,)
        Acceleration of gravity [m/s^2].
    start, start_rate : ndarray (poses,), (rates,)
        The start pose, and the rates there [SI].
    extent : float
        Size of the model [m].
    ctrl : ndarray (controls,)
        Controls of the key [SI].
    site_loads : tuple of SiteLoad
        Loads of the actuators on sites.
    """

    bodies: tuple[TreeBody, ...]
    joints: tuple[TreeJoint, ...]
    tendons: tuple[Tendon, ...]
    actuators: tuple[AffineActuator, ...]
    loops: tuple[PointLoop, ...]
    ties: tuple[Tie, ...]
    damping: Array
    armature: Array
    gravity: Array
    start: Array
    start_rate: Array
    extent: float
    ctrl: Array
    site_loads: tuple[SiteLoad, ...] = ()

    @cached_property
    def moved(self) -> Array:
        """1 where a rate moves a body, else 0 (bodies, rates)."""
        found = np.zeros((len(self.bodies), len(self.armature)))
        for b, body in enumerate(self.bodies[1:], 1):
            found[b] = found[body.parent]
            for j in body.joints:
                joint = self.joints[j]
                found[b, joint.rate : joint.rate + JOINT_SIZES[joint.kind][1]] = 1.0
        return found

    @cached_property
    def masses(self) -> tuple[Array, Array, Array]:
        """Masses [kg], centres of mass [m] and inertias about them [kg m^2] of all bodies."""
        return (
            np.array([body.mass for body in self.bodies]),
            np.array([body.centre for body in self.bodies]),
            np.array([body.inertia for body in self.bodies]),
        )

    @cached_property
    def turns(self) -> Array:
        """1 where a rate is an angular one, else 0 (rates,)."""
        found = np.ones(len(self.armature))
        for joint in self.joints:
            if joint.kind in ("slide", "free"):
                found[joint.rate : joint.rate + (3 if joint.kind == "free" else 1)] = 0.0
        return found

    @property
    def size(self) -> float:
        """Unit of lengths: the extent, or a tiny length if that is 0 [m]."""
        return max(self.extent, 1e-300)

    @cached_property
    def sizes(self) -> Array:
        """Units of the rates (rates,): 1 rad, or the size of the model [m]."""
        return np.where(self.turns > 0, 1.0, self.size)

    @cached_property
    def row_sizes(self) -> Array:
        """Units of the violations of the equalities (rows,) [rad or m]."""
        ties = [
            self.size if tie.tendons else float(self.sizes[self.joints[tie.one].rate])
            for tie in self.ties
        ]
        return np.array([self.size] * (self.rows - len(ties)) + ties)

    def without_rounding(self, jacobian: Array) -> Array:
        """Jacobian (..., rows, rates) of the equalities, zero in rows that are only rounding."""
        return without_rounding(jacobian, self.row_units)

    @cached_property
    def row_units(self) -> Array:
        """Units of the rates over those of the violations (rows, rates)."""
        return np.asarray(self.sizes / self.row_sizes[:, None])

    def places(self, joints: tuple[str, ...]) -> tuple[Index, Index]:
        """Find the indices (drives,) of driven joints in a pose and in the rates, by their names.

        Raises
        ------
        NotCovered
            One of the joints is neither a hinge nor a slide.
        ValueError
            There is no joint of one of the names.
        """
        named = {joint.name: joint for joint in self.joints}
        if missing := [name for name in joints if name not in named]:
            raise ValueError(f"no joint {missing[0]!r}; there are: {', '.join(named) or 'none'}")
        found = [named[name] for name in joints]
        for joint in found:
            if joint.kind not in ("hinge", "slide"):
                raise NotCovered(f"the driven joint {joint.name!r} is a {joint.kind} joint")
        poses, rates = ([getattr(one, part) for one in found] for part in ("pose", "rate"))
        return np.array(poses, np.intp), np.array(rates, np.intp)

    @cached_property
    def quaternions(self) -> tuple[tuple[int, int], ...]:
        """First indices of quaternions in a pose, and of their angular velocities in the rates."""
        return tuple(
            (joint.pose + 3, joint.rate + 3) if joint.kind == "free" else (joint.pose, joint.rate)
            for joint in self.joints
            if joint.kind in ("ball", "free")
        )

    @cached_property
    def scalars(self) -> tuple[Index, Index]:
        """Indices of all numbers that belong to no quaternion, in a pose and in the rates."""
        turning = [q + k for q, _ in self.quaternions for k in range(4)]
        spinning = [v + k for _, v in self.quaternions for k in range(3)]
        return (
            np.setdiff1d(np.arange(self.start.size), turning),
            np.setdiff1d(np.arange(self.armature.size), spinning),
        )

    @property
    def rows(self) -> int:
        """Number of rows of all equalities."""
        return sum(3 if loop.turns is None else 6 for loop in self.loops) + len(self.ties)


def read_tree(model: Any, start: str) -> Tree:
    """Read a spatial mechanism.

    Parameters
    ----------
    model : mujoco.MjModel
        Compiled; only its numbers are read.
    start : str
        Name of the key with the start pose; not used in a model without keys.

    Returns
    -------
    Tree

    Raises
    ------
    NotCovered
        The model has an element that is not covered; the message has its name in the MJCF.
    ValueError
        There is no such key.
    """
    refuse_contacts(model)
    refuse(model, SUPPORT)
    names = [model.key(k).name for k in range(model.nkey)]
    if names and start not in names:
        raise ValueError(f"no key {start!r}; there are: {', '.join(names)}")
    key = names.index(start) if names else -1
    has_equalities = not is_disabled(
        model, DISABLE_FLAG.mjDSBL_EQUALITY, DISABLE_FLAG.mjDSBL_CONSTRAINT
    )
    active = [int(e) for e in np.flatnonzero(model.eq_active0)] if has_equalities else []
    has_damping = not is_disabled(model, DISABLE_FLAG.mjDSBL_DAMPER)
    damping = np.column_stack([model.dof_damping, model.dof_dampingpoly]) * has_damping
    ctrl = model.key_ctrl[key] if names else np.zeros(model.nu)
    return Tree(
        tuple(read_body(model, b) for b in range(model.nbody)),
        tuple(read_joint(model, j) for j in range(model.njnt)),
        tuple(read_tendon(model, t) for t in range(model.ntendon)),
        tuple(
            read_actuator(model, a)
            for a in enabled_actuators(model)
            if model.actuator_trntype[a] != TRANSMISSION_TYPE.mjTRN_SITE
        ),
        tuple(
            read_loop(model, e)
            for e in active
            if EQUALITY_TYPE(int(model.eq_type[e]))
            in (EQUALITY_TYPE.mjEQ_CONNECT, EQUALITY_TYPE.mjEQ_WELD)
        ),
        tuple(
            read_tie(model, e)
            for e in active
            if EQUALITY_TYPE(int(model.eq_type[e]))
            in (EQUALITY_TYPE.mjEQ_JOINT, EQUALITY_TYPE.mjEQ_TENDON)
        ),
        damping,
        np.array(model.dof_armature),
        np.array(model.opt.gravity) * (not is_disabled(model, DISABLE_FLAG.mjDSBL_GRAVITY)),
        np.array(model.key_qpos[key] if names else model.qpos0),
        np.array(model.key_qvel[key] if names else np.zeros(model.nv)),
        float(model.stat.extent),
        np.array(ctrl),
        tuple(
            read_site_load(model, a) for a in enabled_actuators(model) if is_site_motor(model, a)
        ),
    )


def read_body(model: Any, b: int) -> TreeBody:
    """Read body number b."""
    first, axes = int(model.body_jntadr[b]), rotation_matrix(model.body_iquat[b])
    return TreeBody(
        model.body(b).name,
        int(model.body_parentid[b]),
        np.array(model.body_pos[b]),
        np.array(model.body_quat[b]),
        tuple(range(first, first + int(model.body_jntnum[b]))) if first >= 0 else (),
        float(model.body_mass[b]),
        np.array(model.body_ipos[b]),
        axes * model.body_inertia[b] @ axes.T,
    )


def read_joint(model: Any, j: int) -> TreeJoint:
    """Read joint number j."""
    kind, pose = JOINT_KINDS[mujoco.mjtJoint(int(model.jnt_type[j]))], int(model.jnt_qposadr[j])
    has_springs = not is_disabled(model, DISABLE_FLAG.mjDSBL_SPRING)
    has_range = model.jnt_limited[j] and not is_disabled(
        model, DISABLE_FLAG.mjDSBL_LIMIT, DISABLE_FLAG.mjDSBL_CONSTRAINT
    )
    return TreeJoint(
        model.joint(j).name,
        kind,
        pose,
        int(model.jnt_dofadr[j]),
        np.array(model.jnt_pos[j]),
        np.array(model.jnt_axis[j]),
        float(model.qpos0[pose]) if kind in ("hinge", "slide") else 0.0,
        tuple(has_springs * c for c in (model.jnt_stiffness[j], *model.jnt_stiffnesspoly[j])),
        np.array(model.qpos_spring[pose : pose + JOINT_SIZES[kind][0]]),
        tuple(model.jnt_range[j].tolist()) if has_range else UNLIMITED,
        tuple(model.jnt_actfrcrange[j].tolist()) if model.jnt_actfrclimited[j] else UNLIMITED,
    )


def read_tendon(model: Any, t: int) -> Tendon:
    """Read tendon number t."""
    first = int(model.tendon_adr[t])
    wraps = range(first, first + int(model.tendon_num[t]))
    terms, points = list[tuple[int, int, float]](), list[tuple[int, Array]]()
    for w in wraps:
        what = int(model.wrap_objid[w])
        if model.wrap_type[w] == mujoco.mjtWrap.mjWRAP_JOINT:
            place = int(model.jnt_qposadr[what]), int(model.jnt_dofadr[what])
            terms.append((*place, float(model.wrap_prm[w])))
        else:
            points.append((int(model.site_bodyid[what]), np.array(model.site_pos[what])))
    has_springs = not is_disabled(model, DISABLE_FLAG.mjDSBL_SPRING)
    has_damping = not is_disabled(model, DISABLE_FLAG.mjDSBL_DAMPER)
    return Tendon(
        model.tendon(t).name,
        tuple(terms),
        tuple(points),
        float(model.tendon_length0[t]),
        (float(model.tendon_lengthspring[t, 0]), float(model.tendon_lengthspring[t, 1])),
        tuple(has_springs * c for c in (model.tendon_stiffness[t], *model.tendon_stiffnesspoly[t])),
        tuple(has_damping * c for c in (model.tendon_damping[t], *model.tendon_dampingpoly[t])),
    )


def read_loop(model: Any, e: int) -> PointLoop:
    """Read equality number e, a connect or a weld."""
    one, two, data = int(model.eq_obj1id[e]), int(model.eq_obj2id[e]), model.eq_data[e]
    weld = model.eq_type[e] == EQUALITY_TYPE.mjEQ_WELD
    places = (data[3:6], data[:3]) if weld else (data[:3], data[3:6])
    turns = [data[6:10], IDENTITY_QUATERNION]
    if model.eq_objtype[e] == mujoco.mjtObj.mjOBJ_SITE:
        sides = one, two
        one, two = (int(model.site_bodyid[side]) for side in sides)
        places = tuple(model.site_pos[side] for side in sides)
        turns = [model.site_quat[side] for side in sides]
    return PointLoop(
        equality_name(model, e),
        one,
        np.array(places[0]),
        two,
        np.array(places[1]),
        np.array(turns) if weld else None,
        float(data[10]) if weld else 1.0,
    )


def read_tie(model: Any, e: int) -> Tie:
    """Read equality number e, of joints or tendons."""
    return Tie(
        equality_name(model, e),
        model.eq_type[e] == EQUALITY_TYPE.mjEQ_TENDON,
        int(model.eq_obj1id[e]),
        int(model.eq_obj2id[e]),
        np.array(model.eq_data[e, :5]),
    )


def quaternion_product(one: Array, two: Array) -> Array:
    """Product (..., 4) of quaternions [1]."""
    first, second = ([part[..., k] for k in range(4)] for part in (one, two))
    return np.stack(quaternion_product_parts(first, second), axis=-1)


def quaternion_product_parts(one: Sequence[Any], two: Sequence[Any]) -> tuple[Any, Any, Any, Any]:
    """The four parts of the product of quaternions [1]; much faster for single numbers."""
    w, x, y, z = one
    a, b, c, d = two
    return (
        w * a - x * b - y * c - z * d,
        w * b + x * a + y * d - z * c,
        w * c - x * d + y * a + z * b,
        w * d + x * c - y * b + z * a,
    )


def quaternion_conjugate(quaternion: Array) -> Array:
    """Conjugate quaternion (..., 4), that of the opposite rotation [1]."""
    return np.asarray(quaternion * np.array([1.0, -1.0, -1.0, -1.0]))
