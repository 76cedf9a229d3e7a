"""`proofmass new NAME --from ROBOT.urdf` writes an MJCF and a sidecar that agree."""

import pytest
from typer.testing import CliRunner

from proofmass.base.errors import InputError
from proofmass.batch.check import check
from proofmass.commands import new_from_urdf
from proofmass.commands.cli import app
from proofmass.sim.model_source import ADVICE, NO_TEXT
from tests.sim.test_urdf import BASE, MESH, joint, link

ARM = (
    BASE
    + link("bar", 1, -0.5, (0.1, 0.1, 0.01), MESH.format("gone.stl"))
    + joint("pin", "base", "bar", '<origin xyz="0 0 1" rpy="0 1 0"/><dynamics damping="0.1"/>')
    + "<transmission/>"
)


@pytest.fixture
def urdf(tmp_path):
    """A pendulum beside nothing else."""
    file = tmp_path / "robot.urdf"
    file.write_text(f'<robot name="arm">{ARM}</robot>')
    return file


def test_a_case_of_a_urdf_agrees_and_nothing_else_is_written(urdf):
    before = urdf.read_bytes()
    answer = CliRunner().invoke(app, ["new", "arm", "--from", str(urdf)])
    assert answer.exit_code == 0, answer.output
    assert "'gone.stl' not found beside robot.urdf; link bar, whose inertia" in answer.output
    assert "not carried over: 1 transmission" in answer.output
    names = ["arm.toml", "arm.xml", "robot.urdf"]
    assert sorted(file.name for file in urdf.parent.iterdir()) == names
    assert urdf.read_bytes() == before
    assert "<!-- From robot.urdf.\n" in (urdf.parent / "arm.xml").read_text()
    found = check(urdf.parent / "arm.toml", detectable=False, causes=False)
    assert found.exit_code == 0
    assert {c.outcome for c in found.comparisons} >= {"agrees"}


@pytest.mark.parametrize("name", ["arm.toml", "arm.xml"])
def test_nothing_is_overwritten(urdf, name):
    (urdf.parent / name).write_text("mine")
    answer = CliRunner().invoke(app, ["new", "arm", "--from", str(urdf)])
    assert answer.exit_code == 2
    assert answer.output == (
        f"error: {urdf.parent / name}: it is there already; give another name\n"
    )
    assert len(list(urdf.parent.iterdir())) == 2


def test_a_urdf_without_a_case_is_one_line_and_leaves_nothing(urdf, monkeypatch):
    def refuse(name, model):
        raise InputError(model, "drive", "no joint can be driven")

    monkeypatch.setattr(new_from_urdf, "write_proposal", refuse)
    for text, message in ((ARM, "drive: no joint can be driven"), ("", "it has no <link>")):
        urdf.write_text(f'<robot name="arm">{text}</robot>')
        answer = CliRunner().invoke(app, ["new", "arm", "--from", str(urdf)])
        assert (answer.exit_code, answer.output) == (2, f"error: {urdf}: {message}\n")
        assert [file.name for file in urdf.parent.iterdir()] == ["robot.urdf"]


@pytest.mark.parametrize("ending", [".sdf", ".mjb", ".mjcf", ".usd", ".xacro"])
def test_other_formats_are_one_line(tmp_path, ending):
    file = tmp_path / f"robot{ending}"
    file.write_text("<x/>")
    answer = CliRunner().invoke(app, ["new", "arm", "--from", str(file)])
    assert answer.exit_code == 2
    assert answer.output == f"error: {file}: {ADVICE.get(ending, NO_TEXT)}\n"
    assert ending != ".mjb" or "give the MJCF" in answer.output
    assert [one.name for one in tmp_path.iterdir()] == [file.name]
