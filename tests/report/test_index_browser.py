"""The index in a browser: filters, sorting, moving drawings, widths and accessibility."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from tests.report.index_rows import last_record, result_for_index, write_index
from tests.visit import Visit

EXPECTED_ORDER = ["slider_crank", "fourbar", "pendulum", "rod_cantilever", "hacksaw_recorded"]


@pytest.fixture(scope="module")
def index(tmp_path_factory: pytest.TempPathFactory) -> Path:
    result = result_for_index()
    return write_index(tmp_path_factory.mktemp("index"), result, last_record(result))


@pytest.fixture
def open_index(browser, index: Path) -> Iterator[Callable[..., Any]]:
    """A function that opens the index in the browser, and returns the page.

    It is called as ``f(address, **options)`` with the part of the address after the file's name and
    options of `Visit`.  Before the next page, and at the end of the test, it asserts that the page
    wrote no messages and fetched only local files.
    """
    with ExitStack() as visits:

        def open_page(address: str = "", **how: Any) -> Any:
            visits.close()  # leaves the previous page
            visit = visits.enter_context(Visit(browser, index, address, **how))
            visits.callback(assert_silent, visit)
            return visit.page

        yield open_page


def assert_silent(visit: Visit) -> None:
    """Assert that a page wrote no messages and fetched only local files."""
    assert visit.said == []
    assert [url for url in visit.asked if not url.startswith(("file:", "data:"))] == []


def visible_rows(page) -> list[str]:
    """The names of the visible rows, from top to bottom."""
    return page.eval_on_selector_all(
        "tbody tr[data-name]", "rows => rows.filter(r => !r.hidden).map(r => r.dataset.name)"
    )


def test_a_search_filters_and_stays_in_the_address(open_index):
    page = open_index()
    assert visible_rows(page) == EXPECTED_ORDER
    page.keyboard.press("/")
    assert page.evaluate("document.activeElement.id") == "search"
    page.keyboard.type("crank slider")  # the order of words does not matter
    assert visible_rows(page) == ["slider_crank"]
    assert page.inner_text("#count") == "1 of 5 cases"
    assert page.url.endswith("#q=crank+slider")
    page.keyboard.press("Escape")
    assert visible_rows(page) == EXPECTED_ORDER
    assert "#" not in page.url
    page.fill("#search", "nothing of that name")
    assert visible_rows(page) == []
    page.click("#clear")
    assert visible_rows(page) == EXPECTED_ORDER


def test_the_counts_of_outcomes_filter_the_rows(open_index):
    page = open_index()
    for outcome, left in (
        ("agree", EXPECTED_ORDER[2:]),
        ("differ", EXPECTED_ORDER[:2]),
        ("gaps", ["slider_crank", "pendulum"]),
        ("changed", ["pendulum", "hacksaw_recorded"]),
    ):
        page.click(f"[data-outcome={outcome}]")
        assert visible_rows(page) == left
        assert page.get_attribute(f"[data-outcome={outcome}]", "aria-pressed") == "true"
        shown = page.inner_text(f"[data-outcome={outcome}] b").split()[0]
        if outcome in ("agree", "differ"):
            assert int(shown) == len(left)
    page.click("[data-outcome=changed]")  # a second click shows all rows again
    assert visible_rows(page) == EXPECTED_ORDER


def test_engine_and_family_filter_the_rows(open_index):
    page = open_index()
    page.click("[data-engine=pymunk]")
    assert visible_rows(page) == ["slider_crank", "fourbar"]
    heads = page.eval_on_selector_all(
        "th[data-of]", "heads => heads.filter(h => !h.hidden).map(h => h.innerText.trim())"
    )
    assert heads == ["Dynamics · pymunk"]
    page.click("[data-outcome=differ]")  # fourbar differs in MuJoCo only
    assert visible_rows(page) == ["slider_crank"]
    page.click("[data-outcome=differ]")
    page.click("[data-engine='']")
    page.select_option("#family", "linkages/")
    assert visible_rows(page) == [name for name in EXPECTED_ORDER if name != "rod_cantilever"]
    page.select_option("#family", "linkages/pendulum")
    assert visible_rows(page) == ["pendulum"]
    assert page.inner_text("#about-family").startswith("Simple pendulum")


def test_columns_sort_up_and_down_and_back(open_index):
    page = open_index()
    button = "th button[data-sort='quasi-static/mujoco']"
    page.click(button)
    assert visible_rows(page)[:2] == ["fourbar", "rod_cantilever"]  # the largest error is first
    assert page.get_attribute("th[aria-sort]", "aria-sort") == "descending"
    page.click(button)
    assert visible_rows(page)[-2:] == ["rod_cantilever", "fourbar"]
    assert page.get_attribute("th[aria-sort]", "aria-sort") == "ascending"
    assert "down=1" in page.url
    page.click(button)
    assert visible_rows(page) == EXPECTED_ORDER
    assert page.locator("th[aria-sort]").count() == 0
    page.click("th button[data-sort=name]")
    assert visible_rows(page) == sorted(EXPECTED_ORDER)
    assert page.get_attribute("th[aria-sort]", "aria-sort") == "ascending"


def test_an_address_sets_search_filters_and_sorting(open_index):
    page = open_index("#outcome=agree&sort=name&q=p&family=linkages%2F&engine=mujoco")
    assert visible_rows(page) == ["hacksaw_recorded", "pendulum"]
    assert page.input_value("#search") == "p"
    page.evaluate("location.hash = '#q=fourbar'")
    page.wait_for_function("document.querySelector('#search').value === 'fourbar'")
    assert visible_rows(page) == ["fourbar"]
    assert visible_rows(open_index("#outcome=x&family=y&engine=z")) == EXPECTED_ORDER


def test_a_drawing_moves_under_the_pointer_and_with_the_focus(open_index):
    page = open_index()
    path = "tr[data-name=pendulum] .thumbnail .link"
    moved = f"start => document.querySelector('{path}').getAttribute('d') !== start"
    for touch in (
        lambda: page.hover("tr[data-name=pendulum] .case p"),
        lambda: page.focus("tr[data-name=pendulum] .case a"),
    ):
        start = page.get_attribute(path, "d")
        touch()
        page.wait_for_function(moved, arg=start)
        page.hover("#cases thead th:nth-child(2)")
        page.wait_for_function(f"start => !({moved})(start)", arg=start)


def test_a_drawing_does_not_move_with_reduced_motion(open_index):
    page = open_index(reduced_motion="reduce")
    path = "tr[data-name=pendulum] .thumbnail .link"
    start = page.get_attribute(path, "d")
    page.hover("tr[data-name=pendulum] .case p")
    page.wait_for_timeout(200)
    assert page.get_attribute(path, "d") == start


@pytest.mark.parametrize("width", [390, 760, 1024, 1440])
def test_nothing_is_wider_than_the_screen(open_index, width):
    page = open_index(viewport={"width": width, "height": 800})
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    small = page.evaluate(
        "[...document.querySelectorAll('body *')].filter(e => e.childNodes.length && "
        "[...e.childNodes].some(n => n.nodeType === 3 && n.data.trim()) && "
        "e.checkVisibility() && !e.closest('.unseen, script') && "
        "parseFloat(getComputedStyle(e).fontSize) < 12).map(e => e.outerHTML)"
    )
    assert small == []


def test_a_phone_shows_the_cells_of_a_case_below_each_other(open_index):
    page = open_index(viewport={"width": 390, "height": 844})
    page.locator("#cases").scroll_into_view_if_needed()
    page.wait_for_selector("tr[data-name=pendulum] td.cell:not(.none)")
    left = page.eval_on_selector_all(
        "tr[data-name=pendulum] td.cell:not(.none)",
        "cells => cells.map(c => c.getBoundingClientRect().left)",
    )
    assert len(left) == 2
    assert len(set(left)) == 1
    words = "document.querySelector('tr[data-name=fourbar] .case').getBoundingClientRect().width"
    assert page.evaluate(words) > 200


def test_rows_are_shown_without_javascript(open_index):
    page = open_index(java_script_enabled=False)
    assert page.locator("tbody tr[data-name]").count() == 5
    assert page.is_visible("tr[data-name=pendulum] .strip")
    assert not page.is_visible(".bar")


def test_print_has_all_rows_and_no_controls(open_index):
    across = 703  # A4 less the margins, at 96 dots an inch
    page = open_index(color_scheme="dark", viewport={"width": across, "height": 1000})
    page.emulate_media(media="print")
    assert page.evaluate("document.documentElement.scrollWidth") <= across
    right = "document.querySelector('#cases').getBoundingClientRect().right"
    assert page.evaluate(right) <= across
    assert not page.is_visible(".bar")
    assert page.is_visible("tr[data-name=pendulum]")
    ground = page.evaluate("getComputedStyle(document.body).backgroundColor")
    assert ground == "rgb(255, 255, 255)"
    ink = page.evaluate("getComputedStyle(document.body).color")
    assert ink == "rgb(21, 24, 28)"


@pytest.mark.parametrize(
    ("width", "scheme"),
    [
        (390, "dark"),
        (1440, "light"),
        pytest.param(390, "light", marks=pytest.mark.slow),
        pytest.param(1440, "dark", marks=pytest.mark.slow),
    ],
)
def test_rules_of_accessibility_are_kept(browser, index, scheme, width):
    pytest.importorskip("axe_core_python", reason="needs axe-core-python")
    size = {"width": width, "height": 900}
    with Visit(browser, index, color_scheme=scheme, viewport=size) as visit:
        visit.page.click("[data-outcome=agree]")
        visit.page.click("[data-outcome=agree]")
        wrong, met = visit.axe()
        assert wrong == []
        assert met > 15  # axe has applied its rules


@pytest.fixture(scope="module")
def two_engine_index(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An index with all runs in MuJoCo and in pymunk."""
    result = result_for_index()
    own = [c for c in result.comparisons if c.solver == "mujoco"]
    result.comparisons[:] = [replace(c, solver=s) for s in ("mujoco", "pymunk") for c in own]
    return write_index(tmp_path_factory.mktemp("two"), result, last_record(result))


@pytest.mark.parametrize("width", [1100, 1250, 1251])
def test_columns_of_two_engines_fit_on_the_screen(browser, two_engine_index, width):
    """From 1100 points on the table has no scroll bar of its own, so that its head can stay."""
    with Visit(browser, two_engine_index, viewport={"width": width, "height": 900}) as visit:
        assert visit.page.locator("thead th[data-of]").count() == 4
        assert visit.run("document.documentElement.scrollWidth") <= width
        card = "document.querySelector('.table').getBoundingClientRect().right"
        table = "document.querySelector('#cases').getBoundingClientRect().right"
        assert visit.run(f"{table} - {card}") <= 1.0  # the border of the card is 1 point wide


@pytest.fixture(scope="module")
def wide_index(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An index with all runs in MuJoCo, in pymunk and in a third engine, and a recorded curve."""
    result = result_for_index()
    own = [c for c in result.comparisons if c.solver == "mujoco"]
    for solver in ("recorded:rig", "adams", "pymunk"):
        result.comparisons.extend(replace(c, solver=solver) for c in own)
    return write_index(tmp_path_factory.mktemp("wide"), result, last_record(result))


@pytest.mark.parametrize("width", [390, 1024, 1280, 1440])
def test_columns_of_a_third_engine_fit_on_the_screen(browser, wide_index, width):
    with Visit(browser, wide_index, viewport={"width": width, "height": 900}) as visit:
        # recorded curves are no engine
        assert visit.page.locator("thead th[data-of=recorded]").count() == 0
        assert visit.page.locator("#cases thead th[data-of]").count() == 6
        assert visit.run("document.documentElement.scrollWidth") <= width
