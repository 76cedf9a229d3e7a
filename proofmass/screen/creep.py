r"""Joints that dry friction should hold and that creep, since MuJoCo's friction is soft.

MuJoCo's dry friction is a constraint with the reference acceleration -b v and the regularisation R:
below its limit it gives the force f = -b v / R.  A joint under a load f that friction should hold
therefore moves with

    v = f R / b,

which is (1 - d) f T dmax / (2 d I) for one joint of inertia I with the time constant T and the
impedance d of its `solreffriction` and `solimpfriction` (docs/engines.md).  Joints that loops
couple share their loads: with the motions N that exact loops allow, and S the rows of N at the
joints with friction, v = S (S^T diag(b/R) S)^-1 N^T f.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import mujoco
import numpy as np

from proofmass.base.arrays import Array, Index
from proofmass.base.wording import number
from proofmass.screen.finding import FindingKind, ModelFinding, NamedElement, Severity
from proofmass.screen.linear import LinearMotion
from proofmass.screen.pose import HINGE, RANK_SHARE, SLIDE, RestPose, coordinate_unit
from proofmass.screen.short_run import run_as_it_is, start_of, steps_of_run

FRICTION = int(mujoco.mjtConstraint.mjCNSTR_FRICTION_DOF)
AT_STOP = 0.01
"""Distance from a stop, as a share of the joint's range, at which the stop holds the joint."""
LEAST_CREEP = 1e-6
"""Least speed that is told [rad/s or m/s]."""
SEEN_CREEP = 1e-3
"""Speed from which a creeping joint is a fault [rad/s or m/s]: 3 degrees in a minute."""
STIFF_IMPEDANCE = float(mujoco.mjMAXIMP)
"""The largest impedance that MuJoCo accepts [1], 0.9999."""
WORTHWHILE_SLOWNESS = 2.0
"""How much slower a proposed impedance has to make a joint [1]."""
CONFIRMED_SHARE = 0.5
"""Share of the predicted motion, or of the speed at its end, that a run must show: a joint on its
stop shows none, and a nut whose soft thread gives way first loads its screw late."""


@dataclass(frozen=True)
class CreepingJoint:
    """A joint that creeps though its friction would hold it.

    Attributes
    ----------
    joint : NamedElement
    coordinate : int
    speed : float
        [rad/s or m/s]
    load, friction : float
        The load that friction has to hold, and its limit [N m or N].
    unit : str
        That of its coordinate, rad or m.
    coupled : tuple of int
        The coordinates that inertia or loops couple with it, and its own: friction holds them all.
    """

    joint: NamedElement
    coordinate: int
    speed: float
    load: float
    friction: float
    unit: str
    coupled: tuple[int, ...] = ()

    def format(self, speed: float) -> str:
        """A speed of the joint as text, of a hinge in degrees as well.

        >>> joint = CreepingJoint(NamedElement("joint", "j"), 0, 0.0612, 6.13, 8.0, "rad")
        >>> joint.format(0.0612)
        '0.0612 rad/s (3.51°/s)'
        """
        degrees = f" ({number(abs(float(np.degrees(speed))))}°/s)" if self.unit == "rad" else ""
        return f"{number(abs(speed))} {self.unit}/s{degrees}"


def creeping_joints(
    model: mujoco.MjModel, key: int, told: float = LEAST_CREEP
) -> list[CreepingJoint]:
    """The joints that creep from the start of a model, with speeds above `told` [rad/s or m/s].

    Parameters
    ----------
    model : MjModel
    key : int
        The number of the key from which it starts; -1 for its initial pose.
    told : float
        Least speed [rad/s or m/s].
    """
    if not model.dof_frictionloss.any():
        return []
    start = start_of(model, key)
    pose = RestPose(model, start.qpos, start.ctrl, start.act)
    pose.close()
    return list(find_creep(model, start, LinearMotion(pose), told))


def find_creep(
    model: mujoco.MjModel, data: mujoco.MjData, motion: LinearMotion, told: float = LEAST_CREEP
) -> Iterator[CreepingJoint]:
    """The joints that creep from the start state `data`, in which all constraints are known."""
    rows = np.flatnonzero(np.array(data.efc_type[: data.nefc]) == FRICTION)
    table = np.array(data.efc_KBIP[: 4 * data.nefc]).reshape(-1, 4)
    viscosity = np.zeros(model.nv)
    coordinates = np.array(data.efc_id[: data.nefc], dtype=np.intp)[rows]
    viscosity[coordinates] = table[rows, 1] / np.array(data.efc_R[: data.nefc])[rows]
    pose = motion.pose
    pose.enter(pose.qpos)
    forces = pose.forces
    for group in coupled_groups(motion, coordinates):
        rubbing = np.intersect1d(group, coordinates)
        speeds = group_speeds(motion, group, rubbing, viscosity, forces)
        if speeds is None or slips(model, rubbing, viscosity[rubbing] * speeds):
            continue
        for k, speed in zip(rubbing, speeds, strict=True):
            if abs(speed) > told and not is_at_stop(model, pose.qpos, int(k), float(speed)):
                yield CreepingJoint(
                    pose.joint_of(int(k)),
                    int(k),
                    float(speed),
                    float(viscosity[k] * speed),
                    float(model.dof_frictionloss[k]),
                    coordinate_unit(model, int(k)),
                    tuple(group.tolist()),
                )


def slips(model: mujoco.MjModel, rubbing: Index, loads: Array) -> bool:
    """Whether loads of joints with friction are more than it can hold."""
    return bool((np.abs(loads) > model.dof_frictionloss[rubbing]).any())


def group_speeds(
    motion: LinearMotion, group: Index, rubbing: Index, viscosity: Array, forces: Array
) -> Array | None:
    """Speeds of the joints with friction of a group; None if friction leaves it free to move."""
    rows = motion.rows[:, group]
    motions = np.eye(len(group))
    if rows.size:
        _, values, right = np.linalg.svd(rows)
        motions = right[int((values > RANK_SHARE * values.max(initial=1e-300)).sum()) :].T
    at_friction = motions[np.searchsorted(group, rubbing)]
    if not motions.size or np.linalg.matrix_rank(at_friction) < motions.shape[1]:
        return None
    resisted = at_friction.T @ (viscosity[rubbing][:, None] * at_friction)
    return np.asarray(at_friction @ np.linalg.solve(resisted, motions.T @ forces[group]))


def coupled_groups(motion: LinearMotion, coordinates: Index) -> Iterator[Index]:
    """Sets of coordinates that inertia or loops couple, for those with friction."""
    linked = (np.abs(motion.masses) > 0) | (np.abs(motion.rows.T) @ np.abs(motion.rows) > 0)
    seen = np.zeros(len(linked), dtype=bool)
    for k in coordinates:
        if seen[k]:
            continue
        part = np.zeros(len(linked), dtype=bool)
        grown = np.eye(len(linked), dtype=bool)[k]
        while grown.sum() > part.sum():
            part, grown = grown, linked[grown].any(axis=0) | grown
        seen |= part
        yield np.flatnonzero(part)


def is_at_stop(model: mujoco.MjModel, qpos: Array, coordinate: int, speed: float) -> bool:
    """Whether the stop towards which a joint would creep holds it."""
    j = int(model.dof_jntid[coordinate])
    if not model.jnt_limited[j] or model.jnt_type[j] not in (HINGE, SLIDE):
        return False
    stop = model.jnt_range[j][int(speed > 0.0)]
    return bool(abs(qpos[model.jnt_qposadr[j]] - stop) < AT_STOP * np.ptp(model.jnt_range[j]))


def judge_creep(
    model: mujoco.MjModel, key: int, data: mujoco.MjData, motion: LinearMotion
) -> Iterator[ModelFinding]:
    """The joints that creep, in theory and in a run."""
    found = list(find_creep(model, data, motion))
    if not found:
        return
    data, moved = run_as_it_is(model, key, steps_of_run(model.opt.timestep))
    for creep in found:
        way, late = moved[creep.coordinate] / data.time, data.qvel[creep.coordinate]
        if max(way / creep.speed, late / creep.speed) < CONFIRMED_SHARE:
            continue
        force = "N m" if creep.unit == "rad" else "N"
        yield ModelFinding(
            FindingKind.CREEP,
            Severity.FAULT if abs(creep.speed) > SEEN_CREEP else Severity.NOTE,
            f"{creep.joint} creeps with {creep.format(creep.speed)}, though its friction "
            f"of {number(creep.friction)} {force} would hold its load of "
            f"{number(abs(creep.load))} {force}: MuJoCo's dry friction is soft",
            propose_stiffer(model, creep),
            creep.joint,
            creep.speed,
        )


def propose_stiffer(model: mujoco.MjModel, creep: CreepingJoint) -> str:
    """The impedance that makes a joint slower; empty if it has about that already.

    The speed is proportional to (1 - d) / d times the largest impedance.
    """
    low, high = (float(share) for share in model.dof_solimp[creep.coordinate][:2])
    slower = (1.0 - low) / low * high / (1.0 - STIFF_IMPEDANCE)
    if slower < WORTHWHILE_SLOWNESS:
        return ""
    text = f'solimpfriction="{STIFF_IMPEDANCE:g} {STIFF_IMPEDANCE:g} 0.001"'
    return f"{text} on it makes it {number(slower, 2)} times slower"
