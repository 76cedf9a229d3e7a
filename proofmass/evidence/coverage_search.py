"""The search for the numbers that a case notices, and for the smallest noticed change of each.

**Trial changes.**  A number is increased and decreased by `CHANGE_SHARE` of its value, or by
`CHANGE_SHARE` of a natural size if it is 0.  Numbers of kinds that are often not noticed are first
changed together, by random shares of at least `CHANGE_SHARE` and with random signs, then with the
opposite signs.  If neither change is noticed, the group is left to the next runs; otherwise it is
halved.

**The smallest change.**  From the errors e0 before and e1 after a change d the rate of every
error is (e1 - e0) / d at each sample.  The channel whose tolerance is used up first by these rates
gives an estimate of the smallest noticed change.  The run is repeated with twice the estimate,
until they agree within a factor `ACCEPTED_RATIO`.

The quickest run is tried first, kind by kind.  The numbers that it does not notice are tried in the
other runs, one after the other, as a group of all kinds.  Sweeps are made at some of their samples:
a change that is noticed at these is noticed by the whole run as well.  All samples are used if the
unchanged model cannot be swept at a part of them.  In a group one number may hide another, so each
number that was not noticed is then changed alone, up and down, in each whole run; this gives the
share of a tolerance that the change uses.  At the end the other runs are tried with half of the
changes that were found.
"""

import math
import random
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass, replace
from typing import Annotated, Any, TypeVar

from pydantic import BeforeValidator

from proofmass.base.strict import Kind
from proofmass.base.worker import TimedOut, call_isolated
from proofmass.case.case import Case
from proofmass.evidence.changed import (
    Baseline,
    Changes,
    Trial,
    numbers_of_case,
    run_baseline,
    run_with_changes,
    sample_stride,
)
from proofmass.reference.run_reference import changeable_parameters
from proofmass.sim.elements import NotWritten, Number
from proofmass.sim.numbers import CHANGE_SHARE
from proofmass.verdict.comparison import failed_comparisons
from proofmass.verdict.noticed import noticed_changes, smallest_noticed
from proofmass.verdict.outcome import FAILED_OUTCOMES, OUTCOME_OF_EXCEPTION, Outcome

GROUP_SIZE = 6
"""Most numbers of a kind in a group."""
FIRST_CHANGE_SHARE = 1e-4
"""Share of the trial change in the first run of a number, whose rates tell the next change."""
ACCEPTED_RATIO = 4.0
"""An estimate is accepted if the noticed change it comes from is at most so many times as large."""
CLOSE_BOUNDS = 1.5
"""Ratio of a noticed and an unnoticed change at which a search between them ends."""
MAX_ROUNDS = 8
"""Most runs in the search for the smallest noticed change."""
FAILED_CHANGE_FACTOR = 1e-2
"""Factor on a change with which a run fails, for the next run, which may have rates."""
MAX_FAILED_CHANGES = 3
"""Number of successive changes with which a run fails, after which the search ends."""
MAX_GROUP_CHANGE = 2.0
"""Largest change in a group, as a multiple of the trial change of a number alone."""
RETRY_TIME_FACTOR = 4.0
"""Factor on the limit of time for the second run of a trial that reached it."""
PROMISED_SHARE = 0.8
"""Another solver is tried if its rates promise less than this share of the change that is found."""
GROUPED_KINDS = {
    "inertia",
    "damping",
    "armature",
    "friction",
    "softness of the loop",
    "softness of the stop",
    "start rate",
    "range",
}
"""Kinds that are often not noticed; they are tried in groups first, the others one by one."""
POSITIVE_KINDS = {"damping", "armature", "friction", "stiffness"}
"""Kinds whose numbers are not made negative."""
COMPLETE_LABEL = "all together"
"""Label of the complete findings, after the last step of the search."""
StoredFloat = Annotated[float, BeforeValidator(lambda x: math.nan if x is None else x)]
"""A number that may be NaN, which is null in JSON."""
Item = TypeVar("Item")
MapFunction = Callable[..., Iterable[Any]]
"""The function `map`, or the `map` of a pool."""


@dataclass(frozen=True)
class CheckedRun:
    """How closely a solver of a run is checked.

    Attributes
    ----------
    run, solver : str
    checked, channels : int
        Number of channels that agree within a tolerance, and of all channels of the run.
    channel : str
        The channel whose error is nearest to its tolerance.
    error, allowed : float
        Its error and the allowed one, as shares of the scale that `scale_of` gives [1]; 0 if no
        channel is checked.
    why : tuple of str
        The reasons of the tolerances, without repetition.
    units : tuple of str
        Units of the channels that are checked.
    """

    run: str
    solver: str
    checked: int
    channels: int
    channel: str = ""
    error: StoredFloat = 0.0
    allowed: StoredFloat = 0.0
    why: tuple[str, ...] = ()
    units: tuple[str, ...] = ()


@dataclass(frozen=True)
class Finding:
    """The result of changing one number, of the model or of the reference.

    Attributes
    ----------
    kind, of, unit : str
        The kind of the number, its element, and its unit; `kind` is ``parameter`` for a number of
        the reference.
    value, tried : float
        The number, and the change that was tried [its unit].
    noticed : bool
        Whether a run notices the change.
    change : float
        The smallest noticed change, with its sign [its unit]; NaN if it is not known.
    run, solver, channel : str
        The channel that notices it; for a number that is not noticed the channel that the change
        moves most, if that was tried.
    refused : str
        Why the run fails with the change, if no channel of this run notices a smaller one; whether
        another run notices one is not known.
    moved : float
        For a number that is not noticed the change of the error of that channel, as a share of its
        tolerance, by the change that was tried [1]; NaN if no channel is left to compare.
    """

    kind: str
    of: str
    unit: str
    value: float
    tried: float
    noticed: bool
    change: StoredFloat = math.nan
    run: str = ""
    solver: str = ""
    channel: str = ""
    refused: str = ""
    moved: StoredFloat = math.nan

    @property
    def name(self) -> str:
        """Kind and element as text."""
        return f"{self.kind} of {self.of}"

    @property
    def share(self) -> float:
        """The smallest noticed change as a share of the number; NaN if the number is 0."""
        return abs(self.change / self.value) if self.value else math.nan

    @property
    def measure(self) -> float:
        """The smallest noticed change over the tried one, by which findings are sorted."""
        return abs(self.change / self.tried) if self.tried else math.inf


class Search:
    """The search of one case: its unchanged runs, and runs with changed groups of numbers.

    Parameters
    ----------
    case : Case
    pool : ThreadPoolExecutor
        The threads that wait for workers.

    Attributes
    ----------
    before : list of Baseline
        The unchanged runs of all solvers with a tolerance.
    left_out : str
        Why no number is tried; empty if numbers are tried.
    """

    def __init__(self, case: Case, pool: ThreadPoolExecutor) -> None:
        self.case, self.pool = case, pool
        self.before: list[Baseline] = []
        self.left_out = ""
        self.strides = {kind: sample_stride(case, kind) for kind in case.run}

    def run(self, found: dict[str, list[Finding]]) -> Iterator[tuple[int, int, str]]:
        """Try all groups that are not in `found`, and add them.

        Yields after each group the number of groups that are found, that of all, and the label.
        """
        case = self.case
        names = [(kind, s) for kind, run in case.run.items() for s in run.solvers]
        asked = [self.pool.submit(self.base, *name) for name in names]
        self.before = [run for one in asked if (run := one.result())]
        model_numbers: list[Number] = []
        if not self.runs():
            self.left_out = "; ".join(self.failed())
        self.use_all_samples()
        try:
            if self.runs():
                model_numbers = self.call(next(iter(case.run)), numbers_of_case)
        except NotWritten as error:
            self.left_out = str(error)
        groups = {} if COMPLETE_LABEL in found else group_numbers(model_numbers)
        missing = [label for label in groups if label not in found]
        waiting: dict[Future[list[Finding]], str] = {
            self.pool.submit(self.tried, groups[label]): label for label in missing
        }
        runs = self.runs()
        later_steps: list[tuple[str, Callable[..., dict[Number, Finding]], Baseline]] = [
            *((f"then {run.kind} {run.solver}", self.asked, run) for run in runs[1:]),
            *((f"alone {run.kind} {run.solver}", self.alone, run) for run in runs),
        ]
        total = len(groups) + len(later_steps) + 1 if groups else 0
        while waiting:
            for future in wait(waiting, return_when=FIRST_COMPLETED).done:
                label = waiting.pop(future)
                found[label] = future.result()
                yield len(found), total, label
        if not groups:
            return
        pairs = (pair for k in groups for pair in zip(groups[k], found[k], strict=True))
        findings = dict(pairs)
        for label, ask, run in later_steps:
            if label in found:
                findings = dict(zip(model_numbers, found[label], strict=True))
                continue
            findings = ask(run, findings)
            found[label] = [findings[number] for number in model_numbers]
            yield len(found), total, label
        findings = self.try_half_changes(findings)
        found.clear()
        found[COMPLETE_LABEL] = [findings[number] for number in model_numbers]
        yield total, total, COMPLETE_LABEL

    def use_all_samples(self) -> None:
        """Use all samples of a sweep whose unchanged run fails at a part of them.

        An example is a sweep with dry friction, if the drive turns back between the samples that
        remain.
        """
        for run in self.runs():
            if self.strides[run.kind] > 1 and self.trial(run, []).failed:
                self.strides[run.kind] = 1

    def call(self, kind: Kind, function: Callable, *args: object, time_factor: float = 1.0) -> Any:
        """Call a function of the case in a worker, within the limits of a run."""
        limits = self.case.run[kind]
        timeout = time_factor * limits.timeout
        return call_isolated(function, self.case, *args, timeout=timeout, memory=limits.memory)

    def base(self, kind: Kind, solver: str) -> Baseline | None:
        """The unchanged run of a solver; None if none of its channels has a tolerance."""
        case = self.case
        if not any(case.tolerance_for(kind, solver, name) for name in case.channels_of(kind)):
            return None
        try:
            found: Baseline = self.call(kind, run_baseline, kind, solver)
        except tuple(OUTCOME_OF_EXCEPTION) as error:
            failed = failed_comparisons(case, kind, solver, error)
            return Baseline(kind, solver, {}, {}, {}, failed)
        return found

    def failed(self) -> Iterator[str]:
        """Phrases on the unchanged runs that have no curves."""
        for one in self.before:
            for c in one.comparisons[:1]:
                if c.outcome in FAILED_OUTCOMES:
                    yield f"the {one.kind} of {one.solver} is {c.outcome} as it is: {c.message}"

    @property
    def limited(self) -> bool:
        """Whether an unchanged run reached a limit of time or memory, which it may keep later."""
        outcomes = {c.outcome for one in self.before for c in one.comparisons}
        return bool(outcomes & {Outcome.TIMED_OUT, Outcome.OUT_OF_MEMORY})

    def runs(self) -> list[Baseline]:
        """The runs with checked channels: runs at rest first, then by steps."""
        checked_runs = [one for one in self.before if one.errors]
        return sorted(checked_runs, key=lambda one: (one.kind == "dynamics", one.steps))

    def trial(self, run: Baseline, changes: Changes, whole: bool = False) -> Trial:
        """A run with changed numbers; a run that ends with its worker gives a failed trial."""
        same_kind = [one for one in self.before if one.kind == run.kind and one.errors]
        stride = 1 if whole else self.strides[run.kind]
        asked = run.kind, run_with_changes, run.kind, run.solver, list(changes), same_kind, stride
        why = ""
        # the limit of time is that of the unchanged run
        for time_factor in (1.0, RETRY_TIME_FACTOR):
            try:
                found: Trial = self.call(*asked, time_factor=time_factor)
            except TimedOut as error:
                why = str(error)
            except tuple(OUTCOME_OF_EXCEPTION) as error:
                return Trial(math.inf, failed=str(error))
            else:
                return found
        return Trial(math.inf, failed=why)

    def tried(self, group: Sequence[Number]) -> list[Finding]:
        """Findings of the first run on a group of numbers of one kind."""
        run = self.runs()[0]
        alone = list(group)
        if group[0].kind in GROUPED_KINDS:
            alone = halve_noticed(group, lambda some: self.moves(run, some))
        found = self.one_by_one(run, alone, map)
        return [found.get(number) or unnoticed_finding(number) for number in group]

    def asked(self, run: Baseline, known: Mapping[Number, Finding]) -> dict[Number, Finding]:
        """The findings after another run was tried with all numbers that were not noticed."""
        pending = [number for number, one in known.items() if not one.noticed]
        alone = halve_noticed(pending, lambda some: self.moves(run, some), self.pool.map)
        return {**known, **self.one_by_one(run, alone, self.pool.map)}

    def moves(self, run: Baseline, group: Sequence[Number]) -> bool:
        """Whether a run notices a group whose numbers are changed together, with either signs."""
        return any(self.trial(run, changes).ratio > 1 for changes in random_changes(group))

    def one_by_one(
        self, run: Baseline, group: Sequence[Number], each: MapFunction
    ) -> dict[Number, Finding]:
        """Findings on those numbers of a group that are noticed when they are changed alone."""
        found = each(lambda number: self.try_alone(run, number), group)
        return {number: one for number, one in zip(group, found, strict=True) if one}

    def alone(self, run: Baseline, known: Mapping[Number, Finding]) -> dict[Number, Finding]:
        """The findings after each number that was not noticed is changed alone in a whole run.

        For a number that is still not noticed, the finding has the channel that it moves most.
        """

        def farthest(number: Number) -> Finding:
            found = known[number]
            for side in signs_of_change(number):
                trial = self.trial(run, [(number, side * number.step)], whole=True)
                if trial.ratio > 1 and (one := self.try_alone(run, number, whole=True)):
                    return one
                if not trial.moved <= found.moved and not math.isnan(trial.moved):
                    found = replace(found, run=run.kind, solver=run.solver)
                    found = replace(found, channel=trial.moves, moved=trial.moved)
            return found

        unnoticed = [number for number, one in known.items() if not one.noticed]
        return {**known, **dict(zip(unnoticed, self.pool.map(farthest, unnoticed), strict=True))}

    def try_alone(self, run: Baseline, number: Number, whole: bool = False) -> Finding | None:
        """The finding of a run on a number; None if the run does not notice the trial change."""
        small = FIRST_CHANGE_SHARE * number.step
        trial = self.trial(run, [(number, small)], whole)
        if trial.failed:
            return self.find_smallest(
                run, number, FAILED_CHANGE_FACTOR * small, (small, trial), whole
            )
        if (estimate := self.estimate_change(run, number, small, trial)) and abs(
            estimate
        ) < number.step:
            begin = math.copysign(min(2 * abs(estimate), number.step), estimate)
            if one := self.find_smallest(run, number, begin, None, whole):
                return one
        for change in (side * number.step for side in signs_of_change(number)):
            trial = self.trial(run, [(number, change)], whole)
            if trial.ratio > 1:
                begin = change * (FAILED_CHANGE_FACTOR if trial.failed else 0.5)
                return self.find_smallest(run, number, begin, (change, trial), whole)
        return None

    def estimate_change(self, run: Baseline, number: Number, change: float, trial: Trial) -> float:
        """The smallest change that a run would notice by the rates of a trial; 0 without rates."""
        estimate = [
            side * limit.factor * change
            for side, limit in zip((1, -1), trial.limits[run.solver], strict=True)
            if limit.factor < math.inf
            and side * math.copysign(1, change) in signs_of_change(number)
        ]
        return min(estimate, key=abs, default=0.0)

    def find_smallest(
        self,
        run: Baseline,
        number: Number,
        begin: float,
        known: tuple[float, Trial] | None = None,
        whole: bool = False,
    ) -> Finding | None:
        """The finding with the smallest change that a run notices; None if it notices none.

        The search begins with the change `begin`; `known` is a change that is noticed, with its
        trial.
        """
        least, change, failed, largest_unnoticed = known, begin, 0, 0.0
        for _ in range(MAX_ROUNDS):
            trial = self.trial(run, [(number, change)], whole)
            if trial.ratio > 1 and (least is None or abs(change) < abs(least[0])):
                least = change, trial
            if trial.failed:
                # A failed run has no rates to go on from; one with a far smaller change may have.
                change, failed = FAILED_CHANGE_FACTOR * change, failed + 1
                if failed == MAX_FAILED_CHANGES:
                    break
                continue
            limit = trial.limits[run.solver][0]
            if trial.ratio > 1 and 1 / ACCEPTED_RATIO <= limit.factor <= 1:
                # By the rate of this run the change that is just noticed is hardly smaller.
                return self.try_other_solver(run, number, change, trial) or noticed_finding(
                    number, limit.factor * change, run, limit.channel
                )
            if trial.ratio <= 1:
                largest_unnoticed = max(largest_unnoticed, abs(change))
            if least is not None and largest_unnoticed > 0.0:
                if abs(least[0]) < CLOSE_BOUNDS * largest_unnoticed:
                    break
                # The change is between two bounds, but the rates missed it, since the error is
                # quadratic, or has a threshold, as friction has that a solver's tolerance hides:
                # the mean of the bounds' logarithms halves the search.
                change = math.copysign(math.sqrt(largest_unnoticed * abs(least[0])), least[0])
                continue
            estimate = self.estimate_change(run, number, change, trial)
            if not estimate or (least is None and abs(estimate) > number.step):
                break  # the rate was only rounding
            # twice the estimate: a change that should be noticed, and so bounds the search
            change = math.copysign(min(2 * abs(estimate), number.step), estimate)
        if least is None:
            return None
        change, trial = least
        return noticed_finding(number, change, run, trial.channel, trial.failed)

    def try_other_solver(
        self, run: Baseline, number: Number, change: float, trial: Trial
    ) -> Finding | None:
        """The finding of another solver of the run, if the rates promise a smaller change there."""
        own = trial.limits[run.solver][0].factor
        others = [one for one in self.runs() if one.kind == run.kind and one is not run]
        for other in others:
            promised = trial.limits[other.solver][0].factor
            if promised < PROMISED_SHARE * own:
                again = self.trial(other, [(number, 2 * promised * change)])
                limit = again.limits[other.solver][0] if again.limits else None
                if again.ratio > 1 and limit and 1 / ACCEPTED_RATIO <= limit.factor <= 1:
                    return noticed_finding(
                        number, limit.factor * 2 * promised * change, other, limit.channel
                    )
        return None

    def try_half_changes(self, known: Mapping[Number, Finding]) -> dict[Number, Finding]:
        """The findings after other runs were tried with half of the changes that were found."""
        found = dict(known)
        for run in self.runs():
            for is_same_kind in (True, False):
                others = [
                    number
                    for number, one in found.items()
                    if one.noticed
                    and not one.refused
                    and (one.run, one.solver) != run.name
                    and (one.run == run.kind) == is_same_kind
                ]
                for number in self.noticed_at_half(run, others, found, is_same_kind):
                    one = found[number]
                    other = self.find_smallest(run, number, one.change, None, whole=True)
                    if other and abs(other.change) < abs(one.change):
                        found[number] = other
        return found

    def noticed_at_half(
        self,
        run: Baseline,
        group: Sequence[Number],
        found: Mapping[Number, Finding],
        is_same_kind: bool,
    ) -> list[Number]:
        """The numbers of which a run notices half of the smallest change found so far.

        If the run is of the same kind, `is_same_kind`, the rates have shown already which changes
        it notices, but it may still refuse a change of any size.  So the changes in a group are
        then so small that together they are less than is noticed.
        """

        def asks(part: Sequence[Number]) -> bool:
            share = 0.5 / len(part) if is_same_kind else 0.5
            changes = [(number, share * found[number].change) for number in part]
            return self.trial(run, changes).ratio > 1

        alone = halve_noticed(group, asks, self.pool.map)
        return [number for number in alone if asks([number])]

    def differing(self) -> Iterator[str]:
        """The channels that differ without a change, as ``run solver channel``."""
        fine = (Outcome.AGREES, Outcome.UNCHECKED, Outcome.UNSUPPORTED)
        for c in (c for one in self.before for c in one.comparisons if c.outcome not in fine):
            yield f"{c.run} {c.solver} {c.channel}"

    def checked(self) -> Iterator[CheckedRun]:
        """How closely each solver of each run is checked."""
        baselines = {one.name: one for one in self.before}
        for kind, run in self.case.run.items():
            for solver in run.solvers:
                count, one = len(self.case.channels_of(kind)), baselines.get((kind, solver))
                if one is None or not one.errors:
                    yield CheckedRun(kind, solver, 0, count)
                    continue
                agreeing = [c for c in one.comparisons if c.channel in one.errors]
                nearest = max(agreeing, key=lambda c: c.error_max / c.allowed)
                share = one.shares[nearest.channel]
                yield CheckedRun(
                    kind,
                    solver,
                    len(agreeing),
                    count,
                    nearest.channel,
                    share * nearest.error_max / nearest.allowed,
                    share,
                    tuple(dict.fromkeys(c.message for c in agreeing)),
                    tuple(dict.fromkeys(c.unit for c in agreeing)),
                )

    def parameters(self) -> Iterator[Finding]:
        """Findings on the reference's parameters, from the detectable changes of comparisons."""
        comparisons = [c for one in self.before for c in one.comparisons]
        noticed = noticed_changes(comparisons, {Outcome.AGREES})
        for name, value in changeable_parameters(self.case).items():
            blank = Finding("parameter", name, "", value, CHANGE_SHARE * abs(value), False)
            changes = noticed.get(name, [])
            if found := smallest_noticed(changes):
                change, c = found
                size = change.size * (abs(value) if change.relative else 1.0)
                yield replace(
                    blank,
                    noticed=True,
                    change=size,
                    run=c.run,
                    solver=c.solver,
                    channel=c.channel,
                )
            else:
                yield replace(blank, noticed=bool(changes), refused="not known" if changes else "")


def group_numbers(there: Sequence[Number]) -> dict[str, list[Number]]:
    """Numbers in groups of one kind and of at most `GROUP_SIZE`, by labels."""
    groups: dict[str, list[Number]] = {}
    for kind in dict.fromkeys(number.kind for number in there):
        own = [number for number in there if number.kind == kind]
        for k in range(0, len(own), GROUP_SIZE):
            groups[f"{kind} {k // GROUP_SIZE + 1}"] = own[k : k + GROUP_SIZE]
    return groups


def halve_noticed(
    group: Sequence[Item], is_noticed: Callable[[Sequence[Item]], bool], each: MapFunction = map
) -> list[Item]:
    """The members of a group that are left after halving each part that is noticed.

    >>> halve_noticed("abcdefgh", lambda some: "c" in some)
    ['c', 'd']
    """
    level: list[Sequence[Item]] = [group] if group else []
    alone = list[Item]()
    while level:
        alone += [some[0] for some in level if len(some) == 1]
        several = [some for some in level if len(some) > 1]
        yes = each(is_noticed, several)
        inside = [some for some, one in zip(several, yes, strict=True) if one]
        level = [
            half for some in inside for half in (some[: len(some) // 2], some[len(some) // 2 :])
        ]
    return alone


def is_decreased(kind: str, value: float, step: float) -> bool:
    """Whether a number is decreased as well as increased."""
    return kind not in POSITIVE_KINDS or value >= step


def signs_of_change(number: Number) -> tuple[int, ...]:
    """The signs of the changes of a number."""
    return (1, -1) if is_decreased(number.kind, number.value, number.step) else (1,)


def random_changes(group: Sequence[Number]) -> Iterator[Changes]:
    """Random changes of a group, with random signs; then others with the opposite signs.

    A number that is not decreased is increased both times.  No change is smaller than that of the
    number alone.
    """
    generator = random.Random(" ".join(number.name for number in group))
    sides = [generator.choice((1, -1)) for _ in group]
    for turn in (1, -1):
        changes = []
        for number, side in zip(group, sides, strict=True):
            sign = turn * side if len(signs_of_change(number)) > 1 else 1
            changes.append((number, sign * generator.uniform(1.0, MAX_GROUP_CHANGE) * number.step))
        yield changes


def noticed_finding(
    number: Number, change: float, run: Baseline, channel: str, failed: str = ""
) -> Finding:
    """The finding of a number that is noticed."""
    return replace(
        unnoticed_finding(number),
        noticed=True,
        change=float(change),
        run=run.kind,
        solver=run.solver,
        channel=channel,
        refused=failed,
    )


def unnoticed_finding(number: Number) -> Finding:
    """The finding of a number that is not noticed."""
    return Finding(number.kind, number.of, number.unit, number.value, number.step, noticed=False)
