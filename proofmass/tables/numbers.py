"""The numbers of a table: how they are written, and their units where cells have them."""

from collections.abc import Iterable
from dataclasses import replace
from decimal import Decimal
from math import isfinite

from proofmass.base.units import si_unit
from proofmass.tables.cells import (
    STYLES,
    NumberStyle,
    is_empty,
    is_plain,
    shown,
    split_number,
    style_pattern,
    tidy,
)
from proofmass.tables.decisions import Decisions, ImportQuestion
from proofmass.tables.foreign import ForeignColumn, ForeignTable, ImportRule, be, listed
from proofmass.tables.moments import is_moment
from proofmass.tables.text import is_value
from proofmass.tables.unit_words import dimension, read_unit

LONG_WHOLE = 4
"""Digits of a whole number without groups that a program which groups digits would have grouped."""
GROUP_WORDS = {",": "commas", ".": "points", " ": "blanks", "'": "apostrophes", "_": "underscores"}
DECIMAL_WORDS = {",": "comma", ".": "point"}


def read_numbers(table: ForeignTable, decisions: Decisions) -> ForeignTable:
    """The table with plain numbers in its cells; columns of words are left out.

    Columns of times of a clock stay as they are.

    Raises
    ------
    InputError
        Numbers can be read in two ways, or in none.
    """
    table = leave_words_out(table)
    style = find_style(table, decisions)
    columns = []
    for column in table.columns:
        if all(is_moment(cell) or is_empty(cell) for cell in column.cells):
            columns.append(column)
            continue
        columns.append(plain_column(table, column, style))
    found = replace(table, columns=tuple(columns))
    if style.decimal == "," and table.decimal != ".":
        found = found.corrected(ImportRule.DECIMALS, "decimal commas became points")
    if any(style.grouped(number) for column in table.columns for number in numbers_of(column)):
        words = f"{GROUP_WORDS[style.group]} between groups of three digits were removed"
        found = found.corrected(ImportRule.GROUPS, words)
    return cells_without_units(replace(found, decimal=style.decimal))


def leave_words_out(table: ForeignTable) -> ForeignTable:
    """The table without columns that are empty, or that have words where others have numbers."""
    empty = [c.name for c in table.columns if all(map(is_empty, c.cells))]
    worded = [
        c.name
        for c in table.columns
        if c.name not in empty and not any(map(is_value, filter(None, c.cells)))
    ]
    if named := [name for name in empty if not name.startswith("column ")]:
        table = table.corrected(
            ImportRule.LEFT_OUT, f"{listed(named)} {be(named)} left out: no cell has a value"
        )
    if worded:
        table = table.corrected(
            ImportRule.LEFT_OUT, f"{listed(worded)} {be(worded)} left out: words, no numbers"
        )
    return table.without_columns([*empty, *worded])


def numbers_of(column: ForeignColumn) -> Iterable[str]:
    """The numbers of a column, as they are written."""
    for cell in column.cells:
        if is_plain(cell):
            yield cell
        elif not is_empty(cell) and not is_moment(cell) and (parts := split_number(cell)):
            yield parts[0]


def find_style(table: ForeignTable, decisions: Decisions) -> NumberStyle:
    """Find how the numbers of a table are written.

    Raises
    ------
    InputError
        Two ways give different numbers, or no way fits all.
    """
    written = {
        number
        for column in table.columns
        for number in numbers_of(column)
        if not is_plain(number) or "." in number or len(number) >= LONG_WHOLE
    }
    decimal = decisions.decimal or table.decimal
    fitting = [style for style in STYLES if fits(style, written)]
    if decimal:
        fitting = [style for style in fitting if style.decimal == decimal]
    if not fitting:
        raise no_style(table, decimal)
    first = fitting[0]
    other = next((one for one in fitting[1:] if differ(first, one, written)), None)
    if other is None:
        return first
    example = min(number for number in written if first.plain(number) != other.plain(number))
    question = ImportQuestion(
        "",
        f"{example!r} may be {first.plain(example)} or {other.plain(example)}: no number of the "
        "file tells the decimal sign from the one between groups of digits",
        "--decimal {}",
        (first.decimal, other.decimal),
        "{} is the decimal sign",
    )
    answer = decisions.decide(table.file, question)
    return next((style for style in fitting if style.decimal == answer), first)


def fits(style: NumberStyle, written: set[str]) -> bool:
    """Whether all numbers can be in a style; of one with groups, at least one must have them and
    none may lack them."""
    if style.group and not any(style.grouped(number) for number in written):
        return False
    pattern = style_pattern(style)
    return all(pattern.fullmatch(number) for number in written)


def differ(one: NumberStyle, other: NumberStyle, written: set[str]) -> bool:
    """Whether two styles read a number differently."""
    return any(
        Decimal(one.plain(number) or 0) != Decimal(other.plain(number) or 0) for number in written
    )


def no_style(table: ForeignTable, decimal: str) -> Exception:
    """The error of numbers that fit no style, with two of them."""
    wrong: dict[str, str] = {}
    for column in table.columns:
        for row, cell in enumerate(column.cells):
            number = (split_number(cell) or ("", ""))[0]
            for sign in ",.":
                if sign in number:
                    wrong.setdefault(sign, f"{shown(cell)} in {table.line(row)}, {column.name}")
    if decimal and wrong:
        return table.error(
            "--decimal" if len(wrong) < 2 else "",
            f"with the decimal {DECIMAL_WORDS.get(decimal, decimal)} not all numbers can be read, "
            f"such as {next(iter(wrong.values()))}",
        )
    return table.error(
        "",
        f"numbers are written in several ways: {' and '.join(wrong.values())}; write all decimals "
        "in one way",
    )


def plain_column(table: ForeignTable, column: ForeignColumn, style: NumberStyle) -> ForeignColumn:
    """A column with plain numbers, which may have units behind them.

    Raises
    ------
    InputError
        A cell is no number in this style.
    """
    cells = []
    ready = style.decimal == "." and not style.group
    for row, cell in enumerate(column.cells):
        if ready and is_plain(cell) and isfinite(float(cell)):
            cells.append(cell.lstrip("+"))
            continue
        if is_empty(cell):
            cells.append("")
            continue
        number, rest = split_number(cell) or ("", tidy(cell))
        plain = style.plain(number)
        known = not rest or read_unit(rest) is not None
        if plain is None or not known or not isfinite(float(plain)):
            raise table.error(f"{table.line(row)}, {column.name}", f"{shown(cell)} is no number")
        cells.append(f"{plain} {rest}" if rest else plain)
    return replace(column, cells=tuple(cells))


def cells_without_units(table: ForeignTable) -> ForeignTable:
    """The table with the units of cells in the heads of their columns.

    Raises
    ------
    InputError
        Cells of a column are in units of several quantities, or in another than the head says.
    """
    for column in table.columns:
        units = {cell.partition(" ")[2] for cell in column.cells if " " in cell}
        if units and not any(map(is_moment, column.cells)):
            table = cells_without_unit(table, column, sorted(units))
    return table


def cells_without_unit(
    table: ForeignTable, column: ForeignColumn, written: list[str]
) -> ForeignTable:
    """The table with the unit of the cells of a column in its head."""
    known = sorted({read_unit(text) or "" for text in written})
    kinds = {dimension(unit) for unit in (*known, *filter(None, [column.unit]))}
    if len(kinds) > 1:
        raise table.error(
            column.name,
            f"its cells and header are in {' and in '.join(filter(None, [*known, column.unit]))}; "
            "a column has one quantity",
        )
    unit = column.unit or known[0]
    for row, cell in enumerate(column.cells):
        if cell and " " not in cell and float(cell) and not column.unit:
            raise table.error(
                f"{table.line(row)}, {column.name}",
                f"{shown(cell)} has no unit, and other cells of the column are in {written[0]!r}",
            )
    cells = tuple(converted(cell, unit) for cell in column.cells)
    words = f"cells of {column.name} had the unit {' or '.join(map(repr, written))} in them"
    if known != [unit]:
        words += f"; all are in {unit} now"
    found = replace(column, cells=cells, unit=unit, written_unit=column.written_unit or written[0])
    return table.with_column(found).corrected(ImportRule.CELL_UNITS, words)


def converted(cell: str, unit: str) -> str:
    """A cell with a unit as a number in another unit of the same quantity.

    >>> converted("950 ms", "s"), converted("1.05 s", "s"), converted("", "s")
    ('0.950', '1.05', '')
    """
    number, _, own = cell.partition(" ")
    own = read_unit(own) or unit
    return number if own == unit or not number else scaled(number, own, unit)


def scaled(number: str, own: str, unit: str) -> str:
    """A number in one unit as one in another, without rounding where the ratio is a short one.

    >>> scaled("1.50", "ms", "s"), scaled("2", "min", "s")
    ('0.00150', '120')
    """
    return format(Decimal(number) * ratio(own, unit), "f")


def ratio(own: str, unit: str) -> Decimal:
    """How many of one unit another one is."""
    value = si_unit(own)[1] / si_unit(unit)[1]
    back = round(1 / value) if value < 1 else 0
    if back and abs(back * value - 1) < 1e-12:
        return Decimal(1) / Decimal(back)
    return Decimal(round(value)) if value == round(value) else Decimal(repr(round(value, 12)))
