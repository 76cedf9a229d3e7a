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

PENDULUM = {"length": 0.2, "mass": 0.5, "friction": 0.3, "gravity": 9.81}
WEIGHT_MOMENT = 0.5 * 9.81 * 0.2  # m g l [N m]


def test_each_pose_minimises_energy_plus_dissipation():
    """Each pose minimises m g l (1 - cos phi) + friction |slip|, slip since the last sample."""
    shaft = np.array([0.0, 0.2, 0.7, 0.5, 0.1, -0.9, -0.8, 0.4, 2.0])
    phi, found = 0.0, [0.0]
    for before, now in pairwise(shaft):
        stuck = phi + now - before

        def cost(angle, stuck=stuck):
            return WEIGHT_MOMENT * (1 - np.cos(angle)) + PENDULUM["friction"] * abs(angle - stuck)

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
    np.testing.assert_allclose(solve(shaft, **PENDULUM)["swing"], found, atol=1e-7)  # of the search


def test_loop_area_is_the_energy_lost_in_a_cycle():
    """The area is 2 friction (a - 2 p) + 2 bearing_friction a, and equals the energy lost.

    The range of the shaft is a, the slip angle p.
    """
    shaft_range = 1.8
    shaft = shaft_range * 0.5 * (1 - np.cos(np.linspace(0, 4 * np.pi, 40001)))
    rate = np.gradient(shaft)
    found = solve(shaft, rate, **PENDULUM, bearing_friction=0.05)
    last = slice(20000, None)
    area = 2 * 0.3 * (shaft_range - 2 * slip_angle(**PENDULUM)) + 2 * 0.05 * shaft_range
    assert trapezoid(found["holding_moment"][last], shaft[last]) == pytest.approx(area, rel=1e-4)
    assert found["lost"][-1] - found["lost"][20000] == pytest.approx(area, rel=1e-12, abs=0)
    first = np.diff(found["lost"][[0, 20000]])[0]
    # the first cycle starts in mid-play
    assert first == pytest.approx(area + 0.3 * slip_angle(**PENDULUM), rel=1e-12, abs=0)


def test_rates_are_slopes_and_the_hinge_carries_the_weight():
    shaft = np.linspace(0.0, 1.5, 1501)
    found = solve(shaft, 2.0, **PENDULUM)
    for name in ("swing", "slip"):
        slope = np.diff(found[name]) / np.diff(shaft) * 2.0
        # rounding over the step; in one step slip begins, and its slope is between two rates
        off = np.abs(found[f"{name}_rate"][1:] - slope) > 1e-9
        assert off.sum() == 1
        assert shaft[np.argmax(off)] < slip_angle(**PENDULUM) < shaft[np.argmax(off) + 1]
    np.testing.assert_allclose(
        found["hinge_moment"], 0.5 * 9.81 * found["bob_x"], atol=1e-15, rtol=0
    )
    np.testing.assert_allclose(np.hypot(found["bob_x"], found["bob_y"]), 0.2, rtol=1e-15)


def test_the_sample_at_which_slip_begins_counts_as_slip():
    swing, slips = apply_play(np.array([0.0, 0.25, 0.5]), 0.25)  # numbers without rounding
    assert (swing.tolist(), slips.tolist()) == ([0.0, 0.25, 0.25], [True, True, True])


def test_bearing_friction_at_rest_is_that_of_the_last_motion():
    found = solve([0.0, 0.5, 0.5, 0.0], [0.0, 1.0, 0.0, -1.0], **PENDULUM, bearing_friction=0.05)
    bearing = found["holding_moment"] - found["hinge_moment"]
    np.testing.assert_allclose(bearing, [0.0, 0.05, 0.05, -0.05], atol=1e-15, rtol=0)


@pytest.mark.parametrize(
    ("changed", "shaft", "message"),
    [
        ({"friction": 1.0}, [0.0, 1.0, 2.0], "friction must be positive and less than 0.981 N m"),
        ({"friction": 0.0}, [0.0, 1.0, 2.0], "friction must be positive"),
        ({"mass": -1.0}, [0.0, 1.0, 2.0], "mass must be positive"),
        ({"bearing_friction": -1.0}, [0.0, 1.0, 2.0], "bearing_friction must be zero or positive"),
        ({}, [0.0, 0.1, 0.2], "friction holds the pendulum at all given angles: .* 0.310789 rad"),
        ({}, [[0.0, 0.1]], "one row of angles"),
    ],
)
def test_bad_input_is_refused(changed, shaft, message):
    with pytest.raises(ValueError, match=message):
        solve(shaft, **{**PENDULUM, **changed})


def test_slip_angle_is_a_property_and_an_event():
    assert properties(**PENDULUM)["slips at"] == "17.81° from straight down"
    assert events(**PENDULUM) == {"first slip": slip_angle(**PENDULUM)}
