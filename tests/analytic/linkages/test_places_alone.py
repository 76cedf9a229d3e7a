"""Positions and angles of a linkage without its rates are the same as in the whole motion."""

import numpy as np
import pytest

from proofmass.analytic.linkages import fourbar, slider_crank


@pytest.mark.parametrize(
    ("solve", "parameters", "places"),
    [
        (
            fourbar.solve,
            {"point_along": 0.7, "point_across": -0.4, **lengths},
            "coupler_angle rocker_angle pin_x pin_y point_x point_y transmission_angle",
        )
        for lengths in (
            {"crank": 1.0, "coupler": 2.0, "rocker": 2.5, "ground": 3.0, "mode": 1},
            {"crank": 1.0, "coupler": 2.0, "rocker": 2.5, "ground": 3.0, "mode": -1},
            {"crank": 1.0, "coupler": 2.0, "rocker": 2.0, "ground": 3.0},
        )
    ]
    + [
        (
            slider_crank.solve,
            {"crank": 1.0, "guide_y": 0.3, "guide_angle": 0.2, "mode": mode, "coupler": coupler},
            "slide slider_x slider_y point_x point_y coupler_angle transmission_angle",
        )
        for mode, coupler in ((1, 2.0), (-1, 2.0), (1, 1.0 + 0.3 * np.cos(0.2)))
    ],
)
def test_positions_alone_equal_those_of_the_whole_motion(solve, parameters, places):
    """Also through a change point. Only requested quantities are returned."""
    angle = np.linspace(-1.0, 12.0, 400)
    whole = solve(angle, **parameters)
    for name in places.split():
        alone = solve(angle, **parameters, only={name})
        assert alone.keys() == {name}
        np.testing.assert_array_equal(alone[name], whole[name])
    assert solve(angle, **parameters, only=set(places.split())).keys() == set(places.split())
    with_rate = solve(angle, **parameters, only={places.split()[0], "coupler_rate"})
    np.testing.assert_array_equal(with_rate["coupler_rate"], whole["coupler_rate"])
    with pytest.raises(ValueError, match="loop cannot close"):
        solve(angle, **{**parameters, "coupler": 0.2}, only={places.split()[0]})
