"""What is monitored in a model without a sidecar, and which groups of bodies are independent."""

import os
from pathlib import Path

import mujoco
import numpy as np
import pytest
from typer.testing import CliRunner

from proofmass.base.errors import InputError
from proofmass.base.worker import TimedOut
from proofmass.commands.cli import app
from proofmass.sim.protocol.run import Run
from proofmass.studies.diet import scene as scenes
from proofmass.studies.diet.scene import load_scene
from proofmass.studies.diet.trial import independent_groups
from tests.studies.diet.test_diet_bare import compare_in_bare_mujoco, write_edited_model
from tests.studies.test_study_verdicts import RecordingSearch, unkept_study

TWO_CRANKS = """<mujoco><option timestep="0.002"/>
<worldbody>
  <geom name="floor" type="plane" size="99 99 .1" pos="0 0 -5"/>
  <body name="crank" pos="0 0 1"><joint name="hinge" axis="0 1 0"/>
    <geom type="capsule" size=".02" mass="1" fromto="0 0 0 .4 0 0"/><site name="tip" pos=".4 0 0"/>
  </body>
  <body name="far" pos="50 0 1"><joint name="far" axis="0 1 0"/>
    <geom type="capsule" size=".02" mass="1" fromto="0 0 0 .8 0 0"/>
  </body>
  <body name="rock" pos="-50 0 1"><geom size=".1" mass="9"/></body>
</worldbody>
{tie}
<sensor>{sensors}</sensor>
</mujoco>"""
ENERGIES = '<e_potential name="potential"/><e_kinetic name="kinetic"/>'
TIE = '<equality><joint name="tie" joint1="hinge" joint2="far"/></equality>'


def write_two_cranks(folder: Path, sensors: str = "", tie: str = "") -> Path:
    """Write a model of a crank, another crank 50 m away, and a rock that does not move."""
    file = folder / "far.xml"
    file.write_text(TWO_CRANKS.format(sensors=sensors, tie=tie))
    return file


def kept_bodies_and_sentences(file: Path, **more: object) -> tuple[set[str], tuple[str, ...]]:
    """The bodies that a diet keeps, and its sentences on what was monitored."""
    scene = load_scene(file, 0.3, **more)  # type: ignore[arg-type]
    found = RecordingSearch(scene, unkept_study(), rounds=0, tune=False).run()
    return {b.name for b in found.reduced.spec.bodies} - {"world"}, scene.said


def test_moving_bodies_are_kept_and_independent_groups_are_named(tmp_path):
    bodies, said = kept_bodies_and_sentences(write_two_cranks(tmp_path))
    assert bodies == {"crank", "far"}  # the rock has mass, but neither moves nor touches anything
    assert said[0].startswith("Monitored, since no sidecar, no sensor and no --watch says")
    assert "2 groups of bodies move without acting on each other" in said[1]
    assert "crank; far." in said[1]
    assert "--watch NAME" in said[1]


def test_a_body_that_does_not_move_is_not_kept_for_its_potential_energy(tmp_path):
    bodies, said = kept_bodies_and_sentences(write_two_cranks(tmp_path, ENERGIES))
    assert bodies == {"crank", "far"}
    assert "all sensors of the model, potential and kinetic" in said[0]
    assert "known up to a constant" in said[1]
    # a mutation: the potential energy itself counts, and not its change
    before = scenes.with_changes_since_start
    scenes.with_changes_since_start = lambda curves, names: curves
    try:
        assert "rock" in kept_bodies_and_sentences(write_two_cranks(tmp_path, ENERGIES))[0]
    finally:
        scenes.with_changes_since_start = before


@pytest.mark.parametrize("name", ["hinge", "crank", "tip", "angle"])
def test_only_the_named_element_is_monitored(tmp_path, name):
    """It is a joint, a body, a site or a sensor; the sensors of energies are not monitored then."""
    file = write_two_cranks(tmp_path, ENERGIES + '<jointpos name="angle" joint="hinge"/>')
    scene = load_scene(file, 0.3, (name,))
    found = RecordingSearch(scene, unkept_study(), rounds=0, tune=False).run()
    assert {b.name for b in found.reduced.spec.bodies} == {"world", "crank"}
    assert scene.said[0].startswith("Monitored: ")
    assert name in scene.said[0]
    reduced = write_edited_model(found.reduced, tmp_path)
    shown = bare_hinge_difference(file, reduced)
    assert shown <= 1e-12
    sensors = mujoco.MjSpec.from_file(str(reduced)).sensors
    assert [s.name for s in sensors] == (["angle"] if name == "angle" else [])


def bare_hinge_difference(one: Path, two: Path) -> float:
    """The largest difference of the hinge between two files in bare MuJoCo [rad]."""
    shown = compare_in_bare_mujoco(one, two, 0.3, joints=["hinge"])["hinge"]
    assert shown["range"] > 0.1
    return shown["moved"]


def test_bodies_that_act_on_the_named_one_are_kept(tmp_path):
    """A mutation of the scene: an equality ties the crank that is 50 m away to the other one."""
    file = write_two_cranks(tmp_path, tie=TIE)
    bodies, _ = kept_bodies_and_sentences(file, monitored=("crank",))
    assert bodies == {"crank", "far"}
    assert (
        len(kept_bodies_and_sentences(file)[1]) == 2
    )  # there is one group, so no sentence on groups


def test_unknown_names_to_monitor_are_refused(tmp_path):
    with pytest.raises(
        InputError,
        match=r"far\.xml: --watch: no joint, body, site or sensor is "
        r"called 'crnk'; did you mean 'crank'\? there are: hinge, far, crank, rock",
    ):
        load_scene(write_two_cranks(tmp_path), 0.3, ("crnk",))
    answer = CliRunner().invoke(
        app,
        [
            "diet",
            str(write_two_cranks(tmp_path)),
            "--watch",
            "crnk",
            "-o",
            str(tmp_path / "reduced.xml"),
        ],
    )
    assert answer.exit_code == 2
    assert "did you mean 'crank'?" in answer.output.replace("\n", " ")
    assert "Traceback" not in answer.output


def test_channels_of_a_sidecar_can_be_monitored(models, edit):
    edit("pendulum.toml", r"until = 10\.0", "until = 0.5")
    edit("pendulum.toml", r"n = 1001", "n = 26")
    file = models / "pendulum.xml"
    scene = load_scene(file, 1.0, ("angle",))
    assert list(scene.monitored_runs[0].allowed) == ["angle"]
    assert scene.read == {"angle"}
    found = RecordingSearch(scene, unkept_study(), rounds=0, tune=False).run()
    assert [s.name for s in found.reduced.spec.sensors] == ["angle"]
    with pytest.raises(InputError, match="did you mean 'rate'"):
        load_scene(file, 1.0, ("rat",))
    with pytest.raises(InputError, match=r"--error: its sidecar states what an error may be"):
        load_scene(file, 1.0, (), 1e-3)


@pytest.mark.parametrize("error", ["nan", "inf"])
def test_an_error_that_is_not_finite_is_refused(tmp_path, error):
    with pytest.raises(InputError, match=rf"--error: {error} is no share of a range"):
        load_scene(write_two_cranks(tmp_path), 0.3, (), float(error))


def test_a_sidecar_that_hangs_is_left_out(tmp_path, monkeypatch):
    """Each TOML file is read in a worker: a pipe, or a file that takes too long, is left out.

    A file with the name of the model is used all the same.
    """
    file = write_two_cranks(tmp_path)
    os.mkfifo(tmp_path / "pipe.toml")
    (tmp_path / "deep.toml").write_text("a = " + "[" * 100_000)
    (tmp_path / "other.toml").write_text('model = "other.xml"')
    assert list(scenes.load_sidecars(file)) == []
    asked = []

    def late(function, *args, timeout):
        asked.append((function.__name__, args[0].name))
        raise TimedOut("no answer")

    monkeypatch.setattr(scenes, "call_isolated", late)
    monkeypatch.setattr(scenes, "load_validated", lambda path, strict: path.name)
    (tmp_path / "far.toml").write_text("")
    assert list(scenes.load_sidecars(file)) == ["far.toml"]  # this file has the name of the model
    assert asked == [
        ("model_of_sidecar", f"{name}.toml") for name in ("deep", "far", "other", "pipe")
    ]


TREES = """<mujoco><option jacobian="{jacobian}" gravity="0 0 -9.81"/><worldbody>
  <geom type="plane" size="9 9 .1"/>
  <body name="a" pos="0 0 1"><joint name="a" axis="0 1 0"/><geom size=".1" pos=".3 0 0"/>
    <site name="a" pos=".1 0 0"/></body>
  <body name="b" pos="5 0 1"><joint name="b"/><geom size=".1" pos="0 .3 0"/>
    <site name="b" pos="0 .1 0"/></body>
  <body name="low" pos="9 0 .1"><freejoint/><geom size=".1"/></body>
  <body name="high" pos="9 0 .29"><freejoint/><geom size=".1"/></body>
</worldbody>{tie}</mujoco>"""
TIES = {
    "": False,
    TIE.replace("hinge", "a").replace('"far"', '"b"'): True,
    '<tendon><fixed><joint joint="a" coef="1"/><joint joint="b" coef="1"/></fixed></tendon>': True,
    '<tendon><spatial stiffness="1"><site site="a"/><site site="b"/></spatial></tendon>': True,
    '<actuator><position site="a" refsite="b" gear="1 0 0 0 0 0"/></actuator>': True,
    '<actuator><motor joint="a"/><motor joint="b"/></actuator>': False,
}


@pytest.mark.parametrize("jacobian", ["dense", "sparse"])
@pytest.mark.parametrize("tie", TIES)
def test_independent_groups_are_bodies_that_nothing_joins(tie, jacobian):
    """A ball on another ball acts on it; a ball on the floor only acts on a fixed body."""
    text = TREES.format(tie=tie, jacobian=jacobian)
    run = Run("passive", np.linspace(0, 0.2, 11), ())
    found = independent_groups(mujoco.MjModel.from_xml_string(text), run)
    assert found == ([["a", "b"]] if TIES[tie] else [["a"], ["b"]]) + [["low", "high"]]


@pytest.mark.parametrize("tie", TIES)
def test_a_push_moves_only_bodies_of_its_own_group(tie):
    """The groups are checked by a push in bare MuJoCo: it does not move bodies of other groups."""
    found = []
    for push in (0.0, 1.0):
        model = mujoco.MjModel.from_xml_string(TREES.format(tie=tie, jacobian="dense"))
        data = mujoco.MjData(model)
        if model.nu:
            data.ctrl[:] = 1.0
        data.qvel[model.joint("b").dofadr[0]] = push
        mujoco.mj_step(model, data, 100)
        found.append(data.qpos[model.joint("a").qposadr[0]])
    felt = abs(found[1] - found[0]) > 1e-9
    slack = "<fixed>" in tie  # a tendon without a spring, a limit or a motor transmits no force
    assert felt == (TIES[tie] and not slack), found
