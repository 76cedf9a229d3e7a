"""The report: an index and a page for each case.  They open from disk and fetch nothing."""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

from markupsafe import Markup

from proofmass.check import Result
from proofmass.files import write_whole
from proofmass.report.case_page import gather, render_case
from proofmass.report.curves_files import files_of, note_on, write_curves
from proofmass.report.drawing import Drawings, drawn
from proofmass.report.index_page import STATIC as INDEX_STATIC
from proofmass.report.index_page import render_index
from proofmass.report.page import environment, slug, write_static
from proofmass.report.record import (
    History,
    Last,
    Record,
    continued,
    read_last,
    record_of,
    write_record,
)
from proofmass.report.study import ShownStudy
from proofmass.report.style import looks
from proofmass.report.svg import inline
from proofmass.report.thumbnail import Thumbnail

STATIC = (
    *("uPlot.js", "uPlot.css"),
    *("case.css", "case.js", "curves.js", "mechanism.js", "trend.js"),
    *INDEX_STATIC,
)


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
        Made when it is not there; pages of the same name are replaced.
    progress : callable, optional
        Called as ``progress(label, done, total)`` after each case.
    studies : sequence of ShownStudy
        Studies that the pages link to; see `proofmass.studies.pages.write_study_pages`.
    figures : bool
        Whether every figure is written as PNG as well, and figures of all curves: overlays, paths,
        differences.
    record, last : Record, Last, optional
        Of this report, and of the one that it is compared with; without it the one in `folder`.
    data : bool
        Whether the curves are written as well, see `proofmass.report.curves_files`.

    Returns
    -------
    Path
        The ``index.html``.
    """
    folder = Path(folder)
    (folder / "figures").mkdir(parents=True, exist_ok=True)
    write_static(folder, STATIC)
    style, env = looks(c.solver for c in result.comparisons), environment()
    record = record or record_of(result)
    own = read_last(folder)
    last = last or own
    before = own.record or last.record
    history = continued(before.history if before else History(), record)
    pictures = dict[str, Thumbnail | Markup | None]()
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        gathered = list(pool.map(partial(gather, result), result.cases))
        futures = [
            pool.submit(
                drawn, case, g.runs, g.views, style, folder / "figures", slug(case.name), figures
            )
            for case, g in zip(result.cases, gathered, strict=True)
        ]
        for k, case in enumerate(result.cases):
            drawings = futures[k].result()
            if data:
                write_curves(folder, case, gathered[k].runs)
            page = render_case(env, case, result, gathered[k], drawings, style, studies, history)
            write_whole(folder / f"{slug(case.name)}.html", page)
            pictures[case.name] = drawings.moving or still(case.name, drawings)
            progress(case.name, k + 1, len(result.cases))
    index = folder / "index.html"
    write_whole(
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
            {case.name: files_of(folder, case) for case in result.cases} if data else {},
            note_on(data),
        ),
    )
    write_record(folder, record, history)
    return index


def still(name: str, drawings: Drawings) -> Markup:
    """The drawing of a case without poses: its curves, or nothing."""
    svg = drawings.figures.get("thumbnail")
    return Markup(inline(svg, f"{slug(name)}-thumbnail", name)) if svg else Markup()
