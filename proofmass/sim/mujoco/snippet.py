"""Settings of MuJoCo as MJCF, to paste right before ``</mujoco>``, and pasted."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from xml.etree import ElementTree

from proofmass.sim.mjcf import read_tree
from proofmass.sim.mujoco.settings import ENGINE_DEFAULTS, PLACES, SOFTNESS, spelled, write_options
from proofmass.sim.protocol import ParameterValues, left_to_sidecar


def snippet(parameters: ParameterValues, model: Path | None = None) -> str:
    """What to paste so that MuJoCo runs with settings.

    Equalities of the model whose own attributes, or whose class, would win are named, with what to
    write into them.

    Examples
    --------
    >>> print(snippet({"timestep": 1e-3, "integrator": "rk4"}))
    <option timestep="0.001" integrator="RK4"/>
    >>> print(snippet({"cone": "elliptic", "refsafe": False}))
    <option cone="elliptic">
      <flag refsafe="disable"/>
    </option>
    >>> print(snippet({"solref": (0.008, 1.0)}))
    <default>
      <equality solref="0.008 1"/>
    </default>
    """
    left = (f"<!-- {line} -->" for line in left_to_sidecar(parameters, tuple(PLACES)))
    return "\n".join([*mjcf(parameters, model), *left])


def mjcf(parameters: ParameterValues, model: Path | None) -> Iterator[str]:
    """Elements that MuJoCo merges with those before them."""
    every = {**(ENGINE_DEFAULTS if parameters.get("defaults") else {}), **parameters}
    root = ElementTree.Element("mujoco")
    write_options(root, {key: every[key] for key in PLACES if key in every})
    for option in root:
        ElementTree.indent(option)
        yield ElementTree.tostring(option, encoding="unicode").replace(" />", "/>")
    loops = equalities(model) if model else [ElementTree.Element("connect")]
    softness = {key: spelled(every[key]) for key in SOFTNESS if key in every}
    if loops and softness:
        yield from ("<default>", f"  <equality {attributes(softness)}/>", "</default>")
        for loop in loops:
            if own := in_itself(loop, softness):
                yield f"<!-- {loop.tag} {loop.get('name')}: with {attributes(own)} in itself -->"


def in_itself(loop: ElementTree.Element, softness: Mapping[str, str]) -> dict[str, str]:
    """What an equality itself must say, since what it or its class says would win.

    Numbers of its own after those that are given remain.
    """
    found = {}
    for key, value in softness.items():
        if {"class", key} & loop.attrib.keys():
            given = value.split()
            found[key] = " ".join([*given, *loop.get(key, "").split()[len(given) :]])
    return found


def attributes(said: Mapping[str, str]) -> str:
    """Attributes of an element."""
    return " ".join(f'{key}="{value}"' for key, value in said.items())


def equalities(model: Path) -> list[ElementTree.Element]:
    """Elements of an MJCF that hold loops together."""
    return read_tree(model).findall("./equality/*")


def pasted(model: Path, lines: str) -> str:
    """The text of an MJCF with a snippet in it, and in its equalities what the snippet says."""
    root, added = read_tree(model), ElementTree.fromstring(f"<all>{lines}</all>")
    for softness in added.iterfind("./default/equality"):
        for loop in root.iterfind("./equality/*"):
            loop.attrib.update(in_itself(loop, softness.attrib))
    root.extend(added)
    return ElementTree.tostring(root, encoding="unicode")
