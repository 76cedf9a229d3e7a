"""Pareto front of a balancer's error and the spread of energy over its springs."""

import csv
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from io import BytesIO, StringIO
from pathlib import Path

import numpy as np

from proofmass.report.style import RC  # isort: skip
from matplotlib import rc_context
from matplotlib.figure import Figure

from proofmass.analytic.balancer.synthesis import Synthesis
from proofmass.base.arrays import Array
from proofmass.base.files import write_output
from proofmass.base.front import nondominated_points
from proofmass.design.search import Effort, SavedSearch

SPREAD_LIMITS = 12  # number of limits of the spread
LIMIT_EFFORT = Effort(((64, 8), (16, 30)))  # effort of the search for each limit


@dataclass(frozen=True)
class Front:
    """Pareto-optimal designs: none is better than another in both objectives.

    They are sorted by increasing error.

    Attributes
    ----------
    vectors : ndarray (B, d)
        Designs [SI].
    rmse, spread, work_reduction : ndarray (B,)
        Root mean square error and spread of energy [1], and work reduction [%].
    """

    vectors: Array
    rmse: Array
    spread: Array
    work_reduction: Array


def find_front(
    task: Synthesis,
    start: Array,
    folder: Path | None = None,
    limits: int = SPREAD_LIMITS,
    progress: Callable[[int, int, float], None] = lambda *_: None,
) -> Front:
    """Pareto front of (f1, f2): the smallest error f1 for each limit of the spread f2.

    The first limit is zero, with which the smallest spread is found.  The other limits lie at equal
    distances between this spread and that of the smallest error; they are used in rising and then
    in falling order.  Each search begins with the designs of the search before it, and with some
    random designs.

    Parameters
    ----------
    task : Synthesis
    start : ndarray (B, d)
        Designs of small error [SI], with which the first search begins.
    folder : path, optional
        Folder in which the searches save their states.
    limits : int
        Number of limits between the two spreads.
    progress : callable
        Called with the number of finished searches, the number of all searches and the limit [1].

    Returns
    -------
    Front

    Notes
    -----
    Limits of one objective (the epsilon-constraint method) find all parts of a front, whereas
    weighted sums of both objectives find its convex part only.  Van Nes 2022 shows such fronts,
    found by a genetic algorithm, in figure 7.
    """
    found, ends = [start[:1]], [float(task.figures(start[:1]).spread[0])]
    for k in range(2 * limits):
        limit = 0.0
        if k:
            share = min(k, 2 * limits - k) / limits  # up to 1 and down again
            limit = ends[1] + share * (ends[0] - ends[1])
        search = SavedSearch(
            replace(task, limit=limit),
            replace(LIMIT_EFFORT, seed=k),
            folder / f"pareto{k}.npz" if folder else None,
            start,
        )
        search.run()
        start = search.found
        found.append(start[:1])
        if not k:
            ends.append(float(np.nanmin(task.figures(start).spread)))
        progress(k + 1, 2 * limits, limit)
    vectors = np.concatenate(found)
    figures = task.figures(vectors)
    kept = nondominated_points(np.stack([figures.rmse, figures.spread], axis=-1))
    return Front(
        vectors[kept], figures.rmse[kept], figures.spread[kept], figures.work_reduction[kept]
    )


def write_front(found: Front, names: Sequence[str], stem: Path) -> list[Path]:
    """Write the front to CSV, JSON, SVG and PNG files, and return their paths."""
    header = ["rmse", "spread", "work_reduction", *names]
    rows = np.column_stack([found.rmse, found.spread, found.work_reduction, found.vectors]).tolist()
    table = StringIO(newline="")
    csv.writer(table).writerows([header, *rows])
    write_output(stem.with_suffix(".csv"), table.getvalue())
    write_output(
        stem.with_suffix(".json"),
        json.dumps([dict(zip(header, row, strict=True)) for row in rows], indent=1),
    )
    with rc_context(RC):
        figure = Figure((4.5, 3.2), layout="constrained")
        axes = figure.subplots()
        axes.step(found.rmse, found.spread, "o-", where="post", color="#0072B2")
        axes.set(
            xlabel="f1: root mean square error / m g r",
            xscale="log",
            ylabel="f2: spread of energy / m g r",
            title="Pareto front",
        )
        for ending in ("svg", "png"):
            drawn = BytesIO()
            figure.savefig(drawn, format=ending, dpi=150)
            write_output(stem.with_suffix(f".{ending}"), drawn.getvalue())
    return [stem.with_suffix(ending) for ending in (".csv", ".json", ".svg", ".png")]
