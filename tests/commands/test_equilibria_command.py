"""`proofmass equilibria`: what it finds, writes and refuses."""

import json

import pytest
from typer.testing import CliRunner

from proofmass.commands.cli import app

PAIR = """
[platform]
force = [5.7, -1.9]
[rod.left]
clamp = [-0.3, 0.0]
angle = 0.7
length = 1.0
stiffness = 1.0
[rod.right]
clamp = [0.3, 0.0]
angle = 1.05
length = 1.0
stiffness = 1.0
"""


def run(file, *options):
    return CliRunner().invoke(app, ["equilibria", str(file), *options])


@pytest.fixture
def pair(tmp_path):
    file = tmp_path / "pair.toml"
    file.write_text(PAIR)
    return file


def test_an_assembly_file_is_searched_and_written(pair, tmp_path):
    result = run(pair, "--inflections", "1", "-o", str(tmp_path / "out"))
    assert result.exit_code == 0
    assert "stable" in result.output
    rows = json.loads((tmp_path / "out" / "equilibria.json").read_text())
    assert [row["index"] for row in rows] == [0, 0, 0]
    assert (tmp_path / "out" / "equilibria.png").stat().st_size > 10_000
    assert len((tmp_path / "out" / "equilibria.csv").read_text().splitlines()) == 4


def test_a_shipped_case_is_read_from_its_model():
    result = run("models/rods/rfr2_natural.toml", "--inflections", "1", "--json")
    rows = json.loads(result.stdout)
    assert [row["stable"] for row in rows] == [True] * 3
    assert rows[0]["x"] == pytest.approx(0.6223527, abs=1e-6)  # S3 of Table 7's problem


def test_engines_and_cases_are_written_and_files_of_others_are_kept(pair, tmp_path):
    cases, out = tmp_path / "cases", tmp_path / "out"
    options = "--inflections", "1", "--engine", "mujoco", "--cases", str(cases), "--number", "2"
    result = run(pair, *options, "-o", str(out))
    assert result.exit_code == 0
    assert (
        "mujoco, started from the shape of each: stays in 3 of the 3 stable ones" in result.output
    )
    rows = json.loads((out / "equilibria.json").read_text())
    assert [(row["mujoco"], row["mujoco.rests_in"]) for row in rows] == [
        ("stays", n) for n in (1, 2, 3)
    ]
    names = sorted(file.name for file in cases.iterdir() if file.suffix in (".xml", ".toml"))
    assert names == ["equilibrium2.toml", "equilibrium2.xml"]
    assert run(pair, *options).exit_code == 0  # its own files are written again
    other = tmp_path / "other"
    other.mkdir()
    (other / "equilibrium1.toml").write_text("# mine\n")
    result = run(pair, "--inflections", "1", "--cases", str(other))
    assert result.exit_code == 2
    assert "proofmass did not write it" in result.output
    assert (other / "equilibrium1.toml").read_text() == "# mine\n"


@pytest.mark.parametrize(
    ("options", "wrong"),
    [
        (("--number", "1"), "give --cases FOLDER"),
        (("--cases", "new", "--number", "7"), "no equilibrium 7; there are 1 to 3"),
        (("--engine", "mujocco"), "mujocco"),
    ],
)
def test_wrong_options_write_nothing(pair, options, wrong, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = run(pair, "--inflections", "1", *options)
    assert result.exit_code == 2
    assert wrong in result.output
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize(
    ("old", "new", "wrong"),
    [
        ("stiffness = 1.0", "stiffness = -1.0", "rod.left.stiffness"),
        ("[-0.3, 0.0]", "[-3.0, 0.0]", "clamps 1 and 2 are 3.3 m apart"),
        ("length", "lenght", "unknown key 'lenght'"),
        ("force", "moment = 1.0\nforce", "is a pin"),
    ],
)
def test_bad_input_ends_with_one_line(pair, old, new, wrong):
    pair.write_text(PAIR.replace(old, new))
    result = run(pair)
    assert result.exit_code == 2
    assert wrong in result.output
    assert result.output.count("error:") == 1


@pytest.mark.slow
def test_none_within_the_limits_is_told_with_how_near_it_came(tmp_path):
    file = tmp_path / "one.toml"
    file.write_text(
        "[rod.a]\nclamp = [0.0, 0.0]\nlength = 1.0\nstiffness = 1.0\n"
        "[platform]\nforce = [0.0, 9.0]\n"
    )
    result = run(file, "--alpha", "1.0")
    assert result.exit_code == 1
    assert "no equilibrium" in result.output
