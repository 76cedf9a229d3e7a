"""Three hinges of a body in gimbal lock: at the start, and on the way of a run of a second.

Three hinges at one point turn a body in all ways while their axes span space.  The box of the three
unit axes has the volume |cos b|, with the angle b of the middle hinge from where the axes are
perpendicular; where it is zero, the body cannot turn about one direction.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import mujoco
import numpy as np

from proofmass.base.wording import number
from proofmass.screen.finding import FindingKind, ModelFinding, Severity
from proofmass.screen.pose import HINGE, named_element
from proofmass.screen.short_run import start_of, steps_of_run
from proofmass.sim.mjcf import failure_warning

GIMBAL_LOCK = 0.05
"""Volume of the box of three unit axes [1] below which they are near gimbal lock."""
SAME_POINT = 1e-9
"""Distance of the anchors of three hinges at one point [m]."""


@dataclass(frozen=True)
class GimbalLock:
    """Where three hinges first come near gimbal lock.

    Attributes
    ----------
    body : int
    volume : float
        Of the box of their unit axes [1]; 0 if it changes its sign.
    time : float
        After the start [s].
    """

    body: int
    volume: float
    time: float


def judge_gimbals(model: mujoco.MjModel, key: int) -> Iterator[ModelFinding]:
    """Three hinges of a body that are near gimbal lock, at the start or within a second."""
    for lock in find_gimbal_locks(model, key):
        body = named_element(model, "body", lock.body)
        when = f" {number(lock.time, 2)} s after the start" if lock.time else ""
        yield ModelFinding(
            FindingKind.GIMBAL,
            Severity.WARNING,
            f"the three hinges of {body} are near gimbal lock{when}: the box of their axes has a "
            f"volume of {number(lock.volume, 2)}",
            "use a ball joint, or keep the middle hinge elsewhere",
            body,
            lock.volume,
        )


def find_gimbal_locks(model: mujoco.MjModel, key: int) -> list[GimbalLock]:
    """The bodies whose three hinges come near gimbal lock, at the start or in a run of a second."""
    data = start_of(model, key)
    triples = hinge_triples(model, data)
    if not triples:
        return []
    before = box_volumes(data, triples)
    nearest = [GimbalLock(body, abs(v), 0.0) for body, v in zip(triples, before, strict=True)]
    for _ in range(steps_of_run(model.opt.timestep)):
        time = float(data.time)
        mujoco.mj_step(model, data)  # it leaves the axes of its beginning
        if failure_warning(data):
            break
        volumes = box_volumes(data, triples)
        for k, (body, last, now) in enumerate(zip(triples, before, volumes, strict=True)):
            volume = 0.0 if last * now < 0.0 else abs(now)
            if nearest[k].volume >= GIMBAL_LOCK and volume < nearest[k].volume:
                nearest[k] = GimbalLock(body, volume, time)
        before = volumes
    return [lock for lock in nearest if lock.volume < GIMBAL_LOCK]


def hinge_triples(model: mujoco.MjModel, data: mujoco.MjData) -> dict[int, list[int]]:
    """The three hinges at one point of each body that has no other joints."""
    found = dict[int, list[int]]()
    for b in range(1, model.nbody):
        first = model.body_jntadr[b]
        joints = [
            j for j in range(first, first + model.body_jntnum[b]) if model.jnt_type[j] == HINGE
        ]
        if len(joints) == 3 and np.ptp(data.xanchor[joints], axis=0).max() <= SAME_POINT:
            found[b] = joints
    return found


def box_volumes(data: mujoco.MjData, triples: dict[int, list[int]]) -> list[float]:
    """The volumes of the boxes of unit axes, with their signs [1]."""
    axes = data.xaxis[list(triples.values())]
    return np.asarray(np.linalg.det(axes)).tolist()
