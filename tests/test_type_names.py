"""No two types of the package have the same name, and docstrings name existing types."""

import ast
import builtins
import re
import textwrap
from pathlib import Path

import pytest

import proofmass

TYPE_NAME = re.compile(r"[A-Z]\w*[a-z]\w*")
"""The name of a class or a type alias, which a constant does not match."""
Types = tuple[list[str], list[str]]
"""Names of the types that a module defines, and of those that only its docstrings name."""


@pytest.fixture(scope="module")
def types_by_file() -> dict[str, Types]:
    """The types of all modules of the package, which are parsed once."""
    folder = Path(proofmass.__file__).parent
    return {
        str(file.relative_to(folder)): read_types(file.read_text(encoding="utf-8"))
        for file in sorted(folder.rglob("*.py"))
    }


def read_types(source: str) -> Types:
    """The types of a module."""
    tree = ast.parse(source)
    return defined_types(tree), documented_types(tree) if DOCUMENTED_TYPE.search(source) else []


def defined_types(tree: ast.Module) -> list[str]:
    """The names of the classes and type aliases that a module defines."""
    found = []
    for node in tree.body:
        if isinstance(node, ast.ClassDef):
            found.append(node.name)
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            found += [
                t.id for t in targets if isinstance(t, ast.Name) and TYPE_NAME.fullmatch(t.id)
            ]
    return found


def test_no_two_types_have_the_same_name(types_by_file: dict[str, Types]) -> None:
    places: dict[str, list[str]] = {}
    for file, (defined, _) in types_by_file.items():
        for name in defined:
            places.setdefault(name, []).append(file)
    assert len(places) > 400
    assert {name: files for name, files in places.items() if len(files) > 1} == {}


ENTRY_TYPE = re.compile(
    r"\s+[\w*, ]+ : (?:(?:tuple|list|sequence|iterable) of )?([A-Z]\w*[a-z]\w*)(?:, optional)?"
)
"""A parameter or attribute in a docstring, and the name of its type."""
DOCUMENTED_TYPE = re.compile(r"^ +[\w*, ]+ : .*[A-Z]|^ +Raises$", re.MULTILINE)
"""What a module must contain to be searched for types in docstrings at all."""
RAISED = re.compile(r"Raises\n *-+\n(.*?)(?:\n\n|\Z)", re.DOTALL)
"""The section of a docstring that names exceptions."""


def documented_types(tree: ast.Module) -> list[str]:
    """Names of types and exceptions in docstrings of a module that its code does not mention."""
    nodes = list(ast.walk(tree))
    code = {n.id for n in nodes if isinstance(n, ast.Name)}
    code |= {n.attr for n in nodes if isinstance(n, ast.Attribute)}
    found = []
    for node in nodes:
        if isinstance(node, ast.FunctionDef | ast.ClassDef) and (text := ast.get_docstring(node)):
            indented = textwrap.indent(text, " ")
            found += [m[1] for line in indented.splitlines() if (m := ENTRY_TYPE.fullmatch(line))]
            for section in RAISED.findall(text):
                lines = [line for line in section.splitlines() if not line.startswith(" ")]
                found += [
                    name for line in lines for name in line.split(", ") if TYPE_NAME.fullmatch(name)
                ]
    return [name for name in found if name not in code]


UNKNOWN = '''
def lift(links):
    """Lift links.

    Parameters
    ----------
    links : tuple of Link, optional

    Raises
    ------
    Heavy, ValueError
        They cannot be lifted.
    """
'''


def test_types_that_only_a_docstring_names_are_found() -> None:
    assert read_types(UNKNOWN) == ([], ["Link", "Heavy", "ValueError"])
    assert read_types(UNKNOWN + "class Link: ...\nHeavy()") == (["Link"], ["Link", "ValueError"])


def test_docstrings_name_existing_types(types_by_file: dict[str, Types]) -> None:
    known = {name for defined, _ in types_by_file.values() for name in defined}
    known |= {*dir(builtins), "MjModel", "MjData", "MjSpec"}
    unknown = {
        file: names
        for file, (_, documented) in types_by_file.items()
        if (names := [name for name in documented if name not in known])
    }
    assert unknown == {}
