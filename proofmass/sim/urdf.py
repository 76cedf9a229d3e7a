"""Reading a URDF: MuJoCo compiles it, and what MuJoCo leaves out or cannot read is said in words.

MuJoCo takes over links with their inertia, joints with their ranges, damping, friction, forces and
mimics, and the geometry of contacts.  This module

* refuses what is no tree of links, and says which link or joint is wrong;
* finds the meshes, see `proofmass.sim.mesh_places`, and leaves the geometry out whose mesh is
  missing or unreadable where the inertia of its link is given;
* leaves out what has no effect: drawings, and the inertia of links that are fixed to the world;
* compares the compiled model with the file, for remarks on what is not in it.
"""

import os
import re
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from textwrap import fill
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import mujoco
import numpy as np

from proofmass.base.errors import InputError, suggest_names
from proofmass.base.files import read_bytes
from proofmass.base.lines import COMMENT
from proofmass.base.wording import format_count, format_list
from proofmass.sim.mesh_places import MeshPlaces, NoMesh
from proofmass.sim.mjcf import collected_warnings, python_warnings_as_mujoco, refusal
from proofmass.sim.protocol.failures import BadModel

FIXED = "fixed"
DEFAULT_DENSITY = 1000.0
"""Density that MuJoCo gives to geometry by default [kg/m^3]."""
LONGEST_CHAIN = 1023
"""Moving links in a chain with which MuJoCo 4.0.0 still compiles a model; with 2000 of them it
takes 20 s to say that they are too many."""
LEFT_OUT = {
    "transmission": "transmission",
    "gazebo": "gazebo element",
    "include": "include",
    "sensor": "sensor",
    "safety_controller": "safety controller",
    "calibration": "calibration",
}
"""Elements that MuJoCo does not read, and what they are."""
MUJOCO_TAGS = "compiler", "option", "size"
"""Elements of ``<mujoco>`` in a URDF that MuJoCo 4.0.0 reads; it passes over all others."""
XACRO_TAG = re.compile(rb"<xacro:\w+")
"""A macro of xacro; its namespace alone stays in a file in which all macros are expanded."""
ERROR_AT_LINE = re.compile(r" ?Element '(\w+)', line (\d+)")
ERROR_AT_NAME = re.compile(r" ?Element name '([^']*)', id (\d+)")
AFTERWORD = "The static bodies of the spec were fused"
REMEDIES = {
    "A + B >= C": (
        "the moments of inertia are those of no body, since one exceeds the sum of the others; "
        'mend them, or add <mujoco><compiler balanceinertia="true"/></mujoco> to the URDF, by '
        "which MuJoCo makes them equal"
    ),
    "positive eigenvalues": "the moments of inertia must be positive, also about the main axes",
    "larger than mjMINVAL": (
        "it moves and has no mass or no inertia; give it an <inertial>, or make its joint fixed"
    ),
    "geometry specification not found": (
        "its geometry is none of box, cylinder, sphere, capsule and mesh"
    ),
}
"""What is wrong, by words of MuJoCo's message."""


@dataclass(frozen=True)
class UrdfModel:
    """A URDF as MuJoCo's model, with remarks on what was not carried over.

    Attributes
    ----------
    spec : MjSpec
        Compiled once.
    model : MjModel
    remarks : tuple of str
        What is not in the model, or was assumed; phrases without a full stop.
    """

    spec: mujoco.MjSpec
    model: mujoco.MjModel
    remarks: tuple[str, ...]


def read_urdf(path: Path, within: Path | None = None) -> UrdfModel:
    """Read a URDF.

    Parameters
    ----------
    path : Path
        The file.
    within : Path, optional
        The folder that a user named, outside which no mesh is opened.

    Returns
    -------
    UrdfModel

    Raises
    ------
    BadModel
        The file is no URDF, its links are no tree, a mesh is missing whose link has no inertia, or
        MuJoCo cannot compile it.
    """
    robot = Robot(path, parse_urdf(path))
    robot.require_tree()
    robot.drop_what_has_no_effect()
    robot.find_meshes(within)
    while True:  # each turn drops a mesh file, and ends with the last
        spec: mujoco.MjSpec | None = None
        with collected_warnings() as warned, python_warnings_as_mujoco():
            try:
                spec = mujoco.MjSpec.from_string(robot.as_text())
                model = spec.compile()
            except RecursionError:
                raise BadModel(f"{path.name}: its elements are nested too deeply") from None
            except (ValueError, mujoco.FatalError) as error:
                if not robot.drop_unreadable_mesh(str(error)):
                    raise robot.refusal(error, spec) from None
                continue
        return UrdfModel(spec, model, (*robot.remarks(model), *told_warnings(warned)))


def parse_urdf(path: Path) -> Element:
    """The root element of a URDF.

    Raises
    ------
    BadModel
        It is no XML, no URDF, or still has macros.
    """
    try:
        content = read_bytes(path)
    except InputError as error:
        raise BadModel(f"{path.name}: {error.wrong}") from None
    if macro := XACRO_TAG.search(COMMENT.sub(b"", content)):
        raise BadModel(
            f"{path.name}: it has macros of xacro ({macro[0].decode()}>), which are not expanded "
            f"here; write the URDF first: xacro {path.name} > robot.urdf"
        )
    try:
        root = ElementTree.fromstring(content.lstrip())
    except (ElementTree.ParseError, LookupError, ValueError) as error:  # LookupError: its encoding
        raise BadModel(f"{path.name}: no valid XML: {error}") from None
    if root.tag != "robot":
        raise BadModel(
            f"{path.name}: the root element of a URDF is <robot>, and here it is <{root.tag}>"
        )
    return root


@dataclass
class Robot:
    """The elements of a URDF, in which parts are left out before MuJoCo reads them.

    Attributes
    ----------
    path : Path
    root : Element
        The element ``robot``, which the methods change.
    dropped : dict of list
        Links and names of the meshes that are left out, by the reason.
    """

    path: Path
    root: Element
    dropped: dict[str, list[tuple[str, str]]] = field(default_factory=dict)

    def wrong(self, element: Element, words: str) -> BadModel:
        """The error of an element."""
        name = element.get("name")
        place = f"<{element.tag}{f' name={name!r}' if name else ''}>"
        return BadModel(f"{self.path.name}: {place}: {words}")

    @cached_property
    def links(self) -> dict[str, Element]:
        """The links by their names."""
        return {one.get("name", ""): one for one in self.root.findall("link")}

    @cached_property
    def joints(self) -> list[Element]:
        """The joints; a transmission has elements of the same tag, which are not among them."""
        return self.root.findall("joint")

    @cached_property
    def parent_joint(self) -> dict[str, Element]:
        """The joint that carries each link, by the name of the link."""
        return {end_of(joint, "child"): joint for joint in self.joints}

    @cached_property
    def is_static(self) -> dict[str, bool]:
        """Whether a link is fixed to the world, by its name."""
        found: dict[str, bool] = {}
        for name in self.links:
            chain = [name]
            while (at := chain[-1]) not in found:
                joint = self.parent_joint.get(at)
                if joint is None or joint.get("type") != FIXED:
                    found[at] = joint is None
                else:
                    chain.append(end_of(joint, "parent"))
            found |= dict.fromkeys(chain, found[chain[-1]])
        return found

    def require_tree(self) -> None:
        """Raise `BadModel` unless all links have names and form trees."""
        for elements in (self.root.findall("link"), self.joints):
            names = Counter(one.get("name") for one in elements)
            for one in elements:
                if not one.get("name"):
                    raise self.wrong(one, "it has no name")
                if names[one.get("name")] > 1:
                    raise self.wrong(one, "the name stands there twice")
        if not self.links:
            raise BadModel(f"{self.path.name}: it has no <link>")
        carried: dict[str, str] = {}
        for joint in self.joints:
            for end in ("parent", "child"):
                link = end_of(joint, end)
                if link not in self.links:
                    raise self.wrong(
                        joint, f"no link {link!r} for its {end}; {suggest_names(link, self.links)}"
                    )
            child, name = end_of(joint, "child"), str(joint.get("name"))
            if child in carried:
                raise self.wrong(
                    joint,
                    f"link {child!r} is carried by joint {carried[child]!r} already; the links of "
                    "a URDF form a tree, and a loop needs an MJCF with a <connect>",
                )
            carried[child] = name
        self.require_no_cycle()
        self.require_short_chains()
        self.require_numbers()

    def require_no_cycle(self) -> None:
        """Raise `BadModel` if links carry each other in a circle."""
        known = {name for name in self.links if name not in self.parent_joint}
        for name in self.links:
            chain = list[str]()
            while name not in known:
                known.add(name)
                chain.append(name)
                name = end_of(self.parent_joint[name], "parent")
            if name in chain:
                circle = [*chain[chain.index(name) :], name]
                raise self.wrong(
                    self.parent_joint[circle[0]],
                    f"its links carry each other in a circle: {' < '.join(circle)}; a URDF is a "
                    "tree, and a loop needs an MJCF with a <connect>",
                )

    def require_short_chains(self) -> None:
        """Raise `BadModel` if more links hang on each other than MuJoCo compiles."""
        depth = dict[str, int]()
        for name in self.links:
            chain = list[str]()
            while name not in depth and name in self.parent_joint:
                chain.append(name)
                name = end_of(self.parent_joint[name], "parent")
            for one in reversed(chain):
                moves = self.parent_joint[one].get("type") != FIXED
                depth[one] = depth.get(name, 0) + moves
                name = one
        longest = max(depth, key=depth.__getitem__, default="")
        if longest and depth[longest] > LONGEST_CHAIN:
            raise self.wrong(
                self.links[longest],
                f"it is the last of {depth[longest]} moving links in a chain; MuJoCo allows "
                f"{LONGEST_CHAIN}",
            )

    def require_numbers(self) -> None:
        """Raise `BadModel` for a number that is NaN, or infinite and no limit of a joint."""
        for owner in (*self.links.values(), *self.joints):
            for element in owner.iter():
                for key, value in element.attrib.items():
                    words = [] if key in ("name", "filename") else value.lower().split()
                    bad = {"nan", "+nan", "-nan"}
                    if element.tag != "limit":
                        bad |= {sign + word for sign in ("", "+", "-") for word in INFINITE}
                    if bad & {*words} and key not in ("link", "joint", "type"):
                        raise self.wrong(
                            owner, f"<{element.tag} {key}={value!r}> is not a finite number"
                        )

    def drop_what_has_no_effect(self) -> None:
        """Leave out drawings, and the inertia of links that are fixed to the world."""
        for name, link in self.links.items():
            for tag in ("visual", *["inertial"] * self.is_static[name]):
                for one in link.findall(tag):
                    link.remove(one)

    @cached_property
    def fixed_with_mass(self) -> list[str]:
        """Roots whose links that are fixed to the world have a mass, which is why it is said."""
        found = dict[str, None]()
        for name, link in self.links.items():
            if self.is_static[name] and link.find("inertial") is not None:
                while joint := self.parent_joint.get(name):
                    name = end_of(joint, "parent")
                found[name] = None
        return list(found)

    def find_meshes(self, within: Path | None) -> None:
        """Write the paths of all meshes; leave out the geometry of those that cannot be used."""
        places = MeshPlaces(self.path, within, self.take_meshdir())
        for name, link in self.links.items():
            for collision in link.findall("collision"):
                mesh = collision.find("geometry/mesh")
                if mesh is None:
                    continue
                try:
                    mesh.set("filename", str(places.find(mesh.get("filename", ""))))
                except NoMesh as error:
                    self.drop_mesh(name, collision, mesh.get("filename", ""), str(error))

    def drop_mesh(self, link: str, collision: Element, mesh: str, why: str) -> None:
        """Leave out the geometry of a mesh.

        Raises
        ------
        BadModel
            The inertia of its link is not given, and it may move.
        """
        owner = self.links[link]
        if owner.find("inertial") is None and not self.is_static[link]:
            raise self.wrong(
                owner,
                f"mesh {mesh!r}: {why}; the link has no <inertial>, so that its mass is not known "
                "without the mesh; give the mesh or an <inertial>",
            )
        owner.remove(collision)
        self.dropped.setdefault(why, []).append((link, mesh))

    def drop_unreadable_mesh(self, error: str) -> bool:
        """Leave out the meshes of a file that an error of MuJoCo names; whether there was one."""
        named = {*re.findall(r"'([^']*)'", error)}
        found = False
        for name, link in self.links.items():
            for collision in link.findall("collision"):
                mesh = collision.find("geometry/mesh")
                file = "" if mesh is None else mesh.get("filename", "")
                if file and named & {file, Path(file).name, Path(file).stem}:
                    words = " ".join(error.split()).removeprefix("Error: ")
                    why = ERROR_AT_NAME.sub("", words.partition(AFTERWORD)[0]).strip()
                    self.drop_mesh(name, collision, Path(file).name, why.replace(file, "it"))
                    found = True
        return found

    def take_meshdir(self) -> str:
        """Take the folder of meshes out of the extension for MuJoCo, and let paths stand whole."""
        extension = self.root.find("mujoco")
        if extension is None:
            extension = ElementTree.SubElement(self.root, "mujoco")
        compiler = extension.find("compiler")
        if compiler is None:
            compiler = ElementTree.SubElement(extension, "compiler")
        folder = compiler.attrib.pop("meshdir", "") or compiler.attrib.pop("assetdir", "")
        compiler.attrib.update(strippath="false", discardvisual="true")
        return folder

    def as_text(self) -> str:
        """The elements as XML: each child of the root has a line, so that a line tells it."""
        lines = [" ".join(ElementTree.tostring(one, "unicode").split()) for one in self.root]
        name = ElementTree.tostring(Element("robot", {"name": self.root.get("name", "robot")}))
        return "\n".join([name.decode().replace("/>", ">"), *lines, "</robot>"])

    def refusal(self, error: Exception, spec: mujoco.MjSpec | None) -> BadModel | MemoryError:
        """The error of a model that MuJoCo does not compile, at its link or joint."""
        found = refusal(error)
        if isinstance(found, MemoryError):
            return found
        words = str(found).partition(AFTERWORD)[0].strip()
        owner: Element | None = None
        if (line := ERROR_AT_LINE.search(words)) and 2 <= int(line[2]) < len(self.root) + 2:
            owner = self.root[int(line[2]) - 2]
            within = "" if owner.tag == line[1] else f" of <{line[1]}>"
            words = ERROR_AT_LINE.sub(within, words)
        elif named := ERROR_AT_NAME.search(words):
            owner, words = self.links.get(named[1]), ERROR_AT_NAME.sub("", words)
            if owner is None and spec is not None and words.endswith("in geom"):
                owner = self.links.get(spec.geoms[int(named[2])].parent.name)
        words = next((said for part, said in REMEDIES.items() if part in words), words)
        words = words.removeprefix("XML ").removeprefix("Error: ")
        return BadModel(f"{self.path.name}: {words}") if owner is None else self.wrong(owner, words)

    def remarks(self, model: mujoco.MjModel) -> Iterator[str]:
        """What is not in the compiled model, or was assumed."""
        original = Robot(self.path, parse_urdf(self.path))
        for root in original.fixed_with_mass:
            yield (
                f"link {root!r} and what is fixed to it stand still: nothing in the URDF joins it "
                "to the world; if it is to move, give it a joint of type floating"
            )
        for why, pairs in self.dropped.items():
            files = dict.fromkeys(mesh for _, mesh in pairs)
            links = dict.fromkeys(link for link, _ in pairs)
            others = f" and {len(files) - 1} more" if len(files) > 1 else ""
            known = "has no effect" if all(map(self.is_static.get, links)) else "is given"
            yield (
                f"{next(iter(files))!r}{others} {why}; link {format_list(links)}, whose inertia "
                f"{known}, {'has' if len(links) == 1 else 'have'} no contacts there"
            )
        guessed = [
            name
            for name, link in self.links.items()
            if not self.is_static[name]
            and link.find("inertial") is None
            and link.find("collision") is not None
        ]
        if guessed:
            yield (
                f"no <inertial> in link {format_list(guessed)}: the mass is that of the geometry "
                f"with {DEFAULT_DENSITY:g} kg/m³, MuJoCo's default density"
            )
        yield from self.lost_in_joints(model)
        lost = Counter(one.tag for one in original.root.iter())
        unread = (one for one in original.root.findall("mujoco/*") if one.tag not in MUJOCO_TAGS)
        if names := dict.fromkeys(f"<{one.tag}>" for one in unread):
            yield f"not carried over: {format_list(names)} in <mujoco>, where MuJoCo reads none"
        parts = [format_count(lost[tag], what) for tag, what in LEFT_OUT.items() if lost[tag]]
        if parts:
            yield f"not carried over: {format_list(parts)}"

    def lost_in_joints(self, model: mujoco.MjModel) -> Iterator[str]:
        """What joints state and the compiled model does not have."""
        there = {model.joint(k).name: k for k in range(model.njnt)}
        coupled = {
            int(first)
            for first, kind in zip(model.eq_obj1id, model.eq_type, strict=True)
            if kind == mujoco.mjtEq.mjEQ_JOINT
        }
        lost: dict[str, list[str]] = {}
        for joint in (one for one in self.joints if one.get("type") != FIXED):
            name = str(joint.get("name"))
            k = there.get(name)
            dof = None if k is None else int(model.jnt_dofadr[k])
            if joint.find("mimic") is not None and k not in coupled:
                lost.setdefault("mimic", []).append(name)
            for part, kept in (
                ("damping", model.dof_damping),
                ("friction", model.dof_frictionloss),
            ):
                if number_at(joint, "dynamics", part) and (dof is None or not kept[dof]):
                    lost.setdefault(part, []).append(name)
            if number_at(joint, "limit", "velocity"):
                lost.setdefault("largest velocity", []).append(name)
        for part, names in lost.items():
            yield f"not carried over: {part} of joint {format_list(names)}"


INFINITE = "inf", "infinity"


def told_warnings(warned: Iterable[str]) -> Iterator[str]:
    """Warnings of MuJoCo as remarks; that a mimic is ignored is said of all joints at once."""
    for message in warned:
        if "<mimic>" not in message:
            yield f"MuJoCo warns: {' '.join(message.split()).rstrip('.')}"


def end_of(joint: Element, end: str) -> str:
    """The name of the link at the end of a joint, ``parent`` or ``child``; empty if none."""
    found = joint.find(end)
    return "" if found is None else found.get("link", "")


def number_at(joint: Element, tag: str, key: str) -> float:
    """A number of a joint; 0 if it is left out or no number."""
    found = joint.find(tag)
    try:
        return 0.0 if found is None else float(found.get(key, "0"))
    except ValueError:
        return 0.0


def mjcf_of_urdf(path: Path) -> tuple[str, tuple[str, ...]]:
    """The MJCF of a URDF, for a file in the same folder, and remarks on what it does not have.

    MuJoCo writes six digits; the numbers of bodies and joints get all of theirs.

    Raises
    ------
    BadModel
        See `read_urdf`.
    """
    found = read_urdf(path)
    folder = Path(os.path.abspath(path)).parent
    root = ElementTree.fromstring(found.spec.to_xml())
    for mesh in root.iter("mesh"):
        mesh.set("file", os.path.relpath(mesh.get("file", ""), folder))
    for body in root.iter("body"):
        write_digits(body, found.model)
    remarks = (
        fill(f"{one}.", 100, initial_indent=INDENT, subsequent_indent=INDENT)
        for one in found.remarks
    )
    comment = "\n".join([f"<!-- From {path.name}.", *remarks])
    ElementTree.indent(root)
    text = ElementTree.tostring(root, encoding="unicode")
    return f"{comment.replace('--', '- -').replace('<!- -', '<!--')} -->\n{text}\n", found.remarks


INDENT = "     "  # of remarks in the comment of an MJCF


def write_digits(body: Element, model: mujoco.MjModel) -> None:
    """Write all digits of the numbers of a body and its joints into an element of MJCF."""
    of = model.body(str(body.get("name")))
    numbers = {"pos": of.pos, "quat": of.quat}
    body.attrib.update({key: exact(value) for key, value in numbers.items()})
    inertial = body.find("inertial")
    if inertial is not None:
        inertial.attrib.clear()
        values = {"pos": of.ipos, "quat": of.iquat, "mass": of.mass, "diaginertia": of.inertia}
        inertial.attrib.update({key: exact(value) for key, value in values.items()})
    for joint in body.findall("joint"):
        k = model.joint(str(joint.get("name"))).id
        dof = int(model.jnt_dofadr[k])
        values = {
            "pos": model.jnt_pos[k],
            "axis": model.jnt_axis[k],
            "range": model.jnt_range[k],
            "actuatorfrcrange": model.jnt_actfrcrange[k],
            "damping": model.dof_damping[dof],
            "frictionloss": model.dof_frictionloss[dof],
        }
        joint.attrib.update({key: exact(values[key]) for key in values if key in joint.attrib})


def exact(values: Any) -> str:
    """Numbers with all their digits."""
    return " ".join(repr(float(value)).removesuffix(".0") for value in np.ravel(values))
