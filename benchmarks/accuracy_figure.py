"""The figure of wall time over error of all cases: all settings and the engines' defaults."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from proofmass.base.arrays import Array
from proofmass.report.style import FIXED_LOOKS
from proofmass.studies.record import StudyRow
from proofmass.studies.trade.choose import is_default

ERRORS = np.geomspace(1e-2, 1e-9, 57)  # wanted errors, as shares of the range
NAMES = {
    "mujoco": "MuJoCo, cheapest of all settings",
    "mujoco:default": "MuJoCo, defaults refined",
    "pymunk": "pymunk, cheapest of all settings",
    "pymunk:default": "pymunk, defaults refined",
}


def accuracy_figure(rows: Sequence[StudyRow], times: Mapping[str, float]) -> Figure:
    """A panel for each engine: the median over cases, and a band of their middle half."""
    figure = Figure(figsize=(7.2, 3.3))
    axes = figure.subplots(1, 2, sharey=True, sharex=True)
    for ax, engine in zip(axes, ("mujoco", "pymunk"), strict=True):
        for name in (f"{engine}:default", engine):
            own = [
                r
                for r in rows
                if r.engine == engine
                and r.outcome == "ran"
                and r.seconds > 0
                and r.case in times
                and (name == engine or is_default(r))
            ]
            curve(
                ax,
                np.array(
                    [
                        cheapest([r for r in own if r.case == case], time)
                        for case, time in times.items()
                    ]
                ),
                name,
            )
        ax.set_xscale("log")
        ax.set_yscale("log")
        ax.set_xlabel("largest error of all positions, share of range")
        ax.axhline(1.0, color="#333333", linewidth=0.8, linestyle=(0, (1, 2)))
        ax.set_ylim(1e-4, 30.0)
        ax.legend(loc="upper left", frameon=False, fontsize=7)
        ax.annotate(
            "as long as the simulated time",
            (ERRORS[0], 1.0),
            xytext=(0, -3),
            fontsize=7,
            textcoords="offset points",
            ha="left",
            va="top",
        )
    axes[0].set_xlim(ERRORS[0] * 1.5, ERRORS[-1] / 1.5)
    axes[0].set_ylabel("wall time per simulated time [s/s]")
    figure.tight_layout()
    return figure


def cheapest(rows: Sequence[StudyRow], time: float) -> Array:
    """Wall time per simulated time of the cheapest row for each of `ERRORS`; infinite if none."""
    errors = np.array([row.errors.get("position", np.inf) for row in rows])
    seconds = np.array([row.seconds for row in rows]) / time
    able = np.where(errors[:, None] <= ERRORS, seconds[:, None], np.inf)
    return np.asarray(able.min(axis=0, initial=np.inf))


def curve(ax: Axes, costs: Array, name: str) -> None:
    """Draw median and quartiles of costs (cases, errors), as far as half of the cases have one."""
    look = FIXED_LOOKS[name]
    low, middle, high = np.quantile(costs, (0.25, 0.5, 0.75), axis=0, method="higher")
    known = np.isfinite(middle)
    top = np.where(np.isfinite(high), high, np.nan)
    ax.fill_between(
        ERRORS[known], low[known], top[known], color=look.colour, alpha=0.18, linewidth=0
    )
    ax.plot(
        ERRORS[known],
        middle[known],
        color=look.colour,
        linewidth=1.6,
        linestyle=look.dash,
        label=NAMES[name],
    )
