"""Lines and points of a chart: what they look like, in colours and without."""

import math
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from proofmass.analytic.chart import Chart, Line
from proofmass.analytic.numerics import Array
from proofmass.report.figures import every
from proofmass.report.style import MUTED, SOLID, Dash, Look
from proofmass.report.view_sheet import CASING, INK

DASHES: list[Dash] = [(0, (4, 2)), (0, (1.2, 1.2)), (0, (8, 1.5, 1.2, 1.5)), (0, (2.5, 2.5)),
                      (0, (9, 2))]
MARKERS = "os^Dvp*"
PLAIN = Look(INK, (0, (5, 3)), "o")  # of what has no label
MOST = 500  # points of a line, about


def tones(chart: Chart) -> dict[str, Look]:
    """A look for every label of a chart, none of them a solver's; points are black."""
    points = dict.fromkeys(line.label for line in chart.lines if line.label and line.points)
    lines = dict.fromkeys(line.label for line in chart.lines if line.label and not line.points)
    black = {label: Look(INK, SOLID, MARKERS[k % len(MARKERS)], k)
             for k, label in enumerate(points)}
    return black | {label: Look(MUTED[k % len(MUTED)], DASHES[k % len(DASHES)],
                                MARKERS[k % len(MARKERS)], k) for k, label in enumerate(lines)}


def drawn(ax: Axes, line: Line, look: Look, scale: Array, *, cased: bool = False) -> None:
    """A line, thinned where it is long, or its points; on a field with white beside it."""
    x, y = thinned(line).T * scale[:, None]
    if line.points:
        ax.plot(x, y, **dressed(line, look))
        return
    step = max(len(x) // 5, 1)  # markers, apart from those of other labels
    ax.plot(x, y, **dressed(line, look), path_effects=CASING if cased else None,
            markevery=((1 + look.number) % 4 * step // 4, step))


def dressed(line: Line, look: Look) -> dict[str, Any]:
    """Stable bold, unstable thin and dashed; points filled if stable, else hollow.

    Labelled bold lines bear markers, which tell them apart on a black-and-white print.
    """
    shared: dict[str, Any] = {"color": look.colour, "zorder": 3 + line.stable + 2 * line.points}
    if line.points:
        return shared | {"linestyle": "", "marker": look.marker, "markersize": 4.6,
                         "markerfacecolor": look.colour if line.stable else "white"}
    if not line.stable:
        return shared | {"linewidth": 0.9, "linestyle": look.dash}
    bold = shared | {"linewidth": 2.0, "linestyle": "-", "solid_capstyle": "round"}
    if look is PLAIN:
        return bold
    return bold | {"marker": look.marker, "markersize": 4.0, "markerfacecolor": "white",
                   "markeredgewidth": 0.9}


def thinned(line: Line) -> Array:
    """At most about `MOST` of a line's points (n, 2), the ends of its pieces among them.

    >>> line = Line(np.append(np.arange(3000.0), np.nan), np.ones(3001))
    >>> thinned(line).shape
    (501, 2)
    """
    points = np.stack([line.x, line.y], axis=1).astype(float)
    points[~np.isfinite(points).all(axis=1)] = np.nan
    if line.points or len(points) <= MOST:
        return points
    edges = np.flatnonzero(np.diff(np.isnan(points[:, 0]))) + 1
    share = MOST / len(points)
    return np.concatenate([every(piece, max(2, math.ceil(share * len(piece))))
                           for piece in np.split(points, edges)])
