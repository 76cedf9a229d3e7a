"""Files that hold a table: which format a file is in, by its first bytes, and who reads it.

Text is read here.  Workbooks, files of MATLAB and Parquet are read by the libraries of these
formats, in a worker process with limits of time and memory.
"""

from collections.abc import Callable
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from proofmass.base.errors import InputError
from proofmass.base.files import read_bytes
from proofmass.base.worker import Crashed, OutOfMemory, TimedOut, call_isolated
from proofmass.tables.adams import read_results
from proofmass.tables.decisions import Decisions
from proofmass.tables.foreign import ForeignTable
from proofmass.tables.layout import lay_out
from proofmass.tables.lvm import LVM_MARK, read_lvm
from proofmass.tables.matlab import choose_variables, newer_format, read_variables
from proofmass.tables.parquet import read_parquet
from proofmass.tables.text import decode, read_grid
from proofmass.tables.workbook import choose_sheet, read_sheets, require_small

MAX_TABLE_BYTES = 2**28
"""Bytes of a file: a quarter of a gigabyte is an hour at 1000 rows per second in eight columns."""
READ_SECONDS = 120.0
"""Processor time [s] that a library may take: a workbook of `MAX_TABLE_BYTES` takes less."""
READ_MEMORY = 4.0  # [GiB] that a library may use
HEAD_BYTES = (
    256  # bytes by which a format is known; the text at the top of a file of MATLAB has 116
)
TEXT_SAMPLE = 4096  # bytes in which a zero byte shows that a file is no text
PACKED_TABLE = "proofmass[import]"
"""The extra of this package with the libraries of workbooks and Parquet."""
REFUSED = (
    (b"\xd0\xcf\x11\xe0", "a workbook in Excel's old format, .xls; save it as .xlsx"),
    (b"%PDF", "a PDF; export the table as CSV from the program that made it"),
    (b"\x89PNG", "a picture; export the numbers as CSV"),
    (b"\xff\xd8\xff", "a picture; export the numbers as CSV"),
    (b"\x1f\x8b", "a file packed by gzip; unpack it first: gunzip {}"),
    (b"TDSm", "a TDMS of LabVIEW; export it as .lvm, .xlsx or CSV"),
    (b"MDF ", "an MDF; export the channels as CSV or Parquet"),
    (b"#ROSBAG", "a bag of ROS; write a topic as CSV: rostopic echo -b {} -p /TOPIC > curves.csv"),
    (b"\x89MCAP", "a bag of ROS 2; write a topic as CSV, such as with PlotJuggler"),
    (b"SQLite format 3", "a database, such as a bag of ROS 2; write a topic as CSV"),
    (
        b"\x93NUMPY",
        "an array of NumPy; write it with names: numpy.savetxt(.., header='t [s],x [m]')",
    ),
    (b"BZh", "a file packed by bzip2; unpack it first"),
    (b"7z\xbc\xaf", "an archive; unpack it first"),
    (b"Rar!", "an archive; unpack it first"),
    (b"glTF", "a drawing, and no table"),
)
"""First bytes of formats that are not read, and what helps."""


def read_container(file: Path, decisions: Decisions) -> ForeignTable:
    """Read the table of a file of any format.

    Raises
    ------
    InputError
        It is no table, or in a format that is not read; the message says what helps.
    """
    if not file.exists():
        raise InputError(file, "", "no such file")
    data = read_bytes(file)
    if len(data) > MAX_TABLE_BYTES:
        raise InputError(file, "", f"{len(data) / 2**20:.0f} MiB, more than the limit of 256 MiB")
    if not data.strip():
        raise InputError(file, "", "the file is empty")
    head = data[:HEAD_BYTES]
    for first, words in REFUSED:
        if head.startswith(first):
            raise InputError(file, "", words.format(file.name))
    if head.startswith(b"PK\x03\x04"):
        return read_packed(file, decisions)
    if head.startswith(b"PAR1"):
        require_library(file, "pyarrow")
        return replace(isolated(read_parquet, file), file=file)
    if head.startswith((b"MATLAB 7.3", b"\x89HDF")):
        raise InputError(file, "", newer_format())
    if head.startswith(b"MATLAB 5.0") or file.suffix.lower() == ".mat":
        return choose_variables(file, isolated(read_variables, file), decisions)
    return read_text_table(file, data, decisions)


def read_text_table(file: Path, data: bytes, decisions: Decisions) -> ForeignTable:
    """Read a table in text.

    Raises
    ------
    InputError
        The text has no table, or the file is no text.
    """
    text, told = decode(file, data, decisions)
    if "\0" in text[:TEXT_SAMPLE]:
        raise InputError(
            file,
            "",
            "no text and in no format that is read: CSV and other text, .xlsx, .mat, "
            ".res, .lvm, Parquet",
        )
    start = text.lstrip()[:HEAD_BYTES]
    if start.startswith(("<?xml", "<Results")):
        return read_results(file, data, decisions)
    if start.lower().startswith(("<!doctype", "<html", "<svg")):
        raise InputError(file, "", "a page for a browser; export the table as CSV")
    if start.startswith(("{", "[{", "[[")):
        raise InputError(file, "", "JSON; write the table as CSV, such as with pandas.DataFrame")
    if start.startswith(LVM_MARK):
        return lay_out(read_lvm(file, text, decisions, told), decisions)
    grid = read_grid(file, text, decisions)
    return lay_out(replace(grid, corrections=(*told, *grid.corrections)), decisions)


def read_packed(file: Path, decisions: Decisions) -> ForeignTable:
    """Read a workbook, which is a ZIP.

    Raises
    ------
    InputError
        It is a ZIP of something else, too large, or openpyxl is not installed.
    """
    parts = require_small(file)
    if "xl/workbook.xml" not in parts:
        kind = "a ZIP that is no workbook of Excel; unpack it first"
        if "content.xml" in parts:
            kind = "a workbook of LibreOffice, .ods; save it as .xlsx or CSV"
        raise InputError(file, "", kind)
    require_library(file, "openpyxl")
    return lay_out(choose_sheet(file, isolated(read_sheets, file), decisions), decisions)


def require_library(file: Path, name: str) -> None:
    """Raise InputError unless the library of a format is installed."""
    if find_spec(name) is None:
        raise InputError(
            file,
            "",
            f"{name} is needed to read it: pip install '{PACKED_TABLE}'; or save it as CSV",
        )


def isolated(function: Callable[[Path], Any], file: Path) -> Any:
    """Call a function that reads a file in a worker process.

    Raises
    ------
    InputError
        The file cannot be read, or not within the limits.
    """
    try:
        return call_isolated(function, file.absolute(), timeout=READ_SECONDS, memory=READ_MEMORY)
    except InputError as error:
        raise InputError(file, error.key, error.wrong) from None
    except (TimedOut, OutOfMemory) as error:
        raise InputError(file, "", f"too large to be read: {error}") from None
    except Crashed as error:
        raise InputError(file, "", f"damaged: {error}") from None
    except Exception as error:  # libraries raise errors of many kinds on damaged files
        text = (str(error).splitlines() or [type(error).__name__])[0]
        raise InputError(file, "", f"damaged, or no table: {text}") from None
