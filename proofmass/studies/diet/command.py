"""``proofmass diet``: what a scene does not need, and the model without it."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from rich.table import Table

from proofmass.command import answering, errors
from proofmass.errors import InputError
from proofmass.studies.diet.diet import Diet, DietSearch, DietStore
from proofmass.studies.diet.edits import read, write
from proofmass.studies.diet.scene import DietScene, scene_of
from proofmass.studies.diet.table import (
    NO_GAIN,
    Entry,
    ranked,
    read_entries,
    saving,
    sentences,
    write_entries,
)
from proofmass.studies.run import pool
from proofmass.terminal import console
from proofmass.wording import number

GOES = {"harmless": "✓ goes", "drawn": "· drawn", NO_GAIN: "· no gain", "matters": "✗ matters"}


def run_diet(
    model: Path,
    output: Path | None,
    seconds: float,
    monitored: list[str] | None,
    error: float | None,
    keep_options: bool,
    blind: bool,
    jobs: int | None,
    dask: str | None,
) -> None:
    """What ``proofmass diet`` does; `proofmass.cli` says what it is given."""
    from proofmass.studies.diet.page import write_diet  # matplotlib is slow to load

    file = output or Path("diet") / model.name
    with answering("what was tried is kept"):
        if file.exists() and model.exists() and file.samefile(model):
            raise InputError(file, "--output", "is the model itself; give another file")
        if (table := file.with_suffix(".csv")).exists():
            read_entries(table)  # what is no table of a diet is not replaced by one
        scene = scene_of(model, seconds, tuple(dict.fromkeys(monitored or ())), error)
        with pool(jobs, dask) as workers, errors.status("starting") as status:
            found = DietSearch(
                scene,
                blind,
                tune=not keep_options,
                workers=workers,
                store=DietStore(file.parent / "runs"),
                progress=lambda what: status.update(what[:70]),
            ).run()
        finish(scene, found, file)
    for part in shown(found.table):
        console().print(part, markup=False)
    print()
    for path in (file, file.with_suffix(".csv"), write_diet(file.parent, file.parent).first):
        print(path)


def finish(scene: DietScene, found: Diet, file: Path) -> None:
    """Write the reduced model and the table, and try the model as it was written."""
    file.parent.mkdir(parents=True, exist_ok=True)
    half = file.with_name(f"{file.stem}.part.xml")
    try:
        write(found.reduced, half, dressed=True)
        written = read(half, found.reduced.rods)
        models = [
            written.compiled(found.reduced.segmented(w.run.rods)) for w in scene.monitored_runs
        ]
        search = DietSearch(scene)
        outcome, _, message = (search.judge_errors if found.tuned else search.judge_changes)(
            models, found.reduced
        )
        if outcome != "harmless":
            raise InputError(
                scene.edited.file,
                "",
                f"cannot be written with all its digits: its reduced model {message or outcome}",
            )
        write(found.reduced, half)
        half.replace(file)
    finally:
        half.unlink(missing_ok=True)
    write_entries(found.table, file.with_suffix(".csv"))


def shown(entries: Sequence[Entry]) -> Iterator[str | Table]:
    """What standard output shows: what to make of it, what could be run, and what is needed."""
    yield from (f"{text}\n" for text in sentences(entries))
    rows = Table(box=None, header_style="bold", pad_edge=False)
    for name in ("feature", "outcome", "time", "memory", "moves", "most of all"):
        rows.add_column(
            name,
            justify="right" if name in ("time", "memory", "moves") else "left",
            no_wrap=name not in ("feature", "most of all"),
            overflow="fold",
        )
    for entry in ranked(entries):
        if entry.outcome in GOES:
            rows.add_row(*cells(entry))
    if rows.row_count:
        yield rows
        yield (
            "\ntime and memory: saved; time in brackets: interval of the median with 99 %, none "
            "where 0 is within it; moves: largest change of a channel, or with another option "
            "its error, of what is allowed"
        )
    if needed := [e.title for e in ranked(entries) if e.outcome not in GOES]:
        yield f"\nWithout these it does not run: {'; '.join(needed)}"


def cells(entry: Entry) -> tuple[str, ...]:
    """A row of what is shown: time and memory as shares saved."""
    run, channel, share = entry.worst
    saved = ("–", "–")
    if entry.costs:
        saved = saving(entry), f"{entry.saved_memory:+.1f} KB"
    return (
        entry.title,
        GOES[entry.outcome],
        *saved,
        number(share, 2),
        f"{channel} in {run}" if share else "",
    )
