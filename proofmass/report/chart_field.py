"""A field of values in a chart: filled contours, a colour bar, and a line on the zero."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from proofmass.analytic.chart import Chart, Field
from proofmass.analytic.numerics import Array
from proofmass.report.data import readable
from proofmass.report.view_sheet import INK
from proofmass.wording import pretty

ZERO: dict[str, Any] = {"color": INK, "linewidth": 1.8}
WITHIN = 0.96  # share of the values that the colours tell apart: they run into poles


def contours(chart: Chart, field: Field) -> Array:
    """Round levels for all fields of that label in a chart, so that one colour is one value."""
    same = [panel.field for panel in chart.panels
            if panel.field and panel.field.label == field.label]
    values = np.concatenate([one.values.ravel() for one in same]) * readable(field.unit)[1]
    values = values[np.isfinite(values)]
    values = values if values.size else np.array([-1.0, 1.0])
    top = float(np.quantile(np.abs(values), WITHIN))
    ends = np.quantile(values, [0.5 - WITHIN / 2, 0.5 + WITHIN / 2])
    return np.asarray(MaxNLocator(10).tick_values(*((-top, top) if field.signed else ends)))


def filled(ax: Axes, field: Field, levels: Array, scale: Array) -> None:
    """Colours that part at zero if it is signed, thin lines, dashed below zero, a bar beside."""
    unit, factor = readable(field.unit)
    values = np.ma.masked_invalid(np.transpose(field.values) * factor)
    if not values.count():
        return
    grid = (field.x * scale[0], field.y * scale[1], values)
    least, most = float(values.min()), float(values.max())
    beyond = ("neither", "max", "min", "both")[(most > levels[-1]) + 2 * (least < levels[0])]
    colours = ax.contourf(*grid, levels, cmap="PuOr" if field.signed else "cividis_r",
                          extend=beyond, zorder=0.5)
    colours.set_edgecolor("face")  # else hairlines of paper between them
    met = levels[(least < levels) & (levels < most)]
    if met.size:
        ax.contour(*grid, met, colors=INK, linewidths=0.35, zorder=0.6)
    if field.signed and least < 0 < most:
        ax.contour(*grid, [0.0], colors=ZERO["color"], linewidths=ZERO["linewidth"], zorder=0.7)
    bar = ax.figure.colorbar(colours, cax=ax.inset_axes((1.03, 0.0, 0.045, 1.0)))
    bar.set_label(f"{field.label} [{pretty(unit)}]" if unit else field.label)
