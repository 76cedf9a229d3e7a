"""Swinging-block linkage: the classic inverted slider-crank, whose slider has a fixed pivot."""

from collections.abc import Collection

import numpy as np
from numpy.typing import ArrayLike

from proofmass.analytic.linkages import inverted_slider_crank
from proofmass.analytic.numerics import (
    broadcast_motion,
    check_not_negative,
    check_number,
    check_positive,
)
from proofmass.analytic.protocol import (
    Acceleration,
    ClosedForm,
    Length,
    Mass,
    Mode,
    MomentOfInertia,
    Position,
)
from proofmass.base.arrays import Array

MODES = inverted_slider_crank.MODES


def solve(
    angle: ArrayLike,
    rate: ArrayLike = 1.0,
    acceleration: ArrayLike = 0.0,
    *,
    crank: float,
    rod: float,
    pivot_x: float,
    pivot_y: float = 0.0,
    mode: int = 1,
    crank_mass: float = 0.0,
    rod_mass: float = 0.0,
    block_mass: float = 0.0,
    block_inertia: float = 0.0,
    gravity: float = 9.81,
    inertia: bool = False,
    only: Collection[str] | None = None,
) -> dict[str, Array]:
    r"""Motion of a swinging-block linkage whose crank motion is given.

    ::

               P --__   slide s
              /      --__
             / crank     [S]__          A = (0, 0) and S = (pivot_x, pivot_y) are fixed
            /                 --__ E    A-P crank, driven
           A                            P-E rod, through a block that turns on S

    It is the `inverted_slider_crank` without the bar and with the bar's pivot B at S; the equations
    are given there. With D = |A-S| and r = crank, the rod rocks about the line A-S by +-asin(r/D)
    if the pivot is outside the circle of the crank pin, r < D; otherwise it turns with the crank
    (Whitworth).

    Parameters
    ----------
    angle, rate, acceleration : crank angle [rad], its first [rad/s] and second [rad/s^2] time
        derivative, (...) broadcast together; the last axis is the sweep
    crank, rod : lengths [m]
    pivot_x, pivot_y : the block's pivot S [m]
    mode : +1 the rod points from the crank pin to the block, -1 away from it
    crank_mass, rod_mass : uniform bars [kg]
    block_mass : mass of the block, whose weight is carried by its pivot alone [kg]
    block_inertia : moment of inertia of the block about its pivot [kg m^2]
    gravity : along -y [m/s^2]
    inertia : whether moment and forces include those of the accelerations
    only : names of all requested quantities; None requests all. Moment and forces are computed only
        if one of them is requested

    Returns
    -------
    dict of (...) arrays: slide [m], slide_rate, slide_acceleration, slide_margin [m];
    rod_angle [rad], rod_rate, rod_acceleration; end_x, end_y [m], end_vx, end_vy, end_ax, end_ay;
    holding_moment [N m]; forces [N], crank_force_x, crank_force_y of the ground on the crank,
    rod_force_.. of the crank on the rod, guide_force_.. of the rod on the block, with guide_moment
    [N m], and pin_force_.. of the block on its pivot; as in `inverted_slider_crank.solve`.

    Raises
    ------
    ValueError
        As in `inverted_slider_crank.solve`.

    Notes
    -----
    Accuracy as in `inverted_slider_crank.solve`. Source: B. Díaz Lozano, TFG, Universidad de
    Almería 2019, text lines 3415-3758, with the second input constant; the thesis draws this
    linkage and solves the one with two inputs.

    Examples
    --------
    >>> pose = solve(np.pi / 2, crank=2.0, rod=3.0, pivot_x=2.0 + np.cos(0.8), pivot_y=np.sin(0.8))
    >>> [round(float(pose[name]), 6) for name in ("slide", "end_x", "end_y")]
    [2.986202, 2.709167, 0.71143]
    """
    check_number(pivot_x=pivot_x, pivot_y=pivot_y)
    check_not_negative(block_mass=block_mass)
    check_not_negative("kg m^2", block_inertia=block_inertia)
    inputs = broadcast_motion(angle=angle, rate=rate, acceleration=acceleration)
    pose = inverted_slider_crank.solve(
        *(np.stack([value, np.zeros_like(value)]) for value in inputs),
        crank=crank,
        bar=0.0,
        rod=rod,
        ground_x=pivot_x,
        ground_y=pivot_y,
        mode=mode,
        crank_mass=crank_mass,
        rod_mass=rod_mass,
        slider_mass=block_mass,
        slider_inertia=block_inertia,
        gravity=gravity,
        inertia=inertia,
        only=only,
    )
    return {
        name: curve
        for name, curve in pose.items()
        if not name.startswith(("slider", "bar_force")) and name != "holding_moment_bar"
    }


def extremes(*, crank: float, pivot_x: float, pivot_y: float = 0.0) -> tuple[Array, Array]:
    r"""Crank angles and rod angles [rad], each (2,), at which the rod of mode +1 reverses.

    The rod is perpendicular to the crank there. With D = |A-S|, direction d of A-S, r = crank::

        crank = d +- acos(r/D),   rod = d -+ asin(r/D)

    From the first angle to the second the crank passes the side of the pivot, which is the quick
    stroke; the time ratio of the two strokes at constant speed is pi/acos(r/D) - 1. ValueError for
    a crank that is not positive, and where the rod turns fully, r >= D. Source: the right-angled
    triangle A-P-S.

    >>> (fast, slow), rods = extremes(crank=1.0, pivot_x=2.0)
    >>> np.degrees([fast, slow, *rods]).round(6)
    array([-60.,  60.,  30., -30.])
    """
    check_positive(crank=crank)
    check_number(pivot_x=pivot_x, pivot_y=pivot_y)
    distance, direction = np.hypot(pivot_x, pivot_y), np.arctan2(pivot_y, pivot_x)
    if not crank < distance:
        raise ValueError(
            f"crank must be shorter than the {distance:.6g} m to the pivot for the rod to rock, "
            f"got {crank}"
        )
    side = np.array([-1.0, 1.0])
    return (
        direction + side * np.arccos(crank / distance),
        direction - side * np.arcsin(crank / distance),
    )


class SwingingBlock(ClosedForm, function=solve):
    """Swinging-block linkage: the classic inverted slider-crank, whose slider has a fixed pivot."""

    covers_inertia = True
    selects = True

    crank: Length
    rod: Length
    pivot_x: Position
    pivot_y: Position
    mode: Mode
    crank_mass: Mass
    rod_mass: Mass
    block_mass: Mass
    block_inertia: MomentOfInertia
    gravity: Acceleration
