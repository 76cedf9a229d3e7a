"""Sensors of the MJCF as functions of the engine's poses, and their first two time derivatives."""

from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np

from sim.mujoco_model import gear_of_force, joint_of
from sim.protocol import Array, BadModel
from sim.pymunk_links import Links
from sim.pymunk_pose import along, joint_value, turned

S, OBJ = mujoco.mjtSensor, mujoco.mjtObj
ORDER = {S.mjSENS_FRAMEPOS: 0, S.mjSENS_FRAMELINVEL: 1, S.mjSENS_FRAMELINACC: 2,
         S.mjSENS_FRAMEXAXIS: 0, S.mjSENS_FRAMEANGVEL: 1, S.mjSENS_FRAMEANGACC: 2}
FORCES = (S.mjSENS_ACTUATORFRC, S.mjSENS_JOINTACTFRC)
Pose = Callable[[Array], Array]


@dataclass(frozen=True)
class Channel:
    """One channel: a function of the pose and how often to differentiate it by time.

    ``order`` is 0, 1 or 2; -1 stands for the kinetic energy and -2 for the effort of a drive,
    given by its place among the drives, which `factor` turns into the sensor's.
    """

    order: int
    function: Pose
    drive: int = 0
    factor: float = 1.0


def _still(pose: Array) -> Array:
    return np.zeros(pose.shape[:-2])


def channel(links: Links, name: str) -> Channel | str:
    """Find what a channel name means.

    Parameters
    ----------
    links : Links
    name : str
        ``sensor``, ``sensor.x``, ``.y``, ``.z`` or ``sensor.angle``.

    Returns
    -------
    Channel, or str
        The reason why pymunk cannot deliver it.

    Raises
    ------
    BadModel
        No such sensor, or no such component of it.
    """
    model = links.model
    sensor, _, part = name.partition(".")
    names = [model.sensor(i).name for i in range(model.nsensor)]
    if sensor not in names:
        raise BadModel(f"no sensor '{sensor}' for channel '{name}'; "
                       f"the model has {', '.join(names) or 'none'}")
    s = names.index(sensor)
    kind, wide = S(int(model.sensor_type[s])), model.sensor_dim[s] > 1
    if part not in (("x", "y", "z", "angle") if wide else ("",)) or (
            part == "angle" and kind != S.mjSENS_FRAMEXAXIS):
        parts = f"{sensor}.x, .y, .z, or .angle of a framexaxis" if wide else sensor
        raise BadModel(f"no channel '{name}'; use {parts}")
    if model.sensor_reftype[s] != OBJ.mjOBJ_UNKNOWN:
        return "a sensor with a reference frame is not rebuilt for pymunk"
    if kind in ORDER:
        return Channel(ORDER[kind], _frame(links, s, part))
    return _scalar(links, s)


def _scalar(links: Links, s: int) -> Channel | str:
    model, obj = links.model, links.model.sensor_objid[s]
    kind = S(int(model.sensor_type[s]))
    user = kind == S.mjSENS_USER and model.sensor_objtype[s] == OBJ.mjOBJ_JOINT
    if kind in (S.mjSENS_JOINTPOS, S.mjSENS_JOINTVEL) or user:
        order = {S.mjSENS_JOINTPOS: 0, S.mjSENS_JOINTVEL: 1}.get(kind, 2)
        return Channel(order, lambda pose: joint_value(links.joints[obj], pose))
    if kind == S.mjSENS_E_POTENTIAL:
        return Channel(0, lambda pose: _potential(links, pose))
    if kind == S.mjSENS_E_KINETIC:
        return Channel(-1, _still)
    if kind in FORCES:
        return _force(links, kind, obj)
    return f"sensor type {kind.name[7:].lower()} is not rebuilt for pymunk"


def _force(links: Links, kind: mujoco.mjtSensor, obj: int) -> Channel:
    """What a joint's drive must do, or the constant force of the motors on a joint without one."""
    model, of_joint = links.model, kind == S.mjSENS_JOINTACTFRC
    joint = obj if of_joint else joint_of(model, obj)
    if joint in links.driven:
        gear = 1.0 if of_joint else gear_of_force(model, obj)
        return Channel(-2, _still, links.driven.index(joint), 1.0 / gear)
    force = links.joints[joint].load if of_joint else float(
        links.data.actuator_force[model.actuator_outadr[obj]])
    return Channel(0, lambda pose: np.full(pose.shape[:-2], force))


def _frame(links: Links, s: int, part: str) -> Pose:
    link, local, height, turn = _frame_at(links, s)
    plane, kind = links.plane, S(int(links.model.sensor_type[s]))
    if part == "angle":
        start = np.arctan2(*plane.flat(turn[:, 0])[::-1])
        return lambda pose: start + pose[..., link, 2]
    k = "xyz".index(part)
    if kind in (S.mjSENS_FRAMEANGVEL, S.mjSENS_FRAMEANGACC):
        return lambda pose: pose[..., link, 2] * plane.normal[k]
    if kind == S.mjSENS_FRAMEXAXIS:
        axis, up = plane.flat(turn[:, 0]), float(turn[:, 0] @ plane.normal)
        return lambda pose: plane.world(turned(pose[..., link, 2], axis), up)[..., k]
    return lambda pose: plane.world(
        pose[..., link, :2] + turned(pose[..., link, 2], local), height)[..., k]


def _frame_at(links: Links, s: int) -> tuple[int, Array, float, Array]:
    """Link, point on it, height over the plane and orientation of a sensor's object."""
    model, data, obj = links.model, links.data, links.model.sensor_objid[s]
    place = {OBJ.mjOBJ_SITE: (model.site_bodyid, data.site_xpos, data.site_xmat),
             OBJ.mjOBJ_GEOM: (model.geom_bodyid, data.geom_xpos, data.geom_xmat),
             OBJ.mjOBJ_BODY: (np.arange(model.nbody), data.xipos, data.ximat),
             OBJ.mjOBJ_XBODY: (np.arange(model.nbody), data.xpos, data.xmat)}
    kind = OBJ(int(model.sensor_objtype[s]))
    if kind not in place:
        raise BadModel(f"sensor '{model.sensor(s).name}': object type {kind.name[6:].lower()}")
    bodies, points, turns = place[kind]
    link, point = links.of_body[bodies[obj]], points[obj]
    local = links.plane.flat(point) - links.centre[link]
    return link, local, float(point @ links.plane.normal), turns[obj].reshape(3, 3)


def _potential(links: Links, pose: Array) -> Array:
    """MuJoCo's potential energy: -m g.r of every body, plus the joint springs."""
    model, plane = links.model, links.plane
    energy = np.zeros(pose.shape[:-2])
    for b in range(1, model.nbody):
        link, point = links.of_body[b], links.data.xipos[b]
        local = plane.flat(point) - links.centre[link]
        at = plane.world(pose[..., link, :2] + turned(pose[..., link, 2], local),
                         float(point @ plane.normal))
        energy = energy - model.body_mass[b] * (at @ model.opt.gravity)
    for joint in links.joints:
        energy = energy + joint.spring_energy(joint_value(joint, pose))
    return energy


def kinetic(links: Links, velocity: Array) -> Array:
    """Kinetic energy [J] (...) of velocities (..., links + 1, 3)."""
    return 0.5 * ((velocity[..., :-1, :2] ** 2).sum(-1) @ links.mass
                  + velocity[..., :-1, 2] ** 2 @ links.moment)


def moving(function: Pose, order: int, pose: Array, before: Array, after: Array,
           dt: float) -> Array:
    """A function of the pose, or its rate or acceleration, from velocities half a step away.

    Second order in dt at every sample: Chipmunk's velocity belongs to the interval between two
    poses, ``pose(t + dt) = pose(t) + dt after``.

    Parameters
    ----------
    function : callable
        Of poses (..., links + 1, 3).
    order : {0, 1, 2}
    pose, before, after : ndarray (..., links + 1, 3)
        Pose at the sample, velocity over the step before it and over the step after it.
    dt : float
        Time step [s].
    """
    if order == 0:
        return function(pose)
    late = along(function, pose + 0.5 * dt * after, after)
    early = along(function, pose - 0.5 * dt * before, before)
    return 0.5 * (early + late) if order == 1 else (late - early) / dt


def unwrapped(name: str, curve: Array) -> Array:
    """An angle shifted by whole turns so that it starts within (-pi, pi]."""
    if not name.endswith(".angle"):
        return curve
    return curve - 2 * np.pi * np.ceil(curve[0] / (2 * np.pi) - 0.5)
