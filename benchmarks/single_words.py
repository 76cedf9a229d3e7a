"""How many functions and constants of the package have names of a single word.

    python -m benchmarks.single_words [--quick]

Counted are functions and constants of modules, and methods without those that Python calls.  A
leading underscore does not count as a word.
"""

import ast
from collections.abc import Iterator, Sequence
from pathlib import Path

from benchmarks import ROOT, command

KINDS = ("functions", "methods", "constants")


def main(argv: Sequence[str] | None = None) -> None:
    command(__doc__).parse_args(argv)
    names: dict[str, list[str]] = {kind: [] for kind in KINDS}
    for file in sorted((ROOT / "proofmass").rglob("*.py")):
        for kind, name in definitions(file):
            names[kind].append(name)
    for kind, found in names.items():
        single = sum("_" not in name.strip("_") for name in found)
        share = 100 * single / len(found)
        print(f"{kind}: {single} of {len(found)} have a single word, {share:.0f} %")


def definitions(file: Path) -> Iterator[tuple[str, str]]:
    """The kind and the name of each definition at the top of a module, and of its methods."""
    for node in ast.parse(file.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.FunctionDef):
            yield "functions", node.name
        elif isinstance(node, ast.ClassDef):
            for part in node.body:
                if isinstance(part, ast.FunctionDef) and not part.name.startswith("__"):
                    yield "methods", part.name
        elif isinstance(node, (ast.Assign, ast.AnnAssign)):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            for target in targets:
                if isinstance(target, ast.Name) and target.id.isupper():
                    yield "constants", target.id


if __name__ == "__main__":
    main()
