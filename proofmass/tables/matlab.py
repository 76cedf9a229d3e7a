"""Files of MATLAB, ``.mat``, read by `scipy.io`: vectors, matrices and structures as columns."""

from pathlib import Path
from typing import Any

import numpy as np

from proofmass.base.arrays import Array
from proofmass.base.errors import InputError
from proofmass.tables.decisions import Decisions, ImportQuestion
from proofmass.tables.foreign import Correction, ForeignColumn, ForeignTable, ImportRule
from proofmass.tables.headers import is_time_name, read_head, unique

MAX_MATRIX_COLUMNS = 200
"""Columns of a matrix: one with more of them and fewer rows has a row for each quantity."""
OBJECT_ADVICE = (
    "an object of MATLAB ({}), which no other program reads; in MATLAB write it as a table: "
    "writetimetable({}, 'curves.csv'), or writetable"
)
"""What is said of timetables, timeseries and tables."""
Groups = dict[str, list[tuple[str, list[str]]]]
"""Columns, by the variable that they come from; those of vectors of one length are together."""


def read_variables(file: Path) -> Groups:
    """Read the columns of all variables of a file.

    Raises
    ------
    InputError
        The file cannot be read, or has objects of MATLAB only.
    """
    from scipy.io import loadmat

    try:
        found = loadmat(file, squeeze_me=True, struct_as_record=False)
    except NotImplementedError:
        raise InputError(file, "", newer_format()) from None
    except Exception as error:  # scipy raises errors of many kinds on damaged files
        raise InputError(file, "", f"no file of MATLAB that can be read: {error}") from None
    groups: Groups = {}
    arrays: list[tuple[str, list[tuple[str, list[str]]]]] = []
    objects = []
    for name, value in found.items():
        if name.startswith("__"):
            continue
        if type(value).__name__ in ("MatlabOpaque", "MatlabFunction") or is_opaque(value):
            objects.append(name)
        elif hasattr(value, "_fieldnames"):
            groups[name] = structure_columns(value)
        elif isinstance(value, np.ndarray) and value.ndim in (1, 2):
            arrays += [(name, columns)] if (columns := matrix_columns(name, value)) else []
    groups |= grouped_by_rows(arrays)
    groups = {name: columns for name, columns in groups.items() if columns}
    if not groups:
        if objects or "__function_workspace__" in found:
            name = objects[0] if objects and objects[0] != "None" else "tt"
            raise InputError(file, name, OBJECT_ADVICE.format("timetable or timeseries", name))
        raise InputError(file, "", "no vector or matrix of numbers in it")
    return groups


def grouped_by_rows(arrays: list[tuple[str, list[tuple[str, list[str]]]]]) -> Groups:
    """Columns of vectors and matrices, those of one number of rows together."""
    found: dict[int, list[str]] = {}
    for name, columns in arrays:
        found.setdefault(len(columns[0][1]), []).append(name)
    by_name = dict(arrays)
    return {", ".join(names): [c for n in names for c in by_name[n]] for names in found.values()}


def is_opaque(value: Any) -> bool:
    """Whether a value is a record of an object of MATLAB."""
    names = getattr(getattr(value, "dtype", None), "names", None) or ()
    return "s2" in names and "arr" in names


def newer_format() -> str:
    """What is said of a file in the format 7.3, which is HDF5."""
    return "the format 7.3 of MATLAB is not read; in MATLAB write save('curves.mat', '-v7')"


def numbers_text(values: Array) -> list[str]:
    """Numbers as texts with all their digits; NaN as it is."""
    if values.dtype.kind == "f":
        return [
            np.format_float_positional(v, trim="0") if 1e-5 < abs(v) < 1e16 else str(v)
            for v in values
        ]
    return [str(v) for v in values]


def matrix_columns(name: str, value: np.ndarray) -> list[tuple[str, list[str]]]:
    """The columns of a vector or a matrix; a matrix with few rows has a row for each quantity."""
    if value.dtype.kind not in "fiu" or value.size < 2:
        return []
    if value.ndim == 1:
        return [(name, numbers_text(value))]
    rows = (
        value.T
        if value.shape[0] < value.shape[1] and value.shape[0] <= MAX_MATRIX_COLUMNS
        else value
    )
    return [(f"{name}({k + 1})", numbers_text(rows[:, k])) for k in range(rows.shape[1])]


def structure_columns(value: Any) -> list[tuple[str, list[str]]]:
    """The columns of a structure: its vectors, or the signals of a structure with time."""
    found: list[tuple[str, list[str]]] = []
    for name in value._fieldnames:
        part = getattr(value, name)
        signals: Any = np.atleast_1d(part) if name == "signals" else []
        for k, signal in enumerate(signals):
            label = str(getattr(signal, "label", "") or f"signal {k + 1}")
            found += matrix_columns(label, np.asarray(getattr(signal, "values", np.zeros(0))))
        if isinstance(part, np.ndarray) and name != "signals":
            found += matrix_columns(name, part)
    lengths = [len(cells) for _, cells in found]
    longest = max(set(lengths), key=lengths.count, default=0)
    return [one for one in found if len(one[1]) == longest]


def choose_variables(file: Path, groups: Groups, decisions: Decisions) -> ForeignTable:
    """The table of the variables that belong together.

    Raises
    ------
    InputError
        Several do, and none is asked for.
    """
    if decisions.sheet and decisions.sheet not in groups:
        raise InputError(file, "--sheet", f"no {decisions.sheet!r}; {', '.join(groups)}")
    timed = [g for g, columns in groups.items() if any(is_time_name(n) for n, _ in columns)]
    names = timed or list(groups)
    name = decisions.sheet or names[0]
    if len(names) > 1 and not decisions.sheet:
        question = ImportQuestion(
            "", f"{len(names)} tables in the file", "--sheet {}", tuple(names), "{} is read"
        )
        name = decisions.decide(file, question)
        if name not in groups:
            raise InputError(file, "--sheet", f"no {name!r}; {', '.join(groups)}")
    heads = [read_head(one) for one, _ in groups[name]]
    columns = tuple(
        ForeignColumn(own, tuple(cells), head.unit, head.written_unit, head.clockwise)
        for own, head, (_, cells) in zip(
            unique([head.name for head in heads]), heads, groups[name], strict=True
        )
    )
    others = [other for other in groups if other != name]
    words = f"a file of MATLAB: {name}"
    words += f"; left out: {', '.join(others)}" if others else ""
    rows = tuple(range(1, len(columns[0].cells) + 1))
    told = (Correction(ImportRule.CONTAINER, words),)
    return ForeignTable(file, columns, rows, "row", ".", corrections=told)
