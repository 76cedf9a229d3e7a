"""Draw the work-precision diagram of a trade study as a figure for papers.

It shows errors over processor time and over steps on logarithmic axes, with letters for the series,
crosses for failed settings, triangles for expected orders, and error floors with their causes.
"""

from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from operator import attrgetter
from string import ascii_lowercase
from textwrap import fill
from typing import Any

import numpy as np

from proofmass.report.style import FIXED_LOOKS, LABEL_COLOUR, SOLID, Dash, Look, solver_looks  # isort: skip
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, NullLocator
from numpy.typing import NDArray

from proofmass.base.grouping import group_by
from proofmass.base.wording import number
from proofmass.report.figures import set_decades
from proofmass.report.refinements import draw_triangle
from proofmass.sim.engines import NoEngine, engine_of
from proofmass.studies.record import KIND_UNITS, StudyRow
from proofmass.studies.trade.varied import setting_size
from proofmass.studies.trade.verdict import Verdict, pareto_front
from proofmass.verdict.outcome import Outcome

LINE_COLOUR = "#888888"
SHARED_LETTER_DISTANCE = 9.0
"""Distance of ends of series up to which their letters share one place [pt]."""
SHARED_TEXT_RATIO = 3.0
"""Ratio of error floors of one cause up to which they share one text in the margin."""
MARGIN_CHARACTERS = 26  # characters in a line of the margin
MARGIN_LINE_HEIGHT = 0.06  # height of a line of the margin, as a share of the height of a panel
TRIANGLE_TOLERANCE = 0.5  # difference of slope and expected order up to which a triangle is drawn
TRIANGLE_HEIGHT = 0.4  # height of a triangle, as a share of the error above it
SeriesName = tuple[str, str]
"""Engine and name of a series, which identify it."""
SeriesEnds = Mapping[SeriesName, tuple[float, float]]


def series_name(row_or_verdict: StudyRow | Verdict) -> SeriesName:
    """Engine and name of the series that a run or a verdict belongs to."""
    return row_or_verdict.engine, row_or_verdict.series


def series_letter(look: Look) -> str:
    """Letter of a series in the legend; after 26 series a number follows the letter.

    >>> series_letter(Look("", (0, ()), "", 1)), series_letter(Look("", (0, ()), "", 27))
    ('b', 'b1')
    """
    repeat, place = divmod(look.number, 26)
    return ascii_lowercase[place] + (str(repeat) if repeat else "")


def draw_letters(ax: Axes, ends: SeriesEnds, looks: Mapping[SeriesName, Look]) -> None:
    """Draw the letter of each series at its end; series that end close together share a text."""
    groups: list[tuple[float, float, list[SeriesName]]] = []
    points = 72 / ax.figure.dpi
    for series, end in ends.items():
        x, y = ax.transData.transform(end) * points
        near = next(
            (g for g in groups if max(abs(x - g[0]), abs(y - g[1])) < SHARED_LETTER_DISTANCE), None
        )
        if near:
            near[2].append(series)
        else:
            groups.append((x, y, [series]))
    for _, _, names in groups:
        ax.annotate(
            " ".join(series_letter(looks[series]) for series in names),
            ends[names[0]],
            xytext=(0, 7),
            textcoords="offset points",
            fontsize=7,
            weight="bold",
            ha="center",
            va="center",
            color=looks[names[0]].colour,
            zorder=9,
            annotation_clip=False,
        )


def step_count(row: StudyRow) -> float:
    """Number of time steps of a run, or number of segments where the segments are varied."""
    return row.value if row.varied == "segments" else float(row.steps)


def draw_failures(
    ax: Axes, rows: Sequence[StudyRow], timed: bool, looks: Mapping[SeriesName, Look]
) -> None:
    """Draw failed runs as crosses at the upper edge, if their cost is known."""
    for row in rows:
        x = row.seconds if timed else step_count(row) or planned_steps(row, rows)
        if row.outcome != Outcome.RAN and x > 0:
            ax.plot(
                x,
                0.97,
                transform=ax.get_xaxis_transform(),
                marker="x",
                markersize=5,
                markeredgewidth=1.2,
                color=looks[series_name(row)].colour,
                clip_on=False,
                zorder=8,
            )


def planned_steps(row: StudyRow, rows: Iterable[StudyRow]) -> float:
    """Steps that a failed run would have taken, from the duration of one that ran; 0 if unknown."""
    spans = (r.steps * wanted_step(r) for r in rows if r.steps)
    steps = next((s for s in spans if s > 0), np.nan) / wanted_step(row)
    return steps if steps > 0 else 0.0


def wanted_step(row: StudyRow) -> float:
    """Time step that was asked for [s]; NaN if none was."""
    return float(str(row.parameters.get("timestep", np.nan)))


def draw_triangles(
    ax: Axes, rows: Sequence[StudyRow], kind: str, verdicts: Iterable[Verdict]
) -> None:
    """Draw a triangle for each expected order, below the part of a series of nearest slope."""
    orders = group_by((v for v in verdicts if v.expected > 0), lambda v: v.expected)
    taken: list[float] = []
    for order in sorted(orders, reverse=True):  # steep parts are few
        pairs = [
            pair
            for series in map(series_name, orders[order])
            for pair in pairwise(r for r in rows if series_name(r) == series)
            if 0 < step_count(pair[0]) < step_count(pair[1])
            and step_count(pair[0]) not in taken
            and abs(observed_slope(kind, *pair) - order) < TRIANGLE_TOLERANCE
        ]
        if pairs:
            a, b = min(pairs, key=lambda pair: abs(observed_slope(kind, *pair) - order))
            taken.append(step_count(a))
            draw_triangle(
                ax, (step_count(a), step_count(b)), TRIANGLE_HEIGHT * a.errors[kind], order
            )


def observed_slope(kind: str, a: StudyRow, b: StudyRow) -> float:
    """Order that the errors of two runs show over their numbers of steps."""
    return float(np.log(a.errors[kind] / b.errors[kind]) / np.log(step_count(b) / step_count(a)))


def draw_floors(
    ax: Axes,
    ends: SeriesEnds,
    looks: Mapping[SeriesName, Look],
    verdicts: Iterable[Verdict],
    with_causes: bool,
) -> None:
    """Draw a horizontal tick at each error floor; with `with_causes`, its cause in the margin."""
    groups: list[list[Verdict]] = []
    for verdict in sorted(
        (v for v in verdicts if v.floor > 0 and series_name(v) in ends), key=lambda v: v.floor
    ):
        ax.plot(
            ends[series_name(verdict)][0],
            verdict.floor,
            marker="_",
            markersize=18,
            zorder=2.5,
            markeredgewidth=1.8,
            color=looks[series_name(verdict)].colour,
        )
        alike = next(
            (
                g
                for g in groups
                if g[0].cause == verdict.cause and verdict.floor < SHARED_TEXT_RATIO * g[0].floor
            ),
            None,
        )
        if alike:
            alike.append(verdict)
        else:
            groups.append([verdict])
    if with_causes:
        write_margin(ax, groups, looks)


def write_margin(
    ax: Axes, groups: Sequence[Sequence[Verdict]], looks: Mapping[SeriesName, Look]
) -> None:
    """Write level, cause and series of error floors at the right of a panel, without overlaps."""
    low, high = np.log(ax.get_ylim())
    texts = [
        fill(
            f"{number(group[0].floor, 2)} {group[0].cause} ("
            f"{' '.join(sorted(series_letter(looks[series_name(v)]) for v in group))})",
            MARGIN_CHARACTERS,
        )
        for group in groups
    ]
    places = [float((np.log(group[0].floor) - low) / (high - low)) for group in groups]
    heights = [MARGIN_LINE_HEIGHT * (text.count("\n") + 1) for text in texts]
    for at, y, text in zip(places, spread_texts(places, heights), texts, strict=True):
        ax.annotate(
            text,
            (1.0, at),
            xytext=(1.06, y),
            xycoords="axes fraction",
            fontsize=6.5,
            textcoords="axes fraction",
            va="center",
            color=LABEL_COLOUR,
            arrowprops={
                "arrowstyle": "-",
                "linewidth": 0.6,
                "color": LINE_COLOUR,
                "relpos": (0.0, 0.5),
            },
        )


def spread_texts(places: Sequence[float], heights: Sequence[float]) -> list[float]:
    """Move texts up from their rising places as far as needed so that they do not overlap.

    >>> spread_texts([0.1, 0.15, 0.9], [0.1, 0.1, 0.1])
    [0.1, 0.2, 0.9]
    """
    moved: list[float] = []
    for k, place in enumerate(places):
        lowest = moved[-1] + 0.5 * (heights[k - 1] + heights[k]) if moved else place
        moved.append(max(place, lowest))
    return moved


PANEL_HEIGHT, PANEL_GAP = 2.4, 0.25
"""Height of a panel, and width between two of them [inch]."""
LEFT_MARGIN, RIGHT_MARGIN, BOTTOM_MARGIN, TOP_MARGIN = 0.62, 1.75, 0.42, 0.26
"""Margins around the panels [inch]."""
LEGEND_LINE_HEIGHT, LEGEND_ENTRY_WIDTH = 0.155, 2.9  # [inch] of the legend
ERROR_LABEL = "error, share of the range"
MARKERS = "os^Dv<>pPX*h"
DASHES: tuple[Dash, ...] = (
    SOLID,
    (0, (5, 1.5)),
    (0, (1.2, 1.2)),
    (0, (5, 1.5, 1, 1.5)),
    (0, (8, 2)),
    (0, (3, 1, 1, 1, 1, 1)),
    (0, (4, 4)),
    (0, (9, 1.5, 3, 1.5)),
    (0, (1, 3)),
)
FRONT_STYLE: dict[str, Any] = {
    "color": "#d0d0d0",
    "linewidth": 6.0,
    "solid_capstyle": "round",
    "zorder": 1,
}
LARGEST_DRAWN_ERROR = 10.0  # [ranges] error from which on a run is drawn at the upper edge


def trade_figure(
    rows: Sequence[StudyRow], verdicts: Iterable[Verdict], looks: Mapping[SeriesName, Look]
) -> Figure:
    """Draw the diagram of one run of a case: a row of panels for each kind of error.

    Parameters
    ----------
    rows : sequence of StudyRow
        All settings, failed ones included.
    verdicts : iterable of Verdict
        Error floors and expected orders of the series.
    looks : mapping
        Look of each series, from `series_looks`.
    """
    kinds, verdicts = shown_kinds(rows), list(verdicts)
    looks = {name: looks[name] for name in map(series_name, rows)}
    figure, axes = make_panels(kinds, 2, len(looks), 3.5, RIGHT_MARGIN)
    for pair, kind in zip(axes, kinds, strict=True):
        draw_panels(pair, rows, kind, looks, [v for v in verdicts if v.kind == kind])
    draw_legend(figure, looks, marks=True)
    axes[-1][0].set_xlabel("processor time of the run [s]")
    axes[-1][1].set_xlabel("segments" if main_parameter(rows) == "segments" else "time steps")
    return figure


def other_parameters_figure(rows: Sequence[StudyRow], looks: Mapping[SeriesName, Look]) -> Figure:
    """Draw errors over parameters other than the step: a column for each, coarse at the left."""
    kinds, parameters = shown_kinds(rows), list(dict.fromkeys(row.varied for row in rows))
    looks = {name: looks[name] for name in map(series_name, rows)}
    figure, axes = make_panels(kinds, len(parameters), len(looks), 2.4, 0.15)
    draw_legend(figure, looks, marks=False)
    for panels, kind in zip(axes, kinds, strict=True):
        shown = [row for row in rows if has_drawable_error(row, kind)]
        for ax, parameter in zip(panels, parameters, strict=True):
            ends = {}
            for series in dict.fromkeys(
                series_name(row) for row in shown if row.varied == parameter
            ):
                own = [row for row in shown if series_name(row) == series]
                x = [axis_value(row) for row in own]
                draw_series(ax, x, own, kind, looks[series])
                ends[series] = x[-1], drawn_error(own[-1], kind)
            scale_axes(ax, shown, kind)
            label = axis_label(next(row for row in rows if row.varied == parameter))
            if label:
                ax.invert_xaxis()
            ax.set_xlabel(label or parameter)
            draw_letters(ax, ends, looks)
        panels[0].set_title(kind)
        panels[0].set_ylabel(ERROR_LABEL)
    return figure


def make_panels(
    kinds: Sequence[str], columns: int, series_count: int, panel_width: float, right_margin: float
) -> tuple[Figure, NDArray[Any]]:
    """Make a figure of empty panels, a row for each kind of error, with room for the legend."""
    width = LEFT_MARGIN + columns * (panel_width + PANEL_GAP) - PANEL_GAP + right_margin
    head = 0.1 + LEGEND_LINE_HEIGHT * -(-(series_count + 2) // legend_columns(width))
    panels_height = len(kinds) * (PANEL_HEIGHT + TOP_MARGIN + BOTTOM_MARGIN)
    figure = Figure(figsize=(width, head + panels_height))
    axes = figure.subplots(len(kinds), columns, squeeze=False, sharex="col", sharey="row")
    figure.subplots_adjust(
        left=LEFT_MARGIN / width,
        right=1 - right_margin / width,
        bottom=BOTTOM_MARGIN / (head + panels_height),
        top=1 - (head + TOP_MARGIN) / (head + panels_height),
        wspace=PANEL_GAP / panel_width,
        hspace=(TOP_MARGIN + BOTTOM_MARGIN) / PANEL_HEIGHT,
    )
    return figure, axes


def main_parameter(rows: Iterable[StudyRow]) -> str:
    """The parameter that the diagram is about: the time step, else that of the first series."""
    there = dict.fromkeys(row.varied for row in rows)
    return "timestep" if "timestep" in there else next(iter(there))


def axis_value(row: StudyRow) -> float:
    """Place of a run on the axis of its parameter: its size if that has a label, else its value."""
    return setting_size(row.engine, row.varied, row.value) if axis_label(row) else row.value


def axis_label(row: StudyRow) -> str:
    """Label for the sizes of a varied parameter; empty if its own values are drawn."""
    try:
        return engine_of(row.engine).tuning.labels.get(row.varied, "")
    except NoEngine:  # the table may come from a machine with other engines
        return ""


def shown_kinds(rows: Iterable[StudyRow]) -> list[str]:
    """Kinds of errors that some run has; position if there are none."""
    rows = list(rows)
    return [kind for kind in KIND_UNITS if any(has_drawable_error(row, kind) for row in rows)] or [
        "position"
    ]


def has_drawable_error(row: StudyRow, kind: str) -> bool:
    """Whether a run has an error of that kind that can be drawn: finite, and above zero."""
    return row.outcome == Outcome.RAN and 0 < row.errors.get(kind, np.nan) < np.inf


def drawn_error(row: StudyRow, kind: str) -> float:
    """The error at which a run is drawn; larger ones are at the upper edge."""
    return min(row.errors[kind], LARGEST_DRAWN_ERROR)


def series_looks(rows: Iterable[StudyRow]) -> dict[SeriesName, Look]:
    """A look for each series: colour by engine, marker by integrator, dashes for equal markers."""
    looks: dict[SeriesName, Look] = {}
    markers: dict[SeriesName, str] = {}
    same_marker: dict[str, int] = {}
    rows = list(rows)
    solvers = solver_looks(map(coloured_solver, rows))
    for row in rows:
        if series_name(row) in looks:
            continue
        key = row.engine, str(row.parameters.get("integrator", "")).lower()
        marker = markers.setdefault(key, MARKERS[len(markers) % len(MARKERS)])
        same_marker[marker] = same_marker.get(marker, -1) + 1
        looks[series_name(row)] = Look(
            solvers[coloured_solver(row)].colour,
            DASHES[same_marker[marker] % len(DASHES)],
            marker,
            len(looks),
        )
    return looks


def coloured_solver(row: StudyRow) -> str:
    """The solver whose colour a series has: that of its engine's defaults if there is one."""
    solver = row.engine + ":default" * bool(row.parameters.get("defaults"))
    return solver if solver in FIXED_LOOKS else row.engine


def draw_panels(
    pair: Sequence[Axes],
    rows: Sequence[StudyRow],
    kind: str,
    looks: Mapping[SeriesName, Look],
    verdicts: Sequence[Verdict],
) -> None:
    """Draw one kind of error over processor time, and over steps or segments."""
    left, right = pair
    shown = [row for row in rows if has_drawable_error(row, kind)]
    best = pareto_front(rows, kind)
    left.set_title(kind)
    left.set_ylabel(ERROR_LABEL)
    draw_front(left, best, kind)
    for ax, cost in ((left, attrgetter("seconds")), (right, step_count)):
        ends = {}
        for series in dict.fromkeys(map(series_name, shown)):
            own = [row for row in shown if series_name(row) == series and cost(row) > 0]
            if own:
                x = [cost(row) for row in own]
                draw_series(ax, x, own, kind, looks[series], best)
                ends[series] = x[-1], drawn_error(own[-1], kind)
        scale_axes(ax, shown, kind)
        draw_failures(ax, rows, ax is left, looks)
        draw_letters(ax, ends, looks)
        draw_floors(ax, ends, looks, verdicts, with_causes=ax is right)
    draw_triangles(right, shown, kind, verdicts)


def scale_axes(ax: Axes, rows: Sequence[StudyRow], kind: str) -> None:
    """Make both axes logarithmic, with room for letters and crosses."""
    errors = [drawn_error(row, kind) for row in rows]
    ax.set_xscale("log")
    set_decades(ax, min(errors, default=1e-3) / 8, max(errors, default=1.0) * 8)
    ax.xaxis.set_major_locator(LogLocator(numticks=8))
    ax.xaxis.set_minor_locator(NullLocator())
    ax.tick_params(labelbottom=True)


def draw_series(
    ax: Axes,
    x: Sequence[float],
    rows: Sequence[StudyRow],
    kind: str,
    look: Look,
    best: Sequence[StudyRow] = (),
) -> None:
    """Draw one series from coarse to fine; markers of settings on the front are filled."""
    y = [drawn_error(row, kind) for row in rows]
    layer = 3 + look.number / 20
    ax.plot(
        x,
        y,
        **look.line,
        markerfacecolor="white",
        markersize=4,
        markeredgewidth=0.8,
        zorder=layer,
    )
    on_front = [k for k, row in enumerate(rows) if row in best]
    ax.plot(
        [x[k] for k in on_front],
        [y[k] for k in on_front],
        linestyle="",
        marker=look.marker,
        color=look.colour,
        markersize=5,
        zorder=layer + 1,
    )


def draw_front(ax: Axes, best: Sequence[StudyRow], kind: str) -> None:
    """Draw the front as steps: no measured setting is both below and to the left of it."""
    if best:
        ax.step(
            [row.seconds for row in best],
            [drawn_error(row, kind) for row in best],
            where="post",
            **FRONT_STYLE,
        )


def draw_legend(figure: Figure, looks: Mapping[SeriesName, Look], marks: bool) -> None:
    """Draw the legend: series by their letters; with `marks` also the front and the cross."""
    handles = [
        Line2D(
            [],
            [],
            label=f"{series_letter(look)}  {series}",
            **look.line,
            markerfacecolor="white",
            markersize=4,
        )
        for (_, series), look in looks.items()
    ]
    if marks:
        handles += [
            Line2D(
                [],
                [],
                label="front: nothing cheaper is as good",
                linewidth=5,
                color=FRONT_STYLE["color"],
            ),
            Line2D(
                [], [], label="failed: see the table", color=LABEL_COLOUR, marker="x", linestyle=""
            ),
        ]
    figure.legend(
        handles=handles,
        loc="upper left",
        ncols=legend_columns(figure.get_figwidth()),
        handlelength=3.4,
        fontsize=7.5,
        labelspacing=0.3,
        columnspacing=1.2,
        bbox_to_anchor=(0.0, 1 - 0.02 / figure.get_figheight()),
    )


def legend_columns(width: float) -> int:
    """Number of columns of the legend of a figure of that width [inch]."""
    return max(1, int(width / LEGEND_ENTRY_WIDTH))
