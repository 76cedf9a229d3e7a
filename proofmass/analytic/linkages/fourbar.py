"""Planar four-bar linkage: position, velocity, acceleration, coupler curve and static moments."""

import numpy as np
from numpy.typing import ArrayLike

from proofmass.analytic.numerics import Array, finite, not_negative, one_of, positive, unwrapped

Triple = tuple[Array, Array, Array]  # a value with its first and second derivative by the angle
MODES = (1, -1)


def solve(
    angle: ArrayLike, rate: ArrayLike = 1.0, acceleration: ArrayLike = 0.0, *,
    crank: float, coupler: float, rocker: float, ground: float, mode: int = 1,
    point_along: float = 0.0, point_across: float = 0.0,
    crank_mass: float = 0.0, coupler_mass: float = 0.0, rocker_mass: float = 0.0,
    rocker_load: float = 0.0, gravity: float = 9.81,
) -> dict[str, Array]:
    r"""Motion of a four-bar linkage whose crank motion is given.

    ::

              X     Q         A = (0, 0) and B = (ground, 0) are fixed
             a  /     \  b    A-P crank, vector p, driven
             /         \      P-Q coupler, vector a; X any point of the coupler
           P            \     B-Q rocker, vector b
        A --------------- B   d = B - P, D = d . d

    Q is where the circle of radius c = coupler about P meets that of r = rocker about B. With J
    the turn by +90 degrees and C = a x b (twice the area of triangle P-Q-B, signed)::

        C = mode/2 sqrt((c + r)^2 - D) sqrt(D - (c - r)^2)
        a = (x d + C J d)/D, x = (D + c^2 - r^2)/2;  b = (y d + C J d)/D, y = x - D

    and, with ' the derivative by the crank angle and d x d' = (D + crank^2 - ground^2)/2, the
    coupler and rocker angle turn by::

        a1 = ((x C' - C x')/c^2 + d x d')/D,  a2 = ((x C'' - C x'')/c^2 + D'/2 - a1 D')/D
        b1 = ((y C' - C y')/r^2 + d x d')/D,  b2 = ((y C'' - C y'')/r^2 + D'/2 - b1 D')/D

    The moment that holds the crank still is gravity * sum(mass * dy/dangle) over the three
    mid-lengths (uniform bars, gravity along -y), less rocker_load * b1.

    A linkage with s + l = p + q has a **change point**, where all four bars are in line and the
    two modes meet. One of the roots, sqrt(k^2 cos^2(angle/2)) at crank + ground = coupler + rocker
    or sqrt(k^2 sin^2(angle/2)) at |crank - ground| = |coupler - rocker|, k^2 = 4 crank ground, is
    there taken without the absolute value: the motion goes straight on, as inertia makes it. Its
    period may be two turns, and C changes sign at each change point.

    Parameters
    ----------
    angle, rate, acceleration : crank angle [rad], its first [rad/s] and second [rad/s^2] time
        derivative, (...) broadcast together; the last axis is the sweep
    crank, coupler, rocker, ground : lengths between pins [m]
    mode : +1 open, Q left of the directed line P -> B (C > 0); -1 crossed, Q right of it (C < 0).
        C is zero only where coupler and rocker are in line, so a mode is one continuous branch.
        With a change point: the sign of C where 0 < angle < pi.
    point_along, point_across : X in the coupler's frame [m]: from P towards Q, and left of that
    crank_mass, coupler_mass, rocker_mass : masses of the bars [kg]
    rocker_load : constant moment on the rocker, counter-clockwise positive [N m]
    gravity : [m/s^2]

    Returns
    -------
    dict of (...) arrays: coupler_angle, rocker_angle [rad], each with _rate and _acceleration;
    pin_x, pin_y [m], pin_vx, pin_vy, pin_ax, pin_ay of Q and the same of X, point_x ...;
    transmission_angle [rad], between coupler and rocker, in [0, pi]; holding_moment [N m];
    mechanical_advantage 1/b1, the moment that a rocker without masses gives out over the moment
    put into the crank. Angles start in [-pi, pi] and are unwrapped along the last axis, which
    needs steps below pi between samples.

    Raises
    ------
    ValueError
        A length not positive, a mass negative, a point or load not finite, a mode unknown, or a
        pose that cannot be assembled: the message gives the first such angle and by how much the
        circles miss.

    Notes
    -----
    Loop residual below 1e-14 of the lengths. At a limit of the crank, where coupler and rocker are
    in line, the rates are not finite; next to it they lose digits like 1/C^2, and like 1/D where P
    comes near B. Lengths make a change point to within 4 eps of their sum. Source: loop and example
    of B. Díaz Lozano, TFG, Universidad de Almería 2019, text lines 1142-2288, solved there by
    Newton-Raphson. Its accelerations (text line 2054), labelled +1 rad/s^2, are those of -1.

    Examples
    --------
    >>> pose = solve(0.0, crank=1.0, coupler=2.0, rocker=2.5, ground=3.0, mode=-1)
    >>> [round(float(pose[name]), 8) for name in ("pin_x", "pin_y", "rocker_rate")]
    [1.4375, -1.95156187, -0.5]
    """
    lengths = {"crank": crank, "coupler": coupler, "rocker": rocker, "ground": ground}
    masses = {"crank_mass": crank_mass, "coupler_mass": coupler_mass, "rocker_mass": rocker_mass}
    positive(**lengths)
    one_of(MODES, mode=mode)
    not_negative(**masses)
    finite(point_along=point_along, point_across=point_across, rocker_load=rocker_load)
    inputs = np.broadcast_arrays(*(np.asarray(x, float) for x in (angle, rate, acceleration)))
    theta, w, dw = (np.atleast_1d(x) for x in inputs)
    px, py = crank * np.cos(theta), crank * np.sin(theta)
    with np.errstate(divide="ignore", invalid="ignore"):  # in line: inf or nan, as documented
        (ax, ay, a1, a2), (bx, by, b1, b2), cross, dot = _close(
            theta, ground - px, -py, **lengths, mode=mode)
        a_motion, b_motion = (a1 * w, a1 * dw + a2 * w**2), (b1 * w, b1 * dw + b2 * w**2)
        along, across = point_along / coupler, point_across / coupler
        moment = 0.5 * gravity * (
            crank_mass * px + coupler_mass * (2.0 * px + a1 * ax) + rocker_mass * b1 * bx
        ) - rocker_load * b1
        curves = {
            "coupler_angle": unwrapped(np.arctan2(ay, ax)),
            "coupler_rate": a_motion[0], "coupler_acceleration": a_motion[1],
            "rocker_angle": unwrapped(np.arctan2(by, bx)),
            "rocker_rate": b_motion[0], "rocker_acceleration": b_motion[1],
            **_tip("pin", (bx, by, *b_motion), start=ground),
            **_tip("point", (px, py, w, dw),
                   (along * ax - across * ay, along * ay + across * ax, *a_motion)),
            "transmission_angle": np.arctan2(np.abs(cross), dot),
            "holding_moment": moment, "mechanical_advantage": 1.0 / b1,
        }
    return {name: curve.reshape(inputs[0].shape) for name, curve in curves.items()}


def margins(crank: float, coupler: float, rocker: float, ground: float) -> tuple[float, float]:
    """(c + r)^2 - (crank + ground)^2 and (crank - ground)^2 - (c - r)^2 [m^2], to rounding.

    A negative first one keeps the crank from pi, a negative second one from 0; zero is a change
    point there.
    """
    slack = _slack(crank, coupler, rocker, ground)

    def difference(x: float, y: float) -> float:
        return 0.0 if abs(x - y) <= slack else (x - y) * (x + y)

    return (difference(coupler + rocker, crank + ground),
            difference(abs(crank - ground), abs(coupler - rocker)))


def _slack(crank: float, coupler: float, rocker: float, ground: float) -> float:
    """Rounding of a sum or difference of the four lengths [m]."""
    return 4.0 * float(np.finfo(float).eps) * (crank + coupler + rocker + ground)


def _close(
    theta: Array, dx: Array, dy: Array, *,
    crank: float, coupler: float, rocker: float, ground: float, mode: int,
) -> tuple[tuple[Array, ...], tuple[Array, ...], Array, Array]:
    """Coupler and rocker as vectors with first and second turn, their cross and dot product."""
    k = 2.0 * np.sqrt(crank * ground)
    u, v = k * np.cos(0.5 * theta), k * np.sin(0.5 * theta)
    square = (crank - ground) ** 2 + v * v, u * v, 0.5 * (u * u - v * v)
    _reach(theta, np.sqrt(square[0]), coupler, rocker, _slack(crank, coupler, rocker, ground))
    outer, inner = margins(crank, coupler, rocker, ground)
    p, p1, p2 = _root(outer, u, -0.5 * v)
    q, q1, q2 = _root(inner, v, 0.5 * u)
    half = 0.5 * mode
    cross = half * p * q, half * (p1 * q + p * q1), half * (p2 * q + 2.0 * p1 * q1 + p * q2)
    turn = 0.5 * (square[0] + (crank - ground) * (crank + ground))
    along, down = (tuple(0.5 * sign * x for x in square) for sign in (1.0, -1.0))
    shift = 0.5 * (coupler - rocker) * (coupler + rocker)
    a = _bar(coupler, (shift + along[0], *along[1:]), cross, square, turn, dx, dy)
    b = _bar(rocker, (shift + down[0], *down[1:]), cross, square, turn, dx, dy)
    return a, b, cross[0], 0.5 * (coupler**2 + rocker**2 - square[0])


def _root(margin: float, wave: Array, slope: Array) -> Triple:
    """sqrt(margin + wave^2), wave'' = -wave/4; without a margin the wave itself, of either sign."""
    if margin == 0.0:
        return wave, slope, -0.25 * wave
    root = np.sqrt(np.maximum(margin + wave * wave, 0.0))
    first = wave * slope / root
    return root, first, (slope * slope - 0.25 * wave * wave - first * first) / root


def _bar(
    length: float, along: Triple, cross: Triple, square: Triple, turn: Array, dx: Array, dy: Array
) -> tuple[Array, Array, Array, Array]:
    """Vector (along d + cross J d)/square of a bar, its first and second turn by the angle."""
    (x, x1, x2), (y, y1, y2), (s, s1, _) = along, cross, square
    first = ((x * y1 - y * x1) / length**2 + turn) / s
    second = ((x * y2 - y * x2) / length**2 + (0.5 - first) * s1) / s
    return (x * dx - y * dy) / s, (x * dy + y * dx) / s, first, second


def _reach(theta: Array, distance: Array, coupler: float, rocker: float, slack: float) -> None:
    """ValueError where the circles of coupler and rocker, `distance` apart, do not meet."""
    gap = np.maximum(distance - (coupler + rocker), abs(coupler - rocker) - distance)
    if not gap.max(initial=0.0) <= slack:
        bad = np.unravel_index(np.argmin(gap <= slack), gap.shape)
        raise ValueError(
            f"loop cannot close at angle {theta[bad]:.9g} rad: the circles of coupler and rocker "
            f"miss by {gap[bad]:.6g} m"
        )
    if not distance.min(initial=np.inf) > slack:
        raise ValueError("the crank pin meets the fixed pin of the rocker: rocker angle undefined")


def _tip(name: str, *arms: tuple[Array, ...], start: float = 0.0) -> dict[str, Array]:
    """Position, velocity and acceleration at the end of arms (x, y, rate, acceleration)."""
    x, y, vx, vy, ax, ay = (sum(terms) for terms in zip(*(
        (x, y, -w * y, w * x, -dw * y - w**2 * x, dw * x - w**2 * y) for x, y, w, dw in arms
    ), strict=True))
    return {f"{name}_x": start + x, f"{name}_y": y, f"{name}_vx": vx, f"{name}_vy": vy,
            f"{name}_ax": ax, f"{name}_ay": ay}
