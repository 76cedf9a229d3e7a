"""Rigid 3PRR planar parallel robot, inverse: sliders from platform poses; workspace."""

from itertools import product

import numpy as np
from numpy.typing import ArrayLike, NDArray

from proofmass.analytic.numerics import Array, Complex, finite, one_of, positive

SIGNS = tuple(product((1, -1), repeat=3))
MODES = tuple(range(1, len(SIGNS) + 1))
GUIDES = np.array([[1.0], [-1.0], [-1.0j]])  # directions, x + iy as everywhere below
CORNERS = np.array([[0.0], [1.0], [np.exp(1j * np.pi / 3)]])  # of the platform at psi = 0, by side


def solve(
    pose: ArrayLike, rate: ArrayLike = 0.0, acceleration: ArrayLike = 0.0, *,
    side: float, leg: float, guide2_x: float, guide3_x: float, guide3_y: float, mode: int = 1,
) -> dict[str, Array]:
    r"""Motion of the three sliders that gives the platform a wanted motion.

    ::

                             | guide 3, downwards from (guide3_x, guide3_y)
                        P3  [C3]
                        / \  |      P-P2-P3 platform: equilateral, psi = angle of P-P2
                 side  /   \_|      C1-P, C2-P2, C3-P3 legs, all of one length
                      P-----P2      C1 = (s1, 0)
                     /       \      C2 = (guide2_x - s2, 0)
            -->    /          \     C3 = (guide3_x, guide3_y - s3)
        O--------[C1]--------[C2]--- guides 1 and 2 face each other on y = 0

    Corner p = P + b of the platform, guide from o along the unit vector g: with e = p - o - s g
    of length `leg`, d = p - o and the sign of the mode::

        s = d . g - sign sqrt(leg^2 - (d x g)^2)
        s' = e . p'/(e . g)        s'' = (e . p'' + |p' - s' g|^2)/(e . g)

    Parameters
    ----------
    pose, rate, acceleration : x [m], y [m] of P and psi [rad], (3, ...); and their first and second
        time derivatives, which broadcast with the axes of `pose` from the left
    side, leg : of the platform; of each leg [m]
    guide2_x, guide3_x, guide3_y : where guides 2 and 3 start [m], of either sign
    mode : 1 to 8, the row of `SIGNS` = (+++, ++-, +-+, ...); + where the platform's corner is ahead
        of its slider (e . g > 0)

    Returns
    -------
    dict of (...) arrays, for k = 1, 2, 3: slider_k [m], with _rate and _acceleration; lean_k, the
    cosine of leg and guide, zero where the inverse problem is singular; singularity, as in
    `threeprr.solve`, zero where the direct problem is.

    Raises
    ------
    ValueError
        A length not positive (guide: not finite), a mode unknown, or a pose out of reach: the
        message gives the first such pose, the leg, and by how much it is too short.

    Notes
    -----
    Leg lengths are met within rounding. Rates are not finite where a leg is perpendicular to its
    guide, which is the border of the workspace. Source: J. Pérez Gámiz, TFG, UPV/EHU Bilbao 2018,
    eqs 53, 57, 61 (sliders), 62-64 (existence). Misprint: eq. 51, the circle about the first
    slider, is (x - x_P)^2 + (y - y_P)^2 = L^2. Rates are ours.

    Examples
    --------
    >>> where = dict(side=1.0, leg=1.0, guide2_x=3.0, guide3_x=1.5, guide3_y=2.0)
    >>> sliders = solve([0.6, 0.4, 0.0], **where, mode=8)
    >>> [round(float(sliders[f"slider_{k}"]), 5) for k in (1, 2, 3)]
    [1.51652, 2.31652, 1.65049]
    """
    check(side, leg, guide2_x, guide3_x, guide3_y, mode, MODES)
    shape, (point, velocity, push), (psi, w, dw) = _motion(pose, rate, acceleration)
    arm = side * CORNERS * np.exp(1j * psi)
    d = (point + arm - origins(guide2_x, guide3_x, guide3_y)) / GUIDES  # along + i across
    signs, along = np.array(SIGNS[int(mode) - 1])[:, None], _along(d, leg, pose)
    e = (signs * along + 1j * d.imag) * GUIDES
    lean = dot(e, GUIDES)
    v = velocity + 1j * w * arm
    a = push + (1j * dw - w**2) * arm
    with np.errstate(divide="ignore", invalid="ignore"):  # leg perpendicular to its guide
        rates = dot(e, v) / lean
        accelerations = (dot(e, a) + np.abs(v - rates * GUIDES) ** 2) / lean
    curves = {"singularity": determinant(e, dot(e, 1j * arm)) / (leg**3 * side)}
    for name, rows in {"slider_{}": d.real - signs * along, "slider_{}_rate": rates,
                       "slider_{}_acceleration": accelerations, "lean_{}": lean / leg}.items():
        curves |= {name.format(k + 1): row for k, row in enumerate(rows)}
    return {name: curve.reshape(shape) for name, curve in curves.items()}


def reachable(
    pose: ArrayLike, *,
    side: float, leg: float, guide2_x: float, guide3_x: float, guide3_y: float,
) -> NDArray[np.bool_]:
    """Whether each leg reaches its guide: the workspace on a grid of poses.

    `pose` holds x, y [m] of P and psi [rad], (3, ...); lengths as in `solve`; returns (...). All
    three radicands leg^2 - (d x g)^2 must not be negative (eqs 62-64 of the source of `solve`).
    >>> where = dict(side=1.0, leg=1.0, guide2_x=3.0, guide3_x=1.5, guide3_y=2.0)
    >>> reachable(np.transpose([(0.6, 0.4, 0.0), (0.6, 1.4, 0.0)]), **where)
    array([ True, False])
    """
    check(side, leg, guide2_x, guide3_x, guide3_y)
    shape, (point, *_), (psi, *_) = _motion(pose, 0.0, 0.0)
    corner = point + side * CORNERS * np.exp(1j * psi)
    across = ((corner - origins(guide2_x, guide3_x, guide3_y)) / GUIDES).imag
    return np.all(np.abs(across) <= leg, axis=0).reshape(shape)


def origins(guide2_x: float, guide3_x: float, guide3_y: float) -> Complex:
    """Where the guides start, (3, 1)."""
    return np.array([[0.0], [guide2_x], [guide3_x + 1j * guide3_y]])


def dot(a: Complex, b: Complex | complex) -> Array:
    """Scalar product of plane vectors."""
    return (np.conj(a) * b).real


def cross(a: Complex, b: Complex) -> Array:
    """Vector product of plane vectors."""
    return (np.conj(a) * b).imag


def determinant(e: Complex, moment: Array) -> Array:
    """Determinant of the rows (e_x, e_y, moment), all (3, n)."""
    return np.sum(moment * cross(np.roll(e, -1, 0), np.roll(e, -2, 0)), axis=0)


def check(side: float, leg: float, guide2_x: float, guide3_x: float, guide3_y: float,
          mode: int = 1, modes: tuple[int, ...] = MODES) -> None:
    """ValueError that names the first parameter out of its domain."""
    positive(side=side, leg=leg)
    finite(guide2_x=guide2_x, guide3_x=guide3_x, guide3_y=guide3_y)
    one_of(modes, mode=mode)


def three(value: ArrayLike, *derivatives: ArrayLike) -> tuple[tuple[int, ...], list[Array]]:
    """Shape (...) and the (3, n) arrays of a value (3, ...) and of what broadcasts with it."""
    first = np.asarray(value, float)
    if first.ndim == 0 or first.shape[0] != 3:
        raise ValueError(f"three inputs are needed, (3, ...), got an array {first.shape}")
    rest = [np.asarray(x, float) for x in derivatives]
    rest = [x.reshape(x.shape + (1,) * (first.ndim - x.ndim)) for x in rest]
    arrays = np.broadcast_arrays(first, *rest)
    return arrays[0].shape[1:], [x.reshape(3, -1) for x in arrays]


def _motion(pose: ArrayLike, rate: ArrayLike, acceleration: ArrayLike
            ) -> tuple[tuple[int, ...], list[Complex], list[Array]]:
    """Shape, then P and psi, each with its derivatives."""
    shape, arrays = three(pose, rate, acceleration)
    return shape, [x + 1j * y for x, y, _ in arrays], [psi for *_, psi in arrays]


def _along(d: Complex, leg: float, pose: ArrayLike) -> Array:
    """Length of each leg along its guide, or ValueError where it is too short."""
    gap = np.abs(d.imag) - leg
    slack = 4.0 * np.finfo(float).eps * (leg + np.abs(d).max(initial=0.0))  # rounding of gap
    if not gap.max(initial=0.0) <= slack:
        n, k = np.unravel_index(np.argmin((gap <= slack).T), gap.T.shape)
        x, y, psi = np.asarray(pose, float).reshape(3, -1)[:, n]
        raise ValueError(f"pose ({x:.9g} m, {y:.9g} m, {psi:.9g} rad) is out of reach: leg {k + 1} "
                         f"is too short by {gap[k, n]:.6g} m")
    return np.sqrt(np.maximum((leg + d.imag) * (leg - d.imag), 0.0))
