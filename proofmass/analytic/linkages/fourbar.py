"""Planar four-bar linkage: motion, coupler curve, moments and forces.

Further functions give what follows from the lengths alone: Grashof class, crank range, dead centres
and range of the transmission angle.
"""

from collections.abc import Callable, Collection
from functools import reduce
from math import fsum

import numpy as np
from numpy.typing import ArrayLike

from proofmass.analytic.linkages.bars import (
    FORCE_ENDINGS,
    LOAD_ENDINGS,
    Ends,
    drive_moment,
    is_requested,
    pin_load,
    select_positions,
)
from proofmass.analytic.numerics import (
    TURN,
    broadcast_loads,
    broadcast_motion,
    check_not_negative,
    check_number,
    check_one_of,
    check_positive,
    components_in_frame,
    root_derivatives,
    rounding_of_sum,
    smooth_root,
    unwrap_angles,
)
from proofmass.analytic.protocol import (
    Acceleration,
    Angle,
    ClosedForm,
    Length,
    Mass,
    Mode,
    OwnError,
    Position,
    VaryingMoment,
)
from proofmass.base.arrays import Array, Complex

Pair = tuple[Array, Array]
"""Components of a vector, or two derivatives."""
WithDerivatives = tuple[Array, Array, Array]
"""A value and its first two derivatives by the crank angle."""
MODES = (1, -1)


def solve(
    angle: ArrayLike,
    rate: ArrayLike = 1.0,
    acceleration: ArrayLike = 0.0,
    *,
    crank: float,
    coupler: float,
    rocker: float,
    ground: float,
    ground_angle: float = 0.0,
    mode: int = 1,
    point_along: float = 0.0,
    point_across: float = 0.0,
    crank_mass: float = 0.0,
    coupler_mass: float = 0.0,
    rocker_mass: float = 0.0,
    rocker_load: ArrayLike = 0.0,
    gravity: float = 9.81,
    inertia: bool = False,
    only: Collection[str] | None = None,
) -> dict[str, Array]:
    r"""Motion of a four-bar linkage whose crank motion is given.

    ::

              X     Q         A = (0, 0) and B, ground from A at ground_angle, are fixed
             a  /     \  b    A-P crank, vector p, driven
             /         \      P-Q coupler, vector a; X any point of the coupler
           P            \     B-Q rocker, vector b
        A --------------- B   d = B - P, D = d . d

    Q is where the circle of radius c = coupler about P meets that of r = rocker about B. With J
    the turn by +90 degrees and C = a x b (twice the area of triangle P-Q-B, signed)::

        C = mode/2 sqrt((c + r)^2 - D) sqrt(D - (c - r)^2)
        a = (x d + C J d)/D, x = (D + c^2 - r^2)/2;  b = (y d + C J d)/D, y = x - D

    With ' the derivative by the crank angle and d x d' = (D + crank^2 - ground^2)/2, the first and
    second derivatives of the coupler angle, a1 and a2, and of the rocker angle, b1 and b2, are::

        a1 = ((x C' - C x')/c^2 + d x d')/D,  a2 = ((x C'' - C x'')/c^2 + D'/2 - a1 D')/D
        b1 = ((y C' - C y')/r^2 + d x d')/D,  b2 = ((y C'' - C y'')/r^2 + D'/2 - b1 D')/D

    The moment that holds the crank at rest is gravity * sum(mass * dy/dangle) over the three
    mid-lengths (uniform bars, gravity along -y), less rocker_load * b1. With inertia, the power
    of the bars' mass times acceleration at a unit crank rate is added. Weight and inertia of the
    coupler need the moment m1 about P, those of the rocker m2 about B. The pin at Q applies the
    force R to the coupler and -R to the rocker, with a x R = m1 and -b x R + rocker_load = m2::

        R = (m1 b + (m2 - rocker_load) a)/C

    The forces of the other three pins follow from the balance of forces.

    A linkage whose shortest and longest lengths have the same sum as the other two has a **change
    point**, where all four bars are in line and the two modes meet. One of the roots,
    sqrt(k^2 cos^2(f/2)) for crank + ground = coupler + rocker or sqrt(k^2 sin^2(f/2)) for
    |crank - ground| = |coupler - rocker|, k^2 = 4 crank ground and f = angle - ground_angle, is
    then taken without the absolute value: the motion continues smoothly through the change point,
    as inertia makes it. Its period may be two turns, and C changes its sign at each change point.

    Parameters
    ----------
    angle, rate, acceleration : crank angle [rad], its first [rad/s] and second [rad/s^2] time
        derivative, (...) broadcast together; the last axis is the sweep
    crank, coupler, rocker, ground : lengths between pins [m]
    ground_angle : direction of B from A [rad]; all angles are from the x axis
    mode : +1 open, Q left of the directed line P -> B (C > 0); -1 crossed, Q right of it (C < 0).
        C is zero only where coupler and rocker are in line, so a mode is one continuous branch.
        With a change point: the sign of C where 0 < angle - ground_angle < pi.
    point_along, point_across : X in the coupler's frame [m]: from P towards Q, and left of that
    crank_mass, coupler_mass, rocker_mass : masses of the bars [kg]
    rocker_load : moment on the rocker, counter-clockwise positive [N m], a constant or (...)
    gravity : [m/s^2]
    inertia : whether moment and forces include those of the accelerations
    only : names of all requested quantities; None requests all. Moment and forces, which take
        longer than the motion, are computed only if one of them is requested; if only positions and
        angles are requested, nothing else is computed

    Returns
    -------
    dict of (...) arrays: coupler_angle, rocker_angle [rad], coupler_rate, coupler_acceleration,
    rocker_rate, rocker_acceleration; pin_x, pin_y [m], pin_vx, pin_vy, pin_ax, pin_ay of Q, and
    point_x, ... of X;
    transmission_angle [rad], between coupler and rocker, in [0, pi]; holding_moment [N m] of the
    crank's drive; forces of pins [N] in the frame of a bar, _x along it towards its second letter
    above and _y to the left of that: crank_force_x, crank_force_y of the ground on the crank,
    coupler_force_.. of the crank on the coupler, rocker_force_.. of the ground on the rocker, and
    pin_force_.. of the coupler on the rocker, in the coupler's frame;
    mechanical_advantage 1/b1, the output moment of the rocker over the input moment of the crank,
    without masses. Angles start in [-pi, pi] and are unwrapped along the last axis, which
    needs steps below pi between samples.

    Raises
    ------
    ValueError
        A length not positive, a mass negative, a value not finite, a mode unknown, or a pose that
        cannot be assembled: the message gives the first such angle and the distance between the
        circles.

    Notes
    -----
    Loop residual below 1e-14 of the lengths. At a limit position of the crank, where coupler and
    rocker are in line, the rates are not finite; at a change point the forces are not. Next to such
    a pose they lose digits like 1/C^2, and where P comes near B like 1/D. Lengths count as those of
    a change point if their sums differ by at most 4 eps of the sum of all. Source: loop and example
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
    check_positive(**lengths)
    check_one_of(MODES, mode=mode)
    check_not_negative(**masses)
    check_number(
        ground_angle=ground_angle,
        point_along=point_along,
        point_across=point_across,
        gravity=gravity,
    )
    inputs = broadcast_motion(angle=angle, rate=rate, acceleration=acceleration)
    theta, w, dw = (np.atleast_1d(x) for x in inputs)
    (on_rocker,) = broadcast_loads(theta.shape, rocker_load=rocker_load)
    px, py = crank * np.cos(theta), crank * np.sin(theta)
    end_x, end_y = ground * np.cos(ground_angle), ground * np.sin(ground_angle)
    along, across = point_along / coupler, point_across / coupler
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):  # in line: as documented
        (ax, ay), (bx, by), cross, dot, turns = _close_loop(
            theta, ground_angle, end_x - px, end_y - py, **lengths, mode=mode
        )
        places = select_positions(
            only,
            {
                "coupler_angle": lambda: unwrap_angles(np.arctan2(ay, ax)),
                "rocker_angle": lambda: unwrap_angles(np.arctan2(by, bx)),
                "pin_x": lambda: end_x + bx,
                "pin_y": lambda: end_y + by,
                "point_x": lambda: px + (along * ax - across * ay),
                "point_y": lambda: py + (along * ay + across * ax),
                "transmission_angle": lambda: np.arctan2(np.abs(cross), dot),
            },
        )
        if places is not None:
            return {name: curve.reshape(inputs[0].shape) for name, curve in places.items()}
        (a1, a2), (b1, b2) = turns()
        a_motion, b_motion = (a1 * w, a1 * dw + a2 * w**2), (b1 * w, b1 * dw + b2 * w**2)
        loads: dict[str, Array] = {}
        if is_requested(only, *LOAD_ENDINGS):
            bars = _complex(px, py), _complex(ax, ay), _complex(bx, by)
            lift = 1j * gravity
            at_p: Complex | complex = lift
            at_q: Complex | complex = lift
            if inertia:
                at_p = lift + _complex(-(w**2), dw) * bars[0]
                at_q = lift + _complex(-(b_motion[0] ** 2), b_motion[1]) * bars[2]
            p1, q1 = 1j * bars[0], 1j * b1 * bars[2]
            accelerations = (lift, at_p), (at_p, at_q), (lift, at_q)
            velocities: tuple[Ends, ...] = (0j, p1), (p1, q1), (0j, q1)
            moments = map(drive_moment, masses.values(), accelerations, velocities)
            loads = {"holding_moment": np.asarray(sum(moments) - on_rocker * b1)}
            if is_requested(only, *FORCE_ENDINGS):
                loads |= _pin_forces(bars, accelerations, cross, masses, on_rocker)
        curves = {
            "coupler_angle": unwrap_angles(np.arctan2(ay, ax)),
            "coupler_rate": a_motion[0],
            "coupler_acceleration": a_motion[1],
            "rocker_angle": unwrap_angles(np.arctan2(by, bx)),
            "rocker_rate": b_motion[0],
            "rocker_acceleration": b_motion[1],
            **_end_motion("pin", (bx, by, *b_motion), start=(end_x, end_y)),
            **_end_motion(
                "point",
                (px, py, w, dw),
                (along * ax - across * ay, along * ay + across * ax, *a_motion),
            ),
            "transmission_angle": np.arctan2(np.abs(cross), dot),
            **loads,
            "mechanical_advantage": 1.0 / b1,
        }
    return {name: curve.reshape(inputs[0].shape) for name, curve in curves.items()}


def _complex(x: Array, y: Array) -> Complex:
    """Vectors x + iy as complex numbers."""
    vector = np.empty(np.broadcast(x, y).shape, complex)
    vector.real, vector.imag = x, y
    return vector


def _pin_forces(
    bars: tuple[Complex, Complex, Complex],
    accelerations: tuple[Ends, Ends, Ends],
    area: Array,
    masses: dict[str, float],
    rocker_load: Array,
) -> dict[str, Array]:
    """Pin forces of bars A-P, P-Q, B-Q; `area` is C.

    `accelerations` are those of the ends of the bars less that of gravity.
    """
    crank, coupler, rocker = bars
    (f0, _), (f1, m1), (f2, m2) = map(pin_load, masses.values(), bars, accelerations)
    at_q = (m1 * rocker + (m2 - rocker_load) * coupler) / area  # on the coupler
    return {
        **components_in_frame("crank_force", f0 + f1 - at_q, crank),
        **components_in_frame("coupler_force", f1 - at_q, coupler),
        **components_in_frame("rocker_force", f2 + at_q, rocker),
        **components_in_frame("pin_force", -at_q, coupler),
    }


def assembly_margins(
    crank: float, coupler: float, rocker: float, ground: float
) -> tuple[float, float]:
    """(c + r)^2 - (crank + ground)^2 and (crank - ground)^2 - (c - r)^2 [m^2], to rounding.

    If the first one is negative, the crank does not reach pi; if the second one is, it does not
    reach 0. Zero means a change point at that angle.
    """
    rounding = rounding_of_sum(crank, coupler, rocker, ground)

    def product(*factors: tuple[float, ...]) -> float:
        # sums rounded once: the bars may nearly be in line
        one, other = map(fsum, factors)
        return 0.0 if min(abs(one), abs(other)) <= rounding else one * other

    return (
        product((coupler, rocker, -crank, -ground), (coupler, rocker, crank, ground)),
        product((crank, -ground, coupler, -rocker), (crank, -ground, -coupler, rocker)),
    )


def _close_loop(
    theta: Array,
    ground_angle: float,
    dx: Array,
    dy: Array,
    *,
    crank: float,
    coupler: float,
    rocker: float,
    ground: float,
    mode: int,
) -> tuple[Pair, Pair, Array, Array, Callable[[], tuple[Pair, Pair]]]:
    """Components of coupler and rocker for the vector d = (dx, dy) from P to B; C; and a . b.

    The last result is a function that gives the first two derivatives of the angles of coupler and
    rocker by the crank angle.
    """
    k = 2.0 * np.sqrt(crank * ground)
    half_angle = 0.5 * (theta - ground_angle)
    u, v = k * np.cos(half_angle), k * np.sin(half_angle)
    square = (crank - ground) ** 2 + v * v
    rounding = rounding_of_sum(crank, coupler, rocker, ground)
    _check_reach(theta, square, coupler, rocker, rounding)
    outer, inner = assembly_margins(crank, coupler, rocker, ground)
    p, q = smooth_root(outer, u), smooth_root(inner, v)
    half = 0.5 * mode
    cross = half * p * q
    shift = 0.5 * (coupler - rocker) * (coupler + rocker)
    x, y = shift + 0.5 * square, shift - 0.5 * square

    def turns() -> tuple[Pair, Pair]:
        (by_u, by_u2), (by_v, by_v2) = root_derivatives(outer, u, p), root_derivatives(inner, v, q)
        # u' = -v/2, v' = u/2
        p1, p2 = -0.5 * v * by_u, 0.25 * (v * v * by_u2 - u * by_u)
        q1, q2 = 0.5 * u * by_v, 0.25 * (u * u * by_v2 - v * by_v)
        crosses = cross, half * (p1 * q + p * q1), half * (p2 * q + 2.0 * p1 * q1 + p * q2)
        squares = square, u * v, 0.5 * (u * u - v * v)
        turn = 0.5 * (square + (crank - ground) * (crank + ground))
        s1, s2 = 0.5 * squares[1], 0.5 * squares[2]
        return (
            _angle_derivatives(coupler, (x, s1, s2), crosses, squares, turn),
            _angle_derivatives(rocker, (y, -s1, -s2), crosses, squares, turn),
        )

    return (
        ((x * dx - cross * dy) / square, (x * dy + cross * dx) / square),
        ((y * dx - cross * dy) / square, (y * dy + cross * dx) / square),
        cross,
        0.5 * (coupler**2 + rocker**2 - square),
        turns,
    )


def _angle_derivatives(
    length: float,
    along: WithDerivatives,
    cross: WithDerivatives,
    square: WithDerivatives,
    turn: Array,
) -> tuple[Array, Array]:
    """First two derivatives by the crank angle of the angle of a bar (along d + cross J d)/square.

    `turn` is d x d'.
    """
    (x, x1, x2), (y, y1, y2), (s, s1, _) = along, cross, square
    first = ((x * y1 - y * x1) / length**2 + turn) / s
    second = ((x * y2 - y * x2) / length**2 + (0.5 - first) * s1) / s
    return first, second


def _check_reach(
    theta: Array, square: Array, coupler: float, rocker: float, rounding: float
) -> None:
    """Raise a ValueError where the circles of coupler and rocker do not meet; `square` is D."""
    min_distance, max_distance = abs(coupler - rocker), coupler + rocker
    near, far = np.sqrt(square.min(initial=np.inf)), np.sqrt(square.max(initial=0.0))
    if not (far - max_distance <= rounding and min_distance - near <= rounding):
        distance = np.sqrt(square)
        violation = np.maximum(distance - max_distance, min_distance - distance)
        bad = np.unravel_index(np.argmin(violation <= rounding), violation.shape)
        raise ValueError(
            f"loop cannot close at angle {theta[bad]:.9g} rad: the circles of coupler and rocker "
            f"miss by {violation[bad]:.6g} m"
        )
    if not near > rounding:
        raise ValueError("the crank pin meets the fixed pin of the rocker: rocker angle undefined")


def _end_motion(
    name: str, *arms: tuple[Array, ...], start: tuple[float, float] = (0.0, 0.0)
) -> dict[str, Array]:
    """Position, velocity and acceleration at the end of a chain of arms from `start`.

    An arm is (x, y, rate, acceleration): its vector and the derivatives of its angle.
    """
    motions = []
    for x, y, w, dw in arms:
        vx, vy = -w * y, w * x
        motions.append((x, y, vx, vy, -dw * y - w * vy, dw * x + w * vx))
    x, y, vx, vy, ax, ay = (reduce(np.add, terms) for terms in zip(*motions, strict=True))
    return {
        f"{name}_x": start[0] + x,
        f"{name}_y": start[1] + y,
        f"{name}_vx": vx,
        f"{name}_vy": vy,
        f"{name}_ax": ax,
        f"{name}_ay": ay,
    }


CLASS_BY_SHORTEST = {
    "crank": "crank-rocker",
    "coupler": "double rocker",
    "rocker": "rocker-crank",
    "ground": "double crank",
}


def grashof_margin(*, crank: float, coupler: float, rocker: float, ground: float) -> float:
    """Grashof margin (p + q) - (s + l) [m]: the middle two lengths less the shortest and longest.

    Positive: the shortest bar turns fully relative to all others. Zero, to within 4 eps of the sum
    of the lengths: change point. Negative: no bar turns fully relative to another.

    ValueError if a length is not positive, or if one is longer than the other three together, so
    that no pose closes the loop. Source: A. Avello, Teoría de máquinas, as given by B. Díaz Lozano,
    TFG, Universidad de Almería 2019, text lines 950-1008; its program does not treat equality
    separately.

    >>> grashof_margin(crank=1.0, coupler=2.0, rocker=2.5, ground=3.0)
    0.5
    """
    lengths = {"crank": crank, "coupler": coupler, "rocker": rocker, "ground": ground}
    check_positive(**lengths)
    shortest, p, q, longest = sorted(lengths.values())
    if longest > shortest + p + q:
        name = max(lengths, key=lambda bar: lengths[bar])
        raise ValueError(
            f"{name} must not be longer than the other bars together: the loop cannot "
            f"close, they miss by {longest - (shortest + p + q):.6g} m"
        )
    margin = (p + q) - (shortest + longest)
    return margin if abs(margin) > rounding_of_sum(*lengths.values()) else 0.0


def classify(*, crank: float, coupler: float, rocker: float, ground: float) -> str:
    """Grashof class, by which of the bars is the shortest.

    ::

        margin > 0   shortest  crank   crank-rocker   the crank turns, the rocker swings
                               rocker  rocker-crank   the rocker turns, the crank swings
                               ground  double crank   both turn
                               coupler double rocker  both swing, the coupler turns
        margin = 0   change point                     all bars come into line
        margin < 0   triple rocker                    no bar turns fully

    Lengths [m] and errors as in `grashof_margin`.

    >>> classify(crank=1.0, coupler=2.0, rocker=2.5, ground=3.0)
    'crank-rocker'
    >>> classify(crank=2.0, coupler=2.0, rocker=2.5, ground=3.0)
    'triple rocker'
    """
    lengths = {"crank": crank, "coupler": coupler, "rocker": rocker, "ground": ground}
    margin = grashof_margin(**lengths)
    if margin == 0.0:
        return "change point"
    return (
        CLASS_BY_SHORTEST[min(lengths, key=lambda bar: lengths[bar])]
        if margin > 0.0
        else "triple rocker"
    )


def crank_range(
    *, crank: float, coupler: float, rocker: float, ground: float
) -> tuple[float, float]:
    r"""Crank angles that can be reached: low <= |angle| <= high, within [0, pi] [rad].

    ::

        sin^2(low/2) = ((c - r)^2 - (crank - ground)^2)/k^2        k^2 = 4 crank ground
        cos^2(high/2) = ((crank + ground)^2 - (c + r)^2)/k^2

    with c = coupler, r = rocker, and low = 0 or high = pi where the right side is negative. The
    range of a crank that turns fully is (0, pi). A crank with 0 < low and high < pi moves in one of
    two intervals, which are mirror images: from one to the other the linkage must be reassembled.
    At both limits coupler and rocker are in line.

    Lengths [m] and errors as in `grashof_margin`. Accuracy: rounding; for a limit next to 0 or pi
    half of the digits.

    >>> [round(limit, 6) for limit in crank_range(crank=2.0, coupler=2.0, rocker=2.5, ground=3.0)]
    [0.0, 2.219516]
    """
    grashof_margin(crank=crank, coupler=coupler, rocker=rocker, ground=ground)
    outer, inner = assembly_margins(crank, coupler, rocker, ground)
    return _limit_angles(-inner, -outer, 4.0 * crank * ground)


def dead_centres(
    *, crank: float, coupler: float, rocker: float, ground: float, mode: int = 1
) -> tuple[Array, Array]:
    r"""Poses in which crank and coupler are in line, so that the rocker is at rest.

    ::

                 Q               Q            stretched, A-Q = crank + coupler: crank angle g
               /  \             /  \          folded, A-Q = coupler - crank > 0: crank angle g + pi,
             P     \           /    \         or A-Q = crank - coupler > 0: crank angle g
           /        \         /      \
         A --------- B       A ------ B       g = angle Q-A-B
           stretched       P  folded

    The rocker angle is pi less the angle A-B-Q; both g and the rocker angle change their sign with
    the side of Q.

    Returns the crank angles in [0, 2 pi) and the rocker angles in [-pi, pi], each (2,): first
    stretched, then folded [rad]. NaN means that the pose does not exist, or that the rocker does
    not reverse in it because Q lies in A or all bars are in line (change point).

    Q lies left of A-B for mode 1 and right of it for mode -1; for the folded pose with a coupler
    shorter than the crank the sides are interchanged. With a change point `mode` is the mode at the
    dead centre. Lengths [m] and errors as in `grashof_margin`.

    >>> turns, ends = dead_centres(crank=1.0, coupler=2.0, rocker=2.5, ground=3.0, mode=-1)
    >>> [[round(float(x), 4) for x in np.degrees(angles)] for angles in (turns, ends)]
    [[310.7514, 128.6822], [-114.6243, -161.8051]]
    """
    lengths = {"crank": crank, "coupler": coupler, "rocker": rocker, "ground": ground}
    check_positive(**lengths)
    check_one_of(MODES, mode=mode)
    grashof_margin(**lengths)
    e = np.array([coupler + crank, abs(coupler - crank)])
    # positive where the triangle A-B-Q exists
    triangle_margin = np.minimum(ground + rocker - e, e - abs(ground - rocker))
    e = np.where(triangle_margin > rounding_of_sum(*lengths.values()), e, np.nan)
    at_crank = np.arccos((ground**2 + e**2 - rocker**2) / (2.0 * ground * e))
    at_rocker = np.arccos((ground**2 + rocker**2 - e**2) / (2.0 * ground * rocker))
    side = mode * np.array([1.0, np.sign(coupler - crank)])
    folded = np.array([0.0, np.pi if coupler > crank else 0.0])
    return (side * at_crank + folded) % TURN, side * (np.pi - at_rocker)


def swing_angle(*, crank: float, coupler: float, rocker: float, ground: float) -> float:
    """Angle [rad] through which the rocker of a crank-rocker swings, the same in both modes.

    Lengths [m]; ValueError for any other class, and the errors of `grashof_margin`.

    >>> round(float(np.degrees(swing_angle(crank=1.0, coupler=2.0, rocker=2.5, ground=3.0))), 4)
    47.1808
    """
    _, ends = _crank_rocker_dead_centres(crank, coupler, rocker, ground)
    return float(abs(ends[0] - ends[1]))


def time_ratio(*, crank: float, coupler: float, rocker: float, ground: float) -> float:
    """Time of the slower swing of a crank-rocker over that of the faster one, at constant speed.

    It is the ratio of the two crank rotations between the dead centres, the same in both modes.
    Lengths [m]; ValueError for any other class, and the errors of `grashof_margin`.

    >>> round(time_ratio(crank=1.0, coupler=2.0, rocker=2.5, ground=3.0), 6)
    1.023258
    """
    turns, _ = _crank_rocker_dead_centres(crank, coupler, rocker, ground)
    part = float(abs(turns[0] - turns[1]))
    return max(part, TURN - part) / min(part, TURN - part)


def transmission_range(
    *, crank: float, coupler: float, rocker: float, ground: float
) -> tuple[float, float]:
    r"""Smallest and largest angle between coupler and rocker [rad], over the reachable crank range.

    The angle rises with the crank angle from 0 to pi, so that its extremes are its values at the
    ends of `crank_range`::

        sin^2(smallest/2) = ((crank - ground)^2 - (c - r)^2)/(4 c r)
        cos^2(largest/2) = ((c + r)^2 - (crank + ground)^2)/(4 c r)

    with c = coupler, r = rocker, and 0 or pi where the right side is negative. Lengths [m] and
    errors as in `grashof_margin`; accuracy as in `crank_range`.

    >>> ends = transmission_range(crank=1.0, coupler=2.0, rocker=2.5, ground=3.0)
    >>> [round(float(end), 6) for end in np.degrees(ends)]
    [51.317813, 125.099632]
    """
    grashof_margin(crank=crank, coupler=coupler, rocker=rocker, ground=ground)
    outer, inner = assembly_margins(crank, coupler, rocker, ground)
    return _limit_angles(inner, outer, 4.0 * coupler * rocker)


def properties(
    *, crank: float, coupler: float, rocker: float, ground: float, **_: float
) -> dict[str, str]:
    """Grashof class, crank range and transmission angles in words and degrees, for a report.

    >>> properties(crank=1.0, coupler=2.0, rocker=2.5, ground=3.0)["time ratio"]
    '1.0233'
    """
    lengths = {"crank": crank, "coupler": coupler, "rocker": rocker, "ground": ground}
    low, high = np.degrees(crank_range(**lengths))
    least, most = np.degrees(transmission_range(**lengths))
    found = {
        "Grashof class": f"{classify(**lengths)}, margin {grashof_margin(**lengths):.4g} m",
        "crank": "turns fully"
        if (low, high) == (0.0, 180.0)
        else f"reaches {low:.2f}° to {high:.2f}° on either side",
        "transmission angle": f"{least:.2f}° to {most:.2f}°",
    }
    if classify(**lengths) == "crank-rocker":
        found["rocker swings"] = f"{np.degrees(swing_angle(**lengths)):.2f}°"
        found["time ratio"] = f"{time_ratio(**lengths):.4f}"
    return found


def _limit_angles(sine: float, cosine: float, whole: float) -> tuple[float, float]:
    """Angles with sin^2(first/2) = sine/whole, cos^2(second/2) = cosine/whole, within [0, pi]."""
    first, second = np.sqrt(np.clip([sine / whole, cosine / whole], 0.0, 1.0))
    return float(2.0 * np.arcsin(first)), float(2.0 * np.arccos(second))


def _crank_rocker_dead_centres(
    crank: float, coupler: float, rocker: float, ground: float
) -> tuple[Array, Array]:
    """Dead centres of a crank-rocker, or ValueError for any other class."""
    lengths = {"crank": crank, "coupler": coupler, "rocker": rocker, "ground": ground}
    found = classify(**lengths)
    if found != "crank-rocker":
        raise ValueError(f"the lengths must make a crank-rocker, these make a {found}")
    return dead_centres(**lengths, mode=1)


class FourBar(ClosedForm, function=solve, properties=properties):
    """Planar four-bar linkage: motion, coupler curve, moments and forces."""

    own_error = OwnError(1e-12, "the general planar solver, for random lengths")
    covers_inertia = True
    selects = True

    crank: Length
    coupler: Length
    rocker: Length
    ground: Length
    ground_angle: Angle
    mode: Mode
    point_along: Position
    point_across: Position
    crank_mass: Mass
    coupler_mass: Mass
    rocker_mass: Mass
    rocker_load: VaryingMoment
    gravity: Acceleration
