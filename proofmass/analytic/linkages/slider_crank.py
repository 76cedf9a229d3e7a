"""Slider-crank on a straight guide of any inclination: motion, moment and forces, dead points."""

from collections.abc import Collection
from math import fsum
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike

from proofmass.analytic.linkages.bars import (
    FORCE_ENDINGS,
    LOAD_ENDINGS,
    drive_moment,
    is_requested,
    pin_load,
    select_positions,
)
from proofmass.analytic.numerics import (
    broadcast_loads,
    broadcast_motion,
    check_not_negative,
    check_number,
    check_one_of,
    check_positive,
    components_in_frame,
    dot,
    motion_senses,
    root_derivatives,
    rounding_of_sum,
    smooth_root,
    unwrap_angles,
)
from proofmass.analytic.protocol import (
    Acceleration,
    Angle,
    ClosedForm,
    Domain,
    Length,
    Mass,
    Mode,
    OwnError,
    Position,
    Quantity,
    VaryingForce,
)
from proofmass.base.arrays import Array, Complex

MODES = (1, -1)


def solve(
    angle: ArrayLike,
    rate: ArrayLike = 1.0,
    acceleration: ArrayLike = 0.0,
    *,
    crank: float,
    coupler: float,
    guide_x: float = 0.0,
    guide_y: float = 0.0,
    guide_angle: float = 0.0,
    mode: int = 1,
    point_along: float = 0.0,
    point_across: float = 0.0,
    crank_mass: float = 0.0,
    coupler_mass: float = 0.0,
    slider_mass: float = 0.0,
    slider_load: ArrayLike = 0.0,
    gravity: float = 9.81,
    crank_friction: float = 0.0,
    pin_friction: float = 0.0,
    slider_friction: float = 0.0,
    inertia: bool = False,
    only: Collection[str] | None = None,
) -> dict[str, Array]:
    r"""Motion of a slider-crank whose crank motion is given.

    ::

                            _--   guide through G at guide_angle g
                        _[S]      slide s = G-S along u = (cos g, sin g)
          coupler  __--_--
              __---  _--          A = (0, 0) fixed
           P--     G-             A-P crank r, driven
          /      _--              P-S coupler c; X any point of the coupler
         A

    In the frame of the guide, the crank is at f = angle - g, the axis A at a distance e (offset) to
    the right of the guide, and start = G . u. The coupler is the vector (q, -h)::

        h = r sin(f) - e,   q = mode sqrt((c - h)(c + h)),   s = r cos(f) + q - start
        c - h = (c + e - r) + 2 r sin^2(pi/4 - f/2),  c + h = (c - e - r) + 2 r cos^2(pi/4 - f/2)

    The derivative of the coupler angle by the crank angle is k1 = -r cos(f)/q; with k2 = dk1/df::

        ds/df = -r sin(f) + h k1,   d2s/df2 = -r cos(f) + h k2 - q k1^2

    A linkage with coupler = crank + |offset| has a change point, where the coupler is perpendicular
    to the guide. One of c - h and c + h is zero there, and its root is taken as
    sqrt(2 r) sin(pi/4 - f/2), or cos, which changes its sign. The motion thus continues smoothly,
    as inertia makes it, with finite rates; a branch of an offset linkage then closes after two
    turns.

    The moment that holds the crank at rest is gravity * sum(mass * dy/dangle) over the mid-lengths
    of the bars and the slider, less slider_load * ds/dangle. With inertia, the power of mass times
    acceleration at a unit crank rate is added. Weight and inertia of the coupler a need the moment
    m1 about P. The pin at S gives the coupler the force R, whose part along the guide's
    direction u follows from the balance of the slider::

        R = ((R . u) a + m1 J u)/q

    Dry friction acts against the rotation of the crank, the rotation of the coupler relative to
    the crank, and the motion of the slider. It adds crank_friction + pin_friction |k1 - 1| +
    slider_friction |ds/dangle| to the moment, in the sense of the crank. Where a joint is at rest,
    its friction is what it was before.

    Parameters
    ----------
    angle, rate, acceleration : crank angle [rad], its first [rad/s] and second [rad/s^2] time
        derivative, (...) broadcast together; the last axis is the sweep
    crank, coupler : lengths between pins [m]
    guide_x, guide_y : point G of the guide [m], from which the slide is measured
    guide_angle : direction of the guide [rad]
    mode : +1 slider ahead of the crank pin along the guide (q > 0); -1 behind it. With a change
        point: the sign of q where the crank points along the guide, f = 0.
    point_along, point_across : X in the coupler's frame [m]: from P towards S, and left of that
    crank_mass, coupler_mass, slider_mass : uniform bars and slider [kg]
    slider_load : force on the slider along the guide [N], a constant or (...)
    gravity : along -y [m/s^2]
    crank_friction, pin_friction : dry friction of the crank's bearing and of the pin between crank
        and coupler [N m]
    slider_friction : dry friction of the guide [N]
    inertia : whether moment and forces include those of the accelerations
    only : names of all requested quantities; None requests all. Moment and forces, which take
        longer than the motion, are computed only if one of them is requested; if only positions and
        angles are requested, nothing else is computed

    Returns
    -------
    dict of (...) arrays: slide [m], slide_rate, slide_acceleration; slider_x, slider_y [m],
    slider_vx, slider_vy, slider_ax, slider_ay, and point_x, ... of X; coupler_angle [rad] from P to
    S, coupler_rate, coupler_acceleration; transmission_angle [rad] in [0, pi], between the coupler
    and the guide's normal, which is the rocker of a four-bar in the limit of infinite length: pi/2
    is best;
    holding_moment [N m] of the crank's drive; forces [N] in the frame of a bar, or of the guide,
    _x along it and _y to the left: crank_force_x, crank_force_y of the ground on the crank,
    coupler_force_.. of the crank on the coupler, pin_force_.. of the coupler on the slider, in the
    coupler's frame, and guide_force_.. of guide and load on the slider. coupler_angle starts in
    [-pi, pi] and is unwrapped along the last axis.

    Raises
    ------
    ValueError
        A length not positive, a mass negative, a value not finite, a mode unknown, or a coupler
        too short: the message gives the first angle at which it misses the guide, and by how much.

    Notes
    -----
    Loop residual below 1e-14 of the lengths. Rates are not finite where the coupler is
    perpendicular to the guide (q = 0), except at change points; next to it they lose digits like
    1/q^2. Source: loop and example of B. Díaz Lozano, TFG, Universidad de Almería 2019, text lines
    2983-3413, solved there by Newton-Raphson. Its velocities (text line 3269) have the wrong sign,
    and the crank angle was overwritten with zero before they were printed; its accelerations belong
    to +1 rad/s^2 and not to the -1 that is printed with them (text line 3337).

    Examples
    --------
    >>> pose = solve(0.5, crank=1.0, coupler=2.0)
    >>> [round(float(pose[name]), 8) for name in ("slide", "slide_rate", "slide_acceleration")]
    [2.81927027, -0.696111, -1.18002816]
    """
    masses = {"crank_mass": crank_mass, "coupler_mass": coupler_mass, "slider_mass": slider_mass}
    frictions = {
        "crank_friction": crank_friction,
        "pin_friction": pin_friction,
        "slider_friction": slider_friction,
    }
    check_positive(crank=crank, coupler=coupler)
    check_not_negative(**masses)
    check_not_negative("N m or N", **frictions)
    check_number(gravity=gravity, point_along=point_along, point_across=point_across)
    check_one_of(MODES, mode=mode)
    start, offset = _guide_position(guide_x, guide_y, guide_angle)
    rounding = rounding_of_sum(crank, coupler, start, offset)
    inputs = broadcast_motion(angle=angle, rate=rate, acceleration=acceleration)
    theta, w, dw = (np.atleast_1d(v) for v in inputs)
    (on_slider,) = broadcast_loads(theta.shape, slider_load=slider_load)
    cos, sin = np.cos(guide_angle), np.sin(guide_angle)
    crank_along, crank_across = (
        crank * np.cos(theta - guide_angle),
        crank * np.sin(theta - guide_angle),
    )
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):  # across: as documented
        q, roots = _close_loop(theta, guide_angle, crank, coupler, offset, mode, rounding)
        h = crank_across - offset
        s, ax, ay = crank_along + q - start, q * cos + h * sin, q * sin - h * cos
        pin = np.asarray(crank * np.exp(1j * theta), complex)
        arm = np.asarray((point_along + 1j * point_across) / coupler * (ax + 1j * ay), complex)
        places = select_positions(
            only,
            {
                "slide": lambda: s,
                "slider_x": lambda: guide_x + s * cos,
                "slider_y": lambda: guide_y + s * sin,
                "point_x": lambda: (pin + arm).real,
                "point_y": lambda: (pin + arm).imag,
                "coupler_angle": lambda: unwrap_angles(np.arctan2(ay, ax)),
                "transmission_angle": lambda: np.arctan2(np.abs(q), -h),
            },
        )
        if places is not None:
            return {name: curve.reshape(inputs[0].shape) for name, curve in places.items()}
        k1, k2 = _coupler_derivatives(roots, mode)
        s1, s2 = h * k1 - crank_across, h * k2 - q * k1**2 - crank_along
        v, a = s1 * w, s1 * dw + s2 * w**2
        loads: dict[str, Array] = {}
        if is_requested(only, *LOAD_ENDINGS):
            of_crank, of_pin, of_slider = (
                value * motion_senses(rate, float(np.abs(w).max(initial=0.0)))
                for value, rate in zip(frictions.values(), (w, (k1 - 1.0) * w, v), strict=True)
            )
            slider_force = on_slider - of_slider
            guide = complex(cos, sin)
            bars = pin, np.asarray(ax + 1j * ay, complex)
            at_p = at_s = lift = np.full_like(bars[0], 1j * gravity)
            if inertia:
                at_p, at_s = lift + (1j * dw - w**2) * bars[0], lift + guide * a
            p1, slider_velocity = 1j * bars[0], np.asarray(guide * s1)
            loads = {
                "holding_moment": drive_moment(crank_mass, (lift, at_p), (0j, p1))
                + drive_moment(coupler_mass, (at_p, at_s), (p1, slider_velocity))
                + slider_mass * dot(at_s, slider_velocity)
                - slider_force * s1
                + of_crank
                + of_pin * (k1 - 1.0)
            }
            if is_requested(only, *FORCE_ENDINGS):
                loads |= _forces(
                    bars, (lift, at_p, at_s), q, guide, (slider_force, of_pin), **masses
                )
        curves = {
            "slide": s,
            "slide_rate": v,
            "slide_acceleration": a,
            "slider_x": guide_x + s * cos,
            "slider_y": guide_y + s * sin,
            "slider_vx": v * cos,
            "slider_vy": v * sin,
            "slider_ax": a * cos,
            "slider_ay": a * sin,
            **_point_motion((pin, w, dw), (arm, k1 * w, k1 * dw + k2 * w**2)),
            "coupler_angle": unwrap_angles(np.arctan2(ay, ax)),
            "coupler_rate": k1 * w,
            "coupler_acceleration": k1 * dw + k2 * w**2,
            "transmission_angle": np.arctan2(np.abs(q), -h),
            **loads,
        }
    return {name: curve.reshape(inputs[0].shape) for name, curve in curves.items()}


def _point_motion(*arms: tuple[Complex, Array, Array]) -> dict[str, Array]:
    """Position, velocity and acceleration at the end of a chain of arms from the origin.

    An arm is its vector and the derivatives of its angle.
    """
    place = sum(arm for arm, _, _ in arms)
    velocity = sum(1j * w * arm for arm, w, _ in arms)
    acceleration = sum((1j * dw - w**2) * arm for arm, w, dw in arms)
    return {
        f"point_{letters}{axis}": np.asarray(part, float)
        for letters, curve in (("", place), ("v", velocity), ("a", acceleration))
        for axis, part in (("x", np.real(curve)), ("y", np.imag(curve)))
    }


def _forces(
    bars: tuple[Complex, Complex],
    accelerations: tuple[Complex, Complex, Complex],
    q: Array,
    guide: complex,
    loads: tuple[Array, Array],
    *,
    crank_mass: float,
    coupler_mass: float,
    slider_mass: float,
) -> dict[str, Array]:
    """Forces of pins and guide; `guide` is its direction.

    `accelerations` are those of A, P and S less that of gravity. `loads` are the force on the
    slider along the guide, and the moment of friction of the pin P, against the rotation of the
    coupler relative to the crank.
    """
    crank, coupler = bars
    at_a, at_p, at_s = accelerations
    f0, _ = pin_load(crank_mass, crank, (at_a, at_p))
    f1, m1 = pin_load(coupler_mass, coupler, (at_p, at_s))
    m1 = m1 + loads[1]
    slider = np.asarray(slider_mass * at_s, complex)
    force_along = loads[0] - dot(slider, guide)
    on_coupler = np.asarray((force_along * coupler + 1j * guide * m1) / q, complex)
    return {
        **components_in_frame("crank_force", f0 + f1 - on_coupler, crank),
        **components_in_frame("coupler_force", f1 - on_coupler, coupler),
        **components_in_frame("pin_force", -on_coupler, coupler),
        **components_in_frame("guide_force", slider + on_coupler, guide),
    }


def dead_points(
    *,
    crank: float,
    coupler: float,
    guide_x: float = 0.0,
    guide_y: float = 0.0,
    guide_angle: float = 0.0,
    mode: int = 1,
) -> tuple[Array, Array]:
    r"""Crank angles [rad] and slides [m], each (2,), at which crank and coupler are in line.

    First stretched, then folded; the slider reverses there, and the difference of the slides is the
    stroke. With r = crank, c = coupler, e = offset and f the crank angle from the guide's
    direction, mode +1 has::

        stretched  f = asin(e/(c + r)),       slide = (c + r) sqrt(1 - e^2/(c + r)^2) - start
        folded     f = pi + asin(e/(c - r)),  slide = (c - r) sqrt(1 - e^2/(c - r)^2) - start

    and mode -1 has pi - f and the other sign of the roots. ValueError for bad lengths as in
    `solve`, and where the folded linkage does not reach the guide, |c - r| < |e|, or puts the
    slider on the crank axis, c = r. Source: the triangle of A, S and the foot of A on the guide.

    >>> angles, slides = dead_points(crank=1.0, coupler=2.0)
    >>> [round(float(x), 6) for x in (*angles, *slides)]
    [0.0, 3.141593, 3.0, 1.0]
    """
    check_positive(crank=crank, coupler=coupler)
    check_one_of(MODES, mode=mode)
    start, offset = _guide_position(guide_x, guide_y, guide_angle)
    reach = np.array([coupler + crank, coupler - crank])
    if reach[1] == 0.0 or abs(offset) > abs(reach[1]) + rounding_of_sum(
        crank, coupler, start, offset
    ):
        raise ValueError(
            f"no folded dead point: the slider would be {abs(reach[1]):.6g} m from "
            f"the crank axis, the guide is {abs(offset):.6g} m from it"
        )
    sine = np.clip(offset / reach, -1.0, 1.0)
    angle, run = np.array([0.0, np.pi]) + np.arcsin(sine), reach * np.sqrt(1.0 - sine**2)
    return guide_angle + (angle if mode > 0 else np.pi - angle), mode * run - start


def properties(
    *,
    crank: float,
    coupler: float,
    guide_x: float = 0.0,
    guide_y: float = 0.0,
    guide_angle: float = 0.0,
    mode: int = 1,
    **_: float,
) -> dict[str, str]:
    """Stroke and dead points in words and degrees, for a report.

    >>> properties(crank=1.0, coupler=2.0)["stroke"]
    '2 m'
    """
    angles, slides = dead_points(
        crank=crank,
        coupler=coupler,
        guide_x=guide_x,
        guide_y=guide_y,
        guide_angle=guide_angle,
        mode=mode,
    )
    first, second = np.degrees(angles)
    return {
        "stroke": f"{abs(slides[0] - slides[1]):.6g} m",
        "dead points": f"crank at {first:.2f}° and {second:.2f}°",
    }


def _guide_position(x: float, y: float, angle: float) -> tuple[float, float]:
    """Position of G along the guide from the foot of A; offset of the guide to the left of A."""
    check_number(guide_x=x, guide_y=y, guide_angle=angle)
    return (
        float(x * np.cos(angle) + y * np.sin(angle)),
        float(y * np.cos(angle) - x * np.sin(angle)),
    )


def _close_loop(
    theta: Array,
    guide_angle: float,
    crank: float,
    coupler: float,
    offset: float,
    mode: int,
    rounding: float,
) -> tuple[Array, list[tuple[float, Array, Array]]]:
    """The component q of the coupler along the guide; ValueError if the coupler misses the guide.

    q is mode times the product of the roots of c - h and c + h. Each root is returned behind its
    margin and its wave, see `smooth_root`.
    """
    half = np.pi / 4.0 - (theta - guide_angle) / 2.0
    swings = np.sqrt(2.0 * crank) * np.sin(half), np.sqrt(2.0 * crank) * np.cos(half)
    # sums rounded once: the coupler may nearly be perpendicular to the guide
    margins = fsum((coupler, offset, -crank)), fsum((coupler, -offset, -crank))
    squares = [m + x * x for m, x in zip(margins, swings, strict=True)]
    if not all(-square.min(initial=0.0) <= rounding for square in squares):
        distance = -np.minimum(*squares)
        bad = np.unravel_index(np.argmin(distance <= rounding), distance.shape)
        raise ValueError(
            f"loop cannot close at angle {theta[bad]:.9g} rad: the coupler misses "
            f"the guide by {distance[bad]:.6g} m"
        )
    roots = [
        (margin, swing, smooth_root(margin, swing))
        for margin, swing in zip(
            (m if abs(m) > rounding else 0.0 for m in margins), swings, strict=True
        )
    ]
    return mode * roots[0][2] * roots[1][2], roots


def _coupler_derivatives(roots: list[tuple[float, Array, Array]], mode: int) -> tuple[Array, Array]:
    """First two derivatives k1, k2 of the coupler angle by the crank angle."""
    (_, one, _), (_, two, _) = roots
    (slope1, bend1), (slope2, bend2) = (root_derivatives(*each) for each in roots)
    bend = 0.5 * (two * slope2 * bend1 - one * slope1 * bend2)
    return -mode * slope1 * slope2, mode * bend


class SliderCrank(ClosedForm, function=solve, properties=properties):
    """Slider-crank on a guide of any inclination: motion, moment and forces, dead points."""

    own_error = OwnError(1e-12, "the general planar solver, for random lengths")
    covers_inertia = True
    selects = True

    crank: Length
    coupler: Length
    guide_x: Position
    guide_y: Position
    guide_angle: Angle
    mode: Mode
    point_along: Position
    point_across: Position
    crank_mass: Mass
    coupler_mass: Mass
    slider_mass: Mass
    slider_load: VaryingForce
    gravity: Acceleration
    crank_friction: Annotated[float, Quantity("N m", Domain.NOT_NEGATIVE)]
    pin_friction: Annotated[float, Quantity("N m", Domain.NOT_NEGATIVE)]
    slider_friction: Annotated[float, Quantity("N", Domain.NOT_NEGATIVE)]
