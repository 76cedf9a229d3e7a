"""Recorded rows on the x of a run: which x of a run a row of a file belongs to.

The same rules hold for the three uses of a file: a reference, a party that is compared with a
reference, and the rows that a drive or a load follows.  The x of a run is a time, or in a sweep
with a drive of constant rate the value of that drive, or in equilibrium an arc length.  The x
column of a file has a kind by its unit.

    x of the file              x of the run         a row belongs to
    time                       time                 its time since the run began
    time                       value of a drive     from + rate * time
    value of a steady drive    value of a drive     its value
    value of a steady drive    time                 (value - from) / rate
    length                     arc length           its length

The run begins at 0 s.  `clock_origin` finds the time of a file's clock at which it begins.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from proofmass.base.arrays import Array
from proofmass.base.errors import InputError
from proofmass.base.recorded import (
    ITS_COLUMN,
    MIN_ROWS,
    ROW_TOLERANCE,
    RecordedColumn,
    RecordedTable,
    RecordingTable,
    interpolate_recorded,
    nearest_rows,
)
from proofmass.base.units import si_unit

SAME_PLACE = 0.5
"""Share of the spacing of rows: places that are nearer to each other have the same nearest row."""
LOST_ROW = 1.5
"""Spacings of rows: a clock that begins no later after 0 has lost its first row; most programs
whose clock has no 0 begin much later."""
END_TOLERANCE = 1e-3
"""Share of the spacing of rows by which a run may go beyond them: the digits of a printed x are
rounded; the last piece of a spline is off by much less there than within the rows."""
X_OF_REFERENCE = "[recording] x = { column = .., unwrap = true }"
"""Where a sidecar says how the x of a recorded reference is read."""
EVEN_TOLERANCE = 1e-9
"""Share of the mean spacing by which the spacings of even rows may differ: rounding of floats."""


class Recorded:
    """A recorded file as the reference of a case.

    Attributes
    ----------
    table : RecordedTable
    gap : float
        Largest spacing of rows for interpolation, in multiples of the usual spacing [1].
    columns : dict of str to RecordedColumn
        The columns by the names of their curves: those of the file, and those of the sidecar.
    recording : Recording
        The x column.
    curves : dict of str to ndarray (m,)
        Curves that were read [SI].

    Raises
    ------
    ValueError
        A column of the sidecar does not exist, or its unit is not known.
    """

    def __init__(self, table: RecordedTable, settings: RecordingTable) -> None:
        self.table, self.gap = table, settings.gap
        own = {name: RecordedColumn(column=name) for name in table.units}
        self.columns = {**own, **settings.columns}
        for column in settings.columns.values():
            table.require(column)
        self.recording = Recording(table, settings.x, X_OF_REFERENCE)
        self.curves: dict[str, Array] = {}

    def unit(self, name: str) -> str:
        """Return the SI unit of a curve; ValueError if it is not known."""
        return si_unit(self.table.unit_of(self.columns[name]))[0]

    def curve(self, name: str) -> Array:
        """Return a curve at the rows [SI]; see `RecordedTable.curve` for its errors."""
        if name not in self.curves:
            where = f"[recording] columns.{name} = {{ unwrap = true }}"
            self.curves[name] = self.table.curve(self.columns[name], where)
        return self.curves[name]


@dataclass(frozen=True)
class SteadyDrive:
    """A first drive of constant rate, whose value and time determine each other.

    Attributes
    ----------
    unit : str
        SI unit of its value, rad or m.
    start : float
        Its value when the run begins [rad or m].
    rate : float
        Its rate [rad/s or m/s].
    """

    unit: str
    start: float
    rate: float

    def value(self, time: Array) -> Array:
        """Return the values (n,) at times (n,) since the run began [rad or m]."""
        return self.start + self.rate * time

    def time(self, value: Array) -> Array:
        """Return the times (n,) at which the drive has values (n,) [s]."""
        return (value - self.start) / self.rate


@dataclass(frozen=True)
class RunAxis:
    """The x of a run.

    Attributes
    ----------
    kind : str
        The kind of the run, for messages.
    unit : str
        SI unit of x: s, or rad or m.
    steady : SteadyDrive, optional
        The first drive, if it has a constant rate.
    duration : float, optional
        Time that the run takes [s]; None if it is not known without the file.
    begin : float
        Time at which its first sample is, 0 but for a reference without its first rows [s].
    """

    kind: str
    unit: str
    steady: SteadyDrive | None = None
    duration: float | None = None
    begin: float = 0.0

    @property
    def units(self) -> tuple[str, ...]:
        """SI units that the x column of a file may have."""
        own = ("s", self.steady.unit) if self.steady else (self.unit,)
        return tuple(dict.fromkeys([self.unit, *own]))


class Recording:
    """The x column of a recorded file, before it is known which run it belongs to.

    Attributes
    ----------
    table : RecordedTable
    column : RecordedColumn
        The x column; the first column of the file if none was given.
    where : str
        Where the sidecar may say that the column is to be unwrapped, for messages.
    unit : str
        Its SI unit.

    Raises
    ------
    ValueError
        There is no such column, or its unit is not known.
    """

    def __init__(
        self, table: RecordedTable, column: RecordedColumn | None = None, where: str = ITS_COLUMN
    ) -> None:
        self.table, self.where = table, where
        self.column = column or RecordedColumn(column=next(iter(table.units)))
        self.unit = si_unit(table.unit_of(self.column))[0]

    @cached_property
    def values(self) -> Array:
        """The values of the column, which rise, or fall if they are no times (m,) [SI].

        Raises
        ------
        InputError
            A cell is no finite number, or the values turn back.
        """
        return self.table.monotonic(self.column, self.unit != "s", self.where)

    @property
    def spacing(self) -> float:
        """The usual spacing of two rows, the median [SI]."""
        return float(np.median(np.abs(np.diff(self.values))))

    def check_gaps(self, largest: float) -> None:
        """Raise InputError if two rows are farther apart than `largest` times the usual spacing."""
        ratios = np.abs(np.diff(self.values)) / self.spacing
        k = int(np.argmax(ratios))
        if ratios[k] > largest:
            raise InputError(
                self.table.file,
                self.table.line(k + 1),
                f"{self.column.column} goes from {self.values[k]:.6g} to {self.values[k + 1]:.6g} "
                f"{self.unit}, {ratios[k]:.3g} times the usual spacing of rows, "
                f"{self.spacing:.4g} {self.unit}: record what is missing, or allow it by gap = "
                f"{np.ceil(ratios[k]):.0f}",
            )

    def place(self, axis: RunAxis, origin: float | None = None) -> "PlacedRows":
        """Find the x of a run that each row belongs to.

        Parameters
        ----------
        axis : RunAxis
        origin : float, optional
            Time of the file's clock at which the run begins, if other files have the same clock
            [s]; by default that of `clock_origin`.

        Raises
        ------
        InputError
            The column measures another quantity than the x of the run, or goes against the motion
            of the drive.
        """
        name, steady = self.column.column, axis.steady
        if self.unit not in axis.units:
            raise InputError(
                self.table.file,
                f"column {name!r}",
                f"x of the {axis.kind}: column {name!r} of {self.table.file.name} is in "
                f"{self.table.unit_of(self.column)!r}, where {' or '.join(axis.units)} is needed, "
                "or a unit of the same quantity",
            )
        if self.unit == "s":
            zero = self.clock_origin(axis) if origin is None else origin
            words = describe_clock(name, zero)
            if axis.unit == "s":
                return PlacedRows(self, self.values - zero, words)
            assert steady is not None  # since the run's x may be in s only by its law
            law = f"{name} is the drive's value by its rate, {steady.rate:.6g} {steady.unit}/s"
            places = steady.value(self.values - zero)
            return PlacedRows(self, places, f"{words}; {law}" if words else law)
        if steady is not None and self.unit == steady.unit:
            if (self.values[-1] > self.values[0]) != (steady.rate > 0):
                raise InputError(
                    self.table.file,
                    f"column {name!r}",
                    f"it goes from {self.values[0]:.6g} to {self.values[-1]:.6g} {self.unit}, "
                    f"against the drive's rate, {steady.rate:.6g} {self.unit}/s; turn the rows "
                    "around, or change the sign of the rate or of the column (scale = -1)",
                )
            if axis.unit == "s":
                words = f"{name} is the time by the drive's rate, {steady.rate:.6g} {self.unit}/s"
                return PlacedRows(self, steady.time(self.values), words)
        return PlacedRows(self, self.values, "")

    def clock_origin(self, axis: RunAxis) -> float:
        """The time of the file's clock that is 0 s of a run [s].

        It is 0 if the clock has the beginning of the run among its rows, or begins within a row and
        a half after it, when the first row is missing.  The run begins at the first row if the rows
        take just as long as the run, whose duration is known, or if the clock lacks its beginning.
        """
        first, last = float(self.values[0]) - axis.begin, float(self.values[-1]) - axis.begin
        near = SAME_PLACE * self.spacing
        if abs(first) <= near:
            return 0.0
        if axis.duration is not None and abs(last - first - axis.duration) <= near:
            return first
        return first if first > LOST_ROW * self.spacing or last < near else 0.0


def describe_clock(name: str, origin: float) -> str:
    """Say which time of a file's clock is 0 s of a run; empty if it is 0.

    >>> describe_clock("t", 3.25), describe_clock("t", 0.0)
    ("the run begins at t = 3.25 s of the file's clock", '')
    """
    return f"the run begins at {name} = {origin:.10g} s of the file's clock" if origin else ""


@dataclass(frozen=True)
class PlacedRows:
    """The rows of a recorded file on the x of a run.

    Attributes
    ----------
    recording : Recording
        The x column.
    x : ndarray (m,)
        The x of the run that each row belongs to, rising or falling [s, rad or m].
    words : str
        How x was found, if it is not the column itself.
    """

    recording: Recording
    x: Array
    words: str

    @property
    def spacing(self) -> float:
        """The usual spacing of two rows, the median [s, rad or m]."""
        return float(np.median(np.abs(np.diff(self.x))))

    @property
    def even(self) -> bool:
        """Whether all rows have the same spacing."""
        spacing = np.diff(self.x)
        return bool(np.ptp(spacing) <= EVEN_TOLERANCE * abs(spacing.mean()))

    @property
    def rising(self) -> slice:
        """The order in which x rises."""
        return slice(None, None, 1 if self.x[-1] > self.x[0] else -1)

    def samples(self, kind: str) -> Array:
        """The samples of a run whose reference has these rows.

        They are the rows; but in dynamics, in which an engine goes from sample to sample in equal
        steps, as many even times if the rows are uneven.
        """
        if kind != "dynamics" or self.even:
            return self.x
        return np.linspace(self.x[0], self.x[-1], self.x.size)

    def begin_with(self, x: Array) -> bool:
        """Whether samples are the first rows, as those of a run with this reference are."""
        return np.array_equal(self.x[: x.size], x)

    def have(self, x: Array) -> bool:
        """Whether there is a row at each sample."""
        if self.begin_with(x):
            return True
        rows = self.x[self.rising]
        distances = np.abs(x - rows[nearest_rows(x, rows)])
        return bool((distances <= ROW_TOLERANCE * self.spacing).all())

    def at(self, x: Array, curve: Array) -> tuple[Array, Array]:
        """Return a curve of the file at samples of the run, and the error that it may have there.

        Parameters
        ----------
        x : ndarray (n,)
            Samples [s, rad or m].
        curve : ndarray (m,)
            The curve at the rows [SI].

        Returns
        -------
        tuple of two ndarray (n,)
            The row's own value and no error where a row is at the sample, otherwise those of
            `proofmass.base.recorded.interpolate_recorded` [SI].
        """
        if self.begin_with(x):
            return curve[: x.size], np.zeros(x.size)
        rows, values = self.rows_of(curve)
        if self.have(x):
            return values[nearest_rows(x, rows)], np.zeros(x.size)
        return interpolate_recorded(x, rows, values)

    def rows_of(self, curve: Array) -> tuple[Array, Array]:
        """The x of the rows, rising, and a curve of the file there [SI]."""
        return self.x[self.rising], curve[self.rising]

    def require(self, x: Array, kind: str) -> None:
        """Raise InputError if the rows do not cover a run, or are too few to interpolate."""
        table, name = self.recording.table, self.recording.column.column
        if not covers(self.x, x):
            on_axis = f" ({self.words})" if self.words else ""
            raise InputError(
                table.file,
                f"column {name!r}",
                f"it goes from {self.x[0]:.10g} to {self.x[-1]:.10g} (SI){on_axis}, the {kind} "
                f"from {x[0]:.10g} to {x[-1]:.10g}; nothing is extrapolated: record the rest, give "
                "the run other samples, or shift the column",
            )
        if self.x.size < MIN_ROWS and not self.have(x):
            raise InputError(
                table.file,
                "",
                f"{self.x.size} rows are too few to interpolate; record {MIN_ROWS} or more, or "
                "rows at the samples of the run",
            )


def covers(rows: Array, x: Array) -> bool:
    """Whether samples lie within rows that rise or fall, but for rounded digits of the rows.

    >>> covers(np.array([0.0, 1.0, 2.0]), np.array([0.0, 2.0009])), covers(np.ones(2), np.zeros(1))
    (True, False)
    """
    near = END_TOLERANCE * float(np.median(np.abs(np.diff(rows))))
    low, high = sorted((float(rows[0]), float(rows[-1])))
    return bool(x.min() >= low - near and x.max() <= high + near)
