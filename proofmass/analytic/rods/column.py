"""Euler's columns: critical loads, the elastica beyond them, buckling under the own weight."""

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq
from scipy.special import jv

from proofmass.analytic.numerics import check_positive
from proofmass.analytic.rods.elastica import check_stiffness, elliptic_integrals
from proofmass.base.arrays import Array

# Number of quarter waves in the column's length; clamped-pinned has z/(pi/2), where tan z = z.
QUARTER_WAVES = {"clamped-free": 1.0, "pinned-pinned": 2.0, "clamped-clamped": 4.0}
ENDS = ("clamped-free", "pinned-pinned", "clamped-pinned", "clamped-clamped")


def critical(ends: str = "clamped-free", *, length: float = 1.0, stiffness: float = 1.0) -> float:
    """Euler's load (z/L)^2 EI [N]: z = pi/2, pi, the root of tan z = z, 2 pi for the `ENDS`.

    All ends except a free one stay on the line of the load.  ValueError for other ends.

    >>> [round(critical(ends), 8) for ends in ENDS]
    [2.4674011, 9.8696044, 20.19072856, 39.4784176]
    """
    check_positive(length=length)
    check_stiffness(stiffness)
    if ends not in ENDS:
        raise ValueError(f"ends must be one of {', '.join(ENDS)}, got {ends!r}")
    if ends == "clamped-pinned":
        z = brentq(lambda z: np.sin(z) - z * np.cos(z), 4.0, 4.7, xtol=1e-15, rtol=1e-15)
    else:
        z = 0.5 * np.pi * QUARTER_WAVES[ends]
    return float((z / length) ** 2 * stiffness)


def elastica(
    load: ArrayLike, ends: str = "clamped-free", *, length: float = 1.0, stiffness: float = 1.0
) -> dict[str, Array]:
    r"""Shape of a buckled column by the load P over the critical one, in its first mode.

    ::

                 ,-'''-.            clamped-free: a quarter wave, span along the load
        P --> o-'   rise '-o <-- P  pinned-pinned: two, clamped-clamped: four quarter waves
              |--- span ---|

        K(k) = (pi/2) sqrt(P/P_cr),    k = sin(a/2),  a the angle at an inflection
        span/L = 2 E/K - 1,    rise/L = 2 k/(n K),  n quarter waves (clamped-clamped: rise of two)

    Parameters
    ----------
    load : P/P_cr [1], at least 1 and less than 1e4 (...)
    ends : "clamped-free", "pinned-pinned" or "clamped-clamped"
    length, stiffness : L [m], EI [N m^2]

    Returns
    -------
    dict of (...) arrays: span [m] between the ends along the load, negative after they have passed
    each other; rise [m] across the load, of the free tip or of the middle; angle [rad] at the
    inflections; k; energy [J].

    Raises
    ------
    ValueError
        A load below the critical one, where the column is straight, or of 1e4 times that or more;
        clamped-pinned ends, whose load has a component across the line
        (`proofmass.analytic.rods.tip` with mode 2).

    Notes
    -----
    The solution is exact; next to P_cr, k has as many digits as P/P_cr - 1.  The ends of a
    pinned column meet at 2 E = K (`ends_meet`).  For clamped-free ends it is the rod of
    `proofmass.analytic.rods.tip` with psi = pi.
    Source: A. E. H. Love, Mathematical Theory of Elasticity, 4th ed., sec. 263.

    Examples
    --------
    >>> half = elastica(1.1517196)
    >>> [round(float(half[name]), 5) for name in ("k", "span", "rise")]
    [0.5, 0.74102, 0.59321]
    """
    if ends not in QUARTER_WAVES:
        raise ValueError(f"ends must be one of {', '.join(QUARTER_WAVES)}, got {ends!r}")
    ratio = np.asarray(load, float)
    if not np.all((ratio >= 1.0) & (ratio < 1e4)):
        raise ValueError("load must be at least 1 and less than 1e4 critical loads")
    scale = critical(ends, length=length, stiffness=stiffness)
    k, complement = _modulus_of_quarter(0.5 * np.pi * np.sqrt(ratio))
    quarter, second = complete_integrals(complement)
    count = QUARTER_WAVES[ends]
    arcs = 2.0 if ends == "clamped-clamped" else 1.0
    span = 2.0 * second / quarter - 1.0
    return {
        "span": length * span,
        "rise": length * arcs * 2.0 * k / (count * quarter),
        "angle": 2.0 * np.arctan2(k, complement),
        "k": k,
        "energy": ratio * scale * length * (span + 2.0 * k * k - 1.0),
    }


def ends_meet() -> tuple[float, float]:
    """Modulus and P/P_cr at which the ends of a pinned column meet: 2 E(k) = K(k).

    >>> [round(value, 10) for value in ends_meet()]
    [0.9089085575, 2.1833790462]
    """

    def end_distance(other: float) -> float:
        quarter, second = complete_integrals(np.array(other))
        return float(2.0 * second - quarter)

    complement = brentq(end_distance, 0.1, 0.9, xtol=1e-15, rtol=1e-15)
    quarter, _ = complete_integrals(np.array(complement))
    return float(np.sqrt((1.0 - complement) * (1.0 + complement))), float(
        (2.0 * quarter / np.pi) ** 2
    )


def self_buckling(*, length: float = 1.0, stiffness: float = 1.0) -> float:
    """Weight per length [N/m] under which an upright clamped-free column buckles.

    w L^3/EI = (9/4) j^2, j the first zero of the Bessel function J_(-1/3).  Source: A. G.
    Greenhill, Proc. Cambridge Philos. Soc. 4 (1881) 65-73.

    >>> round(self_buckling(), 9)
    7.837347439
    """
    check_positive(length=length)
    check_stiffness(stiffness)
    zero = brentq(lambda x: jv(-1.0 / 3.0, x), 1.5, 2.2, xtol=1e-15, rtol=1e-15)
    return float(2.25 * zero**2 * stiffness / length**3)


def complete_integrals(complement: Array) -> tuple[Array, Array]:
    """The complete elliptic integrals K and E of a complement k'."""
    ends = np.ones_like(complement)
    return elliptic_integrals(ends, 0.0 * ends, complement, complement)[2:]


def _modulus_of_quarter(quarter: Array) -> tuple[Array, Array]:
    """Modulus and complement with K(k) = quarter, by bisection over artanh k."""
    low, high = np.zeros_like(quarter), quarter + 0.0
    for _ in range(64):
        middle = 0.5 * (low + high)
        above = complete_integrals(1.0 / np.cosh(middle))[0] > quarter
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    return np.tanh(low), 1.0 / np.cosh(low)
