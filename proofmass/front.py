"""The front of what nothing else betters in both of two aims."""

import numpy as np
from numpy.typing import NDArray

from proofmass.analytic.numerics import Array


def nondominated(aims: Array) -> NDArray[np.intp]:
    """Which of the points (B, 2) no other one beats in both aims, the first aim rising.

    Points that are not finite are none of them.

    >>> nondominated(np.array([[1.0, 3.0], [2.0, 3.0], [3.0, 1.0], [2.0, 2.0]])).tolist()
    [0, 3, 2]
    """
    order = np.lexsort((aims[:, 1], aims[:, 0]))
    order = order[np.isfinite(aims[order]).all(axis=-1)]
    second = aims[order, 1]
    least = np.minimum.accumulate(np.concatenate([[np.inf], second]))[:-1]
    return np.asarray(order[second < least])
