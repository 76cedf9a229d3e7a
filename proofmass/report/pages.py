"""The report: an index and a page for each case.  They open from disk and fetch nothing."""

import os
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

from proofmass.check import Result
from proofmass.files import write_whole
from proofmass.report.case_page import gather, render_case
from proofmass.report.drawing import drawn
from proofmass.report.families import families
from proofmass.report.page import about, complaint, environment, slug, write_static
from proofmass.report.study import ShownStudy
from proofmass.report.style import looks

STATIC = (
    *("uPlot.js", "uPlot.css", "common.css", "common.js"),
    *("case.css", "case.js", "curves.js", "mechanism.js"),
)


def write_report(
    result: Result,
    folder: Path | str,
    progress: Callable[[str, int, int], None] = lambda *_: None,
    studies: Sequence[ShownStudy] = (),
    figures: bool = False,
) -> Path:
    """Write the index, a page for each case, and every figure as SVG and PNG.

    Parameters
    ----------
    result : Result
        From `proofmass.check.check`.
    folder : path
        Made when it is not there; pages of the same name are replaced.
    progress : callable, optional
        Called as ``progress(label, done, total)`` after each case.
    studies : sequence of Study
        That the pages lead to; see `proofmass.studies.pages.write_study_pages`.
    figures : bool
        Whether figures for papers of all curves are written as well: overlays, paths, differences.

    Returns
    -------
    Path
        The ``index.html``.
    """
    folder = Path(folder)
    (folder / "figures").mkdir(parents=True, exist_ok=True)
    write_static(folder, STATIC)
    style, env = looks(c.solver for c in result.comparisons), environment()
    cards = []
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        gathered = list(pool.map(partial(gather, result), result.cases))
        futures = [
            pool.submit(
                drawn, case, g.runs, g.views, style, folder / "figures", slug(case.name), figures
            )
            for case, g in zip(result.cases, gathered, strict=True)
        ]
        for k, case in enumerate(result.cases):
            card, page = render_case(
                env, case, result, gathered[k], futures[k].result(), style, studies
            )
            cards.append(card)
            write_whole(folder / card["page"], page)
            progress(case.name, k + 1, len(result.cases))
    index = folder / "index.html"
    write_whole(
        index,
        env.get_template("index.html").render(
            families=families(result.cases, cards, result.paths),
            style=style,
            about=about(),
            studies=studies,
            states=Counter(c["state"] for c in cards),
            errors=[complaint(e) for e in result.errors],
            loose=[c for c in result.comparisons if not c.channel],
        ),
    )
    return index
