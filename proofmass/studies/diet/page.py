"""The page of a diet: what each model does not need, what that saves, and each feature as a row."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import isnan
from pathlib import Path
from typing import Any

from matplotlib import rc_context

from proofmass.errors import InputError
from proofmass.report.figures import save
from proofmass.report.marks import MARKS, tones
from proofmass.report.page import slug
from proofmass.report.strip import Strip, place
from proofmass.report.study import Pages, Written, prepared
from proofmass.report.style import FIRST, RC
from proofmass.studies.diet.figure import LARGE, LOOKS, SMALL, diet_sheet
from proofmass.studies.diet.page_data import WORDS, mark_of, savings_data
from proofmass.studies.diet.table import (
    NO_GAIN,
    SAID,
    WHOLE,
    Entry,
    ranked,
    read_entries,
    saving,
    sentences,
    spent,
)
from proofmass.wording import number

SCRIPTS = ("axes.js", "rows.js", "savings.js")
"""Of the chart."""
MUTED = "#333333"
"""Of what stays."""
CHANGES = ((SMALL, "0"), (1.0, "allowed"), (LARGE, "more"))
"""On the axis of changes over what is allowed."""
ZERO = 20.0
"""Place of what saves nothing on an axis of what is saved [%]: timings may be a little worse."""


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
    """The colour of an outcome: of what stays a muted one."""
    return MUTED if outcome == "matters" else FIRST.colour


def part(
    file: Path, entries: Sequence[Entry], folder: Path, css: Mapping[str, str]
) -> dict[str, Any]:
    """All that the page shows of one model."""
    stem = f"{slug(file.stem)}-diet"
    shown = ranked(entries)
    monitored = [e.message for e in entries if e.kind == SAID]
    with rc_context(RC):
        save(diet_sheet([e for e in shown if e.outcome in LOOKS]), folder / stem)
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
    """Names, values and remarks of what a diet saves as a whole; nothing if nothing goes."""
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
    """Place of a change over what is allowed on its axis [%]."""
    return place(min(max(share, SMALL), LARGE), SMALL, LARGE)


def change_strip(entry: Entry, css: Mapping[str, str]) -> Strip | None:
    """How far the channels move; None of what the model cannot be run without."""
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
    """What a removal saves, as a share of the most that one saves, from `ZERO`."""
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
    """A row of the table, every number already a word."""
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
