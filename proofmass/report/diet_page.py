"""The page of diets: what each model does not need, in a figure, in words, and as a table."""

from pathlib import Path
from typing import Any

from markupsafe import Markup
from matplotlib import rc_context

from proofmass.errors import InputError
from proofmass.files import write_whole
from proofmass.report.diet_sheet import LOOKS, diet_sheet
from proofmass.report.figures import save
from proofmass.report.pages import about, environment, slug
from proofmass.report.study import Written, prepared
from proofmass.report.style import RC
from proofmass.report.svg import inline
from proofmass.studies.diet.diet_table import Entry, read_entries
from proofmass.studies.diet.diet_words import ranked, saving, sentences
from proofmass.wording import number

CAPTION = ("What the model can be run without. Left: the channel that moves most, over what it may "
           "move; filled: goes, ring: drawn, kept for the eye, cross: matters. Right: what a step "
           "would save, with the interval of the median with 99 %; outlines stay.")


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
    prepared(output, (*files, *(f.with_suffix(".xml") for f in files), folder / "diet.columns.md"))
    parts = [part(file, output / "figures") for file in files]
    page = output / "index.html"
    write_whole(page, environment().get_template("diet.html").render(
        parts=parts, about=about(), style={}, home=home))
    return Written(page, {one["name"]: f"{page.name}#{one['stem']}" for one in parts})


def part(file: Path, folder: Path) -> dict[str, Any]:
    """All that the page shows of one model."""
    entries = read_entries(file)
    stem = f"{slug(file.stem)}-diet"
    shown = ranked(entries)
    with rc_context(RC):
        svg = save(diet_sheet([e for e in shown if e.outcome in LOOKS]), folder / stem)
    return {"name": file.stem, "stem": stem, "table": file.name, "model": f"{file.stem}.xml",
            "caption": CAPTION, "svg": Markup(inline(svg, stem, f"{file.stem}: {CAPTION}")),
            "words": list(sentences(entries)), "rows": [cells(e) for e in shown]}


def cells(entry: Entry) -> dict[str, str]:
    """A row of the table, every number already a word."""
    run, channel, share = entry.worst
    where = f"{channel} in {run}" if channel and share else ""
    return {"kind": entry.kind, "name": entry.name, "outcome": entry.outcome,
            "share": number(share), "where": where or entry.message,
            "time": saving(entry),
            "memory": f"{number(entry.saved_memory)} KB" if entry.costs else "—"}
