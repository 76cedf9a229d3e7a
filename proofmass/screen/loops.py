"""Loops that are open at the start, or that the load of the start pulls open."""

from collections.abc import Iterator

import mujoco
import numpy as np

from proofmass.base.arrays import Array
from proofmass.base.wording import number
from proofmass.screen.finding import FindingKind, ModelFinding, NamedElement, Severity
from proofmass.screen.mobility import CLOSURES, equality_element
from proofmass.screen.pose import RestPose, coordinate_unit

TOLD_OPENING_SHARE, TOLD_OPENING_ANGLE = 1e-4, 1e-3
"""Opening of a loop that is noticed: a share of the model's extent [1], and an angle [rad]."""
LEFT_SHARE = 1e-6
"""Residual, as a share of the extent, with which loops cannot be closed."""
TORQUE_SCALE = 10
"""Place of a weld's torque scale among the numbers of an equality."""


def openings(pose: RestPose) -> Iterator[tuple[NamedElement, float, str]]:
    """The opening of each active equality in a pose, and its unit, m or rad.

    The place of a connect or weld is open by a distance.  A weld is also open by an angle, which is
    2 asin(r / s) for the length r of its last three residuals and its torque scale s.
    """
    model, constraints = pose.model, pose.constraints
    for e in np.unique(constraints.equalities):
        rows = np.abs(constraints.residuals[constraints.equalities == e])
        element = equality_element(pose, int(e))
        if int(model.eq_type[e]) not in CLOSURES:
            yield element, float(rows.max()), unit_of_coupling(model, int(e))
            continue
        yield element, float(np.linalg.norm(rows[:3])), "m"
        if rows.size > 3:
            share = np.linalg.norm(rows[3:]) / max(model.eq_data[e][TORQUE_SCALE], 1e-9)
            yield element, float(2.0 * np.arcsin(min(1.0, share))), "rad"


def unit_of_coupling(model: mujoco.MjModel, equality: int) -> str:
    """The unit of the residual of an equality between joints or tendons, m or rad."""
    on_joint = model.eq_objtype[equality] == mujoco.mjtObj.mjOBJ_JOINT
    joint = model.eq_obj1id[equality]
    hinge = on_joint and model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_HINGE
    return "rad" if hinge else "m"


def judge_openings(pose: RestPose) -> Iterator[ModelFinding]:
    """The loops that are open in the pose of the file."""
    extent = pose.model.stat.extent
    for element, opening, unit in openings(pose):
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
