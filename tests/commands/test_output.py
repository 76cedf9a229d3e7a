"""Outcomes are printed even if no file can be written; files are whole; inputs are not replaced."""

import os
import sys
from importlib import import_module
from pathlib import Path

import pytest
from typer.testing import CliRunner

from proofmass.base.errors import InputError
from proofmass.base.files import read_bytes, read_text, write_atomically
from proofmass.base.recorded import RecordedColumn, read_table
from proofmass.commands import command
from proofmass.commands.cli import app
from tests.shipped import with_brief_pendulum


@pytest.fixture
def models(models):
    return with_brief_pendulum(models)


def invoke_command(*args: object):
    return CliRunner().invoke(app, [str(a) for a in args])


def test_an_output_folder_that_cannot_be_made_is_reported_before_anything_runs(
    models, tmp_path, monkeypatch
):
    monkeypatch.setattr(
        sys.modules["proofmass.batch.check"],
        "run_parts",
        lambda *_: pytest.fail("a run was started"),
    )
    (tmp_path / "pages").write_text("a file")
    answer = invoke_command("report", models / "pendulum.toml", "-o", tmp_path / "pages")
    assert answer.exit_code == 2
    assert "pages: File exists" in answer.output.replace("\n", "")
    assert isinstance(answer.exception, SystemExit)


def test_outcomes_are_printed_although_the_disk_is_full(models, tmp_path, monkeypatch):
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device", "index.html")

    monkeypatch.setattr("proofmass.report.pages.write_output", full)
    answer = invoke_command("report", models / "pendulum.toml", "-o", tmp_path / "pages")
    assert answer.exit_code == 2
    assert "✓ agrees" in answer.output
    assert "error: index.html: No space left on device" in answer.output
    assert isinstance(answer.exception, SystemExit)


def test_a_failed_write_keeps_the_old_file(tmp_path, monkeypatch):
    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    write_atomically(tmp_path / "a", "old")
    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space"):
        write_atomically(tmp_path / "a", "new")
    assert {p.name: p.read_text() for p in tmp_path.iterdir()} == {"a": "old"}


@pytest.mark.parametrize("spelled", ["same", "another spelling", "link"])
def test_a_diet_does_not_replace_the_model(models, tmp_path, monkeypatch, spelled):
    monkeypatch.chdir(tmp_path)
    model = models / "pendulum.xml"
    before = model.read_bytes()
    link = tmp_path / "link.xml"
    link.symlink_to(model)
    output = {
        "same": model,
        "another spelling": Path("models/../models/pendulum.xml"),
        "link": link,
    }[spelled]
    answer = invoke_command("diet", model, "-o", output)
    assert answer.exit_code == 2
    assert "an input, which no output replaces" in answer.output.replace("\n", "")
    assert model.read_bytes() == before


def test_a_diet_does_not_replace_another_table(models, tmp_path):
    answer = invoke_command("diet", models / "pendulum.xml", "-o", models / "hacksaw_recorded.xml")
    assert answer.exit_code == 2
    assert (
        "hacksaw_recorded.csv: it is there already, and proofmass did not write it"
        in answer.output.replace("\n", "")
    )


def test_pipes_folders_and_loops_of_links_are_not_read(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    os.symlink(tmp_path / "loop", tmp_path / "loop")
    wrong = {
        "pipe": "a device or pipe, not a file",
        ".": "a folder, not a file",
        "loop": "cannot be read: Too many levels of symbolic links",
        "none": "no such file",
    }
    for name, why in wrong.items():
        with pytest.raises(InputError, match=why):
            read_bytes(tmp_path / name)


def test_a_sidecar_is_utf_8_with_or_without_a_byte_order_mark(tmp_path):
    file = tmp_path / "a.toml"
    file.write_bytes("title = 'α'".encode("utf-8-sig"))
    assert read_text(file) == "title = 'α'"
    file.write_bytes("x = 1\ntitle = '5°'".encode("latin-1"))
    with pytest.raises(InputError, match=r"a\.toml: line 2: the byte 0xb0 is not UTF-8"):
        read_text(file)


@pytest.mark.parametrize(
    ("encoding", "mark", "comma"),
    [("latin-1", ",", "."), ("cp1252", ";", ","), ("utf-8-sig", ";", "."), ("utf-16", "\t", ",")],
)
def test_recorded_curves_are_read_as_spreadsheets_write_them(tmp_path, encoding, mark, comma):
    rows = [["t [s]", "angle [°]"], ["0.5", "90"], ["1.5", "-4.5e1"]]
    text = "\r\n".join(mark.join(row) for row in rows)
    file = tmp_path / "rig.csv"
    file.write_bytes(text.replace(".", comma).encode(encoding))
    time, angle = (RecordedColumn(column=name) for name in ("t", "angle"))
    assert read_table(file).monotonic(time).tolist() == [0.5, 1.5]
    assert read_table(file).curve(angle) == pytest.approx([1.5707963267948966, -0.7853981633974483])


def test_numbers_with_points_and_commas_are_refused(tmp_path):
    file = tmp_path / "rig.csv"
    file.write_text("t [s];r [m]\n0;1,5\n1;2.5\n")
    with pytest.raises(InputError, match="line 3: numbers with commas and with points"):
        read_table(file)


@pytest.mark.parametrize("kind", ["folder", "pipe", "loop", "bytes"])
def test_an_unreadable_sidecar_does_not_affect_other_cases(models, kind):
    for file in models.glob("*.toml"):
        if file.stem != "pendulum":
            file.unlink()
    for file in models.glob("*.xml"):
        if file.stem != "pendulum":
            file.unlink()
    bad = models / "x.toml"
    make = {
        "folder": bad.mkdir,
        "pipe": lambda: os.mkfifo(bad),
        "loop": lambda: bad.symlink_to(bad),
        "bytes": lambda: bad.write_bytes(b"reference = 'planar'\ntitle = '\xb0'"),
    }
    make[kind]()
    answer = invoke_command("check", models)
    assert answer.exit_code == 2
    assert answer.output.count("error: ") == 1
    assert "x.toml" in answer.output
    assert "pendulum" in answer.output
    assert "agrees" in answer.output


def test_no_log_of_mujoco_is_left_in_the_folder(models, monkeypatch, edit, undrawn):
    """MuJoCo warns of a spring that is too stiff, and would write its warnings to a log."""
    monkeypatch.setattr(import_module("proofmass.run.solve"), "MAX_FORCE_EVALUATIONS", 3e3)  # brief
    edit("pendulum.xml", '<joint name="pivot"', r'\g<0> stiffness="1e9"')
    monkeypatch.chdir(models)
    for each, exit_code in (("check", 1), ("report", 1), ("trade", 0)):
        answer = invoke_command(each, "pendulum.toml")
        assert answer.exit_code == exit_code
        assert "MuJoCo warning badqacc" in answer.output
    assert not (models / "MUJOCO_LOG.TXT").exists()


@pytest.mark.parametrize("name", ["a [bold] b.toml", "[x] [bold].toml", "ä:smile:.toml"])
def test_a_name_with_markup_is_shown_unchanged(models, name):
    for ending in (".toml", ".xml"):
        (models / f"pendulum{ending}").rename((models / name).with_suffix(ending))
    answer = invoke_command("check", models / name)
    assert answer.exit_code == 0
    assert Path(name).stem in answer.output


def test_a_case_beyond_its_limits_has_a_page_without_drawings(models, tmp_path, edit):
    edit("pendulum.toml", "n = 101", "n = 1001\ntimeout = 1e-3")
    answer = invoke_command("report", models / "pendulum.toml", "-o", tmp_path / "pages")
    assert answer.exit_code == 1
    page = (tmp_path / "pages" / "pendulum.html").read_text()
    assert "its runs reached their limits" in page
    assert "timed out" in page


def test_progress_in_a_log_has_a_line_for_each_case(monkeypatch, capsys):
    """A log has a line for each case, for each 10 s, and at the end.

    A pipe has no cursor that could move back, so a progress bar would fail or fill the log.
    """
    now = [0.0]
    monkeypatch.setattr(command.time, "monotonic", lambda: now[0])
    with command.progress_bar() as advance:
        for done, label in enumerate(
            ["pendulum sweep mujoco", "pendulum sweep pymunk", "fourbar sweep mujoco"], 1
        ):
            advance(label, done, 5)
        now[0] = 11.0
        advance("fourbar dynamics mujoco", 4, 5)
        advance("fourbar dynamics pymunk", 5, 5)
    assert capsys.readouterr().err.splitlines() == [
        "1/5 pendulum sweep mujoco",
        "3/5 fourbar sweep mujoco",
        "4/5 fourbar dynamics mujoco",
        "5/5 fourbar dynamics pymunk",
    ]
