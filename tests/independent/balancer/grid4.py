"""Four segments by search over a grid of two angles, as van Nes 2022 did in listing N.4."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from proofmass.analytic.balancer.model import Balancer, close_chain
from proofmass.base.arrays import Array
from tests.independent.balancer.grid import PARAMETER_NAMES
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

PARAMETER_NAMES_4 = PARAMETER_NAMES - {"rest_angle", "mode", "high2"} | {
    "preload3",
    "low3",
    "length4",
    "stiffness4",
    "quadratic4",
}
STAGES = np.array(["locked", "joint 3 free", "joint 2 free", "both free"])


def minimise(
    angles: ArrayLike, *, points: int = 150, **parameters: float
) -> dict[str, NDArray[np.generic]]:
    r"""Postures of least energy among `points` x `points` of segments 1 and 2.

    ::

           P2 --l3- P3        beta_i over the range of segment 1, as in `grid.minimise`;
          l2|         \l4     segment 2 over the range that it then has, about the direction
          P1|          tip    b and distance D from P1 to the tip:
             \l1    / r
              O                 gamma_ik = b + Q (2 k/N - 1),  k = 1 ... N
                                Q = acos((D^2 + l2^2 - (l3 + l4)^2)/(2 D l2)), or pi

    Segments 3 and 4 close the loop, elbow up. Joints 2 and 3 are straight at rest, theta1 =
    theta2 = 0.

    **Preload** (`low2` and `low3` given). Each point i, k tries up to four postures in this order.
    A posture replaces the previous one, with its energy, if the loads M2, M3 on joints 2 and 3 in
    the previous posture satisfy its condition::

        locked         always                           the rest posture, turned as a whole
        joint 3 free   M2 <  preload2, M3 >= preload3   segments 1 and 2 one bar, its range over i
        joint 2 free   M2 >= preload2, M3 <  preload3   segments 2 and 3 one bar, the range over i
        both free      M2 >= preload2, M3 >= preload3   the point i, k itself

    Where joint 3 or both are free, postures with deflection2 or deflection3 < 0 are excluded. The
    loads are those of a trial, not of an equilibrium: a stage may hide another of less energy.

    Parameters
    ----------
    angles : array_like (n,)
        Pendulum angles, rising [rad]; the thesis takes j/15 of a right angle, j = 1 ... 15.
    points : int
        Number N of points for each of the two angles.
    **parameters : float
        As of `proofmass.analytic.balancer.solve`, without springs, stops and weights that the
        listing does not have: pendulum, length1..4 [m], stiffness1..4 [N m/rad], quadratic1..4 [N
        m/rad^2]; preload2, preload3 [N m] with low2 = low3 = 0.

    Returns
    -------
    dict of ndarray (n,)
        theta1..4, deflection1..4 [rad], balancing_moment [N m], energy of the springs [J], and the
        stage by its name above.

    Raises
    ------
    ValueError
        As for `grid.minimise`; or low2 is given without low3, or the reverse.

    Notes
    -----
    The error is up to a step of 0.02 to 0.04 rad, 6 to 27 mN m for r = 1 m and m g r = 1 N m, and
    more where the stages hide the equilibrium.

    Source: van Nes 2022, listing N.4, text lines 4178-10283.
    Differences: the chain is closed by the cosine rule in the pendulum's frame; a posture that
    cannot close does not exclude those at higher i and k (6118-6172), which changes none of the 32
    designs of appendix M.

    Examples
    --------
    >>> design = dict(length1=0.3, length2=0.3, length3=0.3, length4=0.3, stiffness1=1.0,
    ...               stiffness2=0.1, stiffness3=0.3, stiffness4=0.0, preload2=0.6,
    ...               preload3=0.2, low2=0.0, low3=0.0)
    >>> found = minimise([0.25, 0.75, 1.25], points=50, **design)
    >>> found["stage"].tolist(), float(found["balancing_moment"][0])
    (['locked', 'joint 3 free', 'both free'], 0.25)
    """
    preloaded = "low2" in parameters
    if preloaded != ("low3" in parameters):
        raise ValueError("low2 and low3 belong together in listing N.4: give both or none")
    device, alpha = check_inputs(angles, points, parameters, PARAMETER_NAMES_4, "N.4")
    postures = [
        device.rest[0],
        _postures_joint_2_straight(device, points),
        _postures_joint_3_at_rest(device, points),
        _postures_both_free(device, points),
    ]
    up = alpha[:, None, None]
    stage = _stage_by_loads(device, up, postures) if preloaded else np.full((alpha.size, 1, 1), 3)
    energy = np.choose(
        stage,
        [
            _energy(device, up, posture, preloaded and i in (1, 3))
            for i, posture in enumerate(postures)
        ],
    )
    best = least_energy_index(alpha, energy.reshape(alpha.size, -1))
    rows = (np.arange(alpha.size), *np.unravel_index(best, energy.shape[1:]))
    stage = np.broadcast_to(stage, energy.shape)
    found = np.choose(
        stage[rows][:, None],
        [np.broadcast_to(posture, (*energy.shape, 4))[rows] for posture in postures],
    )
    return {**posture_curves(device, alpha, found), "stage": STAGES[stage[rows]]}


def _postures_joint_2_straight(device: Balancer, points: int) -> Array:
    """Postures (N, 1, 4) with joint 2 straight."""
    r, (a, b, c, d) = device.pendulum[0], device.length[0]
    bar = (largest_angle(r, a + b, c + d) * grid_shares(points))[:, None, None]
    return close_chain(r, device.length[0], np.concatenate([bar, bar], -1), 1)


def _postures_joint_3_at_rest(device: Balancer, points: int) -> Array:
    """Postures (N, 1, 4) with joint 3 bent as at rest: segments 2 and 3 are one bar."""
    r, (a, b, c, d) = device.pendulum[0], device.length[0]
    turn = device.rest[0, 2] - device.rest[0, 1]
    bar = b + c * np.exp(1j * turn)
    lead = (largest_angle(r, a, abs(bar) + d) * grid_shares(points))[:, None, None]
    three = close_chain(r, np.array([a, abs(bar), d]), lead, 1)
    second = three[..., 1] - np.angle(bar)
    return np.stack([three[..., 0], second, second + turn, three[..., 2]], -1)


def _postures_both_free(device: Balancer, points: int) -> Array:
    """Postures (N, N, 4) over the ranges of segments 1 and 2."""
    r, (a, b, c, d) = device.pendulum[0], device.length[0]
    lead = (largest_angle(r, a, b + c + d) * grid_shares(points))[:, None]
    x, y = -a * np.sin(lead), r - a * np.cos(lead)
    second = np.arctan2(x, y) + largest_angle(np.hypot(x, y), b, c + d) * grid_shares(points)
    first = np.stack(np.broadcast_arrays(lead, second), -1)
    return close_chain(r, device.length[0], first, 1)


def _energy(device: Balancer, alpha: Array, posture: Array, unilateral: bool) -> Array:
    """Energy (n, ...) [J] of postures; NaN where `unilateral` and a joint is beyond its stop."""
    deflection = deflections(device, alpha, posture)
    beyond = unilateral & (deflection[..., 1:3] < 0.0).any(axis=-1)
    return np.where(beyond, np.nan, energies(device, deflection))


def _stage_by_loads(device: Balancer, alpha: Array, postures: list[Array]) -> NDArray[np.intp]:
    """Index (n, N, N) of the stage that the loads of the trial postures lead to."""
    preload = device.preload[0, 1:3]
    trials = [trial_loads(device, alpha, posture)[..., 1:3] for posture in postures]
    stage = np.zeros(np.broadcast_shapes(*(t.shape[:-1] for t in trials)), int)
    load = np.broadcast_to(trials[0], (*stage.shape, 2))
    for i in (1, 2, 3):
        more, less = (np.moveaxis(x, -1, 0) for x in (load >= preload, load < preload))  # or NaN
        asked = (less[0] & more[1], more[0] & less[1], more[0] & more[1])[i - 1]
        stage, load = np.where(asked, i, stage), np.where(asked[..., None], trials[i], load)
    return stage
