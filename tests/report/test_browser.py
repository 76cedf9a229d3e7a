"""The pages of cases in a browser: what they show, and that they fetch only their own files."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib import get_data_path, rc_context
from matplotlib.font_manager import findSystemFonts

from docs.make.pictures import launch
from proofmass.batch.check import Result
from proofmass.report import write_report
from proofmass.report.case_figures import find_motions, mechanism_poses
from proofmass.report.figures import save
from proofmass.report.mechanism import mechanism_figure
from proofmass.report.style import RC
from proofmass.run.asked import with_engines
from proofmass.run.sidecar import load_case
from proofmass.sim.engines import hosted_names
from proofmass.verdict.comparison import Comparison
from tests.report.whole import result_from_references, with_failed_dynamics, without_figures
from tests.shipped import shipped
from tests.visit import PHONE, Visit

CASE_NAMES = [
    "fourbar",
    "rod_cantilever",
    "balancer_sine",
    "slider_crank",
    "hacksaw_recorded",
    "pendulum",
]
MAX_LOAD_TIME = 2000  # [ms] largest load time of a page, on a busy machine; 0.3 s are usual


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Pages of six cases: the slider-crank differs, the pendulum fails.

    The static figures, which the scripts do not draw, are left out of most pages to save time.
    """
    cases = {name: load_case(shipped(f"{name}.toml")) for name in CASE_NAMES}
    offs = {"rod_cantilever": 1e-4, "slider_crank": 0.02}
    parts = [result_from_references(case, off=offs.get(n, 1e-13)) for n, case in cases.items()]
    result = Result(cases=list(cases.values()))
    for part in parts:
        result.comparisons.extend(part.comparisons)
        result.curves.update(part.curves)
    rows = [replace(c, **FAILED_FIELDS) if c.case == "pendulum" else c for c in result.comparisons]
    curves = {key: curve for key, curve in result.curves.items() if key[0] != "pendulum"}
    out = tmp_path_factory.mktemp("browser")
    with without_figures("rod_cantilever"):
        write_report(replace(result, comparisons=rows, curves=curves), out)
    return out


FAILED_FIELDS: dict[str, Any] = {
    **{name: float("nan") for name in ("error_max", "at", "error_rms", "nrmse", "error_later")},
    "detectable": {},
    "outcome": "diverged",
    "message": "the state is not finite",
}
assert set(FAILED_FIELDS) <= set(Comparison.__dataclass_fields__)


class CaseVisit(Visit):
    """The page of a case, whose mechanism does not move by itself."""

    def __init__(self, browser: Any, file: Path, address: str = "", **options: Any) -> None:
        super().__init__(browser, file, address, **{"reduced_motion": "reduce", **options})

    def plot(self, place: str) -> dict[str, float]:
        """The rectangle of a plot on the screen, after the page was scrolled to it."""
        found = self.page.locator(f"{place} .u-over")
        found.scroll_into_view_if_needed()
        return dict(found.bounding_box())


@pytest.mark.parametrize("name", CASE_NAMES)
def test_pages_log_nothing_and_fetch_only_local_files(
    name: str, folder: Path, browser: Any
) -> None:
    with CaseVisit(browser, folder / f"{name}.html") as visit:
        assert visit.said == []
        assert all(url.startswith(folder.as_uri()) for url in visit.asked)
        timing = "performance.getEntriesByType('navigation')[0].loadEventEnd"
        assert visit.run(timing) < MAX_LOAD_TIME
        failed = name == "pendulum"
        assert visit.run("find('#curves').hidden") == failed
        assert visit.page.locator("#above canvas").count() == (0 if failed else 1)
        overflow = visit.run("document.documentElement.scrollWidth - innerWidth")
        assert overflow <= 0


@pytest.mark.parametrize("name", CASE_NAMES[:-1])
def test_every_channel_of_every_run_can_be_shown(name: str, folder: Path, browser: Any) -> None:
    with CaseVisit(browser, folder / f"{name}.html") as visit:
        count = visit.run(SHOW_ALL_CHANNELS)
        assert count >= 4
        assert visit.run(FIND_INVALID_TEXT) is None
        assert visit.said == []


SHOW_ALL_CHANNELS = """() => {
  let count = 0;
  for (const run of runs()) {
    choose(run.kind);
    drawAll();
    for (const { name } of ordered(run)) {
      chooseChannel(name);
      MODES.forEach(chooseMode);
      count += 1;
    }
    for (const solver of solversOf(run)) {
      state.solver = solver;
      drawGap();
      [0, Math.floor(run.x.length / 2), run.x.length - 1].forEach((sample) => goTo(sample));
    }
  }
  return count;
}"""
FIND_INVALID_TEXT = "find('main').innerText.match(/NaN|undefined|null|Infinity|object Object/)"


def test_a_page_says_which_runs_failed_and_why(folder: Path, browser: Any) -> None:
    with CaseVisit(browser, folder / "pendulum.html") as visit:
        text = visit.page.inner_text("main")
        assert "runs diverged" in text
        assert "the state is not finite" in text


def test_a_failed_run_is_drawn_until_its_failure(browser: Any, tmp_path: Path) -> None:
    case = load_case(shipped("fourbar.toml"))
    with without_figures():
        write_report(with_failed_dynamics(case, result_from_references(case), "mujoco"), tmp_path)
    with CaseVisit(browser, tmp_path / "fourbar.html") as visit:
        assert visit.run("[state.run, state.solver]") == ["dynamics", "mujoco"]
        assert "pin.x left the tolerance first" in visit.page.inner_text(".cause").lower()
        chip = visit.page.locator("#chips [data-solver='mujoco']")
        assert chip.is_enabled()
        drawn = "pair.plots[0].data[2].filter((value) => value !== null).length"
        assert visit.run(drawn) == 100
        failure_note = visit.page.inner_text("#failed")
        assert "MuJoCo is drawn until 1.7" in failure_note
        assert visit.run(HAS_INK_AT_FAILURE)
        chip.click()  # switches the failed curve off, and its mark with it
        assert not visit.run(HAS_INK_AT_FAILURE)
        assert visit.run(FIND_INVALID_TEXT) is None
        assert visit.said == []


HAS_INK_AT_FAILURE = """() => {
  const plot = pair.plots[0];
  const across = Math.round(plot.valToPos(current().xs[99], "x", true));
  const { top, height } = plot.bbox;
  const ink = plot.ctx.getImageData(across - 1, top + height - 60, 3, 50).data;
  const wanted = variable("--s0");
  const [r, g, b] = [1, 3, 5].map((at) => parseInt(wanted.slice(at, at + 2), 16));
  for (let i = 0; i < ink.length; i += 4) {
    const near = Math.abs(ink[i] - r) + Math.abs(ink[i + 1] - g) + Math.abs(ink[i + 2] - b);
    if (near < 60 && ink[i + 3] > 60) return true;
  }
  return false;
}"""


@pytest.fixture(scope="module")
def snap_page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of a rod that snaps; in pymunk it snaps one sample later than in the reference.

    To save time the rod has 10 links, the sweep has 22 samples, and views and charts are left out.
    """
    case, out = load_case(shipped("rod_snap.toml")), tmp_path_factory.mktemp("snap")
    rods = {"rod": case.rod["rod"].model_copy(update={"segments": 10})}
    runs = {"sweep": case.run["sweep"].model_copy(update={"n": 22})}
    case = case.model_copy(update={"rod": rods, "run": runs, "view": (), "chart": ()})
    result = result_from_references(case, off=1e-4)
    key = (case.name, "sweep", "pymunk")
    late = {}
    for name, curve in result.curves[key].channels.items():
        late[name] = curve.copy()
        late[name][SAMPLE_AFTER_SNAP] = curve[SAMPLE_AFTER_SNAP - 1]
    curves = {**result.curves, key: replace(result.curves[key], channels=late)}
    with without_figures():
        write_report(replace(result, curves=curves), out)
    return out / "rod_snap.html"


SAMPLE_AFTER_SNAP = 8  # the first sample after the first snap of the reference


def test_a_mechanism_is_drawn_on_both_sides_of_its_snaps(snap_page: Path, browser: Any) -> None:
    with CaseVisit(browser, snap_page, "#sweep/mujoco:settled/energy@0") as visit:
        shapes = visit.run(READ_ROD_SHAPES)
        assert len(shapes) == 22
        for shape in shapes:
            assert shape["pale"]
            assert shape["drawn"]
            assert "only" not in shape["words"]
            assert "no pose" not in shape["words"]
        sides = ["up" if shape["middle"] < shape["ends"] else "down" for shape in shapes]
        assert sides == 8 * ["up"] + 11 * ["down"] + 3 * ["up"]
        reference_note = visit.page.inner_text("#ghost")
        assert (
            "jumps to another equilibrium between 0.6667 s and 0.7619 s and between"
            in reference_note
        )
        late = visit.run(READ_ROD_SHAPES.replace("mujoco:settled", "pymunk"))
        # pymunk snaps one sample later
        assert late[SAMPLE_AFTER_SNAP]["middle"] < late[SAMPLE_AFTER_SNAP]["ends"]
        assert late[SAMPLE_AFTER_SNAP + 1]["middle"] > late[SAMPLE_AFTER_SNAP + 1]["ends"]
        assert visit.said == []


READ_ROD_SHAPES = """() => {
  state.solver = "mujoco:settled";
  return current().x.map((_, sample) => {
    goTo(sample);
    const paths = ["pale", "drawn"].map((name) => find(`.m-${name} > .m-rod`).getAttribute("d"));
    const places = paths[1].slice(1).split("L").map((place) => Number(place.split(" ")[1]));
    return {
      pale: paths[0].length,
      drawn: paths[1].length,
      middle: places[Math.floor(places.length / 2)],
      ends: places[0],
      words: find("#mechanism-scale").textContent,
    };
  });
}"""


def test_curves_are_interrupted_where_they_jump(snap_page: Path, browser: Any) -> None:
    with CaseVisit(browser, snap_page, "#sweep/pymunk/tip.angle@0;on=pymunk") as visit:
        assert visit.run("current().channels['tip.angle'].jumps") == [7, 18]
        assert visit.run("current().solvers.pymunk.jumps['tip.angle']") == [8, 18]
        jump_note = visit.page.inner_text("#thinned")
        assert "The reference jumps between 0.6667 s and 0.7619 s and between 1.714 s" in jump_note
        assert "pymunk jumps between 0.7619 s and 0.8571 s and" in jump_note
        assert jump_note.strip() in visit.run("find('#above').getAttribute('aria-label')")
        moves = "find('#option-tip\\\\.angle path').getAttribute('d').split('M').length - 1"
        assert visit.run(moves) == 3
        assert visit.said == []
        # Between two samples before the snap there is ink of both curves.  At the snap of the
        # reference, after sample 7, only the dots of its vertical line are half-way, and pymunk,
        # which snaps after sample 8, still has a curve there.
        assert visit.run(f"({HAS_INK_BETWEEN})(5, '--pale')")
        assert visit.run(f"({HAS_INK_BETWEEN})(5, '--s1')")
        assert not visit.run(f"({HAS_INK_BETWEEN})(7, '--pale')")
        assert visit.run(f"({HAS_INK_BETWEEN})(7, '--s1')")
        assert not visit.run(f"({HAS_INK_BETWEEN})(8, '--s1')")


HAS_INK_BETWEEN = """(sample, name) => {
  const plot = pair.plots[0];
  const [one, two] = [0.2, 0.4].map((share) => {
    const { xs } = current();
    return Math.round(plot.valToPos(xs[sample] + share * (xs[sample + 1] - xs[sample]), "x", true));
  });
  const { top, height } = plot.bbox;
  const ink = plot.ctx.getImageData(one, top, two - one, height).data;
  const wanted = variable(name);
  const parts = [1, 3, 5].map((at) => parseInt(wanted.slice(at, at + 2), 16));
  for (let i = 0; i < ink.length; i += 4) {
    if (parts.every((part, k) => Math.abs(ink[i + k] - part) < 12) && ink[i + 3] > 200) return true;
  }
  return false;
}"""


def test_a_page_that_differs_opens_at_a_channel_that_differs(folder: Path, browser: Any) -> None:
    with CaseVisit(browser, folder / "slider_crank.html") as visit:
        assert "Differs" in visit.page.inner_text(".badge")
        assert visit.run("state.run") == "sweep"
        first = visit.page.locator("#list [role=option]").first
        assert "✗" in first.inner_text()
        assert visit.run("ordered(current())[0].ratio") > 1


def test_the_scrub_bar_moves_plots_and_mechanism(folder: Path, browser: Any) -> None:
    with CaseVisit(browser, folder / "fourbar.html", "#sweep/mujoco/pin.x@0") as visit:
        line = "find('.scrub-line').style.transform"
        crank = "findAll('.m-drawn > g')[0].getAttribute('transform')"
        before = visit.run(line), visit.run(crank)
        visit.page.evaluate(
            "const bar = find('#scrub'); bar.value = 90; bar.dispatchEvent(new Event('input'))"
        )
        assert visit.run("state.sample") == 90
        after = visit.run(line), visit.run(crank)
        assert after[0] != before[0]
        turn = float(after[1].split("rotate(")[1].rstrip(")"))
        assert turn == pytest.approx(-90, abs=0.01)  # 16 bits for a turn; screens count downwards
        assert visit.address == "#sweep/mujoco/pin.x@1.5708"
        assert visit.page.inner_text("#position") == "90°"
        visit.page.keyboard.press("ArrowRight")
        assert visit.run("state.sample") == 91


@pytest.fixture(params=["DejaVu Sans", "Liberation Sans", "Noto Sans"])
def one_font(
    request: pytest.FixtureRequest, browser: Any, tmp_path: Path
) -> Iterator[tuple[str, Any]]:
    """A family of fonts, and a browser that has no other; skipped if the system does not have it.

    DejaVu Sans comes with matplotlib.
    """
    family = request.param
    own = Path(get_data_path()) / "fonts" / "ttf"
    everywhere = [*own.glob("*.ttf"), *map(Path, findSystemFonts())]
    files = [file for file in everywhere if file.stem == f"{family.replace(' ', '')}-Regular"]
    files += [file for file in own.glob("DejaVuSans.ttf") if family == "DejaVu Sans"]
    if not files:
        pytest.skip(f"{family} is not installed")
    (tmp_path / "fonts").mkdir()
    (tmp_path / "fonts" / files[0].name).symlink_to(files[0])
    config = tmp_path / "fonts.conf"
    config.write_text(
        f"<fontconfig><dir>{tmp_path / 'fonts'}</dir>"
        f"<cachedir>{tmp_path / 'cache'}</cachedir></fontconfig>"
    )
    alone = launch(browser.browser_type, FONTCONFIG_FILE=str(config))
    yield family, alone
    alone.close()


def fonts_of(visit: Visit, selector: str) -> set[str]:
    """The families of fonts that the browser draws an element with."""
    session = visit.page.context.new_cdp_session(visit.page)
    for domain in ("DOM", "CSS"):
        session.send(f"{domain}.enable")
    root = session.send("DOM.getDocument")["root"]["nodeId"]
    node = session.send("DOM.querySelector", {"nodeId": root, "selector": selector})["nodeId"]
    found = session.send("CSS.getPlatformFontsForNode", {"nodeId": node})["fonts"]
    return {one["familyName"] for one in found}


def test_no_label_of_the_mechanism_covers_another(folder: Path, one_font: tuple[str, Any]) -> None:
    """The heights of lines differ by a fifth between these fonts; their widths, too."""
    family, alone = one_font
    with CaseVisit(alone, folder / "hacksaw_recorded.html") as visit:
        assert fonts_of(visit, ".m-names text") == {family}
        covered, hidden = visit.run(COUNT_COVERED_LABELS)
        assert covered == 0
        assert hidden > 0  # otherwise no label was near another


@pytest.fixture(scope="module")
def figure_page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A page with the figure of a mechanism whose names have little room, and nothing else."""
    case = load_case(shipped("hacksaw_recorded.toml"))
    motions, _ = find_motions(case, [])
    shape = mechanism_poses(case, motions)
    place = tmp_path_factory.mktemp("figure")
    with rc_context(RC):
        svg = save(mechanism_figure(case, shape, {}), place / "figure", png=False)
    page = place / "figure.html"
    page.write_text(f"<!doctype html><meta charset='utf-8'>{svg}", encoding="utf-8")
    return page


def test_no_name_in_the_figure_of_the_mechanism_covers_another(
    figure_page: Path, one_font: tuple[str, Any]
) -> None:
    """The figure is placed with DejaVu Sans; a browser without it has narrower letters."""
    family, alone = one_font
    with Visit(alone, figure_page) as visit:
        assert fonts_of(visit, "text") == {family}
        count, covered = visit.run(COUNT_COVERED_NAMES)
        assert count > 20
        assert covered == []


COUNT_COVERED_NAMES = """() => {
  const texts = [...document.querySelectorAll("text")].filter((one) => !one.getScreenCTM().b);
  const boxes = texts.map((one) => {
    const { left, right } = one.getBoundingClientRect();
    const { d, f } = one.getScreenCTM();
    const base = f + d * one.getStartPositionOfChar(0).y;
    const size = d * parseFloat(getComputedStyle(one).fontSize);
    return { left, right, top: base - 0.76 * size, bottom: base + 0.24 * size }; // its ink
  });
  const covered = [];
  boxes.forEach((one, k) => boxes.slice(0, k).forEach((other, j) => {
    const across = Math.min(one.right, other.right) - Math.max(one.left, other.left);
    const down = Math.min(one.bottom, other.bottom) - Math.max(one.top, other.top);
    if (across > 0 && down > 0) covered.push([texts[k].textContent, texts[j].textContent]);
  }));
  return [texts.length, covered];
}"""


COUNT_COVERED_LABELS = """() => {
  let [covered, hidden] = [0, 0];
  for (let sample = 0; sample < current().x.length; sample += 10) {
    goTo(sample);
    const texts = [...document.querySelectorAll(".m-names text")];
    const seen = texts.filter((one) => one.style.visibility !== "hidden");
    const boxes = seen.map((one) => one.getBBox());
    hidden += texts.length - boxes.length;
    boxes.forEach((one, k) => boxes.slice(0, k).forEach((other) => {
      const across = Math.min(one.x + one.width, other.x + other.width) - Math.max(one.x, other.x);
      const down = Math.min(one.y + one.height, other.y + other.height) - Math.max(one.y, other.y);
      covered += across > 0.1 && down > 0.1;  // places are rounded to tenths
    }));
  }
  return [covered, hidden];
}"""


def test_pointing_at_a_plot_moves_the_mechanism(folder: Path, browser: Any) -> None:
    with CaseVisit(browser, folder / "fourbar.html", "#dynamics/mujoco/pin.x@0") as visit:
        box = visit.plot("#above")
        visit.page.mouse.move(box["x"] + box["width"] / 2, box["y"] + 40)
        assert visit.run("state.sample") == pytest.approx(180, abs=2)
        lines = visit.run("findAll('.u-cursor-x').map((line) => line.style.transform)")
        assert len(lines) == 2
        assert len(set(lines)) == 1  # both plots show the same place


def test_dragging_zooms_both_plots_and_the_address_keeps_it(folder: Path, browser: Any) -> None:
    file = folder / "fourbar.html"
    with CaseVisit(browser, file, "#dynamics/pymunk/pin.x@1") as visit:
        box = visit.plot("#below")
        visit.page.mouse.move(box["x"] + 100, box["y"] + 60)
        visit.page.mouse.down()
        visit.page.mouse.move(box["x"] + 300, box["y"] + 60, steps=4)
        visit.page.mouse.up()
        scales = visit.run("pair.plots.map((plot) => [plot.scales.x.min, plot.scales.x.max])")
        assert scales[0] == scales[1]
        low, high = scales[0]
        assert 0 < low < high < 6
        address = visit.address
        assert ";z=" in address
    with CaseVisit(browser, file, address) as visit:
        again = visit.run("pair.plots.map((plot) => [plot.scales.x.min, plot.scales.x.max])")
        assert again[0] == pytest.approx([low, high], rel=1e-5)
        visit.page.keyboard.press("0")
        assert ";z=" not in visit.address


def test_solvers_can_be_switched_off_and_axes_changed(folder: Path, browser: Any) -> None:
    with CaseVisit(browser, folder / "fourbar.html", "#dynamics/mujoco/pin.x@1") as visit:
        count = "pair.plots[0].series.length"
        before = visit.run(count)
        visit.page.click("#chips [data-solver='pymunk']")
        assert visit.run(count) == before - 1
        assert ";on=mujoco" in visit.address
        visit.page.keyboard.press("l")
        assert ";log" in visit.address
        assert visit.run("pair.plots[1].scales.y.distr") == 3
        visit.page.keyboard.press("l")
        assert "reference / allowed" in visit.page.inner_text("#difference-title")


def test_an_address_opens_its_channel(folder: Path, browser: Any) -> None:
    address = "#dynamics/pymunk/pin.x@3.25;log;m=6"
    with CaseVisit(browser, folder / "fourbar.html", address) as visit:
        assert visit.page.inner_text("#channel") == "pin.x"
        assert visit.run("[state.run, state.solver, state.mode, state.power]") == [
            "dynamics",
            "pymunk",
            "log",
            6,
        ]
        assert visit.run("current().x[state.sample]") == pytest.approx(3.25, abs=0.01)
        visit.page.click(".sum td a >> nth=0")
        assert visit.address.startswith("#sweep/mujoco/")


def test_keys_choose_channel_run_and_sample(folder: Path, browser: Any) -> None:
    with CaseVisit(browser, folder / "fourbar.html", "#sweep/mujoco/pin.x@1.5707963") as visit:
        assert visit.page.inner_text("#reference-value").endswith("m at 90°")
        visit.page.focus("#list")
        names = visit.run("ordered(current()).map((one) => one.name)")
        place = names.index("pin.x")
        visit.page.keyboard.press("ArrowUp" if place else "ArrowDown")
        assert visit.run("state.channel") == names[place - 1 if place else 1]
        visit.page.focus("#tab-sweep")
        visit.page.keyboard.press("ArrowRight")
        assert visit.run("[state.run, document.activeElement.id]") == ["dynamics", "tab-dynamics"]
        visit.page.keyboard.press("r")
        assert visit.run("state.run") == "sweep"
        visit.page.keyboard.press("2")
        assert ";on=mujoco" in visit.address


def test_differences_are_magnified(folder: Path, browser: Any) -> None:
    with CaseVisit(browser, folder / "slider_crank.html", "#sweep/mujoco/slider.x@1") as visit:
        slide = "findAll('.m-drawn > g')[2].getAttribute('transform')"
        plain = visit.run(slide)
        visit.page.evaluate(
            "const bar = find('#magnification'); bar.value = 1;"
            " bar.dispatchEvent(new Event('input'))"
        )
        assert visit.page.inner_text("#magnification-words") == "×10"
        assert visit.run(slide) != plain
        across = [float(text.split("(")[1].split()[0]) for text in (plain, visit.run(slide))]
        run = "data.runs.sweep.solvers.mujoco.differences['slider.x'][state.sample]"
        scale = visit.run("mechanism().scale")
        # ten times the difference instead of once is nine times more
        assert across[1] - across[0] == pytest.approx(9 * scale * visit.run(run), rel=0.02)


def test_a_rod_in_equilibrium_is_drawn_from_its_curves(folder: Path, browser: Any) -> None:
    with CaseVisit(browser, folder / "rod_cantilever.html") as visit:
        assert visit.run("mechanism().curves.rods.length") == 1
        assert visit.page.locator(".m-dot").count() == 1
        assert "rods of the reference" in visit.page.inner_text("#ghost")


def test_a_mechanism_in_space_is_drawn_without_differences(browser: Any, tmp_path: Path) -> None:
    with without_figures():
        write_report(result_from_references(load_case(shipped("spherical_fourbar.toml"))), tmp_path)
    with CaseVisit(browser, tmp_path / "spherical_fourbar.html") as visit:
        assert visit.page.inner_text("#mechanism-scale") == "to scale, without differences"
        assert "seen along x" in visit.page.inner_text("#ghost")


def test_twelve_engines_need_no_sideways_scrolling(browser: Any, tmp_path: Path) -> None:
    """Their table scrolls in its card, whose words for readers of screens do not widen the page."""
    names = ["mujoco", "pymunk", *hosted_names()][:12]
    with without_figures():
        case = with_engines(load_case(shipped("fourbar.toml")), names)
        write_report(result_from_references(case), tmp_path)
    with CaseVisit(browser, tmp_path / "fourbar.html") as visit:
        assert visit.run("find('.sum').scrollWidth - find('.sum').clientWidth") > 0
        assert visit.run("document.documentElement.scrollWidth - innerWidth") <= 0


@pytest.mark.parametrize("name", ["fourbar", "hacksaw_recorded", "pendulum"])
def test_a_phone_needs_no_sideways_scrolling(name: str, folder: Path, browser: Any) -> None:
    with CaseVisit(browser, folder / f"{name}.html", viewport=PHONE) as visit:
        assert visit.run("document.documentElement.scrollWidth - innerWidth") <= 0
        assert visit.small_text("main", "one.offsetParent && !one.closest('.paper')") == []


@pytest.mark.parametrize(
    ("name", "scheme"),
    [
        ("rod_cantilever", "light"),
        ("rod_cantilever", "dark"),
        pytest.param("fourbar", "light", marks=pytest.mark.slow),
        pytest.param("fourbar", "dark", marks=pytest.mark.slow),
        pytest.param("slider_crank", "dark", marks=pytest.mark.slow),
        pytest.param("pendulum", "light", marks=pytest.mark.slow),
    ],
)
def test_axe_finds_no_accessibility_violation(
    name: str, scheme: str, folder: Path, browser: Any
) -> None:
    with CaseVisit(browser, folder / f"{name}.html", color_scheme=scheme) as visit:
        visit.run("findAll('.more > details').forEach((one) => one.setAttribute('open', ''))")
        dark = scheme == "dark"  # only colours differ
        wrong, met = visit.axe(options="{runOnly: ['color-contrast']}" if dark else "{}")
        assert wrong == []
        assert met > (0 if dark else 15)


def luminance(colour: str) -> float:
    """The relative luminance of a colour #rrggbb, as WCAG 2.2 defines it."""
    levels = [int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5)]
    linear = [x / 12.92 if x <= 0.04045 else ((x + 0.055) / 1.055) ** 2.4 for x in levels]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def test_dark_pages_have_a_dark_background_and_light_curves(folder: Path, browser: Any) -> None:
    for scheme, dark in (("light", False), ("dark", True)):
        with CaseVisit(browser, folder / "fourbar.html", color_scheme=scheme) as visit:
            paper = visit.run("getComputedStyle(document.body).backgroundColor")
            levels = [int(part) for part in paper[4:-1].split(",")]
            assert (max(levels) < 60) == dark
            colours = visit.run("Object.values(data.solvers).map((s) => variable(`--${s.css}`))")
            assert colours
            inks = [luminance(colour) + 0.05 for colour in colours]
            card = luminance(visit.run("variable('--card')")) + 0.05
            # WCAG 2.2, 1.4.3: names of the engines have these colours too, so 4.5 and not 3
            assert all((ink / card if dark else card / ink) >= 4.5 for ink in inks)


def test_a_page_prints_on_three_sheets_or_more(folder: Path, browser: Any) -> None:
    with CaseVisit(browser, folder / "fourbar.html") as visit:
        printed = visit.page.pdf(format="A4", print_background=True)
        assert printed.startswith(b"%PDF")
        assert printed.count(b"/Type /Page\n") + printed.count(b"/Type /Page ") >= 3


def test_tables_are_shown_without_javascript(folder: Path, browser: Any) -> None:
    with CaseVisit(browser, folder / "fourbar.html", java_script_enabled=False) as visit:
        assert visit.page.locator(".sum td a").count() > 5
        visit.page.locator("details.numbers > summary").first.click()
        assert "worst error" in visit.page.locator("details.numbers").first.inner_text()
        assert "need JavaScript" in visit.page.inner_text("main")


def test_a_channel_has_one_unit_and_a_switch_turns_all_angles(folder: Path, browser: Any) -> None:
    """Curve, difference, largest error and what is allowed are in degrees, or all in radians."""
    with CaseVisit(browser, folder / "fourbar.html", "#sweep/mujoco/coupler.angle@1") as visit:

        def shown() -> dict[str, Any]:
            return visit.run(
                """(() => {
                    const c = comparison("mujoco");
                    const reference = find("#reference-value").textContent;
                    return {
                        value: parseFloat(reference.replace("−", "-")),
                        units: [reference.split(" ")[1],
                            find("#chips [data-solver=mujoco] output").textContent.split(" ").pop(),
                            find("#difference-title").textContent.match(/\\\\[(.*)\\\\]/)[1],
                            find("#list [aria-selected=true] .item-name span").textContent],
                        error: c.error, allowed: c.allowed, x: pair.plots[0].data[0].at(-1),
                        told: find("#reasons p").textContent,
                    };
                })()""".replace("\\\\", "\\")
            )

        degrees = shown()
        assert set(degrees["units"]) == {"deg"}
        visit.page.click("#angles [data-angles=rad]")
        radians = shown()
        assert set(radians["units"]) == {"rad"}
        assert " rad at " in radians["told"]
        for key in ("error", "allowed", "x"):
            assert degrees[key] == pytest.approx(np.degrees(radians[key]), rel=1e-9)
        assert degrees["value"] == pytest.approx(np.degrees(radians["value"]), rel=1e-3)
        assert visit.address.endswith(";rad")
        visit.page.click("#angles [data-angles=deg]")
        assert shown() == degrees
        assert ";rad" not in visit.address
    with CaseVisit(browser, folder / "fourbar.html", "#sweep/mujoco/pin.x@1;rad") as visit:
        assert visit.run("state.radians")
        assert visit.run("current().unit") == "rad"
