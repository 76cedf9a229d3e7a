"""``proofmass design linkage``: its files, output and exit codes, its case, and bad input."""

import csv
import json

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from typer.testing import CliRunner

from proofmass.commands import design_linkage as command
from proofmass.commands.cli import design as app
from proofmass.design.coupler_curves import FourBarCurves, SliderCrankCurves
from proofmass.design.linkage_case import write_linkage_case
from proofmass.design.linkage_designs import LinkageDesign
from proofmass.design.linkage_path import PathSearch, PathTask
from proofmass.design.path_points import PathPoints
from proofmass.design.search import Effort
from proofmass.run.sidecar import load_case
from proofmass.run.solve import solve
from tests.independent.linkages.coupler_point import four_bar_point, slider_crank_point

ROWS = "x [mm],y [mm]\n0,0\n10,2\n20,0\n12,-6\n"
FOUR = np.array([1.0, 0.5, 0.7, 1.0, 2.0, 2.5, 3.0, 1.0, 0.8])
SLIDER = np.array([1.0, 0.5, 0.7, 1.0, 3.0, 0.4, 1.2, 0.9])


@pytest.fixture(autouse=True)
def quick(request, monkeypatch):
    """Make searches last a moment, except in slow tests."""
    if "slow" not in request.keywords:
        monkeypatch.setattr(command, "path_effort", lambda _, seed: Effort(((8, 6), (4, 8)), seed))


@pytest.fixture
def unverified(monkeypatch):
    """Do not run the engines, which take longer than the search."""
    monkeypatch.setattr(command, "check_linkage", lambda *_: 0)


@pytest.fixture
def points(tmp_path):
    file = tmp_path / "points.csv"
    file.write_text(ROWS)
    return file


def run_linkage(*args):
    return CliRunner().invoke(app, ["linkage", *map(str, args)])


def assert_one_line_error(answer, *words):
    assert answer.exit_code == 2, answer.output
    said = answer.output.strip()
    assert said.startswith("error: ")
    assert "\n" not in said
    for word in words:
        assert word in said


@pytest.mark.usefixtures("unverified")
def test_designs_are_written_and_printed_best_first(tmp_path, points):
    folder = tmp_path / "out"
    answer = run_linkage(points, "--closed", "--kind", "fourbar", "-o", folder)
    assert answer.exit_code == 0, answer.output
    record = json.loads((folder / "design.json").read_text())
    best = record["designs"][0]
    off = [
        abs(complex(*four_bar_point(best["parameters"], best["mode"], angle)) - complex(*point))
        for angle, point in zip(best["crank_angles"], record["points"], strict=True)
    ]
    assert off == pytest.approx(best["errors"], abs=1e-12)
    assert best["rms_error"] == pytest.approx(np.sqrt(np.mean(np.square(off))), abs=1e-12)
    assert best["in_order"]
    assert best["on_one_branch"]
    low, high = np.degrees(best["transmission_angle"])
    assert 30.0 <= low < high <= 150.0
    assert f"1: {'open' if best['mode'] > 0 else 'crossed'} four-bar" in answer.output
    assert f"{record['descents']} descents found nothing better" in answer.output
    assert "prove no optimum" in answer.output
    rows, told = (
        list(csv.DictReader((folder / f"{name}.csv").read_text().splitlines()))
        for name in ("designs", "passed")
    )
    assert len(rows) == len(record["designs"])
    assert float(rows[0]["crank [m]"]) == best["parameters"]["crank"]
    assert [float(row["error [m]"]) for row in told] == pytest.approx(best["errors"], abs=1e-15)
    for ending in ("svg", "png"):
        assert (folder / f"designs.{ending}").stat().st_size > 1000


@pytest.mark.usefixtures("unverified")
def test_an_interrupted_command_goes_on_to_the_same_designs(tmp_path, points, monkeypatch):
    options = (points, "--closed", "--kind", "slider_crank", "-o")
    once = run_linkage(*options, tmp_path / "once")
    step = PathSearch.step

    def interrupted(self):
        if self.state.step == 9:
            raise KeyboardInterrupt
        return step(self)

    monkeypatch.setattr(PathSearch, "step", interrupted)
    stopped = run_linkage(*options, tmp_path / "twice")
    assert stopped.exit_code == 130
    assert "to go on, give the same command again" in " ".join(stopped.output.split())
    monkeypatch.setattr(PathSearch, "step", step)
    again = run_linkage(*options, tmp_path / "twice")
    assert again.exit_code == once.exit_code == 0
    texts = [(tmp_path / one / "design.json").read_text() for one in ("once", "twice")]
    assert texts[0] == texts[1]


@pytest.mark.usefixtures("unverified")
def test_a_tolerance_that_is_not_met_ends_with_1_and_the_nearest_design(tmp_path):
    """Nine points of random places, within a nanometre."""
    rng = np.random.default_rng(3)
    file = tmp_path / "points.csv"
    rows = [f"{x},{y},1e-9" for x, y in rng.uniform(0, 1, (9, 2))]
    file.write_text("\n".join(["x [m],y [m],tolerance [m]", *rows]) + "\n")
    answer = run_linkage(file, "--kind", "fourbar", "--mode", "open", "-o", tmp_path / "out")
    assert answer.exit_code == 1, answer.output
    said = " ".join(answer.output.split())
    assert "no linkage found meets the tolerances; the nearest misses point" in said
    assert "1e-09 m are allowed" in said
    assert (tmp_path / "out" / "design.json").exists()


@pytest.mark.usefixtures("unverified")
def test_constraints_that_no_linkage_meets_end_with_1_and_what_is_missing(tmp_path, points):
    bounds = ("crank=1:2", "coupler=0.1:0.2", "rocker=0.1:0.2", "ground=1:2")
    options = [word for bound in bounds for word in ("--bound", bound)]
    answer = run_linkage(points, "--kind", "fourbar", *options, "-o", tmp_path / "out")
    assert answer.exit_code == 1, answer.output
    said = " ".join(answer.output.split())
    assert "no linkage within the bounds has a crank that turns fully" in said
    assert "lacks 1." in said  # at least 1 + 1 - 0.4 m
    assert not (tmp_path / "out" / "design.json").exists()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--bound", "crank"), ("write it as NAME=LOW:HIGH", "deg")),
        (("--bound", "crnk=1:2"), ("'crnk'", "crank")),
        (("--bound", "crank=2:1"), ("must be finite and rise",)),
        (("--bound", "crank=0:1"), ("a length is positive",)),
        (("--bound", "offset=0:1", "--kind", "fourbar"), ("no linkage that is searched",)),
        (("--angles-from", "ground"), ("points.csv", "need a column 'angle")),
    ],
)
def test_bad_options_give_a_message_of_one_line(tmp_path, points, options, words):
    assert_one_line_error(run_linkage(points, *options, "-o", tmp_path / "out"), *words)
    assert not (tmp_path / "out").exists()


def test_a_table_that_is_not_there_or_wrong_gives_a_message_of_one_line(tmp_path, points):
    assert_one_line_error(
        run_linkage(tmp_path / "nowhere.csv"), "nowhere.csv", "no such file of points"
    )
    points.write_text("x [m],y [m]\n0,0\n1,0\n")
    assert_one_line_error(run_linkage(points), "points.csv", "2 points", "needs 3")


def known_design(kind):
    """A design that passes six points of its own curve, a turn from the first on."""
    row, points = (FOUR, four_bar_point) if isinstance(kind, FourBarCurves) else (SLIDER, None)
    p = dict(zip(kind.names, row.tolist(), strict=True))
    angles = 0.4 - np.arange(6.0)
    if points:
        places = [complex(*four_bar_point(p, kind.mode, angle)) for angle in angles]
    else:
        places = [complex(*slider_crank_point(p, angle)) for angle in angles]
    path = PathPoints(np.array(places))
    return LinkageDesign(PathTask(path, kind, -1), np.concatenate([row, angles]))


@pytest.mark.parametrize(
    "kind",
    [FourBarCurves(1), FourBarCurves(-1), SliderCrankCurves()],
    ids=["open", "crossed", "slider"],
)
def test_the_engines_of_the_case_pass_the_points(tmp_path, kind):
    """At the crank angles of the design, in both engines; a changed model does not."""
    design = known_design(kind)
    sidecar = write_linkage_case(tmp_path, "mine", design, title="Mine", source="ours")
    case = load_case(sidecar)
    assert engine_errors(case, design, "mujoco") < 1e-8
    assert engine_errors(case, design, "pymunk") < 1e-8
    model = tmp_path / "mine.xml"
    along, across = (repr(design.parameters[f"point_{name}"]) for name in ("along", "across"))
    text = model.read_text()
    changed = text.replace(f'"point" pos="{along} {across} 0"', f'"point" pos="{along} 0.7 0"')
    assert changed != text
    model.write_text(changed)
    assert engine_errors(load_case(sidecar), design, "mujoco") > 0.05


def engine_errors(case, design, engine):
    """Largest distance of an engine's coupler point from the points of the design [m]."""
    curves = solve(case, "sweep", engine)
    turn = curves.drive[0][0]
    order = np.argsort(turn)
    places = np.column_stack([curves.channels["point.x"], curves.channels["point.y"]])[order]
    x, y = CubicSpline(turn[order], places)(design.angles).T
    return np.abs(x + 1j * y - design.path.points).max()


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["fourbar", "slider_crank"])
def test_the_engines_agree_with_the_design(tmp_path, points, kind):
    answer = run_linkage(
        points, "--closed", "--kind", kind, "--effort", "0.1", "-o", tmp_path / "out"
    )
    assert answer.exit_code == 0, answer.output
    assert "The model matches the reference" in answer.output
    assert (tmp_path / "out" / "report" / "index.html").exists()
