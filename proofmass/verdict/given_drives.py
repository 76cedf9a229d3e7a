"""The motion of drives as given columns, numbers or arrays; what is not given is not made up."""

from collections.abc import Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np

from proofmass.base.arrays import Array
from proofmass.base.errors import InputError
from proofmass.case.drive import DriveState
from proofmass.verdict.given_columns import GIVEN, GivenColumn, missing_column, read_column

DRIVE_PART_NAMES = "value", "rate", "acceleration"
DriveParts: TypeAlias = Mapping[str, Sequence["Array | None"]]
"""Value, rate and acceleration of each drive by its joint; None for a part that is not given."""
DriveColumn: TypeAlias = "str | float | Sequence[float] | Array"
"""The name of a column, a number for a constant, or an array."""


def led_columns(drive: Any) -> set[str]:
    """The names of the columns with the motion of drives, which are not judged by themselves."""
    if isinstance(drive, str):
        return {drive}
    parts = drive.values() if isinstance(drive, Mapping) else drive
    if isinstance(parts, (list, tuple)) or isinstance(drive, Mapping):
        return set().union(*map(led_columns, parts))
    return set()


def read_drives(
    drive: Any, columns: Mapping[str, GivenColumn], time: GivenColumn
) -> dict[str, list[Array | None]]:
    """Value, rate and acceleration of each drive by its joint; None for a part not given [SI]."""
    if drive is None:
        return {}
    if isinstance(drive, Mapping):
        each = dict(drive)
    else:
        several = drive if isinstance(drive, list) else [drive]
        each = {f"drive {k}" if several[1:] else "drive": one for k, one in enumerate(several)}
    found: dict[str, list[Array | None]] = {}
    for joint, one in each.items():
        parts = one if isinstance(one, tuple) else (one,)
        if not 1 <= len(parts) <= len(DRIVE_PART_NAMES):
            raise InputError(GIVEN, f"drive.{joint}", "give (value, rate, acceleration)")
        keys = DRIVE_PART_NAMES[: len(parts)]
        known = [
            read_drive_part(f"drive.{joint}.{key}", part, columns, time)
            for key, part in zip(keys, parts, strict=True)
        ]
        found[joint] = [*known, *[None] * (len(DRIVE_PART_NAMES) - len(known))]
    return found


def read_drive_part(
    key: str, part: DriveColumn, columns: Mapping[str, GivenColumn], time: GivenColumn
) -> Array:
    """A part of the motion of a drive at all times [SI]."""
    if isinstance(part, str):
        if part not in columns:
            raise missing_column(key, part, columns)
        return columns[part].in_si
    if np.ndim(part) == 0:
        part = np.full(time.values.shape, part, float)
    found = read_column(key, part, "1").values
    if found.shape != time.values.shape:
        raise InputError(
            GIVEN, key, f"it has {found.size} values, and there are {time.values.size} times"
        )
    return found


def state_of(drives: DriveParts, time: GivenColumn, missing: float = 0.0) -> DriveState | None:
    """The motion of the drives, with a number in the place of parts that are not given."""
    if not drives:
        return None
    gap = np.full(time.values.shape, missing)
    value, rate, acceleration = (
        np.array([gap if parts[k] is None else parts[k] for parts in drives.values()])
        for k in range(len(DRIVE_PART_NAMES))
    )
    return value, rate, acceleration


def drive_tables(drives: DriveParts, times: Array) -> tuple[dict[str, Any], ...]:
    """The tables of drives that follow the given values, for references that read a model."""
    return tuple(
        {"joint": joint, "profile": {"time": times.tolist(), "value": parts[0].tolist()}}
        for joint, parts in drives.items()
        if parts[0] is not None
    )
