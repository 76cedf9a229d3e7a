"""A four-bar on a turned ground, and the coupler point of a slider-crank."""

import numpy as np
import pytest

from proofmass.analytic.linkages import fourbar, slider_crank
from tests.analytic.linkages.spectral import derivative

TURN = 2.0 * np.pi
GRID = np.arange(512) * TURN / 512
PROFILE = (GRID + 0.3 * np.sin(GRID), 1.0 + 0.3 * np.cos(GRID), -0.3 * np.sin(GRID))
FOUR = {"crank": 1.0, "coupler": 2.0, "rocker": 2.5, "ground": 3.0}
POINT = {"point_along": 0.7, "point_across": -0.4}
MASSES = {"crank_mass": 1.0, "coupler_mass": 2.0, "rocker_mass": 3.0}
ROUNDING = 1e-13  # some ten operations on numbers up to 10


@pytest.mark.parametrize("mode", fourbar.MODES)
def test_all_curves_turn_with_the_ground(mode):
    """Without gravity; with it a linkage and its weight do not turn together."""
    turn, inputs = 0.8, {**FOUR, **POINT, **MASSES, "mode": mode, "gravity": 0.0, "inertia": True}
    flat = fourbar.solve(*PROFILE, **inputs)
    turned = fourbar.solve(PROFILE[0] + turn, *PROFILE[1:], ground_angle=turn, **inputs)
    for curves in (flat, turned):  # infinite at dead centres
        curves["inverse_advantage"] = 1.0 / curves.pop("mechanical_advantage")
    for name, curve in flat.items():
        expected = curve
        if name.endswith("_angle") and name != "transmission_angle":
            expected = curve + turn
        elif name.startswith(("pin_", "point_")) and "force" not in name:
            pair = flat[name[:-1] + "x"] + 1j * flat[name[:-1] + "y"]
            spun = pair * np.exp(1j * turn)
            expected = spun.real if name.endswith("x") else spun.imag
        off = np.asarray(turned[name] - expected)
        if name.endswith("_angle"):
            off = (off + np.pi) % TURN - np.pi
        assert np.abs(off).max() <= ROUNDING * (1.0 + np.abs(curve).max()), name


def test_the_weight_of_a_turned_linkage_is_held_against_its_potential_energy():
    """The moment is the derivative of the energy of the mid-lengths by the crank angle."""
    turn = 0.8
    curves = fourbar.solve(GRID, **FOUR, **MASSES, ground_angle=turn)
    crank, pin = np.sin(GRID), curves["pin_y"]
    middles = crank / 2, (crank + pin) / 2, (pin + 3.0 * np.sin(turn)) / 2
    energy = 9.81 * sum(m * y for m, y in zip(MASSES.values(), middles, strict=True))
    off = curves["holding_moment"] - derivative(energy)
    assert np.abs(off).max() < 1e-10 * np.abs(curves["holding_moment"]).max()
    level = fourbar.solve(GRID, **FOUR, **MASSES)["holding_moment"]
    assert np.abs(curves["holding_moment"] - level).max() > 1.0  # the turn of the ground acts


@pytest.mark.parametrize("mode", slider_crank.MODES)
def test_the_coupler_point_of_a_slider_crank_moves_with_its_coupler(mode):
    """At the slider it is the slider; elsewhere its distances from both pins are constant."""
    linkage = {"crank": 1.0, "coupler": 2.0, "guide_y": 0.3, "guide_angle": 0.2, "mode": mode}
    at_slider = slider_crank.solve(*PROFILE, **linkage, point_along=2.0)
    for ending in ("x", "y", "vx", "vy", "ax", "ay"):
        off = at_slider[f"point_{ending}"] - at_slider[f"slider_{ending}"]
        assert np.abs(off).max() < ROUNDING * 10
    curves = slider_crank.solve(*PROFILE, **linkage, **POINT)
    point = curves["point_x"] + 1j * curves["point_y"]
    pin = np.exp(1j * PROFILE[0])
    slider = curves["slider_x"] + 1j * curves["slider_y"]
    assert np.abs(np.abs(point - pin) - np.hypot(0.7, 0.4)).max() < ROUNDING
    assert np.abs(np.abs(point - slider) - np.hypot(1.3, 0.4)).max() < ROUNDING
    left = ((point - pin) * (slider - pin).conj()).imag
    assert (left < 0).all()  # across is to the left
    for axis in "xy":
        for one, other in (
            (f"point_{axis}", f"point_v{axis}"),
            (f"point_v{axis}", f"point_a{axis}"),
        ):
            off = curves[other] - derivative(curves[one])
            assert np.abs(off).max() < 1e-9 * np.abs(curves[other]).max()
