"""Forces and moments between the bodies of a spatial mechanism, by Newton's and Euler's equations.

The force on a body from its parent is the sum of the inertial forces and weights of the body and of
all bodies that it carries, less the forces of loops and of loads on sites on them.  The forces of
the loops follow from the equations of motion::

    J' s = M a + h - Q        J: rows of the equalities and of the drives, s: their forces

They are determined if all rows are independent and no tendon exerts a force.
"""

from collections.abc import Iterator
from dataclasses import replace
from functools import cached_property

import numpy as np

from proofmass.analytic.mjcf import LoopData, carried_bodies
from proofmass.analytic.spatial.kinematics import TreeMotion, cross3
from proofmass.analytic.spatial.mechanism import Tree
from proofmass.analytic.spatial.terms import (
    newton_euler_forces,
    own_terms,
    site_load_forces,
    weld_slope,
)
from proofmass.base.arrays import Array

REACTION_RANK_TOLERANCE = 1e-8
"""Share of the largest singular value below which rows of loops and drives count as dependent."""


PoseStates = tuple[Array, Array, Array]
"""Poses (n, poses), rates and accelerations (n, rates) [SI]."""


def required_constraint_forces(
    tree: Tree, state: PoseStates, joints: tuple[str, ...], ctrl: Array | None
) -> tuple[Array, Array]:
    """Sum of the generalized constraint forces that a motion requires (n, rates) [N m or N].

    The second array has the rows of the equalities (n, rows, rates).  Actuators of the driven
    joints do not act.
    """
    q, v, a = state
    _, dofs = tree.places(joints)
    acting = tuple(one for one in tree.actuators if one.rate not in dofs)
    found = own_terms(replace(tree, actuators=acting), q, v, ctrl)
    needed = np.einsum("nij,nj->ni", found.mass, a) + found.bias - found.force
    return needed, found.jacobian


def is_determined(tree: Tree) -> bool:
    """Whether no tendon exerts a force, by a spring, damper, actuator or equality."""
    has_forces = any(any(one.stiffness) or any(one.damping) for one in tree.tendons)
    actuated = any(one.tendon >= 0 for one in tree.actuators)
    return not (has_forces or actuated or any(tie.tendons for tie in tree.ties))


class Reactions:
    """Forces and moments on the bodies of a tree from their parents in n poses.

    Parameters
    ----------
    tree : Tree
    motion : TreeMotion
        With rates and accelerations.
    state : three ndarray
        See `PoseStates`.
    joints : tuple of str
        The driven joints, whose actuators do not act.
    pushes : ndarray (n, rates)
        Forces of stops on the joints [N m or N].
    ctrl : ndarray (n, controls), optional
        By default those of the key [SI].

    Attributes
    ----------
    drives : ndarray (n, drives)
        Moments or forces of the drives, without the actuators of their joints [N m or N].
    unique : bool
        Whether the motion determines the forces between the bodies.
    """

    def __init__(
        self,
        tree: Tree,
        motion: TreeMotion,
        state: PoseStates,
        joints: tuple[str, ...],
        pushes: Array,
        ctrl: Array | None,
    ):
        self.tree, self.motion, self.ctrl = tree, motion, ctrl
        needed, rows = required_constraint_forces(tree, state, joints, ctrl)
        driven = np.eye(needed.shape[1])[tree.places(joints)[1]]
        driven = np.broadcast_to(driven, (len(needed), *driven.shape))
        # drives are constraints of their joints: both are found from the forces that a motion needs
        across = np.concatenate([rows, driven], axis=1).swapaxes(1, 2)
        sizes = np.linalg.svd(across, compute_uv=False)
        self.unique = is_determined(tree) and across.shape[2] <= across.shape[1]
        self.unique &= not sizes.size or bool(
            (sizes[:, -1] > REACTION_RANK_TOLERANCE * sizes[:, 0]).all()
        )
        inverse = np.linalg.pinv(across, rcond=REACTION_RANK_TOLERANCE)
        self.forces = (inverse @ (needed - pushes)[..., None])[..., 0]
        self.drives = self.forces[:, rows.shape[1] :]

    @cached_property
    def balances(self) -> tuple[Array, Array]:
        """Inertial forces less weights, and moments: see `proofmass.analytic.spatial.terms`."""
        turn = self.motion.turn
        return newton_euler_forces(
            self.tree, self.motion, turn @ self.tree.masses[2] @ np.swapaxes(turn, -1, -2)
        )

    def on(self, body: int, points: Array) -> tuple[Array, Array]:
        """Force [N] and moment about points `points` [N m] (n, 3) on a body from its parent."""
        carried = carried_bodies([one.parent for one in self.tree.bodies], body)
        force, moment = np.zeros(points.shape), np.zeros(points.shape)
        for b in carried:
            push, twist = (part[:, b] for part in self.balances)
            arm = self.motion.point(b, self.tree.bodies[b].centre) - points
            force, moment = force + push, moment + twist + cross3(arm, push)
        for b, place, push, twist in self.loop_and_load_forces():
            if b in carried:
                force, moment = force - push, moment - twist - cross3(place - points, push)
        return force, moment

    def loop_and_load_forces(self) -> Iterator[tuple[int, Array, Array, Array]]:
        """Iterate over loops and loads on sites: body, point, force and moment (n, 3) each."""
        first = 0
        for loop in self.tree.loops:
            width = 3 if loop.turns is None else 6
            own, first = self.forces[:, first : first + width], first + width
            push, twist = own[:, :3], self.twist(loop, own[:, 3:])
            yield loop.one, self.motion.point(loop.one, loop.on_one), push, twist
            yield loop.two, self.motion.point(loop.two, loop.on_two), -push, -twist
        for load, push, twist in site_load_forces(self.tree, self.motion, self.ctrl):
            yield load.body, self.motion.point(load.body, load.at), push, twist

    def twist(self, loop: LoopData, forces: Array) -> Array:
        """Moment of a weld on its first body (n, 3); zero for a connect."""
        if loop.turns is None:
            return np.zeros((len(self.forces), 3))
        return loop.scale * np.einsum("nik,ni->nk", weld_slope(self.motion, loop), forces)
