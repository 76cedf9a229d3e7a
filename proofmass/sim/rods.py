"""Rods in an MJCF: chains of rigid links with torsion springs, added before it is compiled.

A rod of n segments of h = L / n:

    half      |-o--o--o--o-     springs EI/h at h/2, 3h/2, ..., half links at both ends: order 2
    double    @--o--o--o--      springs EI/h at h, 2h, ..., 2 EI/h at the clamp: order 2
    naive     o--o--o--o--      EI/h at the clamp as well, which is half of what is right: order 1

The links' angles are those of the rod's tangent at `Chain.nodes`: at 0, h, 2h, ..., L in the first
scheme, in the middle of the links in the others.  A pinned end has no spring.

A rod that stretches or shears has slides in the middle of its links, with springs EA/h along them
and GA/h across.  The bodies before, between and behind the slides have equal shares of the mass and
inertia of a link.  The order of the two slides alternates from link to link, so that the errors by
the weight of the body between them, which acts on one of the slides only, cancel:

    o==xy==o==yx==o==xy==   springs carry the loads beyond the middle of a link: order 2

A rod that is curved without loads has springs whose angles at rest are its curvature times h.  A
couple along a rod acts on each link in proportion to its length.

A rod in space has three hinges where a planar one has one: about x, along the link before, y and z,
with springs GJ/h, EI_y/h and EI/h, whose angles at rest are the natural twist and curvatures times
h.  Rotations about different axes do not commute.  Their order alternates from link to link, since
otherwise the chain would be of order 1::

    |-xyz--zyx--xyz--zyx-

A rod starts in an arc, or in a given shape, whose bends are changed as little as possible for the
loop to close.  A
pinned far end is a ``connect``.  A clamped far end is two of them, the second one to a slider of
the far body, so that no degree of freedom is constrained twice:

    o==o==o==.----------+       the last link, extended by the rod's length
           tip       slider     on the x axis of the far site

The curves of a rod at rest are position, direction and moment along its arc length.  Positions are
on the links.  Directions and moments are interpolated linearly between those of the links and of
their springs, and extrapolated at the ends, with an error of second order in the length of a link.

The chain of a rod is added to the body of its first site; its links follow each other along their x
axes.  Sensors, actuators and loops of the MJCF may refer to the added elements by name:

    NAME.1, NAME.2, ...     bodies, joints, and sites in the middle of the links
    NAME.1.x, NAME.1.y ...  bodies and joints behind slides, if it stretches or shears
    NAME.1.bend_y, NAME.1.twist  joints of a rod in space, in addition to those about z
    NAME.middle, NAME.tip   sites half way and at the far end, their x axes along the rod.  They
                            keep their places along the rod for other numbers of segments, except
                            for half the strain of a link if NAME.middle is in the middle of one.
    NAME                    the loop that constrains the far end
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from proofmass.analytic.numerics import TURN
from proofmass.base.arrays import Array
from proofmass.sim.protocol.curves import split_channel
from proofmass.sim.protocol.failures import BadModel, BadRod
from proofmass.sim.protocol.run import Rod, Run

SCHEMES = "half", "double", "naive"


@dataclass(frozen=True)
class Hinge:
    """A hinge between two links: number of its axis, spring [N m/rad], angle at rest [rad]."""

    name: str
    axis: int
    spring: float
    rest: float


@dataclass(frozen=True)
class Chain:
    """The links that represent a rod.

    Attributes
    ----------
    rod : Rod
    lengths, springs : ndarray (links,)
        Length [m] of each link and stiffness [N m/rad] of the joint at its beginning, which is zero
        where the rod is pinned and infinite where it is clamped without a spring.
    nodes : ndarray (links,)
        Arc length [m] at which the rod has the direction of each link.
    """

    rod: Rod
    lengths: Array
    springs: Array
    nodes: Array

    @cached_property
    def names(self) -> list[str]:
        """Names of the links' bodies and joints; a link with number 0 has no spring."""
        first = 0 if self.rod.scheme == "half" else 1
        return [f"{self.rod.name}.{k + first}" for k in range(self.lengths.size)]

    def slides(self, link: int) -> tuple[str, ...]:
        """Axes of a link's slides, in their order along the link."""
        axes = {"x": self.rod.axial, "y": self.rod.shear}
        if self.rod.spatial:
            axes["z"] = self.rod.shear
        return tuple(axis for axis, value in axes.items() if value is not None)[:: (-1) ** link]

    def hinges(self, link: int) -> tuple[Hinge, ...]:
        """The hinges at the beginning of a link, in their order."""
        if not self.has_joint[link]:
            return ()
        name, rod = self.names[link], self.rod
        if rod.torsion is None:
            return (Hinge(name, 2, float(self.springs[link]), float(self.rests[link])),)
        cell = rod.length / rod.segments
        about = {
            f"{name}.twist": rod.torsion,
            f"{name}.bend_y": rod.stiffness_y or rod.stiffness,
            name: rod.stiffness,
        }
        found = [
            Hinge(joint, axis, value / cell, cell * rod.curvature[axis])
            for axis, (joint, value) in enumerate(about.items())
        ]
        return tuple(found[:: (-1) ** link])

    @property
    def bodies(self) -> list[str]:
        """Names of all bodies, along the rod; a slide has the name of the body that it moves."""
        return [
            body
            for k, name in enumerate(self.names)
            for body in (name, *(f"{name}.{axis}" for axis in self.slides(k)))
        ]

    @cached_property
    def vertices(self) -> Array:
        """Arc length [m] of the links' ends (links + 1,)."""
        return np.append(0.0, np.cumsum(self.lengths))

    @cached_property
    def has_joint(self) -> NDArray[np.bool_]:
        """Whether each link begins with a joint, (links,)."""
        return np.isfinite(self.springs)

    @cached_property
    def rests(self) -> Array:
        """Values (links,) of the joints of a planar rod without loads; zero where it is pinned."""
        natural = np.diff(self.rod.curvature[2] * self.nodes, prepend=0.0)
        return np.where(self.has_joint & (self.springs > 0), natural, 0.0)

    @cached_property
    def first_bends(self) -> Array:
        """Joint values (links,) of the shape in which the rod starts, before its loop is closed."""
        if not self.rod.shape:
            return np.diff(self.rod.turn * self.nodes / self.rod.length, prepend=0.0)
        angles = np.append(0.0, self.rod.shape)
        knots = np.linspace(0.0, self.rod.length, angles.size)
        return np.diff(CubicSpline(knots, angles)(self.nodes), prepend=0.0)


def chain(rod: Rod) -> Chain:
    """Cut a rod into links.

    Raises
    ------
    BadRod
        Fewer than two segments, an unknown scheme, a length or stiffness that is not positive.
    """
    check_rod(rod)
    n, h = rod.segments, rod.length / rod.segments
    lengths, springs = np.full(n, h), np.full(n, rod.stiffness / h)
    if rod.scheme == "half":
        lengths = np.concatenate([[h / 2], lengths[1:], [h / 2]])
        springs = np.append(np.inf, springs)
        nodes = h * np.arange(n + 1.0)
    else:
        springs[0] *= 2.0 if rod.scheme == "double" else 1.0
        nodes = h * np.arange(0.5, n)
    if rod.ends[0] == "pinned":
        springs[0] = 0.0
    return Chain(rod, lengths, springs, nodes)


def check_rod(rod: Rod) -> None:
    """Raise `BadRod` for properties that no rod can have."""
    for key in ("length", "stiffness", "mass", "axial", "shear", "torsion", "stiffness_y"):
        value = getattr(rod, key)
        if value is not None and not value > 0:
            raise BadRod(rod.name, key, f"{value:g} must be positive")
    if rod.segments < 2:
        raise BadRod(rod.name, "segments", f"{rod.segments}; a rod has two or more")
    if rod.scheme not in SCHEMES:
        raise BadRod(rod.name, "scheme", f"{rod.scheme!r}; known: {', '.join(SCHEMES)}")
    if rod.ends[1] == "clamped" and rod.scheme != "half":
        raise BadRod(rod.name, "scheme", f"{rod.scheme!r} has no clamp at the far end; use half")
    if rod.spatial and (rod.ends != ("clamped", "free") or rod.scheme != "half"):
        raise BadRod(
            rod.name, "torsion", "a rod in space has ends clamped and free, and the scheme half"
        )


MAX_JOINT_STEP = 0.1  # [rad] of a Newton step, so that the arc keeps its side
CLOSURE_TOLERANCE = 1e-12  # constraint violation, over the rod's length
STRAIGHT_ROD_TOLERANCE = 1e-9  # excess length of a straight rod, over the distance of its ends
MAX_CHAIN_ITERATIONS = (
    1000  # Newton steps; 2 pi / `MAX_JOINT_STEP` of them turn every joint once around
)


def tip_pose(chain: Chain, bends: Array) -> tuple[Array, Array]:
    """Pose (x, y, angle) of a chain's tip, and its derivatives (3, links) by the joint values."""
    angles = np.cumsum(bends)
    links = chain.lengths * np.stack([np.cos(angles), np.sin(angles)])
    to_tip = np.cumsum(links[:, ::-1], axis=1)[:, ::-1]  # from each joint to the tip
    return (
        np.append(links.sum(axis=1), angles[-1]),
        np.stack([-to_tip[1], to_tip[0], np.ones_like(bends)]),
    )


def stretch_links(chain: Chain, target: Array | None) -> Chain:
    """The chain, with links stretched as far as its support needs it, if the rod can stretch."""
    distance = 0.0 if target is None else float(np.hypot(*target[:2]))
    if chain.rod.axial is None or chain.rod.length >= distance:
        return chain
    return replace(chain, lengths=chain.lengths * distance / chain.rod.length)


def start_pose(chain: Chain, target: Array | None, moving: bool = False) -> Array:
    """Joint values (links,) of a rod between its ends; zero where a link has no joint.

    Parameters
    ----------
    chain : Chain
    target : ndarray (3,), optional
        Pose of its support, x, y [m] and angle [rad] seen from its beginning; None: a free tip.
    moving : bool
        Whether a support can move; only then a rod may be straight between pins.

    Raises
    ------
    BadRod
        The rod is shorter than the distance of its supports, or its arc cannot be bent to its
        support.
    """
    rod, bends = chain.rod, chain.first_bends.copy()
    if target is None:
        return bends
    distance, reach = float(np.hypot(*target[:2])), float(chain.vertices[-1])
    straight = abs(reach - distance) <= distance * STRAIGHT_ROD_TOLERANCE and not (
        rod.turn or rod.shape or chain.springs[0]
    )
    if moving and straight and rod.ends[1] == "pinned":
        bends[0] = np.arctan2(target[1], target[0])
        return bends
    if reach < distance * (1.0 + STRAIGHT_ROD_TOLERANCE) and rod.axial is None:
        raise BadRod(
            rod.name,
            "length",
            f"{rod.length:g} m, but its supports are {distance:.6g} m apart; it must be longer, or "
            f"stretch: axial = EA [N]",
        )
    if not chain.springs[0]:
        bends[0] += np.arctan2(target[1], target[0]) - np.arctan2(*tip_pose(chain, bends)[0][1::-1])
    constrained = slice(3 if rod.ends[1] == "clamped" else 2)
    turns = TURN * np.round((bends.sum() - target[2]) / TURN)
    target = target + np.array([0.0, 0.0, turns])
    for _ in range(MAX_CHAIN_ITERATIONS):
        place, slopes = tip_pose(chain, bends)
        if np.abs(target - place)[constrained].max() < CLOSURE_TOLERANCE * max(1.0, rod.length):
            return bends
        move = np.linalg.lstsq(
            (slopes * chain.has_joint)[constrained], (target - place)[constrained], 1e-6
        )[0]
        bends += move * min(1.0, MAX_JOINT_STEP / (np.abs(move).max() or 1.0))
    raise BadRod(
        rod.name,
        "shape" if rod.shape else "turn",
        f"a rod that turns by {rod.shape[-1] if rod.shape else rod.turn:g} rad cannot be bent so "
        f"that it ends at its support; give another {'shape' if rod.shape else 'turn'}",
    )


CONNECT, SITE = mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtObj.mjOBJ_SITE
HINGE, SLIDE = mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE
DEFAULT_MASS = 0.01  # [kg] mass of a rod whose mass is not given
RADIUS_RATIO = 0.004  # radius of the capsules that are drawn, over the rod's length
JOINT_PROPERTIES = {
    "damping": [0.0] * 3,
    "frictionloss": 0.0,
    "armature": 0.0,
    "ref": 0.0,
    "springref": 0.0,
    "limited": mujoco.mjtLimited.mjLIMITED_FALSE,
}
"""Properties of the joints of rods, independent of <default>."""


def joint_names(chain: Chain) -> list[str]:
    """Names of the joints that a rod adds to a model."""
    joints = [
        joint
        for k, name in enumerate(chain.names)
        for joint in (
            *(hinge.name for hinge in chain.hinges(k)),
            *(f"{name}.{axis}" for axis in chain.slides(k)),
        )
    ]
    return [*joints, f"{chain.rod.name}.slider"] if chain.rod.ends[1] == "clamped" else joints


def add_rod(spec: mujoco.MjSpec, bare: mujoco.MjModel, chain: Chain) -> None:
    """Add a rod's links, sites and loops; `bare` is the compiled model without rods."""
    rod, site = chain.rod, bare.site(chain.rod.start)
    body, place, turn = spec.site(rod.start).parent, site.pos, site.quat
    half = rod.length / 2
    starts, ends = chain.vertices[:-1], chain.vertices[1:]
    for k, (name, length, first, last) in enumerate(
        zip(chain.names, chain.lengths, starts, ends, strict=True)
    ):
        slides, reached = chain.slides(k), length / 2 if chain.slides(k) else length
        body = body.add_body(name=name, pos=place, quat=turn)
        for hinge in chain.hinges(k):  # a file without another setting has its angles in degrees
            rest = np.degrees(hinge.rest) if spec.compiler.degree else hinge.rest
            spring_joint(body, hinge.name, HINGE, hinge.axis, hinge.spring, rest)
        parts = [(body, 0.0, reached)]  # bodies, with the begin and end of their parts of the link
        for axis in slides:
            body = body.add_body(name=f"{name}.{axis}", pos=[reached - parts[-1][1], 0, 0])
            stiffness = rod.axial if axis == "x" else rod.shear
            spring_joint(body, body.name, SLIDE, "xyz".index(axis), stiffness / length)
            parts.append((body, reached, length if axis == slides[-1] else reached))
        for part, begin, end in parts:
            set_mass(part, rod, length, len(parts), begin)
            if end > begin:
                add_capsule(part, rod, end - begin)
        middle, at, _ = parts[len(slides) // 2]
        middle.add_site(name=name, pos=[length / 2 - at, 0, 0])
        if first < half <= last:
            if half - first > 0.75 * length:  # at the end of the link
                middle, at, _ = parts[-1]
            middle.add_site(name=f"{rod.name}.middle", pos=[half - first - at, 0, 0])
        place, turn = [length - parts[-1][1], 0, 0], [1, 0, 0, 0]
    tip = body.add_site(name=f"{rod.name}.tip", pos=place)
    if rod.end is not None:
        connect(spec, rod.name, tip.name, rod.end)
    if rod.ends[1] == "clamped":
        constrain_to_axis(spec, bare, rod, body, place[0], chain.lengths[-1])


def spring_joint(
    body: mujoco._specs.MjsBody, name: str, kind: int, axis: int, spring: float, rest: float = 0.0
) -> None:
    """Add a hinge or a slide about or along an axis of a body, with a spring of value `rest`."""
    body.add_joint(
        name=name,
        type=kind,
        axis=np.eye(3)[axis],
        pos=[0, 0, 0],
        stiffness=[spring, 0, 0],
        **{**JOINT_PROPERTIES, "springref": rest},
    )


def set_mass(
    body: mujoco._specs.MjsBody, rod: Rod, length: float, parts: int = 1, begin: float = 0.0
) -> None:
    """Give a body its share of the mass and inertia of a link, which is a slender bar.

    The body is one of `parts` equal ones, and its frame is `begin` [m] beyond the beginning of the
    link.
    """
    mass = (rod.mass or DEFAULT_MASS) * length / rod.length / parts
    across = mass * length**2 / 12
    body.mass, body.ipos, body.explicitinertial = mass, [length / 2 - begin, 0, 0], True
    body.inertia = [across / 2, across, across]


def add_capsule(body: mujoco._specs.MjsBody, rod: Rod, length: float) -> None:
    """Add a capsule of this length [m] to a body, to be drawn only."""
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_CAPSULE,
        fromto=[0, 0, 0, length, 0, 0],
        mass=0,
        size=[RADIUS_RATIO * rod.length, 0, 0],
        contype=0,
        conaffinity=0,
    )


def dead_loads(
    model: mujoco.MjModel, start: mujoco.MjData, rods: Sequence[Rod]
) -> Iterator[tuple[int, Array, Array]]:
    """Bodies of rods with loads per length, and the loads on them.

    These are forces (3,) at the centres of mass [N] and moments (3,) [N m], in the axes of the
    world; `start` has the start pose.
    """
    if any(rod.couple for rod in rods):
        mujoco.mj_kinematics(model, start)
    for rod in rods:
        if any(rod.load) or rod.couple:
            about = start.site(rod.start).xmat.reshape(3, 3)[:, 2]
            for body in map(model.body, chain(rod).bodies):
                length = body.mass[0] / (rod.mass or DEFAULT_MASS) * rod.length
                yield body.id, length * np.array(rod.load), length * rod.couple * about


def connect(spec: mujoco.MjSpec, name: str, one: str, two: str) -> None:
    """Add an equality that constrains two sites to the same position."""
    spec.add_equality(name=name, type=CONNECT, objtype=SITE, name1=one, name2=two)


def constrain_to_axis(
    spec: mujoco.MjSpec,
    bare: mujoco.MjModel,
    rod: Rod,
    last: mujoco._specs.MjsBody,
    end: float,
    length: float,
) -> None:
    """Constrain the last link, whose body ends at `end` [m], to the x axis of the far site."""
    name, ahead = f"{rod.name}.slider", rod.length
    site = bare.site(rod.end)
    carrier = spec.site(rod.end).parent.add_body(name=f"{name}.0", pos=site.pos, quat=site.quat)
    slider = carrier.add_body(name=name, pos=[ahead, 0, 0])
    slider.add_joint(name=name, type=SLIDE, axis=[1, 0, 0], stiffness=[0, 0, 0], **JOINT_PROPERTIES)
    set_mass(slider, rod, length)
    add_capsule(slider, rod, length)
    slider.add_site(name=name)
    last.add_site(name=f"{name}.end", pos=[end + ahead, 0, 0])
    connect(spec, name, f"{name}.end", name)


PLACES = dict.fromkeys(("x", "y", "z"), "m")
PLANAR_PARTS = {**PLACES, "angle": "rad", "moment": "N m"}
"""Curves of a planar rod along its length, with units."""
NORMAL = "normal_x", "normal_y", "normal_z"
MOMENTS = "twist_moment", "bend_moment_y", "bend_moment"
SPATIAL_PARTS = {**PLACES, **dict.fromkeys(NORMAL, "1"), **dict.fromkeys(MOMENTS, "N m")}
"""Curves of a rod in space, with units."""
RodPose = tuple[Array, Array, Array]


def rod_parts(rod: Rod) -> dict[str, str]:
    """Names of the curves of a rod along its length, with units."""
    return SPATIAL_PARTS if rod.spatial else PLANAR_PARTS


def format_rod_parts(rod: Rod) -> str:
    """Text with the names of the curves of a rod, for messages."""
    first, *others, last = rod_parts(rod)
    return f"{', '.join([f'{rod.name}.{first}', *(f'.{o}' for o in others)])} and .{last}"


def rod_channels(run: Run) -> dict[str, tuple[Rod, str]]:
    """The channels of a run that are curves of its rods, with the rod and the part of the name.

    Raises
    ------
    BadModel
        A rod has no such curve.
    """
    rods, found = {rod.name: rod for rod in run.rods}, {}
    for channel in run.channels:
        name, part = split_channel(channel, rods)
        if name in rods:
            if part not in rod_parts(rods[name]):
                there = format_rod_parts(rods[name])
                raise BadModel(f"channel {channel!r}: a rod has {there}, along its length")
            found[channel] = rods[name], part
    return found


def rod_curves(run: Run, pose: Callable[[Chain], RodPose]) -> dict[str, Array]:
    """The curves of all rods of a run over its arc lengths.

    Parameters
    ----------
    run : Run
    pose : callable
        Function of a chain that returns the positions (links + 1, 3) of its vertices [m], and the
        angles [rad] of its links and values [rad] of their joints.  For a chain in space the last
        two are the links' axes (links, 3, 3) as columns, and the moments (links, 3) about the axes
        of the sections at which links begin [N m].
    """
    curves: dict[str, Array] = {}
    poses: Mapping[str, RodPose] = {rod.name: pose(chain(rod)) for rod in run.rods}
    for channel, (rod, part) in rod_channels(run).items():
        curves[channel] = rod_curve(chain(rod), part, poses[rod.name], run.x)
    return curves


def rod_curve(one: Chain, part: str, pose: RodPose, s: Array) -> Array:
    """One curve of a rod at arc lengths s [m]."""
    places, angles, bends = pose
    if part in NORMAL:
        return interpolate(one.nodes, angles[:, NORMAL.index(part), 0], s)
    if part in MOMENTS:
        moments = bends[one.has_joint, MOMENTS.index(part)]
        return interpolate(*extend_to_ends(one, moments), s)
    if part == "angle":
        return interpolate(one.nodes, np.unwrap(angles), s)
    if part == "moment":
        sprung = one.has_joint & (one.springs > 0)
        moments = one.springs[sprung] * (bends - one.rests)[sprung]
        return interpolate(one.vertices[:-1][sprung], moments, s)
    return interpolate(one.vertices, places[:, "xyz".index(part)], s)


def extend_to_ends(one: Chain, moments: Array) -> tuple[Array, Array]:
    """Arc lengths of the joints and ends of a chain in space, and the moments there.

    The moments at both ends are extrapolated by parabolas, or by lines if there are two joints.

    >>> rod = Rod("rod", "clamp", None, 3.0, 1.0, 3, ("clamped", "free"), torsion=1.0)
    >>> [values.tolist() for values in extend_to_ends(chain(rod), np.array([0.25, 2.25, 6.25]))]
    [[0.0, 0.5, 1.5, 2.5, 3.0], [0.0, 0.25, 2.25, 6.25, 9.0]]
    """
    joints = one.vertices[:-1][one.has_joint]
    share = np.array([15.0, -10.0, 3.0]) / 8.0 if joints.size > 2 else np.array([1.5, -0.5])
    begin, end = share @ moments[: share.size], share @ moments[: -share.size - 1 : -1]
    return np.array([0.0, *joints, one.rod.length]), np.array([begin, *moments, end])


def interpolate(nodes: Array, values: Array, s: Array) -> Array:
    """Values at s by linear interpolation between nodes, and extrapolation beyond them."""
    k = np.clip(np.searchsorted(nodes, s) - 1, 0, nodes.size - 2)
    share = (s - nodes[k]) / (nodes[k + 1] - nodes[k])
    return (1 - share) * values[k] + share * values[k + 1]


ClampFrame = tuple[Array, Array]


def compile_with_rods(spec: mujoco.MjSpec, rods: Sequence[Rod]) -> mujoco.MjModel:
    """Add rods to a model and compile it; the rods' start poses are added to its keys.

    Raises
    ------
    BadRod
        A rod that is too short, of an unknown scheme, or on a site that does not exist.
    ValueError
        The model does not compile.
    """
    chains, bare = [chain(rod) for rod in rods], compile_without_rods(spec)
    check_sites(bare, rods)
    if not spec.keys:
        spec.add_key(name="start")
    own_keys = [(np.array(key.qpos), np.array(key.qvel)) for key in spec.keys]
    for key in spec.keys:
        key.qpos, key.qvel = [], []
    for one in chains:
        add_rod(spec, bare, one)
    model = spec.compile()
    fill_keys(model, bare, own_keys, chains)
    return model


def compile_without_rods(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """The compiled model without rods, and without elements that may refer to rods by name.

    ``fusestatic`` is switched off in the spec, since rods begin in the frames of the bodies of the
    file, and all their links, a clamped one too, are looked up by name.
    """
    spec.compiler.fusestatic = False
    bare = spec.copy()
    for element in (*bare.sensors, *bare.actuators, *bare.equalities, *bare.keys):
        bare.delete(element)
    return bare.compile()


def check_sites(bare: mujoco.MjModel, rods: Sequence[Rod]) -> None:
    """Raise `BadRod` for a rod whose site does not exist, or with gravity but without a mass."""
    there = [bare.site(i).name for i in range(bare.nsite)]
    for rod in rods:
        tips = [f"{one.name}.tip" for one in rods if one is not rod and not one.spatial]
        for key, site, known in (("from", rod.start, there), ("to", rod.end, [*there, *tips])):
            if site is not None and site not in known:
                raise BadRod(rod.name, key, f"no site {site!r}; there are: {', '.join(known)}")
        heavy = not bare.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_GRAVITY
        if rod.mass is None and heavy and bare.opt.gravity.any():
            raise BadRod(rod.name, "mass", "missing: gravity acts on it [kg]")


def fill_keys(
    model: mujoco.MjModel, bare: mujoco.MjModel, own_keys: list[ClampFrame], chains: list[Chain]
) -> None:
    """Write all keys: the values of the model's own joints, and the start poses of the rods."""
    added = {model.joint(name).id for one in chains for name in joint_names(one)}
    is_own = np.array([j not in added for j in range(model.njnt)], bool)
    places, rates = (
        np.repeat(is_own, np.diff(np.append(adr, size)))
        for adr, size in ((model.jnt_qposadr, model.nq), (model.jnt_dofadr, model.nv))
    )
    for k, (pose, rate) in enumerate(own_keys):
        if pose.size not in (0, bare.nq):
            raise ValueError(
                f"key {model.key(k).name!r}: qpos has {pose.size} numbers; the joints "
                f"without those of the rods have {bare.nq}"
            )
        data = mujoco.MjData(bare)
        data.qpos[:] = pose if pose.size else bare.qpos0
        mujoco.mj_kinematics(bare, data)
        model.key_qpos[k, places] = data.qpos
        model.key_qvel[k, rates] = rate if rate.size else 0.0
        values = start_poses(bare, data, chains)
        for name, value in values.items():
            model.key_qpos[k, model.joint(name).qposadr[0]] = value
        if rate.any():
            data.qvel[:] = rate
            mujoco.mj_fwdPosition(bare, data)
            mujoco.mj_fwdVelocity(bare, data)
            for name, value in start_rates(bare, data, chains, values).items():
                model.key_qvel[k, model.joint(name).dofadr[0]] = value


def start_poses(bare: mujoco.MjModel, data: mujoco.MjData, chains: list[Chain]) -> dict[str, float]:
    """Values of the rods' joints, in the order of the rods: a rod may end at one before it."""
    frames: dict[str, ClampFrame] = {
        bare.site(i).name: (data.site_xpos[i], data.site_xmat[i].reshape(3, 3))
        for i in range(bare.nsite)
    }
    known, found = set(frames), dict[str, float]()
    for one in chains:
        if one.rod.spatial:
            found |= natural_pose(one)
            continue
        place, turn = frames[one.rod.start]
        target = None
        if one.rod.end is not None:
            if one.rod.end not in frames:
                raise BadRod(
                    one.rod.name,
                    "to",
                    f"rod {one.rod.end.removesuffix('.tip')!r} must be defined before it",
                )
            far, other = frames[one.rod.end]
            x, y, _ = (far - place) @ turn
            cos, sin, _ = other[:, 0] @ turn
            target = np.array([x, y, np.arctan2(sin, cos)])
        longer = stretch_links(one, target)
        moving = any(
            site is not None and bare.body_weldid[bare.site(site).bodyid[0]]
            for site in (one.rod.start, one.rod.end)
            if site in known
        )
        bends = start_pose(longer, target, moving)
        frames[f"{one.rod.name}.tip"] = tip_frame(longer, bends, place, turn)
        found |= {n: float(b) for n, b, j in zip(one.names, bends, one.has_joint, strict=True) if j}
        if one.rod.axial is not None:
            ways = longer.lengths - one.lengths
            found |= {f"{n}.x": float(way) for n, way in zip(one.names, ways, strict=True)}
    return found


def natural_pose(one: Chain) -> dict[str, float]:
    """Joint values of a rod in space without loads, and with the arc of its `turn` about z."""
    return {
        hinge.name: hinge.rest + (float(bend) if hinge.axis == 2 else 0.0)
        for k, bend in enumerate(one.first_bends)
        for hinge in one.hinges(k)
    }


def start_rates(
    bare: mujoco.MjModel, data: mujoco.MjData, chains: list[Chain], values: Mapping[str, float]
) -> dict[str, float]:
    """Rates of the joints of rods whose ends move with sites of the model [rad/s].

    The joints with springs have the least rates that the motion of the ends allows; a straight rod
    between pins rotates as a whole.  Rods that end at other rods, or stretch, start at rest.
    """
    found: dict[str, float] = {}
    for one in chains:
        if one.rod.end is None or one.rod.end.endswith(".tip") or one.rod.axial is not None:
            continue
        near, far = bare.site(one.rod.start).id, bare.site(one.rod.end).id
        turn = data.site_xmat[near].reshape(3, 3)
        moves = np.zeros((2, 6))  # angular, linear
        for site, move in zip((near, far), moves, strict=True):
            mujoco.mj_objectVelocity(bare, data, SITE, site, move, 0)
        carried = np.cross(moves[0, :3], data.site_xpos[far] - data.site_xpos[near])
        x, y, _ = (moves[1, 3:] - moves[0, 3:] - carried) @ turn
        wanted = np.array([x, y, (moves[1, :3] - moves[0, :3]) @ turn[:, 2]])
        bends = np.array([values.get(name, 0.0) for name in one.names])
        constrained = slice(3 if one.rod.ends[1] == "clamped" else 2)
        slopes, wanted = (tip_pose(one, bends)[1] * one.has_joint)[constrained], wanted[constrained]
        free = one.springs == 0.0
        by_pins = slopes[:, free] @ np.linalg.pinv(slopes[:, free])  # motions by the pin alone
        rates = np.zeros(one.lengths.size)
        rest = np.eye(len(wanted)) - by_pins
        matrix = rest @ slopes[:, ~free]
        matrix[np.abs(matrix) < STRAIGHT_ROD_TOLERANCE * one.rod.length] = 0.0  # rounding
        rates[~free] = np.linalg.lstsq(matrix, rest @ wanted, 1e-6)[0]
        rates[free] = np.linalg.pinv(slopes[:, free]) @ (wanted - slopes @ rates)
        found |= {n: float(r) for n, r, j in zip(one.names, rates, one.has_joint, strict=True) if j}
    return found


def tip_frame(chain: Chain, bends: Array, place: Array, turn: Array) -> ClampFrame:
    """Position and orientation of a rod's tip; `place` and `turn` are those of its beginning."""
    (x, y, angle), _ = tip_pose(chain, bends)
    cos, sin = np.cos(angle), np.sin(angle)
    rotation = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    return place + turn @ [x, y, 0.0], turn @ rotation
