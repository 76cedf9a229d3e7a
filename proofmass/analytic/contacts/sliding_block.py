"""Block on a slope with dry friction, which slides, stops, and then sticks or slides back."""

from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike

from proofmass.analytic.contacts import check_times
from proofmass.analytic.numerics import check_not_negative, check_number, check_positive
from proofmass.analytic.protocol import Angle, ClosedForm, Domain, Quantity, Speed
from proofmass.base.arrays import Array


def solve(
    time: ArrayLike,
    *,
    friction: float,
    angle: float = 0.0,
    speed: float = 0.0,
    mass: float = 1.0,
    gravity: float = 9.81,
) -> dict[str, Array]:
    r"""Motion of a block along a slope, from an initial speed up or down the slope.

    ::

                   / position, up the slope
            ___  /
           /   \/   mass
           \   /\          friction on the block against its velocity, mu N while it slides
            \ /   \        N = m g cos(angle)
            /      \
          /  angle
        ---------------

    Coulomb's law with one coefficient mu for sticking and sliding::

        a = -g sin(angle) - sense mu g cos(angle)      while it slides, sense = sign(velocity)
        t1 = speed / (-a)                              it stops, if a is opposite to the speed
        a = 0                                          after t1 if mu >= tan(angle): it sticks
        a = -g sin(angle) + mu g cos(angle)            after t1 otherwise: it slides back down

    On level ground the block stops after a distance of speed^2 / (2 mu g).

    Parameters
    ----------
    time : [s], (...), not negative and finite
    friction : the coefficient mu [1]
    angle : inclination of the slope [rad], 0 <= angle < pi/2
    speed : speed at time 0, up the slope [m/s], of either sign
    mass : mass of the block [kg]
    gravity : [m/s^2]

    Returns
    -------
    dict of (...) arrays: position [m] from the start, velocity [m/s] and acceleration [m/s^2], all
    up the slope; friction_force [N] of the slope on the block, up the slope; normal_force [N].

    Raises
    ------
    ValueError
        A parameter out of its domain, or a negative time.

    Notes
    -----
    Accuracy: rounding. The block does not tip over: its corners are far enough apart. At the
    instant when it stops, the acceleration is that of the motion afterwards. Source: textbook
    mechanics.

    Examples
    --------
    >>> motion = solve([0.0, 0.5, 1.0], friction=0.5, speed=2.0, gravity=10.0)
    >>> motion["position"].round(9).tolist(), motion["velocity"].round(9).tolist()
    ([0.0, 0.4, 0.4], [2.0, 0.0, 0.0])
    """
    t = check_times(time)
    before, after, stop = _phases(friction=friction, angle=angle, speed=speed, gravity=gravity)
    check_positive("kg", mass=mass)
    early, late = np.minimum(t, stop), np.maximum(t - stop, 0.0)
    slides = t < stop
    acceleration = np.where(slides, before, after)
    return {
        "position": early * (speed + 0.5 * before * early) + 0.5 * after * late**2,
        "velocity": np.where(slides, speed + before * early, after * late),
        "acceleration": acceleration,
        "friction_force": mass * (acceleration + gravity * np.sin(angle)),
        "normal_force": np.full(t.shape, mass * gravity * np.cos(angle)),
    }


def _phases(
    *, friction: float, angle: float, speed: float, gravity: float
) -> tuple[float, float, float]:
    """Accelerations [m/s^2] before and after the block stops, and the time when it stops [s]."""
    check_not_negative("1", friction=friction)
    check_not_negative("m/s^2", gravity=gravity)
    check_number(speed=speed, angle=angle)
    if not 0.0 <= angle < 0.5 * np.pi:
        raise ValueError(f"angle must lie from 0 to less than pi/2 [rad], got {angle}")
    weight_acceleration, friction_deceleration = (
        gravity * float(f(angle)) for f in (np.sin, np.cos)
    )
    friction_deceleration *= friction
    after = min(friction_deceleration - weight_acceleration, 0.0)
    if speed == 0.0:
        return after, after, 0.0
    before = -weight_acceleration - np.sign(speed) * friction_deceleration
    stops = speed * before < 0.0
    return float(before), after, float(-speed / before) if stops else np.inf


def stop_time(*, friction: float, angle: float, speed: float, gravity: float = 9.81) -> float:
    """Time at which the block stops [s], infinite if it never does, for the inputs of `solve`.

    >>> stop_time(friction=0.5, angle=0.0, speed=2.0, gravity=10.0)
    0.4
    """
    return _phases(friction=friction, angle=angle, speed=speed, gravity=gravity)[2]


def properties(
    *,
    friction: float,
    angle: float = 0.0,
    speed: float = 0.0,
    gravity: float = 9.81,
    **_: float,
) -> dict[str, str]:
    """Time and distance until the block stops, and whether it sticks then, in words.

    >>> properties(friction=0.5, speed=2.0, gravity=10.0)
    {'stops': 'after 0.4 s and 0.4 m', 'at rest': 'sticks: tan(angle) is 0 % of the friction'}
    """
    stop = stop_time(friction=friction, angle=angle, speed=speed, gravity=gravity)
    distance = abs(0.5 * speed * stop) if speed else 0.0
    slope = np.tan(angle)
    if slope > friction:
        at_rest = "slides down: tan(angle) exceeds the friction"
    elif friction > 0.0:
        at_rest = f"sticks: tan(angle) is {100.0 * slope / friction:.4g} % of the friction"
    else:
        at_rest = "stays at rest: the ground is level"
    return {
        "stops": f"after {stop:.5g} s and {distance:.5g} m" if np.isfinite(stop) else "never",
        "at rest": at_rest,
    }


class SlidingBlock(ClosedForm, function=solve, properties=properties):
    """Block on a slope with dry friction, which slides, stops, and then sticks or slides back."""

    friction: Annotated[float, Quantity("1", Domain.NOT_NEGATIVE)]
    angle: Angle
    speed: Speed
    mass: Annotated[float, Quantity("kg", Domain.POSITIVE)]
    gravity: Annotated[float, Quantity("m/s^2", Domain.NOT_NEGATIVE)]
