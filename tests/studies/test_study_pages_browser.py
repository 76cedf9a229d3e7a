"""The pages of studies in a browser: their content and controls; they fetch nothing."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from proofmass.report.figures import save
from proofmass.studies.diet import page as diet_page
from proofmass.studies.diet.page import write_diet
from proofmass.studies.diet.table import WHOLE_KIND, Entry, write_entries
from proofmass.studies.diet.trial import Cost
from proofmass.studies.engines.cost import write_costs
from proofmass.studies.engines.cost_page import write_cost_page
from proofmass.studies.record import StudyRow
from proofmass.studies.stress import page as stress_page
from proofmass.studies.stress.boundary import Boundary, BoundaryKind, write_boundaries
from proofmass.studies.stress.page import write_stress
from proofmass.studies.trade import page as trade_page
from proofmass.studies.trade.page import write_trade
from proofmass.studies.trade.trade import Trade, write_study
from tests.studies.engines.cost_rows import compared, timed
from tests.studies.trade.trade_rows import example_study
from tests.visit import PHONE, Visit

TRADE, STRESS, DIET = "trade/fourbar-dynamics-trade.html", "stress/index.html", "diet/index.html"
COST = "engines/cost.html"
PAGES = [TRADE, "trade/index.html", STRESS, DIET, COST]
AXE_RULES, COLOUR_RULES = (
    ["wcag2a", "wcag2aa", "wcag21aa", "wcag22aa", "best-practice"],
    ["color-contrast"],
)
LARGEST_PAGE = 700_000  # bytes: largest size of a page with its data


def with_noisy_times(row: StudyRow) -> StudyRow:
    """A row whose processor times have a spread of 1.3, measured on a machine with a high load."""
    if not row.repeats:
        return row
    times = (row.seconds, 1.1 * row.seconds, 1.3 * row.seconds)
    return replace(row, repeats=times, machine="Processor x 2", load=5.5)


def boundary(parameter: str, engine: str, holds: float, **more: Any) -> Boundary:
    """A boundary of the four-bar's case between `holds` and 1 % more.

    The parameter was varied from 1e-3 s.
    """
    found = Boundary("fourbar", engine, "as it is", parameter, "s", 1e-3, 1.0, holds, 1.01 * holds)
    return replace(found, limit=BoundaryKind.INACCURATE, failure="off by 0.1", **more)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the pages of four small studies, without their figures for papers."""
    out = tmp_path_factory.mktemp("studies")
    for name in ("trade", "stress", "diet", "engines"):
        (out / name).mkdir()
    rows, verdicts = example_study()
    write_study(Trade([with_noisy_times(row) for row in rows], rows[:1], verdicts), out / "trade")
    write_boundaries(
        [
            boundary("time step", "mujoco", 0.02),
            boundary("time step", "pymunk", 0.005, silent=True),
            boundary("gravity", "mujoco", 0.5),
        ],
        out / "stress" / "stress.csv",
    )
    costs, moved = (Cost(2e-5, 30_720), Cost(1.5e-5, 20_480)), {"run": {"angle": 0.5}}
    entries = [
        Entry("light", "sun", "harmless", moved, "", costs, (0.2, 0.25, 0.3)),
        Entry("body", "bob", "matters", {"run": {"angle": 7.0}}, "", costs, (0.1, 0.2, 0.3)),
        Entry("joint", "pivot", "needed", message='no <sensor>, "angle" needs it'),
        Entry(WHOLE_KIND, "", "harmless", moved, "", costs, (0.2, 0.25, 0.3)),
    ]
    write_entries(entries, out / "diet" / "pendulum.csv")
    (out / "diet" / "pendulum.xml").write_text("<mujoco/>")
    write_costs(compared(timed("mujoco", 1e-5), timed("drake", 3e-5)), out / "engines")
    write_cost_page(out / "engines", out / "engines")
    with pytest.MonkeyPatch.context() as patch:
        for module in (trade_page, stress_page, diet_page):
            patch.setattr(module, save.__name__, lambda figure, file: "")
        for write in (write_trade, write_stress, write_diet):
            name = write.__name__.removeprefix("write_")
            write(out / name, out / name)
    return out


class StudyVisit(Visit):
    """A page of a study that is open in a browser."""

    def point_to(self, number: int, click: bool = False) -> None:
        """Move the pointer to the marker of a setting, and click if `click` is true."""
        self.page.locator("#plot").scroll_into_view_if_needed()
        frame = self.page.locator("#plot svg").bounding_box()
        x, y = self.run(f"view.places.get({number})")
        self.page.mouse.move(frame["x"] + x, frame["y"] + y)
        if click:
            self.page.mouse.down()
            self.page.mouse.up()


@pytest.mark.parametrize("name", PAGES)
def test_pages_log_no_messages_and_fetch_nothing(name: str, folder: Path, browser: Any) -> None:
    assert (folder / name).stat().st_size < LARGEST_PAGE
    with StudyVisit(browser, folder / name) as visit:
        assert visit.said == []
        assert all(url.startswith(folder.as_uri()) for url in visit.asked)
        assert visit.run("document.documentElement.scrollWidth - innerWidth") <= 0


@pytest.mark.parametrize("name", PAGES)
def test_a_phone_needs_no_sideways_scrolling(name: str, folder: Path, browser: Any) -> None:
    with StudyVisit(browser, folder / name, viewport=PHONE) as visit:
        assert visit.run("document.documentElement.scrollWidth - innerWidth") <= 0
        assert visit.small_text("main", "one.getClientRects().length") == []


@pytest.mark.parametrize(
    ("name", "scheme"),
    [
        *((TRADE, "light"), (TRADE, "dark"), (PAGES[1], "light"), (STRESS, "dark")),
        *((DIET, "light"), (COST, "light"), (COST, "dark")),
    ],
)
def test_axe_finds_no_accessibility_violation(
    name: str, scheme: str, folder: Path, browser: Any
) -> None:
    with StudyVisit(browser, folder / name, color_scheme=scheme) as visit:
        dark = scheme == "dark"  # only colours differ from the light scheme
        if not dark:
            visit.run("findAll('details').forEach((one) => one.setAttribute('open', ''))")
        wrong, met = visit.axe(options=f"{{runOnly: {COLOUR_RULES if dark else AXE_RULES}}}")
        assert wrong == []
        assert met > (0 if dark else 15)


def test_a_setting_under_the_pointer_is_described(folder: Path, browser: Any) -> None:
    with StudyVisit(browser, folder / TRADE) as visit:
        assert visit.page.locator("#tip").is_hidden()
        number = visit.run("kind().front[1]")
        visit.point_to(number)
        words = visit.run(f"data.settings[{number}].words")
        for place in ("#tip", "#setting"):
            assert words in visit.page.inner_text(place)
        assert "on the front" in visit.page.inner_text("#tip")
        assert "3 runs" in visit.page.inner_text("#setting")
        assert "Load average" in visit.page.inner_text("#setting")
        assert visit.page.locator("#plot .faded").count() > 0  # the other series


def test_the_keyboard_goes_from_setting_to_setting(folder: Path, browser: Any) -> None:
    with StudyVisit(browser, folder / TRADE) as visit:
        visit.page.focus("#points")
        first = visit.run("state.at")
        assert first == visit.run("kind().front[0]")
        active = visit.page.get_attribute("#points", "aria-activedescendant")
        assert active == f"setting-{first}"
        told = visit.page.get_attribute(f"#{active}", "aria-label")
        assert visit.run(f"data.settings[{first}].words") in told
        visit.page.keyboard.press("ArrowRight")
        second = visit.run("state.at")
        series = visit.run(f"[{first}, {second}].map((k) => data.settings[k].series)")
        assert second != first
        assert series[0] == series[1]
        visit.page.keyboard.press("ArrowDown")
        assert visit.run("data.settings[state.at].series") != series[0]
        assert f"at={visit.run('state.at')}" in visit.address


def test_a_click_copies_the_snippet(folder: Path, browser: Any) -> None:
    allowed = {"permissions": ["clipboard-read", "clipboard-write"]}
    with StudyVisit(browser, folder / TRADE, **allowed) as visit:
        copied = "navigator.clipboard.readText()"
        visit.page.locator(".ask [data-copy]").first.click()
        assert visit.run(copied) == visit.page.locator(".ask pre").first.text_content()
        number = visit.run("kind().front.at(-1)")
        visit.point_to(number, click=True)
        visit.page.wait_for_function("find('#setting [data-copy]').textContent === 'Copied'")
        assert visit.run(copied) == visit.run(f"data.settings[{number}].text")


def test_the_address_keeps_the_state_of_the_page(folder: Path, browser: Any) -> None:
    with StudyVisit(browser, folder / TRADE) as visit:
        every = visit.page.locator("#points [role=option]").count()
        visit.page.click("#chips [data-series='0']")
        assert visit.page.locator("#points [role=option]").count() == every - 9
        visit.page.click("#kinds [data-kind='velocity']")
        assert visit.page.locator(".of-kind[data-kind='position']").is_hidden()
        assert visit.page.locator(".of-kind[data-kind='velocity']").is_visible()
        visit.page.keyboard.press("c")
        assert visit.run("state.cost") == "work"
        visit.page.locator("#plot").scroll_into_view_if_needed()
        frame = visit.page.locator("#plot svg").bounding_box()
        visit.page.mouse.move(frame["x"] + 150, frame["y"] + 100)
        visit.page.mouse.down()
        visit.page.mouse.move(frame["x"] + 400, frame["y"] + 300, steps=3)
        visit.page.mouse.up()
        zoom, address = visit.run("state.zoom"), visit.address
        assert zoom[0] < zoom[1]
        assert zoom[2] < zoom[3]
    with StudyVisit(browser, folder / TRADE, address) as visit:
        assert visit.run("[state.kind, state.cost, [...state.off]]") == ["velocity", "work", [0]]
        assert visit.run("state.zoom") == pytest.approx(zoom, rel=1e-3)
        visit.page.keyboard.press("0")
        assert "zoom" not in visit.address


def test_a_busy_machine_is_reported_and_ties_are_marked(folder: Path, browser: Any) -> None:
    with StudyVisit(browser, folder / TRADE) as visit:
        assert "load average was up to 5.5 on 2 processors" in visit.page.inner_text(".warned")
        assert "do not distinguish the two engines" in visit.page.inner_text(".ask >> nth=0")
        tied = visit.run("kind().tied.length")
        assert tied > 0
        assert visit.page.locator("#points .tied").count() == tied
        low, told, high = visit.run("data.settings[kind().front[0]].seconds")
        assert (low, high) == (told, pytest.approx(1.3 * told))


def test_tables_sort_and_rows_are_filtered(folder: Path, browser: Any) -> None:
    with StudyVisit(browser, folder / STRESS) as visit:
        solvers = "findAll('.chart-table tbody tr').map((row) => row.cells[4].textContent)"
        visit.page.locator(".chart-table th[data-sort] button", has_text="boundary").click()
        assert [text.split()[0] for text in visit.run(solvers)] == ["5.025e-3", "0.0201", "0.5025"]
        visit.page.locator(".chart-table th[data-sort] button", has_text="boundary").click()
        assert visit.run(solvers)[0].startswith("0.5025")
        visit.page.click("#filters [data-group='pymunk']")
        assert "2 of 3 rows" in visit.page.inner_text("#filters")
        visit.page.fill("#filters input", "gravity")
        assert "1 of 3 rows" in visit.page.inner_text("#filters")
        address = visit.address
    with StudyVisit(browser, folder / STRESS, address) as visit:
        assert "1 of 3 rows" in visit.page.inner_text("#filters")


def test_pages_without_javascript_have_advice_and_tables(folder: Path, browser: Any) -> None:
    with StudyVisit(browser, folder / TRADE, java_script_enabled=False) as visit:
        assert visit.page.locator(".ask pre").count() > 10  # settings for all kinds of errors
        assert "needs JavaScript" in visit.page.inner_text("main")
        visit.page.click("#tables summary >> nth=0")
        assert "the loops are open by 0.3 m" in visit.page.inner_text("#tables")
        printed = visit.page.pdf(format="A4")
        assert printed.startswith(b"%PDF")


def test_closed_tables_are_printed(folder: Path, browser: Any) -> None:
    with StudyVisit(browser, folder / TRADE) as visit:
        closed = visit.page.locator("details:not([open])").count()
        assert closed > 1
        pages = visit.page.pdf(format="A4").count(b"/Type /Page\n")
        visit.run("findAll('details').forEach((one) => one.remove())")
        assert pages > visit.page.pdf(format="A4").count(b"/Type /Page\n")
