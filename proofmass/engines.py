"""The engines that there are: entry points of the group ``proofmass.engines``, loaded by name."""

from __future__ import annotations

from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import TYPE_CHECKING

from proofmass.errors import suggest

if TYPE_CHECKING:
    from proofmass.sim.protocol import Engine

GROUP = "proofmass.engines"
OWN = "proofmass"
"""The distribution whose engines have looks of their own, and stand in written sidecars."""


class NoEngine(ValueError):
    """There is no engine of that name, or it cannot be loaded; says why."""


@cache
def found() -> dict[str, EntryPoint]:
    """The entry points by the names of their engines; none of them is imported.

    Where two distributions bring a name, it is that of this distribution, or the first one.
    """
    there: dict[str, EntryPoint] = {}
    for entry in sorted(entry_points(group=GROUP), key=lambda e: (distribution(e) != OWN, e.name)):
        there.setdefault(entry.name, entry)
    return there


def distribution(entry: EntryPoint) -> str:
    """The name of the distribution that brings an engine."""
    return str(entry.dist.name) if entry.dist else ""


def brought_by(name: str) -> str:
    """The other distribution that an engine is of; empty for one of this distribution."""
    entry = found().get(name)
    return "" if entry is None or distribution(entry) == OWN else distribution(entry)


def engine_names() -> list[str]:
    """The names of all engines, those of this distribution first."""
    return list(found())


@cache
def own_engines() -> tuple[str, ...]:
    """The names of the engines of this distribution."""
    return tuple(name for name, entry in found().items() if distribution(entry) == OWN)


def default_engines(in_space: bool = False) -> tuple[str, ...]:
    """The engines of this distribution that a sidecar has if it names none: all that compute.

    Parameters
    ----------
    in_space : bool
        Whether the motion is one in space, which engines of the plane do not have.
    """
    there = filter(computes, own_engines())
    return tuple(name for name in there if not (in_space and engine_of(name).planar))


def computes(solver: str) -> bool:
    """Whether a solver's engine computes its curves; of one that cannot be loaded the run says why.

    >>> computes("mujoco:default"), computes("recorded:rig")
    (True, False)
    """
    try:
        return engine_of(solver).computes
    except NoEngine:
        return True


@cache
def engine_of(name: str) -> Engine:
    """An engine by its name, or by that of a solver.

    Raises
    ------
    NoEngine
        There is none, it cannot be loaded, or it is no `proofmass.sim.protocol.Engine`.
    """
    from proofmass.sim.protocol import Engine

    name = name.partition(":")[0]
    if (entry := found().get(name)) is None:
        raise NoEngine(f"no simulator {name!r}; {suggest(name, engine_names())}")
    try:
        engine = entry.load()
    except Exception as error:
        raise NoEngine(
            f"simulator {name!r}, of {distribution(entry)}: {entry.value} cannot be "
            f"loaded: {type(error).__name__}: {error}"
        ) from error
    if not isinstance(engine, Engine):
        raise NoEngine(
            f"simulator {name!r}, of {distribution(entry)}: {entry.value} is no object "
            f"of a class of proofmass.sim.protocol.Engine"
        )
    return engine
