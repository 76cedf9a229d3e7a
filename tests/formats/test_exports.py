"""Results of a check as JUnit XML and as SARIF: counts, messages and places of faults."""

import json
from collections import Counter
from math import nan
from pathlib import Path
from urllib.parse import unquote, urlparse
from urllib.request import url2pathname
from xml.etree import ElementTree

import pytest
from jsonschema import Draft4Validator
from typer.testing import CliRunner

from proofmass.base.errors import InputError
from proofmass.batch.check import Result
from proofmass.commands import cli
from proofmass.commands.cli import app
from proofmass.formats.junit import as_junit
from proofmass.formats.sarif import as_sarif
from proofmass.run.sidecar import load_case
from proofmass.verdict.comparison import Comparison
from proofmass.verdict.outcome import Outcome
from tests.shipped import shipped


def make_comparison(channel: str, outcome: str = "agrees", **more) -> Comparison:
    """A comparison of one channel, in MuJoCo's sweep of the four-bar by default."""
    place = {"case": "fourbar", "solver": "mujoco", "run": "sweep", "seconds": 3.0}
    return Comparison(**{**place, "channel": channel, "unit": "m", "outcome": outcome, **more})


DIFFERS = make_comparison(
    "pin.x",
    Outcome.DIFFERS,
    error_max=3e-2,
    allowed=1e-2,
    error_rms=1e-2,
    nrmse=2e-2,
    at=0.5,
    message="3 x the allowed error",
)
COMPARISONS = [
    make_comparison("pin.y"),
    DIFFERS,
    make_comparison("rocker", Outcome.UNSUPPORTED, message="no such sensor"),
    make_comparison("crank", Outcome.UNCHECKED, solver="pymunk", message="no tolerance"),
    make_comparison(
        "pin.y", Outcome.TIMED_OUT, solver="pymunk", run="dynamics", message="60 s\x00", seconds=nan
    ),
    make_comparison("", Outcome.UNCHECKED, case="loose", message="no sidecar; it loads and steps"),
]
BAD_INPUT = InputError(Path("models/a b.toml"), "drive.joint", "no joint <q>")


@pytest.fixture
def result(models: Path) -> Result:
    """A result with all kinds of outcomes that the exports distinguish, of cases in `models`."""
    case = load_case(models / "fourbar.toml")
    pendulum = load_case(models / "pendulum.toml")
    rows = [*COMPARISONS, make_comparison("angle", Outcome.UNCHECKED, case="pendulum", seconds=nan)]
    return Result(cases=[case, pendulum], comparisons=rows, errors=[BAD_INPUT])


def test_junit_has_a_suite_for_each_case_and_a_test_for_each_channel(result):
    root = ElementTree.fromstring(as_junit(result))
    assert root.tag == "testsuites"
    suites = {suite.get("name"): suite for suite in root}
    assert list(suites) == ["fourbar", "loose", "pendulum", str(BAD_INPUT.file)]
    found = {
        name: tuple(int(suite.get(key)) for key in ("tests", "failures", "errors", "skipped"))
        for name, suite in suites.items()
    }
    assert found == {
        "fourbar": (5, 2, 0, 2),
        "loose": (1, 0, 0, 1),
        "pendulum": (2, 1, 0, 1),
        str(BAD_INPUT.file): (1, 0, 1, 0),
    }
    assert [root.get(key) for key in ("tests", "failures", "errors", "skipped")] == list("9314")
    tests = [(t.get("classname"), t.get("name")) for t in suites["fourbar"]]
    assert tests[:2] == [("fourbar.sweep.mujoco", "pin.y"), ("fourbar.sweep.mujoco", "pin.x")]
    assert len(set(tests)) == 5


def test_junit_counts_are_those_of_its_elements(result):
    root = ElementTree.fromstring(as_junit(result))
    for suite in root:
        assert int(suite.get("tests")) == len(suite.findall("testcase"))
        for key, tag in (("failures", "failure"), ("errors", "error"), ("skipped", "skipped")):
            assert int(suite.get(key)) == len(suite.findall(f"testcase/{tag}"))


def test_junit_messages_have_the_numbers_of_a_failure(result):
    root = ElementTree.fromstring(as_junit(result))
    first, second, third = root.iter("failure")
    assert first.get("message") == (
        "differs: 3 x the allowed error: error 0.03 m at 0.5, 0.01 allowed, 0.06 of the range"
    )
    assert (first.get("type"), first.text) == ("differs", first.get("message"))
    assert second.get("message") == "timed out: 60 s?"  # XML has no zero byte
    assert third.get("type") == "unchecked"
    assert next(root.iter("skipped")).get("message") == "unsupported: no such sensor"
    (error,) = root.iter("error")
    assert error.get("message") == f"{BAD_INPUT.file}: drive.joint: no joint <q>"


def test_junit_shares_the_time_of_a_run_among_its_channels(result):
    root = ElementTree.fromstring(as_junit(result))
    times = [float(test.get("time")) for test in root.find("testsuite")]
    assert times == [1.0, 1.0, 1.0, 3.0, 0.0]
    assert float(root.find("testsuite").get("time")) == 6.0


REQUIRED_KEYS = {  # keys that SARIF 2.1.0 requires, sections 3.13 to 3.28
    "log": {"version", "runs"},
    "run": {"tool", "results"},
    "driver": {"name"},
    "rule": {"id"},
    "result": {"message"},
    "invocation": {"executionSuccessful"},
}
RESULT_LEVELS = {"none", "note", "warning", "error"}


SARIF_SCHEMA = json.loads((Path(__file__).parents[1] / "data" / "sarif-2.1.0.json").read_text())
"""The schema of the standard; its first key says where it comes from."""


def test_the_schema_refuses_what_sarif_does_not_know():
    log = json.loads(as_sarif(Result()))
    log["runs"][0]["tool"]["driver"]["colour"] = "red"
    assert not Draft4Validator(SARIF_SCHEMA).is_valid(log)


def require_sarif(log: dict) -> dict:
    """Check a SARIF log by the schema and the rules of the format, and return its only run."""
    Draft4Validator(SARIF_SCHEMA).validate(log)
    assert log.keys() >= REQUIRED_KEYS["log"]
    assert log["version"] == "2.1.0"
    (run,) = log["runs"]
    assert run.keys() >= REQUIRED_KEYS["run"]
    driver = run["tool"]["driver"]
    assert driver.keys() >= REQUIRED_KEYS["driver"]
    ids = [rule["id"] for rule in driver["rules"]]
    assert len(set(ids)) == len(ids)
    assert all(rule["shortDescription"]["text"] for rule in driver["rules"])
    for invocation in run["invocations"]:
        assert invocation.keys() >= REQUIRED_KEYS["invocation"]
        assert isinstance(invocation["executionSuccessful"], bool)
    for found in run["results"]:
        assert found.keys() >= REQUIRED_KEYS["result"]
        assert found["message"]["text"]
        assert found["level"] in RESULT_LEVELS
        assert ids[found["ruleIndex"]] == found["ruleId"]
        for place in found["locations"]:
            physical = place["physicalLocation"]
            uri = urlparse(physical["artifactLocation"]["uri"])
            assert " " not in uri.geturl()
            assert (uri.scheme == "file") != ("uriBaseId" in physical["artifactLocation"])
            assert physical.get("region", {"startLine": 1})["startLine"] >= 1
        assert all(isinstance(v, str) for v in found["partialFingerprints"].values())
    return run


def test_sarif_keeps_the_rules_of_its_format(result):
    run = require_sarif(json.loads(as_sarif(result)))
    assert Counter(found["ruleId"] for found in run["results"]) == {
        "differs": 1,
        "timed-out": 1,
        "nothing-checked": 1,
        "bad-input": 1,
    }
    assert run["invocations"] == [{"executionSuccessful": False, "exitCode": 2}]
    marks = [json.dumps(found["partialFingerprints"]) for found in run["results"]]
    assert len(set(marks)) == len(marks)
    assert require_sarif(json.loads(as_sarif(Result())))["results"] == []


def test_sarif_names_the_line_of_a_channel(result, models):
    lines = (models / "fourbar.toml").read_text().splitlines()
    first = json.loads(as_sarif(result))["runs"][0]["results"][0]
    place = first["locations"][0]["physicalLocation"]
    uri = urlparse(place["artifactLocation"]["uri"])
    assert Path(url2pathname(unquote(uri.path))) == models / "fourbar.toml"
    line = lines[place["region"]["startLine"] - 1]
    assert line.split("=")[0].strip().strip('"') == "pin.x"
    assert "3 x the allowed error" in first["message"]["text"]


def test_sarif_names_the_sensor_of_a_channel_that_is_left_to_defaults(monkeypatch):
    file = shipped("fourbar.toml")
    monkeypatch.chdir(file.parent)
    found = json.loads(as_sarif(Result(cases=[load_case(file)], comparisons=[DIFFERS])))
    place = found["runs"][0]["results"][0]["locations"][0]["physicalLocation"]
    assert place["artifactLocation"] == {"uri": "fourbar.xml", "uriBaseId": "%SRCROOT%"}
    line = (file.parent / "fourbar.xml").read_text().splitlines()[place["region"]["startLine"] - 1]
    assert 'name="pin"' in line


SIDECAR_LINES = """title = "a"

[parameters]
crank = 1.0
lenght = 2.0

[settings."mujoco:fine"]
timestep = 1e-3

[[tolerance]]
abs = 1e-3

[[tolerance]]
abs = -1.0
"""


@pytest.mark.parametrize(
    ("key", "wrong", "line"),
    [
        ("parameters.lenght", "unknown", 5),
        ("parameters.width", "missing", 3),
        ('settings."mujoco:fine".timestep', "too large", 8),
        ("tolerance.1.abs", "negative", 14),
        ("tolerance.0.why", "missing", 10),
        ("", "", None),
        ("run", "not there", None),
        ("line 4", "the byte 0xb0 is not UTF-8", 4),
    ],
)
def test_sarif_names_the_line_of_a_key(tmp_path, key, wrong, line):
    file = tmp_path / "a.toml"
    file.write_text(SIDECAR_LINES)
    found = json.loads(as_sarif(Result(errors=[InputError(file, key, wrong)])))
    place = found["runs"][0]["results"][0]["locations"][0]["physicalLocation"]
    assert place.get("region", {}).get("startLine") == line


def invoke_command(*args: object):
    return CliRunner().invoke(app, [str(a) for a in args])


def test_check_writes_junit_and_sarif_files(models, edit, tmp_path):
    edit("pendulum.toml", "length = 1.0", "length = 1.001")  # a fault whose cause is found fast
    junit, sarif = tmp_path / "junit.xml", tmp_path / "check.sarif"
    answer = invoke_command("check", models / "pendulum.toml", "--junit", junit, "--sarif", sarif)
    assert answer.exit_code == 1
    root = ElementTree.fromstring(junit.read_bytes())
    # five channels of four solvers; the two solvers with default settings are not checked
    assert (root.get("tests"), root.get("failures"), root.get("skipped")) == ("20", "10", "10")
    found = require_sarif(json.loads(sarif.read_text()))["results"]
    (fault,) = found  # ten curves of two engines have one cause
    assert fault["ruleId"] == "differs"
    place = fault["locations"][0]["physicalLocation"]
    assert place["artifactLocation"]["uri"].endswith("pendulum.toml")
    line = (models / "pendulum.toml").read_text().splitlines()[place["region"]["startLine"] - 1]
    assert line.startswith("length = 1.001")
    sentence = "length is 1.001 m; with 1 m all 10 curves of 2 runs agree"
    assert sentence in fault["message"]["text"].splitlines()[0]
    for failure in root.iter("failure"):
        assert failure.text.splitlines()[0].endswith(sentence)
        assert "differs" in failure.text.splitlines()[1]


@pytest.mark.parametrize("option", ["--junit", "--sarif"])
def test_outcomes_are_printed_although_an_export_cannot_be_written(monkeypatch, tmp_path, option):
    monkeypatch.setattr(
        cli, "check_with_progress", lambda *_, **__: Result(comparisons=[COMPARISONS[0]])
    )
    answer = invoke_command("check", "models", option, tmp_path / "none" / "file")
    assert answer.exit_code == 2
    assert "1 agrees" in answer.output
    flat = answer.output.replace("\n", "")
    assert flat.count("error: ") == 1
    assert "file: No such file or directory" in flat
    assert not list(tmp_path.iterdir())
