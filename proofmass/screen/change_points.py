"""Change points on the way of a mechanism with one degree of freedom.

Where bars come in line the rank of the loops falls, and the mechanism can continue in another
assembly mode.  The least kept singular value is then a V that meets zero.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import mujoco
import numpy as np

from proofmass.base.arrays import Array
from proofmass.base.wording import number
from proofmass.screen.finding import FindingKind, ModelFinding, NamedElement, Severity
from proofmass.screen.pose import HINGE, SLIDE, RestPose, coordinate_unit

STEP = 0.04
"""Largest motion of a coordinate from a pose to the next [rad, or share of the extent]."""
POSES_OF_A_WAY = 160
"""Poses in each direction: a whole turn."""
COORDINATES_OF_A_WAY = 40
CLOSED_ON_THE_WAY = 1e-9
"""Largest residual of a pose on the way [m or rad]."""
SMALL_VALUE, STEEP = 0.1, 0.75
"""A minimum below the first [1], and below this share of its rise to the neighbours, is a V."""


@dataclass(frozen=True)
class Passed:
    """A pose on the way, and the least singular value of its loops [1]."""

    qpos: Array
    value: float


def find_change_points(pose: RestPose) -> Iterator[tuple[NamedElement, float, str]]:
    """The first change point in each direction: the joint that tells it, its place and its unit.

    The pose is on the loops and has one degree of freedom.
    """
    model = pose.model
    joint = next((j for j in range(model.njnt) if model.jnt_type[j] == HINGE), 0)
    address = model.jnt_qposadr[joint]
    for side in (1.0, -1.0):
        way = list(follow(pose, side))
        for before, here, after in zip(way, way[1:], way[2:], strict=False):
            rise = max(before.value, after.value) - here.value
            lowest = here.value <= min(before.value, after.value)
            if lowest and here.value < min(SMALL_VALUE, STEEP * rise):
                share = (before.value - after.value) / (before.value + after.value)
                span = float(after.qpos[address] - before.qpos[address])
                place = float(here.qpos[address]) + 0.5 * span * share
                unit = coordinate_unit(model, int(model.jnt_dofadr[joint]))
                yield pose.element("joint", joint), place, unit
                break


def follow(pose: RestPose, side: float) -> Iterator[Passed]:
    """Poses on the way in one direction, until a joint limit, a limit position, or a whole turn."""
    model = pose.model
    slides = model.jnt_type[model.dof_jntid] == SLIDE
    scale = np.where(slides, model.stat.extent, 1.0)
    there = pose.elsewhere(pose.qpos)
    last: Array | None = None
    for _ in range(POSES_OF_A_WAY):
        constraints = there.constraints
        yield Passed(there.qpos.copy(), float(constraints.singular_values[model.nv - 2]))
        direction = scale * np.linalg.svd(constraints.rows * scale)[2][model.nv - 1]
        sign = side if last is None else np.sign(direction @ last) or 1.0
        direction = direction * (sign * STEP / np.abs(direction / scale).max())
        last, there.qpos = direction, there.moved(direction)
        if there.close() > CLOSED_ON_THE_WAY or is_beyond_a_limit(model, there.qpos):
            return


def is_beyond_a_limit(model: mujoco.MjModel, qpos: Array) -> bool:
    """Whether a joint is outside its range."""
    joints = np.flatnonzero(model.jnt_limited & np.isin(model.jnt_type, (HINGE, SLIDE)))
    places, ranges = qpos[model.jnt_qposadr[joints]], model.jnt_range[joints]
    return bool(((places < ranges[:, 0]) | (places > ranges[:, 1])).any())


def judge_change_points(pose: RestPose) -> Iterator[ModelFinding]:
    """The change points that are noticed, if the model has one degree of freedom and is small."""
    for joint, place, unit in find_change_points(pose):
        yield ModelFinding(
            FindingKind.CHANGE_POINT,
            Severity.WARNING,
            f"{joint} comes to a change point at {number(place, 4)} {unit}: bars are in line there "
            "and an engine may leave it in another assembly mode",
            "stop before it",
            joint,
            place,
        )
