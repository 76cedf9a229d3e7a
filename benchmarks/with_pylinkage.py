"""pylinkage 1.3, used as its README recommends: components, dyads, `simulation.Linkage`.

pylinkage rotates a crank by equal steps, and every pose starts from the last one.  `step` is its
loop in Python, and `step_fast` the same loop compiled by numba.  Both have a variant that gives
velocities and accelerations.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from pylinkage.actuators import Crank
from pylinkage.components import Ground
from pylinkage.dyads import RRPDyad, RRRDyad
from pylinkage.simulation import Linkage

from benchmarks.timing import Row

Array = NDArray[np.float64]


def fourbar(poses: int) -> Linkage:
    """Crank 1, coupler 2, rocker 2.5, ground 3; its last component is the rocker's pin."""
    base, far = Ground(0.0, 0.0), Ground(3.0, 0.0)
    crank = Crank(anchor=base, radius=1.0, angular_velocity=2.0 * np.pi / poses)
    rocker = RRRDyad(anchor1=crank.output, anchor2=far, distance1=2.0, distance2=2.5)
    return set_crank_rate(Linkage([base, far, crank, rocker]), crank)


def slider_crank(poses: int) -> Linkage:
    """Crank 1, coupler 2, guide along x; its last component is the slider."""
    base, near, far = Ground(0.0, 0.0), Ground(2.0, 0.0), Ground(3.0, 0.0)
    crank = Crank(anchor=base, radius=1.0, angular_velocity=2.0 * np.pi / poses)
    slider = RRPDyad(
        revolute_anchor=crank.output, line_anchor1=near, line_anchor2=far, distance=2.0
    )
    return set_crank_rate(Linkage([base, near, far, crank, slider]), crank)


def set_crank_rate(linkage: Linkage, crank: Crank) -> Linkage:
    """Set the crank's rate for the velocity analysis to 1 rad/s."""
    linkage.set_input_velocity(crank, omega=1.0)
    return linkage


def angles(poses: int) -> Array:
    """Crank angles of the poses; the first is one step after the start."""
    return np.linspace(0.0, 2.0 * np.pi, poses + 1)[1:]


def rows(mechanism: str, build: Callable[[int], Linkage], few: int, many: int) -> list[Row]:
    """All methods for one turn of a linkage: with few poses in Python, with many compiled."""
    slow, fast = build(few), build(many)
    return [
        Row(mechanism, "pylinkage step", "p", few, lambda: list(slow.step(few))),
        Row(
            mechanism,
            "pylinkage step_with_derivatives",
            "p v a",
            few,
            lambda: list(slow.step_with_derivatives(few)),
        ),
        Row(mechanism, "pylinkage step_fast, numba", "p", many, lambda: fast.step_fast(many)),
        Row(
            mechanism,
            "pylinkage step_fast_with_kinematics",
            "p v a",
            many,
            lambda: fast.step_fast_with_kinematics(many),
        ),
    ]


def difference(
    build: Callable[[int], Linkage], truth: Callable[[Array], Array], many: int
) -> float:
    """Largest error of position, velocity and acceleration of a turn, by a reference (3, n, 2)."""
    found = np.array(build(many).step_fast_with_kinematics(many))[:, :, -1]
    return float(np.abs(found - truth(angles(many))).max())
