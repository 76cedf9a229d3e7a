r"""All equilibria of rods on a common platform: the direct problem, without a first guess.

1. The loads of rods in equilibrium are bounded.
2. A mesh of all rods gives, to first order, the rods whose tips reach a point.
3. A lattice of poses gives starts under small loads.  Poses in which rods may be stretched tight
   give starts under large loads.
4. Newton's method leads from each start to an equilibrium; its unknowns are the chart coordinates
   of the rods and the pose.

**A bound by one pose.** Along its own load a rod's tip is L (1 - 2 E(alpha)/alpha) from the clamp,
with E(alpha) <= 2 mode E(k). Summed over the rods, with any point c of the plane and rho the
largest |P - c|::

    sum R_i (L_i - |O_i - c| - |r_i|) - sum 4 mode_i E(k_i) sqrt(R_i EI_i)  <=  |F| rho

so that no R_i is large unless clamps are so far apart that rods can be stretched between them.
The bound of `bound_by_boxes` exists in more cases, but takes seconds for a platform.

**A bound by boxes of poses.** Let d_i be the vector from a clamp to its pin, and let (v, w) be any
small motion of the platform, which moves the pins by t_i = v + w J R r_i.  In equilibrium
sum n_i.t_i = F.v + M w.  The position of a tip along its load (see above) gives, with H_i the value
of `bending_allowance` at alpha_i, n_i.d_i >= R_i L_i - H_i sqrt(R_i EI_i), and therefore::

    s_i = 1 - |d_i - t_i|/L_i
    sum EI_i/L_i (alpha_i^2 s_i - H_i alpha_i)  <=  F.v + M w

No alpha_i is large if some motion makes every s_i positive.  The only poses without such a motion
are those in which rods of their full lengths pull the platform tight against each other: in
equilibria of few inflections the rods become straight as their loads grow, and in the limit they
balance each other without the external load.

The same motion is used for a whole box of poses, in which |d_i - t_i| changes by no more than
|dP| + sqrt(1 + w^2) |r_i| dphi.  Boxes are halved where their bound is the largest.

**Starts under large loads**, where the first steps from the lattice are too long. A rod with a
large alpha and few inflections is straight in tension, except for loops of a size of 1/alpha.  The
first loop is K from the tip and each further one 2 K from the one before, all in units of L/alpha;
the clamp cuts off the last one.  With delta the angle of the clamp over the load and j = 0, 1 ..
whole loops, to either side (q > 0, q < 0)::

    alpha = (2 j + 1) K + y,    tanh(y) = -(-1)^j cos(delta/2),    |q| = K - ln 2 + O(e^-2K)

so each j < mode gives two such rods for a direction and a size of the load.  Starts are drawn at
random: a pose from `tight_poses`; loads along the straight rods, either in the ratio that balances
best or in any ratio; and for each clamp one of these rods or, under a light load, any rod of the
chart.

**Starts on a lattice.** For any pose (P, phi) the mesh lists the shapes in which each rod reaches
its pin, with their loads n_i and stiffnesses K_i.  A choice of one shape for each rod has the
unbalanced load g and is one Newton step from equilibrium::

    g = (sum n_i - F,  sum (R r_i) x n_i - M)          A_i = [1, J R r_i],  R = Rot(phi)
    step = -(sum A_i^T K_i A_i - sum (R r_i).n_i e e^T)^-1 g                e = (0, 0, 1)

The choice becomes a start if that step is short.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ellipe, ellipkm1

from proofmass.analytic.numerics import TURN
from proofmass.analytic.rods.assembly import Assembly
from proofmass.analytic.rods.elastica import (
    ElasticaRods,
    bounds_in_range,
    relative_in_range,
    rods_of_chart,
)
from proofmass.analytic.rods.equilibrium import RodState, clamps_and_forces, state
from proofmass.base.arrays import Array, Complex, Index

POSE_BOUND_MAX_ALPHA = 200.0  # alpha up to which `bound_by_pose` looks for a bound
POSE_BOUND_SAMPLES = 20001  # values of alpha up to there


def bound_by_pose(s: RodState, modes: Sequence[int]) -> float:
    """A bound of alpha = L sqrt(R/EI) of all rods in equilibrium, by one pose; inf if unknown."""
    a, clamp = s.assembly, clamps_and_forces(s)[1]
    away = np.abs(clamp - clamp.mean()) + np.abs(a.arm)
    slack = a.length - away
    if np.any(slack <= 0.0):
        return float(np.inf)
    alpha = np.linspace(0.0, POSE_BOUND_MAX_ALPHA, POSE_BOUND_SAMPLES)
    allowance = np.array([bending_allowance(alpha, mode) for mode in modes])
    unit = (a.stiffness / a.length)[:, None]
    excess = unit * alpha * (alpha * (slack / a.length)[:, None] - allowance)
    spare = np.hypot(*s.load[:2]) * (a.length + away).min()
    room = spare - excess.min(axis=1).sum() + excess.min(axis=1)
    last = max(
        alpha[np.flatnonzero(row <= most)[-1]] for row, most in zip(excess, room, strict=True)
    )
    step = POSE_BOUND_MAX_ALPHA / POSE_BOUND_SAMPLES
    return float(last + step) if last < POSE_BOUND_MAX_ALPHA else float(np.inf)


def bending_allowance(alpha: Array, mode: int) -> Array:
    """4 mode E(k) of the least bent rod of a mode: K(k) = alpha/(2 mode), or k = 0 if straight."""
    q = np.linspace(0.0, 20.0, 4001)
    rest = 1.0 / np.cosh(q) ** 2
    return np.asarray(
        4.0 * mode * np.interp(alpha / (2.0 * mode), ellipkm1(rest), ellipe(1.0 - rest))
    )


MAX_BOUND_RATIO = 1.1  # largest ratio of the bound of boxes to the largest bound of single poses
FIRST_EDGE = 0.1  # edge of the first boxes, over the length of the shortest rod
MAX_BOX_HALVINGS = 8  # times that boxes are halved before no bound is found
BOXES_AT_ONCE = 20_000  # boxes whose motions are found in one batch
BOUND_MAX_ALPHA = 300.0  # alpha up to which `bound_by_boxes` looks for a bound
SLACK_VALUES = np.geomspace(0.01, 2.0, 400)  # s_i of a table; less counts as none
SHARPNESSES = 5.0, 30.0, 200.0  # the largest length is smoothed to 1/5, 1/30 .. of a rod
STEPS_PER_SHARPNESS = 6  # steps of Newton's method for each sharpness
SMOOTHED_LENGTH = 1e-6  # length, over that of a rod, below which its absolute value is smoothed
MAX_MOTION_STEP = 0.3  # longest step of a motion in Newton's method


@dataclass(frozen=True)
class Boxes:
    """Boxes of poses, P +- half (1 + i) and phi +- turn, with a motion (v, w) for each: (n, 3)."""

    where: Complex
    phi: Array
    half: float
    turn: float
    motion: Array

    def __getitem__(self, which: NDArray[np.bool_]) -> "Boxes":
        return Boxes(self.where[which], self.phi[which], self.half, self.turn, self.motion[which])

    def halve(self, flat: bool) -> "Boxes":
        """Four boxes for each, halved in x and y, or eight if phi is halved as well."""
        sides = np.array([-0.5, 0.5])
        x, y, phi = (
            part.ravel()[:, None]
            for part in np.meshgrid(
                sides * self.half, sides * self.half, [0.0] if flat else sides * self.turn
            )
        )
        return Boxes(
            (self.where + x + 1j * y).ravel(),
            (self.phi + phi).ravel(),
            self.half / 2.0,
            self.turn / 2.0,
            np.tile(self.motion, (x.size, 1)),
        )


def bound_by_boxes(s: RodState, modes: Sequence[int], enough: float = np.inf) -> float:
    """alpha = L sqrt(R/EI) that no rod of any equilibrium exceeds, by boxes of poses.

    It is inf if no bound is found, or none below `enough`.  It is proven up to rounding, since
    there is no interval arithmetic, and at most a tenth above the value that the inequality gives
    for the worst pose.

    >>> from proofmass.analytic.rods.assembly import assembly
    >>> from proofmass.analytic.rods.equilibrium import state

    Rods that can be stretched against each other have no bound:

    >>> float(bound_by_boxes(state(assembly([[-1.0, 0.0], [1.0, 0.0]])), (1, 1)))
    inf

    >>> 8.0 < bound_by_boxes(state(assembly([[-0.3, 0.0], [0.3, 0.0]])), (1, 1)) < 10.0
    True
    """
    boxes, max_alpha_of_poses = first_boxes(s), 0.0
    for _ in range(MAX_BOX_HALVINGS):
        boxes = with_best_motions(s, boxes)
        alone, reached = alpha_limits(s, boxes, modes, whole=False)
        max_alpha_of_poses = max(max_alpha_of_poses, alone[reached].max(initial=0.0))
        if max_alpha_of_poses > min(BOUND_MAX_ALPHA, enough / MAX_BOUND_RATIO):
            break
        limit, reached = alpha_limits(s, boxes, modes)
        split = reached & (limit > MAX_BOUND_RATIO * max_alpha_of_poses)
        if not split.any():
            return float(MAX_BOUND_RATIO * max_alpha_of_poses)
        boxes = boxes[split].halve(s.assembly.dof == 2)
    return float(np.inf)


def tight_poses(s: RodState, modes: Sequence[int], min_alpha: float, edge: float) -> Boxes:
    """Boxes, of that edge [L] or less, of all poses in which some alpha may exceed `min_alpha`."""
    boxes = first_boxes(s)
    while True:
        boxes = with_best_motions(s, boxes)
        limit, reached = alpha_limits(s, boxes, modes)
        boxes = boxes[reached & (limit > min_alpha)]
        if 2.0 * boxes.half <= edge * s.assembly.length.min():
            return boxes
        boxes = boxes.halve(s.assembly.dof == 2)


def first_boxes(s: RodState) -> Boxes:
    """The first boxes, which contain all poses whose pins are within the reach of the rods."""
    a, clamp = s.assembly, clamps_and_forces(s)[1]
    reach, edge = a.length + np.abs(a.arm), FIRST_EDGE * a.length.min()
    x, y = (
        np.arange((part - reach).max(), (part + reach).min() + edge, edge)
        for part in (clamp.real, clamp.imag)
    )
    count = int(np.ceil(TURN * np.abs(a.arm).max() / edge)) if a.dof == 3 else 1
    east, north, phi = (part.ravel() for part in np.meshgrid(x, y, TURN / count * np.arange(count)))
    return Boxes(
        east + 1j * north,
        phi,
        edge / 2.0,
        np.pi / count if a.dof == 3 else 0.0,
        np.zeros((phi.size, 3)),
    )


def with_best_motions(s: RodState, boxes: Boxes) -> Boxes:
    """The same boxes, with the motions that make the least s_i of their centres largest."""
    parts = (slice(i, i + BOXES_AT_ONCE) for i in range(0, boxes.phi.size, BOXES_AT_ONCE))
    motion = [best_motions(s, boxes.where[i], boxes.phi[i], boxes.motion[i]) for i in parts]
    return Boxes(
        boxes.where, boxes.phi, boxes.half, boxes.turn, np.concatenate([np.empty((0, 3)), *motion])
    )


def best_motions(s: RodState, where: Complex, phi: Array, start: Array) -> Array:
    """Motions (n, 3) that nearly minimize the largest |d_i - t_i|/L_i; any motion proves a bound.

    Newton's method minimizes the logarithm of the sum of exp(sharp |d_i - t_i|/L_i), which is
    convex.
    """
    a, unknown = s.assembly, s.assembly.dof
    length = a.length[:, None]
    arm = np.exp(1j * phi) * a.arm[:, None]
    away = where + arm - clamps_and_forces(s)[1][:, None]
    lever = np.zeros((*away.shape, 2, 3))
    lever[..., 0, 0] = lever[..., 1, 1] = 1.0
    lever[..., 0, 2], lever[..., 1, 2] = -arm.imag, arm.real
    lever = lever[..., :unknown] / length[..., None, None]
    away = np.stack([away.real, away.imag], axis=-1) / length[..., None]
    best_motion, motion, least = start.copy(), start[:, :unknown], np.full(phi.size, np.inf)
    for sharp in SHARPNESSES:
        for _ in range(STEPS_PER_SHARPNESS):
            offset = away - np.einsum("knij,nj->kni", lever, motion)
            size = np.sqrt((offset**2).sum(axis=-1) + SMOOTHED_LENGTH**2)
            most = size.max(axis=0)
            better = most < least
            least[better], best_motion[better, :unknown] = most[better], motion[better]
            weight = np.exp(sharp * (size - most))
            weight /= weight.sum(axis=0)
            direction = offset / size[..., None]
            slope = -np.einsum("knij,kni->knj", lever, direction)
            mean = np.einsum("kn,knj->nj", weight, slope)
            bend = (np.eye(2) - direction[..., :, None] * direction[..., None, :]) / size[
                ..., None, None
            ]
            matrix = np.einsum("kn,knai,knab,knbj->nij", weight, lever, bend, lever, optimize=True)
            matrix += sharp * (
                np.einsum("kn,kni,knj->nij", weight, slope, slope)
                - mean[:, :, None] * mean[:, None, :]
            )
            matrix += 1e-9 * np.eye(unknown)  # with three equal loads the matrix is singular
            step = np.linalg.solve(matrix, mean[..., None])[..., 0]
            longest = np.abs(step).max(axis=1, keepdims=True)
            motion = motion - step * np.minimum(
                1.0, MAX_MOTION_STEP / np.maximum(longest, SMOOTHED_LENGTH)
            )
    return best_motion


def alpha_limits(
    s: RodState, boxes: Boxes, modes: Sequence[int], whole: bool = True
) -> tuple[Array, NDArray[np.bool_]]:
    """alpha (n,) that no rod exceeds in a box, or at its centre; whether all pins are in reach."""
    a = s.assembly
    arm, length = np.exp(1j * boxes.phi) * a.arm[:, None], a.length[:, None]
    away = boxes.where + arm - clamps_and_forces(s)[1][:, None]
    v, w = boxes.motion[:, 0] + 1j * boxes.motion[:, 1], boxes.motion[:, 2]
    across = np.sqrt(2.0) * boxes.half * whole
    turn = np.abs(a.arm)[:, None] * boxes.turn * whole
    reached = (np.abs(away) <= length + across + turn).all(axis=0)
    slack = 1.0 - (np.abs(away - v - 1j * w * arm) + across + np.sqrt(1.0 + w**2) * turn) / length
    given = np.abs(boxes.motion @ np.append(s.load, 0.0)[:3])
    alpha, valid = np.full(w.size, np.inf), reached & (slack > SLACK_VALUES[0]).all(axis=0)
    slack, given = slack[:, valid], given[valid]
    unit = (a.stiffness / a.length)[:, None]
    low = unit * np.stack(
        [
            np.interp(part, SLACK_VALUES, minima_over_alpha(mode))
            for part, mode in zip(slack, modes, strict=True)
        ]
    )
    room = (given - low.sum(axis=0) + low) / unit
    alpha[valid] = np.max(
        [largest_root(*part) for part in zip(slack, room, modes, strict=True)], axis=0
    )
    return alpha, reached


@lru_cache(maxsize=16)
def minima_over_alpha(mode: int) -> Array:
    """Minima over alpha of alpha^2 s - H alpha for s in `SLACK_VALUES`, H by `bending_allowance`.

    It is concave in s, so linear interpolation does not exceed it.
    """
    alpha = np.geomspace(0.1, 2.0 * np.pi * mode / SLACK_VALUES[0], 4000)
    least = (alpha**2 * SLACK_VALUES[:, None] - bending_allowance(alpha, mode) * alpha).min(axis=1)
    return np.asarray(1.0001 * least)  # between two values of alpha the minimum may be 2e-6 lower


def largest_root(slack: Array, room: Array, mode: int) -> Array:
    """alpha, or slightly more, where alpha^2 slack - H alpha = room, H by `bending_allowance`."""
    allowance = np.asarray(4.0 * mode)  # the least H; one step ends below the root, two above
    for _ in range(2):
        root = (allowance + np.sqrt(allowance**2 + 4.0 * slack * room)) / (2.0 * slack)
        allowance = bending_allowance(root, mode)
    return np.asarray(root)


def theoretical_bound(s: RodState, modes: Sequence[int], enough: float = np.inf) -> float:
    """The bound by one pose if there is one, else by boxes; inf if the latter exceeds `enough`."""
    quick = bound_by_pose(s, modes)
    return quick if np.isfinite(quick) else bound_by_boxes(s, modes, enough)


TIGHT_EDGE = 0.05  # largest edge of the boxes of tight poses [L]
STARTS_PER_CHOICE = 80  # random starts for each choice of loops
MIN_STARTS = 2000  # least number of random starts
SEED = 1  # of the random numbers
LOAD_ANGLE_DEVIATION = 0.1  # standard deviation of a load from its straight rod [rad]
LIGHT_LOAD_ALPHA = 8.0  # alpha below which half of the rods are drawn from the whole chart
MIN_LOAD_RATIO = 1e-3  # least load of a rod, over the largest one
TANH_MARGIN = 1e-12  # least 1 - |tanh(y)|, of a rod that lies along its load


def draw_starts(
    s: RodState, modes: Sequence[int], min_alpha: float, max_alpha: float
) -> tuple[Array, Array]:
    """Random starts, charts (k, 2, n) and poses (3, n), with some alpha in about this range."""
    a, (theta, clamp, _) = s.assembly, clamps_and_forces(s)
    boxes, random = tight_poses(s, modes, min_alpha, TIGHT_EDGE), np.random.default_rng(SEED)
    n = (
        max(MIN_STARTS, STARTS_PER_CHOICE * int(np.prod(2 * np.array(modes))))
        if boxes.phi.size
        else 0
    )
    box, part = random.integers(max(1, boxes.phi.size), size=n), random.uniform(-1.0, 1.0, (3, n))
    where = boxes.where[box] + boxes.half * (part[0] + 1j * part[1])
    phi = boxes.phi[box] + boxes.turn * part[2]
    arm = np.exp(1j * phi) * a.arm[:, None]
    along = where + arm - clamp[:, None]
    along /= np.abs(along)
    load = draw_load_ratios(along, arm / a.length.mean(), random)
    unit = (a.stiffness / a.length**2)[:, None]
    size = np.sqrt(load / unit / (load / unit).max(axis=0, initial=0.0))
    alpha = size * np.exp(random.uniform(np.log(min_alpha), np.log(max_alpha), n))
    delta = theta[:, None] - np.angle(along) + random.normal(0.0, LOAD_ANGLE_DEVIATION, alpha.shape)
    return draw_charts(alpha, delta, np.array(modes)[:, None], random), np.stack(
        [where.real, where.imag, phi]
    )


def draw_load_ratios(along: Array, arm: Array, random: np.random.Generator) -> Array:
    """Ratios of loads (k, n) on straight rods: half balance as well as can be, half are random."""
    balance = np.moveaxis(np.stack([along.real, along.imag, (arm.conj() * along).imag]), -1, 0)
    best = np.abs(np.linalg.svd(balance)[2][:, -1]).T if balance.size else np.ones(along.shape)
    any_other = random.uniform(0.0, 1.0, along.shape)
    return np.maximum(
        np.where(random.random(along.shape[1]) < 0.5, best, any_other), MIN_LOAD_RATIO
    )


def draw_charts(
    alpha: Array, delta: Array, modes: NDArray[np.int_], random: np.random.Generator
) -> Array:
    """Charts (k, 2, n) of rods with random loops; half of the light rods have any q."""
    side, loops = random.choice([-1.0, 1.0], alpha.shape), random.integers(0, modes, alpha.shape)
    cosine = -((-1.0) ** loops) * np.cos((side * delta) % TURN / 2.0)
    y = np.arctanh(np.clip(cosine, TANH_MARGIN - 1.0, 1.0 - TANH_MARGIN))
    q = side * np.maximum((alpha - y) / (2 * loops + 1) - np.log(2.0), 0.05)
    any_other = random.uniform(-1.0, 1.0, alpha.shape) * (alpha + 3.0)
    light = (alpha < LIGHT_LOAD_ALPHA) & (random.random(alpha.shape) < 0.5)
    return np.stack([alpha, np.where(light, any_other, q)], axis=1)


STRAIGHT_ROD_EXCESS = 8.0  # largest K - alpha: the rod is straight within 4 exp(-8)
ARC_POINTS = 500  # points by which the arc length of a row of the mesh is measured
ROTATION_WEIGHT = 0.15  # [L] of arc length for which a load's rotation by 1 rad counts
TRIANGLE_MARGIN = 0.15  # a triangle has points as far outside, in its coordinates
MIN_TRIANGLE_AREA = 1e-14  # twice the area [L^2] of a degenerate triangle, of straight rods
BINS_PER_SIDE = 64  # bins along each side of the square around the reach of a rod


@dataclass(frozen=True)
class Mesh:
    """Triangles of rods of unit length and stiffness: the equilibrium manifold of one rod.

    Attributes
    ----------
    tip, force : ndarray of complex (t, 3)
        Tip [L] and load [EI/L^2] at the corners.
    chart : ndarray (t, 3, 2)
        alpha and q [1] at the corners.
    into : ndarray of complex (t, 2)
        Coordinates in a triangle are (conj(into) (tip - first corner)).real [1/L].
    along, across : ndarray of complex (t,)
        Stiffness [EI/L^3]: dforce = along dtip + across conj(dtip).
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

    def rods_at(self, point: Complex) -> tuple[Index, Index, Array]:
        """Rods that reach points (n,): the point, the triangle, shares of its corners (m, 3)."""
        box = bin_numbers(point)
        which, place = expand_counts(self.first[box + 1] - self.first[box])
        triangle = self.listed[self.first[box][which] + place]
        offset = point[which] - self.tip[triangle, 0]
        one, two = (self.into[triangle].conj() * offset[:, None]).real.T
        rest = 1.0 - (one + two)
        hit = np.flatnonzero(
            (rest > -TRIANGLE_MARGIN) & (one > -TRIANGLE_MARGIN) & (two > -TRIANGLE_MARGIN)
        )
        return which[hit], triangle[hit], np.column_stack([rest[hit], one[hit], two[hit]])


def expand_counts(counts: Index) -> tuple[Index, Index]:
    """Row numbers 0, 1 .., each repeated its number of `counts`, and the place within the row."""
    row = np.repeat(np.arange(counts.size), counts)
    return row, np.arange(row.size) - np.repeat(np.cumsum(counts) - counts, counts)


def bin_numbers(point: Complex) -> Index:
    """Numbers of the bins that points are in."""
    column, row = (
        np.clip(((part + 1.05) * BINS_PER_SIDE / 2.1).astype(int), 0, BINS_PER_SIDE - 1)
        for part in (point.real, point.imag)
    )
    return np.asarray(column * BINS_PER_SIDE + row)


@lru_cache(maxsize=8)
def make_mesh(modes: int, max_alpha: float, size: float) -> Mesh:
    """Mesh of rods with up to `modes` modes and alpha up to `max_alpha`, in steps of `size` [L]."""
    alpha, q = mesh_corners(modes, max_alpha, size)
    grid = np.arange(alpha.size).reshape(alpha.shape)
    a, b, c, d = (
        grid[:-1, :-1].ravel(),
        grid[1:, :-1].ravel(),
        grid[:-1, 1:].ravel(),
        grid[1:, 1:].ravel(),
    )
    half = np.concatenate([np.stack([a, b, c], -1), np.stack([d, c, b], -1)])
    corner = np.concatenate([half, half + grid.size])
    chart = np.stack([np.tile(alpha.ravel(), 2), np.append(q, -q)], axis=-1)
    found = rods_of_chart(chart[:, 0], chart[:, 1])
    tip, force = found.tip[corner], found.force[corner]
    e1, e2 = (tip[:, k] - tip[:, 0] for k in (1, 2))
    f1, f2 = (force[:, k] - force[:, 0] for k in (1, 2))
    area = (e1.conj() * e2).imag
    keep = np.abs(area) > MIN_TRIANGLE_AREA
    e1, e2, f1, f2 = (edge[keep] for edge in (e1, e2, f1, f2))
    area = area[keep]
    into = np.stack([-1j * e2 / area, 1j * e1 / area], axis=-1)
    along = (f1 * e2.conj() - f2 * e1.conj()) / (-2j * area)
    across = (f2 * e1 - f1 * e2) / (-2j * area)
    tip, force, corner = tip[keep], force[keep], corner[keep]
    return Mesh(tip, force, chart[corner], into, along, across, *bin_triangles(tip))


def mesh_corners(modes: int, max_alpha: float, size: float) -> tuple[Array, Array]:
    """alpha and q >= 0 of the mesh: rows of equal alpha, in equal steps of the tip and the load."""
    alpha = np.linspace(0.0, max_alpha, int(np.ceil(max_alpha / (1.5 * size))) + 1)[1:]
    table = np.linspace(0.0, max_alpha + STRAIGHT_ROD_EXCESS, 4000)
    quarter = ellipkm1(1.0 / np.cosh(table) ** 2)
    low = np.interp(alpha / (2.0 * modes + 0.5), quarter, table)
    high = np.interp(alpha + STRAIGHT_ROD_EXCESS, quarter, table)
    fine = low[:, None] + (high - low)[:, None] * np.linspace(0.0, 1.0, ARC_POINTS)
    found = rods_of_chart(alpha[:, None] + 0.0 * fine, fine)
    arc = np.abs(np.diff(found.tip)) + ROTATION_WEIGHT * np.abs(np.diff(found.delta))
    arc = np.cumsum(np.pad(arc, ((0, 0), (1, 0))), axis=1)
    count = int(np.ceil(arc[:, -1].max() / size)) + 1
    share = np.linspace(0.0, 1.0, count)
    q = np.stack([np.interp(share * w[-1], w, f) for w, f in zip(arc, fine, strict=True)])
    return np.broadcast_to(alpha[:, None], q.shape), q


def bin_triangles(tip: Complex) -> tuple[Index, Index]:
    """Triangles (t, 3) by the bins whose points may belong to them: `Mesh.first`, `Mesh.listed`."""
    wide = TRIANGLE_MARGIN * (np.ptp(tip.real, axis=1) + 1j * np.ptp(tip.imag, axis=1))
    low = bin_numbers(tip.real.min(axis=1) + 1j * tip.imag.min(axis=1) - wide)
    high = bin_numbers(tip.real.max(axis=1) + 1j * tip.imag.max(axis=1) + wide)
    rows = high % BINS_PER_SIDE - low % BINS_PER_SIDE + 1
    which, place = expand_counts(rows * (high // BINS_PER_SIDE - low // BINS_PER_SIDE + 1))
    box = low[which] + place // rows[which] * BINS_PER_SIDE + place % rows[which]
    order = np.argsort(box, kind="stable")
    return np.searchsorted(box[order], np.arange(BINS_PER_SIDE**2 + 1)), which[order]


MAX_FIRST_STEP = (0.1, 0.3)  # longest first step of a start, of P [L] and of phi [rad]
CHOICES_AT_ONCE = 1_000_000  # choices of one shape for each rod in a batch
MESH_SIZE = 0.08  # distance of neighbours in the mesh [L]
MIN_LATTICE_CELL = 0.01  # cell [L] below which a lattice without poses is given up
MAX_PIN_DISTANCE = 1.1  # pin to clamp in the lattice, over the rod's length
LOOKUP_DISTANCE = 0.98  # [L] where pins further out are looked up, as light rods end at 1


@dataclass(frozen=True)
class RodShapes:
    """Shapes of one rod that reach its pin, in the order of the poses; see `Mesh`.

    Attributes
    ----------
    force, along, across : ndarray of complex (m,)
        Load [N] and stiffness [N/m]: dforce = along dtip + across conj(dtip).
    chart : ndarray (2, m)
        alpha and q [1].
    """

    force: Complex
    along: Complex
    across: Complex
    chart: Array

    def __getitem__(self, which: Index) -> "RodShapes":
        return RodShapes(
            self.force[which], self.along[which], self.across[which], self.chart[:, which]
        )


def lattice_starts(
    s: RodState, modes: Sequence[int], max_alpha: float, poses: int
) -> Iterator[tuple[Array, Array]]:
    """Batches of starts on a lattice: charts (k, 2, n) and poses (3, n)."""
    a, (angle, clamp, _) = s.assembly, clamps_and_forces(s)
    where, phi = reachable_poses(s, poses)
    arm = np.exp(1j * phi) * a.arm[:, None]
    found = [
        shapes_at_pins(
            make_mesh(modes[i], max_alpha, MESH_SIZE),
            where + arm[i] - clamp[i],
            angle[i],
            a.length[i],
            a.stiffness[i],
        )
        for i in range(a.rods)
    ]
    counts = np.array([count for count, _ in found])
    begin = np.cumsum(counts, axis=1) - counts
    blocks = np.cumsum(counts.prod(axis=0)) // CHOICES_AT_ONCE
    for block in np.unique(blocks):
        pose_index = np.flatnonzero(blocks == block)
        row, place = expand_counts(counts[:, pose_index].prod(axis=0))
        pose_index, chosen = pose_index[row], []
        for i, (_, ways) in enumerate(found):
            place, own = np.divmod(place, counts[i, pose_index])
            chosen.append(ways[begin[i, pose_index] + own])
        near = np.flatnonzero(is_near_equilibrium(s, chosen, arm[:, pose_index]))
        yield (
            np.stack([ways.chart[:, near] for ways in chosen]),
            np.stack([where.real, where.imag, phi])[:, pose_index[near]],
        )


def reachable_poses(s: RodState, poses: int) -> tuple[Complex, Array]:
    """Positions P and angles phi (n,) of a lattice, `poses` or more, with all pins in reach."""
    a, clamp = s.assembly, clamps_and_forces(s)[1]
    cell = 0.1 * a.length.min()
    while True:
        where, phi = poses_in_box(s, cell)
        away = np.abs(where + np.exp(1j * phi) * a.arm[:, None] - clamp[:, None])
        keep = (away < MAX_PIN_DISTANCE * a.length[:, None]).all(axis=0)
        if keep.sum() >= poses:
            return where[keep], phi[keep]
        if not keep.any() and cell < MIN_LATTICE_CELL * a.length.min():
            raise ValueError(
                f"inputs {s.inputs.tolist()} put the clamps further apart than rods "
                "and platform reach"
            )
        cell /= 1.2


def poses_in_box(s: RodState, cell: float) -> tuple[Complex, Array]:
    """Poses `cell` [m] apart, in a box around all positions of the platform that are in reach."""
    a, clamp = s.assembly, clamps_and_forces(s)[1]
    reach = MAX_PIN_DISTANCE * a.length + np.abs(a.arm)
    east, north = (
        np.arange((part - reach).max(), (part + reach).min() + cell, cell)
        for part in (clamp.real, clamp.imag)
    )
    turns = int(np.ceil(2.0 * np.pi / 3.0 * a.length.min() / cell)) if a.dof == 3 else 1
    x, y, phi = np.meshgrid(east, north, np.arange(turns) * 2.0 * np.pi / turns)
    return (x + 1j * y).ravel(), phi.ravel()


def shapes_at_pins(
    rod_mesh: Mesh, offset: Complex, angle: float, length: float, stiffness: float
) -> tuple[Index, RodShapes]:
    """Shapes of a rod with tips at `offset` (n,) [m] from its clamp: their numbers, and all."""
    point = offset * np.exp(-1j * angle) / length
    which, triangle, share = rod_mesh.rods_at(
        point / np.maximum(1.0, np.abs(point) / LOOKUP_DISTANCE)
    )
    order = np.argsort(which, kind="stable")
    triangle, share = triangle[order], share[order]
    unit = stiffness / length**2
    return np.bincount(which, minlength=offset.size), RodShapes(
        unit * np.exp(1j * angle) * (share * rod_mesh.force[triangle]).sum(axis=-1),
        unit / length * rod_mesh.along[triangle],
        unit / length * np.exp(2j * angle) * rod_mesh.across[triangle],
        np.einsum("ns,nsc->cn", share, rod_mesh.chart[triangle]),
    )


def is_near_equilibrium(
    s: RodState, chosen: Sequence[RodShapes], arm: Complex
) -> NDArray[np.bool_]:
    """Whether the Newton step to equilibrium is short (n,), by Cramer's rule."""
    force, along, across = (
        sum(getattr(ways, name) for ways in chosen) for name in ("force", "along", "across")
    )
    side, bend, moment = 0.0 * along, 0.0 * along.real, 0.0 * along.real
    for ways, r in zip(chosen, arm, strict=True):
        push, load = 1j * (ways.along * r - ways.across * r.conj()), r.conj() * ways.force
        side, moment = side + push, moment + load.imag
        bend = bend + (r.conj() * push).imag - load.real
    if s.assembly.dof == 2:
        bend = bend + 1.0
    given = np.append(s.load, 0.0)
    first, second, third = np.array(
        [
            [(along + across).real, across.imag, side.real],
            [across.imag, (along - across).real, side.imag],
            [side.real, side.imag, bend],
        ]
    )
    one, two, three = (
        np.cross(u, v, axis=0) for u, v in ((second, third), (third, first), (first, second))
    )
    size = np.abs((first * one).sum(axis=0))
    x, y, turn = np.abs(
        (force.real - given[0]) * one + (force.imag - given[1]) * two + (moment - given[2]) * three
    )
    near = MAX_FIRST_STEP[0] * s.assembly.length.min()
    return np.asarray((np.hypot(x, y) < near * size) & (turn < MAX_FIRST_STEP[1] * size))


MAX_START_STEPS = 30  # Newton steps of a start; most starts that converge take less than ten
MAX_START_STEP = 1.0  # longest step of alpha, of q, of phi and of P [L]
MAX_ALPHA_SHARE = 0.3  # longest step of a large alpha, over alpha
START_STEP_TOLERANCE = 1e-11  # length of the last step; the error after it is its square
MIN_ALPHA = 1e-3  # least alpha: below it the rod is straight for every q
MAX_ITERATE = 340.0  # largest alpha and q, where k' = sech(q) is 1e-147
SINGULAR_DETERMINANT = 1e-200  # determinant at or below which a matrix counts as singular


def rotate_rods(s: RodState, found: ElasticaRods) -> tuple[Complex, Complex, Complex, Complex]:
    """Tips from their clamps (k, n) and loads on them, rotated with the clamps' tangents.

    Their derivatives (k, 2, n) by alpha and q follow, in the same order.
    """
    a = s.assembly
    turn = np.exp(1j * clamps_and_forces(s)[0])[:, None]
    length, unit = a.length[:, None] * turn, (a.stiffness / a.length**2)[:, None] * turn
    return (
        length * found.tip,
        unit * found.force,
        np.moveaxis(length * found.tip_slope, 0, 1),
        np.moveaxis(unit * found.force_slope, 0, 1),
    )


def newton_system(s: RodState, chart: Array, pose: Array) -> tuple[Array, Array]:
    """Residuals (n, N) and Jacobians (n, N, N), N = 2 k + p: closures first, then balance."""
    a, k, p = s.assembly, s.assembly.rods, s.assembly.dof
    tip, force, tips, forces = rotate_rods(s, rods_of_chart(chart[:, 0], chart[:, 1]))
    arm = np.exp(1j * pose[2]) * a.arm[:, None]
    violation = clamps_and_forces(s)[1][:, None] + tip - pose[0] - 1j * pose[1] - arm
    residual = [
        violation.real,
        violation.imag,
        *(wrench(force, arm) - np.append(s.load, 0.0)[:3, None])[:p],
    ]
    matrix = np.zeros((pose.shape[1], 2 * k + p, 2 * k + p))
    for i in range(k):
        own = slice(2 * i, 2 * i + 2)
        matrix[:, i, own], matrix[:, k + i, own] = tips[i].real.T, tips[i].imag.T
        matrix[:, 2 * k :, own] = np.moveaxis(
            wrench(forces[i][None], arm[i][None, None])[:p], -1, 0
        )
    matrix[:, :k, 2 * k] = matrix[:, k : 2 * k, 2 * k + 1] = -1.0
    if p == 3:
        matrix[:, :k, -1], matrix[:, k : 2 * k, -1] = arm.imag.T, -arm.real.T
        matrix[:, -1, -1] = -(arm.conj() * force).real.sum(axis=0)
    return np.concatenate([np.atleast_2d(row) for row in residual]).T, matrix


def wrench(force: Complex, arm: Complex) -> Array:
    """Sums (3, ...) of the forces (k, ...) and of their moments about P."""
    return np.stack(
        [force.real.sum(axis=0), force.imag.sum(axis=0), (arm.conj() * force).imag.sum(axis=0)]
    )


def solve_starts(s: RodState, chart: Array, pose: Array) -> tuple[Array, Array]:
    """Charts (k, 2, m) and poses (3, m) to which the starts lead that converge."""
    k, p = s.assembly.rods, s.assembly.dof
    x = np.concatenate([chart.reshape(2 * k, -1), pose[:p]])
    active, converged = np.arange(x.shape[1]), np.zeros(x.shape[1], bool)
    for _ in range(MAX_START_STEPS):
        step = solve_linear(*newton_system(s, *split_unknowns(x[:, active], k))).T
        size = step_lengths(s, x[:, active], step).max(axis=0)
        x[:, active] -= step / np.maximum(size, 1.0)
        x[: 2 * k : 2] = np.maximum(x[: 2 * k : 2], MIN_ALPHA)
        converged[active] = size < START_STEP_TOLERANCE
        active = active[np.isfinite(size) & ~converged[active] & is_in_range(x[:, active], k)]
        if not active.size:
            break
    return split_unknowns(x[:, converged], k)


def step_lengths(s: RodState, x: Array, step: Array) -> Array:
    """Lengths of Newton steps (2 k + p, n) as shares of the longest step that is allowed.

    A large alpha may change by `MAX_ALPHA_SHARE` of itself, if q changes with it so that the loops
    keep their places.  The length of a step of q is therefore that of the change of alpha - n K,
    where n K is the multiple next to the clamp and K = q + ln 2.
    """
    k = s.assembly.rods
    alpha, q = x[: 2 * k : 2], x[1 : 2 * k : 2]
    nearest = 2.0 * np.floor(0.5 * alpha / ellipkm1(1.0 / np.cosh(q) ** 2)) + 1.0
    size = np.abs(step) / MAX_START_STEP
    size[2 * k : 2 * k + 2] /= s.assembly.scale[0]
    size[1 : 2 * k : 2] = np.abs(step[: 2 * k : 2] - nearest * np.sign(q) * step[1 : 2 * k : 2])
    size[: 2 * k : 2] /= np.maximum(1.0, MAX_ALPHA_SHARE * alpha)
    return size


def is_in_range(x: Array, k: int) -> NDArray[np.bool_]:
    """Whether alpha and q of all rods are in the range in which their loads can be computed."""
    return np.asarray((np.abs(x[: 2 * k]) < MAX_ITERATE).all(axis=0))


def split_unknowns(x: Array, k: int) -> tuple[Array, Array]:
    """Charts (k, 2, n) and poses (3, n) from the vector of unknowns; the phi of a pin is zero."""
    pose = np.zeros((3, x.shape[1]))
    pose[: len(x) - 2 * k] = x[2 * k :]
    return x[: 2 * k].reshape(k, 2, -1), pose


def solve_linear(right: Array, matrix: Array) -> Array:
    """Solutions of a batch of linear systems; NaN where a matrix is singular."""
    good = np.flatnonzero(np.isfinite(matrix).all(axis=(1, 2)))
    good = good[np.abs(np.linalg.det(matrix[good])) > SINGULAR_DETERMINANT]
    out = np.full_like(right, np.nan)
    out[good] = np.linalg.solve(matrix[good], right[good][..., None])[..., 0]
    return out


def count_negative(s: RodState, chart: Array, pose: Array) -> NDArray[np.int_]:
    r"""Number of negative eigenvalues (n,) of the potential's second variation.

    By Sturm's theorem a rod under its dead load alone has as many as Jacobi's field has zeros: one
    between any two inflections, and one more if the field has changed its sign since the last
    inflection.  If the tip is pinned, the negative eigenvalues of its stiffness K_i are subtracted;
    the platform adds those of the whole stiffness::

        negative = sum_i [mode_i - 1 + (y_i passed zero) - neg(K_i)] + neg(sum A_i^T K_i A_i + ...)

    since the inertia of a bordered matrix is that of its block and of the Schur complement.
    """
    a, found = s.assembly, rods_of_chart(chart[:, 0], chart[:, 1])
    _, force, tips, forces = rotate_rods(s, found)
    own = np.floor(found.waves)
    own += (-1.0) ** own * found.field < 0.0
    arm = np.exp(1j * pose[2]) * a.arm[:, None]
    whole, pinned = np.zeros((pose.shape[1], a.dof, a.dof)), 0
    for i in range(a.rods):
        move, pull = (
            np.stack([slope.real, slope.imag]).T.swapaxes(1, 2) for slope in (tips[i], forces[i])
        )
        stiff = pull @ np.linalg.inv(move)
        pinned = pinned + (np.linalg.eigvalsh(stiff) < 0.0).sum(axis=-1)
        lever = np.zeros((pose.shape[1], 2, 3))
        lever[:, 0, 0] = lever[:, 1, 1] = 1.0
        lever[:, 0, 2], lever[:, 1, 2] = -arm[i].imag, arm[i].real
        lever = lever[..., : a.dof]
        whole += lever.swapaxes(1, 2) @ stiff @ lever
    if a.dof == 3:
        whole[:, 2, 2] -= (arm.conj() * force).real.sum(axis=0)
    total = own.sum(axis=0) - pinned + (np.linalg.eigvalsh(whole) < 0.0).sum(axis=-1)
    return np.asarray(total, int)


SOLUTION_TOLERANCE = 1e-6  # largest difference of tips, loads and moments of one equilibrium
MIN_LATTICE_POSES = 2000  # least number of poses of the lattice
MAX_LATTICE_ALPHA = 20.0  # alpha up to which starts are taken from the lattice of poses
MIN_DRAWN_ALPHA = 12.0  # alpha from which starts are drawn if loads may exceed `MAX_LATTICE_ALPHA`


@dataclass(frozen=True)
class LoadBound:
    """The bound of the loads of all equilibria, which is computed when it is first used.

    Attributes
    ----------
    state : RodState
        Inputs and loads.
    modes : sequence of int
        Largest number of inflections of each rod.
    """

    state: RodState
    modes: Sequence[int]

    @cached_property
    def alpha(self) -> float:
        """alpha [1] that no rod exceeds, by `theoretical_bound`."""
        return theoretical_bound(self.state, self.modes)


@dataclass(frozen=True)
class Solutions:
    """Equilibria (n,) of one assembly of k rods, the lowest potential first.

    Attributes
    ----------
    state : RodState (n,)
        Poses, loads and clamp moments.
    modes : ndarray (n, k)
        Inflections of each rod, its tip included.
    psi, k_rel : ndarray (n, k)
        Direction of its load from the clamp's tangent [rad] and relative modulus, as in `tip`.
    potential : ndarray (n,)
        V = sum U_i - F.P - M phi [J].
    negative : ndarray (n,)
        Number of directions in which V falls; 0 is stable.
    alpha, complement : ndarray (n, k)
        L sqrt(R/EI) of each rod [1], and k' = sqrt(1 - k^2) of its modulus, which is still accurate
        where k_rel is 1 in double precision, for alpha beyond about 18.
    up_to : float
        The largest alpha [1] of the search; the equilibria are those up to there.
    load_bound : LoadBound
        Computes `Solutions.bound`.
    """

    state: RodState
    modes: NDArray[np.int_]
    psi: Array
    k_rel: Array
    potential: Array
    negative: NDArray[np.int_]
    alpha: Array
    complement: Array
    up_to: float
    load_bound: LoadBound

    @property
    def bound(self) -> float:
        """alpha [1] that no rod of any equilibrium with these modes exceeds; inf without a proof.

        It is computed when it is first used, which takes as long as a small search.
        """
        return self.load_bound.alpha

    @property
    def is_bounded(self) -> bool:
        """Whether it is proven that no equilibrium has larger loads than those of the search."""
        return bool(self.up_to >= self.bound)

    def __len__(self) -> int:
        return self.potential.size


def solutions(
    a: Assembly,
    *,
    inputs: ArrayLike = 0.0,
    load: ArrayLike = 0.0,
    modes: int | Sequence[int] = 1,
    most_load: float | None = None,
    poses: int = MIN_LATTICE_POSES,
) -> Solutions:
    r"""All equilibria whose rods have up to given numbers of inflections.

    ::

         O1 |/______.  P  .______\| O2      equilibrium manifold of a rod with a pinned tip:
                     `o.-'                  smooth, with coordinates alpha and gamma of the load
                      |                     on the tip and the angle of the tip to it,
                      v F                   R = alpha^2 EI/L^2, k = cos(gamma/2)

        2 k equations O_i + tip_i = P + Rot(phi) r_i,  p of balance,  2 k + p unknowns

    Triangles of this manifold give all shapes of a rod that reach its pin in a pose.  At each pose
    of a lattice, each choice of one shape for each rod whose first Newton step is short is a start
    of Newton's method.  Where loads may exceed alpha = 20, straight rods with loops are drawn at
    random as further starts.

    Parameters
    ----------
    a : Assembly, of k rods without rigid ends
    inputs : of the motors [rad] or along the guides [m], (k,)
    load : dead force [N] on the platform at its origin, and moment [N m] if it is no pin, (p,)
    modes : largest mode of each rod, or of all
    most_load : largest alpha = L sqrt(R/EI) of any rod [1], from 1 to 340; None: the bound of
        `theoretical_bound`, or 20 if there is none
    poses : least number of poses of the lattice

    Returns
    -------
    Solutions

    Raises
    ------
    ValueError
        A mode, a load or a number out of its domain; rods with rigid ends.

    Notes
    -----
    Equilibria are closed and balanced to 1e-12 of L and EI/L^2 at small loads.  The manifold has
    no gap where modes meet, so a rod with m0 = 0 is found.  Platforms are never mirrored, since the
    pins follow from the pose.  A rod that is exactly straight, or without any load, is on the
    boundary of the chart and is not found.

    Loads are proven to be bounded unless stretched rods can pull the platform tight against each
    other.  `Solutions.bound` is the bound, and `Solutions.is_bounded` tells whether the search went
    as far.  For Table 8 the bound is alpha = 52 for modes to 1 and 104 for modes to 2, for the
    program's 3PFR 18 and 36.

    Completeness below the bound is tested, not proven.  Up to alpha = 20 the number of equilibria
    is the same for lattices of 1500, 2000, 6000 and 10,000 poses and for a mesh of 0.05 L instead
    of 0.08 L, and 20,000 random starts without lattice or mesh find no other: 34 for Table 7 and
    modes up to 3 (all up to the bound), 10 for Table 8 and 56 for the program's 3PFR and modes up
    to 2.  With 500 poses one of the 34 and two of the 56 are missed.  Beyond alpha = 20, starts are
    drawn at random (`tight_poses`), which finds 57 more for Table 8 and one more for the 3PFR; ten
    times as many starts from another seed find the same.

    `RodState.energy`, `RodState.shape` and `closure` integrate from the clamp, where an error grows
    by up to e^alpha; beyond an alpha of 25 they are inaccurate.  Poses, loads, moments, potential
    and stability come from the closed form and are accurate for every alpha.

    Source: Pérez Gámiz 2018, eqs 103-105 and 113-115 and text lines 1149-1161, searches a grid of
    (psi, k_rel), 42 n^3 nodes of the 3PFR in 985 to 17,241 s (Table 2), for given modes.  This
    module differs from it in the chart, the elimination and the closure, which in the source
    accepts mirrored platforms.  Its Table 7 (two solutions) and Table 8 (two) are incomplete.

    Examples
    --------
    >>> from proofmass.analytic.rods.assembly import assembly
    >>> pair = assembly([[-0.3, 0.0], [0.3, 0.0]], stiffness=0.052186)
    >>> found = solutions(pair, inputs=np.radians([40.0, 60.0]), load=[0.3, -0.1])
    >>> found.state.pose.round(3).tolist()
    [[0.622, -0.242], [0.293, -0.341], [-0.081, -0.246]]
    >>> found.is_bounded, round(found.up_to)
    (True, 9)
    """
    given = state(a, inputs=inputs, load=load)
    max_modes = check_arguments(given, modes, most_load, poses)
    load_bound = LoadBound(given, max_modes)
    if most_load is None:
        cap = load_bound.alpha if np.isfinite(load_bound.alpha) else MAX_LATTICE_ALPHA
    else:
        cap = min(most_load, theoretical_bound(given, max_modes, most_load))
    batches = list(lattice_starts(given, max_modes, min(cap, MAX_LATTICE_ALPHA), poses))
    if cap > MAX_LATTICE_ALPHA:
        batches.append(draw_starts(given, max_modes, MIN_DRAWN_ALPHA, cap))
    found = [solve_starts(given, *start) for start in batches]
    chart, pose = (np.concatenate(part, axis=-1) for part in zip(*found, strict=True))
    pose[2] = (pose[2] + np.pi) % TURN - np.pi
    found_rods = rods_of_chart(chart[:, 0], chart[:, 1])
    within = (found_rods.waves < np.array(max_modes)[:, None]) & (chart[:, 0] <= cap)
    kept = distinct_solutions(given, chart, pose, np.flatnonzero(within.all(axis=0)))
    return describe_solutions(given, chart[..., kept], pose[:, kept], cap, load_bound)


def check_arguments(
    s: RodState, modes: int | Sequence[int], most_load: float | None, poses: int
) -> list[int]:
    """The largest mode of each rod; ValueError for arguments that `solutions` does not accept."""
    max_modes = (
        np.broadcast_to(modes, s.assembly.rods)
        if np.size(modes) in (1, s.assembly.rods)
        else np.zeros(1)
    )
    if not (np.all(max_modes >= 1) and np.all(max_modes == np.rint(max_modes))):
        raise ValueError(
            f"modes must be 1, 2 .. for all or for each of {s.assembly.rods} rods, got {modes!r}"
        )
    if most_load is not None and not 1.0 <= most_load <= MAX_ITERATE:
        raise ValueError(f"most_load must lie within [1, {MAX_ITERATE:g}], got {most_load}")
    if not 1 <= poses <= 1_000_000:
        raise ValueError(f"poses must lie within [1, 1000000], got {poses}")
    if s.assembly.rigid_extension.any():
        raise ValueError(
            "rods must have no rigid ends: their tips would carry a moment, got "
            f"rigid_extension {s.assembly.rigid_extension.tolist()}"
        )
    if s.vector.ndim != 1:
        raise ValueError(f"inputs and load must be those of one problem, got {s.vector.shape}")
    return [int(mode) for mode in max_modes]


def distinct_solutions(
    s: RodState, chart: Array, pose: Array, which: NDArray[np.intp]
) -> NDArray[np.intp]:
    """Indices of one solution of each group with the same tips, loads and clamp moments."""
    found = rods_of_chart(*np.moveaxis(chart[..., which], 1, 0))
    size = 1.0 + np.abs(found.force)
    features = np.concatenate(
        [
            found.tip.real,
            found.tip.imag,
            found.force.real / size,
            found.force.imag / size,
            found.moment / size,
        ]
    ).T
    _, first = np.unique((features / SOLUTION_TOLERANCE).round(), axis=0, return_index=True)
    apart: list[int] = []
    for i in first:  # equal solutions that rounding to a grid has separated
        if (
            not apart
            or np.abs(features[apart] - features[i]).max(axis=1).min() > SOLUTION_TOLERANCE
        ):
            apart.append(int(i))
    return which[apart]


def describe_solutions(
    s: RodState, chart: Array, pose: Array, up_to: float, load_bound: LoadBound
) -> Solutions:
    """Equilibria of these charts and poses, with the parameters of Pérez Gámiz 2018."""
    a, found = s.assembly, rods_of_chart(chart[:, 0], chart[:, 1])
    force = rotate_rods(s, found)[1].T
    energy = ((a.stiffness / a.length)[:, None] * found.energy).sum(axis=0)
    potential = energy - s.load @ pose[: a.dof]
    order = np.argsort(potential)
    states = state(
        a,
        inputs=s.inputs,
        load=s.load,
        pose=pose[: a.dof].T,
        moment=(a.stiffness / a.length) * found.moment.T,
        force=np.stack([force.real, force.imag], axis=-1),
    )
    psi = -np.angle(found.delta) % TURN
    k = np.copysign(np.tanh(chart[:, 1]), found.moment)
    return Solutions(
        states[order],
        (np.floor(found.waves).astype(int) + 1).T[order],
        psi.T[order],
        relative_in_range(*bounds_in_range(psi), k).T[order],
        potential[order],
        count_negative(s, chart, pose)[order],
        chart[:, 0].T[order],
        (1.0 / np.cosh(chart[:, 1])).T[order],
        up_to,
        load_bound,
    )
