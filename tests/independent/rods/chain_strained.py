"""A clamped chain whose links stretch and shear in their middles, from the balance of its links.

N_k is the force, as a complex number, on the part of the chain beyond the middle of link k, and
A + i S is the same force in the frame of the link.  h_k and a_k are the length and the angle of the
link, M_k and c_k the moment and the stiffness of the spring at its beginning::

    M_k - M_(k+1) = Im(conj(h_k e_k exp(i a_k)) N_k),      M_k = c_k (a_k - a_(k-1))
    e_k = 1 + A/EA + i S/GA
"""

import numpy as np
from scipy.optimize import root

from proofmass.base.arrays import Array


def free(
    lengths: Array,
    springs: Array,
    force: complex,
    moment: float,
    axial: float,
    shear: float,
    line: complex = 0.0,
    follower: complex = 0.0,
) -> tuple[Array, Array]:
    """Angles of the links [rad], and positions of their ends as complex numbers [m].

    An infinite spring keeps its link along +x.  The force `follower` turns with the last link.
    """
    dead = force + line * (np.sum(lengths) - np.cumsum(lengths) + 0.5 * lengths)
    free = np.isfinite(springs)

    def arms(angles: Array, load: Array) -> Array:
        local = load * np.exp(-1j * angles)
        return lengths * (1.0 + local.real / axial + 1j * local.imag / shear) * np.exp(1j * angles)

    def balance(turns: Array, share: float) -> Array:
        angles = np.zeros(lengths.size)
        angles[free] = turns
        moments = np.zeros(lengths.size + 1)
        moments[:-1][free] = springs[free] * np.diff(angles, prepend=0.0)[free]
        moments[-1] = share * moment
        load = share * (dead + follower * np.exp(1j * angles[-1]))
        bends = np.imag(np.conj(arms(angles, load)) * load)
        return (moments[:-1] - moments[1:] - bends)[free]

    turns = np.zeros(int(free.sum()))
    for share in np.arange(1, 6) / 5.0:
        turns = root(balance, turns, args=(share,), tol=1e-14).x
    if np.abs(balance(turns, 1.0)).max() > 1e-11:
        raise ValueError("the links do not balance")
    angles = np.zeros(lengths.size)
    angles[free] = turns
    return angles, np.cumsum(arms(angles, dead + follower * np.exp(1j * angles[-1])))
