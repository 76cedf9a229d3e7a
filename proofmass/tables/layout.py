"""The parts of a grid of cells: lines before the table, header, units, rows, lines after it.

The rows of numbers are found first, by their width and by the columns that have values.  The rows
directly above them are the header; a row of it may have units, and two rows of it may have the two
halves of names.
"""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

from proofmass.tables.cells import is_empty
from proofmass.tables.decisions import Decisions, ImportQuestion
from proofmass.tables.foreign import Correction, ForeignColumn, ForeignTable, ImportRule, be
from proofmass.tables.headers import ColumnHead, read_head, says_clockwise
from proofmass.tables.text import (
    COMMENT_MARKS,
    CellGrid,
    CellRow,
    DataShape,
    find_shape,
    trimmed,
)
from proofmass.tables.unit_words import NO_UNIT, TIME_UNITS, doubtful_unit, read_unit

MAX_HEADER_ROWS = 8  # rows of a header: of motion capture five, of the inspector of Simulink six
MIN_TABLE_ROWS = 3  # rows of numbers that are a table of their own, and no line of a preamble
SMALL_SHARE = 0.2
"""Rows of a table over those of the largest one in a file, below which they are no table of their
own: lines of numbers before it, or of extremes after it."""
DATA_TYPES = frozenset("double single float float32 float64 int int32 int64 boolean string".split())
"""Words of a row that has the types of columns."""
TAGGED = re.compile(r"(Unit|Type|Interp|BlockPath|PortIndex|Enum|Sync)\s*:\s*(.*)")
"""A cell of a row between header and numbers in an export of the inspector of Simulink."""
STATED_RATE = re.compile(
    r"(\d+(?:[.,]\d+)?)\s*(?:fps\b|frames? per second|bilder/s|rows per second)|"
    r"(?:\bfps\b|frame ?rate|bildrate|sampl\w*[ _]?(?:rate|freq\w*)|abtastrate|rate_hz)"
    r"\D{0,14}?(\d+(?:[.,]\d+)?)",
    re.IGNORECASE,
)
"""A line above a table that states the rows per second."""


@dataclass(frozen=True)
class FoundTable:
    """Rows of numbers that stand below each other, and what stands among and above them.

    Attributes
    ----------
    above : tuple of CellRow
        All rows before.
    data : tuple of CellRow
        The rows of numbers.
    among : tuple of CellRow
        Rows of words and comments among them.
    """

    above: tuple[CellRow, ...]
    data: tuple[CellRow, ...]
    among: tuple[CellRow, ...] = ()


def lay_out(grid: CellGrid, decisions: Decisions) -> ForeignTable:
    """Find the table in a grid of cells.

    Raises
    ------
    InputError
        There is none, there are several, or rows are of different lengths.
    """
    shape = find_shape(list(grid.rows))
    if shape is None:
        raise ForeignTable(grid.file, (), ()).error("", "no table: no rows of numbers")
    tables = find_tables(grid.rows, shape)
    found = choose_table(grid, tables, decisions)
    candidates, preamble = find_header(found.above, shape, grid.mark)
    header = divide_header(candidates)
    preamble += candidates[: len(candidates) - len(header.rows)]
    heads, told = read_header(grid, header, shape, found)
    data = found.data
    table = ForeignTable(
        grid.file,
        make_columns(heads, data),
        tuple(row.number for row in data),
        grid.place_word,
        grid.decimal,
        stated_rate(preamble),
        next((row.number for row in preamble if says_clockwise(words(row))), 0),
        grid.corrections,
    )
    after = rows_after(grid.rows, tables, found)
    told = [*left_out(preamble, header.rows, grid), *told, *outside(found, after, grid)]
    return replace(table, corrections=(*table.corrections, *told))


def words(row: CellRow) -> str:
    """The words of a row."""
    return row.text or " ".join(row.cells)


def find_tables(rows: Sequence[CellRow], shape: DataShape) -> list[FoundTable]:
    """Find the tables of a grid: runs of rows of numbers that only blank rows, comments and
    repeated headers interrupt."""
    tables: list[FoundTable] = []
    data: list[CellRow] = []
    waiting: list[CellRow] = []
    start = 0
    header = ""
    for k, row in enumerate(rows):
        if shape.fits(row) if data else shape.has(row):
            if not data:
                start, header = k, words(rows[k - 1]).strip() if k else ""
            elif not all(interrupts(one, header) for one in waiting):
                tables.append(FoundTable(tuple(rows[:start]), tuple(data)))
                data, start, header = [], k, words(rows[k - 1]).strip()
            else:
                data += [one for one in waiting if not one.is_blank]
            data.append(row)
            waiting = []
        elif data:
            waiting.append(row)
    if data:
        tables.append(FoundTable(tuple(rows[:start]), tuple(data)))
    return [sort_interruptions(one, shape) for one in tables]


def interrupts(row: CellRow, header: str) -> bool:
    """Whether a row may stand within a table: a blank one, a comment, or the header once more."""
    text = words(row).strip()
    return not text or row.is_blank or text == header or text.startswith(COMMENT_MARKS)


def sort_interruptions(table: FoundTable, shape: DataShape) -> FoundTable:
    """The table with the rows of words among its rows of numbers put aside."""
    data = tuple(row for row in table.data if shape.fits(row))
    among = tuple(row for row in table.data if not shape.fits(row))
    return FoundTable(table.above, data, among)


def choose_table(grid: CellGrid, tables: list[FoundTable], decisions: Decisions) -> FoundTable:
    """The one table of a file, or the one that is asked for.

    Raises
    ------
    InputError
        There are several, and none is asked for, or there is none of this number.
    """
    most = max(len(one.data) for one in tables)
    real = [
        one for one in tables if len(one.data) >= max(min(MIN_TABLE_ROWS, most), SMALL_SHARE * most)
    ]
    number = decisions.table
    if len(real) > 1 and not number:
        places = ", ".join(
            f"{k}: {grid.place_word}s {one.data[0].number} to {one.data[-1].number}"
            for k, one in enumerate(real, 1)
        )
        question = ImportQuestion(
            "",
            f"{len(real)} tables stand one after the other ({places})",
            "--table {}",
            tuple(str(k + 1) for k in range(len(real))),
            "table {} of the file is read",
        )
        answer = decisions.decide(grid.file, question)
        number = int(answer) if answer.isdigit() else 0
    if number > len(real) or (len(real) > 1 and number < 1):
        raise ForeignTable(grid.file, (), ()).error(
            "--table", f"the file has {len(real)} tables, numbered from 1 on"
        )
    return real[max(number, 1) - 1]


def rows_after(
    rows: Sequence[CellRow], tables: list[FoundTable], found: FoundTable
) -> list[CellRow]:
    """The rows behind a table that are not blank."""
    last = found.data[-1].number
    return [row for row in rows if row.number > last and not row.is_blank]


def find_header(
    above: Sequence[CellRow], shape: DataShape, mark: str
) -> tuple[list[CellRow], list[CellRow]]:
    """Divide the rows above a table: those of its header, and those before them."""
    header: list[CellRow] = []
    k = len(above)
    while k and above[k - 1].is_blank and not header:
        k -= 1
    while k and len(header) < MAX_HEADER_ROWS:
        row = as_header(above[k - 1], shape.width, mark)
        if row is None:
            break
        header.insert(0, row)
        k -= 1
    return header, [row for row in above[:k] if not row.is_blank]


def as_header(row: CellRow, width: int, mark: str) -> CellRow | None:
    """A row as one of a header of so many columns; None if it is none."""
    cells = list(trimmed(row, width))
    first = cells[0].lstrip() if cells else ""
    sign = next((one for one in COMMENT_MARKS[:3] if first.startswith(one)), "")
    if sign and not (sign == "%" and first == "%"):
        cells[0] = first[len(sign) :].strip() if len(first) > len(sign) else ""
        if not cells[0] and len(cells) == width + 1:
            cells = cells[1:]
    if mark in (" ", "  ", "") and len(cells) != width:
        cells = resplit(row.text.strip().removeprefix(sign or "\0").strip(), width) or cells
    there = sum(bool(cell.strip()) for cell in cells)
    tagged = sum(bool(TAGGED.fullmatch(cell.strip())) for cell in cells)
    if tagged or (there >= max(2, (width + 1) // 2) and len(cells) >= width - 1):
        return replace(row, cells=tuple(cell.strip() for cell in cells))
    if width == 1 and len(cells) == 1 and len(cells[0]) < 40 and there:
        return replace(row, cells=(cells[0].strip(),))
    return None


def resplit(text: str, width: int) -> list[str] | None:
    """The cells of a header between blanks, whose names may have blanks; None if none fit.

    >>> resplit("Time (s)  Crank angle (deg)", 2), resplit('"t s" x', 2), resplit("t (s) x (m)", 2)
    (['Time (s)', 'Crank angle (deg)'], ['t s', 'x'], ['t (s)', 'x (m)'])
    """
    bracketed = r"\S+?(?:\s*[(\[][^)\]]*[)\]])|\S+"
    quoted = r'"[^"]*"|\S+'
    for found in (
        re.split(r"\s{2,}|\t+", text),
        re.split(r"\s*[,;]\s*", text),
        re.findall(quoted, text),
        re.findall(bracketed, text),
    ):
        if len(found) == width:
            return [cell.strip('" ') for cell in found]
    return None


@dataclass(frozen=True)
class HeaderRows:
    """The rows of a header.

    Attributes
    ----------
    names : tuple of str
        The names of the columns; empty without a row of names.
    units : CellRow, optional
        The row of units.
    rows : tuple of CellRow
        All rows of it.
    """

    names: tuple[str, ...]
    units: CellRow | None
    rows: tuple[CellRow, ...]


def read_header(
    grid: CellGrid, header: HeaderRows, shape: DataShape, found: FoundTable
) -> tuple[list[ColumnHead], list[Correction]]:
    """The heads of the columns, from the rows of a header.

    Raises
    ------
    InputError
        The rows have more cells than the header; a unit in a name contradicts that below it.
    """
    told: list[Correction] = []
    names = list(header.names)
    if not names:
        names = [f"column {k + 1}" for k in range(shape.width)]
        told.append(
            Correction(ImportRule.HEADER, f"there is no header; columns are called {names[0]}, ..")
        )
    check_widths(grid, names, shape, found)
    heads = [read_head(name) for name in names]
    if header.units is not None:
        where = f"{grid.place_word} {header.units.number}"
        heads = [
            with_unit(grid, head, cell.strip(), where)
            for head, cell in zip(heads, padded(header.units.cells, len(heads)), strict=True)
        ]
        told.append(Correction(ImportRule.UNITS, f"{where} has the units"))
    return heads, told


def padded(cells: Sequence[str], width: int) -> list[str]:
    """Cells of a row, with empty ones up to a width."""
    return [*cells[:width], *[""] * (width - len(cells))]


def divide_header(rows: list[CellRow]) -> HeaderRows:
    """Find the units, other properties and names among the rows above a table, from the last on."""
    units: CellRow | None = None
    k = len(rows)
    while k:
        row = rows[k - 1]
        tagged = [TAGGED.fullmatch(cell) for cell in row.cells]
        if any(tagged):
            if any(one and one[1] == "Unit" for one in tagged):
                told = tuple(one[2] if one and one[1] == "Unit" else "" for one in tagged)
                units = replace(row, cells=told)
        elif not all(cell.lower() in DATA_TYPES or not cell for cell in row.cells):
            if units is not None or not is_unit_row(row, alone=k == 1):
                break
            units = row
        k -= 1
    end = k
    names: list[str] = []
    while k and not (names and all(names) and len(set(names)) == len(names)):
        cells = list(rows[k - 1].cells)
        above = filled(padded(cells, len(names))) if names else cells
        names = [
            " ".join(filter(None, pair))
            for pair in zip(above, names or [""] * len(cells), strict=True)
        ]
        k -= 1
    if k and units is None and end and is_unit_row(rows[k - 1], alone=True):
        units, k = rows[k - 1], k - 1
    return HeaderRows(tuple(names), units, tuple(rows[k:]))


def is_unit_row(row: CellRow, alone: bool) -> bool:
    """Whether a row of a header has units, and no names.

    `alone` is true if no other row has the names; then the first column must be in a unit of time.
    """
    cells = [bare(cell) for cell in row.cells if bare(cell)]
    known = [read_unit(cell) or doubtful_unit(cell) for cell in cells]
    others = [cell for cell, unit in zip(cells, known, strict=True) if not unit]
    if not any(known) or any(cell.lower() not in NO_UNIT for cell in others):
        bracketed = [cell for cell in row.cells if cell]
        return any(known) and all(re.fullmatch(r"[\[(].*[\])]", cell) for cell in bracketed)
    return not alone or read_unit(bare(row.cells[0])) in TIME_UNITS


def bare(cell: str) -> str:
    """A cell without brackets around it."""
    cell = cell.strip()
    found = re.fullmatch(r"[\[(<{]\s*(.*?)\s*[\])>}]", cell)
    return found[1] if found else cell


def with_unit(grid: CellGrid, head: ColumnHead, cell: str, where: str) -> ColumnHead:
    """A head with the unit of the row of units.

    Raises
    ------
    InputError
        The name has another unit.
    """
    text = bare(cell)
    if not text:
        return head
    unit = "1" if text.lower() in NO_UNIT else read_unit(text)
    below = read_head(f"{head.name} [{text}]")
    unit = below.unit if unit and below.unit else unit
    if head.unit and unit and unit != head.unit:
        raise ForeignTable(grid.file, (), ()).error(
            where,
            f"the unit of {head.name} is {text!r} here, and {head.written_unit!r} in its name; "
            f"mend one of them, or state it: --unit {head.name}={head.unit}",
        )
    clockwise = head.clockwise or says_clockwise(text)
    return ColumnHead(head.name, unit or "", text, clockwise)


def filled(cells: list[str]) -> list[str]:
    """Cells of a row in which a name holds for the empty ones behind it."""
    found: list[str] = []
    for cell in cells:
        found.append(cell or (found[-1] if found else ""))
    return found


def check_widths(grid: CellGrid, names: list[str], shape: DataShape, found: FoundTable) -> None:
    """Raise InputError if rows have more cells than the header has names."""
    if shape.width <= len(names):
        return
    first = next(row for row in found.data if len(row.cells) > len(names))
    hint = ""
    if grid.mark == "," and shape.width == 2 * len(names):
        hint = "; commas seem to be both separators and decimal signs: export with semicolons"
    raise ForeignTable(grid.file, (), ()).error(
        f"{grid.place_word} {first.number}",
        f"{shape.width} cells, the header has {len(names)}{hint}",
    )


def make_columns(heads: list[ColumnHead], data: Sequence[CellRow]) -> tuple[ForeignColumn, ...]:
    """The columns of a table, with the names of their heads, each once."""
    names = unique([head.name for head in heads])
    return tuple(
        ForeignColumn(
            name,
            tuple(row.cells[k] if k < len(row.cells) else "" for row in data),
            head.unit,
            head.written_unit,
            head.clockwise,
        )
        for k, (name, head) in enumerate(zip(names, heads, strict=True))
    )


def unique(names: list[str]) -> list[str]:
    """Names, each once: a second one gets a number, and one without letters is that of its place.

    >>> unique(["t", "x", "x", ""])
    ['t', 'x', 'x (2)', 'column 4']
    """
    seen: Counter[str] = Counter()
    found: list[str] = []
    for k, name in enumerate(names):
        name = name or f"column {k + 1}"
        seen[name] += 1
        full = f"{name} ({seen[name]})" if seen[name] > 1 else name
        while full in found:
            full += "'"
        found.append(full)
    return found


def stated_rate(preamble: list[CellRow]) -> str:
    """The rows per second that a line above a table states, or an empty text."""
    for row in preamble:
        if found := STATED_RATE.search(words(row)):
            return (found[1] or found[2]).replace(",", ".")
    return ""


def left_out(
    preamble: list[CellRow], header: Sequence[CellRow], grid: CellGrid
) -> list[Correction]:
    """What is said of the lines before the header, and of a header of several rows."""
    told = []
    if preamble:
        told.append(
            Correction(
                ImportRule.PREAMBLE,
                f"{places(preamble, grid.place_word)} before the table {be(preamble)} left out: "
                f"{shortened(preamble)}",
            )
        )
    if header and (preamble or header[0].number > 1 or len(header) > 1):
        last = header[-1].number
        which = f"{grid.place_word} {header[0].number}"
        which = f"{grid.place_word}s {header[0].number} to {last}" if len(header) > 1 else which
        told.append(Correction(ImportRule.HEADER, f"the header is {which}"))
    return told


def outside(found: FoundTable, after: list[CellRow], grid: CellGrid) -> list[Correction]:
    """What is said of rows of words among the rows of numbers and behind them."""
    told = []
    if found.among:
        told.append(
            Correction(
                ImportRule.INTERRUPTION,
                f"{places(found.among, grid.place_word)} among the numbers {be(found.among)} left "
                f"out: {shortened(found.among)}",
            )
        )
    if after:
        told.append(
            Correction(
                ImportRule.FOOTER,
                f"{places(after, grid.place_word)} after the table {be(after)} left out: "
                f"{shortened(after)}",
            )
        )
    return told


def places(rows: Sequence[CellRow], word: str) -> str:
    """Where rows stand.

    >>> places([CellRow(3, ()), CellRow(5, ())], "line"), places([CellRow(3, ())], "row")
    ('lines 3 to 5', 'row 3')
    """
    if len(rows) == 1:
        return f"{word} {rows[0].number}"
    return f"{word}s {rows[0].number} to {rows[-1].number}"


SHOWN_LETTERS = 40  # letters of a line that are shown, so that a sentence fits into two lines


def shortened(rows: Sequence[CellRow]) -> str:
    """The beginning of the first row that has words."""
    text = " ".join(words(rows[0]).split())
    more = " .." if len(text) > SHOWN_LETTERS or len(rows) > 1 else ""
    return f"{text[:SHOWN_LETTERS].strip()!r}{more}"


def is_all_empty(column: ForeignColumn) -> bool:
    """Whether a column has no values at all."""
    return all(map(is_empty, column.cells))
