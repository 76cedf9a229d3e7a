r"""Where a model comes to rest from its start, if it stays there.

The rest pose is found by Newton's method on the forces that exact loops leave,

    N^T f(q) = 0,     K = -d/dq [f(q) + J(q)^T l]  at fixed l,     x = N (N^T K N)^-1 N^T f,

with the motions N that the loops allow and their multipliers l.  It counts if N^T K N is positive
definite at each pose on the way, so that the model is pulled there and stays.
"""

import mujoco
import numpy as np

from proofmass.base.arrays import Array
from proofmass.screen.pose import HINGE, MAX_STEP, SLIDE, RestPose

STEPS_TO_REST = 40
"""Newton steps after which no rest pose is found; 15 lead through half a turn in steps of
`MAX_STEP`."""
BALANCED = 1e-9
"""Largest force of a rest pose, as a share of the largest one at the start."""
POSE_CHANGE = 1e-6
"""Step of central differences of forces [rad or m]; 1e-5 gives the same rest poses to 1e-9."""
DEPENDENT_SHARE = 1e-10
"""Least singular value for the multipliers of loops, as a share of the largest."""


def find_rest(pose: RestPose) -> RestPose | None:
    """The stable rest pose to which a pose leads, within all ranges; None if there is none."""
    rest = pose.elsewhere(pose.qpos)
    scale = max(float(np.abs(rest.forces).max(initial=0.0)), 1e-300)
    for _ in range(STEPS_TO_REST):
        motions = rest.constraints.motions
        force = motions.T @ rest.forces
        stiffness = motions.T @ static_stiffness(rest) @ motions
        if np.linalg.eigvalsh((stiffness + stiffness.T) / 2.0).min(initial=1.0) <= 0.0:
            return None
        if np.abs(force).max(initial=0.0) <= BALANCED * scale:
            return rest if in_ranges(rest.model, rest.qpos) else None
        step = motions @ np.linalg.solve(stiffness, force)
        longest = np.abs(step).max(initial=0.0)
        rest.qpos = rest.moved(step * min(1.0, MAX_STEP / max(longest, 1e-300)))
        rest.close()
    return None


def loop_multipliers(pose: RestPose) -> Array:
    """The multipliers l (equations,) that balance the forces as far as they can, J^T l = -f."""
    rows = pose.constraints.rows
    return np.asarray(-np.linalg.lstsq(rows.T, pose.forces, rcond=DEPENDENT_SHARE)[0])


def static_stiffness(pose: RestPose) -> Array:
    """K = -d/dq [f + J^T l] (nv, nv) at fixed multipliers of the loops."""
    pose.enter(pose.qpos)
    multipliers = loop_multipliers(pose)

    def force(change: Array) -> Array:
        pose.enter(pose.moved(change))
        return np.asarray(pose.forces + pose.constraints.rows.T @ multipliers)

    changes = POSE_CHANGE * np.eye(pose.model.nv)
    columns = [force(-dq) - force(dq) for dq in changes]
    pose.enter(pose.qpos)
    return np.transpose(columns).reshape(2 * changes.shape[:1]) / (2.0 * POSE_CHANGE)


def in_ranges(model: mujoco.MjModel, qpos: Array) -> bool:
    """Whether all hinges and slides are within their ranges: beyond them stops carry load."""
    limited = np.flatnonzero(model.jnt_limited & np.isin(model.jnt_type, (HINGE, SLIDE)))
    places = qpos[model.jnt_qposadr[limited]]
    low, high = model.jnt_range[limited].T
    return bool(((places >= low) & (places <= high)).all())


def state_at(model: mujoco.MjModel, rest: RestPose) -> mujoco.MjData:
    """The state of a model in a rest pose, with the same controls."""
    data = mujoco.MjData(model)
    data.qpos[:], data.ctrl[:], data.act[:] = rest.qpos, rest.data.ctrl, rest.data.act
    mujoco.mj_forward(model, data)
    return data
