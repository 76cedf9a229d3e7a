"""The elements of a model with those of the files that it includes, in one tree."""

from pathlib import Path
from xml.etree.ElementTree import Element, SubElement

from proofmass.sim.mjcf import insert_includes, read_tree


def flat_tree(model: Path) -> Element:
    """The elements of a model with those of included files, and its folders as absolute paths."""
    tree = read_tree(model)
    insert_includes(tree, model.parent.absolute())
    given = {k: v for one in tree.iter("compiler") for k, v in one.attrib.items()}
    for one in tree.iter("compiler"):
        for key in ("assetdir", "meshdir", "texturedir"):
            one.attrib.pop(key, None)
    folders = {
        key: str(model.parent.absolute() / given.get(key, given.get("assetdir", "")))
        for key in ("meshdir", "texturedir")
    }
    SubElement(tree, "compiler", folders)
    return tree
