"""Runs of a case with changed numbers of its model: functions that workers call.

`run_baseline` runs a case without changes, and keeps its errors with their signs.
`run_with_changes` runs it with a changed model, compares it with the reference as `proofmass check`
does, and computes from both runs by which change the first tolerance would be used up.
"""

import math
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

import numpy as np

from proofmass.base.arrays import Array
from proofmass.base.errors import InputError
from proofmass.base.read_once import read_once
from proofmass.base.strict import Kind
from proofmass.case.case import Case, DriveTable, LoadTable, PathTable, ProfileTable
from proofmass.reference.case_model import compiled_model
from proofmass.reference.evaluate import evaluate
from proofmass.reference.mobility import mobility
from proofmass.reference.run_reference import shared_reference
from proofmass.reference.samples import run_samples
from proofmass.run.solve import prescribed_run, solve_here
from proofmass.sim.contents import mass, size
from proofmass.sim.elements import Number, Source, changed_rods, compile_source, write_changes
from proofmass.sim.model_files import model_key
from proofmass.sim.numbers import Sizes, numbers_of
from proofmass.sim.protocol.curves import Curves
from proofmass.sim.protocol.failures import BadModel
from proofmass.verdict.compare import check_assembly_mode, compare, scale_of, time_scale
from proofmass.verdict.comparison import Comparison
from proofmass.verdict.outcome import OUTCOME_OF_EXCEPTION, Outcome

MIN_INTERVALS = 24
"""Intervals of a sweep that suffice for the rate of an error: a peak between samples is about a
percent higher."""
ChannelErrors = dict[str, Array]
MovedTable = TypeVar("MovedTable", DriveTable, LoadTable)
Changes = Sequence[tuple[Number, float]]


@dataclass(frozen=True)
class Baseline:
    """A run of the unchanged case.

    Attributes
    ----------
    kind, solver : str
        The kind of run, and the solver.
    errors : dict of str to ndarray (n,)
        Signed errors of the channels that agree [SI].
    allowed, shares : dict of str to float
        Allowed errors [SI], and the same as shares of the scale that `scale_of` gives [1].
    comparisons : list of Comparison
        The comparisons of all channels.
    steps : int
        Steps of the engine.
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
    def steps(self) -> int:
        """Steps of the engine; 0 if they are not known."""
        return next((c.steps for c in self.comparisons), 0)


@dataclass(frozen=True)
class Limit:
    """The factor by which a change must grow to be noticed, and the channel that notices it."""

    factor: float = math.inf
    channel: str = ""


@dataclass(frozen=True)
class Trial:
    """The result of a run with changed numbers.

    Attributes
    ----------
    ratio : float
        The largest error over the allowed one [1], of all channels; infinite if the run fails.
    channel : str
        The channel with this error.
    failed : str
        Why the run gave no curves that can be compared with the reference.
    limits : dict of str to (Limit, Limit)
        For each solver of the run the limits of the same change and of the opposite change, if
        errors grow linearly with the change.
    moved : float
        The largest change of an error over the allowed error [1].
    moves : str
        The channel with this change.
    """

    ratio: float
    channel: str = ""
    failed: str = ""
    limits: dict[str, tuple[Limit, Limit]] = field(default_factory=dict)
    moved: float = math.nan
    moves: str = ""


def run_baseline(case: Case, kind: Kind, solver: str) -> Baseline:
    """Run the unchanged case; the result has its errors with their signs."""
    curves = solve_here(case, kind, solver)
    if curves.stopped:
        raise case.error("drive", f"the {solver} {kind} ends early: {curves.stopped}")
    shared = shared_reference(case, kind, curves)
    comparisons = compare(case, kind, solver, curves, reference=shared)
    reference = comparisons.reference
    assert reference is not None
    errors, allowed, shares = ChannelErrors(), dict[str, float](), dict[str, float]()
    for c in comparisons:
        if c.outcome == Outcome.AGREES:
            errors[c.channel] = curves.channels[c.channel] - reference.channels[c.channel]
            allowed[c.channel] = c.allowed * case.channels[c.channel].factor
            scale = scale_of(case, kind, c.channel, curves, reference.channels[c.channel])
            shares[c.channel] = allowed[c.channel] / scale if scale else math.nan
    return Baseline(kind, solver, errors, allowed, shares, comparisons)


def numbers_of_case(case: Case) -> list[Number]:
    """The numbers of a case's model."""
    model = compiled_model(case)
    length, all_mass = size(model, case.start) or 1.0, mass(model) or 1.0
    times = [time_scale(case, kind, prescribed_motion(case, kind), length) for kind in case.run]
    sizes = Sizes(length, all_mass, next(filter(None, times), 1.0))
    loads = [load.actuator for load in case.load]
    return numbers_of(model_source(case), sizes, [d.joint for d in case.drive], loads)


def prescribed_motion(case: Case, kind: Kind) -> Curves:
    """The motion that a run prescribes, as curves without channels."""
    run = prescribed_run(case, kind)
    moved = case.drive and kind != "equilibrium"
    return Curves(run.x, {}, drive=run.motion(run.x) if moved else None)


kept_source = read_once(model_key)(compile_source)
"""`compile_source`, once for each content of the files of a model."""


def model_source(case: Case) -> Source:
    """The compiled model of a case, with the MJCF file that it comes from."""
    try:
        return kept_source(case.model_path, case.start, case.rods)
    except BadModel as error:
        raise InputError(case.model_path, "", str(error)) from None


def sample_stride(case: Case, kind: Kind) -> int:
    """The stride of samples of a sweep that suffices for a rate; 1 for another kind of run.

    It divides the number of intervals, so that both ends remain samples.
    """
    n = case.run[kind].n
    if kind != "sweep" or n is None:
        return 1
    return max(
        k for k in range(1, n) if (n - 1) % k == 0 and ((n - 1) // k >= MIN_INTERVALS or k == 1)
    )


def with_fewer_samples(case: Case, kind: Kind, stride: int) -> Case:
    """The case with every stride-th sample of a run."""
    run = case.run[kind]
    if stride == 1 or run.n is None:
        return case
    return case.with_run(kind, n=(run.n - 1) // stride + 1)


def with_changed_model(case: Case, changes: Changes, folder: Path) -> Case:
    """The case with a changed model, which is written to a folder; its samples stay the same."""
    file = folder / case.model_path.name
    file.write_text(write_changes(model_source(case), changes), encoding="utf-8")
    rods = {
        name: table.model_copy(update=changed_rods(case.rods, changes).get(name, {}))
        for name, table in case.rod.items()
    }
    runs = {
        kind: run.model_copy(update={"until": float(run_samples(case, kind)[-1])})
        if kind == "equilibrium"
        else run
        for kind, run in case.run.items()
    }
    changed = {"file": folder / case.file.name, "model": file.name, "rod": rods, "run": runs}
    if case.recorded:  # as an absolute path, since it may be in another folder
        changed["reference"] = str((case.file.parent / case.reference).absolute())
    moves = {
        "drive": tuple(with_absolute_path(case, drive) for drive in case.drive),
        "load": tuple(with_absolute_path(case, load) for load in case.load),
    }
    return case.model_copy(update={**changed, **moves})


def with_absolute_path(case: Case, table: MovedTable) -> MovedTable:
    """A drive or a load with the absolute path of the file of its motion profile."""
    profile = table.profile
    if not isinstance(profile, ProfileTable | PathTable) or profile.file is None:
        return table
    file = str((case.file.parent / profile.file).absolute())
    return table.model_copy(update={"profile": profile.with_file(file)})


def run_with_changes(
    case: Case,
    kind: Kind,
    solver: str,
    changes: Changes,
    before: Sequence[Baseline],
    stride: int = 1,
) -> Trial:
    """Run a case with changed numbers, and compare it with the reference as `check` does.

    Parameters
    ----------
    case, kind, solver
        The case, the kind of run and the solver.
    changes : sequence of (Number, float)
        Numbers, and the values that are added to them.
    before : sequence of Baseline
        The unchanged runs of that kind.  That of this solver is compared; the errors and tolerances
        of the others give limits for their solvers.
    stride : int
        Every stride-th sample is run.
    """
    baseline_run = next(one for one in before if one.solver == solver)
    with tempfile.TemporaryDirectory() as folder:
        try:
            thinned_case = with_fewer_samples(case, kind, stride)
            errors = signed_errors(
                thinned_case,
                with_changed_model(thinned_case, changes, Path(folder)),
                kind,
                solver,
                baseline_run,
            )
        except InputError as error:
            return Trial(math.inf, failed=error.wrong)
        except MemoryError:
            raise
        except BadModel as error:
            return Trial(math.inf, failed=str(error))
        except tuple(OUTCOME_OF_EXCEPTION) as error:
            return Trial(math.inf, failed=str(error))
        except Exception as error:
            return Trial(math.inf, failed=f"{type(error).__name__}: {error}")
    ratios = shares_of_tolerance(errors, baseline_run.allowed)
    if not all(map(math.isfinite, ratios.values())):
        return Trial(math.inf, failed="not a number somewhere on a curve")
    channel = max(ratios, key=ratios.__getitem__)
    rates = {name: error - baseline_run.errors[name][::stride] for name, error in errors.items()}
    limits = {one.solver: change_limits(one, rates, stride) for one in before}
    moved_shares = shares_of_tolerance(rates, baseline_run.allowed)
    moves = max(moved_shares, key=moved_shares.__getitem__)
    return Trial(ratios[channel], channel, "", limits, moved_shares[moves], moves)


def shares_of_tolerance(curves: ChannelErrors, allowed: dict[str, float]) -> dict[str, float]:
    """The largest absolute value of each channel, over the channel's allowed error."""
    return {name: float(np.max(np.abs(values))) / allowed[name] for name, values in curves.items()}


def signed_errors(
    case: Case, changed: Case, kind: Kind, solver: str, own: Baseline
) -> ChannelErrors:
    """Signed errors, with a changed model, of the channels that agreed without the change.

    A reference that reads the model reads the changed one; others do not depend on the model, and
    are evaluated once.
    """
    mobility(changed)
    curves = solve_here(changed, kind, solver)
    if curves.stopped:
        raise InputError(changed.file, "drive", f"the run ends early: {curves.stopped}")
    reference = (
        evaluate(changed, kind, curves.x, curves.drive)
        if case.reads_model
        else shared_reference(case, kind, curves).as_driven(curves.drive)
    )
    check_assembly_mode(case, kind, curves, reference)
    missing = [name for name in own.errors if name not in curves.channels]
    if missing:
        why = curves.missing.get(missing[0], "it is not delivered")
        raise InputError(changed.file, missing[0], f"channel {missing[0]}: {why}")
    return {name: curves.channels[name] - reference.channels[name] for name in own.errors}


def change_limits(before: Baseline, rates: ChannelErrors, stride: int) -> tuple[Limit, Limit]:
    """The limits of a change and of its opposite in a run, from the rates of its errors."""
    return tuple(  # type: ignore[return-value]
        min(
            (
                change_limit(before.errors[name][::stride], before.allowed[name], side * rate, name)
                for name, rate in rates.items()
                if name in before.errors
            ),
            key=lambda one: one.factor,
            default=Limit(),
        )
        for side in (1, -1)
    )


def change_limit(error: Array, allowed: float, rate: Array, channel: str) -> Limit:
    """The factor on the rate of an error with which the error reaches its allowed size.

    >>> change_limit(np.array([0.5, -0.5]), 1.0, np.array([0.1, 0.1]), "y").factor
    5.0
    """
    with np.errstate(divide="ignore"):
        room = np.where(rate > 0, allowed - error, allowed + error)
        factors = np.where(rate != 0, room / np.abs(rate), np.inf)
    return Limit(max(float(factors.min()), 0.0), channel)
