"""``proofmass design balancer``: its files, its output, exit codes, and bad input."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from proofmass import report
from proofmass.analytic.balancer import solve
from proofmass.analytic.balancer.measures import precision_points, rmse, work_reduction
from proofmass.batch.check import Result
from proofmass.commands import design as command
from proofmass.commands import design_common
from proofmass.commands.cli import design as app
from proofmass.design import stock
from proofmass.design.search import Effort, SavedSearch
from proofmass.design.springs import STRIP_HEADER, read_strips, strip_stiffness
from proofmass.run.sidecar import load_case
from tests.shipped import shipped


@pytest.fixture(autouse=True)
def quick(request, monkeypatch):
    """Make searches last a second, except in slow tests."""
    if "slow" not in request.keywords:
        monkeypatch.setattr(command, "scale_effort", lambda _, seed: Effort(((8, 2), (4, 2)), seed))
        monkeypatch.setattr(stock, "STOCK_HEATS", ((20, 2), (5, 2)))
        monkeypatch.setattr(stock, "STOCK_CANDIDATES", 20)


def run_design(*args):
    return CliRunner().invoke(app, ["balancer", *map(str, args)])


@pytest.fixture
def unverified(monkeypatch):
    """Do not run the engines, which take longer than the search."""
    monkeypatch.setattr(command, "check_design", lambda *_: 0)


def assert_one_line_error(answer, *words):
    assert answer.exit_code == 2, answer.output
    said = answer.output.strip()
    assert said.startswith("error: ")
    assert "\n" not in said
    for word in words:
        assert word in said


@pytest.mark.usefixtures("unverified")
def test_a_design_is_written_with_its_error_and_work_reduction(tmp_path):
    answer = run_design("--free-angle", "-o", tmp_path)
    assert answer.exit_code == 0, answer.output
    design = json.loads((tmp_path / "design.json").read_text())
    angle = precision_points(90)
    moment = solve(angle, **design["parameters"])["balancing_moment"]
    assert design["rmse"] == pytest.approx(rmse(moment, np.sin(angle)), abs=1e-12)
    assert design["work_reduction"] == pytest.approx(work_reduction(moment, np.sin(angle), angle))
    assert f"work reduction {design['work_reduction']:.3f} %" in answer.output
    chosen = design["selection"]
    built = design["parameters"] | chosen["parameters"]
    moment = solve(angle, **built)["balancing_moment"]
    assert chosen["rmse"] == pytest.approx(rmse(moment, np.sin(angle)), abs=1e-12)
    scaled = [built[f"stiffness{i}"] * chosen["moment"] for i in (1, 2, 3)]
    assert scaled == pytest.approx(chosen["stiffness"])


@pytest.mark.usefixtures("unverified")
def test_an_interrupted_search_continues_to_the_same_design(tmp_path, monkeypatch):
    once = run_design("-o", tmp_path / "once")
    step = SavedSearch.step

    def interrupted(self):
        if self.state.step == 3:
            raise KeyboardInterrupt
        return step(self)

    monkeypatch.setattr(SavedSearch, "step", interrupted)
    stopped = run_design("-o", tmp_path / "twice")
    assert stopped.exit_code == 130
    assert "to go on, give the same command again" in " ".join(stopped.output.split())
    monkeypatch.setattr(SavedSearch, "step", step)
    assert run_design("-o", tmp_path / "twice").output == once.output
    assert (tmp_path / "once" / "design.json").read_text() == (
        tmp_path / "twice" / "design.json"
    ).read_text()


@pytest.mark.usefixtures("unverified")
def test_the_target_may_be_a_table(tmp_path):
    """The moments rise with the square of the angle, unlike those of the default target, the sine.

    The design is much nearer to the table than to the sine, and its error is that of the table.
    """
    file, degrees = tmp_path / "wanted.csv", np.arange(91)
    wanted = (degrees / 90.0) ** 2
    rows = [f"{a},{m!r}" for a, m in zip(degrees.tolist(), wanted.tolist(), strict=True)]
    file.write_text("\n".join(["angle [deg],moment [1]", *rows]))
    assert run_design("--table", file, "-o", tmp_path / "own").exit_code == 0
    design = json.loads((tmp_path / "own" / "design.json").read_text())
    assert design["target"] == "wanted"
    moment = solve(precision_points(90), **design["parameters"])["balancing_moment"]
    away = np.sqrt(np.mean((moment - wanted[1:]) ** 2))  # the points are whole degrees
    assert design["rmse"] == pytest.approx(away, abs=1e-12)
    from_sine = np.sqrt(np.mean((moment - np.sin(np.radians(degrees[1:]))) ** 2))
    assert away < 0.1 * from_sine


def test_another_balancer_is_compared_with_the_design(tmp_path, monkeypatch):
    monkeypatch.setattr(design_common, "check", lambda files: Result([load_case(f) for f in files]))
    monkeypatch.setattr(report, "write_report", lambda _, folder: folder / "index.html")
    file = shipped("balancer_sine_free.toml")
    answer = run_design("--free-angle", "--beside", file, "-o", tmp_path)
    assert answer.exit_code == 0, answer.output
    theirs, ours = load_case(file), load_case(tmp_path / "balancer_sine.toml")
    assert ours.compare_with[theirs.title].parameters == theirs.parameters
    assert ours.parameters["length1"] != theirs.parameters["length1"]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--beside", shipped("fourbar.toml")), ("reference", "'fourbar' is no balancer")),
        (("--beside", "nowhere.toml"), ("nowhere.toml", "no such file")),
        (("--target", "cosine"), ("no such target", "sine180", "--table")),
        (("--preload-joint", "4"), ("preload of 3 segments must be of joints 2, 3, got 4",)),
        (("--preload-joint", "2", "--preload-joint", "3"), ("got 2 and 3",)),
        (("--preload-joint", "3", "--bound", "preload3=0:1"), ("can never release", "sign")),
        (
            ("--preload-joint", "3", "--free-angle", "--bound", "preload3=-1:1"),
            ("must not pass 0",),
        ),
        (("--extension", "0.1"), ("write it as E1:E2",)),
        (("--extension", "-1:0"), ("must stay positive",)),
        (("--extension", "0:0.1", "--target", "laevo"), ("give no other",)),
        (("--strips", "nowhere.csv"), ("nowhere.csv", "no such file of strips")),
        (("--segments", "5"), ("segments must be 2, 3 or 4",)),
        (("--springs", "rubber"), ("linear, nonlinear, each",)),
        (("--bound", "length1"), ("write it as NAME=LOW:HIGH",)),
        (("--bound", "length7=0.1:0.2"), ("no such parameter", "length3")),
        (("--bound", "length1=0.5:0.4"), ("must rise",)),
        (("--free-angle", "--bound", "rest_angle=3:3.1"), ("random designs", "widen bounds")),
        (("--catalogue", "nowhere.csv"), ("nowhere.csv", "no such file of springs")),
        (("--table", "nowhere.csv"), ("nowhere.csv", "no such recorded curve")),
    ],
)
def test_bad_input_gives_a_message_of_one_line(tmp_path, options, words):
    assert_one_line_error(run_design(*options, "-o", tmp_path / "out"), *words)


@pytest.mark.usefixtures("unverified")
def test_clock_springs_have_the_stiffness_of_their_joints(tmp_path):
    """Each spring has the stiffness of its joint; a spring that no strip gives is reported."""
    strips = tmp_path / "strips.csv"
    strips.write_text(",".join(STRIP_HEADER) + "\nthick,20,2,300,4000,206,1400\n")
    answer = run_design("--free-angle", "--strips", strips, "--moment", 5, "-o", tmp_path / "out")
    design = json.loads((tmp_path / "out" / "design.json").read_text())
    reasons = [spring["why"] for spring in design["clock_springs"] if "why" in spring]
    assert answer.exit_code == int(bool(reasons)), answer.output
    moments = solve(precision_points(90), **design["parameters"])
    (thick,) = read_strips(strips)
    for joint, spring in enumerate(design["clock_springs"], 1):
        k = 5.0 * design["parameters"][f"stiffness{joint}"]
        assert spring["stiffness"] == pytest.approx(k, rel=1e-12)
        most = 5.0 * np.abs(moments[f"moment{joint}"]).max()
        assert spring["moment"] == pytest.approx(most, rel=1e-9)
        if "strip" in spring:
            made = spring["count"] * strip_stiffness(thick, spring["length"])
            assert made == pytest.approx(k, rel=1e-12)
            assert f"joint {joint}: {spring['count']} x thick" in answer.output
        else:
            assert f"joint {joint}: no clock spring for" in answer.output or k == 0.0
    assert_one_line_error(
        run_design("--springs", "nonlinear", "--strips", strips, "-o", tmp_path / "other"),
        "--strips: clock springs are linear, and --springs is nonlinear",
    )


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("angle [deg],moment [1]\n0,0\n50,1\n40,1\n90,1", ("line 4", "does not rise")),
        ("angle [deg],moment [1]\n0,0\n50,one\n90,1", ("line 3", "'one' is no number")),
        ("angle [deg],moment [1]\n0,0\n80,1", ("1 to 90 degrees",)),
        ("angle [deg],moment [1]\n0,0\n45,0\n90,0", ("positive work",)),
        ("angle [deg],moment [N m]\n0,0\n90,1", ("'moment [1]'",)),
    ],
)
def test_a_wrong_table_is_refused(tmp_path, text, words):
    file = tmp_path / "wanted.csv"
    file.write_text(text)
    assert_one_line_error(run_design("--table", file, "-o", tmp_path / "out"), "wanted", *words)


@pytest.mark.slow
def test_the_engines_agree_with_the_design(tmp_path):
    answer = run_design(
        "--free-angle",
        "--effort",
        "0.1",
        "--pareto",
        "--beside",
        shipped("balancer_sine_free.toml"),
        "-o",
        tmp_path,
    )
    assert answer.exit_code == 0, answer.output
    assert "The model matches the reference" in answer.output
    assert (tmp_path / "report" / "index.html").is_file()
    assert (tmp_path / "pareto.svg").is_file()
