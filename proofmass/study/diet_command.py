"""``proofmass diet``: what a scene does not need, and the model without it."""

import csv
import io
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from proofmass.command import Jobs, answering, errors
from proofmass.errors import InputError
from proofmass.study.diet import Diet, Entry, Search
from proofmass.study.draft import read
from proofmass.study.kept import Kept
from proofmass.study.scene import Scene, scene_of
from proofmass.study.slim import write
from proofmass.study.store import write as write_whole
from proofmass.terminal import console

GOES = {"harmless": "✓ goes", "drawn": "· drawn, kept", "matters": "✗ matters",
        "needed": "✗ needed"}
COLUMNS = ("kind", "feature", "outcome", "run", "channel", "moved_over_allowed",
           "seconds_before", "seconds_after", "bytes_before", "bytes_after", "message")


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
) -> None:
    """Find what a scene does not need, and write the model without it.

    Each feature is taken out by itself and every run is done again: those of the sidecars, within
    their tolerances, or the motion from the model's key, to rounding. What was tried is kept: a
    diet that was stopped goes on when the command is given again. Exit code 0: done; 2: bad input.
    """
    file = output or Path("diet") / model.name
    with answering("what was tried is kept", InputError):
        scene = scene_of(model, seconds)
        with errors.status("starting") as status:
            found = Search(scene, blind, jobs=jobs, kept=Kept(file.parent / "runs"),
                           progress=lambda what: status.update(what[:70])).run()
        finish(scene, found, file)


def finish(scene: Scene, found: Diet, file: Path) -> None:
    """Write the slim model and the table, try the model as it was written, and tell."""
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
    write_whole(file.with_suffix(".csv"), table(found))
    console().print(shown(found))
    for path in (file, file.with_suffix(".csv")):
        print(path)


def table(found: Diet) -> str:
    """CSV with a row for each channel of each feature; its columns are `COLUMNS`."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for entry in (*found.entries, found.whole):
        head = entry.feature.kind, entry.feature.name, entry.outcome
        before, after = entry.costs or (None, None)
        costs = (before and before.seconds, after and after.seconds, before and before.size,
                 after and after.size, entry.message)
        moved = [(run, name, str(share)) for run, shares in entry.moved.items()
                 for name, share in shares.items()]
        writer.writerows((*head, *row, *costs) for row in moved or [("", "", "")])
    return text.getvalue()


def shown(found: Diet) -> Table:
    """What standard output shows: a row a feature, what goes first."""
    rows = Table(box=None, header_style="bold", pad_edge=False)
    for name in ("what", "which", "outcome", "time", "memory", "moves most", "of allowed"):
        rows.add_column(name, justify="right" if name in ("time", "memory", "of allowed") else
                        "left", overflow="fold")
    rank = {outcome: k for k, outcome in enumerate(GOES)}
    for entry in (*sorted(found.entries, key=lambda e: rank.get(e.outcome, len(rank))),
                  found.whole):
        rows.add_row(*cells(entry))
    return rows


def cells(entry: Entry) -> tuple[str, ...]:
    """A row of what is shown: time and memory as shares saved."""
    run, channel, share = entry.worst
    saved = ("–", "–")
    if entry.costs:
        before, after = entry.costs
        saved = (f"{1 - after.seconds / before.seconds:+.0%}",
                 f"{(before.size - after.size) / 1024:+.1f} KB")
    where = f"{channel} in {run}" if channel and share else entry.message[:80]
    return (entry.feature.kind, entry.feature.name[:60],
            GOES.get(entry.outcome, f"✗ {entry.outcome}"), *saved, where,
            f"{share:.1e}" if share == share else "–")
