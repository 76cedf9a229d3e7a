r"""How large the loads of rods in equilibrium can be.

Along its own load a rod's tip is L (1 - 2 E(alpha)/alpha) from the clamp, E(alpha) <= 2 mode E(k).
Summed over the rods, with any point c of the plane and rho the largest |P - c|::

    sum R_i (L_i - |O_i - c| - |r_i|) - sum 4 mode_i E(k_i) sqrt(R_i EI_i)  <=  |F| rho

so that no R_i is large unless clamps are so far apart that rods can be stretched between them.
`search_boxes.bound` holds more often, and takes seconds for a platform.
"""

from collections.abc import Sequence

import numpy as np
from scipy.special import ellipe, ellipkm1

from proofmass.analytic.numerics import Array
from proofmass.analytic.rods.state import State, clamps

FURTHEST = 200.0  # alpha at which a bound is given up
FINE = 20001


def largest(s: State, modes: Sequence[int]) -> float:
    """alpha = L sqrt(R/EI) that no rod of any equilibrium exceeds; inf where this gives none."""
    a, clamp = s.assembly, clamps(s)[1]
    away = np.abs(clamp - clamp.mean()) + np.abs(a.arm)
    slack = a.length - away
    if np.any(slack <= 0.0):
        return float(np.inf)
    alpha = np.linspace(0.0, FURTHEST, FINE)
    held = np.array([hold(alpha, mode) for mode in modes])
    unit = (a.stiffness / a.length)[:, None]
    excess = unit * alpha * (alpha * (slack / a.length)[:, None] - held)
    spare = np.hypot(*s.load[:2]) * (a.length + away).min()
    room = spare - excess.min(axis=1).sum() + excess.min(axis=1)
    last = max(alpha[np.flatnonzero(row <= most)[-1]]
               for row, most in zip(excess, room, strict=True))
    return float(last + FURTHEST / FINE) if last < FURTHEST else float(np.inf)


def hold(alpha: Array, mode: int) -> Array:
    """4 mode E(k) of the least bent rod of a mode: that with K = alpha/(2 mode), or straight."""
    q = np.linspace(0.0, 20.0, 4001)
    rest = 1.0 / np.cosh(q) ** 2
    return np.asarray(4.0 * mode * np.interp(alpha / (2.0 * mode), ellipkm1(rest),
                                             ellipe(1.0 - rest)))
