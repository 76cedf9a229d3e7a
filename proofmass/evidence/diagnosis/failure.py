"""Why a run failed, from its curves before the failure."""

import math
import time
from collections.abc import Iterator
from typing import NamedTuple, cast

import numpy as np

from proofmass.base.strict import Kind
from proofmass.base.wording import format_list, number
from proofmass.case.case import Case
from proofmass.evidence.diagnosis.explanation import Diagnosis
from proofmass.evidence.diagnosis.fit import MAX_RUN_STEPS, RUN_EXCEPTIONS, Residuals, run_steps
from proofmass.evidence.diagnosis.model import describe_start
from proofmass.evidence.diagnosis.settings import time_step_of, with_half_step
from proofmass.reference.case_model import compiled_model
from proofmass.reference.samples import run_samples
from proofmass.run.solve import settings_of, solve_here
from proofmass.sim.contents import highest_frequency
from proofmass.sim.engines import engine_of
from proofmass.sim.protocol.curves import Curves
from proofmass.sim.protocol.settings import ParameterValues
from proofmass.sim.stability import stability_limit

TRIED_HALVINGS = 6  # times that a time step is halved
TENFOLD = 0.1  # share of the last constraint violation from which its growth is counted


class Reason(NamedTuple):
    """A finding on a failed run, and what mends it; empty where it only describes."""

    remark: str
    remedy: str = ""


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
        Its remarks say which channels left their tolerance first, how far loops are open in the
        start pose, how the constraint violation grew, whether the time step is beyond the stability
        limit of the integrator at the stiffest spring, and with which shorter step the run comes to
        its end; its remedies say which time step helps.

    Raises
    ------
    InputError
        The reference cannot be evaluated.
    """
    begin = time.perf_counter()
    reasons = [
        *describe_stability(case, run, solver, curves),
        *describe_shorter_steps(case, run, solver, curves),
    ]
    words = [
        *describe_first_error(case, run, solver, curves),
        *describe_start(case),
        *describe_violation(curves),
        *(reason.remark for reason in reasons),
    ]
    remedies = [reason.remedy for reason in reasons if reason.remedy]
    return Diagnosis(
        case.name,
        run,
        solver,
        remarks=tuple(words),
        remedies=tuple(remedies[:1]),  # the limit by theory, before a step that was tried
        seconds=time.perf_counter() - begin,
        failed=True,
    )


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
    before = np.flatnonzero(size <= TENFOLD * last)
    if before.size and last > 0:
        k = int(before[-1])
        yield (
            f"the constraint violation grew tenfold, to {number(last)} m, from x = "
            f"{curves.x[k]:.4g} to {curves.x[-1]:.4g}"
        )


def describe_stability(case: Case, run: Kind, solver: str, curves: Curves) -> Iterator[Reason]:
    """A remark on whether the time step is too long for the stiffest spring, by theory."""
    if not (step := time_step_of(run, curves)):
        return
    model = compiled_model(case)
    theory = engine_of(solver).theory
    scheme = theory.scheme_of(cast(ParameterValues, settings_of(case, run, solver)), model)
    fastest = highest_frequency(model, case.start)
    if scheme is None or not fastest:
        return
    most = stability_limit(scheme.step)
    beyond = step * fastest > most
    side = "beyond" if beyond else "within"
    limit = f"{number(1e3 * round_down(most / fastest))} ms"
    yield Reason(
        f"dt ω = {number(step * fastest)} of the stiffest spring, {side} the {number(most)} up to "
        f"which {scheme.name} is stable",
        f"Make the time step at most {limit}; it is {number(1e3 * step)} ms, with which "
        f"{scheme.name} is unstable at the stiffest spring."
        if beyond
        else "",
    )


def round_down(value: float, digits: int = 3) -> float:
    """The next smaller number of so many significant digits.

    >>> round_down(0.00126999), round_down(2.5)
    (0.00126, 2.5)
    """
    unit = 10.0 ** (math.floor(math.log10(value)) - digits + 1)
    return float(f"{math.floor(value / unit * (1 + 1e-12)) * unit:.{digits}g}")


def describe_shorter_steps(case: Case, run: Kind, solver: str, curves: Curves) -> Iterator[Reason]:
    """A remark on the longest step of dt/2, dt/4, .. with which the run, if short, succeeds."""
    if not (step := time_step_of(run, curves)):
        return
    shortest, length = step, float(np.ptp(run_samples(case, run)))
    for _ in range(TRIED_HALVINGS):
        if run_steps(case, run, 2 * length / shortest) > MAX_RUN_STEPS:
            break
        changed = with_half_step(case, run, solver, shortest)
        shortest /= 2
        try:
            solve_here(changed, run, solver)
        except RUN_EXCEPTIONS:
            continue
        words = f"{number(shortest)} s instead of {number(step)} s"
        yield Reason(
            f"with a time step of {words} it comes to its end",
            f"Make the time step {number(1e3 * shortest)} ms; it is {number(1e3 * step)} ms.",
        )
        return
    if shortest < step:
        yield Reason(f"with time steps down to {number(shortest)} s it fails as well")
