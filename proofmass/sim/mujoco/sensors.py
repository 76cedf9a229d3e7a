"""What a run does not read from the sensors: moments of drives, and channels at rest."""

import mujoco

from proofmass.analytic.numerics import Array
from proofmass.sim.contents import gear_of_force, joint_of
from proofmass.sim.mujoco.linkage import Linkage
from proofmass.sim.mujoco.model import Recorder, is_acceleration

S = mujoco.mjtSensor
MOMENTS = (int(S.mjSENS_ACTUATORFRC), int(S.mjSENS_JOINTACTFRC))
NO_MOMENT = "the moment that moves a drive in time is not computed: sweeps only, at rest"
NO_ENERGY = "MuJoCo counts the flywheels of the drives as kinetic energy"
LIMITS = (int(S.mjSENS_JOINTLIMITPOS), int(S.mjSENS_JOINTLIMITVEL), int(S.mjSENS_JOINTLIMITFRC))


def withhold(record: Recorder, stage: int, why: str) -> dict[str, str]:
    """Take the channels out of a record that need that stage or a later one; which, and why.

    Moments of actuators belong to the pose; limits are the engine's soft ones.
    """
    model = record.model
    missing = {
        channel: why
        for channel, (index, _) in record.sensors.items()
        if model.sensor_type[index] in LIMITS
        or is_acceleration(model, index)
        or (model.sensor_needstage[index] >= stage and model.sensor_type[index] not in MOMENTS)
    }
    for channel in missing:
        del record.sensors[channel]
    return missing


def drive_sensors(
    model: mujoco.MjModel, linkage: Linkage, record: Recorder
) -> dict[str, tuple[int, float]]:
    """Channels of the force sensors of driven joints: the drive's number, and the motor's gear."""
    dofs, found = linkage.dofs.tolist(), {}
    for channel, (index, _) in record.sensors.items():
        if model.sensor_type[index] not in MOMENTS:
            continue
        on_actuator = model.sensor_type[index] == MOMENTS[0]
        place = model.sensor_objid[index]
        joint = joint_of(model, place) if on_actuator else place
        if joint >= 0 and model.jnt_dofadr[joint] in dofs:
            gear = gear_of_force(model, place) if on_actuator else 1.0
            found[channel] = dofs.index(model.jnt_dofadr[joint]), gear
    return found


def drive_moments(
    model: mujoco.MjModel, linkage: Linkage, record: Recorder, moments: Array
) -> dict[str, Array]:
    """Holding moments (n, drives) in place of the force sensors of the driven joints."""
    return {
        channel: moments[:, drive] / gear
        for channel, (drive, gear) in drive_sensors(model, linkage, record).items()
    }


def withhold_drives(model: mujoco.MjModel, linkage: Linkage, record: Recorder) -> dict[str, str]:
    """Take out of a record what flywheels and torques of ideal drives falsify; which, and why."""
    missing = dict.fromkeys(drive_sensors(model, linkage, record), NO_MOMENT)
    if linkage.joints:
        missing |= {
            channel: NO_ENERGY
            for channel, (index, _) in record.sensors.items()
            if model.sensor_type[index] == S.mjSENS_E_KINETIC
        }
    for channel in missing:
        del record.sensors[channel]
    return missing
