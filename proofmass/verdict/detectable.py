"""The smallest change of each parameter of a reference that the tolerances of a run would catch."""

from collections.abc import Callable
from functools import partial

import numpy as np

from proofmass.reference.run_reference import Differences, RunReference
from proofmass.verdict.comparison import DetectableChange

NAN = float("nan")
SMALL_CHANGE = 1e-6
"""Relative change of a parameter for a slope: the neglected terms are 1e-12, and rounding is 1e-10
of the change."""
LARGE_CHANGES = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5)
"""Relative changes to try where a slope is not enough."""
SMOOTH_CURVATURE = 0.1  # curvature over slope up to which the slope is exact to about one digit
DifferencesAt = Callable[[float], Differences]
"""Differences of the channels at a share of a parameter."""


def detectable_changes(
    reference: RunReference, allowed: dict[str, float]
) -> dict[str, dict[str, DetectableChange]]:
    """Find the smallest change of each parameter that the tolerance of each channel would catch.

    Parameters
    ----------
    reference : RunReference
    allowed : dict of str to float
        The tolerance of each channel that is checked [its unit].

    Returns
    -------
    dict of str to dict of str to DetectableChange
        By channel, then by parameter; empty for a recorded curve, which has no parameters. A change
        is relative to the parameter, or, if that is 0, relative to the largest parameter.
    """
    found: dict[str, dict[str, DetectableChange]] = {name: {} for name in allowed}
    for key, value in reference.parameters.items():
        moved = partial(reference.differences, key)
        shares, asked = small_detectable(moved, allowed)
        for name, share in (shares | large_detectable(moved, asked)).items():
            found[name][key] = DetectableChange(
                share if value else reference.step(key, share), value != 0
            )
    return found


def small_detectable(
    moved: DifferencesAt, allowed: dict[str, float]
) -> tuple[dict[str, float], dict[str, float]]:
    """The smallest relative change of a parameter that each channel detects, by its slope.

    The second result are the items of `allowed` that have to be tried with large changes: channels
    in which rounding hides a slope that might matter, or all channels if no slope is large enough.
    A slope is not used if it predicts a change larger than the largest one that is tried, since
    curves are not straight that far.
    """
    found, hidden, small = {}, {}, parameter_slopes(moved)
    for name, most in allowed.items():
        size, smooth = small.get(name, (NAN, False))
        least = SMALL_CHANGE / LARGE_CHANGES[0] * most
        if size > least and (smooth or size > most):
            found[name] = SMALL_CHANGE * most / size if smooth else SMALL_CHANGE
        elif not size <= least:
            hidden[name] = most
    return found, hidden if found else allowed


def large_detectable(moved: DifferencesAt, allowed: dict[str, float]) -> dict[str, float]:
    """The smallest of the large changes that each channel detects; NaN where it is not known.

    A channel that does not detect the largest change is left out.
    """
    found = {}
    for name, most in allowed.items():
        for share in LARGE_CHANGES:
            size = largest_difference([*moved(share), *moved(-share)], name)
            if size > most:
                found[name] = share
            elif np.isnan(size):
                found.setdefault(name, NAN)
            else:
                break
    return found


def parameter_slopes(moved: DifferencesAt) -> dict[str, tuple[float, bool]]:
    """For each channel the largest slope times `SMALL_CHANGE`, and whether the curves are smooth
    there.

    Slopes are central differences, or one-sided differences of second order where the reference has
    no solution on one side. Where a curve is not smooth, or rounding hides its slope, the largest
    difference is given instead.
    """
    up, down = moved(SMALL_CHANGE), moved(-SMALL_CHANGE)
    if up and down:
        parts = {n: ((up[0][n] - down[0][n]) / 2, (up[0][n] + down[0][n]) / 2) for n in up[0]}
    elif near := up or down:
        far = moved(2 * SMALL_CHANGE if up else -2 * SMALL_CHANGE)
        parts = {
            n: ((4 * y - far[0][n]) / 2, (far[0][n] - 2 * y) / 2) if far else (y, y)
            for n, y in near[0].items()
        }
    else:
        return {}
    found = {}
    for name, (slope, bend) in parts.items():
        size = float(np.abs(slope).max())
        smooth = bool(np.abs(bend).max() <= SMOOTH_CURVATURE * size)
        found[name] = (size, True) if smooth else (largest_difference([*up, *down], name), False)
    return found


def largest_difference(sides: Differences, name: str) -> float:
    """The largest difference of a channel; NaN where there is none."""
    sizes = [float(np.abs(side[name]).max()) for side in sides]
    return max((size for size in sizes if np.isfinite(size)), default=NAN)
