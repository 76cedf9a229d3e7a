"""Paths of one's own: places of an end point or a platform from the rows of a file, over time."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from proofmass.analytic.inverse import COORDINATES, PathMotion
from proofmass.base.arrays import Array
from proofmass.base.errors import InputError
from proofmass.base.recorded import (
    MIN_ROWS,
    RecordedColumn,
    RecordedTable,
    interval_errors,
    read_table,
)
from proofmass.base.recording import Recording, RunAxis
from proofmass.base.units import same_quantity
from proofmass.case.case import PathTable
from proofmass.case.profile import MIN_SPLINE_ROWS, find_jump

if TYPE_CHECKING:
    from scipy.interpolate import PPoly

STRAIGHT_SHARE = 1e-9
"""Share of the size of a path by which a coordinate may be off a straight line over time and counts
as straight: rows that are printed with ten digits.  The spline would turn the last digits into an
acceleration, of 4e-10 of the size of the path over the square of the spacing."""


@dataclass(frozen=True)
class EndPath:
    """The rows of a path, and the cubic splines through them.

    Attributes
    ----------
    table : RecordedTable
        The file.
    times : ndarray (m,)
        Times of the rows on the x of the run [s].
    places : ndarray (coordinates, m)
        The rows [m, rad].
    words : str
        How places between the rows were found, and how accurate they are.
    """

    table: RecordedTable
    times: Array
    places: Array
    words: str

    def motion(self, time: Array) -> PathMotion:
        """Places, rates and accelerations at times (n,) [s]."""
        place, rate, acceleration = (self.spline(time, order).T for order in range(3))
        return PathMotion(time, place, rate, acceleration)

    @cached_property
    def spline(self) -> "PPoly":
        """The splines of all coordinates over time; straight lines where these are straight."""
        from scipy.interpolate import CubicSpline, PPoly  # slow to load

        pieces = np.array(CubicSpline(self.times, self.places.T).c)
        for k, straight in enumerate(self.straight):
            if straight:
                line, slope = self.lines[0][k], self.lines[1][k]
                pieces[:, :, k] = np.stack([0 * line[:-1], 0 * line[:-1], slope, line[:-1]])
        return PPoly(pieces, self.times)

    @cached_property
    def lines(self) -> tuple[Array, Array]:
        """Rows (coordinates, m) on straight lines over time, and slopes (coordinates, m - 1)."""
        share = (self.times - self.times[0]) / (self.times[-1] - self.times[0])
        first, way = self.places[:, :1], self.places[:, -1:] - self.places[:, :1]
        slope = way / (self.times[-1] - self.times[0])
        return first + way * share, np.broadcast_to(slope, (len(way), self.times.size - 1))

    @property
    def straight(self) -> NDArray[np.bool_]:
        """Whether each coordinate (coordinates,) is a straight line over time, but for rounding."""
        off = np.abs(self.places - self.lines[0]).max(axis=1)
        return np.asarray(off <= STRAIGHT_SHARE * self.size)

    @property
    def size(self) -> float:
        """Largest range of a coordinate [m or rad]."""
        return float(np.ptp(self.places, axis=1).max())

    def row_before(self, time: float) -> int:
        """The last row that is not after a time [s]."""
        return int(np.clip(np.searchsorted(self.times, time, "right") - 1, 0, self.times.size - 1))


def path_clock(file: Path, path: PathTable) -> Recording | None:
    """The column of times of a path's file; None if the rows have no times.

    It is the column that the sidecar names, or the first one if that is a time.
    """
    table = read_table(file)
    if path.time is not None:
        table.require(path.time, "s")
        return Recording(table, path.time)
    first, unit = next(iter(table.units.items()))
    try:
        is_time = same_quantity(unit or "1", "s")
    except ValueError:  # no unit, or an unknown one: it is a coordinate or not used
        is_time = False
    return Recording(table, RecordedColumn(column=first)) if is_time else None


def path_times(
    file: Path, path: PathTable, axis: RunAxis, origin: float | None, until: float | None
) -> Array:
    """Times (m,) of the rows of a path on the x of a run [s].

    Raises
    ------
    InputError
        A time is no number, or the times do not rise.
    ValueError
        The rows have no times, and `until` does not say when the path ends.
    """
    clock = path_clock(file, path)
    if clock is not None:
        return clock.place(axis, origin).x
    if until is None:
        raise ValueError(
            f"the rows of {file.name} have no times: give until = the time of the whole path [s], "
            "or a first column 'time [s]'"
        )
    return np.linspace(0.0, until, len(read_table(file).rows))


def read_path(file: Path, path: PathTable, coordinates: Sequence[str], times: Array) -> EndPath:
    """Read the coordinates of a path.

    Parameters
    ----------
    file : Path
    path : PathTable
    coordinates : sequence of str
        The coordinates that the inverse problem needs.
    times : ndarray (m,)
        Times of the rows [s].

    Raises
    ------
    InputError
        There are too few rows, a cell is no number, or a row jumps.
    ValueError
        A column is missing or measures something else, or a coordinate is not needed.
    """
    table = read_table(file)
    for name in COORDINATES.keys() - set(coordinates):
        if getattr(path, name) is not None:
            raise ValueError(
                f"{name}: leave it out; the reference leads along {', '.join(coordinates)}"
            )
    if times.size < MIN_SPLINE_ROWS:
        raise InputError(
            file, "", f"{times.size} rows; a path needs {MIN_SPLINE_ROWS}, for the spline"
        )
    places = np.array([read_coordinate(table, path, name, times.size) for name in coordinates])
    found = EndPath(table, times, places, describe_spline(times, places))
    if found.size == 0.0:
        raise InputError(file, "", "all rows are at the same place; a path has to move")
    check_jumps(found, coordinates)
    return found


def read_coordinate(table: RecordedTable, path: PathTable, name: str, rows: int) -> Array:
    """A coordinate of a path at its rows (m,) [m or rad]."""
    given = getattr(path, name)
    if isinstance(given, float):
        return np.full(rows, given)
    column = given or RecordedColumn(column=name)
    if column.column not in table.units:
        raise ValueError(
            f"{name} is missing: {table.file.name} has no column {column.column!r}, it has "
            f'{", ".join(table.units)}; name its column, {name} = "..", or a number '
            f"[{COORDINATES[name]}], {name} = 0.0"
        )
    table.require(column, COORDINATES[name])
    return table.curve(column)


def check_jumps(path: EndPath, coordinates: Sequence[str]) -> None:
    """Raise InputError for the first row after which a coordinate jumps."""
    for name, values in zip(coordinates, path.places, strict=True):
        if np.ptp(values) <= STRAIGHT_SHARE * path.size:  # constant but for rounding
            continue
        if (k := find_jump(path.times, values)) is not None:
            raise InputError(
                path.table.file,
                path.table.line(k + 1),
                f"{name} jumps from {values[k]:.6g} to {values[k + 1]:.6g} {COORDINATES[name]} in "
                f"{path.times[k + 1] - path.times[k]:.3g} s: no drive can follow; record the way "
                "from one to the other in several rows",
            )


def describe_spline(times: Array, places: Array) -> str:
    """Say how places between the rows are found, and by how much they may be off."""
    words = f"{times.size} rows, joined by cubic splines"
    if times.size < MIN_ROWS:
        return words
    off = max(float(interval_errors(times, row).max()) for row in places)
    return f"{words}, which may be off by {off:.2g} between rows"
