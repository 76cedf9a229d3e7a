"""Maps of three clamped rods on one rigid platform, driven along guides (3PFR) or by motors (3RFR).
"""

import numpy as np

from proofmass.analytic.chart import Chart
from proofmass.analytic.rods.rod_platform import Problem, standing
from proofmass.analytic.rods.rod_sheets import over_poses, sheet


def constant_orientation(
    *, side: float, theta1: float = 0.0, theta2: float = 0.0, theta3: float = 0.0,
    guide1: float | None = None, guide2: float | None = None, guide3: float | None = None,
    radius: float = 1.0, force_x: float = 0.0, force_y: float = 0.0, moment: float = 0.0,
    mode: int = 1, inflections: int = 1, length: float = 1.0, stiffness: float = 1.0,
    prolongation: float = 0.0, input1: float = 0.0, input2: float = 0.0, input3: float = 0.0,
    nodes: int = 25,
) -> Chart:
    r"""Where the platform gets to without turning, from one of its stable equilibria.

    ::

             - - -O1 [=]---.         P in x, y; phi as in the equilibrium
                            B1       q_1, q_2, q_3 hold the platform in each pose:
                    P ->   / `.      three inputs for three freedoms
                          B3--B2

    Parameters
    ----------
    side, theta1, ..., prolongation : of `rod_platform_driven.solve`
    input1, input2, input3 : q [m or rad] of the equilibrium that `mode` counts
    nodes : along each axis, 5 to 201

    Returns
    -------
    Chart
        As `rod_maps.workspace`, over x, y [m]: det(dq/dP) of all three freedoms [m/rad, or
        rad^2/m^2 for motors], and the stiffness against forces on a platform that may turn [N/m].

    Raises
    ------
    ValueError
        As `rod_platform_driven.solve`, and for too few or too many nodes.

    Notes
    -----
    The window is one rod and half a platform wide to all sides; guides have no ends.  Pérez Gámiz
    2018 has such maps as figures only, without numbers.

    Examples
    --------
    >>> turns = {f"{name}{k}": turn for name in ("theta", "guide")
    ...          for k, turn in enumerate(np.radians([0.0, 120.0, -120.0]), 1)}
    >>> chart = constant_orientation(side=0.5, **turns, nodes=5)
    >>> [panel.field.unit for panel in chart.panels]
    ['m/rad', 'N/m']
    """
    guide = None if guide1 is None or guide2 is None or guide3 is None else (guide1, guide2, guide3)
    problem = Problem(side, radius, length, stiffness, (theta1, theta2, theta3), guide,
                      (input1, input2, input3), (force_x, force_y, moment), inflections)
    start = standing(problem, mode, prolongation)
    chart = over_poses(start, sheet(start, nodes), "rad²/m²" if guide is None else "m/rad")
    return Chart(chart.x, chart.y, chart.panels,
                 f"The platform held at {np.degrees(start.pose[2]):.4g}°. {chart.caption}", True)
