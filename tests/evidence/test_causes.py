"""Causes that are planted in the curves of the reference itself, so that no engine runs."""

import re
from dataclasses import replace

import numpy as np
import pytest

from docs.make.diagnosis import case_of
from proofmass.base.strict import Kind
from proofmass.case.case import Case
from proofmass.evidence.diagnosis.causes import (
    best_causes,
    causes_of_reference,
    describe_transient,
    is_clear,
    is_exact,
    sort_key,
)
from proofmass.evidence.diagnosis.channels import factor_causes, offset_causes, shift_causes
from proofmass.evidence.diagnosis.explanation import Explanation
from proofmass.evidence.diagnosis.failure import describe_first_error, describe_violation
from proofmass.evidence.diagnosis.fit import (
    Residuals,
    SearchBudget,
    SearchLog,
    remaining_share,
    rms,
    run_steps,
)
from proofmass.evidence.diagnosis.model import describe_start, is_model_wrong
from proofmass.evidence.diagnosis.settings import falling_channels, setting_value
from proofmass.reference.evaluate import evaluate
from proofmass.reference.samples import run_samples
from proofmass.run.sidecar import load_case
from proofmass.run.solve import prescribed_run
from proofmass.sim.protocol.curves import Curves
from tests.shipped import shipped


def exact_curves(case: Case, run: Kind = "sweep") -> Curves:
    """The curves of the reference, as if an engine had computed them."""
    asked = prescribed_run(case, run)
    drive = asked.motion(asked.x) if case.drive else None
    return evaluate(case, run, run_samples(case, run), drive)


@pytest.fixture(scope="module")
def fourbar() -> tuple[Case, Curves]:
    case = case_of("fourbar")
    return case, exact_curves(case)


@pytest.fixture(scope="module")
def pendulum() -> tuple[Case, Curves]:
    case = case_of("pendulum")
    return case, exact_curves(case, "dynamics")


def spoilt(known: tuple[Case, Curves], run: Kind = "sweep", **channels) -> Residuals:
    """Residuals in which functions of their curves replace channels; "__" stands for a dot."""
    case, curves = known
    changed = {name.replace("__", "."): change for name, change in channels.items()}
    new = {name: change(curves.channels[name]) for name, change in changed.items()}
    return Residuals(case, run, "mujoco", replace(curves, channels={**curves.channels, **new}))


def first(residuals: Residuals) -> Explanation:
    return best_causes(causes_of_reference(residuals))[0]


@pytest.mark.parametrize(
    ("channel", "factor", "scale", "note"),
    [
        ("holding_moment", -1.0, "-1", "the opposite sign"),
        ("rocker", 57.29577951308232, "57.2958", "in degrees, not in radians"),
        ("rocker_rate", 0.017453292519943295, "0.0174533", "in radians, not in degrees"),
        ("pin.x", 1000.0, "1000", "in thousandths of its unit"),
        ("pin.x", 0.001, "0.001", "in thousands of its unit"),
        ("holding_moment", 1000.0, "1000", "in thousandths of its unit"),
        ("pin.y", 100.0 / 2.54, "39.3701", "in inches, not in metres"),
        ("pin_velocity.x", 100.0 / 2.54, "39.3701", "in inches, not in metres"),
        ("holding_moment", 2.0, "2", "twice as large"),
        ("rocker", 0.5, "0.5", "half as large"),
    ],
)
def test_a_factor_that_has_a_name_is_named(fourbar, channel, factor, scale, note):
    residuals = spoilt(fourbar, **{channel.replace(".", "__"): lambda y: factor * y})
    cause = first(residuals)
    assert cause.sentence.endswith(
        f": scale of {channel} is 1; with {scale} ({note}) the curve agrees"
    )
    assert (cause.kind, cause.free, cause.explains) == ("factor", 0, (channel,))
    assert cause.left < 1e-12
    assert cause.fault.right == pytest.approx(factor, rel=1e-9)


@pytest.mark.parametrize(
    ("channel", "factor"),
    [("pin.x", 57.29577951308232), ("rocker", 1000.0), ("rocker", 39.37007874015748),
     ("holding_moment", 39.37007874015748), ("pin.x", 1.3), ("pin.x", 1.003), ("rocker", -2.0)],
)  # fmt: skip
def test_a_factor_without_a_name_for_its_unit_is_a_number(fourbar, channel, factor):
    residuals = spoilt(fourbar, **{channel.replace(".", "__"): lambda y: factor * y})
    found = [c for c in factor_causes(residuals) if c.explains == (channel,)]
    (cause,) = (c for c in found if c.free == 2)
    assert cause.words == f"{channel} times {factor:.6g}"
    assert cause.fault.note == ""
    assert cause.fault.right == pytest.approx(factor, rel=1e-9)
    assert cause.left < 1e-12
    assert not any(c.free == 0 for c in found)


def test_channels_with_the_same_factor_are_one_cause(fourbar):
    residuals = spoilt(fourbar, pin__x=lambda y: -y, rocker_rate=lambda y: -y)
    cause = first(residuals)
    assert cause.words == "rocker_rate and pin.x with the opposite sign" or (
        cause.words == "pin.x and rocker_rate with the opposite sign"
    )
    assert len(cause.faults) == 2
    assert "; with that changed both curves agree" in cause.sentence
    free = spoilt(fourbar, pin__x=lambda y: 1.7 * y, rocker_rate=lambda y: 1.7 * y)
    (cause,) = (c for c in factor_causes(free) if c.complete)
    assert cause.free == 2


@pytest.mark.parametrize(
    ("channel", "offset", "words", "free"),
    [
        ("rocker", np.pi, "rocker off by half a turn ahead", 0),
        ("rocker", -np.pi / 2, "rocker off by a quarter turn behind", 0),
        ("coupler.angle", 2 * np.pi, "coupler.angle off by a whole turn ahead", 0),
        ("rocker", 0.3, "rocker off by 0.3 rad", 2),
        ("pin.x", 0.05, "pin.x off by 0.05 m", 2),
        ("pin.x", np.pi, "pin.x off by 3.14159 m", 2),
        ("pin.x", -0.05, "pin.x off by -0.05 m", 2),
    ],
)
def test_an_offset_is_named(fourbar, channel, offset, words, free):
    residuals = spoilt(fourbar, **{channel.replace(".", "__"): lambda y: y + offset})
    (cause,) = offset_causes(residuals)
    assert (cause.words, cause.free, cause.kind) == (words, free, "offset")
    assert cause.explains == (channel,)
    unit = fourbar[0].channels[channel].unit
    assert cause.fault.unit == unit
    factor = fourbar[0].channels[channel].factor
    assert cause.fault.right == pytest.approx(offset / factor, rel=1e-6)
    assert cause.fault.wrong == 0.0


def test_exchanged_quantities_are_named(fourbar):
    case, curves = fourbar
    channels = {**curves.channels, "pin.x": curves.channels["pin.y"]}
    residuals = Residuals(case, "sweep", "mujoco", replace(curves, channels=channels))
    cause = first(residuals)
    assert cause.words == "pin.x equal to pin_y"
    assert (cause.fault.wrong, cause.fault.right) == ("pin_x", "pin_y")
    assert (cause.kind, cause.free) == ("quantity", 0)


@pytest.mark.parametrize(
    ("count", "words"),
    [(1, "one sample late"), (-1, "one sample early"),
     (2, "two samples late"), (-2, "two samples early")],
)  # fmt: skip
def test_a_shift_by_samples_is_named(pendulum, count, words):
    case, curves = pendulum
    inner = slice(3, -3)
    channels = {name: np.roll(y, count)[inner] for name, y in curves.channels.items()}
    moved = replace(curves, x=curves.x[inner], channels=channels)
    residuals = Residuals(case, "dynamics", "mujoco", moved)
    cause = best_causes([*shift_causes(residuals)])[0]
    assert cause.words.endswith(f" {words}")
    assert cause.complete
    assert cause.free == 0


@pytest.mark.parametrize(("shift", "way"), [(0.0137, "late"), (-0.0137, "early")])
def test_a_shift_between_samples_is_found(pendulum, shift, way):
    case, curves = pendulum
    exact = evaluate(case, "dynamics", curves.x - shift, None)
    moved = replace(curves, channels=exact.channels)
    residuals = Residuals(case, "dynamics", "mujoco", moved)
    found = [c for c in shift_causes(residuals) if c.free == 2]
    (cause,) = found
    assert cause.words.endswith(f" {way} by 0.0137 in x")
    assert cause.complete


def test_a_shift_by_more_than_a_tenth_is_none(pendulum):
    case, curves = pendulum
    exact = evaluate(case, "dynamics", curves.x - 0.9 * np.ptp(curves.x), None)
    residuals = Residuals(case, "dynamics", "mujoco", replace(curves, channels=exact.channels))
    assert not [c for c in shift_causes(residuals) if c.free == 2]


@pytest.mark.parametrize(
    ("key", "wrong"),
    [("rocker", 2.4), ("ground", 3.3), ("crank", 0.93), ("point_along", 1.2), ("gravity", 9.7),
     ("coupler_mass", 5.0)],
)  # fmt: skip
def test_a_parameter_is_found_with_its_uncertainty(fourbar, key, wrong):
    case, curves = fourbar
    right = case.parameters[key]
    other = case.model_copy(update={"parameters": {**case.parameters, key: wrong}})
    cause = first(Residuals(other, "sweep", "mujoco", curves))
    assert cause.complete
    assert cause.left < 1e-12
    fault = cause.fault
    assert (fault.file, fault.name, fault.wrong, fault.right) == (case.file, key, wrong, right)
    assert (cause.kind, cause.free) == ("parameter", 1)
    assert cause.words.endswith(f" ({100 * (right / wrong - 1):+.4g} %)")
    # a change by `within` moves the most sensitive curve by its tolerance
    residuals = Residuals(case, "sweep", "mujoco", curves)
    moved = residuals.at({key: right + 1e3 * fault.within})
    moves = max(np.abs(y).max() for y in moved.values())
    assert 3e2 < moves < 3e3  # the tolerance is a share of the range, which changes with the value


def test_the_sign_of_a_parameter_is_named_beside_that_of_a_channel(fourbar):
    case, curves = fourbar
    other = case.model_copy(update={"parameters": {**case.parameters, "gravity": -9.81}})
    cause = first(Residuals(other, "sweep", "mujoco", curves))
    assert cause.words == "holding_moment with the opposite sign"
    assert "gravity -9.81 m/s² → 9.81 m/s²" in cause.same


def test_another_assembly_mode_is_found(fourbar):
    case, curves = fourbar
    other = case.model_copy(update={"parameters": {**case.parameters, "mode": -1.0}})
    residuals = Residuals(other, "sweep", "mujoco", curves)
    cause = first(residuals)
    assert cause.words == "mode -1 → +1"
    assert cause.sentence.endswith(": mode is -1; with +1 all 17 curves agree")
    assert cause.fault.instead.startswith("mode = ")
    assert "other assembly modes" in residuals.log.tried
    assert not any(words.startswith("each parameter") for words in residuals.log.tried)


def test_two_parameters_are_found_where_one_does_not_explain_all(fourbar):
    from proofmass.evidence.diagnosis.causes import fitted_pairs

    case, curves = fourbar
    changed = {"rocker": 2.52, "coupler_mass": 2.3}
    other = case.model_copy(update={"parameters": {**case.parameters, **changed}})
    residuals = Residuals(other, "sweep", "mujoco", curves)
    causes = causes_of_reference(residuals)
    assert not any(c.complete for c in causes)
    found = best_causes([*causes, *fitted_pairs(residuals)])
    (best,) = (c for c in found if c.complete)
    assert (best.kind, best.free) == ("pair of parameters", 3)
    assert best.complete
    assert {f.name: f.right for f in best.faults} == {"rocker": 2.5, "coupler_mass": 2.0}
    assert "pairs of parameters of the reference" in residuals.log.tried


def make_residuals(fourbar, largest: float) -> Residuals:
    """Residuals with one channel that differs by so many times its tolerance."""
    return spoilt_by(fourbar, "pin.x", largest)


def spoilt_by(fourbar, channel: str, times: float) -> Residuals:
    case, curves = fourbar
    whole = Residuals(case, "sweep", "mujoco", curves)
    y = curves.channels[channel].copy()
    y[5] += times * whole.allowed[channel]
    channels = {**curves.channels, channel: y}
    return Residuals(case, "sweep", "mujoco", replace(curves, channels=channels))


@pytest.mark.parametrize(
    ("before", "after", "agrees"),
    [
        (100.0, 1.9, True), (100.0, 2.1, False),  # twice the tolerance
        (1e5, 99.0, True), (1e5, 101.0, False),  # a thousandth of the difference
        (3.0, 1.4, True), (3.0, 1.6, False),  # half of a small difference
    ],
)  # fmt: skip
def test_a_channel_agrees_within_twice_its_tolerance_or_a_thousandth(
    fourbar, before, after, agrees
):
    residuals = make_residuals(fourbar, before)
    assert residuals.differing == ("pin.x",)
    left = np.zeros(9)
    left[3] = -after
    assert residuals.agrees("pin.x", left) == agrees
    assert residuals.agrees("pin.y", left) == (after <= 2.0)


@pytest.mark.parametrize(("times", "differs"), [(0.9, False), (1.1, True)])
def test_a_channel_differs_beyond_its_tolerance(fourbar, times, differs):
    assert bool(make_residuals(fourbar, times).differing) == differs


def test_what_is_left_is_that_of_the_explained_channels():
    before = {"a": np.array([3.0, 4.0]), "b": np.array([1.0, 1.0])}
    after = {"a": np.array([0.3, 0.4]), "b": np.array([1.0, 1.0])}
    assert rms(before) == pytest.approx(np.sqrt(27 / 4))
    assert rms(before, ["a"]) == pytest.approx(np.sqrt(25 / 2))
    assert rms(before, ["a"], 1) == 3.0
    assert remaining_share(before, after, ["a"]) == pytest.approx(0.1)
    assert remaining_share(before, after, ()) == pytest.approx(np.sqrt(2.25 / 27))
    assert remaining_share(before, {"b": after["b"] / 2}, ["b"]) == pytest.approx(0.5)


def test_a_judged_cause_names_what_it_explains_and_breaks(fourbar):
    residuals = make_residuals(fourbar, 100.0)
    n = residuals.before["pin.x"].size
    after = {"pin.x": np.zeros(n), "pin.y": np.full(n, 3.0), "rocker": np.ones(n)}
    cause = residuals.judged("kind", "words", after, 2, {"a": (1.0, 2.0)})
    assert (cause.explains, cause.breaks) == (("pin.x",), ("pin.y",))
    assert (cause.left, cause.differing, cause.free) == (0.0, 1, 2)
    assert cause.changes == {"a": (1.0, 2.0)}
    assert residuals.judged("kind", "words", {}).explains == ()


def test_a_budget_is_counted():
    budget = SearchBudget(10.0, 3.0)
    assert budget.lasts
    budget.spend()
    budget.spend()
    assert (budget.spent, budget.lasts) == (6.0, True)
    with budget.share(1):
        assert budget.lasts
        budget.spend()
        assert not budget.lasts
    assert budget.most == 10.0
    assert not budget.lasts
    small = SearchBudget(10.0)
    with small.share(20):
        assert small.most == 10.0
    assert (small.cost, small.spent) == (1.0, 0.0)


def test_a_log_has_what_was_tried_and_what_was_not():
    log = SearchLog()
    log.note("number of the model", 3, 3)
    log.note("load", 1, 1)
    log.note("sign", 2, 5)
    log.note("gear", 0, 2)
    log.note("axis", 0, 0)
    assert log.tried == ["each number of the model", "the load", "2 of 5 signs"]
    assert log.untried == ["3 of 5 signs", "2 of 2 gears"]


@pytest.mark.parametrize(
    ("kind", "steps", "size"),
    [("dynamics", 100, 300.0), ("sweep", 100, 6000.0), ("equilibrium", 1, 300.0),
     ("dynamics", 0, 3.0)],
)  # fmt: skip
def test_the_size_of_a_run_is_steps_times_degrees_of_freedom(fourbar, kind, steps, size):
    assert run_steps(fourbar[0], kind, steps) == size  # three joints


def test_a_long_run_is_not_made_again(fourbar):
    case, curves = fourbar
    for steps, again in ((1000, True), (1001, False)):  # 60 a pose
        residuals = Residuals(case, "sweep", "mujoco", replace(curves, steps=steps))
        assert residuals.can_run_again == again
    recorded = Residuals(case, "sweep", "mujoco", curves)
    recorded.solver = "recorded:rig"
    assert not recorded.can_run_again


@pytest.mark.parametrize(
    ("key", "stated", "fitted", "model"),
    [
        ("rocker", 2.5, 2.525, True),  # the model has more digits
        ("rocker", 2.525, 2.5, False),  # the sidecar has more than the model and than usual
        ("rocker", 4.0, 2.0, True),  # as many: the model is what is tested
        ("ground", 2.7, 3.0, False),
        ("gravity", 9.81, 9.8, False),
    ],
)
def test_the_side_with_unusual_digits_is_taken_to_be_wrong(fourbar, key, stated, fitted, model):
    cause = Explanation("parameter", "", (), (), 0.0, 1, 1, {key: (stated, fitted)})
    assert is_model_wrong(fourbar[0], cause) == model


def make_cause(**fields) -> Explanation:
    given = {"kind": "parameter", "words": "", "explains": ("a",), "breaks": (), "left": 0.0,
             "differing": 1, "free": 1}  # fmt: skip
    return Explanation(**{**given, **fields})


def test_exact_and_clear_causes():
    assert is_exact(make_cause(left=1e-6))
    assert not is_exact(make_cause(left=1.1e-6))
    assert not is_exact(make_cause(differing=2))
    assert is_clear(make_cause(left=1e-3))
    assert not is_clear(make_cause(left=1.1e-3))
    assert is_clear(make_cause(left=0.3, free=0))
    assert not is_clear(make_cause(free=2))
    assert not is_clear(make_cause(free=0, differing=2))


def test_exact_causes_are_sorted_by_places_digits_and_change():
    one = make_cause(changes={"a": (1.0, 2.0)})
    digits = make_cause(changes={"a": (1.0, 2.25)})
    larger = make_cause(changes={"a": (1.0, 3.0)})
    two = make_cause(faults=(None, None), changes={"a": (1.0, 2.0)})
    rough = make_cause(left=1e-3)
    assert sorted([rough, two, larger, digits, one], key=sort_key) == [
        one, larger, digits, two, rough,
    ]  # fmt: skip
    assert sort_key(make_cause(left=1e-9))[1] == 1e-6


@pytest.mark.parametrize(
    ("last", "told"), [(0, True), (99, True), (100, True), (101, False), (1000, False)]
)
def test_a_transient_ends_within_a_tenth_of_the_run(pendulum, last, told):
    case, curves = pendulum
    y = curves.channels["angle"].copy()
    y[: last + 1] += 0.1
    channels = {**curves.channels, "angle": y}
    residuals = Residuals(case, "dynamics", "mujoco", replace(curves, channels=channels))
    words = [*describe_transient(residuals)]
    assert bool(words) == told
    if told:
        share = 100 * last / 1000
        assert words == [
            f"a start transient: no curve is outside its tolerance after "
            f"{curves.x[last]:.4g} s, {share:.2g} % of the run"
        ]


def test_a_channel_falls_to_six_tenths(fourbar):
    residuals = make_residuals(fourbar, 100.0)
    n = residuals.before["pin.x"].size
    assert falling_channels(residuals, {"pin.x": np.full(n, -59.9)}) == ("pin.x",)
    assert falling_channels(residuals, {"pin.x": np.full(n, 60.1)}) == ()
    assert falling_channels(residuals, {"pin.y": np.zeros(n)}) == ()


def test_settings_are_numbers_or_texts():
    assert [setting_value(v) for v in (3, 0.5, True, "rk4", (1, 2))] == [
        3.0, 0.5, "True", "rk4", "(1, 2)",
    ]  # fmt: skip


def test_the_channel_that_leaves_its_tolerance_first_is_named(pendulum):
    case, curves = pendulum
    channels = dict(curves.channels)
    for name, k in (("angle", 40), ("rate", 30)):
        channels[name] = channels[name].copy()
        channels[name][k:] += 1.0
    (words,) = describe_first_error(case, "dynamics", "mujoco", replace(curves, channels=channels))
    assert words == f"rate left the tolerance first, at x = {curves.x[30]:.4g}"
    (none,) = describe_first_error(case, "dynamics", "mujoco", curves)
    assert none == f"no channel left its tolerance until x = {curves.x[-1]:.4g}"


@pytest.mark.parametrize(
    ("sizes", "since"),
    [([1e-9, 1e-9, 1e-6, 1e-5], 2), ([1e-6, 1e-5, 9e-5, 1e-4], 1), ([0.0, 0.0, 0.0, 0.0], None),
     ([1e-5, 1e-5, 1e-5, 1e-5], None)],
)  # fmt: skip
def test_a_tenfold_growth_of_the_violation_is_told(pendulum, sizes, since):
    _, curves = pendulum
    first_four = replace(curves.first(4), violations=np.array(sizes))
    words = [*describe_violation(first_four)]
    if since is None:
        assert words == []
    else:
        x = first_four.x
        (told,) = words
        assert told.endswith(f"from x = {x[since]:.4g} to {x[3]:.4g}")
        assert "grew tenfold, to 1e-" in told
    assert [*describe_violation(replace(first_four, violations=None))] == []


@pytest.mark.parametrize("scale", [1e-2, 1.0, 1e2])
@pytest.mark.parametrize(("turn", "is_open"), [(1e-7, False), (1e-5, True)])
def test_a_start_is_open_by_a_share_of_the_size_of_the_mechanism(scale, turn, is_open, tmp_path):
    """The rocker of 2.5 m is turned in the start pose, and the whole four-bar is scaled."""

    def scaled(found: re.Match) -> str:
        numbers = " ".join(repr(scale * float(word)) for word in found[2].split())
        return f'{found[1]}="{numbers}"'

    case = load_case(shipped("fourbar.toml"))
    text = case.model_path.read_text(encoding="utf-8")
    text = re.sub(r'\b(pos|fromto)="([^"]*)"', scaled, text)
    text = text.replace("2.2459278597319283", repr(2.2459278597319283 + turn))
    (tmp_path / "fourbar.xml").write_text(text, encoding="utf-8")
    remarks = list(describe_start(case.model_copy(update={"file": tmp_path / "fourbar.toml"})))
    gaps = [float(re.search(r"are open by (\S+) m in the start pose", one)[1]) for one in remarks]
    assert gaps == ([pytest.approx(2.5 * turn * scale, rel=0.03)] if is_open else [])
