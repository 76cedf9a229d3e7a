"""Finer steps than a study took, where none is good enough or a cheaper setting is in sight.

The errors of a line that is at no wall fall on with the order of its last two steps.  That tells
which step is good enough, and what it will cost; what promises to be cheaper than all that is good
enough is measured.
"""

from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import Executor
from itertools import groupby
from math import ceil, inf

from proofmass.case import Case
from proofmass.reference import grid
from proofmass.strict import Kind
from proofmass.study.axes import leading
from proofmass.study.line import FALLS, order
from proofmass.study.measure import Task
from proofmass.study.row import NAN, Row
from proofmass.study.run import run
from proofmass.study.setting import Setting
from proofmass.study.store import Store
from proofmass.study.verdict import Verdict

SAFE = 0.8  # of the error that is needed: orders change a little
CHEAPER = 0.8  # of the cheapest that is good enough: else it is not worth a run
LONGEST = 30.0  # s, of a run
ROUNDS = 4  # in which steps are corrected
FEW = 2  # lines in a round


def refined(case: Case, kind: Kind, rows: Iterable[Row], verdicts: Iterable[Verdict], of: str,
            needed: float, store: Store, workers: Executor, engine: str = "", *,
            repeats: int = 5) -> list[Row]:
    """Measured settings, with finer ones where these are needed or promise to be cheaper.

    Parameters
    ----------
    case, kind
        What is run; only durations have steps.
    rows, verdicts : iterable of Row, of Verdict
        Of a study of that run.
    of, needed : str, float
        Kind of error, and the largest measured one that is good enough [share of range].
    store, workers
        See `proofmass.study.run.run`.
    engine : str, optional
        The only one that matters.
    """
    found, told = list(rows), list(verdicts)
    for _ in range(ROUNDS):
        own = [row for row in found if row.engine == (engine or row.engine)]
        if not (tasks := promising(case, kind, own, told, of, needed)):
            break
        found += run(tasks, store, workers, repeats=repeats, timeout=LONGEST)
    return found


def promising(case: Case, kind: Kind, rows: Sequence[Row], verdicts: Sequence[Verdict], of: str,
              needed: float) -> list[Task]:
    """The next steps to try, those of the cheapest lines."""
    limit = min((row.seconds for row in rows if row.outcome == "ran" and row.seconds > 0
                 and row.errors.get(of, inf) <= needed), default=LONGEST / CHEAPER)
    tried = {(row.line, row.value) for row in rows}
    asked = sorted(steps(case, kind, rows, verdicts, of, needed), key=lambda each: each[0])
    return [task for cost, task in asked
            if cost < CHEAPER * limit and (task.line, task.value) not in tried][:FEW]


def steps(case: Case, kind: Kind, rows: Sequence[Row], verdicts: Sequence[Verdict], of: str,
          needed: float) -> Iterator[tuple[float, Task]]:
    """Of each line at no wall what it should cost [s], and the step that should be good enough."""
    if kind != "duration":
        return
    walled = {(v.engine, v.line) for v in verdicts if v.kind == of and v.wall > 0}
    times = grid(case, kind)
    sample = float(times[1] - times[0])
    for coarse, fine in ends(row for row in rows if (row.engine, row.line) not in walled):
        pair = [(row.value, row.errors.get(of, NAN)) for row in (coarse, fine)]
        falls = order(*pair) if all(error > 0 for _, error in pair) else NAN
        if falls > FALLS and fine.errors[of] > needed:
            finer = fine.value * (SAFE * needed / fine.errors[of]) ** (1 / falls)
            step = sample / (ceil(sample / finer) // 2 * 2 + 1)  # odd, see `axes.timesteps`
            yield fine.seconds * fine.value / step, Task(case, kind, scaled(fine, step), fine.study,
                                                         fine.line, fine.axis, step)


def ends(rows: Iterable[Row]) -> Iterator[tuple[Row, Row]]:
    """The two finest steps of each line, if it ran with both."""
    stepped = sorted((row for row in rows if row.axis == "timestep"),
                     key=lambda row: (row.engine, row.line, -row.value))
    for _, line in groupby(stepped, lambda row: (row.engine, row.line)):
        last = list(line)[-2:]
        if [row.outcome for row in last] == ["ran", "ran"]:
            yield last[0], last[1]


def scaled(row: Row, step: float) -> Setting:
    """A setting with another step; what holds loops goes with the step, as it does on its line."""
    knobs = dict(row.knobs, timestep=step)
    if isinstance(solref := row.knobs.get("solref"), tuple):
        knobs["solref"] = (leading(solref) * step / row.value, *solref[1:])
    return Setting(row.engine, knobs)
