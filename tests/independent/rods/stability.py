r"""Stability of an equilibrium under constraints: how the energy curves along allowed motions.

With H the Hessian of the Lagrangian and A the slopes of the constraints, an equilibrium is a
minimum if Z^T H Z is positive definite, Z an orthonormal basis of A's null space.  Newton's matrix
of the equilibrium holds both::

    | H   -A^T |
    | -A   0   |
"""

import numpy as np
from numpy.typing import NDArray

from proofmass.analytic.numerics import Array


def curvatures(matrix: Array, constraints: int) -> Array:
    r"""Eigenvalues of the projected Hessian, lowest first.

    Parameters
    ----------
    matrix : ndarray (..., n + m, n + m)
        Newton's, as above, symmetric.
    constraints : m, independent ones; may be 0

    Returns
    -------
    ndarray (..., n - m); NaN where the matrix is not finite.
        Their signs do not depend on the coordinates, their values do.

    Notes
    -----
    Z from a complete QR factorisation of A^T.  Not in Pérez Gámiz 2018, which lists solutions
    without asking which of them stand.

    Examples
    --------
    A saddle is stable where only its valley is allowed:

    >>> curvatures(np.array([[2.0, 0.0, 0.0], [0.0, -1.0, 3.0], [0.0, 3.0, 0.0]]), 1)
    array([2.])
    """
    n = matrix.shape[-1] - constraints
    out = np.full((*matrix.shape[:-2], n - constraints), np.nan)
    found = np.isfinite(matrix).all(axis=(-1, -2))
    basis = np.linalg.qr(matrix[found][..., :n, n:], mode="complete").Q[..., constraints:]
    allowed = np.swapaxes(basis, -1, -2) @ matrix[found][..., :n, :n] @ basis
    out[found] = np.linalg.eigvalsh(allowed)
    return out


def negative(eigenvalues: Array) -> NDArray[np.int64]:
    """How many eigenvalues (..., n) are negative (...): 0 where the equilibrium is stable.

    >>> int(negative(np.array([-1.0, 2.0])))
    1
    """
    return np.asarray((eigenvalues < 0).sum(axis=-1))
