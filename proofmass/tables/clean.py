"""An import as a whole: from a file of another program to a clean table, and its text as CSV."""

import csv
import io
import re
from dataclasses import replace
from pathlib import Path

from proofmass.tables.angles import settle_units, state_units, turn_clockwise, unwrap_angles
from proofmass.tables.containers import read_container
from proofmass.tables.decisions import Decisions
from proofmass.tables.foreign import ForeignTable, ImportRule, be, listed
from proofmass.tables.headers import unique
from proofmass.tables.moments import is_moment
from proofmass.tables.numbers import read_numbers
from proofmass.tables.rows import order_rows, treat_empty_cells
from proofmass.tables.time_axis import find_time

REASONS = (ImportRule.LEFT_OUT, ImportRule.WRAPPED)
"""Rules that may leave the last columns of a table out."""


def import_table(file: Path, decisions: Decisions) -> ForeignTable:
    """Read a table of another program, and mend what a recorded file must not have.

    Parameters
    ----------
    file : Path
        A file in any of the formats of `proofmass.tables.containers`.
    decisions : Decisions
        What options state, and who answers what the file leaves open.

    Returns
    -------
    ForeignTable
        Its first column is the x, and rises; cells are plain numbers or empty; every correction is
        in it as a sentence.

    Raises
    ------
    InputError
        The file is no table, is damaged, or can be read in two ways and nobody decides.
    """
    table = rename(read_container(file, decisions))
    table = read_numbers(table, decisions)
    if not table.columns:
        raise table.error("", "no column has numbers")
    table = state_units(table, decisions)
    table = leave_clocks_out(find_time(table, decisions))
    table = order_rows(table, decisions)
    table = settle_units(table, decisions)
    table = treat_empty_cells(table, decisions)
    require_curves(table)
    table = unwrap_angles(table)
    require_curves(table)
    table = turn_clockwise(table, decisions)
    return replace(table, corrections=(*table.corrections, *decisions.answers))


def require_curves(table: ForeignTable) -> None:
    """Raise InputError unless a table has two rows, and a column beside its x."""
    if len(table.columns) < 2:
        why = [str(one) for one in table.corrections if one.rule in REASONS]
        also = f"; {why[-1]}" if why else ""
        name = table.columns[0].name
        raise table.error("", f"{name} is the x, and no other column has numbers{also}")
    if len(table.places) < 2:
        raise table.error("", "a table needs two rows of numbers or more")


def rename(table: ForeignTable) -> ForeignTable:
    """The table with names that the header of a recorded file can have."""
    names = unique([clean_name(name) for name in table.names])
    changed = [(a, b) for a, b in zip(table.names, names, strict=True) if a != b]
    columns = tuple(replace(c, name=n) for c, n in zip(table.columns, names, strict=True))
    table = replace(table, columns=columns)
    if not changed:
        return table
    first, now = changed[0]
    more = f", and {len(changed) - 1} more" if len(changed) > 1 else ""
    words = f"{first!r} is called {now!r}{more}: brackets hold units"
    if not set("[]") & set(first):
        words = f"{first!r} is called {now!r}{more}"
    return table.corrected(ImportRule.NAMES, words)


def clean_name(name: str) -> str:
    """A name without the signs that have a meaning in the header of a recorded file.

    >>> clean_name("P[4.1]"), clean_name("%time"), clean_name("a;b")
    ('P(4.1)', 'time', 'a,b')
    """
    name = re.sub(r"\s+", " ", name).strip().lstrip("#%").strip()
    return name.translate(str.maketrans("[];", "(),"))


def leave_clocks_out(table: ForeignTable) -> ForeignTable:
    """The table without columns of times of a clock that are not its x."""
    names = [c.name for c in table.columns[1:] if any(map(is_moment, c.cells))]
    if not names:
        return table
    words = f"{listed(names)} {be(names)} left out: times of a clock, and not the x"
    return table.corrected(ImportRule.LEFT_OUT, words).without_columns(names)


def csv_text(table: ForeignTable) -> str:
    """The table as CSV that `proofmass.base.recorded` reads: names with units, then plain numbers.

    >>> from proofmass.tables.foreign import ForeignColumn
    >>> columns = ForeignColumn("t", ("0.00", "0.01"), "s"), ForeignColumn("x", ("1", "2"), "mm")
    >>> print(csv_text(ForeignTable(Path("a"), columns, (1, 2))), end="")
    t [s],x [mm]
    0.00,1
    0.01,2
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(column.label for column in table.columns)
    writer.writerows(zip(*(column.cells for column in table.columns), strict=True))
    return text.getvalue()
