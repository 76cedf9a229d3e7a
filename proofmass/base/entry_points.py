"""Objects that distributions offer under a name: entry points of a group."""

import sys
from functools import cache
from importlib.metadata import EntryPoint, distributions
from typing import Any

OWN_DISTRIBUTION, GROUP_PREFIX = "proofmass", "proofmass."


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

    The current folder, from which a Python session imports, may be a stranger's and is not
    searched.
    """
    found = [
        entry
        for each in distributions(path=[folder for folder in sys.path if folder])
        for entry in each.entry_points
        if entry.group.startswith(GROUP_PREFIX)
    ]
    return tuple(sorted(found, key=lambda e: (distribution_of(e) != OWN_DISTRIBUTION, e.name)))


def distribution_of(entry: EntryPoint) -> str:
    """The name of the distribution that has an entry point."""
    return str(entry.dist.name) if entry.dist else ""


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
