"""Workbooks of Excel, ``.xlsx``, read by openpyxl: a sheet as a grid of cells."""

import re
import zipfile
from datetime import date, datetime, time, timedelta
from pathlib import Path
from typing import Any

from proofmass.base.errors import InputError
from proofmass.tables.decisions import Decisions, ImportQuestion
from proofmass.tables.foreign import Correction, ForeignTable, ImportRule
from proofmass.tables.text import CellGrid, CellRow, find_shape
from proofmass.tables.unit_words import read_unit

MAX_UNPACKED = 2**30
"""Bytes that the parts of a packed file may have together: a gigabyte has ten million cells."""
MAX_CELLS = 10_000_000
"""Cells of a sheet: ten times as many as a record of an hour at 250 rows per second has in ten
columns; more would not fit into the memory of a worker."""
UNIT_OF_FORMAT = re.compile(r'[0#]\s*"\s*([^"]+?)\s*"$')
"""A unit that the format of a number shows behind it, such as ``0.000" s"``."""


def require_small(file: Path) -> list[str]:
    """The names of the parts of a packed file.

    Raises
    ------
    InputError
        It cannot be unpacked, or is larger than `MAX_UNPACKED` if it is.
    """
    try:
        with zipfile.ZipFile(file) as packed:
            parts = packed.infolist()
    except (zipfile.BadZipFile, NotImplementedError, ValueError) as error:
        raise InputError(file, "", f"a damaged ZIP: {error}") from None
    if (size := sum(part.file_size for part in parts)) > MAX_UNPACKED:
        raise InputError(file, "", f"{size / 2**30:.1f} GiB unpacked, more than the limit of 1 GiB")
    return [part.filename for part in parts]


def read_sheets(file: Path) -> dict[str, list[CellRow]]:
    """Read the cells of all sheets as text; rows behind the last cell are not among them."""
    from openpyxl import load_workbook

    book = load_workbook(file, read_only=True, data_only=True, keep_links=False)
    found: dict[str, list[CellRow]] = {}
    count = 0
    for sheet in book.worksheets:
        rows: list[CellRow] = []
        for number, cells in enumerate(sheet.iter_rows(), 1):
            count += len(cells)
            if count > MAX_CELLS:
                raise InputError(file, sheet.title, f"more than {MAX_CELLS:,} cells")
            texts = [cell_text(cell.value, getattr(cell, "number_format", "")) for cell in cells]
            while texts and not texts[-1]:
                texts.pop()
            if texts:
                rows.append(CellRow(number, tuple(texts)))
        found[sheet.title] = squared(rows)
    return found


def squared(rows: list[CellRow]) -> list[CellRow]:
    """Rows without the empty columns before and behind all cells, each as long as the longest."""
    if not rows:
        return rows
    width = max(len(row.cells) for row in rows)
    first = min(next(k for k, cell in enumerate(row.cells) if cell) for row in rows)
    return [
        CellRow(row.number, (*row.cells, *[""] * (width - len(row.cells)))[first:]) for row in rows
    ]


def cell_text(value: Any, form: str) -> str:
    """The text of a cell, with all digits of its number, and with the unit of its format.

    >>> cell_text(0.005, '0.000" s"'), cell_text(timedelta(seconds=1.5), ""), cell_text(None, "")
    ('0.005 s', '1.500000 s', '')
    """
    if value is None:
        return ""
    if isinstance(value, bool):
        return str(value).upper()
    if isinstance(value, int | float):
        unit = UNIT_OF_FORMAT.search(form or "")
        return f"{value!r} {unit[1]}" if unit and read_unit(unit[1]) else repr(value)
    if isinstance(value, datetime):
        return value.isoformat(" ")
    if isinstance(value, timedelta):
        return f"{value.total_seconds():.6f} s"
    if isinstance(value, date | time):
        return value.isoformat()
    return str(value).strip()


def choose_sheet(file: Path, sheets: dict[str, list[CellRow]], decisions: Decisions) -> CellGrid:
    """The sheet with a table, or the one that is asked for.

    Raises
    ------
    InputError
        Several sheets have tables and none is asked for, or none has one.
    """
    if decisions.sheet and decisions.sheet not in sheets:
        raise InputError(file, "--sheet", f"no sheet {decisions.sheet!r}; {', '.join(sheets)}")
    full = [name for name, rows in sheets.items() if find_shape(rows[:300])]
    if not full:
        raise ForeignTable(file, (), ()).error("", "no sheet has a table of numbers")
    name = decisions.sheet or full[0]
    if len(full) > 1 and not decisions.sheet:
        question = ImportQuestion(
            "", f"{len(full)} sheets have tables", "--sheet {}", tuple(full), "sheet {} is read"
        )
        name = decisions.decide(file, question)
        if name not in sheets:
            raise InputError(file, "--sheet", f"no sheet {name!r}; {', '.join(sheets)}")
    told = (Correction(ImportRule.CONTAINER, f"a workbook of Excel, sheet {name}"),)
    return CellGrid(file, tuple(sheets[name]), "row", corrections=told)
