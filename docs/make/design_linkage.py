"""The example of docs/design_linkage.md: what ``proofmass design linkage`` prints, and its figure.

    python -m docs.make.design_linkage [--quick]

The engines, which the command runs as well, are left out.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from textwrap import wrap

import numpy as np

from benchmarks import ROOT, command
from docs.make.marks import write_between
from proofmass.design.linkage_designs import LINKAGE_KINDS, make_tasks, search_designs_of_path
from proofmass.design.linkage_figure import write_figure
from proofmass.design.linkage_path import PATH_EFFORT
from proofmass.design.linkage_record import design_lines
from proofmass.design.path_points import read_points

PAGE, PICTURE = ROOT / "docs" / "design_linkage.md", ROOT / "docs" / "design_linkage.png"
BEGIN = "<!-- python -m docs.make.design_linkage writes from here to the next mark: output -->"
END = "<!-- to here: output -->"
POINTS = """\
x [mm],y [mm]
0,0
20,0
40,0
60,0
80,0
75,22
40,36
5,22
"""
LETTERS = 100  # letters of a line of the page
TRANSMISSION = 30.0  # [deg] the command's default


def main(argv: Sequence[str] | None = None) -> None:
    """Search, and write what the command prints and draws into docs/."""
    given = command(__doc__).parse_args(argv)
    effort = replace(PATH_EFFORT, heats=((8, 4), (4, 4))) if given.quick else PATH_EFFORT
    with TemporaryDirectory() as folder:
        file = Path(folder) / "foot.csv"
        file.write_text(POINTS)
        path = read_points(file, closed=True)
        kinds = LINKAGE_KINDS[-1:] if given.quick else LINKAGE_KINDS
        tasks = make_tasks(path, kinds, transmission=np.radians(TRANSMISSION))
        found = search_designs_of_path(tasks, effort)
        written = write_figure(found.designs, Path(folder) / "designs")
        if not given.quick:
            PICTURE.write_bytes(written[1].read_bytes())
    lines = [part for line in design_lines(found) for part in wrap_line(line)]
    text = "\n".join(["```", "$ proofmass design linkage foot.csv --closed -o foot", *lines, "```"])
    print(text)
    if not given.quick:
        page = PAGE.read_text(encoding="utf-8")
        PAGE.write_text(write_between(page, BEGIN, END, text), encoding="utf-8")


def wrap_line(line: str) -> list[str]:
    """A line in parts that are not wider than the page."""
    return wrap(line, LETTERS, subsequent_indent="   ") if len(line) > LETTERS else [line]


if __name__ == "__main__":
    main()
