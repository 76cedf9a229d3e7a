"""The proposed runs are made, tried with mutants, and left out if they can check nothing.

A run is kept if a mutant turns its check.  A free motion runs with the model's own step.  If the
model fails with it, or its errors are so large that no mutant turns the check, the solver gets a
variant with a finer step, and its tolerances hold for both: with its own step the model then fails
or differs, and with the finer one it agrees.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from math import inf, isfinite, isnan
from pathlib import Path

from proofmass.base.errors import InputError
from proofmass.base.strict import Kind
from proofmass.base.wording import format_list
from proofmass.base.worker import call_isolated
from proofmass.batch.check import run_solver
from proofmass.batch.work import compare_and_share
from proofmass.case.case import Case, Tolerance
from proofmass.commands.proposal.inspection import first_reasons
from proofmass.commands.proposal.measured_tolerance import (
    describe_far_off,
    far_off,
    format_unit,
    measured_tolerances,
)
from proofmass.commands.proposal.mutant import MutantTrial, try_mutants
from proofmass.commands.proposal.proposal import Proposal
from proofmass.screen.finding import FindingKind
from proofmass.screen.screen import Screen
from proofmass.screen.steps import (
    SAFE_SHARE,
    StableSteps,
    describe_cause,
    describe_ratio,
    format_seconds,
)
from proofmass.sim.engines import NATIVE_ENGINE
from proofmass.sim.protocol.curves import Curves
from proofmass.verdict.comparison import Comparison, Comparisons
from proofmass.verdict.outcome import FAILED_OUTCOMES, Outcome

COMPARE_ERRORS_ONLY = partial(compare_and_share, detectable=False)
DRIVEN_DIVISORS = 2, 4
"""Divisors of the model's step in a driven motion, if the error with that is too large."""
FINER_DIVISORS = 4, 16
"""Divisors of the model's step in a free motion whose errors hide a change of 10 %."""
MAX_STABLE_HALVINGS = 8
"""Halvings of the step after which a model that fails is not tried with a finer one."""
CREEP = FindingKind.CREEP
"""The finding that tells why a model moves in MuJoCo that its reference holds at rest."""
VARIANT = "finer"
"""Name of the variant of a solver with a finer step than the model's."""


class LeftOut(Exception):
    """A run of a solver is left out; the message says why."""


class NothingMoves(LeftOut):
    """A run of a solver is left out since nothing moves in its reference."""


@dataclass(frozen=True)
class MeasuredRun:
    """A run of a solver: its comparisons, tolerances, and the mutants that were tried.

    Attributes
    ----------
    found : list of Comparison
    tolerances : tuple of Tolerance
    trial : MutantTrial or None
        None if no mutant was tried: no curve agrees but those of the drive, or one differs from an
        engine's own tolerance.
    """

    found: list[Comparison]
    tolerances: tuple[Tolerance, ...]
    trial: MutantTrial | None

    @property
    def failed(self) -> str:
        """Why it gave no curves; empty if it did."""
        first = self.found[0]
        return f"{first.outcome}: {first.message}" if first.outcome in FAILED_OUTCOMES else ""

    @property
    def differs(self) -> bool:
        """Whether a curve differs from the reference as it is."""
        return any(c.outcome == Outcome.DIFFERS for c in self.found)

    @property
    def still(self) -> str:
        """Why nothing moves in it; empty if something does."""
        return next((c.message for c in self.found if c.outcome == Outcome.NOTHING_MOVED), "")

    @property
    def turned(self) -> bool:
        """Whether a mutant turned the check."""
        return self.trial is not None and self.trial.turned


def measure_runs(proposal: Proposal, sidecar: Path, screen: Screen | None) -> None:
    """Make the proposed runs, and leave out those that an engine does not cover.

    Raises
    ------
    InputError
        No run is left.
    """
    case, left_out, nothing_moves = proposal.read(sidecar), dict[str, list[str]](), ""
    for kind in list(proposal.runs):
        for solver in list(proposal.runs[kind]):
            try:
                measure_run(proposal, case, kind, solver, screen)
            except NothingMoves as error:
                reason = nothing_moves = str(error)
            except LeftOut as error:
                reason = str(error)
            except InputError as error:
                if not error.key.startswith("run."):
                    raise
                reason = first_reasons(error.wrong)
            else:
                continue
            left_out.setdefault(reason, []).append(f"{kind}, {solver}")
            proposal.leave_out(kind, solver)
    if not proposal.runs:
        creep = [str(one) for one in screen.findings if one.kind is CREEP] if screen else []
        reasons = [nothing_moves, *creep[:1]] if nothing_moves else left_out
        raise InputError(sidecar.with_name(proposal.model), "", "; ".join(reasons))
    proposal.messages += [f"{format_list(of)}: left out: {why}" for why, of in left_out.items()]


def measure_run(
    proposal: Proposal, case: Case, kind: Kind, solver: str, screen: Screen | None
) -> None:
    """Make a run of a solver, and add what was found to the proposal.

    Raises
    ------
    LeftOut
        It fails with all steps, or no mutant turns its check.
    """
    if kind != "dynamics":
        accept(proposal, kind, solver, measure(proposal, case, kind, solver))
    elif proposal.look.is_determined:
        measure_driven_motion(proposal, case, solver)
    else:
        measure_free_motion(proposal, case, solver, screen)


def accept(proposal: Proposal, kind: Kind, solver: str, run: MeasuredRun, step: str = "") -> None:
    """Add a run to the proposal, or raise `LeftOut` if it can check nothing.

    `step` says with which step it was made, if that is not the model's.
    """
    if run.failed and kind != "dynamics":
        raise LeftOut(run.failed)
    if run.still:
        raise NothingMoves(run.still)
    if not (run.turned or run.differs or run.failed):
        nothing = f"no curve of it is compared: {run.found[0].message}"
        raise LeftOut(run.trial.describe() if run.trial else nothing)
    proposal.tolerances += run.tolerances
    words = [f"{kind}, {solver}: {describe_error(run.found)}{step}"]
    if off := far_off(run.found) if run.tolerances else []:
        words.append(describe_far_off(off))
    if run.trial is not None and run.trial.turned:
        words.append(run.trial.describe())
        proposal.turned_by = run.trial.number
    proposal.messages.append("; ".join(words))


def measure(
    proposal: Proposal,
    case: Case,
    kind: Kind,
    solver: str,
    tolerances: tuple[Tolerance, ...] = (),
) -> MeasuredRun:
    """Make a run of a solver, propose its tolerances if none are given, and try mutants."""
    judged = not proposal.look.is_determined
    is_measured = judged and not tolerances
    if judged and tolerances:
        case = case.model_copy(update={"tolerance": tolerances})
    compare = compare_as_measured if is_measured else COMPARE_ERRORS_ONLY
    found, _ = run_solver(case, kind, solver, compare)
    if is_measured and found[0].outcome not in FAILED_OUTCOMES:
        tolerances = tuple(measured_tolerances(kind, (solver,), found))
        case = case.model_copy(update={"tolerance": tolerances})
    agreeing = [
        c.channel
        for c in found
        if c.outcome == Outcome.AGREES and c.channel not in proposal.look.drive_channels
    ]
    run = MeasuredRun(found, tolerances, None)
    if not agreeing or (proposal.look.is_determined and run.differs):  # it can fail, as it does
        return run
    return replace(run, trial=try_in_worker(proposal, case, kind, solver, agreeing))


def compare_as_measured(case: Case, kind: Kind, solver: str, curves: Curves) -> Comparisons:
    """Compare with the tolerances that the errors propose; called in the worker of the run."""
    found = list(COMPARE_ERRORS_ONLY(case, kind, solver, curves))
    own = tuple(measured_tolerances(kind, (solver,), found))
    return COMPARE_ERRORS_ONLY(case.model_copy(update={"tolerance": own}), kind, solver, curves)


def try_in_worker(
    proposal: Proposal, case: Case, kind: Kind, solver: str, agreeing: list[str]
) -> MutantTrial:
    """Try mutants in a worker, within the limits of the run; one that reaches them turns none."""
    limits = case.run[kind]
    asked = case, kind, solver, agreeing, proposal.turned_by
    try:
        found: MutantTrial = call_isolated(
            try_mutants, *asked, timeout=limits.timeout, memory=limits.memory
        )
    except Exception as error:  # models of others may raise anything
        words = str(error) or type(error).__name__
        raise LeftOut(f"no change of the model could be tried: {words}") from None
    return found


def with_step(case: Case, solver: str, step: float) -> Case:
    """The case in which a solver takes another step [s]."""
    return case.model_copy(update={"settings": {**case.settings, solver: {"timestep": step}}})


def measure_driven_motion(proposal: Proposal, case: Case, solver: str) -> None:
    """Run a driven motion, with finer steps as long as its error exceeds the engine's tolerance.

    Raises
    ------
    LeftOut
        No mutant turns its check.
    """
    own = proposal.look.timestep
    first = measure(proposal, case, "dynamics", solver)
    for step in (own / divisor for divisor in DRIVEN_DIVISORS if first.differs or first.failed):
        run = measure(proposal, with_step(case, solver, step), "dynamics", solver)
        if not (run.differs or run.failed):
            why = f"the model's own step is {format_seconds(own)}: "
            why += first.failed or describe_largest(first.found)[0]
            proposal.steps[solver], proposal.step_comments[solver] = step, why
            words = f", with a step of {format_seconds(step)}; {why}"
            return accept(proposal, "dynamics", solver, run, words)
    return accept(proposal, "dynamics", solver, first)


def measure_free_motion(proposal: Proposal, case: Case, solver: str, screen: Screen | None) -> None:
    """Run a free motion with the model's own step; add a variant with a finer one if need be.

    Raises
    ------
    LeftOut
        It fails with all steps, nothing moves, or no mutant turns the check with any step.
    """
    own = measure(proposal, case, "dynamics", solver)
    if own.turned or own.still:
        return accept(proposal, "dynamics", solver, own)
    variant = f"{solver}:{VARIANT}"
    steps = screen.steps if screen and solver == NATIVE_ENGINE else None
    best = best_finer_run(proposal, case, variant, bool(own.failed), steps)
    if best is None:
        if own.failed:
            raise LeftOut(f"{own.failed}; finer steps do not help")
        return accept(proposal, "dynamics", solver, own)
    step, run = best
    why = describe_own(proposal, own, steps)
    words = f", with a step of {format_seconds(step)}"
    shared = tolerances_for(run.tolerances, (solver,), words)
    closer = own if own.failed else measure(proposal, case, "dynamics", solver, shared)
    if closer.turned and not closer.differs:
        return accept(
            proposal, "dynamics", solver, closer, f"; its tolerances are measured{words[1:]}"
        )
    proposal.add_variant("dynamics", solver, variant, step, why)
    if solver == NATIVE_ENGINE and (closer.failed or closer.differs):  # its step is for this engine
        proposal.messages.append(f"dynamics, {solver}: {why}, so that it does not agree")
        both = tolerances_for(run.tolerances, (solver, variant), words)
        return accept(proposal, "dynamics", variant, replace(run, tolerances=both), words)
    proposal.leave_out("dynamics", solver)
    return accept(proposal, "dynamics", variant, run, f"{words}; {why}")


def tolerances_for(
    some: Iterable[Tolerance], solvers: tuple[str, ...], words: str
) -> tuple[Tolerance, ...]:
    """Tolerances for other solvers, whose reason says with which step they were measured."""
    return tuple(
        one.model_copy(update={"solver": solvers, "why": f"{one.why}{words}"}) for one in some
    )


def best_finer_run(
    proposal: Proposal, case: Case, variant: str, fails: bool, stable: StableSteps | None
) -> tuple[float, MeasuredRun] | None:
    """The first finer step whose check a mutant turns, and whose run has no channel far off.

    If there is none, the last one whose check a mutant turns.
    """
    best: tuple[float, MeasuredRun] | None = None
    for step in finer_steps(proposal.look.timestep, fails, stable):
        run = measure(proposal, with_step(case, variant, step), "dynamics", variant)
        if run.turned:
            best = step, run
            if not run.differs:
                return best
    return best


def finer_steps(own: float, fails: bool, stable: StableSteps | None) -> Iterator[float]:
    """Steps that divide the model's [s]: if it fails, those of which the first should be stable."""
    if not fails:
        yield from (own / divisor for divisor in FINER_DIVISORS)
        return
    limit = stable.limit if stable else inf
    halved = [own / 2**k for k in range(1, MAX_STABLE_HALVINGS + 1)]
    yield from [step for step in halved if step <= SAFE_SHARE * limit] or halved[-1:]


def describe_own(proposal: Proposal, own: MeasuredRun, stable: StableSteps | None) -> str:
    """What the model does with its own step."""
    step = f"the model's own step is {format_seconds(proposal.look.timestep)}"
    limit = ""
    if stable and stable.ratio > 1.0:
        limit = f"; {describe_ratio(stable)}, set{describe_cause(stable)}"
    if not own.failed:
        hidden = f"hides {own.trial.tried[-1]}" if own.trial and own.trial.tried else "is too large"
        return f"{step}: {describe_largest(own.found)[0]}, which {hidden}{limit}"
    return f"{step}: {own.failed}{limit}"


def describe_error(found: list[Comparison]) -> str:
    """A phrase on the largest error of a run, and what to do if it is too large."""
    phrase, largest = describe_largest(found)
    if largest is None or largest.outcome != Outcome.DIFFERS or largest.run == "sweep":
        return phrase
    return (
        f"{phrase}, where {largest.allowed:.2g} {largest.unit} is allowed; `proofmass choose` "
        "finds a setting that is closer"
    )


def describe_largest(found: list[Comparison]) -> tuple[str, Comparison | None]:
    """A phrase on the largest error of a run, and its comparison; None if no curve has an error."""
    errors = [c for c in found if isfinite(c.error_max)]
    if not errors:
        return f"{found[0].outcome}: {found[0].message}", None
    largest = max(errors, key=lambda c: c.nrmse if isnan(c.allowed) else c.error_max / c.allowed)
    unit = format_unit(largest.unit)
    return f"largest error {largest.error_max:.2g} {unit}of {largest.channel}", largest
