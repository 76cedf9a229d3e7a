"""No two classes or type aliases of the package have the same name."""

import ast
import re
from pathlib import Path

import proofmass

TYPE_NAME = re.compile(r"[A-Z]\w*[a-z]\w*")
"""The name of a class or a type alias, which a constant does not match."""


def type_names(source: str) -> list[str]:
    """The names of the classes and type aliases that a module defines."""
    found = []
    for node in ast.parse(source).body:
        if isinstance(node, ast.ClassDef):
            found.append(node.name)
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            found += [
                t.id for t in targets if isinstance(t, ast.Name) and TYPE_NAME.fullmatch(t.id)
            ]
    return found


def test_no_two_types_have_the_same_name() -> None:
    places: dict[str, list[str]] = {}
    folder = Path(proofmass.__file__).parent
    for file in sorted(folder.rglob("*.py")):
        for name in type_names(file.read_text(encoding="utf-8")):
            places.setdefault(name, []).append(str(file.relative_to(folder)))
    assert len(places) > 400
    assert {name: files for name, files in places.items() if len(files) > 1} == {}
