"""Validate a case before anything runs: names, units and motion profiles.

`load_case` has checked the sidecar by itself; `validate_case` checks it against the compiled model
and the reference.
"""

from mujoco import MjModel

from proofmass.base.errors import suggest_names
from proofmass.base.units import same_quantity
from proofmass.case.case import Case
from proofmass.reference.case_model import compiled_model
from proofmass.reference.charts import check_charts
from proofmass.reference.evaluate import reference_for
from proofmass.reference.mobility import mobility
from proofmass.reference.plot_data import check_views
from proofmass.run.solve import prescribed_run, settings_of
from proofmass.sim.contents import (
    NO_ANGLE,
    channel_unit,
    has_no_angle,
    joints,
    key_names,
    sensor_names,
)
from proofmass.sim.engines import computes_curves
from proofmass.sim.protocol.curves import Curves
from proofmass.sim.protocol.failures import BadModel
from proofmass.sim.protocol.run import Run

FIRST_SAMPLES = 2
"""Number of samples at which the reference is evaluated to learn its quantities."""


def validate_case(case: Case) -> None:
    """Raise InputError for the first fault of a case.

    Checked are the start key, the driven joints, the sensors and units of all channels, the
    settings of the solvers, the motion profiles of the drives over the whole run, and the reference
    at the first samples: its parameters, its quantities, and the names in views and charts.
    Over-constrained loops are a fault if the reference does not cover them.
    """
    for kind, table in case.run.items():
        for solver in table.solvers:
            settings_of(case, kind, solver)
    check_noise(case)
    check_model(case, compiled_model(case))
    if compiled_model(case).neq:  # without equalities nothing is over-constrained
        mobility(case)
    for kind in case.run:
        few = first_samples(case, prescribed_run(case, kind))
        reference_for(case, kind, few)
        if case.view:
            check_views(case, kind, few)
    if case.chart:
        check_charts(case)


def check_noise(case: Case) -> None:
    """Raise InputError for a tolerance that is the noise of curves that have none."""
    for kind, table in case.run.items():
        for solver in filter(computes_curves, () if case.recorded else table.solvers):
            for name in case.channels_of(kind):
                tolerance = case.tolerance_for(kind, solver, name)
                if tolerance and tolerance.sigma is not None:
                    raise case.error(
                        f"tolerance.{case.tolerance.index(tolerance)}.sigma",
                        f"it covers channel {name!r} of {solver} in {kind}, where neither the "
                        "reference nor the solver is a recorded file, so that no curve has noise; "
                        "give abs or relative_to_range there, or the solver that is recorded",
                    )


def check_model(case: Case, model: MjModel) -> None:
    """Check the names and units in the sidecar against the compiled model."""
    check_names(case, model)
    for name, channel in case.channels.items():
        delivered = delivered_unit(case, model, name)
        if delivered is not None and not same_quantity(channel.unit, delivered):
            raise case.error(
                f"channels.{name}.unit",
                f"{channel.unit!r} measures "
                f"another quantity than the sensor, which delivers {delivered}",
            )


def check_names(case: Case, model: MjModel) -> None:
    """Check the start key and the driven joints of the sidecar against the compiled model."""
    if model.nkey and case.start not in key_names(model):
        raise case.error(
            "start",
            f"{case.model} has no key {case.start!r}; "
            f"{suggest_names(case.start, key_names(model))}",
        )
    for k, drive in enumerate(case.drive):
        if drive.joint not in joints(model):
            raise case.error(
                case.drive_key(k, "joint"),
                f"{case.model} has no joint {drive.joint!r}; "
                f"{suggest_names(drive.joint, joints(model))}",
            )


def delivered_unit(case: Case, model: MjModel, name: str) -> str | None:
    """Find the SI unit that the sensor of a channel delivers; None if the model does not fix it.

    Raises
    ------
    InputError
        The model has no such sensor, the sensor no such part, or its x axis no angle.
    """
    try:
        unit = channel_unit(model, name, case.rods)
    except KeyError as error:
        there = [*sensor_names(model), *case.rod]
        raise case.error(
            f"channels.{name}",
            f"{case.model} has no sensor {error.args[0]!r}; {suggest_names(error.args[0], there)}",
        ) from None
    except BadModel as error:
        raise case.error(f"channels.{name}", str(error)) from None
    if has_no_angle(model, case.start, name):
        raise case.error(f"channels.{name}", NO_ANGLE)
    return unit


def first_samples(case: Case, run: Run) -> Curves:
    """The prescribed motion at the first samples of a run; at all samples of a recorded curve."""
    x = run.x if case.recorded else run.x[:FIRST_SAMPLES]
    moved = case.drive and run.kind != "equilibrium"
    return Curves(x, {}, drive=run.motion(x) if moved else None)
