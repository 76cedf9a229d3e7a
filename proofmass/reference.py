"""The truth of a case: a closed form in `analytic/`, or a recorded curve beside the sidecar."""

import importlib
import inspect
import pkgutil
from functools import cache
from types import ModuleType

import numpy as np

import analytic
from proofmass.case import Case, Kind
from proofmass.drive import Law, Samples, State, Steady
from proofmass.errors import InputError
from proofmass.recorded import Recorded, read_recorded
from sim.protocol import Array, Curves

read_once = cache(lambda file, changed: read_recorded(file))


def module_of(case: Case) -> ModuleType | Recorded:
    """The reference's module in `analytic/`, or the recorded curve."""
    if case.reference.endswith(".csv"):
        file = case.file.parent / case.reference
        return read_once(file, file.stat().st_mtime_ns if file.is_file() else None)
    names = [m.name for m in pkgutil.iter_modules(analytic.__path__)]
    if case.reference not in names:
        raise InputError(case.file, "reference", f"no closed form {case.reference!r}; there are: "
                         f"{', '.join(names)}; or name a recorded curve NAME.csv")
    return importlib.import_module(f"analytic.{case.reference}")


def grid(case: Case, kind: Kind) -> Array:
    """Where a run is sampled."""
    truth, run, drive = module_of(case), case.run[kind], case.drive
    if isinstance(truth, Recorded):
        return truth.x
    n = run.n or 0
    if drive is None or drive.to is None:
        end = run.until or (drive.until if drive else None)
        return np.linspace(0.0, end or 0.0, n)
    if kind == "sweep":
        return np.linspace(drive.start, drive.to, n)
    return np.linspace(0.0, (drive.to - drive.start) / drive.rate, n)


def law(case: Case, kind: Kind) -> Steady | Law | Samples | None:
    """The drive law of a run; None for a free motion."""
    drive, truth = case.drive, module_of(case)
    if drive is None:
        return None
    if drive.to is not None:
        return Steady(drive.start, drive.rate, x_is_time=kind == "duration")
    if isinstance(truth, Recorded):
        return Samples(truth.x, *(column(case, truth, "drive.law", c) for c in drive.law or ()))
    function = getattr(truth, str(drive.law), None)
    if function is None:
        raise InputError(case.file, "drive.law", f"analytic/{case.reference}.py has no function "
                         f"{drive.law!r}")
    return Law(function, dict(drive.parameters))


def evaluate(case: Case, x: Array, state: State | None, **changed: float) -> Curves:
    """The reference curves of a case, channel by channel.

    Parameters
    ----------
    case : Case
        Names the reference and holds its parameters.
    x : ndarray (n,)
        Time [s] or drive value.
    state : tuple of three ndarray (n,), or None
        Drive value, rate and acceleration, *as the drive really moved*; None: a free motion.
    **changed
        Parameters to use instead of the sidecar's.

    Returns
    -------
    Curves
        One curve a channel, under the channel's name.
    """
    truth = module_of(case)
    if isinstance(truth, Recorded):
        quantities = truth.columns
        for name, channel in case.channels.items():
            column(case, truth, f"channels.{name}.equals", channel.equals, channel.unit)
    else:
        quantities = call(case, truth, (x,) if state is None else state, changed)
    wanted = {}
    for name, channel in case.channels.items():
        if channel.equals not in quantities:
            raise InputError(case.file, f"channels.{name}.equals", f"no quantity "
                             f"{channel.equals!r}; there are: {', '.join(quantities)}")
        value = np.broadcast_to(quantities[channel.equals], np.shape(x))
        wanted[name] = channel.scale * value + channel.shift
    return Curves(x, wanted)


def call(case: Case, truth: ModuleType, args: tuple, changed: dict) -> dict[str, Array]:
    """``solve`` of a closed form, with its complaints turned into errors of the sidecar."""
    parameters = {**case.parameters, **changed}
    known = [p.name for p in inspect.signature(truth.solve).parameters.values()
             if p.kind is p.KEYWORD_ONLY]
    for key in parameters:
        if key not in known:
            raise InputError(case.file, f"parameters.{key}", f"analytic/{case.reference}.py has no "
                             f"such parameter; known: {', '.join(known)}")
    try:
        return truth.solve(*args, **parameters)
    except (TypeError, ValueError) as error:
        raise InputError(case.file, "parameters", str(error)) from None


def column(case: Case, truth: Recorded, key: str, name: str, unit: str | None = None) -> Array:
    """A column of the recorded curve, its unit checked."""
    if name not in truth.columns:
        raise InputError(case.file, key, f"no column {name!r} in {case.reference}; there are: "
                         f"{', '.join(truth.columns)}")
    if unit is not None and truth.units[name] != unit:
        raise InputError(case.file, key, f"column {name!r} of {case.reference} is in "
                         f"{truth.units[name]} (SI), the channel in {unit}")
    return truth.columns[name]


def modes(case: Case) -> tuple[int, ...]:
    """Assembly modes that the closed form knows; empty when it has no such choice."""
    return getattr(module_of(case), "MODES", ())
