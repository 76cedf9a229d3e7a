"""All 112 balancers of van Nes 2022, designed again, and the 56 that its tables have a dash for.

    python -m benchmarks.design_balancer [ROW ...] [--effort 1] [--jobs 2] [--states FOLDER]
    python -m benchmarks.design_balancer --redraw
    python -m benchmarks.design_balancer --quick

A ROW is a line of the thesis's text, "left-out" for all dashes, or the words of one of these, such
as "laevo 3 nonlinear contact".

Prints a row a variant: the thesis's figures as printed, those of its parameters recomputed exactly,
and ours; puts them into docs/balancer_designs.json and writes the .md and .png beside it from that.
With --redraw it designs nothing and writes these two again.
"""

import json
import os
import time
from argparse import Namespace
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import ROOT, command, folders
from benchmarks.design_table import HELD, Row, draw, missed, page, summary, table
from proofmass.analytic.balancer import solve
from proofmass.analytic.balancer.measures import TARGETS, precision_points, rmse, work_reduction
from proofmass.analytic.balancer.synthesis import POINTS, Synthesis, Variant, left_out
from proofmass.analytic.numerics import Array
from proofmass.design.command import times
from proofmass.design.search import Effort, SavedSearch

THESIS = ROOT / "tests" / "data" / "balancer.json"
TABLE = ROOT / "docs" / "balancer_designs.json"
OURS = ("ours", "short", "parameters")
KEY = ("target", "segments", "variant", "option")
UNUSED = {"rest_angle": 0.0, "high2": np.pi}  # options that a design does without
# Elbow up or down, power of the error in the aim, times the effort, 0 to go on from what was found
# last; until nothing is missed.
ATTEMPTS = (
    (1, 2.0, 1.0),
    (1, 1.9, 0.0),
    (1, 1.5, 0.0),
    (-1, 2.0, 2.0),
    (-1, 1.5, 0.0),
    (-1, 2.0, 3.0),
)
AGAIN = Effort(((96, 10), (32, 60)))


def variant_of(row: Row) -> Variant:
    """What is free to choose in a row."""
    kind, option = row["variant"], row["option"]
    return Variant(
        row["target"],
        row["segments"],
        "nonlinear" if "nonlinear" in kind else "linear",
        "preload" in kind,
        "rest angle" in option,
        "contact" in option,
        "relaxed" in option,
    )


def dashes() -> list[Row]:
    """The rows that the thesis has a dash for."""
    return [
        {
            "line": None,
            "figure": "",
            "segments": v.segments,
            "target": v.target,
            "variant": " ".join(
                [*["nonlinear"] * (v.springs == "nonlinear"), *["preload"] * v.preload]
            )
            or "regular",
            "option": v.option,
        }
        for v in left_out()
    ]


def key(row: Row) -> tuple[str, int, str, str]:
    """What tells a row from any other."""
    return row["target"], row["segments"], row["variant"], row["option"]


def narrower(row: Row, known: dict[tuple[str, int, str, str], Row]) -> Row | None:
    """The best of our designs with an option less: what the row's own must not be worse than."""
    option = row["option"]
    fewer = option.split(" and ") if " and " in option else ["standard"]
    found = [known[place] for word in fewer if (place := key(row | {"option": word})) in known]
    return min(found, key=lambda other: other["ours"]["rmse"], default=None)


def exact(row: Row) -> tuple[float, float, str]:
    """Error and work reduction of the thesis's own parameters on the path from rest, or why not."""
    angle = precision_points(POINTS[row["segments"]])
    wanted = TARGETS[row["target"]](angle)
    try:
        moment = solve(angle, **row["parameters"])["balancing_moment"]
    except ValueError as error:
        return np.nan, np.nan, str(error)
    return float(rmse(moment, wanted)), float(work_reduction(moment, wanted, angle)), ""


def designed(row: Row, effort: float, states: Path | None, less: Row | None) -> Row:
    """A row: the thesis's figures, or those of our design with an option less, beside ours."""
    found, start = {k: row[k] for k in ("line", "figure", *KEY)}, dict[int, Array]()
    if row["line"]:
        error, reduction, why = exact(row)
        found["printed"] = {k: row["printed"][k] for k in ("rmse", "work_reduction")}
        found["recomputed"] = {"why": why} if why else {"rmse": error, "work_reduction": reduction}
    elif less:
        found["narrower"] = {k: less["ours"][k] for k in ("rmse", "work_reduction")}
        mode = int(less["parameters"].get("mode", 1))
        start[mode] = variant_of(row).vector({**UNUSED, **less["parameters"]})[None]
    began, used = time.perf_counter(), time.process_time()
    for mode, power, more in ATTEMPTS:
        if power < 2.0 and any(word.startswith("rmse") for word in missed(found)):
            continue  # it trades error for work reduction
        task = Synthesis(replace(variant_of(row), mode=mode), TARGETS[row["target"]], power=power)
        name = "_".join(map(str, (*key(row), mode, power, more))).replace(" ", "-")
        search = SavedSearch(
            task,
            times(effort * more, 1) if more else AGAIN,
            states / f"{name}.npz" if states else None,
            start.get(mode),
        )
        search.run()
        start[mode] = search.found
        found |= min(
            ({k: found[k] for k in OURS if k in found}, best(task, found, search.found)),
            key=lambda ours: ours.get("short", np.inf),
        )
        if not missed(found):
            break
    del found["short"]
    return found | {
        "seconds": round(time.perf_counter() - began, 1),
        "cpu_seconds": round(time.process_time() - used, 1),
    }


def best(task: Synthesis, row: Row, vectors: Array) -> Row:
    """The design of least error, or that which comes nearest to being better in all figures."""
    figures = task.figures(vectors)
    theirs = [row[k] for k in HELD if k in row and "why" not in row[k]]
    aims = np.stack([figures.rmse, 100.0 - figures.work_reduction])
    bars = [
        min((t["rmse"] for t in theirs), default=np.inf),
        100.0 - max((t["work_reduction"] for t in theirs), default=-np.inf),
    ]
    share = (aims.T / bars).max(axis=-1)
    short = np.where(np.isfinite(share), np.maximum(1.0, share), np.inf)
    k = np.lexsort((figures.rmse, short))[0]
    return {
        "ours": {
            "rmse": float(figures.rmse[k]),
            "spread": float(figures.spread[k]),
            "work_reduction": float(figures.work_reduction[k]),
        },
        "short": float(short[k]),
        "parameters": {
            n: float(v[0]) for n, v in task.variant.parameters(vectors[k][None]).items()
        },
    }


def main(argv: Sequence[str] | None = None) -> None:
    """Design the rows asked for, or all, and write what is then known of all."""
    parser = command(__doc__)
    parser.add_argument("rows", nargs="*")
    parser.add_argument("--effort", type=float, default=1.0)
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    parser.add_argument("--states", type=Path)
    parser.add_argument("--redraw", action="store_true")
    given = parser.parse_args(argv)
    if given.quick:
        given.rows, given.effort, given.jobs = ["1743"], 0.01, 1
    thesis = json.loads(THESIS.read_text())["rows"]
    if given.states:
        given.states.mkdir(parents=True, exist_ok=True)
    rows = [{**row, "line": int(line)} for line, row in thesis.items()] + dashes()
    known = {key(row): row for row in json.loads(TABLE.read_text())}
    for part in (rows[: len(thesis)], rows[len(thesis) :]):  # the dashes begin where others end
        chosen = [
            row
            for row in part
            if not given.redraw
            and (
                not given.rows
                or {str(row["line"] or "left-out"), " ".join(map(str, key(row)))} & set(given.rows)
            )
        ]
        known |= run(chosen, known, given)
    found = [known[key(row)] for row in rows if key(row) in known]
    print(summary(found))
    with folders(given.quick, Path()) as (_, docs):
        (docs / TABLE.name).write_text(json.dumps(found, indent=1) + "\n")
        (docs / TABLE.name).with_suffix(".md").write_text(page(found))
        draw(found[: len(thesis)], thesis).savefig((docs / TABLE.name).with_suffix(".png"), dpi=130)


def run(rows: list[Row], known: dict[Any, Row], given: Namespace) -> dict[Any, Row]:
    """Design rows side by side; print and return them."""
    os.environ["OMP_NUM_THREADS"] = "1"  # a process a row; its threads would wait for the others'
    found = {}
    with ProcessPoolExecutor(given.jobs, get_context("spawn")) as pool:
        futures = [
            pool.submit(designed, row, given.effort, given.states, narrower(row, known))
            for row in rows
        ]
        for row, future in zip(rows, futures, strict=True):
            found[key(row)] = future.result()
            print(list(table([found[key(row)]]))[-1], flush=True)
    return found


if __name__ == "__main__":
    main()
