"""The page of a diet: the features that each model does not need, and a row for each feature.

A row of the chart is an edit: the time of a step and the memory before it and after it.  Values
that are not numbers are None in the data of the chart.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from math import isnan
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from proofmass.errors import InputError
from proofmass.report.figures import save
from proofmass.report.page import slug
from proofmass.report.strip import Strip, place
from proofmass.report.study import Pages, Written, prepared
from proofmass.report.style import FIRST, RC
from proofmass.report.svg_markers import MARKS, tones
from proofmass.studies.diet.table import (
    NO_GAIN,
    OPTION,
    RANK,
    SAID,
    SURE,
    WHOLE,
    Entry,
    ranked,
    read_entries,
    saving,
    sentences,
    spent,
)
from proofmass.wording import number

ROW, WIDE, HEAD = 0.19, 7.2, 0.5  # [inch] height of a row, width of the figure, upper/lower margin
LEFT_END = -50.0  # % saved, at the left end of the axis at most: a disturbed timing may be less
LETTERS = 42  # most letters of a feature's name in the figure
SMALL, LARGE = 1e-9, 1e9  # ends of the axis of changes over the allowed ones
LOOKS = {
    "harmless": ("o", FIRST.colour),
    "drawn": ("o", "white"),
    NO_GAIN: ("o", "white"),
    "matters": ("X", "#333333"),
}
"""Marker and filling by outcome."""
SCRIPTS = ("axes.js", "rows.js", "savings.js")
"""Scripts of the chart."""
MUTED = "#333333"
"""Colour of features that stay."""
CHANGES = ((SMALL, "0"), (1.0, "allowed"), (LARGE, "more"))
"""Ticks and their labels on the axis of changes over the allowed ones."""
ZERO = 20.0
"""Place of zero on an axis of savings [%]: a measured saving may be slightly negative."""


def write_diet(folder: Path | str, output: Path | str, home: str = "") -> Written:
    """Write the page of all diets in a folder, ``index.html``, and its figures, from their tables.

    Raises
    ------
    InputError
        There is no diet in the folder.
    """
    folder, output = Path(folder), Path(output)
    files = sorted(folder.glob("*.csv"))
    if not files:
        raise InputError(folder, "", "no MODEL.csv there; proofmass diet MODEL.xml writes it")
    models = (f.with_suffix(".xml") for f in files)
    prepared(output, (*files, *models, folder / "diet.columns.md"), SCRIPTS)
    colours = tones([FIRST.colour, MUTED])
    css = {colour: tone.css for colour, tone in colours.items()}
    entries = [read_entries(file) for file in files]
    parts = [
        part(file, some, output / "figures", css) for file, some in zip(files, entries, strict=True)
    ]
    dressed = {outcome: css[colour_of(outcome)] for outcome in LOOKS}
    charted = [
        (one["name"], one["stem"], ranked(some)) for one, some in zip(parts, entries, strict=True)
    ]
    data = savings_data(charted, dressed)
    looks = [
        (*mark_of(outcome), dressed[outcome], f"{outcome}: {WORDS[outcome]}")
        for outcome in LOOKS
        if any(row["outcome"] == outcome for row in data["rows"])
    ]
    page = Pages(output, home, SCRIPTS).write(
        "index.html",
        "diet.html",
        data if data["rows"] else None,
        looks=looks,
        parts=parts,
        outcomes=list(dict.fromkeys(row["outcome"] for one in parts for row in one["rows"])),
        tones=colours.values(),
    )
    return Written(page, {one["name"]: f"{page.name}#{one['stem']}" for one in parts})


def colour_of(outcome: str) -> str:
    """The colour of an outcome; that of features that stay is muted."""
    return MUTED if outcome == "matters" else FIRST.colour


def part(
    file: Path, entries: Sequence[Entry], folder: Path, css: Mapping[str, str]
) -> dict[str, Any]:
    """The data of the section of one model, and its figure in a folder."""
    stem = f"{slug(file.stem)}-diet"
    shown = ranked(entries)
    monitored = [e.message for e in entries if e.kind == SAID]
    with rc_context(RC):
        save(diet_figure([e for e in shown if e.outcome in LOOKS]), folder / stem)
    most = {
        "time": max((abs(e.saved_time) for e in shown if e.saved), default=0.0) or 1.0,
        "memory": max((abs(e.saved_memory) for e in shown if e.costs), default=0.0) or 1.0,
    }
    return {
        "name": file.stem,
        "stem": stem,
        "table": file.name,
        "model": f"{file.stem}.xml",
        "words": [text for text in sentences(entries) if text not in monitored],
        "monitored": monitored,
        "goes": any(e.outcome == "harmless" for e in entries if e.kind != WHOLE),
        "zero": ZERO,
        "short": in_short(entries[-1]),
        "changes": [(change_at(share), text) for share, text in CHANGES],
        "most_time": f"{number(100 * most['time'], 2)} %",
        "most_memory": f"{number(most['memory'], 2)} KB",
        "rows": [cells(e, css, most) for e in shown],
    }


def in_short(whole: Entry) -> list[tuple[str, str, str]]:
    """Names, values and remarks of the savings of a whole diet; empty if nothing is removed."""
    if whole.kind != WHOLE or not whole.costs or not whole.moved:
        return []
    before, after = whole.costs
    run, channel, share = whole.worst
    return [
        (
            "time of a step",
            f"{number(1e6 * before.seconds, 3)} → {number(1e6 * after.seconds, 3)} µs",
            spent(whole),
        ),
        ("memory", f"{number(before.size / 1024)} → {number(after.size / 1024)} KB", ""),
        (
            "largest change",
            f"{number(share, 2)} of what is allowed",
            f"{channel} in {run}" if share else "no channel changes at all",
        ),
    ]


def change_at(share: float) -> float:
    """Place of a change, over the allowed one, on its axis [%]."""
    return place(min(max(share, SMALL), LARGE), SMALL, LARGE)


def change_strip(entry: Entry, css: Mapping[str, str]) -> Strip | None:
    """The strip of the largest change of a channel; None if the model does not run without it."""
    if entry.outcome not in LOOKS:
        return None
    marker, filling = LOOKS[entry.outcome]
    share = entry.worst[2] if entry.moved else 0.0
    at = 100.0 if isnan(share) else change_at(share)
    return Strip(
        f"largest change {number(share, 2)} of what is allowed",
        css[colour_of(entry.outcome)],
        [change_at(one) for one, _ in CHANGES],
        mark=MARKS[marker],
        hollow=filling == "white",
        dot=at,
        bar=(0.0, at),
        band=(0.0, change_at(1.0)),
    )


def saved_strip(
    entry: Entry, css: Mapping[str, str], share: float, interval: Sequence[float] = ()
) -> Strip | None:
    """The strip of a saving, as a share of the largest of a feature, from `ZERO` on."""
    if not entry.costs or isnan(share):
        return None
    ends = [min(max(ZERO + (100 - ZERO) * one, 0.0), 100.0) for one in (share, *interval)]
    strip = Strip(
        f"saves {number(share, 2)} of the most that one feature saves",
        css[FIRST.colour if entry.outcome == "harmless" else MUTED],
        [ZERO, 100.0],
        bar=(ZERO, ends[0]),
    )
    return replace(strip, spread=(ends[1], ends[-1])) if interval else strip


def cells(entry: Entry, css: Mapping[str, str], most: Mapping[str, float]) -> dict[str, Any]:
    """A row of the table, with all numbers formatted as text."""
    run, channel, share = entry.worst
    where = f"{channel} in {run}" if channel and share else ""
    low_high = (entry.saved[0], entry.saved[-1]) if entry.saved else ()
    memory = entry.saved_memory if entry.costs else float("nan")
    return {
        "kind": entry.kind,
        "name": entry.name,
        "outcome": entry.outcome,
        "good": entry.outcome in ("harmless", "drawn", NO_GAIN),
        "share": number(share),
        "share_value": "" if isnan(share) else share,
        "where": where or entry.message,
        "time": saving(entry),
        "time_value": "" if isnan(entry.saved_time) else entry.saved_time,
        "memory": f"{number(memory)} KB" if entry.costs else "—",
        "memory_value": "" if isnan(memory) else memory,
        "change_strip": change_strip(entry, css),
        "time_strip": saved_strip(
            entry,
            css,
            entry.saved_time / most["time"],
            [one / most["time"] for one in low_high],
        ),
        "memory_strip": saved_strip(entry, css, memory / most["memory"]),
    }


Css = Mapping[str, str]
WORDS = {
    "harmless": "it is removed or changed",
    "drawn": "it is not needed, but drawn, and kept",
    NO_GAIN: "it could be changed, but saves no measurable time",
    "matters": "it stays",
}
"""Descriptions of the outcomes."""
SHAPES = {NO_GAIN: "D"}
"""Markers that differ from those of the figure, which has the same marker for two outcomes."""
LEAST = 1e-3
"""Least share of a cost to which an interval is drawn, since a logarithmic axis has no zero."""


def savings_data(parts: Iterable[tuple[str, str, Iterable[Entry]]], css: Css) -> dict[str, Any]:
    """The data of the chart.

    Parameters
    ----------
    parts : iterable of tuple
        Name, stem, and entries of each model, in the order of its table, whose row k has the id
        ``STEM-k``.
    css : mapping of str to str
        CSS classes of the colours, by outcome.
    """
    parts = [(name, stem, list(entries)) for name, stem, entries in parts]
    rows = [
        row(entry, stem, f"{stem}-{k}", css)
        for _, stem, entries in parts
        for k, entry in enumerate(entries)
        if entry.costs and entry.outcome in LOOKS
    ]
    there = {one["part"] for one in rows}
    return {
        "parts": [{"name": name, "stem": stem} for name, stem, _ in parts if stem in there],
        "rows": rows,
    }


def row(entry: Entry, stem: str, key: str, css: Css) -> dict[str, Any]:
    """A row of the chart."""
    before, after = entry.costs
    path, hollow = mark_of(entry.outcome)
    return {
        "part": stem,
        "id": key,
        "label": entry.title,
        "outcome": entry.outcome,
        "strong": entry.kind == WHOLE,
        "rank": -1 if entry.kind == WHOLE else RANK[entry.outcome],
        "css": css[entry.outcome],
        "mark": path,
        "hollow": hollow,
        "seconds": [before.seconds, *times(entry)],
        "memory": [before.size / 1024, after.size / 1024],
        "time": saving(entry),
        "kilobytes": f"{number(entry.saved_memory)} KB",
        "said": sentence(entry),
        "edit": entry.edit,
    }


def mark_of(outcome: str) -> tuple[str, bool]:
    """The marker of an outcome, and whether only its outline is drawn."""
    marker, filling = LOOKS[outcome]
    return MARKS[SHAPES.get(outcome, marker)], filling == "white"


def times(entry: Entry) -> list[float]:
    """Time of a step without a feature, and the ends of its interval, if there is one [s]."""
    before, after = entry.costs
    if not entry.saved:
        return [after.seconds]
    low, middle, high = entry.saved
    return [before.seconds * max(1 - share, LEAST) for share in (middle, high, low)]


def format_time(seconds: float) -> str:
    """The time of a step as text.

    >>> format_time(1.234e-5), format_time(0.0021)
    ('12.3 µs', '2.1 ms')
    """
    return f"{number(1e6 * seconds)} µs" if seconds < 1e-3 else f"{number(1e3 * seconds)} ms"


def sentence(entry: Entry) -> str:
    """Sentences on the outcome of a feature or an option, its costs, and the largest change."""
    before, after = entry.costs
    text = f"{entry.outcome.capitalize()}: {WORDS[entry.outcome]}."
    one, two = ("before", "after") if entry.kind == OPTION else ("with it", "without")
    own = times(entry)
    text += f" A step takes {format_time(before.seconds)} {one}, {format_time(own[0])} {two}"
    if entry.saved:
        text += f" ({format_time(own[1])} to {format_time(own[2])} with {SURE})"
    if entry.saved and not entry.measurable:
        text += ", no change that is measured"
    text += f". Memory: {number(before.size / 1024)} KB {one}, {number(after.size / 1024)} {two}."
    run, channel, share = entry.worst
    if isnan(share):
        return text
    if not share:
        return f"{text} No channel changes."
    return (
        f"{text} The largest change is {number(share, 2)} of what is allowed, {channel} in {run}."
    )


def diet_figure(entries: Sequence[Entry]) -> Figure:
    """The figure of features without which the model runs: columns of change, time and memory."""
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
    axes[1].set_xlim(left=max(axes[1].get_xlim()[0], LEFT_END))
    axes[1].set_xlabel("time of a step saved [%]")
    bars(axes[2], entries, places, lambda entry: entry.saved_memory)
    axes[2].set_xlabel("memory saved [KB]")
    figure.subplots_adjust(
        left=0.36, right=0.97, bottom=0.42 / height, top=1 - 0.12 / height, wspace=0.2
    )
    return figure


def label(ax: Axes, entry: Entry, y: float) -> None:
    """Write the name of a feature to the left of the columns."""
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
    """Draw the largest change of a channel."""
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
    """Draw bars of savings: filled for harmless features, only an outline for others."""
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
