"""The start of a motion: the closed pose nearest to that of the key, and the nearest rates.

A key need not fit: its loops are closed to the digits of the file, and a drive may begin at another
value or with another rate.  All references and engines start a motion with degrees of freedom that
its drives leave in the same state,

    |q - q_key| least    subject to  g(q) = 0,  q_d = profile(t0)
    |v - v_key| least    subject to  J v = 0,   v_d = profile'(t0)

The norm is that of the rates of all joints as MuJoCo counts them [rad, m], unweighted; a difference
of two poses consists of the rates that lead from one to the other in a unit of time.  If several
poses are nearest to the key among those near them, the start is on the branch to which the least
changes lead while the drives go in a straight line from the key's values to their first ones.

The pose is found in two parts: Newton's method with steps of least norm closes the loops, and
steps along the free motions, with the lengths of J. Barzilai and J. Borwein (Two-point step size
gradient methods, 1988), then bring the pose nearest to the key.
"""

from typing import Protocol

import numpy as np

from proofmass.analytic.numerics import CannotAssemble
from proofmass.base.arrays import Array

MAX_KEY_VIOLATION = 0.05
"""Largest violation of loops in the pose of a key [extents or rad] that is closed; a larger one is
no rounding of the key, but a wrong number.  References and engines refuse it alike."""
DRIVE_STAGE = 0.05
"""Longest move of a drive [rad, or extents] from one closed pose to the next on the way to the
start, short enough to keep the branch."""
START_ROUNDING = 1e-15
"""Size of a step [rad, or extents] below which further ones would be rounding."""
NEARLY_CLOSED = 1e-10
"""Size of a step [rad, or extents] after which Newton's method gains no more if a step is not
smaller than the one before it."""
START_RANK_TOLERANCE = 1e-10
"""Singular values below this share of the largest belong to dependent constraints."""
MAX_CLOSING_STEPS = 50
"""Largest number of Newton steps to close the loops; more are never needed near a closed pose."""
MAX_SLIDES = 200
"""Largest number of steps along the free motions; 5 to 40 are usual."""
SMALL_SLOPE = 1e-6
"""Component [rad, or extents] of the way from the key along the free motions below which the gain
of a step, its square, is near rounding."""
MAX_WORSE_SLIDES = 5
"""Number of steps close to the end that gain nothing, after which the slope is rounding."""
MAX_SLOPE = 1e-9
"""Largest component [rad, or extents] of the way from the key that may remain along the free
motions."""


class Constrained(Protocol):
    """Loops and drives of a mechanism as functions of its pose."""

    @property
    def key(self) -> Array:
        """The pose of the key (poses,)."""

    @property
    def sizes(self) -> Array:
        """Units of the rates (rates,): 1 rad, or the extent [m]."""

    def prescribed(self, q: Array) -> tuple[Array, Array]:
        """Violations of the loops, then values of the drives (rows + drives,), and Jacobian."""

    def moved(self, q: Array, move: Array) -> Array:
        """The pose that a move (rates,) leads to from a pose q (poses,)."""

    def way(self, q: Array) -> Array:
        """The move (rates,) that leads from the key to a pose q (poses,)."""


def start_pose(mechanism: Constrained, values: Array) -> Array:
    """Find the closed pose (poses,) nearest to the key with the drives at given values.

    Whether its loops are closed is for the caller to check.

    Parameters
    ----------
    mechanism : Constrained
    values : ndarray (drives,)
        Values of the drives [rad or m].

    Raises
    ------
    CannotAssemble
        No pose is nearest.
    """
    q = mechanism.key
    found, rows = mechanism.prescribed(q)
    target = np.zeros(len(found))
    drives = slice(len(found) - len(values), None)
    units = np.abs(rows[drives]) @ mechanism.sizes
    now = found[drives].copy()
    stages = int(np.max(np.abs(values - now) / units, initial=0.0) / DRIVE_STAGE) + 1
    for share in np.linspace(0.0, 1.0, stages + 1)[1:]:
        target[drives] = values if share == 1.0 else now + share * (values - now)
        q = _close(mechanism, q, target)
    return _slide(mechanism, q, target)


def start_rates(rows: Array, v: Array, wanted: Array) -> Array:
    """The rates nearest to v (rates,) with ``rows @ rates = wanted``."""
    for _ in range(2):  # the second change is the rounding of the first
        v = v + _least_move(rows, wanted - rows @ v)
    return v


def _least_move(rows: Array, change: Array) -> Array:
    """The least move (rates,) that changes prescribed functions by a given amount.

    Rows of length one make the rank independent of units.
    """
    lengths = np.linalg.norm(rows, axis=1)
    lengths[lengths == 0.0] = 1.0
    scaled = rows / lengths[:, None]
    return np.asarray(np.linalg.lstsq(scaled, change / lengths, rcond=START_RANK_TOLERANCE)[0])


def _close(mechanism: Constrained, q: Array, target: Array) -> Array:
    """Close the loops by Newton's method with steps of least norm."""
    last = np.inf
    for _ in range(MAX_CLOSING_STEPS):
        found, rows = mechanism.prescribed(q)
        if not (np.isfinite(found).all() and np.isfinite(rows).all()):
            break
        move = _least_move(rows, target - found)
        size = _size(mechanism, move)
        if size < START_ROUNDING or (last < NEARLY_CLOSED and not size < last):
            return q
        q, last = mechanism.moved(q, move), size
    if not last < NEARLY_CLOSED:
        raise CannotAssemble("the loops cannot be closed from the pose of the key")
    return q


def _slide(mechanism: Constrained, q: Array, target: Array) -> Array:
    """Move a closed pose along the free motions until it is the nearest one to the key.

    A step that does not come nearer is shortened.  Close to the end the distance no longer tells,
    since it changes by rounding; then the pose with the least slope is kept.
    """
    way, slope = _slope(mechanism, q)
    length, size = 1.0, _size(mechanism, slope)
    best, least, worse = q, size, 0
    for _ in range(MAX_SLIDES):
        if least < START_ROUNDING or worse == MAX_WORSE_SLIDES:
            break
        there = _close(mechanism, mechanism.moved(q, -length * slope), target)
        new_way, new_slope = _slope(mechanism, there)
        if size > SMALL_SLOPE and not new_way @ new_way < way @ way:
            length /= 4.0
            continue
        step, bend = new_way - way, new_slope - slope
        q, way, slope, size = there, new_way, new_slope, _size(mechanism, new_slope)
        length = float(step @ step / (step @ bend)) if step @ bend > 0 else 1.0
        if size < least:
            best, least, worse = q, size, 0
        else:
            worse += size < SMALL_SLOPE
    if not least < MAX_SLOPE:
        raise CannotAssemble("no pose of the closed loops is nearest to the key's")
    return best


def _size(mechanism: Constrained, move: Array) -> float:
    """Largest component of a move [rad, or extents]."""
    return float(np.abs(move / mechanism.sizes).max(initial=0.0))


def _slope(mechanism: Constrained, q: Array) -> tuple[Array, Array]:
    """The way (rates,) from the key to a closed pose, and its part along the free motions."""
    _, rows = mechanism.prescribed(q)
    way = mechanism.way(q)
    return way, way - _least_move(rows, rows @ way)
