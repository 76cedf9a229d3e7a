"""Judge arrays from anywhere against a reference by its name, without a sidecar and an engine.

The columns become the curves of a solver, and a case is made in memory that names the reference:
what judges them is `proofmass.verdict.compare.compare`, as for an engine.
"""

import os
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache
from glob import escape
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from proofmass.analytic.protocol import ClosedForm, InputMotion
from proofmass.base.arrays import Array
from proofmass.base.errors import InputError, suggest_names
from proofmass.base.files import MODEL_ENDING
from proofmass.base.recording import Recorded
from proofmass.base.strict import Kind
from proofmass.base.units import (
    describe_quantity,
    read_quantity,
    same_quantity,
    si_unit,
    unit_powers,
)
from proofmass.case.case import Case, Channel, Tolerance, made_models_folder
from proofmass.case.drive import DriveState
from proofmass.case.inputs import PROGRAM_ENDING, RECORDED_ENDING, is_recorded
from proofmass.reference.case_model import compiled_model
from proofmass.reference.dimensions import Powers, curve_powers, unit_of_powers
from proofmass.reference.evaluate import all_quantities, evaluate
from proofmass.reference.find import load_reference, reference_class
from proofmass.run.sidecar import convert_parameters, describe_invalid, key_of_error
from proofmass.run.validate import delivered_unit
from proofmass.sim.contents import sensor_names
from proofmass.sim.engines import engine_names, engine_of
from proofmass.sim.protocol.curves import Curves
from proofmass.sim.protocol.engine import Engine
from proofmass.sim.protocol.object_run import ChannelOfObject, ObjectRun
from proofmass.verdict.compare import CONSTANT_RANGE, compare
from proofmass.verdict.comparison import Comparisons
from proofmass.verdict.given_columns import (
    GIVEN,
    X_NAMES,
    ColumnSource,
    GivenColumn,
    missing_column,
    read_columns,
    require_rising,
)
from proofmass.verdict.given_drives import (
    DRIVE_PART_NAMES,
    DriveParts,
    drive_tables,
    led_columns,
    read_drives,
    state_of,
)
from proofmass.verdict.own_steps import judge_steps

GIVEN_SOLVER = "recorded:given"
"""The solver of given curves: as for another program's curves, nothing is run again."""
RUN: Kind = "dynamics"
"""The run of given curves: they are over time."""
AS_ASKED = "as asked for"
"""The reason of a tolerance whose reason is not given."""
ALL_COLUMNS = "*"
"""The key of a tolerance of all columns that have none of their own."""


@dataclass(frozen=True)
class GivenCurves:
    """Given curves, and the case in memory by which they are judged."""

    case: Case
    curves: Curves

    def compare(self, detectable: bool = True) -> Comparisons:
        """Compare the curves with the reference."""
        return compare(self.case, RUN, GIVEN_SOLVER, self.curves, detectable)


def judge(
    curves: ColumnSource,
    reference: str | Path | None,
    *,
    parameters: Mapping[str, float | str] | None = None,
    tolerance: float | str | Mapping[str, float | str] | None = None,
    why: str = AS_ASKED,
    equals: Mapping[str, Any] | None = None,
    drive: Any = None,
    units: Mapping[str, str] | None = None,
    x: str | None = None,
    model: Path | str | None = None,
    start: str = "start",
    name: str = "",
    channels: Mapping[str, ChannelOfObject] | None = None,
    duration: float | None = None,
    step: float | None = None,
    every: int = 1,
    detectable: bool = True,
) -> Comparisons:
    """Compare arrays, or a model of an engine's own objects, with a reference; without a sidecar.

    Parameters
    ----------
    curves : Curves, mapping, data frame, path or pymunk.Space
        Arrays (n,) by name, with one of times. A name may end in a unit, ``"theta1 [deg]"``;
        without one the numbers are in SI. A path is that of a CSV file with such names. A space is
        run, see `channels`.
    reference : str, path or None
        Name of a reference, such as ``fourbar``; or a file: a program ``yoke.py``, recorded curves
        ``rig.csv``. None, of a space: it is judged by itself, with shorter and shorter steps.
    parameters : mapping, optional
        Parameters of the reference [SI], or texts with a unit, such as ``"250 mm"``.
    tolerance : float, str or mapping, optional
        A number is a share of the range of each reference curve [1]; a text is an absolute error
        with its unit, such as ``"0.1 deg"``; a mapping has one for each column, ``"*"`` standing
        for all others. Without it errors are found and nothing is judged.
    why : str, optional
        The reason of the tolerance, which is the message of curves that agree.
    equals : mapping, optional
        The quantity of the reference that each column must equal; or a table of a channel, such as
        ``{"equals": "rocker_angle", "scale": -1, "shift": 90}``. By default all columns with the
        name of a quantity are compared.
    drive : str, tuple, list or mapping, optional
        The motion of the drive as it really was: the name of a column, or (value, rate,
        acceleration), each the name of a column, an array or a number. Several drives are a list,
        or a mapping by the names of their joints in a model.
    units : mapping, optional
        Units of columns by name.
    x : str, optional
        The column of times; ``time`` or ``t`` if not given, and the index of a data frame if it has
        neither.
    model : path, optional
        The MJCF, for references that read it, such as ``planar``.
    start : str, optional
        The key of the model from which it starts.
    name : str, optional
        Name of the case in the comparisons; that of the reference if not given.
    channels : mapping, optional
        The columns of a space: ``(body, "angle")``, an object that is added to it and the path of
        an attribute, or a function of the space. A copy of the space is stepped. With a function
        without arguments, ``lambda: body.angle``, the space itself is stepped, which the notes of
        the curves say.
    duration, step : float, optional
        Length of the run of a space, and of its steps [s].
    every : int, optional
        Steps of a space from one sample to the next.
    detectable : bool, optional
        Whether to find `Comparison.detectable` as well.

    Returns
    -------
    Comparisons
        One for each column that is compared.

    Raises
    ------
    InputError
        A column is missing, has another length, a value that is no finite number or an unknown
        unit; a parameter is wrong; the drive lacks a part that a curve needs; a tolerance means
        nothing.

    Examples
    --------
    >>> time = np.linspace(0.0, 1.0, 101)
    >>> swing = {"time": time, "angle": 0.1 * np.cos(3.0 * time)}  # without the term of amplitude^2
    >>> (found,) = judge(swing, "pendulum", tolerance=1e-4,
    ...                  parameters={"length": "1 m", "gravity": 9.0, "amplitude": 0.1,
    ...                              "mass": 1.0})
    >>> found.channel, str(found.outcome), found.message
    ('angle', 'differs', '5.36 x the allowed error')
    """
    if reference is None:
        run = object_run(curves, channels, duration, step, every)
        if run is None:
            raise TypeError("arrays need a reference; None is for a model that can be run again")
        return judge_steps(*run, name)
    given = prepare(
        curves,
        reference,
        channels=channels,
        duration=duration,
        step=step,
        every=every,
        parameters=parameters,
        tolerance=tolerance,
        why=why,
        equals=equals,
        drive=drive,
        units=units,
        x=x,
        model=model,
        start=start,
        name=name,
    )
    return given.compare(detectable)


def object_run(
    thing: ColumnSource,
    channels: Mapping[str, ChannelOfObject] | None,
    duration: float | None,
    step: float | None,
    every: int,
) -> tuple[Engine, Any, ObjectRun] | None:
    """The engine whose object something is, and the run that is asked for; None for arrays.

    Raises
    ------
    InputError
        What a run needs is missing, or is given with arrays.
    """
    asked = {"channels": channels, "duration": duration, "step": step}
    arrays = isinstance(thing, Curves | Mapping | Path | str)
    engines = [] if arrays else map(engine_of, engine_names())
    owner = next((engine for engine in engines if engine.owns(thing)), None)
    if owner is None:
        if extra := [key for key, value in asked.items() if value is not None]:
            raise InputError(GIVEN, extra[0], "it is of a run; leave it out for arrays")
        return None
    if missing := [key for key, value in asked.items() if value is None]:
        raise InputError(GIVEN, missing[0], f"missing: how to run a {type(thing).__name__}")
    return owner, thing, ObjectRun(float(duration or 0), float(step or 0), channels or {}, every)


def prepare(
    curves: ColumnSource,
    reference: str | Path,
    *,
    channels: Mapping[str, ChannelOfObject] | None = None,
    duration: float | None = None,
    step: float | None = None,
    every: int = 1,
    **how: Any,
) -> GivenCurves:
    """What is given, or the curves of its run, and the case that judges them; see `judge`."""
    run = object_run(curves, channels, duration, step, every)
    return given_curves(curves if run is None else run[0].record(*run[1:]), reference, **how)


def given_curves(
    curves: ColumnSource,
    reference: str | Path,
    *,
    parameters: Mapping[str, float | str] | None = None,
    tolerance: float | str | Mapping[str, float | str] | None = None,
    why: str = AS_ASKED,
    equals: Mapping[str, Any] | None = None,
    drive: Any = None,
    units: Mapping[str, str] | None = None,
    x: str | None = None,
    model: Path | str | None = None,
    start: str = "start",
    name: str = "",
) -> GivenCurves:
    """Given curves and their case; see `judge` for the arguments and the errors."""
    stated = {n: one["unit"] for n, one in (equals or {}).items() if is_table(one, "unit")}
    columns = read_columns(curves, {**stated, **(units or {})}, x)
    time = columns.pop(X_NAMES[0])
    require_rising(time)
    drives = read_drives(drive, columns, time)
    state = curves.drive if isinstance(curves, Curves) and not drives else state_of(drives, time)
    bare = bare_case(reference, parameters or {}, time.in_si, model, start, drives, name)
    require_drive_and_model(bare, state, model)
    found = choose_channels(bare, time.in_si, state, columns, led_columns(drive), equals)
    case = make_case({**dict(bare), "channels": found}, bare.file)
    needed = Curves(time.in_si, {one: columns[one].in_si for one in found}, drive=state)
    require_drive_parts(case, needed, drives)
    if isinstance(curves, Curves):
        needed = replace(curves, channels=needed.channels, drive=state)
    case = case.model_copy(update={"tolerance": read_tolerances(case, needed, tolerance, why)})
    return GivenCurves(case, needed)


def require_drive_and_model(case: Case, state: DriveState | None, model: Path | str | None) -> None:
    """Raise `InputError` unless a reference gets the drive and the model that it needs."""
    reference = reference_class(case)
    if reference is not None and issubclass(reference, ClosedForm):
        if reference.is_driven() and state is None:
            raise case.error(
                "drive",
                f"missing: {case.reference} is driven; give the motion of its drive, such as "
                "drive=('angle', 'rate', 'acceleration'), names of columns",
            )
        if not reference.is_driven() and state is not None:
            raise case.error("drive", f"{case.reference} has no drive; leave it out")
    if reference is not None and reference.reads_model and model is None:
        raise case.error("model", f"missing: {case.reference} reads an MJCF; give model='NAME.xml'")


def bare_case(
    reference: Path | str,
    parameters: Mapping[str, float | str],
    times: Array,
    model: Path | str | None,
    start: str,
    drives: DriveParts,
    name: str,
) -> Case:
    """The case of a reference, before its channels are known."""
    place = Path(reference)
    is_file = place.suffix in (PROGRAM_ENDING, RECORDED_ENDING)
    file = place.parent / GIVEN if is_file else GIVEN
    if model is not None and not (Path(model).suffix == MODEL_ENDING and Path(model).is_file()):
        raise InputError(file, "model", f"{os.fspath(model)!r} is no MJCF, a file NAME.xml")
    table: dict[str, Any] = {
        "title": f"curves against {reference}",
        "source": "given",
        "model": str(stub_model() if model is None else os.path.abspath(model)),
        "start": start,
        "reference": place.name if is_file else str(reference),
        "parameters": dict(parameters),
        "drive": () if model is None else drive_tables(drives, times),
        "run": {RUN: run_table(place, times)},
        "channels": {"none": {"equals": 0.0, "unit": "1"}},
        "called": name or place.stem,
    }
    return make_case(convert_parameters(table, file), file)


@cache
def stub_model() -> Path:
    """An MJCF without anything, for references that read no model."""
    file = made_models_folder() / "none.xml"
    file.write_text("<mujoco/>", encoding="utf-8")
    return file


def make_case(table: Mapping[str, Any], file: Path) -> Case:
    """A case of a table.

    Raises
    ------
    InputError
        A value is wrong.
    """
    try:
        return Case(**{**table, "file": file})
    except ValidationError as error:
        first = error.errors()[0]
        raise InputError(file, key_of_error(first, dict(table)), describe_invalid(first)) from None


def run_table(reference: Path, times: Array) -> dict[str, Any]:
    """The run of a case whose samples are given; a recorded reference has its own number."""
    recorded = is_recorded(reference.name)
    own = {} if recorded else {"n": times.size, "until": float(times[-1])}
    return {"solvers": (GIVEN_SOLVER,), **own}


def choose_channels(
    case: Case,
    times: Array,
    state: DriveState | None,
    columns: Mapping[str, GivenColumn],
    led: set[str],
    equals: Mapping[str, Any] | None,
) -> dict[str, dict[str, Any]]:
    """The tables of the channels that are compared.

    Raises
    ------
    InputError
        A column or a quantity is not there, or no column has the name of a quantity.
    """
    known = all_quantities(case, RUN, times, state, dict(case.parameters))
    if equals is None:
        equals = {name: name for name in columns if name in known and name not in led}
        if not equals:
            raise InputError(
                case.file,
                "equals",
                f"no column has the name of a quantity of {case.reference}; columns: "
                f"{', '.join(columns) or 'none'}; {suggest_names('', known)}",
            )
    powers = powers_of_curves(case, times, state)
    found: dict[str, dict[str, Any]] = {}
    for name, wanted in equals.items():
        if name not in columns:
            raise missing_column(f"equals.{name}", name, columns)
        table = dict(wanted) if isinstance(wanted, Mapping) else {"equals": wanted}
        quantity = table.get("equals")
        if isinstance(quantity, str) and quantity not in known:
            raise case.error(
                f"equals.{name}",
                f"{case.reference} has no quantity {quantity!r}; {suggest_names(quantity, known)}",
            )
        found[name] = {**table, "unit": unit_of_column(case, columns[name], quantity, powers)}
    return found


def is_table(value: Any, key: str) -> bool:
    """Whether something is a table with a key."""
    return isinstance(value, Mapping) and key in value


def powers_of_curves(case: Case, times: Array, state: DriveState | None) -> dict[str, Powers]:
    """The powers of length, mass and time of the curves of a closed form, as far as they scale."""
    reference = reference_class(case)
    if reference is None or reference.reads_model:
        return {}
    motion, best = InputMotion(times, state), dict[str, Powers]()
    for slides in (False, True) if state is not None else (False,):
        with suppress(Exception):  # somebody's own reference may refuse other numbers
            found = curve_powers(reference, case.parameters, motion, slides)
            best = max(best, found, key=len)
    return best


def unit_of_column(
    case: Case, column: GivenColumn, quantity: Any, powers: Mapping[str, Powers]
) -> str:
    """The unit of a column: its own, or that of the quantity, as far as this is known.

    It is known of recorded rows, of a sensor of the model, and of a curve of a closed form, see
    `proofmass.reference.dimensions`.

    Raises
    ------
    InputError
        The column's own unit is that of another quantity.
    """
    if case.recorded and column.unit == "1" and isinstance(rows := load_reference(case), Recorded):
        return rows.unit(quantity) if quantity in rows.columns else column.unit
    if quantity in powers:
        known = unit_of_powers(powers[quantity])
        if column.unit == "1":
            return known
        if unit_powers(column.unit)[:3] != powers[quantity]:
            what = "an angle or a number" if known == "1" else describe_quantity(known)
            raise case.error(
                column.name,
                f"its unit {column.unit!r} is {describe_quantity(column.unit)}, and {quantity} of "
                f"{case.reference} is {what}",
            )
    if Path(case.model) == stub_model():
        return column.unit
    model = compiled_model(case)
    if column.name.partition(".")[0] not in sensor_names(model):
        return column.unit
    delivered = delivered_unit(case, model, column.name) or column.unit
    if column.unit == "1":
        return delivered
    if not same_quantity(column.unit, delivered):
        raise case.error(
            column.name,
            f"its unit {column.unit!r} measures another quantity than the sensor, which delivers "
            f"{delivered}",
        )
    return column.unit


def require_drive_parts(case: Case, curves: Curves, drives: DriveParts) -> None:
    """Raise `InputError` if a compared curve depends on a part of a drive that was not given."""
    lacking = [
        (joint, word)
        for joint, parts in drives.items()
        for word, part in zip(DRIVE_PART_NAMES, parts, strict=True)
        if part is None
    ]
    if not lacking:
        return
    time = GivenColumn("time", "s", curves.x)
    ways = [
        evaluate(case, RUN, curves.x, state_of(drives, time, filled)).channels
        for filled in (0.0, 1.0)
    ]
    needing = [n for n in case.channels if not np.array_equal(ways[0][n], ways[1][n])]
    if needing:
        joint, word = lacking[0]
        raise case.error(
            f"drive.{joint}",
            f"channel {needing[0]!r} depends on its {word}, which is not given; give (value, rate, "
            "acceleration)",
        )


def read_tolerances(
    case: Case,
    curves: Curves,
    tolerance: float | str | Mapping[str, float | str] | None,
    why: str,
) -> tuple[Tolerance, ...]:
    """The tolerances of the channels.

    Raises
    ------
    InputError
        One is of no channel, is no number, or is a share of the range of a constant curve.
    """
    if tolerance is None:
        return ()
    by_name = dict(tolerance) if isinstance(tolerance, Mapping) else {ALL_COLUMNS: tolerance}
    if ALL_COLUMNS in by_name:
        by_name = {**dict.fromkeys(case.channels, by_name.pop(ALL_COLUMNS)), **by_name}
    reference = evaluate(case, RUN, curves.x, curves.drive).channels
    found = []
    for name, one in by_name.items():
        key = f"tolerance.{name}" if isinstance(tolerance, Mapping) else "tolerance"
        if name not in case.channels:
            raise case.error(
                key, f"no such column is compared; {suggest_names(name, case.channels)}"
            )
        table: dict[str, Any] = {"channels": (escape(name),), "why": why}
        if isinstance(one, str):
            table["abs"] = read_absolute(case, key, one, case.channels[name])
        else:
            require_range(case, key, name, reference[name])
            table["relative_to_range"] = one
        try:
            found.append(Tolerance(**table))
        except ValidationError as error:
            raise case.error(key, describe_invalid(error.errors()[0])) from None
    return tuple(found)


def read_absolute(case: Case, key: str, text: str, channel: Channel) -> float:
    """An absolute tolerance in the unit of its channel."""
    try:
        if channel.unit == "1":  # the unit of the column was not given
            words = text.split(maxsplit=1)
            unit = si_unit(words[1])[0] if words[1:] else "1"
            return read_quantity(text, unit) if words[1:] else float(text)
        return read_quantity(text, channel.si_unit) / channel.factor
    except ValueError as error:
        raise case.error(key, str(error)) from None


def require_range(case: Case, key: str, name: str, reference: Array) -> None:
    """Raise `InputError` for a share of the range of a curve that is constant."""
    if np.ptp(reference) < CONSTANT_RANGE * np.abs(reference).max() or not np.ptp(reference):
        raise case.error(
            key,
            f"the reference of {name!r} is constant, so that a share of its range means nothing; "
            f"give it an absolute one, as in tolerance={{'*': 1e-3, {name!r}: '0.1 mm'}}",
        )
