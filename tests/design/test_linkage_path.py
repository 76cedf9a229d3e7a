"""Linkages found for paths: published problems, constraints, and derivatives of the search.

A design is verified by `tests.independent`, which shares nothing with the product.
"""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from proofmass.design.coupler_curves import FourBarCurves
from proofmass.design.linkage_designs import (
    LinkageDesign,
    distances_from_line,
    make_tasks,
    path_spline,
    search_designs_of_path,
)
from proofmass.design.linkage_path import PATH_EFFORT, SHARPNESS, PathSearch, PathTask
from proofmass.design.linkage_record import shortfall
from proofmass.design.linkage_refine import Refinement, refine
from proofmass.design.path_points import PathPoints
from proofmass.design.search import Effort
from tests.independent.linkages.coupler_point import (
    four_bar_point,
    slider_crank_point,
    worst_transmission,
)

TESTS = Path(__file__).parents[1]
PROBLEMS = {
    one["name"]: one
    for one in json.loads((TESTS / "data" / "linkage_paths.json").read_text())["problems"]
}
QUICK = Effort(((48, 20), (16, 30), (6, 60)))
SMALL = Effort(((24, 15), (8, 20), (2, 40)))
LINE = PathPoints(np.array([20 + 20j, 20 + 25j, 20 + 30j, 20 + 35j, 20 + 40j, 20 + 45j]))
LENGTHS = ("crank", "coupler", "rocker", "ground")


def path_of(problem):
    points = np.array([complex(*pair) for pair in problem["points"]])
    angles = problem.get("angles")
    return PathPoints(
        points,
        None if angles is None else np.radians(angles),
        None,
        problem.get("angles_from", "first"),
        problem.get("closed", False),
    )


def find(path, effort=QUICK, **options):
    return search_designs_of_path(make_tasks(path, **options), effort)


def independent_errors(design, points=None, mode=None):
    """Distances from the points at the crank angles of a design, by elementary geometry [m]."""
    p, found = design.parameters, []
    for angle in design.angles:
        if design.kind == "fourbar":
            found.append(complex(*four_bar_point(p, mode or design.task.kind.mode, angle)))
        else:
            found.append(complex(*slider_crank_point(p, angle)))
    return np.abs(np.array(found) - (design.path.points if points is None else points))


def printed_squares(linkage, problem):
    """Sum of squares of a printed linkage, whose crank angles are printed or given [m^2]."""
    if "crank_angles" in linkage:
        angles = np.array(linkage["crank_angles"])
    else:
        angles = np.radians(problem["angles"]) + linkage.get("first_crank_angle", 0.0)
    targets = [complex(*pair) for pair in problem["points"]]
    sums = []
    for mode in (1, -1):
        places = [
            complex(*four_bar_point(linkage, mode, angle + linkage["ground_angle"]))
            for angle in angles
        ]
        sums.append(sum(abs(a - b) ** 2 for a, b in zip(places, targets, strict=True)))
    return min(sums)


def assert_turns_fully(design):
    """The loop closes in every crank angle, and the path is passed in order within a turn."""
    p = design.parameters
    for angle in np.linspace(0.0, 2.0 * np.pi, 361):
        if design.kind == "fourbar":
            four_bar_point(p, design.task.kind.mode, angle)  # ValueError where it does not close
        else:
            slider_crank_point(p, angle)
    steps = np.diff(design.angles) * design.task.sense
    assert (steps >= 0).all()
    assert steps.sum() <= 2.0 * np.pi + 1e-9


@pytest.mark.parametrize(
    "name",
    [
        "vertical line, 6 points",
        "5 points with crank angles",
        "18 points with crank angles",
        "semicircle, lengths 5 to 60",
    ],
)
def test_published_problems_are_solved_at_least_as_well(name):
    """Printed linkages and ours are both measured by elementary geometry."""
    problem = PROBLEMS[name]
    bounds = {key: tuple(pair) for key, pair in problem["bounds"].items()}
    found = find(path_of(problem), kinds=("fourbar",), bounds=bounds)
    best = found.designs[0]
    ours = float(np.sum(independent_errors(best) ** 2))
    printed = min(printed_squares(one, problem) for one in problem["linkages"])
    assert ours <= printed
    assert_turns_fully(best)
    for key, value in best.parameters.items():
        low, high = bounds.get(key, (-np.inf, np.inf))
        assert low - 1e-9 <= value <= high + 1e-9, key


def test_nine_points_are_passed_exactly_and_a_moved_point_is_noticed():
    """The solution is isolated, so that a moved point or the other mode is missed."""
    path = path_of(PROBLEMS["nine points, problem 3"])
    effort = replace(QUICK, heats=((128, 20), (32, 40), (6, 90)))
    best = find(path, effort, kinds=("fourbar",), modes=(1,)).designs[0]
    assert independent_errors(best).max() < 1e-10
    assert_turns_fully(best)
    points = path.points + np.where(np.arange(9) == 4, 0.01, 0.0)
    assert independent_errors(best, points).max() > 5e-3
    assert independent_errors(best, mode=-best.task.kind.mode).max() > 0.1


def test_the_records_of_the_page_hold_by_elementary_geometry():
    """Every design on docs/linkage_paths.md turns fully, in order, with the error that is told."""
    records = json.loads((TESTS.parent / "docs" / "linkage_paths.json").read_text())
    compared = 0
    for one in records:
        p, mode = one["parameters"], one["mode"]
        for angle in np.linspace(0.0, 2.0 * np.pi, 73):
            four_bar_point(p, mode, angle)
        steps = np.diff(one["crank_angles"]) * one["sense"]
        assert (steps >= -1e-12).all(), one["name"]
        assert steps.sum() <= 2.0 * np.pi + 1e-9, one["name"]
        problem = PROBLEMS.get(one["name"])
        if problem is None or "points" not in problem:
            continue
        places = [complex(*four_bar_point(p, mode, angle)) for angle in one["crank_angles"]]
        targets = [complex(*pair) for pair in problem["points"]]
        squares = sum(abs(a - b) ** 2 for a, b in zip(places, targets, strict=True))
        # rounding of places whose size is that of the bars, next to a change point
        assert squares == pytest.approx(one["ours"], rel=1e-6, abs=1e-16 * one["size"] ** 2)
        for key, (low, high) in problem.get("bounds", {}).items():
            assert low - 1e-9 <= p[key] <= high + 1e-9, (one["name"], key)
        compared += 1
    assert compared >= 17


def test_the_transmission_angle_is_kept():
    """Without the limit the best linkage has a worse one."""
    path = path_of(PROBLEMS["18 points with crank angles"])
    worst = {}
    for limit in (0.0, 60.0):
        found = find(path, kinds=("fourbar",), modes=(1,), transmission=np.radians(limit))
        best = found.designs[0]
        worst[limit] = np.degrees(worst_transmission(best.parameters))
        assert best.worst_transmission == pytest.approx(np.radians(worst[limit]), abs=1e-4)
    assert worst[0.0] < 60.0 - 1e-3
    assert worst[60.0] >= 60.0 - 1e-3


def test_bounds_of_pivots_and_lengths_are_kept():
    bounds = {
        "pivot_x": (0.0, 0.0),
        "pivot_y": (10.0, 30.0),
        "other_x": (25.0, 40.0),
        "crank": (6.0, 7.0),
    }
    found = find(LINE, kinds=("fourbar",), modes=(1,), bounds=bounds)
    assert found.designs
    for design in found.designs:
        p = design.parameters
        other = p["pivot_x"] + p["ground"] * np.cos(p["ground_angle"])
        assert p["pivot_x"] == pytest.approx(0.0, abs=1e-9)
        assert 10.0 <= p["pivot_y"] <= 30.0
        assert 25.0 - 1e-9 <= other <= 40.0 + 1e-9
        assert 6.0 <= p["crank"] <= 7.0
        assert independent_errors(design) == pytest.approx(design.errors, abs=1e-9)


def test_impossible_bounds_are_told_with_what_is_missing():
    """A crank of 10 m cannot turn against bars of at most 1 m."""
    bounds = {"crank": (10.0, 11.0), "coupler": (0.5, 1.0), "rocker": (0.5, 1.0)}
    found = find(LINE, kinds=("fourbar",), bounds={**bounds, "ground": (20.0, 21.0)})
    assert found.designs == []
    assert found.nearest.margin < -25.0  # 10 + 20 against 1 + 1 at best
    assert "lacks" in shortfall(found)
    assert "turns fully" in shortfall(found)


def test_tolerances_lead_to_a_smaller_largest_error():
    """Least squares leave one point too far off; weights bring it within its tolerance."""
    path = path_of(PROBLEMS["18 points with crank angles"])
    free = find(path, SMALL, kinds=("fourbar",), modes=(1,)).designs[0]
    allowed = 0.93 * float(free.errors.max())
    with_tolerance = replace(path, tolerances=np.full(18, allowed))
    best = find(with_tolerance, SMALL, kinds=("fourbar",), modes=(1,)).designs[0]
    assert best.errors.max() <= allowed
    assert best.rms >= free.rms * (1 - 1e-9)
    unmet = replace(path, tolerances=np.full(18, 0.3 * allowed))
    tight = find(unmet, SMALL, kinds=("fourbar",), modes=(1,))
    assert "misses point" in shortfall(tight)
    assert f"{0.3 * allowed:g} m are allowed" in shortfall(tight)


def test_a_slider_crank_draws_its_own_curve():
    """Twelve points of a known slider-crank, whose curve no other was found to have."""
    p = {"pivot_x": 1.0, "pivot_y": 0.5, "guide_angle": 0.3, "crank": 1.0, "coupler": 3.0}
    p |= {"offset": 0.4, "point_along": 1.2, "point_across": 0.9}
    points = [complex(*slider_crank_point(p, angle)) for angle in np.arange(12) * np.pi / 6]
    path = PathPoints(np.array(points), closed=True)
    best = find(path, kinds=("slider_crank",)).designs[0]
    assert independent_errors(best).max() < 1e-9
    assert best.parameters["crank"] == pytest.approx(1.0, abs=1e-6)
    assert best.structural_error < 0.05


@pytest.mark.parametrize("origin", ["none", "first", "x", "ground"])
def test_slopes_of_the_search_and_of_the_refinement_are_finite_differences(origin):
    angles = None if origin == "none" else np.radians([10, 40, 80, 130, 160, 200])
    path = replace(LINE, angles=angles, angles_from="first" if origin == "none" else origin)
    bounds = (("other_x", (60.0, 70.0)),)
    task = PathTask(path, FourBarCurves(1), bounds=bounds, transmission=0.3)
    vectors = task.starts(6, np.random.default_rng(1))
    _, shared, _, own = task.linearize(vectors)
    step = 1e-6
    scale = 1.0 + np.abs(shared).max()
    for k in range(shared.shape[-1]):
        move = step * (np.arange(vectors.shape[1]) == k)
        change = task.residuals(vectors + move) - task.residuals(vectors - move)
        assert np.abs(change / (2 * step) - shared[..., k]).max() < 1e-5 * scale
    if origin == "none":
        for k in range(6):
            move = step * (np.arange(vectors.shape[1]) == task.shape_count + k)
            change = (task.deviations(vectors + move) - task.deviations(vectors - move)) / (
                2 * step
            )
            expected = own[:, k, 0] + 1j * own[:, k, 1]
            assert np.abs(change[:, k] - expected).max() < 1e-5 * scale
            assert np.abs(np.delete(change, k, axis=1)).max() == 0.0
    problem = Refinement(task, SHARPNESS[0])
    unknowns = problem.unknowns(vectors[0]) + 1e-3
    slopes = problem.slopes(unknowns)
    for k in range(unknowns.size):
        move = step * (np.arange(unknowns.size) == k)
        change = (problem.terms(unknowns + move) - problem.terms(unknowns - move)) / (2 * step)
        assert np.abs(change - slopes[:, k]).max() < 1e-5 * (1.0 + np.abs(slopes).max())


def test_a_refinement_puts_crank_angles_in_order():
    """A descent whose last two crank angles are interchanged."""
    task = PathTask(LINE, FourBarCurves(1))
    search = PathSearch(task, QUICK)
    vector = search.run().copy()
    vector[[-1, -2]] = vector[[-2, -1]]
    refined = LinkageDesign(task, refine(task, vector))
    assert refined.in_order
    assert not LinkageDesign(task, vector).in_order
    assert refined.rms < LinkageDesign(task, vector).rms


def test_an_interrupted_search_continues_to_the_same_designs(tmp_path, monkeypatch):
    task = PathTask(LINE, FourBarCurves(1))
    once = PathSearch(task, QUICK).run()
    step = PathSearch.step

    def interrupted(self):
        if self.state.step == 30:
            raise KeyboardInterrupt
        return step(self)

    monkeypatch.setattr(PathSearch, "step", interrupted)
    with pytest.raises(KeyboardInterrupt):
        PathSearch(task, QUICK, tmp_path / "state.npz").run()
    monkeypatch.setattr(PathSearch, "step", step)
    resumed = PathSearch(task, QUICK, tmp_path / "state.npz")
    assert resumed.state.step == 30
    np.testing.assert_array_equal(resumed.run(), once)


def test_designs_that_are_told_differ():
    """Exact ones come first, those with better transmission before others."""
    designs = find(LINE, kinds=("fourbar",), modes=(1,)).designs
    assert len(designs) > 2
    told = [tuple(one.parameters[name] for name in LENGTHS) for one in designs]
    for k, one in enumerate(told):
        for other in told[:k]:
            assert np.abs(np.log(np.array(one) / np.array(other))).max() > 0.2
    exact = [one for one in designs if one.errors.max() < 1e-9]
    assert designs[: len(exact)] == exact
    values = [worst_transmission(one.parameters) for one in exact]
    assert len(values) > 1
    assert values == sorted(values, reverse=True)


def test_the_structural_error_is_that_of_the_curve_between_the_points():
    """A spline through points of a circle, and places beside it."""
    turn = np.arange(12) * np.pi / 6
    circle = PathPoints(np.exp(1j * turn), closed=True)
    spline = path_spline(circle)
    assert np.abs(np.abs(spline) - 1.0).max() < 2e-3
    off = distances_from_line(np.array([1.1 + 0j, 0.0 + 0.5j]), spline)
    assert off == pytest.approx([0.1, 0.5], abs=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name, one in PROBLEMS.items() if "points" in one])
def test_searches_with_another_seed_come_as_near(name):
    """Each search of the page again from other starts: no worse than the page by a factor 1.2."""
    records = json.loads((TESTS.parent / "docs" / "linkage_paths.json").read_text())
    (told,) = [one for one in records if one["name"] == name]
    problem = PROBLEMS[name]
    bounds = {key: tuple(pair) for key, pair in problem.get("bounds", {}).items()}
    found = find(path_of(problem), replace(PATH_EFFORT, seed=7), kinds=("fourbar",), bounds=bounds)
    ours = float(np.sum(independent_errors(found.designs[0]) ** 2))
    assert np.sqrt(ours) <= 1.2 * np.sqrt(told["ours"]) + 1e-8 * told["size"]
