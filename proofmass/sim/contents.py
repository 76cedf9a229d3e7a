"""Contents of a compiled MJCF: names, units of channels, anchors of loops, size and mass."""

from collections.abc import Iterable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass

import mujoco
import numpy as np

from proofmass.base.arrays import Array
from proofmass.base.read_once import read_once
from proofmass.sim.dense import mass_matrix
from proofmass.sim.plane import PARALLEL_TOLERANCE, MotionPlane, find_plane
from proofmass.sim.protocol.curves import split_channel
from proofmass.sim.protocol.failures import BadModel, Unsupported
from proofmass.sim.protocol.run import Rod
from proofmass.sim.rods import format_rod_parts, rod_parts

INDEPENDENT_SHARE = 1e-4
"""Least part of an equality, as a share of its size, that is independent of the others: a start
pose whose loops are closed to five digits makes redundant ones seem independent by less."""
ZERO_FORCE_SHARE = 1e-12
"""Largest moment that counts as none, as a share of the weight at an arm of the model's extent."""
S, OBJ = mujoco.mjtSensor, mujoco.mjtObj
SENSOR_UNITS = {
    S.mjSENS_FRAMEPOS: "m",
    S.mjSENS_FRAMELINVEL: "m/s",
    S.mjSENS_FRAMELINACC: "m/s^2",
    S.mjSENS_FRAMEANGVEL: "rad/s",
    S.mjSENS_FRAMEANGACC: "rad/s^2",
    S.mjSENS_FRAMEQUAT: "1",
    S.mjSENS_BALLQUAT: "1",
    S.mjSENS_BALLANGVEL: "rad/s",
    S.mjSENS_FRAMEXAXIS: "1",
    S.mjSENS_FRAMEYAXIS: "1",
    S.mjSENS_FRAMEZAXIS: "1",
    S.mjSENS_ACCELEROMETER: "m/s^2",
    S.mjSENS_VELOCIMETER: "m/s",
    S.mjSENS_GYRO: "rad/s",
    S.mjSENS_FORCE: "N",
    S.mjSENS_TORQUE: "N m",
    S.mjSENS_SUBTREECOM: "m",
    S.mjSENS_SUBTREELINVEL: "m/s",
    S.mjSENS_SUBTREEANGMOM: "kg m^2/s",
    S.mjSENS_E_KINETIC: "J",
    S.mjSENS_E_POTENTIAL: "J",
    S.mjSENS_CLOCK: "s",
}
JOINT_SENSOR_UNITS = {
    S.mjSENS_JOINTPOS: "{}",
    S.mjSENS_JOINTLIMITPOS: "{}",
    S.mjSENS_JOINTVEL: "{}/s",
    S.mjSENS_JOINTLIMITVEL: "{}/s",
    S.mjSENS_USER: "{}/s^2",
}
TENDON_SENSOR_UNITS = {S.mjSENS_TENDONPOS: "m", S.mjSENS_TENDONVEL: "m/s"}
JOINT_FORCE_SENSORS = (S.mjSENS_JOINTACTFRC, S.mjSENS_JOINTLIMITFRC)
PLACE_SENSORS = (
    S.mjSENS_FRAMEPOS,
    S.mjSENS_FRAMEQUAT,
    S.mjSENS_FRAMEXAXIS,
    S.mjSENS_FRAMEYAXIS,
    S.mjSENS_FRAMEZAXIS,
    S.mjSENS_BALLQUAT,
    S.mjSENS_JOINTPOS,
    S.mjSENS_TENDONPOS,
    S.mjSENS_SUBTREECOM,
)
NO_ANGLE = (
    "the x axis is normal to the plane of motion and has no angle in it; "
    "measure a site whose x axis lies in the plane"
)
SCALAR_JOINT_UNITS = {mujoco.mjtJoint.mjJNT_HINGE: "rad", mujoco.mjtJoint.mjJNT_SLIDE: "m"}


def joints(model: mujoco.MjModel) -> dict[str, str | None]:
    """The joints by name and their units: rad of a hinge, m of a slide, None of another."""
    kinds = (mujoco.mjtJoint(int(kind)) for kind in model.jnt_type)
    return {model.joint(j).name: SCALAR_JOINT_UNITS.get(kind) for j, kind in enumerate(kinds)}


def key_names(model: mujoco.MjModel) -> list[str]:
    """The names of the keyframes."""
    return [model.key(k).name for k in range(model.nkey)]


def find_id(model: mujoco.MjModel, kind: int, word: str, name: str) -> int:
    """The id of a named element; if there is none, an error lists the names in the model."""
    index = mujoco.mj_name2id(model, kind, name)
    if index < 0:
        count = {
            OBJ.mjOBJ_JOINT: model.njnt,
            OBJ.mjOBJ_KEY: model.nkey,
            OBJ.mjOBJ_SENSOR: model.nsensor,
        }[kind]
        names = [mujoco.mj_id2name(model, kind, i) for i in range(count)]
        raise BadModel(f"no <{word}> named {name!r}; there are: {', '.join(map(str, names))}")
    return index


@read_once(None)
def sensor_names(model: mujoco.MjModel) -> tuple[str, ...]:
    """The names of the sensors."""
    return tuple(model.sensor(s).name for s in range(model.nsensor))


def place_sensors(model: mujoco.MjModel) -> list[str]:
    """The names of the sensors of positions and orientations."""
    every = (model.sensor(s).name for s in range(model.nsensor))
    return [
        name
        for name, kind in zip(every, model.sensor_type, strict=True)
        if S(kind) in PLACE_SENSORS
    ]


def sensors_of_drive(model: mujoco.MjModel, joint: str) -> list[str]:
    """The names of the sensors whose curves are the motion of a joint: its position and its rate.

    A reference is evaluated at the actual motion of a driven joint, so that such a curve has no
    error.
    """
    number = model.joint(joint).id
    return [
        model.sensor(s).name
        for s in np.flatnonzero(model.sensor_objid == number)
        if S(int(model.sensor_type[s])) in (S.mjSENS_JOINTPOS, S.mjSENS_JOINTVEL)
    ]


def mechanism_dof(model: mujoco.MjModel, key: str) -> int:
    """Degrees of freedom in the pose of a key: those of the joints less independent equalities."""
    model = copy(model)
    model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    data = pose_of_key(model, key)
    mujoco.mj_fwdPosition(model, data)
    rows = data.efc_J.reshape(-1, model.nv)[data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY]
    slides = model.jnt_type[model.dof_jntid] == mujoco.mjtJoint.mjJNT_SLIDE
    rows = rows * np.where(slides, model.stat.extent, 1.0)
    lengths = np.linalg.norm(rows, axis=1, keepdims=True)
    rows = np.divide(rows, lengths, out=np.zeros_like(rows), where=lengths > 0)
    rank = np.linalg.matrix_rank(rows, rtol=INDEPENDENT_SHARE) if rows.size else 0
    return model.nv - int(rank)


def moves_by_itself(model: mujoco.MjModel, key: str) -> bool:
    """Whether a model moves from the pose of a key, by its rates or by a force on its joints.

    Loops that the pose leaves open by its rounding do not count as forces.
    """
    data = pose_of_key(model, key)
    mujoco.mj_forward(model, data)
    weight = float(np.linalg.norm(model.opt.gravity)) * mass(model) * model.stat.extent
    forces = np.abs(data.qfrc_smooth) > ZERO_FORCE_SHARE * weight
    touches = data.efc_type > int(mujoco.mjtConstraint.mjCNSTR_FRICTION_TENDON)
    return bool(
        forces.any() or data.qvel.any() or data.act_dot.any() or data.efc_force[touches].any()
    )


def bodies_rotating_in_space(model: mujoco.MjModel) -> list[str]:
    """The names of the bodies on balls and free joints."""
    return [
        model.body(int(model.jnt_bodyid[j])).name
        for j in range(model.njnt)
        if mujoco.mjtJoint(int(model.jnt_type[j])) not in SCALAR_JOINT_UNITS
    ]


def channel_names(model: mujoco.MjModel, key: str) -> dict[str, list[str]]:
    """The channels of each sensor that describe a motion in the plane of a planar mechanism.

    For an x axis this is its angle, unless it is normal to the plane; for a linear vector its
    components in the plane, if two axes of the world span that plane; for an angular vector the
    component normal to it.  For a quaternion, and for all vectors of a mechanism that leaves every
    plane, these are all components.
    """
    found, across = {}, normal_axis(model, key)
    for s, name in enumerate(sensor_names(model)):
        kind = S(int(model.sensor_type[s]))
        if kind == S.mjSENS_FRAMEXAXIS and across is not None:
            found[name] = [] if has_normal_axis(model, key, s) else [f"{name}.angle"]
        elif model.sensor_dim[s] == 3:
            parts = {"linear": "xyz".replace(across or "-", ""), "angular": across or "xyz"}
            turns = SENSOR_UNITS.get(kind, "").startswith("rad") or kind == S.mjSENS_TORQUE
            found[name] = [f"{name}.{part}" for part in parts["angular" if turns else "linear"]]
        else:
            found[name] = [f"{name}.{part}".rstrip(".") for part in sensor_parts(model, s)]
    return found


def sensor_parts(model: mujoco.MjModel, s: int) -> tuple[str, ...]:
    """The parts of sensor number s: of a vector, of a quaternion, or "" for a single number.

    A sensor with more numbers has none.
    """
    return {1: ("",), 3: ("x", "y", "z"), 4: ("w", "x", "y", "z")}.get(int(model.sensor_dim[s]), ())


def normal_axis(model: mujoco.MjModel, key: str) -> str | None:
    """The axis of the world, x, y or z, that is normal to the plane of a mechanism.

    The result is empty if the plane is inclined, None if the mechanism leaves every plane.
    """
    try:
        normal = np.abs(start_plane(model, key).normal) if model.njnt else np.zeros(3)
    except Unsupported:
        return None
    return "xyz"[int(normal.argmax())] if normal.max() > 1 - PARALLEL_TOLERANCE else ""


@read_once(None)
def start_plane(model: mujoco.MjModel, key: str) -> MotionPlane:
    """The plane of motion in the pose of a key, see `find_plane`."""
    return find_plane(model, pose_of_key(model, key))


@read_once(None)
def start_places(model: mujoco.MjModel, key: str) -> Array:
    """The numbers of the sensors of positions and orientations in the pose of a key [SI]."""
    data = pose_of_key(model, key)
    mujoco.mj_comPos(model, data)
    mujoco.mj_sensorPos(model, data)
    return data.sensordata.copy()


def has_normal_axis(model: mujoco.MjModel, key: str, s: int) -> bool:
    """Whether the x axis of sensor number s is normal to the plane of motion: it has no angle."""
    first = int(model.sensor_adr[s])
    try:
        flat = start_plane(model, key).flat(start_places(model, key)[first : first + 3])
    except Unsupported:
        return False
    return float(np.linalg.norm(flat)) < PARALLEL_TOLERANCE


def has_no_angle(model: mujoco.MjModel, key: str, channel: str) -> bool:
    """Whether a name is that of the angle of an x axis that is normal to the plane of motion."""
    names = sensor_names(model)
    sensor, part = split_channel(channel, names)
    return (
        part == "angle"
        and sensor in names
        and S(int(model.sensor_type[names.index(sensor)])) == S.mjSENS_FRAMEXAXIS
        and has_normal_axis(model, key, names.index(sensor))
    )


def pose_of_key(model: mujoco.MjModel, key: str) -> mujoco.MjData:
    """The kinematics of the pose of a key, or of the initial pose if there is no such key."""
    data = mujoco.MjData(model)
    if key in key_names(model):
        mujoco.mj_resetDataKeyframe(model, data, key_names(model).index(key))
    mujoco.mj_kinematics(model, data)
    return data


def measures_actuator(model: mujoco.MjModel, sensor: str) -> bool:
    """Whether a sensor measures the force of an actuator, which may be the moment of a drive."""
    return S(int(model.sensor_type[sensor_names(model).index(sensor)])) == S.mjSENS_ACTUATORFRC


def channel_unit(model: mujoco.MjModel, channel: str, rods: Sequence[Rod] = ()) -> str | None:
    """The SI unit of a channel.

    Returns
    -------
    str or None
        None if MJCF does not determine it: for a ``user`` sensor that is not on a joint, and for
        the force of an actuator with a gear, which may be a length.

    Raises
    ------
    BadModel
        The sensor, or the rod, has no such part; or the gear of the sensor's actuator is 0.
    KeyError
        There is no such sensor and no such rod.
    """
    name, part = split_channel(channel, [*sensor_names(model), *(rod.name for rod in rods)])
    for rod in rods:
        if rod.name == name:
            if part not in rod_parts(rod):
                raise BadModel(f"a rod has {format_rod_parts(rod)}, along its length")
            return rod_parts(rod)[part]
    s = sensor_names(model).index(name) if name in sensor_names(model) else -1
    if s < 0:
        raise KeyError(name)
    kind = S(int(model.sensor_type[s]))
    directed = kind == S.mjSENS_FRAMEXAXIS
    if part not in (*sensor_parts(model, s), *["angle"] * directed):
        raise BadModel(f"the sensor has no such part; use {format_parts(model, s)}")
    return "rad" if part == "angle" else SENSOR_UNITS.get(kind) or joint_sensor_unit(model, s, kind)


def format_parts(model: mujoco.MjModel, s: int) -> str:
    """The channels of sensor number s, as a phrase for messages."""
    name, parts = model.sensor(s).name, sensor_parts(model, s)
    if len(parts) < 2:
        return str(name)
    angle = ", or .angle" * (S(int(model.sensor_type[s])) == S.mjSENS_FRAMEXAXIS)
    first = ", ".join([f"{name}.{parts[0]}", *(f".{part}" for part in parts[1:-1])])
    return f"{first} or .{parts[-1]}{angle}"


def find_channel(model: mujoco.MjModel, name: str) -> tuple[int, str]:
    """The number of the sensor of a channel in a plane, and the part of it that the channel is.

    Raises
    ------
    BadModel
        There is no such sensor, or no such part of it.
    """
    names = sensor_names(model)
    sensor, part = split_channel(name, names)
    if sensor not in names:
        raise BadModel(
            f"no sensor '{sensor}' for channel '{name}'; the model has {', '.join(names) or 'none'}"
        )
    s = names.index(sensor)
    angle = ("angle",) if S(int(model.sensor_type[s])) == S.mjSENS_FRAMEXAXIS else ()
    if part not in (*sensor_parts(model, s), *angle):
        raise BadModel(f"no channel '{name}'; use {format_parts(model, s)}")
    return s, part


FRAME_FIELDS = {
    OBJ.mjOBJ_SITE: ("site_xpos", "site_xmat", "site_bodyid"),
    OBJ.mjOBJ_GEOM: ("geom_xpos", "geom_xmat", "geom_bodyid"),
    OBJ.mjOBJ_BODY: ("xipos", "ximat", ""),
    OBJ.mjOBJ_XBODY: ("xpos", "xmat", ""),
}
"""By type of an object its position and orientation in a state, and its body in the model."""


@dataclass(frozen=True)
class MeasuredFrame:
    """The frame of an object that a sensor measures: its type, its number, and its body."""

    of: mujoco.mjtObj
    number: int
    body: int

    def place(self, data: mujoco.MjData) -> Array:
        """Its position (3,) in a state [m]."""
        return np.asarray(getattr(data, FRAME_FIELDS[self.of][0])[self.number])

    def axes(self, data: mujoco.MjData) -> Array:
        """Its axes in a state, columns of a matrix (3, 3) [1]."""
        return np.asarray(getattr(data, FRAME_FIELDS[self.of][1])[self.number].reshape(3, 3))


def sensor_frame(model: mujoco.MjModel, s: int) -> MeasuredFrame | None:
    """The frame of the object of sensor number s; None for an object without a frame."""
    of, number = OBJ(int(model.sensor_objtype[s])), int(model.sensor_objid[s])
    if of not in FRAME_FIELDS:
        return None
    bodies = FRAME_FIELDS[of][2]
    return MeasuredFrame(of, number, int(getattr(model, bodies)[number]) if bodies else number)


def joint_sensor_unit(model: mujoco.MjModel, s: int, kind: mujoco.mjtSensor) -> str | None:
    """The SI unit of sensor number s if it is on a joint, its actuator, or a straight tendon."""
    joint, force = int(model.sensor_objid[s]), kind in JOINT_FORCE_SENSORS
    if kind in TENDON_SENSOR_UNITS and straight_tendon(model, joint):
        return TENDON_SENSOR_UNITS[kind]
    if kind == S.mjSENS_ACTUATORFRC:
        force, actuator = True, joint
        joint = joint_of(model, actuator)
        if joint >= 0 and abs(gear_of_force(model, actuator)) != 1:
            return None
    elif not (force or kind in JOINT_SENSOR_UNITS) or (
        kind == S.mjSENS_USER and model.sensor_objtype[s] != OBJ.mjOBJ_JOINT
    ):
        return None
    unit = (
        SCALAR_JOINT_UNITS.get(mujoco.mjtJoint(int(model.jnt_type[joint]))) if joint >= 0 else None
    )
    if unit is None:
        return None
    return {"rad": "N m", "m": "N"}[unit] if force else JOINT_SENSOR_UNITS[kind].format(unit)


@read_once(None)
def size(model: mujoco.MjModel, key: str) -> float:
    """Largest distance between joints, sites and centres of mass in the pose of a key [m]."""
    data = pose_of_key(model, key)
    points = np.vstack([data.xanchor, data.site_xpos, data.xipos[1:]])
    return float(np.linalg.norm(points[:, None] - points, axis=-1).max()) if len(points) else 0.0


@read_once(None)
def mass(model: mujoco.MjModel) -> float:
    """Mass of all bodies that can move [kg]."""
    return float(model.body_mass[model.body_weldid != 0].sum())


def may_touch(model: mujoco.MjModel) -> bool:
    """Whether contacts may arise, between geoms of two bodies or in a pair that the model names."""
    off = mujoco.mjtDisableBit
    if model.opt.disableflags & int(off.mjDSBL_CONTACT | off.mjDSBL_CONSTRAINT):
        return False
    touchable = model.geom_bodyid[(model.geom_contype | model.geom_conaffinity) > 0]
    return bool(model.npair or np.unique(touchable).size > 1)


def has_dry_friction(model: mujoco.MjModel) -> bool:
    """Whether joints or tendons have dry friction."""
    off = mujoco.mjtDisableBit
    return not model.opt.disableflags & int(off.mjDSBL_FRICTIONLOSS | off.mjDSBL_CONSTRAINT) and (
        bool(model.dof_frictionloss.any() or model.tendon_frictionloss.any())
    )


def joint_of(model: mujoco.MjModel, actuator: int) -> int:
    """The joint that an actuator acts on, or -1."""
    on_joint = (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT)
    found = int(model.actuator_trntype[actuator]) in on_joint
    return int(model.actuator_trnid[actuator, 0]) if found else -1


def control_indices(model: mujoco.MjModel, actuators: Iterable[str]) -> list[int]:
    """Indices in ``ctrl`` of the controls of some actuators."""
    return [int(model.actuator_ctrladr[model.actuator(name).id]) for name in actuators]


def is_linear_in_joint(model: mujoco.MjModel, a: int) -> bool:
    """Whether an actuator on a joint has a force that is linear in the joint's value and rate."""
    affine = model.actuator_biastype[a] == mujoco.mjtBias.mjBIAS_AFFINE
    return joint_of(model, a) >= 0 and bool(affine)


def is_disabled(model: mujoco.MjModel, actuator: int) -> bool:
    """Whether a flag of the model, or the group of an actuator, disables it."""
    off = model.opt.disableactuator & 1 << int(model.actuator_group[actuator])
    return bool(off or model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_ACTUATION))


def actuators_on(model: mujoco.MjModel, joint: int) -> list[int]:
    """Numbers of the actuators that act on a joint and are not disabled."""
    return [
        a
        for a in range(model.nactuator)
        if joint_of(model, a) == joint and not is_disabled(model, a)
    ]


def why_not_motor(model: mujoco.MjModel, actuator: int) -> str:
    """Why an actuator is not a motor, whose force is its control times a number; empty if it is.

    The control of a motor may have a range.
    """
    if (
        model.actuator_gaintype[actuator] != mujoco.mjtGain.mjGAIN_FIXED
        or model.actuator_biastype[actuator] != mujoco.mjtBias.mjBIAS_NONE
        or model.actuator_dyntype[actuator] != mujoco.mjtDyn.mjDYN_NONE
    ):
        return "is no motor: its force is not its control times a number"
    joint = joint_of(model, actuator)
    if is_disabled(model, actuator):
        return "is disabled in the model"
    if model.actuator_forcelimited[actuator] or (joint >= 0 and model.jnt_actfrclimited[joint]):
        return "has a range of forces; leave it out, or give it a range of controls"
    if joint < 0 and int(model.actuator_trntype[actuator]) != mujoco.mjtTrn.mjTRN_SITE:
        return "acts neither on a joint nor at a site"
    return ""


def why_not_linear_in_control(model: mujoco.MjModel, actuator: int) -> str:
    """Why the force of an actuator is not linear in its control; empty if it is.

    The control may have a range.
    """
    affine = mujoco.mjtBias.mjBIAS_NONE, mujoco.mjtBias.mjBIAS_AFFINE
    if (
        model.actuator_gaintype[actuator] != mujoco.mjtGain.mjGAIN_FIXED
        or mujoco.mjtBias(int(model.actuator_biastype[actuator])) not in affine
        or model.actuator_dyntype[actuator] != mujoco.mjtDyn.mjDYN_NONE
    ):
        return "is no motor and no servo: its force is not linear in its control"
    return "is disabled in the model" if is_disabled(model, actuator) else ""


def gear_of(model: mujoco.MjModel, actuator: int) -> Array:
    """Gear (6,) of an actuator; if it has several outputs, that of the first."""
    return np.asarray(model.actuator_gear[model.actuator_outadr[actuator]])


def gear_of_force(model: mujoco.MjModel, actuator: int) -> float:
    """Gear of an actuator on a joint: the ratio of the joint's moment to the actuator's force.

    Raises
    ------
    BadModel
        The gear is 0, so that no force of the actuator gives the joint's moment.
    """
    if not (gear := float(gear_of(model, actuator)[0])):
        raise BadModel(
            f"the gear of actuator {model.actuator(actuator).name!r} is 0 in the MJCF, "
            f"so that its force does not act on its joint; give another, such as 1"
        )
    return gear


def straight_tendon(model: mujoco.MjModel, tendon: int) -> tuple[int, int] | None:
    """The two sites of a tendon that goes straight between them; None for any other tendon."""
    first, count = int(model.tendon_adr[tendon]), int(model.tendon_num[tendon])
    kinds = model.wrap_type[first : first + count]
    if count != 2 or (kinds != mujoco.mjtWrap.mjWRAP_SITE).any():
        return None
    one, two = model.wrap_objid[first : first + 2]
    return int(one), int(two)


def active_connects(model: mujoco.MjModel) -> list[int]:
    """Numbers of the ``connect`` equalities that are active at the start."""
    kind = model.eq_type == mujoco.mjtEq.mjEQ_CONNECT
    return np.flatnonzero(kind & model.eq_active0.astype(bool)).tolist()


def anchors(model: mujoco.MjModel, i: int, pose: Mapping[str, Array]) -> tuple[Array, Array]:
    """Positions in the world of the two points that ``connect`` number i constrains to coincide.

    `pose` has ``site_xpos``, ``xpos`` and ``xmat`` of one pose, or of many along the first axis.
    """
    if model.eq_objtype[i] == mujoco.mjtObj.mjOBJ_SITE:
        places = pose["site_xpos"]
        return places[..., model.eq_obj1id[i], :], places[..., model.eq_obj2id[i], :]
    one, two = (
        pose["xpos"][..., b, :]
        + (pose["xmat"][..., b, :].reshape(-1, 3, 3) @ p).reshape(pose["xpos"][..., b, :].shape)
        for b, p in (
            (model.eq_obj1id[i], model.eq_data[i, 0:3]),
            (model.eq_obj2id[i], model.eq_data[i, 3:6]),
        )
    )
    return one, two


def anchor_bodies(model: mujoco.MjModel, i: int) -> tuple[int, int]:
    """The bodies that equality number i joins, a ``connect`` or a ``weld``."""
    pair = model.eq_obj1id[i], model.eq_obj2id[i]
    if model.eq_objtype[i] == mujoco.mjtObj.mjOBJ_SITE:
        return int(model.site_bodyid[pair[0]]), int(model.site_bodyid[pair[1]])
    return int(pair[0]), int(pair[1])


def pose_of(data: mujoco.MjData) -> dict[str, Array]:
    """The present pose in the form that `anchors` takes."""
    return {"site_xpos": data.site_xpos, "xpos": data.xpos, "xmat": data.xmat}


def highest_frequency(model: mujoco.MjModel, key: str) -> float:
    """The highest natural frequency on the springs of the joints in a start pose [rad/s].

    It is 0 without springs, and for models with loops, which would lower it.
    """
    stiffness = model.jnt_stiffness
    on_one = np.isin(model.jnt_type, (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE))
    if model.neq or not (stiffness * on_one > 0).any():
        return 0.0
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key(key).id)
    mujoco.mj_forward(model, data)
    inertia, springs = mass_matrix(model, data), np.zeros(model.nv)
    springs[model.jnt_dofadr[on_one]] = stiffness[on_one]
    squares = np.linalg.eigvals(np.linalg.solve(inertia, np.diag(springs)))
    return float(np.sqrt(squares.real.max(initial=0.0)))


def force_left_out(model: mujoco.MjModel) -> str:
    """What MuJoCo's sensors of forces between bodies leave out of a model; empty if nothing."""
    others = [k for k in range(model.nu) if joint_of(model, k) < 0]
    if others:
        return f"actuator {model.actuator(others[0]).name!r}, which acts on no joint"
    pulling = [t for t in range(model.ntendon) if exerts_force(model, t)]
    return f"tendon {model.tendon(pulling[0]).name!r}" if pulling else ""


def exerts_force(model: mujoco.MjModel, t: int) -> bool:
    """Whether tendon number t exerts forces, so that it does more than measure a length."""
    own = (
        model.tendon_stiffness,
        model.tendon_stiffnesspoly,
        model.tendon_damping,
        model.tendon_dampingpoly,
        model.tendon_frictionloss,
        model.tendon_armature,
        model.tendon_limited,
    )
    equalities = model.eq_active0.astype(bool) & (model.eq_type == mujoco.mjtEq.mjEQ_TENDON)
    is_in_equality = t in np.concatenate([model.eq_obj1id[equalities], model.eq_obj2id[equalities]])
    return is_in_equality or any(np.any(part[t]) for part in own)


def is_damped(model: mujoco.MjModel) -> bool:
    """Whether dampers, or servos whose forces depend on rates, act in a model."""
    servos = (a for a in range(model.nactuator) if is_linear_in_joint(model, a))
    return bool(
        model.dof_damping.any()
        or model.tendon_damping.any()
        or any(model.actuator_biasprm[a, 2] for a in servos)
    )
