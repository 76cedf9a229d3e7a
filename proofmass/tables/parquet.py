"""Files of Parquet, read by pyarrow: columns with their units, from names or from metadata."""

from pathlib import Path
from typing import Any

from proofmass.base.errors import InputError
from proofmass.tables.foreign import Correction, ForeignColumn, ForeignTable, ImportRule
from proofmass.tables.headers import read_head, unique
from proofmass.tables.matlab import numbers_text
from proofmass.tables.unit_words import read_unit
from proofmass.tables.workbook import MAX_CELLS

UNIT_KEYS = (b"unit", b"units", b"Unit", b"Units")
"""Keys of the metadata of a column that have its unit."""


def read_parquet(file: Path) -> ForeignTable:
    """Read all columns of a file of Parquet as text.

    Raises
    ------
    InputError
        The file is damaged or has too many cells.
    """
    import pyarrow as arrow
    from pyarrow import parquet

    try:
        opened = parquet.ParquetFile(file)
        count = opened.metadata.num_rows * opened.metadata.num_columns
        if count > MAX_CELLS:
            raise InputError(file, "", f"{count:,} cells, more than the limit of {MAX_CELLS:,}")
        table = opened.read()
    except (arrow.ArrowException, OSError) as error:
        raise InputError(
            file, "", f"no Parquet that can be read: {str(error).splitlines()[0]}"
        ) from None
    columns, heads = [], []
    for field, values in zip(table.schema, table.columns, strict=True):
        cells, unit = column_cells(values)
        metadata = field.metadata or {}
        written = next((metadata[key].decode() for key in UNIT_KEYS if key in metadata), unit)
        head = read_head(field.name)
        heads.append(head.name)
        columns.append(
            ForeignColumn(
                head.name,
                cells,
                head.unit or read_unit(written) or "",
                head.written_unit or written,
                head.clockwise,
            )
        )
    named = tuple(
        ForeignColumn(name, c.cells, c.unit, c.written_unit, c.clockwise)
        for name, c in zip(unique(heads), columns, strict=True)
    )
    told = (Correction(ImportRule.CONTAINER, "a file of Parquet"),)
    rows = tuple(range(1, table.num_rows + 1))
    return ForeignTable(file, named, rows, "row", ".", corrections=told)


def column_cells(values: Any) -> tuple[tuple[str, ...], str]:
    """The cells of a column as text, and the unit that its type states."""
    import pyarrow as arrow

    kind = values.type
    if arrow.types.is_timestamp(kind) or arrow.types.is_duration(kind):
        numbers = values.cast(arrow.int64()).to_pylist()
        return tuple("" if v is None else str(v) for v in numbers), kind.unit
    if arrow.types.is_floating(kind):
        import numpy as np

        array = values.to_numpy()
        return tuple(
            "" if np.isnan(v) else t for v, t in zip(array, numbers_text(array), strict=True)
        ), ""
    return tuple("" if v is None else str(v) for v in values.to_pylist()), ""
