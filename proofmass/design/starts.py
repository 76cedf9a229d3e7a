"""Places in the unit cube to begin descents from."""

import numpy as np

from proofmass.analytic.numerics import Array

FACES = (0.1, 0.05)  # of all coordinates lie on their lower, on their upper bound
APART = 0.05  # places nearer than that to a better one are not worth a descent of their own


def scattered(count: int, d: int, rng: np.random.Generator) -> Array:
    """Random places (count, d), some coordinates on a face of the cube: many optima lie on one."""
    places, face = rng.random((2, count, d))
    return np.where(face < FACES[0], 0.0, np.where(face > 1.0 - FACES[1], 1.0, places))


def apart(places: Array, values: Array, most: int) -> Array:
    """The best places of finite value, no two near each other: their numbers, best first.

    >>> places = np.array([[0.0], [0.01], [0.5], [1.0]])
    >>> apart(places, np.array([3.0, 1.0, 2.0, np.inf]), most=3).tolist()
    [1, 2]
    """
    chosen: list[int] = []
    for k in np.argsort(values, kind="stable"):
        gaps = np.abs(places[chosen] - places[k]).max(axis=-1)
        if len(chosen) < most and np.isfinite(values[k]) and (gaps > APART).all():
            chosen.append(int(k))
    return np.array(chosen, int)
