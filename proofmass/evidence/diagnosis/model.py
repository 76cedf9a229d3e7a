"""Causes in the model: another value of a number, the opposite sign of one, stops that rebound.

The engine runs again for each.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from proofmass.base.strict import Kind
from proofmass.base.wording import number
from proofmass.case.case import Case
from proofmass.evidence.changed import model_source, numbers_of_case, with_changed_model
from proofmass.evidence.diagnosis.explanation import Edits, Explanation
from proofmass.evidence.diagnosis.fault import Fault, count_digits, model_fault
from proofmass.evidence.diagnosis.fit import (
    MAX_MODEL_STEPS,
    MODEL_KIND,
    RUN_EXCEPTIONS,
    ChannelCurves,
    ModelResiduals,
    Residuals,
    SearchBudget,
    fitted_causes,
    largest,
    remaining_share,
    slopes_of,
)
from proofmass.reference.case_model import compiled_model
from proofmass.reference.run_reference import changeable_parameters
from proofmass.run.solve import solve_here
from proofmass.sim.contents import size
from proofmass.sim.elements import Number
from proofmass.sim.engines import computes_curves
from proofmass.sim.numbers import joint_axes
from proofmass.sim.protocol.failures import BadModel
from proofmass.sim.start import loop_opening

NUMBER_TOLERANCE = 1e-5
"""Relative difference up to which a number of the model is a fitted value."""
MAX_MIRRORS = 4  # numbers of the model that are tried for one parameter of the reference
SIGN_KIND = "sign"
FLIPPED_KINDS = ("gravity", "stiffness", "rest angle", "gear", "load")
"""Kinds of numbers whose opposite sign is tried; the axes of joints as well."""
OPEN_LOOP_SHARE = 1e-6
"""Opening of the loops in the start pose, as a share of the size, that is more than the six digits
with which people write a pose."""
REBOUND_KIND, STOP_KIND = "rebound", "softness of the stop"
REBOUND_RATIO = 10.0
"""Damping ratio of a stop that leaves no rebound: 4e-26 of the speed of the impact."""


class ChangedModel:
    """Runs of a case with changes of its model, each with all samples.

    `lasts` says whether the budget allows another one.
    """

    def __init__(self, residuals: Residuals) -> None:
        self.residuals, self.case = residuals, residuals.case
        self.source = model_source(self.case)
        self.numbers = numbers_of_case(self.case)
        self.budget = SearchBudget(MAX_MODEL_STEPS, residuals.steps)

    @property
    def lasts(self) -> bool:
        """Whether another run may be made."""
        return self.budget.lasts

    def judged(
        self,
        kind: str,
        edits: Edits,
        faults: Sequence[Fault],
        free: int = 0,
        changes: Mapping[str, tuple[float, float]] | None = None,
    ) -> Explanation | None:
        """The explanation by changes of the model; None if the run then fails."""
        self.budget.spend()
        after = differences_with(self.residuals, edits)
        if not after:
            return None
        words = " and ".join(fault.change for fault in faults)
        return self.residuals.judged(kind, words, after, free, changes, faults, edits)

    def fault(self, number: Number, value: float, within: float = 0.0) -> Fault:
        """The fault of a number that should have a value."""
        return model_fault(self.case, self.source, number, value, within)


def differences_with(
    residuals: Residuals, edits: Edits, reference_follows: bool = True
) -> ChannelCurves:
    """The differences of a run with changes of the model; empty if it fails or ends early.

    A reference that reads the model reads the changed one, unless it should not follow.
    """
    case, run, solver = residuals.case, residuals.run, residuals.solver
    try:
        with TemporaryDirectory() as folder:
            changed = with_changed_model(case, edits, Path(folder))
            curves = solve_here(changed, run, solver)
            if curves.x.size != residuals.curves.x.size:
                return {}
            of = changed if reference_follows and case.reads_model else case
            found = Residuals(of, run, solver, curves).before
    except RUN_EXCEPTIONS:
        return {}
    return found if found.keys() >= residuals.allowed.keys() else {}


def changed_model(residuals: Residuals) -> ChangedModel | None:
    """Runs with changes of the model; None if they are too long or cannot be made, as is noted.

    Curves that the engine does not give again with the model as it is belong to another model.
    """
    log = residuals.log
    if not computes_curves(residuals.solver):
        return None
    if not residuals.can_run_again:
        log.untried.append("numbers of the model, since a run takes too many steps")
        return None
    try:
        model = ChangedModel(residuals)
    except BadModel as error:
        log.untried.append(f"numbers of the model ({error})")
        return None
    return model if is_same_run(residuals, differences_with(residuals, ())) else None


SAME_RUN_SHARE = 1e-3
"""Share of the differences by which a run may differ when it is made again: rounding."""


def is_same_run(residuals: Residuals, again: ChannelCurves) -> bool:
    """Whether the differences of a run that was made again are those of the run."""
    apart = {name: y - residuals.before[name] for name, y in again.items()}
    return bool(apart) and remaining_share(residuals.before, apart, ()) <= SAME_RUN_SHARE


def mirrored_cause(model: ChangedModel, cause: Explanation) -> Explanation | None:
    """The change of the model that is the same as one parameter of the reference, if it is as good.

    If the reference explains the curves with 2.525 in place of 2.5, and a number of the model is
    2.525, then that number with 2.5 explains them too.
    """
    ((stated, fitted),) = cause.changes.values()
    if not fitted or not stated:
        return None
    close = [
        n
        for n in model.numbers
        if abs(abs(n.value) - abs(fitted)) <= NUMBER_TOLERANCE * abs(fitted)
    ]
    found = []
    for one in close[:MAX_MIRRORS]:
        right = float(np.copysign(stated, one.value * fitted * stated))
        edits = ((one, right - one.value),)
        fault = model.fault(one, right)
        # the error is that of the wrong number: the part of it that is allowed would not be noticed
        share = abs(right - one.value) / largest(model.residuals.before) / abs(right)
        fault = replace(fault, within=share * abs(float(fault.right)))
        changes = {one.name: (one.value, right)}
        if model.lasts and (mirror := model.judged(MODEL_KIND, edits, [fault], 1, changes)):
            found.append(mirror)
    best = max(found, key=lambda c: (c.score, -c.left), default=None)
    return best if best and best.score >= cause.score else None


def is_model_wrong(case: Case, cause: Explanation) -> bool:
    """Whether the model rather than the sidecar is taken to be wrong, if both explain as much.

    People write numbers with few digits, and about as many for all numbers of a sidecar.  So the
    sidecar is taken to be wrong if its value has more digits than the other one and than half of
    its other parameters; otherwise it is the model, which is what is tested.
    """
    ((key, (stated, fitted)),) = cause.changes.items()
    others = [count_digits(v) for k, v in changeable_parameters(case).items() if k != key]
    usual = float(np.median(others)) if others else 0.0
    return count_digits(stated) <= max(count_digits(fitted), usual)


def sign_causes(model: ChangedModel) -> Iterator[Explanation]:
    """Causes by the opposite sign of gravity, springs, loads, gears, and axes of joints."""
    if model.case.reads_model:  # it would change with the model
        return
    groups = [[n for n in model.numbers if n.kind == "gravity" and n.value]]
    groups += [[n] for n in model.numbers if n.kind in FLIPPED_KINDS[1:] and n.value]
    groups += joint_axes(model.source)
    done = 0
    for group in filter(None, groups):
        if not model.lasts:
            break
        done += 1
        edits = tuple((one, -2.0 * one.value) for one in group)
        faults = [model.fault(one, -one.value) for one in group]
        if cause := model.judged(SIGN_KIND, edits, faults):
            yield cause
    what = "sign of gravity, of a spring, a load, a gear or an axis in the model"
    model.residuals.log.note(what, done, len([*filter(None, groups)]))


def number_causes(model: ChangedModel) -> Iterator[Explanation]:
    """Causes by other values of the numbers of the model, each fitted."""
    residuals = model.residuals
    fits = ModelResiduals(residuals.case, residuals.run, residuals.solver, residuals.curves)
    fits.log = residuals.log
    if not fits.differing:
        return
    slopes = slopes_of(fits, MODEL_KIND)
    for cause in fitted_causes(fits, slopes, MODEL_KIND, [(name,) for name in slopes]):
        if len(fits.differing) == len(residuals.differing):
            yield cause
        elif cause.complete and model.lasts:  # the reference changes with the model
            judged = model.judged(MODEL_KIND, cause.edits, cause.faults, 1, cause.changes)
            if judged:
                yield judged


def describe_start(case: Case) -> Iterator[str]:
    """A remark on loops that are open in the start pose by more than the digits of its numbers."""
    model = compiled_model(case)
    gap = loop_opening(model, case.start)
    if gap > OPEN_LOOP_SHARE * (size(model, case.start) or 1.0):
        yield (
            f"the loops of {case.model} are open by {number(gap, 2)} m in the start pose "
            f"(key {case.start})"
        )


def rebound_causes(model: ChangedModel) -> Iterator[Explanation]:
    """The cause that an engine's stops have no rebound, where the model's have one.

    If the reference reads the model, both lose the rebound with the change and may agree after it.
    So the change is a cause only if it leaves the engine's curves as they are.
    """
    ratios = [
        n
        for n in model.numbers
        if n.kind == STOP_KIND and n.place.attribute == "solreflimit" and n.place.part == 1
    ]
    soft = [n for n in ratios if 0.0 < n.value < REBOUND_RATIO]
    if not soft or model.residuals.run != "dynamics" or not model.lasts:
        return
    edits = tuple((n, REBOUND_RATIO - n.value) for n in soft)
    faults = [replace(model.fault(n, REBOUND_RATIO), note="no rebound") for n in soft]
    model.residuals.log.tried.append("stops without a rebound")
    if model.case.reads_model:
        model.budget.spend()
        if not is_same_run(model.residuals, differences_with(model.residuals, edits, False)):
            return
    if cause := model.judged(REBOUND_KIND, edits, faults):
        yield cause


def confirm_cause(case: Case, run: Kind, solver: str, cause: Explanation) -> Explanation | None:
    """A cause in the model that another run found, in this run; None if it is no cause of it.

    The run is made again, with and without the change.

    Parameters
    ----------
    case : Case
        A case with the same model.
    run, solver : str
        The run and the solver.
    cause : Explanation
        A cause with `edits`, from `find_causes`.

    Returns
    -------
    Explanation or None
        The cause with what it explains here, if that is all.
    """
    residuals = Residuals(case, run, solver, solve_here(case, run, solver))
    if not residuals.can_run_again:
        return None
    after = differences_with(residuals, cause.edits)
    if not after:
        return None
    found = residuals.judged(
        cause.kind, cause.words, after, cause.free, cause.changes, cause.faults, cause.edits
    )
    return found if found.complete else None
