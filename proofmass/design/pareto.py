"""The trade between a balancer's error and the spread of energy over its springs."""

import csv
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from proofmass.analytic.balancer.synthesis import Synthesis
from proofmass.analytic.numerics import Array
from proofmass.design.search import Effort, SavedSearch
from proofmass.front import nondominated
from proofmass.report.style import RC

WEIGHTS = np.geomspace(1e-3, 1.0, 9).tolist()  # errors are 1e-3 to 1e-1, spreads 0.1 to 1
SHORT = Effort(((64, 8), (16, 30)))  # for each weight


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
    weights: Sequence[float] = WEIGHTS,
    progress: Callable[[int, int, float], None] = lambda *_: None,
) -> Front:
    """Pareto front of (f1, f2): searches with one weight after the other, up and down again.

    Each begins where the last one ended, and in some random places.

    Parameters
    ----------
    task : Synthesis
    start : ndarray (B, d)
        Designs of small error [SI], where the sweep begins.
    folder : path, optional
        Where the searches keep their states.
    weights : of the spread in the aim [1]
    progress : callable
        Told the number of searches done, that of all, and the weight.

    Returns
    -------
    Front

    Notes
    -----
    Weighted sums find the convex part of a front; designs met on the way fill in some of the rest.
    Van Nes 2022 shows such fronts in figure 7, made by a genetic algorithm.
    """
    found = [start]
    sweep = [*weights, *reversed(weights)]
    for k, weight in enumerate(sweep):
        search = SavedSearch(
            replace(task, weight=weight),
            replace(SHORT, seed=k),
            folder / f"pareto{k}.npz" if folder else None,
            start,
        )
        search.run()
        start = search.found
        found.append(start)
        progress(k + 1, len(sweep), weight)
    vectors = np.concatenate(found)
    figures = task.figures(vectors)
    kept = nondominated(np.stack([figures.rmse, figures.spread], axis=-1))
    return Front(
        vectors[kept], figures.rmse[kept], figures.spread[kept], figures.work_reduction[kept]
    )


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
