"""Inverted slider-crank closed form against derivatives, other formulations, published numbers."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from proofmass.analytic.linkages import inverted_slider_crank
from tests.analytic.linkages.spectral import assert_close, derivative

DATA = json.loads((Path(__file__).parents[2] / "data" / "slider_cranks.json").read_text())
THESIS = DATA["inverted_slider_crank"]
LINK = THESIS["lengths"]
INPUTS = THESIS["angles"], THESIS["rates"]
TURN = 2.0 * np.pi
MODES = pytest.mark.parametrize("mode", inverted_slider_crank.MODES)
GRID = np.arange(512) * TURN / 512
# Periodic profiles whose derivatives are not zero, for spectral derivatives of the curves.
INPUT_PROFILES = np.array(
    [
        [GRID + 0.3 * np.sin(GRID), 2.0 * GRID + 0.2 * np.cos(GRID)],
        [1.0 + 0.3 * np.cos(GRID), 2.0 - 0.2 * np.sin(GRID)],
        [-0.3 * np.sin(GRID), -0.2 * np.cos(GRID)],
    ]
)


@st.composite
def links(draw):
    """Lengths with which the crank pin never comes near the slider."""
    scale, direction = draw(st.floats(1e-3, 1e3)), draw(st.floats(-np.pi, np.pi))
    reach, share = draw(st.floats(0.2, 0.8)), draw(st.floats(0.1, 0.9))
    ground = scale * np.exp(1j * direction)
    return {
        "crank": scale * reach * share,
        "bar": scale * reach * (1.0 - share),
        "rod": scale * draw(st.floats(0.5, 3.0)),
        "ground_x": ground.real,
        "ground_y": ground.imag,
    }


def point_motion(pose, name):
    """Position, velocity and acceleration of a point as complex numbers."""
    return [pose[f"{name}_{part}x"] + 1j * pose[f"{name}_{part}y"] for part in ("", "v", "a")]


def constraints(q, link):
    """Phi of the thesis and its Jacobian by x1 y1 x2 y2 x3 y3, inputs given (lines 3497-3601)."""
    x1, y1, x2, y2, x3, y3 = q
    bx, by = link["ground_x"], link.get("ground_y", 0.0)
    phi = [
        (x2 - x1) ** 2 + (y2 - y1) ** 2 - link["rod"] ** 2,
        (x3 - x1) * (y2 - y1) - (x2 - x1) * (y3 - y1),
        x1**2 + y1**2 - link["crank"] ** 2,
        (x3 - bx) ** 2 + (y3 - by) ** 2 - link["bar"] ** 2,
    ]
    jacobian = [
        [-2 * (x2 - x1), -2 * (y2 - y1), 2 * (x2 - x1), 2 * (y2 - y1), 0, 0],
        [y3 - y2, x2 - x3, y1 - y3, x3 - x1, y2 - y1, x1 - x2],
        [2 * x1, 2 * y1, 0, 0, 0, 0],
        [0, 0, 0, 0, 2 * (x3 - bx), 2 * (y3 - by)],
    ]
    return np.array(phi), np.array(jacobian)


def solve_end_of_rod(p1, p3, guess, link):
    """Motion of point 2 by Newton-Raphson, from the motions (3,) of points 1 and 3."""

    def row(p2, k):
        return np.array([p1[k].real, p1[k].imag, p2.real, p2.imag, p3[k].real, p3[k].imag])

    def solved(jacobian, known, right):
        return complex(*np.linalg.solve(jacobian[:2, 2:4], right - jacobian[:2] @ known))

    place = guess
    for _ in range(8):
        phi, jacobian = constraints(row(place, 0), link)
        place += complex(*np.linalg.solve(jacobian[:2, 2:4], -phi[:2]))
    jacobian = constraints(row(place, 0), link)[1]
    v = row(solved(jacobian, row(0j, 1), np.zeros(2)), 1)
    right = right_side(v)
    return place, complex(v[2], v[3]), solved(jacobian, row(0j, 2), -right)


def right_side(v):
    """b of J qpp = -b for the rows of the rod's length and of points 1, 3, 2 in line."""
    x1, y1, x2, y2, x3, y3 = v
    return np.array(
        [
            2 * (x2 - x1) ** 2 + 2 * (y2 - y1) ** 2,
            2 * ((x3 - x1) * (y2 - y1) - (x2 - x1) * (y3 - y1)),
        ]
    )


def check_derivative(curve, expected):
    """Check that `expected` is the spectral derivative of a curve with 512 samples.

    Rounding of a sample, 20 eps, times the highest wave number, 256, is 1.1e-12 of the largest
    value of the curve.  Accelerations are divided twice by the slide, whose own rounding is
    relative to the ground; the slide is at least 0.2 of it, and 1.1e-12 / 0.2^3 is 1.4e-10.  Twice
    that is allowed; none of 36 random seeds needed more.  The curve's ratio to `expected` is large
    for short cranks.
    """
    ratio = np.abs(curve).max() / np.abs(expected).max()
    assert_close(derivative(curve), expected, 3e-10 * max(ratio, 1.0))


@settings(derandomize=True, max_examples=50, deadline=None)
@given(links(), st.sampled_from(inverted_slider_crank.MODES))
def test_loop_and_derivatives_of_random_links(link, mode):
    pose = inverted_slider_crank.solve(*INPUT_PROFILES, **link, mode=mode)
    rod = np.exp(1j * pose["rod_angle"])
    pin, ground = (
        link["crank"] * np.exp(1j * INPUT_PROFILES[0, 0]),
        link["ground_x"] + 1j * link["ground_y"],
    )
    tip, slider, end = (
        ground + link["bar"] * np.exp(1j * INPUT_PROFILES[0, 1]),
        *(point_motion(pose, name)[0] for name in ("slider", "end")),
    )
    violations = [slider - tip, pin + pose["slide"] * rod - slider, pin + link["rod"] * rod - end]
    # rounding: ten operations
    assert np.abs(violations).max() <= 1e-14 * (abs(ground) + link["rod"])
    assert np.all(mode * pose["slide"] > 0)
    for name, rate in (("slide", "slide"), ("rod_angle", "rod")):
        check_derivative(pose[name], pose[f"{rate}_rate"])
        check_derivative(pose[f"{rate}_rate"], pose[f"{rate}_acceleration"])
    for name in ("end", "slider"):
        for k in (0, 1):
            place, rate = point_motion(pose, name)[k : k + 2]
            check_derivative(place.real, rate.real)
            check_derivative(place.imag, rate.imag)


@settings(derandomize=True, max_examples=30, deadline=None)
@given(links(), st.sampled_from(inverted_slider_crank.MODES))
def test_newton_raphson_in_natural_coordinates_agrees(link, mode):
    profiles = INPUT_PROFILES[:, :, ::64]
    pose = inverted_slider_crank.solve(*profiles, **link, mode=mode)
    arms = np.array([[link["crank"]], [link["bar"]]]) * np.exp(1j * profiles[0])
    ground = np.array([[0.0], [link["ground_x"] + 1j * link["ground_y"]]])
    points = [arms + ground, 1j * profiles[1] * arms, (1j * profiles[2] - profiles[1] ** 2) * arms]
    end = np.array(point_motion(pose, "end"))
    for k in range(profiles.shape[2]):
        first, third = ([x[i, k] for x in points] for i in (0, 1))
        found = solve_end_of_rod(first, third, end[0, k] + 1e-3 * link["rod"], link)
        # 1e-12: eps times the condition of the rows, rod over slide, up to 20, squared by the rates
        bound = 1e-12 * np.abs(end).max(axis=1)
        assert np.all(np.abs(np.array(found) - end[:, k]) <= bound)


@settings(derandomize=True, max_examples=30, deadline=None)
@given(links(), st.sampled_from(inverted_slider_crank.MODES), st.floats(0.0, 6.0))
def test_holding_moments_are_the_slopes_of_the_potential_energy(link, mode, at):
    masses = {"crank_mass": 1.3, "bar_mass": 0.8, "rod_mass": 2.1, "slider_mass": 0.7}
    for k, name in enumerate(("holding_moment", "holding_moment_bar")):
        angles = np.full((2, GRID.size), at)
        angles[k] = GRID  # one input turns, the other is at rest
        pose = inverted_slider_crank.solve(angles, 3.0, **link, mode=mode, **masses, gravity=3.7)
        pin_y = link["crank"] * np.sin(angles[0])
        heights = (
            pin_y / 2,
            (link["ground_y"] + pose["slider_y"]) / 2,
            (pin_y + pose["end_y"]) / 2,
            pose["slider_y"],
        )
        energy = 3.7 * sum(m * y for m, y in zip(masses.values(), heights, strict=True))
        # spectral rounding as above, of an energy up to 1e3 times its range
        bound = 1e-13 * 256 * np.abs(energy).max()
        np.testing.assert_allclose(pose[name], derivative(energy), rtol=0, atol=bound)
    assert not inverted_slider_crank.solve(angles, **link)["holding_moment"].any()


@MODES
def test_mirror_image_has_mirrored_curves(mode):
    pose = inverted_slider_crank.solve(*INPUT_PROFILES, **LINK, ground_y=0.7, mode=mode)
    image = inverted_slider_crank.solve(*-INPUT_PROFILES, **LINK, ground_y=-0.7, mode=mode)
    for name, curve in pose.items():
        same = name.startswith(("slide_", "holding")) or name == "slide" or name.endswith("x")
        np.testing.assert_allclose(image[name], curve if same else -curve, rtol=0, atol=0)


def test_modes_share_the_line_of_the_rod():
    pose, other = (
        inverted_slider_crank.solve(*INPUT_PROFILES, **LINK, ground_y=2.5, mode=mode)
        for mode in (1, -1)
    )
    for name in ("rod_rate", "rod_acceleration", "slider_x", "slider_ay"):
        np.testing.assert_array_equal(pose[name], other[name])
    for name in ("slide", "slide_rate", "slide_acceleration"):
        np.testing.assert_array_equal(pose[name], -other[name])
    pin = [LINK["crank"] * np.exp(1j * INPUT_PROFILES[0, 0])]
    middle = (np.array(point_motion(pose, "end")) + np.array(point_motion(other, "end"))) / 2
    assert np.abs(middle[0] - pin[0]).max() <= 2e-15  # rounding
    assert np.all(other["slide_margin"] < 0)


def test_printed_pose_and_velocities_of_the_thesis():
    pose = inverted_slider_crank.solve(*INPUTS, **LINK)
    for part, printed in (("", "position"), ("v", "velocity")):
        names = [f"{p}_{part}{axis}" for p in ("end", "slider") for axis in "xy"]
        for name, digits in zip(names, THESIS[printed][2:], strict=True):
            assert pose[name] == pytest.approx(digits, abs=5.1e-9), name  # half a last digit
    for name in ("slide", "rod_angle"):
        assert pose[name] == pytest.approx(THESIS[name], abs=1e-15)  # rounding
    for name in ("rod_rate", "slide_rate"):
        assert pose[name] == pytest.approx(THESIS[name], abs=1e-8)  # by differences
    unaccelerated = inverted_slider_crank.solve(*INPUTS, 0.0, **LINK)
    assert unaccelerated["slide_acceleration"] == pytest.approx(
        THESIS["slide_acceleration"], abs=1e-8
    )
    other = inverted_slider_crank.solve(*INPUTS, **LINK, mode=-1)
    assert [other["end_x"], other["end_y"]] == pytest.approx(THESIS["other_assembly"], abs=1e-11)


@pytest.mark.parametrize("row", THESIS["accelerations"], ids=lambda row: row["status"][:12])
def test_accelerations_of_the_thesis(row):
    pose = inverted_slider_crank.solve(*INPUTS, row["acceleration"], **LINK)
    arm = LINK["crank"] * np.exp(0.5j) * (1j * row["acceleration"] - 1.0)
    found = [arm.real, arm.imag, *(pose[f"{p}_a{x}"] for p in ("end", "slider") for x in "xy")]
    for name, value, digits in zip(THESIS["columns"], found, row["points"], strict=True):
        if name in row["wrong"]:
            assert abs(value - digits) > 0.05, name
        else:
            assert value == pytest.approx(digits, abs=5.1e-9), name  # half a last digit


def test_two_errors_reproduce_the_printed_accelerations():
    """A product for a difference, and a row that is not the derivative of the collinearity row."""
    row = THESIS["accelerations"][1]
    q, v = np.array(THESIS["position"]), np.array(THESIS["velocity"])
    x1, y1, x2, y2 = v[:4]
    wrong = np.array(
        [
            2 * x2 * (x2 * x1) + 2 * y2 * (y2 * y1) - 2 * x1 * (x2 - x1) - 2 * y1 * (y2 - y1),
            THESIS["collinearity_right_side_printed_code"],
        ]
    )
    jacobian = constraints(q, LINK)[1][:2]
    known = np.array(row["points"])
    known[2:4] = 0.0
    for right, result in ((wrong, row), (right_side(v), THESIS["accelerations"][2])):
        found = np.linalg.solve(jacobian[:, 2:4], -right - jacobian @ known)
        np.testing.assert_allclose(found, result["points"][2:4], rtol=0, atol=1e-7)  # 9 digits in


@pytest.mark.parametrize(
    ("name", "bar", "rates"),
    [
        ("in_proportion", lambda angle: 2.0 * angle, (1.0, 2.0)),
        ("held", lambda angle: 0.8 + 0.0 * angle, (1.0, 0.0)),
    ],
)
def test_curves_are_those_of_the_cycle_tables(name, bar, rates):
    table = np.array(DATA["inverted_cycles"][name]["rows"]).T
    columns = DATA["inverted_cycles"]["columns"][1:]
    angle = np.rint(table[0] / np.pi * 6) * np.pi / 6  # the table has 12 digits of it
    pose = inverted_slider_crank.solve([angle, bar(angle)], rates, **LINK)
    for column, values in zip(columns, table[1:], strict=True):
        np.testing.assert_allclose(pose[column], values, rtol=0, atol=6e-11)  # 12 digits


def test_slider_leaves_the_rod():
    """With beta = 2 theta, |D| = 3 m where 2 cos^2 - 3 cos - 1 = 0; text line 10966 ignores it."""
    table, angle = DATA["off_rod"], np.linspace(0.0, TURN, 100001)
    pose = inverted_slider_crank.solve([angle, 2.0 * angle], [1.0, 2.0], **LINK)
    for degrees, slide in table["slides"].items():
        at = np.radians(float(degrees))
        found = inverted_slider_crank.solve([at, 2.0 * at], **LINK)["slide"]
        assert found == pytest.approx(slide, abs=5.1e-7)  # last digit
    assert [pose["slide"].min(), pose["slide"].max()] == pytest.approx(
        table["slide_range"], abs=5.1e-9
    )  # last digit
    leave = np.arccos((3.0 - np.sqrt(17.0)) / 4.0)
    intervals = inverted_slider_crank.off_rod_intervals(angle, pose["slide_margin"])
    # 1e-9: step^2/8 = 5e-10 times the ratio of second to first derivative, below 1
    np.testing.assert_allclose(intervals, [[leave, TURN - leave]], rtol=0, atol=1e-9)
    assert np.ptp(intervals) / TURN == pytest.approx(table["share"], abs=5.1e-5)  # last digit
    part = slice(40000, 60001)  # begins and ends off the rod
    np.testing.assert_array_equal(
        inverted_slider_crank.off_rod_intervals(angle[part], pose["slide_margin"][part]),
        [[angle[40000], angle[60000]]],
    )
    safe = inverted_slider_crank.off_rod_intervals(angle[:20000], pose["slide_margin"][:20000])
    assert safe.shape == (0, 2)
    touches = inverted_slider_crank.off_rod_intervals(
        [0.0, 1.0, 2.0], [0.5, 0.0, 0.5]
    )  # touches the end of the rod
    assert touches.shape == (0, 2)


@pytest.mark.parametrize(
    ("name", "value"),
    [(n, v) for n in ("crank", "rod") for v in (0.0, -1.0, np.nan, np.inf)]
    + [
        (n, v)
        for n in ("bar", "crank_mass", "bar_mass", "rod_mass", "slider_mass")
        for v in (-1.0, np.nan)
    ]
    + [(n, np.nan) for n in ("ground_x", "ground_y", "gravity")]
    + [("mode", 0)],
)
def test_bad_value_is_named(name, value):
    with pytest.raises(ValueError, match=f"^{name} must be"):
        inverted_slider_crank.solve(*INPUTS, **{**LINK, name: value})


def test_a_crank_pin_in_the_slider_is_refused_with_its_angles():
    meet = 2.0 * np.arcsin(0.25)  # where the crank pin is 1 m from B
    bar = np.angle(2.0 * np.exp(1j * meet) - 2.0)
    angles = [[0.1, meet, 0.2, meet], [0.8, bar, 0.8, bar]]
    with pytest.raises(ValueError, match=rf"angle {meet:.9g} rad and bar angle {bar:.9g} rad"):
        inverted_slider_crank.solve(angles, **LINK)


def test_shapes():
    one = inverted_slider_crank.solve([0.5, 0.8], **LINK)
    many = inverted_slider_crank.solve(np.tile([[0.5], [0.8]], 5), [1.0, 1.0], **LINK)
    assert {curve.shape for curve in one.values()} == {()}
    assert {curve.shape for curve in many.values()} == {(5,)}
    assert all(np.all(many[name] == curve) for name, curve in one.items())
    with pytest.raises(ValueError, match=r"angle must have 2 rows on its first axis, .* \(3,\)"):
        inverted_slider_crank.solve([0.1, 0.2, 0.3], **LINK)
