"""The chart of a stress page: its sentences and its markers, and its behaviour in a browser."""

from dataclasses import replace
from math import inf, nan
from pathlib import Path
from typing import Any

import pytest

from proofmass.report.figures import save
from proofmass.report.svg_markers import MARKER_PATHS
from proofmass.studies.stress import page as stress_page
from proofmass.studies.stress.boundary import Boundary, BoundaryKind, write_boundaries
from proofmass.studies.stress.page import KIND_LOOKS, describe_boundary, write_stress
from tests.visit import PHONE, Visit

STEP = Boundary(
    *("fourbar", "mujoco", "Euler", "time step", "s", 1e-3, 1.0, 0.1, 0.101),
    limit=BoundaryKind.INACCURATE,
    failure="position off by 0.1",
    silent=True,
    theory=0.2,
    law="a law",
)
FAILED = replace(STEP, setting="RK4", limit=BoundaryKind.UNSTABLE, silent=False, failure="gone")
WITHOUT_LIMIT = replace(
    STEP, setting="implicit", holds=1.0, breaks=nan, limit=BoundaryKind.HOLDS, failure="",
    silent=False, theory=inf,
)  # fmt: skip
LIGHTER = Boundary(
    *("fourbar", "pymunk", "as it is", "last body lighter", "times", 1.0, 1e-6, 1e-4, 0.99e-4),
    limit=BoundaryKind.REFUSED,
    failure="no <mass>",
)
UNKNOWN_BEYOND = replace(
    LIGHTER, engine="mujoco", breaks=1e-5, limit=BoundaryKind.OURS, failure="ours: too slow"
)
FAILS_AT_START = replace(
    LIGHTER, parameter="gravity", holds=nan, breaks=nan, limit=BoundaryKind.UNSTABLE, failure="no"
)
PENDULUM_STEP = replace(STEP, what="pendulum", theory=nan, law="")
ALL_BOUNDARIES = [
    STEP,
    FAILED,
    WITHOUT_LIMIT,
    LIGHTER,
    UNKNOWN_BEYOND,
    FAILS_AT_START,
    PENDULUM_STEP,
]


@pytest.mark.parametrize(
    ("one", "words"),
    [
        (
            STEP,
            "Holds up to 0.1 s and fails at 0.101 s: inaccurate, in silence: position off by 0.1."
            " Theory: 0.2 s, of which it is 0.5025 (a law).",
        ),
        (
            WITHOUT_LIMIT,
            "Holds up to 1 s, the last value that was tried. Theory: no limit (a law).",
        ),
        (LIGHTER, "Holds down to × 1e-4 and fails at × 9.9e-5: refused: no <mass>."),
        (UNKNOWN_BEYOND, "Held down to × 1e-4; not known beyond: too slow."),
        (FAILS_AT_START, "Does not hold at × 1, the first value: unstable: no."),
    ],
)
def test_a_sentence_describes_a_limit(one: Boundary, words: str) -> None:
    assert describe_boundary(one) == words


def test_kinds_differ_in_shape_and_in_colour() -> None:
    assert set(KIND_LOOKS) == set(BoundaryKind)
    for part in ("marker", "colour"):
        assert len({getattr(look, part) for look in KIND_LOOKS.values()}) == len(KIND_LOOKS)


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of two cases, without its printable figures."""
    out = tmp_path_factory.mktemp("chart")
    write_boundaries(ALL_BOUNDARIES, out / "stress.csv")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(stress_page, save.__name__, lambda figure, file: "")
        write_stress(out, out)
    return out / "index.html"


ROWS_SCRIPT = "findAll('#rows [role=option]').map((row) => row.getAttribute('aria-label'))"


def test_each_parameter_has_a_panel(page: Path, browser: Any) -> None:
    with Visit(browser, page) as visit:
        titles = visit.run("findAll('#rows [role=group]').map((one) => one.ariaLabel)")
        assert titles == ["time step [s]", "last body lighter", "gravity"]
        rows = visit.run(ROWS_SCRIPT)
        assert len(rows) == 6  # the rows of the first case
        assert rows[0].startswith("MuJoCo, Euler, time step [s]. Holds up to 0.1 s")
        assert visit.said == []
        assert all(url.startswith(page.parent.as_uri()) for url in visit.asked)


def test_limits_are_at_their_values_on_the_axis(page: Path, browser: Any) -> None:
    """The axis is logarithmic, with the start at 1 ms, the limit at 0.1005 s, theory at 0.2 s."""

    def places(k: int, part: str, *names: str) -> list[float]:
        return [
            float(
                visit.run(
                    f"find('#row-fourbar-stress-{k} {part}').getAttribute('{name}')"
                ).removesuffix("%")
            )
            for name in names
        ]

    with Visit(browser, page) as visit:
        start, at = places(0, ".held", "x1", "x2")
        (marker,) = places(0, ".strip svg", "x")
        (theory,) = places(0, ".theory", "x1")
        assert marker == at
        decade = (at - start) / 2.00217  # decades from 1e-3 to 0.1005
        assert theory - at == pytest.approx(0.29887 * decade, abs=0.02)  # log10(0.2 / 0.1005)
        failed = places(0, ".failed", "x1", "x2")
        assert failed == [at, 100.0]  # a longer step fails: to the right end
        assert places(3, ".failed", "x2") == [0.0]  # a lighter body fails: to the left end
        assert places(3, ".held", "x1")[0] > places(3, ".held", "x2")[0]
        for k, none in ((2, ".failed"), (2, ".theory"), (4, ".failed"), (5, ".held")):
            assert visit.page.locator(f"#row-fourbar-stress-{k} {none}").count() == 0


def test_kinds_have_shapes_and_silent_failures_are_hollow(page: Path, browser: Any) -> None:
    with Visit(browser, page) as visit:
        marks = visit.run("findAll('#rows .dot').map((one) => one.getAttribute('d'))")
        names = ["o", "D", ">", "s", "X", "D"]
        assert marks == [MARKER_PATHS[name] for name in names]
        hollow = visit.run("findAll('#rows .dot').map((one) => one.classList.contains('hollow'))")
        assert hollow == [True, False, False, False, False, False]
        colours = visit.run("findAll('#rows .dot').map((one) => getComputedStyle(one).stroke)")
        assert len(set(colours)) == 5
        legend = visit.page.inner_text("#chart .legend")
        for look in KIND_LOOKS.values():
            assert look.words in legend


def test_hovering_shows_the_sentence_and_a_click_leads_to_the_row(page: Path, browser: Any) -> None:
    with Visit(browser, page) as visit:
        tip = visit.page.locator("#rows .tip")
        assert tip.is_hidden()
        row = visit.page.locator("#row-fourbar-stress-3")
        row.hover()
        assert describe_boundary(LIGHTER) in tip.inner_text()
        row.click()
        led = visit.page.locator("tr.led-to")
        assert led.get_attribute("id") == "fourbar-stress-3"
        assert "last body lighter" in led.inner_text()
        assert "pymunk" in led.inner_text()
        assert visit.run("document.activeElement.closest('tr').id") == "fourbar-stress-3"
        top = visit.run("find('tr.led-to').getBoundingClientRect().top")
        assert 0 < top < 900
        visit.page.mouse.move(2, 2)
        assert tip.is_hidden()


def test_the_keyboard_goes_from_limit_to_limit(page: Path, browser: Any) -> None:
    with Visit(browser, page) as visit:
        for _ in range(30):
            visit.page.keyboard.press("Tab")
            if visit.run("document.activeElement.className") == "row-list":
                break
        tip = visit.page.locator("#rows .tip")
        assert describe_boundary(STEP) in tip.inner_text()
        visit.page.keyboard.press("ArrowDown")
        active = visit.page.get_attribute(".row-list", "aria-activedescendant")
        assert active == "row-fourbar-stress-1"
        assert visit.page.get_attribute(f"#{active}", "aria-selected") == "true"
        assert describe_boundary(FAILED) in tip.inner_text()
        visit.page.keyboard.press("End")
        visit.page.keyboard.press("Enter")
        assert visit.page.get_attribute("tr.led-to", "id") == "fourbar-stress-5"


def test_case_and_parameter_are_kept_in_the_address(page: Path, browser: Any) -> None:
    with Visit(browser, page) as visit:
        visit.page.select_option("#subject", "")
        assert len(visit.run(ROWS_SCRIPT)) == 7
        visit.page.select_option("#panel", "time step [s]")
        rows = visit.run(ROWS_SCRIPT)
        assert [row.split(",")[0] for row in rows] == 3 * ["fourbar: MuJoCo"] + ["pendulum: MuJoCo"]
        visit.page.click("#filters [data-group='unstable']")
        assert len(visit.run(ROWS_SCRIPT)) == 3  # the same as in the table
        address = visit.address
        assert "case=all" in address
        assert "off=unstable" in address
    with Visit(browser, page, address) as visit:
        assert len(visit.run(ROWS_SCRIPT)) == 3
        assert visit.run("find('#panel').value") == "time step [s]"
    with Visit(browser, page, "#pendulum-stress") as visit:  # the address of the report's links
        assert [row.split(",")[0] for row in visit.run(ROWS_SCRIPT)] == ["MuJoCo"]


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_no_accessibility_violation(scheme: str, page: Path, browser: Any) -> None:
    with Visit(browser, page, color_scheme=scheme) as visit:
        visit.page.locator("#row-fourbar-stress-1").hover()
        wrong, met = visit.axe("#chart")
        assert wrong == []
        assert met > 10


def test_rows_have_one_column_on_a_phone(page: Path, browser: Any) -> None:
    with Visit(browser, page, viewport=PHONE) as visit:
        assert visit.run("document.documentElement.scrollWidth - innerWidth") <= 0
        row = "#row-fourbar-stress-0"
        label, strip = (
            visit.page.locator(f"{row} {part}").bounding_box() for part in (".row-label", ".strip")
        )
        assert strip["y"] >= label["y"] + label["height"] - 1
        assert strip["width"] > 250
        assert visit.small_text("#chart") == []


def test_markers_have_contrast_in_black_and_white(page: Path, browser: Any) -> None:
    """By lightness alone, markers have a contrast of at least 3 to their background."""
    for scheme in ("light", "dark"):
        with Visit(browser, page, color_scheme=scheme) as visit:
            paper = relative_luminance(
                visit.run("getComputedStyle(find('#chart')).backgroundColor")
            )
            for colour in visit.run(
                "findAll('#rows .dot').map((one) => getComputedStyle(one).stroke)"
            ):
                high, low = sorted([paper, relative_luminance(colour)], reverse=True)
                assert (high + 0.05) / (low + 0.05) >= 3.0


def relative_luminance(colour: str) -> float:
    """Relative luminance of ``rgb(…)``, as WCAG defines it."""
    parts = [int(part) / 255 for part in colour[4:-1].split(",")]
    linear = [p / 12.92 if p <= 0.04045 else ((p + 0.055) / 1.055) ** 2.4 for p in parts]
    return sum(w * p for w, p in zip((0.2126, 0.7152, 0.0722), linear, strict=True))


def test_without_javascript_the_tables_are_shown(page: Path, browser: Any) -> None:
    with Visit(browser, page, java_script_enabled=False) as visit:
        assert visit.page.locator("#chart").is_hidden()
        assert "The chart needs JavaScript" in visit.page.inner_text("main")
        assert visit.page.locator("#tables tbody tr").count() >= 7
