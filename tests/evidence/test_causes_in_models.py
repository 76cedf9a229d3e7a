"""Causes in a model and in the settings of an engine, on motions of 0.2 s that MuJoCo runs in 5 ms.

The faults are planted in the files of the pendulum, or in the settings of a variant of MuJoCo.
"""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from proofmass.case.case import Case
from proofmass.evidence.diagnosis import fit, settings
from proofmass.evidence.diagnosis.causes import (
    causes_of_model,
    find_causes,
    parameter_sign_causes,
    with_mirrors,
)
from proofmass.evidence.diagnosis.explanation import Diagnosis, Explanation
from proofmass.evidence.diagnosis.failure import (
    Reason,
    describe_shorter_steps,
    describe_stability,
)
from proofmass.evidence.diagnosis.fit import ModelResiduals, Residuals, SearchBudget, rms
from proofmass.evidence.diagnosis.model import (
    ChangedModel,
    changed_model,
    confirm_cause,
    differences_with,
    is_same_run,
    mirrored_cause,
    rebound_causes,
    sign_causes,
)
from proofmass.evidence.diagnosis.settings import (
    agreeing_run,
    deciding_settings,
    differing_settings,
    finer_causes,
    run_finer,
    setting_changes,
    sibling_causes,
    with_settings,
    with_settings_of,
)
from proofmass.reference.evaluate import evaluate
from proofmass.reference.samples import run_samples
from proofmass.run.sidecar import load_case
from proofmass.run.solve import solve_here
from proofmass.sim.protocol.failures import Diverged
from tests.shipped import shipped

TOLERANCE = '[[tolerance]]\nrelative_to_range = 1e-6\nwhy = "w"\n'
CENTRE = 'pos="0 -1 0" mass="1"'
BAD = "mujoco:bad"
ShortCase = Callable[..., Case]


@pytest.fixture
def short(tmp_path: Path) -> ShortCase:
    """Write 0.2 s of the pendulum with edits of its files, each (old text, new text)."""

    def write(*edits: tuple[str, str], **given: dict[str, object]) -> Case:
        files = {ending: shipped(f"pendulum.{ending}").read_text() for ending in ("xml", "toml")}
        text = files["toml"].partition("[[tolerance]]")[0] + TOLERANCE
        text = text.replace("until = 10.0", "until = 0.2").replace("n = 1001", "n = 21")
        head, _, tail = text.partition("solvers = [")
        solvers = ", ".join(f'"{one}"' for one in ("mujoco", *given))
        files["toml"] = f"{head}solvers = [{solvers}]{tail.partition(']')[2]}"
        for old, new in edits:
            (ending,) = (name for name, text in files.items() if old in text)
            files[ending] = files[ending].replace(old, new)
        for ending, text in files.items():
            (tmp_path / f"pendulum.{ending}").write_text(text)
        case = load_case(tmp_path / "pendulum.toml")
        return case.model_copy(update={"settings": {**case.settings, **given}})

    return write


def residuals_of(case: Case, solver: str = "mujoco") -> Residuals:
    return Residuals(case, "dynamics", solver, solve_here(case, "dynamics", solver))


def diagnose(case: Case, solver: str = "mujoco", thorough: bool = True) -> Diagnosis:
    return find_causes(
        case, "dynamics", solver, solve_here(case, "dynamics", solver), thorough=thorough
    )


def model_of(residuals: Residuals) -> ChangedModel:
    model = changed_model(residuals)
    assert model
    return model


# Numbers of the model


def test_the_number_of_the_model_that_equals_the_fitted_parameter_is_named(short):
    residuals = residuals_of(short((CENTRE, CENTRE.replace("-1 ", "-1.01 "))))
    model = model_of(residuals)
    length = Explanation(
        "parameter", "", ("angle",), (), 0.1, 5, 1, {"length": (1.0, 1.01 * (1 + 9e-6))}
    )
    found = mirrored_cause(model, length)
    assert found
    assert (found.kind, found.free, found.complete) == ("number of the model", 1, True)
    assert found.sentence == (
        "pendulum.xml, line 12: centre of mass of bob y is -1.01 m; with -1 m all 5 curves agree"
    )
    assert found.changes == {"centre of mass of bob y": (-1.01, -1.0)}
    ((number, change),) = found.edits
    assert (number.name, change) == ("centre of mass of bob y", pytest.approx(0.01))
    assert found.left < 1e-10
    assert model.budget.spent == model.budget.cost
    assert mirrored_cause(model, replace(length, changes={"length": (1.0, 1.01 * 1.00002)})) is None
    assert mirrored_cause(model, replace(length, changes={"length": (1.0, 0.0)})) is None
    assert mirrored_cause(model, replace(length, changes={"length": (0.0, 1.01)})) is None
    better = replace(length, explains=tuple("abcdef"))
    assert mirrored_cause(model, better) is None
    model.budget = SearchBudget(0.0)
    assert mirrored_cause(model, length) is None


def test_a_fitted_value_of_the_other_sign_is_mirrored_too(short):
    """The model has the length as -1.01; a fit of +1.01 and one of -1.01 both name it."""
    model = model_of(residuals_of(short((CENTRE, CENTRE.replace("-1 ", "-1.01 ")))))
    for stated, fitted, right in ((1.0, 1.01, -1.0), (-1.0, -1.01, -1.0), (1.0, -1.01, 1.0)):
        cause = Explanation("parameter", "", (), ("a",) * 9, 0.1, 5, 1, {"l": (stated, fitted)})
        found = mirrored_cause(model, cause)
        assert found
        assert found.changes == {"centre of mass of bob y": (-1.01, right)}


def test_a_parameter_that_explains_as_much_is_told_as_the_same(short):
    """The gravity of the model has more digits, so that the model is taken to be wrong."""
    told = (
        "pendulum.xml, line 5: gravity y is -9.805 m/s²; with -9.81 m/s² all 5 curves agree",
        "pendulum.toml, line 8: gravity is 9.81 m/s²; with 9.805 m/s² all 5 curves agree",
    )
    found = diagnose(short(("0 -9.81 0", "0 -9.805 0")))
    assert (found.causes[0].sentence, *found.causes[0].same) == told
    assert len([c for c in found.causes if c.complete]) == 1


def test_the_sidecar_is_wrong_where_its_value_has_more_digits(short):
    found = diagnose(short(("gravity = 9.81", "gravity = 9.8123")))
    assert found.causes[0].sentence.startswith(
        "pendulum.toml, line 8: gravity is 9.8123 m/s²; with 9.81 m/s²"
    )
    assert len(found.causes[0].same) == 1


def test_the_mirror_of_the_best_parameter_comes_first_if_it_explains_more(short):
    residuals = residuals_of(short((CENTRE, CENTRE.replace("-1 ", "-1.01 "))))
    model = model_of(residuals)
    four = ("angle", "rate", "acceleration", "kinetic")
    length = Explanation("parameter", "l", four, (), 0.0, 5, 1, {"length": (1.0, 1.01)})
    worse = replace(length, explains=four[:1], changes={"mass": (1.0, 2.0)})
    none = replace(length, explains=(), changes={"amplitude": (1.0, 2.0)})
    other = replace(length, kind="shift", explains=four[:3], changes={})
    causes = with_mirrors(model, [none, other, worse, length])
    assert causes[0].kind == "number of the model"
    assert causes[1:] == [none, other, worse, length]
    assert with_mirrors(model, [none, other]) == [none, other]
    assert with_mirrors(model, [worse]) == [worse]


def test_a_number_that_no_parameter_equals_is_fitted(short):
    """The centre of mass lies 10 mm aside, which an anchor 10 mm aside explains exactly."""
    found = diagnose(short((CENTRE, 'pos="0.01 -1 0" mass="1"')))
    best = found.causes[0]
    assert best.sentence == (
        "pendulum.xml, line 11: anchor of joint pivot x is 0 m; with 0.01 m all 5 curves agree"
    )
    assert (best.kind, best.free) == ("number of the model", 1)
    ((number, change),) = best.edits
    assert (number.kind, change) == ("anchor", pytest.approx(0.01, rel=1e-9))
    assert "each number of the model" in found.tried
    quick = diagnose(short((CENTRE, 'pos="0.01 -1 0" mass="1"')), thorough=False)
    assert "each number of the model" not in quick.tried
    assert not quick.causes[0].complete


def test_damping_that_should_not_be_there_is_zero(short):
    found = diagnose(short(('<joint name="pivot"/>', '<joint name="pivot" damping="0.05"/>')))
    assert found.causes[0].sentence == (
        "pendulum.xml, line 11: damping of pivot is 0.05 N·m·s; with 0 N·m·s all 5 curves agree"
    )


def test_runs_with_other_numbers_are_those_of_the_engine(short):
    case = short((CENTRE, CENTRE.replace("-1 ", "-1.01 ")))
    curves = solve_here(case, "dynamics", "mujoco")
    runs = ModelResiduals(case, "dynamics", "mujoco", curves)
    name = "centre of mass of bob y"
    assert runs.kind == "number of the model"
    assert runs.repeats()
    assert runs.parameters[name] == -1.01
    assert runs.sizes[name] == 1.01
    anchor = "anchor of joint pivot x"
    assert (runs.parameters[anchor], runs.sizes[anchor]) == (0.0, 10 * runs.numbers[anchor].step)
    assert not {n.kind for n in runs.numbers.values()} & {"inertia", "softness of the stop"}
    assert runs.edits({name: -1.0}) == ((runs.numbers[name], pytest.approx(0.01)),)
    after = runs.at({name: -1.0})
    assert set(after) == {"angle", "rate", "acceleration", "kinetic", "potential"}
    assert rms(after) < 1e-4 < 1.0 < rms(runs.before)
    assert runs.budget.spent == 2 * runs.budget.cost == 2 * 200 * 1
    assert runs.at({"mass of bob": -1.0}) == {}  # it does not compile
    assert runs.fault(name, -1.0).sentence("x").endswith("is -1.01 m; with -1 m x")
    angle = {**curves.channels, "angle": curves.channels["angle"] + 1e-3}
    others = ModelResiduals(case, "dynamics", "mujoco", replace(curves, channels=angle))
    assert not others.repeats()


def test_a_sweep_is_fitted_with_some_of_its_samples():
    case = load_case(shipped("fourbar.toml"))
    curves = solve_here(case, "sweep", "mujoco")
    runs = ModelResiduals(case, "sweep", "mujoco", curves)
    assert runs.stride == curves.x.size // 48 == 7
    for known in (runs.before, runs.curve, runs.reference):
        assert {y.size for y in known.values()} == {-(-curves.x.size // 7)}
    assert runs.budget.cost == pytest.approx(runs.steps / 7)


def test_a_run_that_is_made_again_is_the_same_to_a_thousandth(short):
    residuals = residuals_of(short(("0 -9.81 0", "0 -9.805 0")))
    assert is_same_run(residuals, differences_with(residuals, ()))
    assert is_same_run(residuals, {n: 1.0009 * y for n, y in residuals.before.items()})
    assert not is_same_run(residuals, {n: 1.0011 * y for n, y in residuals.before.items()})
    assert not is_same_run(residuals, {})
    residuals.before = {n: 2.0 * y for n, y in residuals.before.items()}
    assert changed_model(residuals) is None  # curves of another model
    residuals.solver = "recorded:rig"
    assert changed_model(residuals) is None
    assert residuals.log.untried == []


def test_a_run_that_is_too_long_is_not_made_again(short):
    residuals = residuals_of(short(("0 -9.81 0", "0 -9.805 0")))
    residuals.curves = replace(residuals.curves, steps=60_001)
    assert changed_model(residuals) is None
    assert residuals.log.untried == ["numbers of the model, since a run takes too many steps"]


# Signs


def test_the_sign_of_gravity_is_named(short):
    residuals = residuals_of(short(("0 -9.81 0", "0 9.81 0")))
    model = model_of(residuals)
    gravity, *axes = sign_causes(model)
    assert gravity.sentence == (
        "pendulum.xml, line 5: gravity y is 9.81 m/s²; with -9.81 m/s² all 4 curves agree"
    )
    assert (gravity.kind, gravity.free, gravity.changes) == ("sign", 0, {})
    ((number, change),) = gravity.edits
    assert (number.of, change) == ("y", -19.62)
    assert [c.faults[0].name for c in axes] == ["axis of joint pivot z"]
    assert residuals.log.tried == [
        "each sign of gravity, of a spring, a load, a gear or an axis in the model"
    ]
    model.budget = SearchBudget(1.0)
    assert len([*sign_causes(model)]) == 1
    assert residuals.log.untried == [
        "1 of 2 signs of gravity, of a spring, a load, a gear or an axis in the model"
    ]


def test_the_signs_of_parameters_that_are_tried_are_counted(short):
    residuals = residuals_of(short())
    *_, amplitude = parameter_sign_causes(residuals)
    assert amplitude.changes == {"amplitude": (-np.pi / 2, np.pi / 2)}
    assert (amplitude.kind, amplitude.free) == ("sign", 0)
    residuals.budget = SearchBudget(2.0)
    assert len([*parameter_sign_causes(residuals)]) <= 2
    assert residuals.log.tried == [
        "each sign of a parameter of the reference",
        "2 of 4 signs of a parameter of the reference",
    ]
    assert residuals.log.untried == ["2 of 4 signs of a parameter of the reference"]


def test_a_spring_has_a_sign_as_well(short):
    spring = '<joint name="pivot" stiffness="2" springref="0.5"/>'
    model = model_of(residuals_of(short(('<joint name="pivot"/>', spring))))
    found = [fault.name for cause in sign_causes(model) for fault in cause.faults]
    assert found == [
        "gravity y", "stiffness of pivot", "rest angle of pivot", "axis of joint pivot z",
    ]  # fmt: skip


def test_a_clear_cause_ends_the_search_in_the_model(short):
    model = model_of(residuals_of(short(("0 -9.81 0", "0 9.81 0"))))
    clear = Explanation("parameter", "", ("a",), (), 1e-4, 1, 1)
    assert causes_of_model(model, [clear], True) == []
    assert causes_of_model(model, [replace(clear, free=0)], True) != []
    signs = causes_of_model(model, [], True)
    assert [c.kind for c in signs] == ["sign", "sign"]  # one is complete: no number is fitted
    assert "each number of the model" not in model.residuals.log.tried


# Stops

STOP = """<mujoco model="stop"><compiler angle="radian"/>
  <option timestep="1e-3" gravity="0 -9.81 0"><flag contact="disable"/></option>
  <worldbody><body name="bob">
    <joint name="hinge" range="-0.8 1" limited="true" solreflimit="0.004 {ratio}"/>
    <inertial pos="1 0 0" mass="1" diaginertia="0.1 0.1 0.1"/>
  </body></worldbody>
  <sensor><jointpos name="angle" joint="hinge"/></sensor>
  <keyframe><key name="start" qpos="-0.3"/></keyframe></mujoco>"""
STOPPED = """title = "t"
source = "s"
reference = "planar"
[run.dynamics]
until = 0.6
n = 61
solvers = ["pymunk", "mujoco"]
[[tolerance]]
abs = {most}
why = "w"
"""
NO_REBOUND = (
    "stop.xml, line 4: softness of the stop of hinge, solref 2 is 0.2; with 10 (no rebound) "
    "the curve agrees"
)


def write_stop(folder: Path, ratio: float = 0.2, most: float = 0.02) -> Case:
    (folder / "stop.xml").write_text(STOP.format(ratio=ratio))
    (folder / "stop.toml").write_text(STOPPED.format(most=most))
    return load_case(folder / "stop.toml")


def test_stops_without_a_rebound_are_the_cause_in_pymunk(tmp_path):
    """Chipmunk's limits have no rebound; the reference rebounds by the damping ratio of 0.2."""
    case = write_stop(tmp_path)
    found = diagnose(case, "pymunk")
    assert found.differing == ("angle",)
    assert found.causes[0].sentence == NO_REBOUND
    assert (found.causes[0].kind, found.causes[0].free) == ("rebound", 0)
    ((number, change),) = found.causes[0].edits
    assert (number.value, change) == (0.2, 9.8)
    assert "stops without a rebound" in found.tried


def test_an_engine_that_rebounds_has_another_cause(tmp_path):
    """MuJoCo rebounds too, later by the time constant of the stop; without a rebound both agree."""
    case = write_stop(tmp_path)
    found = diagnose(case, "mujoco")
    assert found.differing == ("angle",)
    assert "stops without a rebound" in found.tried
    assert "rebound" not in {cause.kind for cause in found.causes}


def test_stops_that_do_not_rebound_are_no_cause(tmp_path):
    residuals = residuals_of(write_stop(tmp_path, ratio=10.0, most=1e-5), "pymunk")
    assert residuals.differing
    assert [*rebound_causes(model_of(residuals))] == []
    assert residuals.log.tried == []
    rebounding = model_of(residuals_of(write_stop(tmp_path), "pymunk"))
    spent = rebounding.budget.spent
    assert len([*rebound_causes(rebounding)]) == 1
    assert rebounding.budget.spent - spent == 2 * rebounding.budget.cost
    rebounding.budget = SearchBudget(0.0)
    assert [*rebound_causes(rebounding)] == []


# Causes of another run


def test_a_cause_of_one_run_is_confirmed_in_another(short):
    case = short(("0 -9.81 0", "0 -9.805 0"), **{"mujoco:fine": {"timestep": 5e-4}})
    cause = diagnose(case).causes[0]
    found = confirm_cause(case, "dynamics", "mujoco:fine", cause)
    assert found
    assert (found.kind, found.words, found.free) == (cause.kind, cause.words, cause.free)
    assert (found.changes, found.faults, found.edits) == (cause.changes, cause.faults, cause.edits)
    assert found.complete
    ((number, change),) = cause.edits
    half = replace(cause, edits=((number, change / 2),))
    assert confirm_cause(case, "dynamics", "mujoco:fine", half) is None
    failing = replace(cause, edits=((number, float("nan")),))
    assert confirm_cause(case, "dynamics", "mujoco:fine", failing) is None


# Settings


@pytest.fixture
def euler(short) -> Case:
    """Euler's method in a variant, where the model and the other run have Runge-Kutta's."""
    return short(**{BAD: {"integrator": "Euler"}})


def test_the_setting_of_a_run_that_agrees_is_the_cause(euler):
    found = diagnose(euler, BAD, thorough=False)
    assert found.causes[0].sentence == (
        f"pendulum.toml: integrator of {BAD} is EULER; with RK4 (as in mujoco) all 3 curves agree"
    )
    assert found.causes[0].kind == "setting"
    assert "each setting in which mujoco differs" in found.tried
    assert found.causes[1].words == "a time step of 5e-4 s, not 1e-3 s (error of order 1)"


def test_settings_that_differ_are_those_of_the_engine_that_both_used(euler):
    residuals = residuals_of(euler, BAD)
    agreeing = agreeing_run(residuals, "mujoco")
    assert agreeing
    assert differing_settings(residuals, agreeing) == {"integrator": "RK4"}
    more = {**agreeing.settings, "unknown": 1, "iterations": 7}
    assert differing_settings(residuals, replace(agreeing, settings=more)) == {
        "integrator": "RK4", "iterations": 7,
    }  # fmt: skip
    less = {k: v for k, v in residuals.curves.settings.items() if k != "integrator"}
    residuals.curves = replace(residuals.curves, settings=less)
    assert differing_settings(residuals, agreeing) == {}
    assert agreeing_run(residuals, BAD) is None
    broken = with_settings(euler, "mujoco:broken", {"timestep": -1.0})
    assert agreeing_run(Residuals(broken, "dynamics", BAD, agreeing), "mujoco:broken") is None


def test_as_few_settings_as_possible_are_named(short):
    """Euler's method and a step of 2 ms: with one of them right, the other one is still wrong."""
    own = {"integrator": "Euler", "timestep": 0.005, "tolerance": 1e-7, "iterations": 50}
    residuals = residuals_of(short(**{BAD: own}), BAD)
    agreeing = agreeing_run(residuals, "mujoco")
    assert agreeing
    budget = SearchBudget(100.0)
    (cause,) = deciding_settings(residuals, "mujoco", agreeing, budget)
    assert cause.complete
    assert [fault.name for fault in cause.faults] == [f"integrator of {BAD}"]
    assert budget.spent == 2  # the time step by itself is tried first
    (wrong, right), note = cause.faults[0].values, cause.faults[0].note
    assert (wrong, right, note) == ("EULER", "RK4", "as in mujoco")
    (rough,) = deciding_settings(residuals, "mujoco", agreeing, SearchBudget(0.0))
    assert len(rough.faults) == 4


def test_two_settings_that_decide_together_are_one_cause(short, monkeypatch):
    own = {"integrator": "Euler", "timestep": 0.005, "tolerance": 1e-7}
    residuals = residuals_of(short(**{BAD: own}), BAD)
    agreeing = agreeing_run(residuals, "mujoco")
    assert agreeing

    def pretend(_residuals, other, changes):
        both = {"integrator", "timestep"} <= changes.keys()
        explains = residuals.differing if both else ()
        return Explanation(
            "setting", " ".join(changes), explains, (), 0.0, len(residuals.differing)
        )

    monkeypatch.setattr(settings, "with_settings_of", pretend)
    (cause,) = deciding_settings(residuals, "mujoco", agreeing, SearchBudget(100.0))
    assert sorted(cause.words.split()) == ["integrator", "timestep"]
    same = replace(agreeing, settings=residuals.curves.settings)
    assert [*deciding_settings(residuals, "mujoco", same, SearchBudget(100.0))] == []


def test_a_run_with_other_settings_is_judged_or_fails(euler):
    residuals = residuals_of(euler, BAD)
    found = with_settings_of(residuals, "mujoco", {"integrator": "RK4", "timestep": 5e-4})
    assert found
    assert found.words == (
        f"integrator of {BAD} EULER → RK4 (as in mujoco) and timestep of {BAD} 0.001 → 0.0005 "
        "(as in mujoco)"
    )
    assert with_settings_of(residuals, "mujoco", {"timestep": -1.0}) is None


def test_runs_of_the_same_engine_are_compared_until_the_budget_is_spent(euler, monkeypatch):
    residuals = residuals_of(euler, BAD)
    (cause,) = sibling_causes(residuals)
    assert cause.complete
    assert residuals.log.tried == ["each setting in which mujoco differs"]
    monkeypatch.setattr(settings, "MAX_SETTING_STEPS", 199)
    assert [*sibling_causes(residuals)] == []
    assert residuals.log.untried == ["the settings of mujoco"]
    monkeypatch.setattr(settings, "MAX_SETTING_STEPS", 200)
    assert len([*sibling_causes(residuals)]) == 1
    monkeypatch.setattr(settings, "agreeing_run", None)  # no run is made in an equilibrium
    residuals.run = "equilibrium"
    residuals.case = euler.model_copy(update={"run": {"equilibrium": euler.run["dynamics"]}})
    assert [*sibling_causes(residuals)] == []


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"integrator": "Euler", "timestep": 0.002}, "w, makes the error 2 times as large"),
        ({"integrator": "Euler"}, "w, leaves the error as it is"),
        ({"timestep": -1.0}, "with w, the run fails: "),
        ({"integrator": "RK4"}, "of the error, less than any order explains"),
    ],
)
def test_a_finer_run_that_helps_not_is_a_remark(euler, changed, words):
    cause, told = run_finer(residuals_of(euler, BAD), "w,", with_settings(euler, BAD, changed))
    assert cause is None
    assert words in told


def test_half_the_time_step_halves_the_error_of_euler(euler):
    residuals = residuals_of(euler, BAD)
    ((cause, told),) = finer_causes(residuals)
    assert told == ""
    assert cause
    assert cause.words == "a time step of 5e-4 s, not 1e-3 s (error of order 1)"
    assert (cause.kind, cause.explains, cause.breaks) == ("finer", residuals.differing, ())
    assert cause.left == pytest.approx(0.5, rel=1e-2)
    assert cause.differing == len(residuals.differing) == 3
    assert setting_changes(residuals) == []  # no loops and no iterations that count
    residuals.curves = replace(residuals.curves, steps=60_001)
    assert [*finer_causes(residuals)] == []
    assert setting_changes(residuals) == []


def test_rods_get_twice_as_many_segments(monkeypatch):
    case = load_case(shipped("rod_cantilever.toml"))
    curves = evaluate(case, "equilibrium", run_samples(case, "equilibrium"), None)
    residuals = Residuals(case, "equilibrium", "mujoco", curves)
    asked = []
    monkeypatch.setattr(
        settings, "run_finer", lambda _, words, changed: asked.append((words, changed))
    )
    assert len([*finer_causes(residuals)]) == 1
    ((words, changed),) = asked
    assert words == "twice as many segments"
    assert changed.rod
    for name, rod in changed.rod.items():
        assert rod.segments == 2 * case.rod[name].segments


def test_the_run_of_a_changed_case_is_compared_at_the_tolerances_of_the_case(euler):
    residuals = residuals_of(euler, BAD)
    after = residuals.with_changed_case(with_settings(euler, BAD, {"integrator": "RK4"}))
    assert set(after) == set(residuals.allowed)
    assert rms(after) < 1e-2
    right = evaluate(euler, "dynamics", residuals.curves.x, residuals.curves.drive).channels
    assert np.allclose(residuals.reference["angle"], right["angle"] / residuals.allowed["angle"])


# Failed runs


def test_a_shorter_step_with_which_a_run_ends_is_looked_for(short, monkeypatch):
    case = short()
    curves = solve_here(case, "dynamics", "mujoco")
    asked = []

    def fail_until(last):
        def run(changed, kind, solver):
            step = changed.settings["mujoco"]["timestep"]
            asked.append(step)
            if step > last:
                raise Diverged("failed")

        monkeypatch.setattr("proofmass.evidence.diagnosis.failure.solve_here", run)
        return [*describe_shorter_steps(case, "dynamics", "mujoco", curves)]

    assert fail_until(2.6e-4) == [
        Reason(
            "with a time step of 2.5e-4 s instead of 1e-3 s it comes to its end",
            "Make the time step 0.25 ms; it is 1 ms.",
        )
    ]
    assert asked == [5e-4, 2.5e-4]
    assert fail_until(0.0) == [Reason("with time steps down to 1.56e-5 s it fails as well")]
    assert len(asked) == 2 + 6
    monkeypatch.setattr("proofmass.evidence.diagnosis.failure.MAX_RUN_STEPS", 800)
    assert fail_until(0.0) == [Reason("with time steps down to 2.5e-4 s it fails as well")]
    monkeypatch.setattr("proofmass.evidence.diagnosis.failure.MAX_RUN_STEPS", 399)
    assert fail_until(0.0) == []


@pytest.mark.parametrize(("stiffness", "side"), [(1e4, "within"), (1e9, "beyond")])
def test_the_step_is_within_the_stability_limit_or_beyond_it(short, stiffness, side):
    spring = f'<joint name="pivot" stiffness="{stiffness}"/>'
    case = short(('<joint name="pivot"/>', spring), (CENTRE, 'pos="0 -1 0" mass="1"'))
    curves = replace(solve_here(short(), "dynamics", "mujoco"))
    short(('<joint name="pivot"/>', spring))
    case = load_case(case.file)
    ((words, remedy),) = describe_stability(case, "dynamics", "mujoco", curves)
    fastest = 1e-3 * np.sqrt(stiffness)
    assert words.startswith("dt ω = ")
    assert float(words.split()[3]) == pytest.approx(fastest, rel=1e-2)
    assert f", {side} the 2.83 up to which RK4 is stable" in words
    limit = re.match(r"Make the time step at most (\S+) ms; it is 1 ms, with which RK4", remedy)
    assert bool(limit) == (side == "beyond")
    if limit:
        ratio = float(limit[1]) * 1e-3 * np.sqrt(stiffness) / 2.83
        assert (
            0.98 < ratio < 1.01
        )  # rounded down; the mass of the pendulum is 1 kg m^2 to a percent
    assert [*describe_stability(case, "sweep", "mujoco", curves)] == []


def test_the_budget_of_a_search_in_the_model_is_800_000_steps(short):
    residuals = residuals_of(short(("0 -9.81 0", "0 -9.805 0")))
    model = model_of(residuals)
    assert model.budget == SearchBudget(fit.MAX_MODEL_STEPS, 200)
    assert model.lasts
