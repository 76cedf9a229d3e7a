"""Search for a design: bounded least squares in the unit cube, from many starting points at once.

Descents begin at points that are spread over the cube and follow the Levenberg-Marquardt method;
the best of them are refined.  A descent can move along the faces of the cube, but not along the
boundary of an infeasible region inside the cube: it stops there, and only another descent can find
the designs beyond.  There the last digit of a parameter may decide what a design does, so the
search moves its designs off such boundaries at the end.

A search is a sequence of steps, each of which computes a new state from the last state alone.  A
search that continues from a saved state therefore gives the same result as an uninterrupted one.
"""

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import partial
from io import BytesIO
from itertools import accumulate
from pathlib import Path
from typing import Protocol, cast
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from proofmass.base.arrays import Array
from proofmass.base.errors import InputError
from proofmass.base.files import write_output

FACE_SHARES = (0.1, 0.05)
"""Shares of random coordinates that are on their lower, on their upper bound."""
MIN_EDGE_DISTANCE = (
    0.05  # [1] places nearer than this to a better place get no descent of their own
)


def scatter_places(count: int, d: int, rng: np.random.Generator) -> Array:
    """Random places (count, d) in the unit cube, with a share of the coordinates on its faces.

    Many optima lie on a face.
    """
    places, face = rng.random((2, count, d))
    return np.where(face < FACE_SHARES[0], 0.0, np.where(face > 1.0 - FACE_SHARES[1], 1.0, places))


def distinct_places(
    places: Array, values: Array, most: int, distance: float = MIN_EDGE_DISTANCE
) -> Array:
    """Indices of the best places with finite values, at most `most`, best first.

    Any two of them differ by more than `distance` [1] in a coordinate.

    >>> places = np.array([[0.0], [0.01], [0.5], [1.0]])
    >>> distinct_places(places, np.array([3.0, 1.0, 2.0, np.inf]), most=3).tolist()
    [1, 2]
    """
    chosen: list[int] = []
    for k in np.argsort(values, kind="stable"):
        if len(chosen) == most:
            break
        gaps = np.abs(places[chosen] - places[k]).max(axis=-1)
        if np.isfinite(values[k]) and (gaps > distance).all():
            chosen.append(int(k))
    return np.array(chosen, int)


TERM_DIFFERENCE_STEP = (
    1e-6  # [1] displacement for finite differences of terms that are exact to 1e-12
)
DAMPING_FACTORS = np.array([0.1, 1.0, 10.0])  # factors of the damping that are tried in each step
DAMPING_RISE = 1e3  # factor of the damping if none of the trials is better
MAX_DAMPING = 1e8
"""Damping [1] beyond which a descent has ended, since no step reduces the sum of squares."""
MIN_DAMPING = 1e-9  # [1] smallest damping
MIN_REDUCTION = 1e-7  # smallest relative reduction that counts as better
CostTerms = Callable[[Array], Array]
Linearization = Callable[[Array], tuple[Array, Array]]
"""From places (B, d) to terms (B, m) and their derivatives (B, d, m)."""
Trials = Callable[[Array, Array], Array]
"""From places (B, d) and their damping (B,) to the places (B, F, d) that a step tries."""
SLOPES_COST = 2
"""Number of evaluations as which terms with implicit derivatives count: measured as 0.8 to 1.3 of
the processor time of one evaluation, for 4 to 16 parameters."""


def residual_norms(terms: CostTerms, places: Array) -> Array:
    """Square roots of the sums of squares (B,); inf for infeasible designs."""
    found = np.linalg.norm(terms(places), axis=-1)
    return np.where(np.isfinite(found), found, np.inf)


def step_descents(
    places: Array,
    values: Array,
    damping: Array,
    terms: CostTerms,
    trials: Trials | None = None,
) -> tuple[Array, Array, Array]:
    """One step of each descent that has not ended; the sums of squares never increase.

    Parameters
    ----------
    places, values : ndarray (B, d), (B,)
        Present places of the descents, and the square roots of their sums of squares [1].
    damping : ndarray (B,)
        Damping of each descent [1]; above `MAX_DAMPING` the descent has ended.
    terms : callable
        Terms (B, m) of the sums of squares at places (B, d); NaN for infeasible designs.
    trials : callable, optional
        The places that are tried with each factor of `DAMPING_FACTORS`; by default `trial_places`
        with derivatives by finite differences.
    """
    active = np.flatnonzero((damping <= MAX_DAMPING) & np.isfinite(values))
    places, values = places.copy(), values.copy()
    damping = np.where(np.isfinite(values), damping, np.inf)
    if not active.size:
        return places, values, damping
    trials = trials or partial(trial_places, linearization=partial(linearize, terms=terms))
    tried = trials(places[active], damping[active])
    sizes = residual_norms(terms, tried.reshape(-1, places.shape[1])).reshape(tried.shape[:2])
    best, row = sizes.argmin(axis=-1), np.arange(active.size)
    better = sizes[row, best] < values[active] * (1.0 - MIN_REDUCTION)
    damping[active] = np.maximum(
        damping[active] * np.where(better, DAMPING_FACTORS[best], DAMPING_RISE), MIN_DAMPING
    )
    places[active[better]] = tried[row, best][better]
    values[active[better]] = sizes[row, best][better]
    return places, values, damping


def trial_places(places: Array, damping: Array, linearization: Linearization) -> Array:
    """Places (B, F, d) after a step from each place with each factor of `DAMPING_FACTORS`.

    The damping of the place times the factor is the damping of the Levenberg-Marquardt method in

    ::

        (J^T J + damping diag(J^T J)) step = -J^T r,    for the coordinates that are free to move

    A coordinate on a face of the cube is not free if the sum of squares decreases outwards.
    """
    r, slopes = linearization(places)
    gradient, curvature = (slopes @ r[..., None])[..., 0], slopes @ slopes.swapaxes(-1, -2)
    free = ~(((places <= 0.0) & (gradient > 0.0)) | ((places >= 1.0) & (gradient < 0.0)))
    curvature = curvature * (free[:, :, None] & free[:, None, :])
    size = np.einsum("bii->bi", curvature) + ~free + 1e-15  # positive if J has a zero column
    added = damping[:, None, None] * DAMPING_FACTORS[:, None] * size[:, None] + ~free[:, None]
    matrix = curvature[:, None] + added[..., None] * np.eye(places.shape[1])
    step = np.linalg.solve(matrix, -(gradient * free)[:, None, :, None])[..., 0]
    return np.clip(places[:, None] + step, 0.0, 1.0)


def linearize(places: Array, terms: CostTerms) -> tuple[Array, Array]:
    """Terms (B, m) and their derivatives (B, d, m), by differences that stay within the cube."""
    count, d = places.shape
    nudge = np.where(places > 0.5, -TERM_DIFFERENCE_STEP, TERM_DIFFERENCE_STEP)
    displaced = places[:, None] + nudge[..., None] * np.eye(d)
    found = terms(np.concatenate([places[:, None], displaced], axis=1).reshape(-1, d))
    found = found.reshape(count, d + 1, -1)
    return found[:, 0], np.nan_to_num((found[:, 1:] - found[:, :1]) / nudge[..., None])


EDGE_DISTANCE = 1e-6
"""Distance [1] within which a design that changes one coordinate must be nearly as good."""
MAX_ERROR_SLOPE = 1e3
"""Largest rise of the square root of the sum of squares over a distance [1] that is no jump."""
RETREATS = EDGE_DISTANCE * np.geomspace(2.0, 1e3, 32)
"""Largest changes of coordinates in the random moves off an edge that are tried [1].  Nearly half
of all directions lead away from an edge, few from a place where several edges meet."""


def is_at_edge(places: Array, values: Array, terms: CostTerms) -> NDArray[np.bool_]:
    """Whether a change of one coordinate by `EDGE_DISTANCE` makes designs (B, d) fail or jump."""
    count, d = places.shape
    moves = EDGE_DISTANCE * np.concatenate([np.eye(d), -np.eye(d)])
    around = np.clip(places[:, None] + moves, 0.0, 1.0)
    found = residual_norms(terms, around.reshape(-1, d)).reshape(count, -1)
    worst = found.max(axis=-1, initial=-np.inf)
    return ~np.isfinite(values) | (worst > values + MAX_ERROR_SLOPE * EDGE_DISTANCE)


def leave_edges(places: Array, values: Array, terms: CostTerms, seed: int) -> tuple[Array, Array]:
    """Move designs (B, d) that are at an edge off it; their values are inf if that is not possible.

    At an edge a design is just feasible, or just on a branch of its equilibria: built with the
    least deviation it would behave otherwise, and it may do so on a machine that rounds otherwise.
    """
    places, values = places.copy(), values.copy()
    directions = np.random.default_rng(seed).uniform(-1.0, 1.0, (RETREATS.size, places.shape[1]))
    moves = RETREATS[:, None] * directions
    for k in np.flatnonzero(is_at_edge(places, values, terms)):
        tried = np.clip(places[k] + moves, 0.0, 1.0)
        found = residual_norms(terms, tried)
        found[is_at_edge(tried, found, terms)] = np.inf
        best = found.argmin()
        values[k] = found[best]
        if np.isfinite(found[best]):
            places[k] = tried[best]
    return places, values


SAVE_INTERVAL = 3.0  # [s] interval between writes of the state
START_DAMPING = 1e-2  # [1] damping at the beginning of a descent
MAX_DRAWS = 100  # largest number of draws, each of as many random designs as there are descents
SearchProgress = Callable[[int, int, float], None]


class SearchProblem(Protocol):
    """A least-squares problem for vectors (B, d) between two bounds (d,)."""

    @property
    def low(self) -> Array:
        """Lower bounds."""

    @property
    def high(self) -> Array:
        """Upper bounds."""

    @property
    def fingerprint(self) -> str:
        """A text that differs between any two problems."""

    def coarse(self, vectors: Array) -> Array:
        """A subset of the terms (B, m) of the sum of squares; NaN for infeasible vectors."""

    def residuals(self, vectors: Array) -> Array:
        """All terms (B, m) of the sum of squares; NaN for infeasible vectors."""


class SlopedProblem(SearchProblem, Protocol):
    """A least-squares problem that knows the derivatives of its terms."""

    def linearize(self, vectors: Array, coarse: bool) -> tuple[Array, Array]:
        """Terms (B, m), the coarse ones or all, and their derivatives (B, d, m)."""


@dataclass(frozen=True)
class Effort:
    """The effort of a search: the numbers of its descents and steps.

    Attributes
    ----------
    heats : tuple of (int, int)
        Number of descents and number of steps in each heat, a round of the search.  A heat
        continues the best descents of the heat before it.  The last heat uses all terms, the others
        use the coarse terms.
    seed : int
        Seed of the random places of the first heat.
    implicit : bool
        Whether the derivatives are those of the problem's `linearize`, rather than differences.
    """

    heats: tuple[tuple[int, int], ...] = ((256, 6), (64, 24), (24, 60))
    seed: int = 1
    implicit: bool = False

    @property
    def steps(self) -> int:
        """Number of steps of all heats."""
        return sum(steps for _, steps in self.heats)

    def scaled(self, factor: float, seed: int, least: int) -> "Effort":
        """The same with `factor` times as many descents, `least` in a heat at least.

        >>> Effort(((64, 8), (16, 30))).scaled(0.1, seed=2, least=4).heats
        ((6, 8), (4, 30))
        """
        heats = tuple((max(least, round(count * factor)), steps) for count, steps in self.heats)
        return replace(self, heats=heats, seed=seed)


@dataclass(frozen=True)
class SearchState:
    """The state of a search after a step.

    Attributes
    ----------
    step : int
        Number of finished steps.
    places : ndarray (B, d)
        Designs, as shares from 0 to 1 of the distance between their bounds [1].
    values : ndarray (B,)
        Square roots of their sums of squares [1].
    damping : ndarray (B,)
        Damping of their descents [1].
    evaluations : int
        Number of designs that were evaluated so far.
    finished : bool
        Whether the designs have been moved off edges, which ends the search.
    """

    step: int
    places: Array
    values: Array
    damping: Array
    evaluations: int = 0
    finished: bool = False


class SavedSearch:
    """A search whose state is saved every few seconds if it has a file.

    Parameters
    ----------
    problem : SearchProblem
    effort : Effort
    file : path, optional
        File of the saved state.  If it exists, the search continues from its state.
    start : ndarray (B, d), optional
        Designs to begin with [SI], completed by random ones.  The first of them is also added to
        the last heat, so that the result is not worse.

    Raises
    ------
    InputError
        The file contains the state of another search.
    ValueError
        None of the random designs is feasible.
    """

    def __init__(
        self,
        problem: SearchProblem,
        effort: Effort | None = None,
        file: Path | None = None,
        start: Array | None = None,
    ):
        self.problem, self.effort, self.file, self.given = problem, effort or Effort(), file, start
        self.ends = list(accumulate(steps for _, steps in self.effort.heats))
        given = None if start is None else start.tolist()
        self.key = repr((problem.fingerprint, self.effort, given))
        self.saved, self.evaluations = time.monotonic(), 0
        self.state = self.load() if file and file.exists() else self.begin(start)
        self.evaluations = self.state.evaluations

    @property
    def found(self) -> Array:
        """The designs (B, d) in the present state, best first."""
        return self.vectors(self.state.places[np.argsort(self.state.values, kind="stable")])

    @property
    def heat(self) -> int:
        """Index of the heat that the next step belongs to."""
        return next(k for k, end in enumerate([*self.ends, np.inf]) if self.state.step < end)

    @property
    def done(self) -> bool:
        """Whether all steps are finished, or all descents of the last heat have ended."""
        last = len(self.effort.heats) - 1
        return self.heat > last or (
            self.heat == last and self.stuck and self.state.step not in self.ends
        )

    @property
    def stuck(self) -> bool:
        """Whether all descents have ended."""
        return bool((self.state.damping > MAX_DAMPING).all())

    def run(self, progress: SearchProgress = lambda *_: None) -> Array:
        """Search to the end, move designs off edges where possible, and return the best one (d,).

        An interrupted search saves its state.  `progress` is called as ``progress(step, steps, best
        value)`` after each step.
        """
        try:
            while not self.done:
                self.state = self.step()
                progress(self.state.step, self.effort.steps, float(self.state.values.min()))
                if time.monotonic() - self.saved > SAVE_INTERVAL:
                    self.save()
            if not self.state.finished:
                self.state = self.finish()
        finally:
            self.save()
        return self.found[0]

    def step(self) -> SearchState:
        """The next state; the first step of a heat begins with the best places of the last heat."""
        now, terms = self.state, self.terms(self.heat)
        if now.step in self.ends:
            now = self.fresh(now.step, self.choose(now, self.effort.heats[self.heat][0]), terms)
        stepped = step_descents(now.places, now.values, now.damping, terms, self.trials(self.heat))
        return SearchState(now.step + 1, *stepped, self.evaluations)

    def choose(self, state: SearchState, most: int) -> Array:
        """Choose at most `most` places for the next heat, and the given one for the last heat."""
        places = state.places[distinct_places(state.places, state.values, most)]
        if self.given is not None and self.heat == len(self.ends) - 1:
            places = np.concatenate([self.shares(self.given[:1]), places])
        return places

    def finish(self) -> SearchState:
        """The last state, with the designs moved off edges where possible."""
        now, terms = self.state, self.terms(len(self.ends) - 1)
        places, values = leave_edges(now.places, now.values, terms, self.effort.seed)
        return replace(
            now, places=places, values=values, evaluations=self.evaluations, finished=True
        )

    def begin(self, start: Array | None) -> SearchState:
        """The initial state: the designs given, completed by feasible random ones."""
        count, size = self.effort.heats[0][0], self.problem.low.size
        rng, terms = np.random.default_rng(self.effort.seed), self.terms(0)
        found = np.empty((0, size)) if start is None else self.shares(start)
        for _ in range(MAX_DRAWS):
            if len(found) >= count:
                break
            places = scatter_places(count, size, rng)
            found = np.concatenate([found, places[np.isfinite(residual_norms(terms, places))]])
        if not len(found):
            raise ValueError(
                f"none of {MAX_DRAWS * count} random designs is possible; widen bounds"
            )
        return self.fresh(0, found[:count], terms)

    def fresh(self, step: int, places: Array, terms: CostTerms) -> SearchState:
        """The state of descents that begin at given places."""
        return SearchState(
            step,
            places,
            residual_norms(terms, places),
            np.full(len(places), START_DAMPING),
            self.evaluations,
        )

    def terms(self, heat: int) -> CostTerms:
        """The terms that a heat uses, as a function of places."""
        last = heat == len(self.effort.heats) - 1
        evaluate = self.problem.residuals if last else self.problem.coarse

        def terms(places: Array) -> Array:
            self.evaluations += len(places)
            return evaluate(self.vectors(places))

        return terms

    def trials(self, heat: int) -> Trials | None:
        """The places that a step of a heat tries; None for those by finite differences."""
        if not self.effort.implicit:
            return None
        problem, width = cast(SlopedProblem, self.problem), self.problem.high - self.problem.low
        is_coarse = heat < len(self.effort.heats) - 1

        def linearization(places: Array) -> tuple[Array, Array]:
            self.evaluations += SLOPES_COST * len(places)
            found, slopes = problem.linearize(self.vectors(places), is_coarse)
            slopes = np.where(np.isfinite(found)[:, None], slopes * width[:, None], 0.0)
            return np.nan_to_num(found), np.nan_to_num(slopes)

        return partial(trial_places, linearization=linearization)

    def shares(self, vectors: Array) -> Array:
        """Designs (B, d) as shares [1] of the distance between their bounds."""
        low, high = self.problem.low, self.problem.high
        return np.clip((vectors - low) / (high - low), 0.0, 1.0)

    def vectors(self, places: Array) -> Array:
        """Designs (B, d) [SI] from places in the unit cube."""
        low, high = self.problem.low, self.problem.high
        return np.clip(low + places * (high - low), low, high)

    def save(self) -> None:
        """Write the state into its file, if it has one."""
        self.saved = time.monotonic()
        if self.file:
            packed = BytesIO()
            np.savez(packed, key=self.key, **asdict(self.state))
            write_output(self.file, packed.getvalue())

    def load(self) -> SearchState:
        """Read the state from the file."""
        assert self.file
        try:
            with np.load(self.file) as data:
                key, state = (
                    str(data["key"]),
                    SearchState(
                        int(data["step"]),
                        data["places"],
                        data["values"],
                        data["damping"],
                        int(data["evaluations"]),
                        bool(data["finished"]),
                    ),
                )
        except (OSError, ValueError, KeyError, BadZipFile) as error:
            raise InputError(self.file, "", f"not the state of a search: {error}") from None
        if key != self.key:
            raise InputError(
                self.file,
                "",
                "the state of another search, with another target, "
                "bounds, effort or seed; remove it, or choose another folder",
            )
        return state
