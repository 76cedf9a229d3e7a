"""The numbers of an MJCF that a run computes with, and the same file with some of them changed.

A number stands in an attribute of an element, whether the file states it or leaves it to a default.
`numbers_of` lists those that can act on a motion in the plane of a planar mechanism: masses,
inertias, places, directions, springs, dampers, friction, ranges, gravity, loads, and how hard loops
and stops are held.  Left out are what is drawn only, places normal to the plane, and what the
engine is set to: time step, integrator, iterations.

`written` changes the elements' attributes and leaves the rest of the file as it is.  MuJoCo's own
writer is not used: it rounds to six digits, and does not take a model that waits for its rods.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import mujoco
import numpy as np

from proofmass.analytic.numerics import Array
from proofmass.sim.contents import SCALARS, joint_of
from proofmass.sim.mjcf import LEFT_OUT, OFF, compile_model, leave_out_disabled, read_tree
from proofmass.sim.plane import find_plane
from proofmass.sim.protocol import BadModel, Rod, Unsupported
from proofmass.sim.rods import without_links_to_rods

SHARE = 0.1
"""Of a number, or of its natural size where it is 0: the change that is tried."""
LOOSE = 1e-9
"""Of a unit vector: a part that counts as none."""
NONE = 1e-12
"""Of a natural size: a number that counts as 0."""
S, OBJ = mujoco.mjtSensor, mujoco.mjtObj
ORIENTATIONS = "quat", "euler", "axisangle", "xyaxes", "zaxis"
COPIES = "include", "replicate", "attach", "composite", "flexcomp"
"""Elements by which a file has others than those it states one by one."""
DIRECTED = (S.mjSENS_FRAMEXAXIS, S.mjSENS_FRAMEYAXIS, S.mjSENS_FRAMEZAXIS, S.mjSENS_FRAMEQUAT)
OWN_FRAME = (
    S.mjSENS_ACCELEROMETER,
    S.mjSENS_VELOCIMETER,
    S.mjSENS_GYRO,
    S.mjSENS_FORCE,
    S.mjSENS_TORQUE,
    S.mjSENS_MAGNETOMETER,
)
LIMITS = "solreflimit", "solimplimit"
FIELDS = {
    ("inertial", "pos"): "body_ipos",
    ("inertial", "mass"): "body_mass",
    ("body", "pos"): "body_pos",
    ("site", "pos"): "site_pos",
    ("joint", "pos"): "jnt_pos",
    ("joint", "range"): "jnt_range",
    ("joint", "solreflimit"): "jnt_solref",
    ("joint", "solimplimit"): "jnt_solimp",
    ("equality", "solref"): "eq_solref",
    ("equality", "solimp"): "eq_solimp",
    ("key", "qpos"): "key_qpos",
    ("key", "qvel"): "key_qvel",
    ("key", "ctrl"): "key_ctrl",
}
"""Where the compiled model has the numbers of an attribute."""
OF_DOFS = {"damping": "dof_damping", "armature": "dof_armature", "frictionloss": "dof_frictionloss"}


class NotWritten(BadModel):
    """The file states its elements in a way that cannot be changed number by number."""


@dataclass(frozen=True)
class Place:
    """Where a number stands: an attribute of element number `index` of its tag.

    `part` is the component; of ``turn`` and ``inertia``, which are no attributes, it has no
    meaning: they turn a frame in the plane [rad], and multiply an inertia by 1 + the change.  `rod`
    is the name of the rod whose key of the sidecar it is.
    """

    tag: str
    index: int
    attribute: str
    part: int = 0
    rod: str = ""


@dataclass(frozen=True)
class Number:
    """A number of a model.

    Attributes
    ----------
    kind : str
        What it is, such as ``mass``: numbers of a kind are tried together.
    of : str
        The element that has it, and the part of it.
    value : float
        [its unit]; 1 of an inertia, which is changed as a whole.
    unit : str
        SI unit; that of a share is 1.
    step : float
        The change that is tried [its unit].
    place : Place
    """

    kind: str
    of: str
    value: float
    unit: str
    step: float
    place: Place

    @property
    def name(self) -> str:
        """Kind and element, in words."""
        return f"{self.kind} of {self.of}" if self.of else self.kind

    @property
    def relative(self) -> bool:
        """Whether a change of it is told as a share of its value."""
        return self.value != 0.0


@dataclass(frozen=True)
class Sizes:
    """Natural sizes: what a number is measured by where it is 0."""

    length: float
    mass: float
    time: float

    def of(self, hinge: bool, mass: int, time: int) -> float:
        """Mass^m time^t, times length^2 where it acts on a hinge."""
        return self.mass**mass * self.time**time * (self.length**2 if hinge else 1.0)


@dataclass(frozen=True, eq=False)
class Source:
    """An MJCF file and what it compiles to.

    Attributes
    ----------
    path : Path
    full, bare : MjModel
        With its rods, and without them: the same where it has none.
    key : str
        The start pose.
    rods : tuple of Rod
        Those that it has as chains.
    """

    path: Path
    full: mujoco.MjModel
    bare: mujoco.MjModel
    key: str
    rods: tuple[Rod, ...] = ()

    @cached_property
    def normal(self) -> Array | None:
        """The normal of the plane of motion in the world; None if there is none."""
        try:
            return find_plane(self.full, self.posed(self.full)).normal if self.full.njnt else None
        except Unsupported:
            return None

    @cached_property
    def data(self) -> mujoco.MjData:
        """The start pose without rods."""
        return self.posed(self.bare)

    def posed(self, model: mujoco.MjModel) -> mujoco.MjData:
        """A model in its start pose."""
        data = mujoco.MjData(model)
        names = [model.key(k).name for k in range(model.nkey)]
        if self.key in names:
            mujoco.mj_resetDataKeyframe(model, data, names.index(self.key))
        mujoco.mj_kinematics(model, data)
        return data

    def parts(self, frame: Array) -> list[int]:
        """The axes of a frame (3, 3) that are not normal to the plane of motion."""
        if self.normal is None:
            return [0, 1, 2]
        return [k for k in range(3) if abs(abs(frame[:, k] @ self.normal) - 1.0) > LOOSE]

    def frame(self, body: int) -> Array:
        """Axes of a body's frame in the world (3, 3), as columns."""
        return np.asarray(self.data.xmat[body]).reshape(3, 3)

    @cached_property
    def start(self) -> int:
        """Number of the start key; -1 if there is none."""
        names = [self.full.key(k).name for k in range(self.full.nkey)]
        return names.index(self.key) if self.key in names else -1


def source_of(path: Path, key: str, rods: tuple[Rod, ...] = ()) -> Source:
    """Compile a file to what its numbers are read from."""
    full = compile_model(path, rods)
    if not rods:
        return Source(path, full, full, key)
    bare = without_links_to_rods(mujoco.MjSpec.from_file(str(path)))
    leave_out_disabled(bare)
    return Source(path, full, bare, key, rods)


def numbers_of(source: Source, sizes: Sizes, driven: Sequence[str] = ()) -> list[Number]:
    """The numbers of a model, kind by kind.

    Parameters
    ----------
    source : Source
    sizes : Sizes
        What a number that is 0 is changed by.
    driven : sequence of str
        Joints that are driven; without any the start values are numbers as well.

    Raises
    ------
    NotWritten
        See `written`.
    """
    Tree(source)  # which says whether the file can be changed
    found = [
        *of_bodies(source, sizes),
        *of_joints(source, sizes),
        *of_sites(source, sizes),
        *of_world(source, sizes),
        *of_equalities(source, sizes),
        *of_actuators(source, sizes, driven),
        *(() if driven else of_start(source, sizes)),
        *of_rods(source),
    ]
    return sorted(found, key=lambda number: list(KINDS).index(number.kind))


KINDS = {
    "length": "m",
    "stiffness of a rod": "N m^2",
    "mass of a rod": "kg",
    "place": "m",
    "anchor": "m",
    "site": "m",
    "direction": "rad",
    "zero": "rad",
    "coupling": "1",
    "start value": "rad",
    "start rate": "rad/s",
    "mass": "kg",
    "centre of mass": "m",
    "inertia": "1",
    "gravity": "m/s^2",
    "load": "1",
    "gear": "1",
    "gain": "1",
    "stiffness": "N m",
    "rest angle": "rad",
    "range": "rad",
    "damping": "N m s",
    "armature": "kg m^2",
    "friction": "N m",
    "softness of the loop": "1",
    "softness of the stop": "1",
}
"""Kinds of numbers in the order in which they are told, and the unit of most."""


def measured(
    kind: str, of: str, value: float, place: Place, natural: float, unit: str = ""
) -> Number:
    """A number with the change that is tried: a share of it, or of its natural size."""
    value = value if abs(value) > NONE * natural else 0.0
    return Number(kind, of, value, unit or KINDS[kind], SHARE * (abs(value) or natural), place)


def called(model: mujoco.MjModel, what: str, index: int) -> str:
    """The name of an element; its number if it has none."""
    return getattr(model, what)(index).name or f"number {index + 1}"


def moving(model: mujoco.MjModel) -> list[int]:
    """The bodies that joints move."""
    return [b for b in range(1, model.nbody) if model.body_weldid[b] != 0]


def of_bodies(source: Source, sizes: Sizes) -> Iterator[Number]:
    """Where bodies hang, how they are turned, what they weigh."""
    model = source.bare
    for b in range(1, model.nbody):
        name, parent = called(model, "body", b), int(model.body_parentid[b])
        for k in source.parts(source.frame(parent)):
            value = float(model.body_pos[b, k])
            yield measured(
                "place", f"{name} {'xyz'[k]}", value, Place("body", b, "pos", k), sizes.length
            )
        yield measured("direction", f"body {name}", 0.0, Place("body", b, "turn"), 1.0)
    for b in moving(model):
        name = called(model, "body", b)
        yield measured(
            "mass", name, float(model.body_mass[b]), Place("inertial", b, "mass"), sizes.mass
        )
        yield measured("inertia", name, 1.0, Place("inertial", b, "inertia"), 1.0)
        for k in source.parts(source.frame(b)):
            value = float(model.body_ipos[b, k])
            yield measured(
                "centre of mass",
                f"{name} {'xyz'[k]}",
                value,
                Place("inertial", b, "pos", k),
                sizes.length,
            )


def acting(model: mujoco.MjModel, field: str) -> bool:
    """Whether no disable flag turns off what a field of the compiled model stands for."""
    return not any(
        field in fields and model.opt.disableflags & int(flag) for flag, fields in LEFT_OUT.items()
    )


def of_joints(source: Source, sizes: Sizes) -> Iterator[Number]:
    """Anchors, directions and zeros of hinges and slides, and what acts in them."""
    model = source.bare
    for j in range(model.njnt):
        if (unit := SCALARS.get(mujoco.mjtJoint(int(model.jnt_type[j])))) is None:
            continue
        hinge, name, body = unit == "rad", called(model, "joint", j), int(model.jnt_bodyid[j])
        own, dof, adr = 1.0 if hinge else sizes.length, model.jnt_dofadr[j], model.jnt_qposadr[j]
        if hinge:
            for k in source.parts(source.frame(body)):
                yield measured(
                    "anchor",
                    f"joint {name} {'xyz'[k]}",
                    float(model.jnt_pos[j, k]),
                    Place("joint", j, "pos", k),
                    sizes.length,
                )
        else:
            yield measured("direction", f"joint {name}", 0.0, Place("joint", j, "turn"), 1.0)
        yield measured("zero", name, float(model.qpos0[adr]), Place("joint", j, "ref"), own, unit)
        yield from springs(source, sizes, j, name, hinge)
        for attribute, kind, mass, time, of_it in (
            ("damping", "damping", 1, -1, "N m s" if hinge else "N s/m"),
            ("armature", "armature", 1, 0, "kg m^2" if hinge else "kg"),
            ("frictionloss", "friction", 1, -2, "N m" if hinge else "N"),
        ):
            natural = sizes.of(hinge, mass, time) * (own if attribute == "frictionloss" else 1.0)
            if acting(model, OF_DOFS[attribute]):
                value = float(getattr(model, OF_DOFS[attribute])[dof])
                yield measured(kind, name, value, Place("joint", j, attribute), natural, of_it)
        if model.jnt_limited[j]:
            for k, end in enumerate(("low", "high")):
                yield measured(
                    "range",
                    f"{name} {end}",
                    float(model.jnt_range[j, k]),
                    Place("joint", j, "range", k),
                    own,
                    unit,
                )
            for attribute in LIMITS:
                yield from soft(
                    "softness of the stop",
                    name,
                    Place("joint", j, attribute),
                    getattr(model, FIELDS["joint", attribute])[j],
                )


def springs(source: Source, sizes: Sizes, j: int, name: str, hinge: bool) -> Iterator[Number]:
    """Stiffness of a joint with its polynomial, and where the spring is at rest."""
    model = source.bare
    if not acting(model, "jnt_stiffness"):
        return
    values = [float(model.jnt_stiffness[j]), *map(float, model.jnt_stiffnesspoly[j])]
    for k, value in enumerate(values):
        if value or not k:
            power = f" {k + 1}" if k else ""
            unit = ("N m/rad" if hinge else "N/m") + (f"^{k + 1}" if k else "")
            place = Place("joint", j, "stiffness", k)
            yield measured("stiffness", name + power, value, place, sizes.of(hinge, 1, -2), unit)
    if any(values):
        value = float(model.qpos_spring[model.jnt_qposadr[j]])
        place = Place("joint", j, "springref")
        own = 1.0 if hinge else sizes.length
        yield measured("rest angle", name, value, place, own, "rad" if hinge else "m")


def soft(kind: str, name: str, place: Place, values: Iterable[float]) -> Iterator[Number]:
    """Numbers of a solref or solimp; those that are 0 have no meaning, or are a choice."""
    for k, value in enumerate(values):
        if value:
            of = f"{name}, {place.attribute.removesuffix('limit')} {k + 1}"
            yield measured(kind, of, float(value), replace(place, part=k), 1.0)


def read_sites(source: Source) -> dict[int, bool]:
    """The sites that something reads or that hold something, and whether their directions count."""
    full, bare, found = source.full, source.bare, dict[int, bool]()
    names = {bare.site(s).name: s for s in range(bare.nsite)}

    def use(site: int, directed: bool) -> None:
        if (s := names.get(full.site(site).name)) is not None:
            found[s] = found.get(s, False) or directed

    for i in range(full.nsensor):
        kind = S(int(full.sensor_type[i]))
        if full.sensor_objtype[i] == OBJ.mjOBJ_SITE:
            use(int(full.sensor_objid[i]), kind in DIRECTED or kind in OWN_FRAME)
        if full.sensor_reftype[i] == OBJ.mjOBJ_SITE:
            use(int(full.sensor_refid[i]), True)
    for e in range(full.neq):
        if full.eq_objtype[e] == OBJ.mjOBJ_SITE:
            for site in (full.eq_obj1id[e], full.eq_obj2id[e]):
                use(int(site), full.eq_type[e] != mujoco.mjtEq.mjEQ_CONNECT)
    for a in range(full.nactuator):
        if full.actuator_trntype[a] == mujoco.mjtTrn.mjTRN_SITE:
            for site in full.actuator_trnid[a]:
                if site >= 0:
                    use(int(site), True)
    for rod in source.rods:
        for site, end in zip((rod.start, rod.end), rod.ends, strict=True):
            if site in names:
                found[names[site]] = found.get(names[site], False) or end == "clamped"
    return found


def of_sites(source: Source, sizes: Sizes) -> Iterator[Number]:
    """Places, and directions where they count, of sites that something names."""
    model = source.bare
    for s, directed in sorted(read_sites(source).items()):
        name = called(model, "site", s)
        for k in source.parts(source.frame(int(model.site_bodyid[s]))):
            value = float(model.site_pos[s, k])
            yield measured(
                "site", f"{name} {'xyz'[k]}", value, Place("site", s, "pos", k), sizes.length
            )
        if directed:
            yield measured("direction", f"site {name}", 0.0, Place("site", s, "turn"), 1.0)


def of_world(source: Source, sizes: Sizes) -> Iterator[Number]:
    """Gravity in the plane."""
    gravity = source.full.opt.gravity
    if source.full.opt.disableflags & int(OFF.mjDSBL_GRAVITY):
        return
    natural = float(np.linalg.norm(gravity)) or sizes.length * sizes.time**-2
    for k in source.parts(np.eye(3)):
        yield measured(
            "gravity", "xyz"[k], float(gravity[k]), Place("option", 0, "gravity", k), natural
        )


def of_equalities(source: Source, sizes: Sizes) -> Iterator[Number]:
    """Points of loops that no site has, polynomials of coupled joints, and how hard loops are."""
    model = source.full
    own = len(Tree(source).found["equality"])
    for e in range(own):
        if not model.eq_active0[e] or not acting(model, "eq_active0"):
            continue
        name, kind = called(model, "equality", e), model.eq_type[e]
        if kind == mujoco.mjtEq.mjEQ_CONNECT and model.eq_objtype[e] == OBJ.mjOBJ_BODY:
            for k in source.parts(source.frame(int(model.eq_obj1id[e]))):
                yield measured(
                    "anchor",
                    f"loop {name} {'xyz'[k]}",
                    float(model.eq_data[e, k]),
                    Place("equality", e, "anchor", k),
                    sizes.length,
                )
        if kind == mujoco.mjtEq.mjEQ_JOINT:
            for k in range(5):
                value = float(model.eq_data[e, k])
                if value or not k:
                    place = Place("equality", e, "polycoef", k)
                    yield measured("coupling", f"{name} {k}", value, place, 1.0)
        for attribute in ("solref", "solimp"):
            yield from soft(
                "softness of the loop",
                name,
                Place("equality", e, attribute),
                getattr(model, f"eq_{attribute}")[e],
            )


def of_actuators(source: Source, sizes: Sizes, driven: Sequence[str]) -> Iterator[Number]:
    """Gears, gains, and the constant loads of actuators that drive nothing."""
    model = source.full
    elements = Tree(source).found["actuator"]
    for a in range(model.nactuator):
        name, joint = called(model, "actuator", a), joint_of(model, a)
        for k, value in enumerate(model.actuator_gear[model.actuator_outadr[a]]):
            if value and (joint < 0 or not k):
                of = name if joint >= 0 else f"{name} {k + 1}"
                place = Place("actuator", a, "gear", k)
                yield measured("gear", of, float(value), place, 1.0)
        for attribute in ("gainprm", "biasprm", "kp", "kv"):
            element = elements[a]
            words = [] if element is None else element.get(attribute, "").split()
            for k, value in enumerate(map(float, words)):
                if value:
                    place = Place("actuator", a, attribute, k)
                    yield measured("gain", f"{name}, {attribute} {k + 1}", value, place, 1.0)
        if source.start >= 0 and (joint < 0 or model.joint(joint).name not in driven):
            adr = int(model.actuator_ctrladr[a])
            hinge = joint >= 0 and SCALARS.get(mujoco.mjtJoint(int(model.jnt_type[joint]))) == "rad"
            natural = sizes.of(hinge, 1, -2) * (1.0 if hinge else sizes.length)
            place = Place("key", source.start, "ctrl", adr)
            yield measured("load", name, float(model.key_ctrl[source.start, adr]), place, natural)


def of_start(source: Source, sizes: Sizes) -> Iterator[Number]:
    """Values and rates of the joints in the start key, which a free motion begins with."""
    model, key = source.bare, source.start
    if key < 0:
        return
    for j in range(model.njnt):
        unit = SCALARS.get(mujoco.mjtJoint(int(model.jnt_type[j])))
        if unit is None:
            continue
        name, own = called(model, "joint", j), 1.0 if unit == "rad" else sizes.length
        q, v = int(model.jnt_qposadr[j]), int(model.jnt_dofadr[j])
        place = Place("key", key, "qpos", q)
        yield measured("start value", name, float(model.key_qpos[key, q]), place, own, unit)
        place, natural = Place("key", key, "qvel", v), own / sizes.time
        value = float(model.key_qvel[key, v])
        yield measured("start rate", name, value, place, natural, f"{unit}/s")


def of_rods(source: Source) -> Iterator[Number]:
    """What the sidecar says of the rods."""
    for k, rod in enumerate(source.rods):
        for kind, attribute in (
            ("length", "length"),
            ("stiffness of a rod", "stiffness"),
            ("mass of a rod", "mass"),
        ):
            if (value := getattr(rod, attribute)) is not None:
                place = Place("rod", k, attribute, rod=rod.name)
                yield measured(kind, rod.name, float(value), place, 1.0)


class Tree:
    """The elements of a file, by their numbers in the compiled model.

    `found` has None for an element within a ``frame``, whose numbers are not those of the body.
    """

    def __init__(self, source: Source) -> None:
        self.source, self.path = source, source.path
        self.root = read_tree(source.path)
        for tag in COPIES:
            if self.root.find(f".//{tag}") is not None:
                raise NotWritten(
                    f"{self.path.name}: the numbers of a model with <{tag}> are not tried"
                )
        compiler = [c.attrib for c in self.root.findall("compiler")]
        self.compiler: Mapping[str, str] = {k: v for one in compiler for k, v in one.items()}
        for key in ("settotalmass", "inertiafromgeom", "coordinate"):
            if self.compiler.get(key, "auto") not in ("auto", "-1", "local"):
                raise NotWritten(
                    f"{self.path.name}: the numbers of a model with {key} = "
                    f"{self.compiler[key]!r} are not tried"
                )
        self.found: dict[str, list[Element | None]] = {tag: [] for tag in ("joint", "site")}
        self.found["body"] = []
        self.inside: set[int] = set()
        for world in self.root.findall("worldbody"):
            self.walk(world, framed=False)
        sections = {"equality": "equality", "actuator": "actuator", "key": "keyframe"}
        for tag, section in sections.items():
            self.found[tag] = [e for part in self.root.findall(section) for e in part]
        self.refuse_other_counts()

    def walk(self, body: Element, framed: bool) -> None:
        """Number a body, what it has, and then the bodies that hang on it."""
        self.found["body"].append(None if framed else body)
        later: list[tuple[Element, bool]] = []

        def look(place: Element, framed: bool) -> None:
            for child in place:
                kept = None if framed else child
                if child.tag in ("joint", "freejoint"):
                    self.found["joint"].append(kept)
                elif child.tag == "site":
                    self.found["site"].append(kept)
                elif child.tag == "body":
                    later.append((child, framed))
                elif child.tag == "frame":
                    look(child, True)

        look(body, False)
        for child, within in later:
            self.walk(child, within)

    def refuse_other_counts(self) -> None:
        """Raise NotWritten where the file has others than the compiled model."""
        bare, full = self.source.bare, self.source.full
        added = sum(1 + (rod.ends[1] == "clamped") for rod in self.source.rods if rod.end)
        for tag, count in (
            ("body", bare.nbody),
            ("joint", bare.njnt),
            ("site", bare.nsite),
            ("equality", full.neq - added),
            ("actuator", full.nactuator),
        ):
            if len(self.found[tag]) != count:
                raise NotWritten(
                    f"{self.path.name}: it states {len(self.found[tag])} <{tag}> one by one, and "
                    f"compiles to {count}; its numbers are not tried"
                )

    def element(self, place: Place) -> Element:
        """The element of a number; an ``option`` or ``inertial`` that is missing is added."""
        if place.tag == "option":
            option = self.root.find("option")
            return ElementTree.SubElement(self.root, "option") if option is None else option
        tag = "body" if place.tag == "inertial" else place.tag
        element = self.found[tag][place.index]
        if element is None:
            raise NotWritten(f"{self.path.name}: the numbers of a <{tag}> in a frame are not tried")
        if place.tag != "inertial":
            return element
        inertial = element.find("inertial")
        return ElementTree.SubElement(element, "inertial") if inertial is None else inertial


def written(source: Source, changes: Sequence[tuple[Number, float]]) -> str:
    """The text of the file with numbers changed by so much; those of rods are not in it.

    Raises
    ------
    NotWritten
        Elements come from includes, copies or frames, so that the file does not state them.
    """
    tree, by_element = Tree(source), dict[tuple[str, int], dict[tuple[str, int], float]]()
    for number, change in changes:
        place = number.place
        if place.tag != "rod":
            own = by_element.setdefault((place.tag, place.index), {})
            own[place.attribute, place.part] = own.get((place.attribute, place.part), 0.0) + change
    for (tag, index), own in by_element.items():
        element = tree.element(Place(tag, index, ""))
        if tag == "inertial":
            weigh(source.bare, element, index, own)
            continue
        for attribute in dict.fromkeys(attribute for attribute, _ in own):
            parts = {part: by for (name, part), by in own.items() if name == attribute}
            if attribute == "turn":
                turn(source, element, tag, index, parts[0])
            else:
                add(source, tree, element, Place(tag, index, attribute), parts)
    for compiler in tree.root.findall("compiler"):
        for key in ("meshdir", "texturedir", "assetdir"):
            if key in compiler.attrib:
                folder = source.path.parent / compiler.attrib[key]
                compiler.set(key, str(folder.absolute()))
    return ElementTree.tostring(tree.root, encoding="unicode")


def told(values: Iterable[float]) -> str:
    """Numbers of an attribute, with all digits."""
    return " ".join(repr(float(value)) for value in values)


def weigh(
    model: mujoco.MjModel, element: Element, b: int, by: Mapping[tuple[str, int], float]
) -> None:
    """Write mass, centre and inertia of a body, which the file may leave to its geoms."""
    for key in (*ORIENTATIONS, "fullinertia"):
        element.attrib.pop(key, None)
    centre = np.array(model.body_ipos[b])
    for k in range(3):
        centre[k] += by.get(("pos", k), 0.0)
    element.set("pos", told(centre))
    element.set("quat", told(model.body_iquat[b]))
    element.set("mass", told([model.body_mass[b] + by.get(("mass", 0), 0.0)]))
    factor = 1.0 + by.get(("inertia", 0), 0.0)
    element.set("diaginertia", told(model.body_inertia[b] * factor))


def turn(source: Source, element: Element, tag: str, index: int, angle: float) -> None:
    """Turn a body, a site or the axis of a slide about the normal of the plane."""
    model, normal = source.bare, source.normal
    normal = np.array([0.0, 0.0, 1.0]) if normal is None else normal
    owner = {"body": model.body_parentid, "site": model.site_bodyid, "joint": model.jnt_bodyid}
    local = source.frame(int(owner[tag][index])).T @ normal
    about = np.append(math.cos(angle / 2), math.sin(angle / 2) * local)
    if tag == "joint":
        axis = np.zeros(3)
        mujoco.mju_rotVecQuat(axis, np.array(model.jnt_axis[index]), about)
        element.set("axis", told(axis))
        return
    found = np.zeros(4)
    mujoco.mju_mulQuat(found, about, np.array(getattr(model, f"{tag}_quat")[index]))
    for key in ORIENTATIONS:
        element.attrib.pop(key, None)
    element.set("quat", told(found))


def add(
    source: Source, tree: Tree, element: Element, place: Place, by: Mapping[int, float]
) -> None:
    """Add to components of an attribute, which the file may leave to a default."""
    values = np.array(present(source, element, place), float)
    for part, change in by.items():
        values[part] += change
    if place.tag == "joint" and place.attribute in ("ref", "springref", "range"):
        hinge = source.bare.jnt_type[place.index] == mujoco.mjtJoint.mjJNT_HINGE
        if hinge and tree.compiler.get("angle", "degree") == "degree":
            values = np.degrees(values)
    if place.tag == "joint" and place.attribute == "range" and "limited" not in element.attrib:
        element.set("limited", "true")
    element.set(place.attribute, told(values))


def present(source: Source, element: Element, place: Place) -> Any:
    """The numbers of an attribute as they are compiled, those of a hinge in radians."""
    tag, i, attribute = place.tag, place.index, place.attribute
    bare, full = source.bare, source.full
    if (tag, attribute) in FIELDS:
        model = full if tag == "equality" or attribute == "ctrl" else bare
        return getattr(model, FIELDS[tag, attribute])[i]
    if tag == "option":
        return full.opt.gravity
    if tag == "equality":
        return full.eq_data[i, : 3 if attribute == "anchor" else 5]
    if attribute == "gear":
        return full.actuator_gear[full.actuator_outadr[i]]
    if tag == "actuator":
        return [float(word) for word in element.get(attribute, "").split()]
    if attribute in OF_DOFS:
        return [getattr(bare, OF_DOFS[attribute])[bare.jnt_dofadr[i]]]
    if attribute == "stiffness":
        values = [bare.jnt_stiffness[i], *bare.jnt_stiffnesspoly[i]]
        return values if any(values[1:]) else values[:1]
    field = {"ref": bare.qpos0, "springref": bare.qpos_spring}[attribute]
    return [field[bare.jnt_qposadr[i]]]


def changed_rods(
    rods: Sequence[Rod], changes: Sequence[tuple[Number, float]]
) -> dict[str, dict[str, float]]:
    """The keys of rods that changes are of, and their new values."""
    found: dict[str, dict[str, float]] = {}
    for number, change in changes:
        if number.place.tag == "rod":
            (rod,) = (one for one in rods if one.name == number.place.rod)
            own = found.setdefault(rod.name, {})
            key = number.place.attribute
            own[key] = own.get(key, getattr(rod, key)) + change
    return found
