"""Evaluate the reference of a case along a run: curves by channel, and properties in words."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from proofmass.analytic.numerics import NotCovered
from proofmass.analytic.protocol import Ask, BadCurves, InputMotion, Reference
from proofmass.analytic.remember import call_once
from proofmass.base.arrays import Array
from proofmass.base.errors import InputError, suggest_names
from proofmass.base.recording import Recorded
from proofmass.base.strict import Kind
from proofmass.case.case import Case
from proofmass.case.drive import DriveState
from proofmass.reference.find import (
    is_shipped,
    load_reference,
    place_of_error,
    reference_class,
    source_file,
)
from proofmass.reference.model_run import model_run
from proofmass.reference.profiles import (
    DRIVE_PREFIX,
    drive_profiles,
    load_profiles,
    prescribed_quantities,
)
from proofmass.reference.recorded_rows import (
    interpolation_errors,
    recorded_column,
    rows_of_channels,
)
from proofmass.reference.reference_curves import ReferenceCurves
from proofmass.reference.samples import reference_rows, run_samples
from proofmass.sim.protocol.curves import Curves


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
    if not changed and np.isfinite(x).all() and (state is None or np.isfinite(state).all()):
        require_finite(case, kind, x, channels)
    unsure = interpolation_errors(case, kind, x) if case.recorded else {}
    rows = rows_of_channels(case, kind, x) if case.recorded else {}
    return ReferenceCurves(x, channels, shown=shown, uncertainty=unsure, rows=rows)


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
    except BadCurves as error:
        raise case.error("reference", f"{source_file(reference).name}: {error}") from None
    except Exception as error:
        require_bad_input(case, reference, error)
        key = key if parameters else "drive" if case.drive else "model"
        place = place_of_error(error, reference)
        raise case.error(key, f"{place}: {error}" if place else str(error)) from None


def require_bad_input(case: Case, reference: type[Reference], error: Exception) -> None:
    """Raise an error of a reference again, unless it says that the sidecar is wrong.

    Raises
    ------
    InputError
        The error is a fault of a program of somebody's own, whose line it names.
    Exception
        The error is one of proofmass, or of the computer.
    """
    if isinstance(error, ValueError):
        return
    place = place_of_error(error, reference)
    if place and not isinstance(error, MemoryError):
        words = " ".join(f"{place}: {type(error).__name__}: {error}".split())
        raise case.error("reference", words) from error
    if not isinstance(error, TypeError):
        raise error


def require_finite(case: Case, kind: Kind, x: Array, channels: Mapping[str, Array]) -> None:
    """Raise InputError for a curve of somebody's own reference that is no number at some x.

    References of proofmass have NaN where there is no pose, such as beyond the fold of a rod.
    """
    reference = reference_class(case)
    if reference is None or is_shipped(reference):
        return
    for name in case.channels_of(kind):
        bad = np.flatnonzero(~np.isfinite(channels[name]))
        if bad.size:
            raise case.error(
                "reference",
                f"{source_file(reference).name}: curve {case.channels[name].equals!r} is "
                f"{channels[name][bad[0]]} at x = {x[bad[0]]:g} of run.{kind}, and must be a "
                "number; where the mechanism has no pose, raise a ValueError that says why",
            )


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
    except Exception as error:
        require_bad_input(case, reference, error)
        return {}  # the parameters are wrong, which the runs report


def describe_error(reference: type[Reference]) -> dict[str, str]:
    """The own error of a reference in words; empty if it is not known."""
    own = reference.own_error
    if own is None:
        return {}
    words = f"below {own.error:.0e} of a curve, confirmed by {own.confirmed_by}"
    return {"error of the reference": words}
