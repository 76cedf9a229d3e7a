"""No two modules of the package define a number by the same name: it is another one, or shared."""

import ast
from collections.abc import Iterator
from pathlib import Path

import proofmass

PROTOCOL_NAMES = {"MODES", "WORKING_MODES"}
"""Names by which references state their modes: each may have its own."""


def defined_numbers(source: str) -> Iterator[str]:
    """The names of the constants of a module whose values have numbers and no text.

    >>> list(defined_numbers("A = 1.0\\nB: int = 2\\nC, D = 3, 'd'\\nE = 'e'\\nF = (1, 2)"))
    ['A', 'B', 'C', 'F']
    """
    for node in ast.parse(source).body:
        if isinstance(node, ast.AnnAssign | ast.Assign) and node.value is not None:
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            for target in targets:
                for name, value in named_values(target, node.value):
                    if name.isupper() and has_numbers_only(value):
                        yield name


def named_values(target: ast.expr, value: ast.expr) -> Iterator[tuple[str, ast.expr]]:
    """The names of an assignment with their values; a call has one value for all names."""
    if isinstance(target, ast.Name):
        yield target.id, value
    elif isinstance(target, ast.Tuple):
        each = value.elts if isinstance(value, ast.Tuple) else [value] * len(target.elts)
        for one, its in zip(target.elts, each, strict=True):
            yield from named_values(one, its)


def has_numbers_only(value: ast.expr) -> bool:
    """Whether an expression has a number, and no text."""
    found = [type(node.value) for node in ast.walk(value) if isinstance(node, ast.Constant)]
    return bool({int, float} & set(found)) and str not in found


def test_no_two_modules_define_a_number_by_the_same_name() -> None:
    folder = Path(proofmass.__file__).parent
    places: dict[str, list[str]] = {}
    for file in sorted(folder.rglob("*.py")):
        for name in defined_numbers(file.read_text(encoding="utf-8")):
            places.setdefault(name, []).append(str(file.relative_to(folder)))
    assert len(places) > 700
    assert {
        name: files
        for name, files in places.items()
        if len(files) > 1 and name not in PROTOCOL_NAMES
    } == {}
