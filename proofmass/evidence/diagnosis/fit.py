"""Fits of parameters of the reference, or of numbers of the model, to the curves of a run.

A parameter p is fitted by least squares of the differences of all checked channels, each as a
multiple of what its tolerance allows,

    minimise over p   sum over channels, samples of ((y - y_ref(p)) / allowed)^2

by Gauss-Newton steps, in which the slope of y_ref is a difference quotient at the last value of p.
A change of a model need not affect every channel as the same change of the reference does: for
example, a longer rocker may keep its centre of mass.  So there is a second fit, to those channels
alone whose single fits give the same value of p.

A search ends after a number of evaluations of the reference, or of steps of the engine, which no
clock changes: the same case has the same causes on a slow machine.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from proofmass.analytic.remember import Memory, use_memory
from proofmass.base.arrays import Array
from proofmass.base.errors import InputError
from proofmass.base.strict import Kind
from proofmass.case.case import Case
from proofmass.evidence.changed import model_source, numbers_of_case, with_changed_model
from proofmass.evidence.diagnosis.explanation import Edits, Explanation, rank_key
from proofmass.evidence.diagnosis.fault import Fault, model_fault, parameter_fault
from proofmass.reference.case_model import compiled_model
from proofmass.reference.evaluate import evaluate
from proofmass.reference.find import parameter_unit
from proofmass.reference.run_reference import changeable_parameters
from proofmass.run.solve import call_engine, plan_run, solve_here
from proofmass.sim.engines import computes_curves
from proofmass.sim.protocol.curves import Curves
from proofmass.sim.protocol.failures import BadModel
from proofmass.verdict.compare import allowed_errors
from proofmass.verdict.measured import noise_level, residuals_of
from proofmass.verdict.noise import FittedNumber, Residual
from proofmass.verdict.outcome import OUTCOME_OF_EXCEPTION

SLOPE_STEP = 1e-6  # relative change of a parameter for a slope, whose rounding is then 1e-10 of it
AGREEMENT_FACTOR = 2.0
"""A channel agrees up to this many times its tolerance, since engine and fit both have errors."""
CHANNEL_AGREEMENT_SHARE = 1e-3
"""A channel also agrees up to this share of its difference, since slopes are inexact."""
MAX_REMAINING_SHARE = 0.5
"""Largest such share of a channel that agrees, whose difference may be small already."""
EARLY_SHARES = (0.1, 0.4)  # shares of a run that are fitted by themselves before the whole run
SAME_CHANGE_SHARE = 0.1
"""Share of a channel's difference that remains after a change that it agrees with."""
MAX_FIT_STEPS = 12  # most steps of a fit; each but the first doubles the number of correct digits
CONVERGED_CHANGE = 1e-13  # relative change of a parameter at which a fit ends: it is rounding
RIVAL_SHARE = 0.1  # share left to first order, up to which a cause is fitted after one explains all
TINY_CHANGE = 1e-8  # relative change of a parameter up to which a step is not halved
MAX_FIT_HALVINGS = 6  # times that a step of a fit is halved until it fits better
MAX_MISFIT_RATIO = 0.999  # share of the misfit that a step may leave; a smaller gain is rounding
MAX_FITTED = 5
"""Parameters, or pairs of them, that are fitted: those that leave least to first order."""
FITTED_SWEEP_SAMPLES = (
    48  # samples of a sweep that suffice to fit a number; its end may be left out
)
UNFITTED_KINDS = ("inertia", "softness of the loop", "softness of the stop")
"""Kinds that are not fitted."""
RUN_EXCEPTIONS: tuple[type[Exception], ...] = (InputError, BadModel, *OUTCOME_OF_EXCEPTION)
ChannelCurves = dict[str, Array]
MODEL_KIND = "number of the model"  # a kind of cause
PARAMETER_KIND = "parameter"  # another one
ROUNDING_OF_ERROR = 0.1
"""Share of its standard error within which a fitted value is rounded to few digits."""
MAX_EVALUATIONS = 320
"""Evaluations of the reference after which no other fit begins: those of five parameters and five
pairs, and 20 for slopes and signs.  The slowest shipped reference takes 0.5 s for one."""
MAX_FIT_EVALUATIONS = 30
"""Evaluations, or runs, that one fit may take; one that succeeds takes about 12."""
STEPS_OF_A_POSE = {"dynamics": 1, "sweep": 20, "equilibrium": 100}
"""Steps of dynamics that take as long as a pose of a sweep, or of an equilibrium: measured in
MuJoCo, 10 us a step and degree of freedom, 0.2 ms a pose and 1 ms an equilibrium."""
MAX_RUN_STEPS = 60_000
"""Longest run that is made again with changes, in steps times degrees of freedom: 0.6 s."""
MAX_MODEL_STEPS = 800_000
"""Steps times degrees of freedom after which no other number of the model is fitted: 8 s."""


@dataclass
class SearchBudget:
    """What a search may cost, in a unit that is counted, and what each of its trials costs."""

    most: float
    cost: float = 1.0
    spent: float = 0.0

    def spend(self) -> None:
        """Count one trial."""
        self.spent += self.cost

    @property
    def lasts(self) -> bool:
        """Whether another trial may be made."""
        return self.spent + self.cost <= self.most

    @contextmanager
    def share(self, trials: int) -> Iterator[None]:
        """Let the budget end after some trials more, within the context."""
        whole = self.most
        self.most = min(whole, self.spent + trials * self.cost)
        try:
            yield
        finally:
            self.most = whole


@dataclass
class SearchLog:
    """What a search tried, and what it left out because its budget was spent."""

    tried: list[str] = field(default_factory=list)
    untried: list[str] = field(default_factory=list)

    def note(self, what: str, done: int, there: int) -> None:
        """Note how many of some changes were tried."""
        if done and done == there:
            self.tried.append(f"each {what}" if there > 1 else f"the {what}")
        elif done:
            self.tried.append(f"{done} of {there} {plural(what)}")
        if done < there:
            self.untried.append(f"{there - done} of {there} {plural(what)}")


def plural(what: str) -> str:
    """The plural of words that begin with a noun.

    >>> plural("parameter of the reference")
    'parameters of the reference'
    """
    noun, *rest = what.split(" ")
    return " ".join([f"{noun}s", *rest])


class Residuals:
    """The curves of a solver minus the reference, at the parameters of the case and at others.

    The differences are multiples of each channel's allowed error; channels without a tolerance, or
    with a curve that is not finite, are left out.
    """

    kind = PARAMETER_KIND

    def __init__(self, case: Case, run: Kind, solver: str, curves: Curves) -> None:
        self.case, self.curves, self.parameters = case, curves, changeable_parameters(case)
        self.budget, self.log = SearchBudget(MAX_EVALUATIONS), SearchLog()
        self.slopes = dict[str, ChannelCurves]()
        self.memory: Memory = {}
        self.run, self.solver = run, solver
        self.stride = max(curves.x.size // FITTED_SWEEP_SAMPLES, 1) if run == "sweep" else 1
        largest = max(map(abs, self.parameters.values()), default=0.0) or 1.0
        self.sizes = {key: abs(value) or largest for key, value in self.parameters.items()}
        with use_memory(self.memory, store_results=True):
            self.evaluated = evaluate(case, run, curves.x, curves.drive)
        reference = self.evaluated.channels
        residuals = residuals_of(case, run, solver, curves, self.evaluated)
        self.measured = {n: one for n, one in residuals.items() if isinstance(one, Residual)}
        self.allowed = {
            name: allowed
            for name, allowed in allowed_errors(case, run, solver, curves, reference).items()
            if allowed and np.isfinite(curves.channels[name]).all()
        }
        self.gaps = [
            f"the {whose} of {name} is no number at x = {curves.x[gaps[0]]:g}"
            for whose, found in (("curve", curves.channels), ("reference", reference))
            for name in case.channels_of(run)
            if name in curves.channels
            and case.tolerance_for(run, solver, name)
            and (gaps := np.flatnonzero(~np.isfinite(found[name]))).size
        ]
        self.curve = self.scaled(curves.channels)
        self.reference = self.scaled(reference)
        self.before = self.subtract(self.reference)
        self.differing = tuple(n for n, y in self.before.items() if not self.is_allowed(n, y))

    def is_allowed(self, name: str, differences: Array) -> bool:
        """Whether a channel with these differences is within its tolerance, or is noise."""
        if name not in self.measured:
            return bool(np.abs(differences).max() <= 1.0)
        residual = self.measured[name].with_values(differences * self.allowed[name])
        return residual.is_noise(noise_level(self.case, self.run, self.solver))

    def scaled(self, curves: Mapping[str, Array]) -> ChannelCurves:
        """The checked channels of curves in SI units, as multiples of the allowed errors."""
        return {name: curves[name] / allowed for name, allowed in self.allowed.items()}

    def subtract(self, reference: ChannelCurves) -> ChannelCurves:
        """The curves of the solver minus a reference; both as multiples of the allowed errors."""
        return {name: self.curve[name] - reference[name] for name in self.allowed}

    def at(self, changed: Mapping[str, float]) -> ChannelCurves:
        """The differences to the reference at other parameters; empty if that does not exist."""
        self.budget.spend()
        try:
            with use_memory(self.memory, store_results=False), np.errstate(all="ignore"):
                found = evaluate(
                    self.case, self.run, self.curves.x, self.curves.drive, **changed
                ).channels
        except InputError:  # the changed mechanism cannot be assembled everywhere
            return {}
        differences = self.subtract(self.scaled(found))
        return differences if np.isfinite(rms(differences)) else {}

    def value(self, key: str, share: float) -> float:
        """A parameter after a change by a share of it, or of the largest parameter if it is 0."""
        return self.parameters[key] + share * self.sizes[key]

    def fault(self, key: str, value: float, within: float = 0.0) -> Fault:
        """The fault of a parameter that should have a value, which is known to `within`."""
        unit = parameter_unit(self.case, key)
        return parameter_fault(self.case, key, unit, self.parameters[key], value, within)

    def edits(self, changed: Mapping[str, float]) -> Edits:
        """Changes of the model that a change of parameters is: none."""
        return ()

    def at_shares(self, shares: Mapping[str, float]) -> ChannelCurves:
        """The differences at parameters that are changed by shares; empty as for `at`."""
        if not any(shares.values()):
            return self.before
        return self.at({key: self.value(key, share) for key, share in shares.items()})

    def agrees(self, name: str, after: Array) -> bool:
        """Whether a channel with these differences agrees, or has lost nearly all of its own.

        The differences of a measured channel must be noise.
        """
        if name in self.measured:
            return self.is_allowed(name, after)
        most = float(np.abs(after).max())
        was = float(np.abs(self.before[name]).max())
        if name not in self.differing:
            return most <= AGREEMENT_FACTOR
        return most <= max(
            min(AGREEMENT_FACTOR, MAX_REMAINING_SHARE * was), CHANNEL_AGREEMENT_SHARE * was
        )

    def agreeing(self, after: ChannelCurves) -> ChannelCurves:
        """The differences of the channels that agree, of those that are given."""
        return {name: y for name, y in after.items() if self.agrees(name, y)}

    def with_changed_case(self, case: Case) -> ChannelCurves:
        """The differences of the run of a changed case, with other settings or rods.

        Raises
        ------
        One of `RUN_EXCEPTIONS`
        """
        curves = solve_here(case, self.run, self.solver)
        found = Residuals(self.case, self.run, self.solver, curves).before
        return {name: y for name, y in found.items() if name in self.allowed}

    @property
    def steps(self) -> float:
        """The size of the run, in steps times degrees of freedom, see `run_steps`."""
        return run_steps(self.case, self.run, self.curves.steps)

    @property
    def can_run_again(self) -> bool:
        """Whether an engine computed the curves in a run so short that it may be made again."""
        return computes_curves(self.solver) and self.steps <= MAX_RUN_STEPS

    def judged(
        self,
        kind: str,
        words: str,
        after: ChannelCurves,
        free: int = 0,
        changes: Mapping[str, tuple[float, float]] | None = None,
        faults: Sequence[Fault] = (),
        edits: Edits = (),
    ) -> Explanation:
        """The explanation with these differences after the change.

        Channels that are not in `after` keep their differences.
        """
        agree = {n for n, y in after.items() if self.agrees(n, y)}
        explains = tuple(n for n in self.differing if n in agree)
        return Explanation(
            kind,
            words,
            explains,
            tuple(n for n in after if n not in agree and n not in self.differing),
            remaining_share(self.before, after, explains),
            len(self.differing),
            free,
            changes or {},
            faults=tuple(faults),
            edits=edits,
            ratio=max((float(np.abs(after[n]).max()) for n in explains), default=math.nan),
        )


def fitted_fault(residuals: Residuals, key: str, value: float, slope: ChannelCurves) -> Fault:
    """The fault of a fitted value, with its standard error if all curves have noise."""
    if not residuals.measured.keys() >= slope.keys():
        return residuals.fault(key, value, residuals.sizes[key] / largest(slope))
    free = [
        slope[name] * residuals.allowed[name] / residuals.measured[name].sigma for name in slope
    ]
    error = residuals.sizes[key] / float(np.linalg.norm(np.concatenate(free)))
    return measured_fault(residuals, key, FittedNumber(value, error))


def measured_fault(residuals: Residuals, key: str, fitted: FittedNumber) -> Fault:
    """The fault of a parameter or a number that is fitted to curves with noise."""
    fault = residuals.fault(key, fitted.value, ROUNDING_OF_ERROR * fitted.error)
    return replace(fault, error=fault.within / ROUNDING_OF_ERROR)


def run_steps(case: Case, run: Kind, steps: float) -> float:
    """The size of a run in steps of dynamics times degrees of freedom, of about 10 us each."""
    return max(steps, 1) * STEPS_OF_A_POSE[run] * max(compiled_model(case).nv, 1)


class ModelResiduals(Residuals):
    """The curves of a solver at other numbers of the model, minus the reference.

    The engine runs again for each change, a sweep with some of its samples only.  A reference that
    reads the model changes with it, so in this case only the channels that must equal a number are
    used.
    """

    kind = MODEL_KIND

    def __init__(self, case: Case, run: Kind, solver: str, curves: Curves) -> None:
        super().__init__(case, run, solver, curves)
        if case.reads_model:
            self.allowed = {
                n: most for n, most in self.allowed.items() if n in case.constant_channels
            }
            self.differing = tuple(n for n in self.differing if n in case.constant_channels)
        for known in (self.curve, self.reference, self.before):
            kept = {name: known[name][:: self.stride] for name in self.allowed}
            known.clear()
            known.update(kept)
        self.numbers = {n.name: n for n in numbers_of_case(case) if n.kind not in UNFITTED_KINDS}
        self.parameters = {name: number.value for name, number in self.numbers.items()}
        self.sizes = {n: abs(one.value) or 10.0 * one.step for n, one in self.numbers.items()}
        self.budget = SearchBudget(MAX_MODEL_STEPS, self.steps / self.stride)

    def at(self, changed: Mapping[str, float]) -> ChannelCurves:
        """The differences of the engine's curves with other numbers; empty if the run fails."""
        changes = self.edits(changed)
        self.budget.spend()
        try:
            with TemporaryDirectory() as folder:
                other = with_changed_model(self.case, changes, Path(folder))
                asked = plan_run(other, self.run, self.solver)
                asked = replace(asked, x=asked.x[:: self.stride])
                curves = call_engine(self.solver, other.model_path, asked)
        except RUN_EXCEPTIONS:
            return {}
        if curves.x.size != asked.x.size or not self.allowed.keys() <= curves.channels.keys():
            return {}
        mine = self.scaled(curves.channels)
        differences = {name: mine[name] - self.reference[name] for name in self.allowed}
        return differences if np.isfinite(rms(differences)) else {}

    def edits(self, changed: Mapping[str, float]) -> Edits:
        """Changes of the model that give its numbers other values."""
        return tuple((self.numbers[key], v - self.parameters[key]) for key, v in changed.items())

    def repeats(self) -> bool:
        """Whether a run of the unchanged model gives the given curves again.

        Otherwise the curves belong to another model, and numbers cannot be fitted to them.
        """
        again = self.at({})
        apart = {name: y - self.before[name] for name, y in again.items()}
        return bool(apart) and rms(apart) <= CHANNEL_AGREEMENT_SHARE * rms(self.before)

    def fault(self, key: str, value: float, within: float = 0.0) -> Fault:
        """The fault of a number that should have a value, which is known to `within`."""
        return model_fault(self.case, model_source(self.case), self.numbers[key], value, within)


def rms(
    differences: ChannelCurves, names: Sequence[str] | None = None, end: int | None = None
) -> float:
    """Root mean square of the differences of all channels or of some, up to a sample."""
    parts = [differences[name][:end] for name in (differences if names is None else names)]
    return float(np.sqrt(np.mean(np.concatenate(parts) ** 2)))


def remaining_share(before: ChannelCurves, after: ChannelCurves, explains: Sequence[str]) -> float:
    """The root mean square of differences after a change over that before.

    It is that of the channels that are explained, or of all channels if none is.
    """
    names = [n for n in (explains or before) if n in after]
    return rms({**before, **after}, names or None) / rms(before, names or None)


def slopes_of(residuals: Residuals, what: str) -> dict[str, ChannelCurves]:
    """Slopes by all parameters that any channel depends on; `what` is the word for one of them."""
    slopes, done = dict[str, ChannelCurves](), 0
    for key in residuals.parameters:
        if not residuals.budget.lasts:
            break
        done += 1
        if slope := parameter_slope(residuals, {}, key):
            slopes[key] = slope
    residuals.log.note(what, done, len(residuals.parameters))
    return slopes


def fitted_causes(
    residuals: Residuals,
    slopes: Mapping[str, ChannelCurves],
    what: str,
    choices: Iterable[tuple[str, ...]],
) -> Iterator[Explanation]:
    """Causes by other values of each choice of parameters.

    All are first estimated to first order by slopes.  Those with the best estimates are then
    fitted, unless the budget is spent; the others are given as estimated.
    """
    first = sorted(
        (estimate_cause(residuals, keys, slopes) for keys in choices), key=lambda c: c.left
    )
    complete, unfitted = False, 0
    for cause in first[:MAX_FITTED]:
        if not complete or cause.left < RIVAL_SHARE:
            if residuals.budget.lasts:
                with residuals.budget.share(MAX_FIT_EVALUATIONS):
                    cause = fit_cause(residuals, tuple(cause.changes), slopes)
            else:
                unfitted += 1
        complete = complete or cause.complete
        yield cause
    yield from first[MAX_FITTED:]
    if unfitted:
        many = plural(what) if unfitted > 1 else what
        residuals.log.untried.append(f"the fit of {unfitted} {many}")


def parameter_slope(residuals: Residuals, shares: Mapping[str, float], key: str) -> ChannelCurves:
    """The derivative of the reference by the share of a parameter, at changed parameters."""
    start = {name: residuals.value(name, share) for name, share in shares.items()}
    before = residuals.at(start) if any(shares.values()) else residuals.before
    for step in (SLOPE_STEP, -SLOPE_STEP):
        moved = residuals.at({**start, key: residuals.value(key, shares.get(key, 0.0) + step)})
        if before and moved:
            slope = {name: (before[name] - moved[name]) / step for name in residuals.allowed}
            if max(np.abs(y).max() for y in slope.values()) > 0:
                return slope
    return {}


def solve_least_squares(
    differences: ChannelCurves,
    slopes: Mapping[str, ChannelCurves],
    names: Sequence[str],
    end: int | None = None,
) -> Array:
    """The least-squares changes of some channels' differences, up to a sample, by slopes."""
    matrix = np.stack(
        [np.concatenate([slope[n][:end] for n in names]) for slope in slopes.values()], axis=1
    )
    y = np.concatenate([differences[name][:end] for name in names])
    return np.asarray(np.linalg.lstsq(matrix, y, rcond=None)[0])


def estimate_cause(
    residuals: Residuals, keys: tuple[str, ...], slopes: Mapping[str, ChannelCurves]
) -> Explanation:
    """The cause by other values of some parameters, estimated by slopes at their first values."""
    own_slopes = {key: slopes[key] for key in keys}
    causes = []
    for names in {
        tuple(residuals.allowed),
        agreeing_channels(residuals, residuals.before, own_slopes),
    } - {()}:
        step = solve_least_squares(residuals.before, own_slopes, names)
        after = {
            n: residuals.before[n]
            - sum(d * own_slopes[k][n] for k, d in zip(keys, step, strict=True))
            for n in residuals.allowed
        }
        shares = {k: float(d) for k, d in zip(keys, step, strict=True)}
        cause = parameter_cause(residuals, shares, after, own_slopes)
        causes.append(replace(cause, estimated=True))
    return min(causes, key=lambda cause: cause.left)


def fit_cause(
    residuals: Residuals,
    keys: tuple[str, ...],
    slopes: Mapping[str, ChannelCurves],
) -> Explanation:
    """The best fit of some parameters.

    It is fitted to all channels; to those that ask for the same change; and to the first samples
    before all of them, since the mechanism may follow another branch later.
    """
    all_channels, start = tuple(residuals.allowed), dict.fromkeys(keys, 0.0)
    own_slopes = {key: slopes[key] for key in keys}
    causes, found = list[Explanation](), start

    def attempt(shares: dict[str, float], names: tuple[str, ...], end: int | None = None) -> None:
        nonlocal found
        found = fit_shares(residuals, shares, names, end)
        if after := residuals.at({k: residuals.value(k, s) for k, s in found.items()}):
            causes.append(parameter_cause(residuals, found, after, own_slopes))

    def done() -> bool:
        complete = any(cause.score == len(residuals.differing) for cause in causes)
        return complete or not residuals.budget.lasts

    attempt(start, all_channels)
    for shares, differences in ((start, residuals.before), (found, residuals.at_shares(found))):
        if not done() and (
            here := {k: s for k in keys if (s := parameter_slope(residuals, shares, k))}
        ):
            names = agreeing_channels(residuals, differences, here)
            if names and names != all_channels:
                attempt(dict(shares), names)
    for share in EARLY_SHARES:
        if not done():
            attempt(start, all_channels, int(share * len(residuals.curves.x)))
            attempt(found, all_channels)
    return min(causes, key=rank_key) if causes else estimate_cause(residuals, keys, own_slopes)


def fit_shares(
    residuals: Residuals,
    shares: dict[str, float],
    names: tuple[str, ...],
    end: int | None = None,
) -> dict[str, float]:
    """Fit the changes, as shares of parameters, to some channels by the Gauss-Newton method."""
    after = residuals.at_shares(shares)
    for _ in range(MAX_FIT_STEPS):
        slopes = {k: parameter_slope(residuals, shares, k) for k in shares}
        if not all(slopes.values()) or not residuals.budget.lasts:
            break
        step = solve_least_squares(after, slopes, names, end)
        for _ in range(MAX_FIT_HALVINGS if np.abs(step).max() > TINY_CHANGE else 1):
            moved = {k: s + float(d) for (k, s), d in zip(shares.items(), step, strict=True)}
            new = residuals.at_shares(moved)
            if new and rms(new, names, end) < MAX_MISFIT_RATIO * rms(after, names, end):
                break
            step = 0.5 * step
        else:
            break
        shares, after = moved, new
        if np.abs(step).max() <= CONVERGED_CHANGE:
            break
    return shares


def agreeing_channels(
    residuals: Residuals, differences: ChannelCurves, slopes: Mapping[str, ChannelCurves]
) -> tuple[str, ...]:
    """The largest group of channels whose fits give the same change of one parameter.

    Empty if there are several parameters.
    """
    best: tuple[str, ...] = ()
    if len(slopes) > 1:
        return best
    (slope,) = slopes.values()
    for name in residuals.differing:
        if not (square := float(slope[name] @ slope[name])):
            continue
        change = float(differences[name] @ slope[name]) / square
        names = tuple(
            other
            for other in residuals.differing
            if np.linalg.norm(differences[other] - change * slope[other])
            <= SAME_CHANGE_SHARE * np.linalg.norm(residuals.before[other])
        )
        best = max(best, names, key=len)
    return best


def parameter_cause(
    residuals: Residuals,
    shares: Mapping[str, float],
    after: ChannelCurves,
    slopes: Mapping[str, ChannelCurves],
) -> Explanation:
    """The cause by other values of some parameters, with the differences that it leaves."""
    values = {key: residuals.value(key, share) for key, share in shares.items()}
    changes = {key: (residuals.parameters[key], value) for key, value in values.items()}
    faults = [fitted_fault(residuals, key, value, slopes[key]) for key, value in values.items()]
    words = []
    for fault, (old, new) in zip(faults, changes.values(), strict=True):
        share = f" ({100 * (new / old - 1):+.4g} %)" if old else ""
        words.append(f"{fault.change}{share}")
    kind, free = (residuals.kind, 1) if len(changes) == 1 else (f"pair of {residuals.kind}s", 3)
    text = " and ".join(words)
    edits = residuals.edits(values)
    return residuals.judged(kind, text, after, free, changes, faults, edits)


def largest(curves: ChannelCurves) -> float:
    """The largest absolute value of some curves."""
    return max(float(np.abs(y).max()) for y in curves.values())
