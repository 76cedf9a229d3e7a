"""``proofmass engines``: list engines, or run cases in several of them."""

import json
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from rich.table import Table

from proofmass.base.errors import BAD_INPUT
from proofmass.base.files import write_output
from proofmass.base.json_values import replace_nonfinite
from proofmass.base.strict import Kind
from proofmass.base.wording import format_list, number
from proofmass.batch.check import family_of
from proofmass.batch.pool import pool
from proofmass.case.case import Case
from proofmass.commands.command import (
    error_console,
    exit_on_error,
    print_errors,
    progress_bar,
    provide_engines,
)
from proofmass.commands.studies import read_cases, require_seconds
from proofmass.formats.terminal import make_console
from proofmass.run.asked import with_engines
from proofmass.sim.engines import (
    NoEngine,
    engine_names,
    engine_of,
    format_solver,
    hosted_names,
)
from proofmass.sim.hosts.engine import HostedEngine
from proofmass.sim.hosts.process import is_fetched
from proofmass.studies.cells import CellResult, cells_of, measure_cells
from proofmass.studies.engines.cost import (
    RANKED_ERRORS,
    EngineCosts,
    cost_record,
    measure_costs,
    write_costs,
)
from proofmass.studies.engines.cost_words import (
    describe_machine_load,
    describe_noise,
    state_word,
)
from proofmass.studies.engines.summary import summarize_engine
from proofmass.studies.store import Store
from proofmass.studies.study import Study
from proofmass.studies.trade.trade import SERIES_BUDGET
from proofmass.verdict.outcome import NOT_RUN_OUTCOMES, Outcome

TEXT_COLUMNS = "engine", "not reached"
ALL_ENGINES = "all"
"""The name that stands for all engines that compute."""


@dataclass(frozen=True)
class ListedEngine:
    """An engine as `proofmass engines` lists it.

    Attributes
    ----------
    name, title : str
    version : str
        That which runs.
    state : str
        Whether it runs at once.
    solves, licence, lacks, trap : str
    """

    name: str
    title: str
    version: str
    state: str
    solves: str = ""
    licence: str = ""
    lacks: str = ""
    trap: str = ""


def run_engines(
    paths: list[Path],
    engines: list[str],
    output: Path,
    jobs: int | None,
    dask: str | None,
    as_json: bool,
    cost: bool = False,
    budget: float = SERIES_BUDGET,
    runs: Sequence[Kind] = (),
) -> int:
    """Run ``proofmass engines``; `proofmass.commands.cli` describes its arguments.

    Returns
    -------
    int
        The exit code: `BAD_INPUT` if a sidecar is at fault; the other cases were run.
    """
    if not paths:
        with exit_on_error("nothing is written"):
            if cost:
                raise ValueError("--cost ranks engines in cases: give sidecars or folders")
            show_list(list_engines(), as_json)
        return 0
    with exit_on_error(f"{output} keeps the runs"):
        from proofmass.studies.engines.page import write_engines  # loads the report

        budget = require_seconds("--budget", budget)
        asked = provide_engines(named_engines(engines))
        cases, faults = read_cases(paths)
        print_errors(faults)
        cells = cells_of(cases, asked, runs)
        if left := [case.name for case in cases if runs and not set(runs) & set(case.run)]:
            what = " or ".join(runs)
            error_console.print(f"left out, since they have no run {what}: {format_list(left)}")
        study = Study(Store(output / "runs"))
        with pool(jobs, dask) as workers, progress_bar(len(cells), max_letters=40) as advance:
            results = measure_cells(cells, replace(study, workers=workers, progress=advance))
        data = {
            "kinds": {case.name: family_of(case.file, paths) for case in cases},
            "results": [one.record() for one in results],
        }
        text = json.dumps(data, indent=1, allow_nan=False)
        write_output(output / "engines.json", text)
        costs = None
        if cost:
            started = {one.case for one in results if one.outcome != Outcome.NO_START}
            ranked = [case for case in cases if case.name in started]
            costs = compare_costs(ranked, asked, study, jobs, dask, budget)
            write_costs(costs, output)
        page, exit_code = write_engines(output, output), BAD_INPUT if faults else 0
        if as_json:
            shown = data | ({"cost": cost_record(costs)} if costs else {})
            print(json.dumps(replace_nonfinite(shown), indent=1, allow_nan=False))
            return exit_code
        make_console().print(engine_table(asked, results))
        if costs:
            show_costs(costs)
        print(page.first)
    return exit_code


def compare_costs(
    cases: Sequence[Case],
    asked: tuple[str, ...],
    study: Study,
    jobs: int | None,
    dask: str | None,
    budget: float,
) -> EngineCosts:
    """Compare engines at equal cost, with a progress bar."""
    with pool(jobs, dask) as workers, progress_bar(max_letters=40) as advance:
        working = replace(study, workers=workers, progress=advance)
        return measure_costs([with_engines(case, asked) for case in cases], working, budget=budget)


def show_costs(costs: EngineCosts) -> None:
    """Print the ranks of engines at equal cost for each error, by their errors of positions.

    What makes times uncertain is printed on standard error.
    """
    for sentence in (describe_machine_load(costs.machine), describe_noise(costs), *costs.busy):
        error_console.print(sentence)
    kind = costs.kinds[0] if costs.kinds else ""
    for error in RANKED_ERRORS if kind else ():
        table = Table(box=None, header_style="bold", pad_edge=False)
        table.title, table.title_justify = f"time for an error of {number(error)}, {kind}", "left"
        for name in ("rank", "engine", "x first", "first in", "reached in", "not reached"):
            table.add_column(name, justify="left" if name in TEXT_COLUMNS else "right")
        for one in costs.ranked(kind, error):
            table.add_row(
                f"{one.rank or '–'}{'≈' * bool(one.tied)}",
                format_solver(one.engine),
                number(one.ratio.stated, 2),
                str(one.first),
                f"{one.reached} of {one.cases}",
                "; ".join(
                    f"{state_word(state)} in {', '.join(some)}" for state, some in one.lost.items()
                ),
            )
        make_console().print(table)


def named_engines(engines: Sequence[str]) -> list[str]:
    """The engines that are asked for; ``all`` stands for all that compute."""
    every = [name for name in engine_names() if engine_of(name).computes] + hosted_names()
    found = list[str]()
    for name in engines or [ALL_ENGINES]:
        found += every if name == ALL_ENGINES else [name]
    return list(dict.fromkeys(found))


def engine_table(asked: Sequence[str], results: Sequence[CellResult]) -> Table:
    """A row for each engine: its runs, and its errors."""
    table = Table(box=None, header_style="bold", pad_edge=False)
    names = ("engine", "runs", "median error", "median s", "silently wrong", "lost", "refused")
    for name in names:
        table.add_column(name, justify="left" if name == "engine" else "right", no_wrap=True)
    for solver in asked:
        own = [one for one in results if one.solver == solver]
        found = summarize_engine(solver, results)
        silent = sum(one.is_silently_wrong for one in own)
        refused = sum(one.outcome in NOT_RUN_OUTCOMES for one in own)
        lost = found.of - found.filled - refused
        middle = f"{found.middle:.1e}" if found.filled else "–"
        seconds = f"{found.seconds:.2g}" if found.filled else "–"
        runs = f"{found.filled} of {found.of}"
        table.add_row(found.title, runs, middle, seconds, str(silent), str(lost), str(refused))
    return table


def list_engines() -> list[ListedEngine]:
    """All engines, those of this interpreter first."""
    hosted = hosted_names()
    with ThreadPoolExecutor(4) as threads:
        states = dict(zip(hosted, threads.map(state_of_engine, hosted), strict=True))
    found = list[ListedEngine]()
    for name in (*engine_names(), *hosted):
        try:
            engine = engine_of(name)
            if isinstance(engine, HostedEngine):
                found.append(list_hosted(name, engine, states[name]))
            else:
                version = ", ".join(engine.versions().values())
                found.append(ListedEngine(name, engine.title, version, "runs here"))
        except NoEngine as error:
            found.append(ListedEngine(name, name, "", f"cannot be loaded: {error}"))
    return found


def state_of_engine(name: str) -> str:
    """Whether an engine in another interpreter runs at once."""
    try:
        engine = engine_of(name)
    except NoEngine as error:
        return f"cannot be loaded: {error}"
    if not isinstance(engine, HostedEngine):
        return "runs here"
    return is_fetched(engine.requires, engine.python)


def list_hosted(name: str, engine: HostedEngine, state: str) -> ListedEngine:
    """The entry of an engine in another interpreter."""
    about = engine.about
    lacks = ["motions in space"] * engine.planar + list(engine.lacks)
    return ListedEngine(
        name,
        engine.title,
        engine.version,
        state,
        about.solves,
        about.licence,
        ", ".join(lacks),
        about.trap,
    )


def show_list(engines: Sequence[ListedEngine], as_json: bool) -> None:
    """Print the list as a table or as JSON."""
    if as_json:
        print(json.dumps([asdict(one) for one in engines], indent=1))
        return
    table = Table(box=None, header_style="bold", pad_edge=False)
    for name in ("name", "version", "state", "how it solves", "licence", "lacks"):
        table.add_column(name, no_wrap=name in ("name", "version"))
    for one in engines:
        solves = one.solves + (f" (beware: {one.trap})" if one.trap else "")
        table.add_row(one.name, one.version, one.state, solves, one.licence, one.lacks)
    make_console().print(table)
    print("NAME==VERSION runs another version, such as --engine mujoco==3.6.0 --engine drake")
