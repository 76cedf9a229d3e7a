"""Time stepping in MuJoCo, with ideal drives.

Each driven joint gets a flywheel so heavy that no force in the model disturbs its motion.  In each
step a torque gives the flywheel the mean acceleration of the motion profile over that step.  The
actual motion of the driven joints is returned in addition to the curves, so that a reference can be
evaluated at the actual drive state.

A control that changes in time is constant in each step, at its value in the middle of the step.
MuJoCo keeps it constant over all stages of a step, so that its profile is reproduced to second
order, with RK4 as well.

`run_passive` steps any MJCF as it is, with its contacts, tendons and all else, and without drives.
It neither closes nor checks loops and prescribes no motion.
"""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import cast

import mujoco
import numpy as np
from numpy.typing import NDArray

from proofmass.analytic.support import RunKind
from proofmass.base.arrays import Array
from proofmass.base.clock import processor_time
from proofmass.sim.contents import control_indices
from proofmass.sim.dense import mass_matrix
from proofmass.sim.mjcf import collected_warnings, failure_warning
from proofmass.sim.mujoco.linkage import Linkage
from proofmass.sim.mujoco.model import Recorder, refuse_uncovered
from proofmass.sim.mujoco.sensors import (
    drive_moment_curves,
    drive_sensors,
    withhold_drives,
    withhold_interactions,
)
from proofmass.sim.mujoco.settings import stepping_settings
from proofmass.sim.mujoco.work import PYTHON_STEP, StepWork
from proofmass.sim.protocol.curves import Curves
from proofmass.sim.protocol.failures import Diverged
from proofmass.sim.protocol.run import Run
from proofmass.sim.start import start_state

WARNING_TIME = re.compile(r"Time = (\d+\.?\d*(?:e[-+]?\d+)?)")  # the time in a warning of MuJoCo
# inertia of a flywheel, in multiples of the drive's load inertia in the start pose
FLYWHEEL_RATIO = 1e9


def initialize_dynamics(linkage: Linkage, run: Run, times: Array) -> tuple[Array, Array]:
    """Close the loops at the drives' first values, set the rates of all joints, add the flywheels.

    Without drives, or where drives leave degrees of freedom, the start is that of
    `proofmass.sim.start`.

    Returns
    -------
    torque : ndarray (steps, drives)
        Torque on each flywheel in each step [N m or N], for the profile's mean acceleration in it.
    instant : ndarray (steps + 1, drives)
        Torque for the profile's acceleration at each time [N m or N], needed to read a sample.
    """
    model, data = linkage.model, linkage.data
    if not run.drives:
        linkage.release(*start_state(model, run))
        return np.zeros((times.size - 1, 0)), np.zeros((times.size, 0))
    value, rate, acceleration = (part.T for part in run.motion(times))
    if linkage.leaves_dof():  # such as the joints within rods, which start at the key's values
        tangent = linkage.release(*start_state(model, run))
    else:
        tangent = linkage.move(value[0])
        data.qvel[:] = tangent @ rate[0]
    inertia = mass_matrix(model, data)  # before the flywheels
    flywheel = FLYWHEEL_RATIO * np.diag(tangent.T @ inertia @ tangent)
    model.dof_armature[linkage.dofs] += flywheel
    # damping and friction do not change the motion of an ideal drive; its moment is not read here
    model.dof_damping[linkage.dofs] = model.dof_dampingpoly[linkage.dofs] = 0
    model.dof_frictionloss[linkage.dofs] = 0
    # MuJoCo compares the tolerance of its solver with the inertia, which is now that of the
    # flywheels: without this factor dry friction of the other joints would have no effect
    if flywheel.any():
        model.opt.tolerance *= np.trace(inertia) / (np.trace(inertia) + flywheel.sum())
    pose, speed = data.qpos.copy(), data.qvel.copy()
    mujoco.mj_setConst(model, data)  # the stiffness of MuJoCo's constraints depends on the inertia
    data.qpos[:], data.qvel[:] = pose, speed
    return flywheel * np.diff(rate, axis=0) / np.diff(times)[:, None], flywheel * acceleration


def dynamics(model: mujoco.MjModel, data: mujoco.MjData, run: Run) -> Curves:
    """Step through ``run.x`` (time) and read every sensor at every sample.

    The moment of a drive is the moment that the mechanism needs; the torque that is applied here
    moves the flywheel and is not part of it.

    After a step MuJoCo shows sensors and accelerations of the state in which the step began, while
    position and rates are those of its end.  A sample is therefore read after the first step that
    begins at it.  RK4 shows the accelerations of its last stage, so that with RK4 each sample needs
    a forward pass of its own.

    Raises
    ------
    Diverged
        The engine reset itself, a value is not finite, or a loop opened.
    """
    asked = float(model.opt.timestep)
    count, step = run.steps(asked)
    model.opt.timestep = step
    times = run.x[0] + step * np.arange((run.x.size - 1) * count + 1)
    joints = tuple(drive.joint for drive in run.drives)
    refuse_uncovered(model, RunKind.DRIVEN_MOTION if joints else RunKind.FREE_MOTION, joints)
    linkage = Linkage(model, data, joints)
    record = Recorder(model, data, run.channels, run.x.size)
    missing = withhold_interactions(record) | withhold_drives(model, linkage, record)
    dofs = linkage.dofs
    settings = stepping_settings(model)  # as given: the flywheels need another tolerance
    armature_and_damping = model.dof_armature[dofs], model.dof_damping[dofs]
    torque, instant = initialize_dynamics(linkage, run, times)
    if drive_sensors(model, linkage, record):
        record.record_forces()
    data.time = run.x[0]
    began = processor_time()
    torque = torque.reshape(run.x.size - 1, count, dofs.size)
    controls = HeldControls.of(model, run, times, count)
    with collected_warnings() as warnings:
        step_through(model, data, record, torque, instant[::count], dofs, controls)
    seconds = processor_time() - began
    state, channels, rows = None, record.curves(), record.rows
    if run.drives:
        state = rows["qpos"][:, linkage.adr].T, rows["qvel"][:, dofs].T, rows["qacc"][:, dofs].T
    if "qfrc_inverse" in rows:
        moments = moments_of_drives(rows, dofs, *armature_and_damping)
        channels |= drive_moment_curves(model, linkage, record, moments)
    violations = record.violations()
    curves = Curves(
        run.x,
        channels,
        missing,
        drive=state,
        violation=float(violations.max(initial=0.0)),
        seconds=seconds,
        steps=times.size - 1,
        settings=settings,
        violations=violations,
        asked_step=asked,
        work=(times.size - 1) * (StepWork(model).step(data) + PYTHON_STEP * bool(run.drives)),
    )
    check_run(model, data, record, curves, warnings)
    return curves


@dataclass(frozen=True)
class HeldControls:
    """Controls that change in a run, constant in each step.

    Attributes
    ----------
    places : ndarray (loads,)
        Indices of the controls in ``ctrl``.
    held : ndarray (intervals, steps, loads)
        Controls in each step, with their values in the middle of the step [its unit].
    instant : ndarray (samples, loads)
        Controls at the samples [its unit].
    """

    places: NDArray[np.int32]
    held: Array
    instant: Array

    @classmethod
    def of(cls, model: mujoco.MjModel, run: Run, times: Array, count: int) -> "HeldControls | None":
        """The changing controls of a run with steps between `times`; None if it has none."""
        if not run.loads:
            return None
        places = control_indices(model, (one.actuator for one in run.loads))
        held = run.controls(0.5 * (times[:-1] + times[1:]))[0].T
        instant = run.controls(times[::count])[0].T
        return cls(np.array(places), held.reshape(-1, count, len(places)), instant)


def moments_of_drives(
    rows: Mapping[str, Array], dofs: NDArray[np.int32], armature: Array, damping: Array
) -> Array:
    """Moments that the mechanism needs from its drives [N m or N] (samples, drives).

    They follow from the balance of each driven joint, with the armature and the damping that the
    model gives it and without the flywheel.
    """

    def driven_rows(name: str) -> Array:
        return rows[name][:, dofs]

    given = (
        driven_rows("qfrc_passive") + driven_rows("qfrc_constraint") + driven_rows("qfrc_actuator")
    )
    needed = (
        driven_rows("qfrc_inverse") + armature * driven_rows("qacc") + damping * driven_rows("qvel")
    )
    return np.asarray(needed - given)


def step_through(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    record: Recorder,
    torque: Array,
    instant: Array,
    dofs: NDArray[np.int32],
    controls: HeldControls | None = None,
) -> None:
    """Step from sample to sample and record each; `torque` has shape (intervals, steps, drives).

    A step applies its `torque`, for the mean acceleration of the motion profile in that step.  A
    forward pass at a sample applies the `instant` torque, for the profile's acceleration at that
    time.  Controls that change are set in the same way.
    """
    applied, mj_step, forward = data.qfrc_applied, mujoco.mj_step, mujoco.mj_forward
    is_rk4 = model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4
    # steps of an interval after its first; one call if all are alike
    later_steps = torque.shape[1] - 1
    is_constant = (torque[:, 1:] == torque[:, 1:2]).all(axis=(1, 2)).tolist()
    drive_dofs: slice | NDArray[np.int32] = dofs
    if dofs.size < 2:  # a plain number is written three times as fast as an array
        drive_dofs = slice(dofs[0], dofs[0] + 1) if dofs.size else slice(0, 0)
        torque, instant = torque.sum(axis=-1).tolist(), instant.sum(axis=-1).tolist()
    ctrl, places, held = data.ctrl, None, None
    if controls:
        places, held = controls.places, controls.held
    for k, forces in enumerate(torque):
        if is_rk4:
            applied[drive_dofs] = instant[k]
            if controls:
                ctrl[places] = controls.instant[k]
            forward(model, data)
            record.sample(k)
        else:
            record.sample_state(k)
        applied[drive_dofs] = forces[0]
        if held is not None:
            ctrl[places] = held[k, 0]
        mj_step(model, data)
        if not is_rk4:
            record.sample_shown(k)
        if held is not None:
            for force, control in zip(forces[1:], held[k, 1:], strict=True):
                applied[drive_dofs], ctrl[places] = force, control
                mj_step(model, data)
        elif later_steps and is_constant[k]:
            applied[drive_dofs] = forces[1]
            mj_step(model, data, later_steps)
        else:
            for force in forces[1:]:
                applied[drive_dofs] = force
                mj_step(model, data)
    applied[drive_dofs] = instant[-1]
    if controls:
        ctrl[places] = controls.instant[-1]
    forward(model, data)
    record.sample(len(torque))


def check_run(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    record: Recorder,
    curves: Curves,
    warnings: Iterable[str],
) -> None:
    """Raise `Diverged` if the run failed, with the curves until the failure.

    MuJoCo resets a state that is not finite and continues; it reports this only in a warning.
    `warnings` has the texts of all warnings, with the time of the reset.
    """
    violations, pose = cast(Array, curves.violations), record.rows["qpos"]
    finite = np.isfinite(pose).all(axis=1) & (violations <= 0.1 * model.stat.extent)
    warning = failure_warning(data)
    if not warning and finite.all():
        return
    k = int(np.argmin(finite)) if not finite.all() else finite.size
    times = [float(t) for text in warnings for t in WARNING_TIME.findall(text)]
    if warning and times and times[0] < curves.x[min(k, finite.size - 1)]:
        k, when = int(np.searchsorted(curves.x, times[0])), f"t = {times[0]:.4g} s"
    else:
        when = f"t = {curves.x[k]:.4g} s" if k < finite.size else "some time"
    if warning:
        message = f"{warning}; failed at {when}"
    elif not np.isfinite(pose[k]).all():
        message = f"not finite at {when}"
    else:
        message = f"a loop came open by {violations[k]:.3g} m at {when}"
    raise Diverged(message, curves.first(k) if k else None)


def run_passive(model: mujoco.MjModel, data: mujoco.MjData, run: Run) -> Curves:
    """Step from the present pose and controls through ``run.x`` (time), and read every sensor.

    Parameters
    ----------
    model : mujoco.MjModel
        All of its sensors have names; a sensor with several numbers gives channels ``name[k]``.
    data : mujoco.MjData
    run : Run
        Only its ``x`` is used.

    Raises
    ------
    Diverged
        The engine reset itself, or a sensor is not finite.
    """
    count, model.opt.timestep = run.steps(model.opt.timestep)
    rows, began = np.empty((run.x.size, model.nsensordata)), processor_time()
    for row in rows[:-1]:
        mujoco.mj_step(model, data)
        row[:] = data.sensordata  # of the state in which the step began
        if count > 1:
            mujoco.mj_step(model, data, count - 1)
    mujoco.mj_forward(model, data)
    rows[-1] = data.sensordata
    seconds = processor_time() - began
    check_finite(data, rows, run.x)
    return Curves(
        run.x,
        sensor_curves(model, rows),
        seconds=seconds,
        steps=count * (run.x.size - 1),
        settings=stepping_settings(model),
        work=count * (run.x.size - 1) * StepWork(model).step(data),
    )


def check_finite(data: mujoco.MjData, rows: Array, times: Array) -> None:
    """Raise `Diverged` if MuJoCo warned of a failure or a sensor is not finite."""
    if warning := failure_warning(data):
        raise Diverged(warning)
    finite = np.isfinite(rows).all(axis=1)
    if not finite.all():
        raise Diverged(f"not finite at t = {times[int(np.argmin(finite))]:.4g} s")


def sensor_curves(model: mujoco.MjModel, rows: Array) -> dict[str, Array]:
    """The sensor readings of all samples as curves by channel name."""
    found = {}
    for s in range(model.nsensor):
        name, first, dim = model.sensor(s).name, model.sensor_adr[s], model.sensor_dim[s]
        for k in range(dim):
            found[name if dim == 1 else f"{name}[{k}]"] = rows[:, first + k].copy()
    return found
