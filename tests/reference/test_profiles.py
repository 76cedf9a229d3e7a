"""The motion profiles of drives and loads.

Most references are stubs.
"""

import numpy as np
import pytest

from proofmass.case.case import LoadTable
from proofmass.case.drive import Samples
from proofmass.reference import profiles
from proofmass.reference.profiles import drive_profile, drive_profiles, load_profiles
from tests.reference.stubs import (
    FOURBAR,
    PENDULUM,
    RECORDED,
    X,
    error_of,
    use_recorded_curve,
    use_reference,
    with_drives,
    with_tables,
)


def test_a_load_changes_uniformly_from_the_first_time_to_the_last(monkeypatch):
    """The drive follows a profile, so that the load cannot go in proportion to its way."""
    load = LoadTable(actuator="push", **{"from": 2.0}, to=5.0)
    drive = FOURBAR.drive[0].model_copy(update={"to": None})
    times = np.array([1.0, 2.0, 3.0])
    monkeypatch.setattr(profiles, "run_samples", lambda *_: times)
    (profile,) = load_profiles(with_tables(FOURBAR, load=(load,), drive=(drive,)), "dynamics")
    value, rate, acceleration = profile(times)
    assert value.tolist() == [2.0, 3.5, 5.0]
    assert (set(rate), set(acceleration)) == ({1.5}, {0.0})


def drive_motion(case, kind, k=0):
    """The values, the rates and the accelerations of drive k at `X`."""
    return [np.broadcast_to(part, X.shape).tolist() for part in drive_profile(case, kind, k)(X)]


def test_all_drives_keep_their_start_values_in_an_equilibrium():
    case = with_drives({"from": 0.5, "to": 2.0, "rate": 3.0}, {"from": -1.0, "to": 4.0})
    assert drive_motion(case, "equilibrium") == [[0.5] * 3, [0.0] * 3, [0.0] * 3]
    assert drive_motion(case, "equilibrium", 1) == [[-1.0] * 3, [0.0] * 3, [0.0] * 3]


def test_a_steady_drive_follows_time_in_dynamics_and_is_x_in_a_sweep():
    case = with_drives({"from": 0.5, "to": 2.0, "rate": 3.0})
    assert drive_motion(case, "dynamics") == [[0.5, 1.25, 3.5], [3.0] * 3, [0.0] * 3]
    assert drive_motion(case, "sweep") == [[0.0, 0.25, 1.0], [3.0] * 3, [0.0] * 3]
    assert drive_profile(with_drives({"to": 2.0}), "dynamics", 0)(X)[1].tolist() == [1.0] * 3, (
        "the default rate is 1"
    )


def test_a_second_drive_is_proportional_to_the_first():
    """The second drive goes from 1 to 4 while the first goes from -2 to 0: 1.5 times as fast."""
    case = with_drives({"from": -2.0, "to": 0.0, "rate": 2.0}, {"from": 1.0, "to": 4.0})
    assert drive_motion(case, "dynamics", 1) == [[1.0, 1.75, 4.0], [3.0] * 3, [0.0] * 3]
    assert drive_motion(case, "sweep", 1) == [
        [4.0, 4.375, 5.5],
        [3.0] * 3,
        [0.0] * 3,
    ]  # drive 0 is at X
    both = drive_profiles(case, "dynamics")
    assert [float(one(X)[0][-1]) for one in both] == [0.0, 4.0]
    assert [float(one(X)[0][-1]) for one in drive_profiles(case, "sweep")] == [1.0, 5.5]
    assert drive_profiles(PENDULUM, "dynamics") == ()


def test_a_second_drive_oscillates_with_the_first():
    case = with_drives({"from": 0.0, "to": 2.0, "period": 2.0}, {"from": 1.0, "to": 0.0})
    assert np.array(drive_motion(case, "sweep")[0]) == pytest.approx([0.0, 1 - np.sqrt(0.5), 2.0])
    assert np.array(drive_motion(case, "sweep", 1)[0]) == pytest.approx(
        [1.0, 0.5 + np.sqrt(0.125), 0.0]
    )


def test_drives_of_a_recorded_curve_follow_its_columns(monkeypatch):
    use_recorded_curve(
        monkeypatch, a=("rad", 1, 2, 3), b=("rad/s", 4, 5, 6), c=("rad/s^2", 7, 8, 9)
    )
    case = with_drives({"profile": ("a", "b", "c")}, case=RECORDED)
    found = drive_profile(case, "sweep", 0)
    assert isinstance(found, Samples)
    assert [part.tolist() for part in found(X)] == [[1, 2, 3], [4, 5, 6], [7, 8, 9]]


def test_a_missing_column_of_a_drive_is_reported_at_its_key(monkeypatch):
    use_recorded_curve(monkeypatch, a=("rad", 1, 2, 3))
    case = with_drives({"profile": ("a", "a", "a")}, {"profile": ("a", "a", "aa")}, case=RECORDED)
    words = "no column 'aa' in hacksaw_recorded.csv; did you mean 'a'? there are: t, a"
    assert error_of(drive_profile, case, "sweep", 1) == (RECORDED.file, "drive.1.profile", words)
    assert error_of(drive_profile, with_tables(case, drive=case.drive[1:]), "sweep", 0) == (
        RECORDED.file,
        "drive.profile",
        words,
    )


def ramp(t, *, rate=1.0, other=0.0):
    """A motion profile of one drive."""
    return rate * t, rate + 0 * t, other + 0 * t


def fan(t, rate):
    """A motion profile of two drives, the second of which is twice as fast."""
    return tuple(np.array([part, 2 * part]) for part in ramp(t, rate=rate))


def freely(t, **rates):
    """A motion profile that takes any parameters."""
    return ramp(t, rate=sum(rates.values()))


RAMP_PROFILE = {"profile": "ramp", "until": 1.0, "parameters": {"rate": 2.0}}


def test_a_motion_profile_is_a_function_that_the_reference_names(monkeypatch):
    use_reference(monkeypatch, profiles=(ramp, fan, freely))
    assert drive_motion(with_drives(RAMP_PROFILE), "dynamics") == [
        [0.0, 0.5, 2.0],
        [2.0] * 3,
        [0.0] * 3,
    ]
    own = with_drives(RAMP_PROFILE, {"profile": "freely", "parameters": {"one": 1.0, "two": 2.0}})
    assert drive_motion(own, "sweep")[0] == [0.0, 0.5, 2.0]
    assert drive_motion(own, "sweep", 1)[0] == [0.0, 0.75, 3.0], "a drive with a profile of its own"
    shared = with_drives({**RAMP_PROFILE, "profile": "fan"}, {})
    assert [drive_motion(shared, "sweep", k)[0] for k in (0, 1)] == [
        [0.0, 0.5, 2.0],
        [0.0, 1.0, 4.0],
    ]


def test_a_missing_motion_profile_is_reported_at_its_key(monkeypatch):
    use_reference(monkeypatch, profiles=(ramp,))
    words = "reference fourbar has no motion profile 'rump'; did you mean 'ramp'? there are: ramp"
    assert error_of(
        drive_profile, with_drives({**RAMP_PROFILE, "profile": "rump"}), "sweep", 0
    ) == (
        FOURBAR.file,
        "drive.profile",
        words,
    )
    assert error_of(drive_profile, with_drives(RAMP_PROFILE, {"profile": "rump"}), "sweep", 1) == (
        FOURBAR.file,
        "drive.1.profile",
        words,
    )
    assert error_of(
        drive_profile, with_drives({**RAMP_PROFILE, "profile": "rump"}, {}), "sweep", 1
    ) == (
        FOURBAR.file,
        "drive.0.profile",
        words,
    ), "the second drive follows a row of the first drive's profile"


def test_an_unknown_parameter_of_a_motion_profile_is_reported(monkeypatch):
    use_reference(monkeypatch, profiles=(ramp,))
    words = "ramp() has no such parameter; did you mean 'rate'? known: rate, other"
    bad = {**RAMP_PROFILE, "parameters": {"rte": 2.0}}
    assert error_of(drive_profile, with_drives(bad), "sweep", 0) == (
        FOURBAR.file,
        "drive.parameters.rte",
        words,
    )
    assert error_of(
        drive_profile, with_drives(RAMP_PROFILE, bad | {"until": None}), "sweep", 1
    ) == (
        FOURBAR.file,
        "drive.1.parameters.rte",
        words,
    )
    assert error_of(
        drive_profile, with_drives({**RAMP_PROFILE, "parameters": {"t": 2.0}}), "sweep", 0
    )[1] == ("drive.parameters.t"), "the time is not a parameter"
