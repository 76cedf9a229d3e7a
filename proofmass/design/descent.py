"""Levenberg's and Marquardt's method in the unit cube, from many places side by side.

It slides along the faces of the cube, but not along the edge of what is not possible inside: a
descent that comes there stops, and another one has to find the way round.
"""

from collections.abc import Callable

import numpy as np

from proofmass.analytic.numerics import Array

NUDGE = 1e-6  # for differences of terms that are exact to 1e-12
FACTORS = np.array([0.1, 1.0, 10.0])  # of the damping, tried side by side
BACK = 1e3  # factor of the damping when no trial is better
STUCK = 1e8  # a damping at which no step goes down any more
LEAST = 1e-9
GAIN = 1e-7  # relative; less is not better
Terms = Callable[[Array], Array]


def norms(terms: Terms, places: Array) -> Array:
    """Roots of the sums of squares (B,); inf for what is not possible."""
    found = np.linalg.norm(terms(places), axis=-1)
    return np.where(np.isfinite(found), found, np.inf)


def descend(places: Array, values: Array, damping: Array,
            terms: Terms) -> tuple[Array, Array, Array]:
    """One step from every place (B, d) that is not stuck, never up.

    Parameters
    ----------
    places, values : ndarray (B, d), (B,)
        Where the descents stand, and the roots of their sums of squares.
    damping : ndarray (B,)
        Of each descent; above `STUCK` it is at its end.
    terms : callable
        Terms (B, m) of the sums of squares at places (B, d); NaN for what is not possible.
    """
    left = np.flatnonzero((damping <= STUCK) & np.isfinite(values))
    places, values = places.copy(), values.copy()
    damping = np.where(np.isfinite(values), damping, np.inf)
    if not left.size:
        return places, values, damping
    tried = trials(places[left], damping[left], terms)
    sizes = norms(terms, tried.reshape(-1, places.shape[1])).reshape(tried.shape[:2])
    best, row = sizes.argmin(axis=-1), np.arange(left.size)
    better = sizes[row, best] < values[left] * (1.0 - GAIN)
    damping[left] = np.maximum(damping[left] * np.where(better, FACTORS[best], BACK), LEAST)
    places[left[better]] = tried[row, best][better]
    values[left[better]] = sizes[row, best][better]
    return places, values, damping


def trials(places: Array, damping: Array, terms: Terms) -> Array:
    """Where each damping leads to from each place: (B, F, d).

    ::

        (J^T J + damping diag(J^T J)) step = -J^T r,    for the coordinates that are free to move

    A coordinate on a face of the cube is not free if the sum of squares falls towards the outside.
    """
    r, slopes = linear(places, terms)
    pull, bend = (slopes @ r[..., None])[..., 0], slopes @ slopes.swapaxes(-1, -2)
    free = ~(((places <= 0.0) & (pull > 0.0)) | ((places >= 1.0) & (pull < 0.0)))
    bend = bend * (free[:, :, None] & free[:, None, :])
    size = np.einsum("bii->bi", bend) + ~free + 1e-15  # a term that nothing changes stays solvable
    added = damping[:, None, None] * FACTORS[:, None] * size[:, None] + ~free[:, None]
    matrix = bend[:, None] + added[..., None] * np.eye(places.shape[1])
    step = np.linalg.solve(matrix, -(pull * free)[:, None, :, None])[..., 0]
    return np.clip(places[:, None] + step, 0.0, 1.0)


def linear(places: Array, terms: Terms) -> tuple[Array, Array]:
    """Terms (B, m) and their slopes (B, d, m), by differences that stay within the cube."""
    count, d = places.shape
    nudge = np.where(places > 0.5, -NUDGE, NUDGE)
    near = places[:, None] + nudge[..., None] * np.eye(d)
    found = terms(np.concatenate([places[:, None], near], axis=1).reshape(-1, d))
    found = found.reshape(count, d + 1, -1)
    return found[:, 0], np.nan_to_num((found[:, 1:] - found[:, :1]) / nudge[..., None])
