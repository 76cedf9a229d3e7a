"""Three segments by search over a grid, as van Nes 2022 found every optimum of its appendix M."""

import numpy as np
from numpy.typing import ArrayLike

from proofmass.analytic.balancer.model import Balancer, close_chain
from proofmass.base.arrays import Array
from tests.independent.balancer.trial import (
    check_inputs,
    deflections,
    energies,
    grid_shares,
    largest_angle,
    least_energy_index,
    posture_curves,
    trial_loads,
)

PARAMETER_NAMES = frozenset(
    "pendulum rest_angle mode preload2 low2 high2 length1 length2 length3 stiffness1 "
    "stiffness2 stiffness3 quadratic1 quadratic2 quadratic3".split()
)


def minimise(angles: ArrayLike, *, points: int = 1000, **parameters: float) -> dict[str, Array]:
    r"""Postures of least energy among `points` of segment 1, at each angle of the pendulum.

    ::

              tip            beta = theta1 - angle, of segment 1 against the pendulum, takes the
            l3/ |            points of its range; segments 2 and 3 close the loop:
        P2 __/  | r
          l2\   |              beta_i = R (2 i/N - 1),  i = 1 ... N
             \P1|              R = acos((r^2 + l1^2 - (l2 + l3)^2)/(2 r l1))
              \l|1             R = pi, all round, if r + l1 <= l2 + l3
                O
        V(angle, beta_i) = V1(angle + beta_i - rest_angle) + V2(beta_i) + V3(beta_i)

    The result is the posture with the smallest V of all. So the balancing moment comes in steps of
    stiffness1 2R/N, and the posture may be one that no motion from rest can reach.

    **Preload** (`low2` given). As long as the load on joint 2 of the rest posture, turned as a
    whole, has not exceeded the preload, that posture is the only one. The load that exceeds it
    releases the joint for all later angles; the stop itself is not considered afterwards.

    **Contact** (`high2` given). A point whose joint 2 is beyond the stop is replaced by beta = 0.

    Parameters
    ----------
    angles : array_like (n,)
        Pendulum angles, rising [rad]; the thesis takes j/90 of a right angle, j = 1 ... 90.
    points : int
        Number N of points.
    **parameters : float
        As of `proofmass.analytic.balancer.solve`, without springs, stops and weights that the
        listing does not have: pendulum, length1..3 [m], stiffness1..3 [N m/rad], quadratic1..3 [N
        m/rad^2], preload2 [N m] with low2 = 0, high2, rest_angle [rad], mode.

    Returns
    -------
    dict of ndarray (n,)
        theta1..3, deflection1..3 [rad], balancing_moment [N m], energy of the springs [J].

    Raises
    ------
    ValueError
        A parameter is unknown or out of its domain, length1 is not below the pendulum's, the angles
        do not rise, or no posture closes.

    Notes
    -----
    The balancing moment is off by up to one step, 2 to 9 mN m for r = 1 m and m g r = 1 N m.
    Source: van Nes 2022, listing N.3, text lines 2335-4176. Differences: the chain is closed by the
    cosine rule; range and closure are in the pendulum's frame, where they are the same at every
    angle; the contact posture is the listing's default, theta1 = angle, since its code for it
    (3182-3198) never runs.

    Examples
    --------
    >>> design = dict(length1=0.3394, length2=0.4573, length3=0.4752, rest_angle=0.6641,
    ...               stiffness1=1.2701, stiffness2=0.8473, stiffness3=4.1078)
    >>> found = minimise(np.radians([30.0, 60.0, 90.0]), **design)
    >>> found["balancing_moment"].round(1).tolist()
    [0.5, 0.9, 1.0]
    """
    device, alpha = check_inputs(angles, points, parameters, PARAMETER_NAMES, "N.3")
    first, second, third = device.length[0]
    sweep = largest_angle(device.pendulum[0], first, second + third) * grid_shares(points)
    lead = _segment_1_points(device, alpha, sweep) if "low2" in parameters else sweep[None]
    if "high2" in parameters:
        joint2 = deflections(device, alpha[:, None], _close_postures(device, lead))[..., 1]
        lead = np.where(joint2 > device.high[0, 1], 0.0, lead)
    posture = _close_postures(device, lead)
    energy = energies(device, deflections(device, alpha[:, None], posture))
    rows, best = np.arange(alpha.size), least_energy_index(alpha, energy)
    return posture_curves(device, alpha, np.broadcast_to(posture, (*energy.shape, 3))[rows, best])


def _close_postures(device: Balancer, lead: Array) -> Array:
    """Angles (..., 3) of the segments in the pendulum's frame, if segment 1 leads it by (...)."""
    mode = np.sign(device.rest[0, 2] - device.rest[0, 1])
    return close_chain(device.pendulum[0], device.length[0], lead[..., None], mode)


def _segment_1_points(device: Balancer, alpha: Array, sweep: Array) -> Array:
    """Points (n, N) of segment 1: its rest angle until joint 2 is released, then the sweep."""
    load = trial_loads(device, alpha, device.rest[0])[:, 1]
    released = np.logical_or.accumulate(load > device.preload[0, 1])
    lead = np.where(released[:, None], sweep, device.rest[0, 0])
    lead[np.flatnonzero(released)[:1], 0] = device.rest[0, 0]  # its load releases the joint
    return lead
