"""Recorded curves of another program or a test rig, which are judged like those of an engine.

No curve is computed from the model; the model only gives the quantity that each channel measures.
A spline interpolates the curves of a CSV file at the samples of a run; its error is stated with
them.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field

from proofmass.base.arrays import Array
from proofmass.base.clock import processor_time
from proofmass.base.errors import InputError
from proofmass.base.recorded import LARGEST_GAP, RecordedColumn, read_table
from proofmass.base.recording import PlacedRows, Recording, RunAxis, SteadyDrive
from proofmass.base.strict import Strict, StrictNumber
from proofmass.sim.contents import channel_unit, joints
from proofmass.sim.mjcf import compile_model
from proofmass.sim.protocol.curves import Curves, rows_until
from proofmass.sim.protocol.engine import Engine
from proofmass.sim.protocol.failures import BadModel, BadSetting, Unsupported
from proofmass.sim.protocol.run import Run
from proofmass.sim.protocol.settings import BY_CHANNEL, BY_JOINT, EngineSettings, FileName


class RecordedDrive(Strict):
    """Columns with the recorded motion of a driven joint."""

    value: RecordedColumn
    rate: RecordedColumn
    acceleration: RecordedColumn


class RecordedSettings(EngineSettings):
    """A recorded file, and the quantity of each of its columns.

    `gap` is the largest spacing of rows that is allowed, in multiples of the median spacing.
    """

    file: FileName
    x: RecordedColumn | None = None
    channels: Annotated[dict[str, RecordedColumn], BY_CHANNEL] = Field(min_length=1)
    drive: Annotated[dict[str, RecordedDrive], BY_JOINT] = Field({})
    gap: StrictNumber = Field(LARGEST_GAP, gt=1)


class Export:
    """A recorded file, read by its settings.

    Raises
    ------
    BadSetting
        A column does not exist, or its unit is not stated.
    InputError
        A cell is no finite number, x turns back, or there is a gap between rows.
    """

    def __init__(self, settings: RecordedSettings) -> None:
        self.settings, self.table = settings, read_table(Path(settings.file))
        columns = {f"channels.{name}": one for name, one in settings.channels.items()}
        for joint, drive in settings.drive.items():
            columns |= {f"drive.{joint}.{key}": getattr(drive, key) for key in DRIVE_PARTS}
        for key, column in {"x": settings.x, **columns}.items():
            try:
                if column is not None:
                    self.table.require(column)
            except ValueError as error:
                raise BadSetting(key, str(error)) from None
        try:
            self.recording = Recording(self.table, settings.x)
        except ValueError as error:
            raise BadSetting("x", str(error)) from None
        self.recording.check_gaps(settings.gap)
        self.curves = {key: self.table.curve(column) for key, column in columns.items()}

    def require(self, key: str, column: RecordedColumn, subject: str, *quantities: str) -> None:
        """Raise InputError unless a column measures one of these quantities, given by SI units."""
        try:
            self.table.require(column, *quantities)
        except ValueError as error:
            raise InputError(self.table.file, key, f"{subject}: {error}") from None


DRIVE_PARTS = ("value", "rate", "acceleration")


def simulate(model: Path, run: Run) -> Curves:
    """Give the curves of a recorded file at the samples of a run.

    Parameters
    ----------
    model : Path
        The MJCF file, which gives the quantity of each channel.
    run : Run
        See `proofmass.sim.protocol.run.Run`.  Its settings are `RecordedSettings`.

    Returns
    -------
    Curves
        The channels that have a column, at ``run.x``, with the error of the interpolation as their
        `uncertainty`; and the state of the drives, if it was recorded.

    Raises
    ------
    BadModel
        The model does not compile, or lacks a sensor, or a setting is wrong.
    Unsupported
        The run is passive.
    InputError
        The file has wrong cells, units or a range that is too small.
    """
    if run.kind == "passive":
        raise Unsupported("a model without a sidecar, which names no recorded file")
    begin = processor_time()
    compiled = compile_model(model, run.rods)
    export = Export(RecordedSettings.read(run.settings))
    table, columns = export.table, export.settings.channels
    rows = export.recording.place(run_axis(run, joints(compiled)))
    for name in (name for name in run.channels if name in columns):
        try:
            unit = channel_unit(compiled, name, run.rods)
        except KeyError as error:
            raise BadModel(f"no sensor {error.args[0]!r}") from None
        if unit is not None:
            key = f"column {columns[name].column!r}"
            export.require(key, columns[name], f"channel {name}", unit)
    rows.require(run.x, run.kind)
    exact = rows.have(run.x)
    channels, uncertainty = dict[str, Array](), dict[str, Array]()
    own_rows = dict[str, tuple[Array, Array]]()
    for name in (name for name in run.channels if name in columns):
        curve = export.curves[f"channels.{name}"]
        channels[name], unsure = rows.at(run.x, curve)
        if not exact:
            uncertainty[name] = unsure
        if (own := rows_until(run.x, *rows.rows_of(curve)))[0].size != run.x.size or not exact:
            own_rows[name] = own
    return Curves(
        run.x,
        channels,
        missing={
            name: f"the settings name no column of {table.file.name} for it"
            for name in run.channels
            if name not in columns
        },
        drive=recorded_drive(export, rows, run, exact),
        seconds=processor_time() - begin,
        settings={"x": export.recording.column.column},
        uncertainty=uncertainty,
        rows=own_rows,
        notes=(describe_source(export, rows, uncertainty),),
    )


def run_axis(run: Run, units: Mapping[str, str | None]) -> RunAxis:
    """The x of a run; `units` are the SI units of the joints by name."""
    if run.kind == "equilibrium":
        return RunAxis(run.kind, "m")
    first, width = float(run.x[0]), float(run.x[-1] - run.x[0])
    if not run.drives:
        return RunAxis(run.kind, "s", None, width, first)
    value, rate, acceleration = (part[0] for part in run.motion(run.x))
    by_value = run.kind == "sweep" and np.array_equal(value, run.x)
    unit = units.get(run.drives[0].joint) or "rad"
    constant = float(rate[0])
    if not constant or np.ptp(rate) > 0 or acceleration.any():
        return RunAxis(run.kind, unit if by_value else "s", None, width, first)
    if not by_value:
        steady = SteadyDrive(unit, float(value[0]) - constant * first, constant)
        return RunAxis(run.kind, "s", steady, width, first)
    start = float(getattr(run.drives[0].profile, "start", first))
    steady = SteadyDrive(unit, start, constant)
    return RunAxis(run.kind, unit, steady, width / constant, (first - start) / constant)


def recorded_drive(
    export: Export, rows: PlacedRows, run: Run, exact: bool
) -> tuple[Array, Array, Array] | None:
    """The recorded state of the drives; None if the settings name no columns for it.

    Raises
    ------
    InputError
        The settings name columns for some of the drives only, or the file has no rows at the
        samples of the run.  In the latter case the reference would have the unknown error of an
        interpolated state.
    """
    columns = export.settings.drive
    if not columns or not run.drives:
        return None
    missing = [drive.joint for drive in run.drives if drive.joint not in columns]
    wrong = (
        f"drive: no columns for joint {missing[0]!r}; give all drives or none"
        if missing
        else (
            "drive: its columns are used only if the file has rows at the samples of the run; "
            "record such rows, or leave drive out of the settings: the reference then follows the "
            "profile"
        )
    )
    if missing or not exact:
        raise InputError(export.table.file, "", wrong)
    value, rate, acceleration = (
        np.array(
            [rows.at(run.x, export.curves[f"drive.{drive.joint}.{key}"])[0] for drive in run.drives]
        )
        for key in DRIVE_PARTS
    )
    return value, rate, acceleration


def describe_source(export: Export, rows: PlacedRows, uncertainty: Mapping[str, Array]) -> str:
    """A sentence on the source of the curves and the error of their interpolation."""
    head = f"recorded in {export.table.file.name}, {rows.x.size} rows"
    if rows.words:
        head += f" ({rows.words})"
    if not uncertainty:
        return f"{head}, at the samples of the run; nothing is interpolated"
    shares = {
        name: float(error.max()) / (float(np.ptp(export.curves[f"channels.{name}"])) or 1.0)
        for name, error in uncertainty.items()
    }
    worst = max(shares, key=shares.__getitem__)
    return (
        f"{head}, interpolated by a cubic spline, which may be off by "
        f"{shares[worst]:.2g} of the range ({worst})"
    )


class RecordedCurves(Engine):
    """Recorded curves as an engine of proofmass."""

    title = "Recorded"
    settings = RecordedSettings
    chooses = ()
    computes = False

    def simulate(self, model: Path, run: Run) -> Curves:
        """See `simulate`."""
        return simulate(model, run)

    def check_settings(self, settings: Mapping[str, object]) -> None:
        """Check the settings and the file that they name; see `Export`."""
        Export(RecordedSettings.read(settings))


ENGINE = RecordedCurves()
