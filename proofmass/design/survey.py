"""A survey: the best design of each kind of balancer for one wanted curve, and what it is worth.

All kinds are searched twice or more, with random starts of their own each time.  A kind is
confirmed if at least two of its searches end within `CONFIRMED_FACTOR` of its least error.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np

from proofmass.analytic.balancer.measures import (
    Target,
    chain_of,
    precision_points,
    rmse,
    work_reduction,
)
from proofmass.analytic.balancer.path import along, balancing_moment, follow
from proofmass.analytic.balancer.synthesis import LAST_PATH_ANGLE, Variant
from proofmass.base.arrays import Array
from proofmass.base.front import nondominated_points
from proofmass.design.kinds import (
    SURVEY_HEATS,
    KindsProblem,
    KindsSearch,
    NoDesignError,
    best_rows,
    is_narrower,
)
from proofmass.design.parts import PartList, leave_out_stops, list_parts
from proofmass.design.search import Effort, leave_edges, residual_norms

CONFIRMED_FACTOR = 1.2
"""Factor of the least error within which a second search of a kind must end to confirm it."""
EXACT_ERROR = 1e-4
"""Error over m g r [1] below which designs count as equally good: a stiffness that is off by a
hundredth of a percent changes the moment as much."""
PASSES = 2
"""Number of searches over all kinds."""
MAX_EXTRA_PASSES = 3
"""Largest number of further searches over the kinds of the front that are not confirmed."""
EXTRA_HEATS = ((48, 6), (16, 20), (6, 40))
"""Descents of each kind and their steps in each round of a further search."""
TABLE_POINTS = 90
"""Number of angles at which the errors of the table are computed."""
SurveyProgress = Callable[[str, int, int, float], None]
"""Called with the words of a search, its finished and all its steps, and its least error [1]."""


@dataclass(frozen=True)
class KindResult:
    """The best design of a kind.

    Attributes
    ----------
    variant : Variant
        The kind, with the elbow of the best design.
    parameters : dict
        Parameters of `proofmass.analytic.balancer.solve` that must be built [SI].
    parts : PartList
    rmse, worst, worst_angle, work_reduction : float
        Root mean square error and largest error over m g r [1], the latter's angle [rad], and
        work reduction [%].
    number : int
        Number of the search that found the design, from 0.
    searches : tuple of float
        Least error of each search of the kind, at the angles of the search, best first [1].
    at_bounds : tuple of str
        Parameters that lie on a bound of the search, other than springs at zero.
    optimal : bool
        Whether no kind has both a smaller error and no more parts (Pareto-optimal).
    """

    variant: Variant
    parameters: dict[str, float]
    parts: PartList
    rmse: float
    worst: float
    worst_angle: float
    work_reduction: float
    number: int
    searches: tuple[float, ...]
    at_bounds: tuple[str, ...]
    optimal: bool = False

    @property
    def error(self) -> float:
        """The root mean square error, `EXACT_ERROR` at least [1]."""
        return max(self.rmse, EXACT_ERROR)

    @property
    def agreeing(self) -> int:
        """Number of searches of the kind that ended within a factor of its least error."""
        bar = CONFIRMED_FACTOR * max(self.searches[0], EXACT_ERROR)
        return sum(one <= bar for one in self.searches)

    @property
    def confirmed(self) -> bool:
        """Whether a second search ended within a factor of the least error."""
        return self.agreeing > 1

    @property
    def words(self) -> str:
        """The kind in words."""
        return kind_words(self.variant)


@dataclass(frozen=True)
class Survey:
    """The results of all kinds, best first, with what was done to find them.

    Attributes
    ----------
    kinds : list of KindResult
    impossible : list of Variant
        Kinds for which no design was found.
    evaluations, descents, passes : int
        Numbers of designs that were evaluated, of descents from random starts, and of searches.
    """

    kinds: list[KindResult]
    impossible: list[Variant]
    evaluations: int
    descents: int
    passes: int

    @property
    def front(self) -> list[KindResult]:
        """The Pareto-optimal kinds, with the fewest parts first."""
        return sorted((k for k in self.kinds if k.optimal), key=lambda k: k.parts.count)

    @property
    def unsure(self) -> list[KindResult]:
        """Kinds that are not confirmed although what is said about the best designs needs it.

        They are those of the front, and, unless the best design is exact, those that no other kind
        is wider than: all designs of all kinds are of one of these.
        """
        widest = []
        if self.kinds[0].rmse > EXACT_ERROR:
            plain = [without_elbow(kind.variant) for kind in self.kinds]
            widest = [not any(is_narrower(one, other) for other in plain) for one in plain]
        return [
            kind
            for k, kind in enumerate(self.kinds)
            if not kind.confirmed and (kind.optimal or (widest and widest[k]))
        ]

    @property
    def claim(self) -> str:
        """What the search can say about better designs, in a sentence with its counts."""
        best, unsure = self.kinds[0], self.unsure
        done = (
            f"{self.evaluations:,} designs evaluated in {self.descents:,} descents from random "
            f"starts, over {len(self.kinds)} kinds"
        )
        sure = sum(kind.confirmed for kind in self.front)
        confirmed = (
            f"{sure} of {len(self.front)} Pareto-optimal designs are confirmed by a second search "
            f"of their kind with other starts"
        )
        if best.rmse <= EXACT_ERROR:
            return (
                f"The error is below {EXACT_ERROR:g} m g r, less than a part can be made to: "
                f"nothing better is looked for ({done}; {confirmed})."
            )
        if unsure:
            return (
                f"A better design may exist: of {len(unsure)} kinds among the widest or "
                f"Pareto-optimal ones no two searches ended within a factor {CONFIRMED_FACTOR:g} "
                f"({done}; {confirmed}). A larger --effort looks further."
            )
        return (
            f"Nothing better by a factor {CONFIRMED_FACTOR:g} was found among {done}: two searches "
            f"or more, with starts of their own, ended within this factor for each of the widest "
            f"kinds; {confirmed}. This is no proof that none exists."
        )


def kind_words(variant: Variant) -> str:
    """A kind in words.

    >>> kind_words(Variant("sine", springs="each", preload=(2,), free_angle=True))
    '3 segments, nonlinear springs, preload 2, rest angle free'
    """
    springs = {
        "linear": "linear springs",
        "nonlinear": "equal nonlinear springs",
        "each": "nonlinear springs",
    }[variant.springs]
    found = [f"{variant.segments} segments", springs]
    if variant.preload:
        found.append(f"preload {' and '.join(map(str, variant.preload))}")
    found += ["contact"] * variant.contact
    found += ["rest angle free"] * variant.free_angle
    return ", ".join([*found, *["lengths relaxed"] * variant.relaxed])


class SurveySearch:
    """The searches of a survey, which save their states into a folder.

    Parameters
    ----------
    variants : sequence of Variant
        All kinds, both ways of the elbow included; see `proofmass.design.kinds.all_kinds`.
    target : Target
    seed : int
        Seed of the first search.
    effort : float
        Factor of the numbers of descents [1].
    folder : path, optional
        Folder of the saved states.
    """

    def __init__(
        self,
        variants: Sequence[Variant],
        target: Target,
        seed: int = 1,
        effort: float = 1.0,
        folder: Path | None = None,
    ):
        self.variants, self.target, self.seed = list(variants), target, seed
        self.effort, self.folder = effort, folder
        self.errors: dict[Variant, dict[int, float]] = {v: {} for v in variants}
        self.best: dict[Variant, FoundDesign] = {}
        self.evaluations = self.descents = self.passes = 0

    def run(self, advance: SurveyProgress = lambda *_: None) -> Survey:
        """Search all kinds, and those of the front again until they are confirmed."""
        for k in range(PASSES):
            self.search(self.variants, SURVEY_HEATS, k, f"search {k + 1}", advance)
        for k in range(PASSES, PASSES + MAX_EXTRA_PASSES):
            unsure = self.survey().unsure
            if not unsure:
                break
            again = [v for kind in unsure for v in self.elbows(kind.variant)]
            self.search(again, EXTRA_HEATS, k, f"search {k + 1} of {len(unsure)} kinds", advance)
        return self.survey()

    def elbows(self, variant: Variant) -> list[Variant]:
        """The kinds that differ from a kind by the elbow at most."""
        return [v for v in self.variants if without_elbow(v) == without_elbow(variant)]

    def search(
        self,
        variants: Sequence[Variant],
        heats: Sequence[tuple[int, int]],
        number: int,
        words: str,
        advance: SurveyProgress,
    ) -> None:
        """Search kinds once, and keep what is better than before."""
        scaled = tuple((max(1, round(count * self.effort)), steps) for count, steps in heats)
        seed, self.passes = self.seed + number, self.passes + 1
        for n in sorted({v.segments for v in variants}):
            problem = KindsProblem([v for v in variants if v.segments == n], self.target)
            file = self.folder / f"search_{n}_{number + 1}.npz" if self.folder else None
            label = f"{words}, {n} segments"
            try:
                search = KindsSearch(problem, Effort(scaled, seed, implicit=True), file)
            except NoDesignError:
                continue
            search.run(partial(advance, label))
            self.keep(search, number)

    def keep(self, search: KindsSearch, number: int) -> None:
        """Keep the best design of each kind of a search, if it is better than before."""
        state, problem = search.state, search.problem
        self.evaluations += state.evaluations
        self.descents += search.effort.heats[0][0] * len(problem.variants)
        kind = problem.kind_numbers(state.places)
        designs = problem.designs(state.places)
        for variant, k in zip(
            problem.variants, best_rows(kind, state.values, len(problem.variants)), strict=True
        ):
            if k < 0:
                continue
            value = self.errors[variant][number] = float(state.values[k])
            if variant not in self.best or value < self.best[variant].value:
                self.best[variant] = FoundDesign(value, designs[k], number)

    def survey(self) -> Survey:
        """The results so far; designs of the front are moved off edges."""
        while True:
            kinds = mark_front(self.results())
            moved = [self.leave_edge(self.origin(kind)) for kind in kinds if kind.optimal]
            if not any(moved):
                break
        found = {without_elbow(kind.variant) for kind in kinds}
        missing = dict.fromkeys(map(without_elbow, self.variants))
        return Survey(
            sorted(kinds, key=lambda kind: (kind.error, kind.parts.count, kind.rmse)),
            [v for v in missing if v not in found],
            self.evaluations,
            self.descents,
            self.passes,
        )

    def origin(self, kind: KindResult) -> Variant:
        """The kind in whose search the design of a kind was found."""
        return next(
            variant
            for variant, found in self.best.items()
            if found.results and found.results[0].parameters == kind.parameters
        )

    def leave_edge(self, variant: Variant) -> bool:
        """Move the best design of a kind off an edge; whether that changed it."""
        found = self.best[variant]
        if found.left_edge:
            return False
        problem = KindsProblem([variant], self.target)
        rows = problem.rows(np.zeros(1, int), found.design[None])

        def terms(rows: Array) -> Array:
            self.evaluations += len(rows)
            return problem.residuals(rows)

        rows, values = leave_edges(rows, residual_norms(terms, rows), terms, self.seed)
        design = problem.designs(rows)[0]
        if not np.isfinite(values[0]):
            del self.best[variant]
            self.errors[variant].clear()
            return True
        self.best[variant] = FoundDesign(float(values[0]), design, found.number, left_edge=True)
        return not np.array_equal(design, found.design)

    def results(self) -> list[KindResult]:
        """The result of each kind: the best of all designs that are of this kind.

        A design is often of a narrower kind than the one in whose search it was found.
        """
        own = [self.result(variant) for variant in self.best]
        found = []
        for n in sorted({v.segments for v in self.variants}):
            kinds = [v for v in self.variants if v.segments == n]
            designs = [result for result in own if result.variant.segments == n]
            if not designs:
                continue
            fits = KindsProblem(kinds, self.target).fits([each.parameters for each in designs])
            for plain in dict.fromkeys(map(without_elbow, kinds)):
                rows = [k for k, kind in enumerate(kinds) if without_elbow(kind) == plain]
                fitting = [designs[k] for k in np.flatnonzero(np.any(fits[rows], axis=0))]
                if fitting:
                    best = min(fitting, key=lambda each: each.rmse)
                    found.append(self.as_kind(best, plain))
        return found

    def as_kind(self, best: KindResult, plain: Variant) -> KindResult:
        """The best design of a kind as its result, with the least error of each search.

        Kinds share their designs within a search, so that a design of another kind counts for the
        search in which it was found.
        """
        least = {best.number: best.searches[0]}
        for each in (self.errors[v] for v in self.elbows(plain)):
            least |= {k: min(value, least.get(k, np.inf)) for k, value in each.items()}
        variant = replace(plain, mode=best.variant.mode)
        return replace(best, variant=variant, searches=tuple(sorted(least.values())))

    def result(self, variant: Variant) -> KindResult:
        """The result of a search of a kind with one elbow, from its best design."""
        found = self.best[variant]
        if not found.results:
            problem = KindsProblem([variant], self.target)
            given = problem.parameters(np.zeros(1, int), found.design[None])
            needed = leave_out_stops({name: float(value[0]) for name, value in given.items()})
            found.results.append(
                KindResult(
                    variant,
                    needed,
                    list_parts(needed),
                    *measure_design(needed, self.target),
                    found.number,
                    (found.value,),
                    parameters_at_bounds(problem, found.design),
                )
            )
        return found.results[0]


@dataclass(frozen=True)
class FoundDesign:
    """The best design of a kind so far, as a vector of `parameter_names` [SI]."""

    value: float
    design: Array
    number: int
    left_edge: bool = False
    results: list[KindResult] = field(default_factory=list)


def without_elbow(variant: Variant) -> Variant:
    """The kind with its elbow up, as which both ways of the elbow are listed."""
    return replace(variant, mode=1)


def mark_front(kinds: Sequence[KindResult]) -> list[KindResult]:
    """The results, of which those are marked that no other beats in error and number of parts."""
    order = sorted(kinds, key=lambda kind: (kind.error, kind.parts.count, kind.rmse))
    aims = np.array([[kind.error, kind.parts.count] for kind in order]).reshape(-1, 2)
    best = set(nondominated_points(aims).tolist())
    return [replace(kind, optimal=k in best) for k, kind in enumerate(order)]


def measure_design(
    parameters: dict[str, float], target: Target
) -> tuple[float, float, float, float]:
    """Root mean square error, largest error and its angle, and work reduction of a design."""
    angle, chain = precision_points(TABLE_POINTS), chain_of(parameters)
    moment = balancing_moment(chain, along(chain, follow(chain, LAST_PATH_ANGLE), angle))[0]
    wanted = target(angle)
    error = moment - wanted
    worst = int(np.abs(error).argmax())
    return (
        float(rmse(moment, wanted)),
        float(error[worst]),
        float(angle[worst]),
        float(work_reduction(moment, wanted, angle)),
    )


BOUND_DISTANCE = 1e-9
"""Distance from a bound as a share of that between both bounds at which a parameter lies on it."""


def parameters_at_bounds(problem: KindsProblem, design: Array) -> tuple[str, ...]:
    """Names of the parameters of a design (D,) that lie on a bound at which they do not vanish."""
    low, high = problem.lowest[0], problem.highest[0]
    with np.errstate(invalid="ignore"):
        share = (design - low) / (high - low)
    at = (np.minimum(share, 1.0 - share) < BOUND_DISTANCE) & (design != 0.0) & (high > low)
    names = [name for name, is_at in zip(problem.names, at, strict=True) if is_at]
    return tuple(name for name in names if name not in ("high2", "rest_angle"))
