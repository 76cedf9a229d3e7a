"""All roots of a smooth function on an interval, many evaluated at a time."""

from collections.abc import Callable

import numpy as np

from proofmass.analytic.numerics import Array

Function = Callable[[Array], Array]
ZOOMS = 4  # a pair of roots is seen when farther apart than the grid's spacing/8^4
PARTS = 8


def roots(function: Function, grid: Array, *, most: int = 60) -> Array:
    """Roots of `function` between the rising values of `grid`, sorted.

    Sign changes of the grid, after it has been refined around each place where |f| has a lowest
    value without one; each is closed in by Ridders' method to rounding.

    >>> roots(lambda x: x**2 - 2e-6, np.linspace(-1.0, 1.2, 100)).round(9).tolist()
    [-0.001414214, 0.001414214]
    """
    x, f = np.asarray(grid, float), function(grid)
    for _ in range(ZOOMS):
        x, f = _refined(function, x, f)
    change = np.flatnonzero(np.signbit(f[1:]) != np.signbit(f[:-1]))
    return np.sort(_ridders(function, x[change], x[change + 1], f[change], f[change + 1], most))


def _refined(function: Function, x: Array, f: Array) -> tuple[Array, Array]:
    """The grid with points added around the lowest |f| of a sign."""
    size, low = np.abs(f), np.zeros(x.size, bool)
    here, before, after = size[1:-1], size[:-2], size[2:]
    low[1:-1] = ((here <= np.minimum(before, after)) & (f[1:-1] * f[:-2] > 0.0)
                 & (f[1:-1] * f[2:] > 0.0)
                 & (here <= np.maximum(before, after) - here))  # a parabola dips less than this
    cells = np.flatnonzero(low[1:] | low[:-1])
    if not cells.size:
        return x, f
    share = np.arange(1, PARTS) / PARTS
    new = (x[cells, None] + (x[cells + 1] - x[cells])[:, None] * share).ravel()
    merged = np.concatenate([x, new])
    order = np.argsort(merged)
    return merged[order], np.concatenate([f, function(new)])[order]


def _ridders(function: Function, a: Array, b: Array, fa: Array, fb: Array, most: int) -> Array:
    """Roots between a and b, where f has opposite signs."""
    for _ in range(most if a.size else 0):
        middle = 0.5 * (a + b)
        fm = function(middle)
        scale = np.sqrt(fm * fm - fa * fb)
        shift = np.sign(fa - fb) * fm / np.where(scale > 0.0, scale, 1.0)
        point = middle + (middle - a) * shift
        fp = function(point)
        ends, values = np.stack([a, b, middle, point]), np.stack([fa, fb, fm, fp])
        same = np.signbit(values) == np.signbit(fa)
        a, b = np.where(same, ends, -np.inf).max(axis=0), np.where(same, np.inf, ends).min(axis=0)
        fa, fb = _at(ends, values, a), _at(ends, values, b)
        if np.all((b - a <= 4e-16 * (1.0 + np.abs(a))) | (fb == 0.0) | (fa == 0.0)):
            break
    return np.where(np.abs(fa) <= np.abs(fb), a, b)


def _at(ends: Array, values: Array, chosen: Array) -> Array:
    return np.take_along_axis(values, np.argmax(ends == chosen, axis=0)[None], axis=0)[0]
