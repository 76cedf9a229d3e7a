"""``proofmass stress``: find the limits at which simulations fail."""

from dataclasses import replace
from pathlib import Path

from proofmass.base.errors import InputError
from proofmass.batch.check import collect_inputs
from proofmass.batch.pool import pool
from proofmass.commands.command import (
    error_console,
    exit_on_error,
    progress_bar,
    provide_engines,
)
from proofmass.commands.studies import load_cases
from proofmass.formats.terminal import make_console
from proofmass.sim.model_source import ModelSource
from proofmass.sim.protocol.failures import BadModel
from proofmass.studies.store import Store
from proofmass.studies.stress.boundary import Boundary, write_boundaries
from proofmass.studies.stress.extremes import list_extremes
from proofmass.studies.stress.limit_search import LimitSearch
from proofmass.studies.stress.problems import list_problems
from proofmass.studies.stress.stable_steps import search_bare_model
from proofmass.studies.stress.stress import (
    cause_lines,
    find_boundaries,
    result_table,
    store_trials,
)
from proofmass.studies.study import Study


def run_stress(
    paths: list[Path] | None,
    output: Path,
    jobs: int | None,
    dask: str | None,
    only: str,
    engines: list[str],
) -> None:
    """Run ``proofmass stress``; `proofmass.commands.cli` describes its arguments."""
    with exit_on_error(f"{output} keeps the runs"):
        from proofmass.studies.stress.page import write_stress  # matplotlib is slow to load

        found = search_cases(paths or [], output, jobs, dask, only, provide_engines(engines))
        write_boundaries(found, output / "stress.csv")
        console = make_console()
        console.print(result_table(found))
        for line in cause_lines(found):
            console.print(line, markup=False, highlight=False)
        print(write_stress(output, output).first)


def search_cases(
    paths: list[Path],
    folder: Path,
    jobs: int | None,
    dask: str | None,
    only: str,
    engines: tuple[str, ...] = (),
) -> list[Boundary]:
    """Find boundaries with a progress bar on standard error, and print which do not apply."""
    study = Study(Store(folder / "runs"))
    searches = [] if paths else [store_trials(one, study.store) for one in list_problems()]
    problems: list[InputError] = []
    files = collect_inputs(paths, problems)
    if problems:
        raise problems[0]
    for file in (file for file in files if file.suffix != ".toml"):
        searches += search_without_sidecar(file, study.store, alone=len(files) == 1)
    sidecars = [file for file in files if file.suffix == ".toml"]
    for case in load_cases(sidecars, engines) if sidecars else ():
        ours, skipped = list_extremes(case, study)
        searches += ours
        for why in skipped:
            error_console.print(f"{case.name}: not varied: {why}")
    searches = [one for one in searches if only in one.parameter]
    if not searches:
        raise ValueError(f"--only {only}: no such parameter")
    with (
        pool(jobs, dask) as workers,
        progress_bar(len(searches), max_letters=40) as advance,
    ):
        return find_boundaries(searches, replace(study, workers=workers, progress=advance))


def search_without_sidecar(file: Path, store: Store, alone: bool) -> list[LimitSearch]:
    """The searches of a model without a sidecar; its faults are errors only if it is `alone`."""
    try:
        found = search_bare_model(ModelSource(file.absolute()), store)
    except (InputError, BadModel) as error:
        if alone:
            raise
        error_console.print(f"passed over: {error}", markup=False)
        return []
    error_console.print(
        f"{file}: no sidecar says what is right, so that its stable time steps alone are searched",
        markup=False,
    )
    return found
