"""A balancer's path at any pendulum angles: strides interpolated, then closed by Newton."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from proofmass.analytic.balancer.design import Balancer
from proofmass.analytic.balancer.equilibrium import Point, solve, tangent, windings
from proofmass.analytic.balancer.follow import Trail
from proofmass.analytic.numerics import Array


@dataclass(frozen=True)
class Path:
    """Equilibria (B, A) of a batch at A pendulum angles; NaN beyond a path's end.

    Attributes
    ----------
    alpha : ndarray (A,)
        Pendulum angle, clockwise from the upright [rad].
    theta, winding, moment, energy : ndarray (B, A, n)
        Of each segment or spring: angle from the upright, winding from rest [rad], moment [N m]
        and energy [J].
    rate : ndarray (B, A, n)
        dtheta/dalpha [rad/rad].
    force : ndarray (B, A, 2)
        Force of the chain on the pendulum's tip, in the pendulum's frame: across, to the side of
        growing alpha, and along it [N].
    side : ndarray (B, A, n)
        -1, +1 where a joint is on its lower or upper stop, else 0.
    """

    alpha: Array
    theta: Array
    winding: Array
    moment: Array
    energy: Array
    rate: Array
    force: Array
    side: Array


def along(b: Balancer, trail: Trail, alpha: Array) -> Path:
    """The path at pendulum angles of the side that the trail was followed to.

    A cubic through both ends of a stride, and Newton's method from there.
    """
    alpha = np.asarray(alpha, float)
    count, width = len(b), alpha.size
    design, angle = np.repeat(np.arange(count), width), np.tile(alpha, count)
    reach = np.where(np.isfinite(b.rest).all(axis=-1), np.abs(trail.reach), -1.0)
    known = np.abs(angle) <= np.repeat(reach, width) * (1 + 1e-15)
    each = b[design[known]]
    found, _ = solve(each, guess(trail, design[known], angle[known]))
    rates, _ = tangent(each, found)
    n, j = b.segments, list(b.stopped)
    psi = found.unknowns[:, :n]
    e = windings(each, found.alpha, psi)
    side = np.zeros((len(psi), n))
    side[:, j] = found.side

    def spread(values: Array) -> Array:
        out = np.full((count * width, values.shape[-1]), np.nan)
        out[known] = values
        return out.reshape(count, width, values.shape[-1])

    return Path(alpha, spread(psi + found.alpha[:, None]), spread(e), spread(each.moments(e)),
                spread(each.energies(e)), spread(1.0 + rates[:, :n]),
                spread(found.unknowns[:, n:n + 2]), spread(side))


def guess(trail: Trail, design: NDArray[np.int_], angle: Array) -> Point:
    """Cubic Hermite interpolation (K,) of the strides that hold the angles; rest at angle 0."""
    pieces = trail.pieces
    sense = np.sign(pieces.end.alpha.sum()) or 1.0
    key = 10.0 * pieces.design + sense * pieces.end.alpha
    k = np.minimum(np.searchsorted(key, 10.0 * design + sense * angle), len(key) - 1)
    start, end = pieces.start[k], pieces.end[k]
    width = end.alpha - start.alpha
    t = ((angle - start.alpha) / width)[:, None]
    out, into = pieces.out[k] * width[:, None], pieces.into[k] * width[:, None]
    gap = end.unknowns - start.unknowns
    curve = start.unknowns + t * (out + t * (3 * gap - 2 * out - into + t * (out + into - 2 * gap)))
    return Point(angle, curve, start.side)
