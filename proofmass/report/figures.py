"""The figures: the curves over each other, and their distance to the reference."""

from collections.abc import Mapping
from itertools import cycle
from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MultipleLocator

from proofmass.report.data import Shown, grouped, inputs, readable, thin
from proofmass.report.style import RC, REFERENCE, Look
from proofmass.report.words import number, pretty
from sim.protocol import Array

FLOOR = 1e-18  # of the reference's range: where a difference of exactly zero is drawn
HALO = [withStroke(linewidth=2, foreground="white")]
SIDES = ((0.01, "left"), (0.99, "right"), (0.5, "center"))  # labels of tolerances, in turn


def draw(ax: Axes, x: Array, y: Array, look: Look, limit: int = 500) -> None:
    """One solver's curve; markers are staggered so that curves on each other all show."""
    x, y = thin(x, np.where(np.isfinite(y), y, np.nan), limit)
    every = max(len(x) // 7, 1)
    ax.plot(x, y, color=look.colour, linestyle=look.dash, marker=look.marker,
            markevery=(min(look.number * every // 6 + every // 4, len(x) - 1), every),
            markerfacecolor="white", markeredgewidth=0.8, zorder=3 + look.number / 10)


def limits(ax: Axes, truth: Array, lines: Mapping[str, Array]) -> None:
    """Scale a panel on the reference; a solver that is far off leaves it, and is named."""
    finite = truth[np.isfinite(truth)]
    low, high = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 1.0)
    span = high - low
    if span <= 1e-9 * max(abs(low), abs(high)):  # a constant: do not magnify rounding
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
        ax.text(0.99, 0.99, "off the scale: " + ", ".join(out), transform=ax.transAxes,
                ha="right", va="top", fontsize=6.5, color="#8a1c1c", zorder=9, path_effects=HALO)


def overlay(ax: Axes, view: Shown, channel: str, style: Mapping[str, Look]) -> None:
    """A channel: the reference thick and pale, the solvers thin on top of it."""
    unit, scale = readable(view.case.channels[channel].unit)
    lines = {s: c.channels[channel] * scale for s, c in view.curves.items()
             if channel in c.channels}
    truth = next(iter(view.truth.values())).channels[channel] * scale
    panel(ax, view, channel, truth, lines, style, unit)


def panel(ax: Axes, view: Shown, title: str, truth: Array, lines: dict[str, Array],
          style: Mapping[str, Look], unit: str) -> None:
    """A panel of an overlay."""
    x = max((t.x for t in view.truth.values()), key=len) * view.x_scale
    ax.plot(*thin(x, truth, 500), **REFERENCE)
    for solver, y in lines.items():
        draw(ax, view.curves[solver].x * view.x_scale, y, style[solver])
    limits(ax, truth, lines)
    ax.set_title(title)
    ax.set_ylabel(f"[{pretty(unit)}]")


def difference(ax: Axes, view: Shown, channel: str, style: Mapping[str, Look]) -> None:
    """Absolute differences of a channel on a log axis, with each tolerance as a dashed line."""
    unit = view.case.channels[channel].unit
    levels, tops = [], []
    for solver in view.curves:
        error = view.error(solver, channel)
        if error is None:
            continue
        floor = FLOOR * (float(np.ptp(view.truth[solver].channels[channel])) or 1.0)
        error = np.where(np.isfinite(error), np.maximum(error, floor), np.nan)
        draw(ax, view.curves[solver].x * view.x_scale, error, style[solver], 320)
        solid = error[error > floor]
        levels.append(float(np.nanpercentile(solid, 5)) / 20 if solid.size else floor)
        tops.append(float(np.nanmax(error, initial=floor)))
    checked = [c for c in view.rows
               if c.channel == channel and c.allowed > 0 and c.solver in view.curves]
    for c, (where, side) in zip(checked, cycle(SIDES), strict=False):
        ax.axhline(c.allowed, color=style[c.solver].colour, linewidth=0.9,
                   linestyle=(0, (7, 3)), zorder=2)
        ax.annotate(f"{c.solver} ≤ {number(c.allowed)}", (where, c.allowed), ha=side,
                    xycoords=("axes fraction", "data"), xytext=(0, 1.5), fontsize=6.5, zorder=9,
                    textcoords="offset points", color=style[c.solver].colour, path_effects=HALO)
        tops.append(c.allowed)
        levels.append(c.allowed / 4)  # the level line itself must be inside the panel
    ax.set_yscale("log")
    if levels:
        ax.set_ylim(min(levels), 8 * max(tops))
    else:
        ax.text(0.5, 0.5, "no solver delivers it", transform=ax.transAxes, ha="center")
    ax.set_title(channel)
    ax.set_ylabel(f"|difference| [{pretty(unit)}]")


def sheet(view: Shown, style: Mapping[str, Look], what: str) -> Figure:
    """All channels of a run as a grid of panels; `what` is "overlay" or "difference"."""
    driven = inputs(view) if what == "overlay" else {}
    names = [[*driven]] * bool(driven) + grouped(view.case, view.channels)
    width = max(map(len, names))
    head = 0.8 if view.lost else 0.62  # room for the legend, and the note below it
    height = 1.75 * len(names) + 0.13 + head
    figure = Figure(figsize=(3.05 * width + 0.3, height))
    axes = figure.subplots(len(names), width, squeeze=False, sharex=True)
    for row, line in zip(axes, names, strict=True):
        for k, ax in enumerate(row):
            if k >= len(line):
                ax.remove()
            elif line[k] in driven:
                truth, moved, unit = driven[line[k]]
                unit, scale = readable(unit)
                panel(ax, view, line[k], truth * scale,
                      {s: y * scale for s, y in moved.items()}, style, unit)
            else:
                (overlay if what == "overlay" else difference)(ax, view, line[k], style)
    for j in range(width):  # label the lowest panel of each column: the grid may be ragged
        lowest = max(i for i, line in enumerate(names) if j < len(line))
        axes[lowest, j].set_xlabel(f"{view.x_name} [{view.x_unit}]")
        axes[lowest, j].tick_params(labelbottom=True)
    x = max((t.x for t in view.truth.values()), key=len) * view.x_scale
    axes[0, 0].set_xlim(float(x[0]), float(x[-1]))
    if view.x_unit == "deg" and abs(x[-1] - x[0]) >= 180:
        axes[0, 0].xaxis.set_major_locator(MultipleLocator(90 if abs(x[-1] - x[0]) < 721 else 180))
    legend(figure, view, style, what, height)
    figure.subplots_adjust(left=0.62 / (3.05 * width), right=1 - 0.1 / (3.05 * width),
                           bottom=0.42 / height, top=1 - head / height, wspace=0.3, hspace=0.38)
    return figure


def legend(figure: Figure, view: Shown, style: Mapping[str, Look], what: str,
           height: float) -> None:
    """One legend above the grid, and a note that names the solvers without curves."""
    handles = [Line2D([], [], label="reference", **REFERENCE)] * (what == "overlay")
    handles += [Line2D([], [], label=s, color=style[s].colour, linestyle=style[s].dash,
                       marker=style[s].marker, markerfacecolor="white") for s in view.curves]
    figure.legend(handles=handles, loc="upper left", ncols=len(handles), handlelength=3.2,
                  bbox_to_anchor=(0.0, 1 - 0.02 / height), fontsize=8)
    if view.lost:
        note = "not drawn: " + ", ".join(f"{s} ({c.outcome})" for s, c in view.lost.items())
        figure.text(0.02, 1 - 0.34 / height, note, fontsize=7, color="#8a1c1c", va="top")


def thumbnail(view: Shown, style: Mapping[str, Look]) -> Figure:
    """One overlay in small, for the index."""
    figure = Figure(figsize=(3.2, 1.9))
    overlay(figure.add_axes((0.2, 0.21, 0.77, 0.66)), view, view.channels[0], style)
    figure.axes[0].set_xlabel(f"{view.x_name} [{view.x_unit}]")
    figure.axes[0].margins(x=0)
    return figure


def save(figure: Figure, stem: Path, png: bool = True) -> str:
    """Write STEM.svg and STEM.png; return the SVG's text."""
    figure.savefig(stem.with_suffix(".svg"), metadata={"Date": None, "Creator": None})
    if png:
        figure.savefig(stem.with_suffix(".png"))
    text = stem.with_suffix(".svg").read_text(encoding="utf-8")
    text = text.replace("'DejaVu Sans'", "'DejaVu Sans', Verdana, sans-serif")
    stem.with_suffix(".svg").write_text(text, encoding="utf-8")
    return text


def make(view: Shown, style: Mapping[str, Look], what: str, stem: Path) -> str:
    """Draw and save one figure; return the SVG's text."""
    with rc_context(RC):
        small = what == "thumbnail"
        return save(thumbnail(view, style) if small else sheet(view, style, what), stem, not small)
