"""Stability of a rod under dead loads: how many negative directions its energy has."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from proofmass.analytic.numerics import Array
from proofmass.analytic.rods.shooting import from_tip


@dataclass(frozen=True)
class Stability:
    """Negative directions of V with the tip free and with it pinned; the tip's compliance.

    free, pinned : (...) numbers of negative eigenvalues; 0 is stable
    compliance : (2, 2, ...) of the tip's place by the dead load on it [m/N]
    """

    free: Array
    pinned: Array
    compliance: Array


def stability(
    n_x: ArrayLike, n_y: ArrayLike, theta: ArrayLike, moment: ArrayLike = 0.0, *,
    weight_x: float = 0.0, weight_y: float = 0.0,
    length: float = 1.0, stiffness: float = 1.0, nodes: int = 201,
) -> Stability:
    r"""Negative directions of the second variation at an equilibrium, known by its tip.

    ::

        d2V[h] = int EI h'^2 + (N_x cos(theta) + N_y sin(theta)) h^2 ds,    h(0) = 0

    Tip free: as many as Jacobi's field has zeros on (0, L), which begins at the tip with h = 1 and
    h' = 0 and obeys EI h'' = (N . t) h.  Tip pinned: with C = d(x, y)/d(n_x, n_y) at constant clamp
    and constant moment of the tip::

        pinned = free - (number of negative eigenvalues of C)

    since the inertia of a bordered matrix is that of its block and of the Schur complement.

    Parameters
    ----------
    n_x, n_y, theta, moment : force [N] on the tip, its angle [rad], moment [N m] on it (...)
    weight_x, weight_y : dead load per length [N/m]
    length, stiffness, nodes : of `integrate`

    Returns
    -------
    Stability

    Notes
    -----
    A field that passes zero and returns between two nodes is not seen: `nodes` must be many for
    each half wave.  Exactly at a critical load the count is either of the two beside it.  Not in
    Pérez Gámiz 2018, which has no stability.  Inertia: E. V. Haynsworth, Linear Algebra Appl. 1
    (1968) 73-81.

    Examples
    --------
    >>> column = stability([-2.0, -3.0, -21.0, -23.0], 0.0, 0.0)     # pi^2/4, 20.19, 9 pi^2/4
    >>> column.free.tolist(), column.pinned.tolist()
    ([0, 1, 1, 2], [0, 0, 1, 1])
    """
    rods = from_tip(n_x, n_y, theta, moment, weight_x=weight_x, weight_y=weight_y, length=length,
                    stiffness=stiffness, nodes=nodes, slopes=True)
    field, end = rods.slope[:, 0, 3], rods.slope[-1]
    compliance = end[2:, :2] - end[2:, 3:] * (end[:1, :2] / end[0, 3])
    free = np.sum(np.signbit(field[1:]) != np.signbit(field[:-1]), axis=0)
    eigenvalues = np.linalg.eigvalsh(np.moveaxis(compliance, (0, 1), (-2, -1)))
    return Stability(free, free - np.sum(eigenvalues < 0.0, axis=-1), compliance)
