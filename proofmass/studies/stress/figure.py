"""The figure of a stress study for papers: how far each parameter goes, and where theory ends."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from proofmass.report.style import Look, hatches, looks
from proofmass.studies.stress.boundary import Boundary
from proofmass.wording import format_solver

INK = "#333333"
ROW, WIDE, HEAD = 0.17, 7.2, 0.75  # [inch] a boundary, the figure, what stands above and below
PALE = 0.35  # of an engine's colour, the rest is white
Style = tuple[Look, str]
"""Look and hatch of an engine."""
NEAR = 0.02
"""How close to theory a measured boundary must be."""


def stress_sheet(found: Sequence[Boundary]) -> Figure:
    """Bars by parameter; with theory for all, over values and with the ratios beside."""
    known = all(one.theory == one.theory for one in found)
    groups = [
        (parameter, [one for one in found if one.parameter == parameter])
        for parameter in dict.fromkeys(one.parameter for one in found)
    ]
    rows = len(found) + len(groups)
    height = ROW * rows + 2 * HEAD
    figure = Figure(figsize=(WIDE, height))
    axes = figure.subplots(
        1, 2 if known else 1, sharey=True, squeeze=False, width_ratios=[3, 1] if known else None
    )[0]
    y, styles = float(rows), styled(found)
    for parameter, ours in groups:
        unit = "" if ours[0].unit in ("1", "times") or not known else f" [{ours[0].unit}]"
        axes[0].annotate(
            parameter + unit,
            (0, y - 0.15),
            xycoords=("axes fraction", "data"),
            xytext=(-4, 0),
            textcoords="offset points",
            ha="right",
            va="center",
            fontweight="bold",
        )
        for one in ours:
            y -= 1
            bar(axes[0], one, y, known, styles[one.engine])
            if known and one.ratio == one.ratio:
                axes[1].plot(
                    one.ratio,
                    y,
                    color=styles[one.engine][0].colour,
                    markersize=4,
                    marker=styles[one.engine][0].marker,
                )
        y -= 1
    dress(axes, found, rows, known)
    figure.subplots_adjust(
        left=0.41, right=0.98, bottom=0.55 / height, top=1 - 0.5 / height, wspace=0.06
    )
    legend(figure, found, height)
    return figure


def styled(found: Sequence[Boundary]) -> dict[str, Style]:
    """A look and a hatch for every engine."""
    engines = list(dict.fromkeys(one.engine for one in found))
    chosen, lines = looks(engines), hatches(engines)
    return {name: (chosen[name], lines[name]) for name in engines}


def bar(ax: Axes, one: Boundary, y: float, known: bool, style: Style) -> None:
    """One boundary: a bar from its first value, and how it ends."""
    label = f"{one.what}, {one.setting}" if known else f"{format_solver(one.engine)}, {one.setting}"
    ax.annotate(
        label,
        (0, y),
        xycoords=("axes fraction", "data"),
        xytext=(-4, 0),
        fontsize=6.5,
        textcoords="offset points",
        ha="right",
        va="center",
    )
    low, high = span(one, known)
    colour = style[0].colour
    if one.holds != one.holds:
        ax.annotate(
            "not known" if one.unknown else "lost from the start",
            (0.01, y),
            xycoords=("axes fraction", "data"),
            fontsize=6.5,
            va="center",
        )
        return
    ax.barh(y, high - low, left=low, height=0.6, **filled(style))
    marker = "o" if one.found else "X" if one.unknown else ">"
    ax.plot(
        high,
        y,
        marker=marker,
        color=colour,
        markersize=4.5,
        clip_on=False,
        markerfacecolor="white" if one.silent else colour,
    )
    if np.isfinite(one.theory) and one.theory:
        place = one.theory if known else factor_to(one, one.theory)
        ax.plot([place] * 2, [y - 0.42, y + 0.42], color="black", linewidth=1.3, zorder=4)
    if not known and one.found:
        unit = {"times": "×", "1": ""}.get(one.unit, one.unit)
        ax.annotate(
            f"{one.format_measured()} {unit}",
            (high, y),
            xytext=(6, 0),
            fontsize=6.5,
            textcoords="offset points",
            va="center",
        )


def filled(style: Style) -> dict[str, Any]:
    """The look of an engine's bars.

    Pale by its colour alone: an SVG has a hatch's ground opaque, where a translucent one would be
    of one colour with its lines.
    """
    colour = style[0].colour
    return {
        "facecolor": 1 - PALE * (1 - np.array(to_rgb(colour))),
        "edgecolor": colour,
        "hatch": style[1],
        "linewidth": 0.4,
    }


def span(one: Boundary, known: bool) -> tuple[float, float]:
    """Where a bar begins and ends: values where theory is, otherwise times of the start."""
    end = one.measured if one.found else one.holds if one.unknown else one.reach
    if known:
        return one.start, end
    return 1.0, factor_to(one, end)


def factor_to(one: Boundary, value: float) -> float:
    """The factor by which a parameter was increased or decreased to a value."""
    return max(value / one.start, one.start / value)


def dress(axes: Sequence[Axes], found: Sequence[Boundary], rows: int, known: bool) -> None:
    """Scales, names and the band of what is near enough to theory."""
    axes[0].set_xscale("log")
    axes[0].set_ylim(-0.2, rows + 0.3)
    axes[0].set_yticks([])
    axes[0].set_xlabel(
        "value of the parameter" if known else "factor, up or down, on the case's own value"
    )
    right = max(span(one, known)[1] for one in found if one.holds == one.holds)
    room = 1.3 if known else 60.0  # for words at the ends of bars
    axes[0].set_xlim(min(span(one, known)[0] for one in found) * 0.9, right * room)
    if known:
        axes[1].axvspan(1 - NEAR, 1 + NEAR, color="#eeeeee", zorder=0)
        axes[1].axvline(1.0, color=INK, linewidth=0.8)
        axes[1].set_xlim(1 - 1.6 * NEAR, 1 + 1.6 * NEAR)
        axes[1].set_xlabel("measured / theory")


def legend(figure: Figure, found: Sequence[Boundary], height: float) -> None:
    """Engines, and what the ends of bars mean."""
    handles: list[Patch | Line2D] = [
        Patch(label=format_solver(e), **filled(style)) for e, style in styled(found).items()
    ]
    plain: dict[str, Any] = {"color": INK, "linestyle": "", "markersize": 4.5}
    handles += [
        Line2D([], [], marker="o", label="lost, and said so", **plain),
        Line2D([], [], marker="o", markerfacecolor="white", label="lost in silence", **plain),
        Line2D([], [], marker=">", label="holds to the end", **plain),
    ]
    if any(one.unknown for one in found):
        handles.append(Line2D([], [], marker="X", label="not known beyond", **plain))
    if any(np.isfinite(one.theory) and one.theory for one in found):
        handles.append(
            Line2D(
                [],
                [],
                marker="|",
                markeredgewidth=1.3,
                label="theory",
                **{**plain, "color": "black", "markersize": 8},
            )
        )
    figure.legend(
        handles=handles,
        loc="upper left",
        ncols=len(handles),
        fontsize=7,
        bbox_to_anchor=(0.0, 1 - 0.02 / height),
        handletextpad=0.4,
        columnspacing=1.2,
    )
