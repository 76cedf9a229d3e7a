"""Angles of a table: their units, whole turns by which they jump, and their direction."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from decimal import Decimal
from math import pi

import numpy as np

from proofmass.base.errors import suggest_names
from proofmass.base.recorded import find_wrap
from proofmass.base.units import si_unit
from proofmass.tables.decisions import Decisions, ImportQuestion
from proofmass.tables.foreign import ForeignColumn, ForeignTable, ImportRule, listed
from proofmass.tables.headers import is_angle_name
from proofmass.tables.unit_words import dimension, doubtful_unit, read_unit

TURNS = {"deg": Decimal(360), "rev": Decimal(1), "gon": Decimal(400)}
"""A whole turn in units that divide it."""
TURN = Decimal("6.283185307179586476925286766559")  # [rad]
ANGLE_KINDS = ("rad", "rad/s", "rad/s^2")
"""Quantities whose signs a direction of rotation turns round."""
MORE_DECIMALS = 6
"""Decimals that an unwrapped angle in radians has more than it is printed with: a turn has no end,
and its rounding must not be seen in differences of rows."""
FAST_SHARE = 0.25
"""Share of a turn by which a wrapped angle may turn from row to row: with more, the way in the
other direction is less than three times as long, and the rows do not tell which it was."""
SLOPE_TOLERANCE = 0.02
"""Share by which the slope of a curve may differ from the column of its rate: differences of rows
are no derivatives."""
NOTHING = "none"  # the answer that no column counts clockwise
MIXED_UNITS = {"rad": (("rad", "deg"),), "m": (("m", "mm"), ("m", "cm"))}
"""Units that are taken for each other, by the quantity."""


def settle_units(table: ForeignTable, decisions: Decisions) -> ForeignTable:
    """The table with the units of angles that have none, or a doubtful one.

    Raises
    ------
    InputError
        Nobody decides in which unit an angle is; units contradict each other.
    """
    for column in table.columns:
        if not column.unit and not column.written_unit and is_angle_name(column.name):
            table = settle_angle(table, column, decisions)
        elif doubtful_unit(column.written_unit) and not column.unit:
            table = settle_doubtful(table, column, decisions)
    table = gravity_to_si(table)
    check_slopes(table, decisions.units)
    return table


def state_units(table: ForeignTable, decisions: Decisions) -> ForeignTable:
    """The table with the units of ``--unit``.

    Raises
    ------
    InputError
        The option names no column or no unit.
    """
    for name, written in decisions.units.items():
        column = table.find(name, "--unit")
        unit = read_unit(written) or ("1" if written == "1" else "")
        if written in ("gon", "g_0"):
            unit = written
        if not unit:
            units = ("deg", "rad", "mm", "m", "s", "ms", "deg/s", "N", "N m", "1")
            raise table.error(
                "--unit",
                f"{name}={written}: no unit that is known; {suggest_names(written, units)}",
            )
        words = f"{column.name} is in {unit}, by --unit"
        words += f", not in {column.written_unit}" if column.unit not in ("", unit) else ""
        table = table.with_column(replace(column, unit=unit)).corrected(ImportRule.UNITS, words)
    return table


def settle_angle(table: ForeignTable, column: ForeignColumn, decisions: Decisions) -> ForeignTable:
    """The table with the unit of an angle that has none: by the column of its rate, or asked."""
    for unit in ("deg", "rad"):
        rated = table.with_column(replace(column, unit=unit))
        if any(agrees(rated, replace(column, unit=unit), rate) for rate in rates_of(rated, "rad")):
            words = f"{column.name} has no unit; its slope shows that it is in {unit}"
            return rated.corrected(ImportRule.UNITS, words)
    if table.angle_unit:
        words = f"{column.name} has no unit; a line above the table says {table.angle_unit}"
        found = replace(column, unit=table.angle_unit)
        return table.with_column(found).corrected(ImportRule.UNITS, words)
    values = [abs(float(cell)) for cell in column.cells if cell]
    answers = ("deg", "rad") if max(values, default=0) > 2 * pi else ("rad", "deg")
    question = ImportQuestion(
        column.name,
        f"an angle without a unit, between {least(column)} and {largest(column)}",
        f"--unit {column.name}={{}}",
        answers,
        f"{column.name} is in {{}}",
    )
    unit = decisions.decide(table.file, question)
    return table.with_column(replace(column, unit=read_unit(unit) or unit))


def least(column: ForeignColumn) -> str:
    """The smallest number of a column, as it is written."""
    return min(filter(None, column.cells), key=float)


def largest(column: ForeignColumn) -> str:
    """The largest number of a column, as it is written."""
    return max(filter(None, column.cells), key=float)


def settle_doubtful(
    table: ForeignTable, column: ForeignColumn, decisions: Decisions
) -> ForeignTable:
    """The table with the unit of a column whose word for it has two meanings."""
    answers = doubtful_unit(column.written_unit)
    if column.written_unit.startswith("G") or table.decimal == ",":
        words = f"{column.written_unit} of {column.name} is German: {answers[0]}"
        found = replace(column, unit=answers[0])
        return table.with_column(found).corrected(ImportRule.UNITS, words)
    question = ImportQuestion(
        column.name,
        f"{column.written_unit!r} is a degree in some languages and a gon in others",
        f"--unit {column.name}={{}}",
        answers,
        f"{column.name} is in {{}}",
    )
    unit = decisions.decide(table.file, question)
    return table.with_column(replace(column, unit=unit))


def gravity_to_si(table: ForeignTable) -> ForeignTable:
    """The table with accelerations in m/s^2 that were in multiples of that of gravity."""
    for column in table.columns:
        if column.unit != "g_0":
            continue
        cells = tuple(
            format(Decimal(cell) * Decimal("9.80665"), "f") if cell else "" for cell in column.cells
        )
        words = f"{column.name} was in g; it is multiplied by 9.80665 m/s^2"
        found = replace(column, cells=cells, unit="m/s^2")
        table = table.with_column(found).corrected(ImportRule.UNITS, words)
    return table


def array_of(column: ForeignColumn) -> np.ndarray:
    """The numbers of a column; NaN where it is empty [its unit]."""
    return np.array([float(cell) if cell else np.nan for cell in column.cells])


def rates_of(table: ForeignTable, kind: str) -> list[ForeignColumn]:
    """The columns that are rates of a quantity."""
    return [c for c in table.columns if c.unit and dimension(c.unit) == f"{kind}/s"]


def slope_ratio(table: ForeignTable, curve: ForeignColumn, rate: ForeignColumn) -> float | None:
    """How many times as large as the slope of a curve a column of rates is, both in SI; None if it
    is no multiple of it [1]."""
    x = table.columns[0]
    if dimension(x.unit) != "s" or len(x.cells) < 5:
        return None
    time = array_of(x) * si_unit(x.unit)[1]
    values, there = array_of(curve) * si_unit(curve.unit)[1], array_of(rate)
    with np.errstate(all="ignore"):  # numbers at the limits of floats are no slope of anything
        slope, there = np.gradient(values, time), there * si_unit(rate.unit)[1]
    inner = np.isfinite(slope) & np.isfinite(there)
    inner[[0, -1]] = False
    slope, there = slope[inner], there[inner]
    if slope.size < 3 or not slope.any():
        return None
    with np.errstate(all="ignore"):
        found = float(slope @ there / (slope @ slope))
        rest = np.sqrt(np.mean((there - found * slope) ** 2))
        good = rest <= SLOPE_TOLERANCE * np.sqrt(np.mean(there**2))
    return found if good and np.isfinite(found) else None


def agrees(table: ForeignTable, curve: ForeignColumn, rate: ForeignColumn) -> bool:
    """Whether a column of rates is the slope of a curve."""
    found = slope_ratio(table, curve, rate)
    return found is not None and abs(abs(found) - 1) < SLOPE_TOLERANCE


def check_slopes(table: ForeignTable, stated: Mapping[str, str]) -> None:
    """Raise InputError if a rate is the slope of a curve in another unit than the file says.

    Columns whose units are `stated` by options are left alone.
    """
    for kind, pairs in MIXED_UNITS.items():
        curves = [c for c in table.columns[1:] if c.unit and dimension(c.unit) == kind]
        for curve in curves:
            for rate in rates_of(table, kind):
                if {curve.name, curve.label, rate.name, rate.label} & stated.keys():
                    continue
                found = slope_ratio(table, curve, rate)
                for large, small in pairs:
                    if found is not None and is_mixed(found, large, small):
                        raise contradiction(table, curve, rate, found, (large, small))


def is_mixed(found: float, large: str, small: str) -> bool:
    """Whether a ratio of a rate and a slope is that of two units, or its inverse."""
    units = si_unit(large)[1] / si_unit(small)[1]
    return any(abs(abs(found) / one - 1) < SLOPE_TOLERANCE for one in (units, 1 / units))


def contradiction(
    table: ForeignTable,
    curve: ForeignColumn,
    rate: ForeignColumn,
    found: float,
    pair: tuple[str, str],
) -> Exception:
    """The error of a curve and its rate whose units contradict each other."""
    other = {pair[0]: pair[1], pair[1]: pair[0]}
    ways = [
        f"--unit {column.name}={unit}"
        for column, unit in (
            (rate, f"{other.get(rate.unit.partition('/')[0], pair[0])}/s"),
            (curve, other.get(curve.unit, pair[0])),
        )
    ]
    return table.error(
        rate.name,
        f"{rate.label} is {abs(found):.4g} times the slope of {curve.label}: one of the two units "
        f"is wrong; state it, {' or '.join(ways)}, or state the present one",
    )


def unwrap_angles(table: ForeignTable) -> ForeignTable:
    """The table without jumps of angles by whole turns, or by half ones of an arctangent.

    An angle that turns so fast that whole turns between rows are not known is left out.
    """
    for column in table.columns:
        if column.unit and dimension(column.unit) == "rad":
            table = unwrap_angle(table, column)
    return table


def unwrap_angle(table: ForeignTable, column: ForeignColumn) -> ForeignTable:
    """The table with an angle without jumps."""
    rows = [k for k, cell in enumerate(column.cells) if cell]
    there = [column.cells[k] for k in rows]
    values = np.array([float(cell) for cell in there])
    turn, word = turn_of(column.unit), "turn"
    row = find_wrap(values, float(turn))
    if row is None and np.ptp(values) <= float(turn) / 2:
        turn, word = turn / 2, "half turn"
        row = find_wrap(values, float(turn))
    if row is None:
        return table
    mended, jumps = unwrapped(there, turn)
    steps = np.abs(np.diff([float(cell) for cell in mended]))
    if np.median(steps) > FAST_SHARE * float(turn):
        words = (
            f"column {column.name} is left out: it turns by {np.median(steps):.4g} {column.unit} "
            f"or the rest of a {word} from row to row, so that it is not known how far it turned"
        )
        return table.corrected(ImportRule.WRAPPED, words).without_columns([column.name])
    words = (
        f"{column.name} jumped by {f'a {word}' if jumps == 1 else f'{word}s, {jumps} times'}, "
        f"first at {table.line(rows[row + 1])} from {there[row]} to {there[row + 1]} "
        f"{column.unit}; {'whole' if word == 'turn' else 'half'} turns were added"
    )
    cells = list(column.cells)
    for k, cell in zip(rows, mended, strict=True):
        cells[k] = cell
    found = replace(column, cells=tuple(cells))
    return table.with_column(found).corrected(ImportRule.WRAPPED, words)


def turn_of(unit: str) -> Decimal:
    """A whole turn in a unit of angles."""
    return TURNS.get(unit) or TURN / Decimal(repr(si_unit(unit)[1]))


def unwrapped(cells: Sequence[str], turn: Decimal) -> tuple[tuple[str, ...], int]:
    """An angle with whole turns added, so that no step is longer than half a turn.

    >>> unwrapped(("350.0", "10.0", "-350.0"), Decimal(360))
    (('350.0', '370.0', '370.0'), 2)
    """
    turns, jumps = 0, 0
    found, last = [cells[0]], Decimal(cells[0])
    for cell in cells[1:]:
        value = Decimal(cell)
        step = -round((value - last) / turn)
        turns, jumps, last = turns + step, jumps + bool(step), value
        found.append(with_turns(cell, turns, turn))
    return tuple(found), jumps


def with_turns(cell: str, turns: int, turn: Decimal) -> str:
    """An angle with whole turns added, with its own decimals if a turn is a whole number."""
    if not turns:
        return cell
    value = Decimal(cell) + turns * turn
    if turn == round(turn):
        return format(value, "f")
    exponent = Decimal(cell).as_tuple().exponent
    assert isinstance(exponent, int)
    return format(round(value, min(max(-exponent, 0) + MORE_DECIMALS, 20)), "f")


def turn_clockwise(table: ForeignTable, decisions: Decisions) -> ForeignTable:
    """The table with the signs of clockwise angles and rates turned round.

    Raises
    ------
    InputError
        An option names no column, or a line of the file leaves open which columns are meant.
    """
    names = clockwise_names(table, decisions)
    for name in names:
        column = next(c for c in table.columns if c.name == name)
        cells = tuple(opposite(cell) for cell in column.cells)
        table = table.with_column(replace(column, cells=cells, clockwise=False))
    if names:
        words = f"{listed(names)} counted clockwise: the sign is turned round"
        return table.corrected(ImportRule.CLOCKWISE, words)
    return table


def clockwise_names(table: ForeignTable, decisions: Decisions) -> list[str]:
    """The names of the columns that count clockwise."""
    if decisions.clockwise is not None:
        given = [n for one in decisions.clockwise for n in divided(one, table) if n != NOTHING]
        return [table.find(name, "--clockwise").name for name in given]
    named = [column.name for column in table.columns if column.clockwise]
    angles = [c.name for c in table.columns[1:] if c.unit and dimension(c.unit) in ANGLE_KINDS]
    if named or not table.clockwise_line or not angles:
        return named
    question = ImportQuestion(
        f"line {table.clockwise_line}",
        f"it says that something is clockwise; the angles are {', '.join(angles)}",
        "--clockwise {}",
        (",".join(angles), NOTHING),
        "columns that count clockwise: {}",
    )
    answer = decisions.decide(table.file, question)
    return clockwise_names(table, Decisions(clockwise=(answer,)))


def divided(answer: str, table: ForeignTable) -> list[str]:
    """The names of columns in an answer, with commas between them."""
    return [answer] if answer in table.names else answer.split(",")


def opposite(cell: str) -> str:
    """A number with the other sign.

    >>> opposite("1.50"), opposite("-0.5"), opposite("0.00"), opposite("")
    ('-1.50', '0.5', '0.00', '')
    """
    if not cell or not float(cell):
        return cell
    return cell.removeprefix("-") if cell.startswith("-") else f"-{cell}"
