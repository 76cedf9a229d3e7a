"""A recorded curve as a reference: a CSV file from a test rig or another program.

The first column is x and rises; every column's header is a name with its unit in brackets:
``t [s], theta2 [deg], r1 [mm]``.  Units are brought to SI and radians.
"""

import csv
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from proofmass.errors import InputError
from proofmass.units import si_unit
from sim.protocol import Array


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
    if not file.is_file():
        raise InputError(file, "", "no such recorded curve")
    with file.open(newline="", encoding="utf-8-sig") as stream:
        lines = [(k, row) for k, row in enumerate(csv.reader(stream), 1)
                 if row and not row[0].lstrip().startswith("#")]
    if len(lines) < 3:
        raise InputError(file, "", "a header and at least two rows are needed")
    names, units, factors = zip(*(header(file, cell) for cell in lines[0][1]), strict=True)
    table = np.array([numbers(file, k, row, names) for k, row in lines[1:]]) * factors
    fall = np.flatnonzero(np.diff(table[:, 0]) <= 0)
    if fall.size:
        k = lines[fall[0] + 2][0]
        raise InputError(file, f"line {k}", f"{names[0]} does not rise "
                         f"({table[fall[0], 0]:.6g} then {table[fall[0] + 1, 0]:.6g})")
    columns = dict(zip(names, table.T, strict=True))
    return Recorded(table[:, 0], columns, dict(zip(names, units, strict=True)))


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
