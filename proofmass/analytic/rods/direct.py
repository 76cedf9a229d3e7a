"""Direct problem of flexible mechanisms: pose and forces from clamps and load."""

import numpy as np

from proofmass.analytic.rods.closure import newton
from proofmass.analytic.rods.state import State, columns


def direct(guess: State) -> State:
    r"""Equilibria at given inputs and load, each the one that its guess leads to.

    Parameters
    ----------
    guess : State (...)
        Its inputs and its load are kept; forces, clamp moments and pose are found.

    Returns
    -------
    State (...)
        Closed and balanced within 1e-10 of the sizes EI/L^2, EI/L and L.

    Raises
    ------
    ValueError
        Newton's method with halved steps finds none, or the guess is a straight rod without load,
        whose tip no force can move along it at first order.

    Notes
    -----
    There are several equilibria at the same inputs, stable or not: the guess chooses.  Source:
    Pérez Gámiz 2018, eqs 98, 102 (2RFR), 109, 112 (3PFR), with exact derivatives instead of
    forward differences.

    Examples
    --------
    Two rods that lean on each other, both bent outwards:

    >>> from proofmass.analytic.rods.assembly import assembly
    >>> from proofmass.analytic.rods.state import state
    >>> a = assembly([[-0.3, 0.0], [0.3, 0.0]])
    >>> found = direct(state(a, inputs=np.radians([60.0, 120.0]), pose=[0.0, 0.9],
    ...                      moment=[0.5, -0.5], force=[[-0.5, 0.0], [0.5, 0.0]]))
    >>> (found.pose.round(6) + 0.0).tolist()
    [0.0, 0.948938]
    """
    return settled(guess, "pose")


def settled(guess: State, found: str) -> State:
    """Forces, moments and "pose" or "inputs" of closed states; ValueError for the first failure."""
    flat = guess.vector.reshape(-1, guess.vector.shape[-1])
    result, _ = newton(State(guess.assembly, flat), columns(guess.assembly, "rods", found))
    lost = ~np.isfinite(result.vector).all(axis=-1)
    if lost.any():
        first = State(guess.assembly, flat[np.argmax(lost)])
        given = first.inputs if found == "pose" else first.pose
        raise ValueError(f"no equilibrium is found from the guess at "
                         f"{'inputs' if found == 'pose' else 'pose'} {given.tolist()}, load "
                         f"{first.load.tolist()}: begin nearer, or follow a path to it")
    return State(guess.assembly, result.vector.reshape(guess.vector.shape))
