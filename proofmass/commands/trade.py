"""``proofmass trade``: measure the cost of accuracy, and the error floors that limit it."""

from itertools import groupby
from pathlib import Path

import typer
from rich.table import Table

from proofmass.base.strict import Kind
from proofmass.batch.pool import pool
from proofmass.case.case import Case
from proofmass.commands.command import (
    error_console,
    exit_on_error,
    progress_bar,
    provide_engines,
)
from proofmass.commands.studies import load_cases, require_seconds
from proofmass.formats.terminal import make_console, three_digits
from proofmass.studies import DEFAULT_LONGEST_RUN
from proofmass.studies.store import Store
from proofmass.studies.study import Study
from proofmass.studies.trade.orders import is_unexpected
from proofmass.studies.trade.trade import (
    Trade,
    describe_limits,
    kind_to_study,
    least_seconds,
    trade,
    write_study,
)
from proofmass.studies.trade.varied import list_series
from proofmass.studies.trade.verdict import Verdict
from proofmass.studies.trade.words import format_varied
from proofmass.verdict.outcome import Outcome

TABLE_ERRORS = (1e-4, 1e-6)  # errors for which the table has the processor time
LIMIT_COLUMN = "cause of the error floor, or how far the series came"


def run_trade(
    paths: list[Path],
    output: Path,
    jobs: int | None,
    dask: str | None,
    longest: float,
    kind: Kind | None,
    error: str,
    engines: list[str],
) -> None:
    """Run the command ``proofmass trade``; `proofmass.commands.cli` describes its options."""
    with exit_on_error(f"{output} keeps the runs"):
        from proofmass.studies.trade.page import write_trade  # matplotlib is slow to load

        loaded = load_cases(paths, provide_engines(engines))
        if not (cases := [case for case in loaded if has_series(case, kind)]):
            raise typer.Exit(0)
        study = measure_cases(
            cases, output, jobs, dask, kind, require_seconds("--longest", longest)
        )
        write_study(study, output)
        print_table(study, error)
        error_console.print(describe_limits(longest), markup=False, highlight=False)
        print(write_trade(output, output).first if study.rows else output / "trade.csv")
    raise typer.Exit(int(not any(row.outcome == Outcome.RAN for row in study.rows)))


def has_series(case: Case, kind: Kind | None) -> bool:
    """Whether a case has a convergence series; print a message if not."""
    which = kind_to_study(case, kind)
    if list_series(case, which):
        return True
    error_console.print(
        f"{case.name}: no convergence series in its {which}, which both engines solve to rounding"
    )
    return False


def measure_cases(
    cases: list[Case],
    folder: Path,
    jobs: int | None,
    dask: str | None,
    kind: Kind | None,
    longest: float = DEFAULT_LONGEST_RUN,
) -> Trade:
    """Run `trade` with a progress bar on standard error; then print which motions are chaotic."""
    with pool(jobs, dask) as workers, progress_bar(max_letters=40) as advance:
        study = trade(cases, Study(Store(folder / "runs"), workers, longest, advance), kind)
    for case, motion in {v.case: v.motion for v in study.verdicts if v.motion}.items():
        error_console.print(f"{case}: {motion}", markup=False, highlight=False)
    return study


def print_table(study: Trade, kind: str) -> None:
    """Print a table with one row for each convergence series on standard output."""
    table = Table(box=None, header_style="bold", pad_edge=False)
    for name in (
        "case",
        "series",
        "order",
        "expected",
        "error floor",
        "best",
        *(f"s for {error:g}" for error in TABLE_ERRORS),
        LIMIT_COLUMN,
    ):
        right = name not in ("case", "series", LIMIT_COLUMN)
        table.add_column(name, justify="right" if right else "left", no_wrap=right)
    by_series = {(v.case, v.series): v for v in study.verdicts if v.kind == kind}
    last = ""
    for (case, series), rows in groupby(study.rows, lambda row: (row.case, row.series)):
        own = list(rows)
        costs = [three_digits(least_seconds(own, kind, error)) for error in TABLE_ERRORS]
        best = min((row.errors[kind] for row in own if kind in row.errors), default=float("nan"))
        verdict = by_series.get((case, series), Verdict(case, "", "", series, kind))
        failed = next(
            (
                f"{format_varied(row)}: {row.outcome}: {row.message}"
                for row in own
                if row.outcome != Outcome.RAN
            ),
            "",
        )
        table.add_row(
            case if case != last else "",
            series,
            *format_orders(verdict),
            three_digits(verdict.floor),
            three_digits(best),
            *costs,
            "; ".join(filter(None, (verdict.cause, verdict.reached, verdict.worse, failed))),
        )
        last = case
    if table.row_count:
        make_console().print(table)


def format_orders(verdict: Verdict) -> tuple[str, str]:
    """The observed order, with a mark if theory expects another one, and the expected order."""
    observed, expected = verdict.observed, verdict.expected
    return (
        f"{observed:.2f}{' !' if is_unexpected(observed, expected) else ''}"
        if observed == observed
        else "–",
        f"{expected:g}" if expected == expected else "–",
    )
