"""Which files of a folder are sidecars and models, among all others that a repository has.

Only the standard library is loaded: the pytest plugin asks for each file that ends in ``.toml``.
"""

import re
import tomllib
from pathlib import Path
from typing import Any

SIDECAR_ENDING, MODEL_ENDING = ".toml", ".xml"
ROOT_ELEMENT = re.compile(rb"<([A-Za-z_][\w.-]*)")
"""The first tag of an XML file that is neither its declaration nor a comment."""
COMMENT = re.compile(rb"<!--.*?-->", re.DOTALL)


def is_sidecar(path: Path) -> bool:
    """Whether a file is TOML that names a reference, with an MJCF as its model."""
    table = read_toml(path)
    if table is None or not isinstance(table.get("reference"), str):
        return False
    return is_model(path.parent / str(table.get("model", path.with_suffix(MODEL_ENDING).name)))


def read_toml(path: Path) -> dict[str, Any] | None:
    """The content of a TOML file that has the word reference; None if it cannot be read."""
    try:
        content = path.read_bytes()
        return tomllib.loads(content.decode("utf-8-sig")) if b"reference" in content else {}
    except (OSError, ValueError, RecursionError):
        return None


def is_model(path: Path) -> bool:
    """Whether a file is XML whose root element is that of a model in MJCF.

    A fragment that other models include, ``<mujocoinclude>``, is no model.
    """
    try:
        content = path.read_bytes() if path.suffix == MODEL_ENDING else b""
    except (OSError, ValueError):
        return False
    root = ROOT_ELEMENT.search(COMMENT.sub(b"", content))
    return root is not None and root[1] == b"mujoco"
