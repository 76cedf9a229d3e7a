"""A table of another program: columns of cells as they are written, and what was changed so far.

Every reader of a container makes a `ForeignTable`, and every rule of an import takes one and
returns another.  A rule that changes something adds a `Correction`, a sentence with its place, from
which the terminal, the sidecar's lines and the tests know of it.
"""

from collections.abc import Iterable, Sequence, Sized
from dataclasses import dataclass, field, replace
from enum import StrEnum
from pathlib import Path

from proofmass.base.errors import InputError, suggest_names
from proofmass.base.wording import format_list


class ImportRule(StrEnum):
    """The rules that may change a table."""

    ENCODING = "encoding"
    CONTAINER = "container"
    SEPARATOR = "separator"
    PREAMBLE = "preamble"
    HEADER = "header"
    UNITS = "units"
    INTERRUPTION = "interruption"
    FOOTER = "footer"
    DECIMALS = "decimals"
    GROUPS = "grouped digits"
    CELL_UNITS = "cells with units"
    NAMES = "names"
    LEFT_OUT = "columns left out"
    TIME = "time"
    EPOCH = "epoch"
    FRAMES = "frames"
    NO_TIME = "rows without a time"
    DOUBLED = "doubled rows"
    ORDER = "order of rows"
    EXTREMES = "extremes"
    EVENT = "event"
    EMPTY = "empty cells"
    WRAPPED = "wrapped angle"
    CLOCKWISE = "clockwise"
    ANSWER = "answer"


@dataclass(frozen=True)
class Correction:
    """What a rule changed, or found out, in one sentence.

    Attributes
    ----------
    rule : ImportRule
    words : str
    """

    rule: ImportRule
    words: str

    def __str__(self) -> str:
        return self.words


@dataclass(frozen=True)
class ForeignColumn:
    """A column of a table.

    Attributes
    ----------
    name : str
    cells : tuple of str
        Its cells as the file has them, later as plain numbers.
    unit : str
        Its unit as `proofmass.base.units` reads it; empty if it is not known.
    written_unit : str
        Its unit as the file writes it; empty if the file has none.
    clockwise : bool
        Whether its name or its unit says that it counts clockwise.
    """

    name: str
    cells: tuple[str, ...]
    unit: str = ""
    written_unit: str = ""
    clockwise: bool = False

    @property
    def label(self) -> str:
        """The name and the unit, as messages and headers have them."""
        unit = self.unit or self.written_unit
        return f"{self.name} [{unit}]" if unit else self.name


@dataclass(frozen=True)
class ForeignTable:
    """A table of another program.

    Attributes
    ----------
    file : Path
    columns : tuple of ForeignColumn
    places : tuple of int
        Number of the line or row of the file that each row of cells stands in.
    place_word : str
        What these numbers count, such as ``line``.
    decimal : str
        The decimal sign that the file states, or that its container always has; empty otherwise.
    rate : str
        Rows per second that the file states in a line above the table; empty if it states none.
    angle_unit : str
        Unit of angles that a line above the table states; empty if none does.
    clockwise_line : int
        Number of the line above the table that says that angles are clockwise; 0 if none does.
    corrections : tuple of Correction
    """

    file: Path
    columns: tuple[ForeignColumn, ...]
    places: tuple[int, ...]
    place_word: str = "line"
    decimal: str = ""
    rate: str = ""
    angle_unit: str = ""
    clockwise_line: int = 0
    corrections: tuple[Correction, ...] = field(default=())

    @property
    def names(self) -> list[str]:
        """The names of the columns."""
        return [column.name for column in self.columns]

    def line(self, row: int) -> str:
        """The place of a row in the file."""
        return f"{self.place_word} {self.places[row]}"

    def lines(self, rows: Sequence[int]) -> str:
        """The places of rows in the file, of many the first three.

        >>> table = ForeignTable(Path("a.csv"), (), (4, 5, 9))
        >>> table.lines([0]), table.lines([0, 2])
        ('line 4', 'lines 4 and 9')
        """
        numbers = format_list(str(self.places[row]) for row in rows)
        return f"{self.place_word}{'s' if len(rows) > 1 else ''} {numbers}"

    def corrected(self, rule: ImportRule, words: str, **changes: object) -> "ForeignTable":
        """The table with some fields changed, and with the sentence that says so."""
        added = (*self.corrections, Correction(rule, words))
        return replace(self, corrections=added, **changes)  # type: ignore[arg-type]

    def with_column(self, column: ForeignColumn) -> "ForeignTable":
        """The table with a column in place of that of its name."""
        return replace(
            self, columns=tuple(column if c.name == column.name else c for c in self.columns)
        )

    def without_columns(self, names: Iterable[str]) -> "ForeignTable":
        """The table without some columns."""
        left = set(names)
        return replace(self, columns=tuple(c for c in self.columns if c.name not in left))

    def with_rows(self, rows: Sequence[int]) -> "ForeignTable":
        """The table with some of its rows, in the given order."""
        return replace(
            self,
            columns=tuple(
                replace(c, cells=tuple(c.cells[row] for row in rows)) for c in self.columns
            ),
            places=tuple(self.places[row] for row in rows),
        )

    def find(self, name: str, flag: str) -> ForeignColumn:
        """The column of a name, with or without its unit in brackets, that an option names.

        Raises
        ------
        InputError
            No column has this name.
        """
        for column in self.columns:
            if name in (column.name, column.label):
                return column
        raise InputError(self.file, flag, f"no column {name!r}; {suggest_names(name, self.names)}")

    def error(self, place: str, wrong: str) -> InputError:
        """The error of bad input in the file."""
        return InputError(self.file, place, wrong)


def listed(names: list[str]) -> str:
    """Names of columns in a sentence.

    >>> listed(["x"]), listed(["x", "y"])
    ('column x', 'columns x and y')
    """
    return f"column{'s' if len(names) > 1 else ''} {format_list(names)}"


def be(several: Sized) -> str:
    """The verb for one thing or for several.

    >>> be(["x"]), be(["x", "y"])
    ('is', 'are')
    """
    return "is" if len(several) == 1 else "are"
