r"""Starts of a search: poses of the platform on a lattice, with all rods that reach them.

The mesh lists, at any pose (P, phi), the ways in which each rod can hold its pin, with their loads
n_i and stiffnesses K_i.  A choice of one way for each rod lacks the load g and is one step off::

    g = (sum n_i - F,  sum (R r_i) x n_i - M)          A_i = [1, J R r_i],  R = Rot(phi)
    step = -(sum A_i^T K_i A_i - sum (R r_i).n_i e e^T)^-1 g                e = (0, 0, 1)

It is worth a start where that step is short.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from proofmass.analytic.numerics import Array, Complex
from proofmass.analytic.rods.search_mesh import Index, Mesh, mesh, ragged
from proofmass.analytic.rods.state import State, clamps

NEAR = (0.1, 0.3)  # [L], [rad] that a start may be off
CHUNK = 1_000_000  # choices at once
MESH = 0.08  # between neighbours of the mesh [L]
FINEST = 0.01  # cell [L] at which a lattice without poses is given up
RIM = 1.1  # of a rod's length: how far from its clamp the lattice takes its pin
DRAWN = 0.98  # where a pin further out is looked for: lightly loaded rods end at the rim


@dataclass(frozen=True)
class Ways:
    """Rods that reach the pins of poses, in the order of the poses; see `Mesh`.

    Attributes
    ----------
    force, along, across : ndarray of complex (m,)
        Load [N] and stiffness [N/m]: dforce = along dtip + across conj(dtip).
    chart : ndarray (2, m)
    """

    force: Complex
    along: Complex
    across: Complex
    chart: Array

    def __getitem__(self, which: Index) -> "Ways":
        return Ways(self.force[which], self.along[which], self.across[which],
                    self.chart[:, which])


def starts(s: State, modes: Sequence[int], largest: float,
           poses: int) -> Iterator[tuple[Array, Array]]:
    """Batches of starts: charts (k, 2, n) and poses (3, n)."""
    a, (angle, clamp, _) = s.assembly, clamps(s)
    where, phi = lattice(s, poses)
    arm = np.exp(1j * phi) * a.arm[:, None]
    found = [reaching(mesh(modes[i], largest, MESH), where + arm[i] - clamp[i], angle[i],
                      a.length[i], a.stiffness[i]) for i in range(a.rods)]
    counts = np.array([count for count, _ in found])
    begin = np.cumsum(counts, axis=1) - counts
    blocks = np.cumsum(counts.prod(axis=0)) // CHUNK
    for block in np.unique(blocks):
        at = np.flatnonzero(blocks == block)
        row, place = ragged(counts[:, at].prod(axis=0))
        at, chosen = at[row], []
        for i, (_, ways) in enumerate(found):
            place, own = np.divmod(place, counts[i, at])
            chosen.append(ways[begin[i, at] + own])
        near = np.flatnonzero(balanced(s, chosen, arm[:, at]))
        yield (np.stack([ways.chart[:, near] for ways in chosen]),
               np.stack([where.real, where.imag, phi])[:, at[near]])


def lattice(s: State, poses: int) -> tuple[Complex, Array]:
    """Places P and angles phi (n,) that every pin can be brought to, as many as asked or more."""
    a, clamp = s.assembly, clamps(s)[1]
    cell = 0.1 * a.length.min()
    while True:
        where, phi = around(s, cell)
        away = np.abs(where + np.exp(1j * phi) * a.arm[:, None] - clamp[:, None])
        keep = (away < RIM * a.length[:, None]).all(axis=0)
        if keep.sum() >= poses:
            return where[keep], phi[keep]
        if not keep.any() and cell < FINEST * a.length.min():
            raise ValueError(f"inputs {s.inputs.tolist()} put the clamps further apart than rods "
                             "and platform reach")
        cell /= 1.2


def around(s: State, cell: float) -> tuple[Complex, Array]:
    """Poses `cell` [m] apart, in a box around all that the pins can be brought to."""
    a, clamp = s.assembly, clamps(s)[1]
    reach = RIM * a.length + np.abs(a.arm)
    east, north = (np.arange((part - reach).max(), (part + reach).min() + cell, cell)
                   for part in (clamp.real, clamp.imag))
    turns = int(np.ceil(2.0 * np.pi / 3.0 * a.length.min() / cell)) if a.freedoms == 3 else 1
    x, y, phi = np.meshgrid(east, north, np.arange(turns) * 2.0 * np.pi / turns)
    return (x + 1j * y).ravel(), phi.ravel()


def reaching(sheet: Mesh, off: Complex, angle: float, length: float,
             stiffness: float) -> tuple[Index, Ways]:
    """How many ways a rod has to bring its tip `off` (n,) [m] from its clamp, and all of them."""
    point = off * np.exp(-1j * angle) / length
    which, triangle, share = sheet.reaching(point / np.maximum(1.0, np.abs(point) / DRAWN))
    order = np.argsort(which, kind="stable")
    triangle, share = triangle[order], share[order]
    unit = stiffness / length**2
    return np.bincount(which, minlength=off.size), Ways(
        unit * np.exp(1j * angle) * (share * sheet.force[triangle]).sum(axis=-1),
        unit / length * sheet.along[triangle],
        unit / length * np.exp(2j * angle) * sheet.across[triangle],
        np.einsum("ns,nsc->cn", share, sheet.chart[triangle]))


def balanced(s: State, chosen: Sequence[Ways], arm: Complex) -> NDArray[np.bool_]:
    """Whether the step to equilibrium is short (n,), by Cramer's rule."""
    force, along, across = (sum(getattr(ways, name) for ways in chosen)
                            for name in ("force", "along", "across"))
    side, bend, moment = 0.0 * along, 0.0 * along.real, 0.0 * along.real
    for ways, r in zip(chosen, arm, strict=True):
        push, load = 1j * (ways.along * r - ways.across * r.conj()), r.conj() * ways.force
        side, moment = side + push, moment + load.imag
        bend = bend + (r.conj() * push).imag - load.real
    if s.assembly.freedoms == 2:
        bend = bend + 1.0
    given = np.append(s.load, 0.0)
    first, second, third = np.array([
        [(along + across).real, across.imag, side.real],
        [across.imag, (along - across).real, side.imag],
        [side.real, side.imag, bend]])
    one, two, three = (np.cross(u, v, axis=0) for u, v in (
        (second, third), (third, first), (first, second)))
    size = np.abs((first * one).sum(axis=0))
    x, y, turn = np.abs((force.real - given[0]) * one + (force.imag - given[1]) * two
                        + (moment - given[2]) * three)
    near = NEAR[0] * s.assembly.length.min()
    return np.asarray((np.hypot(x, y) < near * size) & (turn < NEAR[1] * size))
