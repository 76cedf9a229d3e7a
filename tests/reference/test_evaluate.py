"""Curves and properties of a reference, and its errors at the keys of the sidecar.

Most references are stubs; a few are shipped ones.
"""

import numpy as np
import pytest

from proofmass.analytic.numerics import NotCovered
from proofmass.case.case import Beside, Channel
from proofmass.reference.case_model import compiled_model
from proofmass.reference.evaluate import (
    all_quantities,
    call_reference,
    evaluate,
    properties,
    reference_channels,
)
from proofmass.reference.recorded_rows import recorded_column
from tests.reference.stubs import (
    FIVEBAR,
    FOURBAR,
    PENDULUM,
    RECORDED,
    X,
    error_of,
    find_instead,
    make_reference,
    use_recorded_curve,
    use_reference,
    with_tables,
)


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
    find_instead(monkeypatch, made)
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
