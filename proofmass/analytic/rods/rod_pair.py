"""Two clamped rods with their tips on one pin (2RFR), at rest under a dead load.

The charts show all equilibria at given motor angles and load; the maps show the workspace, the
singularities and the stiffness.
"""

from itertools import count
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike, NDArray

from proofmass.analytic.chart import MAX_PANELS, Chart, ChartLine, Panel, line_through
from proofmass.analytic.numerics import check_not_negative, check_number, check_positive
from proofmass.analytic.protocol import (
    Angle,
    BendingStiffness,
    ClosedForm,
    Domain,
    Force,
    GuessedForce,
    GuessedMoment,
    GuessedPosition,
    Length,
    Quantity,
    Reference,
)
from proofmass.analytic.rods.all_equilibria import Solutions, solutions
from proofmass.analytic.rods.assembly import Assembly, assembly
from proofmass.analytic.rods.elastica import arc_lengths, check_stiffness
from proofmass.analytic.rods.equilibrium import RodState, derivatives, solve_direct, state
from proofmass.analytic.rods.workspace import (
    check_nodes,
    connected_edges,
    determinant_field,
    find_rim,
    find_singularities,
    fit_pose_map,
    locus_lines,
    map_equilibria,
    mesh_field,
    mesh_map,
    pose_chart,
    values_through,
)
from proofmass.base.arrays import Array

__all__ = ["equilibria", "motor_angles", "solve", "workspace"]


def make_pair(distance: float, length: float = 1.0, stiffness: float = 1.0) -> Assembly:
    """Two rods with clamps at (-d/2, 0) and (d/2, 0) [m], of length L [m] and EI [N m^2] each."""
    check_not_negative("m", distance=distance)
    check_positive(length=length)
    check_stiffness(stiffness)
    return assembly([[-distance / 2, 0.0], [distance / 2, 0.0]], length=length, stiffness=stiffness)


def find_equilibrium(
    a: Assembly,
    inputs: ArrayLike,
    load: ArrayLike,
    pin: ArrayLike,
    moment: ArrayLike,
    push: ArrayLike,
) -> RodState:
    """The equilibrium that Newton's method finds from a first guess.

    Parameters
    ----------
    a : assembly of `make_pair`
    inputs, load : angles of both clamps [rad]; force on the pin [N]
    pin, moment, push : first guess of the pin [m], the moments at the clamps [N m], and the force
        on the tip of the first rod [N]
    """
    return solve_direct(
        state(
            a,
            inputs=inputs,
            load=load,
            pose=pin,
            moment=moment,
            force=np.array([push, np.subtract(load, push)]),
        )
    )


DRAWN_POINTS = 61  # points of a drawn rod
MAX_SHOWN_DIRECTIONS = 9  # negative directions: equilibria with as many or more share panels


def equilibria(
    *,
    distance: float,
    theta1: float,
    theta2: float,
    force_x: float,
    force_y: float,
    length: float = 1.0,
    stiffness: float = 1.0,
    modes: int = 3,
) -> Chart:
    r"""Chart of all equilibria: stable ones by energy, others by number of negative directions.

    ::

               P --> F        V = U_1 + U_2 - F.P, over all shapes of two rods whose tips meet;
             .' `.            stable: a minimum of V;  unstable: V falls in 1, 2 .. directions,
           _/     \           those with one are saddles between minima
         --@---d---@--

    Parameters
    ----------
    distance : d, between the clamps at (-d/2, 0) and (d/2, 0) [m]
    theta1, theta2 : tangents at the clamps [rad]
    force_x, force_y : F, dead load on the pin [N]
    length, stiffness : L [m], EI [N m^2], of each rod
    modes : largest number of inflections of a rod, its tip included

    Returns
    -------
    Chart
        A line for each equilibrium, from one clamp over the pin to the other.

    Raises
    ------
    ValueError
        As in `proofmass.analytic.rods.all_equilibria`, which also describes how complete the
        equilibria are; no equilibrium.

    Notes
    -----
    Source: Pérez Gámiz 2018, Table 7, which lists two of these, with modes 1 and 1, and neither
    energy nor stability.

    Examples
    --------
    >>> chart = equilibria(distance=0.6, theta1=np.radians(40), theta2=np.radians(60), force_x=0.3,
    ...     force_y=-0.1, stiffness=0.0521860264, modes=1)
    >>> chart.caption.partition(", V")[0]
    '3 equilibria whose rods have up to 1 inflection, the tip included: 3 stable'
    >>> [locus_lines.label for locus_lines in chart.lines][:2]
    ['stable at 0.2416 J, modes 1 and 1', 'stable at 0.78 J, modes 1 and 1']
    """
    found = solutions(
        make_pair(distance, length, stiffness),
        inputs=[theta1, theta2],
        load=[force_x, force_y],
        modes=modes,
    )
    if not len(found):
        raise ValueError(f"no equilibrium with modes up to {modes}")
    panels = tuple(equilibria_panel(found, which) for which in divide_into_panels(found.negative))
    return Chart(
        ("x", "m"), ("y", "m"), panels, format_caption(found, int(modes)), equal_scales=True
    )


def divide_into_panels(negative: NDArray[np.int_]) -> list[NDArray[np.intp]]:
    """Indices of equilibria by panels: a panel has few, of one number of negative directions.

    >>> [which.tolist() for which in divide_into_panels(np.array([0, 1, 1, 0, 1, 1, 1]))]
    [[0, 3], [1, 2, 4], [5, 6]]
    """
    families = [
        np.flatnonzero(np.minimum(negative, MAX_SHOWN_DIRECTIONS) == k)
        for k in range(MAX_SHOWN_DIRECTIONS + 1)
    ]
    for few in count(4):
        panels = [
            part
            for family in families
            if family.size
            for part in np.array_split(family, -(-family.size // few))
        ]
        if len(panels) <= MAX_PANELS:
            return panels
    raise AssertionError("unreachable: a panel may show all of them")


def equilibria_panel(found: Solutions, which: NDArray[np.intp]) -> Panel:
    """Panel of equilibria with one number of negative directions, their pins and clamps."""
    pose, clamp = found.state.pose[which], found.state.assembly.clamp
    ways = min(int(found.negative[which[0]]), MAX_SHOWN_DIRECTIONS)
    lines = [posture_line(found, int(i), rank) for rank, i in enumerate(which, 1)]
    lines.append(ChartLine(pose[:, 0], pose[:, 1], "pin", ways == 0, points=True))
    lines.append(line_through(clamp, "clamps", points=True))
    if not ways:
        return Panel(tuple(lines), title="Stable")
    ends = dict.fromkeys(f"{V:.3g}" for V in found.potential[which[[0, -1]]])
    return Panel(tuple(lines), title=f"Falls in {format_directions(ways)}: {' to '.join(ends)} J")


def posture_line(found: Solutions, i: int, rank: int) -> ChartLine:
    """Chart line of equilibrium number `i`: both rods, from clamp to clamp."""
    x, y = (
        np.append(one[0], one[1, -2::-1])
        for one in found.state[i].shape(np.linspace(0.0, 1.0, DRAWN_POINTS))[:2]
    )
    if found.negative[i]:
        return ChartLine(x, y, f"unstable, no. {rank} in its panel", stable=False)
    modes = " and ".join(map(str, found.modes[i]))
    return ChartLine(x, y, f"stable at {found.potential[i]:.4g} J, modes {modes}")


def format_directions(ways: int) -> str:
    """A number of directions, as text; `MAX_SHOWN_DIRECTIONS` stands for more as well.

    >>> format_directions(1), format_directions(2), format_directions(MAX_SHOWN_DIRECTIONS)
    ('1 direction', '2 directions', '9 or more directions')
    """
    return f"{ways}{' or more' * (ways == MAX_SHOWN_DIRECTIONS)} direction{'s' * (ways > 1)}"


def format_caption(found: Solutions, modes: int) -> str:
    """Text with the numbers of stable and unstable equilibria and their energies V."""
    stable = found.potential[found.negative == 0]
    words = [
        f"{len(found)} equilibria whose rods have up to {modes} inflection"
        f"{'s' * (modes > 1)}, the tip included: {stable.size} stable"
    ]
    if stable.size:
        words.append(f", V = {', '.join(f'{V:.4g}' for V in stable)} J")
    ways = np.minimum(found.negative, MAX_SHOWN_DIRECTIONS)
    for k in np.unique(ways[ways > 0]).tolist():
        fallen = found.potential[ways == k]
        words.append(
            f"; {fallen.size} that fall in {format_directions(k)}, the lowest at {fallen[0]:.4g} J"
        )
    limit = (
        f"By proof, no rod of any other carries more than R = {found.bound:.3g}² EI/L², up to "
        "which all were searched for"
        if found.is_bounded
        else f"Searched up to R = {found.up_to:.3g}² EI/L² on each rod"
    )
    return f"{''.join(words)}. V is the energy of bending less F·P. {limit}."


def workspace(
    *,
    distance: float,
    theta1: float,
    theta2: float,
    force_x: float,
    force_y: float,
    pin_x: float,
    pin_y: float,
    moment1: float,
    moment2: float,
    push_x: float,
    push_y: float,
    length: float = 1.0,
    stiffness: float = 1.0,
    nodes: int = 25,
) -> Chart:
    r"""Chart of the poses that are reached from the case's equilibrium by turning the motors.

    ::

           .-~~~-.         rim: inverse singularity, dP/dq singular; no motor moves the pin further
          / +  +  \        inside: direct singularity, dq/dP singular, det K = 0; the pin snaps
         | + S--.  |
         |+ + \ -`.|       det(dq/dP) = -det8_FK/det8_IK,  q = (theta1, theta2),  P = (x, y)
          \____`-._/

    Parameters
    ----------
    distance, theta1, theta2, force_x, force_y, pin_x, pin_y : of `solve` [m, rad, N]
    moment1, moment2, push_x, push_y, length, stiffness : of `solve` [N m, N, m, N m^2]; all poses
        have the load of that equilibrium and are reached from it
    nodes : along each axis, 5 to 201

    Returns
    -------
    Chart
        Panels over x, y [m]: det(dq/dP) [rad^2/m^2]; the least eigenvalue of K [N/m], on the aspect
        of the equilibrium, whose poses are reached without a singularity; both motor angles [rad].

    Raises
    ------
    ValueError
        As `rod_pair.solve`, and for too few or too many nodes.

    Notes
    -----
    The equilibrium manifold ends at its inverse singularities and continues beyond direct ones,
    which the motors cannot pass because the pin jumps there.  Where the manifold lies over itself,
    a node shows the part that was reached first, and the fields have a white tear between two
    parts.  Singularities are named as in the text of Pérez Gámiz 2018 (eqs 99, 102); its program
    (text lines 3160-3495) has the names the other way round: it calls zeros of det(dq/dP) inverse
    and zeros of det(dP/dq) forward singularities.  The source has these maps as figures only.
    Aspect: D. Chablat and P. Wenger, IEEE Int. Conf. Robotics and Automation 1998.

    Examples
    --------
    >>> chart = workspace(distance=0.6, theta1=np.pi / 3, theta2=2 * np.pi / 3, force_x=0.0,
    ...     force_y=0.0, pin_x=0.0, pin_y=0.9, moment1=0.5, moment2=-0.5, push_x=-0.5, push_y=0.0,
    ...     nodes=5)
    >>> [equilibria_panel.field.unit for equilibria_panel in chart.panels]
    ['rad²/m²', 'N/m', 'rad', 'rad']
    """
    start = find_equilibrium(
        make_pair(distance, length, stiffness),
        [theta1, theta2],
        [force_x, force_y],
        [pin_x, pin_y],
        [moment1, moment2],
        [push_x, push_y],
    )
    return pose_chart(start, fit_pose_map(start, nodes), "rad²/m²")


def motor_angles(
    *,
    distance: float,
    theta1: float,
    theta2: float,
    force_x: float,
    force_y: float,
    pin_x: float,
    pin_y: float,
    moment1: float,
    moment2: float,
    push_x: float,
    push_y: float,
    length: float = 1.0,
    stiffness: float = 1.0,
    span: float = np.pi,
    nodes: int = 25,
) -> Chart:
    r"""Chart of the motor angles to which the case's equilibrium can be followed before it folds.

    ::

        theta2 .---------.
               | + / - .-|        rim: direct singularity, det K = 0, where two equilibria meet
               |+ S / /  |        inside: inverse singularity, which the motors can pass
               |_+_/_/___|
                   theta1         det(dP/dq) = -det8_IK/det8_FK

    Parameters
    ----------
    distance, theta1, theta2, force_x, force_y, pin_x, pin_y : of `workspace` [m, rad, N]
    moment1, moment2, push_x, push_y, length, stiffness : of `workspace` [N m, N, m, N m^2]
    span : width of the window about the case's angles [rad]
    nodes : along each axis, 5 to 201

    Returns
    -------
    Chart
        Panels over theta1, theta2 [rad]: det(dP/dq) [m^2/rad^2], and x and y of the pin [m].

    Raises
    ------
    ValueError
        As `workspace`, and for a window without width.

    Examples
    --------
    >>> chart = motor_angles(distance=0.6, theta1=np.pi / 3, theta2=2 * np.pi / 3, force_x=0.0,
    ...     force_y=0.0, pin_x=0.0, pin_y=0.9, moment1=0.5, moment2=-0.5, push_x=-0.5, push_y=0.0,
    ...     span=0.5, nodes=5)
    >>> [locus_lines.label for locus_lines in chart.panels[0].lines]
    ['inverse singularity', 'here']
    """
    check_positive(span=span)
    check_nodes(nodes)
    start = find_equilibrium(
        make_pair(distance, length, stiffness),
        [theta1, theta2],
        [force_x, force_y],
        [pin_x, pin_y],
        [moment1, moment2],
        [push_x, push_y],
    )
    m = map_equilibria(
        start,
        *(values_through(q, q - span / 2, q + span / 2, nodes) for q in start.inputs),
        name="inputs",
    )
    ends, ways = find_rim(m)
    inverse = find_singularities(m, "inverse", (ends, ways))
    mesh = mesh_map(m, connected_edges(m)[0], ends, inverse)
    lines = (
        *locus_lines(m, ends, "direct singularity"),
        *locus_lines(m, inverse, "inverse singularity"),
        ChartLine(start.inputs[:1], start.inputs[1:], "here", points=True),
    )
    whole = mesh.triangles(m.reached)
    slopes = derivatives(m.states).direct, derivatives(mesh.ends).direct
    panels = [
        Panel(lines, determinant_field(mesh, *slopes, "det(dP/dq)", "m²/rad²"), "Singularities")
    ]
    for k, name in enumerate(("x", "y")):
        values = mesh.values(m.states.pose[..., k], mesh.ends.pose[:, k], inverse.pose[:, k])
        panels.append(
            Panel(lines, mesh_field(mesh, values, f"{name} of the pin", "m", whole), f"Pin: {name}")
        )
    return Chart(
        ("theta1", "rad"),
        ("theta2", "rad"),
        tuple(panels),
        f"Motor angles to which this equilibrium can be followed, {m.reached.mean():.0%} "
        "of the window. At a direct singularity the equilibrium ends and the pin jumps; in "
        "an inverse singularity the motors cannot move the pin in some direction. Where "
        "contours break off, there are several equilibria: the path of the motors selects "
        "one of them.",
    )


def solve(
    s: ArrayLike,
    *,
    distance: float,
    theta1: float,
    theta2: float,
    force_x: float,
    force_y: float,
    pin_x: float,
    pin_y: float,
    moment1: float,
    moment2: float,
    push_x: float,
    push_y: float,
    length: float = 1.0,
    stiffness: float = 1.0,
) -> dict[str, Array]:
    r"""Shapes of both rods at arc lengths `s` from their clamps.

    ::

               P --> F            clamps at (-d/2, 0) and (d/2, 0), at angles theta1 and theta2
             .' `.                n_1 + n_2 = F,  m(L) = 0 in both rods
           _/     \
         --@---d---@--

    Parameters
    ----------
    s : [m], in [0, length]  (...)
    distance : d, between the clamps [m]
    theta1, theta2 : tangents at the clamps [rad]
    force_x, force_y : F, dead load on the pin [N]
    pin_x, pin_y : first guess of the pin P [m]; together with the next two lines it selects one of
        the equilibria
    moment1, moment2 : first guess of the moments at the clamps [N m]
    push_x, push_y : first guess of the force n_1 on the tip of the first rod [N]
    length, stiffness : L [m], EI [N m^2], of each rod

    Returns
    -------
    dict of (...) arrays: x1, y1 [m], t1 [rad], m1 [N m] along the first rod, x2, ... along the
    second; and, the same at all arc lengths, pin_x, pin_y [m], hold1, hold2, the moments [N m] on
    the clamps that keep them at rest, and energy of bending [J].

    Raises
    ------
    ValueError
        A parameter out of its domain, clamps out of reach, or a guess from which Newton's method
        finds no equilibrium.

    Notes
    -----
    The error is below 1e-9 L.  Source: Pérez Gámiz 2018, eqs 98-102 and Table 7, where the second
    clamp must be at (0.3, 0), not at (0, 0.3) as printed.

    Examples
    --------
    The lowest of the equilibria at the inputs of Table 7, which it does not list:

    >>> both = solve([0.5, 1.0], distance=0.6, theta1=np.radians(40), theta2=np.radians(60),
    ...     force_x=0.3, force_y=-0.1, stiffness=0.0521860264, pin_x=0.19, pin_y=0.86,
    ...     moment1=0.086, moment2=-0.025, push_x=0.19, push_y=0.51)
    >>> [round(float(both[name][-1]), 5) for name in ("x1", "y1", "x2", "y2")]
    [0.18884, 0.86287, 0.18884, 0.86287]
    """
    a, arc = make_pair(distance, length, stiffness), arc_lengths(s, length)
    check_number(theta1=theta1, theta2=theta2, force_x=force_x, force_y=force_y)
    check_number(pin_x=pin_x, pin_y=pin_y, moment1=moment1, moment2=moment2)
    check_number(push_x=push_x, push_y=push_y)
    found = find_equilibrium(
        a,
        [theta1, theta2],
        [force_x, force_y],
        [pin_x, pin_y],
        [moment1, moment2],
        [push_x, push_y],
    )
    known: dict[str, Array] = {}
    for name, rods in zip("xytm", found.shape(arc.ravel() / length), strict=True):
        known |= {f"{name}{k}": rod.reshape(arc.shape) for k, rod in enumerate(rods, 1)}
    ends = {
        "pin_x": found.pose[0],
        "pin_y": found.pose[1],
        "hold1": -found.moment[0],
        "hold2": -found.moment[1],
        "energy": found.energy.sum(),
    }
    return known | {name: np.full(arc.shape, value) for name, value in ends.items()}


class PairParameters(Reference):
    """The sizes of two rods on one pin, and the first guess that chooses their equilibrium."""

    distance: Annotated[float, Quantity("m", Domain.NOT_NEGATIVE)]
    pin_x: GuessedPosition
    pin_y: GuessedPosition
    moment1: GuessedMoment
    moment2: GuessedMoment
    push_x: GuessedForce
    push_y: GuessedForce
    length: Length
    stiffness: BendingStiffness


class RodPair(PairParameters, ClosedForm, function=solve):
    """Two clamped rods with their tips on one pin (2RFR), at rest under a dead load."""

    method = "solver of the elastica between a clamp and a common pin"
    charts = (
        equilibria,
        motor_angles,
        workspace,
    )

    theta1: Angle
    theta2: Angle
    force_x: Force
    force_y: Force
