"""Accelerations of a mechanism in a given motion, with exact loops and drives and dry friction."""

import numpy as np

from proofmass.analytic.joints_at_rest import RestRows, free_motions
from proofmass.base.arrays import Array

SLIPPING_RATE = 1e-12
"""Rate below which a joint with dry friction is at rest [rad/s, or sizes per s]."""
REDUNDANT_VALUE_SHARE = 1e-13
"""Singular value, as a share of the largest, below which rows are redundant: exact copies of
others, but for rounding."""


def solve_accelerations(mass: Array, force: Array, rows: Array, needed: Array) -> Array:
    """Accelerations a (n,) with ``M a + J^T f = force`` and ``J a = needed`` [SI].

    The rows of J (rows, n) may be redundant.

    >>> force, rows = np.array([3.0, 1.0]), np.array([[0.0, 1.0]])
    >>> solve_accelerations(np.eye(2), force, rows, np.zeros(1)).round(12) + 0.0
    array([3., 0.])
    """
    matrix = np.block([[mass, rows.T], [rows, np.zeros((len(rows), len(rows)))]])
    right = np.concatenate([force, needed])
    return np.asarray(np.linalg.lstsq(matrix, right, rcond=REDUNDANT_VALUE_SHARE)[0][: len(mass)])


def accelerations_with_friction(
    mass: Array, force: Array, rows: Array, needed: Array, rates: Array, bounds: Array
) -> Array:
    """The accelerations of `solve_accelerations` with dry friction of coordinates.

    A coordinate that slips has its largest friction; one at rest begins to move, or stays; see
    `proofmass.analytic.joints_at_rest`.

    Parameters
    ----------
    mass, force, rows, needed : ndarray
        See `solve_accelerations` [SI].
    rates : ndarray (n,)
        Rates of the coordinates [rad/s or 1/s]: those of slides in sizes.
    bounds : ndarray (n,)
        Largest friction of each [N m or N].

    Examples
    --------
    A block of 2 kg with a friction of 3 N slips, begins to slip, and sticks:

    >>> free = np.zeros((0, 1)), np.zeros(0)
    >>> def acceleration(push, rate):
    ...     rates, bounds = np.array([rate]), np.array([3.0])
    ...     one = np.array([[2.0]]), np.array([push])
    ...     found = accelerations_with_friction(*one, *free, rates, bounds)
    ...     return round(float(found[0]), 12) + 0.0
    >>> acceleration(5.0, -1.0), acceleration(5.0, 0.0), acceleration(2.0, 0.0)
    (4.0, 1.0, 0.0)
    """
    rubs = np.flatnonzero(bounds)
    senses = np.where(np.abs(rates[rubs]) > SLIPPING_RATE, np.sign(rates[rubs]), 0.0)
    slips, still = rubs[senses != 0.0], rubs[senses == 0.0]
    own = np.eye(len(mass))
    force = force - own[slips].T @ (senses[senses != 0.0] * bounds[slips])
    at_rest = RestRows(
        free_motions(mass, rows)[still], bounds[still], np.zeros(len(still), dtype=bool)
    )
    begins = at_rest.decide(solve_accelerations(mass, force, rows, needed)[still])
    force = force - own[still].T @ (begins * bounds[still])
    stuck = own[still[begins == 0.0]]
    rows, needed = np.vstack([rows, stuck]), np.append(needed, np.zeros(len(stuck)))
    return solve_accelerations(mass, force, rows, needed)
