"""Check cases: find them below given paths, run every solver and compare its curves."""

import os
from collections.abc import Callable, Collection, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, TypeAlias, cast

from proofmass.base.display import ShownAsHtml
from proofmass.base.errors import InputError, model_error
from proofmass.base.files import MODEL_ENDING, readable
from proofmass.base.grouping import group_by
from proofmass.base.strict import Kind
from proofmass.base.worker import OutOfMemory, TimedOut, call_isolated
from proofmass.batch.pool import ClusterError, pool, size_of
from proofmass.batch.work import (
    check_model_here,
    compare_and_share,
    count_samples,
    load_here,
    read_remarks_here,
    run_and_compare,
    screen_here,
    validate_here,
)
from proofmass.case.case import Case
from proofmass.case.inputs import SIDECAR_ENDING, is_of_others, names_program
from proofmass.run.asked import with_engines
from proofmass.sim.engines import NATIVE_ENGINE
from proofmass.sim.model_source import (
    ADVICE,
    SEARCHED_ENDINGS,
    SOURCE_ENDINGS,
    ModelSource,
    is_model_object,
    source_of_object,
)
from proofmass.sim.protocol.curves import Curves
from proofmass.sim.protocol.failures import BadModel, Diverged, Unavailable, Unsupported
from proofmass.verdict.comparison import Comparison, Comparisons, failed_comparisons
from proofmass.verdict.outcome import (
    FAILED_OUTCOMES,
    GOOD_OUTCOMES,
    OUTCOME_OF_EXCEPTION,
    UNCHECKED_OUTCOMES,
    Outcome,
)
from proofmass.verdict.refinement import (
    FinerRun,
    RefinedRow,
    RunResult,
    refined_errors,
    refinement_runs,
)

if TYPE_CHECKING:
    import mujoco

    from proofmass.evidence.diagnosis import Diagnosis, Explanation, SharedCause
    from proofmass.screen.screen import Screen

CheckTask = tuple[Case, Kind, str] | FinerRun | ModelSource
Checkable: TypeAlias = "Path | str | Case | mujoco.MjModel | mujoco.MjSpec"
"""What can be checked: files and folders by their paths, cases, and models of MuJoCo."""
LOADING_SECONDS = 60.0  # [s], the time limit of reading a sidecar
BARE_WITH_ENGINES = (
    "a model without a sidecar is checked by itself, in MuJoCo: give no engine, compare versions "
    "with proofmass versions, or write a sidecar with proofmass new"
)
OWN_MODEL_TIMEOUT = 900.0
"""Limit of the processor time of a model without a sidecar [s].  The solutions of its motion end by
counts that take about `PROCESSOR_SECONDS`; on a slow machine they take up to 20 times as long."""
SCREEN_SECONDS = 120.0
"""Limit of the processor time of a first screen [s]; the largest public models take up to 20 s."""
CAUSES_SECONDS = 600.0
"""Processor time after which the search for the causes of one run's differences is ended [s].  It
ends by counts, after 3 min with the slowest shipped reference; this only ends what hangs."""


@dataclass(frozen=True)
class Result(ShownAsHtml):
    """All results of a check: comparisons, their curves, diagnoses, and errors of the input.

    Curves, diagnoses and notes are stored by the names of case, run and solver.  Curves that were
    compared have their reference with them, see `ComparedCurves`; they are not kept where a
    `CaseConsumer` took them.  `failed` has the curves of failed runs, up to the failure; `notes`
    has the remarks on the others.  Only runs that differ or failed have a diagnosis.
    `paths` are the files and folders that were given; `family_of` names a case's folder by them.
    `screens` has the first screens of models without a sidecar, and of models that blew up, by the
    names of their cases; `remarks` what reading such a model left out or assumed.
    `versions` has what computed, package by package, of solvers in interpreters of their own.
    `of_others` are files of these folders that are neither sidecars nor models, see `find_inputs`.
    """

    cases: list[Case] = field(default_factory=list)
    comparisons: list[Comparison] = field(default_factory=list)
    curves: dict[tuple[str, str, str], Curves] = field(default_factory=dict)
    refined: list[RefinedRow] = field(default_factory=list)
    failed: dict[tuple[str, str, str], Curves] = field(default_factory=dict)
    diagnoses: dict[tuple[str, str, str], "Diagnosis"] = field(default_factory=dict)
    notes: dict[tuple[str, str, str], tuple[str, ...]] = field(default_factory=dict)
    screens: dict[str, "Screen"] = field(default_factory=dict)
    remarks: dict[str, tuple[str, ...]] = field(default_factory=dict)
    versions: dict[str, dict[str, str]] = field(default_factory=dict)
    errors: list[InputError] = field(default_factory=list)
    paths: tuple[Path, ...] = ()
    of_others: list[Path] = field(default_factory=list)

    def has_finding(self, kinds: Collection[str]) -> bool:
        """Whether a first screen has a finding of some kinds, `FindingKind`."""
        return any(
            finding.kind in kinds for screen in self.screens.values() for finding in screen.findings
        )

    @property
    def exit_code(self) -> int:
        """0: all agree; 1: something differs, diverged or crashed, or a case is unchecked; 2: bad
        input.
        """
        wrong = any(c.outcome not in GOOD_OUTCOMES for c in self.comparisons)
        return 2 if self.errors else int(wrong or bool(self.unchecked))

    @property
    def causes(self) -> "list[SharedCause]":
        """The best causes of all runs that differ, each once; see `shared_causes`."""
        if not self.diagnoses:
            return []
        from proofmass.evidence.diagnosis import shared_causes

        return shared_causes(self.diagnoses.values())

    @property
    def unchecked(self) -> list[Case]:
        """Cases that ran without any check, although the sidecar does not say ``unchecked``."""
        ran = {c.case for c in self.comparisons}
        checked = {c.case for c in self.comparisons if c.outcome not in UNCHECKED_OUTCOMES}
        left = ran - checked
        return [c for c in self.cases if c.name in left and not (c.unchecked or c.asked)]


def find_inputs(paths: Iterable[Path], of_others: list[Path] | None = None) -> Iterator[Path]:
    """Find sidecars, and models without a sidecar, in given files and below given folders.

    They are found folder by folder.  Hidden folders and links to folders are not searched.  Files
    of folders that are neither sidecars nor models, see `proofmass.case.inputs.is_of_others`, are
    added to `of_others`; a file that is given by its name is an input in any case.  A sidecar whose
    reference is a program is an input only if it is given by its name, since its code runs.

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
        elif path.suffix in SEARCHED_ENDINGS and path.with_suffix(SIDECAR_ENDING).exists():
            yield path.with_suffix(SIDECAR_ENDING)
        elif path.suffix in (SIDECAR_ENDING, *SOURCE_ENDINGS):
            yield path
        else:
            known = "neither a sidecar (.toml), a model (.xml, .urdf, .mjb) nor a folder"
            raise InputError(path, "", ADVICE.get(path.suffix, known))


def find_in_folder(folder: Path, of_others: list[Path]) -> Iterator[Path]:
    """Find what `find_inputs` yields of one folder, and add to `of_others`."""
    unreadable: list[OSError] = []
    programs: list[Path] = []
    nothing = True
    for place, folders, files in os.walk(folder, onerror=unreadable.append):
        wrong = [name for name in folders if name.endswith((SIDECAR_ENDING, MODEL_ENDING))]
        there = [Path(place) / name for name in sorted(files + wrong)]
        folders[:] = sorted(
            name for name in folders if not name.startswith(".") and name not in wrong
        )
        known = SIDECAR_ENDING, *SEARCHED_ENDINGS
        candidates = [file for file in there if file.suffix in known]
        by_owner = group_by(candidates, is_of_others)
        of_others += by_owner.get(True, [])
        ours = by_owner.get(False, [])
        found = [file for file in ours if file.suffix == SIDECAR_ENDING]
        found += [
            file
            for file in ours
            if file.suffix in SEARCHED_ENDINGS and not file.with_suffix(SIDECAR_ENDING).exists()
        ]
        nothing = nothing and not found
        by_kind = group_by(found, names_program)
        programs += by_kind.get(True, [])
        yield from by_kind.get(False, [])
    for error in unreadable:
        raise InputError(Path(error.filename), "", f"cannot be read: {error.strerror}")
    if programs:
        others = f" (and {len(programs) - 1} more)" if programs[1:] else ""
        raise InputError(
            programs[0],
            "reference",
            f"it is a program beside the sidecar, and a search of a folder runs none{others}; give "
            "the sidecar itself, if you trust it",
        )
    if nothing:
        raise InputError(folder, "", "no sidecar (.toml) and no model (.xml, .urdf) in this folder")


def folder_of(file: Path, paths: Iterable[Path]) -> Path | None:
    """The nearest given folder in which a file was found; None if the file itself was given."""
    if file in (paths := tuple(paths)):
        return None
    given = [path for path in paths if file.is_relative_to(path)]
    return max(given, key=lambda path: len(path.parts), default=None)


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
    return readable(
        folder.relative_to(nearest).as_posix()
        if folder != nearest
        else Path(os.path.abspath(folder)).name
    )


def unique_names(files: Iterable[Path]) -> dict[Path, str]:
    """Choose a name for each sidecar, and each model without one: the name of its file.

    If several files have the same name, as many folders are put before it as make it unique.  A
    sidecar keeps its plain name if only models share it.  Models that differ by their endings alone
    are named with these.

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
            if places[other] != own
            and (file.suffix != SIDECAR_ENDING or other.suffix == SIDECAR_ENDING)
        ]
        length = 1
        while any(other[-length:] == own[-length:] for other in others):
            length += 1
        twins = [other for other in same_stem[file.stem] if places[other] == own]
        ending = file.suffix if twins[1:] and file.suffix != SIDECAR_ENDING else ""
        found[file] = readable("/".join(own[-length:]) + ending)
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
        return call_isolated(load_here, path, timeout=LOADING_SECONDS)
    except InputError:
        raise
    except Exception as error:
        words = str(error) or type(error).__name__
        if names_program(path):
            raise InputError(path, "reference", f"its program cannot be loaded: {words}") from None
        raise InputError(path, "", f"cannot be read: {words}") from None


def load_validated(path: Path, strict: bool = False) -> Case:
    """Read a sidecar and validate the case, see `validate_isolated`."""
    case = read_isolated(path)
    validate_isolated(case, strict)
    return case


def validate_isolated(case: Case, strict: bool = False) -> None:
    """Validate a case in another process.

    A validation that takes more time or memory than any of the runs may is no error, since the runs
    will report it; with `strict` it is an error.

    Raises
    ------
    InputError
        The sidecar, its model or its reference is at fault.
    """
    try:
        call_isolated(
            validate_here,
            case,
            timeout=max(run.timeout for run in case.run.values()),
            memory=max(run.memory for run in case.run.values()),
        )
    except InputError:
        raise
    except Exception as error:  # the runs fail for the same reason, and report it
        if strict:
            raise InputError(case.file, "", f"its model or its reference: {error}") from None


def run_solver(
    case: Case,
    kind: Kind,
    solver: str,
    compare_curves: Callable[[Case, Kind, str, Curves], Comparisons] = compare_and_share,
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
        if solver in case.asked or isinstance(error, Unavailable):
            return failed_comparisons(case, kind, solver, error), None
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


def early_end_error(
    case: Case, kind: Kind, solver: str, curves: Curves | None
) -> InputError | None:
    """The error of a sweep that ended early, such as at a limit position; its curves are kept."""
    if curves is None or not curves.stopped:
        return None
    limits = case.run[kind]
    asked = call_isolated(count_samples, case, kind, timeout=limits.timeout, memory=limits.memory)
    return case.error(
        "drive",
        f"the {solver} {kind} ends at sample {curves.x.size} of {asked}, which are kept: "
        f"{curves.stopped}",
    )


def screen_isolated(source: ModelSource) -> "Screen | None":
    """Screen a model in a worker; None if that fails, since its runs say why."""
    with suppress(Exception):
        return cast("Screen", call_isolated(screen_here, source, timeout=SCREEN_SECONDS))
    return None


def remarks_isolated(source: ModelSource) -> tuple[str, ...]:
    """Do what `read_remarks_here` does, in a worker; empty if that fails, which its runs report."""
    with suppress(Exception):
        return call_isolated(read_remarks_here, source, timeout=SCREEN_SECONDS)
    return ()


def check_bare_model(source: ModelSource) -> list[Comparison]:
    """Do what `check_model_here` does, in a worker; a failure is an outcome."""
    try:
        return [call_isolated(check_model_here, source, timeout=OWN_MODEL_TIMEOUT)]
    except BadModel as error:
        raise model_error(source.file, error) from None
    except tuple(OUTCOME_OF_EXCEPTION) as error:
        outcome = OUTCOME_OF_EXCEPTION[type(error)]
        one = Comparison(source.file.stem, NATIVE_ENGINE, "dynamics", "", "")
        return [replace(one, outcome=outcome, message=str(error))]


class CaseConsumer(Protocol):
    """What takes the results of cases one by one, so that their curves need not be kept."""

    def begin(self, result: Result) -> None:
        """Take the cases and the errors of the input, before the first run."""

    def take(self, part: Result) -> None:
        """Take the result of one case, whose runs have all ended; called from several threads."""


def check(
    paths: "Iterable[Checkable] | Checkable" = ("models",),
    jobs: int | None = None,
    progress: Callable[[str, int, int], None] = lambda *_: None,
    causes: bool = True,
    detectable: bool = True,
    dask: str | None = None,
    consumer: CaseConsumer | None = None,
    engines: tuple[str, ...] = (),
) -> Result:
    """Run every case below `paths` and compare it with its reference.

    Parameters
    ----------
    paths : path, Case, MjModel, MjSpec, or an iterable of these
        Sidecars, models (MJCF, URDF, MJB), folders; cases, also changed ones; models of MuJoCo, of
        which workers get a copy.
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
        `proofmass.batch.pool.pool`; they are made on this machine if not given.
    consumer : CaseConsumer, optional
        Takes the result of each case when its last run has ended.  The curves of a case are then
        not kept, so that the memory does not depend on the number of cases.

    engines : tuple of str, optional
        Engines that make the runs in place of the solvers of the sidecars, such as ``drake`` or
        ``mujoco==3.3.7``.  What they cannot run is unsupported or unavailable and no error.

    Returns
    -------
    Result
        Errors of the input are collected in `Result.errors`; the other cases still run.
    """
    given, objects = sort_given(paths)
    if dask is not None:
        given = tuple(path.absolute() for path in given)  # workers run in other folders
    result = Result(paths=given)
    with pool(jobs, dask) as executor, ThreadPoolExecutor(os.cpu_count()) as threads:
        inputs = collect_inputs(given, result.errors, result.of_others)
        parts = plan_parts(inputs, objects, result, executor, engines)
        if consumer is not None:
            consumer.begin(result)
        follow = partial(stages_of, causes=causes, detectable=detectable, consumer=consumer)
        run_parts(parts, executor, threads, jobs or size_of(executor), progress, follow)
        for part in parts:
            add_part(result, part.result)
        if causes:
            share_causes(result, executor)
    return result


class CheckStep(NamedTuple):
    """A call, and what the main thread does with its future when it has ended.

    The steps that progress is counted by have a label.  A step that is not `here`, in this process,
    may be made on another machine.
    """

    label: str
    call: Callable[[], Any]
    keep: Callable[[Future[Any]], Any] = Future.result
    here: bool = False


def is_checkable(thing: Any) -> bool:
    """Whether something is a `Checkable`."""
    return isinstance(thing, Path | str | Case) or is_model_object(thing)


def sort_given(given: "Iterable[Checkable] | Checkable") -> tuple[tuple[Path, ...], list[Any]]:
    """The paths among what is to be checked, and the cases and models of MuJoCo.

    Raises
    ------
    TypeError
        Something is none of these.
    """
    things = [given] if is_checkable(given) else list(cast("Iterable[Checkable]", given))
    paths, objects = list[Path](), list[Any]()
    for one in things:
        if isinstance(one, Path | str):
            paths.append(Path(one))
        elif is_checkable(one):
            objects.append(one)
        else:
            raise TypeError(
                f"{type(one).__name__} cannot be checked; give a path, a Case, an MjModel or an "
                "MjSpec, or several of these"
            )
    return tuple(paths), objects


@dataclass
class NamedWork:
    """The work on one input: the tasks that it asks for, and the part of the result that they give.

    `name` is its name in the result, which no other has.
    """

    name: str
    tasks: list[CheckTask]
    result: Result

    def add_case(self, case: Case) -> None:
        """Plan the runs of a case."""
        self.tasks += [(case, kind, s) for kind, run in case.run.items() for s in run.solvers]
        self.tasks += refinement_runs(case)
        self.result.cases.append(case)


def plan_parts(
    paths: list[Path],
    objects: list[Any],
    result: Result,
    pool: Executor,
    engines: tuple[str, ...] = (),
) -> list[NamedWork]:
    """Read the sidecars and plan the work on each input; cases and errors go to the result."""
    parts: list[NamedWork] = []
    names, taken = unique_names(paths), set[str]()
    read = {path: pool.submit(load_validated, path) for path in paths if is_case_file(path)}
    objects = [
        (one, pool.submit(validate_isolated, one)) if isinstance(one, Case) else (one, None)
        for one in objects
    ]

    def plan(name: str) -> NamedWork:
        taken.add(name)
        parts.append(NamedWork(name, [], Result(paths=result.paths)))
        return parts[-1]

    def asked(case: Case) -> Case:
        return with_engines(case, engines) if engines else case

    def free_name(name: str) -> str:
        others = (f"{name} {k}" for k in count(2))
        return name if name not in taken else next(one for one in others if one not in taken)

    for path in paths:
        with collected_error(result):
            if path in read:
                case = rename_case(read[path].result(), names[path])
                plan(names[path]).add_case(asked(case))
            elif engines:
                raise InputError(path, "", BARE_WITH_ENGINES)
            else:
                source = ModelSource(path, within=folder_of(path, result.paths))
                plan(names[path]).tasks.append(source)
    for one, validated in objects:
        with collected_error(result):
            if validated is not None:
                validated.result()
                name = free_name(one.name)
                plan(name).add_case(asked(rename_case(one, name)))
            else:
                source = source_of_object(one, free_name)
                plan(source.file.name).tasks.append(source)
    result.cases.extend(case for part in parts for case in part.result.cases)
    return parts


@contextmanager
def collected_error(result: Result) -> Iterator[None]:
    """Add an `InputError` of the context to the errors of a result."""
    try:
        yield
    except InputError as error:
        result.errors.append(error)


def is_case_file(path: Path) -> bool:
    """Whether an input is read as a sidecar."""
    return path.suffix not in SOURCE_ENDINGS


def run_parts(
    parts: list[NamedWork],
    executor: Executor,
    threads: Executor,
    jobs: int,
    progress: Callable[[str, int, int], None],
    follow: Callable[[NamedWork], Iterator[list[CheckStep]]],
) -> None:
    """Do the work on all inputs; `follow` gives the steps of an input, stage by stage.

    Steps that are made in this process use the `threads`.  A stage begins when all steps of the
    stage before it have ended.  A free thread continues with a step of its last input: its worker
    has the compiled model in memory, and the reference at changed parameters.
    """
    stages = {part.name: follow(part) for part in parts}
    waiting = {name: steps for name in stages if (steps := next_steps(stages[name]))}
    left = {name: len(steps) for name, steps in waiting.items()}
    total, done = sum(bool(step.label) for steps in waiting.values() for step in steps), 0
    running, last = dict[Future[Any], tuple[str, CheckStep]](), list[str]()
    while waiting or running:
        while waiting and len(running) < jobs:
            busy = {name for name, _ in running.values()}
            name, step = take_step(waiting, last.pop() if last else None, busy)
            running[(threads if step.here else executor).submit(step.call)] = name, step
        for future in wait(running, return_when=FIRST_COMPLETED).done:
            name, step = running.pop(future)
            last.append(name)
            step.keep(future)
            left[name] -= 1
            if not left[name] and (steps := next_steps(stages[name])):
                waiting[name], left[name] = steps, len(steps)
                total += sum(bool(step.label) for step in steps)
            if step.label:
                done += 1
                progress(step.label, done, total)


def next_steps(stages: Iterator[list[CheckStep]]) -> list[CheckStep]:
    """Return the steps of the next stage that has any; none after the last stage."""
    return next(filter(None, stages), [])


def take_step(
    waiting: dict[str, list[CheckStep]], preferred: str | None, busy: set[str]
) -> tuple[str, CheckStep]:
    """Take a step of the input `preferred`, or of one that no thread is busy with, or of any.

    >>> first, second, third = (CheckStep(label, int) for label in "abc")
    >>> waiting = {"1": [first, second], "2": [third]}
    >>> [take_step(waiting, *how)[1].label for how in ((None, set()), (None, {"1"}))]
    ['a', 'c']
    >>> take_step(waiting, "2", {"1"})[1].label, waiting
    ('b', {})
    """
    free = [name for name in waiting if name not in busy]
    name = preferred if preferred in waiting else (free or list(waiting))[0]
    step = waiting[name].pop(0)
    if not waiting[name]:
        del waiting[name]
    return name, step


def stages_of(
    part: NamedWork, causes: bool, detectable: bool, consumer: CaseConsumer | None
) -> Iterator[list[CheckStep]]:
    """Yield the steps of an input: runs, their judgement, causes, and what a consumer does.

    A run with bad input adds an error to the part's result instead of its outcome.
    """
    result, outcomes = part.result, dict[int, RunResult]()

    def keep_outcome(k: int, future: Future[RunResult]) -> None:
        found = outcome_or_error(part.tasks[k], future)
        if not isinstance(found, InputError):
            outcomes[k] = found
        elif str(found) not in map(str, result.errors):
            result.errors.append(found)

    def keep_screen(future: Future["Screen | None"]) -> None:
        if found := future.result():
            result.screens[part.name] = found

    def keep_remarks(future: Future[tuple[str, ...]]) -> None:
        if found := future.result():
            result.remarks[part.name] = found

    bare = [task for task in part.tasks if isinstance(task, ModelSource)]
    yield [
        CheckStep(task_label(task), partial(run_task, task, detectable), partial(keep_outcome, k))
        for k, task in enumerate(part.tasks)
    ]
    yield [CheckStep("", partial(screen_isolated, source), keep_screen) for source in bare]
    lossy = [source for source in bare if source.may_lose]
    yield [CheckStep("", partial(remarks_isolated, source), keep_remarks) for source in lossy]
    yield [CheckStep("", partial(collect_outcomes, part.tasks, outcomes, result), here=True)]
    outcomes.clear()
    part.tasks.clear()  # the study of a refinement holds the curves of all its runs
    if not result.cases:
        result.comparisons[:] = [replace(c, case=part.name) for c in result.comparisons]
    if causes:
        models = [ModelSource(case.model_path) for case in result.cases if blew_up(result, case)]
        yield [CheckStep("", partial(screen_isolated, model), keep_screen) for model in models]
        yield list(diagnosis_steps(result))
    if consumer is not None:
        if result.cases:
            yield [CheckStep("", partial(consumer.take, result), here=True)]
        part.result = replace(result, curves={}, failed={})


def blew_up(result: Result, case: Case) -> bool:
    """Whether the engine whose language the model is in diverged; rods are no part of the model."""
    return not case.rod and any(
        c.outcome == Outcome.DIVERGED and c.solver.partition(":")[0] == NATIVE_ENGINE
        for c in result.comparisons
    )


def add_part(result: Result, part: Result) -> None:
    """Add the result of one file to that of all; an error that is there already is not repeated."""
    result.comparisons.extend(part.comparisons)
    result.curves.update(part.curves)
    result.notes.update(part.notes)
    result.refined.extend(part.refined)
    result.screens.update(part.screens)
    result.remarks.update(part.remarks)
    result.versions.update(part.versions)
    result.failed.update(part.failed)
    result.diagnoses.update(part.diagnoses)
    known = set(map(str, result.errors))
    result.errors.extend(error for error in part.errors if str(error) not in known)


def outcome_or_error(task: CheckTask, future: Future[RunResult]) -> RunResult | InputError:
    """Return the outcome of a run; an error becomes that of its input, so that others go on."""
    try:
        return future.result()
    except InputError as error:
        return error
    except ClusterError:
        raise
    except Exception as error:
        words = f"{task_label(task)} failed: {type(error).__name__}: {error}"
        return InputError(task_file(task), "", words)


def collect_outcomes(
    tasks: list[CheckTask], outcomes: dict[int, RunResult], result: Result
) -> None:
    """Add the outcomes of the tasks to the result, in the order of the tasks."""
    for k in sorted(outcomes):
        task, (comparisons, curves) = tasks[k], outcomes[k]
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
        elif curves is not None and not isinstance(task, ModelSource):
            kept = result.failed if comparisons[0].outcome in FAILED_OUTCOMES else result.curves
            kept[task[0].name, task[1], task[2]] = curves
            if curves.versions:
                result.versions[task[2]] = curves.versions
            if kept is result.curves:
                result.notes[task[0].name, task[1], task[2]] = curves.notes
        result.comparisons.extend(comparisons)
        if not isinstance(task, ModelSource) and (early := early_end_error(*task[:3], curves)):
            result.errors.append(early)


def diagnosis_steps(result: Result) -> Iterator[CheckStep]:
    """Yield steps that find the causes of the runs of one case that differ or failed.

    The search is most thorough for the first run; the others likely have the same cause.
    """
    differing = dict.fromkeys(
        (c.case, c.run, c.solver) for c in result.comparisons if c.outcome == Outcome.DIFFERS
    )
    runs = {key: result.curves[key] for key in differing if key in result.curves} | result.failed
    for k, (key, curves) in enumerate(runs.items()):
        _, run, solver = key
        yield CheckStep(
            f"{' '.join(key)}: causes",
            partial(
                diagnose_run,
                result.cases[0],
                cast(Kind, run),
                solver,
                curves,
                key in result.failed,
                not k,
            ),
            partial(keep_diagnosis, result, key),
        )


def keep_diagnosis(result: Result, key: tuple[str, str, str], future: "Future[Diagnosis]") -> None:
    """Add a diagnosis to the result."""
    result.diagnoses[key] = future.result()


def share_causes(result: Result, executor: Executor) -> None:
    """Try the causes that were found in a model in the other runs of the same model that differ.

    So a wrong number is one cause in all cases that read its file, also where the reference reads
    the number as well.
    """
    cases = {case.name: case for case in result.cases}
    found = [d.best for d in result.diagnoses.values() if d.best and d.best.complete]
    causes = {cause.key: cause for cause in found if cause.edits and cause.fault}
    futures = [
        (key, executor.submit(confirm_run, cases[key[0]], cast(Kind, key[1]), key[2], cause))
        for key, diagnosis in result.diagnoses.items()
        for cause in causes.values()
        if not (diagnosis.failed or diagnosis.fault)
        and is_about(cause, cases[diagnosis.case])
        and cause.key not in [each.key for each in diagnosis.causes[:1]]
    ]
    for key, future in futures:
        if cause := future.result():
            old = result.diagnoses[key]
            result.diagnoses[key] = replace(old, causes=(cause, *old.causes))


def is_about(cause: "Explanation", case: Case) -> bool:
    """Whether a cause is in the model of a case."""
    model = os.path.realpath(case.model_path)
    return any(os.path.realpath(fault.file) == model for fault in cause.faults)


def confirm_run(case: Case, run: Kind, solver: str, cause: "Explanation") -> "Explanation | None":
    """Do what `confirm_cause` does, in a worker; None if that fails."""
    from proofmass.evidence.diagnosis import confirm_cause

    limits = {"timeout": CAUSES_SECONDS, "memory": case.run[run].memory}
    try:
        found = call_isolated(confirm_cause, case, run, solver, cause, **limits)
        return cast("Explanation | None", found)
    except Exception:  # the run keeps the causes that it has
        return None


def diagnose_run(
    case: Case,
    run: Kind,
    solver: str,
    curves: Curves,
    failed: bool = False,
    thorough: bool = True,
) -> "Diagnosis":
    """Search for the causes of one run in a worker; a search that fails gives its own error."""
    from proofmass.evidence.diagnosis import Diagnosis, describe_failure, find_causes

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
    if isinstance(task, ModelSource):
        return check_bare_model(task), None
    if isinstance(task, FinerRun):
        return run_solver(*task[:3], compare_curves=refined_errors)
    return run_solver(*task, compare_curves=partial(compare_and_share, detectable=detectable))


def task_file(task: CheckTask) -> Path:
    """The file that asked for a task."""
    return task.file if isinstance(task, ModelSource) else task[0].file


def task_label(task: CheckTask) -> str:
    """The name of a task in a progress line."""
    if isinstance(task, ModelSource):
        return task.file.name
    finer = f", {task.segments} segments" if isinstance(task, FinerRun) else ""
    return f"{task[0].name} {task[1]} {task[2]}{finer}"
