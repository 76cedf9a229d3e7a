"""Charts of a five-bar linkage: workspace by working mode, poses, and singular poses.

All charts take the lengths of `solve`.
"""

from collections.abc import Iterable
from dataclasses import asdict

import numpy as np

from proofmass.analytic.chart import LINE_BREAK, Chart, ChartLine, Panel, line_through
from proofmass.analytic.linkages.fivebar.kinematics import (
    solve,
    solve_inverse,
    unassembled_share,
)
from proofmass.analytic.linkages.fivebar.maps import (
    WORKING_MODE_PAIRS,
    FivebarLengths,
    SingularPiece,
    aspects,
    reach_area,
    reach_border,
    type_2,
)
from proofmass.analytic.linkages.regions import chart_regions
from proofmass.analytic.numerics import check_finite
from proofmass.base.arrays import Array, Complex

TYPE_1_LABELS = {side: f"type 1: {side} crank and coupler in line" for side in ("left", "right")}
TYPE_2_LABELS = {
    True: "type 2: couplers in line, stretched",
    False: "type 2: couplers in line, folded",
}
ASSEMBLY_LABELS = {1: "assembly +1: tip left of L to R", -1: "assembly -1: tip right of L to R"}
POSITION_AXES = (("x", "m"), ("y", "m"))
LabelledCurve = tuple[Complex, str]
"""Points x + iy of a curve, and its label."""


def workspace(
    *,
    left_crank: float,
    left_coupler: float,
    right_coupler: float,
    right_crank: float,
    left_x: float,
    right_x: float,
    path: tuple[float, ...] = (),
    circle: tuple[float, ...] = (),
) -> Chart:
    r"""Points that the tip reaches in each working mode, with singular curves and aspects.

    The reach is the intersection of two rings about the fixed pins.  On its border a crank and its
    coupler are in line (type 1 singularities).  In each working mode, curves on which the couplers
    are in line (type 2) divide the reach into aspects.

    Parameters
    ----------
    left_crank, left_coupler, right_coupler, right_crank : lengths between pins [m]
    left_x, right_x : positions of the fixed pins on the x axis [m]
    path, circle : a closed path of the tip that is drawn in addition [m]: corners x, y, x, y, ...;
        or centre x, y and radius of a circle

    Returns
    -------
    Chart
        A panel for each of the four working modes, whose regions are the aspects with their areas.

    Raises
    ------
    ValueError
        As in `aspects`; a path with an odd number of coordinates, or a circle without three values.

    Notes
    -----
    The border consists of arcs of circles, whose areas are exact; curves of type 2 are coupler
    curves of a four-bar, whose areas are integrated with an error below 1e-9 of the whole.

    Examples
    --------
    >>> chart = workspace(left_crank=2.0, left_coupler=3.5, right_coupler=4.0, right_crank=1.0,
    ...                   left_x=0.0, right_x=2.0)
    >>> [panel.title for panel in chart.panels][:2]
    ['left +1, right +1: 21.61 + 14.37 m²', 'left +1, right -1: 35.1 + 0.5173 + 0.3621 m²']
    """
    link = FivebarLengths(left_crank, left_coupler, right_coupler, right_crank, left_x, right_x)
    path_lines = path_of_tip(path, circle)
    singular, pins = type_2(link), fixed_pin_markers(link)
    border = [(piece.points, TYPE_1_LABELS[side]) for piece, side in reach_border(link)]
    panels = []
    for mode in WORKING_MODE_PAIRS:
        found = aspects(link, mode, singular)
        inner = [(s.curve.points, TYPE_2_LABELS[s.stretched]) for s in singular if s.mode == mode]
        lines = lines_by_label([*border, *inner])
        areas = sorted((one.area for some in found.values() for one in some), reverse=True)
        panels.append(
            Panel(
                (*lines, *path_lines, pins),
                title=f"{format_mode(mode)}: {' + '.join(f'{area:.4g}' for area in areas)} m²",
                regions=chart_regions(found, ASSEMBLY_LABELS),
            )
        )
    return Chart(
        *POSITION_AXES,
        tuple(panels),
        f"The tip reaches {reach_area(link):.6g} m² in each of the four working modes. Type 1 "
        "singularities bound the reach; type 2 singularities divide it into aspects, in each of "
        "which the tip goes everywhere without a singular pose. L and R are the crank pins. "
        "Numbers are areas of aspects, integrated along their borders with an error below 1e-8 m².",
        equal_scales=True,
    )


def path_of_tip(path: tuple[float, ...], circle: tuple[float, ...]) -> tuple[ChartLine, ...]:
    """Line of a closed path with given corners, or of a circle; no line if both are empty."""
    check_finite(path=path, circle=circle)
    if len(path) % 2:
        raise ValueError(f"path must be pairs x, y, got {len(path)} numbers")
    if len(circle) not in (0, 3):
        raise ValueError(f"circle must be x, y and radius, got {len(circle)} numbers")
    corners = np.reshape(path, (-1, 2)) @ [1.0, 1.0j]
    if circle:
        x, y, radius = circle
        corners = x + 1j * y + radius * np.exp(1j * np.linspace(0.0, 2.0 * np.pi, 121)[:-1])
    closed = np.append(corners, corners[:1])
    return (line_through(closed, "path of the tip"),) if corners.size else ()


def format_mode(mode: tuple[int, int]) -> str:
    """Describe a working mode in words.

    >>> format_mode((1, -1))
    'left +1, right -1'
    """
    return f"left {mode[0]:+d}, right {mode[1]:+d}"


def lines_by_label(curves: Iterable[LabelledCurve]) -> tuple[ChartLine, ...]:
    """One line for all curves of a label, interrupted between them; a marker for a single point."""
    found: dict[tuple[str, bool], list[Complex]] = {}
    for points, label in curves:
        point = bool(np.ptp(points.real) == np.ptp(points.imag) == 0.0)
        found.setdefault((label, point), []).append(
            np.append(points[:1] if point else points, LINE_BREAK)
        )
    return tuple(
        line_through(z, label, points=point)
        for (label, point), parts in found.items()
        for z in [np.concatenate(parts)[:-1]]
    )


def fixed_pin_markers(link: FivebarLengths) -> ChartLine:
    """Markers of both fixed pins."""
    return ChartLine(np.array([link.left_x, link.right_x]), np.zeros(2), "fixed pins", points=True)


def link_lines(
    link: FivebarLengths, left: complex, right: complex, tip: complex, other: complex | None = None
) -> tuple[ChartLine, ...]:
    """Lines of cranks and couplers in one pose; dashed the couplers to the tip `other`, if any."""
    dashed = (
        [line_through(np.array([left, other, right]), "other assembly", stable=False, bars=True)]
        if other is not None
        else []
    )
    return (
        line_through(
            np.array([link.left_x, left, LINE_BREAK, right, link.right_x]), "cranks", bars=True
        ),
        line_through(np.array([left, tip, right]), "couplers", bars=True),
        *dashed,
        fixed_pin_markers(link),
        line_through(np.array([tip]), "tip", points=True),
    )


def poses_of_tip(
    link: FivebarLengths, tip: complex
) -> Iterable[tuple[tuple[int, int], int, Array, Complex]]:
    """Poses with a given tip: working mode, assembly mode, crank angles (2,), and points.

    The points are left pin, right pin, tip, and the tip of the other assembly mode.
    """
    lengths = asdict(link)
    for mode in WORKING_MODE_PAIRS:
        found = solve_inverse(
            [tip.real, tip.imag], **lengths, left_mode=mode[0], right_mode=mode[1]
        )
        angle = np.array([found["left"], found["right"]])
        assembly = 1 if found["assembly"] > 0.0 else -1
        tips = [solve(angle, **lengths, mode=m) for m in (assembly, -assembly)]
        points = *link.crank_pins(*angle), *(complex(t["tip_x"], t["tip_y"]) for t in tips)
        yield mode, assembly, angle, np.array(points)


def working_modes(
    *,
    left_crank: float,
    left_coupler: float,
    right_coupler: float,
    right_crank: float,
    left_x: float,
    right_x: float,
    tip_x: float,
    tip_y: float,
) -> Chart:
    """The four working modes for one position of the tip, each with its other assembly mode.

    Parameters
    ----------
    left_crank, left_coupler, right_coupler, right_crank : lengths between pins [m]
    left_x, right_x : positions of the fixed pins on the x axis [m]
    tip_x, tip_y : position of the tip [m]

    Returns
    -------
    Chart
        A panel for each working mode; dashed lines are the couplers in the other assembly mode, for
        the same crank angles.

    Raises
    ------
    ValueError
        The tip is out of reach.

    Examples
    --------
    >>> chart = working_modes(left_crank=4.0, left_coupler=5.0, right_coupler=5.0, right_crank=4.0,
    ...                       left_x=-3.0, right_x=3.0, tip_x=0.0, tip_y=8.0)
    >>> chart.panels[1].title
    'left +1, right -1, assembly +1: cranks at 90.00° and 90.00°'
    """
    link = FivebarLengths(left_crank, left_coupler, right_coupler, right_crank, left_x, right_x)
    panels = tuple(
        Panel(
            link_lines(link, *places),
            title=f"{format_mode(mode)}, assembly {assembly:+d}: cranks at "
            + " and ".join(f"{one:.2f}°" for one in (np.degrees(angle) + 180.0) % 360.0 - 180.0),
        )
        for mode, assembly, angle, places in poses_of_tip(link, complex(tip_x, tip_y))
    )
    return Chart(
        *POSITION_AXES,
        panels,
        f"Four pairs of crank angles put the tip at ({tip_x:g}, {tip_y:g}) m. The mode of a side "
        "is +1 where its crank pin lies to the left of the line from the fixed pin to the tip. "
        "Dashed: the other assembly mode, with the same cranks and the tip on the other side of "
        "the line between the crank pins.",
        equal_scales=True,
    )


def crank_angles(
    *,
    left_crank: float,
    left_coupler: float,
    right_coupler: float,
    right_crank: float,
    left_x: float,
    right_x: float,
) -> Chart:
    """Both kinds of singularities over the angles of both cranks, for each assembly mode.

    Parameters
    ----------
    left_crank, left_coupler, right_coupler, right_crank : lengths between pins [m]
    left_x, right_x : positions of the fixed pins on the x axis [m]

    Returns
    -------
    Chart

    Examples
    --------
    >>> chart = crank_angles(left_crank=2.0, left_coupler=3.5, right_coupler=4.0, right_crank=1.0,
    ...                      left_x=0.0, right_x=2.0)
    >>> chart.caption.split(":")[1].split(". ")[0]
    ' 2.127 % of all pairs'
    """
    link = FivebarLengths(left_crank, left_coupler, right_coupler, right_crank, left_x, right_x)
    singular = type_2(link)
    panels = tuple(
        Panel(
            lines_by_label(
                [
                    *type_1_angle_curves(link, singular, assembly),
                    *type_2_angle_curves(link, singular),
                ]
            ),
            title=ASSEMBLY_LABELS[assembly],
        )
        for assembly in (1, -1)
    )
    share = unassembled_share(link)
    words = (
        "All pairs of angles can be assembled."
        if share < 1e-12
        else "Between the type 2 curves the loop cannot be closed: "
        f"{100.0 * share:.4g} % of all pairs."
    )
    return Chart(
        ("left crank", "rad"),
        ("right crank", "rad"),
        panels,
        f"{words} On type 1 curves the tip is on the border of its reach and the working mode "
        "changes. L and R are the crank pins.",
        equal_scales=True,
    )


def angle_curve(left: Complex, right: Complex) -> Complex:
    """Angles of both cranks as real and imaginary part, in [-pi, pi], with NaN where they jump."""
    one, other = np.angle(left), np.angle(right)
    jumps = np.flatnonzero((np.abs(np.diff(one)) > np.pi) | (np.abs(np.diff(other)) > np.pi)) + 1
    return np.insert(one + 1j * other, jumps, LINE_BREAK)


def type_1_angle_curves(
    link: FivebarLengths, singular: list[SingularPiece], assembly: int
) -> Iterable[LabelledCurve]:
    """Curves of type 1 singularities over both crank angles, in one assembly mode.

    Where crank and coupler of one side are in line, the tip is on the border of the reach; the
    other side has one of its two modes.
    """
    ends = np.array([one.curve.points[[0, -1]] for one in singular], complex).ravel()
    for piece, side in reach_border(link, ends):
        for mode in (1, -1):
            left = crank_pin(piece.points, link.left_x, link.left_crank, link.left_coupler, mode)
            right = crank_pin(
                piece.points, link.right_x, link.right_crank, link.right_coupler, mode
            )
            coupler_cross = np.imag(np.conj(piece.points - left) * (piece.points - right))
            if coupler_cross[coupler_cross.size // 2] * assembly > 0.0:
                yield angle_curve(left - link.left_x, right - link.right_x), TYPE_1_LABELS[side]


def crank_pin(tip: Complex, x: float, crank: float, coupler: float, mode: int) -> Complex:
    """Crank pin x + iy of one side for tips within its reach, or out of it by rounding only."""
    s = tip - x
    cosine = (np.abs(s) ** 2 + crank**2 - coupler**2) / (2.0 * np.abs(s) * crank)
    opening = np.arccos(np.clip(cosine, -1.0, 1.0))
    return np.asarray(x + crank * s / np.abs(s) * np.exp(1j * mode * opening))


def type_2_angle_curves(
    link: FivebarLengths, singular: list[SingularPiece]
) -> Iterable[LabelledCurve]:
    """Curves of type 2 singularities over both crank angles."""
    for one in singular:
        yield (
            angle_curve(one.left - link.left_x, one.right - link.right_x),
            TYPE_2_LABELS[one.stretched],
        )


def singular_poses(
    *,
    left_crank: float,
    left_coupler: float,
    right_coupler: float,
    right_crank: float,
    left_x: float,
    right_x: float,
) -> Chart:
    """One pose of each kind of singularity that the lengths allow.

    Parameters
    ----------
    left_crank, left_coupler, right_coupler, right_crank : lengths between pins [m]
    left_x, right_x : positions of the fixed pins on the x axis [m]

    Returns
    -------
    Chart

    Examples
    --------
    >>> chart = singular_poses(left_crank=2.0, left_coupler=3.5, right_coupler=4.0,
    ...                        right_crank=1.0, left_x=0.0, right_x=2.0)
    >>> [panel.title for panel in chart.panels][-1]
    'type 2: couplers in line, folded'
    """
    link = FivebarLengths(left_crank, left_coupler, right_coupler, right_crank, left_x, right_x)
    panels = [
        *(Panel(link_lines(link, *places), title=title) for title, places in type_1_poses(link)),
        *(Panel(link_lines(link, *places), title=title) for title, places in type_2_poses(link)),
    ]
    return Chart(
        *POSITION_AXES,
        tuple(panels),
        "In a type 1 singularity the tip has no velocity along the bars in line, whatever the "
        "cranks do; in a type 2 singularity it moves across the couplers although the cranks "
        "are fixed.",
        equal_scales=True,
    )


def type_1_poses(link: FivebarLengths) -> Iterable[tuple[str, Complex]]:
    """Titles and points of poses with one side in line: left pin, right pin, tip.

    There is at most one pose for each side and each of stretched and folded, on an arc of the
    border.
    """
    seen: dict[str, complex] = {}
    for piece, side in reach_border(link):
        thirds = piece.points[[piece.points.size // 3, -1 - piece.points.size // 3]]
        tip = complex(thirds[np.argmax(thirds.imag)])
        x = link.left_x if side == "left" else link.right_x
        crank, coupler = (
            (link.left_crank, link.left_coupler)
            if side == "left"
            else (link.right_crank, link.right_coupler)
        )
        how = "stretched" if abs(tip - x) > max(crank, coupler) else "folded"
        if tip.imag >= 0.0 or f"{TYPE_1_LABELS[side]}, {how}" not in seen:
            seen[f"{TYPE_1_LABELS[side]}, {how}"] = tip
    for title, tip in seen.items():
        found = solve_inverse([tip.real, tip.imag], **asdict(link), left_mode=1, right_mode=-1)
        yield title, np.array([*link.crank_pins(found["left"], found["right"]), tip])


def type_2_poses(link: FivebarLengths) -> Iterable[tuple[str, Complex]]:
    """Titles and points of poses with the couplers in line: left pin, right pin, tip.

    There is at most one pose for stretched and one for folded couplers, in the middle of the
    longest piece.
    """
    longest: dict[bool, SingularPiece] = {}
    for one in type_2(link):
        best = longest.get(one.stretched)
        if best is None or curve_length(one) > curve_length(best):
            longest[one.stretched] = one
    for stretched, one in longest.items():
        k = one.left.size // 2
        yield TYPE_2_LABELS[stretched], np.array([one.left[k], one.right[k], one.curve.points[k]])


def curve_length(one: SingularPiece) -> float:
    """Length of the polygon of a curve's points [m]."""
    return float(np.abs(np.diff(one.curve.points)).sum())
