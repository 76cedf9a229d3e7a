"""How far something holds: a boundary between the last value that held and one that failed.

Boundaries are kept in a table, a row for each.
"""

import csv
import io
from collections.abc import Iterable
from dataclasses import asdict, dataclass, fields
from enum import StrEnum
from pathlib import Path
from typing import Any, NamedTuple, get_type_hints

import numpy as np

from proofmass.errors import InputError
from proofmass.files import write_whole
from proofmass.studies.record import write_columns
from proofmass.wording import number

DIGITS = 4
"""Digits of values beside a boundary, so that what is printed is what was tried."""
NAN = float("nan")


class BoundaryKind(StrEnum):
    """What limits a parameter; `sentence` says it in words."""

    UNSTABLE = "unstable"
    INACCURATE = "inaccurate"
    REFUSED = "refused"
    OURS = "ours"
    HOLDS = "holds"

    @property
    def sentence(self) -> str:
        """What is meant, in words."""
        return SENTENCES[self]


SENTENCES = {
    BoundaryKind.UNSTABLE: "the run diverges, is not finite, aborts or raises the engine's "
    "warning, a loop comes open, or there is no pose or no equilibrium any more",
    BoundaryKind.INACCURATE: "the engine runs to the end, and is off by more than a tenth of the "
    "range, or by more than the row names",
    BoundaryKind.REFUSED: "the engine does not compile or accept it",
    BoundaryKind.OURS: "no boundary of the engine: not known beyond, since proofmass gave up, for "
    "lack of time, of a reference or of iterations, or did not accept it itself",
    BoundaryKind.HOLDS: "no boundary: all values held as far as the parameter was varied",
}
"""Of all kinds of limits, for tables and pages."""


class Failure(NamedTuple):
    """Why a value did not hold, what kind of limit that is, and whether the engine said nothing."""

    message: str
    limit: BoundaryKind
    silent: bool = False


class TrialResult(NamedTuple):
    """What became of one value: a failure or none, and the time step that was taken [s].

    `step` is read from the engine after the run; NaN where nothing was stepped, or the run gave no
    curves.
    """

    failure: Failure | None = None
    step: float = NAN


def is_engine_warning(message: str) -> bool:
    """Whether the engine itself said that a run diverged; otherwise only its curves show it.

    >>> is_engine_warning("MuJoCo warning badqacc; failed at some time")
    True
    >>> is_engine_warning("not finite at t = 2 s")
    False
    """
    return message.split()[1:2] == ["warning"]


@dataclass(frozen=True)
class VariedRange:
    """A parameter that is varied, and its range.

    Attributes
    ----------
    what : str
        The case, or the problem in words.
    engine, setting : str
        The engine, and its integrator or what else is set, in words.
    parameter, unit : str
        The parameter that is varied, and its unit.
    start, reach : float
        First and last value that is tried [its unit].
    """

    what: str
    engine: str
    setting: str
    parameter: str
    unit: str
    start: float
    reach: float


def exactly(value: float) -> str:
    """A value that was tried, with as many digits as tell it from others, four at least.

    >>> exactly(61.75), exactly(61.7523)
    ('61.75', '61.7523')
    """
    texts = (number(value, digits) for digits in range(DIGITS, 17))
    return next((text for text in texts if float(text) == value), repr(value))


@dataclass(frozen=True)
class Boundary(VariedRange):
    """How far one parameter can be varied.

    Attributes
    ----------
    holds, breaks : float
        The furthest value before which all held, and the next value, which failed [its unit].
        `breaks` is NaN if all values up to `reach` held; both are NaN if `start` failed.
    again : float
        The furthest value beyond `breaks` that held again [its unit]: between the two some values
        hold and others do not.  NaN where all values that were tried beyond `breaks` failed.
    step : float
        Time step that the engine took at `holds` [s]; NaN where nothing was stepped.
    theory : float
        The boundary by theory [its unit]: infinite (zero where the parameter is decreased) if there
        is none, NaN if theory says nothing.
    law : str
        The theory in words.
    limit : BoundaryKind
        The kind of limit.
    failure : str
        The failure at `breaks`, in words.
    silent : bool
        Whether the engine itself said nothing of the failure.
    """

    holds: float = NAN
    breaks: float = NAN
    again: float = NAN
    step: float = NAN
    theory: float = NAN
    law: str = ""
    limit: BoundaryKind = BoundaryKind.HOLDS
    failure: str = ""
    silent: bool = False

    @property
    def found(self) -> bool:
        """Whether there is a boundary of the engine between `start` and `reach`."""
        return bool(np.isfinite(self.breaks)) and not self.unknown

    @property
    def several(self) -> bool:
        """Whether there are several boundaries, since a value beyond the first one holds again."""
        return self.again == self.again

    @property
    def last(self) -> str:
        """The last value that held again, without its unit."""
        return number(self.reach) if self.again == self.reach else exactly(self.again)

    def format_measured(self, digits: int = 3) -> str:
        """The boundary in words, without its unit; of several the first and the last.

        >>> Boundary("", "", "", "", "", 1.0, 9.0, 1.96, 2.0).format_measured()
        '1.98'
        >>> Boundary("", "", "", "", "", 1.0, 9.0, 1.96, 2.0, again=2.5).format_measured()
        '2 to 2.5'
        """
        if self.several:
            return f"{exactly(self.breaks)} to {self.last}"
        return number(self.measured, digits)

    @property
    def unknown(self) -> bool:
        """Whether nothing is known beyond `holds`, for a reason of our own."""
        return self.limit == BoundaryKind.OURS

    @property
    def measured(self) -> float:
        """The boundary, between what held and what did not; infinite (or zero) if there is none.

        NaN where nothing is known, or where `start` did not hold.
        """
        if self.found:
            return float(np.sqrt(self.holds * self.breaks))
        if self.unknown or not np.isfinite(self.holds):
            return NAN
        return float("inf") if self.reach > self.start else 0.0

    @property
    def ratio(self) -> float:
        """Measured over theory; 1 where both say nowhere, NaN where only one does."""
        if self.measured == self.theory:
            return 1.0
        ratio = self.measured / self.theory if self.theory else NAN
        return ratio if np.isfinite(ratio) and ratio else NAN

    @property
    def ending(self) -> str:
        """What kind of limit it is, whether the engine said so, and what went wrong.

        >>> Boundary("", "", "", "", "", 1.0, 9.0, 2.0, 2.02, limit=BoundaryKind.INACCURATE,
        ...          failure="position off by 0.1 of its range", silent=True).ending
        'inaccurate, in silence: position off by 0.1 of its range'
        """
        if self.limit == BoundaryKind.HOLDS:
            return ""
        return f"{self.limit}{', in silence' if self.silent else ''}: {self.why}"

    @property
    def why(self) -> str:
        """What went wrong, without the word for the kind of limit."""
        return self.failure.removeprefix(f"{self.limit}: ")


COLUMNS = {
    "what": "name of the sidecar, or a small model whose limit theory knows, in words",
    "engine": "name of the engine",
    "setting": "integrator, or what else is set, in words",
    "parameter": "what was varied",
    "unit": "of all values in the row; times: of what the case has",
    "start": "its first value",
    "reach": "its last value, if no run fails before",
    "holds": "the furthest value that held; empty if even `start` did not",
    "breaks": "the next that did not, at most 1 % further, 2 % if there is `again`, 10 % if "
    "`limit` is ours; empty if all held",
    "again": "the furthest beyond `breaks` that held again: some values between hold, others do "
    "not; empty if all that were tried beyond failed",
    "step": "time step that the engine took at `holds` [s]; empty if nothing was stepped in time",
    "theory": "where the boundary must be, inf or 0 for nowhere; empty if nothing is known",
    "law": "what theory says, in words",
    "limit": "what kind of limit it is; "
    + "; ".join(f"{one}: {one.sentence}" for one in BoundaryKind),
    "failure": "what went wrong there",
    "silent": "whether the engine itself said nothing",
    "measured": "root of holds times breaks, inf or 0 if there is no boundary up to `reach`; empty "
    "if `limit` is ours, or `start` did not hold",
    "ratio": "measured over theory; 1 where both say nowhere",
}


def write_boundaries(found: Iterable[Boundary], file: Path) -> None:
    """Write a row for each boundary as CSV, and beside it ``NAME.columns.md``."""
    text = io.StringIO()
    rows = csv.DictWriter(text, COLUMNS, lineterminator="\n")
    rows.writeheader()
    for one in found:
        cells = {**asdict(one), "measured": one.measured, "ratio": one.ratio}
        rows.writerow({key: "" if value != value else value for key, value in cells.items()})
    write_whole(file, text.getvalue())
    write_columns(file.with_suffix(".columns.md"), file.name, "boundary", COLUMNS)


def read_boundaries(file: Path) -> list[Boundary]:
    """The boundaries that `write_boundaries` wrote.

    Raises
    ------
    InputError
        A column is missing, as in the table of an earlier version.
    """
    kinds = get_type_hints(Boundary)
    with file.open(encoding="utf-8", newline="") as stream:
        reader = csv.DictReader(stream)
        for one in fields(Boundary):
            if one.name not in (reader.fieldnames or ()):
                raise InputError(
                    file,
                    "",
                    f"no column {one.name!r}: not the table that this version writes; run "
                    "proofmass stress again",
                )
        return [
            Boundary(**{f.name: parsed(cells[f.name], kinds[f.name]) for f in fields(Boundary)})
            for cells in reader
        ]


def parsed(cell: str, kind: type) -> Any:
    """A cell as what it was.

    >>> parsed("", float), parsed("True", bool), parsed("2.0", float)
    (nan, True, 2.0)
    """
    if kind is bool:
        return cell == "True"
    if kind is float:
        return float(cell or "nan")
    return kind(cell)
