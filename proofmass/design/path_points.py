"""The points of a path: a table of places, with crank angles and tolerances if it has them."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from proofmass.analytic.numerics import TURN
from proofmass.base.arrays import Array, Complex
from proofmass.base.errors import InputError
from proofmass.base.recorded import RecordedColumn, RecordedTable, read_table
from proofmass.base.units import same_quantity

LEAST_POINTS = 3
"""Least number of points; with two of them any linkage whatever fits after a change of its size."""
COLUMNS = {"x": "m", "y": "m", "angle": "rad", "tolerance": "m"}
"""Columns of a table of points, with the SI units of their quantities; the first two are needed."""
COINCIDENCE = 1e-9  # distance of two points over the size of the path below which they coincide [1]


@dataclass(frozen=True)
class PathPoints:
    """Points of a path, in the order in which they are passed.

    Attributes
    ----------
    points : ndarray (N,) of complex
        Places x + iy [m].
    angles : ndarray (N,), optional
        Crank angles at the points, which rise or fall [rad].
    tolerances : ndarray (N,), optional
        Largest distances from the points that are allowed [m].
    angles_from : str
        What the crank angles are measured from: ``first``, so that their differences alone count;
        ``x``, the x axis; or ``ground``, the direction to the rocker's pivot, or of the guide.
    closed : bool
        Whether the path leads back from the last point to the first.
    emphasis : ndarray (N,), optional
        Further factors of the weights of the points [1].
    """

    points: Complex
    angles: Array | None = None
    tolerances: Array | None = None
    angles_from: str = "first"
    closed: bool = False
    emphasis: Array | None = None

    @cached_property
    def size(self) -> float:
        """Largest distance between two points [m]."""
        return float(np.abs(self.points[:, None] - self.points).max())

    @property
    def weights(self) -> Array:
        """Weights of the distances [1]: the least tolerance over that of the point."""
        found = np.ones(self.points.size) if self.emphasis is None else self.emphasis
        if self.tolerances is None:
            return found
        return np.asarray(found * self.tolerances.min() / self.tolerances)

    @property
    def closing_share(self) -> float:
        """Length from the first to the last point over that of the closed path [1]."""
        chords = np.abs(np.diff(self.points))
        closing = abs(self.points[-1] - self.points[0])
        return float(chords.sum() / (chords.sum() + closing))

    @property
    def senses(self) -> tuple[int, ...]:
        """Senses in which the crank may turn: both, or the one of the given angles."""
        if self.angles is None:
            return (1, -1)
        return (1,) if self.angles[-1] > self.angles[0] else (-1,)

    @property
    def fingerprint(self) -> str:
        """A text that differs between any two paths."""
        return repr(
            (
                self.points.tolist(),
                None if self.angles is None else self.angles.tolist(),
                None if self.tolerances is None else self.tolerances.tolist(),
                self.angles_from,
                self.closed,
            )
        )


def read_points(file: Path, angles_from: str = "first", closed: bool = False) -> PathPoints:
    """Read the points of a path from a CSV file with the columns of `COLUMNS`.

    Raises
    ------
    InputError
        There is no such file; a column is missing, unknown or of another quantity; a cell is no
        finite number; there are fewer than `LEAST_POINTS` points; two successive points coincide;
        the angles turn back or exceed a turn; a tolerance is not positive.
    """
    if not file.exists():
        raise InputError(file, "", "no such file of points")
    table = read_table(file)
    check_columns(table)
    x, y = (table.curve(RecordedColumn(column=name)) for name in ("x", "y"))
    points = np.asarray(x + 1j * y, complex)
    if points.size < LEAST_POINTS:
        raise InputError(
            file, "", f"{points.size} points; a path needs {LEAST_POINTS}, each in a row of its own"
        )
    found = PathPoints(
        points,
        read_angles(table) if "angle" in table.units else None,
        read_tolerances(table) if "tolerance" in table.units else None,
        angles_from,
        closed,
    )
    check_distances(table, found)
    if angles_from != "first" and found.angles is None:
        raise InputError(file, "line 1", "angles from x or ground need a column 'angle [deg]'")
    return found


def check_columns(table: RecordedTable) -> None:
    """Raise InputError unless the columns are those of a table of points."""
    for name in ("x", "y"):
        if name not in table.units:
            raise InputError(
                table.file,
                "line 1",
                f"no column {name!r}; the columns are 'x [m]' and 'y [m]', and if wanted "
                f"'angle [deg]' of the crank and 'tolerance [m]', in any units of these quantities",
            )
    for name, quantity in {name: COLUMNS.get(name) for name in table.units}.items():
        if quantity is None:
            raise InputError(
                table.file,
                "line 1",
                f"column {name!r} is none of {', '.join(COLUMNS)}; leave it out",
            )
        try:
            unit = table.unit_of(RecordedColumn(column=name))
            same = same_quantity(unit, quantity)
        except ValueError as error:
            raise InputError(table.file, "line 1", str(error)) from None
        if not same:
            wanted = "an angle, such as deg" if quantity == "rad" else "a length, such as mm"
            raise InputError(
                table.file, "line 1", f"column {name!r} is in {unit!r}; it must be in {wanted}"
            )


def read_angles(table: RecordedTable) -> Array:
    """The crank angles [rad], which rise or fall by at most a turn in all."""
    angles = table.monotonic(RecordedColumn(column="angle"), may_fall=True)
    if abs(angles[-1] - angles[0]) > TURN * (1.0 + 1e-12):
        raise InputError(
            table.file,
            table.line(angles.size - 1),
            f"the crank angles cover {np.degrees(abs(angles[-1] - angles[0])):g} degrees; the "
            f"path must be passed within one turn of 360",
        )
    return angles


def read_tolerances(table: RecordedTable) -> Array:
    """The tolerances [m], which are positive."""
    found = table.curve(RecordedColumn(column="tolerance"))
    if (found <= 0).any():
        row = int(np.argmax(found <= 0))
        raise InputError(
            table.file, f"{table.line(row)}, tolerance", f"must be positive, got {found[row]:g} m"
        )
    return found


def check_distances(table: RecordedTable, path: PathPoints) -> None:
    """Raise InputError if two successive points coincide, or all lie in one place."""
    gaps = np.abs(np.diff(path.points)) <= COINCIDENCE * path.size
    if gaps.any():
        row = int(np.argmax(gaps)) + 1
        raise InputError(
            table.file,
            table.line(row),
            "the point is that of the row before; give each point once, the first one again only "
            "at the end of a closed path",
        )
