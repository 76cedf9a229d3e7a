"""Find engines: entry points of the group ``proofmass.engines``, loaded by name."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

from proofmass.base.entry_points import (
    OWN_DISTRIBUTION,
    NotLoaded,
    distribution_of,
    entry_points_of,
    load_entry_point,
)
from proofmass.base.errors import suggest_names

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

    from proofmass.sim.protocol.engine import Engine

ENGINE_GROUP = "proofmass.engines"
NATIVE_ENGINE = "mujoco"
"""The engine whose own format is MJCF: it runs any model, and gives the poses of drawings."""


class NoEngine(ValueError):
    """No engine has that name, or it cannot be loaded; the message says why."""


def engine_entry_points() -> dict[str, EntryPoint]:
    """Entry points by the names of their engines; no engine is imported.

    If two distributions provide an engine of the same name, that of this distribution is taken, or
    else the first in the order of their names.
    """
    return {name: same[0] for name, same in entry_points_of(ENGINE_GROUP).items()}


def engine_names() -> list[str]:
    """The names of all engines, those of this distribution first."""
    return list(engine_entry_points())


@cache
def own_engines() -> tuple[str, ...]:
    """The names of the engines of this distribution."""
    return tuple(
        name
        for name, entry in engine_entry_points().items()
        if distribution_of(entry) == OWN_DISTRIBUTION
    )


def default_engines(in_space: bool = False) -> tuple[str, ...]:
    """Engines of a sidecar that names none: those of this distribution that compute their curves.

    Parameters
    ----------
    in_space : bool
        Whether the motion is one in space; planar engines are left out then.
    """
    there = filter(computes_curves, own_engines())
    return tuple(name for name in there if not (in_space and engine_of(name).planar))


def computes_curves(solver: str) -> bool:
    """Whether a solver's engine computes its curves, instead of reading them from a file.

    An engine that cannot be loaded counts as one that computes; its run reports why.

    >>> computes_curves("mujoco:default"), computes_curves("recorded:rig")
    (True, False)
    """
    try:
        return engine_of(solver).computes
    except NoEngine:
        return True


@cache
def engine_of(name: str) -> Engine:
    """Load an engine by its name, or by the name of a solver.

    Raises
    ------
    NoEngine
        No engine has the name, it cannot be loaded, or it is no
        `proofmass.sim.protocol.engine.Engine`.
    """
    from proofmass.sim.protocol.engine import Engine

    name = name.partition(":")[0]
    if (entry := engine_entry_points().get(name)) is None:
        raise NoEngine(f"no simulator {name!r}; {suggest_names(name, engine_names())}")
    try:
        engine = load_entry_point(entry, "simulator")
    except NotLoaded as error:
        raise NoEngine(str(error)) from error
    if not isinstance(engine, Engine):
        raise NoEngine(
            f"simulator {name!r}, of {distribution_of(entry)}: {entry.value} is no object "
            f"of a class of proofmass.sim.protocol.engine.Engine"
        )
    return engine


def format_solver(solver: str) -> str:
    """Format a solver's name for a sentence.

    >>> format_solver("mujoco:default")
    'MuJoCo default'
    """
    engine, _, variant = solver.partition(":")
    try:
        title = engine_of(engine).title
    except NoEngine:  # a table may name an engine that only another machine has
        title = engine
    return f"{title} {variant}".strip()


def is_variant(solver: str) -> bool:
    """Whether a solver is an engine with other settings; a recorded party is never a variant.

    >>> is_variant("mujoco"), is_variant("mujoco:default"), is_variant("recorded:rig")
    (False, True, False)
    """
    return ":" in solver and computes_curves(solver)
