"""Each row of the page "What you have" is tried: its command or call is made."""

import math
import re
import shutil
from pathlib import Path

import mujoco
import numpy as np
import pytest
from typer.testing import CliRunner

import proofmass
import proofmass.batch.check
from proofmass.analytic.linkages import fourbar
from proofmass.batch.check import collect_inputs
from proofmass.commands.cli import app
from proofmass.sim.model_source import ADVICE
from tests.shipped import shipped
from tests.sim.pymunk.test_own_space import LENGTHS, fourbar_channels, make_fourbar
from tests.sim.test_urdf import BASE, SHOULDER, UPPER

PAGE = (Path(__file__).parent.parent / "docs" / "inputs.md").read_text(encoding="utf-8")
ROWS = dict(re.findall(r"^\| (?!what|-)(.*?) \| (.*) \|$", PAGE, re.MULTILINE))
"""The cells of the first table by what a person has."""


@pytest.fixture
def room(tmp_path, monkeypatch):
    """A folder with a robot in each form, in which commands run."""
    monkeypatch.chdir(tmp_path)
    for ending in (".xml", ".toml"):
        shutil.copy(shipped("pendulum.toml").with_suffix(ending), tmp_path / f"pendulum{ending}")
    tilted = SHOULDER.replace('xyz="0 0 1"', 'xyz="0 0 1" rpy="0 1 0"')
    Path("robot.urdf").write_text(f'<robot name="r">{BASE}{UPPER}{tilted}</robot>')
    shutil.copy("pendulum.xml", "robot.xml")
    mujoco.mj_saveModel(mujoco.MjModel.from_xml_path("robot.xml"), "robot.mjb")
    return tmp_path


def command_of(what: str) -> list[str]:
    """The words of the command in the row of the page, without ``proofmass``."""
    (command,) = re.findall(r"`proofmass ([^`]*)`", ROWS[what])[:1]
    return str(command).split()


@pytest.mark.parametrize("what", ["an MJCF", "a URDF", "a compiled model (`.mjb`)"])
def test_a_model_in_a_file_is_checked(room, what, monkeypatch):
    monkeypatch.setattr(proofmass.batch.check, "screen_isolated", lambda _: None)
    answer = CliRunner().invoke(app, command_of(what))
    assert answer.exit_code == 0, answer.output
    assert "self-consistent" in answer.output


def test_a_folder_has_all_that_is_named(room):
    (folder := room / "robots").mkdir()
    for name in ("robot.xml", "robot.urdf", "pendulum.toml", "pendulum.xml", "robot.mjb"):
        shutil.copy(name, folder)
    *_, path = command_of("a folder of robots")
    errors = []
    found = collect_inputs([path], errors)
    assert not errors
    assert {file.name for file in found} == {"robot.xml", "robot.urdf", "pendulum.toml"}


def test_sdf_and_others_get_advice(room):
    for ending, words in ADVICE.items():
        Path(f"robot{ending}").write_text("<x/>")
        answer = CliRunner().invoke(app, ["check", f"robot{ending}"])
        assert (answer.exit_code, answer.stderr) == (2, f"error: robot{ending}: {words}\n")
    for ending, word in ((".sdf", "sdf2mjcf"), (".mjcf", "ends in .xml"), (".xacro", "xacro FILE")):
        assert word in ADVICE[ending]
    assert "`sdf2mjcf`" in ROWS["an SDF"]


def test_each_row_that_is_a_call_can_be_made(room, monkeypatch):
    """The names in the calls are those of the page."""
    made = []
    monkeypatch.setattr(
        proofmass.batch.check, "run_parts", lambda parts, *_: made.extend(p.name for p in parts)
    )
    (room / "robots").mkdir()
    shutil.copy("robot.urdf", "robots")
    names = {
        "proofmass": proofmass,
        "case": proofmass.load_case("pendulum.toml").with_run("dynamics", n=2, until=0.01),
        "model": mujoco.MjModel.from_xml_path("robot.xml"),
    }
    calls = re.findall(r"`(proofmass\.\w+\(.*\))`", "\n".join(ROWS.values()))
    assert len(calls) == 7
    for call in calls:
        if call.startswith("proofmass.check"):
            eval(call, names)
    assert made == ["pendulum", "pendulum", "robot", "pendulum", "pendulum 2"]


def test_the_calls_with_arrays_and_a_space_agree(tmp_path, monkeypatch):
    space, bars = make_fourbar()
    time = np.linspace(0.0, 1.0, 11)
    true = fourbar.solve(time, **LENGTHS)["rocker_angle"]
    channels = fourbar_channels(bars)
    names = {
        "proofmass": proofmass,
        "lengths": LENGTHS,
        "curves": {"time": time, "theta": time, "rocker_angle": true},
        "space": space,
        "angles": {"theta": channels["crank"], "rocker_angle": channels["rocker_angle"]},
    }
    monkeypatch.chdir(tmp_path)
    rows = "".join(f"{t},{math.degrees(t)},{y}\n" for t, y in zip(time, true, strict=True))
    Path("rig.csv").write_text(f"time [s],theta [deg],rocker_angle [rad]\n{rows}")
    csv = "curves of another program as CSV"
    for what in ("arrays: NumPy, a DataFrame", "a `Space` of pymunk", csv):
        (call,) = re.findall(r"`(proofmass\.judge\(.*\))`", ROWS[what])
        assert [c.outcome for c in eval(call, names)] == ["agrees"]
    (call,) = re.findall(r"`(proofmass\.\w+\(.*\))`", ROWS["a test of your own"])
    eval(call, names)


def test_the_scripts_on_the_page_run(capsys):
    for script in re.findall(r"^```python\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL):
        exec(compile(script, "docs/inputs.md", "exec"), {})
    arrays, space = capsys.readouterr().out.splitlines()
    channel, outcome, error, unit, _ = arrays.split()
    assert (channel, outcome, unit) == ("angle", "agrees", "deg")
    assert 0.001 < float(error) < 0.02
    assert space.startswith("self-consistent until 0.5 s, its end: steps of 1, 0.5, 0.25 and 0.125")
