"""The report: self-contained pages that say in one line what agrees, and why the rest does not.

`write_report` is all that the rest of the project needs.  `words` holds the sentences, `tables` the
rows, `figures` the curves, `charts` and `views` what a sidecar asks for, `mechanism` what moves in
the plane; `case_figures` draws them (SVG and PNG), `pages` puts them into `templates/`, and writes
the curves as tables.  `case_page` is the page of a case, `index_page` the table of all cases, with
style and script in `static/`; `record` keeps what the next report is compared with, `changes`
compares.
"""

from proofmass.report.pages import write_report
from proofmass.report.words import headline

__all__ = ["headline", "write_report"]
