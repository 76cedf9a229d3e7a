"""The report: self-contained pages that say in one line what agrees, and why the rest does not.

The rest of the project uses `write_report`.  `words` makes the sentences, `tables` the rows of
tables, `figures` the plots of curves, `charts` and `views` the figures that a sidecar asks for,
`mechanism` the drawing of the mechanism; `case_figures` draws all figures of a case (SVG and PNG).
`pages` fills the templates in `templates/`, and writes the curves as tables.  `case_page` is the
page of a case, `index_page` the table of all cases; styles and scripts are in `static/`.  `record`
stores what the next report is compared with, and `changes` compares two reports.
"""

from contextlib import chdir
from pathlib import Path

with chdir(Path(__file__).parent):  # a matplotlibrc of the current folder may be a stranger's:
    import matplotlib  # noqa: F401, it can make matplotlib start LaTeX and evaluate expressions

from proofmass.report.pages import write_report
from proofmass.report.words import headline

__all__ = ["headline", "write_report"]
