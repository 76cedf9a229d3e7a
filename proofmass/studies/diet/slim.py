"""Writing a draft as MJCF, with all its digits, and without what it was given to be studied."""

import ctypes
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from xml.etree import ElementTree

import mujoco

from proofmass.files import write_whole
from proofmass.sim.protocol import Rod
from proofmass.sim.rods import compile_with_rods
from proofmass.studies.diet.draft import Draft

DIGITS = 17  # of a number in double precision
FLOATS = ("rgba",)  # attributes in single precision
NUMBER = re.compile(r"-?\d[\d.]*(?:e[-+]?\d+)?")


def write(draft: Draft, file: Path, dressed: bool = False) -> None:
    """Write a model; files that it names are found from there as they were from its source.

    One that is `dressed` keeps its probes and the names that it was given.
    """
    spec = draft.again().spec
    keys = {key.name: (list(key.qpos), list(key.qvel)) for key in spec.keys}
    if not dressed:
        undress(draft, spec)
    compile_with_rods(spec, draft.rods) if draft.rods else spec.compile()
    for folder in ("meshdir", "texturedir") if spec.meshes or spec.textures else ():
        place = os.path.relpath(draft.file.parent / getattr(spec, folder), file.parent)
        setattr(spec, folder, place)
    with all_digits():
        text = shortest(spec.to_xml())
    write_whole(file, bare(text, draft.rods, keys) if draft.rods else text)


def undress(draft: Draft, spec: mujoco.MjSpec) -> None:
    """Take off what a draft was given to be studied."""
    for sensor in list(spec.sensors):
        if sensor.name in draft.probes:
            spec.delete(sensor)
    for kind, name in draft.given:
        for element in getattr(spec, kind):
            if element.name == name:
                element.name = ""


@contextmanager
def all_digits() -> Iterator[None]:
    """Let the engine write numbers as exact as they are, not in six digits, where it can.

    The switch is its own, and not one of the bindings.
    """
    folder = Path(mujoco.__file__).parent
    libraries = [ctypes.CDLL(str(f)) for f in folder.iterdir()
                 if re.fullmatch(r"(lib)?mujoco[\d.]*\.(so|dylib|dll)[\d.]*", f.name)]
    switch = next((lib._mjPRIVATE__set_xml_precision for lib in libraries
                   if hasattr(lib, "_mjPRIVATE__set_xml_precision")), lambda digits: None)
    switch(DIGITS)
    try:
        yield
    finally:
        switch(6)


def shortest(text: str) -> str:
    """The same XML with numbers as short as they can be told.

    >>> shortest('<geom rgba="0.40000000596046448 1 1 1" size="0.10000000000000001 1e-05 3"/>')
    '<geom rgba="0.4 1 1 1" size="0.1 1e-05 3"/>'
    """
    def short(match: re.Match[str]) -> str:
        name, values = match.groups()
        if not all(NUMBER.fullmatch(value) for value in values.split()):
            return match[0]
        told = [f"{float(v):.7g}" if name in FLOATS else repr(float(v)).removesuffix(".0")
                if "." in v else v for v in values.split()]
        return f'{name}="{" ".join(told)}"'

    return re.sub(r'(\w+)="([^"]*)"', short, text)


def bare(text: str, rods: tuple[Rod, ...], keys: dict[str, tuple[list[float], list[float]]]) -> str:
    """A completed model as it is without its rods, with its own keys."""
    root = ElementTree.fromstring(text, ElementTree.XMLParser(
        target=ElementTree.TreeBuilder(insert_comments=True)))
    roots = {f"{rod.name}.{k}" for rod in rods for k in (0, 1)}
    loops = {rod.name for rod in rods} | {f"{rod.name}.slider" for rod in rods}
    for parent in list(root.iter()):
        for child in list(parent):
            if (child.tag == "body" and child.get("name") in roots) or (
                    child.tag == "connect" and child.get("name") in loops) or (
                    child.tag == "key" and child.get("name") not in keys):
                parent.remove(child)
    for key in root.iter("key"):
        for name, values in zip(("qpos", "qvel"), keys[key.get("name", "")], strict=True):
            key.attrib.pop(name, None)
            if values:
                key.set(name, " ".join(f"{v:.17g}" for v in values))
    return ElementTree.tostring(root, encoding="unicode") + "\n"
