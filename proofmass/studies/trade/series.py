"""Convergence series: one engine parameter from coarse to fine, the order of its errors, its end.

An error floor is claimed only where errors are asymptotic: less than 1e-2 of the range, and changed
by less than 5 % by each of two halvings of the step (`flat`, `halved`).  A constant
error of 0.8 of the range is no floor: the engine follows another motion, or one that is out of
phase.

The errors of a series without an error floor are expected to fall further, with the order of its
last two steps.  From that follow the step that would be good enough and its cost.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import groupby, pairwise
from math import inf, isclose, isfinite, log

from proofmass.case import Case
from proofmass.outcome import Outcome
from proofmass.sim.protocol import leading
from proofmass.strict import Kind
from proofmass.studies import BUDGET, LONGEST
from proofmass.studies.measure import StudyRun
from proofmass.studies.record import NAN, ParameterValue, Setting, StudyRow
from proofmass.studies.run import row as row_of
from proofmass.studies.store import Store, key_of, versions
from proofmass.studies.trade.varied import ConvergenceSeries, at_step, list_series
from proofmass.studies.trade.verdict import Verdict
from proofmass.wording import format_solver, number

FALLS = 0.5
"""Order, over two refinements, below which an error counts as no longer falling."""
COARSE = 0.1
"""Share of the range above which an error is that of another motion and shows no order."""
ASYMPTOTIC = 0.01
"""Share of the range below which an error is asymptotic and may be a floor: at this share its next
term, which goes with the square, is 1 % of it."""
FLAT = 0.05
"""Relative change of an error by a halving of the step below which it is unchanged.  An error
changes by this much if a tenth of it still falls, with first order."""
WORSE = 1.5
"""Ratio of the error of a finer step to the coarser one's above which it is called worse; a smaller
ratio may come from a change of phase."""
CLEAR = 10.0
"""Ratio to the error of the floor above which errors show their order.  Where the floor is 1/10 of
the error, second order appears as 1.9."""
ALIKE = 0.05
"""Difference of two successive orders, over their sum, up to which they are the same: 0.1 for first
order."""
FAILED = (Outcome.DIVERGED, Outcome.NOT_FINITE, Outcome.CRASHED, Outcome.NO_REFERENCE)
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
        if last.outcome in (Outcome.TIMED_OUT, Outcome.UNSUPPORTED) or last.seconds > budget:
            return True
        return bool(self.kinds) and all(self.settled(kind) for kind in self.kinds)

    def settled(self, kind: str) -> bool:
        """Whether the last two refinements left an error unchanged, or each made it worse.

        The error must be asymptotic, or else that of positions must be: after a jolt at the start,
        accelerations may have large errors for any step.
        """
        points = self.points(kind)
        if not (still(points) or rising(points)):
            return False
        last = points[-1][1] if isfinite(points[-1][1]) else points[-3][1]
        places = self.points("position")
        return last < ASYMPTOTIC or (bool(places) and places[-1][1] < ASYMPTOTIC)

    @property
    def kinds(self) -> list[str]:
        """Kinds of errors that the rows have."""
        return list(dict.fromkeys(kind for row in self.rows for kind in row.errors))

    def points(self, kind: str) -> list[tuple[float, float]]:
        """Sizes and errors of the settings from the first with the right motion on.

        The motion is right if the error is below `COARSE`.  If no setting has the right
        motion, these are all settings that ran.  Errors of failed runs are infinite.
        """
        every = self.every(kind)
        first = next((k for k, (_, error) in enumerate(every) if error < COARSE), None)
        return [p for p in every if isfinite(p[1])] if first is None else every[first:]

    def every(self, kind: str) -> list[tuple[float, float]]:
        """Sizes and errors of all settings, infinite where a run failed."""
        return [
            (size, error)
            for size, row in zip(self.series.sizes, self.rows, strict=False)
            if (error := inf if row.outcome in FAILED else row.errors.get(kind, NAN)) > 0
            and row.outcome in (Outcome.RAN, *FAILED)
        ]

    def place(self, size: float) -> int:
        """The number of the setting with a size."""
        return self.series.sizes.index(size)


def order(coarse: tuple[float, float], fine: tuple[float, float]) -> float:
    """The order of convergence that two sizes and their errors show; -inf if the finer one failed.

    >>> order((0.2, 4e-4), (0.1, 1e-4))
    2.0
    """
    if fine[1] == inf:
        return -inf
    return log(coarse[1] / fine[1]) / log(coarse[0] / fine[0])


def alike(coarse: float, fine: float) -> bool:
    """Whether a refinement changed an error by less than `FLAT`.

    >>> alike(1e-3, 1.04e-3), alike(1e-3, 0.94e-3)
    (True, False)
    """
    return isfinite(fine) and abs(fine / coarse - 1) < FLAT


def still(points: Points) -> bool:
    """Whether each of the last two refinements left the error unchanged."""
    errors = [error for _, error in points[-3:]]
    return len(errors) == 3 and all(alike(*pair) for pair in pairwise(errors))


def rising(points: Points) -> bool:
    """Whether each of the last two refinements made the error worse, or failed."""
    errors = [error for _, error in points[-3:]]
    return (
        len(errors) == 3
        and isfinite(errors[0])
        and all(fine == inf or fine > (1 + FLAT) * coarse for coarse, fine in pairwise(errors))
    )


def flat(points: Points) -> int | None:
    """Index of the point that may be at an error floor, with two refinements after it if possible.

    The point is asymptotic and no later refinement changes its error: two refinements, or one if
    the series ends there.  None if there is no such point.  Two halvings of its step decide whether
    it is at a floor (`halved`).

    >>> flat([(0.4, 16e-5), (0.2, 4e-5), (0.1, 1e-5), (0.05, 1e-5), (0.025, 1e-5)])
    2
    >>> flat([(0.4, 0.80), (0.2, 0.81), (0.1, 0.80)])  # another motion
    """
    ends = len(points) - 1
    if not points or not points[-1][1] < ASYMPTOTIC:
        return None
    while ends > 0 and alike(points[ends - 1][1], points[ends][1]):
        ends -= 1
    ends = max(ends, len(points) - 3)
    return ends if ends < len(points) - 1 and points[ends][1] < ASYMPTOTIC else None


def least(points: Points) -> int | None:
    """Index of the least error, if it is asymptotic and all finer points are worse; else None.

    At least two finer points must follow.

    >>> least([(0.4, 1e-8), (0.2, 1e-10), (0.1, 4e-10), (0.05, 2e-9)])
    1
    """
    k = min(range(len(points)), key=lambda k: points[k][1], default=0)
    worse = [error for _, error in points[k + 1 :]]
    return (
        k
        if len(worse) > 1
        and points[k][1] < ASYMPTOTIC
        and all(isfinite(error) and error > (1 + FLAT) * points[k][1] for error in worse)
        else None
    )


def halved(errors: Sequence[float]) -> bool:
    """Whether an error, and those with half and a quarter of its step, show an error floor.

    >>> (halved([1e-3, 1.01e-3, 1e-3]), halved([1e-3, 0.9e-3, 0.85e-3]),
    ...  halved([0.5, 0.5, 0.5]))
    (True, False, False)
    """
    return (
        len(errors) == 3
        and 0 < errors[0] < ASYMPTOTIC
        and all(alike(*pair) for pair in pairwise(errors))
    )


def slowed(points: Points) -> int | None:
    """Index of the first point after which the error no longer falls over two refinements or more.

    The order of the series ends there; this alone is no error floor.  None if there is no such
    point.

    >>> slowed([(0.4, 16e-5), (0.2, 4e-5), (0.1, 1.1e-5), (0.05, 1e-5), (0.025, 1.2e-5)])
    2
    """
    for k in range(len(points) - 2):
        if all(order(points[k], later) < FALLS for later in points[k + 2 :]):
            return k
    return None


def level(points: Points) -> float:
    """The least error from the point of `slowed` on; NaN if there is no such point."""
    first = slowed(points)
    return NAN if first is None else min(error for _, error in points[first:])


def clear(points: Points) -> Points:
    """The points before that of `slowed`, without those near the error of the end.

    Errors count as near up to the ratio `CLEAR`.  If the last refinement alone does not
    let the error fall, the points are treated as if the error slowed there.
    """
    first, low = slowed(points), level(points)
    if first is None and len(points) > 1 and order(*points[-2:]) < FALLS:
        first, low = len(points) - 2, min(error for _, error in points[-2:])
    return [p for p in points[:first] if isfinite(p[1]) and (first is None or p[1] > CLEAR * low)]


def observed(points: Points) -> float:
    """The order in the asymptotic range: the mean of the finest two equal orders; NaN without any.

    The two orders are those of two successive refinements, among the points of
    `clear`.

    >>> observed([(0.4, 9e-2), (0.2, 4e-3), (0.1, 1e-3), (0.05, 2.5e-4)])
    2.0
    """
    orders = [order(*pair) for pair in pairwise(clear(points))]
    return next(
        (
            (one + two) / 2
            for one, two in reversed(list(pairwise(orders)))
            if abs(one - two) <= ALIKE * max(2.0, abs(one + two))
        ),
        NAN,
    )


def still_falls(points: Points) -> float:
    """The order with which errors fall at the end of a series, to predict those of finer settings.

    It is the observed order if the last refinement shows it as well, else the order of the last
    refinement alone.  NaN if the errors do not fall, or are not below `COARSE`.

    >>> round(still_falls([(0.4, 4e-2), (0.2, 1e-2), (0.1, 2.6e-3)]), 2)
    1.97
    >>> still_falls([(0.4, 0.8), (0.2, 0.7)])
    nan
    """
    ends = [p for p in points if isfinite(p[1])][-2:]
    if len(ends) < 2 or ends != list(points[-2:]) or not ends[0][1] < COARSE:
        return NAN
    last = order(*ends)
    seen = observed(points)
    if abs(last - seen) <= 2 * ALIKE * max(1.0, seen):
        return seen
    return last if last > FALLS else NAN


def worse(points: Points) -> tuple[tuple[float, float], tuple[float, float]] | None:
    """The two successive points of which the finer is worse by the largest ratio.

    None if no ratio is above `WORSE`.  Failed runs do not count: they have no error.

    >>> worse([(1e-3, 1.9e-2), (0.5e-3, 6.8e-2), (0.25e-3, 4e-4)])
    ((0.001, 0.019), (0.0005, 0.068))
    """
    pairs = [
        (coarse, fine)
        for coarse, fine in pairwise(points)
        if coarse[1] < COARSE and isfinite(fine[1]) and fine[1] > WORSE * coarse[1]
    ]
    return max(pairs, key=lambda pair: pair[1][1] / pair[0][1], default=None)


SAFE = 0.8  # share of the needed error that is aimed at, since orders change a little
APART = 1.4  # least ratio of two steps for an order to be computed from them


LIKELY = 0.9
"""Largest expected wall time of a run, as a share of the longest one allowed: expectations have
errors of a tenth, and a run that is given up has no result."""


@dataclass
class Limits:
    """Wall times that a search may take, and that it took so far.

    Attributes
    ----------
    longest, budget : float
        Longest wall time of a run, and of all runs of the search together [s].
    spent : float
        Wall time of the runs of the search [s].  Runs that are taken from the store count as well,
        so that a repeated search ends at the same place.
    settings : int
        Number of settings that were measured.
    known : int
        Number of other settings that were in the store.
    short : bool
        Whether a setting was left out because of the budget.
    """

    longest: float = LONGEST
    budget: float = BUDGET
    spent: float = 0.0
    settings: int = 0
    known: int = 0
    short: bool = False

    @property
    def likely(self) -> float:
        """Largest expected wall time of a run that is tried [s]: it should end within `longest`."""
        return LIKELY * self.longest

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
class Promise:
    """Prediction for a series: step that should be good enough [s], its wall time [s], order."""

    row: StudyRow
    step: float
    seconds: float
    falls: float


def promises(
    rows: Iterable[StudyRow], verdicts: Iterable[Verdict], of: str, needed: float
) -> list[Promise]:
    """Predictions for all series without an error floor whose errors still fall, cheapest first."""
    floors = {(v.engine, v.series) for v in verdicts if v.kind == of and v.floor > 0}
    found = []
    for coarse, fine in ends(row for row in rows if (row.engine, row.series) not in floors):
        pair = [(row.value, row.reached(of)) for row in (coarse, fine)]
        falls = order(*pair) if all(0 < error < inf for _, error in pair) else NAN
        if falls > FALLS and fine.reached(of) > needed:
            step = fine.value * (SAFE * needed / fine.reached(of)) ** (1 / falls)
            found.append(Promise(fine, step, fine.seconds * fine.value / step, falls))
    return sorted(found, key=lambda each: each.seconds)


def ends(rows: Iterable[StudyRow]) -> Iterator[tuple[StudyRow, StudyRow]]:
    """For each series a clearly coarser step and the finest one, if both ran."""
    stepped = sorted(
        (row for row in rows if row.varied == "timestep"),
        key=lambda row: (row.engine, row.series, -row.value),
    )
    for _, group in groupby(stepped, lambda row: (row.engine, row.series)):
        series = list(group)
        before = [row for row in series if row.value > APART * series[-1].value]
        if before and [before[-1].outcome, series[-1].outcome] == ["ran", "ran"]:
            yield before[-1], series[-1]


def scaled(row: StudyRow, step: float) -> Setting:
    """The setting of a row with another step, and with what depends on the step in its series."""
    return at_step(Setting(row.engine, dict(row.parameters, timestep=row.value)), step)


def list_cached_settings(
    case: Case, kind: Kind, rows: Iterable[StudyRow], store: Store, only: str = ""
) -> Iterator[StudyRow]:
    """Rows of further settings of a case that the store has, from any study.

    `rows` are left out.  If `only` is given, these are settings of that engine.  The key of each
    setting is computed again, so that only runs of the present model, sidecar, sources and versions
    are used.
    """
    there = {row.key for row in rows}
    own = [series for series in list_series(case, kind) if series.engine == (only or series.engine)]
    for key, record in store.records(case.name, kind):
        engine, parameters = str(record.get("engine")), record.get("parameters")
        if (
            key in there
            or engine not in {series.engine for series in own}
            or (not isinstance(parameters, dict) or record.get("versions") != versions(engine))
        ):
            continue
        setting = Setting(
            engine,
            {
                name: tuple(value) if isinstance(value, list) else value
                for name, value in parameters.items()
            },
        )
        task = StudyRun(case, kind, setting, "choose", *placed(setting, own))
        found = store.repeats(key) if key_of(task) == key else []
        if found and found[0].outcome == Outcome.RAN:
            yield row_of(task, found, True, key)


def placed(setting: Setting, own: Iterable[ConvergenceSeries]) -> tuple[str, str, float]:
    """Name of the series that a setting belongs to, or a new one; varied parameter; its value."""
    for series in own:
        first = series.settings[0]
        value = setting.parameters.get(series.varied)
        if series.engine != setting.engine or value is None or len(series.settings) < 2:
            continue
        there = (
            at_step(first, leading(value)) if series.scaled else first.but(**{series.varied: value})
        )
        if same(there.parameters, setting.parameters):
            return series.name, series.varied, leading(value)
    step = setting.parameters.get("timestep", NAN)
    words = ", ".join(
        f"{name} {value}" for name, value in setting.parameters.items() if name != "timestep"
    )
    return (
        f"{format_solver(setting.engine)}, {words or 'as in the model'}",
        "timestep",
        leading(step),
    )


def same(one: dict[str, ParameterValue], other: dict[str, ParameterValue]) -> bool:
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
