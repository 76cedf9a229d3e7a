"""Distributions with entry points, which tests write as pip would install them."""

import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import pytest

from proofmass.base.entry_points import all_entry_points, entry_points_of
from proofmass.base.worker import close_idle_workers
from proofmass.reference.find import find_reference
from proofmass.run.fingerprint import package_versions
from proofmass.sim.engines import engine_of

CACHED = all_entry_points, entry_points_of, engine_of, find_reference, package_versions
"""What a process remembers of the distributions that it found."""


def write_distribution(
    folder: Path, name: str, files: Mapping[str, str], group: str, **objects: str
) -> None:
    """Write a distribution with the texts of its files, and a group of entry points.

    `objects` are the names of objects by the names of their entry points, with a module that is not
    the distribution's own before a colon.
    """
    info = folder / f"{name}-1.0.dist-info"
    info.mkdir(parents=True)
    for file, text in files.items():
        (folder / file).parent.mkdir(exist_ok=True)
        (folder / file).write_text(text)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    places = {key: place if ":" in place else f"{name}:{place}" for key, place in objects.items()}
    lines = [f"{key} = {place}" for key, place in places.items()]
    (info / "entry_points.txt").write_text("\n".join([f"[{group}]", *lines, ""]))


def forget_distributions(modules: str = "") -> None:
    """Let this process know no more of distributions than a new one, and start new workers.

    Modules whose names begin with `modules` are imported again.
    """
    close_idle_workers()  # those that were started with another path
    for name in [name for name in sys.modules if modules and name.startswith(modules)]:
        del sys.modules[name]
    for cached in CACHED:
        cached.cache_clear()


@contextmanager
def on_path(*folders: Path, modules: str = "") -> Iterator[None]:
    """Let this process and new workers have folders on their path."""
    with pytest.MonkeyPatch.context() as patch:
        for folder in folders:
            patch.syspath_prepend(folder)
        forget_distributions(modules)
        yield
    forget_distributions(modules)
