"""Check cases: find them below given paths, run every solver and compare its curves."""

import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import cast

from proofmass.case import Case
from proofmass.compare import Comparison, attach_reference, compare, failed_comparisons
from proofmass.diagnosis import Diagnosis, describe_failure, find_causes
from proofmass.engines import engine_of
from proofmass.errors import InputError, model_error
from proofmass.grouping import group_by
from proofmass.inputs import MODEL_ENDING, SIDECAR_ENDING, is_of_others
from proofmass.mobility import mobility
from proofmass.outcome import (
    FAILED_OUTCOMES,
    GOOD_OUTCOMES,
    OUTCOME_OF_EXCEPTION,
    UNCHECKED_OUTCOMES,
    Outcome,
)
from proofmass.pool import ClusterError, pool, size_of
from proofmass.reference import run_samples
from proofmass.refinement import FinerRun, RefinedRow, RunResult, refined_errors, refinement_runs
from proofmass.self_consistency import PROCESSOR_SECONDS, Rung, why_failed
from proofmass.sidecar import load_case
from proofmass.sim.mjcf import NATIVE_ENGINE
from proofmass.sim.protocol import BadModel, Curves, Diverged, Unsupported
from proofmass.solve import solve_here
from proofmass.strict import Kind
from proofmass.validate import validate_case
from proofmass.worker import Crashed, OutOfMemory, TimedOut, call_isolated

CheckTask = tuple[Case, Kind, str] | FinerRun | Path
LOADING_SECONDS = 60.0  # [s], the time limit of reading a sidecar
OWN_MODEL_TIMEOUT = 900.0
"""Limit of the processor time of a model without a sidecar [s].  The solutions of its motion end by
counts that take about `PROCESSOR_SECONDS`; on a slow machine they take up to 20 times as long."""
OWN_MODEL_SECONDS, OWN_MODEL_SAMPLES = 1.0, 101
"""Length of the motion of a model without a sidecar [s], and the number of times at which two ways
of solving it are compared."""
CAUSES_SECONDS = 60.0  # [s], the time limit of the search for the causes of one run's differences


@dataclass(frozen=True)
class Result:
    """All results of a check: comparisons, their curves, diagnoses, and errors of the input.

    Curves and diagnoses are stored by the names of case, run and solver.  Curves that were compared
    have their reference with them, see `proofmass.reference.ComparedCurves`.  `failed` has the
    curves of failed runs, up to the failure.  Only runs that differ or failed have a diagnosis.
    `paths` are the files and folders that were given; `family_of` names a case's folder by them.
    `of_others` are files of these folders that are neither sidecars nor models, see `find_inputs`.
    """

    cases: list[Case] = field(default_factory=list)
    comparisons: list[Comparison] = field(default_factory=list)
    curves: dict[tuple[str, str, str], Curves] = field(default_factory=dict)
    refined: list[RefinedRow] = field(default_factory=list)
    failed: dict[tuple[str, str, str], Curves] = field(default_factory=dict)
    diagnoses: dict[tuple[str, str, str], Diagnosis] = field(default_factory=dict)
    errors: list[InputError] = field(default_factory=list)
    paths: tuple[Path, ...] = ()
    of_others: list[Path] = field(default_factory=list)

    def _repr_html_(self) -> str:
        from proofmass import as_html

        return as_html(self)

    @property
    def exit_code(self) -> int:
        """0: all agree; 1: something differs, diverged or crashed, or a case is unchecked; 2: bad
        input.
        """
        wrong = any(c.outcome not in GOOD_OUTCOMES for c in self.comparisons)
        return 2 if self.errors else int(wrong or bool(self.unchecked))

    @property
    def unchecked(self) -> list[Case]:
        """Cases that ran without any check, although the sidecar does not say ``unchecked``."""
        ran = {c.case for c in self.comparisons}
        checked = {c.case for c in self.comparisons if c.outcome not in UNCHECKED_OUTCOMES}
        return [case for case in self.cases if case.name in ran - checked and not case.unchecked]


def find_inputs(paths: Iterable[Path], of_others: list[Path] | None = None) -> Iterator[Path]:
    """Find sidecars, and models without a sidecar, in given files and below given folders.

    They are found folder by folder.  Hidden folders and links to folders are not searched.  Files
    of folders that are neither sidecars nor models, see `proofmass.inputs.is_of_others`, are added
    to `of_others`; a file that is given by its name is an input in any case.

    Raises
    ------
    InputError
        A path does not exist or is no input; a folder cannot be read (raised after the files of all
        folders that can).
    """
    for path in paths:
        if not path.exists():
            raise InputError(path, "", "no such file or folder")
        if path.is_dir():
            yield from find_in_folder(path, [] if of_others is None else of_others)
        elif path.suffix == ".xml" and path.with_suffix(".toml").exists():
            yield path.with_suffix(".toml")
        elif path.suffix in (".toml", ".xml"):
            yield path
        else:
            raise InputError(path, "", "neither a sidecar (.toml), a model (.xml) nor a folder")


def find_in_folder(folder: Path, of_others: list[Path]) -> Iterator[Path]:
    """Find what `find_inputs` yields of one folder, and add to `of_others`."""
    unreadable: list[OSError] = []
    nothing = True
    for place, folders, files in os.walk(folder, onerror=unreadable.append):
        there = [Path(place) / name for name in sorted(files + folders)]
        folders[:] = sorted(
            name
            for name in folders
            if not name.startswith(".") and not name.endswith((".toml", ".xml"))
        )
        candidates = [file for file in there if file.suffix in (SIDECAR_ENDING, MODEL_ENDING)]
        by_owner = group_by(candidates, is_of_others)
        of_others += by_owner.get(True, [])
        ours = by_owner.get(False, [])
        found = [file for file in ours if file.suffix == SIDECAR_ENDING]
        found += [
            file
            for file in ours
            if file.suffix == MODEL_ENDING and not file.with_suffix(SIDECAR_ENDING).exists()
        ]
        nothing = nothing and not found
        yield from found
    for error in unreadable:
        raise InputError(Path(error.filename), "", f"cannot be read: {error.strerror}")
    if nothing:
        raise InputError(folder, "", "no sidecar (.toml) and no model (.xml) in this folder")


def family_of(file: Path, paths: Iterable[Path]) -> str:
    """The family of a file: the path of its folder below the given folder in which it was found.

    The family of a file in the given folder itself, or of a given file, is its folder's own name.

    >>> family_of(Path("models/linkages/fourbar.toml"), [Path("models")])
    'linkages'
    >>> family_of(Path("models/linkages/fourbar.toml"), [Path("models/linkages")])
    'linkages'
    """
    folder = file.parent
    given = [path for path in paths if folder.is_relative_to(path)]
    nearest = max(given, key=lambda path: len(path.parts), default=folder)
    return (
        folder.relative_to(nearest).as_posix()
        if folder != nearest
        else Path(os.path.abspath(folder)).name
    )


def unique_names(files: Iterable[Path]) -> dict[Path, str]:
    """Choose a name for each sidecar, and each model without one: the name of its file.

    If several files have the same name, as many folders are put before it as make it unique.  A
    sidecar keeps its plain name if only models share it.

    >>> unique_names([Path("/a/arm.toml"), Path("/b/arm.toml"), Path("/b/leg.toml")]).values()
    dict_values(['a/arm', 'b/arm', 'leg'])
    """
    places = {file: Path(os.path.abspath(file)).with_suffix("").parts for file in files}
    same_stem = group_by(places, lambda file: file.stem)
    found = {}
    for file, own in places.items():
        others = [
            places[other]
            for other in same_stem[file.stem]
            if places[other] != own and (file.suffix == ".xml" or other.suffix == ".toml")
        ]
        length = 1
        while any(other[-length:] == own[-length:] for other in others):
            length += 1
        found[file] = "/".join(own[-length:])
    return found


def rename_case(case: Case, name: str) -> Case:
    """The case under a name, which may differ from that of its file."""
    return case if case.name == name else case.model_copy(update={"called": name})


def read_isolated(path: Path) -> Case:
    """Read a sidecar in another process; its model and reference too if it leaves channels out.

    Raises
    ------
    InputError
        Also if reading fails in another way, or takes too long.
    """
    try:
        return call_isolated(load_case, path, timeout=LOADING_SECONDS)
    except InputError:
        raise
    except Exception as error:
        words = str(error) or type(error).__name__
        raise InputError(path, "", f"cannot be read: {words}") from None


def load_validated(path: Path, strict: bool = False) -> Case:
    """Read a sidecar and `validate_case` the case.

    A validation that takes more time or memory than any of the runs may is no error, since the runs
    will report it; with `strict` it is an error.

    Raises
    ------
    InputError
        The sidecar, its model or its reference is at fault.
    """
    case = read_isolated(path)
    try:
        call_isolated(
            validate_case,
            case,
            timeout=max(run.timeout for run in case.run.values()),
            memory=max(run.memory for run in case.run.values()),
        )
    except InputError:
        raise
    except Exception as error:  # the runs fail for the same reason, and report it
        if strict:
            raise InputError(path, "", f"its model or its reference: {error}") from None
    return case


def run_solver(
    case: Case, kind: Kind, solver: str, compare_curves: Callable[..., list[Comparison]] = compare
) -> tuple[list[Comparison], Curves | None]:
    """Run and compare one solver; a failed run gives failed comparisons, and its curves if any.

    The model is compiled and the reference evaluated in the run's own process, within its limits.
    A model that the simulator does not cover is bad input: the sidecar asked for it.
    """
    limits = case.run[kind]
    try:
        return call_isolated(
            run_and_compare,
            case,
            kind,
            solver,
            compare_curves,
            timeout=limits.timeout,
            memory=limits.memory,
        )
    except Unsupported as error:
        raise case.error(
            f"run.{kind}.solvers",
            f"{solver} cannot run {case.model}: {error}; leave it out",
        ) from None
    except tuple(OUTCOME_OF_EXCEPTION) as error:
        advice = ""
        if isinstance(error, (TimedOut, OutOfMemory)):
            key = "timeout" if isinstance(error, TimedOut) else "memory"
            advice = f"; {key} in [run.{kind}] allows more"
        curves = error.curves if isinstance(error, Diverged) else None
        return failed_comparisons(case, kind, solver, error, advice), curves


def run_and_compare(
    case: Case, kind: Kind, solver: str, compare_curves: Callable[..., list[Comparison]]
) -> tuple[list[Comparison], Curves]:
    """Do what `run_solver` does, in this process; an unexpected exception becomes a crash."""
    try:
        mobility(case)
        curves = solve_here(case, kind, solver)
        return compare_curves(case, kind, solver, curves), attach_reference(case, kind, curves)
    except (InputError, MemoryError):
        raise
    except tuple(OUTCOME_OF_EXCEPTION):
        raise
    except Exception as error:
        raise Crashed(f"{type(error).__name__}: {error}") from error


def early_end_error(
    case: Case, kind: Kind, solver: str, curves: Curves | None
) -> InputError | None:
    """The error of a sweep that ended early, such as at a limit position; its curves are kept."""
    if curves is None or not curves.stopped:
        return None
    return case.error(
        "drive",
        f"the {solver} {kind} ends at sample {curves.x.size} of "
        f"{run_samples(case, kind).size}, which are kept: {curves.stopped}",
    )


def check_bare_model(model: Path) -> list[Comparison]:
    """Check a model without a sidecar by itself, see `proofmass.self_consistency`."""
    try:
        return [call_isolated(check_model_here, model, timeout=OWN_MODEL_TIMEOUT)]
    except BadModel as error:
        raise model_error(model, error) from None
    except tuple(OUTCOME_OF_EXCEPTION) as error:
        outcome = OUTCOME_OF_EXCEPTION[type(error)]
        one = Comparison(model.stem, NATIVE_ENGINE, "dynamics", "", "")
        return [replace(one, outcome=outcome, message=str(error))]


def check_model_here(model: Path) -> Comparison:
    """Do what `check_bare_model` does, in this process.

    The comparison has the error of the model's own run; `at` is the time until which the motion is
    known.
    """
    motion = engine_of(NATIVE_ENGINE).own_motion(
        model, OWN_MODEL_SECONDS, OWN_MODEL_SAMPLES, PROCESSOR_SECONDS
    )
    own = motion.runs[0]
    found = Comparison(
        model.stem,
        NATIVE_ENGINE,
        "dynamics",
        "",
        "m",
        seconds=own.seconds,
        steps=round(float(motion.times[len(own.points) - 1]) / own.step),
        violation=float(own.gap.max(initial=0.0)),
    )
    if failed := why_failed(motion):
        return replace(found, outcome=Outcome.DIVERGED, message=failed)
    rung = Rung(motion)
    if not rung.consistent:
        return replace(found, outcome=Outcome.UNCHECKED, message=rung.words())
    return replace(
        found,
        error_max=rung.error(own),
        at=rung.until,
        uncertainty=rung.known,
        outcome=Outcome.SELF_CONSISTENT,
        message=rung.words(),
    )


def check(
    paths: Iterable[Path | str] = ("models",),
    jobs: int | None = None,
    progress: Callable[[str, int, int], None] = lambda *_: None,
    causes: bool = True,
    detectable: bool = True,
    dask: str | None = None,
) -> Result:
    """Run every case below `paths` and compare it with its reference.

    Parameters
    ----------
    paths : iterable of path
        Sidecars, models, folders.
    jobs : int, optional
        Number of parallel runs; the number of processors, or of threads of the cluster, if not
        given.
    progress : callable, optional
        Called as ``progress(label, done, total)`` after each run.
    causes : bool
        Whether to search for changes that would explain why a run differs.
    detectable : bool
        Whether to find `Comparison.detectable` as well, see `compare`.
    dask : str, optional
        Address of the scheduler of a Dask cluster on which the runs are made, see
        `proofmass.pool.pool`; they are made on this machine if not given.

    Returns
    -------
    Result
        Errors of the input are collected in `Result.errors`; the other cases still run.
    """
    given = tuple(map(Path, paths))
    if dask is not None:
        given = tuple(path.absolute() for path in given)  # workers run in other folders
    result = Result(paths=given)
    with pool(jobs, dask) as executor:
        tasks = plan_tasks(collect_inputs(given, result.errors, result.of_others), result, executor)
        outcomes = run_tasks(
            tasks, result, executor, jobs or size_of(executor), progress, detectable
        )
        collect_outcomes(tasks, outcomes, result)
        if causes:
            diagnose_runs(result, executor, progress)
    return result


def plan_tasks(paths: list[Path], result: Result, pool: Executor) -> list[CheckTask]:
    """Read the sidecars and list the tasks; cases and errors are added to the result."""
    tasks: list[CheckTask] = []
    names = unique_names(paths)
    read = {path: pool.submit(load_validated, path) for path in paths if path.suffix != ".xml"}
    for path in paths:
        try:
            if path not in read:
                tasks.append(path)
                continue
            case = rename_case(read[path].result(), names[path])
            tasks += [(case, k, s) for k, r in case.run.items() for s in r.solvers]
            tasks += refinement_runs(case)
            result.cases.append(case)
        except InputError as error:
            result.errors.append(error)
    return tasks


def run_tasks(
    tasks: list[CheckTask],
    result: Result,
    pool: Executor,
    jobs: int,
    progress: Callable[[str, int, int], None],
    detectable: bool,
) -> dict[int, RunResult]:
    """Run the tasks, and give their results by number; tasks with bad input add errors instead.

    A free worker continues with a task of its last case, since it has the compiled model of that
    case in memory, and its reference at changed parameters.
    """
    outcomes = dict[int, RunResult]()
    waiting: dict[Path, list[int]] = {}
    for k, task in enumerate(tasks):
        waiting.setdefault(task_file(task), []).append(k)
    running, last = dict[Future[RunResult], int](), list[Path]()
    while waiting or running:
        while waiting and len(running) < jobs:
            k = take_task(
                waiting,
                last.pop() if last else None,
                {task_file(tasks[other]) for other in running.values()},
            )
            running[pool.submit(run_task, tasks[k], detectable)] = k
        for future in wait(running, return_when=FIRST_COMPLETED).done:
            k = running.pop(future)
            last.append(task_file(tasks[k]))
            try:
                outcomes[k] = future.result()
            except InputError as error:
                if str(error) not in map(str, result.errors):
                    result.errors.append(error)
            except ClusterError:
                raise
            except Exception as error:  # so that the other tasks keep their results
                result.errors.append(
                    InputError(
                        task_file(tasks[k]),
                        "",
                        f"{task_label(tasks[k])} failed: {type(error).__name__}: {error}",
                    )
                )
            count = len(tasks) - len(running) - sum(map(len, waiting.values()))
            progress(task_label(tasks[k]), count, len(tasks))
    return outcomes


def take_task(waiting: dict[Path, list[int]], preferred: Path | None, busy: set[Path]) -> int:
    """Take a task of the file `preferred`, or of a file that no worker is busy with, or of any
    file.

    >>> waiting = {Path("a"): [0, 1], Path("b"): [2]}
    >>> take_task(waiting, None, set()), take_task(waiting, None, {Path("a")})
    (0, 2)
    >>> take_task(waiting, Path("b"), {Path("a")}), waiting
    (1, {})
    """
    free = [file for file in waiting if file not in busy]
    file = preferred if preferred in waiting else (free or list(waiting))[0]
    k = waiting[file].pop(0)
    if not waiting[file]:
        del waiting[file]
    return k


def collect_outcomes(
    tasks: list[CheckTask], outcomes: dict[int, RunResult], result: Result
) -> None:
    """Add the outcomes of the tasks to the result, in the order of the tasks."""
    models = [task for task in tasks if isinstance(task, Path)]
    names = unique_names([*models, *(case.file for case in result.cases)])
    for k in sorted(outcomes):
        task, (comparisons, curves) = tasks[k], outcomes[k]
        if isinstance(task, Path):
            comparisons = [replace(c, case=names[task]) for c in comparisons]
        if isinstance(task, FinerRun):
            try:
                rows, comparisons = task.study.add(task.segments, outcomes[k])
            except InputError as error:
                result.errors.append(error)
                continue
            except tuple(OUTCOME_OF_EXCEPTION) as error:
                result.errors.append(task.case.error("refine", str(error)))
                continue
            result.refined.extend(rows)
        elif curves is not None and not isinstance(task, Path):
            kept = result.failed if comparisons[0].outcome in FAILED_OUTCOMES else result.curves
            kept[task[0].name, task[1], task[2]] = curves
        result.comparisons.extend(comparisons)
        if not isinstance(task, Path) and (early := early_end_error(*task[:3], curves)):
            result.errors.append(early)


def diagnose_runs(
    result: Result, pool: Executor, progress: Callable[[str, int, int], None] = lambda *_: None
) -> None:
    """Search for the causes of all runs that differ or failed, and add them to the result.

    The search is most thorough for the first run of a case; its others likely have the same cause.
    """
    cases = {case.name: case for case in result.cases}
    differing = dict.fromkeys(
        (c.case, c.run, c.solver) for c in result.comparisons if c.outcome == Outcome.DIFFERS
    )
    runs = {key: result.curves[key] for key in differing if key in result.curves} | result.failed
    first = {name: (name, run, solver) for name, run, solver in reversed(runs)}
    futures = [
        pool.submit(
            diagnose_run,
            cases[name],
            cast(Kind, run),
            solver,
            curves,
            (name, run, solver) in result.failed,
            first[name] == (name, run, solver),
        )
        for (name, run, solver), curves in runs.items()
    ]
    for k, (key, future) in enumerate(zip(runs, futures, strict=True)):
        result.diagnoses[key] = future.result()
        progress(f"{' '.join(key)}: causes", k + 1, len(runs))


def diagnose_run(
    case: Case,
    run: Kind,
    solver: str,
    curves: Curves,
    failed: bool = False,
    thorough: bool = True,
) -> Diagnosis:
    """Search for the causes of one run in a worker; a search that fails gives its own error."""
    search = describe_failure if failed else partial(find_causes, thorough=thorough)
    limits = {"timeout": CAUSES_SECONDS, "memory": case.run[run].memory}
    try:
        return cast(Diagnosis, call_isolated(search, case, run, solver, curves, **limits))
    except Exception as error:  # so that the comparisons are reported in any case
        return Diagnosis(
            case.name, run, solver, fault=str(error) or type(error).__name__, failed=failed
        )


def collect_inputs(
    paths: Iterable[Path | str], errors: list[InputError], of_others: list[Path] | None = None
) -> list[Path]:
    """Apply `find_inputs` to one path at a time, so that one wrong path does not hide the others.

    A file that is found by two paths is listed once.
    """
    found: dict[str, Path] = {}
    for path in paths:
        try:
            for file in find_inputs([Path(path)], of_others):
                found.setdefault(os.path.abspath(file), file)
        except InputError as error:
            errors.append(error)
        except OSError as error:
            errors.append(InputError(Path(path), "", f"cannot be read: {error.strerror}"))
    return list(found.values())


def run_task(task: CheckTask, detectable: bool = True) -> tuple[list[Comparison], Curves | None]:
    """Run one task: a run of a case, or the check of a model without a sidecar."""
    if isinstance(task, Path):
        return check_bare_model(task), None
    compare_curves = partial(compare, detectable=detectable)
    return run_solver(
        *task[:3], compare_curves=refined_errors if isinstance(task, FinerRun) else compare_curves
    )


def task_file(task: CheckTask) -> Path:
    """The file that asked for a task."""
    return task if isinstance(task, Path) else task[0].file


def task_label(task: CheckTask) -> str:
    """The name of a task in a progress line."""
    if isinstance(task, Path):
        return task.name
    finer = f", {task.segments} segments" if isinstance(task, FinerRun) else ""
    return f"{task[0].name} {task[1]} {task[2]}{finer}"
