"""The search for a limit of a case: its time steps, its schemes, and several boundaries.

No engine runs: the results of runs are given.
"""

from dataclasses import replace
from math import inf, nan
from types import SimpleNamespace

import pytest

from proofmass.errors import InputError
from proofmass.sidecar import load_case
from proofmass.sim.mjcf import compiles
from proofmass.studies.measure import Measurement, StudyRun
from proofmass.studies.record import Setting
from proofmass.studies.store import Store
from proofmass.studies.stress import limit_search
from proofmass.studies.stress.boundary import Boundary, BoundaryKind, Failure, TrialResult
from proofmass.studies.stress.limit_search import (
    LimitSearch,
    StressedCase,
    find_first_and_last,
    round_to_printed,
)
from proofmass.studies.stress.page import describe_boundary
from proofmass.studies.stress.stress import format_limit
from tests.shipped import shipped

PENDULUM = load_case(shipped("pendulum.toml"))  # 10 s in 1001 samples, in steps of 1 ms
OTHER = PENDULUM.model_copy(update={"title": "changed"})


@pytest.fixture
def own(tmp_path) -> StressedCase:
    return StressedCase(
        PENDULUM, "dynamics", Setting("mujoco", {"integrator": "RK4"}), Store(tmp_path)
    )


@pytest.fixture
def ran(monkeypatch):
    """``ran(found)``: all runs give this result; it returns the list of their arguments."""

    def given(found: Measurement) -> list[tuple]:
        asked: list[tuple] = []
        monkeypatch.setattr(
            StressedCase,
            "run",
            lambda self, case, **parameters: asked.append((case, parameters)) or found,
        )
        return asked

    return given


def test_a_trial_tells_why_it_is_failed_and_in_which_steps(own, ran):
    asked = ran(Measurement({"position": 0.5}, step=0.25))
    assert own.try_case(OTHER, timestep=0.5) == TrialResult(
        Failure("position off by 0.5 of its range", BoundaryKind.INACCURATE, silent=True), 0.25
    )
    assert asked == [(OTHER, {"timestep": 0.5})]
    ran(Measurement({"position": 0.01}, step=0.25))
    assert own.try_case(OTHER) == TrialResult(None, 0.25)


@pytest.mark.parametrize(
    ("parameters", "step"),
    [({}, 1e-3), ({"timestep": 3e-3}, 3e-3), ({"timestep": 3e-3, "iterations": 7}, 3e-3)],
)
def test_a_run_in_steps_takes_just_those_that_are_asked_for(parameters, step, own, ran):
    """Its samples are whole steps apart; without a parameter the step is that of the model."""
    asked = ran(Measurement(step=step * (1 + 1e-10)))
    assert own.try_in_steps(OTHER, 2.0, **parameters) == TrialResult(None, step * (1 + 1e-10))
    ((case, given),) = asked
    assert given == parameters
    assert case.title == "changed"
    run = case.run["dynamics"]
    steps = run.until / step / (run.n - 1)
    assert steps == pytest.approx(round(steps), rel=1e-9)
    assert run.until == pytest.approx(2.0, abs=2 * step)


def test_another_step_than_asked_for_is_an_error_of_the_program(own, ran):
    """Otherwise the limit would be given for a wrong time step.  A failed run has no step."""
    for step in (1.001e-3, 1e-3 * (1 + 1e-8), 2e-3, 5e-4):
        ran(Measurement(step=step))
        with pytest.raises(RuntimeError) as error:
            own.try_in_steps(PENDULUM, 1.0)
        assert str(error.value) == (
            f"pendulum, mujoco: took steps of {step!r} s where 0.001 s were asked for"
        )
    ran(Measurement(outcome="stopped", step=nan))
    assert own.try_in_steps(PENDULUM, 1.0).failure.limit == BoundaryKind.UNSTABLE


def test_a_boundary_is_searched_in_each_scheme_of_an_engine_that_has_several(own, monkeypatch):
    """With one scheme the setting of the case is searched; with two, each scheme is searched."""
    schemes = [SimpleNamespace(name=name, settings={"integrator": name}) for name in "ab"]

    def trial(parameters, x):
        return TrialResult(Failure(f"{parameters}", BoundaryKind.UNSTABLE))

    for n, words in ((1, ["RK4"]), (2, ["a", "b"])):
        monkeypatch.setattr(
            limit_search, "engine_of", lambda name, n=n: SimpleNamespace(schemes=schemes[:n])
        )
        found = list(own.search_schemes("step", "s", 1.0, inf, trial, schemes[:n]))
        assert [one.setting for one in found] == words


def test_a_model_that_an_engine_refuses_is_the_changed_one(own, monkeypatch):
    """It is tried whether the model of the changed case, whose run failed, compiles."""
    asked = []

    def failing(*_):
        raise InputError(PENDULUM.file, "model", "why")

    monkeypatch.setattr(limit_search, "measure_or_read", failing)
    monkeypatch.setattr(limit_search, "can_compile", lambda case: asked.append(case))
    assert own.run(OTHER) == Measurement(outcome="refused", message="why")
    assert asked == [OTHER]


def test_a_model_is_compiled_in_a_worker_within_a_minute(monkeypatch):
    calls = []

    def answer(function, *args, timeout):
        calls.append((function, args, timeout))
        return "whether"

    monkeypatch.setattr(limit_search, "call_isolated", answer)
    assert limit_search.can_compile(OTHER) == "whether"
    assert calls == [(compiles, (OTHER.model_path,), 60.0)]


def test_what_is_not_in_the_store_is_run(own, monkeypatch):
    task, asked = StudyRun(PENDULUM, "dynamics", own.setting), []
    monkeypatch.setattr(limit_search, "task_key", lambda task: "key")
    monkeypatch.setattr(
        limit_search, "measure_untimed", lambda *told: asked.append(told) or Measurement(steps=3)
    )
    for _ in range(2):
        assert limit_search.measure_or_read(task, own.store, 5.0) == Measurement(steps=3)
    assert asked == [(task, 5.0)]
    assert (
        limit_search.measure_or_read(replace(task, study="x"), own.store).steps == 3
    )  # another study has the same key here


GONE = Failure("gone", BoundaryKind.UNSTABLE)
LATE = Failure("late", BoundaryKind.OURS)


def search(test, start: float, reach: float) -> LimitSearch:
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
        return GONE if any(low <= x < high for low, high in fails) else None

    own = search(test, *((1.0, 16.0) if up else (1.0, 1 / 16.0)))
    found = own.find()
    breaks, again = (found.breaks, found.again) if up else (1 / found.breaks, 1 / found.again)
    assert found.several
    assert first <= breaks < 1.05 * first
    assert last / 1.05 < again <= last
    assert test(found.holds) is None
    assert test(found.breaks) == GONE
    assert test(found.again) is None
    assert 1.019 < max(found.breaks / found.holds, found.holds / found.breaks) < 1.021
    words = format_limit(found).split()  # the printed values are those that were tried
    assert (float(words[0]), float(words[2])) == (found.breaks, found.again)
    assert "some values hold and others do not, up to" in describe_boundary(found)


@pytest.mark.parametrize("within", [0.01, 1e-6, 0.5])
@pytest.mark.parametrize("edge", [2.345678, 9.9999, 10.0])
def test_one_boundary_stays_as_it_was_bisected(edge, within):
    found = search(lambda x: GONE if x >= edge else None, 1.0, 64.0).find(within)
    assert found.holds < edge <= found.breaks <= (1.0 + within) * found.holds
    assert not found.several
    assert found.format_measured() == format_limit(found).removesuffix(" s")


def test_what_is_not_known_beside_a_boundary_makes_no_second():
    """Values at which proofmass gives up, before or beyond the boundary, are no engine failures."""

    def test(x: float) -> Failure | None:
        return LATE if 1.7 < x < 1.95 or x > 2.2 else GONE if x >= 2.0 else None

    assert not search(test, 1.0, 16.0).find().several


def test_values_beside_a_boundary_have_four_digits_and_stay_between_the_ends():
    seen = []

    def test(x: float) -> Failure | None:
        seen.append(x)
        return GONE if x >= 2.0 else None

    find_first_and_last(test, 1.5, 2.4, 1.9876543, 2.0012345, GONE)
    assert all(x == round_to_printed(x) for x in seen)
    assert (min(seen), max(seen)) == (1.5, 2.4)


def test_a_first_boundary_within_the_last_digit_is_told_as_a_value_that_fails():
    """1.776 holds and 1.7764 fails, but both are printed as 1.776, so 1.777 is given."""

    def test(x: float) -> Failure | None:
        return GONE if 1.77634 <= x < 1.8 or x >= 2.5 else None

    holds, breaks, _, again = find_first_and_last(test, 1.7, 9.0, 1.7763, 1.7764, GONE)
    assert breaks == 1.777
    assert again == round_to_printed(again)
    assert (test(holds), test(breaks), test(again)) == (None, GONE, None)


def test_the_limit_as_it_is_printed_is_looked_beside():
    """1.985 holds, 2 fails, 1.99 is printed: 2 % before 1.99 a value fails, 2 % before 2 none."""

    def test(x: float) -> Failure | None:
        return GONE if 1.949 <= x < 1.953 or x >= 2.0 else None

    holds, breaks, _, again = find_first_and_last(test, 1.0, 9.0, 1.985, 2.0, GONE)
    assert breaks == 1.951
    assert again == 1.985
    assert test(holds) is None


def test_what_only_more_digits_tell_is_printed_with_them():
    """1.77634 fails, but both neighbours of it with four digits hold."""

    def test(x: float) -> Failure | None:
        return GONE if 1.7763 < x < 1.7764 or x >= 2.5 else None

    holds, breaks, failure, again = find_first_and_last(test, 1.7, 9.0, 1.7763, 1.77634, GONE)
    found = Boundary("", "", "", "step", "s", 1.7, 9.0, holds, breaks, failure="gone", again=again)
    assert failure == GONE
    assert format_limit(found).startswith("1.77634 to ")
    assert "fails at 1.77634 s" in describe_boundary(found)


def test_the_last_value_that_was_tried_is_printed_as_where_nothing_fails():
    """The end of the range is 1e12 times 6.5797, whose digits have no meaning, so three suffice."""
    found = Boundary("", "", "", "k", "1", 6.5797, 6.579736e12, 1.3e10, 1.341e10, again=6.579736e12)
    assert format_limit(found) == "1.341e10 to 6.58e12"
