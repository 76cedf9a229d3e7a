"""Torsion springs, linear or quadratic, wound up to a preload."""

import numpy as np

from proofmass.analytic.numerics import Array


def preloaded(stiffness: Array, quadratic: Array, preload: Array) -> tuple[Array, Array, Array]:
    r"""A spring ``M = k x + A x^2`` wound up until it carries its preload.

    From there on, with the winding e counted from the preloaded state, x = e + e*::

        M = M0 + k' e + A e^2,    e* = 2 M0/(k + k'),    k' = sqrt(k^2 + 4 A M0)

    e* is the root that is reached first from the slack spring.

    Parameters
    ----------
    stiffness, quadratic : ndarray (...)
        k [N m/rad] and A [N m/rad^2] of the slack spring.
    preload : ndarray (...)
        M0 [N m].

    Returns
    -------
    stiffness, winding, energy : ndarray (...)
        k' [N m/rad], e* [rad] and k e*^2/2 + A e*^3/3 [J].  k' is NaN where the spring never
        carries M0.  With no stiffness at all the moment is constant: e* is infinite, and its
        energy, which then has no slack state to count from, is given as 0.

    Notes
    -----
    Source: van Nes 2022, eq. 12-17 with alpha* for e*.

    Examples
    --------
    >>> k, winding, energy = preloaded(np.array(2.0), np.array(-0.5), np.array(1.5))
    >>> float(k), float(winding), round(float(energy), 6)
    (1.0, 1.0, 0.833333)
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        stiff = np.where(preload == 0, stiffness, np.sqrt(stiffness**2 + 4 * quadratic * preload))
        winding = np.where(preload == 0, 0.0, 2 * preload / (stiffness + stiff))
        energy = winding**2 * (stiffness / 2 + quadratic * winding / 3)
    return stiff, winding, np.where(np.isfinite(winding), energy, 0.0)
