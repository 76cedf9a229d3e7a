"""Convergence series: one engine parameter from coarse to fine, the order of its errors, its end.

An error floor is claimed only where errors are asymptotic: less than 1e-2 of the range, and changed
by less than 5 % by each of two halvings of the step (`find_flat_point`, `is_floor`).  A constant
error of 0.8 of the range is no floor: the engine follows another motion, or one that is out of
phase.

The errors of a series without an error floor are expected to fall further, with the order of its
last two steps.  From that follow the step that would be good enough and its cost.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import groupby, pairwise
from math import inf, isclose, isfinite, log

from proofmass.base.strict import Kind
from proofmass.base.wording import number
from proofmass.case.case import Case
from proofmass.sim.engines import format_solver
from proofmass.sim.protocol.settings import first_number
from proofmass.studies import DEFAULT_LONGEST_RUN, DEFAULT_SEARCH_BUDGET
from proofmass.studies.measure import StudyRun
from proofmass.studies.record import NAN, ParameterValue, Setting, StudyRow
from proofmass.studies.store import Store, package_versions, task_key
from proofmass.studies.study import make_row
from proofmass.studies.trade.varied import ConvergenceSeries, list_series, with_step
from proofmass.studies.trade.verdict import Verdict
from proofmass.verdict.outcome import NOT_RUN_OUTCOMES, Outcome

MIN_FALLING_ORDER = 0.5
"""Order, over two refinements, below which an error counts as no longer falling."""
MIN_ORDER_POINTS = 3  # least number of settings from whose errors an order is computed
OTHER_MOTION_ERROR = 0.1
"""Share of the range above which an error is that of another motion and shows no order."""
ASYMPTOTIC_ERROR = 0.01
"""Share of the range below which an error is asymptotic and may be a floor: at this share its next
term, which goes with the square, is 1 % of it."""
UNCHANGED_SHARE = 0.05
"""Relative change of an error by a halving of the step below which it is unchanged.  An error
changes by this much if a tenth of it still falls, with first order."""
WORSE_RATIO = 1.5
"""Ratio of the error of a finer step to the coarser one's above which it is called worse; a smaller
ratio may come from a change of phase."""
FLOOR_CLEARANCE = 10.0
"""Ratio to the error of the floor above which errors show their order.  Where the floor is 1/10 of
the error, second order appears as 1.9."""
SAME_ORDER_SHARE = 0.05
"""Difference of two successive orders, over their sum, up to which they are the same: 0.1 for first
order."""
INFINITE_ERROR_OUTCOMES = (
    Outcome.DIVERGED,
    Outcome.NOT_FINITE,
    Outcome.CRASHED,
    Outcome.NO_REFERENCE,
)
"""Outcomes of runs that count as an infinite error."""

Points = Sequence[tuple[float, float]]
"""Sizes (such as time steps) and errors of settings, from coarse to fine."""


@dataclass
class MeasuredSeries:
    """A convergence series and the rows of its settings measured so far, from the coarsest on."""

    series: ConvergenceSeries
    rows: list[StudyRow] = field(default_factory=list)

    def done(self, budget: float) -> bool:
        """Whether the series ends: no setting left, errors settled, or a run over `budget` [s]."""
        if len(self.rows) == len(self.series.settings):
            return True
        if not self.rows:
            return False
        last = self.rows[-1]
        if last.outcome in (Outcome.TIMED_OUT, *NOT_RUN_OUTCOMES) or last.cost > budget:
            return True
        return bool(self.kinds) and all(self.settled(kind) for kind in self.kinds)

    def settled(self, kind: str) -> bool:
        """Whether the last two refinements left an error unchanged, or each made it worse.

        The error must be asymptotic, or else that of positions must be: after a jolt at the start,
        accelerations may have large errors for any step.
        """
        points = self.points(kind)
        if not (is_constant(points) or is_rising(points)):
            return False
        last = points[-1][1] if isfinite(points[-1][1]) else points[-3][1]
        places = self.points("position")
        return last < ASYMPTOTIC_ERROR or (bool(places) and places[-1][1] < ASYMPTOTIC_ERROR)

    @property
    def kinds(self) -> list[str]:
        """Kinds of errors that the rows have."""
        return list(dict.fromkeys(kind for row in self.rows for kind in row.errors))

    def points(self, kind: str) -> list[tuple[float, float]]:
        """Sizes and errors of the settings from the first with the right motion on.

        The motion is right if the error is below `OTHER_MOTION_ERROR`.  If no setting has the right
        motion, these are all settings that ran.  Errors of failed runs are infinite.
        """
        every = self.every(kind)
        first = next((k for k, (_, error) in enumerate(every) if error < OTHER_MOTION_ERROR), None)
        return [p for p in every if isfinite(p[1])] if first is None else every[first:]

    def every(self, kind: str) -> list[tuple[float, float]]:
        """Sizes and errors of all settings, infinite where a run failed."""
        return [
            (size, error)
            for size, row in zip(self.series.sizes, self.rows, strict=False)
            if (
                error := inf
                if row.outcome in INFINITE_ERROR_OUTCOMES
                else row.errors.get(kind, NAN)
            )
            > 0
            and row.outcome in (Outcome.RAN, *INFINITE_ERROR_OUTCOMES)
        ]

    def place(self, size: float) -> int:
        """The number of the setting with a size."""
        return self.series.sizes.index(size)


def convergence_order(coarse: tuple[float, float], fine: tuple[float, float]) -> float:
    """The order of convergence that two sizes and their errors show; -inf if the finer one failed.

    >>> convergence_order((0.2, 4e-4), (0.1, 1e-4))
    2.0
    """
    if fine[1] == inf:
        return -inf
    return log(coarse[1] / fine[1]) / log(coarse[0] / fine[0])


def is_unchanged(coarse: float, fine: float) -> bool:
    """Whether a refinement changed an error by less than `UNCHANGED_SHARE`.

    >>> is_unchanged(1e-3, 1.04e-3), is_unchanged(1e-3, 0.94e-3)
    (True, False)
    """
    return isfinite(fine) and abs(fine / coarse - 1) < UNCHANGED_SHARE


def is_constant(points: Points) -> bool:
    """Whether each of the last two refinements left the error unchanged."""
    errors = [error for _, error in points[-3:]]
    return len(errors) == 3 and all(is_unchanged(*pair) for pair in pairwise(errors))


def is_rising(points: Points) -> bool:
    """Whether each of the last two refinements made the error worse, or failed."""
    errors = [error for _, error in points[-3:]]
    return (
        len(errors) == 3
        and isfinite(errors[0])
        and all(
            fine == inf or fine > (1 + UNCHANGED_SHARE) * coarse
            for coarse, fine in pairwise(errors)
        )
    )


def find_flat_point(points: Points) -> int | None:
    """Index of the point that may be at an error floor, with two refinements after it if possible.

    The point is asymptotic and no later refinement changes its error: two refinements, or one if
    the series ends there.  None if there is no such point.  Two halvings of its step decide whether
    it is at a floor (`is_floor`).

    >>> find_flat_point([(0.4, 16e-5), (0.2, 4e-5), (0.1, 1e-5), (0.05, 1e-5), (0.025, 1e-5)])
    2
    >>> find_flat_point([(0.4, 0.80), (0.2, 0.81), (0.1, 0.80)])  # another motion
    """
    last = len(points) - 1
    if not points or not points[-1][1] < ASYMPTOTIC_ERROR:
        return None
    while last > 0 and is_unchanged(points[last - 1][1], points[last][1]):
        last -= 1
    last = max(last, len(points) - 3)
    return last if last < len(points) - 1 and points[last][1] < ASYMPTOTIC_ERROR else None


def find_least_error(points: Points) -> int | None:
    """Index of the least error, if it is asymptotic and all finer points are worse; else None.

    At least two finer points must follow.

    >>> find_least_error([(0.4, 1e-8), (0.2, 1e-10), (0.1, 4e-10), (0.05, 2e-9)])
    1
    """
    k = min(range(len(points)), key=lambda k: points[k][1], default=0)
    finer_errors = [error for _, error in points[k + 1 :]]
    return (
        k
        if len(finer_errors) > 1
        and points[k][1] < ASYMPTOTIC_ERROR
        and all(
            isfinite(error) and error > (1 + UNCHANGED_SHARE) * points[k][1]
            for error in finer_errors
        )
        else None
    )


def is_floor(errors: Sequence[float]) -> bool:
    """Whether an error, and those with half and a quarter of its step, show an error floor.

    >>> (is_floor([1e-3, 1.01e-3, 1e-3]), is_floor([1e-3, 0.9e-3, 0.85e-3]),
    ...  is_floor([0.5, 0.5, 0.5]))
    (True, False, False)
    """
    return (
        len(errors) == 3
        and 0 < errors[0] < ASYMPTOTIC_ERROR
        and all(is_unchanged(*pair) for pair in pairwise(errors))
    )


def find_slowdown(points: Points) -> int | None:
    """Index of the first point after which the error no longer falls over two refinements or more.

    The order of the series ends there; this alone is no error floor.  None if there is no such
    point.

    >>> find_slowdown([(0.4, 16e-5), (0.2, 4e-5), (0.1, 1.1e-5), (0.05, 1e-5), (0.025, 1.2e-5)])
    2
    """
    for k in range(len(points) - 2):
        if all(
            convergence_order(points[k], later) < MIN_FALLING_ORDER for later in points[k + 2 :]
        ):
            return k
    return None


def slowdown_error(points: Points) -> float:
    """The least error from the point of `find_slowdown` on; NaN if there is no such point."""
    first = find_slowdown(points)
    return NAN if first is None else min(error for _, error in points[first:])


def points_before_slowdown(points: Points) -> Points:
    """The points before that of `find_slowdown`, without those near the error of the end.

    Errors count as near up to the ratio `FLOOR_CLEARANCE`.  If the last refinement alone does not
    let the error fall, the points are treated as if the error slowed there.
    """
    first, end_error = find_slowdown(points), slowdown_error(points)
    if first is None and len(points) > 1 and convergence_order(*points[-2:]) < MIN_FALLING_ORDER:
        first, end_error = len(points) - 2, min(error for _, error in points[-2:])
    return [
        p
        for p in points[:first]
        if isfinite(p[1]) and (first is None or p[1] > FLOOR_CLEARANCE * end_error)
    ]


def observed_order(points: Points) -> float:
    """The order in the asymptotic range: the mean of the finest two equal orders; NaN without any.

    The two orders are those of two successive refinements, among the points of
    `points_before_slowdown`.

    >>> observed_order([(0.4, 9e-2), (0.2, 4e-3), (0.1, 1e-3), (0.05, 2.5e-4)])
    2.0
    """
    orders = [convergence_order(*pair) for pair in pairwise(points_before_slowdown(points))]
    return next(
        (
            (one + two) / 2
            for one, two in reversed(list(pairwise(orders)))
            if abs(one - two) <= SAME_ORDER_SHARE * max(2.0, abs(one + two))
        ),
        NAN,
    )


def final_order(points: Points) -> float:
    """The order with which errors fall at the end of a series, to predict those of finer settings.

    It is the observed order if the last refinement shows it as well, else the order of the last
    refinement alone.  NaN if there are fewer than three errors, if they do not fall, or if they are
    not below `OTHER_MOTION_ERROR`.

    >>> round(final_order([(0.4, 4e-2), (0.2, 1e-2), (0.1, 2.6e-3)]), 2)
    1.97
    >>> final_order([(0.4, 0.8), (0.2, 0.7)])
    nan
    """
    finite = [p for p in points if isfinite(p[1])]
    ends = finite[-2:]
    if (
        len(finite) < MIN_ORDER_POINTS
        or ends != list(points[-2:])
        or not ends[0][1] < OTHER_MOTION_ERROR
    ):
        return NAN
    last = convergence_order(*ends)
    observed = observed_order(points)
    if abs(last - observed) <= 2 * SAME_ORDER_SHARE * max(1.0, observed):
        return observed
    return last if last > MIN_FALLING_ORDER else NAN


def find_worse_pair(points: Points) -> tuple[tuple[float, float], tuple[float, float]] | None:
    """The two successive points of which the finer is worse by the largest ratio.

    None if no ratio is above `WORSE_RATIO`.  Failed runs do not count: they have no error.

    >>> find_worse_pair([(1e-3, 1.9e-2), (0.5e-3, 6.8e-2), (0.25e-3, 4e-4)])
    ((0.001, 0.019), (0.0005, 0.068))
    """
    pairs = [
        (coarse, fine)
        for coarse, fine in pairwise(points)
        if coarse[1] < OTHER_MOTION_ERROR
        and isfinite(fine[1])
        and fine[1] > WORSE_RATIO * coarse[1]
    ]
    return max(pairs, key=lambda pair: pair[1][1] / pair[0][1], default=None)


AIMED_ERROR_SHARE = 0.8  # share of the needed error that is aimed at, since orders change a little
MIN_STEP_RATIO = 1.4  # least ratio of two steps for an order to be computed from them


EXPECTED_TIME_SHARE = 0.9
"""Largest expected cost of a run, as a share of the largest one allowed: expectations have errors
of a tenth."""


@dataclass
class Limits:
    """Counted processor times that a search may take, and that it took so far.

    Attributes
    ----------
    longest, budget : float
        Largest counted time of a run, and of all runs of the search together [s].
    spent : float
        Counted time of the runs of the search [s].  Runs that are taken from the store count as
        well, so that a repeated search ends at the same place.
    settings : int
        Number of settings that were measured.
    known : int
        Number of other settings that were in the store.
    short : bool
        Whether a setting was left out because of the budget.
    """

    longest: float = DEFAULT_LONGEST_RUN
    budget: float = DEFAULT_SEARCH_BUDGET
    spent: float = 0.0
    settings: int = 0
    known: int = 0
    short: bool = False

    @property
    def longest_expected(self) -> float:
        """Largest expected cost of a run that is tried [s]: it should end within `longest`."""
        return EXPECTED_TIME_SHARE * self.longest

    @property
    def words(self) -> str:
        """The limits and what was spent, in a sentence.

        >>> Limits(budget=60.0, spent=12.34, settings=3).words
        '3 settings measured, with runs of 12 s in all, of --budget 60 s and --longest 30 s a run'
        """
        known = f"{self.known} more settings known from the store; " if self.known else ""
        return (
            f"{known}{self.settings} settings measured, with runs of {number(self.spent, 2)} s in "
            f"all, of --budget {number(self.budget)} s and --longest {number(self.longest)} s a run"
            + "; the budget left some out"
            * self.short
        )


@dataclass(frozen=True)
class Prediction:
    """Prediction for a series: step that should be good enough [s], its cost [s], order."""

    row: StudyRow
    step: float
    seconds: float
    falls: float


def predict_steps(
    rows: Iterable[StudyRow], verdicts: Iterable[Verdict], error_kind: str, needed: float
) -> list[Prediction]:
    """Predictions for all series without an error floor whose errors still fall, cheapest first."""
    floors = {(v.engine, v.series) for v in verdicts if v.kind == error_kind and v.floor > 0}
    found = []
    for coarse, fine in final_pairs(row for row in rows if (row.engine, row.series) not in floors):
        pair = [(row.value, row.reached(error_kind)) for row in (coarse, fine)]
        falling_order = (
            convergence_order(*pair) if all(0 < error < inf for _, error in pair) else NAN
        )
        if falling_order > MIN_FALLING_ORDER and fine.reached(error_kind) > needed:
            step = fine.value * (AIMED_ERROR_SHARE * needed / fine.reached(error_kind)) ** (
                1 / falling_order
            )
            found.append(Prediction(fine, step, fine.cost * fine.value / step, falling_order))
    return sorted(found, key=lambda each: each.seconds)


def final_pairs(rows: Iterable[StudyRow]) -> Iterator[tuple[StudyRow, StudyRow]]:
    """For each series a clearly coarser step and the finest one, if these and another one ran."""
    stepped = sorted(
        (row for row in rows if row.varied == "timestep"),
        key=lambda row: (row.engine, row.series, -row.value),
    )
    for _, group in groupby(stepped, lambda row: (row.engine, row.series)):
        series = list(group)
        before = [row for row in series if row.value > MIN_STEP_RATIO * series[-1].value]
        ran = [row for row in series if row.outcome == Outcome.RAN]
        if (
            before
            and len(ran) >= MIN_ORDER_POINTS
            and [before[-1].outcome, series[-1].outcome] == ["ran", "ran"]
        ):
            yield before[-1], series[-1]


def setting_at_step(row: StudyRow, step: float) -> Setting:
    """The setting of a row with another step, and with what depends on the step in its series."""
    return with_step(Setting(row.engine, dict(row.parameters, timestep=row.value)), step)


def list_cached_settings(
    case: Case, kind: Kind, rows: Iterable[StudyRow], store: Store, only: str = ""
) -> Iterator[StudyRow]:
    """Rows of further settings of a case that the store has, from any study.

    `rows` are left out.  If `only` is given, these are settings of that engine.  The key of each
    setting is computed again, so that only runs of the present model, sidecar, sources and versions
    are used.
    """
    known_keys = {row.key for row in rows}
    all_series = [
        series for series in list_series(case, kind) if series.engine == (only or series.engine)
    ]
    for key, record in store.records(case.name, kind):
        engine, parameters = str(record.get("engine")), record.get("parameters")
        if (
            key in known_keys
            or engine not in {series.engine for series in all_series}
            or (
                not isinstance(parameters, dict)
                or record.get("versions") != package_versions(engine)
            )
        ):
            continue
        setting = Setting(
            engine,
            {
                name: tuple(value) if isinstance(value, list) else value
                for name, value in parameters.items()
            },
        )
        task = StudyRun(case, kind, setting, "choose", *find_series(setting, all_series))
        found = store.repeats(key) if task_key(task) == key else []
        if found and found[0].outcome == Outcome.RAN:
            yield make_row(task, found, True, key)


def find_series(
    setting: Setting, all_series: Iterable[ConvergenceSeries]
) -> tuple[str, str, float]:
    """Name of the series that a setting belongs to, or a new one; varied parameter; its value."""
    for series in all_series:
        first = series.settings[0]
        value = setting.parameters.get(series.varied)
        if series.engine != setting.engine or value is None or len(series.settings) < 2:
            continue
        candidate = (
            with_step(first, first_number(value))
            if series.scaled
            else first.with_parameters(**{series.varied: value})
        )
        if are_same_parameters(candidate.parameters, setting.parameters):
            return series.name, series.varied, first_number(value)
    step = setting.parameters.get("timestep", NAN)
    words = ", ".join(
        f"{name} {value}" for name, value in setting.parameters.items() if name != "timestep"
    )
    return (
        f"{format_solver(setting.engine)}, {words or 'as in the model'}",
        "timestep",
        first_number(step),
    )


def are_same_parameters(one: dict[str, ParameterValue], other: dict[str, ParameterValue]) -> bool:
    """Whether the parameters of two settings are equal up to rounding."""
    if one.keys() != other.keys():
        return False
    for name, value in one.items():
        parts = [v if isinstance(v, tuple) else (v,) for v in (value, other[name])]
        if len(parts[0]) != len(parts[1]) or not all(
            isclose(a, b, rel_tol=1e-9)
            if isinstance(a, float) and isinstance(b, (float, int))
            else a == b
            for a, b in zip(*parts, strict=True)
        ):
            return False
    return True
