"""Curves of all channels from the states of the links of a mechanism at the samples."""

from copy import copy
from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from proofmass.analytic.numerics import unwrap_quaternions
from proofmass.base.arrays import Array
from proofmass.sim.contents import (
    find_channel,
    gear_of_force,
    is_linear_in_joint,
    joint_of,
    sensor_frame,
    straight_tendon,
)
from proofmass.sim.interpreter.mechanism import LinkStates, NeutralMechanism
from proofmass.sim.neutral import NeutralReader
from proofmass.sim.protocol.curves import Curves
from proofmass.sim.protocol.failures import Diverged, Unsupported
from proofmass.sim.smooth import SmoothTerms

S, OBJ = mujoco.mjtSensor, mujoco.mjtObj
MAX_OPENING_SHARE = 0.1
"""Opening of a loop or a joint, as a share of the size, beyond which a run has failed."""
RANGE_ROUNDING = 1e-6
"""Distance by which a joint may pass the end of its range [rad or m], since it may end on it."""
ROW_SHARE = 1e-10
"""Singular value, as a share of the largest, below which rows of constraints are redundant: those
of loops that are planar in the coordinates themselves, to rounding."""
POINT_SENSORS = {S.mjSENS_FRAMEPOS: 0, S.mjSENS_FRAMELINVEL: 1, S.mjSENS_FRAMELINACC: 2}
AXIS_SENSORS = {S.mjSENS_FRAMEXAXIS: 0, S.mjSENS_FRAMEYAXIS: 1, S.mjSENS_FRAMEZAXIS: 2}
JOINT_SENSORS = {S.mjSENS_JOINTPOS: 0, S.mjSENS_JOINTVEL: 1}
JointMotion = tuple[Array, Array, Array]
"""Values, rates and accelerations along a run."""


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
        """Coordinate, rate and acceleration (n,) of a hinge or slide."""
        one, s = self.mechanism.joints[j], self.states
        if s.coordinates.size and np.isfinite(s.coordinates[:2, :, j]).all():
            value, rate, acceleration = s.coordinates[:, :, j]
            return value, rate, acceleration
        a, b = one.parent, one.child
        axis = s.turn[:, a] @ one.axis
        if one.kind == "hinge":
            turn = np.swapaxes(s.turn[:, a], -1, -2) @ s.turn[:, b]
            skew = turn - np.swapaxes(turn, -1, -2)
            sine = 0.5 * np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], -1) @ one.axis
            cosine = 0.5 * (np.trace(turn, axis1=1, axis2=2) - 1.0)
            relative = s.omega[:, b] - s.omega[:, a], s.alpha[:, b] - s.alpha[:, a]
            value = one.value + np.unwrap(np.arctan2(sine, cosine))
            return value, (relative[0] * axis).sum(-1), (relative[1] * axis).sum(-1)
        far, near = self.point(b, one.anchor), self.point(a, one.anchor)
        gap, speed, change = (p - q for p, q in zip(far, near, strict=True))
        omega, alpha = s.omega[:, a], s.alpha[:, a]
        turning = np.cross(omega, axis)
        second = np.cross(alpha, axis) + np.cross(omega, turning)
        return (
            one.value + (gap * axis).sum(-1),
            (speed * axis + gap * turning).sum(-1),
            (change * axis + 2.0 * speed * turning + gap * second).sum(-1),
        )

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
        channels, missing = dict[str, Array](), dict[str, str]()
        with np.errstate(all="ignore"):
            for name in run.channels:
                found = self.channel(name)
                if isinstance(found, str):
                    missing[name] = found
                elif found.size and np.isnan(found).all():
                    missing[name] = "the engine has no accelerations"
                else:
                    channels[name] = found
        drive = None
        if mechanism.drives and n:
            motions = [self.joint(one.joint) for one in mechanism.drives]
            value, rate, acceleration = (np.array(p) for p in zip(*motions, strict=True))
            if np.isnan(acceleration).all():  # the engine has none, and its drives are ideal
                acceleration = run.motion(run.x[:n])[2]
            drive = value, rate, acceleration
        if not stops:
            self.refuse_ends_of_ranges()
        open_ = ~(self.openings <= MAX_OPENING_SHARE * mechanism.size)
        good = int(np.argmax(open_)) if open_.any() else n
        curves = Curves(
            run.x[:n],
            channels,
            missing,
            drive=drive,
            violation=float(self.openings.max(initial=0.0)),
            seconds=self.states.seconds,
            steps=mechanism.steps,
            settings={"timestep": mechanism.step, **settings},
            violations=self.openings,
            notes=self.states.notes,
            asked_step=self.reader.asked_step,
        )
        if good < run.x.size or self.states.failed:
            why = self.states.failed or "the run ended early"
            if good < n:
                why = f"a loop or joint came open by {self.openings[good]:.3g} m"
            when = run.x[min(good, run.x.size - 1)]
            raise Diverged(f"{why} (t = {when:.4g} s)", curves.first(good) if good else None)
        return curves

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
        for k, link in enumerate(self.mechanism.links):
            total -= link.mass * self.states.place[:, k] @ self.mechanism.gravity
        for j, one in enumerate(self.mechanism.joints):
            if one.spring.any():
                (k, a, b), x = one.spring, self.joint(j)[0] - one.rest
                total += x**2 * (k / 2 + x * (a / 3 + x * b / 4))
        for spring in self.mechanism.springs:
            gap = self.point(spring.b, spring.on_b)[0] - self.point(spring.a, spring.on_a)[0]
            length = np.linalg.norm(gap, axis=-1)
            total += 0.5 * spring.stiffness * (length - np.clip(length, *spring.slack)) ** 2
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
        """The moment of a drive, or the force of a motor on a joint without one."""
        if kind not in (S.mjSENS_ACTUATORFRC, S.mjSENS_JOINTACTFRC):
            return None
        model, obj = self.reader.model, int(self.reader.model.sensor_objid[s])
        on_actuator = kind == S.mjSENS_ACTUATORFRC
        joint = joint_of(model, obj) if on_actuator else obj
        if joint in self.reader.driven:
            gear = gear_of_force(model, obj) if on_actuator else 1.0
            moments = self.drive_moments
            if isinstance(moments, str):
                return moments
            return moments[:, self.reader.driven.index(joint)] / gear
        if not on_actuator or is_linear_in_joint(model, obj):
            return "the force of a servo is not evaluated from the states of links"
        force = self.reader.actuator_force(obj)
        places = slice(None, None, 2 * self.mechanism.count)
        return np.resize(force[places], len(self.states.place))

    @cached_property
    def drive_moments(self) -> Array | str:
        """Moments that the mechanism needs from its drives (n, drives) [N m or N], or why not.

        They follow from the balance of all joints at the coordinates, rates and accelerations of
        the run, ``M a + h = Q + J^T f + S^T moment``, with the equations of MuJoCo and without its
        soft constraints.
        """
        model, driven = copy(self.reader.model), list(self.reader.driven)
        if any(one.kind not in ("hinge", "slide") for one in self.mechanism.joints):
            return "moments of drives are evaluated for hinges and slides only"
        dofs = model.jnt_dofadr[driven]
        if model.dof_frictionloss[dofs].any() or model.dof_dampingpoly[dofs].any():
            return "dry friction and polynomial damping of a driven joint are left out"
        for a in range(model.nactuator):
            if joint_of(model, a) in driven:
                model.actuator_gainprm[a] = model.actuator_biasprm[a] = 0.0
        terms, found = SmoothTerms(model, self.reader.run.start), []
        motions = np.array([self.joint(j) for j in range(model.njnt)])  # (joints, 3, n)
        controls = self.reader.controls[:, :: 2 * self.mechanism.count]
        for k, (q, v, a) in enumerate(np.moveaxis(motions, -1, 0).swapaxes(1, 2)):
            own = terms.terms(q, v, controls[:, min(k, controls.shape[1] - 1)])
            rows = np.vstack([own.jacobian, np.eye(model.nv)[dofs]])
            needed = own.mass @ a + own.bias - own.force
            found.append(np.linalg.lstsq(rows.T, needed, rcond=ROW_SHARE)[0][-len(dofs) :])
        return np.array(found).reshape(-1, len(dofs))

    def direction(self, link: int, axis: Array, part: str) -> Array:
        """A component, or the angle in the plane, of a direction that is fixed in a link."""
        world = self.states.turn[:, link] @ axis
        if part != "angle":
            return np.asarray(world[:, "xyz".index(part)])
        x, y = (world @ self.mechanism.plane[:2].T).T
        return np.unwrap(np.arctan2(y, x))

    readers = (joint_channel, tendon_channel, energy_channel, frame_channel, force_channel)
