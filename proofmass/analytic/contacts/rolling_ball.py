"""Ball on a level floor with dry friction, which slides until it rolls."""

from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike

from proofmass.analytic.contacts import check_times
from proofmass.analytic.numerics import check_not_negative, check_number, check_positive
from proofmass.analytic.protocol import ClosedForm, Domain, Length, Quantity, Rate, Speed
from proofmass.base.arrays import Array

SPHERE_INERTIA_RATIO = 0.4
"""Moment of inertia of a solid sphere divided by m r^2 [1]; a solid disc has 0.5, a hoop 1."""


def solve(
    time: ArrayLike,
    *,
    radius: float,
    friction: float,
    speed: float,
    spin: float = 0.0,
    inertia_ratio: float = SPHERE_INERTIA_RATIO,
    gravity: float = 9.81,
) -> dict[str, Array]:
    r"""Motion of a ball or a disc on a level floor, from any speed and spin.

    ::

              spin, in the sense in which it would roll along x
             ---->
            /  o  \---> speed        slip u = velocity - radius spin, at the lowest point
            \_____/                  friction mu m g against the slip
        ------------------> x

    With k = I / (m r^2) and s = sign(u) at the start::

        v = speed - s mu g t             spin' = s mu g / (k r)
        u = u0 - s mu g (1 + 1/k) t      until u = 0 at t1 = |u0| / (mu g (1 + 1/k))
        v = r spin = (speed + k r spin0) / (1 + k)      from then on, without friction

    Parameters
    ----------
    time : [s], (...), not negative and finite
    radius : [m]
    friction : the coefficient mu [1]
    speed : speed of the centre at time 0, along x [m/s], of either sign
    spin : spin at time 0 [rad/s]; a negative one is backspin of a ball that moves along x
    inertia_ratio : k [1]: 2/5 for a solid sphere, 1/2 for a disc, 1 for a hoop
    gravity : [m/s^2]

    Returns
    -------
    dict of (...) arrays: position [m], velocity [m/s] and acceleration [m/s^2] of the centre along
    x; angle [rad], spin [rad/s] and spin_rate [rad/s^2] in the sense of rolling along x; slip [m/s]
    of the lowest point.

    Raises
    ------
    ValueError
        A parameter out of its domain, or a negative time.

    Notes
    -----
    Accuracy: rounding. Source: textbook mechanics; a sphere that starts without spin rolls at 5/7
    of its initial speed, for any friction that is not zero.

    Examples
    --------
    >>> late = solve(9.0, radius=0.1, friction=0.3, speed=7.0)
    >>> round(float(late["velocity"]), 12), round(float(late["spin"]), 12)
    (5.0, 50.0)
    """
    t = check_times(time)
    end, sliding_acceleration, rolling_speed = _sliding_phase(
        radius, friction, speed, spin, inertia_ratio, gravity
    )
    early, late = np.minimum(t, end), np.maximum(t - end, 0.0)
    spin_acceleration = -sliding_acceleration / (inertia_ratio * radius)
    slides = t < end
    return {
        "position": early * (speed + 0.5 * sliding_acceleration * early) + rolling_speed * late,
        "velocity": np.where(slides, speed + sliding_acceleration * early, rolling_speed),
        "acceleration": np.where(slides, sliding_acceleration, 0.0),
        "angle": early * (spin + 0.5 * spin_acceleration * early) + rolling_speed / radius * late,
        "spin": np.where(slides, spin + spin_acceleration * early, rolling_speed / radius),
        "spin_rate": np.where(slides, spin_acceleration, 0.0),
        "slip": np.where(
            slides,
            speed - radius * spin + (sliding_acceleration - radius * spin_acceleration) * early,
            0.0,
        ),
    }


def _sliding_phase(
    radius: float, friction: float, speed: float, spin: float, ratio: float, gravity: float
) -> tuple[float, float, float]:
    """Time when rolling begins [s], acceleration before it [m/s^2], speed after it [m/s]."""
    check_positive(radius=radius)
    check_positive("1", inertia_ratio=ratio)
    check_not_negative("1", friction=friction)
    check_not_negative("m/s^2", gravity=gravity)
    check_number(speed=speed, spin=spin)
    slip, deceleration = speed - radius * spin, friction * gravity
    rolling_speed = (speed + ratio * radius * spin) / (1.0 + ratio)
    if slip == 0.0:
        return 0.0, 0.0, rolling_speed
    if deceleration == 0.0:
        return np.inf, 0.0, rolling_speed
    return (
        abs(slip) / (deceleration * (1.0 + 1.0 / ratio)),
        -float(np.sign(slip)) * deceleration,
        rolling_speed,
    )


def roll_time(
    *,
    radius: float,
    friction: float,
    speed: float,
    spin: float = 0.0,
    inertia_ratio: float = SPHERE_INERTIA_RATIO,
    gravity: float = 9.81,
) -> float:
    """Time at which the ball begins to roll [s], infinite without friction.

    >>> round(roll_time(radius=0.1, friction=0.3, speed=7.0, gravity=10.0), 12)
    0.666666666667
    """
    return _sliding_phase(radius, friction, speed, spin, inertia_ratio, gravity)[0]


def properties(
    *,
    radius: float,
    friction: float,
    speed: float,
    spin: float = 0.0,
    inertia_ratio: float = SPHERE_INERTIA_RATIO,
    gravity: float = 9.81,
) -> dict[str, str]:
    """Time when the ball begins to roll, and its speed then, in words.

    >>> properties(radius=0.1, friction=0.3, speed=7.0, gravity=10.0)
    {'rolls': 'from 0.66667 s on, at 5 m/s'}
    """
    end, _, rolling_speed = _sliding_phase(radius, friction, speed, spin, inertia_ratio, gravity)
    if not np.isfinite(end):
        return {"rolls": "never"}
    return {"rolls": f"from {end:.5g} s on, at {rolling_speed:.5g} m/s"}


class RollingBall(ClosedForm, function=solve, properties=properties):
    """Ball on a level floor with dry friction, which slides until it rolls."""

    radius: Length
    friction: Annotated[float, Quantity("1", Domain.NOT_NEGATIVE)]
    speed: Speed
    spin: Rate
    inertia_ratio: Annotated[float, Quantity("1", Domain.POSITIVE)]
    gravity: Annotated[float, Quantity("m/s^2", Domain.NOT_NEGATIVE)]
