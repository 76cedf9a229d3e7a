"""Closing the loops of one pose, or of many at once, by Newton's method; rates in closed poses.

Joint values are measured in `Mechanism.scale` and the loops in `Mechanism.size`, so that one
number is small or large for both.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from proofmass.analytic.numerics import Array
from proofmass.analytic.planar.loops import bias, gap, loop_jacobian, residual
from proofmass.analytic.planar.mechanism import (
    CannotAssemble,
    Mechanism,
    Overconstrained,
    SingularHere,
)
from proofmass.analytic.planar.motion import move

Index = NDArray[np.intp]
RANK = 1e-9
"""Singular values below this share of the largest count as zero."""
CLOSED = 1e-12
"""Loops that are open by less, in sizes of the mechanism, are closed: rounding of their sums."""
BLOCK = 4096
"""Poses solved at once: their arrays stay in the processor's cache."""


@dataclass(frozen=True)
class Drives:
    """Which joints are driven and which follow."""

    driven: Index
    following: Index

    @classmethod
    def of(cls, m: Mechanism, names: tuple[str, ...]) -> "Drives":
        """Find the driven joints by name."""
        there = [j.name for j in m.joints]
        for name in names:
            if name not in there:
                raise ValueError(f"no joint {name!r}; there are: {', '.join(there)}")
        driven = np.array([there.index(name) for name in names], np.intp)
        return cls(driven, np.setdiff1d(np.arange(len(there)), driven))


def scaled_jacobian(m: Mechanism, q: Array) -> Array:
    """Jacobian of the loops in their own units (n, rows, joints)."""
    return loop_jacobian(m, move(m, q), q) * m.scale / m.size


def newton(m: Mechanism, q: Array, d: Drives, steps: int = 12) -> Array:
    """Close the loops of poses (n, joints) by moving the joints that follow; drives stay.

    The last step is smaller than 1e-8, so by quadratic convergence its error is rounding.

    Raises
    ------
    SingularHere
        The Jacobian has lost its rank.
    CannotAssemble
        No convergence; says how far the loops stay open.
    """
    q = q.copy()
    for k in range(0, len(q), BLOCK):
        _close(m, q[k:k + BLOCK], d, steps)
    return q


def _close(m: Mechanism, q: Array, d: Drives, steps: int) -> None:
    """Newton's method on poses (n, joints), in place."""
    for _ in range(steps):
        motion = move(m, q)
        matrix = (loop_jacobian(m, motion, q) * m.scale)[..., d.following]
        try:
            step = np.linalg.solve(matrix, residual(m, motion, q)[..., None])[..., 0]
        except np.linalg.LinAlgError:
            raise SingularHere("the loops' Jacobian is singular") from None
        q[:, d.following] -= step * m.scale[d.following]
        if not np.abs(step).max(initial=0.0) > 1e-8:
            break
    left = np.abs(residual(m, move(m, q), q)).max(axis=-1, initial=0.0) / m.size
    if not left.max(initial=0.0) < CLOSED:
        open_by, name = gap(m, q[int(np.argmax(np.where(np.isfinite(left), left, np.inf)))])
        raise CannotAssemble(f"loop {name!r} stays open by {open_by:.3g} m")


def nearest(m: Mechanism, q: Array) -> Array:
    """Close the loops of one pose (joints,) with the least change of all its joints [rad, m]."""
    for _ in range(50):
        motion = move(m, q[None])
        open_by = residual(m, motion, q[None])[0]
        step = np.linalg.lstsq(loop_jacobian(m, motion, q[None])[0], open_by, rcond=RANK)[0]
        q = q - step
        if not np.abs(step).max(initial=0.0) > 1e-14:
            break
    if m.rows and not gap(m, q)[0] < CLOSED * m.size:
        best = least_squares(lambda q: residual(m, move(m, q[None]), q[None])[0], m.start)
        open_by, name = gap(m, best.x)
        raise CannotAssemble(f"cannot be assembled from the start pose: loop {name!r} stays open "
                             f"by {open_by:.3g} m at best")
    return q


def fitting(m: Mechanism, q: Array, v: Array) -> Array:
    """Rates (joints,) that keep the loops of a closed pose closed, with the least change of v."""
    matrix = loop_jacobian(m, move(m, q[None]), q[None])[0]
    return np.asarray(v - np.linalg.lstsq(matrix, matrix @ v, rcond=RANK)[0])


def freedoms(m: Mechanism, q: Array) -> int:
    """Mobility of a closed pose (joints,): joints less independent loop equations.

    The rank is low at a singular pose too, so a neighbour that the mechanism can reach decides.

    Raises
    ------
    Overconstrained
        The loops hold a direction twice.
    """
    for _ in range(3):
        matrix = scaled_jacobian(m, q[None])[0]
        _, values, directions = np.linalg.svd(matrix)
        rank = int((values > RANK * max(values.max(initial=0.0), RANK)).sum())
        if rank == m.rows:
            return len(m.joints) - m.rows
        q = nearest(m, q + 0.03 * directions[rank:].sum(axis=0) * m.scale)
    names = ", ".join(map(repr, m.loop_names))
    raise Overconstrained(f"over-constrained: the loops {names} give {m.rows} equations, of which "
                          f"only {rank} are independent; take a loop or a part out")


def rates(m: Mechanism, q: Array, d: Drives, rate: Array,
          acceleration: Array) -> tuple[Array, Array]:
    """Rates and accelerations of all joints (n, joints) in closed poses, from the drives' own.

    Raises
    ------
    SingularHere
        At one of the poses the drives do not determine them.
    """
    v, a = np.zeros_like(q), np.zeros_like(q)
    v[:, d.driven], a[:, d.driven] = rate, acceleration
    for k in range(0, len(q), BLOCK):
        _rates(m, d, *(x[k:k + BLOCK] for x in (q, v, a)))
    return v, a


def _rates(m: Mechanism, d: Drives, q: Array, v: Array, a: Array) -> None:
    """Fill in the rates and accelerations of the joints that follow, (n, joints), in place."""
    matrix = loop_jacobian(m, move(m, q), q)
    try:
        solve = np.linalg.inv(matrix[..., d.following])
    except np.linalg.LinAlgError:
        raise SingularHere("the drives do not determine the rates at one of the poses") from None
    v[:, d.following] = -_times(solve, _times(matrix[..., d.driven], v[:, d.driven]))
    drift = bias(m, move(m, q, v, np.zeros_like(q)), q, v)
    a[:, d.following] = -_times(solve, _times(matrix[..., d.driven], a[:, d.driven]) + drift)


def condition(m: Mechanism, q: Array, d: Drives) -> Array:
    """Condition of closed poses (n,): how much rounding grows in them; infinite where singular."""
    if not d.following.size:
        return np.ones(len(q))
    return np.asarray(np.linalg.cond(scaled_jacobian(m, q)[..., d.following]))


def _times(matrix: Any, vector: Any) -> Array:
    return np.asarray((matrix @ vector[..., None])[..., 0])
