"""Quasi-static sweep in MuJoCo: poses, rates, accelerations and holding moments without time steps.

The holding moment is virtual work: the engine's inverse dynamics at rest, projected on the motion
that the drive allows.  The engine's own ``qfrc_inverse`` at the drive is not it: on a closed loop
it leaves out what the loop carries.
"""

import time

import mujoco
import numpy as np

from sim.mujoco_linkage import Linkage
from sim.mujoco_model import Recorder
from sim.protocol import Array, BadModel, Curves, Run, Unsupported

S = mujoco.mjtSensor
MOMENTS = (int(S.mjSENS_ACTUATORFRC), int(S.mjSENS_JOINTACTFRC))


def sweep(model: mujoco.MjModel, data: mujoco.MjData, run: Run) -> Curves:
    """Follow the drives over ``run.x`` and read every sensor at every pose.

    Raises
    ------
    BadModel
        The loops cannot be closed at the first values of the drives.
    Unsupported
        Freedoms are left when the drives are held, or an equality is of another kind.
    """
    if not run.drives:
        raise BadModel("a sweep needs a [drive]: the joint that is moved")
    state = run.motion(run.x)
    linkage = Linkage(model, data, tuple(d.joint for d in run.drives))
    record = Recorder(model, data, run.channels, run.x.size)
    moments, stopped, done = np.empty((run.x.size, len(run.drives))), "", run.x.size
    began = time.perf_counter()
    tangent = None
    for k, (values, rates, accelerations) in enumerate(zip(*(s.T for s in state), strict=True)):
        try:
            tangent = linkage.move(values, tangent)
            moments[k] = linkage.holding_moments(tangent)
            data.qvel[:] = tangent @ rates
            data.qacc[:] = linkage.acceleration(data.qvel, accelerations)
        except (BadModel, Unsupported) as error:
            if k < 2:
                raise
            stopped, done = str(error), k
            break
        mujoco.mj_inverse(model, data)
        record.sample(k)
    seconds = time.perf_counter() - began
    record.cut(done)
    channels = record.curves()
    channels |= drive_moments(model, linkage, record, moments[:done])
    value, rate, acceleration = (part[:, :done] for part in state)
    return Curves(run.x[:done], channels, drive=(value, rate, acceleration),
                  gap=float(record.gaps().max()), seconds=seconds, steps=done, stopped=stopped)


def drive_moments(model: mujoco.MjModel, linkage: Linkage, record: Recorder,
                  moments: Array) -> dict[str, Array]:
    """Holding moments (n, drives) in place of the force sensors of the driven joints."""
    dofs, found = linkage.dofs.tolist(), {}
    for channel, (index, _) in record.sensors.items():
        if model.sensor_type[index] not in MOMENTS:
            continue
        on_actuator = model.sensor_type[index] == MOMENTS[0]
        place = model.sensor_objid[index]
        joint = model.actuator_trnid[place, 0] if on_actuator else place
        if model.jnt_dofadr[joint] in dofs:
            gear = model.actuator_gear[place, 0] if on_actuator else 1.0
            found[channel] = moments[:, dofs.index(model.jnt_dofadr[joint])] / gear
    return found
