"""The sheet of all rods in triangles: which rods reach a point with their tips, to first order."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.special import ellipkm1

from proofmass.analytic.numerics import Array, Complex
from proofmass.analytic.rods.search_sheet import rods

Index = NDArray[np.intp]

STRAIGHT = 8.0  # K - alpha: a rod stretched along its clamp's tangent but for 4 exp(-8)
FINE = 500  # points that a row's arc length is measured with
TURNING = 0.15  # [L] of the mesh that a turn of the load by 1 rad is worth
BEYOND = 0.15  # how far outside of a triangle it still answers, in its own coordinates
THIN = 1e-14  # twice the area [L^2] of a triangle without an inside, of straight rods
BINS = 64  # a side of the square around the reach of a rod


@dataclass(frozen=True)
class Mesh:
    """Triangles of rods of unit length and stiffness.

    Attributes
    ----------
    tip, force : ndarray of complex (t, 3)
        At the corners.
    chart : ndarray (t, 3, 2)
        alpha and q at the corners.
    into : ndarray of complex (t, 2)
        Coordinates in a triangle: (conj(into) (tip - first corner)).real
    along, across : ndarray of complex (t,)
        Stiffness: dforce = along dtip + across conj(dtip).
    first, listed : ndarray
        Triangles by bins: those of bin b are listed[first[b] : first[b + 1]].
    """

    tip: Complex
    force: Complex
    chart: Array
    into: Complex
    along: Complex
    across: Complex
    first: Index
    listed: Index

    def reaching(self, point: Complex) -> tuple[Index, Index, Array]:
        """Rods that reach points (n,): which point, triangle, and shares of its corners (m, 3)."""
        box = boxes(point)
        which, place = ragged(self.first[box + 1] - self.first[box])
        triangle = self.listed[self.first[box][which] + place]
        off = point[which] - self.tip[triangle, 0]
        inside = (self.into[triangle].conj() * off[:, None]).real
        share = np.column_stack([1.0 - inside.sum(axis=1), inside])
        hit = np.flatnonzero((share > -BEYOND).all(axis=1))
        return which[hit], triangle[hit], share[hit]


def ragged(counts: Index) -> tuple[Index, Index]:
    """Rows 0, 1 .. repeated `counts` times, and the place within each."""
    row = np.repeat(np.arange(counts.size), counts)
    return row, np.arange(row.size) - np.repeat(np.cumsum(counts) - counts, counts)


def boxes(point: Complex) -> Index:
    """Number of the bin that a point is in."""
    column, row = (np.clip(((part + 1.05) * BINS / 2.1).astype(int), 0, BINS - 1)
                   for part in (point.real, point.imag))
    return np.asarray(column * BINS + row)


@lru_cache(maxsize=8)
def mesh(modes: int, most: float, size: float) -> Mesh:
    """The rods of the first `modes` modes with loads up to most^2 EI/L^2, in steps of `size` L."""
    alpha, q = corners(modes, most, size)
    grid = np.arange(alpha.size).reshape(alpha.shape)
    a, b, c, d = (grid[:-1, :-1].ravel(), grid[1:, :-1].ravel(), grid[:-1, 1:].ravel(),
                  grid[1:, 1:].ravel())
    corner = np.concatenate([np.stack([a, b, c], -1), np.stack([d, c, b], -1)])
    half = np.stack([alpha.ravel()[corner], q.ravel()[corner]], axis=-1)
    chart = np.concatenate([half, half * [1.0, -1.0]])
    found = rods(chart[..., 0], chart[..., 1])
    e1, e2 = (found.tip[:, k] - found.tip[:, 0] for k in (1, 2))
    f1, f2 = (found.force[:, k] - found.force[:, 0] for k in (1, 2))
    area = (e1.conj() * e2).imag
    keep = np.abs(area) > THIN
    e1, e2, f1, f2 = (edge[keep] for edge in (e1, e2, f1, f2))
    area = area[keep]
    into = np.stack([-1j * e2 / area, 1j * e1 / area], axis=-1)
    along = (f1 * e2.conj() - f2 * e1.conj()) / (-2j * area)
    across = (f2 * e1 - f1 * e2) / (-2j * area)
    tip = found.tip[keep]
    return Mesh(tip, found.force[keep], chart[keep], into, along, across, *binned(tip))


def corners(modes: int, most: float, size: float) -> tuple[Array, Array]:
    """alpha and q >= 0 of the mesh: rows of equal alpha, in equal steps of tip and force."""
    alpha = np.linspace(0.0, most, int(np.ceil(most / (1.5 * size))) + 1)[1:]
    table = np.linspace(0.0, most + STRAIGHT, 4000)
    quarter = ellipkm1(1.0 / np.cosh(table) ** 2)
    low = np.interp(alpha / (2.0 * modes + 0.5), quarter, table)
    high = np.interp(alpha + STRAIGHT, quarter, table)
    fine = low[:, None] + (high - low)[:, None] * np.linspace(0.0, 1.0, FINE)
    found = rods(alpha[:, None] + 0.0 * fine, fine)
    way = np.abs(np.diff(found.tip)) + TURNING * np.abs(np.diff(found.delta))
    way = np.cumsum(np.pad(way, ((0, 0), (1, 0))), axis=1)
    count = int(np.ceil(way[:, -1].max() / size)) + 1
    share = np.linspace(0.0, 1.0, count)
    q = np.stack([np.interp(share * w[-1], w, f) for w, f in zip(way, fine, strict=True)])
    return np.broadcast_to(alpha[:, None], q.shape), q


def binned(tip: Complex) -> tuple[Index, Index]:
    """Triangles (t, 3) by the bins that they may answer in: first and listed of a mesh."""
    wide = BEYOND * (np.ptp(tip.real, axis=1) + 1j * np.ptp(tip.imag, axis=1))
    low = boxes(tip.real.min(axis=1) + 1j * tip.imag.min(axis=1) - wide)
    high = boxes(tip.real.max(axis=1) + 1j * tip.imag.max(axis=1) + wide)
    rows = high % BINS - low % BINS + 1
    which, place = ragged(rows * (high // BINS - low // BINS + 1))
    box = low[which] + place // rows[which] * BINS + place % rows[which]
    order = np.argsort(box, kind="stable")
    return np.searchsorted(box[order], np.arange(BINS**2 + 1)), which[order]
