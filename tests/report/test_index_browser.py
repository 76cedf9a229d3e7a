"""The index in a browser: filters, sorting, moving drawings, widths and accessibility."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from tests.report.index_rows import last_record, whole_result, write_index
from tests.visit import Visit

ORDER = ["slider_crank", "fourbar", "pendulum", "rod_cantilever", "hacksaw_recorded"]


@pytest.fixture(scope="module")
def index(tmp_path_factory: pytest.TempPathFactory) -> Path:
    result = whole_result()
    return write_index(tmp_path_factory.mktemp("index"), result, last_record(result))


@pytest.fixture
def opened(browser, index: Path) -> Iterator[Callable[..., Any]]:
    """A function that opens the index in the browser, and returns the page.

    It is called as ``f(address, **options)`` with the part of the address after the file's name and
    options of `Visit`.  Before the next page, and at the end of the test, it asserts that the page
    wrote no messages and fetched only local files.
    """
    with ExitStack() as visits:

        def open_page(address: str = "", **how: Any) -> Any:
            visits.close()  # leaves the previous page
            visit = visits.enter_context(Visit(browser, index, address, **how))
            visits.callback(silent, visit)
            return visit.page

        yield open_page


def silent(visit: Visit) -> None:
    """Assert that a page wrote no messages and fetched only local files."""
    assert visit.said == []
    assert [url for url in visit.asked if not url.startswith(("file:", "data:"))] == []


def names(page) -> list[str]:
    """The names of the visible rows, from top to bottom."""
    return page.eval_on_selector_all(
        "tbody tr[data-name]", "rows => rows.filter(r => !r.hidden).map(r => r.dataset.name)"
    )


def test_a_search_filters_and_stays_in_the_address(opened):
    page = opened()
    assert names(page) == ORDER
    page.keyboard.press("/")
    assert page.evaluate("document.activeElement.id") == "search"
    page.keyboard.type("crank slider")  # the order of words does not matter
    assert names(page) == ["slider_crank"]
    assert page.inner_text("#count") == "1 of 5 cases"
    assert page.url.endswith("#q=crank+slider")
    page.keyboard.press("Escape")
    assert names(page) == ORDER
    assert "#" not in page.url
    page.fill("#search", "nothing of that name")
    assert names(page) == []
    page.click("#clear")
    assert names(page) == ORDER


def test_the_numbers_filter(opened):
    page = opened()
    for outcome, left in (
        ("agree", ORDER[2:]),
        ("differ", ORDER[:2]),
        ("gaps", ["slider_crank", "pendulum"]),
        ("changed", ["pendulum", "hacksaw_recorded"]),
    ):
        page.click(f"[data-outcome={outcome}]")
        assert names(page) == left
        assert page.get_attribute(f"[data-outcome={outcome}]", "aria-pressed") == "true"
        shown = page.inner_text(f"[data-outcome={outcome}] b").split()[0]
        if outcome in ("agree", "differ"):
            assert int(shown) == len(left)
    page.click("[data-outcome=changed]")  # a second click shows all rows again
    assert names(page) == ORDER


def test_an_engine_and_a_family_filter(opened):
    page = opened()
    page.click("[data-engine=pymunk]")
    assert names(page) == ["slider_crank", "fourbar"]
    heads = page.eval_on_selector_all(
        "th[data-of]", "heads => heads.filter(h => !h.hidden).map(h => h.innerText.trim())"
    )
    assert heads == ["Dynamics · pymunk"]
    page.click("[data-outcome=differ]")  # fourbar differs in MuJoCo only
    assert names(page) == ["slider_crank"]
    page.click("[data-outcome=differ]")
    page.click("[data-engine='']")
    page.select_option("#family", "linkages/")
    assert names(page) == [name for name in ORDER if name != "rod_cantilever"]
    page.select_option("#family", "linkages/pendulum")
    assert names(page) == ["pendulum"]
    assert page.inner_text("#about-family").startswith("Simple pendulum")


def test_columns_sort_up_and_down_and_back(opened):
    page = opened()
    button = "th button[data-sort='quasi-static/mujoco']"
    page.click(button)
    assert names(page)[:2] == ["fourbar", "rod_cantilever"]  # the largest error is first
    assert page.get_attribute("th[aria-sort]", "aria-sort") == "descending"
    page.click(button)
    assert names(page)[-2:] == ["rod_cantilever", "fourbar"]
    assert page.get_attribute("th[aria-sort]", "aria-sort") == "ascending"
    assert "down=1" in page.url
    page.click(button)
    assert names(page) == ORDER
    assert page.locator("th[aria-sort]").count() == 0
    page.click("th button[data-sort=name]")
    assert names(page) == sorted(ORDER)
    assert page.get_attribute("th[aria-sort]", "aria-sort") == "ascending"


def test_an_address_is_a_state(opened):
    page = opened("#outcome=agree&sort=name&q=p&family=linkages%2F&engine=mujoco")
    assert names(page) == ["hacksaw_recorded", "pendulum"]
    assert page.input_value("#search") == "p"
    page.evaluate("location.hash = '#q=fourbar'")
    page.wait_for_function("document.querySelector('#search').value === 'fourbar'")
    assert names(page) == ["fourbar"]
    assert names(opened("#outcome=x&family=y&engine=z")) == ORDER


def test_a_drawing_moves_under_the_pointer_and_with_the_focus(opened):
    page = opened()
    path = "tr[data-name=pendulum] .thumbnail .link"
    moved = f"start => document.querySelector('{path}').getAttribute('d') !== start"
    for touch in (
        lambda: page.hover("tr[data-name=pendulum] .case p"),
        lambda: page.focus("tr[data-name=pendulum] .case a"),
    ):
        start = page.get_attribute(path, "d")
        touch()
        page.wait_for_function(moved, arg=start)
        page.hover("h1")
        page.wait_for_function(f"start => !({moved})(start)", arg=start)


def test_a_drawing_stays_still_where_motion_is_not_wanted(opened):
    page = opened(reduced_motion="reduce")
    path = "tr[data-name=pendulum] .thumbnail .link"
    start = page.get_attribute(path, "d")
    page.hover("tr[data-name=pendulum] .case p")
    page.wait_for_timeout(200)
    assert page.get_attribute(path, "d") == start


@pytest.mark.parametrize("width", [390, 760, 1024, 1440])
def test_nothing_is_wider_than_the_screen(opened, width):
    page = opened(viewport={"width": width, "height": 800})
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    small = page.evaluate(
        "[...document.querySelectorAll('body *')].filter(e => e.childNodes.length && "
        "[...e.childNodes].some(n => n.nodeType === 3 && n.data.trim()) && "
        "e.checkVisibility() && !e.closest('.unseen, script') && "
        "parseFloat(getComputedStyle(e).fontSize) < 12).map(e => e.outerHTML)"
    )
    assert small == []


def test_a_phone_shows_a_case_as_lines(opened):
    page = opened(viewport={"width": 390, "height": 844})
    left = page.eval_on_selector_all(
        "tr[data-name=pendulum] td.cell:not(.none)",
        "cells => cells.map(c => c.getBoundingClientRect().left)",
    )
    assert len(left) == 2
    assert len(set(left)) == 1
    words = "document.querySelector('tr[data-name=fourbar] .case').getBoundingClientRect().width"
    assert page.evaluate(words) > 200


def test_without_a_script_the_rows_are_there(opened):
    page = opened(java_script_enabled=False)
    assert page.locator("tbody tr[data-name]").count() == 5
    assert page.is_visible("tr[data-name=pendulum] .strip")
    assert not page.is_visible(".bar")


def test_print_has_all_rows_and_no_controls(opened):
    across = 703  # A4 less the margins, at 96 dots an inch
    page = opened(color_scheme="dark", viewport={"width": across, "height": 1000})
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
def wide(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An index with all runs in MuJoCo, in pymunk and in a third engine, and a recorded curve."""
    result = whole_result()
    own = [c for c in result.comparisons if c.solver == "mujoco"]
    for solver in ("recorded:rig", "adams", "pymunk"):
        result.comparisons.extend(replace(c, solver=solver) for c in own)
    return write_index(tmp_path_factory.mktemp("wide"), result, last_record(result))


@pytest.mark.parametrize("width", [390, 1024, 1280, 1440])
def test_a_third_engine_has_room_beside_the_others(browser, wide, width):
    with Visit(browser, wide, viewport={"width": width, "height": 900}) as visit:
        assert visit.page.locator("thead th[data-of=recorded]").count() == 2
        assert visit.page.locator("thead th[data-of]").count() == 8
        assert visit.run("document.documentElement.scrollWidth") <= width
