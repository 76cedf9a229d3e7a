"""The report: an index and a page for each case, which open from disk and load nothing else.

On demand the curves of a case are also written as files: a CSV table for each run, and one Parquet
file of all runs where pyarrow is installed.  Values are in SI units and radians.  A column is
``NAME SOLVER [UNIT]``, as `proofmass.base.recorded` reads it.  The reference of a solver is
evaluated at the motion that the solver's drives really had.  A column that is the same for all
solvers is written once, without a solver's name.
"""

import io
import os
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from importlib.util import find_spec
from pathlib import Path
from threading import Lock

import numpy as np
from markupsafe import Markup

from proofmass.base.arrays import Array
from proofmass.base.files import (
    make_folder,
    output_permissions,
    protect,
    remove_output,
    write_output,
)
from proofmass.base.grouping import group_by
from proofmass.base.units import si_unit
from proofmass.batch.check import Result, add_part
from proofmass.case.case import Case
from proofmass.report.case_figures import Drawings, draw_case
from proofmass.report.case_page import gather_runs, render_case
from proofmass.report.data import PlottedRun, drive_units
from proofmass.report.index_page import STATIC as INDEX_STATIC
from proofmass.report.index_page import render_index, write_index_files
from proofmass.report.model_page import model_pages
from proofmass.report.page import environment, slug, write_static
from proofmass.report.record import (
    History,
    Last,
    Made,
    Record,
    extend_history,
    extend_with_case,
    make_record,
    read_last,
    record_start,
    write_record,
)
from proofmass.report.study import ShownStudy
from proofmass.report.style import Look, solver_looks
from proofmass.report.svg import inline_svg
from proofmass.report.thumbnail import Thumbnail
from proofmass.run.case_files import input_files
from proofmass.sim.protocol.curves import drive_columns

STATIC = (
    *("uPlot.js", "uPlot.css"),
    *("case.css", "case.js", "curves.js", "mechanism.js", "trend.js"),
    *("model.css", "model.js"),
    *INDEX_STATIC,
)


DATA_FOLDER = "data"
DERIVATIVE_UNITS = "", "/s", "/s^2"
Table = dict[str, Array]


@output_permissions()
def write_report(
    result: Result,
    folder: Path | str,
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
        From `proofmass.batch.check.check`, with all curves.
    folder : path
        Folder of the report; it is made if needed, and pages of the same name are replaced.
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
    made = record.made if record else record_start(inputs=next(iter(result.paths), None))
    return ReportWriter(Path(folder), made, last, studies, figures, data).finish(result, record)


@dataclass
class ReportWriter:
    """A report that is written while its cases are checked, a page when a case has ended.

    It is the `proofmass.batch.check.CaseConsumer` of `check`, so that no more than the curves of
    the cases that are running are in memory.  The index is written after the first, the second, the
    fourth case and so on, and at the end: it names the cases that are missing, in case that the
    process is killed.  An error, such as a full disk, ends the writing and is raised by `finish`,
    so that results are printed before.

    Attributes
    ----------
    folder : Path
        Folder of the report.
    made : Made
        When and where the report was begun.
    last : Last or None
        The report that this one is compared with; None for the one in the folder.
    studies, figures, data
        See `write_report`.
    """

    folder: Path
    made: Made
    last: Last | None = None
    studies: Sequence[ShownStudy] = ()
    figures: bool = False
    data: bool = False

    def __post_init__(self) -> None:
        own = read_last(self.folder)
        self.compared_with = self.last or own
        before = own.record or self.compared_with.record
        self.before = before.history if before else History()
        self.begun: Result | None = None
        self.taken = dict[str, Result]()
        self.pictures = dict[str, Thumbnail | Markup | None]()
        self.error: Exception | None = None
        self.lock = Lock()

    def begin(self, result: Result) -> None:
        """Take the cases and the errors of the input, and write styles and scripts."""
        self.begun = replace(result, errors=list(result.errors))
        with self.keep_error():
            protect(file for case in result.cases for file in input_files(case))
            make_folder(make_folder(self.folder) / "figures")
            write_static(self.folder, STATIC)

    @cached_property
    def looks(self) -> dict[str, Look]:
        """The look of each solver, the same on all pages."""
        begun = self.begun or Result()
        asked = (s for case in begun.cases for run in case.run.values() for s in run.solvers)
        return solver_looks([*asked, *(c.solver for c in begun.comparisons)])

    @contextmanager
    def keep_error(self) -> Iterator[None]:
        """Keep the first error for `finish`."""
        try:
            yield
        except Exception as error:
            self.error = self.error or error

    def take(self, part: Result) -> None:
        """Write the page of a case, and sometimes the index; nothing after an error."""
        if self.error is None and self.begun is not None:
            with self.keep_error():
                known = self.begun.errors
                self.write_page(replace(part, errors=[*known, *part.errors]))
                self.count(part)

    def write_page(self, part: Result) -> None:
        """Write the page of a case with its figures."""
        (case,) = part.cases
        gathered = gather_runs(part, case)
        stem = slug(case.name)
        drawings = draw_case(
            case,
            gathered.runs,
            gathered.views,
            self.looks,
            self.folder / "figures",
            stem,
            self.figures,
        )
        if self.data:
            write_curves(self.folder, case, gathered.runs)
        history = extend_with_case(self.before, make_record(part, self.made))
        page = render_case(
            environment(), case, part, gathered, drawings, self.looks, self.studies, history
        )
        write_output(self.folder / f"{stem}.html", page)
        self.pictures[case.name] = drawings.moving or static_picture(case.name, drawings)

    def count(self, part: Result) -> None:
        """Count a case whose page is written, and write the index at powers of two."""
        with self.lock:
            self.taken[part.cases[0].name] = replace(part, curves={}, failed={})
            count = len(self.taken)
            if count & (count - 1) == 0 and count < len(self.begun.cases if self.begun else ()):
                self.write_unfinished()

    def write_unfinished(self) -> None:
        """Write the index of the cases that have ended, which names the others.

        Without any case nothing is written, so that the last report stays as it is.  Its
        `results.json` stays in any case: the next report is compared with a whole one.
        """
        if self.begun is None or not self.taken:
            return
        cases = [case for case in self.begun.cases if case.name in self.taken]
        found = replace(self.begun, cases=cases, comparisons=[], errors=list(self.begun.errors))
        for case in cases:
            add_part(found, self.taken[case.name])
        missing = [case.name for case in self.begun.cases if case.name not in self.taken]
        self.write_index(found, make_record(found, self.made), missing)

    def finish(self, result: Result, record: Record | None = None) -> Path:
        """Write the pages of cases that were not taken yet, the index and the record.

        Raises
        ------
        OSError
            A file cannot be written; also one of those before.
        """
        if self.begun is None:
            self.begin(result)
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            rest = (one for one in split_result(result) if one.cases[0].name not in self.taken)
            list(pool.map(self.take, rest))
        if self.error is not None:
            raise self.error
        for name, page in model_pages(environment(), result):
            write_output(self.folder / name, page)
        record = record or make_record(result, self.made)
        index = self.write_index(result, record)
        write_record(self.folder, record, extend_history(self.before, record))
        return index

    def write_index(self, result: Result, record: Record, missing: Sequence[str] = ()) -> Path:
        """Write the index with the files of its rows; `missing` are cases without results."""
        files = {case.name: file_links(self.folder, case) for case in result.cases}
        pages = render_index(
            environment(),
            result,
            self.looks,
            self.pictures,
            record,
            self.compared_with,
            extend_history(self.before, record),
            self.studies,
            files if self.data else {},
            note_on_files(self.data),
            missing,
        )
        return write_index_files(self.folder, pages)


def split_result(result: Result) -> Iterator[Result]:
    """Yield the result of each case."""
    rows = group_by(result.comparisons, lambda c: c.case)
    refined = group_by(result.refined, lambda row: row.case)
    curves, failed, diagnoses = (
        group_by(table, lambda key: key[0])
        for table in (result.curves, result.failed, result.diagnoses)
    )
    for case in result.cases:
        name = case.name
        yield Result(
            cases=[case],
            comparisons=rows.get(name, []),
            curves={key: result.curves[key] for key in curves.get(name, ())},
            refined=refined.get(name, []),
            failed={key: result.failed[key] for key in failed.get(name, ())},
            diagnoses={key: result.diagnoses[key] for key in diagnoses.get(name, ())},
            paths=result.paths,
        )


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
