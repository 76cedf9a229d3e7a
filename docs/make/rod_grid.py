"""The grids in which Pérez Gámiz 2018 searches for equilibria of two and of three rods.

Newton's method is that of proofmass, which closes platforms by their pose.  It finds no mirrored
platforms, unless the equilibria of a mirrored platform are asked for as well.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from proofmass.analytic.numerics import TURN
from proofmass.analytic.rods import tip
from proofmass.analytic.rods.all_equilibria import solve_starts
from proofmass.analytic.rods.elastica import rods_of_chart
from proofmass.analytic.rods.equilibrium import RodState, clamps_and_forces
from proofmass.base.arrays import Array, Complex

MAX_ALPHA = 20.0  # of the equilibria that are counted
SPACING = np.log(0.0966498)  # B of the document's spacing of k_rel, with the end slope 0.25
LOOKUP_POINTS = 400  # values of k_rel of each sign in which a load is looked up


@dataclass(frozen=True)
class Grid:
    """Numbers of a grid: nodes, starts of Newton's method, and distinct equilibria.

    `mirrored` is the number of equilibria of a mirrored platform, if it was asked for.
    """

    nodes: int
    starts: int
    found: int
    mirrored: int = 0


def moduli(count: int = 21) -> Array:
    """Values of k_rel of both signs, clustered at 1 as in the document (text line 5660)."""
    half = np.expm1(SPACING * np.linspace(0.0, 1.0, count)) / np.expm1(SPACING)
    half = np.clip(half, 1e-6, 1.0 - 1e-6)
    return np.concatenate([-half[::-1], half])


def directions(nodes: int) -> Array:
    """Values of psi."""
    return np.clip(np.linspace(0.0, TURN, nodes), 1e-3, TURN - 1e-3)


def search_two_rods(s: RodState, nodes: int) -> Grid:
    """Search the grid of (psi1, k_rel1, k_rel2).

    A start is a cell in which all three residuals change their sign.  The load of the second rod
    follows from the balance of forces.  In place of these cells, the document's program intersects
    two curves of isosurfaces.
    """
    theta, clamp, _ = clamps_and_forces(s)
    unit, k_rel = s.assembly.stiffness[0], moduli()
    psi1, one, second_k = np.meshgrid(directions(nodes), k_rel, k_rel, indexing="ij")
    first = tip(psi1[..., 0], one[..., 0], stiffness=unit)
    rest = complex(*s.load) - first["R"] * np.exp(1j * (psi1[..., 0] + theta[0]))
    psi2 = np.clip((np.angle(rest) - theta[1]) % TURN, 1e-6, TURN - 1e-6)
    second = tip(psi2[..., None], second_k, stiffness=unit)
    place = [
        c + (rod["x"] + 1j * rod["y"]) * np.exp(1j * angle)
        for c, rod, angle in zip(clamp, (first, second), theta, strict=True)
    ]
    gap = place[0][..., None] - place[1]
    off = np.abs(rest)[..., None] - second["R"]
    change = [has_sign_change(part) for part in (gap.real, gap.imag, off)]
    cells = np.nonzero(change[0] & change[1] & change[2])
    chart = np.stack(
        [
            chart_of(first["R"][cells[:2]] / unit, first["k"][cells[:2]]),
            chart_of(second["R"][cells] / unit, second["k"][cells]),
        ]
    )
    at = place[1][cells]
    forces = solve_from(s, chart, np.stack([at.real, at.imag, 0.0 * at.real]))
    return Grid(gap.size, at.size, distinct(forces))


def has_sign_change(residual: Array) -> NDArray[np.bool_]:
    """Cells of a grid at whose corners a residual has both signs."""
    positive = residual > 0.0
    some = every = positive
    for axis in range(3):
        low, high = (np.delete(some, end, axis) for end in (-1, 0))
        some = low | high
        low, high = (np.delete(every, end, axis) for end in (-1, 0))
        every = low & high
    return np.asarray(some & ~every)


def search_three_rods(
    s: RodState, nodes: int, gap: float, moment: float, mirror: RodState | None = None
) -> Grid:
    """Search the grid of (k_rel1, psi1, psi2, psi3).

    A start is a node whose sides and moment are within tolerances.  The balance of forces gives the
    loads of rods 2 and 3, and the inverse of R(k_rel) gives up to four shapes of each of these
    rods, which are 16 in all (eqs 113-115).

    Parameters
    ----------
    s : RodState
        Inputs and load.
    nodes : int
        Number n of values of each psi; the grid has 42 n^3 nodes.
    gap, moment : float
        Tolerances tolL [m] and tolM [N m].
    mirror : RodState, optional
        The same with a mirrored platform, which has the same sides.
    """
    k_rel, starts = moduli(), 0
    both = [s] if mirror is None else [s, mirror]
    found: list[list[Array]] = [[] for _ in both]
    table = [Inverse(psi, s.assembly.stiffness[0]) for psi in directions(nodes)]
    for psi1 in directions(nodes):
        for shapes in shapes_of_nodes(s, psi1, k_rel, table):
            chart, pose = nearly_closed(s, shapes, gap, moment)
            starts += pose.shape[1]
            for some, one in zip(found, both, strict=True):
                some.append(solve_from(one, chart, pose))
    counts = [distinct(np.concatenate(some)) for some in found]
    return Grid(k_rel.size * nodes**3, starts, *counts)


class Inverse:
    """The inverse of R(k_rel) for one psi and mode 1: at most four monotone pieces."""

    def __init__(self, psi: float, stiffness: float) -> None:
        self.psi, k_rel = psi, moduli(LOOKUP_POINTS)
        self.pieces: list[tuple[Array, Array]] = []
        load = np.log(tip(psi, k_rel, stiffness=stiffness)["R"])
        for half in (slice(0, LOOKUP_POINTS), slice(LOOKUP_POINTS, None)):
            level, k = load[half], k_rel[half]
            turns = np.flatnonzero(np.diff(np.sign(np.diff(level)))) + 1
            for piece in np.split(np.arange(LOOKUP_POINTS), turns):
                rising = piece[np.argsort(level[piece])]
                self.pieces.append((level[rising], k[rising]))
        self.pieces = sorted(self.pieces, key=lambda piece: -piece[0].size)[:4]

    def __call__(self, load: Array) -> Array:
        """Values of k_rel (4, ...) with these loads; NaN where there are fewer."""
        out = np.full((4, *load.shape), np.nan)
        with np.errstate(invalid="ignore", divide="ignore"):  # loads of the wrong sign
            level = np.log(load)
        for i, (known, k) in enumerate(self.pieces):
            out[i] = np.interp(level, known, k, left=np.nan, right=np.nan)
        return out


def shapes_of_nodes(
    s: RodState, psi1: float, k_rel: Array, table: list[Inverse]
) -> Iterator[list[tuple[Array, Array, Complex, Complex]]]:
    """R, k, tips and forces of rods 1 to 3 at all nodes of one psi1, for each k_rel1."""
    theta = clamps_and_forces(s)[0]
    psi = np.array([inverse.psi for inverse in table])
    two_way, three_way = np.exp(1j * (theta[1] + psi))[:, None], np.exp(1j * (theta[2] + psi))
    across = (two_way.conj() * three_way).imag
    for k in k_rel:
        first = rotated_tip(s, 0, np.array([psi1]), np.array([k]))
        rest = complex(*s.load[:2]) - first[3][0]
        with np.errstate(divide="ignore", invalid="ignore"):  # parallel loads
            loads = (
                (rest.conjugate() * three_way).imag / across,
                (two_way.conj() * rest).imag / across,
            )
        second = np.stack([table[j](loads[0][j]) for j in range(psi.size)], axis=1)
        third = np.stack([table[j](loads[1][:, j]) for j in range(psi.size)], axis=2)
        good = np.isfinite(second).any(axis=0) & np.isfinite(third).any(axis=0)
        j2, j3 = np.nonzero(good)
        yield [
            first,
            rotated_tip(s, 1, psi[j2], second[:, j2, j3]),
            rotated_tip(s, 2, psi[j3], third[:, j2, j3]),
        ]


def rotated_tip(
    s: RodState, i: int, psi: Array, k_rel: Array
) -> tuple[Array, Array, Complex, Complex]:
    """R/EI, k, tip and force in the frame of rod i; NaN where k_rel is."""
    theta, clamp, _ = clamps_and_forces(s)
    unit, finite = s.assembly.stiffness[i], np.isfinite(k_rel)
    rod = tip(np.broadcast_to(psi, k_rel.shape)[finite], k_rel[finite], stiffness=unit)
    out = np.full((4, *k_rel.shape), np.nan, complex)
    turn = np.exp(1j * theta[i])
    psi_finite = np.broadcast_to(psi, k_rel.shape)[finite]
    out[:, finite] = (
        rod["R"] / unit,
        rod["k"],
        clamp[i] + turn * (rod["x"] + 1j * rod["y"]),
        rod["R"] * turn * np.exp(1j * psi_finite),
    )
    return out[0].real, out[1].real, out[2], out[3]


def nearly_closed(
    s: RodState, shapes: list[tuple[Array, Array, Complex, Complex]], gap: float, moment: float
) -> tuple[Array, Array]:
    """Charts (3, 2, m) and poses (3, m) of the combinations that close within tolerances."""
    one, second, third = shapes
    side = abs(s.assembly.arm[0] - s.assembly.arm[1])
    pin = [np.broadcast_to(one[2], (4, 4, second[2].shape[1])), second[2][:, None], third[2][None]]
    centre = (pin[0] + pin[1] + pin[2]) / 3.0
    force = [one[3], second[3][:, None], third[3][None]]
    couple = sum(((p - centre).conj() * f).imag for p, f in zip(pin, force, strict=True))
    with np.errstate(invalid="ignore"):
        good = np.abs(couple - s.load[2]) < moment
        for p, q in ((0, 1), (1, 2), (2, 0)):
            good &= np.abs(np.abs(pin[p] - pin[q]) - side) < gap
    at = np.nonzero(good)
    picks = [(np.zeros_like(at[0]),), (at[0], at[2]), (at[1], at[2])]
    chart = np.stack(
        [chart_of(rod[0][pick], rod[1][pick]) for rod, pick in zip(shapes, picks, strict=True)]
    )
    turn = np.angle(np.broadcast_to(pin[1], good.shape)[at] - pin[0][at])
    return chart, np.stack([centre[at].real, centre[at].imag, turn])


def chart_of(load: Array, k: Array) -> Array:
    """alpha and q of rods of mode 1, 1 m long, under R/EI."""
    return np.stack([np.sqrt(load), -np.arctanh(k)])


def solve_from(s: RodState, chart: Array, pose: Array) -> Array:
    """Forces (n, 2 k) in the clamps' frames, over EI, of the equilibria that starts lead to.

    Only equilibria of mode 1 with alpha up to `MAX_ALPHA` are returned.
    """
    if not pose.size:
        return np.empty((0, 2 * s.assembly.rods))
    solved = solve_starts(s, chart, pose)[0]
    found = rods_of_chart(*np.moveaxis(solved, 1, 0))
    force = found.force[:, ((found.waves < 1.0) & (solved[:, 0] < MAX_ALPHA)).all(axis=0)].T
    return np.concatenate([force.real, force.imag], axis=1)


def distinct(forces: Array) -> int:
    """Number of different forces, to four decimals."""
    return int(np.unique(forces.round(4) + 0.0, axis=0).shape[0])
