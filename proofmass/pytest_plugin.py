"""pytest's hooks: which files are sidecars, and so become items of `proofmass.pytest_items`.

A repository has many files that end in ``.toml``.  One is a sidecar if it was named on the command
line, if it lies below a folder of the option ``proofmass_paths``, or if it can be read as TOML,
names a reference, and its model is an MJCF.  All others are left alone.  Nothing but this module is
loaded until there is a sidecar.
"""

from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from proofmass.case.inputs import SIDECAR_ENDING, is_sidecar

if TYPE_CHECKING:
    from proofmass.pytest_items import SidecarFile

PATHS_OPTION = "proofmass_paths"


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the option that names folders of sidecars."""
    parser.addini(
        PATHS_OPTION,
        "files and folders in which each .toml is a sidecar, and a faulty one is an error",
        type="paths",
        default=[],
    )


def pytest_collect_file(file_path: Path, parent: pytest.Collector) -> "SidecarFile | None":
    """Collect a file if it is a sidecar."""
    if file_path.suffix != SIDECAR_ENDING:
        return None
    named = is_named(file_path, parent.config)
    if not (named or is_below(file_path, parent.config) or is_sidecar(file_path)):
        return None
    from proofmass.pytest_items import SidecarFile

    found: SidecarFile = SidecarFile.from_parent(parent, path=file_path, named=named)
    return found


def is_named(path: Path, config: pytest.Config) -> bool:
    """Whether a file was given to pytest by its name."""
    given = (config.invocation_params.dir / arg.partition("::")[0] for arg in config.args)
    return any(one.suffix == SIDECAR_ENDING and one.resolve() == path.resolve() for one in given)


def is_below(path: Path, config: pytest.Config) -> bool:
    """Whether a file is one of ``proofmass_paths`` or below one of them."""
    return any(path.is_relative_to(one) for one in config.getini(PATHS_OPTION))
