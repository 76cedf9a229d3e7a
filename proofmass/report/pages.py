"""The report: an index and a page for each case, which open from disk and load nothing else.

On demand the curves of a case are also written as files: a CSV table for each run, and one Parquet
file of all runs where pyarrow is installed.  Values are in SI units and radians.  A column is
``NAME SOLVER [UNIT]``, as `proofmass.recorded` reads it.  The reference of a solver is evaluated at
the motion that the solver's drives really had.  A column that is the same for all solvers is
written once, without a solver's name.
"""

import io
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from markupsafe import Markup

from proofmass.analytic.numerics import Array
from proofmass.case import Case
from proofmass.check import Result
from proofmass.files import (
    make_folder,
    output_permissions,
    protect,
    remove_output,
    write_output,
)
from proofmass.fingerprint import input_files
from proofmass.report.case_figures import Drawings, draw_case
from proofmass.report.case_page import gather_runs, render_case
from proofmass.report.data import PlottedRun, drive_units
from proofmass.report.index_page import STATIC as INDEX_STATIC
from proofmass.report.index_page import render_index
from proofmass.report.page import environment, slug, write_static
from proofmass.report.record import (
    History,
    Last,
    Record,
    extend_history,
    make_record,
    read_last,
    write_record,
)
from proofmass.report.study import ShownStudy
from proofmass.report.style import solver_looks
from proofmass.report.svg import inline_svg
from proofmass.report.thumbnail import Thumbnail
from proofmass.sim.protocol import drive_columns
from proofmass.units import si_unit

STATIC = (
    *("uPlot.js", "uPlot.css"),
    *("case.css", "case.js", "curves.js", "mechanism.js", "trend.js"),
    *INDEX_STATIC,
)


DATA_FOLDER = "data"
DERIVATIVE_UNITS = "", "/s", "/s^2"
Table = dict[str, Array]


@output_permissions()
def write_report(
    result: Result,
    folder: Path | str,
    progress: Callable[[str, int, int], None] = lambda *_: None,
    studies: Sequence[ShownStudy] = (),
    figures: bool = False,
    record: Record | None = None,
    last: Last | None = None,
    data: bool = False,
) -> Path:
    """Write the index, a page for each case, and every figure as SVG.

    Parameters
    ----------
    result : Result
        From `proofmass.check.check`.
    folder : path
        Folder of the report; it is made if needed, and pages of the same name are replaced.
    progress : callable, optional
        Called as ``progress(label, done, total)`` after each case.
    studies : sequence of ShownStudy
        Studies that the pages link to; see `proofmass.studies.pages.write_study_pages`.
    figures : bool
        Whether every figure is written as PNG as well, and figures of all curves: overlays, paths,
        differences.
    record, last : Record, Last, optional
        The record of this report, and that of the report that it is compared with; by default the
        one in `folder`.
    data : bool
        Whether the curves are written as well, see `proofmass.report.pages`.

    Returns
    -------
    Path
        The file ``index.html``.
    """
    folder = Path(folder)
    protect(file for case in result.cases for file in input_files(case))
    drawn = make_folder(make_folder(folder) / "figures")
    write_static(folder, STATIC)
    style, env = solver_looks(c.solver for c in result.comparisons), environment()
    record = record or make_record(result)
    own = read_last(folder)
    last = last or own
    before = own.record or last.record
    history = extend_history(before.history if before else History(), record)
    pictures = dict[str, Thumbnail | Markup | None]()
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        gathered = list(pool.map(partial(gather_runs, result), result.cases))
        futures = [
            pool.submit(
                draw_case,
                case,
                g.runs,
                g.views,
                style,
                drawn,
                slug(case.name),
                figures,
            )
            for case, g in zip(result.cases, gathered, strict=True)
        ]
        for k, case in enumerate(result.cases):
            drawings = futures[k].result()
            if data:
                write_curves(folder, case, gathered[k].runs)
            page = render_case(env, case, result, gathered[k], drawings, style, studies, history)
            write_output(folder / f"{slug(case.name)}.html", page)
            pictures[case.name] = drawings.moving or static_picture(case.name, drawings)
            progress(case.name, k + 1, len(result.cases))
    index = folder / "index.html"
    write_output(
        index,
        render_index(
            env,
            result,
            style,
            pictures,
            record,
            last,
            history,
            studies,
            {case.name: file_links(folder, case) for case in result.cases} if data else {},
            note_on_files(data),
        ),
    )
    write_record(folder, record, history)
    return index


def static_picture(name: str, drawings: Drawings) -> Markup:
    """Return the picture of a case without poses for the index: its first channel, or nothing."""
    svg = drawings.figures.get("thumbnail")
    return Markup(inline_svg(svg, f"{slug(name)}-thumbnail", name)) if svg else Markup()


def write_curves(folder: Path, case: Case, runs: list[PlottedRun]) -> None:
    """Write the curves of a case below a report's folder; a run without curves has no file.

    Older files of the case are removed, since they would look like files of this report.
    """
    place = make_folder(folder / DATA_FOLDER)
    for old in existing_files(place, case):
        remove_output(old)
    tables: dict[str, Table] = {view.kind: run_table(view) for view in runs if view.curves}
    for kind, table in tables.items():
        write_output(place / f"{slug(case.name)}-{kind}.csv", as_csv(table))
    if tables and has_parquet():
        write_output(place / f"{slug(case.name)}.parquet", as_parquet(tables))


def note_on_files(data: bool) -> str:
    """Format a note on files of curves that the report does not have; empty if it has all."""
    if not data:
        return "proofmass report --data writes the curves as tables."
    return (
        "" if has_parquet() else "With proofmass[parquet] the curves are written in Parquet, too."
    )


def file_links(folder: Path, case: Case) -> list[tuple[str, str]]:
    """Return labels and paths, from the report's folder, of the existing files of a case."""
    stem = f"{slug(case.name)}-"
    return [
        (
            "Parquet" if file.suffix == ".parquet" else f"{file.stem.removeprefix(stem)} (CSV)",
            f"{DATA_FOLDER}/{file.name}",
        )
        for file in existing_files(folder / DATA_FOLDER, case)
    ]


def existing_files(place: Path, case: Case) -> list[Path]:
    """Return the existing files of a case in a folder."""
    stem = slug(case.name)
    names = [*(f"{stem}-{kind}.csv" for kind in case.run), f"{stem}.parquet"]
    return [place / name for name in names if (place / name).is_file()]


def run_table(view: PlottedRun) -> Table:
    """Return the columns of a run; a solver that stopped early has NaN from there on."""
    unit = "m" if view.x_unit == "m" else "s" if view.x_unit == "s" else "rad"
    table: Table = {f"{view.x_name} [{unit}]": view.grid}
    for name, symbol, each in run_columns(view):
        differ = len({part.tobytes() for part in each.values()}) > 1
        for solver, values in list(each.items())[: None if differ else 1]:
            words = f"{name} {solver}" if differ and solver else name
            missing = np.full(view.grid.size - len(values), np.nan)
            table[f"{words} [{symbol}]"] = np.concatenate([values, missing])
    return table


def run_columns(view: PlottedRun) -> Iterator[tuple[str, str, dict[str, Array]]]:
    """Yield name, unit and curves by solver: of drives as they moved, of channels and references.

    A channel is yielded solver by solver, with the solver's name in that of the column.
    """
    if view.kind != "equilibrium":
        for row, (drive, unit) in enumerate(
            zip(view.case.drive, drive_units(view.case), strict=True)
        ):
            for order, (name, per) in enumerate(
                zip(drive_columns(drive.joint), DERIVATIVE_UNITS, strict=True)
            ):
                moved = {
                    s: c.drive[order][row]
                    for s, c in view.curves.items()
                    if c.drive and not c.by_profile
                }
                if moved:
                    yield name, f"{unit}{per}", moved
    for name in view.channels:
        symbol = si_unit(view.case.channels[name].unit or "1")[0] or "1"
        for word, source in (("", view.curves), (" reference", view.reference)):
            found = {s: c.channels[name] for s, c in source.items() if name in c.channels}
            if word and found:
                yield f"{name}{word}", symbol, found
            else:
                for solver, values in found.items():
                    yield f"{name} {solver}", symbol, {"": values}


def as_csv(table: Table) -> str:
    """Format a table as CSV with commas and points, with all digits; NaN is an empty cell."""
    lines = [",".join(f'"{name}"' if "," in name else name for name in table)]
    rows = np.stack(list(table.values()), axis=1).tolist()
    lines += [",".join("" if v != v else repr(v) for v in row) for row in rows]
    return "\n".join(lines) + "\n"


def has_parquet() -> bool:
    """Whether pyarrow, which writes Parquet, is installed."""
    return find_spec("pyarrow") is not None


def as_parquet(tables: dict[str, Table]) -> bytes:
    """Return the runs of a case as one Parquet table, with a column ``run``."""
    import pyarrow
    import pyarrow.parquet

    parts = [
        pyarrow.table({"run": [kind] * len(next(iter(table.values()))), **table})
        for kind, table in tables.items()
    ]
    whole = pyarrow.concat_tables(parts, promote_options="default")
    stream = io.BytesIO()
    pyarrow.parquet.write_table(whole, stream)
    return stream.getvalue()
