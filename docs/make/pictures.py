"""Pictures of a report in docs/: its index, a page of a case that differs, and an animation.

    python -m docs.make.pictures [--quick]

Checks the linkages, with a rocker of the four-bar that is made 1 % longer in the model.  Takes
pictures of pages of the report with the Chromium of the system, and animates the four-bar.  Writes
docs/report_index.png, docs/report_case.png and docs/fourbar.webp; with --quick it takes pictures of
one case and writes nothing.
"""

import io
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from PIL import Image

from benchmarks import ROOT, command, replacing_pages
from proofmass import animate, load_case
from proofmass.batch.check import check
from proofmass.report import write_report

CHROMIUM = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), ""
)
"""The browser of the system; empty if there is none."""
SCREEN = {"width": 1440, "height": 900}
LONGER = ('name="rocker_end" pos="2.5 0 0"', 'name="rocker_end" pos="2.525 0 0"')
PICTURE_WIDTH = 1100  # pixels of a picture in docs/
COLOURS = 256  # number of colours of a picture's palette


@contextmanager
def chromium() -> Iterator[Any]:
    """The browser, which is closed at the end of the context."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as play:
        browser = launch(play.chromium)
        yield browser
        browser.close()


def launch(kind: Any, **environment: str) -> Any:
    """Start the browser, of a type of playwright's browsers, with variables of the environment."""
    return kind.launch(
        executable_path=CHROMIUM,
        args=["--no-sandbox", "--disable-gpu", "--font-render-hinting=none"],
        env=os.environ | environment,
    )


def open_page(browser: Any, page: Path) -> Any:
    """A page in light colours whose mechanism does not play by itself."""
    context = browser.new_context(
        viewport=SCREEN, reduced_motion="reduce", color_scheme="light", device_scale_factor=1
    )
    tab = context.new_page()
    tab.goto(page.as_uri())
    tab.wait_for_load_state()
    return tab


def picture(tab: Any) -> Image.Image:
    """A picture of a page as the screen shows it."""
    return Image.open(io.BytesIO(tab.screenshot())).convert("RGB")


def few_colours(image: Image.Image) -> Image.Image:
    """The picture with a palette of `COLOURS` colours."""
    return image.quantize(
        COLOURS, method=Image.Quantize.MAXCOVERAGE, kmeans=2, dither=Image.Dither.NONE
    )


def write_wrong_report(folder: Path, quick: bool) -> Path:
    """Write a report of the linkages, or of the four-bar alone, with its wrong model."""
    models = folder / "linkages"
    shutil.copytree(ROOT / "models" / "linkages", models)
    model = models / "fourbar.xml"
    text = model.read_text(encoding="utf-8")
    if LONGER[0] not in text:
        raise ValueError(f"{model.name} has no {LONGER[0]}")
    for sidecar in models.glob("*.toml"):  # other cases keep the right model
        toml = sidecar.read_text(encoding="utf-8")
        sidecar.write_text(toml.replace('"fourbar.xml"', '"fourbar_right.xml"'), encoding="utf-8")
    shutil.copy(model, models / "fourbar_right.xml")
    model.write_text(text.replace(*LONGER), encoding="utf-8")
    result = check([models / "fourbar.toml" if quick else models])
    write_report(result, folder / "report")
    return folder / "report"


def save(image: Image.Image, name: str) -> None:
    """Write a picture into docs/."""
    smaller = image.resize((PICTURE_WIDTH, round(PICTURE_WIDTH * image.height / image.width)))
    few_colours(smaller).save(ROOT / "docs" / name, optimize=True)


def main() -> None:
    quick = command(__doc__).parse_args().quick
    if not CHROMIUM:
        print("there is no Chromium on this system: no pictures")
        return
    with tempfile.TemporaryDirectory() as folder, chromium() as browser:
        report = write_wrong_report(Path(folder), quick)
        index = picture(open_page(browser, report / "index.html"))
        case = picture(open_page(browser, report / "fourbar.html"))
        wrong = load_case(Path(folder) / "linkages" / "fourbar.toml")
        motion = animate(wrong, solvers=["mujoco"], frames=2 if quick else 60, magnify=10)
    if quick:
        print(f"pictures of {index.size} and {case.size}, {len(motion.frames)} frames")
        return
    save(index, "report_index.png")
    save(case, "report_case.png")
    with replacing_pages():
        motion.save(ROOT / "docs" / "fourbar.webp")
    for name in ("report_index.png", "report_case.png", "fourbar.webp"):
        print(f"docs/{name}: {(ROOT / 'docs' / name).stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main()
