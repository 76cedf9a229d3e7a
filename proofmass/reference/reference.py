"""The reference of a case: a module of `analytic/`, or a recorded curve in a file."""

import inspect
import pickle
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from mujoco import MjModel

from proofmass.analytic.numerics import NotCovered
from proofmass.analytic.protocol import Ask, InputMotion, ModelRun, Reference
from proofmass.analytic.remember import call_once
from proofmass.base.arrays import Array
from proofmass.base.errors import InputError, model_error, suggest_names
from proofmass.base.files import content_key
from proofmass.base.recording import (
    LOST_ROW,
    SAME_PLACE,
    PlacedRows,
    Recorded,
    Recording,
    RunAxis,
    SteadyDrive,
)
from proofmass.base.strict import Kind
from proofmass.base.units import same_quantity
from proofmass.case.case import Case, ProfileTable
from proofmass.case.drive import DriveState, FunctionProfile, InProportion, Samples, Steady, Swing
from proofmass.case.profile import SampledProfile, make_sampled_profile, profile_clock
from proofmass.reference.find import load_reference, reference_class
from proofmass.reference.self_consistency import PROCESSOR_SECONDS, Rung, why_failed
from proofmass.sim.contents import channel_names, joints
from proofmass.sim.engines import engine_of
from proofmass.sim.mjcf import NATIVE_ENGINE, compile_model, model_key
from proofmass.sim.protocol.curves import Curves
from proofmass.sim.protocol.failures import BadModel, BadRod, NotSolved, Unsupported
from proofmass.sim.protocol.run import ChangingLoad, Drive, Run

DriveProfile = InProportion | FunctionProfile | SampledProfile | Samples | Steady | Swing
DRIVE_PREFIX, DRIVE_PARTS = "drive.", ("", ".rate", ".acceleration")
"""Names of the prescribed motion of drives: ``drive.crank``, ``drive.crank.rate``, ..."""
if TYPE_CHECKING:
    from mujoco import MjModel

    from proofmass.sim.smooth import SmoothTerms

CONTROL_UNITS = "1", "N", "N m", "m", "rad", "m/s", "rad/s"
"""SI units that the control of a motor or of a servo may have."""
END_SHARE = 0.01
"""Share of a record by which its last row may miss the stated end of a run, if rows are few."""
RESULTS_IN_MEMORY = 64
"""Number of compiled models and read curves in memory; a study tries many numbers of rod links."""
compile_once = lru_cache(RESULTS_IN_MEMORY)(lambda file, content, rods: compile_model(file, rods))
place_once = lru_cache(RESULTS_IN_MEMORY)(Recording.place)


@lru_cache(8)
def smooth_terms(model: "MjModel", start: str = "start") -> "SmoothTerms":
    """MuJoCo's terms of the equations of motion of a model, for the spatial solver."""
    from proofmass.sim.smooth import SmoothTerms  # it loads that solver, which few cases need

    return SmoothTerms(model, start)


@dataclass(frozen=True)
class ReferenceCurves(Curves):
    """Curves of the reference in the run of a case.

    Attributes
    ----------
    shown : dict of str to ndarray (n,)
        Quantities of the reference that views of the run show, by their own names [SI].
    """

    shown: dict[str, Array] = field(default_factory=dict)


@dataclass(frozen=True)
class ComparedCurves(Curves):
    """Curves of a solver, with the reference curves with which they were compared.

    Attributes
    ----------
    reference : dict of str to ndarray (n,)
        Reference curves by channel [SI].
    shown : dict of str to ndarray (n,)
        Quantities of the reference that views of the run show, see `ReferenceCurves` [SI].
    properties : dict of str to str, optional
        The `properties` of the case; None if they were not asked for.
    """

    reference: dict[str, Array] = field(default_factory=dict)
    shown: dict[str, Array] = field(default_factory=dict)
    properties: dict[str, str] | None = None

    @classmethod
    def of(
        cls, curves: Curves, reference: Curves, properties: dict[str, str] | None = None
    ) -> Self:
        """Join curves and the reference with which they are compared."""
        shown = reference.shown if isinstance(reference, ReferenceCurves) else {}
        return cls(**vars(curves), reference=reference.channels, shown=shown, properties=properties)


def reads_model(case: Case) -> bool:
    """Whether the reference reads its numbers from the MJCF, whose errors it then shares."""
    found = reference_class(case)
    return found is not None and found.reads_model


def covers_inertia(case: Case) -> bool:
    """Whether the reference can include inertia in moments and forces."""
    found = reference_class(case)
    return found is not None and found.covers_inertia


def run_samples(case: Case, kind: Kind) -> Array:
    """The samples x (n,) of a run: times [s], drive values, or arc lengths [m] in equilibrium."""
    run, leader = case.run[kind], case.leader
    if case.recorded:
        return reference_rows(case, kind).samples(kind)
    n = run.n or 0
    if kind == "equilibrium":
        return np.linspace(0.0, run.until or min(rod.length for rod in case.rods), n)
    if leader is None or not leader.steady:
        end = run.until or (leader.until or leader.period if leader else None)
        if end is None and leader and isinstance(leader.profile, ProfileTable):
            end = float(sampled_drive_profile(case, kind, 0).times[-1])
        return np.linspace(0.0, end or 0.0, n)
    first, last = leader.start, float(leader.to or 0.0)
    if kind == "sweep":
        return np.linspace(first, last, n)
    return np.linspace(0.0, (last - first) / leader.speed, n)


def steady_drive(case: Case) -> SteadyDrive | None:
    """The first drive, if it has a constant rate."""
    leader = case.leader
    if leader is None or not leader.steady:
        return None
    unit = joints(compiled_model(case)).get(leader.joint) or "rad"
    return SteadyDrive(unit, leader.start, leader.speed)


def time_axis(case: Case, kind: Kind) -> RunAxis:
    """A run in time, also where the x of the run is the value of a drive."""
    leader, steady = case.leader, steady_drive(case)
    duration = case.run[kind].until or (leader.until if leader else None)
    if leader and steady:
        duration = leader.way / steady.rate
    return RunAxis(kind, "s", steady, duration)


def run_axis(case: Case, kind: Kind) -> RunAxis:
    """The x of a run."""
    if kind == "equilibrium":
        return RunAxis(kind, "m")
    axis = time_axis(case, kind)
    if kind == "sweep" and axis.steady:
        return replace(axis, unit=axis.steady.unit)
    return axis


def shared_origin(case: Case, kind: Kind) -> float | None:
    """The time at which a run begins on the clock of the files that drives and loads follow [s].

    All files of a case that are over time have one clock: that of the first of these files.  None
    if no drive and no load follows a file over time.
    """
    for key, profile in case.sampled_profiles:
        if profile.file is not None:
            file = case.file.parent / profile.file
            clock = read_profile(case, key, profile_clock, file, profile)
            if clock.unit == "s":
                return float(clock.clock_origin(time_axis(case, kind)))
    return None


def reference_rows(case: Case, kind: Kind) -> PlacedRows:
    """The rows of a recorded reference on the x of a run.

    In a sweep whose first drive has columns of the reference any x serves, since each row has the
    state of the drives.
    """
    reference = load_reference(case)
    assert isinstance(reference, Recorded)
    axis = run_axis(case, kind)
    if kind == "sweep" and case.leader and isinstance(case.leader.profile, tuple):
        axis = replace(axis, unit=reference.recording.unit)
    placed: PlacedRows = place_once(reference.recording, axis, shared_origin(case, kind))
    return placed


def check_reference_rows(case: Case, kind: Kind, x: Array) -> None:
    """Raise InputError if the rows of a recorded reference contradict a run of the sidecar.

    Parameters
    ----------
    case, kind
        The run.
    x : ndarray (n,)
        Its samples [s, rad or m].
    """
    reference, placed = load_reference(case), reference_rows(case, kind)
    assert isinstance(reference, Recorded)
    for end in stated_ends(case, kind):
        end.check(case, placed)
    if not placed.have(x):
        placed.require(x, kind)
        reference.recording.check_gaps(reference.gap)


def stated_ends(case: Case, kind: Kind) -> Iterator["StatedEnd"]:
    """The ends of a run that the sidecar states."""
    leader, table, steady = case.leader, case.run[kind], steady_drive(case)
    if kind == "equilibrium":
        steady = None
    if leader and steady:
        law = steady if kind == "dynamics" else None
        yield StatedEnd(0, case.drive_key(0, "from"), leader.start, steady.unit, LOST_ROW, law)
        yield StatedEnd(
            -1, case.drive_key(0, "to"), leader.start + leader.way, steady.unit, law=law
        )
        return
    unit = "m" if kind == "equilibrium" else "s"
    by_rows = leader and isinstance(leader.profile, tuple)
    if not (by_rows or case.sampled_profiles or kind == "equilibrium"):
        yield StatedEnd(0, f"run.{kind}", 0.0, unit, LOST_ROW if leader else SAME_PLACE)
    if table.until is not None:
        yield StatedEnd(-1, f"run.{kind}.until", table.until, unit)
    elif leader and leader.until is not None:
        yield StatedEnd(-1, case.drive_key(0, "until"), leader.until, unit)


@dataclass(frozen=True)
class StatedEnd:
    """An end of a run as the sidecar states it.

    Attributes
    ----------
    row : {0, -1}
        Number of the row of a recorded reference that belongs to it.
    key : str
        The key that states it.
    place : float
        The time, the drive's value, or the arc length there [SI].
    unit : str
        Its unit.
    allowed : float
        Largest distance of the row, in multiples of the usual spacing of rows [1].
    law : SteadyDrive, optional
        The drive whose value the place is, if the x of the run is time.
    """

    row: int
    key: str
    place: float
    unit: str
    allowed: float = SAME_PLACE
    law: SteadyDrive | None = None

    def check(self, case: Case, placed: PlacedRows) -> None:
        """Raise InputError if the row is somewhere else."""
        places = self.law.value(placed.x) if self.law else placed.x
        near = self.allowed * float(np.median(np.abs(np.diff(places))))
        if self.row:
            near = min(near, END_SHARE * float(np.ptp(places)))
        at, recording = float(places[self.row]), placed.recording
        if abs(at - self.place) <= near:
            return
        name, table = recording.column.column, recording.table
        cell = table.rows[self.row][1][list(table.units).index(name)].strip()
        which, verb = ("last", "end") if self.row else ("first", "begin")
        found, here = f"{cell} {table.unit_of(recording.column)}", f"{at:.6g} {self.unit}"
        raise case.error(
            self.key,
            f"the run {verb}s at {self.place:.6g} {self.unit}, and the {which} row of "
            f"{table.file.name}, {table.line(self.row)}, is at {name} = {found}"
            + (f", which is {here} of the run" if here != found else "")
            + "; change the sidecar or the rows, or shift the column: [recording] "
            f'x = {{ column = "{name}", shift = .. }}',
        )


def drive_profiles(case: Case, kind: Kind) -> tuple[DriveProfile, ...]:
    """The motion profiles of a run, one for each drive; none for a free motion."""
    return tuple(drive_profile(case, kind, k) for k in range(len(case.drive)))


def drive_profile(case: Case, kind: Kind, k: int) -> DriveProfile:
    """The motion profile of drive number k."""
    drive, reference, leader = case.drive[k], load_reference(case), case.drive[0]
    if kind == "equilibrium":
        return Steady(drive.start, 0.0, x_is_time=True)
    if isinstance(drive.profile, ProfileTable):
        return sampled_drive_profile(case, kind, k)
    if drive.profile is not None or drive.to is None:
        if isinstance(reference, Recorded):
            key = case.drive_key(k, "profile")
            return Samples(
                reference_rows(case, kind).x,
                *(recorded_column(case, reference, key, c) for c in drive.profile or ()),
            )
        shared = drive.profile is None or (
            k == 0 and any(d.profile is None for d in case.drive[1:])
        )
        teller = leader if drive.profile is None else drive
        k_of_teller = case.drive.index(teller)
        own = {one.__name__: one for one in reference.profiles}
        function = own.get(str(teller.profile))
        if function is None:
            raise case.error(
                case.drive_key(k_of_teller, "profile"),
                f"reference {case.reference} has no motion profile {teller.profile!r}; "
                f"{suggest_names(str(teller.profile), own)}",
            )
        takes = list(inspect.signature(function).parameters.values())[1:]
        names = [p.name for p in takes]
        for name in teller.parameters:
            if name not in names and not any(p.kind is p.VAR_KEYWORD for p in takes):
                raise case.error(
                    case.drive_key(k_of_teller, f"parameters.{name}"),
                    f"{teller.profile}() has no such parameter; "
                    f"{suggest_names(name, names, 'known')}",
                )
        return FunctionProfile(function, dict(teller.parameters), k if shared else None)
    if k:
        ratio = drive.way / leader.way
        return InProportion(drive_profile(case, kind, 0), leader.start, ratio, drive.start)
    if drive.period:
        return Swing(drive.start, drive.to, drive.period)
    return Steady(drive.start, drive.speed, x_is_time=kind == "dynamics")


def sampled_drive_profile(case: Case, kind: Kind, k: int) -> SampledProfile:
    """The motion profile of drive number k, which follows the rows of a file."""
    drive = case.drive[k]
    assert isinstance(drive.profile, ProfileTable)
    unit = joints(compiled_model(case)).get(drive.joint) or "rad"
    return sampled_profile(
        case, kind, case.drive_key(k, "profile"), drive.profile, drive.start, unit
    )


def sampled_profile(
    case: Case, kind: Kind, key: str, profile: ProfileTable, start: float, *units: str
) -> SampledProfile:
    """The profile at a key of the sidecar that follows rows, over the x of a run.

    `start` and `units` are those of `make_sampled_profile`.
    """
    axis, origin = time_axis(case, kind), shared_origin(case, kind)
    found: SampledProfile = read_profile(
        case,
        key,
        partial(make_sampled_profile, axis=axis, origin=origin),
        *(case.file.parent, profile, start, *units),
    )
    if kind == "sweep" and axis.steady:
        return replace(found, start=axis.steady.start, rate=axis.steady.rate)
    return found


def load_profiles(case: Case, kind: Kind) -> tuple[DriveProfile, ...]:
    """The profiles of the controls of a run's changing loads, one for each load."""
    return tuple(load_profile(case, kind, k) for k in range(len(case.load)))


def control_profiles(case: Case, kind: Kind) -> dict[str, DriveProfile]:
    """The profiles of `load_profiles`, by the names of the actuators."""
    names = (load.actuator for load in case.load)
    return dict(zip(names, load_profiles(case, kind), strict=True))


def control_values(case: Case, kind: Kind, x: Array, derivative: int) -> dict[str, Array]:
    """Return a derivative of the controls of the actuators with loads, by actuator."""
    at = np.asarray(x, float)
    return {name: one(at)[derivative] for name, one in control_profiles(case, kind).items()}


def load_profile(case: Case, kind: Kind, k: int) -> DriveProfile:
    """The profile of the control of load number k."""
    load = case.load[k]
    if load.profile is not None:
        return sampled_profile(
            case, kind, case.load_key(k, "profile"), load.profile, 0.0, *CONTROL_UNITS
        )
    way, leader = float(load.to or 0.0) - load.start, case.drive[0]
    if leader.to is not None:
        ratio = way / (leader.to - leader.start)
        return InProportion(drive_profile(case, kind, 0), leader.start, ratio, load.start)
    first, last = run_samples(case, kind)[[0, -1]].tolist()
    rate = way / (last - first)
    return Steady(load.start - rate * first, rate, x_is_time=True)


def read_profile(case: Case, key: str, read: Callable[..., Any], *args: object) -> Any:
    """Call a function that reads a profile; its ValueError becomes bad input at a key.

    Raises
    ------
    InputError
        A column of the profile is wrong.
    """
    try:
        return read(*args)
    except ValueError as error:
        raise case.error(key, str(error)) from None


def reference_for(case: Case, run: Kind, curves: Curves) -> Curves:
    """The reference at the state that the drives really had in a run."""
    return evaluate(case, run, curves.x, curves.drive)


def evaluate(
    case: Case, kind: Kind, x: Array, state: DriveState | None, **changed: float
) -> ReferenceCurves:
    """The reference curves of a run of a case, channel by channel.

    The reference is evaluated in this process, without limits of time or memory, and with as many
    threads as BLAS has here.  Workers have one thread, so that last digits may differ.

    Parameters
    ----------
    case : Case
        Has the name of the reference and its parameters.
    kind : str
        The run.
    x : ndarray (n,)
        Time [s] or drive value.
    state : tuple of three ndarray (drives, n), or None
        Drive values, rates and accelerations, *as the drives really moved*; None: a free motion.
    **changed
        Parameters that replace the sidecar's [SI].

    Returns
    -------
    ReferenceCurves
        One curve for each channel, by the channel's name, in SI units; and the quantities that
        views show, unless parameters are changed.
    """
    parameters = {**case.parameters, **changed}
    names = frozenset(c.equals for c in case.channels.values() if isinstance(c.equals, str))
    more = frozenset[str]() if changed else names_in_views(case, kind) - case.channels.keys()
    known = reference_quantities(case, kind, x, state, parameters, only=names | more)
    if any(name.startswith(DRIVE_PREFIX) for name in names | more):
        known = known | prescribed_quantities(case, kind, x)
    if not names <= known.keys():  # an error; its message suggests one of all names
        known = all_quantities(case, kind, x, state, parameters)
    shown = {name: known[name] for name in more if name in known}
    channels = reference_channels(case, x, known)
    unsure = interpolation_errors(case, kind, x) if case.recorded else {}
    return ReferenceCurves(x, channels, shown=shown, uncertainty=unsure)


def names_in_views(case: Case, kind: Kind) -> frozenset[str]:
    """All names in the views of a run."""
    return frozenset(
        name
        for view in case.view
        if case.run_of(view) == kind
        for name in (view.x, *view.y, *view.stack, *view.dashed)
    )


def all_quantities(
    case: Case,
    kind: Kind,
    x: Array,
    state: DriveState | None,
    parameters: dict[str, float | str],
    key: str = "parameters",
) -> dict[str, Array]:
    """All curves that a channel may equal: `reference_quantities` and `prescribed_quantities`."""
    return {
        **reference_quantities(case, kind, x, state, parameters, key),
        **prescribed_quantities(case, kind, x),
    }


def reference_quantities(
    case: Case,
    kind: Kind,
    x: Array,
    state: DriveState | None,
    parameters: dict[str, float | str],
    key: str = "parameters",
    only: frozenset[str] | None = None,
) -> dict[str, Array]:
    """Evaluate the reference's quantities, by their own names.

    `kind`, `x` and `state` are those of `evaluate`.  `parameters` stand in the sidecar at `key`.
    If `only` is given, the reference may leave out other quantities.
    """
    reference = load_reference(case)
    if not isinstance(reference, Recorded):
        return call_reference(case, kind, reference, x, state, parameters, key, only)
    if parameters:
        raise case.error(key, "the reference is a recorded curve, which has none")
    placed, known = reference_rows(case, kind), dict[str, Array]()
    for name in reference.columns if only is None else only & reference.columns.keys():
        try:
            known[name] = placed.at(np.asarray(x, float), reference.curve(name))[0]
        except (InputError, ValueError):  # such as texts in a column that no channel equals
            if only is not None:
                recorded_column(case, reference, "reference", name)
    return known


def interpolation_errors(case: Case, kind: Kind, x: Array) -> dict[str, Array]:
    """The errors that channels of a recorded reference may have between its rows [SI].

    Channels are left out if all samples x (n,) are at rows.
    """
    reference, placed = load_reference(case), reference_rows(case, kind)
    assert isinstance(reference, Recorded)
    if placed.have(x):
        return {}
    return {
        name: abs(channel.scale) * placed.at(x, reference.curve(channel.equals))[1]
        for name, channel in case.channels_of(kind).items()
        if isinstance(channel.equals, str) and channel.equals in reference.columns
    }


def describe_rows(case: Case, kind: Kind) -> str:
    """A sentence on the x of a recorded reference and its interpolation; empty without either."""
    reference, placed, x = load_reference(case), reference_rows(case, kind), run_samples(case, kind)
    assert isinstance(reference, Recorded)
    words, errors = [placed.words] if placed.words else [], interpolation_errors(case, kind, x)
    if errors:
        share = max(
            float(error.max()) / (float(np.ptp(abs(c.scale) * reference.curve(c.equals))) or 1.0)
            for name, error in errors.items()
            if isinstance((c := case.channels[name]).equals, str)
        )
        words.append(
            f"its {placed.x.size} rows are at uneven times; it is interpolated at even times by a "
            f"cubic spline, which may be off by {share:.2g} of the range"
        )
    return "; ".join(words)


def prescribed_quantities(case: Case, kind: Kind, x: Array) -> dict[str, Array]:
    """The prescribed motion of drives: ``drive.JOINT``, ``drive.JOINT.rate``, ``.acceleration``.

    A channel that equals one of them is compared with the motion profile, and not with the motion
    that the drive really had.
    """
    return {
        f"{DRIVE_PREFIX}{drive.joint}{part}": np.broadcast_to(values, np.shape(x))
        for drive, profile in zip(case.drive, drive_profiles(case, kind), strict=True)
        for part, values in zip(DRIVE_PARTS, profile(np.asarray(x, float)), strict=True)
    }


def reference_channels(case: Case, x: Array, known: dict[str, Array]) -> dict[str, Array]:
    """The curve that each channel must have, from the reference's quantities; both in SI units."""
    reference, wanted = load_reference(case), {}
    for name, channel in case.channels.items():
        if isinstance(channel.equals, float):
            level = channel.scale * channel.equals + channel.shift
            wanted[name] = np.full(np.shape(x), level * channel.factor)
            continue
        if isinstance(reference, Recorded) and not channel.equals.startswith(DRIVE_PREFIX):
            recorded_column(
                case, reference, f"channels.{name}.equals", channel.equals, channel.unit
            )
        elif channel.equals not in known:
            raise case.error(
                f"channels.{name}.equals",
                f"no quantity {channel.equals!r}; {suggest_names(channel.equals, known)}",
            )
        value = np.broadcast_to(known[channel.equals], np.shape(x))
        wanted[name] = channel.scale * value + channel.shift * channel.factor
    return wanted


def call_reference(
    case: Case,
    kind: Kind,
    reference: type[Reference],
    x: Array,
    state: DriveState | None,
    parameters: dict[str, float | str],
    key: str = "parameters",
    only: frozenset[str] | None = None,
) -> dict[str, Array]:
    """Call a reference, and turn its errors into bad input at `key` of the sidecar.

    The last results of references that do not read the model are kept, see `call_once`; the others
    have a memory of their own, as models may change.
    """
    require_known(case, reference, parameters, key)
    rates: dict[str, Array] = {}
    if case.load:
        parameters, rates = scale_parameters(case, kind, reference, x, parameters)
    motion = InputMotion(np.asarray(x), state)
    ask = Ask(
        inertia=reference.covers_inertia and case.has_inertia(kind),
        wanted=only,
        load_rates=rates,
        run=model_run(case, kind, x) if reference.reads_model else None,
    )
    try:
        if reference.reads_model:
            return reference.evaluate(parameters, motion, ask)
        return call_once(reference.evaluate, parameters, motion, ask)
    except NotCovered as error:
        raise InputError(
            case.model_path, "", f"the reference {case.reference!r} does not cover it: {error}"
        ) from None
    except (TypeError, ValueError) as error:
        key = key if parameters else "drive" if case.drive else "model"
        raise case.error(key, str(error)) from None


def require_known(
    case: Case, reference: type[Reference], parameters: Mapping[str, Any], key: str
) -> None:
    """Raise InputError for a parameter that the reference does not have."""
    there = list(reference.parameters)
    for name in parameters:
        if name not in there:
            raise case.error(
                f"{key}.{name}",
                f"reference {case.reference} has no "
                f"such parameter; {suggest_names(name, there, 'known')}",
            )


def model_run(case: Case, kind: Kind, x: Array) -> ModelRun:
    """The model of a case and what moves it in a run, for references that read the model."""
    in_time = kind == "dynamics"
    times = np.asarray(x, float)
    return ModelRun(
        model=compiled_model(case),
        start=case.start,
        joints=tuple(drive.joint for drive in case.drive),
        controls=control_values(case, kind, x, 0),
        control_rates=control_values(case, kind, x, 1),
        in_time=(times, drive_profiles(case, kind)) if in_time and case.drive else None,
        control_profiles=control_profiles(case, kind) if in_time else {},
        terms=lambda: smooth_terms(compiled_model(case), case.start),
        solve_closely=partial(solve_closely, case, kind),
        evidence=lambda: solve_closely_with_evidence(case, times)[1],
    )


def scale_parameters(
    case: Case, kind: Kind, reference: type[Reference], x: Array, parameters: Mapping[str, Any]
) -> tuple[dict[str, Any], dict[str, Array]]:
    """Turn the parameters that loads scale into curves (n,), and find the rates of these.

    Raises
    ------
    InputError
        The reference has no such parameter, or one that may not change along a path.
    """
    may = [
        name for name, one in reference.parameters.items() if name in parameters and one.may_change
    ]
    found, rates = dict(parameters), dict[str, Array]()
    for k, (load, profile) in enumerate(zip(case.load, load_profiles(case, kind), strict=True)):
        if not may and not reference.follows_controls:
            raise case.error(
                case.load_key(k),
                f"the reference {case.reference!r} covers no load that changes",
            )
        if not load.scales and not reference.follows_controls:
            raise case.error(
                case.load_key(k, "scales"),
                f"missing: which parameters of {case.reference} the load multiplies; "
                f"{suggest_names('', may, 'those of this case that may change')}",
            )
        control, rate, _ = np.broadcast_arrays(*profile(np.asarray(x, float)))
        for name in load.scales:
            if name not in may:
                raise case.error(
                    case.load_key(k, "scales"),
                    f"{name!r} is no parameter of this case that {case.reference} lets change "
                    f"along a path; {suggest_names(name, may, 'those that may')}",
                )
            found[name], rates[name] = parameters[name] * control, parameters[name] * rate
    return found, rates


def solve_closely(case: Case, kind: Kind, x: Array) -> dict[str, Array]:
    """Find all sensors of a model at times x [s], solved without a simulator's time steps.

    Raises
    ------
    NotCovered
        The motion cannot be solved this way, or is not known until the last time.
    """
    if case.rod:
        raise NotCovered("rods")
    if kind != "dynamics":
        raise NotCovered(f"a run of {kind}; it is a motion in time")
    if x.size < 2:
        raise NotCovered("a single moment; give a run of some length")
    return solve_closely_with_evidence(case, x)[0]


def solve_closely_with_evidence(case: Case, x: Array) -> tuple[dict[str, Array], str]:
    """All sensors at times x [s], and the evidence that the motion is known."""
    file = case.model_path
    led = zip(case.drive, drive_profiles(case, "dynamics"), strict=True)
    drives = tuple(Drive(drive.joint, profile) for drive, profile in led)
    loads = tuple(ChangingLoad(*one) for one in control_profiles(case, "dynamics").items())
    inputs = pickle.dumps((drives, loads))
    return solve_closely_once(file, model_key(file), case.start, x.tobytes(), inputs)


@lru_cache(8)
def solve_closely_once(
    file: Path, content: tuple[str, ...], start: str, x: bytes, inputs: bytes
) -> tuple[dict[str, Array], str]:
    """Do what `solve_closely_with_evidence` does; a cache by times, drives and loads as bytes."""
    equations, times = engine_of(NATIVE_ENGINE).own_equations, np.frombuffer(x)
    drives, loads = pickle.loads(inputs)
    end = float(times[-1])
    motion = equations.solve_motion(file, end, times.size, PROCESSOR_SECONDS, start, drives, loads)
    if failed := why_failed(motion):
        raise NotCovered(f"the model itself fails: {failed}")
    rung = Rung(motion)
    if not rung.is_sure:
        raise NotCovered(f"its motion is not known until {times[-1]:.3g} s: {rung.words()}")
    names = channel_names(compile_once(file, content, ()), start).values()
    run = Run("dynamics", times, tuple(chain(*names)), drives, start, loads=loads)
    try:
        return equations.solve_closely(file, run).channels, rung.words()
    except (Unsupported, NotSolved) as error:
        raise NotCovered(str(error)) from None


def properties(case: Case, beside: str | None = None) -> dict[str, str]:
    """Properties of the mechanism as a whole, such as its class, limits and stroke, if any."""
    reference = reference_class(case)
    if reference is None:
        return {}
    known = describe_error(reference)
    if reference.properties is Reference.properties:
        return known
    parameters = case.parameters if beside is None else case.compare_with[beside].parameters
    kind = next(iter(case.run))
    x, ask = run_samples(case, kind), Ask()
    motion = InputMotion(x)
    if reference.reads_model:  # the prescribed motion, of the model itself
        ask = Ask(run=model_run(case, kind, x))
        drives = [np.broadcast_arrays(*one(x)) for one in drive_profiles(case, kind)]
        if drives:
            value, rate, acceleration = map(np.array, zip(*drives, strict=True))
            motion = InputMotion(x, (value, rate, acceleration))
    try:
        return {**reference(**parameters).properties(motion, ask), **known}
    except (TypeError, ValueError):  # the parameters are wrong, which the runs report
        return {}


def describe_error(reference: type[Reference]) -> dict[str, str]:
    """The own error of a reference in words; empty if it is not known."""
    own = reference.own_error
    if own is None:
        return {}
    words = f"below {own.error:.0e} of a curve, confirmed by {own.confirmed_by}"
    return {"error of the reference": words}


def compiled_model(case: Case) -> MjModel:
    """The case's compiled MJCF; it is compiled once for all runs."""
    try:
        return compile_once(case.model_path, model_key(case.model_path), case.rods)
    except BadRod as error:
        rod, key, why = error.args
        raise case.error(f"rod.{rod}.{key}", why) from None
    except BadModel as error:
        raise model_error(case.model_path, error) from None


def reference_identity(case: Case) -> tuple[str | int, ...]:
    """A key that differs for cases with different reference curves: their tables and files."""
    asked = repr(case.model_copy(update={"settings": {}, "tolerance": ()}).model_dump())
    files = [case.file.parent / case.reference] if case.recorded or case.program else []
    return asked, *model_key(case.model_path), *map(content_key, [*case.profile_files, *files])


def recorded_column(
    case: Case, reference: Recorded, key: str, name: str, unit: str | None = None
) -> Array:
    """A column of the recorded curve; its unit is checked if `unit` is given."""
    if name not in reference.columns:
        raise case.error(
            key,
            f"no column {name!r} in {case.reference}; {suggest_names(name, reference.columns)}",
        )
    try:
        own = reference.unit(name)
    except ValueError as error:
        raise case.error(key, str(error)) from None
    if unit is not None and not same_quantity(own, unit):
        raise case.error(
            key,
            f"column {name!r} of {case.reference} is in {own} (SI), the channel in {unit}",
        )
    return reference.curve(name)


def assembly_modes(case: Case) -> tuple[int, ...]:
    """Assembly modes that the reference offers; empty if it offers no choice."""
    found = reference_class(case)
    return () if found is None else found.modes()


def parameter_unit(case: Case, parameter: str) -> str:
    """The SI unit of a parameter of the reference; empty if it has none."""
    found = reference_class(case)
    if found is None or parameter not in found.parameters:
        return ""
    return found.parameters[parameter].unit
