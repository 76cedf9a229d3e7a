"""The study ``trade``: orders and error floors of convergence series, and what accuracy costs.

    study = trade([load_case("models/linkages/fourbar.toml")], Store(folder / "runs"), workers)
    write_study(study, folder)

Free motions are disturbed first: errors of chaotic ones are judged up to the horizon of the
trajectory. Then every convergence series is refined until its errors fall no further; each setting
runs once for its errors. The settings that may be on the Pareto front, and the engine's defaults,
with which they are compared, are run again in rounds for their processor times. Where a series may
be at an error floor, its step is halved twice. Where the halvings leave the error, and where a
series shows another order than theory expects, each possible cause is changed separately. Series of
a case and engine that are at floors with the same errors are at one floor: causes are changed in
the first of them only.
"""

import json
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import nullcontext
from dataclasses import asdict, dataclass, field
from itertools import product
from math import inf, isclose, isnan, nan
from pathlib import Path

from proofmass.base.errors import InputError
from proofmass.base.files import write_output
from proofmass.base.grouping import group_by
from proofmass.base.strict import Kind
from proofmass.base.wording import number
from proofmass.batch.pool import pool
from proofmass.case.case import Case
from proofmass.reference.reference import compiled_model
from proofmass.run.solve import MAX_FORCE_EVALUATIONS
from proofmass.sim.protocol.settings import first_number
from proofmass.sim.protocol.tuning import Perturbation
from proofmass.studies import DEFAULT_LONGEST_RUN
from proofmass.studies.measure import StudyRun
from proofmass.studies.record import KIND_UNITS, NAN, Setting, StudyRow, write_table
from proofmass.studies.run import LONG_RUN_SECONDS, Progress, run_tasks
from proofmass.studies.store import Store
from proofmass.studies.trade.choose import is_default
from proofmass.studies.trade.disturbed import (
    ROUNDING_CAUSE_SHARE,
    DisturbedMotion,
    disturb_motions,
    end_at_horizon,
    measure_rounding,
)
from proofmass.studies.trade.floor_cause import (
    ROUNDING_CAUSE,
    UNKNOWN_CAUSE,
    find_cause,
    format_factor,
    halved_settings,
    list_perturbations,
)
from proofmass.studies.trade.orders import expected_orders, is_unexpected, nearest_order
from proofmass.studies.trade.search import LONG_RUN_COST_RATIO
from proofmass.studies.trade.series import (
    MeasuredSeries,
    find_flat_point,
    find_least_error,
    is_floor,
    observed_order,
    points_before_slowdown,
)
from proofmass.studies.trade.varied import ConvergenceSeries, list_series
from proofmass.studies.trade.verdict import Verdict, comparable_settings
from proofmass.studies.trade.words import (
    format_end,
    format_reached,
    format_worsened,
    is_error_of_drives,
)
from proofmass.verdict.outcome import Outcome

SERIES_BUDGET = 0.5
"""Counted time of a run [s] after which its series ends; only slow engines reach it."""
FRONT_REPEATS = 2  # repeats, for their times, of each setting that may be on the Pareto front
FRONT_COST_RATIO = 1.5
"""Ratio of the cost of short runs to the cheapest; counted costs cannot rank smaller ratios."""
SAME_FLOOR_TOLERANCE = 0.01
"""Relative difference of errors of two settings of a case and engine that are at one floor."""
SeriesPlace = tuple[int, int]  # numbers of a series, and of a setting in it
PerturbedRows = dict[SeriesPlace, list[tuple[Perturbation, StudyRow]]]
HalvedRows = dict[SeriesPlace, list[StudyRow]]
Leaders = dict[SeriesPlace, SeriesPlace]
"""For each setting at a floor the first setting at the same floor, in which causes are changed."""


@dataclass(frozen=True)
class Trade:
    """Results of a study: rows of its settings and of the perturbed ones, verdicts on the series.

    The cases are those that were run; the run of a chaotic motion ends at its horizon.
    """

    rows: list[StudyRow]
    perturbed: list[StudyRow]
    verdicts: list[Verdict]
    cases: list[Case] = field(default_factory=list)


@dataclass
class CaseSeries:
    """A convergence series of one run of a case, with the rows measured so far."""

    case: Case
    run: Kind
    measured: MeasuredSeries
    motion: DisturbedMotion | None = None

    @property
    def series(self) -> ConvergenceSeries:
        """The convergence series that is measured."""
        return self.measured.series

    def orders(self, kind: str) -> tuple[float, float]:
        """The observed and the expected order of a kind of error; NaN where none is expected."""
        if not (expected_ones := expected_orders(self.case, self.run, self.series, kind)):
            return nan, nan
        observed_one = observed_order(self.measured.points(kind))
        return observed_one, nearest_order(expected_ones, observed_one)

    def floors(self) -> dict[str, int]:
        """For each kind of error that may be at a floor the number of the setting to examine.

        One setting is examined for all these kinds: the finest one that any of them needs.
        """
        found = {
            kind: self.measured.place(points[k][0])
            for kind in self.measured.kinds
            for points in (self.measured.points(kind),)
            if (k := find_flat_point(points)) is not None
        }
        last = max(found.values(), default=0)
        return dict.fromkeys(found, last)

    def rising_kinds(self) -> dict[str, int]:
        """Number of the finest setting, for each kind of error that grows at the series' end."""
        return {
            kind: self.measured.place(points[-1][0])
            for kind in self.measured.kinds
            for points in (self.measured.points(kind),)
            if find_least_error(points) is not None
        }

    def unexpected_order_setting(self, kind: str) -> int | None:
        """Number of the finest setting before a floor if the order is not as expected, or None."""
        return (
            self.measured.place(points_before_slowdown(self.measured.points(kind))[-1][0])
            if is_unexpected(*self.orders(kind))
            else None
        )

    def task(self, k: int) -> StudyRun:
        """The run of setting number k."""
        setting = self.series.settings[k]
        return StudyRun(
            self.case,
            self.run,
            setting,
            "trade",
            self.series.name,
            self.series.varied,
            first_number(setting.parameters[self.series.varied]),
            key=self.measured.rows[k].key if k < len(self.measured.rows) else "",
        )

    def row(self, size: float) -> StudyRow:
        """The row of the setting with a size."""
        return self.measured.rows[self.measured.place(size)]


def trade(
    cases: Iterable[Case],
    store: Store,
    workers: Executor | None = None,
    kind: Kind | None = None,
    *,
    budget: float = SERIES_BUDGET,
    longest: float = DEFAULT_LONGEST_RUN,
    repeats: int = FRONT_REPEATS,
    progress: Progress = lambda *_: None,
) -> Trade:
    """Measure errors and processor times of all convergence series of cases, and judge the series.

    Parameters
    ----------
    cases : iterable of Case
    store : Store
        Store of finished runs.
    workers : Executor, optional
        See `proofmass.studies.run.pool`.
    kind : {"sweep", "dynamics", "equilibrium"}, optional
        Which run of the cases; if not given, the first of dynamics, equilibrium and sweep that a
        case has.
    budget : float
        Processor time of a run after which its series ends [s].
    longest : float
        Processor time after which a run is given up [s].
    repeats : int
        Number of repeats, for processor times, of each setting that may be on the Pareto front.
    progress : callable
        Called as ``progress(label, done, total)``; the total grows with the series.

    Raises
    ------
    InputError
        A case has no such run, or its model has an error.
    """
    with nullcontext(workers) if workers else pool() as executor:
        cases = list(cases)
        kinds = [kind_to_study(case, kind) for case in cases]
        motions = disturb_motions(cases, kinds, store, executor, longest)
        cases = [end_at_horizon(*each) for each in zip(cases, kinds, motions, strict=True)]
        all_series = [
            CaseSeries(case, which, MeasuredSeries(series), motion)
            for case, which, motion in zip(cases, kinds, motions, strict=True)
            for series in list_series(case, which)
        ]
        while batch := [one for one in all_series if not one.measured.done(budget)]:
            rows = run_tasks(
                [one.task(len(one.measured.rows)) for one in batch],
                store,
                executor,
                repeats=0,
                timeout=longest,
                progress=progress,
            )
            for one, row in zip(batch, rows, strict=True):
                one.measured.rows.append(row)
        rows = [row for one in all_series for row in one.measured.rows]
        rows = run_tasks(
            [one.task(k) for one in all_series for k in range(len(one.measured.rows))],
            store,
            executor,
            repeats=repeats,
            repeated={k for k, row in enumerate(rows) if is_default(row)}.union(
                find_near_front(rows)
            ),
            longest_repeated=budget,
            timeout=longest,
            progress=progress,
        )
        finer = halve_steps(all_series, store, executor, longest, progress)
        leaders = find_leaders(all_series, finer)
        perturbed = perturb_causes(all_series, leaders, store, executor, longest, progress)
        disturbed = measure_roundings(
            all_series, leaders, finer, perturbed, store, executor, longest
        )
        return Trade(
            rows,
            [
                *(row for found in finer.values() for row in found if row.study == "floor"),
                *(row for found in perturbed.values() for _, row in found),
            ],
            [
                judge_series(all_series, error, n, leaders, finer, perturbed, disturbed, budget)
                for n, one in enumerate(all_series)
                for error in one.measured.kinds
            ],
            cases,
        )


def find_near_front(rows: Sequence[StudyRow]) -> list[int]:
    """Numbers of the settings that may be on the Pareto front of their case and engine.

    A setting is one of them if for some kind of error no setting that is as accurate is cheaper by
    more than the factor `FRONT_COST_RATIO`, or `LONG_RUN_COST_RATIO` for runs longer than
    `LONG_RUN_SECONDS`.

    >>> times = [(1e-3, 0.01), (1e-3, 0.014), (1e-3, 0.02), (1e-4, 1.0), (1e-4, 1.2), (1e-4, 1.4)]
    >>> find_near_front([StudyRow("", "", "", "", "", "", 0.0, errors={"energy": e}, seconds=s,
    ...                      outcome=Outcome.RAN) for e, s in times])
    [0, 1, 3, 4]
    """
    numbers = {id(row): k for k, row in enumerate(rows)}
    groups = group_by(rows, lambda row: (row.case, row.engine))
    found = set[int]()
    for group, kind in product(groups.values(), KIND_UNITS):
        shortest = inf
        for row in sorted(
            comparable_settings(group, kind), key=lambda row: (row.errors[kind], row.cost)
        ):
            shortest = min(shortest, row.cost)
            if (
                row.cost
                <= (FRONT_COST_RATIO if row.cost < LONG_RUN_SECONDS else LONG_RUN_COST_RATIO)
                * shortest
            ):
                found.add(numbers[id(row)])
    return sorted(found)


def kind_to_study(case: Case, kind: Kind | None) -> Kind:
    """The kind of run to study: the given one, else the first of three that the case has."""
    wanted: list[Kind] = [kind] if kind else ["dynamics", "equilibrium", "sweep"]
    for name in wanted:
        if name in case.run:
            return name
    raise case.error(f"run.{kind}", f"there is no such run; there are: {', '.join(case.run)}")


def find_leaders(all_series: Sequence[CaseSeries], finer: HalvedRows) -> Leaders:
    """For each setting at a floor, unchanged by halvings, the first setting at the same floor.

    Two settings of a case and engine are at the same floor if all kinds of errors that are at a
    floor in the later one are so in the first one too, and are equal there up to
    `SAME_FLOOR_TOLERANCE`.
    """
    kinds = {(n, k): kinds_at_floor(all_series[n], k, rows) for (n, k), rows in finer.items()}
    found: Leaders = {}
    for n, k in filter(kinds.__getitem__, kinds):
        own = all_series[n].measured.rows[k].errors
        found[n, k] = next(
            (
                (m, j)
                for (m, j), first in found.items()
                if (m, j) == first
                for other in (all_series[m],)
                if other.case is all_series[n].case
                and other.series.engine == all_series[n].series.engine
                and kinds[n, k] <= kinds[m, j]
                and all(
                    isclose(
                        own[kind], other.measured.rows[j].errors[kind], rel_tol=SAME_FLOOR_TOLERANCE
                    )
                    for kind in kinds[n, k]
                )
            ),
            (n, k),
        )
    return found


def halve_steps(
    all_series: list[CaseSeries],
    store: Store,
    workers: Executor,
    longest: float,
    progress: Progress,
) -> HalvedRows:
    """Rows with half and a quarter of the step, for all settings that may be at a floor."""
    places = [
        (n, k) for n, one in enumerate(all_series) for k in dict.fromkeys(one.floors().values())
    ]
    found: HalvedRows = {place: [] for place in places}
    asked = [
        ((n, k), setting)
        for n, k in places
        for one in (all_series[n],)
        for setting in halved_settings(
            one.run,
            one.series,
            one.series.settings[k],
            float(compiled_model(one.case).opt.timestep),
        )
    ]
    tasks = [
        StudyRun(
            one.case,
            one.run,
            setting,
            "floor",
            one.series.name,
            "halved",
            first_number(setting.parameters["timestep" if one.run == "dynamics" else "segments"]),
            timed=False,
        )
        for (n, _), setting in asked
        for one in (all_series[n],)
    ]
    for (place, _), row in zip(
        asked,
        run_tasks(tasks, store, workers, repeats=0, timeout=longest, progress=progress),
        strict=True,
    ):
        found[place].append(row)
    return found


def is_left_by_halvings(one: CaseSeries, k: int, kind: str, finer: Sequence[StudyRow]) -> bool:
    """Whether two halvings leave the error of setting number k, and it is asymptotic."""
    rows = [one.measured.rows[k], *finer]
    return is_floor([row.errors.get(kind, NAN) for row in rows if row.outcome == Outcome.RAN])


def kinds_at_floor(one: CaseSeries, k: int, finer: Sequence[StudyRow]) -> set[str]:
    """The kinds of errors of setting number k that are unchanged by two halvings of the step."""
    return {
        kind
        for kind, at in one.floors().items()
        if at == k and is_left_by_halvings(one, k, kind, finer)
    }


def perturb_causes(
    all_series: list[CaseSeries],
    leaders: Leaders,
    store: Store,
    workers: Executor,
    longest: float,
    progress: Progress,
) -> PerturbedRows:
    """Run each change of a possible cause at floors, and where an order is not the expected one.

    Among settings at the same floor the causes are changed in the first one.
    """
    places = dict.fromkeys(
        list(leaders.values())
        + [
            (n, k)
            for n, one in enumerate(all_series)
            for kind in one.measured.kinds
            if (k := one.unexpected_order_setting(kind)) is not None
        ]
    )
    asked = [
        (place, case, perturbation)
        for place in places
        for one in (all_series[place[0]],)
        for case, perturbation in list_perturbations(
            one.case,
            one.run,
            one.series.settings[place[1]],
            store.folder / "models",
            one.series.scaled,
        )
    ]
    tasks = [
        StudyRun(
            case,
            all_series[n].run,
            Setting(all_series[n].series.engine, one.parameters),
            "floor",
            all_series[n].series.name,
            one.cause,
            timed=False,
        )
        for (n, _), case, one in asked
    ]
    rows = run_tasks(tasks, store, workers, repeats=0, timeout=longest, progress=progress)
    found: PerturbedRows = {place: [] for place in places}
    for (place, _, perturbation), row in zip(asked, rows, strict=True):
        found[place].append((perturbation, row))
    return found


def measure_roundings(
    all_series: list[CaseSeries],
    leaders: Leaders,
    finer: HalvedRows,
    perturbed: PerturbedRows,
    store: Store,
    workers: Executor,
    longest: float,
) -> dict[SeriesPlace, dict[str, float]]:
    """Measure how far roundings move the results whose errors may be due to rounding.

    These are the results whose errors grow as the step becomes shorter, and those at a floor that
    no other cause explains.
    """
    places = {
        (n, k)
        for n, one in enumerate(all_series)
        if one.run == "dynamics"
        for k in one.rising_kinds().values()
    }
    places |= {
        (n, k)
        for n, k in leaders.values()
        for one in (all_series[n],)
        if one.run == "dynamics"
        for kind in kinds_at_floor(one, k, finer[n, k])
        if find_cause(one.measured.rows[k].errors[kind], perturbed[n, k], kind, True)[0]
        == UNKNOWN_CAUSE
    }
    futures = {
        place: workers.submit(measure_rounding, all_series[place[0]].task(place[1]), store, longest)
        for place in sorted(places)
    }
    return {place: future.result() for place, future in futures.items()}


def judge_series(
    all_series: Sequence[CaseSeries],
    kind: str,
    n: int,
    leaders: Leaders,
    finer: HalvedRows,
    perturbed: PerturbedRows,
    disturbed: Mapping[SeriesPlace, Mapping[str, float]],
    budget: float,
) -> Verdict:
    """Judge a series in one kind of error: order, error floor, or how far it came without a floor.

    Parameters
    ----------
    all_series, kind : sequence of CaseSeries, str
        All series of the study, and the kind of error.
    n : int
        Number of the series; the first part of each key of the mappings.
    leaders : mapping of SeriesPlace to SeriesPlace
        For each setting at a floor the setting in which causes were changed.
    finer, perturbed : mapping of SeriesPlace to list
        Rows with half and a quarter of the step, and with each possible cause changed, by setting.
    disturbed : mapping of SeriesPlace to mapping of str to float
        For each setting how far roundings move the result, by kind of error, as a share of the
        range [1].
    budget : float
        Processor time of a run after which its series ends [s].
    """
    one = all_series[n]
    rows, unexpected = one.measured.rows, one.unexpected_order_setting(kind)
    why = cause = evidence = ""
    floor = NAN
    if (k := one.floors().get(kind)) is not None:
        first = finer[n, k][0]
        half = first.errors.get(kind, NAN) if first.outcome == Outcome.RAN else NAN
        refinement = "halving the step" if one.run == "dynamics" else "twice as many segments"
        why = (
            f"{refinement} {format_factor(rows[k].errors[kind] / half)}"
            if half > 0
            else f"{refinement}: {first.outcome}"
        )
        if is_left_by_halvings(one, k, kind, finer[n, k]):
            place = leaders[n, k]
            leader, row = all_series[place[0]], all_series[place[0]].measured.rows[place[1]]
            cause, evidence = find_cause(row.errors[kind], perturbed[place], kind, at_floor=True)
            why = "none of the changed causes changes it"
            floor = rows[k].errors[kind]
            if cause == UNKNOWN_CAUSE:
                cause, rounding_evidence = judge_rounding(row, kind, disturbed.get(place, {}))
                evidence = "; ".join(filter(None, (evidence, rounding_evidence)))
            if leader is not one and evidence:
                evidence = f"the same errors as {leader.series.name}, in which {evidence}"
            evidence = "; ".join(filter(None, (evidence, format_drive_error(rows[k], kind))))
    elif (k := one.rising_kinds().get(kind)) is not None:
        points = one.measured.points(kind)
        cause, evidence = judge_rounding(rows[k], kind, disturbed.get((n, k), {}))
        why, floor = "finer settings are worse", min(error for _, error in points)
    has_cause = bool(cause) and cause != UNKNOWN_CAUSE
    remark = (
        ""
        if unexpected is None
        else ": ".join(
            filter(None, find_cause(rows[unexpected].errors[kind], perturbed[n, unexpected], kind))
        )
    )
    motion = one.motion
    end = format_end(one.measured, budget)
    return Verdict(
        one.case.name,
        one.run,
        one.series.engine,
        one.series.name,
        kind,
        *one.orders(kind),
        floor if has_cause else NAN,
        cause if has_cause else "",
        evidence if has_cause else "",
        remark,
        "" if has_cause else format_reached(one.measured, kind, one.orders(kind)[1], why, end),
        "" if cause == ROUNDING_CAUSE else format_worsened(one.measured, kind),
        motion.words if motion else "",
        motion.horizon if motion else NAN,
    )


def format_drive_error(row: StudyRow, kind: str) -> str:
    """A sentence on the error at the prescribed motion, if most of it is that of the drives.

    >>> row = StudyRow("", "", "", "", "", "", 1.0, errors={"position": 1e-6},
    ...                asked={"position": 3e-5})
    >>> format_drive_error(row, "position")
    'at the motion that drives were asked for the error is 3e-5, since their own error is added'
    """
    if not is_error_of_drives(row, kind):
        return ""
    return (
        f"at the motion that drives were asked for the error is {number(row.asked[kind], 2)}, "
        "since their own error is added"
    )


def judge_rounding(row: StudyRow, kind: str, moved_by: Mapping[str, float]) -> tuple[str, str]:
    """Cause and evidence: rounding, if it moves the result by enough; else `UNKNOWN_CAUSE`."""
    moved, error = moved_by.get(kind, NAN), row.errors.get(kind, NAN)
    if not moved >= ROUNDING_CAUSE_SHARE * error:
        return UNKNOWN_CAUSE, ""
    return ROUNDING_CAUSE, (
        f"roundings of masses and start move the result by {number(moved, 2)} where "
        f"its error is {number(error, 2)}"
    )


def describe_limits(longest: float) -> str:
    """A sentence on the limits of a study: where series end, and when runs are given up."""
    return (
        f"Limits: a convergence series ends at {number(MAX_FORCE_EVALUATIONS)} evaluations of "
        f"forces, after a run of more than {number(SERIES_BUDGET)} s, or where its errors no "
        f"longer fall; a run is given up after {number(longest)} s (--longest)."
    )


def least_cost(rows: Iterable[StudyRow], kind: str, error: float) -> float:
    """Processor time of the cheapest row with an error of at most `error` [s]; NaN if there is
    none."""
    return min(
        (
            row.seconds
            for row in rows
            if row.outcome == Outcome.RAN and row.errors.get(kind, nan) <= error
        ),
        default=nan,
    )


def write_study(study: Trade, folder: Path) -> None:
    """Write ``trade.csv``, ``verdicts.json`` and, if causes were changed, ``floors.csv``."""
    write_table(study.rows, folder / "trade.csv")
    if study.perturbed:
        write_table(study.perturbed, folder / "floors.csv")
    records = [
        {k: v for k, v in asdict(one).items() if not (isinstance(v, float) and isnan(v))}
        for one in study.verdicts
    ]
    write_output(folder / "verdicts.json", json.dumps(records, indent=1, allow_nan=False))


def read_verdicts(file: Path) -> list[Verdict]:
    """The verdicts that `write_study` wrote.

    Raises
    ------
    InputError
        The file is not one that this version wrote.
    """
    try:
        return [Verdict(**one) for one in json.loads(file.read_text(encoding="utf-8"))]
    except (TypeError, ValueError):
        raise InputError(
            file,
            "",
            "not the verdicts that this version writes; run proofmass trade "
            "with that folder again, which keeps its runs",
        ) from None
