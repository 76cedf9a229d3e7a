"""All equilibria of flexible mechanisms: our search compared with the grids of Pérez Gámiz 2018.

    python -m docs.make.rod_solutions [-o docs/rod_solutions.md] [--quick]

A grid has one tuple of modes; the search includes all modes up to them.
"""

import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np

from benchmarks import command
from docs.make.rod_grid import Grid, search_three_rods, search_two_rods
from proofmass.analytic.rods.all_equilibria import solutions
from proofmass.analytic.rods.assembly import assembly, triangle
from proofmass.analytic.rods.equilibrium import RodState, state

EI = 0.05218602640386952  # N m^2, steel wire of 1.5 mm
CORNERS, GUIDES = triangle(np.sqrt(3.0)), np.radians([0.0, 120.0, -120.0])
PAIR = assembly([[-0.3, 0.0], [0.3, 0.0]], stiffness=EI)
PAIR_AT = {"inputs": np.radians([40.0, 60.0]), "load": [0.3, -0.1]}
CASES = {
    "2RFR, Table 7": (PAIR, PAIR_AT, (1, 2, 3)),
    "3RFR, Table 8": (
        assembly(CORNERS, stiffness=EI, arm=triangle(0.2)),
        {"inputs": np.radians([45.0, 180.0, -60.0]), "load": [0.0, 0.5, 0.0]},
        (1, 2),
    ),
    "3PFR, annex": (
        assembly(CORNERS, stiffness=EI, arm=triangle(0.5), angle=GUIDES, guide=GUIDES),
        {"inputs": 0.1, "load": [0.3, -0.2, 0.0]},
        (1, 2),
    ),
}
ALPHA_LIMITS = 10.0, 15.0, 20.0, 26.0, 40.0, 60.0, 80.0
NODES = 15, 30, 60, 120  # n, two rods
PRINTED = {  # Table 2, a 3PFR: n, tolL [m], tolM [N m]: solutions, seconds
    (15, 0.5, 1.0): (5, 1686),
    (20, 0.5, 1.0): (6, 4341),
    (25, 0.5, 1.0): (6, 12176),
    (30, 0.1, 1.0): (6, 17241),
    (25, 0.1, 0.1): (3, 5467),
}

HEAD = """# All equilibria of flexible mechanisms

`python -m docs.make.rod_solutions -o docs/rod_solutions.md` made this page; times are CPU seconds
of one thread on a machine that others used as well. The mechanisms and tables are those of J. Pérez
Gámiz, Resolución del problema de posición de mecanismos ultraflexibles planos de cadena cerrada,
TFG, UPV/EHU Bilbao 2018, with steel rods of 1 m and 1.5 mm: Table 7 with its second clamp at
(0.3, 0), Table 8 with 180 degrees for its second motor and a platform of 0.2 m, and the mechanism
of its 3PFR program (code lines 8812-8945). The mode of a rod is the number of its inflections, the
pinned tip included.

## Our search

| direct problem | modes to | equilibria | stable | of modes 1 | known before | searched to alpha \
| proven bound |
|---|---|---|---|---|---|---|---|
"""

AGAINST = """
*Known before* are the equilibria that the document prints and those that a multi-start search by
another program found. New are one of the 34, of modes (1, 3) at P = (0.663584, -0.190273) m, and
all equilibria of Table 8 with a rod in a loop. The search covers loads up to the bound of the next
section.

## Counts by the largest load

alpha = L sqrt(R/EI) is that of the largest load R on the rods of an equilibrium. With a limited
number of inflections it cannot grow without limit: the rods would become straight, and straight
rods would have to hold the platform tight against each other, which these mechanisms do not allow
(`proofmass/analytic/rods/all_equilibria.py`). The bound is proven for all poses at once, except for
rounding, and is up to a tenth larger than the inequality needs. Cells beyond the bound are empty.

| equilibria, stable ones | {heads} | bound |
|---|{lines}---|
"""

GRIDS = """
Completeness below the bound is tested, not proven (`tests/analytic/rods/test_rod_solutions.py`,
`tests/analytic/rods/test_rod_solutions_bound.py`). Up to alpha = 20 the counts are the same for
lattices of 1500 to 10,000 poses and for meshes of 0.05 and 0.08 of a length, and 20,000 random
starts find no other equilibrium. Beyond alpha = 20 the starts are straight rods with loops, drawn
at random: each equilibrium is reached many times, and ten times as many starts from another seed
find no other. Poses and loads beyond 20 are confirmed by polynomials along the rods, without the
closed form of an elastica. Stability is confirmed in the same way, except for modes to 2 beyond
alpha = 40, where the energy for moving a rod's loops along it is less than rounding. The stable
equilibria have modes 1.

## The document's grids

The grids have n values of each psi and 42 of k_rel, which are n 42^2 nodes for two rods and 42 n^3
for three; all modes are 1. Our grid is the document's in NumPy, with our Newton's method, which
accepts no mirrored platforms; three rods have up to 16 shapes for each node. A start of Newton's
method is a node at which all sides are within the tolerance tolL and the moment is within tolM; for
two rods it is a cell in which three residuals change their sign.

| direct problem | n | tolL m | tolM N m | nodes | starts | found | of | CPU s | µs per node | \
printed: solutions, s | ms per node |
|---|---|---|---|---|---|---|---|---|---|---|---|
"""


def timed(work: Callable[[], Grid]) -> tuple[Grid, float]:
    began = time.process_time()
    return work(), time.process_time() - began


def search_rows(names: Sequence[str], max_modes: int) -> Iterator[str]:
    """Rows of the first table, with up to `max_modes` of the modes of a case."""
    before = {("2RFR, Table 7", 3): 33, ("3RFR, Table 8", 2): 4, ("3PFR, annex", 1): 3}
    for name in names:
        a, given, modes = CASES[name]
        for upto in modes[:max_modes]:
            found = solutions(a, modes=upto, **given)
            yield (
                f"| {name} | {upto} | {len(found)} | {(found.negative == 0).sum()} | "
                f"{(found.modes == 1).all(axis=1).sum()} | {before.get((name, upto), '')} | "
                f"{found.up_to:.1f} | {found.bound:.1f} |"
            )


def counts_by_load(names: Sequence[str], max_modes: int, limits: Sequence[float]) -> Iterator[str]:
    """Rows of counts up to each limit of the largest alpha, as far as the proven bound."""
    for name in names:
        a, given, modes = CASES[name]
        for upto in modes[:max_modes]:
            found = solutions(a, modes=upto, **given)
            cells = []
            for limit in (*limits, found.bound):
                counted = found.negative[found.alpha.max(axis=1) <= limit]
                cells.append(f"{counted.size}, {(counted == 0).sum()}" * bool(limit <= found.bound))
            yield f"| {name}, modes to {upto} | {' | '.join(cells)} (to {found.bound:.1f}) |"


def grid_rows(
    names: Sequence[str], nodes: Sequence[int], settings: Sequence[tuple[int, float, float]]
) -> Iterator[str]:
    """Rows of the table of grids: n for two rods; n, tolL [m] and tolM [N m] for three."""
    for name in names:
        a, given, _ = CASES[name]
        s, known = state(a, **given), len(solutions(a, modes=1, most_load=20.0, **given))
        if a is not PAIR:
            yield from (row_of_three(name, s, setting, known) for setting in settings)
            continue
        for n in nodes:
            grid, seconds = timed(lambda s=s, n=n: search_two_rods(s, n))
            yield row(name, (n, "", ""), grid, known, seconds)


def row_of_three(name: str, s: RodState, setting: tuple[int, float, float], known: int) -> str:
    grid, seconds = timed(lambda: search_three_rods(s, *setting))
    printed = PRINTED.get(setting) if "3PFR" in name else None
    return row(name, setting, grid, known, seconds, printed)


def row(
    name: str,
    setting: tuple[object, ...],
    grid: Grid,
    known: int,
    seconds: float,
    printed: tuple[int, int] | None = None,
) -> str:
    theirs = (
        "| |"
        if printed is None
        else f"{printed[0]}, {printed[1]} | {1e3 * printed[1] / grid.nodes:.0f} |"
    )
    return (
        f"| {name} | {' | '.join(map(str, setting))} | {grid.nodes:,} | {grid.starts:,} | "
        f"{grid.found} | {known} | {seconds:.1f} | {1e6 * seconds / grid.nodes:.1f} | {theirs}"
    )


TAIL = """
*Found* is the number of distinct equilibria with alpha to 20, and *of* the number that our search
finds up to there. The printed solutions and times are those of Table 2 (2018, MATLAB, another
machine, load not stated). They include mirrored platforms, which are three of the six roots of its
residual for the mechanism of its program; [all cells of Table 2](rod_table2.md) are on a page of
their own. A cell of Table 2 takes 985 s (n = 15, three solutions) to 17,241 s (n = 30, six). In the
five settings here a node takes 8 to 19 ms in the document's program, for any n; the time here
depends on the number of starts as well. With wide tolerances Newton's method in a chart without
seams reaches all equilibria of modes 1 with alpha to 20, also those with rods in loops, where
Tables 7 and 8 print two each. The document's Newton's method keeps the sign of k_rel, and keeps psi
within a turn.
"""


def main(argv: Sequence[str] | None = None) -> None:
    parser = command(__doc__)
    parser.add_argument("-o", "--output", type=Path, default=None)
    given = parser.parse_args(argv)
    names = ("2RFR, Table 7", "3PFR, annex") if given.quick else tuple(CASES)
    limits = (20.0,) if given.quick else ALPHA_LIMITS
    table = AGAINST.rstrip("\n").format(
        heads=" | ".join(f"to {limit:g}" for limit in limits), lines="---|" * len(limits)
    )
    max_modes = 1 if given.quick else 3
    sizes = ((3,), ((3, 0.5, 1.0),)) if given.quick else (NODES, tuple(PRINTED))
    grids = grid_rows(names, *sizes)
    text = "\n".join(
        [
            HEAD.rstrip("\n"),
            *search_rows(names, max_modes),
            table,
            *counts_by_load(names, max_modes, limits),
            GRIDS.rstrip("\n"),
            *grids,
            TAIL,
        ]
    )
    if given.output:
        given.output.write_text(text)
    print(text)


if __name__ == "__main__":
    main()
