"""The reference of a case: its samples, the motion of drives, the expected channels, and errors.

Most modules of references are stubs that are made here; a few are shipped ones.
"""

import os
from types import SimpleNamespace

import numpy as np
import pytest

from proofmass import reference
from proofmass.analytic.linkages import fivebar, fourbar
from proofmass.analytic.numerics import NotCovered
from proofmass.case import Beside, Channel, DriveTable
from proofmass.drive import Samples
from proofmass.errors import InputError
from proofmass.recorded import Recorded
from proofmass.reference import (
    all_quantities,
    assembly_modes,
    call_reference,
    compiled_model,
    drive_profile,
    drive_profiles,
    evaluate,
    load_reference,
    properties,
    recorded_column,
    reference_channels,
    run_samples,
)
from proofmass.sidecar import load_case
from proofmass.sim.protocol import BadModel, BadRod
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


def but(case, **changed):
    """The case with some of its tables replaced."""
    return case.model_copy(update=changed)


def sampled(case, kind, **table):
    """The case with one run alone, some keys of which are replaced."""
    return but(case, run={kind: case.run[kind].model_copy(update=table)})


def driven(*tables, case=FOURBAR):
    """The case with these drives, whose joints have the numbers of the drives as names."""
    return but(
        case,
        drive=tuple(
            DriveTable(joint=str(k), **{"from": 0.0, **table}) for k, table in enumerate(tables)
        ),
    )


def wrong(function, *args, **named):
    """The file, the key and the message of the error that a call raises."""
    with pytest.raises(InputError) as error:
        function(*args, **named)
    return error.value.file, error.value.key, error.value.wrong


def closed(monkeypatch, **functions):
    """Replace the reference module of all cases by one with these functions."""
    monkeypatch.setattr(
        reference,
        "load_reference",
        lambda case: SimpleNamespace(__name__=case.reference, **functions),
    )


def made(monkeypatch, **columns) -> Recorded:
    """Replace the reference of all cases by a recorded curve of three rows at `X`.

    Each column is given as its unit and its values.
    """
    curve = Recorded(
        X,
        {name: np.array(values) for name, (_, *values) in columns.items()},
        {name: unit for name, (unit, *_) in columns.items()},
    )
    monkeypatch.setattr(reference, "load_reference", lambda case: curve)
    return curve


def test_a_reference_is_a_module_by_its_name():
    assert load_reference(FOURBAR) is fourbar
    assert load_reference(FIVEBAR) is fivebar


def test_a_reference_that_is_not_there_is_named_with_the_nearest_and_all_that_are():
    file, key, words = wrong(load_reference, but(FOURBAR, reference="forbar"))
    assert (file, key) == (FOURBAR.file, "reference")
    head, _, names = words.partition("there are: ")
    assert head == "no closed form 'forbar'; did you mean 'fourbar'? "
    names, _, tail = names.partition("; ")
    assert names.split(", ") == sorted(names.split(", "))
    assert {"fourbar", "pendulum", "planar"} <= set(names.split(", "))
    assert tail == "or name a recorded curve NAME.csv"


def test_a_recorded_curve_is_read_once_and_again_when_its_file_has_changed(models):
    case = load_case(models / "hacksaw_recorded.toml")
    first = load_reference(case)
    assert load_reference(case) is first
    file = models / case.reference
    before = file.stat().st_mtime_ns
    head, *rows = [line for line in file.read_text().splitlines() if not line.startswith("#")]
    file.write_text("\n".join([head, *rows[:3]]))
    os.utime(file, ns=(before + 1, before + 1))
    assert load_reference(case).x.size == 3 < first.x.size
    file.unlink()
    assert wrong(load_reference, case) == (file, "", "no such recorded curve")


def test_a_recorded_curve_is_sampled_where_it_was_recorded():
    for kind in RECORDED.run:
        assert run_samples(RECORDED, kind) is load_reference(RECORDED).x


def test_a_free_motion_is_sampled_from_its_start_to_its_last_time():
    np.testing.assert_allclose(
        run_samples(sampled(PENDULUM, "dynamics", n=5, until=2.0), "dynamics"),
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
def test_where_a_driven_run_is_sampled(drive, kind, until, expected):
    case = sampled(driven(drive), kind, n=3, until=until)
    np.testing.assert_allclose(run_samples(case, kind), expected, rtol=0, atol=1e-15)


def test_a_rest_is_sampled_along_the_shortest_rod_or_up_to_a_length():
    rod = ROD.rod["rod"]
    rods = {
        "long": rod.model_copy(update={"length": 3.0}),
        "short": rod.model_copy(update={"length": 2.0}),
    }
    np.testing.assert_allclose(
        run_samples(sampled(but(ROD, rod=rods), "equilibrium", n=3), "equilibrium"), [0, 1, 2]
    )
    np.testing.assert_allclose(
        run_samples(sampled(ROD, "equilibrium", n=3, until=0.5), "equilibrium"), [0, 0.25, 0.5]
    )


def moved(case, kind, k=0):
    """The values, the rates and the accelerations of drive k at `X`."""
    return [np.broadcast_to(part, X.shape).tolist() for part in drive_profile(case, kind, k)(X)]


def test_at_rest_all_drives_stay_where_they_begin():
    case = driven({"from": 0.5, "to": 2.0, "rate": 3.0}, {"from": -1.0, "to": 4.0})
    assert moved(case, "equilibrium") == [[0.5] * 3, [0.0] * 3, [0.0] * 3]
    assert moved(case, "equilibrium", 1) == [[-1.0] * 3, [0.0] * 3, [0.0] * 3]


def test_a_steady_drive_goes_with_time_in_a_duration_and_is_x_itself_in_a_sweep():
    case = driven({"from": 0.5, "to": 2.0, "rate": 3.0})
    assert moved(case, "dynamics") == [[0.5, 1.25, 3.5], [3.0] * 3, [0.0] * 3]
    assert moved(case, "sweep") == [[0.0, 0.25, 1.0], [3.0] * 3, [0.0] * 3]
    assert drive_profile(driven({"to": 2.0}), "dynamics", 0)(X)[1].tolist() == [1.0] * 3, (
        "the default rate is 1"
    )


def test_a_follower_keeps_its_share_of_the_leader_s_way():
    """The second drive goes from 1 to 4 while the first goes from -2 to 0: 1.5 times as fast."""
    case = driven({"from": -2.0, "to": 0.0, "rate": 2.0}, {"from": 1.0, "to": 4.0})
    assert moved(case, "dynamics", 1) == [[1.0, 1.75, 4.0], [3.0] * 3, [0.0] * 3]
    assert moved(case, "sweep", 1) == [[4.0, 4.375, 5.5], [3.0] * 3, [0.0] * 3]  # drive 0 is at X
    both = drive_profiles(case, "dynamics")
    assert [float(one(X)[0][-1]) for one in both] == [0.0, 4.0]
    assert [float(one(X)[0][-1]) for one in drive_profiles(case, "sweep")] == [1.0, 5.5]
    assert drive_profiles(PENDULUM, "dynamics") == ()


def test_a_follower_of_a_swing_swings():
    case = driven({"from": 0.0, "to": 2.0, "period": 2.0}, {"from": 1.0, "to": 0.0})
    assert np.array(moved(case, "sweep")[0]) == pytest.approx([0.0, 1 - np.sqrt(0.5), 2.0])
    assert np.array(moved(case, "sweep", 1)[0]) == pytest.approx([1.0, 0.5 + np.sqrt(0.125), 0.0])


def test_drives_of_a_recorded_curve_are_its_columns(monkeypatch):
    made(monkeypatch, a=("rad", 1, 2, 3), b=("rad/s", 4, 5, 6), c=("rad/s^2", 7, 8, 9))
    found = drive_profile(driven({"profile": ("a", "b", "c")}), "sweep", 0)
    assert isinstance(found, Samples)
    assert [part.tolist() for part in found(X)] == [[1, 2, 3], [4, 5, 6], [7, 8, 9]]


def test_a_column_that_a_drive_lacks_is_named_where_it_is_asked_for(monkeypatch):
    made(monkeypatch, a=("rad", 1, 2, 3))
    case = driven({"profile": ("a", "a", "a")}, {"profile": ("a", "a", "aa")}, case=RECORDED)
    words = "no column 'aa' in hacksaw_recorded.csv; did you mean 'a'? there are: a"
    assert wrong(drive_profile, case, "sweep", 1) == (RECORDED.file, "drive.1.profile", words)
    assert wrong(drive_profile, but(case, drive=case.drive[1:]), "sweep", 0) == (
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


LAW = {"profile": "ramp", "until": 1.0, "parameters": {"rate": 2.0}}


def test_a_law_is_a_function_of_the_reference_s_module_with_its_parameters(monkeypatch):
    closed(monkeypatch, ramp=ramp, fan=fan, freely=freely)
    assert moved(driven(LAW), "dynamics") == [[0.0, 0.5, 2.0], [2.0] * 3, [0.0] * 3]
    own = driven(LAW, {"profile": "freely", "parameters": {"one": 1.0, "two": 2.0}})
    assert moved(own, "sweep")[0] == [0.0, 0.5, 2.0]
    assert moved(own, "sweep", 1)[0] == [0.0, 0.75, 3.0], "a drive with a profile of its own"
    shared = driven({**LAW, "profile": "fan"}, {})
    assert [moved(shared, "sweep", k)[0] for k in (0, 1)] == [[0.0, 0.5, 2.0], [0.0, 1.0, 4.0]]


def test_a_law_that_the_reference_lacks_is_named_where_it_is_asked_for(monkeypatch):
    closed(monkeypatch, ramp=ramp)
    words = "reference fourbar has no function 'rump'"
    assert wrong(drive_profile, driven({**LAW, "profile": "rump"}), "sweep", 0) == (
        FOURBAR.file,
        "drive.profile",
        words,
    )
    assert wrong(drive_profile, driven(LAW, {"profile": "rump"}), "sweep", 1) == (
        FOURBAR.file,
        "drive.1.profile",
        words,
    )
    assert wrong(drive_profile, driven({**LAW, "profile": "rump"}, {}), "sweep", 1) == (
        FOURBAR.file,
        "drive.0.profile",
        words,
    ), "the second drive follows a row of the first drive's profile"


def test_a_parameter_that_a_law_lacks_is_named_with_those_it_has(monkeypatch):
    closed(monkeypatch, ramp=ramp)
    words = "ramp() has no such parameter; did you mean 'rate'? known: rate, other"
    bad = {**LAW, "parameters": {"rte": 2.0}}
    assert wrong(drive_profile, driven(bad), "sweep", 0) == (
        FOURBAR.file,
        "drive.parameters.rte",
        words,
    )
    assert wrong(drive_profile, driven(LAW, bad | {"until": None}), "sweep", 1) == (
        FOURBAR.file,
        "drive.1.parameters.rte",
        words,
    )
    assert wrong(drive_profile, driven({**LAW, "parameters": {"t": 2.0}}), "sweep", 0)[1] == (
        "drive.parameters.t"
    ), "the time is not a parameter"


def listening(told, **found):
    """A reference that appends its arguments to a list and returns these quantities."""

    def solve(*args, length=1.0, mode=1):
        told.append((args, length, mode))
        return found

    return SimpleNamespace(solve=solve)


def test_a_closed_form_is_asked_with_time_or_with_the_drives_as_they_moved():
    told = []
    truth = listening(told, a=X)
    assert call_reference(FOURBAR, "sweep", truth, X, None, {"length": 2.0}) == {"a": X}
    one, two = np.ones((1, 3)), np.ones((2, 3))
    call_reference(FOURBAR, "sweep", truth, X, (one, 2 * one, 3 * one), {"mode": -1})
    call_reference(FIVEBAR, "sweep", truth, X, (two, 2 * two, 3 * two), {})
    free, single, double = told
    assert free[0][0] is X
    assert free[1:] == (2.0, 1)
    assert single[1:] == (1.0, -1)
    assert [part.tolist() for part in single[0]] == [[1.0] * 3, [2.0] * 3, [3.0] * 3]
    assert [part.tolist() for part in double[0]] == [[[n] * 3] * 2 for n in (1.0, 2.0, 3.0)]


def test_a_reference_that_reads_the_model_gets_it_with_start_and_driven_joints():
    def solve(time, *, model, start, joints, gravity=9.81):
        return {"given": (model, start, joints, gravity)}

    truth, case = SimpleNamespace(solve=solve), but(FIVEBAR, start="elsewhere")
    given = call_reference(case, "sweep", truth, X, None, {"gravity": 1.6})["given"]
    assert given == (compiled_model(FIVEBAR), "elsewhere", ("left", "right"), 1.6)
    for name in ("model", "start", "joints"):  # these come from the case, not from [parameters]
        assert wrong(call_reference, case, "sweep", truth, X, None, {name: 3.0}) == (
            FIVEBAR.file,
            f"parameters.{name}",
            "reference fivebar has no such parameter; known: gravity",
        )


def test_a_parameter_that_a_reference_lacks_is_named_with_those_it_has():
    truth = listening([])
    words = "reference fourbar has no such parameter; did you mean 'length'? known: length, mode"
    assert wrong(call_reference, FOURBAR, "sweep", truth, X, None, {"mode": 1, "lenght": 2.0}) == (
        FOURBAR.file,
        "parameters.lenght",
        words,
    )
    assert wrong(
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


def failing(error):
    """A reference that raises this error."""

    def solve(*_, length=1.0):
        raise error

    return SimpleNamespace(solve=solve)


def test_a_model_that_a_reference_does_not_cover_is_at_fault_itself():
    assert wrong(
        call_reference, FOURBAR, "sweep", failing(NotCovered("it has a tendon")), X, None, {}
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
def test_what_a_reference_refuses_is_an_error_of_what_it_was_given(
    error, case, parameters, key, at_fault
):
    """The error is one of the parameters if there are any, otherwise of the drives or the model."""
    assert wrong(call_reference, case, "sweep", failing(error), X, None, parameters, key) == (
        case.file,
        at_fault,
        "too short",
    )


def test_another_error_of_a_reference_is_no_bad_input():
    with pytest.raises(KeyError):
        call_reference(FOURBAR, "sweep", failing(KeyError("bug")), X, None, {})


def test_the_quantities_of_a_closed_form_are_those_of_its_parameters(monkeypatch):
    told = []
    monkeypatch.setattr(reference, "load_reference", lambda case: listening(told, a=X))
    found = all_quantities(FOURBAR, "sweep", X, None, {"length": 2.0})
    assert {name: found[name] for name in found if "drive." not in name} == {"a": X}
    assert told[0][1] == 2.0
    for key in ("parameters", "compare_with.'x'.parameters"):
        named = {} if key == "parameters" else {"key": key}
        assert (
            wrong(all_quantities, FOURBAR, "sweep", X, None, {"no": 2.0}, **named)[1] == f"{key}.no"
        )


def test_the_quantities_of_a_recorded_curve_are_its_columns_as_far_as_a_run_came(monkeypatch):
    motion = dict.fromkeys(("theta2", "omega2", "alpha2"), ("rad", 0.0, 0.0, 0.0))
    made(monkeypatch, a=("m", 1.0, 2.0, 3.0), b=("s", 4.0, 5.0, 6.0), **motion)
    found = all_quantities(RECORDED, "sweep", X[:2], None, {})
    assert {name: found[name].tolist() for name in ("a", "b")} == {
        "a": [1.0, 2.0],
        "b": [4.0, 5.0],
    }
    words = "the reference is a recorded curve, which has none"
    assert wrong(all_quantities, RECORDED, "sweep", X, None, {"a": 1.0}) == (
        RECORDED.file,
        "parameters",
        words,
    )
    assert wrong(
        all_quantities, RECORDED, "sweep", X, None, {"a": 1.0}, "compare_with.'x'.parameters"
    ) == (
        RECORDED.file,
        "compare_with.'x'.parameters",
        words,
    )


def test_channels_are_quantities_times_their_scale_and_shifted_in_their_unit(monkeypatch):
    closed(monkeypatch)
    case = but(
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


def test_a_quantity_that_a_reference_lacks_is_named_with_those_it_has(monkeypatch):
    closed(monkeypatch)
    case = but(FOURBAR, channels={"rate": Channel(equals="crnk", unit="m")})
    assert wrong(reference_channels, case, X, {"crank": X, "rocker": X}) == (
        FOURBAR.file,
        "channels.rate.equals",
        "no quantity 'crnk'; did you mean 'crank'? there are: crank, rocker",
    )


def test_a_channel_of_a_recorded_curve_has_its_column_and_its_quantity(monkeypatch):
    curve = made(monkeypatch, a=("m", 1.0, 2.0, 3.0))
    case = but(RECORDED, channels={"x": Channel(equals="a", unit="mm")})
    assert reference_channels(case, X, curve.columns)["x"].tolist() == [1.0, 2.0, 3.0]
    angle = but(RECORDED, channels={"x": Channel(equals="a", unit="deg")})
    assert wrong(reference_channels, angle, X, curve.columns) == (
        RECORDED.file,
        "channels.x.equals",
        "column 'a' of hacksaw_recorded.csv is in m (SI), the channel in deg",
    )
    failed = but(RECORDED, channels={"x": Channel(equals="aa", unit="m")})
    assert wrong(reference_channels, failed, X, curve.columns) == (
        RECORDED.file,
        "channels.x.equals",
        "no column 'aa' in hacksaw_recorded.csv; did you mean 'a'? there are: a",
    )


def test_a_column_is_asked_for_with_its_quantity_or_without(monkeypatch):
    curve = made(monkeypatch, a=("m", 1.0, 2.0, 3.0))
    for unit in (None, "m", "mm"):
        assert recorded_column(RECORDED, curve, "key", "a", unit) is curve.columns["a"]
    assert wrong(recorded_column, RECORDED, curve, "key", "a", "rad")[1] == "key"


def test_a_reference_is_evaluated_at_its_parameters_and_at_changed_ones():
    """A pendulum of twice the mass has the same motion and twice the energy."""
    once = evaluate(PENDULUM, "dynamics", X, None)
    assert once.x is X
    mass = PENDULUM.parameters["mass"]
    twice = evaluate(PENDULUM, "dynamics", X, None, mass=2 * mass)
    np.testing.assert_allclose(twice.channels["angle"], once.channels["angle"], rtol=1e-15)
    np.testing.assert_allclose(twice.channels["kinetic"], 2 * once.channels["kinetic"], rtol=1e-14)


def test_facts_are_of_the_parameters_or_of_those_beside(monkeypatch):
    def tell(*, length, mode=1):
        return {"length": f"{length:g} m"}

    closed(monkeypatch, properties=tell)
    case = but(
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
    closed(monkeypatch)
    assert properties(case) == {}


def test_parameters_that_cannot_be_have_no_facts(monkeypatch):
    def tell(**_):
        raise ValueError("too short")

    closed(monkeypatch, properties=tell)
    assert properties(FOURBAR) == {}


def test_modes_are_those_of_the_reference_if_it_has_such_a_choice():
    assert assembly_modes(FOURBAR) == (1, -1)
    assert assembly_modes(PENDULUM) == ()
    assert assembly_modes(RECORDED) == ()


def test_a_model_is_compiled_once_and_again_when_its_file_or_its_rods_have_changed(models):
    case = load_case(models / "pendulum.toml")
    first = compiled_model(case)
    assert compiled_model(but(case, title="another")) is first
    before = case.model_path.stat().st_mtime_ns
    case.model_path.write_text(case.model_path.read_text().replace('mass="1"', 'mass="3"'))
    os.utime(case.model_path, ns=(before + 1, before + 1))
    assert compiled_model(case).body("bob").mass == 3 * first.body("bob").mass
    finer = ROD.rod["rod"].model_copy(update={"segments": 7})
    assert compiled_model(but(ROD, rod={"rod": finer})).nbody < compiled_model(ROD).nbody


def test_a_rod_that_cannot_be_built_is_an_error_of_the_sidecar(monkeypatch):
    def fail(*_):
        raise BadRod("beam", "from", "no site 'clmp'")

    monkeypatch.setattr(reference, "compile_once", fail)
    assert wrong(compiled_model, ROD) == (ROD.file, "rod.beam.from", "no site 'clmp'")


def test_a_model_that_cannot_be_compiled_is_named_once(monkeypatch):
    def fail(*_):
        raise BadModel("fourbar.xml: XML Error: line 3")

    monkeypatch.setattr(reference, "compile_once", fail)
    assert wrong(compiled_model, FOURBAR) == (FOURBAR.model_path, "", "XML Error: line 3")
