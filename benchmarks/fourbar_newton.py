"""The four-bar by Newton-Raphson, one pose at a time, with explicit equations.

The equations that `teaching.natural_coordinates` assembles from rows are written
here as one array, and no log is kept.  The scheme cannot be faster in Python.  B. Díaz Lozano, TFG,
Universidad de Almería 2019, text lines 1417-1469 and 1989-2056.  An iteration stops at
|dq| <= 1e-10, and each pose starts from the last one.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
CRANK, COUPLER, ROCKER, GROUND = 1.0, 2.0, 2.5, 3.0


def system(q: Array) -> tuple[Array, Array]:
    """Constraints and Jacobian for q = [x1, y1, x2, y2, angle]."""
    x1, y1, x2, y2, angle = q
    c, s = np.cos(angle), np.sin(angle)
    ax, ay, bx = x2 - x1, y2 - y1, x2 - GROUND
    level = abs(c) < np.sqrt(0.5)
    gap = x1 - CRANK * c if level else y1 - CRANK * s
    row = [1, 0, 0, 0, CRANK * s] if level else [0, 1, 0, 0, -CRANK * c]
    value = [
        x1**2 + y1**2 - CRANK**2,
        ax**2 + ay**2 - COUPLER**2,
        bx**2 + y2**2 - ROCKER**2,
        gap,
        0,
    ]
    slope = [
        [2 * x1, 2 * y1, 0, 0, 0],
        [-2 * ax, -2 * ay, 2 * ax, 2 * ay, 0],
        [0, 0, 2 * bx, 2 * y2, 0],
        row,
        [0, 0, 0, 0, 1],
    ]
    return np.array(value), np.array(slope, float)


def sweep(angles: Array, start: Array) -> Array:
    """Position, velocity, acceleration of the rocker's pin (3, n, 2), at unit crank rate."""
    q = np.array([1.0, 0.0, *start, angles[0]])
    rows = []
    for angle in angles:
        q[4], error = angle, np.inf
        while error > 1e-10:
            value, slope = system(q)
            step = np.linalg.solve(slope, -value)
            error = float(np.linalg.norm(step))
            q += step
        slope = system(q)[1]
        v = np.linalg.solve(slope, [0, 0, 0, 0, 1])
        c, s = np.cos(angle), np.sin(angle)
        turning = CRANK * (c if abs(c) < np.sqrt(0.5) else s)
        right = [2 * v[:2] @ v[:2], 2 * (v[2:4] - v[:2]) @ (v[2:4] - v[:2]), 2 * v[2:4] @ v[2:4]]
        a = np.linalg.solve(-slope, [*right, turning, 0])
        rows.append([q[2:4].copy(), v[2:4], a[2:4]])
    return np.swapaxes(rows, 0, 1)
