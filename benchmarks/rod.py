"""Elliptic integrals and rods: tip poses, shapes and shooting, against scipy's integrals.

    python -m benchmarks.rod [rounds]
"""

import sys
from collections.abc import Iterator

import numpy as np
from scipy.special import ellipe, ellipeinc, ellipkinc, ellipkm1

from analytic.domain import Array
from analytic.rod import equilibria, integrate, modulus, pinned, shape, solve, tip
from analytic.rod.integrals import legendre
from benchmarks.timing import Row, measure

COUNT = 100_000
BATCH = 1000
PINNED = {"x": 0.8, "y": 0.1, "guess": (0.1, 0.1, 0.1), "stiffness": 0.16493361431}


def by_scipy(psi: Array, k_rel: Array, mode: Array) -> tuple[Array, Array, Array]:
    """R, x, y as the document writes them, with scipy's incomplete integrals."""
    k, _ = modulus(psi, k_rel)
    start = np.arcsin(np.cos(0.5 * psi) / k)
    count, square = 2.0 * mode - 1.0, k * k
    first = count * ellipkm1(1.0 - square) - ellipkinc(start, square)
    second = count * ellipe(square) - ellipeinc(start, square)
    along, across = 2.0 * second / first - 1.0, -2.0 * k * np.cos(start) / first
    return (first**2, -along * np.cos(psi) - across * np.sin(psi),
            -along * np.sin(psi) + across * np.cos(psi))


def ways() -> Iterator[Row]:
    """What is timed."""
    rng = np.random.default_rng(0)
    psi, k_rel = rng.uniform(0.05, 6.2, COUNT), rng.uniform(-0.999, 0.999, COUNT)
    mode = rng.integers(1, 4, COUNT).astype(float)
    phi, other = rng.uniform(0.0, 1.57, COUNT), rng.uniform(0.01, 1.0, COUNT)
    sine, cosine = np.sin(phi), np.cos(phi)
    delta, square = np.hypot(cosine, other * sine), 1.0 - other**2
    start = [np.full(BATCH, value) for value in (-3.23, -1.16, -0.61)]
    s = np.linspace(0.0, 1.0, 101)

    def four() -> None:
        ellipkinc(phi, square), ellipeinc(phi, square), ellipkm1(other**2), ellipe(square)

    yield Row("F, E, K, E", "one mean", "", COUNT, lambda: legendre(sine, cosine, delta, other))
    yield Row("F, E, K, E", "scipy", "", COUNT, four)
    yield Row("tip pose", "all of it", "", COUNT, lambda: tip(psi, k_rel, mode))
    yield Row("tip pose", "R, x, y with scipy", "", COUNT, lambda: by_scipy(psi, k_rel, mode))
    yield Row("shape", "1000 rods, 100 points", "", COUNT, lambda: shape(
        psi[:BATCH, None], k_rel[:BATCH, None], mode[:BATCH, None], s[:-1]))
    for scheme, nodes in (("rk4", 61), ("dop853", 41)):
        yield Row("shooting", f"{scheme}, {nodes} nodes, {BATCH} at once", "", BATCH, lambda
                  scheme=scheme, nodes=nodes: integrate(*start, scheme=scheme, nodes=nodes))
    yield Row("clamped-pinned", "Newton, exact Jacobian", "", 1, lambda: pinned(**PINNED))
    yield Row("clamped-pinned", "document's Newton, RK4", "", 1, lambda: pinned(
        **PINNED, nodes=61, scheme="rk4", exact=False, tolerance=1e-7))
    yield Row("cantilever", "tip load", "", 1, lambda: solve(s, force_y=10.0))
    yield Row("cantilever", "weight", "", 1, lambda: solve(s, weight_y=-10.0))
    yield Row("cantilever", "five branches, stability", "", 1, lambda: equilibria(force_y=100.0))


def main(rounds: int = 5) -> None:
    found = list(ways())
    measure(found, rounds)
    print(f"least of {rounds} interleaved rounds, one thread, CPU time")
    print(f"{'what':16}{'how':34}{'us each':>12}{'a second':>14}")
    for row in found:
        print(f"{row.mechanism:16}{row.method:34}{1e6 * row.own / row.poses:12.3f}"
              f"{row.speed:14,.0f}")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
