"""Columns of numbers from anywhere: `Curves`, mappings, data frames, CSV files.

Each is checked and has a unit; an error names it.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias, cast

import numpy as np

from proofmass.base.arrays import Array
from proofmass.base.errors import InputError, suggest_names
from proofmass.base.recorded import find_wrap, is_number, read_table, split_header
from proofmass.base.units import same_quantity, si_unit, to_si
from proofmass.sim.protocol.curves import Curves

GIVEN = Path("judge")
"""What messages name in place of a file."""
X_NAMES = "time", "t"
"""Names of the column of x, if none is named."""
ColumnSource: TypeAlias = "Curves | Mapping[str, Any] | Any"
"""`Curves`, a mapping of names to arrays, a data frame, or the path of a CSV file."""


@dataclass(frozen=True)
class GivenColumn:
    """A column: its name, its unit, and its values as they were given."""

    name: str
    unit: str
    values: Array

    @property
    def in_si(self) -> Array:
        """The values in SI."""
        return np.asarray(to_si(cast(Any, self.values), self.unit))


def read_columns(
    curves: ColumnSource, units: Mapping[str, str], x: str | None
) -> dict[str, GivenColumn]:
    """The columns of what was given, by name; that of x is called ``time``.

    Raises
    ------
    InputError
        See `judge`.
    """
    arrays, index = named_arrays(curves)
    found: dict[str, GivenColumn] = {}
    for header, values in arrays.items():
        name, unit = (header, "") if header in units else split_header(header)
        found[name] = read_column(name, values, units.get(name) or unit or "1")
    if unknown := [name for name in units if name not in found]:
        raise missing_column(f"units.{unknown[0]}", unknown[0], found)
    if x is None:
        x = next((name for name in X_NAMES if name in found), None)
        if x is None and index is not None:
            found[X_NAMES[0]] = read_column(X_NAMES[0], index, "1")
            x = X_NAMES[0]
    if x is None or x not in found:
        raise missing_column("x", x or X_NAMES[0], found)
    time = found.pop(x)
    if time.unit != "1" and not same_quantity(time.unit, "s"):
        raise InputError(GIVEN, x, f"its unit is {time.unit!r}, and it must be a time, such as s")
    for column in found.values():
        if column.values.shape != time.values.shape:
            raise InputError(
                GIVEN,
                column.name,
                f"it has {column.values.size} values, and {x} has {time.values.size}",
            )
    return {**found, X_NAMES[0]: time}


def named_arrays(curves: ColumnSource) -> tuple[dict[str, Any], Any]:
    """The arrays of what was given, by name, and the index of a data frame, if it is one."""
    if isinstance(curves, Curves):
        return {X_NAMES[0]: curves.x, **curves.channels}, None
    if isinstance(curves, Mapping):
        return {str(name): values for name, values in curves.items()}, None
    if isinstance(curves, Path | str):
        return csv_arrays(Path(curves)), None
    names = getattr(curves, "columns", None)
    if isinstance(names, Iterable):  # a data frame of pandas or polars; neither is loaded here
        arrays = {str(name): np.asarray(curves[name]) for name in names}
        return arrays, getattr(curves, "index", None)
    raise TypeError(
        f"{type(curves).__name__} has no curves; give Curves, a mapping of names to arrays, a data "
        "frame, or the path of a CSV file"
    )


def csv_arrays(file: Path) -> dict[str, Array]:
    """The columns of a CSV file by their headers; columns of words are left out.

    Raises
    ------
    InputError
        See `read_table`; also for a cell that is no finite number, with its line.
    """
    table = read_table(file)
    _, first = table.rows[0]
    return {
        f"{name} [{unit}]" if unit else name: table.values(name)
        for (name, unit), cell in zip(table.units.items(), first, strict=True)
        if is_number(cell)
    }


def read_column(name: str, values: Any, unit: str) -> GivenColumn:
    """A column of finite numbers.

    Raises
    ------
    InputError
        It is none.
    """
    try:
        si_unit(unit)
        found = np.asarray(values, float)
    except (TypeError, ValueError) as error:
        raise InputError(GIVEN, name, " ".join(str(error).split())) from None
    if found.ndim != 1:
        raise InputError(GIVEN, name, f"it must be an array (n,), and has the shape {found.shape}")
    if found.size < 2:
        raise InputError(GIVEN, name, f"it has {found.size} values; give two or more")
    if (bad := np.flatnonzero(~np.isfinite(found))).size:
        raise InputError(GIVEN, name, f"value {bad[0]} is {found[bad[0]]}, no finite number")
    name_si, factor = si_unit(unit)
    k = find_wrap(found, 2 * np.pi / factor) if name_si == "rad" else None
    if k is not None:
        raise InputError(
            GIVEN,
            name,
            f"it jumps from {found[k]:.6g} to {found[k + 1]:.6g} {unit}: the angle is wrapped; "
            "unwrap it, as numpy.unwrap does",
        )
    return GivenColumn(name, unit, found)


def require_rising(time: GivenColumn) -> None:
    """Raise `InputError` unless times rise."""
    falls = np.flatnonzero(np.diff(time.values) <= 0)
    if falls.size:
        k = int(falls[0])
        raise InputError(
            GIVEN,
            time.name,
            f"it does not rise: {time.values[k]:.6g} then {time.values[k + 1]:.6g}, values {k} and "
            f"{k + 1}",
        )


def missing_column(key: str, name: str, there: Mapping[str, GivenColumn]) -> InputError:
    """The error of a column that is not there."""
    return InputError(GIVEN, key, f"there is no column {name!r}; {suggest_names(name, there)}")
