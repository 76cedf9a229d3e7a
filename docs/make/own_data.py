"""The output of an import and the table of shapes on the page "Your own data".

    python -m docs.make.own_data [--quick]

Every file of ``tests/tables/shapes.py`` is written to a temporary folder and imported.
"""

import tempfile
from collections.abc import Iterator, Sequence
from decimal import Decimal
from pathlib import Path

from benchmarks import command
from docs.make.marks import write_between
from proofmass.base.errors import InputError
from proofmass.commands.import_table import account_lines, parse_units
from proofmass.tables.clean import import_table
from proofmass.tables.decisions import Decisions
from proofmass.tables.sidecar_lines import TableRole, sidecar_lines
from tests.tables.shapes import SHAPES, TableShape

PAGE = Path(__file__).parent.parent / "own_data.md"
BEGIN = "<!-- python -m docs.make.own_data writes from here to the next mark: {} -->"
END = "<!-- to here: {} -->"
SHOWN = "sam.csv"  # the file whose import is shown
MISREAD = "misread"
WIDTH = 80  # letters of a line of the terminal that is shown


def decisions_of(shape: TableShape) -> Decisions:
    """The options of a shape, as the command takes them."""
    given = dict(zip(shape.options[::2], shape.options[1::2], strict=True))
    return Decisions(
        units=parse_units([given["--unit"]] if "--unit" in given else None),
        fps=Decimal(given["--fps"]) if "--fps" in given else None,
        time=given.get("--time", ""),
    )


def shown_output(folder: Path) -> str:
    """What the terminal shows of an import."""
    shape = next(one for one in SHAPES if one.name == SHOWN)
    shape.write(folder / shape.name)
    table = import_table(folder / shape.name, decisions_of(shape))
    lines = [f"$ proofmass import {SHOWN}", *account_lines(table, WIDTH), "lines for the sidecar:"]
    lines += ["# sam_clean.csv", *sidecar_lines(table, "sam_clean.csv", TableRole.TRUTH)]
    return "\n".join(["```", *lines, "```"])


def outcome(shape: TableShape, folder: Path) -> str:
    """How a file comes in: ``as it is``, ``with --fps 200``, or why it does not."""
    shape.write(folder / shape.name)
    try:
        table = import_table(folder / shape.name, decisions_of(shape))
    except InputError as error:
        return f"refused: {error.wrong}"
    there = {column.name: (column.unit, column.cells) for column in table.columns}
    for name, (unit, texts) in shape.columns.items():
        if name not in there or there[name][0] != unit or not same(there[name][1], texts):
            return MISREAD
    if set(there) - set(shape.columns):
        return MISREAD
    return f"with `{' '.join(shape.options)}`" if shape.options else "as it is"


def same(cells: tuple[str, ...], texts: list[str]) -> bool:
    """Whether numbers are those that are printed in a file, to all digits."""
    return [Decimal(c) if c else None for c in cells] == [Decimal(t) if t else None for t in texts]


def table_of_shapes(folder: Path) -> Iterator[str]:
    """The rows of the table of shapes, and how many come in."""
    outcomes = {shape.name: outcome(shape, folder) for shape in SHAPES}
    kinds = sorted({shape.shape for shape in SHAPES}, key=str.lower)
    yield "| shape | files | comes in | a sentence of the account |"
    yield "|---|---|---|---|"
    for kind in kinds:
        files = [shape for shape in SHAPES if shape.shape == kind]
        how = dict.fromkeys(outcomes[shape.name] for shape in files)
        says = next((shape for shape in files if shape.says), None)
        yield f"| {kind} | {len(files)} | {'; '.join(how)} | {sentence(says, folder)} |"
    good = [o for o in outcomes.values() if not o.startswith(("refused", MISREAD))]
    yield ""
    yield f"{len(good)} of {len(SHAPES)} files in {len(kinds)} shapes come in by one command."


def sentence(shape: TableShape | None, folder: Path) -> str:
    """The sentence that a shape is told by."""
    if shape is None:
        return ""
    table = import_table(folder / shape.name, decisions_of(shape))
    found = next(str(one) for one in table.corrections if shape.says[0] in str(one))
    return found.replace("|", "\\|").replace("<", "&lt;")


def new_page(text: str) -> str:
    """The page with its output and its table made anew."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        output, rows = shown_output(folder), "\n".join(table_of_shapes(folder))
    text = write_between(text, BEGIN.format("output"), END.format("output"), output)
    return write_between(text, BEGIN.format("shapes"), END.format("shapes"), rows)


def main(argv: Sequence[str] | None = None) -> None:
    """Make the page anew, and write it unless it shall be quick."""
    given = command(__doc__).parse_args(argv)
    text = new_page(PAGE.read_text(encoding="utf-8"))
    if not given.quick:
        PAGE.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
