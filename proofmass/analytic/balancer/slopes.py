"""Derivatives of a balancer's moment by its parameters, at the equilibria of its path.

At an equilibrium R(u, p) = 0 of the unknowns u (`proofmass.analytic.balancer.path`), with a
parameter p, the implicit function theorem gives, as long as no stop switches::

    du/dp = -(dR/du)^-1 dR/dp,      dM/dp = dM/dp at constant u + dM/du du/dp

dR/du is Newton's matrix.  dR/dp and dM/dp at constant u are differences of closed formulas, for
which no equilibrium has to be found again.
"""

from collections.abc import Sequence

import numpy as np

from proofmass.analytic.balancer.model import Balancer
from proofmass.analytic.balancer.path import (
    BalancerPaths,
    Point,
    deflections,
    equilibria_along,
    system,
)
from proofmass.base.arrays import Array


def moment_slopes(
    b: Balancer, paths: BalancerPaths, alpha: Array, changed: Sequence[Balancer], change: Array
) -> tuple[Array, Array, Array]:
    """Balancing moments of a batch (B,) at pendulum angles (A,), and their derivatives.

    Parameters
    ----------
    b, paths : Balancer, BalancerPaths
        The batch, and its paths to the last angle or beyond.
    alpha : ndarray (A,)
        Pendulum angles [rad].
    changed : sequence of d Balancer
        The batch with one parameter changed.
    change : ndarray (B, d)
        The changes [SI]; small, so that differences of closed formulas are derivatives.

    Returns
    -------
    moment : ndarray (B, A)
        dV*/dalpha [N m]; NaN beyond the end of a path.
    slopes : ndarray (B, d, A)
        Derivatives [N m over the parameter's unit]; NaN likewise.
    theta : ndarray (B, A, n)
        Angles of the segments from the upright [rad].
    """
    equilibria = equilibria_along(b, paths, alpha)
    each, found, reached = equilibria.each, equilibria.point, equilibria.reached
    design = np.repeat(np.arange(len(b)), alpha.size)[reached]
    residual, matrix = system(each, found)
    here = moments_at(each, found)
    others = [one[design] for one in changed]
    step = change[design].T
    with np.errstate(invalid="ignore", divide="ignore"):  # a change may be impossible
        rises = (
            np.stack([system(o, found)[0] - residual for o in others], axis=-1) / step.T[:, None]
        )
        own = np.stack([moments_at(o, found) - here for o in others], axis=-1) / step.T
    moves = -solve_each(matrix, rises)
    turned = spring_slopes(each, found)[:, None] * moves[:, 0]
    pull = each.stretch(found.alpha)[:, None] * moves[:, b.segments + 1]
    slopes = own + turned - pull
    count, width = len(b), alpha.size
    values = np.full((count * width, 1 + len(changed) + b.segments), np.nan)
    values[reached] = np.column_stack(
        [here, slopes, found.unknowns[:, : b.segments] + found.alpha[:, None]]
    )
    out = values.reshape(count, width, -1)
    last = 1 + len(changed)
    return out[..., 0], out[..., 1:last].swapaxes(-1, -2), out[..., last:]


def moments_at(b: Balancer, p: Point) -> Array:
    """Balancing moments (K,) at points of the path [N m]."""
    n = b.segments
    first = b.moments(deflections(b, p.alpha, p.unknowns[:, :n]))[:, 0]
    return np.asarray(first - p.unknowns[:, n + 1] * b.stretch(p.alpha))


def spring_slopes(b: Balancer, p: Point) -> Array:
    """Stiffness (K,) of spring 1 at points of the path [N m/rad]."""
    return np.asarray(b.slopes(deflections(b, p.alpha, p.unknowns[:, : b.segments]))[:, 0])


def solve_each(matrix: Array, right: Array) -> Array:
    """Solve ``matrix x = right`` (K, N, d) for each of a batch; NaN where a matrix is singular."""
    try:
        return np.asarray(np.linalg.solve(matrix, right))
    except np.linalg.LinAlgError:
        out = np.full_like(right, np.nan)
        for k in np.flatnonzero(np.linalg.det(matrix) != 0.0):
            out[k] = np.linalg.solve(matrix[k], right[k])
        return out
