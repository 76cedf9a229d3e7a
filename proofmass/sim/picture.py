"""Pictures of a mechanism at some poses of a run: lines, polygons, joints and springs.

A mechanism that leaves every plane is projected, see `side_view`.

The poses are those of the engine.  A body is drawn as its geoms, and also as lines between its
joints and loops if its geoms do not reach these.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import product
from math import ceil

import mujoco
import numpy as np
from scipy.spatial import ConvexHull, QhullError

from proofmass.base.arrays import Array
from proofmass.sim.contents import (
    active_connects,
    anchor_bodies,
    anchors,
    control_indices,
    pose_of,
    straight_tendon,
)
from proofmass.sim.mujoco.dynamics import initialize_dynamics
from proofmass.sim.mujoco.equilibrium import RestingLinkage, UnstableRest, linkage_of
from proofmass.sim.mujoco.linkage import Linkage
from proofmass.sim.mujoco.work import PYTHON_STEP, StepWork
from proofmass.sim.plane import find_plane
from proofmass.sim.protocol.failures import BadModel, Unsupported
from proofmass.sim.protocol.run import Rod, Run, whole_steps
from proofmass.sim.rods import chain, joint_names


@dataclass(frozen=True)
class Link:
    """A rigid body; `outlines` are lines and closed polygons (poses, points, 2) [m]."""

    name: str
    outlines: tuple[Array, ...]


@dataclass(frozen=True)
class Mark:
    """A joint, a loop or a clamp at positions `at` (poses, 2) [m].

    `kind` is hinge, ball, slide, pin or clamp.  `guide` (poses, 2, 2) [m] has the ends of the range
    that a slide covers in the run, or the position of a clamp and a point ahead on its rod.
    """

    name: str
    kind: str
    at: Array
    driven: bool = False
    ground: bool = False
    guide: Array | None = None


@dataclass(frozen=True)
class Coil:
    """A spring or damper between two points; `ends` (poses, 2, 2) [m]."""

    name: str
    ends: Array


@dataclass(frozen=True)
class Picture:
    """A mechanism at some poses.

    Attributes
    ----------
    axes : tuple of str
        The two world axes that span the drawing; empty names when the plane is inclined.
    x, inputs : ndarray (poses,), (drives, poses)
        The run's parameter [SI] and the values of the drives [rad or m].
    ground, links, marks
        The parts of the drawing, whose arrays have the poses along their first axis.
    tracks : tuple of str
        Sensors of a position in the world, whose paths may be added to the drawing.
    stopped : str
        Why there are no poses beyond the last; empty if the run was followed to its end.
    coils : tuple of Coil
        Springs and dampers between two points, also with the poses along the first axis.
    """

    axes: tuple[str, str]
    x: Array
    inputs: Array
    ground: Link
    links: tuple[Link, ...]
    marks: tuple[Mark, ...]
    tracks: tuple[str, ...] = ()
    stopped: str = ""
    coils: tuple[Coil, ...] = ()

    def at(self, poses: list[int]) -> "Picture":
        """The picture with these poses only."""

        def cut(link: Link) -> Link:
            return replace(link, outlines=tuple(o[poses] for o in link.outlines))

        marks = tuple(
            replace(m, at=m.at[poses], guide=None if m.guide is None else m.guide[poses])
            for m in self.marks
        )
        return replace(
            self,
            x=self.x[poses],
            inputs=self.inputs[:, poses],
            marks=marks,
            ground=cut(self.ground),
            links=tuple(map(cut, self.links)),
            coils=tuple(replace(coil, ends=coil.ends[poses]) for coil in self.coils),
        )


G, J, S = mujoco.mjtGeom, mujoco.mjtJoint, mujoco.mjtSensor
CIRCLE_ANGLES = np.linspace(0, 2 * np.pi, 24, endpoint=False)


class PictureScene:
    """The parts of the rigid bodies of a model, and the plane in which they are drawn."""

    def __init__(self, model: mujoco.MjModel, start: Array):
        self.model, self.data = model, mujoco.MjData(model)
        self.data.qpos[:] = start
        mujoco.mj_kinematics(model, self.data)
        if not model.njnt:
            raise Unsupported("the model has no joint")
        self.size, self.along = float(model.stat.extent), ""
        try:
            plane = find_plane(model, self.data)
        except Unsupported:
            self.along, self.axes, self.basis = side_view(model, self.data)
            return
        normal = int(np.abs(plane.normal).argmax())
        self.axes, self.basis = ("", ""), np.stack([plane.e1, plane.e2])
        if abs(plane.normal[normal]) > 1 - 1e-12:
            shown = [k for k in range(3) if k != normal]
            self.axes, self.basis = ("xyz"[shown[0]], "xyz"[shown[1]]), np.eye(3)[shown]

    def draw(self, rows: dict[str, Array], run: Run) -> Picture:
        """The picture at all poses of `rows`, without x, inputs and `stopped`."""
        model = self.model
        roots = [b for b in range(1, model.nbody) if model.body_weldid[b] == b]
        rod_of = {
            name: rod.name
            for rod in run.rods
            for name in (*joint_names(chain(rod)), *chain(rod).bodies)
        }
        links: dict[str, tuple[Array, ...]] = {}
        for b in roots:
            name = rod_of.get(model.body(b).name, model.body(b).name)
            links[name] = (*links.get(name, ()), *self.outlines(b, rows))
        fixed: list[Array] = []
        for b, p in self.geoms(0):
            if rod := rod_of.get(model.body(b).name):
                links[rod] = (self.placed(b, p, rows), *links[rod])
            else:
                fixed.append(self.placed(b, p, rows))
        fixed += self.floors([o for link in links.values() for o in link])
        marks = [
            self.joint(j, rows, run)
            for j in range(model.njnt)
            if model.joint(j).name not in rod_of and not self.is_free(j)
        ]
        marks += [self.pin(i, rows) for i in active_connects(model)]
        marks += [self.clamp(rod, rows) for rod in run.rods if self.is_clamped_to_ground(rod)]
        tracks = tuple(
            model.sensor(i).name
            for i in range(model.nsensor)
            if model.sensor_type[i] == S.mjSENS_FRAMEPOS and model.sensor_refid[i] < 0
        )
        empty = np.empty(0)
        return Picture(
            self.axes,
            empty,
            empty,
            Link("ground", tuple(fixed)),
            tuple(map(Link, links, links.values())),
            tuple(marks),
            tracks,
            coils=tuple(
                Coil(model.tendon(t).name, self.flat(rows["site_xpos"][:, list(sites)]))
                for t, sites in springs_between_sites(model)
            ),
        )

    def is_free(self, joint: int) -> bool:
        """Whether a joint is not drawn, since its body is free in the plane or in space."""
        model, body = self.model, int(self.model.jnt_bodyid[joint])
        own = model.body_jntadr[body] + np.arange(model.body_jntnum[body])
        kinds = sorted(model.jnt_type[own].tolist())
        planar = kinds == [J.mjJNT_SLIDE, J.mjJNT_SLIDE, J.mjJNT_HINGE]
        return bool(model.jnt_type[joint] == J.mjJNT_FREE or (planar and not self.along))

    def floors(self, outlines: list[Array]) -> Iterator[Array]:
        """Slabs (poses, 4, 2) for planes that are seen edge-on, wide enough for all `outlines`."""
        model, data = self.model, self.data
        for g in np.flatnonzero(model.geom_type == G.mjGEOM_PLANE):
            up = self.flat(data.geom_xmat[g].reshape(3, 3)[:, 2])
            if not outlines or np.linalg.norm(up) < 1 - 1e-9:
                continue
            at, along = self.flat(data.geom_xpos[g]), np.array([up[1], -up[0]])
            ways = np.concatenate([(o - at).reshape(-1, 2) @ along for o in outlines])
            wide = 0.1 * np.ptp(ways)
            ends = at + along * np.array([[ways.min() - wide], [ways.max() + wide]])
            slab = np.vstack([ends, ends[::-1] - 0.05 * self.size * up])
            yield np.broadcast_to(slab, (len(outlines[0]), 4, 2))

    def flat(self, vectors: Array) -> Array:
        """Components of vectors in the plane of the drawing: (..., 3) to (..., 2)."""
        return vectors @ self.basis.T

    def local(self, body: int, world: Array) -> Array:
        """Points `world` in the start pose, (3,) or (points, 3), in a body's frame."""
        return (world - self.data.xpos[body]) @ self.data.xmat[body].reshape(3, 3)

    def placed(self, body: int, points: Array, rows: dict[str, Array]) -> Array:
        """Points (k, 3) in a body's frame, as points of the drawing at all poses (poses, k, 2)."""
        turn = rows["xmat"][:, body].reshape(-1, 3, 3)
        return self.flat(rows["xpos"][:, None, body] + points @ turn.transpose(0, 2, 1))

    def outlines(self, root: int, rows: dict[str, Array]) -> tuple[Array, ...]:
        """Outlines of a rigid body: its geoms, and lines between `points` that these miss."""
        found = [self.placed(b, p, rows) for b, p in self.geoms(root)]
        points = self.points(root)
        if not points:
            return tuple(found)
        spread = self.placed(root, np.array(points), rows)
        off = max(
            min((distance_to_outline(p, o[0]) for o in found), default=np.inf) for p in spread[0]
        )
        if off > 0.02 * self.size and len(points) > 1:
            centre = spread[0] - spread[0].mean(axis=0)
            found.append(spread[:, np.argsort(np.arctan2(centre[:, 1], centre[:, 0]))])
        return tuple(found)

    def points(self, root: int) -> list[Array]:
        """Points of a rigid body in its frame: joints to other bodies, loops, measured sites."""
        model, data, found = self.model, self.data, []
        for j in range(model.njnt):
            child = int(model.jnt_bodyid[j])
            first = model.body_jntadr[child] == j  # other joints do not touch the parent body
            parent = int(model.body_weldid[model.body_parentid[child]]) if first else -1
            if J(model.jnt_type[j]) in (J.mjJNT_HINGE, J.mjJNT_BALL) and root in (child, parent):
                found.append(data.xanchor[j])
        for i in active_connects(model):
            for body, place in zip(
                anchor_bodies(model, i), anchors(model, i, pose_of(data)), strict=True
            ):
                if model.body_weldid[body] == root:
                    found.append(place.reshape(3))
        for i in range(model.nsensor):
            site = int(model.sensor_objid[i])
            if (
                model.sensor_type[i] == S.mjSENS_FRAMEPOS
                and model.sensor_objtype[i] == mujoco.mjtObj.mjOBJ_SITE
                and model.body_weldid[model.site_bodyid[site]] == root
            ):
                found.append(data.site_xpos[site])
        for _, sites in springs_between_sites(model):
            found += [
                data.site_xpos[s] for s in sites if model.body_weldid[model.site_bodyid[s]] == root
            ]
        places: list[Array] = []
        for place in found:
            if all(np.linalg.norm(place - p) > 1e-6 * self.size for p in places):
                places.append(place)
        return [self.local(root, p) for p in places]

    def geoms(self, root: int) -> Iterator[tuple[int, Array]]:
        """Body and outline (points, 3), in that body's frame, of each geom of a rigid body."""
        model, data = self.model, self.data
        for g in range(model.ngeom):
            body = int(model.geom_bodyid[g])
            if model.body_weldid[body] != root:
                continue
            turn, size = data.geom_xmat[g].reshape(3, 3), model.geom_size[g]
            outline = self.silhouette(g, turn, size)
            if outline is not None:
                yield body, self.local(body, data.geom_xpos[g] + outline)

    def silhouette(self, g: int, turn: Array, size: Array) -> Array | None:
        """Outline (points, 3) of a geom about its centre; None if it has none, like a plane."""
        kind, axis = G(self.model.geom_type[g]), turn[:, 2]
        if self.along and kind in (G.mjGEOM_BOX, G.mjGEOM_CYLINDER):
            return solid_outline(kind, size, np.cross(*self.basis) @ turn) @ turn.T
        level = bool(self.along) or np.linalg.norm(self.flat(axis)) > 1e-6
        if kind in (G.mjGEOM_CAPSULE, G.mjGEOM_CYLINDER) and level:
            return np.array([-axis, axis]) * size[1]
        if kind in (G.mjGEOM_CAPSULE, G.mjGEOM_CYLINDER, G.mjGEOM_SPHERE, G.mjGEOM_ELLIPSOID):
            return (
                size[0]
                * np.stack([np.cos(CIRCLE_ANGLES), np.sin(CIRCLE_ANGLES)], axis=1)
                @ self.basis
            )
        if kind == G.mjGEOM_BOX:
            corners = size * np.array(list(product((-1, 1), repeat=3)))
        elif kind == G.mjGEOM_MESH:
            mesh = self.model.geom_dataid[g]
            first, many = self.model.mesh_vertadr[mesh], self.model.mesh_vertnum[mesh]
            corners = self.model.mesh_vert[first : first + many]
        else:
            return None
        world = corners @ turn.T
        try:
            return np.asarray(world[ConvexHull(self.flat(world)).vertices])
        except QhullError:  # a flat geom seen edge-on
            return None

    def joint(self, j: int, rows: dict[str, Array], run: Run) -> Mark:
        """The mark of a joint; the guide of a slide covers the range that it reaches in the run."""
        model, body = self.model, int(self.model.jnt_bodyid[j])
        first = model.body_jntadr[body] == j
        ground = bool(first and model.body_weldid[model.body_parentid[body]] == 0)
        at, name = rows["xanchor"][:, j], model.joint(j).name
        driven = name in [d.joint for d in run.drives]
        if model.jnt_type[j] != J.mjJNT_SLIDE:
            kind = "hinge" if model.jnt_type[j] == J.mjJNT_HINGE else "ball"
            return Mark(name, kind, self.flat(at), driven, ground)
        way = rows["qpos"][:, model.jnt_qposadr[j]] - model.qpos0[model.jnt_qposadr[j]]
        axis = rows["xaxis"][:, j]
        from_zero = [] if ground else [0.0]  # on a moving body the guide starts at the zero
        ends = np.array([min([way.min(), *from_zero]), max([way.max(), *from_zero])])
        guide = at[:, None] + axis[:, None] * ends[:, None]
        return Mark(
            name, "slide", self.flat(at + axis * way[:, None]), driven, ground, self.flat(guide)
        )

    def pin(self, i: int, rows: dict[str, Array]) -> Mark:
        """The mark of a loop, in the middle of its two points."""
        one, two = anchors(self.model, i, rows)
        ground = 0 in self.model.body_weldid[list(anchor_bodies(self.model, i))]
        return Mark(
            self.model.equality(i).name, "pin", self.flat(0.5 * (one + two)), ground=bool(ground)
        )

    def is_clamped_to_ground(self, rod: Rod) -> bool:
        """Whether a rod begins in a clamp on the ground."""
        first = self.model.body(chain(rod).names[0])
        return rod.ends[0] == "clamped" and not self.model.body_weldid[first.parentid[0]]

    def clamp(self, rod: Rod, rows: dict[str, Array]) -> Mark:
        """The mark of a rod's clamp on the ground, with the direction of the rod."""
        first = self.model.body(chain(rod).names[0])
        ends = self.placed(first.id, np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]), rows)
        return Mark("", "clamp", ends[:, 0], ground=True, guide=ends)


def springs_between_sites(model: mujoco.MjModel) -> list[tuple[int, tuple[int, int]]]:
    """Springs and dampers between two sites: number of the tendon, and numbers of the sites."""
    return [
        (t, sites)
        for t in range(model.ntendon)
        if (sites := straight_tendon(model, t))
        and (model.tendon_stiffness[t] or model.tendon_damping[t])
    ]


BOX_EDGES = [0, 1, 3, 2, 0, 4, 5, 1, 5, 7, 3, 7, 6, 2, 6, 4]
"""A closed path along all edges of a box, of corners in the order of signs of x, y, z, -1 first."""


def solid_outline(kind: mujoco.mjtGeom, size: Array, view: Array) -> Array:
    """A closed line (points, 3) in the axes of a box or cylinder that depicts it from any side.

    For a cylinder it has both rims, and two lines along it, at the contour seen along `view` (3,).
    """
    if kind == G.mjGEOM_BOX:
        return (size * np.array(list(product((-1, 1), repeat=3))))[BOX_EDGES]
    turn = CIRCLE_ANGLES + np.arctan2(view[0], -view[1])
    rim = size[0] * np.column_stack([np.cos(turn), np.sin(turn)])
    half, whole = len(rim) // 2, [*range(len(rim)), 0]
    low, high = (np.column_stack([rim, np.full(len(rim), end)]) for end in (-size[1], size[1]))
    return np.vstack([low[whole], low[: half + 1], high[half:], high[whole], high[[0]]])


def side_view(model: mujoco.MjModel, data: mujoco.MjData) -> tuple[str, tuple[str, str], Array]:
    """The projection of a mechanism that leaves every plane, seen from a side.

    The vertical axis is the axis of the world along gravity, or z without gravity.  The horizontal
    axis is that of the other two along which the start pose extends further, or the first of them.

    Returns
    -------
    str, tuple of str, ndarray (2, 3)
        The axis of the view, the horizontal and the vertical axis, and the latter two as vectors
        [1].
    """
    gravity = np.abs(model.opt.gravity)
    up = int(gravity.argmax()) if gravity.any() else 2
    reach = np.ptp(np.vstack([data.xanchor, data.site_xpos, data.xipos[1:]]), axis=0)
    flat = [k for k in range(3) if k != up]
    across = max(flat, key=lambda k: (round(float(reach[k]), 9), -k))
    (along,) = (k for k in flat if k != across)
    return "xyz"[along], ("xyz"[across], "xyz"[up]), np.eye(3)[[across, up]]


def distance_to_outline(point: Array, outline: Array) -> float:
    """Distance of a point from a closed polygon or a line (points, 2); zero inside [m]."""
    start, end = outline, np.roll(outline, -1, axis=0)
    along, to = end - start, point - start
    share = np.clip((to * along).sum(1) / np.maximum((along**2).sum(1), 1e-300), 0, 1)
    crosses = (start[:, 1] > point[1]) != (end[:, 1] > point[1])
    level = np.where(crosses, along[:, 1], 1.0)
    left = point[0] < start[:, 0] + along[:, 0] * to[:, 1] / level
    if (crosses & left).sum() % 2:
        return 0.0
    return float(np.linalg.norm(to - share[:, None] * along, axis=1).min())


MAX_PICTURE_WORK = 5.0  # largest counted processor time [s] for stepping a motion
STEPS_AT_A_TIME = 100
"""Steps of a free motion that MuJoCo makes in one call, after which their time is counted."""
# share of a stride to which a drawing locates the end of a path of equilibria
DRAWN_STRIDE_SHARE = 1e-3


def follow_run(
    model: mujoco.MjModel, data: mujoco.MjData, run: Run
) -> tuple[list[dict[str, Array]], list[int], str]:
    """Poses along the run, numbers of those reached by a jump, and why there are no more.

    If not even the first pose can be found, the only pose is the start pose of the MJCF.
    """
    mujoco.mj_kinematics(model, data)
    rows, jumps = list[dict[str, Array]](), list[int]()
    kept = ("qpos", "xpos", "xmat", "xanchor", "xaxis", "site_xpos")
    is_prescribed = run.drives or run.kind == "equilibrium"
    moves = step_poses(model, data, run)
    if is_prescribed:
        moves = (drive_poses if run.kind == "dynamics" else sweep_poses)(model, data, run)
    first, stopped = {name: getattr(data, name).copy() for name in kept}, ""
    try:
        for jumped in moves:
            jumps += [len(rows)] * jumped
            rows.append({name: getattr(data, name).copy() for name in kept})
    except (BadModel, Unsupported) as error:
        stopped = str(error)
    return rows or [first], jumps, stopped


def sweep_poses(model: mujoco.MjModel, data: mujoco.MjData, run: Run) -> Iterator[bool]:
    """Put the model into its pose at each drive value; yields whether it fell from another pose.

    A sweep of the engine ends where its equilibrium becomes unstable.  Here the model falls to
    another equilibrium and the motion continues, as with the engine's own steps and the reference.
    """
    linkage, tangent = linkage_of(model, data, run), None
    if isinstance(linkage, RestingLinkage):
        linkage.shortest = DRAWN_STRIDE_SHARE
    for values in np.vstack([run.motion(run.x)[0], run.controls(run.x)[0]]).T:
        fell = False
        try:
            tangent = linkage.move(values, tangent)
        except UnstableRest as end:
            if not isinstance(linkage, RestingLinkage):
                raise
            try:
                tangent, fell = linkage.fall(values), True
            except (BadModel, Unsupported):
                raise end from None
        yield fell


def drive_poses(model: mujoco.MjModel, data: mujoco.MjData, run: Run) -> Iterator[bool]:
    """Put the model into its pose at each time, by steps if drives leave degrees of freedom."""
    linkage = Linkage(model, data, tuple(drive.joint for drive in run.drives))
    if not linkage.leaves_dof():
        yield from sweep_poses(model, data, run)
        return
    work, begin = StepWork(model), float(run.x[0])
    model.opt.timestep = step = common_step(run.x, model.opt.timestep)
    shown = np.bincount(np.rint((run.x - begin) / step).astype(int))  # number of samples per step
    times = begin + step * np.arange(len(shown), dtype=float)
    change, spent = control_setter(model, data, run), 0.0
    for k, torque in enumerate((*initialize_dynamics(linkage, run, times)[0], None)):
        for _ in range(shown[k]):
            mujoco.mj_kinematics(model, data)
            yield False
        if torque is not None:
            data.qfrc_applied[linkage.dofs] = torque
            change(times[k] + 0.5 * step)
            mujoco.mj_step(model, data)
        spent += work.step(data) + PYTHON_STEP
        if spent >= MAX_PICTURE_WORK or not np.isfinite(data.qpos).all():
            raise Unsupported("the motion was not followed to its end")


def common_step(x: Array, longest: float) -> float:
    """The longest step <= `longest` whose multiples lead to `x`, some samples of an even grid.

    >>> common_step(np.array([0.0, 2.0, 5.0, 7.0]), 0.6)
    0.5
    """
    spacing = np.diff(x)
    uneven = float(np.ptp(spacing))
    least = float(spacing.min())
    base = least if uneven < 1e-9 * least else min(least, uneven)
    return base / whole_steps(base, longest)


def step_poses(model: mujoco.MjModel, data: mujoco.MjData, run: Run) -> Iterator[bool]:
    """Step a free motion of the model from sample to sample."""
    work, spent, data.time = StepWork(model), 0.0, run.x[0]
    change, step = control_setter(model, data, run), model.opt.timestep
    for moment in run.x:
        # steps until the time is nearest to the sample; MuJoCo may reset it in between
        while (left := ceil((moment - data.time) / step - 0.5)) > 0 and spent < MAX_PICTURE_WORK:
            change(data.time + 0.5 * step)
            count = 1 if run.loads else min(left, STEPS_AT_A_TIME)
            mujoco.mj_step(model, data, count)
            spent += count * (work.step(data) + PYTHON_STEP)
        if spent >= MAX_PICTURE_WORK or not np.isfinite(data.qpos).all():
            raise Unsupported("the free motion was not followed to its end")
        mujoco.mj_kinematics(model, data)
        yield False


def control_setter(model: mujoco.MjModel, data: mujoco.MjData, run: Run) -> Callable[[float], None]:
    """A function that sets the controls of a run's loads to their values at a time [s] in it."""
    places = control_indices(model, (one.actuator for one in run.loads))
    last = float(run.x[-1])

    def change(moment: float) -> None:
        if places:
            data.ctrl[places] = run.controls(np.array([min(moment, last)]))[0][:, 0]

    return change
