r"""Static equilibrium of a balancer's chain in the pendulum's frame, as one linear system.

With psi the segments' angles from the pendulum, e = D psi + alpha (1, 0, ..) - e0 the windings and
c(psi) = sum l_i u(psi_i) - (0, r) the loop, the energy is stationary under loop and stops::

    D^T M(e) + A^T lambda - S^T mu = 0,     c = 0,     e_j = bound_j or mu_j = 0

A = dc/dpsi; S picks the joints with stops.  lambda is the force of the chain on the pendulum's tip,
mu_j the moment of a stop on its joint, positive if it winds the joint up.  Newton's matrix is

    [ D^T M' D - diag(l_i lambda.u(psi_i))   A^T   -S^T ]
    [ A                                       0      0  ]
    [ -S or 0                                 0    0 or 1 ]

A chain stretched between its ends is not singular in these coordinates; a fold of the path is.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from proofmass.analytic.balancer.model import Balancer
from proofmass.analytic.numerics import Array

Which = NDArray[Any]

STILL = 1e-9  # [rad] the last Newton step; what is left is its square
MOST = 12


@dataclass(frozen=True)
class Point:
    """Equilibria, one for each of a batch.

    Attributes
    ----------
    alpha : ndarray (B,)
        Pendulum angle, clockwise from the upright [rad].
    unknowns : ndarray (B, n + 2 + s)
        psi [rad], lambda [N] and mu [N m], s the joints with stops.
    side : ndarray (B, s)
        [1]: -1 where the joint is on its lower stop, +1 on its upper one, 0 between them.
    """

    alpha: Array
    unknowns: Array
    side: Array

    def __getitem__(self, which: Which) -> "Point":
        return Point(self.alpha[which], self.unknowns[which], self.side[which])

    def put(self, which: Which, other: "Point") -> None:
        """Replace some of the batch."""
        self.alpha[which], self.unknowns[which] = other.alpha, other.unknowns
        self.side[which] = other.side

    def ahead(self, way: Array, along: Array) -> "Point":
        """Moved on by `way` (B,) of alpha along the change of the unknowns with it."""
        return Point(self.alpha + way, self.unknowns + way[:, None] * along, self.side)

    @staticmethod
    def join(points: Sequence["Point"]) -> "Point":
        """Several batches as one."""
        alpha, unknowns, side = zip(*((p.alpha, p.unknowns, p.side) for p in points), strict=True)
        return Point(np.concatenate(alpha), np.concatenate(unknowns), np.concatenate(side))


def windings(b: Balancer, alpha: Array, psi: Array) -> Array:
    """Windings (B, n) of all springs from rest [rad]."""
    turned = psi - b.rest
    e = np.diff(turned, axis=-1, prepend=0.0)
    e[..., 0] += alpha
    return e


def bounds(b: Balancer, side: Array) -> Array:
    """The winding [rad] at which each joint with stops is held; 0 where it is not."""
    j = list(b.stopped)
    with np.errstate(invalid="ignore"):
        return np.where(side < 0, b.low[:, j], np.where(side > 0, b.high[:, j], 0.0))


def system(b: Balancer, p: Point) -> tuple[Array, Array]:
    """Residual (B, N) and Newton's matrix (B, N, N) of the equilibrium."""
    n, j = b.segments, list(b.stopped)
    psi, force, stop = np.split(p.unknowns, [n, n + 2], axis=-1)
    e = windings(b, p.alpha, psi)
    moment, slope = b.moments(e), b.slopes(e)
    east, north = b.length * np.sin(psi), b.length * np.cos(psi)
    held = (p.side != 0).astype(float)
    load = moment.copy()
    load[:, j] -= stop
    residual = np.concatenate(
        [
            load
            - np.pad(load[:, 1:], ((0, 0), (0, 1)))
            + force[:, :1] * north
            - force[:, 1:] * east,
            np.stack([east.sum(-1), north.sum(-1) - b.pendulum], axis=-1),
            np.where(held > 0, bounds(b, p.side) - e[:, j], stop),
        ],
        axis=-1,
    )
    matrix = np.zeros((*residual.shape, residual.shape[-1]))
    i, after = np.arange(n), np.pad(slope[:, 1:], ((0, 0), (0, 1)))
    matrix[:, i, i] = slope + after - force[:, :1] * east - force[:, 1:] * north
    matrix[:, i[1:], i[:-1]] = matrix[:, i[:-1], i[1:]] = -slope[:, 1:]
    matrix[:, n, i] = matrix[:, i, n] = north
    matrix[:, n + 1, i] = matrix[:, i, n + 1] = -east
    for k, joint in enumerate(j):
        row = n + 2 + k
        matrix[:, joint, row], matrix[:, joint - 1, row] = -1.0, 1.0
        matrix[:, row, joint], matrix[:, row, joint - 1] = -held[:, k], held[:, k]
        matrix[:, row, row] = 1.0 - held[:, k]
    return residual, matrix


def solve(b: Balancer, p: Point) -> tuple[Point, Array]:
    """Newton's method from `p`, its angles and stops held; the moves [rad] it took, NaN if lost."""
    unknowns, moved = p.unknowns.copy(), np.zeros(len(b))
    left = np.arange(len(b))
    for _ in range(MOST):
        residual, matrix = system(b[left], Point(p.alpha[left], unknowns[left], p.side[left]))
        step = -solved(matrix, residual)
        unknowns[left] += step
        size = np.abs(step[:, : b.segments]).max(axis=-1)
        moved[left] += size
        left = left[~(size < STILL)]
        if not left.size:
            break
        left = left[moved[left] < 2.0]
    moved[left] = np.nan
    moved[~(moved < 2.0)] = np.nan
    return Point(p.alpha, unknowns, p.side), moved


def tangent(b: Balancer, p: Point) -> tuple[Array, Which]:
    """Change of the unknowns with alpha (B, N), and whether the equilibrium is stable (B,).

    It is stable as long as the determinant of Newton's matrix keeps the sign that a minimum of the
    energy gives it: that of (-1)^(stops held).
    """
    _, matrix = system(b, p)
    pull = np.zeros_like(p.unknowns)  # of the residual with alpha
    e = windings(b, p.alpha, p.unknowns[:, : b.segments])
    pull[:, 0] = b.slopes(e)[:, 0]
    with np.errstate(invalid="ignore"):  # a lost equilibrium is not stable
        sign = np.linalg.slogdet(matrix)[0] * (-1.0) ** (p.side != 0).sum(axis=-1)
    return -solved(matrix, pull), np.asarray(sign > 0)


def solved(matrix: Array, right: Array) -> Array:
    """``matrix^-1 right`` for each of a batch; NaN where a matrix is singular."""
    try:
        return np.asarray(np.linalg.solve(matrix, right[..., None])[..., 0])
    except np.linalg.LinAlgError:
        out = np.full_like(right, np.nan)
        for k in np.flatnonzero(np.linalg.det(matrix) != 0.0):
            out[k] = np.linalg.solve(matrix[k], right[k])
        return out


def stable_at_rest(b: Balancer, p: Point) -> Which:
    """Whether the rest posture is a minimum of the energy (B,): the matrix has its inertia."""
    _, matrix = system(b, p)
    held = (p.side != 0).sum(axis=-1)
    return np.asarray((np.linalg.eigvalsh(matrix) < 0).sum(axis=-1) == 2 + held)


def at_rest(b: Balancer) -> Point:
    """The rest posture: the pendulum upright, all joints unwound, preloads held by their stops."""
    j = list(b.stopped)
    low, high = b.low[:, j] == 0, b.high[:, j] == 0
    side = np.where(low, -1, np.where(high, 1, 0))
    unknowns = np.concatenate([b.rest, np.zeros((len(b), 2)), b.preload[:, j]], axis=-1)
    return Point(np.zeros(len(b)), unknowns, side)


def margins(b: Balancer, p: Point) -> Array:
    """How far each joint with stops (B, s) is from switching; negative beyond it.

    The way to the nearer stop [rad] of a joint that is free, the stop's push [N m] of one held.
    """
    j, n = list(b.stopped), b.segments
    e, push = windings(b, p.alpha, p.unknowns[:, :n])[:, j], p.unknowns[:, n + 2 :]
    way = np.minimum(e - b.low[:, j], b.high[:, j] - e)
    return np.where(p.side == 0, way, -p.side * push)


def nearest(b: Balancer, p: Point) -> Array:
    """The stop (B, s) that each joint is nearer to: -1 the lower, +1 the upper one."""
    j = list(b.stopped)
    e = windings(b, p.alpha, p.unknowns[:, : b.segments])[:, j]
    return np.where(e - b.low[:, j] <= b.high[:, j] - e, -1, 1)
