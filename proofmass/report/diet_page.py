"""The page of diets: what each model does not need, in a figure, in words, and as a table."""

import shutil
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from markupsafe import Markup
from matplotlib import rc_context

from proofmass.errors import InputError
from proofmass.report.diet_sheet import LOOKS, diet_sheet, saved_memory, saved_time
from proofmass.report.figures import save
from proofmass.report.pages import about, environment, slug
from proofmass.report.study import Written
from proofmass.report.style import RC
from proofmass.report.svg import inline
from proofmass.study.diet_table import WHOLE, Entry, read_entries
from proofmass.wording import number

RANK = {"harmless": 0, "drawn": 1, "matters": 2}
CAPTION = ("What the model can be run without. Left: the channel that moves most, over what it may "
           "move; filled: goes, ring: drawn, kept for the eye, cross: matters. Right: what a step "
           "would save; outlines stay.")


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
    (output / "figures").mkdir(parents=True, exist_ok=True)
    if folder.resolve() != output.resolve():
        for file in (*files, *(f.with_suffix(".xml") for f in files), folder / "diet.columns.md"):
            shutil.copyfile(file, output / file.name)
    parts = [part(file, output / "figures") for file in files]
    page = output / "index.html"
    page.write_text(environment().get_template("diet.html").render(
        parts=parts, about=about(), style={}, home=home), encoding="utf-8")
    return Written(page, {one["name"]: f"{page.name}#{one['stem']}" for one in parts})


def part(file: Path, folder: Path) -> dict[str, Any]:
    """All that the page shows of one model."""
    entries = read_entries(file)
    stem = f"{slug(file.stem)}-diet"
    runs = sorted((e for e in entries if e.outcome in LOOKS), key=rank)
    with rc_context(RC):
        svg = save(diet_sheet(runs), folder / stem)
    return {"name": file.stem, "stem": stem, "table": file.name, "model": f"{file.stem}.xml",
            "caption": CAPTION, "svg": Markup(inline(svg, stem, f"{file.stem}: {CAPTION}")),
            "words": list(words(entries)), "rows": [cells(e) for e in sorted(entries, key=rank)]}


def rank(entry: Entry) -> int:
    """What goes first, the whole last of what could be run."""
    return 3 if entry.kind == WHOLE else RANK.get(entry.outcome, 4)


def words(entries: Sequence[Entry]) -> Iterator[str]:
    """What to make of it."""
    single, whole = [e for e in entries if e.kind != WHOLE], entries[-1]
    gone = [e for e in single if e.outcome == "harmless"]
    drawn = [e for e in single if e.outcome == "drawn"]
    if not gone:
        yield (f"Nothing is left to remove: each of {len(single)} features was taken out, and all "
               f"but what is drawn is needed or changes a channel by more than it may.")
    else:
        run, channel, share = whole.worst
        yield (f"{len(gone)} of {len(single)} features go together: "
               f"{', '.join(f'{e.kind} {e.name}'.strip() for e in gone)}.")
        yield (f"The largest change is {number(share, 2)} of what is allowed, of {channel} in "
               f"{run}." if share else "No channel changes at all.")
        if whole.costs:
            yield (f"A step takes {number(1 - saved_time(whole), 3)} of its time, and "
                   f"{number(saved_memory(whole))} KB less memory.")
    if drawn:
        yield (f"Drawn, and kept for the eye: {', '.join(e.name for e in drawn)}. --blind takes "
               f"them out as well.")


def cells(entry: Entry) -> dict[str, str]:
    """A row of the table, every number already a word."""
    run, channel, share = entry.worst
    where = f"{channel} in {run}" if channel and share else ""
    return {"kind": entry.kind, "name": entry.name, "outcome": entry.outcome,
            "share": number(share), "where": where, "message": entry.message,
            "time": f"{number(100 * saved_time(entry), 2)} %" if entry.costs else "—",
            "memory": f"{number(saved_memory(entry))} KB" if entry.costs else "—"}
