"""Results of one run of a study: relative errors, invariants, failures, and processor times."""

import os
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from proofmass.base.arrays import Array
from proofmass.base.errors import InputError
from proofmass.base.strict import Kind
from proofmass.base.worker import Crashed, TimedOut
from proofmass.case.case import Case
from proofmass.case.drive import DriveState
from proofmass.reference.evaluate import evaluate
from proofmass.reference.profiles import drive_profiles
from proofmass.reference.samples import run_samples
from proofmass.run.sidecar import load_case
from proofmass.run.solve import call_engine, plan_run
from proofmass.sim.protocol.curves import Curves
from proofmass.sim.protocol.failures import BadModel, BadSetting, Diverged, NotSolved, Unsupported
from proofmass.studies import measure
from proofmass.studies.measure import (
    StudyRun,
    drives_moved,
    first_not_finite,
    observe,
    pin_process,
    relative_errors,
    reserve_processor,
    time_run,
)
from proofmass.studies.record import Setting
from proofmass.studies.study import make_row
from tests.shipped import shipped
from tests.studies.study_tasks import own_locks  # noqa: F401, a fixture of all tests

PENDULUM = load_case(shipped("pendulum.toml"))
FOURBAR = load_case(shipped("fourbar.toml"))
EULER = Setting("mujoco", {"integrator": "Euler"})
NEEDS_PINNING = pytest.mark.skipif(
    not measure.available_processors(), reason="runs are not pinned here"
)


def prescribed_drive_state(case: Case, kind: Kind, x: Array) -> DriveState:
    """The state of a drive that follows its motion profile exactly."""
    value, rate, acceleration = drive_profiles(case, kind)[0](x)
    return tuple(np.array([part * np.ones_like(x)]) for part in (value, rate, acceleration))


def measure_pendulum(step: float, setting: Setting = EULER) -> measure.Measurement:
    """Measure the pendulum in MuJoCo, released from the horizontal, for ten seconds."""
    return observe(
        StudyRun(PENDULUM, "dynamics", setting.with_parameters(timestep=step)), False, None
    )


def test_errors_are_shares_of_the_range_of_the_reference():
    x = run_samples(PENDULUM, "dynamics")
    exact = evaluate(PENDULUM, "dynamics", x, None).channels
    off = {"angle": exact["angle"] + 1e-3, "kinetic": exact["kinetic"] * 1.01}
    found = relative_errors(PENDULUM, "dynamics", Curves(x, off))
    assert found == {
        "position": pytest.approx(1e-3 / np.pi, rel=1e-6),  # it swings over pi
        "energy": pytest.approx(0.01, rel=1e-6),
    }


def test_the_error_of_a_kind_is_that_of_its_worst_channel():
    x = run_samples(FOURBAR, "dynamics")
    state = prescribed_drive_state(FOURBAR, "dynamics", x)
    exact = evaluate(FOURBAR, "dynamics", x, state).channels
    places = [name for name, c in FOURBAR.channels.items() if c.unit in ("rad", "m")]
    assert len(places) > 2
    for worst in places:
        off = {n: y + (2e-3 if n == worst else 1e-3) * np.ptp(y) for n, y in exact.items()}
        found = relative_errors(FOURBAR, "dynamics", Curves(x, off, drive=state))
        assert found["position"] == pytest.approx(2e-3, rel=1e-9)
        assert found["velocity"] == pytest.approx(1e-3, rel=1e-9)


def test_errors_are_computed_at_the_actual_state_of_the_drive():
    x = run_samples(FOURBAR, "dynamics")
    value, rate, acceleration = prescribed_drive_state(FOURBAR, "dynamics", x)
    late = value - 1e-3, rate, acceleration
    exact = evaluate(FOURBAR, "dynamics", x, late).channels
    assert max(relative_errors(FOURBAR, "dynamics", Curves(x, exact, drive=late)).values()) == 0.0


def test_constant_channels_have_no_relative_error():
    case = load_case(shipped("peaucellier.toml"))
    x = run_samples(case, "sweep")
    state = prescribed_drive_state(case, "sweep", x)
    curves = {
        n: y + 1.0
        for n, y in evaluate(case, "dynamics", x, state).channels.items()
        if isinstance(case.channels[n].equals, float)
    }
    assert curves
    assert relative_errors(case, "sweep", Curves(x, curves, drive=state)) == {}


@pytest.mark.parametrize("place", [0, -1])
def test_a_reference_curve_that_is_constant_but_for_rounding_has_no_error(place, monkeypatch):
    """This holds wherever the channel stands among those with the same unit."""
    run = plan_run(FOURBAR, "dynamics", "mujoco")
    state = run.motion(run.x)
    exact = evaluate(FOURBAR, "dynamics", run.x, state).channels
    angles = [name for name, c in FOURBAR.channels.items() if c.si_unit == "rad"]
    assert len(angles) > 1
    rounded = exact | {angles[place]: 1.0 + 1e-15 * np.cos(run.x)}
    monkeypatch.setattr(measure, "reference_at", lambda *_: rounded)
    curves = rounded | {angles[place]: np.full(run.x.size, 2.0)}
    found = relative_errors(FOURBAR, "dynamics", Curves(run.x, curves, drive=state))
    assert "position" in found
    assert max(found.values()) == 0.0


@pytest.mark.parametrize("step", [0.01, 0.0025])
def test_energy_of_a_symplectic_euler_drifts_as_its_modified_hamiltonian_says(step):
    # The modified Hamiltonian H - h/2 p V'(q) is constant to second order.  So the error of H is
    # the largest h/2 p V' = h/2 sqrt(2 g) max(sin q sqrt(cos q)) g, at cos q = 1/sqrt(3).  It is
    # divided by the largest kinetic energy, g.  The relative size of the next order is h omega,
    # with omega = sqrt(g).
    drift = step / 2 * np.sqrt(2 * 9.81) * np.sqrt(2 / 3 / np.sqrt(3))
    assert measure_pendulum(step).invariants["energy"] == pytest.approx(
        drift, rel=step * np.sqrt(9.81)
    )


def test_driven_runs_have_a_constraint_violation_and_no_energy():
    found = observe(
        StudyRun(FOURBAR, "dynamics", Setting("mujoco", {"timestep": 4e-3})), False, None
    )
    assert set(found.invariants) == {"violation"}
    assert 0 < found.invariants["violation"] < 1e-3


def test_a_damped_pendulum_has_no_energy_invariant(models, edit):
    edit("pendulum.xml", '<joint name="pivot"/>', '<joint name="pivot" damping="0.1"/>')
    braked = StudyRun(load_case(models / "pendulum.toml"), "dynamics", EULER)
    assert "energy" not in observe(braked, False, None).invariants


def test_steps_and_seconds_are_those_of_the_engine():
    found = measure_pendulum(0.01)
    assert found.steps == 1000
    assert 0 < found.seconds < 60
    again = observe(
        StudyRun(PENDULUM, "dynamics", EULER.with_parameters(timestep=0.01)), True, None
    )
    assert (again.steps, again.errors, again.complete) == (1000, {}, True)


@pytest.mark.parametrize("engine", ["mujoco", "pymunk"])
def test_the_time_step_that_was_taken_is_recorded(engine):
    """A whole number of steps leads from sample to sample: 18 in the 17.45 ms of this case."""
    task = StudyRun(FOURBAR, "dynamics", Setting(engine, {"timestep": 1e-3}))
    found = observe(task, False, None)
    assert found.step == pytest.approx(2 * np.pi / 360 / 18, rel=1e-12, abs=0)
    assert make_row(task, [found], is_timed=False).step == found.step
    swept = observe(StudyRun(FOURBAR, "sweep", Setting(engine)), False, None)
    assert np.isnan(swept.step)


@pytest.mark.parametrize(
    ("timed", "seconds", "made"), [(True, 0.01, 2), (True, 0.03, 1), (False, 0.01, 1)]
)
def test_a_short_run_is_made_twice_if_its_time_matters(monkeypatch, timed, seconds, made):
    """In its first run a process also loads libraries, whose time is not that of the run."""
    step, runs = measure.time_run, []

    def clocked(*run):
        curves, shared = step(*run)
        runs.append(replace(curves, work=seconds, seconds=seconds / (1 + len(runs))))
        return runs[-1], shared

    monkeypatch.setattr(measure, "time_run", clocked)
    task = StudyRun(PENDULUM, "dynamics", EULER.with_parameters(timestep=0.01), timed=timed)
    assert observe(task, False, None).seconds == runs[-1].seconds
    assert len(runs) == made


def test_an_engine_in_another_interpreter_has_no_share_and_its_time_of_compilation(monkeypatch):
    """This process waits for it; what waits gives no processor to others."""

    def elsewhere(*run):
        curves = call_engine(*run)
        return replace(curves, versions={"engine": "1"}, compile_seconds=2.5)

    own = observe(StudyRun(PENDULUM, "dynamics", EULER), False, None)
    monkeypatch.setattr(measure, "call_engine", elsewhere)
    task = StudyRun(PENDULUM, "dynamics", EULER)
    found = make_row(task, [observe(task, False, None)], is_timed=True)
    assert own.shared >= 0
    assert own.compile_seconds == 0
    assert np.isnan(found.shared)
    assert found.compile_seconds == 2.5
    assert found.errors == own.errors


def test_the_load_is_the_larger_of_those_before_and_after_a_run(monkeypatch):
    told = iter([3.0, 1.0, 0.5, 7.0])
    monkeypatch.setattr(measure, "load_average", lambda: next(told))
    task = StudyRun(PENDULUM, "dynamics", EULER.with_parameters(timestep=0.01))
    found = [observe(task, again, None) for again in (False, True)]
    assert [one.load for one in found] == [3.0, 7.0]
    assert make_row(task, found, is_timed=True).load == 7.0  # the load of the repeat
    assert make_row(task, found[:1], is_timed=True).load == 3.0
    assert np.isnan(make_row(task, [measure.Measurement()], is_timed=True).load)


def test_the_load_is_nan_on_a_system_without_a_load_average(monkeypatch):
    def none() -> tuple[float, float, float]:
        raise OSError

    monkeypatch.setattr(os, "getloadavg", none)
    assert np.isnan(measure.load_average())


@pytest.mark.parametrize(
    ("error", "outcome"),
    [
        (Diverged("failed"), "diverged"),
        (Unsupported("a hinge"), "unsupported"),
        (Crashed("signal 6"), "crashed"),
        (TimedOut("no answer"), "timed out"),
    ],
)
def test_failed_runs_have_an_outcome_and_raise_no_exception(monkeypatch, error, outcome):
    def fail(*_, **__):
        raise error

    monkeypatch.setattr(measure, "call_isolated", fail)
    found = measure.measure_task(StudyRun(PENDULUM, "dynamics", EULER), 5.0)
    assert (found.outcome, found.message, found.complete) == (outcome, str(error), False)


@pytest.mark.parametrize(
    ("error", "outcome", "of_a_task"),
    [
        (NotSolved("why"), "not solved", "diverged"),
        (BadModel("why"), "no start", "unsupported"),
        (BadSetting("name", "why"), "no start", "unsupported"),
        (Diverged("why"), "diverged", "diverged"),
        (TimedOut("why"), "timed out", "timed out"),
    ],
)
def test_each_exception_in_a_worker_has_an_outcome(monkeypatch, error, outcome, of_a_task):
    """Each exception has an outcome, which `measure_task` replaces in two cases.

    A run that was not solved counts as diverged.  A model that cannot start is unsupported if the
    setting has a number of segments, and bad input otherwise.
    """

    def fail(*_, **__):
        raise error

    monkeypatch.setattr(measure, "call_isolated", fail)
    found = measure.measure(call_engine, timeout=5.0)
    assert found == measure.Measurement(outcome=outcome, message=str(error))
    task = StudyRun(PENDULUM, "dynamics", EULER.with_parameters(segments=9))
    assert measure.measure_task(task, 5.0).outcome == of_a_task
    if outcome == "no start":
        with pytest.raises(InputError, match="why"):
            measure.measure_task(StudyRun(PENDULUM, "dynamics", EULER), 5.0)


def test_the_result_of_a_worker_is_returned_unchanged(monkeypatch):
    asked = []
    monkeypatch.setattr(
        measure, "call_isolated", lambda *args, **limits: asked.append((args, limits)) or "curves"
    )
    assert measure.measure(call_engine, "mujoco", timeout=5.0, memory=2.0) == "curves"
    assert asked == [((call_engine, "mujoco"), {"timeout": 5.0, "memory": 2.0})]


def test_an_unknown_parameter_is_bad_input(monkeypatch):
    wrong = StudyRun(PENDULUM, "dynamics", Setting("mujoco", {"speed": 3}))
    monkeypatch.setattr(measure, "call_isolated", lambda function, *args, **_: function(*args))
    with pytest.raises(InputError, match=r"toml: settings\.mujoco\.speed: unknown setting 'speed'"):
        measure.measure_task(wrong, 60.0)
    with pytest.raises(InputError):
        observe(wrong, False, None)


def test_curves_that_are_not_finite_have_no_errors(monkeypatch):
    curves = Curves(np.arange(3.0), {"a": np.zeros(3), "b": np.array([0.0, np.nan, np.inf])})
    assert first_not_finite(curves.channels) == "b at sample 1"
    monkeypatch.setattr(measure, "call_engine", lambda *_: curves)
    found = observe(StudyRun(PENDULUM, "dynamics", EULER), False, None)
    assert (found.outcome, found.message, found.errors) == ("not finite", "b at sample 1", {})


def test_unreachable_poses_give_the_outcome_no_reference(monkeypatch):
    case = load_case(shipped("double_rocker.toml"))
    x = run_samples(case, "dynamics")
    away = np.full((1, x.size), np.pi), np.ones((1, x.size)), np.zeros((1, x.size))
    monkeypatch.setattr(measure, "call_engine", lambda *_: Curves(x, {}, drive=away))
    found = observe(StudyRun(case, "dynamics", EULER), False, None)
    assert found.outcome == "no reference"
    assert found.message


def test_a_reference_that_is_not_finite_gives_no_errors(monkeypatch):
    x = run_samples(PENDULUM, "dynamics")
    exact = evaluate(PENDULUM, "dynamics", x, None).channels
    monkeypatch.setattr(measure, "call_engine", lambda *_: Curves(x, exact))
    monkeypatch.setattr(
        measure, "reference_at", lambda *_: exact | {"rate": np.where(x > 1, np.nan, x)}
    )
    found = observe(StudyRun(PENDULUM, "dynamics", EULER), False, None)
    assert (found.outcome, found.errors) == ("no reference", {})
    assert found.message == "not finite: rate at sample 101"


def test_a_reference_that_is_not_finite_at_the_prescribed_motion_gives_no_errors(monkeypatch):
    """The drive is late, and one channel of the reference is not finite where it is not late."""
    run = plan_run(FOURBAR, "dynamics", "mujoco")
    value, rate, acceleration = run.motion(run.x)
    late = value - 1e-3, rate, acceleration
    exact = evaluate(FOURBAR, "dynamics", run.x, late).channels
    name = next(n for n, c in FOURBAR.channels.items() if c.unit == "rad")

    def reference(case: Case, kind: Kind, curves: Curves, file: None) -> dict[str, Array]:
        is_late = np.array_equal(curves.drive[0], late[0])
        return exact if is_late else exact | {name: np.full(run.x.size, np.nan)}

    monkeypatch.setattr(measure, "call_engine", lambda *_: Curves(run.x, exact, drive=late))
    monkeypatch.setattr(measure, "reference_at", reference)
    found = observe(StudyRun(FOURBAR, "dynamics", EULER), False, None)
    assert (found.outcome, found.errors, found.asked) == ("no reference", {}, {})
    assert found.message == f"not finite: {name} at sample 0"


def test_a_run_that_ends_early_has_the_outcome_stopped(monkeypatch):
    x = run_samples(PENDULUM, "dynamics")[:9]
    part = Curves(x, evaluate(PENDULUM, "dynamics", x, None).channels, stopped="a limit")
    monkeypatch.setattr(measure, "call_engine", lambda *_: part)
    found = observe(StudyRun(PENDULUM, "dynamics", EULER), False, None)
    assert (found.outcome, found.message, found.complete) == ("stopped", "a limit", True)


@NEEDS_PINNING
def test_a_processor_is_given_to_one_run_at_a_time(monkeypatch):
    monkeypatch.setattr(measure, "available_processors", lambda: [0, 1])
    with reserve_processor() as one, reserve_processor() as other:
        assert {one, other} == {0, 1}
        monkeypatch.setattr(measure.time, "sleep", lambda _: (_ for _ in ()).throw(TimeoutError))
        with pytest.raises(TimeoutError), reserve_processor():
            pass
    with reserve_processor() as again:
        assert again in (0, 1)


@NEEDS_PINNING
def test_a_process_is_pinned_for_a_run_only(monkeypatch):
    def look(*run):
        where.append(os.sched_getaffinity(0))
        return call_engine(*run)

    before, where = os.sched_getaffinity(0), list[set[int]]()
    monkeypatch.setattr(measure, "call_engine", look)
    with pin_process(min(before)):
        assert os.sched_getaffinity(0) == {min(before)}
    assert os.sched_getaffinity(0) == before
    assert observe(StudyRun(PENDULUM, "dynamics", EULER), False, min(before)).pinned
    assert where in ([{min(before)}], [{min(before)}] * 2)  # a short run is made twice
    assert os.sched_getaffinity(0) == before


def test_runs_on_a_system_without_pinning_are_not_marked_as_pinned(monkeypatch):
    monkeypatch.setattr(measure, "available_processors", list)
    with reserve_processor() as none:
        assert none is None
    assert not measure_pendulum(0.01).pinned


@pytest.mark.parametrize(
    ("processor", "share"),
    [(1.5, 0.25), (2.0, 0.0), (2.1, 0.0)],  # the last one by clocks of different resolution
)
def test_the_share_of_others_is_the_wall_time_without_the_processor_time(
    processor, share, monkeypatch
):
    wall, own = iter([10.0, 12.0]), iter([5.0, 5.0 + processor])
    clock = SimpleNamespace(perf_counter=lambda: next(wall))
    monkeypatch.setattr(measure, "time", clock)
    monkeypatch.setattr(measure, "processor_time", lambda: next(own))
    monkeypatch.setattr(measure, "call_engine", lambda *_: Curves(np.zeros(1), {}))
    run = plan_run(PENDULUM, "dynamics", "mujoco")
    assert time_run("mujoco", PENDULUM.model_path, run)[1] == pytest.approx(share)


@pytest.mark.parametrize(
    ("case", "kind", "moved"),
    [(FOURBAR, "dynamics", True), (FOURBAR, "sweep", False), (PENDULUM, "dynamics", False)],
)
def test_drives_can_be_off_their_profiles_in_time_alone(case, kind, moved):
    run = plan_run(case, kind, "mujoco")
    curves = Curves(run.x, {}, drive=run.motion(run.x) if run.drives else None)
    assert drives_moved(run, curves) == moved
