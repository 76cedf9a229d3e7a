"""Slider-crank closed form against derivatives, other formulations, limits, published numbers."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from proofmass.analytic.linkages import fourbar, slider_crank
from tests.analytic.linkages.spectral import assert_close, derivative

DATA = json.loads((Path(__file__).parents[2] / "data" / "slider_cranks.json").read_text())
THESIS = DATA["slider_crank"]
LINK = THESIS["lengths"]
INCLINED = {**LINK, "guide_x": 2.0, "guide_y": 0.5, "guide_angle": np.arctan2(0.5, 1.0)}
MASSES = {"crank_mass": 1.3, "coupler_mass": 2.1, "slider_mass": 0.7}
TURN = 2.0 * np.pi
MODES = pytest.mark.parametrize("mode", slider_crank.MODES)
GRID = np.arange(512) * TURN / 512
# A periodic crank profile whose derivatives are not zero, for spectral derivatives of the curves.
CRANK_PROFILE = (GRID + 0.3 * np.sin(GRID), 1.0 + 0.3 * np.cos(GRID), -0.3 * np.sin(GRID))


@st.composite
def full_turn_links(draw):
    """Lengths and a guide: the crank turns fully, the coupler is never normal to the guide."""
    crank, scale = draw(st.floats(0.1, 1.0)), draw(st.floats(1e-3, 1e3))
    offset = scale * crank * draw(st.floats(-2.0, 2.0))
    coupler = (scale * crank + abs(offset)) * draw(st.floats(1.15, 4.0))
    direction, along = draw(st.floats(-np.pi, np.pi)), scale * draw(st.floats(-3.0, 3.0))
    point = (along + 1j * offset) * np.exp(1j * direction)
    return {
        "crank": scale * crank,
        "coupler": coupler,
        "guide_x": point.real,
        "guide_y": point.imag,
        "guide_angle": direction,
    }


def link_size(link):
    return link["crank"] + link["coupler"] + np.hypot(link["guide_x"], link["guide_y"])


def constraints(q, link):
    """Phi of the thesis (text lines 3063-3131) and its Jacobian, poses along the first axis."""
    x1, y1, x2, y2, angle = q.T
    ux, uy = np.cos(link["guide_angle"]), np.sin(link["guide_angle"])
    none, one = np.zeros_like(x1), np.ones_like(x1)
    level, r = np.abs(np.cos(angle)) < np.sqrt(0.5), link["crank"]
    phi = [
        x1**2 + y1**2 - r**2,
        (x2 - x1) ** 2 + (y2 - y1) ** 2 - link["coupler"] ** 2,
        (x2 - link["guide_x"]) * uy - (y2 - link["guide_y"]) * ux,
        np.where(level, x1 - r * np.cos(angle), y1 - r * np.sin(angle)),
        none,
    ]
    rows = [
        [2 * x1, 2 * y1, none, none, none],
        [2 * (x1 - x2), 2 * (y1 - y2), 2 * (x2 - x1), 2 * (y2 - y1), none],
        [none, none, uy * one, -ux * one, none],
        [
            1.0 * level,
            1.0 * ~level,
            none,
            none,
            np.where(level, r * np.sin(angle), -r * np.cos(angle)),
        ],
        [none, none, none, none, one],
    ]
    return np.stack(phi, -1), np.moveaxis(np.array(rows), 2, 0)


def solve_linear(matrix, right):
    return np.linalg.solve(matrix, right[..., None])[..., 0]


def natural_coordinates(angle, rate, acceleration, link, guess):
    """x1, y1, x2, y2, angle and derivatives, (3, n, 5), by Newton-Raphson; guess = x2 + i y2."""
    pin = link["crank"] * np.exp(1j * angle)
    q = np.stack([pin.real, pin.imag, guess.real, guess.imag, angle], -1)
    for _ in range(8):
        phi, jacobian = constraints(q, link)
        q = q + solve_linear(jacobian, -phi)
    jacobian = constraints(q, link)[1]
    none = np.zeros_like(angle)
    v = solve_linear(jacobian, np.stack([none, none, none, none, rate], -1))
    turn = np.where(jacobian[:, 3, 0] == 1.0, np.cos(angle), np.sin(angle))
    b = np.stack(
        [
            2 * (v[:, :2] ** 2).sum(-1),
            2 * ((v[:, 2:4] - v[:, :2]) ** 2).sum(-1),
            none,
            rate**2 * link["crank"] * turn,
            -acceleration,
        ],
        -1,
    )
    return np.stack([q, v, solve_linear(jacobian, -b)])


@settings(derandomize=True, max_examples=60, deadline=None)
@given(full_turn_links(), st.sampled_from(slider_crank.MODES))
def test_loop_and_derivatives_of_random_links(link, mode):
    pose = slider_crank.solve(*CRANK_PROFILE, **link, mode=mode)
    slider = pose["slider_x"] + 1j * pose["slider_y"]
    coupler = link["coupler"] * np.exp(1j * pose["coupler_angle"])
    along = np.exp(1j * link["guide_angle"])
    closed = link["crank"] * np.exp(1j * CRANK_PROFILE[0]) + coupler - slider
    on_guide = link["guide_x"] + 1j * link["guide_y"] + pose["slide"] * along - slider
    assert np.abs([closed, on_guide]).max() <= 1e-14 * link_size(link)  # rounding: ten operations
    assert np.all(mode * (coupler / along).real > 0)
    # 1e-10: rounding times the highest wave number, 256 eps = 6e-14, times the ratio of a curve,
    # with its mean, to its derivative, up to 1e3
    for name in ("slide", "coupler"):
        value = pose["slide" if name == "slide" else "coupler_angle"]
        assert_close(derivative(value), pose[f"{name}_rate"], 1e-10)
        assert_close(derivative(pose[f"{name}_rate"]), pose[f"{name}_acceleration"], 1e-10)
    for part, name in (("v", "rate"), ("a", "acceleration")):
        vector = pose[f"slider_{part}x"] + 1j * pose[f"slider_{part}y"]
        assert_close(vector, pose[f"slide_{name}"] * along, 1e-14)  # rounding


@settings(derandomize=True, max_examples=30, deadline=None)
@given(full_turn_links(), st.sampled_from(slider_crank.MODES))
def test_newton_raphson_in_natural_coordinates_agrees(link, mode):
    pose = slider_crank.solve(*CRANK_PROFILE, **link, mode=mode)
    guess = pose["slider_x"] + 1j * pose["slider_y"] + 1e-3 * link["crank"]  # off the solution
    # 1e-12: eps times the Jacobian's condition, up to 1e3 where the coupler leans most
    for part, q in zip(
        ("", "v", "a"), natural_coordinates(*CRANK_PROFILE, link, guess), strict=True
    ):
        found = pose[f"slider_{part}x"] + 1j * pose[f"slider_{part}y"]
        assert_close(found, q[:, 2] + 1j * q[:, 3], 1e-12)


@settings(derandomize=True, max_examples=30, deadline=None)
@given(full_turn_links(), st.sampled_from(slider_crank.MODES), st.floats(-3.0, 3.0))
def test_a_rotated_linkage_has_a_rotated_motion(link, mode, by):
    pose = slider_crank.solve(*CRANK_PROFILE, **link, mode=mode)
    point = (link["guide_x"] + 1j * link["guide_y"]) * np.exp(1j * by)
    turned = slider_crank.solve(
        CRANK_PROFILE[0] + by,
        *CRANK_PROFILE[1:],
        **{
            **link,
            "guide_x": point.real,
            "guide_y": point.imag,
            "guide_angle": link["guide_angle"] + by,
        },
        mode=mode,
    )
    for part in ("slide", "slide_rate", "slide_acceleration"):
        # 1e-13: rounding of angles of up to 10 rad, through slopes of up to 50
        bound = 1e-13 * max(np.abs(pose[part]).max(), link_size(link))
        np.testing.assert_allclose(turned[part], pose[part], rtol=0, atol=bound)
    np.testing.assert_allclose(
        turned["transmission_angle"], pose["transmission_angle"], rtol=0, atol=1e-13
    )  # rounding as above


@MODES
def test_modes_are_mirror_images_about_the_normal(mode):
    angle, rate, acceleration = CRANK_PROFILE
    pose = slider_crank.solve(*CRANK_PROFILE, **LINK, guide_y=0.4, mode=mode)
    image = slider_crank.solve(np.pi - angle, -rate, -acceleration, **LINK, guide_y=0.4, mode=-mode)
    for name in ("slide", "slide_rate", "slide_acceleration"):
        # rounding of pi - angle, through slopes of up to 5
        np.testing.assert_allclose(image[name], -pose[name], rtol=0, atol=1e-14)


def test_a_four_bar_with_a_long_rocker_is_a_slider_crank():
    angle, rate, acceleration = (x[::8] for x in CRANK_PROFILE)
    pose = slider_crank.solve(angle, rate, acceleration, **LINK)
    errors = []
    for rocker in (1e4, 1e5):  # pivot far below the guide, linkage turned by a quarter
        bar = fourbar.solve(
            angle + np.pi / 2, rate, acceleration, **LINK, rocker=rocker, ground=rocker, mode=1
        )
        along = np.stack([bar["pin_y"], bar["pin_vy"], bar["pin_ay"], bar["transmission_angle"]])
        straight = np.stack(
            [pose[n] for n in ("slide", "slide_rate", "slide_acceleration", "transmission_angle")]
        )
        errors.append(np.abs(along - straight).max(axis=1))
    # the pin's circle leaves the guide by x^2/2R: every error falls with 1/R
    np.testing.assert_allclose(errors[0] / errors[1], 10.0, rtol=2e-3)  # next order, 1/R^2
    assert np.all(errors[1] < 1e-4)


@MODES
def test_holding_moment_is_the_slope_of_the_potential_energy(mode):
    load = -40.0
    pose = slider_crank.solve(
        GRID, 5.0, **INCLINED, mode=mode, **MASSES, gravity=3.7, slider_load=load
    )
    crank_y = LINK["crank"] * np.sin(GRID)
    heights = crank_y / 2, (crank_y + pose["slider_y"]) / 2, pose["slider_y"]
    energy = 3.7 * sum(m * y for m, y in zip(MASSES.values(), heights, strict=True))
    energy -= load * pose["slide"]
    assert_close(pose["holding_moment"], derivative(energy), 1e-12)  # spectral rounding, as above
    assert abs(pose["holding_moment"].mean()) <= 1e-13 * np.ptp(energy)  # no work over a turn
    assert not slider_crank.solve(GRID, **LINK)["holding_moment"].any()


def test_printed_pose_of_the_thesis():
    printed = THESIS["position"]
    for point in THESIS["guide_through"]:  # the slide counts from the given point
        pose = slider_crank.solve(THESIS["angle"], **LINK, guide_x=point[0])
        assert pose["slider_x"] == pytest.approx(printed["x"], abs=5.1e-9)  # half a last digit
        assert pose["slide"] == pytest.approx(printed["x"] - point[0], abs=5.1e-9)
        assert pose["slider_y"] == 0.0
    other = slider_crank.solve(THESIS["angle"], **LINK, mode=-1)
    assert other["slider_x"] == pytest.approx(printed["other_assembly_x"], abs=1e-15)  # rounding


def test_velocities_of_the_thesis_and_their_misprint():
    table, link = THESIS["velocity"], {**LINK, "guide_x": 2.0, "guide_y": 0.0, "guide_angle": 0.0}
    pose = slider_crank.solve(THESIS["angle"], table["rate"], **LINK)
    assert pose["slider_vx"] == pytest.approx(table["true"][2], abs=1e-11)  # 12 digits
    assert abs(pose["slider_vx"] - table["printed"][2]) > 1.0
    q = natural_coordinates(
        *np.array([[THESIS["angle"]], [1.0], [0.0]]), link, np.array([2.8 + 0j])
    )[0]
    jacobian = constraints(q, link)[1][0]
    right = np.array([0.0, 0.0, 0.0, 0.0, 1.0])
    np.testing.assert_allclose(solve_linear(jacobian, right), table["true"], rtol=0, atol=1e-11)
    jacobian[3, 4] = np.cos(0.0)  # wrong sign, and the angle overwritten with zero
    np.testing.assert_allclose(solve_linear(jacobian, right), table["printed"], rtol=0, atol=5.1e-9)


@pytest.mark.parametrize("row", THESIS["accelerations"], ids=lambda row: row["status"][:12])
def test_accelerations_of_the_thesis(row):
    pose = slider_crank.solve(THESIS["angle"], 1.0, row["acceleration"], **LINK)
    error = abs(pose["slider_ax"] - row["x"])
    if "misprint" in row["status"]:
        assert error > 1.0
    else:
        assert error <= 5.1e-9  # half a unit of the last printed digit


def test_curves_are_those_of_the_cycle_table():
    table = DATA["slider_crank_cycle"]
    columns = np.array(table["rows"]).T
    pose = slider_crank.solve(columns[0], **LINK)
    for name, column in zip(table["columns"][1:], columns[1:], strict=True):
        np.testing.assert_allclose(pose[name], column, rtol=0, atol=1e-11)  # table has 12 digits
    exact = slider_crank.solve(np.array([0.0, 0.5, 1.0]) * np.pi, **LINK)
    for name, values in (
        ("slide", [3.0, np.sqrt(3.0), 1.0]),
        ("slide_rate", [0.0, -1.0, 0.0]),
        ("slide_acceleration", [-1.5, 1.0 / np.sqrt(3.0), 0.5]),
    ):
        np.testing.assert_allclose(exact[name], values, rtol=0, atol=5e-16)  # rounding of pi


def test_motion_on_an_inclined_guide_is_that_of_the_table():
    table = DATA["slider_crank_inclined"]
    (x, y), (x2, y2) = table["guide_through"]
    pose = slider_crank.solve(
        table["angle"], **LINK, guide_x=x, guide_y=y, guide_angle=np.arctan2(y2 - y, x2 - x)
    )
    for name in ("slider_x", "slider_y", "slider_vx", "slider_vy", "slider_ax", "slider_ay"):
        assert pose[name] == pytest.approx(table[name], abs=5.1e-7), name  # six decimals


def test_extremes_of_the_thesis_sweep():
    table = THESIS["sweep"]
    slides = slider_crank.solve(GRID, **LINK)["slide"]
    assert [slides.min(), slides.max()] == pytest.approx(
        table["slide"], rel=1e-15, abs=0
    )  # rounding
    # fastest where x = sin^2 solves x^3 - n^2 x^2 - n^4 x + n^4 = 0 with n = coupler/crank = 2
    root = min(x.real for x in np.roots([1, -4, -16, 16]) if x.real > 0)
    peak = slider_crank.solve(np.arcsin(np.sqrt(root)), **LINK)
    assert abs(peak["slide_acceleration"]) <= 2e-15  # rounding of the root
    assert -peak["slide_rate"] == pytest.approx(table["speed_max"], abs=5.1e-6)  # last digit
    assert table["leaves_the_drawn_guide_at"] == pytest.approx(np.arccos(0.25), rel=1e-15, abs=0)
    assert slider_crank.solve(np.arccos(0.25), **LINK)["slide"] == pytest.approx(
        2.0, rel=1e-15, abs=0
    )


@settings(derandomize=True, max_examples=40, deadline=None)
@given(full_turn_links(), st.sampled_from(slider_crank.MODES))
def test_dead_points_are_where_the_slider_reverses(link, mode):
    angles, slides = slider_crank.dead_points(**link, mode=mode)
    pose = slider_crank.solve(angles, **link, mode=mode)
    # rounding of the angles, times the slide's second derivative of up to ten sizes
    np.testing.assert_allclose(pose["slide_rate"], 0.0, rtol=0, atol=1e-13 * link_size(link))
    np.testing.assert_allclose(pose["slide"], slides, rtol=0, atol=1e-13 * link_size(link))
    turn = slider_crank.solve(GRID, **link, mode=mode)["slide"]
    assert turn.min() >= slides.min() - 1e-13 * link_size(link)
    assert turn.max() <= slides.max() + 1e-13 * link_size(link)


def test_rate_has_a_limit_at_the_fold_of_equal_crank_and_coupler():
    """Near pi/2 the condition number of the Jacobian grows like 1/eps, but the rate has a limit."""
    table, link = DATA["slider_crank_fold"], {"crank": 1.0, "coupler": 1.0}
    axis = {"guide_x": 0.0, "guide_y": 0.0, "guide_angle": 0.0}
    for eps in (1e-3, 1e-4):
        angle = np.pi / 2 - eps
        q = np.array([[np.cos(angle), np.sin(angle), 2 * np.cos(angle), 0.0, angle]])
        phi, jacobian = constraints(q, link | axis)
        assert np.abs(phi).max() <= 1e-15  # rounding: the pose is closed
        condition = np.linalg.cond(jacobian[0]) * eps
        assert condition == pytest.approx(table["condition_times_eps"], abs=5.1e-3)  # last digit
        pose = slider_crank.solve(angle, **link)
        limit = table["rate_at_the_fold"]
        assert pose["slide_rate"] == pytest.approx(limit * np.cos(eps), rel=1e-13, abs=0)  # exact
