"""The rows of the report's tables, with all numbers formatted."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from proofmass.base.errors import InputError
from proofmass.base.wording import format_list, format_unit, number
from proofmass.case.case import Case, Tolerance
from proofmass.reference.evaluate import properties
from proofmass.reference.find import parameter_unit
from proofmass.reference.run_reference import changeable_parameters
from proofmass.report.data import PlottedRun
from proofmass.report.words import SYMBOLS
from proofmass.sim.engines import format_solver
from proofmass.verdict.comparison import Comparison, DetectableChange
from proofmass.verdict.noticed import noticed_changes, smallest_noticed
from proofmass.verdict.outcome import CHECKED_OUTCOMES, FAILED_OUTCOMES, Outcome

NAN = float("nan")


@dataclass(frozen=True)
class TableRow:
    """One channel of one solver."""

    solver: str
    outcome: str
    symbol: str
    message: str
    cells: tuple[str, ...]
    notice: str = ""
    notices: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True)
class Group:
    """The rows of one channel; its constant is the number that it must equal, if any."""

    channel: str
    unit: str
    rows: tuple[TableRow, ...]
    constant: str = ""


def format_place(view: PlottedRun, x: float) -> str:
    """Format a value of the run's parameter with its unit."""
    value, unit = view.place(x)
    return "—" if math.isnan(value) else f"{number(value)} {unit}"


def comparison_groups(view: PlottedRun) -> list[Group]:
    """Return the main table of a run: channels, and for each channel all solvers.

    Cells: largest error, its place, its share of the range, RMS, NRMSE, allowed error.
    """
    groups = []
    for channel in view.channels:
        rows = [
            TableRow(
                c.solver,
                c.outcome,
                SYMBOLS.get(c.outcome, "?"),
                c.message if c.outcome != Outcome.UNCHECKED else "",
                (
                    number(c.error_max),
                    format_place(view, c.at),
                    number(c.relative_to_range),
                    number(c.error_rms),
                    number(c.nrmse),
                    number(c.allowed),
                ),
                *format_detectable_changes(c),
            )
            for c in view.rows
            if c.channel == channel
        ]
        groups.append(
            Group(
                channel,
                format_unit(view.case.channels[channel].unit),
                tuple(rows),
                format_constant(view.case, channel),
            )
        )
    return groups


def format_constant(case: Case, channel: str) -> str:
    """Format the constant that a channel must equal, with its unit; empty for a quantity."""
    c = case.channels[channel]
    if isinstance(c.equals, str):
        return ""
    unit = "" if c.unit == "1" else f" {format_unit(c.unit)}"
    return f"= {number(c.scale * c.equals + c.shift, 6)}{unit}"


def format_detectable_changes(c: Comparison) -> tuple[str, tuple[tuple[str, str], ...]]:
    """Format the most sensitive parameter of a channel, and all of them, most sensitive first.

    Changes of parameters that are 0 cannot be stated as shares; they come after the others.
    """
    found = sorted(
        c.detectable.items(),
        key=lambda item: (math.isnan(item[1].size), not item[1].relative, item[1].size),
    )
    words = tuple((name, format_change(change)) for name, change in found)
    return (" ".join(words[0]) if words else "—"), words


def format_change(change: DetectableChange) -> str:
    """Format the smallest change that a tolerance would catch.

    >>> format_change(DetectableChange(2e-5)), format_change(DetectableChange(2e-5, relative=False))
    ('2e-5', '0 ± 2e-5')
    """
    if math.isnan(change.size):
        return "not known"
    return ("" if change.relative else "0 ± ") + number(change.size, 2)


def unnoticed_parameters(case: Case, rows: list[Comparison]) -> list[str]:
    """Return the parameters of which no checked channel notices a change of 10 %."""
    changes = noticed_changes(rows, CHECKED_OUTCOMES)
    return [p for p in changeable_parameters(case) if p not in changes]


def unknown_parameters(case: Case, rows: list[Comparison]) -> list[str]:
    """Return the parameters of which it is not known whether a checked channel notices a change."""
    changes = noticed_changes(rows, CHECKED_OUTCOMES)
    return [
        p
        for p in changeable_parameters(case)
        if p in changes and smallest_noticed(changes[p]) is None
    ]


@dataclass(frozen=True)
class SmallestChange:
    """A parameter, and the smallest change of it that a tolerance would catch, as text."""

    name: str
    value: str
    size: str
    by: str


def smallest_changes(case: Case, rows: list[Comparison]) -> list[SmallestChange]:
    """Return for each parameter the smallest change that any channel of any solver notices."""
    try:
        values = format_parameters(case, case.parameters)
        names = list(changeable_parameters(case))
    except InputError:  # the reference is at fault, which the runs report
        return []
    found, noticed = [], noticed_changes(rows, CHECKED_OUTCOMES)
    for name in names:
        smallest = smallest_noticed(noticed.get(name, []))
        if smallest is None:
            found.append(SmallestChange(name, values[name], "—", "not noticed"))
            continue
        change, c = smallest
        size = f"{number(100 * change.size, 2)} %" if change.relative else format_change(change)
        found.append(
            SmallestChange(
                name, values[name], size, f"{c.channel}, {c.run}, {format_solver(c.solver)}"
            )
        )
    return found


def extrema_groups(view: PlottedRun) -> list[Group]:
    """Return extrema of each channel with their places; those of solvers as differences.

    Cells: least value, its place, greatest value, its place.
    """
    groups = []
    for channel in view.channels:
        factor = view.case.channels[channel].factor
        reference, x = view.longest.channels[channel] / factor, view.longest.x
        low, high = extrema_indices(reference)
        rows = [
            TableRow(
                "reference",
                "",
                "",
                "",
                (
                    number(reference[low], 6),
                    format_place(view, x[low]),
                    number(reference[high], 6),
                    format_place(view, x[high]),
                ),
            )
        ]
        for solver, curves in view.curves.items():
            if channel not in curves.channels:
                continue
            mine, own = (by.channels[channel] / factor for by in (curves, view.reference[solver]))
            cells: list[str] = []
            for k, q in zip(extrema_indices(mine), extrema_indices(own), strict=True):
                cells += [
                    format_signed(float(mine[k] - own[q])),
                    format_shift(float(curves.x[k] - curves.x[q]) * view.x_scale, view.x_unit),
                ]
            rows.append(TableRow(solver, "", "", "", tuple(cells)))
        groups.append(Group(channel, format_unit(view.case.channels[channel].unit), tuple(rows)))
    return groups


def format_parameters(case: Case, values: Mapping[str, float | str]) -> dict[str, str]:
    """Format parameters, with the units that the reference's docstring states."""
    return {
        name: value
        if isinstance(value, str)
        else f"{number(value, 6)} {format_unit(parameter_unit(case, name))}".strip()
        for name, value in values.items()
    }


def compare_parameter_sets(case: Case) -> tuple[list[str], list[list[list[str]]]]:
    """Compare the case with other parameter sets: heads, rows of properties and of parameters."""
    heads = [case.name, *case.compare_with]
    own_properties = [properties(case), *(properties(case, name) for name in case.compare_with)]
    given = [
        format_parameters(case, values)
        for values in (case.parameters, *(b.parameters for b in case.compare_with.values()))
    ]
    return heads, [
        [
            [key, *(one.get(key, "—") for one in sets)]
            for key in dict.fromkeys(key for one in sets for key in one)
        ]
        for sets in (own_properties, given)
    ]


def extrema_indices(y: np.ndarray) -> tuple[int, int]:
    """Return the indices of the least and the greatest value of a curve; NaN is ignored."""
    if not np.isfinite(y).any():
        return 0, 0
    return int(np.nanargmin(y)), int(np.nanargmax(y))


def format_signed(value: float) -> str:
    """Format a difference with its sign."""
    return ("+" if value > 0 else "") + number(value)


def format_shift(value: float, unit: str) -> str:
    """Format the displacement of an extremum; "same" if it is at the same place."""
    return "same" if value == 0 else f"{format_signed(value)} {unit}"


def cost_rows(view: PlottedRun) -> list[dict[str, str]]:
    """Return cost, constraint violation and settings of each solver's run."""
    rows = []
    for solver in view.solvers:
        own = [c for c in view.rows if c.solver == solver]
        if not own:
            continue
        c, curves = own[0], view.curves.get(solver)
        settings = curves.settings if curves else {}
        texts = [f"{k} {format_setting(v)}" for k, v in settings.items()]
        rows.append(
            {
                "solver": solver,
                "seconds": number(c.seconds),
                "violation": number(c.violation),
                "steps": str(c.steps) if c.steps else "—",
                "settings": "; ".join(
                    filter(None, (", ".join(texts), *(curves.notes if curves else ())))
                )
                or "—",
                "note": c.message if c.outcome in FAILED_OUTCOMES else "",
            }
        )
    return rows


def format_setting(value: object) -> str:
    """Format the value of a setting."""
    if isinstance(value, float | np.floating):
        return number(float(value))
    if isinstance(value, list | tuple | np.ndarray):
        return "[" + ", ".join(format_setting(v) for v in value) + "]"
    return str(value)


def missing_channels(view: PlottedRun) -> list[str]:
    """List the channels that solvers cannot deliver, each reason once."""
    rows = sorted(
        (c for c in view.rows if c.outcome == Outcome.UNSUPPORTED),
        key=lambda c: (c.solver, c.message),
    )
    return [
        f"{solver}, {format_list(c.channel for c in own)}: {message or 'no reason given'}"
        for (solver, message), found in groupby(rows, key=lambda c: (c.solver, c.message))
        if (own := list(found))
    ]


def tolerance_rows(case: Case) -> list[dict[str, str]]:
    """Return every tolerance: what it covers, its size, and the reason for the size."""
    return [
        {
            "covers": describe_coverage(t),
            "why": t.why,
            "size": describe_size(t),
        }
        for t in case.tolerance
    ]


def describe_size(t: Tolerance) -> str:
    """Format the size of a tolerance.

    >>> describe_size(Tolerance(sigma=0.05, fit=("zero",), why="encoder"))
    'noise of 0.05, zero fitted'
    """
    if t.sigma is not None:
        size = t.sigma if isinstance(t.sigma, str) else f"of {number(t.sigma)}"
        return f"noise {size}" + f", {format_list(t.fit)} fitted" * bool(t.fit)
    if t.abs is not None:
        return f"{number(t.abs)} (absolute)"
    return f"{number(t.relative_to_range or NAN)} of range"


def describe_coverage(t: Tolerance) -> str:
    """Format what a tolerance covers.

    >>> describe_coverage(Tolerance(run="sweep", solver="mujoco", abs=1.0, why="x"))
    'sweep; mujoco; all channels'
    """
    units = "" if t.unit == ("*",) else f" in {', '.join(map(format_unit, t.unit))}"
    names = "all channels" if t.channels == ("*",) else ", ".join(t.channels)
    return "; ".join(
        [
            t.run or "every run",
            "every solver" if t.solver == ("*",) else ", ".join(t.solver),
            names + units,
        ]
    )
