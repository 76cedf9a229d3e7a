"""Slider-crank closed form at its limits: dead points, change points, poses that do not close."""

from fractions import Fraction

import numpy as np
import pytest

from proofmass.analytic.linkages import slider_crank

TURN = 2.0 * np.pi
LINK = {"crank": 1.0, "coupler": 2.0}
SHORT_COUPLER = {"crank": 1.0, "coupler": 0.6, "guide_y": 0.1}  # the crank cannot turn fully
MASSES = ("crank_mass", "coupler_mass", "slider_mass")
FRICTIONS = ("crank_friction", "pin_friction", "slider_friction")
MODES = pytest.mark.parametrize("mode", slider_crank.MODES)


def assert_derivative(curve, expected, period, tolerance):
    """`expected` is the spectral derivative of a curve sampled over one period."""
    wave = TURN / period * 1j * np.fft.fftfreq(curve.size, 1.0 / curve.size)
    wave[curve.size // 2] = 0.0
    error = np.abs(np.fft.ifft(wave * np.fft.fft(curve)).real - expected).max()
    assert error <= tolerance * np.abs(expected).max()


def test_dead_points_of_a_swinging_crank():
    """With a coupler shorter than the crank each dead point lies in its own range of the crank."""
    angles, slides = slider_crank.dead_points(**SHORT_COUPLER)
    pose = slider_crank.solve(angles, **SHORT_COUPLER)
    np.testing.assert_allclose(pose["slide_rate"], 0.0, rtol=0, atol=1e-15)  # rounding
    np.testing.assert_allclose(pose["slide"], slides, rtol=1e-14)
    for link in ({"coupler": 0.95, "guide_y": 0.1}, {"coupler": 1.0}):
        with pytest.raises(ValueError, match="no folded dead point"):
            slider_crank.dead_points(crank=1.0, **link)


def test_motion_is_smooth_through_the_fold():
    """Crank = coupler, in line, is Cardan's straight line: s = 2 r cos(angle), coupler reversed."""
    at = np.linspace(0.0, TURN, 361)
    pose = slider_crank.solve(at, crank=1.0, coupler=1.0)
    # rounding of the bracket's root, twice
    np.testing.assert_allclose(pose["slide"], 2.0 * np.cos(at), rtol=0, atol=1e-15)
    np.testing.assert_allclose(pose["slide_rate"], -2.0 * np.sin(at), rtol=0, atol=1e-15)
    np.testing.assert_allclose(pose["coupler_angle"], -at, rtol=1e-15)
    assert np.all(pose["coupler_rate"] == -1.0)
    # the slider stays in A
    slider_at_rest = slider_crank.solve(at, 1.3, -0.4, crank=1.0, coupler=1.0, mode=-1)
    for name in ("slide", "slide_rate", "slide_acceleration"):
        assert np.abs(slider_at_rest[name]).max() <= 2e-15  # rounding


@MODES
@pytest.mark.parametrize("offset", [0.3, -0.3])
def test_linkage_with_an_offset_change_point_closes_after_two_turns(offset, mode):
    angle = 2 * TURN * (np.arange(1024) + 0.37) / 1024
    along = np.exp(0.7j)
    point = (30.0 + 1j * offset) * along
    link = {
        "crank": 1.0,
        "coupler": 1.3,
        "guide_x": point.real,
        "guide_y": point.imag,
        "guide_angle": 0.7,
    }
    pose = slider_crank.solve(angle, **link, mode=mode)
    pin = np.exp(1j * angle) + 1.3 * np.exp(1j * pose["coupler_angle"])
    assert np.abs(pin - point - pose["slide"] * along).max() <= 3e-14  # rounding of the 30 m
    for name in ("slide", "coupler"):
        value = pose["slide" if name == "slide" else "coupler_angle"]
        # 1e-10: rounding times the highest wave number, 512 eps = 1e-13, and the curves' ratio
        assert_derivative(value, pose[f"{name}_rate"], 2 * TURN, 1e-10)
        assert_derivative(pose[f"{name}_rate"], pose[f"{name}_acceleration"], 2 * TURN, 1e-10)
    later = slider_crank.solve(angle + TURN, **link, mode=mode)["slide"]
    assert np.abs(later - pose["slide"]).max() > 1.0  # a turn later: other assembly mode


@pytest.mark.parametrize(
    ("name", "value"),
    [(n, v) for n in ("crank", "coupler") for v in (0.0, -1.0, np.nan, np.inf)]
    + [(n, v) for n in (*MASSES, *FRICTIONS) for v in (-1.0, np.nan, np.inf)]
    + [
        (n, v)
        for n in ("guide_x", "guide_y", "guide_angle", "slider_load", "gravity")
        for v in (np.nan, np.inf)
    ]
    + [("mode", 0)],
)
def test_bad_value_is_named(name, value):
    with pytest.raises(ValueError, match=f"^{name} must be"):
        slider_crank.solve(0.0, **{**LINK, name: value})


def test_an_unreachable_angle_is_named_with_its_violation():
    limit = np.arcsin(0.7)  # coupler perpendicular to the guide
    assert slider_crank.solve(limit, **SHORT_COUPLER)["slide"] == pytest.approx(
        np.cos(limit), abs=1e-7
    )  # square root of rounding
    with pytest.raises(ValueError, match=r"angle 1\.6 rad: .* by 0\.299574 m"):
        slider_crank.solve([0.0, 0.5, 1.6, 1.7], **SHORT_COUPLER)
    with pytest.raises(ValueError, match=rf"angle {-np.pi / 2:.9g} rad: .* by 0\.5 m"):
        slider_crank.solve([0.0, -np.pi / 2], **SHORT_COUPLER)
    with pytest.raises(ValueError, match=r"by 7\.\d+e-10 m"):  # 1e-9 cos(limit)
        slider_crank.solve(limit + 1e-9, **SHORT_COUPLER)
    turned = {**SHORT_COUPLER, "guide_x": -0.1, "guide_y": 0.0, "guide_angle": np.pi / 2}
    with pytest.raises(ValueError, match=rf"angle {np.pi:.9g} rad: .* by 0\.3 m"):
        slider_crank.solve([np.pi / 2, np.pi], **turned)


def test_shapes_broadcast():
    pose = slider_crank.solve(np.zeros((3, 1)), np.ones(4), **LINK)
    assert {curve.shape for curve in pose.values()} == {(3, 4)}
    assert {curve.shape for curve in slider_crank.solve(0.0, **LINK).values()} == {()}


@pytest.mark.parametrize("gap", [1e-3, 1e-7, 1e-11])
@pytest.mark.parametrize("offset", [0.3, -0.3])
def test_the_slide_has_all_digits_where_the_coupler_is_nearly_upright(offset, gap):
    """Exact by Pythagoras: the axis is 1 + |offset| from the pin's foot on the guide."""
    coupler = 1.0 + abs(offset) + gap
    angle = -np.copysign(np.pi / 2, offset)
    pose = slider_crank.solve(angle, crank=1.0, coupler=coupler, guide_y=offset)
    exact = float(Fraction(coupler) ** 2 - (1 + abs(Fraction(offset))) ** 2) ** 0.5
    # 6e-17 is the cosine of the rounded right angle; 4e-16 the rounding of sums and roots
    assert pose["slide"] == pytest.approx(exact, rel=4e-16, abs=1e-16)
