"""Appendix E: energy, its slopes by differences, its stationary point, and two misprints."""

import numpy as np
import pytest
from scipy.optimize import brentq

from proofmass.analytic.balancer import solve
from tests.analytic.balancer.balancer_chain import (
    PATH_ANGLES,
    ROWS,
    deflections,
    equilibrium,
    row_parameters,
    segment_angles,
)
from tests.independent.balancer.lagrange import potential

LINES = pytest.mark.parametrize("line", [1743, 1766, 1789, 2107])


def sides(line):
    row = ROWS[line]
    return dict(zip(("length1", "length2", "length3"), row["length"], strict=True))


def acos_of_sides(a, b, c):
    return np.arccos((a * a + b * b - c * c) / (2.0 * a * b))


@LINES
def test_energy_is_that_of_the_springs_and_the_weight(line):
    row, theta1 = ROWS[line], equilibrium(ROWS[line])
    e = deflections(row, theta1, PATH_ANGLES)
    found = potential(PATH_ANGLES, e[0], **row_parameters(row), weight=0.7)
    springs = 0.5 * np.array(row["stiffness"]) @ e**2
    np.testing.assert_allclose(
        found.energy, springs + 0.7 * np.cos(PATH_ANGLES), rtol=0, atol=1e-14
    )


@pytest.mark.parametrize("mode", [1, -1])
@LINES
def test_slopes_agree_with_differences(line, mode):
    row, h = row_parameters(ROWS[line]), 1e-5
    # 0.01 rad off equilibrium
    alpha1 = deflections(ROWS[line], equilibrium(ROWS[line]), PATH_ANGLES)[0] + 0.01
    if mode == -1:
        alpha1 = 0.9 * PATH_ANGLES  # elbow down reaches these too
    call = dict(**row, weight=0.7, mode=mode)
    found = potential(PATH_ANGLES, alpha1, **call)
    for slope, (da, d1) in ((found.by_angle, (h, 0.0)), (found.by_winding1, (0.0, h))):
        more, less = (
            potential(PATH_ANGLES + s * da, alpha1 + s * d1, **call).energy for s in (1, -1)
        )
        # h^2 times a third derivative up to 50, and eps/h
        np.testing.assert_allclose(slope, (more - less) / (2 * h), rtol=0, atol=1e-8)


@LINES
def test_the_stationary_winding_is_the_equilibrium(line):
    row = row_parameters(ROWS[line])
    pose = solve(PATH_ANGLES, **row, weight=1.0)
    for i in (9, 44, 89):
        near = pose["deflection1"][i] + np.array([-1e-3, 1e-3])
        root = brentq(
            lambda x, i=i: potential(PATH_ANGLES[i], x, **row).by_winding1, *near, xtol=1e-15
        )
        assert root == pytest.approx(pose["deflection1"][i], abs=1e-13)
    found = potential(PATH_ANGLES, pose["deflection1"], **row, weight=1.0)
    np.testing.assert_allclose(found.by_winding1, 0.0, atol=1e-13)  # rounding
    np.testing.assert_allclose(found.by_angle, pose["holding_moment"], rtol=0, atol=1e-13)
    np.testing.assert_allclose(found.energy, pose["energy"], rtol=0, atol=1e-13)


def test_elbow_down_is_the_mirror_image():
    row = row_parameters(ROWS[1743]) | {"rest_angle": 0.2}
    up = potential(PATH_ANGLES, 0.9 * PATH_ANGLES, **row, weight=0.3)
    down = potential(
        -PATH_ANGLES, -0.9 * PATH_ANGLES, **row | {"rest_angle": -0.2}, weight=0.3, mode=-1
    )
    for one, other, sign in zip(up, down, (1.0, -1.0, -1.0), strict=True):
        np.testing.assert_allclose(other, sign * one, rtol=0, atol=1e-15)


def test_e8_prints_the_wrong_sign_of_the_rest_angle():
    """Line 1351 has alpha - alpha_1 + theta_10: for line 1766 q is wrong by up to 0.346 m."""
    row, theta1 = ROWS[1766], equilibrium(ROWS[1766])
    l1, start = row["length"][0], row["rest_angle"]
    e1 = theta1 - start
    true = np.abs(np.exp(1j * PATH_ANGLES) - l1 * np.exp(1j * theta1))
    q = [
        np.sqrt(1.0 + l1**2 - 2.0 * l1 * np.cos(PATH_ANGLES - e1 + sign * start))
        for sign in (-1, 1)
    ]
    np.testing.assert_allclose(q[0], true, rtol=0, atol=1e-15)
    assert true[49] == pytest.approx(0.699330, abs=5.1e-7)  # at 50 degrees
    assert q[1][49] - true[49] == pytest.approx(0.143, abs=5.1e-4)
    assert np.max(q[1] - true) == pytest.approx(0.346, abs=5.1e-4)


def test_e6_is_right_only_with_segment_1_behind_the_pendulum():
    """Line 1347, theta_2 - theta_1 = pi - gamma_2 - phi_2, is 1.17 rad off for line 1766."""
    for line, is_wrong in ((1743, False), (1766, True)):
        l1, l2, l3 = ROWS[line]["length"]
        theta1 = equilibrium(ROWS[line])[49]
        t1, t2, _ = segment_angles(ROWS[line], theta1, PATH_ANGLES[49])
        q = np.abs(np.exp(1j * PATH_ANGLES[49]) - l1 * np.exp(1j * t1))
        gamma2, phi2 = acos_of_sides(q, l1, 1.0), acos_of_sides(q, l2, l3)
        printed, ahead = np.pi - gamma2 - phi2, gamma2 - np.pi - phi2
        assert (theta1 > PATH_ANGLES[49]) == is_wrong
        # arc cosines lose digits next to a straight angle
        assert t2 - t1 == pytest.approx(ahead if is_wrong else printed, abs=1e-12)
        if is_wrong:
            assert t2 - t1 == pytest.approx(-1.324990, abs=5.1e-7)
            assert printed - (t2 - t1) == pytest.approx(1.17, abs=5.1e-3)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"length2": 0.0}, "length2 must be"),
        ({"length1": 1.0}, "length1 must be below pendulum"),
        ({"stiffness3": -1.0}, "stiffness3 must be"),
        ({"weight": np.nan}, "weight must be"),
        ({"mode": 0}, "mode must be"),
        ({"stiffness1": np.inf}, "stiffness1 must be"),
    ],
)
def test_bad_values_are_named(change, message):
    with pytest.raises(ValueError, match=message):
        potential(0.1, 0.1, **row_parameters(ROWS[1743]) | change)


def test_out_of_reach_is_nan():
    assert np.isnan(potential(3.0, 0.0, **row_parameters(ROWS[1743]))).all()
