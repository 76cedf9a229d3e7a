"""The data of one run of a case for the report: curves of all solvers with their references.

`Jumps` are the places where curves jump between two samples, as at a snap or a contact, without
values in between.  A step between two samples is suspected to be a jump where it is much larger
than the steps around it.  The reference is then evaluated at finer samples between the two: a jump
remains one large step, a steep curve gives many small steps.  An engine has no finer samples.  Its
step is a jump where the reference jumps as well, or does not make that step.
"""

from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from proofmass.analytic.numerics import TURN
from proofmass.base.arrays import Array
from proofmass.base.strict import Kind
from proofmass.base.units import si_unit
from proofmass.batch.check import Result
from proofmass.case.case import Case
from proofmass.reference.case_model import compiled_model
from proofmass.reference.evaluate import evaluate, reference_for
from proofmass.reference.profiles import DRIVE_PARTS, DRIVE_PREFIX, drive_profiles
from proofmass.reference.reference_curves import ComparedCurves
from proofmass.reference.samples import run_samples
from proofmass.report.words import MOTION_UNITS
from proofmass.run.solve import plan_run
from proofmass.sim.contents import joints
from proofmass.sim.engines import NATIVE_ENGINE
from proofmass.sim.protocol.curves import Curves
from proofmass.verdict.compare import scale_of, unit_of_x
from proofmass.verdict.comparison import Comparison
from proofmass.verdict.outcome import FAILED_OUTCOMES, Outcome
from proofmass.verdict.refinement import RefinedRow

MIN_JUMP_SHARE = 0.02  # of the range: a smaller step is narrower than the line of a curve
MIN_JUMP_RATIO = 2.0
"""Least ratio of a jump to the steps around it; a sine of 8 samples a period has 1.4."""
FINER_SAMPLES = 32
"""Number of finer samples per step; a square root, as before a fold, has steps of 0.18 of it."""
REMAINING_SHARE = 0.25  # share of a suspected step that a single finer step must have to be a jump
OWN_STEP_SHARE = 0.5
"""Share of a solver's step by which it must differ from the reference's step to be a jump."""
MAX_SUSPECTS = 32  # largest number of suspected steps that are examined; noise has more


@dataclass(frozen=True)
class Jumps:
    """Where the reference or a solver jumps: indices of the samples before a jump.

    Attributes
    ----------
    mechanism : tuple of int
        Jumps of the mechanism itself, and with it of every curve.
    channels : dict of str to tuple of int
        Jumps of single curves, by channel.
    """

    mechanism: tuple[int, ...] = ()
    channels: Mapping[str, tuple[int, ...]] = field(default_factory=dict)

    def of(self, channel: str = "") -> list[int]:
        """Return the jumps of a channel, or without its name of the mechanism."""
        return sorted({*self.mechanism, *self.channels.get(channel, ())})

    def every(self) -> list[int]:
        """Return the jumps of the mechanism and of all channels."""
        return sorted({*self.mechanism, *(k for found in self.channels.values() for k in found)})


@dataclass(frozen=True)
class PlottedRun:
    """One run of a case, with all that the report shows of it.

    Attributes
    ----------
    case, kind
        The case, and the kind of the run.
    rows : list of Comparison
        All comparisons of the run, in the order of the sidecar's solvers.
    curves, reference : dict of str to Curves
        Curves by solver, and the reference at the state that the solver's drives really had.  Those
        of a failed run end where it failed.
    x_name, x_unit, x_scale : str, str, float
        The run's parameter; x times the scale [1] is in the displayed unit.
    refined, verdicts : list of RefinedRow, list of Comparison
        Errors and verdicts of a refinement of the run.
    whole : Curves, optional
        The reference over the whole run by the motion profiles of its drives, where a solver failed
        and no other reached the end of the run.
    jumps : Jumps
        Jumps of the reference.
    jumps_of : dict of str to Jumps
        Jumps of the solvers, by solver.
    """

    case: Case
    kind: Kind
    rows: list[Comparison]
    curves: dict[str, Curves] = field(default_factory=dict)
    reference: dict[str, Curves] = field(default_factory=dict)
    x_name: str = "time t"
    x_unit: str = "s"
    x_scale: float = 1.0
    refined: list[RefinedRow] = field(default_factory=list)
    verdicts: list[Comparison] = field(default_factory=list)
    whole: Curves | None = None
    jumps: Jumps = field(default_factory=Jumps)
    jumps_of: dict[str, Jumps] = field(default_factory=dict)

    @property
    def solvers(self) -> list[str]:
        """The solvers of the run, as the sidecar lists them."""
        return list(self.case.run[self.kind].solvers)

    @property
    def failed(self) -> dict[str, Comparison]:
        """Solvers that failed or have no curves, with a comparison that tells why."""
        return {
            c.solver: c
            for c in reversed(self.rows)
            if c.outcome in FAILED_OUTCOMES
            or (c.solver not in self.curves and c.outcome == Outcome.UNSUPPORTED)
        }

    @property
    def without_failed(self) -> "PlottedRun":
        """The run without the curves of failed solvers."""
        failed = self.failed
        curves, reference = (
            {s: c for s, c in by.items() if s not in failed} for by in (self.curves, self.reference)
        )
        return replace(self, curves=curves, reference=reference, whole=None)

    @property
    def channels(self) -> list[str]:
        """The channels of this run, in the sidecar's order."""
        return list(self.case.channels_of(self.kind))

    @property
    def longest(self) -> Curves:
        """The reference over the longest run; a sweep may end early, at a limit position."""
        return self.whole or max(self.reference.values(), key=lambda reference: len(reference.x))

    @property
    def grid(self) -> Array:
        """The samples of the run if no solver ends early."""
        return run_samples(self.case, self.kind)

    def apart(self, solver: str, channel: str) -> list[int]:
        """Return the jumps of a solver's difference to the reference: those of both."""
        jumps = self.jumps_of.get(solver, Jumps())
        return sorted({*self.jumps.of(channel), *jumps.of(channel)})

    def place(self, x: float) -> tuple[float, str]:
        """Return a value of the run's parameter in the displayed unit, and that unit."""
        return x * self.x_scale, self.x_unit

    def error(self, solver: str, channel: str) -> Array | None:
        """Return absolute differences to the reference in the channel's unit; None if not there."""
        if solver not in self.curves or channel not in self.curves[solver].channels:
            return None
        mine, own = (by[solver].channels[channel] for by in (self.curves, self.reference))
        return np.abs(mine - own) / self.case.channels[channel].factor


def plotted_run(result: Result, case: Case, kind: Kind) -> PlottedRun:
    """Collect one run of a case from the result."""
    rows = [c for c in result.comparisons if c.case == case.name and c.run == kind]
    curves = {
        s: result.curves[case.name, kind, s]
        for s in case.run[kind].solvers
        if (case.name, kind, s) in result.curves
    }
    reference = {s: compared_reference(case, kind, c) for s, c in curves.items()}
    failed, failed_references = curves_until_failure(result, case, kind)
    whole = None
    if (
        failed
        and max((c.x.size for c in curves.values()), default=0) < run_samples(case, kind).size
    ):
        whole = prescribed_reference(case, kind)
    curves = {s: (curves | failed)[s] for s in case.run[kind].solvers if s in curves | failed}
    reference = {s: (reference | failed_references)[s] for s in curves}
    finer, verdicts = list[RefinedRow](), list[Comparison]()
    if case.refine and case.refine.run == kind:
        finer = [row for row in result.refined if row.case == case.name]
        verdicts = [c for c in result.comparisons if c.case == case.name and c.run == "refine"]
    # without curves the parameter is not shown
    parameter = run_parameter(case, kind) if curves else ("time t", "s", 1.0)
    found = PlottedRun(case, kind, rows, curves, reference, *parameter, finer, verdicts, whole)
    if not curves:
        return found
    farthest = max(curves.values(), key=lambda c: len(c.x))
    jumps = reference_jumps(case, kind, found.longest, farthest)
    jumps_of = {s: solver_jumps(case, kind, c, reference[s], jumps) for s, c in curves.items()}
    return replace(found, jumps=jumps, jumps_of=jumps_of)


def compared_reference(case: Case, kind: Kind, curves: Curves) -> Curves:
    """Return the reference that curves were compared with; evaluated if it was not stored."""
    if isinstance(curves, ComparedCurves):
        return Curves(curves.x, curves.reference)
    return reference_for(case, kind, curves)


def curves_until_failure(
    result: Result, case: Case, kind: Kind
) -> tuple[dict[str, Curves], dict[str, Curves]]:
    """Return curves of failed runs and their references, by solver.

    A run whose reference cannot be evaluated is left out.
    """
    curves, reference = dict[str, Curves](), dict[str, Curves]()
    for solver in case.run[kind].solvers:
        found = result.failed.get((case.name, kind, solver))
        if found is not None and found.x.size:
            with suppress(Exception):  # no reference may exist for a state shortly before a failure
                reference[solver] = reference_for(case, kind, found)
                curves[solver] = found
    return curves, reference


def prescribed_reference(case: Case, kind: Kind) -> Curves | None:
    """Evaluate the reference over a whole run by the motion profiles; None if it cannot be."""
    with suppress(Exception):
        run = plan_run(case, kind, NATIVE_ENGINE)
        return evaluate(case, kind, run.x, run.motion(run.x) if run.drives else None)
    return None


def all_reached_limits(runs: Iterable[PlottedRun]) -> bool:
    """Whether all runs of a case reached their time or memory limit, as a further run would too."""
    outcomes = {c.outcome for run in runs for c in run.rows}
    return bool(outcomes) and outcomes <= {Outcome.TIMED_OUT, Outcome.OUT_OF_MEMORY}


def run_parameter(case: Case, kind: Kind) -> tuple[str, str, float]:
    """Return name, unit and scale of a run's parameter: time, arc length, or a sweep's joint."""
    unit = unit_of_x(case, kind)
    if kind == "equilibrium":
        return "arc length s", unit, 1.0
    if unit == "s":
        return "time t", unit, 1.0
    joint = case.drive[0].joint
    return (
        (f"{joint} position", unit, 1.0) if unit == "m" else (f"{joint} angle", "deg", 180 / np.pi)
    )


def drive_units(case: Case) -> list[str]:
    """Return the unit of the value of each drive: m or rad."""
    units = joints(compiled_model(case))
    return [str(units[drive.joint]) for drive in case.drive]


def displayed_unit(unit: str) -> tuple[str, float]:
    """Return the displayed unit of a curve, and the factor from SI: degrees, not radians.

    >>> displayed_unit("rad/s")[0], displayed_unit("m"), displayed_unit("mm")
    ('deg/s', ('m', 1.0), ('mm', 1000.0))
    """
    if unit == "rad" or unit.startswith("rad/"):
        return "deg" + unit[3:], 180 / np.pi
    return unit, 1.0 / si_unit(unit)[1] if unit else 1.0


def channel_rows(case: Case, channels: list[str]) -> list[list[str]]:
    """Arrange channels in rows: positions, rates, accelerations, and the others by their unit."""
    units = {name: channel.si_unit for name, channel in case.channels.items()}
    rest = [u for u in units.values() if not any(u in o for o in MOTION_UNITS.values())]
    orders = [*MOTION_UNITS.values(), *((u,) for u in dict.fromkeys(rest))]
    rows = [[n for n in channels if units[n] in order] for order in orders]
    rows = [r for r in rows if r]
    if rows and max(map(len, rows)) <= 2:  # short rows are joined, to leave less paper empty
        rows = [channels]
    width = min(max(map(len, rows), default=1), 4 if len(rows) > 1 else 3)
    return [r[k : k + width] for r in rows for k in range(0, len(r), width)]


def drive_curves(view: PlottedRun) -> dict[str, tuple[Array, dict[str, Array], str]]:
    """Return the motion of drives that the axis does not show: profile, solvers' motions and unit.

    A single steady drive is the axis itself; of several steady drives only the positions are
    returned.  In an equilibrium drives are at rest, and none is returned.  Rates and accelerations
    are left out where no solver has any, and so are quantities that a channel compares, and solvers
    without a recorded motion of the drives.
    """
    case, found = view.case, {}
    if (
        case.leader is None
        or not view.curves
        or view.kind == "equilibrium"
        or (case.leader.steady and len(case.drive) == 1)
    ):
        return {}
    equal = {case.channels[name].equals for name in view.channels}
    prescribed = zip(case.drive, drive_profiles(case, view.kind), drive_units(case), strict=True)
    for row, (drive, profile, unit) in enumerate(prescribed):
        names = (
            (" (drive)", unit),
            (" rate (drive)", f"{unit}/s"),
            (" acceleration (drive)", f"{unit}/s^2"),
        )
        for k, (suffix, u) in enumerate(names[: 1 if case.leader.steady else 3]):
            moved = {
                s: c.drive[k][row]
                for s, c in view.curves.items()
                if c.drive and not c.by_profile and k <= c.derivatives
            }
            if moved and f"{DRIVE_PREFIX}{drive.joint}{DRIVE_PARTS[k]}" not in equal:
                found[f"{drive.joint}{suffix}"] = np.asarray(profile(view.longest.x)[k]), moved, u
    return found


def drive_rows(view: PlottedRun, names: list[str]) -> list[list[str]]:
    """Arrange panels of drives in rows: one drive in a row, several by order of derivative."""
    each = max(len(names) // max(len(view.case.drive), 1), 1)
    rows = [names[k::each] for k in range(each)] if len(names) > each else [names]
    return [row[k : k + 4] for row in rows for k in range(0, len(row), 4)]


def monotonic_stretches(x: Array, jumps: Iterable[int] = ()) -> list[tuple[slice, bool]]:
    """Split a curve into stretches on which x rises or falls, and tell whether x rises.

    Stretches share the sample at which x turns back, and none at a jump.

    >>> monotonic_stretches(np.array([0.0, 1.0, 2.0, 2.0, 1.0]))
    [(slice(0, 4, None), True), (slice(3, 5, None), False)]
    >>> monotonic_stretches(np.array([0.0, 1.0, 2.0, 3.0, 4.0]), [1])
    [(slice(0, 2, None), True), (slice(2, 5, None), True)]
    """
    steps = np.nan_to_num(np.diff(x))
    moving = np.flatnonzero(np.abs(steps) > 1e-9 * np.nanmax(np.abs(steps), initial=0.0))
    turns = moving[1:][np.diff(np.sign(steps[moving])) != 0]
    edges = [0, *turns.tolist(), len(x) - 1]
    found = list[tuple[slice, bool]]()
    for a, b in pairwise(edges):
        rises, first = bool(x[b] >= x[a]), a
        for jump in sorted(k for k in jumps if a <= k < b):
            found.append((slice(first, jump + 1), rises))
            first = jump + 1
        found.append((slice(first, b + 1), rises))
    return found


def split_at_jumps(x: Array, y: Array, jumps: Iterable[int], limit: int) -> tuple[Array, Array]:
    """Reduce a curve as `thin_curve` does, with NaN where it jumps after a sample.

    >>> split_at_jumps(np.array([0.0, 1.0, 2.0]), np.array([0.0, 5.0, 6.0]), [0], 9)
    (array([ 0., nan,  1.,  2.]), array([ 0., nan,  5.,  6.]))
    """
    edges = [0, *(k + 1 for k in sorted(jumps) if k + 1 < len(x)), len(x)]
    parts = [
        thin_curve(x[a:b], y[a:b], max(limit * (b - a) // len(x), 4)) for a, b in pairwise(edges)
    ]
    gap = np.full(1, np.nan)
    joined = [[column for part in parts for column in (gap, part[k])][1:] for k in (0, 1)]
    return np.concatenate(joined[0]), np.concatenate(joined[1])


def thin_curve(x: Array, y: Array, limit: int) -> tuple[Array, Array]:
    """Reduce a curve to about `limit` points at most: the least and greatest of each stretch.

    >>> x = np.linspace(0, 1, 10_000)
    >>> y = np.where(x == x[777], 5.0, 0.0)
    >>> tx, ty = thin_curve(x, y, 400)
    >>> len(tx) <= 402, ty.max()
    (True, np.float64(5.0))
    """
    if len(x) <= limit:
        return x, y
    each = -(-len(x) // (limit // 2))
    rest = -len(x) % each
    stretches = np.append(y, np.full(rest, np.nan)).reshape(-1, each)
    first, hollow = np.arange(0, len(x) + rest, each), np.isnan(stretches)
    least = first + np.where(hollow, np.inf, stretches).argmin(axis=1)
    most = first + np.where(hollow, -np.inf, stretches).argmax(axis=1)
    index = np.unique(np.concatenate([[0, len(x) - 1], least, most]))
    return x[index], y[index]


def reference_jumps(case: Case, kind: Kind, reference: Curves, curves: Curves) -> Jumps:
    """Find the jumps of the reference's curves; a solver's curves are needed for the time scale."""
    suspected = {
        name: suspected_jumps(curve, scale_of(case, kind, name, curves, curve))
        for name, curve in reference.channels.items()
    }
    every = sorted({k for found in suspected.values() for k in found})
    if not every:
        return Jumps()
    with suppress(Exception):  # a reference that ends between two samples
        fine = finer_reference(case, kind, reference.x, every[:MAX_SUSPECTS])
        return collect_jumps(
            case,
            kind,
            {
                name: [
                    k
                    for k in found
                    if is_jump(reference.x, reference.channels[name], fine, name, k)
                ]
                for name, found in suspected.items()
            },
            reference,
        )
    return Jumps()


def solver_jumps(case: Case, kind: Kind, curves: Curves, reference: Curves, known: Jumps) -> Jumps:
    """Find the jumps of a solver's curves, from its reference and the jumps of that (`known`)."""
    found = {}
    for name, curve in curves.channels.items():
        if name in reference.channels:
            scale = scale_of(case, kind, name, curves, reference.channels[name])
            steps, apart = np.abs(np.diff(curve)), np.abs(np.diff(curve - reference.channels[name]))
            found[name] = [
                k
                for k in suspected_jumps(curve, scale)
                if k in known.of(name) or apart[k] > OWN_STEP_SHARE * steps[k]
            ]
    return collect_jumps(case, kind, found, curves)


def suspected_jumps(curve: Array, scale: float) -> list[int]:
    """Return the samples after which a curve has a step that is much larger than those around it.

    The first and the last step, which have neighbours on one side only, are never suspected.

    >>> suspected_jumps(np.array([0.0, 0.1, 0.2, 0.3, 2.0, 2.1, 2.2]), 2.2)
    [3]
    """
    steps = np.abs(np.diff(curve))
    if steps.size < 3:
        return []
    sides = np.pad(steps, 2)
    around = np.max([sides[:-4], sides[1:-3], sides[3:-1], sides[4:]], axis=0)
    found = np.flatnonzero((steps > MIN_JUMP_SHARE * scale) & (steps > MIN_JUMP_RATIO * around))
    return [k for k in found.tolist() if 0 < k < steps.size - 1]


def finer_reference(case: Case, kind: Kind, x: Array, suspected: Iterable[int]) -> Curves:
    """Evaluate the reference with `FINER_SAMPLES` samples in place of each suspected step."""
    more = [np.linspace(x[k], x[k + 1], FINER_SAMPLES + 1) for k in suspected]
    fine = np.unique(np.concatenate([x, *more]))
    run = plan_run(case, kind, NATIVE_ENGINE)
    return evaluate(case, kind, fine, run.motion(fine) if run.drives else None)


def is_jump(x: Array, curve: Array, fine: Curves, name: str, k: int) -> bool:
    """Whether a step of a curve is still a single step at finer samples."""
    first, last = np.searchsorted(fine.x, x[[k, k + 1]])
    steps = np.abs(np.diff(fine.channels[name][first : last + 1]))
    return bool(
        last - first >= FINER_SAMPLES
        and steps.max() > REMAINING_SHARE * abs(curve[k + 1] - curve[k])
    )


def collect_jumps(case: Case, kind: Kind, found: Mapping[str, list[int]], curves: Curves) -> Jumps:
    """Return the jumps of curves, those of the mechanism apart.

    In a sweep a jump of a place or an angle is a jump of the mechanism, unless an angle jumps by
    whole turns.
    """
    whole = set[int]()
    for name, places in found.items():
        unit, curve = case.channels[name].si_unit, curves.channels[name]
        if kind == "sweep" and unit in ("m", "rad"):
            for k in places:
                step = curve[k + 1] - curve[k]
                way = abs(step - TURN * round(step / TURN)) if unit == "rad" else abs(step)
                if way > REMAINING_SHARE * abs(step):
                    whole.add(k)
    own = {name: tuple(k for k in places if k not in whole) for name, places in found.items()}
    return Jumps(tuple(sorted(whole)), {name: places for name, places in own.items() if places})
