"""Which files of a folder are sidecars and models, among all others that a repository has.

It loads no package: the pytest plugin asks for each file that ends in ``.toml``.
"""

import os
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from proofmass.base.errors import InputError
from proofmass.base.files import MODEL_ENDING, URDF_ENDING, read_bytes
from proofmass.base.lines import COMMENT

REFERENCE = b"reference"  # the key that each sidecar has
SIDECAR_ENDING = ".toml"
ROOT_TAGS = {MODEL_ENDING: b"mujoco", URDF_ENDING: b"robot"}
"""The root element of a model, by the ending of its file."""
PROGRAM_ENDING, RECORDED_ENDING = ".py", ".csv"
ROOT_ELEMENT = re.compile(rb"<([A-Za-z_][\w.-]*)")
"""The first tag of an XML file that is neither its declaration nor a comment."""


def is_sidecar(path: Path) -> bool:
    """Whether a file is TOML that names a reference, with an MJCF as its model."""
    table = parse_toml(content_of(path))
    if table is None or not isinstance(table.get("reference"), str):
        return False
    return is_model(path.parent / str(table.get("model", path.with_suffix(MODEL_ENDING).name)))


def is_of_others(path: Path) -> bool:
    """Whether a TOML file, an XML file or a URDF is certainly neither a sidecar nor a model.

    A sidecar may be faulty, and is then an error.  So a TOML file is of others only if no MJCF of
    the same name is beside it, and if it has no key ``reference``, or is no TOML and does not have
    the word.  A file that cannot be read is not of others.
    """
    content = content_of(path)
    if content is None:
        return False
    if path.suffix in ROOT_TAGS:
        return root_tag(content) != ROOT_TAGS[path.suffix]
    if is_model(path.with_suffix(MODEL_ENDING)):
        return False
    table = parse_toml(content)
    return REFERENCE not in content if table is None else "reference" not in table


def named_files(path: Path) -> list[Path]:
    """An input, the model that has its name, and the files that it names, also if it is faulty."""
    table = parse_toml(content_of(path)) if path.suffix == SIDECAR_ENDING else None
    named = [path.parent / word for word in words_of(table)]
    # a text that no file can have as its name, such as a long one, is an error to Path.is_file
    return [path, path.with_suffix(MODEL_ENDING), *filter(os.path.isfile, named)]


def words_of(value: object) -> Iterator[str]:
    """All texts in the tables and lists of a sidecar."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, (dict, list)):
        for one in value.values() if isinstance(value, dict) else value:
            yield from words_of(one)


def is_program(reference: str) -> bool:
    """Whether the reference that a sidecar names is a program, a Python file beside it."""
    return reference.endswith(PROGRAM_ENDING)


def is_recorded(reference: str) -> bool:
    """Whether the reference that a sidecar names is a recorded curve."""
    return reference.endswith(RECORDED_ENDING)


def names_program(path: Path) -> bool:
    """Whether the reference of a sidecar is a program."""
    content = content_of(path) or b""
    if PROGRAM_ENDING.encode() not in content and b"\\" not in content:  # an escape may spell it
        return False
    return is_program(str((parse_toml(content) or {}).get("reference", "")))


def content_of(path: Path) -> bytes | None:
    """The content of a file; None if it cannot be read."""
    try:
        return read_bytes(path)
    except InputError:
        return None


def parse_toml(content: bytes | None) -> dict[str, Any] | None:
    """The tables of a TOML file that has the word reference; None if they cannot be read."""
    if content is None:
        return None
    try:
        return tomllib.loads(content.decode("utf-8-sig")) if REFERENCE in content else {}
    except (ValueError, RecursionError):
        return None


def is_model(path: Path) -> bool:
    """Whether a file is XML whose root element is that of a model in MJCF."""
    return path.suffix == MODEL_ENDING and has_model_root(content_of(path) or b"")


def has_model_root(content: bytes) -> bool:
    """Whether the root element of XML is that of a model in MJCF.

    A fragment that other models include, ``<mujocoinclude>``, is no model.
    """
    return root_tag(content) == ROOT_TAGS[MODEL_ENDING]


def root_tag(content: bytes) -> bytes:
    """The tag of the root element of XML; empty if there is none."""
    root = ROOT_ELEMENT.search(COMMENT.sub(b"", content))
    return root[1] if root else b""
