"""The motion profiles of a run's drives, and the profiles of the controls of its loads."""

import inspect

import numpy as np

from proofmass.base.arrays import Array
from proofmass.base.errors import suggest_names
from proofmass.base.recording import Recorded
from proofmass.base.strict import Kind
from proofmass.case.case import Case, ProfileTable
from proofmass.case.drive import FunctionProfile, InProportion, Samples, Steady, Swing
from proofmass.case.profile import SampledProfile
from proofmass.reference.find import load_reference
from proofmass.reference.path import path_profiles
from proofmass.reference.recorded_rows import recorded_column
from proofmass.reference.samples import (
    CONTROL_UNITS,
    reference_rows,
    run_samples,
    sampled_drive_profile,
    sampled_profile,
)

DriveProfile = InProportion | FunctionProfile | SampledProfile | Samples | Steady | Swing
DRIVE_PREFIX, DRIVE_PARTS = "drive.", ("", ".rate", ".acceleration")
"""Names of the prescribed motion of drives: ``drive.crank``, ``drive.crank.rate``, ..."""


def drive_profiles(case: Case, kind: Kind) -> tuple[DriveProfile, ...]:
    """The motion profiles of a run, one for each drive; none for a free motion."""
    return tuple(drive_profile(case, kind, k) for k in range(len(case.drive)))


def drive_profile(case: Case, kind: Kind, k: int) -> DriveProfile:
    """The motion profile of drive number k."""
    drive, reference, leader = case.drive[k], load_reference(case), case.drive[0]
    if kind == "equilibrium":
        return Steady(drive.start, 0.0, x_is_time=True)
    if case.path_table and drive.profile in (None, case.path_table):
        return path_profiles(case, kind, load_profiles(case, kind))[k]
    if isinstance(drive.profile, ProfileTable):
        return sampled_drive_profile(case, kind, k)
    if drive.profile is not None or drive.to is None:
        if isinstance(reference, Recorded):
            key = case.drive_key(k, "profile")
            return Samples(
                reference_rows(case, kind).x,
                *(recorded_column(case, reference, key, str(c)) for c in drive.profile or ()),
            )
        shared = drive.profile is None or (
            k == 0 and any(d.profile is None for d in case.drive[1:])
        )
        teller = leader if drive.profile is None else drive
        k_of_teller = case.drive.index(teller)
        own = {one.__name__: one for one in reference.profiles}
        function = own.get(str(teller.profile))
        if function is None:
            raise case.error(
                case.drive_key(k_of_teller, "profile"),
                f"reference {case.reference} has no motion profile {teller.profile!r}; "
                f"{suggest_names(str(teller.profile), own)}",
            )
        takes = list(inspect.signature(function).parameters.values())[1:]
        names = [p.name for p in takes]
        for name in teller.parameters:
            if name not in names and not any(p.kind is p.VAR_KEYWORD for p in takes):
                raise case.error(
                    case.drive_key(k_of_teller, f"parameters.{name}"),
                    f"{teller.profile}() has no such parameter; "
                    f"{suggest_names(name, names, 'known')}",
                )
        return FunctionProfile(function, dict(teller.parameters), k if shared else None)
    if k:
        ratio = drive.way / leader.way
        return InProportion(drive_profile(case, kind, 0), leader.start, ratio, drive.start)
    if drive.period:
        return Swing(drive.start, drive.to, drive.period)
    return Steady(drive.start, drive.speed, x_is_time=kind == "dynamics")


def load_profiles(case: Case, kind: Kind) -> tuple[DriveProfile, ...]:
    """The profiles of the controls of a run's changing loads, one for each load."""
    return tuple(load_profile(case, kind, k) for k in range(len(case.load)))


def load_profile(case: Case, kind: Kind, k: int) -> DriveProfile:
    """The profile of the control of load number k."""
    load = case.load[k]
    if load.profile is not None:
        return sampled_profile(
            case, kind, case.load_key(k, "profile"), load.profile, 0.0, *CONTROL_UNITS
        )
    way, leader = float(load.to or 0.0) - load.start, case.drive[0]
    if leader.to is not None:
        ratio = way / (leader.to - leader.start)
        return InProportion(drive_profile(case, kind, 0), leader.start, ratio, load.start)
    first, last = run_samples(case, kind)[[0, -1]].tolist()
    rate = way / (last - first)
    return Steady(load.start - rate * first, rate, x_is_time=True)


def control_profiles(case: Case, kind: Kind) -> dict[str, DriveProfile]:
    """The profiles of `load_profiles`, by the names of the actuators."""
    names = (load.actuator for load in case.load)
    return dict(zip(names, load_profiles(case, kind), strict=True))


def control_values(case: Case, kind: Kind, x: Array, derivative: int) -> dict[str, Array]:
    """Return a derivative of the controls of the actuators with loads, by actuator."""
    at = np.asarray(x, float)
    return {name: one(at)[derivative] for name, one in control_profiles(case, kind).items()}


def prescribed_quantities(case: Case, kind: Kind, x: Array) -> dict[str, Array]:
    """The prescribed motion of drives: ``drive.JOINT``, ``drive.JOINT.rate``, ``.acceleration``.

    A channel that equals one of them is compared with the motion profile, and not with the motion
    that the drive really had.
    """
    return {
        f"{DRIVE_PREFIX}{drive.joint}{part}": np.broadcast_to(values, np.shape(x))
        for drive, profile in zip(case.drive, drive_profiles(case, kind), strict=True)
        for part, values in zip(DRIVE_PARTS, profile(np.asarray(x, float)), strict=True)
    }
