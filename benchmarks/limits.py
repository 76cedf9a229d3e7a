"""Comparison of the limits of dynamics runs in docs/stress.md with programs in bare engines.

    python -m benchmarks.limits [folder] [--only CASE ...] [--changed] [--quick]

Writes docs/limits.md.  For each limit of a dynamics run the case is changed as `proofmass stress`
changes it, to 2 % before the printed limit and to 2 % beyond it.  Both changed cases are written as
programs and run in interpreters without proofmass.  Where a first and a last boundary are printed,
programs at these two values are run as well.  With --only the rows of all other cases are kept,
with --changed all rows that confirm a limit as it is printed now.
"""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from math import isclose
from pathlib import Path

from benchmarks import ROOT, command, folders
from proofmass.run.sidecar import load_case
from proofmass.sim.protocol.failures import Diverged, Unsupported
from proofmass.sim.pymunk.dynamics import MAX_ITERATIONS
from proofmass.studies.measure import Measurement, StudyRun
from proofmass.studies.store import Store
from proofmass.studies.stress.boundary import BoundaryKind, Failure
from proofmass.studies.stress.extremes import ENERGY_PARAMETER, list_extremes
from proofmass.studies.stress.limit_search import LimitSearch, step_by_factor
from proofmass.studies.stress.stable_steps import STABLE_STEP_PARAMETER
from proofmass.studies.study import Make, Study
from proofmass.studies.trade.program import TIMED_OUT_PREFIX, drive_ways, run_stored_program
from proofmass.studies.trade.verify import setting_as_used
from proofmass.verdict.outcome import Outcome

DISTANCE = 0.02
"""Distance of the two tried values from a limit, as a share of it."""
TIMEOUT = 120.0
"""Wall time after which a program is ended [s]."""
JOBS = 2
CONFIRMED = "confirmed"
WIDTH = 7  # cells of a row
UNSTABLE, INACCURATE = str(BoundaryKind.UNSTABLE), str(BoundaryKind.INACCURATE)
HEAD = """# Limits in bare engines

`python -m benchmarks.limits` made this page. [Where it breaks](stress.md) states {count} limits of
cases in dynamics runs. Each case was changed as `proofmass stress` changes it, to 2 % before the
printed limit and to 2 % beyond it. Both changed cases were written as programs and run by
themselves. Programs do not import proofmass; tests run them where it cannot be imported.

A limit is *confirmed* if all positions of the program before it are within a tenth of the range of
the reference, and the program beyond it fails or has a larger error. For {several} limits a first
and a last boundary are stated, and two more programs were run at these values. Such a limit is
confirmed if the program at the first value fails and the one at the last value holds, if the one
2 % before the first value holds, and if the one 2 % beyond the last value fails, unless the last
value is also the last that `stress` tries. The table has no limits of sweeps: a sweep has no time
steps, and proofmass finds its poses with what the engine computes. Limits of energy are confirmed
by scripts (`tests/studies/stress/bare/`).

| result | limits |
|---|---|
{results}

| case | solver | parameter | limit | 2 % before it | 2 % beyond it | result |
|---|---|---|---|---|---|---|
{rows}
"""


@dataclass(frozen=True)
class PrintedLimit:
    """A row of docs/stress.md that states a limit of a case."""

    case: str
    parameter: str
    engine: str
    setting: str
    value: float
    words: str
    again: float = float("nan")

    @property
    def key(self) -> tuple[str, str, str]:
        """Case, solver and parameter, as a row of docs/limits.md begins."""
        return self.case, f"{self.engine}, {self.setting}", self.parameter


@dataclass(frozen=True)
class BareLimit:
    """A printed limit, and the results of the programs before and beyond it, in words."""

    limit: PrintedLimit
    before: str
    beyond: str
    result: str


class NoProgram(Exception):
    """A run cannot be written as a program, for the reason in the message."""


def main(argv: Sequence[str] | None = None) -> None:
    """Confirm the limits of all cases of docs/stress.md, or one of the pendulum."""
    parser = command(__doc__)
    parser.add_argument("folder", type=Path, nargs="?", default=ROOT / "reports" / "stress")
    parser.add_argument("--only", nargs="+", metavar="CASE", help="names of cases")
    parser.add_argument("--changed", action="store_true", help="only limits not yet confirmed")
    given = parser.parse_args(argv)
    text = (ROOT / "docs" / "stress.md").read_text(encoding="utf-8")
    limits = [one for one in printed_limits(text) if one.case in (given.only or [one.case])]
    if given.quick:
        limits = [one for one in limits if one.case == "pendulum"][:1]
    some = given.only or given.changed
    kept = dict(rows_of((ROOT / "docs" / "limits.md").read_text("utf-8"))) if some else {}
    if given.changed:
        limits = [one for one in limits if not is_confirmed(one, kept)]
    with folders(given.quick, given.folder) as (folder, docs):
        found = confirm(limits, ProgramStudy(Store(folder / "runs")))
        fresh = {each.limit.key: cells(each) for each in found}
        every = printed_limits(text) if some else limits
        rows = [row for one in every if (row := fresh.get(one.key) or kept_cells(one, kept))]
        (docs / "limits.md").write_text(page(rows), encoding="utf-8")


def printed_limits(text: str) -> Iterator[PrintedLimit]:
    """The limits of cases that the document states.

    >>> row = "| time step | 1e-3 | mujoco, Euler | 0.14 s |  | inaccurate, in silence: off |"
    >>> list(printed_limits("## pendulum\\n" + row))[0].value
    0.14
    """
    case = ""
    for line in text.splitlines():
        if line.startswith("## "):
            case = line.removeprefix("## ")
            continue
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if len(cells) != 6 or not cells[5].startswith((UNSTABLE, INACCURATE)):
            continue
        engine, _, setting = cells[2].partition(", ")
        first, *more = cells[3].split()
        if first != "nowhere" and setting != "sweep":
            again = float(more[1]) if more[:1] == ["to"] else float("nan")
            yield PrintedLimit(case, cells[0], engine, setting, float(first), cells[3], again)


def rows_of(text: str) -> Iterator[tuple[tuple[str, ...], list[str]]]:
    """The rows of docs/limits.md, by case, solver and parameter."""
    for line in text.splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if len(cells) == WIDTH and cells[0] not in ("case", "---"):
            yield tuple(cells[:3]), cells


def is_confirmed(one: PrintedLimit, kept: Mapping[tuple[str, ...], list[str]]) -> bool:
    """Whether a row confirms a limit as it is printed."""
    cells = kept.get(one.key, [])
    return bool(cells) and (cells[3], cells[-1]) == (one.words, CONFIRMED)


def kept_cells(one: PrintedLimit, kept: Mapping[tuple[str, ...], list[str]]) -> list[str]:
    """The cells of a kept row of a limit, if there is one and the limit is still printed the same.

    Raises
    ------
    SystemExit
        The row confirms another value than the one that is printed now.
    """
    cells = kept.get(one.key, [])
    if cells and cells[3] != one.words:
        raise SystemExit(f"{', '.join(one.key)}: {one.words}, of which {cells[3]} was confirmed")
    return cells


class ProgramStudy(Study):
    """A study that runs programs instead of engines."""

    def measure_one(self, task: StudyRun, make: Make) -> Measurement:
        """The errors of the program of a task."""
        return run_program(task, self.store)


def confirm(limits: Sequence[PrintedLimit], study: ProgramStudy) -> list[BareLimit]:
    """Run the programs of all limits of dynamics runs, but those of energy.

    Stable time steps are left out as well, since `stress` measures them in bare MuJoCo itself.
    """
    searches = dict[tuple[str, str, str, str], LimitSearch]()
    for name in dict.fromkeys(one.case for one in limits):
        case = load_case(next((ROOT / "models").rglob(f"{name}.toml")))
        if "dynamics" in case.run:
            for search in list_extremes(case, study)[0]:
                searches[name, search.parameter, search.engine, search.setting] = search
    asked = [
        (one, searches[key])
        for one in limits
        if (key := (one.case, one.parameter, one.engine, one.setting)) in searches
        and one.parameter not in (ENERGY_PARAMETER, STABLE_STEP_PARAMETER)
    ]
    with ThreadPoolExecutor(JOBS) as workers:
        return list(workers.map(lambda each: try_sides(*each), asked))


def run_program(task: StudyRun, store: Store) -> Measurement:
    """The errors of a dynamics run as a program, at the actual motion of its drives."""
    if task.run != "dynamics":
        raise NoProgram(f"a program steps through time, and this is the {task.run}")
    drive = drive_ways(task.case, task.setting.engine)[0]
    try:
        used = setting_as_used(task.case, task.setting)
    except Diverged:  # the number of iterations is not known: take the largest
        used = task.setting.with_parameters(iterations=MAX_ITERATIONS)
    try:
        ran = run_stored_program(task.case, used, drive, store, TIMEOUT)
    except Unsupported as error:
        raise NoProgram(str(error)) from None
    if ran.failure:
        late = ran.failure.startswith(TIMED_OUT_PREFIX)
        return Measurement(
            outcome=Outcome.TIMED_OUT if late else Outcome.DIVERGED, message=ran.failure
        )
    return Measurement(errors=ran.driven)


def try_sides(limit: PrintedLimit, search: LimitSearch) -> BareLimit:
    """Run the programs before and beyond a limit, and at both of its values if it has two."""
    up, away = search.reach > search.start, 1.0 + DISTANCE
    last = limit.again if limit.again == limit.again else limit.value
    values = [
        step_by_factor(limit.value, away, search.start, not up),
        step_by_factor(last, away, search.reach, up),
    ]
    if limit.again == limit.again:
        values += [limit.value, limit.again]
        if isclose(limit.again, search.reach, rel_tol=DISTANCE):  # stress tried no value beyond it
            values[1] = limit.value
    try:
        before, beyond, *ends = (search.trial(value).failure for value in values)
    except NoProgram as why:
        return BareLimit(limit, "", "", f"no program: {why}")
    return BareLimit(limit, words(before), words(beyond), judge(before, beyond, *ends))


def judge(before: Failure | None, beyond: Failure | None, *ends: Failure | None) -> str:
    """The result for a limit from its runs before and beyond it, and at its first and last value.

    >>> failed = Failure("", BoundaryKind.UNSTABLE)
    >>> judge(None, failed), judge(failed, failed), judge(None, None)
    ('confirmed', 'fails before it', 'holds beyond it')
    >>> [judge(None, failed, *more) for more in ((failed, None), (failed, failed), (None, None))]
    ['confirmed', 'fails at its last value', 'holds at its first value']
    """
    if any(one and one.limit == BoundaryKind.OURS for one in (before, beyond, *ends)):
        return "a program took too long"
    if before:
        return "fails before it"
    if not beyond:
        return "holds beyond it"
    first, last = ends or (beyond, None)
    if not first:
        return "holds at its first value"
    return "fails at its last value" if last else CONFIRMED


def words(failure: Failure | None) -> str:
    """The result of a program in words."""
    return failure.message.replace("|", "¦") if failure else "holds"


def page(rows: Sequence[Sequence[str]]) -> str:
    """The document, of the cells of all rows."""
    counts = Counter(cells[-1] for cells in rows)
    return HEAD.format(
        count=len(rows),
        several=sum(" to " in cells[3] for cells in rows),
        results="\n".join(f"| {result} | {count} |" for result, count in counts.most_common()),
        rows="\n".join(f"| {' | '.join(cells)} |" for cells in rows),
    )


def cells(each: BareLimit) -> list[str]:
    """A row of the table of limits."""
    return [*each.limit.key, each.limit.words, each.before, each.beyond, each.result]


if __name__ == "__main__":
    main()
