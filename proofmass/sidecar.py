"""The small tables of a sidecar: drives, runs, channels, tolerances."""

from fnmatch import fnmatchcase
from typing import Any

from pydantic import Field, field_validator, model_validator

from proofmass.isolate import MEMORY
from proofmass.strict import Kind, Strict
from proofmass.units import si_unit


def known_unit(unit: str) -> str:
    """The unit itself; ValueError if there is no such unit."""
    si_unit(unit)
    return unit


class DriveTable(Strict):
    """``[drive]``, or one of several ``[[drive]]``: a joint that is moved, and how.

    One of: ``from``, ``to`` and ``rate`` (constant speed); ``from``, ``to`` and ``period`` (a swing
    to and fro); ``law`` with ``until``, a function of the reference's module, or three columns of
    a recorded reference (value, rate, acceleration).  The first drive leads.  Another with ``from``
    and ``to`` keeps its proportion to the first one's progress (`to` may equal `from`: it is held);
    one with a joint alone takes its row of the first one's law.
    """

    joint: str
    start: float = Field(0.0, alias="from")
    to: float | None = None
    rate: float | None = None
    period: float | None = Field(None, gt=0)
    law: str | tuple[str, str, str] | None = None
    until: float | None = Field(None, gt=0)
    parameters: dict[str, float] = Field({})

    @field_validator("law", mode="before")
    @classmethod
    def _named(cls, law: Any) -> Any:
        columns = isinstance(law, list | tuple) and [type(c) for c in law] == [str] * 3
        if law is not None and not isinstance(law, str) and not columns:
            raise ValueError(f"{law!r} is neither the name of a function of the reference's module "
                             f"nor three columns of a recorded curve: [value, rate, acceleration]")
        return law

    @property
    def steady(self) -> bool:
        """Whether it runs at constant speed, so that a sweep can go by its value."""
        return self.to is not None and self.period is None

    def check_leader(self) -> None:
        """Raise ValueError if this table alone does not say how its joint moves."""
        if (self.to is None) == (self.law is None):
            raise ValueError("give either from, to and rate, or from, to and period, or law")
        if self.rate is not None and not self.steady:
            raise ValueError("rate goes with from and to alone")
        if isinstance(self.law, str) and self.until is None:
            raise ValueError("a law needs until = the last time [s]")
        if self.to is not None and self.to == self.start:
            raise ValueError("to must differ from 'from'")
        if self.steady and not (float(self.to or 0) - self.start) * self.speed > 0:
            raise ValueError("rate must be non-zero and lead from 'from' to 'to'")

    def check_follower(self) -> None:
        """Raise ValueError if this table says more than a drive after the first one may."""
        for key in ("rate", "period", "until"):
            if getattr(self, key) is not None:
                raise ValueError(f"{key} belongs to the first drive, which leads")

    @property
    def speed(self) -> float:
        """Rate of a steady drive [rad/s or m/s], 1 when the sidecar gives none."""
        return 1.0 if self.rate is None else self.rate


MOST = 10**8
"""Samples of a run: a curve of them is 0.8 GB, and a run has dozens of curves."""


class RunTable(Strict):
    """``[run.sweep]``, ``[run.duration]`` or ``[run.rest]``: how many samples, which solvers.

    `until` is the last time [s], or the last arc length [m] of a rest: the shortest rod's.  A run,
    its model and its reference have `timeout` [s] and `memory` [GiB].
    """

    n: int | None = Field(None, ge=2, le=MOST)
    until: float | None = Field(None, gt=0)
    solvers: tuple[str, ...] = Field(min_length=1)
    timeout: float = Field(120.0, gt=0)
    memory: float = Field(MEMORY, gt=0)


class Channel(Strict):
    """``[channels]``: sensor = scale * quantity + shift, in `unit`.

    `equals` names a quantity of the reference, or is a number: then the curve must be constant.
    `unit` is any unit of what the sensor delivers; sensor and quantity are both brought from SI to
    it.  `shift`, and `equals` if it is a number, are in that unit; `scale` is a plain factor.
    """

    equals: str | float
    unit: str
    scale: float = 1.0
    shift: float = 0.0
    only: Kind | None = None

    @field_validator("unit")
    @classmethod
    def _known_unit(cls, unit: str) -> str:
        return known_unit(unit)

    @property
    def si_unit(self) -> str:
        """The SI unit of the same quantity, in which simulators and references deliver it."""
        return si_unit(self.unit)[0]

    @property
    def factor(self) -> float:
        """What a number in `unit` is multiplied by to be in SI."""
        return si_unit(self.unit)[1]


class Tolerance(Strict):
    """``[[tolerance]]``: a number, where it holds, and the reason for it.

    `run`, `solver`, `unit` and `channels` select; what is left out selects all.  The number is
    `abs`, in the channel's unit, or `of_range`, a share of the reference curve's range; of a curve
    that does not move, a share of its size, see `proofmass.compare.scale_of`.
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
                and ("*" in self.unit or unit in self.unit)
                and any(fnmatchcase(name, c) for c in self.channels))

    def allowed(self, scale: float) -> float:
        """The largest error allowed on a curve of that range or size, in the curve's unit."""
        return self.abs if self.abs is not None else float(self.of_range or 0) * scale
