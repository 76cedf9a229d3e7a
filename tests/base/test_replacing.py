"""No output replaces an input or a file that proofmass did not write."""

import os
from pathlib import Path

import pytest
from typer.testing import CliRunner

from proofmass.base.errors import InputError
from proofmass.base.files import (
    LIST_NAME,
    OUTPUT_MARK,
    make_folder,
    output_permissions,
    protect,
    remove_output,
    require_replaceable,
    write_output,
)
from proofmass.case.inputs import named_files
from proofmass.commands.cli import app
from tests.shipped import shipped

FOREIGN = "a file of somebody else, with no mark"


@pytest.fixture
def case(tmp_path: Path) -> Path:
    """A short case in a folder of its own."""
    folder = tmp_path / "case"
    folder.mkdir()
    for ending in ("xml", "toml"):
        text = shipped(f"pendulum.{ending}").read_text(encoding="utf-8")
        text = text.replace("until = 10.0", "until = 0.5").replace("n = 1001", "n = 51")
        (folder / f"pendulum.{ending}").write_text(text, encoding="utf-8")
    return folder / "pendulum.toml"


def invoke(*words: object) -> str:
    """Run a command that refuses its output, and return what it prints in one line."""
    answer = CliRunner().invoke(app, [str(word) for word in words])
    assert answer.exit_code == 2, answer.output
    assert isinstance(answer.exception, SystemExit)
    return answer.output.replace("\n", "")


def content(folder: Path) -> dict[str, bytes]:
    """The files below a folder, and what is in them."""
    return {
        str(file.relative_to(folder)): file.read_bytes()
        for file in sorted(folder.rglob("*"))
        if file.is_file()
    }


COMMANDS = {
    "check --junit": ["check", "{case}", "--junit", "{out}"],
    "check --sarif": ["check", "{case}", "--sarif", "{out}"],
    "schema": ["schema", "-o", "{out}"],
    "choose": ["choose", "{case}", "--error", "1e-3", "-o", "{out}"],
    "choose --creep": ["choose", "{case}", "--creep", "1e-3", "-o", "{out}"],
    "animate": ["animate", "{case}", "-o", "{out}"],
    "diet": ["diet", "{model}", "-o", "{out}"],
}
ENDINGS = {"choose": ".py", "choose --creep": ".py", "animate": ".gif", "diet": ".xml"}


def words_of(name: str, case: Path, out: Path) -> list[str]:
    """The words of a command for a case and a file to write."""
    model = case.with_suffix(".xml")
    return [word.format(case=case, model=model, out=out) for word in COMMANDS[name]]


@pytest.mark.parametrize("name", COMMANDS)
def test_a_file_of_somebody_else_is_not_replaced(name, case, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    file = tmp_path / f"mine{ENDINGS.get(name, '.txt')}"
    file.write_text(FOREIGN)
    before = content(tmp_path)
    printed = invoke(*words_of(name, case, file))
    assert "proofmass did not write it" in printed
    assert "--force" in printed
    assert content(tmp_path) == before


@pytest.mark.parametrize("ending", ["toml", "xml"])
@pytest.mark.parametrize("name", ["check --junit", "check --sarif", "diet", "schema"])
def test_no_input_is_replaced_even_with_force(name, ending, case):
    before = content(case.parent)
    printed = invoke(*words_of(name, case, case.with_suffix(f".{ending}")), "--force")
    if ending == "xml" or name != "diet":
        assert "an input, which no output replaces" in printed
    assert content(case.parent) == before


def test_a_file_that_an_input_names_is_not_replaced_even_with_force(case):
    """An included file, and a recorded curve that an earlier report wrote."""
    part = case.parent / "part.xml"
    model = case.with_suffix(".xml")
    text = model.read_text(encoding="utf-8")
    part.write_text("<mujoco><option/></mujoco>", encoding="utf-8")
    model.write_text(text.replace("</mujoco>", '<include file="part.xml"/></mujoco>'))
    before = content(case.parent)
    assert "part.xml: an input" in invoke("check", case, "--junit", part, "--force")
    assert content(case.parent) == before


@pytest.mark.parametrize("named", ["pendulum.toml", "pendulum.xml", "part.xml", "rig.csv"])
@pytest.mark.parametrize("given", [".", "pendulum.toml"])
@pytest.mark.parametrize(
    ("ending", "old", "new"),
    [
        ("xml", "</mujoco>", '<extension><plugin plugin="none"/></extension></mujoco>'),
        ("toml", "title = ", "tilte = "),
    ],
    ids=["model", "sidecar"],
)
def test_a_faulty_input_is_not_replaced_either(named, given, ending, old, new, case, monkeypatch):
    monkeypatch.chdir(case.parent)
    model = case.with_suffix(".xml")
    model.write_text(model.read_text().replace("</mujoco>", '<include file="part.xml"/></mujoco>'))
    Path("part.xml").write_text("<mujoco><option/></mujoco>")
    Path("rig.csv").write_text("t [s],angle [rad]\n0,0\n1,1\n")
    case.write_text(case.read_text().replace('reference = "pendulum"', 'reference = "rig.csv"'))
    faulty = case.with_suffix(f".{ending}")
    faulty.write_text(faulty.read_text().replace(old, new, 1))
    before = content(case.parent)
    printed = invoke("check", given, "--junit", named, "--force")
    assert f"{named}: an input, which no output replaces" in printed
    assert content(case.parent) == before


@pytest.mark.parametrize("text", ["A review, " * 40, "a\\u0000b"])
def test_a_text_that_is_no_name_of_a_file_names_none(text, case):
    case.write_text(case.read_text() + f'\nnote = "{text}"\n')
    assert named_files(case) == [case, case.with_suffix(".xml")]


@pytest.mark.parametrize("name", ["check --junit", "check --sarif", "schema", "animate"])
def test_an_own_file_is_replaced_and_a_foreign_one_with_force(name, case, tmp_path):
    file = tmp_path / f"mine{ENDINGS.get(name, '.txt')}"
    words = words_of(name, case, file)
    for more in ([], [], ["--force"]):
        if more:
            file.write_text(FOREIGN)
        answer = CliRunner().invoke(app, [*words, *more])
        assert answer.exit_code == 0, answer.output
        assert OUTPUT_MARK.encode() in file.read_bytes()
    assert not (tmp_path / LIST_NAME).exists()


def test_a_report_replaces_its_own_files_alone(case, tmp_path):
    folder = tmp_path / "pages"
    words = ["report", str(case), "-o", str(folder), "--data"]
    for _ in range(2):
        answer = CliRunner().invoke(app, words)
        assert answer.exit_code == 0, answer.output
    pages = content(folder)
    mine = folder / "figures" / "mine.svg"
    mine.write_text(FOREIGN)
    assert CliRunner().invoke(app, words).exit_code == 0
    assert mine.read_text() == FOREIGN
    for name in ("index.html", "pendulum.html", "results.json", "data/pendulum-dynamics.csv"):
        other = tmp_path / name.replace("/", "_") / "pages"
        (other / name).parent.mkdir(parents=True)
        (other / name).write_text(FOREIGN)
        printed = invoke("report", case, "-o", other, "--data")
        assert f"{Path(name).name}: it is there already" in printed
        assert (other / name).read_text() == FOREIGN
        again = ["report", str(case), "-o", str(other), "--data", "--force"]
        assert CliRunner().invoke(app, again).exit_code == 0
        assert content(other).keys() == pages.keys()


@pytest.mark.parametrize("name", ["figures", "static", "data"])
def test_a_report_writes_nothing_through_a_link(name, case, tmp_path):
    other = tmp_path / "other"
    other.mkdir()
    (tmp_path / "pages").mkdir()
    (tmp_path / "pages" / name).symlink_to(other)
    printed = invoke("report", case, "-o", tmp_path / "pages", "--data")
    assert f"{name}: a link to {other}" in printed
    assert not content(other)
    (tmp_path / "linked").symlink_to(other)
    assert "linked: a link to" in invoke("report", case, "-o", tmp_path / "linked")
    assert not content(other)


def test_an_output_is_no_input_folder_device_or_pipe(tmp_path):
    (tmp_path / "input").write_text(OUTPUT_MARK)
    (tmp_path / "link").symlink_to("input")
    (tmp_path / "hard").hardlink_to(tmp_path / "input")
    os.mkfifo(tmp_path / "pipe")
    with output_permissions(force=True):
        protect([tmp_path / "input"])
        for name in ("input", "link"):
            with pytest.raises(InputError, match="an input"):
                write_output(tmp_path / name, "x")
        write_output(tmp_path / "hard", "x")  # another name of the file, which is replaced alone
        for file, why in ((tmp_path / "pipe", "pipe"), (Path("/dev/null"), "device")):
            with pytest.raises(InputError, match=why):
                require_replaceable(file)
        with pytest.raises(InputError, match="a folder"):
            write_output(tmp_path, "x")
    assert (tmp_path / "input").read_text() == OUTPUT_MARK
    write_output(tmp_path / "input", "x")  # the permissions ended with the context


def test_a_link_is_replaced_and_the_file_that_it_names_is_not(tmp_path):
    (tmp_path / "old").write_text(OUTPUT_MARK)
    (tmp_path / "link").symlink_to("old")
    (tmp_path / "nowhere").symlink_to("gone")
    write_output(tmp_path / "link", f"new {OUTPUT_MARK}")
    assert (tmp_path / "old").read_text() == OUTPUT_MARK
    with pytest.raises(InputError, match="proofmass did not write it"):
        write_output(tmp_path / "nowhere", "x")
    assert not (tmp_path / "gone").exists()


def test_a_file_without_a_mark_is_known_by_the_list_of_its_folder(tmp_path):
    write_output(tmp_path / "a.csv", "1")
    write_output(tmp_path / "a.csv", "2")
    (tmp_path / "b.csv").write_text("3")
    with pytest.raises(InputError, match=r"b\.csv: it is there already"):
        write_output(tmp_path / "b.csv", "4")
    remove_output(tmp_path / "b.csv")
    remove_output(tmp_path / "a.csv")
    assert content(tmp_path).keys() == {LIST_NAME, "b.csv"}
    (tmp_path / LIST_NAME).write_text("b.csv\n")  # as another process would
    write_output(tmp_path / "b.csv", "5")
    assert (tmp_path / "b.csv").read_text() == "5"


@pytest.mark.parametrize("kind", ["link", "pipe", "folder"])
def test_a_list_that_is_no_file_is_neither_read_nor_written(tmp_path, kind):
    outside = tmp_path / "outside"
    outside.write_text("a.csv\n")
    folder = make_folder(tmp_path / "folder")
    (folder / "a.csv").write_text("1")
    place = folder / LIST_NAME
    {"link": lambda: place.symlink_to(outside), "pipe": lambda: os.mkfifo(place)}.get(
        kind, place.mkdir
    )()
    for name in ("a.csv", "b.csv"):
        with pytest.raises(InputError):
            write_output(folder / name, "2")
    assert outside.read_text() == "a.csv\n"
    assert (folder / "a.csv").read_text() == "1"
    assert not (folder / "b.csv").exists()
