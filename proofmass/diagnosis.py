"""Why a run differs: changes of the case that would explain it, best first.

Each hypothesis is one change of the case: another value of a parameter of the reference, or of two
parameters; another assembly mode; a sign, a unit, an offset or another quantity of channels; a
shift along x.  It is fitted to the curves of the solver.  It explains the channels that differ
without the change and agree with it; channels that agree without the change and differ with it
count against it.

A parameter p is fitted by least squares of the differences of all checked channels, each as a
multiple of what its tolerance allows,

    minimise over p   sum over channels, samples of ((y - y_ref(p)) / allowed)^2

by Gauss-Newton steps, in which the slope of y_ref is a difference quotient at the last value of p.
A change of a model need not affect every channel as the same change of the reference does: for
example, a longer rocker may keep its centre of mass.  So there is a second fit, to those channels
alone whose single fits give the same value of p.
"""

import inspect
import re
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, cast

import numpy as np

from proofmass.analytic.numerics import Array
from proofmass.analytic.remember import Memory, use_memory
from proofmass.case import Case
from proofmass.changed import numbers_of_case, with_changed_model
from proofmass.compare import allowed_errors, changeable_parameters
from proofmass.engines import computes_curves, engine_of
from proofmass.errors import InputError
from proofmass.files import read_text
from proofmass.outcome import OUTCOME_OF_EXCEPTION
from proofmass.recording import Recorded
from proofmass.reference import (
    all_quantities,
    assembly_modes,
    compiled_model,
    evaluate,
    load_reference,
    parameter_unit,
    reference_reads_model,
)
from proofmass.sim.contents import highest_frequency
from proofmass.sim.protocol import STEP_CAUSE, BadModel, Curves, ParameterValues, Perturbation
from proofmass.sim.stability import stability_limit
from proofmass.solve import call_engine, describe_dynamics, plan_run, settings_of, solve_here
from proofmass.strict import Kind
from proofmass.wording import format_list, format_unit, number

SLOPE_STEP = 1e-6  # relative change of a parameter for a slope, whose rounding is then 1e-10 of it
AGREEMENT_FACTOR = 2.0
"""A channel agrees up to this many times its tolerance, since engine and fit both have errors."""
AGREEMENT_SHARE = 1e-3
"""A channel also agrees up to this share of its difference, since slopes are inexact."""
MAX_REMAINING_SHARE = 0.5
"""Largest such share of a channel that agrees, whose difference may be small already."""
HANDICAPS = {0: 0.0, 1: 0.01, 2: 0.1, 3: 0.25}
"""Handicap of a cause in the ranking, as a share of the channels that differ, by how freely it was
chosen, see `Explanation.free`."""
EARLY_SHARES = (0.1, 0.4)  # shares of a run that are fitted by themselves before the whole run
SAME_CHANGE_SHARE = 0.1
"""Share of a channel's difference that remains after a change that it agrees with."""
MAX_ITERATIONS = 12  # most steps of a fit; each but the first doubles the number of correct digits
CONVERGED_CHANGE = 1e-13  # relative change of a parameter at which a fit ends: it is rounding
RIVAL_SHARE = 0.1  # share left to first order, up to which a cause is fitted after one explains all
TINY_CHANGE = 1e-8  # relative change of a parameter up to which a step is not halved
MAX_HALVINGS = 6
"""Number of times that a step of a fit is halved until it fits better, and that a time step is."""
MAX_MISFIT_RATIO = 0.999  # share of the misfit that a step may leave; a smaller gain is rounding
MAX_FITTED_PAIRS = 4  # pairs of parameters that are fitted: those that leave least to first order
MAX_CAUSES = 5  # causes that are kept
EXACT_SHARE = 1e-6  # share of the differences that a cause may leave to be called exact
FIT_SECONDS = 6.0
"""Processor time [s] after which no other fit begins; a slow reference takes 0.5 s."""
MODEL_KIND = "number of the model"  # a kind of cause
SWEEP_SAMPLES = 48  # samples of a sweep that suffice to fit a number; its end may be left out
MODEL_FIT_SECONDS = 6.0  # as SECONDS, for numbers of the model, with which the engine runs again
UNFITTED_KINDS = ("inertia", "softness of the loop", "softness of the stop")
"""Kinds that are not fitted."""
KNOWN_FACTORS = {
    "with the opposite sign": (-1.0, ""),
    "in degrees, not in radians": (180 / np.pi, "rad"),
    "in radians, not in degrees": (np.pi / 180, "rad"),
    "in thousandths of its unit": (1e3, "m kg N J"),
    "in thousands of its unit": (1e-3, "m kg N J"),
    "in inches, not in metres": (1 / 0.0254, "m"),
    "twice as large": (2.0, ""),
    "half as large": (0.5, ""),
}
"""Factors on a curve that are tried, by their descriptions, and the units that each is tried for,
by their first words; the empty text means all units."""
ANGLE_OFFSETS = {"a whole turn": 2 * np.pi, "half a turn": np.pi, "a quarter turn": np.pi / 2}
"""Offsets of an angle that have a name [rad]."""
SAMPLE_SHIFTS = {"one sample": 1, "two samples": 2}
"""Shifts of a curve that have a name, in samples."""
MAX_REPEATED_SECONDS = 0.3  # [s] longest wall time of a run that is made again with changes
FALLING_SHARE = 0.6
"""Share of a difference that half a time step leaves if the error is of order 3/4."""
MAX_ORDER = 6  # highest order of an integrator
WORSE_RATIO = 1.1  # factor on the difference above which a change is said to make it larger
NUMBER_TOLERANCE = 1e-5  # relative difference up to which a number of the model is the fitted one
MAX_NAMED_LINES = 4  # most lines of the model that are named
NUMBER_PATTERN = re.compile(r"(?<![\w.])[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?(?![\w.])")
RUN_EXCEPTIONS: tuple[type[Exception], ...] = (InputError, BadModel, *OUTCOME_OF_EXCEPTION)
ChannelCurves = dict[str, Array]


@dataclass(frozen=True)
class Explanation:
    """A change of the case that would explain the differences of a run.

    Attributes
    ----------
    kind : str
        parameter, pair of parameters, assembly mode, factor, offset, quantity, shift, number of the
        model, or finer: a shorter time step, shorter segments, or another setting with which the
        engine should have a smaller error.
    words : str
        Description of the change, with numbers and units.
    explains, breaks : tuple of str
        Channels that differ and agree with the change, and channels that agree and differ with it.
    left : float
        Root mean square of the differences after the change, over that before [1], of the channels
        that it explains, or of all if it explains none; each channel in units of what is allowed.
    differing : int
        How many channels differ.
    free : int
        How freely the change was chosen, see `HANDICAPS`: 0 without a fitted number, such as a
        sign; 1 one fitted parameter; 2 a fitted factor, offset or shift, which any channel may
        have; 3 two fitted parameters.
    changes : mapping of str to tuple of float
        For each fitted parameter its value in the sidecar, and the fitted value [SI].
    same : tuple of str
        Descriptions of other changes that fit the curves equally well.
    """

    kind: str
    words: str
    explains: tuple[str, ...]
    breaks: tuple[str, ...]
    left: float
    differing: int
    free: int = 0
    changes: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    same: tuple[str, ...] = ()

    @property
    def fitted(self) -> int:
        """The number of fitted values."""
        return len(self.changes) or int(self.free > 0)

    @property
    def score(self) -> int:
        """Number of channels that it explains, less that of channels that it breaks."""
        return len(self.explains) - len(self.breaks)

    @property
    def share(self) -> float:
        """The score as a share of the channels that differ."""
        return self.score / self.differing


@dataclass(frozen=True)
class Diagnosis:
    """The causes that would explain why the run of a solver differs from its reference.

    Attributes
    ----------
    case, run, solver : str
        Names of the case, the run and the solver.
    differing : tuple of str
        Its channels that differ.
    checked : int
        Number of its channels that have a tolerance and a finite curve.
    causes : tuple of Explanation
        The causes, best first.
    tried : tuple of str
        Descriptions of the changes that were tried.
    remarks : tuple of str
        Further findings: lines of the model that have the value of the best cause, and the effect
        of a shorter time step or shorter segments.
    seconds : float
        Wall time of the search [s].
    fault : str
        The reason why causes could not be searched for; empty if they were.
    failed : bool
        Whether the run failed; then there are only remarks.
    """

    case: str
    run: str
    solver: str
    differing: tuple[str, ...] = ()
    checked: int = 0
    causes: tuple[Explanation, ...] = ()
    tried: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()
    seconds: float = 0.0
    fault: str = ""
    failed: bool = False

    @property
    def found(self) -> bool:
        """Whether there is a cause that explains more channels than it breaks."""
        return bool(self.causes) and self.causes[0].score > 0

    @property
    def lines(self) -> list[str]:
        """Lines of text: the best cause, what it explains, the next best cause, and remarks."""
        if self.fault:
            return [f"causes were not searched for: {self.fault}"]
        if self.failed:
            return list(self.remarks) or ["no reason was found"]
        if not self.found:
            return [f"none of those tried: {', '.join(self.tried)}", *self.remarks]
        best, *others = self.causes
        rest = [name for name in self.differing if name not in best.explains]
        does = "puts {} right" if best.kind != "finer" else "reduces the error of {}"
        right = (
            f"{does.format(self.count_explained(best))}, {number(best.left, 2)} of the error left"
        )
        found = [best.words, right + f"; not {format_list(rest)}" * bool(rest)]
        found += [f"as good: {format_list(best.same)}"] * bool(best.same)
        if others:
            right = f"{self.count_explained(others[0])} right, " if others[0].score > 0 else ""
            left = number(others[0].left, 2)
            found.append(f"next best: {others[0].words} ({right}{left} left)")
        return [*found, *self.remarks]

    @property
    def text(self) -> str:
        """All lines, after the word "cause" or "failed"."""
        head = "failed" if self.failed else "cause"
        return f"{head}: " + f"\n{' ' * 9}".join(self.lines)

    def count_explained(self, cause: Explanation) -> str:
        """A phrase on how many of the channels that differ a cause explains."""
        many, there = len(cause.explains), len(self.differing)
        if many < there:
            return f"{many} of {there} channels"
        return f"all {there} channels" if there > 1 else "the channel"


class Residuals:
    """The curves of a solver minus the reference, at the parameters of the case and at others.

    The differences are multiples of each channel's allowed error; channels without a tolerance, or
    with a curve that is not finite, are left out.
    """

    def __init__(self, case: Case, run: Kind, solver: str, curves: Curves) -> None:
        self.case, self.curves, self.parameters = case, curves, changeable_parameters(case)
        self.memory: Memory = {}
        self.run, self.solver = run, solver
        self.stride = max(curves.x.size // SWEEP_SAMPLES, 1) if run == "sweep" else 1
        largest = max(map(abs, self.parameters.values()), default=0.0) or 1.0
        self.sizes = {key: abs(value) or largest for key, value in self.parameters.items()}
        begin = time.process_time()
        with use_memory(self.memory, store_results=True):
            reference = evaluate(case, run, curves.x, curves.drive).channels
        self.seconds = time.process_time() - begin
        self.allowed = {
            name: allowed
            for name, allowed in allowed_errors(case, run, solver, curves, reference).items()
            if allowed and np.isfinite(curves.channels[name]).all()
        }
        self.curve = self.scaled(curves.channels)
        self.reference = self.scaled(reference)
        self.before = self.subtract(self.reference)
        self.differing = tuple(n for n, y in self.before.items() if np.abs(y).max() > 1.0)

    def scaled(self, curves: Mapping[str, Array]) -> ChannelCurves:
        """The checked channels of curves in SI units, as multiples of the allowed errors."""
        return {name: curves[name] / allowed for name, allowed in self.allowed.items()}

    def subtract(self, reference: ChannelCurves) -> ChannelCurves:
        """The curves of the solver minus a reference; both as multiples of the allowed errors."""
        return {name: self.curve[name] - reference[name] for name in self.allowed}

    def at(self, changed: Mapping[str, float]) -> ChannelCurves:
        """The differences to the reference at other parameters; empty if that does not exist."""
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

    def unit(self, key: str) -> str:
        """The unit of a parameter."""
        return parameter_unit(self.case, key)

    def at_shares(self, shares: Mapping[str, float]) -> ChannelCurves:
        """The differences at parameters that are changed by shares; empty as for `at`."""
        if not any(shares.values()):
            return self.before
        return self.at({key: self.value(key, share) for key, share in shares.items()})

    def agrees(self, name: str, after: Array) -> bool:
        """Whether a channel with these differences agrees, or has lost nearly all of its own."""
        most = float(np.abs(after).max())
        was = float(np.abs(self.before[name]).max())
        if name not in self.differing:
            return most <= AGREEMENT_FACTOR
        return most <= max(min(AGREEMENT_FACTOR, MAX_REMAINING_SHARE * was), AGREEMENT_SHARE * was)

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
    def can_run_again(self) -> bool:
        """Whether an engine computed the curves in a time so short that it may run again."""
        return self.curves.seconds <= MAX_REPEATED_SECONDS and computes_curves(self.solver)

    def time_for_another(self, deadline: float) -> bool:
        """Whether the reference can be evaluated at other parameters before a deadline."""
        return time.process_time() + self.seconds < deadline

    def judged(
        self,
        kind: str,
        words: str,
        after: ChannelCurves,
        free: int = 0,
        changes: Mapping[str, tuple[float, float]] | None = None,
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
        )


class ModelResiduals(Residuals):
    """The curves of a solver at other numbers of the model, minus the reference.

    The engine runs again for each change, a sweep with some of its samples only.  A reference that
    reads the model changes with it, so in this case only the channels that must equal a number are
    used.
    """

    def __init__(self, case: Case, run: Kind, solver: str, curves: Curves) -> None:
        super().__init__(case, run, solver, curves)
        if reference_reads_model(case):
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
        self.seconds += curves.seconds / self.stride

    def at(self, changed: Mapping[str, float]) -> ChannelCurves:
        """The differences of the engine's curves with other numbers; empty if the run fails."""
        changes = [(self.numbers[key], v - self.parameters[key]) for key, v in changed.items()]
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

    def repeats(self) -> bool:
        """Whether a run of the unchanged model gives the given curves again.

        Otherwise the curves belong to another model, and numbers cannot be fitted to them.
        """
        again = self.at({})
        apart = {name: y - self.before[name] for name, y in again.items()}
        return bool(apart) and rms(apart) <= AGREEMENT_SHARE * rms(self.before)

    def unit(self, key: str) -> str:
        """The unit of a number."""
        return self.numbers[key].unit


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


def find_causes(
    case: Case, run: Kind, solver: str, curves: Curves, thorough: bool = True
) -> Diagnosis:
    """Search for changes of a case that would explain why a run differs from its reference.

    Parameters
    ----------
    case : Case
    run, solver : str
        The run and the solver of the curves.
    curves : Curves
        The curves, from `proofmass.solve.solve`.
    thorough : bool
        Whether runs of the engine with other numbers of the model are part of the search.

    Returns
    -------
    Diagnosis
        Without causes if no checked channel differs.

    Raises
    ------
    InputError
        The reference cannot be evaluated at the parameters of the case.

    Examples
    --------
    >>> from proofmass import load_case, solve
    >>> case = load_case("models/linkages/fourbar.toml")
    >>> curves = solve(case, "sweep", "mujoco")
    >>> wrong = case.model_copy(update={"parameters": {**case.parameters, "rocker": 2.4}})
    >>> find_causes(wrong, "sweep", "mujoco", curves).causes[0].words
    'rocker = 2.5 m instead of 2.4 m (+4.167 %)'
    """
    begin = time.perf_counter()
    residuals = Residuals(case, run, solver, curves)
    found, remarks = list[Explanation](), list[str]()
    settings = setting_changes(residuals)
    if residuals.differing:
        found += [
            *factor_causes(residuals),
            *offset_causes(residuals),
            *quantity_causes(residuals),
            *shift_causes(residuals),
            *mode_causes(residuals),
            *parameter_causes(residuals, time.process_time() + FIT_SECONDS),
        ]
        if thorough and computes_curves(solver):
            best = max((c.score for c in found if c.free <= 1), default=0)
            found += model_causes(residuals, best)
        shorter = [*finer_causes(residuals)]
        found += [cause for cause, _ in shorter if cause]
        found += setting_causes(residuals, settings)
        remarks = [words for _, words in shorter if words]
    causes = best_causes(found)
    remarks += locate_values(case, causes[0]) if causes else []
    return Diagnosis(
        case.name,
        run,
        solver,
        residuals.differing,
        len(residuals.allowed),
        causes,
        describe_tried(residuals, thorough, settings),
        tuple(remarks),
        time.perf_counter() - begin,
    )


def describe_tried(
    residuals: Residuals, thorough: bool, settings: Iterable[Perturbation]
) -> tuple[str, ...]:
    """Descriptions of the changes that are tried with a case."""
    words = ["sign, unit, factor and offset of each channel", "shifts along x"]
    words += ["other quantities of the reference"]
    if len(assembly_modes(residuals.case)) > 1:
        words.append("other assembly modes")
    if residuals.parameters:
        words.append("each parameter, and pairs of them")
    if (
        thorough
        and computes_curves(residuals.solver)
        and residuals.curves.seconds <= MAX_REPEATED_SECONDS * residuals.stride
    ):
        words.append(f"numbers of the model in {MODEL_FIT_SECONDS:g} s of processor time")
    words += [one.change for one in settings]
    return tuple(words)


def rank_key(cause: Explanation) -> tuple[float, float]:
    """The key by which causes are ranked, smallest first.

    The first number is the handicap of `HANDICAPS` less the share of channels that the cause
    explains, or 0 if it explains none; the second is the share of the differences that it leaves.
    """
    return HANDICAPS[cause.free] - cause.share if cause.score > 0 else 0.0, cause.left


def sort_key(cause: Explanation) -> tuple[float, ...]:
    """The key of `rank_key`, with exact causes sorted by digits of their values, then by change.

    The share that an exact cause leaves is only rounding.  A value with few digits is more likely,
    since people write round numbers.
    """
    first, left = rank_key(cause)
    changes = cause.changes.values()
    digits = sum(len(f"{new:.5e}".lstrip("-").partition("e")[0].rstrip("0")) for _, new in changes)
    return (
        first,
        max(left, EXACT_SHARE),
        digits,
        sum(abs(new / old - 1) for old, new in changes if old),
    )


def best_causes(causes: Sequence[Explanation]) -> tuple[Explanation, ...]:
    """The best causes; those that fit the curves equally well are joined into one.

    Causes that leave all of the differences are dropped.
    """
    kept = list[Explanation]()
    for cause in sorted(causes, key=sort_key):
        equal = [
            k
            for k, other in enumerate(kept)
            if other.explains == cause.explains != ()
            and cause.free <= 2
            and max(other.left, cause.left) <= max(EXACT_SHARE, 1.01 * min(other.left, cause.left))
        ]
        if equal:
            first = kept[equal[0]]
            kept[equal[0]] = replace(first, same=(*first.same, cause.words))
        elif cause.score > 0 or cause.left < MAX_MISFIT_RATIO:
            kept.append(cause)
    return tuple(kept[:MAX_CAUSES])


def factor_causes(residuals: Residuals) -> Iterator[Explanation]:
    """Causes in which channels are a multiple of the reference: by sign, unit, or any factor."""
    units = {name: residuals.case.channels[name].si_unit for name in residuals.differing}
    moving = [name for name in residuals.differing if np.ptp(residuals.reference[name]) > 0]
    for words, (factor, unit_words) in KNOWN_FACTORS.items():
        divided = {
            name: residuals.curve[name] / factor - residuals.reference[name]
            for name in moving
            if not unit_words
            or units[name].partition("/")[0].partition(" ")[0] in unit_words.split()
        }
        if right := residuals.agreeing(divided):
            yield residuals.judged("factor", f"{format_list(right)} {words}", right)
    for name in moving:
        square = float(residuals.reference[name] @ residuals.reference[name])
        factor = (
            float(residuals.curve[name] @ residuals.reference[name]) / square if square else 0.0
        )
        if not factor or any(abs(factor / known - 1) < 1e-3 for known, _ in KNOWN_FACTORS.values()):
            continue
        right = residuals.agreeing(
            {n: residuals.curve[n] / factor - residuals.reference[n] for n in moving}
        )
        if next(iter(right), "") == name:  # otherwise an earlier channel gave the same factor
            yield residuals.judged("factor", f"{format_list(right)} times {factor:.6g}", right, 2)


def offset_causes(residuals: Residuals) -> Iterator[Explanation]:
    """Causes in which channels are off by a constant: by parts of a turn, or by any offset."""
    for name in residuals.differing:
        unit, allowed = residuals.case.channels[name].si_unit, residuals.allowed[name]
        offset = float(np.mean(residuals.before[name])) * allowed
        known = ANGLE_OFFSETS if unit == "rad" else {}
        turn = next((w for w, t in known.items() if abs(abs(offset) / t - 1) < 1e-3), "")
        if turn:
            offset = float(np.copysign(ANGLE_OFFSETS[turn], offset))
        right = residuals.agreeing(
            {
                other: residuals.before[other] - offset / residuals.allowed[other]
                for other in residuals.differing
                if residuals.case.channels[other].si_unit == unit
            }
        )
        if next(iter(right), "") == name:
            words = turn or f"{offset:.6g} {format_unit(unit)}"
            way = "" if not turn else " ahead" if offset > 0 else " behind"
            text = f"{format_list(right)} off by {words}{way}"
            yield residuals.judged("offset", text, right, 0 if turn else 2)


def quantity_causes(residuals: Residuals) -> Iterator[Explanation]:
    """The cause in which channels equal other quantities of the reference than the sidecar says."""
    case, curves = residuals.case, residuals.curves
    known = all_quantities(case, residuals.run, curves.x, curves.drive, dict(case.parameters))
    right, words = ChannelCurves(), []
    for name in residuals.differing:
        channel, allowed = case.channels[name], residuals.allowed[name]
        for quantity, values in known.items() if isinstance(channel.equals, str) else ():
            if quantity == channel.equals or not np.ptp(values) > 0:
                continue
            expected = channel.scale * np.broadcast_to(values, curves.x.shape)
            left = residuals.curve[name] - (expected + channel.shift * channel.factor) / allowed
            if np.isfinite(left).all() and residuals.agrees(name, left):
                right[name] = left
                words.append(f"{name} equal to {quantity}")
                break
    if right:
        yield residuals.judged("quantity", format_list(words), right)


def shift_causes(residuals: Residuals) -> Iterator[Explanation]:
    """Causes in which channels are shifted along x: by one or two samples, or by any step."""
    moving = [n for n in residuals.differing if np.ptp(residuals.reference[n]) > 0]
    for words, count in SAMPLE_SHIFTS.items():
        for direction, mine, own in (
            ("late", slice(count, None), slice(None, -count)),
            ("early", slice(None, -count), slice(count, None)),
        ):
            right = residuals.agreeing(
                {n: residuals.curve[n][mine] - residuals.reference[n][own] for n in moving}
            )
            if right:
                yield residuals.judged("shift", f"{format_list(right)} {words} {direction}", right)
    if len(residuals.curves.x) < 8 or not moving:
        return
    from scipy.interpolate import CubicSpline  # slow to load

    x, shift, after = residuals.curves.x, 0.0, dict(residuals.before)
    splines = {name: CubicSpline(x, residuals.reference[name]) for name in moving}
    for _ in range(MAX_ITERATIONS):
        slope = np.concatenate([-splines[name](x - shift, 1) for name in moving])
        step = float(np.concatenate([after[n] for n in moving]) @ slope / (slope @ slope))
        if not abs(shift + step) < 0.1 * np.ptp(x):
            return
        shift += step
        after = {name: residuals.curve[name] - splines[name](x - shift) for name in moving}
    if right := residuals.agreeing(after):
        direction = "late" if shift > 0 else "early"
        yield residuals.judged(
            "shift", f"{format_list(right)} {direction} by {abs(shift):.4g} in x", right, 2
        )


def mode_causes(residuals: Residuals) -> Iterator[Explanation]:
    """Causes in which the reference has another assembly mode."""
    solver = load_reference(residuals.case)
    if isinstance(solver, Recorded) or not assembly_modes(residuals.case):
        return
    own = residuals.case.parameters.get(
        "mode", inspect.signature(solver.solve).parameters["mode"].default
    )
    for mode in assembly_modes(residuals.case):
        if mode != own and (after := residuals.at({"mode": mode})):
            yield residuals.judged("assembly mode", f"mode = {mode:+d} instead of {own:+g}", after)


def finer_causes(residuals: Residuals) -> Iterator[tuple[Explanation | None, str]]:
    """A cause or a remark on half the time step, and one on twice as many segments of rods.

    The run is made again for each, if it was short.
    """
    case, run, solver = residuals.case, residuals.run, residuals.solver
    if not residuals.can_run_again:
        return
    if step := time_step_of(run, residuals.curves):
        words = f"a time step of {number(step / 2)} s instead of {number(step)} s"
        yield run_finer(residuals, words, with_half_step(case, run, solver, step))
    if case.rod:
        finer = case.with_segments({name: 2 * rod.segments for name, rod in case.rod.items()})
        yield run_finer(residuals, "twice as many segments", finer)


def setting_causes(residuals: Residuals, settings: Iterable[Perturbation]) -> Iterator[Explanation]:
    """Causes in an engine's settings other than its time step, such as soft constraints.

    The run is made again with each of the settings.
    """
    case, solver = residuals.case, residuals.solver
    for one in settings:
        try:
            after = residuals.with_changed_case(with_settings(case, solver, one.parameters))
        except RUN_EXCEPTIONS:
            continue
        if falling := falling_channels(residuals, after):
            left = remaining_share(residuals.before, after, falling)
            words = f"{one.cause}: {one.change}"
            yield Explanation("finer", words, falling, (), left, len(residuals.differing))


def setting_changes(residuals: Residuals) -> list[Perturbation]:
    """Changes of an engine's settings, other than the time step, that should reduce its error."""
    case, run, solver = residuals.case, residuals.run, residuals.solver
    if run != "dynamics" or not residuals.can_run_again:
        return []
    engine = engine_of(solver)
    own = engine.settings.read(settings_of(case, run, solver)).model_dump(exclude_unset=True)
    every = engine.perturbations(own, describe_dynamics(case), scaled=False)
    return [one for one in every if one.better and one.cause != STEP_CAUSE]


def time_step_of(run: Kind, curves: Curves) -> float:
    """The time step of a run [s]; 0 if it has none."""
    step = curves.settings.get("timestep")
    return step if run == "dynamics" and isinstance(step, float) else 0.0


def with_half_step(case: Case, run: Kind, solver: str, step: float) -> Case:
    """The settings of a case with half the time step for a solver."""
    engine = engine_of(solver)
    parameters = engine.at_step(cast(ParameterValues, settings_of(case, run, solver)), step / 2)
    return with_settings(case, solver, {**case.settings.get(solver, {}), **parameters})


def with_settings(case: Case, solver: str, settings: Mapping[str, Any]) -> Case:
    """Return the case with other settings of a solver."""
    return case.model_copy(update={"settings": {**case.settings, solver: settings}})


def run_finer(residuals: Residuals, words: str, changed: Case) -> tuple[Explanation | None, str]:
    """Make a run with shorter steps or segments; give a cause if errors fall, or a remark."""
    try:
        after = residuals.with_changed_case(changed)
    except RUN_EXCEPTIONS as error:
        return None, f"with {words} the run fails: {error}"
    share = remaining_share(residuals.before, after, residuals.differing)
    if share > WORSE_RATIO:
        return None, f"{words} makes the error {number(share)} times as large"
    falling = falling_channels(residuals, after)
    if not falling:
        return None, f"{words} leaves the error as it is"
    left_of = remaining_share(residuals.before, after, falling)
    if left_of < 0.5**MAX_ORDER:
        return None, f"{words} leaves {number(left_of)} of the error, less than any order explains"
    text = f"{words} (error of order {number(-np.log2(left_of), 2)})"
    return Explanation("finer", text, falling, (), left_of, len(residuals.differing)), ""


def falling_channels(residuals: Residuals, after: ChannelCurves) -> tuple[str, ...]:
    """The channels that differ and whose largest difference falls to `FALLING_SHARE` of it."""
    return tuple(
        n
        for n in residuals.differing
        if n in after
        and np.abs(after[n]).max() <= FALLING_SHARE * np.abs(residuals.before[n]).max()
    )


def locate_values(case: Case, cause: Explanation) -> list[str]:
    """Remarks on the lines of the model in which the value of a cause stands.

    For a parameter of the reference it is the fitted value, for a number of the model the value
    that it has now.
    """
    found = []
    model_lines = read_text(case.model_path).splitlines()
    for before, after in cause.changes.values():
        value = before if cause.kind == MODEL_KIND else after
        lines = [
            k
            for k, line in enumerate(model_lines, 1)
            if any(
                abs(float(n) - value) <= NUMBER_TOLERANCE * abs(value)
                for n in NUMBER_PATTERN.findall(line)
            )
        ]
        if value and 0 < len(lines) <= MAX_NAMED_LINES:
            where = f"line{'s' * (len(lines) > 1)} {format_list(map(str, lines))}"
            found.append(f"{value:.6g} stands in {case.model}, {where}")
    return found


def parameter_causes(
    residuals: Residuals, deadline: float, pairs: bool = True
) -> Iterator[Explanation]:
    """Causes by other values of each parameter, and of pairs if no single one explains all.

    All changes are first estimated to first order by slopes.  They are then fitted, those with the
    best estimates first, until the deadline; the others are given as estimated.
    """
    slopes = {
        key: slope
        for key in residuals.parameters
        if residuals.time_for_another(deadline) and (slope := parameter_slope(residuals, {}, key))
    }
    pairs_of_slopes = [*combinations(slopes, 2)] if pairs else []
    for choices, count in (([(k,) for k in slopes], None), (pairs_of_slopes, MAX_FITTED_PAIRS)):
        first = sorted(
            (estimate_cause(residuals, keys, slopes) for keys in choices), key=lambda c: c.left
        )
        complete = False
        for cause in first[:count]:
            rival = not complete or cause.left < RIVAL_SHARE
            if rival and residuals.time_for_another(deadline):
                cause = fit_cause(residuals, tuple(cause.changes), slopes, deadline)
            complete = complete or cause.score == len(residuals.differing)
            yield cause
        if complete:
            return


def model_causes(residuals: Residuals, score: int) -> Iterator[Explanation]:
    """Causes by other numbers of the model, if no single change of the reference explains all.

    The engine runs again for each number, so nothing is tried if its run is long.
    """
    if (
        score >= len(residuals.differing)
        or residuals.curves.seconds > MAX_REPEATED_SECONDS * residuals.stride
    ):
        return
    model = ModelResiduals(residuals.case, residuals.run, residuals.solver, residuals.curves)
    if not model.differing or not model.repeats():
        return
    deadline = time.process_time() + MODEL_FIT_SECONDS
    for cause in parameter_causes(model, deadline, pairs=False):
        words = f"in {residuals.case.model}: {cause.words}"
        yield replace(cause, kind=MODEL_KIND, words=words)


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
        causes.append(parameter_cause(residuals, shares, after, ", to first order"))
    return min(causes, key=lambda cause: cause.left)


def fit_cause(
    residuals: Residuals,
    keys: tuple[str, ...],
    slopes: Mapping[str, ChannelCurves],
    deadline: float,
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
        found = fit_shares(residuals, shares, names, deadline, end)
        if after := residuals.at({k: residuals.value(k, s) for k, s in found.items()}):
            causes.append(parameter_cause(residuals, found, after))

    def done() -> bool:
        complete = any(cause.score == len(residuals.differing) for cause in causes)
        return complete or not residuals.time_for_another(deadline)

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
    deadline: float,
    end: int | None = None,
) -> dict[str, float]:
    """Fit the changes, as shares of parameters, to some channels by the Gauss-Newton method."""
    after = residuals.at_shares(shares)
    for _ in range(MAX_ITERATIONS):
        slopes = {k: parameter_slope(residuals, shares, k) for k in shares}
        if not all(slopes.values()) or not residuals.time_for_another(deadline):
            break
        step = solve_least_squares(after, slopes, names, end)
        for _ in range(MAX_HALVINGS if np.abs(step).max() > TINY_CHANGE else 1):
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
    residuals: Residuals, shares: Mapping[str, float], after: ChannelCurves, note: str = ""
) -> Explanation:
    """The cause by other values of some parameters, with the differences that it leaves."""
    changes = {k: (residuals.parameters[k], residuals.value(k, s)) for k, s in shares.items()}
    words = []
    for key, (old, new) in changes.items():
        unit = format_unit(residuals.unit(key).removeprefix("1"))
        share = f" ({100 * (new / old - 1):+.4g} %)" if old else ""
        words.append(f"{key} = {new:.6g} {unit} instead of {old:.6g} {unit}".rstrip() + share)
    kind, free = ("parameter", 1) if len(changes) == 1 else ("pair of parameters", 3)
    return residuals.judged(
        kind, " and ".join(words).replace("  ", " ") + note, after, free, changes
    )


def describe_failure(case: Case, run: Kind, solver: str, curves: Curves) -> Diagnosis:
    """Describe a failed run by its curves before the failure.

    Parameters
    ----------
    case : Case
    run, solver : str
        The run and the solver that failed.
    curves : Curves
        The curves until the last sample before the failure.

    Returns
    -------
    Diagnosis
        Its remarks say which channels left their tolerance first, how the constraint violation
        grew, whether the time step is beyond the stability limit of the integrator at the stiffest
        spring, and with which shorter step the run comes to its end.

    Raises
    ------
    InputError
        The reference cannot be evaluated.
    """
    begin = time.perf_counter()
    words = [
        *describe_first_error(case, run, solver, curves),
        *describe_violation(curves),
        *describe_stability(case, run, solver, curves),
        *describe_shorter_steps(case, run, solver, curves),
    ]
    seconds = time.perf_counter() - begin
    return Diagnosis(case.name, run, solver, remarks=tuple(words), seconds=seconds, failed=True)


def describe_first_error(case: Case, run: Kind, solver: str, curves: Curves) -> Iterator[str]:
    """A remark on the channels that left their tolerance first, and at which x."""
    residuals = Residuals(case, run, solver, curves)
    over = {
        name: int(np.argmax(np.abs(residuals.before[name]) > 1.0)) for name in residuals.differing
    }
    if not over and curves.x.size > 1:
        yield f"no channel left its tolerance until x = {curves.x[-1]:.4g}"
    if not over:
        return
    name = min(over, key=lambda n: over[n])
    at_once = [n for n, k in over.items() if k == over[name]]
    yield f"{format_list(at_once)} left the tolerance first, at x = {curves.x[over[name]]:.4g}"


def describe_violation(curves: Curves) -> Iterator[str]:
    """A remark on the growth of the constraint violation before the failure."""
    size = curves.violations
    if size is None or size.size < 2 or not size.max() > 0:
        return
    last = float(size[-1])
    before = np.flatnonzero(size <= 0.1 * last)
    if before.size and last > 0:
        k = int(before[-1])
        yield (
            f"the constraint violation grew tenfold, to {number(last)} m, from x = "
            f"{curves.x[k]:.4g} to {curves.x[-1]:.4g}"
        )


def describe_stability(case: Case, run: Kind, solver: str, curves: Curves) -> Iterator[str]:
    """A remark on whether the time step is too long for the stiffest spring, by theory."""
    if not (step := time_step_of(run, curves)):
        return
    model = compiled_model(case)
    engine = engine_of(solver)
    scheme = engine.scheme_of(cast(ParameterValues, settings_of(case, run, solver)), model)
    fastest = highest_frequency(model, case.start)
    if scheme is None or not fastest:
        return
    most = stability_limit(scheme.step)
    side = "beyond" if step * fastest > most else "within"
    yield (
        f"dt ω = {number(step * fastest)} of the stiffest spring, {side} the {number(most)} up to "
        f"which {scheme.name} is stable"
    )


def describe_shorter_steps(case: Case, run: Kind, solver: str, curves: Curves) -> Iterator[str]:
    """A remark on the longest step of dt/2, dt/4, .. with which the run, if short, succeeds."""
    if not (step := time_step_of(run, curves)):
        return
    shortest, seconds = step, curves.seconds
    for _ in range(MAX_HALVINGS):
        if (seconds := 2 * seconds) > MAX_REPEATED_SECONDS:
            break
        changed = with_half_step(case, run, solver, shortest)
        shortest /= 2
        try:
            solve_here(changed, run, solver)
        except RUN_EXCEPTIONS:
            continue
        words = f"{number(shortest)} s instead of {number(step)} s"
        yield f"with a time step of {words} it comes to its end"
        return
    if shortest < step:
        yield f"with time steps down to {number(shortest)} s it fails as well"
