"""A spatial mechanism: the data of a model with what the formulation derives from them.

`read_tree` makes a `Tree` from the numbers of a compiled MJCF; MuJoCo's kinematics is not used.
What a pose and its rates are says `proofmass.analytic.mjcf.ModelData`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from proofmass.analytic.mjcf import (
    JOINT_SIZES,
    ActuatorData,
    ActuatorTarget,
    BodyData,
    JointData,
    JointKind,
    KeyData,
    LoopData,
    ModelData,
    SiteLoad,
    TendonData,
    TieData,
    read_compiled,
)
from proofmass.analytic.numerics import NotCovered, without_rounding
from proofmass.analytic.spatial.support import SUPPORT
from proofmass.analytic.support import refuse, refuse_placed_bodies
from proofmass.base.arrays import Array, Index


@dataclass(frozen=True, eq=False)
class Tree:
    """A spatial mechanism: bodies, joints, forces and equalities; body 0 is the ground.

    Attributes
    ----------
    data : ModelData
    key : KeyData
        The start pose, the rates there, and the controls.
    actuators : tuple of ActuatorData
        Those of joints and tendons that act.
    """

    data: ModelData
    key: KeyData
    actuators: tuple[ActuatorData, ...]

    @property
    def bodies(self) -> tuple[BodyData, ...]:
        """All bodies."""
        return self.data.bodies

    @property
    def joints(self) -> tuple[JointData, ...]:
        """All joints."""
        return self.data.joints

    @property
    def tendons(self) -> tuple[TendonData, ...]:
        """All tendons."""
        return self.data.tendons

    @cached_property
    def loops(self) -> tuple[LoopData, ...]:
        """The equalities of points of bodies."""
        return self.data.loops

    @cached_property
    def ties(self) -> tuple[TieData, ...]:
        """The equalities of joints and of tendons."""
        return self.data.ties

    @property
    def site_loads(self) -> tuple[SiteLoad, ...]:
        """Loads of the actuators on sites."""
        return self.data.site_loads

    @property
    def gravity(self) -> Array:
        """Acceleration of gravity (3,) [m/s^2]."""
        return self.data.options.gravity

    @property
    def start(self) -> Array:
        """The start pose (poses,) [SI]."""
        return self.key.pose

    @property
    def start_rate(self) -> Array:
        """The rates at the start pose (rates,) [SI]."""
        return self.key.rates

    @property
    def ctrl(self) -> Array:
        """Controls of the key (controls,) [SI]."""
        return self.key.ctrl

    @property
    def extent(self) -> float:
        """Size of the model [m]."""
        return self.data.extent

    @cached_property
    def damping(self) -> Array:
        """Damping of all rates (rates, 3): coefficients of 1, of the speed and its square [SI]."""
        return np.concatenate([np.zeros((0, 3)), *(joint.damping for joint in self.joints)])

    @cached_property
    def armature(self) -> Array:
        """Armature of all rates (rates,) [kg or kg m^2]."""
        return np.concatenate([np.zeros(0), *(joint.armature for joint in self.joints)])

    @cached_property
    def frictions(self) -> Array:
        """Dry friction of all rates (rates,) [N m or N]."""
        return np.concatenate([np.zeros(0), *(joint.friction for joint in self.joints)])

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
    def reliefs(self) -> Array:
        """Forces at the centres of mass that take away weight (bodies, 3) [N]."""
        shares = np.array([body.weight_share for body in self.bodies])
        return np.asarray(-(shares * self.masses[0])[:, None] * self.gravity)

    @cached_property
    def turns(self) -> Array:
        """1 where a rate is an angular one, else 0 (rates,)."""
        found = np.ones(len(self.armature))
        for joint in self.joints:
            if joint.kind in (JointKind.SLIDE, JointKind.FREE):
                found[joint.rate : joint.rate + (3 if joint.kind == JointKind.FREE else 1)] = 0.0
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
            if not joint.is_scalar:
                raise NotCovered(f"the driven joint {joint.name!r} is a {joint.kind} joint")
        poses, rates = ([getattr(one, part) for one in found] for part in ("pose", "rate"))
        return np.array(poses, np.intp), np.array(rates, np.intp)

    @cached_property
    def quaternions(self) -> tuple[tuple[int, int], ...]:
        """First indices of quaternions in a pose, and of their angular velocities in the rates."""
        return tuple(
            (joint.pose + place, joint.rate + place)
            for joint in self.joints
            if not joint.is_scalar
            for place in (3 if joint.kind == JointKind.FREE else 0,)
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
    return make_tree(read_compiled(model), start)


def make_tree(data: ModelData, start: str) -> Tree:
    """Make the tree of a model's data; see `read_tree`."""
    refuse(data, SUPPORT)
    refuse_placed_bodies(data)
    refuse_weight_on_actuators(data)
    for joint in data.joints:
        if joint.friction.any() and not joint.is_scalar:
            raise NotCovered(f"frictionloss of joint {joint.name!r}, which is a {joint.kind} joint")
    on_site = ActuatorTarget.SITE
    return Tree(data, data.key(start), tuple(one for one in data.acting if one.target != on_site))


def refuse_weight_on_actuators(data: ModelData) -> None:
    """Raise NotCovered if actuators compensate weight, which is then part of their forces."""
    if any(body.weight_share for body in data.bodies):
        for joint in data.joints:
            if joint.takes_weight:
                raise NotCovered(f"actuatorgravcomp of joint {joint.name!r}")


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
