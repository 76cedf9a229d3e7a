"""Power hacksaw: offset slider-crank with the slider on a guide above the crank axis."""

from collections.abc import Collection

import numpy as np
from numpy.typing import ArrayLike

from proofmass.analytic.linkages import slider_crank
from proofmass.analytic.linkages.bars import LOADS, asks
from proofmass.analytic.numerics import Array, finite, not_negative

MODES = (1, -1)


def solve(
    angle: ArrayLike,
    rate: ArrayLike,
    acceleration: ArrayLike,
    *,
    crank: float,
    coupler: float,
    offset: float,
    mode: int = 1,
    cutting_force: ArrayLike = 0.0,
    crank_mass: float = 0.0,
    coupler_mass: float = 0.0,
    slider_mass: float = 0.0,
    gravity: float = 9.81,
    inertia: bool = False,
    only: Collection[str] | None = None,
) -> dict[str, Array]:
    r"""Motion of the hacksaw linkage whose crank motion is given, in the report's nine curves.

    ::

        --[S]------------------- guide, y = offset   O = (0, 0) crank axis
             `--.__  coupler                         O-P crank r2, angle theta2 (given)
                   `--.__                            P-S coupler r3, angle theta3
                         `P                          O-S polar length r1, angle theta1
                     crank O

    The loop r1 = r2 + r3 with S on the guide gives, with e = offset - r2 sin(theta2) and
    q = r3 cos(theta3) = -mode sqrt((r3 + e)(r3 - e))::

        sin(theta3) = e/r3             theta3' = -theta2' r2 cos(theta2)/q
        theta3'' = (r2 sin(theta2) theta2'^2 + e theta3'^2 - theta2'' r2 cos(theta2))/q
        x = r2 cos(theta2) + q         x' = -r2 sin(theta2) theta2' - e theta3'
        x'' = -r2 (cos(theta2) theta2'^2 + sin(theta2) theta2'') - q theta3'^2 - e theta3''
        r1 = -hypot(x, offset)         theta1 = atan2(-offset, -x)

    Moment and forces are those of a slider-crank, see `slider_crank.solve`: at rest the moment is
    that of the weights, less cutting_force dx/dtheta2, by virtual work.

    r1 is negative by the report's convention, so theta1 points away from the slider: with the
    slider on the left it lies in (-pi/2, 0). r1' and r1'' are not the slider's rates x' and x''.

    Parameters
    ----------
    angle, rate, acceleration : crank angle theta2 [rad], its first [rad/s] and second [rad/s^2]
        time derivative, (...) broadcast together
    crank, coupler : lengths r2, r3 between pins [m]
    offset : height of the guide above the crank axis [m], of either sign
    mode : +1 slider left of the crank pin, theta3 = pi - asin(e/r3) (the report's); -1 right of
        it, theta3 = asin(e/r3)
    cutting_force : force on the slider along +x [N], or along the motion
    crank_mass, coupler_mass, slider_mass : uniform bars and slider [kg]
    gravity : along -y [m/s^2]
    inertia : whether moment and forces are those of the motion, and not those at rest
    only : names of all quantities that are asked for: moment and forces are left out if they are
        not among them; None asks for all

    Returns
    -------
    dict of (...) arrays: r1 [m], theta1, theta3 [rad], each with _rate and _acceleration;
    slider_x [m], slider_velocity [m/s], slider_acceleration [m/s^2]; holding_moment [N m] of the
    crank's drive; crank_force_x .. guide_force_y [N], see `slider_crank.solve`.

    Raises
    ------
    ValueError
        A length not positive, a mass negative, a value not finite, a mode unknown, or a pose that
        cannot close: the message gives the first such angle and by how much the coupler misses.

    Notes
    -----
    Loop residual below 1e-14 of the lengths. Rates are not finite where the coupler stands upright
    (|e| = r3), those of r1 and theta1 also where the slider meets the axis. theta1 is continuous
    through x = 0, where the report's acot(x/offset) jumps by pi and r1 changes sign. Source: power
    hacksaw report, Universidad Nacional de Colombia, text lines 300-338 (loop), 530-543 (solution).
    Misprints: lines 300 and 302 print the coupler terms with theta2 for theta3; lines 533-534
    print the formula of theta3' for r1 and that of theta1 for theta3'.

    Examples
    --------
    >>> pose = solve(0.0, 0.0, 0.0, crank=0.075, coupler=0.170, offset=0.045)
    >>> [round(float(pose[name]), 6) for name in ("r1", "theta1", "theta3")]
    [-0.099672, -0.468422, 2.873694]
    """
    finite(cutting_force=cutting_force, gravity=gravity)
    not_negative(crank_mass=crank_mass, coupler_mass=coupler_mass, slider_mass=slider_mass)
    theta, w, dw = np.broadcast_arrays(*(np.asarray(v, float) for v in (angle, rate, acceleration)))
    px, py, q = _close(theta, crank, coupler, offset, mode)
    e, x, square = offset - py, px + q, (px + q) ** 2 + offset**2
    with np.errstate(divide="ignore", invalid="ignore"):  # upright: inf or nan, as documented
        w3 = -w * px / q
        dw3 = (py * w**2 + e * w3**2 - dw * px) / q
        v = -py * w - e * w3
        a = -px * w**2 - py * dw - q * w3**2 - e * dw3
        r1 = -np.sqrt(square)
        curves = {
            "r1": r1,
            "theta1": np.arctan2(-offset, -x),
            "r1_rate": x * v / r1,
            "r1_acceleration": (x * a + (v * offset) ** 2 / square) / r1,
            "theta1_rate": -offset * v / square,
            "theta1_acceleration": offset * (2.0 * x * v**2 / square - a) / square,
            "theta3": np.arctan2(e, np.abs(q)) if mode < 0 else np.pi - np.arctan2(e, np.abs(q)),
            "theta3_rate": w3,
            "theta3_acceleration": dw3,
            "slider_x": x,
            "slider_velocity": v,
            "slider_acceleration": a,
        }
    if asks(only, *LOADS):
        whole = slider_crank.solve(
            theta,
            w,
            dw,
            crank=crank,
            coupler=coupler,
            guide_y=offset,
            mode=-mode,  # there +1 is ahead of the crank pin along the guide
            crank_mass=crank_mass,
            coupler_mass=coupler_mass,
            slider_mass=slider_mass,
            slider_load=cutting_force,
            gravity=gravity,
            inertia=inertia,
            only=only,
        )
        curves |= {name: curve for name, curve in whole.items() if asks({name}, *LOADS)}
    return {name: np.asarray(curve) for name, curve in curves.items()}


def _close(
    theta: Array, crank: float, coupler: float, offset: float, mode: int
) -> tuple[Array, Array, Array]:
    """Crank pin and horizontal run of the coupler, or ValueError where it misses the guide."""
    for name, value, least in (
        ("crank", crank, 0.0),
        ("coupler", coupler, 0.0),
        ("offset", offset, -np.inf),
    ):
        if not least < value < np.inf:
            raise ValueError(f"{name} must be finite and above {least} [m], got {value}")
    if mode not in MODES:
        raise ValueError(f"mode must be one of {MODES}, got {mode}")
    px, py = crank * np.cos(theta), crank * np.sin(theta)
    rise, gap = offset - py, np.abs(offset - py) - coupler
    slack = 1e-15 * (crank + coupler + abs(offset))  # rounding of gap
    if not gap.max(initial=0.0) <= slack:
        bad = np.unravel_index(np.argmin(gap <= slack), gap.shape)
        raise ValueError(
            f"loop cannot close at angle {theta[bad]:.9g} rad: the coupler misses "
            f"the guide by {gap[bad]:.6g} m"
        )
    return px, py, -mode * np.sqrt(np.maximum((coupler + rise) * (coupler - rise), 0.0))


def turn_time(peak: float = 5.0) -> float:
    """Duration T [s] of the motor's run-up, in which it makes one turn: peak T^2/3 = 2 pi.

    `peak` is the largest crank acceleration [rad/s^2]; ValueError unless it is positive.
    >>> round(turn_time(), 3)
    1.942
    """
    if not 0.0 < peak < np.inf:
        raise ValueError(f"peak must be a positive finite acceleration [rad/s^2], got {peak}")
    return float(np.sqrt(6.0 * np.pi / peak))


def motor(time: ArrayLike, *, peak: float = 5.0) -> tuple[Array, Array, Array]:
    r"""Crank motion of the report's motor: smooth run-up over one turn, then constant speed.

    ::

        peak       ________
                  /        \           acceleration over time, T = turn_time(peak)
           0   __/          \_________
                 0  T/3  2T/3  T

    `time` [s] (...), not negative; returns the crank angle [rad], rate [rad/s] and acceleration
    [rad/s^2], each (...). The final rate is 2 peak T/3. ValueError for a negative or NaN time.
    Source: power hacksaw report, Universidad Nacional de Colombia, text lines 206-253. Departure:
    line 222 prints a final rate of 6.45 rad/s; 2 peak T/3 is 6.472 rad/s, its 62 turns/min.
    >>> [round(float(value), 3) for value in motor(turn_time())]
    [6.283, 6.472, 0.0]
    """
    t, total = np.asarray(time, float), turn_time(peak)
    if not np.all(t >= 0.0):
        raise ValueError("time must not be negative [s]")
    third, cruise = total / 3.0, np.maximum(t - total, 0.0)
    rise, hold, fall = (np.clip(t - k * third, 0.0, third) for k in range(3))  # time in each part
    jerk = peak / third
    angle = jerk * (rise**3 - fall**3) / 6.0 + peak * (
        (hold**2 + fall**2) / 2.0 + third * (0.5 * hold + 1.5 * fall + 2.0 * cruise)
    )
    rate = jerk * (rise**2 - fall**2) / 2.0 + peak * (hold + fall)
    return np.asarray(angle), np.asarray(rate), np.asarray(jerk * (rise - fall))
