"""Objects that distributions offer under a name: entry points of a group."""

import sys
import tomllib
from functools import cache
from importlib.metadata import EntryPoint, distributions
from pathlib import Path
from typing import Any

OWN_DISTRIBUTION, GROUP_PREFIX = "proofmass", "proofmass."
CHECKOUT = Path(__file__).parents[2]
"""Folder of the package: a checkout of proofmass, if it has its `pyproject.toml`."""


class NotLoaded(ValueError):
    """An entry point cannot be loaded; the message names it and its distribution."""


@cache
def entry_points_of(group: str) -> dict[str, tuple[EntryPoint, ...]]:
    """Entry points of a group by name, those of this distribution first; nothing is imported."""
    there: dict[str, tuple[EntryPoint, ...]] = {}
    for entry in all_entry_points():
        if entry.group == group and entry not in there.get(entry.name, ()):
            there[entry.name] = (*there.get(entry.name, ()), entry)
    return there


@cache
def all_entry_points() -> tuple[EntryPoint, ...]:
    """Entry points of all groups of proofmass, those of this distribution first.

    Those of this distribution are those of its checkout, of which an older state may be installed.
    The current folder, from which a Python session imports, may be a stranger's and is not
    searched.
    """
    own = entry_points_of_checkout(CHECKOUT)
    found = [
        entry
        for each in distributions(path=[folder for folder in sys.path if folder])
        if own is None or each.name != OWN_DISTRIBUTION
        for entry in each.entry_points
    ]
    found = [entry for entry in (*(own or ()), *found) if entry.group.startswith(GROUP_PREFIX)]
    return tuple(sorted(found, key=lambda e: (distribution_of(e) != OWN_DISTRIBUTION, e.name)))


def entry_points_of_checkout(folder: Path) -> tuple[EntryPoint, ...] | None:
    """The entry points that a checkout of proofmass states; None for a folder that is none."""
    try:
        project = tomllib.loads((folder / "pyproject.toml").read_text("utf-8"))["project"]
    except (OSError, ValueError, KeyError):
        return None
    if project.get("name") != OWN_DISTRIBUTION:
        return None
    return tuple(
        EntryPoint(name, value, group)
        for group, own in project.get("entry-points", {}).items()
        for name, value in own.items()
    )


def distribution_of(entry: EntryPoint) -> str:
    """The name of the distribution that has an entry point, of this one if none is installed."""
    return str(entry.dist.name) if entry.dist else OWN_DISTRIBUTION


def foreign_distribution(group: str, name: str) -> str:
    """The distribution that has an entry point; empty for one of this distribution."""
    found = distribution_of(there[0]) if (there := entry_points_of(group).get(name)) else ""
    return "" if found == OWN_DISTRIBUTION else found


def load_entry_point(entry: EntryPoint, what: str) -> Any:
    """Import the object of an entry point.

    Parameters
    ----------
    entry : EntryPoint
        One of `entry_points_of`.
    what : str
        What it is, for the message of an error.

    Raises
    ------
    NotLoaded
        It cannot be imported.
    """
    try:
        return entry.load()
    except Exception as error:
        raise NotLoaded(
            f"{what} {entry.name!r}, of {distribution_of(entry)}: {entry.value} cannot be loaded: "
            f"{type(error).__name__}: {error}"
        ) from error
