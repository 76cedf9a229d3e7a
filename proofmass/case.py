"""A case: one sidecar, parsed and checked.

The sidecar says what cannot be said in MJCF: where the truth comes from, which sensor must equal
which quantity, how close, and why that close.  Unknown keys are errors.
"""

import math
import tomllib
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator

from proofmass.errors import InputError

Kind = Literal["sweep", "duration"]


class Strict(BaseModel):
    """A table of the sidecar: unknown keys are errors that list the known ones."""

    model_config = ConfigDict(frozen=True, extra="forbid", populate_by_name=True)

    @model_validator(mode="before")
    @classmethod
    def _known(cls, table: Any) -> Any:
        known = [f.alias or name for name, f in cls.model_fields.items()]
        for key in table if isinstance(table, dict) else ():
            if key not in known and key not in cls.model_fields:
                raise ValueError(f"unknown key {key!r}; known: {', '.join(known)}")
        return table


class DriveTable(Strict):
    """``[drive]``: the joint that is moved, and how.

    Either ``from``, ``to`` and ``rate`` (constant speed), or ``law`` with ``until``: a function
    of the reference's module, or three columns of a recorded reference (value, rate, acceleration).
    """

    joint: str
    start: float = Field(0.0, alias="from")
    to: float | None = None
    rate: float = 1.0
    law: str | tuple[str, str, str] | None = None
    until: float | None = Field(None, gt=0)
    parameters: dict[str, float] = {}

    @model_validator(mode="after")
    def _one_way(self) -> "DriveTable":
        if (self.to is None) == (self.law is None):
            raise ValueError("give either from, to and rate, or law")
        if isinstance(self.law, str) and self.until is None:
            raise ValueError("a law needs until = the last time [s]")
        if self.to is not None and not (self.to - self.start) * self.rate > 0:
            raise ValueError("rate must be non-zero and lead from 'from' to 'to'")
        return self


class RunTable(Strict):
    """``[run.sweep]`` or ``[run.duration]``: how many samples, and which solvers."""

    n: int | None = Field(None, ge=2)
    until: float | None = Field(None, gt=0)
    solvers: tuple[str, ...] = Field(min_length=1)
    timeout: float = Field(120.0, gt=0)


class Channel(Strict):
    """``[channels]``: sensor = scale * quantity + shift, in `unit`."""

    equals: str
    unit: str
    scale: float = 1.0
    shift: float = 0.0
    only: Kind | None = None


class Tolerance(Strict):
    """``[[tolerance]]``: a number, where it holds, and the reason for it.

    `run`, `solver`, `unit` and `channels` select; what is left out selects all.  The number is
    `abs`, in the channel's unit, or `of_range`, a share of the reference curve's range.
    """

    run: Kind | None = None
    solver: tuple[str, ...] = ("*",)
    unit: tuple[str, ...] = ("*",)
    channels: tuple[str, ...] = ("*",)
    abs: float | None = Field(None, gt=0)
    of_range: float | None = Field(None, gt=0)
    why: str

    @field_validator("solver", "unit", "channels", mode="before")
    @classmethod
    def _listed(cls, value: Any) -> Any:
        return (value,) if isinstance(value, str) else value

    @model_validator(mode="after")
    def _complete(self) -> "Tolerance":
        if (self.abs is None) == (self.of_range is None):
            raise ValueError("give either abs (in the channel's unit) or of_range")
        if not self.why.strip():
            raise ValueError("why is empty; a tolerance needs its reason")
        return self

    def covers(self, run: str, solver: str, name: str, unit: str) -> bool:
        """Whether this tolerance speaks of that channel of that solver in that run."""
        return (self.run in (None, run)
                and any(fnmatchcase(solver, s) for s in self.solver)
                and (self.unit == ("*",) or unit in self.unit)
                and any(fnmatchcase(name, c) for c in self.channels))

    def allowed(self, span: float) -> float:
        """The largest error allowed on a curve of that range, in the curve's unit."""
        return self.abs if self.abs is not None else float(self.of_range or 0) * span


class Case(Strict):
    """One sidecar.  `file` is where it was read; everything else stands in it."""

    file: Path
    title: str
    source: str
    model: str
    start: str = "start"
    reference: str
    parameters: dict[str, float] = {}
    drive: DriveTable | None = None
    run: dict[Kind, RunTable] = Field(min_length=1)
    settings: dict[str, dict[str, Any]] = {}
    channels: dict[str, Channel] = Field(min_length=1)
    tolerance: tuple[Tolerance, ...] = ()

    @property
    def name(self) -> str:
        """The sidecar's file name without its ending."""
        return self.file.stem

    @property
    def model_path(self) -> Path:
        """The MJCF file."""
        return self.file.parent / self.model

    @model_validator(mode="after")
    def _consistent(self) -> "Case":
        for key, value in self.parameters.items():
            if not math.isfinite(value):
                raise ValueError(f"parameters.{key} is {value}; it must be finite")
        if "sweep" in self.run and not self.drive:
            raise ValueError("run.sweep needs a [drive]: the joint that is moved")
        recorded = self.reference.endswith(".csv")
        for kind, run in self.run.items():
            if (run.n is None) != recorded:
                raise ValueError(f"run.{kind}.n " + ("is given by the recorded curve; leave it out"
                                                     if recorded else "is missing: samples"))
            if not self.drive and run.until is None and not recorded:
                raise ValueError(f"run.{kind}.until is missing: the last time [s]")
            for solver in run.solvers:
                self._overlap(kind, solver)
        return self

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
    file = Path(file)
    try:
        table = tomllib.loads(file.read_text(encoding="utf-8"))
        case = Case(**{"model": file.stem + ".xml", **table, "file": file})
    except FileNotFoundError:
        raise InputError(file, "", "no such file") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(file, "", f"not TOML: {error}") from None
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        wrong = "missing; it is required" if first["type"] == "missing" else first["msg"]
        raise InputError(file, key, wrong.removeprefix("Value error, ")) from None
    if not case.model_path.is_file():
        raise InputError(file, "model", f"no file {case.model!r} beside the sidecar")
    return case
