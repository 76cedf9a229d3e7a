"""A rod from a clamp to a pin at a given place: its force and moment by shooting with Newton.

Rod from a clamp to a pin, at rest: the shape that a first guess of its force leads to.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from proofmass.analytic.numerics import Array
from proofmass.analytic.rods.equilibrium import flow
from proofmass.analytic.rods.shooting import ShotRods, integrate

System = Callable[[Array], tuple[Array, Array]]


@dataclass(frozen=True)
class Shot:
    """Where Newton's method ended: (n_x, n_y, m0) [N, N m], the rod, and how it got there."""

    unknowns: Array
    rod: ShotRods
    iterations: int
    residual: float  # largest of the tip's misses [m] and its moment [N m]
    converged: bool


def pinned(
    x: float,
    y: float,
    guess: ArrayLike,
    *,
    theta0: float = 0.0,
    length: float = 1.0,
    stiffness: float = 1.0,
    nodes: int = 81,
    scheme: str = "dop853",
    exact: bool = True,
    tolerance: float = 1e-12,
) -> Shot:
    r"""Force and clamp moment that bring the moment-free tip of a rod to (x, y).

    ::

        f(n_x, n_y, m0) = [x(L) - x, y(L) - y, m(L)] = 0

    by Newton's method, a step halved for as long as the largest |f| grows.  Which of the many
    equilibria is found depends on the guess.

    Parameters
    ----------
    x, y : the pin, from the clamp [m]
    guess : (n_x, n_y, m0) to begin with [N, N m]
    theta0, length, stiffness : clamp's tangent [rad], L [m], EI [N m^2]
    nodes, scheme : of `integrate`
    exact : Jacobian by the variational equations; otherwise the document's forward differences
    tolerance : largest |f| of a root [m, N m]

    Raises
    ------
    ValueError
        A pin farther away than the rod is long, or a parameter out of its domain.

    Notes
    -----
    Source: Pérez Gámiz 2018, sec. 11.4.1 and annex II lines 1616-1957: RK4 with 61 nodes, forward
    differences of 1e-10, tolerance 1e-7, no halving below a step of 1e-3 of it, and an end where
    |f| no longer changes.  It calls the problem direct (line 370) and inverse (annex).

    Examples
    --------
    >>> found = pinned(0.8, 0.1, (0.1, 0.1, 0.1), stiffness=0.16493361431, nodes=121)
    >>> found.unknowns.round(6).tolist(), found.converged
    ([-3.230877, -1.163408, -0.607639], True)
    """
    if not np.hypot(x, y) <= length:
        raise ValueError(f"length must reach the pin, {np.hypot(x, y):.6g} m away, got {length}")
    shoot = partial(
        integrate, theta0=theta0, length=length, stiffness=stiffness, nodes=nodes, scheme=scheme
    )
    target = np.array([x, y, 0.0])

    def miss(unknowns: Array) -> Array:
        rod = shoot(*unknowns)
        return np.array([rod.x[-1], rod.y[-1], rod.m[-1]]) - target

    def system(unknowns: Array) -> tuple[Array, Array]:
        rod = shoot(*unknowns, slopes=True)
        return (np.array([rod.x[-1], rod.y[-1], rod.m[-1]]) - target, rod.slope[-1][[2, 3, 1], :3])

    start = np.array(guess, float)
    root, count, size = newton(miss, system if exact else differences(miss), start, tolerance)
    return Shot(root, shoot(*root), count, size, size <= tolerance)


def differences(miss: Callable[[Array], Array], step: float = 1e-10) -> System:
    """Residual and Jacobian by forward differences."""

    def system(x: Array) -> tuple[Array, Array]:
        f = miss(x)
        return f, np.column_stack([(miss(x + step * unit) - f) / step for unit in np.eye(x.size)])

    return system


def newton(
    miss: Callable[[Array], Array], system: System, x: Array, tolerance: float, most: int = 200
) -> tuple[Array, int, float]:
    """The document's iteration: root, steps taken, and the largest residual left there."""
    f, jacobian = system(x)
    size = np.abs(f).max()
    for count in range(most):
        if size <= tolerance or not np.isfinite(size):
            return x, count, float(size)
        step = np.linalg.solve(jacobian, f)
        after = np.abs(miss(x - step)).max()
        while not after <= size and np.abs(step).max() > 1e-3 * tolerance:
            step = 0.5 * step
            after = np.abs(miss(x - step)).max()
        x = x - step
        if abs(after - size) <= tolerance:
            return x, count + 1, float(after)
        (f, jacobian), size = system(x), after
    return x, most, float(size)


def solve(
    s: ArrayLike,
    *,
    pin_x: float,
    pin_y: float,
    force_x: float,
    force_y: float,
    moment: float,
    length: float = 1.0,
    stiffness: float = 1.0,
    theta0: float = 0.0,
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
    found = pinned(
        pin_x, pin_y, (force_x, force_y, moment), length=length, stiffness=stiffness, theta0=theta0
    )
    if not found.converged:
        raise ValueError(
            f"force_x, force_y, moment = {force_x:g}, {force_y:g}, {moment:g} lead to "
            f"no equilibrium; give a nearer guess"
        )
    n = complex(*found.unknowns[:2])
    place, theta = flow(theta0, found.unknowns[2], n, arc, stiffness)
    m = found.unknowns[2] + (np.conj(n) * place[0]).imag
    return {
        "x": place[0].real,
        "y": place[0].imag,
        "theta": theta[0],
        "m": m,
        "force_x": np.full(arc.shape, n.real),
        "force_y": np.full(arc.shape, n.imag),
        "hold": np.full(arc.shape, -found.unknowns[2]),
    }
