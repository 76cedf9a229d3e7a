"""Causes in the settings of an engine: its time step, its segments, and what another run has."""

from collections.abc import Iterable, Iterator, Mapping
from typing import Any, cast

import numpy as np

from proofmass.base.strict import Kind
from proofmass.base.wording import format_list, number
from proofmass.case.case import Case
from proofmass.evidence.diagnosis.explanation import FINER_KIND, Explanation
from proofmass.evidence.diagnosis.fault import Fault, FaultValue, sidecar_fault
from proofmass.evidence.diagnosis.fit import (
    RUN_EXCEPTIONS,
    ChannelCurves,
    Residuals,
    SearchBudget,
    remaining_share,
    run_steps,
)
from proofmass.run.solve import describe_dynamics, settings_of, solve_here
from proofmass.sim.engines import engine_of
from proofmass.sim.protocol.curves import Curves
from proofmass.sim.protocol.settings import ParameterValues
from proofmass.sim.protocol.tuning import STEP_CAUSE, Perturbation

FALLING_SHARE = 0.6
"""Share of a difference that half a time step leaves if the error is of order 3/4."""
HIGHEST_ORDER = 6  # highest order of an integrator
WORSENING_FACTOR = 1.1  # factor on the difference above which a change is said to make it larger
MAX_SETTING_STEPS = 600_000
"""Steps times degrees of freedom that may be spent on settings in which runs differ: 6 s."""
SETTING_KIND = "setting"


def finer_causes(residuals: Residuals) -> Iterator[tuple[Explanation | None, str]]:
    """A cause or a remark on half the time step, and one on twice as many segments of rods.

    The run is made again for each, if it was short.
    """
    case, run, solver = residuals.case, residuals.run, residuals.solver
    if not residuals.can_run_again:
        return
    if step := time_step_of(run, residuals.curves):
        words = f"a time step of {number(step / 2)} s, not {number(step)} s,"
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
            yield Explanation(FINER_KIND, words, falling, (), left, len(residuals.differing))


def setting_changes(residuals: Residuals) -> list[Perturbation]:
    """Changes of an engine's settings, other than the time step, that should reduce its error."""
    case, run, solver = residuals.case, residuals.run, residuals.solver
    if run != "dynamics" or not residuals.can_run_again:
        return []
    engine = engine_of(solver)
    own = engine.settings.read(settings_of(case, run, solver)).model_dump(exclude_unset=True)
    every = engine.tuning.perturbations(own, describe_dynamics(case), scaled=False)
    return [one for one in every if one.better and one.cause != STEP_CAUSE]


def time_step_of(run: Kind, curves: Curves) -> float:
    """The time step of a run [s]; 0 if it has none."""
    step = curves.settings.get("timestep")
    return step if run == "dynamics" and isinstance(step, float) else 0.0


def with_half_step(case: Case, run: Kind, solver: str, step: float) -> Case:
    """The settings of a case with half the time step for a solver."""
    tuning = engine_of(solver).tuning
    parameters = tuning.at_step(cast(ParameterValues, settings_of(case, run, solver)), step / 2)
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
    if share > WORSENING_FACTOR:
        return None, f"{words} makes the error {number(share)} times as large"
    falling = falling_channels(residuals, after)
    if not falling:
        return None, f"{words} leaves the error as it is"
    left_of = remaining_share(residuals.before, after, falling)
    if left_of < 0.5**HIGHEST_ORDER:
        return None, f"{words} leaves {number(left_of)} of the error, less than any order explains"
    text = f"{words.removesuffix(',')} (error of order {number(-np.log2(left_of), 2)})"
    return Explanation(FINER_KIND, text, falling, (), left_of, len(residuals.differing)), ""


def falling_channels(residuals: Residuals, after: ChannelCurves) -> tuple[str, ...]:
    """The channels that differ and whose largest difference falls to `FALLING_SHARE` of it."""
    return tuple(
        n
        for n in residuals.differing
        if n in after
        and np.abs(after[n]).max() <= FALLING_SHARE * np.abs(residuals.before[n]).max()
    )


def sibling_causes(residuals: Residuals) -> Iterator[Explanation]:
    """Causes in the settings by which a run differs from one of the same engine that agrees.

    The other runs of the engine that the sidecar asks for are made, and that of the engine without
    a variant.  Of the first that agrees those settings are looked for that decide: each by itself,
    and if none does, all that cannot be left as they are.
    """
    case, run, solver = residuals.case, residuals.run, residuals.solver
    engine = solver.partition(":")[0]
    others = [s for s in (engine, *case.run[run].solvers) if s.partition(":")[0] == engine]
    budget = SearchBudget(MAX_SETTING_STEPS, run_steps(case, run, residuals.curves.steps))
    for other in dict.fromkeys(others):
        if other == solver or run == "equilibrium":
            continue
        if not budget.lasts:
            residuals.log.untried.append(f"the settings of {other}")
            return
        budget.spend()
        if (agreeing := agreeing_run(residuals, other)) is None:
            continue
        residuals.log.tried.append(f"each setting in which {other} differs")
        yield from deciding_settings(residuals, other, agreeing, budget)
        return


def agreeing_run(residuals: Residuals, solver: str) -> Curves | None:
    """The run of another solver, if all its checked channels are within this one's tolerances."""
    try:
        curves = solve_here(residuals.case, residuals.run, solver)
    except RUN_EXCEPTIONS:
        return None
    found = Residuals(residuals.case, residuals.run, residuals.solver, curves)
    return None if found.differing or not found.allowed else curves


def deciding_settings(
    residuals: Residuals, other: str, agreeing: Curves, budget: SearchBudget
) -> Iterator[Explanation]:
    """The settings of an agreeing run with which the run agrees as well, as few as possible."""
    changes = differing_settings(residuals, agreeing)
    if not changes:
        return

    def with_those(keys: Iterable[str]) -> Explanation | None:
        budget.spend()
        return with_settings_of(residuals, other, {key: changes[key] for key in keys})

    for key in changes:
        if budget.lasts and (one := with_those([key])) and one.complete:
            yield one
            return
    needed = [*changes]
    for key in changes:
        rest = [k for k in needed if k != key]
        if rest and budget.lasts and (one := with_those(rest)) and one.complete:
            needed = rest
    if found := with_those(needed):
        yield found


def differing_settings(residuals: Residuals, agreeing: Curves) -> dict[str, Any]:
    """The settings that an agreeing run used with other values than this one."""
    mine, known = residuals.curves.settings, engine_of(residuals.solver).settings.model_fields
    return {
        key: value
        for key, value in agreeing.settings.items()
        if key in known and key in mine and mine[key] != value
    }


def with_settings_of(
    residuals: Residuals, other: str, changes: Mapping[str, Any]
) -> Explanation | None:
    """The explanation that another run has these settings; None if the run then fails."""
    case, solver = residuals.case, residuals.solver
    settings = {**settings_of(case, residuals.run, solver), **changes}
    try:
        after = residuals.with_changed_case(with_settings(case, solver, settings))
    except RUN_EXCEPTIONS:
        return None
    faults = [setting_fault(residuals, other, key, value) for key, value in changes.items()]
    words = format_list(fault.change for fault in faults)
    return residuals.judged(SETTING_KIND, words, after, faults=faults)


def setting_fault(residuals: Residuals, other: str, key: str, right: Any) -> Fault:
    """The fault of a setting of the run's solver, of which another run has the right value."""
    solver = residuals.solver
    keys, name = ["settings", solver, key], f"{key} of {solver}"
    wrong, wanted = setting_value(residuals.curves.settings[key]), setting_value(right)
    return sidecar_fault(residuals.case, keys, name, wrong, wanted, note=f"as in {other}")


def setting_value(value: object) -> FaultValue:
    """A setting as a number, or as text if it is none."""
    if isinstance(value, int | float) and not isinstance(value, bool):
        return float(value)
    return str(value)
