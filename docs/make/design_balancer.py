"""Designs for all 112 balancers of van Nes 2022, and for the 56 + 40 that it has a dash for.

    python -m docs.make.design_balancer [ROW ...] [--effort 1] [--jobs 2] [--states FOLDER]
    python -m docs.make.design_balancer --redraw
    python -m docs.make.design_balancer --quick

A ROW is a line of the thesis's text, "left-out" for the 56 dashes of its tables M.1 to M.5,
"spring-3" for the 40 of its figures, whose preload is that of spring 3, or the words of one of
these, such as "laevo 3 nonlinear contact".

Prints a row for each variant: the thesis's figures as printed, those of its parameters recomputed
exactly, and ours.  Writes the rows into docs/balancer_designs.json, and from this file the .md and
.png of the same name.  With --redraw only the .md and .png are written again.
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
from docs.make.design_table import (
    DIGITS,
    KEY,
    Row,
    draw,
    draw_systems,
    page,
    summary,
    table,
    worse_figures,
)
from proofmass.analytic.balancer import solve
from proofmass.analytic.balancer.measures import TARGETS, precision_points, rmse, work_reduction
from proofmass.analytic.balancer.synthesis import (
    THESIS_FIGURES,
    THESIS_POINTS,
    Synthesis,
    Variant,
    thesis_variants,
    variants_of,
)
from proofmass.base.arrays import Array
from proofmass.commands.design import scale_effort
from proofmass.design.search import Effort, SavedSearch

THESIS = ROOT / "tests" / "data" / "balancer.json"
TABLE = ROOT / "docs" / "balancer_designs.json"
OURS = ("ours", "short", "parameters")
WITHOUT = {"preload 3": "regular", "nonlinear preload 3": "nonlinear"}
UNUSED = {"rest_angle": 0.0, "high2": np.pi, "preload3": 0.0}  # values of options that are off
Attempt = tuple[int, float, float, dict[str, tuple[float, float]]]
# Elbow up (1) or down (-1), power of the error in the objective, factor of the effort (0 continues
# from the last result), and narrower bounds.  Attempts are made until no figure is worse.
ATTEMPTS: tuple[Attempt, ...] = (
    (1, 2.0, 1.0, {}),
    (1, 1.9, 0.0, {}),
    (1, 1.5, 0.0, {}),
    (-1, 2.0, 2.0, {}),
    (-1, 1.5, 0.0, {}),
    (-1, 2.0, 3.0, {}),
)
SIGNS: tuple[dict[str, tuple[float, float]], ...] = ({}, {"preload3": (-1.0, 0.0)})
"""Narrower bounds of a preload of spring 3 where both signs can release it."""
SHORT_EFFORT = Effort(((96, 10), (32, 60)))


def variants_without_balancer() -> list[Variant]:
    """The 56 variants that have a cell in tables M.1 to M.5 of van Nes 2022, but no balancer."""
    targets, options = (list(dict.fromkeys(words)) for words in zip(*THESIS_FIGURES, strict=True))
    return [
        variant
        for target in targets
        for option in options
        if (target, option) not in THESIS_FIGURES
        for variant in variants_of(target, option)
    ]


def third_preload_variants() -> list[Variant]:
    """The 40 variants whose row "3 Seg.: prestress spring 3" in the figures has only a dash."""
    return [replace(v, preload=(3,)) for v in thesis_variants() if v.segments == 3 and v.preload]


def variant_of(row: Row) -> Variant:
    """The variant of a row: what its design may choose."""
    kind, option = row["variant"], row["option"]
    return Variant(
        row["target"],
        row["segments"],
        "nonlinear" if "nonlinear" in kind else "linear",
        preloaded(kind, row["segments"]),
        "rest angle" in option,
        "contact" in option,
        "relaxed" in option,
    )


def preloaded(kind: str, segments: int) -> tuple[int, ...]:
    """The preloaded joints that the words of a row name."""
    return (3,) if kind.endswith("3") else tuple(range(2, segments)) if "preload" in kind else ()


def dashes() -> list[Row]:
    """The rows for which the thesis has a dash."""
    return [
        {
            "line": None,
            "figure": v.figure if v.preload == (3,) else "",
            "segments": v.segments,
            "target": v.target,
            "variant": " ".join(
                [
                    *["nonlinear"] * (v.springs == "nonlinear"),
                    *["preload"] * bool(v.preload),
                    *["3"] * (v.preload == (3,)),
                ]
            )
            or "regular",
            "option": v.option,
        }
        for v in (*variants_without_balancer(), *third_preload_variants())
    ]


def key(row: Row) -> tuple[str, int, str, str]:
    """The identity of a row: target, segments, variant and option."""
    return row["target"], row["segments"], row["variant"], row["option"]


def narrower(row: Row, known: dict[tuple[str, int, str, str], Row]) -> Row | None:
    """The best of our designs with one option less, which the design of the row must equal.

    For a preload of spring 3 it is the design without a preload.
    """
    option = row["option"]
    if row["variant"].endswith("3"):
        return known.get(key(row | {"variant": WITHOUT[row["variant"]]}))
    fewer = option.split(" and ") if " and " in option else ["standard"]
    found = [known[place] for word in fewer if (place := key(row | {"option": word})) in known]
    return min(found, key=lambda other: other["ours"]["rmse"], default=None)


def exact(row: Row) -> tuple[float, float, str]:
    """Error and work reduction of the thesis's parameters on the path from rest, or why none."""
    angle = precision_points(THESIS_POINTS[row["segments"]])
    wanted = TARGETS[row["target"]](angle)
    try:
        moment = solve(angle, **row["parameters"])["balancing_moment"]
    except ValueError as error:
        return np.nan, np.nan, str(error)
    return float(rmse(moment, wanted)), float(work_reduction(moment, wanted, angle)), ""


def design(row: Row, effort: float, states: Path | None, less: Row | None) -> Row:
    """A row with our figures and the thesis's, or those of our design with one option less."""
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
    attempts: Sequence[Attempt] = ATTEMPTS
    if third := row["variant"].endswith("3"):
        modes = {1, *start}
        signs = SIGNS if "rest" in row["option"] else SIGNS[:1]
        attempts = [(mode, 2.0, 1.0, sign) for mode in sorted(modes)[::-1] for sign in signs]
    for mode, power, more, narrowed in attempts:
        if power < 2.0 and any(word.startswith("rmse") for word in worse_figures(found)):
            continue  # this attempt has more error for more work reduction
        variant = replace(variant_of(row), mode=mode, narrowed=narrowed)
        task = Synthesis(variant, TARGETS[row["target"]], power=power)
        name = "_".join(map(str, (*key(row), mode, power, more, *narrowed))).replace(" ", "-")
        search = SavedSearch(
            task,
            scale_effort(effort * more, 1) if more else SHORT_EFFORT,
            states / f"{name}.npz" if states else None,
            start.get(mode),
        )
        search.run()
        start[mode] = search.found
        found |= min(
            ({k: found[k] for k in OURS if k in found}, best(task, found, search.found)),
            key=lambda it: (it["short"], it["ours"]["rmse"]) if it else (np.inf, np.inf),
        )
        if not worse_figures(found) and not third:
            break
    del found["short"]
    return found | {
        "seconds": round(time.perf_counter() - began, 1),
        "cpu_seconds": round(time.process_time() - used, 1),
    }


def best(task: Synthesis, row: Row, vectors: Array) -> Row:
    """The design of least error, or the one that is nearest to being better in all figures."""
    figures = task.figures(vectors)
    theirs = [row[k] for k in DIGITS if k in row and "why" not in row[k]]
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
    third = len(rows) - len(third_preload_variants())
    # The designs of the dashes start from designs of the rows before them.
    for part in (rows[: len(thesis)], rows[len(thesis) : third], rows[third:]):
        chosen = [
            row
            for row in part
            if not given.redraw
            and (not given.rows or {row_group(row), " ".join(map(str, key(row)))} & set(given.rows))
        ]
        known |= run(chosen, known, given)
    found = [known[key(row)] for row in rows if key(row) in known]
    print(summary(found))
    with folders(given.quick, Path()) as (_, docs):
        (docs / TABLE.name).write_text(json.dumps(found, indent=1) + "\n")
        (docs / TABLE.name).with_suffix(".md").write_text(page(found))
        draw(found[: len(thesis)], thesis).savefig((docs / TABLE.name).with_suffix(".png"), dpi=130)
        for n in (3, 4):
            draw_systems(found, n).savefig(docs / f"{TABLE.stem}_{n}.png", dpi=130)


def row_group(row: Row) -> str:
    """The line of the thesis's text, or the group of dashes to which the row belongs."""
    return str(row["line"] or ("spring-3" if row["variant"].endswith("3") else "left-out"))


def run(rows: list[Row], known: dict[Any, Row], given: Namespace) -> dict[Any, Row]:
    """Design rows in parallel processes; print and return them."""
    os.environ["OMP_NUM_THREADS"] = "1"  # one process per row: threads would only wait
    found = {}
    with ProcessPoolExecutor(given.jobs, get_context("spawn")) as pool:
        futures = [
            pool.submit(design, row, given.effort, given.states, narrower(row, known))
            for row in rows
        ]
        for row, future in zip(rows, futures, strict=True):
            found[key(row)] = future.result()
            print(list(table([found[key(row)]]))[-1], flush=True)
    return found


if __name__ == "__main__":
    main()
