"""The study of work and precision: lines to their walls, what the walls are, and what it costs.

    study = trade([load_case("models/fourbar.toml")], Store(folder / "runs"), workers)
    write_study(study, folder)

Lines go from setting to setting side by side, each run once for its errors, until their walls; then
all settings are timed in rounds; then one cause after the other is moved at the walls, and where a
line shows another order than theory expects.
"""

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import asdict, dataclass
from math import isnan, nan
from pathlib import Path

from proofmass.case import Case
from proofmass.errors import InputError
from proofmass.files import write_whole
from proofmass.strict import Kind
from proofmass.study.axes import Line, leading, lines
from proofmass.study.line import Track, clear, deep, level, observed
from proofmass.study.measure import Task
from proofmass.study.orders import expected, nearest, off
from proofmass.study.row import Row
from proofmass.study.run import run
from proofmass.study.store import Store
from proofmass.study.table import write_table
from proofmass.study.verdict import Verdict
from proofmass.study.wall import Probe, judge, probes

BUDGET = 2.0  # s, of one run, for engines that take much longer than usual
LONGEST = 30.0  # s, after which a run is given up
REPEATS = 5
Progress = Callable[[str, int, int], None]
Place = tuple[int, int]  # of a lane, and of a setting on its line
Moved = dict[Place, list[tuple[Probe, Row]]]


@dataclass(frozen=True)
class Trade:
    """What a study found: its settings, what was moved at walls, and verdicts on the lines."""

    rows: list[Row]
    moved: list[Row]
    verdicts: list[Verdict]


@dataclass
class Lane:
    """A line of one run of a case, and how far it is."""

    case: Case
    run: Kind
    track: Track

    @property
    def line(self) -> Line:
        """Whose settings they are."""
        return self.track.line

    def orders(self, kind: str) -> tuple[float, float]:
        """The observed order and the expected one; NaN where none is expected."""
        if not (wanted := expected(self.case, self.run, self.line, kind)):
            return nan, nan
        seen = observed(self.track.points(kind))
        return seen, nearest(wanted, seen)

    def places(self, kind: str) -> tuple[int | None, int | None]:
        """The numbers of two settings that ask for their causes: one well in the wall, and
        the finest before it of a line with another order than expected."""
        points = self.track.points(kind)
        k = deep(points)
        return (None if k is None else self.track.place(points[k][0]),
                self.track.place(clear(points)[-1][0]) if off(*self.orders(kind)) else None)

    def task(self, k: int) -> Task:
        """Setting number k."""
        setting = self.line.settings[k]
        return Task(self.case, self.run, setting, "trade", self.line.name, self.line.axis,
                    leading(setting.knobs[self.line.axis]))


def trade(cases: Iterable[Case], store: Store, workers: Executor | None = None,
          kind: Kind | None = None, *, budget: float = BUDGET, repeats: int = REPEATS,
          progress: Progress = lambda *_: None) -> Trade:
    """Measure what accuracy costs.

    Parameters
    ----------
    cases : iterable of Case
    store : Store
        Of finished runs.
    workers : Executor, optional
        See `proofmass.study.run.pool`.
    kind : {"sweep", "duration", "rest"}, optional
        Which run of the cases; the first of duration, rest and sweep that they have.
    budget : float
        Wall time of a run after which its line ends [s].
    repeats : int
        Timed runs of each setting.
    progress : callable
        Called as ``progress(label, done, total)``; the total grows with the lines.

    Raises
    ------
    InputError
        A case has no such run, or its model is at fault.
    """
    lanes = [Lane(case, which, Track(line)) for case in cases for which in (chosen(case, kind),)
             for line in lines(case, which)]
    while batch := [lane for lane in lanes if not lane.track.done(budget)]:
        rows = run([lane.task(len(lane.track.rows)) for lane in batch], store, workers, repeats=0,
                   timeout=LONGEST, progress=progress)
        for lane, row in zip(batch, rows, strict=True):
            lane.track.rows.append(row)
    tasks = [lane.task(k) for lane in lanes for k in range(len(lane.track.rows))]
    rows = run(tasks, store, workers, repeats=repeats, patience=budget, timeout=LONGEST,
               progress=progress)
    moved = at_walls(lanes, store, workers, progress)
    return Trade(rows, [row for found in moved.values() for _, row in found],
                 [verdict(lane, error, {k: found for (m, k), found in moved.items() if m == n})
                  for n, lane in enumerate(lanes) for error in lane.track.kinds])


def chosen(case: Case, kind: Kind | None) -> Kind:
    """The run that a study is of."""
    wanted: list[Kind] = [kind] if kind else ["duration", "rest", "sweep"]
    for name in wanted:
        if name in case.run:
            return name
    raise InputError(case.file, f"run.{kind}", f"there is no such run; there are: "
                     f"{', '.join(case.run)}")


def at_walls(lanes: list[Lane], store: Store, workers: Executor | None,
             progress: Progress) -> Moved:
    """Move every cause at every wall, and where an order is another than expected."""
    places = dict.fromkeys((n, k) for n, lane in enumerate(lanes) for kind in lane.track.kinds
                           for k in lane.places(kind) if k is not None)
    asked = [(place, probe) for place in places for lane in (lanes[place[0]],)
             for probe in probes(lane.case, lane.run, lane.line.settings[place[1]],
                                 store.folder / "models")]
    tasks = [Task(probe.case, lanes[n].run, probe.setting, "wall", lanes[n].line.name, probe.cause)
             for (n, _), probe in asked]
    rows = run(tasks, store, workers, repeats=0, timeout=LONGEST, progress=progress)
    found: Moved = {place: [] for place in places}
    for (place, probe), row in zip(asked, rows, strict=True):
        found[place].append((probe, row))
    return found


def verdict(lane: Lane, kind: str, moved: Mapping[int, Sequence[tuple[Probe, Row]]]) -> Verdict:
    """Order and wall of one line in one kind of error; `moved` has the causes at its settings."""
    rows = lane.track.rows
    at_wall, at_odds = (("", "") if k is None else judge(rows[k].errors[kind], moved[k], kind)
                        for k in lane.places(kind))
    return Verdict(lane.case.name, lane.run, lane.line.engine, lane.line.name, kind,
                   *lane.orders(kind), level(lane.track.points(kind)), *at_wall,
                   ": ".join(filter(None, at_odds)))


def cost(rows: Iterable[Row], kind: str, error: float) -> float:
    """Wall time of the cheapest of the rows that are no further off [s]; NaN if all are."""
    return min((row.seconds for row in rows if row.outcome == "ran"
                and row.errors.get(kind, nan) <= error), default=nan)


def write_study(study: Trade, folder: Path) -> None:
    """``trade.csv``, ``verdicts.json`` and, if causes were moved, ``walls.csv``."""
    write_table(study.rows, folder / "trade.csv")
    if study.moved:
        write_table(study.moved, folder / "walls.csv")
    told = [{k: v for k, v in asdict(one).items() if not (isinstance(v, float) and isnan(v))}
            for one in study.verdicts]
    write_whole(folder / "verdicts.json", json.dumps(told, indent=1, allow_nan=False))


def read_verdicts(file: Path) -> list[Verdict]:
    """The verdicts that `write_study` wrote."""
    return [Verdict(**one) for one in json.loads(file.read_text(encoding="utf-8"))]
