"""Modules of the package that one other module uses, and those of them that are found by name.

    python -m benchmarks.modules_used_once [--quick]

A use is an import, at the top of a module or in a function.  Modules that a table names are left
out, because users reach them by this name: entry points, such as those of references, and names
of the package (`PUBLIC`).  A package counts if it has more than a docstring.  A module is
found by name if an example or a benchmark imports it, or if a page of the documentation or
CONTRIBUTING.md names its file.

The only user of many modules is a list of what exists: the package that offers its modules, the
command line, or an engine's adapter.  These are counted separately.
"""

import ast
import re
import tomllib
from collections.abc import Iterable, Sequence
from itertools import chain
from pathlib import Path

import grimp

from benchmarks import ROOT, command
from proofmass import PUBLIC


def main(argv: Sequence[str] | None = None) -> None:
    given = command(__doc__).parse_args(argv)
    users = users_of_modules()
    once = {name: own[0] for name, own in users.items() if len(own) == 1}
    named = named_elsewhere(once)
    print(f"{len(users)} modules, {len(once)} used by one: {len(once) / len(users):.1%}")
    listed = {name: kind for name, user in once.items() if (kind := kind_of_list(name, user))}
    print(f"{len(once) - len(listed)} of these used by a module that is no list of modules", end="")
    print(f": {(len(once) - len(listed)) / len(users):.1%}")
    print(f"{len(once) - len(named)} of these named nowhere else", end="")
    print(f": {(len(once) - len(named)) / len(users):.1%}")
    for name, user in once.items() if not given.quick else ():
        found = "named" * (name in named)
        print(f"    {name:42} {lines(name):4}  {user:34} {found:5} {listed.get(name, '')}")


def kind_of_list(module: str, user: str) -> str:
    """The kind of list of modules that a module's only user is; empty if it is none."""
    if user == module.rpartition(".")[0]:
        return "package"
    if user in ("cli", "__main__"):
        return "command line"
    return "adapter" if user.endswith(".engine") else ""


def users_of_modules() -> dict[str, list[str]]:
    """The modules that import each module, by short names; none for modules in tables."""
    graph = grimp.build_graph("proofmass", cache_dir=None)
    reached = set(chain.from_iterable(tables()))
    users: dict[str, list[str]] = {}
    for name in sorted(filter(has_code, graph.modules)):
        own = [] if name in reached else sorted(graph.find_modules_that_directly_import(name))
        users[name.removeprefix("proofmass.")] = [user.removeprefix("proofmass.") for user in own]
    return users


def tables() -> Iterable[Iterable[str]]:
    """Names of modules in tables: references, names of the package, entry points."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    yield (f"proofmass.{module}" for module in set(PUBLIC.values()))
    for group in (project["scripts"], *project["entry-points"].values()):
        yield (target.partition(":")[0] for target in group.values())


def named_elsewhere(modules: Iterable[str]) -> set[str]:
    """The modules that examples or benchmarks import, or whose file the documentation names."""
    folders = "examples/**", "benchmarks", "docs/make"
    scripts = [file for folder in folders for file in ROOT.glob(f"{folder}/*.py")]
    pages = [*ROOT.glob("docs/**/*.md"), ROOT / "CONTRIBUTING.md"]
    code, words = (
        "\n".join(file.read_text(encoding="utf-8") for file in files) for files in (scripts, pages)
    )
    found = set()
    for name in modules:
        parent, _, last = f"proofmass.{name}".rpartition(".")
        imported = rf"{re.escape(parent)}\.{last}\b|from {re.escape(parent)} import .*\b{last}\b"
        path = rf"{name.replace('.', '/')}\b|[`/]{last}\.py`"
        if re.search(imported, code) or re.search(path, words):
            found.add(name)
    return found


def file_of(name: str) -> Path:
    """The file of a module."""
    place = ROOT / name.replace(".", "/")
    return place.with_suffix(".py") if place.with_suffix(".py").exists() else place / "__init__.py"


def has_code(name: str) -> bool:
    """Whether a module has more than a docstring."""
    return len(ast.parse(file_of(name).read_text(encoding="utf-8")).body) > 1


def lines(name: str) -> int:
    """The number of lines of a module."""
    return len(file_of(f"proofmass.{name}").read_text(encoding="utf-8").splitlines())


if __name__ == "__main__":
    main()
