"""Measure one run of a study: run the engine on a reserved processor, compare with the reference.

No two timed runs of any study on this machine use the same processor at the same time.
"""

import os
import platform
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from functools import cache
from math import isnan
from pathlib import Path
from typing import Any, TypeVar, cast

import numpy as np

from proofmass.base.arrays import Array
from proofmass.base.clock import processor_time
from proofmass.base.errors import InputError
from proofmass.base.strict import Kind
from proofmass.base.worker import DEFAULT_MEMORY, call_isolated
from proofmass.case.case import Case
from proofmass.run.solve import call_engine
from proofmass.sim.protocol.curves import Curves
from proofmass.sim.protocol.failures import BadModel, NotSolved
from proofmass.sim.protocol.run import Run
from proofmass.studies.invariants import invariants
from proofmass.studies.locks import HAS_LOCKS, announce_waiting, holder, try_lock, wait_for_lock
from proofmass.studies.record import KIND_UNITS, NAN, Setting
from proofmass.studies.references import moved_as_prescribed, reference_at, write_reference
from proofmass.verdict.outcome import OUTCOME_OF_EXCEPTION, Outcome

LOCK_POLL_SECONDS = 0.005  # s between two looks for a free processor


def available_processors() -> list[int]:
    """Numbers of the processors that runs may be pinned to; empty where the system cannot pin."""
    return sorted(os.sched_getaffinity(0)) if HAS_LOCKS and hasattr(os, "sched_getaffinity") else []


@contextmanager
def reserve_processor() -> Iterator[int | None]:
    """Reserve a processor, after waiting for a free one; None where the system cannot pin.

    A reservation is a lock, see `proofmass.studies.locks`: other processes of the user respect it,
    and it ends with the process that has it.  Waiting processes form a queue, so that a study that
    asks without a pause does not get all processors.
    """
    if not available_processors():
        yield None
        return
    with ExitStack() as reserved:
        with announce_waiting(describe_reservations), wait_for_lock("queue"):
            core = lock_free_processor(reserved)
        yield core


def lock_free_processor(reserved: ExitStack) -> int:
    """Wait for a free processor and lock it until `reserved` is closed; return its number."""
    while True:
        for core in available_processors():
            if file := try_lock(f"core-{core}"):
                reserved.enter_context(file)
                return core
        time.sleep(LOCK_POLL_SECONDS)


def describe_reservations() -> str:
    """Tell which other processes have reserved processors; empty if none is known to have."""
    others = sorted({*filter(None, (holder(f"core-{core}") for core in available_processors()))})
    if not others:
        return ""
    return (
        f"waiting for a processor: runs that are timed in process{'es' * (len(others) > 1)} "
        f"{', '.join(map(str, others))} have reserved all that are left"
    )


@contextmanager
def pin_process(core: int | None) -> Iterator[None]:
    """Pin this process to one processor within the context; do nothing for None."""
    if core is None:
        yield
        return
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {core})
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)


@cache
def describe_machine() -> str:
    """Name of this machine's processor, and how many it has, such as ``NAME x 2``."""
    name = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    for line in info.read_text("utf-8", "replace").splitlines() if info.exists() else ():
        if line.startswith("model name"):
            name = line.partition(":")[2].strip()
    return f"{name} x {os.cpu_count()}"


def load_average() -> float:
    """Load average of the last minute [processes]; NaN where the system has none."""
    try:
        return os.getloadavg()[0]
    except (AttributeError, OSError):  # Windows has none
        return NAN


T = TypeVar("T")
REFERENCE_TIMEOUT = (
    600.0  # s, processor time after which the reference of a free motion is given up
)
SHORT_RUN_SECONDS = 0.02
"""Counted time [s] below which a run is made twice and timed the second time: a process needs some
milliseconds more for the first run."""
ROUNDING_RANGE = 1e-9
"""Largest share of the largest range of a unit's curves at which a curve is only rounding."""


@dataclass(frozen=True)
class StudyRun:
    """A run of a case that a study asks for, with its entries in the study's table.

    Attributes
    ----------
    case : Case
        From `load_case`, or a changed copy of it (`model_copy`), such as with another start or
        other samples.
    run : {"sweep", "dynamics", "equilibrium"}
        Which of the case's runs.
    setting : Setting
        The engine and its parameters.
    study, series, varied : str
        The study that asks for the run, the convergence series that the run belongs to, and the
        parameter that differs in this series.
    value : float
        Value of the varied parameter [its unit], such as a time step in s.
    reference : path, optional
        File of the reference at the prescribed motion, see `proofmass.studies.references`.
    key : str
        Key of the run in the store, if it is known; see `proofmass.studies.store.task_key`.
    timed : bool
        Whether the time matters: a short run is then made twice, and the second one timed.
    """

    case: Case
    run: Kind
    setting: Setting
    study: str = ""
    series: str = ""
    varied: str = ""
    value: float = NAN
    reference: Path | None = None
    key: str = ""
    timed: bool = True

    @property
    def label(self) -> str:
        """The run in a line of progress: case, kind of run, engine and parameters."""
        parameters = ", ".join(f"{name} {value}" for name, value in self.setting.parameters.items())
        return f"{self.case.name} {self.run} {self.setting.engine} {parameters}"


@dataclass(frozen=True)
class Measurement:
    """The result of one run: fields as in `StudyRow`, and the recorded `curves` by name."""

    errors: dict[str, float] = field(default_factory=dict)
    invariants: dict[str, float] = field(default_factory=dict)
    seconds: float = NAN
    steps: int = 0
    pinned: bool = False
    shared: float = NAN
    machine: str = ""
    outcome: str = Outcome.RAN
    message: str = ""
    asked: dict[str, float] = field(default_factory=dict)
    curves: dict[str, Array] = field(default_factory=dict, repr=False, compare=False)
    step: float = NAN
    load: float = NAN
    work: float = NAN
    compile_seconds: float = 0.0

    @property
    def complete(self) -> bool:
        """Whether the run came to an end, so that its time counts."""
        return self.outcome in (Outcome.RAN, Outcome.STOPPED)

    @property
    def cost(self) -> float:
        """The counted processor time, or the measured one if none is counted [s]."""
        return self.seconds if isnan(self.work) else self.work


STUDY_OUTCOME_OF_EXCEPTION: dict[type[Exception], Outcome] = {
    **OUTCOME_OF_EXCEPTION,
    NotSolved: Outcome.NOT_SOLVED,
    BadModel: Outcome.NO_START,
}
"""Outcomes by the exceptions that a worker raises; `NotSolved` has an outcome of its own here."""


def measure(
    function: Callable[..., T], *args: Any, timeout: float, memory: float = DEFAULT_MEMORY
) -> T | Measurement:
    """Call a function in a process of its own; turn an exception into a measurement.

    Parameters
    ----------
    function : callable
        Function that runs a model; see `proofmass.base.worker.call_isolated`.
    *args
        Arguments of the function.
    timeout, memory : float
        Processor time and memory at which the process is ended [s, GiB].

    Returns
    -------
    object
        The function's result; if it fails, a `Measurement` with the outcome and the message.
    """
    try:
        return cast(T, call_isolated(function, *args, timeout=timeout, memory=memory))
    except tuple(STUDY_OUTCOME_OF_EXCEPTION) as error:
        kind = next(one for one in type(error).__mro__ if one in STUDY_OUTCOME_OF_EXCEPTION)
        return Measurement(outcome=STUDY_OUTCOME_OF_EXCEPTION[kind], message=str(error))


def measure_task(task: StudyRun, timeout: float) -> Measurement:
    """Run a task in a process of its own, on a reserved processor, within `timeout` [s].

    Raises
    ------
    InputError
        The model cannot be used, or a parameter is unknown to the engine.
    """
    return measure_reserved(task, False, timeout)


def repeat_task(task: StudyRun, timeout: float) -> Measurement:
    """Do as `measure_task` does for the time alone, without a comparison with the reference."""
    return measure_reserved(task, True, timeout)


def measure_reserved(task: StudyRun, is_repeat: bool, timeout: float) -> Measurement:
    """Do what `measure_task` or `repeat_task` does."""
    with reserve_processor() as core:
        found = measure(
            observe, task, is_repeat, core, timeout=timeout, memory=task.case.run[task.run].memory
        )
    if found.outcome == Outcome.NOT_SOLVED:
        return replace(found, outcome=OUTCOME_OF_EXCEPTION[NotSolved])
    if found.outcome != Outcome.NO_START:
        return found
    if "segments" in task.setting.parameters:  # such as a sensor on the tenth link
        return replace(found, outcome=Outcome.UNSUPPORTED)
    raise InputError(task.case.model_path, "", found.message)


def write_reference_of(task: StudyRun) -> Measurement | None:
    """Write the reference of a free motion before its runs, so that it is no part of their time.

    It is evaluated in a process of its own, on a reserved processor.  The result of a failure is
    that of all runs, as no setting of the case has a reference then.
    """
    limits = task.case.run[task.run]
    with reserve_processor():
        try:
            found = measure(
                write_reference,
                task.case,
                task.run,
                task.reference,
                timeout=max(REFERENCE_TIMEOUT, limits.timeout),
                memory=limits.memory,
            )
        except InputError as error:
            return Measurement(outcome=Outcome.NO_REFERENCE, message=error.wrong)
    return found and replace(found, message=f"its reference: {found.message}")


def observe(task: StudyRun, is_repeat: bool, core: int | None) -> Measurement:
    """Run a task in this process, pinned to a processor; `is_repeat` leaves out the comparison."""
    with pin_process(core):
        case, run = task.setting.apply_to(task.case, task.run)
        before = load_average()
        curves, shared = time_run(task.setting.engine, case.model_path, run)
        if task.timed and curves.cost < SHORT_RUN_SECONDS:
            curves, shared = time_run(task.setting.engine, case.model_path, run)
        cost = Measurement(
            {},
            {},
            curves.seconds,
            curves.steps,
            core is not None,
            shared,
            describe_machine(),
            step=step_taken(task.run, curves),
            load=max(before, load_average()),
            work=curves.work,
            compile_seconds=curves.compile_seconds,
        )
        return cost if is_repeat else compare_run(case, run, curves, cost, task.reference)


def simulate_task(task: StudyRun) -> Curves:
    """Run a task in this process, without a reference."""
    case, run = task.setting.apply_to(task.case, task.run)
    return call_engine(task.setting.engine, case.model_path, run)


def step_taken(kind: Kind, curves: Curves) -> float:
    """Time step that the engine reports [s]; NaN for runs that are no dynamics."""
    return float(str(curves.settings.get("timestep", NAN))) if kind == "dynamics" else NAN


def compare_run(
    case: Case, run: Run, curves: Curves, cost: Measurement, file: Path | None
) -> Measurement:
    """Compare a run with its reference: `cost` with errors, invariants, outcome and curves."""
    kind = cast(Kind, run.kind)
    channels = {f"channel.{name}": values for name, values in curves.channels.items()}
    cost = replace(cost, curves={"x": curves.x, **channels})
    if bad_sample := first_not_finite(curves.channels):
        return replace(cost, outcome=Outcome.NOT_FINITE, message=bad_sample)
    asked = dict[str, float]()
    try:
        kept = file if moved_as_prescribed(run, curves) else None
        errors = relative_errors(case, kind, curves, kept)
        if drives_moved(run, curves):
            prescribed = replace(curves, drive=run.motion(curves.x))
            asked = relative_errors(case, kind, prescribed, file)
    except InputError as error:  # such as a pose that the mechanism cannot have
        return replace(cost, outcome=Outcome.NO_REFERENCE, message=error.wrong)
    return replace(
        cost,
        errors=errors,
        asked=asked,
        invariants=invariants(case, curves),
        outcome=Outcome.STOPPED if curves.stopped else "ran",
        message=curves.stopped,
    )


def drives_moved(run: Run, curves: Curves) -> bool:
    """Whether drives moved in time, so that their motion may differ from the prescribed one."""
    return run.kind == "dynamics" and bool(run.drives) and curves.drive is not None


def time_run(engine: str, model: Path, run: Run) -> tuple[Curves, float]:
    """Curves of a run, and the share of its wall time that the processor gave to others [1].

    The share is NaN if another interpreter computed: its processor time is known of the steps only.
    """
    wall, own = time.perf_counter(), processor_time()
    curves = call_engine(engine, model, run)
    own, wall = processor_time() - own, time.perf_counter() - wall
    return curves, NAN if curves.versions else max(0.0, 1.0 - own / wall)


def first_not_finite(channels: dict[str, Array]) -> str:
    """The first channel with a value that is not finite, and its sample; empty if there is none."""
    for name, values in channels.items():
        finite = np.isfinite(values)
        if not finite.all():
            return f"{name} at sample {int(np.argmin(finite))}"
    return ""


def relative_errors(
    case: Case, kind: Kind, curves: Curves, file: Path | None = None
) -> dict[str, float]:
    """Largest error of each kind of channel, as a share of the reference's range [1].

    The reference is that of `proofmass.studies.references.reference_at`, to which `file` belongs.
    """
    found = dict[str, float]()
    for kind_of_error, errors in distances_to_reference(case, kind, curves, file):
        found[kind_of_error] = max(float(errors.max()), found.get(kind_of_error, 0.0))
    return found


def distances_to_reference(
    case: Case, kind: Kind, curves: Curves, file: Path | None = None
) -> Iterator[tuple[str, Array]]:
    """For each channel its kind, and its errors (n,) as shares of the reference's range [1].

    Channels whose reference is constant have no range and are left out.

    Raises
    ------
    InputError
        The mechanism cannot have a pose of the drives, or the reference is not finite.
    """
    reference = reference_at(case, kind, curves, file)
    if bad_sample := first_not_finite(reference):
        raise case.error("reference", f"not finite: {bad_sample}")
    return channel_distances(case, kind, reference, curves.channels)


def channel_distances(
    case: Case, kind: Kind, one: Mapping[str, Array], two: Mapping[str, Array]
) -> Iterator[tuple[str, Array]]:
    """For each channel its kind, and the distances of its curves as shares of the range of `one`.

    Channels that are constant in `one`, but for rounding, have no range and are left out.
    """
    units = {n: c.si_unit for n, c in case.channels_of(kind).items() if n in one and n in two}
    ranges = {name: curve_range(one[name]) for name in units}
    for name, unit in units.items():
        what = next((kind for kind, known in KIND_UNITS.items() if unit in known), None)
        widest = max(ranges[other] for other in units if units[other] == unit)
        if what and ranges[name] > ROUNDING_RANGE * widest:
            yield what, np.abs(two[name] - one[name]) / ranges[name]


def curve_range(values: Array) -> float:
    """Range of a curve: its largest value minus its smallest."""
    return float(np.ptp(values))
