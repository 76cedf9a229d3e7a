"""A search over all kinds: its front, its claim, its files, and curves that nothing reaches."""

import csv
import json
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

from proofmass.analytic.balancer import solve
from proofmass.analytic.balancer.measures import TARGETS, precision_points
from proofmass.analytic.balancer.synthesis import Variant
from proofmass.commands import survey as command
from proofmass.commands.cli import design as app
from proofmass.design import survey as surveys
from proofmass.design.kinds import KindsSearch, all_kinds
from proofmass.design.parts import PartList, leave_out_stops, list_parts
from proofmass.design.survey import EXACT_ERROR, KindResult, Survey, SurveySearch, mark_front

CHAIN = {"length1": 0.4, "length2": 0.45, "length3": 0.45}
CHAIN |= {"stiffness1": 1.0, "stiffness2": 0.5, "stiffness3": 2.0}


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    """Make searches last a second, and run no engine."""
    monkeypatch.setattr(surveys, "SURVEY_HEATS", ((3, 2), (1, 4)))
    monkeypatch.setattr(surveys, "EXTRA_HEATS", ((3, 2), (1, 4)))
    monkeypatch.setattr(surveys, "MAX_EXTRA_PASSES", 1)
    monkeypatch.setattr(command, "check_front", lambda *_: 0)


def run_survey(*args):
    return CliRunner().invoke(app, ["balancer", "--all", *map(str, args)])


def kind(error, count, *searches, variant=None, optimal=False):
    """A result with an error, a number of parts, and the errors of its searches."""
    parts = PartList(2, tuple(range(count - 2)), (), (), (), ())
    given = (error, 1.0, 90.0, 0, searches or (error,), (), optimal)
    return KindResult(variant or Variant(""), {}, parts, error, *given)


def test_the_front_is_that_of_brute_force():
    rng = np.random.default_rng(1)
    kinds = [
        kind(float(e), int(c)) for e, c in zip(rng.random(40), rng.integers(3, 9, 40), strict=True)
    ]
    for one in mark_front(kinds):
        beaten = any(
            (o.error <= one.error and o.parts.count <= one.parts.count)
            and (o.error < one.error or o.parts.count < one.parts.count)
            for o in kinds
        )
        assert one.optimal != beaten


def test_designs_that_are_exact_compete_by_their_parts():
    few, many = kind(0.9 * EXACT_ERROR, 5), kind(0.1 * EXACT_ERROR, 9)
    assert [one.optimal for one in mark_front([many, few])] == [True, False]


@pytest.mark.parametrize(
    ("searches", "said"),
    [
        ((0.010, 0.0119), "Nothing better by a factor 1.2 was found among 1,000 designs"),
        ((0.010, 0.0121), "A better design may exist: of 1 kinds"),
        ((0.010,), "A better design may exist"),
        ((0.5 * EXACT_ERROR, 0.9), "nothing better is looked for"),
    ],
)
def test_a_claim_needs_a_second_search_that_ends_alike(searches, said):
    found = Survey([kind(searches[0], 5, *searches, optimal=True)], [], 1000, 10, 2)
    assert said in found.claim


def test_the_widest_kinds_must_agree_too():
    best = kind(0.01, 5, 0.01, 0.01, optimal=True)
    wider = kind(0.01, 5, 0.01, 0.02, variant=Variant("", free_angle=True))
    assert Survey([best, wider], [], 1, 1, 2).unsure == [wider]
    sure = replace(wider, searches=(0.01, 0.011))
    assert Survey([best, sure], [], 1, 1, 2).unsure == []


@pytest.mark.parametrize(
    ("changes", "parts"),
    [
        ({}, PartList(3, (1, 2, 3), (), (), (), ())),
        ({"stiffness2": 0.0}, PartList(3, (1, 3), (2,), (), (), ())),
        ({"quadratic3": 0.1, "quadratic2": 0.0}, PartList(3, (1, 2, 3), (), (3,), (), ())),
        ({"preload2": 0.1, "low2": 0.0}, PartList(3, (1, 2, 3), (), (), (2,), (2,))),
        ({"high2": 3.0}, PartList(3, (1, 2, 3), (), (), (), ())),
        ({"high2": 0.05}, PartList(3, (1, 2, 3), (), (), (), (2,))),
    ],
)
def test_parts_are_what_must_be_built(changes, parts):
    given = CHAIN | changes
    needed = leave_out_stops(given)
    assert list_parts(needed) == parts
    angle = precision_points(9)
    same = solve(angle, **needed)["balancing_moment"]
    assert same == pytest.approx(solve(angle, **given)["balancing_moment"], abs=1e-12)


def test_a_survey_writes_one_table_and_one_figure(tmp_path):
    answer = run_survey("--segments", 2, "--within", 1, "-o", tmp_path)
    assert answer.exit_code == 0, answer.output
    record = json.loads((tmp_path / "kinds.json").read_text())
    rows = list(csv.DictReader((tmp_path / "kinds.csv").read_text().splitlines()))
    assert [row["kind"] for row in rows] == [one["kind"] for one in record["kinds"]]
    assert len(rows) == 2
    for ending in ("svg", "png"):
        assert (tmp_path / f"kinds.{ending}").stat().st_size > 1000
    angle = precision_points(90)
    for one in record["kinds"]:
        moment = solve(angle, **one["parameters"])["balancing_moment"]
        error = np.sqrt(np.mean((moment - np.sin(angle)) ** 2))
        assert one["rmse"] == pytest.approx(error, abs=1e-12)
        assert one["no_springs"] == [2]
    columns = np.stack([angle, angle**2], -1)
    least = np.linalg.lstsq(columns, np.sin(angle), rcond=None)[1][0]
    # the search's 30 angles and the table's 90 have slightly different least errors
    assert record["kinds"][0]["rmse"] == pytest.approx(np.sqrt(least / 90), rel=0.01)
    assert "none in joint 2" in " ".join(answer.output.split())
    assert record["claim"] in answer.output


def test_an_interrupted_survey_continues_to_the_same_table(tmp_path, monkeypatch):
    once = run_survey("--segments", 2, "-o", tmp_path / "once")
    step = KindsSearch.step

    def interrupted(self):
        if self.state.step == 4 and self.effort.seed == 2:
            raise KeyboardInterrupt
        return step(self)

    monkeypatch.setattr(KindsSearch, "step", interrupted)
    assert run_survey("--segments", 2, "-o", tmp_path / "twice").exit_code == 130
    monkeypatch.setattr(KindsSearch, "step", step)
    twice = run_survey("--segments", 2, "-o", tmp_path / "twice")
    assert (once.exit_code, twice.exit_code) == (1, 1)
    for name in ("kinds.json", "kinds.csv"):
        again = (tmp_path / "twice" / name).read_text()
        assert again == (tmp_path / "once" / name).read_text()


def test_a_curve_that_nothing_reaches_is_exit_code_1(tmp_path):
    """A constant moment: no spring that is relaxed at rest gives it at one degree."""
    file = tmp_path / "flat.csv"
    file.write_text("angle [deg],moment [1]\n0,0.5\n90,0.5\n")
    answer = run_survey("--table", file, "--segments", 2, "-o", tmp_path / "out")
    assert answer.exit_code == 1
    said = " ".join(answer.output.split())
    assert "No balancer reaches the curve within 1 % of its largest moment" in said
    assert "The curve wants +0.5 m g r at 1 degree" in said
    assert "at 1 degrees" in said


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--preload",), "--preload: --all searches kinds with and without it"),
        (("--pareto",), "--pareto: is of one kind of balancer"),
        (("--segments", "5"), "segments must be 2, 3 or 4, got 5"),
        (("--springs", "rubber"), "linear, nonlinear, each"),
        (("--bound", "mass=0:1"), "no kind has such a parameter"),
    ],
)
def test_options_of_one_kind_are_refused(tmp_path, options, words):
    answer = run_survey(*options, "-o", tmp_path / "out")
    assert answer.exit_code == 2
    assert words in answer.output
    assert answer.output.strip().count("\n") == 0


def test_linear_springs_of_three_segments_are_searched(tmp_path):
    """Both elbows count as one kind; all designs of the table can be built and measured again."""
    plain = [k for k in all_kinds([3], ["linear"]) if not k.preload]
    kinds = [k for k in plain if not (k.contact or k.relaxed)]
    found = SurveySearch(kinds, TARGETS["sine"], folder=tmp_path).run()
    assert len(found.kinds) + len(found.impossible) == 2
    assert found.evaluations > 100
    assert found.kinds[0].rmse < 0.2
    for one in found.kinds:
        moment = solve(precision_points(90), **one.parameters)["balancing_moment"]
        assert np.isfinite(moment).all()
