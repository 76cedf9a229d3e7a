"""Paths: a measured point's place across against its place up, to one scale."""

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from proofmass.analytic.numerics import Array
from proofmass.report.data import Shown
from proofmass.report.figures import every, legend
from proofmass.report.style import REFERENCE, Look
from proofmass.sim.picture import Picture
from proofmass.sim.protocol import Curves

PANEL = 2.45  # [inch] side of a panel


def paths(view: Shown, picture: Picture | None) -> list[str]:
    """Names of the points whose two places in the plane of motion are channels, in metres."""
    across, up = picture.axes if picture else ("", "")
    return [name for name in dict.fromkeys(c.rpartition(".")[0] for c in view.channels)
            if across and all(f"{name}.{a}" in view.channels
                              and view.case.channels[f"{name}.{a}"].si_unit == "m"
                              for a in (across, up))
            and np.ptp(path(view.longest, name, picture), axis=0).max() > 1e-9]


def path(curves: Curves, name: str, picture: Picture | None) -> Array:
    """The path of a point (n, 2) [m]; NaN where the solver has none."""
    missing = np.full(curves.x.shape, np.nan)
    return np.stack([curves.channels.get(f"{name}.{a}", missing)
                     for a in (picture.axes if picture else "xy")], axis=1)


def path_sheet(view: Shown, picture: Picture, style: Mapping[str, Look]) -> Figure:
    """All paths of a run side by side."""
    names = paths(view, picture)
    width = min(len(names), 4)
    rows = -(-len(names) // width)
    height, head = (PANEL + 0.75) * rows, 0.5 if view.lost else 0.3
    size = np.array([max((PANEL + 0.75) * width, 6.5), height + head])
    figure = Figure(figsize=tuple(size))
    for k, name in enumerate(names):
        corner = (0.65 + (PANEL + 0.75) * (k % width),
                  0.45 + (PANEL + 0.75) * (rows - 1 - k // width))
        ax = figure.add_axes((*(corner / size), *(PANEL / size)))
        path_panel(ax, view, name, picture, style)
    legend(figure, view, style, "overlay", float(size[1]))
    return figure


def path_panel(ax: Axes, view: Shown, name: str, picture: Picture,
               style: Mapping[str, Look]) -> None:
    """One path: the reference thick and pale, the solvers thin on top of it; scales are equal."""
    truth = path(view.longest, name, picture)
    ax.plot(*every(truth, 400).T, **REFERENCE)
    for solver, curves in view.curves.items():
        found = every(path(curves, name, picture), 400)
        look, step = style[solver], max(len(found) // 9, 1)
        ax.plot(*found.T, color=look.colour, linestyle=look.dash, marker=look.marker,
                markevery=(min(look.number * step // 6, len(found) - 1), step),
                markerfacecolor="white", markeredgewidth=0.8, zorder=3 + look.number / 10)
    low, high = np.nanmin(truth, axis=0), np.nanmax(truth, axis=0)
    middle, half = 0.5 * (low + high), 0.56 * float((high - low).max())
    ax.set(xlim=(middle[0] - half, middle[0] + half), ylim=(middle[1] - half, middle[1] + half),
           xlabel=f"{name}.{picture.axes[0]} [m]", ylabel=f"{name}.{picture.axes[1]} [m]")
    ax.locator_params(nbins=5)
    ax.set_title(f"{name}: its {'shape' if view.kind == 'rest' else 'path'}")
