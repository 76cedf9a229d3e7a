"""The figure of a chart: panels with the same axes, lines, regions and fields, and a legend."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from textwrap import fill
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, PathPatch
from matplotlib.path import Path
from matplotlib.ticker import MaxNLocator, MultipleLocator
from matplotlib.tri import Triangulation

from proofmass.analytic.chart import Chart, ChartLine, ChartRegion, Field
from proofmass.base.arrays import Array
from proofmass.base.wording import format_unit, number
from proofmass.report.data import displayed_unit
from proofmass.report.figures import TEXT_BACKGROUND, thin_path
from proofmass.report.style import INK, MUTED_COLOURS, SOLID, Dash, Look
from proofmass.report.views import WHITE_EDGES

CHART_DASHES: list[Dash] = [
    (0, (4, 2)),
    (0, (1.2, 1.2)),
    (0, (8, 1.5, 1.2, 1.5)),
    (0, (2.5, 2.5)),
    (0, (9, 2)),
]
MARKERS = "os^Dvp*"
UNLABELLED_LOOK = Look(INK, (0, (5, 3)), "o")  # of lines without a label
MAX_LINE_POINTS = 500  # approximate number of points to which a line is reduced


def label_looks(chart: Chart) -> dict[str, Look]:
    """Return a look for every label of a chart; lines differ from all solvers, points are black."""
    points = dict.fromkeys(line.label for line in chart.lines if line.label and line.points)
    lines = dict.fromkeys(line.label for line in chart.lines if line.label and not line.points)
    black = {
        label: Look(INK, SOLID, MARKERS[k % len(MARKERS)], k) for k, label in enumerate(points)
    }
    return black | {
        label: Look(
            MUTED_COLOURS[k % len(MUTED_COLOURS)],
            CHART_DASHES[k % len(CHART_DASHES)],
            MARKERS[k % len(MARKERS)],
            k,
        )
        for k, label in enumerate(lines)
    }


def draw_line(ax: Axes, line: ChartLine, look: Look, scale: Array, *, cased: bool = False) -> None:
    """Draw a line, reduced if it is long, or its points; `cased` adds white edges on a field."""
    x, y = thin_line(line).T * scale[:, None]
    if line.points or line.bars:
        ax.plot(x, y, **line_style(line, look))
        return
    step = max(len(x) // 5, 1)  # between markers, which are staggered between labels
    ax.plot(
        x,
        y,
        **line_style(line, look),
        path_effects=WHITE_EDGES if cased else None,
        markevery=((1 + look.number) % 4 * step // 4, step),
    )


def line_style(line: ChartLine, look: Look) -> dict[str, Any]:
    """Return the style of a line or its points as matplotlib's keywords.

    Stable lines are bold, unstable ones thin and dashed; points are filled if stable, else hollow.
    Labelled bold lines have markers, which distinguish them on a black-and-white print.
    """
    shared: dict[str, Any] = {"color": look.colour, "zorder": 3 + line.stable + 2 * line.points}
    if line.points:
        return shared | {
            "linestyle": "",
            "marker": look.marker,
            "markersize": 4.6,
            "markerfacecolor": look.colour if line.stable else "white",
        }
    if line.bars:
        thick = 4.4 if look.number % 2 == 0 else 2.4  # two bars at the same place are both visible
        width, dash = (thick, SOLID) if line.stable else (1.0, CHART_DASHES[0])
        return shared | {
            "linewidth": width,
            "linestyle": dash,
            "solid_capstyle": "round",
            "marker": "o",
            "markersize": 4.6 if line.stable else 3.0,
            "markerfacecolor": "white",
            "markeredgewidth": 0.9,
        }
    if not line.stable:
        return shared | {"linewidth": 0.9, "linestyle": look.dash}
    bold = shared | {"linewidth": 2.0, "linestyle": "-", "solid_capstyle": "round"}
    if look is UNLABELLED_LOOK:
        return bold
    return bold | {
        "marker": look.marker,
        "markersize": 4.0,
        "markerfacecolor": "white",
        "markeredgewidth": 0.9,
    }


def thin_line(line: ChartLine) -> Array:
    """Return at most about `MAX_LINE_POINTS` points of a line (n, 2), with the ends of its pieces.

    >>> line = ChartLine(np.append(np.arange(3000.0), np.nan), np.ones(3001))
    >>> thin_line(line).shape
    (501, 2)
    """
    points = np.stack([line.x, line.y], axis=1).astype(float)
    points[~np.isfinite(points).all(axis=1)] = np.nan
    if line.points or len(points) <= MAX_LINE_POINTS:
        return points
    edges = np.flatnonzero(np.diff(np.isnan(points[:, 0]))) + 1
    share = MAX_LINE_POINTS / len(points)
    return np.concatenate(
        [
            thin_path(piece, max(2, math.ceil(share * len(piece))))
            for piece in np.split(points, edges)
        ]
    )


ZERO_LINE: dict[str, Any] = {"color": INK, "linewidth": 1.8}
COLOURED_SHARE = 0.96  # share of the values that the colours cover, since fields may have poles


def contour_levels(chart: Chart, field: Field) -> Array:
    """Return round levels, the same for all fields of one label, so that colours are comparable."""
    same = [
        panel.field for panel in chart.panels if panel.field and panel.field.label == field.label
    ]
    values = np.concatenate([one.values.ravel() for one in same]) * displayed_unit(field.unit)[1]
    values = values[np.isfinite(values)]
    values = values if values.size else np.array([-1.0, 1.0])
    top = float(np.quantile(np.abs(values), COLOURED_SHARE))
    ends = np.quantile(values, [0.5 - COLOURED_SHARE / 2, 0.5 + COLOURED_SHARE / 2])
    return np.asarray(MaxNLocator(10).tick_values(*((-top, top) if field.signed else ends)))


def draw_field(ax: Axes, field: Field, levels: Array, scale: Array) -> None:
    """Draw a field: colours, thin contour lines, dashed below zero, and a colour bar.

    A signed field has two colours that meet at zero, and a bold line there.
    """
    unit, factor = displayed_unit(field.unit)
    values = np.ma.masked_invalid(np.transpose(field.values) * factor)
    if not values.count() or (field.triangles is not None and not len(field.triangles)):
        return
    x, y = field.x * scale[0], field.y * scale[1]
    fill_in: Any = ax.contourf
    line_in: Any = ax.contour
    grid: tuple[Any, ...] = (x, y, values)
    if field.triangles is not None:
        grid = (Triangulation(x, y, triangles=field.triangles), values)
        fill_in, line_in = ax.tricontourf, ax.tricontour
    least, most = float(values.min()), float(values.max())
    extend = ("neither", "max", "min", "both")[(most > levels[-1]) + 2 * (least < levels[0])]
    colours = fill_in(
        *grid,
        levels=levels,
        cmap="PuOr" if field.signed else "cividis_r",
        extend=extend,
        zorder=0.5,
    )
    colours.set_edgecolor("face")  # otherwise viewers show thin white lines between the areas
    met = levels[(least < levels) & (levels < most)]
    if met.size:
        line_in(*grid, levels=met, colors=INK, linewidths=0.35, zorder=0.6)
    if field.signed and least < 0 < most:
        line_in(
            *grid,
            levels=[0.0],
            colors=ZERO_LINE["color"],
            linewidths=ZERO_LINE["linewidth"],
            zorder=0.7,
        )
    bar = ax.figure.colorbar(colours, cax=ax.inset_axes((1.03, 0.0, 0.045, 1.0)))
    bar.set_label(f"{field.label} [{format_unit(unit)}]" if unit else field.label)


REGION_COLOURS = ("#cfe0f0", "#f4d9b0", "#d9d2e9", "#d5e8d4", "#f3d0d6", "#e6e6e6")
"""Colours of regions: pale, so that lines are visible on them, and of different lightness."""
REGION_HATCHES = ("", "////", "....", "xxxx", "----", "++++")
"""Hatches of regions, which distinguish them on a black-and-white print."""
HALF_NUMBER_SIZE = np.array([0.28, 0.07])  # [inch] half of a number's width and height
PLACES_ACROSS = 28  # number of places across a region, and up, at which its number is tried


def region_styles(chart: Chart) -> dict[str, dict[str, Any]]:
    """Return colour and hatch of the regions, by label."""
    labels = dict.fromkeys(region.label for region in chart.regions)
    return {
        label: {
            "facecolor": REGION_COLOURS[k % len(REGION_COLOURS)],
            "hatch": REGION_HATCHES[k % len(REGION_HATCHES)],
            "edgecolor": "#8a8f96",
            "linewidth": 0.0,
        }
        for k, label in enumerate(labels)
    }


def draw_region(
    ax: Axes, region: ChartRegion, fill_of: Mapping[str, Any], box: "PanelFrame", cell: Array
) -> None:
    """Draw a region with its colour and hatch, and its area as a number where there is room.

    `cell` is the size of the panel [inch].
    """
    rings = [np.asarray(outline) * box.scale for outline in region.outlines if len(outline) > 2]
    if not rings:
        return
    paths = [Path(np.append(ring, ring[:1], axis=0)) for ring in rings]
    path = Path.make_compound_path(*paths)
    ax.add_patch(PathPatch(path, zorder=0.5, **fill_of))
    if not np.isfinite(region.area):
        return
    scale = cell / (box.high - box.low) / HALF_NUMBER_SIZE
    place, room = widest_place([ring * scale for ring in rings])
    if room > 1.0:
        x, y = place / scale
        unit = f"{format_unit(box.units[0])}²" if box.units[0] == box.units[1] else ""
        ax.text(
            x,
            y,
            f"{number(region.area, 4)} {unit}".rstrip(),
            fontsize=7,
            ha="center",
            va="center",
            zorder=7,
            bbox=TEXT_BACKGROUND,
        )


def widest_place(rings: list[Array]) -> tuple[Array, float]:
    """Find the place in a region that is farthest from its outlines, on a grid, and its distance.

    >>> square = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]])
    >>> place, room = widest_place([square])
    >>> bool(np.abs(place - 2.0).max() < 0.1), round(room, 1)
    (True, 1.9)
    """
    low, high = rings[0].min(axis=0), rings[0].max(axis=0)
    share = (np.arange(PLACES_ACROSS) + 0.5) / PLACES_ACROSS
    grid = low + np.stack(np.meshgrid(share, share), axis=-1).reshape(-1, 2) * (high - low)
    inside = [Path(np.append(ring, ring[:1], axis=0)).contains_points(grid) for ring in rings]
    grid = grid[np.sum(inside, axis=0) % 2 == 1]
    if not len(grid):
        return 0.5 * (low + high), 0.0
    far = np.full(len(grid), np.inf)
    for ring in rings:
        start, way = ring, np.roll(ring, -1, axis=0) - ring
        long = np.maximum(np.sum(way**2, axis=1), 1e-300)
        apart = grid[:, None] - start
        along = np.clip(np.sum(apart * way, axis=2) / long, 0.0, 1.0)
        far = np.minimum(far, np.linalg.norm(apart - along[..., None] * way, axis=2).min(axis=1))
    wide = np.flatnonzero(far >= 0.98 * far.max())  # in a strip many places are about as far
    middle = grid[wide].mean(axis=0)
    best = wide[np.argmin(np.linalg.norm(grid[wide] - middle, axis=1))]
    return grid[best], float(far[best])


PANEL_WIDTHS = {1: 4.6, 2: 3.4, 3: 2.7, 4: 2.2}  # [inch] width of a panel, by the number in a row
# height over width of a panel: largest, least, and of charts whose axes have different scales
MAX_PANEL_RATIO, MIN_PANEL_RATIO, PANEL_RATIO = 1.5, 0.4, 0.72
# [inch] margins, and room for a colour bar
CHART_LEFT_MARGIN, CHART_BOTTOM_MARGIN, CHART_TOP_MARGIN, COLOUR_BAR_WIDTH = 0.72, 0.45, 0.3, 0.95
LETTER_WIDTH = 0.066  # [inch] mean width of a letter


@dataclass(frozen=True)
class PanelFrame:
    """The ranges of a chart's axes: corners (2,) in displayed units, the units, factors from SI."""

    low: Array
    high: Array
    units: tuple[str, str]
    scale: Array

    @property
    def height_over_width(self) -> float:
        """Height over width, in displayed units."""
        across, up = self.high - self.low
        return float(up / across)


@dataclass(frozen=True)
class Layout:
    """The grid of panels [inch]: columns and rows, panel size, gaps, room for titles and legend."""

    across: int
    down: int
    cell: Array
    gap: Array
    head: float
    bar: float
    key: float

    @property
    def right(self) -> float:
        """The right end of the panels."""
        return float(CHART_LEFT_MARGIN + self.across * (self.cell[0] + self.gap[0]) - self.gap[0])

    @property
    def size(self) -> Array:
        """Width and height of the figure."""
        high = self.down * (self.cell[1] + self.gap[1]) - self.gap[1]
        return np.array(
            [
                self.right + self.bar + self.key,
                CHART_TOP_MARGIN + self.head + high + CHART_BOTTOM_MARGIN,
            ]
        )


def chart_figure(title: str, chart: Chart) -> Figure:
    """Draw a chart: panels with the same axes, and the legend at their right."""
    box, looks = panel_frame(chart), label_looks(chart)
    filling = region_styles(chart)
    handles = [
        *(Patch(label=fill(name, 36), **of) for name, of in filling.items()),
        *legend_handles(chart, looks),
    ]
    plan, titles = layout(chart, box, handles)
    wide, high = np.maximum(plan.size, [0.2 + 1.4 * LETTER_WIDTH * len(title), 0.0])
    figure = Figure(figsize=(wide, high))
    grid = figure.add_gridspec(
        plan.down,
        plan.across,
        left=CHART_LEFT_MARGIN / wide,
        right=plan.right / wide,
        bottom=CHART_BOTTOM_MARGIN / high,
        top=1 - (CHART_TOP_MARGIN + plan.head) / high,
        wspace=plan.gap[0] / plan.cell[0],
        hspace=plan.gap[1] / plan.cell[1],
    )
    for k, panel in enumerate(chart.panels):
        ax = figure.add_subplot(grid[divmod(k, plan.across)])
        ax.set_title(titles[k])
        for region in panel.regions:
            draw_region(ax, region, filling[region.label], box, plan.cell)
        if panel.field:
            draw_field(ax, panel.field, contour_levels(chart, panel.field), box.scale)
        for line in panel.lines:
            draw_line(
                ax, line, looks.get(line.label, UNLABELLED_LOOK), box.scale, cased=bool(panel.field)
            )
        format_axes(
            ax, chart, box, first=k % plan.across == 0, lowest=k + plan.across >= len(chart.panels)
        )
    figure.text(0.1 / wide, 1 - 0.06 / high, title, fontsize=10, weight="bold", va="top")
    figure.legend(
        handles=handles,
        loc="upper left",
        fontsize=8,
        handlelength=3.0,
        bbox_to_anchor=(
            (plan.right + plan.bar + 0.05) / wide,
            1 - (CHART_TOP_MARGIN + plan.head - 0.1) / high,
        ),
    )
    return figure


def layout(chart: Chart, box: PanelFrame, handles: Sequence[Artist]) -> tuple[Layout, list[str]]:
    """Return a nearly square grid of panels, and the panels' titles, broken to fit them."""
    count = len(chart.panels)
    across = count if count <= 3 else math.isqrt(count - 1) + 1
    wide = PANEL_WIDTHS[across]
    titles = [fill(panel.title, int(wide / LETTER_WIDTH)) for panel in chart.panels]
    head = 0.06 + 0.14 * max(text.count("\n") + bool(text) for text in titles)
    bar = COLOUR_BAR_WIDTH * any(panel.field for panel in chart.panels)
    rows = [row for handle in handles for row in str(handle.get_label()).split("\n")]
    cell = np.array([wide, wide * (box.height_over_width if chart.equal_scales else PANEL_RATIO)])
    key = 0.62 + LETTER_WIDTH * max(map(len, rows)) if rows else 0.1
    return Layout(
        across, -(-count // across), cell, np.array([0.2 + bar, head + 0.14]), head, bar, key
    ), titles


def panel_frame(chart: Chart) -> PanelFrame:
    """Return ranges of the axes that contain all finite points.

    A chart of shapes (`alike`) has one scale for both axes, and the ratio of height to width of its
    panels is from `MIN_PANEL_RATIO` to `MAX_PANEL_RATIO`.  The margin of a logarithmic axis is
    in decades.
    """
    (across, wide), (up, high) = displayed_unit(chart.x[1]), displayed_unit(chart.y[1])
    scale = np.array([wide, high])
    parts = [np.stack([line.x, line.y]) for line in chart.lines]
    parts += [outline.T for region in chart.regions for outline in region.outlines]
    for field in (panel.field for panel in chart.panels if panel.field):
        parts.append(np.stack(field.places))
    cloud = np.concatenate([np.empty((2, 0)), *parts], axis=1) * scale[:, None]
    if chart.logarithmic:
        cloud[1] = np.log10(np.where(cloud[1] > 0.0, cloud[1], np.nan))
    cloud = cloud[:, np.isfinite(cloud).all(axis=0)]
    cloud = cloud if cloud.size else np.array([[0.0, 1.0], [0.0, 1.0]])
    low, top = cloud.min(axis=1), cloud.max(axis=1)
    middle, span = 0.5 * (low + top), top - low
    flat = span <= 1e-9 * np.abs(cloud).max(axis=1)  # do not magnify rounding
    least = 0.0 if chart.equal_scales and not flat.all() else np.maximum(np.abs(middle), 1.0)
    half = 0.53 * np.where(flat, least, span)
    if chart.equal_scales:
        half[1] = max(half[1], MIN_PANEL_RATIO * half[0])
        half[0] = max(half[0], half[1] / MAX_PANEL_RATIO)
    low, top = middle - half, middle + half
    if chart.logarithmic:
        low[1], top[1] = 10.0 ** low[1], 10.0 ** top[1]
    return PanelFrame(low, top, (across, up), scale)


def format_axes(ax: Axes, chart: Chart, box: PanelFrame, *, first: bool, lowest: bool) -> None:
    """Set ranges, ticks and grid of a panel; labels only at the left and below the lowest."""
    if chart.logarithmic:
        ax.set_yscale("log", nonpositive="mask")
    ax.set(xlim=(box.low[0], box.high[0]), ylim=(box.low[1], box.high[1]))
    counted = [line.x == np.rint(line.x) for line in chart.lines if not chart.x[1]]
    if counted and np.concatenate(counted).all():
        ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    for axis, unit, span in zip((ax.xaxis, ax.yaxis), box.units, box.high - box.low, strict=True):
        if unit == "deg":
            axis.set_major_locator(
                MultipleLocator(next((s for s in (5, 10, 15, 30, 45, 90) if span / s < 8.01), 180))
            )
    ax.tick_params(labelbottom=lowest, labelleft=first)
    ax.set_xlabel(axis_label(chart.x[0], box.units[0]) * lowest)
    ax.set_ylabel(axis_label(chart.y[0], box.units[1]) * first)
    ax.grid(not (ax.collections or ax.patches))


def axis_label(name: str, unit: str) -> str:
    """Format an axis label: name with unit, if there is any.

    >>> axis_label("angle", "deg"), axis_label("R / R_cr", "")
    ('angle [deg]', 'R / R_cr')
    """
    return f"{name} [{format_unit(unit)}]" if unit else name


def legend_handles(chart: Chart, looks: Mapping[str, Look]) -> list[Line2D]:
    """Return the legend's entries: labels, and what bold and dashed mean where no label does."""
    entries: dict[str, ChartLine] = {}
    for line in chart.lines:
        if line.label and (line.label not in entries or line.stable):
            entries[line.label] = line
    rows = [(label, line_style(line, looks[label])) for label, line in entries.items()]
    if any(
        not line.stable and (not line.label or entries[line.label].stable)
        for line in chart.lines
        if not line.points
    ):
        none = np.empty(0)
        rows += [
            ("stable", line_style(ChartLine(none, none), UNLABELLED_LOOK)),
            ("unstable", line_style(ChartLine(none, none, stable=False), UNLABELLED_LOOK)),
        ]
    signed = {panel.field.label for panel in chart.panels if panel.field and panel.field.signed}
    rows += [(f"zero of {label}", ZERO_LINE) for label in sorted(signed)]
    return [Line2D([], [], label=fill(label, 36), **look) for label, look in rows]
