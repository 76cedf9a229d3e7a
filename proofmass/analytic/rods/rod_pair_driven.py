"""Two clamped rods with their tips on one pin (2RFR), moved by their motors through equilibria."""

from collections.abc import Mapping
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline

from proofmass.analytic.inverse import InverseProblem, PathMotion
from proofmass.analytic.numerics import check_finite, check_number
from proofmass.analytic.protocol import (
    ClosedForm,
    VaryingForce,
)
from proofmass.analytic.remember import reuse_nearby
from proofmass.analytic.rods.continuation import follow, loads_and_rates
from proofmass.analytic.rods.equilibrium import (
    RodState,
    check_reach,
    columns,
    derivatives,
    newton,
    solve_direct,
)
from proofmass.analytic.rods.led import LED_ACCURACY, lead_along, load_parts
from proofmass.analytic.rods.rod_pair import PairParameters, make_pair
from proofmass.base.arrays import Array, Complex

PairNumbers = tuple[float, ...]


POINTS_PER_DIVISION = 4  # points of a division at which the inverse problem is solved
MAX_APPROACH_STEP = (
    0.02  # longest step [L] from the first equilibrium towards the points, for all at once
)


def circles(
    time: ArrayLike, *, diameter: float, number: int, divisions: int, **pair: float
) -> tuple[Array, Array, Array]:
    """Motion profile of motor angles that move the pin round concentric circles.

    Parameters
    ----------
    time : array_like (n,)
        [s]; a division takes a second.  At 0 the pin is in the centre, at 1 + k divisions on the x
        axis, where circle k, from 0, begins counter-clockwise; in the last division of a round the
        pin moves out to the next circle.
    diameter : float
        Diameter of the outermost circle [m]; the others are at equal distances.
    number, divisions : int
        Number of circles, and number of divisions of each.
    **pair
        The equilibrium in the centre: theta1, theta2, angles of the motors [rad], and distance,
        pin_x .. push_y, force_x, force_y, length, stiffness as for `solve`.

    Returns
    -------
    angle, rate, acceleration : ndarray (2, n)
        Of both motors [rad, rad/s, rad/s^2]: cubic splines through solutions of the inverse
        problem, `POINTS_PER_DIVISION` in each division.  At the divisions, whole seconds, the pin
        is on its circle within 1e-9 m.

    Raises
    ------
    ValueError
        As `solve`; numbers below 1, a size that is not positive, or a position to which the pin
        cannot be moved.

    Notes
    -----
    Source: Pérez Gámiz 2018, text lines 3118-3128: D = 0.2 m, 5 circles of 8 divisions each, no
    load.  Its function for the points is not listed; their order here is our choice.

    Examples
    --------
    >>> angles, _, _ = circles([0.0, 1.0], diameter=0.2, number=1, divisions=8, distance=0.6,
    ...     theta1=-0.5622717, theta2=0.3649722, stiffness=0.0521860264, pin_x=0.293,
    ...     pin_y=-0.341, moment1=0.28, moment2=0.29, push_x=-0.83, push_y=0.95)
    >>> np.degrees(angles[:, 1]).round(3).tolist()
    [-51.075, 23.811]
    """
    check_sizes(diameter, number, divisions)
    turns, size = turns_and_sizes(number, divisions)
    return motor_profile(time, 0.5 * diameter * size * np.exp(2j * np.pi * turns), pair)


def rectangles(
    time: ArrayLike, *, width: float, height: float, number: int, divisions: int, **pair: float
) -> tuple[Array, Array, Array]:
    """Motion profile of motor angles that move the pin round concentric rectangles.

    Parameters
    ----------
    time : array_like (n,)
        [s]; a division takes a second.  At 0 the pin is in the centre, at 1 + 4 k divisions on
        rectangle k, from 0, one division from its lower right corner, in which a round ends; the
        pin moves clockwise.
    width, height : float
        Size of the outermost rectangle [m]; the others are at equal distances.
    number, divisions : int
        Number of rectangles, and number of divisions of each side.
    **pair
        As for `circles` [SI].

    Returns
    -------
    angle, rate, acceleration : ndarray (2, n)
        As of `circles` [rad, rad/s, rad/s^2].

    Raises
    ------
    ValueError
        As `circles`.

    Notes
    -----
    Source: Pérez Gámiz 2018, text lines 3130-3137: 0.2 m by 0.2 m, 4 rectangles, 4 divisions a
    side, no load; the order of the points is our choice.  About the centre of the source the last
    of the 64 points, a corner of the largest rectangle, is an unstable equilibrium: the program
    prescribes the pin, which the motors alone cannot keep there.
    """
    check_sizes(min(width, height), number, divisions)
    turns, size = turns_and_sizes(number, 4 * int(divisions))
    sides = 4.0 * turns + 1.0 / divisions
    corner = np.array([1 - 1j, -1 - 1j, -1 + 1j, 1 + 1j, 1 - 1j])
    side = np.floor(sides + 1e-9).astype(int)
    shape = corner[side % 4] + (sides - side) * (corner[side % 4 + 1] - corner[side % 4])
    return motor_profile(time, 0.5 * size * (width * shape.real + 1j * height * shape.imag), pair)


def check_sizes(size: float, number: int, divisions: int) -> None:
    """ValueError for a path whose size [m] is not positive, or with less than one part."""
    if not (number >= 1 and divisions >= 1 and 0.0 < size < np.inf):
        raise ValueError(
            f"a size [m] must be positive and finite, and number and divisions 1 or more, got "
            f"{size}, {number}, {divisions}"
        )


def turns_and_sizes(number: int, divisions: int) -> tuple[Array, Array]:
    """Turns [1] about the centre at the points of a path, and their sizes over that of the path."""
    t = np.arange(POINTS_PER_DIVISION * number * int(divisions) + 1) / POINTS_PER_DIVISION
    turns = np.maximum(t - 1.0, 0.0) / divisions
    out = np.clip(divisions * (turns % 1.0) - (divisions - 1.0), 0.0, 1.0)
    ring = np.floor(turns) + 1.0 + np.where(turns < number - 1, out, 0.0)
    return turns, np.minimum(t, np.minimum(ring, number)) / number


def motor_profile(
    time: ArrayLike, places: Complex, pair: dict[str, float]
) -> tuple[Array, Array, Array]:
    """Motor angles, rates and accelerations (2, n) by splines through points x + iy of the pin.

    Parameters
    ----------
    time : array_like (n,)
        [s]
    places : ndarray (m,)
        Points relative to the first equilibrium, `POINTS_PER_DIVISION` to a second [m].
    pair : dict of float
        Arguments of `circles` for the equilibrium [SI].

    Returns
    -------
    angle, rate, acceleration : ndarray (2, n)
        [rad, rad/s, rad/s^2]
    """
    try:
        spline = motor_spline(tuple(places.tolist()), **pair)
    except TypeError as error:  # there is a parameter too many or too few
        raise ValueError(str(error).replace("equilibria_at_points()", "a path")) from None
    t = np.asarray(time, float)
    angle, rate, acceleration = (np.moveaxis(spline(t, k), -1, 0) for k in range(3))
    return angle, rate, acceleration


@lru_cache(8)
def motor_spline(places: tuple[complex, ...], **pair: float) -> CubicSpline:
    """Spline of both motor angles over time; see `motor_profile`."""
    return CubicSpline(
        np.arange(len(places)) / POINTS_PER_DIVISION, equilibria_at_points(places, **pair).inputs
    )


def equilibria_at_points(
    places: tuple[complex, ...],
    *,
    theta1: float,
    theta2: float,
    distance: float,
    pin_x: float,
    pin_y: float,
    moment1: float,
    moment2: float,
    push_x: float,
    push_y: float,
    force_x: float = 0.0,
    force_y: float = 0.0,
    length: float = 1.0,
    stiffness: float = 1.0,
) -> RodState:
    """Equilibria (m,) with the pin at points relative to its first position, by straight paths."""
    problem = distance, length, stiffness, force_x, force_y
    start = first_equilibrium(
        (theta1, theta2), problem, (pin_x, pin_y, moment1, moment2, push_x, push_y)
    )
    free, points = columns(start.assembly, "rods", "inputs"), np.array(places)
    states = RodState(start.assembly, np.tile(start.vector, (points.size, 1)))
    steps = 1 + int(np.ceil(np.abs(points).max() / MAX_APPROACH_STEP / length))
    goal = np.stack([points.real, points.imag], axis=1)
    check_reach(states.with_parts(pose=start.pose + goal))
    for share in np.linspace(0.0, 1.0, steps)[1:]:
        states, moved = newton(states.with_parts(pose=start.pose + share * goal), free)
        if not np.isfinite(moved).all():
            x, y = start.pose + share * goal[np.argmax(~np.isfinite(moved))]
            raise ValueError(f"the pin cannot be moved to ({x:.6g}, {y:.6g}) m")
    return states


def follow_path(
    motion: PathMotion,
    *,
    theta1: float,
    theta2: float,
    distance: float,
    pin_x: float,
    pin_y: float,
    moment1: float,
    moment2: float,
    push_x: float,
    push_y: float,
    force_x: ArrayLike = 0.0,
    force_y: ArrayLike = 0.0,
    length: float = 1.0,
    stiffness: float = 1.0,
) -> tuple[Array, Array, Array]:
    """Motor angles that lead the pin along a path, with their rates and accelerations.

    Parameters
    ----------
    motion : PathMotion
        x, y of the pin [m].
    theta1, theta2 : angles of the motors at the equilibrium that the next parameters guess, from
        which the pin goes straight to the first place [rad]
    distance, pin_x, pin_y : of `solve` [m]
    moment1, moment2, push_x, push_y : of `solve` [N m, N]
    force_x, force_y : dead load on the pin [N], or along the path, (n,)
    length, stiffness : of `solve` [m, N m^2]

    Returns
    -------
    angle, rate, acceleration : ndarray (2, n)
        [rad, rad/s, rad/s^2]; see `proofmass.analytic.rods.led.lead_along`.

    Raises
    ------
    ValueError
        A place is out of reach, or the equilibrium ends at a fold before it.
    """
    load, rate, acceleration = load_parts(motion, force_x=force_x, force_y=force_y)
    problem = distance, length, stiffness, *load[:, 0].tolist()
    guess = pin_x, pin_y, moment1, moment2, push_x, push_y
    start = first_equilibrium((theta1, theta2), problem, guess)
    return lead_along(start, motion, load, rate, acceleration)


def solve(
    angle: ArrayLike,
    rate: ArrayLike = 0.0,
    acceleration: ArrayLike = 0.0,
    *,
    distance: float,
    pin_x: float,
    pin_y: float,
    moment1: float,
    moment2: float,
    push_x: float,
    push_y: float,
    force_x: ArrayLike = 0.0,
    force_y: ArrayLike = 0.0,
    length: float = 1.0,
    stiffness: float = 1.0,
    load_rates: Mapping[str, Array] | None = None,
) -> dict[str, Array]:
    r"""Equilibria of two rods on one pin, followed along the motions of their motors.

    ::

               P --> F            clamps at (-d/2, 0) and (d/2, 0), at angles theta1 and theta2
             .' `.                n_1 + n_2 = F,  m(L) = 0 in both rods
           _/     \
         --@---d---@--            dP/dt = dP/dtheta dtheta/dt + dP/dF dF/dt at rest: no inertia
        theta1    theta2

    Parameters
    ----------
    angle : theta1, theta2 [rad] in order of the motion, (2, n)
    rate : their rates [rad/s], which broadcast with `angle`
    acceleration : [rad/s^2], not used, since equilibria have no inertia
    distance : d, between the clamps [m]
    pin_x, pin_y : first guess of the pin P at the first angles [m]; together with the next two
        lines it selects one of the equilibria
    moment1, moment2 : first guess of the moments at the clamps [N m]
    push_x, push_y : first guess of the force n_1 on the tip of the first rod [N]
    force_x, force_y : F, dead load on the pin [N], or along the path, (n,)
    length, stiffness : L [m], EI [N m^2], of each rod
    load_rates : rates of force_x and force_y [N/s], (n,) each; None: both are constant

    Returns
    -------
    dict of (n,) arrays: pin_x, pin_y [m], pin_vx, pin_vy [m/s], tip1, tip2, tangents at the pin
    [rad], hold1, hold2, the moments of the motors [N m], push_x, push_y, n_1 [N], energy of bending
    [J], pin_stiffness, the least stiffness of the pin [N/m].  All are NaN from the first sample
    beyond a fold, where the stiffness of the pin is zero and the pin leaves the branch.

    Raises
    ------
    ValueError
        Angles of another shape, clamps out of reach, or a guess from which Newton's method finds no
        equilibrium.

    Notes
    -----
    Between samples the motors and the load change in proportion to each other.  A branch point,
    which occurs in symmetric problems only, is passed without leaving the branch.  Equilibria are
    closed and balanced within 1e-10 of L and EI/L^2; rates are their derivatives, within 1e-9 m/rad
    on the line below, 0.2 rad from a fold.
    Source of the motions: Pérez Gámiz 2018, text lines 2924-4013, which prints no results.

    Examples
    --------
    The line of the source, one radian of the first motor without load, and one radian backwards:

    >>> start = {"distance": 0.6, "stiffness": 0.0521860264, "pin_x": 0.293, "pin_y": -0.341,
    ...          "moment1": 0.28, "moment2": 0.29, "push_x": -0.83, "push_y": 0.95}
    >>> begin = np.radians([[-32.2158], [20.9114]])
    >>> turn = np.array([[0.0, 0.5, 1.0], [0.0, 0.0, 0.0]])
    >>> solve(begin + turn, **start)["pin_y"].round(4).tolist()
    [-0.3408, -0.2937, -0.1929]
    >>> solve(begin - turn, **start)["pin_y"].round(4).tolist()
    [-0.3408, nan, nan]
    """
    theta = np.asarray(angle, float)
    if theta.ndim != 2 or len(theta) != 2 or not theta.size:
        raise ValueError(f"angle must hold theta1 and theta2, (2, n), got {theta.shape}")
    check_number(pin_x=pin_x, pin_y=pin_y, moment1=moment1, moment2=moment2)
    check_number(push_x=push_x, push_y=push_y)
    check_finite(angle=theta.sum(), rate=np.sum(rate), force_x=force_x, force_y=force_y)
    load, growth = loads_and_rates(theta.shape[1:], load_rates, force_x=force_x, force_y=force_y)
    problem = distance, length, stiffness, *load[0].tolist()
    guess = pin_x, pin_y, moment1, moment2, push_x, push_y
    near = find_branch(tuple(map(tuple, np.hstack([theta.T, load]).tolist())), problem, guess)
    there = np.isfinite(near.vector[:, 0])
    first = pair_states(near.vector[there], *problem)
    first = first.with_parts(inputs=theta.T[there], load=load[there])
    states, _ = newton(first, columns(near.assembly, "rods", "pose"))
    curves = describe_equilibria(
        states, np.broadcast_to(rate, theta.shape)[:, there], growth[there]
    )
    found = {name: np.full(there.size, np.nan) for name in curves}
    for name, values in curves.items():
        found[name][there] = values
    return found


@reuse_nearby
def find_branch(
    path: tuple[tuple[float, ...], ...], problem: PairNumbers, guess: PairNumbers
) -> RodState:
    """Equilibria (n,) along a path of (theta1, theta2, F_x, F_y), NaN beyond a fold.

    `reuse_nearby` gives the same result for problems that differ by less than 1e-5, and Newton's
    method continues from it for each of them.  Sensitivities need many such problems.
    """
    first = first_equilibrium(path[0][:2], problem, guess)
    return follow_from(path, problem, tuple(first.vector.tolist()))


def first_equilibrium(
    angles: tuple[float, ...], problem: PairNumbers, guess: PairNumbers
) -> RodState:
    """The equilibrium at the first angles of the motors that Newton's method finds from a guess."""
    pin_x, pin_y, moment1, moment2, *push = guess
    rods = [moment1, *push, moment2, *np.subtract(problem[-2:], push)]
    return solve_direct(pair_states(np.array([*rods, pin_x, pin_y, *angles, 0.0, 0.0]), *problem))


@reuse_nearby
def follow_from(
    path: tuple[tuple[float, ...], ...], problem: PairNumbers, first: PairNumbers
) -> RodState:
    """Equilibria (n,) along a path from a first equilibrium, which many guesses have in common."""
    angles, load = np.hsplit(np.array(path), 2)
    return follow(pair_states(np.array(first), *problem), inputs=angles, load=load).states


def pair_states(
    vector: Array, distance: float, length: float, stiffness: float, force_x: float, force_y: float
) -> RodState:
    """States (n,) of a pair of rods with these vectors, under the load of the problem."""
    return RodState(make_pair(distance, length, stiffness), vector).with_parts(
        load=[force_x, force_y]
    )


def describe_equilibria(s: RodState, rate: Array, growth: Array) -> dict[str, Array]:
    """Quantities (n,) of equilibria for rates (2, n) of the motors and (n, 2) of the loads."""
    slopes = derivatives(s)
    velocity = np.einsum("npk,kn->pn", slopes.direct, rate)
    velocity += np.einsum("npk,nk->pn", slopes.compliance, growth)
    tips = s.shape([1.0])[2][..., 0]
    return {
        "pin_x": s.pose[:, 0],
        "pin_y": s.pose[:, 1],
        "pin_vx": velocity[0],
        "pin_vy": velocity[1],
        "tip1": tips[:, 0],
        "tip2": tips[:, 1],
        "hold1": -s.moment[:, 0],
        "hold2": -s.moment[:, 1],
        "push_x": s.force[:, 0, 0],
        "push_y": s.force[:, 0, 1],
        "energy": s.energy.sum(axis=1),
        "pin_stiffness": np.linalg.eigvalsh(slopes.stiffness)[:, 0],
    }


class DrivenRodPair(PairParameters, ClosedForm, function=solve):
    """Two clamped rods with their tips on one pin (2RFR), moved by their motors."""

    method = "solver of the elastica between a clamp and a common pin"
    takes_load_rates = True
    profiles = (
        circles,
        rectangles,
    )
    inverse = InverseProblem({"x": "pin_x", "y": "pin_y"}, follow_path, LED_ACCURACY)

    force_x: VaryingForce
    force_y: VaryingForce
