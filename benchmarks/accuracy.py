"""Errors, wall times and limits of all cases that are stepped in time or have rods.

    python -m benchmarks.accuracy [folder] [--quick]

Writes docs/accuracy.md and docs/accuracy.png from the study that `proofmass trade models` keeps in
the folder (reports/trade).  Runs that the study lacks are made; a whole study takes half an hour.
The section on limits is written only if `python -m benchmarks.stress` was run before.
"""

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import product
from math import inf, isfinite
from pathlib import Path
from statistics import median

import numpy as np
from matplotlib import rc_context

from benchmarks import ROOT, accuracy_figure, command, folders
from benchmarks.accuracy_far import far
from benchmarks.accuracy_series import causes, orders
from proofmass.base.wording import number
from proofmass.batch.pool import pool
from proofmass.case.case import Case
from proofmass.commands.studies import load_cases
from proofmass.commands.trade import has_series, measure_cases
from proofmass.reference.samples import run_samples
from proofmass.report.figures import save
from proofmass.report.style import RC
from proofmass.sim.engines import format_solver
from proofmass.studies.record import StudyRow
from proofmass.studies.store import Store
from proofmass.studies.study import Study
from proofmass.studies.trade.choose import ERROR_MARGIN, Choice, NoGoodSetting, choose
from proofmass.studies.trade.search import search
from proofmass.studies.trade.series import Limits
from proofmass.studies.trade.trade import Trade, kind_to_study, trade, write_study
from proofmass.studies.trade.verdict import Verdict
from proofmass.studies.trade.words import format_setting_briefly
from proofmass.verdict.outcome import Outcome

ENGINES = ("mujoco", "pymunk")
WANTED_ERRORS = (1e-4, 1e-6)  # shares of the range of the positions
BUDGET = 120.0
"""Wall time [s] of each search: more than the default of `proofmass choose`, since nobody waits."""
HEAD = """# How accurate, how fast, how far

`python -m benchmarks.accuracy` made this page from `proofmass trade models`: {settings} settings of
{cases} cases, {runs} timed runs, on {machine}. An error is the largest
error of all positions and angles over a run, as a share of their ranges. Wall times in seconds are
those of this machine; ratios of wall times differ less between machines.

![Wall time over error, of all cases](accuracy.png)

*The vertical axis is the wall time of the cheapest setting that reaches an error, divided by the
simulated time. The line is the median of all cases, and the band contains the middle half of them.
A line ends at the error that half of the cases do not reach.*
"""
CHOSEN = """## How accurate, how fast

The tables show what `proofmass choose CASE --error 1e-4` and `--error 1e-6` find with
`--budget {budget}` in each engine: the cheapest setting whose measured error is at most half of the
wanted error, and whose error is at most the wanted one when the setting is run again as it would be
pasted, and from a shifted start. The column × is a ratio of wall times: the engine's defaults, with
only their step refined until they reach the same error, over the setting. Where no measured step
reaches it, the time of the defaults is extrapolated with their measured order; “never” means that
their error floor is above the wanted error. “cannot” means that no setting was found.
"""


@dataclass(frozen=True)
class Pick:
    """The setting that `choose` found for an error of a case in an engine, or why it found none."""

    case: str
    engine: str
    wanted: float
    choice: Choice | None
    why: str = ""

    @property
    def never(self) -> bool:
        """Whether the engine's defaults cannot reach the error with any step."""
        return self.choice is not None and self.choice.ratio == inf


def main(argv: Sequence[str] | None = None) -> None:
    parser = command(__doc__)
    parser.add_argument("folder", type=Path, nargs="?", default=ROOT / "reports" / "trade")
    given = parser.parse_args(argv)
    models = ROOT / "models"
    every = load_cases([models / "linkages" / "pendulum.toml" if given.quick else models])
    with folders(given.quick, given.folder) as (folder, docs):
        cases = [c for c in sorted(every, key=lambda c: c.name) if has_series(c, None)]
        study = (
            trade(cases, Study(Store(folder / "runs")), budget=0.01, repeats=1)
            if given.quick
            else measure_cases(cases, folder, None, None, None)
        )
        write_study(study, folder)
        cases = study.cases
        stepped = [case for case in cases if "dynamics" in case.run]
        wanted = (1e-2,) if given.quick else WANTED_ERRORS
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
            *reasons(found),
            *far(ROOT / "reports" / "stress" / "stress.csv"),
            *orders(study, cases),
            *causes(study),
        ]
        (docs / "accuracy.md").write_text("\n".join(text) + "\n", encoding="utf-8")


def time_of(case: Case) -> float:
    """Simulated time of a dynamics run [s]."""
    return float(np.ptp(run_samples(case, "dynamics")))


def refined_rows(
    cases: Sequence[Case], study: Trade, folder: Path, errors: Sequence[float]
) -> dict[str, list[StudyRow]]:
    """Settings of each case that the study measured, and those that the search of `choose` adds."""
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
                wanted / ERROR_MARGIN,
                Study(store, workers),
                engine,
                limits=Limits(budget=BUDGET),
            )
        ]

    # More searches than processors run at once, the longest first, so that no processor is idle.
    with pool() as workers, ThreadPoolExecutor(2 * jobs) as searches:
        asked = sorted(
            product(cases, ENGINES),
            key=lambda each: -expected(found[each[0].name], each[1], min(errors)),
        )
        for (case, _), rows in zip(asked, searches.map(one, asked), strict=True):
            found[case.name] += rows
    return found


def expected(rows: Sequence[StudyRow], engine: str, wanted: float) -> float:
    """Wall time [s] of a run with the wanted error, if errors fall with the square of the step."""
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
    verdicts: Sequence[Verdict],
    errors: Sequence[float],
) -> list[Pick]:
    """The result of `choose` for each case, engine and error."""
    own = {case.name: [v for v in verdicts if v.case == case.name] for case in cases}
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
                    kind_to_study(case, None),
                    rows[case.name],
                    wanted,
                    "position",
                    engine,
                    own[case.name],
                ),
            )
        except NoGoodSetting as why:
            return Pick(case.name, engine, wanted, None, str(why))

    # The longest run first; the results are returned in the order of the cases.
    costs = [
        expected(rows[case.name], engine, wanted / ERROR_MARGIN) for case, engine, wanted in asked
    ]
    order = sorted(range(len(asked)), key=lambda k: -costs[k])
    with ThreadPoolExecutor(os.cpu_count()) as threads:
        found = dict(zip(order, threads.map(lambda k: one(asked[k]), order), strict=True))
    return [found[k] for k in range(len(asked))]


def head(study: Trade) -> str:
    """The first paragraphs of the page, with the numbers of settings, cases and runs."""
    machines = dict.fromkeys(row.machine for row in study.rows if row.machine)
    return HEAD.format(
        settings=len(study.rows),
        cases=len({row.case for row in study.rows}),
        runs=sum(len(row.repeats) for row in study.rows),
        machine=", ".join(machines),
    )


def summary(found: Sequence[Pick]) -> Iterator[str]:
    """The table of each engine: how many settings were found, and how much cheaper they are."""
    yield (
        "| engine | error | found | longest time | shortest time | defaults never reach it | "
        "median × | smallest × | median × where they reach it |"
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
        finite = [pick.choice.ratio for pick in got if pick.choice and isfinite(pick.choice.ratio)]
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
    """The table of settings, a row for each case and engine."""
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
            for cell in pick_cells(pick)
        ]
        yield f"| {case if case != last else ''} | {format_solver(engine)} | {' | '.join(cells)} |"
        last = case


def pick_cells(pick: Pick) -> tuple[str, str, str]:
    """The setting, its wall time in seconds, and the ratio of the defaults' time to it."""
    if not pick.choice:
        return "cannot", "", ""
    row, ratio = pick.choice.row, pick.choice.ratio
    return (
        format_setting_briefly(row),
        number(row.seconds, 2),
        "never" if pick.never else number(ratio, 2),
    )


def reasons(found: Sequence[Pick]) -> Iterator[str]:
    """The reasons why `choose` found no setting, case by case."""
    failed = [pick for pick in found if not pick.choice]
    if failed:
        yield "\nCases without a setting, with the reason:\n"
        for pick in failed:
            yield f"- {pick.case}, {format_solver(pick.engine)}, {number(pick.wanted)}: {pick.why}."


if __name__ == "__main__":
    main()
