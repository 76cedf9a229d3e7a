"""What scenes need: the diet of all own models, without their options, and of a fat one.

    python -m benchmarks.diet [folder] [--quick]

Writes docs/diet.md and docs/diet.png.  Runs are kept in the folder (reports/diet), so that a call
goes on where another was interrupted.
"""

from collections.abc import Sequence
from pathlib import Path

from matplotlib import rc_context

from benchmarks import ROOT, command, folders
from proofmass.report.figures import save
from proofmass.report.style import RC
from proofmass.studies.diet.diet import ROUNDS, DietSearch, DietStore, finish
from proofmass.studies.diet.page import LOOKS, diet_figure, write_diet
from proofmass.studies.diet.scene import scene_of
from proofmass.studies.diet.table import SAID, WHOLE, Entry, ranked, read_entries, sentences
from proofmass.studies.measure import machine
from proofmass.studies.run import pool
from proofmass.wording import number

FAT = ROOT / "docs" / "fourbar_fat.xml"
SECONDS = 5.0  # that a model without a sidecar is followed
HEAD = """# What scenes need

`python -m benchmarks.diet` made this; `proofmass diet MODEL.xml` does it for any MJCF. Each feature
is taken out by itself, and every run is done again: those of the sidecars in MuJoCo, where a
channel may move by a tenth of what its error leaves of its tolerance, or else the motion from the
key, where it may move by rounding. What is harmless goes, all of it together. `--watch NAME`, with
a joint, body, site or sensor, says what alone matters; without it and without a sidecar all sensors
are monitored, or all that moves, and bodies that do not act on each other are named in groups.

Then options of the engine are made cheaper, one after the other: solver tolerance, iterations, time
step, integrator, friction cone, solver and Jacobian. These change every run, so what is measured is
held against what is true. With a sidecar that is its reference, whose error may grow by a tenth of
what it leaves of its tolerance. Without one it is the fine solution of the same model, with 8 times
shorter steps, of which a channel may be off by 1.1 times what it is with the options as they are;
`--error SHARE` allows so much of its range, `--keep-options` leaves all options alone. Where the
model leaves its fine solution by a tenth before the run ends, as after an impact, an option may
move a channel by no more than a feature may.

Times are of pairs of runs, with and without, in an order drawn by lot. What is saved is the median
of their ratios, and the interval in brackets holds it with a probability of 99 % (sign test, if the
noise of one pair does not depend on that of others). Where 0 is within there is no measurable
change. `tests/studies/diet/diet_bare.py` holds what was written against the model as it was in bare
MuJoCo.

## A fat model

[`fourbar_fat.xml`](fourbar_fat.xml) is a four-bar let go, and a nut that has come off it, with much
of what a scene collects over the years.

![What each feature of the fat model changes, and what its removal saves](diet.png)

*Left: the channel that moves most; right: what a step would save. Filled: goes; ring: drawn, kept
for the eye; cross: matters. The last row is all that goes, at once.*
"""
OWN = """## proofmass's own models

Of {all} models {clean} have no feature left to remove; their options were left alone, which
[`trade` and `choose`](accuracy.md) are for. Drawn geoms could go, for no run needs them, and stay
for the eye; what they cost together is the time and the memory of the table, on {machine}.
Steps of a sweep or an equilibrium run are its poses.
"""
COLUMNS = (
    "model",
    "features",
    "goes",
    "only drawn",
    "moves a channel",
    "needed to run",
    "ms a step",
    "without drawn",
    "KB",
    "without drawn",
)


def main(argv: Sequence[str] | None = None) -> None:
    parser = command(__doc__)
    parser.add_argument("folder", type=Path, nargs="?", default=ROOT / "reports" / "diet")
    given = parser.parse_args(argv)
    files = sorted(
        (ROOT / "models").rglob("pendulum.xml" if given.quick else "*.xml"),
        key=lambda file: file.name,
    )
    rounds = 1 if given.quick else ROUNDS  # pairs of runs
    with folders(given.quick, given.folder) as (folder, docs):
        own = {file.stem: searched(file, folder, rounds, tune=False) for file in files}
        fat = own[files[0].stem] if given.quick else searched(FAT, folder, rounds)
        write_diet(folder, folder)
        with rc_context(RC):
            save(diet_figure([e for e in ranked(fat) if e.outcome in LOOKS]), docs / "diet")
        (docs / "diet.svg").unlink()
        clean = sum(not named(entries, "harmless") for entries in own.values())
        lines = [
            HEAD,
            *sentences(fat),
            "",
            OWN.format(clean=clean, all=len(own), machine=machine()),
            f"| {' | '.join(COLUMNS)} |",
            f"|{'---|' * len(COLUMNS)}",
            *(row(name, entries) for name, entries in own.items()),
        ]
        (docs / "diet.md").write_text("\n".join(lines) + "\n", encoding="utf-8")


def searched(model: Path, folder: Path, rounds: int, tune: bool = True) -> list[Entry]:
    """The diet of a model, with its options or without; table and reduced model in the folder."""
    print(model.stem, flush=True)
    file = folder / model.name
    scene = scene_of(model, SECONDS)
    with pool() as workers:
        found = DietSearch(
            scene, rounds=rounds, tune=tune, workers=workers, store=DietStore(folder / "runs")
        ).run()
    finish(scene, found, file)
    return read_entries(file.with_suffix(".csv"))


def named(entries: Sequence[Entry], outcome: str) -> list[str]:
    """Features with an outcome."""
    return [e.title for e in entries if e.outcome == outcome and e.kind != WHOLE]


def row(name: str, entries: Sequence[Entry]) -> str:
    """A model's row of the table: features by outcome, and the cost of what is only drawn."""
    gone, drawn, matters = (named(entries, o) for o in ("harmless", "drawn", "matters"))
    single = sum(e.kind not in (WHOLE, SAID) for e in entries)
    needed = single - len(gone) - len(drawn) - len(matters)
    costs = next((e.costs for e in entries if e.outcome == "drawn"), entries[-1].costs)
    cells = [number(1e3 * c.seconds, 2) for c in costs] + [number(c.size / 1024) for c in costs]
    geoms = sum(name.count(",") + 1 for name in drawn)
    told = [f"{geoms} geom{'s' * (geoms > 1)}" if geoms else "nothing", len(matters), needed]
    return (
        "| "
        + " | ".join(map(str, (name, single, "; ".join(gone) or "nothing", *told, *cells)))
        + " |"
    )


if __name__ == "__main__":
    main()
