"""Mechanisms of Pérez Gámiz 2018 and their equilibria, from data/rod_assemblies.json."""

import json
from functools import cache
from pathlib import Path

import numpy as np
from scipy.special import ellipeinc, ellipkinc

from proofmass.analytic.rods.assembly import Assembly, assembly, triangle
from proofmass.analytic.rods.equilibrium import RodState, solve_direct, state

DATA = json.loads((Path(__file__).parents[2] / "data" / "rod_assemblies.json").read_text())
EI = DATA["stiffness"]
TABLE_7_NAMES = ("S1", "S2", "S3", "S4")
PAIR = assembly(DATA["rfr2"]["clamp"], stiffness=EI)
CORNERS = triangle(np.sqrt(3.0))  # where the clamps or guides of three rods are


def three_rod_platform(side: float, **more) -> Assembly:
    """Three rods on an equilateral platform."""
    return assembly(CORNERS, stiffness=EI, arm=triangle(side), **more)


@cache
def table_7_state(name: str) -> RodState:
    """An equilibrium of the 2RFR of Table 7, solved from the recomputed digits."""
    row, load = DATA["rfr2"]["recomputed"][name], np.array(DATA["rfr2"]["load"])
    first = np.array(row["force1"])
    return solve_direct(
        state(
            PAIR,
            inputs=np.radians(DATA["rfr2"]["inputs_deg"]),
            pose=row["pose"],
            load=load,
            moment=row["moment"],
            force=[first, load - first],
        )
    )


def rods_by_elliptic_integrals(psi, k_rel, clamp, angle):
    """Tip [m], force [N] and clamp moment [N m] of rods of 1 m and mode 1, by elliptic integrals.

    Pérez Gámiz 2018, eqs 40, 41, 86, 87, 91.  Tips and forces are complex numbers in the frame.
    """
    psi, k_rel, angle = (np.asarray(v, float) for v in (psi, k_rel, angle))
    least = np.abs(np.cos(psi / 2))
    k = np.sign(k_rel) * least + (1 - least) * k_rel
    start = np.arcsin(np.cos(psi / 2) / k)
    f, e = (whole(np.pi / 2, k**2) - whole(start, k**2) for whole in (ellipkinc, ellipeinc))
    along, across = (2 * e - f) / f, -2 * k * np.cos(start) / f
    tip = (1j * across - along) * np.exp(1j * psi)
    points = np.asarray(clamp, float) @ np.array([1.0, 1.0j])
    return (
        points + tip * np.exp(1j * angle),
        f**2 * EI * np.exp(1j * (psi + angle)),
        2 * k * f * EI * np.cos(start),
    )


def xy(points):
    """Points (..., 2) from complex numbers."""
    return np.stack([np.real(points), np.imag(points)], axis=-1)
