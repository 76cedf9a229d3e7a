"""Balancers by the batch held against a target: what a search for the best design evaluates."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from proofmass.analytic.balancer.design import balancers
from proofmass.analytic.balancer.follow import follow
from proofmass.analytic.balancer.measures import (
    energy_spread,
    precision_points,
    rmse,
    work_reduction,
)
from proofmass.analytic.balancer.path import along
from proofmass.analytic.balancer.variants import Variant
from proofmass.analytic.numerics import Array

POINTS = {3: 90, 4: 15}  # of the thesis, by segments
COARSE = 15  # points of a coarse look, at most
BENT = 0.02  # sine of the last joint's angle: what is straighter can flip its elbow
BETWEEN = 1.25  # times as much at few points: between them the elbow may be straighter
RIGHT_ANGLE = np.pi / 2 + 1e-9  # [rad] so that rounding does not end a path before its last point
SMALL = 1e-4  # of m g r: errors below it count as squares for any power


@dataclass(frozen=True)
class Figures:
    """What designs are worth, each (B,): NaN for one that cannot be built.

    Attributes
    ----------
    rmse, work_reduction, spread : ndarray (B,)
        `proofmass.analytic.balancer.measures`, at m g r = 1 N m: [1], [%], [1].
    """

    rmse: Array
    work_reduction: Array
    spread: Array


@dataclass(frozen=True)
class Synthesis:
    r"""A search for the balancer whose moment comes nearest to a target.

    ::

        minimise    mean_j |M1(alpha_j; p) - target_j|^power  +  weight^2 spread^2
        subject to  low <= p <= high,
                    a rest posture that is stable, a path from it to 90 degrees without a fold,
                    mode sin(theta_n - theta_(n-1)) > 0.02 all along: the elbow never straightens

    Parameters
    ----------
    variant : Variant
        What is free, and within which bounds.
    target : callable
        Wanted moment [N m] at pendulum angles [rad], for m g r = 1 N m.
    points : int, optional
        Points j 90/points degrees, j = 1, 2 ..; as many as in the thesis when not given.
    power : float
        2 for the least error, 1 for the best work reduction, or between.
    weight : float
        Of the spread of energy between the springs, a second aim (here its mean square).

    Notes
    -----
    Terms are exact to rounding.  Errors below 1e-4 enter as squares, so that a power below 2 has a
    slope at zero.
    """

    variant: Variant
    target: Callable[[Array], Array]
    points: int = 0
    power: float = 2.0
    weight: float = 0.0

    @property
    def low(self) -> Array:
        """Lower bounds (d,)."""
        return np.array([low for low, _ in self.variant.bounds.values()])

    @property
    def high(self) -> Array:
        """Upper bounds (d,)."""
        return np.array([high for _, high in self.variant.bounds.values()])

    @property
    def angles(self) -> Array:
        """The points [rad]."""
        return precision_points(self.points or POINTS[self.variant.segments])

    @property
    def fingerprint(self) -> str:
        """What tells this search from any other."""
        wanted = np.asarray(self.target(self.angles), float).tolist()
        return repr((self.variant, wanted, self.power, self.weight))

    def coarse(self, vectors: Array) -> Array:
        """Terms (B, m), at few points, whose squares add up to the aim; NaN if not buildable."""
        return self.terms(vectors, precision_points(min(COARSE, self.angles.size)), BETWEEN * BENT)

    def residuals(self, vectors: Array) -> Array:
        """The same at all points."""
        return self.terms(vectors, self.angles)

    def terms(self, vectors: Array, angle: Array, bent: float = BENT) -> Array:
        """The same at angles (A,), for elbows that stay bent by more than the sine `bent`."""
        moment, energy = self.curves(vectors, angle, bent)
        found = moment - self.target(angle)
        if self.power != 2.0:
            found = found * (found**2 + SMALL**2) ** (self.power / 4.0 - 0.5)
        if self.weight:
            n = self.variant.segments
            uneven = np.sqrt(n) * (energy - energy.mean(axis=-1, keepdims=True))
            found = np.concatenate([found, self.weight * uneven.reshape(len(found), -1)], axis=-1)
        return found / np.sqrt(angle.size)

    def figures(self, vectors: Array) -> Figures:
        """Figures of designs (B, d) at all points."""
        moment, energy = self.curves(vectors, self.angles)
        wanted = self.target(self.angles)
        return Figures(rmse(moment, wanted), work_reduction(moment, wanted, self.angles),
                       energy_spread(*np.moveaxis(energy, -1, 0)))

    def curves(self, vectors: Array, angle: Array, bent: float = BENT) -> tuple[Array, Array]:
        """Balancing moments (B, A) [N m] and energies (B, A, n) [J]; NaN where not buildable."""
        there, n = np.flatnonzero(np.isfinite(vectors).all(axis=-1)), self.variant.segments
        chains = balancers(**self.variant.parameters(vectors[there]))
        possible = np.isfinite(chains.rest + chains.stiffness).all(axis=-1)
        there, chains = there[possible], chains[possible]
        moment = np.full((len(vectors), angle.size), np.nan)
        energy = np.full((len(vectors), angle.size, n), np.nan)
        if there.size:
            with np.errstate(all="ignore"):  # a path that ends leaves nothing to solve beyond
                path = along(chains, follow(chains, RIGHT_ANGLE), angle)
                last, before = path.theta[..., -1], path.theta[..., -2]
                good = (self.variant.mode * np.sin(last - before) > bent).all(axis=-1)
            moment[there[good]], energy[there[good]] = path.moment[good, :, 0], path.energy[good]
        return moment, energy
