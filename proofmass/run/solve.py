"""Run a case in a simulator: ``solve(case, kind, solver) -> Curves``."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from proofmass.analytic.controls import break_times
from proofmass.base.arrays import Array
from proofmass.base.errors import InputError, model_error, suggest_names
from proofmass.base.strict import Kind
from proofmass.base.worker import Crashed, OutOfMemory, TimedOut, call_isolated
from proofmass.case.case import Case
from proofmass.case.drive import check_driven
from proofmass.case.profile import SampledProfile
from proofmass.reference.case_model import compiled_model
from proofmass.reference.profiles import drive_profiles, load_profiles
from proofmass.reference.recorded_rows import check_reference_rows, describe_rows
from proofmass.reference.samples import run_samples
from proofmass.sim.contents import (
    has_dry_friction,
    joint_of,
    joints,
    why_not_linear_in_control,
    why_not_motor,
)
from proofmass.sim.engines import (
    NoEngine,
    computes_curves,
    engine_of,
    is_engine,
    suggest_engines,
)
from proofmass.sim.protocol.curves import Curves
from proofmass.sim.protocol.failures import BadModel, BadSetting, Diverged, Unsupported
from proofmass.sim.protocol.run import STEP_ROUNDING, ChangingLoad, Drive, Run
from proofmass.sim.protocol.settings import BY_CHANNEL, BY_JOINT, FILE_MARK

if TYPE_CHECKING:
    from proofmass.sim.protocol.tuning import Studied

LIMIT_ROUNDING = 1e-12
"""Distance by which a drive may pass its joint's limit, since it may end on it [rad or m]."""
LARGEST_RATE = 1e150  # [rad/s or m/s] of a motion profile: squares of larger rates are not finite
TURNING_ROUNDING = 1e-9
"""Share of a drive's range by which it may leave the interval between two samples."""
LARGEST_CONTROL = 1e150  # [its unit] of a control: squares of larger forces are not finite
MAX_FORCE_EVALUATIONS = 3e4
"""Largest number of force evaluations in a run of a series; series so end at the same step on any
machine."""
EXPECTED_ERRORS = (
    *(BadModel, InputError, Unsupported, Diverged, MemoryError),
    *(Crashed, TimedOut, OutOfMemory),  # of an interpreter of the engine's own
)
"""What an engine may raise; any other exception is a crash of the run."""
CHECKS_PER_SAMPLE = 20  # intervals into which the time between two samples is divided for checks


def settings_of(case: Case, kind: Kind, solver: str) -> dict[str, Any]:
    """The settings of a solver of a run, checked by its engine.

    A solver is an engine, or ``engine:variant``.  The variant ``default`` stands for the engine's
    own default settings; any other is a table ``[settings."engine:variant"]`` of the sidecar.

    Raises
    ------
    InputError
        There is no such engine or table, or the engine refuses a setting.
    """
    engine, _, variant = solver.partition(":")
    if not is_engine(engine):
        raise case.error(
            f"run.{kind}.solvers", f"no simulator {engine!r}; {suggest_engines(engine)}"
        )
    settings = dict(case.settings.get(solver, {}))
    if variant == "default":
        settings["defaults"] = True
    elif variant and not settings:
        raise case.error(f"run.{kind}.solvers", f'{solver!r} needs a table [settings."{solver}"]')
    table = f'settings."{solver}"' if variant else f"settings.{solver}"
    try:
        of = engine_of(engine)
        for key in of.settings.marked(FILE_MARK):
            if isinstance(name := settings.get(key), str):
                settings[key] = str(case.file.parent / name)
        of.check_settings(settings)
    except NoEngine as error:
        if settings:
            raise case.error(f"run.{kind}.solvers", str(error)) from None
        return settings  # the run reports why the engine cannot be loaded
    except BadSetting as error:
        key, why = error.args
        raise case.error(f"{table}.{key}", why) from None
    for mark, what, there in (
        (BY_CHANNEL, "channel", [*case.channels]),
        (BY_JOINT, "driven joint", [drive.joint for drive in case.drive]),
    ):
        for key in of.settings.marked(mark):
            for name in settings.get(key, ()):
                if name not in there:
                    raise case.error(
                        f"{table}.{key}.{name}",
                        f"no {what} {name!r}; {suggest_names(name, there)}",
                    )
    return settings


def with_computing_solvers(case: Case) -> tuple[Case, tuple[str, ...]]:
    """Reduce a case to the solvers that compute their curves; the other solvers come second.

    A run without such a solver is left out.
    """
    others = dict.fromkeys(
        solver for run in case.run.values() for solver in run.solvers if not computes_curves(solver)
    )
    if not others:
        return case, ()
    runs = {
        kind: run.model_copy(update={"solvers": left})
        for kind, run in case.run.items()
        if (left := tuple(solver for solver in run.solvers if solver not in others))
    }
    return case.model_copy(update={"run": runs}), tuple(others)


def plan_run(case: Case, kind: Kind, solver: str) -> Run:
    """The run of a case that a simulator is asked to make, with the solver's settings.

    Raises
    ------
    InputError
        See `settings_of` and `prescribed_run`.
    """
    settings = settings_of(case, kind, solver)
    return replace(prescribed_run(case, kind), settings=settings)


def describe_dynamics(case: Case) -> "Studied":
    """The description of a case's dynamics run from which an engine lists settings to try."""
    from proofmass.sim.protocol.tuning import Studied  # for studies; a check needs none

    driven = bool(case.drive)
    return Studied(
        compiled_model(case),
        run_samples(case, "dynamics"),
        MAX_FORCE_EVALUATIONS,
        driven,
        driven and not case.recorded,
        lambda: starts_with_jolt(case),
        bool(case.load),
    )


def starts_with_jolt(case: Case) -> bool:
    """Whether a dynamics run starts under gravity or with moving drives."""
    start = run_samples(case, "dynamics")[:1]
    moving = any(
        abs(part).max() > 0
        for profile in drive_profiles(case, "dynamics")
        for part in profile(start)[1:]
    )
    return moving or bool(compiled_model(case).opt.gravity.any())


def prescribed_run(case: Case, kind: Kind) -> Run:
    """The run of a case without settings, which is the same for all simulators.

    Raises
    ------
    InputError
        A motion profile cannot be evaluated, is not finite, or leads a joint out of its range.
    """
    drives = tuple(
        Drive(d.joint, profile)
        for d, profile in zip(case.drive, drive_profiles(case, kind), strict=True)
    )
    channels = tuple(case.channels_of(kind))
    x, inertia = run_samples(case, kind), case.run[kind].inertia
    loads = tuple(
        ChangingLoad(one.actuator, profile)
        for one, profile in zip(case.load, load_profiles(case, kind), strict=True)
    )
    run = Run(kind, x, channels, drives, case.start, {}, case.rods, inertia, loads)
    if case.recorded:
        check_reference_rows(case, kind, x)
    try:
        check_drives(case, run)
        check_loads(case, run)
    except (InputError, MemoryError):
        raise
    except Exception as error:  # a function that the sidecar names may raise anything
        raise case.error(
            "drive.parameters", f"the profile of a drive cannot be evaluated: {error}"
        ) from None
    return run


def check_drives(case: Case, run: Run) -> None:
    """Raise `InputError` if a drive of a run is not finite or leaves the range of its joint.

    Nothing limits an ideal drive: engines ignore the range, or push against it with a spring whose
    force has no meaning.
    """
    if not run.drives:
        return
    model, x = compiled_model(case), run.x
    if run.kind == "sweep" and has_dry_friction(model):
        check_turning_points(case, run)
    if run.kind == "dynamics":
        x = divide_intervals(x)
    units = joints(model)
    for k, (drive, *motion) in enumerate(zip(run.drives, *run.motion(x), strict=True)):
        if drive.joint not in units:  # the engines report it, and list the joints
            continue
        values, unit = motion[0], units[drive.joint]
        check_covered(case, case.drive_key(k, "profile"), drive.profile, run.x)
        largest = [float(np.abs(part).max()) for part in motion]
        if not (np.isfinite(largest).all() and largest[1] < LARGEST_RATE):
            raise case.error(
                case.drive_key(k),
                f"joint {drive.joint!r} is driven to "
                f"{largest[0]:.6g} {unit} at up to {largest[1]:.6g} {unit}/s and "
                f"{largest[2]:.6g} {unit}/s^2; all must be finite, and the rate less "
                f"than {LARGEST_RATE:g}",
            )
        low, high = model.joint(drive.joint).range
        beyond = np.maximum(low - values, values - high)
        if model.jnt_limited[model.joint(drive.joint).id] and beyond.max() > LIMIT_ROUNDING:
            raise case.error(
                case.drive_key(k),
                f"joint {drive.joint!r} is driven to "
                f"{values[beyond.argmax()]:.6g} {unit}, beyond its range in "
                f"{case.model}, {low:.6g} to {high:.6g} {unit}; drive it less far or "
                f"give the joint a wider range",
            )


def check_loads(case: Case, run: Run) -> None:
    """Raise `InputError` if a changing load is not of a motor, or leaves the motor's range.

    In dynamics it may be of a servo as well.
    """
    if not run.loads:
        return
    model, x, fits = compiled_model(case), run.x, why_not_motor
    if run.kind == "dynamics":
        fits = why_not_linear_in_control
        x = divide_intervals(x)
        rows = np.array(break_times(load.profile for load in run.loads))
        x = np.union1d(x, rows[(rows >= x[0]) & (rows <= x[-1])])
    controls = run.controls(x)[0]
    names = [model.actuator(a).name for a in range(model.nactuator)]
    for k, (load, control) in enumerate(zip(run.loads, controls, strict=True)):
        if load.actuator not in names:
            raise case.error(
                case.load_key(k, "actuator"),
                f"{case.model} has no actuator {load.actuator!r}; "
                f"{suggest_names(load.actuator, names)}",
            )
        a = names.index(load.actuator)
        joint = joint_of(model, a)
        if joint >= 0 and model.joint(joint).name in [drive.joint for drive in run.drives]:
            raise case.error(
                case.load_key(k, "actuator"),
                f"{load.actuator!r} acts on joint {model.joint(joint).name!r}, which is driven",
            )
        if why := fits(model, a):
            raise case.error(case.load_key(k, "actuator"), f"{load.actuator!r} {why}")
        check_covered(case, case.load_key(k, "profile"), load.profile, run.x)
        low, high = (
            model.actuator_ctrlrange[a]
            if model.actuator_ctrllimited[a]
            else (-LARGEST_CONTROL, LARGEST_CONTROL)
        )
        beyond = ~((control >= low) & (control <= high))
        if beyond.any():
            raise case.error(
                case.load_key(k),
                f"the control of {load.actuator!r} is {control[beyond.argmax()]:.6g} at x = "
                f"{x[beyond.argmax()]:.6g}; it must lie within {low:.6g} to {high:.6g}",
            )


def divide_intervals(x: Array) -> Array:
    """Return samples with `CHECKS_PER_SAMPLE` intervals from each to the next."""
    places = np.arange(CHECKS_PER_SAMPLE * (x.size - 1) + 1) / CHECKS_PER_SAMPLE
    return np.interp(places, np.arange(x.size), x)


def check_covered(case: Case, key: str, profile: object, x: Array) -> None:
    """Raise InputError if the rows of a sampled profile do not cover the samples of a run."""
    if isinstance(profile, SampledProfile) and not profile.covers(x):
        first, last = profile.times[[0, -1]]
        raise case.error(
            key,
            f"{profile.file} goes from {first:.6g} to {last:.6g} s, the run from {x[0]:.6g} to "
            f"{x[-1]:.6g} s; nothing is extrapolated: give more rows, or an until within them",
        )


def check_turning_points(case: Case, run: Run) -> None:
    """Raise `InputError` if a drive turns back between two samples of a sweep with dry friction.

    With dry friction the poses at rest depend on where a drive turns back, which a sweep from
    sample to sample would miss.
    """
    for k, motion in enumerate(run.motion(divide_intervals(run.x))[0]):
        ends = np.stack(
            [motion[:-1:CHECKS_PER_SAMPLE], motion[CHECKS_PER_SAMPLE::CHECKS_PER_SAMPLE]]
        )
        inside = motion[:-1].reshape(-1, CHECKS_PER_SAMPLE)
        past = np.maximum(
            inside.max(axis=1) - ends.max(axis=0), ends.min(axis=0) - inside.min(axis=1)
        )
        if past.max() > TURNING_ROUNDING * float(np.ptp(motion)):
            first = int(past.argmax())
            raise case.error(
                f"run.{run.kind}.n" if not case.recorded else case.drive_key(k),
                f"joint {run.drives[k].joint!r} turns back between samples {first} and "
                f"{first + 1}, at {run.x[first]:.6g} to {run.x[first + 1]:.6g}; with dry friction "
                "a sweep depends on where: take another n, so that a sample lies there",
            )


def solve(case: Case, kind: Kind, solver: str) -> Curves:
    """Run a case in a simulator, in a process of its own.

    Parameters
    ----------
    case : Case
        The case, from `load_case`.
    kind : "sweep", "dynamics" or "equilibrium"
        The run of the case.
    solver : str
        Engine, or ``engine:variant``.

    Returns
    -------
    Curves

    Raises
    ------
    InputError
        The sidecar or the model is wrong.
    Unsupported, Diverged, Crashed, TimedOut, OutOfMemory
        The run failed.

    Examples
    --------
    >>> from proofmass import load_case, solve
    >>> curves = solve(load_case("models/linkages/fourbar.toml"), "sweep", "mujoco")
    >>> round(float(curves.channels["rocker"][0]), 6)
    2.245928
    """
    limits = case.run[kind]
    return call_isolated(
        solve_here, case, kind, solver, timeout=limits.timeout, memory=limits.memory
    )


def solve_here(case: Case, kind: Kind, solver: str) -> Curves:
    """Do what `solve` does, in this process."""
    run = plan_run(case, kind, solver)
    try:
        curves = call_engine(solver, case.model_path, run)
    except BadModel as error:
        raise model_error(case.model_path, error) from None
    notes = [
        f"{word} {name}: {profile.words}"
        for word, name, profile in (
            *(("drive", drive.joint, drive.profile) for drive in run.drives),
            *(("load", load.actuator, load.profile) for load in run.loads),
        )
        if isinstance(profile, SampledProfile)
    ]
    if case.recorded and (words := describe_rows(case, kind)):
        notes.append(f"reference {case.reference}: {words}")
    if not run.drives and curves.made_step < (1.0 - STEP_ROUNDING) * curves.asked_step:
        notes.append(format_other_step(curves))
    if notes:
        curves = replace(curves, notes=(*curves.notes, *notes))
    if run.drives and curves.drive is None and kind != "equilibrium":
        return replace(curves, drive=run.motion(curves.x), by_profile=True)
    check_driven(run, curves)
    return curves


def format_other_step(curves: Curves) -> str:
    """A phrase on the time step of a run that is shorter than the one that was asked for."""
    return (
        f"steps of {1e3 * curves.made_step:.4g} ms instead of {1e3 * curves.asked_step:.4g} ms, so "
        "that whole steps lead from sample to sample"
    )


def call_engine(engine: str, model: Path, run: Run) -> Curves:
    """Call an engine's ``simulate``; an unexpected exception becomes a crash of the run."""
    try:
        return engine_of(engine).simulate(model, run)
    except NoEngine as error:
        raise Crashed(str(error)) from error
    except EXPECTED_ERRORS:
        raise
    except Exception as error:
        raise Crashed(f"{type(error).__name__}: {error}") from error
