"""Two clamped rods with their tips on one pin (2RFR), at rest under a dead load."""

import numpy as np
from numpy.typing import ArrayLike

from proofmass.analytic.numerics import Array
from proofmass.analytic.rods.pair import at_rest, pair
from proofmass.analytic.rods.rod_charts import equilibria
from proofmass.analytic.rods.rod_maps import motor_angles, workspace

__all__ = ["equilibria", "motor_angles", "solve", "workspace"]


def solve(
    s: ArrayLike, *, distance: float, theta1: float, theta2: float, force_x: float, force_y: float,
    pin_x: float, pin_y: float, moment1: float, moment2: float, push_x: float, push_y: float,
    length: float = 1.0, stiffness: float = 1.0,
) -> dict[str, Array]:
    r"""Shapes of both rods at arc lengths `s` from their clamps.

    ::

               P --> F            clamps at (-d/2, 0) and (d/2, 0), held at theta1 and theta2
             .' `.                n_1 + n_2 = F,  m(L) = 0 in both rods
           _/     \
         --@---d---@--

    Parameters
    ----------
    s : [m], in [0, length]  (...)
    distance : d, between the clamps [m]
    theta1, theta2 : tangents at the clamps [rad]
    force_x, force_y : F, dead load on the pin [N]
    pin_x, pin_y : first guess of the pin P [m]; it and the next two choose among the
        equilibria
    moment1, moment2 : first guess of the moments at the clamps [N m]
    push_x, push_y : first guess of the force n_1 on the tip of the first rod [N]
    length, stiffness : L [m], EI [N m^2], of each rod

    Returns
    -------
    dict of (...) arrays: x1, y1 [m], t1 [rad], m1 [N m] along the first rod, x2, ... along the
    second; pin_x, pin_y [m], hold1, hold2, the moments [N m] that hold the clamps, and energy of
    bending [J], the same everywhere.

    Raises
    ------
    ValueError
        Clamps out of reach, or a guess from which Newton's method finds no equilibrium.

    Notes
    -----
    Within 1e-9 L.  Source: Pérez Gámiz 2018, eqs 98-102 and Table 7, where the second clamp must
    stand at (0.3, 0), not at (0, 0.3) as printed.

    Examples
    --------
    The lowest of the equilibria at the inputs of Table 7, which it does not list:

    >>> both = solve([0.5, 1.0], distance=0.6, theta1=np.radians(40), theta2=np.radians(60),
    ...     force_x=0.3, force_y=-0.1, stiffness=0.0521860264, pin_x=0.19, pin_y=0.86,
    ...     moment1=0.086, moment2=-0.025, push_x=0.19, push_y=0.51)
    >>> [round(float(both[name][-1]), 5) for name in ("x1", "y1", "x2", "y2")]
    [0.18884, 0.86287, 0.18884, 0.86287]
    """
    arc = np.asarray(s, float)
    found = at_rest(pair(distance, length, stiffness), [theta1, theta2], [force_x, force_y],
                    [pin_x, pin_y], [moment1, moment2], [push_x, push_y])
    known: dict[str, Array] = {}
    for name, rods in zip("xytm", found.shape(arc.ravel() / length), strict=True):
        known |= {f"{name}{k}": rod.reshape(arc.shape) for k, rod in enumerate(rods, 1)}
    ends = {"pin_x": found.pose[0], "pin_y": found.pose[1], "hold1": -found.moment[0],
            "hold2": -found.moment[1], "energy": found.energy.sum()}
    return known | {name: np.full(arc.shape, value) for name, value in ends.items()}
