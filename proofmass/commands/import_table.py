"""``proofmass import``: a clean CSV of any table, what was changed, and lines for a sidecar."""

import sys
import textwrap
from decimal import Decimal
from pathlib import Path

import typer

from proofmass.base.errors import InputError
from proofmass.base.files import protect, write_output
from proofmass.base.wording import format_count
from proofmass.commands.command import error_console, exit_on_error
from proofmass.tables.clean import csv_text, import_table
from proofmass.tables.decisions import Decisions, ImportQuestion
from proofmass.tables.foreign import ForeignTable
from proofmass.tables.sidecar_lines import TableRole, sidecar_lines

CLEAN = "_clean"  # what the name of a clean file has more than that of the CSV it comes from
MIN_WIDTH, ENDLESS = 40, 100_000  # least width of lines, and that where no terminal has one
MAX_SHOWN_COLUMNS = 12  # columns in the table of the terminal; of more the first ones and a count


def run_import(file: Path, output: Path | None, role: TableRole, decisions: Decisions) -> None:
    """Import a table: write the clean file, and print what was changed and lines for a sidecar."""
    if not decisions.yes and sys.stdin.isatty() and error_console.is_terminal:
        decisions.ask = ask_person
    with exit_on_error("nothing is written"):
        protect([file])
        table = import_table(file, decisions)
        target = output or clean_file(file)
        require_csv(target)
        write_output(target, csv_text(table))
    for line in account_lines(table, terminal_width()):
        error_console.print(line)
    error_console.print("lines for the sidecar:", style="bold")
    print(f"# {target}", *sidecar_lines(table, target.name, role), sep="\n")


def require_csv(file: Path) -> None:
    """Raise InputError unless a file can be named in a sidecar."""
    if file.suffix != ".csv":
        raise InputError(
            file,
            "--output",
            "give a name that ends in .csv, by which a sidecar knows a recorded curve",
        )


def clean_file(file: Path) -> Path:
    """The file that is written if no other is named, in the folder of the given one.

    >>> clean_file(Path("rig.lvm")).name, clean_file(Path("sam.csv")).name
    ('rig.csv', 'sam_clean.csv')
    """
    if file.suffix.lower() == ".csv":
        return file.with_name(f"{file.stem}{CLEAN}.csv")
    return file.with_suffix(".csv")


def ask_person(question: ImportQuestion) -> str:
    """Ask on the terminal, until an answer is possible."""
    where = f"{question.about}: " if question.about else ""
    for line in wrapped(f"{where}{question.text}", "? ", "  ", terminal_width()):
        error_console.print(line)
    default = question.answers[0] if question.answers else None
    option = question.option.partition(" ")[0]
    choices = f"{' / '.join(question.answers)}, " if question.answers else ""
    while True:
        answer = typer.prompt(f"  {choices}as {option} takes it", default=default, err=True)
        if not question.answers or answer in question.answers:
            return str(answer).strip()


def terminal_width() -> int:
    """The width that sentences are wrapped at; without a terminal they are not wrapped."""
    return max(error_console.width, MIN_WIDTH) if error_console.is_terminal else ENDLESS


def wrapped(text: str, first: str, rest: str, width: int) -> list[str]:
    """A sentence in lines of a width."""
    return textwrap.wrap(
        text, width, initial_indent=first, subsequent_indent=rest, break_on_hyphens=False
    )


def account_lines(table: ForeignTable, width: int) -> list[str]:
    """What was read and changed, in lines of a width.

    Parameters
    ----------
    table : ForeignTable
    width : int
        Largest number of letters of a line.

    Returns
    -------
    list of str
    """
    columns = format_count(len(table.columns), "column")
    lines = [f"{table.file.name}: {format_count(len(table.places), 'row')}, {columns}"]
    for correction in table.corrections:
        lines += wrapped(str(correction), "· ", "  ", width)
    return [*lines, *column_lines(table)]


def column_lines(table: ForeignTable) -> list[str]:
    """Lines with the name, the unit, and the first and last number of each column."""
    shown = table.columns[:MAX_SHOWN_COLUMNS]
    rows = [("column", "unit", "first", "last")]
    rows += [(c.name, c.unit or c.written_unit or "none", c.cells[0], c.cells[-1]) for c in shown]
    widths = [max(len(row[k]) for row in rows) for k in range(4)]
    widths[0] = min(widths[0], 30)
    lines = [
        "  "
        + "  ".join(
            [f"{row[0][:30]:<{widths[0]}}", f"{row[1]:<{widths[1]}}"]
            + [f"{row[k]:>{widths[k]}}" for k in (2, 3)]
        )
        for row in rows
    ]
    if len(table.columns) > len(shown):
        lines.append(f"  and {len(table.columns) - len(shown)} more")
    return lines


def parse_units(texts: list[str] | None) -> dict[str, str]:
    """The units of columns from options ``COLUMN=UNIT``.

    Raises
    ------
    ValueError
        An option has no ``=``.
    """
    found = {}
    for text in texts or ():
        name, mark, unit = text.rpartition("=")
        if not mark:
            raise ValueError(f"--unit {text}: give COLUMN=UNIT, such as theta=deg")
        found[name.strip()] = unit.strip()
    return found


def parse_rate(text: str | None) -> Decimal | None:
    """The rows per second of an option.

    Raises
    ------
    ValueError
        It is no number above 0.
    """
    if text is None:
        return None
    try:
        rate = Decimal(text)
    except ArithmeticError:
        rate = Decimal(0)
    if not rate.is_finite() or rate <= 0:
        raise ValueError(f"--fps {text}: give a number above 0, such as 240")
    return rate
