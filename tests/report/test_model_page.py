"""The page of a model without a sidecar: findings with their lines and marks, steps, modes."""

import re
from html import unescape
from pathlib import Path

import mujoco
import numpy as np
import pytest

from proofmass.batch.check import Result
from proofmass.report import write_report
from proofmass.report.model_drawing import draw_model
from proofmass.screen.finding import NamedElement
from proofmass.screen.screen import screen_model
from proofmass.sim.model_source import ModelSource
from proofmass.verdict.comparison import Comparison
from tests.visit import PHONE, Visit

DATA = Path(__file__).parents[1] / "data"
MODELS = {
    "pd954": DATA / "screen" / "pd954.xml",
    "rods/jansen": DATA / "threads" / "jansen613.xml",
    "boom114": DATA / "threads" / "boom114.xml",
}
STANDS = '<mujoco><worldbody><body name="&lt;b&gt;"><geom size=".1"/></body></worldbody></mujoco>'


def result_on(models):
    """The result of a check of models without sidecars, without their runs."""
    rows = [
        Comparison(name, "mujoco", "dynamics", "", "", outcome="self-consistent", message="until 1")
        for name in models
    ]
    screens = {name: screen_model(file) for name, file in models.items()}
    return Result(comparisons=rows, screens=screens)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("models")
    still = place / "a <b>.xml"
    still.write_text(STANDS, encoding="utf-8")
    write_report(result_on(MODELS | {"a <b>": still}), place / "report")
    return place / "report"


def text_of(page):
    """The text of a page without its elements."""
    return re.sub(r"\s+", " ", unescape(re.sub("<[^>]+>", " ", page.read_text(encoding="utf-8"))))


@pytest.mark.parametrize(
    ("name", "line"),
    [
        ("pd954", 'pd954.xml, line 3: <body name="b"'),
        ("rods,jansen", "jansen613.xml, line 8: <equality><connect"),
    ],
)
def test_a_page_begins_with_the_worst_finding_and_has_its_line(folder, name, line):
    found = screen_model(MODELS[name.replace(",", "/")]).findings
    text = text_of(folder / f"{name}.html")
    answer = f"{found[0].text[0].upper()}{found[0].text[1:]}."
    assert answer in text
    assert text.index(answer) < text.index("What is wrong, and what to do") < text.index(line)
    for finding in found:
        assert finding.text in text
        assert re.sub(r"\s+", "", finding.remedy) in re.sub(r"\s+", "", text)


def test_the_index_leads_to_each_page(folder):
    index = (folder / "index.html").read_text(encoding="utf-8")
    for name in ("pd954.html", "rods,jansen.html", "a~20~3cb~3e.html"):
        assert f'<a href="{name}">' in index
        assert (folder / name).exists()


def test_names_of_a_stranger_are_no_elements_of_the_page(folder):
    page = (folder / "a~20~3cb~3e.html").read_text(encoding="utf-8")
    assert "<b>" not in page
    assert "a <b>" in unescape(page)


def test_bars_of_steps_are_shares_of_the_limits(folder):
    page = (folder / "pd954.html").read_text(encoding="utf-8")
    rows = re.findall(r'class="bar is-(\w+)" style="--w: ([\d.]+)%"', page)
    steps = screen_model(MODELS["pd954"]).steps
    assert len(rows) == len(steps.limits)
    shares = [steps.own / limit for limit in steps.limits.values()]
    shares[0] = steps.ratio
    for (state, width), share in zip(rows, shares, strict=True):
        assert float(width) == pytest.approx(min(75.0 * share, 100.0), abs=0.06)
        assert (state == "unstable") == (share > 1.0)


def marks_of(svg):
    """The texts of the marks and their places."""
    found = re.findall(
        r'class="mark" transform="translate\(([\d.]+) ([\d.]+)\)".*?>(\d[\d ]*)<', svg
    )
    return {text: np.array([float(x), float(y)]) for x, y, text in found}


def test_marks_lie_at_their_elements_in_the_scale_of_the_drawing():
    elements = [NamedElement("joint", name) for name in ("crank", "rocker", "coupler")]
    marks = marks_of(draw_model(ModelSource(DATA / "threads" / "weld2729.xml"), elements).svg)
    # a square of 1 m and 2 m: the coupler's joint is above the crank's, the rocker's beside it
    up, along = marks["3"] - marks["1"], marks["2"] - marks["1"]
    assert up[0] == pytest.approx(0.0, abs=0.2)
    assert along[1] == pytest.approx(0.0, abs=0.2)
    assert along[0] == pytest.approx(-2.0 * up[1], abs=0.3)


def test_a_model_is_drawn_in_whatever_form_it_is_read(tmp_path):
    robot = tmp_path / "arm.urdf"
    robot.write_text("""<robot name="arm"><link name="base"/><link name="tip"><inertial>
      <mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
      <collision><geometry><mesh filename="package://x/none.stl"/></geometry></collision></link>
      <joint name="j" type="continuous"><parent link="base"/><child link="tip"/>
      <axis xyz="0 1 0"/></joint></robot>""")
    compiled = tmp_path / "pd954.mjb"
    model = mujoco.MjModel.from_xml_path(str(MODELS["pd954"]))
    mujoco.mj_saveModel(model, str(compiled), None)
    assert draw_model(ModelSource(robot), []).svg.startswith("<svg")
    drawn = draw_model(ModelSource(MODELS["pd954"]), [])
    assert draw_model(ModelSource(compiled), []).svg == drawn.svg.replace(".xml", ".mjb")


def test_marks_at_one_place_are_one_mark():
    twice = [NamedElement("connect", "loop"), None, NamedElement("connect", "loop")]
    assert list(marks_of(draw_model(ModelSource(MODELS["rods/jansen"]), twice).svg)) == ["1 3"]


def test_an_element_without_a_place_has_no_mark():
    elements = [NamedElement("sensor", "a"), NamedElement("joint", "none"), None]
    assert not marks_of(draw_model(ModelSource(MODELS["pd954"]), elements).svg)


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_a_page_is_accessible_and_fits_a_phone(folder, browser, scheme):
    with Visit(browser, folder / "boom114.html", viewport=PHONE, color_scheme=scheme) as visit:
        wrong, met = visit.axe()
        assert wrong == []
        assert met > 10
        assert visit.run("document.documentElement.scrollWidth - innerWidth") <= 0
