"""Quasi-static sweep in MuJoCo: poses, rates, accelerations and forces without time steps.

Moments of drives and forces between bodies are those at rest, or with `Run.inertia` those at the
drives' rates and accelerations; they follow from the engine's inverse dynamics with rigid loops.
Controls of changing loads are set at each pose; between two poses they are followed like drives.
Degrees of freedom that the drives leave are in the equilibrium of springs, weights and joint
limits, see `proofmass.sim.mujoco.equilibrium`.  With the setting ``settled = true`` the engine
itself steps until it is at rest, see `proofmass.sim.mujoco.settling`.

A run of kind `equilibrium` finds one pose and the shapes of its rods.  The start shapes may be far
from equilibrium: Newton's method descends in steps of bounded size, up to a maximum number.
"""

import mujoco
import numpy as np

from proofmass.base.arrays import Array
from proofmass.base.clock import processor_time
from proofmass.sim.mujoco.equilibrium import RestingLinkage, RubbingLinkage, linkage_of
from proofmass.sim.mujoco.model import Recorder
from proofmass.sim.mujoco.sensors import (
    drive_moment_curves,
    interaction_indices,
    withhold_interactions,
    withhold_stage,
)
from proofmass.sim.mujoco.settling import settled_sweep
from proofmass.sim.mujoco.work import StepWork
from proofmass.sim.plane import find_plane
from proofmass.sim.protocol.curves import Curves
from proofmass.sim.protocol.failures import BadModel, Unsupported
from proofmass.sim.protocol.run import Run
from proofmass.sim.rods import Chain, RodPose, rod_channels, rod_curves

NO_MOTION = "nothing moves in an equilibrium run: it has no rates and no accelerations"
ACCELERATION_STAGE = int(mujoco.mjtStage.mjSTAGE_ACC)
NO_ACCELERATIONS = (
    "springs, weights or joint limits determine the pose: an equilibrium has no accelerations"
)


def sweep(model: mujoco.MjModel, data: mujoco.MjData, run: Run) -> Curves:
    """Follow the drives over ``run.x`` and read every sensor at every pose.

    The sweep ends early where the loops cannot be closed any further, where a joint that the drives
    move leaves its range, or where the equilibrium of the remaining degrees of freedom folds or
    becomes unstable.  With the setting ``settled = true`` the engine steps in time.

    Raises
    ------
    BadModel
        The loops cannot be closed at the first values of the drives, or the start pose is an
        unstable equilibrium.
    Unsupported
        Degrees of freedom remain that have no equilibrium near the start pose, or an equality is of
        a kind that is not covered.
    """
    if not run.drives:
        raise BadModel("a sweep needs a [drive]: the joint that is moved")
    if run.settings.get("settled"):
        if run.loads:
            raise Unsupported(
                f"the load of actuator {run.loads[0].actuator!r}, which changes, in a sweep that "
                "is settled"
            )
        return settled_sweep(model, data, run)
    state, (controls, control_rates) = run.motion(run.x), run.controls(run.x)
    inputs = np.vstack([state[0], controls]), np.vstack([state[1], control_rates]), state[2]
    linkage = linkage_of(model, data, run)
    record = Recorder(model, data, run.channels, run.x.size)
    missing = withhold_interactions(record)
    missing |= (
        withhold_stage(record, ACCELERATION_STAGE, NO_ACCELERATIONS)
        if isinstance(linkage, RestingLinkage)
        else {}
    )
    drives = len(run.drives)
    moments, stopped, solved = np.empty((run.x.size, drives)), "", run.x.size
    force_indices = np.array(interaction_indices(record), int)
    has_forces = bool(force_indices.size)
    began = processor_time()
    fastest, path = float(np.abs(state[1]).max()), linkage.path(inputs[0])
    for k, (values, rates, accelerations) in enumerate(zip(*(s.T for s in inputs), strict=True)):
        try:
            tangent = next(path)
            linkage.check_limits()
            velocity = tangent @ rates
            linkage.rubs(velocity, fastest)
            if not run.inertia:
                data.qvel[:] = data.qacc[:] = 0.0
                moments[k] = linkage.balance_forces(tangent, has_forces)[:drives]
                forces = data.sensordata[force_indices]
            data.qvel[:] = velocity
            data.qacc[:] = linkage.acceleration(velocity, accelerations)
        except (BadModel, Unsupported) as error:
            if k < 2:
                raise
            stopped, solved = str(error), k
            break
        mujoco.mj_inverse(model, data)
        if data.ncon:
            raise Unsupported(
                f"{data.ncon} contact(s) in a sweep, at {linkage.format_drives(values[:drives])}"
            )
        if run.inertia:
            moments[k] = linkage.balance_forces(tangent, has_forces)[:drives]
        else:
            data.sensordata[force_indices] = forces
        record.sample(k)
    if isinstance(linkage, RubbingLinkage) and not stopped:
        linkage.check_slipped()
    seconds = processor_time() - began
    record.cut(solved)
    channels = record.curves()
    channels |= drive_moment_curves(model, linkage, record, moments[:solved])
    value, rate, acceleration = (part[:, :solved] for part in state)
    return Curves(
        run.x[:solved],
        channels,
        missing,
        drive=(value, rate, acceleration),
        violation=float(record.violations().max()),
        seconds=seconds,
        steps=solved,
        stopped=stopped,
        derivatives=1 if isinstance(linkage, RestingLinkage) else 2,
        work=solved * StepWork(model).pose(),
    )


VELOCITY_STAGE = int(mujoco.mjtStage.mjSTAGE_VEL)


def equilibrium(model: mujoco.MjModel, data: mujoco.MjData, run: Run) -> Curves:
    """Find the equilibrium of the model with its drives at their first values.

    Rods are read at the arc lengths ``run.x``; a sensor has one value, which is repeated for each
    of these.

    Raises
    ------
    BadModel
        The loops cannot be closed, or the equilibrium is not stable.
    Unsupported
        The degrees of freedom have no equilibrium, or an equality is of a kind that is not covered.
    """
    began = processor_time()
    linkage = linkage_of(model, data, run)
    tangent = linkage.move(run.motion(run.x[:1])[0][:, 0])
    linkage.check_limits()
    sensors = tuple(c for c in run.channels if c not in rod_channels(run))
    record = Recorder(model, data, sensors, 1)
    missing = withhold_interactions(record) | withhold_stage(record, VELOCITY_STAGE, NO_MOTION)
    mujoco.mj_forward(model, data)
    data.qvel[:] = data.qacc[:] = 0.0
    moments = linkage.balance_forces(tangent, bool(interaction_indices(record)))
    record.sample(0)
    curves = record.curves() | drive_moment_curves(model, linkage, record, moments[None])
    curves = {name: np.repeat(values, run.x.size) for name, values in curves.items()}
    curves |= rod_curves(run, lambda one: rod_pose(model, data, one))
    return Curves(
        run.x,
        curves,
        missing,
        violation=float(record.violations().max()),
        seconds=processor_time() - began,
        steps=1,
        work=StepWork(model).pose(),
    )


def rod_pose(model: mujoco.MjModel, data: mujoco.MjData, one: Chain) -> RodPose:
    """Vertices, angles and bends of a rod's links; for a rod in space see `rod_curves`."""
    links = [model.body(name).id for name in one.names]
    axes = data.xmat[links].reshape(-1, 3, 3)
    directions = axes[:, :, 0]
    places = np.vstack([data.xpos[links], data.site(f"{one.rod.name}.tip").xpos])
    if one.rod.spatial:
        moments = [section_moment(model, data, one, k, axes) for k in range(len(links))]
        return places, axes, np.array(moments)
    x, y = find_plane(model, data).flat(directions).T
    bends = np.array(
        [
            data.joint(name).qpos[0] if jointed else 0.0
            for name, jointed in zip(one.names, one.has_joint, strict=True)
        ]
    )
    return places, np.arctan2(y, x), bends


def section_moment(
    model: mujoco.MjModel, data: mujoco.MjData, one: Chain, k: int, axes: Array
) -> Array:
    """The moment (3,) [N m] in a rod in space where link k begins, about the axes of the section.

    The springs of the hinges give the moments about the hinge axes, which are neither the axes of
    the link before nor those of the link after.
    """
    hinges = one.hinges(k)
    if not hinges:
        return np.full(3, np.nan)
    numbers = [model.joint(hinge.name).id for hinge in hinges]
    values = data.qpos[model.jnt_qposadr[numbers]]
    hinge_moments = [
        hinge.spring * (value - hinge.rest) for hinge, value in zip(hinges, values, strict=True)
    ]
    left, _, right = np.linalg.svd(axes[k - 1] + axes[k])
    return np.asarray(np.linalg.solve(data.xaxis[numbers], hinge_moments) @ (left @ right))
