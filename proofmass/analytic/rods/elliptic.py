"""The pinned-tip elastica in closed form: load, tip, moment and shape from (psi, k_rel, mode)."""

import numpy as np
from numpy.typing import ArrayLike

from proofmass.analytic.numerics import TURN, Array, positive
from proofmass.analytic.rods.integrals import jacobi, legendre

BLOCK = 16384  # poses at once: their arrays stay in the processor's cache


def tip(
    psi: ArrayLike, k_rel: ArrayLike, mode: ArrayLike = 1, *,
    length: float = 1.0, stiffness: float = 1.0,
) -> dict[str, Array]:
    r"""Load, tip and moment of an inextensible rod that is clamped, with a moment-free tip.

    ::

              n = R (cos psi, sin psi)      clamp at the origin, tangent along +x
                 \                          load n on the tip, psi from the clamp's tangent
                  \ ,--o                    mode = number of inflections, the tip included
        |     _,-'   (x, y)                 k > 0: bent to the left at the clamp, m0 > 0
        |=---'
        |  m0

    The rod is a piece of an inflectional elastica of modulus k that ends in an inflection::

        cos((psi - theta)/2) = k sin phi,    theta' = 2 k sqrt(R/EI) cos phi,    EI theta' = m
        sqrt(R/EI) L = F(phi2) - F(phi1),    sin phi1 = cos(psi/2)/k,    phi2 = (mode - 1/2) pi
        (x, y) = -X (cos psi, sin psi) + Y (-sin psi, cos psi),    a = sqrt(R/EI)
        X = (2 [E(phi2) - E(phi1)] - [F(phi2) - F(phi1)])/a,    Y = -2 k cos(phi1)/a

    Since |k| >= k_min = |cos(psi/2)|, k is given by its place in what is left of (-1, 1)::

        k_rel = sign(k) (|k| - k_min)/(1 - k_min)

    Parameters
    ----------
    psi : direction of the load [rad], in (0, 2 pi)  (...)
    k_rel : relative modulus, in (-1, 0) or (0, 1)  (...)
    mode : 1, 2, ...  (...); all broadcast together
    length, stiffness : L [m], EI [N m^2]

    Returns
    -------
    dict of (...) arrays: R [N]; x, y [m] of the tip and theta, its angle [rad]; m0 [N m];
    energy [J] of bending, (1/2) int m^2/EI ds; k.

    Raises
    ------
    ValueError
        An argument out of its domain.

    Notes
    -----
    Relative accuracy about 1e-14 (energy: 1e-15 of R L), also near k_rel = 0, a rod without load or
    of whole half waves, and near +-1, where R has no bound: F(phi2) - F(phi1) is one integral from
    the clamp's first inflection.  k_rel = 0 is a seam: there m0 = 0, and the rod goes on in
    -k_rel with a mode more or less.  Source: J. Pérez Gámiz, Resolución del problema de posición de
    mecanismos ultraflexibles planos de cadena cerrada, TFG, UPV/EHU Bilbao 2018 (below: Pérez Gámiz
    2018), eq. 33-47 and 86-91.  Its line 451 swaps the valid and the invalid moduli, and its energy
    (annex II) lacks the factor 1/2.

    Examples
    --------
    >>> rod = tip(np.pi / 2, 0.5)
    >>> [round(float(rod[name]), 6) for name in ("R", "x", "y", "theta", "m0", "energy")]
    [1.034068, 0.940263, 0.310127, 0.47474, 0.972296, 0.151987]
    """
    positive(length=length)
    stiff(stiffness)
    given = [np.asarray(v, float) for v in (psi, k_rel, mode)]
    p, r, q = np.broadcast_arrays(*domain(*given))
    flat = [np.ravel(v) for v in (p, r, q)]
    found = np.empty((7, p.size))
    for start in range(0, p.size, BLOCK):
        part = slice(start, start + BLOCK)
        found[:, part] = _unit(*(v[part] for v in flat))
    scale = (stiffness / length**2, length, length, 1.0, stiffness / length,
             stiffness / length, 1.0)
    names = ("R", "x", "y", "theta", "m0", "energy", "k")
    return {name: (row * unit).reshape(p.shape)
            for name, row, unit in zip(names, found, scale, strict=True)}


def _unit(psi: Array, k_rel: Array, mode: Array) -> tuple[Array, ...]:
    """R, x, y, theta, m0, energy, k for L = EI = 1."""
    c, s = np.cos(0.5 * psi), np.sin(0.5 * psi)
    least, room = bounds(psi)
    above, other, k = _moduli(least, room, k_rel)
    sine, cosine = c / k, np.sqrt(above * (np.abs(k) + least)) / np.abs(k)
    apex = cosine / s, other * sine / s, other / s
    first, second, whole_first, whole_second = legendre(*apex, other)
    waves = 2.0 * (mode - 1.0)
    reach = first + waves * whole_first
    bend = second - k**2 * sine * apex[0] + waves * whole_second
    along, across = (2.0 * bend - reach) / reach, 2.0 * k * cosine / reach
    end = k * (1.0 - 2.0 * ((mode - 1.0) % 2.0))
    return (reach**2, -along * np.cos(psi) + across * np.sin(psi),
            -along * np.sin(psi) - across * np.cos(psi), psi - 2.0 * np.arctan2(other, end),
            2.0 * k * reach * cosine, 2.0 * reach * (bend - other**2 * reach), k)


def shape(
    psi: ArrayLike, k_rel: ArrayLike, mode: ArrayLike, fraction: ArrayLike, *,
    length: float = 1.0, stiffness: float = 1.0,
) -> dict[str, Array]:
    """The rod of `tip` at fractions of its length from the clamp, in [0, 1].

    Returns x, y [m], theta [rad], unwrapped, and the moment m [N m], all (...) as the arguments
    broadcast together.  By Jacobi's functions, counted from the tip (`from_inflection`).

    >>> whole, part = tip(1.0, -0.3, 2), shape(1.0, -0.3, 2, [0.0, 0.5, 1.0])
    >>> bool(abs(part["x"][2] - whole["x"]) < 1e-14), part["m"][[0, 2]].round(6).tolist()
    (True, [-4.478744, 0.0])
    """
    given = (np.asarray(v, float) for v in (psi, k_rel, mode))
    p, r, q, f = np.broadcast_arrays(*domain(*given), np.asarray(fraction, float))
    if not np.all((f >= 0.0) & (f <= 1.0)):
        raise ValueError("fraction must lie within [0, 1]")
    least, room = bounds(p)
    _, other, k = _moduli(least, room, r)
    load = tip(p, r, q, length=length, stiffness=stiffness)["R"]
    unit = np.sqrt(stiffness / load)
    end = k * (1.0 - 2.0 * ((q - 1.0) % 2.0))
    x, y, theta, m = from_inflection(p, end, other, (1.0 - f) * length / unit)
    tip_x, tip_y, _, _ = from_inflection(p, end, other, length / unit)
    return {"x": unit * (tip_x - x), "y": unit * (tip_y - y), "theta": theta,
            "m": stiffness / unit * m}


def from_inflection(
    psi: Array, k: Array, complement: Array, v: Array
) -> tuple[Array, Array, Array, Array]:
    r"""An elastica followed backwards from an inflection, lengths in sqrt(EI/R), over the arc v.

    ::

        cos((psi - theta)/2) = k cd(v),  sin((psi - theta)/2) = k' nd(v),  m = 2 k k' sd(v)

    psi is the direction of the load on the inflection; k = cos((psi - theta)/2) there, of either
    sign, and k' = sqrt(1 - k^2) > 0.  Returns x, y of the inflection from the point at v, theta,
    and m in units of sqrt(R EI).
    """
    sn, cn, dn, epsilon = jacobi(v, complement)
    m = 2.0 * k * complement * sn / dn
    along = v - 2.0 * epsilon + 2.0 * k * k * sn * cn / dn
    return (along * np.cos(psi) + m * np.sin(psi), along * np.sin(psi) - m * np.cos(psi),
            psi - 2.0 * np.arctan2(complement, k * cn), m)


def modulus(psi: ArrayLike, k_rel: ArrayLike) -> tuple[Array, Array]:
    """k and its complement sqrt(1 - k^2), both to rounding (Pérez Gámiz 2018, eq. 91).

    >>> [round(float(x), 6) for x in modulus(np.pi / 2, -0.5)]
    [-0.853553, 0.521005]
    """
    _, other, k = _moduli(*bounds(psi), np.asarray(k_rel, float))
    return k, other


def relative(psi: ArrayLike, k: ArrayLike) -> Array:
    """k_rel of a modulus, |k| >= |cos(psi/2)| (Pérez Gámiz 2018, eq. 47).

    >>> round(float(relative(np.pi / 2, 0.85)), 6)
    0.487868
    """
    least, room = bounds(psi)
    return np.copysign((np.abs(k) - least) / room, k)


def _moduli(least: Array, room: Array, k_rel: Array) -> tuple[Array, Array, Array]:
    """|k| - k_min, sqrt(1 - k^2) and k."""
    above = room * np.abs(k_rel)
    size = least + above
    return above, np.sqrt(room * (1.0 - np.abs(k_rel)) * (1.0 + size)), np.copysign(size, k_rel)


def bounds(psi: ArrayLike) -> tuple[Array, Array]:
    """k_min = |cos(psi/2)| and 1 - k_min, the latter without cancellation, for 0 < psi < 2 pi."""
    angle = np.asarray(psi, float)
    return (np.abs(np.cos(0.5 * angle)),
            2.0 * np.sin(0.25 * np.minimum(angle, TURN - angle)) ** 2)


def domain(psi: Array, k_rel: Array, mode: Array) -> tuple[Array, Array, Array]:
    """The arguments of `tip`, or a ValueError that names the first one out of its domain."""
    checks = (("psi", psi, (psi > 0.0) & (psi < TURN), "within (0, 2 pi) [rad]"),
              ("k_rel", k_rel, (np.abs(k_rel) < 1.0) & (k_rel != 0.0), "within (-1, 0) or (0, 1)"),
              ("mode", mode, (mode >= 1) & (mode == np.rint(mode)), "a whole number from 1"))
    for name, value, good, what in checks:
        if not good.all():
            raise ValueError(f"{name} must be {what}, got {value[~good].flat[0]}")
    return psi, k_rel, mode


def stiff(stiffness: float) -> None:
    """ValueError for a bending stiffness that is not positive and finite."""
    if not 0.0 < stiffness < np.inf:
        raise ValueError(f"stiffness must be a positive finite EI [N m^2], got {stiffness}")
