"""The study of work and precision: orders of lines, their error floors, and what it costs.

    study = trade([load_case("models/linkages/fourbar.toml")], Store(folder / "runs"), workers)
    write_study(study, folder)

Free motions are disturbed first: chaotic ones are judged up to where a trajectory means something.
Lines go from setting to setting side by side, each run once for its errors, until nothing falls any
more; then all settings are timed in rounds.  Where a line may be at an error floor its step is
halved twice, and one cause after the other is moved; so is it where a line shows another order than
theory expects.
"""

import json
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import asdict, dataclass, field
from math import isnan, nan
from pathlib import Path

from proofmass.case import Case
from proofmass.errors import InputError
from proofmass.files import write_whole
from proofmass.outcome import Outcome
from proofmass.reference import compiled
from proofmass.sim.protocol import leading
from proofmass.strict import Kind
from proofmass.studies import LONGEST
from proofmass.studies.measure import StudyRun
from proofmass.studies.record import NAN, StudyRow, write_table
from proofmass.studies.run import Progress, pool, run
from proofmass.studies.store import Store
from proofmass.studies.trade.axes import WORK, ConvergenceSeries, lines
from proofmass.studies.trade.disturbed import ROUNDED, DisturbedMotion, motions_of, rounding, within
from proofmass.studies.trade.floor import ROUNDING, UNKNOWN, Probe, factor, halvings, judge, probes
from proofmass.studies.trade.orders import expected, nearest, off
from proofmass.studies.trade.series import Track, clear, flat, halved, least, observed
from proofmass.studies.trade.verdict import Verdict
from proofmass.studies.trade.words import ended, reached, worsened
from proofmass.wording import number

USUAL = 2.0  # s, of one run, for engines that take much longer than usual
REPEATS = 5
SeriesPlace = tuple[int, int]  # of a lane, and of a setting on its line
ProbedRows = dict[SeriesPlace, list[tuple[Probe, StudyRow]]]
Halved = dict[SeriesPlace, list[StudyRow]]


@dataclass(frozen=True)
class Trade:
    """What a study found: its settings, what was moved, verdicts on the lines, and the cases as
    they were judged: a chaotic motion up to its horizon."""

    rows: list[StudyRow]
    moved: list[StudyRow]
    verdicts: list[Verdict]
    cases: list[Case] = field(default_factory=list)


@dataclass
class Lane:
    """A line of one run of a case, and how far it is."""

    case: Case
    run: Kind
    track: Track
    motion: DisturbedMotion | None = None

    @property
    def line(self) -> ConvergenceSeries:
        """Whose settings they are."""
        return self.track.line

    def orders(self, kind: str) -> tuple[float, float]:
        """The observed order and the expected one; NaN where none is expected."""
        if not (wanted := expected(self.case, self.run, self.line, kind)):
            return nan, nan
        seen = observed(self.track.points(kind))
        return seen, nearest(wanted, seen)

    def floors(self) -> dict[str, int]:
        """For each kind of error that may be at a floor the number of the setting to look at.

        The finest of these settings serves all kinds that are flat there.
        """
        found = {
            kind: self.track.place(points[k][0])
            for kind in self.track.kinds
            for points in (self.track.points(kind),)
            if (k := flat(points)) is not None
        }
        last = max(found.values(), default=0)
        return dict.fromkeys(found, last)

    def risen(self) -> dict[str, int]:
        """For each kind whose error grows from some step on the number of the finest setting."""
        return {
            kind: self.track.place(points[-1][0])
            for kind in self.track.kinds
            for points in (self.track.points(kind),)
            if least(points) is not None
        }

    def odd(self, kind: str) -> int | None:
        """The finest setting before a floor of a line with another order than expected."""
        return (
            self.track.place(clear(self.track.points(kind))[-1][0])
            if off(*self.orders(kind))
            else None
        )

    def task(self, k: int) -> StudyRun:
        """Setting number k."""
        setting = self.line.settings[k]
        return StudyRun(
            self.case,
            self.run,
            setting,
            "trade",
            self.line.name,
            self.line.axis,
            leading(setting.parameters[self.line.axis]),
        )

    def row(self, size: float) -> StudyRow:
        """The row of the setting of a size."""
        return self.track.rows[self.track.place(size)]


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
    """Measure what accuracy costs.

    Parameters
    ----------
    cases : iterable of Case
    store : Store
        Of finished runs.
    workers : Executor, optional
        See `proofmass.studies.run.pool`.
    kind : {"sweep", "dynamics", "equilibrium"}, optional
        Which run of the cases; the first of dynamics, equilibrium and sweep that they have.
    budget : float
        Wall time of a run after which its line ends [s].
    longest : float
        After which a run is given up [s].
    repeats : int
        Timed runs of each setting.
    progress : callable
        Called as ``progress(label, done, total)``; the total grows with the lines.

    Raises
    ------
    InputError
        A case has no such run, or its model is at fault.
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
    lanes = [
        Lane(case, which, Track(line), motion)
        for case, which, motion in zip(cases, kinds, motions, strict=True)
        for line in lines(case, which)
    ]
    while batch := [lane for lane in lanes if not lane.track.done(budget)]:
        rows = run(
            [lane.task(len(lane.track.rows)) for lane in batch],
            store,
            workers,
            repeats=0,
            timeout=longest,
            progress=progress,
        )
        for lane, row in zip(batch, rows, strict=True):
            lane.track.rows.append(row)
    tasks = [lane.task(k) for lane in lanes for k in range(len(lane.track.rows))]
    rows = run(
        tasks, store, workers, repeats=repeats, patience=budget, timeout=longest, progress=progress
    )
    finer = halve(lanes, store, workers, longest, progress)
    moved = move(lanes, finer, store, workers, longest, progress)
    disturbed = disturb(lanes, finer, moved, store, workers, longest)
    return Trade(
        rows,
        [
            *(row for found in finer.values() for row in found),
            *(row for found in moved.values() for _, row in found),
        ],
        [
            verdict(lane, error, n, finer, moved, disturbed, budget)
            for n, lane in enumerate(lanes)
            for error in lane.track.kinds
        ],
        cases,
    )


def chosen(case: Case, kind: Kind | None) -> Kind:
    """The run that a study is of."""
    wanted: list[Kind] = [kind] if kind else ["dynamics", "equilibrium", "sweep"]
    for name in wanted:
        if name in case.run:
            return name
    raise InputError(
        case.file, f"run.{kind}", f"there is no such run; there are: {', '.join(case.run)}"
    )


def halve(
    lanes: list[Lane], store: Store, workers: Executor, longest: float, progress: Progress
) -> Halved:
    """The rows of half and of a quarter of the step, wherever a line may be at a floor."""
    asked = [
        ((n, k), setting)
        for n, lane in enumerate(lanes)
        for k in dict.fromkeys(lane.floors().values())
        for setting in halvings(
            lane.run, lane.line, lane.line.settings[k], float(compiled(lane.case).opt.timestep)
        )
    ]
    tasks = [
        StudyRun(
            lane.case,
            lane.run,
            setting,
            "floor",
            lane.line.name,
            "halved",
            leading(setting.parameters["timestep" if lane.run == "dynamics" else "segments"]),
        )
        for (n, _), setting in asked
        for lane in (lanes[n],)
    ]
    found: Halved = {}
    for (place, _), row in zip(
        asked,
        run(tasks, store, workers, repeats=0, timeout=longest, progress=progress),
        strict=True,
    ):
        found.setdefault(place, []).append(row)
    return found


def left(lane: Lane, k: int, kind: str, finer: Sequence[StudyRow]) -> bool:
    """Whether two halvings leave the error of setting number k, which is asymptotic."""
    rows = [lane.track.rows[k], *finer]
    return halved([row.errors.get(kind, NAN) for row in rows if row.outcome == Outcome.RAN])


def move(
    lanes: list[Lane],
    finer: Halved,
    store: Store,
    workers: Executor,
    longest: float,
    progress: Progress,
) -> ProbedRows:
    """Move every cause where two halvings leave an error, and where an order is another."""
    places = dict.fromkeys(
        [
            (n, k)
            for n, lane in enumerate(lanes)
            for kind, k in lane.floors().items()
            if left(lane, k, kind, finer[n, k])
        ]
        + [
            (n, k)
            for n, lane in enumerate(lanes)
            for kind in lane.track.kinds
            if (k := lane.odd(kind)) is not None
        ]
    )
    asked = [
        (place, probe)
        for place in places
        for lane in (lanes[place[0]],)
        for probe in probes(
            lane.case,
            lane.run,
            lane.line.settings[place[1]],
            store.folder / "models",
            lane.line.scaled,
        )
    ]
    tasks = [
        StudyRun(probe.case, lanes[n].run, probe.setting, "floor", lanes[n].line.name, probe.cause)
        for (n, _), probe in asked
    ]
    rows = run(tasks, store, workers, repeats=0, timeout=longest, progress=progress)
    found: ProbedRows = {place: [] for place in places}
    for (place, probe), row in zip(asked, rows, strict=True):
        found[place].append((probe, row))
    return found


def disturb(
    lanes: list[Lane],
    finer: Halved,
    moved: ProbedRows,
    store: Store,
    workers: Executor,
    longest: float,
) -> dict[SeriesPlace, dict[str, float]]:
    """How far changes by some roundings move the results that may be rounding.

    Those that grow as the step shrinks, and those that nothing else moves.
    """
    places = {
        (n, k)
        for n, lane in enumerate(lanes)
        if lane.run == "dynamics"
        for k in lane.risen().values()
    }
    places |= {
        (n, k)
        for n, lane in enumerate(lanes)
        if lane.run == "dynamics"
        for kind, k in lane.floors().items()
        if left(lane, k, kind, finer[n, k])
        and judge(lane.track.rows[k].errors[kind], moved[n, k], kind, True)[0] == UNKNOWN
    }
    futures = {
        place: workers.submit(rounding, lanes[place[0]].task(place[1]), store, longest)
        for place in sorted(places)
    }
    return {place: future.result() for place, future in futures.items()}


def verdict(
    lane: Lane,
    kind: str,
    n: int,
    finer: Halved,
    moved: ProbedRows,
    disturbed: Mapping[SeriesPlace, Mapping[str, float]],
    budget: float,
) -> Verdict:
    """Order and error floor of a line in one kind of error; how far it came where none is shown.

    Parameters
    ----------
    lane, kind, n
        The lane, which is number n, and the kind of error.
    finer, moved, disturbed
        What halvings, moved causes and roundings did at its settings.
    budget : float
        Wall time after which lines end [s].
    """
    rows, odd = lane.track.rows, lane.odd(kind)
    why = cause = evidence = ""
    floor = NAN
    if (k := lane.floors().get(kind)) is not None:
        first = finer[n, k][0]
        half = first.errors.get(kind, NAN) if first.outcome == Outcome.RAN else NAN
        what = "halving the step" if lane.run == "dynamics" else "twice as many segments"
        why = (
            f"{what} {factor(rows[k].errors[kind] / half)}"
            if half > 0
            else f"{what}: {finer[n, k][0].outcome}"
        )
        if left(lane, k, kind, finer[n, k]):
            cause, evidence = judge(rows[k].errors[kind], moved[n, k], kind, at_floor=True)
            why = "nothing that was moved moves it"
            floor = rows[k].errors[kind]
            if cause == UNKNOWN:
                cause, shown = as_rounding(rows[k], kind, disturbed.get((n, k), {}))
                evidence = "; ".join(filter(None, (evidence, shown)))
    elif (k := lane.risen().get(kind)) is not None:
        points = lane.track.points(kind)
        cause, evidence = as_rounding(rows[k], kind, disturbed.get((n, k), {}))
        why, floor = "finer ones are worse", min(error for _, error in points)
    known = bool(cause) and cause != UNKNOWN
    remark = (
        ""
        if odd is None
        else ": ".join(filter(None, judge(rows[odd].errors[kind], moved[n, odd], kind)))
    )
    motion = lane.motion
    last = ended(lane.track, budget)
    return Verdict(
        lane.case.name,
        lane.run,
        lane.line.engine,
        lane.line.name,
        kind,
        *lane.orders(kind),
        floor if known else NAN,
        cause if known else "",
        evidence if known else "",
        remark,
        "" if known else reached(lane.track, kind, lane.orders(kind)[1], why, last),
        "" if cause == ROUNDING else worsened(lane.track, kind),
        motion.words if motion else "",
        motion.horizon if motion else NAN,
    )


def as_rounding(row: StudyRow, kind: str, away: Mapping[str, float]) -> tuple[str, str]:
    """Whether an error is rounding, and by how much changes by some roundings moved the result."""
    moved, error = away.get(kind, NAN), row.errors.get(kind, NAN)
    if not moved >= ROUNDED * error:
        return UNKNOWN, ""
    return ROUNDING, (
        f"roundings of masses and start move the result by {number(moved, 2)} where "
        f"its error is {number(error, 2)}"
    )


def limits(longest: float, budget: float = USUAL) -> str:
    """What a study goes no further than, in words."""
    return (
        f"Limits: a line of settings ends at {number(WORK)} evaluations of forces, after a run "
        f"of more than {number(budget)} s, or where nothing falls any more; a run is given up "
        f"after {number(longest)} s (--longest)."
    )


def cost(rows: Iterable[StudyRow], kind: str, error: float) -> float:
    """Wall time of the cheapest of the rows that are no further off [s]; NaN if all are."""
    return min(
        (
            row.seconds
            for row in rows
            if row.outcome == Outcome.RAN and row.errors.get(kind, nan) <= error
        ),
        default=nan,
    )


def write_study(study: Trade, folder: Path) -> None:
    """``trade.csv``, ``verdicts.json`` and, if causes were moved, ``floors.csv``."""
    write_table(study.rows, folder / "trade.csv")
    if study.moved:
        write_table(study.moved, folder / "floors.csv")
    told = [
        {k: v for k, v in asdict(one).items() if not (isinstance(v, float) and isnan(v))}
        for one in study.verdicts
    ]
    write_whole(folder / "verdicts.json", json.dumps(told, indent=1, allow_nan=False))


def read_verdicts(file: Path) -> list[Verdict]:
    """The verdicts that `write_study` wrote.

    Raises
    ------
    InputError
        Another version did, or something else.
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
