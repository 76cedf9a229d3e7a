"""What a report stores for the next one: ``results.json`` beside its index.

The file has every number of `proofmass check --json`, where and when they were computed, and the
errors of the last reports, so that a report can show what changed since the last one.
"""

import json
import math
import os
import platform
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator

from proofmass.base.errors import InputError
from proofmass.base.files import read_text, write_output
from proofmass.base.json_values import replace_nonfinite
from proofmass.batch.check import Result, family_of
from proofmass.formats.terminal import COMPARISON_KEYS
from proofmass.report.commit import commit_of
from proofmass.report.families import reference_name
from proofmass.report.page import read_versions
from proofmass.verdict.comparison import Comparison

RECORD_VERSION = 1
RECORD_NAME = "results.json"
KEPT_REPORTS = 50
"""Number of reports whose errors are kept."""


class Part(BaseModel):
    """A part of a record; unknown fields, from another version, are ignored."""

    model_config = ConfigDict(frozen=True, extra="ignore")


class Made(Part):
    """When and on which machine a report was made, without host name and folders.

    Attributes
    ----------
    date : str
        Date and time in UTC, in ISO 8601.
    command : str
        The command with its arguments.
    commit : str
        Commit of the working tree of the inputs; empty if they lie in none.  The inputs may differ
        from it, see `proofmass.report.commit`.
    versions : dict of str to str
        Versions of packages.
    machine, processors : str, int
        Operating system and type of machine, and its number of processors.
    load_start, load_end : float or None
        Load average over a minute, in processes [1], before and after the runs.
    """

    date: str
    command: str = ""
    commit: str = ""
    versions: dict[str, str] = {}
    machine: str = ""
    processors: int = 0
    load_start: float | None = None
    load_end: float | None = None

    @property
    def day(self) -> str:
        """The date as people read it."""
        return format_day(self.date)


class CaseRecord(Part):
    """A case, the folder that it lies in, and the name of its reference."""

    name: str
    title: str
    family: str
    reference: str


class ChannelRecord(Part):
    """A `Comparison` by the keys of ``check --json``, and its error as a share of the range."""

    case: str
    solver: str
    run: str
    channel: str
    unit: str
    error_max: float | None
    at: float | None
    error_rms: float | None
    nrmse: float | None
    uncertainty: float | None = 0.0  # earlier versions did not have it
    noise: dict[str, Any] | None = None  # nor this
    allowed: float | None
    detectable: dict[str, dict[str, float | bool | None]]
    outcome: str
    message: str
    seconds: float | None
    steps: int
    share_of_range: float | None

    @property
    def key(self) -> str:
        """The name of the channel in the history."""
        return channel_key(self.case, self.run, self.solver, self.channel)


class FaultRecord(Part):
    """An input at fault."""

    file: str
    key: str
    wrong: str


class Past(Part):
    """A report of the history; see `Made` for its fields."""

    date: str
    commit: str = ""
    versions: dict[str, str] = {}

    @field_validator("date")
    @classmethod
    def known_date(cls, date: str) -> str:
        """Raise ValueError for a date that cannot be read."""
        datetime.fromisoformat(date)
        return date

    @property
    def day(self) -> str:
        """The date as people read it."""
        return format_day(self.date)


class History(Part):
    """Errors of the last reports, as shares of the range: a list for each channel, oldest first.

    Attributes
    ----------
    reports : list of Past
    errors : dict of str to list
        For each `channel_key`, the error in each report as a share of the range [1]; None where a
        report has none.
    damage : str
        Parts that could not be read and were left out; empty if there are none.
    """

    reports: list[Past] = []
    errors: dict[str, list[float | None]] = {}
    damage: str = Field(default="", exclude=True)

    def trend(self, case: str, run: str, solver: str, channel: str) -> list[float | None]:
        """Return the errors of a channel in `reports`; None where a report has none."""
        return self.errors.get(channel_key(case, run, solver, channel), [None] * len(self.reports))


class Record(Part):
    """All that a report stores."""

    format: int
    made: Made
    exit_code: int
    cases: list[CaseRecord]
    comparisons: list[ChannelRecord]
    errors: list[FaultRecord]
    history: History = History()

    @field_validator("history", mode="before")
    @classmethod
    def mended_history(cls, value: object) -> object:
        """Leave out damaged parts of the history, so that the rest of the record can be read."""
        return value if isinstance(value, History) else repair_history(value)


def repair_history(value: object) -> History:
    """Read a history from JSON, without the reports, rows and errors that are damaged."""
    if not isinstance(value, dict):
        return History(damage="all of it, which is no table")
    reports, rows = value.get("reports", []), value.get("errors", {})
    if not isinstance(reports, list) or not isinstance(rows, dict):
        return History(damage="all of it, whose reports are no list or whose errors are no table")
    kept, wrong = dict[int, Past](), list[str]()
    for k, one in enumerate(reports):
        try:
            kept[k] = Past.model_validate(one)
        except ValidationError as error:
            first = error.errors()[0]
            what = f"{'.'.join(map(str, first['loc']))}: {first['msg']}".removeprefix(": ")
            wrong.append(f"report {k + 1} of {len(reports)} ({what})")
    whole = {
        key: row for key, row in rows.items() if isinstance(row, list) and len(row) == len(reports)
    }
    if count := len(rows) - len(whole):
        wrong.append(f"{count} row{'s' * (count > 1)} of another length")
    errors = {key: [row[k] for k in kept] for key, row in whole.items()}
    if count := sum(not is_error(one) for row in errors.values() for one in row):
        wrong.append(
            f"{count} error{'s' * (count > 1)} that {'are' if count > 1 else 'is'} no number"
        )
    return History(
        reports=list(kept.values()),
        errors={
            key: [one if is_error(one) else None for one in row] for key, row in errors.items()
        },
        damage="; ".join(wrong),
    )


def is_error(value: object) -> bool:
    """Whether a value is an error of the history: a share of the range, or None.

    >>> [is_error(value) for value in (1e-9, 0, None, True, -1.0, float("nan"), "1e-9")]
    [True, True, True, False, False, False, False]
    """
    if value is None:
        return True
    number = isinstance(value, int | float) and not isinstance(value, bool)
    return number and 0.0 <= value < math.inf  # type: ignore[operator]


@dataclass(frozen=True)
class Last:
    """The last report: its record, and what is wrong with its file; without a report neither."""

    record: Record | None = None
    wrong: str = ""
    file: Path = Path(RECORD_NAME)

    @property
    def shown(self) -> str:
        """What is wrong, without the folders of this machine."""
        return self.wrong.replace(str(self.file), self.file.name)


def format_day(date: str) -> str:
    """Format a date in ISO 8601 for people.

    >>> format_day("2026-11-23T19:08:12+00:00")
    '2026-11-23 19:08 UTC'
    """
    return f"{date[:10]} {date[11:16]} UTC"


def channel_key(case: str, run: str, solver: str, channel: str) -> str:
    """Return the name of a channel in the history."""
    return f"{case}/{run}/{solver}/{channel}"


def load_average() -> float | None:
    """Return the load average over a minute, in processes; None where the system has none."""
    return round(os.getloadavg()[0], 2) if hasattr(os, "getloadavg") else None


def record_start(command: Sequence[str] = (), inputs: Path | None = None) -> Made:
    """Return date, command, commit, versions, machine and load before the runs of a report.

    Parameters
    ----------
    command : sequence of str
        Words of the command; of a word that is an absolute path only the name is kept.
    inputs : Path, optional
        A file or folder of the working tree whose commit is recorded; the current one by default.
    """
    words = [Path(word).name if Path(word).is_absolute() else word for word in command]
    return Made(
        date=datetime.now(UTC).isoformat(timespec="seconds"),
        command=" ".join(words),
        commit=commit_of(inputs or Path()),
        versions=dict(read_versions()),
        machine=f"{platform.system()} {platform.machine()}",
        processors=os.cpu_count() or 0,
        load_start=load_average(),
    )


def make_record(result: Result, made: Made | None = None) -> Record:
    """Return the record of a result, without a history."""
    made = made or record_start(inputs=next(iter(result.paths), None))
    hosted = {
        f"{package} of {solver}": version
        for solver, packages in result.versions.items()
        for package, version in packages.items()
    }
    return Record(
        format=RECORD_VERSION,
        made=made.model_copy(
            update={"load_end": load_average(), "versions": made.versions | hosted}
        ),
        exit_code=result.exit_code,
        cases=[
            CaseRecord(
                name=case.name,
                title=case.title,
                family=family_of(case.file, result.paths),
                reference=reference_name(case),
            )
            for case in result.cases
        ],
        comparisons=[channel_record(c) for c in result.comparisons],
        errors=[
            FaultRecord(
                file=e.file.name, key=e.key, wrong=e.wrong.replace(str(e.file), e.file.name)
            )
            for e in result.errors
        ],
    )


def channel_record(c: Comparison) -> ChannelRecord:
    """Return the record of a comparison."""
    values = asdict(c)
    return ChannelRecord.model_validate(
        replace_nonfinite(
            {key: values[key] for key in COMPARISON_KEYS} | {"share_of_range": c.relative_to_range}
        )
    )


def read_last(folder: Path) -> Last:
    """Read the record of the report in a folder, or tell why it cannot be read."""
    file = folder / RECORD_NAME
    if not file.exists():
        return Last()
    try:
        return read_baseline(folder)
    except InputError as error:
        wrong = f"the record {file} {error.wrong}; changes since the last report are not shown"
        return Last(wrong=wrong, file=file)


def read_baseline(folder: Path) -> Last:
    """Read the record of the report in a folder, with which another report is compared.

    Raises
    ------
    InputError
        There is no record, or it cannot be read or is damaged.
    """
    file = folder / RECORD_NAME
    if not file.exists():
        raise InputError(file, "", "no such file; proofmass report writes it")
    try:
        found = parse_record(read_text(file))
        damage = found.history.damage
        wrong = f"the history in {file} is damaged; left out: {damage}" if damage else ""
        return Last(found, wrong, file)
    except InputError as error:
        wrong = f"cannot be read: {error.wrong}"
    except ValidationError as error:
        first = error.errors()[0]
        wrong = f"is damaged: {'.'.join(map(str, first['loc']))}: {first['msg']}"
    except (ValueError, RecursionError) as error:
        wrong = f"is damaged: {error}"
    raise InputError(file, "", wrong)


def parse_record(text: str) -> Record:
    """Read a record from its text; ValueError if it is none or has another format version."""
    found = json.loads(text)
    if not isinstance(found, dict) or "format" not in found:
        raise ValueError("it has no format version")
    if found["format"] != RECORD_VERSION:
        raise ValueError(
            f"its format version is {found['format']!r}, and {RECORD_VERSION} is read here"
        )
    return Record.model_validate(found)


def write_record(folder: Path, record: Record, history: History) -> None:
    """Write a record with the history up to it, one line for each channel."""
    whole = record.model_copy(update={"history": history})
    write_output(folder / RECORD_NAME, format_lines(whole.model_dump(mode="json")))


def format_lines(table: dict[str, Any]) -> str:
    """Format JSON with a line for each entry of lists and tables, so that diffs are readable."""
    parts = []
    for key, value in table.items():
        if key == "history":
            text = format_lines(value).rstrip()
        elif isinstance(value, list) and value:
            text = "[\n" + ",\n".join(map(format_line, value)) + "\n]"
        elif isinstance(value, dict) and value:
            entries = (f"{format_line(name)}: {format_line(each)}" for name, each in value.items())
            text = "{\n" + ",\n".join(entries) + "\n}"
        else:
            text = format_line(value)
        parts.append(f"{format_line(key)}: {text}")
    return "{\n" + ",\n".join(parts) + "\n}\n"


def format_line(value: Any) -> str:
    """Format JSON in one line."""
    return json.dumps(value, separators=(",", ":"), ensure_ascii=False, allow_nan=False)


def extend_history(history: History, record: Record) -> History:
    """Return a history with a further report, reduced to the last `KEPT_REPORTS` reports."""
    made = record.made
    past = Past(date=made.date, commit=made.commit, versions=made.versions)
    reports = [*history.reports, past][-KEPT_REPORTS:]
    missing = [None] * len(history.reports)
    now = {c.key: round_error(c.share_of_range) for c in record.comparisons if c.channel}
    errors = {}
    for key in dict.fromkeys([*history.errors, *now]):
        row = [*history.errors.get(key, missing), now.get(key)][-KEPT_REPORTS:]
        if any(value is not None for value in row):
            errors[key] = row
    return History(reports=reports, errors=errors, damage=history.damage)


def extend_with_case(history: History, record: Record) -> History:
    """Return `extend_history` of the channels of a record alone, such as those of one case."""
    own = {c.key: history.errors[c.key] for c in record.comparisons if c.key in history.errors}
    return extend_history(history.model_copy(update={"errors": own}), record)


def round_error(value: float | None) -> float | None:
    """Return a number to three digits; None for None.

    >>> round_error(1.23456e-9)
    1.23e-09
    """
    return None if value is None else float(f"{value:.2e}")
