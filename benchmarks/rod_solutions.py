"""All equilibria of flexible mechanisms: our search against the grids of Pérez Gámiz 2018.

    python -m benchmarks.rod_solutions [-o docs/rod_solutions.md] [--quick]

Modes are one tuple for a grid, and all up to them for the search.
"""

import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np

from benchmarks import command
from benchmarks.rod_grid import Grid, three, two
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
CAPS = 10.0, 15.0, 20.0, 26.0, 40.0, 60.0, 80.0  # alpha
NODES = 15, 30, 60, 120  # n, two rods
PRINTED = {  # Table 2, a 3PFR: n, tolL [m], tolM [N m]: solutions, seconds
    (15, 0.5, 1.0): (5, 1686),
    (20, 0.5, 1.0): (6, 4341),
    (25, 0.5, 1.0): (6, 12176),
    (30, 0.1, 1.0): (6, 17241),
    (25, 0.1, 0.1): (3, 5467),
}

HEAD = """# All equilibria of flexible mechanisms

`python -m benchmarks.rod_solutions -o docs/rod_solutions.md` made this; times are CPU seconds of
one thread on a machine that others used as well. Mechanisms and tables are those of J. Pérez Gámiz,
Resolución del problema de posición de mecanismos ultraflexibles planos de cadena cerrada, TFG,
UPV/EHU Bilbao 2018, steel rods of 1 m and 1.5 mm: Table 7 with its second clamp at (0.3, 0), Table
8 with 180 degrees for its second motor and a platform of 0.2 m, and the mechanism of its 3PFR
program (code lines 8812-8945). Modes count inflections, the pinned tip included.

## Our search

| direct problem | modes to | equilibria | stable | of modes 1 | known before | searched to alpha \
| proven bound |
|---|---|---|---|---|---|---|---|
"""

AGAINST = """
"Known before" are those that the document prints and, of the others, those of a multi-start search
by another program. New are one of the 34, of modes (1, 3) at P = (0.663584, -0.190273) m, and all
of Table 8 with a rod in a loop. Loads are searched for up to the bound of the next section.

## Counts against the largest load

alpha = L sqrt(R/EI) is the largest of the loads R on the rods of an equilibrium. With so many
inflections at most it cannot grow without end: rods would become straight, and straight rods would
have to hold the platform tight against each other, which these mechanisms do not allow
(`proofmass/analytic/rods/all_equilibria.py`). The bound is proven for every pose at once, but for
rounding, and is up to a tenth larger than the inequality needs. Cells beyond the bound are empty.

| equilibria, stable ones | {heads} | bound |
|---|{lines}---|
"""

GRIDS = """
Completeness below the bound is tested, not proven (`tests/analytic/rods/test_rod_solutions.py`,
`tests/analytic/rods/test_rod_solutions_bound.py`). Up to alpha = 20 counts are the same for
lattices of 1500 to 10,000 poses and for meshes of 0.05 and 0.08 of a length, and 20,000 random
starts find no other. Beyond, starts are straight rods with loops, drawn at random: each equilibrium
is arrived at many times, and ten times as many starts from another seed find no other. Poses and
loads beyond 20 are confirmed by polynomials along the rods, without the closed form of an elastica;
so is stability, but for modes to 2 beyond alpha = 40, where a rod's loops can slide along it for
less than rounding. The stable ones have modes 1.

## The document's grids

n values of each psi and 42 of k_rel: n 42^2 nodes for two rods, 42 n^3 for three, modes all 1. Ours
is its grid in NumPy, with our Newton's method, which accepts no mirrored platforms; three rods of
each node have up to 16 shapes. A start is a node within the tolerances tolL of all sides and tolM
of the moment, for two rods a cell in which three residuals change their sign.

| direct problem | n | tolL m | tolM N m | nodes | starts | found | of | CPU s | µs a node | \
printed: solutions, s | ms a node |
|---|---|---|---|---|---|---|---|---|---|---|---|
"""


def timed(work: Callable[[], Grid]) -> tuple[Grid, float]:
    began = time.process_time()
    return work(), time.process_time() - began


def searched(names: Sequence[str], most: int) -> Iterator[str]:
    """Rows of the first table, with so many inflections at most."""
    before = {("2RFR, Table 7", 3): 33, ("3RFR, Table 8", 2): 4, ("3PFR, annex", 1): 3}
    for name in names:
        a, given, modes = CASES[name]
        for upto in modes[:most]:
            found = solutions(a, modes=upto, **given)
            yield (
                f"| {name} | {upto} | {len(found)} | {(found.negative == 0).sum()} | "
                f"{(found.modes == 1).all(axis=1).sum()} | {before.get((name, upto), '')} | "
                f"{found.up_to:.1f} | {found.bound:.1f} |"
            )


def against(names: Sequence[str], most: int, caps: Sequence[float]) -> Iterator[str]:
    """Rows of counts by the largest load of an equilibrium, as far as the proven bound."""
    for name in names:
        a, given, modes = CASES[name]
        for upto in modes[:most]:
            found = solutions(a, modes=upto, **given)
            cells = []
            for cap in (*caps, found.bound):
                counted = found.negative[found.alpha.max(axis=1) <= cap]
                cells.append(f"{counted.size}, {(counted == 0).sum()}" * bool(cap <= found.bound))
            yield f"| {name}, modes to {upto} | {' | '.join(cells)} (to {found.bound:.1f}) |"


def gridded(
    names: Sequence[str], nodes: Sequence[int], settings: Sequence[tuple[int, float, float]]
) -> Iterator[str]:
    """Rows of the second table: n for two rods; n, tolL [m] and tolM [N m] for three."""
    for name in names:
        a, given, _ = CASES[name]
        s, known = state(a, **given), len(solutions(a, modes=1, most_load=20.0, **given))
        if a is not PAIR:
            yield from (of_three(name, s, setting, known) for setting in settings)
            continue
        for n in nodes:
            grid, seconds = timed(lambda s=s, n=n: two(s, n))
            yield row(name, (n, "", ""), grid, known, seconds)


def of_three(name: str, s: RodState, setting: tuple[int, float, float], known: int) -> str:
    grid, seconds = timed(lambda: three(s, *setting))
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
"Found" are distinct equilibria with alpha to 20, "of" those of our search up to there. Printed are
solutions and times of Table 2 (2018, MATLAB, another machine, load not stated), which count
mirrored platforms: three of the six roots of its residual for the mechanism of its program; [all
of its cells](rod_table2.md) are on a page of their own. All of
Table 2 takes 985 s (n = 15, three solutions) to 17,241 s (n = 30, six). The nodes of the five
settings here cost it 8 to 19 ms at any n; here time goes with the starts as well. From wide
tolerances Newton's method in a chart without seams gets to all equilibria of modes 1 with alpha to
20, rods in loops among them, where Tables 7 and 8 print two each: the document's own keeps the sign
of k_rel and psi within a turn.
"""


def main(argv: Sequence[str] | None = None) -> None:
    parser = command(__doc__)
    parser.add_argument("-o", "--output", type=Path, default=None)
    given = parser.parse_args(argv)
    names = ("2RFR, Table 7", "3PFR, annex") if given.quick else tuple(CASES)
    caps = (20.0,) if given.quick else CAPS
    table = AGAINST.rstrip("\n").format(
        heads=" | ".join(f"to {cap:g}" for cap in caps), lines="---|" * len(caps)
    )
    most = 1 if given.quick else 3
    grids = gridded(names, *(((3,), ((3, 0.5, 1.0),)) if given.quick else (NODES, tuple(PRINTED))))
    text = "\n".join(
        [
            HEAD.rstrip("\n"),
            *searched(names, most),
            table,
            *against(names, most, caps),
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
