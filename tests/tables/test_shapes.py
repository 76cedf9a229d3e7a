"""Files in the shapes that programs write come in by one command, with the digits they print."""

from collections import Counter
from decimal import Decimal
from pathlib import Path

import pytest
from typer.testing import CliRunner

from docs.make.own_data import PAGE, new_page
from proofmass.base.recorded import read_table
from proofmass.commands.cli import app
from tests.tables.shapes import SHAPES, TableShape

MIN_FILES, MIN_SHAPES = 40, 25
CONVERTED_SHAPES = {
    "Excel, .xlsx": "a number of a workbook is no text",
    "MATLAB, vectors": "a number of MATLAB is no text",
    "MATLAB, structure with time": "a number of MATLAB is no text",
    "MATLAB, To File": "a number of MATLAB is no text",
    "Parquet": "a number of Parquet is no text",
    "MATLAB, timetable with dates": "times count from the first row on",
    "ROS, CSV": "times count from the first row on",
    "epoch": "times count from the first row on",
    "dates and times of a clock": "times count from the first row on",
    "frame numbers": "times follow from the rows",
    "LabVIEW, times in the header": "times follow from the first one and the spacing",
    "rows per second, and no times": "times follow from the rows",
    "accelerations in g": "they are multiplied",
    "clockwise sign": "signs are turned round",
}
"""Shapes whose numbers are not texts of the file, or are computed, and why."""


def import_file(file: Path, *options: object) -> tuple[int, str]:
    """Run the command; its exit code, and all that it prints."""
    answer = CliRunner().invoke(app, ["import", str(file), *map(str, options)])
    assert answer.exception is None or isinstance(answer.exception, SystemExit), answer.exception
    return answer.exit_code, answer.output


def decimals(texts: object) -> list[Decimal | None]:
    """Numbers of texts, without a rounding."""
    return [Decimal(text) if text else None for text in texts]  # type: ignore[attr-defined]


@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: shape.name)
def test_a_file_comes_in_with_the_digits_that_it_prints(shape: TableShape, tmp_path: Path) -> None:
    if shape.library:
        pytest.importorskip(shape.library)
    shape.write(tmp_path / shape.name)
    clean = tmp_path / "clean" / "curves.csv"
    clean.parent.mkdir()
    code, said = import_file(tmp_path / shape.name, "-o", clean, *shape.options)
    assert code == 0, said
    for words in shape.says:
        assert words in said
    table = read_table(clean)
    for name, (unit, texts) in shape.columns.items():
        k = list(table.units).index(name)
        assert table.units[name] == unit, name
        cells = [row[k] for _, row in table.rows]
        assert decimals(cells) == decimals(texts), name
        if shape.shape not in CONVERTED_SHAPES:
            assert cells == texts, name


def test_no_other_column_comes_in_than_those_that_are_stated(tmp_path: Path) -> None:
    """A column that nobody compares could be misread in silence."""
    for shape in (one for one in SHAPES if not one.library):
        shape.write(tmp_path / shape.name)
        clean = tmp_path / "clean.csv"
        import_file(tmp_path / shape.name, "-o", clean, *shape.options)
        others = [name for name in read_table(clean).units if name not in shape.columns]
        assert others == [], shape.name


def test_there_are_enough_files_in_enough_shapes() -> None:
    assert len(SHAPES) >= MIN_FILES
    assert len({shape.shape for shape in SHAPES}) >= MIN_SHAPES
    assert set(CONVERTED_SHAPES) < {shape.shape for shape in SHAPES}
    assert max(Counter(shape.name for shape in SHAPES).values()) == 1


def test_the_page_has_the_output_and_the_outcomes_of_today() -> None:
    pytest.importorskip("openpyxl")
    pytest.importorskip("pyarrow")
    text = PAGE.read_text(encoding="utf-8")
    assert new_page(text) == text, "python -m docs.make.own_data writes them"
    assert "misread" not in text.split("## Shapes")[1]
