"""An engine that runs in an interpreter of its own, as an `Engine` of proofmass."""

import copy
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path
from typing import Literal, Self

from pydantic import Field

from proofmass.base.strict import StrictNumber, Switch
from proofmass.sim.hosts.process import host_of, provide
from proofmass.sim.interpreter.mechanism import LinkStates, NeutralMechanism
from proofmass.sim.neutral import NeutralReader, read_mechanism, support_without
from proofmass.sim.plane import find_plane
from proofmass.sim.protocol.curves import Curves
from proofmass.sim.protocol.engine import Engine
from proofmass.sim.protocol.failures import Unsupported
from proofmass.sim.protocol.run import Run
from proofmass.sim.protocol.settings import EngineSettings
from proofmass.sim.resting import read_rest
from proofmass.sim.states import RestCurves, StateCurves

SCRIPTS = Path(__file__).parent / "scripts"
PIN = re.compile(r"([A-Za-z0-9._-]+)(\[[\w,-]+\])?==([A-Za-z0-9.!+_-]+)")
"""A requirement with one version."""


class HostedSettings(EngineSettings):
    """Settings that all engines in interpreters of their own have.

    `timestep` [s] replaces that of the model.  ``defaults = True`` stands for the engine's own
    default settings, with this `timestep`.
    """

    timestep: StrictNumber = Field(0.002, gt=0)
    defaults: Switch = False


class SteppedSettings(HostedSettings):
    """Settings of an engine with semi-implicit steps, whose velocities belong to their middle.

    With `reading` ``plain`` the velocity at a sample is that behind the step that ends there, which
    is of first order.  With ``half step`` the run starts with the rates of half a step before, and
    the velocity at a sample is the mean of those before and behind it: of second order.
    """

    reading: Literal["half step", "plain"] = "half step"


@dataclass(frozen=True)
class About:
    """What people want to know of an engine before they choose it.

    Attributes
    ----------
    solves : str
        How it satisfies constraints, and its integrator.
    licence : str
    practice : str
        The settings that proofmass gives it, which are not its defaults.
    trap : str
        What is easily mistaken, such as an unrelated package of its name.
    """

    solves: str
    licence: str
    practice: str = ""
    trap: str = ""


class HostedEngine(Engine):
    """An engine in an interpreter of its own.

    Its script has a function ``simulate(mechanism, settings)`` and imports the engine and
    ``proofmass_host``, see `proofmass.sim.interpreter`.

    Parameters
    ----------
    script : str or Path
        The script, by its name in this distribution or by its path.
    requires : sequence of str
        Packages with versions, that of the engine first, such as ``drake==1.51.1``.
    title : str
        Name in a sentence.
    about : About
    settings : type of EngineSettings
    lacks : sequence of str
        Features of a model that the engine has not, of those that a neutral mechanism has; see
        `proofmass.sim.neutral`.
    planar : bool
        Whether it moves bodies only in a plane.
    stops : bool
        Whether it has stops at the ends of the ranges of joints.
    friction : bool
        Whether it has dry friction of hinges and slides, in time and at rest.
    contacts : bool
        Whether its script builds the shapes and contacts of a mechanism, in time.
    rests : bool
        Whether its script comes to rest where `NeutralMechanism.rest` asks for it, as all scripts
        do whose steps `record` makes and whose links have the forces of `link_forces`.
    python : str
        An interpreter that has the packages; empty: uv makes one.
    oldest : str
        The oldest release that the script can drive, with which a comparison of all releases
        begins; empty: not known.

    Examples
    --------
    >>> from proofmass.sim.hosts.engine import About, HostedEngine
    >>> engine = HostedEngine(
    ...     "mine.py", ("mine==1.0",), title="Mine", about=About("soft constraints", "MIT")
    ... )
    >>> engine.at_version("1.1").requires
    ('mine==1.1',)
    """

    def __init__(
        self,
        script: str | Path,
        requires: Sequence[str],
        *,
        title: str,
        about: About,
        settings: type[EngineSettings] = HostedSettings,
        lacks: Sequence[str] = (),
        planar: bool = False,
        stops: bool = False,
        friction: bool = False,
        contacts: bool = False,
        rests: bool = False,
        python: str = "",
        oldest: str = "",
    ) -> None:
        if isinstance(requires, str):
            raise ValueError(f"{title} requires {requires!r}; give a tuple of such texts")
        for one in requires:
            if not PIN.fullmatch(one):
                raise ValueError(f"{title} requires {one!r}; give one version, NAME==VERSION")
        self.script, self.requires = SCRIPTS / script, tuple(requires)
        self.title, self.about, self.python, self.oldest = title, about, python, oldest
        self.settings, self.planar, self.lacks = settings, planar, tuple(lacks)
        self.stops, self.contacts, self.rests = stops, contacts, rests
        self.support = support_without(tuple(lacks), friction)  # type: ignore[misc]

    @property
    def version(self) -> str:
        """The version of the engine's own package."""
        return self.requires[0].partition("==")[2]

    def at_version(self, number: str) -> Self:
        """The same engine in another version of its own package."""
        other = copy.copy(self)
        name = self.requires[0].partition("==")[0]
        other.requires = (f"{name}=={number}", *self.requires[1:])
        other.title = f"{self.title} {number}"
        return other

    def versions(self) -> dict[str, str]:
        """What computes: the packages, and a digest of the script."""
        pins = dict(one.split("==") for one in self.requires)
        return pins | {"host": sha256(self.script.read_bytes()).hexdigest()}

    def provide(self) -> str:
        """Fetch the packages; returns why they cannot be had, or nothing if they are there."""
        return provide(self.requires, self.python)

    def simulate(self, model: Path, run: Run) -> Curves:
        """See `Engine.simulate`; the engine is started if it does not wait for a run."""
        own = self.settings.read(run.settings)
        reader, mechanism = self.read(model, run, own)
        host = host_of(self.script, self.requires, self.python)
        used = own.model_dump(exclude={"timestep"})
        states = host.run(mechanism, used | {"given": sorted(own.model_fields_set)})
        shown = {key: value for key, value in used.items() if value not in (False, "")}
        return self.curves(reader, mechanism, states, shown, host.versions)

    def read(
        self, model: Path, run: Run, own: EngineSettings
    ) -> tuple[NeutralReader, NeutralMechanism]:
        """The model in its start, and the mechanism that the engine gets."""
        defaults = getattr(own, "defaults", False)
        asks = "timestep" in own.model_fields_set or defaults
        step = float(getattr(own, "timestep", 0.0)) if asks else None
        if run.kind in ("sweep", "equilibrium") and self.rests:
            rest = read_rest(model, replace(run, settings={}), self.support, step)
            if self.planar:
                find_plane(rest.model, rest.data)
            if not self.stops and (name := rest.joint_on_stop()):
                raise Unsupported(f"joint {name!r} rests on the end of its range")
            return rest, rest.mechanism()
        own_run = replace(run, settings={})
        reader = read_mechanism(model, own_run, self.support, step, self.contacts)
        if self.planar:
            find_plane(reader.model, reader.data)
        middle = getattr(own, "reading", "") == "half step" and not defaults
        return reader, reader.mechanism(-0.5 * reader.step if middle else 0.0)

    def curves(
        self,
        reader: NeutralReader,
        mechanism: NeutralMechanism,
        states: LinkStates,
        settings: dict[str, object],
        versions: dict[str, str],
    ) -> Curves:
        """The curves of the states that the engine returned."""
        kind = RestCurves if mechanism.rest else StateCurves
        found = kind(reader, mechanism, states).curves(settings, self.stops)
        computed = ", ".join(f"{name} {version}" for name, version in versions.items())
        notes = (*found.notes, f"Computed by {computed}.")
        return replace(found, notes=notes, versions=versions, compile_seconds=states.compiled)
