"""The study ``trade``: orders and error floors of convergence series, and what accuracy costs.

    study = trade([load_case("models/linkages/fourbar.toml")], Store(folder / "runs"), workers)
    write_study(study, folder)

Free motions are disturbed first: errors of chaotic ones are judged up to the horizon of the
trajectory. Then every convergence series is refined until its errors fall no further; each setting
runs once for its errors. The settings that may be on the Pareto front, and the engine's defaults,
with which they are compared, are run again in rounds for their wall times. Where a series may be at
an error floor, its step is halved twice. Where the halvings leave the error, and where a series
shows another order than theory expects, each possible cause is changed separately. Series of a case
and engine that are at floors with the same errors are at one floor: causes are changed in the first
of them only.
"""

import json
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import asdict, dataclass, field
from itertools import product
from math import inf, isclose, isnan, nan
from pathlib import Path

from proofmass.case import Case
from proofmass.errors import InputError
from proofmass.files import write_whole
from proofmass.outcome import Outcome
from proofmass.reference import compiled
from proofmass.sim.protocol import Perturbation, leading
from proofmass.strict import Kind
from proofmass.studies import LONGEST
from proofmass.studies.measure import StudyRun
from proofmass.studies.record import KINDS, NAN, Setting, StudyRow, write_table
from proofmass.studies.run import MOMENT, Progress, pool, run
from proofmass.studies.store import Store
from proofmass.studies.trade.choose import is_default
from proofmass.studies.trade.disturbed import ROUNDED, DisturbedMotion, motions_of, rounding, within
from proofmass.studies.trade.floor_cause import (
    ROUNDING,
    UNKNOWN,
    factor,
    halvings,
    judge,
    list_perturbations,
)
from proofmass.studies.trade.orders import expected, nearest, off
from proofmass.studies.trade.search import SURE
from proofmass.studies.trade.series import MeasuredSeries, clear, flat, halved, least, observed
from proofmass.studies.trade.varied import WORK, ConvergenceSeries, list_series
from proofmass.studies.trade.verdict import Verdict, able
from proofmass.studies.trade.words import by_drives, format_end, format_reached, format_worsened
from proofmass.wording import number

USUAL = 0.5  # [s] wall time of a run after which its series ends; reached by slow engines only
REPEATS = 2  # repeats, for wall times, of each setting that may be on the Pareto front
NEAR = 1.5  # ratio to the cheapest of short runs: single ones do not tell smaller ratios apart
SAME = 0.01
"""Relative difference of errors of two settings of a case and engine that are at one floor."""
SeriesPlace = tuple[int, int]  # numbers of a series, and of a setting in it
PerturbedRows = dict[SeriesPlace, list[tuple[Perturbation, StudyRow]]]
Halved = dict[SeriesPlace, list[StudyRow]]
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
        if not (wanted := expected(self.case, self.run, self.series, kind)):
            return nan, nan
        seen = observed(self.measured.points(kind))
        return seen, nearest(wanted, seen)

    def floors(self) -> dict[str, int]:
        """For each kind of error that may be at a floor the number of the setting to examine.

        One setting is examined for all these kinds: the finest one that any of them needs.
        """
        found = {
            kind: self.measured.place(points[k][0])
            for kind in self.measured.kinds
            for points in (self.measured.points(kind),)
            if (k := flat(points)) is not None
        }
        last = max(found.values(), default=0)
        return dict.fromkeys(found, last)

    def risen(self) -> dict[str, int]:
        """Number of the finest setting, for each kind of error that grows at the series' end."""
        return {
            kind: self.measured.place(points[-1][0])
            for kind in self.measured.kinds
            for points in (self.measured.points(kind),)
            if least(points) is not None
        }

    def odd(self, kind: str) -> int | None:
        """Number of the finest setting before a floor if the order is not as expected, or None."""
        return (
            self.measured.place(clear(self.measured.points(kind))[-1][0])
            if off(*self.orders(kind))
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
            leading(setting.parameters[self.series.varied]),
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
    budget: float = USUAL,
    longest: float = LONGEST,
    repeats: int = REPEATS,
    progress: Progress = lambda *_: None,
) -> Trade:
    """Measure errors and wall times of all convergence series of cases, and judge the series.

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
        Wall time of a run after which its series ends [s].
    longest : float
        Wall time after which a run is given up [s].
    repeats : int
        Number of repeats, for wall times, of each setting that may be on the Pareto front.
    progress : callable
        Called as ``progress(label, done, total)``; the total grows with the series.

    Raises
    ------
    InputError
        A case has no such run, or its model has an error.
    """
    if workers is None:
        with pool() as local:
            return trade(
                cases,
                store,
                local,
                kind,
                budget=budget,
                longest=longest,
                repeats=repeats,
                progress=progress,
            )
    cases = list(cases)
    kinds = [chosen(case, kind) for case in cases]
    motions = motions_of(cases, kinds, store, workers, longest)
    cases = [within(*each) for each in zip(cases, kinds, motions, strict=True)]
    every = [
        CaseSeries(case, which, MeasuredSeries(series), motion)
        for case, which, motion in zip(cases, kinds, motions, strict=True)
        for series in list_series(case, which)
    ]
    while batch := [one for one in every if not one.measured.done(budget)]:
        rows = run(
            [one.task(len(one.measured.rows)) for one in batch],
            store,
            workers,
            repeats=0,
            timeout=longest,
            progress=progress,
        )
        for one, row in zip(batch, rows, strict=True):
            one.measured.rows.append(row)
    rows = [row for one in every for row in one.measured.rows]
    rows = run(
        [one.task(k) for one in every for k in range(len(one.measured.rows))],
        store,
        workers,
        repeats=repeats,
        repeated={k for k, row in enumerate(rows) if is_default(row)}.union(near_front(rows)),
        longest_repeated=budget,
        timeout=longest,
        progress=progress,
    )
    finer = halve(every, store, workers, longest, progress)
    leaders = find_leaders(every, finer)
    perturbed = perturb(every, leaders, store, workers, longest, progress)
    disturbed = disturb(every, leaders, finer, perturbed, store, workers, longest)
    return Trade(
        rows,
        [
            *(row for found in finer.values() for row in found if row.study == "floor"),
            *(row for found in perturbed.values() for _, row in found),
        ],
        [
            verdict(every, error, n, leaders, finer, perturbed, disturbed, budget)
            for n, one in enumerate(every)
            for error in one.measured.kinds
        ],
        cases,
    )


def near_front(rows: Sequence[StudyRow]) -> list[int]:
    """Numbers of the settings that may be on the Pareto front of their case and engine.

    A setting is one of them if for some kind of error no setting that is as accurate was faster by
    more than the factor `NEAR`, or `SURE` for runs longer than
    `MOMENT`.

    >>> times = [(1e-3, 0.01), (1e-3, 0.014), (1e-3, 0.02), (1e-4, 1.0), (1e-4, 1.2), (1e-4, 1.4)]
    >>> near_front([StudyRow("", "", "", "", "", "", 0.0, errors={"energy": e}, seconds=s,
    ...                      outcome=Outcome.RAN) for e, s in times])
    [0, 1, 3, 4]
    """
    numbers = {id(row): k for k, row in enumerate(rows)}
    groups: dict[tuple[str, str], list[StudyRow]] = {}
    for row in rows:
        groups.setdefault((row.case, row.engine), []).append(row)
    found = set[int]()
    for group, kind in product(groups.values(), KINDS):
        least = inf
        for row in sorted(able(group, kind), key=lambda row: (row.errors[kind], row.seconds)):
            least = min(least, row.seconds)
            if row.seconds <= (NEAR if row.seconds < MOMENT else SURE) * least:
                found.add(numbers[id(row)])
    return sorted(found)


def chosen(case: Case, kind: Kind | None) -> Kind:
    """The kind of run to study: the given one, else the first of three that the case has."""
    wanted: list[Kind] = [kind] if kind else ["dynamics", "equilibrium", "sweep"]
    for name in wanted:
        if name in case.run:
            return name
    raise InputError(
        case.file, f"run.{kind}", f"there is no such run; there are: {', '.join(case.run)}"
    )


def find_leaders(every: Sequence[CaseSeries], finer: Halved) -> Leaders:
    """For each setting at a floor, unchanged by halvings, the first setting at the same floor.

    Two settings of a case and engine are at the same floor if all kinds of errors that are at a
    floor in the later one are so in the first one too, and are equal there up to
    `SAME`.
    """
    kinds = {(n, k): left_kinds(every[n], k, rows) for (n, k), rows in finer.items()}
    found: Leaders = {}
    for n, k in filter(kinds.__getitem__, kinds):
        own = every[n].measured.rows[k].errors
        found[n, k] = next(
            (
                (m, j)
                for (m, j), first in found.items()
                if (m, j) == first
                for other in (every[m],)
                if other.case is every[n].case
                and other.series.engine == every[n].series.engine
                and kinds[n, k] <= kinds[m, j]
                and all(
                    isclose(own[kind], other.measured.rows[j].errors[kind], rel_tol=SAME)
                    for kind in kinds[n, k]
                )
            ),
            (n, k),
        )
    return found


def halve(
    every: list[CaseSeries], store: Store, workers: Executor, longest: float, progress: Progress
) -> Halved:
    """Rows with half and a quarter of the step, for all settings that may be at a floor."""
    places = [(n, k) for n, one in enumerate(every) for k in dict.fromkeys(one.floors().values())]
    found: Halved = {place: [] for place in places}
    asked = [
        ((n, k), setting)
        for n, k in places
        for one in (every[n],)
        for setting in halvings(
            one.run, one.series, one.series.settings[k], float(compiled(one.case).opt.timestep)
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
            leading(setting.parameters["timestep" if one.run == "dynamics" else "segments"]),
            timed=False,
        )
        for (n, _), setting in asked
        for one in (every[n],)
    ]
    for (place, _), row in zip(
        asked,
        run(tasks, store, workers, repeats=0, timeout=longest, progress=progress),
        strict=True,
    ):
        found[place].append(row)
    return found


def left(one: CaseSeries, k: int, kind: str, finer: Sequence[StudyRow]) -> bool:
    """Whether two halvings leave the error of setting number k, and it is asymptotic."""
    rows = [one.measured.rows[k], *finer]
    return halved([row.errors.get(kind, NAN) for row in rows if row.outcome == Outcome.RAN])


def left_kinds(one: CaseSeries, k: int, finer: Sequence[StudyRow]) -> set[str]:
    """The kinds of errors of setting number k that are unchanged by two halvings of the step."""
    return {kind for kind, at in one.floors().items() if at == k and left(one, k, kind, finer)}


def perturb(
    every: list[CaseSeries],
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
            for n, one in enumerate(every)
            for kind in one.measured.kinds
            if (k := one.odd(kind)) is not None
        ]
    )
    asked = [
        (place, case, perturbation)
        for place in places
        for one in (every[place[0]],)
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
            every[n].run,
            Setting(every[n].series.engine, one.parameters),
            "floor",
            every[n].series.name,
            one.cause,
            timed=False,
        )
        for (n, _), case, one in asked
    ]
    rows = run(tasks, store, workers, repeats=0, timeout=longest, progress=progress)
    found: PerturbedRows = {place: [] for place in places}
    for (place, _, perturbation), row in zip(asked, rows, strict=True):
        found[place].append((perturbation, row))
    return found


def disturb(
    every: list[CaseSeries],
    leaders: Leaders,
    finer: Halved,
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
        (n, k) for n, one in enumerate(every) if one.run == "dynamics" for k in one.risen().values()
    }
    places |= {
        (n, k)
        for n, k in leaders.values()
        for one in (every[n],)
        if one.run == "dynamics"
        for kind in left_kinds(one, k, finer[n, k])
        if judge(one.measured.rows[k].errors[kind], perturbed[n, k], kind, True)[0] == UNKNOWN
    }
    futures = {
        place: workers.submit(rounding, every[place[0]].task(place[1]), store, longest)
        for place in sorted(places)
    }
    return {place: future.result() for place, future in futures.items()}


def verdict(
    every: Sequence[CaseSeries],
    kind: str,
    n: int,
    leaders: Leaders,
    finer: Halved,
    perturbed: PerturbedRows,
    disturbed: Mapping[SeriesPlace, Mapping[str, float]],
    budget: float,
) -> Verdict:
    """Judge a series in one kind of error: order, error floor, or how far it came without a floor.

    Parameters
    ----------
    every, kind : sequence of CaseSeries, str
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
        Wall time of a run after which its series ends [s].
    """
    one = every[n]
    rows, odd = one.measured.rows, one.odd(kind)
    why = cause = evidence = ""
    floor = NAN
    if (k := one.floors().get(kind)) is not None:
        first = finer[n, k][0]
        half = first.errors.get(kind, NAN) if first.outcome == Outcome.RAN else NAN
        what = "halving the step" if one.run == "dynamics" else "twice as many segments"
        why = (
            f"{what} {factor(rows[k].errors[kind] / half)}"
            if half > 0
            else f"{what}: {first.outcome}"
        )
        if left(one, k, kind, finer[n, k]):
            place = leaders[n, k]
            lead, row = every[place[0]], every[place[0]].measured.rows[place[1]]
            cause, evidence = judge(row.errors[kind], perturbed[place], kind, at_floor=True)
            why = "none of the changed causes changes it"
            floor = rows[k].errors[kind]
            if cause == UNKNOWN:
                cause, shown = as_rounding(row, kind, disturbed.get(place, {}))
                evidence = "; ".join(filter(None, (evidence, shown)))
            if lead is not one and evidence:
                evidence = f"the same errors as {lead.series.name}, in which {evidence}"
            evidence = "; ".join(filter(None, (evidence, added_by_drive(rows[k], kind))))
    elif (k := one.risen().get(kind)) is not None:
        points = one.measured.points(kind)
        cause, evidence = as_rounding(rows[k], kind, disturbed.get((n, k), {}))
        why, floor = "finer settings are worse", min(error for _, error in points)
    known = bool(cause) and cause != UNKNOWN
    remark = (
        ""
        if odd is None
        else ": ".join(filter(None, judge(rows[odd].errors[kind], perturbed[n, odd], kind)))
    )
    motion = one.motion
    last = format_end(one.measured, budget)
    return Verdict(
        one.case.name,
        one.run,
        one.series.engine,
        one.series.name,
        kind,
        *one.orders(kind),
        floor if known else NAN,
        cause if known else "",
        evidence if known else "",
        remark,
        "" if known else format_reached(one.measured, kind, one.orders(kind)[1], why, last),
        "" if cause == ROUNDING else format_worsened(one.measured, kind),
        motion.words if motion else "",
        motion.horizon if motion else NAN,
    )


def added_by_drive(row: StudyRow, kind: str) -> str:
    """A sentence on the error at the prescribed motion, if most of it is that of the drives.

    >>> row = StudyRow("", "", "", "", "", "", 1.0, errors={"position": 1e-6},
    ...                asked={"position": 3e-5})
    >>> added_by_drive(row, "position")
    'at the motion that drives were asked for the error is 3e-5, since their own error is added'
    """
    if not by_drives(row, kind):
        return ""
    return (
        f"at the motion that drives were asked for the error is {number(row.asked[kind], 2)}, "
        "since their own error is added"
    )


def as_rounding(row: StudyRow, kind: str, away: Mapping[str, float]) -> tuple[str, str]:
    """Cause and evidence: rounding, if it moves the result by enough; else `UNKNOWN`."""
    moved, error = away.get(kind, NAN), row.errors.get(kind, NAN)
    if not moved >= ROUNDED * error:
        return UNKNOWN, ""
    return ROUNDING, (
        f"roundings of masses and start move the result by {number(moved, 2)} where "
        f"its error is {number(error, 2)}"
    )


def limits(longest: float, budget: float = USUAL) -> str:
    """A sentence on the limits of a study: where series end, and when runs are given up."""
    return (
        f"Limits: a convergence series ends at {number(WORK)} evaluations of "
        f"forces, after a run of more than {number(budget)} s, or where its errors no longer fall; "
        f"a run is given up after {number(longest)} s (--longest)."
    )


def cost(rows: Iterable[StudyRow], kind: str, error: float) -> float:
    """Wall time of the cheapest row with an error of at most `error` [s]; NaN if there is none."""
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
    write_whole(folder / "verdicts.json", json.dumps(records, indent=1, allow_nan=False))


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
