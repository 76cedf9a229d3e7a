"""All kinds of balancers for one wanted curve, and the search over all of them at once.

A kind is a `Variant`: a number of segments, its springs, preloads and stops, and what else is free.
Designs of all kinds with the same number of segments are rows of one batch, since a batch of a
thousand balancers takes little longer than one of ten::

    row = (code of its kind, shares of all parameters between the bounds of its kind)

A parameter that is not free in a kind has equal bounds there.  A kind is narrower than another one
if each of its designs is a design of the other one as well.  Between the rounds of the search, each
kind takes over the designs of narrower kinds that are better than its own.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from itertools import product

import numpy as np
from numpy.typing import NDArray

from proofmass.analytic.balancer.measures import precision_points
from proofmass.analytic.balancer.synthesis import (
    COARSE_ELBOW_FACTOR,
    COARSE_POINTS,
    LENGTH_BOUNDS,
    MIN_ELBOW_SINE,
    PRELOADED_JOINTS,
    SPRING_KINDS,
    TRIANGLE_LENGTH,
    Variant,
    batch_moments,
    batch_slopes,
)
from proofmass.base.arrays import Array
from proofmass.design.search import (
    START_DAMPING,
    SavedSearch,
    SearchState,
    distinct_places,
    residual_norms,
    scatter_places,
)

SURVEY_POINTS = 30
"""Number of angles at which designs of all kinds are compared while they are searched."""
SURVEY_HEATS = ((8, 5), (3, 12), (1, 24))
"""Descents of each kind and their steps in each round of the search."""
ANY_TARGET = ""
"""Target of all kinds: no name of the thesis, whose figures have bounds of their own."""
MAX_DRAW_ROUNDS = 20
"""Largest number of rounds of random draws."""
DRAWS_PER_START = 3
"""Random designs that are tried for each start in a round: about a quarter of them is possible."""
NO_CONTACT = np.pi
"""Angle of the upper stop of a joint without one [rad], in the vector of a design."""
FIT_ROUNDING = 1e-12
"""Distance beyond a bound that is rounding [SI]."""


def all_kinds(
    segments: Sequence[int] = tuple(LENGTH_BOUNDS),
    springs: Sequence[str] = SPRING_KINDS,
    extension: tuple[float, float] = (0.0, 0.0),
    narrowed: Mapping[str, tuple[float, float]] | None = None,
) -> list[Variant]:
    """All kinds of balancers, both ways of the elbow included, with the same bounds in each kind.

    Bounds of `narrowed` hold for those kinds that have the parameter.  A kind for which they are
    impossible is left out.  ValueError if no kind has a parameter, or none is left.

    >>> [len(all_kinds([n])) for n in (2, 3, 4)]
    [2, 144, 192]
    """
    narrowed, found = narrowed or {}, []
    known = set[str]()
    for n in segments:
        if n not in PRELOADED_JOINTS:
            raise ValueError(f"segments must be 2, 3 or 4, got {n}")
        preloads = PRELOADED_JOINTS[n]
        either = (False, True) if n > 2 else (False,)
        wide = (False, True) if n > 2 or any(extension) else (False,)
        elbows = (1, -1) if n > 2 else (1,)
        for spring, preload, angle, contact, relaxed, mode in product(
            springs, preloads, either, either, wide, elbows
        ):
            if n == 2 and spring == "nonlinear" and "each" in springs and not any(extension):
                continue  # one spring alone: the same as each
            plain = Variant(
                ANY_TARGET, n, spring, preload, angle, contact, relaxed, mode, extension
            )
            known |= set(plain.usual)
            own = {name: pair for name, pair in narrowed.items() if name in plain.usual}
            try:
                found.append(replace(plain, narrowed=own))
            except ValueError:
                continue
    if unknown := [name for name in narrowed if name not in known]:
        raise ValueError(
            f"bound of {unknown[0]!r}: no kind has such a parameter; there are "
            f"{', '.join(sorted(known))}"
        )
    if not found:
        raise ValueError("no kind of balancer is possible with these bounds")
    return found


def is_narrower(one: Variant, other: Variant) -> bool:
    """Whether each design of a kind is a design of another kind, which is not the same.

    >>> linear = Variant("sine")
    >>> is_narrower(linear, Variant("sine", springs="each", free_angle=True))
    True
    >>> is_narrower(linear, Variant("sine", springs="nonlinear"))
    False
    """
    return (
        one != other
        and (one.segments, one.mode) == (other.segments, other.mode)
        and (one.springs == other.springs or other.springs == "each")
        and set(one.preload) <= set(other.preload)
        and one.free_angle <= other.free_angle
        and one.contact <= other.contact
        and one.relaxed <= other.relaxed
    )


SHARE_STEP = 1e-7
"""Change of a parameter for differences of closed formulas, as a share of the distance of its
bounds: the root of the rounding."""


def parameter_names(segments: int) -> list[str]:
    """Names of the parameters that any kind with a number of segments may have free."""
    joints = range(1, segments + 1)
    return [
        *(f"{name}{i}" for name in ("stiffness", "quadratic") for i in joints),
        *(f"preload{i}" for i in (2, 3) if i <= segments and segments > 2),
        *(f"length{i}" for i in joints),
        *(("rest_angle", "high2") if segments > 2 else ()),
    ]


class KindsProblem:
    """The error of designs of several kinds with one number of segments, as rows of one batch.

    Parameters
    ----------
    variants : sequence of Variant
        Kinds with one number of segments.
    target : callable
        Target moment [N m] at pendulum angles [rad], for m g r = 1 N m.
    points : int
        Number of points j 90/points degrees.

    Notes
    -----
    A row (1 + D,) lies in the unit cube: the code of its kind, and the shares of the D parameters
    of `parameter_names`.
    """

    def __init__(
        self,
        variants: Sequence[Variant],
        target: Callable[[Array], Array],
        points: int = SURVEY_POINTS,
    ):
        self.variants, self.target, self.angle = list(variants), target, precision_points(points)
        self.segments = variants[0].segments
        self.names = parameter_names(self.segments)
        bounds = np.array([[kind_bounds(v)[name] for name in self.names] for v in variants])
        self.lowest, self.highest = bounds[..., 0], bounds[..., 1]
        self.low, self.high = np.zeros(1 + len(self.names)), np.ones(1 + len(self.names))
        self.shares_spring = np.array([v.springs == "nonlinear" for v in variants])
        self.modes = np.array([float(v.mode) for v in variants])
        self.contact = np.array([v.contact for v in variants])
        self.stops = {
            i: np.array([preload_side(v, i) for v in variants])
            for i in (2, 3)
            if f"preload{i}" in self.names
        }

    @property
    def fingerprint(self) -> str:
        """Text that distinguishes this search from any other."""
        wanted = np.asarray(self.target(self.angle), float).tolist()
        return repr((self.variants, wanted))

    def codes(self, kind: NDArray[np.int_]) -> Array:
        """The first coordinates of rows by the numbers of their kinds."""
        return (kind + 0.5) / len(self.variants)

    def kind_numbers(self, rows: Array) -> NDArray[np.int_]:
        """Numbers of the kinds of rows."""
        return np.floor(rows[:, 0] * len(self.variants)).astype(int)

    def designs(self, rows: Array) -> Array:
        """Values (B, D) [SI] of the parameters of rows."""
        kind = self.kind_numbers(rows)
        low, high = self.lowest[kind], self.highest[kind]
        return np.clip(low + rows[:, 1:] * (high - low), low, high)

    def rows(self, kind: NDArray[np.int_], designs: Array) -> Array:
        """Rows of kinds (B,) with values of parameters (B, D) [SI], cut off at their bounds."""
        low, width = self.lowest[kind], self.highest[kind] - self.lowest[kind]
        shares = np.where(width > 0, (designs - low) / np.where(width > 0, width, 1.0), 0.0)
        return np.column_stack([self.codes(kind), np.clip(shares, 0.0, 1.0)])

    def parameters(self, kind: NDArray[np.int_], designs: Array) -> dict[str, Array]:
        """Parameters (B,) of `proofmass.analytic.balancer.solve`."""
        found = dict(zip(self.names, designs.T, strict=True))
        shared = self.shares_spring[kind]
        for name in ("stiffness", "quadratic"):
            for i in range(2, self.segments + 1):
                if not self.variants[0].is_rigid:
                    found[f"{name}{i}"] = np.where(shared, found[f"{name}1"], found[f"{name}{i}"])
        for i, side in self.stops.items():
            found[f"low{i}"] = np.where(side[kind] > 0, 0.0, -np.inf)
            found[f"high{i}"] = np.where(side[kind] < 0, 0.0, np.inf)
        if "high2" in self.names:
            contact, at = self.contact[kind], designs[:, self.names.index("high2")]
            found["high2"] = np.where(contact, at, found["high2"])
        if any(self.variants[0].extension):
            for i, given in enumerate(self.variants[0].extension, 1):
                found[f"extension{i}"] = np.full(len(kind), given)
        return found | {"mode": self.modes[kind]}

    def fits(self, designs: Sequence[Mapping[str, float]]) -> NDArray[np.bool_]:
        """Whether each kind (K,) has each of the designs (B,), which are given by parameters."""
        absent = dict.fromkeys(self.names, 0.0) | {"high2": NO_CONTACT}
        given = np.array([[one.get(k, absent[k]) for k in self.names] for one in designs])
        springs = [[k for k in self.names if k.startswith(s)] for s in ("stiffness", "quadratic")]
        equal = np.array(
            [all(len({one.get(k, 0.0) for k in each}) == 1 for each in springs) for one in designs]
        )
        shared = self.shares_spring & (self.segments > 2)
        others = np.isin(self.names, [k for each in springs for k in each[1:]])
        low, high = self.lowest[:, None] - FIT_ROUNDING, self.highest[:, None] + FIT_ROUNDING
        inside = (given >= low) & (given <= high) | (shared[:, None] & others)[:, None]
        found = inside.all(axis=-1) & (equal | ~shared[:, None])
        found &= np.array([one.get("mode", 1.0) for one in designs]) == self.modes[:, None]
        for i, side in self.stops.items():
            lower = np.array([f"low{i}" in one for one in designs])
            upper = np.array([one.get(f"high{i}", 1.0) == 0.0 for one in designs])
            found &= (~lower | (side > 0)[:, None]) & (~upper | (side < 0)[:, None])
        return np.asarray(found)

    def coarse(self, rows: Array) -> Array:
        """Terms (B, m) at few points."""
        return self.terms(rows, *self.coarse_limits)

    def residuals(self, rows: Array) -> Array:
        """Terms (B, m) at all points."""
        return self.terms(rows, self.angle, MIN_ELBOW_SINE)

    @property
    def coarse_limits(self) -> tuple[Array, float]:
        """Angles of the coarse terms, and the smallest sine of the elbow there."""
        points = min(COARSE_POINTS, self.angle.size)
        return precision_points(points), COARSE_ELBOW_FACTOR * MIN_ELBOW_SINE

    def terms(self, rows: Array, angle: Array, min_sine: float) -> Array:
        """Terms (B, m) at angles (A,)."""
        kind, designs = self.kind_numbers(rows), self.designs(rows)
        found = [
            batch_moments(self.parameters(kind[part], designs[part]), angle, min_sine)
            for part in parts_of_batch(len(rows))
        ]
        return (np.concatenate(found) - self.target(angle)) / np.sqrt(angle.size)

    def linearize(self, rows: Array, coarse: bool) -> tuple[Array, Array]:
        """Terms (B, m), and their derivatives by the rows (B, 1 + D, m)."""
        angle, min_sine = self.coarse_limits if coarse else (self.angle, MIN_ELBOW_SINE)
        parts = [self.linearize_part(rows[p], angle, min_sine) for p in parts_of_batch(len(rows))]
        moment, slopes = (np.concatenate(each) for each in zip(*parts, strict=True))
        scale = np.sqrt(angle.size)
        return (moment - self.target(angle)) / scale, slopes / scale

    def linearize_part(self, rows: Array, angle: Array, min_sine: float) -> tuple[Array, Array]:
        """Moments (B, A) and their derivatives by the rows (B, 1 + D, A)."""
        kind, designs = self.kind_numbers(rows), self.designs(rows)
        width = self.highest[kind] - self.lowest[kind]
        step = SHARE_STEP * width
        change = np.where(designs + step > self.highest[kind], -step, step)
        moment, slopes = batch_slopes(
            lambda designs: self.parameters(kind, designs), designs, change, angle, min_sine
        )
        by_share = slopes * width[..., None]
        return moment, np.concatenate([np.zeros_like(by_share[:, :1]), by_share], axis=1)


BATCH_SIZE = 1024
"""Largest number of balancers that are followed together: arrays of some megabytes."""


def parts_of_batch(count: int) -> list[slice]:
    """Slices of at most `BATCH_SIZE` rows.

    >>> parts_of_batch(1500)
    [slice(0, 1024, None), slice(1024, 1500, None)]
    """
    return [slice(k, min(k + BATCH_SIZE, count)) for k in range(0, max(count, 1), BATCH_SIZE)]


def kind_bounds(variant: Variant) -> dict[str, tuple[float, float]]:
    """Bounds of all parameters of a kind; equal ones of parameters that are not free in it."""
    found = dict.fromkeys(parameter_names(variant.segments), (0.0, 0.0))
    found |= {f"length{i}": (TRIANGLE_LENGTH,) * 2 for i in (1, 2) if variant.is_rigid}
    if "high2" in found:
        found["high2"] = (NO_CONTACT, NO_CONTACT)
    for name, pair in variant.bounds.items():
        shared = name in ("stiffness", "quadratic")
        found[f"{name}1" if shared else name] = pair
    return found


def preload_side(variant: Variant, joint: int) -> int:
    """1 if the preload of a joint is positive in a kind, -1 if negative, 0 without a preload."""
    if joint not in variant.preload:
        return 0
    return 1 if variant.bounds[f"preload{joint}"][0] >= 0 else -1


class NoDesignError(ValueError):
    """None of the random designs of a search is possible."""


class KindsSearch(SavedSearch):
    """A search over kinds with one number of segments; each heat keeps the best of each kind."""

    problem: KindsProblem

    def begin(self, start: Array | None) -> SearchState:
        """The initial state: feasible random designs of each kind."""
        count, rng = self.effort.heats[0][0], np.random.default_rng(self.effort.seed)
        terms, wanted = self.terms(0), np.full(len(self.problem.variants), count)
        rows, values = [np.empty((0, self.problem.low.size))], [np.empty(0)]
        for _ in range(MAX_DRAW_ROUNDS):
            kind = np.repeat(np.arange(wanted.size), DRAWS_PER_START * wanted)
            places = scatter_places(kind.size, self.problem.low.size, rng)
            places[:, 0] = self.problem.codes(kind)
            found = residual_norms(terms, places)
            for k in np.flatnonzero(wanted):
                good = np.flatnonzero((kind == k) & np.isfinite(found))[: wanted[k]]
                rows.append(places[good])
                values.append(found[good])
                wanted[k] -= good.size
            if not wanted.any():
                break
        found_rows = np.concatenate(rows)
        if not len(found_rows):
            raise NoDesignError("none of the random designs of any kind is possible; widen bounds")
        damping = np.full(len(found_rows), START_DAMPING)
        return SearchState(0, found_rows, np.concatenate(values), damping, self.evaluations)

    def choose(self, state: SearchState, most: int) -> Array:
        """The best distinct designs of each kind, and of those that it takes over."""
        state = self.share(state)
        kind = self.problem.kind_numbers(state.places)
        chosen = []
        for k in range(len(self.problem.variants)):
            own = np.flatnonzero(kind == k)
            chosen.append(own[distinct_places(state.places[own], state.values[own], most)])
        return state.places[np.concatenate(chosen)]

    def share(self, state: SearchState) -> SearchState:
        """Add to the designs of each kind the best design of each narrower kind, where better."""
        problem, terms = self.problem, self.terms(self.heat)
        best = best_rows(problem.kind_numbers(state.places), state.values, len(problem.variants))
        givers, takers = self.narrower_pairs
        known = best[givers] >= 0
        givers, takers = givers[known], takers[known]
        if not givers.size:
            return state
        worth = np.where(best[takers] >= 0, state.values[best[takers]], np.inf)
        better = state.values[best[givers]] < worth
        givers, takers = givers[better], takers[better]
        if not givers.size:
            return state
        rows = problem.rows(takers, problem.designs(state.places[best[givers]]))
        return replace(
            state,
            places=np.concatenate([state.places, rows]),
            values=np.concatenate([state.values, residual_norms(terms, rows)]),
            damping=np.concatenate([state.damping, np.full(len(rows), START_DAMPING)]),
        )

    @cached_property
    def narrower_pairs(self) -> tuple[NDArray[np.int_], NDArray[np.int_]]:
        """Numbers of all pairs of kinds of which the first is narrower than the second."""
        kinds = self.problem.variants
        pairs = [
            (i, j)
            for i, one in enumerate(kinds)
            for j, other in enumerate(kinds)
            if is_narrower(one, other)
        ]
        return tuple(np.array(pairs, int).reshape(-1, 2).T)  # type: ignore[return-value]

    def finish(self) -> SearchState:
        """The last state with what narrower kinds found; designs are not moved off edges here."""
        return replace(self.share(self.state), evaluations=self.evaluations, finished=True)


def best_rows(kind: NDArray[np.int_], values: Array, count: int) -> NDArray[np.int_]:
    """Number of the best row of each kind; -1 for a kind without a row of finite value."""
    best = np.full(count, -1)
    for k in np.argsort(values, kind="stable")[::-1]:
        if np.isfinite(values[k]):
            best[kind[k]] = k
    return best
