"""Cases of rods in segments, data/rod_chain.json, and continuous rods by DOP853 as their seeds."""

import json
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

from proofmass.analytic.rods.assembly import assembly

CASES = json.loads((Path(__file__).parents[2] / "data" / "rod_chain.json").read_text())
PAIR_CASE = CASES["2RFR"]
STABLE_ROWS = {row["name"]: row for row in PAIR_CASE["stable"]}


def continuum(angle, force, moment, stiffness, length=1.0):
    """theta(s), theta'(s), x(s), y(s) of a clamped rod from its tip force and its clamp moment."""

    def slope(_, y):
        bend = (force[0] * np.sin(y[0]) - force[1] * np.cos(y[0])) / stiffness
        return [y[1], bend, np.cos(y[0]), np.sin(y[0])]

    start = [angle, moment / stiffness, 0.0, 0.0]
    return solve_ivp(
        slope, (0.0, length), start, method="DOP853", rtol=1e-11, atol=1e-12, dense_output=True
    ).sol


def tangent_angle(*rod):
    """theta(s) of `continuum`."""
    shape = continuum(*rod)
    return lambda s: shape(s)[0]


def pair_of_table_7():
    """The mechanism of Table 7."""
    return assembly(
        PAIR_CASE["clamp"],
        stiffness=PAIR_CASE["stiffness"],
        angle=np.radians(PAIR_CASE["angle_deg"]),
    )


def tangents_of_pair(row):
    """theta(s) of both rods of that mechanism in an equilibrium, a row of the data."""
    first = np.array(row["force1"])
    forces = first, np.array(PAIR_CASE["force"]) - first
    angles = np.radians(PAIR_CASE["angle_deg"])
    return [
        tangent_angle(*rod, PAIR_CASE["stiffness"])
        for rod in zip(angles, forces, row["root_moment"], strict=True)
    ]


def observed_orders(errors):
    """Observed orders of errors for h that is halved each time."""
    return np.log2(np.abs(errors[:-1]) / np.abs(errors[1:]))


def extrapolated(coarse, fine):
    """Richardson's extrapolation of errors of second order; the remaining error is of order h^4."""
    return (4.0 * fine - coarse) / 3.0
