"""The pseudo-rigid-body model: a cantilever as two rigid links with a torsion spring."""

import numpy as np
from numpy.typing import ArrayLike

from proofmass.analytic.numerics import Array, positive
from proofmass.analytic.rods.elliptic import stiff

RADIUS = 0.8517  # of the length, for a load across the rod
STIFFNESS = 2.65  # coefficient K_Theta


def pseudo_rigid(
    force: ArrayLike, *, length: float = 1.0, stiffness: float = 1.0,
    radius: float = RADIUS, coefficient: float = STIFFNESS,
) -> dict[str, Array]:
    r"""Tip of a cantilever under a dead load across it, by the pseudo-rigid-body model.

    ::

                        o ^ F        link of g L turns by Theta against a spring K = g K_Theta EI/L
                    . '              K Theta = F g L cos(Theta)
        |=======o---------           x = L (1 - g (1 - cos(Theta))),   y = g L sin(Theta)
          1 - g     g

    Parameters
    ----------
    force : F [N] (...), along +y
    length, stiffness : L [m], EI [N m^2]
    radius, coefficient : g and K_Theta

    Returns
    -------
    dict of (...) arrays: x, y [m] of the tip, turn = Theta [rad].

    Notes
    -----
    An approximation: up to Theta = 64 deg the tip is within 1.5 % of the length of the elastica's.
    It stands for design practice, not for truth.  Source: L. L. Howell, Compliant Mechanisms,
    Wiley 2001, sec. 5.2.

    Examples
    --------
    >>> tip = pseudo_rigid(2.0)
    >>> round(float(tip["x"]), 4), round(float(tip["y"]), 4)
    (0.8435, 0.4921)
    """
    positive(length=length, radius=radius, coefficient=coefficient)
    stiff(stiffness)
    drive = np.asarray(force, float) * length**2 / (coefficient * stiffness)
    turn = np.arctan(drive)
    for _ in range(50):  # Newton on a monotone function, from between root and pi/2
        turn = turn - (turn - drive * np.cos(turn)) / (1.0 + drive * np.sin(turn))
    return {"x": length * (1.0 - radius * (1.0 - np.cos(turn))),
            "y": length * radius * np.sin(turn), "turn": turn}
