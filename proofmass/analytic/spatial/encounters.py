"""What a motion may meet that the solver does not have: contacts, and ends of tendons' ranges.

A motion that meets none of them is the same as without them.  One that does is refused, with the
place where it does.
"""

import numpy as np

from proofmass.analytic.numerics import NotCovered, interpolate_cubic
from proofmass.analytic.spatial.kinematics import TreeMotion
from proofmass.analytic.spatial.mechanism import Tree
from proofmass.analytic.spatial.terms import tendon_length
from proofmass.analytic.term_source import TermSource
from proofmass.base.arrays import Array
from proofmass.base.wording import number

PLACES_BETWEEN = np.linspace(0.0, 1.0, 9)[1:]
"""Shares of the way between two samples at which a tendon's length is looked at."""


def refuse_encounters(
    tree: Tree, source: TermSource, motion: TreeMotion, q: Array, v: Array, times: Array | None
) -> None:
    """Raise NotCovered if a motion, or a sweep without `times`, meets a contact or a tendon's end.

    Parameters
    ----------
    tree : Tree
    source : TermSource
        Finds contacts.
    motion : TreeMotion
        Of the bodies.
    q, v : ndarray (n, poses), (n, rates)
        Poses and rates [SI].
    times : ndarray (n,) or None
        [s]
    """
    refuse_tendon_ends(tree, motion, q, v, times)
    if tree.data.may_touch and (words := source.first_contact(times, q)):
        raise NotCovered(
            f'{words}: end the motion before, or give <option> a <flag contact="disable"/>'
        )


def refuse_tendon_ends(
    tree: Tree, motion: TreeMotion, q: Array, v: Array, times: Array | None
) -> None:
    """Raise NotCovered if a tendon reaches an end of its range, where its limit begins to act."""
    for tendon in tree.tendons:
        if not tendon.is_limited:
            continue
        length = tendon_length(tree, motion, q, v, tendon)
        low, high = tendon.range[0] + tendon.margin, tendon.range[1] - tendon.margin
        values, places = length.value, np.arange(float(len(q)))
        if times is not None:
            values, places = between_samples(times, length.value, length.rate)
        outside = (values < low) | (values > high)
        if outside.any():
            first = int(np.argmax(outside))
            where = "sample" if times is None else "t ="
            raise NotCovered(
                f"range of tendon {tendon.name!r}, an end of which it reaches at {where} "
                f"{number(float(places[first]))}{'' if times is None else ' s'}"
            )


def between_samples(times: Array, values: Array, rates: Array) -> tuple[Array, Array]:
    """Values at the samples and at `PLACES_BETWEEN` them, by cubic polynomials, and their times."""
    step, s = np.diff(times)[:, None], PLACES_BETWEEN
    slope, end_slope = step * rates[:-1, None], step * rates[1:, None]
    inside = interpolate_cubic(s, values[:-1, None], values[1:, None], slope, end_slope)
    at = times[:-1, None] + step * s
    return np.concatenate([values[:1], inside.ravel()]), np.concatenate([times[:1], at.ravel()])
