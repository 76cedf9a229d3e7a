"""The animation of a planar mechanism: its bodies at many poses, and deviations due to curves.

The poses are those of the model: by kinematics at the values of the drives, in equilibrium, or in
a free motion.  Curves of the reference and of solvers deviate little from these poses.  The
deviations are transferred to the bodies by the Jacobian J of the measured positions and angles s,
which a change dq of the joints changes by

    ds = J dq,        dq = least squares of ds, with much smaller weights of the loops

so that a loop that a solver leaves open is drawn open.  Deviations that are too large for a linear
step, as where a solver jumps to another equilibrium at another drive value than the model, are
fitted by Newton's method from the known pose whose measured values are nearest.

A mechanism that leaves every plane is projected and drawn as the model moves it, without deviations
due to curves.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from proofmass.base.arrays import Array
from proofmass.sim.contents import (
    active_connects,
    anchor_bodies,
    anchors,
    pose_of,
    sensor_frame,
    sensor_names,
)
from proofmass.sim.mujoco.model import load
from proofmass.sim.picture import Picture, PictureScene, follow_run, springs_between_sites
from proofmass.sim.plane import find_plane
from proofmass.sim.protocol.curves import split_channel
from proofmass.sim.protocol.run import Run
from proofmass.sim.rods import chain, joint_names

# weight of a loop's constraint violation relative to measured values; squared 1e-6
LOOP_WEIGHT = 1e-3
# share of the largest singular value below which singular values count as zero
POSE_RANK_TOLERANCE = 1e-9
LIMIT_DISTANCE = 1e-3  # [rad, or share of the size] distance at which a joint is drawn on its limit
ROUNDING = 1e-13  # share of the size, or rad, by which poses may deviate
NEWTON_STEPS = 4  # number of steps of Newton's method
# [rad, or share of the size] largest deviation for a linear step: its square is 2e-3
MAX_LINEAR_DEVIATION = 0.05
J, S = mujoco.mjtJoint, mujoco.mjtSensor
Curve = Mapping[str, Array]
Measured = Mapping[str, tuple[Curve, Curve]]
"""By solver: the reference's curves, and the solver's differences to them, at the run's x [SI]."""


@dataclass(frozen=True)
class Gauge:
    """A measured position or angle.

    Attributes
    ----------
    read : callable
        Gives the measured value in a pose, and its derivative by each joint.
    scale : float
        Unit of deviations: 1 for an angle [rad], the size of the mechanism for a position [m].
    turns : bool
        Whether an angle is measured.
    """

    read: Callable[[mujoco.MjData], tuple[float, Array]]
    scale: float
    turns: bool


Gauges = Mapping[str, Gauge]


@dataclass(frozen=True)
class MovedBody:
    """A rigid body; `outlines` (points, 2) [m] are relative to its origin in the first pose."""

    name: str
    outlines: tuple[Array, ...]


@dataclass(frozen=True)
class Spot:
    """A joint, one side of a loop, a guide or a clamp, at a point `at` of a body.

    Attributes
    ----------
    name, kind : str
        Kind is hinge, slide, pin, guide or clamp.
    body : int
        Number of the body; -1 for the ground.
    at : ndarray (2,)
        Position relative to the body's origin in the first pose [m].
    driven, ground, spring : bool
        Whether it is driven, is on the ground, has a spring.
    to : ndarray (2,), optional
        The other end of a guide [m]; for a clamp a point ahead on the rod.
    parent : int
        Number of the body relative to which a joint's body moves; -1 for the ground.
    """

    name: str
    kind: str
    body: int
    at: Array
    driven: bool = False
    ground: bool = False
    spring: bool = False
    to: Array | None = None
    parent: int = -1


@dataclass(frozen=True)
class MovedCoil:
    """A spring or damper between two points.

    `body` has the numbers of the points' bodies, -1 for the ground; `at` (2, 2) has the positions
    of the points relative to the bodies' origins in the first pose [m].
    """

    name: str
    body: tuple[int, int]
    at: Array


@dataclass(frozen=True)
class Motion:
    """A mechanism at the poses of a run.

    Attributes
    ----------
    picture : Picture
        The same poses as outlines in the world.
    index : ndarray (poses,) of int
        Numbers of the samples of the run at which the poses are [1].
    bodies, spots : tuple of MovedBody, tuple of Spot
    places : ndarray (poses, bodies, 3)
        Position and angle of each body [m, m, rad], according to the reference if its curves
        determine them, otherwise according to the model.
    away : dict of str to ndarray (poses, bodies, 3)
        By solver, deviation of the bodies by its curves from those by the reference [m, m, rad];
        NaN at poses without curves of the solver.
    rods : dict of str to tuple of int
        Numbers of the bodies that are the links of a rod, in their order.
    at_limit : dict of str to ndarray (poses,) of bool
        By joint that reaches an end of its range, whether it is there [1].
    used : tuple of str
        The curves that determine the bodies.
    unfit : float
        Largest deviation of the bodies from the reference's curves, as a share of the size [1].
    jumps : tuple of int
        Poses that are reached by a jump to another equilibrium from the pose before.
    along : str
        The axis of the world along which a mechanism in space is seen; empty for a planar one.  In
        space only the picture has the bodies, whose outlines change, and `bodies` is empty.
    coils : tuple of MovedCoil
        Springs and dampers between two points.
    """

    picture: Picture
    index: Array
    bodies: tuple[MovedBody, ...]
    spots: tuple[Spot, ...]
    places: Array
    away: dict[str, Array]
    rods: dict[str, tuple[int, ...]]
    at_limit: dict[str, Array]
    used: tuple[str, ...]
    unfit: float
    jumps: tuple[int, ...] = ()
    along: str = ""
    coils: tuple[MovedCoil, ...] = ()


def motion(
    model: Path, run: Run, measured: Measured, count: int = 121, keep: Iterable[int] = ()
) -> Motion:
    """The mechanism at up to `count` samples of a run, as far as its poses can be found.

    Samples before and after a jump to another equilibrium are among them.

    Parameters
    ----------
    model : Path
    run : Run
    measured : mapping
        See `Measured`.  The curves of a solver may end early.
    count : int
    keep : iterable of int
        Samples after which a curve jumps.

    Raises
    ------
    Unsupported
        The model has no joint.
    BadModel
        The model does not compile.
    """
    compiled, data = load(model, run)
    scene = MovingScene(compiled, data.qpos, run)
    start, last = data.qpos.copy(), run.x.size - 1
    index = np.linspace(0, last, min(count, run.x.size)).round().astype(int)
    both = [sample for k in keep for sample in (k, k + 1) if sample <= last]
    index = np.unique([*index.tolist(), *both])
    index = index[:1] if run.kind == "equilibrium" else index
    rows, jumps, stopped = follow_run(compiled, data, replace(run, x=run.x[index]))
    between = [np.arange(index[k - 1], index[k]) for k in jumps if k]
    if any(samples.size > 1 for samples in between):  # find the jump between two poses
        index = np.unique(np.concatenate([index, *between]))
        data.qpos[:] = start
        rows, jumps, stopped = follow_run(compiled, data, replace(run, x=run.x[index]))
    index = index[: len(rows)]
    x = run.x[index]
    poses = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    drawn = replace(
        scene.draw(poses, run),
        x=x,
        inputs=run.motion(x)[0],
        stopped=stopped,
    )
    if scene.along:
        empty = np.empty((len(index), 0, 3))
        return Motion(
            drawn, index, (), (), empty, {}, {}, scene.limits(poses), (), 0.0, along=scene.along
        )
    scene.before = poses["xmat"][0].reshape(-1, 3, 3)
    places, away, used, unfit = scene.place_bodies(poses, measured, index)
    return Motion(
        drawn,
        index,
        scene.bodies(poses),
        scene.spots(poses, drawn),
        places,
        away,
        scene.rods,
        scene.limits(poses),
        used,
        unfit,
        tuple(jumps),
        coils=scene.coils(poses),
    )


class MovingScene(PictureScene):
    """The rigid bodies of a model, the spots on them, and their motion with measured values."""

    def __init__(self, model: mujoco.MjModel, start: Array, run: Run):
        super().__init__(model, start)
        self.run = run
        self.roots = [b for b in range(1, model.nbody) if model.body_weldid[b] == b]
        self.number = {root: k for k, root in enumerate(self.roots)}
        self.rods: dict[str, tuple[int, ...]] = {}
        if self.along:
            return
        self.across = np.cross(*self.basis)
        self.before = np.empty(0)
        self.plane = find_plane(model, self.data)
        self.name_of_rod = {link: rod.name for rod in run.rods for link in chain(rod).bodies}
        self.hidden = {name for rod in run.rods for name in joint_names(chain(rod))}
        for k, root in enumerate(self.roots):
            rod = self.name_of_rod.get(model.body(root).name)
            if rod:
                self.rods[rod] = (*self.rods.get(rod, ()), k)

    def bodies(self, poses: dict[str, Array]) -> tuple[MovedBody, ...]:
        """All rigid bodies, with their outlines relative to their origins."""
        first = {name: rows[:1] for name, rows in poses.items()}
        found = []
        for root in self.roots:
            name, origin = self.model.body(root).name, self.flat(poses["xpos"][0, root])
            outlines = tuple(outline[0] - origin for outline in self.outlines(root, first))
            found.append(MovedBody(self.name_of_rod.get(name, name), outlines))
        return tuple(found)

    def spots(self, poses: dict[str, Array], drawn: Picture) -> tuple[Spot, ...]:
        """Joints on the bodies that they move, guides on the parent bodies, sides of loops."""
        model, found = self.model, list[Spot]()
        curved = np.any(getattr(model, "jnt_stiffnesspoly", np.zeros((model.njnt, 1))), axis=1)
        marks = {mark.name: mark for mark in drawn.marks}

        def spot(
            name: str, kind: str, body: int, at: Array, to: Array | None = None, **more: Any
        ) -> None:
            root = int(model.body_weldid[body])
            number = self.number.get(root, -1)
            origin = self.flat(poses["xpos"][0, root]) if number >= 0 else np.zeros(2)
            end = None if to is None else to - origin
            found.append(Spot(name, kind, number, at - origin, **more, to=end))

        for j in range(model.njnt):
            name, body = model.joint(j).name, int(model.jnt_bodyid[j])
            if name in self.hidden or self.is_free(j):
                continue
            mark = marks[name]
            parent = int(model.body_parentid[body])
            if mark.guide is not None:
                spot(name, "guide", parent, *mark.guide[0])
            spot(
                name,
                mark.kind,
                body,
                mark.at[0],
                driven=mark.driven,
                ground=mark.ground,
                spring=bool(model.jnt_stiffness[j] or curved[j]),
                parent=self.number.get(int(model.body_weldid[parent]), -1),
            )
        for i in active_connects(model):
            ground = 0 in model.body_weldid[list(anchor_bodies(model, i))]
            sides = zip(anchor_bodies(model, i), anchors(model, i, poses), strict=True)
            for body, at in sides:
                spot(model.equality(i).name, "pin", body, self.flat(at[0]), ground=bool(ground))
        for rod in filter(self.is_clamped_to_ground, self.run.rods):
            ends = self.clamp(rod, poses).guide
            if ends is not None:
                spot(rod.name, "clamp", 0, ends[0, 0], ends[0, 1], ground=True)
        return tuple(found)

    def coils(self, poses: dict[str, Array]) -> tuple[MovedCoil, ...]:
        """Springs and dampers between two points."""
        model, found = self.model, list[MovedCoil]()
        for t, sites in springs_between_sites(model):
            roots = model.body_weldid[model.site_bodyid[list(sites)]]
            places = self.flat(poses["site_xpos"][0, list(sites)])
            origins = self.flat(poses["xpos"][0, roots])
            found.append(
                MovedCoil(
                    model.tendon(t).name,
                    (self.number.get(int(roots[0]), -1), self.number.get(int(roots[1]), -1)),
                    places - origins,
                )
            )
        return tuple(found)

    def limits(self, poses: dict[str, Array]) -> dict[str, Array]:
        """Joints that reach an end of their range, with the poses at which they are there."""
        model, found = self.model, {}
        for j in np.flatnonzero(model.jnt_limited):
            values = poses["qpos"][:, model.jnt_qposadr[j]]
            slide = model.jnt_type[j] == J.mjJNT_SLIDE
            near = LIMIT_DISTANCE * (self.size if slide else 1.0)
            low, high = model.jnt_range[j]
            touching = (values < low + near) | (values > high - near)
            if touching.any():
                found[model.joint(j).name] = touching
        return found

    def place_bodies(
        self, poses: dict[str, Array], measured: Measured, index: Array
    ) -> tuple[Array, dict[str, Array], tuple[str, ...], float]:
        """Fields `places`, `away`, `used` and `unfit` of a `Motion`, from measured curves."""
        shape = (len(index), len(self.roots), 3)
        places, unfit = np.empty(shape), 0.0
        away = {solver: np.full(shape, np.nan) for solver in measured}
        reference = max((known for known, _ in measured.values()), key=count_samples, default={})
        gauges = {name: gauge for name in reference if (gauge := self.gauge(name)) is not None}
        if not self.determines_pose(gauges):
            gauges = {}
        known = KnownPoses(self, gauges, poses["qpos"])
        for k, sample in enumerate(index.tolist()):
            self.data.qpos[:] = poses["qpos"][k]
            if wanted := values_at_sample(reference, gauges, sample):
                self.data.qpos[:] = known.near(wanted, poses["qpos"][k])
                unfit = max(unfit, self.fit({n: gauges[n] for n in wanted}, wanted))
            self.update()
            places[k] = self.places()
            moves = dict[tuple[str, ...], Array]()  # shared by solvers with the same curves
            for solver, (_, differences) in measured.items():
                if off := values_at_sample(differences, gauges, sample):
                    shown = tuple(off)
                    if shown not in moves:
                        moves[shown] = self.moves({name: gauges[name] for name in shown})
                    away[solver][k] = self.away(known, off, places[k], moves[shown])
        places[:, :, 2] = np.unwrap(places[:, :, 2], axis=0)
        away = {s: rows for s, rows in away.items() if np.isfinite(rows).any()}
        return places, away, tuple(gauges), unfit

    def away(
        self, known: "KnownPoses", off: dict[str, float], places: Array, moves: Array
    ) -> Array:
        """Deviation of the bodies from `places` for deviations `off` of the gauges."""
        gauges = {name: known.gauges[name] for name in off}
        if max(abs(o) / gauges[n].scale for n, o in off.items()) < MAX_LINEAR_DEVIATION:
            return np.asarray(moves @ list(off.values()))
        pose = self.data.qpos.copy()
        wanted = {name: gauges[name].read(self.data)[0] + o for name, o in off.items()}
        self.data.qpos[:] = known.near(wanted, pose)
        self.fit(gauges, wanted)
        found = self.places() - places
        found[:, 2] = wrap_angles(found[:, 2])
        self.data.qpos[:] = pose
        self.update()
        return found

    def update(self) -> None:
        """Compute the kinematics for the present values of the joints."""
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)

    def determines_pose(self, gauges: Gauges) -> bool:
        """Whether a measured value changes with a joint that is not driven."""
        driven = [self.model.joint(d.joint).dofadr[0] for d in self.run.drives]
        self.update()
        rows = [np.delete(gauge.read(self.data)[1], driven) for gauge in gauges.values()]
        return any(np.abs(row).max(initial=0.0) > POSE_RANK_TOLERANCE for row in rows)

    def places(self) -> Array:
        """Position, and angle from the first pose, of each body (bodies, 3)."""
        at = self.flat(self.data.xpos[self.roots])
        rotations = self.data.xmat.reshape(-1, 3, 3) @ self.before.transpose(0, 2, 1)
        lead = self.flat(rotations[self.roots] @ self.basis[0])
        return np.column_stack([at, np.arctan2(lead[:, 1], lead[:, 0])])

    def rates(self) -> Array:
        """Derivatives of position and angle of the bodies by the joints (bodies, 3, joints)."""
        found = np.empty((len(self.roots), 3, self.model.nv))
        for k, root in enumerate(self.roots):
            move, turn = self.jacobian(root, self.data.xpos[root])
            found[k] = np.vstack([self.basis @ move, self.across @ turn])
        return found

    def jacobian(self, body: int, point: Array) -> tuple[Array, Array]:
        """Jacobians of a point of a body and of its rotation by the joints, (3, joints) each."""
        move, turn = np.zeros((3, self.model.nv)), np.zeros((3, self.model.nv))
        mujoco.mj_jac(self.model, self.data, move, turn, point, body)
        return move, turn

    def fit(self, gauges: Gauges, wanted: dict[str, float]) -> float:
        """Move the joints to wanted values of the gauges; returns the largest deviation left."""
        for _ in range(NEWTON_STEPS):
            self.update()
            lacking = self.gauge_deviations(gauges, wanted)
            if np.abs(lacking).max() < ROUNDING * self.size:
                break
            self.data.qpos += self.change(gauges, lacking)
        self.update()
        scales = np.array([gauge.scale for gauge in gauges.values()])
        return float(np.abs(self.gauge_deviations(gauges, wanted) / scales).max())

    def gauge_deviations(self, gauges: Gauges, wanted: dict[str, float]) -> Array:
        """Wanted values of the gauges minus present ones; angles without whole turns."""
        off = np.array([wanted[name] - gauge.read(self.data)[0] for name, gauge in gauges.items()])
        turns = np.array([gauge.turns for gauge in gauges.values()])
        return np.where(turns, wrap_angles(off), off)

    def change(self, gauges: Gauges, off: Array) -> Array:
        """The change of the joints that changes the gauges by `off` and closes the loops."""
        matrix, scales, lengths = self.rows(gauges)
        gaps = [self.flat(two.reshape(3) - one.reshape(3)) for one, two in self.loops()]
        ways = np.concatenate([off, np.zeros(len(self.run.drives)), *gaps])
        return np.asarray(
            lengths * np.linalg.lstsq(matrix, ways / scales, rcond=POSE_RANK_TOLERANCE)[0]
        )

    def moves(self, gauges: Gauges) -> Array:
        """Derivatives of the bodies by the gauges, with closed loops (bodies, 3, gauges)."""
        matrix, scales, lengths = self.rows(gauges)
        joints = lengths[:, None] * np.linalg.pinv(matrix, rcond=POSE_RANK_TOLERANCE) / scales
        return np.asarray(self.rates() @ joints[:, : len(gauges)])

    def loops(self) -> list[tuple[Array, Array]]:
        """Positions of both points of all loops [m]."""
        return [anchors(self.model, i, pose_of(self.data)) for i in active_connects(self.model)]

    def rows(self, gauges: Gauges) -> tuple[Array, Array, Array]:
        """Derivatives of gauges, drives and loops by the joints, without units (rows, joints).

        The units of the rows (rows,) and of the joints (joints,) are returned in addition.
        """
        model, data = self.model, self.data
        lengths = np.where(model.jnt_type == J.mjJNT_SLIDE, self.size, 1.0)
        rows = [gauge.read(data)[1] for gauge in gauges.values()]
        scales = [gauge.scale for gauge in gauges.values()]
        for drive in self.run.drives:
            rows.append(np.eye(model.nv)[model.joint(drive.joint).dofadr[0]])
            scales.append(1.0)
        for i, ends in zip(active_connects(model), self.loops(), strict=True):
            apart = [
                self.jacobian(b, p.reshape(3))[0]
                for b, p in zip(anchor_bodies(model, i), ends, strict=True)
            ]
            rows.extend(self.basis @ (apart[0] - apart[1]))
            scales += [self.size / LOOP_WEIGHT] * 2
        return np.array(rows) * lengths / np.array(scales)[:, None], np.array(scales), lengths

    def gauge(self, channel: str) -> Gauge | None:
        """The gauge of a channel that is a position or an angle; None for any other channel."""
        model = self.model
        name, part = split_channel(channel, sensor_names(model))
        if name not in sensor_names(model):
            return None
        s = sensor_names(model).index(name)
        kind, number = S(int(model.sensor_type[s])), int(model.sensor_objid[s])
        if kind == S.mjSENS_JOINTPOS:
            slide = model.jnt_type[number] == J.mjJNT_SLIDE
            unit = np.eye(model.nv)[model.jnt_dofadr[number]]
            return Gauge(
                lambda data: (float(data.qpos[model.jnt_qposadr[number]]), unit),
                self.size if slide else 1.0,
                not slide,
            )
        frame = sensor_frame(model, s)
        if frame is None or model.sensor_refid[s] >= 0:
            return None
        if kind == S.mjSENS_FRAMEPOS and part in ("x", "y", "z"):
            axis = "xyz".index(part)
            return Gauge(
                lambda data: (
                    float(frame.place(data)[axis]),
                    self.jacobian(frame.body, frame.place(data))[0][axis],
                ),
                self.size,
                False,
            )
        if kind == S.mjSENS_FRAMEXAXIS and part == "angle":

            def angle(data: mujoco.MjData) -> tuple[float, Array]:
                across, up = self.plane.flat(frame.axes(data)[:, 0])
                turn = self.jacobian(frame.body, frame.place(data))[1]
                return float(np.arctan2(up, across)), self.plane.normal @ turn

            return Gauge(angle, 1.0, True)
        return None


class KnownPoses:
    """Known poses of a model, from which the one nearest to wanted values of gauges is chosen."""

    def __init__(self, scene: MovingScene, gauges: Gauges, qpos: Array):
        self.scene, self.gauges, self.qpos = scene, gauges, qpos

    def near(self, wanted: dict[str, float], pose: Array) -> Array:
        """The pose itself if it is near to the wanted values, otherwise the nearest known pose.

        The distance includes that of the drives.  The known pose is returned with the drives of
        `pose`.
        """
        scene, data = self.scene, self.scene.data
        gauges = {name: self.gauges[name] for name in wanted}
        scales = np.array([gauge.scale for gauge in gauges.values()])
        data.qpos[:] = pose
        scene.update()
        if np.abs(scene.gauge_deviations(gauges, wanted) / scales).max() < MAX_LINEAR_DEVIATION:
            return pose
        joints = [scene.model.joint(drive.joint).id for drive in scene.run.drives]
        drives = scene.model.jnt_qposadr[joints]
        lengths = np.where(scene.model.jnt_type[joints] == J.mjJNT_SLIDE, scene.size, 1.0)
        turns = np.array([gauge.turns for gauge in gauges.values()])
        off = np.array(list(wanted.values())) - np.stack([self.shown[n] for n in wanted], axis=1)
        off = np.where(turns, wrap_angles(off), off) / scales
        away = np.hstack([off, (self.qpos - pose)[:, drives] / lengths])
        found: Array = self.qpos[int(np.argmin(np.linalg.norm(away, axis=1)))].copy()
        found[drives] = pose[drives]
        return found

    @cached_property
    def shown(self) -> Curve:
        """Values of all gauges at the known poses."""
        scene, found = self.scene, {name: np.empty(len(self.qpos)) for name in self.gauges}
        for k, pose in enumerate(self.qpos):
            scene.data.qpos[:] = pose
            scene.update()
            for name, gauge in self.gauges.items():
                found[name][k] = gauge.read(scene.data)[0]
        return found


def values_at_sample(curves: Curve, gauges: Gauges, sample: int) -> dict[str, float]:
    """Curves of the gauges at a sample; empty if one of them is not finite there.

    A curve that has ended is left out.
    """
    found = {
        name: float(curves[name][sample])
        for name in gauges
        if name in curves and sample < len(curves[name])
    }
    return found if np.isfinite(list(found.values())).all() else {}


def wrap_angles(angles: Array) -> Array:
    """Angles reduced by whole turns to -pi to pi [rad]."""
    return np.asarray((angles + np.pi) % (2 * np.pi) - np.pi)


def count_samples(curves: Curve) -> int:
    """Number of samples of the longest curve."""
    return max(map(len, curves.values()), default=0)
