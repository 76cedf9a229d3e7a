"""How accurate, how fast, how far: all cases that are stepped in time, or have rods.

    python -m benchmarks.accuracy [folder] [--quick]

Writes docs/accuracy.md and docs/accuracy.png from the study of `proofmass trade models` in the
folder (reports/trade); what that lacks is run, half an hour if it is all.  How far engines go is
told if `python -m benchmarks.stress` was run before.
"""

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from statistics import median

import numpy as np
from matplotlib import rc_context

from benchmarks import ROOT, accuracy_figure, command, folders
from benchmarks.accuracy_far import far
from benchmarks.accuracy_series import causes, orders
from proofmass.case import Case
from proofmass.outcome import Outcome
from proofmass.reference import grid
from proofmass.report.figures import save
from proofmass.report.style import RC
from proofmass.studies.command import named
from proofmass.studies.record import StudyRow
from proofmass.studies.run import pool
from proofmass.studies.store import Store
from proofmass.studies.trade.choose import MARGIN, Cannot, Choice, choose
from proofmass.studies.trade.search import search
from proofmass.studies.trade.series import Limits
from proofmass.studies.trade.trade import Trade, chosen, trade, write_study
from proofmass.studies.trade.trade_command import has_series, measured
from proofmass.studies.trade.verdict import Verdict
from proofmass.studies.trade.words import format_setting_briefly
from proofmass.wording import format_solver, number

ENGINES = ("mujoco", "pymunk")
WANTED = (1e-4, 1e-6)  # of the range of the positions
BUDGET = 120.0
"""Of each search [s]: more than `proofmass choose` takes by itself, in which a person waits."""
HEAD = """# How accurate, how fast, how far

`python -m benchmarks.accuracy` made this from `proofmass trade models`: {settings} settings of
{cases} cases, {runs} timed runs, on {machine}. Errors are the largest
of all positions and angles over a run, as shares of their ranges. Seconds are of this machine;
ratios travel better.

![Wall time over error, of all cases](accuracy.png)

*The band holds the middle half of all cases, the line is their median: wall time of the cheapest
setting that is so close, over the time that it simulates. A line ends where half of the cases
cannot go on.*
"""
CHOSEN = """## How accurate, how fast

What `proofmass choose CASE --error 1e-4` and `--error 1e-6` find with `--budget {budget}`, by
engine: the cheapest setting whose measured error is half of that and which is as good when it is
run again as pasted, and from a shifted start. × is how many times as long the engine's defaults
take when only their step is refined to the same error, by their measured order where no measured
step gets there; “never” where their error floor is above it.
"""


@dataclass(frozen=True)
class Pick:
    """What was chosen for an error of a case in an engine, or why nothing was."""

    case: str
    engine: str
    wanted: float
    choice: Choice | None
    why: str = ""

    @property
    def never(self) -> bool:
        """Whether the defaults never get there."""
        return self.choice is not None and "never get there" in self.choice.beside


def main(argv: Sequence[str] | None = None) -> None:
    parser = command(__doc__)
    parser.add_argument("folder", type=Path, nargs="?", default=ROOT / "reports" / "trade")
    given = parser.parse_args(argv)
    models = ROOT / "models"
    every = named([models / "linkages" / "pendulum.toml" if given.quick else models])
    with folders(given.quick, given.folder) as (folder, docs):
        cases = [c for c in sorted(every, key=lambda c: c.name) if has_series(c, None)]
        study = (
            trade(cases, Store(folder / "runs"), budget=0.01, repeats=1)
            if given.quick
            else measured(cases, folder, None, None, None)
        )
        write_study(study, folder)
        cases = study.cases
        stepped = [case for case in cases if "dynamics" in case.run]
        wanted = (1e-2,) if given.quick else WANTED
        rows = refined_rows(stepped, study, folder, wanted)
        found = picks(stepped, rows, study.verdicts, wanted)
        with rc_context(RC):
            save(
                accuracy_figure.accuracy_figure(study.rows, {c.name: time_of(c) for c in stepped}),
                docs / "accuracy",
            )
        (docs / "accuracy.svg").unlink()
        text = [
            head(study),
            CHOSEN.format(budget=number(BUDGET)),
            *summary(found),
            *table(found),
            *whys(found),
            *far(ROOT / "reports" / "stress" / "stress.csv"),
            *orders(study, cases),
            *causes(study),
        ]
        (docs / "accuracy.md").write_text("\n".join(text) + "\n", encoding="utf-8")


def time_of(case: Case) -> float:
    """How much time a dynamics run simulates [s]."""
    return float(np.ptp(grid(case, "dynamics")))


def refined_rows(
    cases: Sequence[Case], study: Trade, folder: Path, errors: Sequence[float]
) -> dict[str, list[StudyRow]]:
    """Settings of each case, with those that `choose` searches."""
    found = {case.name: [row for row in study.rows if row.case == case.name] for case in cases}
    store, jobs = Store(folder / "runs"), os.cpu_count() or 1

    def one(what: tuple[Case, str]) -> list[StudyRow]:
        case, engine = what
        return [
            row
            for wanted in errors
            for row in search(
                case,
                "position",
                wanted / MARGIN,
                store,
                workers,
                engine,
                limits=Limits(budget=BUDGET),
            )
        ]

    # more searches than processors, the longest first, so that no processor waits for one of them
    with pool() as workers, ThreadPoolExecutor(2 * jobs) as searches:
        asked = sorted(
            product(cases, ENGINES),
            key=lambda each: -expected(found[each[0].name], each[1], min(errors)),
        )
        for (case, _), rows in zip(asked, searches.map(one, asked), strict=True):
            found[case.name] += rows
    return found


def expected(rows: Sequence[StudyRow], engine: str, wanted: float) -> float:
    """Wall time [s] of a run that is so close, if errors fall with the square of its step."""
    return min(
        (
            row.seconds * max(row.reached("position") / wanted, 1.0) ** 0.5
            for row in rows
            if row.engine == engine and row.outcome == Outcome.RAN
        ),
        default=0.0,
    )


def picks(
    cases: Sequence[Case],
    rows: Mapping[str, list[StudyRow]],
    told: Sequence[Verdict],
    errors: Sequence[float],
) -> list[Pick]:
    """What `choose` finds of each case, in each engine, for each error."""
    verdicts = {case.name: [v for v in told if v.case == case.name] for case in cases}
    asked = [
        (case, engine, wanted)
        for case in cases
        for engine, wanted in product(ENGINES, errors)
        if any(row.engine == engine for row in rows[case.name])
    ]

    def one(what: tuple[Case, str, float]) -> Pick:
        case, engine, wanted = what
        try:
            return Pick(
                case.name,
                engine,
                wanted,
                choose(
                    case,
                    chosen(case, None),
                    rows[case.name],
                    wanted,
                    "position",
                    engine,
                    verdicts[case.name],
                ),
            )
        except Cannot as why:
            return Pick(case.name, engine, wanted, None, str(why))

    # the longest first; told in the order of the cases
    costs = [expected(rows[case.name], engine, wanted / MARGIN) for case, engine, wanted in asked]
    order = sorted(range(len(asked)), key=lambda k: -costs[k])
    with ThreadPoolExecutor(os.cpu_count()) as threads:
        found = dict(zip(order, threads.map(lambda k: one(asked[k]), order), strict=True))
    return [found[k] for k in range(len(asked))]


def head(study: Trade) -> str:
    """What was run."""
    machines = dict.fromkeys(row.machine for row in study.rows if row.machine)
    return HEAD.format(
        settings=len(study.rows),
        cases=len({row.case for row in study.rows}),
        runs=sum(len(row.repeats) for row in study.rows),
        machine=", ".join(machines),
    )


def summary(found: Sequence[Pick]) -> Iterator[str]:
    """How often, and how much cheaper, engine by engine."""
    yield (
        "| engine | error | found | dearest | cheapest | defaults never get there | "
        "median × | least × | median × where they do |"
    )
    yield "|---|---|---|---|---|---|---|---|---|"
    errors = dict.fromkeys(pick.wanted for pick in found)
    groups: list[tuple[str, str, Callable[[Pick], bool]]] = [
        (
            format_solver(engine),
            number(wanted),
            lambda p, e=engine, w=wanted: (p.engine, p.wanted) == (e, w),
        )
        for engine, wanted in product(ENGINES, errors)
    ]
    for engine, error, own in (*groups, ("both", "both", lambda p: True)):
        asked = [pick for pick in found if own(pick)]
        got = [pick for pick in asked if pick.choice]
        seconds = [pick.choice.row.seconds for pick in got if pick.choice]
        finite = [pick.choice.ratio for pick in got if pick.choice and pick.choice.ratio > 0]
        never = sum(pick.never for pick in got)
        every = [*finite, *[float("inf")] * never]
        cells = [f"{number(max(seconds))} s", f"{number(min(seconds))} s"] if seconds else ["", ""]
        middle = median(every) if every else float("nan")
        yield (
            f"| {engine} | {error} | {len(got)} of {len(asked)} | {' | '.join(cells)} | {never} "
            f"| {'never' if middle == float('inf') else number(middle)} "
            f"| {number(min(every, default=float('nan')))} "
            f"| {number(median(finite)) if finite else '—'} |"
        )
    yield ""


def table(found: Sequence[Pick]) -> Iterator[str]:
    """A row a case and engine."""
    errors = dict.fromkeys(pick.wanted for pick in found)
    asked = " | ".join(f"setting for {number(wanted)} | s | ×" for wanted in errors)
    yield f"| case | engine | {asked} |"
    yield "|---|---|" + "---|---|---|" * len(errors)
    last = ""
    for case, engine in dict.fromkeys((pick.case, pick.engine) for pick in found):
        cells = [
            cell
            for pick in found
            if (pick.case, pick.engine) == (case, engine)
            for cell in told(pick)
        ]
        yield f"| {case if case != last else ''} | {format_solver(engine)} | {' | '.join(cells)} |"
        last = case


def told(pick: Pick) -> tuple[str, str, str]:
    """Setting, seconds, and how much longer the defaults take."""
    if not pick.choice:
        return "cannot", "", ""
    row, ratio = pick.choice.row, pick.choice.ratio
    return (
        format_setting_briefly(row),
        number(row.seconds, 2),
        "never" if pick.never else number(ratio, 2),
    )


def whys(found: Sequence[Pick]) -> Iterator[str]:
    """Why there is no setting, case by case."""
    failed = [pick for pick in found if not pick.choice]
    if failed:
        yield "\nCannot, and why:\n"
        for pick in failed:
            yield f"- {pick.case}, {format_solver(pick.engine)}, {number(pick.wanted)}: {pick.why}."


if __name__ == "__main__":
    main()
