"""Clamped rod with a free tip under dead loads: all equilibria, the stable one, its shape.

The module also has the pseudo-rigid-body model: a cantilever as two rigid links with a torsion
spring.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import romb

from proofmass.analytic.numerics import TURN, check_finite, check_positive
from proofmass.analytic.rods.elastica import (
    arc_lengths,
    check_section_stiffnesses,
    check_stiffness,
    from_inflection,
)
from proofmass.analytic.rods.shooting import from_tip, stability
from proofmass.base.arrays import Array, Complex

Function = Callable[[Array], Array]
REFINEMENTS = 4  # of the grid: finds pairs of roots spacing/8^4 apart or more
CELL_PARTS = 8  # parts into which a refinement divides a cell


def roots(function: Function, grid: Array, *, max_iterations: int = 60) -> Array:
    """Roots of `function` between the rising values of `grid`, sorted.

    The grid is refined around each local minimum of |f| without a change of sign.  Each change of
    sign on the refined grid encloses a root, which Ridders' method finds to rounding.

    >>> roots(lambda x: x**2 - 2e-6, np.linspace(-1.0, 1.2, 100)).round(9).tolist()
    [-0.001414214, 0.001414214]
    """
    x, f = np.asarray(grid, float), function(grid)
    for _ in range(REFINEMENTS):
        x, f = _refine_grid(function, x, f)
    change = np.flatnonzero(np.signbit(f[1:]) != np.signbit(f[:-1]))
    return np.sort(
        _close_in(function, x[change], x[change + 1], f[change], f[change + 1], max_iterations)
    )


def _refine_grid(function: Function, x: Array, f: Array) -> tuple[Array, Array]:
    """The grid with points added around the local minima of |f| without a change of sign."""
    size, is_minimum = np.abs(f), np.zeros(x.size, bool)
    here, before, after = size[1:-1], size[:-2], size[2:]
    is_minimum[1:-1] = (
        (here <= np.minimum(before, after))
        & (f[1:-1] * f[:-2] > 0.0)
        & (f[1:-1] * f[2:] > 0.0)
        & (here <= np.maximum(before, after) - here)
    )  # otherwise a parabola through the three values does not reach zero
    cells = np.flatnonzero(is_minimum[1:] | is_minimum[:-1])
    if not cells.size:
        return x, f
    share = np.arange(1, CELL_PARTS) / CELL_PARTS
    new = (x[cells, None] + (x[cells + 1] - x[cells])[:, None] * share).ravel()
    merged = np.concatenate([x, new])
    order = np.argsort(merged)
    return merged[order], np.concatenate([f, function(new)])[order]


def _close_in(
    function: Function, a: Array, b: Array, fa: Array, fb: Array, max_iterations: int
) -> Array:
    """Roots between a and b, at which f has opposite signs."""
    for _ in range(max_iterations if a.size else 0):
        middle = 0.5 * (a + b)
        fm = function(middle)
        scale = np.sqrt(fm * fm - fa * fb)
        shift = np.sign(fa - fb) * fm / np.where(scale > 0.0, scale, 1.0)
        point = middle + (middle - a) * shift
        fp = function(point)
        ends, values = np.stack([a, b, middle, point]), np.stack([fa, fb, fm, fp])
        same = np.signbit(values) == np.signbit(fa)
        a, b = np.where(same, ends, -np.inf).max(axis=0), np.where(same, np.inf, ends).min(axis=0)
        fa, fb = _values_at(ends, values, a), _values_at(ends, values, b)
        remaining = (b - a) * np.minimum(1.0, np.minimum(np.abs(fa), np.abs(fb)) / np.abs(fb - fa))
        if np.all((remaining <= 4e-16 * (1.0 + np.abs(a))) | (fb == 0.0) | (fa == 0.0)):
            break  # a secant would no longer move the better end
    return np.where(np.abs(fa) <= np.abs(fb), a, b)


def _values_at(ends: Array, values: Array, chosen: Array) -> Array:
    """The values that belong to the chosen ones of the ends."""
    return np.take_along_axis(values, np.argmax(ends == chosen, axis=0)[None], axis=0)[0]


INTEGRAL_SAMPLES = 129  # samples along the rod for integrals by Romberg's rule, 2^7 + 1
MIN_SHOOTING_STEPS = 64  # least number of shooting steps along the rod, of order 8


@dataclass(frozen=True)
class Load:
    """A rod and its loads; forces are in the frame of the clamp, with x along its tangent."""

    length: float
    stiffness: float
    force: complex  # [N]
    moment: float  # [N m]
    weight: complex  # [N/m]
    axial: float  # EA [N]
    shear: float  # GA [N]
    follower: complex = 0.0  # [N], in the frame of the section at the tip, x along its normal

    @property
    def keywords(self) -> dict[str, Any]:
        """Keyword arguments of `from_tip` and `stability`."""
        return {
            "weight_x": self.weight.real,
            "weight_y": self.weight.imag,
            "length": self.length,
            "stiffness": self.stiffness,
            "axial": self.axial,
            "shear": self.shear,
        }

    @property
    def has_closed_form(self) -> bool:
        """Whether the rod has a closed form, by elliptic functions.

        The only load is then a force on the tip, which is an inflection.  The force does not pull
        along the clamp's tangent, and the rod neither stretches nor shears.
        """
        return (
            self.moment == 0.0
            and self.weight == 0.0
            and self.follower == 0.0
            and abs(np.sin(0.5 * self.psi)) > 1e-100
            and np.isinf(self.axial)
            and np.isinf(self.shear)
        )

    @property
    def psi(self) -> float:
        """The direction of the force [rad], in [0, 2 pi)."""
        return float(np.angle(self.force) % TURN)

    @property
    def waves(self) -> float:
        """L sqrt(R/EI) [1]."""
        return float(self.length * np.sqrt(abs(self.force) / self.stiffness))

    def tip_force(self, theta: Array) -> Complex:
        """Force (...) on a tip of angle `theta` [N]."""
        return np.asarray(self.force + self.follower * np.exp(1j * theta))

    def beyond(self, arc: Array, theta: Array) -> Complex:
        """Force (...) of the part of the rod beyond an arc length on the part before it [N]."""
        return self.tip_force(theta) + self.weight * (self.length - arc)


def solve(
    s: ArrayLike,
    *,
    length: float = 1.0,
    stiffness: float = 1.0,
    force_x: float = 0.0,
    force_y: float = 0.0,
    moment: float = 0.0,
    weight_x: float = 0.0,
    weight_y: float = 0.0,
    follower_x: float = 0.0,
    follower_y: float = 0.0,
    x0: float = 0.0,
    y0: float = 0.0,
    theta0: float = 0.0,
    axial: float = np.inf,
    shear: float = np.inf,
    branch: int = 1,
) -> dict[str, Array]:
    r"""Shape of a clamped rod under dead loads at arc lengths `s` from the clamp.

    ::

          \|  w, per length           EI theta' = m,   m(L) = M
        | ___                         m' = N_x sin(theta) - N_y cos(theta)
        |=   '--._  ) M               N = F + w (L - s)
        |         '-o
       (x0, y0)      \ F              all loads keep their directions

    A force alone at the tip is solved in closed form, with k the modulus that is looked for::

        k cd(L sqrt(R/EI), |k|) = cos(psi/2)

    and all other loads by shooting from the tip, whose angle is then the only unknown.  The same is
    done for a rod that stretches and shears, whose sections have normals of angle theta::

        x' + i y' = (1 + A/EA + i S/GA) exp(i theta),     m' = N_x y' - N_y x'
        A + i S = (N_x + i N_y) exp(-i theta)

    Parameters
    ----------
    s : [m], in [0, length], of the rod without load  (...)
    length, stiffness : L [m], EI [N m^2]
    force_x, force_y : F on the tip [N]
    moment : M on the tip [N m]
    weight_x, weight_y : w, dead load per length of rod [N/m]
    follower_x, follower_y : force on the tip along the normal of its section and to the left of
        it, which turns with it [N]
    x0, y0, theta0 : the clamp [m] and its tangent [rad]
    axial, shear : EA, and GA with the section's area of shear [N]; infinite: without that strain
    branch : 1 is the equilibrium of least potential energy, 2 the next (`equilibria`); a follower
        force has no potential energy and does not count in this order

    Returns
    -------
    dict of (...) arrays: x, y [m], theta [rad], unwrapped from the clamp's, m [N m], and force_x,
    force_y [N] of the part beyond s on the part before it.

    Raises
    ------
    ValueError
        A parameter out of its domain, an s beyond the rod, a branch that does not exist or in which
        the rod is compressed to zero length, 1 + A/EA <= 0.

    Notes
    -----
    The error is below 1e-13 L for a force alone and 1e-11 L otherwise, up to L sqrt(R/EI) of about
    10.  Of two equilibria that are mirror images, the one to the left comes first.  Source: Pérez
    Gámiz 2018, eq. 24-30 and 33-46, misprints of eq. 27-29 corrected (docs/errata.md); E. Reissner,
    J. Appl. Math. Phys. 23 (1972) 795-804 for the strains; K. E. Bisshopp and D. C. Drucker, Q.
    Appl. Math. 3 (1945) 272-275 for psi = pi/2.

    Examples
    --------
    >>> tip = solve(1.0, force_y=10.0)
    >>> [round(float(tip[name]), 10) for name in ("x", "y", "theta")]
    [0.4450044022, 0.8106090249, 1.4302855388]
    """
    load = _checked_load(
        length,
        stiffness,
        complex(force_x, force_y),
        moment,
        complex(weight_x, weight_y),
        theta0,
        axial,
        shear,
        complex(follower_x, follower_y),
    )
    check_finite(x0=x0, y0=y0)
    arc = arc_lengths(s, length)
    if not float(branch).is_integer():
        raise ValueError(f"branch must be a whole number, got {branch}")
    branch = int(branch)
    found = _equilibrium_tips(load)
    if not 1 <= branch <= found["tip"].size:
        raise ValueError(f"branch must be from 1 to {found['tip'].size}, got {branch}")
    place, theta, m = (
        v[0].reshape(arc.shape)
        for v in _shape(load, found["tip"][branch - 1 : branch], arc.ravel())
    )
    if found["least"][branch - 1] <= 0.0:
        raise ValueError(
            f"axial must be more than {axial:g} N: the loads compress the rod to zero length"
        )
    place = complex(x0, y0) + place * np.exp(1j * theta0)
    beyond = load.beyond(arc, found["theta"][branch - 1]) * np.exp(1j * theta0)
    return {
        "x": place.real,
        "y": place.imag,
        "theta": theta + theta0,
        "m": m,
        "force_x": beyond.real,
        "force_y": beyond.imag,
    }


def equilibria(
    *,
    length: float = 1.0,
    stiffness: float = 1.0,
    force_x: float = 0.0,
    force_y: float = 0.0,
    moment: float = 0.0,
    weight_x: float = 0.0,
    weight_y: float = 0.0,
    theta0: float = 0.0,
    axial: float = np.inf,
    shear: float = np.inf,
) -> dict[str, Array]:
    """All equilibria of the rod of `solve`, by rising potential energy.

    Returns
    -------
    dict of (branches,) arrays: theta [rad] of the tip; x, y [m] of the tip from the clamp; m0
    [N m]; energy of the strains [J]; potential [J], energy less F.p(L), the integral of w.p and
    M theta(L), with p and theta counted from the clamp; unstable, the number of negative
    directions.

    Notes
    -----
    The search is over the angle of the tip, with |theta_L - theta_0| <= L (|M| + |F| L/2 +
    |w| L^2/6)/EI for a rod that does not stretch, on a grid that is fine near rods in tension.  Of
    two equilibria closer than about 1e-6 rad (next to a fold) both may be missed.

    >>> found = equilibria(force_x=-3.0)                 # a column beyond pi^2/4 = 2.467
    >>> found["theta"].round(4).tolist(), found["unstable"].tolist()
    ([1.2245, -1.2245, 0.0], [0, 0, 1])
    """
    load = _checked_load(
        length,
        stiffness,
        complex(force_x, force_y),
        moment,
        complex(weight_x, weight_y),
        theta0,
        axial,
        shear,
    )
    found = dict(_equilibrium_tips(load))
    place = found.pop("place") * np.exp(1j * theta0)
    state = stability(load.force.real, load.force.imag, found["theta"], moment, **load.keywords)
    del found["tip"], found["least"]
    return {
        **found,
        "theta": found["theta"] + theta0,
        "x": place.real,
        "y": place.imag,
        "unstable": state.free,
    }


def _checked_load(
    length: float,
    stiffness: float,
    force: complex,
    moment: float,
    weight: complex,
    theta0: float,
    axial: float,
    shear: float,
    follower: complex = 0.0,
) -> Load:
    """The load of these arguments; ValueError for an argument out of its domain."""
    check_positive(length=length)
    check_stiffness(stiffness)
    check_section_stiffnesses(axial, shear)
    check_finite(
        force_x=force.real,
        force_y=force.imag,
        moment=moment,
        weight_x=weight.real,
        weight_y=weight.imag,
        theta0=theta0,
        follower_x=follower.real,
        follower_y=follower.imag,
    )
    turn = np.exp(-1j * theta0)
    return Load(
        length,
        stiffness,
        complex(force * turn),
        moment,
        complex(weight * turn),
        axial,
        shear,
        follower,
    )


@lru_cache(maxsize=64)
def _equilibrium_tips(load: Load) -> dict[str, Array]:
    """The tips of all equilibria in the clamp's frame, by rising potential energy."""
    tip = roots(lambda v: _clamp_angle(load, v), _search_grid(load))
    arc = np.linspace(0.0, load.length, INTEGRAL_SAMPLES)
    place, theta, m = _shape(load, tip, arc)
    step = arc[1]
    local = load.beyond(arc, theta[:, -1:]) * np.exp(-1j * theta)
    strained = m**2 / load.stiffness + local.real**2 / load.axial + local.imag**2 / load.shear
    energy = romb(strained, step) / 2.0
    work = (np.conj(load.force) * place[:, -1] + romb(np.conj(load.weight) * place, step)).real
    found = {
        "tip": tip,
        "theta": theta[:, -1],
        "place": place[:, -1],
        "m0": m[:, 0],
        "energy": energy,
        "potential": energy - work - load.moment * theta[:, -1],
        "least": 1.0 + local.real.min(axis=1) / load.axial,
    }
    scale = load.stiffness / load.length
    order = np.lexsort((-found["theta"], np.round(found["potential"] / scale, 9)))
    return {name: value[order] for name, value in found.items()}


def _search_grid(load: Load) -> Array:
    """Values of the unknown between which all equilibria lie.

    The unknown is artanh k for a force alone, with which K(k) grows evenly, else the tip's angle.
    """
    if load.has_closed_form:
        most = load.waves + 40.0 - np.log(np.sin(0.5 * load.psi))
        return np.linspace(-most, most, 801 + int(10.0 * load.waves * most))
    tip = abs(load.force) + abs(load.follower)
    mean = abs(load.moment) + tip * load.length / 2.0 + abs(load.weight) * load.length**2 / 6.0
    most = tip + abs(load.weight) * load.length
    reach = mean * load.length / load.stiffness * (1.0 + most / min(load.axial, load.shear))
    even = np.linspace(-reach - 0.01, reach + 0.013, 801 + int(40.0 * reach))
    near = np.geomspace(1e-13, 1.0, 53)
    load_angles = np.angle(load.force) + TURN * np.arange(-1, 2)[:, None]
    return np.unique(np.concatenate([even, *(load_angles - near), *(load_angles + near)]))


def _clamp_angle(load: Load, unknown: Array) -> Array:
    """Angle at the clamp [rad], which is zero in equilibrium."""
    return _shape(load, unknown, np.zeros(1))[1][:, 0]


def _shape(load: Load, unknown: Array, arc: Array) -> tuple[Array, Array, Array]:
    """Position (complex), angle and moment (unknowns, arcs) at arc lengths from the clamp."""
    if not load.has_closed_form:
        return _shape_by_shooting(load, unknown, arc)
    k, complement = np.tanh(unknown)[:, None], 1.0 / np.cosh(unknown)[:, None]
    unit, psi = load.length / load.waves, np.asarray(load.psi)
    x, y, theta, m = from_inflection(psi, k, complement, (load.length - arc) / unit)
    end_x, end_y, _, _ = from_inflection(psi, k, complement, np.asarray(load.waves))
    return unit * (end_x - x + 1j * (end_y - y)), theta, load.stiffness / unit * m


def _shape_by_shooting(load: Load, tip: Array, arc: Array) -> tuple[Array, Array, Array]:
    """The same as `_shape`, by shooting from tips of given angles."""
    back = load.length - arc
    nodes = np.unique(np.concatenate([np.linspace(0.0, load.length, MIN_SHOOTING_STEPS + 1), back]))
    force = load.tip_force(tip)
    rods = from_tip(force.real, force.imag, tip, load.moment, **load.keywords, nodes=nodes)
    at = np.searchsorted(nodes, back)
    place = rods.x + 1j * rods.y
    return (place[-1] - place[at]).T, rods.theta[at].T, -rods.m[at].T


RADIUS_FACTOR = 0.8517  # characteristic radius over the length, for a load across the rod
STIFFNESS_COEFFICIENT = 2.65  # stiffness coefficient K_Theta


def pseudo_rigid(
    force: ArrayLike,
    *,
    length: float = 1.0,
    stiffness: float = 1.0,
    radius: float = RADIUS_FACTOR,
    coefficient: float = STIFFNESS_COEFFICIENT,
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
    radius, coefficient : g and K_Theta [1]

    Returns
    -------
    dict of (...) arrays: x, y [m] of the tip, turn = Theta [rad].

    Raises
    ------
    ValueError
        A force that is not finite, or a parameter that is not positive.

    Notes
    -----
    This is an approximation: up to Theta = 64 deg the tip is within 1.5 % of the length from the
    elastica's.  It represents design practice and is not meant as an exact reference.  Source:
    L. L. Howell, Compliant Mechanisms, Wiley 2001, sec. 5.2.

    Examples
    --------
    >>> tip = pseudo_rigid(2.0)
    >>> round(float(tip["x"]), 4), round(float(tip["y"]), 4)
    (0.8435, 0.4921)
    """
    check_positive(length=length, radius=radius, coefficient=coefficient)
    check_stiffness(stiffness)
    check_finite(force=force)
    load_ratio = np.asarray(force, float) * length**2 / (coefficient * stiffness)
    turn = np.arctan(load_ratio)
    for _ in range(50):  # Newton's method on a monotone function, from between the root and pi/2
        turn = turn - (turn - load_ratio * np.cos(turn)) / (1.0 + load_ratio * np.sin(turn))
    return {
        "x": length * (1.0 - radius * (1.0 - np.cos(turn))),
        "y": length * radius * np.sin(turn),
        "turn": turn,
    }
