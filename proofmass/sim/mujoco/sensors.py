"""Channels that are not read from MuJoCo's sensors: moments of drives, and channels left out."""

import mujoco

from proofmass.base.arrays import Array
from proofmass.sim.contents import force_left_out, gear_of_force, joint_of
from proofmass.sim.mujoco.linkage import Linkage
from proofmass.sim.mujoco.model import Recorder, is_acceleration

S = mujoco.mjtSensor
MOMENT_SENSORS = (int(S.mjSENS_ACTUATORFRC), int(S.mjSENS_JOINTACTFRC))
NO_MOMENT = (
    "dry friction or polynomial damping of a driven joint, and the armature of a tendon or of an "
    "actuator, are not added to a drive's moment"
)
FORCE_LEFT_OUT = "MuJoCo's sensors of forces leave out {}"
NO_ENERGY = "MuJoCo counts the flywheels of the drives as kinetic energy"
INTERACTION_SENSORS = (int(S.mjSENS_FORCE), int(S.mjSENS_TORQUE))
LIMIT_SENSORS = (
    int(S.mjSENS_JOINTLIMITPOS),
    int(S.mjSENS_JOINTLIMITVEL),
    int(S.mjSENS_JOINTLIMITFRC),
)


def withhold_stage(record: Recorder, stage: int, why: str) -> dict[str, str]:
    """Take the channels that need `stage` or a later one out of a record; returns them and `why`.

    Moments of actuators and forces between bodies stay, since they have values at rest.  Sensors of
    joint limits are always taken out, since they show the engine's soft limits.
    """
    model = record.model
    missing = {
        channel: why
        for channel, (index, _) in record.sensors.items()
        if model.sensor_type[index] in LIMIT_SENSORS
        or is_acceleration(model, index)
        or (
            model.sensor_needstage[index] >= stage
            and model.sensor_type[index] not in (*MOMENT_SENSORS, *INTERACTION_SENSORS)
        )
    }
    for channel in missing:
        del record.sensors[channel]
    return missing


def withhold_interactions(record: Recorder) -> dict[str, str]:
    """Take the sensors of forces between bodies out of a record if MuJoCo leaves a force out.

    Returns the channels that were taken out, with the reason.
    """
    model = record.model
    what = force_left_out(model)
    missing = {
        channel: FORCE_LEFT_OUT.format(what)
        for channel, (index, _) in record.sensors.items()
        if what and model.sensor_type[index] in INTERACTION_SENSORS
    }
    for channel in missing:
        del record.sensors[channel]
    return missing


def interaction_indices(record: Recorder) -> list[int]:
    """Indices in ``sensordata`` of the sensors of forces and moments between bodies."""
    model, found = record.model, set[int]()
    for index, _ in record.sensors.values():
        if model.sensor_type[index] in INTERACTION_SENSORS:
            first = int(model.sensor_adr[index])
            found.update(range(first, first + int(model.sensor_dim[index])))
    return sorted(found)


def drive_sensors(
    model: mujoco.MjModel, linkage: Linkage, record: Recorder
) -> dict[str, tuple[int, float]]:
    """Channels of the force sensors of driven joints, with the number of the drive and the gear."""
    dofs, found = linkage.dofs.tolist(), {}
    for channel, (index, _) in record.sensors.items():
        if model.sensor_type[index] not in MOMENT_SENSORS:
            continue
        on_actuator = model.sensor_type[index] == MOMENT_SENSORS[0]
        place = model.sensor_objid[index]
        joint = joint_of(model, place) if on_actuator else place
        if joint >= 0 and model.jnt_dofadr[joint] in dofs:
            gear = gear_of_force(model, place) if on_actuator else 1.0
            found[channel] = dofs.index(model.jnt_dofadr[joint]), gear
    return found


def drive_moment_curves(
    model: mujoco.MjModel, linkage: Linkage, record: Recorder, moments: Array
) -> dict[str, Array]:
    """Curves for the force sensors of the driven joints, from holding moments (n, drives)."""
    return {
        channel: moments[:, drive] / gear
        for channel, (drive, gear) in drive_sensors(model, linkage, record).items()
    }


def withhold_drives(model: mujoco.MjModel, linkage: Linkage, record: Recorder) -> dict[str, str]:
    """Take the channels out of a record that flywheels falsify; returns them with the reasons."""
    missing = {
        channel: NO_MOMENT
        for channel, (drive, _) in drive_sensors(model, linkage, record).items()
        if model.dof_frictionloss[linkage.dofs[drive]]
        or model.dof_dampingpoly[linkage.dofs[drive]].any()
        or model.tendon_armature.any()
        or model.actuator_armature.any()
    }
    if linkage.joints:
        missing |= {
            channel: NO_ENERGY
            for channel, (index, _) in record.sensors.items()
            if model.sensor_type[index] == S.mjSENS_E_KINETIC
        }
    for channel in missing:
        del record.sensors[channel]
    return missing
