"""A study: where its runs are kept, who makes them, how long they may take, who hears of them.

    with pool(jobs=2) as workers:                  # or pool(dask="tcp://...")
        study = Study(Store(folder), workers)
        rows = study.run(tasks, repeats=0)         # errors and invariants; one run each
        rows = study.run(tasks)                    # the same, and times of 5 more rounds
    write_table(rows, folder / "trade.csv")
    study.store.curves(rows[0].key)                # x, channel.angle, ...

Each result is stored at once, so that a study that was stopped can be continued.  A run that is in
the store is not made again, even if another study asked for it.
"""

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from concurrent.futures import Executor, as_completed
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from math import ceil, isnan
from pathlib import Path
from typing import Any, TypeVar

from proofmass.batch.pool import pool
from proofmass.sim.engines import NATIVE_ENGINE
from proofmass.sim.protocol.settings import ParameterValue
from proofmass.studies.measure import (
    Measurement,
    StudyRun,
    measure_task,
    repeat_task,
    write_reference_of,
)
from proofmass.studies.record import NAN, Setting, StudyRow
from proofmass.studies.references import has_one_reference
from proofmass.studies.store import RunKey, Store, task_key

T = TypeVar("T")
Progress = Callable[[str, int, int], None]
Make = Callable[[StudyRun, float], Measurement]
"""Makes a run, within a limit of processor time [s]."""
REPEATS_SECONDS = 0.3
"""Time that all repeats of a long run take together [s]: a short disturbance, such as an
interrupt or another process, is a small share of it."""
LONG_RUN_SECONDS = 0.1
"""Counted time [s] from which a run is long compared with a short disturbance."""


def tell_nobody(label: str, done: int, total: int) -> None:
    """The progress of a study that nobody looks at."""


@dataclass(frozen=True)
class Study:
    """What all runs of a study share: where they are kept, who makes them, and how long they may
    take.

    Attributes
    ----------
    store : Store
        Where every finished run is saved at once.
    workers : Executor, optional
        From `proofmass.batch.pool.pool`.  Without workers calls are made here, one after the other.
    longest : float, optional
        Processor time after which a run is given up [s]; that of the sidecar if not given.
    progress : callable
        Called as ``progress(label, done, total)`` after each run; the total is 0 if it is not
        known.
    failed_references : dict of Path to Measurement
        References of free motions that cannot be evaluated, by their files, with the reason.  They
        are tried once in a study.
    """

    store: Store
    workers: Executor | None = None
    longest: float | None = None
    progress: Progress = tell_nobody
    failed_references: dict[Path, Measurement] = field(default_factory=dict, repr=False)

    @contextmanager
    def working(self) -> Iterator["Study"]:
        """The study with its workers, or with threads of this machine that end with the context."""
        if self.workers:
            yield self
        else:
            with pool() as workers:
                yield replace(self, workers=workers)

    def inside_worker(self, longest: float) -> "Study":
        """The study for functions that workers call: they make their runs there, of `longest` [s].

        It pickles, since it has neither workers nor progress.
        """
        return replace(self, workers=None, longest=self.longest or longest, progress=tell_nobody)

    @property
    def models(self) -> Path:
        """The folder in which changed models are kept."""
        return self.store.folder / "models"

    def limit(self, task: StudyRun) -> float:
        """Processor time after which a run of a task is given up [s]."""
        return self.longest or task.case.run[task.run].timeout

    def results(
        self, function: Callable[..., T], calls: Iterable[tuple]
    ) -> Iterator[tuple[int, T]]:
        """Call a function with each of some arguments: the number and the result of each call.

        They come in the order in which calls end.  Calls that have not begun are cancelled if one
        of them fails, or if the caller stops.
        """
        if self.workers is None:
            for k, arguments in enumerate(calls):
                yield k, function(*arguments)
            return
        futures = {self.workers.submit(function, *each): k for k, each in enumerate(calls)}
        try:
            for future in as_completed(futures):
                yield futures[future], future.result()
        finally:
            for future in futures:
                future.cancel()

    def call_each(self, function: Callable[..., T], calls: Iterable[tuple]) -> list[T]:
        """The results of a function for each of some arguments, in the order of these."""
        found = dict(self.results(function, calls))
        return [found[k] for k in sorted(found)]

    def call(self, function: Callable[..., T], *arguments: Any, **named: Any) -> T:
        """The result of one call of a function."""
        return self.call_each(partial(function, **named), [arguments])[0]

    def measure(
        self, runs: Mapping[RunKey, StudyRun], make: Make, before: int = 0, later: int = 0
    ) -> dict[RunKey, Measurement]:
        """The results of runs: read from the store, or else made within their limits and stored.

        Parameters
        ----------
        runs : mapping of (str, int) to StudyRun
            Tasks by their key in the store and the number of the repeat.
        make : callable
            Makes one of the runs that are not in the store.
        before, later : int
            Numbers of other runs that the progress counts as done, and as to be done.
        """
        loaded = {unit: self.store.load(*unit, self.limit(task)) for unit, task in runs.items()}
        found = {unit: one for unit, one in loaded.items() if one is not None}
        missing = [unit for unit in runs if unit not in found]
        self.write_references(runs[unit] for unit in missing if unit[1] == 0)
        for unit, one in self.make_runs({unit: runs[unit] for unit in missing}, make):
            task = runs[unit]
            found[unit] = one
            self.store.save(*unit, task, one, self.limit(task))
            self.progress(task.label, before + len(found), before + len(runs) + later)
        return found

    def make_runs(
        self, runs: Mapping[RunKey, StudyRun], make: Make
    ) -> Iterator[tuple[RunKey, Measurement]]:
        """Make runs; those whose reference failed have its failure as their result."""
        failed = self.failed_references
        units = [unit for unit, task in runs.items() if task.reference not in failed]
        for unit, task in runs.items():
            if task.reference in failed:
                yield unit, failed[task.reference]
        for k, one in self.results(make, [(runs[unit], self.limit(runs[unit])) for unit in units]):
            yield units[k], one

    def write_references(self, tasks: Iterable[StudyRun]) -> None:
        """Write the references of free motions that are in no file; note those that fail."""
        missing = {
            task.reference: task
            for task in tasks
            if task.reference
            and has_one_reference(task.case, task.run)
            and task.reference not in self.failed_references
            and not task.reference.is_file()
        }
        failures = self.call_each(write_reference_of, [(task,) for task in missing.values()])
        self.failed_references.update(
            {file: one for file, one in zip(missing, failures, strict=True) if one}
        )

    def measure_one(self, task: StudyRun, make: Make) -> Measurement:
        """The result of one run, see `measure`."""
        unit = task.key or task_key(task), 0
        return self.measure({unit: task}, make)[unit]

    def run(
        self,
        tasks: Iterable[StudyRun],
        *,
        repeats: int = 5,
        repeated: Collection[int] | None = None,
        longest_repeated: float = 2.0,
    ) -> list[StudyRow]:
        """Run each task once, then up to `repeats` times more for its processor time alone.

        Repeats are made in rounds: all tasks once, then all of them again.  A run longer than
        `LONG_RUN_SECONDS` is repeated less often: once, or until all its runs together took
        `REPEATS_SECONDS`.  The time of the first run counts as well.

        Parameters
        ----------
        tasks : iterable of StudyRun
            Tasks with the same key are run once.
        repeats : int
            Largest number of repeats of a task; with 0 the rows have no timings.
        repeated : collection of int, optional
            Numbers of the tasks that are repeated, all if not given; the other tasks have one
            timing, that of the first run.
        longest_repeated : float
            A task whose first run counts more than this [s] is not repeated and has one timing.

        Returns
        -------
        list of StudyRow
            One row for each task, in the order of the tasks; outcome and message tell of a failure.

        Raises
        ------
        InputError
            A model or a parameter cannot be used at all.
        """
        tasks = with_references(tasks, self.store)
        keys = self.store.find_keys(tasks)
        by_key = dict(zip(keys, tasks, strict=True))
        again = set(keys) if repeated is None else {keys[k] for k in repeated}
        with self.working() as study:
            first = study.measure(
                {(key, 0): task for key, task in by_key.items()},
                measure_task,
                later=repeats * len(again),
            )
            counts = {
                key: repeats_needed(one.cost, repeats)
                for (key, _), one in first.items()
                if key in again and one.complete and one.cost <= longest_repeated
            }
            # Round by round, not task by task: a disturbance of some seconds then spoils one
            # time of several tasks, not all times of one.
            rounds = {
                (key, n): by_key[key]
                for n in range(1, repeats + 1)
                for key in by_key
                if n <= counts.get(key, 0)
            }
            found = first | study.measure(rounds, repeat_task, before=len(first))
        measured = [
            [found[key, n] for n in range(repeats + 1) if (key, n) in found] for key in keys
        ]
        return [
            make_row(task, each, repeats > 0, key)
            for task, each, key in zip(tasks, measured, keys, strict=True)
        ]


def repeats_needed(seconds: float, repeats: int) -> int:
    """Number of repeats of a run that counts `seconds`: less than `repeats` for long runs.

    >>> [repeats_needed(seconds, 5) for seconds in (0.01, 0.2, 1.5)]
    [5, 1, 1]
    """
    return (
        min(repeats, max(1, ceil(REPEATS_SECONDS / seconds) - 1))
        if seconds >= LONG_RUN_SECONDS
        else repeats
    )


def with_references(tasks: Iterable[StudyRun], store: Store) -> list[StudyRun]:
    """The tasks with the files of their references at the prescribed motions.

    Of the parameters of a setting only the number of segments of rods can change a reference.
    """
    tasks = list(tasks)
    keys = store.find_keys(
        [
            StudyRun(task.case, task.run, Setting(NATIVE_ENGINE, segments_of(task.setting)))
            for task in tasks
        ]
    )
    return [
        replace(task, reference=store.folder / f"{key}.reference.npz")
        for task, key in zip(tasks, keys, strict=True)
    ]


def segments_of(setting: Setting) -> dict[str, ParameterValue]:
    """The number of segments of rods, if a setting has one."""
    return {name: value for name, value in setting.parameters.items() if name == "segments"}


def make_row(task: StudyRun, found: list[Measurement], is_timed: bool, key: str = "") -> StudyRow:
    """The row of a task from its first run, which has the errors, and its repeats.

    If a repeat failed, the row has the outcome of the first one that did.
    """
    first, *repeats = found
    failed = next((k for k, one in enumerate(repeats) if not one.complete), None)
    outcome, message = first.outcome, first.message
    if failed is not None:
        outcome = repeats[failed].outcome
        message = f"repeat {failed + 1}: {repeats[failed].message}"
    timed_runs = [one for one in repeats if one.complete]
    if is_timed and first.complete:
        timed_runs.insert(0, first)
    least = min(timed_runs, key=lambda one: one.seconds, default=first)
    setting = task.setting
    return StudyRow(
        task.study,
        task.case.name,
        task.run,
        setting.engine,
        task.series,
        task.varied,
        task.value,
        dict(setting.parameters),
        first.errors,
        first.invariants,
        least.seconds,
        first.steps,
        tuple(one.seconds for one in timed_runs),
        least.pinned,
        least.shared,
        least.machine,
        outcome,
        message,
        key,
        first.asked,
        first.step,
        max((one.load for one in timed_runs if not isnan(one.load)), default=NAN),
        first.work,
        first.compile_seconds,
    )
