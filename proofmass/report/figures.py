"""Figures of a run: the curves over the reference, and their differences to the reference."""

from collections.abc import Iterable, Mapping, Sequence
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, MultipleLocator, NullLocator
from PIL import Image

from proofmass.base.arrays import Array
from proofmass.base.files import write_output
from proofmass.base.wording import format_unit, number
from proofmass.report.data import (
    PlottedRun,
    channel_rows,
    displayed_unit,
    drive_curves,
    drive_rows,
    monotonic_stretches,
    split_at_jumps,
    thin_curve,
)
from proofmass.report.style import LABEL_COLOUR, REFERENCE_STYLE, WRONG_COLOUR, Look
from proofmass.report.svg import compact_svg

ZERO_LEVEL = 1e-18  # of the reference's range: a difference of exactly zero is drawn there
DPI = 150
TEXT_BACKGROUND = {"facecolor": "white", "alpha": 0.7, "edgecolor": "none", "pad": 0.4}
NAMED_SOLVERS = 2
"""Solvers that the words at a tolerance's line name, so that they fit into a panel."""
SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def draw_curve(
    ax: Axes, x: Array, y: Array, look: Look, limit: int = 300, jumps: Iterable[int] = ()
) -> None:
    """Draw the curve of a solver, with staggered markers so that coincident curves are all visible.

    Markers are filled where x falls, as on the way back of a loop.  The curve is open at jumps.
    """
    for way, rises in monotonic_stretches(x, jumps):
        part_x, part = thin_curve(x[way], np.where(np.isfinite(y[way]), y[way], np.nan), limit)
        every = max(len(part) // 7, 1)
        ax.plot(
            part_x,
            part,
            **look.line,
            markevery=(min(marker_start(look, every), len(part) - 1), every),
            markerfacecolor="white" if rises else look.colour,
            markeredgewidth=0.8,
            zorder=3 + look.number / 10,
        )


def marker_start(look: Look, every: int) -> int:
    """The first of the points of a curve that has a marker; twelve looks begin at different ones.

    >>> [marker_start(Look("", (0, ()), "", number), 48) % 48 for number in (0, 1, 6, 7)]
    [12, 20, 16, 24]
    """
    return (2 * look.number + look.number // 6) * every // 12 + every // 4


def thin_path(points: Array, limit: int, jumps: Iterable[int] = ()) -> Array:
    """Return at most `limit` of the points (n, 2) of a path, with its first and last.

    Where the path jumps after a point, there is NaN.

    >>> thin_path(np.zeros((1000, 2)), 400).shape
    (400, 2)
    >>> thin_path(np.zeros((1000, 2)), 400, [499]).shape
    (401, 2)
    """
    edges = [k + 1 for k in sorted(jumps) if k + 1 < len(points)]
    if edges:
        gap, parts = np.full((1, points.shape[1]), np.nan), np.split(points, edges)
        shares = [max(2, limit * len(part) // len(points)) for part in parts]
        each = [thin_path(*one) for one in zip(parts, shares, strict=True)]
        return np.concatenate([part for one in each for part in (gap, one)][1:])
    if len(points) <= limit:
        return points
    return np.asarray(points[np.linspace(0, len(points) - 1, limit).round().astype(int)])


def scale_panel(ax: Axes, reference: Array, lines: Mapping[str, Array]) -> None:
    """Scale a panel by the reference; solvers that are far off leave the panel and are named."""
    finite = reference[np.isfinite(reference)]
    low, high = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 1.0)
    span = high - low
    if span <= 1e-9 * max(abs(low), abs(high)):  # a constant, whose rounding is not magnified
        span = max(abs(low), abs(high)) or 1.0
    out = []
    bounds = [low - 0.06 * span, high + 0.06 * span]
    for name, y in lines.items():
        y = y[np.isfinite(y)]
        if y.size:
            if y.min() < low - 0.5 * span or y.max() > high + 0.5 * span:
                out.append(name)
            bounds[0] = min(bounds[0], max(float(y.min()), low - 0.5 * span))
            bounds[1] = max(bounds[1], min(float(y.max()), high + 0.5 * span))
    ax.set_ylim(*bounds)
    if out:
        ax.text(
            0.99,
            0.99,
            "off the scale: " + ", ".join(out),
            transform=ax.transAxes,
            ha="right",
            va="top",
            fontsize=6.5,
            color=WRONG_COLOUR,
            zorder=9,
            bbox=TEXT_BACKGROUND,
        )


def draw_overlay(
    ax: Axes,
    view: PlottedRun,
    channel: str,
    style: Mapping[str, Look],
    others: Iterable[Array] = (),
) -> None:
    """Draw a channel: the reference thick and pale, the solvers thin on top of it."""
    unit, scale = displayed_unit(view.case.channels[channel].unit)
    lines = {
        s: c.channels[channel] * scale for s, c in view.curves.items() if channel in c.channels
    }
    draw_panel(
        ax,
        view,
        channel,
        view.longest.channels[channel] * scale,
        lines,
        style,
        unit,
        others,
        {s: jumps.of(channel) for s, jumps in {"": view.jumps, **view.jumps_of}.items()},
    )


def draw_panel(
    ax: Axes,
    view: PlottedRun,
    title: str,
    reference: Array,
    lines: dict[str, Array],
    style: Mapping[str, Look],
    unit: str,
    others: Iterable[Array] = (),
    jumps: Mapping[str, Iterable[int]] | None = None,
) -> None:
    """Draw a panel of an overlay: the curve of the reference, and the lines of the solvers.

    `reference` has the samples of the longest run, and `others` are curves for which the panel
    must have room.  `jumps` are by solver, those of the reference under the empty string.
    """
    jumps = jumps or {}
    ax.plot(
        *split_at_jumps(view.longest.x * view.x_scale, reference, jumps.get("", ()), 300),
        **REFERENCE_STYLE,
    )
    for solver, y in lines.items():
        own = jumps.get(solver, ())
        draw_curve(ax, view.curves[solver].x * view.x_scale, y, style[solver], jumps=own)
    scale_panel(ax, np.concatenate([reference, *others]), lines)
    draw_ends(ax, view, style)
    ax.set_title(title)
    ax.set_ylabel(f"[{format_unit(unit)}]")


def draw_ends(ax: Axes, view: PlottedRun, style: Mapping[str, Look]) -> None:
    """Draw a vertical line where a solver stopped before the run's last sample."""
    for solver, curves in view.curves.items():
        if curves.stopped:
            ax.axvline(
                float(curves.x[-1]) * view.x_scale,
                color=style[solver].colour,
                linewidth=0.9,
                linestyle=(0, (1, 2)),
                zorder=2,
            )


def draw_difference(ax: Axes, view: PlottedRun, channel: str, style: Mapping[str, Look]) -> None:
    """Draw absolute differences of a channel on a log axis, and each tolerance as a dashed line."""
    unit = view.case.channels[channel].unit
    levels, tops = list[float](), list[float]()
    for solver in view.curves:
        error = view.error(solver, channel)
        if error is None:
            continue
        floor = ZERO_LEVEL * (float(np.ptp(view.reference[solver].channels[channel])) or 1.0)
        error = np.where(np.isfinite(error), np.maximum(error, floor), np.nan)
        jumps = view.apart(solver, channel)
        draw_curve(ax, view.curves[solver].x * view.x_scale, error, style[solver], 120, jumps)
        solid = error[error > floor]
        levels.append(float(np.nanpercentile(solid, 5)) / 20 if solid.size else floor)
        tops.append(float(np.nanmax(error, initial=floor)))
    allowed = channel_tolerances(view, channel)
    levels += [level / 4 for level in allowed]  # so that the lines of tolerances are in the panel
    if levels:
        set_decades(ax, min(levels), 8 * max([*tops, *allowed]))
        draw_tolerances(ax, allowed, style)
    else:
        ax.set_yticks([])
        ax.text(0.5, 0.5, "no solver delivers it", transform=ax.transAxes, ha="center")
    draw_ends(ax, view, style)
    ax.set_title(channel)
    ax.set_ylabel(f"|difference| [{format_unit(unit)}]")


def set_decades(ax: Axes, low: float, high: float) -> None:
    """Set a logarithmic axis that is labelled with a few powers of ten."""
    ax.set_yscale("log")
    ax.yaxis.set_major_locator(LogLocator(numticks=5))
    ax.yaxis.set_minor_locator(NullLocator())
    ax.yaxis.set_major_formatter(
        FuncFormatter(lambda value, _: "10" + f"{round(np.log10(value))}".translate(SUPERSCRIPTS))
    )
    ax.set_ylim(low, high)


def channel_tolerances(view: PlottedRun, channel: str) -> dict[float, list[str]]:
    """Return the allowed errors of a channel, and the solvers that each applies to."""
    found: dict[float, list[str]] = {}
    for c in view.rows:
        if c.channel == channel and c.allowed > 0 and c.solver in view.curves:
            same = next((a for a in found if abs(a - c.allowed) < 1e-3 * a), c.allowed)
            found.setdefault(same, []).append(c.solver)
    return found


def name_solvers(solvers: Sequence[str]) -> str:
    """Return the first names of solvers, and how many more there are.

    >>> name_solvers(["mujoco", "pymunk"]), name_solvers(["mujoco", "pymunk", "drake", "dart"])
    ('mujoco, pymunk', 'mujoco, pymunk and 2 more')
    """
    more = f" and {len(solvers) - NAMED_SOLVERS} more" if len(solvers) > NAMED_SOLVERS else ""
    return ", ".join(solvers[:NAMED_SOLVERS]) + more


def draw_tolerances(ax: Axes, allowed: dict[float, list[str]], style: Mapping[str, Look]) -> None:
    """Draw a dashed line for each tolerance, with its solvers and number where there is room."""
    low, high = np.log(ax.get_ylim())
    taken: list[tuple[float, bool]] = []
    for level in sorted(allowed, reverse=True):
        colour = style[allowed[level][0]].colour if len(allowed[level]) == 1 else LABEL_COLOUR
        ax.axhline(level, color=colour, linewidth=0.9, linestyle=(0, (7, 3)), zorder=2)
        height = (np.log(level) - low) / (high - low)
        free = [
            (height + shift, right)
            for shift in (0.01, -0.105)
            for right in (False, True)
            if all(abs(height + shift - y) > 0.1 or right != r for y, r in taken)
        ]
        if free:  # otherwise only the table shows it
            taken.append(free[0])
            ax.text(
                0.99 if free[0][1] else 0.01,
                free[0][0],
                f"{name_solvers(allowed[level])} ≤ {number(level)}",
                transform=ax.transAxes,
                fontsize=6.5,
                color=colour,
                ha="right" if free[0][1] else "left",
                va="bottom",
                zorder=9,
                bbox=TEXT_BACKGROUND,
            )


def run_figure(view: PlottedRun, style: Mapping[str, Look], what: str) -> Figure:
    """Draw all channels of a run as a grid of panels; `what` is "overlay" or "difference"."""
    driven = drive_curves(view) if what == "overlay" else {}
    names = drive_rows(view, list(driven)) + channel_rows(view.case, view.channels)
    width = max(map(len, names))
    labels = ["reference"] * (what == "overlay") + list(view.curves)
    more = legend_height(labels, 3.05 * width + 0.36)
    head = (0.8 if view.failed else 0.62) + more  # room for the legend, and the note below it
    height = 1.75 * len(names) + 0.13 + head
    figure = Figure(figsize=(3.05 * width + 0.36, height))
    axes = figure.subplots(len(names), width, squeeze=False, sharex=True)
    for row, line in zip(axes, names, strict=True):
        for k, ax in enumerate(row):
            if k >= len(line):
                ax.remove()
            elif line[k] in driven:
                reference, moved, unit = driven[line[k]]
                unit, scale = displayed_unit(unit)
                draw_panel(
                    ax,
                    view,
                    line[k],
                    reference * scale,
                    {s: y * scale for s, y in moved.items()},
                    style,
                    unit,
                )
            else:
                (draw_overlay if what == "overlay" else draw_difference)(ax, view, line[k], style)
    for j in range(width):  # label the lowest panel of each column; rows may differ in length
        lowest = max(i for i, line in enumerate(names) if j < len(line))
        axes[lowest, j].set_xlabel(f"{view.x_name} [{view.x_unit}]")
        axes[lowest, j].tick_params(labelbottom=True)
    for ax in figure.axes:  # fixed places: finding free ones takes as long as drawing
        ax.xaxis.set_label_coords(0.5, -0.22)
        ax.yaxis.set_label_coords(-0.215, 0.5)
        ax.yaxis.get_offset_text().set(x=1, ha="right")
    x = view.grid * view.x_scale
    axes[0, 0].set_xlim(float(x[0]), float(x[-1]))
    if view.x_unit == "deg" and abs(x[-1] - x[0]) >= 180:
        axes[0, 0].xaxis.set_major_locator(MultipleLocator(90 if abs(x[-1] - x[0]) < 721 else 180))
    draw_legend(figure, view, style, what, height, more)
    figure.subplots_adjust(
        left=0.68 / (3.05 * width),
        right=1 - 0.1 / (3.05 * width),
        bottom=0.42 / height,
        top=1 - head / height,
        wspace=0.3,
        hspace=0.38,
    )
    return figure


def label_row(ax: Axes, text: str, y: float, gap: float = 4.0, **style: Any) -> None:
    """Write the name of a row of bars to the left of the axes, `gap` points away."""
    ax.annotate(
        text,
        (0, y),
        xycoords=("axes fraction", "data"),
        xytext=(-gap, 0),
        textcoords="offset points",
        ha="right",
        va="center",
        **style,
    )


def solver_handles(solvers: Iterable[str], style: Mapping[str, Look]) -> list[Line2D]:
    """Return the legend's entries of solvers."""
    return [Line2D([], [], label=s, **style[s].line, markerfacecolor="white") for s in solvers]


HEADER_LINE_HEIGHT = 0.17
"""Height of a line of a legend above a grid of panels [inch]."""


HEADER_ENTRY_WIDTH, HEADER_ENTRY_SPACE = 0.67, 0.13
"""Width of the line of a legend's entry with the space to the next one, and what of it the last one
does not need: 3.2 + 0.8 + 2 letters of 8 points, less its padding [inch]."""
HEADER_LETTER_WIDTH = 0.066
"""Mean width of a letter of 8 points [inch]."""


def columns_that_fit(labels: Iterable[str], width: float) -> int:
    """Number of columns of a legend that is no wider than a figure [inch].

    >>> columns_that_fit(["reference", "mujoco", "pymunk"], 6.4), columns_that_fit(["x"] * 12, 6.4)
    (3, 8)
    """
    widths = [HEADER_ENTRY_WIDTH + HEADER_LETTER_WIDTH * len(label) for label in labels]
    width += HEADER_ENTRY_SPACE
    if sum(widths) <= width:
        return len(widths)
    return max(1, int(width / max(widths)))


def legend_height(labels: Iterable[str], width: float) -> float:
    """Height of the lines of a legend above a grid of panels, without the first [inch]."""
    labels = list(labels)
    return HEADER_LINE_HEIGHT * (-(-len(labels) // columns_that_fit(labels, width)) - 1)


def draw_legend_above(figure: Figure, handles: Sequence[Line2D], height: float) -> None:
    """Draw a legend above a grid of panels, in one line if it fits; see `legend_height`.

    `height` is the figure's [inch].
    """
    figure.legend(
        handles=handles,
        loc="upper left",
        ncols=columns_that_fit(
            [str(handle.get_label()) for handle in handles], figure.get_figwidth()
        ),
        handlelength=3.2,
        labelspacing=0.3,
        bbox_to_anchor=(0.0, 1 - 0.02 / height),
        fontsize=8,
    )


def draw_legend(
    figure: Figure,
    view: PlottedRun,
    style: Mapping[str, Look],
    what: str,
    height: float,
    more: float = 0.0,
) -> None:
    """Draw the legend above the grid, `more` [inch] than a line, and a note on failed solvers."""
    handles = [Line2D([], [], label="reference", **REFERENCE_STYLE)] * (what == "overlay")
    draw_legend_above(figure, [*handles, *solver_handles(view.curves, style)], height)
    if view.failed:
        note = "not drawn: " + ", ".join(f"{s} ({c.outcome})" for s, c in view.failed.items())
        figure.text(
            0.02, 1 - (0.34 + more) / height, note, fontsize=7, color=WRONG_COLOUR, va="top"
        )


def curve_thumbnail(view: PlottedRun, style: Mapping[str, Look]) -> Figure:
    """Draw a small overlay of the first channel, for the index, where there is no mechanism."""
    figure = Figure(figsize=(1.8, 1.3))
    draw_overlay(figure.add_axes((0.24, 0.14, 0.74, 0.7)), view, view.channels[0], style)
    figure.axes[0].set_ylabel("")
    return figure


def save(figure: Figure, stem: Path, png: bool = True) -> str:
    """Write STEM.svg, and STEM.png with a palette of colours; return the SVG's text."""
    file = BytesIO()
    figure.savefig(file, format="svg", metadata={"Date": None, "Creator": None})
    text = compact_svg(
        file.getvalue().decode().replace("'DejaVu Sans'", "'DejaVu Sans', Verdana, sans-serif")
    )
    write_output(stem.with_suffix(".svg"), text)
    if png:
        figure.dpi, canvas = DPI, FigureCanvasAgg(figure)
        canvas.draw()
        pixels = Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")
        few = pixels.quantize(128, method=Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
        file = BytesIO()
        few.save(file, format="png", dpi=(DPI, DPI))
        write_output(stem.with_suffix(".png"), file.getvalue())
    return text
