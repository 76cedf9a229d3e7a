"""Rigid 3PRR planar parallel robot: motion of the platform from its three sliders, and the inverse.

The module also has all poses of the platform for given sliders.
"""

from collections.abc import Collection
from dataclasses import asdict, dataclass
from itertools import product
from math import prod

import numpy as np
from numpy.typing import ArrayLike, NDArray

from proofmass.analytic.inverse import PathMotion
from proofmass.analytic.linkages.bars import drive_moment, is_requested, pin_load
from proofmass.analytic.numerics import (
    broadcast_loads,
    broadcast_motion,
    check_finite,
    check_not_negative,
    check_number,
    check_one_of,
    check_positive,
    components_in_frame,
    cross,
    dot,
    unwrap_angles,
)
from proofmass.base.arrays import Array, Complex

SIGNS = tuple(product((1, -1), repeat=3))
WORKING_MODES = tuple(range(1, len(SIGNS) + 1))
# Unit vectors along the guides as x + iy, as all vectors below
GUIDE_DIRECTIONS = np.array([[1.0], [-1.0], [-1.0j]])
# Vectors from P to the corners of the platform at psi = 0, for a side of 1
UNIT_CORNERS = np.array([[0.0], [1.0], [np.exp(1j * np.pi / 3)]])


@dataclass(frozen=True)
class RobotLengths:
    """Lengths of a 3PRR robot.

    Attributes
    ----------
    side, leg : float
        Side of the platform; length of each leg [m].
    guide2_x, guide3_x, guide3_y : float
        Starting points of guides 2 and 3 [m].
    """

    side: float
    leg: float
    guide2_x: float
    guide3_x: float
    guide3_y: float

    def __post_init__(self) -> None:
        check_positive(side=self.side, leg=self.leg)
        check_number(guide2_x=self.guide2_x, guide3_x=self.guide3_x, guide3_y=self.guide3_y)

    @property
    def size(self) -> float:
        """Size of the robot: sum of all lengths [m]."""
        return self.side + self.leg + abs(self.guide2_x) + abs(self.guide3_x) + abs(self.guide3_y)

    @property
    def guide_origins(self) -> Complex:
        """Starting points x + iy of the guides, (3, 1) [m]."""
        return np.array([[0.0], [self.guide2_x], [self.guide3_x + 1j * self.guide3_y]])


def solve_inverse(
    pose: ArrayLike,
    rate: ArrayLike = 0.0,
    acceleration: ArrayLike = 0.0,
    *,
    side: float,
    leg: float,
    guide2_x: float,
    guide3_x: float,
    guide3_y: float,
    mode: int = 1,
) -> dict[str, Array]:
    r"""Motion of the three sliders for a given motion of the platform (inverse kinematics).

    ::

                             | guide 3, downwards from (guide3_x, guide3_y)
                        P3  [C3]
                        / \  |      P-P2-P3 platform: equilateral, psi = angle of P-P2
                 side  /   \_|      C1-P, C2-P2, C3-P3 legs, all of one length
                      P-----P2      C1 = (s1, 0)
                     /       \      C2 = (guide2_x - s2, 0)
            -->    /          \     C3 = (guide3_x, guide3_y - s3)
        O--------[C1]--------[C2]--- guides 1 and 2 face each other on y = 0

    A leg e connects the slider o + s g, on a guide that starts at o with the unit vector g, to the
    corner p = P + b of the platform. With e = p - o - s g of length `leg`, d = p - o and the sign
    of the mode::

        s = d . g - sign sqrt(leg^2 - (d x g)^2)
        s' = e . p'/(e . g)        s'' = (e . p'' + |p' - s' g|^2)/(e . g)

    Parameters
    ----------
    pose, rate, acceleration : x [m], y [m] of P and psi [rad], (3, ...), and their first and second
        time derivatives, whose axes are aligned with those of `pose` from the left
    side, leg : side of the platform; length of each leg [m]
    guide2_x, guide3_x, guide3_y : starting points of guides 2 and 3 [m], of either sign
    mode : 1 to 8, the row of `SIGNS` = (+++, ++-, +-+, ...); + where the platform's corner is ahead
        of its slider (e . g > 0)

    Returns
    -------
    dict of (...) arrays, for k = 1, 2, 3: slider_k [m], with _rate and _acceleration; lean_k, the
    cosine of the angle between leg and guide, which is zero where the inverse problem is singular;
    singularity, as in `threeprr.solve`, which is zero where the direct problem is singular.

    Raises
    ------
    ValueError
        A length not positive, a value not finite, a mode unknown, or a pose out of reach: the
        message gives the first such pose, the leg, and by how much it is too short.

    Notes
    -----
    Leg lengths are met within rounding. Rates are not finite where a leg is perpendicular to its
    guide, which is the border of the workspace. Source: J. Pérez Gámiz, TFG, UPV/EHU Bilbao 2018,
    eqs 53, 57, 61 (sliders), 62-64 (existence). Misprint: eq. 51, the circle about the first
    slider, is (x - x_P)^2 + (y - y_P)^2 = L^2. The source has no rates.

    Examples
    --------
    >>> where = dict(side=1.0, leg=1.0, guide2_x=3.0, guide3_x=1.5, guide3_y=2.0)
    >>> sliders = solve_inverse([0.6, 0.4, 0.0], **where, mode=8)
    >>> [round(float(sliders[f"slider_{k}"]), 5) for k in (1, 2, 3)]
    [1.51652, 2.31652, 1.65049]
    """
    robot = RobotLengths(side, leg, guide2_x, guide3_x, guide3_y)
    shape, (point, velocity, point_acceleration), (psi, w, dw) = _motion(pose, rate, acceleration)
    arm = side * UNIT_CORNERS * np.exp(1j * psi)
    # real part along the guide, imaginary part across it
    d = (point + arm - robot.guide_origins) / GUIDE_DIRECTIONS
    signs, along = np.array(signs_of_mode(mode))[:, None], _leg_along_guide(d, leg, pose)
    e = (signs * along + 1j * d.imag) * GUIDE_DIRECTIONS
    lean = dot(e, GUIDE_DIRECTIONS)
    v = velocity + 1j * w * arm
    a = point_acceleration + (1j * dw - w**2) * arm
    with np.errstate(divide="ignore", invalid="ignore"):  # leg perpendicular to its guide
        rates = dot(e, v) / lean
        accelerations = (dot(e, a) + np.abs(v - rates * GUIDE_DIRECTIONS) ** 2) / lean
    curves = {"singularity": determinant(e, dot(e, 1j * arm)) / (leg**3 * side)}
    for name, rows in {
        "slider_{}": d.real - signs * along,
        "slider_{}_rate": rates,
        "slider_{}_acceleration": accelerations,
        "lean_{}": lean / leg,
    }.items():
        curves |= {name.format(k + 1): row for k, row in enumerate(rows)}
    return {name: curve.reshape(shape) for name, curve in curves.items()}


def determinant(e: Complex, moment: Array) -> Array:
    """Determinant (n,) of the three rows (e_x, e_y, moment), from arrays (3, n)."""
    return np.sum(moment * cross(np.roll(e, -1, 0), np.roll(e, -2, 0)), axis=0)


def signs_of_mode(mode: int) -> tuple[int, int, int]:
    """Signs of e . g of the three legs in a working mode of 1 to 8, or a ValueError."""
    check_one_of(WORKING_MODES, mode=mode)
    one, two, three = SIGNS[int(mode) - 1]
    return one, two, three


def flatten_motion(**motion: ArrayLike) -> tuple[tuple[int, ...], list[Array]]:
    """Shape (...), and arrays (3, n) of a value (3, ...) and of derivatives broadcast to it."""
    arrays = broadcast_motion(3, **motion)
    shape = arrays[0].shape[1:]
    return shape, [one.reshape(3, prod(shape)) for one in arrays]


def _motion(
    pose: ArrayLike, rate: ArrayLike, acceleration: ArrayLike
) -> tuple[tuple[int, ...], list[Complex], list[Array]]:
    """Shape (...); P with its derivatives; psi with its derivatives."""
    shape, arrays = flatten_motion(pose=pose, rate=rate, acceleration=acceleration)
    return shape, [x + 1j * y for x, y, _ in arrays], [psi for *_, psi in arrays]


def _leg_along_guide(d: Complex, leg: float, pose: ArrayLike) -> Array:
    """Part of each leg along its guide, not negative; a ValueError where a leg is too short."""
    shortage = np.abs(d.imag) - leg
    rounding = 4.0 * np.finfo(float).eps * (leg + np.abs(d).max(initial=0.0))  # rounding error
    if not shortage.max(initial=0.0) <= rounding:
        n, k = np.unravel_index(np.argmin((shortage <= rounding).T), shortage.T.shape)
        x, y, psi = np.asarray(pose, float).reshape(3, -1)[:, n]
        raise ValueError(
            f"pose ({x:.9g} m, {y:.9g} m, {psi:.9g} rad) is out of reach: leg {k + 1} "
            f"is too short by {shortage[k, n]:.6g} m"
        )
    return np.sqrt(np.maximum((leg + d.imag) * (leg - d.imag), 0.0))


LEG_PAIRS = np.array([(0, 1), (0, 2), (1, 2)])
POSE_TOLERANCE = 1e-7  # closer poses count as one: a double root is known to sqrt(1e-16) = 1e-8
MISSING_POSE = complex(np.nan, np.nan)
HARMONIC_ORDERS = np.arange(-3, 4)[:, None]
UNIT_CIRCLE_SAMPLES = np.exp(2j * np.pi * np.arange(7) / 7)[:, None]
# column k: (1 + it)^(3 + k) (1 - it)^(3 - k) = (1 + t^2)^3 e^(i k psi), highest power first
HALF_ANGLE_MATRIX = np.transpose(
    [np.poly([1j] * (3 + k) + [-1j] * (3 - k)) * (-1) ** (k % 2) for k in HARMONIC_ORDERS.ravel()]
)


def poses(
    sliders: ArrayLike,
    *,
    side: float,
    leg: float,
    guide2_x: float,
    guide3_x: float,
    guide3_y: float,
) -> dict[str, NDArray]:
    r"""All poses of the platform, up to six, for given positions of the sliders.

    ::

                 P          Move the ends of leg k back by the arm of its corner: q_k = C_k - b_k.
              .` | `.       All legs then meet in P, so P is the centre of a circle of radius `leg`
          q1 ----+---- q2   through q1, q2, q3.
              `. | .`
                 q3

    Let the triangle have the squared sides S12, S13, S23 and twice the area A. Its circumradius is
    `leg` if ::

        p(psi) = S12 S13 S23 - 4 leg^2 A^2 = 0

    S and A are linear in cos(psi) and sin(psi), so p has the harmonics -3 to 3. With
    t = tan((psi - psi0)/2) it is a sextic; psi0 is chosen so that its leading coefficient does not
    vanish. The roots are improved by Newton's method on the three leg lengths.

    Where two of the points are equal, such as q1 = q2, these legs are parallel, psi is a double
    root, and two circles of radius `leg` pass through the points. There are two poses of equal psi,
    for which the linear equations of the source give 0/0.

    Parameters
    ----------
    sliders : positions s1, s2, s3 [m], (3, ...)
    side, leg, guide2_x, guide3_x, guide3_y : see `solve_inverse` [m]

    Returns
    -------
    dict of (6, ...) arrays: x, y [m] of P, psi [rad] ascending in [-pi, pi], singularity (see
    `threeprr.solve`), with NaN after the last pose; and parallel (bool), whether two legs are
    parallel.

    Raises
    ------
    ValueError
        A value out of its domain, or sliders for which the platform is free to move: if they form a
        triangle equal to the platform, it moves in a circle without turning.

    Notes
    -----
    Leg lengths are met within 1e-14 of the mechanism's size. Poses closer than 1e-7 count as one;
    psi is known to 1e-8 where two poses merge, to 1e-5 where three merge. Poses are found for
    lengths that differ by up to a factor of 100. Source: J. Pérez Gámiz, TFG, UPV/EHU Bilbao 2018,
    eqs 48-49 and 146-148, annex I. Difference: its polynomial of degree 8 in tan(psi/2) is
    (1 + t^2) times the sextic, so that there are not 8 poses but at most 6; it cannot give
    psi = pi, and four of the eight triples of its Table 3 have parallel legs.

    Examples
    --------
    >>> where = dict(side=1.0, leg=1.0, guide2_x=3.0, guide3_x=2.5, guide3_y=2.8)
    >>> poses([2.0, 0.5, 0.2], **where)["psi"].round(6)
    array([-0.250967,  0.125104,       nan,       nan,       nan,       nan])
    """
    robot = RobotLengths(side, leg, guide2_x, guide3_x, guide3_y)
    shape, (s,) = flatten_motion(sliders=sliders)
    c = robot.guide_origins + s * GUIDE_DIRECTIONS
    a, b = c[1] - c[0], c[2] - c[0]
    _check_not_free(
        np.maximum(np.abs(np.abs(a) - side), np.abs(b - UNIT_CORNERS[2] * a))
        < POSE_TOLERANCE * side,
        s,
    )
    starts = _first_guesses(c, _sextic_roots(c, side, leg, s), side, leg)
    point, psi = _merge_poses(_polish_poses(starts, c, side, leg), leg + side)
    e, arm = leg_vectors(c[:, None], point, psi, side)
    leg_differences = np.abs(np.diff(e[LEG_PAIRS], axis=1)[:, 0])
    curves = {
        "x": point.real,
        "y": point.imag,
        "psi": psi,
        "singularity": determinant(e, cross(arm, e)) / (leg**3 * side),
        "parallel": np.any(leg_differences < POSE_TOLERANCE * (leg + side), axis=0),
    }
    return {name: curve.reshape(6, *shape) for name, curve in curves.items()}


def leg_vectors(c: Complex, point: Complex, psi: Array, side: float) -> tuple[Complex, Complex]:
    """Legs e, and arms b from P to corners, (3, ...), for sliders at c (3, ...) and poses (...)."""
    arm = side * UNIT_CORNERS.reshape(3, *(1,) * psi.ndim) * np.exp(1j * psi)
    return point + arm - c, arm


def inverse_jacobian(e: Complex, arm: Complex) -> tuple[Complex, Array]:
    """Velocity v of P and rate w of psi, (3, ...), for e . (v + w J b) = 1 of each leg alone."""
    moment, (e1, e2) = cross(arm, e), (np.roll(e, -k, axis=0) for k in (1, 2))
    m1, m2 = (np.roll(moment, -k, axis=0) for k in (1, 2))
    total = determinant(e, moment)
    return 1j * (m1 * e2 - m2 * e1) / total, cross(e1, e2) / total


def missing_leg_length(sliders: ArrayLike, robot: RobotLengths) -> float:
    """Length [m] by which the legs are too short for given sliders; negative if too long."""
    c = robot.guide_origins + np.reshape(sliders, (3, 1)) * GUIDE_DIRECTIONS
    s, area = _triangle_sides(c, robot.side, np.exp(1j * np.linspace(-np.pi, np.pi, 3600)))
    with np.errstate(divide="ignore", invalid="ignore"):  # points in line: no circle
        short = np.sqrt(s.prod(axis=0)) / (2.0 * np.abs(area)) - robot.leg
    return float(short[np.nanargmin(np.abs(short))])


def _triangle_sides(c: Complex, side: float, z: Complex) -> tuple[Array, Array]:
    """Squared sides (3, ...) and twice the area (...) of triangle q1, q2, q3 at z = e^(i psi)."""
    q = c - side * UNIT_CORNERS.reshape(3, *(1,) * (c.ndim - 1)) * z
    a, b = q[1] - q[0], q[2] - q[0]
    return np.abs(np.array([a, b, b - a])) ** 2, cross(a, b)


def _sextic_roots(c: Complex, side: float, leg: float, sliders: Array) -> Array:
    """Real roots psi of the sextic, (6, n); NaN in place of complex roots."""
    s, area = _triangle_sides(c[:, None], side, UNIT_CIRCLE_SAMPLES)
    product, square = s.prod(axis=0), 4.0 * leg**2 * area**2
    p = product - square
    _check_not_free(
        np.abs(p).max(axis=0) < POSE_TOLERANCE * (product + square).max(axis=0), sliders
    )
    zero = -UNIT_CIRCLE_SAMPLES[
        np.argmax(np.abs(p), axis=0), 0
    ]  # opposite to the largest |p|: t is finite
    harmonics = np.fft.fftshift(np.fft.fft(p, axis=0), axes=0)
    sextic = (HALF_ANGLE_MATRIX @ (harmonics * zero**HARMONIC_ORDERS)).real
    companion = np.zeros((sextic.shape[1], 6, 6))
    companion[:, range(1, 6), range(5)] = 1.0
    companion[:, 0] = -(sextic[1:] / sextic[0]).T
    t = np.linalg.eigvals(companion).T
    real = np.abs(t.imag) < 1e-3 * (1.0 + np.abs(t) ** 2)  # triple roots split by 1e-5
    return np.where(real, np.angle(zero) + 2.0 * np.arctan(t.real), np.nan)


def _first_guesses(c: Complex, psi: Array, side: float, leg: float) -> Complex:
    """First guesses of P and psi, (2, 12, n), for each psi from two circles of radius `leg`.

    The circles pass through those two of q1, q2, q3 that are farthest apart.
    """
    q = c[:, None] - side * UNIT_CORNERS[..., None] * np.exp(1j * psi)
    one, other = q[LEG_PAIRS.T]
    far = np.argmax(np.abs(other - one), axis=0)[None]
    one, other = (np.take_along_axis(x, far, 0)[0] for x in (one, other))
    half = 0.5 * (other - one)
    rise = 1j * half * np.sqrt(np.maximum((leg / np.abs(half)) ** 2 - 1.0, 0.0))
    point = one + half + np.stack([rise, -rise])
    return np.array([point, np.broadcast_to(psi, point.shape)]).reshape(2, 12, -1)


def _polish_poses(starts: Complex, c: Complex, side: float, leg: float) -> Complex:
    """Poses after Newton steps on the leg lengths, best first; wrong ones are `MISSING_POSE`."""
    real = np.isfinite(starts[1].real)
    c, trial = c[:, np.nonzero(real)[1]], starts[:, real]
    best, best_error = trial, np.full(c.shape[1], np.inf)
    for _ in range(5):
        e, arm = leg_vectors(c, trial[0], trial[1].real, side)
        length_error = np.abs(np.abs(e) - leg).max(axis=0)
        best, best_error = (
            np.where(length_error < best_error, trial, best),
            np.fmin(length_error, best_error),
        )
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):  # singular poses
            steps = np.array(inverse_jacobian(e, arm)) * 0.5 * (leg**2 - np.abs(e) ** 2)
            trial = trial + steps.sum(axis=1)
    # within the rounding error of a leg's length
    good = best_error <= 1e-14 * (leg + side + np.abs(c).max(axis=0))
    found, all_errors = np.full_like(starts, MISSING_POSE), np.full(real.shape, np.inf)
    found[:, real], all_errors[real] = np.where(good, best, MISSING_POSE), best_error
    return np.take_along_axis(found, np.argsort(all_errors, axis=0)[None], 1)


def _merge_poses(found: Complex, size: float) -> tuple[Complex, Array]:
    """P and psi of different poses, (6, n), by ascending psi in [-pi, pi]."""
    z = np.exp(1j * found[1].real)
    for k in range(1, len(z)):
        distance = np.abs(found[0, :k] - found[0, k]) + size * np.abs(z[:k] - z[k])
        found[:, k, np.any(distance < POSE_TOLERANCE * size, axis=0)] = MISSING_POSE
    psi = (found[1].real + np.pi) % (2.0 * np.pi) - np.pi
    order = np.argsort(psi, axis=0)[:6]
    return np.take_along_axis(found[0], order, 0), np.take_along_axis(psi, order, 0)


def _check_not_free(is_free: NDArray[np.bool_], sliders: Array) -> None:
    """Raise a ValueError if the platform can move while the sliders are at rest."""
    if is_free.any():
        where = ", ".join(f"{x:.9g}" for x in sliders[:, np.argmax(is_free)])
        raise ValueError(f"the platform is free to move at sliders ({where}) m")


MODES = (1, -1, 2, -2, 3, -3)
PIN_FORCE_ENDINGS = tuple(f"_force_{k}_{part}" for k in (1, 2, 3) for part in "xy")
LOAD_ENDINGS = ("holding_force_1", "holding_force_2", "holding_force_3", *PIN_FORCE_ENDINGS)


def solve(
    sliders: ArrayLike,
    rate: ArrayLike = 1.0,
    acceleration: ArrayLike = 0.0,
    *,
    side: float,
    leg: float,
    guide2_x: float,
    guide3_x: float,
    guide3_y: float,
    mode: int = 1,
    platform_mass: float = 0.0,
    leg_mass: float = 0.0,
    slider_mass: float = 0.0,
    load_x: ArrayLike = 0.0,
    load_y: ArrayLike = 0.0,
    load_moment: ArrayLike = 0.0,
    gravity: float = 9.81,
    inertia: bool = False,
    only: Collection[str] | None = None,
) -> dict[str, Array]:
    r"""Motion of the platform whose three slider motions are given.

    ::

                             | guide 3, downwards from (guide3_x, guide3_y)
                        P3  [C3]
                        / \  |      P-P2-P3 platform: equilateral, psi = angle of P-P2
                 side  /   \_|      C1-P, C2-P2, C3-P3 legs, all of one length
                      P-----P2      C1 = (s1, 0)
                     /       \      C2 = (guide2_x - s2, 0)
            -->    /          \     C3 = (guide3_x, guide3_y - s3)
        O--------[C1]--------[C2]--- guides 1 and 2 face each other on y = 0

    The poses are those of `poses`. With the leg e, the arm b = corner - P, the guide's direction g
    and the slider's rate s', the constant length of each leg gives one row of two linear systems
    with the same matrix::

        e . v + w (b x e)   = s' e . g
        e . v' + w' (b x e) = s'' e . g + w^2 e . b - |e'|^2

    The forces that hold the sliders at rest follow from the transposed matrix (virtual work); with
    inertia they are those that move the sliders. Weight and inertia of a leg need the moment m
    about its slider, so that the leg applies to the corner of the platform a force N with
    e x N = -m. The part t e of N along the leg follows from the three balances of the platform,
    with the same transposed matrix::

        N = t e - m J e/leg^2,  J the turn by +90 degrees

    The forces of the other pins and of the guides follow from the balances of legs and sliders.

    Parameters
    ----------
    sliders, rate, acceleration : s1, s2, s3 [m], (3, ...), and their time derivatives [m/s],
        [m/s^2], whose axes are aligned with those of `sliders` from the left; the last axis is the
        path
    side, leg : side of the platform; length of each leg [m]
    guide2_x, guide3_x, guide3_y : starting points of guides 2 and 3 [m], of either sign
    mode : +k or -k: the k-th pose by ascending psi in [-pi, pi] among the poses with positive or
        negative `singularity`. Both signs are equally frequent, and a pose keeps its sign on every
        path without singular poses. Where there are two poses, a mode is therefore one continuous
        branch. Where there are four or six, it is one branch until another pose of its sign
        appears, vanishes or passes it in psi (parallel legs), or one of them crosses psi = pi.
    platform_mass, leg_mass, slider_mass : masses of the uniform platform, of each uniform leg, of
        each slider [kg]
    load_x, load_y, load_moment : load on the platform at P [N], [N m], constants or (...)
    gravity : along -y [m/s^2]
    inertia : whether forces include those of the accelerations
    only : names of all requested quantities; None requests all. Forces, which take longer than the
        motion, are computed only if one of them is requested

    Returns
    -------
    dict of (...) arrays: x, y [m] of P, psi [rad] and, for k = 1, 2, 3, leg_angle_k [rad], each
    with _rate and _acceleration; holding_force_k [N], along the guide; forces [N] in the frame of a
    leg or guide, _x along it and _y to the left: pin_force_k_x, pin_force_k_y of leg k on the
    platform and leg_force_k_.. of the slider on the leg, in the leg's frame, and guide_force_k_..
    of guide and drive on the slider, whose mass is at its pin, so that the guide applies no moment
    about the pin; singularity, the determinant of the matrix divided by leg^3 side: it is zero
    where the lines of the legs meet in one point or are parallel. Angles start in [-pi, pi] and are
    unwrapped along the path.

    Raises
    ------
    ValueError
        A value out of its domain, or a mode that does not exist for the given sliders: the message
        gives the first such triple with the existing modes, or by how much the legs are too short
        or too long.

    Notes
    -----
    Leg lengths are met within 1e-14 of the mechanism's size. Rates are not finite where
    `singularity` is zero, and next to such poses they lose digits like its inverse. Source: J.
    Pérez Gámiz, TFG, UPV/EHU Bilbao 2018, eqs 146-148, for the positions; the source has no rates,
    forces and modes.

    Examples
    --------
    >>> where = dict(side=1.0, leg=1.0, guide2_x=3.0, guide3_x=2.5, guide3_y=2.8)
    >>> pose = solve([2.0, 0.5, 0.2], **where)
    >>> [round(float(pose[name]), 6) for name in ("x", "y", "psi")]
    [2.21711, 0.976147, -0.250967]
    """
    robot = RobotLengths(side, leg, guide2_x, guide3_x, guide3_y)
    check_one_of(MODES, mode=mode)
    check_not_negative(platform_mass=platform_mass, leg_mass=leg_mass, slider_mass=slider_mass)
    check_number(gravity=gravity)
    shape, (s, ds, dds) = flatten_motion(sliders=sliders, rate=rate, acceleration=acceleration)
    loads_at_p = broadcast_loads(shape, load_x=load_x, load_y=load_y, load_moment=load_moment)
    across, up, turning = (load.ravel() for load in loads_at_p)
    point, psi, singularity = _choose_pose(s, mode, robot)
    e, arm = leg_vectors(robot.guide_origins + s * GUIDE_DIRECTIONS, point, psi, side)
    slide = dot(e, GUIDE_DIRECTIONS)
    with np.errstate(divide="ignore", invalid="ignore"):  # singular: inf or nan, as documented
        move, turn = inverse_jacobian(e, arm)
        v, w = ((x * ds * slide).sum(axis=0) for x in (move, turn))
        de = v + 1j * w * arm - ds * GUIDE_DIRECTIONS
        right = dds * slide + w**2 * dot(e, arm) - np.abs(de) ** 2
        a, dw = ((x * right).sum(axis=0) for x in (move, turn))
        dde = a + (1j * dw - w**2) * arm - dds * GUIDE_DIRECTIONS
        loads: dict[str, Array] = {}
        if is_requested(only, *LOAD_ENDINGS):
            spin, lift, middle = 1j * dw - w**2, 1j * gravity, arm.mean(axis=0)
            ends = (
                inertia * dds * GUIDE_DIRECTIONS + lift,
                inertia * (a + spin * arm) + lift,
            )  # of the legs
            force = platform_mass * (inertia * (a + spin * middle) + lift)
            moment = cross(middle, force) + inertia * platform_mass * side**2 / 12.0 * dw
            force, moment = force - (across + 1j * up), moment - turning
            holding_force = slider_mass * dot(ends[0], GUIDE_DIRECTIONS)
            for k in range(3):  # virtual work for a unit rate of slider k
                unit_velocity, unit_rate = move[k] * slide[k], turn[k] * slide[k]
                feet = np.where(np.arange(3)[:, None] == k, GUIDE_DIRECTIONS, 0.0)
                moved = feet, unit_velocity + 1j * unit_rate * arm
                holding_force[k] += dot(force, unit_velocity) + moment * unit_rate
                holding_force[k] += drive_moment(leg_mass, ends, moved).sum(axis=0)
            loads = {f"holding_force_{k + 1}": row for k, row in enumerate(holding_force)}
            if is_requested(only, *PIN_FORCE_ENDINGS):
                loads |= _pin_forces(
                    (e, arm), (move, turn), (force, moment), ends, leg_mass, slider_mass
                )
    curves = {
        "x": point.real,
        "x_rate": v.real,
        "x_acceleration": a.real,
        "y": point.imag,
        "y_rate": v.imag,
        "y_acceleration": a.imag,
        "psi": psi,
        "psi_rate": w,
        "psi_acceleration": dw,
        "singularity": singularity,
        **loads,
    }
    for name, rows in {
        "leg_angle_{}": np.angle(e),
        "leg_angle_{}_rate": cross(e, de) / leg**2,
        "leg_angle_{}_acceleration": cross(e, dde) / leg**2,
    }.items():
        curves |= {name.format(k + 1): row for k, row in enumerate(rows)}
    curves = {name: curve.reshape(shape) for name, curve in curves.items()}
    angles = ("psi", "leg_angle_1", "leg_angle_2", "leg_angle_3")
    return curves | {name: unwrap_angles(curves[name]) for name in angles if shape}


def _pin_forces(
    pose: tuple[Complex, Complex],
    unit_motions: tuple[Complex, Array],
    needed: tuple[Complex, Array],
    ends: tuple[Complex, Complex],
    leg_mass: float,
    slider_mass: float,
) -> dict[str, Array]:
    """Forces of pins and guides.

    `pose` has the vectors of legs and arms, `unit_motions` is the result of `inverse_jacobian`.
    `needed` are the force and the moment about P that the platform needs from the legs, and `ends`
    the accelerations of slider and corner of each leg less that of gravity.
    """
    (e, arm), (move, turn), (force, moment) = pose, unit_motions, needed
    on_leg, m = pin_load(leg_mass, e, ends)
    across = -1j * m * e / np.abs(e) ** 2
    remainder = force - across.sum(axis=0), moment - cross(arm, across).sum(axis=0)
    on_platform = across + (dot(move, remainder[0]) + turn * remainder[1]) * e
    on_leg = on_leg + on_platform
    on_slider = on_leg + slider_mass * ends[0]
    found: dict[str, Array] = {}
    for k in range(3):
        found |= components_in_frame(f"pin_force_{k + 1}", on_platform[k], e[k])
        found |= components_in_frame(f"leg_force_{k + 1}", on_leg[k], e[k])
        found |= components_in_frame(f"guide_force_{k + 1}", on_slider[k], GUIDE_DIRECTIONS[k])
    return found


def _choose_pose(s: Array, mode: int, robot: RobotLengths) -> tuple[Complex, Array, Array]:
    """P, psi and singularity of a mode, or a ValueError where the mode does not exist."""
    found = poses(s, **asdict(robot))
    hits = {m: _has_mode(found["singularity"], m) for m in MODES}
    exists = hits[mode].any(axis=0)
    if not exists.all():
        n = int(np.argmin(exists))
        others = [
            f"{m:+d} at psi {found['psi'][hit[:, n], n][0]:.6g} rad"
            for m, hit in hits.items()
            if hit[:, n].any()
        ]
        triple = ", ".join(f"{x:.9g}" for x in s[:, n])
        short = missing_leg_length(s[:, n], robot) if not others else 0.0
        why = (
            f"there are: {', '.join(others)}"
            if others
            else (f"the legs are too {'short' if short > 0 else 'long'} by {abs(short):.6g} m")
        )
        raise ValueError(f"mode {mode:+.0f} does not exist at sliders ({triple}) m; {why}")
    row = np.argmax(hits[mode], axis=0)[None]
    x, y, psi, singularity = (
        np.take_along_axis(found[name], row, 0)[0] for name in ("x", "y", "psi", "singularity")
    )
    return x + 1j * y, psi, singularity


def _has_mode(singularity: Array, mode: int) -> NDArray[np.bool_]:
    """Whether each of the poses (6, n) has the mode; a singular pose counts for both signs."""
    sign = np.sign(mode) * singularity > -POSE_TOLERANCE
    return sign & (np.cumsum(sign, axis=0) == abs(mode))


def circle(
    time: ArrayLike,
    *,
    centre_x: float,
    centre_y: float,
    radius: float,
    period: float,
    psi: float = 0.0,
    swing: float = 0.0,
    side: float,
    leg: float,
    guide2_x: float,
    guide3_x: float,
    guide3_y: float,
    leg_mode: int = 1,
) -> tuple[Array, Array, Array]:
    r"""Slider motions that move the platform's centre on a circle while the platform swings.

    ::

        centre = (centre_x, centre_y) + radius (cos u, sin u)     u = 2 pi time/period
        angle  = psi + swing sin u

    `time` [s] (n,), lengths [m], `period` [s], `psi` and `swing` [rad]; `leg_mode` is the mode of
    `solve_inverse`. Returns the positions of the three sliders [m] and their first and second time
    derivatives, each (3, n). ValueError as in `solve_inverse`, or for a period that is not
    positive.
    >>> where = dict(side=1.0, leg=1.0, guide2_x=3.0, guide3_x=2.5, guide3_y=2.8)
    >>> path = dict(centre_x=2.0, centre_y=1.2, radius=0.1, period=2.0)
    >>> sliders, rate, _ = circle([0.0, 1.0], **path, **where)
    >>> sliders.round(6)
    array([[ 1.188312,  0.988312],
           [-0.011688,  0.188312],
           [ 0.106135,  0.22265 ]])
    """
    robot = RobotLengths(side, leg, guide2_x, guide3_x, guide3_y)
    check_positive("s", period=period)
    check_number(centre_x=centre_x, centre_y=centre_y, radius=radius, psi=psi, swing=swing)
    check_finite(time=time)
    w = 2.0 * np.pi / period
    turn = np.exp(1j * w * np.asarray(time, float))
    swung = swing * turn
    angle = psi + swung.imag, w * swung.real, -(w**2) * swung.imag
    centre = (
        centre_x + 1j * centre_y + radius * turn,
        1j * w * radius * turn,
        -(w**2) * radius * turn,
    )
    arm = side * UNIT_CORNERS.mean() * np.exp(1j * angle[0])  # from P to the centre
    point = (
        centre[0] - arm,
        centre[1] - 1j * angle[1] * arm,
        centre[2] - (1j * angle[2] - angle[1] ** 2) * arm,
    )
    motion = (np.array([p.real, p.imag, a]) for p, a in zip(point, angle, strict=True))
    return slider_motion(solve_inverse(*motion, **asdict(robot), mode=leg_mode))


def follow_path(
    motion: PathMotion,
    *,
    side: float,
    leg: float,
    guide2_x: float,
    guide3_x: float,
    guide3_y: float,
    leg_mode: int = 1,
) -> tuple[Array, Array, Array]:
    """Positions of the three sliders that lead the platform along a path, with their derivatives.

    Parameters
    ----------
    motion : PathMotion
        x, y [m] of P, the platform's corner on the first leg, and its angle psi [rad].
    side, leg, guide2_x, guide3_x, guide3_y : [m], see `solve_inverse`
    leg_mode : the mode of `solve_inverse`

    Returns
    -------
    position, rate, acceleration : ndarray (3, n)
        [m, m/s, m/s^2], exact.

    Raises
    ------
    ValueError
        As `solve_inverse`.
    """
    found = solve_inverse(
        motion.place,
        motion.rate,
        motion.acceleration,
        side=side,
        leg=leg,
        guide2_x=guide2_x,
        guide3_x=guide3_x,
        guide3_y=guide3_y,
        mode=leg_mode,
    )
    return slider_motion(found)


def slider_motion(found: dict[str, Array]) -> tuple[Array, Array, Array]:
    """Positions, rates and accelerations (3, n) of the sliders that `solve_inverse` found."""
    value, rate, acceleration = (
        np.array([found[f"slider_{k}{part}"] for k in (1, 2, 3)])
        for part in ("", "_rate", "_acceleration")
    )
    return value, rate, acceleration
