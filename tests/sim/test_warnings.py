"""Tests that MuJoCo's own warnings are shown, and that all parties take the numbers it takes."""

import json
from functools import partial
from pathlib import Path

import mujoco
import numpy as np
import pytest
from typer.testing import CliRunner

from proofmass.analytic.contacts import damping_ratio, is_mixed
from proofmass.commands.cli import app
from proofmass.sim.engines import engine_of
from proofmass.sim.mjcf import collected_warnings, compile_model
from proofmass.sim.protocol.run import Run

MIXED = "MuJoCo warns: mixed solref format, replacing with default (joint 'fall': {}).".format
FALL = """<mujoco><option gravity="0 0 -10" timestep="1e-4"><flag contact="disable"/></option>
<worldbody><body pos="0 0 .3"><joint name="fall" type="slide" axis="0 0 1" limited="true"
  range="-.2 9" solreflimit="{}"/><geom size=".1" mass="1"/></body></worldbody>
<sensor><jointpos name="height" joint="fall"/></sensor>
<keyframe><key name="start" qpos="0"/></keyframe></mujoco>"""


def fall(tmp_path, engine, solref):
    file = tmp_path / "fall.xml"
    file.write_text(FALL.format(solref))
    return engine_of(engine).simulate(file, Run("dynamics", np.linspace(0.0, 0.4, 81), ("height",)))


@pytest.mark.parametrize("solref", ["0.02 -1", "0.02 0", "-1000 10"])
def test_a_mixed_solref_is_said_with_its_element_and_replaced_in_both_engines(tmp_path, solref):
    """MuJoCo takes its default, 0.02 1, for it; the limit has then no rebound that counts."""
    found, default = fall(tmp_path, "mujoco", solref), fall(tmp_path, "mujoco", "0.02 1")
    assert found.notes == (MIXED(solref),)
    assert default.notes == ()
    np.testing.assert_array_equal(found.channels["height"], default.channels["height"])
    chipmunk, plain = fall(tmp_path, "pymunk", solref), fall(tmp_path, "pymunk", "0.02 1")
    np.testing.assert_array_equal(chipmunk.channels["height"], plain.channels["height"])
    assert damping_ratio([float(word) for word in solref.split()]) == 1.0


@pytest.mark.parametrize(
    "solref",
    ["0.02 1", "0.02 0", "0.02 -1", "-1000 -10", "-1000 0", "-1000 10", "0 1", "0 0", "-.1 .1"],
)
def test_a_solref_is_mixed_where_bare_mujoco_says_so(solref):
    model = mujoco.MjModel.from_xml_string(FALL.format(solref))
    data = mujoco.MjData(model)
    data.qpos[0] = -0.21
    with collected_warnings() as said:
        mujoco.mj_forward(model, data)
    assert bool(said) == is_mixed(*map(float, solref.split()))


def test_a_warning_of_the_compiler_is_said_by_both_engines(tmp_path):
    text = FALL.format("0.02 1").replace("<option", '<compiler settotalmass="2"/><option')
    file = tmp_path / "heavy.xml"
    file.write_text(text)
    run = Run("dynamics", np.linspace(0.0, 0.1, 3), ("height",))
    for engine in ("mujoco", "pymunk"):
        (note,) = engine_of(engine).simulate(file, run).notes
        assert note.startswith("MuJoCo warns: compiler attribute 'settotalmass' is deprecated")


def test_warnings_of_nested_contexts_reach_the_outer_one_once(tmp_path):
    file = tmp_path / "heavy.xml"
    file.write_text(FALL.format("0.02 1").replace("<option", '<compiler settotalmass="2"/><option'))
    with collected_warnings() as said:
        compile_model(file)
        compile_model(file)
    assert len(said) == 1
    with collected_warnings() as later:
        pass
    assert not later


def test_a_warning_is_shown_in_the_terminal_in_json_and_on_the_page(tmp_path, monkeypatch):
    """And no MUJOCO_LOG.TXT is left in the folder."""
    monkeypatch.chdir(tmp_path)
    Path("bare").mkdir()
    for folder in (".", "bare"):
        Path(folder, "fall.xml").write_text(FALL.format("0.02 -1"))
    Path("fall.toml").write_text(
        'title = "Fall onto a limit"\nsource = "ours"\nreference = "spatial"\n'
        '[run.dynamics]\nuntil = 0.4\nn = 81\nsolvers = ["mujoco"]\n'
        '[channels]\nheight = { equals = "height", unit = "m" }\n'
    )
    invoke = partial(CliRunner().invoke, app)
    assert MIXED("0.02 -1") in " ".join(invoke(["check", "fall.toml"]).output.split())
    found = json.loads(invoke(["check", "fall.toml", "--json"]).stdout)
    assert found["notes"] == [f"fall dynamics mujoco: {MIXED('0.02 -1')}"]
    own = json.loads(invoke(["check", "bare/fall.xml", "--json"]).stdout)["comparisons"]
    assert MIXED("0.02 -1") in own[0]["message"]
    invoke(["report", "fall.toml", "-o", "pages"])
    pages = "".join(file.read_text() for file in Path("pages").rglob("*.html"))
    assert "mixed solref format" in pages
    assert not list(tmp_path.rglob("MUJOCO_LOG.TXT"))
