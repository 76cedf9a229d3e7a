"""How far a joint of a planar mechanism can be driven while the other joints follow."""

from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from mujoco import MjModel

from proofmass.analytic.mjcf import ModelData
from proofmass.analytic.numerics import TURN
from proofmass.analytic.planar import Branch, Mechanism, solve
from proofmass.analytic.planar.mechanism import PlanarJoint, PointSpring, SumSpring
from proofmass.analytic.planar.support import SUPPORT
from proofmass.analytic.support import RunKind, refuse
from proofmass.base.arrays import Array
from proofmass.base.errors import InputError
from proofmass.base.wording import number
from proofmass.batch.work import OWN_MODEL_SAMPLES
from proofmass.sim.contents import joint_of

DRIVEN_SHARE = 0.9
"""Share of a joint's distance to a limit position or a change point that is driven, to stay before
it."""
MIN_DRIVEN_SHARE = 0.01
"""Least distance of a drive, as a share of a turn or of the mechanism's size."""
TRIED_SHARES = 1.0, 0.5, 0.25, 0.1, 0.05
"""Shares of a distance that are tried if springs act."""
START_MARGIN = 1e-9
"""Largest distance of a start pose from a joint's range that is rounding, in turns or sizes."""
WHOLE_TURN = TURN * (1 - 1e-9)
"""Way of a hinge that is a turn, but for rounding [rad]."""
Rank = tuple[bool, bool, bool, float]
"""A motor, a whole turn, a joint on the ground, a long range: the greater the better."""


class DriveEnd(NamedTuple):
    """The value to which a joint can be driven [rad or m], and whether it is a change point."""

    value: float
    is_change_point: bool = False


@dataclass(frozen=True)
class JointRange:
    """The range in which a joint can be driven while the other joints follow.

    Attributes
    ----------
    joint, unit : str
        The name of the joint, and the unit of its values.
    start : float
        Its value in the start pose [rad or m].
    low, high : DriveEnd
        Both ends of the range.
    share : float
        The longer side of the range as a share of a turn, or of the mechanism's size [1].
    turns, motor, grounded : bool
        Whether it makes a whole turn, whether an actuator drives it, and whether its body is joined
        to the ground.
    """

    joint: str
    unit: str
    start: float
    low: DriveEnd
    high: DriveEnd
    share: float
    turns: bool
    motor: bool
    grounded: bool

    @property
    def rank(self) -> Rank:
        """The order of preference."""
        return self.motor, self.turns, self.grounded, self.share

    @property
    def far_end(self) -> DriveEnd:
        """The end on the longer side."""
        return max(self.low, self.high, key=lambda end: abs(end.value - self.start))

    @property
    def way(self) -> tuple[float, float]:
        """First and last value of the drive: that of the start pose, and one on the longer side."""
        if self.turns:
            return self.start, self.start + TURN
        return self.start, self.start + DRIVEN_SHARE * (self.far_end.value - self.start)

    def describe_way(self) -> str:
        """How far the joint goes, as the end of a sentence.

        >>> begin, end = DriveEnd(0.0), DriveEnd(1.5708, is_change_point=True)
        >>> JointRange("a", "rad", 0.0, begin, end, 0.25, False, False, True).describe_way()
        'goes 90% of its way to the change point at 1.571 rad, where bars are in line'
        """
        if self.turns:
            return "turns once"
        goes = f"goes {DRIVEN_SHARE:.0%} of its way to"
        if self.far_end.is_change_point:
            return (
                f"{goes} the change point at {number(self.far_end.value, 4)} {self.unit}, where "
                "bars are in line"
            )
        return f"{goes} a limit"


def find_best_range(
    model: MjModel,
    start: str,
    mechanism: Mechanism,
    data: ModelData,
    pose: Array,
    springs_hold: bool,
) -> tuple[JointRange | None, str]:
    """The range of the joint that is best to drive, or None and why the first cannot be driven.

    Parameters
    ----------
    model, start
        The compiled model, and the name of its key.
    mechanism, data
        The mechanism, and the numbers of the model that it was made of.
    pose : ndarray (joints,)
        The closed start pose [rad or m].
    springs_hold : bool
        Whether a motor is driven while springs hold the other joints; otherwise a single drive
        determines the motion.
    """
    motors = {joint_of(model, a) for a in range(model.nactuator)}
    best: JointRange | None = None
    why = ""

    def highest_rank(j: int) -> Rank:
        return j in motors, mechanism.joints[j].hinge, is_grounded(model, j), 1.0

    for j in sorted(range(len(mechanism.joints)), key=highest_rank, reverse=True):
        joint = mechanism.joints[j]
        if not joint.name or (springs_hold and j not in motors):
            continue
        if best and best.rank >= highest_rank(j):
            break
        try:
            refuse(data, SUPPORT, RunKind.SWEEP, (joint.name,))
            low, high = find_ends(model, start, mechanism, j, float(pose[j]), springs_hold)
        except ValueError as error:  # the others do not follow, or have servos: not covered
            why = why or str(error)
            continue
        found = range_between(joint, mechanism.size, float(pose[j]), low, high, highest_rank(j))
        if found.share > MIN_DRIVEN_SHARE:
            best = max(best or found, found, key=lambda one: one.rank)
    return best, why


def range_between(
    joint: PlanarJoint, size: float, at: float, low: DriveEnd, high: DriveEnd, rank: Rank
) -> JointRange:
    """The range of a joint between two ends."""
    share = max(at - low.value, high.value - at) / (TURN if joint.hinge else size)
    turns = joint.hinge and not high.is_change_point and high.value - at > WHOLE_TURN
    unit = "rad" if joint.hinge else "m"
    return JointRange(joint.name, unit, at, low, high, share, turns, rank[0], rank[2])


def find_ends(
    model: MjModel, start: str, mechanism: Mechanism, j: int, at: float, springs_hold: bool
) -> tuple[DriveEnd, DriveEnd]:
    """Both ends of the range of joint number j, which starts at `at` [rad or m].

    Raises
    ------
    ValueError
        The other joints do not follow it.
    """
    joint = mechanism.joints[j]
    unit = TURN if joint.hinge else mechanism.size
    low, high = joint.range
    below, above = (
        DriveEnd(equilibrium_end(model, start, joint.name, at, end))
        if springs_hold
        else branch_end(mechanism, j, end)
        for end in (max(at - unit, low), min(at + unit, high))
    )
    return below, above


def branch_end(mechanism: Mechanism, j: int, end: float) -> DriveEnd:
    """The value to which joint number j can be driven towards an end [rad or m].

    Where the determinant of the loops' Jacobian changes its sign on the way, the branch passes a
    change point.  The determinant is linear in the way there.
    """
    knots = Branch(mechanism, (mechanism.joints[j].name,)).walk(np.array([[end]]))[0]
    values, sides = knots.q[:, j], knots.orientation != knots.orientation[0]
    if not sides.any():
        return DriveEnd(float(values[-1]))
    after = int(np.argmax(sides))
    left, right = knots.regular[after - 1], knots.regular[after]
    share = left / (left + right)
    return DriveEnd(
        float(values[after - 1] + share * (values[after] - values[after - 1])),
        is_change_point=True,
    )


def equilibrium_end(model: MjModel, start: str, joint: str, at: float, end: float) -> float:
    """The value to which a joint can be driven towards an end with the others in equilibrium."""
    for share in TRIED_SHARES:
        last = at + share * (end - at)
        with suppress(ValueError):
            solve(
                np.linspace(at, last, OWN_MODEL_SAMPLES), model=model, start=start, joints=(joint,)
            )
            return last
    return at


def refuse_start_out_of_range(path: Path, mechanism: Mechanism, pose: Array) -> None:
    """Raise an `InputError` of a file if a joint starts beyond its range: no drive begins there."""
    for joint, value in zip(mechanism.joints, pose.tolist(), strict=True):
        low, high = joint.range
        unit = "rad" if joint.hinge else "m"
        margin = START_MARGIN * (TURN if joint.hinge else mechanism.size)
        if not low - margin <= value <= high + margin:
            raise InputError(
                path,
                "",
                f"joint {joint.name!r} starts at {value:.6g} {unit}, beyond its range, "
                f"{low:.6g} to {high:.6g} {unit}; change its key or its range",
            )


def is_grounded(model: MjModel, j: int) -> bool:
    """Whether the body of a joint is joined to the ground."""
    return bool(model.body_parentid[model.jnt_bodyid[j]] == 0)


def has_springs(mechanism: Mechanism) -> bool:
    """Whether there are springs, which may determine the joints that a drive leaves free."""
    m = mechanism
    springs: tuple[PlanarJoint | PointSpring | SumSpring, ...]
    springs = (*m.joints, *m.point_springs, *m.sum_springs)
    return any(any((spring.stiffness, *spring.stiffness_poly)) for spring in springs)
