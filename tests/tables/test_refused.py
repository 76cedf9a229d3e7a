"""Files that are no table, or contradict themselves, end in one line that says what helps."""

import zipfile
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from proofmass.base.errors import InputError
from proofmass.commands.cli import app
from proofmass.tables import containers, parquet, workbook
from proofmass.tables.clean import csv_text, import_table
from proofmass.tables.decisions import Decisions
from tests.tables.shapes import SHAPES
from tests.tables.test_questions import SQUARES, TIMES, rows

HEAD = "t [s],theta [deg]\n"
BAD = {
    "a letter": (b"Dear reader,\nit has 3 lines, and no table.\n", ["no table", "Dear reader"]),
    "nothing": (b"\n \n", ["the file is empty"]),
    "one row": ((HEAD + "0,1\n").encode(), ["no table"]),
    "JSON": (b'{"t": [0, 1], "x": [2, 3]}', ["JSON", "CSV"]),
    "a page": (b"<html><table><tr><td>1</td></tr></table></html>", ["browser"]),
    "other XML": (b"<?xml version='1.0'?><robot name='a'/>", ["<robot>", "<Results>"]),
    "a DOCTYPE": (b"<?xml version='1.0'?><!DOCTYPE a [<!ENTITY b 'c'>]><Results/>", ["DOCTYPE"]),
    "cut XML": (b"<?xml version='1.0'?><Results><Analysis>", ["line 1", "no XML"]),
    "old Excel": (b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + bytes(99), [".xls", "save it as .xlsx"]),
    "a PDF": (b"%PDF-1.7\n", ["PDF", "export"]),
    "gzip": (b"\x1f\x8b\x08" + bytes(30), ["gunzip"]),
    "format 7.3": (
        b"MATLAB 7.3 MAT-file, Platform: GLNXA64" + bytes(90),
        ["save('curves.mat', '-v7')"],
    ),
    "noise": (bytes(range(256)) * 20, ["no text"]),
    "units in two ways": (
        ("t [s],theta [deg]\ns,rad\n" + rows(TIMES, SQUARES)).encode(),
        ["line 2", "theta is 'rad' here, and 'deg' in its name", "--unit theta=deg"],
    ),
    "a rate in another unit": (
        (
            "t [s],theta [rad],omega [rad/s]\n"
            + rows(
                TIMES,
                [f"{float(t) * 720:.3f}" for t in TIMES],
                [f"{v * 3.141592653589793 / 180:.5f}" for v in [720.0] * 40],
            )
        ).encode(),
        ["omega [rad/s] is 0.01745 times the slope of theta [rad]", "--unit theta=deg"],
    ),
    "a wide row": (
        (HEAD + "0,1\n1,2\n2,3,9\n3,4\n").encode(),
        ["line 4", "3 cells, the rows around it have 2"],
    ),
    "a short row": (
        ("t [s],a [mm],b [mm]\n" + "0,1,2\n1,2,3\n2,3\n3,4,5\n").encode(),
        ["line 4", "2 cells, the rows around it have 3"],
    ),
    "a word": (
        (HEAD + "0,1\n1,2\n2,much\n3,4\n").encode(),
        ["line 4", "'much' in cell 2 is no number"],
    ),
    "a word in the first row": (
        (HEAD + "0,much\n1,2\n2,3\n3,4\n").encode(),
        ["line 2", "'much' in cell 2 is no number"],
    ),
    "a word in the last row": (
        (HEAD + "0,1\n1,2\n2,3\n3,much\n").encode(),
        ["line 5", "'much' in cell 2 is no number"],
    ),
    "an open quotation mark": (
        b't [s],x [mm]\n0.0,"1,000.5"\n0.1,"1,000.7"\n0.2,"1\n',
        ["line 4", "a quotation mark is not closed"],
    ),
    "hours or minutes": (
        ("time,x [mm]\n" + rows([f"00:{k:02}" for k in range(40)], SQUARES)).encode(),
        ["'00:00' may be hours and minutes, or minutes and seconds", "--fps"],
    ),
    "dates in two orders": (
        ("time,x [mm]\n" + "".join(f"0{k}/05/2024 10:00:00,{k}\n" for k in range(1, 9))).encode(),
        ["may begin with the day or with the month"],
    ),
    "a fast angle": (
        ("t [s],phi [deg]\n" + rows(TIMES, [f"{k * 250 % 360}.0" for k in range(40)])).encode(),
        ["column phi is left out", "110 deg or the rest of a turn"],
    ),
    "both decimal signs": (
        (HEAD.replace(",", ";") + "0,0;1,5\n0,1;1.6\n0,2;1,7\n").encode(),
        ["several ways", "line 2", "line 3"],
    ),
    "time turns back": (
        (HEAD + rows(TIMES, SQUARES) + rows(TIMES, SQUARES)).encode(),
        ["line 42", "t turns back, from 0.195 to 0.000"],
    ),
    "coarse times": (
        (HEAD + rows([t[:4] for t in TIMES], SQUARES)).encode(),
        ["t is 0.00 in this row and in the one before", "--fps"],
    ),
    "no time": (
        ("a [mm],b [mm]\n" + rows(SQUARES, SQUARES[::-1])).encode(),
        ["no column is a time", "--time COLUMN", "--fps 100", "a, b"],
    ),
    "time alone": (("t [s]\n" + rows(TIMES)).encode(), ["no other column has numbers"]),
    "too large a number": ((HEAD + "0,1\n1,1e999\n2,3\n").encode(), ["line 3", "1e999"]),
    "units of cells": (
        b"t,x\n0 s,1 mm\n1 s,2 kg\n2 s,3 mm\n",
        ["x: its cells and header are in kg and in mm"],
    ),
    "words between blanks": (
        ("Time (s) Angle of the crank\n" + rows(TIMES, SQUARES, mark=" ")).encode(),
        ["line 1", "6 words for 2 columns"],
    ),
}
"""Contents of files, and words of the message."""


def message_of(file: Path, *options: str) -> str:
    """The message of a command that must end with exit code 2 and write nothing."""
    before = set(file.parent.iterdir())
    answer = CliRunner().invoke(app, ["import", str(file), *options])
    assert answer.exit_code == 2, answer.output
    assert isinstance(answer.exception, SystemExit)
    assert set(file.parent.iterdir()) == before
    assert answer.output.count("\n") == 1
    return answer.output


@pytest.mark.parametrize("name", BAD)
def test_a_file_is_refused_with_what_helps(name: str, tmp_path: Path) -> None:
    data, words = BAD[name]
    (tmp_path / "a.dat").write_bytes(data)
    said = message_of(tmp_path / "a.dat")
    assert all(word in said for word in words), said


def test_a_missing_file_and_a_folder_are_refused(tmp_path: Path) -> None:
    assert "no such file" in message_of(tmp_path / "none.csv")
    (tmp_path / "folder").mkdir()
    assert "a folder" in message_of(tmp_path / "folder")


def test_options_are_checked(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text(HEAD + rows(TIMES, SQUARES), encoding="utf-8")
    assert "--unit theta" in message_of(tmp_path / "a.txt", "--unit", "theta")
    assert "--fps fast" in message_of(tmp_path / "a.txt", "--fps", "fast")
    assert "--fps -1" in message_of(tmp_path / "a.txt", "--fps", "-1")
    assert "ends in .csv" in message_of(tmp_path / "a.txt", "-o", str(tmp_path / "b.txt"))


def test_a_contradiction_is_settled_by_an_option(tmp_path: Path) -> None:
    data, _ = BAD["a rate in another unit"]
    (tmp_path / "a.txt").write_bytes(data)
    for unit in ("theta=deg", "omega=rad/s", "theta=rad"):
        name, _, own = unit.partition("=")
        table = import_table(tmp_path / "a.txt", Decisions(units={name: own}))
        assert next(c for c in table.columns if c.name == name).unit == own


def test_files_of_others_and_inputs_are_not_replaced(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text(HEAD + rows(TIMES, SQUARES), encoding="utf-8")
    (tmp_path / "a.csv").write_text("mine", encoding="utf-8")
    assert "proofmass did not write it" in message_of(tmp_path / "a.txt")
    assert (tmp_path / "a.csv").read_text(encoding="utf-8") == "mine"
    (tmp_path / "b.csv").write_text(HEAD + rows(TIMES, SQUARES), encoding="utf-8")
    assert "an input" in message_of(tmp_path / "b.csv", "-o", str(tmp_path / "b.csv"), "--force")
    for _ in range(2):  # the second time it is our own file that is replaced
        answer = CliRunner().invoke(app, ["import", str(tmp_path / "b.csv")])
        assert answer.exit_code == 0
    assert (tmp_path / "b_clean.csv").exists()
    assert CliRunner().invoke(app, ["import", str(tmp_path / "a.txt"), "--force"]).exit_code == 0
    assert (tmp_path / "a.csv").read_text(encoding="utf-8").startswith("t [s],theta [deg]\n")


def test_a_library_that_is_missing_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(containers, "find_spec", lambda _: None)
    (tmp_path / "a.parquet").write_bytes(b"PAR1" + bytes(30))
    with pytest.raises(InputError, match=r"pyarrow is needed.*pip install 'proofmass\[import\]'"):
        import_table(tmp_path / "a.parquet", Decisions())
    with zipfile.ZipFile(tmp_path / "a.xlsx", "w") as packed:
        packed.writestr("xl/workbook.xml", "<workbook/>")
    with pytest.raises(InputError, match=r"openpyxl is needed.*pip install 'proofmass\[import\]'"):
        import_table(tmp_path / "a.xlsx", Decisions())


def test_packed_files_are_bounded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with zipfile.ZipFile(tmp_path / "bomb.xlsx", "w", zipfile.ZIP_DEFLATED) as packed:
        packed.writestr("xl/workbook.xml", "<workbook/>")
        packed.writestr("xl/worksheets/sheet1.xml", bytes(2**21))
    assert (tmp_path / "bomb.xlsx").stat().st_size < 2**13
    monkeypatch.setattr(workbook, "MAX_UNPACKED", 2**20)
    with pytest.raises(InputError, match="unpacked, more than the limit"):
        import_table(tmp_path / "bomb.xlsx", Decisions())
    with zipfile.ZipFile(tmp_path / "a.ods", "w") as packed:
        packed.writestr("content.xml", "<x/>")
    with pytest.raises(InputError, match="LibreOffice"):
        import_table(tmp_path / "a.ods", Decisions())
    arrow = pytest.importorskip("pyarrow")
    from pyarrow import parquet as written

    written.write_table(arrow.table({"t": [0.0] * 100_000}), tmp_path / "bomb.parquet")
    assert (tmp_path / "bomb.parquet").stat().st_size < 2**13
    monkeypatch.setattr(parquet, "MAX_CELLS", 50_000)
    with pytest.raises(InputError, match="100,000 cells, more than the limit of 50,000"):
        parquet.read_parquet(tmp_path / "bomb.parquet")


def test_objects_of_matlab_are_refused_by_name(tmp_path: Path) -> None:
    from scipy.io import savemat

    savemat(tmp_path / "a.mat", {"word": "no numbers"})
    with pytest.raises(InputError, match="no vector or matrix of numbers"):
        import_table(tmp_path / "a.mat", Decisions())


TEXTS = [shape for shape in SHAPES if not shape.library and not shape.name.endswith(".mat")]
KEPT_BYTES = 1500
"""Bytes of a file that are kept, so that a change is near the header more often."""


@st.composite
def damaged_files(draw: st.DrawFn) -> tuple[str, bytes]:
    """A file of a shape with bytes changed, removed and added."""
    index = draw(st.integers(0, len(TEXTS) - 1))
    shape = TEXTS[index]
    data = bytearray(contents(index))
    for _ in range(draw(st.integers(1, 6))):
        place = draw(st.integers(0, len(data)))
        end = place + draw(st.integers(0, 20))
        added = draw(
            st.one_of(
                st.binary(max_size=4),
                st.sampled_from(
                    [b",", b"\n", b'"', b"\t", b"nan", b"1e400", b"(deg)", b"12:00:00"]
                ),
            )
        )
        data[place:end] = added
    return shape.name, bytes(data)


def contents(index: int) -> bytes:
    """The beginning of the file of a shape."""
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / TEXTS[index].name
        TEXTS[index].write(file)
        return file.read_bytes()[:KEPT_BYTES]


def require_one_line(error: InputError) -> None:
    """Assert that a message is one line."""
    assert "\n" not in str(error)


@settings(max_examples=150, deadline=None, suppress_health_check=list(HealthCheck))
@given(damaged_files(), st.booleans())
def test_damaged_files_come_in_or_are_refused(
    tmp_path: Path, damaged: tuple[str, bytes], yes: bool
) -> None:
    name, data = damaged
    (tmp_path / name).write_bytes(data)
    try:
        text = csv_text(import_table(tmp_path / name, Decisions(yes=yes)))
    except InputError as error:
        require_one_line(error)
    else:
        assert text.count("\n") > 2


@settings(max_examples=150, deadline=None, suppress_health_check=list(HealthCheck))
@given(st.one_of(st.binary(max_size=400), st.text('0123456789.,;\t\n -e:[]()tsx"#', max_size=200)))
def test_any_bytes_come_in_or_are_refused(tmp_path: Path, data: bytes | str) -> None:
    (tmp_path / "a.txt").write_bytes(data.encode() if isinstance(data, str) else data)
    try:
        import_table(tmp_path / "a.txt", Decisions(yes=True))
    except InputError as error:
        require_one_line(error)
