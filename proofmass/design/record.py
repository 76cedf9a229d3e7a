"""What is worth keeping of a design: figures, parameters, springs that can be bought."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from proofmass.analytic.balancer.synthesis import Synthesis
from proofmass.analytic.numerics import Array
from proofmass.design.selection import Selection, select


def described(task: Synthesis, vectors: Array, stock: Mapping[str, float]) -> dict[str, Any]:
    """The first of the designs (B, d), best first, and the springs for one of them."""
    variant = task.variant
    record = {"target": variant.target, "segments": variant.segments, "springs": variant.springs,
              "preload": variant.preload, "option": variant.option, "figure": variant.figure,
              "bounds": variant.bounds, "points": task.angles.size, **worth(task, vectors[0])}
    if variant.springs == "linear" and (chosen := built(task, vectors, stock)):
        record["selection"] = chosen
    return record


def worth(task: Synthesis, vector: Array) -> dict[str, Any]:
    """Figures and parameters of a design (d,)."""
    figures = task.figures(vector[None])
    return {"rmse": float(figures.rmse[0]), "work_reduction": float(figures.work_reduction[0]),
            "spread": float(figures.spread[0]), "parameters":
            {k: float(v[0]) for k, v in task.variant.parameters(vector[None]).items()}}


def built(task: Synthesis, vectors: Array, stock: Mapping[str, float]) -> dict[str, Any]:
    """Catalogue springs for the design that is best with them, and what it is then worth.

    Near the best design lie others that are nearly as good with other ratios of their stiffnesses:
    each of them is tried.  Empty where joint 2 has no spring to compare with, or none can be built.
    """
    places = [list(task.variant.usual).index(f"stiffness{i + 1}")
              for i in range(task.variant.segments)]
    tried = [(vector, select(vector[places], stock)) for vector in vectors if vector[places[1]] > 0]
    if not tried:
        return {}
    with_them = np.array([fitted(vector, chosen, places) for vector, chosen in tried])
    errors = task.figures(with_them).rmse
    if np.isnan(errors).all():
        return {}
    best = int(np.nanargmin(errors))
    chosen = tried[best][1]
    return {"springs": chosen.springs, "stiffness": chosen.stiffness, "ratios": chosen.ratios,
            "error": chosen.error, "moment": chosen.scale, **worth(task, with_them[best])}


def fitted(vector: Array, chosen: Selection, places: list[int]) -> Array:
    """A design (d,) with the chosen stiffnesses instead, for m g r = 1 N m."""
    changed = vector.copy()
    changed[places] = np.array(chosen.stiffness) / chosen.scale
    return changed
