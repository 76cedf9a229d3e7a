"""Run the tasks of a study in parallel; each result is stored at once, so that a study can resume.

    with pool(jobs=2) as workers:                  # or pool(dask="tcp://...")
        study = Study(Store(folder), workers)
        rows = study.run(tasks, repeats=0)         # errors and invariants; one run each
        rows = study.run(tasks)                    # the same, and times of 5 more rounds
    write_table(rows, folder / "trade.csv")
    study.store.curves(rows[0].key)                # x, channel.angle, ...

A run that is in the store is not made again, even if another study asked for it.
"""

from collections.abc import Callable, Collection, Iterable, Iterator
from concurrent.futures import Executor, as_completed
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from math import ceil, isnan
from pathlib import Path

from proofmass.base.strict import Kind
from proofmass.batch.pool import pool
from proofmass.case.case import Case
from proofmass.studies.measure import Measurement, StudyRun, measure_task
from proofmass.studies.record import NAN, Setting, StudyRow
from proofmass.studies.store import Store

Progress = Callable[[str, int, int], None]
RunKey = tuple[str, int]  # key of a task and number of the repeat; 0 is the first run, with errors
REPEATS_SECONDS = 0.3
"""Time that all repeats of a long run take together [s]: a short disturbance, such as an
interrupt or another process, is a small share of it."""
LONG_RUN_SECONDS = 0.1
"""Counted time [s] from which a run is long compared with a short disturbance."""


@dataclass(frozen=True)
class Study:
    """What all runs of a study share: where they are kept, who makes them, and how long they may
    take.

    Attributes
    ----------
    store : Store
        Where every finished run is saved at once.
    workers : Executor, optional
        From `proofmass.batch.pool.pool`; threads of this machine if not given.
    longest : float, optional
        Processor time after which a run is given up [s]; that of the sidecar if not given.
    progress : callable
        Called as ``progress(label, done, total)`` after each run.
    """

    store: Store
    workers: Executor | None = None
    longest: float | None = None
    progress: Progress = lambda *_: None

    @contextmanager
    def working(self) -> Iterator[Executor]:
        """The workers of the study, or threads of this machine that end with the context."""
        if self.workers:
            yield self.workers
        else:
            with pool() as workers:
                yield workers

    @property
    def models(self) -> Path:
        """The folder in which changed models are kept."""
        return self.store.folder / "models"

    def limit(self, task: StudyRun) -> float:
        """Processor time after which a run of a task is given up [s]."""
        return self.longest or task.case.run[task.run].timeout

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
        again = set(keys) if repeated is None else {keys[k] for k in repeated}
        with self.working() as workers:
            rounds = Rounds(dict(zip(keys, tasks, strict=True)), self, workers)
            rounds.make_runs([(key, 0) for key in rounds.tasks], later=repeats * len(again))
            timed = {
                key: repeats_needed(one.cost, repeats)
                for key in rounds.tasks
                if key in again
                and (one := rounds.found[key, 0]).complete
                and one.cost <= longest_repeated
            }
            # Round by round, not task by task: a disturbance of some seconds then spoils one
            # time of several tasks, not all times of one.
            rounds.make_runs(
                [
                    (key, n)
                    for n in range(1, repeats + 1)
                    for key, most in timed.items()
                    if n <= most
                ]
            )
        found = [
            [rounds.found[key, n] for n in range(repeats + 1) if (key, n) in rounds.found]
            for key in keys
        ]
        return [
            make_row(task, each, repeats > 0, key)
            for task, each, key in zip(tasks, found, keys, strict=True)
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
    """The tasks with the file of their reference, which all tasks of one run of a case share."""
    files: dict[tuple[int, Kind], Path | None] = {}
    found = list[StudyRun]()
    for task in tasks:
        if (run := (id(task.case), task.run)) not in files:
            files[run] = reference_file(task, store)
        found.append(replace(task, reference=files[run]))
    return found


def has_shared_reference(case: Case, kind: Kind) -> bool:
    """Whether all settings of a run have the same reference: a free motion without rods."""
    return kind == "dynamics" and not case.drive and not case.rod


def reference_file(task: StudyRun, store: Store) -> Path | None:
    """File of the reference of a run if `has_shared_reference`, else None."""
    if not has_shared_reference(task.case, task.run):
        return None
    first = replace(task, setting=Setting("mujoco"), key="")
    return store.folder / f"{store.key(first)}.reference.npz"


@dataclass
class Rounds:
    """Runs of tasks, found in the store or made, with what is needed to make more of them."""

    tasks: dict[str, StudyRun]
    study: Study
    workers: Executor
    found: dict[RunKey, Measurement] = field(default_factory=dict)

    def make_runs(self, units: list[RunKey], later: int = 0) -> None:
        """Load runs from the store, then make the missing ones; `later` counts as work to come."""
        total = len(self.found) + len(units) + later
        store, missing = self.study.store, list[RunKey]()
        for unit in units:
            key, repeat = unit
            if (one := store.load(key, repeat, self.limit(key))) is None:
                missing.append(unit)
            else:
                self.found[unit] = one
        futures = {
            self.workers.submit(measure_task, self.tasks[key], repeat > 0, self.limit(key)): (
                key,
                repeat,
            )
            for key, repeat in missing
        }
        try:
            for future in as_completed(futures):
                key, repeat = futures[future]
                self.found[key, repeat] = future.result()
                store.save(key, repeat, self.tasks[key], future.result(), self.limit(key))
                self.study.progress(self.tasks[key].label, len(self.found), total)
        finally:
            for future in futures:
                future.cancel()

    def limit(self, key: str) -> float:
        """Processor time after which a run of a task is given up [s]."""
        return self.study.limit(self.tasks[key])


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
    )
