"""Rigid 3PRR planar parallel robot, direct: motion of the platform from its three sliders."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from proofmass.analytic.linkages import threeprr_inverse
from proofmass.analytic.linkages.threeprr_inverse import (
    CORNERS,
    GUIDES,
    check,
    cross,
    dot,
    origins,
    three,
)
from proofmass.analytic.linkages.threeprr_poses import NEAR, inverse_jacobian, lacking, legs, poses
from proofmass.analytic.numerics import Array, Complex, not_negative, unwrapped

MODES = (1, -1, 2, -2, 3, -3)


def solve(
    sliders: ArrayLike, rate: ArrayLike = 1.0, acceleration: ArrayLike = 0.0, *,
    side: float, leg: float, guide2_x: float, guide3_x: float, guide3_y: float, mode: int = 1,
    platform_mass: float = 0.0, leg_mass: float = 0.0, slider_mass: float = 0.0,
    load_x: float = 0.0, load_y: float = 0.0, load_moment: float = 0.0, gravity: float = 9.81,
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

    The poses are those of `threeprr_poses.poses`. For the leg e, the arm b = corner - P, the
    guide's direction g and the slider's rate s', each leg of fixed length gives one row of two
    linear systems with the same matrix::

        e . v + w (b x e)   = s' e . g
        e . v' + w' (b x e) = s'' e . g + w^2 e . b - |e'|^2

    The forces that hold the sliders still follow from the transposed matrix (virtual work).

    Parameters
    ----------
    sliders, rate, acceleration : s1, s2, s3 [m], (3, ...), and their time derivatives [m/s],
        [m/s^2], which broadcast with the axes of `sliders` from the left; the last axis is the path
    side, leg : of the platform; of each leg [m]
    guide2_x, guide3_x, guide3_y : where guides 2 and 3 start [m], of either sign
    mode : +k, -k: the k-th by ascending psi in [-pi, pi] among the poses of positive, negative
        `singularity`. Both signs are equally frequent, and a pose keeps its sign on every path that
        it follows without becoming singular: where there are two poses, mode is one continuous
        branch. Where there are four or six it is one until another pose of its sign appears,
        vanishes, passes it in psi (parallel legs), or one of them crosses psi = pi.
    platform_mass, leg_mass, slider_mass : uniform platform and each leg, each slider [kg]
    load_x, load_y, load_moment : constant load on the platform at P [N], [N m]
    gravity : along -y [m/s^2]

    Returns
    -------
    dict of (...) arrays: x, y [m] of P, psi [rad] and, for k = 1, 2, 3, leg_angle_k [rad], each
    with _rate and _acceleration; holding_force_k [N], along the guide; singularity, the matrix's
    determinant over leg^3 side: zero where the lines of the legs meet in one point or are parallel.
    Angles start in [-pi, pi] and are unwrapped along the path.

    Raises
    ------
    ValueError
        A value out of its domain, or a mode that is not there: the message gives the first such
        triple with the modes that are there, or by how much the legs are too short or too long.

    Notes
    -----
    Legs are met within 1e-14 of the mechanism. Rates are not finite where `singularity` is zero,
    and lose digits like its inverse next to it. Source: J. Pérez Gámiz, TFG, UPV/EHU Bilbao 2018,
    eqs 146-148, for the positions; rates, forces and modes are ours.

    Examples
    --------
    >>> where = dict(side=1.0, leg=1.0, guide2_x=3.0, guide3_x=2.5, guide3_y=2.8)
    >>> pose = solve([2.0, 0.5, 0.2], **where)
    >>> [round(float(pose[name]), 6) for name in ("x", "y", "psi")]
    [2.21711, 0.976147, -0.250967]
    """
    where = {"side": side, "leg": leg, "guide2_x": guide2_x, "guide3_x": guide3_x,
             "guide3_y": guide3_y}
    check(**where, mode=mode, modes=MODES)
    not_negative(platform_mass=platform_mass, leg_mass=leg_mass, slider_mass=slider_mass)
    shape, (s, ds, dds) = three(sliders, rate, acceleration)
    point, psi, singularity = _chosen(s, mode, where)
    e, arm = legs(origins(guide2_x, guide3_x, guide3_y) + s * GUIDES, point, psi, side)
    slide = dot(e, GUIDES)
    weight = gravity * (platform_mass + 1.5 * leg_mass)  # half of each leg hangs on its corner
    force, moment = load_x + 1j * (load_y - weight), load_moment - weight * arm.real.mean(axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):  # singular: inf or nan, as documented
        move, turn = inverse_jacobian(e, arm)
        v, w = ((x * ds * slide).sum(axis=0) for x in (move, turn))
        de = v + 1j * w * arm - ds * GUIDES
        right = dds * slide + w**2 * dot(e, arm) - np.abs(de) ** 2
        a, dw = ((x * right).sum(axis=0) for x in (move, turn))
        dde = a + (1j * dw - w**2) * arm - dds * GUIDES
        hold = -slide * (dot(move, force) + turn * moment)
        hold += gravity * (slider_mass + 0.5 * leg_mass) * GUIDES.imag
    curves = {
        "x": point.real, "x_rate": v.real, "x_acceleration": a.real,
        "y": point.imag, "y_rate": v.imag, "y_acceleration": a.imag,
        "psi": psi, "psi_rate": w, "psi_acceleration": dw, "singularity": singularity,
    }
    for name, rows in {
        "leg_angle_{}": np.angle(e), "leg_angle_{}_rate": cross(e, de) / leg**2,
        "leg_angle_{}_acceleration": cross(e, dde) / leg**2, "holding_force_{}": hold,
    }.items():
        curves |= {name.format(k + 1): row for k, row in enumerate(rows)}
    curves = {name: curve.reshape(shape) for name, curve in curves.items()}
    angles = ("psi", "leg_angle_1", "leg_angle_2", "leg_angle_3")
    return curves | {name: unwrapped(curves[name]) for name in angles if shape}


def _chosen(s: Array, mode: int, where: dict[str, float]) -> tuple[Complex, Array, Array]:
    """P, psi and singularity of the mode, or ValueError where it is not there."""
    found = poses(s, **where)
    hits = {m: _hit(found["singularity"], m) for m in MODES}
    there = hits[mode].any(axis=0)
    if not there.all():
        n = int(np.argmin(there))
        others = [f"{m:+d} at psi {found['psi'][hit[:, n], n][0]:.6g} rad"
                  for m, hit in hits.items() if hit[:, n].any()]
        triple = ", ".join(f"{x:.9g}" for x in s[:, n])
        short = lacking(s[:, n], **where) if not others else 0.0
        why = f"there are: {', '.join(others)}" if others else (
            f"the legs are too {'short' if short > 0 else 'long'} by {abs(short):.6g} m")
        raise ValueError(f"mode {mode:+.0f} is not there at sliders ({triple}) m; {why}")
    row = np.argmax(hits[mode], axis=0)[None]
    x, y, psi, singularity = (np.take_along_axis(found[name], row, 0)[0]
                              for name in ("x", "y", "psi", "singularity"))
    return x + 1j * y, psi, singularity


def _hit(singularity: Array, mode: int) -> NDArray[np.bool_]:
    """Which of the poses (6, n) is the mode's; a singular pose is one of either sign."""
    sign = np.sign(mode) * singularity > -NEAR
    return sign & (np.cumsum(sign, axis=0) == abs(mode))


def circle(
    time: ArrayLike, *, centre_x: float, centre_y: float, radius: float, period: float,
    psi: float = 0.0, swing: float = 0.0, side: float, leg: float, guide2_x: float,
    guide3_x: float, guide3_y: float, leg_mode: int = 1,
) -> tuple[Array, Array, Array]:
    r"""Slider motions that lead the platform's centre around a circle while the platform swings.

    ::

        centre = (centre_x, centre_y) + radius (cos u, sin u)     u = 2 pi time/period
        angle  = psi + swing sin u

    `time` [s] (n,), lengths [m], `period` [s], `psi` and `swing` [rad]; `leg_mode` is the mode of
    `threeprr_inverse.solve`. Returns the three sliders [m] and their first and second time
    derivatives, each (3, n). ValueError as there, or for a period that is not positive.
    >>> where = dict(side=1.0, leg=1.0, guide2_x=3.0, guide3_x=2.5, guide3_y=2.8)
    >>> path = dict(centre_x=2.0, centre_y=1.2, radius=0.1, period=2.0)
    >>> sliders, rate, _ = circle([0.0, 1.0], **path, **where)
    >>> sliders.round(6)
    array([[ 1.188312,  0.988312],
           [-0.011688,  0.188312],
           [ 0.106135,  0.22265 ]])
    """
    if not 0.0 < period < np.inf:
        raise ValueError(f"period must be positive and finite [s], got {period}")
    w = 2.0 * np.pi / period
    turn = np.exp(1j * w * np.asarray(time, float))
    swung = swing * turn
    angle = psi + swung.imag, w * swung.real, -w**2 * swung.imag
    centre = centre_x + 1j * centre_y + radius * turn, 1j * w * radius * turn, -w**2 * radius * turn
    arm = side * CORNERS.mean() * np.exp(1j * angle[0])  # from P to the centre
    point = (centre[0] - arm, centre[1] - 1j * angle[1] * arm,
             centre[2] - (1j * angle[2] - angle[1] ** 2) * arm)
    motion = (np.array([p.real, p.imag, a]) for p, a in zip(point, angle, strict=True))
    found = threeprr_inverse.solve(*motion, side=side, leg=leg, guide2_x=guide2_x,
                                   guide3_x=guide3_x, guide3_y=guide3_y, mode=leg_mode)
    value, rate, acceleration = (np.array([found[f"slider_{k}{part}"] for k in (1, 2, 3)])
                                 for part in ("", "_rate", "_acceleration"))
    return value, rate, acceleration
