"""Boundaries of parameters: the furthest value that holds, and the next value, which fails.

A value of a parameter holds if the run with it does not fail.  The boundaries of a study are
stored in a table with one row for each of them.
"""

from collections.abc import Iterable
from dataclasses import asdict, dataclass, fields
from enum import StrEnum
from pathlib import Path
from typing import Any, NamedTuple, get_type_hints

import numpy as np

from proofmass.base.files import write_output
from proofmass.base.wording import number
from proofmass.studies.bracket import Bracket
from proofmass.studies.record import NAN, format_cells, read_cells, write_columns

PRINTED_DIGITS = 4
"""Significant digits of the values that are tried near a boundary, so that the printed value is
exactly the one that was tried."""


class BoundaryKind(StrEnum):
    """The kind of limit that a parameter meets; `sentence` describes it."""

    UNSTABLE = "unstable"
    INACCURATE = "inaccurate"
    REFUSED = "refused"
    OURS = "ours"
    HOLDS = "holds"

    @property
    def sentence(self) -> str:
        """The description of this kind of limit."""
        return LIMIT_SENTENCES[self]


LIMIT_SENTENCES = {
    BoundaryKind.UNSTABLE: "the run diverges, is not finite, aborts or raises the engine's "
    "warning, a loop opens, or no pose or equilibrium is found any more",
    BoundaryKind.INACCURATE: "the engine runs to the end, but its error is larger than a tenth of "
    "the range, or than the row names",
    BoundaryKind.REFUSED: "the engine does not compile or accept the model",
    BoundaryKind.OURS: "no boundary of the engine: nothing is known beyond, since proofmass itself "
    "ran out of time, had no reference, ran out of iterations, or did not accept the value",
    BoundaryKind.HOLDS: "no boundary: all values that were tried hold",
}
"""Descriptions of all kinds of limits, for tables and pages."""


class Failure(NamedTuple):
    """Why a value fails, the kind of limit, and whether the engine gave no warning."""

    message: str
    limit: BoundaryKind
    silent: bool = False


class TrialResult(NamedTuple):
    """The result of trying one value: its failure, if any, and the time step that was taken [s].

    `step` is read from the engine after the run; it is NaN if the run has no time steps, or gave no
    curves.
    """

    failure: Failure | None = None
    step: float = NAN


def is_engine_warning(message: str) -> bool:
    """Whether a message is the engine's own warning that a run diverged.

    Without a warning only the curves of the run show it.

    >>> is_engine_warning("MuJoCo warning badqacc; failed at some time")
    True
    >>> is_engine_warning("not finite at t = 2 s")
    False
    """
    return message.split()[1:2] == ["warning"]


@dataclass(frozen=True)
class PredictedLimit:
    """A boundary that is computed of a model before any run, as by its first screen.

    Attributes
    ----------
    theory : float
        [its unit]; infinite if there is none, NaN if none is known.
    law : str
        What sets it.
    remedy : str
        What to write into the model, if its own value is beyond it.
    """

    theory: float = NAN
    law: str = ""
    remedy: str = ""


@dataclass(frozen=True)
class VariedRange:
    """A parameter that is varied, and its range.

    Attributes
    ----------
    what : str
        The name of the case, or a description of the problem.
    engine, setting : str
        The engine, and a description of its integrator or other setting.
    parameter, unit : str
        The parameter that is varied, and its unit.
    start, reach : float
        First and last value that are tried [its unit].
    """

    what: str
    engine: str
    setting: str
    parameter: str
    unit: str
    start: float
    reach: float


def format_exactly(value: float) -> str:
    """A value that was tried, written with all its digits, four at least.

    >>> format_exactly(61.75), format_exactly(61.7523)
    ('61.75', '61.7523')
    """
    texts = (number(value, digits) for digits in range(PRINTED_DIGITS, 17))
    return next((text for text in texts if float(text) == value), repr(value))


@dataclass(frozen=True)
class Boundary(VariedRange):
    """How far one parameter can be varied.

    Attributes
    ----------
    holds, breaks : float
        The furthest value up to which all values hold, and the next value, which fails [its unit].
        `breaks` is NaN if all values up to `reach` hold; `holds` is NaN if `start` fails, and then
        `breaks` is NaN as well.
    again : float
        The furthest value beyond `breaks` that holds again [its unit]: between the two some values
        hold and others fail.  NaN if all values that were tried beyond `breaks` fail.
    step : float
        Time step that the engine took at `holds` [s]; NaN if the run has no time steps.
    theory : float
        The boundary by theory [its unit]: infinite (zero if the parameter is decreased) if theory
        says that there is none, NaN if no theory is known.
    law : str
        A description of the theory.
    limit : BoundaryKind
        The kind of limit.
    failure : str
        A description of the failure at `breaks`.
    silent : bool
        Whether the engine itself gave no warning of the failure.
    remedy : str
        What to write into the model, if its own value is beyond the boundary.
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
    remedy: str = ""

    @property
    def found(self) -> bool:
        """Whether a boundary of the engine was found between `start` and `reach`."""
        return bool(np.isfinite(self.breaks)) and not self.unknown

    @property
    def several(self) -> bool:
        """Whether there are several boundaries: a value beyond the first one holds again."""
        return self.again == self.again

    @property
    def last(self) -> str:
        """The furthest value that holds again, as text without its unit."""
        return number(self.reach) if self.again == self.reach else format_exactly(self.again)

    def format_measured(self, digits: int = 3) -> str:
        """The boundary as text without its unit; of several boundaries the first and the last.

        >>> Boundary("", "", "", "", "", 1.0, 9.0, 1.96, 2.0).format_measured()
        '1.98'
        >>> Boundary("", "", "", "", "", 1.0, 9.0, 1.96, 2.0, again=2.5).format_measured()
        '2 to 2.5'
        """
        if self.several:
            return f"{format_exactly(self.breaks)} to {self.last}"
        return number(self.measured, digits)

    def describe(self, unit: str, digits: int = 3) -> str:
        """Format the boundary with its unit as a table shows it.

        >>> Boundary("", "", "", "step", "s", 0.1, 10.0, 2.0, 2.02).describe("s")
        '2.01 s'
        >>> Boundary("", "", "", "step", "s", 0.1, 10.0, 10.0).describe("s")
        'none to 10 s'
        >>> ours = BoundaryKind.OURS
        >>> Boundary("", "", "", "step", "s", 0.1, 10.0, 2.0, 2.2, limit=ours).describe("s")
        'not known beyond 2 s'
        """
        unit = "" if self.unit == "1" else f" {unit}"
        if self.found:
            return f"{self.format_measured(digits)}{unit}"
        if self.holds != self.holds:
            return "not known" if self.unknown else "nowhere"
        if self.unknown:
            return f"not known beyond {number(self.holds)}{unit}"
        return f"none to {number(self.reach)}{unit}"

    @property
    def unknown(self) -> bool:
        """Whether nothing is known beyond `holds`, since proofmass itself gave up there."""
        return self.limit == BoundaryKind.OURS

    @property
    def measured(self) -> float:
        """The geometric mean of `holds` and `breaks`; infinite (or zero) if there is no boundary.

        NaN if nothing is known beyond `holds`, or if `start` fails.
        """
        if self.found:
            return Bracket(self.holds, self.breaks).middle
        if self.unknown or not np.isfinite(self.holds):
            return NAN
        return float("inf") if self.reach > self.start else 0.0

    @property
    def ratio(self) -> float:
        """The measured boundary over that by theory.

        It is 1 if neither has a boundary, and NaN if only one of them has.
        """
        if self.measured == self.theory:
            return 1.0
        ratio = self.measured / self.theory if self.theory else NAN
        return ratio if np.isfinite(ratio) and ratio else NAN

    @property
    def ending(self) -> str:
        """The kind of limit, whether the engine gave no warning, and the failure.

        >>> Boundary("", "", "", "", "", 1.0, 9.0, 2.0, 2.02, limit=BoundaryKind.INACCURATE,
        ...          failure="position off by 0.1 of its range", silent=True).ending
        'inaccurate, in silence: position off by 0.1 of its range'
        """
        if self.limit == BoundaryKind.HOLDS:
            return ""
        return f"{self.limit}{', in silence' if self.silent else ''}: {self.why}"

    @property
    def why(self) -> str:
        """The failure without the word for the kind of limit."""
        return self.failure.removeprefix(f"{self.limit}: ")


BOUNDARY_COLUMNS = {
    "what": "name of the sidecar, or description of a small model whose limit is known by theory",
    "engine": "name of the engine",
    "setting": "integrator, or description of another setting",
    "parameter": "the parameter that was varied",
    "unit": "unit of all values in the row; times: multiples of the case's own value",
    "start": "first value of the parameter; the first one below that of the case that holds, if "
    "that fails",
    "reach": "last value of the parameter, if no run fails before",
    "holds": "the furthest value that holds; empty if even `start` fails",
    "breaks": "the next value, which fails, at most 1 % further, 2 % if there is `again`, 10 % if "
    "`limit` is ours; empty if all values hold",
    "again": "the furthest value beyond `breaks` that holds again: some values between hold, "
    "others fail; empty if all values that were tried beyond `breaks` fail",
    "step": "time step that the engine took at `holds` [s]; empty if the run has no time steps",
    "theory": "the boundary by theory, inf or 0 if it says that there is none; empty if no theory "
    "is known",
    "law": "description of the theory",
    "limit": "kind of limit; " + "; ".join(f"{one}: {one.sentence}" for one in BoundaryKind),
    "failure": "description of the failure at `breaks`",
    "silent": "whether the engine itself gave no warning of the failure",
    "remedy": "what to write into the model, if its own value is beyond the boundary",
    "measured": "square root of holds times breaks, inf or 0 if there is no boundary up to "
    "`reach`; empty if `limit` is ours, or `start` fails",
    "ratio": "measured over theory; 1 if neither has a boundary",
}


def write_boundaries(boundaries: Iterable[Boundary], file: Path) -> None:
    """Write a CSV file with a row for each boundary, and its columns to ``NAME.columns.md``."""
    rows = [{**asdict(one), "measured": one.measured, "ratio": one.ratio} for one in boundaries]
    cells = ({key: "" if value != value else value for key, value in row.items()} for row in rows)
    write_output(file, format_cells(cells, BOUNDARY_COLUMNS))
    write_columns(file.with_suffix(".columns.md"), file.name, "boundary", BOUNDARY_COLUMNS)


def read_boundaries(file: Path) -> list[Boundary]:
    """Read the boundaries from a file of `write_boundaries`.

    Raises
    ------
    InputError
        A column is missing, as in the table of an earlier version.
    """
    kinds = get_type_hints(Boundary)
    names = [field.name for field in fields(Boundary)]
    return [
        Boundary(**{name: convert_cell(cells[name], kinds[name]) for name in names})
        for cells in read_cells(file, names, again="proofmass stress")
    ]


def convert_cell(cell: str, kind: type) -> Any:
    """The value of a cell, of the type that its field has.

    >>> convert_cell("", float), convert_cell("True", bool), convert_cell("2.0", float)
    (nan, True, 2.0)
    """
    if kind is bool:
        return cell == "True"
    if kind is float:
        return float(cell or "nan")
    return kind(cell)
