"""The page of cases beside engines, from ``engines.json``: a dot for an error, a mark for others.

The size of a dot is the decade of the largest error of positions, and the number stands beside it.
"""

from collections.abc import Sequence
from math import ceil, log10
from pathlib import Path
from typing import Any, NamedTuple

from proofmass.base.wording import number
from proofmass.report.page import slug
from proofmass.report.study import (
    PageWriter,
    StudyPages,
    prepare_folder,
    read_results,
    require_table,
)
from proofmass.sim.engines import format_solver
from proofmass.studies.cells import CHANNEL_KINDS, OTHER_KIND, CellResult, format_one_digit
from proofmass.studies.engines.cost import COST_TABLE
from proofmass.studies.engines.cost_page import write_cost_page
from proofmass.studies.engines.summary import summarize_engine
from proofmass.verdict.outcome import Outcome

ENGINES_TABLE = "engines.json"
SMALLEST_DECADE, LARGEST_DECADE = -12, -1
"""Decades of errors with the smallest and the largest dot."""
SMALLEST_DOT, LARGEST_DOT = 1.5, 8.0
"""Radii of these dots [px]."""
MARKS: dict[str, tuple[str, str]] = {
    Outcome.UNSUPPORTED: ("–", "refused"),
    Outcome.UNAVAILABLE: ("–", "unavailable"),
    Outcome.DIVERGED: ("✕", "diverged"),
    Outcome.CRASHED: ("✕", "crashed"),
    Outcome.TIMED_OUT: ("✕", "timed out"),
    Outcome.OUT_OF_MEMORY: ("✕", "out of memory"),
}
"""Marks and words of runs without curves."""
SILENT_MARK = "!"
"""Mark of a run that is silently wrong."""


class ShownCell(NamedTuple):
    """A cell of the table: its dot or mark, its words, and its title.

    `radius` is that of the dot [px], 0 without one; `state` is ``good``, ``silent``, ``lost`` or
    ``none``; `value` sorts the column.
    """

    radius: float
    mark: str
    words: str
    title: str
    state: str
    value: str


def write_engines(folder: Path | str, output: Path | str, home: str = "") -> StudyPages:
    """Write the page of a table, ``index.html``, from its file ``engines.json``.

    Raises
    ------
    InputError
        There is no such file in the folder, or something else wrote it.
    """
    file, output = require_table(folder, ENGINES_TABLE, "engines CASES"), Path(output)
    data = read_engines(file)
    results: list[CellResult] = data["results"]
    solvers = list(dict.fromkeys(one.solver for one in results))
    cases = list(dict.fromkeys((one.case, one.run) for one in results))
    places = {(one.case, one.run, one.solver): one for one in results}
    runs = dict(reversed(cases))  # the first of each case
    rows = [
        (
            case,
            run,
            slug(case) if runs[case] == run else slug(f"{case}-{run}"),
            data["kinds"].get(case, ""),
            [shown_cell(places.get((case, run, solver))) for solver in solvers],
        )
        for case, run in cases
    ]
    prepare_folder(output, (file,))
    costs = (Path(folder) / COST_TABLE).is_file() and write_cost_page(Path(folder), output, home)
    kinds = list(dict.fromkeys(kind for *_, kind, _ in rows if kind))
    page = PageWriter(output, home).write(
        "index.html",
        "engines.html",
        tones=(),
        solvers=[(solver, format_solver(solver)) for solver in solvers],
        rows=rows,
        kinds=kinds,
        summaries=[summarize_engine(solver, results) for solver in solvers],
        filled=sum(one.is_filled for one in results),
        count=len(results),
        cases=len(cases),
        legend=[(dot_radius(10.0**decade), f"1e{decade}") for decade in (-12, -9, -6, -3, -1)],
        readings=readings_of(results),
        table=ENGINES_TABLE,
        costs=costs.name if costs else "",
    )
    return StudyPages(page, {case: f"index.html#{slug(case)}" for case, _ in cases})


def read_engines(file: Path) -> dict[str, Any]:
    """The content of an ``engines.json`` with its records as objects."""

    def read(data: dict[str, Any]) -> dict[str, Any]:
        results = [CellResult.read(one) for one in data["results"]]
        return {"kinds": dict(data["kinds"]), "results": results}

    return read_results(file, "engines", read)


def shown_cell(result: CellResult | None) -> ShownCell:
    """What the table shows of a result."""
    if result is None:
        return ShownCell(0.0, "", "", "", "none", "")
    title = f"{result.case} {result.run}, {format_solver(result.solver)}: "
    if not result.is_filled:
        mark, words = MARKS.get(result.outcome, ("✕", str(result.outcome)))
        state = "none" if mark == "–" else "lost"
        return ShownCell(0.0, mark, words, title + (result.message or words), state, "")
    share = result.position
    words = format_one_digit(share)
    parts = [
        f"{kind} {number(worst.share)} ({worst.channel})"
        for kind in (*CHANNEL_KINDS, OTHER_KIND)
        if (worst := result.worst(kind))
    ]
    title += f"{'; '.join(parts)}; {number(result.seconds)} s"
    if result.is_silently_wrong:
        return ShownCell(0.0, SILENT_MARK, words, title, "silent", f"{share}")
    return ShownCell(dot_radius(share), "", words, title, "good", f"{share}")


def dot_radius(share: float) -> float:
    """The radius of the dot of an error [px], by its decade.

    >>> dot_radius(1e-12), dot_radius(0.1), dot_radius(0.0)
    (1.5, 8.0, 1.5)
    """
    decade = ceil(log10(share)) if share > 0 else SMALLEST_DECADE
    place = (decade - SMALLEST_DECADE) / (LARGEST_DECADE - SMALLEST_DECADE)
    return round(SMALLEST_DOT + min(max(place, 0.0), 1.0) * (LARGEST_DOT - SMALLEST_DOT), 1)


def readings_of(results: Sequence[CellResult]) -> str:
    """Which engines have their velocities read half a step later, in a sentence."""
    by_reading: dict[str, list[str]] = {}
    for one in results:
        if reading := one.settings.get("reading"):
            names = by_reading.setdefault(str(reading), [])
            if (title := format_solver(one.solver)) not in names:
                names.append(title)
    return "; ".join(f"{reading}: {', '.join(names)}" for reading, names in by_reading.items())
