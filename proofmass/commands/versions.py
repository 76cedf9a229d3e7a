"""``proofmass versions``: what changed between versions of an engine, and in which."""

import json
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from proofmass.base.errors import InputError
from proofmass.base.files import write_output
from proofmass.base.wording import format_count
from proofmass.batch.check import collect_inputs, load_validated, rename_case, unique_names
from proofmass.batch.pool import pool
from proofmass.case.case import Case
from proofmass.commands.command import error_console, exit_on_error, progress_bar, provide_engines
from proofmass.formats.terminal import make_console
from proofmass.sim.engines import VERSION_MARK, NoEngine, engine_of, format_solver
from proofmass.sim.hosts.engine import HostedEngine
from proofmass.sim.hosts.releases import list_releases
from proofmass.sim.protocol.failures import Unsupported
from proofmass.studies.cells import Cell, cells_of
from proofmass.studies.store import Store
from proofmass.studies.study import Study
from proofmass.studies.versions.bare import BareCell
from proofmass.studies.versions.bisect import MakeCell, VersionSeries, measure_versions
from proofmass.studies.versions.changes import VersionChange
from proofmass.studies.versions.table import as_data, change_table, date_lines


def run_versions(
    paths: list[Path],
    engines: list[str],
    every: bool,
    since: str,
    output: Path,
    jobs: int | None,
    dask: str | None,
    as_json: bool,
) -> int:
    """Run ``proofmass versions``; `proofmass.commands.cli` describes its arguments.

    Returns
    -------
    int
        The exit code: 1 if something changed.
    """
    with exit_on_error(f"{output} keeps the runs"):
        from proofmass.studies.versions.page import write_versions  # loads the report

        name, versions = asked_versions(engines, every, since)
        series = list_series(paths, name, versions)
        study = Study(Store(output / "runs"))
        with pool(jobs, dask) as workers, progress_bar(max_letters=40) as advance:
            working = replace(study, workers=workers, progress=advance)
            measure_versions(series, working, every=not every)
        changes = [change for one in series for change in one.changes(study.store)]
        changes.sort(key=lambda one: versions.index(one.after))
        data = json.dumps(as_data(series, changes, name), indent=1, allow_nan=False)
        write_output(output / "versions.json", data)
        page = write_versions(output, output)
        if as_json:
            print(data)
        else:
            print_changes(series, changes, name, versions)
            print(page.first)
    return int(bool(changes))


def asked_versions(engines: Sequence[str], every: bool, since: str) -> tuple[str, tuple[str, ...]]:
    """The engine of a comparison, and its versions in their order.

    Raises
    ------
    NoEngine, Unsupported
        The engines are not versions of one engine, or it has no other versions.
    """
    names = list(dict.fromkeys(one.partition(VERSION_MARK)[0] for one in engines))
    if len(names) != 1:
        raise NoEngine(
            "give versions of one engine, such as --engine mujoco==3.3.7 --engine mujoco==4.0.0, "
            "or --engine mujoco --all"
        )
    name, given = names[0], [v for one in engines if (v := one.partition(VERSION_MARK)[2])]
    if not every:
        if len(given) < 2:
            raise NoEngine(f"give two versions of {name} or more, or --all for all its releases")
        provide_engines([f"{name}{VERSION_MARK}{version}" for version in given])
        return name, tuple(dict.fromkeys(given))
    hosted = engine_of(f"{name}{VERSION_MARK}{given[0] if given else '0'}")
    if not isinstance(hosted, HostedEngine):
        raise Unsupported(f"{hosted.title} is not run in other versions")
    package = hosted.requires[0].partition(VERSION_MARK)[0]
    oldest = since or (given[0] if given else hosted.oldest or "0")
    newest = given[-1] if given[1:] else ""
    with error_console.status(f"asking for releases of {package}") as status:

        def show(version: str) -> None:
            status.update(f"releases of {package}: {version}")

        return name, tuple(list_releases(package, oldest, newest, show))


def list_series(paths: list[Path], engine: str, versions: tuple[str, ...]) -> list[VersionSeries]:
    """The series of all cases below the paths, and of models without a sidecar.

    Raises
    ------
    InputError
        The first error of a path or of a case.
    """
    problems: list[InputError] = []
    files = collect_inputs(paths, problems)
    if problems:
        raise problems[0]
    names, found = unique_names(files), list[VersionSeries]()
    for file in files:
        if file.suffix == ".toml":
            case = rename_case(load_validated(file.absolute()), names[file])
            make: MakeCell = partial(case_cell, case, engine)
        else:
            make = partial(model_cell, file.absolute(), names[file], engine)
        found.append(VersionSeries(names[file], make, versions))
    if not found:
        raise InputError(paths[0], "", "no case and no model")
    return found


def case_cell(case: Case, engine: str, version: str) -> Cell:
    """The run of a case in a version, see `cells_of`."""
    (cell,) = cells_of([case], [f"{engine}{VERSION_MARK}{version}"])
    return cell


def model_cell(model: Path, name: str, engine: str, version: str) -> BareCell:
    """The motion of a model without a sidecar in a version."""
    return BareCell(model, name, f"{engine}{VERSION_MARK}{version}")


def print_changes(
    series: Sequence[VersionSeries],
    changes: Sequence[VersionChange],
    engine: str,
    versions: Sequence[str],
) -> None:
    """Print the table of changes, and a line for each version in which something changed."""
    console = make_console()
    runs = sum(len(one.results) for one in series)
    if changes:
        console.print(change_table(changes))
    for line in date_lines(changes):
        console.print(line)
    changed = {one.case for one in changes}
    console.print(
        f"{format_count(len(changed), 'case')} of {len(series)} changed between "
        f"{format_solver(engine)} {versions[0]} and {versions[-1]}: {format_count(runs, 'run')} in "
        f"{format_count(len(versions), 'version')}"
    )
