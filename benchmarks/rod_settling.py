"""Into which equilibria two engines settle, from random shapes and from nudged equilibria.

    python -m benchmarks.rod_settling [folder] [--quick]

Writes docs/rod_settling.md.  Runs are kept one by one in the folder (reports), so that a call goes
on where another was interrupted.  Two processes.
"""

import json
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from functools import cache
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import ROOT, command, folders
from benchmarks.rod_settle import ENGINES, Scene, scene
from proofmass.analytic.rods.assembly import assembly, triangle
from proofmass.sim.protocol import Diverged

EI = 0.05218602640386952  # N m^2, steel wire of 1.5 mm
CORNERS, GUIDES = triangle(np.sqrt(3.0)), np.radians([0.0, 120.0, -120.0])
CASES: dict[str, tuple[Any, dict[str, Any], int]] = {
    "2RFR, Table 7": (
        assembly([[-0.3, 0.0], [0.3, 0.0]], stiffness=EI),
        {"inputs": np.radians([40.0, 60.0]), "load": [0.3, -0.1]},
        3,
    ),
    "3RFR, Table 8": (
        assembly(CORNERS, stiffness=EI, arm=triangle(0.2)),
        {"inputs": np.radians([45.0, 180.0, -60.0]), "load": [0.0, 0.5, 0.0]},
        2,
    ),
    "3PFR, annex": (
        assembly(CORNERS, stiffness=EI, arm=triangle(0.5), angle=GUIDES, guide=GUIDES),
        {"inputs": 0.1, "load": [0.3, -0.2, 0.0]},
        1,
    ),
}
CASES["2RFR, modes 1"] = *CASES["2RFR, Table 7"][:2], 1  # of --quick
RANDOM = {  # case, engine, links: random starts
    ("2RFR, Table 7", "mujoco", 20): 400,
    ("2RFR, Table 7", "mujoco", 10): 60,
    ("2RFR, Table 7", "pymunk", 10): 60,
    ("3RFR, Table 8", "mujoco", 20): 200,
    ("3PFR, annex", "mujoco", 20): 200,
}
NUDGES = 2  # of each equilibrium, in the same scenes
QUICK = {("2RFR, modes 1", "mujoco", 10): 1, ("2RFR, modes 1", "pymunk", 10): 1}
Task = tuple[str, str, int, str, int]
Row = dict[str, Any]
Starts = Mapping[tuple[str, str, int], int]


@cache
def built(case: str, links: int) -> Scene:
    """A problem in chains of so many links."""
    a, given, modes = CASES[case]
    return scene(a, given, modes, links)


def tasks(starts: Starts, equilibria: int | None) -> list[Task]:
    """Case, engine, links, which start (an equilibrium's number or "random"), and its seed."""
    some = [(*key, "random", seed) for key, count in starts.items() for seed in range(count)]
    for case, engine, links in starts:
        some += [
            (case, engine, links, str(k), seed)
            for k in range(len(built(case, links).found))[:equilibria]
            for seed in range(NUDGES)
            if not np.isnan(built(case, links).standing.energy[k])
        ]
    return some


def run(task: Task) -> Row:
    """Settle from one start."""
    case, engine, links, start, seed = task
    began, s, row = time.process_time(), built(case, links), {"task": list(task)}
    try:
        qpos = s.random(seed) if start == "random" else s.nudged(int(start), seed)
        angles = ENGINES[engine](s, qpos)
        k, own, off = s.which(angles)
        row |= {
            "to": k,
            "potential": float(own.potential),
            "off": off,
            "least": float(own.curvatures[0]),
            "pose": own.pose.round(4).tolist(),
            "bend": float(np.abs(np.diff(own.angle, axis=-1)).max()),
        }
    except Diverged as error:
        row |= {"failed": str(error)}
    return row | {"cpu": time.process_time() - began}


def kept(file: Path) -> list[Row]:
    """Rows of earlier calls."""
    return [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []


def document(rows: list[Row], starts: Starts) -> str:
    """The page that the rows make."""
    parts = [HEAD]
    for key in starts:
        own = [row for row in rows if tuple(row["task"][:3]) == key]
        if own:
            parts += [f"## {key[0]}: {key[1]}, {key[2]} links a rod\n", *table(key, own)]
    return "\n".join([*parts, agreement(rows, starts), ""])


def table(key: tuple[str, str, int], rows: list[Row]) -> list[str]:
    """Equilibria with what reached and what left them, and a sentence on the rest."""
    s = built(key[0], key[2])
    loose = [row for row in rows if row["task"][3] == "random"]
    reached = Counter(row.get("to") for row in loose)
    lines = [
        "| equilibrium | modes | V [J] | directions down | reached | nudged |",
        "|---|---|---|---|---|---|",
    ]
    nudged: dict[int, list[Row]] = {}
    for row in rows:
        if row["task"][3] != "random":
            nudged.setdefault(int(row["task"][3]), []).append(row)
    for k in range(len(s.found)):
        ways = "; ".join(whither(k, row) for row in nudged.get(k, [])) or "no chain stands there"
        lines.append(
            f"| {k + 1} | {', '.join(map(str, s.found.modes[k]))} | "
            f"{s.found.potential[k]:.6f} | {s.found.negative[k]} | "
            f"{reached[k] or ''} | {ways} |"
        )
    fallen = sum(row.get("least", 1.0) <= 0.0 for row in rows)
    off, failed = [row["off"] for row in rows if "off" in row], sum("failed" in row for row in rows)
    return [
        *lines,
        "",
        f"{len(loose)} random starts. {others(loose)}{fallen} of all {len(rows)} "
        f"runs end where energy falls in some direction, {failed} do not come to rest. In the "
        f"median links are within {np.median(off):.1g} rad of the chain's own equilibrium, "
        f"{max(off):.1g} at most. CPU {sum(row['cpu'] for row in rows):.0f} s.\n",
    ]


def others(loose: list[Row]) -> str:
    """A sentence on those that end in none of the equilibria."""
    rows = [row for row in loose if row.get("to") == -1]
    if not rows:
        return ""
    return (
        f"{len(rows)} of them end in {len({tuple(row['pose']) for row in rows})} other places, "
        f"stable for the chain; in each of them a joint is bent by "
        f"{min(row['bend'] for row in rows):.2g} rad or more, a loop too tight for its links. "
    )


def whither(k: int, row: Row) -> str:
    """Where a nudged equilibrium goes."""
    to = row.get("to")
    return (
        "failed" if to is None else "stays" if to == k else f"to {to + 1}" if to >= 0 else "other"
    )


def agreement(rows: list[Row], starts: Starts) -> str:
    """From how many of the same starts both engines go to the same rest."""
    lines = ["## The same starts in both engines\n"]
    for case, links in dict.fromkeys((key[0], key[2]) for key in starts if key[1] == "pymunk"):
        ends: dict[str, dict[tuple[str, int], Any]] = {}
        for row in rows:
            if row["task"][0] == case and row["task"][2] == links and "to" in row:
                here = tuple(row["pose"]) if row["to"] < 0 else row["to"]
                ends.setdefault(row["task"][1], {})[row["task"][3], row["task"][4]] = here
        if len(ends) == 2:
            both = ends["mujoco"].keys() & ends["pymunk"].keys()
            for word, some in (
                ("random shapes", [t for t in both if t[0] == "random"]),
                ("nudges", [t for t in both if t[0] != "random"]),
            ):
                same = sum(ends["mujoco"][t] == ends["pymunk"][t] for t in some)
                lines.append(
                    f"{case}, {links} links: the same rest from {same} of {len(some)} {word}."
                )
    return "\n".join(lines)


HEAD = """# Where engines settle

`python -m benchmarks.rod_settling` made this. The mechanisms of J. Pérez Gámiz, Resolución del
problema de posición de mecanismos ultraflexibles planos de cadena cerrada, TFG, UPV/EHU Bilbao
2018: all equilibria that `proofmass.analytic.rods.all_equilibria` finds with loads up to R = 400
EI/L^2, the lowest first, and how many of the random starts of an engine end in each. Larger loads
take loops tighter than these chains can be bent; two rods have none, three have more
(`rod_solutions.md`). A start turns every rod by up to a full turn in an arc, bends each joint by
0.25 rad more (standard deviation), and closes the loops with the least change. The engine then
steps, with damping, until nothing moves. Nudged: begun in the chain's own equilibrium with links
turned by 1e-3 rad (standard deviation), twice.

In every table what begins beside a stable equilibrium stays, and nothing ends in an unstable one.
Which of the stable ones a shape comes to depends on damping and inertia, which are made up:
MuJoCo's joints have the armature with which every spring swings equally fast, Chipmunk's links have
one moment of inertia. From shapes far from rest that hardly matters; at a saddle, where a hair's
breadth decides, it does. The equilibria of mode one that Table 7 prints are numbers 4 and 10: an
engine finds the natural one, number 1, most often.

Chipmunk is left out with three rods: its steps did not come to rest there, in four starts of
100,000 steps each.
"""


def main(argv: Sequence[str] | None = None) -> None:
    parser = command(__doc__)
    parser.add_argument("folder", type=Path, nargs="?", default=ROOT / "reports")
    given = parser.parse_args(argv)
    starts, equilibria = (QUICK, 1) if given.quick else (RANDOM, None)
    with folders(given.quick, given.folder) as (folder, docs):
        file = folder / "rod_settling.jsonl"
        rows = kept(file)
        done = {tuple(row["task"]) for row in rows}
        left = [task for task in tasks(starts, equilibria) if task not in done]
        file.parent.mkdir(exist_ok=True)
        try:
            with get_context("fork").Pool(2) as pool, file.open("a") as out:
                for row in pool.imap_unordered(run, left):
                    rows.append(row)
                    print(json.dumps(row), file=out, flush=True)
        finally:
            (docs / "rod_settling.md").write_text(document(rows, starts))


if __name__ == "__main__":
    main()
