"""Four-bar closed form against derivatives, a second formulation and published numbers."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from proofmass.analytic.linkages import fourbar
from tests.analytic.linkages.spectral import derivative

DATA = json.loads((Path(__file__).parents[2] / "data" / "four_bar.json").read_text())
THESIS = DATA["cases"][0]
LINK = THESIS["lengths"]
TURN = 2.0 * np.pi
MODES = pytest.mark.parametrize("mode", fourbar.MODES)
GRID = np.arange(512) * TURN / 512
# A periodic crank profile whose derivatives are not zero, for spectral derivatives of the curves.
CRANK_PROFILE = (GRID + 0.3 * np.sin(GRID), 1.0 + 0.3 * np.cos(GRID), -0.3 * np.sin(GRID))
POINT = {"point_along": 0.7, "point_across": -0.4}


@st.composite
def crank_rockers(draw):
    """Lengths whose crank turns fully; margins keep coupler and rocker out of line."""
    crank, scale = draw(st.floats(0.1, 0.7)), draw(st.floats(1e-3, 1e3))
    total = (1.0 + crank) * draw(st.floats(1.1, 2.0))
    difference = (1.0 - crank) * draw(st.floats(-0.9, 0.9))
    coupler, rocker = (total + difference) / 2.0, (total - difference) / 2.0
    return {
        "crank": scale * crank,
        "coupler": scale * coupler,
        "rocker": scale * rocker,
        "ground": scale,
    }


def assert_close(actual, expected, tolerance):
    """Largest error within `tolerance` times the largest deviation of `expected` from its mean."""
    error = np.abs(actual - expected).max() / np.abs(expected - expected.mean()).max()
    assert error <= tolerance, f"error {error:.3g} of the curve"


def check_derivative(curve, expected, least_sine, order=1):
    """Check that `expected` is the spectral derivative of a curve with 512 samples.

    A sample has rounding errors of some ten operations, 100 eps of the largest value, which are
    divided by the sine of the transmission angle once for rates and once more for accelerations.
    The derivative multiplies them by up to the highest wave number, 256, to the power of the order.
    Over the range of `expected`, which short bars make small against the curve, this is the error.
    """
    rounding = 100.0 * np.finfo(float).eps * 256.0**order * np.abs(curve).max() / least_sine**2
    tolerance = rounding / np.abs(expected - expected.mean()).max()
    assert_close(derivative(curve, order), expected, tolerance)


def loop_violations(angle, pose, link):
    def vector(length, at):
        return length * np.exp(1j * at)

    over = vector(link["crank"], angle) + vector(link["coupler"], pose["coupler_angle"])
    under = link["ground"] + vector(link["rocker"], pose["rocker_angle"])
    return np.abs(over - under), np.abs(over - pose["pin_x"] - 1j * pose["pin_y"])


def check_loop_and_derivatives(link, mode, profile=CRANK_PROFILE, least_sine=None):
    """Check the closed loop, the rigid coupler, and all rates and accelerations as derivatives.

    `least_sine` is that of the transmission angle if none is given.
    """
    pose = fourbar.solve(*profile, **link, mode=mode, **POINT)
    for violation in loop_violations(profile[0], pose, link):
        assert violation.max() <= 1e-14 * max(link.values())  # rounding: about ten operations
    arm = pose["point_x"] + 1j * pose["point_y"] - link["crank"] * np.exp(1j * profile[0])
    turned = arm * np.exp(-1j * pose["coupler_angle"])
    # rounding of coordinates and of an angle of a few turns
    assert np.abs(turned - complex(*POINT.values())).max() <= 1e-14 * (max(link.values()) + 1.0)
    least_sine = least_sine or np.abs(np.sin(pose["transmission_angle"])).min()
    for bar in ("coupler", "rocker"):
        along = np.exp(1j * pose[f"{bar}_angle"])
        check_derivative(along, 1j * pose[f"{bar}_rate"] * along, least_sine)
        check_derivative(pose[f"{bar}_rate"], pose[f"{bar}_acceleration"], least_sine)
    for place in ("pin_{}x", "pin_{}y", "point_{}x", "point_{}y"):
        curve, first, second = (pose[place.format(part)] for part in ("", "v", "a"))
        check_derivative(curve, first, least_sine)
        check_derivative(first, second, least_sine)
        check_derivative(curve, second, least_sine, 2)
    return pose


@MODES
def test_loop_and_derivatives_of_the_thesis_linkage(mode):
    check_loop_and_derivatives(LINK, mode)


@settings(derandomize=True, max_examples=40, deadline=None)
@given(crank_rockers(), st.sampled_from(fourbar.MODES))
def test_loop_and_derivatives_of_random_crank_rockers(link, mode):
    check_loop_and_derivatives(link, mode)


@settings(derandomize=True, max_examples=25, deadline=None)
@given(crank_rockers(), st.sampled_from(fourbar.MODES))
def test_newton_raphson_on_the_raw_loop_equations_agrees(link, mode):
    angle, rate, acceleration = CRANK_PROFILE
    pose = fourbar.solve(*CRANK_PROFILE, **link, mode=mode)
    bars = np.stack([pose["coupler_angle"], pose["rocker_angle"]]) + 1e-3  # off the solution
    arms = np.array([[link["coupler"]], [-link["rocker"]]])

    def solved(complex_right_side, at):
        columns = 1j * arms * np.exp(1j * at)
        matrix = np.stack([columns.real.T, columns.imag.T], axis=1)
        right = np.stack([complex_right_side.real, complex_right_side.imag], axis=1)
        return np.linalg.solve(matrix, right[..., None])[..., 0].T

    turned = link["crank"] * np.exp(1j * angle)
    for _ in range(8):
        bars = bars - solved(turned + (arms * np.exp(1j * bars)).sum(0) - link["ground"], bars)
    rates = solved(-1j * turned * rate, bars)
    spin = (arms * np.exp(1j * bars) * rates**2).sum(0)
    second = solved(spin - turned * (1j * acceleration - rate**2), bars)
    # Rounding of the 2x2 solutions: eps times their condition (up to 1e2 here), squared by the
    # rates in the acceleration.
    for found, name in ((bars, "angle"), (rates, "rate"), (second, "acceleration")):
        for row, bar in zip(found, ("coupler", "rocker"), strict=True):
            assert_close(row, pose[f"{bar}_{name}"], 1e-11)


@MODES
def test_modes_are_mirror_images(mode):
    angle, rate, acceleration = CRANK_PROFILE
    pose = fourbar.solve(*CRANK_PROFILE, **LINK, mode=mode, point_along=0.7, point_across=-0.4)
    image = fourbar.solve(
        -angle, -rate, -acceleration, **LINK, mode=-mode, point_along=0.7, point_across=0.4
    )
    same = (
        "pin_x",
        "pin_vx",
        "pin_ax",
        "point_x",
        "point_vx",
        "point_ax",
        "transmission_angle",
        "holding_moment",
    )
    for name in pose.keys() - {"mechanical_advantage"}:
        # eps: the two calls add the same terms in another order
        sign = 1.0 if name in same else -1.0
        np.testing.assert_allclose(image[name], sign * pose[name], rtol=0, atol=4e-15)
    ratio = image["mechanical_advantage"] / pose["mechanical_advantage"]
    # as above, over the smallest rocker rate on the grid, 2e-3
    np.testing.assert_allclose(ratio, 1.0, rtol=0, atol=2e-12)


@MODES
def test_mode_is_the_side_of_the_pin(mode):
    pose = fourbar.solve(GRID, **LINK, mode=mode)
    crank_pin = LINK["crank"] * np.exp(1j * GRID)
    pin = pose["pin_x"] + 1j * pose["pin_y"]
    assert np.all(mode * ((LINK["ground"] - crank_pin).conj() * (pin - crank_pin)).imag > 0)


@MODES
def test_holding_moment_is_the_slope_of_the_potential_energy(mode):
    masses = {"crank_mass": 1.3, "coupler_mass": 2.1, "rocker_mass": 0.7}
    pose = fourbar.solve(GRID, 5.0, **LINK, mode=mode, **masses, gravity=3.7)
    crank_y = LINK["crank"] * np.sin(GRID)
    heights = crank_y / 2, (crank_y + pose["pin_y"]) / 2, pose["pin_y"] / 2
    energy = 3.7 * sum(m * y for m, y in zip(masses.values(), heights, strict=True))
    assert_close(pose["holding_moment"], derivative(energy), 1e-12)  # spectral rounding, as above
    work = pose["holding_moment"].mean() * TURN
    assert abs(work) <= 1e-13 * np.ptp(energy)  # conservative: no work over a turn, rounding only
    assert not fourbar.solve(GRID, **LINK)["holding_moment"].any()


@pytest.mark.parametrize("load", [-2.0, 0.5])
@MODES
def test_a_load_on_the_rocker_does_the_work_that_the_crank_puts_in(mode, load):
    pose = fourbar.solve(GRID, 5.0, **LINK, mode=mode, rocker_load=load)
    # 1e-12: spectral rounding, as above
    assert_close(derivative(-load * pose["rocker_angle"]), pose["holding_moment"], 1e-12)
    assert abs(pose["holding_moment"].mean()) <= 1e-15  # no work over a turn, rounding only


@MODES
def test_coupler_points_at_ends_and_middle_move_as_the_pins(mode):
    ends = {
        name: fourbar.solve(*CRANK_PROFILE, **LINK, mode=mode, point_along=along)
        for name, along in (("start", 0.0), ("middle", 1.0), ("end", LINK["coupler"]))
    }
    for part in ("x", "y", "vx", "vy", "ax", "ay"):
        start, middle, end = (pose[f"point_{part}"] for pose in ends.values())
        # rounding of lengths up to 3 and rates up to 5
        np.testing.assert_allclose(end, ends["end"][f"pin_{part}"], rtol=0, atol=2e-14)
        np.testing.assert_allclose(middle, (start + end) / 2, rtol=0, atol=2e-14)
    angle, rate, acceleration = CRANK_PROFILE
    spin = 1j * rate * np.exp(1j * angle)
    np.testing.assert_allclose(ends["start"]["point_x"], np.cos(angle), rtol=0, atol=1e-15)
    np.testing.assert_allclose(ends["start"]["point_vy"], spin.imag, rtol=0, atol=2e-15)
    second = (1j * acceleration - rate**2) * np.exp(1j * angle)
    np.testing.assert_allclose(ends["start"]["point_ax"], second.real, rtol=0, atol=2e-15)


def test_printed_pose_of_the_thesis():
    pose = fourbar.solve(THESIS["angle"], 1.0, **LINK, mode=THESIS["mode"])
    for name, printed in THESIS["printed"].items():
        assert pose[name] == pytest.approx(printed, abs=5.1e-9)  # half a unit of the last digit
    assert pose["pin_y"] == pytest.approx(-np.sqrt(975) / 16, rel=1e-15, abs=0)  # exact value
    assert pose["rocker_rate"] == pytest.approx(-0.5, abs=1e-15)  # exact value
    other = fourbar.solve(THESIS["angle"], **LINK, mode=-THESIS["mode"])
    assert other["pin_y"] == -pose["pin_y"]


@pytest.mark.parametrize("row", THESIS["acceleration_rows"], ids=lambda row: row["status"][:12])
def test_accelerations_of_the_thesis(row):
    pose = fourbar.solve(0.0, 1.0, row["acceleration"], **LINK, mode=THESIS["mode"])
    found = np.array([pose["pin_ax"], pose["pin_ay"]])
    error = np.abs(found - [row["pin_ax"], row["pin_ay"]]).max()
    if "misprint" in row["status"]:
        assert error > 1.0
    else:
        assert error <= 5.1e-9  # half a unit of the last printed digit


def test_curves_are_those_of_the_cycle_table():
    table = np.array(DATA["cycle"]["rows"])
    pose = fourbar.solve(table[:, 0], **LINK, mode=-1)
    for name, column in zip(DATA["cycle"]["columns"][1:], table.T[1:], strict=True):
        np.testing.assert_allclose(pose[name], column, rtol=0, atol=1e-11)  # table has 12 digits


@pytest.mark.parametrize("name", ["pin_vx", "pin_vy", "pin_ax", "pin_ay"])
def test_extremes_are_those_of_the_plots(name):
    plots, angle = DATA["plots"], np.linspace(0.0, 2 * 3.1416, 50)
    curve = fourbar.solve(angle, 1.0, plots["acceleration"], **LINK, mode=-1)[name]
    # half a unit of the last of 7 digits
    np.testing.assert_allclose([curve.min(), curve.max()], plots[name], rtol=0, atol=5.1e-7)


@pytest.mark.parametrize("case", DATA["norton"], ids=lambda case: f"mode{case['mode']:+d}")
def test_norton_example_is_met(case):
    pose = fourbar.solve(
        np.radians(case["angle_deg"]),
        case["rate"],
        case["acceleration"],
        **case["lengths"],
        mode=case["mode"],
    )
    for bar in ("coupler", "rocker"):
        for name, key in (("angle", "pos"), ("rate", "vel"), ("acceleration", "acc")):
            # rounding only: the reference has 22 digits
            assert pose[f"{bar}_{name}"] == pytest.approx(float(case[bar][key]), rel=1e-14, abs=0)


def test_angles_follow_a_double_crank_through_whole_turns():
    angle = np.linspace(0.0, 3 * TURN, 601)
    pose = fourbar.solve(angle, crank=2.0, coupler=2.5, rocker=3.0, ground=1.0)
    for bar in ("coupler", "rocker"):
        curve = pose[f"{bar}_angle"]
        assert np.abs(np.diff(curve)).max() < 0.1
    assert np.ptp(pose["rocker_angle"][[0, -1]]) == pytest.approx(3 * TURN, abs=1e-14)  # rounding


def test_shapes_broadcast():
    pose = fourbar.solve(np.zeros((3, 1)), np.ones(4), **LINK)
    assert {curve.shape for curve in pose.values()} == {(3, 4)}
    assert {curve.shape for curve in fourbar.solve(0.0, **LINK).values()} == {()}
    assert {curve.shape for curve in fourbar.solve([], **LINK).values()} == {(0,)}


@pytest.mark.parametrize("name", ["crank", "coupler", "rocker", "ground"])
@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, np.inf])
def test_bad_length_is_named(name, value):
    with pytest.raises(ValueError, match=f"^{name} must be"):
        fourbar.solve(0.0, **{**LINK, name: value})


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"mode": 0}, "mode must be"),
        ({"rocker_mass": -1.0}, "rocker_mass must be"),
        ({"point_across": np.nan}, "point_across must be"),
        ({"rocker_load": np.inf}, "rocker_load must be"),
    ],
)
def test_other_bad_values_are_named(change, message):
    with pytest.raises(ValueError, match=message):
        fourbar.solve(0.0, **LINK, **change)


def test_mechanical_advantage_conserves_power():
    pose = fourbar.solve(GRID, 3.0, **LINK, mode=-1)
    sums = pose["mechanical_advantage"] * pose["rocker_rate"]
    np.testing.assert_allclose(sums, 3.0, rtol=1e-14)  # power in is power out; rounding
    at_zero = fourbar.solve(0.0, **LINK, mode=-1)["mechanical_advantage"]
    assert at_zero == pytest.approx(-2.0, rel=1e-14, abs=0)  # exact: the rocker turns at -1/2
