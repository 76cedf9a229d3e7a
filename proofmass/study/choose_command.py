"""``proofmass choose``: the cheapest setting that is as good as is asked for, to paste."""

from pathlib import Path
from typing import Annotated, cast

import typer

from proofmass.case import Case
from proofmass.command import Dask, Jobs, answering, errors
from proofmass.errors import InputError
from proofmass.strict import Kind
from proofmass.study.choose import MARGIN, Cannot, choose, printed
from proofmass.study.command import Errors, Runs, measured, named, turnable
from proofmass.study.finer import refined
from proofmass.study.row import Row
from proofmass.study.run import pool
from proofmass.study.store import Store
from proofmass.study.trade import chosen


def choose_command(
    path: Annotated[Path, typer.Argument(help="A sidecar.", metavar="CASE")],
    error: Annotated[float, typer.Option(help="Largest error, as a share of the range of the "
                                         "reference.")],
    of: Annotated[Errors, typer.Option(help="Of what.")] = Errors.position,
    solver: Annotated[str, typer.Option(help="mujoco or pymunk.", show_default="any")] = "",
    run: Annotated[Runs | None, typer.Option(help="Which run of the case.", show_default="the "
                   "first of these that it has")] = None,
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder of proofmass trade; what "
                      "it lacks is run.")] = Path("trade"),
    jobs: Jobs = None,
    dask: Dask = None,
) -> None:
    """Print the cheapest measured setting whose error is as small as is asked for, to paste.

    Its measured error must be half of that, and it is run again, from a shifted start as well.
    Where the study's steps end above that, or a finer one promises to be cheaper, finer ones are
    measured.
    Exit code 0: found; 1: no setting is good enough; 2: bad input.
    """
    with answering(f"{output} keeps the runs"):
        cases = named([path])
        if len(cases) != 1:
            raise InputError(path, "", "give the sidecar of one case, such as models/fourbar.toml")
        case, = cases
        kind = chosen(case, cast(Kind | None, run and run.value))
        asked(case, kind, error, solver)
        if not turnable(case, kind):
            raise typer.Exit(1)
        study = measured([case], output, jobs, dask, kind)
        there(study.rows, of.value)
        with pool(jobs, dask) as workers, errors.status("looking for finer steps"):
            rows = refined(case, kind, study.rows, study.verdicts, of.value, error / MARGIN,
                           Store(output / "runs"), workers, solver)
        try:
            choice = choose(case, kind, rows, error, of.value, solver, study.verdicts)
        except Cannot as why:
            errors.print(f"{case.name}: {why}", markup=False)
            raise typer.Exit(1) from None
        print(printed(choice, case))


def asked(case: Case, kind: Kind, error: float, solver: str) -> None:
    """Raise ValueError for what cannot be chosen."""
    if not 0 < error < 1:
        raise ValueError(f"--error {error:g}: give a share of the range between 0 and 1, such as "
                         f"1e-5")
    known = dict.fromkeys(name.partition(":")[0] for name in case.run[kind].solvers)
    if solver and solver not in known:
        raise ValueError(f"--solver {solver}: {case.name} runs in {', '.join(known)}")


def there(rows: list[Row], of: str) -> None:
    """Raise ValueError if no run tells such an error, but some tell others."""
    kinds = dict.fromkeys(kind for row in rows for kind in row.errors)
    if kinds and of not in kinds:
        raise ValueError(f"--of {of}: no channel is one; there are: {', '.join(kinds)}")
