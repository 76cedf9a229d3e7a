"""The search for causes: changes of a case that would explain why a run differs, best first.

Each hypothesis is one change of the case: another value of a parameter of the reference, or of two
parameters; another assembly mode; a sign, a unit, an offset or another quantity of channels; a
shift along x; another number of the model, or its sign; settings of the engine.  It is fitted to
the curves of the solver.  It explains the channels that differ without the change and agree with
it; channels that agree without the change and differ with it count against it.
"""

import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np

from proofmass.base.strict import Kind
from proofmass.case.case import Case
from proofmass.evidence.diagnosis.channels import (
    factor_causes,
    offset_causes,
    quantity_causes,
    shift_causes,
)
from proofmass.evidence.diagnosis.explanation import Diagnosis, Explanation, rank_key
from proofmass.evidence.diagnosis.fault import count_digits, sidecar_fault
from proofmass.evidence.diagnosis.fit import (
    MAX_MISFIT_RATIO,
    Residuals,
    fitted_causes,
    plural,
    slopes_of,
)
from proofmass.evidence.diagnosis.measured import measured_numbers, noise_cause
from proofmass.evidence.diagnosis.model import (
    SIGN_KIND,
    ChangedModel,
    changed_model,
    describe_start,
    is_model_wrong,
    mirrored_cause,
    number_causes,
    rebound_causes,
    sign_causes,
)
from proofmass.evidence.diagnosis.settings import (
    finer_causes,
    setting_causes,
    setting_changes,
    sibling_causes,
)
from proofmass.reference.find import assembly_modes, reference_class
from proofmass.sim.protocol.curves import Curves

MAX_CAUSES = 5  # causes that are kept
EXACT_SHARE = 1e-6  # share of the differences that a cause may leave to be called exact
EQUAL_RATIO = 1.01  # ratio of what two causes leave, up to which they fit equally well
CLEAR_SHARE = 1e-3
"""Share of the differences that a clear cause leaves: no setting of an engine leaves as little."""
PARAMETER = "parameter of the reference"
TRANSIENT_SHARE = 0.1  # share of a run within which a difference at its start is a transient


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
        The curves, from `proofmass.run.solve.solve`.
    thorough : bool
        Whether all numbers of the model are fitted, for which the engine runs again many times.

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
    >>> find_causes(wrong, "sweep", "mujoco", curves).causes[0].sentence
    'fourbar.toml, line 10: rocker is 2.4 m; with 2.5 m all 17 curves agree'
    """
    begin = time.perf_counter()
    residuals = Residuals(case, run, solver, curves)
    causes, remarks = causes_of_noise(residuals), list[str]()
    differing = causes[0].explains if causes else residuals.differing
    if differing and not causes:
        causes += causes_of_reference(residuals)
        if model := changed_model(residuals):
            causes = with_mirrors(model, causes)
        if not any(c.complete and c.free <= 1 for c in causes):
            causes += fitted_pairs(residuals)
        if model:
            causes += causes_of_model(model, causes, thorough)
        remarks += [*describe_start(residuals.case), *describe_transient(residuals)]
        if not any(map(is_clear, causes)):
            more, words = causes_of_settings(residuals)
            causes, remarks = [*causes, *more], [*remarks, *words]
    return Diagnosis(
        case.name,
        run,
        solver,
        differing,
        len(residuals.allowed),
        best_causes(causes),
        tuple(residuals.log.tried),
        tuple(residuals.log.untried),
        tuple(remarks),
        time.perf_counter() - begin,
        fault="" if differing else "; ".join(residuals.gaps),
    )


def causes_of_noise(residuals: Residuals) -> list[Explanation]:
    """Causes of what measured curves differ by, if these explain all that differs."""
    found = [*noise_cause(residuals)]
    measured = residuals.measured.keys() >= {*residuals.differing}
    if measured and (numbers := measured_numbers(residuals)):
        found += numbers.explanations
    return [one for one in found if one.complete]


def causes_of_reference(residuals: Residuals) -> list[Explanation]:
    """Causes in the reference and in the channels, for which no engine runs again.

    Where a change without a fitted number explains all to rounding, nothing is fitted.
    """
    tried = residuals.log.tried
    tried += ["sign, unit, factor and offset of each channel", "shifts along x"]
    tried += ["other quantities of the reference"]
    found = [
        *factor_causes(residuals),
        *offset_causes(residuals),
        *quantity_causes(residuals),
        *shift_causes(residuals),
        *mode_causes(residuals),
        *parameter_sign_causes(residuals),
    ]
    if not any(is_exact(c) and not c.free for c in found):
        found += fitted_parameters(residuals)
    return found


def fitted_parameters(residuals: Residuals) -> Iterator[Explanation]:
    """Causes by other values of each parameter."""
    residuals.slopes = slopes_of(residuals, PARAMETER)
    choices = [(key,) for key in residuals.slopes]
    yield from fitted_causes(residuals, residuals.slopes, PARAMETER, choices)


def fitted_pairs(residuals: Residuals) -> Iterator[Explanation]:
    """Causes by other values of two parameters."""
    if len(residuals.slopes) < 2:
        return
    residuals.log.tried.append(f"pairs of {plural(PARAMETER)}")
    pairs = [*combinations(residuals.slopes, 2)]
    yield from fitted_causes(residuals, residuals.slopes, f"pair of {plural(PARAMETER)}", pairs)


def is_exact(cause: Explanation) -> bool:
    """Whether a cause explains all channels, and leaves only rounding of the differences."""
    return cause.complete and cause.left <= EXACT_SHARE


def is_clear(cause: Explanation) -> bool:
    """Whether no setting of the engine need be tried: a cause explains all, and was not fitted or
    leaves almost nothing."""
    return cause.complete and (not cause.free or (cause.free == 1 and cause.left <= CLEAR_SHARE))


def causes_of_model(
    model: ChangedModel, known: Sequence[Explanation], thorough: bool
) -> list[Explanation]:
    """Causes in the model, unless a cause is clear.

    Its numbers are fitted if no single change explains all so far.
    """
    if any(is_clear(c) and c.free for c in known):
        return []
    found = [*sign_causes(model), *rebound_causes(model)]
    if thorough and not any(c.complete and c.free <= 1 for c in (*known, *found)):
        found += number_causes(model)
    return found


def with_mirrors(model: ChangedModel, causes: Sequence[Explanation]) -> list[Explanation]:
    """The causes, in which the best one by a parameter is turned to the side that is wrong.

    Its mirrored cause comes in addition if it explains more, otherwise in its place if the value
    that it calls right is the more likely one.
    """
    single = [c for c in causes if c.kind == "parameter" and c.score > 0]
    if not single:
        return [*causes]
    best = min(single, key=sort_key)
    mirror = mirrored_cause(model, best)
    if mirror is None:
        return [*causes]
    others = [c for c in causes if c is not best]
    if mirror.score > best.score:
        return [mirror, *causes]
    first, second = (mirror, best) if is_model_wrong(model.case, best) else (best, mirror)
    return [replace(first, same=(*first.same, second.sentence)), *others]


def causes_of_settings(residuals: Residuals) -> tuple[list[Explanation], list[str]]:
    """Causes in the settings of the engine, and remarks on those that leave the error."""
    settings = setting_changes(residuals)
    shorter = [*finer_causes(residuals)]
    found = [*sibling_causes(residuals)]
    found += [cause for cause, _ in shorter if cause]
    found += setting_causes(residuals, settings)
    residuals.log.tried += [one.change for one in settings]
    return found, [words for _, words in shorter if words]


def sort_key(cause: Explanation) -> tuple[float, ...]:
    """The key of `rank_key`, with exact causes sorted by places, by digits, then by change.

    The share that an exact cause leaves is only rounding.  One wrong value is more likely than
    several.  A value with few digits is more likely, since people write round numbers.
    """
    first, left = rank_key(cause)
    changes = cause.changes.values()
    return (
        first,
        max(left, EXACT_SHARE),
        len(cause.faults),
        sum(count_digits(new) for _, new in changes),
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
            and max(other.left, cause.left)
            <= max(EXACT_SHARE, EQUAL_RATIO * min(other.left, cause.left))
        ]
        if equal:
            first = kept[equal[0]]
            kept[equal[0]] = replace(first, same=(*first.same, cause.words, *cause.same))
        elif cause.score > 0 or cause.left < MAX_MISFIT_RATIO:
            kept.append(cause)
    return tuple(kept[:MAX_CAUSES])


def mode_causes(residuals: Residuals) -> Iterator[Explanation]:
    """Causes in which the reference has another assembly mode."""
    reference = reference_class(residuals.case)
    if reference is None or not reference.modes():
        return
    residuals.log.tried.append("other assembly modes")
    own: Any = residuals.case.parameters.get("mode", reference.parameters["mode"].default)
    for mode in assembly_modes(residuals.case):
        if residuals.budget.lasts and mode != own and (after := residuals.at({"mode": mode})):
            keys, values = ["parameters", "mode"], (f"{own:+g}", f"{mode:+d}")
            fault = sidecar_fault(residuals.case, keys, "mode", *values)
            yield residuals.judged("assembly mode", fault.change, after, faults=[fault])


def parameter_sign_causes(residuals: Residuals) -> Iterator[Explanation]:
    """Causes by the opposite sign of a parameter of the reference."""
    signed = {key: value for key, value in residuals.parameters.items() if value}
    done = 0
    for key, value in signed.items():
        if not residuals.budget.lasts:
            break
        done += 1
        if after := residuals.at({key: -value}):
            fault = residuals.fault(key, -value)
            changes = {key: (value, -value)}
            yield residuals.judged(SIGN_KIND, fault.change, after, 0, changes, [fault])
    residuals.log.note("sign of a parameter of the reference", done, len(signed))


def describe_transient(residuals: Residuals) -> Iterator[str]:
    """A remark on curves of a motion in time that differ at its start alone."""
    x, n = residuals.curves.x, residuals.curves.x.size
    over = [np.flatnonzero(np.abs(residuals.before[c]) > 1.0) for c in residuals.differing]
    last = max((int(k[-1]) for k in over if k.size), default=n)
    if residuals.run == "dynamics" and n > 1 and last <= TRANSIENT_SHARE * (n - 1):
        yield (
            f"a start transient: no curve is outside its tolerance after {x[last]:.4g} s, "
            f"{100 * last / (n - 1):.2g} % of the run"
        )
