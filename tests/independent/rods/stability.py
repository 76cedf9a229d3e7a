r"""Stability of an equilibrium under constraints: curvatures of the energy along allowed motions.

H is the Hessian of the Lagrangian, A the matrix of the constraints' derivatives, and Z an
orthonormal basis of the null space of A.  An equilibrium is a minimum if Z^T H Z is positive
definite.  Newton's matrix of the equilibrium contains H and A::

    | H   -A^T |
    | -A   0   |
"""

import numpy as np
from numpy.typing import NDArray

from proofmass.base.arrays import Array


def curvatures(matrix: Array, constraints: int) -> Array:
    r"""Eigenvalues of the projected Hessian, lowest first.

    Parameters
    ----------
    matrix : ndarray (..., n + m, n + m)
        Newton's matrix, symmetric, as above.
    constraints : m, the number of independent constraints, which may be 0

    Returns
    -------
    ndarray (..., n - m); NaN where the matrix is not finite.
        Their values depend on the coordinates, their signs do not.

    Notes
    -----
    Z is computed by a complete QR factorisation of A^T.  Pérez Gámiz 2018 lists solutions without
    their stability.

    Examples
    --------
    A saddle is stable if only motions along its valley are allowed:

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


def count_negative(eigenvalues: Array) -> NDArray[np.int64]:
    """Number (...) of negative eigenvalues (..., n): 0 where the equilibrium is stable.

    >>> int(count_negative(np.array([-1.0, 2.0])))
    1
    """
    return np.asarray((eigenvalues < 0).sum(axis=-1))
