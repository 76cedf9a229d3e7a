"""Sensors of the MJCF as functions of the links' poses, and their first two time derivatives."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from proofmass.base.arrays import Array
from proofmass.sim.contents import (
    find_channel,
    gear_of_force,
    is_linear_in_joint,
    joint_of,
    sensor_frame,
)
from proofmass.sim.plane import MotionPlane
from proofmass.sim.protocol.failures import BadModel
from proofmass.sim.pymunk.kinematics import derivative_along, joint_value, rotate, spring_length
from proofmass.sim.pymunk.links import LinkJoint, Links, LinkSpring
from proofmass.sim.pymunk.reactions import (
    Interaction,
    SampledMotion,
    bodies_carried_by,
    solve_forces,
    transmitted_force,
)

S, OBJ = mujoco.mjtSensor, mujoco.mjtObj
SENSOR_ORDERS = {
    S.mjSENS_FRAMEPOS: 0,
    S.mjSENS_FRAMELINVEL: 1,
    S.mjSENS_FRAMELINACC: 2,
    S.mjSENS_FRAMEXAXIS: 0,
    S.mjSENS_FRAMEANGVEL: 1,
    S.mjSENS_FRAMEANGACC: 2,
}
FORCE_SENSORS = (S.mjSENS_ACTUATORFRC, S.mjSENS_JOINTACTFRC)
INTERACTION_SENSORS = (S.mjSENS_FORCE, S.mjSENS_TORQUE)
PoseFunction = Callable[[Array], Array]


@dataclass(frozen=True)
class Sensor:
    """One channel: a function of the pose, and how often it is differentiated with respect to time.

    ``order`` is 0, 1 or 2 for a function and its derivatives, -1 for the kinetic energy, -2 for the
    force of a drive, and -3 for a force or moment between two bodies, given by an `Interaction`.
    For order -2, ``drive`` is the index of the drive, and ``factor`` the ratio of the channel to
    the drive's force.
    """

    order: int
    function: PoseFunction
    drive: int = 0
    factor: float = 1.0
    transmitted: Interaction | None = None


@dataclass(frozen=True)
class ConstantValue:
    """A function of the pose that is constant."""

    value: float = 0.0

    def __call__(self, pose: Array) -> Array:
        """The value in poses (..., links + 1, 3)."""
        return np.full(pose.shape[:-2], self.value)


@dataclass(frozen=True)
class LinkAngle:
    """An angle [rad] that depends on the rotation of a link: ``start + share * rotation``."""

    link: int
    start: float = 0.0
    share: float = 1.0

    def __call__(self, pose: Array) -> Array:
        """The angle [rad] in poses (..., links + 1, 3)."""
        return self.start + self.share * pose[..., self.link, 2]


@dataclass(frozen=True)
class PointPosition:
    """Component `part` of the world position [m] of a point of a link.

    ``local`` is the point relative to the link's centre in the start pose [m], ``height`` its
    coordinate along the plane's normal [m].
    """

    plane: MotionPlane
    link: int
    local: Array
    height: float
    part: int

    def __call__(self, pose: Array) -> Array:
        """The component [m] in poses (..., links + 1, 3)."""
        body = pose[..., self.link, :]
        flat = body[..., :2] + rotate(body[..., 2], self.local)
        return self.plane.world(flat, self.height)[..., self.part]


@dataclass(frozen=True)
class Direction:
    """Component `part` in the world of a unit vector that is fixed in a link.

    ``local`` are its components in the plane in the start pose, ``height`` its component along the
    plane's normal.
    """

    plane: MotionPlane
    link: int
    local: Array
    height: float
    part: int

    def __call__(self, pose: Array) -> Array:
        """The component [1] in poses (..., links + 1, 3)."""
        flat = rotate(pose[..., self.link, 2], self.local)
        return self.plane.world(flat, self.height)[..., self.part]


@dataclass(frozen=True)
class JointValue:
    """The coordinate of a joint [rad or m]."""

    joint: LinkJoint

    def __call__(self, pose: Array) -> Array:
        """The value [rad or m] in poses (..., links + 1, 3)."""
        return joint_value(self.joint, pose)


@dataclass(frozen=True)
class LinkSpringLength:
    """The length of a spring between points [m]."""

    spring: LinkSpring

    def __call__(self, pose: Array) -> Array:
        """The length [m] in poses (..., links + 1, 3)."""
        return spring_length(self.spring, pose)


@dataclass(frozen=True)
class Potential:
    """MuJoCo's potential energy [J]: -m g.r of every body, plus the springs."""

    links: Links

    def __call__(self, pose: Array) -> Array:
        """The energy [J] in poses (..., links + 1, 3)."""
        energy = np.zeros(pose.shape[:-2])
        for mass, place in body_masses(self.links):
            centre = np.stack([replace(place, part=k)(pose) for k in range(3)], axis=-1)
            energy = energy - mass * (centre @ self.links.model.opt.gravity)
        for joint in self.links.joints:
            energy = energy + joint.spring_energy(joint_value(joint, pose))
        for spring in self.links.springs:
            energy = energy + spring.energy(spring_length(spring, pose))
        return energy


def body_masses(links: Links) -> list[tuple[float, PointPosition]]:
    """Mass [kg] and centre of mass of every body of the MJCF except the world."""
    model, plane, found = links.model, links.plane, []
    for b in range(1, model.nbody):
        link, point = int(links.of_body[b]), links.data.xipos[b]
        found.append(
            (
                float(model.body_mass[b]),
                PointPosition(
                    plane,
                    link,
                    plane.flat(point) - links.centre[link],
                    float(point @ plane.normal),
                    0,
                ),
            )
        )
    return found


def read_channel(links: Links, name: str) -> Sensor | str:
    """The sensor that the name of a channel stands for, or why pymunk does not deliver it.

    Parameters
    ----------
    links : Links
    name : str
        ``sensor``, ``sensor.x``, ``.y``, ``.z`` or ``sensor.angle``.

    Returns
    -------
    Sensor, or str
        A str is the reason why pymunk cannot deliver the channel.

    Raises
    ------
    BadModel
        There is no such sensor, or no such component of it.
    """
    model = links.model
    s, part = find_channel(model, name)
    kind = S(int(model.sensor_type[s]))
    if model.sensor_reftype[s] != OBJ.mjOBJ_UNKNOWN:
        return "a sensor with a reference frame is not rebuilt for pymunk"
    if kind in SENSOR_ORDERS:
        return Sensor(SENSOR_ORDERS[kind], _frame_function(links, s, part))
    if kind in INTERACTION_SENSORS:
        return _interaction_sensor(links, s, "xyz".index(part))
    return _scalar_sensor(links, s)


def _scalar_sensor(links: Links, s: int) -> Sensor | str:
    """Sensor s of joints, tendons, energies or actuator forces, or why it is missing."""
    model, obj = links.model, links.model.sensor_objid[s]
    kind = S(int(model.sensor_type[s]))
    user = kind == S.mjSENS_USER and model.sensor_objtype[s] == OBJ.mjOBJ_JOINT
    if kind in (S.mjSENS_JOINTPOS, S.mjSENS_JOINTVEL) or user:
        order = {S.mjSENS_JOINTPOS: 0, S.mjSENS_JOINTVEL: 1}.get(kind, 2)
        return Sensor(order, JointValue(links.joints[obj]))
    if kind in (S.mjSENS_TENDONPOS, S.mjSENS_TENDONVEL):
        return Sensor(int(kind == S.mjSENS_TENDONVEL), LinkSpringLength(links.springs[obj]))
    if kind == S.mjSENS_E_POTENTIAL:
        return Sensor(0, Potential(links))
    if kind == S.mjSENS_E_KINETIC:
        return Sensor(-1, ConstantValue())
    if kind in FORCE_SENSORS:
        return _force_sensor(links, kind, obj)
    return f"sensor type {kind.name[7:].lower()} is not rebuilt for pymunk"


def _force_sensor(links: Links, kind: mujoco.mjtSensor, obj: int) -> Sensor | str:
    """The force of a joint's drive, or the constant force of motors on a joint without drive."""
    model, of_joint = links.model, kind == S.mjSENS_JOINTACTFRC
    joint = obj if of_joint else joint_of(model, obj)
    if joint in links.driven:
        gear = 1.0 if of_joint else gear_of_force(model, obj)
        return Sensor(-2, ConstantValue(), links.driven.index(joint), 1.0 / gear)
    servos = (a for a in range(model.nactuator) if joint_of(model, a) == joint)
    if joint >= 0 and any(is_linear_in_joint(model, a) for a in servos):
        return "the force of a servo is not rebuilt for pymunk"
    loaded = [pull.body for pull in links.pulls if pull.actuator >= 0]
    if of_joint and np.isin(loaded, bodies_carried_by(model, model.jnt_bodyid[joint])).any():
        return "what loads on sites do to a joint is not rebuilt for pymunk"
    force = links.joints[joint].load if of_joint else float(links.reader.actuator_force(obj)[0])
    return Sensor(0, ConstantValue(force))


def _interaction_sensor(links: Links, s: int, part: int) -> Sensor:
    """Component `part` of sensor s of the force or moment between a site's body and its parent."""
    link, local, _, turn = _sensor_frame(links, s)
    plane, axis = links.plane, turn[:, part]
    sensor = Interaction(
        int(links.model.site_bodyid[links.model.sensor_objid[s]]),
        link,
        local,
        plane.flat(axis),
        float(plane.normal @ axis),
        S(int(links.model.sensor_type[s])) == S.mjSENS_TORQUE,
    )
    return Sensor(-3, ConstantValue(), transmitted=sensor)


def force_curves(
    links: Links, channels: Mapping[str, Sensor], motion: SampledMotion
) -> dict[str, Array]:
    """Curves of those channels that show forces or moments, in a motion."""
    wanted = {name: c for name, c in channels.items() if c.order <= -2}
    if not wanted:
        return {}
    forces = solve_forces(links, motion)
    drives = forces[:, links.rows :]
    return {
        name: transmitted_force(links, c.transmitted, motion, forces)
        if c.transmitted
        else drives[:, c.drive] * c.factor
        for name, c in wanted.items()
    }


def _frame_function(links: Links, s: int, part: str) -> PoseFunction:
    """Component `part` of the position, direction or angle that belongs to frame sensor s."""
    link, local, height, turn = _sensor_frame(links, s)
    plane, kind = links.plane, S(int(links.model.sensor_type[s]))
    if part == "angle":
        return LinkAngle(link, float(np.arctan2(*plane.flat(turn[:, 0])[::-1])))
    k = "xyz".index(part)
    if kind in (S.mjSENS_FRAMEANGVEL, S.mjSENS_FRAMEANGACC):
        return LinkAngle(link, share=float(plane.normal[k]))
    if kind == S.mjSENS_FRAMEXAXIS:
        return Direction(plane, link, plane.flat(turn[:, 0]), float(turn[:, 0] @ plane.normal), k)
    return PointPosition(plane, link, local, height, k)


def _sensor_frame(links: Links, s: int) -> tuple[int, Array, float, Array]:
    """Link, point on it, height over the plane and orientation (3, 3) of the object of sensor s."""
    frame = sensor_frame(links.model, s)
    if frame is None:
        kind = OBJ(int(links.model.sensor_objtype[s])).name[6:].lower()
        raise BadModel(f"sensor '{links.model.sensor(s).name}': object type {kind}")
    link, point = links.of_body[frame.body], frame.place(links.data)
    local = links.plane.flat(point) - links.centre[link]
    return link, local, float(point @ links.plane.normal), frame.axes(links.data)


def kinetic_energy(links: Links, velocity: Array) -> Array:
    """Kinetic energy [J] (...) of velocities (..., links + 1, 3)."""
    return 0.5 * (
        (velocity[..., :-1, :2] ** 2).sum(-1) @ links.mass
        + velocity[..., :-1, 2] ** 2 @ links.moment
    )


def time_derivative(
    function: PoseFunction, order: int, pose: Array, before: Array, after: Array, dt: float
) -> Array:
    """A function of the pose, its rate or its acceleration, from velocities around a sample.

    The result is of second order in dt at every sample, since Chipmunk's velocity belongs to the
    interval between two poses, ``pose(t + dt) = pose(t) + dt after``.

    Parameters
    ----------
    function : callable
        Function of poses (..., links + 1, 3).
    order : {0, 1, 2}
        Order of the time derivative.
    pose, before, after : ndarray (..., links + 1, 3)
        Pose at the sample [m, m, rad], velocity over the step before it and over the step after
        it [m/s, m/s, rad/s].
    dt : float
        Time step [s].
    """
    if order == 0:
        return function(pose)
    late = derivative_along(function, pose + 0.5 * dt * after, after)
    early = derivative_along(function, pose - 0.5 * dt * before, before)
    return 0.5 * (early + late) if order == 1 else (late - early) / dt


def unwrap_angle(name: str, curve: Array) -> Array:
    """The curve of an angle channel, shifted by whole turns to start in (-pi, pi]; others as is."""
    if not name.endswith(".angle"):
        return curve
    return curve - 2 * np.pi * np.ceil(curve[0] / (2 * np.pi) - 0.5)
