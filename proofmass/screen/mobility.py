"""How a model can move: its degrees of freedom, and constraints that others imply."""

from collections.abc import Iterator
from dataclasses import dataclass

import mujoco
import numpy as np

from proofmass.base.wording import format_count, number
from proofmass.screen.finding import FindingKind, ModelFinding, NamedElement, Severity
from proofmass.screen.pose import RestPose, named_element

BESIDE = 0.02
"""Distance of the poses beside the start in which the rank is taken as well [rad or m]."""
POSES_BESIDE = 3
CLOSED_BESIDE = 1e-9
"""Largest residual of a pose beside the start [m or rad]."""
LEAST_DISTANCE = 1e-4
"""Least distance of a pose beside the start, which the loops may have led back to it [rad or m]."""
NEARLY_SINGULAR = 1e-3
"""Singular value [1] below which a start pose is nearly singular."""
CLOSURES = int(mujoco.mjtEq.mjEQ_CONNECT), int(mujoco.mjtEq.mjEQ_WELD)


@dataclass(frozen=True)
class Mobility:
    """Numbers of a model's elements, of its constraints, and of the motions that they leave.

    Attributes
    ----------
    bodies, joints, coordinates : int
        Of the model, without its loops.
    loops, couplings : int
        Active connects and welds, and other active equalities.
    equations, rank : int
        Scalar equations of these, and how many of them are independent in the start pose.
    rank_beside : int
        The rank in poses beside the start pose; it is higher if the start pose is singular.
    least_value : float
        Least singular value of the independent equations [1]; NaN if there are none.
    needed : dict of NamedElement to tuple of int
        For each active equality its equations, and those of them that no other equality implies.
    """

    bodies: int
    joints: int
    coordinates: int
    loops: int
    couplings: int
    equations: int
    rank: int
    rank_beside: int
    least_value: float
    needed: dict[NamedElement, tuple[int, int]]

    @property
    def dof(self) -> int:
        """Degrees of freedom beside the start pose."""
        return self.coordinates - self.rank_beside

    @property
    def has_one_way(self) -> bool:
        """Whether loops leave it one degree of freedom, in the start pose as beside it."""
        return bool(self.loops) and self.dof == 1 and self.rank == self.rank_beside

    @property
    def redundant(self) -> int:
        """Equations that others imply."""
        return self.equations - self.rank


def find_mobility(pose: RestPose) -> Mobility:
    """The mobility of a model in a pose with closed loops, and in poses beside it."""
    model, constraints = pose.model, pose.constraints
    active = np.flatnonzero(pose.data.eq_active)
    loops = int(np.isin(model.eq_type[active], CLOSURES).sum())
    values = constraints.singular_values
    rank = constraints.rank
    return Mobility(
        bodies=model.nbody - 1,
        joints=model.njnt,
        coordinates=model.nv,
        loops=loops,
        couplings=len(active) - loops,
        equations=len(constraints.rows),
        rank=rank,
        rank_beside=max(ranks_beside(pose), default=rank),
        least_value=float(values[rank - 1]) if rank else float("nan"),
        needed={
            equality_element(model, int(e)): (
                int((constraints.equalities == e).sum()),
                rank - constraints.without(int(e)).rank,
            )
            for e in active
        },
    )


def ranks_beside(pose: RestPose) -> list[int]:
    """Ranks in poses beside the start pose, on the loops; empty if none was found.

    Constraints that are independent almost everywhere may depend on each other just in the start
    pose: bars in line are an example.
    """
    motions = pose.constraints.motions
    if not len(pose.constraints.rows) or not motions.size:
        return []
    found = []
    for mix in np.random.default_rng(1).normal(size=(POSES_BESIDE, motions.shape[1])):
        velocity = motions @ mix
        trial = pose.elsewhere(pose.moved(BESIDE * velocity / np.abs(velocity).max()))
        left = trial.close()
        distance = np.abs(pose.change_to(trial.qpos)).max()
        if left < CLOSED_BESIDE and distance > LEAST_DISTANCE:
            found.append(trial.constraints.rank)
    return found


def equality_element(model: mujoco.MjModel, equality: int) -> NamedElement:
    """An equality as an MJCF element, with its name: a connect, a weld, an equality joint, ..."""
    kind = mujoco.mjtEq(int(model.eq_type[equality])).name.removeprefix("mjEQ_").lower()
    if kind not in ("connect", "weld"):
        kind = f"equality {kind}"
    return NamedElement(kind, named_element(model, "equality", equality).name)


def judge_mobility(pose: RestPose, found: Mobility) -> Iterator[ModelFinding]:
    """What is noticed of a mobility.

    `pose` has closed loops, which may have been open in the model's own start pose.
    """
    if found.equations and found.rank == found.coordinates:
        yield ModelFinding(
            FindingKind.NO_MOBILITY,
            Severity.FAULT,
            f"the mobility is 0: {found.equations} equations, of which {found.rank} are "
            f"independent, leave none of {found.coordinates} joint coordinates free; what moves is "
            "the softness of the loops",
            "replace a weld that closes a loop by a connect, or leave out a loop"
            if np.any(pose.model.eq_type == mujoco.mjtEq.mjEQ_WELD)
            else "leave out a loop, or give a body of it another joint",
            value=0.0,
        )
    elif found.rank_beside > found.rank:
        extra = found.rank_beside - found.rank
        motions = format_count(extra, "more motion")
        yield ModelFinding(
            FindingKind.SINGULAR_START,
            Severity.WARNING,
            f"the start pose is singular: {found.rank} independent equations, {found.rank_beside} "
            f"beside it, which leaves {motions} just here, and an engine may leave it in another "
            "assembly mode",
            "start beside this pose",
            value=float(extra),
        )
    elif found.least_value < NEARLY_SINGULAR:
        yield ModelFinding(
            FindingKind.SINGULAR_START,
            Severity.NOTE,
            f"the start pose is nearly singular: its least singular value is "
            f"{number(found.least_value, 2)}",
            value=found.least_value,
        )
