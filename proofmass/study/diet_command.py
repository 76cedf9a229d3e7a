"""``proofmass diet``: what a scene does not need, and the model without it."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from proofmass.command import Dask, Jobs, answering, errors
from proofmass.errors import InputError
from proofmass.study.diet import Diet, Search
from proofmass.study.diet_table import Entry, read_entries, write_entries
from proofmass.study.diet_words import ranked, sentences
from proofmass.study.draft import read
from proofmass.study.kept import Kept
from proofmass.study.run import pool
from proofmass.study.scene import Scene, scene_of
from proofmass.study.slim import write
from proofmass.terminal import console
from proofmass.wording import number

GOES = {"harmless": "✓ goes", "drawn": "· drawn", "matters": "✗ matters"}


def diet_command(
    model: Annotated[Path, typer.Argument(help="MJCF file; sidecars beside it say what it is "
                     "for.")],
    output: Annotated[Path | None, typer.Option("--output", "-o", help="The slim model; the table "
                      "stands beside it.", show_default="diet/MODEL.xml")] = None,
    seconds: Annotated[float, typer.Option(min=1e-3, help="To follow a model without a sidecar, "
                       "from its key.")] = 5.0,
    blind: Annotated[bool, typer.Option("--blind", help="Geoms that are only drawn go as well.")]
    = False,
    jobs: Jobs = None,
    dask: Dask = None,
) -> None:
    """Find what a scene does not need, and write the model without it.

    Each feature is taken out by itself and every run is done again: those of the sidecars, within
    their tolerances, or the motion from the model's key, to rounding. What was tried is kept: a
    diet that was stopped goes on when the command is given again. Exit code 0: done; 2: bad input.
    """
    from proofmass.report.diet_page import write_diet  # matplotlib is slow to load

    file = output or Path("diet") / model.name
    with answering("what was tried is kept"):
        if file.exists() and model.exists() and file.samefile(model):
            raise InputError(file, "--output", "is the model itself; give another file")
        if (table := file.with_suffix(".csv")).exists():
            read_entries(table)  # what is no table of a diet is not replaced by one
        scene = scene_of(model, seconds)
        with pool(jobs, dask) as workers, errors.status("starting") as status:
            found = Search(scene, blind, workers=workers, kept=Kept(file.parent / "runs"),
                           progress=lambda what: status.update(what[:70])).run()
        finish(scene, found, file)
    for part in shown((*found.entries, found.whole)):
        console().print(part, markup=False)
    print()
    for path in (file, file.with_suffix(".csv"), write_diet(file.parent, file.parent).first):
        print(path)


def finish(scene: Scene, found: Diet, file: Path) -> None:
    """Write the slim model and the table, and try the model as it was written."""
    file.parent.mkdir(parents=True, exist_ok=True)
    half = file.with_name(f"{file.stem}.part.xml")
    try:
        write(found.slim, half, dressed=True)
        written = read(half, found.slim.rods)
        models = [written.compiled(found.slim.segmented(w.run.rods)) for w in scene.watches]
        outcome, _, message = Search(scene).ran(models, found.slim)
        if outcome != "harmless":
            raise InputError(scene.draft.file, "", "cannot be written with all its digits: its "
                             f"slim model {message or outcome}")
        write(found.slim, half)
        half.replace(file)
    finally:
        half.unlink(missing_ok=True)
    write_entries((*found.entries, found.whole), file.with_suffix(".csv"))


def shown(entries: Sequence[Entry]) -> Iterator[str | Table]:
    """What standard output shows: what to make of it, what could be run, and what is needed."""
    yield from (f"{text}\n" for text in sentences(entries))
    rows = Table(box=None, header_style="bold", pad_edge=False)
    for name in ("feature", "outcome", "time", "memory", "moves", "most of all"):
        rows.add_column(name, justify="right" if name in ("time", "memory", "moves") else "left",
                        no_wrap=name not in ("feature", "most of all"), overflow="fold")
    for entry in ranked(entries):
        if entry.outcome in GOES:
            rows.add_row(*cells(entry))
    if rows.row_count:
        yield rows
        yield "\ntime and memory: saved; moves: largest change of a channel, of what is allowed"
    if needed := [e.title for e in entries if e.outcome not in GOES]:
        yield f"\nWithout these it does not run: {'; '.join(needed)}"


def cells(entry: Entry) -> tuple[str, ...]:
    """A row of what is shown: time and memory as shares saved."""
    run, channel, share = entry.worst
    saved = ("–", "–")
    if entry.costs:
        saved = f"{entry.saved_time:+.0%}", f"{entry.saved_memory:+.1f} KB"
    return (entry.title, GOES[entry.outcome], *saved, number(share, 2),
            f"{channel} in {run}" if share else "")
