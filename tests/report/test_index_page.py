"""The HTML of the index: its rows, their order, its cells, drawings and links to files."""

import json
import math
import re
from dataclasses import replace
from html import unescape
from pathlib import Path

import numpy as np
import pytest
from markupsafe import Markup

from proofmass.base.errors import InputError
from proofmass.batch.check import Result
from proofmass.evidence.diagnosis import Diagnosis, Explanation, Fault
from proofmass.report import index_page, pages
from proofmass.report.case_figures import find_motions as moved
from proofmass.report.data import PlottedRun
from proofmass.report.glance import glance_of
from proofmass.report.index_page import case_row, columns_of, headline_of, index_cell
from proofmass.report.pages import file_links, note_on_files, run_table, write_curves
from proofmass.report.record import History, extend_history
from proofmass.report.study import ShownStudy
from proofmass.report.thumbnail import (
    MAX_BYTES,
    MAX_OUTLINE_POINTS,
    MAX_POSES,
    MIN_POSES,
    THUMBNAIL_HEIGHT,
    THUMBNAIL_WIDTH,
    reduce_picture,
    thin_outline,
)
from proofmass.run.sidecar import load_case
from proofmass.sim.protocol.curves import Curves
from proofmass.verdict.outcome import Outcome
from tests.report.index_rows import (
    CASE_NAMES,
    MADE,
    comparison_of,
    failed_comparison,
    index_files,
    index_text,
    last_record,
    make_record,
    result_for_index,
    small_thumbnail,
)
from tests.report.many_rows import result_of_many
from tests.shipped import MODELS, shipped


@pytest.fixture(scope="module")
def page() -> str:
    result = result_for_index()
    return index_text(result, last_record(result))


def rows_of(page: str) -> dict[str, str]:
    """The rows of the table by the names of their cases."""
    found = re.findall(r'(?s)<tr data-name="([^"]+)".*?</tr>', page)
    parts = re.split(r'<tr (?=data-name=")', page)[1:]
    return dict(zip(found, parts, strict=True))


SHARED_FACTS = ("title", "symbol", "word", "state", "family", "search", "engines", "failing")


def facts_of(page: str) -> dict[str, dict[str, object]]:
    """The facts by which the script filters and sorts the rows, by the names of their cases."""
    found = json.loads(re.search(r'(?s)id="facts">(.*?)</script>', page)[1])
    rows, facts = found["rows"], {}
    for k, name in enumerate(rows["name"]):
        facts[name] = {key: rows[key][k] for key in rows if key not in ("name", "values")}
        facts[name] |= {key: found["shared"][facts[name][key]] for key in SHARED_FACTS}
        facts[name]["values"] = {key: values[k] for key, values in rows["values"].items()}
    return facts


def data_attribute(row: str, name: str) -> str:
    """The value of an attribute ``data-…`` of a row."""
    return unescape(re.search(rf'data-{name}="([^"]*)"', row)[1])


def test_rows_are_ordered_by_failure_then_change_then_margin(page):
    # slider_crank fails, fourbar differs by 30 times its tolerance, pendulum is worse than before,
    # and the others use 0.5 and 1e-6 of a tolerance
    order = ["slider_crank", "fourbar", "pendulum", "rod_cantilever", "hacksaw_recorded"]
    assert list(rows_of(page)) == order
    states = [data_attribute(row, "state") for row in rows_of(page).values()]
    assert states == ["bad", "bad", "good", "good", "good"]


def test_the_counts_above_the_table_match_its_rows(page):
    numbers = dict(
        re.findall(r'data-outcome="(\w+)" disabled>(.*?)</button>', page.replace("\n", " "))
    )
    words = {key: re.sub(r"<[^>]*>|\s+", " ", text).split() for key, text in numbers.items()}
    assert words["agree"][:3] == ["3", "of", "5"]
    assert words["differ"][0] == "2"
    # two channels are not checked: the rate of adams, and the run that fails; channels of default
    # settings do not count
    assert words["gaps"][:3] == ["2", "of", "12"]
    # pendulum is worse, hacksaw_recorded is better, and a case is missing
    assert words["changed"][0] == "3"
    assert "Not in this one: gone_by_now." in page


def test_cases_that_their_sidecars_leave_unchecked_are_counted():
    result = result_for_index()
    assert "not checked<span" in index_text(result)  # the curves
    assert "cases agree<span" in index_text(result)
    open_case = "rod_cantilever"
    result = replace(
        result,
        cases=[c.model_copy(update={"unchecked": c.name == open_case}) for c in result.cases],
        comparisons=[
            replace(c, outcome=Outcome.UNCHECKED) if c.case == open_case else c
            for c in result.comparisons
        ],
    )
    assert "cases agree, 1 not checked<span" in index_text(result)


def test_without_a_last_report_there_are_no_changes():
    page = index_text(result_for_index())
    assert "no last report to compare with" in page
    assert 'data-sort="change"' not in page


def test_a_cell_shows_worst_error_and_tolerance_and_hollow_other_settings():
    result = result_for_index()
    cell = index_cell([c for c in result.comparisons if c.case == "pendulum" and "muj" in c.solver])
    assert (cell.error, cell.kind, cell.bad) == ("9e-7", "position", False)
    assert cell.sort == pytest.approx(0.9)
    first, other = cell.lanes
    assert (first.solver, first.hollow, first.over) == ("mujoco", False, False)
    assert first.width == pytest.approx(0.9 * 75)
    assert (other.solver, other.hollow, other.width) == ("mujoco:default", True, 100.0)
    assert cell.words == (
        "MuJoCo: angle 9e-7 of the range, 0.9 of what is allowed; "
        "MuJoCo default: rate 1 % of the range, 10000 of what is allowed as in the model"
    )


def test_a_cell_shows_a_channel_that_differs_before_a_larger_error():
    cell = index_cell(
        [c for c in result_for_index().comparisons if (c.case, c.run) == ("fourbar", "sweep")]
    )
    assert (cell.error, cell.bad) == ("0.03", True)
    assert cell.lanes[0].words.startswith("MuJoCo: pin.y 3 % of the range, 30 of what is allowed")
    assert cell.lanes[0].over


def test_a_cell_of_a_failed_run_has_a_word_and_no_bar(page):
    cell = index_cell([c for c in result_for_index().comparisons if c.outcome == Outcome.DIVERGED])
    assert (cell.error, cell.bad, cell.sort) == ("diverged", True, math.inf)
    assert (cell.lanes[0].width, cell.lanes[0].words) == (None, "pymunk: diverged")
    row = rows_of(page)["slider_crank"]
    assert "pymunk, dynamics: diverged: why not." in row
    assert '<b class="bad">diverged</b> <span></span>' in row  # no kind of quantity
    assert '<span class="unseen">diverged</span>' in row


def cells_of(row: str) -> dict[str, tuple[str, bool]]:
    """The error of each cell of a row, and whether it is marked as a failure, by the heading."""
    found = re.findall(r'(?s)data-label="([^"]+)">.*?<b( class="bad")?>([^<]+)</b>', row)
    return {heading: (error, bool(bad)) for heading, bad, error in found}


def test_a_cell_has_the_error_of_the_runs_and_the_engine_of_its_heading():
    errors = {
        ("sweep", "mujoco"): 1e-9,
        ("dynamics", "mujoco"): 2e-5,
        ("sweep", "pymunk"): 3e-7,
        ("dynamics", "pymunk"): 4e-3,
    }
    rows = [
        comparison_of("fourbar", run, engine, "pin.x", error, allowed=1e-3)
        for (run, engine), error in errors.items()
    ]
    rows[-1] = replace(rows[-1], outcome=Outcome.DIFFERS)
    fourbar = load_case(shipped("fourbar.toml"))
    page = index_text(Result([fourbar], rows, paths=(MODELS,)))
    assert cells_of(rows_of(page)["fourbar"]) == {
        "Quasi-static · MuJoCo": ("1e-9", False),
        "Quasi-static · pymunk": ("3e-7", False),
        "Dynamics · MuJoCo": ("2e-5", False),
        "Dynamics · pymunk": ("4e-3", True),
    }
    rows = [replace(rows[0], error_max=2 * 0.012345)]
    page = index_text(Result([fourbar], rows, paths=(MODELS,)))
    assert cells_of(rows_of(page)["fourbar"])["Quasi-static · MuJoCo"][0] == "0.012"


def test_a_bar_is_as_wide_as_its_error_over_what_is_allowed():
    """It is linear up to its end, a third beyond what is allowed; there it has an arrow."""
    ratios = (0.0, 0.1, 0.41, 1.0, 1.2, 40.0)
    rows = [
        comparison_of(
            "pendulum",
            "dynamics",
            f"mujoco:{k}",
            "angle",
            ratio * 1e-3,
            1e-3,
            Outcome.AGREES if ratio <= 1 else Outcome.DIFFERS,
        )
        for k, ratio in enumerate(ratios)
    ]
    page = index_text(Result([load_case(shipped("pendulum.toml"))], rows, paths=(MODELS,)))
    bars = re.findall(
        r'<g class="([^"]*)"><rect class="room"[^>]*/>.*?width="([^"]+)%".*?</g>', page
    )
    assert [float(width) for _, width in bars] == [0.0, 7.5, 30.75, 75.0, 90.0, 100.0]
    assert ["over" in css for css, _ in bars] == [ratio > 1 for ratio in ratios]
    assert page.count('class="beyond"') == 1


def test_one_wrong_value_of_two_cases_is_the_headline():
    rows = [
        comparison_of("fourbar", "sweep", "mujoco", "pin.x", 1e-2, outcome=Outcome.DIFFERS),
        comparison_of("pendulum", "dynamics", "mujoco", "angle", 1e-2, outcome=Outcome.DIFFERS),
    ]
    fault = Fault(
        Path("shared.xml"),
        33,
        "rocker x",
        "m",
        2.525,
        2.5,
        instead='<site pos="2.5"/>',
        written='<site pos="2.525"/>',
    )
    cause = Explanation("number of the model", "w", ("x",), (), 1e-9, 1, faults=(fault,))
    found = {
        (c.case, c.run, c.solver): Diagnosis(c.case, c.run, c.solver, ("x",), 1, (cause,))
        for c in rows
    }
    cases = [load_case(shipped(f"{c.case}.toml")) for c in rows]
    result = Result(cases, rows, diagnoses=found, paths=(MODELS,))
    page = index_text(result)
    assert "<h1>One wrong value fails 2 of 2 cases</h1>" in page
    sentence = "shared.xml, line 33: rocker x is 2.525 m; with 2.5 m both curves of 2 runs"
    assert page.count(sentence) == 1
    assert 'data-copy="&lt;site pos=&#34;2.5&#34;/&gt;"' in page
    for name in ("fourbar", "pendulum"):
        assert "1 of 1 curves differ: shared.xml, line 33." in rows_of(page)[name]
    other = index_text(replace(result, diagnoses={}))
    assert "<h1>2 of 2 cases differ or failed</h1>" in other


@pytest.mark.parametrize(
    ("states", "words"),
    [
        (["good", "good"], "All 2 cases agree"),
        (["good"], "1 case agrees"),
        (["good", "open"], "1 of 2 cases agree, 1 is not checked"),
        (["good", "bad"], "1 of 2 cases differs or failed"),
    ],
)
def test_the_headline_counts_the_cases(states, words):
    row = case_row(
        load_case(shipped("pendulum.toml")), result_for_index(), [], [], None, History(), {}
    )
    assert headline_of([replace(row, state=state) for state in states], []) == words


def test_engines_at_a_glance_have_median_worst_time_and_refusals():
    rows = [
        *(
            comparison_of("a", "dynamics", "mujoco", f"x{k}", share)
            for k, share in enumerate((1e-9, 2e-8, 4e-2))
        ),
        comparison_of("a", "dynamics", "mujoco:default", "x0", 3e-1, None, Outcome.UNCHECKED),
        comparison_of("b", "dynamics", "mujoco:fine", "x0", 1e-4),
        replace(comparison_of("b", "sweep", "mujoco", "x0", 1e-14), seconds=2.0),
        failed_comparison("a", "dynamics", "pymunk", "x0", Outcome.UNSUPPORTED),
        comparison_of("b", "dynamics", "pymunk", "x0", 1e-5),
        failed_comparison("b", "sweep", "pymunk", "x0", Outcome.DIVERGED),
        comparison_of("a", "dynamics", "recorded:rig", "x0", 1e-5),
    ]
    found = glance_of({"one": ("one/", ["a"]), "two": ("two/", ["b"]), "none": ("", ["c"])}, rows)
    assert [(c.group, c.engine, c.defaults) for c in found.columns] == [
        ("quasi-static", "mujoco", False),  # pymunk has no curve there: no column
        ("dynamics", "mujoco", False),
        ("dynamics", "mujoco", True),
        ("dynamics", "pymunk", False),
    ]
    one, two = found.rows
    assert one.cells[0] is None
    assert (one.cells[1].median, one.cells[1].worst) == (2e-8, 4e-2)
    assert (one.cells[1].close, one.cells[2].close) == (True, False)
    assert (one.cells[3].cases, one.cells[3].refused) == (0, 1)
    assert (two.cells[0].seconds, two.cells[0].median) == (2.0, 1e-14)
    assert two.cells[1].median == 1e-4  # a variant, where the model has no settings of its own


def test_a_row_and_its_facts_say_the_same(page):
    """A row that is not drawn yet has a short form, which the script makes of the facts."""
    rows, facts = rows_of(page), facts_of(page)
    assert rows.keys() == facts.keys() == set(CASE_NAMES)
    for name, row in rows.items():
        own = facts[name]
        assert f'<a href="{own["page"]}">{name}</a>' in row
        assert f"<p>{own['title']}</p>" in unescape(row)
        assert f'<span aria-hidden="true">{own["symbol"]}</span>' in row
        assert f'<span class="unseen">{own["word"]}</span>' in row
        assert f"{own['checked']} of {own['channels']}<i>" in row
        assert f'<td class="cost right">{own["seconds"]:g} s</td>' in row
        assert data_attribute(row, "state") == own["state"]
        assert re.search(r'(?s)<td class="picture">\s*<svg', row)
    words = [own["word"] for own in facts.values()]
    assert words == ["diverged", "differs", "agrees", "agrees", "agrees"]
    assert [own["symbol"] for own in facts.values()] == ["⚠", "✗", "✓", "✓", "✓"]


def test_the_facts_of_a_row_are_what_the_filters_look_for(page):
    facts = facts_of(page)
    engines = {name: own["engines"].split() for name, own in facts.items()}
    assert engines["pendulum"] == ["mujoco", "adams"]
    assert engines["slider_crank"] == ["mujoco", "pymunk"]
    failing = {name: own["failing"] for name, own in facts.items() if own["failing"]}
    assert failing == {"slider_crank": "pymunk", "fourbar": "mujoco"}
    words = facts["fourbar"]["search"].split()
    assert {"linkages", "fourbar", "pin.x", "rocker"} <= set(words)
    changes = {name: (own["changes"], own["worse"]) for name, own in facts.items()}
    assert changes["pendulum"] == (1, 1)
    assert changes["hacksaw_recorded"] == (1, 0)
    assert changes["fourbar"] == (0, 0)


def test_the_cost_above_the_table_is_the_sum_of_those_of_the_rows(page):
    """Each run of a solver takes 0.5 s in these results; an engine that failed states no time."""
    costs = {name: own["seconds"] for name, own in facts_of(page).items()}
    assert costs["fourbar"] == costs["rod_cantilever"] == 1.0  # two runs
    assert costs["hacksaw_recorded"] == 0.5
    told = re.search(r"processor time (MuJoCo [^<]*)", page)[1].partition(" processors")[0]
    parts = re.findall(r"(\S+) s\b", told)
    assert len(parts) == 2
    assert sum(map(float, parts)) == sum(costs.values())


def test_a_column_is_sorted_by_the_largest_error_and_failures_are_beyond_all_numbers(page):
    values = {name: own["values"] for name, own in facts_of(page).items()}
    assert values["fourbar"]["quasi-static/mujoco"] == 30.0  # over what is allowed
    assert values["pendulum"]["quasi-static/mujoco"] is None  # it has no such run
    assert values["slider_crank"]["dynamics/pymunk"] > 1e300
    assert math.isfinite(values["slider_crank"]["dynamics/pymunk"])  # JSON has no infinity


def test_a_channel_with_a_number_represents_an_engine_that_has_none_of_another(page):
    assert cells_of(rows_of(page)["pendulum"])["Dynamics · adams"] == ("1e-9", False)


def test_many_errors_of_inputs_are_folded():
    def page_with(count: int) -> str:
        errors = [InputError(Path(f"/home/me/c{k}.toml"), "n", "too few") for k in range(count)]
        return index_text(Result(errors=errors))

    many = page_with(12)
    assert "12 inputs at fault" in many
    assert many.index("c9.toml") < many.index("<summary>2 more</summary>") < many.index("c10.toml")
    assert "more</summary>" not in page_with(10)


def test_files_of_rows_continue_the_page_with_the_rows_and_their_drawings():
    files = index_files(result_of_many(85))
    first = list(rows_of(files.page))
    assert len(first) == 40
    names = list(facts_of(files.page))
    for number, text in enumerate(files.row_files, 1):
        mark, call = text.splitlines()
        assert mark.startswith("// ")
        found, rows, poses = json.loads(re.fullmatch(r"takeRows\(\.\.\.(.*)\);", call)[1])
        assert found == number
        there = [name for row in rows for name in rows_of(row)]
        assert there == names[40 * number : 40 * (number + 1)]
        assert 'class="fill"' in rows[0]
        assert poses == [small_thumbnail().data] * len(there)
    assert [len(json.loads(f.partition("...")[2][:-3])[1]) for f in files.row_files] == [40, 5]


def test_an_unknown_engine_has_its_own_column_and_marker(page):
    columns = columns_of(result_for_index())
    assert [(c.run, c.engine) for c in columns] == [
        ("quasi-static", "mujoco"),
        ("dynamics", "mujoco"),
        ("dynamics", "adams"),
        ("dynamics", "pymunk"),
    ]
    assert "Dynamics · adams" in page
    assert 'data-engine="adams"' in page
    names = re.findall(r'<button type="button" data-engine="[^"]+"[^>]*>([^<]*)</button>', page)
    assert names == ["MuJoCo", "adams", "pymunk"]
    shapes = re.findall(r'<svg class="dot" viewBox[^>]*><path d="([^"]+)"', page)
    assert len(set(shapes)) == 3  # so that engines can be distinguished without colour


def test_only_curves_of_runs_are_counted_as_checked(page):
    facts = facts_of(page)
    left = {name: facts[name]["channels"] - facts[name]["checked"] for name in facts}
    assert left["pendulum"] == 1
    assert left["slider_crank"] == 1
    assert left["rod_cantilever"] == 0  # errors of a refinement are not curves
    assert "3 of 4" in rows_of(page)["pendulum"]


def test_channels_of_other_settings_with_a_tolerance_are_counted():
    result = result_for_index()
    case = next(c for c in result.cases if c.name == "pendulum")
    rows = [
        comparison_of("pendulum", "dynamics", "mujoco:fine", "angle", 1e-9),
        comparison_of("pendulum", "dynamics", "mujoco:fine", "rate", 1e-9, None, Outcome.UNCHECKED),
    ]
    whole = Result([case], rows, paths=result.paths)
    row = case_row(case, whole, columns_of(whole), [], None, History(), {})
    assert (row.checked, row.channels) == (1, 2)


def test_a_row_names_its_family_and_its_changes(page):
    rows = rows_of(page)
    facts = facts_of(page)
    assert facts["pendulum"]["family"] == "linkages/pendulum"
    assert facts["hacksaw_recorded"]["family"] == "linkages/recorded curves"
    assert "1 worse" in rows["pendulum"]
    assert "1 better" in rows["hacksaw_recorded"]
    assert "angle: error 1e-9 of the range before, error 9e-7 of the range now" in rows["pendulum"]


def test_families_can_be_selected_and_are_described(page):
    (what,) = re.findall(r'value="linkages/pendulum" title="([^"]+)">pendulum \(1\)<', page)
    assert what.startswith("Simple pendulum")
    assert '<option value="linkages/">All linkages (4)</option>' in page


def test_errors_models_without_sidecar_and_studies_have_sections(page):
    assert "bad.toml: drive.joint: no joint &lt;q&gt;" in page
    assert "/home/me" not in page
    assert "1 input at fault" in page
    assert "no sidecar; it loads and steps" in page
    study = ShownStudy("Cost", "what accuracy costs", "trade/index.html", {})
    other = index_text(result_for_index(), studies=[study])
    assert '<a href="trade/index.html">Cost</a>: what accuracy costs. 0 parts.' in other
    assert "<h2>Studies</h2>" not in page


def test_an_empty_report_says_so():
    page = index_text(Result())
    assert "No case was found." in page
    assert "<table" not in page


def test_sentences_of_a_row_that_differs_are_limited():
    assert index_page.shorten_sentences("abc") == list("abc")
    assert index_page.shorten_sentences("abcd") == [*"ab", "And 2 more runs."]


def test_a_row_that_differs_names_the_channel_that_differs(page):
    row = rows_of(page)["fourbar"]
    assert "MuJoCo, sweep: 1 of 3 differ, pin.y by 30 x." in row
    assert "remark" not in rows_of(page)["pendulum"]


def test_a_trend_is_drawn_of_errors_that_change():
    result = result_for_index()
    history = History()
    for share in (1e-9, 1e-8):
        rows = [comparison_of("pendulum", "dynamics", "mujoco", "angle", share, unit="rad")]
        history = extend_history(history, make_record(Result(comparisons=rows), MADE))
    before = last_record(result)
    rows = rows_of(index_text(result, before, history))
    ((words, points),) = re.findall(
        r'#trend"><svg[^>]* aria-label="([^"]+)"><polyline points="([^"]+)"', rows["pendulum"]
    )
    assert words == "dynamics MuJoCo, angle: 3 reports, 1e-9 to 9e-7 of the range"
    heights = [float(point.split(",")[1]) for point in points.split()]
    assert len(heights) == 3
    assert heights == sorted(heights, reverse=True)  # errors grow upwards
    assert 9 < max(heights) - min(heights) <= max(heights) <= 18  # within the frame, most of it
    assert "polyline" not in rows["hacksaw_recorded"]  # its channel is in one report only
    assert "polyline" not in rows_of(index_text(result, before))["pendulum"]


def test_the_drawing_moves_within_its_frame():
    motions, _ = moved(load_case(shipped("fourbar.toml")), [])
    moving = reduce_picture(motions["sweep"].picture)
    assert moving.points.shape == (MAX_POSES, sum(moving.sizes) + len(moving.joints), 2)
    assert moving.points[..., 0].max() <= THUMBNAIL_WIDTH
    assert moving.points[..., 1].max() <= THUMBNAIL_HEIGHT
    kinds = [(kind, driven, grounded) for kind, driven, grounded in moving.joints]
    assert kinds.count(("hinge", True, True)) == 1  # the joint of the crank
    # a link keeps its length to one unit of the grid at each end, in both directions
    first = moving.points[:, : moving.sizes[0]].astype(float)
    length = np.linalg.norm(first[:, 0] - first[:, 1], axis=1)
    assert np.ptp(length) <= 2 * np.sqrt(2)
    assert np.ptp(first, axis=0).max() > 10  # the crank moves


@pytest.mark.parametrize("name", ["balls_touching", "compliant_wrist"])
def test_a_drawing_with_many_points_has_fewer_poses(name):
    """The data of a drawing are limited, since all drawings are on one page.

    Its outlines have fewer points, and keep their extent to a twentieth of their larger side.
    """
    case = load_case(shipped(f"{name}.toml"))
    motions, _ = moved(case, [])
    picture = next(iter(motions.values())).picture
    outlines = [outline for link in picture.links for outline in link.outlines]
    moving = reduce_picture(picture)
    assert moving.points.nbytes <= max(MAX_BYTES, 2 * MIN_POSES * moving.points.shape[1])
    assert MIN_POSES <= len(moving.points) < MAX_POSES
    assert max(moving.sizes) <= MAX_OUTLINE_POINTS
    for outline in outlines:
        kept = thin_outline(outline)[0]
        for part in (np.min, np.max):
            off = np.abs(part(kept, axis=0) - part(outline[0], axis=0))
            assert (off <= np.ptp(outline[0], axis=0).max() / 20).all()


def test_a_rod_that_begins_straight_is_shown_where_it_is_bent():
    """The drawing shows a pose in which the rod is bent.

    The rod has no joints from which the clearest pose could be chosen.
    """
    motions, _ = moved(load_case(shipped("rod_released.toml")), [])
    moving = reduce_picture(motions["dynamics"].picture)
    begin, shown = moving.points[0].astype(float), moving.points[moving.shown].astype(float)
    assert np.ptp(begin[:, 1]) <= 1
    assert np.ptp(shown[:, 1]) > THUMBNAIL_HEIGHT / 2


def test_the_page_stores_the_points_of_its_drawings(page):
    found = json.loads(re.search(r'(?s)id="poses">(.*?)</script>', page)[1])
    assert set(found) == set(CASE_NAMES)
    shape = small_thumbnail()
    assert found["pendulum"] == shape.data
    raw = np.frombuffer(__import__("base64").b64decode(shape.data["points"]), np.uint8)
    assert np.array_equal(raw.reshape(shape.points.shape), shape.points)
    svg = shape.svg('a"b')
    assert isinstance(svg, Markup)
    assert 'data-name="a&#34;b"' in svg or 'data-name="a&quot;b"' in svg
    assert svg.count('class="link"') == 1
    assert svg.count('class="joint') == 2


def example_run(case_name: str = "fourbar") -> PlottedRun:
    """A run of two solvers; the second one stopped early and has a reference of its own."""
    case = load_case(shipped(f"{case_name}.toml"))
    view = PlottedRun(case, "dynamics", [])
    x = view.grid
    drive = (np.atleast_2d(x), np.ones((1, x.size)), np.zeros((1, x.size)))
    short = 5
    cut = tuple(part[:, :short] for part in drive)
    view.curves["mujoco"] = Curves(x, {"pin.x": np.sin(x) / 3, "rocker": x}, drive=drive)
    view.curves["pymunk"] = Curves(x[:short], {"pin.x": x[:short]}, drive=cut)
    view.reference["mujoco"] = Curves(x, {"pin.x": np.sin(x), "rocker": x})
    view.reference["pymunk"] = Curves(x[:short], {"pin.x": x[:short] + 1e-16})
    return view


def test_curves_are_written_in_si_units_with_all_their_digits(tmp_path: Path):
    view = example_run()
    write_curves(tmp_path, view.case, [view])
    head, *lines = (tmp_path / "data" / "fourbar-dynamics.csv").read_text().splitlines()
    columns = head.split(",")
    assert columns[0] == "time t [s]"
    assert "pin.x mujoco [m]" in columns
    assert "pin.x reference pymunk [m]" in columns
    assert "rocker reference [rad]" in columns  # all solvers that have it share it
    assert "crank drive rate mujoco [rad/s]" in columns
    assert len(lines) == view.grid.size
    row = lines[7].split(",")
    assert float(row[columns.index("pin.x mujoco [m]")]) == np.sin(view.grid[7]) / 3
    assert row[columns.index("pin.x pymunk [m]")] == ""  # pymunk had stopped
    assert "pin.x pymunk [m]" in run_table(view)


def test_links_lead_to_existing_files(tmp_path: Path):
    view = example_run()
    assert file_links(tmp_path, view.case) == []
    write_curves(tmp_path, view.case, [view])
    found = file_links(tmp_path, view.case)
    assert found[0] == ("dynamics (CSV)", "data/fourbar-dynamics.csv")
    assert all((tmp_path / path).is_file() for _, path in found)
    page = index_text(result_for_index(), files={"fourbar": found}, note="")
    assert '<a href="data/fourbar-dynamics.csv">dynamics (CSV)</a>' in rows_of(page)["fourbar"]
    write_curves(tmp_path, view.case, [])  # a later report without curves
    assert file_links(tmp_path, view.case) == []


def test_the_page_says_how_to_get_files_that_are_not_written(monkeypatch):
    monkeypatch.setattr(pages, "find_spec", lambda name: None)
    assert "--data" in note_on_files(data=False)
    assert "proofmass[parquet]" in note_on_files(data=True)
    monkeypatch.setattr(pages, "find_spec", lambda name: name)
    assert note_on_files(data=True) == ""
    assert "a note of that kind" in index_text(result_for_index(), note="a note of that kind")


def test_parquet_has_the_numbers_of_the_csv(tmp_path: Path):
    parquet = pytest.importorskip("pyarrow.parquet", reason="needs proofmass[parquet]")
    view = example_run()
    write_curves(tmp_path, view.case, [view])
    table = parquet.read_table(tmp_path / "data" / "fourbar.parquet")
    assert set(table["run"].to_pylist()) == {"dynamics"}
    for name, values in run_table(view).items():
        assert np.array_equal(table[name].to_numpy(), values, equal_nan=True)
    assert ("Parquet", "data/fourbar.parquet") in file_links(tmp_path, view.case)
