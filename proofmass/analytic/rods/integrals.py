"""Legendre's elliptic integrals and Jacobi's functions of arrays, by arithmetic-geometric means.

A modulus k is given by its complement k' = sqrt(1 - k^2), and an amplitude phi by its sine, cosine
and delta = sqrt(1 - k^2 sin^2): near k = 1 the digits of k and of phi alone do not suffice.
"""

import numpy as np
from numpy.typing import ArrayLike

from proofmass.analytic.numerics import Array

GAP = float(np.sqrt(np.finfo(float).eps))  # of a mean that its next step closes: it is quadratic
Four = tuple[Array, Array, Array, Array]


def legendre(sine: Array, cosine: Array, delta: Array, complement: Array) -> Four:
    r"""F(phi), E(phi), K and E of an amplitude in [0, pi), all from one mean.

    Gauss's transformation in Bulirsch's form, free of trigonometry up to its last line::

        tan(phi' - phi) = (b/a) tan(phi),  that is, with y = a cot(phi):  y' = y - a b/y
        F = phi/a at the limit of the pairs (a, b), which begin with (1, k')

    Parameters
    ----------
    sine, cosine, delta : of the amplitude (...); sine >= 0
    complement : k' (...), 0 < k' <= 1

    Returns
    -------
    first, second, complete_first, complete_second : ndarray (...)

    Raises
    ------
    ValueError
        A complement of zero, where K is infinite, or not a number.

    Notes
    -----
    Within a few roundings of F, for every k' down to 1e-150.  Source: R. Bulirsch, Numerical
    calculation of elliptic integrals and elliptic functions, Numer. Math. 7 (1965) 78-90,
    procedure el2; here for both kinds at once, and beyond pi/2.

    Examples
    --------
    >>> half = np.sqrt(np.array(0.5))
    >>> [round(float(x), 12) for x in legendre(half, half, np.sqrt(np.array(0.75)), half)]
    [0.826017876249, 0.748186504178, 1.854074677301, 1.350643881048]
    """
    if not np.min(complement, initial=1.0) > 0.0:
        raise ValueError(f"complement must be positive, got {np.min(complement)}")
    a, b, p, square = np.ones_like(complement), complement, delta, complement * complement
    with np.errstate(divide="ignore", over="ignore"):  # y is infinite at multiples of pi/2
        y = cosine / sine + 0.0  # no -0
        turns, whole = (y < 0.0).astype(float), 1.0
        slope, last, wave = sine * cosine, np.zeros_like(p), 0.5 * sine * cosine / delta
        rest, mean, next_mean = square, np.ones_like(p), 0.5 * (1.0 + square)
        while True:
            rest = mean * b + rest
            product = a * b
            ratio = product / p
            slope, last, p = last * ratio + slope, wave, p + ratio
            wave = 0.5 * (slope / p + wave)
            gap, a, whole = np.max((a - b) / a, initial=0.0), a + b, 2.0 * whole
            mean, next_mean = next_mean, 0.5 * (rest / a + next_mean)
            y = y - product / y
            if not gap > GAP:
                break
            b = 2.0 * np.sqrt(product)
            turns = 2.0 * turns + (y < 0.0)
        turned = (np.arctan2(a, y) + np.pi * turns) / a
    quarter = 0.5 * np.pi * whole / a
    second = turned * next_mean + wave * (1.0 - square)
    return turned, second, quarter, quarter * next_mean


def incomplete(phi: ArrayLike, k: ArrayLike) -> tuple[Array, Array]:
    """F(phi, k) and E(phi, k) for any real amplitude [rad] and |k| < 1, broadcast together.

    F(phi + n pi) = F(phi) + 2 n K, and E alike.  ValueError for a modulus of 1 or more.

    >>> [round(float(x), 12) for x in incomplete(4.0, 0.5)]
    [4.254327497524, 3.770057482948]
    """
    angle, modulus = np.broadcast_arrays(np.asarray(phi, float), np.asarray(k, float))
    if not np.all(np.abs(modulus) < 1.0):
        raise ValueError(f"k must lie within (-1, 1), got {modulus[~(np.abs(modulus) < 1.0)][0]}")
    half_turns = np.floor(angle / np.pi)
    sine, cosine = np.abs(np.sin(angle)), np.cos(angle) * (1.0 - 2.0 * (half_turns % 2.0))
    complement = np.sqrt((1.0 - modulus) * (1.0 + modulus))
    delta = np.hypot(cosine, complement * sine)
    first, second, whole_first, whole_second = legendre(sine, cosine, delta, complement)
    return first + 2.0 * half_turns * whole_first, second + 2.0 * half_turns * whole_second


def jacobi(u: ArrayLike, complement: ArrayLike) -> Four:
    """Jacobi's sn, cn, dn and the integral epsilon of dn^2 from 0 to u, E(am u), of complement k'.

    sn and cn keep their digits next to their zeros, and cn and dn their relative ones where k' is
    tiny.  Source: Bulirsch 1965, procedure sncndn; epsilon by `legendre`.

    >>> [round(float(x), 12) for x in jacobi(1.0, np.sqrt(0.75))]
    [0.82263557813, 0.568568998095, 0.911492005669, 0.933987498346]
    """
    argument, other = np.broadcast_arrays(np.asarray(u, float), np.asarray(complement, float))
    ends = np.ones_like(other)
    _, _, quarter, whole = legendre(ends, 0.0 * ends, other, other)
    halves = np.rint(0.5 * argument / quarter)
    rest = argument - 2.0 * halves * quarter
    sn, cn, dn = _reduced(np.abs(rest), other)
    second = np.copysign(legendre(sn, cn, dn, other)[1], rest) + 2.0 * halves * whole
    flip = 1.0 - 2.0 * (halves % 2.0)
    return flip * np.copysign(sn, rest), flip * cn, dn, second


def _reduced(u: Array, complement: Array) -> tuple[Array, Array, Array]:
    """sn, cn, dn for 0 <= u <= K."""
    a, b, pairs = np.ones_like(complement), complement, []
    while True:
        pairs.append((a, b))
        gap, a, b = np.max((a - b) / a, initial=0.0), 0.5 * (a + b), np.sqrt(a * b)
        if not gap > GAP:
            break
    start = u == 0.0
    phase = np.where(start, 1.0, u * a)
    ratio, dn = np.cos(phase) / np.sin(phase), np.ones_like(u)
    c = ratio * a
    for a, b in reversed(pairs):
        ratio, c = c * ratio, dn * c
        dn = (b + ratio) / (a + ratio)
        ratio = c / a
    sn = 1.0 / np.hypot(1.0, c)
    return np.where(start, 0.0, sn), np.where(start, 1.0, c * sn), np.where(start, 1.0, dn)
