"""Coupler points of many linkages at once against geometry, the sextic, and finite differences."""

import numpy as np
import pytest

from proofmass.analytic.linkages import fourbar
from proofmass.design.coupler_curves import (
    FourBarCurves,
    SliderCrankCurves,
    assemble_designs,
    margin_slopes,
)
from tests.independent.linkages.coupler_point import (
    four_bar_point,
    sextic_residual,
    slider_crank_point,
)

KINDS = pytest.mark.parametrize(
    "kind",
    [FourBarCurves(1), FourBarCurves(-1), SliderCrankCurves()],
    ids=["open", "crossed", "slider"],
)
TRANSMISSION = 0.4  # [rad] keeps derivatives from the poses where they are infinite


def random_linkages(kind, count=40):
    """Linkages whose crank turns fully, with crank angles."""
    rng = np.random.default_rng(5)
    shapes = kind.random_shapes(count, rng, TRANSMISSION)
    fit = rng.normal(size=(count, 3)) + 1j * rng.normal(size=(count, 3))
    angles = rng.uniform(-7.0, 7.0, (count, 9))
    return assemble_designs(shapes, fit), angles


def independent_points(kind, designs, angles):
    """The same points by elementary geometry, one after the other."""
    found = []
    for row, turns in zip(designs, angles, strict=True):
        p = dict(zip(kind.names, row.tolist(), strict=True))
        if isinstance(kind, FourBarCurves):
            found.append([complex(*four_bar_point(p, kind.mode, angle)) for angle in turns])
        else:
            found.append([complex(*slider_crank_point(p, angle)) for angle in turns])
    return np.array(found)


@KINDS
def test_points_are_those_of_elementary_geometry(kind):
    designs, angles = random_linkages(kind)
    points = kind.points(designs, angles)
    off = np.abs(points - independent_points(kind, designs, angles))
    scale = np.abs(designs[:, 3:]).max(axis=1, keepdims=True)
    # rounding, which the height of a triangle divides by the sine of the transmission angle
    assert (off / scale).max() < 1e-12 / np.sin(TRANSMISSION)


@pytest.mark.parametrize("mode", fourbar.MODES)
def test_points_of_both_modes_lie_on_the_sextic_of_the_coupler_curve(mode):
    kind = FourBarCurves(mode)
    designs, angles = random_linkages(kind)
    residuals = []
    for row, points in zip(designs, kind.points(designs, angles), strict=True):
        p = dict(zip(kind.names, row.tolist(), strict=True))
        residuals.append([sextic_residual(p, z.real, z.imag) for z in points])
        moved = [sextic_residual(p, z.real * 1.01 + 0.01, z.imag) for z in points]
        assert np.abs(moved).max() > 1e-4  # a moved point is off the curve
    # the determinant of the two linear equations is small where they nearly coincide
    assert np.median(np.abs(residuals)) < 1e-12
    assert np.abs(residuals).max() < 1e-6


def test_the_other_assembly_mode_is_another_curve():
    designs, angles = random_linkages(FourBarCurves(1))
    gap = FourBarCurves(1).points(designs, angles) - FourBarCurves(-1).points(designs, angles)
    assert np.abs(gap).max(axis=1).min() > 1e-3


@KINDS
def test_slopes_are_finite_differences(kind):
    designs, angles = random_linkages(kind)
    by_design, by_angle = kind.slopes(designs, angles)
    step = 1e-6
    scale = 1.0 + np.abs(by_design).max()
    for k, name in enumerate(kind.names):
        move = step * (np.arange(len(kind.names)) == k)
        change = kind.points(designs + move, angles) - kind.points(designs - move, angles)
        assert np.abs(change / (2 * step) - by_design[..., k]).max() < 1e-6 * scale, name
    change = kind.points(designs, angles + step) - kind.points(designs, angles - step)
    assert np.abs(change / (2 * step) - by_angle).max() < 1e-6 * scale


@KINDS
def test_margins_are_zero_where_the_crank_just_turns_and_their_slopes_are_right(kind):
    """The bars are made longer or shorter by 1e-6 around a margin of zero."""
    designs, _ = random_linkages(kind)
    margins = kind.margins(designs, TRANSMISSION)
    assert (margins > -1e-9).all()
    slopes = margin_slopes(kind, designs, TRANSMISSION)
    rng = np.random.default_rng(6)
    move = 1e-5 * rng.normal(size=designs.shape)
    rise = kind.margins(designs + move, TRANSMISSION) - margins
    assert np.abs(rise - np.einsum("bhk,bk->bh", slopes, move)).max() < 1e-7


@pytest.mark.parametrize("mode", fourbar.MODES)
def test_a_four_bar_with_margins_turns_fully_with_its_transmission_angle(mode):
    kind = FourBarCurves(mode)
    designs, _ = random_linkages(kind)
    for row in designs:
        p = dict(zip(kind.names, row.tolist(), strict=True))
        lengths = {name: p[name] for name in ("crank", "coupler", "rocker", "ground")}
        assert fourbar.crank_range(**lengths) == (0.0, np.pi)
        low, high = fourbar.transmission_range(**lengths)
        assert min(low, np.pi - high) > TRANSMISSION - 1e-9


def test_loops_that_do_not_close_have_negative_margins_and_finite_points():
    """A coupler and a rocker of a tenth do not reach."""
    kind = FourBarCurves(1)
    designs, angles = random_linkages(kind)
    designs[:, 4:6] *= 0.1
    assert (kind.margins(designs, 0.0).min(axis=1) < 0).all()
    assert np.isfinite(kind.points(designs, angles)).all()
