"""Motion of a 3PRR robot: rates, forces and modes, the inverse problem and the workspace."""

import numpy as np
import pytest

from proofmass.analytic.linkages import threeprr
from proofmass.analytic.linkages.threeprr import poses
from tests.analytic.linkages.spectral import assert_close, derivative
from tests.analytic.linkages.threeprr_tables import (
    DATA,
    LENGTHS,
    POSE_NAMES,
    SIX_POSES,
    SLIDERS,
    TABLE3,
    TABLE4,
    corners,
    leg_errors,
    nearest_distance,
    pose_rows,
    slider_points,
    slider_triples,
)
from tests.independent.linkages.reach import is_threeprr_pose

TURN = 2.0 * np.pi
GRID = np.arange(256) / 256
CIRCLE = {
    "centre_x": 1.6,
    "centre_y": 1.0,
    "radius": 0.15,
    "period": 1.0,
    "psi": -0.4,
    "swing": 0.2,
}
MASSES_AND_LOADS = {
    "platform_mass": 2.0,
    "leg_mass": 0.7,
    "slider_mass": 0.5,
    "load_x": 3.0,
    "load_y": -2.0,
    "load_moment": 1.5,
}


@pytest.mark.parametrize("table", [TABLE3, TABLE4], ids=("table 3", "table 4"))
def test_inverse_solutions_are_those_of_the_tables(table):
    pose, where = table["pose"], table["where"]
    pose = np.array([pose["x"], pose["y"], np.radians(pose["psi_deg"])])
    triples = slider_triples(pose, where)
    assert len(np.unique(triples.round(9), axis=0)) == 8
    for k, printed in enumerate(table["sliders"]):
        for value in np.unique(triples[:, k].round(9)):
            # 5 significant digits are printed
            assert np.abs(value - printed).min() <= (5.1e-5 if abs(value) >= 1.0 else 5.1e-6)
    for triple in triples:
        assert np.abs(leg_errors(pose, triple, where)).max() <= 1e-15  # rounding
        # eq. 51, with its misprint in y corrected
        assert np.hypot(triple[0] - pose[0], pose[1]) == pytest.approx(where["leg"], abs=1e-15)


@pytest.mark.parametrize("leg_mode", [4, 8])
def test_rates_are_derivatives(leg_mode):
    profiles = threeprr.circle(GRID, **CIRCLE, **LENGTHS, leg_mode=leg_mode)
    for k in range(3):
        # rounding times wave number 128
        assert_close(TURN * derivative(profiles[0][k]), profiles[1][k], 1e-12)
        assert_close(TURN * derivative(profiles[1][k]), profiles[2][k], 1e-12)
    wanted = CIRCLE["psi"] + CIRCLE["swing"] * np.sin(TURN * GRID)
    pose = next(
        p
        for p in (threeprr.solve(*profiles, **LENGTHS, mode=m) for m in (1, -1))
        if np.allclose(p["psi"], wanted)
    )
    for name in (*POSE_NAMES, "leg_angle_1", "leg_angle_2", "leg_angle_3"):
        # rounding times wave number 128 over the smallest determinant
        assert_close(TURN * derivative(pose[name]), pose[f"{name}_rate"], 1e-10)
        assert_close(TURN * derivative(pose[f"{name}_rate"]), pose[f"{name}_acceleration"], 1e-10)
    centre = np.mean(corners(*(pose[n] for n in POSE_NAMES), LENGTHS["side"]), axis=0)
    off = centre - CIRCLE["centre_x"] - 1j * CIRCLE["centre_y"]
    np.testing.assert_allclose(off, CIRCLE["radius"] * np.exp(1j * TURN * GRID), atol=1e-14)


@pytest.mark.parametrize("mode", [1, -1])
def test_holding_forces_are_slopes_of_the_potential(mode):
    step = 1e-3 * np.arange(-3, 4)
    weights = np.array([-1, 9, -45, 0, 45, -9, 1]) / 0.06  # 6th order: 1e-18 times 7th derivative
    static = threeprr.solve(SLIDERS, 0.0, **LENGTHS, **MASSES_AND_LOADS, mode=mode)
    for k in range(3):
        sliders = SLIDERS[:, None] + np.eye(3)[:, [k]] * step
        pose = threeprr.solve(sliders, **LENGTHS, mode=mode)
        p, c = (
            corners(*(pose[n] for n in POSE_NAMES), LENGTHS["side"]),
            slider_points(sliders, LENGTHS),
        )
        height = MASSES_AND_LOADS["platform_mass"] * np.mean(p, axis=0).imag
        for corner, slider in zip(p, c, strict=True):
            height = height + 0.5 * MASSES_AND_LOADS["leg_mass"] * (corner + slider).imag
            height = height + MASSES_AND_LOADS["slider_mass"] * slider.imag
        potential = (
            9.81 * height
            - MASSES_AND_LOADS["load_x"] * pose["x"]
            - MASSES_AND_LOADS["load_y"] * pose["y"]
            - MASSES_AND_LOADS["load_moment"] * pose["psi"]
        )
        assert static[f"holding_force_{k + 1}"] == pytest.approx(weights @ potential, abs=1e-10)


def test_singularity_is_the_jacobian_determinant_of_the_leg_lengths():
    x, y, psi = 1.3, 0.7, 0.4
    step, where = 1e-6, {**LENGTHS, "side": 0.8, "leg": 1.2}
    found = threeprr.solve_inverse([x, y, psi], **where, mode=3)
    sliders = [found[f"slider_{k}"] for k in (1, 2, 3)]
    columns = [
        [
            (up - down) / (2 * step)
            for up, down in zip(
                leg_errors(np.array([x, y, psi]) + h, sliders, where),
                leg_errors(np.array([x, y, psi]) - h, sliders, where),
                strict=True,
            )
        ]
        for h in step * np.eye(3)
    ]
    expected = np.linalg.det(np.transpose(columns)) / where["side"]
    assert found["singularity"] == pytest.approx(expected, abs=1e-9)  # rounding over the step
    back = poses(sliders, **where)
    assert nearest_distance(pose_rows(back), [x, y, psi]) <= 1e-14  # rounding
    assert np.nanmin(np.abs(back["singularity"] - found["singularity"])) <= 1e-13
    assert found["lean_3"] == pytest.approx(
        (sliders[2] - (where["guide3_y"] - corners(x, y, psi, 0.8)[2].imag)) / -1.2, abs=1e-15
    )


def test_modes_are_continuous_between_folds():
    """Each of the six modes is one smooth curve along a straight line in the space of sliders."""
    line = np.linspace(0.0, 1.0, 401)
    sliders = np.array(SIX_POSES["sliders"])[:, None] + np.array([[0.03], [-0.02], [0.02]]) * line
    assert np.isfinite(poses(sliders, **SIX_POSES["where"])["psi"]).all()
    for mode in threeprr.MODES:
        pose = threeprr.solve(
            sliders, np.array([0.03, -0.02, 0.02]), **SIX_POSES["where"], mode=mode
        )
        assert np.all(np.sign(pose["singularity"]) == np.sign(mode))
        for name in POSE_NAMES:  # trapezoids: step^2/12 times the change of the acceleration
            rate = pose[f"{name}_rate"]
            steps = 0.5 * (rate[1:] + rate[:-1]) / 400.0
            np.testing.assert_allclose(np.diff(pose[name]), steps, atol=1e-7)


def test_workspace_has_the_counts_of_the_document():
    grid = DATA["workspace"]
    line = np.linspace(*grid["range"], grid["nodes"])
    psi = np.arange(0.0, 2.0 + 1e-9, grid["psi_step_over_pi"]) * np.pi
    nodes = np.array(np.meshgrid(psi, line, line, indexing="ij"))[[1, 2, 0]]
    reached = is_threeprr_pose(nodes, **grid["where"])
    assert reached.sum(axis=(1, 2)).tolist() == grid["counts"]
    assert reached.sum() == 1185
    cut = grid["slice"]
    nodes = np.array(np.meshgrid(line, line, np.radians(cut["psi_deg"]), indexing="ij"))
    x, y, _ = nodes[:, is_threeprr_pose(nodes, **grid["where"])]
    assert x.size == cut["count"]
    for found, printed in ((x, cut["x"]), (y, cut["y"])):  # nodes, multiples of 0.18 m
        np.testing.assert_allclose([found.min(), found.max()], printed, atol=1e-12, rtol=0)


def test_the_inverse_problem_is_solved_for_reachable_poses_only():
    rng = np.random.default_rng(3)
    nodes = rng.uniform(-3.0, 4.0, (3, 300))
    reached = is_threeprr_pose(nodes, **LENGTHS)
    assert 0 < reached.sum() < 300
    threeprr.solve_inverse(nodes[:, reached], **LENGTHS)
    for node in nodes[:, ~reached].T:
        with pytest.raises(ValueError, match="out of reach"):
            threeprr.solve_inverse(node, **LENGTHS)


def test_an_unreachable_pose_is_named_with_the_missing_length():
    where = {**LENGTHS, "guide3_x": 2.0}
    high = np.transpose([(1.5, 0.9, 0.0), (1.5, 1.25, 0.0)])
    with pytest.raises(
        ValueError,
        match=r"pose \(1.5 m, 1.25 m, 0 rad\) is out of reach: leg 1 is "
        r"too short by 0.25 m",
    ):
        threeprr.solve_inverse(high, **where)
    upright = threeprr.solve_inverse([1.5, 1.0, 0.0], [0.0, 1.0, 0.0], **where)
    assert upright["slider_1"] == 1.5  # border of the workspace: leg 1 perpendicular to its guide
    assert upright["lean_1"] == 0.0
    assert not np.isfinite(upright["slider_1_rate"])


@pytest.mark.parametrize(
    ("name", "value"),
    [(n, v) for n in ("side", "leg") for v in (0.0, -1.0, np.nan, np.inf)]
    + [(n, np.nan) for n in ("guide2_x", "guide3_x", "guide3_y")]
    + [("mode", 0)],
)
def test_bad_value_is_named(name, value):
    with pytest.raises(ValueError, match=f"^{name} must be"):
        threeprr.solve(SLIDERS, **{**LENGTHS, name: value})


def test_other_bad_values_are_named():
    with pytest.raises(ValueError, match="leg_mass must be"):
        threeprr.solve(SLIDERS, **LENGTHS, leg_mass=-1.0)
    with pytest.raises(ValueError, match="period must be"):
        threeprr.circle(0.0, **{**CIRCLE, "period": 0.0}, **LENGTHS)
    with pytest.raises(ValueError, match="sliders must have 3 rows"):
        threeprr.solve([2.0, 0.5], **LENGTHS)


def test_shapes_broadcast_from_the_left():
    sliders = SLIDERS[:, None, None] + np.zeros((3, 2, 4))
    for rate in (1.0, np.ones(3), np.ones((3, 2)), np.ones_like(sliders)):
        pose = threeprr.solve(sliders, rate, 0.0, **LENGTHS)
        assert {curve.shape for curve in pose.values()} == {(2, 4)}
    assert {curve.shape for curve in threeprr.solve(SLIDERS, **LENGTHS).values()} == {()}
    assert poses(sliders, **LENGTHS)["psi"].shape == (6, 2, 4)
    assert threeprr.solve(np.zeros((3, 0)), **LENGTHS)["x"].shape == (0,)
