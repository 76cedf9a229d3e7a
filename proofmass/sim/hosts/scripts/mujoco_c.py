"""MuJoCo of any version from 3.2 on: its own reading of the model, stepped as the model says."""

import os

import mujoco
import numpy as np
import proofmass_host as host

VERSIONS = {"mujoco": mujoco.__version__, "numpy": np.__version__}
STEPS_AT_ONCE, REST = 50, host.WayToRest(0.0, 1e-9, 1e-5, 1, 8000)  # of the fastest joint
MOVES_PER_COUNT = 50  # steps for one of a mechanism's `count`, for stiffer constraints
FATAL = ("mjWARN_INERTIA", "mjWARN_BADQPOS", "mjWARN_BADQVEL", "mjWARN_BADQACC")


def build(mjcf):
    """The model of this version with the numbers of the run, and data at its start."""
    os.chdir(mjcf.folder)
    try:
        model = mujoco.MjModel.from_xml_string(mjcf.text)
    except ValueError as error:
        words = " ".join(str(error).split())
        raise host.Refused(f"this version cannot read the model: {words}") from None
    if (model.nq, model.nv, model.neq, model.nbody) != mjcf.sizes:
        raise host.Refused("this version reads other joints, bodies or equalities")
    for name, values in mjcf.arrays.items():
        there = getattr(model, name, None)
        if there is not None and np.shape(there) == values.shape:
            there[...] = values
        elif values.any():
            raise host.Refused(f"this version has no {name} of this shape")
    for name, value in mjcf.options.items():
        if hasattr(model.opt, name):
            setattr(model.opt, name, value if value.ndim else value.item())
    for name in ("integrator", "solver", "cone"):
        setattr(model.opt, name, int(word(f"mjt{name.title()}", mjcf.words[name])))
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
        raise host.Refused(f"this version has no {name}")
    return found


def simulate(mechanism: host.NeutralMechanism, settings: dict) -> host.LinkStates:
    """Step as the product's own engine does, and read the links at the samples."""
    mjcf = mechanism.mjcf
    model, data = build(mjcf)
    if mechanism.rest:
        return come_to_rests(mechanism, model, data)
    count, n, changes = mechanism.count, mechanism.samples, mjcf.changed.size > 0
    rows, times = [np.empty((n, size)) for size in (model.nq, model.nv, model.nv)], np.empty(n)
    with host.Stopwatch() as watch:
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
    rows[0][np.cumsum(lost) > 0] = np.nan
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

    def speed():
        return np.abs(data.qvel).max()

    with host.Stopwatch() as watch:
        for k in range(n):
            values[:] = [one.value[2 * k * mechanism.count] for one in mechanism.drives]
            if mjcf.changed.size:
                data.ctrl[mjcf.changed] = mjcf.controls[2 * k * mechanism.count]
            if k:
                data.qvel[mjcf.dofs] = (values - data.qpos[adr]) / (moves * model.opt.timestep)
                mujoco.mj_step(model, data, moves)
                steps += moves
            try:
                steps += STEPS_AT_ONCE * host.come_to_rest(REST, step, speed)
            except host.NoRest as error:
                failed = f"{error} at sample {k}"
                break
            rows[0][k] = data.qpos
    states = states_of(mechanism, model, rows, watch.seconds, failed)
    states.steps = steps
    return states


def states_of(mechanism, model, rows, seconds, failed="", compiled=0.0):
    """The states of all links at coordinates, rates and accelerations of the samples."""
    finite = np.isfinite(rows[0]).all(axis=1) & np.isfinite(rows[1]).all(axis=1)
    states, data = host.LinkStates.empty(mechanism, True), mujoco.MjData(model)
    states.seconds, states.compiled = seconds, compiled
    count = len(finite) if finite.all() else int(np.argmin(finite))
    data.qpos[:] = mechanism.mjcf.qpos
    mujoco.mj_kinematics(model, data)
    frames = [data.xmat[one.body].reshape(3, 3).copy() for one in mechanism.links]
    centres = [
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
        for i, link in enumerate(mechanism.links[1:], 1):
            states.set(k, i, motion_of(model, data, link.body, centres[i], frames[i]))
    if not accelerated:
        states.acceleration[:], states.alpha[:] = np.nan, np.nan
    for j in mechanism.singles:
        places = model.jnt_qposadr[j], model.jnt_dofadr[j], model.jnt_dofadr[j]
        states.coordinates[:, :, j] = [row[:, place] for row, place in zip(rows, places)]
    return states if count == len(finite) and not failed else states.first(count, failed)


def motion_of(model, data, body, centre, frame):
    """The motion of a link with a centre in its body, whose axes at the start are in `frame`."""
    turn, (velocity, acceleration) = data.xmat[body].reshape(3, 3), np.zeros((2, 6))
    xbody, arm = int(mujoco.mjtObj.mjOBJ_XBODY), turn @ centre
    mujoco.mj_objectVelocity(model, data, xbody, body, velocity, 0)
    mujoco.mj_objectAcceleration(model, data, xbody, body, acceleration, 0)
    omega, alpha, speed = velocity[:3], acceleration[:3], np.cross(velocity[:3], arm)
    drawn = model.opt.gravity + np.cross(alpha, arm) + np.cross(omega, speed)
    place, around = data.xpos[body] + arm, turn @ frame.T
    return place, around, velocity[3:] + speed, omega, acceleration[3:] + drawn, alpha
