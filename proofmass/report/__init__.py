"""The report: self-contained pages that say in one line what agrees, and why the rest does not.

`write_report` is all that the rest of the project needs.  `words` holds the sentences, `tables` the
rows, `figures` the curves, `charts` and `views` what a sidecar asks for, `mechanism` what moves in
the plane; `drawing` draws them (SVG and PNG), `pages` puts them into `templates/`.  `case_page` is
the page of a case, `first_screen` the panels at its top.  `index_page` is the table of all cases,
made of `cells`, with style and script in `static/`; `record` keeps what the next report is compared
with, `changes` compares, and `curves_files` writes the curves as tables.
"""

from proofmass.report.pages import write_report
from proofmass.report.words import headline

__all__ = ["headline", "write_report"]
