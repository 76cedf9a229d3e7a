"""What is wrong with a balancer, or not what it seems: flags for the report and for tests."""

import numpy as np

from proofmass.analytic.balancer.design import balancer
from proofmass.analytic.balancer.follow import Trail, follow
from proofmass.analytic.balancer.path import Path, along
from proofmass.analytic.numerics import Array

RANGE = np.pi / 2  # [rad] that a clock spring between simple stops can be wound
STRAIGHT = 0.05  # [rad] below which an arm is called straight: errors in length grow twentyfold
STEP = np.radians(0.25)


def flags(to: float = np.pi / 2, **parameters: float) -> list[str]:
    """What a designer must know before believing a balancer's moment curve.

    Parameters
    ----------
    to : float
        Last pendulum angle [rad].
    **parameters
        Of `proofmass.analytic.balancer.solve`.

    Returns
    -------
    list of str
        Empty for a regular balancer.  Otherwise some of: an unstable rest posture; a fold, where
        the chain jumps; an arm that straightens and passes into the other elbow (a search over
        one elbow only finds the straight arm there), or comes near to it; a joint that never leaves
        its preload, or never touches its stop; a spring wound past its range or past its largest
        moment.

    Examples
    --------
    >>> flags(length1=0.3382, length2=0.5, length3=0.5, rest_angle=0.0152, stiffness1=0.5152,
    ...       stiffness2=1.5643, stiffness3=2.5515, preload2=0.944, low2=0.0)
    ['joint 2 never leaves its preload: M1 = k1 alpha as far as it is locked']
    """
    b = balancer(**parameters)
    trail = follow(b, to)
    found = [trail.why[0]] if trail.why[0] else []
    if trail.reach[0] == 0.0:
        return found
    path = along(b, trail, np.linspace(0.0, trail.reach[0], int(abs(trail.reach[0]) / STEP) + 2))
    return [*found, *straightened(path), *untouched(b.low[0], b.high[0], path, trail),
            *overwound(path, b.stiffness[0], b.quadratic[0])]


def straightened(path: Path) -> list[str]:
    """Where the last two segments come in line, or nearly so."""
    n = path.theta.shape[-1]
    bend = np.sin(path.theta[0, :, -1] - path.theta[0, :, -2])
    least = int(np.abs(bend).argmin())
    crossed = np.flatnonzero(np.diff(np.sign(bend)) != 0)
    if crossed.size:
        at = np.degrees(path.alpha[crossed[0] + 1])
        return [f"segments {n - 1} and {n} straighten at {at:.1f} deg and pass into the other "
                f"elbow"]
    if abs(bend[least]) < STRAIGHT:
        return [f"segments {n - 1} and {n} are straight but for {abs(bend[least]):.3f} rad at "
                f"{np.degrees(path.alpha[least]):.1f} deg: nearly singular"]
    return []


def untouched(low: Array, high: Array, path: Path, trail: Trail) -> list[str]:
    """Stops that are never left, or never met."""
    left = {joint for _, joint, _, side in trail.switches if side == 0}
    met = {joint for _, joint, _, side in trail.switches if side > 0}
    found = []
    for k in range(len(low)):
        if low[k] == 0.0 and k + 1 not in left and (path.side[0, :, k] < 0).all():
            found.append(f"joint {k + 1} never leaves its preload: M1 = k1 alpha as far as it is "
                         f"locked")
        if np.isfinite(high[k]) and high[k] > 0 and k + 1 not in met:
            found.append(f"joint {k + 1} never touches its stop at {high[k]:g} rad")
    return found


def overwound(path: Path, stiffness: Array, quadratic: Array) -> list[str]:
    """Springs wound past their range, or past their largest moment."""
    found = []
    for k in range(len(stiffness)):
        far = path.winding[0, :, k]
        if np.abs(far).max() > RANGE * (1 + 1e-9) and k:
            found.append(f"spring {k + 1} is wound by {np.abs(far).max():.2f} rad, more than a "
                         f"quarter turn")
        if (stiffness[k] + 2 * quadratic[k] * far < 0).any():
            at = np.degrees(path.alpha[(stiffness[k] + 2 * quadratic[k] * far < 0).argmax()])
            found.append(f"spring {k + 1} is past its largest moment from {at:.1f} deg on")
    return found
