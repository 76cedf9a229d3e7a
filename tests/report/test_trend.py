"""The trend of a case: known errors over several reports, damage, and the chart in a browser."""

import json
import re
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from proofmass.batch.check import Result
from proofmass.case.case import Case
from proofmass.report import write_report
from proofmass.report.record import (
    History,
    Record,
    extend_history,
    make_record,
    read_last,
    record_start,
    write_record,
)
from proofmass.report.trend import Trend, format_growth, trend_of
from proofmass.run.sidecar import load_case
from proofmass.verdict.comparison import Comparison
from tests.report.index_rows import comparison_of
from tests.report.whole import result_from_references, without_figures
from tests.shipped import shipped
from tests.visit import PHONE, Visit

MADE = record_start(["proofmass", "report"])
# Errors now, as a share of the range; 1e-12 is allowed in a sweep, 1e-6 in dynamics in MuJoCo.
ERROR_SHARE = 1e-7


@pytest.fixture(scope="module")
def fourbar() -> Case:
    return load_case(shipped("fourbar.toml"))


def past_record(record: Record, k: int, shares: Callable[[Any], float | None]) -> Record:
    """The record of a report on day `k`, with other errors.

    Reports from the third on were made with another version of MuJoCo.
    """
    versions = {**MADE.versions, "mujoco": "1.0" if k < 3 else "2.0"}
    made = MADE.model_copy(
        update={
            "date": f"2026-01-{k:02d}T08:00:00+00:00",
            "commit": f"{k:07d}aaaa",
            "versions": versions,
        }
    )
    rows = [c.model_copy(update={"share_of_range": shares(c)}) for c in record.comparisons]
    return record.model_copy(update={"made": made, "comparisons": rows})


def history_of(result: Result, *shares: Callable[[Any], float | None]) -> History:
    """A history with a report for each function in `shares`, which gives its errors."""
    history, now = History(), make_record(result, MADE)
    for k, each in enumerate(shares, 1):
        history = extend_history(history, past_record(now, k, each))
    return history


def trend_now(result: Result, *shares: Callable[[Any], float | None]) -> Trend:
    """The trend of the four-bar, whose last report is that of the result."""
    (case,) = result.cases
    now = make_record(result, MADE)
    return trend_of(extend_history(history_of(result, *shares), now), case, result.comparisons)


def result_with(*comparisons: Comparison) -> Result:
    """A result of the four-bar with these comparisons."""
    return Result(cases=[load_case(shipped("fourbar.toml"))], comparisons=list(comparisons))


AGREEING_ROW = comparison_of("fourbar", "dynamics", "mujoco", "pin.x", 1e-8)
DIFFERING_ROW = comparison_of("fourbar", "sweep", "mujoco", "pin.x", 1e-9, 1e-10, "differs")


def test_a_trend_begins_with_the_second_report() -> None:
    first = trend_now(result_with(AGREEING_ROW))
    assert (first.data, first.rows, first.count) == ({}, [], 1)
    second = trend_now(result_with(AGREEING_ROW), lambda c: 1e-9)
    assert [row.channel for row in second.rows] == ["pin.x"]
    assert second.count == 2
    # a new channel has one error only
    new = trend_now(result_with(AGREEING_ROW), lambda c: None)
    assert (new.rows, new.count) == ([], 2)


def test_rows_are_worst_first_and_say_how_errors_changed() -> None:
    found = trend_now(
        result_with(AGREEING_ROW, DIFFERING_ROW), lambda c: 4e-7, lambda c: None, lambda c: 1e-9
    )
    assert [(row.run, row.channel, row.solver) for row in found.rows] == [
        ("sweep", "pin.x", "MuJoCo"),  # 10 times its tolerance
        ("dynamics", "pin.x", "MuJoCo"),  # a hundredth of its tolerance
    ]
    row = found.rows[1]
    assert (row.first, row.before, row.now, row.largest) == ("4e-7", "1e-9", "1e-8", "4e-7")
    assert (row.allowed, row.growth) == ("1e-6", "× 10")
    assert found.rows[0].growth == ""
    reports = found.data["reports"]
    assert [one["commit"] for one in reports[:3]] == ["0000001", "0000002", "0000003"]
    assert [one["made"] for one in reports] == [0, 0, 1, 2]
    assert found.data["versions"][1]["mujoco"] == "2.0"


@pytest.mark.parametrize(
    ("last", "now", "words"),
    [
        (1e-6, 2.1e-6, "× 2.1"),
        (1e-6, 1.9e-6, ""),
        (1e-6, 4e-7, "÷ 2.5"),
        (0.0, 1e-6, "from 0"),
        (1e-6, 0.0, "to 0"),
        (1e-15, 9e-13, ""),  # rounding
        (None, 1.0, ""),
    ],
)
def test_the_growth_of_an_error_is_formatted_as_a_factor(
    last: float | None, now: float, words: str
) -> None:
    assert format_growth(last, now) == words


def damaged_history(folder: Path, change: Callable[[dict[str, Any]], object]) -> History:
    """Read the history of a record of three reports after its file was damaged by `change`.

    The damage must be reported in one line.
    """
    result = result_with(AGREEING_ROW, DIFFERING_ROW)
    write_record(
        folder,
        make_record(result, MADE),
        history_of(result, lambda c: 1e-9, lambda c: 2e-9, lambda c: 3e-9),
    )
    file = folder / "results.json"
    text = json.loads(file.read_text())
    text["history"] = change(text["history"]) or text["history"]
    file.write_text(json.dumps(text))
    last = read_last(folder)
    assert last.record is not None
    assert last.wrong.startswith(f"the history in {file} is damaged; left out: ")
    assert "\n" not in last.wrong
    assert last.wrong.endswith(last.record.history.damage)
    return last.record.history


CHANNEL_KEY = "fourbar/dynamics/mujoco/pin.x"


@pytest.mark.parametrize(
    ("change", "words", "left"),
    [
        (lambda h: h["reports"][1].pop("date"), "report 2 of 3 (date: Field", [1e-9, 3e-9]),
        (
            lambda h: h["reports"][0].update(date="yesterday"),
            "report 1 of 3 (date: Value error",
            [2e-9, 3e-9],
        ),
        (lambda h: h["reports"].__setitem__(2, 7), "report 3 of 3 (Input", [1e-9, 2e-9]),
        (lambda h: h["errors"][CHANNEL_KEY].append(1.0), "1 row of another length", None),
        (lambda h: h["errors"].update({CHANNEL_KEY: "x"}), "1 row of another length", None),
        (
            lambda h: h["errors"].update({CHANNEL_KEY: ["1e-9", -1.0, 3e-9]}),
            "2 errors that are no number",
            [None, None, 3e-9],
        ),
        (lambda h: h.update(errors=[]), "all of it, whose reports", None),
        (lambda h: "x", "all of it, which is no table", None),
    ],
)
def test_only_the_damaged_part_of_a_history_is_left_out(
    change: Callable[[dict[str, Any]], object],
    words: str,
    left: list[float | None] | None,
    tmp_path: Path,
) -> None:
    def replacement(history: dict[str, Any]) -> object:
        found = change(history)
        return found if found == "x" else None

    history = damaged_history(tmp_path, replacement)
    assert history.damage.startswith(words)
    assert history.errors.get(CHANNEL_KEY) == left
    if not words.startswith("all"):
        whole = history.errors["fourbar/sweep/mujoco/pin.x"]
        assert len(whole) == len(history.reports) >= 2
        assert None not in whole


def test_damage_of_a_history_is_not_written_again(tmp_path: Path) -> None:
    history = damaged_history(tmp_path, lambda h: h["errors"][CHANNEL_KEY].append(1.0) and None)
    write_record(tmp_path, make_record(result_with(AGREEING_ROW), MADE), history)
    assert read_last(tmp_path).wrong == ""
    assert "damage" not in (tmp_path / "results.json").read_text()


# ------------------------------------------------------------------ the page


def known_error(c: Any, k: int) -> float | None:
    """The error of a channel in report `k`, from 1 to 4.

    The error of one curve grows tenfold from report to report, from 1e-10 on.  The errors of the
    rocker include a zero and a missing one.
    """
    if (c.run, c.solver, c.channel) == ("dynamics", "mujoco", "pin.x"):
        return 10.0 ** (k - 11)
    if c.run == "dynamics" and c.channel == "rocker":
        return [1e-8, 0.0, None, 1e-8][k - 1]
    return ERROR_SHARE


@pytest.fixture(scope="module")
def folder(fourbar: Case, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a report that was written after four others."""
    out = tmp_path_factory.mktemp("trend")
    result = result_from_references(fourbar, off=ERROR_SHARE)
    errors_by_report = [lambda c, k=k: known_error(c, k) for k in (1, 2, 3, 4)]
    write_record(out, make_record(result, MADE), history_of(result, *errors_by_report))
    with without_figures():
        write_report(result, out)
    return out


class TrendVisit(Visit):
    """The page of the four-bar, opened at the trend of a channel in dynamics."""

    def __init__(self, browser: Any, folder: Path, channel: str = "pin.x", **options: Any) -> None:
        options = {"reduced_motion": "reduce", **options}
        super().__init__(browser, folder / "fourbar.html", "#trend", **options)
        self.run(
            f"chooseTrend(trend.channels.findIndex((row) => row.run === 'dynamics'"
            f" && row.channel === '{channel}'))"
        )

    def heights(self, solver: str) -> list[float]:
        """The vertical places of a solver's points, which grow downwards."""
        found = self.run(
            f"findAll('#trend-plot [data-solver=\"{solver}\"] .trend-point')"
            ".map((one) => one.getAttribute('transform'))"
        )
        return [float(re.findall(r"[\d.]+", text)[1]) for text in found]


def test_known_errors_are_drawn_at_their_heights(folder: Path, browser: Any) -> None:
    with TrendVisit(browser, folder) as visit:
        heights = visit.heights("mujoco")
        steps = [a - b for a, b in pairwise(heights)]
        assert len(heights) == 5
        # each step is a decade; coordinates have one decimal, so that steps differ by up to 0.1
        assert steps[:3] == pytest.approx(3 * [steps[0]], abs=0.11)
        assert steps[0] > 10
        allowed = float(visit.run("find('.trend-allowed').getAttribute('y1')"))
        text = visit.page.inner_text("#trend-plot")
        assert "allowed now 1e−6 (MuJoCo)" in text
        assert "allowed now 2e−6 (pymunk)" in text
        assert heights[3] - allowed == pytest.approx(steps[0], abs=0.11)  # from 1e-7 to 1e-6
        assert visit.page.locator("#trend-plot .over").count() == 0
        assert visit.page.locator("#trend-plot .trend-versions").count() == 2
        assert visit.said == []
        assert all(url.startswith(folder.as_uri()) for url in visit.asked)


def test_the_worst_channel_is_first_and_has_filled_points(folder: Path, browser: Any) -> None:
    with TrendVisit(browser, folder) as visit:
        visit.run("chooseTrend(0)")
        ratios = visit.run("trend.channels.map(worstRatio)")
        known = [ratio for ratio in ratios if ratio is not None]
        assert known == sorted(known, reverse=True)
        assert ratios[0] > 1  # in a sweep only 1e-12 is allowed
        assert visit.page.locator("#trend-plot .over").count() == 10  # five reports, two solvers
        item = visit.page.locator("#trend-list [role=option]").first
        assert "✗" in item.inner_text()


def test_zero_errors_are_drawn_and_missing_ones_leave_gaps(folder: Path, browser: Any) -> None:
    with TrendVisit(browser, folder, "rocker") as visit:
        heights = visit.heights("mujoco")
        assert len(heights) == 4  # one of five reports has no error
        assert heights[1] == max(heights)  # zero is drawn below the axis
        line = visit.run("find('#trend-plot [data-solver=mujoco] .trend-line').getAttribute('d')")
        assert line.count("M") == 2  # interrupted at the missing error
        assert "\n0\n" in "\n".join(
            visit.run("findAll('#trend-plot text').map((one) => one.textContent)")
        ).join(["\n", "\n"])


def test_pointer_and_keys_select_a_report(folder: Path, browser: Any) -> None:
    with TrendVisit(browser, folder) as visit:
        report_text = "#trend-told"
        assert "this report" in visit.page.inner_text(report_text)
        box = visit.page.locator("#trend-plot").bounding_box()
        across = visit.run("trendPlaces.across(1)")
        visit.page.mouse.move(box["x"] + across, box["y"] + 60)
        words = visit.page.inner_text(report_text)
        assert "2026-01-02 08:00 UTC, commit 0000002" in words
        assert "MuJoCo 1e−9, 1e−3 of what is allowed now" in words
        assert f"proofmass {MADE.versions['proofmass']}, mujoco 1.0" in words
        visit.page.mouse.move(2, 2)
        assert "this report" in visit.page.inner_text(report_text)
        visit.page.focus("#trend-plot")
        visit.page.keyboard.press("Home")
        for _ in range(2):
            visit.page.keyboard.press("ArrowRight")
        plot = visit.page.locator("#trend-plot")
        assert plot.get_attribute("aria-valuenow") == "3"
        assert plot.get_attribute("aria-valuetext").startswith("2026-01-03 08:00 UTC, commit")
        assert "before: mujoco 1.0 → 2.0" in visit.page.inner_text(report_text)
        assert "MuJoCo from 1e−10 to 1e−7, at most 1e−7, allowed 1e−6" in plot.get_attribute(
            "aria-label"
        )
        channel = visit.page.inner_text("#trend-channel")
        before = visit.run("state.channel")
        visit.page.focus("#trend-list")
        visit.page.keyboard.press("ArrowUp")
        assert visit.page.inner_text("#trend-channel") != channel
        assert visit.run("state.channel") == before  # the curves above have other keys
        assert visit.page.locator("#trend-list [aria-selected=true]").count() == 1


def test_each_report_is_listed_in_a_table(folder: Path, browser: Any) -> None:
    with TrendVisit(browser, folder) as visit:
        visit.page.locator("#trend-plot ~ details summary").click()
        lines = visit.run("[...find('#trend-table').tBodies[0].rows].map((row) => row.innerText)")
        assert len(lines) == 5
        assert lines[-1].split("\t")[:2] == ["2026-01-01 08:00 UTC, commit 0000001", "1e−10"]
    with Visit(browser, folder / "fourbar.html", java_script_enabled=False) as visit:
        visit.page.locator("#trend details summary").last.click()
        text = visit.page.inner_text("#trend")
        assert re.search(r"pin\.x\s+dynamics\s+MuJoCo\s+1e-10\s+1e-7\s+1e-7\s+1e-7\s+1e-6", text)


@pytest.mark.parametrize("scheme", ["light", pytest.param("dark", marks=pytest.mark.slow)])
def test_axe_finds_no_accessibility_violation(scheme: str, folder: Path, browser: Any) -> None:
    with TrendVisit(browser, folder, color_scheme=scheme) as visit:
        visit.run("findAll('#trend details').forEach((one) => one.setAttribute('open', ''))")
        wrong, met = visit.axe("#trend")
        assert wrong == []
        assert met > 10


def test_a_phone_shows_the_trend_in_one_column(folder: Path, browser: Any) -> None:
    with TrendVisit(browser, folder, viewport=PHONE) as visit:
        assert visit.run("document.documentElement.scrollWidth - innerWidth") <= 0
        sides = visit.run(
            "['.list-side', '.plots'].map((one) => "
            "find(`#trend ${one}`).getBoundingClientRect().left)"
        )
        assert sides[0] == pytest.approx(sides[1], abs=1)
        assert visit.small_text("#trend", "one.offsetParent !== null || one.ownerSVGElement") == []


def test_a_page_with_a_trend_stays_below_its_largest_size(folder: Path) -> None:
    assert (folder / "fourbar.html").stat().st_size < 700_000


def test_the_index_links_to_the_trend(folder: Path, browser: Any) -> None:
    with Visit(browser, folder / "index.html", reduced_motion="reduce") as visit:
        link = visit.page.locator("tr[data-name=fourbar] .trend-link")
        assert "of fourbar" in link.inner_text() + link.text_content()
        link.focus()
        visit.page.keyboard.press("Enter")
        visit.page.wait_for_url(re.compile(r"/fourbar\.html"))  # the page appends to it
        top = visit.run("find('#trend').getBoundingClientRect().top")
        assert abs(top) < 200
        assert visit.said == []


def test_a_first_report_says_when_the_trend_begins(
    fourbar: Case, browser: Any, tmp_path: Path
) -> None:
    result = result_from_references(fourbar, off=ERROR_SHARE)
    with without_figures():
        write_report(result, tmp_path)
    with Visit(browser, tmp_path / "fourbar.html", reduced_motion="reduce") as visit:
        assert "The trend begins with the second report" in visit.page.inner_text("#trend")
        assert visit.page.locator("#trend-body").count() == 0
        assert visit.said == []
    assert not any("trend" in url for url in visit.asked)
    file = tmp_path / "results.json"
    text = json.loads(file.read_text())
    text["history"]["reports"][0]["date"] = 3
    file.write_text(json.dumps(text))
    with without_figures():
        write_report(result, tmp_path)
    page = (tmp_path / "fourbar.html").read_text(encoding="utf-8")
    assert page.count("The history in results.json is damaged; left out: report 1 of 1 (date") == 1
    index = (tmp_path / "index.html").read_text(encoding="utf-8")
    assert index.count("is damaged; left out: report 1 of 1 (date") == 1
    assert str(tmp_path) not in index
