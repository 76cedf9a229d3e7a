"""The chart of a diet page: its sentences and its markers, and its behaviour in a browser."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from proofmass.report.figures import save
from proofmass.studies.diet import page as diet_page
from proofmass.studies.diet.page import (
    MIN_COST_SHARE,
    describe_entry,
    outcome_marker,
    step_times,
    write_diet,
)
from proofmass.studies.diet.table import (
    NO_GAIN,
    OPTION_KIND,
    WHOLE_KIND,
    Entry,
    read_entries,
    write_entries,
)
from proofmass.studies.diet.trial import Cost
from tests.visit import PHONE, Visit

COSTS = (Cost(1e-4, 20_480), Cost(4.9e-5, 10_240))
CHANGES = {"run": {"angle": 0.5}}
LIGHT = Entry("light", "sun", "harmless", CHANGES, "", COSTS, (0.4, 0.5, 0.6))
CONTACT = replace(
    LIGHT, kind="contact", name="all", saved=(0.7, 0.8, 0.9), moved={"run": {"angle": 0.0}},
    edit='<option><flag contact="disable"/></option>',
)  # fmt: skip
STEP = replace(
    LIGHT, kind=OPTION_KIND, name="time step 1e-3 to 2e-3 s", outcome="matters",
    moved={"run": {"angle": 7.0}}, edit='<option timestep="0.002"/>',
)  # fmt: skip
SOLVER = replace(
    LIGHT, kind=OPTION_KIND, name="solver Newton to CG", outcome=NO_GAIN, saved=(-0.1, 0.0, 0.1),
    edit='<option solver="CG"/>',
)  # fmt: skip
DRAWN_COVER = replace(LIGHT, kind="drawn geom", name="cover", outcome="drawn")
NEEDED = Entry("joint", "pivot", "needed", message="a sensor names it")
ALL_CHANGES = replace(CONTACT, kind=WHOLE_KIND, name="", edit="")
ENTRIES = [STEP, LIGHT, CONTACT, SOLVER, DRAWN_COVER, NEEDED, ALL_CHANGES]


def test_a_sentence_describes_an_entry() -> None:
    assert describe_entry(LIGHT) == (
        "Harmless: it is removed or changed. A step takes 100 µs with it, 50 µs without (40 µs to "
        "60 µs with 99 %). Memory: 20 KB with it, 10 without. The largest change is 0.5 of what is "
        "allowed, angle in run."
    )
    assert "100 µs before, 100 µs after (90 µs to 110 µs with 99 %), no change" in describe_entry(
        SOLVER
    )
    assert describe_entry(CONTACT).endswith("No channel changes.")


def test_intervals_of_step_times_are_above_zero() -> None:
    assert step_times(LIGHT) == pytest.approx([5e-5, 4e-5, 6e-5])
    assert step_times(replace(LIGHT, saved=(0.5, 0.9, 1.2)))[1] == pytest.approx(
        MIN_COST_SHARE * 1e-4, rel=1e-6, abs=0
    )
    assert step_times(replace(LIGHT, saved=())) == [4.9e-5]  # no pairs, no interval


def test_outcomes_differ_in_their_markers() -> None:
    outcomes = ("harmless", "drawn", NO_GAIN, "matters")
    assert len({outcome_marker(outcome) for outcome in outcomes}) == len(outcomes)


def test_entries_are_read_as_they_were_written(tmp_path: Path) -> None:
    write_entries(ENTRIES, tmp_path / "model.csv")
    assert read_entries(tmp_path / "model.csv") == ENTRIES


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of two models, without its printable figures."""
    out = tmp_path_factory.mktemp("chart")
    write_entries(ENTRIES, out / "arm.csv")
    write_entries([LIGHT, replace(ALL_CHANGES, outcome="harmless")], out / "bob.csv")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(diet_page, save.__name__, lambda figure, file: "")
        write_diet(out, out)
    return out / "index.html"


LABELS_SCRIPT = "findAll('#rows .row-label').map((one) => one.textContent)"


def row_script(label: str) -> str:
    """A JavaScript expression that finds the row of the chart with a label."""
    return f"findAll('#rows .row').find((one) => find('.row-label', one).textContent === '{label}')"


def axis_positions(visit: Visit, label: str, part: str, *names: str) -> list[float]:
    """Attributes of a part of a row that are positions on the axis [%]."""
    found = visit.run(
        f"{list(names)!r}.map((name) => find('{part}', {row_script(label)}).getAttribute(name))"
    )
    return [float(text.removesuffix("%")) for text in found]


def test_entries_are_sorted_by_their_savings(page: Path, browser: Any) -> None:
    with Visit(browser, page) as visit:
        assert visit.run(LABELS_SCRIPT) == [
            WHOLE_KIND,
            "contact all",  # harmless, with the largest saving
            "light sun",
            "drawn geom cover",
            "option solver Newton to CG",
            "option time step 1e-3 to 2e-3 s",
        ]  # the needed joint has no costs, and no row
        values = visit.run("findAll('#rows .row .row-value').map((one) => one.textContent)")
        assert values[1:3] == ["80 % (70 to 90)", "50 % (40 to 60)"]
        visit.page.click("#costs [data-cost=memory]")
        assert visit.run("find('#rows .row .row-value').textContent") == "10 KB"
        assert "cost=memory" in visit.address
        assert visit.said == []
        assert all(url.startswith(page.parent.as_uri()) for url in visit.asked)


def test_costs_and_intervals_are_at_their_values_on_the_axis(page: Path, browser: Any) -> None:
    """The axis is logarithmic; a step takes 100 µs with the light, 50 µs (40 to 60) without."""
    with Visit(browser, page) as visit:
        (before,) = axis_positions(visit, "light sun", ".theory", "x1")
        (after,) = axis_positions(visit, "light sun", ".strip svg", "x")
        octave = before - after
        assert axis_positions(visit, "light sun", ".bar", "x1", "x2") == [before, after]
        low, high = axis_positions(visit, "light sun", ".spread", "x1", "x2")
        assert after - low == pytest.approx(0.32193 * octave, abs=0.02)  # log2(50 / 40)
        assert high - after == pytest.approx(0.26303 * octave, abs=0.02)  # log2(60 / 50)
        hollow = visit.run("findAll('#rows .dot').map((one) => one.classList.contains('hollow'))")
        assert hollow == [False, False, False, True, True, False]


def test_a_click_copies_an_edit_or_leads_to_the_row(page: Path, browser: Any) -> None:
    allowed = {"permissions": ["clipboard-read", "clipboard-write"]}
    with Visit(browser, page, **allowed) as visit:
        tip = visit.page.locator("#rows .tip")
        contact = visit.page.locator("#rows .row", has_text="contact all")
        contact.hover()
        assert f"A click copies {CONTACT.edit}" in tip.inner_text()
        assert describe_entry(CONTACT) in tip.inner_text()
        contact.click()
        visit.page.wait_for_function("find('#rows [role=status]').textContent !== ''")
        assert visit.run("navigator.clipboard.readText()") == CONTACT.edit
        assert f"Copied: {CONTACT.edit}" in tip.inner_text()
        assert visit.page.locator("tr.led-to").count() == 0
        visit.page.locator("#rows .row", has_text="light sun").click()
        assert "light" in visit.page.locator("tr.led-to").inner_text()
        assert visit.run("navigator.clipboard.readText()") == CONTACT.edit


def test_the_enter_key_copies_an_edit(page: Path, browser: Any) -> None:
    allowed = {"permissions": ["clipboard-read", "clipboard-write"]}
    with Visit(browser, page, **allowed) as visit:
        for _ in range(30):
            visit.page.keyboard.press("Tab")
            if visit.run("document.activeElement.className") == "row-list":
                break
        visit.page.keyboard.press("End")
        visit.page.keyboard.press("Enter")
        visit.page.wait_for_function("find('#rows [role=status]').textContent !== ''")
        assert visit.run("navigator.clipboard.readText()") == STEP.edit
        assert visit.run("document.activeElement.className") == "row-list"


def test_model_and_filters_are_kept_in_the_address(page: Path, browser: Any) -> None:
    with Visit(browser, page) as visit:
        visit.page.select_option("#subject", "bob-diet")
        assert visit.run(LABELS_SCRIPT) == [WHOLE_KIND, "light sun"]
        visit.page.select_option("#subject", "")
        assert len(visit.run(LABELS_SCRIPT)) == 8
        visit.page.click("#filters [data-group='harmless']")
        assert len(visit.run(LABELS_SCRIPT)) == 3
        address = visit.address
    with Visit(browser, page, address) as visit:
        assert len(visit.run(LABELS_SCRIPT)) == 3
    with Visit(browser, page, "#bob-diet") as visit:
        assert len(visit.run(LABELS_SCRIPT)) == 2


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_no_accessibility_violation(scheme: str, page: Path, browser: Any) -> None:
    with Visit(browser, page, color_scheme=scheme) as visit:
        visit.page.locator("#rows .row").nth(1).hover()
        wrong, met = visit.axe("#chart")
        assert wrong == []
        assert met > 10


def test_rows_have_one_column_on_a_phone(page: Path, browser: Any) -> None:
    with Visit(browser, page, viewport=PHONE) as visit:
        assert visit.run("document.documentElement.scrollWidth - innerWidth") <= 0
        row = visit.page.locator("#rows .row").first
        label, strip = (row.locator(part).bounding_box() for part in (".row-label", ".strip"))
        assert strip["y"] >= label["y"] + label["height"] - 1
        assert visit.small_text("#chart") == []


def test_a_diet_without_times_has_no_chart(browser: Any, tmp_path: Path) -> None:
    write_entries([NEEDED, replace(ALL_CHANGES, costs=(), saved=())], tmp_path / "arm.csv")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(diet_page, save.__name__, lambda figure, file: "")
        write_diet(tmp_path, tmp_path)
    with Visit(browser, tmp_path / "index.html") as visit:
        assert visit.page.locator("#chart").count() == 0
        assert visit.said == []
        assert not any("savings" in url for url in visit.asked)
