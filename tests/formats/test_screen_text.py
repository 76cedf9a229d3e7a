"""First screens as text, as data, and in the exit code of check."""

import json
from pathlib import Path

import mujoco
import pytest
from typer.testing import CliRunner

from proofmass.batch.check import Result
from proofmass.commands.cli import app
from proofmass.formats.sarif import as_sarif
from proofmass.formats.screen import describe_model, screen_data, screen_lines
from proofmass.formats.terminal import as_json
from proofmass.screen.finding import FindingKind
from proofmass.screen.screen import screen_model

CASES = Path(__file__).parents[1] / "data" / "screen"


@pytest.fixture(scope="module")
def exploding():
    """The screen of two links whose servos need a step of 3.46 ms and get 20 ms."""
    return screen_model(CASES / "pd954.xml")


def test_the_first_line_says_what_the_model_is(exploding):
    first = next(iter(screen_lines(exploding))).plain
    assert first.startswith("pd954.xml: 2 bodies, 2 joints, 2 degrees of freedom; ")
    assert first.endswith("largest stable step 3.46 ms (Euler)")


def test_a_fault_is_told_with_what_to_do(exploding):
    _, fault, cure = (line.plain for line in screen_lines(exploding))
    assert fault.startswith("  ✗ the step of 20 ms is 5.78 times the largest stable one, 3.46 ms (")
    assert fault.endswith("the model blows up at joint b, by the damping of actuator 3")
    assert cure.startswith(
        '    to do: timestep="0.0028" or integrator="implicitfast" (stable up to'
    )


def test_a_mechanism_with_a_loop_is_described_with_its_redundant_equations():
    described = describe_model(screen_model(CASES / "scotch_weld.xml"))
    assert "1 loop (6 equations, 4 redundant), 0 degrees of freedom" in described


def test_a_model_without_a_limit_says_up_to_which_step_and_what_was_left_out():
    described = describe_model(screen_model(CASES / "hold565.xml"))
    assert described.endswith(
        "no unstable step up to 1 s about its start (Euler), dry friction aside"
    )


def test_data_has_the_numbers_of_the_sentences(exploding):
    data = json.loads(as_json(Result(screens={"pd954": exploding})))["screens"]["pd954"]
    [finding] = data["findings"]
    assert (finding["kind"], finding["severity"]) == ("stable-step", "fault")
    assert finding["element"] == {"kind": "joint", "name": "b"}
    assert finding["value"] == pytest.approx(
        data["steps"]["step"] / data["steps"]["limit_on_the_way"]
    )
    assert data["mobility"]["degrees_of_freedom"] == 2
    assert data["steps"]["cause"] == "the damping of actuator 3"


def test_data_without_a_limit_is_valid_json():
    free = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><body><joint axis="0 1 0"/><geom size=".1" pos="1 0 0"/></body>'
        "</worldbody></mujoco>"
    )
    data = json.loads(as_json(Result(screens={"free": screen_model(free)})))["screens"]["free"]
    assert data["steps"]["limits"]["Euler"] is None  # infinite
    assert screen_data(screen_model(free))["findings"] == []


@pytest.mark.parametrize(("kinds", "code"), [("stable-step", 1), ("stable-step,open-loop", 1)])
def test_result_has_a_finding_of_a_kind(exploding, kinds, code):
    result = Result(screens={"pd954": exploding})
    assert result.has_finding(set(kinds.split(","))) == bool(code)
    assert not result.has_finding({FindingKind.OPEN_LOOP})
    assert not result.has_finding(set())


def test_check_fails_on_a_kind_of_finding_and_names_the_kinds_there_are(tmp_path):
    model = tmp_path / "brake.xml"  # self-consistent, exit code 0, though its joint creeps
    model.write_text(
        '<mujoco><worldbody><body><joint axis="0 1 0" frictionloss="20" '
        'solimpfriction="0.9 0.9 0.001"/>'
        '<geom size=".001" pos="1 0 0" mass="1"/></body></worldbody></mujoco>',
        encoding="utf-8",
    )
    invoke = CliRunner().invoke
    assert invoke(app, ["check", str(model)]).exit_code == 0
    failing = invoke(app, ["check", str(model), "--fail-on", "open-loop, creep"])
    assert failing.exit_code == 1
    assert "creeps with 9.81e-3 rad/s" in failing.output  # (1 - d) g T / (2 l), d = 0.9, T = 0.02 s
    wrong = invoke(app, ["check", str(model), "--fail-on", "creeping"])
    assert wrong.exit_code == 2
    assert "no kind of finding creeping; there are: not-finite" in " ".join(wrong.output.split())


def test_sarif_has_a_finding_at_the_line_of_its_element(exploding):
    found = json.loads(as_sarif(Result(screens={"pd954": exploding})))["runs"][0]
    [result] = found["results"]
    assert (result["ruleId"], result["level"]) == ("stable-step", "error")
    line = result["locations"][0]["physicalLocation"]["region"]["startLine"]
    text = (CASES / "pd954.xml").read_text(encoding="utf-8").splitlines()
    assert '<joint name="b"' in text[line - 1]
    assert [rule["id"] for rule in found["tool"]["driver"]["rules"]] == ["stable-step"]


def test_each_kind_of_finding_has_a_sentence():
    assert all(kind.sentence for kind in FindingKind)
    assert len({kind.sentence for kind in FindingKind}) == len(FindingKind)
