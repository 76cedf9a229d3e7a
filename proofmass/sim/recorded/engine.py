"""Recorded curves of another program or a test rig, which are judged like those of an engine.

No curve is computed from the model; the model only gives the quantity that each channel measures.
A spline interpolates the curves of a CSV file at the samples of a run; its error is stated with
them.
"""

import time
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field

from proofmass.analytic.numerics import Array
from proofmass.errors import InputError
from proofmass.recorded import (
    MIN_ROWS,
    ROW_TOLERANCE,
    RecordedColumn,
    interpolate_recorded,
    nearest_rows,
    read_table,
)
from proofmass.sim.contents import channel_unit
from proofmass.sim.mjcf import compile_model
from proofmass.sim.protocol import (
    BY_CHANNEL,
    BY_JOINT,
    BadModel,
    BadSetting,
    Curves,
    Engine,
    EngineSettings,
    FileName,
    Run,
    StrictNumber,
    Unsupported,
)
from proofmass.strict import Strict

X_UNITS = {"dynamics": ("s",), "equilibrium": ("m",)}
"""Units of the x of a run; that of a sweep is time, or the value of a drive."""


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
    gap: StrictNumber = Field(10.0, gt=1)


class Recording:
    """A recorded file, read by its settings.

    Raises
    ------
    BadSetting
        A column does not exist, or its unit is not stated.
    InputError
        A cell is no finite number, x does not rise, or there is a gap between rows.
    """

    def __init__(self, settings: RecordedSettings) -> None:
        self.settings, self.table = settings, read_table(Path(settings.file))
        self.x = settings.x or RecordedColumn(column=next(iter(self.table.units)))
        columns = {"x": self.x}
        columns |= {f"channels.{name}": one for name, one in settings.channels.items()}
        for joint, drive in settings.drive.items():
            columns |= {f"drive.{joint}.{key}": getattr(drive, key) for key in DRIVE_PARTS}
        for key, column in columns.items():
            try:
                self.table.require(column)
            except ValueError as error:
                raise BadSetting(key, str(error)) from None
        self.rows = self.table.rising(self.x)
        self.curves = {key: self.table.curve(column) for key, column in columns.items()}
        self.spacing = float(np.median(np.diff(self.rows)))
        self.check_spacing()

    def check_spacing(self) -> None:
        """Raise InputError if the spacing of rows is larger somewhere than the setting allows."""
        ratios = np.diff(self.rows) / self.spacing
        k = int(np.argmax(ratios))
        if ratios[k] > self.settings.gap:
            raise InputError(
                self.table.file,
                self.table.line(k + 1),
                f"{self.x.column} goes from {self.rows[k]:.6g} to {self.rows[k + 1]:.6g}, "
                f"{ratios[k]:.3g} times the usual spacing of rows, {self.spacing:.4g} (SI): record "
                f"what is missing, or allow it by gap = {np.ceil(ratios[k]):.0f} in the settings",
            )

    def require(self, key: str, column: RecordedColumn, subject: str, *quantities: str) -> None:
        """Raise InputError unless a column measures one of these quantities, given by SI units."""
        try:
            self.table.require(column, *quantities)
        except ValueError as error:
            raise InputError(self.table.file, key, f"{subject}: {error}") from None

    def has_rows_at_samples(self, run: Run) -> bool:
        """Whether the file has a row at every sample of a run.

        Raises
        ------
        InputError
            The rows do not cover the range of the run, or are too few to interpolate.
        """
        first, last = self.rows[0], self.rows[-1]
        tolerance = ROW_TOLERANCE * self.spacing
        if run.x[0] < first - tolerance or run.x[-1] > last + tolerance:
            raise InputError(
                self.table.file,
                f"column {self.x.column!r}",
                f"it goes from {first:.6g} to {last:.6g} (SI), the {run.kind} from {run.x[0]:.6g} "
                f"to {run.x[-1]:.6g}; nothing is extrapolated: record the rest, or give the run "
                "other samples",
            )
        distances = np.abs(run.x - self.rows[nearest_rows(run.x, self.rows)])
        if (distances <= tolerance).all():
            return True
        if self.rows.size < MIN_ROWS:
            raise InputError(
                self.table.file,
                "",
                f"{self.rows.size} rows are too few to interpolate; record {MIN_ROWS} or more, or "
                "rows at the samples of the run",
            )
        return False


DRIVE_PARTS = ("value", "rate", "acceleration")


def simulate(model: Path, run: Run) -> Curves:
    """Give the curves of a recorded file at the samples of a run.

    Parameters
    ----------
    model : Path
        The MJCF file, which gives the quantity of each channel.
    run : Run
        See `proofmass.sim.protocol.Run`.  Its settings are `RecordedSettings`.

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
    begin = time.perf_counter()
    compiled = compile_model(model, run.rods)
    recording = Recording(RecordedSettings.read(run.settings))
    table, columns = recording.table, recording.settings.channels
    recording.require(
        f"column {recording.x.column!r}", recording.x, f"x of the {run.kind}", *x_units(run)
    )
    for name in (name for name in run.channels if name in columns):
        try:
            unit = channel_unit(compiled, name, run.rods)
        except KeyError as error:
            raise BadModel(f"no sensor {error.args[0]!r}") from None
        if unit is not None:
            key = f"column {columns[name].column!r}"
            recording.require(key, columns[name], f"channel {name}", unit)
    exact = recording.has_rows_at_samples(run)
    channels, uncertainty = dict[str, Array](), dict[str, Array]()
    nearest = nearest_rows(run.x, recording.rows)
    for name in (name for name in run.channels if name in columns):
        curve = recording.curves[f"channels.{name}"]
        if exact:
            channels[name] = curve[nearest]
        else:
            channels[name], uncertainty[name] = interpolate_recorded(run.x, recording.rows, curve)
    return Curves(
        run.x,
        channels,
        missing={
            name: f"the settings name no column of {table.file.name} for it"
            for name in run.channels
            if name not in columns
        },
        drive=recorded_drive(recording, run, exact),
        seconds=time.perf_counter() - begin,
        settings={"x": recording.x.column},
        uncertainty=uncertainty,
        notes=(describe_source(recording, uncertainty),),
    )


def x_units(run: Run) -> tuple[str, ...]:
    """SI units that the x of a run may have."""
    if run.kind in X_UNITS:
        return X_UNITS[run.kind]
    by_value = bool(run.drives) and np.array_equal(run.motion(run.x)[0][0], run.x)
    return ("rad", "m") if by_value else ("s",)


def recorded_drive(
    recording: Recording, run: Run, exact: bool
) -> tuple[Array, Array, Array] | None:
    """The recorded state of the drives; None if the settings name no columns for it.

    Raises
    ------
    InputError
        The settings name columns for some of the drives only, or the file has no rows at the
        samples of the run.  In the latter case the reference would have the unknown error of an
        interpolated state.
    """
    columns = recording.settings.drive
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
        raise InputError(recording.table.file, "", wrong)
    nearest = nearest_rows(run.x, recording.rows)
    value, rate, acceleration = (
        np.array([recording.curves[f"drive.{drive.joint}.{key}"][nearest] for drive in run.drives])
        for key in DRIVE_PARTS
    )
    return value, rate, acceleration


def describe_source(recording: Recording, uncertainty: Mapping[str, Array]) -> str:
    """A sentence on the source of the curves and the error of their interpolation."""
    head = f"recorded in {recording.table.file.name}, {len(recording.table.rows)} rows"
    if not uncertainty:
        return f"{head}, at the samples of the run; nothing is interpolated"
    shares = {
        name: float(error.max()) / (float(np.ptp(recording.curves[f"channels.{name}"])) or 1.0)
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
        """Check the settings and the file that they name; see `Recording`."""
        Recording(RecordedSettings.read(settings))


ENGINE = RecordedCurves()
