"""Jacobians, tip stiffness and singularities of flexible mechanisms."""

from dataclasses import dataclass

import numpy as np

from proofmass.analytic.numerics import Array
from proofmass.analytic.rods.closure import closure, determinant, solve
from proofmass.analytic.rods.state import Columns, State, columns


@dataclass(frozen=True)
class Derivatives:
    r"""First derivatives about equilibria (...) of k rods whose platform has p freedoms.

    Attributes
    ----------
    direct : ndarray (..., p, k)
        dP/dq at constant load [m/rad, rad/rad; m/m, rad/m].
    inverse : ndarray (..., k, p)
        dq/dP at constant load; NaN unless k = p.
    stiffness : ndarray (..., p, p)
        Wrench that the rods ask for, d(sum n, sum r x n)/dP with the inputs held [N/m, N, N m]:
        symmetric, and positive definite where the platform is stable on rods that are.
    direct_determinant : ndarray (...)
        Of the derivatives by (m0_1, n_1, m0_2, n_2, .., P): zero in a direct singularity, where
        the inputs no longer hold the platform: a fold of the equilibria, dP/dq infinite.
    rod_determinants : ndarray (..., k)
        Of each rod alone, by (m0, n) with its pin held: zero where a rod held at both ends buckles,
        and the stiffness has a pole.  direct_determinant = det(stiffness) times all of them.
    inverse_determinant : ndarray (...)
        Of those by (m0_1, n_1, q_1, m0_2, n_2, q_2, ..): zero in an inverse singularity, where some
        motion of the platform needs infinite rates of the inputs; NaN unless k = p.
    """

    direct: Array
    inverse: Array
    stiffness: Array
    direct_determinant: Array
    rod_determinants: Array
    inverse_determinant: Array


def derivatives(s: State) -> Derivatives:
    r"""First derivatives about closed states, exact, by the implicit function theorem.

    With the rows f of `proofmass.analytic.rods.closure` and R the columns of all rods::

        det(dP/dq) = (-1)^(p + 3 k (k - 1)/2) inverse_determinant/direct_determinant

    The sign is the order of the unknowns in the source; it is -1 for 2RFR and +1 for 3RFR.

    Notes
    -----
    Source: Pérez Gámiz 2018, eqs 99, 102, 111, 112 (unknowns and their order), text lines 4017-4050
    and 6994-7090.  Its text calls zeros of the two determinants inverse and direct singularities,
    as here; its program evaluates det(dq/dP) and det(dP/dq) instead, whose zeros are those of the
    *other* determinant, under the same two names.
    """
    a, (_, jacobian) = s.assembly, closure(s)
    rods, pose, inputs = (columns(a, name) for name in ("rods", "pose", "inputs"))
    free, k, p = columns(a, "rods", "pose"), a.rods, a.freedoms
    follow = ratio(jacobian, free, inputs)[..., 3 * k:, :]
    back, inverse = np.full((*follow.shape[:-2], k, p), np.nan), np.nan * follow[..., 0, 0]
    if k == p:
        held = columns(a, "rods", "inputs")
        back = ratio(jacobian, held, pose)[..., 3 * k:, :]
        order = np.concatenate([[*rods[3 * i:3 * i + 3], inputs[i]] for i in range(k)])
        inverse = determinant(jacobian[..., order])
    own = jacobian[..., :3 * k, :]
    carried = ratio(own, rods, pose)
    balance = jacobian[..., 3 * k:, :]
    stiffness = balance[..., rods] @ carried + balance[..., pose]
    own = np.stack([determinant(own[..., 3 * i:3 * i + 3, 3 * i:3 * i + 3]) for i in range(k)], -1)
    return Derivatives(follow, back, stiffness, determinant(jacobian[..., free]), own, inverse)


def ratio(jacobian: Array, unknown: Columns, given: Columns) -> Array:
    """Derivatives of unknown columns by given ones, where the rows stay zero; NaN if singular."""
    matrix, right = jacobian[..., unknown], -jacobian[..., given]
    rows, width = right.shape[-2:]
    flat = [solve(matrix.reshape(-1, rows, rows), right[..., i].reshape(-1, rows))
            for i in range(width)]
    return np.stack(flat, axis=-1).reshape(*right.shape[:-2], matrix.shape[-1], width)
