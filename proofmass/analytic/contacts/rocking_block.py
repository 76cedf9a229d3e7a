"""Rigid block that rocks on its two lower corners, after Housner."""

from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import elliprf

from proofmass.analytic.contacts import check_times
from proofmass.analytic.linkages.pendulum import jacobi_functions
from proofmass.analytic.numerics import check_number, check_positive
from proofmass.analytic.protocol import Angle, ClosedForm, Domain, Length, Quantity
from proofmass.base.arrays import Array

MIN_AMPLITUDE_SHARE = 1e-9
"""Smallest amplitude, as a share of the block's angle alpha; below it the block rests."""
MAX_ROCKING_IMPACTS = 100_000
"""Largest number of impacts that are computed."""


def solve(
    time: ArrayLike, *, width: float, height: float, tilt: float, gravity: float = 9.81
) -> dict[str, Array]:
    r"""Motion of a block that is released at rest, tilted on one of its lower corners.

    ::

              width                    alpha = atan(width / height)
            _________                  R = half a diagonal
           /        /  height
          /   o    /                   angle theta > 0, counter-clockwise: it stands on its left
         /        /                    lower corner, which is at -width/2
        /________/ theta               theta < 0: on its right one
        --------------------> x

    The block turns about one corner until the other one hits the floor; then it turns about that
    one. The angular momentum about the new corner is the same before and after the impact::

        theta'' = -p^2 sin(alpha - theta)  for theta > 0,      p^2 = 3 g / (4 R)
        rate after / rate before = r = 1 - 3/2 sin^2(alpha)

    alpha - theta is the angle of an inverted pendulum from the vertical, whose motion is given by
    the Jacobi functions of p times the time from the amplitude A of a half cycle, with the modulus
    k = cos((alpha - A)/2) and k' = sin((alpha - A)/2)::

        sin((A - theta)/2) = k k' sn^2/((1 + cn) dn),      theta' = -2 p k k' sn/dn

    From impact to impact::

        rate^2 = 2 p^2 (cos(alpha - A) - cos(alpha))           at the impact
        cos(alpha - A') = cos(alpha) + r^2 (cos(alpha - A) - cos(alpha))
        T(A) = F(arccos(tan((alpha - A)/2) / tan(alpha/2)), cos((alpha - A)/2)) / p

    T(A) is the time from the amplitude to the impact. The times of the impacts have a limit, from
    which on the block rests.

    Parameters
    ----------
    time : [s], (...), not negative and finite
    width, height : dimensions of the block [m]; r must be positive: width < 2^(1/2) height
    tilt : angle theta at time 0, at rest [rad], 0 < |tilt| < alpha
    gravity : [m/s^2]

    Returns
    -------
    dict of (...) arrays: angle [rad], rate [rad/s], acceleration [rad/s^2] between impacts;
    centre_x, centre_height [m] of the block, which rests with its centre at x = 0; impacts [1],
    number of impacts until then.

    Raises
    ------
    ValueError
        A parameter out of its domain, a negative time, or more than `MAX_ROCKING_IMPACTS` impacts.

    Notes
    -----
    Accuracy: 2e-14 of the amplitude and of the largest rate between impacts, beside the rounding of
    the time; 1e-13 of the whole time for times of impacts. A block whose amplitude is less than
    1e-9 of alpha rests. The floor is rigid and rough enough for the corner not to slip; an impact
    hits the new corner alone. Source: G. W. Housner, The behavior of inverted pendulum structures
    during earthquakes, Bull. Seism. Soc. Am. 53 (1963) 403-417.

    Examples
    --------
    >>> start = solve(0.0, width=0.1, height=0.4, tilt=0.1)
    >>> round(float(start["angle"]), 12), round(float(start["acceleration"]), 6)
    (0.1, -5.156054)
    """
    t = check_times(time)
    alpha, p_squared = _check_block(width, height, tilt, gravity)
    amplitudes, peaks, ends = _half_cycles(
        alpha, p_squared, tilt, rate_ratio(width=width, height=height), float(t.max(initial=0.0))
    )
    # the half cycle of each time; the first one begins at its amplitude
    half_cycle = np.searchsorted(ends, t, side="right")
    rests = half_cycle >= len(ends)
    angle, rate, acceleration = (np.zeros(t.shape) for _ in range(3))
    p = np.sqrt(p_squared)
    for k in np.unique(half_cycle[~rests]):
        in_cycle = half_cycle == k
        modulus, other = (f(0.5 * (alpha - amplitudes[k])) for f in (np.cos, np.sin))
        sn, cn, dn = jacobi_functions(p * (t[in_cycle] - peaks[k]), modulus, other)
        # angle that the block has turned back from the amplitude, with 1 - cn = sn^2/(1 + cn)
        turned = 2.0 * np.arcsin(modulus * other * sn**2 / ((1.0 + cn) * dn))
        lean = np.maximum(amplitudes[k] - turned, 0.0)
        side = np.sign(tilt) * (-1.0) ** k
        angle[in_cycle] = side * lean
        rate[in_cycle] = -side * 2.0 * p * modulus * other * sn / dn
        acceleration[in_cycle] = -side * p_squared * np.sin(alpha - lean)
    half_width, half_height = 0.5 * width, 0.5 * height
    lean = np.abs(angle)
    shift = 2.0 * half_width * np.sin(0.5 * lean) ** 2 + half_height * np.sin(lean)
    return {
        "angle": angle,
        "rate": rate,
        "acceleration": acceleration,
        "centre_x": -np.sign(angle) * shift,
        "centre_height": half_width * np.sin(lean) + half_height * np.cos(lean),
        "impacts": np.minimum(half_cycle, len(ends)).astype(float),
    }


def _check_block(width: float, height: float, tilt: float, gravity: float) -> tuple[float, float]:
    """Angle alpha of the block [rad] and p^2 [1/s^2], after a check of the inputs."""
    check_positive("m/s^2", gravity=gravity)
    check_number(tilt=tilt)
    ratio = rate_ratio(width=width, height=height)
    alpha = float(np.arctan2(width, height))
    if ratio <= 0.0:
        raise ValueError(
            f"width must be less than {np.sqrt(2.0) * height:.6g} m, 2^(1/2) heights: a wider "
            f"block does not rock on; got {width}"
        )
    if not 0.0 < abs(tilt) < alpha:
        raise ValueError(
            f"tilt must lie between 0 and {alpha:.6g} rad, at which the block falls over; "
            f"got {tilt}"
        )
    return alpha, 1.5 * gravity / float(np.hypot(width, height))


def rate_ratio(*, width: float, height: float) -> float:
    """Rate after an impact over the rate before it [1], 1 - 3/2 sin^2(alpha).

    >>> round(rate_ratio(width=0.1, height=0.4), 6)
    0.911765
    """
    check_positive(width=width, height=height)
    return 1.0 - 1.5 * width**2 / (width**2 + height**2)


def time_to_impact(*, width: float, height: float, tilt: float, gravity: float = 9.81) -> float:
    """Time [s] from the tilt, at rest, to the first impact, for the inputs of `solve`.

    >>> round(time_to_impact(width=0.1, height=0.4, tilt=0.1), 9)
    0.187180651
    """
    alpha, p_squared = _check_block(width, height, tilt, gravity)
    return _time_to_impact(alpha, abs(tilt), p_squared)


def _time_to_impact(alpha: float, amplitude: float, p_squared: float) -> float:
    """Time [s] from an amplitude to the next impact; `p_squared` is p^2 [1/s^2]."""
    upright = alpha - amplitude
    # F(phi, k) = sin(phi) R_F(cos^2 phi, 1 - k^2 sin^2 phi, 1), without the cancellation of 1 - k^2
    slope, edge = np.tan(0.5 * upright), np.tan(0.5 * alpha)
    # edge^2 - slope^2 in a form that keeps all digits at small amplitudes
    difference = (
        np.sin(0.5 * amplitude) / (np.cos(0.5 * upright) * np.cos(0.5 * alpha)) * (edge + slope)
    )
    cos2, sin2 = (slope / edge) ** 2, difference / edge**2
    inner = cos2 + np.sin(0.5 * upright) ** 2 * sin2
    return float(np.sqrt(sin2 / p_squared) * elliprf(cos2, inner, 1.0))


def _half_cycles(
    alpha: float, p_squared: float, tilt: float, r: float, until: float
) -> tuple[Array, Array, Array]:
    """Amplitudes [rad] of the half cycles, times [s] of the amplitudes and of the impacts after."""
    amplitudes, peaks, ends = [abs(tilt)], [0.0], [_time_to_impact(alpha, abs(tilt), p_squared)]
    while ends[-1] <= until:
        if len(ends) > MAX_ROCKING_IMPACTS:
            raise ValueError(
                f"the block hits the floor more than {MAX_ROCKING_IMPACTS} times "
                f"until {until:.6g} s"
            )
        before = amplitudes[-1]
        # cos(alpha - A) - cos(alpha) = 2 sin(alpha - A/2) sin(A/2), times r^2 after the impact
        lift = 2.0 * r**2 * np.sin(alpha - 0.5 * before) * np.sin(0.5 * before)
        # 2 sin(alpha - A/2) sin(A/2) = lift: with x = tan(A/2), (2 cos(alpha) + lift) x^2
        # - 2 sin(alpha) x + lift = 0, of which the smaller root is taken
        sine, cosine = np.sin(alpha), np.cos(alpha)
        root = np.sqrt(sine**2 - lift * (2.0 * cosine + lift))
        after = 2.0 * float(np.arctan2(lift, sine + root))
        if after < MIN_AMPLITUDE_SHARE * alpha:
            break
        half_time = _time_to_impact(alpha, after, p_squared)
        amplitudes.append(after)
        peaks.append(ends[-1] + half_time)
        ends.append(ends[-1] + 2.0 * half_time)
    return np.array(amplitudes), np.array(peaks), np.array(ends)


def properties(
    *, width: float, height: float, tilt: float, gravity: float = 9.81
) -> dict[str, str]:
    """Time of the first impact, ratio of rates at an impact, and angle of tipping over, in words.

    >>> properties(width=0.1, height=0.4, tilt=0.1)["rate after an impact"]
    '91.18 % of that before it'
    """
    first = time_to_impact(width=width, height=height, tilt=tilt, gravity=gravity)
    kept = 100.0 * rate_ratio(width=width, height=height)
    return {
        "first impact": f"after {first:.5g} s",
        "rate after an impact": f"{kept:.4g} % of that before it",
        "falls over at": f"{np.degrees(np.arctan2(width, height)):.4g}°",
    }


class RockingBlock(ClosedForm, function=solve, properties=properties):
    """Rigid block that rocks on its two lower corners, after Housner."""

    width: Length
    height: Length
    tilt: Angle
    gravity: Annotated[float, Quantity("m/s^2", Domain.POSITIVE)]
