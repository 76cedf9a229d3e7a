"""Time stepping in MuJoCo, with an ideal drive.

The driven joint gets a flywheel so heavy that nothing in the model can disturb it, and in each
step the torque that gives it the law's mean acceleration over that step.  What the joint really
did is returned beside the curves, so that a comparison can be made at the actual drive state.
"""

import time

import mujoco
import numpy as np

from sim.mujoco_model import Reader, loop_gap
from sim.mujoco_sweep import Linkage
from sim.protocol import Array, Curves, Diverged, Run, Unsupported

FLYWHEEL = 1e9  # times the inertia that the drive feels at the start pose
W = mujoco.mjtWarning
FATAL = (W.mjWARN_BADQPOS, W.mjWARN_BADQVEL, W.mjWARN_BADQACC, W.mjWARN_INERTIA)


def steps_per_sample(x: Array, timestep: float) -> tuple[int, float]:
    """How many steps fit between two samples, and the step [s] that makes them fit exactly."""
    gap = np.diff(x)
    if np.ptp(gap) > 1e-9 * gap.mean():
        raise Unsupported("samples at uneven times in a duration")
    count = max(1, int(np.ceil(gap.mean() / timestep - 1e-9)))
    return count, float((x[-1] - x[0]) / (x.size - 1) / count)


def start(linkage: Linkage, run: Run, times: Array) -> tuple[Array, Array]:
    """Close the loops at the drive's first value, give every joint its rate, fit the flywheel.

    Returns
    -------
    torque : ndarray (steps,)
        What to apply at the driven joint in each step.
    inertia : ndarray (nv, nv)
        Mass matrix at the start pose, before the flywheel.
    """
    model, data = linkage.model, linkage.data
    value, rate, _ = run.drive.law(times)
    tangent = linkage.place(float(value[0]))
    data.qvel[:] = tangent * rate[0]
    inertia = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, inertia)
    flywheel = FLYWHEEL * float(tangent @ inertia @ tangent)
    model.dof_armature[linkage.dof] += flywheel
    model.dof_damping[linkage.dof] = model.dof_frictionloss[linkage.dof] = 0
    pose, speed = data.qpos.copy(), data.qvel.copy()
    mujoco.mj_setConst(model, data)  # the flywheel changes how stiff the engine makes a constraint
    data.qpos[:], data.qvel[:] = pose, speed
    return flywheel * np.diff(rate) / np.diff(times), inertia


def duration(model: mujoco.MjModel, data: mujoco.MjData, run: Run) -> Curves:
    """Step through ``run.x`` (time) and read every sensor at every sample.

    The sensors of a MuJoCo step belong to its beginning, one step before the state it leaves
    behind; a sample is therefore read after a forward pass at the sample's own state.

    Raises
    ------
    Diverged
        The engine reset itself, a value is not finite, or a loop came open.
    """
    count, step = steps_per_sample(run.x, model.opt.timestep)
    model.opt.timestep = step
    times = run.x[0] + step * np.arange((run.x.size - 1) * count + 1)
    reader, linkage = Reader(model, run.channels), None
    torque = np.zeros(times.size - 1)
    if run.drive:
        linkage = Linkage(model, data, run.drive.joint)
        torque, _ = start(linkage, run, times)
    dof = linkage.dof if linkage else 0
    state, gap = np.empty((run.x.size, 3)), 0.0
    data.time = run.x[0]
    began = time.perf_counter()
    for k in range(run.x.size):
        mujoco.mj_forward(model, data)
        reader.sample(data)
        state[k] = data.qpos[linkage.adr if linkage else 0], data.qvel[dof], data.qacc[dof]
        gap = max(gap, loop_gap(model, data).max(initial=0.0))
        check(model, data, gap)
        if k + 1 < run.x.size:
            for force in torque[k * count : (k + 1) * count]:
                data.qfrc_applied[dof] = force
                mujoco.mj_step(model, data)
    return Curves(run.x, reader.curves(), drive=tuple(state.T) if linkage else None, gap=gap,
                  seconds=time.perf_counter() - began, steps=times.size - 1,
                  settings={"timestep": step})


def check(model: mujoco.MjModel, data: mujoco.MjData, gap: float) -> None:
    """Raise when the run is lost; MuJoCo itself resets the state and carries on in silence."""
    for warning in FATAL:
        if data.warning[warning].number:
            name = warning.name[7:].lower()
            raise Diverged(f"MuJoCo warning {name} at t = {data.time:.4g} s")
    if not np.isfinite(data.qpos).all():
        raise Diverged(f"not finite at t = {data.time:.4g} s")
    if gap > 0.1 * model.stat.extent:
        raise Diverged(f"a loop came open by {gap:.3g} m at t = {data.time:.4g} s")
