"""Two rods alike on one pin, clamped beside each other: their assembly, and them at rest."""

import numpy as np
from numpy.typing import ArrayLike

from proofmass.analytic.rods.assembly import Assembly, assembly
from proofmass.analytic.rods.direct import direct
from proofmass.analytic.rods.state import State, state


def pair(distance: float, length: float = 1.0, stiffness: float = 1.0) -> Assembly:
    """Clamps at (-d/2, 0) and (d/2, 0) [m], each rod of length L [m] and stiffness EI [N m^2]."""
    return assembly([[-distance / 2, 0.0], [distance / 2, 0.0]], length=length, stiffness=stiffness)


def at_rest(a: Assembly, inputs: ArrayLike, load: ArrayLike, pin: ArrayLike, moment: ArrayLike,
            push: ArrayLike) -> State:
    """The equilibrium that a first guess leads to.

    Parameters
    ----------
    a : of `pair`
    inputs, load : angles of both clamps [rad]; force on the pin [N]
    pin, moment, push : first guess of the pin [m], the moments at the clamps [N m], and the force
        on the tip of the first rod [N]
    """
    return direct(state(a, inputs=inputs, load=load, pose=pin, moment=moment,
                        force=np.array([push, np.subtract(load, push)])))
