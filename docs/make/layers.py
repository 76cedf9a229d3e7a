"""The imports between the folders of the package, as a matrix: docs/layers.svg.

    python -m docs.make.layers [--quick]

The folders stand in the order of the contracts in pyproject.toml.  A row has the number of modules
that each folder imports from those before it, so that the upper half of the matrix is empty if no
folder imports a later one.
"""

import tomllib
from collections import Counter
from collections.abc import Sequence
from xml.etree import ElementTree

import grimp

from benchmarks import ROOT, command

CELL, ROW = 58, 34  # width of a column and height of a row [pixels]
NAMES, TOP = 320, 62  # where the matrix begins [pixels]
STYLE = """
text { font: 13px system-ui, sans-serif; fill: #333b48 }
.folder { font-weight: 600; fill: #1d2430 }
.count { text-anchor: middle }
.top { text-anchor: middle; font-weight: 600; font-size: 12px }
.line { stroke: #d5d8de }
.same { fill: #e9e9ec }
.later { fill: #f6f6f8 }
"""
QUESTIONS = {
    "base": "what do all others use?",
    "tables": "what does a table of another program say?",
    "analytic": "what does mathematics say?",
    "sim": "what do the engines say?",
    "screen": "what is this model?",
    "case": "what did the user write?",
    "reference": "what is a run compared with?",
    "run": "what is one run?",
    "verdict": "does it agree?",
    "evidence": "why does it differ?",
    "batch": "what of many cases?",
    "formats": "how is it said as text?",
    "report": "how is it shown?",
    "studies": "what does accuracy cost?",
    "design": "which springs balance?",
    "commands": "what does the user ask?",
}


def main(argv: Sequence[str] | None = None) -> None:
    given = command(__doc__).parse_args(argv)
    folders = ordered_folders()
    drawing = draw(folders, count_imports())
    if not given.quick:
        (ROOT / "docs/layers.svg").write_text(drawing)


def ordered_folders() -> list[str]:
    """The folders of the package, from the first that knows no other."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text())
    contracts = settings["tool"]["importlinter"]["contracts"]
    layers = next(one["layers"] for one in contracts if one["type"] == "layers")
    return [layer for layer in reversed(layers) if (ROOT / "proofmass" / layer).is_dir()]


def count_imports() -> Counter[tuple[str, str]]:
    """The number of pairs of an importing and an imported module, for each pair of folders."""
    graph = grimp.build_graph("proofmass", cache_dir=None)
    return Counter(
        (folder_of(module), folder_of(imported))
        for module in graph.modules
        for imported in graph.find_modules_directly_imported_by(module)
    )


def folder_of(module: str) -> str:
    """The folder of a module below the package; the module's own name if it lies in none."""
    return module.partition(".")[2].partition(".")[0]


def draw(folders: Sequence[str], counts: Counter[tuple[str, str]]) -> str:
    """The matrix as SVG."""
    width, height = NAMES + CELL * len(folders) + 10, TOP + ROW * len(folders) + 10
    back = sum(counts[one, later] for k, one in enumerate(folders) for later in folders[k + 1 :])
    title = f"Imports between folders; {back} go back"
    svg = ElementTree.Element(
        "svg",
        {"xmlns": "http://www.w3.org/2000/svg", "viewBox": f"0 0 {width} {height}", "role": "img"},
    )
    svg.set("aria-label", title)
    ElementTree.SubElement(svg, "style").text = STYLE
    write(svg, NAMES - 12, 20, "imports from", "folder", end=True)
    for k, folder in enumerate(folders):
        # in two heights, since neighbours' names are wider than a column
        write(svg, NAMES + CELL * (k + 0.5), 20 + 22 * (k % 2), folder, "top")
        draw_row(svg, folders, k, [counts[folder, other] for other in folders])
    for k in range(len(folders) + 1):
        y = TOP + ROW * k
        line = {"x1": "10", "x2": str(NAMES + CELL * len(folders)), "y1": str(y), "y2": str(y)}
        ElementTree.SubElement(svg, "line", line | {"class": "line"})
    ElementTree.indent(svg, "")
    return ElementTree.tostring(svg, "unicode") + "\n"


def draw_row(
    svg: ElementTree.Element, folders: Sequence[str], row: int, counts: Sequence[int]
) -> None:
    """What one folder imports."""
    y = TOP + ROW * row
    write(svg, 12, y + 22, f"{folders[row]}/", "folder")
    write(svg, 104, y + 22, QUESTIONS[folders[row]])
    for column, count in enumerate(counts):
        kind = "same" if column == row else "later" if column > row else ""
        box = {"x": str(NAMES + CELL * column), "y": str(y), "width": str(CELL), "height": str(ROW)}
        if kind:
            ElementTree.SubElement(svg, "rect", box | {"class": kind})
        elif count:
            darkness = min(1.0, 0.12 + count / 120)
            shade = {"fill": "#4a6a94", "fill-opacity": f"{darkness:.2f}"}
            ElementTree.SubElement(svg, "rect", box | shade)
        if count:
            write(svg, NAMES + CELL * (column + 0.5), y + 22, str(count), "count")


def write(
    svg: ElementTree.Element, x: float, y: float, text: str, kind: str = "", end: bool = False
) -> None:
    """A text at a place."""
    place = {"x": f"{x:g}", "y": f"{y:g}"} | ({"class": kind} if kind else {})
    if end:
        place["text-anchor"] = "end"
    ElementTree.SubElement(svg, "text", place).text = text


if __name__ == "__main__":
    main()
