"""Views: curves of a run over another x, also as loops, compared with other parameter sets.

The figure of a view shows curves or a stack, and below them the differences to the reference or the
sum of the stack less its mean.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from textwrap import fill
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.patheffects import Normal, Stroke
from matplotlib.ticker import MultipleLocator

from proofmass.base.arrays import Array
from proofmass.base.wording import format_list, format_unit, number
from proofmass.case.case import Case, View
from proofmass.reference.plot_data import PlotData, plot_data
from proofmass.report.data import PlottedRun, displayed_unit, monotonic_stretches, thin_curve
from proofmass.report.figures import (
    TEXT_BACKGROUND,
    draw_difference,
    draw_overlay,
    draw_panel,
    solver_handles,
)
from proofmass.report.style import INK, REFERENCE_STYLE, SOLID, Look


@dataclass(frozen=True)
class Viewed:
    """A view of a run.

    Attributes
    ----------
    view : View
        The table of the sidecar.
    own, beside : PlotData, dict of str to PlotData
        The reference over the longest run, and the same with other parameter sets, by their names.
    over : PlottedRun
        The run with the view's x in place of its own.
    """

    view: View
    own: PlotData
    beside: dict[str, PlotData]
    over: PlottedRun

    @property
    def x(self) -> Array:
        """The reference's x, in the displayed unit."""
        return self.own.values[self.view.x] * self.over.x_scale

    @property
    def loop(self) -> bool:
        """Whether x turns back, so that the curve is a loop."""
        return len(monotonic_stretches(self.x)) > 1

    def readable(self, name: str, by: PlotData | None = None) -> Array:
        """Return a curve of the reference in the displayed unit; `by` is another parameter set."""
        source = by or self.own
        return source.values[name] * displayed_unit(source.units[name])[1]

    def total(self, by: PlotData | None = None) -> Array:
        """Return the sum of the stacked quantities; `by` is another parameter set."""
        return np.sum([self.readable(name, by) for name in self.view.stack], axis=0)


def apply_view(shown: PlottedRun, view: View) -> Viewed:
    """Replace the x of a run by that of a view.

    It is a solver's own curve where x is a channel, otherwise the reference's.
    """
    case = shown.case
    of_longest = max(shown.curves, key=lambda solver: len(shown.curves[solver].x))
    longest, own_reference = shown.curves[of_longest], shown.reference[of_longest]
    bare = view.model_copy(update={"y": (), "stack": (), "dashed": (), "marks": {}})
    curves, reference = {}, {}
    for solver, found in shown.curves.items():
        there = plot_data(case, bare, found, reference=shown.reference[solver]).values[view.x]
        reference[solver] = replace(shown.reference[solver], x=there)
        x = found.channels.get(view.x) if view.x in case.channels else there
        if x is not None:
            curves[solver] = replace(found, x=x)
    own = plot_data(case, view, longest, reference=own_reference)
    unit, scale = displayed_unit(own.units[view.x])
    return Viewed(
        view,
        own,
        {name: plot_data(case, view, longest, name) for name in case.compare_with},
        replace(
            shown,
            curves=curves,
            reference=reference,
            x_name=format_joint(case, view.x, unit),
            x_unit=unit,
            x_scale=scale,
        ),
    )


def format_joint(case: Case, name: str, unit: str) -> str:
    """Format the name of a driven joint with "angle" or "position"; other names are unchanged."""
    joint = name not in case.channels and name in [d.joint for d in case.drive]
    return name + (" angle" if unit == "deg" else " position") * joint


def apply_views(case: Case, shown: list[PlottedRun]) -> list[Viewed]:
    """Return the views of a case whose runs have curves."""
    return [
        apply_view(s, view)
        for view in case.view
        for s in (one.without_failed for one in shown)
        if s.curves and s.kind == case.run_of(view)
    ]


def stack_unit(view: Viewed) -> str:
    """Return the displayed unit of the quantities that a view stacks."""
    return format_unit(displayed_unit(view.own.units[view.view.stack[0]])[0])


def format_spread(view: Viewed, by: PlotData | None = None) -> str:
    """Format how constant the sum of a stack is: its range, spread, and spread over the mean."""
    total = view.total(by)
    low, high, mean = float(np.min(total)), float(np.max(total)), float(np.mean(total))
    tiny = 1e-12 * max(abs(low), abs(high))  # a smaller number is a zero with rounding
    ends = " to ".join(number(end if abs(end) > tiny else 0.0, 4) for end in (low, high))
    share = f", {number(100 * (high - low) / abs(mean), 2)} % of its mean" if mean else ""
    return (
        f"{ends} {stack_unit(view)}, a spread of {number(high - low, 3)} {stack_unit(view)}{share}"
    )


def view_caption(view: Viewed) -> str:
    """Format the caption of a view's figure."""
    if view.view.stack:
        words = [
            f"The reference's {format_list(view.view.stack)}, stacked"
            + (" on the first way" if view.loop else "")
            + f"; their sum as a line, {format_spread(view)}; below, the sum less its mean"
        ]
        words += [f"{name}: {format_spread(view, by)}" for name, by in view.beside.items()]
    else:
        words = ["Reference (thick, pale) and solvers on top of it"]
        words += ["markers open where x rises, filled where it falls"] * view.loop
        words += [f"dashed: {format_list(view.view.dashed)}"] * bool(view.view.dashed)
        words += [f"thin: {format_list(view.beside)}"] * bool(view.beside)
        words += [
            "below, the difference to the reference in the channel's unit, with what the "
            "tolerance allows"
        ] * any(n in view.over.channels for n in view.view.y)
    return "; ".join(words) + "."


DASHED_STYLES: list[dict[str, Any]] = [
    {"color": colour, "linewidth": 1.3, "linestyle": (0, dash), "zorder": 2.8}
    for colour, dash in (
        (INK, (5, 3)),
        ("#7b4ba0", (1, 1.5)),
        ("#6b5600", (6, 2, 1, 2)),
        ("#555555", (9, 3)),
    )
]
SUM_STYLE: dict[str, Any] = {"color": INK, "linewidth": 1.7, "zorder": 2.7}
OTHER_SET_STYLES: list[dict[str, Any]] = [
    {"color": colour, "linewidth": 0.9, "linestyle": dash, "zorder": 2.6}
    for colour, dash in (
        ("#7b4ba0", SOLID),
        ("#6b5600", (0, (1, 1.5))),
        ("#555555", (0, (8, 2))),
        ("#7b4ba0", (0, (3, 1, 1, 1))),
    )
]
# colours of stacked quantities, the lowest one darkest
STACK_COLOURS = ("#574488", "#8a78b4", "#b3a6d0", "#d6cee6", "#efecf6", "#c9ccd1")
MIN_MARK_DISTANCE = 0.035  # of a panel's width: marks with a smaller distance share one text
WHITE_EDGES = [Stroke(linewidth=3.2, foreground="white"), Normal()]  # white edges of lines on areas
LEGEND_CHARACTERS = 28  # [characters] width of the legend
# [inch] heights of panels, width of the legend beside them
VIEW_PANEL_HEIGHT, LOWER_PANEL_HEIGHT, LEGEND_WIDTH = 2.75, 0.95, 2.35


def view_figure(view: Viewed, style: Mapping[str, Look]) -> Figure:
    """Draw a panel for each curve, or one for the stack, with a panel below at a finer scale."""
    names = view.view.y or ("",)
    heights = [VIEW_PANEL_HEIGHT, LOWER_PANEL_HEIGHT][
        : 1 + any(has_lower_panel(view, name) for name in names)
    ]
    width, wide = min(len(names), 3), 4.3 if len(names) == 1 else 3.0
    rows, apart = -(-len(names) // width), np.array([0.75, 0.62])
    cell = np.array([wide, sum(heights)])
    size = np.array(
        [
            0.75 + width * wide + (width - 1) * apart[0] + LEGEND_WIDTH,
            0.98 + rows * cell[1] + (rows - 1) * apart[1],
        ]
    )
    figure = Figure(figsize=tuple(size))
    grid = figure.add_gridspec(
        rows,
        width,
        left=0.75 / size[0],
        right=1 - LEGEND_WIDTH / size[0],
        bottom=0.43 / size[1],
        top=1 - 0.55 / size[1],
        wspace=apart[0] / cell[0],
        hspace=apart[1] / cell[1],
    )
    for k, name in enumerate(names):
        parts = grid[k // width, k % width].subgridspec(
            len(heights), 1, height_ratios=heights, hspace=0.1
        )
        pair = [figure.add_subplot(parts[i]) for i in range(1 + has_lower_panel(view, name))]
        if view.view.stack:
            draw_stack(pair[0], pair[1], view)
        else:
            draw_curve(pair, view, name, style)
        set_shared_axis(pair, view)
        draw_marks(pair, view, name)
    figure.text(
        0.1 / size[0], 1 - 0.08 / size[1], view.view.title, fontsize=10, weight="bold", va="top"
    )
    draw_legend(figure, view, style, size)
    return figure


def has_lower_panel(view: Viewed, name: str) -> bool:
    """Whether a curve has a panel below: with its differences, or with the sum of a stack."""
    return bool(view.view.stack) or name in view.over.channels


def draw_curve(pair: list[Axes], view: Viewed, name: str, style: Mapping[str, Look]) -> None:
    """Draw a curve of `y`: reference, solvers, dashed curves and other parameter sets.

    The panel below shows the differences to the reference.
    """
    others = [view.readable(name, by) for by in view.beside.values()]
    target = [view.readable(name) for name in view.view.dashed]
    unit = displayed_unit(view.own.units[name])[0]
    if name in view.over.channels:
        draw_overlay(pair[0], view.over, name, style, [*others, *target])
        draw_difference(pair[1], view.over, name, style)
        pair[1].set_title("")
        pair[1].set_ylabel(f"|diff.| [{format_unit(view.own.units[name])}]")
    else:
        jumps = {"": view.over.jumps.of(name)}
        draw_panel(
            pair[0],
            view.over,
            name,
            view.readable(name),
            {},
            style,
            unit,
            [*others, *target],
            jumps,
        )
    for y, look in [
        *zip(others, OTHER_SET_STYLES * len(others), strict=False),
        *zip(target, DASHED_STYLES * len(target), strict=False),
    ]:
        pair[0].plot(*remove_retraced(view.x, y), **look)


def remove_retraced(x: Array, y: Array) -> tuple[Array, Array]:
    """Return a curve without parts that retrace its first one, which would fill the gaps of dashes.

    >>> x = np.array([0.0, 1.0, 2.0, 1.0, 0.0])
    >>> [len(remove_retraced(x, y)[0]) for y in (x**2, np.arange(5.0))]
    [3, 5]
    """
    way = monotonic_stretches(x)[0][0]
    rising = np.argsort(x[way])
    again = np.interp(x, x[way][rising], y[way][rising])
    retraced = np.abs(again - y).max() <= 1e-3 * np.ptp(y)  # less than a line is wide
    return thin_curve(x[way], y[way], 300) if retraced else thin_curve(x, y, 300)


def draw_stack(ax: Axes, below: Axes, view: Viewed) -> None:
    """Draw stacked quantities, negative ones downwards; in `below` their sum less its mean."""
    way = monotonic_stretches(view.x)[0][0]
    x = view.x[way]
    up, down = np.zeros_like(x), np.zeros_like(x)
    for name, colour in zip(view.view.stack, STACK_COLOURS * len(view.view.stack), strict=False):
        part = view.readable(name)[way]
        base = np.where(part >= 0, up, down)
        ax.fill_between(
            x, base, base + part, facecolor=colour, edgecolor="white", linewidth=0.5, zorder=1
        )
        up, down = up + np.maximum(part, 0), down + np.minimum(part, 0)
    lines = [
        (view.total(by), look)
        for by, look in zip(view.beside.values(), OTHER_SET_STYLES * len(view.beside), strict=False)
    ]
    for total, look in [*lines, (view.total(), SUM_STYLE)]:
        ax.plot(*remove_retraced(view.x, total), **look, path_effects=WHITE_EDGES)
        below.plot(*remove_retraced(view.x, total - np.mean(total)), **look)
    ax.grid(False)
    ax.set_ylim(min(0.0, 1.05 * float(down.min())), None)
    ax.set_title("sum: " + format_spread(view), fontweight="normal")
    ax.set_ylabel(f"[{stack_unit(view)}]")
    below.set_ylabel(f"sum − mean [{stack_unit(view)}]")


def set_shared_axis(pair: list[Axes], view: Viewed) -> None:
    """Set the horizontal axis that a panel shares with the one below it."""
    low, high = float(np.nanmin(view.x)), float(np.nanmax(view.x))
    for ax in pair:
        ax.set_xlim(low, high)
        if view.over.x_unit == "deg":
            step = next((s for s in (5, 10, 15, 30, 45, 90) if (high - low) / s < 8.01), 180)
            ax.xaxis.set_major_locator(MultipleLocator(step))
        ax.tick_params(labelbottom=ax is pair[-1])
        ax.yaxis.set_label_coords(-0.13 if len(view.view.y) < 2 else -0.18, 0.5)
        ax.yaxis.get_offset_text().set(x=1, ha="right")
    pair[-1].set_xlabel(f"{view.over.x_name} [{view.over.x_unit}]")


def draw_marks(pair: list[Axes], view: Viewed, name: str) -> None:
    """Draw a vertical line at each mark, with its words where the curve leaves room."""
    y = view.readable(name) if name else view.total()
    unit = "°" if view.over.x_unit == "deg" else f" {format_unit(view.over.x_unit)}"
    for places in group_marks(view):
        for x in places.values():
            for ax in pair:
                ax.axvline(x, color=INK, linewidth=0.8, linestyle=(0, (1, 2)), zorder=2.4)
        right = max(places.values()) > np.mean(pair[0].get_xlim())
        x = min(places.values()) if right else max(places.values())
        low, high = pair[0].get_ylim()
        top = y[np.nanargmin(np.abs(view.x - x))] < 0.5 * (low + high)
        words = "\n".join(f"{word} {number(at, 4)}{unit}" for word, at in places.items())
        pair[0].annotate(
            words,
            (x, 0.97 if top else 0.03),
            rotation=90,
            fontsize=7,
            color=INK,
            xycoords=("data", "axes fraction"),
            textcoords="offset points",
            xytext=(-3 if right else 3, 0),
            ha="right" if right else "left",
            va="top" if top else "bottom",
            zorder=9,
            bbox=TEXT_BACKGROUND,
        )


def group_marks(view: Viewed) -> list[dict[str, float]]:
    """Group the marks from left to right; those too near for separate texts are in one group."""
    room = MIN_MARK_DISTANCE * float(np.ptp(view.x))
    groups: list[dict[str, float]] = []
    for word, x in sorted(view.own.marks.items(), key=lambda item: item[1]):
        x *= view.over.x_scale
        if groups and x - max(groups[-1].values()) < room:
            groups[-1][word] = x
        else:
            groups.append({word: x})
    return groups


def draw_legend(figure: Figure, view: Viewed, style: Mapping[str, Look], size: Array) -> None:
    """Draw the legend beside the panels."""
    handles: list[Any] = []
    if view.view.stack:
        handles += [Line2D([], [], label="sum", **SUM_STYLE)]
        handles += reversed(
            [
                Patch(facecolor=colour, edgecolor="white", label=name)
                for name, colour in zip(
                    view.view.stack, STACK_COLOURS * len(view.view.stack), strict=False
                )
            ]
        )
    else:
        handles += [Line2D([], [], label="reference", **REFERENCE_STYLE)]
        shown = any(n in view.over.channels for n in view.view.y)
        handles += solver_handles(view.over.curves if shown else (), style)
    handles += [
        Line2D([], [], label=fill(name, LEGEND_CHARACTERS), **look)
        for name, look in zip(view.view.dashed, DASHED_STYLES * len(view.view.dashed), strict=False)
    ]
    handles += [
        Line2D([], [], label=fill(name, LEGEND_CHARACTERS), **look)
        for name, look in zip(view.beside, OTHER_SET_STYLES * len(view.beside), strict=False)
    ]
    if view.loop and not view.view.stack:
        handles += [
            Line2D(
                [],
                [],
                linestyle="",
                marker="o",
                color="#777777",
                markersize=4.5,
                markerfacecolor=face,
                label=f"{view.over.x_name} {way}",
            )
            for face, way in (("white", "rises"), ("#777777", "falls"))
        ]
    figure.legend(
        handles=handles,
        loc="upper left",
        fontsize=8,
        handlelength=3.0,
        bbox_to_anchor=(1 - (LEGEND_WIDTH - 0.1) / size[0], 1 - 0.42 / size[1]),
    )
