"""Records of a study: a run with its setting, its errors and its cost; read and write their tables.

A setting is an engine with values of its parameters.  A table is a CSV file with one record in each
row; a second file, ``NAME.columns.md``, describes the columns.
"""

import csv
import io
import json
import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from importlib.util import find_spec
from pathlib import Path
from typing import Any, get_type_hints

from proofmass.base import units
from proofmass.base.errors import InputError
from proofmass.base.files import write_output
from proofmass.base.strict import Kind
from proofmass.case.case import Case
from proofmass.run.solve import plan_run
from proofmass.sim.protocol.run import Run
from proofmass.sim.protocol.settings import ParameterValue
from proofmass.verdict.outcome import Outcome


@dataclass(frozen=True)
class Setting:
    """An engine and the values of its parameters, which replace all settings of the sidecar.

    Attributes
    ----------
    engine : str
        Name of the engine.
    parameters : dict of str to ParameterValue
        Settings of the engine, such as timestep [s]; and `segments`, the number of segments of
        each rod of the case.
    """

    engine: str
    parameters: dict[str, ParameterValue] = field(default_factory=dict)

    def with_parameters(self, **parameters: ParameterValue) -> "Setting":
        """The same setting with some parameters replaced or added."""
        return Setting(self.engine, {**self.parameters, **parameters})

    def apply_to(self, case: Case, kind: Kind) -> tuple[Case, Run]:
        """The case with this setting, its rods with that many segments, and the run to ask for."""
        parameters: dict[str, Any] = dict(self.parameters)
        if segments := parameters.pop("segments", None):
            case = case.with_segments(dict.fromkeys(case.rod, segments))
        case = case.model_copy(update={"settings": {self.engine: parameters}})
        return case, plan_run(case, kind, self.engine)


NAN = float("nan")
KIND_UNITS = {**units.MOTION_UNITS, "force": units.FORCE_UNITS, "energy": ("J",)}
"""SI units by kind of channel; a run has one error for each kind of channel that it has."""


def format_kind(kind: str) -> str:
    """The name of a kind of error in a sentence.

    >>> format_kind("force"), format_kind("velocity")
    ('force or torque', 'velocity')
    """
    return "force or torque" if kind == "force" else kind


@dataclass(frozen=True)
class StudyRow:
    """One run of a study.

    Attributes
    ----------
    study : str
        trade, choose, stress or diet.
    case, run, engine : str
        Name of the case, kind of run, and name of the engine.
    series, varied : str
        The convergence series that the run belongs to (all parameters but one, in words), and
        the parameter that is varied.
    value : float
        Value of the varied parameter [its unit], such as a time step in s.
    parameters : dict of str to ParameterValue
        Values of all parameters.
    errors : dict of str to float
        Largest error of each kind of channel, as a share of the reference's range [1]; the
        reference is evaluated at the motion that the drives really had.
    invariants : dict of str to float
        violation: largest distance between two points that a loop should hold together [m];
        energy: largest change of energy over the largest kinetic energy [1], where nothing drives
        or brakes the motion; stretch of rods [1].
    seconds, steps : float, int
        Shortest processor time of all runs of the setting [s]; number of time steps.
    repeats : tuple of float
        Processor times of all runs that were timed [s].
    pinned : bool
        Whether its process was pinned to a processor that no other run of a study used meanwhile.
    shared : float
        Share of the time of the run in `seconds` that its processor gave to other processes [1];
        NaN of an engine in an interpreter of its own.
    machine : str
        Name of the processor, and how many the machine has.
    outcome, message : str
        ran; stopped: a sweep that ended early, with errors up to its end; or why there are no
        errors: diverged, not finite, no reference (at a pose that the run came to), crashed, timed
        out, out of memory, unsupported.
    key : str
        Key of its files in the store, as in ``store.curves(row.key)``.
    asked : dict of str to float
        As `errors` [1], with the reference at the prescribed motion of the drives; empty if no
        drive moves in time.
    step : float
        Time step that the engine took [s].  It may be shorter than the one that was asked for,
        since a whole number of steps leads from sample to sample.  NaN where nothing was stepped,
        or the run gave no curves.
    load : float
        Load average of the machine, the number of processes that wanted a processor [1] in the last
        minute: the largest of those at the start and end of the timed runs.  NaN where the system
        has none, and in tables of earlier versions.
    work : float
        Processor time that the steps of the run count [s], see
        `proofmass.sim.protocol.curves.Curves`.
    compile_seconds : float
        Processor time in which the engine compiled the model before its steps [s], which is no
        part of `seconds`.
    """

    study: str
    case: str
    run: str
    engine: str
    series: str
    varied: str
    value: float
    parameters: dict[str, ParameterValue] = field(default_factory=dict)
    errors: dict[str, float] = field(default_factory=dict)
    invariants: dict[str, float] = field(default_factory=dict)
    seconds: float = NAN
    steps: int = 0
    repeats: tuple[float, ...] = ()
    pinned: bool = False
    shared: float = NAN
    machine: str = ""
    outcome: str = Outcome.RAN
    message: str = ""
    key: str = ""
    asked: dict[str, float] = field(default_factory=dict)
    step: float = NAN
    load: float = NAN
    work: float = NAN
    compile_seconds: float = 0.0

    @property
    def cost(self) -> float:
        """What decides which setting is cheaper [s]: the counted time, else the measured one."""
        return self.seconds if math.isnan(self.work) else self.work

    def reached(self, kind: str) -> float:
        """Error of a kind against the prescribed motion, `asked` if there is any; NaN if none."""
        return (self.asked or self.errors).get(kind, NAN)


COLUMN_PREFIXES = {  # fields of `StudyRow` with a column for each key: prefixes of these columns
    "parameters": "parameter",
    "errors": "error",
    "asked": "asked",
    "invariants": "invariant",
}
RUN_COLUMNS = {
    "study": "trade, choose, stress or diet",
    "case": "name of the sidecar",
    "run": "sweep, dynamics or equilibrium",
    "engine": "name of the engine",
    "series": "convergence series that the run belongs to: the parameters that stay, in words",
    "varied": "the parameter that differs from run to run in the series",
    "value": "value of the varied parameter, in its unit",
    "parameter": "value of each parameter of the engine, timestep in [s]; segments of all rods; a "
    "tuple is a JSON array",
    "error": "largest error of the channels of a kind, as a share of the range of the reference "
    "[1]; the reference is evaluated at the motion that the drives really had",
    "asked": "as `error`, with the reference at the prescribed motion of the drives; empty if no "
    "drive moves in time [1]",
    "invariant": "violation: largest distance of points that a loop should hold together [m]; "
    "energy: largest change over the largest kinetic energy, of free motions without "
    "friction [1]; stretch: of rods [1]",
    "seconds": "shortest processor time of all runs of the setting, without loading the model [s]",
    "steps": "time steps of dynamics, solved poses otherwise",
    "step": "time step that the engine took in dynamics [s]: the one of `parameter.timestep`, or "
    "the next shorter one of which whole ones lead from sample to sample",
    "repeats": "all processor times [s], as a JSON array: of settings near the front those of "
    "several rounds, of the others that of one run; a short run is made twice, and timed the "
    "second time",
    "pinned": "whether the process kept to one processor, and no other run of a study to the same",
    "shared": "share of the time of the run in `seconds` that its processor gave to others [1]; "
    "empty of an engine in an interpreter of its own",
    "load": "largest load average of the last minute when a timed run began or ended, over all "
    "processors of the machine; empty where the system has none [processes]",
    "work": "processor time that the steps count, the same on every machine [s]; it decides which "
    "setting is cheaper",
    "compile_seconds": "processor time in which the engine compiled the model before its steps, no "
    "part of `seconds` [s]",
    "machine": "its processor, and how many it has",
    "outcome": "ran, stopped (a sweep that ended early), diverged, not finite, no reference (at a "
    "pose that the run came to), crashed, timed out, out of memory, unsupported",
    "message": "details of the outcome",
    "key": "key of the run in the store; KEY.npz has its curves",
}


def write_table(rows: Iterable[StudyRow], file: Path) -> None:
    """Write ``NAME.csv``, ``NAME.columns.md`` and, where pyarrow is there, ``NAME.parquet``."""
    rows = list(rows)
    write_output(file, format_table(rows))
    write_columns(
        file.with_suffix(".columns.md"),
        file.name,
        "run",
        {
            f"{name}.*" if name in COLUMN_PREFIXES.values() else name: what
            for name, what in RUN_COLUMNS.items()
        },
    )
    if rows and find_spec("pyarrow"):
        from pyarrow import csv as arrow
        from pyarrow import parquet

        packed = io.BytesIO()
        parquet.write_table(arrow.read_csv(file), packed)
        write_output(file.with_suffix(".parquet"), packed.getvalue())


def read_table(file: Path) -> list[StudyRow]:
    """The rows of a CSV file that `write_table` wrote.

    Raises
    ------
    InputError
        The file is not there, or lacks a column that every row needs.
    """
    required = ("study", "case", "run", "engine", "series", "varied", "value")
    return [parse_row(cells) for cells in read_cells(file, required)]


def read_cells(
    file: Path, columns: Iterable[str], what: str = "a study", again: str = "the study"
) -> list[dict[str, str]]:
    """Read the rows of a CSV file that a study wrote, with their cells by column.

    Raises
    ------
    InputError
        The file cannot be read, or it lacks one of the columns.
    """
    try:
        with file.open(encoding="utf-8", newline="") as stream:
            reader = csv.DictReader(stream)
            for name in columns:
                if name not in (reader.fieldnames or ()):
                    raise InputError(
                        file,
                        "",
                        f"not the table of {what}: no column {name!r}; if an earlier version "
                        f"wrote it, run {again} again",
                    )
            return list(reader)
    except OSError as error:
        raise InputError(file, "", f"no table there: {error.strerror}") from None


def format_table(rows: Sequence[StudyRow]) -> str:
    """Text of the CSV table of rows, with a header; a cell is empty where a row has no value.

    >>> print(format_table([StudyRow("trade", "pendulum", "dynamics", "mujoco", "RK4",
    ...                  "timestep", 0.01, {"timestep": 0.01},
    ...                  {"position": 1e-7})]).partition(",seconds")[0])
    study,case,run,engine,series,varied,value,parameter.timestep,error.position
    """
    cells = [row_cells(row) for row in rows]
    columns = dict.fromkeys(name for row in cells for name in row)
    ordered_columns = sorted(
        columns, key=lambda name: list(RUN_COLUMNS).index(name.partition(".")[0])
    )
    return format_cells(cells, ordered_columns)


def format_cells(rows: Iterable[Mapping[str, Any]], columns: Collection[str]) -> str:
    """Format rows as CSV with a header; a cell that a row lacks is empty."""
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def row_cells(row: StudyRow) -> dict[str, str]:
    """The cells of a row by the names of their columns."""
    cells = dict[str, str]()
    for column in fields(StudyRow):
        value = getattr(row, column.name)
        if column.name in COLUMN_PREFIXES:
            cells |= {
                f"{COLUMN_PREFIXES[column.name]}.{key}": format_cell(part)
                for key, part in value.items()
            }
        else:
            cells[column.name] = value if isinstance(value, str) else format_cell(value)
    return cells


def format_cell(value: Any) -> str:
    """Text of a cell: a number, true or false, a JSON array, or a word; empty for NaN.

    >>> [format_cell(value) for value in (1e-3, float("nan"), (0.02, 1.0), "RK4", "8")]
    ['0.001', '', '[0.02, 1.0]', 'RK4', '"8"']
    """
    if isinstance(value, float) and math.isnan(value):
        return ""
    return value if isinstance(value, str) and parse_cell(value) == value else json.dumps(value)


def parse_cell(cell: str) -> Any:
    """Value of a cell: parsed as JSON, an array as a tuple; else the text of the cell."""
    try:
        value = json.loads(cell)
    except ValueError:
        return cell
    return tuple(value) if isinstance(value, list) else value


def parse_row(cells: dict[str, str]) -> StudyRow:
    """The row with these cells, by the names of their columns."""
    values = dict[str, Any]()
    for name, kind in get_type_hints(StudyRow).items():
        if name in COLUMN_PREFIXES:
            own = {
                column.partition(".")[2]: cell
                for column, cell in cells.items()
                if column.startswith(COLUMN_PREFIXES[name] + ".") and cell
            }
            values[name] = {key: parse_cell(cell) for key, cell in own.items()}
        elif name in cells:
            cell = cells[name]
            values[name] = cell if kind is str else parse_cell(cell) if cell else NAN
    return StudyRow(**values)


def write_columns(file: Path, table: str, row: str, columns: dict[str, str]) -> None:
    """Write a Markdown file that describes the rows and columns of a table."""
    lines = [f"| `{column}` | {what} |" for column, what in columns.items()]
    write_output(
        file,
        "\n".join(
            [
                f"# Columns of {table}",
                "",
                f"One row a {row}.",
                "",
                "| column | is |",
                "|---|---|",
                *lines,
                "",
            ]
        ),
    )
