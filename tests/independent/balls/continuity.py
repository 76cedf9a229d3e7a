"""One continuous branch of poses from each sample of a sweep to the next, in balls.

Drives go straight from their values at one sample to those at the next.  Krawczyk's test with the
drives as balls over that way proves that a box has exactly one pose for each of their values, so
that the poses are a continuous branch.  If the box holds the proven poses of both samples, both are
on that branch, since the box has no other pose there.  The boxes of two neighbouring steps share
the proven pose of their common sample, and with it the branch.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from flint import arb, ctx

from tests.independent.balls.loops import (
    CaseNumbers,
    Form,
    NotProven,
    approximate_pose,
    krawczyk_image,
    prove_pose,
)

MOST_HALVINGS = 7
"""Number of times that a step is halved at most: 128 parts."""
MOST_INFLATIONS = 4
"""Number of boxes that are tried: each is the image of the one before, and a margin."""
MARGIN = 0.2
"""Margin of a box, as a share of its width; a wider one makes the matrix less certain."""
LEAST_MARGIN = 1e-9
"""The same for a step in which nothing moves [m or rad]."""


@dataclass(frozen=True)
class ProvenPose:
    """Drives and unknowns at a sample, as balls [m or rad]."""

    drives: Sequence[arb]
    unknowns: Sequence[arb]


def is_continuous(form: Form, p: CaseNumbers, start: ProvenPose, end: ProvenPose) -> bool:
    """Whether one branch leads from a pose to the next; a step that is too long is halved."""
    return is_branch(form, p, start, end, MOST_HALVINGS)


def is_branch(
    form: Form, p: CaseNumbers, start: ProvenPose, end: ProvenPose, halvings: int
) -> bool:
    """The same with a number of halvings that are left."""
    if holds_one_branch(form, p, start, end):
        return True
    if not halvings:
        return False
    try:
        middle = pose_between(form, p, start, end)
    except (NotProven, ZeroDivisionError):
        return False
    parts = (start, middle), (middle, end)
    return all(is_branch(form, p, one, two, halvings - 1) for one, two in parts)


def pose_between(form: Form, p: CaseNumbers, start: ProvenPose, end: ProvenPose) -> ProvenPose:
    """A proven pose at the middle of the drives' way."""
    halves = [(one + two) / 2 for one, two in zip(start.drives, end.drives, strict=True)]
    ends = zip(start.unknowns, end.unknowns, strict=True)
    guess = [float(((one + two) / 2).mid()) for one, two in ends]
    guess = approximate_pose(form, p, halves, guess)
    unknowns, _ = prove_pose(form, p, halves, guess)
    return ProvenPose(halves, unknowns)


def holds_one_branch(form: Form, p: CaseNumbers, start: ProvenPose, end: ProvenPose) -> bool:
    """Whether a box about both poses has exactly one pose for each value of the drives between."""
    ctx.cap = 2
    drives = [one.union(two) for one, two in zip(start.drives, end.drives, strict=True)]
    hulls = [one.union(two) for one, two in zip(start.unknowns, end.unknowns, strict=True)]
    box = hulls
    for _ in range(MOST_INFLATIONS):
        box = [one + arb(0, float(MARGIN * one.rad()) + LEAST_MARGIN) for one in box]
        try:
            image = krawczyk_image(form, p, drives, box)
        except (ZeroDivisionError, ValueError):  # the matrix of the box is singular
            return False
        if all(one.contains_interior(two) for one, two in zip(box, image, strict=True)):
            return True
        box = [one.union(two) for one, two in zip(hulls, image, strict=True)]
    return False
