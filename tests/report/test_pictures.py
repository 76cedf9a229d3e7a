"""First screens of three pages beside stored pictures of them, by the light of coarse blocks.

All letters are drawn with the DejaVu fonts that Matplotlib brings, so that a machine's own fonts
change nothing.  What is left to differ are the edges of letters and lines: browsers smooth them in
ways of their own.
"""

from base64 import b64encode
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib import get_data_path
from PIL import Image

from benchmarks.pictures import few_colours, picture
from proofmass.diagnosis import Diagnosis, Explanation
from proofmass.report import write_report
from proofmass.report.record import Made
from proofmass.sidecar import load_case
from tests.report import index_rows
from tests.report.whole import whole_result, without_figures
from tests.shipped import shipped
from tests.visit import Visit

STORED = Path(__file__).parent.parent / "data" / "pictures"
NAMES = ("index", "agrees", "differs")
SIZE = 150_000  # bytes of a stored picture
BLOCK = 8  # pixels: a letter's stroke and its smoothed edges are in one
DIFFERS = 20.0  # of 255: the palette of a stored picture moves blocks of colour by up to that
SHARE = 2e-3  # of the blocks: letters set at whole pixels move 7e-4, the smallest failed plot 5e-3
FONTS = {"Page": "DejaVuSans", "Page bold": "DejaVuSans-Bold", "Page mono": "DejaVuSansMono"}
MADE = Made(
    date="2026-01-02T03:04:05+00:00",
    command="proofmass report models",
    commit="0123456789",
    versions={"proofmass": "0.1.0"},
    machine="a machine",
    processors=2,
)


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The index, a four-bar that agrees, and one that differs; nothing of them is of today."""
    folder = tmp_path_factory.mktemp("pictures")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(index_rows, "MADE", MADE)
        result = index_rows.whole_result()
        index = index_rows.write_index(folder, result, index_rows.last_record(result))
    case = load_case(shipped("fourbar.toml"))
    found = {"index": index}
    for name, off in (("agrees", 2.5e-13), ("differs", 0.02)):
        result = whole_result(case, off=off)
        if name == "differs":
            runs = [(case.name, run, "mujoco") for run in case.run]
            result = replace(result, diagnoses={key: diagnosis(*key) for key in runs})
        with without_figures():
            found[name] = write_report(result, folder / name).with_name("fourbar.html")
    return found


def diagnosis(*key: str) -> Diagnosis:
    """Two causes of five channels that differ."""
    names = ("pin.x", "pin.y", "rocker", "point.x", "point.y")
    longer = Explanation(
        "parameter", "rocker = 2.525 m instead of 2.5 m (+1 %)", names[:4], (), 1e-13, 5, 1,
        {"rocker": (2.5, 2.525)},
    )  # fmt: skip
    late = Explanation("shift", "pin.x late by 0.01 in x", names[:1], (), 0.1, 5, 2)
    return Diagnosis(
        *key, names, 5, (longer, late), ("sign", "unit"), ("2.525 stands in fourbar.xml, line 33",)
    )


def shot(browser: Any, page: Path, change: str = "") -> Image.Image:
    """The first screen with the fonts of Matplotlib, after a script has changed the page."""
    with Visit(browser, page, reduced_motion="reduce") as visit:
        visit.page.add_style_tag(content="".join(map(face, FONTS)) + LETTERS)
        visit.run(READY)
        if change:
            visit.run(change)
        return picture(visit.page)


def face(name: str) -> str:
    """A font for a style sheet, all of it: pages that lie on a disk may not read another folder."""
    file = Path(get_data_path()) / "fonts" / "ttf" / f"{FONTS[name]}.ttf"
    family, _, weight = name.partition(" ")
    bold, mono = weight == "bold", weight == "mono"
    return (
        f"@font-face {{ font-family: '{family}{' mono' if mono else ''}';"
        f" font-weight: {'600 900' if bold else '100 500'};"
        f" src: url(data:font/ttf;base64,{b64encode(file.read_bytes()).decode()}) }}"
    )


LETTERS = ":root { --sans: 'Page'; --mono: 'Page mono'; }"
READY = """async () => {
  await Promise.all([...document.fonts].map((font) => font.load()));
  await new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)));
  if (typeof drawAll === "function") drawAll();
  await new Promise((done) => setTimeout(done, 200));
}"""


def blocks(image: Image.Image) -> np.ndarray:
    """The mean light of each block of a picture."""
    light = np.asarray(image.convert("L"), float)
    rows, columns = (size // BLOCK for size in light.shape)
    cut = light[: rows * BLOCK, : columns * BLOCK]
    return cut.reshape(rows, BLOCK, columns, BLOCK).mean(axis=(1, 3))


def apart(one: Image.Image, other: Image.Image) -> float:
    """The share of the blocks that differ."""
    if one.size != other.size:
        return 1.0
    return float(np.mean(np.abs(blocks(one) - blocks(other)) > DIFFERS))


@pytest.mark.parametrize("name", NAMES)
def test_a_first_screen_is_as_it_was(
    name: str, pages: dict[str, Path], browser: Any, tmp_path: Path
) -> None:
    file = STORED / f"{name}.png"
    found = shot(browser, pages[name])
    if file.is_file() and apart(Image.open(file), found) <= SHARE:
        assert file.stat().st_size <= SIZE
        return
    new = tmp_path / file.name
    few_colours(found).save(new, optimize=True)
    pytest.fail(f"not the stored picture: if it is meant to look like {new}, copy that to {file}")


MUTATIONS = {
    "a missing plot": ("agrees", "find('#gap').replaceChildren()"),
    "a missing drawing": ("agrees", "find('#mechanism').replaceChildren()"),
    "a moved panel": ("agrees", "find('.notes').style.marginTop = '24px'"),
    "a missing panel": ("differs", "find('.cause').remove()"),
    "a missing bar": ("differs", "findAll('.cause .bar').forEach((bar) => bar.remove())"),
    "a missing row": ("index", "document.querySelector('tr[data-name=pendulum]').remove()"),
    "missing strips": (
        "index",
        "document.querySelectorAll('tbody .strip').forEach((strip) => strip.remove())",
    ),
}


@pytest.mark.parametrize(
    "words",
    [  # one of each page
        words
        if words in ("a missing plot", "a missing panel", "a missing row")
        else pytest.param(words, marks=pytest.mark.slow)
        for words in MUTATIONS
    ],
)
def test_a_first_screen_that_was_changed_is_told(
    words: str, pages: dict[str, Path], browser: Any
) -> None:
    name, change = MUTATIONS[words]
    changed = shot(browser, pages[name], change)
    assert apart(Image.open(STORED / f"{name}.png"), changed) > SHARE
