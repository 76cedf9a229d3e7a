"""Newton's method with halved steps for batches of equilibria, and loads put on in steps."""

from collections.abc import Callable

import numpy as np

from proofmass.analytic.numerics import Array
from tests.independent.rods.chain_matrix import Bordered

System = Callable[[Array], tuple[Array, Bordered]]

STILL = 1e-9  # [rad] the last step; what is left is its square
MOST = 50
SMALLEST = 2.0**-12  # part of Newton's step below which Newton is lost
NEAR = 0.5  # [rad] a load step that turns a segment by more could change the branch
LEAST = 2.0**-10  # part of the load


def newton(system: System, start: Array, angles: int) -> Array:
    r"""Zeros of a batch of systems, by Newton's method with halved steps.

    A step d = J^-1 r is halved to t d until it leads on: until the next step with the old J, which
    no choice of units changes, has become shorter::

        |J^-1 r(x - t d)| <= (1 - t/4) |d|

    Parameters
    ----------
    system : callable
        ``system(unknowns)`` gives the residual (..., N) and its slopes, a `Bordered` matrix.
    start : ndarray (..., N)
    angles : how many of the unknowns, the first ones, are angles [rad]; their steps count

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
    for _ in range(MOST):
        step = matrix.solve(residual)
        size, part = turn(step, angles), np.ones(step.shape[:-1])
        still = size < STILL
        while True:
            trial = unknowns - part[..., None] * step
            residual, after = system(trial)
            on = still | (turn(matrix.solve(residual), angles) <= (1 - part / 4) * size)
            if np.all(on | ~(part > SMALLEST) | np.isnan(size)):
                break
            part = np.where(on, part, part / 2)
        unknowns, matrix = np.where(on[..., None], trial, np.nan), after
        if np.all(still | ~on):
            break
    unknowns[~still] = np.nan
    return unknowns


def turn(step: Array, angles: int) -> Array:
    """Root of the sum of squares of a step's angles (...) [rad]."""
    return np.asarray(np.linalg.norm(step[..., :angles], axis=-1))


def follow(solve: Callable[[float, Array], Array], start: Array, angles: int) -> Array:
    """Put a load on in steps: ``solve(part, seed)`` for parts that rise to 1; NaN where it is lost.

    Steps are halved where Newton fails or a segment turns by more than 0.5 rad, so that the branch
    of `start`, the equilibrium without load, is kept as far as it goes.  A batch goes in equal
    steps and is lost as a whole.
    """
    done, step, unknowns = 0.0, 1.0, start
    while done < 1.0:
        trial = solve(min(1.0, done + step), unknowns)
        if np.all(np.abs(trial - unknowns)[..., :angles] < NEAR):
            done, step, unknowns = done + step, 2 * step, trial
        elif step < LEAST:
            return np.full_like(start, np.nan)
        else:
            step /= 2
    return unknowns
