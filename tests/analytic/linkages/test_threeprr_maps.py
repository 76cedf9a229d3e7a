"""Workspace of a 3PRR robot: areas in two ways, singular curves, poses of each working mode."""

from dataclasses import asdict, replace

import numpy as np
import pytest

from proofmass.analytic.chart import Chart
from proofmass.analytic.linkages import threeprr
from tests.analytic.linkages.threeprr_tables import SIX_POSES, TABLE3, TABLE4, TABLE5, TABLE6
from tests.independent.linkages.reach import is_threeprr_pose

THESIS = threeprr.RobotLengths(1.0, 1.0, 3.0, 2.0, 2.0)
SHORT_SIDE = threeprr.RobotLengths(0.7, 1.0, 3.0, 1.5, 2.0)
LONG_SIDE = threeprr.RobotLengths(2.3, 1.0, 3.0, 1.5, 2.0)
EACH = pytest.mark.parametrize(
    "robot", [THESIS, SHORT_SIDE, LONG_SIDE], ids=["thesis", "short", "long"]
)
ANGLES = pytest.mark.parametrize("psi", [np.pi / 6, -0.4, 2.0, 4.0])


def cell_centres(part: threeprr.WorkspaceSlice, n: int = 300) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates of the centres of the cells of a slice."""
    share = (np.arange(n) + 0.5) / n
    x, y = (low + share * (high - low) for low, high in (part.x, part.y))
    return tuple(np.meshgrid(x, y, indexing="ij"))


def singularity_measure(
    robot: threeprr.RobotLengths, x: np.ndarray, y: np.ndarray, psi: float, mode: int
):
    """Singularity measure by the inverse problem."""
    pose = np.array([x, y, np.full(np.shape(x), psi)])
    return threeprr.solve_inverse(pose, **asdict(robot), mode=mode)["singularity"]


@EACH
@ANGLES
def test_a_slice_is_where_all_legs_reach(robot: threeprr.RobotLengths, psi: float) -> None:
    part = threeprr.WorkspaceSlice(robot, psi)
    n = 600
    share = (np.arange(n) + 0.5) / n
    x = robot.guide3_x + 2.0 * (robot.side + robot.leg) * (share - 0.5)
    y = 2.0 * robot.leg * (share - 0.5)
    grid = np.array([*np.meshgrid(x, y), np.full((n, n), psi)])
    counted = is_threeprr_pose(grid, **asdict(robot)).mean() * (
        4.0 * robot.leg * (robot.side + robot.leg)
    )
    # cells along the edges, which are shorter than 2 L; a cell is 1/600 of the box
    assert part.area == pytest.approx(counted, abs=0.03)
    assert (part.area == 0.0) == (2.0 * robot.leg <= robot.side * abs(np.sin(psi)))


def test_the_document_counts_88_nodes_in_the_same_slice() -> None:
    part = threeprr.WorkspaceSlice(THESIS, np.pi / 6)
    nodes = np.linspace(-3.0, 6.0, 51)
    (left, right), (low, high) = part.x, part.y
    inside = sum((left <= nodes) & (nodes <= right)) * sum((low <= nodes) & (nodes <= high))
    assert inside == 88
    assert part.area == pytest.approx(3.0, rel=1e-15, abs=0)


@EACH
@ANGLES
@pytest.mark.parametrize("mode", threeprr.WORKING_MODES)
def test_aspects_have_the_sign_of_the_inverse_problem(
    robot: threeprr.RobotLengths, psi: float, mode: int
) -> None:
    part = threeprr.WorkspaceSlice(robot, psi)
    found = threeprr.aspects_of_slice(part, mode)
    if part.area == 0.0:
        assert found == {1: [], -1: []}
        return
    sign = singularity_measure(robot, *cell_centres(part), psi, mode)
    for side in (1, -1):
        area = sum(one.area for one in found[side])
        # a curve across the slice cuts 1/300 of the cells, and their errors average to less
        assert area == pytest.approx(np.mean(sign * side > 0.0) * part.area, abs=2e-3 * part.area)
    total = sum(one.area for some in found.values() for one in some)
    assert total == pytest.approx(part.area, rel=1e-12)


def test_a_wrong_length_changes_areas_by_more_than_the_tolerance() -> None:
    part = threeprr.WorkspaceSlice(SHORT_SIDE, 2.0)
    counted = (
        np.mean(singularity_measure(SHORT_SIDE, *cell_centres(part), 2.0, 3) > 0.0) * part.area
    )
    for name in ("side", "leg"):
        wrong = replace(SHORT_SIDE, **{name: 1.03 * asdict(SHORT_SIDE)[name]})
        found = threeprr.aspects_of_slice(threeprr.WorkspaceSlice(wrong, 2.0), 3)
        assert abs(sum(one.area for one in found[1]) - counted) > 2e-3 * part.area, name


@EACH
@ANGLES
@pytest.mark.parametrize("mode", threeprr.WORKING_MODES)
def test_singularity_measure_changes_sign_across_type_2_curves(
    robot: threeprr.RobotLengths, psi: float, mode: int
) -> None:
    part = threeprr.WorkspaceSlice(robot, psi)
    curves = threeprr.type_2_of_slice(part, mode)
    if not curves:  # then no pose of the slice differs in its sign from the others
        sign = singularity_measure(robot, *cell_centres(part), psi, mode) if part.area else 1.0
        assert np.ptp(np.sign(sign)) == 0.0
    for one in curves:
        tip = one.points[2:-2]
        if not tip.size:
            tip = np.array([one.points.mean()])
        inside = np.abs(tip.imag - np.mean(part.y)) < 0.5 * np.ptp(part.y) - 1e-9
        tip = tip[inside]
        assert np.abs(singularity_measure(robot, tip.real, tip.imag, psi, mode)).max() < 1e-12
        tangent = np.gradient(tip) if tip.size > 1 else np.diff(one.points)
        across = 1e-6j * tangent / np.abs(tangent)
        middle = slice(tip.size // 4, max(1, tip.size - tip.size // 4))
        for step, sign in ((across, 1.0), (-across, -1.0)):
            z = (tip + step)[middle]
            z = z[
                (np.abs(z.real - np.mean(part.x)) < robot.leg)
                & (np.abs(z.imag - np.mean(part.y)) < 0.5 * np.ptp(part.y))
            ]
            assert z.size
            assert (sign * singularity_measure(robot, z.real, z.imag, psi, mode) > 0.0).all()


def test_legs_as_long_as_the_side_may_have_a_whole_line_of_singular_poses() -> None:
    # sliders 1 and 2 coincide with the third corner, in which the lines of all legs meet
    psi, mode = -0.4, 7
    part = threeprr.WorkspaceSlice(THESIS, psi)
    (height,) = {
        round(float(one.points[0].imag), 9)
        for one in threeprr.type_2_of_slice(part, mode)
        if one.points.size == 2
    }
    assert height == pytest.approx(-np.sin(psi + np.pi / 3), abs=1e-9)
    x = np.linspace(part.x[0] + 1e-6, part.x[1] - 1e-6, 9)
    level = singularity_measure(THESIS, x, np.full(9, -np.sin(psi + np.pi / 3)), psi, mode)
    assert np.abs(level).max() < 1e-12
    assert len(threeprr.aspects_of_slice(part, mode)[1]) == 3


@EACH
def test_angles_of_a_place_are_those_at_which_all_legs_reach(
    robot: threeprr.RobotLengths,
) -> None:
    rng = np.random.default_rng(3)
    x = robot.guide3_x + rng.uniform(-1.1, 1.1, 60) * (robot.side + robot.leg)
    y = rng.uniform(-1.1, 1.1, 60) * robot.leg
    psi = (np.arange(3600) + 0.5) * 2.0 * np.pi / 3600
    grid = np.array(np.broadcast_arrays(x[:, None], y[:, None], psi))
    counted = is_threeprr_pose(grid, **asdict(robot)).mean(axis=1) * 2.0 * np.pi
    angles = threeprr.angles_of_place(x, y, robot)
    assert np.abs(angles - counted).max() < 8 * 2.0 * np.pi / 3600  # at most eight ends of arcs
    assert np.ptp(counted) > 1.0
    wider = threeprr.angles_of_place(x, y, replace(robot, side=1.03 * robot.side))
    assert np.abs(wider - counted).max() > 8 * 2.0 * np.pi / 3600


@EACH
def test_map_slices_and_closed_form_give_the_same_volume(robot: threeprr.RobotLengths) -> None:
    psi = (np.arange(2400) + 0.5) * 2.0 * np.pi / 2400
    slices = np.mean([threeprr.WorkspaceSlice(robot, one).area for one in psi.tolist()])
    # error h^2 of the midpoint rule at kinks of |sin|
    assert threeprr.volume(robot) == pytest.approx(2.0 * np.pi * slices, rel=1e-6)
    n = 400
    share = (np.arange(n) + 0.5) / n - 0.5
    wide, high = 2.0 * (robot.side + robot.leg), 2.0 * robot.leg
    angles = threeprr.angles_of_place(robot.guide3_x + wide * share[:, None], high * share, robot)
    # error of cells of 1/400 at the border, where the angles change like a square root
    assert angles.mean() * wide * high == pytest.approx(threeprr.volume(robot), rel=2e-4)
    counted = np.mean(angles > 0.0) * wide * high
    assert threeprr.reach_area_of_place(robot) == pytest.approx(counted, rel=4e-3)


def test_reach_area_agrees_with_a_dense_midpoint_rule() -> None:
    """Against a dense midpoint rule, for sides above and below L sqrt(3/4).

    From that side on one height alone decides.
    """
    for robot in (THESIS, SHORT_SIDE, LONG_SIDE, threeprr.RobotLengths(0.2, 1.0, 1.0, 0.0, 1.0)):
        n = 200_000
        y = robot.leg * (2.0 * (np.arange(n) + 0.5) / n - 1.0)
        wide = np.nansum(np.diff(threeprr.reach_of_place(y, robot), axis=-1)[..., 0], axis=-1)
        # error h^1.5 of a midpoint rule of square roots
        assert threeprr.reach_area_of_place(robot) == pytest.approx(
            wide.mean() * 2.0 * robot.leg, rel=1e-7
        )


def leg_and_side_lengths(chart: Chart, panel: int) -> np.ndarray:
    """Lengths of the legs and of the platform's sides in a panel."""
    lines = {line.label: line.x + 1j * line.y for line in chart.panels[panel].lines}
    legs, ring = np.abs(np.diff(lines["legs"])), np.abs(np.diff(lines["platform"]))
    return np.array([*legs[np.isfinite(legs)], *ring])


@pytest.mark.parametrize("table", [TABLE3, TABLE4], ids=["table 3", "table 4"])
def test_sliders_of_the_eight_working_modes_are_those_of_the_tables(table: dict) -> None:
    x, y = table["pose"]["x"], table["pose"]["y"]
    psi = np.radians(table["pose"]["psi_deg"])
    chart = threeprr.leg_modes(**table["where"], x=x, y=y, psi=psi)
    where = table["where"]
    triples = set()
    for k in range(8):
        sizes = [where["leg"]] * 3 + [where["side"]] * 3
        assert np.abs(leg_and_side_lengths(chart, k) - sizes).max() < 1e-12
        feet = next(line for line in chart.panels[k].lines if line.label == "sliders")
        triples.add((feet.x[0], where["guide2_x"] - feet.x[1], where["guide3_y"] - feet.y[2]))
        assert np.abs(feet.y[:2]).max() == 0.0
        assert feet.x[2] == where["guide3_x"]
    printed = np.array(table["sliders"])
    assert len(triples) == 8
    for k in range(3):
        found = np.unique(np.round([triple[k] for triple in triples], 9))
        assert np.sort(found) == pytest.approx(np.sort(np.unique(printed[k])), abs=6e-5)


@pytest.mark.parametrize(
    ("table", "count"),
    [(TABLE5, 2), (TABLE6, 2), (SIX_POSES, 6)],
    ids=["table 5", "table 6", "six"],
)
def test_all_direct_poses_are_those_of_the_document(table: dict, count: int) -> None:
    where = table["where"]
    sliders = dict(zip(("slider_1", "slider_2", "slider_3"), table["sliders"], strict=True))
    chart = threeprr.direct_poses(**where, **sliders)
    assert len(chart.panels) == count
    places = []
    for k, panel in enumerate(chart.panels):
        sizes = [where["leg"]] * 3 + [where["side"]] * 3
        assert np.abs(leg_and_side_lengths(chart, k) - sizes).max() < 1e-12
        (p,) = [line for line in panel.lines if line.label == "P"]
        places.append((p.x[0], p.y[0]))
    for x, y, _ in table["poses"]:
        assert np.abs(np.array(places) - [x, y]).max(axis=1).min() < 6e-5


def test_drawn_singular_poses_are_singular() -> None:
    chart = threeprr.singular_poses(**asdict(SHORT_SIDE), psi=0.4)
    for k, panel in enumerate(chart.panels):
        assert np.abs(leg_and_side_lengths(chart, k) - [1.0, 1.0, 1.0, 0.7, 0.7, 0.7]).max() < 1e-12
        lines = {line.label: line.x + 1j * line.y for line in panel.lines}
        e = np.diff(lines["legs"])[[0, 3, 6]]
        if panel.title.startswith("type 1"):
            lean = np.real(np.conj(e) * np.array([1.0, -1.0, -1.0j]))
            assert abs(lean[int(panel.title[12]) - 1]) < 1e-7  # square root of rounding
            continue
        corners = lines["legs"][[1, 4, 7]]
        point = lines["where they meet"][0]
        away = np.imag(np.conj(e) * (point - corners))
        assert np.abs(away).max() < 1e-9


def test_areas_on_the_chart_are_those_of_the_aspects() -> None:
    psi = np.pi / 6
    chart = threeprr.workspace_slice(**asdict(THESIS), psi=psi)
    part = threeprr.WorkspaceSlice(THESIS, psi)
    for mode, panel in zip(threeprr.WORKING_MODES, chart.panels, strict=True):
        found = threeprr.aspects_of_slice(part, mode)
        areas = sorted(one.area for some in found.values() for one in some)
        assert sorted(region.area for region in panel.regions) == pytest.approx(areas)
    with pytest.raises(ValueError, match=r"no place is reached at psi = 1\.5708 rad"):
        threeprr.workspace_slice(**asdict(LONG_SIDE), psi=np.pi / 2)


def test_the_map_shows_where_every_angle_is_reached() -> None:
    chart = threeprr.workspace(**asdict(SHORT_SIDE))
    assert "0.36 m² at every angle" in chart.caption  # (2 (L - a))^2
    (ring,) = [line for line in chart.lines if line.label == "reached at every angle"]
    inner = threeprr.angles_of_place(
        SHORT_SIDE.guide3_x + 0.999 * (ring.x - SHORT_SIDE.guide3_x), 0.999 * ring.y, SHORT_SIDE
    )
    outer = threeprr.angles_of_place(
        SHORT_SIDE.guide3_x + 1.01 * (ring.x - SHORT_SIDE.guide3_x), 1.01 * ring.y, SHORT_SIDE
    )
    assert inner == pytest.approx(2.0 * np.pi)
    assert (outer < 2.0 * np.pi).all()
    with pytest.raises(ValueError, match=r"nodes must lie within \[5, 401\]"):
        threeprr.workspace(**asdict(SHORT_SIDE), nodes=3)
