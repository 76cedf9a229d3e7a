"""What computes a result on a machine: the code of proofmass and of engines, and versions.

The functions load nothing but the standard library, so that they can be sent to a machine on which
another version of proofmass is installed, or none.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator
    from importlib.metadata import Distribution
    from pathlib import Path

NOT_INSTALLED = "none"
PLUGIN_GROUPS = "proofmass.engines", "proofmass.hosted_engines", "proofmass.references"
COMPUTING_PACKAGES = "mujoco", "numpy", "pymunk", "scipy"  # on whose versions digits depend


def describe_installation() -> dict[str, str]:
    """What this Python computes with, each by the name that a message has for it.

    These are the versions of Python and of the packages that compute, and the versions and the code
    of proofmass and of each distribution that provides an engine or a reference.

    Returns
    -------
    dict of str to str
        ``{"Python": "3.11.7", "mujoco": "4.0.0", .., "proofmass": "0.1.0, code 91ab02cd"}``.
    """
    import platform
    from importlib.metadata import entry_points

    found = {"Python": platform.python_version()}
    found |= {name: version_of(name) for name in COMPUTING_PACKAGES}
    found["proofmass"] = f"{version_of('proofmass')}, code {digest_files(files_of('proofmass'))}"
    for entry in (one for group in PLUGIN_GROUPS for one in entry_points(group=group)):
        if entry.dist is not None and entry.dist.name not in found:
            found[entry.dist.name] = f"{entry.dist.version}, code {digest_plugins(entry.dist)}"
    return found


def version_of(name: str) -> str:
    """The version of a distribution, or `NOT_INSTALLED`."""
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version(name)
    except PackageNotFoundError:
        return NOT_INSTALLED


def own_version() -> str:
    """The version of proofmass; ``0+unknown`` for a source tree that is not installed."""
    found = version_of("proofmass")
    return "0+unknown" if found == NOT_INSTALLED else found


def digest_plugins(dist: "Distribution") -> str:
    """A digest of a distribution that provides engines or references: its files, and their names.

    The files are all that it installed beside its metadata, also data and compiled modules.  Of one
    that is installed where it is developed they are those of its modules and packages there.
    """
    from pathlib import Path

    files = {str(one): Path(str(one.locate())) for one in dist.files or ()}
    for module in modules_of(dist):
        files |= files_of(module, "*")
    code = digest_files({name: file for name, file in files.items() if is_code(name, file)})
    names = sorted(f"{one.group} {one.name} {one.value}" for one in dist.entry_points)
    return digest_text(f"{code} {names}")


def modules_of(dist: "Distribution") -> "Iterator[str]":
    """The modules and packages of a distribution whose files its list may lack.

    These are the modules of its engines and references, those that it names, and those in a folder
    that it adds to Python's path.
    """
    from pathlib import Path

    for entry in dist.entry_points:
        if entry.group in PLUGIN_GROUPS:
            yield entry.module.partition(".")[0]
    yield from (dist.read_text("top_level.txt") or "").split()
    for path in (Path(str(one.locate())) for one in dist.files or () if one.suffix == ".pth"):
        text = path.read_text("utf-8", "replace") if path.is_file() else ""
        for folder in map(Path, text.splitlines()):
            if folder.is_absolute() and folder.is_dir():
                yield from (one.stem for one in folder.glob("[!_]*.py"))
                yield from (one.parent.name for one in folder.glob("*/__init__.py"))


def is_code(name: str, file: "Path") -> bool:
    """Whether results may depend on a file of a distribution, and it is the same on each machine.

    Metadata, scripts, and files that tell where a distribution is developed have folders of the
    machine in them; bytecode follows from its source.

    >>> from pathlib import Path
    >>> is_code("a/table.csv", Path(__file__)), is_code("a-1.dist-info/RECORD", Path(__file__))
    (True, False)
    """
    first = name.partition("/")[0]
    return (
        file.is_file()
        and not first.endswith((".dist-info", ".egg-info", ".pth"))
        and not first.startswith(("..", "__editable__"))
        and file.suffix != ".pyc"
    )


def files_of(module: str, pattern: str = "*.py") -> "dict[str, Path]":
    """The Python files of a module or package, by their names below its folder."""
    from importlib.util import find_spec
    from pathlib import Path

    spec = find_spec(module) if module.isidentifier() else None
    if spec is None:
        return {}
    if not spec.submodule_search_locations:
        return {f"{module}.py": Path(str(spec.origin))}
    return {
        f"{module}/{file.relative_to(folder).as_posix()}": file
        for folder in spec.submodule_search_locations
        for file in Path(folder).rglob(pattern)
    }


def digest_files(files: "dict[str, Path]") -> str:
    """The first eight digits of a digest of files and of their names."""
    from hashlib import sha256

    return digest_text(
        "".join(
            f"{name} {sha256(files[name].read_bytes()).hexdigest()}\n" for name in sorted(files)
        )
    )


def digest_text(text: str) -> str:
    """The first eight digits of a digest of a text."""
    from hashlib import sha256

    return sha256(text.encode()).hexdigest()[:8]
