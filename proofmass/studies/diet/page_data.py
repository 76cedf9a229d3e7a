"""What the chart of a diet page shows, as one dict for its script.

A row is an edit: what a step and the memory cost with what it takes out or changes, and without.
Numbers that are none are None.
"""

from collections.abc import Iterable, Mapping
from math import isnan
from typing import Any

from proofmass.report.marks import MARKS
from proofmass.studies.diet.figure import LOOKS
from proofmass.studies.diet.table import NO_GAIN, OPTION, RANK, SURE, WHOLE, Entry, saving
from proofmass.wording import number

Css = Mapping[str, str]
WORDS = {
    "harmless": "it goes",
    "drawn": "it could go, and is kept for the eye",
    NO_GAIN: "it could be changed, and saves no time that is measured",
    "matters": "it stays",
}
"""What becomes of a feature, by its outcome."""
SHAPES = {NO_GAIN: "D"}
"""Markers other than those of the figure, which has one for two outcomes."""
LEAST = 1e-3
"""Share of a cost that an interval is drawn to: an axis of decades has no zero."""


def savings_data(parts: Iterable[tuple[str, str, Iterable[Entry]]], css: Css) -> dict[str, Any]:
    """All that the chart shows.

    Parameters
    ----------
    parts : iterable of tuple
        Name, stem, and entries in the order of their table, whose row k has the id ``STEM-k``.
    css : mapping of str to str
        Classes of colours, by outcome.
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
    """Time of a step without a feature, and the interval of it [s]; of none the time alone."""
    before, after = entry.costs
    if not entry.saved:
        return [after.seconds]
    low, middle, high = entry.saved
    return [before.seconds * max(1 - share, LEAST) for share in (middle, high, low)]


def format_time(seconds: float) -> str:
    """A time of a step in words.

    >>> format_time(1.234e-5), format_time(0.0021)
    ('12.3 µs', '2.1 ms')
    """
    return f"{number(1e6 * seconds)} µs" if seconds < 1e-3 else f"{number(1e3 * seconds)} ms"


def sentence(entry: Entry) -> str:
    """What became of a feature or an option, what it costs, and what its removal changes."""
    before, after = entry.costs
    told = f"{entry.outcome.capitalize()}: {WORDS[entry.outcome]}."
    one, two = ("before", "after") if entry.kind == OPTION else ("with it", "without")
    own = times(entry)
    told += f" A step takes {format_time(before.seconds)} {one}, {format_time(own[0])} {two}"
    if entry.saved:
        told += f" ({format_time(own[1])} to {format_time(own[2])} with {SURE})"
    if entry.saved and not entry.measurable:
        told += ", no change that is measured"
    told += f". Memory: {number(before.size / 1024)} KB {one}, {number(after.size / 1024)} {two}."
    run, channel, share = entry.worst
    if isnan(share):
        return told
    if not share:
        return f"{told} No channel changes."
    return (
        f"{told} The largest change is {number(share, 2)} of what is allowed, {channel} in {run}."
    )
