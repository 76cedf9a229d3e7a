"""The search for a limit of a case: its time steps, its schemes, and several boundaries.

No engine runs: the results of runs are given.
"""

from dataclasses import replace
from math import inf, nan
from types import SimpleNamespace

import pytest

from proofmass.base.errors import InputError
from proofmass.run.sidecar import load_case
from proofmass.sim.mjcf import compiles
from proofmass.studies.measure import Measurement, StudyRun
from proofmass.studies.record import Setting
from proofmass.studies.store import Store
from proofmass.studies.stress import limit_search
from proofmass.studies.stress.boundary import Boundary, BoundaryKind, Failure, TrialResult
from proofmass.studies.stress.limit_search import (
    LimitSearch,
    StressedCase,
    bisect,
    find_first_and_last,
    round_to_printed,
)
from proofmass.studies.stress.page import describe_boundary
from proofmass.studies.study import Study
from tests.shipped import shipped

PENDULUM = load_case(shipped("pendulum.toml"))  # 10 s in 1001 samples, in steps of 1 ms
CHANGED_PENDULUM = PENDULUM.model_copy(update={"title": "changed"})


@pytest.fixture
def stressed_pendulum(tmp_path) -> StressedCase:
    study = Study(Store(tmp_path), longest=5.0)
    return StressedCase(PENDULUM, "dynamics", Setting("mujoco", {"integrator": "RK4"}), study)


@pytest.fixture
def patch_runs(monkeypatch):
    """``patch_runs(found)``: all runs give this result; it returns the list of their arguments."""

    def patch(found: Measurement) -> list[tuple]:
        asked: list[tuple] = []
        monkeypatch.setattr(
            StressedCase,
            "run",
            lambda self, case, **parameters: asked.append((case, parameters)) or found,
        )
        return asked

    return patch


def test_a_trial_gives_its_failure_and_its_time_step(stressed_pendulum, patch_runs):
    asked = patch_runs(Measurement({"position": 0.5}, step=0.25))
    assert stressed_pendulum.try_case(CHANGED_PENDULUM, timestep=0.5) == TrialResult(
        Failure("position off by 0.5 of its range", BoundaryKind.INACCURATE, silent=True), 0.25
    )
    assert asked == [(CHANGED_PENDULUM, {"timestep": 0.5})]
    patch_runs(Measurement({"position": 0.01}, step=0.25))
    assert stressed_pendulum.try_case(CHANGED_PENDULUM) == TrialResult(None, 0.25)


@pytest.mark.parametrize(
    ("parameters", "step"),
    [({}, 1e-3), ({"timestep": 3e-3}, 3e-3), ({"timestep": 3e-3, "iterations": 7}, 3e-3)],
)
def test_a_run_takes_exactly_the_steps_that_are_asked_for(
    parameters, step, stressed_pendulum, patch_runs
):
    """Its samples are whole steps apart; without a parameter the step is that of the model."""
    asked = patch_runs(Measurement(step=step * (1 + 1e-10)))
    assert stressed_pendulum.try_in_steps(CHANGED_PENDULUM, 2.0, **parameters) == TrialResult(
        None, step * (1 + 1e-10)
    )
    ((case, given),) = asked
    assert given == parameters
    assert case.title == "changed"
    run = case.run["dynamics"]
    steps = run.until / step / (run.n - 1)
    assert steps == pytest.approx(round(steps), rel=1e-9)
    assert run.until == pytest.approx(2.0, abs=2 * step)


def test_a_step_other_than_the_one_asked_for_raises(stressed_pendulum, patch_runs):
    """Otherwise the limit would be given for a wrong time step.  A failed run has no step."""
    for step in (1.001e-3, 1e-3 * (1 + 1e-8), 2e-3, 5e-4):
        patch_runs(Measurement(step=step))
        with pytest.raises(RuntimeError) as error:
            stressed_pendulum.try_in_steps(PENDULUM, 1.0)
        assert str(error.value) == (
            f"pendulum, mujoco: took steps of {step!r} s where 0.001 s were asked for"
        )
    patch_runs(Measurement(outcome="stopped", step=nan))
    assert stressed_pendulum.try_in_steps(PENDULUM, 1.0).failure.limit == BoundaryKind.UNSTABLE


def test_each_scheme_of_an_engine_has_a_search_of_its_own(stressed_pendulum, monkeypatch):
    """With one scheme the setting of the case is searched; with two, each scheme is searched."""
    schemes = [SimpleNamespace(name=name, settings={"integrator": name}) for name in "ab"]

    def trial(parameters, x):
        return TrialResult(Failure(f"{parameters}", BoundaryKind.UNSTABLE))

    for n, words in ((1, ["RK4"]), (2, ["a", "b"])):
        monkeypatch.setattr(
            limit_search,
            "engine_of",
            lambda name, n=n: SimpleNamespace(theory=SimpleNamespace(schemes=schemes[:n])),
        )
        found = list(stressed_pendulum.search_schemes("step", "s", 1.0, inf, trial, schemes[:n]))
        assert [one.setting for one in found] == words


def test_a_refused_model_is_that_of_the_changed_case(stressed_pendulum, monkeypatch):
    """It is tried whether the model of the changed case, whose run failed, compiles."""
    asked = []

    def failing(*_):
        raise InputError(PENDULUM.file, "model", "why")

    monkeypatch.setattr(Study, "measure_one", failing)
    monkeypatch.setattr(limit_search, "can_compile", lambda case: asked.append(case))
    assert stressed_pendulum.run(CHANGED_PENDULUM) == Measurement(outcome="refused", message="why")
    assert asked == [CHANGED_PENDULUM]


def test_a_model_is_compiled_in_a_worker_within_a_minute(monkeypatch):
    calls = []

    def answer(function, *args, timeout):
        calls.append((function, args, timeout))
        return "whether"

    monkeypatch.setattr(limit_search, "call_isolated", answer)
    assert limit_search.can_compile(CHANGED_PENDULUM) == "whether"
    assert calls == [(compiles, (CHANGED_PENDULUM.model_path,), 60.0)]


def test_a_run_is_made_once_and_then_read_from_the_store(stressed_pendulum):
    """It is read for another study too, and made again for another setting."""
    task, asked = StudyRun(PENDULUM, "dynamics", stressed_pendulum.setting), []
    study = stressed_pendulum.study

    def make(*told) -> Measurement:
        asked.append(told)
        return Measurement(steps=3)

    for _ in range(2):
        assert study.measure_one(task, make) == Measurement(steps=3)
    assert asked == [(task, 5.0)]
    again = replace(task, study="another study")
    assert study.measure_one(again, make).steps == 3
    assert len(asked) == 1
    other = replace(task, setting=task.setting.with_parameters(integrator="Euler"))
    assert study.measure_one(other, make).steps == 3
    assert asked[1:] == [(other, 5.0)]


ENGINE_FAILURE = Failure("gone", BoundaryKind.UNSTABLE)
PROOFMASS_FAILURE = Failure("late", BoundaryKind.OURS)


def search_by_test(test, start: float, reach: float) -> LimitSearch:
    """A search whose values hold or fail as a function says."""
    return LimitSearch("", "", "", "step", "s", start, reach, lambda x: TrialResult(test(x)))


@pytest.mark.parametrize("up", [True, False])
@pytest.mark.parametrize(
    ("fails", "first", "last"),
    [
        # bisection finds one boundary; the other one is before or beyond it
        (((2.0, 2.2), (2.5, inf)), 2.0, 2.5),
        (((2.0, 2.05), (2.1, 2.2), (2.3, 2.6), (3.0, inf)), 2.0, 3.0),
        (((5.0, 5.3), (7.0, inf)), 5.0, 7.0),
        # edges that have more than four digits
        (((1.77634, 2.2), (2.51234, inf)), 1.77634, 2.51234),
        # a failing interval that a stride meets; the end of the range holds
        (((3.9, 4.3),), 3.9, 16.0),
    ],
)
def test_of_several_boundaries_the_first_and_the_last_are_found(fails, first, last, up):
    def test(x: float) -> Failure | None:
        x = x if up else 1.0 / x
        return ENGINE_FAILURE if any(low <= x < high for low, high in fails) else None

    own = search_by_test(test, *((1.0, 16.0) if up else (1.0, 1 / 16.0)))
    found = own.find()
    breaks, again = (found.breaks, found.again) if up else (1 / found.breaks, 1 / found.again)
    assert found.several
    assert first <= breaks < 1.05 * first
    assert last / 1.05 < again <= last
    assert test(found.holds) is None
    assert test(found.breaks) == ENGINE_FAILURE
    assert test(found.again) is None
    assert 1.019 < max(found.breaks / found.holds, found.holds / found.breaks) < 1.021
    words = found.describe(found.unit).split()  # the printed values are those that were tried
    assert (float(words[0]), float(words[2])) == (found.breaks, found.again)
    assert "some values hold and others do not, up to" in describe_boundary(found)


@pytest.mark.parametrize("within", [0.01, 1e-6, 0.5])
@pytest.mark.parametrize("edge", [2.345678, 9.9999, 10.0])
def test_a_single_boundary_is_that_of_the_bisection(edge, within):
    found = search_by_test(lambda x: ENGINE_FAILURE if x >= edge else None, 1.0, 64.0).find(within)
    assert found.holds < edge <= found.breaks <= (1.0 + within) * found.holds
    assert not found.several
    assert found.format_measured() == found.describe(found.unit).removesuffix(" s")


def test_a_bisection_tries_each_value_once():
    """A trial of the length of a reference is slow, and its result is not stored."""
    tried = []

    def test(x: float) -> Failure | None:
        tried.append(x)
        return ENGINE_FAILURE if x >= 3.0 else None

    holds, breaks, failure = bisect(test, 1.0, 100.0)
    assert holds < 3.0 <= breaks
    assert failure == ENGINE_FAILURE
    assert len(tried) == len(set(tried)) > 5
    assert max(tried) < 4.0 * 4.0  # no stride beyond the first one that fails


def test_unknown_values_near_a_boundary_make_no_second_boundary():
    """Values at which proofmass gives up, before or beyond the boundary, are no engine failures."""

    def test(x: float) -> Failure | None:
        return (
            PROOFMASS_FAILURE if 1.7 < x < 1.95 or x > 2.2 else ENGINE_FAILURE if x >= 2.0 else None
        )

    assert not search_by_test(test, 1.0, 16.0).find().several


def test_values_near_a_boundary_have_four_digits_within_the_range():
    seen = []

    def test(x: float) -> Failure | None:
        seen.append(x)
        return ENGINE_FAILURE if x >= 2.0 else None

    find_first_and_last(test, 1.5, 2.4, 1.9876543, 2.0012345, ENGINE_FAILURE)
    assert all(x == round_to_printed(x) for x in seen)
    assert (min(seen), max(seen)) == (1.5, 2.4)


def test_a_boundary_within_the_last_digit_is_a_failing_value():
    """1.776 holds and 1.7764 fails, but both are printed as 1.776, so 1.777 is given."""

    def test(x: float) -> Failure | None:
        return ENGINE_FAILURE if 1.77634 <= x < 1.8 or x >= 2.5 else None

    holds, breaks, _, again = find_first_and_last(test, 1.7, 9.0, 1.7763, 1.7764, ENGINE_FAILURE)
    assert breaks == 1.777
    assert again == round_to_printed(again)
    assert (test(holds), test(breaks), test(again)) == (None, ENGINE_FAILURE, None)


def test_values_are_tried_near_the_limit_as_it_is_printed():
    """1.985 holds, 2 fails, 1.99 is printed: 2 % before 1.99 a value fails, 2 % before 2 none."""

    def test(x: float) -> Failure | None:
        return ENGINE_FAILURE if 1.949 <= x < 1.953 or x >= 2.0 else None

    holds, breaks, _, again = find_first_and_last(test, 1.0, 9.0, 1.985, 2.0, ENGINE_FAILURE)
    assert breaks == 1.951
    assert again == 1.985
    assert test(holds) is None


def test_a_limit_is_printed_with_more_digits_if_needed():
    """1.77634 fails, but both neighbours of it with four digits hold."""

    def test(x: float) -> Failure | None:
        return ENGINE_FAILURE if 1.7763 < x < 1.7764 or x >= 2.5 else None

    holds, breaks, failure, again = find_first_and_last(
        test, 1.7, 9.0, 1.7763, 1.77634, ENGINE_FAILURE
    )
    found = Boundary("", "", "", "step", "s", 1.7, 9.0, holds, breaks, failure="gone", again=again)
    assert failure == ENGINE_FAILURE
    assert found.describe(found.unit).startswith("1.77634 to ")
    assert "fails at 1.77634 s" in describe_boundary(found)


def test_the_end_of_the_range_is_printed_with_three_digits():
    """The end of the range is 1e12 times 6.5797, whose digits have no meaning, so three suffice."""
    found = Boundary("", "", "", "k", "1", 6.5797, 6.579736e12, 1.3e10, 1.341e10, again=6.579736e12)
    assert found.describe(found.unit) == "1.341e10 to 6.58e12"
