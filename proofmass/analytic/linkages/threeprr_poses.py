"""Rigid 3PRR planar parallel robot: all poses of the platform for given sliders."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from proofmass.analytic.linkages.threeprr_inverse import (
    CORNERS,
    GUIDES,
    check,
    cross,
    determinant,
    origins,
    three,
)
from proofmass.analytic.numerics import Array, Complex

PAIRS = np.array([(0, 1), (0, 2), (1, 2)])
NEAR = 1e-7  # a double root is known to sqrt(1e-16) = 1e-8: what is closer is one
MISSING = complex(np.nan, np.nan)
ORDERS = np.arange(-3, 4)[:, None]
SAMPLES = np.exp(2j * np.pi * np.arange(7) / 7)[:, None]
# column k: (1 + it)^(3 + k) (1 - it)^(3 - k) = (1 + t^2)^3 e^(i k psi), highest power first
HALF_ANGLE = np.transpose([np.poly([1j] * (3 + k) + [-1j] * (3 - k)) * (-1) ** (k % 2)
                           for k in ORDERS.ravel()])


def poses(
    sliders: ArrayLike, *,
    side: float, leg: float, guide2_x: float, guide3_x: float, guide3_y: float,
) -> dict[str, NDArray]:
    r"""All poses of the platform, none to six, for given sliders.

    ::

                 P          Move the ends of leg k back by the arm of its corner: q_k = C_k - b_k.
              .` | `.       All legs then meet in P, so P is the centre of a circle of radius `leg`
          q1 ----+---- q2   through q1, q2, q3.
              `. | .`
                 q3

    A triangle with the squared sides S12, S13, S23 and twice the area A has that circumradius if ::

        p(psi) = S12 S13 S23 - 4 leg^2 A^2 = 0

    S and A are linear in cos(psi) and sin(psi), so p has the harmonics -3 to 3. With
    t = tan((psi - psi0)/2) it is a sextic; psi0 is chosen so that its leading coefficient does not
    vanish. Roots are polished by Newton on the three leg lengths.

    Where q1 = q2 (any two) the legs are parallel, psi is a double root and two circles of radius
    `leg` pass through the points: two poses of equal psi, which the source's linear equations
    leave as 0/0.

    Parameters
    ----------
    sliders : s1, s2, s3 [m], (3, ...)
    side, leg, guide2_x, guide3_x, guide3_y : see `threeprr_inverse.solve` [m]

    Returns
    -------
    dict of (6, ...) arrays: x, y [m] of P, psi [rad] ascending in [-pi, pi], singularity (see
    `threeprr.solve`), with NaN after the last pose; and parallel (bool), two legs are parallel.

    Raises
    ------
    ValueError
        A value out of its domain, or sliders that leave the platform free to move: where they form
        the platform's own triangle, it moves in a circle without turning.

    Notes
    -----
    Legs are met within 1e-14 of the mechanism. Poses closer than 1e-7 are one; psi is known to 1e-8
    where two poses merge, to 1e-5 where three do. Poses are found for lengths that differ by up to
    a factor of 100. Source: J. Pérez Gámiz, TFG, UPV/EHU Bilbao 2018, eqs 48-49 and 146-148, annex
    I. Departure: its polynomial of degree 8 in tan(psi/2) is (1 + t^2) times the sextic, so there
    are not 8 poses but at most 6; it loses psi = pi, and four of the eight triples of its Table 3
    have parallel legs.

    Examples
    --------
    >>> where = dict(side=1.0, leg=1.0, guide2_x=3.0, guide3_x=2.5, guide3_y=2.8)
    >>> poses([2.0, 0.5, 0.2], **where)["psi"].round(6)
    array([-0.250967,  0.125104,       nan,       nan,       nan,       nan])
    """
    check(side, leg, guide2_x, guide3_x, guide3_y)
    shape, (s,) = three(sliders)
    if not np.isfinite(s).all():
        raise ValueError("sliders must be finite [m]")
    c = origins(guide2_x, guide3_x, guide3_y) + s * GUIDES
    a, b = c[1] - c[0], c[2] - c[0]
    _refuse(np.maximum(np.abs(np.abs(a) - side), np.abs(b - CORNERS[2] * a)) < NEAR * side, s)
    starts = _starts(c, _angles(c, side, leg, s), side, leg)
    point, psi = _merged(_polished(starts, c, side, leg), leg + side)
    e, arm = legs(c[:, None], point, psi, side)
    apart = np.abs(np.diff(e[PAIRS], axis=1)[:, 0])
    curves = {"x": point.real, "y": point.imag, "psi": psi,
              "singularity": determinant(e, cross(arm, e)) / (leg**3 * side),
              "parallel": np.any(apart < NEAR * (leg + side), axis=0)}
    return {name: curve.reshape(6, *shape) for name, curve in curves.items()}


def legs(c: Complex, point: Complex, psi: Array, side: float) -> tuple[Complex, Complex]:
    """Legs and arms, (3, ...), for sliders at c (3, ...) and poses (...)."""
    arm = side * CORNERS.reshape(3, *(1,) * psi.ndim) * np.exp(1j * psi)
    return point + arm - c, arm


def inverse_jacobian(e: Complex, arm: Complex) -> tuple[Complex, Array]:
    """Velocity of P and rate of psi, (3, ...) each, per unit of e . (v + w J b) of each leg."""
    moment, (e1, e2) = cross(arm, e), (np.roll(e, -k, axis=0) for k in (1, 2))
    m1, m2 = (np.roll(moment, -k, axis=0) for k in (1, 2))
    total = determinant(e, moment)
    return 1j * (m1 * e2 - m2 * e1) / total, cross(e1, e2) / total


def lacking(sliders: ArrayLike, *, side: float, leg: float, guide2_x: float, guide3_x: float,
            guide3_y: float) -> float:
    """By how much [m] the legs are too short (too long: negative) at a triple without a pose."""
    c = origins(guide2_x, guide3_x, guide3_y) + np.reshape(sliders, (3, 1)) * GUIDES
    s, area = _triangle(c, side, np.exp(1j * np.linspace(-np.pi, np.pi, 3600)))
    with np.errstate(divide="ignore", invalid="ignore"):  # in line: no circle
        short = np.sqrt(s.prod(axis=0)) / (2.0 * np.abs(area)) - leg
    return float(short[np.nanargmin(np.abs(short))])


def _triangle(c: Complex, side: float, z: Complex) -> tuple[Array, Array]:
    """Squared sides (3, ...) and twice the area (...) of q1, q2, q3 at z = e^(i psi)."""
    q = c - side * CORNERS.reshape(3, *(1,) * (c.ndim - 1)) * z
    a, b = q[1] - q[0], q[2] - q[0]
    return np.abs(np.array([a, b, b - a])) ** 2, cross(a, b)


def _angles(c: Complex, side: float, leg: float, sliders: Array) -> Array:
    """Real roots psi of the sextic, (6, n), NaN for the others."""
    s, area = _triangle(c[:, None], side, SAMPLES)
    product, square = s.prod(axis=0), 4.0 * leg**2 * area**2
    p = product - square
    _refuse(np.abs(p).max(axis=0) < NEAR * (product + square).max(axis=0), sliders)
    zero = -SAMPLES[np.argmax(np.abs(p), axis=0), 0]  # half a turn from the largest: t is finite
    harmonics = np.fft.fftshift(np.fft.fft(p, axis=0), axes=0)
    sextic = (HALF_ANGLE @ (harmonics * zero**ORDERS)).real
    companion = np.zeros((sextic.shape[1], 6, 6))
    companion[:, range(1, 6), range(5)] = 1.0
    companion[:, 0] = -(sextic[1:] / sextic[0]).T
    t = np.linalg.eigvals(companion).T
    real = np.abs(t.imag) < 1e-3 * (1.0 + np.abs(t) ** 2)  # triple roots split by 1e-5
    return np.where(real, np.angle(zero) + 2.0 * np.arctan(t.real), np.nan)


def _starts(c: Complex, psi: Array, side: float, leg: float) -> Complex:
    """P and psi, (2, 12, n): both circles through the two of q1, q2, q3 farthest apart."""
    q = c[:, None] - side * CORNERS[..., None] * np.exp(1j * psi)
    one, other = q[PAIRS.T]
    far = np.argmax(np.abs(other - one), axis=0)[None]
    one, other = (np.take_along_axis(x, far, 0)[0] for x in (one, other))
    half = 0.5 * (other - one)
    rise = 1j * half * np.sqrt(np.maximum((leg / np.abs(half)) ** 2 - 1.0, 0.0))
    point = one + half + np.stack([rise, -rise])
    return np.array([point, np.broadcast_to(psi, point.shape)]).reshape(2, 12, -1)


def _polished(starts: Complex, c: Complex, side: float, leg: float) -> Complex:
    """Best of some Newton steps on the leg lengths, best poses first; MISSING is a wrong one."""
    real = np.isfinite(starts[1].real)
    c, trial = c[:, np.nonzero(real)[1]], starts[:, real]
    best, gap = trial, np.full(c.shape[1], np.inf)
    for _ in range(5):
        e, arm = legs(c, trial[0], trial[1].real, side)
        wrong = np.abs(np.abs(e) - leg).max(axis=0)
        best, gap = np.where(wrong < gap, trial, best), np.fmin(wrong, gap)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):  # singular: not best
            steps = np.array(inverse_jacobian(e, arm)) * 0.5 * (leg**2 - np.abs(e) ** 2)
            trial = trial + steps.sum(axis=1)
    good = gap <= 1e-14 * (leg + side + np.abs(c).max(axis=0))  # rounding of a leg's length
    found, gaps = np.full_like(starts, MISSING), np.full(real.shape, np.inf)
    found[:, real], gaps[real] = np.where(good, best, MISSING), gap
    return np.take_along_axis(found, np.argsort(gaps, axis=0)[None], 1)


def _merged(found: Complex, size: float) -> tuple[Complex, Array]:
    """Each P and psi once, (6, n), by ascending psi in [-pi, pi]."""
    z = np.exp(1j * found[1].real)
    for k in range(1, len(z)):
        apart = np.abs(found[0, :k] - found[0, k]) + size * np.abs(z[:k] - z[k])
        found[:, k, np.any(apart < NEAR * size, axis=0)] = MISSING
    psi = (found[1].real + np.pi) % (2.0 * np.pi) - np.pi
    order = np.argsort(psi, axis=0)[:6]
    return np.take_along_axis(found[0], order, 0), np.take_along_axis(psi, order, 0)


def _refuse(free: NDArray[np.bool_], sliders: Array) -> None:
    """ValueError where the platform can move although the sliders stand still."""
    if free.any():
        where = ", ".join(f"{x:.9g}" for x in sliders[:, np.argmax(free)])
        raise ValueError(f"the platform is free to move at sliders ({where}) m")
