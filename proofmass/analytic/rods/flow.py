r"""The tip of a clamped rod under an end load, with exact derivatives: a chain of high order.

::

      m0  clamp         tip   n             z' = exp(i theta),   m = m0 + Im(conj(n) z),
     _|/________________.--->               theta' = m/EI        z, n = x + iy from the clamp
      |\   theta(s)

Freezing theta moves z along a straight segment; freezing z turns theta in a hinge.  Alternated with
half a segment at both ends that is a chain of n rigid segments and hinge springs, of second order;
with the lengths and hinges below, some of them negative, the same chain is of sixth order.  Each
part is solved exactly, so the map is symplectic, and the tip stiffness that it gives is symmetric
to rounding.
"""

import numpy as np
from numpy.typing import ArrayLike

from proofmass.analytic.numerics import Array, Complex


def _mirrored(first: list[float]) -> tuple[float, ...]:
    """The whole of a palindrome of sum 1 with an odd count, from what is left of its middle."""
    return (*first, 1.0 - 2.0 * sum(first), *first[::-1])


def _halved(first: list[float]) -> tuple[float, ...]:
    """The whole of a palindrome of sum 1 with an even count, from its first half but one."""
    half = [*first, 0.5 - sum(first)]
    return (*half, *half[::-1])


HINGES = _mirrored([0.0378593198406116, 0.102635633102435, -0.0258678882665587, 0.314241403071447,
                    -0.130144459517415, 0.106417700369543, -0.00879424312851058])
MOST = 500  # steps: five times what eight inflections need; a rod that wants more has lost its way
SEGMENTS = _halved([0.09171915262446165, 0.183983170005006, -0.05653436583288827,
                    0.004914688774712854, 0.143761127168358, 0.328567693746804])


def flow(angle: ArrayLike, moment: ArrayLike, force: ArrayLike, length: ArrayLike,
         stiffness: ArrayLike) -> tuple[Complex, Array]:
    r"""Tip of planar inextensible rods, with derivatives with respect to m0, n_x and n_y.

    ::

        theta' = m/EI,   m' = n_x sin(theta) - n_y cos(theta),   x' = cos(theta),   y' = sin(theta)

    Parameters
    ----------
    angle : tangent at the clamp [rad], (...)
    moment : at the clamp, m0 [N m], (...)
    force : on the tip, n_x + i n_y [N], (...)
    length, stiffness : L [m] and EI [N m^2], (...)

    Returns
    -------
    z : ndarray (4, ...)
        Tip from the clamp, x + iy [m], and its derivatives by m0, n_x, n_y.
    theta : ndarray (4, ...)
        Tangent at the tip [rad], and its derivatives.

    Notes
    -----
    Error about 1e-11 of the length: 4 + 5/2 L sqrt(|n|/EI + (m0/EI)^2/4) steps, the most of the
    batch.  Derivatives are those of the steps themselves, the variational equations solved by the
    same chain.  Equations: J. Pérez Gámiz, TFG, UPV/EHU Bilbao 2018, eqs 30, 78; it takes forty
    steps of RK4, error 1e-6 m, and forward differences.  Steps: S. Blanes and P. C. Moan, Practical
    symplectic partitioned Runge-Kutta and Runge-Kutta-Nyström methods, J. Comput. Appl. Math. 142,
    2002, SRKN 14a.

    Examples
    --------
    A rod of length pi/2 bent into a quarter of a circle:

    >>> z, theta = flow(0.0, 1.0, 0.0, np.pi / 2, 1.0)
    >>> complex(z[0].round(9)), float(theta[0].round(9))
    ((1+1j), 1.570796327)
    """
    angle, m0, n, length, stiffness = np.broadcast_arrays(
        np.asarray(angle, float), moment, np.asarray(force, complex), length, stiffness)
    fixed = np.zeros((4, *angle.shape))
    fixed[0], fixed[1] = m0, 1.0
    arm = np.zeros((4, *angle.shape), complex)
    arm[2], arm[3] = 1.0, -1.0j
    theta, z = np.zeros_like(fixed), np.zeros_like(arm)
    theta[0] = angle
    count = steps(m0, n, length, stiffness)
    turns = [share * length / (count * stiffness) for share in HINGES]
    moves = [share * length / count for share in SEGMENTS]
    moves.append(np.zeros_like(moves[0]))  # a step ends with its last hinge
    lever = n.conj()
    for _ in range(count):
        for turn, move in zip(turns, moves, strict=True):
            theta += turn * ((lever * z + arm * z[0]).imag + fixed)
            along = np.exp(1j * theta[0]) * move
            change = 1j * along * theta
            change[0] = along
            z += change
    return z, theta


def steps(moment: Array, force: Complex, length: Array, stiffness: Array) -> int:
    """Steps that the most bent rod of a batch needs, at most 500."""
    rate = np.sqrt(np.abs(force) / stiffness + (moment / stiffness) ** 2 / 4.0)
    return int(min(np.ceil(4.0 + 2.5 * np.nanmax(length * rate, initial=0.0)), MOST))
