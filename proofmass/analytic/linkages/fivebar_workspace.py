r"""Planar five-bar linkage: where the tip can go, and which crank angles can be assembled.

::

        T                 L, R   crank pins        |L - R| in [|c - r|, c + r]: assembled
     c .' `. r            A, B   fixed pins        |T - A| in [|l - c|, l + c] and
     .'     `.            l, m   cranks            |T - B| in [|m - r|, m + r]: T in reach
   L '       ` R          c, r   couplers
   l \       / m          g      distance A-B
      A     B

Parameters are those of `fivebar.solve`: left_crank l, left_coupler c, right_coupler r, right_crank
m, left_x and right_x, all in [m]; a value that is not positive (for left_x, right_x: not finite)
is a ValueError. Sources: the workspace of two annuli is textbook, and so are the two types of
singularity (C. Gosselin and J. Angeles, IEEE Trans. Robotics and Automation 6, 1990); neither B.
Díaz Lozano, TFG, Universidad de Almería 2019, nor the five-bar notebook treats them.
"""

import numpy as np
from numpy.typing import ArrayLike

from proofmass.analytic.linkages.fivebar_inverse import check, inputs
from proofmass.analytic.numerics import Array


def margin(
    tip: ArrayLike, *, left_crank: float, left_coupler: float, right_coupler: float,
    right_crank: float, left_x: float, right_x: float,
) -> Array:
    """How far the tip is inside the reach of both sides [m], negative where it is outside.

    `tip` (x, y) [m], (2,) or (2, n); returns (n,) or a scalar, the least of its four radial
    distances to the bounding circles. On zero a crank and its coupler are in line: type 1.

    >>> link = dict(left_crank=4.0, left_coupler=5.0, right_coupler=5.0, right_crank=4.0,
    ...             left_x=-3.0, right_x=3.0)
    >>> margin([[0.0, 0.0], [0.0, 9.0]], **link).round(6).tolist()
    [2.0, -0.486833]
    """
    check(left_crank=left_crank, left_coupler=left_coupler, right_coupler=right_coupler,
          right_crank=right_crank, left_x=left_x, right_x=right_x)
    (x, y), = inputs(tip)
    left, right = np.hypot(x - left_x, y), np.hypot(x - right_x, y)
    return np.asarray(np.minimum.reduce([
        left - abs(left_crank - left_coupler), left_crank + left_coupler - left,
        right - abs(right_crank - right_coupler), right_crank + right_coupler - right]))


def boundary(
    n: int = 361, *, left_crank: float, left_coupler: float, right_coupler: float,
    right_crank: float, left_x: float, right_x: float,
) -> Array:
    """Points (4, 2, n) on the boundary of the reach: the type 1 singularities of the tip [m].

    Four circles of n points each: left stretched, left folded, right stretched, right folded; NaN
    where a circle runs outside the other side's reach.

    >>> link = dict(left_crank=4.0, left_coupler=5.0, right_coupler=5.0, right_crank=4.0,
    ...             left_x=-3.0, right_x=3.0)
    >>> boundary(5, **link)[0].round(3).tolist()  # left stretched, seen from the left base
    [[6.0, nan, nan, nan, 6.0], [0.0, nan, nan, nan, -0.0]]
    """
    lengths = {"left_crank": left_crank, "left_coupler": left_coupler,
               "right_coupler": right_coupler, "right_crank": right_crank}
    check(**lengths, left_x=left_x, right_x=right_x)
    base = np.array([left_x, left_x, right_x, right_x])[:, None]
    radius = np.array([left_crank + left_coupler, abs(left_crank - left_coupler),
                       right_crank + right_coupler, abs(right_crank - right_coupler)])[:, None]
    turn = np.linspace(0.0, 2.0 * np.pi, n)
    points = np.stack([base + radius * np.cos(turn), radius * np.sin(turn)])
    inside = margin(points, **lengths, left_x=left_x, right_x=right_x)
    rounding = 4.0 * np.finfo(float).eps * (radius + np.abs(base) + abs(right_x - left_x))
    return np.moveaxis(np.where(inside >= -rounding, points, np.nan), 0, 1)


def in_line(
    left: ArrayLike, *, left_crank: float, left_coupler: float, right_coupler: float,
    right_crank: float, left_x: float, right_x: float,
) -> Array:
    """Right crank angles (4, n) [rad] that put the couplers in line: type 2 singularities.

    `left` crank angle [rad], (n,). The first two rows are the stretched couplers, |L - R| = c + r,
    the others the folded ones, |L - R| = |c - r|; NaN where there is no such angle. Assembled are
    the angles between the first two rows and not between the last two.

    >>> link = dict(left_crank=2.0, left_coupler=3.5, right_coupler=4.0, right_crank=1.0,
    ...             left_x=0.0, right_x=2.0)
    >>> in_line(0.5, **link).round(6).tolist()
    [nan, nan, 1.312845, 2.328748]
    """
    check(left_crank=left_crank, left_coupler=left_coupler, right_coupler=right_coupler,
          right_crank=right_crank, left_x=left_x, right_x=right_x)
    s = left_x - right_x + left_crank * np.exp(1j * np.asarray(left, float))
    rows = []
    for apart in (left_coupler + right_coupler, abs(left_coupler - right_coupler)):
        with np.errstate(divide="ignore", invalid="ignore"):  # no such angle: nan, as documented
            open_by = np.arccos((np.abs(s) ** 2 + right_crank**2 - apart**2)
                                / (2.0 * np.abs(s) * right_crank))
        rows += [np.angle(s) - open_by, np.angle(s) + open_by]
    return np.stack(rows)


def pin_distances(
    *, left_crank: float, right_crank: float, left_x: float, right_x: float
) -> tuple[float, float]:
    """Least and largest distance of the crank pins [m] over all pairs of crank angles.

    The linkage can always be assembled if these lie within |c - r| and c + r.

    >>> pin_distances(left_crank=2.0, right_crank=0.5, left_x=0.0, right_x=1.0)
    (0.5, 3.5)
    """
    check(left_crank=left_crank, right_crank=right_crank, left_x=left_x, right_x=right_x)
    chain = (abs(right_x - left_x), left_crank, right_crank)
    return max(0.0, 2.0 * max(chain) - sum(chain)), sum(chain)


def unassembled_share(
    *, left_crank: float, left_coupler: float, right_coupler: float, right_crank: float,
    left_x: float, right_x: float,
) -> float:
    """Share [-] of all pairs of crank angles that cannot be assembled.

    At one left angle, with S = |L - B|, the share of right angles with |L - R| < x is
    arccos((S^2 + m^2 - x^2)/(2 S m))/pi, clipped. Its mean over the left angle is taken by Gauss
    quadrature between the angles where the clipping sets in; error below 1e-12.

    >>> round(unassembled_share(left_crank=2.0, left_coupler=3.5, right_coupler=4.0,
    ...                         right_crank=1.0, left_x=0.0, right_x=2.0), 8)
    0.02126519
    """
    check(left_crank=left_crank, left_coupler=left_coupler, right_coupler=right_coupler,
          right_crank=right_crank, left_x=left_x, right_x=right_x)
    ground, limits = abs(right_x - left_x), (left_coupler + right_coupler,
                                             abs(left_coupler - right_coupler))
    bends = np.array([right_crank + sign * x for x in limits for sign in (1, -1)])
    with np.errstate(divide="ignore"):  # ground = 0: S is constant, no bends
        cosines = (ground**2 + left_crank**2 - bends**2) / (2.0 * ground * left_crank)
    knots = np.array([0.0, *np.sort(np.arccos(cosines[np.abs(cosines) < 1.0])), np.pi])
    nodes, weights = np.polynomial.legendre.leggauss(64)
    u = 0.5 * np.pi * (nodes + 1.0)  # angle = middle - half cos(u): no square roots at the ends
    half = 0.5 * np.diff(knots)[:, None]
    angle = knots[:-1, None] + half * (1.0 - np.cos(u))
    s = np.abs(ground - left_crank * np.exp(1j * angle))
    over, under = (np.arccos(np.clip((s**2 + right_crank**2 - x**2) / (2.0 * s * right_crank),
                                     -1.0, 1.0)) for x in limits)
    assembled = np.sum((over - under) / np.pi * half * np.sin(u) * weights) / 2.0
    return float(1.0 - assembled)
