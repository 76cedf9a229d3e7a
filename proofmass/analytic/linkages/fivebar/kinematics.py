r"""Planar five-bar linkage with both cranks driven: motion, holding moments, inverse, workspace.

::

        T                 L, R   crank pins        |L - R| in [|c - r|, c + r]: assembled
     c .' `. r            A, B   fixed pins        |T - A| in [|l - c|, l + c] and
     .'     `.            l, m   cranks            |T - B| in [|m - r|, m + r]: T within reach
   L '       ` R          c, r   couplers
   l \       / m          g      distance A-B
      A     B

The lengths are those of `solve` and `FivebarLengths`: left_crank l, left_coupler c, right_coupler
r, right_crank m, left_x and right_x, all in [m]. A length that is not positive, or a left_x or
right_x that is not finite, raises a ValueError. Sources: the workspace as the intersection of two
annuli is textbook knowledge, and so are the two types of singularity (C. Gosselin and J. Angeles,
IEEE Trans. Robotics and Automation 6, 1990); neither B. Díaz Lozano, TFG, Universidad de Almería
2019, nor the five-bar notebook treats them.
"""

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from proofmass.analytic.inverse import PathMotion
from proofmass.analytic.linkages.bars import (
    FORCE_ENDINGS,
    LOAD_ENDINGS,
    Ends,
    drive_moment,
    is_requested,
    pin_load,
)
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

WORKING_MODES = (1, -1)


@dataclass(frozen=True)
class FivebarLengths:
    """Lengths on which the reach of a five-bar linkage depends.

    Attributes
    ----------
    left_crank, left_coupler, right_coupler, right_crank : float
        Lengths between pins [m].
    left_x, right_x : float
        Places of the fixed pins on the x axis [m].
    """

    left_crank: float
    left_coupler: float
    right_coupler: float
    right_crank: float
    left_x: float
    right_x: float

    def __post_init__(self) -> None:
        check_positive(
            left_crank=self.left_crank,
            left_coupler=self.left_coupler,
            right_coupler=self.right_coupler,
            right_crank=self.right_crank,
        )
        check_number(left_x=self.left_x, right_x=self.right_x)

    @property
    def base(self) -> float:
        """Distance from the left to the right fixed pin along x, of either sign [m]."""
        return self.right_x - self.left_x

    @property
    def size(self) -> float:
        """Sum of all lengths [m]."""
        return (
            abs(self.base)
            + self.left_crank
            + self.left_coupler
            + self.right_coupler
            + self.right_crank
        )

    @property
    def circles(self) -> tuple[tuple[float, float, int, str], ...]:
        """Circles that bound the reach: centre, radius [m], +1 outer or -1 inner, side.

        A circle of radius zero, of a crank as long as its coupler, is left out.
        """
        found = []
        for side, x, crank, coupler in (
            ("left", self.left_x, self.left_crank, self.left_coupler),
            ("right", self.right_x, self.right_crank, self.right_coupler),
        ):
            found.append((x, crank + coupler, 1, side))
            if crank != coupler:
                found.append((x, abs(crank - coupler), -1, side))
        return tuple(found)

    def crank_pins(self, left: Array, right: Array) -> tuple[Complex, Complex]:
        """Positions x + iy of both crank pins at crank angles [rad] [m]."""
        return (
            np.asarray(self.left_x + self.left_crank * np.exp(1j * left)),
            np.asarray(self.right_x + self.right_crank * np.exp(1j * right)),
        )


def solve_inverse(
    tip: ArrayLike,
    velocity: ArrayLike = 0.0,
    acceleration: ArrayLike = 0.0,
    *,
    left_crank: float,
    left_coupler: float,
    right_coupler: float,
    right_crank: float,
    left_x: float,
    right_x: float,
    left_mode: int = 1,
    right_mode: int = 1,
) -> dict[str, Array]:
    r"""Crank motions of a five-bar linkage whose tip motion is given (inverse kinematics).

    ::

              pin                 one side: base A of the left crank, or B of the right one;
        crank .' `.  coupler      p = base-pin, length l; a = pin-tip, length c;
            .'  s  `.             s = tip - base, S = |s|
        base ------- tip          +1: pin to the left of s, as drawn; -1: to the right

    Each side is solved by itself. The angle at the base, between s and the crank, is psi, in
    [0, pi]. With K twice the area of triangle base-pin-tip::

        angle = arg(s) + mode psi,  tan(psi) = K/((S^2 + l^2 - c^2)/2)
        K = 1/2 sqrt((l + c + S)(l + c - S)(S + |l - c|)(S - |l - c|))
        rate = a . v/(p x a),  p x a = -mode K
        acceleration = (a . v' + rate^2 a . p + |v - J p rate|^2)/(p x a)

    Parameters
    ----------
    tip, velocity, acceleration : (x, y) of the tip [m], its velocity [m/s] and acceleration
        [m/s^2]; tip (2,) or (2, n), the others broadcast to it
    left_crank, left_coupler, right_coupler, right_crank, left_x, right_x : [m], as in
        `fivebar.solve`
    left_mode, right_mode : working modes, +-1 each as above; a mode is one continuous branch,
        which ends where crank and coupler are in line (K = 0, type 1 singularity)

    Returns
    -------
    dict of (n,) arrays, or of scalars: left, right [rad], each with _rate and _acceleration, and
    assembly, the sine of the angle between the couplers: its sign is the mode with which
    `fivebar.solve` gives the same pose, its zeros are the type 2 singularities. Angles are
    arg(s) + mode psi with arg(s) unwrapped, in (-2 pi, 2 pi) for the first sample.

    Raises
    ------
    ValueError
        A length not positive, a value not finite, a mode unknown, or a tip out of reach: the
        message gives the first such tip, the side, and the distance between the circles of its
        crank and coupler.

    Notes
    -----
    Residual below 1e-14 of the lengths. Source: five-bar notebook "método geométrico", text lines
    125-254, whose signs (sigma1, sigma2) are (right_mode, left_mode). The notebook solves a
    quadratic equation for tan(angle/2), which divides by zero where a root is half a turn; the
    formulas here do not.

    Examples
    --------
    >>> pose = solve_inverse([0.0, 8.0], left_crank=4.0, left_coupler=5.0, right_coupler=5.0,
    ...              right_crank=4.0, left_x=-3.0, right_x=3.0)
    >>> [round(float(np.degrees(pose[side])), 6) for side in ("left", "right")]
    [90.0, 131.11209]
    """
    # refuses lengths out of their domains
    FivebarLengths(left_crank, left_coupler, right_coupler, right_crank, left_x, right_x)
    check_one_of(WORKING_MODES, left_mode=left_mode, right_mode=right_mode)
    motion = broadcast_motion(2, tip=tip, velocity=velocity, acceleration=acceleration)
    left, a = _solve_side("left", motion, left_x, left_crank, left_coupler, left_mode)
    right, b = _solve_side("right", motion, right_x, right_crank, right_coupler, right_mode)
    curves = left | right | {"assembly": cross(a, b) / (left_coupler * right_coupler)}
    return {name: np.reshape(curve, motion[0].shape[1:]) for name, curve in curves.items()}


def _solve_side(
    name: str, motion: list[Array], base: float, crank: float, coupler: float, mode: int
) -> tuple[dict[str, Array], Complex]:
    """Angle, rate and acceleration of one crank, and the vector of its coupler."""
    tip, v, dv = (x + 1j * y for x, y in motion)
    s = tip - base
    area = twice_area(
        np.abs(s),
        crank,
        coupler,
        float(np.abs(base)),
        motion[0],
        "tip out of reach at ({:.9g}, {:.9g}) m",
        f"{name} crank and coupler",
    )
    square = np.abs(s) ** 2
    side = 0.5 * (square + crank**2 - coupler**2)
    p = (side + 1j * mode * area) * s / square
    a = s - p
    with np.errstate(divide="ignore", invalid="ignore"):  # in line: inf or nan, as documented
        lever = -mode * area
        rate = dot(a, v) / lever
        second = (dot(a, dv) + rate**2 * dot(a, p) + np.abs(v - 1j * rate * p) ** 2) / lever
    angle = unwrap_angles(np.atleast_1d(np.angle(s))) + mode * np.arctan2(area, side)
    return {name: angle, f"{name}_rate": rate, f"{name}_acceleration": second}, a


def jacobians(
    angle: ArrayLike,
    tip: ArrayLike,
    *,
    left_crank: float,
    right_crank: float,
    left_x: float,
    right_x: float,
) -> tuple[Array, Array]:
    """Matrices A and B of the velocity equation A v = B w, (..., 2, 2) each.

    v is the velocity of the tip, w are the (left, right) crank rates. The rows of A are the vectors
    a and b of the couplers, and B is diag(p x a, q x b): det B = 0 in type 1, det A = a x b = 0 in
    type 2 singularities. The transposed matrices relate static forces: the moments M on the cranks
    that balance a force F on the tip solve A^T n = F, M = -B^T n. `angle` [rad] and `tip` [m] are a
    pose, (2,) or (2, n); lengths [m] as in `solve`. Source: derived here; the notebook named in
    `solve` has positions only.

    >>> A, B = jacobians([np.pi / 2, np.pi / 2], [0.0, 8.0], left_crank=4.0, right_crank=4.0,
    ...                  left_x=-3.0, right_x=3.0)
    >>> np.linalg.solve(A, B).round(12).tolist()
    [[-2.0, -2.0], [-1.5, 1.5]]
    """
    check_positive(left_crank=left_crank, right_crank=right_crank)
    check_number(left_x=left_x, right_x=right_x)
    theta, place = broadcast_motion(2, angle=angle, tip=tip)
    p, q = left_crank * np.exp(1j * theta[0]), right_crank * np.exp(1j * theta[1])
    end = place[0] + 1j * place[1]
    a, b, zero = end - left_x - p, end - right_x - q, np.zeros(end.shape)
    A = np.array([[a.real, a.imag], [b.real, b.imag]])
    B = np.array([[cross(p, a), zero], [zero, cross(q, b)]])
    return np.moveaxis(A, (0, 1), (-2, -1)), np.moveaxis(B, (0, 1), (-2, -1))


def twice_area(
    distance: Array,
    one: float,
    two: float,
    size: float,
    pose: Array,
    error_format: str,
    bars: str,
) -> Array:
    """Twice the area of triangles with three given sides, or a ValueError if one cannot be closed.

    The sides are `distance`, `one` and `two`; `size` bounds the numbers from which `distance` was
    computed. The message is made of `error_format`, a format for the two entries of `pose` (2, ...)
    at the first such triangle, and of `bars`, the names of the bars.
    """
    far, near = one + two, abs(one - two)
    violation = np.maximum(distance - far, near - distance)
    rounding = 4.0 * np.finfo(float).eps * (far + size)  # rounding at a limit position
    is_closed = (violation <= rounding) & (distance > rounding)
    if not is_closed.all():
        bad = np.unravel_index(np.argmin(is_closed), is_closed.shape)
        miss = f"miss by {violation[bad]:.6g} m"
        raise ValueError(
            f"{error_format.format(*(row[bad] for row in pose))}: the circles of {bars} "
            + ("coincide, so the pose is not determined" if violation[bad] <= rounding else miss)
        )
    heron = (far + distance) * (far - distance) * (distance + near) * (distance - near)
    return np.asarray(0.5 * np.sqrt(np.maximum(heron, 0.0)))


def unassembled_share(link: FivebarLengths) -> float:
    """Share [1] of all pairs of crank angles at which the linkage cannot be assembled.

    At a given left angle, with S = |L - B|, the share of right angles with |L - R| < x is
    arccos((S^2 + m^2 - x^2)/(2 S m))/pi, with the argument clipped to [-1, 1]. Its mean over the
    left angle is computed by Gauss quadrature between the angles at which the clipping begins; the
    error is below 1e-12.

    >>> round(unassembled_share(FivebarLengths(2.0, 3.5, 4.0, 1.0, 0.0, 2.0)), 8)
    0.02126519
    """
    left_crank, right_crank, ground = link.left_crank, link.right_crank, abs(link.base)
    limits = link.left_coupler + link.right_coupler, abs(link.left_coupler - link.right_coupler)
    kink_distances = np.array([right_crank + sign * x for x in limits for sign in (1, -1)])
    with np.errstate(divide="ignore", invalid="ignore"):  # ground = 0: S is constant
        cosines = (ground**2 + left_crank**2 - kink_distances**2) / (2.0 * ground * left_crank)
    knots = np.array([0.0, *np.sort(np.arccos(cosines[np.abs(cosines) < 1.0])), np.pi])
    nodes, weights = np.polynomial.legendre.leggauss(64)
    u = 0.5 * np.pi * (nodes + 1.0)  # angle = middle - half cos(u): no square roots at ends
    half = 0.5 * np.diff(knots)[:, None]
    angle = knots[:-1, None] + half * (1.0 - np.cos(u))
    s = np.abs(ground - left_crank * np.exp(1j * angle))
    far, near = s + right_crank, np.abs(s - right_crank)
    # not arccos, which has half of the digits where a circle is touched at all left angles
    over, under = (
        2.0
        * np.arctan2(
            np.sqrt(np.maximum((x - near) * (x + near), 0.0)),
            np.sqrt(np.maximum((far - x) * (far + x), 0.0)),
        )
        for x in limits
    )
    assembled = np.sum((over - under) / np.pi * half * np.sin(u) * weights) / 2.0
    return float(1.0 - assembled)


MODES = (1, -1)


def solve(
    angle: ArrayLike,
    rate: ArrayLike = 1.0,
    acceleration: ArrayLike = 0.0,
    *,
    left_crank: float,
    left_coupler: float,
    right_coupler: float,
    right_crank: float,
    left_x: float,
    right_x: float,
    mode: int = 1,
    left_crank_mass: float = 0.0,
    left_coupler_mass: float = 0.0,
    right_coupler_mass: float = 0.0,
    right_crank_mass: float = 0.0,
    tip_mass: float = 0.0,
    gravity: float = 9.81,
    force_x: ArrayLike = 0.0,
    force_y: ArrayLike = 0.0,
    inertia: bool = False,
    only: Collection[str] | None = None,
) -> dict[str, Array]:
    r"""Motion of a five-bar linkage whose two crank motions are given (direct kinematics).

    ::

                  T            A = (left_x, 0) and B = (right_x, 0) are fixed
             a  .' `.  b       A-L left crank, vector p, driven; B-R right crank, q, driven
              .'     `.        L-T left coupler, vector a, length c
           L '         ` R     R-T right coupler, vector b, length r
             \         /       T the tip;  d = R - L, D = |d|
              A       B

    T is where the circle of radius c about L meets that of r about R. With J the turn by +90
    degrees and C = a x b (twice the area of triangle L-R-T, signed)::

        C = mode/2 sqrt((c + r + D)(c + r - D)(D + |c - r|)(D - |c - r|))
        a = [(D^2 + c^2 - r^2)/2 d + C J d]/D^2,  b = a - d

    The angles alpha of a and beta of b then follow from J a alpha' - J b beta' = d'::

        alpha' = d' . b/C,  alpha'' = (d'' . b + alpha'^2 a . b - beta'^2 r^2)/C
        beta'  = d' . a/C,  beta''  = (d'' . a + alpha'^2 c^2 - beta'^2 a . b)/C

    The velocity of the tip is t = -(p x a) J b/C for a unit rate of the left crank, and
    (q x b) J a/C for a unit rate of the right one. Half the weight of a uniform bar acts at each of
    its ends. Let F be the force on the tip less the weight of the tip and of half of both couplers.
    Virtual work then gives the moment that holds a crank at rest:
    gravity/2 (crank_mass + coupler_mass) p_x - F . t. With inertia, the power of mass times
    acceleration at a unit rate of that crank alone is added.

    Mass and force of the tip act on the left coupler. Weight and inertia of this coupler, with
    them, need the moment m1 about L; those of the right coupler need m2 about R. The pin at T
    applies the force N to the right coupler and -N to the left one, with -a x N = m1, b x N = m2::

        N = -(m1 b + m2 a)/C

    The forces of the other four pins follow from the balance of forces.

    Parameters
    ----------
    angle, rate, acceleration : (left, right) crank angle [rad], its first [rad/s] and second
        [rad/s^2] time derivative; angle (2,) or (2, n), the others broadcast to it
    left_crank, left_coupler, right_coupler, right_crank : lengths between pins [m]
    left_x, right_x : positions of the fixed pins on the x axis [m]
    mode : +1 T left of the directed line L -> R (C > 0), -1 right of it. C is zero only where the
        couplers are in line (type 2 singularity), so a mode is one continuous branch.
    left_crank_mass, left_coupler_mass, right_coupler_mass, right_crank_mass : masses of the bars
        [kg]
    tip_mass : point mass at the tip [kg]
    gravity : along -y [m/s^2]
    force_x, force_y : force on the tip [N], constants or (n,)
    inertia : whether moments and forces include those of the accelerations
    only : names of all requested quantities; None requests all. Moments and forces, which take
        longer than the motion, are computed only if one of them is requested

    Returns
    -------
    dict of (n,) arrays, or of scalars: tip_x, tip_y [m], tip_vx, tip_vy, tip_ax, tip_ay;
    left_coupler_angle, right_coupler_angle [rad], each with _rate and _acceleration; left_moment,
    right_moment [N m] of the cranks' drives; forces of pins [N] in the frame of a bar, _x along it
    towards its second letter above and _y to the left of that: left_crank_force_x,
    left_crank_force_y of the ground on the left crank, left_coupler_force_.. of that crank on its
    coupler, right_crank_force_.. and right_coupler_force_.. in the same way, and pin_force_.. of
    the left coupler on the right one, in the left one's frame; pin_distance D [m]. Three sines of
    angles between bars have the signs of the modes, and zeros at singular poses: assembly,
    a x b/(c r), type 2; left_working and right_working, coupler x crank, type 1. Angles
    start in [-pi, pi] and are unwrapped, which needs steps below pi between samples.

    Raises
    ------
    ValueError
        A length not positive, a mass negative, a value not finite, a mode unknown, or poses that
        cannot be assembled: the message gives the angles of the first one and the distance between
        the circles.

    Notes
    -----
    Loop residual below 1e-14 of the lengths. Where the couplers are in line the rates are not
    finite; next to it they lose digits like 1/C^2.

    Sources: B. Díaz Lozano, TFG, Universidad de Almería 2019, text lines 2290-2981: A = (0, 0),
    B = (ground, 0), inputs theta, beta = left, right; its example is mode +1. Its velocities (line
    2638) and accelerations (2724) are those of the unsolved first guess. Five-bar notebook "método
    geométrico", text lines 7-123: l1, l2 right crank and coupler, l4, l3 left, right_x = -left_x =
    l5/2, inputs theta1, theta4 = right, left. It eliminates X3 = f + g Y3, which divides by zero
    where L and R are above each other, and misprints the sign of b in eq. (0.9); its "arms up" is
    mode +1 only while R is to the right of L. Neither source has moments and forces.

    Examples
    --------
    >>> pose = solve([0.3, 0.9], [0.1, 0.0], left_crank=2.0, left_coupler=3.5, right_coupler=4.0,
    ...              right_crank=1.0, left_x=0.0, right_x=2.0)
    >>> [round(float(pose[name]), 8) for name in ("tip_x", "tip_y", "tip_vx", "tip_vy")]
    [-0.9068351, 2.66749129, 0.52591296, 0.98486894]
    """
    link = FivebarLengths(left_crank, left_coupler, right_coupler, right_crank, left_x, right_x)
    check_one_of(MODES, mode=mode)
    check_not_negative(
        left_crank_mass=left_crank_mass,
        left_coupler_mass=left_coupler_mass,
        right_coupler_mass=right_coupler_mass,
        right_crank_mass=right_crank_mass,
        tip_mass=tip_mass,
    )
    check_number(gravity=gravity)
    theta, w, dw = broadcast_motion(2, angle=angle, rate=rate, acceleration=acceleration)
    across, up = broadcast_loads(theta.shape[1:], force_x=force_x, force_y=force_y)
    directions = np.exp(1j * theta)  # vectors are complex numbers, J is 1j
    p, q = left_crank * directions[0], right_crank * directions[1]
    d = right_x + q - left_x - p
    size = abs(link.base) + left_crank + right_crank
    area = mode * twice_area(
        np.abs(d),
        left_coupler,
        right_coupler,
        size,
        theta,
        "loop cannot close at angles ({:.9g}, {:.9g}) rad",
        "the couplers",
    )
    square, excess = np.abs(d) ** 2, left_coupler**2 - right_coupler**2
    a = (0.5 * (square + excess) + 1j * area) * d / square
    b, left_lever, right_lever = a - d, cross(p, a), cross(q, a - d)
    vp, vq = 1j * w[0] * p, 1j * w[1] * q
    dvp, dvq = (1j * dw[0] - w[0] ** 2) * p, (1j * dw[1] - w[1] ** 2) * q
    with np.errstate(divide="ignore", invalid="ignore"):  # in line: inf or nan, as documented
        alpha, beta = dot(vq - vp, b) / area, dot(vq - vp, a) / area
        a_dot_b = 0.5 * (left_coupler**2 + right_coupler**2 - square)
        ddalpha = (dot(dvq - dvp, b) + alpha**2 * a_dot_b - beta**2 * right_coupler**2) / area
        ddbeta = (dot(dvq - dvp, a) + alpha**2 * left_coupler**2 - beta**2 * a_dot_b) / area
        tip, v = left_x + p + a, vp + 1j * alpha * a
        dv = dvp + (1j * ddalpha - alpha**2) * a
        loads: dict[str, Array] = {}
        if is_requested(only, *LOAD_ENDINGS):
            lift = 1j * gravity
            at_l, at_t, at_r = (inertia * each + lift for each in (dvp, dv, dvq))
            carried = tip_mass * at_t - (across + 1j * up)
            left = left_crank_mass, left_coupler_mass
            right = right_crank_mass, right_coupler_mass
            by_left, by_right = -1j * b * left_lever / area, 1j * a * right_lever / area
            loads = {
                "left_moment": dot(carried, by_left)
                + drive_moment(left[0], (lift, at_l), (0j, 1j * p))
                + drive_moment(left[1], (at_l, at_t), (1j * p, by_left))
                + drive_moment(right[1], (at_r, at_t), (0j, by_left)),
                "right_moment": dot(carried, by_right)
                + drive_moment(right[0], (lift, at_r), (0j, 1j * q))
                + drive_moment(right[1], (at_r, at_t), (1j * q, by_right))
                + drive_moment(left[1], (at_l, at_t), (0j, by_right)),
            }
            if is_requested(only, *FORCE_ENDINGS):
                loads |= _forces(
                    (p, a, q, b), (at_l, at_t, at_r), area, carried, lift, (*left, *right)
                )
    curves = {
        "tip_x": tip.real,
        "tip_y": tip.imag,
        "tip_vx": v.real,
        "tip_vy": v.imag,
        "tip_ax": dv.real,
        "tip_ay": dv.imag,
        "left_coupler_angle": unwrap_angles(np.atleast_1d(np.angle(a))),
        "left_coupler_rate": alpha,
        "left_coupler_acceleration": ddalpha,
        "right_coupler_angle": unwrap_angles(np.atleast_1d(np.angle(b))),
        "right_coupler_rate": beta,
        "right_coupler_acceleration": ddbeta,
        **loads,
        "pin_distance": np.abs(d),
        "assembly": area / (left_coupler * right_coupler),
        "left_working": -left_lever / (left_crank * left_coupler),
        "right_working": -right_lever / (right_crank * right_coupler),
    }
    return {name: np.reshape(curve, theta.shape[1:]) for name, curve in curves.items()}


def _forces(
    bars: tuple[Complex, Complex, Complex, Complex],
    accelerations: tuple[Complex, Complex, Complex],
    area: Array,
    carried: Complex,
    lift: complex,
    masses: tuple[float, float, float, float],
) -> dict[str, Array]:
    """Forces of the pins of bars A-L, L-T, B-R, R-T with given masses; `area` is C.

    `accelerations` are those of L, T and R less that of gravity, which is -`lift`; `carried` is the
    force that the left coupler applies to the tip.
    """
    at_l, at_t, at_r = accelerations
    ends: tuple[Ends, ...] = (lift, at_l), (at_l, at_t), (lift, at_r), (at_r, at_t)
    (f0, _), (f1, m1), (f2, _), (f3, m2) = (
        pin_load(mass, bar, two) for mass, bar, two in zip(masses, bars, ends, strict=True)
    )
    left_crank, left, right_crank, right = bars
    m1 = m1 + cross(left, carried)
    on_right = np.asarray(-(m1 * right + m2 * left) / area)
    on_left, from_right = f1 + carried + on_right, f3 - on_right
    return {
        **components_in_frame("left_crank_force", f0 + on_left, left_crank),
        **components_in_frame("left_coupler_force", on_left, left),
        **components_in_frame("right_crank_force", f2 + from_right, right_crank),
        **components_in_frame("right_coupler_force", from_right, right),
        **components_in_frame("pin_force", on_right, left),
    }


def circle(
    time: ArrayLike,
    *,
    center_x: float,
    center_y: float,
    radius: float,
    rate: float,
    **linkage: Any,
) -> tuple[Array, Array, Array]:
    """Motion profiles of the cranks that move the tip on a circle at constant speed.

    The tip is at center + radius (cos, sin)(rate time), `time` [s] (n,); lengths [m], `rate`
    [rad/s] of either sign. `linkage` has the lengths, left_x, right_x, left_mode and right_mode of
    `solve_inverse`. Returns (left, right) crank angles [rad], rates [rad/s] and accelerations
    [rad/s^2], each (2, n). ValueError where the circle leaves the reach. The angles at different
    times are continuous, even if they are computed by separate calls, if the circle does not meet
    the x axis to the left of a fixed pin.

    >>> link = dict(left_crank=4.0, left_coupler=5.0, right_coupler=5.0, right_crank=4.0,
    ...             left_x=-3.0, right_x=3.0, left_mode=1, right_mode=-1)
    >>> angle, rate, _ = circle(0.0, center_x=-1.0, center_y=8.0, radius=1.0, rate=0.5, **link)
    >>> [round(float(value), 6) for value in angle]
    [1.570796, 1.570796]
    """
    check_number(center_x=center_x, center_y=center_y, radius=radius, rate=rate)
    check_finite(time=time)
    spin = radius * np.exp(1j * rate * np.asarray(time, float))
    tip, v, dv = center_x + 1j * center_y + spin, 1j * rate * spin, -(rate**2) * spin
    return follow_tip(np.asarray(tip), np.asarray(v), np.asarray(dv), **linkage)


def rectangle(
    time: ArrayLike,
    *,
    corner_x: float,
    corner_y: float,
    width: float,
    height: float,
    period: float,
    **linkage: Any,
) -> tuple[Array, Array, Array]:
    r"""Motion profiles of the cranks that move the tip on a rectangle, with rest in its corners.

    ::

        4 <--- 3      each side takes a quarter of the period; on it, with tau from 0 to 1,
        |      ^      share = tau - sin(2 pi tau)/(2 pi)
        v      |      velocity and acceleration are zero in every corner, and both are
        1 ---> 2      continuous, as the cranks need it

    `time` [s] (n,); corner 1 at (corner_x, corner_y), `width` and `height` [m] of either sign,
    `period` [s]. `linkage` and the returned values are as for `circle`. ValueError where the
    rectangle leaves the reach, or for a period that is not positive.

    >>> link = dict(left_crank=4.0, left_coupler=5.0, right_coupler=5.0, right_crank=4.0,
    ...             left_x=-3.0, right_x=3.0, left_mode=1, right_mode=-1)
    >>> angle, rate, _ = rectangle([0.0, 1.0], corner_x=0.0, corner_y=8.0, width=-1.0, height=-1.0,
    ...                            period=4.0, **link)
    >>> bool(np.abs(rate).max() < 1e-12), angle[:, 0].round(6).tolist()
    (True, [1.570796, 1.570796])
    """
    check_positive("s", period=period)
    check_number(corner_x=corner_x, corner_y=corner_y, width=width, height=height)
    check_finite(time=time)
    quarters = 4.0 * np.asarray(time, float) / period
    number = np.floor(quarters)
    phase = 2.0 * np.pi * (quarters - number)
    corners = complex(corner_x, corner_y) + np.array(
        [0.0, width, complex(width, height), 1j * height]
    )
    side = number.astype(int) % 4
    corner, edge = corners[side], (np.roll(corners, -1) - corners)[side]
    quarter_rate = 4.0 / period
    share = (phase - np.sin(phase)) / (2.0 * np.pi)
    vectors: list[Complex] = [
        corner + share * edge,
        quarter_rate * (1.0 - np.cos(phase)) * edge,
        2.0 * np.pi * quarter_rate**2 * np.sin(phase) * edge,
    ]
    return follow_tip(*vectors, **linkage)


def follow_tip(tip: Complex, v: Complex, dv: Complex, **linkage: Any) -> tuple[Array, Array, Array]:
    """Crank angles, rates and accelerations, (2, n) each, for a given motion of the tip."""
    pose = solve_inverse(*([vector.real, vector.imag] for vector in (tip, v, dv)), **linkage)
    angle, rate, acceleration = (
        np.stack([pose[f"left{part}"], pose[f"right{part}"]])
        for part in ("", "_rate", "_acceleration")
    )
    return angle, rate, acceleration


def follow_path(
    motion: PathMotion,
    *,
    left_crank: float,
    left_coupler: float,
    right_coupler: float,
    right_crank: float,
    left_x: float,
    right_x: float,
    left_mode: int = 1,
    right_mode: int = 1,
) -> tuple[Array, Array, Array]:
    """Crank angles (left, right) that lead the tip along a path, with rates and accelerations.

    Parameters
    ----------
    motion : PathMotion
        x, y of the tip [m].
    left_crank, left_coupler, right_coupler, right_crank, left_x, right_x : [m], see `solve_inverse`
    left_mode, right_mode : working modes, see `solve_inverse`

    Returns
    -------
    angle, rate, acceleration : ndarray (2, n)
        [rad, rad/s, rad/s^2], exact; the angles are continuous along the path.

    Raises
    ------
    ValueError
        As `solve_inverse`.
    """
    return follow_tip(
        *(x + 1j * y for x, y in (motion.place, motion.rate, motion.acceleration)),
        left_crank=left_crank,
        left_coupler=left_coupler,
        right_coupler=right_coupler,
        right_crank=right_crank,
        left_x=left_x,
        right_x=right_x,
        left_mode=left_mode,
        right_mode=right_mode,
    )


def properties(
    *,
    left_crank: float,
    left_coupler: float,
    right_coupler: float,
    right_crank: float,
    left_x: float,
    right_x: float,
    **_: float,
) -> dict[str, str]:
    """Share of crank angles at which the linkage cannot be assembled, in words for a report."""
    share = unassembled_share(
        FivebarLengths(left_crank, left_coupler, right_coupler, right_crank, left_x, right_x)
    )
    return {
        "crank angles": "any two can be assembled"
        if share < 1e-12
        else f"{100 * share:.2f} % of all pairs cannot be assembled"
    }
