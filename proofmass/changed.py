"""Runs of a case with changed numbers of its model: functions that workers call.

`baseline` runs a case as it is, and keeps its errors with their signs.  `with_changes` runs it with
a changed model, holds it against the reference as `proofmass check` does, and tells from the two at
which change the first tolerance would be used up.
"""

import math
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import TypeVar

import numpy as np

from proofmass.analytic.numerics import Array
from proofmass.case import Case, DriveTable, LoadTable, ProfileTable
from proofmass.compare import Comparison, check_branch, compare, run_reference, scale_of, time_of
from proofmass.errors import InputError
from proofmass.mobility import mobility
from proofmass.outcome import FAILURES, Outcome
from proofmass.reference import compiled, evaluate, grid, reads_model
from proofmass.sim.contents import mass, size
from proofmass.sim.elements import Number, Source, changed_rods, source_of, written
from proofmass.sim.numbers import Sizes, numbers_of
from proofmass.sim.protocol import BadModel, Curves
from proofmass.solve import prescribed_run, run_here
from proofmass.strict import Kind

ENOUGH = 24
"""Intervals of a sweep that show the rate of an error: a peak between them is a percent higher."""
ChannelErrors = dict[str, Array]
MovedTable = TypeVar("MovedTable", DriveTable, LoadTable)
Changes = Sequence[tuple[Number, float]]


@dataclass(frozen=True)
class Baseline:
    """A run of the case as it is.

    Attributes
    ----------
    kind, solver : str
        The run and what runs it.
    errors : dict of str to ndarray (n,)
        Signed errors of the channels that agree [SI].
    allowed, shares : dict of str to float
        What they may be [SI], and as shares of what `scale_of` says [1].
    comparisons : list of Comparison
    seconds : float
        Wall time of the engine [s].
    """

    kind: Kind
    solver: str
    errors: ChannelErrors
    allowed: dict[str, float]
    shares: dict[str, float]
    comparisons: list[Comparison]

    @property
    def name(self) -> tuple[Kind, str]:
        """The run and the solver."""
        return self.kind, self.solver

    @property
    def seconds(self) -> float:
        """Wall time of the engine."""
        return next((c.seconds for c in self.comparisons if math.isfinite(c.seconds)), 0.0)


@dataclass(frozen=True)
class Limit:
    """By what factor a change would have to grow to be noticed, and by which channel."""

    factor: float = math.inf
    channel: str = ""


@dataclass(frozen=True)
class Trial:
    """What came of a run with changed numbers.

    Attributes
    ----------
    ratio : float
        The largest error over what is allowed [1], of all channels; infinite if the run fails.
    channel : str
        The channel of it.
    failed : str
        Why the run gave no curves that can be held against the reference.
    limits : dict of str to (Limit, Limit)
        By solvers of the run, if errors grow with the change: for the same change and for the
        opposite one.
    moved : float
        By how much the change moves an error at most, over what is allowed [1].
    moves : str
        The channel of it.
    """

    ratio: float
    channel: str = ""
    failed: str = ""
    limits: dict[str, tuple[Limit, Limit]] = field(default_factory=dict)
    moved: float = math.nan
    moves: str = ""


def baseline(case: Case, kind: Kind, solver: str) -> Baseline:
    """Run a case as it is, and tell its errors with their signs."""
    mobility(case)
    curves = run_here(case, kind, solver)
    if curves.stopped:
        raise InputError(case.file, "drive", f"the {solver} {kind} ends early: {curves.stopped}")
    comparisons = compare(case, kind, solver, curves)
    reference = run_reference(case, kind, curves).as_driven(curves.drive)
    errors, allowed, shares = ChannelErrors(), dict[str, float](), dict[str, float]()
    for c in comparisons:
        if c.outcome == Outcome.AGREES:
            errors[c.channel] = curves.channels[c.channel] - reference.channels[c.channel]
            allowed[c.channel] = c.allowed * case.channels[c.channel].factor
            scale = scale_of(case, kind, c.channel, curves, reference.channels[c.channel])
            shares[c.channel] = allowed[c.channel] / scale if scale else math.nan
    return Baseline(kind, solver, errors, allowed, shares, comparisons)


def numbers(case: Case) -> list[Number]:
    """The numbers of a case's model."""
    model = compiled(case)
    length, all_mass = size(model, case.start) or 1.0, mass(model) or 1.0
    times = [time_of(case, kind, prescribed(case, kind), length) for kind in case.run]
    sizes = Sizes(length, all_mass, next(filter(None, times), 1.0))
    loads = [load.actuator for load in case.load]
    return numbers_of(source(case), sizes, [d.joint for d in case.drive], loads)


def prescribed(case: Case, kind: Kind) -> Curves:
    """The motion that a run prescribes, without any channel."""
    run = prescribed_run(case, kind)
    moved = case.drive and kind != "equilibrium"
    return Curves(run.x, {}, drive=run.motion(run.x) if moved else None)


sources = lru_cache(8)(source_of)


def source(case: Case) -> Source:
    """The compiled model of a case with its file."""
    try:
        return sources(case.model_path, case.start, case.rods)
    except BadModel as error:
        raise InputError(case.model_path, "", str(error)) from None


def stride_of(case: Case, kind: Kind) -> int:
    """Of how many samples of a sweep one is enough to tell a rate; 1 of another run.

    Both ends stay, since a case is thinned by its number of samples.
    """
    n = case.run[kind].n
    if kind != "sweep" or n is None:
        return 1
    return max(k for k in range(1, n) if (n - 1) % k == 0 and ((n - 1) // k >= ENOUGH or k == 1))


def thinned(case: Case, kind: Kind, stride: int) -> Case:
    """The case with one sample of so many, at the same places."""
    run = case.run[kind]
    if stride == 1 or run.n is None:
        return case
    fewer = run.model_copy(update={"n": (run.n - 1) // stride + 1})
    return case.model_copy(update={"run": {**case.run, kind: fewer}})


def mutant(case: Case, changes: Changes, folder: Path) -> Case:
    """The case with a changed model, as a file in a folder; it is sampled as it was."""
    file = folder / case.model_path.name
    file.write_text(written(source(case), changes), encoding="utf-8")
    if case.recorded:
        (folder / case.reference).write_bytes((case.file.parent / case.reference).read_bytes())
    rods = {
        name: table.model_copy(update=changed_rods(case.rods, changes).get(name, {}))
        for name, table in case.rod.items()
    }
    runs = {
        kind: run.model_copy(update={"until": float(grid(case, kind)[-1])})
        if kind == "equilibrium"
        else run
        for kind, run in case.run.items()
    }
    changed = {"file": folder / case.file.name, "model": file.name, "rod": rods, "run": runs}
    moves = {
        "drive": tuple(whole_path(case, drive) for drive in case.drive),
        "load": tuple(whole_path(case, load) for load in case.load),
    }
    return case.model_copy(update={**changed, **moves})


def whole_path(case: Case, table: MovedTable) -> MovedTable:
    """A drive or a load that names the file which it follows by its whole path."""
    if not isinstance(table.profile, ProfileTable) or table.profile.file is None:
        return table
    file = str((case.file.parent / table.profile.file).absolute())
    return table.model_copy(update={"profile": table.profile.model_copy(update={"file": file})})


def with_changes(
    case: Case,
    kind: Kind,
    solver: str,
    changes: Changes,
    before: Sequence[Baseline],
    stride: int = 1,
) -> Trial:
    """Run a case with changed numbers, and hold it against the reference as `check` does.

    Parameters
    ----------
    case, kind, solver
        The run.
    changes : sequence of (Number, float)
        What is added to which numbers.
    before : sequence of Baseline
        The runs of that kind; that of this solver is judged, the others lend their errors and
        tolerances.
    stride : int
        One sample of so many is run.
    """
    own = next(one for one in before if one.solver == solver)
    with tempfile.TemporaryDirectory() as folder:
        try:
            few = thinned(case, kind, stride)
            errors = errors_of(few, mutant(few, changes, Path(folder)), kind, solver, own)
        except InputError as error:
            return Trial(math.inf, failed=error.wrong)
        except MemoryError:
            raise
        except BadModel as error:
            return Trial(math.inf, failed=str(error))
        except tuple(FAILURES) as error:
            return Trial(math.inf, failed=str(error))
        except Exception as error:
            return Trial(math.inf, failed=f"{type(error).__name__}: {error}")
    ratios = shares(errors, own.allowed)
    if not all(map(math.isfinite, ratios.values())):
        return Trial(math.inf, failed="not a number somewhere on a curve")
    channel = max(ratios, key=ratios.__getitem__)
    rates = {name: error - own.errors[name][::stride] for name, error in errors.items()}
    limits = {one.solver: limits_of(one, rates, stride) for one in before}
    by = shares(rates, own.allowed)
    moves = max(by, key=by.__getitem__)
    return Trial(ratios[channel], channel, "", limits, by[moves], moves)


def shares(some: ChannelErrors, allowed: dict[str, float]) -> dict[str, float]:
    """The largest of each channel's numbers, over what the channel may be off."""
    return {name: float(np.max(np.abs(values))) / allowed[name] for name, values in some.items()}


def errors_of(case: Case, changed: Case, kind: Kind, solver: str, own: Baseline) -> ChannelErrors:
    """Signed errors of the channels that agreed, with a changed model.

    A reference that reads the model is given the changed one; others know the case's own only, and
    are evaluated once.
    """
    mobility(changed)
    curves = run_here(changed, kind, solver)
    if curves.stopped:
        raise InputError(changed.file, "drive", f"it ends early: {curves.stopped}")
    reference = (
        evaluate(changed, kind, curves.x, curves.drive)
        if reads_model(case)
        else run_reference(case, kind, curves).as_driven(curves.drive)
    )
    check_branch(case, kind, curves, reference)
    missing = [name for name in own.errors if name not in curves.channels]
    if missing:
        why = curves.missing.get(missing[0], "it is not delivered")
        raise InputError(changed.file, missing[0], f"channel {missing[0]}: {why}")
    return {name: curves.channels[name] - reference.channels[name] for name in own.errors}


def limits_of(before: Baseline, rates: ChannelErrors, stride: int) -> tuple[Limit, Limit]:
    """By what factor of a change and of its opposite a run notices it, from its rates."""
    return tuple(  # type: ignore[return-value]
        min(
            (
                limit(before.errors[name][::stride], before.allowed[name], side * rate, name)
                for name, rate in rates.items()
                if name in before.errors
            ),
            key=lambda one: one.factor,
            default=Limit(),
        )
        for side in (1, -1)
    )


def limit(error: Array, allowed: float, rate: Array, channel: str) -> Limit:
    """By what factor of its rate an error gets as large as it may be.

    >>> limit(np.array([0.5, -0.5]), 1.0, np.array([0.1, 0.1]), "y").factor
    5.0
    """
    with np.errstate(divide="ignore"):
        room = np.where(rate > 0, allowed - error, allowed + error)
        factors = np.where(rate != 0, room / np.abs(rate), np.inf)
    return Limit(max(float(factors.min()), 0.0), channel)
