"""A case in one engine: in which steps it is run, in which schemes, and what may be compiled.

The runs are given.
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
from proofmass.studies.stress.boundary import BoundaryKind, Failure, TrialResult
from proofmass.studies.stress.limit_search import StressedCase
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
    """``ran(found)``: what all runs give; what is asked for is in the list that it returns."""

    def given(found: Measurement) -> list[tuple]:
        asked: list[tuple] = []
        monkeypatch.setattr(
            StressedCase,
            "run",
            lambda self, case, **parameters: asked.append((case, parameters)) or found,
        )
        return asked

    return given


def test_a_trial_tells_why_it_is_lost_and_in_which_steps(own, ran):
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
    """Its samples are whole steps apart; a step of the model is one as well."""
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
    """What is found of a step would be told of another; a lost run has none."""
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
    """With one scheme, what is set is what there is; with two, each has its boundary."""
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
    """Whether it compiles is asked of the case whose run has failed."""
    asked = []

    def failing(*_):
        raise InputError(PENDULUM.file, "model", "why")

    monkeypatch.setattr(limit_search, "measure_once", failing)
    monkeypatch.setattr(limit_search, "is_compiled", lambda case: asked.append(case))
    assert own.run(OTHER) == Measurement(outcome="refused", message="why")
    assert asked == [OTHER]


def test_a_model_is_compiled_in_a_worker_within_a_minute(monkeypatch):
    calls = []

    def answer(function, *args, timeout):
        calls.append((function, args, timeout))
        return "whether"

    monkeypatch.setattr(limit_search, "isolated", answer)
    assert limit_search.is_compiled(OTHER) == "whether"
    assert calls == [(compiles, (OTHER.model_path,), 60.0)]


def test_what_is_not_in_the_store_is_run(own, monkeypatch):
    task, asked = StudyRun(PENDULUM, "dynamics", own.setting), []
    monkeypatch.setattr(limit_search, "key_of", lambda task: "key")
    monkeypatch.setattr(
        limit_search, "measure_untimed", lambda *told: asked.append(told) or Measurement(steps=3)
    )
    for _ in range(2):
        assert limit_search.measure_once(task, own.store, 5.0) == Measurement(steps=3)
    assert asked == [(task, 5.0)]
    assert (
        limit_search.measure_once(replace(task, study="x"), own.store).steps == 3
    )  # nobody asks which study
