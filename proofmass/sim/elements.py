"""The elements of an MJCF file by their numbers, and the file with some of its numbers changed.

A number is part of an attribute of an element, which the file may state or leave to a default.
`write_changes` changes attributes and leaves the rest of the file as it is.  MuJoCo's own writer is
not used, since it rounds to six digits and does not accept a model whose rods are still missing.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import mujoco
import numpy as np

from proofmass.base.arrays import Array
from proofmass.base.lines import WrittenValue, attribute_value
from proofmass.sim.contents import key_names, pose_of_key
from proofmass.sim.mjcf import compile_model, leave_out_disabled, read_spec, read_tree
from proofmass.sim.plane import find_plane
from proofmass.sim.protocol.failures import BadModel, Unsupported
from proofmass.sim.protocol.run import Rod
from proofmass.sim.rods import chain, compile_without_rods, joint_names

NORMAL_TOLERANCE = 1e-9
"""Component of a unit vector [1] below which it counts as zero."""
ORIENTATIONS = "quat", "euler", "axisangle", "xyaxes", "zaxis"
COPYING_TAGS = "include", "replicate", "attach", "composite", "flexcomp"
"""Elements that add elements to a model which its file does not state one by one."""
COMPILED_FIELDS = {
    ("inertial", "pos"): "body_ipos",
    ("inertial", "mass"): "body_mass",
    ("body", "pos"): "body_pos",
    ("site", "pos"): "site_pos",
    ("joint", "pos"): "jnt_pos",
    ("joint", "axis"): "jnt_axis",
    ("joint", "range"): "jnt_range",
    ("joint", "solreflimit"): "jnt_solref",
    ("joint", "solimplimit"): "jnt_solimp",
    ("equality", "solref"): "eq_solref",
    ("equality", "solimp"): "eq_solimp",
    ("tendon", "stiffness"): "tendon_stiffness",
    ("tendon", "damping"): "tendon_damping",
    ("tendon", "springlength"): "tendon_lengthspring",
    ("key", "qpos"): "key_qpos",
    ("key", "qvel"): "key_qvel",
    ("key", "ctrl"): "key_ctrl",
}
"""Fields of the compiled model with the numbers of an attribute."""
DOF_FIELDS = {
    "damping": "dof_damping",
    "armature": "dof_armature",
    "frictionloss": "dof_frictionloss",
}


class NotWritten(BadModel):
    """The file states its elements in a way that cannot be changed number by number."""


@dataclass(frozen=True)
class Place:
    """The place of a number: an attribute of element number `index` of its tag.

    `part` is the component of the attribute.  It has no meaning for "turn" and "inertia", which
    are not attributes: a change of "turn" rotates a frame in the plane [rad], and a change of
    "inertia" multiplies an inertia by 1 + the change.  `rod` is the name of the rod, if the
    number is a key of a rod in the sidecar.
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
        Its kind, such as ``mass``; all numbers of a kind are changed together.
    of : str
        The element, and the component, to which it belongs.
    value : float
        Its value [its unit]; 1 for an inertia, which is changed as a whole.
    unit : str
        SI unit; 1 for a share.
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
        """Kind and element, for messages."""
        return f"{self.kind} of {self.of}" if self.of else self.kind

    @property
    def relative(self) -> bool:
        """Whether a change is stated as a share of the value, which is then not 0."""
        return self.value != 0.0


@dataclass(frozen=True, eq=False)
class Source:
    """An MJCF file and its compiled models.

    Attributes
    ----------
    path : Path
    full, bare : MjModel
        The model with its rods, and without them; the same object if there are none.
    key : str
        Name of the key with the start pose.
    rods : tuple of Rod
        Rods that the model has as chains of links.
    """

    path: Path
    full: mujoco.MjModel
    bare: mujoco.MjModel
    key: str
    rods: tuple[Rod, ...] = ()

    @cached_property
    def normal(self) -> Array | None:
        """The normal of the plane of motion in the world; None if there is none."""
        if not self.full.njnt:
            return None
        try:
            return find_plane(self.full, pose_of_key(self.full, self.key)).normal
        except Unsupported:
            return None

    @cached_property
    def data(self) -> mujoco.MjData:
        """The data of the model without rods, in the start pose."""
        return pose_of_key(self.bare, self.key)

    def parts(self, frame: Array) -> list[int]:
        """The axes of a frame (3, 3) that are not normal to the plane of motion."""
        if self.normal is None:
            return [0, 1, 2]
        return [k for k in range(3) if abs(abs(frame[:, k] @ self.normal) - 1.0) > NORMAL_TOLERANCE]

    def frame(self, body: int) -> Array:
        """Axes of a body's frame in the world (3, 3), as columns."""
        return np.asarray(self.data.xmat[body]).reshape(3, 3)

    @cached_property
    def start(self) -> int:
        """Number of the start key; -1 if there is none."""
        names = key_names(self.full)
        return names.index(self.key) if self.key in names else -1


def compile_source(path: Path, key: str, rods: tuple[Rod, ...] = ()) -> Source:
    """Compile a file, with and without its rods."""
    full = compile_model(path, rods)
    if not rods:
        return Source(path, full, full, key)
    bare = compile_without_rods(read_spec(path))
    leave_out_disabled(bare)
    return Source(path, full, bare, key, rods)


class ModelElements:
    """The elements of a file, by tag and by their numbers in the compiled model.

    `found` has None for an element within a ``frame``, whose numbers differ from the compiled ones.
    """

    def __init__(self, source: Source) -> None:
        self.source, self.path = source, source.path
        self.root = read_tree(source.path)
        for tag in COPYING_TAGS:
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
        sections = {tag: tag for tag in ("equality", "tendon", "actuator")} | {"key": "keyframe"}
        for tag, section in sections.items():
            self.found[tag] = [e for part in self.root.findall(section) for e in part]
        self.refuse_other_counts()

    def walk(self, body: Element, framed: bool) -> None:
        """Number a body, its joints and sites, and then its child bodies, in MuJoCo's order."""
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
        """Raise NotWritten if the file has another number of elements than the compiled model."""
        bare, full = self.source.bare, self.source.full
        added = sum(1 + (rod.ends[1] == "clamped") for rod in self.source.rods if rod.end)
        for tag, count in (
            ("body", bare.nbody),
            ("joint", bare.njnt),
            ("site", bare.nsite),
            ("equality", full.neq - added),
            ("tendon", full.ntendon),
            ("actuator", full.nactuator),
        ):
            if len(self.found[tag]) != count:
                raise NotWritten(
                    f"{self.path.name}: it states {len(self.found[tag])} <{tag}> one by one, and "
                    f"compiles to {count}; its numbers are not tried"
                )

    def element(self, place: Place) -> Element:
        """The element of a number; a missing ``option`` or ``inertial`` is added."""
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


def write_changes(source: Source, changes: Sequence[tuple[Number, float]]) -> str:
    """The text of the file with changes added to some of its numbers; those of rods are skipped.

    Raises
    ------
    NotWritten
        Elements come from includes, copies or frames, so that the file does not state them.
    """
    tree, by_element = ModelElements(source), dict[tuple[str, int], dict[tuple[str, int], float]]()
    for number, change in changes:
        place = number.place
        if place.tag != "rod":
            own = by_element.setdefault((place.tag, place.index), {})
            own[place.attribute, place.part] = own.get((place.attribute, place.part), 0.0) + change
    for (tag, index), own in by_element.items():
        element = tree.element(Place(tag, index, ""))
        if tag == "inertial":
            write_inertial(source.bare, element, index, own)
            continue
        for attribute in dict.fromkeys(attribute for attribute, _ in own):
            parts = {part: by for (name, part), by in own.items() if name == attribute}
            if attribute == "turn":
                rotate_element(source, element, tag, index, parts[0])
            else:
                add_to_attribute(source, tree, element, Place(tag, index, attribute), parts)
    for compiler in tree.root.findall("compiler"):
        for key in ("meshdir", "texturedir", "assetdir"):
            if key in compiler.attrib:
                folder = source.path.parent / compiler.attrib[key]
                compiler.set(key, str(folder.absolute()))
    return ElementTree.tostring(tree.root, encoding="unicode")


def attribute_text(values: Iterable[float]) -> str:
    """Text of an attribute, with all digits of its numbers."""
    return " ".join(repr(float(value)) for value in values)


def write_inertial(
    model: mujoco.MjModel, element: Element, b: int, changes: Mapping[tuple[str, int], float]
) -> None:
    """Write changed mass, centre and inertia of a body, which the file may leave to its geoms."""
    stated = "pos" in element.attrib
    for key in (*ORIENTATIONS, "fullinertia"):
        element.attrib.pop(key, None)
    centre, frame = np.array(model.body_ipos[b]), model.body_iquat[b]
    if changes.get(("mass", 0)) and not (stated or model.body_mass[b]):
        # the compiled centre of a body without mass is its position in its parent
        centre, frame = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])
    for k in range(3):
        centre[k] += changes.get(("pos", k), 0.0)
    element.set("pos", attribute_text(centre))
    element.set("quat", attribute_text(frame))
    element.set("mass", attribute_text([model.body_mass[b] + changes.get(("mass", 0), 0.0)]))
    factor = 1.0 + changes.get(("inertia", 0), 0.0)
    element.set("diaginertia", attribute_text(model.body_inertia[b] * factor))


def rotate_element(source: Source, element: Element, tag: str, index: int, angle: float) -> None:
    """Rotate a body, a site or the axis of a slide by `angle` [rad] about the plane's normal."""
    model, normal = source.bare, source.normal
    normal = np.array([0.0, 0.0, 1.0]) if normal is None else normal
    owner = {"body": model.body_parentid, "site": model.site_bodyid, "joint": model.jnt_bodyid}
    local = source.frame(int(owner[tag][index])).T @ normal
    about = np.append(math.cos(angle / 2), math.sin(angle / 2) * local)
    if tag == "joint":
        axis = np.zeros(3)
        mujoco.mju_rotVecQuat(axis, np.array(model.jnt_axis[index]), about)
        element.set("axis", attribute_text(axis))
        return
    found = np.zeros(4)
    mujoco.mju_mulQuat(found, about, np.array(getattr(model, f"{tag}_quat")[index]))
    for key in ORIENTATIONS:
        element.attrib.pop(key, None)
    element.set("quat", attribute_text(found))


def add_to_attribute(
    source: Source,
    tree: ModelElements,
    element: Element,
    place: Place,
    changes: Mapping[int, float],
) -> None:
    """Add changes to components of an attribute, which the file may leave to a default."""
    values = np.array(compiled_values(source, element, place), float)
    for part, change in changes.items():
        values[part] += change
    if in_degrees(source, tree, place):
        values = np.degrees(values)
    if place.tag == "joint" and place.attribute == "range" and "limited" not in element.attrib:
        element.set("limited", "true")
    element.set(place.attribute, attribute_text(values))


def in_degrees(source: Source, tree: ModelElements, place: Place) -> bool:
    """Whether the file states a number in degrees that the compiled model has in radians."""
    return (
        place.tag == "joint"
        and place.attribute in ("ref", "springref", "range")
        and source.bare.jnt_type[place.index] == mujoco.mjtJoint.mjJNT_HINGE
        and tree.compiler.get("angle", "degree") == "degree"
    )


def degrees_of(source: Source, place: Place) -> bool:
    """Whether the file states a number in degrees, see `in_degrees`."""
    return in_degrees(source, ModelElements(source), place)


def written_number(source: Source, place: Place) -> WrittenValue | None:
    """A number as the file states it; the line of its element alone if the number is a default.

    None if the element itself is not written, or belongs to a rod.
    """
    if place.tag == "rod":
        return None
    tree = ModelElements(source)
    written = [id(element) for element in tree.root.iter()]
    try:
        element = tree.element(place)
    except NotWritten:
        return None
    if id(element) not in written:  # an <inertial> that the body's geoms stand for
        if place.tag != "inertial":
            return None
        element = tree.element(replace(place, tag="body"))
    count = written.index(id(element))
    return attribute_value(source.path, count, place.attribute, place.part)


def compiled_values(source: Source, element: Element, place: Place) -> Any:
    """The compiled numbers of an attribute, those of a hinge in radians."""
    tag, i, attribute = place.tag, place.index, place.attribute
    bare, full = source.bare, source.full
    if tag == "tendon":
        own = np.atleast_1d(getattr(full, COMPILED_FIELDS[tag, attribute])[i])
        return own if own[0] != own[-1] else own[:1]
    if tag == "key" and attribute != "ctrl":
        return own_key_values(source, i, attribute)
    if (tag, attribute) in COMPILED_FIELDS:
        model = full if tag == "equality" or attribute == "ctrl" else bare
        return getattr(model, COMPILED_FIELDS[tag, attribute])[i]
    if tag == "option":
        return full.opt.gravity
    if tag == "equality":
        return full.eq_data[i, : 3 if attribute == "anchor" else 5]
    if attribute == "gear":
        return full.actuator_gear[full.actuator_outadr[i]]
    if tag == "actuator":
        return [float(word) for word in element.get(attribute, "").split()]
    if attribute in DOF_FIELDS:
        return [getattr(bare, DOF_FIELDS[attribute])[bare.jnt_dofadr[i]]]
    if attribute == "stiffness":
        values = [bare.jnt_stiffness[i], *bare.jnt_stiffnesspoly[i]]
        return values if any(values[1:]) else values[:1]
    field = {"ref": bare.qpos0, "springref": bare.qpos_spring}[attribute]
    return [field[bare.jnt_qposadr[i]]]


def own_key_values(source: Source, key: int, attribute: str) -> Array:
    """Positions (nq,) or rates (nv,) of a key, `qpos` or `qvel`, without those of rods."""
    values = getattr(source.full, COMPILED_FIELDS["key", attribute])[key]
    if not source.rods:
        return values
    full = source.full
    added = {full.joint(name).id for rod in source.rods for name in joint_names(chain(rod))}
    is_own = np.array([j not in added for j in range(full.njnt)], bool)
    starts = (full.jnt_qposadr, full.nq) if attribute == "qpos" else (full.jnt_dofadr, full.nv)
    return np.asarray(values[np.repeat(is_own, np.diff(np.append(*starts)))])


def changed_rods(
    rods: Sequence[Rod], changes: Sequence[tuple[Number, float]]
) -> dict[str, dict[str, Any]]:
    """The new values of the keys of rods that changes affect, by rod and key."""
    found: dict[str, dict[str, Any]] = {}
    for number, change in changes:
        if number.place.tag == "rod":
            (rod,) = (one for one in rods if one.name == number.place.rod)
            own = found.setdefault(rod.name, {})
            key = number.place.attribute
            value = own.get(key, getattr(rod, key))
            if isinstance(value, tuple):
                more = (change if k == number.place.part else 0.0 for k in range(len(value)))
                own[key] = tuple(map(sum, zip(value, more, strict=True)))
            else:
                own[key] = value + change
    return found
