r"""The elastica with a pinned tip in closed form: load, tip, moment and shape.

Two sets of parameters describe a rod: (psi, k_rel, mode), which follow from its load and clamp
moment or from a sampled shape, and the chart (alpha, q) below.

Elliptic integrals and Jacobi's functions are computed by arithmetic-geometric means.  A modulus k
is given by its complement k' = sqrt(1 - k^2), and an amplitude phi by its sine, cosine and delta =
sqrt(1 - k^2 sin^2), since near k = 1 the digits of k and of phi alone do not suffice.

All rods with a clamp and a pinned tip form one smooth equilibrium manifold, without gaps between
the modes.  Along the arc from its tip, where the curvature is zero, the rod obeys the equation of a
pendulum that is released at rest.  With delta the angle of the tangent over the load, gamma its
value at the tip, and u = alpha (1 - s/L)::

            clamp      u = alpha         delta'' = sin(delta),  delta(0) = gamma, delta'(0) = 0
              \                          alpha = L sqrt(R/EI)
               `--._                     cos(delta/2) = k cd(u),  sin(delta/2) = k' nd(u)
                    `---o--> R           k = cos(gamma/2) = tanh(q),  k' = sech(q)
                  tip, u = 0
                    Z = int_0^alpha e^(i delta) du = alpha - 2 E(alpha) + 2 k^2 sn cd + 2i k k' sd

The chart, alpha > 0 and a real q, determines the rod: load and tip in the clamp's frame are

    n = EI/L^2 alpha^2 e^(-i delta(alpha)),    tip = L/alpha e^(-i delta(alpha)) Z

and the mode is the whole part of alpha/(2 K) plus 1; load and tip are smooth where it changes.  The
Jacobi field of the pendulum, y = d delta/d gamma = cn + sd (E(u) - k'^2 u), gives all derivatives.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ellipkm1

from proofmass.analytic.numerics import TURN, check_positive
from proofmass.base.arrays import Array, Complex

MEAN_TOLERANCE = float(np.sqrt(np.finfo(float).eps))  # (a - b)/a, squared by a step
Four = tuple[Array, Array, Array, Array]


def elliptic_integrals(sine: Array, cosine: Array, delta: Array, complement: Array) -> Four:
    r"""F(phi), E(phi), K and E of an amplitude in [0, pi), all by one arithmetic-geometric mean.

    Gauss's transformation in Bulirsch's form uses no trigonometric function up to its last line::

        tan(phi' - phi) = (b/a) tan(phi),  that is, with y = a cot(phi):  y' = y - a b/y
        F = phi/a at the limit of the pairs (a, b), which begin with (1, k')

    Parameters
    ----------
    sine, cosine, delta : of the amplitude [1] (...); sine >= 0
    complement : k' [1] (...), 0 < k' <= 1

    Returns
    -------
    first, second, complete_first, complete_second : ndarray (...) [1]

    Raises
    ------
    ValueError
        A complement of zero, where K is infinite, or not a number.

    Notes
    -----
    The error is a few roundings of F, for every k' down to 1e-150.  Source: R. Bulirsch, Numerical
    calculation of elliptic integrals and elliptic functions, Numer. Math. 7 (1965) 78-90,
    procedure el2; here for both kinds at once, and beyond pi/2.

    Examples
    --------
    >>> half = np.sqrt(np.array(0.5))
    >>> [round(float(x), 12) for x in elliptic_integrals(half, half, np.sqrt(np.array(0.75)), half)]
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
            if not gap > MEAN_TOLERANCE:
                break
            b = 2.0 * np.sqrt(product)
            turns = 2.0 * turns + (y < 0.0)
        turned = (np.arctan2(a, y) + np.pi * turns) / a
    quarter = 0.5 * np.pi * whole / a
    second = turned * next_mean + wave * (1.0 - square)
    return turned, second, quarter, quarter * next_mean


def incomplete_integrals(phi: ArrayLike, k: ArrayLike) -> tuple[Array, Array]:
    """F(phi, k) and E(phi, k) for any real amplitude [rad] and |k| < 1, broadcast together.

    F(phi + n pi) = F(phi) + 2 n K, and E likewise.  ValueError for a modulus of 1 or more.

    >>> [round(float(x), 12) for x in incomplete_integrals(4.0, 0.5)]
    [4.254327497524, 3.770057482948]
    """
    angle, modulus = np.broadcast_arrays(np.asarray(phi, float), np.asarray(k, float))
    if not np.all(np.abs(modulus) < 1.0):
        raise ValueError(f"k must lie within (-1, 1), got {modulus[~(np.abs(modulus) < 1.0)][0]}")
    half_turns = np.floor(angle / np.pi)
    sine, cosine = np.abs(np.sin(angle)), np.cos(angle) * (1.0 - 2.0 * (half_turns % 2.0))
    complement = np.sqrt((1.0 - modulus) * (1.0 + modulus))
    delta = np.hypot(cosine, complement * sine)
    first, second, whole_first, whole_second = elliptic_integrals(sine, cosine, delta, complement)
    return first + 2.0 * half_turns * whole_first, second + 2.0 * half_turns * whole_second


def jacobi_functions(u: ArrayLike, complement: ArrayLike) -> Four:
    """Jacobi's sn, cn, dn and the integral epsilon of dn^2 from 0 to u, E(am u), of complement k'.

    sn and cn are accurate next to their zeros, and cn and dn have a small relative error where k'
    is tiny.  Source: Bulirsch 1965, procedure sncndn; epsilon by `elliptic_integrals`.

    >>> [round(float(x), 12) for x in jacobi_functions(1.0, np.sqrt(0.75))]
    [0.82263557813, 0.568568998095, 0.911492005669, 0.933987498346]
    """
    argument, other = np.broadcast_arrays(np.asarray(u, float), np.asarray(complement, float))
    ends = np.ones_like(other)
    _, _, quarter, whole = elliptic_integrals(ends, 0.0 * ends, other, other)
    halves = np.rint(0.5 * argument / quarter)
    rest = argument - 2.0 * halves * quarter
    sn, cn, dn = _jacobi_in_quarter(np.abs(rest), other)
    second = np.copysign(elliptic_integrals(sn, cn, dn, other)[1], rest) + 2.0 * halves * whole
    flip = 1.0 - 2.0 * (halves % 2.0)
    return flip * np.copysign(sn, rest), flip * cn, dn, second


def _jacobi_in_quarter(u: Array, complement: Array) -> tuple[Array, Array, Array]:
    """Jacobi's sn, cn and dn for 0 <= u <= K."""
    a, b, pairs = np.ones_like(complement), complement, []
    while True:
        pairs.append((a, b))
        gap, a, b = np.max((a - b) / a, initial=0.0), 0.5 * (a + b), np.sqrt(a * b)
        if not gap > MEAN_TOLERANCE:
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


RODS_PER_BLOCK = 16384  # computed at once, since their arrays fit the processor's cache


def tip(
    psi: ArrayLike,
    k_rel: ArrayLike,
    mode: ArrayLike = 1,
    *,
    length: float = 1.0,
    stiffness: float = 1.0,
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

    Since |k| >= k_min = |cos(psi/2)|, k is given relative to the interval from k_min to 1::

        k_rel = sign(k) (|k| - k_min)/(1 - k_min)

    Parameters
    ----------
    psi : direction of the load [rad], in (0, 2 pi)  (...)
    k_rel : relative modulus [1], in (-1, 0) or (0, 1)  (...)
    mode : 1, 2, ...  [1] (...); all broadcast together
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
    The relative error is about 1e-14 (energy: 1e-15 of R L), also near k_rel = 0, where the rod has
    no load or consists of whole half waves, and near +-1, where R has no bound: F(phi2) - F(phi1)
    is computed as one integral from the clamp's first inflection.  At k_rel = 0, m0 = 0, and the
    rod continues in -k_rel with one mode more or less.  Source: J. Pérez Gámiz, Resolución del
    problema de posición de mecanismos ultraflexibles planos de cadena cerrada, TFG, UPV/EHU Bilbao
    2018 (below: Pérez Gámiz 2018), eq. 33-47 and 86-91.  Its line 451 swaps the valid and the
    invalid moduli, and its energy (annex II) lacks the factor 1/2.

    Examples
    --------
    >>> rod = tip(np.pi / 2, 0.5)
    >>> [round(float(rod[name]), 6) for name in ("R", "x", "y", "theta", "m0", "energy")]
    [1.034068, 0.940263, 0.310127, 0.47474, 0.972296, 0.151987]
    """
    check_positive(length=length)
    check_stiffness(stiffness)
    given = [np.asarray(v, float) for v in (psi, k_rel, mode)]
    p, r, q = np.broadcast_arrays(*check_domain(*given))
    flat = [np.ravel(v) for v in (p, r, q)]
    found = np.empty((7, p.size))
    for start in range(0, p.size, RODS_PER_BLOCK):
        part = slice(start, start + RODS_PER_BLOCK)
        found[:, part] = _unit_rods(*(v[part] for v in flat))
    scale = (
        stiffness / length**2,
        length,
        length,
        1.0,
        stiffness / length,
        stiffness / length,
        1.0,
    )
    names = ("R", "x", "y", "theta", "m0", "energy", "k")
    return {
        name: (row * unit).reshape(p.shape)
        for name, row, unit in zip(names, found, scale, strict=True)
    }


def _unit_rods(psi: Array, k_rel: Array, mode: Array) -> tuple[Array, ...]:
    """R, x, y, theta, m0, energy and k of rods (n,) with L = EI = 1."""
    c, s = np.cos(0.5 * psi), np.sin(0.5 * psi)
    least, room = bounds_in_range(psi)
    above, complement, k = _moduli(least, room, k_rel)
    sine, cosine = c / k, np.sqrt(above * (np.abs(k) + least)) / np.abs(k)
    apex = cosine / s, complement * sine / s, complement / s
    first, second, whole_first, whole_second = elliptic_integrals(*apex, complement)
    waves = 2.0 * (mode - 1.0)
    reach = first + waves * whole_first
    bend = second - k**2 * sine * apex[0] + waves * whole_second
    along, across = (2.0 * bend - reach) / reach, 2.0 * k * cosine / reach
    end = k * (1.0 - 2.0 * ((mode - 1.0) % 2.0))
    return (
        reach**2,
        -along * np.cos(psi) + across * np.sin(psi),
        -along * np.sin(psi) - across * np.cos(psi),
        psi - 2.0 * np.arctan2(complement, end),
        2.0 * k * reach * cosine,
        2.0 * reach * (bend - complement**2 * reach),
        k,
    )


def shape(
    psi: ArrayLike,
    k_rel: ArrayLike,
    mode: ArrayLike,
    fraction: ArrayLike,
    *,
    length: float = 1.0,
    stiffness: float = 1.0,
) -> dict[str, Array]:
    """The rod of `tip` at fractions of its length from the clamp, in [0, 1].

    Returns x, y [m], theta [rad], unwrapped, and the moment m [N m], all (...) as the arguments
    broadcast together.  They are computed by Jacobi's functions of the arc from the tip
    (`from_inflection`).

    >>> whole, part = tip(1.0, -0.3, 2), shape(1.0, -0.3, 2, [0.0, 0.5, 1.0])
    >>> bool(abs(part["x"][2] - whole["x"]) < 1e-14), part["m"][[0, 2]].round(6).tolist()
    (True, [-4.478744, 0.0])
    """
    given = (np.asarray(v, float) for v in (psi, k_rel, mode))
    p, r, q, f = np.broadcast_arrays(*check_domain(*given), np.asarray(fraction, float))
    if not np.all((f >= 0.0) & (f <= 1.0)):
        raise ValueError("fraction must lie within [0, 1]")
    least, room = bounds_in_range(p)
    _, complement, k = _moduli(least, room, r)
    load = tip(p, r, q, length=length, stiffness=stiffness)["R"]
    unit = np.sqrt(stiffness / load)
    end = k * (1.0 - 2.0 * ((q - 1.0) % 2.0))
    x, y, theta, m = from_inflection(p, end, complement, (1.0 - f) * length / unit)
    tip_x, tip_y, _, _ = from_inflection(p, end, complement, length / unit)
    return {
        "x": unit * (tip_x - x),
        "y": unit * (tip_y - y),
        "theta": theta,
        "m": stiffness / unit * m,
    }


def from_inflection(
    psi: Array, k: Array, complement: Array, v: Array
) -> tuple[Array, Array, Array, Array]:
    r"""An elastica at the arc v before an inflection, lengths in units of sqrt(EI/R).

    ::

        cos((psi - theta)/2) = k cd(v),  sin((psi - theta)/2) = k' nd(v),  m = 2 k k' sd(v)

    psi is the direction of the load on the inflection; k = cos((psi - theta)/2) at the inflection
    may have either sign, and k' = sqrt(1 - k^2) > 0.  Returns x, y of the inflection from the point
    at v, theta, and m in units of sqrt(R EI).
    """
    sn, cn, dn, epsilon = jacobi_functions(v, complement)
    m = 2.0 * k * complement * sn / dn
    along = v - 2.0 * epsilon + 2.0 * k * k * sn * cn / dn
    return (
        along * np.cos(psi) + m * np.sin(psi),
        along * np.sin(psi) - m * np.cos(psi),
        psi - 2.0 * np.arctan2(complement, k * cn),
        m,
    )


def modulus(psi: ArrayLike, k_rel: ArrayLike) -> tuple[Array, Array]:
    """The modulus k and its complement sqrt(1 - k^2), to rounding (Pérez Gámiz 2018, eq. 91).

    ValueError for psi outside (0, 2 pi) or k_rel outside [-1, 1].

    >>> [round(float(x), 6) for x in modulus(np.pi / 2, -0.5)]
    [-0.853553, 0.521005]
    """
    given = np.asarray(k_rel, float)
    if not np.all(np.abs(given) <= 1.0):
        raise ValueError(f"k_rel must lie within [-1, 1], got {given[~(np.abs(given) <= 1.0)][0]}")
    _, other, k = _moduli(*bounds(psi), given)
    return k, other


def relative(psi: ArrayLike, k: ArrayLike) -> Array:
    """The relative modulus k_rel of k, |k| >= |cos(psi/2)| (Pérez Gámiz 2018, eq. 47).

    ValueError for psi outside (0, 2 pi), or for |k| further than 1e-14 outside [|cos(psi/2)|, 1].

    >>> round(float(relative(np.pi / 2, 0.85)), 6)
    0.487868
    """
    least, room = bounds(psi)
    above = np.abs(k) - least
    rounding = 1e-14  # of k and of cos(psi/2), which lose a few eps each where they are computed
    is_valid = (above >= -rounding) & (np.abs(k) <= 1.0 + rounding)
    if not np.all(is_valid):
        first, bound = (
            np.broadcast_to(value, is_valid.shape)[~is_valid][0] for value in (k, least)
        )
        raise ValueError(f"|k| must lie within [|cos(psi/2)|, 1] = [{bound}, 1], got k = {first}")
    return relative_in_range(least, room, k)


def relative_in_range(least: Array, room: Array, k: ArrayLike) -> Array:
    """The relative modulus of k, from k_min and 1 - k_min as `bounds` returns them, unchecked."""
    return np.copysign((np.abs(k) - least) / room, k)


def _check_direction(psi: ArrayLike) -> None:
    """ValueError for a direction of the load [rad] outside (0, 2 pi)."""
    angle = np.asarray(psi, float)
    is_valid = (angle > 0.0) & (angle < TURN)
    if not np.all(is_valid):
        raise ValueError(f"psi must be within (0, 2 pi) [rad], got {angle[~is_valid][0]}")


def _moduli(least: Array, room: Array, k_rel: Array) -> tuple[Array, Array, Array]:
    """|k| - k_min, sqrt(1 - k^2) and k of relative moduli."""
    above = room * np.abs(k_rel)
    size = least + above
    return above, np.sqrt(room * (1.0 - np.abs(k_rel)) * (1.0 + size)), np.copysign(size, k_rel)


def bounds(psi: ArrayLike) -> tuple[Array, Array]:
    """k_min = |cos(psi/2)|, and 1 - k_min computed without cancellation.

    ValueError for psi outside (0, 2 pi).

    >>> [round(float(x), 6) for x in bounds(np.pi / 2)]
    [0.707107, 0.292893]
    """
    _check_direction(psi)
    return bounds_in_range(np.asarray(psi, float))


def bounds_in_range(angle: Array) -> tuple[Array, Array]:
    """The `bounds` of directions [rad] in [0, 2 pi], unchecked."""
    return (np.abs(np.cos(0.5 * angle)), 2.0 * np.sin(0.25 * np.minimum(angle, TURN - angle)) ** 2)


def check_domain(psi: Array, k_rel: Array, mode: Array) -> tuple[Array, Array, Array]:
    """The arguments of `tip`, or a ValueError that names the first one out of its domain."""
    _check_direction(psi)
    checks = (
        ("k_rel", k_rel, (np.abs(k_rel) < 1.0) & (k_rel != 0.0), "within (-1, 0) or (0, 1)"),
        ("mode", mode, (mode >= 1) & (mode == np.rint(mode)), "a whole number from 1"),
    )
    for name, value, good, what in checks:
        if not good.all():
            raise ValueError(f"{name} must be {what}, got {value[~good].flat[0]}")
    return psi, k_rel, mode


def check_stiffness(stiffness: float) -> None:
    """ValueError for a bending stiffness that is not positive and finite."""
    check_positive("N m^2", stiffness=stiffness)


def check_section_stiffnesses(axial: float, shear: float) -> None:
    """ValueError for an EA or a GA that is not positive; an infinite one excludes that strain."""
    for name, value in (("axial", axial), ("shear", shear)):
        if np.ndim(value) or not value > 0.0:
            raise ValueError(f"{name} must be a positive stiffness of a section [N], got {value}")


def arc_lengths(s: ArrayLike, length: float) -> Array:
    """Arc lengths (...) [m] as an array; ValueError for one that is not on a rod of this length.

    >>> arc_lengths([0.0, 1.5], 1.0)
    Traceback (most recent call last):
    ValueError: s must lie within [0, 1.0] [m], got 1.5
    """
    arc = np.asarray(s, float)
    is_valid = (arc >= 0.0) & (arc <= length)
    if not np.all(is_valid):
        raise ValueError(f"s must lie within [0, {length}] [m], got {arc[~is_valid].flat[0]}")
    return arc


INFLECTION_TOLERANCE = 1e-6  # from a moment-free tip to an inflection, over a half wave


def of_load(
    n_x: ArrayLike,
    n_y: ArrayLike,
    m0: ArrayLike,
    *,
    theta0: ArrayLike = 0.0,
    length: float = 1.0,
    stiffness: float = 1.0,
    apart: float = INFLECTION_TOLERANCE,
) -> tuple[Array, Array, Array]:
    r"""psi, k_rel and mode of a rod with moment-free tip: the inverse of `tip`.

    With R and psi the load's size and direction from the clamp's tangent::

        k^2 = cos^2(psi/2) + m0^2/(4 R EI),    sign(k) = sign(m0)
        mode = 1 + (L sqrt(R/EI) - u)/(2 K),   u from the clamp to the first inflection

    Parameters
    ----------
    n_x, n_y : force on the tip [N] (...)
    m0 : moment at the clamp [N m] (...), not zero
    theta0 : angle of the clamp's tangent [rad]
    length, stiffness : L [m], EI [N m^2]
    apart : largest distance of the tip from an inflection, over a half wave [1]

    Returns
    -------
    psi [rad], k_rel [1], mode [1] : ndarray (...)

    Raises
    ------
    ValueError
        A rod without inflections (k >= 1), or one whose tip is not at an inflection.

    Notes
    -----
    Digits of k_rel are lost like m0^2/(4 R EI) over 1 - k_min.  This inverse of eq. 35, 36 and 88
    of Pérez Gámiz 2018 is not in the source.

    Examples
    --------
    >>> psi, k_rel, mode = of_load(-3.2308774, -1.1634081, -0.6076388, stiffness=0.16493361431)
    >>> round(float(psi), 6), round(float(k_rel), 6), float(mode)
    (3.487228, -0.322258, 2.0)
    """
    check_positive(length=length)
    check_stiffness(stiffness)
    fx, fy, m, turn = np.broadcast_arrays(*(np.asarray(v, float) for v in (n_x, n_y, m0, theta0)))
    size, psi = np.hypot(fx, fy), (np.arctan2(fy, fx) - turn) % TURN
    least, room = bounds_in_range(psi)
    excess = m * m / (4.0 * size * stiffness)
    k = np.sqrt(least**2 + excess)
    with np.errstate(divide="ignore", invalid="ignore"):  # psi = 0: no inflection
        k_rel = np.copysign(excess / (k + least) / room, m)
    if not np.all((np.abs(k_rel) < 1.0) & (m != 0.0)):
        raise ValueError("the rod has no inflection, or no moment at its clamp")
    complement = np.sqrt(room * (1.0 - np.abs(k_rel)) * (1.0 + k))
    s = np.sin(0.5 * psi)
    sine, cosine = np.copysign(1.0, m) * np.cos(0.5 * psi) / k, np.sqrt(excess) / k
    first, _, quarter, _ = elliptic_integrals(
        cosine / s, complement * sine / s, complement / s, complement
    )
    mode = 1.0 + (length * np.sqrt(size / stiffness) - first) / (2.0 * quarter)
    whole = np.maximum(np.rint(mode), 1.0)
    distance = np.abs(mode - whole)
    if not np.all(distance <= apart):
        raise ValueError(
            f"the tip carries a moment: it is {np.max(distance):.3g} of a half wave away "
            f"from an inflection"
        )
    return psi, k_rel, whole


def of_shape(
    s: ArrayLike,
    x: ArrayLike,
    y: ArrayLike,
    theta: ArrayLike,
    *,
    stiffness: float = 1.0,
) -> tuple[Array, Array, Array]:
    """psi, k_rel and mode of a rod sampled from clamp to tip, arc lengths s (n,), to O(spacing^2).

    The load n is fitted to m = (tip - p) x n, where m = EI theta' by differences.  The result is a
    first guess for Newton's method and is usable if the samples resolve the half waves.

    >>> from proofmass.analytic.rods.elastica import shape
    >>> rod = shape(2.0, 0.4, 2, np.linspace(0.0, 1.0, 201))
    >>> [round(float(v), 2) for v in of_shape(np.linspace(0, 1, 201), rod["x"], rod["y"],
    ...                                       rod["theta"])]
    [2.0, 0.4, 2.0]
    """
    arc, px, py, angle = (np.asarray(v, float) for v in (s, x, y, theta))
    m = stiffness * np.gradient(angle, arc, edge_order=2)
    arms = np.stack([py - py[-1], px[-1] - px], axis=1)
    n = np.linalg.lstsq(arms, m, rcond=None)[0]
    return of_load(
        n[0],
        n[1],
        arms[0] @ n,
        theta0=angle[0],
        length=float(arc[-1] - arc[0]),
        stiffness=stiffness,
        apart=0.25,
    )


@dataclass(frozen=True)
class ElasticaRods:
    """Rods of unit length and stiffness in the frame of their clamps, arrays of one shape.

    Attributes
    ----------
    tip, force : ndarray of complex
        x + iy of the tip [L], and of the load on it [EI/L^2].
    tip_slope, force_slope : ndarray of complex (2, ...)
        Their derivatives with respect to alpha and to q.
    moment, energy : ndarray
        Moment at the clamp [EI/L]; energy of bending [EI/L].
    delta : ndarray of complex
        e^(i delta), where delta is the angle of the tangent at the clamp over the load.
    waves : ndarray
        alpha/(2 K): number of half waves between the clamp and the tip [1].
    field : ndarray
        Jacobi field y at the clamp [L].
    """

    tip: Complex
    force: Complex
    tip_slope: Complex
    force_slope: Complex
    moment: Array
    energy: Array
    delta: Complex
    waves: Array
    field: Array


def rods_of_chart(alpha: Array, q: Array) -> ElasticaRods:
    """Rods of unit length and stiffness at points (alpha, q) of the chart, with derivatives."""
    k, complement = np.tanh(q), 1.0 / np.cosh(q)
    sn, cn, dn, second = jacobi_functions(alpha, complement)
    delta: Complex = (k * cn / dn + 1j * complement / dn) ** 2
    drift = second - complement**2 * alpha
    field = cn + sn / dn * drift
    rise = 2.0 * k * complement * sn / dn
    turn = -2.0 * complement * field  # d delta/dq
    z = alpha - 2.0 * second + 2.0 * k**2 * sn * cn / dn + 1j * rise
    z_slope = (
        2.0 * alpha * k * complement**2
        - 0.5 * rise * turn
        - 2j * complement * (cn / dn**2 * drift - complement**2 * sn / dn)
    )
    back = delta.conj()
    tip, force = back * z / alpha, alpha**2 * back
    spin = np.stack([rise, turn])
    return ElasticaRods(
        tip,
        force,
        np.stack([(1.0 - tip) / alpha, back * z_slope / alpha]) - 1j * spin * tip,
        np.stack([2.0 * force / alpha, 0.0 * force]) - 1j * spin * force,
        -alpha * rise,
        alpha**2 * (k**2 - complement**2) - (tip * force.conj()).real,
        delta,
        0.5 * alpha / ellipkm1(complement**2),
        field,
    )
