"""Values at half steps as functions of the time."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from .mechanism import DriveRows, PlainArray

LINE_SHARE = 1e-13
"""Deviation from a line, as a share of the largest value, that is rounding."""


def line_of(table: PlainArray) -> tuple[float, float] | None:
    """Value at the start, and change from entry to entry, of a table that is a line, or None.

    >>> line_of(np.array([1.0, 3.0, 5.0])), line_of(np.array([7.0])), line_of(np.arange(3.0) ** 2)
    ((1.0, 2.0), (7.0, 0.0), None)
    """
    if table.size == 1:
        return float(table[0]), 0.0
    line, slope = np.linspace(table[0], table[-1], table.size, retstep=True)
    straight = np.abs(line - table).max() <= LINE_SHARE * np.abs(table).max()
    return (float(table[0]), float(slope)) if straight else None


def values_beyond(drive: DriveRows, half: float, more: int) -> PlainArray:
    """The values of a drive with `more` entries before and behind, for a spline without ends.

    There the drive goes on with the acceleration and its change at the end of the table.

    Parameters
    ----------
    drive : DriveRows
    half : float
        Half a time step [s].
    more : int
    """
    beside, parts, a = half * np.arange(1, more + 1), [], drive.acceleration
    for end, jump, dt in ((0, a[1] - a[0], -beside[::-1]), (-1, a[-1] - a[-2], beside)):
        second = a[end] / 2.0 + dt * jump / half / 6.0
        parts.append(drive.value[end] + dt * (drive.rate[end] + dt * second))
    return np.concatenate([parts[0], drive.value, parts[1]])


def in_time(
    step: float, *rows: PlainArray, factor: Any = 1.0, before: int = 0
) -> Callable[..., Any]:
    """A function of the time from values at half steps, or from a single value.

    Parameters
    ----------
    step : float
        Time step [s].
    rows : ndarray (1,) or (2 steps + 1,)
        Value, derivative, second derivative over 2, and so on.
    factor : number or ndarray
        Factor of the value.
    before : int
        Number of arguments of the function before the time; it ignores these and those behind it.

    Returns
    -------
    callable
        ``value(t)``, the Taylor polynomial about the half step that is next to a time.

    Examples
    --------
    >>> square = in_time(0.2, np.array([0.0, 0.01, 0.04]), np.array([0.0, 0.2, 0.4]))
    >>> round(square(0.1), 6), round(square(0.11), 6)
    (0.01, 0.012)
    """
    half, most = 0.5 * step, rows[0].size - 1

    def value(*given: Any) -> Any:
        t = given[before]
        i = min(round(t / half), most)
        return factor * sum(float(row[i]) * (t - half * i) ** n for n, row in enumerate(rows))

    return value
