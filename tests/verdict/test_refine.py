"""Refinement of rods: orders of convergence, and limits, for rising numbers of segments."""

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from proofmass.base.arrays import Array
from proofmass.batch.check import Result, check, run_task
from proofmass.reference.evaluate import evaluate
from proofmass.reference.samples import run_samples
from proofmass.report import write_report
from proofmass.run.sidecar import load_case
from proofmass.sim.protocol.curves import Curves
from proofmass.verdict.comparison import Comparison
from proofmass.verdict.refinement import (
    RefinedRow,
    RefinementStudy,
    judge_order,
    refined_errors,
    refinement_runs,
)
from tests.shipped import shipped
from tests.sim.rod_models import ENGINES

CANTILEVER_FILE = "rod_cantilever.toml"
SEGMENTS = 5, 10, 20
Edit = Callable[..., Path]


@pytest.fixture
def short_study(edit: Edit) -> Path:
    """The cantilever in both engines, with few segments.

    The limit of its tip is off by the term of h^4, for which 1e-5 m is allowed.
    """
    edit(CANTILEVER_FILE, r"segments = \[10, 20, 40, 80\]", f"segments = {list(SEGMENTS)}")
    edit(CANTILEVER_FILE, r"between = \[20, 40\]\n", "")
    return edit(CANTILEVER_FILE, "richardson = 1e-6", "richardson = 1e-5")


@pytest.fixture
def mujoco_study(short_study: Path, edit: Edit) -> Path:
    """The cantilever with few segments in MuJoCo alone."""
    return edit(CANTILEVER_FILE, r'"mujoco", "pymunk"', '"mujoco"')


def refinement_by_outcome(file: Path) -> dict[str, list[Comparison]]:
    """The comparisons of the refinement by outcome, without those of the run itself."""
    found: dict[str, list[Comparison]] = {}
    for task in refinement_runs(load_case(file)):
        for c in task.study.add(task.segments, run_task(task))[1]:
            found.setdefault(c.outcome, []).append(c)
    return found


def study_synthetic_runs(
    error: Callable[[int, Array], Array], unit: str = "m", **keys: object
) -> tuple[RefinementStudy, list[Comparison]]:
    """A study of synthetic runs, and its comparisons.

    The curves are those of the reference plus an error, ``error(segments, arc lengths)``.  `unit`
    is that of the positions; keywords replace keys of `[refine]`.
    """
    case = load_case(shipped(CANTILEVER_FILE))
    assert case.refine is not None
    channels = {
        name: one.model_copy(update={"unit": unit} if one.unit == "m" else {})
        for name, one in case.channels.items()
    }
    refine = case.refine.model_copy(update=keys)
    case = case.model_copy(update={"refine": refine, "channels": channels})
    found: list[Comparison] = []
    for task in refinement_runs(case):
        if task.solver == "mujoco":
            s = run_samples(task.case, "equilibrium")
            truth = evaluate(task.case, "equilibrium", s, None).channels
            curves = Curves(
                s,
                {name: y + error(task.segments, s) for name, y in truth.items()},
                seconds=0.1,
                steps=1,
            )
            study = task.study
            found = study.add(
                task.segments, (refined_errors(task.case, "equilibrium", "mujoco", curves), curves)
            )[1]
    return study, found


def power_law_error(p: float, size: float = 1.0) -> Callable[[int, Array], Array]:
    """An error of order p, proportional to the arc length."""
    return lambda n, s: size * s * float(n) ** -p


def test_both_engines_show_the_order_and_the_limit(short_study):
    """With half a link at the clamp the order is 2, and the error of the limit is of h^4."""
    labels = []
    result = check([short_study], progress=lambda label, *_: labels.append(label), detectable=False)
    rows = [c for c in result.comparisons if c.run == "refine"]
    assert {(c.solver, c.outcome) for c in rows} == {(name, "agrees") for name in ENGINES}
    assert {c.channel for c in rows} == {
        "order of rod.x",
        "order of rod.y",
        "order of rod.angle",
        "limit of rod.x",
        "limit of rod.y",
    }
    assert result.exit_code == 0
    assert "rod_cantilever equilibrium pymunk, 20 segments" in labels
    assert len(labels) == 2 + 2 * len(SEGMENTS)
    both = {name: [row for row in result.refined if row.solver == name] for name in ENGINES}
    assert [row.segments for row in both["mujoco"]] == [n for n in SEGMENTS for _ in range(3)]
    for one, two in zip(*both.values(), strict=True):  # the same chain, at rest to 1e-12
        assert one.error == pytest.approx(two.error, abs=1e-11)


def test_a_naive_clamp_is_of_first_order(mujoco_study, edit):
    """The naive scheme makes half a cell at the clamp as soft as a whole one.

    Its error is of first order, and the extrapolated limit differs.
    """
    edit(CANTILEVER_FILE, "segments = 40", 'segments = 40\nscheme = "naive"')
    found = refinement_by_outcome(mujoco_study)
    assert set(found) == {"differs"}
    orders = [c for c in found["differs"] if c.channel.startswith("order")]
    assert len(orders) == 3
    for c in orders:
        assert 0.7 < c.error_max < 1.3  # off 2 by about 1; with five links h^2 still counts
        assert "x the allowed error, order 1." in c.message or "order 0." in c.message


@pytest.mark.parametrize(
    ("old", "new"),
    [("stiffness = 1.0 +#", "stiffness = 1.02 #"), ("force_y = 10.0", "force_y = 10.5")],
)
def test_a_wrong_reference_differs_in_orders_and_limits(old, new, mujoco_study, edit):
    """The errors level off at the error of the reference."""
    edit(CANTILEVER_FILE, old, new)
    found = refinement_by_outcome(mujoco_study)
    assert "agrees" not in found
    assert {c.channel for c in found["differs"]} >= {"order of rod.x", "limit of rod.y"}


def test_exact_angles_of_a_circle_show_no_order(edit):
    """The angles are exact, which is reported; the positions are those of a polygon."""
    edit("rod_into_circle.toml", '"mujoco", "pymunk"', '"mujoco"')
    found = refinement_by_outcome(
        edit("rod_into_circle.toml", r"segments = \[10, 20, 40\]", "segments = [4, 8]")
    )
    assert [c.channel for c in found["agrees"]] == ["order of rod.x", "order of rod.y"]
    (exact,) = found["unchecked"]
    assert exact.channel == "order of rod.angle"
    assert "left to rounding" in exact.message


def test_the_order_of_each_pair_of_runs_counts():
    """The order is 2 for the first pairs of runs and 1.8 for the last one, which differs."""
    found = study_synthetic_runs(power_law_error(2.0))[1]
    assert {c.outcome for c in found} == {"agrees"}
    assert not any("left to rounding" in c.message for c in found)
    assert {(round(c.seconds, 9), c.steps) for c in found} == {(0.4, 4)}  # of four runs together

    def late(n: int, s: Array) -> Array:
        return power_law_error(2.0)(n, s) * (2**0.2 if n == 80 else 1.0)

    found = [c for c in study_synthetic_runs(late)[1] if c.channel.startswith("order")]
    assert [(c.outcome, c.at) for c in found] == [("differs", 80)] * 3
    assert found[0].error_max == pytest.approx(0.2, rel=1e-9)  # rounding of the differences
    assert found[0].message == "2 x the allowed error, order 1.8 from 40 to 80 segments"


def test_a_higher_order_than_asked_for_differs():
    """An order that is too high differs as well as one that is too low."""
    assert all(
        c.outcome == "differs"
        for c in study_synthetic_runs(power_law_error(3.0))[1]
        if c.channel.startswith("order")
    )


@pytest.mark.parametrize("bad", [10, 80])
def test_a_nan_differs(bad):
    """A NaN in any run makes orders and limits differ, even if the other runs have no error."""

    def off(n: int, s: Array) -> Array:
        return np.where(s == s[-1], np.nan, 0.0) if n == bad else 0 * s

    found = study_synthetic_runs(off)[1]
    orders = [c for c in found if c.channel.startswith("order")]
    assert [c.outcome for c in orders] == ["differs"] * 3
    assert "not a number" in orders[0].message
    limits = [
        c.outcome
        for c in study_synthetic_runs(off, between=(10, 20) if bad == 10 else (40, 80))[1]
        if c.channel.startswith("limit")
    ]
    assert limits == ["differs"] * 2


def test_errors_at_the_error_floor_do_not_count():
    """Pairs with an error below the error floor, 1e-9 m, do not count.

    The errors are of second order, but at least 3e-10 of the arc length, as with rounding, so that
    only 10 and 20 segments show the order.  With a lower error floor, 40 and 80 segments differ.
    """

    def off(n: int, s: Array) -> Array:
        return np.maximum(power_law_error(2.0, 1e-6)(n, s), 3e-10 * s)

    found = {c.channel: c for c in study_synthetic_runs(off)[1]}["order of rod.x"]
    assert (found.outcome, found.at) == ("agrees", 20)
    assert found.message.endswith("errors up to 1e-09 m are left to rounding")
    lower = {c.channel: c for c in study_synthetic_runs(off, error_floor=1e-12)[1]}[
        "order of rod.x"
    ]
    assert lower.outcome == "differs"
    assert "from 40 to 80" in lower.message


def test_an_error_as_large_as_the_error_floor_shows_no_order():
    refine = load_case(shipped(CANTILEVER_FILE)).refine
    assert refine is not None
    rows = [
        RefinedRow("", "", n, "rod.x", "m", error, 0.0, 1.0, 0.0, 0)
        for n, error in ((10, 3e-9), (20, refine.error_floor))
    ]
    found = judge_order(refine, rows, {"case": "", "solver": "", "run": "refine"})
    assert (found.outcome, found.message.partition(":")[0]) == ("unchecked", "no order shows")


@pytest.mark.parametrize(
    ("between", "fine", "unit", "factor"),
    [((20, 40), 40, "m", 1.0), (None, 80, "m", 1.0), (None, 80, "mm", 1e-3)],
)
def test_the_error_of_the_limit_is_of_the_next_order(between, fine, unit, factor):
    """The limit of an error a h^2 + b h^4 is off by -b h1^2 h2^2, with h1 = 2 h2.

    The allowed error of the limit is given in m, whatever the unit of the channel.
    """

    def off(n: int, s: Array) -> Array:
        return s * (0.1 * n**-2.0 + 5.0 * n**-4.0)

    limit_error = 4 * 5.0 * fine**-4.0
    for share, outcome in ((1.01, "agrees"), (0.99, "differs")):
        found = {
            c.channel: c
            for c in study_synthetic_runs(
                off, unit, between=between, richardson=share * limit_error
            )[1]
        }
        limit = found["limit of rod.x"]
        assert (limit.outcome, limit.at, limit.unit) == (outcome, 1.0, unit)
        assert limit.error_max == pytest.approx(
            limit_error / factor, rel=1e-6, abs=0
        )  # rounding, divided by h^4
        assert "limit of rod.angle" not in found


def test_a_failed_run_is_the_outcome_of_the_study():
    """The outcome of the study names the number of segments of the failed run and its reason."""
    study, _ = study_synthetic_runs(power_law_error(2.0))
    failed = Comparison(
        "rod_cantilever",
        "mujoco",
        "equilibrium",
        "rod.x",
        "m",
        outcome="diverged",
        message="not at rest",
    )
    again = RefinementStudy(study.case, study.refine, "mujoco")
    for n, found in study.runs.items():
        verdict = again.add(n, ([failed], None) if n == 40 else found)[1]
    assert [(c.outcome, c.run, c.message) for c in verdict] == [
        ("diverged", "refine", "with 40 segments: not at rest")
    ]


BAD_TABLES = {
    "falling": (r"segments = \[.*", "segments = [20, 10]", "must rise, from 2 or more"),
    "one link": (r"segments = \[.*", "segments = [1, 10]", "must rise, from 2 or more"),
    "alone": (r"segments = \[.*", "segments = [10]", "at least 2 items"),
    "strangers": ("between = .*", "between = [10, 40]", "neighbours in segments"),
    "no bound": ("richardson = .*", "", "richardson = what the limit may be off by"),
    "no reason": ('why = "half.*', 'why = " "', "needs its reason"),
    "no channel": (
        r'"rod.\[xy\]", "rod.angle"',
        '"rod.phi"',
        "'rod.phi' matches nothing; did you mean 'rod.y'? there are: rod.x",
    ),
    "no run": ("order = 2.0", 'order = 2.0\nrun = "sweep"', "refine.run: there is no run.sweep"),
    "no order": ("order = 2.0\n", "", "refine.order: missing"),
}


@pytest.mark.parametrize(("old", "new", "words"), BAD_TABLES.values(), ids=BAD_TABLES)
def test_bad_tables_of_refine_are_reported(old, new, words, edit):
    """The error names the key and what would be right, and nothing is run."""
    result = check([edit(CANTILEVER_FILE, old, new, count=1)])
    assert (result.exit_code, result.comparisons) == (2, [])
    assert "rod_cantilever.toml: refine" in str(result.errors[0])
    assert words in str(result.errors[0])


def test_a_case_without_rods_cannot_be_refined(edit):
    """A linkage has no rods, and so no segments."""
    file = edit(
        "fourbar.toml",
        r"\[channels\]",
        '[refine]\nsegments = [2, 4]\nrun = "sweep"\n'
        'order = 2.0\nwithin = 0.1\nwhy = "x"\n[channels]',
    )
    assert "needs a [rod.NAME]" in str(check([file]).errors[0])


@pytest.mark.parametrize(("segments", "n"), [((10, 20, 40, 80), 11), ((6, 9), 4)])
def test_samples_are_common_to_all_numbers_of_segments(segments, n, edit):
    """The samples are places that the chains of all numbers of segments have in common.

    They do not depend on the samples of the run itself.
    """
    case = load_case(edit(CANTILEVER_FILE, "n = 41", "n = 41\nuntil = 0.5"))
    refine = case.refine.model_copy(update={"segments": segments, "between": None})
    tasks = list(refinement_runs(case.model_copy(update={"refine": refine})))
    assert tuple(t.case.rod["rod"].segments for t in tasks) == segments * 2
    for task in tasks:
        np.testing.assert_array_equal(run_samples(task.case, "equilibrium"), np.linspace(0, 1, n))


def page_of_synthetic_study(folder: Path, error: Callable[[int, Array], Array]) -> str:
    """The page of the case with a synthetic study, without a run of the case itself."""
    study, found = study_synthetic_runs(error)
    result = Result(cases=[study.case], comparisons=found, refined=study.rows())
    write_report(result, folder)
    return (folder / "rod_cantilever.html").read_text(encoding="utf-8")


@pytest.mark.parametrize("p", [2.0, 1.5])
def test_the_page_shows_orders_and_outcomes(p, tmp_path):
    """The page has the figure, the orders and the outcomes; a wrong order is in the headline."""
    page = page_of_synthetic_study(tmp_path, power_law_error(p))
    assert (tmp_path / "figures" / "rod_cantilever-refine.svg").is_file()
    table = page[page.index("Refinement: the run with more") :]
    assert table.count(f"<td>{p:g}</td>") >= 9  # three pairs of runs, three channels
    assert ("✗ order" in table) == (p != 2.0)
    assert bool(re.search(r"✗ \d+ of \d+ orders of convergence not as", page)) == (p != 2.0)


def test_a_nan_does_not_prevent_the_figure(tmp_path):
    """Errors that are NaN in one run do not prevent the figure of the others."""
    page = page_of_synthetic_study(tmp_path, lambda n, s: s * (np.nan if n == 20 else n**-2.0))
    assert "not a number somewhere" in page
    assert (tmp_path / "figures" / "rod_cantilever-refine.svg").is_file()


def test_pytest_fails_a_wrong_order_too(mujoco_study, edit, pytester):
    """An item of pytest fails where a check reports a wrong order."""
    edit(CANTILEVER_FILE, "within = 0.1", "within = 1e-3")
    run = pytester.runpytest_inprocess("-p", "no:cacheprovider", "-n", "0", str(mujoco_study))
    run.assert_outcomes(failed=1)
    run.stdout.fnmatch_lines(["*refine order of rod.x: differs; *order 1.9* from 5 to 10 segm*"])
