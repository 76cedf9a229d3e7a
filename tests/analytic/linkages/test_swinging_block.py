"""Swinging-block closed form against an inverted slider-crank with its bar at rest, a triangle."""

import json
from pathlib import Path

import numpy as np
import pytest

from proofmass.analytic.linkages import inverted_slider_crank, swinging_block

DATA = json.loads((Path(__file__).parents[2] / "data" / "slider_cranks.json").read_text())
LINK = DATA["inverted_slider_crank"]["lengths"]
SWINGING_BLOCK = {"crank": 2.0, "rod": 3.0, "pivot_x": 2.0 + np.cos(0.8), "pivot_y": np.sin(0.8)}
MASSES = {"crank_mass": 1.3, "rod_mass": 2.1}
TURN = 2.0 * np.pi
GRID = np.arange(512) * TURN / 512


@pytest.mark.parametrize("mode", swinging_block.MODES)
def test_motion_is_that_of_an_inverted_slider_crank_with_its_bar_at_rest(mode):
    classic = swinging_block.solve(GRID, 1.3, -0.4, **SWINGING_BLOCK, mode=mode, **MASSES)
    pose = inverted_slider_crank.solve(
        [GRID, 0.8 + 0.0 * GRID], [1.3, 0.0], [-0.4, 0.0], **LINK, mode=mode, **MASSES
    )
    for name, curve in classic.items():  # rounding: the pivot is computed differently
        np.testing.assert_allclose(curve, pose[name], rtol=0, atol=1e-13 * np.ptp(curve))


def test_rocking_angles_and_time_ratio_of_the_rod():
    table = DATA["held_bar"]
    geometry = {name: SWINGING_BLOCK[name] for name in ("crank", "pivot_x", "pivot_y")}
    crank, rod = swinging_block.extremes(**geometry)
    line = np.arctan2(SWINGING_BLOCK["pivot_y"], SWINGING_BLOCK["pivot_x"])
    assert np.degrees(rod - line) == pytest.approx(
        [table["rocks_deg"], -table["rocks_deg"]], abs=5.1e-7
    )  # last digit
    pose = swinging_block.solve(crank, **SWINGING_BLOCK)
    assert np.abs(pose["rod_rate"]).max() <= 1e-15  # the rod turns back; rounding
    np.testing.assert_allclose(pose["rod_angle"], rod, rtol=1e-15)
    turn = swinging_block.solve(GRID, **SWINGING_BLOCK)["rod_angle"]
    assert rod[1] <= turn.min() < turn.max() <= rod[0]
    fast = crank[1] - crank[0]
    assert (TURN - fast) / fast == pytest.approx(table["time_ratio"], abs=5.1e-7)  # last digit
    upright = swinging_block.solve(np.pi / 2, **SWINGING_BLOCK)["slide"]
    assert upright == pytest.approx(table["slide_at_90_deg"], abs=5.1e-7)
    for crank, wrong in ((3.0, "shorter than the"), (0.0, "a positive finite length")):
        with pytest.raises(ValueError, match=f"crank must be {wrong}"):
            swinging_block.extremes(**{**geometry, "crank": crank})


@pytest.mark.parametrize("crank", [0.4, 1.7])
def test_swinging_block_satisfies_the_law_of_cosines(crank):
    """Law of cosines; the rod turns fully if the crank is longer than the ground."""
    pose = swinging_block.solve(GRID, crank=crank, rod=3.0, pivot_x=1.0)
    square = crank**2 + 1.0 - 2.0 * crank * np.cos(GRID)
    np.testing.assert_allclose(pose["slide"] ** 2, square, rtol=1e-14)  # rounding
    np.testing.assert_allclose(
        pose["rod_rate"], (crank**2 - crank * np.cos(GRID)) / square, rtol=0, atol=4e-15
    )  # rounding
    winds = pose["rod_angle"][-1] + pose["rod_rate"][-1] * TURN / 512 - pose["rod_angle"][0]
    assert winds == pytest.approx(TURN if crank > 1.0 else 0.0, abs=1e-3)  # curvature within a step


def test_bad_values_are_refused_and_shapes_broadcast():
    with pytest.raises(ValueError, match=r"^rod must be"):
        swinging_block.solve(0.1, **{**SWINGING_BLOCK, "rod": -1.0})
    with pytest.raises(ValueError, match="meets the slider at crank angle 0 rad"):
        swinging_block.solve([0.1, 0.0], crank=2.0, rod=3.0, pivot_x=2.0)
    assert {c.shape for c in swinging_block.solve(0.1, **SWINGING_BLOCK).values()} == {()}
    assert {c.shape for c in swinging_block.solve(0.1, np.ones(4), **SWINGING_BLOCK).values()} == {
        (4,)
    }


def test_angles_of_several_sweeps_are_each_unwrapped_along_the_last_axis():
    """Each row is as it is alone; the rod turns with the crank, and the second row runs back."""
    turns = np.array([np.linspace(0.0, 12.0, 60), np.linspace(12.0, 0.0, 60)])
    lengths = {"crank": 3.0, "rod": 9.0, "pivot_x": 1.0}
    together = swinging_block.solve(turns, **lengths)["rod_angle"]
    for row, sweep in zip(together, turns, strict=True):
        np.testing.assert_array_equal(row, swinging_block.solve(sweep, **lengths)["rod_angle"])
    assert np.ptp(together[0]) > TURN
