"""Poses per second of the closed forms beside Newton-Raphson, one pose at a time.

    python -m benchmarks.closed_forms

Every closed form gives all its curves at 200000 poses per call. The Newton-Raphson row solves the
four-bar the way B. Díaz Lozano, TFG, Universidad de Almería 2019, does (text lines 1417-1469 and
1989-2056): natural coordinates, numpy.linalg.solve, stop at a step of 1e-10, each pose starting
from the last, then one linear solve each for velocity and acceleration. Best of 7 runs.
"""

import time
from collections.abc import Callable

import numpy as np

from analytic import fourbar, hacksaw, pendulum

POSES, NEWTON_POSES, RUNS = 200_000, 500, 7
CRANK, COUPLER, ROCKER, GROUND = 1.0, 2.0, 2.5, 3.0
Vector = np.ndarray


def system(q: Vector) -> tuple[Vector, Vector]:
    """Constraints and Jacobian for q = [x1, y1, x2, y2, angle]."""
    x1, y1, x2, y2, angle = q
    c, s = np.cos(angle), np.sin(angle)
    ax, ay, bx = x2 - x1, y2 - y1, x2 - GROUND
    level = abs(c) < np.sqrt(0.5)
    gap = x1 - CRANK * c if level else y1 - CRANK * s
    row = [1, 0, 0, 0, CRANK * s] if level else [0, 1, 0, 0, -CRANK * c]
    value = [x1**2 + y1**2 - CRANK**2, ax**2 + ay**2 - COUPLER**2,
             bx**2 + y2**2 - ROCKER**2, gap, 0]
    slope = [[2 * x1, 2 * y1, 0, 0, 0], [-2 * ax, -2 * ay, 2 * ax, 2 * ay, 0],
             [0, 0, 2 * bx, 2 * y2, 0], row, [0, 0, 0, 0, 1]]
    return np.array(value), np.array(slope, float)


def newton_sweep(angles: Vector) -> Vector:
    """Pin positions, rates and accelerations at unit crank rate, one pose after the other."""
    q, rows = np.array([1.0, 0.0, 1.4375, -1.95, angles[0]]), []
    for angle in angles:
        q[4], step = angle, np.ones(5)
        while np.linalg.norm(step) > 1e-10:
            value, slope = system(q)
            step = np.linalg.solve(slope, -value)
            q = q + step
        slope = system(q)[1]
        v = np.linalg.solve(slope, [0, 0, 0, 0, 1])
        c, s = np.cos(angle), np.sin(angle)
        turning = CRANK * (c if abs(c) < np.sqrt(0.5) else s)
        right = [2 * v[:2] @ v[:2], 2 * (v[2:4] - v[:2]) @ (v[2:4] - v[:2]), 2 * v[2:4] @ v[2:4]]
        a = np.linalg.solve(-slope, [*right, turning, 0])
        rows.append([*q[2:4], *v[2:4], *a[2:4]])
    return np.array(rows).T


def best(work: Callable[[], object]) -> float:
    """Shortest wall time [s] of several runs."""
    times = []
    for _ in range(RUNS):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return min(times)


def main() -> None:
    link = {"crank": CRANK, "coupler": COUPLER, "rocker": ROCKER, "ground": GROUND}
    angles, few = (np.linspace(0.0, 2.0 * np.pi, n) for n in (POSES, NEWTON_POSES))
    saw, body = {"crank": 0.075, "coupler": 0.170, "offset": 0.045}, {"length": 1.0, "mass": 1.0}
    swing = body | {"gravity": 9.81, "amplitude": -np.pi / 2}
    pose, rows = fourbar.solve(few, **link, mode=-1), newton_sweep(few)
    names = ("pin_x", "pin_y", "pin_vx", "pin_vy", "pin_ax", "pin_ay")
    error = max(np.abs(pose[n] - row).max() for n, row in zip(names, rows, strict=True))
    base = NEWTON_POSES / best(lambda: newton_sweep(few))
    speeds = {
        "four-bar, Newton-Raphson": base,
        "four-bar": POSES / best(lambda: fourbar.solve(angles, **link, mode=-1)),
        "hacksaw": POSES / best(lambda: hacksaw.solve(angles, 1.0, 0.0, **saw)),
        "pendulum": POSES / best(lambda: pendulum.solve(angles, **swing)),
    }
    print(f"{'closed form':26}{'poses/s':>14}{'ratio':>10}")
    for name, speed in speeds.items():
        print(f"{name:26}{speed:14,.0f}{speed / base:10,.1f}")
    print(f"largest difference of Newton-Raphson and closed form: {error:.1e} m, m/s, m/s^2")


if __name__ == "__main__":
    main()
