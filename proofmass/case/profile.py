"""Sampled profiles: the motion of a drive, or a control, from rows of a table.

A file, or a table in the sidecar, has the value of a drive or its rate at rising times.  The rows
become a piecewise polynomial p(t), whose derivatives and integral are exact:

    value, spline    q = p, cubic, q'' continuous          q' = p'     q'' = p''
    value, linear    q = p, straight between rows          only for a control
    value, held      q = p, a stair from row to row        only for a control
    rate, spline     q' = p, cubic, q''' continuous        q = from + integral of p, quartic
    rate, linear     q' = p, straight between rows         q quadratic, q'' a stair
"""

from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from proofmass.base.arrays import Array
from proofmass.base.errors import InputError
from proofmass.base.read_once import read_once
from proofmass.base.recorded import (
    MIN_ROWS,
    RecordedColumn,
    interval_errors,
    read_table,
)
from proofmass.base.recording import Recording, RunAxis, covers
from proofmass.case.case import ProfileTable
from proofmass.case.drive import (
    DriveState,
    format_numbers,
    profile_formula,
    quintic_spline,
    table_times,
)

MIN_SPLINE_ROWS = 4  # smallest number of rows of a spline; any table has at least two rows
JUMP_STEEPNESS = 10.0  # times the neighbouring slopes: a steeper change from row to row is a jump
RUN_IN_TIME = RunAxis("run", "s")
SMALLEST_JUMP = 1e-6  # of the range: a smaller change is no jump


@dataclass(frozen=True)
class SampledProfile:
    """A drive that follows a piecewise polynomial.

    Attributes
    ----------
    times : ndarray (m,)
        Times at which the pieces meet [s].
    pieces : ndarray (degree + 1, m - 1)
        Coefficients of the value, the highest power first [SI].
    file : str
        Name of the file of the rows, or words for a table in the sidecar.
    words : str
        How the polynomial was made of the rows, and how accurate it is between them.
    start, rate : float
        The x of the run at 0 s, and the rate of x: 0 and 1 where x is time; in a sweep with a drive
        of constant rate the value of that drive and its rate [SI].
    """

    times: Array
    pieces: Array
    file: str
    words: str
    start: float = 0.0
    rate: float = 1.0

    def __call__(self, x: Array) -> DriveState:
        """Value, rate and acceleration in time at samples x of a run.

        At a row where one of them jumps, it is that of the piece that begins there.
        """
        t = self.time(x)
        k = np.clip(np.searchsorted(self.times, t, "right") - 1, 0, self.times.size - 2)
        s, powers = t - self.times[k], np.arange(self.pieces.shape[0] - 1, -1, -1)
        found = list[Array]()
        factors = np.ones(powers.size)
        for order in range(3):
            value = np.zeros_like(t)
            for row, factor, power in zip(self.pieces, factors, powers - order, strict=True):
                if power >= 0:
                    value = value * s + factor * row[k]
            found.append(value)
            factors = factors * (powers - order)
        return found[0], found[1], found[2]

    def time(self, x: Array) -> Array:
        """The times (n,) of samples x (n,) of a run [s]."""
        return (np.asarray(x, float) - self.start) / self.rate

    def scalar(self) -> Callable[[float], float]:
        """The value only, as a function of one time [s].

        >>> pieces = np.array([[2.0, -1.0], [0.0, 2.0]])
        >>> profile = SampledProfile(np.array([0.0, 1.0, 3.0]), pieces, "", "")
        >>> times = [0.5, 1.0, 2.0]
        >>> [profile.scalar()(t) for t in times], profile(np.array(times))[0].tolist()
        ([1.0, 2.0, 1.0], [1.0, 2.0, 1.0])
        """
        times, pieces = self.times.tolist(), self.pieces.T.tolist()
        last = len(pieces) - 1

        def value(time: float) -> float:
            k = min(max(bisect_right(times, time) - 1, 0), last)
            found, s = 0.0, time - times[k]
            for row in pieces[k]:
                found = found * s + row
            return found

        return value

    @property
    def breaks(self) -> Array:
        """Times at which a derivative of the value jumps [s]."""
        return self.times

    def covers(self, x: Array) -> bool:
        """Whether samples lie within the rows, but for rounded digits."""
        return covers(self.times, self.time(x))


def make_sampled_profile(
    folder: Path,
    profile: ProfileTable,
    start: float,
    unit: str,
    *others: str,
    axis: RunAxis = RUN_IN_TIME,
    origin: float | None = None,
) -> SampledProfile:
    """Make the profile of a drive, or of the control of a load, from rows.

    Parameters
    ----------
    folder : Path
        The folder of the sidecar, to which the name of the file is relative.
    profile : ProfileTable
    start : float
        First value of a drive whose rate is given [rad or m].
    unit, *others : str
        SI unit of the joint's value, rad or m; for a control all units that it may have.
    axis : RunAxis
        The run in time.
    origin : float, optional
        See `proofmass.base.recording.Recording.place` [s].

    Raises
    ------
    InputError
        The file is wrong; the message names it, with the line or the column.
    ValueError
        A column does not exist, or measures something else; the message names it.
    """
    if profile.file is None:
        return profile_of_table(profile, start, unit)
    file = folder / profile.file
    return profile_of_file(file, profile, start, (unit, *others), axis, origin)


def profile_of_table(profile: ProfileTable, start: float, unit: str) -> SampledProfile:
    """Make a profile from rows that stand in the sidecar.

    Raises
    ------
    ValueError
        A spline has too few rows.
    """
    kind, column = profile.given
    times, values = (np.array(rows, float) for rows in (profile.time, column))
    if profile.interpolation == "spline" and times.size < MIN_SPLINE_ROWS:
        raise ValueError(
            f"{times.size} rows; a spline needs {MIN_SPLINE_ROWS}: give more, or "
            f"interpolation = 'linear'"
        )
    si = unit if kind == "value" else f"{unit}/s"
    pieces, words = make_pieces(times, values, profile, start, si)
    return SampledProfile(
        piece_times(times, profile), pieces, "the table", f"{profile.words}, {words}"
    )


def piece_times(times: Array, profile: ProfileTable) -> Array:
    """Times at which pieces meet [s]; a held row lasts until the next, the last as long as before.

    >>> stair = ProfileTable(time=(0.0, 0.5, 0.7), value=(1.0, 2.0, 3.0), interpolation="held")
    >>> piece_times(np.array(stair.time), stair)
    array([0. , 0.5, 0.7, 0.9])
    """
    if profile.interpolation != "held":
        return times
    return np.append(times, 2 * times[-1] - times[-2])


def profile_clock(file: Path, profile: ProfileTable) -> Recording:
    """The column that says when the drive or the load is at each row of a file.

    It raises as `make_sampled_profile` does.
    """
    assert not isinstance(profile.time, tuple)  # lists go without a file
    return clock_of_file(file, profile.time)


@read_once()
def clock_of_file(file: Path, column: RecordedColumn | None) -> Recording:
    """The column of times of a file."""
    return Recording(read_table(file), column)


@read_once()
def profile_of_file(
    file: Path,
    profile: ProfileTable,
    start: float,
    units: tuple[str, ...],
    axis: RunAxis,
    origin: float | None,
) -> SampledProfile:
    """Do what `make_sampled_profile` does, once for each content of a file."""
    table = read_table(file)
    kind, column = profile.given
    assert isinstance(column, RecordedColumn)
    unit = units[0]
    si = unit if kind == "value" else f"{unit}/s"
    placed = profile_clock(file, profile).place(axis, origin)
    table.require(column, si, *units[1:])
    times, values = placed.x, table.curve(column)
    if profile.interpolation == "spline" and times.size < MIN_SPLINE_ROWS:
        raise InputError(file, "", f"{times.size} rows; a spline needs {MIN_SPLINE_ROWS}")
    steep = kind == "value" and profile.interpolation != "spline"  # a control, which may jump
    if not steep and (k := find_jump(times, values)) is not None:
        raise InputError(
            file,
            table.line(k + 1),
            f"{column.column} jumps from {values[k]:.6g} to {values[k + 1]:.6g} {si} in "
            f"{times[k + 1] - times[k]:.3g} s: no drive has the "
            f"{'rate' if kind == 'value' else 'acceleration'} that this asks for; record the way "
            "from one to the other in several rows",
        )
    pieces, words = make_pieces(times, values, profile, start, si)
    return SampledProfile(
        piece_times(times, profile),
        pieces,
        file.name,
        "; ".join(
            filter(None, (f"{kind} of {file.name}, {times.size} rows, {words}", placed.words))
        ),
    )


def find_jump(times: Array, values: Array) -> int | None:
    """Find the row after which a curve jumps: it is much steeper there than before and after.

    A single row that is far off its neighbours is a jump as well.

    >>> t = np.linspace(0.0, 1.0, 21)
    >>> find_jump(t, np.sin(t)), find_jump(t, np.sin(t) + (t > 0.52)), find_jump(t, t + (t == t[7]))
    (None, 10, 6)
    """
    if times.size < MIN_ROWS:  # a few rows may be the intended corners of a motion
        return None
    slopes = np.diff(values) / np.diff(times)
    sides = np.pad(np.abs(slopes), 2)
    before, steep, after, next_but_one = sides[1:-3], sides[2:-2], sides[3:-1], sides[4:]
    alone = steep > JUMP_STEEPNESS * np.maximum(before, after)
    back = np.append(slopes[:-1] * slopes[1:] < 0, False)
    outlier = back & (np.minimum(steep, after) > JUMP_STEEPNESS * np.maximum(before, next_but_one))
    large = np.abs(np.diff(values)) > SMALLEST_JUMP * float(np.ptp(values))
    found = np.flatnonzero(large & (alone | outlier))
    return int(found[0]) if found.size else None


def make_pieces(
    times: Array, values: Array, profile: ProfileTable, start: float, si: str
) -> tuple[Array, str]:
    """Make the polynomials of the value, and words that say how they were made."""
    kind, _ = profile.given
    if profile.interpolation == "held":
        return values[None], "held from row to row"
    if profile.interpolation == "linear" and kind == "value":
        return np.array([np.diff(values) / np.diff(times), values[:-1]]), (
            "straight from row to row"
        )
    if profile.interpolation == "linear":
        steps = np.diff(times)
        slopes = np.diff(values) / steps
        way = np.append(0.0, np.cumsum(0.5 * (values[:-1] + values[1:]) * steps))
        stair = float(np.abs(np.diff(slopes)).max(initial=0.0))
        return np.array([0.5 * slopes, values[:-1], start + way[:-1]]), (
            "straight from row to row and integrated exactly: the value is quadratic, the "
            f"acceleration a stair with steps up to {stair:.2g} {si}^2"
        )
    from scipy.interpolate import CubicSpline  # slow to load

    spline = CubicSpline(times, values)
    off = float(interval_errors(times, values).max()) if times.size >= MIN_ROWS else np.nan
    known = "" if np.isnan(off) else f"; between rows it may be off by {off:.2g} {si}"
    if kind == "value":
        return np.asarray(spline.c), (
            f"a cubic spline, of which rate and acceleration are the derivatives{known}"
        )
    whole = np.array(spline.antiderivative().c)
    whole[-1] += start
    return whole, f"a cubic spline, integrated exactly{known}"


CONTROLS_SOURCE = '''\
def controls(t):
    """Controls (loads, n) of the actuators whose controls change, at times (n,) [s]."""
    return np.array([
{rows}    ])'''
PIECEWISE_SOURCE = '''\
def piecewise(t, times, pieces):
    """Polynomials of the time since the last of some times, the highest power first."""
    k = np.clip(np.searchsorted(times, t, "right") - 1, 0, len(times) - 2)
    s, found = t - np.array(times)[k], 0.0
    for row in pieces:
        found = found * s + np.array(row)[k]
    return found


'''


def controls_source(profiles: Sequence[object], x: Array) -> str:
    """Write ``controls(t)``: controls (loads, n) of changing loads at times (n,).

    The source uses NumPy as ``np``.  Rows are joined as in the profile, by straight lines or by
    polynomials; any other profile that is not a formula is written as a table, see
    `proofmass.case.drive.motion_source`.

    Parameters
    ----------
    profiles : sequence of callable
        See `proofmass.sim.protocol.run.ChangingLoad`.
    x : ndarray (n,)
        Times of the samples [s].

    Examples
    --------
    >>> from proofmass.case.drive import InProportion, Steady
    >>> print(controls_source([InProportion(Steady(0.0, 2.0, True), 0.0, 0.5, 1.0)], np.zeros(2)))
    def controls(t):
        \"\"\"Controls (loads, n) of the actuators whose controls change, at times (n,) [s].\"\"\"
        return np.array([
            1.0 + 0.5 * (0.0 + 2.0 * t - 0.0),
        ])
    """
    if not profiles:
        return ""
    rows = [control_source(profile, x) for profile in profiles]
    text = CONTROLS_SOURCE.format(rows="".join(f"        {row},\n" for row in rows))
    return (PIECEWISE_SOURCE if any(row.startswith("piecewise(") for row in rows) else "") + text


def control_source(profile: object, x: Array) -> str:
    """A profile as a Python expression of t."""
    if found := profile_formula(profile):
        return found[0]
    if isinstance(profile, SampledProfile):
        times, pieces = profile.times, profile.pieces
    else:
        times = table_times([profile], x)
        value, rate, bend = np.broadcast_arrays(*profile(times))  # type: ignore[operator]
        pieces = quintic_spline(times, value, rate, bend).c
    if len(pieces) == 2:
        last = profile(times[-1:])[0]  # type: ignore[operator]
        return (
            f"np.interp(t, {indent_numbers(times)}, {indent_numbers(np.append(pieces[1], last))})"
        )
    return f"piecewise(t, {indent_numbers(times)}, [{', '.join(map(indent_numbers, pieces))}])"


def indent_numbers(values: Array) -> str:
    """Write numbers as an indented list."""
    return format_numbers(values).replace("\n", "\n        ")
