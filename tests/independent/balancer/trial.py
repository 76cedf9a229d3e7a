"""Trial postures of both grid searches: ranges, deflections, energies and loads.

A posture is the angles of all segments in the pendulum's frame, clockwise from the pendulum.
"""

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from proofmass.analytic.balancer.model import Balancer, balancer
from proofmass.base.arrays import Array
from tests.independent.balancer.loads import node_loads, pin_force

BELOW_STRETCHED = 1.0 - 1e-14  # a stretched chain whose cosine does not round to more than one


def check_inputs(
    angles: ArrayLike, points: int, parameters: dict[str, float], names: Iterable[str], listing: str
) -> tuple[Balancer, Array]:
    """The balancer and the angles (n,); ValueError if a parameter or an angle is wrong."""
    if strange := sorted(set(parameters) - set(names)):
        raise ValueError(f"listing {listing} has no {strange[0]}, only {', '.join(sorted(names))}")
    if points < 2:
        raise ValueError(f"points must be at least 2, got {points}")
    device, alpha = balancer(**parameters), np.asarray(angles, float)
    if alpha.ndim != 1 or not (np.diff(alpha) > 0.0).all():
        raise ValueError(f"angles must be one row that rises, got {alpha.tolist()}")
    if not device.length[0, 0] < device.pendulum[0]:
        raise ValueError(
            f"length1 must be below pendulum = {device.pendulum[0]:g} m, so that the "
            f"tip is never below its end, got {device.length[0, 0]:g}"
        )
    if device.low[np.isfinite(device.low)].any():
        raise ValueError(f"low must be 0, the stop of a preload, got {device.low[0].min():g}")
    return device, alpha


def grid_shares(points: int) -> Array:
    """2 i/N - 1 for i = 1 ... N: the upper end is a point, the lower one is not.

    >>> grid_shares(4).tolist()
    [-0.5, 0.0, 0.5, 1.0]
    """
    return 2.0 * np.arange(1, points + 1) / points - 1.0


def largest_angle(side: ArrayLike, arm: ArrayLike, opposite: ArrayLike) -> Array:
    """Largest angle [rad] between two sides of a triangle; pi if the third is longer than both.

    >>> float(largest_angle(1.0, 1.0, 1.0).round(9)), float(largest_angle(1.0, 0.5, 2.0).round(9))
    (1.047197551, 3.141592654)
    """
    a, b, c = (np.asarray(x, float) for x in (side, arm, opposite))
    cosine = (a * a + b * b - c * c) / (2.0 * a * b)
    return np.where(a + b <= c, np.pi, BELOW_STRETCHED * np.arccos(np.clip(cosine, -1.0, 1.0)))


def deflections(device: Balancer, alpha: Array, posture: Array) -> Array:
    """Deflections (..., n) [rad] of postures for the pendulum angles alpha (...)."""
    turned = posture - device.rest[0]
    first = alpha + turned[..., 0]
    deflection = np.empty((*first.shape, turned.shape[-1]))
    deflection[..., 0], deflection[..., 1:] = first, np.diff(turned)
    return deflection


def energies(device: Balancer, deflection: Array) -> Array:
    """Energy (...) of all springs [J] at deflections (..., n)."""
    return np.asarray(device.energies(deflection[None])[0].sum(axis=-1))


def trial_loads(device: Balancer, alpha: Array, posture: Array) -> Array:
    """Loads (..., n) [N m] on the joints if only the first and last spring are in equilibrium."""
    moment = device.moments(deflections(device, alpha, posture)[None])[0]
    force = pin_force(posture, device.length[0], moment)
    with np.errstate(invalid="ignore"):  # no force where the last segment points at O
        return node_loads(posture, device.length[0], *force)


def least_energy_index(alpha: Array, energy: Array) -> NDArray[np.intp]:
    """Index (n,) of the smallest energy (n, N) at each angle; NaN marks a point without posture."""
    none = np.isnan(energy).all(axis=-1)
    if none.any():
        raise ValueError(f"no posture closes at {alpha[none][0]:.6g} rad: take more points")
    return np.nanargmin(energy, axis=-1)


def posture_curves(device: Balancer, alpha: Array, posture: Array) -> dict[str, Any]:
    """Curves that the searches return, of postures (n, segments)."""
    deflection = deflections(device, alpha, posture)
    segments = range(device.segments)
    return {
        **{f"theta{i + 1}": alpha + posture[:, i] for i in segments},
        **{f"deflection{i + 1}": deflection[:, i] for i in segments},
        "balancing_moment": device.moments(deflection[None])[0, :, 0],
        "energy": energies(device, deflection),
    }
