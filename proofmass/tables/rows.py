"""Rows of a table that an import leaves out: doubled ones, those without a time, extremes."""

from decimal import Decimal
from itertools import pairwise

from proofmass.tables.decisions import Decisions, ImportQuestion
from proofmass.tables.foreign import ForeignTable, ImportRule, be, listed
from proofmass.tables.unit_words import dimension

MAX_EXTREMES = 8
"""Rows behind a table that may have its extremes: minimum, maximum, mean, and when."""
MAX_EVENT_SHARE = 0.05
"""Share of rows at a time that stands twice: with more of them the clock is too coarse."""
FEW_EVENTS = 5
"""Times that may stand twice in any table, however short."""
DROPOUT_SHARE = 0.2
"""Share of rows with an empty cell up to which they are left out: with more of them columns have
different clocks."""


def order_rows(table: ForeignTable, decisions: Decisions) -> ForeignTable:
    """The table whose x rises from row to row, each once.

    Raises
    ------
    InputError
        The x turns back, or stands many times; the message names the line.
    """
    table = drop_timeless(table)
    table = drop_doubled(table)
    table = drop_extremes(table)
    table = reverse(table)
    return drop_events(table, decisions)


def x_values(table: ForeignTable) -> list[Decimal]:
    """The numbers of the first column."""
    return [Decimal(cell) for cell in table.columns[0].cells]


def drop_timeless(table: ForeignTable) -> ForeignTable:
    """The table without rows that have no x."""
    x = table.columns[0]
    missing = [row for row, cell in enumerate(x.cells) if not cell]
    if not missing:
        return table
    kept = [row for row, cell in enumerate(x.cells) if cell]
    words = f"{table.lines(missing)} {be(missing)} left out: {x.name} is empty"
    return table.corrected(ImportRule.NO_TIME, words).with_rows(kept)


def drop_doubled(table: ForeignTable) -> ForeignTable:
    """The table without rows that repeat the one before them."""
    rows = list(zip(*(column.cells for column in table.columns), strict=True))
    doubled = [k for k in range(1, len(rows)) if rows[k] == rows[k - 1]]
    if not doubled:
        return table
    left = set(doubled)
    kept = [k for k in range(len(rows)) if k not in left]
    which = f"{len(doubled)} rows repeat those" if len(doubled) > 1 else "the row repeats that"
    words = f"{table.lines(doubled)} {be(doubled)} left out: {which} before"
    return table.corrected(ImportRule.DOUBLED, words).with_rows(kept)


def drop_extremes(table: ForeignTable) -> ForeignTable:
    """The table without rows at its end that have the extremes of its columns."""
    x = x_values(table)
    steps = [b - a for a, b in pairwise(x)]
    turns = [k + 1 for k, step in enumerate(steps) if step < 0]
    if not turns or len(x) - turns[0] > MAX_EXTREMES or turns[0] < MAX_EXTREMES:
        return table
    end = turns[0]
    body = table.with_rows(range(end))
    if not all(has_extremes(table, body, row) for row in range(end, len(x))):
        return table
    last = range(end, len(x))
    words = f"{table.lines(last)} {be(last)} left out: the extremes of the columns"
    return body.corrected(ImportRule.EXTREMES, words)


def has_extremes(table: ForeignTable, body: ForeignTable, row: int) -> bool:
    """Whether the cells of a row are extremes of the columns of the rows before."""
    for whole, part in zip(table.columns[1:], body.columns[1:], strict=True):
        values = [Decimal(cell) for cell in part.cells if cell]
        cell = whole.cells[row]
        if cell and values and Decimal(cell) not in (min(values), max(values)):
            return False
    return len(table.columns) > 1


def reverse(table: ForeignTable) -> ForeignTable:
    """The table with its rows in the order of time, if they are in the opposite order."""
    x = x_values(table)
    falls = all(b <= a for a, b in pairwise(x)) and x[0] > x[-1]
    if not falls or dimension(table.columns[0].unit) != "s":
        return table
    words = f"the rows were in the opposite order of {table.columns[0].name}"
    return table.corrected(ImportRule.ORDER, words).with_rows(range(len(x) - 1, -1, -1))


def drop_events(table: ForeignTable, decisions: Decisions) -> ForeignTable:
    """The table with one row at each x.

    Raises
    ------
    InputError
        The x turns back, or stands twice so often that its digits are too few.
    """
    x, name = x_values(table), table.columns[0].name
    if len(x) < 2:
        raise table.error("", "a table needs two rows of numbers or more")
    down = x[0] > x[-1]
    turns = [k for k in range(1, len(x)) if (x[k] > x[k - 1] if down else x[k] < x[k - 1])]
    if turns:
        raise table.error(
            table.line(turns[0]),
            f"{name} turns back, from {x[turns[0] - 1]} to {x[turns[0]]}; give one record, with "
            "its rows in the order of time",
        )
    twice = [k for k in range(1, len(x)) if x[k] == x[k - 1]]
    if not twice:
        return table
    if len(twice) > max(FEW_EVENTS, MAX_EVENT_SHARE * len(x)):
        raise table.error(
            table.line(twice[0]),
            f"{name} is {x[twice[0]]} in this row and in the one before, and so are {len(twice)} "
            "rows: its digits are too few; export more of them, or give the rows per second, "
            "--fps 1000",
        )
    before = decisions.event == "before"
    left = {k if before else k - 1 for k in twice}
    shown = sorted(left)
    words = (
        f"{table.lines(shown)} {be(shown)} left out: {name} = {x[twice[0]]} stands twice, and the "
        f"row {'before' if before else 'after'} the event is kept (--event "
        f"{'after' if before else 'before'} for the other)"
    )
    kept = [k for k in range(len(x)) if k not in left]
    return table.corrected(ImportRule.EVENT, words).with_rows(kept)


def treat_empty_cells(table: ForeignTable, decisions: Decisions) -> ForeignTable:
    """The table without rows in which a value drops out.

    At the ends of a column, where differences have no value, cells stay empty.

    Raises
    ------
    InputError
        So many cells are empty that columns have different clocks.
    """
    ends, inside = empty_rows(table)
    if not ends and not inside:
        return table
    drop = decisions.empty
    if not drop and len(inside) > DROPOUT_SHARE * len(table.places):
        question = ImportQuestion(
            "",
            f"{len(inside)} of {len(table.places)} rows have empty cells: columns have different "
            "clocks",
            "--empty {}",
            ("keep", "drop"),
            "{} rows with empty cells",
        )
        drop = decisions.decide(table.file, question)
    left = {"keep": [], "drop": sorted({*ends, *inside}), "": sorted(inside)}[drop]
    if left:
        names = [c.name for c in table.columns if any(not c.cells[row] for row in left)]
        words = f"{table.lines(left)} {be(left)} left out: {listed(names)} {be(names)} empty there"
        words += " (--empty keep keeps such rows)" if not drop else ""
        kept = [row for row in range(len(table.places)) if row not in set(left)]
        table = table.corrected(ImportRule.EMPTY, words).with_rows(kept)
    return say_empty_ends(table)


def say_empty_ends(table: ForeignTable) -> ForeignTable:
    """The table with a sentence on cells that stay empty."""
    columns = [column for column in table.columns if not all(column.cells)]
    if not columns:
        return table
    rows = sorted({k for c in columns for k, cell in enumerate(c.cells) if not cell})
    words = (
        f"{listed([c.name for c in columns])} {be(columns)} empty in {table.lines(rows)}, which "
        f"{'stays' if len(rows) == 1 else 'stay'}; "
        "--empty drop leaves these rows out"
    )
    return table.corrected(ImportRule.EMPTY, words)


def empty_rows(table: ForeignTable) -> tuple[set[int], set[int]]:
    """Rows with an empty cell at an end of its column, and those with one between values."""
    ends: set[int] = set()
    inside: set[int] = set()
    for column in table.columns:
        there = [row for row, cell in enumerate(column.cells) if cell]
        for row, cell in enumerate(column.cells):
            if not cell:
                (inside if there and there[0] < row < there[-1] else ends).add(row)
    return ends - inside, inside
