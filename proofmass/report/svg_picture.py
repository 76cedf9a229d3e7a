"""SVG of simple shapes as PNG, for readers of notebooks that show no SVG.

GitHub removes SVG from the outputs of a notebook, and JupyterLab shows none before a notebook is
trusted; a PNG is shown by all.
"""

import io
import re
from collections.abc import Mapping
from typing import Any
from xml.etree import ElementTree

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, PathPatch, Rectangle
from matplotlib.path import Path as Outline
from PIL import Image

PIXELS_PER_INCH = 100  # of the SVG, so that its lengths are hundredths of an inch
POINTS_PER_PIXEL = 72 / PIXELS_PER_INCH
PNG_COLOURS = 64
"""Number of colours of the palette; lines, their edges and texts need no more."""
STEPS = re.compile(r"([MHV])([^MHV]*)")


def svg_as_png(svg: str) -> bytes:
    """Draw SVG that consists of rectangles, circles, straight lines and texts.

    Parameters
    ----------
    svg : str
        The elements ``rect``, ``circle``, ``path`` with the steps M, H and V, and ``text``, without
        groups, in a ``viewBox`` that starts at 0 0.

    Returns
    -------
    bytes
        A PNG of the size of the ``viewBox`` [pixel].

    Raises
    ------
    ValueError
        There is another element, or another step of a path.

    Examples
    --------
    >>> png = svg_as_png('<svg viewBox="0 0 30 20"><circle cx="9" cy="9" r="4" fill="#000"/></svg>')
    >>> png[1:4], Image.open(io.BytesIO(png)).size
    (b'PNG', (30, 20))
    """
    root = ElementTree.fromstring(svg)
    _, _, width, height = map(float, root.attrib["viewBox"].split())
    figure = Figure(
        figsize=(width / PIXELS_PER_INCH, height / PIXELS_PER_INCH),
        dpi=PIXELS_PER_INCH,
    )
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set(xlim=(0.0, width), ylim=(height, 0.0))
    axes.set_axis_off()
    for order, element in enumerate(root):
        draw_element(axes, element, order, float(root.get("font-size", 11)))
    stream = io.BytesIO()
    with rc_context({"lines.scale_dashes": False}):
        figure.savefig(stream, format="png")
    return reduce_colours(stream.getvalue())


def draw_element(axes: Axes, element: ElementTree.Element, order: int, font_size: float) -> None:
    """Draw an element of the SVG above those with a smaller order."""
    tag, given = element.tag.rpartition("}")[2], element.attrib
    if tag == "text":
        axes.text(
            float(given["x"]),
            float(given["y"]),
            element.text or "",
            fontsize=font_size * POINTS_PER_PIXEL,
            fontweight=given.get("font-weight", "normal"),
            ha={"start": "left", "middle": "center", "end": "right"}[
                given.get("text-anchor", "start")
            ],
            va="baseline",
            color=given.get("fill", "#000"),
            parse_math=False,
            zorder=order,
        )
        return
    numbers = {key: float(value) for key, value in given.items() if key in ("cx", "cy", "r")}
    look = shape_look(given) | {"zorder": order}
    if tag == "rect":
        axes.add_patch(Rectangle((0.0, 0.0), float(given["width"]), float(given["height"]), **look))
    elif tag == "circle":
        axes.add_patch(Circle((numbers["cx"], numbers["cy"]), numbers["r"], **look))
    elif tag == "path":
        axes.add_patch(PathPatch(read_outline(given["d"]), **look))
    else:
        raise ValueError(f"there is no drawing of <{tag}>, only of rect, circle, path and text")


def shape_look(given: Mapping[str, str]) -> dict[str, Any]:
    """Keyword arguments of a patch of matplotlib for the attributes of a shape."""
    look: dict[str, Any] = {
        "facecolor": given.get("fill", "none"),
        "edgecolor": given.get("stroke", "none"),
        "linewidth": float(given.get("stroke-width", 1)) * POINTS_PER_PIXEL,
        "alpha": float(given.get("opacity", 1)),
    }
    if given.get("stroke-linecap") == "round":
        look |= {"capstyle": "round", "joinstyle": "round"}
    if "stroke-dasharray" in given:
        dashes = [float(length) * POINTS_PER_PIXEL for length in given["stroke-dasharray"].split()]
        look["linestyle"] = (0, tuple(dashes))
    return look


def read_outline(steps: str) -> Outline:
    """Path of matplotlib from the steps M, H and V of a path of SVG.

    >>> read_outline("M1 2 3 4M5 6H7").vertices.tolist()
    [[1.0, 2.0], [3.0, 4.0], [5.0, 6.0], [7.0, 6.0]]
    """
    if not re.fullmatch(r"[MHV\d\s.,-]*", steps):
        raise ValueError(f"path {steps[:40]!r} must have the steps M, H and V only")
    places: list[tuple[float, float]] = []
    codes: list[Any] = []
    for step, text in STEPS.findall(steps):
        numbers = [float(number) for number in text.split()]
        if step == "M":
            found = list(zip(numbers[::2], numbers[1::2], strict=True))
            codes += [Outline.MOVETO, *[Outline.LINETO] * (len(found) - 1)]
        else:
            x, y = places[-1]
            found = [(numbers[0], y) if step == "H" else (x, numbers[0])]
            codes.append(Outline.LINETO)
        places += found
    return Outline(places, codes)


def reduce_colours(png: bytes) -> bytes:
    """Return the picture with a palette, which makes it several times smaller."""
    stream = io.BytesIO()
    picture = Image.open(io.BytesIO(png)).convert("RGB")
    picture.quantize(PNG_COLOURS, dither=Image.Dither.NONE).save(stream, "png", optimize=True)
    return stream.getvalue()
