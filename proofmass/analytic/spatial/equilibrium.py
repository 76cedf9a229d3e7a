"""Equilibrium equations of a tree in space, for `proofmass.analytic.equilibrium`."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from proofmass.analytic.numerics import CannotAssemble
from proofmass.analytic.spatial.kinematics import normalize_quaternions
from proofmass.analytic.spatial.mechanism import Tree, quaternion_product
from proofmass.analytic.spatial.motion import (
    MAX_ASSEMBLY_STEPS,
    VIOLATION_TOLERANCE,
    ConstrainedTree,
)
from proofmass.analytic.spatial.terms import OwnTerms, own_terms
from proofmass.analytic.stops import Stop, make_stops
from proofmass.base.arrays import Array, Index


@dataclass(frozen=True)
class TreeAtRest:
    """A tree whose drives leave degrees of freedom, for `EquilibriumSolver`.

    Attributes
    ----------
    tree : Tree
    joints : tuple of str
        The driven joints.
    """

    tree: Tree
    joints: tuple[str, ...]

    @property
    def sizes(self) -> Array:
        """Units of its rates (rates,): 1 rad, or the size of the model [m]."""
        return self.tree.sizes

    @cached_property
    def places(self) -> tuple[Index, Index]:
        """Indices of the drives in a pose and in the rates (drives,)."""
        return self.tree.places(self.joints)

    @property
    def driven(self) -> Index:
        """Indices of the drives in the rates (drives,)."""
        return self.places[1]

    @cached_property
    def stops(self) -> tuple[Stop, ...]:
        """Stops of the joints that are not driven."""
        return tuple(
            stop
            for joint in self.tree.joints
            if joint.is_scalar and joint.rate not in self.driven
            for stop in make_stops(
                joint.name, joint.stop_range, joint.pose, joint.rate, float(self.sizes[joint.rate])
            )
        )

    @cached_property
    def closed(self) -> tuple[Array, float]:
        """The start pose (poses,) with closed equalities, and their largest violation before."""
        q, _, gap = ConstrainedTree(self.tree, OwnTerms(self.tree)).start()
        return q, gap

    def begin(self, values: Array) -> Array:
        """Find the closed pose (poses,) nearest to the start, with the drives at values (drives,).

        Raises
        ------
        CannotAssemble
            The equalities stay open.
        """
        q = self.closed[0][None]
        units = np.eye(self.sizes.size)[self.driven]
        for _ in range(MAX_ASSEMBLY_STEPS):
            found = own_terms(self.tree, q, np.zeros((1, self.sizes.size)))
            drive_violations = self.values(q)[0] - values
            violations = np.concatenate([found.gap[0], drive_violations])
            if np.abs(violations).max() < VIOLATION_TOLERANCE * max(1.0, self.tree.extent):
                return np.asarray(q[0])
            rows = np.vstack([found.jacobian[0], units]) * self.sizes
            q = self.moved(q, -self.sizes * np.linalg.lstsq(rows, violations)[0][None])
        raise CannotAssemble(
            f"the equalities stay open by {np.abs(violations).max():.3g} with the drives at "
            f"{', '.join(f'{value:.6g}' for value in values)}"
        )

    def moved(self, q: Array, moves: Array) -> Array:
        """Poses (n, poses) that moves (n, rates) lead to; balls turn about constant axes."""
        found, (places, rates) = q.copy(), self.tree.scalars
        found[:, places] += moves[:, rates]
        for pose_index, rate_index in self.tree.quaternions:
            rotations = moves[:, rate_index : rate_index + 3]
            angle = np.linalg.norm(rotations, axis=1, keepdims=True)
            half = np.sinc(angle / (2 * np.pi)) / 2 * rotations
            quaternion = np.concatenate([np.cos(angle / 2), half], axis=1)
            found[:, pose_index : pose_index + 4] = normalize_quaternions(
                quaternion_product(q[:, pose_index : pose_index + 4], quaternion)
            )
        return found

    def pushed(self, q: Array, ctrl: Array | None) -> tuple[Array, Array, Array]:
        """Generalized forces (n, rates) at poses q (n, poses), and the equalities' Jacobian.

        The third array has the violations of the equalities (n, rows) [rad, or sizes].
        """
        found = own_terms(self.tree, q, np.zeros((len(q), self.sizes.size)), ctrl)
        sizes = self.tree.row_sizes
        return found.force - found.bias, found.jacobian / sizes[:, None], found.gap / sizes

    def values(self, q: Array) -> Array:
        """Values of the drives (n, drives) [rad or m]."""
        return q[:, self.places[0]]
