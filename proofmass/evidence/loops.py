"""A measured loop of a moment over an angle, beside sines, fits, other files and cases."""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from proofmass.analytic.hysteresis import HysteresisLoop, LoopCurve, LoopErrors
from proofmass.base.arrays import Array
from proofmass.base.errors import InputError, suggest_names
from proofmass.base.recorded import RecordedColumn, RecordedTable, read_table
from proofmass.base.units import same_quantity, si_unit
from proofmass.base.wording import number
from proofmass.reference.evaluate import all_quantities
from proofmass.run.sidecar import load_case
from proofmass.run.solve import prescribed_run
from proofmass.run.validate import validate_case

SINE, FIT = "sine", "fit"
SIZED = re.compile(r"(sine|fit)(?:=(.+))?")
"""A reference by a function: ``sine``, ``sine=0.0586``, ``fit=5``."""
USUAL_DEGREE = 5
"""Degree of a fit without one: that of listing N.2 of van Nes 2022."""
MAX_DEGREE = 15
"""Largest degree of a fit, whose coefficients are then known to few digits."""
HOLDING_MOMENT = "holding_moment"
"""The quantity of a case that is compared if no other is named."""
ANGLE_UNITS, MOMENT_UNITS = ("rad", "m"), ("N m", "N")
"""Quantities of x and of y, the usual ones first; a slide has a way and a force."""


@dataclass(frozen=True)
class LoopFile:
    """A loop in a recorded file.

    Attributes
    ----------
    file : Path
    x, y : str
        Its columns.
    units : tuple of str
        Their units.
    loop : HysteresisLoop
        [SI]
    """

    file: Path
    x: str
    y: str
    units: tuple[str, str]
    loop: HysteresisLoop


@dataclass(frozen=True)
class LoopReference:
    """A reference of a loop.

    Attributes
    ----------
    name : str
        As it was asked for.
    words : str
        What it is, with fitted numbers.
    curves : dict of str to callable
        The curve of each branch, ``up`` and ``down`` [SI].
    errors : LoopErrors
        The loop against it.
    ends : tuple of float
        The angles between which both are compared [SI].
    """

    name: str
    words: str
    curves: dict[str, LoopCurve]
    errors: LoopErrors
    ends: tuple[float, float]


def read_loop(file: Path, x: str = "", y: str = "") -> LoopFile:
    """Read a loop from a CSV file.

    Parameters
    ----------
    file : Path
    x, y : str
        Columns of the angle or way and of the moment or force; if empty, the first ones that are
        in units of these.

    Raises
    ------
    InputError
        There are no such columns, or no branch.
    """
    table = read_table(file)
    names = [find_column(table, x, "--x", ANGLE_UNITS), find_column(table, y, "--y", MOMENT_UNITS)]
    columns = [RecordedColumn(column=name, unwrap=is_angle(table, name)) for name in names]
    try:
        loop = HysteresisLoop(*(table.curve(column) for column in columns))
    except ValueError as error:
        raise InputError(file, f"column {names[0]!r}", str(error)) from None
    units = (table.units[names[0]], table.units[names[1]])
    return LoopFile(file, names[0], names[1], units, loop)


def is_angle(table: RecordedTable, name: str) -> bool:
    """Whether a column is an angle."""
    return same_quantity(table.units[name], "rad")


def find_column(table: RecordedTable, asked: str, option: str, quantities: tuple[str, ...]) -> str:
    """A column by its name, or the only one that measures the first of some quantities it has.

    Raises
    ------
    InputError
        There is none, or there are several.
    """
    if asked:
        if asked not in table.units:
            words = f"no column {asked!r}; {suggest_names(asked, table.units)}"
            raise InputError(table.file, option, words)
        found = [asked]
    else:
        found = next(filter(None, (columns_in(table, one) for one in quantities)), [])
    if not found:
        raise InputError(
            table.file,
            option,
            f"no column is in {' or '.join(quantities)}; the header has {', '.join(table.units)}; "
            f"write a unit in brackets behind a name, or try proofmass import {table.file.name}",
        )
    if len(found) > 1:
        raise InputError(
            table.file, option, f"several columns may be it: give one of {', '.join(found)}"
        )
    unit = table.units[found[0]]
    if not any(same_quantity(unit, one) for one in quantities):
        raise InputError(
            table.file,
            option,
            f"column {found[0]!r} is in {unit or 'no unit'}, where {' or '.join(quantities)} is "
            "needed, or a unit of the same quantity",
        )
    return found[0]


def columns_in(table: RecordedTable, quantity: str) -> list[str]:
    """The columns in units of a quantity."""
    return [name for name, unit in table.units.items() if unit and same_quantity(unit, quantity)]


def make_reference(own: LoopFile, asked: str) -> LoopReference:
    """A reference of a loop, and the loop against it.

    Parameters
    ----------
    own : LoopFile
    asked : str
        ``sine`` or ``sine=SIZE`` [unit of the moment], ``fit`` or ``fit=DEGREE``, another CSV file,
        or a sidecar, with the name of a quantity of its reference behind a colon.

    Raises
    ------
    InputError
        It is none of these, or does not overlap with the loop.
    """
    loop, words = own.loop, asked
    if sized := SIZED.fullmatch(asked):
        curve, words = sized_curve(own, *sized.groups())
        curves, ends = dict.fromkeys(loop.sides, curve), loop.ends
    else:
        other, words = other_loop(own, asked)
        ends = max(loop.ends[0], other.ends[0]), min(loop.ends[1], other.ends[1])
        if not ends[0] < ends[1]:
            raise InputError(
                own.file, "--with", f"{asked} goes over other values of {own.x}: nothing in common"
            )
        only = next(iter(other.sides.values()))
        curves = {name: other.sides.get(name, only).at for name in loop.sides}
    errors = loop.between(*ends).errors(curves)
    return LoopReference(asked, words, curves, errors, ends)


def sized_curve(own: LoopFile, kind: str, size: str | None) -> tuple[LoopCurve, str]:
    """The curve of ``sine`` or ``fit``, and what it is in words.

    Raises
    ------
    InputError
        The size is no positive number, or the degree no whole one.
    """
    unit, factor = own.units[1], si_unit(own.units[1])[1]
    if kind == SINE and not same_quantity(own.units[0], "rad"):
        raise InputError(own.file, "--with", f"sine: {own.x} is no angle, but in {own.units[0]}")
    try:
        if kind == SINE:
            height = own.loop.sine() if size is None else float(size) * factor
            if not (np.isfinite(height) and height):
                raise ValueError
            fitted = ", fitted" if size is None else ""
            words = f"{number(height / factor, 5)} {unit} sin({own.x}){fitted}"
            return (lambda angle: height * np.sin(angle)), words
        degree = USUAL_DEGREE if size is None else int(size)
        if not 0 <= degree <= MAX_DEGREE:
            raise ValueError
    except ValueError:
        what = "a number" if kind == SINE else f"a degree from 0 to {MAX_DEGREE}"
        raise InputError(own.file, "--with", f"{kind}={size}: give {what}") from None
    return own.loop.fit(degree), f"polynomial of degree {degree}, fitted"


def other_loop(own: LoopFile, asked: str) -> tuple[HysteresisLoop, str]:
    """The loop of another file or of a case, and what it is in words.

    Raises
    ------
    InputError
        There is no such file, or the quantity is none of the case.
    """
    name, _, quantity = asked.rpartition(":") if ".toml:" in asked else (asked, "", "")
    file = Path(name)
    if file.suffix != ".toml":
        other = read_loop(file)
        return other.loop, f"{other.y} over {other.x} of {file.name}"
    quantity = quantity or HOLDING_MOMENT
    loop = case_loop(file, quantity)
    return loop, f"{quantity} of {file.name}, last cycle"


def case_loop(file: Path, quantity: str) -> HysteresisLoop:
    """The loop of a quantity of a case's reference over its first drive, in its last cycle.

    Raises
    ------
    InputError
        The case has no drive, or its reference no such quantity.
    """
    case = load_case(file)
    validate_case(case)
    kind = "sweep" if "sweep" in case.run else next(iter(case.run))
    run = prescribed_run(case, kind)
    if not case.drive or kind == "equilibrium":
        raise InputError(file, "drive", "a loop needs a run with a drive, whose value is the angle")
    state = run.motion(run.x)
    known = all_quantities(case, kind, run.x, state, case.parameters)
    if quantity not in known:
        words = f"no quantity {quantity!r}; {suggest_names(quantity, known)}"
        raise InputError(file, "reference", words)
    moment: Array = np.broadcast_to(known[quantity], run.x.shape)
    return HysteresisLoop(state[0][0], moment).last_cycle()


def make_references(own: LoopFile, asked: Iterable[str]) -> list[LoopReference]:
    """All references that are asked for, each once."""
    return [make_reference(own, one) for one in dict.fromkeys(asked)]
