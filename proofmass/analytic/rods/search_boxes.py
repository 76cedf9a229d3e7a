r"""How large the loads of rods on a platform can be, pose by pose.

Let d_i lead from a clamp to its pin, and let (v, w) be any small motion of the platform, which
moves the pins by t_i = v + w J R r_i.  In equilibrium sum n_i.t_i = F.v + M w.  A tip's place
along its load gives n_i.d_i >= R_i L_i - hold(alpha_i) sqrt(R_i EI_i) (see `search_bound`)::

    s_i = 1 - |d_i - t_i|/L_i
    sum EI_i/L_i (alpha_i^2 s_i - hold(alpha_i) alpha_i)  <=  F.v + M w

No alpha_i is large where some motion makes every s_i positive.  No motion does only where rods
stretched to their full lengths hold the platform tight against each other: with equilibria of few
inflections and ever larger loads rods would be straight in the limit, with no load but their own.

One motion serves a box of poses, in which |d_i - t_i| changes by no more than
|dP| + sqrt(1 + w^2) |r_i| dphi.  Boxes are halved where their bound is the largest.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from proofmass.analytic.numerics import TURN, Array, Complex
from proofmass.analytic.rods.search_bound import hold, largest
from proofmass.analytic.rods.state import State, clamps

WITHIN = 1.1  # of the largest bound of single poses that the bound may be
EDGE = 0.1  # of the first boxes, over the shortest rod
HALVINGS = 8
CHUNK = 20_000  # boxes at once
FURTHEST = 300.0  # alpha at which a bound is given up
SLACK = np.geomspace(0.01, 2.0, 400)  # s_i of a table; what is less counts as none
SMOOTH = 5.0, 30.0, 200.0  # the largest of the lengths is smoothed to 1/5, 1/30 .. of a rod
STEPS = 6  # of Newton's method for each of these
ROUND = 1e-6  # below which a length is smoothed
STRIDE = 0.3  # longest step of a motion


@dataclass(frozen=True)
class Boxes:
    """Poses P +- half (1 + i), phi +- turn, with a motion (v, w) for each: (n,), (n, 3)."""

    where: Complex
    phi: Array
    half: float
    turn: float
    motion: Array

    def __getitem__(self, which: NDArray[np.bool_]) -> "Boxes":
        return Boxes(self.where[which], self.phi[which], self.half, self.turn, self.motion[which])

    def halved(self, flat: bool) -> "Boxes":
        """Four or eight for each."""
        sides = np.array([-0.5, 0.5])
        x, y, phi = (part.ravel()[:, None] for part in np.meshgrid(
            sides * self.half, sides * self.half, [0.0] if flat else sides * self.turn))
        return Boxes((self.where + x + 1j * y).ravel(), (self.phi + phi).ravel(), self.half / 2.0,
                     self.turn / 2.0, np.tile(self.motion, (x.size, 1)))


def bound(s: State, modes: Sequence[int]) -> float:
    """alpha = L sqrt(R/EI) that no rod of any equilibrium exceeds; inf where none is found.

    >>> from proofmass.analytic.rods.assembly import assembly
    >>> from proofmass.analytic.rods.state import state

    Proven but for rounding, without interval arithmetic; by a tenth above what the inequality
    gives for the worst pose.  Rods that can be stretched against each other have none:

    >>> float(bound(state(assembly([[-1.0, 0.0], [1.0, 0.0]])), (1, 1)))
    inf

    >>> 8.0 < bound(state(assembly([[-0.3, 0.0], [0.3, 0.0]])), (1, 1)) < 10.0
    True
    """
    boxes, most = first(s), 0.0
    for _ in range(HALVINGS):
        boxes = moved(s, boxes)
        alone, reached = limits(s, boxes, modes, whole=False)
        most = max(most, alone[reached].max(initial=0.0))
        limit, reached = limits(s, boxes, modes)
        if most > FURTHEST:
            break
        split = reached & (limit > WITHIN * most)
        if not split.any():
            return float(WITHIN * most)
        boxes = boxes[split].halved(s.assembly.freedoms == 2)
    return float(np.inf)


def tight(s: State, modes: Sequence[int], least: float, edge: float) -> Boxes:
    """All poses, in boxes with that edge [L] or less, where some alpha may exceed `least`."""
    boxes = first(s)
    while True:
        boxes = moved(s, boxes)
        limit, reached = limits(s, boxes, modes)
        boxes = boxes[reached & (limit > least)]
        if 2.0 * boxes.half <= edge * s.assembly.length.min():
            return boxes
        boxes = boxes.halved(s.assembly.freedoms == 2)


def first(s: State) -> Boxes:
    """Boxes that hold all poses which pins can be brought to."""
    a, clamp = s.assembly, clamps(s)[1]
    reach, edge = a.length + np.abs(a.arm), EDGE * a.length.min()
    x, y = (np.arange((part - reach).max(), (part + reach).min() + edge, edge)
            for part in (clamp.real, clamp.imag))
    count = int(np.ceil(TURN * np.abs(a.arm).max() / edge)) if a.freedoms == 3 else 1
    east, north, phi = (part.ravel() for part in np.meshgrid(x, y, TURN / count * np.arange(count)))
    return Boxes(east + 1j * north, phi, edge / 2.0,
                 np.pi / count if a.freedoms == 3 else 0.0, np.zeros((phi.size, 3)))


def moved(s: State, boxes: Boxes) -> Boxes:
    """The same with motions that make the least s_i of their centres as large as possible."""
    parts = (slice(i, i + CHUNK) for i in range(0, boxes.phi.size, CHUNK))
    motion = [best(s, boxes.where[i], boxes.phi[i], boxes.motion[i]) for i in parts]
    return Boxes(boxes.where, boxes.phi, boxes.half, boxes.turn,
                 np.concatenate([np.empty((0, 3)), *motion]))


def best(s: State, where: Complex, phi: Array, start: Array) -> Array:
    """Motions (n, 3) whose largest |d_i - t_i|/L_i is about the least: any is a proof.

    Newton's method for the logarithm of the sum of exp(sharp |d_i - t_i|/L_i), which is convex.
    """
    a, unknown = s.assembly, s.assembly.freedoms
    length = a.length[:, None]
    arm = np.exp(1j * phi) * a.arm[:, None]
    away = where + arm - clamps(s)[1][:, None]
    lever = np.zeros((*away.shape, 2, 3))
    lever[..., 0, 0] = lever[..., 1, 1] = 1.0
    lever[..., 0, 2], lever[..., 1, 2] = -arm.imag, arm.real
    lever = lever[..., :unknown] / length[..., None, None]
    away = np.stack([away.real, away.imag], axis=-1) / length[..., None]
    out, at, least = start.copy(), start[:, :unknown], np.full(phi.size, np.inf)
    for sharp in SMOOTH:
        for _ in range(STEPS):
            gap = away - np.einsum("knij,nj->kni", lever, at)
            size = np.sqrt((gap**2).sum(axis=-1) + ROUND**2)
            most = size.max(axis=0)
            better = most < least
            least[better], out[better, :unknown] = most[better], at[better]
            weight = np.exp(sharp * (size - most))
            weight /= weight.sum(axis=0)
            way = gap / size[..., None]
            slope = -np.einsum("knij,kni->knj", lever, way)
            mean = np.einsum("kn,knj->nj", weight, slope)
            bend = (np.eye(2) - way[..., :, None] * way[..., None, :]) / size[..., None, None]
            matrix = np.einsum("kn,knai,knab,knbj->nij", weight, lever, bend, lever, optimize=True)
            matrix += sharp * (np.einsum("kn,kni,knj->nij", weight, slope, slope)
                               - mean[:, :, None] * mean[:, None, :])
            matrix += 1e-9 * np.eye(unknown)  # three equal loads leave a motion free
            step = np.linalg.solve(matrix, mean[..., None])[..., 0]
            longest = np.abs(step).max(axis=1, keepdims=True)
            at = at - step * np.minimum(1.0, STRIDE / np.maximum(longest, ROUND))
    return out


def limits(s: State, boxes: Boxes, modes: Sequence[int],
           whole: bool = True) -> tuple[Array, NDArray[np.bool_]]:
    """alpha (n,) that no rod exceeds in a box, or at its centre; and whether all pins get there."""
    a = s.assembly
    arm, length = np.exp(1j * boxes.phi) * a.arm[:, None], a.length[:, None]
    away = boxes.where + arm - clamps(s)[1][:, None]
    v, w = boxes.motion[:, 0] + 1j * boxes.motion[:, 1], boxes.motion[:, 2]
    across = np.sqrt(2.0) * boxes.half * whole
    turn = np.abs(a.arm)[:, None] * boxes.turn * whole
    reached = (np.abs(away) <= length + across + turn).all(axis=0)
    slack = 1.0 - (np.abs(away - v - 1j * w * arm) + across + np.sqrt(1.0 + w**2) * turn) / length
    given = np.abs(boxes.motion @ np.append(s.load, 0.0)[:3])
    out, held = np.full(w.size, np.inf), reached & (slack > SLACK[0]).all(axis=0)
    slack, given = slack[:, held], given[held]
    unit = (a.stiffness / a.length)[:, None]
    low = unit * np.stack([np.interp(part, SLACK, lowest(mode))
                           for part, mode in zip(slack, modes, strict=True)])
    room = (given - low.sum(axis=0) + low) / unit
    out[held] = np.max([largest_root(*part) for part in zip(slack, room, modes, strict=True)],
                       axis=0)
    return out, reached


@lru_cache(maxsize=16)
def lowest(mode: int) -> Array:
    """Least of alpha^2 s - hold(alpha) alpha over alpha, for s in `SLACK`.

    It is concave in s, so that interpolation stays below it.
    """
    alpha = np.geomspace(0.1, 2.0 * np.pi * mode / SLACK[0], 4000)
    least = (alpha**2 * SLACK[:, None] - hold(alpha, mode) * alpha).min(axis=1)
    return np.asarray(1.0001 * least)  # between two alpha it may be less by 2e-6


def largest_root(slack: Array, room: Array, mode: int) -> Array:
    """alpha, or a little more, beyond which alpha^2 slack - hold(alpha) alpha exceeds room >= 0."""
    held = np.asarray(4.0 * mode)  # the least that it can be gives less than the root, then more
    for _ in range(2):
        root = (held + np.sqrt(held**2 + 4.0 * slack * room)) / (2.0 * slack)
        held = hold(root, mode)
    return np.asarray(root)


def proven(s: State, modes: Sequence[int]) -> float:
    """The bound that costs nothing, or else that of the boxes."""
    quick = largest(s, modes)
    return quick if np.isfinite(quick) else bound(s, modes)
