"""The study ``trade``: orders and error floors of convergence series, and what accuracy costs.

    study = Study(Store(folder / "runs"), workers)
    write_study(trade([load_case("models/linkages/fourbar.toml")], study), folder)

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
from dataclasses import asdict, dataclass, field, replace
from itertools import product
from math import inf, isnan, nan
from pathlib import Path
from typing import NamedTuple

from proofmass.base.errors import InputError
from proofmass.base.files import write_output
from proofmass.base.grouping import group_by
from proofmass.base.strict import Kind
from proofmass.base.wording import number
from proofmass.case.case import Case
from proofmass.reference.case_model import compiled_model
from proofmass.run.solve import MAX_FORCE_EVALUATIONS
from proofmass.sim.protocol.settings import first_number
from proofmass.studies import DEFAULT_LONGEST_RUN
from proofmass.studies.measure import StudyRun
from proofmass.studies.record import KIND_UNITS, NAN, Setting, StudyRow, write_table
from proofmass.studies.study import LONG_RUN_SECONDS, Study
from proofmass.studies.trade.case_series import CaseSeries, MeasuredSetting
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
    format_factor,
    halved_settings,
    list_perturbations,
)
from proofmass.studies.trade.search import LONG_RUN_COST_RATIO
from proofmass.studies.trade.series import (
    MeasuredSeries,
)
from proofmass.studies.trade.varied import list_series
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


@dataclass(frozen=True)
class Trade:
    """Results of a study: rows of its settings and of the perturbed ones, verdicts on the series.

    The cases are those that were run; the run of a chaotic motion ends at its horizon.
    """

    rows: list[StudyRow]
    perturbed: list[StudyRow]
    verdicts: list[Verdict]
    cases: list[Case] = field(default_factory=list)


def trade(
    cases: Iterable[Case],
    study: Study,
    kind: Kind | None = None,
    *,
    budget: float = SERIES_BUDGET,
    repeats: int = FRONT_REPEATS,
) -> Trade:
    """Measure errors and processor times of all convergence series of cases, and judge the series.

    Parameters
    ----------
    cases : iterable of Case
    study : Study
        Where runs are kept, who makes them, and how long they may take; the total of its
        ``progress(label, done, total)`` grows with the series.
    kind : {"sweep", "dynamics", "equilibrium"}, optional
        Which run of the cases; if not given, the first of dynamics, equilibrium and sweep that a
        case has.
    budget : float
        Processor time of a run after which its series ends [s].
    repeats : int
        Number of repeats, for processor times, of each setting that may be on the Pareto front.

    Raises
    ------
    InputError
        A case has no such run, or its model has an error.
    """
    with study.working() as working:
        study = replace(working, longest=study.longest or DEFAULT_LONGEST_RUN)
        found = measure_series(cases, study, kind, budget, repeats)
        examining_rows = examine_floors(found.series, study)
        verdicts = [
            judge_series(one, error, budget) for one in found.series for error in one.measured.kinds
        ]
        return Trade(found.rows, examining_rows, verdicts, found.cases)


class SeriesOfCases(NamedTuple):
    """The convergence series of cases: the cases, up to their horizons, how each motion responds to
    a disturbed start, all series, and the rows of their settings."""

    cases: list[Case]
    motions: list[DisturbedMotion | None]
    series: list[CaseSeries]
    rows: list[StudyRow]


def measure_series(
    cases: Iterable[Case], study: Study, kind: Kind | None, budget: float, repeats: int
) -> SeriesOfCases:
    """Measure errors and processor times of all convergence series of cases; see `trade`."""
    cases = list(cases)
    kinds = [kind_to_study(case, kind) for case in cases]
    motions = disturb_motions(cases, kinds, study)
    cases = [end_at_horizon(*each) for each in zip(cases, kinds, motions, strict=True)]
    all_series = [
        CaseSeries(case, which, MeasuredSeries(series), motion)
        for case, which, motion in zip(cases, kinds, motions, strict=True)
        for series in list_series(case, which)
    ]
    refine_series(all_series, study, budget)
    return SeriesOfCases(
        cases, motions, all_series, time_settings(all_series, study, budget, repeats)
    )


def refine_series(all_series: Sequence[CaseSeries], study: Study, budget: float) -> None:
    """Run the next setting of each series that has not ended, until all have ended."""
    while batch := [one for one in all_series if not one.measured.done(budget)]:
        rows = study.run([one.task(len(one.measured.rows)) for one in batch], repeats=0)
        for one, row in zip(batch, rows, strict=True):
            one.measured.rows.append(row)


def time_settings(
    all_series: Sequence[CaseSeries], study: Study, budget: float, repeats: int
) -> list[StudyRow]:
    """Run the settings again that may be on the Pareto front, and the defaults, for their times."""
    rows = [row for one in all_series for row in one.measured.rows]
    defaults = {k for k, row in enumerate(rows) if is_default(row)}
    return study.run(
        [one.task(k) for one in all_series for k in range(len(one.measured.rows))],
        repeats=repeats,
        repeated=defaults.union(find_near_front(rows)),
        longest_repeated=budget,
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


def examine_floors(all_series: Sequence[CaseSeries], study: Study) -> list[StudyRow]:
    """Make the further runs that show floors and their causes; their rows, for the table."""
    halved = halve_steps(all_series, study)
    find_leaders([setting for one in all_series for setting in one.at_floors()])
    perturbed = perturb_causes(all_series, study)
    measure_roundings(all_series, study)
    return [*halved, *perturbed]


def halve_steps(all_series: Iterable[CaseSeries], study: Study) -> list[StudyRow]:
    """Run all settings that may be at a floor with half and a quarter of their steps; the rows."""
    asked = [
        (one, setting)
        for series in all_series
        for one in series.at_floors()
        for setting in halved_settings(
            series.run,
            series.series,
            one.setting,
            float(compiled_model(series.case).opt.timestep),
        )
    ]
    tasks = [
        StudyRun(
            one.of.case,
            one.of.run,
            setting,
            "floor",
            one.of.series.name,
            "halved",
            first_number(
                setting.parameters["timestep" if one.of.run == "dynamics" else "segments"]
            ),
            timed=False,
        )
        for one, setting in asked
    ]
    rows = study.run(tasks, repeats=0)
    for (one, _), row in zip(asked, rows, strict=True):
        one.halved.append(row)
    return rows


def find_leaders(settings: Iterable[MeasuredSetting]) -> None:
    """Find the leader of each setting at a floor: the first setting at the same floor.

    The causes of a floor are then changed once, and not in each of its settings.
    """
    leaders = list[MeasuredSetting]()
    for setting in settings:
        if setting.kinds_at_floor:
            setting.leader = next((one for one in leaders if one.leads(setting)), setting)
            if setting.leader is setting:
                leaders.append(setting)


def perturb_causes(all_series: Sequence[CaseSeries], study: Study) -> list[StudyRow]:
    """Run each change of a possible cause at floors, and where an order is not the expected one.

    Among settings at the same floor the causes are changed in the first one.
    """
    unexpected = [
        one.setting(k)
        for one in all_series
        for kind in one.measured.kinds
        if (k := one.unexpected_order_setting(kind)) is not None
    ]
    asked = [
        (setting, case, perturbation)
        for setting in dict.fromkeys([*floor_leaders(all_series), *unexpected])
        for case, perturbation in list_perturbations(
            setting.of.case,
            setting.of.run,
            setting.setting,
            study.models,
            setting.of.series.scaled,
        )
    ]
    tasks = [
        StudyRun(
            case,
            setting.of.run,
            Setting(setting.of.series.engine, one.parameters),
            "floor",
            setting.of.series.name,
            one.cause,
            timed=False,
        )
        for setting, case, one in asked
    ]
    rows = study.run(tasks, repeats=0)
    for (setting, _, perturbation), row in zip(asked, rows, strict=True):
        setting.perturbed.append((perturbation, row))
    return rows


def floor_leaders(all_series: Iterable[CaseSeries]) -> list[MeasuredSetting]:
    """The settings that lead others at a floor, or are alone at one."""
    examined = [setting for one in all_series for setting in one.examined.values()]
    return list(dict.fromkeys(one.leader for one in examined if one.leader))


def measure_roundings(all_series: Iterable[CaseSeries], study: Study) -> None:
    """Measure how far roundings move the results whose errors may be due to rounding.

    These are the results whose errors grow as the step becomes shorter, and those at a floor that
    no other cause explains.
    """
    in_time = [one for one in all_series if one.run == "dynamics"]
    rising = [one.setting(k) for one in in_time for k in one.rising_kinds().values()]
    unexplained = [
        setting
        for setting in floor_leaders(in_time)
        for kind in setting.kinds_at_floor
        if setting.cause_of(kind, at_floor=True)[0] == UNKNOWN_CAUSE
    ]
    settings = list(dict.fromkeys([*rising, *unexplained]))
    tasks = [setting.of.task(setting.k) for setting in settings]
    with study.working() as working:
        moved = working.call_each(
            measure_rounding, [(task, study.store, study.limit(task)) for task in tasks]
        )
    for setting, one in zip(settings, moved, strict=True):
        setting.disturbed = one


def judge_series(one: CaseSeries, kind: str, budget: float) -> Verdict:
    """Judge a series in one kind of error: order, error floor, or how far it came without a floor.

    Parameters
    ----------
    one : CaseSeries
        The series, with the settings that were examined in further runs.
    kind : str
        The kind of error.
    budget : float
        Processor time of a run after which its series ends [s].
    """
    unexpected = one.unexpected_order_setting(kind)
    why = cause = evidence = ""
    floor = NAN
    if (k := one.floors().get(kind)) is not None:
        setting = one.setting(k)
        why = format_halving(setting, kind)
        if setting.is_left_by_halvings(kind):
            cause, evidence = explain_floor(setting, kind)
            why, floor = "none of the changed causes changes it", setting.row.errors[kind]
    elif (k := one.rising_kinds().get(kind)) is not None:
        setting = one.setting(k)
        cause, evidence = judge_rounding(setting.row, kind, setting.disturbed)
        why = "finer settings are worse"
        floor = min(error for _, error in one.measured.points(kind))
    has_cause = bool(cause) and cause != UNKNOWN_CAUSE
    remark = (
        ""
        if unexpected is None
        else ": ".join(filter(None, one.setting(unexpected).cause_of(kind)))
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


def format_halving(setting: MeasuredSetting, kind: str) -> str:
    """A phrase on what half the step, or twice the segments, does to an error."""
    first = setting.halved[0]
    half = first.errors.get(kind, NAN) if first.outcome == Outcome.RAN else NAN
    refinement = "halving the step" if setting.of.run == "dynamics" else "twice as many segments"
    if half > 0:
        return f"{refinement} {format_factor(setting.row.errors[kind] / half)}"
    return f"{refinement}: {first.outcome}"


def explain_floor(setting: MeasuredSetting, kind: str) -> tuple[str, str]:
    """The cause of a floor, or `UNKNOWN_CAUSE`, and the evidence in words."""
    leader = setting.leader
    assert leader is not None  # an error of the setting is at a floor
    cause, evidence = leader.cause_of(kind, at_floor=True)
    if cause == UNKNOWN_CAUSE:
        cause, rounding_evidence = judge_rounding(leader.row, kind, leader.disturbed)
        evidence = "; ".join(filter(None, (evidence, rounding_evidence)))
    if leader.of is not setting.of and evidence:
        evidence = f"the same errors as {leader.of.series.name}, in which {evidence}"
    return cause, "; ".join(filter(None, (evidence, format_drive_error(setting.row, kind))))


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


def least_seconds(rows: Iterable[StudyRow], kind: str, error: float) -> float:
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
