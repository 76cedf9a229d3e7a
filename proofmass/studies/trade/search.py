"""Search for the cheapest setting with a small enough error, without measuring all settings.

A family is an engine with values of all parameters but the time step: an integrator, the stiffness
of loops, the number of iterations of the solver.  A family starts with one step from sample to
sample, or with the step of the model if its settings are the model's own.  The next step is the one
that should be good enough by the order of the last errors.  A family is followed as long as that
step should not cost much more than the cheapest setting that is good enough already (`COST_RATIO`).
The cheapest settings are then timed again in rounds.

What a run costs is counted from its steps (`StudyRow.cost`), so that the search is the same on
every machine; measured times are information.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import takewhile
from math import inf, isclose, isfinite, isnan

from proofmass.base.clock import processor_time
from proofmass.base.errors import InputError
from proofmass.case.case import Case
from proofmass.reference.evaluate import reference_for
from proofmass.reference.samples import run_samples
from proofmass.run.solve import describe_dynamics, prescribed_run
from proofmass.sim.engines import engine_of
from proofmass.sim.protocol.curves import Curves
from proofmass.sim.protocol.run import whole_steps
from proofmass.sim.protocol.settings import first_number
from proofmass.sim.protocol.tuning import Recipe
from proofmass.studies.bounded import call_bounded
from proofmass.studies.bracket import Bracket
from proofmass.studies.measure import StudyRun
from proofmass.studies.record import Setting, StudyRow
from proofmass.studies.references import has_one_reference
from proofmass.studies.store import Store, task_key
from proofmass.studies.study import (
    LONG_RUN_SECONDS,
    Study,
)
from proofmass.studies.trade.series import (
    AIMED_ERROR_SHARE,
    MIN_FALLING_ORDER,
    OTHER_MOTION_ERROR,
    Limits,
    convergence_order,
    setting_at_step,
)
from proofmass.studies.trade.varied import own_settings_series
from proofmass.verdict.outcome import NOT_RUN_OUTCOMES, Outcome

TIMING_REPEATS = 2  # repeats, for their times, of each setting that may be the cheapest
CLOSE_STEP_RATIO = 1.25
"""Ratio of a step to a good enough one below which no step between them is tried."""
MAX_REFINEMENT_RATIO = 30.0  # largest ratio of a step to the next one
COST_RATIO = 2.0
"""Ratio to the cost of the cheapest setting up to which settings are followed, and timed again in
rounds: counted costs do not tell smaller ratios apart."""
LONG_RUN_COST_RATIO = 1.3
"""The same ratio for long runs (`LONG_RUN_SECONDS`), of which fewer are affordable."""
PARALLEL_RUN_SECONDS = 0.5
"""Expected time [s] from which only the cheapest run is made, and others if it is not enough."""
YIELDING_COST_RATIO = 40.0
"""The same ratio for drives that yield: the cheapest setting with an ideal drive may cost much less
than the cheapest one with such drives."""
DEFAULTS_COST_RATIO = 8.0
"""The same ratio for the engine's defaults, which are measured for comparison."""
TRIAL_STEP_RATIO = 4.0
"""Ratio of a step to the next one that is tried to see whether an order holds."""
MAX_BAD_STEPS = 3  # steps without a run or an order after which a family may be given up
STUCK_CHANGE = 0.01
"""Relative change of an error above `OTHER_MOTION_ERROR` over `MAX_BAD_STEPS` steps, each a
quarter of the previous one, up to which finer steps are taken not to help: the engine follows
another motion."""
MIN_LOG_DISTANCE = 1 / 3
"""Least distance of a step between two others from each of them, on the logarithmic scale, over the
distance of these two."""
SAME_ERROR_TOLERANCE = 1e-3
"""Relative difference of errors up to which two families count as equal."""
SAME_ORDER_TOLERANCE = 0.2  # difference of two orders up to which they count as equal
MAX_DRIVE_REFINEMENTS = 3
"""Settings that are refined together because their drives are not accurate enough."""
MAX_RUNS_OF_FAMILY = 12  # largest number of runs of a family
GIVEN_UP_RATIO = 3.0
"""Ratio of the processor time of a run to the largest counted one at which it is given up: a busy
machine doubles the processor time of a run, whose caches others empty."""
REFERENCE_TIME_FACTOR = 5.0
"""Factor on the time of the reference that a run gets in addition: the first runs evaluate the
reference at the prescribed motion, and each run that at its own, while others run."""


@dataclass
class SettingFamily:
    """Settings of one engine that differ in the time step, and the rows measured so far.

    ``at(step)`` is the setting with a step [s].  `plain` marks the engine's own defaults.  The
    first step is `first`, or else `sample`, the time from sample to sample [s].
    """

    engine: str
    name: str
    at: Callable[[float], Setting]
    sample: float
    plain: bool = False
    first: float | None = None
    rows: list[StudyRow] = field(default_factory=list)

    def step(self, wanted: float) -> float:
        """The longest step up to the wanted one that fits its samples [s]; see `whole_step`."""
        return whole_step(self.sample, wanted)

    def next(self, error_kind: str, needed: float, limit: float) -> float | None:
        """The step to try next [s]; None if none should be good enough within `limit` [s]."""
        if not self.rows:
            return self.first or self.sample
        if len(self.rows) >= MAX_RUNS_OF_FAMILY or any(
            row.outcome in (Outcome.TIMED_OUT, *NOT_RUN_OUTCOMES) for row in self.rows
        ):
            return None
        rows = sorted(self.rows, key=lambda row: -row.value)
        if len(rows) >= MAX_BAD_STEPS and all(row.outcome != Outcome.RAN for row in rows):
            return None
        if row_error(rows[0], error_kind) <= needed:
            return None
        by_step = {row.value: row for row in rows}
        steps = Bracket.find_first(
            (step, row_error(row, error_kind) <= needed) for step, row in by_step.items()
        )
        if isnan(steps.holds):
            step = self.step_by_order(rows, error_kind, needed, limit)
        elif self.plain:
            return None
        else:
            step = step_between(by_step[steps.breaks], by_step[steps.holds], error_kind, needed)
        if step is None:
            return None
        step = self.step(step)
        if any(abs(row.value - step) < 1e-9 * step for row in rows):
            return None
        return step if self.cost(step) <= limit else None

    def cost(self, step: float) -> float:
        """Expected cost of a run with a step [s], from that of the finest step that ran."""
        ran = [row for row in self.rows if isfinite(row.cost)]
        finest = min(ran, key=lambda row: row.value, default=None)
        return finest.cost * finest.value / step if finest else 0.0

    def step_by_order(
        self, rows: list[StudyRow], error_kind: str, needed: float, limit: float
    ) -> float | None:
        """The finer step [s] that should be good enough by the order of the last errors, or None.

        If a run with that step should take longer than the limit [s], a step `TRIAL_STEP_RATIO`
        times finer is tried to see whether the order holds; if the order is known to hold, no step
        is tried.
        """
        last = rows[-1]
        # The engine follows another motion, whose error shows no order: large steps lead out of
        # it soonest.
        if not row_error(last, error_kind) < OTHER_MOTION_ERROR:
            return None if is_stuck(rows, error_kind) else last.value / TRIAL_STEP_RATIO
        # This is the first error of the right motion: a second one is needed for an order, and a
        # halving costs least.
        if len(rows) < 2 or not row_error(rows[-2], error_kind) < OTHER_MOTION_ERROR:
            return last.value / 2.0
        falls = order_between(rows[-2], last, error_kind)
        if falls < MIN_FALLING_ORDER:  # one more refinement, then it counts as a floor
            is_flat = (
                len(rows) > 2 and order_between(rows[-3], last, error_kind) < MIN_FALLING_ORDER
            )
            return None if is_flat else last.value / 2.0
        # The error goes with step ** order. The aim is below what is needed, as orders are inexact.
        wanted = last.value * (AIMED_ERROR_SHARE * needed / row_error(last, error_kind)) ** (
            1 / falls
        )
        # The order of two steps may be too low by chance, as where the error changes its sign. A
        # family is given up for its cost only if three steps agree on the order.
        if self.cost(wanted) > limit:
            order_holds = (
                len(rows) > 2
                and abs(order_between(rows[-3], rows[-2], error_kind) - falls)
                < SAME_ORDER_TOLERANCE
            )
            return None if order_holds else last.value / TRIAL_STEP_RATIO
        # An order of two steps is not trusted over more than one and a half decades.
        return max(wanted, last.value / MAX_REFINEMENT_RATIO)


def whole_step(sample: float, wanted: float) -> float:
    """The longest step up to the wanted one with a whole number of steps from sample to sample [s].

    >>> whole_step(1.0, 0.3), whole_step(1.0, 0.2)
    (0.25, 0.2)
    """
    return sample / whole_steps(sample, wanted)


def step_between(coarse: StudyRow, fine: StudyRow, error_kind: str, needed: float) -> float | None:
    """A step between one that is not good enough and one that is; None if there is little to gain.

    There is little to gain if the two steps are close (`CLOSE_STEP_RATIO`).  For long runs this is
    also so if, by the order of the two errors, the step that is just good enough is close to the
    fine one; the order is taken as 1 at most, since a very large error at the coarse step makes it
    too high.  Short runs are tried in any case, since errors need not fall evenly.
    """
    bracket = Bracket(fine.value, coarse.value)
    if bracket.ratio < CLOSE_STEP_RATIO:
        return None
    # Without an order that the two errors show nothing is known but that the limit is between.
    if not row_error(coarse, error_kind) < OTHER_MOTION_ERROR:
        return bracket.middle
    falls = order_between(coarse, fine, error_kind)
    if falls < MIN_FALLING_ORDER:
        return bracket.middle
    wanted = fine.value * (
        AIMED_ERROR_SHARE * needed / max(row_error(fine, error_kind), 1e-17)
    ) ** (1 / falls)
    has_little_gain = AIMED_ERROR_SHARE * needed < row_error(
        fine, error_kind
    ) * CLOSE_STEP_RATIO ** min(falls, 1.0)
    if has_little_gain and fine.cost > LONG_RUN_SECONDS:
        return None
    # A wrong order may point outside the bracket, or so near to an end that nothing is learnt.
    return bracket.inside(wanted, MIN_LOG_DISTANCE)


def is_stuck(rows: Sequence[StudyRow], error_kind: str) -> bool:
    """Whether the errors of the last steps hardly change, so that finer steps will not help."""
    last = [row_error(row, error_kind) for row in rows[-MAX_BAD_STEPS:]]
    return len(last) == MAX_BAD_STEPS and max(last) - min(last) <= STUCK_CHANGE * min(last)


def row_error(row: StudyRow, error_kind: str) -> float:
    """The error of a row; infinite if it has none."""
    value = row.reached(error_kind)
    return value if row.outcome == Outcome.RAN and isfinite(value) else inf


def order_between(coarse: StudyRow, fine: StudyRow, error_kind: str) -> float:
    """The order of convergence that two rows show; minus infinity where the finer one fails."""
    return convergence_order(
        (coarse.value, row_error(coarse, error_kind)),
        (fine.value, max(row_error(fine, error_kind), 1e-300)),
    )


def list_families(case: Case, engine: str = "") -> Iterator[SettingFamily]:
    """The families to search in dynamics, of one engine or of all engines of the case."""
    times = run_samples(case, "dynamics")
    sample = float(times[1] - times[0])
    description = describe_dynamics(case)
    for series in own_settings_series(case, "dynamics"):
        if series.engine in (engine or series.engine):
            (setting,) = series.settings
            yield SettingFamily(
                series.engine,
                series.name,
                vary_step(setting),
                sample,
                first=min(first_number(setting.parameters["timestep"]), sample),
            )
    for name in case.run["dynamics"].engines:
        if name in (engine or name):
            for recipe in engine_of(name).tuning.recipes(description):
                yield SettingFamily(
                    name, recipe.name, recipe_setting(name, recipe), sample, recipe.plain
                )


def vary_step(setting: Setting) -> Callable[[float], Setting]:
    """The function that gives a setting with another time step."""
    return lambda step: setting.with_parameters(timestep=step)


def recipe_setting(engine: str, recipe: Recipe) -> Callable[[float], Setting]:
    """The function that gives the setting of a recipe for a time step."""
    return lambda step: Setting(engine, {"timestep": step, **recipe.parameters(step)})


def search(
    case: Case,
    error_kind: str,
    needed: float,
    study: Study,
    engine: str = "",
    *,
    limits: Limits | None = None,
    cost_ratio: float = COST_RATIO,
    repeats: int = TIMING_REPEATS,
) -> list[StudyRow]:
    """Measure settings of dynamics until the cheapest one that is good enough is known.

    Parameters
    ----------
    case : Case
        A case with a dynamics run.
    error_kind, needed : str, float
        Kind of error, and the largest that is good enough, as a share of the reference's range [1].
    study : Study
        Where runs are kept, and who makes them; their limit of time follows from `limits`.
    engine : str, optional
        The only engine to search.
    limits : Limits, optional
        Counted time that each run, without its reference, and all runs together may take; the
        search updates how much they took.
    cost_ratio : float
        A family is followed while the expected cost of its next run is below this multiple of that
        of the cheapest setting that is good enough so far [1].
    repeats : int
        Number of repeats, for their times, of each of the cheapest settings.

    Returns
    -------
    list of StudyRow
        All settings that were measured.
    """
    found, limits = list(list_families(case, engine)), limits or Limits()
    longest = limits.longest
    reference_time = REFERENCE_TIME_FACTOR * stored_reference_seconds(case, study.store)
    study = replace(study, longest=GIVEN_UP_RATIO * longest + reference_time)
    while tasks := [
        task
        for family in found
        for task in next_runs(
            case, family, found, error_kind, needed, limits.longest_expected, cost_ratio
        )
    ]:
        tasks = select_affordable(select_cheap(tasks), found, limits.budget - limits.spent)
        limits.short = not tasks
        if limits.short:
            break
        limits.settings += len(tasks)
        rows = study.run([task for _, task in tasks], repeats=0)
        for (family, _), row in zip(tasks, rows, strict=True):
            family.rows.append(row)
            failed = longest if row.outcome == Outcome.TIMED_OUT else 0.0
            limits.spent += row.cost if isfinite(row.cost) else failed
        if has_one_reference(case, "dynamics") and any(
            row.outcome == Outcome.NO_REFERENCE for row in rows
        ):
            break  # all settings have the same reference
    rows = [row for family in found for row in family.rows]
    cheap = least_cost(rows, error_kind, needed)
    retiming_ratio = COST_RATIO if cheap < LONG_RUN_SECONDS else LONG_RUN_COST_RATIO
    timed = [
        row
        for row in rows
        if row_error(row, error_kind) <= needed and row.cost <= retiming_ratio * cheap
    ]
    for engine in dict.fromkeys(family.engine for family in found):
        default_rows = [
            row
            for family in found
            if family.plain and family.engine == engine
            for row in family.rows
            if row.outcome == Outcome.RAN
        ]
        if (
            default_rows
            and (compared := select_for_comparison(default_rows, error_kind, needed)) not in timed
        ):
            timed.append(compared)
    tasks_ = [
        StudyRun(
            case,
            "dynamics",
            Setting(row.engine, row.parameters),
            row.study,
            row.series,
            row.varied,
            row.value,
            key=row.key,
        )
        for row in timed
    ]
    again = study.run(tasks_, repeats=repeats)
    places = {id(row): k for k, row in enumerate(timed)}
    return [again[places[id(row)]] if id(row) in places else row for row in rows]


def select_for_comparison(
    default_rows: Sequence[StudyRow], error_kind: str, needed: float
) -> StudyRow:
    """Of rows with an engine's defaults the cheapest good enough one, or else the most accurate."""
    good = [row for row in default_rows if row_error(row, error_kind) <= needed]
    if good:
        return min(good, key=lambda row: row.cost)
    return min(default_rows, key=lambda row: row_error(row, error_kind))


def stored_reference_seconds(case: Case, store: Store) -> float:
    """`reference_seconds` of a case, measured once for a store; 0 if it is no part of a run."""
    task = StudyRun(case, "dynamics", Setting(case.run["dynamics"].engines[0]))
    if has_one_reference(case, "dynamics"):
        return 0.0
    return float(
        store.value(
            f"{task_key(task)}.reference.json",
            lambda: call_bounded(case, "dynamics", reference_seconds, case),
        )
    )


def reference_seconds(case: Case) -> float:
    """Processor time to evaluate the reference of dynamics [s]; called in a worker."""
    asked = prescribed_run(case, "dynamics")
    began = processor_time()
    with suppress(InputError):  # the runs will report the error
        reference_for(
            case,
            "dynamics",
            Curves(asked.x, {}, drive=asked.motion(asked.x) if asked.drives else None),
        )
    return processor_time() - began


def refine_for_drives(
    case: Case, tried: Iterable[tuple[StudyRow, float]], wanted: float
) -> list[StudyRun]:
    """Tasks with finer steps for settings whose drives are not accurate enough in programs.

    Parameters
    ----------
    case : Case
        A case with a dynamics run.
    tried : iterable of (StudyRow, float)
        Settings, and the errors of their programs, as shares of the reference's range [1].
    wanted : float
        Largest error that is good enough, as such a share [1].

    Returns
    -------
    list of StudyRun
        Runs of the settings with the least expected costs, at most `MAX_DRIVE_REFINEMENTS`.
        The step follows from the error, since a drive of a given gain yields in proportion to the
        square of the step.
    """
    asked = []
    sample = float(run_samples(case, "dynamics")[1] - run_samples(case, "dynamics")[0])
    for row, drive_error in tried:
        if wanted < drive_error < OTHER_MOTION_ERROR:
            finer = (
                max((AIMED_ERROR_SHARE * wanted / drive_error) ** 0.5, 1 / MAX_REFINEMENT_RATIO)
                * row.value
            )
            step = whole_step(sample, finer)
            asked.append(
                (
                    row.cost * row.value / step,
                    StudyRun(
                        case,
                        "dynamics",
                        setting_at_step(row, step),
                        row.study,
                        row.series,
                        row.varied,
                        step,
                    ),
                )
            )
    return [task for _, task in sorted(asked, key=lambda each: each[0])[:MAX_DRIVE_REFINEMENTS]]


def next_runs(
    case: Case,
    family: SettingFamily,
    every: Iterable[SettingFamily],
    error_kind: str,
    needed: float,
    longest_expected: float,
    cost_ratio: float,
) -> Iterator[tuple[SettingFamily, StudyRun]]:
    """The next run of a family with that family, or nothing if the family is given up."""
    best = least_cost(
        [
            row
            for one in every
            for row in one.rows
            if one.engine == family.engine or not family.plain
        ],
        error_kind,
        needed,
    )
    if not family.plain and (
        is_outdone(family, every, error_kind) or repeats_another(family, every, error_kind)
    ):
        return
    cost_ratio *= LONG_RUN_COST_RATIO / COST_RATIO if best > LONG_RUN_SECONDS else 1.0
    limit = min(longest_expected, (DEFAULTS_COST_RATIO if family.plain else cost_ratio) * best)
    step = family.next(error_kind, needed, limit)
    if step is not None and (
        family.plain or not coincides_with_another(family, every, error_kind, step)
    ):
        yield (
            family,
            StudyRun(case, "dynamics", family.at(step), "choose", family.name, "timestep", step),
        )


def is_outdone(family: SettingFamily, every: Iterable[SettingFamily], error_kind: str) -> bool:
    """Whether another family of the same engine is better, so that finer steps are no use.

    The other family has a smaller error in no more time, by more than the uncertainty of single
    runs, and its errors fall as fast.  If the last `MAX_BAD_STEPS` errors of the family are
    above `OTHER_MOTION_ERROR`, they show no order: then another family with an error well below
    that suffices.
    """
    last = sorted(family.rows, key=lambda row: -row.value)[-MAX_BAD_STEPS:]
    if len(last) < MAX_BAD_STEPS:
        return False
    *_, previous, finest = last
    falls = order_between(previous, finest, error_kind)
    if failed := all(row_error(row, error_kind) >= OTHER_MOTION_ERROR for row in last):
        largest_error = OTHER_MOTION_ERROR / COST_RATIO
    elif row_error(previous, error_kind) < OTHER_MOTION_ERROR:
        largest_error = row_error(finest, error_kind) / COST_RATIO ** max(1.0, falls)
    else:
        return False
    for other in every:
        rows = sorted(other.rows, key=lambda row: -row.value)
        if other is family or other.engine != family.engine or len(rows) < 2:
            continue
        is_better = any(
            row_error(row, error_kind) <= largest_error and row.cost <= finest.cost for row in rows
        )
        if is_better and (
            failed or order_between(rows[-2], rows[-1], error_kind) > falls - SAME_ORDER_TOLERANCE
        ):
            return True
    return False


def repeats_another(family: SettingFamily, every: Iterable[SettingFamily], error_kind: str) -> bool:
    """Whether an earlier family has the same error with the finest step of this one, for no more.

    This is decided only for long runs.
    Families with the engine's defaults do not count, since they are not refined once a step is good
    enough.
    """
    last = min(family.rows, key=lambda row: row.value, default=None)
    return (
        last is not None
        and last.cost > LONG_RUN_SECONDS
        and row_error(last, error_kind) < OTHER_MOTION_ERROR
        and any(
            isclose(row.value, last.value)
            and isclose(
                row_error(row, error_kind),
                row_error(last, error_kind),
                rel_tol=SAME_ERROR_TOLERANCE,
            )
            and row.cost <= LONG_RUN_COST_RATIO * last.cost
            for other in earlier_families(family, every)
            if not other.plain
            for row in other.rows
        )
    )


def coincides_with_another(
    family: SettingFamily, every: Iterable[SettingFamily], error_kind: str, step: float
) -> bool:
    """Whether an earlier family is the same as this one: at this step, and at a step that it ran.

    Parameters that depend on the step may be bounded, so that several families meet at the bound.
    """
    return any(
        other.at(step) == family.at(step)
        and any(
            row_error(row, error_kind) < OTHER_MOTION_ERROR
            and other.at(row.value) == family.at(row.value)
            for row in other.rows
        )
        for other in earlier_families(family, every)
    )


def earlier_families(
    family: SettingFamily, every: Iterable[SettingFamily]
) -> Iterator[SettingFamily]:
    """The families of the same engine that come before one in a list."""
    for other in takewhile(lambda one: one is not family, every):
        if other.engine == family.engine:
            yield other


def select_cheap(
    tasks: list[tuple[SettingFamily, StudyRun]],
) -> list[tuple[SettingFamily, StudyRun]]:
    """Of the next runs those that are made now: all short ones, and the cheapest of the long ones.

    The others wait until it is known whether one of these is good enough.
    """
    costs = [family.cost(task.value) for family, task in tasks]
    longest = max(PARALLEL_RUN_SECONDS, LONG_RUN_COST_RATIO * min(costs))
    return [each for each, cost in zip(tasks, costs, strict=True) if cost <= longest]


def select_affordable(
    tasks: list[tuple[SettingFamily, StudyRun]], every: Sequence[SettingFamily], left: float
) -> list[tuple[SettingFamily, StudyRun]]:
    """Of the next runs those that together are expected to take no more than is left [s].

    A family that has not run is expected to take as long as the slowest family of its engine.  If
    no family of an engine has run, those with the longest step are made, and the others wait.
    """
    found = []
    longest_steps: dict[str, float] = {}
    for family, task in tasks:
        longest_steps[family.engine] = max(longest_steps.get(family.engine, 0.0), task.value)
    for family, task in tasks:
        slowest = max(one.cost(task.value) for one in every if one.engine == family.engine)
        cost = family.cost(task.value) or slowest
        if cost <= left and (cost or isclose(task.value, longest_steps[family.engine])):
            found.append((family, task))
            left -= cost
    return found


def least_cost(rows: Iterable[StudyRow], error_kind: str, needed: float) -> float:
    """Cost of the cheapest row that is good enough [s]; infinite if none is."""
    return min(
        (row.cost for row in rows if row_error(row, error_kind) <= needed and row.cost > 0),
        default=inf,
    )
