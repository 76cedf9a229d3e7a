"""Designs whose springs are in a stock: a search over combinations of springs and all else at once.

A joint has an option of the stock, with stiffnesses from `low` to `high`: none, one or two springs
of a catalogue, for which both are the same, or one or two clock springs from a strip, as long as
their lengths and their stress allow.  Near a design with stiffnesses k, terms r, and derivatives
J_k by the stiffnesses and J_o by all others, the error with stiffnesses K of the stock is about::

    min over s and o of |r + J_k (s K - k) + J_o o|,     s = 1/(m g r)

with a small cost of large moves, which ranks all combinations at once.  The best ones are improved
together, each with its own springs kept, and those that end best are the designs around which
combinations are ranked again.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement, product
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from proofmass.analytic.balancer.measures import precision_points
from proofmass.analytic.balancer.model import balancers
from proofmass.analytic.balancer.path import along, balancing_moment, follow
from proofmass.analytic.balancer.synthesis import (
    BATCH_STRIDE,
    COARSE_ELBOW_FACTOR,
    COARSE_POINTS,
    LAST_PATH_ANGLE,
    MIN_ELBOW_SINE,
    Synthesis,
    batch_slopes,
    least_bend,
)
from proofmass.base.arrays import Array
from proofmass.design.search import (
    START_DAMPING,
    Effort,
    SavedSearch,
    SearchProgress,
    SearchState,
    distinct_places,
    residual_norms,
)
from proofmass.design.springs import SPRING_COUNTS, SpringStrip, strip_stiffness

MAX_RANKED = 400_000
"""Largest number of combinations that are all ranked: arrays of some megabytes."""
STOCK_POINTS = 30
"""Number of angles at which combinations are compared."""
STOCK_CANDIDATES = 320
"""Number of combinations that are improved in a round."""
STARTS_PER_COMBINATION = 2
"""Number of designs with which a combination is improved in a round."""
STOCK_HEATS = ((STOCK_CANDIDATES, 5), (60, 12), (12, 40))
"""Numbers of combinations and of steps in each part of a round."""
USELESS_SHARE = 0.9
"""Error of a design over that of no balancer at all above which it balances nothing [1]."""
STOCK_ROUNDS = 3
"""Largest number of rounds; a round that improves nothing is the last."""
STOCK_STARTS = 8
"""Number of designs around which combinations are ranked."""
MOVE_COST = 0.01
"""Error that a change of a parameter by its whole range, or of a stiffness by itself, counts as
when combinations are ranked [1]: the error of a bad design."""
SOFT_SHARE = 0.1
"""Share of the stiffest joint's stiffness that the change of a softer one is compared with [1]."""
STOCK_STEP = 1e-7
"""Change of a parameter for differences of closed formulas, as a share of its range."""
STRESS_MARGIN = 1e-6
"""Share by which the moment of a clock spring stays below its limit, more than rounding."""
MOMENT_RANGE = 1e3
"""Factor between the smallest and the largest m g r that is searched where it is free."""


@dataclass(frozen=True)
class SpringOption:
    """What a joint can have from the stock.

    Attributes
    ----------
    names : tuple of str
        Names of the springs or strips; none for a joint without a spring.
    low, high : float
        Stiffnesses that can be made [N m/rad].
    moment : float
        Largest moment [N m].
    """

    names: tuple[str, ...]
    low: float
    high: float
    moment: float = np.inf


def catalogue_options(catalogue: Mapping[str, float]) -> list[SpringOption]:
    """No spring, one, or two in parallel.

    >>> [option.low for option in catalogue_options({"a": 1.0, "b": 2.5})]
    [0.0, 1.0, 2.5, 2.0, 3.5, 5.0]
    """
    chosen = [(), *((name,) for name in catalogue), *combinations_with_replacement(catalogue, 2)]
    sums = [sum((catalogue[name] for name in names), 0.0) for names in chosen]
    return [SpringOption(names, k, k) for names, k in zip(chosen, sums, strict=True)]


def strip_options(strips: Sequence[SpringStrip]) -> list[SpringOption]:
    """No spring, or one or two clock springs from a strip."""
    return [
        SpringOption((), 0.0, 0.0),
        *(
            SpringOption(
                (s.name,) * n,
                n * strip_stiffness(s, s.longest),
                n * strip_stiffness(s, s.shortest),
                n * s.stress * s.width * s.thickness**2 / 6.0,
            )
            for s, n in product(strips, SPRING_COUNTS)
        ),
    ]


class StockProblem:
    """The error of designs of one kind with linear springs, whose springs are in a stock.

    Parameters
    ----------
    task : Synthesis
        Kind and target, with linear springs.
    options : sequence of SpringOption
        The stock.
    moment : float, optional
        m g r [N m] that the springs balance; without it, m g r is free.

    Notes
    -----
    A row (B, 2 n + 1 + o) lies in the unit cube: codes of the joints' options, shares of their
    stiffnesses, that of the logarithm of m g r, and those of all other parameters of the kind.
    """

    def __init__(self, task: Synthesis, options: Sequence[SpringOption], moment: float | None):
        self.task, self.options, self.moment = task, list(options), moment
        variant = task.variant
        self.springs = [name for name in variant.usual if name.startswith("stiffness")]
        self.n = len(self.springs)
        self.others = [name for name in variant.usual if name not in self.springs]
        bounds = np.array([variant.bounds[name] for name in self.others]).reshape(-1, 2)
        self.lowest, self.highest = bounds.T
        self.soft = np.array([option.low for option in options])
        self.stiff = np.array([option.high for option in options])
        self.largest = np.array([option.moment for option in options])
        top = self.stiff.max()
        given = (top / np.sqrt(MOMENT_RANGE), top * np.sqrt(MOMENT_RANGE))
        self.range = (moment, moment) if moment else given
        self.low = np.zeros(2 * self.n + 1 + len(self.others))
        self.high = np.ones_like(self.low)
        self.angle = precision_points(STOCK_POINTS)

    @property
    def fingerprint(self) -> str:
        """Text that distinguishes this search from any other."""
        return repr((self.task.fingerprint, self.options, self.moment))

    def chosen(self, rows: Array) -> NDArray[np.int_]:
        """Numbers (B, n) of the options of the joints."""
        return np.floor(rows[:, : self.n] * len(self.options)).astype(int)

    def stiffness(self, rows: Array) -> Array:
        """Stiffnesses (B, n) [N m/rad] of the joints."""
        k = self.chosen(rows)
        share = rows[:, self.n : 2 * self.n]
        return np.asarray(self.soft[k] + share * (self.stiff[k] - self.soft[k]))

    def balanced(self, rows: Array) -> Array:
        """m g r (B,) [N m] that the springs balance."""
        low, high = self.range
        return np.asarray(low * (high / low) ** rows[:, 2 * self.n])

    def designs(self, rows: Array) -> Array:
        """Vectors (B, d) of the kind, for m g r = 1 N m."""
        scaled = self.stiffness(rows) / self.balanced(rows)[:, None]
        other = self.lowest + rows[:, 2 * self.n + 1 :] * (self.highest - self.lowest)
        values = dict(zip(self.springs, scaled.T, strict=True))
        values |= dict(zip(self.others, other.T, strict=True))
        return np.stack([values[name] for name in self.task.variant.usual], axis=-1)

    def rows(self, chosen: NDArray[np.int_], scale: Array, designs: Array) -> Array:
        """Rows with options (B, n) and m g r (B,) [N m] whose others are those of designs (B, d).

        The stiffnesses are those of the options that are nearest to the designs'.
        """
        low, high = self.range
        names = list(self.task.variant.usual)
        wanted = designs[:, [names.index(name) for name in self.springs]] * scale[:, None]
        width = self.stiff[chosen] - self.soft[chosen]
        share = np.where(width > 0, (wanted - self.soft[chosen]) / np.where(width > 0, width, 1), 0)
        other = designs[:, [names.index(name) for name in self.others]]
        of_moment = np.log(scale / low) / np.log(high / low) if high > low else 0.0 * scale
        free = np.column_stack(
            [share, of_moment, (other - self.lowest) / (self.highest - self.lowest)]
        )
        return np.column_stack([(chosen + 0.5) / len(self.options), np.clip(free, 0.0, 1.0)])

    def parameters(self, rows: Array) -> dict[str, Array]:
        """Parameters (B,) of `proofmass.analytic.balancer.solve`, for m g r = 1 N m."""
        found = self.task.variant.parameters(self.designs(rows))
        return {"mode": np.ones(len(rows))} | found

    @property
    def coarse_limits(self) -> tuple[Array, float]:
        """Angles of the coarse terms, and the smallest sine of the elbow there."""
        return precision_points(COARSE_POINTS), COARSE_ELBOW_FACTOR * MIN_ELBOW_SINE

    def coarse(self, rows: Array) -> Array:
        """Terms (B, m) at few points; NaN where a design or one of its springs is impossible."""
        return self.terms(rows, *self.coarse_limits)

    def residuals(self, rows: Array) -> Array:
        """Terms (B, m) at all points; NaN likewise."""
        return self.terms(rows, self.angle, MIN_ELBOW_SINE)

    def terms(self, rows: Array, angle: Array, min_sine: float) -> Array:
        """Terms (B, m) at angles (A,)."""
        moment = np.full((len(rows), angle.size), np.nan)
        if not len(rows):
            return moment
        parameters = self.parameters(rows)
        chains = balancers(**parameters)
        good = np.flatnonzero(np.isfinite(chains.rest + chains.stiffness).all(axis=-1))
        if good.size:
            with np.errstate(all="ignore"):  # beyond the end of a path all values are NaN
                some = chains[good]
                path = along(some, follow(some, LAST_PATH_ANGLE, BATCH_STRIDE), angle)
                bent = least_bend(path.theta, parameters["mode"][good]) > min_sine
                load = np.abs(path.moment).max(axis=1) * self.balanced(rows[good])[:, None]
            joints = load[:, : self.n]
            limit = self.largest[self.chosen(rows[good])] * (1.0 - STRESS_MARGIN)
            possible = bent & (joints <= limit).all(axis=-1)
            moment[good[possible]] = balancing_moment(some, path)[possible]
        return (moment - self.task.target(angle)) / np.sqrt(angle.size)

    def linearize(self, rows: Array, coarse: bool) -> tuple[Array, Array]:
        """Terms (B, m), and their derivatives by the rows (B, 2 n + 1 + o, m)."""
        angle, min_sine = self.coarse_limits if coarse else (self.angle, MIN_ELBOW_SINE)
        change = np.where(rows > 0.5, -STOCK_STEP, STOCK_STEP)
        change[:, : self.n] = 0.0  # the options are kept
        moment, slopes = batch_slopes(self.parameters, rows, change, angle, min_sine)
        scale = np.sqrt(angle.size)
        return (moment - self.task.target(angle)) / scale, slopes / scale


class StockSearch(SavedSearch):
    """A round of the search: given rows are improved, and the best of all combinations kept."""

    problem: StockProblem

    def begin(self, start: Array | None) -> SearchState:
        """The initial state: the rows given."""
        assert start is not None
        values = residual_norms(self.terms(0), start)
        damping = np.full(len(start), START_DAMPING)
        return SearchState(0, start, values, damping, self.evaluations)

    def choose(self, state: SearchState, most: int) -> Array:
        """The best distinct rows; rows of different combinations are always distinct."""
        spread = state.places.copy()
        spread[:, : self.problem.n] = self.problem.chosen(state.places)
        return state.places[distinct_places(spread, state.values, most)]


@dataclass(frozen=True)
class StockDesign:
    """The best design with springs of the stock.

    Attributes
    ----------
    vector : ndarray (d,)
        The design for m g r = 1 N m [SI].
    moment : float
        m g r [N m] that the springs balance.
    springs : tuple of tuple of str
        Names of the springs or strips of each joint.
    stiffness : tuple of float
        Stiffness of each joint [N m/rad].
    combinations, tried, evaluations : int
        Numbers of all combinations, of those that were improved, and of evaluated designs.
    """

    vector: Array
    moment: float
    springs: tuple[tuple[str, ...], ...]
    stiffness: tuple[float, ...]
    combinations: int
    tried: int
    evaluations: int


def search_stock(
    task: Synthesis,
    designs: Array,
    options: Sequence[SpringOption],
    moment: float | None = None,
    folder: Path | None = None,
    progress: SearchProgress = lambda *_: None,
) -> StockDesign | None:
    """Find the best design whose springs are in a stock.

    The result is None if no combination is possible and has an error below that of no balancer.

    Parameters
    ----------
    task : Synthesis
        Kind with linear springs, and target.
    designs : ndarray (B, d)
        Designs without regard to the stock [SI], best first, around which the search begins.
    options : sequence of SpringOption
    moment : float, optional
        m g r [N m]; free without it.
    folder : path, optional
        Folder of the saved states of the rounds.
    progress : callable
        As that of `SavedSearch.run`.
    """
    problem = StockProblem(task, options, moment)
    around, best, least = designs[:STOCK_STARTS], None, np.inf
    tried, evaluations = set[tuple[int, ...]](), 0
    for k in range(STOCK_ROUNDS):
        rows = rank_combinations(problem, around, tried)
        if not len(rows):
            break
        tried |= {tuple(each) for each in problem.chosen(rows).tolist()}
        file = folder / f"stock{k + 1}.npz" if folder else None
        search = StockSearch(problem, Effort(STOCK_HEATS, k, implicit=True), file, rows)
        if not np.isfinite(search.state.values).any():
            break
        search.run(progress)
        evaluations += search.state.evaluations
        order = np.argsort(search.state.values, kind="stable")
        if not search.state.values[order[0]] < least:
            break
        least, best = float(search.state.values[order[0]]), search.state.places[order[:1]]
        around = problem.designs(search.state.places[order[:STOCK_STARTS]])
    nothing = np.sqrt(np.mean(task.target(problem.angle) ** 2))
    if best is None or least > USELESS_SHARE * nothing:
        return None
    chosen = problem.chosen(best)[0]
    return StockDesign(
        problem.designs(best)[0],
        float(problem.balanced(best)[0]),
        tuple(problem.options[k].names for k in chosen),
        tuple(problem.stiffness(best)[0].tolist()),
        len(options) ** problem.n,
        len(tried),
        evaluations,
    )


def rank_combinations(problem: StockProblem, designs: Array, tried: set[tuple[int, ...]]) -> Array:
    """Rows of the combinations whose predicted errors around the designs are least."""
    found: list[tuple[float, tuple[int, ...], int, float]] = []
    for which, design in enumerate(designs):
        ranked = predict_errors(problem, design)
        if ranked is None:
            continue
        chosen, error, scale = ranked
        best = np.argsort(error, kind="stable")[:STOCK_CANDIDATES]
        found += [
            (float(error[k]), tuple(chosen[k].tolist()), which, float(scale[k])) for k in best
        ]
    found.sort()
    count: dict[tuple[int, ...], int] = {}
    kept = []
    for each in found:
        combination = each[1]
        if combination in tried or count.get(combination, 0) >= STARTS_PER_COMBINATION:
            continue
        count[combination] = count.get(combination, 0) + 1
        kept.append(each)
        if len(kept) == STOCK_CANDIDATES:
            break
    if not kept:
        return np.empty((0, problem.low.size))
    _, chosen_options, which_design, scales = zip(*kept, strict=True)
    return problem.rows(np.array(chosen_options), np.array(scales), designs[np.array(which_design)])


def predict_errors(
    problem: StockProblem, design: Array
) -> tuple[NDArray[np.int_], Array, Array] | None:
    """Options (C, n), predicted errors (C,) and m g r (C,) [N m] of combinations near a design.

    None if the design itself is impossible.
    """
    terms, by_spring, by_other = split_slopes(problem, design)
    if not np.isfinite(terms).all():
        return None
    names = list(problem.task.variant.usual)
    k = design[[names.index(name) for name in problem.springs]]
    basis = np.linalg.qr(by_other.T)[0]
    slopes = by_spring.T - basis @ (basis.T @ by_spring.T)  # (m, n)
    rest = terms - slopes @ k - basis @ (basis.T @ terms)
    gram, aim = slopes.T @ slopes, slopes.T @ rest
    chosen = list_combinations(problem, k)
    if problem.moment:
        scale = np.full(len(chosen), problem.moment)
        stiffness = np.clip(k * problem.moment, problem.soft[chosen], problem.stiff[chosen])
    else:
        stiffness = problem.soft[chosen]
        size = np.einsum("ci,ij,cj->c", stiffness, gram, stiffness)
        with np.errstate(divide="ignore", invalid="ignore"):
            scale = -size / (stiffness @ aim)
        usable = np.isfinite(scale) & (scale > problem.range[0]) & (scale < problem.range[1])
        chosen, stiffness, scale = chosen[usable], stiffness[usable], scale[usable]
    scaled = stiffness / scale[:, None]
    square = np.einsum("ci,ij,cj->c", scaled, gram, scaled)
    error = rest @ rest + 2.0 * scaled @ aim + square
    return chosen, np.sqrt(np.maximum(error, 0.0)), scale


def split_slopes(problem: StockProblem, design: Array) -> tuple[Array, Array, Array]:
    """Terms (m,) of a design and their derivatives by the stiffnesses and by all others.

    After the terms of the error follow those of moves away from the design: `MOVE_COST` times
    the change of each stiffness over itself, and of each other parameter over its range.  Without
    them the derivatives would predict no error for combinations far away, where they do not hold.
    """
    task = problem.task
    step = STOCK_STEP * (task.high - task.low)
    change = np.where(design + step > task.high, -step, step)[None]

    def make(vectors: Array) -> dict[str, Array]:
        return {"mode": np.ones(len(vectors))} | task.variant.parameters(vectors)

    moment, slopes = batch_slopes(make, design[None], change, problem.angle, MIN_ELBOW_SINE)
    scale = np.sqrt(problem.angle.size)
    is_spring = np.array([name in problem.springs for name in task.variant.usual])
    k, width = design[is_spring], (task.high - task.low)[~is_spring]
    terms = (moment[0] - task.target(problem.angle)) / scale
    added = np.zeros((k.size, width.size))
    by_spring = [
        slopes[0][is_spring] / scale,
        np.diag(MOVE_COST / np.maximum(k, SOFT_SHARE * k.max())),
        added,
    ]
    by_other = [slopes[0][~is_spring] / scale, added.T, np.diag(MOVE_COST / width)]
    return (
        np.append(terms, np.zeros(k.size + width.size)),
        np.concatenate(by_spring, axis=1),
        np.concatenate(by_other, axis=1),
    )


def list_combinations(problem: StockProblem, k: Array) -> NDArray[np.int_]:
    """All combinations (C, n) of options, or if they are too many, those near to stiffnesses k.

    Near means the nearest options of each joint, for the given m g r, or for each m g r at which
    the stiffest joint has one of the options.
    """
    count, n = len(problem.options), problem.n
    if count**n <= MAX_RANKED:
        return np.stack(np.meshgrid(*[np.arange(count)] * n, indexing="ij"), -1).reshape(-1, n)
    middle = 0.5 * (problem.soft + problem.stiff)
    scales = [problem.moment] if problem.moment else middle[middle > 0] / k.max()
    most = max(2, int((MAX_RANKED / len(scales)) ** (1.0 / n)))
    found = []
    for scale in scales:
        away = np.maximum(problem.soft - k[:, None] * scale, k[:, None] * scale - problem.stiff)
        nearest = np.argsort(np.maximum(away, 0.0), axis=-1, kind="stable")[:, :most]
        found.append(np.stack(np.meshgrid(*nearest, indexing="ij"), -1).reshape(-1, n))
    return np.unique(np.concatenate(found), axis=0)
