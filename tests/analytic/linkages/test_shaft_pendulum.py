"""A pendulum on a shaft with dry friction against the minimum of energy plus dissipation."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import trapezoid
from scipy.optimize import minimize_scalar

from proofmass.analytic.linkages.shaft_pendulum import (
    apply_play,
    events,
    properties,
    slip_angle,
    solve,
)

OWN = {"length": 0.2, "mass": 0.5, "friction": 0.3, "gravity": 9.81}
WEIGHT = 0.5 * 9.81 * 0.2  # m g l [N m]


def test_it_goes_where_energy_and_dissipation_are_least():
    """Each pose minimises m g l (1 - cos phi) + friction |slip|, slip since the last sample."""
    shaft = np.array([0.0, 0.2, 0.7, 0.5, 0.1, -0.9, -0.8, 0.4, 2.0])
    phi, found = 0.0, [0.0]
    for before, now in pairwise(shaft):
        stuck = phi + now - before

        def cost(angle, stuck=stuck):
            return WEIGHT * (1 - np.cos(angle)) + OWN["friction"] * abs(angle - stuck)

        phi = min(
            (
                stuck,
                minimize_scalar(
                    cost, bounds=(-1.5, 1.5), method="bounded", options={"xatol": 1e-12}
                ).x,
            ),
            key=cost,
        )
        found.append(phi)
    np.testing.assert_allclose(solve(shaft, **OWN)["swing"], found, atol=1e-7)  # of the search


def test_area_of_a_cycle():
    """The area is 2 friction (a - 2 p) + 2 bearing_friction a, and equals the energy lost.

    The range of the shaft is a, the slip angle p.
    """
    way = 1.8
    shaft = way * 0.5 * (1 - np.cos(np.linspace(0, 4 * np.pi, 40001)))
    rate = np.gradient(shaft)
    found = solve(shaft, rate, **OWN, bearing_friction=0.05)
    last = slice(20000, None)
    area = 2 * 0.3 * (way - 2 * slip_angle(**OWN)) + 2 * 0.05 * way
    assert trapezoid(found["holding_moment"][last], shaft[last]) == pytest.approx(area, rel=1e-4)
    assert found["lost"][-1] - found["lost"][20000] == pytest.approx(area, rel=1e-12, abs=0)
    first = np.diff(found["lost"][[0, 20000]])[0]
    # the first cycle starts in mid-play
    assert first == pytest.approx(area + 0.3 * slip_angle(**OWN), rel=1e-12, abs=0)


def test_rates_are_slopes_and_the_hinge_gives_the_weight_its_moment():
    shaft = np.linspace(0.0, 1.5, 1501)
    found = solve(shaft, 2.0, **OWN)
    for name in ("swing", "slip"):
        slope = np.diff(found[name]) / np.diff(shaft) * 2.0
        same = slope[:-1] == pytest.approx(slope[1:], abs=1e-9)
        assert same or (np.abs(found[f"{name}_rate"][2:] - slope[1:]) > 1e-9).sum() <= 1
    np.testing.assert_allclose(
        found["hinge_moment"], 0.5 * 9.81 * found["bob_x"], atol=1e-15, rtol=0
    )
    np.testing.assert_allclose(np.hypot(found["bob_x"], found["bob_y"]), 0.2, rtol=1e-15)


def test_a_sample_at_which_it_begins_to_slip_is_one_behind_that():
    swing, slips = apply_play(np.array([0.0, 0.25, 0.5]), 0.25)  # numbers without rounding
    assert (swing.tolist(), slips.tolist()) == ([0.0, 0.25, 0.25], [True, True, True])


def test_a_shaft_that_stands_rubs_as_before():
    found = solve([0.0, 0.5, 0.5, 0.0], [0.0, 1.0, 0.0, -1.0], **OWN, bearing_friction=0.05)
    bearing = found["holding_moment"] - found["hinge_moment"]
    np.testing.assert_allclose(bearing, [0.0, 0.05, 0.05, -0.05], atol=1e-15, rtol=0)


@pytest.mark.parametrize(
    ("changed", "shaft", "message"),
    [
        ({"friction": 1.0}, [0.0, 1.0, 2.0], "friction must be positive and less than 0.981 N m"),
        ({"friction": 0.0}, [0.0, 1.0, 2.0], "friction must be positive"),
        ({"friction": np.nan}, [0.0, 1.0, 2.0], "friction must be positive"),
        ({"mass": -1.0}, [0.0, 1.0, 2.0], "mass must be positive"),
        ({"bearing_friction": -1.0}, [0.0, 1.0, 2.0], "bearing_friction must be zero or positive"),
        ({}, [0.0, 0.1, 0.2], "friction holds the pendulum at all given angles: .* 0.310789 rad"),
        ({}, [[0.0, 0.1]], "one row of angles"),
    ],
)
def test_bad_input(changed, shaft, message):
    with pytest.raises(ValueError, match=message):
        solve(shaft, **{**OWN, **changed})


def test_words():
    assert properties(**OWN)["slips at"] == "17.81° from straight down"
    assert events(**OWN) == {"first slip": slip_angle(**OWN)}
