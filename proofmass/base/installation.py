"""What computes a result on a machine: the code of proofmass and of engines, and versions.

The functions load nothing but the standard library, so that they can be sent to a machine on which
another version of proofmass is installed, or none.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from importlib.metadata import Distribution
    from pathlib import Path

NOT_INSTALLED = "none"
PLUGIN_GROUPS = "proofmass.engines", "proofmass.references"
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
    """A digest of the Python files of a distribution that provides engines or references.

    These are all that it installed and, for one that is installed where it is developed, all of the
    packages in which its engines and references are.
    """
    from pathlib import Path

    files = {str(one): Path(str(one.locate())) for one in dist.files or ()}
    found = {name: file for name, file in files.items() if file.suffix == ".py" and file.is_file()}
    for entry in dist.entry_points:
        if entry.group in PLUGIN_GROUPS:
            found |= files_of(entry.module.partition(".")[0])
    return digest_files(found)


def files_of(module: str) -> "dict[str, Path]":
    """The Python files of a module or package, by their names below its folder."""
    from importlib.util import find_spec
    from pathlib import Path

    spec = find_spec(module)
    if spec is None:
        return {}
    if not spec.submodule_search_locations:
        return {f"{module}.py": Path(str(spec.origin))}
    return {
        f"{module}/{file.relative_to(folder).as_posix()}": file
        for folder in spec.submodule_search_locations
        for file in Path(folder).rglob("*.py")
    }


def digest_files(files: "dict[str, Path]") -> str:
    """The first eight digits of a digest of files and of their names."""
    from hashlib import sha256

    total = sha256()
    for name in sorted(files):
        total.update(f"{name} {sha256(files[name].read_bytes()).hexdigest()}\n".encode())
    return total.hexdigest()[:8]
