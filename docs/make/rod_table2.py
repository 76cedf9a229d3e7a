"""Table 2 of Pérez Gámiz 2018, cell by cell: solutions of its grids, and CPU times.

python -m docs.make.rod_table2 [-o docs/rod_table2.md] [--quick]
"""

import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from benchmarks import command
from docs.make.rod_grid import search_three_rods
from docs.make.rod_solutions import CASES, CORNERS, EI, GUIDES
from proofmass.analytic.rods.assembly import assembly, triangle
from proofmass.analytic.rods.equilibrium import state

PRINTED = {  # solutions and seconds by n, tolL [m] and tolM [N m] (text lines 1152-1155)
    (15, 1.0, 1.0): (5, 2030),
    (15, 0.5, 1.0): (5, 1686),
    (15, 0.1, 1.0): (4, 1270),
    (15, 1.0, 0.5): (4, 1067),
    (15, 0.5, 0.5): (3, 985),
    (20, 1.0, 1.0): (6, 4848),
    (20, 0.5, 1.0): (6, 4341),
    (20, 0.1, 1.0): (5, 3170),
    (20, 1.0, 0.5): (6, 3534),
    (20, 0.5, 0.5): (5, 3592),
    (25, 1.0, 1.0): (6, 9908),
    (25, 0.5, 1.0): (6, 12176),
    (25, 0.1, 1.0): (5, 7771),
    (25, 1.0, 0.5): (5, 7171),
    (25, 0.1, 0.1): (3, 5467),
    (30, 0.1, 1.0): (6, 17241),
    (30, 0.5, 0.5): (6, 11750),
}

HEAD = """# Table 2 of Pérez Gámiz, cell by cell

`python -m docs.make.rod_table2 -o docs/rod_table2.md` made this page. Table 2 of J. Pérez Gámiz,
Resolución del problema de posición de mecanismos ultraflexibles planos de cadena cerrada, TFG,
UPV/EHU Bilbao 2018 (text lines 1152-1155) lists the numbers of solutions and the times of its grids
for three rods and a platform of 0.5 m. A grid has n values of each psi, and tolerances of sides and
moment within which a node is a start of Newton's method. The mechanism and the load here are those
of its 3PFR program (code lines 8812-8945); the table does not say whether they are its own. Its
fourth heading repeats the second, tolL = 0.5 and tolM = 1. Here it is read as tolL = 1 and
tolM = 0.5, which completes the scheme.

The tolerance of the moment is not that of the program, which compares the moment with 0.2 tolM
(code line 9138), while the text and the table do not mention a factor. With the factor fewer nodes
are starts: for n = 7, tolL = 0.5 and tolM = 1 there are 191 instead of 311, and for n = 7, tolL = 1
and tolM = 1 there are 624 instead of 1,124. Both lead to the same number of solutions, 2 and 3
mirrored ones.

The document closes a platform by its three sides, so that mirrored platforms count as solutions.
Here Newton's method runs twice from each start: with the platform as it is, which has {true}
equilibria of modes 1 with alpha to 20 (`docs/rod_solutions.md`), and with a mirrored one, which
has {mirrored}. The printed number counts both columns together.

| n | tolL m | tolM N m | nodes | starts | found | mirrored | CPU s | printed: solutions | s | \
times as long |
|---|---|---|---|---|---|---|---|---|---|---|
"""

TAIL = """

CPU seconds are those of one thread, on a machine that others used as well; those of the document
are of MATLAB in 2018, on a machine that it does not name. Of {cells} cells {same} have as many
solutions here as printed, {more} have more and {fewer} have fewer. With wide tolerances even the
coarsest grid leads to all solutions here, because this Newton's method converges from further away
than the document's, which keeps the sign of k_rel, and keeps psi within a turn. The document's
times grow with the number of nodes, those here with the number of starts.
"""


def rows(cells: Sequence[tuple[int, float, float]]) -> Iterator[tuple[str, int]]:
    """A row for each cell, and the number of its solutions minus the printed number."""
    a, given, _ = CASES["3PFR, annex"]
    mirrored = assembly(
        CORNERS, stiffness=EI, arm=triangle(0.5) * [1.0, -1.0], angle=GUIDES, guide=GUIDES
    )
    s, mirror = (state(one, **given) for one in (a, mirrored))
    for cell in cells:
        began = time.process_time()
        grid = search_three_rods(s, *cell, mirror=mirror)
        seconds = time.process_time() - began
        count, printed = PRINTED.get(cell, (0, 0))
        row = (
            f"| {cell[0]} | {cell[1]:g} | {cell[2]:g} | {grid.nodes:,} | {grid.starts:,} | "
            f"{grid.found} | {grid.mirrored} | {seconds:.1f} | {count} | {printed:,} | "
            f"{printed / seconds:,.0f} |"
        )
        print(row, flush=True)
        yield row, grid.found + grid.mirrored - count


def main(argv: Sequence[str] | None = None) -> None:
    parser = command(__doc__)
    parser.add_argument("-o", "--output", type=Path, default=None)
    given = parser.parse_args(argv)
    cells = [(3, 0.5, 1.0)] if given.quick else list(PRINTED)
    found, differences = zip(*rows(cells), strict=True)
    counts = [row.split("|")[6:8] for row in found]
    text = (
        HEAD.format(
            true=max(int(one) for one, _ in counts), mirrored=max(int(one) for _, one in counts)
        )
        + "\n".join(found)
        + TAIL.format(
            cells=len(cells),
            same=sum(d == 0 for d in differences),
            more=sum(d > 0 for d in differences),
            fewer=sum(d < 0 for d in differences),
        )
    )
    if given.output:
        given.output.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
