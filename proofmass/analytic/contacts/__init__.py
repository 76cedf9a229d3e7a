"""References of rigid bodies that touch: blocks and balls with dry friction and impacts."""

import numpy as np
from numpy.typing import ArrayLike

from proofmass.analytic.numerics import Array


def check_restitution(restitution: float) -> None:
    """ValueError where a coefficient of restitution is none.

    >>> check_restitution(1.5)
    Traceback (most recent call last):
    ValueError: restitution must lie from 0 to 1 [1], got 1.5
    """
    if not 0.0 <= restitution <= 1.0:
        raise ValueError(f"restitution must lie from 0 to 1 [1], got {restitution}")


def since_start(time: ArrayLike) -> Array:
    """Times [s] of a motion that is known from its start on, as an array.

    >>> since_start([0.0, -1.0])
    Traceback (most recent call last):
    ValueError: time must not be negative [s]: an impact cannot be followed backwards, got -1.0
    """
    t = np.asarray(time, float)
    if not np.all(t >= 0.0):
        raise ValueError(
            f"time must not be negative [s]: an impact cannot be followed backwards, got {t.min()}"
        )
    return t
