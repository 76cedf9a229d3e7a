"""The page of a case: the data that its script reads, the texts, and the first table."""

import json
import re
from base64 import b64decode
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from docs.make.pictures import LONGER
from proofmass.base.errors import InputError
from proofmass.batch.check import Result
from proofmass.case.case import Case
from proofmass.evidence.coverage import (
    FOLDER_VARIABLE,
    Coverage,
    StoredFindings,
    coverage_file,
    coverage_key,
)
from proofmass.evidence.coverage_search import CheckedRun, Finding
from proofmass.evidence.diagnosis import Diagnosis, Explanation, Fault
from proofmass.formats.explain import format_not_noticed
from proofmass.reference.evaluate import evaluate
from proofmass.reference.reference_curves import ComparedCurves
from proofmass.report import case_page, write_report
from proofmass.report.case_data import (
    kept_samples,
    motion_data,
    recorded_data,
    runs_data,
    script_json,
)
from proofmass.report.case_figures import find_motions, measured_curves
from proofmass.report.case_page import (
    advice,
    cause_panels,
    format_badge,
    load_noticed_panel,
    noticed_panel,
)
from proofmass.report.data import PlottedRun, plotted_run
from proofmass.report.overview import FIRST_DECADE, LAST_DECADE, axis_place, overview_table
from proofmass.report.style import BACKGROUNDS, TEXT_CONTRAST, contrast, make_legible, solver_looks
from proofmass.report.tables import smallest_changes
from proofmass.report.words import format_closeness
from proofmass.run.sidecar import load_case
from proofmass.run.solve import plan_run
from proofmass.sim.motion import Motion, motion
from proofmass.verdict.compare import compare
from proofmass.verdict.outcome import Outcome
from tests.report.whole import result_from_references, with_failed_dynamics, without_figures
from tests.shipped import shipped

DATA = re.compile(r'<script type="application/json" id="data">(.*?)</script>', re.DOTALL)
MAX_PAGE_SIZE = 700_000  # [bytes] largest size of a page, with its data


def decode_numbers(text: str, kind: str) -> np.ndarray:
    """Decode numbers in base64; `kind` is their NumPy type."""
    return np.frombuffer(b64decode(text), kind)


def decode_scaled(packed: dict[str, Any]) -> np.ndarray:
    """Decode numbers that are stored as whole numbers of 16 bits and a scale; -2^15 is NaN."""
    numbers = decode_numbers(packed["numbers"], "<i2").reshape(packed["shape"]).astype(float)
    return np.where(numbers == -(2**15), np.nan, numbers) * packed["scale"]


@pytest.fixture(scope="module")
def fourbar() -> Case:
    return load_case(shipped("fourbar.toml"))


@pytest.fixture(scope="module")
def result(fourbar: Case) -> Result:
    return result_from_references(fourbar, detectable=True)


@pytest.fixture(scope="module")
def runs(fourbar: Case, result: Result) -> list[PlottedRun]:
    return [plotted_run(result, fourbar, kind) for kind in fourbar.run]


@pytest.fixture(scope="module")
def page(result: Result, tmp_path_factory: pytest.TempPathFactory) -> str:
    index = write_report(result, tmp_path_factory.mktemp("page"))
    return index.with_name("fourbar.html").read_text(encoding="utf-8")


def test_curves_on_the_page_are_those_of_the_run(page: str, result: Result, fourbar: Case) -> None:
    data = json.loads(DATA.search(page)[1])  # type: ignore[index]
    assert list(data["runs"]) == ["sweep", "dynamics"]
    for kind, run in data["runs"].items():
        x = decode_numbers(run["x"], "<f8")
        assert run["every"] == 1
        for solver in fourbar.run[kind].solvers:
            curves = result.curves[fourbar.name, kind, solver]
            assert np.array_equal(x, curves.x)
            expected = evaluate(fourbar, kind, curves.x, curves.drive).channels
            for name in fourbar.channels_of(kind):
                reference = decode_numbers(run["channels"][name]["curve"], "<f8")
                assert np.array_equal(reference, expected[name])
                difference = decode_numbers(run["solvers"][solver]["differences"][name], "<f4")
                exact = curves.channels[name] - expected[name]
                assert difference == pytest.approx(exact, rel=6e-8, abs=0)  # rounding of float32
                assert np.abs(difference).max() > 0


def test_the_largest_difference_is_where_the_comparison_says(page: str, result: Result) -> None:
    data = json.loads(DATA.search(page)[1])  # type: ignore[index]
    for c in result.comparisons:
        run = data["runs"][c.run]
        own = run["solvers"][c.solver]
        difference = np.abs(decode_numbers(own["differences"][c.channel], "<f4"))
        at = int(np.abs(decode_numbers(run["x"], "<f8") - c.at).argmin())
        assert difference[at] == pytest.approx(difference.max(), rel=1e-6, abs=0)
        recorded = own["comparisons"][c.channel]
        assert difference[at] * run["channels"][c.channel]["factor"] == pytest.approx(
            recorded["error"], rel=1e-6, abs=0
        )
        assert recorded["share"] == pytest.approx(c.relative_to_range, rel=1e-3, abs=0)


@pytest.mark.parametrize("name", ["fourbar", "rod_cantilever"])
def test_a_page_stays_below_its_largest_size(name: str, page: str, tmp_path: Path) -> None:
    if name != "fourbar":
        case = load_case(shipped(f"{name}.toml"))
        index = write_report(result_from_references(case, off=1e-4), tmp_path)
        page = index.with_name(f"{name}.html").read_text(encoding="utf-8")
    assert 30_000 < len(page.encode()) < MAX_PAGE_SIZE


def test_thinned_curves_keep_extremes_and_largest_errors(runs: list[PlottedRun]) -> None:
    whole = runs_data(runs, 10**9)
    assert [run["every"] for run in whole.values()] == [1, 1]
    room = len(script_json(whole)) // 2
    found = runs_data(runs, room)
    assert room // 2 < len(script_json(found)) <= room
    run, data = runs[0], found["sweep"]
    index = kept_samples(run, data["every"])
    assert (data["samples"], data["drawn"]) == (361, len(index))
    assert decode_numbers(data["x"], "<f8").tolist() == run.longest.x[index].tolist()
    for curve in run.longest.channels.values():
        assert {int(curve.argmin()), int(curve.argmax())} <= set(index.tolist())
    places = run.longest.x[index]
    assert all(np.abs(places - c.at).min() == 0 for c in run.rows)


def test_ends_and_largest_errors_are_kept_without_any_room(runs: list[PlottedRun]) -> None:
    data = runs_data(runs, 0)["sweep"]
    assert data["every"] == 361
    assert {0.0, float(runs[0].longest.x[-1])} <= set(decode_numbers(data["x"], "<f8").tolist())
    assert all(np.abs(decode_numbers(data["x"], "<f8") - c.at).min() == 0 for c in runs[0].rows)


def test_a_page_that_is_too_large_has_fewer_samples(
    page: str, result: Result, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    size = len(page.encode())
    monkeypatch.setattr(case_page, "MAX_PAGE_BYTES", size - 40_000)
    smaller_page = write_report(result, tmp_path).with_name("fourbar.html").read_bytes()
    assert size - 200_000 < len(smaller_page) <= size - 40_000
    data = json.loads(DATA.search(smaller_page.decode())[1])  # type: ignore[index]
    assert {run["every"] for run in data["runs"].values()} == {2}


def test_curves_of_a_solver_that_stopped_early_end_there(fourbar: Case, result: Result) -> None:
    whole = result.curves[fourbar.name, "sweep", "pymunk"]
    short = replace(
        whole,
        x=whole.x[:100],
        stopped="a limit position",
        channels={name: curve[:100] for name, curve in whole.channels.items()},
        drive=tuple(part[:, :100] for part in whole.drive or ()),
    )
    cut = replace(result, curves={**result.curves, (fourbar.name, "sweep", "pymunk"): short})
    run = plotted_run(cut, fourbar, "sweep")
    own = recorded_data(fourbar, [run])["runs"]["sweep"]["solvers"]["pymunk"]
    assert own["stopped"] == "a limit position"
    assert own["end"] == short.x[-1]
    assert len(decode_numbers(own["differences"]["pin.x"], "<f4")) == 100
    moved = find_motions(fourbar, [run])[0]["sweep"]
    drawn = np.isfinite(moved.away["pymunk"]).all(axis=(1, 2))
    assert drawn.tolist() == (moved.index < 100).tolist()
    assert np.isnan(decode_scaled(motion_data(moved)["away"]["pymunk"])[~drawn]).all()


def test_curves_with_nan_are_drawn_where_they_are_finite(
    fourbar: Case, result: Result, tmp_path: Path
) -> None:
    whole = result.curves[fourbar.name, "sweep", "mujoco"]
    broken = whole.channels["pin.x"].copy()
    broken[200:] = np.nan
    curves = replace(whole, channels={**whole.channels, "pin.x": broken}, violation=float("nan"))
    rows = [c for c in result.comparisons if (c.run, c.solver) != ("sweep", "mujoco")]
    found = replace(
        result,
        comparisons=[*compare(fourbar, "sweep", "mujoco", curves, detectable=False), *rows],
        curves={**result.curves, (fourbar.name, "sweep", "mujoco"): curves},
    )
    with without_figures():
        page = write_report(found, tmp_path).with_name("fourbar.html").read_text(encoding="utf-8")
    own = json.loads(DATA.search(page)[1])["runs"]["sweep"]["solvers"]["mujoco"]  # type: ignore[index]
    off = decode_numbers(own["differences"]["pin.x"], "<f4")
    assert np.isfinite(off).tolist() == [k < 200 for k in range(361)]
    assert own["violation"] is None
    assert re.search(
        r'<a href="#sweep/mujoco/pin\.x@[^"]+"[^>]* class="bad"><b>no number ✗</b>', page
    )
    assert own["comparisons"]["pin.x"]["outcome"] == "differs"
    away = decode_scaled(json.loads(DATA.search(page)[1])["motions"]["sweep"]["away"]["mujoco"])  # type: ignore[index]
    assert np.isnan(away[-1]).all()
    assert np.isfinite(away[0]).all()


def motion_with_differences(
    case: Case, change: Callable[[np.ndarray], dict[str, np.ndarray]]
) -> Motion:
    """The motion of a case's first run, with MuJoCo's differences to the reference made up.

    `change` gives the differences, by channel, at the samples of the run [SI].
    """
    kind = next(iter(case.run))
    run = plan_run(case, kind, "mujoco")
    state = run.motion(run.x) if run.drives else None
    reference = evaluate(case, "sweep", run.x, state).channels
    differences = change(run.x)
    known = {name: reference[name] for name in differences}
    return motion(case.model_path, run, {"mujoco": (known, differences)}, 31)


def test_bodies_are_moved_by_measured_differences(fourbar: Case) -> None:
    names = [body.name for body in motion_with_differences(fourbar, lambda x: {}).bodies]
    found = motion_with_differences(
        fourbar, lambda x: {"rocker": 1e-7 * np.cos(x), "coupler.angle": 3e-7 * np.sin(x)}
    )
    x, away = found.picture.x, found.away["mujoco"]
    # the loops have a weight of 1e-6 of the measured values, the square of `LOOP_WEIGHT`
    assert away[:, names.index("rocker"), 2] == pytest.approx(1e-7 * np.cos(x), abs=1e-12)
    assert away[:, names.index("coupler"), 2] == pytest.approx(3e-7 * np.sin(x), abs=1e-12)
    assert away[:, names.index("crank")] == pytest.approx(0.0, abs=1e-12)  # prescribed by the drive
    assert found.places[:, names.index("crank"), 2] == pytest.approx(x, abs=1e-12)
    assert found.unfit < 1e-13
    assert set(found.used) == {"rocker", "coupler.angle"}


def test_bodies_of_a_free_motion_are_moved_by_measured_differences() -> None:
    found = motion_with_differences(
        load_case(shipped("pendulum.toml")), lambda x: {"angle": 1e-6 * np.sin(x)}
    )
    assert found.away["mujoco"][:, 0, 2] == pytest.approx(1e-6 * np.sin(found.picture.x), abs=1e-14)


def test_without_positions_there_is_no_reference_to_draw(fourbar: Case) -> None:
    found = motion_with_differences(fourbar, lambda x: {"holding_moment": np.cos(x)})
    assert (found.used, found.away) == ((), {})


def test_a_wrong_length_does_not_fit_the_reference(models: Path) -> None:
    file = models / "fourbar.xml"
    file.write_text(file.read_text().replace(*LONGER))
    case = load_case(models / "fourbar.toml")
    names = ["rocker", "coupler.angle", "pin.x", "pin.y"]
    found = motion_with_differences(case, lambda x: dict.fromkeys(names, 0 * x))
    assert 1e-3 < found.unfit < 2e-2  # 0.025 m too long, over a size of 3 m


def test_poses_at_a_joint_limit_are_marked() -> None:
    case = load_case(shipped("balancer_progressive_contact.toml"))
    found = find_motions(case, [])[0]["sweep"]
    (touching,) = found.at_limit.values()
    assert 0 < touching.sum() < len(touching)
    assert any(spot.spring for spot in found.spots)


def test_poses_on_the_page_are_those_of_the_motion(fourbar: Case, runs: list[PlottedRun]) -> None:
    found = find_motions(fourbar, runs)[0]["dynamics"]
    data = motion_data(found)
    size = np.abs(found.places).max(axis=(0, 1))
    assert np.abs(decode_scaled(data["places"]) - found.places).max(axis=(0, 1)) == pytest.approx(
        0.0, abs=float(size.max()) / 2**16 * 1.01
    )
    assert [body["name"] for body in data["bodies"]] == ["crank", "coupler", "rocker"]
    assert set(data["away"]) == set(fourbar.run["dynamics"].solvers)
    assert set(measured_curves(runs[1])["pymunk"][1]) >= {"pin.x", "rocker"}


def test_links_of_a_rod_are_drawn_as_one_line() -> None:
    case = load_case(shipped("rod_snap.toml"))
    rods = {"rod": case.rod["rod"].model_copy(update={"segments": 10})}
    runs = {"sweep": case.run["sweep"].model_copy(update={"n": 22})}
    found = find_motions(case.model_copy(update={"rod": rods, "run": runs}), [])[0]["sweep"]
    data = motion_data(found)
    assert [body["name"] for body in data["bodies"]] == ["motor"]
    (rod, pin) = data["lines"]
    assert rod["name"] == "rod"
    points = decode_scaled(rod["points"])
    steps = np.linalg.norm(np.diff(points, axis=1), axis=2).sum(axis=1)
    half = 1.0 / 20  # [m] half of the first of 10 links, which have 1 m in all, is clamped
    assert steps == pytest.approx(1.0 - half, abs=1e-4)
    assert decode_scaled(pin["points"])[:, 0] == pytest.approx(
        np.tile([0.8, 0.0], (len(points), 1)), abs=1e-4
    )


def test_the_first_table_shows_the_largest_error_and_its_place(page: str, result: Result) -> None:
    rows = [
        c
        for c in result.comparisons
        if (c.run, c.solver) == ("sweep", "mujoco") and c.unit in ("m", "rad")
    ]
    (first, *_) = re.findall(r'href="#sweep/mujoco/([^@"]+)@([^"]+)"', page)
    (shown_row,) = [c for c in rows if c.channel == first[0]]
    worst = max(c.relative_to_range for c in rows)
    assert shown_row.relative_to_range == pytest.approx(
        worst, rel=1e-3, abs=0
    )  # stored with four digits
    assert float(first[1]) == pytest.approx(shown_row.at, rel=1e-5)
    assert axis_place(10**LAST_DECADE * 10) == 100.0
    assert axis_place(10 ** (FIRST_DECADE - 1)) == 0.0


@pytest.mark.parametrize(("worse", "milder"), [("pin.x", "pin.y"), ("pin.y", "pin.x")])
def test_the_first_table_shows_the_channel_that_differs_most(
    worse: str, milder: str, fourbar: Case, result: Result
) -> None:
    """Of two channels that differ it shows the one with the larger multiple of what is allowed."""
    allowed_shares = {worse: 1 / 50, milder: 1 / 20}
    rows = [
        replace(c, outcome="differs", allowed=c.error_max * allowed_shares[c.channel], message="x")
        if (c.run, c.solver) == ("sweep", "mujoco") and c.channel in allowed_shares
        else c
        for c in result.comparisons
    ]
    data = {
        "solvers": {"mujoco": {}, "pymunk": {}},
        **recorded_data(
            fourbar, [plotted_run(replace(result, comparisons=rows), fourbar, "sweep")]
        ),
    }
    (run,) = overview_table(data)
    cell = run.rows[0].cells[0]
    assert cell
    assert (cell.bad, f"{worse}@" in cell.link, run.rows[0].kind) == (True, True, "position")
    assert format_badge(fourbar, rows, "bad", []).startswith("✗ Differs: 2 of ")
    assert "differ by up to 1e-13 of their range in the sweep" in format_closeness(fourbar, rows)
    assert "Compare the lengths" in advice(fourbar, rows, [], "bad")[0]


def test_how_well_engines_agree_is_one_sentence(fourbar: Case, result: Result) -> None:
    assert (
        format_closeness(fourbar, result.comparisons)
        == "Positions to 1e-13 of their range in the sweep, 1e-13 in dynamics."
    )
    assert format_closeness(fourbar, []) == ""


def test_the_smallest_change_is_that_of_the_most_sensitive_channel(
    fourbar: Case, result: Result
) -> None:
    found = {row.name: row for row in smallest_changes(fourbar, result.comparisons)}
    known = [(c.detectable["crank"].size, c) for c in result.comparisons if "crank" in c.detectable]
    least, c = min(known, key=lambda item: item[0])
    assert found["crank"].by == f"{c.channel}, {c.run}, MuJoCo"
    assert float(found["crank"].size.removesuffix(" %")) == pytest.approx(100 * least, rel=0.05)
    assert found["crank"].value == "1 m"


def test_a_reference_that_was_compared_is_not_evaluated_again(
    fourbar: Case, result: Result, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        pytest.fail("the reference was evaluated again")

    known = {
        key: ComparedCurves(
            **vars(curves), reference=evaluate(fourbar, "sweep", curves.x, curves.drive).channels
        )
        for key, curves in result.curves.items()
    }
    monkeypatch.setattr("proofmass.report.data.reference_for", fail)
    run = plotted_run(replace(result, curves=known), fourbar, "sweep")
    for solver, shown in run.reference.items():
        assert shown.channels is known[fourbar.name, "sweep", solver].reference


def example_coverage(case: Case) -> Coverage:
    """A made-up coverage with numbers of every kind: noticed, refused and not noticed."""
    noticed = {"run": "sweep", "solver": "mujoco", "channel": "pin.x"}
    return Coverage(
        case.name,
        "key",
        (CheckedRun("sweep", "mujoco", 1, 1, units=("m",)),),
        (Finding("parameter", "crank", "m", 1.0, 0.1, True, 2e-13, **noticed),),
        (
            Finding("place", "body coupler x", "m", 1.0, 0.1, True, 3e-13, **noticed),
            Finding("range", "rocker", "rad", 1.0, 0.1, True, refused="beyond it", **noticed),
            *(Finding(kind, "crank", "1", 1.0, 0.1, False) for kind in UNNOTICED_KINDS),
        ),
    )


UNNOTICED_KINDS = ("inertia", "damping", "friction", "armature", "site", "direction")


def test_unnoticed_numbers_are_described_in_the_words_of_explain(fourbar: Case) -> None:
    found = example_coverage(fourbar)
    panel = noticed_panel(fourbar, found)
    lines = list(format_not_noticed(fourbar, found))
    assert [*panel.unnoticed, *panel.more] == lines
    assert lines[0].startswith("inertia of crank: all runs that are checked are at rest")
    assert len(panel.more) == len(UNNOTICED_KINDS) - 4
    (parameter,), (number,) = panel.parameters, panel.numbers
    assert (parameter.name, parameter.change, parameter.share) == ("crank", "2e-13 m", "2e-11 %")
    assert number.by == "pin.x, sweep, MuJoCo"
    assert panel.refused == ("range of rocker: beyond it",)
    assert (
        "No number of fourbar.xml was tried: too slow."
        in noticed_panel(fourbar, replace(found, left_out="too slow")).not_tried
    )


def test_a_page_shows_stored_coverage_and_searches_for_none(
    fourbar: Case, result: Result, page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert re.search(r"<code>proofmass explain \S*fourbar\.toml</code> finds the numbers of", page)
    assert "numbers of the model of which no run notices a change" in page
    assert "Noticed from this change on" not in page
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path / "found"))
    key = coverage_key(fourbar)
    StoredFindings(1, coverage=replace(example_coverage(fourbar), key=key)).write(
        coverage_file(fourbar, key, None)
    )
    assert load_noticed_panel(fourbar)
    monkeypatch.setattr(  # a worker process may have another folder of stored findings
        "proofmass.report.case_page.evaluate_in_worker",
        lambda case, beyond, function, otherwise: function(case),
    )
    with without_figures():
        index = write_report(result, tmp_path / "pages")
    page = index.with_name("fourbar.html").read_text(encoding="utf-8")
    panel = page[page.index('id="not-checked"') : page.index('id="player"')]
    assert "inertia of crank: all runs that are checked are at rest" in panel
    assert "finds the numbers" not in panel
    assert "Noticed from this change on" in page
    coverage_file(fourbar, key, None).write_text("{", encoding="utf-8")
    assert load_noticed_panel(fourbar) is None  # `proofmass explain` reports the damaged file


def make_explanation(words: str, explains: tuple[str, ...], left: float = 1e-15) -> Explanation:
    """A longer rocker as the cause of the differences of the channels `explains`."""
    changes = {"rocker": (2.5, 2.525)}
    return Explanation("parameter", words, explains, ("pin.y",), left, 3, 1, changes, ("a twin",))


def make_diagnosis(run: str, solver: str, *found: Explanation, **more: Any) -> Diagnosis:
    """A diagnosis of three channels that differ in the four-bar, with these causes."""
    fields = {"differing": ("a", "b", "c"), "tried": ("sign", "unit"), **more}
    return Diagnosis("fourbar", run, solver, causes=found, **fields)


def test_causes_are_first_on_the_page(fourbar: Case, result: Result, tmp_path: Path) -> None:
    best, other = (
        make_explanation("rocker is longer", ("a", "b")),
        make_explanation("crank is", (), 0.5),
    )
    found = {
        ("fourbar", run, "mujoco"): make_diagnosis(run, "mujoco", best, other, remarks=("line 33",))
        for run in ("sweep", "dynamics")
    }
    found["fourbar", "sweep", "pymunk"] = make_diagnosis("sweep", "pymunk", remarks=("no less",))
    panel, none = cause_panels(fourbar, found)
    assert panel.title == (
        "Most likely (33 % explained): rocker is longer; with that changed 4 of 6 curves of 2 runs "
        "agree, but 2 that agreed would differ"
    )
    assert panel.lines == (
        "with it 1e-15 of the error is left; not c",
        "as good: a twin",
        "line 33",
    )
    assert [row.words for row in panel.rows] == ["rocker is longer", "crank is", "nothing changed"]
    assert panel.rows[0].explains == "2 of 3, 1 wrong"
    places = [row.place for row in panel.rows]
    assert places == sorted(places)  # each leaves less error than no change does
    assert panel.where == (
        "The same in 2 runs: MuJoCo in the sweep (2 of 3 curves) and "
        "MuJoCo in dynamics (2 of 3 curves)."
    )
    assert (none.title, none.lines) == ("Cause: none of those that were tried", ("no less",))
    assert none.rows == ()
    assert cause_panels(fourbar.model_copy(update={"file": Path("other.toml")}), found) == []
    with without_figures():
        page = write_report(replace(result, diagnoses=found), tmp_path).with_name("fourbar.html")
    text = page.read_text(encoding="utf-8")
    assert text.index("Most likely (33 % explained): rocker is longer") < text.index("Not checked")
    assert "Tried: sign and unit." in text


def test_what_to_do_is_the_remedy_of_the_cause(fourbar: Case, result: Result) -> None:
    """The general advice is for runs without a known cause only."""
    rows = [
        replace(c, outcome=Outcome.DIFFERS)
        for c in result.comparisons
        if c.case == fourbar.name and c.solver == "mujoco" and c.outcome == Outcome.AGREES
    ]
    line = '<site name="rocker_end" pos="2.5 0 0"/>'
    fault = Fault(fourbar.model_path, 33, "rocker_end x", "m", 2.525, 2.5, instead=line)
    cause = Explanation("number of the model", "w", ("a",), (), 0.0, 1, faults=(fault,))
    found = {
        ("fourbar", run, "mujoco"): Diagnosis("fourbar", run, "mujoco", ("a",), causes=(cause,))
        for run in ("sweep", "dynamics")
    }
    assert advice(fourbar, rows, [], "bad", [*found.values()]) == []  # the panel has the line
    (told,) = advice(fourbar, rows, [], "bad", [found["fourbar", "sweep", "mujoco"]])
    assert told.startswith("Halve the time step")
    (panel,) = cause_panels(fourbar, found)
    assert panel.title == (
        "fourbar.xml, line 33: rocker_end x is 2.525 m; with 2.5 m both curves of 2 runs agree"
    )
    assert panel.faults == (fault,)
    assert not any(line in words for words in panel.lines)
    failed = Diagnosis("fourbar", "dynamics", "mujoco", failed=True, remedies=("Step 1 ms.",))
    first = found["fourbar", "sweep", "mujoco"]
    assert advice(fourbar, rows, [], "bad", [first, failed]) == ["Step 1 ms."]


def test_a_failed_search_for_causes_is_reported(fourbar: Case) -> None:
    found = {("fourbar", "sweep", "mujoco"): make_diagnosis("sweep", "mujoco", fault="no answer")}
    (panel,) = cause_panels(fourbar, found)
    assert (panel.title, panel.lines) == ("Why it differs was not found out", ("no answer",))


@pytest.mark.parametrize("alone", [False, True])
def test_data_of_a_failed_run_end_at_its_failure(
    fourbar: Case, result: Result, alone: bool
) -> None:
    solvers = fourbar.run["dynamics"].solvers if alone else ["mujoco"]
    run = plotted_run(with_failed_dynamics(fourbar, result, *solvers), fourbar, "dynamics")
    assert set(run.failed) == set(solvers)
    assert (run.whole is not None) == alone  # otherwise another solver reached the end
    data = recorded_data(fourbar, [run])["runs"]["dynamics"]
    exact = result.curves[fourbar.name, "dynamics", "mujoco"]
    assert np.array_equal(decode_numbers(data["x"], "<f8"), exact.x)
    own = data["solvers"]["mujoco"]
    assert len(decode_numbers(own["differences"]["pin.x"], "<f4")) == 100
    assert (own["early"], own["end"]) == (True, exact.x[99])
    expected = evaluate(fourbar, "sweep", exact.x, exact.drive).channels["pin.x"]
    assert np.array_equal(decode_numbers(data["channels"]["pin.x"]["curve"], "<f8"), expected)
    assert set(run.without_failed.curves) == set(fourbar.run["dynamics"].solvers) - set(solvers)


def test_a_failed_run_without_a_reference_is_not_drawn(
    fourbar: Case, result: Result, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise InputError(fourbar.file, "", "cannot be assembled there")

    failed = with_failed_dynamics(fourbar, result, *fourbar.run["dynamics"].solvers)
    monkeypatch.setattr("proofmass.report.data.reference_for", fail)
    run = plotted_run(failed, fourbar, "dynamics")
    assert (run.curves, run.reference, len(run.failed)) == ({}, {}, 4)


def test_equal_remarks_on_several_runs_are_shown_once(
    fourbar: Case, result: Result, tmp_path: Path
) -> None:
    found = with_failed_dynamics(fourbar, result, "mujoco", "pymunk")
    (panel,) = cause_panels(fourbar, found.diagnoses)
    assert (panel.title, panel.rows) == ("What happened", ())
    assert panel.where == "The same in 2 runs: MuJoCo in dynamics and pymunk in dynamics."
    with without_figures():
        page = write_report(found, tmp_path).with_name("fourbar.html").read_text(encoding="utf-8")
    first = page[page.index("What happened") : page.index("Not checked")]
    assert "Pin.x left the tolerance first." in first or "pin.x left the tolerance first." in first
    assert re.search(r"MuJoCo is drawn until 1\.7\d* s: diverged", page)


def test_colours_are_legible_on_both_backgrounds() -> None:
    for look in solver_looks(
        ["mujoco", "pymunk", "mujoco:default", "pymunk:default", "x"]
    ).values():
        for paper in BACKGROUNDS.values():
            assert contrast(make_legible(look.colour, paper), paper) >= TEXT_CONTRAST
    assert contrast("#E69F00", "#ffffff") < 3  # this is why colours are changed


def test_scripts_and_styles_are_written_with_the_pages(result: Result, tmp_path: Path) -> None:
    write_report(replace(result, cases=[], comparisons=[], curves={}), tmp_path)
    names = {file.name for file in (tmp_path / "static").iterdir()}
    assert {"uPlot.js", "uPlot.css", "case.js", "case.css", "common.js", "common.css"} <= names
    assert "uPlot" in (tmp_path / "static" / "uPlot.js").read_text(encoding="utf-8")


def test_the_first_table_marks_an_undecided_curve_as_a_failure():
    """The cell shows the undecided curve, which has the larger error, and marks it as a failure."""
    fields = {"share": 1e-3, "later": None, "allowed_share": 1e-2, "ratio": 0.1, "at": 0.5}
    own = {
        "far": {**fields, "outcome": "undecided"},
        "near": {**fields, "share": 1e-4, "outcome": "agrees"},
    }
    channels = {name: {"kind": "position"} for name in own}
    run = {"solvers": {"recorded:rig": {"comparisons": own}}, "failed": {}, "channels": channels}
    (part,) = overview_table({"solvers": ["recorded:rig"], "runs": {"dynamics": run}})
    (row,) = part.rows
    (cell,) = row.cells
    assert (cell.text, cell.note, cell.bad) == ("1e-3", "undecided", True)
