"""References of rigid bodies in contact: blocks and balls with dry friction and impacts."""

import numpy as np
from numpy.typing import ArrayLike

from proofmass.analytic.numerics import check_finite
from proofmass.base.arrays import Array


def check_restitution(restitution: float) -> None:
    """Raise a ValueError if a coefficient of restitution is not within [0, 1].

    >>> check_restitution(1.5)
    Traceback (most recent call last):
    ValueError: restitution must lie from 0 to 1 [1], got 1.5
    """
    if np.ndim(restitution) or not 0.0 <= restitution <= 1.0:
        raise ValueError(f"restitution must lie from 0 to 1 [1], got {restitution}")


def check_times(time: ArrayLike) -> Array:
    """Times [s] as an array, or a ValueError if one is before the start or not finite.

    >>> check_times([0.0, -1.0])
    Traceback (most recent call last):
    ValueError: time must not be negative [s]: an impact cannot be followed backwards, got -1.0
    """
    check_finite(time=time)
    t = np.asarray(time, float)
    if not np.all(t >= 0.0):
        raise ValueError(
            f"time must not be negative [s]: an impact cannot be followed backwards, got {t.min()}"
        )
    return t


def restitution(damping_ratio: float) -> float:
    """Coefficient of restitution [1] of an impact on a damped spring that can only push.

    It is the speed after the impact over that before it.  With the damping ratio z, and without
    other forces, contact ends when the force of spring and damper has fallen to zero, which is
    before the spring has its free length again. The body keeps the speed that it has then:

        e = exp(-2 z acos(z) / (1 - z^2)^(1/2))        z < 1
        e = exp(-2)                                    z = 1, MuJoCo's default
        e = exp(-2 z acosh(z) / (z^2 - 1)^(1/2))       z > 1

    Parameters
    ----------
    damping_ratio : float
        z [1], not negative.

    Returns
    -------
    float
        e [1].

    Raises
    ------
    ValueError
        A damping ratio that is negative or not finite.

    Examples
    --------
    >>> [round(restitution(z), 6) for z in (0.0, 0.1, 1.0, 10.0)]
    [1.0, 0.744079, 0.135335, 0.002438]
    """
    z = damping_ratio
    if np.ndim(z) or not 0.0 <= z < np.inf:
        raise ValueError(f"damping_ratio must be zero or positive [1], got {z}")
    if z == 1.0:
        return float(np.exp(-2.0))
    angle = np.arccos(z) if z < 1.0 else np.arccosh(z)
    # |1 - z| |1 + z|, not |1 - z^2|, which is a difference of nearly equal numbers for z near 1
    return float(np.exp(-2.0 * z * angle / (np.sqrt(abs(1.0 - z)) * np.sqrt(1.0 + z))))


DEFAULT_DAMPING_RATIO = 1.0
"""Damping ratio of MuJoCo's default `solref`, which replaces one of mixed format."""


def is_mixed(first: float, second: float) -> bool:
    """Whether one of the two numbers of a `solref` is positive and the other is not.

    >>> is_mixed(0.02, 0.0), is_mixed(-100.0, 0.0)
    (True, False)
    """
    return (first > 0) != (second > 0)


def damping_ratio(solref: ArrayLike) -> float:
    """Damping ratio [1] of MuJoCo's soft contacts and joint limits; NaN if `solref` has none.

    `solref` is a time constant and the damping ratio, or, with negative signs, a stiffness and a
    damping coefficient.  If only one of them is positive, MuJoCo takes its default instead, whose
    ratio is 1, with the warning "mixed solref format".

    >>> damping_ratio([0.02, 1.0]), damping_ratio([-100.0, -10.0]), damping_ratio([-100.0, 10.0])
    (1.0, 0.5, 1.0)
    """
    first, second = np.asarray(solref, float).tolist()
    if is_mixed(first, second):
        return DEFAULT_DAMPING_RATIO
    ratio = second if first > 0 else -second / (2.0 * np.sqrt(-first)) if first < 0 else np.nan
    return float(ratio) if ratio >= 0 else float("nan")
