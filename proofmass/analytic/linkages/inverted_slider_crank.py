"""Inverted slider-crank with two inputs: a rod on a crank slides through the tip of a driven bar.

`swinging_block` has the classic form, in which the slider turns about a fixed pivot.
"""

from collections.abc import Collection
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike

from proofmass.analytic.linkages.bars import (
    FORCE_ENDINGS,
    LOAD_ENDINGS,
    drive_moment,
    is_requested,
    pin_load,
)
from proofmass.analytic.numerics import (
    broadcast_motion,
    check_not_negative,
    check_number,
    check_one_of,
    check_positive,
    components_in_frame,
    dot,
    rounding_of_sum,
    unwrap_angles,
)
from proofmass.analytic.protocol import (
    Acceleration,
    ClosedForm,
    Domain,
    Length,
    Mass,
    Mode,
    MomentOfInertia,
    OwnError,
    Position,
    Quantity,
)
from proofmass.base.arrays import Array, Complex

MODES = (1, -1)


def solve(
    angle: ArrayLike,
    rate: ArrayLike = 1.0,
    acceleration: ArrayLike = 0.0,
    *,
    crank: float,
    bar: float,
    rod: float,
    ground_x: float,
    ground_y: float = 0.0,
    mode: int = 1,
    crank_mass: float = 0.0,
    bar_mass: float = 0.0,
    rod_mass: float = 0.0,
    slider_mass: float = 0.0,
    slider_inertia: float = 0.0,
    gravity: float = 9.81,
    inertia: bool = False,
    only: Collection[str] | None = None,
) -> dict[str, Array]:
    r"""Motion of an inverted slider-crank whose crank and bar motions are given.

    ::

               P --__   slide s
              /      --[S]__            A = (0, 0) and B = (ground_x, ground_y) are fixed
             / crank   /    --__ E      A-P crank at angle a1, driven
            /         / bar             B-S bar at angle a2, driven
           A         B                  P-E rod, through a slider pinned to the bar's tip S

    In the complex plane P = crank e^(i a1) and S = B + bar e^(i a2). The unit vector u is the
    rod's direction, and D = S - P is parallel to it. Divided by u, the derivatives of D = s u have
    a real part, along the rod, and an imaginary part, across it; w and dw are the rod's rate and
    acceleration::

        u = mode D/|D|,   s = mode |D|,   E = P + rod u
        D'/u = s' + i s w,   D''/u = (s'' - s w^2) + i (s dw + 2 s' w)

    The moments that hold crank and bar at rest are gravity * sum(mass * dy/dangle) over the
    mid-lengths of crank, bar and rod and over the slider. With inertia, the power of mass times
    acceleration at a unit rate of that drive alone is added. Weight and inertia of the rod need the
    moment m about P. The rod gives the slider a force N across the rod and the moment
    slider_inertia dw, which turns the slider with the rod::

        N = -(m + slider_inertia dw)/s i u

    The forces of the pins follow from the balance of forces.

    Parameters
    ----------
    angle, rate, acceleration : angles of crank and bar [rad], first [rad/s] and second [rad/s^2]
        time derivatives, (2, ...): the first axis is crank, bar, the last one after it the sweep. A
        scalar rate or acceleration holds for both, one of shape (2,) for all samples.
    crank, bar, rod : lengths [m]; with bar = 0 the slider turns about B
    ground_x, ground_y : fixed pivot B of the bar [m]
    mode : +1 the rod points from the crank pin to the slider, s > 0; -1 away from it, s < 0, and
        the slider sits on the rod's extension behind the pin
    crank_mass, bar_mass, rod_mass, slider_mass : uniform bars and slider [kg]
    slider_inertia : moment of inertia of the slider, which turns with the rod, about S [kg m^2]
    gravity : along -y [m/s^2]
    inertia : whether moments and forces include those of the accelerations
    only : names of all requested quantities; None requests all. Moments and forces, which take
        longer than the motion, are computed only if one of them is requested

    Returns
    -------
    dict of (...) arrays: slide [m] from P to S along the rod, slide_rate, slide_acceleration;
    rod_angle [rad], rod_rate, rod_acceleration; end_x, end_y [m], end_vx, end_vy, end_ax,
    end_ay of E; slider_x, slider_y and the same of S; slide_margin [m], the slider's distance from
    the nearer end of the rod, negative where it has left the rod (see `off_rod_intervals`);
    holding_moment of the crank and holding_moment_bar [N m]; forces of pins [N] in the frame of a
    bar, _x along it and _y to the left: crank_force_x, crank_force_y of the ground on the crank,
    bar_force_.. of the ground on the bar, rod_force_.. of the crank on the rod, and, in the rod's
    frame, guide_force_.. of the rod on the slider at S, whose _x is zero, with guide_moment [N m]
    about S, and pin_force_.. of the slider on the bar. rod_angle starts in [-pi, pi] and is
    unwrapped, which needs steps below pi between samples.

    Raises
    ------
    ValueError
        A length not positive (bar: negative), a mass negative, a value not finite, a mode unknown,
        inputs that are not two, or a pose in which the crank pin meets the slider, so that the rod
        has no direction: the message gives the first such angles.

    Notes
    -----
    The slider may leave the rod: the equations hold there too, but such a linkage cannot be built.
    Loop residual below 1e-14 of the lengths; rates lose digits like 1/s. Source: loop and example
    of B. Díaz Lozano, TFG, Universidad de Almería 2019, text lines 3415-3758, solved there by
    Newton-Raphson. The accelerations of E printed there (text line 3733) are wrong for any input:
    their right-hand side has a product in place of a difference (text line 3704) and a wrong
    collinearity row (text line 3706); those of P and S, labelled +1 rad/s^2, are those of
    -1 rad/s^2. The slider of its animation, a2 = 2 a1, is off the rod for 41 % of the turn.

    Examples
    --------
    >>> pose = solve([0.5, 0.8], [1.0, 2.0], crank=2.0, bar=1.0, rod=3.0, ground_x=2.0)
    >>> [round(float(pose[name]), 8) for name in ("end_x", "end_y", "end_vx", "end_vy")]
    [4.66110172, 0.21351053, -1.31819903, 0.35413793]
    """
    masses = {
        "crank_mass": crank_mass,
        "bar_mass": bar_mass,
        "rod_mass": rod_mass,
        "slider_mass": slider_mass,
    }
    check_positive(crank=crank, rod=rod)
    check_not_negative(**masses, slider_inertia=slider_inertia)
    check_not_negative("m", bar=bar)
    check_number(ground_x=ground_x, ground_y=ground_y, gravity=gravity)
    check_one_of(MODES, mode=mode)
    inputs = broadcast_motion(2, angle=angle, rate=rate, acceleration=acceleration)
    (a1, a2), (w1, w2), (dw1, dw2) = (x.reshape(2, -1) for x in inputs)
    pin, tip = _arm(crank, a1, w1, dw1), _arm(bar, a2, w2, dw2)
    ground = complex(ground_x, ground_y)
    slider = ground + tip[0], tip[1], tip[2]
    separation = [b - a for a, b in zip(pin, slider, strict=True)]
    u = mode * _rod_direction(separation[0], rounding_of_sum(crank, bar, abs(ground)), a1, a2)
    s, (slip, slip2) = mode * np.abs(separation[0]), (d / u for d in separation[1:])
    v, w = slip.real, slip.imag / s
    angles = np.atleast_1d(np.angle(u).reshape(inputs[0].shape[1:]))
    rod_angle, dw = unwrap_angles(angles).ravel(), (slip2.imag - 2.0 * v * w) / s
    end = [a + b for a, b in zip(pin, _arm(rod, rod_angle, w, dw), strict=True)]
    loads: dict[str, Array] = {}
    if is_requested(only, *LOAD_ENDINGS, "_moment_bar"):
        rod_rates = (-1j * pin[0] / u).imag / s, (1j * tip[0] / u).imag / s
        lift = 1j * gravity
        at_p, at_s, at_e = (inertia * point[2] + lift for point in (pin, slider, end))
        slider_moment = inertia * slider_inertia * dw
        p1, s1 = 1j * pin[0], 1j * tip[0]
        by_crank, by_bar = (1j * turn * rod * u for turn in rod_rates)
        loads = {
            "holding_moment": drive_moment(crank_mass, (lift, at_p), (0j, p1))
            + drive_moment(rod_mass, (at_p, at_e), (p1, p1 + by_crank))
            + slider_moment * rod_rates[0],
            "holding_moment_bar": drive_moment(bar_mass, (lift, at_s), (0j, s1))
            + drive_moment(rod_mass, (at_p, at_e), (0j, by_bar))
            + slider_mass * dot(at_s, s1)
            + slider_moment * rod_rates[1],
        }
        if is_requested(only, *FORCE_ENDINGS, "guide_moment"):
            loads |= _forces(
                (np.exp(1j * a1), np.exp(1j * a2), u),
                (crank, bar, rod),
                s,
                (at_p, at_s, at_e),
                slider_moment,
                lift,
                **masses,
            )
    curves = {
        "slide": s,
        "slide_rate": v,
        "slide_acceleration": slip2.real + s * w**2,
        "rod_angle": rod_angle,
        "rod_rate": w,
        "rod_acceleration": dw,
        "slide_margin": np.minimum(s, rod - s),
        **loads,
    }
    for name, point in (("end", end), ("slider", slider)):
        for part, value in zip(("", "v", "a"), point, strict=True):
            curves |= {f"{name}_{part}x": value.real, f"{name}_{part}y": value.imag}
    return {name: curve.reshape(inputs[0].shape[1:]) for name, curve in curves.items()}


def _forces(
    directions: tuple[Complex, Complex, Complex],
    lengths: tuple[float, float, float],
    slide: Array,
    accelerations: tuple[Complex, Complex, Complex],
    slider_moment: Array,
    lift: complex,
    *,
    crank_mass: float,
    bar_mass: float,
    rod_mass: float,
    slider_mass: float,
) -> dict[str, Array]:
    """Forces of pins and guide, from directions and lengths of crank, bar and rod.

    `accelerations` are those of P, S and E less that of gravity, which is -`lift`. The rod gives
    the slider the moment `slider_moment`.
    """
    crank, bar, rod = (a * b for a, b in zip(directions, lengths, strict=True))
    at_p, at_s, at_e = accelerations
    f0, _ = pin_load(crank_mass, crank, (lift, at_p))
    f1, m1 = pin_load(rod_mass, rod, (at_p, at_e))
    f2, _ = pin_load(bar_mass, bar, (lift, at_s))
    across = -(m1 + slider_moment) / slide
    on_slider = 1j * across * directions[2]
    on_rod, on_bar = f1 + on_slider, np.asarray(on_slider - slider_mass * at_s)
    return {
        **components_in_frame("crank_force", f0 + on_rod, directions[0]),
        **components_in_frame("bar_force", f2 - on_bar, directions[1]),
        **components_in_frame("rod_force", on_rod, directions[2]),
        "guide_force_x": np.zeros_like(across),
        "guide_force_y": across,
        "guide_moment": slider_moment,
        **components_in_frame("pin_force", on_bar, directions[2]),
    }


def off_rod_intervals(x: ArrayLike, slide_margin: ArrayLike) -> Array:
    r"""Intervals of x, (k, 2), in which the slider has left the rod.

    `x` (n,) rises; `slide_margin` (n,) is the curve of `solve`. The ends of an interval, zeros of
    the margin, are interpolated linearly, with an error of step^2/8 times the ratio of the margin's
    second derivative to its first; an interval shorter than a step can be missed.

    >>> angle = np.linspace(0.0, 2.0 * np.pi, 100001)
    >>> pose = solve([angle, 2.0 * angle], crank=2.0, bar=1.0, rod=3.0, ground_x=2.0)
    >>> off_rod_intervals(angle, pose["slide_margin"]).round(6)
    array([[1.855399, 4.427786]])
    """
    x, margin = broadcast_motion(x=x, slide_margin=slide_margin)
    is_off = margin < 0.0
    last = np.flatnonzero(is_off[1:] != is_off[:-1])
    share = margin[last] / (margin[last] - margin[last + 1])
    ends = x[last] + share * (x[last + 1] - x[last])
    return np.concatenate([x[:1][is_off[:1]], ends, x[-1:][is_off[-1:]]]).reshape(-1, 2)


def _arm(length: float, angle: Array, rate: Array, acceleration: Array) -> tuple[Complex, ...]:
    """Complex vector of a turning arm, velocity and acceleration of its end."""
    arm = length * np.exp(1j * angle)
    return arm, 1j * rate * arm, (1j * acceleration - rate**2) * arm


def _rod_direction(separation: Complex, rounding: float, a1: Array, a2: Array) -> Complex:
    """Unit vectors along the rod, from its ends' separation D; ValueError where D vanishes."""
    distance = np.abs(separation)
    if not distance.min(initial=np.inf) > rounding:
        bad = np.argmin(distance > rounding)
        raise ValueError(
            f"the crank pin meets the slider at crank angle {a1[bad]:.9g} rad and bar "
            f"angle {a2[bad]:.9g} rad: the rod has no direction"
        )
    return separation / distance


class InvertedSliderCrank(ClosedForm, function=solve):
    """Inverted slider-crank: a rod on a driven crank slides through the tip of a driven bar."""

    own_error = OwnError(1e-12, "the general planar solver, for random lengths")
    covers_inertia = True
    selects = True

    crank: Length
    bar: Annotated[float, Quantity("m", Domain.NOT_NEGATIVE)]
    rod: Length
    ground_x: Position
    ground_y: Position
    mode: Mode
    crank_mass: Mass
    bar_mass: Mass
    rod_mass: Mass
    slider_mass: Mass
    slider_inertia: MomentOfInertia
    gravity: Acceleration
