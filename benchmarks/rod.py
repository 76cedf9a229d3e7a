"""CPU times of elliptic integrals and rods: tip poses, shapes, shooting, and scipy's integrals.

python -m benchmarks.rod [rounds] [--quick]
"""

from collections.abc import Iterator, Sequence

import numpy as np
from scipy.special import ellipe, ellipeinc, ellipkinc, ellipkm1

from benchmarks import command
from benchmarks.timing import SPELL, Row, measure
from proofmass.analytic.rods import equilibria, integrate, modulus, pinned, shape, solve, tip
from proofmass.analytic.rods.elastica import elliptic_integrals
from proofmass.base.arrays import Array

COUNT = 100_000
BATCH = 1000
PINNED = {"x": 0.8, "y": 0.1, "guess": (0.1, 0.1, 0.1), "stiffness": 0.16493361431}


def by_scipy(psi: Array, k_rel: Array, mode: Array) -> tuple[Array, Array, Array]:
    """R, x, y by the document's formulas, with scipy's incomplete integrals."""
    k, _ = modulus(psi, k_rel)
    start = np.arcsin(np.cos(0.5 * psi) / k)
    count, square = 2.0 * mode - 1.0, k * k
    first = count * ellipkm1(1.0 - square) - ellipkinc(start, square)
    second = count * ellipe(square) - ellipeinc(start, square)
    along, across = 2.0 * second / first - 1.0, -2.0 * k * np.cos(start) / first
    return (
        first**2,
        -along * np.cos(psi) - across * np.sin(psi),
        -along * np.sin(psi) + across * np.cos(psi),
    )


def methods(count: int, batch: int) -> Iterator[Row]:
    """The timed methods, for `count` tips and `batch` rods at once."""
    rng = np.random.default_rng(0)
    psi, k_rel = rng.uniform(0.05, 6.2, count), rng.uniform(-0.999, 0.999, count)
    mode = rng.integers(1, 4, count).astype(float)
    phi, other = rng.uniform(0.0, 1.57, count), rng.uniform(0.01, 1.0, count)
    sine, cosine = np.sin(phi), np.cos(phi)
    delta, square = np.hypot(cosine, other * sine), 1.0 - other**2
    start = [np.full(batch, value) for value in (-3.23, -1.16, -0.61)]
    s = np.linspace(0.0, 1.0, 101)

    def four() -> None:
        ellipkinc(phi, square), ellipeinc(phi, square), ellipkm1(other**2), ellipe(square)

    yield Row(
        "F, E, K, E", "one mean", "", count, lambda: elliptic_integrals(sine, cosine, delta, other)
    )
    yield Row("F, E, K, E", "scipy", "", count, four)
    yield Row("tip pose", "all of it", "", count, lambda: tip(psi, k_rel, mode))
    yield Row("tip pose", "R, x, y with scipy", "", count, lambda: by_scipy(psi, k_rel, mode))
    yield Row(
        "shape",
        f"{batch} rods, 100 points",
        "",
        100 * batch,
        lambda: shape(psi[:batch, None], k_rel[:batch, None], mode[:batch, None], s[:-1]),
    )
    for scheme, nodes in (("rk4", 61), ("dop853", 41)):
        yield Row(
            "shooting",
            f"{scheme}, {nodes} nodes, {batch} at once",
            "",
            batch,
            lambda scheme=scheme, nodes=nodes: integrate(*start, scheme=scheme, nodes=nodes),
        )
    yield Row("clamped-pinned", "Newton, exact Jacobian", "", 1, lambda: pinned(**PINNED))
    yield Row(
        "clamped-pinned",
        "document's Newton, RK4",
        "",
        1,
        lambda: pinned(**PINNED, nodes=61, scheme="rk4", exact=False, tolerance=1e-7),
    )
    yield Row("cantilever", "tip load", "", 1, lambda: solve(s, force_y=10.0))
    yield Row("cantilever", "weight", "", 1, lambda: solve(s, weight_y=-10.0))
    yield Row("cantilever", "five branches, stability", "", 1, lambda: equilibria(force_y=100.0))


def main(argv: Sequence[str] | None = None) -> None:
    parser = command(__doc__)
    parser.add_argument("rounds", type=int, nargs="?", default=5)
    given = parser.parse_args(argv)
    rounds = 1 if given.quick else given.rounds
    found = list(methods(100, 10) if given.quick else methods(COUNT, BATCH))
    measure(found, rounds, 0.0 if given.quick else SPELL)
    print(f"least of {rounds} interleaved rounds, one thread, CPU time")
    print(f"{'what':16}{'how':34}{'us each':>12}{'a second':>14}")
    for row in found:
        print(
            f"{row.mechanism:16}{row.method:34}{1e6 * row.own / row.poses:12.3f}{row.speed:14,.0f}"
        )


if __name__ == "__main__":
    main()
