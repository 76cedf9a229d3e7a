"""The terms of the equations of motion of a tree, and what a source of them can be asked.

    M(q) v̇ + h(q, v) = Q(q, v) + Jᵀ λ,      φ(q) = 0,   J v̇ = γ(q, v)

There are two sources: the formulation of `proofmass.analytic.spatial.terms`, and MuJoCo in
`proofmass.sim.smooth`, which needs nothing of the solver in space.
"""

from dataclasses import dataclass
from typing import Protocol

from proofmass.base.arrays import Array


@dataclass(frozen=True)
class Terms:
    """The terms at one pose, or at n poses along a first axis.

    Attributes
    ----------
    mass : ndarray (..., rates, rates)
        Mass matrix M [SI].
    bias, force : ndarray (..., rates)
        Force h of inertia and gravity without accelerations, and force Q of springs, dampers and
        actuators [N or N m].
    gap : ndarray (..., rows)
        Constraint violations φ of the equalities [m or rad].
    jacobian : ndarray (..., rows, rates)
        Jacobian J of the equalities [SI].
    drift : ndarray (..., rows)
        Right-hand side γ [m/s^2 or rad/s^2].
    """

    mass: Array
    bias: Array
    force: Array
    gap: Array
    jacobian: Array
    drift: Array


TERM_NAMES = {
    "mass": "mass matrix",
    "bias": "bias force",
    "force": "force of springs, dampers and actuators",
    "gap": "constraint violation of the equalities",
    "jacobian": "Jacobian of the equalities",
    "drift": "J-dot-v of the equalities",
}
"""Names of the terms, for messages."""


class TermSource(Protocol):
    """A source of the terms at one pose."""

    @property
    def name(self) -> str:
        """Name of the program that computes the terms."""

    def __hash__(self) -> int:
        """Hash value, so that motions can be cached."""

    def terms(self, q: Array, v: Array, ctrl: Array | None = None) -> Terms:
        """All terms at a pose (poses,) with rates (rates,) and controls, by default the key's."""

    def equalities(self, q: Array) -> tuple[Array, Array]:
        """Violations (rows,) and Jacobian (rows, rates) of equalities at a pose (poses,) [SI]."""

    def acceleration(self, q: Array, v: Array, ctrl: Array | None = None) -> Array:
        """Accelerations (rates,) of a tree without equalities [SI]."""

    def first_contact(self, times: Array | None, q: Array) -> str:
        """The first contact of poses (n, poses), and between them if they have times (n,) [s].

        Returns
        -------
        str
            Which geoms touch and when; empty if none do.

        Raises
        ------
        NotCovered
            The source has no shapes of bodies.
        """
