"""The links of rods as elements of an MJCF with all their digits, for programs.

MuJoCo's own writer rounds numbers to six digits.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import mujoco
import numpy as np

from proofmass.analytic.numerics import Array
from proofmass.sim.mjcf import collected_warnings
from proofmass.sim.mujoco.settings import section, spelled
from proofmass.sim.protocol import Rod, Unsupported
from proofmass.sim.rods import chain, compile_with_rods

DEEPEST = 490
"""Bodies in each other that are written: MuJoCo reads no element in 500 others."""
UNTURNED = [1.0, 0.0, 0.0, 0.0]
PLAIN = {
    "pos": "0 0 0",
    "damping": "0 0 0",
    "frictionloss": "0",
    "armature": "0",
    "ref": "0",
    "springref": "0",
    "limited": "false",
}
"""Of a rod's joint, and of any where no default class says otherwise."""
HINGE = mujoco.mjtJoint.mjJNT_HINGE
KINDS = {
    "nbody": mujoco.mjtObj.mjOBJ_BODY,
    "njnt": mujoco.mjtObj.mjOBJ_JOINT,
    "nsite": mujoco.mjtObj.mjOBJ_SITE,
    "nsensor": mujoco.mjtObj.mjOBJ_SENSOR,
    "nactuator": mujoco.mjtObj.mjOBJ_ACTUATOR,
    "neq": mujoco.mjtObj.mjOBJ_EQUALITY,
}
"""What a program asks for by name, by how many there are in a model."""
LEFT_OUT = "_", "key_", "name", "path"
"""How arrays begin that are not compared: a program sets the state of its key, and may hold the
files of meshes.  Sizes are compared with the arrays."""


def write_rods(root: Element, path: Path, rods: Sequence[Rod]) -> None:
    """Write the links, sites and loops of rods into the elements of a model, in place.

    Parameters
    ----------
    root : Element
        The elements of the model with what it includes, without keys.
    path : Path
        The MJCF file.
    rods : sequence of Rod
        What is added to it before it is compiled.

    Raises
    ------
    Unsupported
        A rod on a site that is no element of the file, of too many links, or with elements that do
        not compile to the very numbers of the model.
    """
    spec = mujoco.MjSpec.from_file(str(path))
    loops = len(spec.equalities)
    with collected_warnings():  # what it warns of was told when the model was loaded
        exact = compile_with_rods(spec, rods)
    plain = root.find("default") is None
    for rod in rods:
        write_body(host(root, rod.start), spec.body(chain(rod).names[0]), plain)
        if rod.ends[1] == "clamped" and rod.end is not None:
            write_body(host(root, rod.end), spec.body(f"{rod.name}.slider.0"), plain)
    for loop in spec.equalities[loops:]:
        names = {"name": loop.name, "site1": loop.name1, "site2": loop.name2}
        ElementTree.SubElement(section(root, "equality"), "connect", names)
    ElementTree.SubElement(root, "compiler", {"fusestatic": "false"})
    refuse_others(root, exact)


def host(root: Element, site: str) -> Element:
    """The element of the body, or of the world, that a site is on."""
    parents = {child: parent for parent in root.iter() for child in parent}
    for element in root.iterfind(".//worldbody//site"):
        if element.get("name") == site:
            while element.tag not in ("body", "worldbody"):
                element = parents[element]
            return element
    raise Unsupported(f"a program with a rod on site {site!r}, which is no element of the file")


def write_body(parent: Element, body: mujoco._specs.MjsBody, plain: bool) -> None:
    """Write a body of a rod, and those behind it; `plain` without classes of defaults."""
    depth = 0
    while body is not None:  # a rod does not branch
        depth += 1
        if depth > DEEPEST:
            raise Unsupported(
                f"a program with a rod of more than {DEEPEST} links and slides: MuJoCo reads no "
                "deeper elements"
            )
        parent = ElementTree.SubElement(parent, "body", {"name": body.name, **place(body)})
        parent.extend(parts(body, plain))
        body = body.first_body()


def parts(body: mujoco._specs.MjsBody, plain: bool) -> Iterator[Element]:
    """The elements of a body of a rod, as `proofmass.sim.rods.add` makes them."""
    if body.explicitinertial:
        inertia = {"mass": body.mass, "pos": body.ipos, "diaginertia": body.inertia}
        yield Element("inertial", {key: digits(value) for key, value in inertia.items()})
    for joint in body.joints:
        said = {
            "name": joint.name,
            "type": "hinge" if joint.type == HINGE else "slide",
            "axis": digits(joint.axis),
            "stiffness": digits(joint.stiffness[0] if plain else joint.stiffness),
            **PLAIN,
            "springref": digits(joint.springref) if joint.springref else PLAIN["springref"],
        }
        yield Element("joint", {k: v for k, v in said.items() if not plain or v != PLAIN.get(k)})
    for geom in body.geoms:
        yield Element(
            "geom",
            {
                "type": "capsule",
                "fromto": digits(geom.fromto),
                "size": digits(geom.size[0]),
                "mass": "0",
                "contype": "0",
                "conaffinity": "0",
            },
        )
    for site in body.sites:
        yield Element("site", {"name": site.name, **place(site)})


def place(element: mujoco._specs.MjsBody | mujoco._specs.MjsSite) -> dict[str, str]:
    """Where a body or a site is in its parent."""
    turned = element.quat.tolist() != UNTURNED
    said = {"pos": digits(element.pos)}
    return {**said, "quat": digits(element.quat)} if turned else said


def digits(value: Array | float) -> str:
    """Numbers as MJCF, with all their digits."""
    return spelled(np.asarray(value, float).tolist())


def refuse_others(root: Element, exact: mujoco.MjModel) -> None:
    """Raise `Unsupported` unless elements compile to the numbers of a model, but for its keys."""
    text = ElementTree.tostring(root, encoding="unicode")
    try:
        with collected_warnings():
            model = mujoco.MjModel.from_xml_string(text)
    except ValueError as error:
        raise Unsupported(f"a program for this model with rods: {error}") from None
    if (other := first_other(model, exact)) is not None:
        raise Unsupported(
            f"a program for this model with rods: its elements compile to another {other}"
        )


def first_other(one: mujoco.MjModel, two: mujoco.MjModel) -> str | None:
    """The first array or kind of names in which two models differ; None where they are alike.

    Their keys and the names of files are left out.
    """
    for count, kind in KINDS.items():
        first, second = (
            [mujoco.mj_id2name(model, kind, k) for k in range(getattr(model, count))]
            for model in (one, two)
        )
        if first != second:
            return f"order of names, {count}"
    for name in dir(two):
        values = getattr(two, name)
        compared = isinstance(values, np.ndarray) and not name.startswith(LEFT_OUT)
        if compared and not np.array_equal(getattr(one, name), values):
            return name
    return None
