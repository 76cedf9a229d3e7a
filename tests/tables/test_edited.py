"""One edit of a file, of one cell or line: no number comes in at another place than it had.

A cell that is missing moves those behind it, a header that lacks one moves all names.  Such files
are refused, or the line is left out.
"""

from decimal import Decimal
from pathlib import Path

import pytest

from proofmass.base.errors import InputError
from proofmass.tables.clean import import_table
from proofmass.tables.decisions import Decisions
from tests.tables.shapes import SHAPES, TableShape

MARKS = {
    "adams.tab": "\t",
    "solidworks.csv": ",",
    "sam.csv": ";",
    "inventor.txt": "\t",
    "tracker.txt": "\t",
    "timetable.csv": ",",
    "grouped_german.csv": ";",
    "savetxt.txt": " ",
    "phyphox.csv": ",",
    "capture.csv": ",",
    "inspector.csv": ",",
    "rig.lvm": "\t",
    "joined.csv": ",",
    "event.csv": ",",
}
"""Files of shapes and their separators."""
KEPT = 12  # lines of numbers that are kept


def cells_without(cells: list[str], k: int) -> list[str]:
    """Cells without one of them."""
    return cells[:k] + cells[k + 1 :]


EDITS = {
    "a cell missing": lambda cells, k: cells_without(cells, k),
    "a separator more": lambda cells, k: [*cells[:k], "", *cells[k:]],
    "a number more": lambda cells, k: [*cells[:k], "7.5", *cells[k:]],
    "a cell blank": lambda cells, k: [*cells[:k], "", *cells[k + 1 :]],
    "a word in a cell": lambda cells, k: [*cells[:k], "much", *cells[k + 1 :]],
    "no value": lambda cells, k: [*cells[:k], "NaN", *cells[k + 1 :]],
}
"""Edits of the cells of a line."""


def text_of(shape: TableShape, folder: Path) -> tuple[list[str], int, str]:
    """The lines of a file, the number of the first one of numbers, and its encoding."""
    shape.write(folder / shape.name)
    data = (folder / shape.name).read_bytes()
    encoding = "utf-8"
    try:
        text = data.decode(encoding)
    except UnicodeDecodeError:
        encoding, text = "cp1252", data.decode("cp1252")
    lines = text.splitlines()
    rows = len(next(iter(shape.columns.values()))[1])
    first = len(lines) - rows - (shape.name == "event.csv")
    return lines[: first + KEPT], first, encoding


def require_right(shape: TableShape, file: Path, edit: str) -> None:
    """Assert that each number that comes in is the one that is printed for its time."""
    try:
        table = import_table(file, Decisions())
    except InputError:
        return
    time = next(iter(shape.columns))
    places = {Decimal(text): k for k, text in enumerate(shape.columns[time][1])}
    x = table.columns[0]
    for column in table.columns[1:]:
        if column.name not in shape.columns:
            continue
        unit, texts = shape.columns[column.name]
        assert column.unit in (unit, ""), (edit, column.name)
        for at, cell in zip(x.cells, column.cells, strict=True):
            if cell:
                assert Decimal(cell) == Decimal(texts[places[Decimal(at)]] or "NaN"), (edit, at)


@pytest.mark.parametrize("name", MARKS)
def test_an_edited_line_moves_no_number(name: str, tmp_path: Path) -> None:
    shape = next(one for one in SHAPES if one.name == name)
    lines, first, encoding = text_of(shape, tmp_path)
    for number in sorted({first - 2, first - 1, first, first + 1, first + 5, len(lines) - 1}):
        cells = lines[number].split(MARKS[name]) if number >= 0 else []
        for edit, change in EDITS.items():
            for k in range(len(cells)):
                if not cells[k] and edit == "a number more":
                    continue  # a number in the place of an empty cell is no error of a file
                changed = list(lines)
                changed[number] = MARKS[name].join(change(cells, k))
                file = tmp_path / f"edited_{name}"
                file.write_bytes(("\n".join(changed) + "\n").encode(encoding))
                require_right(shape, file, f"{edit}, line {number + 1}, cell {k + 1}")


@pytest.mark.parametrize("name", MARKS)
def test_an_added_line_moves_no_number(name: str, tmp_path: Path) -> None:
    shape = next(one for one in SHAPES if one.name == name)
    lines, first, encoding = text_of(shape, tmp_path)
    added = ("# a comment", "note: restarted", "12", "END", "---", "", lines[first - 1], lines[-1])
    for number in (0, first - 1, first, first + 4, len(lines)):
        for line in added:
            changed = [*lines[:number], line, *lines[number:]]
            file = tmp_path / f"edited_{name}"
            file.write_bytes(("\n".join(changed) + "\n").encode(encoding))
            require_right(shape, file, f"{line!r} at line {number + 1}")


@pytest.mark.parametrize("name", MARKS)
def test_a_file_that_is_cut_off_says_so(name: str, tmp_path: Path) -> None:
    shape = next(one for one in SHAPES if one.name == name)
    lines, _, encoding = text_of(shape, tmp_path)
    whole = "\n".join(lines)
    for letters in range(1, len(lines[-1])):
        file = tmp_path / f"edited_{name}"
        file.write_bytes(whole[:-letters].encode(encoding))
        try:
            table = import_table(file, Decisions())
        except InputError:
            continue
        told = any("cut off" in str(one) for one in table.corrections)
        if not told:
            require_right(shape, file, f"{letters} letters less")
