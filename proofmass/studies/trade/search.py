"""Search for the cheapest setting with a small enough error, without measuring all settings.

A family is an engine with values of all parameters but the time step: an integrator, the stiffness
of loops, the number of iterations of the solver.  A family starts with one step from sample to
sample, or with the step of the model if its settings are the model's own.  The next step is the one
that should be good enough by the order of the last errors.  A family is followed as long as that
step should not cost much more than the cheapest setting that is good enough already (`SLACK`).  The
cheapest settings are then timed again in rounds.
"""

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import takewhile
from math import inf, isclose, isfinite

from proofmass.case import Case
from proofmass.engines import engine_of
from proofmass.errors import InputError
from proofmass.outcome import Outcome
from proofmass.reference import grid
from proofmass.sim.protocol import Curves, Recipe, leading, whole_steps
from proofmass.solve import prescribed_run
from proofmass.studies.bounded import bounded
from proofmass.studies.measure import StudyRun, cached_reference
from proofmass.studies.record import Setting, StudyRow
from proofmass.studies.run import MOMENT, Progress, is_shared, reference_of, run
from proofmass.studies.store import Store, key_of, once
from proofmass.studies.trade.series import COARSE, FALLS, SAFE, Limits, scaled
from proofmass.studies.trade.series import order as order_of
from proofmass.studies.trade.varied import as_given, studied

REPEATS = 2  # repeats, for wall times, of each setting that may be the cheapest
CLOSE = 1.25  # ratio of a step to a good enough one below which no step between them is tried
FARTHEST = 30.0  # largest ratio of a step to the next one
SLACK = 2.0
"""Ratio to the wall time of the cheapest setting up to which settings are followed, and timed again
in rounds: single runs do not tell smaller ratios apart."""
SURE = 1.3
"""The same ratio for long runs (`MOMENT`), whose single wall times are more certain."""
LONG = 0.5  # [s] expected time from which only the cheapest run is made, others if it is not enough
YIELDING = 40.0
"""The same ratio for drives that yield: the cheapest setting with an ideal drive may cost much less
than the cheapest one with such drives."""
PLAIN = 8.0  # the same ratio for the engine's defaults, which are measured for comparison
BETWEEN = 4.0  # ratio of a step to the next one that is tried to see whether an order holds
HOPELESS = 3  # steps without a run or an order after which a family may be given up
STUCK = 0.01
"""Relative change of an error above `COARSE` over `HOPELESS` steps, each a
quarter of the previous one, up to which finer steps are taken not to help: the engine follows
another motion."""
NARROWER = 1 / 3
"""Least distance of a step between two others from each of them, on the logarithmic scale, over the
distance of these two."""
ALIKE = 1e-3
"""Relative difference of errors up to which two families count as equal."""
SAME = 0.2  # difference of two orders up to which they count as equal
BEST = 3  # settings that are refined together because their drives are not accurate enough
RUNS = 12  # largest number of runs of a family
REFERENCE_TIMES = 5.0
"""Factor on the time of the reference that a run gets in addition: each worker evaluates the
reference once, while others run."""


@dataclass
class SettingFamily:
    """Settings of one engine that differ in the time step, and the rows measured so far.

    ``at(step)`` is the setting with a step [s].  `plain` marks the engine's own defaults.  The
    first step is `first`, or else `sample`, the time from sample to sample [s].
    """

    engine: str
    name: str
    at: Callable[[float], Setting]
    sample: float
    plain: bool = False
    first: float | None = None
    rows: list[StudyRow] = field(default_factory=list)

    def step(self, wanted: float) -> float:
        """The longest step up to the wanted one that fits its samples [s]; see `whole_step`."""
        return whole_step(self.sample, wanted)

    def next(self, of: str, needed: float, limit: float) -> float | None:
        """The step to try next [s]; None if none should be good enough within `limit` [s]."""
        if not self.rows:
            return self.first or self.sample
        if len(self.rows) >= RUNS or any(
            row.outcome in (Outcome.TIMED_OUT, Outcome.UNSUPPORTED) for row in self.rows
        ):
            return None
        rows = sorted(self.rows, key=lambda row: -row.value)
        if len(rows) >= HOPELESS and all(row.outcome != Outcome.RAN for row in rows):
            return None
        good = next((k for k, row in enumerate(rows) if error(row, of) <= needed), None)
        if good == 0:
            return None
        if good is None:
            step = self.finer(rows, of, needed, limit)
        elif self.plain:
            return None
        else:
            step = between(rows[good - 1], rows[good], of, needed)
        if step is None:
            return None
        step = self.step(step)
        if any(abs(row.value - step) < 1e-9 * step for row in rows):
            return None
        return step if self.cost(step) <= limit else None

    def cost(self, step: float) -> float:
        """Expected wall time of a run with a step [s], from that of the finest step that ran."""
        ran = [row for row in self.rows if isfinite(row.seconds)]
        finest = min(ran, key=lambda row: row.value, default=None)
        return finest.seconds * finest.value / step if finest else 0.0

    def finer(self, rows: list[StudyRow], of: str, needed: float, limit: float) -> float | None:
        """The finer step [s] that should be good enough by the order of the last errors, or None.

        If a run with that step should take longer than the limit [s], a step `BETWEEN`
        times finer is tried to see whether the order holds; if the order is known to hold, no step
        is tried.
        """
        last = rows[-1]
        if not error(last, of) < COARSE:
            return None if stuck(rows, of) else last.value / BETWEEN
        if len(rows) < 2 or not error(rows[-2], of) < COARSE:
            return last.value / 2.0
        falls = order(rows[-2], last, of)
        if falls < FALLS:  # one more refinement, then it counts as a floor
            flat = len(rows) > 2 and order(rows[-3], last, of) < FALLS
            return None if flat else last.value / 2.0
        wanted = last.value * (SAFE * needed / error(last, of)) ** (1 / falls)
        if self.cost(wanted) > limit:
            holds = len(rows) > 2 and abs(order(rows[-3], rows[-2], of) - falls) < SAME
            return None if holds else last.value / BETWEEN
        return max(wanted, last.value / FARTHEST)


def whole_step(sample: float, wanted: float) -> float:
    """The longest step up to the wanted one with a whole number of steps from sample to sample [s].

    >>> whole_step(1.0, 0.3), whole_step(1.0, 0.2)
    (0.25, 0.2)
    """
    return sample / whole_steps(sample, wanted)


def between(coarse: StudyRow, fine: StudyRow, of: str, needed: float) -> float | None:
    """A step between one that is not good enough and one that is; None if there is little to gain.

    There is little to gain if the two steps are close (`CLOSE`).  For long runs this is
    also so if, by the order of the two errors, the step that is just good enough is close to the
    fine one; the order is taken as 1 at most, since a very large error at the coarse step makes it
    too high.  Short runs are tried in any case, since errors need not fall evenly.
    """
    if coarse.value < CLOSE * fine.value:
        return None
    middle = (coarse.value * fine.value) ** 0.5
    if not error(coarse, of) < COARSE:
        return middle
    falls = order(coarse, fine, of)
    if falls < FALLS:
        return middle
    wanted = fine.value * (SAFE * needed / max(error(fine, of), 1e-17)) ** (1 / falls)
    little = SAFE * needed < error(fine, of) * CLOSE ** min(falls, 1.0)
    if little and fine.seconds > MOMENT:
        return None
    aside = (coarse.value / fine.value) ** NARROWER
    return min(max(wanted, fine.value * aside), coarse.value / aside)


def stuck(rows: Sequence[StudyRow], of: str) -> bool:
    """Whether the errors of the last steps hardly change, so that finer steps will not help."""
    last = [error(row, of) for row in rows[-HOPELESS:]]
    return len(last) == HOPELESS and max(last) - min(last) <= STUCK * min(last) < inf


def error(row: StudyRow, of: str) -> float:
    """The error of a row; infinite if it has none."""
    value = row.reached(of)
    return value if row.outcome == Outcome.RAN and isfinite(value) else inf


def order(coarse: StudyRow, fine: StudyRow, of: str) -> float:
    """The order of convergence that two rows show; minus infinity where the finer one fails."""
    return order_of((coarse.value, error(coarse, of)), (fine.value, max(error(fine, of), 1e-300)))


def families(case: Case, engine: str = "") -> Iterator[SettingFamily]:
    """The families to search in dynamics, of one engine or of all engines of the case."""
    times = grid(case, "dynamics")
    sample = float(times[1] - times[0])
    there = dict.fromkeys(solver.partition(":")[0] for solver in case.run["dynamics"].solvers)
    about = studied(case)
    for series in as_given(case, "dynamics"):
        if series.engine in (engine or series.engine):
            (own,) = series.settings
            yield SettingFamily(
                series.engine,
                series.name,
                setter(own),
                sample,
                first=min(leading(own.parameters["timestep"]), sample),
            )
    for name in there:
        if name in (engine or name):
            for recipe in engine_of(name).recipes(about):
                yield SettingFamily(
                    name, recipe.name, setting_of(name, recipe), sample, recipe.plain
                )


def setter(own: Setting) -> Callable[[float], Setting]:
    """The function that gives a setting with another time step."""
    return lambda step: own.but(timestep=step)


def setting_of(engine: str, recipe: Recipe) -> Callable[[float], Setting]:
    """The function that gives the setting of a recipe for a time step."""
    return lambda step: Setting(engine, {"timestep": step, **recipe.parameters(step)})


def search(
    case: Case,
    of: str,
    needed: float,
    store: Store,
    workers: Executor | None = None,
    engine: str = "",
    *,
    limits: Limits | None = None,
    slack: float = SLACK,
    repeats: int = REPEATS,
    progress: Progress = lambda *_: None,
) -> list[StudyRow]:
    """Measure settings of dynamics until the cheapest one that is good enough is known.

    Parameters
    ----------
    case : Case
        A case with a dynamics run.
    of, needed : str, float
        Kind of error, and the largest that is good enough, as a share of the reference's range [1].
    store : Store
        Where every finished run is saved at once.
    workers : Executor, optional
        From `proofmass.studies.run.pool`; threads of this machine if not given.
    engine : str, optional
        The only engine to search.
    limits : Limits, optional
        Wall time that each run, without its reference, and all runs together may take; the search
        updates how much they took.
    slack : float
        A family is followed while the expected wall time of its next run is below this multiple of
        that of the cheapest setting that is good enough so far [1].
    repeats : int
        Number of repeats, for wall times, of each of the cheapest settings.
    progress : callable
        Called as ``progress(label, done, total)`` after each run.

    Returns
    -------
    list of StudyRow
        All settings that were measured.
    """
    found, limits = list(families(case, engine)), limits or Limits()
    longest = limits.longest
    timeout = longest + REFERENCE_TIMES * cached_reference_seconds(case, store)
    while tasks := [
        task
        for family in found
        for task in following(case, family, found, of, needed, limits.likely, slack)
    ]:
        tasks = affordable(cheaper(tasks), limits.budget - limits.spent)
        limits.short = not tasks
        if limits.short:
            break
        limits.settings += len(tasks)
        rows = run(
            [task for _, task in tasks],
            store,
            workers,
            repeats=0,
            timeout=timeout,
            progress=progress,
        )
        for (family, _), row in zip(tasks, rows, strict=True):
            family.rows.append(row)
            failed = longest if row.outcome == Outcome.TIMED_OUT else 0.0
            limits.spent += row.seconds if isfinite(row.seconds) else failed
        if is_shared(case, "dynamics") and any(row.outcome == Outcome.NO_REFERENCE for row in rows):
            break  # all settings have the same reference
    rows = [row for family in found for row in family.rows]
    cheap = cheapest(rows, of, needed)
    near = SLACK if cheap < MOMENT else SURE
    timed = [row for row in rows if error(row, of) <= needed and row.seconds <= near * cheap]
    for engine in dict.fromkeys(family.engine for family in found):
        plain = [
            row
            for family in found
            if family.plain and family.engine == engine
            for row in family.rows
            if row.outcome == Outcome.RAN
        ]
        if plain and (compared := to_compare(plain, of, needed)) not in timed:
            timed.append(compared)
    tasks_ = [
        StudyRun(
            case,
            "dynamics",
            Setting(row.engine, row.parameters),
            row.study,
            row.series,
            row.varied,
            row.value,
            key=row.key,
        )
        for row in timed
    ]
    again = run(tasks_, store, workers, repeats=repeats, timeout=timeout, progress=progress)
    places = {id(row): k for k, row in enumerate(timed)}
    return [again[places[id(row)]] if id(row) in places else row for row in rows]


def to_compare(plain: Sequence[StudyRow], of: str, needed: float) -> StudyRow:
    """Of rows with an engine's defaults the cheapest good enough one, or else the most accurate."""
    good = [row for row in plain if error(row, of) <= needed]
    if good:
        return min(good, key=lambda row: row.seconds)
    return min(plain, key=lambda row: error(row, of))


def cached_reference_seconds(case: Case, store: Store) -> float:
    """`reference_seconds` of a case, measured once for a store; 0 if a file keeps the reference."""
    task = StudyRun(case, "dynamics", Setting(case.run["dynamics"].solvers[0].partition(":")[0]))
    if reference_of(task, store):
        return 0.0
    file = store.folder / f"{key_of(task)}.reference.json"
    return float(once(file, lambda: bounded(case, "dynamics", reference_seconds, case)))


def reference_seconds(case: Case) -> float:
    """Wall time to evaluate the reference of dynamics [s]; called in a worker."""
    asked = prescribed_run(case, "dynamics")
    began = time.perf_counter()
    with suppress(InputError):  # the runs will report the error
        cached_reference(
            case,
            "dynamics",
            Curves(asked.x, {}, drive=asked.motion(asked.x) if asked.drives else None),
        )
    return time.perf_counter() - began


def finer_for_drives(
    case: Case, tried: Iterable[tuple[StudyRow, float]], wanted: float
) -> list[StudyRun]:
    """Tasks with finer steps for settings whose drives are not accurate enough in programs.

    Parameters
    ----------
    case : Case
        A case with a dynamics run.
    tried : iterable of (StudyRow, float)
        Settings, and the errors of their programs, as shares of the reference's range [1].
    wanted : float
        Largest error that is good enough, as such a share [1].

    Returns
    -------
    list of StudyRun
        Runs of the settings with the shortest expected wall times, at most `BEST`.
        The step follows from the error, since a drive of a given gain yields in proportion to the
        square of the step.
    """
    asked = []
    sample = float(grid(case, "dynamics")[1] - grid(case, "dynamics")[0])
    for row, off in tried:
        if wanted < off < COARSE:
            finer = max((SAFE * wanted / off) ** 0.5, 1 / FARTHEST) * row.value
            step = whole_step(sample, finer)
            asked.append(
                (
                    row.seconds * row.value / step,
                    StudyRun(
                        case, "dynamics", scaled(row, step), row.study, row.series, row.varied, step
                    ),
                )
            )
    return [task for _, task in sorted(asked, key=lambda each: each[0])[:BEST]]


def following(
    case: Case,
    family: SettingFamily,
    every: Iterable[SettingFamily],
    of: str,
    needed: float,
    longest: float,
    slack: float,
) -> Iterator[tuple[SettingFamily, StudyRun]]:
    """The next run of a family with that family, or nothing if the family is given up."""
    best = cheapest(
        [
            row
            for one in every
            for row in one.rows
            if one.engine == family.engine or not family.plain
        ],
        of,
        needed,
    )
    if not family.plain and (outdone(family, every, of) or repeated(family, every, of)):
        return
    slack *= SURE / SLACK if best > MOMENT else 1.0
    limit = min(longest, (PLAIN if family.plain else slack) * best)
    step = family.next(of, needed, limit)
    if step is not None and (family.plain or not merged(family, every, of, step)):
        yield (
            family,
            StudyRun(case, "dynamics", family.at(step), "choose", family.name, "timestep", step),
        )


def outdone(family: SettingFamily, every: Iterable[SettingFamily], of: str) -> bool:
    """Whether another family of the same engine is better, so that finer steps are no use.

    The other family has a smaller error in no more time, by more than the uncertainty of single
    runs, and its errors fall as fast.  If the last `HOPELESS` errors of the family are
    above `COARSE`, they show no order: then another family with an error well below
    that suffices.
    """
    last = sorted(family.rows, key=lambda row: -row.value)[-HOPELESS:]
    if len(last) < HOPELESS:
        return False
    *_, before, end = last
    falls = order(before, end, of)
    if failed := all(error(row, of) >= COARSE for row in last):
        most = COARSE / SLACK
    elif error(before, of) < COARSE:
        most = error(end, of) / SLACK ** max(1.0, falls)
    else:
        return False
    for other in every:
        rows = sorted(other.rows, key=lambda row: -row.value)
        if other is family or other.engine != family.engine or len(rows) < 2:
            continue
        ahead = any(error(row, of) <= most and row.seconds <= end.seconds for row in rows)
        if ahead and (failed or order(rows[-2], rows[-1], of) > falls - SAME):
            return True
    return False


def repeated(family: SettingFamily, every: Iterable[SettingFamily], of: str) -> bool:
    """Whether an earlier family has the same error with the finest step of this one, for no more.

    This is decided only for runs that are long enough for a single wall time to be reliable.
    Families with the engine's defaults do not count, since they are not refined once a step is good
    enough.
    """
    last = min(family.rows, key=lambda row: row.value, default=None)
    return (
        last is not None
        and last.seconds > MOMENT
        and error(last, of) < COARSE
        and any(
            isclose(row.value, last.value)
            and isclose(error(row, of), error(last, of), rel_tol=ALIKE)
            and row.seconds <= SURE * last.seconds
            for other in before(family, every)
            if not other.plain
            for row in other.rows
        )
    )


def merged(family: SettingFamily, every: Iterable[SettingFamily], of: str, step: float) -> bool:
    """Whether an earlier family has the same setting at this step, and at a step that it has run.

    Parameters that depend on the step may be bounded, so that several families meet at the bound.
    """
    return any(
        other.at(step) == family.at(step)
        and any(
            error(row, of) < COARSE and other.at(row.value) == family.at(row.value)
            for row in other.rows
        )
        for other in before(family, every)
    )


def before(family: SettingFamily, every: Iterable[SettingFamily]) -> Iterator[SettingFamily]:
    """The families of the same engine that come before one in a list."""
    for other in takewhile(lambda one: one is not family, every):
        if other.engine == family.engine:
            yield other


def cheaper(
    tasks: list[tuple[SettingFamily, StudyRun]],
) -> list[tuple[SettingFamily, StudyRun]]:
    """Of the next runs those that are made now: all short ones, and the cheapest of the long ones.

    The others wait until it is known whether one of these is good enough.
    """
    costs = [family.cost(task.value) for family, task in tasks]
    most = max(LONG, SURE * min(costs))
    return [each for each, cost in zip(tasks, costs, strict=True) if cost <= most]


def affordable(
    tasks: list[tuple[SettingFamily, StudyRun]], left: float
) -> list[tuple[SettingFamily, StudyRun]]:
    """Of the next runs those that together are expected to take no more than is left [s]."""
    found = []
    for family, task in tasks:
        if (cost := family.cost(task.value)) <= left:
            found.append((family, task))
            left -= cost
    return found


def cheapest(rows: Iterable[StudyRow], of: str, needed: float) -> float:
    """Wall time of the cheapest row that is good enough [s]; infinite if none is."""
    return min(
        (row.seconds for row in rows if error(row, of) <= needed and row.seconds > 0), default=inf
    )
