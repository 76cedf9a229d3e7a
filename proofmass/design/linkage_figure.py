"""Figures of designs for a path: coupler curves, the points, and the linkages at the first one."""

from collections.abc import Sequence
from io import BytesIO
from pathlib import Path

import numpy as np

from proofmass.report.style import RC  # isort: skip
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from proofmass.base.files import write_output
from proofmass.design.linkage_designs import EXACT, LinkageDesign

PANEL = (4.2, 4.0)  # width and height of a panel [in]
DRAWN_DESIGNS = 4  # designs that are drawn
CURVE_COLOUR, BAR_COLOUR, COUPLER_COLOUR, POINT_COLOUR = "#0072B2", "#444444", "#009E73", "#D55E00"


def write_figure(designs: Sequence[LinkageDesign], stem: Path) -> list[Path]:
    """Draw the first designs side by side, write SVG and PNG, and return the files."""
    drawn = designs[:DRAWN_DESIGNS]
    columns = min(len(drawn), 2)
    rows = -(-len(drawn) // columns)
    with rc_context(RC):
        figure = Figure((PANEL[0] * columns, PANEL[1] * rows), layout="constrained")
        panels = figure.subplots(rows, columns, squeeze=False).flat
        for number, axes in enumerate(panels, 1):
            if number <= len(drawn):
                draw_design(axes, drawn[number - 1], number)
            else:
                axes.set_axis_off()
        files = [stem.with_suffix(f".{ending}") for ending in ("svg", "png")]
        for file in files:
            data = BytesIO()
            figure.savefig(data, format=file.suffix[1:], dpi=150)
            write_output(file, data.getvalue())
    return files


def draw_design(axes: Axes, design: LinkageDesign, number: int) -> None:
    """Draw a coupler curve with the points and the linkage at the first of them."""
    curve, points = design.curve(), design.path.points
    places = design.pose(float(design.angles[0]))
    a, p, x, q = (places[name] for name in "APXQ")
    axes.plot(curve.real, curve.imag, color=CURVE_COLOUR, lw=1.2, label="coupler curve", zorder=1)
    axes.fill(
        *np.array([p, x, q]).view(float).reshape(-1, 2).T, color=COUPLER_COLOUR, alpha=0.2, zorder=2
    )
    draw_bar(axes, [p, q, x, p], COUPLER_COLOUR)
    draw_bar(axes, [a, p], BAR_COLOUR)
    if design.kind == "fourbar":
        draw_bar(axes, [places["B"], q], BAR_COLOUR)
        pivots = np.array([a, places["B"]])
    else:
        draw_guide(axes, design, q)
        pivots = np.array([a])
    axes.plot(pivots.real, pivots.imag, "^", color=BAR_COLOUR, ms=8, zorder=3)
    axes.plot(points.real, points.imag, "o", color=POINT_COLOUR, ms=4, label="points", zorder=5)
    axes.annotate(
        "1", (points[0].real, points[0].imag), xytext=(4, 4), textcoords="offset points", zorder=6
    )
    axes.set_aspect("equal", adjustable="datalim")
    kind = design.task.kind
    mode = {1: "open", -1: "crossed"}[kind.mode] + " " if design.kind == "fourbar" else ""
    axes.set(
        title=f"{number}: {mode}{kind.title}, {error_words(design)}",
        xlabel="x [m]",
        ylabel="y [m]",
    )


def error_words(design: LinkageDesign) -> str:
    """The error of a design in the title of its panel."""
    if design.value <= EXACT * design.path.size:
        return "exact"
    return f"error {design.rms:.3g} m"


def draw_bar(axes: Axes, places: Sequence[complex], colour: str) -> None:
    """Draw a bar through places, with pins."""
    found = np.array(places)
    axes.plot(found.real, found.imag, "-o", color=colour, lw=2, ms=4, mfc="white", zorder=3)


def draw_guide(axes: Axes, design: LinkageDesign, slider: complex) -> None:
    """Draw the guide along the way of the slider, and the slider on it."""
    turn = np.linspace(0.0, 2.0 * np.pi, 181)
    way = np.array([design.pose(angle)["Q"] for angle in turn])
    along = np.exp(1j * design.parameters["guide_angle"])
    run = (way * np.conj(along)).real
    ends = way[[run.argmin(), run.argmax()]]
    ends = ends + 0.1 * np.ptp(run) * along * np.array([-1.0, 1.0])
    axes.plot(ends.real, ends.imag, "--", color=BAR_COLOUR, lw=1, zorder=1)
    axes.plot(slider.real, slider.imag, "s", color=BAR_COLOUR, ms=8, zorder=4)
