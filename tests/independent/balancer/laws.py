"""Closed formulas of a balancer: release angle of a preload, initial stiffness, scaling."""

import re
from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tests.independent.balancer.loads import levers

Array = NDArray[np.float64]


def leverage(theta: ArrayLike, lengths: ArrayLike) -> Array:
    r"""Share h_i = M_i/M_1 of the balancing moment that loads joint i while all but 1 are locked.

    ::

        h_i = ((T - P_i) x u)/(T x u), u along the last segment

    The chain then turns about O like one body and the last spring carries nothing, so the force
    runs along the last segment, and h stays what it is at rest. For three segments::

        h_2 = l_2 sin(th_3 - th_2)/(l_1 sin(th_3 - th_1) + l_2 sin(th_3 - th_2))

    and where the first segments stand along the pendulum, h_2 = 1 - l_1/r, h_3 = 1 - (l_1 + l_2)/r.

    `theta` [rad] and `lengths` [m] (..., n) of the rest posture, clockwise from +y; returns
    (..., n), h_1 = 1 and h_n = 0. Not finite where the last segment points at O. Not in van Nes
    2022, which finds the release by search (lines 3917-3922); from its appendix B with M_n = 0.

    >>> leverage([0.0, -np.pi / 3, np.pi / 3], [0.5, 0.5, 0.5]).round(9) + 0.0
    array([1. , 0.5, 0. ])
    """
    x, y = levers(theta, lengths)
    with np.errstate(divide="ignore", invalid="ignore"):
        area = x * y[..., -1:] - y * x[..., -1:]
        return np.asarray(area / area[..., :1])


def release_angle(
    preload: ArrayLike, leverage: ArrayLike, stiffness1: ArrayLike, quadratic1: ArrayLike = 0.0
) -> Array:
    r"""Pendulum angle at which a preloaded joint leaves its stop, all others but 1 still locked.

    ::

        k_1 a + A_1 a^2 = M_0/h      a = 2 m/(k_1 + sqrt(k_1^2 + 4 A_1 m)), m = M_0/h

    For linear springs a = M_0/(k_1 h). The first of several preloaded joints is the one with the
    smallest angle; the angles of the others are no longer valid once it is released.

    Parameters
    ----------
    preload : M_0 [N m], zero or positive
    leverage : h of that joint, as from `leverage`
    stiffness1, quadratic1 : of spring 1, M_1 = k_1 a + A_1 a^2 [N m/rad], [N m/rad^2]

    Returns
    -------
    angle [rad], broadcast; inf if the joint never releases: h <= 0, or spring 1 never carries M_0/h

    Notes
    -----
    Accuracy: rounding. Not in van Nes 2022, but equal to what its search finds: 46.66 degrees for
    the optimum of line 1745.

    Examples
    --------
    >>> angle = release_angle(0.3983, 1.0 - 0.4764, 0.9341)
    >>> round(float(np.degrees(angle)), 4)
    46.6595
    """
    m0, h, k, a = (np.asarray(x, float) for x in (preload, leverage, stiffness1, quadratic1))
    with np.errstate(divide="ignore", invalid="ignore"):
        m = m0 / h
        angle = np.where(m0 == 0.0, 0.0, 2.0 * m / (k + np.sqrt(k * k + 4.0 * a * m)))
    return np.where((h > 0.0) & (angle >= 0.0), angle, np.inf)


def initial_stiffness(theta: ArrayLike, lengths: ArrayLike, stiffness: ArrayLike) -> Array:
    r"""Slope dM_1/dangle of the balancing moment in the rest posture, all springs relaxed.

    ::

        k_eff = t . C^-1 t,   C = sum_i w_i w_i^T/k_i,   w_i = (-y_i, x_i),   t = (y_1, -x_1)

    C is the compliance of the tip, (x_i, y_i) = T - P_i, and t dangle the displacement of the tip
    by the pendulum. With n = 3 and segment 1 along the pendulum, for any k_3::

        k_eff = 1/(1/k_1 + (1 - l_1/r)^2/k_2)

    Parameters
    ----------
    theta, lengths : rest posture, clockwise from +y [rad], and lengths [m], (..., n)
    stiffness : k_i [N m/rad] (..., n), positive; inf for a joint that its preload locks, at most
        n - 2 of them

    Returns
    -------
    k_eff [N m/rad] (...)

    Raises
    ------
    ValueError
        A stiffness is not positive: the chain then has no resistance of its own.

    Notes
    -----
    Accuracy: rounding over the determinant of C, which is zero for a straight chain. Not in van Nes
    2022: linearised from its eqs 8-11.

    Examples
    --------
    >>> theta = [0.0, -np.pi / 3, np.pi / 3]
    >>> round(float(initial_stiffness(theta, [0.5] * 3, [1.0, 0.25, 7.0])), 9)
    0.5
    """
    k = np.asarray(stiffness, float)
    if not np.all(k > 0.0):
        raise ValueError(f"stiffness must be positive, or inf for a locked joint, got {k.tolist()}")
    x, y = levers(theta, lengths)
    xx, xy, yy = (np.sum(product / k, axis=-1) for product in (y * y, -x * y, x * x))
    tx, ty = y[..., 0], -x[..., 0]
    return np.asarray((yy * tx * tx - 2.0 * xy * tx * ty + xx * ty * ty) / (xx * yy - xy * xy))


def slack_moment(
    angle: ArrayLike,
    *,
    pendulum: float,
    length1: float,
    reach: float,
    stiffness1: float,
    rest_angle: float = 0.0,
) -> Array:
    r"""Balancing moment with spring 1 alone: zero until the other segments are stretched (taut).

    ::

        M_1 = k_1 max(0, angle - rest_angle - b),   cos b = (r^2 + l_1^2 - reach^2)/(2 r l_1)

    The limit of weak outer springs; that of stiff ones is M_1 = k_1 angle.

    Parameters
    ----------
    angle : pendulum angle [rad] (...), from the rest posture on
    pendulum, length1, reach : r, l_1 and the sum of all other lengths [m]
    stiffness1 : k_1 [N m/rad]
    rest_angle : of segment 1 [rad]

    Returns
    -------
    M_1 [N m] (...); zero at all angles if the outer segments reach the tip everywhere

    Notes
    -----
    In van Nes 2022, lines 2588-2612, the angle b is the end of the search.

    Examples
    --------
    >>> moment = slack_moment([0.5, 1.5], pendulum=1.0, length1=1.0, reach=1.0, stiffness1=3.0)
    >>> moment.round(9)
    array([0.        , 1.35840735])
    """
    cosine = (pendulum**2 + length1**2 - reach**2) / (2.0 * pendulum * length1)
    taut = np.arccos(cosine) if cosine > -1.0 else np.inf
    return stiffness1 * np.maximum(np.asarray(angle, float) - rest_angle - taut, 0.0)


def scaled(
    parameters: Mapping[str, float], *, length: float = 1.0, moment: float = 1.0
) -> dict[str, float]:
    """Parameters of a similar balancer, whose moment curve is `moment` times the old one.

    Lengths are multiplied by `length`, springs and preloads by `moment`, and the weight, a moment
    over a length, by moment/length; angles, stops and the mode stay. Energies go with the moment.

    `parameters` are those of `proofmass.analytic.balancer.solve`. The optima of van Nes 2022 are
    for r = 1 m, m g r = 1 N m; its prototype is one of them with lengths halved (lines 893-913).

    >>> scaled({"length1": 0.4, "stiffness1": 2.0, "rest_angle": 0.6}, length=0.5, moment=3.0)
    {'length1': 0.2, 'stiffness1': 6.0, 'rest_angle': 0.6}
    """
    factors = {
        "length": length,
        "pendulum": length,
        "stiffness": moment,
        "quadratic": moment,
        "preload": moment,
        "weight": moment / length,
    }
    return {
        name: value * factors.get(re.sub(r"\d$", "", name), 1.0)
        for name, value in parameters.items()
    }
