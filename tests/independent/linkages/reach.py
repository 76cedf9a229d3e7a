"""Which poses a five-bar linkage and a 3PRR robot reach, from the distances of their pins alone."""

import numpy as np


def fivebar_margin(tip, *, left_crank, left_coupler, right_coupler, right_crank, left_x, right_x):
    """Distance [m] of the tip from the border of the two rings; negative where it is out of reach.

    `tip` is (x, y) [m], (2,) or (2, n); the lengths are those of `fivebar.solve`.
    """
    x, y = np.asarray(tip, float)
    left, right = np.hypot(x - left_x, y), np.hypot(x - right_x, y)
    return np.minimum.reduce(
        [
            left - abs(left_crank - left_coupler),
            left_crank + left_coupler - left,
            right - abs(right_crank - right_coupler),
            right_crank + right_coupler - right,
        ]
    )


def is_threeprr_pose(pose, *, side, leg, guide2_x, guide3_x, guide3_y):
    """Whether all legs reach their guides in poses x, y [m], psi [rad], (3, ...).

    J. Pérez Gámiz, TFG, UPV/EHU Bilbao 2018, eqs 62-64: no radicand of the sliders is negative.
    Guides 1 and 2 are on y = 0, guide 3 on x = guide3_x.
    """
    x, y, psi = np.asarray(pose, float)
    from_guides = y, y + side * np.sin(psi), x + side * np.cos(psi + np.pi / 3) - guide3_x
    return np.abs(from_guides).max(axis=0) <= leg
