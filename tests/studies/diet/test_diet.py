"""A diet removes known ballast, keeps features that matter, and keeps the motion of the model."""

import csv
import errno
import os
import re
from contextlib import nullcontext
from functools import partial
from pathlib import Path

import mujoco
import numpy as np
import pytest
from typer.testing import CliRunner, Result

from proofmass.commands.cli import app
from proofmass.run.sidecar import load_case
from proofmass.run.solve import plan_run
from proofmass.studies.diet.diet import Diet, DietSearch
from proofmass.studies.diet.edits import (
    EditedModel,
    read_model,
    remove_material,
    shorten,
    write_all_digits,
    write_model,
)
from proofmass.studies.diet.scene import DietScene, load_scene, monitor_run
from proofmass.studies.diet.trial import most_iterations
from proofmass.verdict.compare import compare
from tests.shipped import shipped
from tests.studies.test_study_verdicts import RecordingSearch, unkept_study

CORE_MODEL = """
<mujoco model="core">
  <option timestep="0.002" integrator="implicitfast" {option}/>
  <asset>{asset}</asset>
  <worldbody>
    {world}
    <geom name="table" type="box" size="1 1 .1" pos="0 3 -.12"/>
    <body name="ball" pos="0 3 0.1">
      <freejoint name="ball"/>
      <geom name="ball" size=".1" mass="1"/>
    </body>
    <body name="arm" pos="0 0 1">
      <joint name="arm" axis="0 1 0"/>
      <geom name="arm" type="capsule" size=".02" fromto="0 0 0 .4 0 0" mass="1" {mask}/>
      <site name="tip" pos=".5 0 0"/>
    </body>
    <body name="brace" pos="1.1 0 .2">
      <joint name="slide" type="slide" axis="1 0 0"/><joint name="brace" axis="0 1 0"/>
      <geom name="brace" type="capsule" size=".02" fromto="0 0 0 -.45 0 .6" mass="1" {mask}/>
      <site name="brace_tip" pos="-.6 0 .8"/>
    </body>
  </worldbody>
  <equality><connect name="pin" site1="tip" site2="brace_tip"/>{loop}</equality>
  <actuator>{actuator}</actuator>
  <sensor>
    <jointpos name="angle" joint="arm"/><jointvel name="rate" joint="arm"/>
    <framepos name="ball" objtype="xbody" objname="ball"/>
  </sensor>
  <keyframe><key name="start" qpos="0 3 0.1 1 0 0 0 0 0 0 {idle}"/>{key}</keyframe>
</mujoco>
"""
NO_EXTRAS = dict.fromkeys(("option", "asset", "world", "loop", "actuator", "idle", "key"), "")
CORE_PARTS = {**NO_EXTRAS, "mask": 'contype="0" conaffinity="0"'}
BALLAST = {
    "option": 'tolerance="0" iterations="200"',
    "asset": '<mesh name="rock" vertex="0 0 0 1 0 0 0 1 0 0 0 1"/>'
    '<texture name="sky" type="2d" builtin="checker" width="64" height="64"/>'
    '<material name="paint" texture="sky"/>',
    "world": '<light name="sun"/><camera name="eye"/><site name="mark"/>'
    '<geom name="floor" type="plane" size="9 9 .1" pos="0 0 -20"/>'
    '<geom name="boulder" type="mesh" mesh="rock" pos="40 0 0" contype="0" '
    'conaffinity="0" material="paint"/>'
    '<body name="plate" pos="0 -60 0"><geom name="plate" size=".1"/></body>',
    "loop": '<weld name="weld" body1="plate" body2="world"/>',
    "actuator": '<motor name="motor" joint="arm"/>',
    "key": '<key name="other"/>',
    "mask": "",
}
IDLE_BODY = (
    '<body name="idle" pos="0 -50 0" gravcomp="1"><joint name="idle" armature="1e6"/>'
    '<geom name="idle" size=".1" mass="1"/></body></worldbody>'
)
ELEMENT_LISTS = (
    "joints",
    "bodies",
    "geoms",
    "equalities",
    "actuators",
    "sensors",
    "keys",
    "lights",
    "cameras",
    "meshes",
    "textures",
    "materials",
    "sites",
)


def write_core_model(folder: Path, **parts: str) -> Path:
    """Write a model of a ball on a table and of a closed loop of two bars that fall."""
    file = folder / "scene.xml"
    file.write_text(CORE_MODEL.format(**{**CORE_PARTS, **parts}))
    return file


def write_padded_model(folder: Path) -> Path:
    """Write the same model with ballast: features that it does not need."""
    file = write_core_model(folder, **{**BALLAST, "idle": "0"})
    file.write_text(file.read_text().replace("</worldbody>", IDLE_BODY))
    return file


def search_without_timing(
    file: Path, seconds: float = 0.3, **options: bool
) -> tuple[DietScene, Diet]:
    """The scene of a model and the result of a diet without timings."""
    scene = load_scene(file, seconds)
    return scene, RecordingSearch(scene, unkept_study(), rounds=0, **options).run()


def element_names(spec: mujoco.MjSpec) -> dict[str, set[str]]:
    """The names of the elements of a model, in a set for each list."""
    return {kind: {element.name for element in getattr(spec, kind)} for kind in ELEMENT_LISTS}


@pytest.fixture(scope="module")
def stripped(tmp_path_factory) -> tuple[DietScene, Diet]:
    return search_without_timing(write_padded_model(tmp_path_factory.mktemp("diet")), blind=True)


def test_ballast_is_removed_and_the_core_is_kept(stripped, tmp_path):
    spec, core = (
        stripped[1].reduced.spec,
        element_names(mujoco.MjSpec.from_file(str(write_core_model(tmp_path)))),
    )
    core["geoms"] -= {"arm", "brace"}  # only drawn, so a blind diet removes them
    assert element_names(spec) == core
    assert spec.option.tolerance == 1e-8
    assert {(g.name, g.contype) for g in spec.geoms} == {("ball", 1), ("table", 1)}


def test_the_reduced_model_moves_as_the_core_does(stripped, tmp_path):
    # the diet does not know the core, so the motion of the core is an independent reference
    reduced, core = (
        stripped[1].reduced.compiled(),
        mujoco.MjModel.from_xml_path(str(write_core_model(tmp_path))),
    )
    poses = []
    for m in (reduced, core):
        data = mujoco.MjData(m)
        mujoco.mj_resetDataKeyframe(m, data, 0)
        mujoco.mj_step(m, data, 150)
        poses.append(data.qpos.copy())
    assert np.abs(np.subtract(*poses)).max() < 1e-9  # rounding that grows over 150 steps
    assert np.abs(poses[0][7:]).max() > 0.1  # the bars do move


@pytest.mark.parametrize(
    ("kind", "name"),
    [
        ("contact of geom", "ball"),
        ("contact of geom", "table"),
        ("equality", "pin"),
        ("body", "ball"),
        ("body", "brace"),
    ],
)
def test_features_that_matter_are_kept(stripped, kind, name):
    entry = next(e for e in stripped[1].entries if (e.kind, e.name) == (kind, name))
    assert entry.outcome == "matters"
    assert entry.worst[2] > 1


def test_a_second_diet_removes_nothing(stripped, tmp_path):
    file = tmp_path / "reduced.xml"
    write_model(stripped[1].reduced, file)
    _, again = search_without_timing(file, blind=True)
    assert not [e for e in again.entries if e.outcome == "harmless"]


def test_geoms_that_are_only_drawn_are_kept_without_blind(tmp_path):
    _, found = search_without_timing(write_core_model(tmp_path))
    assert {e.name for e in found.entries if e.outcome == "drawn"} == {"2: arm, brace"}
    assert element_names(found.reduced.spec)["geoms"] == {"table", "ball", "arm", "brace"}


def test_a_channel_may_change_by_a_tenth_of_tolerance_minus_error():
    case = load_case(shipped("fourbar.toml"))
    run = plan_run(case, "dynamics", "mujoco")
    monitored = monitor_run(case, run, "mujoco", read_model(case.model_path))
    found = [c for c in compare(case, "dynamics", "mujoco", monitored.before) if c.allowed > 0]
    assert len(found) > 5
    for c in found:
        rounding = 1e-9 * max(float(np.abs(v).max()) for v in monitored.before.channels.values())
        left = (c.allowed - c.error_max) / 10
        assert left > rounding  # every channel may change by rounding as well
        assert monitored.allowed[c.channel] == pytest.approx(
            np.full(run.x.size, left), rel=1e-9, abs=0
        )


def test_a_diet_that_allows_too_much_removes_the_pin_of_the_loop(tmp_path, monkeypatch):
    # a mutation: with a loose tolerance the diet removes the pin of the loop
    monkeypatch.setattr("proofmass.studies.diet.scene.CHANNEL_ROUNDING_SHARE", 1e6)
    _, found = search_without_timing(write_core_model(tmp_path))
    assert "pin" not in element_names(found.reduced.spec)["equalities"]


def test_a_diet_without_the_sensor_of_the_ball_removes_the_ball(tmp_path):
    file = write_core_model(tmp_path)
    file.write_text(re.sub(r"<framepos.*?/>", "", file.read_text()))
    _, found = search_without_timing(file)
    assert "ball" not in element_names(found.reduced.spec)["bodies"]
    assert "pin" in element_names(found.reduced.spec)["equalities"]


def test_without_sensors_everything_that_moves_is_monitored(tmp_path):
    file = write_padded_model(tmp_path)
    file.write_text(re.sub(r"<sensor>.*</sensor>", "", file.read_text(), flags=re.DOTALL))
    _, found = search_without_timing(file, blind=True)
    assert element_names(found.reduced.spec)["joints"] == {"ball", "arm", "slide", "brace"}
    written = tmp_path / "reduced.xml"
    write_model(found.reduced, written)
    assert mujoco.MjModel.from_xml_path(str(written)).nsensor == 0


FLYING_DISC = """
<mujoco>
  <option gravity="0 0 0" {wind}/>
  <worldbody><body name="disc" pos="1 2 3" euler="0 0 30">
    <freejoint/><geom type="box" size=".3 .1 .02" contype="0" conaffinity="0"/>
  </body></worldbody>
  <keyframe><key name="start" qpos="1.5 2.5 3 0 0 0 1" qvel="{speed} 0 0 2"/></keyframe>
</mujoco>
"""


@pytest.mark.parametrize(("speed", "planar"), [("1 2 0", True), ("1 2 0.1", False)])
def test_a_free_joint_becomes_planar_if_the_motion_is_planar(tmp_path, speed, planar):
    file = tmp_path / "disc.xml"
    file.write_text(FLYING_DISC.format(speed=speed, wind=""))
    scene, found = search_without_timing(file, 1.0)
    reduced = found.reduced.compiled()
    assert reduced.nv == (3 if planar else 6)
    data = mujoco.MjData(reduced)
    mujoco.mj_resetDataKeyframe(reduced, data, 0)
    steps = scene.monitored_runs[0].before.steps
    mujoco.mj_step(reduced, data, steps)
    mujoco.mj_kinematics(reduced, data)
    # free flight with constant velocity and rate, which methods of first order integrate exactly
    x, y, z = map(float, speed.split())
    t = steps * reduced.opt.timestep
    assert data.xpos[1] == pytest.approx([1.5 + x * t, 2.5 + y * t, 3 + z * t], abs=1e-12)
    assert data.xmat[1][:2] == pytest.approx(
        [np.cos(np.pi + 2 * t), -np.sin(np.pi + 2 * t)], abs=1e-12
    )


@pytest.mark.parametrize("name", ["fourbar", "balancer4_sam", "rod_pinned"])
def test_a_model_is_written_with_all_its_digits(tmp_path, name):
    from proofmass.run.sidecar import load_case

    rods = load_case(shipped(f"{name}.toml")).rods
    edited, file = EditedModel(shipped(f"{name}.xml"), rods), tmp_path / f"{name}.xml"
    write_model(edited, file)
    before, after = edited.compiled(), EditedModel(file, rods).compiled()
    for field in (
        "qpos0",
        "key_qpos",
        "key_ctrl",
        "body_inertia",
        "jnt_stiffness",
        "eq_solref",
        "geom_quat",
    ):
        assert np.array_equal(getattr(before, field), getattr(after, field)), field


def test_the_number_of_digits_is_restored_after_writing():
    spec = mujoco.MjSpec.from_string('<mujoco><option timestep="0.00123456789"/></mujoco>')
    spec.compile()
    with write_all_digits():
        assert "0.00123456789" in shorten(spec.to_xml())
    assert "0.00123457" in spec.to_xml()


def test_keys_and_sensors_that_sidecars_use_are_kept(models, edit):
    # two cases of one model: both keys are kept; a sensor that no channel reads is removed
    edit("pendulum.toml", r"kinetic = .*\n", "")
    edit("pendulum.toml", r"until = 10\.0", "until = 1.0")
    edit("pendulum.toml", "n = 1001", "n = 101")
    (models / "other.toml").write_text(
        (models / "pendulum.toml")
        .read_text()
        .replace("\n[", '\nmodel = "pendulum.xml"\nstart = "other"\n[', 1)
    )
    edit("pendulum.xml", r"<keyframe>", '<keyframe><key name="other" qpos="1"/><key name="third"/>')
    scene, found = search_without_timing(models / "pendulum.xml")
    assert {w.name for w in scene.monitored_runs} == {"pendulum dynamics", "other dynamics"}
    left = element_names(found.reduced.spec)
    assert left["keys"] == {"start", "other"}
    assert "kinetic" not in left["sensors"]
    assert "potential" in left["sensors"]


@pytest.mark.usefixtures("undrawn")
def test_command_writes_the_reduced_model_and_repeats_no_trials(tmp_path, monkeypatch):
    # no timing is checked, so no processor is reserved and the rounds may be short
    monkeypatch.setattr("proofmass.studies.diet.trial.reserve_processor", nullcontext)
    monkeypatch.setattr("proofmass.studies.diet.trial.MIN_ROUNDS_SECONDS", 0.0)
    file, reduced = (
        write_core_model(tmp_path, world='<light name="sun"/>'),
        tmp_path / "out" / "reduced.xml",
    )
    for _ in range(2):
        answer = CliRunner().invoke(
            app, ["diet", str(file), "-o", str(reduced), "--seconds", "0.1"]
        )
        assert answer.exit_code == 0, answer.output
        for judge in ("judge_changes", "judge_errors"):  # the second time nothing is judged again
            monkeypatch.setattr(DietSearch, judge, None)
        monkeypatch.setattr("proofmass.commands.diet.write_result", lambda *_: None)
    assert "sun" not in reduced.read_text()
    assert not list(reduced.parent.glob("*.part*"))
    rows = list(csv.DictReader(reduced.with_suffix(".csv").read_text().splitlines()))
    light = [row for row in rows if row["kind"] == "light"]
    assert {row["channel"] for row in light} >= {"angle", "rate", "ball[2]"}
    assert all(float(row["moved_over_allowed"]) == 0 for row in light)
    assert int(light[0]["bytes_before"]) > int(light[0]["bytes_after"])


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize("written", [0, 2])
def test_a_diet_on_a_full_disk_says_so_and_goes_on_later(written, tmp_path, monkeypatch):
    """The disk is full at the first result, or after two; later at each of the files of the end."""
    monkeypatch.setattr("proofmass.studies.diet.trial.reserve_processor", nullcontext)
    monkeypatch.setattr("proofmass.studies.diet.trial.MIN_ROUNDS_SECONDS", 0.0)
    file = write_core_model(tmp_path, world='<light name="sun"/>')
    reduced, model = tmp_path / "out" / "reduced.xml", file.read_bytes()
    words = ["diet", str(file), "-o", str(reduced), "--seconds", "0.05", "--keep-options"]

    def diet_with_space_for(files: int) -> Result:
        writes = []

        def fsync(_: int) -> None:
            writes.append(1)
            if len(writes) > files:
                raise OSError(errno.ENOSPC, "No space left on device")

        monkeypatch.setattr(os, "fsync", fsync)
        answer = CliRunner().invoke(app, words)
        assert not list(tmp_path.rglob("*.part"))
        assert file.read_bytes() == model
        return answer

    def is_told(answer: Result) -> bool:
        lines = answer.output.replace("\n", "")
        return answer.exit_code == 2 and "No space left on device" in lines and "error: " in lines

    assert is_told(diet_with_space_for(written))
    assert not reduced.exists()
    assert diet_with_space_for(1000).exit_code == 0
    assert is_told(diet_with_space_for(0))
    assert is_told(diet_with_space_for(2))  # after the model and its table: the page
    assert diet_with_space_for(1000).exit_code == 0


def test_a_material_is_removed_from_defaults_too(tmp_path):
    file = tmp_path / "disc.xml"
    file.write_text(
        FLYING_DISC.format(speed="1 2 0", wind="").replace(
            "<worldbody>",
            """
        <asset><material name="steel" rgba=".5 .5 .5 1"/></asset>
        <default><geom material="steel"/></default><worldbody>""",
        )
    )
    _, found = search_without_timing(file)
    write_model(found.reduced, tmp_path / "reduced.xml")
    reduced = mujoco.MjModel.from_xml_path(str(tmp_path / "reduced.xml"))
    assert reduced.nmat == 0
    assert reduced.geom_rgba[0] == pytest.approx([0.5, 0.5, 0.5, 1])


@pytest.mark.parametrize(
    "usual",
    ["", '<tendon material="red"/>', '<default class="rope"><tendon material="red"/></default>'],
)
def test_a_material_is_kept_only_if_a_tendon_has_it(usual, tmp_path):
    """A material is removed from geoms, and kept if a tendon has it, itself or by a default."""
    file, own = tmp_path / "rope.xml", 'class="rope"' if "class" in usual else ""
    file.write_text(f"""<mujoco><asset><material name="red" rgba="1 0 0 1"/><material name="steel"/>
      </asset><default><geom material="steel"/>{usual}</default><worldbody>
      <site name="top" pos="0 0 1"/><body name="bob"><joint name="bob"/>
      <geom size=".1" pos="0 .5 0"/><site name="low" pos="0 .5 0"/></body></worldbody>
      <tendon><spatial name="rope" {own} stiffness="5"><site site="top"/><site site="low"/>
      </spatial></tendon></mujoco>""")
    reduced = read_model(file).without(partial(remove_material, name="steel"))
    if usual:
        with pytest.raises(ValueError, match="tendon 'rope' is made of it"):
            reduced.without(partial(remove_material, name="red"))
    else:
        reduced = reduced.without(partial(remove_material, name="red"))
    write_model(reduced, tmp_path / "reduced.xml")
    found = mujoco.MjModel.from_xml_path(str(tmp_path / "reduced.xml"))
    assert [found.material(k).name for k in range(found.nmat)] == ["red"] * bool(usual)
    assert found.tendon_matid[0] == (0 if usual else -1)


@pytest.mark.parametrize(("loops", "iterations"), [(False, 0), (True, 1)])
def test_counted_iterations_are_those_that_the_solver_needs(tmp_path, loops, iterations):
    # soft equalities alone have a quadratic cost, whose minimum is Newton's first step
    text = write_core_model(tmp_path).read_text()
    text = text.replace("<freejoint", "<!-- <freejoint").replace(
        'name="ball"/>\n      <geom', 'name="ball"/> -->\n      <geom'
    )
    text = text.replace("0 3 0.1 1 0 0 0 ", "")
    (tmp_path / "bars.xml").write_text(text if loops else re.sub("<connect.*?/>", "", text))
    scene = load_scene(tmp_path / "bars.xml", 0.1)
    monitored = scene.monitored_runs[0]
    assert most_iterations(scene.edited.compiled(), monitored.brief, 1e-8) == iterations


BAD_MODELS = {
    "missing": (None, "no such model"),
    "not XML": ("<mujoco><worldbody></mujoco>", "XML"),
    "does not compile": ('<mujoco><sensor><jointpos joint="none"/></sensor></mujoco>', "'none'"),
    "diverges": (
        '<mujoco><option timestep="1"/><worldbody><body><joint stiffness="1e9"/>'
        '<geom size="1"/></body></worldbody><keyframe><key qpos="1"/></keyframe></mujoco>',
        "diverged",
    ),
}


@pytest.mark.parametrize("wrong", BAD_MODELS)
def test_bad_input_gives_a_message_of_one_line(tmp_path, wrong):
    text, word = BAD_MODELS[wrong]
    file = tmp_path / "scene.xml"
    if text:
        file.write_text(text)
    answer = CliRunner().invoke(app, ["diet", str(file), "-o", str(tmp_path / "reduced.xml")])
    assert answer.exit_code == 2
    assert word in answer.output
    assert "scene.xml" in answer.output
    assert "Traceback" not in answer.output
    assert len(answer.output.strip().splitlines()) == 1
    assert not (tmp_path / "reduced.xml").exists()
