"""Two clamped rods with their tips on one pin (2RFR), led by their motors through equilibria."""

import numpy as np
from numpy.typing import ArrayLike

from proofmass.analytic.numerics import Array, finite
from proofmass.analytic.remember import nearby
from proofmass.analytic.rods.continuation import follow
from proofmass.analytic.rods.equilibrium import RodState, columns, derivatives, direct, newton
from proofmass.analytic.rods.rod_pair import pair

PairNumbers = tuple[float, ...]


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
    force_x: float = 0.0,
    force_y: float = 0.0,
    length: float = 1.0,
    stiffness: float = 1.0,
) -> dict[str, Array]:
    r"""Equilibria of two rods on one pin, followed along the motions of their motors.

    ::

               P --> F            clamps at (-d/2, 0) and (d/2, 0), turned to theta1 and theta2
             .' `.                n_1 + n_2 = F,  m(L) = 0 in both rods
           _/     \
         --@---d---@--            dP/dt = dP/dtheta dtheta/dt at rest: no inertia
        theta1    theta2

    Parameters
    ----------
    angle : theta1, theta2 [rad] in order of the motion, (2, n)
    rate : their rates [rad/s], which broadcast with `angle`
    acceleration : [rad/s^2] is not used; equilibria are as slow as one likes
    distance : d, between the clamps [m]
    pin_x, pin_y : first guess of the pin P at the first angles [m]; it and the next two choose
        among the equilibria
    moment1, moment2 : first guess of the moments at the clamps [N m]
    push_x, push_y : first guess of the force n_1 on the tip of the first rod [N]
    force_x, force_y : F, dead load on the pin [N]
    length, stiffness : L [m], EI [N m^2], of each rod

    Returns
    -------
    dict of (n,) arrays: pin_x, pin_y [m], pin_vx, pin_vy [m/s], tip1, tip2, tangents at the pin
    [rad], hold1, hold2, the moments of the motors [N m], push_x, push_y, n_1 [N], energy of bending
    [J], pin_stiffness, the least of the pin [N/m].  NaN from the first sample behind a fold, where
    the pin has lost its stiffness and leaves the branch.

    Raises
    ------
    ValueError
        Angles of another shape, clamps out of reach, or a guess from which Newton's method finds no
        equilibrium.

    Notes
    -----
    Between samples the motors turn in proportion to each other.  A branch point, which needs
    symmetry, is passed straight on.  Closed and balanced within 1e-10 of L and EI/L^2; rates are
    derivatives of that, within 1e-9 m/rad on the line below, 0.2 rad off a fold.
    Source of the motions: Pérez Gámiz 2018, text lines 2924-4013, which prints no results.

    Examples
    --------
    The document's line, one radian of the first motor without load, and as far the other way:

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
    finite(angle=theta.sum(), rate=np.sum(rate))
    problem = distance, length, stiffness, force_x, force_y
    guess = pin_x, pin_y, moment1, moment2, push_x, push_y
    near = branch(tuple(map(tuple, theta.T.tolist())), problem, guess)
    there = np.isfinite(near.vector[:, 0])
    first = begun(near.vector[there], *problem).replaced(inputs=theta.T[there])
    states, _ = newton(first, columns(near.assembly, "rods", "pose"))
    curves = described(states, np.broadcast_to(rate, theta.shape)[:, there])
    found = {name: np.full(there.size, np.nan) for name in curves}
    for name, values in curves.items():
        found[name][there] = values
    return found


@nearby
def branch(
    path: tuple[tuple[float, ...], ...], problem: PairNumbers, guess: PairNumbers
) -> RodState:
    """Equilibria (n,) along a path of the motors, NaN behind a fold.

    Newton's method goes on from there to problems of more digits, of which sensitivities want many.
    """
    pin_x, pin_y, moment1, moment2, *push = guess
    rods = [moment1, *push, moment2, *np.subtract(problem[-2:], push)]
    first = direct(begun(np.array([*rods, pin_x, pin_y, *path[0], 0.0, 0.0]), *problem))
    return followed(path, problem, tuple(first.vector.tolist()))


@nearby
def followed(
    path: tuple[tuple[float, ...], ...], problem: PairNumbers, first: PairNumbers
) -> RodState:
    """The same from an equilibrium, to which many guesses lead."""
    return follow(begun(np.array(first), *problem), inputs=path).states


def begun(
    vector: Array, distance: float, length: float, stiffness: float, force_x: float, force_y: float
) -> RodState:
    """States of a pair of rods with these vectors, under its load."""
    return RodState(pair(distance, length, stiffness), vector).replaced(load=[force_x, force_y])


def described(s: RodState, rate: Array) -> dict[str, Array]:
    """Quantities (n,) of equilibria whose motors turn at rates (2, n)."""
    slopes = derivatives(s)
    velocity = np.einsum("npk,kn->pn", slopes.direct, rate)
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
