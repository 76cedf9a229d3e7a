"""The picture of the sliders in each notebook, for readers without a kernel, as on GitHub.

    python -m docs.make.notebook_pictures [--quick]

Writes the first drawing of each notebook's sliders into the notebook as a PNG, the only output that
is stored.  The drawings of the notebooks' cases and the animations are made by a run only.  With
--quick it draws one notebook and writes nothing.
"""

import json
from collections.abc import Sequence
from typing import Any

from benchmarks import command
from benchmarks.notebooks import NAMES, NOTEBOOKS, explored

STORED = "image/png", "text/plain"
"""Forms of the sliders that are stored; readers prefer widgets and HTML, which need more than this
file: a kernel, or a reader that shows SVG."""


def slider_output(name: str) -> dict[str, Any]:
    """Return the output that is stored for the sliders of a notebook, at their first positions."""
    bundle = explored(name)._repr_mimebundle_()
    data = {kind: bundle[kind] for kind in STORED}
    return {"data": data, "metadata": {}, "output_type": "display_data"}


def with_picture(text: str, output: dict[str, Any]) -> str:
    """Return the text of a notebook with this output of its sliders."""
    found = json.loads(text)
    (cell,) = (cell for cell in found["cells"] if cell["id"] == "sliders")
    cell["outputs"] = [output]
    return json.dumps(found, indent=1, ensure_ascii=False) + "\n"


def main(argv: Sequence[str] | None = None) -> None:
    given = command(__doc__).parse_args(argv)
    for name in NAMES[:1] if given.quick else NAMES:
        file = NOTEBOOKS / f"{name}.ipynb"
        text = with_picture(file.read_text(encoding="utf-8"), slider_output(name))
        if not given.quick:
            file.write_text(text, encoding="utf-8")
        print(f"{name}: {len(text) / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
