"""Find engines: entry points of two groups, loaded by name.

Engines of the group ``proofmass.engines`` run in the interpreter of proofmass, and those of this
distribution run every case that names no other.  Engines of ``proofmass.hosted_engines`` run in
interpreters of their own, and only where a command or a sidecar names them.  A name may state a
version, ``mujoco==3.3.7``: the engine then runs in an interpreter that has it.
"""

from __future__ import annotations

import re
from functools import cache
from typing import TYPE_CHECKING

from proofmass.base.entry_points import (
    OWN_DISTRIBUTION,
    NotLoaded,
    distribution_of,
    entry_points_of,
    foreign_distribution,
    load_entry_point,
)
from proofmass.base.errors import suggest_names

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

    from proofmass.sim.protocol.engine import Engine

ENGINE_GROUP, HOSTED_GROUP = "proofmass.engines", "proofmass.hosted_engines"
VERSION_MARK = "=="
"""Between the name of an engine and the version in which it runs."""
NATIVE_ENGINE = "mujoco"
"""The engine whose own format is MJCF: it runs any model, and gives the poses of drawings."""


VERSION = re.compile(r"\d[A-Za-z0-9.!+-]*")
"""A version of a package."""
OTHER_VERSION = re.compile(r"[^\w:]*v?(\d.*)")
"""A version as other programs want it behind a name, such as ``@3.2.0``."""


class NoEngine(ValueError):
    """No engine has that name, or it cannot be loaded; the message says why."""


def engine_entry_points(group: str = ENGINE_GROUP) -> dict[str, EntryPoint]:
    """Entry points of a group by the names of their engines; no engine is imported.

    If two distributions provide an engine of the same name, that of this distribution is taken, or
    else the first in the order of their names.
    """
    return {name: same[0] for name, same in entry_points_of(group).items()}


def engine_names() -> list[str]:
    """The names of all engines, those of this distribution first."""
    return list(engine_entry_points())


def hosted_names() -> list[str]:
    """The names of the engines that run in interpreters of their own; none is imported."""
    return list(engine_entry_points(HOSTED_GROUP))


def distribution_of_engine(name: str) -> str:
    """The distribution of others that brings an engine; empty for engines of this one."""
    groups = ENGINE_GROUP, HOSTED_GROUP
    return next((found for one in groups if (found := foreign_distribution(one, name))), "")


def is_engine(name: str) -> bool:
    """Whether there is an engine of a name, which may state a version; none is imported.

    >>> is_engine("mujoco"), is_engine("mujoco==3.3.7"), is_engine("mujocco")
    (True, True, False)
    """
    return name.partition(VERSION_MARK)[0] in (*engine_names(), *hosted_names())


def suggest_engines(name: str) -> str:
    """A phrase that says what would have been right instead of a wrong name of an engine.

    >>> suggest_engines("mujoco@3.2.0")
    "a version is asked for by '==': mujoco==3.2.0"
    """
    names = [*engine_names(), *hosted_names()]
    for one in names:
        version = OTHER_VERSION.fullmatch(name, len(one))
        if version and name.startswith(one):
            return f"a version is asked for by {VERSION_MARK!r}: {one}{VERSION_MARK}{version[1]}"
    return suggest_names(name.partition(VERSION_MARK)[0], names)


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
    """Load an engine by its name, which may state a version, or by the name of a solver.

    Raises
    ------
    NoEngine
        No engine has the name, it cannot be loaded, it is no
        `proofmass.sim.protocol.engine.Engine`, or it is not run in other versions.
    """
    from proofmass.sim.protocol.engine import Engine
    from proofmass.sim.protocol.failures import Unsupported

    name, mark, version = name.partition(":")[0].partition(VERSION_MARK)
    found = engine_entry_points().get(name) or engine_entry_points(HOSTED_GROUP).get(name)
    if found is None:
        raise NoEngine(f"no simulator {name!r}; {suggest_engines(name)}")
    try:
        engine = load_entry_point(found, "simulator")
    except NotLoaded as error:
        raise NoEngine(str(error)) from error
    if not isinstance(engine, Engine):
        raise NoEngine(
            f"simulator {name!r}, of {distribution_of(found)}: {found.value} is no object "
            f"of a class of proofmass.sim.protocol.engine.Engine"
        )
    if not mark:
        return engine
    if not VERSION.fullmatch(version):
        raise NoEngine(f"{name}{mark}{version}: {version!r} is no version, such as {name}==1.2.3")
    try:
        return engine.at_version(version)
    except Unsupported as error:
        raise NoEngine(f"{name}{mark}{version}: {error}") from error


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
