"""The index of a thousand cases: its size, its rows near the screen, and the files of the rest."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from proofmass.report.index_page import ROWS_PER_FILE, STATIC, write_index_files
from proofmass.report.page import write_static
from tests.report.index_rows import index_files, last_record, write_index
from tests.report.many_rows import result_of_many
from tests.visit import PHONE, Visit

COUNT = 1000
MAX_BYTES = 700_000
"""Largest size of the page of an index [bytes], as for a page of a case with its figures."""
MAX_ELEMENTS = 3_000
"""More than the frame of the page and the rows of two screens need; all rows need 52,000."""
BUSY = "rows.filter((row) => !row.whole).length"


@pytest.fixture(scope="module")
def index(tmp_path_factory: pytest.TempPathFactory) -> Path:
    result = result_of_many(COUNT)
    return write_index(tmp_path_factory.mktemp("many") / "index", result, last_record(result))


@pytest.fixture
def visit(browser: Any, index: Path) -> Iterator[Visit]:
    """A visit to the index on a desktop, which must write no messages and fetch local files."""
    with Visit(browser, index) as found:
        yield found
        assert found.said == []
        assert [url for url in found.asked if not url.startswith(("file:", "data:"))] == []


def drawn_rows(visit: Visit) -> list[str]:
    """The names of the cases that have a row in the table, from top to bottom."""
    found: list[str] = visit.run(
        "findAll('tbody tr[data-name]', table).map((row) => row.dataset.name)"
    )
    return found


def visible_rows(visit: Visit) -> list[str]:
    """The names of the cases whose row is on the screen."""
    found: list[str] = visit.run(
        "findAll('tbody tr[data-name]', table).filter((row) => {"
        " const { top, bottom } = row.getBoundingClientRect();"
        " return bottom > 0 && top < innerHeight; }).map((row) => row.dataset.name)"
    )
    return found


def scroll_to(visit: Visit, share: str) -> None:
    """Scroll to a share of the height of the page, and wait for the rows that are there."""
    visit.run(f"scrollTo(0, {share} * document.documentElement.scrollHeight)")
    visit.page.wait_for_function(
        "findAll('tbody tr[data-name]', table).some((row) => {"
        " const { top, bottom } = row.getBoundingClientRect();"
        " return bottom > 0 && top < innerHeight; })"
    )


def test_the_page_is_small_and_has_elements_for_what_is_on_the_screen(
    visit: Visit, index: Path
) -> None:
    assert index.stat().st_size <= MAX_BYTES
    for share in ("0", "0.3", "0.9"):
        scroll_to(visit, share)
        assert visit.run("document.querySelectorAll('*').length") <= MAX_ELEMENTS
        assert len(drawn_rows(visit)) < 60
    assert visit.run("rows.length") == COUNT


def test_every_case_is_reached_by_scrolling_in_the_order_of_the_rows(visit: Visit) -> None:
    """Each screen begins with a row of the screen before it, and all rows are whole in the end."""
    visit.page.wait_for_function(f"{BUSY} === 0")
    visit.page.fill("#search", "hacksaw")
    order = visit.run("chosen.map((row) => row.name)")
    assert len(order) == COUNT // 5
    seen = list(visible_rows(visit))
    for _ in range(3 * COUNT):  # more screens than there are rows
        if seen[-1] == order[-1]:
            break
        before = len(seen)
        visit.run("scrollBy(0, 0.8 * innerHeight)")
        visit.run("new Promise((done) => requestAnimationFrame(() => setTimeout(done)))")
        for name in visible_rows(visit):
            if name not in seen:
                seen.append(name)
        if len(seen) > before + 100:
            pytest.fail("a screen has more than a hundred rows")
    assert seen == order
    assert visit.page.locator("tbody tr[data-name] td.cell").count() > 0


def test_a_search_finds_a_case_that_has_no_row_yet(visit: Visit) -> None:
    last = visit.run("rows.at(-1).name")
    assert last not in drawn_rows(visit)
    visit.page.fill("#search", last)
    visit.page.wait_for_function("rows.at(-1).whole")
    assert drawn_rows(visit) == [last]
    assert visit.page.inner_text("#count") == f"1 of {COUNT} cases"
    assert visit.page.locator("tbody tr[data-name] .strip").count() > 0
    visit.page.fill("#search", "variant 77")  # the words are in the titles
    assert visit.run("chosen.length") == sum("77" in str(k) for k in range(COUNT))


def test_sorting_draws_the_first_rows_of_the_new_order(visit: Visit) -> None:
    visit.page.click("th button[data-sort=name]")
    names = sorted(visit.run("rows.map((row) => row.name)"))
    shown = drawn_rows(visit)
    assert shown == names[: len(shown)]
    visit.page.click("th button[data-sort=name]")
    shown = drawn_rows(visit)
    assert shown == names[::-1][: len(shown)]
    button = "th button[data-sort='quasi-static/mujoco']"
    visit.page.click(button)  # the error of a copy grows with its number
    assert drawn_rows(visit)[0] == "fourbar_0996"


def test_the_table_says_how_many_rows_it_has_and_which_it_shows(visit: Visit) -> None:
    assert visit.page.get_attribute("#cases", "aria-rowcount") == str(COUNT + 1)
    scroll_to(visit, "0.5")
    order = visit.run("chosen.map((row) => row.name)")
    for row in drawn_rows(visit):
        number = visit.page.get_attribute(f"tr[data-name={row}]", "aria-rowindex")
        assert int(number) == order.index(row) + 2  # after the row of the head, from 1


def test_the_tab_key_goes_from_row_to_row_beyond_those_that_are_drawn(visit: Visit) -> None:
    visit.page.wait_for_function(f"{BUSY} === 0")
    order = visit.run("chosen.map((row) => row.name)")
    begun = len(drawn_rows(visit))
    visit.page.focus(f"tr[data-name={order[0]}] .case a")
    place = "document.activeElement.closest('tr')?.dataset.name"
    reached = [visit.run(place)]
    for _ in range(2 * begun):
        visit.page.keyboard.press("Tab")
        visit.run("new Promise((done) => requestAnimationFrame(() => setTimeout(done)))")
        reached += [name for name in [visit.run(place)] if name and name != reached[-1]]
    assert reached == order[: len(reached)]
    assert len(reached) > begun
    visit.run("scrollTo(0, 0)")  # the focus stays although its row is off the screen
    visit.run("new Promise((done) => requestAnimationFrame(() => setTimeout(done)))")
    assert visit.run(place) == reached[-1]


def test_the_engine_hides_its_columns_also_in_rows_that_come_later(visit: Visit) -> None:
    visit.page.click("[data-engine=pymunk]")
    scroll_to(visit, "0.9")
    visit.page.wait_for_function(f"{BUSY} === 0")
    shown = visit.run(
        "findAll('tbody td[data-of]', table).filter((cell) => !cell.hidden)"
        ".map((cell) => cell.dataset.of)"
    )
    assert set(shown) == {"pymunk"}


def test_print_has_all_rows(visit: Visit) -> None:
    visit.page.wait_for_function(f"{BUSY} === 0")
    visit.page.emulate_media(media="print")
    visit.page.wait_for_function(f"findAll('tbody tr[data-name]', table).length === {COUNT}")
    assert visit.page.locator("tbody tr[data-name] td.case a").count() == COUNT
    assert visit.page.locator("tbody tr.gap").count() == 0
    visit.page.emulate_media(media="screen")
    visit.page.wait_for_function("findAll('tbody tr[data-name]', table).length < 60")


def test_an_index_without_its_files_still_names_every_case(browser: Any, index: Path) -> None:
    lone = index.parent.with_name("lone")
    write_index(lone, result_of_many(ROWS_PER_FILE + 5))
    for file in (lone / "rows").iterdir():
        file.unlink()
    with Visit(browser, lone / "index.html") as visit:
        scroll_to(visit, "0.99")
        name = visit.run("rows.at(-1).name")
        row = visit.page.locator(f"tr[data-name={name}]")
        assert row.locator(".case a").get_attribute("href") == f"{name}.html"
        assert "variant" in row.inner_text()


def test_without_javascript_every_case_has_a_link(browser: Any, index: Path) -> None:
    with Visit(browser, index, java_script_enabled=False) as visit:
        assert visit.page.locator("tbody tr[data-name]").count() == ROWS_PER_FILE
        assert visit.page.locator(".others a").count() == COUNT - ROWS_PER_FILE
        assert visit.page.is_visible(".others li >> nth=-1")


@pytest.mark.parametrize("size", [PHONE, {"width": 1024, "height": 800}])
def test_no_row_is_wider_than_the_screen(browser: Any, index: Path, size: dict[str, int]) -> None:
    with Visit(browser, index, viewport=size) as visit:
        scroll_to(visit, "0.5")
        assert visit.run("document.documentElement.scrollWidth") <= size["width"]
        right = "findAll('tbody td.case', table).map((cell) => cell.getBoundingClientRect().right)"
        assert max(visit.run(right)) <= size["width"]


def test_rules_of_accessibility_are_kept_between_gaps(browser: Any, index: Path) -> None:
    pytest.importorskip("axe_core_python", reason="needs axe-core-python")
    with Visit(browser, index, color_scheme="dark") as visit:
        scroll_to(visit, "0.5")
        assert visit.page.locator("tbody tr.gap").count() == 2
        wrong, met = visit.axe()
        assert wrong == []
        assert met > 15  # axe has applied its rules


@pytest.mark.parametrize("size", [PHONE, {"width": 1280, "height": 800}])
def test_names_of_many_missing_cases_are_folded_within_their_note(
    browser: Any, tmp_path: Path, size: dict[str, int]
) -> None:
    """A paragraph may not have a fold in it: the browser would end it before the fold."""
    missing = [f"missing_{k}" for k in range(500)]
    write_static(tmp_path, STATIC)
    index = write_index_files(tmp_path, index_files(result_of_many(3), missing=missing))
    with Visit(browser, index, viewport=size) as visit:
        note = visit.page.locator(".warning")
        assert note.locator("details").count() == 1
        folded = note.bounding_box()["height"]
        note.locator("summary").click()
        assert "missing_499" in note.inner_text()
        assert note.bounding_box()["height"] > 2 * folded
        assert visit.run("document.documentElement.scrollWidth") <= size["width"]


def test_files_of_a_longer_index_before_are_removed(tmp_path: Path) -> None:
    for count, files in ((2 * ROWS_PER_FILE + 1, ["1.js", "2.js"]), (ROWS_PER_FILE, [])):
        result = result_of_many(count)
        index = write_index_files(tmp_path, index_files(result))
        assert index == tmp_path / "index.html"
        assert index.is_file()
        assert sorted(file.name for file in (tmp_path / "rows").iterdir()) == files
