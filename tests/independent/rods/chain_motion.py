"""Motion of a chain of rigid links with torsion springs, in absolute angles, by DOP853.

The rod consists of n - 1 links of length h and half a link at each end; the first half link may be
clamped.  Springs EI/h are between the links.  With c_j the centres of the links,
T = 1/2 sum m_j |c_j'|^2 + 1/2 sum m_j l_j^2/12 w_j^2.  Lagrange's equations of absolute angles::

    sum_l B_kl (cos(t_k - t_l) t_l'' + sin(t_k - t_l) t_l'^2) + I_k t_k'' = Q_k

with B = A^T m A; A_jk is the length that link k contributes to the position of centre j.
"""

from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_ivp


class ChainMotion(NamedTuple):
    """Motion of a chain released at rest: positions x + iy (n,) of the tip, and energies (n,)."""

    tip: np.ndarray
    kinetic: np.ndarray
    strain: np.ndarray
    weight: np.ndarray


def released_chain(
    t: np.ndarray, n: int, *, stiffness: float, mass: float, gravity: float, theta0: float = 0.0
) -> ChainMotion:
    """Motion of a straight rod of length 1, released with its clamp at `theta0`, as n + 1 links."""
    h = 1.0 / n
    lengths = np.array([h / 2, *[h] * (n - 1), h / 2])
    masses = mass * lengths
    add = np.tril(np.tile(lengths, (n + 1, 1)), -1) + np.diag(lengths / 2)
    both = add.T @ (masses[:, None] * add)
    own = masses * lengths**2 / 12
    pull = masses @ add  # moments of the weight, over g cos(t_k)
    spring = stiffness / h * (2.0 * np.eye(n + 1) - np.eye(n + 1, k=1) - np.eye(n + 1, k=-1))
    spring[[0, -1], [0, -1]] /= 2.0

    def slopes(_, state):
        angle, rate = np.full(n + 1, theta0), np.zeros(n + 1)
        angle[1:], rate[1:] = np.split(state, 2)
        apart = angle[:, None] - angle
        force = -spring @ angle - gravity * pull * np.cos(angle)
        force -= (both * np.sin(apart)) @ rate**2
        inertia = both * np.cos(apart) + np.diag(own)
        return np.append(rate[1:], np.linalg.solve(inertia[1:, 1:], force[1:]))

    begin = np.append(np.full(n, theta0), np.zeros(n))
    found = solve_ivp(slopes, (0.0, t[-1]), begin, "DOP853", t, rtol=1e-8, atol=1e-9)
    angle = np.vstack([np.full(t.size, theta0), found.y[:n]])
    rate = np.vstack([np.zeros(t.size), found.y[n:]])
    moved = add @ (1j * np.exp(1j * angle) * rate)
    return ChainMotion(
        lengths @ np.exp(1j * angle),
        0.5 * (masses @ np.abs(moved) ** 2 + own @ rate**2),
        0.5 * np.einsum("it,ij,jt->t", angle, spring, angle),
        gravity * pull @ np.sin(angle),
    )


def driven_chain(
    t: np.ndarray,
    n: int,
    *,
    crank: float,
    rate: float,
    stiffness: float,
    coupler_mass: float,
    slider_mass: float,
) -> np.ndarray:
    """Middle and tip (2, times) x + iy of a coupler of length 1, as n + 1 links; n is even.

    In axes that move with the end of the crank, the acceleration of this end acts as a weight that
    rotates.  A Lagrange multiplier keeps the tip on the guide.  Coupler and crank begin along +x.
    """
    h = 1.0 / n
    lengths = np.array([h / 2, *[h] * (n - 1), h / 2])
    masses = coupler_mass * lengths
    add = np.tril(np.tile(lengths, (n + 1, 1)), -1) + np.diag(lengths / 2)
    both = add.T @ (masses[:, None] * add) + slider_mass * np.outer(lengths, lengths)
    own = np.diag(masses * lengths**2 / 12)
    pull = masses @ add + slider_mass * lengths
    spring = stiffness / h * (2.0 * np.eye(n + 1) - np.eye(n + 1, k=1) - np.eye(n + 1, k=-1))
    spring[[0, -1], [0, -1]] /= 2.0

    def slopes(time, state):
        angle, turning = np.split(state, 2)
        onward = -(rate**2) * crank * np.exp(1j * rate * time)
        apart = angle[:, None] - angle
        along = np.exp(1j * angle)
        force = -spring @ angle - pull * (np.conj(1j * along) * onward).real
        force -= (both * np.sin(apart)) @ turning**2
        rise = lengths * along.real
        needed = lengths @ (along.imag * turning**2) - onward.imag
        inertia = both * np.cos(apart) + own
        matrix = np.block([[inertia, -rise[:, None]], [rise[None], np.zeros((1, 1))]])
        return np.append(turning, np.linalg.solve(matrix, np.append(force, needed))[:-1])

    begin = np.append(np.zeros(n + 1), np.full(n + 1, -rate * crank))
    found = solve_ivp(slopes, (0.0, t[-1]), begin, "DOP853", t, rtol=1e-9, atol=1e-10)
    links = lengths[:, None] * np.exp(1j * found.y[: n + 1])
    end = crank * np.exp(1j * rate * t)
    middle = links[: n // 2].sum(axis=0) + 0.5 * links[n // 2]
    return end + np.stack([middle, links.sum(axis=0)])
