"""First screens of three pages compared with stored pictures by the brightness of blocks.

All letters are drawn with the DejaVu fonts of Matplotlib, so that the fonts of the machine have no
influence.  Only the edges of letters and lines may still differ, since each browser smooths them in
its own way; the mean brightness of a block hardly depends on that.
"""

from base64 import b64encode
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib import get_data_path
from PIL import Image

from docs.make.pictures import few_colours, picture
from proofmass.case.case import Case
from proofmass.evidence.diagnosis import Diagnosis, Explanation, Fault
from proofmass.reference import compared_with
from proofmass.report import case_page, write_report
from proofmass.report.record import Made
from proofmass.run.sidecar import load_case
from tests.report import index_rows
from tests.report.whole import result_from_references, without_figures
from tests.shipped import shipped
from tests.visit import Visit

STORED = Path(__file__).parent.parent / "data" / "pictures"
PICTURE_NAMES = ("index", "agrees", "differs")
MAX_PICTURE_SIZE = 150_000  # [bytes] largest size of a stored picture
BLOCK_SIZE = 8  # [pixels] side of a block, which contains a letter's stroke with its smoothed edges
# Two blocks differ if their mean brightness, from 0 to 255, differs by more.  The palette of a
# stored picture changes coloured blocks by up to 20.
BLOCK_TOLERANCE = 20.0
# Largest share of blocks that may differ: letters at whole pixels change 7e-4 of them, the smallest
# missing plot changes 5e-3.
MAX_CHANGED_SHARE = 2e-3
FONTS = {"Page": "DejaVuSans", "Page bold": "DejaVuSans-Bold", "Page mono": "DejaVuSansMono"}
PROVEN = {"position": 6e-16, "velocity": 4e-16, "acceleration": 5e-16, "moment": 3e-16}
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
    """The index, the page of a four-bar that agrees, and that of one that differs.

    Date, versions and machine are fixed on all of them.
    """
    folder = tmp_path_factory.mktemp("pictures")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(index_rows, "MADE", MADE)
        result = index_rows.result_for_index()
        index = index_rows.write_index(folder, result, index_rows.last_record(result))
    case = load_case(shipped("fourbar.toml"))
    found = {"index": index}
    for name, off in (("agrees", 2.5e-13), ("differs", 0.02)):
        result = result_from_references(case, off=off)
        if name == "differs":
            runs = [(case.name, run, "mujoco") for run in case.run]
            result = replace(result, diagnoses={key: example_diagnosis(*key) for key in runs})
        with without_figures(), pytest.MonkeyPatch.context() as patch:
            # on another machine a last bit may differ, so that the table of proofs does not hold
            patch.setattr(compared_with, "proven_errors", lambda *_: PROVEN)
            patch.setattr(case_page, "evaluate_in_worker", evaluate_here)
            found[name] = write_report(result, folder / name).with_name("fourbar.html")
    return found


def evaluate_here(case: Case, beyond: bool, function: Callable[[Case], Any], otherwise: Any) -> Any:
    """The value of a function of a case, in this process."""
    return function(case)


def example_diagnosis(*key: str) -> Diagnosis:
    """A diagnosis of five channels that differ, with two causes."""
    names = ("pin.x", "pin.y", "rocker", "point.x", "point.y")
    fault = Fault(
        Path("fourbar.xml"), 33, "rocker_end x", "m", 2.525, 2.5,
        instead='<site name="rocker_end" pos="2.5 0 0"/>',
    )  # fmt: skip
    longer = Explanation(
        "number of the model", fault.change, names, (), 1e-13, 5, 1, {"rocker": (2.5, 2.525)},
        faults=(fault,),
    )  # fmt: skip
    late = Explanation("shift", "pin.x late by 0.01 in x", names[:1], (), 0.1, 5, 2)
    return Diagnosis(*key, names, 5, (longer, late), ("sign", "unit"))


def take_picture(browser: Any, page: Path, change: str = "") -> Image.Image:
    """Take a picture of the first screen with Matplotlib's fonts, after the script `change`."""
    with Visit(browser, page, reduced_motion="reduce") as visit:
        visit.page.add_style_tag(content="".join(map(font_face, FONTS)) + FONT_STYLE)
        visit.run(WAIT_FOR_FONTS)
        if change:
            visit.run(change)
        return picture(visit.page)


def font_face(name: str) -> str:
    """The rule of a style sheet that defines a font.

    The rule contains the whole font, since a page that is a file may not read another folder.
    """
    file = Path(get_data_path()) / "fonts" / "ttf" / f"{FONTS[name]}.ttf"
    family, _, weight = name.partition(" ")
    bold, mono = weight == "bold", weight == "mono"
    return (
        f"@font-face {{ font-family: '{family}{' mono' if mono else ''}';"
        f" font-weight: {'600 900' if bold else '100 500'};"
        f" src: url(data:font/ttf;base64,{b64encode(file.read_bytes()).decode()}) }}"
    )


FONT_STYLE = ":root { --sans: 'Page'; --mono: 'Page mono'; }"
WAIT_FOR_FONTS = """async () => {
  await Promise.all([...document.fonts].map((font) => font.load()));
  await new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)));
  if (typeof drawAll === "function") drawAll();
  await new Promise((done) => setTimeout(done, 200));
}"""


def block_means(image: Image.Image) -> np.ndarray:
    """The mean brightness of each block of a picture, from 0 to 255."""
    light = np.asarray(image.convert("L"), float)
    rows, columns = (size // BLOCK_SIZE for size in light.shape)
    cut = light[: rows * BLOCK_SIZE, : columns * BLOCK_SIZE]
    return cut.reshape(rows, BLOCK_SIZE, columns, BLOCK_SIZE).mean(axis=(1, 3))


def changed_share(one: Image.Image, other: Image.Image) -> float:
    """The share of the blocks that differ between two pictures; 1 if their sizes differ."""
    if one.size != other.size:
        return 1.0
    return float(np.mean(np.abs(block_means(one) - block_means(other)) > BLOCK_TOLERANCE))


@pytest.mark.parametrize("name", PICTURE_NAMES)
def test_a_first_screen_matches_its_stored_picture(
    name: str, pages: dict[str, Path], browser: Any, tmp_path: Path
) -> None:
    file = STORED / f"{name}.png"
    found = take_picture(browser, pages[name])
    if file.is_file() and changed_share(Image.open(file), found) <= MAX_CHANGED_SHARE:
        assert file.stat().st_size <= MAX_PICTURE_SIZE
        return
    new = tmp_path / file.name
    few_colours(found).save(new, optimize=True)
    pytest.fail(f"not the stored picture: if it is meant to look like {new}, copy that to {file}")


PAGE_CHANGES = {
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
    [  # one change of each page is in the fast suite
        words
        if words in ("a missing plot", "a missing panel", "a missing row")
        else pytest.param(words, marks=pytest.mark.slow)
        for words in PAGE_CHANGES
    ],
)
def test_a_changed_first_screen_does_not_match_its_stored_picture(
    words: str, pages: dict[str, Path], browser: Any
) -> None:
    name, change = PAGE_CHANGES[words]
    changed = take_picture(browser, pages[name], change)
    assert changed_share(Image.open(STORED / f"{name}.png"), changed) > MAX_CHANGED_SHARE
