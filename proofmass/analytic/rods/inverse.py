"""Inverse problem of flexible mechanisms: motor angles or slides and forces from the pose."""

import numpy as np

from proofmass.analytic.rods.direct import settled
from proofmass.analytic.rods.state import State


def inverse(guess: State) -> State:
    r"""Inputs that hold the platform at given poses under given loads.

    Parameters
    ----------
    guess : State (...)
        Its pose and its load are kept; forces, clamp moments and inputs are found.

    Returns
    -------
    State (...)
        Closed and balanced within 1e-10 of the sizes EI/L^2, EI/L and L.

    Raises
    ------
    ValueError
        Inputs are more or less than the freedoms; a pose is out of reach of a rod; or Newton's
        method finds no equilibrium from the guess.

    Notes
    -----
    Source: Pérez Gámiz 2018, eqs 98, 99 (2RFR), 109, 111 (3PFR).  Its program has cos and sin of
    the clamp's angle in place of the guide's in the derivative by the slide, which is right only
    where they are the same.

    Examples
    --------
    >>> from proofmass.analytic.rods.assembly import assembly
    >>> from proofmass.analytic.rods.state import state
    >>> a = assembly([[-0.3, 0.0], [0.3, 0.0]])
    >>> found = inverse(state(a, inputs=[1.0, 2.0], pose=[0.0, 0.948938],
    ...                       moment=[0.5, -0.5], force=[[-0.5, 0.0], [0.5, 0.0]]))
    >>> np.degrees(found.inputs).round(2).tolist()
    [60.0, 120.0]
    """
    square(guess)
    within_reach(guess)
    return settled(guess, "inputs")


def square(s: State) -> None:
    """ValueError unless there are as many inputs as freedoms."""
    a = s.assembly
    if a.rods != a.freedoms:
        raise ValueError(f"the inverse problem needs as many rods as freedoms, got {a.rods} rods "
                         f"and {a.freedoms} freedoms")


def within_reach(s: State) -> None:
    """ValueError for the first pose whose pin is further from a clamp or guide than a rod is long.
    """
    a, (x, y, *phi) = s.assembly, np.moveaxis(s.pose, -1, 0)
    arm = a.arm * np.exp(1j * phi[0])[..., None] if phi else 0.0
    apart = (x + 1j * y)[..., None] + arm - a.clamp
    far = np.abs(apart) if a.guide is None else np.abs((apart * a.guide.conj()).imag)
    short = (far - (a.length + a.prolongation)).reshape(-1, a.rods)
    if short.max(initial=0.0) > 0.0:
        which, rod = np.unravel_index(np.argmax(short > 0.0), short.shape)
        pose = s.pose.reshape(-1, a.freedoms)[which].tolist()
        raise ValueError(f"pose {pose} is out of reach: rod {rod + 1} is too short by "
                         f"{short[which, rod]:.6g} m")
