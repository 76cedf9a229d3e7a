"""The Pareto front of points with two aims, both to be small."""

import numpy as np
from numpy.typing import NDArray

from proofmass.base.arrays import Array


def nondominated_points(aims: Array) -> NDArray[np.intp]:
    """Indices of the nondominated ones of points (B, 2), in rising order of the first aim.

    A point that is not finite is never among them.

    >>> nondominated_points(np.array([[1.0, 3.0], [2.0, 3.0], [3.0, 1.0], [2.0, 2.0]])).tolist()
    [0, 3, 2]
    """
    order = np.lexsort((aims[:, 1], aims[:, 0]))
    order = order[np.isfinite(aims[order]).all(axis=-1)]
    second = aims[order, 1]
    least = np.minimum.accumulate(np.concatenate([[np.inf], second]))[:-1]
    return np.asarray(order[second < least])
