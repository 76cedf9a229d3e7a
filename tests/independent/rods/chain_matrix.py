r"""Newton's matrix of an equilibrium: a block for each chain, bordered by the common unknowns.

::

    | H_1           B_1 |     H_i  Hessian of the Lagrangian by the angles of chain i
    |      H_2      B_2 |     B_i  its mixed derivatives by angles, and pose and multipliers
    | B_1^T  B_2^T   C  |     C    its Hessian by pose and multipliers
"""

from dataclasses import dataclass

import numpy as np

from proofmass.base.arrays import Array


@dataclass(frozen=True)
class Bordered:
    """A batch of symmetric matrices.

    Attributes
    ----------
    block : ndarray (..., k, n, n), H_i
    border : ndarray (..., k, n, m), B_i
    corner : ndarray (..., m, m), C
    """

    block: Array
    border: Array
    corner: Array

    def solve(self, right: Array) -> Array:
        """``matrix^-1 right`` (..., kn + m) by elimination of the blocks; NaN where it is singular.

        >>> two = Bordered(np.array([[[2.0]]]), np.array([[[1.0]]]), np.zeros((1, 1)))
        >>> two.solve(np.array([4.0, 1.0]))
        array([1., 2.])
        """
        *batch, k, n, m = self.border.shape
        split = k * n
        upper = right[..., :split].reshape(*batch, k, n, 1)
        inner = solve_or_nan(self.block, np.concatenate([self.border, upper], axis=-1))
        folded = (np.swapaxes(self.border, -1, -2) @ inner).sum(axis=-3)
        shared = solve_or_nan(
            self.corner - folded[..., :m], right[..., split:, None] - folded[..., m:]
        )
        outer = inner[..., m:] - inner[..., :m] @ shared[..., None, :, :]
        return np.concatenate([outer.reshape(*batch, split), shared[..., 0]], axis=-1)

    def dense(self) -> Array:
        """The matrices with all their zeros (..., kn + m, kn + m)."""
        *batch, k, n, m = self.border.shape
        out = np.zeros((*batch, k * n + m, k * n + m))
        for i in range(k):
            out[..., i * n : (i + 1) * n, i * n : (i + 1) * n] = self.block[..., i, :, :]
        out[..., : k * n, k * n :] = self.border.reshape(*batch, k * n, m)
        out[..., k * n :, : k * n] = np.swapaxes(out[..., : k * n, k * n :], -1, -2)
        out[..., k * n :, k * n :] = self.corner
        return out


def solve_or_nan(matrix: Array, right: Array) -> Array:
    """``matrix^-1 right`` (..., n, m) for each of a batch; NaN where a matrix is singular."""
    try:
        return np.asarray(np.linalg.solve(matrix, right))
    except np.linalg.LinAlgError:
        with np.errstate(invalid="ignore"):  # a matrix may be NaN already
            good = np.isin(np.linalg.slogdet(matrix).sign, (-1.0, 1.0))[..., None, None]
        found = np.linalg.solve(np.where(good, matrix, np.eye(matrix.shape[-1])), right)
        return np.where(good, found, np.nan)
