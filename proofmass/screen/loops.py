"""Loops that are open at the start, or that the load of the start pulls open."""

from collections.abc import Iterator

import numpy as np

from proofmass.base.arrays import Array
from proofmass.base.wording import number
from proofmass.screen.finding import FindingKind, ModelFinding, Severity
from proofmass.screen.mobility import equality_element
from proofmass.screen.pose import RestPose, coordinate_unit
from proofmass.sim.openings import find_openings

TOLD_OPENING_SHARE, TOLD_OPENING_ANGLE = 1e-4, 1e-3
"""Opening of a loop that is noticed: a share of the model's extent [1], and an angle [rad]."""
LEFT_SHARE = 1e-6
"""Residual, as a share of the extent, with which loops cannot be closed."""


def judge_openings(pose: RestPose) -> Iterator[ModelFinding]:
    """The loops that are open in the pose of the file."""
    extent = pose.model.stat.extent
    constraints = pose.constraints
    for one in find_openings(pose.model, constraints.residuals, constraints.equalities):
        element, opening, unit = equality_element(pose.model, one.equality), one.size, one.unit
        if opening > (TOLD_OPENING_SHARE * extent if unit == "m" else TOLD_OPENING_ANGLE):
            yield ModelFinding(
                FindingKind.OPEN_LOOP,
                Severity.FAULT,
                f"{element} is open by {number(opening)} {unit} at the start: it closes by a jerk",
                element=element,
                value=opening,
            )


def judge_closing(pose: RestPose, left: float, change: Array) -> Iterator[ModelFinding]:
    """What is noticed of loops after closing: the residual `left`, and the `change` (nv,)."""
    model = pose.model
    if left > LEFT_SHARE * model.stat.extent:
        yield ModelFinding(
            FindingKind.OPEN_LOOP,
            Severity.FAULT,
            f"the loops stay open by {number(left)} m or rad: no pose near the start closes them",
            "check the lengths of the links and the places of the sites or anchors",
            value=left,
        )
        return
    if change.size and np.abs(change).max() > TOLD_OPENING_ANGLE:
        k = int(np.argmax(np.abs(change)))
        joint = pose.joint_of(k)
        moved = f"{number(float(change[k]))} {coordinate_unit(model, k)}"
        yield ModelFinding(
            FindingKind.OPEN_LOOP,
            Severity.NOTE,
            f"the loops close where {joint} is {moved} further",
            "give that pose as a key",
            element=joint,
            value=float(change[k]),
        )
