"""Equal balls in a row that hit each other, one impact after the other."""

from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike

from proofmass.analytic.contacts import check_restitution, check_times
from proofmass.analytic.numerics import check_not_negative, check_positive
from proofmass.analytic.protocol import ClosedForm, Domain, Length, Natural, Quantity, Ratio
from proofmass.base.arrays import Array

MAX_IMPACTS = 10_000
"""Largest number of impacts that are computed."""


def solve(
    time: ArrayLike,
    *,
    balls: int,
    radius: float,
    gap: float,
    speed: float,
    restitution: float = 1.0,
) -> dict[str, Array]:
    r"""Motion of a row of equal balls on a line, of which the first one hits the others.

    ::

        speed
         --->   gap
        (1)     |  (2)  (3)  (4)  (5)
        ---------------------------------> x
         0       2 radius + gap

    In an impact of two neighbours with the velocities v and w::

        v' = ((1 - e) v + (1 + e) w) / 2          v' + w' = v + w: momentum is conserved
        w' = ((1 + e) v + (1 - e) w) / 2          w' - v' = e (v - w): restitution

    and between impacts each ball keeps its velocity. Elastic balls exchange their velocities, so
    that the last ball gets the whole speed of the first one. Balls that touch are the limit of
    small gaps; if they are elastic, the order of the impacts makes no difference.

    Parameters
    ----------
    time : [s], (...), not negative and finite
    balls : number of balls [1], from 2 to `MAX_IMPACTS`
    radius : radius of each ball [m]
    gap : distance between the surfaces of neighbours at time 0 [m]; 0 for elastic balls only
    speed : of the first ball at time 0 [m/s], positive
    restitution : e [1], 0 <= e <= 1

    Returns
    -------
    dict of (...) arrays: x1, x2, ... [m], positions of the centres, measured from that of the first
    ball at time 0; v1, v2, ... [m/s], their velocities, at the instant of an impact those after it;
    impacts [1], number of impacts until then.

    Raises
    ------
    ValueError
        A parameter out of its domain, a negative time, or more than `MAX_IMPACTS` impacts, which
        inelastic balls may have within a finite time.

    Notes
    -----
    Accuracy: rounding. The floor has no friction and the balls do not turn. Source: textbook
    mechanics.

    Examples
    --------
    >>> late = solve(1.0, balls=3, radius=0.1, gap=0.05, speed=2.0)
    >>> [round(float(late[name]), 12) for name in ("x1", "x2", "x3", "v1", "v3")]
    [0.05, 0.3, 2.4, 0.0, 2.0]
    """
    t = check_times(time)
    starts, places, speeds = _follow_impacts(
        balls, radius, gap, speed, restitution, float(t.max(initial=0.0))
    )
    last_impact = np.searchsorted(starts, t, side="right") - 1
    x = places[last_impact] + speeds[last_impact] * (t - starts[last_impact])[..., None]
    v = speeds[last_impact]
    numbers = range(int(balls))
    return {
        **{f"x{k + 1}": x[..., k] for k in numbers},
        **{f"v{k + 1}": v[..., k] for k in numbers},
        "impacts": last_impact.astype(float),
    }


def _follow_impacts(
    balls: int, radius: float, gap: float, speed: float, e: float, until: float
) -> tuple[Array, Array, Array]:
    """Times (n,) [s] of start and impacts, and positions and velocities (n, balls) after them."""
    if np.ndim(balls) or not (2 <= balls <= MAX_IMPACTS and balls == int(balls)):
        raise ValueError(f"balls must be a whole number from 2 to {MAX_IMPACTS}, got {balls}")
    check_positive(radius=radius)
    check_positive("m/s", speed=speed)
    check_not_negative("m", gap=gap)
    check_restitution(e)
    if gap == 0.0 and e < 1.0:
        raise ValueError(
            f"gap must be positive [m]: the motion of inelastic balls that touch depends on the "
            f"order of their impacts; got gap = 0 and restitution = {e}"
        )
    count = int(balls)
    now, centres = 0.0, (2.0 * radius + gap) * np.arange(count)
    v = np.zeros(count)
    v[0] = speed
    distances = np.full(count - 1, gap)  # distances between the surfaces of neighbours
    found = [(now, centres, v)]
    while len(found) <= MAX_IMPACTS:
        closing = v[:-1] - v[1:]
        with np.errstate(all="ignore"):
            waits = np.where(closing > 1e-15 * speed, np.maximum(distances, 0.0) / closing, np.inf)
        k = int(np.argmin(waits))
        if not (np.isfinite(waits[k]) and now + waits[k] <= until):
            return tuple(map(np.array, zip(*found, strict=True)))  # type: ignore[return-value]
        centres, distances, now = (
            centres + v * waits[k],
            distances - closing * waits[k],
            now + float(waits[k]),
        )
        distances[k] = 0.0
        speed_behind, speed_ahead = v[k], v[k + 1]
        v = v.copy()
        v[k] = 0.5 * ((1.0 - e) * speed_behind + (1.0 + e) * speed_ahead)
        v[k + 1] = 0.5 * ((1.0 + e) * speed_behind + (1.0 - e) * speed_ahead)
        found.append((now, centres, v))
    raise ValueError(f"the balls hit each other more than {MAX_IMPACTS} times until {now:.6g} s")


def properties(
    *, balls: int, radius: float, gap: float, speed: float, restitution: float = 1.0
) -> dict[str, str]:
    """Number of impacts, time of the last one, and velocities after it, in words.

    >>> properties(balls=3, radius=0.1, gap=0.05, speed=2.0)["at last"]
    '0, 0, 2 m/s'
    """
    times, _, speeds = _follow_impacts(balls, radius, gap, speed, restitution, np.inf)
    return {
        "impacts": f"{len(times) - 1}, the last one after {times[-1]:.5g} s",
        "at last": f"{', '.join(f'{v:.4g}' for v in speeds[-1])} m/s",
    }


class BallRow(ClosedForm, function=solve, properties=properties):
    """Equal balls in a row that hit each other, one impact after the other."""

    balls: Natural
    radius: Length
    gap: Annotated[float, Quantity("m", Domain.NOT_NEGATIVE)]
    speed: Annotated[float, Quantity("m/s", Domain.POSITIVE)]
    restitution: Ratio
