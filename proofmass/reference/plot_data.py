"""What a view shows of the reference: its curves by name, their units, and marked places."""

from dataclasses import dataclass

from proofmass.base.arrays import Array
from proofmass.base.errors import suggest_names
from proofmass.base.recording import Recorded
from proofmass.case.case import Case, View
from proofmass.reference.case_model import compiled_model
from proofmass.reference.evaluate import all_quantities, reference_channels
from proofmass.reference.find import load_reference, reference_class
from proofmass.reference.profiles import DRIVE_PREFIX
from proofmass.reference.reference_curves import ComparedCurves
from proofmass.sim.contents import NO_ANGLE, has_no_angle, joints
from proofmass.sim.protocol.curves import Curves


@dataclass(frozen=True)
class PlotData:
    """Values (n,) and units of all names in a view, and marked places on x by their words."""

    values: dict[str, Array]
    units: dict[str, str]
    marks: dict[str, float]


def plot_data(
    case: Case,
    view: View,
    curves: Curves,
    beside: str | None = None,
    reference: Curves | None = None,
) -> PlotData:
    """Evaluate the reference for a view, at the state that the drives really had in a run.

    Parameters
    ----------
    case, view
        The view, and the case that it belongs to.
    curves : Curves
        Curves of a solver; only x, the drives and, if the curves were compared, the stored curves
        of their reference are used.
    beside : str, optional
        Name of a parameter set of the case that replaces the case's own parameters.
    reference : Curves, optional
        The reference's channels at that state, for the case's own parameters, if they are not
        stored with the curves.  The reference is evaluated only where the view names curves that
        are not stored.

    Returns
    -------
    PlotData

    Raises
    ------
    InputError
        A name that is no channel, no driven joint and no quantity of the reference; a missing
        unit; parameters that the reference refuses.
    """
    recorded = case.recorded
    state = None if recorded else curves.drive
    parameters, key = case.parameters, "parameters"
    if beside is not None:
        parameters, key = (
            case.compare_with[beside].parameters,
            f"compare_with.{beside!r}.parameters",
        )
    moved = {d.joint: curves.drive[0][k] for k, d in enumerate(case.drive) if curves.drive}
    own = reference.channels if reference else {}
    known_curves = {**moved, **own}
    if isinstance(curves, ComparedCurves):
        known_curves = {**curves.shown, **moved, **curves.reference, **own}
    asked = {name for some in names_by_key(view).values() for name in some}
    if beside is not None or not asked <= known_curves.keys():
        known = all_quantities(case, case.run_of(view), curves.x, state, parameters, key)
        known_curves = {**known, **moved, **reference_channels(case, curves.x, known)}
    values, units = {}, {}
    for key, names in names_by_key(view).items():
        for name in names:
            if name not in known_curves:
                raise case.error(
                    key_path(case, view, key),
                    f"nothing is called {name!r}; "
                    f"{suggest_names(name, known_curves, 'channels, driven joints, quantities')}",
                )
            if has_no_angle(compiled_model(case), case.start, name):
                raise case.error(key_path(case, view, key), f"{name!r}: {NO_ANGLE}")
            values[name], units[name] = known_curves[name], unit_of_name(case, view, key, name)
    return PlotData(values, units, view_marks(case, view))


def names_by_key(view: View) -> dict[str, tuple[str, ...]]:
    """Return the names that a view uses, by the key of the sidecar."""
    return {
        "x": (view.x,),
        "y": view.y,
        "stack": view.stack,
        "dashed": view.dashed,
    }


def key_path(case: Case, view: View, key: str) -> str:
    """Return the path of a view's key in the sidecar, for messages."""
    return case.table_key("view", case.view.index(view), key)


def unit_of_name(case: Case, view: View, key: str, name: str) -> str:
    """Return the unit of a name in a view.

    It is the unit of the channel or joint with that name, of a channel that equals the quantity, or
    the unit that the view states.  A curve of `dashed` without any has that of the first of `y`.
    """
    reference, given = load_reference(case), "x_unit" if key == "x" else "unit"
    if name in case.channels:
        return case.channels[name].unit
    if name in [d.joint for d in case.drive]:
        return str(joints(compiled_model(case))[name])
    if name.startswith(DRIVE_PREFIX):
        joint, _, part = name.removeprefix(DRIVE_PREFIX).partition(".")
        own = str(joints(compiled_model(case))[joint])
        return own + {"rate": "/s", "acceleration": "/s^2"}.get(part, "")
    if isinstance(reference, Recorded):
        return reference.unit(name)
    stated = next(
        (c.unit for c in case.channels.values() if c.equals == name), getattr(view, given)
    )
    if stated is None and key == "dashed":
        return unit_of_name(case, view, "y", view.y[0])
    if stated is None:
        raise case.error(
            key_path(case, view, given),
            f"missing: no channel equals {name!r}"
            f', so its unit must be given, such as {given} = "N m"',
        )
    return stated


def view_marks(case: Case, view: View) -> dict[str, float]:
    """Return marked places on x by their words, from the sidecar or a function of the reference."""
    if not isinstance(view.marks, str):
        return dict(view.marks)
    key = key_path(case, view, "marks")
    reference = reference_class(case)
    there = {one.__name__: one for one in (reference.marks if reference else ())}
    if view.marks not in there:
        raise case.error(
            key,
            f"reference {case.reference} has no function {view.marks!r}; "
            f"{suggest_names(view.marks, there)}",
        )
    if case.leader is None or view.x != case.leader.joint:
        raise case.error(
            key,
            f"{view.marks}() tells places of the first drive, so x "
            f"must be that joint, not {view.x!r}",
        )
    try:
        return {word: float(x) for word, x in there[view.marks](**case.parameters).items()}
    except (TypeError, ValueError) as error:
        raise case.error(key, str(error)) from None


def check_views(case: Case, run: str, curves: Curves) -> None:
    """Raise InputError if a view of that run cannot be drawn."""
    for view in case.view:
        if case.run_of(view) == run:
            for beside in (None, *case.compare_with):
                found = plot_data(case, view, curves, beside)
            units = {found.units[n] for n in (*view.y, *view.stack, *view.dashed)}
            if len(units) > 1 and (view.stack or view.dashed):
                key = "stack" if view.stack else "dashed"
                raise case.error(
                    key_path(case, view, key),
                    f"one axis, but units {', '.join(sorted(units))}",
                )
