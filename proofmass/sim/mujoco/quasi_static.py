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

import time

import mujoco
import numpy as np

from proofmass.analytic.numerics import Array
from proofmass.sim.mujoco.equilibrium import RestingLinkage, RubbingLinkage, linkage_of
from proofmass.sim.mujoco.model import Recorder
from proofmass.sim.mujoco.sensors import (
    drive_moments,
    interactions,
    withhold,
    withhold_interactions,
)
from proofmass.sim.mujoco.settling import settled
from proofmass.sim.plane import find_plane
from proofmass.sim.protocol import BadModel, Curves, Run, Unsupported
from proofmass.sim.rods import Chain, RodPose, of_rods, shapes

ACC = int(mujoco.mjtStage.mjSTAGE_ACC)
NO_ACC = "springs, weights or joint limits determine the pose: an equilibrium has no accelerations"


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
        return settled(model, data, run)
    state, (controls, control_rates) = run.motion(run.x), run.controls(run.x)
    inputs = np.vstack([state[0], controls]), np.vstack([state[1], control_rates]), state[2]
    linkage = linkage_of(model, data, run)
    record = Recorder(model, data, run.channels, run.x.size)
    missing = withhold_interactions(record)
    missing |= withhold(record, ACC, NO_ACC) if isinstance(linkage, RestingLinkage) else {}
    drives = len(run.drives)
    moments, stopped, done = np.empty((run.x.size, drives)), "", run.x.size
    shown = interactions(record)
    began = time.perf_counter()
    fastest, path = float(np.abs(state[1]).max()), linkage.path(inputs[0])
    for k, (values, rates, accelerations) in enumerate(zip(*(s.T for s in inputs), strict=True)):
        try:
            tangent = next(path)
            linkage.check_limits()
            linkage.rubs(tangent @ rates, fastest)
            if not run.inertia:
                data.qvel[:] = data.qacc[:] = 0.0
                moments[k] = linkage.balance_forces(tangent, bool(shown))[:drives]
                forces = data.sensordata[shown]
            data.qvel[:] = tangent @ rates
            data.qacc[:] = linkage.acceleration(data.qvel, accelerations)
        except (BadModel, Unsupported) as error:
            if k < 2:
                raise
            stopped, done = str(error), k
            break
        mujoco.mj_inverse(model, data)
        if data.ncon:
            raise Unsupported(
                f"{data.ncon} contact(s) in a sweep, at {linkage.format_drives(values[:drives])}"
            )
        if run.inertia:
            moments[k] = linkage.balance_forces(tangent, bool(shown))[:drives]
        else:
            data.sensordata[shown] = forces
        record.sample(k)
    if isinstance(linkage, RubbingLinkage) and not stopped:
        linkage.check_slipped()
    seconds = time.perf_counter() - began
    record.cut(done)
    channels = record.curves()
    channels |= drive_moments(model, linkage, record, moments[:done])
    value, rate, acceleration = (part[:, :done] for part in state)
    return Curves(
        run.x[:done],
        channels,
        missing,
        drive=(value, rate, acceleration),
        violation=float(record.gaps().max()),
        seconds=seconds,
        steps=done,
        stopped=stopped,
        derivatives=1 if isinstance(linkage, RestingLinkage) else 2,
    )


VELOCITY = int(mujoco.mjtStage.mjSTAGE_VEL)


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
    began = time.perf_counter()
    linkage = linkage_of(model, data, run)
    tangent = linkage.move(run.motion(run.x[:1])[0][:, 0])
    linkage.check_limits()
    sensors = tuple(c for c in run.channels if c not in of_rods(run))
    record = Recorder(model, data, sensors, 1)
    missing = withhold_interactions(record) | withhold(record, VELOCITY, NO_ACC)
    mujoco.mj_forward(model, data)
    data.qvel[:] = data.qacc[:] = 0.0
    moments = linkage.balance_forces(tangent, bool(interactions(record)))
    record.sample(0)
    curves = record.curves() | drive_moments(model, linkage, record, moments[None])
    curves = {name: np.repeat(values, run.x.size) for name, values in curves.items()}
    curves |= shapes(run, lambda one: pose(model, data, one))
    return Curves(
        run.x,
        curves,
        missing,
        violation=float(record.gaps().max()),
        seconds=time.perf_counter() - began,
        steps=1,
    )


def pose(model: mujoco.MjModel, data: mujoco.MjData, one: Chain) -> RodPose:
    """Vertices, angles and bends of a rod's links; for a rod in space see `shapes`."""
    links = [model.body(name).id for name in one.names]
    axes = data.xmat[links].reshape(-1, 3, 3)
    ahead = axes[:, :, 0]
    places = np.vstack([data.xpos[links], data.site(f"{one.rod.name}.tip").xpos])
    if one.rod.spatial:
        moments = [moment(model, data, one, k, axes) for k in range(len(links))]
        return places, axes, np.array(moments)
    x, y = find_plane(model, data).flat(ahead).T
    bends = np.array(
        [
            data.joint(name).qpos[0] if jointed else 0.0
            for name, jointed in zip(one.names, one.jointed, strict=True)
        ]
    )
    return places, np.arctan2(y, x), bends


def moment(model: mujoco.MjModel, data: mujoco.MjData, one: Chain, k: int, axes: Array) -> Array:
    """The moment (3,) [N m] in a rod in space where link k begins, about the axes of the section.

    The springs of the hinges give the moments about the hinge axes, which are neither the axes of
    the link before nor those of the link after.
    """
    hinges = one.hinges(k)
    if not hinges:
        return np.full(3, np.nan)
    numbers = [model.joint(hinge.name).id for hinge in hinges]
    values = data.qpos[model.jnt_qposadr[numbers]]
    about = [
        hinge.spring * (value - hinge.rest) for hinge, value in zip(hinges, values, strict=True)
    ]
    left, _, right = np.linalg.svd(axes[k - 1] + axes[k])
    return np.asarray(np.linalg.solve(data.xaxis[numbers], about) @ (left @ right))
