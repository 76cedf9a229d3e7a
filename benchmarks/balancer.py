"""CPU times of moment-angle curves of balancers: exact paths, and the thesis's grid.

python -m benchmarks.balancer [rounds] [--quick]
"""

from collections.abc import Iterator, Sequence

import numpy as np

from benchmarks import command
from benchmarks.timing import SPELL, Row, measure
from proofmass.analytic.balancer import along, balancer, follow, solve
from proofmass.analytic.balancer.measures import precision_points
from proofmass.base.arrays import Array
from tests.analytic.balancer.balancer_table import parameters, rows
from tests.independent.balancer import grid, grid4

BATCH = 1000
LINES = {
    "3 segments": ("1766", 90),
    "3 segments, preload": ("1745", 90),
    "3 segments, contact": ("1860", 90),
    "4 segments": ("1744", 15),
    "4 segments, two preloads": ("1747", 15),
}


def varied(given: dict[str, float], size: int) -> dict[str, Array]:
    """A batch of designs, each number of which is within 3 percent of the given one."""
    rng = np.random.default_rng(0)
    spread = 1.0 + rng.uniform(-0.03, 0.03, (len(given), size))
    return {name: value * spread[k] for k, (name, value) in enumerate(given.items())}


def methods(name: str, line: str, count: int, size: int) -> Iterator[Row]:
    """The methods to compute the curve of one row of the thesis."""
    given, angle = parameters(rows()[line]), precision_points(count)
    search = grid if rows()[line]["segments"] == 3 else grid4
    many = varied(given, size)

    def batch() -> None:
        chains = balancer(**many)
        along(chains, follow(chains, np.pi / 2), angle)

    yield Row(name, "followed, exact, alone", "", 1, lambda: solve(angle, **given))
    yield Row(name, f"followed, exact, {size} at once", "", size, batch)
    what = "90 x 1000" if count == 90 else "15 x 150 x 150"
    yield Row(name, f"thesis's grid, {what}", "", 1, lambda: search.minimise(angle, **given))


def main(argv: Sequence[str] | None = None) -> None:
    parser = command(__doc__)
    parser.add_argument("rounds", type=int, nargs="?", default=5)
    given = parser.parse_args(argv)
    rounds = 1 if given.quick else given.rounds
    found = [
        row
        for name, (line, count) in LINES.items()
        for row in methods(name, line, count, 10 if given.quick else BATCH)
    ]
    measure(found, rounds, 0.0 if given.quick else SPELL)
    print(f"least of {rounds} interleaved rounds, one thread; milliseconds of CPU a curve")
    base = {row.mechanism: row.own / row.poses for row in found if row.method.startswith("thesis")}
    print(f"{'balancer':28}{'method':34}{'ms a curve':>12}{'of the grid':>14}")
    for row in found:
        own = row.own / row.poses
        print(
            f"{row.mechanism:28}{row.method:34}{1e3 * own:12.3f}{own / base[row.mechanism]:14.3f}"
        )


if __name__ == "__main__":
    main()
