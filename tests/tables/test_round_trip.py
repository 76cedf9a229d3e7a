"""Random tables in random styles come in with their numbers, or are refused or asked: never wrong.

The written text is made here, from whole numbers and powers of ten; nothing of the package writes
it.
"""

from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from proofmass.base.errors import InputError
from proofmass.base.recorded import read_table
from proofmass.tables.clean import csv_text, import_table
from proofmass.tables.decisions import Decisions

NAMES = ("t", "x", "load", "P[2]", "v_{y}", "Slider 1")
UNITS = ("s", "mm", "N", "J", "mm/s", "m")
EXAMPLES = 200
"""Tables that are tried: enough for each pair of a separator, a decimal sign and a group."""


@dataclass(frozen=True)
class WrittenTable:
    """A table, and how it is written."""

    columns: tuple[tuple[Decimal, ...], ...]
    mark: str
    decimal: str
    group: str
    head: str
    preamble: tuple[str, ...]
    newline: str
    encoding: str
    final: bool

    def text(self) -> str:
        """The file's text."""
        names = list(NAMES[: len(self.columns)])
        units = list(UNITS[: len(self.columns)])
        if self.mark == " ":
            names = [name.replace(" ", "_") for name in names]
        heads = {
            "none": [],
            "brackets": [[f"{n} [{u}]" for n, u in zip(names, units, strict=True)]],
            "parentheses": [[f"{n} ({u})" for n, u in zip(names, units, strict=True)]],
            "row": [names, units],
            "bracketed row": [names, [f"[{u}]" for u in units]],
        }[self.head]
        rows = [list(map(self.cell, row)) for row in zip(*self.columns, strict=True)]
        lines = [*self.preamble, *(self.mark.join(map(self.quoted, r)) for r in (*heads, *rows))]
        return self.newline.join(lines) + self.newline * self.final

    def cell(self, value: Decimal) -> str:
        """A number as it is written."""
        text = format(value, ",f" if self.group else "f")
        return text.replace(".", "d").replace(",", self.group).replace("d", self.decimal)

    def quoted(self, cell: str) -> str:
        """A cell in quotation marks if it has the separator in it."""
        return f'"{cell}"' if self.mark in cell else cell


def scaled(numbers: list[int], digits: int) -> tuple[Decimal, ...]:
    """Whole numbers over a power of ten."""
    return tuple(Decimal(number).scaleb(-digits) for number in numbers)


@st.composite
def written_tables(draw: st.DrawFn) -> WrittenTable:
    """Tables in all the styles."""
    rows = draw(st.integers(3, 12))
    start, step = draw(st.integers(0, 5000)), draw(st.integers(1, 2000))
    columns = [scaled([start + k * step for k in range(rows)], draw(st.integers(0, 5)))]
    for _ in range(draw(st.integers(1, 5))):
        low = draw(st.sampled_from([-9_999_999, -999, 0]))
        numbers = draw(st.lists(st.integers(low, 9_999_999), min_size=rows, max_size=rows))
        columns.append(scaled(numbers, draw(st.integers(0, 6))))
    mark, decimal = draw(st.sampled_from([",", ";", "\t", "|", " "])), draw(st.sampled_from(".,"))
    group = draw(st.sampled_from(["", "", ",", ".", " ", "'", "\N{NARROW NO-BREAK SPACE}"]))
    return WrittenTable(
        tuple(columns),
        mark,
        decimal,
        "" if group == decimal or (mark == " " and not group.strip()) else group,
        draw(st.sampled_from(["brackets", "parentheses", "row", "bracketed row", "none"])),
        tuple(
            draw(st.lists(st.sampled_from(["Run 3", "Date: 2026-03-02", "", "12", "a;b,c"])))[:3]
        ),
        draw(st.sampled_from(["\n", "\r\n"])),
        draw(st.sampled_from(["utf-8", "utf-8-sig", "utf-16", "utf-16-le"])),
        draw(st.booleans()),
    )


@settings(
    max_examples=EXAMPLES,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
@given(written_tables())
def test_numbers_come_in_or_are_asked_for(tmp_path: Path, written: WrittenTable) -> None:
    file, clean = tmp_path / "table.txt", tmp_path / "clean.csv"
    file.write_bytes(written.text().encode(written.encoding))
    try:
        table = import_table(file, Decisions())
    except InputError:
        return
    clean.write_text(csv_text(table), encoding="utf-8")
    found = read_table(clean)
    columns = [tuple(Decimal(row[k]) for _, row in found.rows) for k in range(len(found.units))]
    kept = [k for k in range(len(written.columns[0])) if k not in doubled(written)]
    right = [tuple(column[k] for k in kept) for column in written.columns]
    if not written.final and columns[0] == right[0][:-1]:
        right = [
            column[:-1] for column in right
        ]  # the last line may have been cut off, and is told
        assert any("cut off" in str(one) for one in table.corrections)
    assert columns == right
    if written.head != "none":
        assert list(found.units.values()) == list(UNITS[: len(columns)])


def doubled(written: WrittenTable) -> set[int]:
    """Rows that repeat the one before, which are left out."""
    rows = list(zip(*written.columns, strict=True))
    return {k for k in range(1, len(rows)) if rows[k] == rows[k - 1]}
