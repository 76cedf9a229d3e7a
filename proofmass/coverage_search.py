"""The search for the numbers that a case notices, and for the smallest change of each.

**What is tried.**  A number is changed by `SHARE` of its value, one that is 0 by `SHARE` of a
natural size, to both sides.  Numbers of a kind that often nothing notices are changed together
first, by random shares of at least that and to random sides, then to the opposite sides: where
neither is noticed, they wait.  Where one is, the group is halved.

**The smallest change.**  From the errors e0 before and e1 after a change d the rate of every
error is (e1 - e0) / d at each sample, and the channel whose tolerance is used up first tells the
change that is noticed.  This is repeated with twice the change that was found, until the two agree.

The quickest run is asked first, kind by kind.  What it does not notice is asked of the other runs,
one after the other, as a group of all kinds.  Sweeps are searched at some of their samples, at
which what is noticed is noticed by the whole run as well, unless the model as it is cannot be swept
there.  In a group one number may hide another, so that each that nothing noticed is then changed
alone, to both sides, in each whole run, which tells how much of a tolerance it uses.  At the end
the other runs are asked for half of the changes that were found.
"""

import math
import random
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass, replace
from typing import Any, TypeVar

from proofmass.case import Case
from proofmass.changed import Baseline, Changes, Trial, baseline, numbers, stride_of, with_changes
from proofmass.compare import Comparison, changeable
from proofmass.outcome import FAILED, FAILURES, Outcome
from proofmass.sim.elements import NotWritten, Number
from proofmass.sim.numbers import SHARE
from proofmass.strict import Kind
from proofmass.worker import TimedOut, isolated

CHUNK = 6
"""Numbers of a kind that are tried together."""
SMALL = 1e-4
"""Of the change that is tried: the first one, whose rate tells what to try next."""
NEAR = 4.0
"""A change is found if it is up to so many times less than one that was tried and noticed."""
ROUNDS = 8
"""Changes to try for the smallest one that is noticed."""
DOWN = 1e-2
"""Of a change with which a run fails: the next one, which may tell a rate."""
IN_TURN = 3
"""Changes with which a run fails, one after the other, until it is given up."""
MOST = 2.0
"""Of the change that is tried alone: the largest in a group."""
LONGER = 4.0
"""Of the limit of time of a run: that of a trial that reached it, when it is asked once more."""
SOONER = 0.8
"""Of the change that is found: what another solver has to promise to be asked."""
QUIET = {
    "inertia",
    "damping",
    "armature",
    "friction",
    "softness of the loop",
    "softness of the stop",
    "start rate",
    "range",
}
"""Kinds that often nothing notices: they begin with a group, the others one by one."""
POSITIVE = {"damping", "armature", "friction", "stiffness"}
"""Kinds that are not tried below 0."""
MATERIAL = (
    "mass",
    "mass of a rod",
    "inertia",
    "stiffness",
    "stiffness of a rod",
    "axial stiffness of a rod",
    "shear stiffness of a rod",
    "torsion stiffness of a rod",
    "stiffness of a rod about y",
    "friction",
)
"""What mechanisms are made of: the kinds that a case should notice."""
WHOLE = "all together"
"""Label of what is asked at the end."""
Some = TypeVar("Some")
Each = Callable[..., Iterable[Any]]
"""A `map`, or that of a pool."""


@dataclass(frozen=True)
class CheckedRun:
    """How closely a solver of a run is checked.

    Attributes
    ----------
    run, solver : str
    checked, channels : int
        Channels that agree with a tolerance, and all of the run.
    channel : str
        The channel nearest its tolerance.
    error, allowed : float
        Its error and what it may be, as shares of what `scale_of` says [1]; 0 if none is checked.
    why : tuple of str
        The reasons of the tolerances, each once.
    units : tuple of str
        Units of the channels that are checked.
    """

    run: str
    solver: str
    checked: int
    channels: int
    channel: str = ""
    error: float = 0.0
    allowed: float = 0.0
    why: tuple[str, ...] = ()
    units: tuple[str, ...] = ()


@dataclass(frozen=True)
class Finding:
    """What came of changing one number, of the model or of the reference.

    Attributes
    ----------
    kind, of, unit : str
        The number, in words; `kind` is ``parameter`` for one of the reference.
    value, tried : float
        The number, and the change that was tried [its unit].
    noticed : bool
    change : float
        The smallest change that is noticed, with its sign [its unit]; NaN where it is not known.
    run, solver, channel : str
        What notices it; where nothing does, what the change moves most, if that was asked.
    refused : str
        Why the run fails with the change, where no channel tells a smaller one.
    moved : float
        Of a number that nothing notices: how much of its tolerance that channel moves by with the
        change that was tried [1]; NaN where no channel is left to tell it.
    """

    kind: str
    of: str
    unit: str
    value: float
    tried: float
    noticed: bool
    change: float = math.nan
    run: str = ""
    solver: str = ""
    channel: str = ""
    refused: str = ""
    moved: float = math.nan

    @property
    def name(self) -> str:
        """Kind and element, in words."""
        return f"{self.kind} of {self.of}"

    @property
    def share(self) -> float:
        """The smallest change as a share of the number; NaN of one that is 0."""
        return abs(self.change / self.value) if self.value else math.nan

    @property
    def measure(self) -> float:
        """The smallest change over that which was tried, by which findings are sorted."""
        return abs(self.change / self.tried) if self.tried else math.inf


class Search:
    """The search of one case: its runs as they are, and groups of numbers that are changed.

    Parameters
    ----------
    case : Case
    pool : ThreadPoolExecutor
        Whose threads wait for workers.

    Attributes
    ----------
    before : list of Baseline
        The runs that were asked for, as they are.
    left_out : str
        Why no number is tried; empty if they are.
    """

    def __init__(self, case: Case, pool: ThreadPoolExecutor) -> None:
        self.case, self.pool = case, pool
        self.before: list[Baseline] = []
        self.left_out = ""
        self.strides = {kind: stride_of(case, kind) for kind in case.run}

    def run(self, found: dict[str, list[Finding]]) -> Iterator[tuple[int, int, str]]:
        """Try all groups that are not found yet; yields how many are, after each of them."""
        case = self.case
        names = [(kind, s) for kind, run in case.run.items() for s in run.solvers]
        asked = [self.pool.submit(self.base, *name) for name in names]
        self.before = [run for one in asked if (run := one.result())]
        there: list[Number] = []
        if not self.runs():
            self.left_out = "; ".join(self.failed())
        self.keep_whole()
        try:
            if self.runs():
                there = self.call(next(iter(case.run)), numbers)
        except NotWritten as error:
            self.left_out = str(error)
        groups = {} if WHOLE in found else grouped(there)
        missing = [label for label in groups if label not in found]
        waiting: dict[Future[list[Finding]], str] = {
            self.pool.submit(self.tried, groups[label]): label for label in missing
        }
        runs = self.runs()
        later: list[tuple[str, Callable[..., dict[Number, Finding]], Baseline]] = [
            *((f"then {run.kind} {run.solver}", self.asked, run) for run in runs[1:]),
            *((f"alone {run.kind} {run.solver}", self.alone, run) for run in runs),
        ]
        total = len(groups) + len(later) + 1 if groups else 0
        while waiting:
            for future in wait(waiting, return_when=FIRST_COMPLETED).done:
                label = waiting.pop(future)
                found[label] = future.result()
                yield len(found), total, label
        if not groups:
            return
        pairs = (pair for k in groups for pair in zip(groups[k], found[k], strict=True))
        known = dict(pairs)
        for label, ask, run in later:
            if label in found:
                known = dict(zip(there, found[label], strict=True))
                continue
            known = ask(run, known)
            found[label] = [known[number] for number in there]
            yield len(found), total, label
        known = self.sooner(known)
        found.clear()
        found[WHOLE] = [known[number] for number in there]
        yield total, total, WHOLE

    def keep_whole(self) -> None:
        """Search sweeps at all samples that at some of them fail as they are.

        So is one with dry friction whose drive turns back between the samples that are left.
        """
        for run in self.runs():
            if self.strides[run.kind] > 1 and self.trial(run, []).failed:
                self.strides[run.kind] = 1

    def call(self, kind: Kind, function: Callable, *args: object, longer: float = 1.0) -> Any:
        """Call a function of the case in a worker, within the limits of a run."""
        limits = self.case.run[kind]
        timeout = longer * limits.timeout
        return isolated(function, self.case, *args, timeout=timeout, memory=limits.memory)

    def base(self, kind: Kind, solver: str) -> Baseline | None:
        """A run as it is; None of a solver of which no channel has a tolerance."""
        case, channels = self.case, self.case.channels_of(kind)
        if not any(case.tolerance_for(kind, solver, name) for name in channels):
            return None
        try:
            found: Baseline = self.call(kind, baseline, kind, solver)
        except tuple(FAILURES) as error:
            failed = [
                Comparison(
                    case.name,
                    solver,
                    kind,
                    name,
                    c.unit,
                    outcome=FAILURES[type(error)],
                    message=str(error),
                )
                for name, c in channels.items()
            ]
            return Baseline(kind, solver, {}, {}, {}, failed)
        return found

    def failed(self) -> Iterator[str]:
        """The runs that have no curves as they are, in words."""
        for one in self.before:
            for c in one.comparisons[:1]:
                if c.outcome in FAILED:
                    yield f"the {one.kind} of {one.solver} is {c.outcome} as it is: {c.message}"

    @property
    def limited(self) -> bool:
        """Whether a run reached a limit of time or memory as it is, and may not the next time."""
        outcomes = {c.outcome for one in self.before for c in one.comparisons}
        return bool(outcomes & {Outcome.TIMED_OUT, Outcome.OUT_OF_MEMORY})

    def runs(self) -> list[Baseline]:
        """The runs that check something: at rest before in time, the quickest first."""
        there = [one for one in self.before if one.errors]
        return sorted(there, key=lambda one: (one.kind == "dynamics", one.seconds))

    def trial(self, run: Baseline, changes: Changes, whole: bool = False) -> Trial:
        """A run with changed numbers; one that fails with its worker is a trial as well."""
        alike = [one for one in self.before if one.kind == run.kind and one.errors]
        stride = 1 if whole else self.strides[run.kind]
        asked = run.kind, with_changes, run.kind, run.solver, list(changes), alike, stride
        why = ""
        for longer in (1.0, LONGER):  # the run as it is keeps within its limit of time
            try:
                found: Trial = self.call(*asked, longer=longer)
            except TimedOut as error:
                why = str(error)
            except tuple(FAILURES) as error:
                return Trial(math.inf, failed=str(error))
            else:
                return found
        return Trial(math.inf, failed=why)

    def tried(self, group: Sequence[Number]) -> list[Finding]:
        """What the first run tells of a group of numbers of one kind."""
        run = self.runs()[0]
        alone = list(group)
        if group[0].kind in QUIET:
            alone = parted(group, lambda some: self.moves(run, some))
        found = self.one_by_one(run, alone, map)
        return [found.get(number) or not_noticed(number) for number in group]

    def asked(self, run: Baseline, known: Mapping[Number, Finding]) -> dict[Number, Finding]:
        """The findings after another run was asked for all numbers that nothing noticed."""
        pending = [number for number, one in known.items() if not one.noticed]
        alone = parted(pending, lambda some: self.moves(run, some), self.pool.map)
        return {**known, **self.one_by_one(run, alone, self.pool.map)}

    def moves(self, run: Baseline, group: Sequence[Number]) -> bool:
        """Whether a run notices a group that is changed as one, to these sides or to the others."""
        return any(self.trial(run, changes).ratio > 1 for changes in draws(group))

    def one_by_one(
        self, run: Baseline, group: Sequence[Number], each: Each
    ) -> dict[Number, Finding]:
        """Those of a group that are noticed alone."""
        found = each(lambda number: self.single(run, number), group)
        return {number: one for number, one in zip(group, found, strict=True) if one}

    def alone(self, run: Baseline, known: Mapping[Number, Finding]) -> dict[Number, Finding]:
        """The findings after a whole run was asked for each number alone that nothing noticed.

        Of what is not noticed either, it is stated what it moves most.
        """

        def farthest(number: Number) -> Finding:
            found = known[number]
            for side in sides_of(number):
                trial = self.trial(run, [(number, side * number.step)], whole=True)
                if trial.ratio > 1 and (one := self.single(run, number, whole=True)):
                    return one
                if not trial.moved <= found.moved and not math.isnan(trial.moved):
                    found = replace(found, run=run.kind, solver=run.solver)
                    found = replace(found, channel=trial.moves, moved=trial.moved)
            return found

        silent = [number for number, one in known.items() if not one.noticed]
        return {**known, **dict(zip(silent, self.pool.map(farthest, silent), strict=True))}

    def single(self, run: Baseline, number: Number, whole: bool = False) -> Finding | None:
        """What a run notices of a number; None if it does not notice the change that is tried."""
        small = SMALL * number.step
        trial = self.trial(run, [(number, small)], whole)
        if trial.failed:
            return self.smallest(run, number, DOWN * small, (small, trial), whole)
        if (estimate := self.nearest(run, number, small, trial)) and abs(estimate) < number.step:
            begin = math.copysign(min(2 * abs(estimate), number.step), estimate)
            if one := self.smallest(run, number, begin, None, whole):
                return one
        for change in (side * number.step for side in sides_of(number)):
            trial = self.trial(run, [(number, change)], whole)
            if trial.ratio > 1:
                begin = change * (DOWN if trial.failed else 0.5)
                return self.smallest(run, number, begin, (change, trial), whole)
        return None

    def nearest(self, run: Baseline, number: Number, change: float, trial: Trial) -> float:
        """The change that a run would notice by the rates of a trial; 0 if it tells none."""
        estimate = [
            side * limit.factor * change
            for side, limit in zip((1, -1), trial.limits[run.solver], strict=True)
            if limit.factor < math.inf and side * math.copysign(1, change) in sides_of(number)
        ]
        return min(estimate, key=abs, default=0.0)

    def smallest(
        self,
        run: Baseline,
        number: Number,
        begin: float,
        known: tuple[float, Trial] | None = None,
        whole: bool = False,
    ) -> Finding | None:
        """The smallest change that a run notices, from a guess; `known` is one that it notices."""
        least, change, failed, quiet = known, begin, 0, 0.0
        for _ in range(ROUNDS):
            trial = self.trial(run, [(number, change)], whole)
            if trial.ratio > 1 and (least is None or abs(change) < abs(least[0])):
                least = change, trial
            if trial.failed:
                change, failed = DOWN * change, failed + 1
                if failed == IN_TURN:
                    break
                continue
            same = trial.limits[run.solver][0]
            if trial.ratio > 1 and 1 / NEAR <= same.factor <= 1:
                return self.by_another(run, number, change, trial) or noticed(
                    number, same.factor * change, run, same.channel
                )
            estimate = self.nearest(run, number, change, trial)
            if not estimate or (least is None and abs(estimate) > number.step):
                break  # the rate that promised it was rounding
            following = math.copysign(min(2 * abs(estimate), number.step), estimate)
            if trial.ratio <= 1:
                quiet = max(quiet, abs(change))
            if least and quiet:  # the rates are wrong: it goes with a square, for one
                following = math.copysign(math.sqrt(quiet * abs(least[0])), least[0])
            change = following
        if least is None:
            return None
        change, trial = least
        return noticed(number, change, run, trial.channel, trial.failed)

    def by_another(
        self, run: Baseline, number: Number, change: float, trial: Trial
    ) -> Finding | None:
        """What another solver of the run notices, if the rates promise a smaller change there."""
        own = trial.limits[run.solver][0].factor
        others = [one for one in self.runs() if one.kind == run.kind and one is not run]
        for other in others:
            promised = trial.limits[other.solver][0].factor
            if promised < SOONER * own:
                again = self.trial(other, [(number, 2 * promised * change)])
                limit = again.limits[other.solver][0] if again.limits else None
                if again.ratio > 1 and limit and 1 / NEAR <= limit.factor <= 1:
                    return noticed(
                        number, limit.factor * 2 * promised * change, other, limit.channel
                    )
        return None

    def sooner(self, known: Mapping[Number, Finding]) -> dict[Number, Finding]:
        """The findings after other runs were asked for half of the changes that were found."""
        found = dict(known)
        for run in self.runs():
            for alike in (True, False):
                others = [
                    number
                    for number, one in found.items()
                    if one.noticed
                    and not one.refused
                    and (one.run, one.solver) != run.name
                    and (one.run == run.kind) == alike
                ]
                for number in self.noticed_sooner(run, others, found, alike):
                    one = found[number]
                    other = self.smallest(run, number, one.change, None, whole=True)
                    if other and abs(other.change) < abs(one.change):
                        found[number] = other
        return found

    def noticed_sooner(
        self,
        run: Baseline,
        group: Sequence[Number],
        found: Mapping[Number, Finding],
        alike: bool,
    ) -> list[Number]:
        """Those that a run notices at half of the change that is found so far.

        Of a run that is `alike`, of the same kind, rates have shown what it notices; it may still
        refuse a change of any size, so that in a group all of them are as small as to add up to
        less than is noticed.
        """

        def asks(some: Sequence[Number]) -> bool:
            share = 0.5 / len(some) if alike else 0.5
            changes = [(number, share * found[number].change) for number in some]
            return self.trial(run, changes).ratio > 1

        alone = parted(group, asks, self.pool.map)
        return [number for number in alone if asks([number])]

    def differing(self) -> Iterator[str]:
        """The channels that differ already, in words."""
        fine = (Outcome.AGREES, Outcome.UNCHECKED, Outcome.UNSUPPORTED)
        for c in (c for one in self.before for c in one.comparisons if c.outcome not in fine):
            yield f"{c.run} {c.solver} {c.channel}"

    def checked(self) -> Iterator[CheckedRun]:
        """How closely each solver of each run is checked."""
        there = {one.name: one for one in self.before}
        for kind, run in self.case.run.items():
            for solver in run.solvers:
                count, one = len(self.case.channels_of(kind)), there.get((kind, solver))
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
        """What is noticed of the parameters of the reference, by what comparisons tell already."""
        for name, value in changeable(self.case).items():
            blank = Finding("parameter", name, "", value, SHARE * abs(value), False)
            estimate = [
                (change.size * (abs(value) if change.relative else 1.0), c)
                for one in self.before
                for c in one.comparisons
                if c.outcome == Outcome.AGREES and (change := c.detectable.get(name))
            ]
            known = [(by, c) for by, c in estimate if not math.isnan(by)]
            if known:
                by, c = min(known, key=lambda pair: pair[0])
                found = replace(blank, noticed=True, change=by, run=c.run, solver=c.solver)
                yield replace(found, channel=c.channel)
            else:
                yield replace(
                    blank, noticed=bool(estimate), refused="not known" if estimate else ""
                )


def grouped(there: Sequence[Number]) -> dict[str, list[Number]]:
    """Numbers of a kind in groups of a few, by labels."""
    groups: dict[str, list[Number]] = {}
    for kind in dict.fromkeys(number.kind for number in there):
        own = [number for number in there if number.kind == kind]
        for k in range(0, len(own), CHUNK):
            groups[f"{kind} {k // CHUNK + 1}"] = own[k : k + CHUNK]
    return groups


def parted(
    group: Sequence[Some], asks: Callable[[Sequence[Some]], bool], each: Each = map
) -> list[Some]:
    """What is left to be asked alone, of a group that is halved where it is noticed.

    >>> parted("abcdefgh", lambda some: "c" in some)
    ['c', 'd']
    """
    level: list[Sequence[Some]] = [group] if group else []
    alone = list[Some]()
    while level:
        alone += [some[0] for some in level if len(some) == 1]
        several = [some for some in level if len(some) > 1]
        yes = each(asks, several)
        inside = [some for some, one in zip(several, yes, strict=True) if one]
        level = [
            half for some in inside for half in (some[: len(some) // 2], some[len(some) // 2 :])
        ]
    return alone


def goes_below(kind: str, value: float, step: float) -> bool:
    """Whether a number is made smaller as well as larger."""
    return kind not in POSITIVE or value >= step


def sides_of(number: Number) -> tuple[int, ...]:
    """To which sides a number is changed."""
    return (1, -1) if goes_below(number.kind, number.value, number.step) else (1,)


def draws(group: Sequence[Number]) -> Iterator[Changes]:
    """Random changes of a group, to both sides where there are two, and those to the other sides.

    None is less than what is tried alone.
    """
    chosen = random.Random(" ".join(number.name for number in group))
    sides = [chosen.choice((1, -1)) for _ in group]
    for turn in (1, -1):
        changes = []
        for number, side in zip(group, sides, strict=True):
            sign = turn * side if len(sides_of(number)) > 1 else 1
            changes.append((number, sign * chosen.uniform(1.0, MOST) * number.step))
        yield changes


def noticed(
    number: Number, change: float, run: Baseline, channel: str, failed: str = ""
) -> Finding:
    """The finding of a number that is noticed."""
    return replace(
        not_noticed(number),
        noticed=True,
        change=float(change),
        run=run.kind,
        solver=run.solver,
        channel=channel,
        refused=failed,
    )


def not_noticed(number: Number) -> Finding:
    """The finding of a number that is not noticed."""
    return Finding(number.kind, number.of, number.unit, number.value, number.step, noticed=False)
