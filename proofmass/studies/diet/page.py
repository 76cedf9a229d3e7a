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

from proofmass.report.style import FIRST_LOOK, LABEL_COLOUR, RC  # isort: skip
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from proofmass.base.errors import InputError
from proofmass.base.wording import number
from proofmass.report.figures import label_row, save
from proofmass.report.page import slug
from proofmass.report.strip import Strip, log_place
from proofmass.report.study import PageWriter, StudyPages, prepare_folder
from proofmass.report.svg_markers import MARKER_PATHS, page_tones
from proofmass.studies.diet.table import (
    CONFIDENCE,
    NO_GAIN,
    OPTION_KIND,
    OUTCOME_RANKS,
    SENTENCE_KIND,
    WHOLE_KIND,
    Entry,
    format_saving,
    format_time_share,
    read_entries,
    sort_entries,
    summary_sentences,
)

ROW_HEIGHT, FIGURE_WIDTH, MARGIN_HEIGHT = (0.19, 7.2, 0.5)
"""Height of a row, width of the figure, and upper and lower margin [inch]."""
MIN_SAVING = -50.0  # % saved, at the left end of the axis at most: a disturbed timing may be less
MAX_LABEL_LETTERS = 42  # most letters of a feature's name in the figure
SMALLEST_CHANGE, LARGEST_CHANGE = 1e-9, 1e9  # ends of the axis of changes over the allowed ones
OUTCOME_LOOKS = {
    "harmless": ("o", FIRST_LOOK.colour),
    "drawn": ("o", "white"),
    NO_GAIN: ("o", "white"),
    "matters": ("X", LABEL_COLOUR),
}
"""Marker and filling by outcome."""
SAVINGS_SCRIPTS = ("axes.js", "rows.js", "savings.js")
"""Scripts of the chart."""
CHANGE_TICKS = ((SMALLEST_CHANGE, "0"), (1.0, "allowed"), (LARGEST_CHANGE, "more"))
"""Ticks and their labels on the axis of changes over the allowed ones."""
ZERO_PLACE = 20.0
"""Place of zero on an axis of savings [%]: a measured saving may be slightly negative."""


def write_diet(folder: Path | str, output: Path | str, home: str = "") -> StudyPages:
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
    prepare_folder(output, (*files, *models, folder / "diet.columns.md"), SAVINGS_SCRIPTS)
    colours = page_tones([FIRST_LOOK.colour, LABEL_COLOUR])
    css = {colour: tone.css for colour, tone in colours.items()}
    entries = [read_entries(file) for file in files]
    parts = [
        section_data(file, some, output / "figures", css)
        for file, some in zip(files, entries, strict=True)
    ]
    outcome_css = {outcome: css[colour_of(outcome)] for outcome in OUTCOME_LOOKS}
    charted = [
        (one["name"], one["stem"], sort_entries(some))
        for one, some in zip(parts, entries, strict=True)
    ]
    data = savings_data(charted, outcome_css)
    looks = [
        (*outcome_marker(outcome), outcome_css[outcome], f"{outcome}: {OUTCOME_WORDS[outcome]}")
        for outcome in OUTCOME_LOOKS
        if any(row["outcome"] == outcome for row in data["rows"])
    ]
    page = PageWriter(output, home, SAVINGS_SCRIPTS).write(
        "index.html",
        "diet.html",
        data if data["rows"] else None,
        looks=looks,
        parts=parts,
        outcomes=list(dict.fromkeys(row["outcome"] for one in parts for row in one["rows"])),
        tones=colours.values(),
    )
    return StudyPages(page, {one["name"]: f"{page.name}#{one['stem']}" for one in parts})


def colour_of(outcome: str) -> str:
    """The colour of an outcome; that of features that stay is muted."""
    return LABEL_COLOUR if outcome == "matters" else FIRST_LOOK.colour


def section_data(
    file: Path, entries: Sequence[Entry], folder: Path, css: Mapping[str, str]
) -> dict[str, Any]:
    """The data of the section of one model, and its figure in a folder."""
    stem = f"{slug(file.stem)}-diet"
    shown = sort_entries(entries)
    monitored = [e.message for e in entries if e.kind == SENTENCE_KIND]
    with rc_context(RC):
        save(diet_figure([e for e in shown if e.outcome in OUTCOME_LOOKS]), folder / stem)
    most = {
        "time": max((abs(e.saved_time) for e in shown if e.saved), default=0.0) or 1.0,
        "memory": max((abs(e.saved_memory) for e in shown if e.costs), default=0.0) or 1.0,
    }
    return {
        "name": file.stem,
        "stem": stem,
        "table": file.name,
        "model": f"{file.stem}.xml",
        "words": [text for text in summary_sentences(entries) if text not in monitored],
        "monitored": monitored,
        "goes": any(e.outcome == "harmless" for e in entries if e.kind != WHOLE_KIND),
        "zero": ZERO_PLACE,
        "short": summary_rows(entries[-1]),
        "changes": [(place_change(share), text) for share, text in CHANGE_TICKS],
        "most_time": f"{number(100 * most['time'], 2)} %",
        "most_memory": f"{number(most['memory'], 2)} KB",
        "rows": [table_row(e, css, most) for e in shown],
    }


def summary_rows(whole: Entry) -> list[tuple[str, str, str]]:
    """Names, values and remarks of the savings of a whole diet; empty if nothing is removed."""
    if whole.kind != WHOLE_KIND or not whole.costs or not whole.moved:
        return []
    before, after = whole.costs
    run, channel, share = whole.worst
    return [
        (
            "time of a step",
            f"{number(1e6 * before.seconds, 3)} → {number(1e6 * after.seconds, 3)} µs",
            format_time_share(whole),
        ),
        ("memory", f"{number(before.size / 1024)} → {number(after.size / 1024)} KB", ""),
        (
            "largest change",
            f"{number(share, 2)} of what is allowed",
            f"{channel} in {run}" if share else "no channel changes at all",
        ),
    ]


def place_change(share: float) -> float:
    """Place of a change, over the allowed one, on its axis [%]."""
    return log_place(
        min(max(share, SMALLEST_CHANGE), LARGEST_CHANGE), SMALLEST_CHANGE, LARGEST_CHANGE
    )


def change_strip(entry: Entry, css: Mapping[str, str]) -> Strip | None:
    """The strip of the largest change of a channel; None if the model does not run without it."""
    if entry.outcome not in OUTCOME_LOOKS:
        return None
    marker, filling = OUTCOME_LOOKS[entry.outcome]
    share = entry.worst[2] if entry.moved else 0.0
    at = 100.0 if isnan(share) else place_change(share)
    return Strip(
        f"largest change {number(share, 2)} of what is allowed",
        css[colour_of(entry.outcome)],
        [place_change(one) for one, _ in CHANGE_TICKS],
        mark=MARKER_PATHS[marker],
        hollow=filling == "white",
        dot=at,
        bar=(0.0, at),
        band=(0.0, place_change(1.0)),
    )


def saved_strip(
    entry: Entry, css: Mapping[str, str], share: float, interval: Sequence[float] = ()
) -> Strip | None:
    """The strip of a saving, as a share of the largest of a feature, from `ZERO_PLACE` on."""
    if not entry.costs or isnan(share):
        return None
    ends = [
        min(max(ZERO_PLACE + (100 - ZERO_PLACE) * one, 0.0), 100.0) for one in (share, *interval)
    ]
    strip = Strip(
        f"saves {number(share, 2)} of the most that one feature saves",
        css[FIRST_LOOK.colour if entry.outcome == "harmless" else LABEL_COLOUR],
        [ZERO_PLACE, 100.0],
        bar=(ZERO_PLACE, ends[0]),
    )
    return replace(strip, spread=(ends[1], ends[-1])) if interval else strip


def table_row(entry: Entry, css: Mapping[str, str], most: Mapping[str, float]) -> dict[str, Any]:
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
        "time": format_saving(entry),
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
OUTCOME_WORDS = {
    "harmless": "it is removed or changed",
    "drawn": "it is not needed, but drawn, and kept",
    NO_GAIN: "it could be changed, but saves no measurable time",
    "matters": "it stays",
}
"""Descriptions of the outcomes."""
CHART_MARKERS = {NO_GAIN: "D"}
"""Markers that differ from those of the figure, which has the same marker for two outcomes."""
MIN_COST_SHARE = 1e-3
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
        chart_row(entry, stem, f"{stem}-{k}", css)
        for _, stem, entries in parts
        for k, entry in enumerate(entries)
        if entry.costs and entry.outcome in OUTCOME_LOOKS
    ]
    there = {one["part"] for one in rows}
    return {
        "parts": [{"name": name, "stem": stem} for name, stem, _ in parts if stem in there],
        "rows": rows,
    }


def chart_row(entry: Entry, stem: str, key: str, css: Css) -> dict[str, Any]:
    """A row of the chart."""
    before, after = entry.costs
    path, hollow = outcome_marker(entry.outcome)
    return {
        "part": stem,
        "id": key,
        "label": entry.title,
        "outcome": entry.outcome,
        "strong": entry.kind == WHOLE_KIND,
        "rank": -1 if entry.kind == WHOLE_KIND else OUTCOME_RANKS[entry.outcome],
        "css": css[entry.outcome],
        "mark": path,
        "hollow": hollow,
        "seconds": [before.seconds, *step_times(entry)],
        "memory": [before.size / 1024, after.size / 1024],
        "time": format_saving(entry),
        "kilobytes": f"{number(entry.saved_memory)} KB",
        "said": describe_entry(entry),
        "edit": entry.edit,
    }


def outcome_marker(outcome: str) -> tuple[str, bool]:
    """The marker of an outcome, and whether only its outline is drawn."""
    marker, filling = OUTCOME_LOOKS[outcome]
    return MARKER_PATHS[CHART_MARKERS.get(outcome, marker)], filling == "white"


def step_times(entry: Entry) -> list[float]:
    """Time of a step without a feature, and the ends of its interval, if there is one [s]."""
    before, after = entry.costs
    if not entry.saved:
        return [after.seconds]
    low, middle, high = entry.saved
    return [before.seconds * max(1 - share, MIN_COST_SHARE) for share in (middle, high, low)]


def format_time(seconds: float) -> str:
    """The time of a step as text.

    >>> format_time(1.234e-5), format_time(0.0021)
    ('12.3 µs', '2.1 ms')
    """
    return f"{number(1e6 * seconds)} µs" if seconds < 1e-3 else f"{number(1e3 * seconds)} ms"


def describe_entry(entry: Entry) -> str:
    """Sentences on the outcome of a feature or an option, its costs, and the largest change."""
    before, after = entry.costs
    text = f"{entry.outcome.capitalize()}: {OUTCOME_WORDS[entry.outcome]}."
    one, two = ("before", "after") if entry.kind == OPTION_KIND else ("with it", "without")
    own = step_times(entry)
    text += f" A step takes {format_time(before.seconds)} {one}, {format_time(own[0])} {two}"
    if entry.saved:
        text += f" ({format_time(own[1])} to {format_time(own[2])} with {CONFIDENCE})"
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
    height = ROW_HEIGHT * max(len(entries), 2) + 2 * MARGIN_HEIGHT
    figure = Figure(figsize=(FIGURE_WIDTH, height))
    axes = figure.subplots(1, 3, sharey=True, width_ratios=[1.2, 1, 1])
    places = np.arange(len(entries), 0, -1.0).tolist()
    for y, entry in zip(places, entries, strict=True):
        draw_label(axes[0], entry, y)
        draw_change(axes[0], entry, y)
    axes[0].axvline(1.0, color=LABEL_COLOUR, linewidth=0.8)
    axes[0].set_xscale("log")
    axes[0].set_xlim(SMALLEST_CHANGE / 3, LARGEST_CHANGE * 3)
    axes[0].set_xticks([SMALLEST_CHANGE, 1e-5, 1, 1e5, LARGEST_CHANGE])
    axes[0].set_xticklabels(["0", "10⁻⁵", "allowed", "10⁵", "more"], fontsize=6.5)
    axes[0].set_xlabel("largest change of a channel")
    axes[0].set_ylim(0.2, len(entries) + 0.8)
    axes[0].set_yticks([])
    draw_bars(axes[1], entries, places, lambda entry: 100 * entry.saved_time)
    for y, entry in zip(places, entries, strict=True):
        if entry.saved:
            low, _, high = entry.saved
            axes[1].plot([100 * low, 100 * high], [y, y], color=LABEL_COLOUR, linewidth=0.9)
    axes[1].set_xlim(left=max(axes[1].get_xlim()[0], MIN_SAVING))
    axes[1].set_xlabel("time of a step saved [%]")
    draw_bars(axes[2], entries, places, lambda entry: entry.saved_memory)
    axes[2].set_xlabel("memory saved [KB]")
    figure.subplots_adjust(
        left=0.36, right=0.97, bottom=0.42 / height, top=1 - 0.12 / height, wspace=0.2
    )
    return figure


def draw_label(ax: Axes, entry: Entry, y: float) -> None:
    """Write the name of a feature to the left of the columns."""
    words = entry.title
    shortened = words if len(words) <= MAX_LABEL_LETTERS else f"{words[: MAX_LABEL_LETTERS - 1]}…"
    weight = "bold" if entry.kind == WHOLE_KIND else "normal"
    label_row(ax, shortened, y, 5.0, fontsize=6.8, fontweight=weight)


def draw_change(ax: Axes, entry: Entry, y: float) -> None:
    """Draw the largest change of a channel."""
    marker, filling = OUTCOME_LOOKS[entry.outcome]
    share = entry.worst[2] if entry.moved else 0.0
    place = min(max(share, SMALLEST_CHANGE), LARGEST_CHANGE) if share == share else LARGEST_CHANGE
    ax.plot([SMALLEST_CHANGE / 3, place], [y, y], color="#c4c4c4", linewidth=0.8, zorder=1)
    ax.plot(
        place,
        y,
        marker=marker,
        markersize=5,
        markerfacecolor=filling,
        zorder=3,
        markeredgecolor=FIRST_LOOK.colour if marker == "o" else LABEL_COLOUR,
    )


def draw_bars(
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
                color=FIRST_LOOK.colour if goes else "white",
                edgecolor=FIRST_LOOK.colour if entry.outcome != "matters" else "#999999",
            )
    ax.axvline(0.0, color=LABEL_COLOUR, linewidth=0.6)
    ax.set_axisbelow(True)
