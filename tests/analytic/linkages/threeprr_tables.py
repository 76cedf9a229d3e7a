"""Tables of the 3PRR document, and helpers of its tests: legs of a pose, poses of a triple.

A triple is the three slider positions.
"""

import json
from pathlib import Path

import numpy as np

from proofmass.analytic.linkages import threeprr

DATA = json.loads((Path(__file__).parents[2] / "data" / "threeprr.json").read_text())
TABLE3, TABLE4 = DATA["inverse"]
TABLE5, TABLE6, SIX_POSES = DATA["direct"]
LENGTHS, SLIDERS = TABLE5["where"], np.array(TABLE5["sliders"])
POSE_NAMES = ("x", "y", "psi")


def corners(x, y, psi, side):
    """P, P2, P3 of the platform, as complex numbers."""
    p = x + 1j * y
    return [p, p + side * np.exp(1j * psi), p + side * np.exp(1j * (psi + np.pi / 3))]


def slider_points(sliders, where):
    """Points C1, C2, C3 of the sliders, as complex numbers."""
    return [
        sliders[0] + 0j,
        where["guide2_x"] - sliders[1] + 0j,
        where["guide3_x"] + 1j * (where["guide3_y"] - sliders[2]),
    ]


def leg_errors(pose, sliders, where):
    """Distance between the ends of each leg less its length [m], for poses x, y, psi."""
    return [
        np.abs(p - c) - where["leg"]
        for p, c in zip(corners(*pose, where["side"]), slider_points(sliders, where), strict=True)
    ]


def slider_triples(pose, where):
    """Slider positions of the eight working modes of a pose, (8, 3)."""
    found = [threeprr.solve_inverse(pose, **where, mode=m) for m in threeprr.WORKING_MODES]
    return np.array([[f[f"slider_{k}"] for k in (1, 2, 3)] for f in found])


def pose_rows(found):
    """Rows x, y, psi of the poses that exist for one triple, (poses, 3)."""
    rows = np.transpose([found[name] for name in POSE_NAMES])
    return rows[np.isfinite(rows[:, 0])]


def nearest_distance(rows, pose):
    """Smallest distance of rows x, y [m] and psi [rad], without whole turns, from a pose."""
    rows = np.asarray(rows) - np.asarray(pose)
    rows[:, 2] = np.angle(np.exp(1j * rows[:, 2]))
    return np.abs(rows).max(axis=1).min()
