"""Newton's method with halved steps for batches of equilibria, and loads that grow in steps."""

from collections.abc import Callable

import numpy as np

from proofmass.base.arrays import Array
from tests.independent.rods.chain_matrix import Bordered

System = Callable[[Array], tuple[Array, Bordered]]

STEP_TOLERANCE = (
    1e-9  # [rad] largest last step of Newton's method; the remaining error is its square
)
MAX_ITERATIONS = 50  # largest number of Newton's iterations
MIN_STEP_SHARE = 2.0**-12  # share of Newton's step at which the halving ends without success
MAX_TURN = 0.5  # [rad] rotation of a segment in a load step from which on the branch could change
MIN_LOAD_STEP = 2.0**-10  # smallest step of a load, as a share of it


def newton(system: System, start: Array, angles: int) -> Array:
    r"""Zeros of a batch of systems, by Newton's method with halved steps.

    A step d = J^-1 r is halved to t d until the step that follows is shorter::

        |J^-1 r(x - t d)| <= (1 - t/4) |d|

    The units of the residual do not change the result of this test.

    Parameters
    ----------
    system : callable
        ``system(unknowns)`` gives the residual (..., N) and its slopes, a `Bordered` matrix.
    start : ndarray (..., N)
    angles : number of angles [rad] among the unknowns, which are the first ones; only their steps
        are measured

    Returns
    -------
    ndarray (..., N); NaN where no zero was found.

    Notes
    -----
    Source: P. Deuflhard, Newton Methods for Nonlinear Problems, Springer 2004, natural monotonicity
    test.

    Examples
    --------
    >>> def arctan(x):
    ...     return np.arctan(x), Bordered(1 / (1 + x**2)[:, None, None], np.zeros((1, 1, 0)),
    ...                                   np.zeros((0, 0)))
    >>> newton(arctan, np.array([3.0]), 1)
    array([0.])
    """
    unknowns = np.array(start, float)
    residual, matrix = system(unknowns)
    for _ in range(MAX_ITERATIONS):
        step = matrix.solve(residual)
        size, share = norm_of_angles(step, angles), np.ones(step.shape[:-1])
        converged = size < STEP_TOLERANCE
        while True:
            trial = unknowns - share[..., None] * step
            residual, after = system(trial)
            accepted = converged | (
                norm_of_angles(matrix.solve(residual), angles) <= (1 - share / 4) * size
            )
            if np.all(accepted | ~(share > MIN_STEP_SHARE) | np.isnan(size)):
                break
            share = np.where(accepted, share, share / 2)
        unknowns, matrix = np.where(accepted[..., None], trial, np.nan), after
        if np.all(converged | ~accepted):
            break
    unknowns[~converged] = np.nan
    return unknowns


def norm_of_angles(step: Array, angles: int) -> Array:
    """Root of the sum of squares of a step's angles (...) [rad]."""
    return np.asarray(np.linalg.norm(step[..., :angles], axis=-1))


def follow_in_steps(solve: Callable[[float, Array], Array], start: Array, angles: int) -> Array:
    """Apply a load in steps: ``solve(part, seed)`` for shares of the load that rise to 1.

    A step is halved if Newton's method fails or a segment turns by more than 0.5 rad, so that the
    equilibria stay on the branch of `start`, the equilibrium without load.  All members of a batch
    take the same steps, and all are NaN if the steps become too small.
    """
    applied, step, unknowns = 0.0, 1.0, start
    while applied < 1.0:
        trial = solve(min(1.0, applied + step), unknowns)
        if np.all(np.abs(trial - unknowns)[..., :angles] < MAX_TURN):
            applied, step, unknowns = applied + step, 2 * step, trial
        elif step < MIN_LOAD_STEP:
            return np.full_like(start, np.nan)
        else:
            step /= 2
    return unknowns
