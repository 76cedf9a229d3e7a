"""Planar five-bar linkage with both cranks driven: motion of its tip, moments that hold it."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from proofmass.analytic.linkages import fivebar_inverse, fivebar_workspace
from proofmass.analytic.linkages.fivebar_inverse import check, cross, dot, inputs, twice_area
from proofmass.analytic.numerics import Array, Complex, unwrapped

MODES = (1, -1)


def solve(
    angle: ArrayLike, rate: ArrayLike = 1.0, acceleration: ArrayLike = 0.0, *,
    left_crank: float, left_coupler: float, right_coupler: float, right_crank: float,
    left_x: float, right_x: float, mode: int = 1,
    left_crank_mass: float = 0.0, left_coupler_mass: float = 0.0,
    right_coupler_mass: float = 0.0, right_crank_mass: float = 0.0,
    gravity: float = 9.81, force_x: float = 0.0, force_y: float = 0.0,
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

    The tip moves by t = -(p x a) J b/C for a unit rate of the left crank, by (q x b) J a/C for
    one of the right. Half a uniform bar's weight hangs at each of its ends, so with the load F at
    the tip, the force less half of both couplers' weight, virtual work gives the moment that holds
    a crank: gravity/2 (crank_mass + coupler_mass) p_x - F . t.

    Parameters
    ----------
    angle, rate, acceleration : (left, right) crank angle [rad], its first [rad/s] and second
        [rad/s^2] time derivative; angle (2,) or (2, n), the others broadcast to it
    left_crank, left_coupler, right_coupler, right_crank : lengths between pins [m]
    left_x, right_x : places of the fixed pins on the x axis [m]
    mode : +1 T left of the directed line L -> R (C > 0), -1 right of it. C is zero only where the
        couplers are in line (type 2 singularity), so a mode is one continuous branch.
    left_crank_mass, left_coupler_mass, right_coupler_mass, right_crank_mass : of the bars [kg]
    gravity : along -y [m/s^2]
    force_x, force_y : constant force on the tip [N]

    Returns
    -------
    dict of (n,) arrays, or of scalars: tip_x, tip_y [m], tip_vx, tip_vy, tip_ax, tip_ay;
    left_coupler_angle, right_coupler_angle [rad], each with _rate and _acceleration; left_moment,
    right_moment that hold the cranks still [N m]; pin_distance D [m]. Sines of the angles
    between bars, whose signs are those of the modes and whose zeros are the singular poses:
    assembly, a x b/(c r), type 2; left_working and right_working, coupler x crank, type 1. Angles
    start in [-pi, pi] and are unwrapped, which needs steps below pi between samples.

    Raises
    ------
    ValueError
        A length not positive, a mass negative, a mode unknown, or poses that cannot be assembled:
        the message gives the first one's angles and by how much the circles miss.

    Notes
    -----
    Loop residual below 1e-14 of the lengths. Where the couplers are in line the rates are not
    finite; next to it they lose digits like 1/C^2.

    Sources: B. Díaz Lozano, TFG, Universidad de Almería 2019, text lines 2290-2981: A = (0, 0),
    B = (ground, 0), inputs theta, beta = left, right; its example is mode +1. Its velocities (line
    2638) and accelerations (2724) are those of the unsolved first guess. Five-bar notebook "método
    geométrico", text lines 7-123: l1, l2 right crank and coupler, l4, l3 left, right_x = -left_x =
    l5/2, inputs theta1, theta4 = right, left. It eliminates X3 = f + g Y3, which divides by zero
    where L and R are above each other and misprints the sign of b in eq. (0.9); its "arms up" is
    mode +1 only while R is to the right of L. Both stop at kinematics; the moments are ours.

    Examples
    --------
    >>> pose = solve([0.3, 0.9], [0.1, 0.0], left_crank=2.0, left_coupler=3.5, right_coupler=4.0,
    ...              right_crank=1.0, left_x=0.0, right_x=2.0)
    >>> [round(float(pose[name]), 8) for name in ("tip_x", "tip_y", "tip_vx", "tip_vy")]
    [-0.9068351, 2.66749129, 0.52591296, 0.98486894]
    """
    check(left_crank=left_crank, left_coupler=left_coupler, right_coupler=right_coupler,
          right_crank=right_crank, left_x=left_x, right_x=right_x, mode=mode)
    theta, w, dw = inputs(angle, rate, acceleration)
    turned = np.exp(1j * theta)  # vectors are complex numbers, J is 1j
    p, q = left_crank * turned[0], right_crank * turned[1]
    d = right_x + q - left_x - p
    reach = abs(right_x - left_x) + left_crank + right_crank
    area = mode * twice_area(np.abs(d), left_coupler, right_coupler, reach, theta,
                             "loop cannot close at angles ({:.9g}, {:.9g}) rad", "the couplers")
    square, excess = np.abs(d) ** 2, left_coupler**2 - right_coupler**2
    a = (0.5 * (square + excess) + 1j * area) * d / square
    b, left_lever, right_lever = a - d, cross(p, a), cross(q, a - d)
    vp, vq = 1j * w[0] * p, 1j * w[1] * q
    dvp, dvq = (1j * dw[0] - w[0] ** 2) * p, (1j * dw[1] - w[1] ** 2) * q
    with np.errstate(divide="ignore", invalid="ignore"):  # in line: inf or nan, as documented
        alpha, beta = dot(vq - vp, b) / area, dot(vq - vp, a) / area
        rest = 0.5 * (left_coupler**2 + right_coupler**2 - square)
        ddalpha = (dot(dvq - dvp, b) + alpha**2 * rest - beta**2 * right_coupler**2) / area
        ddbeta = (dot(dvq - dvp, a) + alpha**2 * left_coupler**2 - beta**2 * rest) / area
        left_moment, right_moment = _moments(
            p, q, -1j * b * left_lever / area, 1j * a * right_lever / area,
            force_x + 1j * force_y, gravity, left_crank_mass=left_crank_mass,
            left_coupler_mass=left_coupler_mass, right_coupler_mass=right_coupler_mass,
            right_crank_mass=right_crank_mass)
        tip, v = left_x + p + a, vp + 1j * alpha * a
        dv = dvp + (1j * ddalpha - alpha**2) * a
    curves = {
        "tip_x": tip.real, "tip_y": tip.imag, "tip_vx": v.real, "tip_vy": v.imag,
        "tip_ax": dv.real, "tip_ay": dv.imag,
        "left_coupler_angle": unwrapped(np.atleast_1d(np.angle(a))),
        "left_coupler_rate": alpha, "left_coupler_acceleration": ddalpha,
        "right_coupler_angle": unwrapped(np.atleast_1d(np.angle(b))),
        "right_coupler_rate": beta, "right_coupler_acceleration": ddbeta,
        "left_moment": left_moment, "right_moment": right_moment,
        "pin_distance": np.abs(d), "assembly": area / (left_coupler * right_coupler),
        "left_working": -left_lever / (left_crank * left_coupler),
        "right_working": -right_lever / (right_crank * right_coupler),
    }
    return {name: np.reshape(curve, theta.shape[1:]) for name, curve in curves.items()}


def _moments(
    p: Complex, q: Complex, by_left: Complex, by_right: Complex, force: complex, gravity: float,
    **masses: float,
) -> tuple[Array, Array]:
    """Moments that hold the cranks; `by_left`, `by_right` move the tip at unit crank rates."""
    check(**masses)
    left, right = masses["left_coupler_mass"], masses["right_coupler_mass"]
    load = np.asarray(force - 0.5j * gravity * (left + right))
    left_weight = 0.5 * gravity * (masses["left_crank_mass"] + left)
    right_weight = 0.5 * gravity * (masses["right_crank_mass"] + right)
    return left_weight * p.real - dot(load, by_left), right_weight * q.real - dot(load, by_right)


def circle(
    time: ArrayLike, *, center_x: float, center_y: float, radius: float, rate: float,
    **linkage: Any,
) -> tuple[Array, Array, Array]:
    """Crank motions that lead the tip round a circle at constant speed: a drive law.

    The tip stands at center + radius (cos, sin)(rate time), `time` [s] (n,); lengths [m], `rate`
    [rad/s] of either sign. `linkage` holds the lengths, left_x, right_x, left_mode and right_mode
    of `fivebar_inverse.solve`. Returns (left, right) crank angles [rad], rates [rad/s] and
    accelerations [rad/s^2], each (2, n). ValueError where the circle leaves the reach. The angles
    are continuous over the law, whatever times it is asked for, if the circle stays clear of the
    x axis left of each fixed pin.

    >>> link = dict(left_crank=4.0, left_coupler=5.0, right_coupler=5.0, right_crank=4.0,
    ...             left_x=-3.0, right_x=3.0, left_mode=1, right_mode=-1)
    >>> angle, rate, _ = circle(0.0, center_x=-1.0, center_y=8.0, radius=1.0, rate=0.5, **link)
    >>> [round(float(value), 6) for value in angle]
    [1.570796, 1.570796]
    """
    spin = radius * np.exp(1j * rate * np.asarray(time, float))
    tip, v, dv = center_x + 1j * center_y + spin, 1j * rate * spin, -(rate**2) * spin
    pose = fivebar_inverse.solve(
        *([vector.real, vector.imag] for vector in (tip, v, dv)), **linkage)
    angle, speed, change = (np.stack([pose[f"left{part}"], pose[f"right{part}"]])
                            for part in ("", "_rate", "_acceleration"))
    return angle, speed, change


def facts(*, left_crank: float, left_coupler: float, right_coupler: float, right_crank: float,
          left_x: float, right_x: float, **_: float) -> dict[str, str]:
    """Which crank angles can be assembled, in words, for a report."""
    share = fivebar_workspace.unassembled_share(
        left_crank=left_crank, left_coupler=left_coupler, right_coupler=right_coupler,
        right_crank=right_crank, left_x=left_x, right_x=right_x)
    return {"crank angles": "any two can be assembled" if share < 1e-12 else
            f"{100 * share:.2f} % of all pairs cannot be assembled"}
