"""The work-precision diagram: errors over wall time and over steps, both axes logarithmic."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, NullLocator
from numpy.typing import NDArray

from proofmass.report.figures import decades
from proofmass.report.style import KNOWN, SOLID, Dash, Look
from proofmass.report.trade_marks import (
    Name,
    failures,
    floors,
    letter,
    letters,
    name_of,
    triangles,
    work,
)
from proofmass.studies.row import KINDS, Row
from proofmass.studies.trade.axes import SIZE
from proofmass.studies.trade.verdict import Verdict, front

HIGH, LEFT, GAP, RIGHT, BELOW, ABOVE = 2.4, 0.62, 0.25, 1.75, 0.42, 0.26  # [inch]
LINE, ENTRY = 0.155, 2.9  # [inch] of the legend
SHARE = "error, share of the range"
TURNED = {"solref": "time constant of loops, solref [s]", "solimp": "1 − solimp",
          "error_bias": "time constant of the bias [s]"}
MARKERS = "os^Dv<>pPX*h"
DASHES: tuple[Dash, ...] = (SOLID, (0, (5, 1.5)), (0, (1.2, 1.2)), (0, (5, 1.5, 1, 1.5)),
                            (0, (8, 2)), (0, (3, 1, 1, 1, 1, 1)))
FRONT: dict[str, Any] = {"color": "#d0d0d0", "linewidth": 6.0, "solid_capstyle": "round",
                         "zorder": 1}
LOST = 10.0  # ranges: a run that is off by more is drawn at the upper edge


def trade_sheet(rows: Sequence[Row], verdicts: Iterable[Verdict], looks: Mapping[Name, Look]
                ) -> Figure:
    """The diagram of one run of a case: a row of panels for each kind of error.

    Parameters
    ----------
    rows : sequence of Row
        Of all settings, those that failed among them.
    verdicts : iterable of Verdict
        Error floors and expected orders of the lines.
    looks : mapping
        From `dressed`.
    """
    kinds, verdicts = shown_kinds(rows), list(verdicts)
    looks = {name: looks[name] for name in map(name_of, rows)}
    figure, axes = grid(kinds, 2, len(looks), 3.5, RIGHT)
    for pair, kind in zip(axes, kinds, strict=True):
        panels(pair, rows, kind, looks, [v for v in verdicts if v.kind == kind])
    legend(figure, looks, marks=True)
    axes[-1][0].set_xlabel("wall time of the run [s]")
    axes[-1][1].set_xlabel("segments" if axis_of(rows) == "segments" else "time steps")
    return figure


def turn_sheet(rows: Sequence[Row], looks: Mapping[Name, Look]) -> Figure:
    """Errors over knobs other than the step: a column for each knob, coarse at the left."""
    kinds, knobs = shown_kinds(rows), list(dict.fromkeys(row.axis for row in rows))
    looks = {name: looks[name] for name in map(name_of, rows)}
    figure, axes = grid(kinds, len(knobs), len(looks), 2.4, 0.15)
    legend(figure, looks, marks=False)
    for panels, kind in zip(axes, kinds, strict=True):
        shown = [row for row in rows if good(row, kind)]
        for ax, knob in zip(panels, knobs, strict=True):
            ends = {}
            for line in dict.fromkeys(name_of(row) for row in shown if row.axis == knob):
                own = [row for row in shown if name_of(row) == line]
                x = [turned(row) for row in own]
                curve(ax, x, own, kind, looks[line])
                ends[line] = x[-1], min(own[-1].errors[kind], LOST)
            scale(ax, [min(row.errors[kind], LOST) for row in shown])
            if knob in TURNED:
                ax.invert_xaxis()
            ax.set_xlabel(TURNED.get(knob, knob))
            letters(ax, ends, looks)
        panels[0].set_title(kind)
        panels[0].set_ylabel(SHARE)
    return figure


def grid(kinds: Sequence[str], across: int, lines: int, wide: float, right: float
         ) -> tuple[Figure, NDArray[Any]]:
    """Empty panels, a row for each kind of error, below the room for a legend of so many lines."""
    width = LEFT + across * (wide + GAP) - GAP + right
    head = 0.1 + LINE * -(-(lines + 2) // entries(width))
    down = len(kinds) * (HIGH + ABOVE + BELOW)
    figure = Figure(figsize=(width, head + down))
    axes = figure.subplots(len(kinds), across, squeeze=False, sharex="col", sharey="row")
    figure.subplots_adjust(
        left=LEFT / width, right=1 - right / width, bottom=BELOW / (head + down),
        top=1 - (head + ABOVE) / (head + down), wspace=GAP / wide,
        hspace=(ABOVE + BELOW) / HIGH)
    return figure, axes


def axis_of(rows: Iterable[Row]) -> str:
    """What is turned on the lines of the diagram: the step, or else what the first line has."""
    there = dict.fromkeys(row.axis for row in rows)
    return "timestep" if "timestep" in there else next(iter(there))


def turned(row: Row) -> float:
    """Where a knob stands."""
    return SIZE[row.axis](row.value) if row.axis in TURNED else row.value


def shown_kinds(rows: Iterable[Row]) -> list[str]:
    """Kinds of errors of which something can be drawn; one at least."""
    rows = list(rows)
    return [kind for kind in KINDS if any(good(row, kind) for row in rows)] or ["position"]


def good(row: Row, kind: str) -> bool:
    """Whether a run has an error of that kind that can be drawn."""
    return row.outcome == "ran" and 0 < row.errors.get(kind, np.nan) < np.inf


def dressed(rows: Iterable[Row]) -> dict[Name, Look]:
    """A look for each line: colour by engine, marker by integrator, dash among those alike."""
    looks: dict[Name, Look] = {}
    markers: dict[Name, int] = {}
    alike: dict[Name, int] = {}
    for row in rows:
        if name_of(row) in looks:
            continue
        key = row.engine, str(row.knobs.get("integrator", "")).lower()
        markers.setdefault(key, len(markers))
        alike[key] = alike.get(key, -1) + 1
        known = KNOWN.get(row.engine + ":default" * bool(row.knobs.get("defaults")))
        looks[name_of(row)] = Look(known.colour if known else "#444444",
                                   DASHES[alike[key] % len(DASHES)],
                                   MARKERS[markers[key] % len(MARKERS)], len(looks))
    return looks


def panels(pair: Sequence[Axes], rows: Sequence[Row], kind: str, looks: Mapping[Name, Look],
           verdicts: Sequence[Verdict]) -> None:
    """One kind of error, over wall time and over steps or segments."""
    left, right = pair
    shown = [row for row in rows if good(row, kind)]
    best = front(rows, kind)
    left.set_title(kind)
    left.set_ylabel(SHARE)
    stairs(left, best, kind)
    for ax, cost in ((left, seconds), (right, work)):
        ends = {}
        for line in dict.fromkeys(map(name_of, shown)):
            own = [row for row in shown if name_of(row) == line and cost(row) > 0]
            if own:
                x = [cost(row) for row in own]
                curve(ax, x, own, kind, looks[line], best)
                ends[line] = x[-1], min(own[-1].errors[kind], LOST)
        scale(ax, [min(row.errors[kind], LOST) for row in shown])
        failures(ax, rows, ax is left, looks)
        letters(ax, ends, looks)
        floors(ax, ends, looks, verdicts, named=ax is right)
    triangles(right, shown, kind, verdicts)


def seconds(row: Row) -> float:
    """Wall time [s]."""
    return row.seconds


def scale(ax: Axes, errors: Sequence[float]) -> None:
    """Both axes logarithmic, with room for letters and crosses."""
    ax.set_xscale("log")
    decades(ax, min(errors, default=1e-3) / 8, max(errors, default=1.0) * 8)
    ax.xaxis.set_major_locator(LogLocator(numticks=8))
    ax.xaxis.set_minor_locator(NullLocator())
    ax.tick_params(labelbottom=True)


def curve(ax: Axes, x: Sequence[float], rows: Sequence[Row], kind: str, look: Look,
          best: Sequence[Row] = ()) -> None:
    """One line, from coarse to fine; settings on the front are filled."""
    y = [min(row.errors[kind], LOST) for row in rows]
    layer = 3 + look.number / 20
    ax.plot(x, y, color=look.colour, linestyle=look.dash, marker=look.marker,
            markerfacecolor="white", markersize=4, markeredgewidth=0.8, zorder=layer)
    ahead = [k for k, row in enumerate(rows) if row in best]
    ax.plot([x[k] for k in ahead], [y[k] for k in ahead], linestyle="", marker=look.marker,
            color=look.colour, markersize=5, zorder=layer + 1)


def stairs(ax: Axes, best: Sequence[Row], kind: str) -> None:
    """The front: no setting measured is below and at the left of it."""
    if best:
        ax.step([row.seconds for row in best], [min(row.errors[kind], LOST) for row in best],
                where="post", **FRONT)


def legend(figure: Figure, looks: Mapping[Name, Look], marks: bool) -> None:
    """The lines by their letters; with marks the front, and what a cross is."""
    handles = [Line2D([], [], label=f"{letter(look)}  {line}", color=look.colour,
                      linestyle=look.dash, marker=look.marker, markerfacecolor="white",
                      markersize=4) for (_, line), look in looks.items()]
    if marks:
        handles += [Line2D([], [], label="front: nothing cheaper is as good", linewidth=5,
                           color=FRONT["color"]),
                    Line2D([], [], label="failed: see the table", color="#333333", marker="x",
                           linestyle="")]
    figure.legend(handles=handles, loc="upper left", ncols=entries(figure.get_figwidth()),
                  handlelength=3.4, fontsize=7.5, labelspacing=0.3, columnspacing=1.2,
                  bbox_to_anchor=(0.0, 1 - 0.02 / figure.get_figheight()))


def entries(width: float) -> int:
    """Columns of the legend of a figure of that width [inch]."""
    return max(1, int(width / ENTRY))
