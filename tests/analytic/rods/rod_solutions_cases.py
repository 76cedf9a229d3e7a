"""Direct problems of Pérez Gámiz 2018 with all their known equilibria, data/rod_solutions.json."""

import json
from functools import cache
from pathlib import Path

import numpy as np

from proofmass.analytic.rods.all_equilibria import solutions
from proofmass.analytic.rods.assembly import assembly, triangle

DATA = json.loads((Path(__file__).parents[2] / "data" / "rod_solutions.json").read_text())
EI = DATA["stiffness"]
CORNERS = triangle(np.sqrt(3.0))  # clamps or guides of three rods


def make_problem(name):
    """The assembly of a case of the data, and its inputs and load as arguments of `solutions`."""
    row = DATA[name]
    if name == "rfr2":
        a = assembly(row["clamp"], stiffness=EI)
    else:
        guide = np.radians(row["guide_deg"]) if "guide_deg" in row else None
        a = assembly(
            CORNERS,
            stiffness=EI,
            arm=triangle(row["side"]),
            guide=guide,
            angle=0.0 if guide is None else guide,
        )
    inputs = np.radians(row["inputs_deg"]) if "inputs_deg" in row else row["inputs"]
    return a, {"inputs": inputs, "load": row["load"]}


@cache
def find_solutions(name, modes):
    """All equilibria of a case of the data with up to this number of modes, computed once."""
    a, arguments = make_problem(name)
    return solutions(a, modes=modes, **arguments)


def alphas(f):
    """alpha = L sqrt(R/EI) of each rod (n, k), with L = 1 m."""
    return np.sqrt(np.linalg.norm(f.state.force, axis=-1) / EI)
