"""Measurements of LabVIEW, ``.lvm``: a header with keys, one for each segment, and columns.

The format is that of NI's specification of the LabVIEW measurement file.  A column of times may be
missing; then the header has the first time and the spacing.
"""

from collections.abc import Sequence
from dataclasses import replace
from decimal import Decimal, InvalidOperation
from pathlib import Path

from proofmass.base.errors import InputError
from proofmass.tables.cells import is_plain
from proofmass.tables.decisions import Decisions, ImportQuestion
from proofmass.tables.foreign import Correction, ImportRule
from proofmass.tables.headers import read_head
from proofmass.tables.layout import COMMENT_COLUMN
from proofmass.tables.text import CellGrid, CellRow, lines_of

LVM_MARK = "LabVIEW Measurement"  # the first words of such a file
HEADER_END = "***End_of_Header***"  # the line behind a header
X_NAME = "X_Value"  # the name of the column of times
SEPARATORS = {"tab": "\t", "comma": ","}


def read_lvm(file: Path, text: str, decisions: Decisions, told: tuple[Correction, ...]) -> CellGrid:
    """Read a measurement of LabVIEW as a grid of its names, units and numbers.

    Raises
    ------
    InputError
        The header does not end, or there are several segments and none is asked for.
    """
    lines = [line.rstrip("\r\n") for line in lines_of(text)]
    ends = [k for k, line in enumerate(lines) if line.startswith(HEADER_END)]
    if not ends:
        raise InputError(file, "", f"a file of LabVIEW without the line {HEADER_END}")
    keys = dict(line.split("\t", 1) for line in lines[: ends[0]] if "\t" in line)
    keys |= dict(
        line.split(",", 1) for line in lines[: ends[0]] if "\t" not in line and "," in line
    )
    mark = SEPARATORS.get(keys.get("Separator", "Tab").strip().lower(), "\t")
    start = choose_segment(file, lines, ends, decisions)
    rows = [
        CellRow(k + 1, tuple(line.split(mark)), line)
        for k, line in enumerate(lines)
        if start < k and (k < segment_end(lines, ends, start))
    ]
    rows = [without_remark(row, rows[0]) for row in rows if not row.is_blank]
    if not rows:
        raise InputError(file, f"line {start + 1}", "no columns below this line")
    require_names(file, rows)
    segment = segment_keys(lines, ends, start, mark)
    decimal = keys.get("Decimal_Separator", "").strip()
    open_end = not text.endswith(("\n", "\r"))
    grid = CellGrid(file, tuple(rows), "line", mark, decimal, open_end)
    words = f"a measurement of LabVIEW: lines 1 to {start + 1} are its header"
    told = (*told, Correction(ImportRule.PREAMBLE, words))
    return with_times(replace(with_units(grid, segment), corrections=told), segment)


def without_remark(row: CellRow, head: CellRow) -> CellRow:
    """A row without its last cell, if that is an empty one for a remark."""
    named = [name.strip() for name in head.cells]
    if COMMENT_COLUMN in named and len(row.cells) > named.index(COMMENT_COLUMN) > 0:
        last = row.cells[named.index(COMMENT_COLUMN) :]
        if row is not head and not any(map(str.strip, last)):
            return replace(row, cells=row.cells[: named.index(COMMENT_COLUMN)])
    return row


def require_names(file: Path, rows: Sequence[CellRow]) -> None:
    """Raise InputError if the names of columns do not begin with that of the x, or lack some."""
    names = [name.strip() for name in rows[0].cells if name.strip()]
    width = max((len(row.cells) for row in rows[1:]), default=0)
    moved = names[-1] == COMMENT_COLUMN and any(
        is_plain(row.cells[len(names) - 1].replace(",", "."))
        for row in rows[1:]
        if len(row.cells) >= len(names)
    )
    if names[0] != X_NAME or moved or (names[-1] != COMMENT_COLUMN and len(names) < width):
        raise InputError(
            file,
            f"line {rows[0].number}",
            f"the names of columns begin with {X_NAME}, and end with {COMMENT_COLUMN}; some are "
            "missing",
        )


def choose_segment(file: Path, lines: Sequence[str], ends: list[int], decisions: Decisions) -> int:
    """The line at the end of the header of the segment that is read."""
    starts = [k for k in ends if has_columns(lines, ends, k)] or ends[-1:]
    number = decisions.table
    if len(starts) > 1 and not number:
        question = ImportQuestion(
            "",
            f"{len(starts)} segments, each with a header, "
            f"at lines {', '.join(str(k + 1) for k in starts)}",
            "--table {}",
            tuple(str(k + 1) for k in range(len(starts))),
            "segment {} is read",
        )
        answer = decisions.decide(file, question)
        number = int(answer) if answer.isdigit() else 0
    if not 0 <= number <= len(starts) or (len(starts) > 1 and number < 1):
        raise InputError(file, "--table", f"there are {len(starts)} segments, from 1 on")
    return starts[max(number, 1) - 1]


def has_columns(lines: Sequence[str], ends: list[int], start: int) -> bool:
    """Whether the header that ends at a line has columns below it, and no header of a segment."""
    below = next((line for line in lines[start + 1 :] if line.strip()), "")
    return bool(below) and not below.startswith("Channels")


def segment_end(lines: Sequence[str], ends: list[int], start: int) -> int:
    """The line before which the numbers of a segment end."""
    following = next((k for k in ends if k > start), len(lines))
    if following == len(lines):
        return following
    channels = [k for k in range(start, following) if lines[k].startswith("Channels")]
    return channels[0] if channels else following


def segment_keys(
    lines: Sequence[str], ends: list[int], start: int, mark: str
) -> dict[str, list[str]]:
    """The cells of the header of a segment, by the first one of each line."""
    before = max((k for k in ends if k < start), default=0)
    cells = [line.split(mark) for line in lines[before:start]]
    return {row[0]: [cell.strip() for cell in row] for row in cells if row[0]}


def with_units(grid: CellGrid, segment: dict[str, list[str]]) -> CellGrid:
    """The grid with the units of the segment in the names of the columns."""
    head, *data = grid.rows
    units = segment.get("Y_Unit_Label", [])
    kinds = segment.get("X_Dimension", [])
    names = []
    for k, name in enumerate(head.cells):
        unit = units[k] if 0 < k < len(units) else ""
        if name.strip() == X_NAME and "Time" in kinds:
            unit = "s"
        names.append(f"{name} [{unit}]" if unit and not read_head(name).written_unit else name)
    return replace(grid, rows=(replace(head, cells=tuple(names)), *data))


def with_times(grid: CellGrid, segment: dict[str, list[str]]) -> CellGrid:
    """The grid with times from the first one and the spacing, if there is no column of times."""
    head, *data = grid.rows
    there = any(row.cells[0].strip() for row in data)
    if there or not head.cells[0].startswith(X_NAME):
        return grid
    try:
        start, step = (Decimal(segment[key][1].replace(",", ".")) for key in ("X0", "Delta_X"))
    except (KeyError, IndexError, InvalidOperation):
        return grid
    decimal = grid.decimal or "."
    rows = tuple(
        replace(row, cells=(format(start + k * step, "f").replace(".", decimal), *row.cells[1:]))
        for k, row in enumerate(data)
    )
    words = f"times follow from the header: X0 = {start}, Delta_X = {step}"
    told = (*grid.corrections, Correction(ImportRule.FRAMES, words))
    return replace(grid, rows=(head, *rows), corrections=told)
