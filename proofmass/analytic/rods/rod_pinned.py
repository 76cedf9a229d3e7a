"""Rod from a clamp to a pin, at rest: the shape that a first guess of its force leads to."""

import numpy as np
from numpy.typing import ArrayLike

from proofmass.analytic.numerics import Array
from proofmass.analytic.rods.flow import flow
from proofmass.analytic.rods.pinned import pinned


def solve(
    s: ArrayLike, *, pin_x: float, pin_y: float, force_x: float, force_y: float, moment: float,
    length: float = 1.0, stiffness: float = 1.0, theta0: float = 0.0,
) -> dict[str, Array]:
    r"""Shape of a rod clamped at the origin with its tip pinned to a place, at arc lengths `s`.

    ::

        | __                          EI theta' = m,    m(L) = 0
        |=  `-._      .-o pin         m' = n_x sin(theta) - n_y cos(theta)
        |       `-..-'

    Parameters
    ----------
    s : [m], in [0, length]  (...)
    pin_x, pin_y : from the clamp [m]
    force_x, force_y : first guess of the pin's force on the tip [N]; it and the next one choose
        among the equilibria
    moment : first guess of the moment at the clamp [N m]
    length, stiffness, theta0 : L [m], EI [N m^2], tangent at the clamp [rad]

    Returns
    -------
    dict of (...) arrays: x, y [m], theta [rad], m [N m]; and force_x, force_y [N], the pin's, and
    hold [N m], the moment that holds the clamp.

    Raises
    ------
    ValueError
        A pin out of reach, or a guess from which Newton's method finds no equilibrium.

    Notes
    -----
    Within 1e-10 L for rods of few half waves.  Source: Pérez Gámiz 2018, sec. 11.4.1 and annex II
    lines 1616-1957, which prints no results.

    Examples
    --------
    >>> tip = solve(1.0, pin_x=0.8, pin_y=0.1, force_x=-20.0, force_y=-7.0, moment=-3.7)
    >>> [round(float(tip[name]), 6) for name in ("x", "y", "theta")]
    [0.8, 0.1, 1.254165]
    """
    arc = np.asarray(s, float)
    found = pinned(pin_x, pin_y, (force_x, force_y, moment), length=length, stiffness=stiffness,
                   theta0=theta0)
    if not found.converged:
        raise ValueError(f"force_x, force_y, moment = {force_x:g}, {force_y:g}, {moment:g} lead to "
                         f"no equilibrium; give a nearer guess")
    n = complex(*found.unknowns[:2])
    place, theta = flow(theta0, found.unknowns[2], n, arc, stiffness)
    m = found.unknowns[2] + (np.conj(n) * place[0]).imag
    return {"x": place[0].real, "y": place[0].imag, "theta": theta[0], "m": m,
            "force_x": np.full(arc.shape, n.real), "force_y": np.full(arc.shape, n.imag),
            "hold": np.full(arc.shape, -found.unknowns[2])}
