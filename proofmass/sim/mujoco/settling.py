"""Sweep in which MuJoCo itself steps to rest at every sample, with its soft loops and limits.

Neither inertia nor damping changes an equilibrium, but both change the way to it.  Inertia also
changes the softness of MuJoCo's constraints, whose stiffness is proportional to the inertia that
they act on: a force F opens a constraint by

    (1 - d) F T^2 / m      (d, T: the constraint's solimp and time constant, m: inertia)

Every joint therefore gets an armature with which the phase of its oscillation on its own stiffness
grows by `PHASE_PER_STEP` radians per step, and the damping that is critical for the slowest degree
of freedom.  With solimp 0.9999 and a time constant of two to five steps the relative error of a
moment is then 1e-7 to 1e-6; with MuJoCo's default solref and solimp of limits (`solreflimit`,
`solimplimit`) it is 1e-2.
"""

import copy
from collections.abc import Callable

import mujoco
import numpy as np

from proofmass.analytic.support import RunKind
from proofmass.base.arrays import Array
from proofmass.base.clock import processor_time
from proofmass.sim.dense import mass_matrix
from proofmass.sim.mjcf import failure_warning
from proofmass.sim.mujoco.equilibrium import LOOP_RANK_TOLERANCE, RestingLinkage
from proofmass.sim.mujoco.linkage import Linkage
from proofmass.sim.mujoco.model import Recorder, refuse_uncovered
from proofmass.sim.mujoco.sensors import drive_moment_curves, withhold_interactions, withhold_stage
from proofmass.sim.mujoco.settings import stepping_settings
from proofmass.sim.mujoco.work import StepWork
from proofmass.sim.protocol.curves import Curves
from proofmass.sim.protocol.failures import Diverged, NotSolved
from proofmass.sim.protocol.run import Run


def step_to_rest(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    rest_speed: float,
    *,
    block: int,
    max_steps: int,
    constrain: Callable[[], None] = lambda: None,
    context: str = "",
) -> int:
    """Step until all speeds are below `rest_speed` at two successive checks; the number of steps.

    Parameters
    ----------
    model, data
    rest_speed : float
        Speed of the fastest joint below which the model counts as at rest [rad/s or m/s].
    block, max_steps : int
        Number of steps between two checks, and largest number of steps.
    constrain : callable
        Called before each block of steps.
    context : str
        Values of the drives, for messages.

    Raises
    ------
    Diverged
        The engine reset itself.
    NotSolved
        The model does not come to rest.
    """
    before, steps = np.inf, 0
    for steps in range(block, max_steps, block):
        constrain()
        mujoco.mj_step(model, data, block)
        speed = float(np.abs(data.qvel).max())
        if warning := failure_warning(data):
            raise Diverged(f"{warning}; failed on the way to rest{context}")
        if max(speed, before) < rest_speed:
            return steps
        before = speed
    joint = model.joint(model.dof_jntid[np.abs(data.qvel).argmax()]).name
    raise NotSolved(
        f"not at rest after {steps} steps{context}: joint {joint!r} moves at "
        f"{before:.2g} (rad/s or m/s)"
    )


VELOCITY_STAGE = int(mujoco.mjtStage.mjSTAGE_VEL)
NO_RATE = "the engine is at rest at every sample: no rates, no accelerations"
PHASE_PER_STEP = 0.015  # [rad] phase per step of a joint that oscillates on its own stiffness
MIN_STIFFNESS_SHARE = 1e-3  # share of the largest stiffness; joints with less oscillate more slowly
# inertia of a drive in multiples of the largest: until rest only rounding moves it
HELD_DRIVE_RATIO = 1e12
STEPS_PER_STRIDE = 100  # steps in which the drives move by a stride of `Linkage`
STEPS_PER_CHECK = 50  # steps between two checks of the speed
REST_SPEED = 1e-9  # [rad/s or m/s] speed of the fastest joint below which the model is at rest
MAX_SETTLING_STEPS = 400_000  # steps after which a sample is given up


def settled_sweep(model: mujoco.MjModel, data: mujoco.MjData, run: Run) -> Curves:
    """Sweep the drives over ``run.x``; at each sample step to rest, and read every sensor there.

    Raises
    ------
    Unsupported
        The model has a feature that such a run does not cover.
    Diverged
        The engine reset itself, or does not come to rest.
    """
    refuse_uncovered(model, RunKind.SETTLED_SWEEP, [drive.joint for drive in run.drives])
    linkage = Linkage(model, data, tuple(d.joint for d in run.drives))
    set_inertia_and_damping(linkage)
    record = Recorder(model, data, run.channels, run.x.size)
    missing = withhold_interactions(record) | withhold_stage(record, VELOCITY_STAGE, NO_RATE)
    value, rate, acceleration = run.motion(run.x)
    moments, steps, began = np.empty(value.T.shape), 0, processor_time()
    for k, values in enumerate(value.T):
        steps += move_drives(linkage, values) + settle_at(linkage, values)
        moments[k] = holding_moments(linkage)
        record.sample(k)
    seconds = processor_time() - began
    channels = record.curves() | drive_moment_curves(model, linkage, record, moments)
    return Curves(
        run.x,
        channels,
        missing,
        (value, rate, acceleration),
        float(record.violations().max(initial=0.0)),
        seconds,
        steps,
        stepping_settings(model),
        derivatives=0,
        work=steps * StepWork(model).step(data),
    )


def set_inertia_and_damping(linkage: Linkage) -> None:
    """Set the armatures and the damping of the joints, and the flywheels of the drives."""
    import scipy.linalg  # slow to load

    model, data, dofs = linkage.model, linkage.data, linkage.dofs
    rest = RestingLinkage(copy.copy(model), copy.copy(data), linkage.joints, linkage.dof())
    rest.settle()
    stiffness = rest.balance.stiffness
    null = scipy.linalg.null_space(
        np.vstack([rest.rows()[1], rest.units]), rcond=LOOP_RANK_TOLERANCE
    )
    own = np.abs(np.diag(stiffness))
    pace = PHASE_PER_STEP / model.opt.timestep
    model.dof_armature += np.maximum(own, MIN_STIFFNESS_SHARE * own.max()) / pace**2
    linkage.rows()
    inertia = mass_matrix(model, data)
    squares = scipy.linalg.eigvalsh(null.T @ stiffness @ null, null.T @ inertia @ null)
    slowest = np.sqrt(np.abs(squares).min(initial=pace**2))
    model.dof_damping += 2 * slowest * np.diag(inertia)
    model.dof_armature[dofs] += HELD_DRIVE_RATIO * inertia.max()
    model.dof_damping[dofs] = 0
    model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_DAMPER)  # this damping must act
    pose = data.qpos.copy()
    mujoco.mj_setConst(model, data)  # the stiffness of MuJoCo's constraints depends on the inertia
    data.qpos[:], data.qvel[:] = pose, 0


def move_drives(linkage: Linkage, values: Array) -> int:
    """Move the drives at constant speeds to their next values; returns the number of steps."""
    model, data = linkage.model, linkage.data
    way = values - data.qpos[linkage.adr]
    steps = int(np.ceil(STEPS_PER_STRIDE * (np.abs(way) / linkage.stride).max()))
    if steps:
        data.qvel[linkage.dofs] = way / (steps * model.opt.timestep)
        mujoco.mj_step(model, data, steps)
    return steps


def settle_at(linkage: Linkage, values: Array) -> int:
    """Step with the drives at fixed values until the model is at rest; the number of steps."""
    data = linkage.data

    def constrain() -> None:
        data.qpos[linkage.adr], data.qvel[linkage.dofs] = values, 0

    return step_to_rest(
        linkage.model,
        data,
        REST_SPEED,
        block=STEPS_PER_CHECK,
        max_steps=MAX_SETTLING_STEPS,
        constrain=constrain,
        context=f" at {linkage.format_drives(values)}",
    )


def holding_moments(linkage: Linkage) -> Array:
    """Moments that the drives must exert at rest, besides the engine's own constraint forces."""
    data = linkage.data
    mujoco.mj_forward(linkage.model, data)
    forces = data.qfrc_bias - data.qfrc_passive - data.qfrc_constraint - data.qfrc_actuator
    return forces[linkage.dofs]
