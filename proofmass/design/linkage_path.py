"""Search for linkages whose coupler point passes through given points, in their order.

The unknowns are the parameters of a linkage, and the crank angle at each point unless the table
gives it.  Descents of the Levenberg-Marquardt method begin at random linkages whose crank turns
fully, at random rising crank angles.  For given ratios of lengths and given angles the points are
linear in three complex numbers, the pivot, the crank and the arm of the coupler point::

    point = pivot + crank exp(i angle) + arm exp(i coupler angle),   angles from ground or guide

so that the size, the place and the coupler point of a start are the best ones for its ratios.  A
step solves for the parameters alone: each crank angle acts on one point only, and is eliminated.
That the crank turns fully, and the transmission angle, are penalties in the descents.  The best
ones are refined by `scipy.optimize.least_squares` with the steps between the crank angles as
unknowns, so that their order is a bound, and the penalties as sharp as rounding allows.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from proofmass.analytic.numerics import TURN
from proofmass.base.arrays import Array, Complex
from proofmass.design.coupler_curves import CurveKind, assemble_designs, margin_slopes
from proofmass.design.path_points import PathPoints
from proofmass.design.search import (
    DAMPING_FACTORS,
    Effort,
    SavedSearch,
    SearchState,
    Trials,
    distinct_places,
)

LENGTH_SHARES = (0.05, 3.0)  # usual bounds of lengths over the size of the path [1]
PLACE_BOUND = 3.0  # usual bound of pivots and of the coupler point over the size of the path [1]
ANGLE_BOUND = 3.0 * TURN  # of crank angles and directions [rad]: far from where descents go
DRAWS = 32  # random linkages for each descent, of which it begins at the best
RIDGE = 1e-6
"""Weight of the squares of crank and arm in the fit of a start [1]; without it a start whose
coupler hardly turns against its crank has arms of any length."""
SHARPNESS = (30.0, 1e6)
"""Weights of penalties over the size of the path [1], in the descents and in the refinement."""
SAFETY = 1e-9
"""Least margin over the size of the path [1]: more than a refined penalty gives way, 1e-12."""
LEAST_STIFFNESS = 1e-15  # added to squares of slopes [1], so that none is zero
DISTINCT = 4e-3  # [1] places nearer than this to a better place are not continued
REFINED = 12  # descents of each search that are refined
FINISHED = 3  # of these, the best are refined to the end
REFINED_STEPS = (1200, 12000)
"""Most evaluations times unknowns in a refinement, and in one to the end; descents stop near their
minimum, and an evaluation with twice the unknowns takes more than twice as long."""
FEWEST_STEPS = 20  # evaluations of a refinement, however many unknowns it has
PATH_EFFORT = Effort(((512, 30), (96, 60), (24, 120)))
"""Usual effort of the search of one kind in one assembly mode and one sense of the crank."""


@dataclass(frozen=True)
class PathTask:
    """A path, and the linkages of one kind and one sense of the crank that may follow it.

    Attributes
    ----------
    path : PathPoints
    kind : CurveKind
    sense : int
        1 if the crank angle rises from point to point, -1 if it falls.
    bounds : tuple of (str, (float, float))
        Bounds of parameters [m, rad]; also of ``start_angle``, the crank angle at the first point,
        and of ``other_x`` and ``other_y``, the rocker's pivot.
    transmission : float
        Least angle of the transmission angle from 0 and from pi [rad].
    """

    path: PathPoints
    kind: CurveKind
    sense: int = 1
    bounds: tuple[tuple[str, tuple[float, float]], ...] = ()
    transmission: float = 0.0

    @property
    def fingerprint(self) -> str:
        """A text that differs between any two tasks."""
        return repr(
            (
                self.path.fingerprint,
                type(self.kind).__name__,
                self.kind.mode,
                self.sense,
                sorted(self.bounds),
                self.transmission,
            )
        )

    @property
    def given_angles(self) -> bool:
        """Whether the table gives the crank angles."""
        return self.path.angles is not None

    @cached_property
    def shape_count(self) -> int:
        """Number of parameters of a linkage."""
        return len(self.kind.names)

    @property
    def angle_count(self) -> int:
        """Number of crank angles that are unknown: all, that at the first point, or none."""
        if self.path.angles is None:
            return self.path.points.size
        return 1 if self.path.angles_from == "first" else 0

    @cached_property
    def box(self) -> Array:
        """Lower and upper bounds of all unknowns (2, d)."""
        size, centre = self.path.size, complex(self.path.points.mean())
        usual = {
            "pivot_x": (centre.real - PLACE_BOUND * size, centre.real + PLACE_BOUND * size),
            "pivot_y": (centre.imag - PLACE_BOUND * size, centre.imag + PLACE_BOUND * size),
            "ground_angle": (-ANGLE_BOUND, ANGLE_BOUND),
            "guide_angle": (-ANGLE_BOUND, ANGLE_BOUND),
            **dict.fromkeys(
                ("point_along", "point_across", "offset"), (-PLACE_BOUND * size, PLACE_BOUND * size)
            ),
        }
        length = LENGTH_SHARES[0] * size, LENGTH_SHARES[1] * size
        given = dict(self.bounds)
        limits = [given.get(name, usual.get(name, length)) for name in self.kind.names]
        start = given.get("start_angle", (-ANGLE_BOUND, ANGLE_BOUND))
        later = [(-2.0 * ANGLE_BOUND, 2.0 * ANGLE_BOUND)] * (self.angle_count - 1)
        return np.array([*limits, *[start, *later][: self.angle_count]]).T

    @property
    def low(self) -> Array:
        """Lower bounds."""
        return np.asarray(self.box[0])

    @property
    def high(self) -> Array:
        """Upper bounds, a little above the lower ones where a parameter is fixed."""
        return np.maximum(self.box[1], self.box[0] + 1e-12 * (1.0 + np.abs(self.box[0])))

    @cached_property
    def free(self) -> NDArray[np.bool_]:
        """Which unknowns are not fixed by their bounds (d,)."""
        return np.asarray(self.box[1] > self.box[0], bool)

    @cached_property
    def other_box(self) -> list[tuple[int, float, float]]:
        """Sign and bound of the rocker's pivot: part (0 for x, 1 for y), sign and bound."""
        given, found = dict(self.bounds), []
        for part, name in enumerate(("other_x", "other_y")):
            if name in given:
                low, high = given[name]
                found += [(part, 1.0, low), (part, -1.0, -high)]
        return found

    def angles(self, vectors: Array) -> Array:
        """Crank angles at the points (B, N) [rad]."""
        k = self.shape_count
        if self.path.angles is None:
            return vectors[:, k:]
        if self.path.angles_from == "first":
            return np.asarray(vectors[:, k:] + (self.path.angles - self.path.angles[0]))
        origin = vectors[:, 2:3] if self.path.angles_from == "ground" else 0.0 * vectors[:, :1]
        return np.asarray(origin + self.path.angles)

    def slopes(self, vectors: Array) -> tuple[Complex, Complex]:
        """Derivatives of the points by the shared unknowns (B, N, s) and by own angles (B, N).

        The latter are zero where the table gives the angles.
        """
        designs = vectors[:, : self.shape_count]
        by_design, by_angle = self.kind.slopes(designs, self.angles(vectors))
        if not self.given_angles:
            return by_design, by_angle
        if self.path.angles_from == "ground":
            by_design[..., 2] += by_angle
        if self.path.angles_from == "first":
            by_design = np.concatenate([by_design, by_angle[..., None]], axis=-1)
        return by_design, np.zeros_like(by_angle)

    def margins(self, designs: Array) -> Array:
        """All margins (B, h) [m] that must not be negative."""
        found = [self.kind.margins(designs, self.transmission)]
        if self.other_box:
            x, y, g, d = designs[:, 0], designs[:, 1], designs[:, 2], designs[:, 6]
            places = x + d * np.cos(g), y + d * np.sin(g)
            found += [
                (sign * places[part] - bound)[:, None] for part, sign, bound in self.other_box
            ]
        return np.concatenate(found, axis=1)

    def penalties(self, designs: Array, sharpness: float) -> Array:
        """Terms of the sum of squares (B, h) for margins that are too small."""
        size = self.path.size
        missing = np.maximum(SAFETY * size - self.margins(designs), 0.0)
        return np.asarray(sharpness * missing / size)

    def penalty_slopes(self, designs: Array, sharpness: float) -> Array:
        """Derivatives of `penalties` by the parameters (B, h, k)."""
        found = [margin_slopes(self.kind, designs, self.transmission)]
        g, d = designs[:, 2], designs[:, 6] if self.other_box else designs[:, 2]
        for part, sign, _ in self.other_box:
            row = np.zeros((len(designs), 1, self.shape_count))
            row[:, 0, part] = sign
            row[:, 0, 2] = sign * d * (np.cos(g) if part else -np.sin(g))
            row[:, 0, 6] = sign * (np.sin(g) if part else np.cos(g))
            found.append(row)
        acts = self.margins(designs) < SAFETY * self.path.size
        return np.asarray(
            -sharpness / self.path.size * acts[..., None] * np.concatenate(found, axis=1)
        )

    def deviations(self, vectors: Array) -> Complex:
        """Weighted distances from the points over the size of the path, x + iy (B, N) [1]."""
        found = self.kind.points(vectors[:, : self.shape_count], self.angles(vectors))
        return np.asarray((found - self.path.points) * self.path.weights / self.path.size)

    def residuals(self, vectors: Array) -> Array:
        """All terms of the sum of squares (B, m)."""
        off = self.deviations(vectors)
        barred = self.penalties(vectors[:, : self.shape_count], SHARPNESS[0])
        return np.concatenate([off.real, off.imag, barred], axis=1)

    coarse = residuals

    def start_angles(self, count: int, rng: np.random.Generator) -> Array:
        """Random crank angles at the points (count, N), in order [rad]."""
        first = rng.uniform(-np.pi, np.pi, (count, 1))
        if self.path.angles is not None:
            first = first if self.path.angles_from == "first" else np.zeros((count, 1))
            start = self.path.angles[0] if self.path.angles_from == "first" else 0.0
            return np.asarray(first + (self.path.angles - start))
        chords = np.abs(np.diff(self.path.points))
        power, spread = rng.choice([0.0, 0.5, 1.0], (count, 1)), rng.choice([0.1, 0.5], (count, 1))
        steps = chords**power * np.exp(spread * rng.normal(size=(count, chords.size)))
        whole = rng.uniform(0.15, 1.0, (count, 1))
        if self.path.closed:
            whole = np.full((count, 1), self.path.closing_share)
        steps *= whole * TURN / steps.sum(axis=1, keepdims=True)
        return np.concatenate([first, first + self.sense * np.cumsum(steps, axis=1)], axis=1)

    def starts(self, count: int, rng: np.random.Generator) -> Array:
        """The best of random designs (count, d), by their distances from the points."""
        found, values = np.empty((0, self.low.size)), np.empty(0)
        for _ in range(DRAWS):
            tried = self.random_vectors(count, rng)
            size = np.linalg.norm(self.residuals(tried), axis=1)
            found, values = np.concatenate([found, tried]), np.concatenate([values, size])
            best = np.argsort(values, kind="stable")[:count]
            found, values = found[best], values[best]
        return found

    def random_vectors(self, count: int, rng: np.random.Generator) -> Array:
        """Random designs (count, d) whose size, place and coupler point suit the points best."""
        shapes = self.kind.random_shapes(count, rng, self.transmission)
        angles = self.start_angles(count, rng)
        turned = angles
        if self.path.angles_from == "x":
            turned = angles - rng.uniform(-np.pi, np.pi, (count, 1))
        basis = self.kind.basis(shapes, turned)
        fit = fit_points(np.exp(1j * turned), basis, self.path.points, self.path.size)
        designs = assemble_designs(shapes, fit)
        if self.path.angles_from == "x":
            designs[:, 2] = (angles - turned)[:, 0]
        vectors = np.concatenate([designs, (turned + designs[:, 2:3])[:, : self.angle_count]], 1)
        return np.clip(vectors, self.low, self.high)

    def linearize(self, vectors: Array) -> tuple[Array, Array, Array, Array]:
        """Terms (B, 2 N + h), their slopes by the shared unknowns (B, .., s), and those of angles.

        The last two are the terms of the points (B, N, 2) and their slopes by their own crank
        angles (B, N, 2), which are zero where the table gives the angles.
        """
        designs, scale = vectors[:, : self.shape_count], self.path.weights / self.path.size
        shared, own = self.slopes(vectors)
        shared, own, off = shared * scale[:, None], own * scale, self.deviations(vectors)
        barred = self.penalty_slopes(designs, SHARPNESS[0])
        barred = np.pad(barred, ((0, 0), (0, 0), (0, shared.shape[-1] - barred.shape[-1])))
        return (
            self.residuals(vectors),
            np.concatenate([shared.real, shared.imag, barred], axis=1),
            np.stack([off.real, off.imag], axis=-1),
            np.stack([own.real, own.imag], axis=-1),
        )

    def trial_places(self, places: Array, damping: Array) -> Array:
        """Places (B, F, d) after steps with all factors of the damping, as in a search."""
        span = self.high - self.low
        r, shared, off, own = self.linearize(self.low + places * span)
        s = shared.shape[-1]
        shared = shared * span[:s]
        gradient = np.einsum("bmk,bm->bk", shared, r)
        free = self.free[:s] & ~(
            ((places[:, :s] <= 0.0) & (gradient > 0.0))
            | ((places[:, :s] >= 1.0) & (gradient < 0.0))
        )
        grown = 1.0 + damping[:, None] * DAMPING_FACTORS
        if self.given_angles:
            matrix, right = normal_equations(shared, gradient, grown)
            steps = solve_free(matrix, right, free)
        else:
            steps = steps_with_own_angles(shared, gradient, off, own * span[s:, None], grown, free)
        return np.clip(places[:, None] + steps, 0.0, 1.0)


def normal_equations(shared: Array, gradient: Array, grown: Array) -> tuple[Array, Array]:
    """Matrices (B, F, s, s) with the diagonal times `grown` (B, F), and right sides (B, F, s)."""
    curvature = np.einsum("bmk,bml->bkl", shared, shared)
    diagonal = np.einsum("bkk->bk", curvature) + LEAST_STIFFNESS
    added = (grown - 1.0)[..., None, None] * diagonal[:, None, :, None] * np.eye(shared.shape[-1])
    return curvature[:, None] + added, np.repeat(-gradient[:, None], grown.shape[1], axis=1)


def solve_free(matrix: Array, right: Array, free: NDArray[np.bool_]) -> Array:
    """Solutions (B, F, s) in which unknowns that are not free (B, s) are zero."""
    keep = free[:, None, :, None] & free[:, None, None, :]
    fixed = np.where(free, 0.0, 1.0)[:, None, :, None] * np.eye(free.shape[1])
    return np.asarray(
        np.linalg.solve(np.where(keep, matrix, 0.0) + fixed, (right * free[:, None])[..., None])[
            ..., 0
        ]
    )


def steps_with_own_angles(
    shared: Array,
    gradient: Array,
    off: Array,
    own: Array,
    grown: Array,
    free: NDArray[np.bool_],
) -> Array:
    """Steps (B, F, s + N) of shared unknowns and of the crank angle of each point.

    With c the product of a point's slopes by the shared unknowns and by its angle, and k the square
    of the latter, the step of an angle is -(pull + c . step)/(k grown), which leaves matrices less
    c c^T/(k grown) for the shared unknowns.
    """
    count, n = own.shape[:2]
    points = shared[:, : 2 * n].reshape(count, 2, n, -1)
    cross = np.einsum("bpnk,bnp->bnk", points, own)
    pull = np.einsum("bnp,bnp->bn", own, off)
    stiffness = np.einsum("bnp,bnp->bn", own, own) + LEAST_STIFFNESS
    inverse = 1.0 / (stiffness[:, None] * grown[..., None])
    matrix, right = normal_equations(shared, gradient, grown)
    matrix = matrix - np.einsum("bfn,bnk,bnl->bfkl", inverse, cross, cross)
    right = right + np.einsum("bfn,bnk,bn->bfk", inverse, cross, pull)
    step = solve_free(matrix, right, free)
    turned = -inverse * (pull[:, None] + np.einsum("bnk,bfk->bfn", cross, step))
    return np.concatenate([step, turned], axis=-1)


def fit_points(turns: Complex, basis: Complex, points: Complex, size: float) -> Complex:
    """Coefficients (B, 3) with which 1, `turns` and `basis` (B, N) are nearest to points (N,)."""
    columns = np.stack([np.ones_like(turns), turns, basis], axis=-1)
    adjoint = columns.conj().swapaxes(-1, -2)
    ridge = RIDGE * turns.shape[1] * np.diag([0.0, 1.0, 1.0])
    centre = points.mean()
    right = adjoint @ (points - centre)[:, None]
    found = np.linalg.solve(adjoint @ columns + ridge, right)[..., 0]
    found[:, 0] += centre
    return np.asarray(found, complex)


class PathSearch(SavedSearch):
    """A search for linkages; see `PathTask`, and `SavedSearch` for its saved state."""

    problem: PathTask

    def begin(self, start: Array | None) -> SearchState:
        """The initial state: the best of random linkages."""
        rng = np.random.default_rng(self.effort.seed)
        vectors = self.problem.starts(self.effort.heats[0][0], rng)
        return self.fresh(0, self.shares(vectors), self.terms(0))

    def choose(self, state: SearchState, most: int) -> Array:
        """The best places that are `DISTINCT` from better ones."""
        return state.places[distinct_places(state.places, state.values, most, DISTINCT)]

    def trials(self, heat: int) -> Trials:
        """The places that a step tries, with the crank angles eliminated."""
        return self.problem.trial_places

    def finish(self) -> SearchState:
        """The last state; `refine` goes on from it."""
        return replace(self.state, evaluations=self.evaluations, finished=True)
