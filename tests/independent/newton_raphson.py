"""Newton-Raphson iteration that keeps a log of every step."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
System = Callable[[Array], tuple[Array, Array]]
RANK_MARGIN = 1e-5  # singular values below it count as zero, as in the documents


@dataclass(frozen=True)
class Solution:
    """Last iterate and log: row i tells of iterate i, before its step, and of that step."""

    root: Array  # (unknowns,)
    steps: Array  # (iterations,) norm of the step
    residuals: Array  # (iterations,) norm of the residual
    ranks: NDArray[np.int_]  # (iterations,) rank of the Jacobian
    conditions: Array  # (iterations,) its condition number

    @property
    def iterations(self) -> int:
        return self.steps.size


class NotConverged(ValueError):
    """No root within the iterations allowed; `solution` is as far as it came."""

    def __init__(self, message: str, solution: Solution) -> None:
        super().__init__(message)
        self.solution = solution


class Singular(NotConverged):
    """The Jacobian of an iterate has no inverse, or is not finite."""


def newton_raphson(
    system: System, start: ArrayLike, *, tolerance: float = 1e-10, most: int = 101
) -> Solution:
    r"""Root of F(x) = 0 by x <- x + dx with J(x) dx = -F(x), until |dx| <= tolerance.

    Parameters
    ----------
    system : x (unknowns,) -> F (equations,), J (equations, unknowns). With more equations than
        unknowns the step is that of least squares (Gauss-Newton).
    start : first iterate (unknowns,)
    tolerance : largest norm of the last step, in the mixed units of x
    most : number of iterations allowed

    Returns
    -------
    Solution : the root, whose error is about tolerance^2 where J is regular, and the log

    Raises
    ------
    NotConverged
        After `most` iterations, or once an iterate is not finite.
    Singular
        A square Jacobian has no inverse, or any is not finite.

    Notes
    -----
    The test is on the step, not on the residual, as in the two documents solved by it: B. Díaz
    Lozano, TFG, Universidad de Almería 2019, text lines 1417-1469 (1e-10, 101 iterations) and the
    power hacksaw report, Universidad Nacional de Colombia, text lines 196, 345 (1e-6). It does not
    know which root it meets: check the branch.

    Examples
    --------
    >>> found = newton_raphson(lambda x: (x**2 - 2.0, np.diag(2.0 * x)), [1.0])
    >>> found.iterations, round(float(found.root[0]), 12)
    (5, 1.414213562373)
    """
    x, log = np.array(start, float), np.empty((0, 4))
    for _ in range(most):
        residual, jacobian = system(x)
        try:
            sizes = np.linalg.svd(jacobian, compute_uv=False)
            step = _step(jacobian, -residual)
        except np.linalg.LinAlgError:
            raise Singular(
                f"singular Jacobian at iteration {len(log) + 1}", _solution(x, log)
            ) from None
        condition = sizes[0] / sizes[-1] if sizes[-1] > 0.0 else np.inf
        row = np.array(
            [np.linalg.norm(step), np.linalg.norm(residual), np.sum(sizes > RANK_MARGIN), condition]
        )
        x, log = x + step, np.vstack([log, row])
        if row[0] <= tolerance:
            return _solution(x, log)
        if not np.isfinite(x).all():
            break
    raise NotConverged(
        f"no root in {len(log)} iterations: the last step is {log[-1, 0]:.3g}", _solution(x, log)
    )


def _step(jacobian: Array, right: Array) -> Array:
    square = jacobian.shape[0] == jacobian.shape[1]
    step = np.linalg.solve(jacobian, right) if square else np.linalg.lstsq(jacobian, right)[0]
    return np.asarray(step, float)


def _solution(x: Array, log: Array) -> Solution:
    steps, residuals, ranks, conditions = log.T
    return Solution(x, steps, residuals, ranks.astype(int), conditions)
