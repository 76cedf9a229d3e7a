"""The refinement of a page: errors, orders and limits by number of segments, and their cost."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedLocator, NullLocator

from proofmass.base.units import si_unit
from proofmass.base.wording import format_unit, number
from proofmass.case.case import Refine
from proofmass.report.data import PlottedRun
from proofmass.report.figures import (
    TEXT_BACKGROUND,
    ZERO_LEVEL,
    draw_legend_above,
    legend_height,
    set_decades,
    solver_handles,
)
from proofmass.report.style import LABEL_COLOUR, Look
from proofmass.report.words import SYMBOLS
from proofmass.verdict.refinement import RefinedRow, extrapolated_error, observed_order

# [inch] a panel with its labels, and the legend above
REFINEMENT_PANEL_WIDTH, REFINEMENT_PANEL_HEIGHT, LEGEND_HEIGHT = 2.6, 2.2, 0.42
TRIANGLE_SHARE = 0.35  # of the error: top of the triangle that shows the order


def refine_figure(view: PlottedRun, refine: Refine, style: Mapping[str, Look]) -> Figure:
    """Draw a panel for each channel: errors of all solvers, the order as a triangle, the limit."""
    found = rows_by_channel(view)
    rows = -(-len(found) // 4)
    width = -(-len(found) // rows)
    across, labels = REFINEMENT_PANEL_WIDTH * width + 0.2, {row.solver for row in view.refined}
    legend = LEGEND_HEIGHT + legend_height([*labels, limit_label(refine)], across)
    size = np.array([across, REFINEMENT_PANEL_HEIGHT * rows + legend])
    figure = Figure(figsize=tuple(size))
    for k, (channel, solvers) in enumerate(found.items()):
        ax = figure.add_subplot(rows, width, k + 1)
        draw_panel(ax, solvers, refine, style)
        ax.set_title(channel)
    figure.subplots_adjust(
        left=0.68 / size[0],
        right=1 - 0.1 / size[0],
        bottom=0.42 / size[1],
        top=1 - (legend + 0.22) / size[1],
        wspace=0.68 / (REFINEMENT_PANEL_WIDTH - 0.68),
        hspace=0.68 / (REFINEMENT_PANEL_HEIGHT - 0.68),
    )
    draw_legend(figure, view, refine, style, size[1])
    return figure


def draw_panel(
    ax: Axes, solvers: dict[str, list[RefinedRow]], refine: Refine, style: Mapping[str, Look]
) -> None:
    """Draw the errors of a channel; earlier solvers have larger markers, so that all show."""
    ax.set_xscale("log")
    drawn = list[float]()
    for k, (solver, rows) in enumerate(solvers.items()):
        drawn += draw_errors(ax, rows, refine, style[solver], 3.2 + 2.4 * (len(solvers) - 1 - k))
    unit = next(iter(solvers.values()))[0].unit
    quantity, factor = si_unit(unit)
    bounds = (
        {"limit": refine.richardson / factor} if (refine.richardson and quantity == "m") else {}
    )
    if any(value <= refine.error_floor for value in drawn):
        bounds["rounding"] = refine.error_floor
    good = [v for v in (*drawn, *bounds.values()) if np.isfinite(v)] or [1.0]
    set_decades(ax, min(good) / 8, max(good) * 4)
    draw_order(ax, max(solvers.values(), key=len), refine)
    draw_levels(ax, bounds, format_unit(unit))
    ax.xaxis.set_major_locator(FixedLocator(refine.segments))
    ax.xaxis.set_minor_locator(NullLocator())
    ax.xaxis.set_major_formatter("{x:.0f}")
    ax.set_xlim(refine.segments[0] / 1.25, refine.segments[-1] * 1.25)
    ax.set_xlabel("segments of each rod")
    ax.set_ylabel(f"|difference| [{format_unit(unit)}]")


def draw_errors(
    ax: Axes, rows: list[RefinedRow], refine: Refine, look: Look, marker_size: float
) -> list[float]:
    """Draw the errors of a solver, and its limit unless that is rounding; return drawn values."""
    drawn = [max(row.error, ZERO_LEVEL) for row in rows]
    layer = 3 + look.number / 10
    ax.plot(
        [row.segments for row in rows],
        drawn,
        **look.line,
        markerfacecolor="white",
        markersize=marker_size,
        zorder=layer,
    )
    for a, b in pairwise(rows):
        limit_error = abs(extrapolated_error(a, b, refine.order))
        if (a.segments, b.segments) == refine.last and limit_error > refine.error_floor:
            ax.plot(
                b.segments,
                limit_error,
                color=look.colour,
                linestyle="",
                marker="D",
                markerfacecolor="none",
                markersize=marker_size + 0.8,
                zorder=layer,
            )
            drawn.append(limit_error)
    return drawn


def draw_order(ax: Axes, rows: list[RefinedRow], refine: Refine) -> None:
    """Draw a triangle of the expected order below the last two errors above the error floor."""
    above = [pair for pair in pairwise(rows) if min(row.error for row in pair) > refine.error_floor]
    if not above:
        return
    a, b = above[-1]
    foot = draw_triangle(ax, (a.segments, b.segments), TRIANGLE_SHARE * a.error, refine.order)
    ax.annotate(
        "1",
        (np.sqrt(a.segments * b.segments), foot),
        xytext=(0, -2),
        fontsize=7,
        textcoords="offset points",
        ha="center",
        va="top",
        color=LABEL_COLOUR,
    )


def draw_triangle(ax: Axes, sizes: tuple[float, float], top: float, order: float) -> float:
    """Draw a triangle that falls as errors of an order do, with the order at its upright side.

    Parameters
    ----------
    ax : Axes
        Both axes are logarithmic.
    sizes : (float, float)
        Numbers of segments or of steps [1], between which the triangle stands.
    top : float
        The error at its upper corner [its unit], that of the axis.
    order : float
        The power of the number with which errors fall [1].

    Returns
    -------
    float
        The error at its lower side [its unit].
    """
    foot = top * (sizes[0] / sizes[1]) ** order
    ax.fill(
        [sizes[0], sizes[0], sizes[1]],
        [top, foot, foot],
        facecolor="#eeeeee",
        edgecolor=LABEL_COLOUR,
        linewidth=0.8,
        zorder=2,
    )
    ax.annotate(
        number(order),
        (sizes[0], np.sqrt(top * foot)),
        xytext=(-3, 0),
        fontsize=7,
        textcoords="offset points",
        ha="right",
        va="center",
        color=LABEL_COLOUR,
    )
    return foot


def draw_levels(ax: Axes, bounds: dict[str, float], unit: str) -> None:
    """Draw dashed lines at the allowed limit, and at the error floor of rounding."""
    for words, level in bounds.items():
        ax.axhline(level, color=LABEL_COLOUR, linewidth=0.9, linestyle=(0, (7, 3)), zorder=2)
        ax.annotate(
            f"{words} ≤ {number(level)} {unit}",
            (0.01, level),
            xytext=(0, 2),
            fontsize=6.5,
            xycoords=("axes fraction", "data"),
            textcoords="offset points",
            color=LABEL_COLOUR,
            bbox=TEXT_BACKGROUND,
        )


def limit_label(refine: Refine) -> str:
    """The label of the limit that two numbers of segments give."""
    coarse, fine = refine.last
    return f"limit from {coarse} and {fine}"


def draw_legend(
    figure: Figure, view: PlottedRun, refine: Refine, style: Mapping[str, Look], height: float
) -> None:
    """Draw the legend: the solvers, and the meaning of an open diamond."""
    handles = solver_handles(dict.fromkeys(row.solver for row in view.refined), style)
    limit_of = Line2D(
        [],
        [],
        label=limit_label(refine),
        color=LABEL_COLOUR,
        marker="D",
        linestyle="",
        markerfacecolor="none",
    )
    draw_legend_above(figure, [*handles, limit_of], height)


@dataclass(frozen=True)
class RefinementLine:
    """One channel of one solver: its verdicts, and its numbers as text."""

    solver: str
    unit: str
    verdicts: tuple[tuple[str, str, str, str], ...]
    errors: tuple[str, ...]
    orders: tuple[str, ...]
    limits: tuple[str, ...]


def rows_by_channel(view: PlottedRun) -> dict[str, dict[str, list[RefinedRow]]]:
    """Group the rows by channel and solver, from few segments to many."""
    found: dict[str, dict[str, list[RefinedRow]]] = {}
    for row in view.refined:
        found.setdefault(row.channel, {}).setdefault(row.solver, []).append(row)
    return found


def table(view: PlottedRun, refine: Refine) -> dict[str, list[RefinementLine]]:
    """Return the lines of the table by channel."""
    found: dict[str, list[RefinementLine]] = {}
    for channel, solvers in rows_by_channel(view).items():
        for solver, rows in solvers.items():
            own = [
                (c.channel.split()[0], SYMBOLS.get(c.outcome, "?"), c.outcome, c.message)
                for c in view.verdicts
                if c.solver == solver
                and c.channel in ("order", f"order of {channel}", f"limit of {channel}")
            ]
            found.setdefault(channel, []).append(
                RefinementLine(
                    solver,
                    format_unit(rows[0].unit),
                    tuple(own),
                    tuple(number(row.error) for row in rows),
                    format_pairs(rows, lambda a, b: observed_order(a, b, refine.error_floor), 4),
                    format_pairs(rows, lambda a, b: abs(extrapolated_error(a, b, refine.order)), 3),
                )
            )
    return found


def format_pairs(
    rows: list[RefinedRow], compute: Callable[[RefinedRow, RefinedRow], float], digits: int
) -> tuple[str, ...]:
    """Format a number of each row and the one before it, as `compute` computes it."""
    return tuple(number(compute(a, b), digits) for a, b in pairwise(rows))


def costs(view: PlottedRun) -> Iterator[tuple[str, list[str]]]:
    """Yield each solver with its seconds, by number of segments."""
    for solver, rows in next(iter(rows_by_channel(view).values()), {}).items():
        yield solver, [number(row.seconds) for row in rows]


def caption(refine: Refine) -> str:
    """Format the caption: the requirements, and how errors are sampled."""
    coarse, fine = refine.last
    samples = ", which have the same places on the links of all" * (refine.run == "equilibrium")
    bound = "" if refine.richardson is None else f"; it may be {number(refine.richardson)} m off"
    return (
        f"Each rod in {', '.join(map(str, refine.segments))} segments: largest error over the "
        f"samples{samples}; triangles fall with order {number(refine.order)}, from which each "
        f"step may be {number(refine.within)} away: {refine.why}; open diamonds: the limit "
        f"that {coarse} and {fine} segments point to (Richardson), at the last sample{bound}."
    )
