"""Search for limits: one parameter is increased or decreased until a run of a case fails.

A run fails when the engine says so, when it is not finite, when a loop comes open by a tenth of the
mechanism, and when a position, or a holding moment of a sweep, is off by a tenth of its range: that
the engine does not see.  Where proofmass itself gives up, the limit is not the engine's; see
`proofmass.studies.stress.boundary.BoundaryKind`.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, fields
from functools import cache, partial
from math import floor, isclose, isnan, log10
from pathlib import Path
from typing import Any, cast

import numpy as np

from proofmass.case import Case
from proofmass.engines import engine_of
from proofmass.errors import InputError
from proofmass.mobility import mobility
from proofmass.outcome import Outcome
from proofmass.reference import compiled, grid
from proofmass.sim.mjcf import compiles
from proofmass.sim.protocol import Engine, Scheme
from proofmass.strict import Kind
from proofmass.studies.measure import Measurement, StudyRun, measure, observe, simulate_task
from proofmass.studies.record import ParameterValue, Setting, format_kind
from proofmass.studies.store import Store, key_of
from proofmass.studies.stress.boundary import (
    DIGITS,
    NAN,
    Boundary,
    BoundaryKind,
    Failure,
    TrialResult,
    VariedRange,
    is_engine_warning,
)
from proofmass.studies.variants import READS, with_whole_steps
from proofmass.wording import number
from proofmass.worker import KILLED, isolated

WITHIN = 0.01
"""A boundary is known when what failed is so little beyond what held."""
COARSE = 0.1
"""The same where nothing is known beyond, nor by theory: that value is no property of an engine."""
STRIDE = 4.0
"""Factor from one value to the next on the way to the extreme."""
BESIDE = 1.01, 1.02, 1.03, 1.04, 1.06, 1.1, 1.2, 1.4
"""Factors to both sides of a boundary at which it is checked: all before it must hold, all beyond
it must fail.  Bisection alone finds one of several boundaries, and a stride is a factor of 4.
Errors that go up and down with the parameter do so in 2 to 4 % of it."""
JUST = 1.02
"""From the first of several boundaries to the value before it that is said to hold."""


LARGE = 0.1
"""Error, as a share of the reference's range, that nothing is right beyond."""
JUDGED: dict[Kind, tuple[str, ...]] = {
    "sweep": ("position", "force"),
    "equilibrium": ("position", "force"),
    "dynamics": ("position",),
}
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


TryValue = Callable[[float], TrialResult]
"""Tries a value."""
Runner = Callable[[StudyRun], Measurement]
"""Makes a run."""


@dataclass(frozen=True)
class LimitSearch(VariedRange):
    """The search for a limit: how to try a value, and what theory says; see `Boundary`."""

    trial: TryValue
    theory: float = NAN
    law: str = ""

    def find(self, within: float = WITHIN) -> Boundary:
        """Bisect the boundary to a share of its value, and look whether there are several.

        Where theory has one, the search is as close where proofmass itself gives up: a boundary may
        be just before it, as of an engine that leaves its reference behind.
        """
        steps = dict[float, float]()

        @cache
        def test(value: float) -> Failure | None:
            failure, steps[value] = self.trial(value)
            return failure

        expected = np.isfinite(self.theory) and self.theory > 0
        coarse = within if expected else COARSE
        holds, breaks, failure = bisect(test, self.start, self.reach, within, coarse)
        again = NAN
        near = max(holds / breaks, breaks / holds) < JUST
        if near and is_failure(failure):
            holds, breaks, failure, again = find_several(
                test, self.start, self.reach, holds, breaks, failure
            )
        known = {f.name: getattr(self, f.name) for f in fields(self) if f.name != "trial"}
        message, limit, silent = failure or ("", BoundaryKind.HOLDS, False)
        return Boundary(
            **known,
            holds=holds,
            breaks=breaks,
            again=again,
            step=steps.get(holds, NAN),
            limit=limit,
            failure=message,
            silent=silent,
        )


def bisect(
    test: Callable[[float], Failure | None],
    start: float,
    reach: float,
    within: float = WITHIN,
    coarse: float = COARSE,
) -> tuple[float, float, Failure | None]:
    """Vary a parameter from `start` towards `reach`, and close in on the first value that fails.

    Strides are geometric, so all values are positive.  A boundary is the first one that a stride
    meets; an island of failure between two strides is not seen, and of several boundaries one is
    found: see `find_several`.  Where nothing is known beyond, the two are closed in to `coarse`
    alone.

    Returns
    -------
    holds, breaks : float
        The furthest value that held, and the nearest that failed [its unit], that of `start`; each
        is NaN if there is none.
    failure : Failure or None
        Why `breaks` failed, or `start` already; None if all values held.

    Examples
    --------
    >>> failed = Failure("beyond", BoundaryKind.UNSTABLE)
    >>> holds, breaks, _ = bisect(lambda x: None if x < 2 else failed, 0.1, 100.0)
    >>> holds < 2 <= breaks, breaks / holds < 1.01
    (True, True)
    >>> bisect(lambda x: None if x > 1e-3 else failed, 1.0, 1e-2)
    (0.01, nan, None)
    """
    failure = test(start)
    if failure:
        return NAN, NAN, failure._replace(message=f"at {start:g} already: {failure.message}")
    holds, breaks = start, NAN
    strides = max(1, int(np.ceil(abs(np.log(reach / start)) / np.log(STRIDE) - 1e-9)))
    for value in np.geomspace(start, reach, strides + 1)[1:].tolist():
        failure = test(value)
        if failure:
            breaks = value
            break
        holds = value
    while max(holds / breaks, breaks / holds) > 1.0 + (  # not with NaN
        max(coarse, within) if failure and failure.limit == BoundaryKind.OURS else within
    ):
        middle = float(np.sqrt(holds * breaks))
        if found := test(middle):
            breaks, failure = middle, found
        else:
            holds = middle
    return holds, breaks, failure


def find_several(
    test: Callable[[float], Failure | None],
    start: float,
    reach: float,
    holds: float,
    breaks: float,
    failure: Failure | None,
) -> tuple[float, float, Failure | None, float]:
    """Look beside a boundary for values before it that fail, and for values beyond that hold.

    A run through a singular pose fails where one of its steps comes near to it, and an error that
    goes up and down with the parameter passes its limit several times.  Then the first boundary and
    the last are looked for, each until the values at all factors of `BESIDE` before the one hold,
    and those beyond the other fail.  Values have as many digits as are printed.

    Parameters
    ----------
    test : callable
        Why a value fails, or None.
    start, reach : float
        First and last value that may be tried [its unit].
    holds, breaks : float
        What `bisect` found [its unit].
    failure : Failure or None
        Why `breaks` failed.

    Returns
    -------
    holds, breaks : float
        The same if there is one boundary; otherwise the first value that failed, and the value just
        before it, which held [its unit].
    failure : Failure or None
        Why `breaks` failed.
    again : float
        The last value that held again [its unit]; NaN if there is one boundary.

    Examples
    --------
    >>> failed = Failure("beyond", BoundaryKind.UNSTABLE)
    >>> def test(x):  # fails from 2.2 to 2.3, and from 2.5 on
    ...     return failed if 2.2 <= x < 2.3 or x >= 2.5 else None
    >>> holds, breaks, _, again = find_several(test, 1.0, 9.0, 2.48, 2.5, failed)
    >>> holds < 2.2 <= breaks < 2.25, 2.45 < again < 2.5
    (True, True)
    >>> find_several(lambda x: failed if x >= 2 else None, 1.0, 9.0, 1.99, 2.0, failed)[-1]
    nan
    """
    up = reach > start

    def fails_at(value: float) -> bool:
        return is_failure(test(value))

    def holds_at(value: float) -> bool:
        return test(value) is None

    one_before = next(filter(holds_at, printed(holds, not up)), holds)
    one_beyond = next(filter(fails_at, printed(breaks, up)), breaks)
    between = float(number(np.sqrt(holds * breaks)))
    first = find_last(fails_at, one_beyond, start, not up, beside(between, JUST, start, not up))
    last = find_last(holds_at, one_before, reach, up, beside(between, JUST, reach, up))
    if first == one_beyond and last == one_before:
        return holds, breaks, failure, NAN
    return beside(first, JUST, start, not up), first, test(first), last


def find_last(
    meets: Callable[[float], bool], edge: float, end: float, up: bool, near: float
) -> float:
    """The furthest value that meets a condition, from an edge on to an end; the edge if none does.

    From the furthest value that is known, those at all factors of `BESIDE` are tried; before them a
    value near the edge.
    """
    found = near if near != edge and meets(near) else edge
    while True:
        tried = [beside(found, factor, end, up) for factor in BESIDE]
        met = [value for value in tried if value != found and meets(value)]
        if not met:
            return found
        found = met[-1]


def rounded(value: float) -> float:
    """A value with the digits that are printed."""
    return float(number(value, DIGITS))


def printed(value: float, up: bool) -> list[float]:
    """A value with the digits that are printed, and the next one that has so many.

    Of two values that are alike in these digits one may hold and the other fail.

    >>> printed(0.177634, up=True), printed(0.177634, up=False)
    ([0.1776, 0.1777], [0.1776, 0.1775])
    """
    digit = 10.0 ** (floor(log10(value)) - DIGITS + 1)
    nearest = rounded(value)
    return [nearest, rounded(nearest + digit if up else nearest - digit)]


def beside(value: float, factor: float, end: float, up: bool) -> float:
    """A value at a factor from another, up or down to an end, with the digits that are printed.

    >>> beside(0.05, 1.02, 1.0, up=True), beside(0.05, 1.02, 0.04901, up=False)
    (0.051, 0.04902)
    """
    there = rounded(value * factor if up else value / factor)
    return min(there, end) if up else max(there, end)


@dataclass(frozen=True)
class StressedCase:
    """A case in one engine, and the run in which its limits are searched, at most so long [s].

    Runs are made by `measure_once` and kept in the store, or by `runner` if it is given.
    """

    case: Case
    kind: Kind
    setting: Setting
    store: Store
    timeout: float = TIMEOUT
    runner: Runner | None = None

    @property
    def engine(self) -> Engine:
        """What the engine says of itself."""
        return engine_of(self.setting.engine)

    @property
    def models(self) -> Path:
        """Where changed models are kept."""
        return self.store.folder / "models"

    @property
    def integrator(self) -> str:
        """The integrator, or that it is the model's own."""
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
        task = StudyRun(case, self.kind, self.setting.but(**parameters), "stress", timed=False)
        try:
            if self.runner:
                return self.runner(task)
            return measure_once(task, self.store, self.timeout)
        except InputError as error:
            refused = self.engine.native and not is_compiled(case)
            return Measurement(outcome="refused" if refused else "no start", message=error.wrong)

    def find_failure(self, case: Case, **parameters: ParameterValue) -> Failure | None:
        """Run a changed case; why the run fails, or None."""
        return find_failure(self.run(case, **parameters), self.kind)

    def try_case(self, case: Case, **parameters: ParameterValue) -> TrialResult:
        """Run a changed case; why the run fails, and the step that was taken."""
        found = self.run(case, **parameters)
        return TrialResult(find_failure(found, self.kind), found.step)

    def try_in_steps(self, case: Case, seconds: float, **parameters: ParameterValue) -> TrialResult:
        """Run a changed case for so long [s], in steps of just what is asked.

        Raises
        ------
        RuntimeError
            The engine took another step.
        """
        step = float(str(parameters.get("timestep", self.step)))
        found = self.try_case(with_whole_steps(case, seconds, step), **parameters)
        if not (isnan(found.step) or isclose(found.step, step, rel_tol=SAME)):
            raise RuntimeError(
                f"{self.case.name}, {self.setting.engine}: took steps of "
                f"{found.step!r} s where {step!r} s were asked for"
            )
        return found

    def search_schemes(
        self,
        parameter: str,
        unit: str,
        start: float,
        reach: float,
        trial: Callable[[dict[str, ParameterValue], float], TrialResult],
        schemes: Iterable[Scheme],
    ) -> Iterator[LimitSearch]:
        """The search for a limit of this case, for each of the engine's schemes."""
        if len(self.engine.schemes) < 2:
            yield self.search(parameter, unit, start, reach, partial(trial, {}))
            return
        for one in schemes:
            yield self.search(parameter, unit, start, reach, partial(trial, one.settings), one.name)

    def search(
        self,
        parameter: str,
        unit: str,
        start: float,
        reach: float,
        trial: TryValue,
        words: str = "",
        **more: Any,
    ) -> LimitSearch:
        """The search for a limit of this case."""
        return LimitSearch(
            self.case.name,
            self.setting.engine,
            words or self.integrator,
            parameter,
            unit,
            start,
            reach,
            trial,
            **more,
        )


def measure_once(task: StudyRun, store: Store, timeout: float = TIMEOUT) -> Measurement:
    """A run, from the store if it is there.

    Nobody asks for its wall time, so that it needs no processor of its own.
    """
    return store.once(key_of(task), task, timeout, partial(measure_untimed, task, timeout))


def measure_untimed(task: StudyRun, timeout: float) -> Measurement:
    """A run, or the outcome of what failed."""
    found = measure(observe, task, False, None, timeout=timeout)
    return find_late_part(task, found) if found.outcome == Outcome.TIMED_OUT else found


def find_late_part(task: StudyRun, late: Measurement) -> Measurement:
    """A run that gave no answer in time: the engine's fault if late again, or the reference's."""
    if isinstance(measure(simulate_task, task, timeout=TIMEOUT), Measurement):
        return late
    message = f"{late.message}; the engine has its run"
    return Measurement(outcome=Outcome.NO_REFERENCE, message=message)


def is_compiled(case: Case) -> bool:
    """Whether the case's file can be compiled; in a worker."""
    return cast(bool, isolated(compiles, case.model_path, timeout=TIMEOUT))


def find_failure(found: Measurement, run: Kind) -> Failure | None:
    """Why a run fails, or None."""
    if found.outcome != Outcome.RAN:
        unseen = found.outcome in (Outcome.DIVERGED, Outcome.NOT_FINITE) and not is_engine_warning(
            found.message
        )
        return Failure(f"{found.outcome}: {found.message}", limit_kind(found), unseen)
    for kind in JUDGED[run]:
        if not found.errors.get(kind, 0.0) <= LARGE:
            return Failure(
                f"{format_kind(kind)} off by {found.errors[kind]:.2g} of its range",
                BoundaryKind.INACCURATE,
                silent=True,
            )
    return None


def is_failure(failure: Failure | None) -> bool:
    """Whether a value fails for a reason of the engine's."""
    return failure is not None and failure.limit != BoundaryKind.OURS


def limit_kind(found: Measurement) -> BoundaryKind:
    """What kind of limit a run without errors is."""
    if found.outcome == Outcome.CRASHED and found.message.startswith(KILLED):
        return BoundaryKind.UNSTABLE
    return LIMITS.get(found.outcome, BoundaryKind.OURS)


class NotApplicable(Exception):
    """A limit that a case does not have; says why."""


def require(there: object, why: str) -> None:
    """Raise `NotApplicable` where something is missing."""
    if not there:
        raise NotApplicable(why)


def reference_follows_masses(case: Case) -> bool:
    """Whether the reference stays right when masses change: it reads them, or needs none."""
    return case.reference == READS or (bool(case.drive) and mobility(case) == len(case.drive))
