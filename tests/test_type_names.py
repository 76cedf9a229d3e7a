"""No two types of the package have the same name, and docstrings name existing types."""

import ast
import builtins
import re
import textwrap
from functools import cache
from pathlib import Path

import proofmass

parse = cache(ast.parse)
TYPE_NAME = re.compile(r"[A-Z]\w*[a-z]\w*")
"""The name of a class or a type alias, which a constant does not match."""


def type_names(source: str) -> list[str]:
    """The names of the classes and type aliases that a module defines."""
    found = []
    for node in parse(source).body:
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


ENTRY_TYPE = re.compile(
    r"\s+[\w*, ]+ : (?:(?:tuple|list|sequence|iterable) of )?([A-Z]\w*[a-z]\w*)(?:, optional)?"
)
"""A parameter or attribute in a docstring, and the name of its type."""
DOCUMENTED_TYPE = re.compile(r"^ +[\w*, ]+ : .*[A-Z]|^ +Raises$", re.MULTILINE)
"""What a module must contain to be read at all."""
RAISED = re.compile(r"Raises\n *-+\n(.*?)(?:\n\n|\Z)", re.DOTALL)
"""The section of a docstring that names exceptions."""


def unknown_types(source: str, known: set[str]) -> list[str]:
    """Names of types and exceptions in the docstrings of a module that are not known.

    Names that the code of the module mentions are known as well.
    """
    nodes = list(ast.walk(parse(source))) if DOCUMENTED_TYPE.search(source) else []
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
    return [name for name in found if name not in known | code]


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


def test_a_type_that_is_not_there_is_found() -> None:
    assert unknown_types(UNKNOWN, {"ValueError"}) == ["Link", "Heavy"]
    assert unknown_types(UNKNOWN, {"ValueError", "Link", "Heavy"}) == []


def test_docstrings_name_existing_types() -> None:
    folder = Path(proofmass.__file__).parent
    sources = {file: file.read_text(encoding="utf-8") for file in sorted(folder.rglob("*.py"))}
    known = {name for text in sources.values() for name in type_names(text)} | set(dir(builtins))
    known |= {"MjModel", "MjData", "MjSpec"}
    found = {str(file): unknown_types(text, known) for file, text in sources.items()}
    unknown = {name: names for name, names in found.items() if names}
    assert unknown == {}
