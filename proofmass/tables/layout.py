"""The parts of a grid of cells: lines before the table, header, units, rows, lines after it.

The rows of numbers are found first, by their width and by the columns that have values.  The rows
directly above them are the header; a row of it may have units, and two rows of it may have the two
halves of names.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

from proofmass.base.wording import format_list
from proofmass.tables.cells import is_empty, is_plain, shown, split_number
from proofmass.tables.decisions import Decisions, ImportQuestion
from proofmass.tables.foreign import Correction, ForeignColumn, ForeignTable, ImportRule, be
from proofmass.tables.header_rows import (
    HeaderRows,
    bare,
    divide_header,
    find_header,
    padded,
)
from proofmass.tables.headers import ColumnHead, read_head, says_clockwise, unique
from proofmass.tables.text import (
    COMMENT_MARKS,
    SAMPLE_LINES,
    CellGrid,
    CellRow,
    DataShape,
    find_shape,
    is_value,
    row_words,
    trimmed,
)
from proofmass.tables.unit_words import NO_UNIT, read_unit

MIN_TABLE_ROWS = 3  # rows of numbers that are a table of their own, and no line of a preamble
SMALL_SHARE = 0.2
"""Rows of a table over those of the largest one in a file, below which they are no table of their
own: lines of numbers before it, or of extremes after it."""
STATED_RATE = re.compile(
    r"(\d+(?:[.,]\d+)?)\s*(?:fps\b|frames? per second|bilder/s|rows per second)|"
    r"(?:\bfps\b|frame ?rate|bildrate|sampl\w*[ _]?(?:rate|freq\w*)|abtastrate|rate_hz)"
    r"\D{0,14}?(\d+(?:[.,]\d+)?)",
    re.IGNORECASE,
)
"""A line above a table that states the rows per second."""
STATED_ANGLES = {
    "deg": re.compile(r"indegrees\s*=\s*yes|angles?\b.{0,20}\bdeg(rees?)?\b", re.IGNORECASE),
    "rad": re.compile(r"indegrees\s*=\s*no|angles?\b.{0,20}\brad(ians?)?\b", re.IGNORECASE),
}
"""Lines above a table that state the unit of all angles, such as OpenSim's ``inDegrees=yes``."""
HALF = re.compile(r"\d+(?:[eE][-+]?\d+)?")
"""The second half of a number that its decimal comma divides."""
WHOLE_HALF = re.compile(r"\s*[-+]?\d+")
"""Its first half."""
COMMENT_COLUMN = "Comment"
"""The name of a last column that LabVIEW writes for remarks, in which rows have no cells."""


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
    shape = find_shape(list(grid.rows[:SAMPLE_LINES])) or find_shape(list(grid.rows))
    if shape is None:
        raise ForeignTable(grid.file, (), ()).error("", "no table: no rows of numbers")
    grid, shape = join_decimals(grid, shape)
    refuse_broken_rows(grid, shape)
    tables = find_tables(grid.rows, shape)
    found, cut = without_cut_row(choose_table(grid, tables, decisions), shape, grid)
    check_lengths(grid, found, shape)
    candidates, preamble = find_header(found.above, shape, grid)
    header = divide_header(candidates, shape)
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
        stated_angle(preamble),
        next((row.number for row in preamble if says_clockwise(row_words(row))), 0),
        grid.corrections,
    )
    after = rows_after(grid.rows, tables, found)
    told = [*left_out(preamble, header.rows, grid), *told, *outside(found, after, grid), *cut]
    return replace(table, corrections=(*table.corrections, *told))


def join_decimals(grid: CellGrid, shape: DataShape) -> tuple[CellGrid, DataShape]:
    """The grid with halves of numbers put together, if commas are decimal signs and separators.

    That is so if the row above the numbers has half as many cells, none of them a number, and each
    second cell of each row of numbers has digits only.
    """
    if grid.mark != "," or shape.width % 2:
        return grid, shape
    first = next((k for k, row in enumerate(grid.rows) if shape.has(row)), 0)
    head = grid.rows[first - 1].cells if first else ()
    data = [row for row in grid.rows if shape.has(row)]
    halves = [cell for row in data for cell in row.cells[1 : shape.width : 2]]
    wholes = [cell for row in data for cell in row.cells[: shape.width : 2]]
    if len(head) != shape.width // 2 or any(map(is_value, head)):
        return grid, shape
    if not all(map(HALF.fullmatch, halves)) or not all(map(WHOLE_HALF.fullmatch, wholes)):
        return grid, shape
    chosen = set(data)
    rows = tuple(
        replace(row, cells=tuple(map(",".join, zip(row.cells[::2], row.cells[1::2], strict=True))))
        if row in chosen
        else row
        for row in grid.rows
    )
    told = Correction(
        ImportRule.DECIMALS, "commas are separators and decimal signs: halves of numbers are joined"
    )
    joined = replace(grid, rows=rows, decimal=",", corrections=(*grid.corrections, told))
    return joined, DataShape(len(head), tuple(range(len(head))), shape.rows, shape.share)


def refuse_broken_rows(grid: CellGrid, shape: DataShape) -> None:
    """Raise InputError if a row beside one of numbers begins like it and goes on otherwise.

    Such a row is not left out as a remark is: it has a place on the x, and a value is missing.
    """
    fitting = [False, *map(shape.fits, grid.rows), False]
    for k, row in enumerate(grid.rows, 1):
        beside = fitting[k - 1] or (fitting[k + 1] and len(row.cells) == shape.width)
        if fitting[k] or not beside or row.is_blank:
            continue
        cells = trimmed(row, shape.width)
        first = shape.values[0]
        if first >= len(cells) or not is_value(cells[first]) or len(list(filter(None, cells))) < 2:
            continue
        place = f"{grid.place_word} {row.number}"
        wrong = [k for k in shape.values if k < len(cells) and not_a_value(cells[k])]
        text = f"{len(cells)} cells, the rows around it have {shape.width}"
        if wrong:
            text = f"{shown(cells[wrong[0]])} in cell {wrong[0] + 1} is no number"
        raise ForeignTable(grid.file, (), ()).error(place, text)


def not_a_value(cell: str) -> bool:
    """Whether a cell is neither a value nor empty."""
    return not is_empty(cell) and not is_value(cell)


def find_tables(rows: Sequence[CellRow], shape: DataShape) -> list[FoundTable]:
    """Find the tables of a grid: runs of rows of numbers that only blank rows, comments and
    repeated headers interrupt."""
    tables: list[FoundTable] = []
    data: list[CellRow] = []
    among: list[CellRow] = []
    waiting: list[CellRow] = []
    start, header = 0, ""
    for k, row in enumerate(rows):
        if not (shape.fits(row) if data else shape.has(row)):
            waiting += [row] * bool(data)
            continue
        if data and not belongs(waiting, header, data[-1], row):
            tables.append(FoundTable(tuple(rows[:start]), tuple(data), tuple(among)))
            data, among = [], []
        if not data:
            start = k
            while start and may_lack_cells(rows[start - 1], shape):
                start -= 1
            data += rows[start:k]
            header = row_words(rows[start - 1]).strip() if start else ""
        else:
            among += [one for one in waiting if not one.is_blank]
        data.append(row)
        waiting = []
    if data:
        tables.append(FoundTable(tuple(rows[:start]), tuple(data), tuple(among)))
    return tables


def may_lack_cells(row: CellRow, shape: DataShape) -> bool:
    """Whether a row is a first row of numbers without its last cells, as of differences."""
    return shape.fits(row) and sum(bool(cell.strip()) for cell in row.cells) > 1


def belongs(waiting: list[CellRow], header: str, last: CellRow, row: CellRow) -> bool:
    """Whether a row of numbers goes on with a table, behind rows that have none."""
    if all(interrupts(one, header) for one in waiting):
        return True
    return all(map(is_remark, waiting)) and goes_on(last, row)


def interrupts(row: CellRow, header: str) -> bool:
    """Whether a row may stand within a table: a blank one, a comment, or the header once more."""
    text = row_words(row).strip()
    return not text or row.is_blank or text == header or text.startswith(COMMENT_MARKS)


def is_remark(row: CellRow) -> bool:
    """Whether a row has one cell of words, such as the name of an event."""
    return sum(bool(cell.strip()) for cell in row.cells) <= 1


def goes_on(last: CellRow, row: CellRow) -> bool:
    """Whether the first number of a row is larger than that of the row before."""
    numbers = [split_number(one.cells[0]) for one in (last, row)]
    plain = [p[0].replace(",", ".") for p in numbers if p]
    return len(plain) == 2 and all(map(is_plain, plain)) and float(plain[1]) > float(plain[0])


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
        places = format_list(
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


def without_cut_row(
    found: FoundTable, shape: DataShape, grid: CellGrid
) -> tuple[FoundTable, list[Correction]]:
    """The table without a last row that was cut off as it was written, and what is said of it.

    Such a row is the end of a text without a line's end, and lacks cells, or digits of its last
    number that all other rows have.
    """
    last = found.data[-1]
    if not grid.open_end or last.number != grid.rows[-1].number:
        return found, []
    cells, place = trimmed(last, shape.width), f"{grid.place_word} {last.number}"
    there = [row.cells for row in found.data[:-1] if len(row.cells) == len(cells)]
    digits = {decimals(one[-1]) for one in there if not is_empty(one[-1])}
    if len(cells) >= shape.width and decimals(cells[-1]) in digits and len(digits) == 1:
        return found, []
    if len(cells) >= shape.width and len(digits) != 1:
        words = f"{place}, the last one, has no line's end: its last number may have been cut off"
        return found, [Correction(ImportRule.FOOTER, words)]
    words = f"{place} is left out: it is cut off, and no line's end follows"
    return replace(found, data=found.data[:-1]), [Correction(ImportRule.FOOTER, words)]


def decimals(cell: str) -> int:
    """The number of letters behind the last point or comma of a cell; -1 without either."""
    _, sign, behind = cell.strip().replace(",", ".").rpartition(".")
    return len(behind) if sign else -1


def check_lengths(grid: CellGrid, found: FoundTable, shape: DataShape) -> None:
    """Raise InputError if a row has fewer or more cells than others: which ones is not known."""
    for row in found.data:
        beyond = row.cells[shape.width :]
        if len(row.cells) < shape.width or (beyond and not any(map(str.strip, beyond))):
            raise ForeignTable(grid.file, (), ()).error(
                f"{grid.place_word} {row.number}",
                f"{len(row.cells)} cells, the rows around it have {shape.width}; an empty cell "
                "needs its separator too",
            )


def rows_after(
    rows: Sequence[CellRow], tables: list[FoundTable], found: FoundTable
) -> list[CellRow]:
    """The rows behind a table that are not blank."""
    last = found.data[-1].number
    return [row for row in rows if row.number > last and not row.is_blank]


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
    names = fit_names(grid, names, shape, found)
    heads = [read_head(name) for name in names]
    if header.units is not None:
        require_all_units(grid, header.units, names)
        where = f"{grid.place_word} {header.units.number}"
        heads = [
            with_unit(grid, head, cell.strip(), where)
            for head, cell in zip(heads, padded(header.units.cells, len(heads)), strict=True)
        ]
        told.append(Correction(ImportRule.UNITS, f"{where} has the units"))
    return heads, told


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


def require_all_units(grid: CellGrid, units: CellRow, names: list[str]) -> None:
    """Raise InputError if a row of units has fewer or more cells than there are names."""
    if len(trimmed(units, len(names))) != len(names):
        raise ForeignTable(grid.file, (), ()).error(
            f"{grid.place_word} {units.number}",
            f"{len(units.cells)} units for {len(names)} columns; each one needs its place",
        )


def with_row_numbers(names: list[str], shape: DataShape, found: FoundTable) -> list[str]:
    """The names of columns, with one for numbers of rows that have none, as R writes them."""
    if shape.width != len(names) + 1:
        return names
    numbers = [row.cells[0].strip() for row in found.data]
    if numbers == [str(k + 1) for k in range(len(numbers))]:
        return ["row", *names]
    return names


def fit_names(grid: CellGrid, names: list[str], shape: DataShape, found: FoundTable) -> list[str]:
    """The names of as many columns as the rows of numbers have.

    Raises
    ------
    InputError
        There are more or fewer names than cells, which may belong to other columns then.
    """
    names = with_row_numbers(names, shape, found)
    if len(names) < shape.width:
        beyond = [row for row in found.data if any(c.strip() for c in row.cells[len(names) :])]
        if not beyond:
            return [*names, *[""] * (shape.width - len(names))]
        hint = ""
        if grid.mark == "," and shape.width == 2 * len(names):
            hint = "; commas seem to be both separators and decimal signs: export with semicolons"
        raise ForeignTable(grid.file, (), ()).error(
            f"{grid.place_word} {beyond[0].number}",
            f"{len(beyond[0].cells)} cells, the header has {len(names)}{hint}",
        )
    left = [name for name in names[shape.width :] if name.strip()]
    commented = any(len(row.cells) > shape.width for row in found.data) or left == [COMMENT_COLUMN]
    if left and not commented:
        raise ForeignTable(grid.file, (), ()).error(
            f"{grid.place_word} {found.data[0].number}",
            f"{shape.width} cells, the header has {len(names)}",
        )
    return names


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


def stated_rate(preamble: list[CellRow]) -> str:
    """The rows per second that a line above a table states, or an empty text."""
    for row in preamble:
        if found := STATED_RATE.search(row_words(row)):
            return (found[1] or found[2]).replace(",", ".")
    return ""


def stated_angle(preamble: list[CellRow]) -> str:
    """The unit of angles that a line above a table states, or an empty text."""
    for row in preamble:
        for unit, pattern in STATED_ANGLES.items():
            if pattern.search(row_words(row)):
                return unit
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
    text = " ".join(row_words(rows[0]).split())
    more = " .." if len(text) > SHOWN_LETTERS or len(rows) > 1 else ""
    return f"{text[:SHOWN_LETTERS].strip()!r}{more}"
