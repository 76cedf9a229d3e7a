"""What the sensors of an MJCF read in a motion: the quantities of the reference `planar`."""

import mujoco
import numpy as np

from proofmass.analytic.numerics import Array, Complex
from proofmass.analytic.planar.dynamics import kinetic, potential
from proofmass.analytic.planar.kinematics import BodyMotion
from proofmass.analytic.planar.mechanism import Mechanism, Reader, rotation

S, OBJ = mujoco.mjtSensor, mujoco.mjtObj
PLACES = {S.mjSENS_FRAMEPOS: 0, S.mjSENS_FRAMELINVEL: 1, S.mjSENS_FRAMELINACC: 2}
TURNS = {S.mjSENS_FRAMEANGVEL: 1, S.mjSENS_FRAMEANGACC: 2}
FORCES = (S.mjSENS_ACTUATORFRC, S.mjSENS_JOINTACTFRC)


def quantities(
    reader: Reader,
    m: Mechanism,
    motion: BodyMotion,
    joint: tuple[Array, Array, Array],
    moments: dict[str, Array],
) -> dict[str, Array]:
    """Curves (n,) by channel name: ``sensor``, ``sensor.x``, ``.y``, ``.z``, ``sensor.angle``.

    Parameters
    ----------
    reader : Reader
        The compiled model, and its plane.
    m : Mechanism
    motion : BodyMotion
    joint : three ndarray (n, joints)
        Joint values, rates, accelerations [rad or m, per s, per s^2].
    moments : dict of str to ndarray (n,)
        Holding moment of each driven joint [N m or N].
    """
    found: dict[str, Array] = {}
    for s in range(reader.model.nsensor):
        name, kind = reader.model.sensor(s).name, S(reader.model.sensor_type[s])
        value: Array | None = None
        if kind in PLACES or kind in TURNS or kind == S.mjSENS_FRAMEXAXIS:
            found |= {f"{name}.{part}": curve for part, curve in frame(reader, motion, s).items()}
        elif kind in FORCES:
            value = effort(reader, m, s, moments)
        elif kind == S.mjSENS_E_POTENTIAL:
            value = potential(m, motion, joint[0])
        elif kind == S.mjSENS_E_KINETIC:
            value = kinetic(m, motion, joint[1])
        elif reader.model.sensor_objtype[s] == OBJ.mjOBJ_JOINT:
            order = {S.mjSENS_JOINTPOS: 0, S.mjSENS_JOINTVEL: 1, S.mjSENS_USER: 2}.get(kind)
            value = None if order is None else joint[order][:, reader.model.sensor_objid[s]]
        if value is not None:
            found[name] = value
    return found


def frame(reader: Reader, motion: BodyMotion, s: int) -> dict[str, Array]:
    """The parts of a sensor that reads a frame; none if it reads it in a moving one."""
    kind = S(reader.model.sensor_type[s])
    if reader.model.sensor_reftype[s] != OBJ.mjOBJ_UNKNOWN:
        return {}
    body, at, turn = seat(reader, s)
    if kind in TURNS:
        return spread(reader, np.zeros(1), motion.turn[TURNS[kind]][body])
    if kind in PLACES:
        order = PLACES[kind]
        flat = motion.point(body, reader.flat(at), order)
        return spread(reader, flat, np.zeros(1) if order else np.array([at @ reader.normal]))
    axis = turn[:, 0]
    angle = np.angle(reader.flat(axis)) + motion.turn[0][body]
    angle = angle - 2 * np.pi * np.ceil(angle[0] / (2 * np.pi) - 0.5)
    parts = spread(reader, motion.w[0][body] * reader.flat(axis), np.array([axis @ reader.normal]))
    return {**parts, "angle": angle}


def seat(reader: Reader, s: int) -> tuple[int, Array, Array]:
    """Body, place and orientation in the reference pose of the object that a sensor is on."""
    model, kind = reader.model, OBJ(reader.model.sensor_objtype[s])
    i = model.sensor_objid[s]
    body, at, quaternion = {
        OBJ.mjOBJ_SITE: lambda: (model.site_bodyid[i], model.site_pos[i], model.site_quat[i]),
        OBJ.mjOBJ_GEOM: lambda: (model.geom_bodyid[i], model.geom_pos[i], model.geom_quat[i]),
        OBJ.mjOBJ_BODY: lambda: (i, model.body_ipos[i], model.body_iquat[i]),
        OBJ.mjOBJ_XBODY: lambda: (i, np.zeros(3), np.array([1.0, 0, 0, 0])),
    }[kind]()
    return (
        int(body),
        reader.at[body] + reader.turn[body] @ at,
        reader.turn[body] @ rotation(quaternion),
    )


def spread(reader: Reader, flat: Complex | Array, up: Array) -> dict[str, Array]:
    """World components of what lies in the plane and along its normal."""
    return {
        part: reader.e1[k] * flat.real + reader.e2[k] * flat.imag + reader.normal[k] * up
        for k, part in enumerate("xyz")
    }


def effort(reader: Reader, m: Mechanism, s: int, moments: dict[str, Array]) -> Array | None:
    """A force sensor: the holding moment of a driven joint, the constant load of another."""
    model, i = reader.model, reader.model.sensor_objid[s]
    actuator = S(model.sensor_type[s]) == S.mjSENS_ACTUATORFRC
    joint = m.joints[model.actuator_trnid[i, 0] if actuator else i]
    moment = moments.get(joint.name, np.array([joint.load]))
    return moment / model.actuator_gear[i, 0] if actuator else moment
