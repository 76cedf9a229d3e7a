"""The figure of a diet for papers: what each feature changes, and what its removal saves."""

from collections.abc import Callable, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from proofmass.report.style import FIRST
from proofmass.studies.diet.table import NO_GAIN, WHOLE, Entry

ROW, WIDE, HEAD = 0.19, 7.2, 0.5  # [inch] a feature, the figure, what stands above and below
LEAST = -50.0  # % saved: a timing that was disturbed more does not stretch the axis
LETTERS = 42  # of a feature's name
SMALL, LARGE = 1e-9, 1e9  # changes over what is allowed that are told apart
LOOKS = {
    "harmless": ("o", FIRST.colour),
    "drawn": ("o", "white"),
    NO_GAIN: ("o", "white"),
    "matters": ("X", "#333333"),
}
"""Marker and filling by outcome: what goes, what could, what stays."""


def diet_sheet(entries: Sequence[Entry]) -> Figure:
    """Three columns over the features that the model can be run without: change, time, memory."""
    height = ROW * max(len(entries), 2) + 2 * HEAD
    figure = Figure(figsize=(WIDE, height))
    axes = figure.subplots(1, 3, sharey=True, width_ratios=[1.2, 1, 1])
    places = np.arange(len(entries), 0, -1.0).tolist()
    for y, entry in zip(places, entries, strict=True):
        label(axes[0], entry, y)
        change(axes[0], entry, y)
    axes[0].axvline(1.0, color="#333333", linewidth=0.8)
    axes[0].set_xscale("log")
    axes[0].set_xlim(SMALL / 3, LARGE * 3)
    axes[0].set_xticks([SMALL, 1e-5, 1, 1e5, LARGE])
    axes[0].set_xticklabels(["0", "10⁻⁵", "allowed", "10⁵", "more"], fontsize=6.5)
    axes[0].set_xlabel("largest change of a channel")
    axes[0].set_ylim(0.2, len(entries) + 0.8)
    axes[0].set_yticks([])
    bars(axes[1], entries, places, lambda entry: 100 * entry.saved_time)
    for y, entry in zip(places, entries, strict=True):
        if entry.saved:
            low, _, high = entry.saved
            axes[1].plot([100 * low, 100 * high], [y, y], color="#333333", linewidth=0.9)
    axes[1].set_xlim(left=max(axes[1].get_xlim()[0], LEAST))
    axes[1].set_xlabel("time of a step saved [%]")
    bars(axes[2], entries, places, lambda entry: entry.saved_memory)
    axes[2].set_xlabel("memory saved [KB]")
    figure.subplots_adjust(
        left=0.36, right=0.97, bottom=0.42 / height, top=1 - 0.12 / height, wspace=0.2
    )
    return figure


def label(ax: Axes, entry: Entry, y: float) -> None:
    """What was taken out, left of the columns."""
    words = entry.title
    cut = words if len(words) <= LETTERS else f"{words[: LETTERS - 1]}…"
    ax.annotate(
        cut,
        (0, y),
        xycoords=("axes fraction", "data"),
        xytext=(-5, 0),
        fontsize=6.8,
        textcoords="offset points",
        ha="right",
        va="center",
        fontweight="bold" if entry.kind == WHOLE else "normal",
    )


def change(ax: Axes, entry: Entry, y: float) -> None:
    """How far the channels move."""
    marker, filling = LOOKS[entry.outcome]
    share = entry.worst[2] if entry.moved else 0.0
    place = min(max(share, SMALL), LARGE) if share == share else LARGE
    ax.plot([SMALL / 3, place], [y, y], color="#c4c4c4", linewidth=0.8, zorder=1)
    ax.plot(
        place,
        y,
        marker=marker,
        markersize=5,
        markerfacecolor=filling,
        zorder=3,
        markeredgecolor=FIRST.colour if marker == "o" else "#333333",
    )


def bars(
    ax: Axes, entries: Sequence[Entry], places: Sequence[float], value: Callable[[Entry], float]
) -> None:
    """What is saved: filled where it goes, only an outline where it stays."""
    for y, entry in zip(places, entries, strict=True):
        if entry.costs:
            goes = entry.outcome == "harmless"
            ax.barh(
                y,
                value(entry),
                height=0.62,
                linewidth=0.6,
                color=FIRST.colour if goes else "white",
                edgecolor=FIRST.colour if entry.outcome != "matters" else "#999999",
            )
    ax.axvline(0.0, color="#333333", linewidth=0.6)
    ax.set_axisbelow(True)
