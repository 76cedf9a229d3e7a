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
from proofmass.base.recording import PlacedRows, Recorded, Recording, RunAxis, SteadyDrive
from proofmass.base.strict import Kind
from proofmass.case.case import Case, ProfileTable
from proofmass.case.profile import SampledProfile, make_sampled_profile, profile_clock
from proofmass.reference.case_model import compiled_model
from proofmass.reference.find import load_reference
from proofmass.sim.contents import joints

place_once = read_once(None)(Recording.place)


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
        if profile.file is not None:
            file = case.file.parent / profile.file
            clock = read_profile(case, key, profile_clock, file, profile)
            if clock.unit == "s":
                return float(clock.clock_origin(time_axis(case, kind)))
    return None


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
    found: SampledProfile = read_profile(
        case,
        key,
        partial(make_sampled_profile, axis=axis, origin=origin),
        *(case.file.parent, profile, start, *units),
    )
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
