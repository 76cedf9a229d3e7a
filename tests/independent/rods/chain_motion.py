"""A chain of rigid links with torsion springs in motion, in absolute angles, by DOP853.

The rod is n links of h between halves of h at both ends, of which the first is clamped.  With c_j
the centres of the links, T = 1/2 sum m_j |c_j'|^2 + 1/2 sum m_j l_j^2/12 w_j^2, and the springs
EI/h are between the links.  Lagrange's equations of absolute angles::

    sum_l B_kl (cos(t_k - t_l) t_l'' + sin(t_k - t_l) t_l'^2) + I_k t_k'' = Q_k

with B = A^T m A, A_jk what link k adds to the place of centre j.
"""

from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_ivp


class ChainMotion(NamedTuple):
    """Tip of a chain, let go at rest: times (n,), places x + iy (n,) and the energy (n,)."""

    tip: np.ndarray
    energy: np.ndarray


def released_chain(
    t: np.ndarray, n: int, *, stiffness: float, mass: float, gravity: float, theta0: float = 0.0
) -> ChainMotion:
    """A straight rod of length 1, clamped at `theta0` from +x, let go, as n + 1 links."""
    h = 1.0 / n
    lengths = np.array([h / 2, *[h] * (n - 1), h / 2])
    masses = mass * lengths
    add = np.tril(np.tile(lengths, (n + 1, 1)), -1) + np.diag(lengths / 2)
    both = add.T @ (masses[:, None] * add)
    own = masses * lengths**2 / 12
    pull = masses @ add  # of weight on each angle, by its cosine
    spring = stiffness / h * (2.0 * np.eye(n + 1) - np.eye(n + 1, k=1) - np.eye(n + 1, k=-1))
    spring[-1, -1] /= 2.0

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
    energy = (
        0.5 * (masses @ np.abs(moved) ** 2 + own @ rate**2)
        + 0.5 * np.einsum("it,ij,jt->t", angle, spring, angle)
        + gravity * pull @ np.sin(angle)
    )
    return ChainMotion(lengths @ np.exp(1j * angle), energy)
