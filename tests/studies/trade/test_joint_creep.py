"""`choose --creep` of joints: dry friction that holds, measured in bare MuJoCo."""

import re
import shutil
from pathlib import Path

import mujoco
import numpy as np
import pytest

from proofmass.studies.trade.joint_creep import (
    FrictionSetting,
    find_holding_friction,
    measure_joints,
)
from tests.shipped import shipped
from tests.studies.trade.test_creep import run_choose

DATA = Path(__file__).parents[2] / "data"
HOLD565 = DATA / "screen" / "hold565.xml"
SCREW = DATA / "threads" / "screw2430.xml"


def creep_of(text: str) -> np.ndarray:
    """The speeds of all joints of an MJCF at the end of a second in bare MuJoCo."""
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    for _ in range(round(1.0 / model.opt.timestep)):
        mujoco.mj_step(model, data)
    return np.abs(data.qvel)


def pasted(text: str, lines: str) -> str:
    """A model with printed lines: attributes of its joints and equalities, and an option."""
    for line in lines.splitlines():
        if option := re.fullmatch(r"<option (.*)/>", line):
            text = text.replace("<option ", f"<option {option[1]} ")
        elif element := re.search(r'<(\w+ name="\w+")([^<>]*)/>', line):
            text = re.sub(f"<{element[1]}", rf"\g<0>{element[2]}", text)
    return text


def alternatives(printed: str) -> list[str]:
    """The printed ways to hold the joints, without the comment before them."""
    return printed.split("-->\n", 1)[1].split("<!-- or -->\n")


@pytest.mark.parametrize(("model", "speed"), [(HOLD565, 1e-3), (HOLD565, 1e-6), (SCREW, 1e-3)])
def test_the_printed_lines_hold_all_joints_in_bare_mujoco(model, speed):
    answer = run_choose(model, "--creep", speed)
    assert answer.exit_code == 0
    text = model.read_text()
    assert creep_of(text).max() > 10 * speed
    ways = alternatives(answer.stdout)
    assert len(ways) == (2 if speed > 1e-4 else 1)
    for way in ways:
        assert creep_of(pasted(text, way)).max() <= speed


def test_elements_without_names_are_printed_so_that_they_can_be_found(tmp_path):
    file = tmp_path / "model.xml"
    file.write_text("""<mujoco><worldbody><body name="nut">
      <joint name="turn" axis="0 0 1" frictionloss="0.05"/>
      <joint name="rise" type="slide" axis="0 0 1"/><geom size=".1" mass="1"/></body></worldbody>
      <equality><joint joint1="rise" joint2="turn" polycoef="0 .002 0 0 0"/></equality></mujoco>""")
    answer = run_choose(file, "--creep", 1e-3)
    assert answer.exit_code == 0, answer.output
    assert '<equality><joint joint1="rise" joint2="turn" solref=' in answer.stdout
    file.write_text("""<mujoco><worldbody><body name="lift">
      <joint type="slide" axis="0 0 1" frictionloss="30"/><geom size=".1" mass="2"/></body>
      </worldbody></mujoco>""")
    assert re.search(
        r'^<joint solimpfriction="[^"]+"/><!-- joint 0 of body lift -->$',
        run_choose(file, "--creep", 1e-3).stdout,
        re.MULTILINE,
    )


def test_what_was_measured_stands_beside_the_formula():
    answer = run_choose(HOLD565, "--creep", 1e-3)
    said = " ".join(answer.stdout.split())
    own = creep_of(HOLD565.read_text())
    for speed, joint in zip(own, ("shoulder", "elbow"), strict=True):
        told = float(
            re.search(rf"as in the model:.*?joint {joint} creeps with (\S+) rad/s", said)[1]
        )
        assert told == pytest.approx(speed, rel=0.02)  # that of the last tenth of the second
    assert "the formula gives 0.0612 and 0.125" in said


# dry friction of joints without slip, measured in bare MuJoCo: 7.2e-3, 7.1e-6, 7.7e-12 rad/s
@pytest.mark.parametrize(("iterations", "rate"), [(5, 7.2e-3), (20, 7.1e-6), (50, 7.7e-12)])
def test_iterations_without_slip_remove_the_creep(iterations, rate):
    model = mujoco.MjModel.from_xml_path(str(HOLD565))
    own, _ = find_holding_friction(model, 0, 1e-2)
    found = measure_joints(model, 0, own.joints, FrictionSetting(iterations=iterations))
    assert found.fastest == pytest.approx(rate, rel=0.02)


def test_the_softest_friction_that_is_slow_enough_is_proposed():
    model = mujoco.MjModel.from_xml_path(str(HOLD565))
    own, (stiffer, _) = find_holding_friction(model, 0, 1e-3)
    assert own.fastest == pytest.approx(0.1226, rel=0.01)
    assert stiffer.fastest <= 1e-3 < 1.2 * stiffer.fastest  # rounded to two digits of 1 - d
    assert find_holding_friction(model, 0, 0.2)[1] == []  # slow enough as it is


def test_a_speed_that_no_setting_reaches_is_reported():
    answer = run_choose(HOLD565, "--creep", 1e-30)
    assert answer.exit_code == 1
    assert "noslip_iterations 200" in answer.output


def test_a_case_without_joints_that_creep_is_one_whatever_its_model_is_called(tmp_path):
    for name, called in (("case.toml", "block_stops.toml"), ("other.xml", "block_stops.xml")):
        shutil.copy(shipped(called), tmp_path / name)
    text = (tmp_path / "case.toml").read_text()
    (tmp_path / "case.toml").write_text(f'model = "other.xml"\n{text}')
    assert run_choose(tmp_path / "case.toml", "--creep", 1e-3).exit_code == 0
    refused = run_choose(tmp_path / "other.xml", "--creep", 1e-3)
    assert refused.exit_code == 2
    assert "for bodies on contacts give a case" in refused.output


def test_a_case_whose_joints_creep_is_asked_for_them(tmp_path):
    shutil.copy(HOLD565, tmp_path)
    (tmp_path / "hold565.toml").write_text(
        'title = "a held arm"\nsource = "a thread"\nreference = "refined"\n'
        '[run.dynamics]\nuntil = 0.1\nsolvers = ["mujoco"]\n'
    )
    answer = run_choose(tmp_path / "hold565.toml", "--creep", 1e-2)
    assert answer.exit_code == 0
    assert '<joint name="shoulder" solimpfriction=' in answer.stdout


@pytest.mark.parametrize(
    ("args", "words"),
    [
        ((DATA / "screen" / "pd954.xml", "--creep", 1e-6), "no joint creeps that its dry friction"),
        ((HOLD565, "--creep", 1e-6, "-o", "run.py"), "their lines are printed; leave it out"),
        ((HOLD565, "--creep", -1), "give a speed in m/s or rad/s, such as 1e-6"),
        ((DATA / "missing.xml", "--creep", 1e-6), "missing.xml"),
    ],
)
def test_bad_input_gives_a_message_of_one_line(args, words):
    answer = run_choose(*args)
    assert answer.exit_code == 2
    assert words in " ".join(answer.output.split())
    assert len(answer.output.strip().splitlines()) == 1
