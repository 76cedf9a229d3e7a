"""The reference of a case: its samples, the motion of drives, the expected channels, and errors.

Most modules of references are stubs that are made here; a few are shipped ones.
"""

import os
from pathlib import Path

import numpy as np
import pytest

from proofmass.analytic.linkages import fivebar, fourbar
from proofmass.analytic.numerics import NotCovered
from proofmass.analytic.protocol import Mode, Position, Reference
from proofmass.base.errors import InputError
from proofmass.base.recorded import RecordedTable, RecordingTable
from proofmass.base.recording import Recorded
from proofmass.case.case import Beside, Channel, DriveTable, LoadTable
from proofmass.case.drive import Samples
from proofmass.reference import reference
from proofmass.reference.find import load_reference
from proofmass.reference.reference import (
    all_quantities,
    assembly_modes,
    call_reference,
    compiled_model,
    drive_profile,
    drive_profiles,
    evaluate,
    load_profiles,
    properties,
    recorded_column,
    reference_channels,
    run_samples,
)
from proofmass.run.sidecar import load_case
from proofmass.sim.protocol.failures import BadModel, BadRod
from tests.shipped import shipped

PENDULUM, FOURBAR, FIVEBAR, CIRCLE, HACKSAW, RECORDED, SWING, ROD = (
    load_case(shipped(f"{name}.toml"))
    for name in (
        "pendulum",
        "fourbar",
        "fivebar",
        "fivebar_circle",
        "hacksaw",
        "hacksaw_recorded",
        "triple_rocker",
        "rod_cantilever",
    )
)
X = np.array([0.0, 0.25, 1.0])


def with_tables(case, **changed):
    """The case with some of its tables replaced."""
    return case.model_copy(update=changed)


def with_run_table(case, kind, **table):
    """The case with one run alone, some keys of which are replaced."""
    return with_tables(case, run={kind: case.run[kind].model_copy(update=table)})


def test_a_load_changes_uniformly_from_the_first_time_to_the_last(monkeypatch):
    """The drive follows a profile, so that the load cannot go in proportion to its way."""
    load = LoadTable(actuator="push", **{"from": 2.0}, to=5.0)
    drive = FOURBAR.drive[0].model_copy(update={"to": None})
    times = np.array([1.0, 2.0, 3.0])
    monkeypatch.setattr(reference, "run_samples", lambda *_: times)
    (profile,) = load_profiles(with_tables(FOURBAR, load=(load,), drive=(drive,)), "dynamics")
    value, rate, acceleration = profile(times)
    assert value.tolist() == [2.0, 3.5, 5.0]
    assert (set(rate), set(acceleration)) == ({1.5}, {0.0})


def with_drives(*tables, case=FOURBAR):
    """The case with these drives, whose joints have the numbers of the drives as names."""
    return with_tables(
        case,
        drive=tuple(
            DriveTable(joint=str(k), **{"from": 0.0, **table}) for k, table in enumerate(tables)
        ),
    )


def error_of(function, *args, **named):
    """The file, the key and the message of the error that a call raises."""
    with pytest.raises(InputError) as error:
        function(*args, **named)
    return error.value.file, error.value.key, error.value.wrong


def make_reference(solve=None, **attributes) -> type[Reference]:
    """A reference with parameters `length` and `mode`, whose method calls a function."""

    def call(self, motion, ask):
        return solve(motion, ask, **self.values)

    fields = {"__annotations__": {"length": Position, "mode": Mode}, "length": 1.0, "mode": 1}
    return type("Made", (Reference,), {**fields, "solve": call, **attributes})


def use_reference(monkeypatch, **attributes):
    """Let all cases have a reference with these attributes of its class."""
    made = make_reference(**attributes)
    monkeypatch.setattr(reference, "load_reference", lambda case: made)
    monkeypatch.setattr(reference, "reference_class", lambda case: made)


def use_recorded_curve(monkeypatch, **columns) -> Recorded:
    """Replace the reference of all cases by a recorded curve of three rows at `X`.

    Each column is given as its unit and its values.
    """
    units = {"t": "s"} | {name: unit for name, (unit, *_) in columns.items()}
    cells = zip(X, *(values for _, *values in columns.values()), strict=True)
    rows = tuple((k, [repr(float(cell)) for cell in row]) for k, row in enumerate(cells, 2))
    curve = Recorded(
        RecordedTable(Path(RECORDED.reference), units, rows), RecordingTable.model_validate({})
    )
    monkeypatch.setattr(reference, "load_reference", lambda case: curve)
    monkeypatch.setattr(reference, "reference_class", lambda case: None)
    return curve


def test_a_reference_is_the_class_of_its_name():
    assert load_reference(FOURBAR) is fourbar.FourBar
    assert load_reference(FIVEBAR) is fivebar.FiveBar


def test_an_unknown_reference_is_reported_with_the_nearest_and_all_names():
    file, key, words = error_of(load_reference, with_tables(FOURBAR, reference="forbar"))
    assert (file, key) == (FOURBAR.file, "reference")
    head, _, names = words.partition("there are: ")
    assert head == "no reference 'forbar'; did you mean 'fourbar'? "
    names, _, tail = names.partition("; ")
    assert names.split(", ") == sorted(names.split(", "))
    assert {"fourbar", "pendulum", "planar"} <= set(names.split(", "))
    assert tail == "or name a recorded curve NAME.csv or a program NAME.py"


def test_a_recorded_curve_is_read_again_only_if_its_file_has_changed(models):
    case = load_case(models / "hacksaw_recorded.toml")
    first = load_reference(case)
    assert load_reference(case) is first
    file = models / case.reference
    before = file.stat().st_mtime_ns
    head, *rows = [line for line in file.read_text().splitlines() if not line.startswith("#")]
    file.write_text("\n".join([head, *rows[:3]]))
    os.utime(file, ns=(before + 1, before + 1))
    assert len(load_reference(case).table.rows) == 3 < len(first.table.rows)
    file.unlink()
    assert error_of(load_reference, case) == (file, "", "no such recorded curve")


def test_a_recorded_curve_is_sampled_where_it_was_recorded():
    for kind in RECORDED.run:
        times = load_reference(RECORDED).table.values("t")
        np.testing.assert_array_equal(run_samples(RECORDED, kind), times)


def test_a_free_motion_is_sampled_from_its_start_to_its_last_time():
    np.testing.assert_allclose(
        run_samples(with_run_table(PENDULUM, "dynamics", n=5, until=2.0), "dynamics"),
        [0.0, 0.5, 1.0, 1.5, 2.0],
        rtol=0,
        atol=1e-15,
    )


@pytest.mark.parametrize(
    ("drive", "kind", "until", "expected"),
    [
        # a sweep is sampled by the drive's value, dynamics by time until the drive is there
        ({"from": -2.0, "to": 1.0, "rate": 0.5}, "sweep", None, (-2.0, -0.5, 1.0)),
        ({"from": -2.0, "to": 1.0, "rate": 0.5}, "dynamics", None, (0.0, 3.0, 6.0)),
        ({"from": -2.0, "to": 0.0, "rate": 0.5}, "sweep", None, (-2.0, -1.0, 0.0)),
        ({"from": -2.0, "to": 0.0, "rate": 0.5}, "dynamics", None, (0.0, 2.0, 4.0)),
        # a drive with a period or a profile is sampled by time in both runs: over one period,
        # until the profile's last time, or until that of the run
        ({"to": 1.0, "period": 8.0}, "sweep", None, (0.0, 4.0, 8.0)),
        ({"to": 1.0, "period": 8.0}, "dynamics", 2.0, (0.0, 1.0, 2.0)),
        ({"profile": "circle", "until": 6.0}, "dynamics", None, (0.0, 3.0, 6.0)),
        ({"profile": "circle", "until": 6.0}, "sweep", 2.0, (0.0, 1.0, 2.0)),
    ],
)
def test_a_driven_run_is_sampled_by_the_drive_or_by_time(drive, kind, until, expected):
    case = with_run_table(with_drives(drive), kind, n=3, until=until)
    np.testing.assert_allclose(run_samples(case, kind), expected, rtol=0, atol=1e-15)


def test_an_equilibrium_is_sampled_along_the_shortest_rod_or_to_a_length():
    rod = ROD.rod["rod"]
    rods = {
        "long": rod.model_copy(update={"length": 3.0}),
        "short": rod.model_copy(update={"length": 2.0}),
    }
    np.testing.assert_allclose(
        run_samples(with_run_table(with_tables(ROD, rod=rods), "equilibrium", n=3), "equilibrium"),
        [0, 1, 2],
    )
    np.testing.assert_allclose(
        run_samples(with_run_table(ROD, "equilibrium", n=3, until=0.5), "equilibrium"),
        [0, 0.25, 0.5],
    )


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


def recording_reference(calls, **found):
    """A reference that appends its arguments to a list and returns these quantities."""

    def solve(motion, ask, length=1.0, mode=1):
        calls.append((motion.arguments, length, mode))
        return found

    return make_reference(solve)


def test_a_closed_form_gets_the_time_or_the_motion_of_the_drives():
    calls = []
    truth = recording_reference(calls, a=X)
    found = call_reference(FOURBAR, "sweep", truth, X, None, {"length": 2.0})
    assert list(found) == ["a"]
    assert found["a"] is X
    one, two = np.ones((1, 3)), np.ones((2, 3))
    call_reference(FOURBAR, "sweep", truth, X, (one, 2 * one, 3 * one), {"mode": -1})
    call_reference(FIVEBAR, "sweep", truth, X, (two, 2 * two, 3 * two), {})
    free, single, double = calls
    assert free[0][0] is X
    assert free[1:] == (2.0, 1)
    assert single[1:] == (1.0, -1)
    assert [part.tolist() for part in single[0]] == [[1.0] * 3, [2.0] * 3, [3.0] * 3]
    assert [part.tolist() for part in double[0]] == [[[n] * 3] * 2 for n in (1.0, 2.0, 3.0)]


def test_a_reference_that_reads_the_model_gets_model_start_and_joints():
    given = []

    def solve(motion, ask, length):
        given.append((ask.of_model.model, ask.of_model.start, ask.of_model.joints, length))
        return {}

    truth = make_reference(solve, reads_model=True)
    case = with_tables(FIVEBAR, start="elsewhere")
    assert call_reference(case, "sweep", truth, X, None, {"length": 1.6}) == {}
    assert given == [(compiled_model(FIVEBAR), "elsewhere", ("left", "right"), 1.6)]


def test_a_reference_that_does_not_say_so_gets_no_model():
    truth = make_reference(lambda motion, ask, length: {"a": ask.of_model.model})
    assert error_of(call_reference, FIVEBAR, "sweep", truth, X, None, {"length": 1.6}) == (
        FIVEBAR.file,
        "parameters",
        "it reads no model: a class that does states reads_model = True",
    )


def test_an_unknown_parameter_of_a_reference_is_reported():
    truth = recording_reference([])
    words = "reference fourbar has no such parameter; did you mean 'length'? known: length, mode"
    assert error_of(
        call_reference, FOURBAR, "sweep", truth, X, None, {"mode": 1, "lenght": 2.0}
    ) == (
        FOURBAR.file,
        "parameters.lenght",
        words,
    )
    assert error_of(
        call_reference,
        FOURBAR,
        "sweep",
        truth,
        X,
        None,
        {"lenght": 2.0},
        "compare_with.'x'.parameters",
    ) == (
        FOURBAR.file,
        "compare_with.'x'.parameters.lenght",
        words,
    )


def failing_reference(error):
    """A reference that raises this error."""

    def solve(*_, **__):
        raise error

    return make_reference(solve)


def test_a_model_that_a_reference_does_not_cover_is_an_error_of_the_model():
    assert error_of(
        call_reference,
        FOURBAR,
        "sweep",
        failing_reference(NotCovered("it has a tendon")),
        X,
        None,
        {},
    ) == (
        FOURBAR.model_path,
        "",
        "the reference 'fourbar' does not cover it: it has a tendon",
    )


@pytest.mark.parametrize("error", [ValueError("too short"), TypeError("too short")])
@pytest.mark.parametrize(
    ("case", "parameters", "key", "at_fault"),
    [
        (FOURBAR, {"length": 2.0}, "parameters", "parameters"),
        (FOURBAR, {"length": 2.0}, "compare_with.'x'.parameters", "compare_with.'x'.parameters"),
        (FOURBAR, {}, "parameters", "drive"),
        (PENDULUM, {}, "parameters", "model"),
    ],
)
def test_an_error_of_a_reference_is_reported_at_the_input_at_fault(
    error, case, parameters, key, at_fault
):
    """The error is one of the parameters if there are any, otherwise of the drives or the model."""
    assert error_of(
        call_reference, case, "sweep", failing_reference(error), X, None, parameters, key
    ) == (
        case.file,
        at_fault,
        "too short",
    )


def test_an_unexpected_error_of_a_reference_is_not_bad_input():
    with pytest.raises(KeyError):
        call_reference(FOURBAR, "sweep", failing_reference(KeyError("bug")), X, None, {})


def test_a_closed_form_is_evaluated_at_the_given_parameters(monkeypatch):
    calls = []
    made = recording_reference(calls, a=X)
    monkeypatch.setattr(reference, "load_reference", lambda case: made)
    found = all_quantities(FOURBAR, "sweep", X, None, {"length": 2.0})
    assert {name: found[name] for name in found if "drive." not in name} == {"a": X}
    assert calls[0][1] == 2.0
    for key in ("parameters", "compare_with.'x'.parameters"):
        named = {} if key == "parameters" else {"key": key}
        assert (
            error_of(all_quantities, FOURBAR, "sweep", X, None, {"no": 2.0}, **named)[1]
            == f"{key}.no"
        )


def test_columns_of_a_recorded_curve_end_with_the_samples_of_the_run(monkeypatch):
    motion = dict.fromkeys(("theta2", "omega2", "alpha2"), ("rad", 0.0, 0.0, 0.0))
    use_recorded_curve(monkeypatch, a=("m", 1.0, 2.0, 3.0), b=("s", 4.0, 5.0, 6.0), **motion)
    found = all_quantities(RECORDED, "sweep", X[:2], None, {})
    assert {name: found[name].tolist() for name in ("a", "b")} == {
        "a": [1.0, 2.0],
        "b": [4.0, 5.0],
    }
    words = "the reference is a recorded curve, which has none"
    assert error_of(all_quantities, RECORDED, "sweep", X, None, {"a": 1.0}) == (
        RECORDED.file,
        "parameters",
        words,
    )
    assert error_of(
        all_quantities, RECORDED, "sweep", X, None, {"a": 1.0}, "compare_with.'x'.parameters"
    ) == (
        RECORDED.file,
        "compare_with.'x'.parameters",
        words,
    )


def test_channels_are_scaled_and_shifted_quantities_in_their_unit(monkeypatch):
    use_reference(monkeypatch)
    case = with_tables(
        FOURBAR,
        channels={
            "level": Channel(equals=5.0, unit="mm", scale=3.0, shift=2.0),
            "plain": Channel(equals="a", unit="m"),
            "other": Channel(equals="a", unit="mm", scale=-2.0, shift=500.0),
            "constant": Channel(equals="c", unit="m"),
        },
    )
    found = reference_channels(case, X, {"a": X, "c": np.array(7.0)})
    assert {name: values.tolist() for name, values in found.items()} == {
        "level": [0.017] * 3,  # 3 * 5 + 2 mm
        "plain": X.tolist(),
        "other": [0.5, 0.0, -1.5],
        "constant": [7.0] * 3,
    }


def test_an_unknown_quantity_of_a_channel_is_reported(monkeypatch):
    use_reference(monkeypatch)
    case = with_tables(FOURBAR, channels={"rate": Channel(equals="crnk", unit="m")})
    assert error_of(reference_channels, case, X, {"crank": X, "rocker": X}) == (
        FOURBAR.file,
        "channels.rate.equals",
        "no quantity 'crnk'; did you mean 'crank'? there are: crank, rocker",
    )


def test_a_channel_of_a_recorded_curve_needs_a_column_of_its_quantity(monkeypatch):
    curve = use_recorded_curve(monkeypatch, a=("m", 1.0, 2.0, 3.0))
    known = {"a": curve.curve("a")}
    case = with_tables(RECORDED, channels={"x": Channel(equals="a", unit="mm")})
    assert reference_channels(case, X, known)["x"].tolist() == [1.0, 2.0, 3.0]
    angle = with_tables(RECORDED, channels={"x": Channel(equals="a", unit="deg")})
    assert error_of(reference_channels, angle, X, known) == (
        RECORDED.file,
        "channels.x.equals",
        "column 'a' of hacksaw_recorded.csv is in m (SI), the channel in deg",
    )
    failed = with_tables(RECORDED, channels={"x": Channel(equals="aa", unit="m")})
    assert error_of(reference_channels, failed, X, known) == (
        RECORDED.file,
        "channels.x.equals",
        "no column 'aa' in hacksaw_recorded.csv; did you mean 'a'? there are: t, a",
    )


def test_a_column_is_read_with_or_without_a_unit(monkeypatch):
    curve = use_recorded_curve(monkeypatch, a=("m", 1.0, 2.0, 3.0))
    for unit in (None, "m", "mm"):
        assert recorded_column(RECORDED, curve, "key", "a", unit) is curve.curve("a")
    assert error_of(recorded_column, RECORDED, curve, "key", "a", "rad")[1] == "key"


def test_a_reference_is_evaluated_at_its_parameters_and_at_changed_ones():
    """A pendulum of twice the mass has the same motion and twice the energy."""
    once = evaluate(PENDULUM, "dynamics", X, None)
    assert once.x is X
    mass = PENDULUM.parameters["mass"]
    twice = evaluate(PENDULUM, "dynamics", X, None, mass=2 * mass)
    np.testing.assert_allclose(twice.channels["angle"], once.channels["angle"], rtol=1e-15)
    np.testing.assert_allclose(twice.channels["kinetic"], 2 * once.channels["kinetic"], rtol=1e-14)


def test_properties_are_those_of_the_case_or_of_compared_parameters(monkeypatch):
    def tell(self, motion, ask):
        if "length" not in self.values:
            raise ValueError("no length")
        return {"length": f"{self.length:g} m"}

    use_reference(monkeypatch, properties=tell)
    case = with_tables(
        FOURBAR,
        parameters={"length": 2.0, "mode": -1},
        compare_with={
            "x": Beside(parameters={"length": 3.0}),
            "bad": Beside(parameters={"mode": 1}),
        },
    )
    assert properties(case) == {"length": "2 m"}
    assert properties(case, "x") == {"length": "3 m"}
    assert properties(case, "bad") == {}, "errors of the parameters are reported by the runs"
    use_reference(monkeypatch)
    assert properties(case) == {}


def test_impossible_parameters_have_no_properties(monkeypatch):
    def tell(*_):
        raise ValueError("too short")

    use_reference(monkeypatch, properties=tell)
    assert properties(FOURBAR) == {}


def test_assembly_modes_are_those_of_the_reference_if_it_has_any():
    assert assembly_modes(FOURBAR) == (1, -1)
    assert assembly_modes(PENDULUM) == ()
    assert assembly_modes(RECORDED) == ()


def test_a_model_is_compiled_again_only_if_its_file_or_its_rods_change(models):
    case = load_case(models / "pendulum.toml")
    first = compiled_model(case)
    assert compiled_model(with_tables(case, title="another")) is first
    before = case.model_path.stat().st_mtime_ns
    case.model_path.write_text(case.model_path.read_text().replace('mass="1"', 'mass="3"'))
    os.utime(case.model_path, ns=(before + 1, before + 1))
    assert compiled_model(case).body("bob").mass == 3 * first.body("bob").mass
    finer = ROD.rod["rod"].model_copy(update={"segments": 7})
    assert compiled_model(with_tables(ROD, rod={"rod": finer})).nbody < compiled_model(ROD).nbody


def test_a_rod_that_cannot_be_built_is_an_error_of_the_sidecar(monkeypatch):
    def fail(*_):
        raise BadRod("beam", "from", "no site 'clmp'")

    monkeypatch.setattr(reference, "compile_once", fail)
    assert error_of(compiled_model, ROD) == (ROD.file, "rod.beam.from", "no site 'clmp'")


def test_a_compilation_error_names_the_model_once(monkeypatch):
    def fail(*_):
        raise BadModel("fourbar.xml: XML Error: line 3")

    monkeypatch.setattr(reference, "compile_once", fail)
    assert error_of(compiled_model, FOURBAR) == (FOURBAR.model_path, "", "XML Error: line 3")
