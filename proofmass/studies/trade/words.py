"""Describe settings, errors, error floors, and how far a series came, in words."""

from math import isfinite

from proofmass.base.wording import number
from proofmass.sim.engines import format_solver
from proofmass.studies.record import NAN, StudyRow
from proofmass.studies.trade.orders import ORDER_TOLERANCE
from proofmass.studies.trade.series import (
    ASYMPTOTIC_ERROR,
    MeasuredSeries,
    final_order,
    find_worse_pair,
    is_constant,
    observed_order,
)
from proofmass.studies.trade.verdict import Verdict
from proofmass.verdict.outcome import Outcome

STATED_ERROR = 1e-4
"""Error [share of the range] for which the needed step of a series is stated."""
DRIVE_ERROR_RATIO = 1.5
"""Ratio of the error at the prescribed motion to that at the motion that drives really had, above
which most of the error is that of the drives."""

TIME_UNITS = (("s", 1.0), ("ms", 1e3), ("µs", 1e6))
"""Units of times, and how many are a second."""


def format_setting(row: StudyRow) -> str:
    """Describe a setting: its series, and the value of the varied parameter.

    >>> row = StudyRow("", "", "", "pymunk", "pymunk at 1 ms, iterations", "iterations", 30)
    >>> format_setting(row)
    'pymunk at 1 ms, iterations 30'
    """
    place = format_varied(row)
    return (
        f"{row.series.removesuffix(row.varied)}{place}"
        if row.series.endswith(row.varied)
        else (f"{row.series}, {place}")
    )


def format_varied(row: StudyRow) -> str:
    """Describe the varied parameter of a setting and its value.

    >>> format_varied(StudyRow("", "", "", "mujoco", "MuJoCo RK4", "timestep", 2.5e-3))
    'timestep 2.5 ms'
    """
    place = f"{number(1e3 * row.value)} ms" if row.varied == "timestep" else number(row.value)
    return f"{row.varied} {place}"


def format_setting_briefly(row: StudyRow) -> str:
    """Describe a setting without its engine."""
    return format_setting(row).removeprefix(format_solver(row.engine)).lstrip(", ")


def format_error(row: StudyRow, error_kind: str) -> str:
    """Describe an error at the prescribed motion, and at that of the drives if it differs much.

    >>> row = StudyRow("", "", "", "", "", "", 1e-3, errors={"position": 1e-6},
    ...                asked={"position": 3e-5})
    >>> format_error(row, "position")
    '3e-5 off, and 1e-6 off the motion that its drives really had'
    """
    text = f"{number(row.reached(error_kind), 2)} off"
    if not is_error_of_drives(row, error_kind):
        return text
    return (
        f"{text}, and {number(row.errors[error_kind], 2)} off the motion that its drives really had"
    )


def is_error_of_drives(row: StudyRow, error_kind: str) -> bool:
    """Whether most of an error is that of the drives."""
    return row.reached(error_kind) > DRIVE_ERROR_RATIO * row.errors.get(error_kind, NAN)


def format_cost(row: StudyRow) -> str:
    """Describe the processor time of a setting, and the value of its varied parameter."""
    return f"{number(row.seconds, 2)} s at {format_varied(row)}"


def format_floor(verdict: Verdict) -> str:
    """Describe an error floor and its cause."""
    return f"the error floor is {number(verdict.floor, 2)}, {verdict.cause}"


def format_needed_step(error: float, wanted: float, order: float, row: StudyRow) -> str:
    """Describe the step that a wanted error needs, and the processor time of a run, if an order
    holds.

    >>> row = StudyRow("", "", "", "", "", "timestep", 1e-3, seconds=0.5)
    >>> format_needed_step(4e-4, 1e-4, 2.0, row)
    '1e-4 would need a step of about 5e-4 s and about 1 s a run'
    """
    factor = (error / wanted) ** (1 / order)
    return (
        f"{number(wanted, 2)} would need a step of about {number(row.value / factor, 2)} s and "
        f"about {number(row.cost * factor, 2)} s a run"
    )


def format_reached(
    measured: MeasuredSeries, kind: str, expected: float, why: str, ended: str
) -> str:
    """Describe how far a series without error floor came, and what it needs for `STATED_ERROR`.

    Parameters
    ----------
    measured, kind : MeasuredSeries, str
        The series with its rows, and the kind of error.
    expected : float
        Order of convergence by theory [1]; the order of a single refinement counts only if it is
        near this.
    why : str
        Reason why an error that no longer falls is not called a floor.
    ended : str
        Description of what ended the series before its last setting, or empty.
    """
    points = [p for p in measured.every(kind) if isfinite(p[1])]
    if len(points) < 2:
        return ""
    size, error = points[-1]
    row = measured.rows[measured.place(size)]
    place = f"{number(error, 2)} at {format_varied(row)}"
    order = final_order(measured.points(kind))
    not_asymptotic = "" if error < ASYMPTOTIC_ERROR else "not yet asymptotic: "
    is_last_alone = observed_order(measured.points(kind)) != order
    if not order > 0 or (is_last_alone and not abs(order - expected) <= ORDER_TOLERANCE):
        why = why or "its last refinements change it without an order"
        words = [f"no error floor is shown: {place}, {why}"]
        if not_asymptotic:
            words = [
                f"stays at {place}; an error floor is claimed below {number(ASYMPTOTIC_ERROR)} only"
                if measured.settled(kind) and is_constant(measured.points(kind))
                else f"{not_asymptotic}{place}, and no order is seen"
            ]
    else:
        words = [
            f"{not_asymptotic}order {number(order, 2)} down to {place}"
            + ", of the last refinement alone" * is_last_alone
        ]
        if error > STATED_ERROR and row.varied == "timestep" and row.cost > 0:
            words.append(
                format_needed_step(error, STATED_ERROR, order, row) + ", if that order holds"
            )
    return "; ".join([*words, *filter(None, [ended])])


def format_end(measured: MeasuredSeries, budget: float) -> str:
    """Describe a failure or a too long run that ended a series; empty if its errors settled."""
    last = measured.rows[-1]
    if last.outcome != Outcome.RAN:
        return f"{format_varied(last)}: {last.outcome}"
    if last.cost > budget:
        return f"the series ends there, at a run of more than {number(budget)} s"
    return ""


def format_worsened(measured: MeasuredSeries, kind: str) -> str:
    """Describe a finer setting that is worse than the one before it; empty if there is none."""
    if not (pair := find_worse_pair(measured.every(kind))):
        return ""
    coarse, fine = (
        f"{number(error, 2)} at {format_varied(measured.rows[measured.place(size)])}"
        for size, error in pair
    )
    return f"finer is worse: {coarse}, {fine}"
