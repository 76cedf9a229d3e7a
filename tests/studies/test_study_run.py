"""Running the tasks of a study: rounds, resuming, interrupts, and SIGKILL at any moment."""

import os
import pickle
import random
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from threading import Event, get_ident

import pytest

from proofmass.base.errors import InputError
from proofmass.base.worker import TimedOut
from proofmass.batch.pool import pool
from proofmass.run.sidecar import load_case
from proofmass.sim.protocol.curves import Curves
from proofmass.studies import measure, references
from proofmass.studies import study as runs
from proofmass.studies.measure import Measurement, StudyRun, relative_errors
from proofmass.studies.record import NAN, Setting, StudyRow, read_table
from proofmass.studies.references import has_one_reference
from proofmass.studies.store import Store
from proofmass.studies.study import (
    Study,
    make_row,
    with_references,
)
from tests.shipped import shipped
from tests.studies.study_tasks import own_locks, tasks  # noqa: F401, a fixture of all tests

STUDY_SCRIPT = """
import sys
from pathlib import Path
from proofmass.batch.pool import pool
from proofmass.studies.study import Study
from proofmass.studies.store import Store
from proofmass.studies.record import write_table
from tests.studies.study_tasks import tasks

folder = Path(sys.argv[1])
with pool(jobs=2) as workers:
    rows = Study(Store(folder), workers).run(tasks()[:int(sys.argv[2])], repeats=1)
write_table(rows, folder / "trade.csv")
"""
TWO_TASKS = tasks()[:2]


class ImmediateExecutor:
    """An executor that calls functions at once in this thread, and records the arguments."""

    def __init__(self):
        self.calls: list[tuple] = []

    def submit(self, function, *args):
        self.calls.append((function, *args))
        future: Future = Future()
        try:
            future.set_result(function(*args))
        except BaseException as error:
            future.set_exception(error)
        return future


def measurement(seconds: float, **changed: object) -> Measurement:
    """A measurement with a processor time [s] and other changed fields."""
    return replace(
        Measurement({"position": 1e-3}, {"violation": 0.0}, seconds, 10, True, 0.5, "x"), **changed
    )


def name_function(name: str, left: Iterator[float]) -> Callable[..., Measurement]:
    """A function of a name that gives measurements with the next processor times [s]."""

    def take_next(task, timeout):
        return measurement(next(left))

    take_next.__name__ = name
    return take_next


@pytest.fixture
def replace_runs(monkeypatch):
    """A function that replaces runs by measurements with given processor times [s], in order."""

    def take(*seconds):
        left = iter(seconds)
        monkeypatch.setattr(runs, "has_one_reference", lambda case, kind: False)
        for name in ("measure_task", "repeat_task"):
            monkeypatch.setattr(runs, name, name_function(name, left))

    return take


def test_only_the_named_tasks_are_repeated_and_the_others_keep_their_first_timing(
    tmp_path, replace_runs
):
    replace_runs(0.05, 0.09, 0.07, 0.06)
    rows = Study(Store(tmp_path), ImmediateExecutor()).run(TWO_TASKS, repeats=2, repeated=[1])
    assert [row.repeats for row in rows] == [(0.05,), (0.09, 0.07, 0.06)]


def test_all_tasks_are_run_once_before_any_is_run_again(tmp_path, replace_runs):
    replace_runs(*[0.05] * 6)
    workers = ImmediateExecutor()
    Study(Store(tmp_path), workers, longest=7.0).run(TWO_TASKS, repeats=2)
    assert [(task.value, made.__name__) for made, task, _ in workers.calls] == [
        (step, name)
        for name in ("measure_task", "repeat_task", "repeat_task")
        for step in (0.01, 0.005)
    ]
    assert {limit for *_, limit in workers.calls} == {7.0}


def test_seconds_are_the_least_of_all_runs(tmp_path, replace_runs):
    replace_runs(0.06, 0.05, 0.03, 0.04)
    (one,) = Study(Store(tmp_path), ImmediateExecutor()).run(TWO_TASKS[:1], repeats=3)
    assert (one.seconds, one.repeats) == (0.03, (0.06, 0.05, 0.03, 0.04))


def test_a_long_run_is_repeated_less_often(tmp_path, replace_runs):
    replace_runs(0.3, 0.5)
    (one,) = Study(Store(tmp_path), ImmediateExecutor()).run(TWO_TASKS[:1], repeats=3)
    assert (one.seconds, one.repeats) == (0.3, (0.3, 0.5))


def test_a_run_longer_than_the_limit_is_not_repeated(tmp_path, replace_runs):
    replace_runs(3.0, 1.9, 1.8)
    long, short = Study(Store(tmp_path), ImmediateExecutor()).run(
        TWO_TASKS, repeats=2, longest_repeated=2.0
    )
    assert long.repeats == (3.0,)
    assert short.repeats == (1.9, 1.8)


def test_without_repeats_nothing_is_timed(tmp_path, replace_runs):
    replace_runs(0.1)
    (one,) = Study(Store(tmp_path), ImmediateExecutor()).run(TWO_TASKS[:1], repeats=0)
    assert (one.seconds, one.repeats) == (0.1, ())


def test_equal_runs_are_made_once_and_have_separate_rows(tmp_path, replace_runs):
    replace_runs(0.1)
    twin = replace(TWO_TASKS[0], series="another", varied="integrator", value=NAN)
    workers = ImmediateExecutor()
    rows = Study(Store(tmp_path), workers).run([TWO_TASKS[0], twin], repeats=0)
    assert len(workers.calls) == 1
    assert [(one.series, one.varied) for one in rows] == [
        ("mujoco Euler", "timestep"),
        ("another", "integrator"),
    ]


def test_stored_runs_are_not_repeated_and_count_as_done(tmp_path, replace_runs):
    replace_runs(*[0.1] * 5)
    first = Study(Store(tmp_path), ImmediateExecutor()).run(TWO_TASKS[:1], repeats=1)
    seen, workers = [], ImmediateExecutor()
    rows = Study(Store(tmp_path), workers, progress=lambda *told: seen.append(told)).run(
        TWO_TASKS, repeats=1
    )
    assert rows[:1] == first
    assert [(task.value, made.__name__) for made, task, _ in workers.calls] == [
        (0.005, "measure_task"),
        (0.005, "repeat_task"),
    ]
    assert seen[-1][1:] == (4, 4)
    assert (
        Study(Store(tmp_path), ImmediateExecutor()).run(TWO_TASKS, repeats=1) == rows
    )  # none is left to take


def test_stored_curves_give_the_same_errors(tmp_path):
    store = Store(tmp_path)
    for one, task in zip(Study(store).run(TWO_TASKS, repeats=0), TWO_TASKS, strict=True):
        kept = store.curves(one.key)
        curves = Curves(
            kept["x"],
            {name.removeprefix("channel."): values for name, values in kept.items() if name != "x"},
        )
        assert relative_errors(task.case, "dynamics", curves) == one.errors


def test_the_reference_of_a_free_motion_is_not_timed_with_a_run(tmp_path, monkeypatch):
    """The reference is written once into a file, which later workers read."""
    limits = []

    def isolated(function, *args, timeout, **_):
        limits.append((function.__name__, timeout))
        return function(*args)

    monkeypatch.setattr(measure, "call_isolated", isolated)
    plain = [measure.measure_task(task, 9.0).errors for task in TWO_TASKS]
    limits.clear()
    rows = Study(Store(tmp_path), ImmediateExecutor(), longest=9.0).run(TWO_TASKS, repeats=0)
    assert [row.errors for row in rows] == plain
    assert limits == [
        ("write_reference", measure.REFERENCE_TIMEOUT),
        ("observe", 9.0),
        ("observe", 9.0),
    ]
    (file,) = tmp_path.glob("*.reference.npz")
    monkeypatch.setattr(references, "reference_for", None)
    third = tasks()[2]
    assert Study(Store(tmp_path), ImmediateExecutor()).run([third], repeats=0)[0].outcome == "ran"
    (other,) = with_references([replace(third, setting=Setting("pymunk", {}))], Store(tmp_path))
    assert other.reference == file


def test_settings_share_a_file_of_the_reference_unless_the_segments_of_rods_differ(tmp_path):
    """A reference that reads the model changes with the places of sensors on a rod."""
    case = load_case(shipped("rod_released.toml"))
    asked = [
        StudyRun(case, "dynamics", Setting("mujoco", parameters))
        for parameters in ({}, {"timestep": 1e-3}, {"segments": 7}, {"segments": 8})
    ]
    files = [task.reference for task in with_references(asked, Store(tmp_path))]
    assert files[0] == files[1]
    assert len(set(files)) == 3


@pytest.mark.parametrize(
    ("error", "outcome", "message"),
    [
        (TimedOut("no answer in 600 s"), "timed out", "its reference: no answer in 600 s"),
        (InputError(Path("a"), "", "a stop is met"), "no reference", "a stop is met"),
    ],
)
def test_a_failed_reference_is_tried_once_in_a_study_and_keeps_its_outcome(
    error, outcome, message, monkeypatch, tmp_path
):
    """A reference that took too long gives the outcome "timed out", not "no reference".

    So a later study tries it again.
    """
    asked = []

    def fail(function, *args, **limits):
        asked.append(function.__name__)
        raise error

    monkeypatch.setattr(measure, "call_isolated", fail)
    study = Study(Store(tmp_path), ImmediateExecutor(), longest=9.0)
    for task in TWO_TASKS:
        (row,) = replace(study).run([task], repeats=1)
        assert (row.outcome, row.message) == (outcome, message)
    assert asked == ["write_reference"]
    Study(Store(tmp_path), ImmediateExecutor(), longest=10.0).run(TWO_TASKS, repeats=0)
    assert len(asked) == 1 + (outcome == "timed out")


def test_failed_runs_keep_their_row_and_are_not_timed(tmp_path, monkeypatch):
    failed = Measurement(outcome="diverged", message="failed at 1 s")
    monkeypatch.setattr(
        runs,
        "measure_task",
        lambda task, timeout: measurement(0.01) if task.value == 0.005 else failed,
    )
    bad, good = Study(Store(tmp_path), ImmediateExecutor()).run(TWO_TASKS, repeats=2)
    assert (bad.outcome, bad.message) == ("diverged", "failed at 1 s")
    assert (bad.errors, bad.repeats) == ({}, ())
    assert (good.outcome, len(good.repeats)) == ("ran", 3)


def test_a_failed_repeat_is_the_outcome_of_its_row():
    one = make_row(
        TWO_TASKS[0],
        [measurement(0.01), measurement(0.02), Measurement(outcome="crashed", message="signal 6")],
        True,
    )
    assert (one.outcome, one.message, one.repeats) == (
        "crashed",
        "repeat 2: signal 6",
        (0.01, 0.02),
    )


def test_calls_have_their_results_in_order_and_are_made_here_without_workers(tmp_path):
    """With workers they end in any order: here the second one ends before the first."""
    study, passed = Study(Store(tmp_path)), Event()

    def wait(name: str) -> tuple[str, int]:
        if name == "first":
            assert passed.wait(10.0)
        passed.set()
        return name, get_ident()

    with ThreadPoolExecutor(2) as workers:
        working = replace(study, workers=workers)
        assert working.call_each(wait, [("first",), ("second",)])[0][0] == "first"
        names, threads = zip(*working.call_each(wait, [("a",), ("b",), ("c",)]), strict=True)
        assert names == ("a", "b", "c")
        assert get_ident() not in threads
        assert working.call(int, "11", base=2) == 3
    assert study.call_each(wait, [("a",), ("b",)]) == [("a", get_ident()), ("b", get_ident())]
    assert study.call(int, "11", base=2) == 3


def test_calls_that_have_not_begun_are_cancelled_after_one_fails(tmp_path):
    begun, ended = [], Event()

    def fail_first(k: int) -> None:
        begun.append(k)
        if k == 0:
            raise ValueError("why")
        assert ended.wait(10.0)  # keeps the only worker busy until the others are cancelled

    with ThreadPoolExecutor(1) as workers:
        with pytest.raises(ValueError, match="why"):
            Study(Store(tmp_path), workers).call_each(fail_first, [(k,) for k in range(9)])
        ended.set()
    assert begun in ([0], [0, 1])


def test_a_study_inside_a_worker_can_be_sent_there(tmp_path):
    """It keeps the store and the limit; it has neither the workers nor the progress bar."""
    with ThreadPoolExecutor(1) as workers:
        study = Study(Store(tmp_path), workers, progress=lambda *_: None)
        sent = pickle.loads(pickle.dumps(study.inside_worker(9.0)))
        again = replace(study, longest=7.0).inside_worker(9.0)
    assert (sent.workers, sent.longest, sent.store.folder) == (None, 9.0, tmp_path)
    assert sent.progress("label", 1, 2) is None
    assert again.longest == 7.0


def test_an_interrupt_keeps_finished_runs(tmp_path, replace_runs):
    def stop(label, done, total):
        if done == 3:
            raise KeyboardInterrupt

    replace_runs(*[0.1] * 5)
    with pytest.raises(KeyboardInterrupt):
        Study(Store(tmp_path), ImmediateExecutor(), progress=stop).run(tasks()[:5], repeats=0)
    assert len(list(tmp_path.glob("*.json"))) == 3


def test_bad_input_ends_a_study(tmp_path):
    wrong = replace(
        TWO_TASKS[0], setting=TWO_TASKS[0].setting.with_parameters(integrator="Simpson")
    )
    with pool(1) as workers, pytest.raises(InputError, match=r"known: euler, .*'Simpson'"):
        Study(Store(tmp_path), workers).run([wrong])


def test_an_unreachable_cluster_is_reported_in_one_line(monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr("proofmass.batch.pool.CONNECT_TIMEOUT", "100ms")
    with (
        pytest.raises(ValueError, match=r"--dask tcp://127.*host:8786") as told,
        pool(dask="tcp://127.0.0.1:9"),
    ):
        pass
    assert "\n" not in str(told.value)


def test_without_dask_the_message_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(ValueError, match=r"pip install proofmass\[dask\]"), pool(dask="tcp://a:1"):
        pass


def start_study(folder: Path, count: int) -> subprocess.Popen:
    """Start a study of `count` tasks in a process group of its own."""
    return subprocess.Popen(
        [sys.executable, "-c", STUDY_SCRIPT, str(folder), str(count)],
        cwd=Path(__file__).parents[2],
        start_new_session=True,
        stderr=subprocess.PIPE,
        text=True,
    )


def finished_runs(folder: Path) -> dict[str, int]:
    """Names of the records of finished runs, and when they were written [ns]."""
    return {one.name: one.stat().st_mtime_ns for one in folder.glob("*.json")}


def stop_study(
    folder: Path, count: int, after: int, later: float, signal_number: signal.Signals
) -> str:
    """Start a study and stop it `later` seconds after `after` more runs are finished.

    Returns the standard error of the study.
    """
    there, study = len(finished_runs(folder)), start_study(folder, count)
    while study.poll() is None and len(finished_runs(folder)) < there + after:
        time.sleep(1e-3)
    time.sleep(later)
    os.killpg(study.pid, signal_number)
    return study.communicate(timeout=60)[1]


def rows_without_times(folder: Path) -> list[str]:
    """The rows of a study, as text, without processor times and the load of the machine."""
    return [
        repr(replace(one, seconds=NAN, repeats=(NAN,) * len(one.repeats), shared=NAN, load=NAN))
        for one in read_table(folder / "trade.csv")
    ]


def assert_same_table_after_kills(kills: int, count: int, tmp_path: Path, seed: int = 6) -> None:
    """Assert that a study that is killed repeatedly gives the table of an undisturbed study."""
    torn, whole, dice = tmp_path / "torn", tmp_path / "whole", random.Random(seed)
    torn.mkdir()
    before = finished_runs(torn)
    for _ in range(kills):
        stop_study(
            torn,
            count,
            dice.randint(1, 2 * count // (kills + 1)),
            dice.uniform(0, 0.02),
            signal.SIGKILL,
        )
        now = finished_runs(torn)
        assert now.items() >= before.items()  # finished runs are not made again
        before = now
        assert not (torn / "trade.csv").exists()
    for folder in (torn, whole):
        assert start_study(folder, count).communicate()[1] == ""
    assert finished_runs(torn).items() >= before.items()
    curves = {one.stem for one in torn.glob("*.npz") if not one.name.endswith(".reference.npz")}
    assert curves == {one.split(".")[0] for one in finished_runs(torn)}
    assert len(list(torn.glob("*.reference.npz"))) == 1  # the reference, which all runs share
    assert finished_runs(torn).keys() == finished_runs(whole).keys()
    assert len(finished_runs(torn)) == 2 * count
    assert rows_without_times(torn) == rows_without_times(whole)


@pytest.mark.slow
def test_a_study_killed_ten_times_gives_the_same_table(tmp_path):
    assert_same_table_after_kills(10, 20, tmp_path)


def test_an_interrupt_from_the_keyboard_stores_no_crash(tmp_path):
    said = stop_study(tmp_path, 4, 2, 0.0, signal.SIGINT)  # the signal also reaches the workers
    assert "KeyboardInterrupt" in said
    assert start_study(tmp_path, 4).communicate()[1] == ""
    assert [one.outcome for one in read_table(tmp_path / "trade.csv")] == ["ran"] * 4


def test_parallel_and_sequential_runs_have_the_same_results(tmp_path):
    def rows(jobs: int) -> list[StudyRow]:
        with ThreadPoolExecutor(jobs) as workers:
            return Study(Store(tmp_path / str(jobs)), workers).run(tasks(), repeats=0)

    one, two = ([(r.errors, r.invariants, r.steps, r.outcome) for r in rows(n)] for n in (1, 2))
    assert one == two
    assert all(errors for errors, *_ in one)


@pytest.mark.parametrize(
    ("name", "kind", "shared"),
    [
        ("pendulum.toml", "dynamics", True),
        ("fourbar.toml", "dynamics", False),
        ("fourbar.toml", "sweep", False),
        ("rod_released.toml", "dynamics", False),
    ],
)
def test_settings_share_the_reference_of_a_free_motion_without_rods(name, kind, shared):
    """A setting may change the segments of rods, and with them the places of sensors."""
    assert has_one_reference(load_case(shipped(name)), kind) == shared
