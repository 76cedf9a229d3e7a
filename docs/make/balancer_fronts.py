"""Pareto fronts of error and energy spread of balancers, compared with figure 7 of van Nes 2022.

    python -m docs.make.balancer_fronts [SYSTEM ...] [--jobs 1] [--states FOLDER]
    python -m docs.make.balancer_fronts --redraw
    python -m docs.make.balancer_fronts --quick

A SYSTEM is a name of the table below, such as "nonlinear preload"; without one all are searched.
Writes docs/balancer_fronts.json, and from this file the .md and .png of the same name.  With
--redraw only the .md and .png are written again.
"""

import json
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure
from numpy.typing import NDArray

from benchmarks import ROOT, command, folders
from proofmass.analytic.balancer import solve
from proofmass.analytic.balancer.measures import TARGETS, energy_spread, precision_points, rmse
from proofmass.analytic.balancer.synthesis import Synthesis, Variant
from proofmass.base.arrays import Array
from proofmass.base.front import nondominated_points
from proofmass.design.pareto import LIMIT_EFFORT, SPREAD_LIMITS, find_front
from proofmass.design.search import Effort, SavedSearch
from proofmass.report.style import RC

PAGE = ROOT / "docs" / "balancer_fronts.json"
THESIS = ROOT / "tests" / "data" / "balancer.json"
SYSTEMS = {  # variant, colour, line of the thesis; the first three are those of figure 7
    "regular": (Variant("sine"), "#0072B2", "1743"),
    "nonlinear": (Variant("sine", springs="nonlinear"), "#D55E00", "1753"),
    "nonlinear preload": (Variant("sine", springs="nonlinear", preload=(2,)), "#444444", "1755"),
    "preload": (Variant("sine", preload=(2,)), "#009E73", "1745"),
    "preload 3": (Variant("sine", preload=(3,)), "#E69F00", ""),
    "rest angle": (Variant("sine", free_angle=True), "#882255", "1766"),
}
LIMIT_MARGIN = 2e-4  # of the spread: more than the penalty allows a limit to be exceeded
Record = dict[str, Any]
HEAD = """# Error against evenly shared energy

`python -m docs.make.balancer_fronts` made this page. S. van Nes, The use of a rigid linkage
balancer with torsion springs to realize nonlinear moment-angle characteristics, MSc thesis TU Delft
2022.074, has two objectives for a balancer of three segments and a sine: f1, the root mean square
error over m g r (eq. 18), and f2, the unevenness of the springs' shares of the energy (eq. 19). Its
figure 7 shows Pareto fronts of the first three systems of the table, found by a genetic algorithm.
The thesis prints no number of these fronts, and the curves are not in its text. It prints the
balancers of least f1, whose f1 and f2 are recomputed here from their parameters.

Each front here is found by a series of searches for the least f1 under a limit of f2, within the
bounds of figures M.1 and M.2. There are {limits} limits from the least f2 to that of the least f1,
up and down again, and one search with the f2 of the thesis's balancer as its limit, which starts
from this balancer. Such searches also find points that lie above the lower convex hull of the
front, which a weighted sum of both objectives cannot find. Every point is a design on a stable path
to 90 degrees.

The thesis says of figure 7 that the regular balancers generally have the lowest values, the
nonlinear ones high values, and the nonlinear ones with a preload values between these. Here this is
true below f2 = 0.2, but the nonlinear balancers reach an error that the regular ones never reach,
and a preload changes their front only a little. The front of linear springs with a preload starts
at a spread of 2.9, because the energy of the preload counts; its limits are far apart below 0.24,
where more points could be found.

![Fronts of f1 and f2, and the thesis's balancers of least f1](balancer_fronts.png)

"""


def is_on_hull(rmse: Array, spread: Array) -> NDArray[np.bool_]:
    """Which points (B,) of a front are corners of its lower convex hull.

    These are the points that a weighted sum of both objectives can find.  The errors must rise.

    >>> is_on_hull(np.array([0.0, 1.0, 2.0]), np.array([1.0, 0.9, 0.0]))
    array([ True, False,  True])
    """
    corners: list[int] = []
    for k in range(rmse.size):
        while len(corners) > 1:
            (i, j) = corners[-2:]
            turn = (rmse[j] - rmse[i]) * (spread[k] - spread[i]) - (spread[j] - spread[i]) * (
                rmse[k] - rmse[i]
            )
            if turn > 0:
                break
            corners.pop()
        corners.append(k)
    return np.isin(np.arange(rmse.size), corners)


def search_front(name: str, states: Path | None, quick: bool) -> Record:
    """The front of a system, and the processor time of its search [s]."""
    began = time.process_time()
    task = Synthesis(SYSTEMS[name][0], TARGETS["sine"])
    file = states / f"{name.replace(' ', '-')}.npz" if states else None
    effort = Effort(((12, 2), (4, 3))) if quick else Effort()
    start = SavedSearch(task, effort, file)
    start.run()
    folder = states / name.replace(" ", "-") if states else None
    if folder:
        folder.mkdir(exist_ok=True)
    found = find_front(task, start.found, folder, limits=1 if quick else SPREAD_LIMITS)
    record = front_of(task, name, found.vectors)
    if SYSTEMS[name][2] and not quick:
        record = with_search_at_thesis(record)
    return record | {"cpu_seconds": round(time.process_time() - began, 1)}


def front_of(task: Synthesis, name: str, vectors: Array) -> Record:
    """The record of a system: the nondominated ones of its designs (B, d)."""
    figures = task.figures(vectors)
    kept = nondominated_points(np.stack([figures.rmse, figures.spread], axis=-1))
    return {
        "system": name,
        "bounds": task.variant.bounds,
        "rmse": figures.rmse[kept].tolist(),
        "spread": figures.spread[kept].tolist(),
        "work_reduction": figures.work_reduction[kept].tolist(),
        "vectors": vectors[kept].tolist(),
    }


def with_search_at_thesis(record: Record) -> Record:
    """The front with one more search, under the f2 of the thesis's balancer of least f1.

    The search starts from this balancer and from the whole front.  Its limit is less by
    `LIMIT_MARGIN`, because the penalty allows a limit to be exceeded a little.
    """
    name, vectors = record["system"], np.array(record["vectors"])
    task = Synthesis(SYSTEMS[name][0], TARGETS["sine"])
    theirs = task.variant.vector(thesis_row(name)["parameters"])[None]
    begin = np.concatenate([theirs, vectors])
    search = SavedSearch(
        replace(task, limit=printed(name)[1] - LIMIT_MARGIN), LIMIT_EFFORT, start=begin
    )
    search.run()
    return record | front_of(task, name, np.concatenate([vectors, search.found[:1]]))


def thesis_row(name: str) -> Record:
    """The thesis's balancer of least f1."""
    return dict(json.loads(THESIS.read_text())["rows"][SYSTEMS[name][2]])


def printed(name: str) -> tuple[float, float]:
    """f1 and f2 [1] of the thesis's balancer of least f1, recomputed from its parameters."""
    angle = precision_points(90)
    found = solve(angle, **thesis_row(name)["parameters"])
    return (
        float(rmse(found["balancing_moment"], np.sin(angle))),
        float(energy_spread(*(found[f"energy{i}"] for i in (1, 2, 3)))),
    )


def least_error(record: Record, spread: float) -> float:
    """The least f1 of the front with an f2 of at most `spread` [1]."""
    f1, f2 = np.array(record["rmse"]), np.array(record["spread"])
    return float(f1[f2 <= spread].min(initial=np.inf))


def table(records: list[Record]) -> Iterator[str]:
    """The fronts as a Markdown table."""
    yield (
        "| system | least f1, with f2 | least f2, with f1 | f1 at f2 ≤ 0.2, 0.1, 0.05 | points | "
        "above the hull | thesis's line: f1, f2; f1 here | CPU s |"
    )
    yield "|---|---|---|---|---|---|---|---|"
    for record in records:
        f1, f2 = np.array(record["rmse"]), np.array(record["spread"])
        line = SYSTEMS[record["system"]][2]
        theirs = "-"
        if line:
            error, spread = printed(record["system"])
            own = least_error(record, spread)
            theirs = f"{line}: {error:.4f}, {spread:.3f}; here {own:.4f}"
        above = (~is_on_hull(f1, f2)).sum()
        some = (least_error(record, spread) for spread in (0.2, 0.1, 0.05))
        at = ", ".join(f"{error:.4f}" if np.isfinite(error) else "none" for error in some)
        yield (
            f"| {record['system']} | {f1[0]:.5f}, {f2[0]:.3f} | {f2[-1]:.4f}, {f1[-1]:.3f} | "
            f"{at} | {f1.size} | {above} | {theirs} | {record['cpu_seconds']:.0f} |"
        )


def page(records: list[Record]) -> str:
    """The text of docs/balancer_fronts.md."""
    return HEAD.format(limits=SPREAD_LIMITS) + "\n".join(table(records)) + "\n"


def draw(records: list[Record]) -> Figure:
    """The figure of all fronts: points on the hull filled, others open, the thesis's as crosses."""
    with rc_context(RC):
        figure = Figure((9.5, 4.2), layout="constrained")
        panels = figure.subplots(1, 2, sharey=True)
        for axes, scale in zip(panels, ("linear", "log"), strict=True):
            for record in records:
                name, colour = record["system"], SYSTEMS[record["system"]][1]
                f1, f2 = np.array(record["rmse"]), np.array(record["spread"])
                hull = is_on_hull(f1, f2)
                axes.step(f1, f2, "-", where="post", color=colour, linewidth=0.8)
                axes.plot(f1[hull], f2[hull], "o", color=colour, markersize=4, label=name)
                axes.plot(f1[~hull], f2[~hull], "o", color=colour, markersize=4, mfc="white")
                if SYSTEMS[name][2]:
                    axes.plot(*printed(name), "x", color=colour, markersize=7)
            axes.set(xlabel="f1: root mean square error / m g r [1]", xscale=scale)
        panels[0].set(ylabel="f2: spread of energy / m g r [1]", ylim=(-0.02, 0.8))
        panels[0].legend(
            title="filled: on the convex hull; open: above it; x: thesis, least f1",
            title_fontsize=7,
            fontsize=7,
        )
        return figure


def main(argv: Sequence[str] | None = None) -> None:
    """Search the fronts that are named, or all, and write the page of all known fronts."""
    parser = command(__doc__)
    parser.add_argument("systems", nargs="*", choices=[*SYSTEMS, []])
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--states", type=Path)
    parser.add_argument("--redraw", action="store_true")
    given = parser.parse_args(argv)
    if given.states:
        given.states.mkdir(parents=True, exist_ok=True)
    known = {}
    if PAGE.exists():
        known = {record["system"]: record for record in json.loads(PAGE.read_text())}
    names = given.systems or (["regular"] if given.quick else list(SYSTEMS))
    if not given.redraw:
        with ProcessPoolExecutor(given.jobs, get_context("spawn")) as pool:
            futures = [pool.submit(search_front, name, given.states, given.quick) for name in names]
            for name, future in zip(names, futures, strict=True):
                known[name] = future.result()
                print(list(table([known[name]]))[-1], flush=True)
    records = [known[name] for name in SYSTEMS if name in known]
    with folders(given.quick, Path()) as (_, docs):
        (docs / PAGE.name).write_text(json.dumps(records, indent=1) + "\n")
        (docs / PAGE.name).with_suffix(".md").write_text(page(records))
        draw(records).savefig((docs / PAGE.name).with_suffix(".png"), dpi=130)


if __name__ == "__main__":
    main()
