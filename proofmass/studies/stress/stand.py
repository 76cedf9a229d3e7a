"""A case in one engine, and when a run of it is lost.

That is when the engine says so, when it is not finite, when a loop comes open by a tenth of the
mechanism, and when a position, or a holding moment of a sweep, is off by a tenth of its range: that
the engine does not see.  What keeps us from knowing is a limit of our own; see
`proofmass.studies.stress.boundary.BoundaryKind`.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from math import isclose, isnan
from pathlib import Path
from typing import Any, cast

from proofmass.case import Case
from proofmass.engines import engine_of
from proofmass.errors import InputError
from proofmass.mobility import mobility
from proofmass.outcome import FAILURES, Outcome
from proofmass.reference import compiled, grid
from proofmass.sim.mjcf import compiles
from proofmass.sim.protocol import BadModel, Curves, Engine, NotSolved, Scheme
from proofmass.solve import simulate
from proofmass.strict import Kind
from proofmass.studies.measure import Measurement, StudyRun, observe
from proofmass.studies.record import ParameterValue, Setting, format_kind
from proofmass.studies.store import Store, key_of
from proofmass.studies.stress.boundary import BoundaryKind, Failure, Sought, Trial, Tried, told
from proofmass.studies.stress.ways import in_steps
from proofmass.studies.variants import READS
from proofmass.worker import KILLED, TimedOut, isolated

LOST = 0.1
"""Error, as a share of the reference's range, that nothing is right beyond."""
JUDGED = "position", "force"
TIMEOUT = 60.0
LONG = 1_000_000  # steps of the longest runs
SAME = 1e-9  # share of a step by which rounding may change it
LIMITS: dict[str, BoundaryKind] = {
    Outcome.DIVERGED: BoundaryKind.UNSTABLE,
    Outcome.NOT_FINITE: BoundaryKind.UNSTABLE,
    Outcome.STOPPED: BoundaryKind.UNSTABLE,
    "refused": BoundaryKind.REFUSED,
}
"""Outcomes that are the engine's; all others are limits of our own."""


@dataclass(frozen=True)
class Stand:
    """A case in one engine, in the run that its extremes are tried in, and how long [s] at most."""

    case: Case
    kind: Kind
    setting: Setting
    store: Store
    patience: float = TIMEOUT

    @property
    def engine(self) -> Engine:
        """What the engine says of itself."""
        return engine_of(self.setting.engine)

    @property
    def models(self) -> Path:
        """Where changed models are kept."""
        return self.store.folder / "models"

    @property
    def words(self) -> str:
        """Engine settings in short."""
        return str(self.setting.parameters.get("integrator", "as in the model"))

    @property
    def step(self) -> float:
        """Time step [s] that the case asks for."""
        return float(str(self.setting.parameters.get("timestep", compiled(self.case).opt.timestep)))

    @property
    def seconds(self) -> float:
        """How long the motion takes."""
        x = grid(self.case, self.kind)
        return float(x[-1] - x[0])

    def run(self, case: Case, **parameters: ParameterValue) -> Measurement:
        """Run a changed case."""
        task = StudyRun(case, self.kind, self.setting.but(**parameters), "stress")
        try:
            return tried(task, self.store, self.patience)
        except InputError as error:
            refused = self.engine.native and not is_compiled(case)
            return Measurement(outcome="refused" if refused else "no start", message=error.wrong)

    def lost(self, case: Case, **parameters: ParameterValue) -> Failure | None:
        """Run a changed case; why it is lost, or None."""
        return judged(self.run(case, **parameters))

    def tried(self, case: Case, **parameters: ParameterValue) -> Tried:
        """Run a changed case; why it is lost, and the step that was taken."""
        found = self.run(case, **parameters)
        return Tried(judged(found), found.step)

    def stepped(self, case: Case, seconds: float, **parameters: ParameterValue) -> Tried:
        """Run a changed case for so long [s], in steps of just what is asked.

        Raises
        ------
        RuntimeError
            The engine took another step.
        """
        step = float(str(parameters.get("timestep", self.step)))
        found = self.tried(in_steps(case, seconds, step), **parameters)
        if not (isnan(found.step) or isclose(found.step, step, rel_tol=SAME)):
            raise RuntimeError(
                f"{self.case.name}, {self.setting.engine}: took steps of "
                f"{found.step!r} s where {step!r} s were asked for"
            )
        return found

    def integrated(
        self,
        parameter: str,
        unit: str,
        start: float,
        reach: float,
        trial: Callable[[dict[str, ParameterValue], float], Tried],
        schemes: Iterable[Scheme],
    ) -> Iterator[Sought]:
        """A boundary of this case for each scheme of the engine, where it has several."""
        if len(self.engine.schemes) < 2:
            yield self.sought(parameter, unit, start, reach, partial(trial, {}))
            return
        for one in schemes:
            yield self.sought(parameter, unit, start, reach, partial(trial, one.settings), one.name)

    def sought(
        self,
        parameter: str,
        unit: str,
        start: float,
        reach: float,
        trial: Trial,
        words: str = "",
        **more: Any,
    ) -> Sought:
        """A boundary of this case."""
        return Sought(
            self.case.name,
            self.setting.engine,
            words or self.words,
            parameter,
            unit,
            start,
            reach,
            trial,
            **more,
        )


def tried(task: StudyRun, store: Store, patience: float = TIMEOUT) -> Measurement:
    """A run, from the store if it is there; nobody asks for its time, so that it needs no core."""
    return store.once(key_of(task), task, patience, partial(observed, task, patience))


def observed(task: StudyRun, patience: float) -> Measurement:
    """A run, and whatever keeps it from one."""
    try:
        return cast(Measurement, isolated(observe, task, False, None, timeout=patience))
    except TimedOut as late:
        return unanswered(task, str(late))
    except NotSolved as error:
        return Measurement(outcome=Outcome.NOT_SOLVED, message=str(error))
    except tuple(FAILURES) as error:
        return Measurement(outcome=FAILURES[type(error)], message=str(error))
    except BadModel as error:
        return Measurement(outcome=Outcome.NO_START, message=str(error))


def unanswered(task: StudyRun, late: str) -> Measurement:
    """Whose answer was not there in time: the engine's, if late again, or the reference's."""
    try:
        isolated(simulated, task, timeout=TIMEOUT)
    except tuple(FAILURES):
        return Measurement(outcome=FAILURES[TimedOut], message=late)
    return Measurement(outcome=Outcome.NO_REFERENCE, message=f"{late}; the engine has its run")


def simulated(task: StudyRun) -> Curves:
    """A run in this process, held against nothing."""
    case, run = task.setting.applied(task.case, task.run)
    return simulate(task.setting.engine, case.model_path, run)


def is_compiled(case: Case) -> bool:
    """Whether the case's file can be compiled; in a worker."""
    return cast(bool, isolated(compiles, case.model_path, timeout=TIMEOUT))


def judged(found: Measurement) -> Failure | None:
    """Why a run is lost, or None."""
    if found.outcome != Outcome.RAN:
        unseen = found.outcome in (Outcome.DIVERGED, Outcome.NOT_FINITE) and not told(found.message)
        return Failure(f"{found.outcome}: {found.message}", limit_of(found), unseen)
    for kind in JUDGED:
        if not found.errors.get(kind, 0.0) <= LOST:
            return Failure(
                f"{format_kind(kind)} off by {found.errors[kind]:.2g} of its range",
                BoundaryKind.INACCURATE,
                silent=True,
            )
    return None


def limit_of(found: Measurement) -> BoundaryKind:
    """What kind of limit a run without errors is."""
    if found.outcome == Outcome.CRASHED and found.message.startswith(KILLED):
        return BoundaryKind.UNSTABLE
    return LIMITS.get(found.outcome, BoundaryKind.OURS)


class NotHere(Exception):
    """An extreme that a case does not have; says why."""


def needs(there: object, why: str) -> None:
    """Raise `NotHere` where something is missing."""
    if not there:
        raise NotHere(why)


def known(case: Case) -> bool:
    """Whether the reference follows changes of the masses: by itself, or since it needs none."""
    return case.reference == READS or (bool(case.drive) and mobility(case) == len(case.drive))
