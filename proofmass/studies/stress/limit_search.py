"""Search for limits: one parameter is increased or decreased until a run of a case fails.

A run fails if the engine reports it, if a curve is not finite, if the constraint violation reaches
a tenth of the mechanism, or if the error of a position, or of a holding moment in a sweep, exceeds
a tenth of its range.  The engine does not notice such an error.  If proofmass itself gives up, the
limit is not the engine's; see `proofmass.studies.stress.boundary.BoundaryKind`.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, dataclass, fields, replace
from functools import partial
from itertools import chain
from math import floor, isclose, isnan, log10
from pathlib import Path
from typing import Any, TypeVar, cast

import numpy as np

from proofmass.base.errors import InputError
from proofmass.base.strict import Kind
from proofmass.base.wording import number
from proofmass.base.worker import KILLED_BY_SIGNAL, call_isolated
from proofmass.case.case import Case
from proofmass.reference.case_model import compiled_model
from proofmass.reference.mobility import mobility
from proofmass.reference.samples import run_samples
from proofmass.sim.engines import engine_of
from proofmass.sim.mjcf import compiles
from proofmass.sim.protocol.engine import Engine
from proofmass.sim.protocol.theory import Scheme
from proofmass.studies.bracket import Bracket
from proofmass.studies.measure import Measurement, StudyRun, measure, observe, simulate_task
from proofmass.studies.record import NAN, ParameterValue, Setting, format_kind
from proofmass.studies.stress.boundary import (
    PRINTED_DIGITS,
    Boundary,
    BoundaryKind,
    Failure,
    PredictedLimit,
    TrialResult,
    VariedRange,
    is_engine_warning,
)
from proofmass.studies.study import Study
from proofmass.studies.variants import PLANAR_REFERENCE, with_whole_steps
from proofmass.verdict.outcome import Outcome

BOUNDARY_TOLERANCE = 0.01
"""Relative distance of the failing value from the holding one at which a bisection ends."""
UNKNOWN_BOUNDARY_TOLERANCE = 0.1
"""The same if nothing is known beyond the holding value, and theory has no boundary either: then
the value is not a property of the engine."""
STRIDE_FACTOR = 4.0
"""Largest factor between consecutive values on the way to the extreme, before the bisection."""
NEIGHBOUR_FACTORS = 1.01, 1.02, 1.03, 1.04, 1.06, 1.1, 1.2, 1.4
"""Factors to both sides of a boundary at which values are tried: those before it must hold, those
beyond it must fail.  Bisection finds only one of several boundaries, and a stride is a factor of 4.
Errors that go up and down with the parameter do so within 2 to 4 % of its value."""
NEAREST_FACTOR = 1.02
"""Factor from the first of several boundaries back to the value that is given as holding.  Only if
bisection ended within this factor are other boundaries searched for."""


LARGE_ERROR = 0.1
"""Largest error, as a share of the reference's range, with which a run does not fail."""
JUDGED_ERROR_KINDS: dict[Kind, tuple[str, ...]] = {
    "sweep": ("position", "force"),
    "equilibrium": ("position", "force"),
    "dynamics": ("position",),
}
SEARCH_RUN_TIMEOUT = 60.0  # [s] of a run
MAX_SEARCH_STEPS = 1_000_000  # steps of the longest runs
SAME_STEP_SHARE = 1e-9  # relative difference of two time steps that is only rounding
LIMIT_OF_OUTCOME: dict[str, BoundaryKind] = {
    Outcome.DIVERGED: BoundaryKind.UNSTABLE,
    Outcome.NOT_FINITE: BoundaryKind.UNSTABLE,
    Outcome.STOPPED: BoundaryKind.UNSTABLE,
    "refused": BoundaryKind.REFUSED,
}
"""Kind of limit for each outcome that the engine causes; with all other outcomes proofmass itself
gave up."""


TryValue = Callable[[float], TrialResult]
"""Tries a value of the parameter."""


PredictValue = Callable[[], PredictedLimit | None]
"""Predicts a boundary; None if there is no prediction."""


T = TypeVar("T")


class TriedValues(dict[float, T]):
    """The results of values that were tried; a value is tried when it is first asked for.

    >>> squares = TriedValues(lambda value: value**2)
    >>> squares[3.0], squares.get(4.0), dict(squares)
    (9.0, None, {3.0: 9.0})
    """

    def __init__(self, trial: Callable[[float], T]) -> None:
        super().__init__()
        self.trial = trial

    def __missing__(self, value: float) -> T:
        self[value] = self.trial(value)
        return self[value]


@dataclass(frozen=True)
class LimitSearch(VariedRange):
    """The search for a limit: its range, how to try a value, and the theory; see `Boundary`."""

    trial: TryValue
    theory: float = NAN
    law: str = ""
    least: float = NAN  # down to which a value that holds is searched for, if `start` fails
    predict: PredictValue | None = None

    def find(self, within: float = BOUNDARY_TOLERANCE) -> Boundary:
        """Find the boundary by bisection, and search for other boundaries near it.

        `within` is the relative distance of the failing value from the holding one.  It is used
        where proofmass itself gives up as well, if theory has a boundary: that may lie just before,
        for example if the engine runs beyond the values at which the reference exists.
        """
        tried = TriedValues(self.trial)

        def test(value: float) -> Failure | None:
            return tried[value].failure

        known = (self.predict and self.predict()) or PredictedLimit(self.theory, self.law)
        expected = np.isfinite(known.theory) and known.theory > 0
        coarse = within if expected else UNKNOWN_BOUNDARY_TOLERANCE
        start = find_start(test, self.start, self.least)
        holds, breaks, failure = bisect(test, start, self.reach, within, coarse)
        again = NAN
        if Bracket(holds, breaks).ratio < NEAREST_FACTOR and is_engine_failure(failure):
            holds, breaks, failure, again = find_first_and_last(
                test, start, self.reach, holds, breaks, failure
            )
        message, limit, silent = failure or ("", BoundaryKind.HOLDS, False)
        varied = {f.name: getattr(self, f.name) for f in fields(VariedRange)}
        return Boundary(
            **{**varied, "start": start},
            **asdict(known),
            holds=holds,
            breaks=breaks,
            again=again,
            step=tried.get(holds, TrialResult()).step,
            limit=limit,
            failure=message,
            silent=silent,
        )


def find_start(test: Callable[[float], Failure | None], start: float, least: float) -> float:
    """The first value that holds, from `start` down to `least` in strides of `STRIDE_FACTOR`.

    It is `start` if that holds, if none holds, or if proofmass itself gives up on the way.

    >>> failed = Failure("beyond", BoundaryKind.UNSTABLE)
    >>> find_start(lambda x: None if x < 0.2 else failed, 1.0, 1e-3)
    0.0625
    >>> find_start(lambda x: failed, 1.0, 1e-3), find_start(lambda x: failed, 1.0, NAN)
    (1.0, 1.0)
    """
    value = start
    while is_engine_failure(failure := test(value)):
        value /= STRIDE_FACTOR
        if not value >= least:  # not with NaN
            return start
    return start if failure else value


def bisect(
    test: Callable[[float], Failure | None],
    start: float,
    reach: float,
    within: float = BOUNDARY_TOLERANCE,
    coarse: float = UNKNOWN_BOUNDARY_TOLERANCE,
) -> tuple[float, float, Failure | None]:
    """Vary a parameter from `start` towards `reach`, and bisect where the first value fails.

    The values are geometrically spaced, so all of them are positive.  The first boundary that a
    stride crosses is found.  Failing values between two strides that hold are not seen, and only
    one of several boundaries is found: see `find_first_and_last`.  The bisection ends at the
    relative distance `within`, or at `coarse` if that is larger and nothing is known
    beyond `holds`.

    Returns
    -------
    holds, breaks : float
        The furthest value that holds, and the nearest that fails [its unit], the unit of `start`;
        each is NaN if there is none.
    failure : Failure or None
        Why `breaks` fails, or `start` if that fails already; None if all values hold.

    Examples
    --------
    >>> failed = Failure("beyond", BoundaryKind.UNSTABLE)
    >>> holds, breaks, _ = bisect(lambda x: None if x < 2 else failed, 0.1, 100.0)
    >>> holds < 2 <= breaks, breaks / holds < 1.01
    (True, True)
    >>> bisect(lambda x: None if x > 1e-3 else failed, 1.0, 1e-2)
    (0.01, nan, None)
    """
    tried = TriedValues(test)
    if failure := tried[start]:
        return NAN, NAN, failure._replace(message=f"at {start:g} already: {failure.message}")
    strides = max(1, int(np.ceil(abs(np.log(reach / start)) / np.log(STRIDE_FACTOR) - 1e-9)))
    values = np.geomspace(start, reach, strides + 1)[1:].tolist()
    bracket = Bracket.find_first(
        chain([(start, True)], ((value, tried[value] is None) for value in values))
    )
    # The end of the bisection is asked for anew in each step, since the first failure may be
    # proofmass's own and a later one, nearer to the value that holds, the engine's.
    while bracket.ratio > 1.0 + (  # not with NaN
        within if is_engine_failure(tried.get(bracket.breaks)) else max(coarse, within)
    ):
        bracket = bracket.narrowed(bracket.middle, tried[bracket.middle] is None)
    return bracket.holds, bracket.breaks, tried.get(bracket.breaks)


def find_first_and_last(
    test: Callable[[float], Failure | None],
    start: float,
    reach: float,
    holds: float,
    breaks: float,
    failure: Failure | None,
) -> tuple[float, float, Failure | None, float]:
    """Search near a boundary for values before it that fail, and for values beyond it that hold.

    A run through a singular pose fails if one of its steps comes near that pose, and an error that
    goes up and down with the parameter exceeds its limit several times.  In such cases the first
    and the last boundary are searched for, until the values at all factors of `NEIGHBOUR_FACTORS`
    before the first one hold, and those beyond the last one fail.  Values are rounded to the
    printed digits.

    Parameters
    ----------
    test : callable
        Gives the failure of a value, or None if it holds.
    start, reach : float
        First and last value that may be tried [its unit].
    holds, breaks : float
        The values that `bisect` found [its unit].
    failure : Failure or None
        Why `breaks` fails.

    Returns
    -------
    holds, breaks : float
        The same values if there is one boundary; otherwise the value just before the first one that
        fails, which holds, and the first one that fails [its unit].
    failure : Failure or None
        Why `breaks` fails.
    again : float
        The last value that holds again [its unit]; NaN if there is one boundary.

    Examples
    --------
    >>> failed = Failure("beyond", BoundaryKind.UNSTABLE)
    >>> def test(x):  # fails from 2.2 to 2.3, and from 2.5 on
    ...     return failed if 2.2 <= x < 2.3 or x >= 2.5 else None
    >>> holds, breaks, _, again = find_first_and_last(test, 1.0, 9.0, 2.48, 2.5, failed)
    >>> holds < 2.2 <= breaks < 2.25, 2.45 < again < 2.5
    (True, True)
    >>> find_first_and_last(lambda x: failed if x >= 2 else None, 1.0, 9.0, 1.99, 2.0, failed)[-1]
    nan
    """
    up = reach > start

    def fails_at(value: float) -> bool:
        return is_engine_failure(test(value))

    def holds_at(value: float) -> bool:
        return test(value) is None

    # A value that was tried has more digits than are printed, and its printed neighbour may behave
    # otherwise. The search therefore begins at printed values.
    one_before = next(filter(holds_at, printed_neighbours(holds, not up)), holds)
    one_beyond = next(filter(fails_at, printed_neighbours(breaks, up)), breaks)
    between = float(number(Bracket(holds, breaks).middle))
    first = find_furthest(
        fails_at, one_beyond, start, not up, step_by_factor(between, NEAREST_FACTOR, start, not up)
    )
    last = find_furthest(
        holds_at, one_before, reach, up, step_by_factor(between, NEAREST_FACTOR, reach, up)
    )
    if first == one_beyond and last == one_before:
        return holds, breaks, failure, NAN
    return step_by_factor(first, NEAREST_FACTOR, start, not up), first, test(first), last


def find_furthest(
    meets: Callable[[float], bool], edge: float, end: float, up: bool, first_trial: float
) -> float:
    """The furthest value from an edge towards an end that meets a condition; the edge if none does.

    The value `first_trial` is tried first.  Then the values at all factors of `NEIGHBOUR_FACTORS`
    from the furthest one that meets the condition are tried, until none of them meets it.
    """
    found = first_trial if first_trial != edge and meets(first_trial) else edge
    while True:
        tried = [step_by_factor(found, factor, end, up) for factor in NEIGHBOUR_FACTORS]
        met = [value for value in tried if value != found and meets(value)]
        if not met:
            return found
        found = met[-1]


def round_to_printed(value: float) -> float:
    """A value rounded to the digits that are printed."""
    return float(number(value, PRINTED_DIGITS))


def printed_neighbours(value: float, up: bool) -> list[float]:
    """A value rounded to the digits that are printed, and the next such value, up or down.

    Of two values that round to the same digits one may hold and the other fail.

    >>> printed_neighbours(0.177634, up=True), printed_neighbours(0.177634, up=False)
    ([0.1776, 0.1777], [0.1776, 0.1775])
    """
    digit = 10.0 ** (floor(log10(value)) - PRINTED_DIGITS + 1)
    nearest = round_to_printed(value)
    return [nearest, round_to_printed(nearest + digit if up else nearest - digit)]


def step_by_factor(value: float, factor: float, end: float, up: bool) -> float:
    """A value multiplied or divided by a factor and rounded, but not beyond an end.

    >>> step_by_factor(0.05, 1.02, 1.0, up=True), step_by_factor(0.05, 1.02, 0.04901, up=False)
    (0.051, 0.04902)
    """
    there = round_to_printed(value * factor if up else value / factor)
    return min(there, end) if up else max(there, end)


@dataclass(frozen=True)
class StressedCase:
    """A case in one engine, and the kind of run in which its limits are searched for.

    Its runs are those of the study, see `Study.inside_worker`.
    """

    case: Case
    kind: Kind
    setting: Setting
    study: Study
    note: str = ""
    """Words on a setting that differs from that of the case."""

    @property
    def engine(self) -> Engine:
        """The engine of the setting."""
        return engine_of(self.setting.engine)

    @property
    def models(self) -> Path:
        """The folder in which changed models are kept."""
        return self.study.models

    def with_longest(self, seconds: float) -> "StressedCase":
        """The same with another processor time after which a run is given up [s]."""
        return replace(self, study=replace(self.study, longest=seconds))

    @property
    def integrator(self) -> str:
        """The integrator of the setting, or the words that it is the model's own."""
        return str(self.setting.parameters.get("integrator", "as in the model"))

    @property
    def step(self) -> float:
        """Time step [s] that the case asks for."""
        return float(
            str(self.setting.parameters.get("timestep", compiled_model(self.case).opt.timestep))
        )

    @property
    def seconds(self) -> float:
        """Duration of the run [s]."""
        x = run_samples(self.case, self.kind)
        return float(x[-1] - x[0])

    def run(self, case: Case, **parameters: ParameterValue) -> Measurement:
        """Run a changed case."""
        task = StudyRun(
            case, self.kind, self.setting.with_parameters(**parameters), "stress", timed=False
        )
        try:
            return self.study.measure_one(task, measure_untimed)
        except InputError as error:
            refused = self.engine.native and not can_compile(case)
            return Measurement(outcome="refused" if refused else "no start", message=error.wrong)

    def find_failure(self, case: Case, **parameters: ParameterValue) -> Failure | None:
        """Run a changed case; the failure of the run, or None."""
        return find_failure(self.run(case, **parameters), self.kind)

    def try_case(self, case: Case, **parameters: ParameterValue) -> TrialResult:
        """Run a changed case; the failure of the run, and the time step that was taken."""
        found = self.run(case, **parameters)
        return TrialResult(find_failure(found, self.kind), found.step)

    def try_in_steps(self, case: Case, seconds: float, **parameters: ParameterValue) -> TrialResult:
        """Run a changed case for a duration [s], in exactly the time steps that are asked for.

        Raises
        ------
        RuntimeError
            The engine took other time steps.
        """
        step = float(str(parameters.get("timestep", self.step)))
        found = self.try_case(with_whole_steps(case, seconds, step), **parameters)
        if not (isnan(found.step) or isclose(found.step, step, rel_tol=SAME_STEP_SHARE)):
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
        """A search for a limit of this case for each of the schemes, or one if there is no choice.

        `trial` is called with the settings of the scheme, and the value.
        """
        if len(self.engine.theory.schemes) < 2:
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
        """A search for a limit of this case; `words` describe the setting."""
        return LimitSearch(
            self.case.name,
            self.setting.engine,
            ", ".join(filter(None, (words or self.integrator, self.note))),
            parameter,
            unit,
            start,
            reach,
            trial,
            **more,
        )


def measure_untimed(task: StudyRun, timeout: float) -> Measurement:
    """Make a run that is not timed; the measurement of a failed run has only its outcome.

    Its processor time is not used, so the run does not need a processor of its own.
    """
    found = measure(observe, task, False, None, timeout=timeout)
    return attribute_timeout(task, found) if found.outcome == Outcome.TIMED_OUT else found


def attribute_timeout(task: StudyRun, late: Measurement) -> Measurement:
    """Tell whether the engine or the reference was too slow in a run that timed out.

    The engine is run alone: if it fails again the measurement is kept as it is, otherwise the
    outcome is that there is no reference.
    """
    if isinstance(measure(simulate_task, task, timeout=SEARCH_RUN_TIMEOUT), Measurement):
        return late
    message = f"{late.message}; the engine has its run"
    return Measurement(outcome=Outcome.NO_REFERENCE, message=message)


def can_compile(case: Case) -> bool:
    """Whether the model of a case compiles; it is tried in a worker process."""
    return cast(bool, call_isolated(compiles, case.model_path, timeout=SEARCH_RUN_TIMEOUT))


def find_failure(measurement: Measurement, run: Kind) -> Failure | None:
    """The failure of a run, or None."""
    if measurement.outcome != Outcome.RAN:
        unseen = measurement.outcome in (
            Outcome.DIVERGED,
            Outcome.NOT_FINITE,
        ) and not is_engine_warning(measurement.message)
        return Failure(
            f"{measurement.outcome}: {measurement.message}", kind_of_limit(measurement), unseen
        )
    for kind in JUDGED_ERROR_KINDS[run]:
        if not measurement.errors.get(kind, 0.0) <= LARGE_ERROR:
            return Failure(
                f"{format_kind(kind)} off by {measurement.errors[kind]:.2g} of its range",
                BoundaryKind.INACCURATE,
                silent=True,
            )
    return None


def is_engine_failure(failure: Failure | None) -> bool:
    """Whether a value fails by the engine, and not since proofmass itself gave up."""
    return failure is not None and failure.limit != BoundaryKind.OURS


def kind_of_limit(measurement: Measurement) -> BoundaryKind:
    """The kind of limit that a run meets which ended without curves to compare."""
    if measurement.outcome == Outcome.CRASHED and measurement.message.startswith(KILLED_BY_SIGNAL):
        return BoundaryKind.UNSTABLE
    return LIMIT_OF_OUTCOME.get(measurement.outcome, BoundaryKind.OURS)


class NotApplicable(Exception):
    """A case does not have this kind of limit; the message says why."""


def require(condition: object, why: str) -> None:
    """Raise `NotApplicable` if a condition is not met."""
    if not condition:
        raise NotApplicable(why)


def reference_follows_masses(case: Case) -> bool:
    """Whether the reference stays right when masses change: it reads them, or needs no masses."""
    return case.reference == PLANAR_REFERENCE or (
        bool(case.drive) and mobility(case) == len(case.drive)
    )
