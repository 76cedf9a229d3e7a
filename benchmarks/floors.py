"""Comparison of the error floors that `proofmass trade` states with programs in bare engines.

    python -m benchmarks.floors [folder] [--only CASE ...] [--quick]

Writes docs/floors.md from the study that `python -m benchmarks.accuracy` keeps in the folder
(reports/trade).  The setting of each floor of a dynamics run is written as programs with the
measured step, half and a quarter of it; the programs run in interpreters without proofmass.
With --only these cases are measured if the folder lacks them, and the page of these cases is
printed and not written.
"""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from benchmarks import ROOT, command, folders
from proofmass.base.wording import number
from proofmass.case.case import Case
from proofmass.commands.studies import load_cases
from proofmass.commands.trade import has_series, measure_cases
from proofmass.reference.case_model import compiled_model
from proofmass.sim.protocol.failures import Unsupported
from proofmass.studies.record import NAN, Setting, StudyRow
from proofmass.studies.store import Store
from proofmass.studies.study import Study
from proofmass.studies.trade.floor_cause import ROUNDING_CAUSE, halved_settings
from proofmass.studies.trade.program import ProgramRun, drive_ways, run_stored_program
from proofmass.studies.trade.series import is_floor, is_unchanged
from proofmass.studies.trade.trade import Trade, trade
from proofmass.studies.trade.varied import list_series
from proofmass.studies.trade.verdict import Verdict
from proofmass.studies.trade.verify import setting_as_used

TIMEOUT = 120.0
"""Wall time after which a program is ended [s]; the longest has a quarter of the step."""
JOBS = 2
HEAD = """# Error floors in bare engines

`python -m benchmarks.floors` made this page. `proofmass trade` states {count} error floors in
dynamics runs, in {settings} settings of {cases} cases. Each setting was written as three programs,
with the measured step, half and a quarter of it, and these were run by themselves. Programs do not
import proofmass; tests run them where it cannot be imported. The errors are those of the CSV files
that the programs wrote, as shares of the range. They are evaluated at the actual motion of the
drives, for which the files have columns, because `trade` states floors in this way. At the
prescribed motion the error of the drive is added if the drive changes its speed; `trade` states it
in addition to the floor.

A floor is *confirmed* if the two halvings each change the program's error by less than 5 %, and
the error is within 5 % of the stated one. For a floor that is caused by rounding, the errors with
finer steps must be larger or the same.

| result | floors |
|---|---|
{results}
"""
TABLE = """
## Floors that were not confirmed

| case | engine | series | error of | stated | bare | half the step | a quarter | cause |
|---|---|---|---|---|---|---|---|---|
"""


@dataclass(frozen=True)
class BareFloor:
    """A floor that a study states, and runs of programs with the step, half and a quarter of it.

    `why` is the reason if there are no programs.
    """

    verdict: Verdict
    runs: tuple[ProgramRun, ...] = ()
    why: str = ""

    @property
    def errors(self) -> list[float]:
        """Errors of the programs [share of range]; NaN for one that failed or has no curves."""
        return [run.driven.get(self.verdict.kind, NAN) for run in self.runs]

    @property
    def result(self) -> str:
        """Whether the floor was confirmed, or why it was not, in words."""
        if self.why:
            return f"no program: {self.why}"
        if failed := next((run.failure for run in self.runs if run.failure), ""):
            return f"a program failed: {failed}"
        errors = self.errors
        if errors[0] != errors[0]:
            return f"programs have no curves of {self.verdict.kind}"
        if self.verdict.cause == ROUNDING_CAUSE:
            worse = all(fine > 0.95 * errors[0] for fine in errors[1:])
            return "confirmed" if worse else "a finer step is better"
        if is_floor(errors) and is_unchanged(self.verdict.floor, errors[0]):
            return "confirmed"
        return "another error" if is_floor(errors) else "a halving of the step changes the error"


def main(argv: Sequence[str] | None = None) -> None:
    """Confirm the floors of all cases, or of the pendulum."""
    parser = command(__doc__)
    parser.add_argument("folder", type=Path, nargs="?", default=ROOT / "reports" / "trade")
    parser.add_argument("--only", nargs="+", metavar="CASE", help="names of cases")
    given = parser.parse_args(argv)
    models = ROOT / "models"
    every = load_cases([models / "linkages" / "pendulum.toml" if given.quick else models])
    every = [case for case in every if not given.only or case.name in given.only]
    with folders(given.quick, given.folder) as (folder, docs):
        cases = [case for case in every if has_series(case, None)]
        store = Store(folder / "runs")
        study = (
            trade(cases, Study(store), budget=0.01, repeats=1)
            if given.quick
            else measure_cases(cases, folder, None, None, None)
        )
        found = list(confirm(study, store))
        if given.only:
            print(page(found))
        else:
            (docs / "floors.md").write_text(page(found), encoding="utf-8")


def confirm(study: Trade, store: Store) -> Iterator[BareFloor]:
    """Run the settings of all floors of dynamics as programs."""
    cases = {case.name: case for case in study.cases}
    floors = {
        verdict: row_of(study, verdict)
        for verdict in study.verdicts
        if verdict.floor > 0 and verdict.run == "dynamics"
    }
    with ThreadPoolExecutor(JOBS) as workers:
        futures = {
            row.key: workers.submit(run_programs, cases[row.case], row, store)
            for row in floors.values()
        }
        for verdict, row in floors.items():
            runs, why = futures[row.key].result()
            yield BareFloor(verdict, runs, why)


def row_of(study: Trade, verdict: Verdict) -> StudyRow:
    """The setting at which a floor was measured."""
    return next(
        row
        for row in study.rows
        if (row.case, row.engine, row.series) == (verdict.case, verdict.engine, verdict.series)
        and row.errors.get(verdict.kind) == verdict.floor
    )


def run_programs(case: Case, row: StudyRow, store: Store) -> tuple[tuple[ProgramRun, ...], str]:
    """Runs of programs with the step of a setting, half and a quarter of it, or why none exist."""
    series = next(one for one in list_series(case, "dynamics") if one.name == row.series)
    setting = Setting(row.engine, row.parameters)
    drive = drive_ways(case, row.engine)[0]
    finer = halved_settings("dynamics", series, setting, float(compiled_model(case).opt.timestep))
    try:
        return tuple(
            run_stored_program(case, setting_as_used(case, one), drive, store, TIMEOUT)
            for one in (setting, *finer)
        ), ""
    except Unsupported as error:
        return (), str(error)


def page(found: Sequence[BareFloor]) -> str:
    """The document."""
    counts = Counter(each.result for each in found)
    head = HEAD.format(
        count=len(found),
        settings=len({(v.case, v.engine, v.series) for v in (each.verdict for each in found)}),
        cases=len({each.verdict.case for each in found}),
        results=result_rows(counts),
    )
    others = [each for each in found if each.result != "confirmed"]
    return head + (TABLE + "\n".join(map(line, others)) + "\n" if others else "")


def result_rows(counts: Mapping[str, int]) -> str:
    """The lines of the first table, the most frequent result first."""
    return "\n".join(f"| {result} | {count} |" for result, count in Counter(counts).most_common())


def line(each: BareFloor) -> str:
    """A line of the table of floors."""
    v = each.verdict
    errors = [number(error, 2) for error in each.errors] or ["–"] * 3
    cells = [v.case, v.engine, v.series, v.kind, number(v.floor, 2), *errors]
    return f"| {' | '.join(cells)} | {v.cause}; {each.result} |"


if __name__ == "__main__":
    main()
