"""Ball that falls, bounces with a coefficient of restitution, and comes to rest."""

from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike

from proofmass.analytic.contacts import check_restitution, check_times
from proofmass.analytic.numerics import check_not_negative, check_number, check_positive
from proofmass.analytic.protocol import ClosedForm, Domain, Quantity, Ratio, Speed
from proofmass.base.arrays import Array


def solve(
    time: ArrayLike,
    *,
    height: float,
    restitution: float,
    speed: float = 0.0,
    gravity: float = 9.81,
) -> dict[str, Array]:
    r"""Vertical motion of a ball over a floor, with all its bounces until it rests.

    ::

        height
         |\
         | \      __
         |  \    /  \     _
         |   \  /    \   / \  _
        -|----\/------\-/---\/-\........ time
              t0               t_end, rests

    With w = sqrt(speed^2 + 2 g height), the speed of the first impact::

        t0 = (speed + w) / g                          first impact
        e^n w                                         speed after impact n = 1, 2, ...
        t_n = t0 + (2 w / g) (e + ... + e^n)          impact n + 1
        t_end = t0 + (2 w / g) e / (1 - e)            limit of the times of impact, e < 1

    and the height is a parabola between two impacts. From t_end on the ball rests.

    Parameters
    ----------
    time : [s], (...), not negative and finite
    height : of the lowest point over the floor at time 0 [m], not negative
    restitution : e, speed after an impact over that before it [1], 0 <= e <= 1
    speed : upwards at time 0 [m/s], of either sign
    gravity : [m/s^2], positive

    Returns
    -------
    dict of (...) arrays: height [m] of the lowest point, velocity [m/s] upwards, acceleration
    [m/s^2] between impacts, 0 at rest; bounces [1], number of impacts until then.

    Raises
    ------
    ValueError
        A parameter out of its domain, or a negative time.

    Notes
    -----
    Accuracy: rounding; the relative error of the time of an impact is below 1e-15. The number of
    impacts is computed by a logarithm and corrected by one where rounding makes it wrong. The ball
    counts as resting once 1e-15 of the time from t0 to t_end is left, and its number of bounces
    does not grow any more. Source: textbook mechanics.

    Examples
    --------
    >>> at = solve([0.0, 1.0, 1.5, 9.0], height=5.0, restitution=0.5, gravity=10.0)
    >>> at["height"].round(9).tolist(), at["bounces"].tolist()
    ([5.0, 0.0, 1.25, 0.0], [0.0, 1.0, 1.0, 51.0])
    """
    t = check_times(time)
    first, impact_speed = _first_impact(height, restitution, speed, gravity)
    e, flight = restitution, 2.0 * impact_speed / gravity
    elapsed = t - first
    end = rest_time(height=height, restitution=e, speed=speed, gravity=gravity)
    rests_at_once = e == 0.0 or flight == 0.0
    max_flights = (
        0.0 if rests_at_once else np.inf if e == 1.0 else np.ceil(np.log(1e-15) / np.log(e))
    )
    with np.errstate(all="ignore"):
        if rests_at_once:
            count = np.zeros(t.shape)
        elif e == 1.0:
            count = np.floor(elapsed / flight)
        else:
            share_gone = np.minimum(elapsed * (1.0 - e) / (flight * e), 1.0 - 1e-16)
            count = np.floor(np.log1p(-share_gone) / np.log(e))
        count = np.clip(np.nan_to_num(count), 0.0, max_flights)
        for _ in range(2):  # corrects the rounding of the logarithm
            count = count + (elapsed >= _time_of_flights(count + 1.0, e, flight)) * (
                count < max_flights
            )
            count = count - (elapsed < _time_of_flights(count, e, flight)) * (count > 0.0)
    take_off_speed = impact_speed * e ** (count + 1.0)
    flight_time = elapsed - _time_of_flights(count, e, flight)
    first_fall, rests = elapsed < 0.0, (t >= end) | ((count >= max_flights) & (elapsed >= 0.0))
    flying = (
        flight_time * (take_off_speed - 0.5 * gravity * flight_time),
        take_off_speed - gravity * flight_time,
    )
    falling = height + t * (speed - 0.5 * gravity * t), speed - gravity * t
    heights, v = (
        np.where(first_fall, one, np.where(rests, 0.0, other))
        for one, other in zip(falling, flying, strict=True)
    )
    return {
        "height": np.maximum(heights, 0.0),
        "velocity": v,
        "acceleration": np.where(rests & ~first_fall, 0.0, -gravity),
        "bounces": np.where(first_fall, 0.0, count + 1.0),
    }


def _time_of_flights(count: Array, e: float, flight: float) -> Array:
    """Time [s] from the first impact to the impact after `count` more flights."""
    if e in (0.0, 1.0):
        return flight * e * count
    # e (1 - e^n) / (1 - e), without the difference of nearly equal numbers for e near 1
    return flight * e * np.asarray(-np.expm1(count * np.log(e))) / (1.0 - e)


def _first_impact(
    height: float, restitution: float, speed: float, gravity: float
) -> tuple[float, float]:
    """Time [s] and speed [m/s] of the first impact."""
    check_not_negative("m", height=height)
    check_number(speed=speed)
    check_positive("m/s^2", gravity=gravity)
    check_restitution(restitution)
    impact_speed = float(np.sqrt(speed**2 + 2.0 * gravity * height))
    if speed < 0.0:  # this form has no difference of nearly equal numbers
        return 2.0 * height / (impact_speed - speed), impact_speed
    return (speed + impact_speed) / gravity, impact_speed


def rest_time(
    *, height: float, restitution: float, speed: float = 0.0, gravity: float = 9.81
) -> float:
    """Time at which the bounces accumulate [s], infinite for a restitution of 1.

    >>> rest_time(height=5.0, restitution=0.5, gravity=10.0)
    3.0
    """
    first, impact_speed = _first_impact(height, restitution, speed, gravity)
    if restitution == 1.0:
        return np.inf if impact_speed else first
    return first + 2.0 * impact_speed / gravity * restitution / (1.0 - restitution)


def properties(
    *, height: float, restitution: float, speed: float = 0.0, gravity: float = 9.81
) -> dict[str, str]:
    """First impact, greatest height after it, and the time when the ball rests, in words.

    >>> properties(height=5.0, restitution=0.5, gravity=10.0)["rests"]
    'from 3 s on'
    """
    first, impact_speed = _first_impact(height, restitution, speed, gravity)
    end = rest_time(height=height, restitution=restitution, speed=speed, gravity=gravity)
    top = (restitution * impact_speed) ** 2 / (2.0 * gravity)
    return {
        "first impact": f"at {first:.5g} s, with {impact_speed:.5g} m/s",
        "highest after it": f"{top:.5g} m",
        "rests": f"from {end:.5g} s on" if np.isfinite(end) else "never",
    }


class BouncingBall(ClosedForm, function=solve, properties=properties):
    """Ball that falls, bounces with a coefficient of restitution, and comes to rest."""

    height: Annotated[float, Quantity("m", Domain.NOT_NEGATIVE)]
    restitution: Ratio
    speed: Speed
    gravity: Annotated[float, Quantity("m/s^2", Domain.POSITIVE)]
