"""Charts of a 3PRR robot: workspace, poses by mode of the legs, and singular poses.

All charts take the lengths of `solve`.
"""

from collections.abc import Iterable
from dataclasses import asdict

import numpy as np

from proofmass.analytic.chart import LINE_BREAK, Chart, ChartLine, Field, Panel, line_through
from proofmass.analytic.linkages.regions import chart_regions
from proofmass.analytic.linkages.threeprr.kinematics import (
    GUIDE_DIRECTIONS,
    SIGNS,
    UNIT_CORNERS,
    WORKING_MODES,
    leg_vectors,
    poses,
    solve_inverse,
)
from proofmass.analytic.linkages.threeprr.maps import (
    RobotLengths,
    WorkspaceSlice,
    angles_of_place,
    aspects_of_slice,
    reach_area_of_place,
    reach_of_place,
    type_2_of_slice,
    volume,
)
from proofmass.analytic.numerics import TURN
from proofmass.base.arrays import Array, Complex

POSITION_AXES = (("x", "m"), ("y", "m"))
SIGN_LABELS = {1: "singularity measure > 0", -1: "singularity measure < 0"}
GUIDE_OVERHANG = 0.3
"""Length of guides drawn beyond sliders and platform, as a share of the side."""


def workspace(
    *,
    side: float,
    leg: float,
    guide2_x: float,
    guide3_x: float,
    guide3_y: float,
    nodes: int = 161,
) -> Chart:
    r"""Measure of the angles that the platform can have with P at each point of the plane.

    ::

        |y| <= L,  |y + a sin(psi)| <= L,  |x + a cos(psi + 60 deg) - guide3_x| <= L

    Lines bound the points that P reaches at some angle, and those that P reaches at every angle.

    Parameters
    ----------
    side, leg : a, L [m]
    guide2_x, guide3_x, guide3_y : starting points of guides 2 and 3 [m]
    nodes : number of nodes of the map along each axis

    Returns
    -------
    Chart

    Raises
    ------
    ValueError
        A value out of its domain; nodes not within [5, 401].

    Notes
    -----
    The measure of the angles is exact at each node, and so is its integral, 8 L (pi L - a) if
    a <= 2 L; the area is integrated with a relative error below 1e-8.  The sliders have no joint
    limits.  Therefore guide3_x shifts the chart, and guide2_x and guide3_y do not change it.

    Examples
    --------
    >>> chart = workspace(side=1.0, leg=1.0, guide2_x=3.0, guide3_x=2.0, guide3_y=2.0)
    >>> chart.caption.split(";")[0]
    'P reaches 7.65757 m² at some angle of the platform'
    """
    if not 5 <= nodes <= 401:
        raise ValueError(f"nodes must lie within [5, 401], got {nodes}")
    robot = RobotLengths(side, leg, guide2_x, guide3_x, guide3_y)
    x = guide3_x + (side + leg) * np.linspace(-1.0, 1.0, nodes)
    y = leg * np.linspace(-1.0, 1.0, nodes)
    angles = angles_of_place(x[:, None], y, robot)
    angles[angles == 0.0] = np.nan
    heights = leg * np.cos(np.linspace(np.pi, 0.0, 721))
    rims = reach_of_place(heights, robot)
    lines = [
        ChartLine(
            np.append(left, right[::-1]), np.append(heights, heights[::-1]), "reached at some angle"
        )
        for left, right in rims.transpose(1, 2, 0)
        if np.isfinite(left).any()
    ]
    words = "no place of P is reached at every angle"
    if side < leg:
        half_side = leg - side
        corners = (
            np.array([-1.0 - 1.0j, 1.0 - 1.0j, 1.0 + 1.0j, -1.0 + 1.0j, -1.0 - 1.0j]) * half_side
        )
        lines.append(
            line_through(np.asarray(guide3_x + corners, complex), "reached at every angle")
        )
        words = f"{4.0 * half_side**2:.6g} m² at every angle"
    field = Field(x, y, angles, "angles of the platform", "rad")
    return Chart(
        *POSITION_AXES,
        (Panel(tuple(lines), field),),
        f"P reaches {reach_area_of_place(robot):.6g} m² at some angle of the platform; {words}. "
        f"Slices at one angle have {volume(robot) / TURN:.6g} m² in the mean, "
        f"{describe_slices(robot)}. The mean is exact.",
        equal_scales=True,
    )


def describe_slices(robot: RobotLengths) -> str:
    """Smallest and largest area of a slice, in words."""
    least = 2.0 * robot.leg * max(0.0, 2.0 * robot.leg - robot.side)
    return f"from {least:.6g} m² at 90° to {4.0 * robot.leg**2:.6g} m² at 0°"


def slice_area(
    *, side: float, leg: float, guide2_x: float, guide3_x: float, guide3_y: float
) -> Chart:
    """Area of the slice of the workspace over the angle of the platform, 2 L (2 L - a |sin psi|).

    Parameters
    ----------
    side, leg : a, L [m]
    guide2_x, guide3_x, guide3_y : starting points of guides 2 and 3 [m]

    Returns
    -------
    Chart

    Examples
    --------
    >>> chart = slice_area(side=1.0, leg=1.0, guide2_x=3.0, guide3_x=2.0, guide3_y=2.0)
    >>> [round(float(chart.lines[0].y[k]), 9) for k in (0, 90)]
    [4.0, 2.0]
    """
    robot = RobotLengths(side, leg, guide2_x, guide3_x, guide3_y)
    psi = np.linspace(0.0, TURN, 361)
    area = np.array([WorkspaceSlice(robot, one).area for one in psi.tolist()])
    return Chart(
        ("angle of the platform", "rad"),
        ("area of the slice", "m²"),
        (Panel((ChartLine(psi, area),)),),
        f"{describe_slices(robot).capitalize()}; {volume(robot) / TURN:.6g} m² in the mean. "
        "Exact: at one angle P reaches a rectangle.",
    )


def workspace_slice(
    *, side: float, leg: float, guide2_x: float, guide3_x: float, guide3_y: float, psi: float
) -> Chart:
    """Slice of the workspace at one angle, with singularities and aspects in each mode of the legs.

    Parameters
    ----------
    side, leg : side of the platform; length of each leg [m]
    guide2_x, guide3_x, guide3_y : starting points of guides 2 and 3 [m]
    psi : angle of the platform [rad]

    Returns
    -------
    Chart
        A panel for each of the eight modes of the legs, whose regions are the aspects with their
        areas.

    Raises
    ------
    ValueError
        As in `aspects_of_slice`, or no point is reached at this angle.

    Notes
    -----
    The border is exact; the curves inside are closed forms, x for each y, whose areas are
    integrated with an error below 1e-9 of the whole.

    Examples
    --------
    >>> chart = workspace_slice(side=1.0, leg=1.0, guide2_x=3.0, guide3_x=2.0, guide3_y=2.0,
    ...                         psi=np.pi / 6)
    >>> [panel.title for panel in chart.panels][:2]
    ['legs +++: 2.55 + 0.3465 + 0.1037 m²', 'legs ++-: 2.55 + 0.3465 + 0.1037 m²']
    """
    robot = RobotLengths(side, leg, guide2_x, guide3_x, guide3_y)
    part = WorkspaceSlice(robot, psi)
    if part.area == 0.0:
        raise ValueError(f"no place is reached at psi = {psi:.6g} rad")
    (left, right), (low, high) = part.x, part.y
    across = np.array([left, right, LINE_BREAK.real, left, right])
    up = np.array([low, high, LINE_BREAK.real, low, high])
    edges = (
        ChartLine(
            across, np.array([low, low, LINE_BREAK.real, high, high]), "type 1: leg 1 or 2 upright"
        ),
        ChartLine(np.array([left, left, LINE_BREAK.real, right, right]), up, "type 1: leg 3 level"),
    )
    panels = []
    for mode in WORKING_MODES:
        found = aspects_of_slice(part, mode)
        curves = np.concatenate(
            [np.append(one.points, LINE_BREAK) for one in type_2_of_slice(part, mode)]
        )
        areas = [one.area for some in found.values() for one in some]
        shown = sorted((area for area in areas if area > 5e-5 * part.area), reverse=True)
        panels.append(
            Panel(
                (*edges, line_through(curves, "type 2")),
                title=f"legs {leg_signs(mode)}: {' + '.join(f'{area:.4g}' for area in shown)} m²",
                regions=chart_regions(found, SIGN_LABELS),
            )
        )
    return Chart(
        *POSITION_AXES,
        tuple(panels),
        f"P reaches {part.area:.6g} m² with the platform at {np.degrees(psi):.4g}°, exactly, in "
        "each of eight modes of the legs. A sign is + where the platform's corner is ahead of its "
        "slider. On the edges a leg is perpendicular to its guide, type 1; on type 2 curves the "
        "lines of all legs meet in one point, and the platform can move although the sliders are "
        "fixed. Numbers are areas of the aspects, with an error below 1e-9 m².",
        equal_scales=True,
    )


def leg_signs(mode: int) -> str:
    """Signs of a mode of the legs.

    >>> leg_signs(3)
    '+-+'
    """
    return "".join("+" if one > 0 else "-" for one in SIGNS[mode - 1])


def robot_lines(
    robot: RobotLengths, point: complex, psi: float, sliders: Array
) -> tuple[ChartLine, ...]:
    """Lines of platform, legs, sliders and P in one pose."""
    arms = robot.side * UNIT_CORNERS[:, 0] * np.exp(1j * psi)
    corners = point + arms
    feet = slider_points(robot, sliders)
    both = np.stack([feet, corners, np.full(3, LINE_BREAK)], axis=1).ravel()[:-1]
    ring = np.append(corners, corners[:1])
    return (
        line_through(ring, "platform", bars=True),
        line_through(both, "legs", bars=True),
        line_through(feet, "sliders", points=True),
        line_through(np.array([point]), "P", points=True),
    )


def add_guides(robot: RobotLengths, panels: Iterable[Panel]) -> tuple[Panel, ...]:
    """Panels with the lines of the guides, which extend over all lines of all panels."""
    given = tuple(panels)
    x, y = (
        np.concatenate([getattr(line, axis) for panel in given for line in panel.lines])
        for axis in ("x", "y")
    )
    x, y = np.append(x, robot.guide3_x), np.append(y, 0.0)
    overhang = GUIDE_OVERHANG * robot.side
    left, right = np.nanmin(x) - overhang, np.nanmax(x) + overhang
    low, high = np.nanmin(y) - overhang, np.nanmax(y) + overhang
    guides = ChartLine(
        np.array([left, right, np.nan, robot.guide3_x, robot.guide3_x]),
        np.array([0.0, 0.0, np.nan, low, high]),
        "guides",
        stable=False,
    )
    return tuple(Panel((*panel.lines, guides), title=panel.title) for panel in given)


def leg_modes(
    *,
    side: float,
    leg: float,
    guide2_x: float,
    guide3_x: float,
    guide3_y: float,
    x: float,
    y: float,
    psi: float,
) -> Chart:
    """The eight modes of the legs for one pose of the platform.

    Parameters
    ----------
    side, leg : side of the platform; length of each leg [m]
    guide2_x, guide3_x, guide3_y : starting points of guides 2 and 3 [m]
    x, y, psi : pose of the platform [m], [rad]

    Returns
    -------
    Chart

    Raises
    ------
    ValueError
        The pose is out of reach.

    Examples
    --------
    >>> chart = leg_modes(side=1.0, leg=1.0, guide2_x=3.0, guide3_x=1.5, guide3_y=2.0,
    ...                   x=0.6, y=0.4, psi=0.0)
    >>> chart.panels[7].title
    'legs ---: sliders at 1.517, 2.317, 1.65 m'
    """
    robot = RobotLengths(side, leg, guide2_x, guide3_x, guide3_y)
    panels = []
    for mode in WORKING_MODES:
        sliders = slider_positions(robot, complex(x, y), psi, mode)
        panels.append(
            Panel(
                robot_lines(robot, complex(x, y), psi, sliders),
                title=f"legs {leg_signs(mode)}: "
                f"sliders at {', '.join(f'{s:.4g}' for s in sliders)} m",
            )
        )
    return Chart(
        *POSITION_AXES,
        add_guides(robot, panels),
        f"Eight triples of sliders give P the position ({x:g}, {y:g}) m with the platform at "
        f"{np.degrees(psi):.4g}°: each leg may lean in the direction of its guide, +, or against "
        "it, -.",
        equal_scales=True,
    )


def direct_poses(
    *,
    side: float,
    leg: float,
    guide2_x: float,
    guide3_x: float,
    guide3_y: float,
    slider_1: float,
    slider_2: float,
    slider_3: float,
) -> Chart:
    """All poses of the platform, up to six, for given positions of the three sliders.

    Parameters
    ----------
    side, leg : side of the platform; length of each leg [m]
    guide2_x, guide3_x, guide3_y : starting points of guides 2 and 3 [m]
    slider_1, slider_2, slider_3 : positions of the sliders on their guides [m]

    Returns
    -------
    Chart

    Raises
    ------
    ValueError
        There is no pose, or the platform is free to move.

    Examples
    --------
    >>> chart = direct_poses(side=1.0, leg=1.0, guide2_x=3.0, guide3_x=2.5, guide3_y=2.8,
    ...                      slider_1=2.0, slider_2=0.5, slider_3=0.2)
    >>> [panel.title for panel in chart.panels]
    ['psi = -14.3794°, measure 1.006', 'psi = 7.1679°, measure -1.018']
    """
    robot = RobotLengths(side, leg, guide2_x, guide3_x, guide3_y)
    sliders = np.array([slider_1, slider_2, slider_3])
    found = poses(sliders, **asdict(robot))
    pose_rows = np.flatnonzero(np.isfinite(found["psi"]))
    if not pose_rows.size:
        raise ValueError(f"no pose at sliders ({slider_1:g}, {slider_2:g}, {slider_3:g}) m")
    panels = [
        Panel(
            robot_lines(
                robot, complex(found["x"][k], found["y"][k]), float(found["psi"][k]), sliders
            ),
            title=f"psi = {np.degrees(found['psi'][k]):.4f}°, "
            f"measure {found['singularity'][k]:.4g}",
        )
        for k in pose_rows
    ]
    return Chart(
        *POSITION_AXES,
        add_guides(robot, panels),
        f"The platform has {pose_rows.size} poses with the sliders at {slider_1:g}, {slider_2:g} "
        f"and {slider_3:g} m, all real roots of a sextic, so that there are at most six. The "
        "singularity measure is zero where two poses meet.",
        equal_scales=True,
    )


def singular_poses(
    *, side: float, leg: float, guide2_x: float, guide3_x: float, guide3_y: float, psi: float
) -> Chart:
    """One pose of each kind of singularity at one angle of the platform.

    Parameters
    ----------
    side, leg : side of the platform; length of each leg [m]
    guide2_x, guide3_x, guide3_y : starting points of guides 2 and 3 [m]
    psi : angle of the platform [rad]

    Returns
    -------
    Chart

    Raises
    ------
    ValueError
        No point is reached at this angle.

    Examples
    --------
    >>> chart = singular_poses(side=1.0, leg=1.0, guide2_x=3.0, guide3_x=2.5, guide3_y=2.8, psi=0.4)
    >>> [panel.title for panel in chart.panels][3:]
    ['type 2, legs +++: lines meet in one point', 'type 2, legs -+-: lines meet in one point']
    """
    robot = RobotLengths(side, leg, guide2_x, guide3_x, guide3_y)
    part = WorkspaceSlice(robot, psi)
    if part.area == 0.0:
        raise ValueError(f"no place is reached at psi = {psi:.6g} rad")
    rise = float(part.arms[1].imag)
    middle, height = float(np.mean(part.x)), float(np.mean(part.y))
    upright = leg if rise <= 0.0 else -leg
    kinds = [
        ("type 1: leg 1 perpendicular to its guide", middle + 1j * upright, 1),
        ("type 1: leg 2 perpendicular to its guide", middle - 1j * (upright + rise), 1),
        ("type 1: leg 3 perpendicular to its guide", part.x[1] + 1j * height, 1),
    ]
    panels = [
        Panel(pose_lines(robot, complex(place), psi, mode), title=title)
        for title, place, mode in kinds
    ]
    for mode in (1, 6):
        curve = max(type_2_of_slice(part, mode), key=lambda one: one.points.size).points
        place = complex(curve[curve.size // 2])
        panels.append(
            Panel(
                (
                    *pose_lines(robot, place, psi, mode),
                    *intersection_lines(robot, place, psi, mode),
                ),
                title=f"type 2, legs {leg_signs(mode)}: lines meet in one point",
            )
        )
    return Chart(
        *POSITION_AXES,
        add_guides(robot, panels),
        "In a type 1 singularity a corner has no velocity along its leg, whatever the sliders do; "
        "in a type 2 singularity the platform turns about the point where the lines of its legs "
        "meet, although all sliders are fixed.",
        equal_scales=True,
    )


def pose_lines(robot: RobotLengths, place: complex, psi: float, mode: int) -> tuple[ChartLine, ...]:
    """Lines of the robot with P at a point, in one mode of the legs."""
    return robot_lines(robot, place, psi, slider_positions(robot, place, psi, mode))


def slider_positions(robot: RobotLengths, place: complex, psi: float, mode: int) -> Array:
    """Positions of the sliders (3,) [m] with P at a point, in one mode of the legs."""
    found = solve_inverse([place.real, place.imag, psi], **asdict(robot), mode=mode)
    return np.array([float(found[f"slider_{k}"]) for k in (1, 2, 3)])


def slider_points(robot: RobotLengths, sliders: Array) -> Complex:
    """Points x + iy (3,) of the sliders in the plane [m]."""
    return np.asarray((robot.guide_origins + sliders[:, None] * GUIDE_DIRECTIONS)[:, 0])


def intersection_lines(
    robot: RobotLengths, place: complex, psi: float, mode: int
) -> tuple[ChartLine, ...]:
    """Lines from the platform along the legs to the intersection of those of legs 1 and 2.

    There are none if the legs are nearly parallel, so that the intersection is far away.
    """
    feet = slider_points(robot, slider_positions(robot, place, psi, mode))
    e, arms = leg_vectors(feet[:, None], np.array([place]), np.array([psi]), robot.side)
    p, v = (place + arms)[:, 0], e[:, 0]
    direction_cross = float(np.imag(np.conj(v[0]) * v[1]))
    if abs(direction_cross) < 0.05 * robot.leg**2:
        return ()
    share = float(np.imag(np.conj(p[1] - p[0]) * v[1])) / direction_cross
    point = p[0] + share * v[0]
    z = np.array([p[0], point, LINE_BREAK, p[1], point, LINE_BREAK, p[2], point])
    return (
        line_through(z, "lines of the legs", stable=False),
        line_through(np.array([point]), "where they meet", points=True),
    )
