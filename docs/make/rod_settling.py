"""Equilibria that two engines settle into, from random shapes and from disturbed equilibria.

    python -m docs.make.rod_settling [folder] [--quick]

Writes docs/rod_settling.md.  Runs are kept one by one in the folder (reports), so that a call
continues where another was interrupted.  Two processes are used.
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
from docs.make.rod_settle import ENGINES, Scene, scene
from proofmass.analytic.rods.assembly import assembly, triangle
from proofmass.sim.protocol.failures import Diverged

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
CASES["2RFR, modes 1"] = *CASES["2RFR, Table 7"][:2], 1  # for --quick
RANDOM = {  # number of random starts by case, engine and links
    ("2RFR, Table 7", "mujoco", 20): 400,
    ("2RFR, Table 7", "mujoco", 10): 60,
    ("2RFR, Table 7", "pymunk", 10): 60,
    ("3RFR, Table 8", "mujoco", 20): 200,
    ("3PFR, annex", "mujoco", 20): 200,
}
NUDGES = 2  # number of disturbed starts of each equilibrium, in the same scenes
QUICK = {("2RFR, modes 1", "mujoco", 10): 1, ("2RFR, modes 1", "pymunk", 10): 1}
Task = tuple[str, str, int, str, int]
Row = dict[str, Any]
Starts = Mapping[tuple[str, str, int], int]


@cache
def built(case: str, links: int) -> Scene:
    """The scene of a case with `links` links in each rod."""
    a, given, modes = CASES[case]
    return scene(a, given, modes, links)


def tasks(starts: Starts, equilibria: int | None) -> list[Task]:
    """Tasks: case, engine, links, start (the number of an equilibrium or "random") and seed."""
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
    """The rest that an engine settles into from one start, as a row."""
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
    """The rows that earlier calls wrote."""
    return [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []


def document(rows: list[Row], starts: Starts) -> str:
    """The text of the page, made of the rows."""
    parts = [HEAD]
    for key in starts:
        own = [row for row in rows if tuple(row["task"][:3]) == key]
        if own:
            parts += [f"## {key[0]}: {key[1]}, {key[2]} links a rod\n", *table(key, own)]
    return "\n".join([*parts, agreement(rows, starts), ""])


def table(key: tuple[str, str, int], rows: list[Row]) -> list[str]:
    """The table of the equilibria with the starts that end in them, and a sentence on others."""
    s = built(key[0], key[2])
    loose = [row for row in rows if row["task"][3] == "random"]
    reached = Counter(row.get("to") for row in loose)
    lines = [
        "| equilibrium | modes | V [J] | unstable directions | reached | nudged |",
        "|---|---|---|---|---|---|",
    ]
    nudged: dict[int, list[Row]] = {}
    for row in rows:
        if row["task"][3] != "random":
            nudged.setdefault(int(row["task"][3]), []).append(row)
    for k in range(len(s.found)):
        ends = "; ".join(end_of_nudge(k, row) for row in nudged.get(k, []))
        lines.append(
            f"| {k + 1} | {', '.join(map(str, s.found.modes[k]))} | "
            f"{s.found.potential[k]:.6f} | {s.found.negative[k]} | "
            f"{reached[k] or ''} | {ends or 'no equilibrium of the chain'} |"
        )
    fallen = sum(row.get("least", 1.0) <= 0.0 for row in rows)
    off, failed = [row["off"] for row in rows if "off" in row], sum("failed" in row for row in rows)
    return [
        *lines,
        "",
        f"{len(loose)} random starts. {others(loose)}{fallen} of all {len(rows)} runs end "
        f"where the energy falls in some direction, and {failed} do not come to rest. The links "
        f"are within {np.median(off):.1g} rad of the chain's own equilibrium in the median, and "
        f"within {max(off):.1g} rad at most. CPU time {sum(row['cpu'] for row in rows):.0f} s.\n",
    ]


def others(loose: list[Row]) -> str:
    """A sentence on the random starts that end in none of the equilibria."""
    rows = [row for row in loose if row.get("to") == -1]
    if not rows:
        return ""
    return (
        f"{len(rows)} of them end in {len({tuple(row['pose']) for row in rows})} other poses, "
        f"which are stable for the chain; in each of them a joint is bent by "
        f"{min(row['bend'] for row in rows):.2g} rad or more, in a loop too tight for its links. "
    )


def end_of_nudge(k: int, row: Row) -> str:
    """Whether a run from disturbed equilibrium k stays there, or where it ends, in words."""
    to = row.get("to")
    return (
        "failed" if to is None else "stays" if to == k else f"to {to + 1}" if to >= 0 else "other"
    )


def agreement(rows: list[Row], starts: Starts) -> str:
    """The section on the number of starts from which both engines settle into the same rest."""
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
                    f"{case}, {links} links: both engines settle into the same rest from "
                    f"{same} of {len(some)} {word}."
                )
    return "\n".join(lines)


HEAD = """# Where engines settle

`python -m docs.make.rod_settling` made this page. The mechanisms are those of J. Pérez Gámiz,
Resolución del problema de posición de mecanismos ultraflexibles planos de cadena cerrada, TFG,
UPV/EHU Bilbao 2018. The tables have all equilibria that
`proofmass.analytic.rods.all_equilibria` finds with loads up to R = 400 EI/L^2, the lowest energy
first. Larger loads need loops that are too tight for these chains; two rods have no such
equilibria, three rods have more (`rod_solutions.md`).

*Reached* is the number of random starts of an engine that end in an equilibrium. In a random start
every rod is an arc that turns by up to a full turn, each joint is bent by a random angle of
0.25 rad (standard deviation) in addition, and the loops are closed with the least change. The
engine then steps, with damping, until nothing moves. *Nudged* is the end of two runs that start in
the chain's own equilibrium, with links rotated by random angles of 1e-3 rad (standard deviation).

In every table the runs that start near a stable equilibrium stay there, and no run ends in an
unstable one. Damping and inertia decide which of the stable equilibria a shape settles into, and
both are made up: MuJoCo's joints have the armature with which every spring swings equally fast, and
all of Chipmunk's links have the same moment of inertia. They hardly matter for shapes far from
rest, but they do at a saddle, where a very small difference decides. The equilibria of mode one
that Table 7 prints are numbers 4 and 10; an engine finds the natural one, number 1, most often.

There are no tables of pymunk with three rods, because its steps did not come to rest there in four
starts of 100,000 steps each.
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
