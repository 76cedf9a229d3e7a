"""Pictures of the pages of five models without a sidecar: docs/model_*.png.

    python -m docs.make.model_pages [CASSIE.xml] [--quick]

Takes pictures of the pages that a report has for a gripper of models/, for three models of public
threads, and for the file CASSIE.xml, if it is given, with the Chromium of the system.  With --quick
it takes one picture and writes nothing.
"""

import shutil
import tempfile
from pathlib import Path

from benchmarks import ROOT, command
from docs.make.pictures import CHROMIUM, chromium, open_page, picture, save
from proofmass.batch.check import check
from proofmass.report import write_report

MODELS = (
    ROOT / "tests" / "data" / "screen" / "pd954.xml",
    ROOT / "tests" / "data" / "screen" / "hold565.xml",
    ROOT / "tests" / "data" / "threads" / "jansen613.xml",
    ROOT / "models" / "spatial" / "robotiq_2f85.xml",
)


def main() -> None:
    parser = command(__doc__)
    parser.add_argument("cassie", type=Path, nargs="?")
    given = parser.parse_args()
    if not CHROMIUM:
        print("there is no Chromium on this system: no pictures")
        return
    with tempfile.TemporaryDirectory() as place, chromium() as browser:
        folder = Path(place)
        for model in MODELS[:1] if given.quick else MODELS:
            shutil.copy(model, folder)  # without its sidecar
        outside = [given.cassie] if given.cassie else []
        write_report(check([folder, *outside]), folder / "report")
        for model in sorted([*folder.glob("*.xml"), *outside]):
            image = picture(open_page(browser, folder / "report" / f"{model.stem}.html"))
            if given.quick:
                print(f"a picture of {image.size}")
            else:
                save(image, f"model_{model.stem}.png")


if __name__ == "__main__":
    main()
