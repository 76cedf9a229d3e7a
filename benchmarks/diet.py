"""The diet of all own models, without their options, and of a model with needless features.

    python -m benchmarks.diet [folder] [--quick]

Writes docs/diet.md and docs/diet.png.  Runs are kept in the folder (reports/diet), so that a call
continues where another was interrupted.
"""

from collections.abc import Sequence
from pathlib import Path

from matplotlib import rc_context

from benchmarks import ROOT, command, folders
from proofmass.base.wording import number
from proofmass.report.figures import save
from proofmass.report.style import RC
from proofmass.studies.diet.diet import TIMING_ROUNDS, DietSearch, write_result
from proofmass.studies.diet.page import OUTCOME_LOOKS, diet_figure, write_diet
from proofmass.studies.diet.scene import load_scene
from proofmass.studies.diet.table import (
    SENTENCE_KIND,
    WHOLE_KIND,
    Entry,
    read_entries,
    sort_entries,
    summary_sentences,
)
from proofmass.studies.measure import describe_machine
from proofmass.studies.store import Store
from proofmass.studies.study import Study

FAT = ROOT / "docs" / "fourbar_fat.xml"
SECONDS = 5.0  # simulated time of a model without a sidecar
HEAD = """# What scenes need

`python -m benchmarks.diet` made this page; `proofmass diet MODEL.xml` does the same for any MJCF.
Each feature of a model is removed by itself, and every run is repeated. With a sidecar these are
its runs in MuJoCo, and the removal may change a channel by a tenth of the difference between its
tolerance and its error. Without a sidecar it is the motion from the key, and the removal may change
a channel by rounding only. All harmless features are then removed together. `--watch NAME`, with a
joint, body, site or sensor, names what alone matters. Without it and without a sidecar all sensors
are monitored, or everything that moves, and bodies that do not act on each other are listed in
groups.

Then options of the engine are made cheaper, one after the other: solver tolerance, iterations, time
step, integrator, friction cone, solver and Jacobian. These options change every run, so that its
error is measured against a reference. With a sidecar this is its reference, and the error may grow
by a tenth of the difference between the tolerance and the error. Without a sidecar it is the fine
solution of the same model, with 8 times shorter steps, and the error of a channel may be 1.1 times
the error with the options as they are; `--error SHARE` allows an error of this share of the
channel's range instead. `--keep-options` leaves all options alone. If the motion of the model
differs from its fine solution by a tenth before the run ends, as after an impact, an option may
change a channel by no more than the removal of a feature may.

Times are those of the steps alone, without the preparation of a run, which takes as long as a
hundred steps. They are measured in pairs of runs, with and without a feature, in random order. The
saving is the median of the ratios of their times, and the interval in brackets contains it with a
probability of 99 % (sign test, if the noise of one pair does not depend on that of others). If the
interval contains 0, there is no measurable change. `tests/studies/diet/diet_bare.py` compares the
written model with the original one in bare MuJoCo.

## A model with needless features

[`fourbar_fat.xml`](fourbar_fat.xml) is a four-bar that is released and a nut that has come off it,
with many features of the kinds that a scene collects over the years.

![What each feature of the fat model changes, and what its removal saves](diet.png)

*Left: the largest change of a channel; right: the time that a step would save. A filled marker is a
feature that is removed, a ring one that is only drawn and kept for the viewer, a cross one that
matters. The last row is the removal of all harmless features at once.*
"""
OWN = """## proofmass's own models

Of {all} models {clean} have no feature left to remove. Their options were left alone, because
[`trade` and `choose`](accuracy.md) find them. No run needs the drawn geoms; they are kept for the
viewer, and the table has the time and the memory with and without them, on {machine}.
The steps of a sweep or an equilibrium run are its poses.
"""
COLUMNS = (
    "model",
    "features",
    "harmless",
    "only drawn",
    "change a channel",
    "needed to run",
    "ms per step",
    "ms without drawn",
    "KB",
    "KB without drawn",
)


def main(argv: Sequence[str] | None = None) -> None:
    parser = command(__doc__)
    parser.add_argument("folder", type=Path, nargs="?", default=ROOT / "reports" / "diet")
    given = parser.parse_args(argv)
    files = sorted(
        (ROOT / "models").rglob("pendulum.xml" if given.quick else "*.xml"),
        key=lambda file: file.name,
    )
    rounds = 1 if given.quick else TIMING_ROUNDS  # number of pairs of runs
    with folders(given.quick, given.folder) as (folder, docs):
        own = {file.stem: searched(file, folder, rounds, tune=False) for file in files}
        fat = own[files[0].stem] if given.quick else searched(FAT, folder, rounds)
        write_diet(folder, folder)
        with rc_context(RC):
            save(
                diet_figure([e for e in sort_entries(fat) if e.outcome in OUTCOME_LOOKS]),
                docs / "diet",
            )
        (docs / "diet.svg").unlink()
        clean = sum(not titles(entries, "harmless") for entries in own.values())
        lines = [
            HEAD,
            *summary_sentences(fat),
            "",
            OWN.format(clean=clean, all=len(own), machine=describe_machine()),
            f"| {' | '.join(COLUMNS)} |",
            f"|{'---|' * len(COLUMNS)}",
            *(row(name, entries) for name, entries in own.items()),
        ]
        (docs / "diet.md").write_text("\n".join(lines) + "\n", encoding="utf-8")


def searched(model: Path, folder: Path, rounds: int, tune: bool = True) -> list[Entry]:
    """The diet of a model, with its options or without; writes table and reduced model."""
    print(model.stem, flush=True)
    file = folder / model.name
    scene = load_scene(model, SECONDS)
    study = Study(Store(folder / "runs"))
    found = DietSearch(scene, study, rounds=rounds, tune=tune).run()
    write_result(scene, study, found, file)
    return read_entries(file.with_suffix(".csv"))


def titles(entries: Sequence[Entry], outcome: str) -> list[str]:
    """Titles of the features with an outcome."""
    return [e.title for e in entries if e.outcome == outcome and e.kind != WHOLE_KIND]


def row(name: str, entries: Sequence[Entry]) -> str:
    """A model's row of the table: features by outcome, and the cost of what is only drawn."""
    gone, drawn, matters = (titles(entries, o) for o in ("harmless", "drawn", "matters"))
    single = sum(e.kind not in (WHOLE_KIND, SENTENCE_KIND) for e in entries)
    needed = single - len(gone) - len(drawn) - len(matters)
    costs = next((e.costs for e in entries if e.outcome == "drawn"), entries[-1].costs)
    cells = [number(1e3 * c.seconds, 2) for c in costs] + [number(c.size / 1024) for c in costs]
    geoms = sum(name.count(",") + 1 for name in drawn)
    counts = [f"{geoms} geom{'s' * (geoms > 1)}" if geoms else "nothing", len(matters), needed]
    return (
        "| "
        + " | ".join(map(str, (name, single, "; ".join(gone) or "nothing", *counts, *cells)))
        + " |"
    )


if __name__ == "__main__":
    main()
