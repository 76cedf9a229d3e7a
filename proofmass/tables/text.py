"""Tables in text: the encoding of a file, and the cells of its lines."""

import codecs
import csv
import io
import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from proofmass.base.errors import InputError
from proofmass.tables.cells import STYLES, is_empty, is_plain, split_number
from proofmass.tables.decisions import Decisions
from proofmass.tables.foreign import Correction, ImportRule
from proofmass.tables.moments import is_moment
from proofmass.tables.unit_words import read_unit

SAMPLE_BYTES = 4096  # bytes at the beginning by which UTF-16 without a mark is known
ZERO_BYTES_SHARE = 0.4  # share of zero bytes at every other place of UTF-16 in a Western language
ENCODING_WORDS = {
    "cp932": ("時間", "時刻", "角度", "速度", "変位", "位置"),
    "cp1251": ("время", "угол", "скорость", "момент", "координата"),
    "gb18030": ("时间", "角度", "速度", "位移", "时刻"),
    "cp949": ("시간", "각도", "속도", "변위"),
}
"""Words of headers by which encodings of other scripts are told from Windows-1252."""
SAMPLE_LINES = 3000  # lines in which the separator is looked for
MARKS = ("\t", ";", "|", ",", "  ", " ")
"""Separators, in the order in which they are preferred: two blanks or more, or any blanks."""
MARK_WORDS = {"\t": "tabs", ";": "semicolons", "|": "bars", ",": "commas", "  ": "blanks"}
MARK_WORDS |= {" ": "blanks", "": "nothing"}
VALUE_SHARE = 0.6
"""Share of the cells of a column that must be values: footers and lines of words are fewer."""
COMMENT_MARKS = ("#", "%", "//", "!", "*", "'")
"""Signs at the beginning of lines of comments."""


@dataclass(frozen=True)
class CellRow:
    """A row of cells.

    Attributes
    ----------
    number : int
        Its line or row in the file.
    cells : tuple of str
    text : str
        The line as it stands in the file; empty for a row of a workbook.
    """

    number: int
    cells: tuple[str, ...]
    text: str = ""

    @property
    def is_blank(self) -> bool:
        """Whether all cells are empty."""
        return not any(cell.strip() for cell in self.cells)


@dataclass(frozen=True)
class CellGrid:
    """All rows of a file.

    Attributes
    ----------
    file : Path
    rows : tuple of CellRow
    place_word : str
        What the numbers of rows count.
    mark : str
        The separator of cells; empty if cells are separate in the container.
    decimal : str
        The decimal sign, if the file states it.
    open_end : bool
        Whether the last line has no end, as that of a text that was cut off.
    corrections : tuple of Correction
    """

    file: Path
    rows: tuple[CellRow, ...]
    place_word: str = "line"
    mark: str = ""
    decimal: str = ""
    open_end: bool = False
    corrections: tuple[Correction, ...] = ()


def decode(file: Path, data: bytes, decisions: Decisions) -> tuple[str, tuple[Correction, ...]]:
    """Decode the text of a file.

    Raises
    ------
    InputError
        The option names no encoding, or the file is not in it.
    """
    name = decisions.encoding or find_encoding(data)
    try:
        text = data.decode(name)
    except (LookupError, UnicodeError):
        raise InputError(
            file, "--encoding", f"the file is not in {name!r}; give a name such as utf-8 or cp1252"
        ) from None
    text = text.removeprefix("\ufeff")
    if name in ("utf-8-sig", "ascii", "utf-8"):
        return text, ()
    return text, (Correction(ImportRule.ENCODING, f"the text is in {name.upper()}"),)


def find_encoding(data: bytes) -> str:
    """Find the encoding of a text.

    >>> [find_encoding("t [s];φ [°]".encode(name)) for name in ("utf-8", "utf-16", "utf-16-le")]
    ['utf-8-sig', 'utf-16', 'utf-16-le']
    >>> find_encoding("φ,°".encode("utf-8")), find_encoding("x [°]".encode("latin-1"))
    ('utf-8-sig', 'cp1252')
    """
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return "utf-16"
    sample = data[:SAMPLE_BYTES]
    for name, offset in (("utf-16-le", 1), ("utf-16-be", 0)):
        if sample and sample[offset::2].count(0) > ZERO_BYTES_SHARE * len(sample) / 2:
            return name
    try:
        data.decode("utf-8-sig")
    except UnicodeDecodeError:
        pass
    else:
        return "utf-8-sig"
    for name, known in ENCODING_WORDS.items():
        text = data.decode(name, errors="ignore").lower()
        if any(word in text for word in known):
            return name
    try:
        data.decode("cp1252")
    except UnicodeDecodeError:
        return "latin-1"
    return "cp1252"


def is_value(cell: str) -> bool:
    """Whether a cell has a number, in any style and with a unit or without, or a time of a clock.

    >>> [is_value(cell) for cell in ("1.234,5", "0.005 sec", "10:00:00.5", "Theta2", "3 bodies")]
    [True, True, True, False, False]
    """
    if is_plain(cell):
        return True
    parts = split_number(cell)
    if parts is not None:
        number, rest = parts
        if any(style.plain(number) is not None for style in STYLES):
            return not rest or read_unit(rest) is not None or is_moment(cell)
    return is_moment(cell)


def lines_of(text: str) -> list[str]:
    """The lines of a text, as `csv` counts them, with their ends."""
    return io.StringIO(text, newline="").readlines()


def split_rows(text: str, mark: str) -> Iterator[CellRow]:
    """The rows of a text whose cells a mark separates."""
    if mark in (" ", "  ", ""):
        pattern = {" ": r"\s+", "  ": r"\s{2,}|\t", "": r"(?!)"}[mark]
        for number, line in enumerate(lines_of(text), 1):
            line = line.rstrip("\r\n")
            yield CellRow(number, tuple(re.split(pattern, line.strip())), line)
        return
    lines = lines_of(text)
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=mark, skipinitialspace=True)
    last = 0
    for cells in reader:
        number = last + 1
        yield CellRow(number, tuple(cells), "".join(lines[last : reader.line_num]).rstrip("\r\n"))
        last = reader.line_num


@dataclass(frozen=True)
class DataShape:
    """What the rows of numbers of a grid have in common.

    Attributes
    ----------
    width : int
        The number of cells of a full row.
    values : tuple of int
        The columns that have values, and no words.
    rows : int
        The number of full rows with values in all these columns, or with empty cells.
    share : float
        The share of the cells of these rows that are values [1].
    """

    width: int
    values: tuple[int, ...]
    rows: int
    share: float

    def has(self, row: CellRow) -> bool:
        """Whether a row is one of these: of full width, with a value, and no words in a place of
        values."""
        return len(trimmed(row, self.width)) >= self.width and self.fits(row)

    def fits(self, row: CellRow) -> bool:
        """Whether a row has a value and no words in a place of values.

        It may be too short, and may have words beyond its width, which are a comment.
        """
        cells = row.cells
        if len(cells) == self.width and all(is_plain(cells[k]) for k in self.values):
            return True
        cells = trimmed(row, self.width)
        if any(cell.strip() and is_value(cell) for cell in cells[self.width :]):
            return False
        there = [cells[k] for k in self.values if k < len(cells) and not is_empty(cells[k])]
        return bool(there) and all(map(is_value, there))


def row_words(row: CellRow) -> str:
    """The words of a row."""
    return row.text or " ".join(row.cells)


def trimmed(row: CellRow, width: int) -> tuple[str, ...]:
    """The cells of a row without empty ones beyond a width."""
    cells = row.cells
    while len(cells) > width and not cells[-1].strip():
        cells = cells[:-1]
    return cells


def find_shape(rows: list[CellRow]) -> DataShape | None:
    """Find the shape of the rows of numbers; None if there are none."""
    counts = Counter(len(row.cells) for row in rows if any(map(is_value, row.cells)))
    best: DataShape | None = None
    for width, count in counts.most_common(3):
        full = [row for row in rows if len(row.cells) == width and any(map(is_value, row.cells))]
        values = tuple(k for k in range(width) if is_value_column([row.cells[k] for row in full]))
        if not values:
            continue
        shape = DataShape(width, values, 0, 0.0)
        data = [row for row in full if shape.has(row)]
        if len(data) < 2:
            continue
        cells = [cell for row in data for cell in row.cells]
        share = sum(map(is_value, cells)) / max(sum(not is_empty(c) for c in cells), 1)
        shape = DataShape(width, values, len(data), share)
        if best is None or shape.rows * len(values) > best.rows * len(best.values):
            best = shape
        if count < len(rows) // 4:
            break
    return best


def is_value_column(cells: list[str]) -> bool:
    """Whether most cells of a column are values."""
    there = [cell for cell in cells if not is_empty(cell)]
    return bool(there) and sum(map(is_value, there)) >= VALUE_SHARE * len(there)


def read_grid(file: Path, text: str, decisions: Decisions, mark: str = "") -> CellGrid:
    """Read the cells of a text, whose separator is found unless it is given.

    Raises
    ------
    InputError
        The text has no rows of numbers.
    """
    lines = lines_of(text)
    sample = "".join(lines[:SAMPLE_LINES])
    best = mark or find_mark(sample)
    if best is None:
        raise InputError(file, "", no_table(text))
    try:
        rows = tuple(split_rows(text, best))
    except csv.Error as error:
        raise InputError(file, "", f"no table: {error}") from None
    open_quote = next((row for row in rows if has_open_quote(row, best)), None)
    if open_quote is not None:
        raise InputError(file, f"line {open_quote.number}", "a quotation mark is not closed")
    words = f"cells are separated by {MARK_WORDS[best]}"
    told = () if best == "," else (Correction(ImportRule.SEPARATOR, words),)
    return CellGrid(
        file, rows, "line", best, open_end=not text.endswith(("\n", "\r")), corrections=told
    )


def has_open_quote(row: CellRow, mark: str) -> bool:
    """Whether a row of numbers goes on in the next line, or ends the text, within quotation marks.

    A name may have a line break in it.
    """
    if not mark.strip() and mark != "\t":
        return False
    text = row.text
    return text.count('"') % 2 == 1 and any(map(is_value, row.cells))


def find_mark(text: str) -> str | None:
    """Find the separator of the cells of a text: that which gives the most values.

    Blanks are separators only if no sign divides the rows into values alone, since blanks may group
    digits; commas count as such a sign only below a header, since they may be decimal signs.  An
    empty separator is that of a single column; None without any numbers.

    >>> find_mark("t;x\\n0,1;1 000\\n0,2;2 000"), find_mark("t x\\n0,1 1\\n0,2 2")
    (';', ' ')
    """
    best: tuple[float, str | None] = (0.0, None)
    divided = False
    for mark in MARKS:
        if divided and not mark.strip() and mark != "\t":
            break
        try:
            rows = list(split_rows(text, mark))
        except csv.Error:
            continue
        shape = find_shape(rows)
        if shape is None or shape.width < 2:
            continue
        headed = has_header(rows, shape)
        divided |= shape.share == 1.0 and (mark != "," or headed)
        score = shape.rows * len(shape.values) * shape.share**2 * (1 + headed)
        if score > best[0]:
            best = score, mark
    if best[1] is None and find_shape(list(split_rows(text, ""))):
        return ""
    return best[1]


def has_header(rows: list[CellRow], shape: DataShape) -> bool:
    """Whether the row above the numbers has as many cells, and words in all of them."""
    first = next((k for k, row in enumerate(rows) if shape.has(row)), 0)
    above = next((row for row in reversed(rows[:first]) if not row.is_blank), None)
    if above is None:
        return False
    cells = trimmed(above, shape.width)
    return len(cells) == shape.width and not any(map(is_value, cells))


def no_table(text: str) -> str:
    """Why a text is no table."""
    first = next((line.strip() for line in text.splitlines() if line.strip()), "")
    if not first:
        return "the file is empty"
    return (
        "no table: no rows of two numbers or more stand below each other; its first line is "
        f"{first[:60]!r}"
    )
