"""Cells of a table of cases and solvers: one run each, compared with its reference, and stored.

A cell is kept in a file of its own, so that a table which was stopped can be continued, and a
solver that is added later costs its own cells only.
"""

import io
import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property, partial
from math import isnan, nan
from typing import Any, Protocol, TypeVar, cast

import numpy as np

from proofmass.base.arrays import Array
from proofmass.base.errors import InputError
from proofmass.base.files import write_atomically
from proofmass.base.json_values import replace_nonfinite, restore_nan
from proofmass.base.strict import Kind
from proofmass.base.units import FORCE_UNITS, MOTION_UNITS, POSITION_UNITS
from proofmass.base.worker import call_isolated
from proofmass.case.case import Case
from proofmass.run.asked import with_engines
from proofmass.run.fingerprint import (
    bytes_of_case_model,
    digest,
    digest_recorded_files,
    package_versions,
)
from proofmass.studies.measure import STUDY_OUTCOME_OF_EXCEPTION
from proofmass.studies.store import Store, digest_of_sources, read_json
from proofmass.studies.study import Study
from proofmass.verdict.outcome import Outcome

T = TypeVar("T")

SILENT_SHARE = 0.1
"""Error, as a share of the range, from which a run that ends without a word is silently wrong: no
curve of an engineer's report would be taken for the reference's."""
MOTION_KINDS = "position", "velocity", "acceleration"
"""Kinds of channels whose errors a cell of a table has."""
KINDS_OF_RUNS: tuple[Kind, ...] = ("dynamics", "sweep", "equilibrium")
"""Kinds of runs, that which more engines have first."""
CHANNEL_KINDS: dict[str, tuple[str, ...]] = {
    "position": POSITION_UNITS,
    "velocity": MOTION_UNITS["velocity"],
    "acceleration": MOTION_UNITS["acceleration"],
    "force": FORCE_UNITS,
}
"""Kinds of channels by the units of their quantities."""
OTHER_KIND = "other"
"""The kind of all other channels."""


@dataclass(frozen=True)
class ChannelError:
    """The error of a channel.

    Attributes
    ----------
    channel, unit, kind : str
    error : float
        The largest [its unit].
    share : float
        The same over the range of the reference, or over its size if it is constant [1].
    scale : float
        That range or size [SI]; NaN where the error is 0.
    """

    channel: str
    unit: str
    kind: str
    error: float
    share: float
    scale: float = nan


@dataclass(frozen=True)
class CellResult:
    """What became of a run of a case by a solver.

    Attributes
    ----------
    case, run, solver : str
    outcome : str
        ``ran``, or the outcome of a run that failed or was not made.
    message : str
        Why it failed or was not made.
    errors : tuple of ChannelError
        Of all channels that the engine delivers.
    missing : dict of str to str
        Channels that it does not deliver, and why.
    seconds, compile_seconds : float
        Processor time of the steps, and of compilation before them [s].
    step : float
        Time step [s].
    settings : dict
        Settings of the run that are not the engine's defaults or that it chose.
    versions : dict of str to str
        What computed, of an engine in another interpreter.
    """

    case: str
    run: str
    solver: str
    outcome: str = Outcome.RAN
    message: str = ""
    errors: tuple[ChannelError, ...] = ()
    missing: dict[str, str] = field(default_factory=dict)
    seconds: float = nan
    compile_seconds: float = 0.0
    step: float = nan
    settings: dict[str, Any] = field(default_factory=dict)
    versions: dict[str, str] = field(default_factory=dict)

    def worst(self, kind: str = "") -> ChannelError | None:
        """The channel with the largest share of the range, of a kind or of all kinds."""
        found = [one for one in self.errors if kind in ("", one.kind)]
        return max(found, key=lambda one: one.share, default=None)

    @property
    def position(self) -> float:
        """Largest error of positions over their range [1]; of all channels if there are none."""
        worst = self.worst("position") or self.worst()
        return worst.share if worst else nan

    @property
    def is_filled(self) -> bool:
        """Whether the run ended with curves that were compared."""
        return self.outcome == Outcome.RAN and bool(self.errors)

    @property
    def is_silently_wrong(self) -> bool:
        """Whether a run that ended without a word is off by more than `SILENT_SHARE`."""
        return self.is_filled and not self.position <= SILENT_SHARE

    @classmethod
    def read(cls, record: dict[str, Any]) -> "CellResult":
        """The result of a record that `record` made."""
        errors = tuple(ChannelError(**restore_nan(one)) for one in record["errors"])
        return cls(**{**restore_nan(record), "errors": errors})

    def record(self) -> dict[str, Any]:
        """The result as values of JSON; numbers that are not finite are None."""
        return replace_nonfinite(asdict(self))


ResultAndCurves = tuple[CellResult, dict[str, Array]]
"""A result, and its curves by channel [SI]; none of a run that failed."""


def format_one_digit(share: float) -> str:
    """A share of a range with one digit.

    >>> format_one_digit(2.3e-5), format_one_digit(1.2), format_one_digit(nan)
    ('2e-5', '1e+0', '?')
    """
    return "?" if isnan(share) else f"{share:.0e}".replace("e-0", "e-").replace("e+0", "e+")


def format_motion_errors(result: CellResult) -> str:
    """The largest errors of positions, velocities and accelerations, or of all channels instead."""
    found = [worst.share for kind in MOTION_KINDS if (worst := result.worst(kind))]
    return " / ".join(map(format_one_digit, found or [result.position]))


def channel_kind(unit: str) -> str:
    """The kind of a channel by the SI unit of its quantity.

    >>> channel_kind("rad"), channel_kind("m/s"), channel_kind("J")
    ('position', 'velocity', 'other')
    """
    return next((kind for kind, units in CHANNEL_KINDS.items() if unit in units), OTHER_KIND)


@dataclass(frozen=True)
class Cell:
    """A run of a case by a solver.

    Attributes
    ----------
    case : Case
        Its sidecar may name other solvers.
    run : str
    solver : str
    """

    case: Case
    run: Kind
    solver: str

    @cached_property
    def asked(self) -> Case:
        """The case with this solver alone."""
        return with_engines(self.case, (self.solver,))

    @property
    def key(self) -> str:
        """Digest of all that the result depends on."""
        case = self.asked
        table = case.run[self.run]
        parts = {
            "model": digest(bytes_of_case_model(case)),
            "recorded": digest_recorded_files(case),
            "sidecar": case.model_dump(mode="json", exclude={"file", "title", "source", "view"}),
            "run": (self.run, table.timeout, table.memory),
            "versions": package_versions(self.solver),
            "sources": digest_of_sources(),
        }
        return digest(json.dumps(parts, sort_keys=True, default=str).encode())

    def measure(self) -> ResultAndCurves:
        """Run and compare in a worker; the result, and the curves [SI] by channel."""
        table = self.asked.run[self.run]
        empty = CellResult(self.case.name, self.run, self.solver)
        return measure_isolated(
            measure_here, self.asked, empty, timeout=table.timeout, memory=table.memory
        )


def measure_isolated(
    function: Callable[[T, CellResult], ResultAndCurves],
    subject: T,
    empty: CellResult,
    timeout: float,
    memory: float,
) -> ResultAndCurves:
    """Measure in a worker; what fails is the outcome of the `empty` result, without curves.

    Parameters
    ----------
    function : callable
        ``function(subject, empty)`` fills the result.
    subject : object
        What is measured.
    empty : CellResult
        A result with its names alone.
    timeout, memory : float
        Limits of processor time [s] and memory [GiB].
    """
    try:
        return call_isolated(function, subject, empty, timeout=timeout, memory=memory)
    except Exception as error:
        outcome, words = describe_failure(error)
        return replace(empty, outcome=outcome, message=words), {}


def describe_failure(error: Exception) -> tuple[Outcome, str]:
    """The outcome and the message of a run that raised an exception."""
    if isinstance(error, InputError):
        return Outcome.NO_START, ": ".join(filter(None, (error.key, error.wrong)))
    for kind in type(error).__mro__:
        if kind in STUDY_OUTCOME_OF_EXCEPTION:
            return STUDY_OUTCOME_OF_EXCEPTION[kind], str(error)
    return Outcome.CRASHED, f"{type(error).__name__}: {error}"


def measure_here(case: Case, empty: CellResult) -> ResultAndCurves:
    """Do what `Cell.measure` does, in this process."""
    from proofmass.batch.work import compare_and_share
    from proofmass.run.solve import solve_here

    kind = cast(Kind, empty.run)
    curves = solve_here(case, kind, empty.solver)
    found = compare_and_share(case, kind, empty.solver, curves, detectable=False)
    errors = tuple(
        ChannelError(
            c.channel,
            c.unit,
            channel_kind(case.channels[c.channel].si_unit),
            c.error_max,
            c.relative_to_range,
            c.error_rms * case.channels[c.channel].factor / c.nrmse if c.nrmse else nan,
        )
        for c in found
        if c.channel in curves.channels
    )
    result = replace(
        empty,
        outcome=Outcome.STOPPED if curves.stopped else Outcome.RAN,
        message=curves.stopped,
        errors=errors,
        missing=curves.missing,
        seconds=curves.seconds,
        compile_seconds=curves.compile_seconds,
        step=curves.made_step,
        settings={key: value for key, value in curves.settings.items() if key != "timestep"},
        versions=curves.versions,
    )
    return result, {"x": curves.x, **curves.channels}


class MeasuredCell(Protocol):
    """What is measured and stored: a `Cell`, or something like it."""

    @property
    def key(self) -> str:
        """Digest of all that the result depends on."""

    def measure(self) -> ResultAndCurves:
        """The result and the curves."""


def stored_cell(cell: MeasuredCell, store: Store) -> CellResult:
    """The result of a cell: read from its file, or measured and written, with its curves."""
    file = store.folder / f"{cell.key}.cell.json"
    if file.is_file():
        return CellResult.read(read_json(file))
    found, curves = cell.measure()
    if curves:
        packed = io.BytesIO()
        np.savez(packed, **curves)  # type: ignore[arg-type]
        write_atomically(file.with_suffix(".npz"), packed.getvalue())
    write_atomically(file, json.dumps(found.record(), indent=1, allow_nan=False))
    return found


def stored_curves(cell: MeasuredCell, store: Store) -> dict[str, Array]:
    """The curves of a stored cell [SI], by channel; none of a run that failed."""
    file = store.folder / f"{cell.key}.cell.npz"
    if not file.is_file():
        return {}
    with np.load(file, allow_pickle=False) as arrays:
        return dict(arrays)


def cells_of(
    cases: Iterable[Case], solvers: Sequence[str], runs: Sequence[Kind] = ()
) -> list[Cell]:
    """The cells of all cases that have one of some runs, case by case.

    Without `runs` it is one run of each case: that in time, or else its sweep or its equilibrium.
    """
    return [
        Cell(case, run, solver)
        for case in cases
        for run in [one for one in runs or KINDS_OF_RUNS if one in case.run][: None if runs else 1]
        for solver in solvers
    ]


def measure_cells(cells: Sequence[Cell], study: Study) -> list[CellResult]:
    """The results of cells, in their order; `study.progress` is called after each."""
    found: dict[int, CellResult] = {}
    for k, result in study.results(partial(stored_cell, store=study.store), [(c,) for c in cells]):
        found[k] = result
        label = f"{result.case} {result.run} {result.solver}"
        study.progress(label, len(found), len(cells))
    return [found[k] for k in range(len(cells))]
