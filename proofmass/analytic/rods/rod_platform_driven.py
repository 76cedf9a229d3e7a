"""Three clamped rods on one rigid platform, driven along guides (3PFR) or by motors (3RFR).

The module has the reference of equilibria along a path of the inputs, and the map of the workspace
with constant orientation.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike

from proofmass.analytic.chart import Chart
from proofmass.analytic.inverse import InverseProblem, PathMotion
from proofmass.analytic.numerics import check_count, check_finite, check_not_negative, check_number
from proofmass.analytic.protocol import (
    Angle,
    BendingStiffness,
    ClosedForm,
    Domain,
    Length,
    Natural,
    OneOf,
    Quantity,
    VaryingForce,
    VaryingMoment,
)
from proofmass.analytic.remember import reuse_nearby
from proofmass.analytic.rods.continuation import follow, loads_and_rates
from proofmass.analytic.rods.equilibrium import RodState, columns, derivatives, newton
from proofmass.analytic.rods.led import LED_ACCURACY, lead_along, load_parts
from proofmass.analytic.rods.rod_platform import (
    MODES,
    PlatformProblem,
    ThreeNumbers,
    equilibrium_of_mode,
    platform_is_stable,
)
from proofmass.analytic.rods.workspace import fit_pose_map, pose_chart
from proofmass.base.arrays import Array

__all__ = ["MODES", "constant_orientation", "solve"]


def constant_orientation(
    *,
    side: float,
    theta1: float = 0.0,
    theta2: float = 0.0,
    theta3: float = 0.0,
    guide1: float | None = None,
    guide2: float | None = None,
    guide3: float | None = None,
    radius: float = 1.0,
    force_x: float = 0.0,
    force_y: float = 0.0,
    moment: float = 0.0,
    mode: int = 1,
    inflections: int = 1,
    length: float = 1.0,
    stiffness: float = 1.0,
    rigid_extension: float = 0.0,
    input1: float = 0.0,
    input2: float = 0.0,
    input3: float = 0.0,
    nodes: int = 25,
) -> Chart:
    r"""Chart of the poses that the platform reaches without rotation from a stable equilibrium.

    ::

             - - -O1 [=]---.         P in x, y; phi as in the equilibrium
                            B1       q_1, q_2, q_3 determine each pose:
                    P ->   / `.      three inputs for three degrees of freedom
                          B3--B2

    Parameters
    ----------
    side, theta1, theta2, theta3, guide1, guide2, guide3, radius : of `solve` [m, rad]
    force_x, force_y, moment, mode, inflections : of `solve` [N, N m]
    length, stiffness, rigid_extension : of `solve` [m, N m^2]
    input1, input2, input3 : q [m or rad] of the equilibrium that `mode` counts
    nodes : along each axis, 5 to 201

    Returns
    -------
    Chart
        As `rod_pair.workspace`, over x, y [m]: det(dq/dP) of x, y and phi [m/rad, or
        rad^2/m^2 for motors], the stiffness to forces on a platform that may rotate [N/m], and
        the three slides [m] or motor angles [rad].

    Raises
    ------
    ValueError
        As `rod_platform_driven.solve`, and for too few or too many nodes.

    Notes
    -----
    The window extends by one rod and half a platform to all sides; guides have no ends.  Pérez
    Gámiz 2018 has such maps as figures only, without numbers.

    Examples
    --------
    The start pose of annex II.4, as below.

    >>> turns = 0.0, 2 * np.pi/3, -2 * np.pi/3
    >>> chart = constant_orientation(side=0.2 * np.sqrt(3), stiffness=0.0521860264, nodes=5,
    ...     **{f"input{k}": -0.0782049 for k in (1, 2, 3)},
    ...     **{f"{key}{k}": turn for key in ("theta", "guide") for k, turn in enumerate(turns, 1)})
    >>> [panel.field.unit for panel in chart.panels]
    ['m/rad', 'N/m', 'm', 'm', 'm']
    """
    guide = None if guide1 is None or guide2 is None or guide3 is None else (guide1, guide2, guide3)
    problem = PlatformProblem(
        side,
        radius,
        length,
        stiffness,
        (theta1, theta2, theta3),
        guide,
        (input1, input2, input3),
        (force_x, force_y, moment),
        inflections,
    )
    start = equilibrium_of_mode(problem, mode, rigid_extension)
    chart = pose_chart(start, fit_pose_map(start, nodes), "rad²/m²" if guide is None else "m/rad")
    return Chart(
        chart.x,
        chart.y,
        chart.panels,
        f"The platform's angle is constant, {np.degrees(start.pose[2]):.4g}°. {chart.caption}",
        True,
    )


def follow_path(
    motion: PathMotion,
    *,
    side: float,
    theta1: float = 0.0,
    theta2: float = 0.0,
    theta3: float = 0.0,
    guide1: float | None = None,
    guide2: float | None = None,
    guide3: float | None = None,
    radius: float = 1.0,
    force_x: ArrayLike = 0.0,
    force_y: ArrayLike = 0.0,
    moment: ArrayLike = 0.0,
    mode: int = 1,
    inflections: int = 1,
    length: float = 1.0,
    stiffness: float = 1.0,
    rigid_extension: float = 0.0,
    input1: float = 0.0,
    input2: float = 0.0,
    input3: float = 0.0,
) -> tuple[Array, Array, Array]:
    """Inputs that lead the platform along a path, with their rates and accelerations.

    Parameters
    ----------
    motion : PathMotion
        x, y [m] and phi [rad] of the platform.
    side, theta1, theta2, theta3, guide1, guide2, guide3, radius : of `solve` [m, rad]
    force_x, force_y, moment : dead load [N, N m], or along the path, (n,)
    mode, inflections : of `solve`
    length, stiffness, rigid_extension : of `solve` [m, N m^2]
    input1, input2, input3 : q [m or rad] of the equilibrium that `mode` counts, from which the
        platform goes straight to the first place; there `solve` must count the same mode

    Returns
    -------
    value, rate, acceleration : ndarray (3, n)
        [m or rad]; see `proofmass.analytic.rods.led.lead_along`.

    Raises
    ------
    ValueError
        As `solve`; a place is out of reach, or the equilibrium ends at a fold before it.
    """
    load, rate, acceleration = load_parts(motion, force_x=force_x, force_y=force_y, moment=moment)
    first_x, first_y, first_moment = load[:, 0].tolist()
    problem = PlatformProblem(
        side,
        radius,
        length,
        stiffness,
        (theta1, theta2, theta3),
        guide_directions(guide1, guide2, guide3),
        (input1, input2, input3),
        (first_x, first_y, first_moment),
        inflections,
    )
    start = equilibrium_of_mode(problem, mode, rigid_extension)
    return lead_along(start, motion, load, rate, acceleration)


QUANTITIES = ("x", "y", "phi", "x_rate", "y_rate", "phi_rate", "hold1", "hold2", "hold3", "energy")


def solve(
    inputs: ArrayLike,
    rate: ArrayLike = 1.0,
    acceleration: ArrayLike = 0.0,
    *,
    side: float,
    theta1: float = 0.0,
    theta2: float = 0.0,
    theta3: float = 0.0,
    guide1: float | None = None,
    guide2: float | None = None,
    guide3: float | None = None,
    radius: float = 1.0,
    force_x: ArrayLike = 0.0,
    force_y: ArrayLike = 0.0,
    moment: ArrayLike = 0.0,
    mode: int = 1,
    inflections: int = 1,
    length: float = 1.0,
    stiffness: float = 1.0,
    rigid_extension: float = 0.0,
    load_rates: Mapping[str, Array] | None = None,
) -> dict[str, Array]:
    r"""Equilibria along a path of the inputs, each the continuation of the one before.

    ::

               q_1 -->
        - - O1 - [=]------.            clamp i at O_i + q_i (cos guide_i, sin guide_i),
                           `-._ B1     its tangent at theta_i; without guides q_i adds to theta_i
                               `o
                               / `.    O_i and the platform as in `rod_platform`
                             `o----o

    Parameters
    ----------
    inputs : q [m or rad], (3, ...); the last axis is the path
    rate, acceleration : their time derivatives [SI]; there are no accelerations without masses
    side : see `rod_platform.solve` [m]
    theta1, theta2, theta3 : tangents at the clamps [rad]; without guides, those of inputs 0
    guide1, guide2, guide3 : directions of the guides [rad]; None: the inputs turn the clamps
    radius : see `rod_platform.solve` [m]
    force_x, force_y : dead load F on the platform at P [N], or along the path, (...)
    moment : dead load M on the platform [N m], or along the path, (...)
    mode, inflections : see `rod_platform.solve`; they select the equilibrium at the first inputs
    length, stiffness : L [m], EI [N m^2], of each rod
    rigid_extension : see `rod_platform.solve` [m]
    load_rates : rates of force_x, force_y and moment [SI], (...) each; None: all are constant

    Returns
    -------
    dict of (...) arrays: x, y [m], phi [rad] of the platform, unwrapped, each with _rate; hold1,
    hold2, hold3, the forces or moments of the drives [N or N m]; energy of bending [J].  All are
    NaN from the sample on at which the equilibrium folds or becomes unstable.

    Raises
    ------
    ValueError
        As `rod_platform.solve`, or some guides without the others.

    Notes
    -----
    The error is below 1e-9 of the sizes EI/L^2, EI/L and L; rates are by the exact Jacobian.
    Results are also NaN where a rod is so tight, with alpha = L sqrt(R/EI) above about 12, that
    shooting along it loses all digits; a path that pulls a rod straight takes minutes up to there.
    Source: Pérez Gámiz 2018, eqs 106-112 and annex II.4 (lines 7091-8310), which follows paths of
    inputs from tables that are not printed.  This module differs from it in the derivative by the
    slide, which in the source is right for guides along the clamps' tangents only, and beyond
    folds, where the source continues from the last point on any branch that Newton's method finds.

    Examples
    --------
    The start pose of annex II.4, without load and without its rigid ends: each force is across its
    guide, so the drives carry no force.

    >>> turns = 0.0, 2 * np.pi/3, -2 * np.pi/3
    >>> start = solve(np.full((3, 1), -0.0782049), side=0.2 * np.sqrt(3), stiffness=0.0521860264,
    ...     **{f"{key}{k}": turn for key in ("theta", "guide") for k, turn in enumerate(turns, 1)})
    >>> round(float(start["phi"][0]) * 180 / np.pi, 4), abs(float(start["hold1"][0])) < 1e-8
    (60.0, True)
    """
    q, guides = np.asarray(inputs, float), {"guide1": guide1, "guide2": guide2, "guide3": guide3}
    if q.shape[:1] != (3,):
        raise ValueError(f"inputs must be those of three rods, (3, ...), got {q.shape}")
    check_count(inflections=inflections)
    check_not_negative("m", rigid_extension=rigid_extension)
    check_finite(force_x=force_x, force_y=force_y, moment=moment)
    check_number(theta1=theta1, theta2=theta2, theta3=theta3)
    check_number(**{n: g for n, g in guides.items() if g is not None})
    path = q.reshape(3, -1).T
    load, growth = loads_and_rates(
        q.shape[1:], load_rates, force_x=force_x, force_y=force_y, moment=moment
    )
    first_x, first_y, first_moment = load[0].tolist()
    problem = PlatformProblem(
        side,
        radius,
        length,
        stiffness,
        (theta1, theta2, theta3),
        guide_directions(guide1, guide2, guide3),
        tuple(path[0].tolist()),
        (first_x, first_y, first_moment),
        inflections,
    )
    path_and_loads = tuple(map(tuple, np.hstack([path, load]).tolist()))
    near = find_branch(problem, path_and_loads, mode, rigid_extension).vector
    there = np.isfinite(near[:, 0])
    robot = replace(problem.assembly, rigid_extension=np.full(3, rigid_extension))
    states = RodState(robot, near[there]).with_parts(inputs=path[there], load=load[there])
    found, _ = newton(states, columns(robot, "rods", "pose"))
    speed = np.broadcast_to(np.asarray(rate, float), q.shape).reshape(3, -1).T
    curves = {name: np.full(there.shape, np.nan) for name in QUANTITIES}
    for name, curve in zip(
        QUANTITIES, describe_equilibria(found, speed[there], growth[there]), strict=True
    ):
        curves[name][there] = curve
    return {name: curve.reshape(q.shape[1:]) for name, curve in curves.items()}


def guide_directions(*angle: float | None) -> ThreeNumbers | None:
    """Directions of all guides, or None without guides; ValueError if only some are given."""
    if all(a is None for a in angle):
        return None
    one, two, three = angle
    if one is None or two is None or three is None:
        raise ValueError(f"guide1, guide2, guide3 must be given together, got {angle}")
    return one, two, three


@reuse_nearby
def find_branch(
    problem: PlatformProblem,
    path: tuple[tuple[float, ...], ...],
    mode: int,
    rigid_extension: float,
) -> RodState:
    """Equilibria (n,) along a path of inputs and loads; NaN from the first unstable one on.

    At a symmetric platform two eigenvalues of the stiffness change their sign together, which the
    determinant does not show.
    """
    inputs, load = np.hsplit(np.array(path), 2)
    followed = follow(equilibrium_of_mode(problem, mode, rigid_extension), inputs=inputs, load=load)
    vector = followed.states.vector
    vector[np.arange(len(path)) > followed.crossed.min(initial=np.inf) - 1.0] = np.nan
    reached = RodState(followed.states.assembly, vector[np.isfinite(vector[:, 0])])
    vector[np.argmin(np.append(platform_is_stable(reached), False)) :] = np.nan
    return RodState(followed.states.assembly, vector)


def describe_equilibria(found: RodState, rate: Array, growth: Array) -> Array:
    """`QUANTITIES` (10, n) of equilibria (n,), for rates (n, 3) of their inputs and loads."""
    guide, slopes = found.assembly.guide, derivatives(found)
    pose_rates = (slopes.direct @ rate[..., None])[..., 0]
    pose_rates += (slopes.compliance @ growth[..., None])[..., 0]
    drive_loads = found.moment
    if guide is not None:
        drive_loads = (found.force @ np.array([1.0, -1.0j]) * guide).real
    return np.vstack([found.pose.T, pose_rates.T, -drive_loads.T, found.energy.sum(axis=-1)])


class DrivenRodPlatform(ClosedForm, function=solve):
    """Three clamped rods on one rigid platform, driven along guides (3PFR) or by motors (3RFR)."""

    method = "solver of three rods on a platform"
    takes_load_rates = True
    charts = (constant_orientation,)
    inverse = InverseProblem({"x": "x", "y": "y", "phi": "phi"}, follow_path, LED_ACCURACY)

    side: Length
    theta1: Angle
    theta2: Angle
    theta3: Angle
    guide1: Angle
    guide2: Angle
    guide3: Angle
    radius: Length
    force_x: VaryingForce
    force_y: VaryingForce
    moment: VaryingMoment
    mode: Annotated[int, OneOf(MODES)]
    inflections: Natural
    length: Length
    stiffness: BendingStiffness
    rigid_extension: Annotated[float, Quantity("m", Domain.NOT_NEGATIVE)]
