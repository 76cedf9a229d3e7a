"""All equilibria of flexible mechanisms: our search against the grid of Pérez Gámiz 2018.

    python -m benchmarks.rod_solutions [nodes of psi ...]

The grid is that of its 2RFR program: (psi1, k_rel1, k_rel2), 21 values of k_rel of each sign; the
second rod's load follows from balance. A start is a cell in which all three residuals change their
sign, where the program intersects two curves of isosurfaces. Newton's method is ours for both.
Modes are one tuple for the grid, and all up to them for the search.
"""

import sys
import time

import numpy as np

from analytic.domain import TURN, Array
from analytic.rod import tip
from analytic.rod.assembly import assembly, triangle
from analytic.rod.search_newton import solve
from analytic.rod.search_sheet import rods
from analytic.rod.solutions import solutions
from analytic.rod.state import clamps, state

EI = 0.05218602640386952  # N m^2, steel wire of 1.5 mm
CORNERS, GUIDES = triangle(np.sqrt(3.0)), np.radians([0.0, 120.0, -120.0])
PAIR = assembly([[-0.3, 0.0], [0.3, 0.0]], stiffness=EI)
PAIR_AT = {"inputs": np.radians([40.0, 60.0]), "load": [0.3, -0.1]}
CASES = {
    "2RFR, Table 7": (PAIR, PAIR_AT, (1, 2, 3)),
    "3RFR, Table 8": (assembly(CORNERS, stiffness=EI, arm=triangle(0.2)),
                      {"inputs": np.radians([45.0, 180.0, -60.0]), "load": [0.0, 0.5, 0.0]},
                      (1, 2)),
    "3PFR, annex": (assembly(CORNERS, stiffness=EI, arm=triangle(0.5), angle=GUIDES, guide=GUIDES),
                    {"inputs": 0.1, "load": [0.3, -0.2, 0.0]}, (1, 2)),
}
TABLE_2 = {15: (5, 2030), 20: (6, 4848), 25: (6, 9908)}  # n_psi: solutions, seconds, as printed


def grid(nodes: int) -> tuple[int, int]:
    """Nodes of the document's grid and distinct equilibria of modes (1, 1) that it leads to."""
    s = state(PAIR, **PAIR_AT)
    rise = np.log(0.0966498)  # B of its spacing with the end slope 0.25
    half = np.expm1(rise * np.linspace(0.0, 1.0, 21)) / np.expm1(rise)
    k_rel = np.clip(np.concatenate([-half[::-1], half]), -1.0 + 1e-6, 1.0 - 1e-6)
    k_rel[20:22] = -1e-6, 1e-6
    psi = np.clip(np.linspace(0.0, TURN, nodes), 1e-3, TURN - 1e-3)
    psi1, one, two = np.meshgrid(psi, k_rel, k_rel, indexing="ij")
    theta, clamp, _ = clamps(s)
    first = tip(psi1[..., 0], one[..., 0], stiffness=EI)
    rest = complex(*s.load) - (first["R"] * np.exp(1j * (psi1[..., 0] + theta[0])))
    psi2 = (np.angle(rest) - theta[1]) % TURN
    second = tip(np.clip(psi2, 1e-6, TURN - 1e-6)[..., None], two, stiffness=EI)
    place = [c + (rod["x"] + 1j * rod["y"]) * np.exp(1j * angle)
             for c, rod, angle in zip(clamp, (first, second), theta, strict=True)]
    gap = place[0][..., None] - place[1]
    change = [turned(part) for part in (gap.real, gap.imag, np.abs(rest)[..., None] - second["R"])]
    cells = np.nonzero(change[0] & change[1] & change[2])
    chart = np.stack([charted(first["R"][cells[:2]], first["k"][cells[:2]]),
                      charted(second["R"][cells], second["k"][cells])])
    at = place[1][cells]
    arrived, _ = solve(s, chart, np.stack([at.real, at.imag, 0.0 * at.real]))
    found = rods(*np.moveaxis(arrived, 1, 0))
    force = found.force[:, (found.waves < 1.0).all(axis=0)]
    return gap.size, np.unique(force.T.round(4), axis=0).shape[0]


def turned(residual: Array) -> Array:
    """Cells of a grid at whose corners a residual has both signs."""
    positive = residual > 0.0
    some = every = positive
    for axis in range(3):
        low, high = (np.delete(some, end, axis) for end in (-1, 0))
        some = low | high
        low, high = (np.delete(every, end, axis) for end in (-1, 0))
        every = low & high
    return np.asarray(some & ~every)


def charted(load: Array, k: Array) -> Array:
    """alpha and q of rods of mode 1, 1 m long."""
    return np.stack([np.sqrt(load / EI), -np.arctanh(k)])


def main(*nodes: int) -> None:
    print(f"{'direct problem':16}{'way':26}{'modes':>8}{'equilibria':>12}{'CPU s':>9}")
    for name, (a, given, modes) in CASES.items():
        for upto in modes:
            began = time.process_time()
            found = solutions(a, modes=upto, **given)
            print(f"{name:16}{'search':26}{f'to {upto}':>8}{len(found):12}"
                  f"{time.process_time() - began:9.2f}")
    for n in nodes or (30, 60, 120):
        began = time.process_time()
        size, count = grid(n)
        print(f"{'2RFR, Table 7':16}{f'grid, {size} nodes':26}{'1':>8}{count:12}"
              f"{time.process_time() - began:9.2f}")
    print("as printed in 2018 for a 3PFR of modes 1, 42 n^3 nodes (Table 2, another machine):")
    for n, (count, seconds) in TABLE_2.items():
        print(f"{'3PFR':16}{f'grid, {42 * n**3} nodes':26}{'1':>8}{count:12}{seconds:9}")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
