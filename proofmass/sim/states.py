"""Curves of all channels from the states of the links of a mechanism at the samples."""

from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from proofmass.analytic.numerics import unwrap_quaternions
from proofmass.base.arrays import Array
from proofmass.sim.balance import ForceBalance
from proofmass.sim.contact_laws import find_pairs
from proofmass.sim.contents import (
    find_channel,
    force_left_out,
    gear_of_force,
    is_linear_in_joint,
    joint_of,
    sensor_frame,
    straight_tendon,
)
from proofmass.sim.interpreter.mechanism import LinkStates, NeutralMechanism, cubic_energy
from proofmass.sim.neutral import NeutralReader
from proofmass.sim.protocol.curves import Curves
from proofmass.sim.protocol.failures import Diverged, Unsupported
from proofmass.sim.rods import Chain, RodPose, rod_channels, rod_curves

S, OBJ = mujoco.mjtSensor, mujoco.mjtObj
MAX_OPENING_SHARE = 0.1
"""Opening of a loop or a joint, as a share of the size, beyond which a run has failed."""
RANGE_ROUNDING = 1e-6
"""Distance by which a joint may pass the end of its range [rad or m], since it may end on it."""
POINT_SENSORS = {S.mjSENS_FRAMEPOS: 0, S.mjSENS_FRAMELINVEL: 1, S.mjSENS_FRAMELINACC: 2}
AXIS_SENSORS = {S.mjSENS_FRAMEXAXIS: 0, S.mjSENS_FRAMEYAXIS: 1, S.mjSENS_FRAMEZAXIS: 2}
INTERACTION_SENSORS = S.mjSENS_FORCE, S.mjSENS_TORQUE
JOINT_SENSORS = {S.mjSENS_JOINTPOS: 0, S.mjSENS_JOINTVEL: 1}
RATE_SENSORS = (
    S.mjSENS_JOINTVEL,
    S.mjSENS_BALLANGVEL,
    S.mjSENS_TENDONVEL,
    S.mjSENS_FRAMELINVEL,
    S.mjSENS_FRAMEANGVEL,
    S.mjSENS_FRAMELINACC,
    S.mjSENS_FRAMEANGACC,
    S.mjSENS_GYRO,
    S.mjSENS_VELOCIMETER,
    S.mjSENS_E_KINETIC,
)
"""Sensors of rates and accelerations."""
NO_RATE = "the engine is at rest at every sample: no rates, no accelerations"
JointMotion = tuple[Array, Array, Array]
"""Values, rates and accelerations along a run."""


def solve_slides(
    axes: list[tuple[Array, bool]], path: JointMotion, spin: Array, grows: Array
) -> list[JointMotion]:
    """Coordinates, rates and accelerations of slides from the path of a point (n, 3).

    `axes` are directions (n, 3), and whether each turns with the child, whose angular velocity and
    acceleration are `spin` and `grows` (n, 3), in the axes of the parent.
    """
    if not axes:
        return []
    still = np.zeros_like(spin)
    first = [np.cross(spin, axis) if turns else still for axis, turns in axes]
    second = [
        np.cross(grows, axis) + np.cross(spin, slope) if turns else still
        for (axis, turns), slope in zip(axes, first, strict=True)
    ]
    columns, slopes, bends = (
        np.stack(part, axis=-1) for part in ([axis for axis, _ in axes], first, second)
    )
    inverse, (way, speed, change) = np.asarray(np.linalg.pinv(columns), float), path

    def times(matrix: Array, vectors: Array) -> Array:
        return np.asarray(np.einsum("nij,nj->ni", matrix, vectors))

    value = times(inverse, way)
    rate = times(inverse, speed - times(slopes, value))
    acceleration = times(inverse, change - 2.0 * times(slopes, rate) - times(bends, value))
    return list(zip(value.T, rate.T, acceleration.T, strict=True))


@dataclass(frozen=True)
class StateCurves:
    """The channels of a run from the states of its links.

    Attributes
    ----------
    reader : NeutralReader
        The model in its start, and the run.
    mechanism : NeutralMechanism
    states : LinkStates
        Of n samples.
    """

    reader: NeutralReader
    mechanism: NeutralMechanism
    states: LinkStates

    def point(self, link: int, at: Array) -> JointMotion:
        """Position, velocity and acceleration (n, 3) of a point, given in the start pose."""
        s = self.states
        arm = s.turn[:, link] @ (at - self.mechanism.links[link].centre)
        omega, alpha = s.omega[:, link], s.alpha[:, link]
        return (
            s.place[:, link] + arm,
            s.velocity[:, link] + np.cross(omega, arm),
            s.acceleration[:, link] + np.cross(alpha, arm) + np.cross(omega, np.cross(omega, arm)),
        )

    def joint(self, j: int) -> JointMotion:
        """Coordinate, rate and acceleration (n,) of a hinge or slide.

        Raises
        ------
        Unsupported
            The engine tells no coordinates, and the link has several joints.
        """
        one, s = self.mechanism.joints[j], self.states
        if s.coordinates.size and np.isfinite(s.coordinates[:2, :, j]).all():
            value, rate, acceleration = s.coordinates[:, :, j]
            return value, rate, acceleration
        row = self.mechanism.joints_of(one.child)
        kinds = [self.mechanism.joints[k].kind for k in row]
        if kinds.count("hinge") > 1 or {"ball", "free"} & set(kinds):
            raise Unsupported(f"joint {one.name!r}, one of several of its link: its coordinate")
        value, rate, acceleration = self.row_motion(row)[row.index(j)]
        return one.value + value, rate, acceleration

    def row_motion(self, row: list[int]) -> list[JointMotion]:
        """Coordinates since the start, rates and accelerations of slides and one hinge in a row.

        In the axes of the parent a point of the child on the axis of the hinge has gone by a way
        that is the sum of ``q a`` over the slides, whose directions a turn with the child if they
        are behind the hinge.
        """
        mechanism, s = self.mechanism, self.states
        joints = [mechanism.joints[j] for j in row]
        a, b = joints[0].parent, joints[0].child
        hinge = next((i for i, one in enumerate(joints) if one.kind == "hinge"), len(joints))
        anchor = joints[min(hinge, len(joints) - 1)].anchor
        into = np.swapaxes(s.turn[:, a], -1, -2)

        def inside(vectors: Array) -> Array:
            return np.asarray(np.einsum("nij,nj->ni", into, vectors))

        far, near = self.point(b, anchor), self.point(a, anchor)
        gap, speed, change = (p - q for p, q in zip(far, near, strict=True))
        omega, alpha = s.omega[:, a], s.alpha[:, a]
        turn, spin = into @ s.turn[:, b], inside(s.omega[:, b] - omega)
        grows = inside(s.alpha[:, b] - alpha - np.cross(omega, s.omega[:, b]))
        speed = speed - np.cross(omega, gap)
        drawn = np.cross(alpha, gap) + np.cross(omega, np.cross(omega, gap) + 2.0 * speed)
        axes = [
            (turn @ one.axis if i > hinge else np.tile(one.axis, (len(turn), 1)), i > hinge)
            for i, one in enumerate(joints)
            if one.kind == "slide"
        ]
        found = solve_slides(
            axes, (inside(gap), inside(speed), inside(change - drawn)), spin, grows
        )
        if hinge < len(joints):
            axis = joints[hinge].axis
            skew = turn - np.swapaxes(turn, -1, -2)
            sine = 0.5 * np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], -1) @ axis
            cosine = 0.5 * (np.trace(turn, axis1=1, axis2=2) - 1.0)
            found.insert(hinge, (np.unwrap(np.arctan2(sine, cosine)), spin @ axis, grows @ axis))
        return found

    @cached_property
    def openings(self) -> Array:
        """Largest distance (n,) of two points that a loop, a hinge or a ball joins [m]."""
        found = np.zeros(len(self.states.place))
        pairs = [(one.a, one.on_a, one.b, one.on_b) for one in self.mechanism.loops]
        pairs += [
            (one.parent, one.anchor, one.child, one.anchor)
            for one in self.mechanism.joints
            if one.kind in ("hinge", "ball") and len(self.mechanism.joints_of(one.child)) == 1
        ]
        for a, on_a, b, on_b in pairs:
            gap = self.point(a, on_a)[0] - self.point(b, on_b)[0]
            found = np.maximum(found, np.linalg.norm(gap, axis=-1))
        return found

    def curves(self, settings: dict[str, object], stops: bool = False) -> Curves:
        """All channels of the run, with the actual motion of the drives.

        Parameters
        ----------
        settings : dict of str to object
            Those of the run, as they are shown.
        stops : bool
            Whether the engine has stops at the ends of the ranges of joints.

        Raises
        ------
        BadModel
            A channel names no sensor, or a part that it has not.
        Unsupported
            A joint passes the end of its range.
        Diverged
            The states end early, or a loop or joint is open.
        """
        run, mechanism, n = self.reader.run, self.mechanism, len(self.states.place)
        channels, missing = self.read_channels()
        if not stops:
            self.refuse_ends_of_ranges()
        curves = Curves(
            run.x[:n],
            channels,
            missing,
            drive=self.drive_motion() if mechanism.drives and n else None,
            violation=float(self.openings.max(initial=0.0)),
            seconds=self.states.seconds,
            steps=mechanism.steps,
            settings={"timestep": mechanism.step, **settings},
            violations=self.openings,
            notes=self.states.notes,
            asked_step=self.reader.asked_step,
        )
        return self.without_failure(curves, run.x, "t = {:.4g} s")

    def read_channels(self) -> tuple[dict[str, Array], dict[str, str]]:
        """The curves of all channels, and why others are missing."""
        channels, missing = dict[str, Array](), dict[str, str]()
        with np.errstate(all="ignore"):
            for name in self.reader.run.channels:
                found = self.channel(name)
                if isinstance(found, str):
                    missing[name] = found
                elif found.size and np.isnan(found).all():
                    missing[name] = "the engine has no accelerations"
                else:
                    channels[name] = found
        return channels, missing

    def drive_motion(self) -> JointMotion:
        """The actual motion of the drives."""
        run, n = self.reader.run, len(self.states.place)
        motions = [self.joint(one.joint) for one in self.mechanism.drives]
        value, rate, acceleration = (np.array(p) for p in zip(*motions, strict=True))
        if np.isnan(acceleration).all():  # the engine has none, and its drives are ideal
            acceleration = run.motion(run.x[:n])[2]
        return value, rate, acceleration

    def without_failure(self, curves: Curves, x: Array, where: str) -> Curves:
        """The curves, unless the states end early or a loop is open: then `Diverged` has them.

        `where` is the format of the x (n,) at which the run failed.
        """
        open_ = ~(self.openings <= MAX_OPENING_SHARE * self.mechanism.size)
        good = int(np.argmax(open_)) if open_.any() else len(open_)
        if good == x.size and not self.states.failed:
            return curves
        why = self.states.failed or "the run ended early"
        if good < len(open_):
            why = f"a loop or joint came open by {self.openings[good]:.3g} m"
        at = where.format(x[min(good, x.size - 1)])
        raise Diverged(f"{why} ({at})", curves.first(good) if good else None)

    def refuse_ends_of_ranges(self) -> None:
        """Raise `Unsupported` if a joint passes the end of its range, where it has no stop."""
        for j, one in enumerate(self.mechanism.joints):
            if one.limits is None:
                continue
            value, (low, high) = self.joint(j)[0], one.limits
            if (value < low - RANGE_ROUNDING).any() or (value > high + RANGE_ROUNDING).any():
                raise Unsupported(f"joint {one.name!r} reaches the end of its range")

    def channel(self, name: str) -> Array | str:
        """The curve (n,) of a channel, or why there is none."""
        model = self.reader.model
        s, part = find_channel(model, name)
        kind = S(int(model.sensor_type[s]))
        if model.sensor_reftype[s] != OBJ.mjOBJ_UNKNOWN:
            return "a sensor with a reference frame is not evaluated from states"
        for read in self.readers:
            if (found := read(self, s, kind, part)) is not None:
                return found
        return f"{kind.name[7:].lower()} is not evaluated from the states of links"

    def joint_channel(self, s: int, kind: mujoco.mjtSensor, part: str) -> Array | None:
        """The curve of a joint's coordinate, rate or acceleration, or of a ball's rate."""
        model, obj = self.reader.model, int(self.reader.model.sensor_objid[s])
        if kind in JOINT_SENSORS:
            return self.joint(obj)[JOINT_SENSORS[kind]]
        if kind == S.mjSENS_USER and model.sensor_objtype[s] == OBJ.mjOBJ_JOINT:
            return self.joint(obj)[2]
        if kind != S.mjSENS_BALLANGVEL:
            return None
        one = self.mechanism.joints[obj]
        relative = self.states.omega[:, one.child] - self.states.omega[:, one.parent]
        body = int(model.jnt_bodyid[obj])
        return self.in_frame(one.child, self.reader.data.xmat[body], relative)[:, "xyz".index(part)]

    def in_frame(self, link: int, axes: Array, vectors: Array) -> Array:
        """Components of vectors (n, 3) along axes (9,) that are fixed in a link."""
        turn = self.states.turn[:, link] @ axes.reshape(3, 3)
        return np.asarray(np.einsum("nji,nj->ni", turn, vectors))

    def tendon_channel(self, s: int, kind: mujoco.mjtSensor, part: str) -> Array | None:
        """The curve of the length of a straight tendon, or of its rate."""
        model, data = self.reader.model, self.reader.data
        if kind not in (S.mjSENS_TENDONPOS, S.mjSENS_TENDONVEL):
            return None
        sites = straight_tendon(model, int(model.sensor_objid[s]))
        if sites is None:
            return None
        one, two = (
            self.point(int(self.reader.link_of[model.site_bodyid[k]]), data.site_xpos[k])
            for k in sites
        )
        gap, rate = two[0] - one[0], two[1] - one[1]
        length = np.linalg.norm(gap, axis=-1)
        return length if kind == S.mjSENS_TENDONPOS else (gap * rate).sum(-1) / length

    def energy_channel(self, s: int, kind: mujoco.mjtSensor, part: str) -> Array | None:
        """MuJoCo's kinetic or potential energy [J]."""
        if kind == S.mjSENS_E_KINETIC:
            return self.kinetic_energy()
        return self.potential_energy() if kind == S.mjSENS_E_POTENTIAL else None

    def kinetic_energy(self) -> Array:
        """Kinetic energy of links and armatures [J]."""
        s, total = self.states, np.zeros(len(self.states.place))
        for k, link in enumerate(self.mechanism.links):
            spin = np.einsum("nji,nj->ni", s.turn[:, k], s.omega[:, k])
            total += 0.5 * link.mass * (s.velocity[:, k] ** 2).sum(-1)
            total += 0.5 * np.einsum("ni,ij,nj->n", spin, link.inertia, spin)
        for j, one in enumerate(self.mechanism.joints):
            if one.armature:
                total += 0.5 * one.armature * self.joint(j)[1] ** 2
        return total

    def potential_energy(self) -> Array:
        """Potential energy of weight and springs, without that of servos [J]."""
        total = np.zeros(len(self.states.place))
        for k, link in enumerate(self.reader.links()):
            total -= link.mass * self.states.place[:, k] @ self.reader.model.opt.gravity
        for j, one in enumerate(self.mechanism.joints):
            if one.spring.any():
                total += cubic_energy(self.joint(j)[0] - one.rest, one.spring)
        for spring in self.mechanism.springs:
            gap = self.point(spring.b, spring.on_b)[0] - self.point(spring.a, spring.on_a)[0]
            total += spring.energy(np.linalg.norm(gap, axis=-1))
        return total

    def frame_channel(self, s: int, kind: mujoco.mjtSensor, part: str) -> Array | None:
        """The curve of a position, a direction, a quaternion or a rate of a frame."""
        frame, data = sensor_frame(self.reader.model, s), self.reader.data
        if frame is None:
            return None
        link, at, own = int(self.reader.link_of[frame.body]), frame.place(data), frame.axes(data)
        if kind in POINT_SENSORS:
            return self.point(link, at)[POINT_SENSORS[kind]][:, "xyz".index(part)]
        if kind in AXIS_SENSORS:
            return self.direction(link, own[:, AXIS_SENSORS[kind]], part)
        if kind == S.mjSENS_FRAMEQUAT:
            turn = self.states.turn[:, link] @ own
            quaternions = Rotation.from_matrix(turn).as_quat(scalar_first=True)
            start = np.empty(4)
            mujoco.mju_mat2Quat(start, own.ravel())
            quaternions *= np.sign(quaternions[0] @ start) or 1.0
            return unwrap_quaternions(quaternions)[:, "wxyz".index(part)]
        if kind == S.mjSENS_GYRO:
            return self.in_frame(link, own, self.states.omega[:, link])[:, "xyz".index(part)]
        if kind == S.mjSENS_VELOCIMETER:
            return self.in_frame(link, own, self.point(link, at)[1])[:, "xyz".index(part)]
        if kind == S.mjSENS_FRAMEANGVEL:
            return self.states.omega[:, link, "xyz".index(part)]
        if kind == S.mjSENS_FRAMEANGACC:
            return self.states.alpha[:, link, "xyz".index(part)]
        return None

    def force_channel(self, s: int, kind: mujoco.mjtSensor, part: str) -> Array | str | None:
        """The moment of a drive, the force of a motor, or a force or moment between bodies."""
        model, obj = self.reader.model, int(self.reader.model.sensor_objid[s])
        if kind in INTERACTION_SENSORS:
            if what := force_left_out(model):
                return f"sensors of forces leave out {what}"
            found = self.forces
            place = int(model.sensor_adr[s]) + "xyz".index(part)
            return found if isinstance(found, str) else found[1][:, place]
        if kind not in (S.mjSENS_ACTUATORFRC, S.mjSENS_JOINTACTFRC):
            return None
        on_actuator = kind == S.mjSENS_ACTUATORFRC
        joint = joint_of(model, obj) if on_actuator else obj
        if joint in self.reader.driven:
            gear, found = gear_of_force(model, obj) if on_actuator else 1.0, self.forces
            drive = self.reader.driven.index(joint)
            return found if isinstance(found, str) else found[0][:, drive] / gear
        if not on_actuator or is_linear_in_joint(model, obj):
            return "the force of a servo is not evaluated from the states of links"
        force = self.reader.actuator_force(obj)
        places = slice(None, None, 2 * self.mechanism.count)
        return np.resize(force[places], len(self.states.place))

    @cached_property
    def forces(self) -> tuple[Array, Array] | str:
        """Moments of the drives (n, drives) [N m or N] and sensor values (n, values), or why not.

        See `ForceBalance`.
        """
        reader = self.reader
        if find_pairs(reader.model):
            return "the forces of contacts are not told by the engine"
        stops = [j for j, one in enumerate(self.mechanism.joints) if one.limits]
        try:
            balance = ForceBalance(reader.model, reader.run.start, reader.driven, stops)
            motion = self.coordinates()
        except Unsupported as error:
            return str(error)
        if not len(motion[0]):
            return np.zeros((0, len(reader.driven))), np.zeros((0, reader.model.nsensordata))
        controls = reader.controls[:, :: 2 * self.mechanism.count]
        friction = balance.find_friction(
            motion[0], reader.run.motion(reader.run.x[: len(motion[0])])[1]
        )
        moments, sensors = list[Array](), list[Array]()
        for k, (q, v, a, rub) in enumerate(zip(*motion, friction, strict=True)):
            now = controls[:, min(k, controls.shape[1] - 1)]
            try:
                drives, loops = balance.forces(q, v, a, now, rub)
            except Unsupported as error:
                return str(error)
            moments.append(drives)
            sensors.append(balance.sensors(a, loops))
        return np.array(moments), np.array(sensors)

    def coordinates(self) -> JointMotion:
        """Coordinates (n, nq), rates and accelerations (n, nv) of MuJoCo [SI].

        Raises
        ------
        Unsupported
            A ball has another joint beside it.
        """
        model, n = self.reader.model, len(self.states.place)
        q, v, a = np.empty((n, model.nq)), np.empty((n, model.nv)), np.empty((n, model.nv))
        for j, one in enumerate(self.mechanism.joints):
            at, dof = int(model.jnt_qposadr[j]), int(model.jnt_dofadr[j])
            if one.kind in ("hinge", "slide"):
                q[:, at], v[:, dof], a[:, dof] = self.joint(j)
                continue
            if len(self.mechanism.joints_of(one.child)) > 1:
                raise Unsupported(f"{one.kind} joint {one.name!r} beside another joint of its link")
            if one.kind == "free":
                parts = self.point(one.child, self.reader.data.xpos[model.jnt_bodyid[j]])
                q[:, at : at + 3], v[:, dof : dof + 3], a[:, dof : dof + 3] = parts
                at, dof = at + 3, dof + 3
            parts = self.rotation(j, at)
            q[:, at : at + 4], v[:, dof : dof + 3], a[:, dof : dof + 3] = parts
        return q, v, a

    def rotation(self, j: int, at: int) -> JointMotion:
        """Quaternion (n, 4) at place `at`, rates and accelerations (n, 3) of a ball or free joint.

        The quaternion follows from that of the start, Q0, and the relative rotation since then, T::

            Q = Q0 B0^T T B0            B0: axes of the body at the start
        """
        reader, s, one = self.reader, self.states, self.mechanism.joints[j]
        body, base = one.child, one.parent if one.kind == "ball" else 0
        axes = reader.data.xmat[reader.model.jnt_bodyid[j]].reshape(3, 3)
        start = Rotation.from_quat(reader.qpos[at : at + 4], scalar_first=True)
        relative = np.swapaxes(s.turn[:, base], -1, -2) @ s.turn[:, body]
        quaternions = start * Rotation.from_matrix(axes.T @ relative @ axes)
        spin, change = s.omega[:, body] - s.omega[:, base], s.alpha[:, body] - s.alpha[:, base]
        change = change - np.cross(s.omega[:, body], spin)
        local = (self.in_frame(body, axes.ravel(), part) for part in (spin, change))
        return quaternions.as_quat(scalar_first=True), *local

    def direction(self, link: int, axis: Array, part: str) -> Array:
        """A component, or the angle in the plane, of a direction that is fixed in a link."""
        world = self.states.turn[:, link] @ axis
        if part != "angle":
            return np.asarray(world[:, "xyz".index(part)])
        x, y = (world @ self.mechanism.plane[:2].T).T
        return np.unwrap(np.arctan2(y, x))

    readers = (joint_channel, tendon_channel, energy_channel, frame_channel, force_channel)


@dataclass(frozen=True)
class RestCurves(StateCurves):
    """The channels of a sweep or of an equilibrium from the links at rest."""

    def curves(self, settings: dict[str, object], stops: bool = False) -> Curves:
        """See `StateCurves.curves`; an equilibrium has one value of each sensor, repeated."""
        run, n = self.reader.run, len(self.states.place)
        single = run.kind == "equilibrium"
        rods = rod_channels(run) if single else {}
        channels, missing = self.read_channels()
        missing = {name: why for name, why in missing.items() if name not in rods}
        if not stops:
            self.refuse_ends_of_ranges()
        if single and n:
            channels = {name: np.repeat(curve, run.x.size) for name, curve in channels.items()}
            channels |= rod_curves(run, self.rod_pose)
        drive = None
        if self.mechanism.drives and not single:
            _, rate, acceleration = (part[:, :n] for part in run.motion(run.x))
            drive = self.drive_motion()[0], rate, acceleration
        curves = Curves(
            run.x if single else run.x[:n],
            channels,
            missing,
            drive=drive,
            violation=float(self.openings.max(initial=0.0)),
            seconds=self.states.seconds,
            steps=self.states.steps,
            settings={"timestep": self.mechanism.step, **settings},
            notes=self.states.notes,
            derivatives=0,
        )
        return self.without_failure(curves, run.x[: self.reader.samples], "x = {:.4g}")

    def channel(self, name: str) -> Array | str:
        """See `StateCurves.channel`; nothing moves."""
        if name in rod_channels(self.reader.run):
            return "a curve of a rod"
        s, _ = find_channel(self.reader.model, name)
        kind = S(int(self.reader.model.sensor_type[s]))
        if kind in RATE_SENSORS or kind == S.mjSENS_USER:
            return NO_RATE
        return super().channel(name)

    def rod_pose(self, one: Chain) -> RodPose:
        """Vertices, angles and bends of the links of a planar rod; see `rod_curves`."""
        model, data = self.reader.model, self.reader.data
        if one.rod.spatial:
            raise Unsupported("curves of a rod in space are not evaluated from the states of links")
        bodies = [int(model.body(name).id) for name in one.names]
        links = [int(self.reader.link_of[b]) for b in bodies]
        places = [self.point(k, data.xpos[b])[0][0] for k, b in zip(links, bodies, strict=True)]
        tip = model.site(f"{one.rod.name}.tip")
        end = int(self.reader.link_of[int(tip.bodyid[0])])
        places.append(self.point(end, data.site_xpos[tip.id])[0][0])
        angles = [
            float(self.direction(k, data.xmat[b].reshape(3, 3)[:, 0], "angle")[0])
            for k, b in zip(links, bodies, strict=True)
        ]
        bends = [
            self.joint(int(model.joint(name).id))[0][0] if jointed else 0.0
            for name, jointed in zip(one.names, one.has_joint, strict=True)
        ]
        return np.array(places), np.array(angles), np.array(bends)
