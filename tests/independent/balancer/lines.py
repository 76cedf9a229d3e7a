"""Connected straight pieces through the origin, fitted to a target by least squares.

They are the "best theoretical approximation" of van Nes 2022, tables M.1 to M.20.
"""

from itertools import combinations, product
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from proofmass.analytic.balancer.measures import rmse
from proofmass.base.arrays import Array

KINK_SEARCHES = 10
"""Number of searches for kinks, from as many combinations of samples."""
KINK_SEARCH_STEPS = 40
"""Number of halvings in the search for kinks, from the distance of samples to rounding."""


class Lines(NamedTuple):
    """Connected straight pieces that start in the origin."""

    rmse: Array  # (...) root mean square of the residual [N m]
    slopes: Array  # (..., pieces) slope of each piece [N m/rad]
    kinks: Array  # (..., pieces - 1) angles at which two pieces meet [rad], rising


def best_lines(angle: ArrayLike, target: ArrayLike, pieces: int = 1) -> Lines:
    r"""Fit connected straight pieces through the origin to a target, by least squares.

    ::

        M                __--        M = sum_i c_i max(a - kink_i, 0), kink_0 = 0;
        |          __.-''
        |       .-'                  the slope of piece i is c_0 + ... + c_i
        |    .'
        |  /
        0/------+-----+------ a
             kink_1  kink_2

    Springs in series would have such a curve if the chain had no geometry: one slope for linear
    springs, and another one after each release of a preload. It is no bound for balancers: the
    pieces of a real chain are curved, and the best regular balancer of a sine (0.0835) has a
    smaller error than the straight line.

    Parameters
    ----------
    angle : points [rad] (points,), positive and rising
    target : moments at the points (..., points) [N m]
    pieces : number of pieces: 1, 2 or 3

    Returns
    -------
    Lines

    Raises
    ------
    ValueError
        There are not more points than the 2 pieces - 1 unknowns.

    Notes
    -----
    Kinks at all combinations of samples are tried first, then those of a shrinking lattice about
    each of the best ten.  Kinks are found to about 1e-8 rad and the rmse to rounding: for all
    targets of the product a global search over the kinks finds no smaller one.

    "Best theoretical approximation" of van Nes 2022, tables M.1 to M.20. The errors of its straight
    lines (0.0861 sine, 0.1016 progressive, 0.2755 laevo) are means with angle 0 as a point, those
    of its kinked lines are not; without this point they are 0.0866, 0.1021, 0.2770 at 90 points.
    Its error for laevo in three pieces, 0.0207, is that of a local optimum; 0.0175 is possible.
    """
    a, wanted = np.asarray(angle, float), np.asarray(target, float)
    if not a.size > 2 * pieces - 1:
        raise ValueError(f"angle must have more than {2 * pieces - 1} points, got {a.size}")
    kinks = np.array(list(combinations(a[:-1], pieces - 1)))
    order = np.argsort(fit_pieces(a, wanted, kinks)[1], axis=-1, kind="stable")
    best = kinks[order[..., :KINK_SEARCHES]]
    lattice = np.array(list(product((-1.0, -0.5, 0.0, 0.5, 1.0), repeat=pieces - 1)))
    step = np.diff(a).max()
    for _ in range(KINK_SEARCH_STEPS if pieces > 1 else 0):
        candidates = np.clip(best[..., None, :] + step * lattice, 0.0, a[-1])
        chosen = np.argmin(fit_pieces(a, wanted[..., None, :], candidates)[1], axis=-1)
        best = np.take_along_axis(candidates, chosen[..., None, None], axis=-2)[..., 0, :]
        step *= 0.5
    changes, errors = fit_pieces(a, wanted, np.sort(best, axis=-1))
    first = np.argmin(errors, axis=-1)[..., None]
    best, changes = (
        np.take_along_axis(each, first[..., None], axis=-2)[..., 0, :]
        for each in (np.sort(best, axis=-1), changes)
    )
    return Lines(
        np.take_along_axis(errors, first, axis=-1)[..., 0], np.cumsum(changes, axis=-1), best
    )


def fit_pieces(angle: Array, target: Array, kinks: Array) -> tuple[Array, Array]:
    """Fit changes of slope (..., sets, pieces) for sets of kinks; with the rmse (..., sets)."""
    starts = np.insert(kinks, 0, 0.0, axis=-1)
    hinges = np.maximum(angle[:, None] - starts[..., None, :], 0.0)
    changes = np.linalg.pinv(hinges) @ target[..., None, :, None]  # kinks may coincide
    fitted = (hinges @ changes)[..., 0]
    return changes[..., 0], rmse(fitted, target[..., None, :])
