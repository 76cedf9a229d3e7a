"""A recorded curve as a reference: a CSV file from a test rig or another program.

The first column is x and rises; every column's header is a name with its unit in brackets:
``t [s], theta2 [deg], r1 [mm]``.  Units are brought to SI and radians.

The file is in UTF-8, with or without a byte order mark, in UTF-16 with one, or else in
Windows-1252, as spreadsheets write it.  Cells are separated by commas, or by semicolons or tabs if
the header has them; only then a number may have a decimal comma.
"""

import codecs
import csv
import io
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from proofmass.analytic.numerics import Array
from proofmass.errors import InputError
from proofmass.files import read_bytes
from proofmass.units import si_unit


@dataclass(frozen=True)
class Recorded:
    """Columns of a CSV file in SI units; x first."""

    x: Array
    columns: dict[str, Array]
    units: dict[str, str]


def read_recorded(file: Path) -> Recorded:
    """Read a recorded curve.

    Raises
    ------
    InputError
        No such file, a header without a unit, a cell that is no finite number, an x that does
        not rise; the row and the column are named.
    """
    if not file.exists():
        raise InputError(file, "", "no such recorded curve")
    text = decoded(read_bytes(file))
    mark = separator(text)
    try:
        lines = [
            (k, row)
            for k, row in enumerate(csv.reader(io.StringIO(text, newline=""), delimiter=mark), 1)
            if row and not row[0].lstrip().startswith("#")
        ]
    except csv.Error as error:
        raise InputError(file, "", f"not CSV: {error}") from None
    if mark != ",":
        lines = [lines[0], *with_points(file, lines[1:])] if lines else lines
    if len(lines) < 3:
        raise InputError(file, "", "a header and at least two rows are needed")
    names, units, factors = zip(*(header(file, cell) for cell in lines[0][1]), strict=True)
    table = np.array([numbers(file, k, row, names) for k, row in lines[1:]]) * factors
    fall = np.flatnonzero(np.diff(table[:, 0]) <= 0)
    if fall.size:
        k = lines[fall[0] + 2][0]
        raise InputError(
            file,
            f"line {k}",
            f"{names[0]} does not rise ({table[fall[0], 0]:.6g} then {table[fall[0] + 1, 0]:.6g})",
        )
    columns = dict(zip(names, table.T, strict=True))
    return Recorded(table[:, 0], columns, dict(zip(names, units, strict=True)))


def decoded(data: bytes) -> str:
    """The text of a CSV file, in the encodings that spreadsheets write.

    >>> decoded("x [°]".encode("latin-1")) == decoded("x [°]".encode("utf-8-sig")) == "x [°]"
    True
    """
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return data.decode("utf-16", errors="replace")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("cp1252", errors="replace")


def separator(text: str) -> str:
    """What stands between the cells of the header, the first line that is no comment.

    >>> separator("# rig 3; day 2\\nt [s],r [m]"), separator("t [s];r [m]")
    (',', ';')
    """
    lines = (line for line in text.splitlines() if line.strip() and line.lstrip()[0] != "#")
    head = next(lines, "")
    return next((mark for mark in ";\t" if mark in head), ",")


def with_points(file: Path, lines: list[tuple[int, list[str]]]) -> list[tuple[int, list[str]]]:
    """Rows with decimal points for their decimal commas.

    Raises
    ------
    InputError
        The file has both: one of them groups digits, and which is not said.
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


def header(file: Path, cell: str) -> tuple[str, str, float]:
    """Name, SI unit and factor of a header cell such as ``theta2 [deg]``."""
    name, bracket, rest = cell.strip().partition("[")
    if not bracket or not rest.endswith("]"):
        raise InputError(file, f"column {cell.strip()!r}", "no unit; write it as 'name [unit]'")
    try:
        return name.strip(), *si_unit(rest[:-1].strip())
    except ValueError as error:
        raise InputError(file, f"column {cell.strip()!r}", str(error)) from None


def numbers(file: Path, line: int, row: list[str], names: tuple[str, ...]) -> list[float]:
    """One row as finite floats."""
    if len(row) != len(names):
        raise InputError(file, f"line {line}", f"{len(row)} cells, the header has {len(names)}")
    values = []
    for name, cell in zip(names, row, strict=True):
        try:
            values.append(float(cell))
        except ValueError:
            raise InputError(file, f"line {line}, {name}", f"{cell!r} is no number") from None
        if not math.isfinite(values[-1]):
            raise InputError(file, f"line {line}, {name}", f"{cell!r} is not finite")
    return values
