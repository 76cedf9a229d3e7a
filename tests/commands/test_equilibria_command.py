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
