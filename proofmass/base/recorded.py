"""Recorded curves: a CSV file from a test rig or another program.

A file is a reference, one of the parties that are compared with a reference, or the rows that a
drive or a load follows.  Every column's header is a name with its unit in brackets:
``t [s], theta2 [deg], r1 [mm]``, or a `RecordedColumn` states the unit.  Values are converted to SI
units and radians.  `proofmass.base.recording` finds the x of a run that each row belongs to.

The file is in UTF-8, with or without a byte order mark, in UTF-16 with one, or else in
Windows-1252, as spreadsheets write it.  Cells are separated by commas, or by semicolons or tabs if
the header has them; only in the latter case may a number have a decimal comma.
"""

import codecs
import csv
import io
import math
import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field, field_validator, model_validator

from proofmass.base.arrays import Array
from proofmass.base.errors import InputError, suggest_names
from proofmass.base.files import read_bytes
from proofmass.base.read_once import read_once
from proofmass.base.strict import Strict, StrictNumber, Switch
from proofmass.base.units import same_quantity, si_unit

ROW_TOLERANCE = 1e-9  # of the median spacing of rows: a place no farther from a row is at the row
WRAP_TOLERANCE = 0.1
"""Share of a turn by which a step across whole turns may differ from the steps beside it."""
ITS_COLUMN = "unwrap = true to its column"
IMPORTED_ENDINGS = (".xlsx", ".xls", ".mat", ".lvm", ".res", ".parquet", ".tab", ".txt", ".dat")
"""Endings of files with tables that are no CSV, of which ``proofmass import`` makes one."""
ROW_NUMBER = "row"
"""Name of the column that every file has: the number of the row, from 0 on, as a time [s]; unless
the file has a column of that name.  A loop needs it, whose columns turn back."""
MIN_ROWS = 16  # least number of rows: a spline through every fourth then has at least four points
NEIGHBOUR_ROWS = 4  # rows to each side whose errors decide how the error falls with the spacing
CUBIC_ERROR_RATIO = 0.1
"""Largest ratio of the errors at 2 and 4 times the spacing where the error is a cubic's."""
LARGEST_GAP = 10.0
"""Spacing of two rows over the usual spacing beyond which rows count as missing, by default."""
SMOOTH_FACTOR, BEND_FACTOR, END_FACTOR = 2 / 16, 2.0, 2.0
"""Factors on the error at twice the spacing: on smooth stretches, at bends, and at both ends in
addition; see `interpolate_recorded`."""


class RecordedColumn(Strict):
    """A column of a recorded file, and the curve that it stands for: scale * column + shift.

    `unit` is the unit of the column where its header has none, and `shift` is in the column's unit.
    `unwrap` removes the whole turns by which an angle jumps.  A name alone stands for a table with
    that `column`.
    """

    column: str
    unit: str | None = None
    scale: StrictNumber = 1.0
    shift: StrictNumber = 0.0
    unwrap: Switch = False

    @model_validator(mode="before")
    @classmethod
    def _named(cls, column: Any) -> Any:
        return {"column": column} if isinstance(column, str) else column

    @field_validator("unit")
    @classmethod
    def _known_unit(cls, unit: str | None) -> str | None:
        if unit is not None:
            si_unit(unit)
        return unit


class RecordingTable(Strict):
    """``[recording]``: how the file of a recorded reference is read.

    `x` is the first column if it is left out.  `columns` are read as their tables say; every other
    column of the file has the unit of its header.  `gap` is the largest spacing of rows between
    which the reference may be interpolated, in multiples of the usual spacing.
    """

    x: RecordedColumn | None = None
    columns: dict[str, RecordedColumn] = Field({})
    gap: StrictNumber = Field(LARGEST_GAP, gt=1)

    @field_validator("columns", mode="before")
    @classmethod
    def _own_names(cls, columns: Any) -> Any:
        if not isinstance(columns, dict):
            return columns
        return {
            name: {"column": name, **one} if isinstance(one, dict) else one
            for name, one in columns.items()
        }


@dataclass(frozen=True)
class RecordedTable:
    """The contents of a CSV file.

    Attributes
    ----------
    file : Path
    units : dict of str to str
        Text in brackets of each column's header, by the name of the column; empty where there is
        none.  Columns of a file without a header are called ``1``, ``2``, ...
    rows : tuple of (int, list of str)
        Number of the line in the file, and cells, of each row.
    """

    file: Path
    units: dict[str, str]
    rows: tuple[tuple[int, list[str]], ...]

    def line(self, row: int) -> str:
        """Return the line of a row in the file, for messages."""
        return f"line {self.rows[row][0]}"

    def counts(self, name: str) -> bool:
        """Whether a name is that of the number of the row, and of no column."""
        return name == ROW_NUMBER and name not in self.units

    def cell(self, row: int, name: str) -> str:
        """Return the text of a cell."""
        if self.counts(name):
            return f"{row % len(self.rows)}"
        return self.rows[row][1][list(self.units).index(name)].strip()

    def values(self, name: str) -> Array:
        """Return the values of a column in the unit of the file.

        Raises
        ------
        InputError
            A cell that is no finite number; the message names the line and the column.
        """
        if self.counts(name):
            return np.arange(len(self.rows), dtype=float)
        k = list(self.units).index(name)
        try:
            return np.array([cell_number(self.file, n, row[k], name) for n, row in self.rows])
        except InputError as error:
            raise with_import_hint(error) from None

    def unit_of(self, wanted: RecordedColumn) -> str:
        """Return the unit of a column, from its header or from the sidecar.

        Raises
        ------
        ValueError
            There is no such column, neither states its unit, or they state different units.
        """
        if self.counts(wanted.column):
            return wanted.unit or "s"
        if wanted.column not in self.units:
            raise ValueError(
                f"no column {wanted.column!r} in {self.file.name}; "
                f"{suggest_names(wanted.column, self.units)}"
            )
        own = self.units[wanted.column]
        try:
            known = bool(own) and bool(si_unit(own))
        except ValueError as error:
            known = False
            if wanted.unit is None:
                raise ValueError(f"column {wanted.column!r} of {self.file.name}: {error}") from None
        if wanted.unit is None and not known:
            raise ValueError(
                f"column {wanted.column!r} of {self.file.name} has no unit in its header; write it "
                f"as '{wanted.column} [unit]', or give it: "
                f'{{ column = "{wanted.column}", unit = ".." }}; {import_hint(self.file)}'
            )
        if known and wanted.unit is not None and si_unit(wanted.unit) != si_unit(own):
            raise ValueError(
                f"unit {wanted.unit!r}: the header of column {wanted.column!r} of "
                f"{self.file.name} says {own!r}; leave the unit out, or mend the header"
            )
        return wanted.unit or own

    def require(self, wanted: RecordedColumn, *quantities: str) -> None:
        """Raise ValueError unless a column can be read as one of these quantities.

        Parameters
        ----------
        wanted : RecordedColumn
        *quantities : str
            SI units; the column must be in a unit of one of these quantities.  Without any, every
            unit is accepted.
        """
        unit = self.unit_of(wanted)
        if quantities and not any(same_quantity(unit, si) for si in quantities):
            raise ValueError(
                f"column {wanted.column!r} of {self.file.name} is in {unit!r}, where "
                f"{' or '.join(quantities)} is needed, or a unit of the same quantity"
            )
        if wanted.unwrap and not same_quantity(unit, "rad"):
            raise ValueError(f"unwrap goes with an angle; {wanted.column!r} is in {unit!r}")

    def curve(self, wanted: RecordedColumn, where: str = ITS_COLUMN) -> Array:
        """Return the curve that a column stands for [SI].

        `where` says in a message how a wrapped angle can be unwrapped.

        Raises
        ------
        InputError
            A cell is no finite number; an angle is wrapped, and its column does not `unwrap`.
        """
        unit, values = self.unit_of(wanted), self.values(wanted.column)
        quantity, factor = si_unit(unit)
        turn = 2 * np.pi / factor
        if wanted.unwrap:
            values = np.unwrap(values, period=turn)
        elif quantity == "rad" and (k := find_wrap(values, turn)) is not None:
            raise InputError(
                self.file,
                self.line(k + 1),
                f"{wanted.column} jumps from {values[k]:.6g} to {values[k + 1]:.6g} {unit}: the "
                f"angle is wrapped; add {where}",
            )
        return np.asarray((wanted.scale * values + wanted.shift) * factor)

    def monotonic(
        self, wanted: RecordedColumn, may_fall: bool = False, where: str = ITS_COLUMN
    ) -> Array:
        """Return the curve of a column that must rise from row to row, or may fall instead [SI].

        `where` is that of `curve`.

        Raises
        ------
        InputError
            The curve does not rise, or turns back; the message names the line.
        """
        x = self.curve(wanted, where)
        falls = may_fall and np.median(np.diff(x)) < 0
        wrong = np.flatnonzero(np.diff(x) >= 0 if falls else np.diff(x) <= 0)
        if wrong.size:
            raise InputError(
                self.file,
                self.line(int(wrong[0]) + 1),
                f"{wanted.column} does not {'fall' if falls else 'rise'} "
                f"({x[wrong[0]]:.10g} then {x[wrong[0] + 1]:.10g}); give the rows in their order, "
                f"each {wanted.column} once; {import_hint(self.file)}",
            )
        return x


def find_wrap(values: Array, turn: float) -> int | None:
    """Find the row after which an angle goes on a whole turn away.

    Such a step is longer than half a turn; without the turn it is like a step before or after it.
    An angle that turns by more than half a turn from each row to the next is not
    wrapped.

    Parameters
    ----------
    values : ndarray (m,)
        The angle [its unit].
    turn : float
        A whole turn [its unit].

    Examples
    --------
    >>> angle = np.arange(0.0, 900.0, 70.0)
    >>> find_wrap(angle, 360.0), find_wrap(angle % 360, 360.0), find_wrap(3 * angle, 360.0)
    (None, 5, None)
    """
    steps = np.diff(values)
    long = np.abs(np.round(steps / turn)) == 1
    if steps.size < 2 or not long.any():
        return None
    left = steps - turn * np.round(steps / turn)
    change, change_left = (np.pad(np.abs(np.diff(one)), 1, "edge") for one in (steps, left))
    smoother = change_left[:-1] + change_left[1:] < change[:-1] + change[1:]
    alike = np.minimum(change_left[:-1], change_left[1:]) < WRAP_TOLERANCE * turn
    found = np.flatnonzero(long & smoother & alike)
    return int(found[0]) if found.size else None


def read_table(file: Path) -> RecordedTable:
    """Read a CSV file, or return it from memory if it was not changed since it was read.

    Raises
    ------
    InputError
        No such file, no CSV, rows of another length than the header, two columns of one name.
    """
    try:
        file.stat()
    except FileNotFoundError:
        raise InputError(file, "", "no such recorded curve") from None
    except (OSError, ValueError) as error:  # such as a zero byte in its name
        raise InputError(file, "", f"cannot be read: {error}") from None
    return parse_table(file)


def import_hint(file: Path) -> str:
    """The command that makes a table which can be read of most files.

    >>> import_hint(Path("data/run 3.csv"))
    "try proofmass import 'run 3.csv'"
    """
    return f"try proofmass import {shlex.quote(file.name)}"


def with_import_hint(error: InputError) -> InputError:
    """An error of a file with the command that may mend it."""
    return InputError(error.file, error.key, f"{error.wrong}; {import_hint(error.file)}")


@read_once()
def parse_table(file: Path) -> RecordedTable:
    """Do what `read_table` does, once for each content of a file."""
    text = decode_csv(read_bytes(file))
    try:
        return parse_text(file, text)
    except InputError as error:
        raise with_import_hint(error) from None


def parse_text(file: Path, text: str) -> RecordedTable:
    """Read the text of a CSV file.

    Raises
    ------
    InputError
        No CSV, rows of another length than the header, two columns of one name.
    """
    mark = find_separator(text)
    try:
        lines = [
            (k, row)
            for k, row in enumerate(csv.reader(io.StringIO(text, newline=""), delimiter=mark), 1)
            if row and not row[0].lstrip().startswith("#")
        ]
    except csv.Error as error:
        raise InputError(file, "", f"not CSV: {error}") from None
    if lines and all(map(is_number, lines[0][1])):  # there is no header
        lines.insert(0, (lines[0][0], [str(k + 1) for k in range(len(lines[0][1]))]))
    if mark != ",":
        lines = [lines[0], *replace_decimal_commas(file, lines[1:])] if lines else lines
    if len(lines) < 3:
        raise InputError(file, "", "a header and at least two rows are needed")
    units: dict[str, str] = {}
    for cell in lines[0][1]:
        name, unit = split_header(cell)
        if name in units:
            raise InputError(file, f"column {name!r}", "stands twice in the header")
        units[name] = unit
    for k, row in lines[1:]:
        if len(row) != len(units):
            raise InputError(file, f"line {k}", f"{len(row)} cells, the header has {len(units)}")
    return RecordedTable(file, units, tuple(lines[1:]))


def decode_csv(data: bytes) -> str:
    """Decode the text of a CSV file, in the encodings that spreadsheets write.

    >>> decode_csv("x [°]".encode("latin-1")) == decode_csv("x [°]".encode("utf-8-sig")) == "x [°]"
    True
    """
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return data.decode("utf-16", errors="replace")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("cp1252", errors="replace")


def find_separator(text: str) -> str:
    """Find the character between the cells of the header, the first line that is no comment.

    >>> find_separator("# rig 3; day 2\\nt [s],r [m]"), find_separator("t [s];r [m]")
    (',', ';')
    """
    lines = (line for line in text.splitlines() if line.strip() and line.lstrip()[0] != "#")
    head = next(lines, "")
    return next((mark for mark in ";\t" if mark in head), ",")


def replace_decimal_commas(
    file: Path, lines: list[tuple[int, list[str]]]
) -> list[tuple[int, list[str]]]:
    """Return rows in which decimal points replace decimal commas.

    Raises
    ------
    InputError
        The file has both: one of them groups digits, and which one is not known.
    """
    signs = {sign: k for k, row in lines for cell in row for sign in ",." if sign in cell}
    if len(signs) == 2:
        raise InputError(
            file,
            f"line {max(signs.values())}",
            "numbers with commas and with points "
            "in one file; write the decimals in one way, and do not group digits",
        )
    return [(k, [cell.replace(",", ".") for cell in row]) for k, row in lines]


def is_number(cell: str) -> bool:
    """Whether a cell is a number, with a decimal comma or a decimal point."""
    try:
        float(cell.replace(",", "."))
    except ValueError:
        return False
    return True


def split_header(cell: str) -> tuple[str, str]:
    """Split a header cell into name and unit; all of a cell that ends with no unit is the name.

    >>> split_header("theta2 [deg]"), split_header("Velocity [1] (deg/s)")
    (('theta2', 'deg'), ('Velocity [1] (deg/s)', ''))
    """
    name, _, rest = cell.strip().partition("[")
    if not rest.endswith("]"):
        return cell.strip(), ""
    return name.strip(), rest[:-1].strip()


def cell_number(file: Path, line: int, cell: str, name: str) -> float:
    """Return a cell as a finite number; InputError if it is none."""
    try:
        value = float(cell)
    except ValueError:
        raise InputError(file, f"line {line}, {name}", f"{cell!r} is no number") from None
    if not math.isfinite(value):
        raise InputError(file, f"line {line}, {name}", f"{cell!r} is not finite")
    return value


def row_numbers(file: Path, line: int, row: Sequence[str], names: Sequence[str]) -> list[float]:
    """Return one row as finite floats; InputError if a cell is none or the length is wrong."""
    if len(row) != len(names):
        raise InputError(file, f"line {line}", f"{len(row)} cells, the header has {len(names)}")
    return [cell_number(file, line, cell, name) for name, cell in zip(names, row, strict=True)]


def read_named_rows(file: Path, header: Sequence[str], row_word: str) -> dict[str, list[float]]:
    """Read a CSV file with this header, whose rows are a name and positive numbers.

    `row_word` is the word for a row in messages.

    Raises
    ------
    InputError
        No such file, another header, no row, a name twice, a number that is not positive.
    """
    if not file.is_file():
        raise InputError(file, "", f"no such file of {row_word}s")
    lines = [
        [cell.strip() for cell in line.split(",")]
        for line in file.read_text(encoding="utf-8-sig").splitlines()
    ]
    if not lines or lines[0] != list(header):
        raise InputError(file, "line 1", f"the header must be '{','.join(header)}'")
    found: dict[str, list[float]] = {}
    for number, (name, *cells) in enumerate(lines[1:], 2):
        if not name and not cells:
            continue
        values = row_numbers(file, number, cells, header[1:])
        if not name or name in found:
            raise InputError(
                file, f"line {number}", f"a {row_word} needs a name of its own, got {name!r}"
            )
        for column, value in zip(header[1:], values, strict=True):
            if not value > 0:
                raise InputError(
                    file, f"line {number}, {column}", f"must be positive, got {value:g}"
                )
        found[name] = values
    if not found:
        raise InputError(file, "", f"no {row_word}s")
    return found


def interpolate_recorded(x: Array, rows: Array, curve: Array) -> tuple[Array, Array]:
    """Interpolate a recorded curve at other places, and estimate the error there.

    The curve is the cubic spline through all rows, whose second derivative is continuous.  A place
    that is at a row has the row's own value, and no error.

    The error is estimated with splines through fewer rows, at the rows that they leave out.
    Splines through every second row show the error at twice the spacing, splines through every
    fourth row the error at four times the spacing.  Where the first is a tenth of the second or
    less, within four rows, the error falls with the fourth power of the spacing, and the spline
    through all rows has 1/16 of the first; twice that is stated.  Elsewhere the curve has a bend,
    where the spline through all rows may have a larger error: up to 1.6 times the first, if the
    bend lies between the rows that were left out.  There twice the first is stated.  Both are
    doubled in the four rows at each end, where no row is left out.  An interval that is longer than
    the mean of those around it has an error that is larger by the fourth power of their ratio.

    Parameters
    ----------
    x : ndarray (n,)
        Places, within the range of the rows [SI].
    rows, curve : ndarray (m,)
        Rows of the record, rising, and the curve there [SI]; at least `MIN_ROWS` rows.

    Returns
    -------
    tuple of two ndarray (n,)
        The curve, and the error that it may have [SI].

    Examples
    --------
    >>> rows = np.linspace(0.0, 6.0, 61)
    >>> x = np.array([0.2, 0.25, 3.14])
    >>> found, error = interpolate_recorded(x, rows, np.sin(rows))
    >>> float(error[0]), bool((np.abs(found - np.sin(x)) <= error + 1e-16).all())
    (0.0, True)
    """
    from scipy.interpolate import CubicSpline  # slow to load

    nearest = nearest_rows(x, rows)
    at_row = np.abs(x - rows[nearest]) <= ROW_TOLERANCE * float(np.median(np.diff(rows)))
    found = np.where(at_row, curve[nearest], CubicSpline(rows, curve)(x))
    interval = np.clip(np.searchsorted(rows, x, "right") - 1, 0, rows.size - 2)
    return found, np.where(at_row, 0.0, interval_errors(rows, curve)[interval])


def nearest_rows(x: Array, rows: Array) -> Array:
    """Return the indices of the rows that are nearest to places."""
    after = np.clip(np.searchsorted(rows, x), 1, rows.size - 1)
    return np.where(x - rows[after - 1] <= rows[after] - x, after - 1, after)


def interval_errors(rows: Array, curve: Array) -> Array:
    """Estimate the error of the spline through all rows between each row and the next, (m - 1,)."""
    double, fourfold = (
        with_neighbours(left_out_errors(rows, curve, every)).max(axis=1) for every in (2, 4)
    )
    errors = double * np.where(double <= CUBIC_ERROR_RATIO * fourfold, SMOOTH_FACTOR, BEND_FACTOR)
    errors[:NEIGHBOUR_ROWS] *= END_FACTOR
    errors[-NEIGHBOUR_ROWS:] *= END_FACTOR
    spacing = np.diff(rows)
    longer = np.maximum(spacing / with_neighbours(spacing).mean(axis=1), 1.0)
    return np.maximum(errors[:-1], errors[1:]) * longer**4


def left_out_errors(rows: Array, curve: Array, every: int) -> Array:
    """Return errors of splines through every n-th row, at the rows that they leave out, (m,).

    `every` is n.  There are n splines, which begin at each of the first n rows; none is evaluated
    beyond its own rows.
    """
    from scipy.interpolate import CubicSpline  # slow to load

    errors = np.zeros(rows.size)
    for first in range(every):
        kept = slice(first, None, every)
        inside = (rows >= rows[kept][0]) & (rows <= rows[kept][-1])
        off = np.abs(CubicSpline(rows[kept], curve[kept])(rows[inside]) - curve[inside])
        errors[inside] = np.maximum(errors[inside], off)
    return errors


def with_neighbours(values: Array) -> Array:
    """Return each value with its `NEIGHBOUR_ROWS` neighbours on each side; the ends are repeated.

    >>> with_neighbours(np.array([1.0, 2.0]))[0].tolist()
    [1.0, 1.0, 1.0, 1.0, 1.0, 2.0, 2.0, 2.0, 2.0]
    """
    padded = np.pad(values, NEIGHBOUR_ROWS, "edge")
    return np.lib.stride_tricks.sliding_window_view(padded, 2 * NEIGHBOUR_ROWS + 1)
