"""Planar four-bar linkage: position, velocity, acceleration and static holding moment."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
MODES = (1, -1)
TURN = 2.0 * np.pi


def solve(
    angle: ArrayLike, rate: ArrayLike = 1.0, acceleration: ArrayLike = 0.0, *,
    crank: float, coupler: float, rocker: float, ground: float, mode: int = 1,
    crank_mass: float = 0.0, coupler_mass: float = 0.0, rocker_mass: float = 0.0,
    gravity: float = 9.81,
) -> dict[str, Array]:
    r"""Motion of a four-bar linkage whose crank motion is given.

    ::

                    Q         A = (0, 0) and B = (ground, 0) are fixed
             a  /     \  b    A-P crank, vector p, driven
             /         \      P-Q coupler, vector a
           P            \     B-Q rocker, vector b
        A --------------- B   d = B - P, D = |d|

    Q is where the circle of radius c = coupler about P meets that of r = rocker about B. With J
    the turn by +90 degrees and C = a x b (twice the area of triangle P-Q-B, signed)::

        C = mode/2 sqrt((c + r + D)(c + r - D)(D + |c - r|)(D - |c - r|))
        a = [(D^2 + c^2 - r^2)/2 d + C J d]/D^2,  b = a - d

    Derivatives by the crank angle follow from p + a = b + (ground, 0)::

        a1 = -(J p . b)/C,  a2 = (p . b + a1^2 a . b - b1^2 r^2)/C
        b1 = -(J p . a)/C,  b2 = (p . a + a1^2 c^2 - b1^2 a . b)/C

    for the coupler (a1, a2) and rocker angle (b1, b2). The moment that holds the crank still is
    gravity * sum(mass * dy/dangle) over the three mid-lengths (uniform bars, gravity along -y).

    Parameters
    ----------
    angle, rate, acceleration : crank angle [rad], its first [rad/s] and second [rad/s^2] time
        derivative, (...) broadcast together; the last axis is the sweep
    crank, coupler, rocker, ground : lengths between pins [m]
    mode : +1 open, Q left of the directed line P -> B (C > 0); -1 crossed, Q right of it (C < 0).
        C is zero only where coupler and rocker are in line, so a mode is one continuous branch.
    crank_mass, coupler_mass, rocker_mass : masses of the bars [kg]
    gravity : [m/s^2]

    Returns
    -------
    dict of (...) arrays: coupler_angle, rocker_angle [rad], each with _rate and _acceleration;
    pin_x, pin_y [m], pin_vx, pin_vy, pin_ax, pin_ay of Q; transmission_angle [rad], between
    coupler and rocker, in [0, pi]; holding_moment [N m]. Angles start in [-pi, pi] and are
    unwrapped along the last axis, which needs steps below pi between samples.

    Raises
    ------
    ValueError
        A length not positive, a mass negative, a mode unknown, or a pose that cannot be assembled:
        the message gives the first such angle and by how much the circles miss.

    Notes
    -----
    Loop residual below 1e-14 of the lengths. Where coupler and rocker are in line the rates are
    not finite; next to it they lose digits like 1/C^2. Source: loop and example of B. Díaz Lozano,
    TFG, Universidad de Almería 2019, text lines 1142-2288, solved there by Newton-Raphson. Its
    accelerations (text line 2054), labelled +1 rad/s^2, are those of -1 rad/s^2.

    Examples
    --------
    >>> pose = solve(0.0, crank=1.0, coupler=2.0, rocker=2.5, ground=3.0, mode=-1)
    >>> [round(float(pose[name]), 8) for name in ("pin_x", "pin_y", "rocker_rate")]
    [1.4375, -1.95156187, -0.5]
    """
    _check({"crank": crank, "coupler": coupler, "rocker": rocker, "ground": ground}, mode)
    for name, mass in (("crank", crank_mass), ("coupler", coupler_mass), ("rocker", rocker_mass)):
        if not 0.0 <= mass < np.inf:
            raise ValueError(f"{name}_mass must be zero or positive [kg], got {mass}")
    inputs = np.broadcast_arrays(*(np.asarray(x, float) for x in (angle, rate, acceleration)))
    theta, w, dw = (np.atleast_1d(x) for x in inputs)
    px, py = crank * np.cos(theta), crank * np.sin(theta)
    dx, dy = ground - px, -py
    ax, ay, cross = _close(theta, dx, dy, coupler, rocker, mode, crank + ground)
    bx, by = ax - dx, ay - dy
    dot = 0.5 * (coupler**2 + rocker**2 - dx * dx - dy * dy)
    with np.errstate(divide="ignore", invalid="ignore"):  # in line: inf or nan, as documented
        a1, b1 = (py * bx - px * by) / cross, (py * ax - px * ay) / cross
        a2 = (px * bx + py * by + a1**2 * dot - b1**2 * rocker**2) / cross
        b2 = (px * ax + py * ay + a1**2 * coupler**2 - b1**2 * dot) / cross
        b_rate, b_acceleration = b1 * w, b1 * dw + b2 * w**2
        moment = 0.5 * gravity * (
            crank_mass * px + coupler_mass * (2.0 * px + a1 * ax) + rocker_mass * b1 * bx
        )
        curves = {
            "coupler_angle": _unwrapped(np.arctan2(ay, ax)),
            "coupler_rate": a1 * w, "coupler_acceleration": a1 * dw + a2 * w**2,
            "rocker_angle": _unwrapped(np.arctan2(by, bx)),
            "rocker_rate": b_rate, "rocker_acceleration": b_acceleration,
            "pin_x": px + ax, "pin_y": py + ay, "pin_vx": -b_rate * by, "pin_vy": b_rate * bx,
            "pin_ax": -b_acceleration * by - b_rate**2 * bx,
            "pin_ay": b_acceleration * bx - b_rate**2 * by,
            "transmission_angle": np.arctan2(np.abs(cross), dot), "holding_moment": moment,
        }
    return {name: curve.reshape(inputs[0].shape) for name, curve in curves.items()}


def _check(lengths: dict[str, float], mode: int) -> None:
    for name, length in lengths.items():
        if not 0.0 < length < np.inf:
            raise ValueError(f"{name} must be a positive finite length [m], got {length}")
    if mode not in MODES:
        raise ValueError(f"mode must be one of {MODES}, got {mode}")


def _close(
    theta: Array, dx: Array, dy: Array, coupler: float, rocker: float, mode: int, reach: float
) -> tuple[Array, Array, Array]:
    """Coupler vector and cross product coupler x rocker, or ValueError where the circles miss."""
    far, near = coupler + rocker, abs(coupler - rocker)
    distance = np.hypot(dx, dy)
    gap = np.maximum(distance - far, near - distance)
    slack = 4.0 * np.finfo(float).eps * (far + reach)  # rounding of gap at an exact limit pose
    if not gap.max(initial=0.0) <= slack:
        bad = np.unravel_index(np.argmin(gap <= slack), gap.shape)
        raise ValueError(
            f"loop cannot close at angle {theta[bad]:.9g} rad: the circles of coupler and rocker "
            f"miss by {gap[bad]:.6g} m"
        )
    if not distance.min(initial=np.inf) > slack:
        raise ValueError("the crank pin meets the fixed pin of the rocker: rocker angle undefined")
    heron = (far + distance) * (far - distance) * (distance + near) * (distance - near)
    cross = 0.5 * mode * np.sqrt(np.maximum(heron, 0.0))
    square = distance * distance
    along, across = 0.5 + 0.5 * (coupler - rocker) * far / square, cross / square
    return along * dx - across * dy, along * dy + across * dx, cross


def _unwrapped(angle: Array) -> Array:
    turns = np.rint(np.diff(angle, axis=-1, prepend=angle[..., :1]) / TURN)
    return angle - TURN * np.cumsum(turns, axis=-1)
