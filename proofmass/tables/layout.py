"""The parts of a grid of cells: lines before the table, header, units, rows, lines after it.

The rows of numbers are found first, by their width and by the columns that have values.  The rows
directly above them are the header; a row of it may have units, and two rows of it may have the two
halves of names.
"""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

from proofmass.base.wording import format_list
from proofmass.tables.cells import is_empty, is_plain, split_number
from proofmass.tables.decisions import Decisions, ImportQuestion
from proofmass.tables.foreign import Correction, ForeignColumn, ForeignTable, ImportRule, be
from proofmass.tables.headers import ColumnHead, is_time_name, read_head, says_clockwise
from proofmass.tables.text import (
    COMMENT_MARKS,
    SAMPLE_LINES,
    CellGrid,
    CellRow,
    DataShape,
    find_shape,
    is_value,
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
STATED_ANGLES = {
    "deg": re.compile(r"indegrees\s*=\s*yes|angles?\b.{0,20}\bdeg(rees?)?\b", re.IGNORECASE),
    "rad": re.compile(r"indegrees\s*=\s*no|angles?\b.{0,20}\brad(ians?)?\b", re.IGNORECASE),
}
"""Lines above a table that state the unit of all angles, such as OpenSim's ``inDegrees=yes``."""
HALF = re.compile(r"\d+(?:[eE][-+]?\d+)?")
"""The second half of a number that its decimal comma divides."""
RULER = re.compile(r"[-=:+_*~\s|]*")
"""A line that is drawn below a header."""


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
        next((row.number for row in preamble if says_clockwise(words(row))), 0),
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
    if len(head) != shape.width // 2 or any(map(is_value, head)):
        return grid, shape
    if not all(HALF.fullmatch(cell) for cell in halves):
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


def words(row: CellRow) -> str:
    """The words of a row."""
    return row.text or " ".join(row.cells)


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
            text = f"{cells[wrong[0]].strip()!r} in cell {wrong[0] + 1} is no number"
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
            header = words(rows[start - 1]).strip() if start else ""
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
    text = words(row).strip()
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
    if not grid.open_end or last.number != grid.rows[-1].number or len(found.data) < 3:
        return found, []
    cells = trimmed(last, shape.width)
    digits = {decimals(row.cells[-1]) for row in found.data[:-1] if len(row.cells) == len(cells)}
    if len(cells) >= shape.width and (len(digits) > 1 or decimals(cells[-1]) in digits):
        return found, []
    words = f"{grid.place_word} {last.number} is left out: it is cut off, and no line's end follows"
    return replace(found, data=found.data[:-1]), [Correction(ImportRule.FOOTER, words)]


def decimals(cell: str) -> int:
    """The number of letters behind the last point or comma of a cell."""
    return len(re.split(r"[.,]", cell.strip())[-1])


def check_lengths(grid: CellGrid, found: FoundTable, shape: DataShape) -> None:
    """Raise InputError if a row between others lacks cells: which ones is not known."""
    short = [k for k, row in enumerate(found.data) if len(row.cells) < shape.width]
    full = [k for k, row in enumerate(found.data) if len(row.cells) >= shape.width]
    wrong = next((k for k in short if full[0] < k < full[-1]), None)
    if wrong is not None:
        row = found.data[wrong]
        raise ForeignTable(grid.file, (), ()).error(
            f"{grid.place_word} {row.number}",
            f"{len(row.cells)} cells, the rows around it have {shape.width}",
        )


def rows_after(
    rows: Sequence[CellRow], tables: list[FoundTable], found: FoundTable
) -> list[CellRow]:
    """The rows behind a table that are not blank."""
    last = found.data[-1].number
    return [row for row in rows if row.number > last and not row.is_blank]


def find_header(
    above: Sequence[CellRow], shape: DataShape, grid: CellGrid
) -> tuple[list[CellRow], list[CellRow]]:
    """Divide the rows above a table: those of its header, and those before them.

    Raises
    ------
    InputError
        The row above the table names columns, and it is not clear which.
    """
    header: list[CellRow] = []
    left: list[CellRow] = []
    k = len(above)
    while k and above[k - 1].is_blank and not header:
        k -= 1
    while k and len(header) < MAX_HEADER_ROWS:
        if RULER.fullmatch(words(above[k - 1])) and not above[k - 1].is_blank:
            k -= 1
            continue
        upper = above[k - 2] if k > 1 else None
        if not header and is_statistic(above[k - 1], upper, grid, shape.width):
            left.append(above[k - 1])
            k -= 1
            continue
        row = as_header(above[k - 1], shape.width, grid.mark)
        if row is None and not header and grid.mark in (" ", "  "):
            require_no_names(grid, above[k - 1], shape)
        if row is None:
            break
        header.insert(0, row)
        k -= 1
    return header, [*[row for row in above[:k] if not row.is_blank], *reversed(left)]


def joined_brackets(cells: list[str]) -> list[str]:
    """Cells of a header put together where a separator stood in a bracket.

    >>> joined_brackets(["t [s]", "phi (deg", " cw)"])
    ['t [s]', 'phi (deg, cw)']
    """
    found: list[str] = []
    for cell in cells:
        is_open = found and found[-1].count("(") > found[-1].count(")")
        if is_open or (found and found[-1].count("[") > found[-1].count("]")):
            found[-1] += f",{cell}"
        else:
            found.append(cell)
    return found


def is_statistic(row: CellRow, above: CellRow | None, grid: CellGrid, width: int) -> bool:
    """Whether a row between header and numbers has a word, such as ``Max``, and then numbers."""
    cells = [cell for cell in trimmed(row, width) if cell.strip()]
    if len(cells) < 2 or is_value(cells[0]) or not all(map(is_value, cells[1:])):
        return False
    if above is None or (upper := as_header(above, width, grid.mark)) is None:
        return False
    there = [cell for cell in upper.cells if cell]
    return len(there) >= len(cells) and (
        not any(map(is_value, there)) or all(map(is_value, there[1:]))
    )


def require_no_names(grid: CellGrid, row: CellRow, shape: DataShape) -> None:
    """Raise InputError if a row that cannot be divided among the columns has names or units."""
    text = words(row).lstrip("#% ")
    parts = text.split()
    if is_time_name(parts[0]) or any(read_unit(bare(part)) for part in parts if "(" in part):
        raise ForeignTable(grid.file, (), ()).error(
            f"{grid.place_word} {row.number}",
            f"{len(parts)} words for {shape.width} columns between blanks; put names with blanks "
            "into quotation marks, or separate the cells by tabs",
        )


def as_header(row: CellRow, width: int, mark: str) -> CellRow | None:
    """A row as one of a header of so many columns; None if it is none."""
    cells = list(trimmed(row, width))
    first = cells[0].lstrip() if cells else ""
    sign = next((one for one in COMMENT_MARKS[:3] if first.startswith(one)), "")
    if sign and not (sign == "%" and first == "%"):
        cells[0] = first[len(sign) :].strip() if len(first) > len(sign) else ""
        if not cells[0] and len(cells) == width + 1:
            cells = cells[1:]
    if mark == "," and len(cells) > width:
        cells = joined_brackets(cells)
    if mark in (" ", "  ", "") and len(cells) != width:
        cells = resplit(row.text.strip().removeprefix(sign or "\0").strip(), width) or []
    there = sum(bool(cell.strip()) for cell in cells)
    if (
        there
        and is_value(next(filter(str.strip, cells)))
        and 2 * sum(map(is_value, cells)) >= there
    ):
        return None
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
    to_bracket = r"[^()\[\]]+[(\[][^)\]]*[)\]]"
    quoted = r'"[^"]*"|\S+'
    for found in (
        re.split(r"\s{2,}|\t+", text),
        re.split(r"\s*[,;]\s*", text),
        re.findall(quoted, text),
        re.findall(bracketed, text),
        re.findall(to_bracket, text),
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
    names = with_row_numbers(names, shape, found)
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


def divide_header(rows: list[CellRow], shape: DataShape) -> HeaderRows:
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
    if units is None and k > 1 and (mixed := units_below_names(rows[k - 1], rows[k - 2])):
        names_row, units = mixed
        return HeaderRows(names_row.cells, units, tuple(rows[k - 2 :]))
    names = list(rows[k - 1].cells) if k else []
    k -= bool(k)
    while k and (needy := nameless(names, shape)):
        above = filled(padded(rows[k - 1].cells, len(names)))
        if not all(above[j] and not is_value(above[j]) for j in needy):
            break
        names = [
            joined_name(above[j], name) if j in needy or lacks_unit(above[j], name) else name
            for j, name in enumerate(names)
        ]
        k -= 1
    if k and units is None and end and is_unit_row(rows[k - 1], alone=True):
        units, k = rows[k - 1], k - 1
    return HeaderRows(tuple(names), units, tuple(rows[k:]))


def nameless(names: list[str], shape: DataShape) -> set[int]:
    """The columns with values whose name is missing, or is that of another one too."""
    twice = {name for name, count in Counter(names).items() if name and count > 1}
    return {k for k in shape.values if k < len(names) and (not names[k] or names[k] in twice)}


def lacks_unit(above: str, below: str) -> bool:
    """Whether the upper half of a name has a unit, and the lower one has none."""
    return bool(read_head(above).unit) and not read_head(below).written_unit


def joined_name(above: str, below: str) -> str:
    """The name of a column from two rows, with its unit at the end.

    >>> joined_name("rocker [deg]", "measured"), joined_name("rod", "X (mm)"), joined_name("", "t")
    ('rocker measured [deg]', 'rod X (mm)', 't')
    """
    head = read_head(above)
    if below and head.unit and not read_head(below).written_unit:
        return f"{head.name} {below} [{head.written_unit}]"
    return " ".join(filter(None, (above, below)))


def units_below_names(row: CellRow, above: CellRow) -> tuple[CellRow, CellRow] | None:
    """The names and the units of two rows, of which the lower one has the name of a column too.

    Where the upper row has a name, the lower one must have a unit.
    """
    pairs = list(zip(above.cells, row.cells, strict=False))
    if not all(read_unit(bare(below)) for name, below in pairs if name) or all(above.cells):
        return None
    if not any(name for name, _ in pairs):
        return None
    names = tuple(name or below for name, below in pairs)
    units = tuple(below if name else "" for name, below in pairs)
    return replace(row, cells=names), replace(row, cells=units)


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


def with_row_numbers(names: list[str], shape: DataShape, found: FoundTable) -> list[str]:
    """The names of columns, with one for numbers of rows that have none, as R writes them."""
    if shape.width != len(names) + 1:
        return names
    numbers = [row.cells[0].strip() for row in found.data]
    if numbers == [str(k + 1) for k in range(len(numbers))]:
        return ["row", *names]
    return names


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


def stated_angle(preamble: list[CellRow]) -> str:
    """The unit of angles that a line above a table states, or an empty text."""
    for row in preamble:
        for unit, pattern in STATED_ANGLES.items():
            if pattern.search(words(row)):
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
    text = " ".join(words(rows[0]).split())
    more = " .." if len(text) > SHOWN_LETTERS or len(rows) > 1 else ""
    return f"{text[:SHOWN_LETTERS].strip()!r}{more}"


def is_all_empty(column: ForeignColumn) -> bool:
    """Whether a column has no values at all."""
    return all(map(is_empty, column.cells))
