"""Maps of two clamped rods on one pin (2RFR): workspace, singularities and stiffness."""

import numpy as np

from proofmass.analytic.chart import Chart, Line, Panel
from proofmass.analytic.numerics import positive
from proofmass.analytic.rods.derivatives import derivatives
from proofmass.analytic.rods.pair import at_rest, pair
from proofmass.analytic.rods.rod_sheets import (
    field,
    joined,
    line,
    over_poses,
    rim,
    several,
    sheet,
    through,
)
from proofmass.analytic.rods.workspace import loci, spread


def workspace(
    *, distance: float, theta1: float, theta2: float, force_x: float, force_y: float,
    pin_x: float, pin_y: float, moment1: float, moment2: float, push_x: float, push_y: float,
    length: float = 1.0, stiffness: float = 1.0, nodes: int = 25,
) -> Chart:
    r"""The sheet of poses that are reached from the case's equilibrium by turning the motors.

    ::

           .-~~~-.         rim: inverse singularity, dP/dq singular; no motor moves the pin on
          / +  +  \        inside: direct singularity, dq/dP singular, det K = 0; the pin gives way
         | + S--.  |
         |+ + \ -`.|       det(dq/dP) = -det8_FK/det8_IK,  q = (theta1, theta2),  P = (x, y)
          \____`-._/

    Parameters
    ----------
    distance, theta1, theta2, force_x, force_y, pin_x, pin_y, moment1, moment2, push_x, push_y,
    length, stiffness : of `rod_pair.solve`; the sheet has its load and goes through its equilibrium
    nodes : along each axis, 5 to 201

    Returns
    -------
    Chart
        Two panels over x, y [m]: det(dq/dP) [rad^2/m^2]; and the least eigenvalue of K [N/m], on
        the aspect of the equilibrium: what no singularity parts from it.

    Raises
    ------
    ValueError
        As `rod_pair.solve`, and for too few or too many nodes.

    Notes
    -----
    A sheet ends at its inverse singularities and passes direct ones: motors cannot, the pin jumps
    there.  Where a sheet lies over itself, a node shows the part that was reached first, and the
    fields have a white tear between two parts.  Singularities are named as in the text of Pérez
    Gámiz 2018 (eqs 99, 102); its program (text lines 3160-3495) calls zeros of det(dq/dP) inverse
    and zeros of det(dP/dq) forward singularities, which is the other way round.  It has these maps
    as figures only.  Aspect: D. Chablat and P. Wenger, IEEE Int. Conf. Robotics and Automation
    1998.

    Examples
    --------
    >>> chart = workspace(distance=0.6, theta1=np.pi / 3, theta2=2 * np.pi / 3, force_x=0.0,
    ...     force_y=0.0, pin_x=0.0, pin_y=0.9, moment1=0.5, moment2=-0.5, push_x=-0.5, push_y=0.0,
    ...     nodes=5)
    >>> [panel.field.unit for panel in chart.panels]
    ['rad²/m²', 'N/m']
    """
    start = at_rest(pair(distance, length, stiffness), [theta1, theta2], [force_x, force_y],
                    [pin_x, pin_y], [moment1, moment2], [push_x, push_y])
    return over_poses(start, sheet(start, nodes), "rad²/m²")


def motor_angles(
    *, distance: float, theta1: float, theta2: float, force_x: float, force_y: float,
    pin_x: float, pin_y: float, moment1: float, moment2: float, push_x: float, push_y: float,
    length: float = 1.0, stiffness: float = 1.0, span: float = np.pi, nodes: int = 25,
) -> Chart:
    r"""How far the motors turn before the case's equilibrium folds and the pin jumps.

    ::

        theta2 .---------.
               | + / - .-|        rim: direct singularity, det K = 0, where two equilibria meet
               |+ S / /  |        inside: inverse singularity, which motors pass
               |_+_/_/___|
                   theta1         det(dP/dq) = -det8_IK/det8_FK

    Parameters
    ----------
    distance, ..., stiffness : of `workspace`
    span : width of the window about the case's angles [rad]
    nodes : along each axis, 5 to 201

    Returns
    -------
    Chart
        One panel over theta1, theta2 [rad]: det(dP/dq) [m^2/rad^2].

    Raises
    ------
    ValueError
        As `workspace`, and for a window without width.

    Examples
    --------
    >>> chart = motor_angles(distance=0.6, theta1=np.pi / 3, theta2=2 * np.pi / 3, force_x=0.0,
    ...     force_y=0.0, pin_x=0.0, pin_y=0.9, moment1=0.5, moment2=-0.5, push_x=-0.5, push_y=0.0,
    ...     span=0.5, nodes=5)
    >>> [line.label for line in chart.panels[0].lines]
    ['inverse singularity', 'here']
    """
    positive(span=span)
    several(nodes)
    start = at_rest(pair(distance, length, stiffness), [theta1, theta2], [force_x, force_y],
                    [pin_x, pin_y], [moment1, moment2], [push_x, push_y])
    m = spread(start, *(through(q, q - span / 2, q + span / 2, nodes) for q in start.inputs),
               name="inputs")
    lines = (*line(m, rim(m)[0], "direct singularity"),
             *line(m, loci(m, "inverse"), "inverse singularity"),
             Line(start.inputs[:1], start.inputs[1:], "here", points=True))
    slopes, (_, torn) = derivatives(m.states).direct, joined(m)
    panel = Panel(lines, field(m, torn, slopes, "det(dP/dq)", "m²/rad²"))
    return Chart(("theta1", "rad"), ("theta2", "rad"), (panel,),
                 f"Motor angles that this equilibrium can be followed to, {m.reached.mean():.0%} "
                 "of the window. Beyond a direct singularity it is gone and the pin jumps; in an "
                 "inverse singularity the motors cannot move the pin in some direction. White "
                 "bands part equilibria: which one is there depends on the way.")
