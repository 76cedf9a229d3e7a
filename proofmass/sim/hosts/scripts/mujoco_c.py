"""MuJoCo of any version from 3.2 on: its own reading of the model, stepped as the model says."""

import os

import mujoco
import numpy as np
from proofmass_host import (
    LinkStates,
    NeutralMechanism,
    NoRest,
    Refused,
    Stopwatch,
    WayToRest,
    come_to_rest,
)

VERSIONS = {"mujoco": mujoco.__version__, "numpy": np.__version__}
STEPS_AT_ONCE, REST = 50, WayToRest(0.0, 1e-9, 1e-5, 1, 8000)  # of the fastest joint
MOVES_PER_COUNT = 50  # steps for one of `NeutralMechanism.count`, which is for stiffer constraints
FATAL = ("mjWARN_INERTIA", "mjWARN_BADQPOS", "mjWARN_BADQVEL", "mjWARN_BADQACC")


def build(mjcf):
    """The model of this version with the numbers of the run, and data at its start."""
    os.chdir(mjcf.folder)
    try:
        model = mujoco.MjModel.from_xml_string(mjcf.text)
    except ValueError as error:
        words = " ".join(str(error).split())
        raise Refused(f"this version cannot read the model: {words}") from None
    if (model.nq, model.nv, model.neq, model.nbody) != mjcf.sizes:
        raise Refused("this version reads other joints, bodies or equalities")
    for name, values in mjcf.arrays.items():
        there = getattr(model, name, None)
        if there is not None and np.shape(there) == values.shape:
            there[...] = values
        elif values.any():
            raise Refused(f"this version has no {name} of this shape")
    for name, value in mjcf.options.items():
        if value.ndim:
            getattr(model.opt, name)[:] = value
        elif hasattr(model.opt, name):
            setattr(model.opt, name, value.item())
    kinds = {"integrator": "mjtIntegrator", "solver": "mjtSolver", "cone": "mjtCone"}
    for name, kind in kinds.items():
        setattr(model.opt, name, int(word(kind, mjcf.words[name])))
    flags = mjcf.words["disabled"].split()
    model.opt.disableflags = sum(int(word("mjtDisableBit", flag)) for flag in flags)
    data = mujoco.MjData(model)
    data.qpos[:] = mjcf.qpos
    mujoco.mj_setConst(model, data)  # the flywheels belong to the inertia
    data.qpos[:], data.qvel[:], data.ctrl[:] = mjcf.qpos, mjcf.qvel, mjcf.ctrl
    data.xfrc_applied[:] = mjcf.pushes
    return model, data


def word(kind, name):
    """The number of a word of MuJoCo in this version."""
    found = getattr(getattr(mujoco, kind), name, None)
    if found is None:
        raise Refused(f"this version has no {name}")
    return found


def simulate(mechanism: NeutralMechanism, settings: dict) -> LinkStates:
    """Step as the product's own engine does, and read the links at the samples."""
    mjcf = mechanism.mjcf
    model, data = build(mjcf)
    if mechanism.rest:
        return come_to_rests(mechanism, model, data)
    count, n, changes = mechanism.count, mechanism.samples, mjcf.changed.size > 0
    rows = [np.empty((n, size)) for size in (model.nq, model.nv, model.nv)]
    times = np.empty(n)
    with Stopwatch() as watch:
        for k in range(n):
            times[k] = data.time
            data.qfrc_applied[mjcf.dofs] = mjcf.instant[k * count]
            if changes:
                data.ctrl[mjcf.changed] = mjcf.controls[2 * k * count]
            mujoco.mj_forward(model, data)
            for row, now in zip(rows, (data.qpos, data.qvel, data.qacc)):
                row[k] = now
            for i in range(k * count, (k + 1) * count if k < n - 1 else 0):
                data.qfrc_applied[mjcf.dofs] = mjcf.torque[i]
                if changes:
                    data.ctrl[mjcf.changed] = mjcf.controls[2 * i + 1]
                mujoco.mj_step(model, data)
    numbers = [data.warning[int(getattr(mujoco.mjtWarning, name))].number for name in FATAL]
    said = [name[7:].lower() for name, number in zip(FATAL, numbers) if number]
    failed = f"MuJoCo warning {' and '.join(said)}" if said else ""
    # with such a warning MuJoCo starts again, at time 0
    lost = times < (np.arange(n) * count - 0.5) * model.opt.timestep
    rows[0][int(np.argmax(lost)) if lost.any() else n :] = np.nan
    return states_of(mechanism, model, rows, watch.seconds, failed)


def come_to_rests(mechanism, model, data):
    """Step to rest at each sample, as a settled sweep of the product's own engine."""
    mjcf, n, failed, steps = mechanism.mjcf, mechanism.samples, "", 0
    rows = [np.zeros((n, size)) for size in (model.nq, model.nv, model.nv)]
    rows[0][:] = np.nan
    adr = [model.jnt_qposadr[one.joint] for one in mechanism.drives]
    values, moves = np.zeros(len(adr)), MOVES_PER_COUNT * mechanism.count
    data.qvel[:] = 0.0

    def step():
        data.qpos[adr], data.qvel[mjcf.dofs] = values, 0.0
        mujoco.mj_step(model, data, STEPS_AT_ONCE)

    with Stopwatch() as watch:
        for k in range(n):
            values[:] = [one.value[2 * k * mechanism.count] for one in mechanism.drives]
            if mjcf.changed.size:
                data.ctrl[mjcf.changed] = mjcf.controls[2 * k * mechanism.count]
            if k:
                data.qvel[mjcf.dofs] = (values - data.qpos[adr]) / (moves * model.opt.timestep)
                mujoco.mj_step(model, data, moves)
                steps += moves
            try:
                steps += STEPS_AT_ONCE * come_to_rest(REST, step, lambda: np.abs(data.qvel).max())
            except NoRest as error:
                failed = f"{error} at sample {k}"
                break
            rows[0][k] = data.qpos
    states = states_of(mechanism, model, rows, watch.seconds, failed)
    states.steps = steps
    return states


def states_of(mechanism, model, rows, seconds, failed="", compiled=0.0):
    """The states of all links at coordinates, rates and accelerations of the samples."""
    finite = np.isfinite(rows[0]).all(axis=1) & np.isfinite(rows[1]).all(axis=1)
    states, data, rate = LinkStates.empty(mechanism), mujoco.MjData(model), np.zeros(6)
    states.seconds, states.compiled = seconds, compiled
    xbody = int(mujoco.mjtObj.mjOBJ_XBODY)
    count = len(finite) if finite.all() else int(np.argmin(finite))
    data.qpos[:] = mechanism.mjcf.qpos
    mujoco.mj_kinematics(model, data)
    frames = [data.xmat[one.body].reshape(3, 3).copy() for one in mechanism.links]
    offsets = [
        frame.T @ (one.centre - data.xpos[one.body]) for frame, one in zip(frames, mechanism.links)
    ]
    accelerated = np.isfinite(rows[2]).all()
    for k in range(count):
        data.qpos[:], data.qvel[:] = rows[0][k], rows[1][k]
        data.qacc[:] = rows[2][k] if accelerated else 0.0
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_fwdVelocity(model, data)
        mujoco.mj_rnePostConstraint(model, data)
        for i in range(1, len(frames)):
            body = mechanism.links[i].body
            turn = data.xmat[body].reshape(3, 3)
            arm = turn @ offsets[i]
            mujoco.mj_objectVelocity(model, data, xbody, body, rate, 0)
            omega, velocity = rate[:3].copy(), rate[3:].copy()
            mujoco.mj_objectAcceleration(model, data, xbody, body, rate, 0)
            alpha, acceleration = rate[:3].copy(), rate[3:] + model.opt.gravity
            states.place[k, i], states.turn[k, i] = data.xpos[body] + arm, turn @ frames[i].T
            states.velocity[k, i] = velocity + np.cross(omega, arm)
            states.omega[k, i], states.alpha[k, i] = omega, alpha
            states.acceleration[k, i] = (
                acceleration + np.cross(alpha, arm) + np.cross(omega, np.cross(omega, arm))
            )
    if not accelerated:
        states.acceleration[:], states.alpha[:] = np.nan, np.nan
    single = [one.kind in ("hinge", "slide") for one in mechanism.joints]
    states.coordinates = np.full((3, mechanism.samples, len(single)), np.nan)
    for j in np.flatnonzero(single):
        places = model.jnt_qposadr[j], model.jnt_dofadr[j], model.jnt_dofadr[j]
        states.coordinates[:, :, j] = [row[:, place] for row, place in zip(rows, places)]
    return states if count == len(finite) and not failed else states.first(count, failed)
