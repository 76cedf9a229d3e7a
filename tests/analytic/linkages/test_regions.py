"""Regions bounded by pieces of curves: holes, parts that touch in a point, open outlines."""

import numpy as np
import pytest

from proofmass.analytic.linkages.regions import (
    CurvePiece,
    arc,
    chord,
    is_inside,
    join_regions,
    overlap_area,
)


def polygon(*corners: complex) -> list[CurvePiece]:
    return [chord(a, b) for a, b in zip(corners, [*corners[1:], corners[0]], strict=True)]


def test_a_hole_belongs_to_the_smallest_region_around_it() -> None:
    outer = [arc(0.0, 5.0, 0.0, 2 * np.pi), arc(0.0, 4.0, 0.0, 2 * np.pi).back]
    inner = [arc(0.5, 2.0, 0.0, 2 * np.pi), arc(0.5, 1.0, 0.0, 2 * np.pi).back]
    found = join_regions([*inner, *outer], 10.0)
    assert [one.area for one in found] == pytest.approx([9 * np.pi, 3 * np.pi], rel=1e-13)
    assert [len(one.outlines) for one in found] == [2, 2]
    assert np.abs(found[1].outlines[0] - 0.5).max() == pytest.approx(2.0)


@pytest.mark.parametrize("turned", range(8))
def test_regions_that_touch_in_a_corner_are_kept_apart(turned: int) -> None:
    squares = polygon(0, 1, 1 + 1j, 1j) + polygon(1 + 1j, 2 + 1j, 2 + 2j, 1 + 2j)
    found = join_regions(squares[turned:] + squares[:turned], 2.0)
    assert [one.area for one in found] == [1.0, 1.0]
    assert [len(one.outlines[0]) for one in found] == [4, 4]


def test_an_outline_that_does_not_close_is_an_error() -> None:
    with pytest.raises(ValueError, match=r"an outline ends at \(0, 1\) m"):
        join_regions(polygon(0, 1, 1 + 1j, 1j)[:3], 1.0)


def test_areas_do_not_depend_on_how_an_outline_is_drawn() -> None:
    whole = arc(2 - 1j, 3.0, 0.3, 0.3 + 2 * np.pi)
    parts = [arc(2 - 1j, 3.0, a, b) for a, b in ((0.3, 0.4), (0.4, 5.0), (5.0, 0.3 + 2 * np.pi))]
    for pieces in ([whole], parts):
        assert join_regions(pieces, 3.0)[0].area == pytest.approx(9 * np.pi, rel=1e-14, abs=0)


def test_area_of_a_half_disc_away_from_the_origin() -> None:
    half = [arc(2 - 1j, 3.0, 0.3, 0.3 + np.pi)]
    half.append(chord(half[0].points[-1], half[0].points[0]))
    (found,) = join_regions(half, 3.0)
    assert found.area == pytest.approx(4.5 * np.pi, rel=1e-14, abs=0)


def test_overlap_area_is_the_share_of_points_in_both_discs() -> None:
    rng = np.random.default_rng(5)
    for distance, one, other in ((1.3, 1.0, 0.8), (0.5, 2.0, 1.7), (2.9, 1.5, 1.5)):
        z = one * np.sqrt(rng.random(400_000)) * np.exp(2j * np.pi * rng.random(400_000))
        share = np.mean(np.abs(z - distance) < other)
        # four standard deviations of a share are 4 * 0.5/sqrt(400000) = 3.2e-3
        assert overlap_area(distance, one, other) / (np.pi * one**2) == pytest.approx(
            share, abs=3.2e-3
        )


def test_points_inside_a_horseshoe_outline_are_recognized() -> None:
    horseshoe = np.array([0, 3, 3 + 3j, 2 + 3j, 2 + 1j, 1 + 1j, 1 + 3j, 3j])
    assert is_inside(np.array([0.5 + 2j, 1.5 + 2j, 2.5 + 2j, 1.5 + 0.5j]), horseshoe).tolist() == [
        True,
        False,
        True,
        True,
    ]


@pytest.mark.parametrize("distance", [1e-12, 1e-8, 1e-4, 0.1, 1.0])
def test_overlap_of_equal_discs_that_nearly_coincide(distance: float) -> None:
    """Unit discs have pi - 2 asin(d/2) - d (1 - d^2/4)^(1/2) in common."""
    missing = 2.0 * np.arcsin(distance / 2.0) + distance * np.sqrt(1.0 - distance**2 / 4.0)
    # rounding of numbers up to pi
    assert overlap_area(distance, 1.0, 1.0) == pytest.approx(np.pi - missing, rel=0, abs=2e-15)


@pytest.mark.parametrize("gap", [1e-4, 1e-6, 1e-10])
def test_overlap_of_equal_discs_that_nearly_touch(gap: float) -> None:
    """Unit discs at 2 cos(t) have 2 t - sin(2 t) in common, a series in t."""
    distance = 2.0 - gap
    t = 2.0 * np.arcsin(np.sqrt((2.0 - distance) / 4.0))
    area = (2.0 * t) ** 3 / 6.0 * (1.0 - (2.0 * t) ** 2 / 20.0 + (2.0 * t) ** 4 / 840.0)
    # rounding of the wedges, whose half angle is t
    assert overlap_area(distance, 1.0, 1.0) == pytest.approx(area, rel=0, abs=2e-16 * t + 1e-17)
