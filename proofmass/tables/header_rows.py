"""The header of a table in a grid of cells: its rows above the numbers, names and units in them."""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

from proofmass.tables.foreign import ForeignTable
from proofmass.tables.headers import is_time_name, read_head
from proofmass.tables.text import (
    COMMENT_MARKS,
    CellGrid,
    CellRow,
    DataShape,
    is_value,
    row_words,
    trimmed,
)
from proofmass.tables.unit_words import NO_UNIT, TIME_UNITS, doubtful_unit, read_unit

MAX_HEADER_ROWS = 8  # rows of a header: of motion capture five, of the inspector of Simulink six
DATA_TYPES = frozenset("double single float float32 float64 int int32 int64 boolean string".split())
"""Words of a row that has the types of columns."""
TAGGED = re.compile(r"(Unit|Type|Interp|BlockPath|PortIndex|Enum|Sync)\s*:\s*(.*)")
"""A cell of a row between header and numbers in an export of the inspector of Simulink."""
UNIT_LABELS = ("unit", "units", "einheit", "einheiten", "unité", "unidad", "unità", "jednostka")
"""Words in front of a row of units."""
RULER = re.compile(r"[-=:+_*~\s|]*")
"""A line that is drawn below a header."""


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
        if RULER.fullmatch(row_words(above[k - 1])) and not above[k - 1].is_blank:
            k -= 1
            continue
        upper = above[k - 2] if k > 1 else None
        if not header and is_single_word(above[k - 1], upper, grid, shape.width):
            left.append(above[k - 1])
            k -= 1
            continue
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


def is_single_word(row: CellRow, above: CellRow | None, grid: CellGrid, width: int) -> bool:
    """Whether a row between header and numbers has one word only, such as ``Data``."""
    if width < 2 or sum(bool(cell.strip()) for cell in trimmed(row, width)) != 1:
        return False
    return above is not None and as_header(above, width, grid.mark) is not None


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
    text = row_words(row).lstrip("#% ")
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
        return replace(row, cells=tuple(cell.strip(' "') for cell in cells))
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
        if len(rows[k - 1].cells) != len(names) or not all(
            above[j] and not is_value(above[j]) for j in needy
        ):
            break
        names = [
            joined_name(above[j], name) if j in needy or lacks_unit(above[j], name) else name
            for j, name in enumerate(names)
        ]
        k -= 1
    if k and units is None and end and is_unit_row(rows[k - 1], alone=True):
        units, k = rows[k - 1], k - 1
    elif k and units is None and has_units(rows[k - 1].cells, names):
        names = [joined_name(*pair) for pair in zip(rows[k - 1].cells, names, strict=True)]
        k -= 1
    return HeaderRows(tuple(names), units, tuple(rows[k:]))


def has_units(above: Sequence[str], names: list[str]) -> bool:
    """Whether a row above names has units in half of its cells, and the names have none."""
    if len(above) != len(names) or any(read_head(name).written_unit for name in names):
        return False
    return 2 * sum(bool(read_head(cell).unit) for cell in above) >= len(names) > 0


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
    cells = [bare(cell) for cell in row.cells if bare(cell).lower() not in ("", *UNIT_LABELS)]
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


def filled(cells: list[str]) -> list[str]:
    """Cells of a row in which a name holds for the empty ones behind it."""
    found: list[str] = []
    for cell in cells:
        found.append(cell or (found[-1] if found else ""))
    return found
