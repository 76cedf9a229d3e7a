"""The classical Runge-Kutta step for engines that have accelerations but no steps."""

from __future__ import annotations

from collections.abc import Callable

from .mechanism import PlainArray

SlopesAt = Callable[[PlainArray, PlainArray, int], tuple]


def runge_kutta(stage: SlopesAt, first: tuple, step: int, length: float) -> tuple:
    """The changes of coordinates and rates in a step, of fourth order.

    Coordinates may be those of a manifold: their changes are then in its tangent space at the
    beginning of the step, and so are their slopes (Munthe-Kaas).

    Parameters
    ----------
    stage : callable
        ``stage(change, faster, half)`` are the slopes of coordinates and rates where they are
        changed by `change` and `faster`, at a half step number `half`.
    first : tuple of ndarray
        The slopes at the beginning of the step.
    step : int
        Number of the step; it begins at the half step ``2 step``.
    length : float
        Time step [s].

    Examples
    --------
    A body in free fall:

    >>> import numpy as np
    >>> def fall(change, faster, half):
    ...     return faster, np.array([-9.81])
    >>> change, faster = runge_kutta(fall, (np.zeros(1), np.array([-9.81])), 0, 2.0)
    >>> round(float(change[0]), 12), round(float(faster[0]), 12)
    (-19.62, -19.62)
    """
    slopes = [first]
    for share, half in ((0.5, 2 * step + 1), (0.5, 2 * step + 1), (1.0, 2 * step + 2)):
        change, faster = (share * length * part for part in slopes[-1])
        slopes.append(stage(change, faster, half))
    a, b, c, d = slopes
    change, faster = (
        length / 6.0 * (one + 2.0 * (two + three) + four)
        for one, two, three, four in zip(a, b, c, d)
    )
    return change, faster
