"""How well a balancer meets its target: residual moment, residual work, spread of the energy."""

from itertools import combinations, product
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from proofmass.analytic.numerics import Array

HALVINGS = 40  # of the kinks' search: from a sample's distance to rounding


def precision_points(count: int) -> Array:
    """Pendulum angles j pi/(2 count) [rad], j = 1 .. count; zero is not one of them.

    Van Nes 2022, lines 735-772: 90 for three segments, 15 for four.

    >>> np.degrees(precision_points(3)).round(9)
    array([30., 60., 90.])
    """
    if count < 1:
        raise ValueError(f"count must be at least 1, got {count}")
    return 0.5 * np.pi * np.arange(1, count + 1) / count


def rmse(moment: ArrayLike, target: ArrayLike, *, scale: ArrayLike = 1.0) -> Array:
    """Root mean square of moment - target over the last axis, in units of `scale` = m g r [N m].

    Van Nes 2022, eq. 18. `moment` and `target` [N m] broadcast, (..., points); returns (...).

    >>> float(rmse([1.0, 2.0], [1.0, 4.0], scale=2.0).round(9))
    0.707106781
    """
    error = np.asarray(moment, float) - np.asarray(target, float)
    return np.sqrt(np.mean(error**2, axis=-1)) / scale


def work_reduction(moment: ArrayLike, reference: ArrayLike, angle: ArrayLike) -> Array:
    r"""Share of the work against `reference` [%] that is left no more when `moment` balances it.

    ::

        100 (1 - integral |moment - reference| dangle / integral reference dangle)

    It means nothing without its reference: the same balancer has another number against the sine
    than against the model of itself (see `prototype.REDUCTIONS`).

    Parameters
    ----------
    moment, reference : balancing moment and what it should be [N m], (..., points)
    angle : pendulum angle [rad] (points,), rising

    Returns
    -------
    (...) percent, 100 for a perfect balancer, negative for one that is worse than none

    Raises
    ------
    ValueError
        The reference does no work over these angles.

    Notes
    -----
    Trapezoids on the points given, as in van Nes 2022, eq. 34 and line 4119, whose points leave out
    angle 0; that changes it by less than 0.02 percentage points there.

    Examples
    --------
    >>> angle = precision_points(90)
    >>> round(float(work_reduction(0.9 * np.sin(angle), np.sin(angle), angle)), 9)
    90.0
    """
    given, wanted, a = (np.asarray(curve, float) for curve in (moment, reference, angle))
    work = np.trapezoid(wanted, a, axis=-1)
    if not np.all(work > 0.0):
        raise ValueError(f"reference must do positive work over angle, got {np.min(work):.6g} J")
    return np.asarray(100.0 * (1.0 - np.trapezoid(np.abs(given - wanted), a, axis=-1) / work))


def energy_spread(*energies: ArrayLike, scale: ArrayLike = 1.0) -> Array:
    r"""How unevenly the springs share the energy: mean over the points of their differences.

    ::

        f2 = mean_j sqrt(sum over pairs (V_a - V_b)^2)/(m g r) = mean_j sqrt(n) |V - mean V|/(m g r)

    Parameters
    ----------
    energies : of each of the n springs [J], each (..., points)
    scale : m g r [N m]

    Returns
    -------
    (...); zero if all springs hold the same

    Notes
    -----
    Van Nes 2022, eqs 19-22 and line 4117, with three springs. Pairs of n springs by the identity
    on the right.

    Examples
    --------
    >>> round(float(energy_spread([1.0], [2.0], [4.0])), 9) == round(14**0.5, 9)
    True
    """
    springs = np.stack(np.broadcast_arrays(*(np.asarray(v, float) for v in energies)))
    square = len(springs) * np.sum((springs - springs.mean(axis=0)) ** 2, axis=0)
    return np.mean(np.sqrt(square), axis=-1) / scale


class Lines(NamedTuple):
    """Connected straight pieces that start in the origin."""

    rmse: Array  # (...) what is left [N m]
    slopes: Array  # (..., pieces) [N m/rad]
    kinks: Array  # (..., pieces - 1) where two pieces meet [rad], rising


def best_lines(angle: ArrayLike, target: ArrayLike, pieces: int = 1) -> Lines:
    r"""Closest chain of straight pieces through the origin, by least squares at the points.

    ::

        M                __--        M = sum_i c_i max(a - kink_i, 0), kink_0 = 0;
        |          __.-''
        |       .-'                  the slope of piece i is c_0 + ... + c_i
        |    .'
        |  /
        0/------+-----+------ a
             kink_1  kink_2

    It is what springs in series could do if the chain had no geometry: one slope for linear
    springs, another after each release of a preload. Not a bound: a real chain bends its pieces,
    and the best regular balancer of a sine (0.0835) beats the straight line.

    Parameters
    ----------
    angle : points [rad] (points,), positive and rising
    target : (..., points) [N m]
    pieces : 1, 2, 3

    Returns
    -------
    Lines

    Raises
    ------
    ValueError
        Not more points than free numbers, 2 pieces - 1.

    Notes
    -----
    Kinks on all samples first, then a shrinking lattice about the best: kinks to about 1e-8 rad,
    rmse to rounding, unless two minima lie within one sample's distance.

    "Best theoretical approximation" of van Nes 2022, tables M.1 to M.20. Its straight lines (0.0861
    sine, 0.1016 progressive, 0.2755 laevo) were averaged with angle 0 as a point, where its kinked
    ones were not; without it they are 0.0866, 0.1021, 0.2770 at 90 points. Its laevo in three
    pieces, 0.0207, is a local optimum; 0.0175 can be had.

    Examples
    --------
    >>> angle = precision_points(90)
    >>> line = best_lines(angle, np.sin(angle))
    >>> round(float(line.rmse), 5), round(float(line.slopes[0]), 4)
    (0.08656, 0.7718)
    """
    a, wanted = np.asarray(angle, float), np.asarray(target, float)
    if not a.size > 2 * pieces - 1:
        raise ValueError(f"angle must have more than {2 * pieces - 1} points, got {a.size}")
    kinks = np.array(list(combinations(a[:-1], pieces - 1)))
    best = kinks[np.argmin(_fit(a, wanted, kinks)[1], axis=-1)]
    lattice = np.array(list(product((-1.0, -0.5, 0.0, 0.5, 1.0), repeat=pieces - 1)))
    step = np.diff(a).max()
    for _ in range(HALVINGS if pieces > 1 else 0):
        near = best[..., None, :] + step * lattice
        chosen = np.argmin(_fit(a, wanted, near)[1], axis=-1)
        best = np.take_along_axis(near, chosen[..., None, None], axis=-2)[..., 0, :]
        step *= 0.5
    best = np.sort(best, axis=-1)
    changes, left = _fit(a, wanted, best[..., None, :])
    return Lines(left[..., 0], np.cumsum(changes[..., 0, :], axis=-1), best)


def _fit(angle: Array, target: Array, kinks: Array) -> tuple[Array, Array]:
    """Changes of slope (..., sets, pieces) and rmse (..., sets) for sets of kinks."""
    starts = np.insert(kinks, 0, 0.0, axis=-1)
    hinges = np.maximum(angle[:, None] - starts[..., None, :], 0.0)
    changes = np.linalg.pinv(hinges) @ target[..., None, :, None]  # kinks may coincide
    fitted = (hinges @ changes)[..., 0]
    return changes[..., 0], rmse(fitted, target[..., None, :])
