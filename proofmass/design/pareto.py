"""The trade between a balancer's error and the spread of energy over its springs."""

import csv
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure
from numpy.typing import NDArray

from proofmass.analytic.balancer.synthesis import Synthesis
from proofmass.analytic.numerics import Array
from proofmass.design.search import Effort, SavedSearch
from proofmass.front import nondominated
from proofmass.report.style import RC

LIMITS = 12  # of the spread
SHORT = Effort(((64, 8), (16, 30)))  # for each limit


@dataclass(frozen=True)
class Front:
    """Designs of which none is better than another in both aims, the error rising.

    Attributes
    ----------
    vectors : ndarray (B, d)
        Designs [SI].
    rmse, spread, work_reduction : ndarray (B,)
        Their error and spread [1], and work reduction [%].
    """

    vectors: Array
    rmse: Array
    spread: Array
    work_reduction: Array


def front(
    task: Synthesis,
    start: Array,
    folder: Path | None = None,
    limits: int = LIMITS,
    progress: Callable[[int, int, float], None] = lambda *_: None,
) -> Front:
    """Pareto front of (f1, f2): the least error for one limit of the spread after the other.

    The first limit is zero, where the least spread is found; the others divide the way from there
    to the spread of the least error evenly, and are gone through up and down again.  Each search
    begins where the last one ended, and in some random places.

    Parameters
    ----------
    task : Synthesis
    start : ndarray (B, d)
        Designs of small error [SI], where the sweep begins.
    folder : path, optional
        Where the searches keep their states.
    limits : int
        How many.
    progress : callable
        Told the number of searches done, that of all, and the limit [1].

    Returns
    -------
    Front

    Notes
    -----
    A limit (epsilon constraint) leads to every part of a front, where a weighted sum of both aims
    leads to its convex part alone.  Van Nes 2022 shows such fronts in figure 7, made by a genetic
    algorithm.
    """
    found, ends = [start[:1]], [float(task.figures(start[:1]).spread[0])]
    for k in range(2 * limits):
        limit = 0.0
        if k:
            share = min(k, 2 * limits - k) / limits  # up to 1 and down again
            limit = ends[1] + share * (ends[0] - ends[1])
        search = SavedSearch(
            replace(task, limit=limit),
            replace(SHORT, seed=k),
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
    kept = nondominated(np.stack([figures.rmse, figures.spread], axis=-1))
    return Front(
        vectors[kept], figures.rmse[kept], figures.spread[kept], figures.work_reduction[kept]
    )


def on_hull(rmse: Array, spread: Array) -> NDArray[np.bool_]:
    """Which points (B,) of a front, errors rising, a weighted sum of both aims could find.

    They are the corners of the lower convex hull.

    >>> on_hull(np.array([0.0, 1.0, 2.0]), np.array([1.0, 0.9, 0.0]))
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


def write_front(found: Front, names: Sequence[str], stem: Path) -> list[Path]:
    """Write the front as CSV, JSON, SVG and PNG."""
    header = ["rmse", "spread", "work_reduction", *names]
    rows = np.column_stack([found.rmse, found.spread, found.work_reduction, found.vectors]).tolist()
    with stem.with_suffix(".csv").open("w", newline="", encoding="utf-8") as stream:
        csv.writer(stream).writerows([header, *rows])
    stem.with_suffix(".json").write_text(
        json.dumps([dict(zip(header, row, strict=True)) for row in rows], indent=1),
        encoding="utf-8",
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
            figure.savefig(stem.with_suffix(f".{ending}"), dpi=150)
    return [stem.with_suffix(ending) for ending in (".csv", ".json", ".svg", ".png")]
