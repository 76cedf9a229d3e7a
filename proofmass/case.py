"""A case: one sidecar, parsed and checked.

The sidecar says what cannot be said in MJCF: where the truth comes from, which sensor must equal
which quantity, how close, and why that close.  Unknown keys are errors.
"""

import tomllib
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

from pydantic import Field, ValidationError, field_validator, model_validator

from proofmass.errors import InputError, suggest
from proofmass.files import read_text
from proofmass.refine import Refine
from proofmass.rod import RodTable
from proofmass.sidecar import Channel, DriveTable, RunTable, Tolerance
from proofmass.sim.protocol import Rod
from proofmass.strict import Kind, Strict
from proofmass.view import Beside, ChartTable, View

TYPES = ("int", "float", "str", "tuple[float, ...]")  # which pydantic adds to where an error is


class Case(Strict):
    """One sidecar.  `file` is where it was read; everything else stands in it.

    `unchecked` says that nothing of the case is checked, on purpose.  `unmatched` are sensors that
    are not listed and have the name of no quantity.
    """

    file: Path
    title: str
    source: str
    model: str
    start: str = "start"
    reference: str
    parameters: dict[str, float | str] = Field({})
    drive: tuple[DriveTable, ...] = ()
    rod: dict[str, RodTable] = Field({})
    run: dict[Kind, RunTable] = Field(min_length=1)
    settings: dict[str, dict[str, Any]] = Field({})
    channels: dict[str, Channel] = Field(min_length=1)
    tolerance: tuple[Tolerance, ...] = ()
    view: tuple[View, ...] = ()
    chart: tuple[ChartTable, ...] = ()
    beside: dict[str, Beside] = Field({})
    refine: Refine | None = None
    unchecked: bool = False
    unmatched: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """The sidecar's file name without its ending."""
        return self.file.stem

    @property
    def model_path(self) -> Path:
        """The MJCF file."""
        return self.file.parent / self.model

    def require_model(self) -> None:
        """Raise InputError if there is no such file."""
        if not self.model_path.is_file():
            raise InputError(self.file, "model", f"no file {self.model!r} beside the sidecar")

    @property
    def rods(self) -> tuple[Rod, ...]:
        """The rods that complete the model."""
        return tuple(table.built(name) for name, table in self.rod.items())

    @property
    def leader(self) -> DriveTable | None:
        """The first drive; None for a free motion."""
        return self.drive[0] if self.drive else None

    def drive_key(self, k: int, *keys: str) -> str:
        """Where drive number k, or a key of it, stands in the sidecar."""
        return ".".join(["drive", *[str(k)] * (len(self.drive) > 1), *keys])

    @field_validator("drive", "view", "chart", mode="before")
    @classmethod
    def _several(cls, value: Any) -> Any:
        return (value,) if isinstance(value, dict) else value

    @field_validator("drive")
    @classmethod
    def _led(cls, drives: tuple[DriveTable, ...]) -> tuple[DriveTable, ...]:
        for k, drive in enumerate(drives):
            drive.check_follower() if k else drive.check_leader()
            if drive.joint in [d.joint for d in drives[:k]]:
                raise ValueError(f"joint {drive.joint!r} is driven twice")
            if k and drive.to is not None and drives[0].to is None:
                raise ValueError(f"joint {drive.joint!r} has from and to, but the first drive has "
                                 f"none to be in proportion with; leave them out or give a law")
            alone = k and drive.to is None and drive.law is None
            if alone and drives[0].to is not None:
                raise ValueError(f"joint {drive.joint!r} needs from and to")
            if alone and not isinstance(drives[0].law, str):
                raise ValueError(f"joint {drive.joint!r} needs law = [value, rate, acceleration], "
                                 f"three columns of its own")
        return drives

    @model_validator(mode="after")
    def _consistent(self) -> "Case":
        if "sweep" in self.run and not self.drive:
            raise ValueError("run.sweep needs a [drive]: the joint that is moved")
        if "rest" in self.run:
            self._restful()
        recorded = self.reference.endswith(".csv")
        if recorded and not (self.file.parent / self.reference).is_file():
            raise ValueError(f"reference: no such recorded curve: there is no file "
                             f"{self.reference!r} beside the sidecar")
        for kind, run in self.run.items():
            if (run.n is None) != recorded:
                raise ValueError(f"run.{kind}.n " + ("is given by the recorded curve; leave it out"
                                                     if recorded else "is missing: samples"))
            if kind == "duration" and not (self.drive or run.until or recorded):
                raise ValueError(f"run.{kind}.until is missing: the last time [s]")
            for solver in run.solvers:
                self._overlap(kind, solver)
        return self

    @model_validator(mode="after")
    def _drawable(self) -> "Case":
        for view in self.view:
            self.run_of(view)
        if self.beside and not self.view:
            raise ValueError("beside is drawn in views; give a [[view]]")
        return self

    @model_validator(mode="after")
    def _refinable(self) -> "Case":
        if self.refine is None:
            return self
        if not self.rod:
            raise ValueError("refine needs a [rod.NAME]: it is cut into more and more segments")
        self._has_run("refine.run", self.refine.run)
        there = self.channels_of(self.refine.run)
        for pattern in self.refine.channels:
            if not any(fnmatchcase(name, pattern) for name in there):
                raise ValueError(f"refine.channels: {pattern!r} matches nothing; "
                                 f"{suggest(pattern, there)}")
        return self

    @model_validator(mode="after")
    def _matching(self) -> "Case":
        solvers = [solver for run in self.run.values() for solver in run.solvers]
        for name in self.settings:
            if name not in solvers:
                raise ValueError(f'settings."{name}": no run has this solver; '
                                 f"{suggest(name, solvers)}")
        for name, channel in self.channels.items():
            self._has_run(f"channels.{name}.only", channel.only)
        if self.unchecked and (self.tolerance or self.refine):
            raise ValueError("unchecked = true says that nothing is checked: leave it out, or the "
                             "tolerances and refine")
        for k, tolerance in enumerate(self.tolerance):
            self._has_run(f"tolerance.{k}.run", tolerance.run)
            self._match(f"tolerance.{k}", tolerance)
        return self

    def run_of(self, view: View) -> Kind:
        """The run that a view shows: the one it names, else the first that records its channels."""
        runs = self.run if view.run is None else [view.run]
        names = [n for n in (view.x, *view.y) if n in self.channels]
        for kind in (k for k in runs if k in self.run):
            if all(self.channels[n].only in (None, kind) for n in names):
                return kind
        raise ValueError(f"view {view.title!r}: no run.{view.run or '*'} records its channels "
                         f"{', '.join(names) or '(it names none)'}")

    def _restful(self) -> None:
        shortest = min((rod.length for rod in self.rod.values()), default=None)
        if shortest is None:
            raise ValueError("run.rest needs a [rod.NAME]: it is sampled along its length")
        if (self.run["rest"].until or shortest) > shortest:
            raise ValueError(f"run.rest.until goes beyond the shortest rod, {shortest:g} m")

    def _has_run(self, key: str, kind: Kind | None) -> None:
        if kind is not None and kind not in self.run:
            raise ValueError(f"{key}: there is no run.{kind}; there are: {', '.join(self.run)}")

    def _match(self, place: str, tolerance: Tolerance) -> None:
        """Raise ValueError for a pattern that matches no name, and if all together cover nothing.
        """
        there = {"solver": [s for run in self.run.values() for s in run.solvers],
                 "unit": [channel.unit for channel in self.channels.values()],
                 "channels": list(self.channels)}
        for key, names in there.items():
            for pattern in getattr(tolerance, key):
                literal = key == "unit" and pattern != "*"
                if not any(name == pattern if literal else fnmatchcase(name, pattern)
                           for name in names):
                    raise ValueError(f"{place}.{key}: {pattern!r} matches nothing; "
                                     f"{suggest(pattern, names)}")
        if not any(tolerance.covers(kind, solver, name, channel.unit)
                   for kind, run in self.run.items() for solver in run.solvers
                   for name, channel in self.channels_of(kind).items()):
            raise ValueError(f"{place}: it covers nothing: no channel of its run and its solvers "
                             f"has both one of its names and one of its units")

    def _overlap(self, kind: Kind, solver: str) -> None:
        for name, channel in self.channels.items():
            hits = [t for t in self.tolerance if t.covers(kind, solver, name, channel.unit)]
            if len(hits) > 1:
                raise ValueError(f"{len(hits)} tolerances cover channel {name!r} of {solver} in "
                                 f"{kind}; exactly one may")

    def channels_of(self, kind: str) -> dict[str, Channel]:
        """The channels that a run records."""
        return {n: c for n, c in self.channels.items() if c.only in (None, kind)}

    def tolerance_for(self, kind: str, solver: str, name: str) -> Tolerance | None:
        """The tolerance of a channel, or None: it is then shown but not checked."""
        unit = self.channels[name].unit
        return next((t for t in self.tolerance if t.covers(kind, solver, name, unit)), None)


def load_case(file: Path | str) -> Case:
    """Read a sidecar.

    Parameters
    ----------
    file : path
        ``NAME.toml``; the model is ``NAME.xml`` beside it unless the sidecar says otherwise.

    Returns
    -------
    Case

    Raises
    ------
    InputError
        Unreadable, an unknown key, a missing key, a tolerance without a reason, ...
    """
    from proofmass.defaults import (
        fill_defaults,  # which looks at the model and the reference of a case
    )

    file = Path(file)
    try:
        table = {"model": file.stem + ".xml", **tomllib.loads(read_text(file)), "unmatched": ()}
        case = Case(**{**fill_defaults(table, file), "file": file})
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"] if part not in TYPES)
        wrong = "missing; it is required" if first["type"] == "missing" else first["msg"]
        raise InputError(file, key, wrong.removeprefix("Value error, ")) from None
    except RecursionError:
        raise InputError(file, "", "its tables or arrays are nested too deeply") from None
    except (ValueError, OverflowError) as error:
        raise InputError(file, "", f"not TOML: {error}") from None
    case.require_model()
    return case
