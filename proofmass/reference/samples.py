"""The samples of a run: the x at which its curves are wanted, and its place on recorded rows.

The x of a run is time, the value of the first drive, or the length along a rod.  The files that
drives and loads follow, and the rows of a recorded reference, are placed on it.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from proofmass.base.arrays import Array
from proofmass.base.read_once import read_once
from proofmass.base.recorded import RecordedColumn, read_table
from proofmass.base.recording import PlacedRows, Recorded, Recording, RunAxis, SteadyDrive
from proofmass.base.strict import Kind
from proofmass.case.case import Case, PathTable, ProfileTable
from proofmass.case.path import path_clock, path_times
from proofmass.case.profile import SampledProfile, make_sampled_profile, profile_clock
from proofmass.reference.case_model import compiled_model
from proofmass.reference.find import load_reference
from proofmass.sim.contents import joints

place_once = read_once(None)(Recording.place)
CONTROL_UNITS = "1", "N", "N m", "m", "rad", "m/s", "rad/s"
"""SI units that the control of a motor or of a servo may have."""


def run_samples(case: Case, kind: Kind) -> Array:
    """The samples x (n,) of a run: times [s], drive values, or arc lengths [m] in equilibrium."""
    run, leader = case.run[kind], case.leader
    if case.recorded:
        return reference_rows(case, kind).samples(kind)
    n = run.n or 0
    if kind == "equilibrium":
        return np.linspace(0.0, run.until or min(rod.length for rod in case.rods), n)
    if leader is None or not leader.steady:
        end = run.until or (leader.until or leader.period if leader else None)
        if end is None and leader and isinstance(leader.profile, ProfileTable):
            end = float(sampled_drive_profile(case, kind, 0).times[-1])
        if end is None and case.path_table:
            end = float(path_row_times(case, kind)[-1])
        return np.linspace(0.0, end or 0.0, n)
    first, last = leader.start, float(leader.to or 0.0)
    if kind == "sweep":
        return np.linspace(first, last, n)
    return np.linspace(0.0, (last - first) / leader.speed, n)


def steady_drive(case: Case) -> SteadyDrive | None:
    """The first drive, if it has a constant rate."""
    leader = case.leader
    if leader is None or not leader.steady:
        return None
    unit = joints(compiled_model(case)).get(leader.joint) or "rad"
    return SteadyDrive(unit, leader.start, leader.speed)


def time_axis(case: Case, kind: Kind) -> RunAxis:
    """A run in time, also where the x of the run is the value of a drive."""
    leader, steady = case.leader, steady_drive(case)
    duration = case.run[kind].until or (leader.until if leader else None)
    if leader and steady:
        duration = leader.way / steady.rate
    return RunAxis(kind, "s", steady, duration)


def run_axis(case: Case, kind: Kind) -> RunAxis:
    """The x of a run."""
    if kind == "equilibrium":
        return RunAxis(kind, "m")
    axis = time_axis(case, kind)
    if kind == "sweep" and axis.steady:
        return replace(axis, unit=axis.steady.unit)
    return axis


def shared_origin(case: Case, kind: Kind) -> float | None:
    """The time at which a run begins on the clock of the files that drives and loads follow [s].

    All files of a case that are over time have one clock: that of the first of these files.  None
    if no drive and no load follows a file over time.
    """
    for key, profile in case.sampled_profiles:
        if profile.file is not None and (key, profile) not in loads_at_path_rows(case):
            file = case.file.parent / profile.file
            read = path_clock if isinstance(profile, PathTable) else profile_clock
            clock = read_profile(case, key, read, file, profile)
            if clock is not None and clock.unit == "s":
                return float(clock.clock_origin(time_axis(case, kind)))
    return None


def loads_at_path_rows(case: Case) -> tuple[tuple[str, ProfileTable], ...]:
    """The profiles of loads at the rows of the path, with their keys.

    They name the file of the path and no time, which the rows of that file may not have.
    """
    path = case.path_table
    if path is None:
        return ()
    return tuple(
        (case.load_key(k, "profile"), one.profile)
        for k, one in enumerate(case.load)
        if one.profile and one.profile.file == path.file and one.profile.time is None
    )


def path_row_times(case: Case, kind: Kind) -> Array:
    """Times (m,) of the rows of the path of a case, on the x of a run [s]."""
    path, leader = case.path_table, case.leader
    assert path is not None
    assert leader is not None
    found: Array = read_profile(
        case,
        case.drive_key(0, "profile"),
        path_times,
        *(case.file.parent / path.file, path),
        *(time_axis(case, kind), shared_origin(case, kind), leader.until),
    )
    return found


def profile_at_path_rows(case: Case, kind: Kind, profile: ProfileTable) -> ProfileTable:
    """The profile of a load with its column read at the rows of the path, as lists of numbers."""
    assert profile.file is not None
    table = read_table(case.file.parent / profile.file)
    kind_of_column, column = profile.given
    assert isinstance(column, RecordedColumn)
    table.require(column, *CONTROL_UNITS)
    values = tuple(table.curve(column).tolist())
    rows = {"time": tuple(path_row_times(case, kind).tolist()), kind_of_column: values}
    return ProfileTable.model_validate({**rows, "interpolation": profile.interpolation})


def reference_rows(case: Case, kind: Kind) -> PlacedRows:
    """The rows of a recorded reference on the x of a run.

    In a sweep whose first drive has columns of the reference any x serves, since each row has the
    state of the drives.
    """
    reference = load_reference(case)
    assert isinstance(reference, Recorded)
    axis = run_axis(case, kind)
    if kind == "sweep" and case.leader and isinstance(case.leader.profile, tuple):
        axis = replace(axis, unit=reference.recording.unit)
    placed: PlacedRows = place_once(reference.recording, axis, shared_origin(case, kind))
    return placed


def sampled_drive_profile(case: Case, kind: Kind, k: int) -> SampledProfile:
    """The motion profile of drive number k, which follows the rows of a file."""
    drive = case.drive[k]
    assert isinstance(drive.profile, ProfileTable)
    unit = joints(compiled_model(case)).get(drive.joint) or "rad"
    return sampled_profile(
        case, kind, case.drive_key(k, "profile"), drive.profile, drive.start, unit
    )


def sampled_profile(
    case: Case, kind: Kind, key: str, profile: ProfileTable, start: float, *units: str
) -> SampledProfile:
    """The profile at a key of the sidecar that follows rows, over the x of a run.

    `start` and `units` are those of `make_sampled_profile`.
    """
    axis, origin = time_axis(case, kind), shared_origin(case, kind)
    given = profile
    if (key, profile) in loads_at_path_rows(case):
        profile = read_profile(case, key, profile_at_path_rows, case, kind, profile)
    found: SampledProfile = read_profile(
        case,
        key,
        partial(make_sampled_profile, axis=axis, origin=origin),
        *(case.file.parent, profile, start, *units),
    )
    if profile is not given:
        joined = found.words.removeprefix(profile.words)
        words = f"{given.words} at the rows of the path{joined}"
        found = replace(found, file=str(given.file), words=words)
    if kind == "sweep" and axis.steady:
        return replace(found, start=axis.steady.start, rate=axis.steady.rate)
    return found


def read_profile(case: Case, key: str, read: Callable[..., Any], *args: object) -> Any:
    """Call a function that reads a profile; its ValueError becomes bad input at a key.

    Raises
    ------
    InputError
        A column of the profile is wrong.
    """
    try:
        return read(*args)
    except ValueError as error:
        raise case.error(key, str(error)) from None
