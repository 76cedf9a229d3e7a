"""A convergence series: one engine parameter from coarse to fine, its order, and where it ends.

An error floor is claimed only where errors are asymptotic: less than 1e-2 of the range, and changed
by less than 5 % when the step is halved, twice in a row (`flat`, `halved`).  An error of 0.8 of the
range that stays is no floor: the motion is another one, or out of phase.

The errors of a series without an error floor fall on with the order of its last two steps.  That
tells which step would be good enough, and what it would cost.
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
"""Order over two refinements below which an error no longer falls as a power of the step."""
COARSE = 0.1
"""Errors of a larger share of the range are those of another motion and show no order."""
ASYMPTOTIC = 0.01
"""Errors of a larger share of the range are no floor: their next term, of the square, is 1 %."""
FLAT = 0.05
"""Share that two halvings of the step may each change of an error that is at a floor.  An error of
first order with a share of 10 % that still falls changes by this."""
WORSE = 1.5
"""Times an error that a finer step must have to be called worse; less is a change of phase."""
CLEAR = 10.0
"""Times the least error: errors nearer to it bend.  With a share 1/10 of it, second order shows
1.9."""
ALIKE = 0.05
"""What two orders in turn may differ by, to be one order, of their sum: 0.1 of first order."""
FAILED = (Outcome.DIVERGED, Outcome.NOT_FINITE, Outcome.CRASHED, Outcome.NO_REFERENCE)
"""Outcomes of settings that are no better than any error."""

Points = Sequence[tuple[float, float]]
"""Sizes and errors, from coarse to fine."""


@dataclass
class MeasuredSeries:
    """A convergence series and the rows of its settings that were run, from the first on."""

    series: ConvergenceSeries
    rows: list[StudyRow] = field(default_factory=list)

    def done(self, budget: float) -> bool:
        """Whether another setting would tell nothing more, or the last one took a budget [s]."""
        if len(self.rows) == len(self.series.settings):
            return True
        if not self.rows:
            return False
        last = self.rows[-1]
        if last.outcome in (Outcome.TIMED_OUT, Outcome.UNSUPPORTED) or last.seconds > budget:
            return True
        return bool(self.kinds) and all(self.settled(kind) for kind in self.kinds)

    def settled(self, kind: str) -> bool:
        """Whether two refinements in turn left an error as it is, or made it worse.

        It must be asymptotic, or of a motion whose positions are: jolts at the start may leave
        accelerations far off for any step.
        """
        points = self.points(kind)
        if not (still(points) or rising(points)):
            return False
        last = points[-1][1] if isfinite(points[-1][1]) else points[-3][1]
        places = self.points("position")
        return last < ASYMPTOTIC or (bool(places) and places[-1][1] < ASYMPTOTIC)

    @property
    def kinds(self) -> list[str]:
        """Kinds of errors that were found."""
        return list(dict.fromkeys(kind for row in self.rows for kind in row.errors))

    def points(self, kind: str) -> list[tuple[float, float]]:
        """Sizes and errors of the settings, infinite where a run failed.

        It begins where the motion is the right one, if it is so anywhere.
        """
        every = self.every(kind)
        first = next((k for k, (_, error) in enumerate(every) if error < COARSE), None)
        return [p for p in every if isfinite(p[1])] if first is None else every[first:]

    def every(self, kind: str) -> list[tuple[float, float]]:
        """The same from the first setting on."""
        return [
            (size, error)
            for size, row in zip(self.series.sizes, self.rows, strict=False)
            if (error := inf if row.outcome in FAILED else row.errors.get(kind, NAN)) > 0
            and row.outcome in (Outcome.RAN, *FAILED)
        ]

    def place(self, size: float) -> int:
        """The number of the setting of that size."""
        return self.series.sizes.index(size)


def order(coarse: tuple[float, float], fine: tuple[float, float]) -> float:
    """The order that two sizes and their errors show.

    >>> order((0.2, 4e-4), (0.1, 1e-4))
    2.0
    """
    if fine[1] == inf:
        return -inf
    return log(coarse[1] / fine[1]) / log(coarse[0] / fine[0])


def alike(coarse: float, fine: float) -> bool:
    """Whether a refinement left an error as it is.

    >>> alike(1e-3, 1.04e-3), alike(1e-3, 0.94e-3)
    (True, False)
    """
    return isfinite(fine) and abs(fine / coarse - 1) < FLAT


def still(points: Points) -> bool:
    """Whether the last two refinements left the error as it is."""
    errors = [error for _, error in points[-3:]]
    return len(errors) == 3 and all(alike(*pair) for pair in pairwise(errors))


def rising(points: Points) -> bool:
    """Whether the last two refinements made the error worse, or failed."""
    errors = [error for _, error in points[-3:]]
    return (
        len(errors) == 3
        and isfinite(errors[0])
        and all(fine == inf or fine > (1 + FLAT) * coarse for coarse, fine in pairwise(errors))
    )


def flat(points: Points) -> int | None:
    """The last point before a series's end that may be at an error floor; None if there is none.

    It is asymptotic and no later refinement changes it: two if there are so many, one if the series
    ends there.  Whether it is at a floor two halvings of its step tell.

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
    """The point of the least error, if it is asymptotic and all finer ones are worse: two at least.

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
    """Whether an error and those of half and a quarter of its step are those of an error floor.

    >>> halved([1e-3, 1.01e-3, 1e-3]), halved([1e-3, 0.9e-3, 0.85e-3]), halved([0.5, 0.5, 0.5])
    (True, False, False)
    """
    return (
        len(errors) == 3
        and 0 < errors[0] < ASYMPTOTIC
        and all(alike(*pair) for pair in pairwise(errors))
    )


def slowed(points: Points) -> int | None:
    """The first point from which two refinements or more do not let the error fall; None if all do.

    An order ends there; it is no error floor yet.

    >>> slowed([(0.4, 16e-5), (0.2, 4e-5), (0.1, 1.1e-5), (0.05, 1e-5), (0.025, 1.2e-5)])
    2
    """
    for k in range(len(points) - 2):
        if all(order(points[k], later) < FALLS for later in points[k + 2 :]):
            return k
    return None


def level(points: Points) -> float:
    """The least error from where it slowed on; NaN if it did not."""
    first = slowed(points)
    return NAN if first is None else min(error for _, error in points[first:])


def clear(points: Points) -> Points:
    """The points before the error slows, and not near what it comes to.

    An end that falls no further is none yet, and may become one.
    """
    first, low = slowed(points), level(points)
    if first is None and len(points) > 1 and order(*points[-2:]) < FALLS:
        first, low = len(points) - 2, min(error for _, error in points[-2:])
    return [p for p in points[:first] if isfinite(p[1]) and (first is None or p[1] > CLEAR * low)]


def observed(points: Points) -> float:
    """The order in the asymptotic range: the finest two refinements that show the same; NaN if no
    two that are clear of what the error comes to do.

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
    """The order with which a series ends, to predict finer settings; NaN if none is seen.

    The observed one where the last refinement shows it too, else that of the last refinement alone,
    if it is asymptotic or nearly so.

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
    """The two settings in turn of which the finer one is worse by most; None if none is by much.

    A run that failed has no error; it is known by its outcome.

    >>> worse([(1e-3, 1.9e-2), (0.5e-3, 6.8e-2), (0.25e-3, 4e-4)])
    ((0.001, 0.019), (0.0005, 0.068))
    """
    pairs = [
        (coarse, fine)
        for coarse, fine in pairwise(points)
        if coarse[1] < COARSE and isfinite(fine[1]) and fine[1] > WORSE * coarse[1]
    ]
    return max(pairs, key=lambda pair: pair[1][1] / pair[0][1], default=None)


SAFE = 0.8  # of the error that is needed: orders change a little
APART = 1.4  # times a step that the one before it must be, for an order to be found from both


LIKELY = 0.9
"""Share of the longest wall time that a run is expected to take at most: expectations are off by a
tenth, and a run that is given up tells nothing."""


@dataclass
class Limits:
    """How much time a search may take, and how much it took.

    Attributes
    ----------
    longest, budget : float
        Longest wall time of a run, and of all runs of the search together [s].
    spent : float
        Wall time of the runs that the search asked for, those in the store too: a search that is
        made again ends where it ended before [s].
    settings : int
        Number of settings that were measured.
    known : int
        Number of other settings that were in the store.
    short : bool
        Whether the budget left a setting out.
    """

    longest: float = LONGEST
    budget: float = BUDGET
    spent: float = 0.0
    settings: int = 0
    known: int = 0
    short: bool = False

    @property
    def likely(self) -> float:
        """What a run may be expected to take at most, for it to end within `longest` [s]."""
        return LIKELY * self.longest

    @property
    def words(self) -> str:
        """The same in a sentence.

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
    """The step [s] with which a series should be good enough, and what it should cost [s]."""

    row: StudyRow
    step: float
    seconds: float
    falls: float


def promises(
    rows: Iterable[StudyRow], verdicts: Iterable[Verdict], of: str, needed: float
) -> list[Promise]:
    """Of each series at no error floor the step that should be good enough, the cheapest first."""
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
    """The finest step of each series and the one before it that is clearly coarser, if both ran."""
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
    """A setting with another step; how hard loops are held goes with it, as in its series."""
    return at_step(Setting(row.engine, dict(row.parameters, timestep=row.value)), step)


def list_cached_settings(
    case: Case, kind: Kind, rows: Iterable[StudyRow], store: Store, only: str = ""
) -> Iterator[StudyRow]:
    """Settings that the store has of a case beside those of a study, whoever asked for them; of one
    engine `only`, if that is given.

    The key of each is found anew, so that its model, sidecar, sources and versions are these.
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
    """The series that a setting belongs to, or one of its own; the varied parameter; its value."""
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
    """Whether two settings differ by no more than rounding."""
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
