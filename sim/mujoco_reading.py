"""What a sweep reads otherwise than from the sensors: moments of drives, and channels at rest."""

import mujoco

from sim.mujoco_linkage import Linkage
from sim.mujoco_model import Recorder, gear_of, joint_of
from sim.protocol import Array

S = mujoco.mjtSensor
MOMENTS = (int(S.mjSENS_ACTUATORFRC), int(S.mjSENS_JOINTACTFRC))
LIMITS = (int(S.mjSENS_JOINTLIMITPOS), int(S.mjSENS_JOINTLIMITVEL), int(S.mjSENS_JOINTLIMITFRC))


def withhold(record: Recorder, stage: int, why: str) -> dict[str, str]:
    """Take the channels out of a record that need that stage or a later one; which, and why.

    Moments of actuators belong to the pose; limits are the engine's soft ones.
    """
    model = record.model
    missing = {channel: why for channel, (index, _) in record.sensors.items()
               if model.sensor_type[index] in LIMITS or (
                   model.sensor_needstage[index] >= stage
                   and model.sensor_type[index] not in MOMENTS)}
    for channel in missing:
        del record.sensors[channel]
    return missing


def drive_moments(model: mujoco.MjModel, linkage: Linkage, record: Recorder,
                  moments: Array) -> dict[str, Array]:
    """Holding moments (n, drives) in place of the force sensors of the driven joints."""
    dofs, found = linkage.dofs.tolist(), {}
    for channel, (index, _) in record.sensors.items():
        if model.sensor_type[index] not in MOMENTS:
            continue
        on_actuator = model.sensor_type[index] == MOMENTS[0]
        place = model.sensor_objid[index]
        joint = joint_of(model, place) if on_actuator else place
        if joint >= 0 and model.jnt_dofadr[joint] in dofs:
            gear = gear_of(model, place)[0] if on_actuator else 1.0
            found[channel] = moments[:, dofs.index(model.jnt_dofadr[joint])] / gear
    return found
