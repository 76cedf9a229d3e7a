"""Inputs of flexible rods that lead their platform, or their common pin, along a path.

Equilibria are continued from place to place, see `proofmass.analytic.rods.continuation`, and
resolved by Newton's method.  With z the unknowns (forces, clamp moments, inputs), u what is given
(pose, load) and J the exact Jacobian of the rows f(z, u) = 0 of the assembly::

    J_z z' = -J_u u'                  J_z z'' = -J_u u'' - (dJ/dt) (z', u')

dJ/dt is the derivative of J along the path, by central differences of fourth order of J.
"""

import numpy as np
from numpy.typing import ArrayLike

from proofmass.analytic.inverse import PathMotion
from proofmass.analytic.rods.continuation import follow
from proofmass.analytic.rods.equilibrium import (
    RodState,
    check_reach,
    check_square,
    closure,
    columns,
    newton,
    residual_and_state_sizes,
    solve_linear,
)
from proofmass.base.arrays import Array

MAX_LED_STEP = 0.02
"""Longest way between places from one of which an equilibrium is continued to the next [L, rad];
Newton's method then reaches the places between them in a few steps."""
LED_ACCURACY = 1e-10
"""Accuracy of inputs [share of their range]: equilibria are resolved to 1e-10 of L and EI/L^2."""
JACOBIAN_STRIDE = 1e-3
"""Change of the state, over its sizes, between the Jacobians whose differences give dJ/dt: with the
fourth order of the differences their error is 1e-12, as large as that of rounding."""
STENCIL = (-2.0, 1.0 / 12.0), (-1.0, -2.0 / 3.0), (1.0, 2.0 / 3.0), (2.0, -1.0 / 12.0)
"""Places and weights of central differences of fourth order."""


def lead_along(
    start: RodState, motion: PathMotion, load: Array, load_rate: Array, load_acceleration: Array
) -> tuple[Array, Array, Array]:
    """Inputs (k, n) that lead the platform along a path, with their rates and accelerations.

    Parameters
    ----------
    start : RodState
        One equilibrium, from which the first place is reached in a straight line.
    motion : PathMotion
        The pose [m, rad].
    load, load_rate, load_acceleration : ndarray (p, n)
        The dead load on the platform and its time derivatives [N, N m].

    Returns
    -------
    value, rate, acceleration : ndarray (k, n)
        [rad or m]; values are resolved to 1e-10 of the sizes of the assembly.

    Raises
    ------
    ValueError
        A place is out of reach of a rod, or the equilibrium ends at a fold before it.
    """
    check_square(start)
    pose, loads = motion.place.T, load.T
    states = RodState(start.assembly, np.tile(start.vector, (len(pose), 1)))
    states = states.with_parts(pose=pose, load=loads)
    check_reach(states)
    found, moved = newton(continue_along(start, states), columns(start.assembly, "rods", "inputs"))
    failed = ~np.isfinite(moved)
    if failed.any():
        raise ValueError(f"no equilibrium is found at {format_pose(pose[np.argmax(failed)])}")
    given = [
        np.concatenate([one.T, two.T], axis=1)
        for one, two in (
            (motion.rate, load_rate),
            (motion.acceleration, load_acceleration),
        )
    ]
    rate, acceleration = state_rates(found, *given)
    inputs = columns(start.assembly, "inputs")
    return found.inputs.T, rate[:, inputs].T, acceleration[:, inputs].T


def continue_along(start: RodState, states: RodState) -> RodState:
    """States near those of given poses and loads: continued at some of them, then interpolated.

    Raises
    ------
    ValueError
        The equilibrium cannot be continued to one of the poses.
    """
    a, pose, load = start.assembly, states.pose, states.load
    sizes = np.ones(pose.shape[1])
    sizes[:2] = a.length.mean()
    steps = np.linalg.norm(np.diff(pose, axis=0) / sizes, axis=1)
    way = np.append(0.0, np.cumsum(steps))
    stops = np.unique(np.append(0, np.searchsorted(way, np.arange(0.0, way[-1], MAX_LED_STEP))))
    stops = np.unique(np.append(stops, len(pose) - 1))
    path = follow(start, pose=pose[stops], load=load[stops])
    if path.why:
        k = int(path.reached)
        raise ValueError(
            f"the equilibrium cannot be led to {format_pose(pose[stops[k]])}: it ends at "
            f"{format_pose(path.last.pose)}, {path.why}"
        )
    vectors = path.states.vector
    place = np.interp(np.arange(len(pose)), stops, np.arange(stops.size))
    before = np.minimum(place.astype(int), max(stops.size - 2, 0))
    after = np.minimum(before + 1, stops.size - 1)
    share = (place - before)[:, None]
    near = RodState(a, (1.0 - share) * vectors[before] + share * vectors[after])
    return near.with_parts(pose=pose, load=load)


def state_rates(s: RodState, given_rate: Array, given_acceleration: Array) -> tuple[Array, Array]:
    """First and second time derivatives (n, 4 k + 2 p) of the vectors of states (n,).

    `given_rate` and `given_acceleration` (n, 2 p) are those of the pose and the load.
    """
    a = s.assembly
    unknown, given = columns(a, "rods", "inputs"), columns(a, "pose", "load")
    jacobian = closure(s)[1]

    def implied(given_part: Array, right: Array) -> Array:
        found = np.zeros_like(s.vector)
        found[:, given] = given_part
        right = right - (jacobian[..., given] @ given_part[..., None])[..., 0]
        found[:, unknown] = solve_linear(jacobian[..., unknown], right)
        return found

    rate = implied(given_rate, np.zeros(jacobian.shape[:2]))
    size = residual_and_state_sizes(a)[1]
    fastest = np.maximum((np.abs(rate) / size).max(axis=1, keepdims=True), np.finfo(float).tiny)
    stride = (
        JACOBIAN_STRIDE / fastest
    )  # seconds along the path in which the state changes that much
    bend = sum(
        weight * (closure(RodState(a, s.vector + place * stride * rate))[1] @ rate[..., None])
        for place, weight in STENCIL
    )
    return rate, implied(given_acceleration, -np.asarray(bend)[..., 0] / stride)


def load_parts(motion: PathMotion, **parts: ArrayLike) -> tuple[Array, Array, Array]:
    """Loads (p, n) along a path and their time derivatives, from the parts by name [N, N m]."""
    value, rate, acceleration = (
        np.array([np.broadcast_to(known.get(name, 0.0), motion.time.shape) for name in parts])
        for known in (parts, motion.load_rates, motion.load_accelerations)
    )
    return value, rate, acceleration


def format_pose(pose: Array) -> str:
    """A pose with its units.

    >>> format_pose(np.array([0.1, 0.2])), format_pose(np.array([0.1, 0.2, 0.3]))
    ('(0.1 m, 0.2 m)', '(0.1 m, 0.2 m, 0.3 rad)')
    """
    units = ("m", "m", "rad")[: pose.size]
    return f"({', '.join(f'{x:.6g} {unit}' for x, unit in zip(pose, units, strict=True))})"
