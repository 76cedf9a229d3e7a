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


def restitution(damping_ratio: float) -> float:
    """Speed after an impact over that before it [1], of a damped spring that can only push.

    With the damping ratio z, and without other forces, the spring lets go where its force has
    fallen to zero, before it has its length again, and the body keeps the speed it has then:

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

    Examples
    --------
    >>> [round(restitution(z), 6) for z in (0.0, 0.1, 1.0, 10.0)]
    [1.0, 0.744079, 0.135335, 0.002438]
    """
    z = damping_ratio
    if abs(z - 1.0) < 1e-6:  # the limit, to rounding of the quotient
        return float(np.exp(-2.0))
    angle = np.arccos(z) if z < 1.0 else np.arccosh(z)
    return float(np.exp(-2.0 * z * angle / np.sqrt(abs(1.0 - z * z))))


def damping_ratio(solref: ArrayLike) -> float:
    """The damping ratio [1] of MuJoCo's soft contacts and limits; NaN if they have none.

    `solref` is a time constant and the ratio itself, or, both negative, a stiffness and a damping.

    >>> damping_ratio([0.02, 1.0]), damping_ratio([-100.0, -10.0])
    (1.0, 0.5)
    """
    first, second = np.asarray(solref, float).tolist()
    ratio = second if first > 0 else -second / (2.0 * np.sqrt(-first)) if first < 0 else np.nan
    return float(ratio) if ratio >= 0 else float("nan")
