"""Closed formulas of a balancer against equilibria by search, finite differences and limits."""

import numpy as np
import pytest
from scipy.optimize import brentq

from proofmass.analytic.balancer import solve
from tests.analytic.balancer.balancer_chain import (
    PATH_ANGLES,
    ROWS,
    energy_slope,
    row_parameters,
    segment_angles,
)
from tests.independent.balancer.laws import (
    initial_stiffness,
    leverage,
    release_angle,
    scaled,
    slack_moment,
)

# Preloaded optima of van Nes 2022: l1, M02, k1, A1, release in degrees as found by bisection of an
# independent path (inf: never).
PRELOADED = {
    1745: (0.4764, 0.3983, 0.9341, 0.0, 46.6595),
    2086: (0.4278, 0.4968, 1.9362, 0.0, 25.6925),
    1998: (0.4689, 0.1367, 1.6965, 0.0, 8.6928),
    2157: (0.5000, 0.3690, 1.5268, 0.0, 27.6947),
    1801: (0.3887, 0.5780, 1.1032, -0.2693, 69.958),
    1826: (0.4658, 0.3642, 0.0361, 0.4207, 70.521),
    2167: (0.3344, 0.6610, 2.4953, -1.6017, np.inf),
}
# Initial stiffness of free optima [N m/rad], recomputed independently to six decimals.
INITIAL_STIFFNESS = {
    1743: 0.752771,
    1789: 0.990662,
    1814: 0.043256,
    2084: 0.862462,
    1766: 1.002052,
    2107: 2.670295,
}
FOUR_SEGMENTS = {
    "length1": 0.3609,
    "length2": 0.3739,
    "length3": 0.3745,
    "length4": 0.3083,
    "stiffness1": 1.3125,
    "stiffness2": 0.9037,
    "stiffness3": 1.1970,
    "stiffness4": 0.1568,
}


def rest_angles(row):
    return segment_angles(row, row.get("rest_angle", 0.0), 0.0)


def slope_by_tip_force(theta, lengths, stiffness):
    """dM1/dangle from one system for deflections and tip force: K e = W F, the tip moves with t."""
    steps = np.asarray(lengths) * np.exp(-1j * np.asarray(theta))  # x is minus the imaginary part
    to_tip = np.cumsum(steps[::-1])[::-1]
    w = np.stack([-to_tip.real, -to_tip.imag], axis=-1)
    n = len(lengths)
    matrix = np.block([[np.diag(stiffness), -w], [w.T, np.zeros((2, 2))]])
    tip = np.array([to_tip[0].real, to_tip[0].imag])
    return stiffness[0] * np.linalg.solve(matrix, np.concatenate([np.zeros(n), -tip]))[0]


@pytest.mark.parametrize("line", PRELOADED)
def test_release_angle_follows_from_one_length(line):
    l1, preload, k1, a1, release = PRELOADED[line]
    found = np.degrees(release_angle(preload, 1.0 - l1, k1, a1))
    assert found == pytest.approx(release, abs=6e-4 if a1 else 6e-5)  # half a unit, last digit


@pytest.mark.parametrize("line", [1745, 1768, 1826])
def test_release_angle_is_that_of_a_search(line):
    """The search turns the chain as one body.

    It finds the angle from which on virtual work no longer presses joint 2 on its stop.
    """
    row = ROWS[line]
    share = leverage(rest_angles(row), row["length"])[1]
    start = row.get("rest_angle", 0.0)
    searched = brentq(lambda a: energy_slope(row, start + a, a), 0.1, 1.5, xtol=1e-14)
    assert release_angle(
        row["preload2"], share, row["stiffness"][0], row.get("quadratic", 0.0)
    ) == pytest.approx(searched, abs=1e-13)
    found = solve(searched + np.array([-1e-6, 1e-6]), **row_parameters(row))["deflection2"]
    assert abs(found[0]) < 1e-12 < found[1]


def test_leverage_of_three_segments_as_a_quotient_of_sines():
    for row in ROWS.values():
        (t1, t2, t3), (l1, l2, _) = rest_angles(row), row["length"]
        outer = l2 * np.sin(t3 - t2)
        assert leverage(rest_angles(row), row["length"]) == pytest.approx(
            [1.0, outer / (l1 * np.sin(t3 - t1) + outer), 0.0], rel=1e-14, abs=0
        )
        if not t1:
            assert leverage(rest_angles(row), row["length"])[1] == pytest.approx(
                1.0 - l1, abs=1e-15
            )
    # line 1768: its segment 1 leans forward, and the release comes at 33.1218 degrees
    row = ROWS[1768]
    release = release_angle(
        row["preload2"], leverage(rest_angles(row), row["length"])[1], row["stiffness"][0]
    )
    assert np.degrees(release) == pytest.approx(33.1218, abs=6e-5)


@pytest.mark.parametrize(
    ("length", "k1", "preloads", "first"),
    [
        ((0.29, 0.29, 0.29, 0.29), 0.971, (0.596, 0.225), 31.611),  # table F.1, unrounded
        ((0.3252, 0.2926, 0.3570, 0.3558), 0.9512, (0.6055, 0.2502), 39.432),  # line 1747
    ],
)
def test_first_release_of_four_segments(length, k1, preloads, first):
    parameters = {f"length{i}": each for i, each in enumerate(length, 1)}
    parameters |= {
        "stiffness1": k1,
        "stiffness2": 0.2,
        "stiffness3": 0.2,
        "low2": 0.0,
        "low3": 0.0,
        "preload2": preloads[0],
        "preload3": preloads[1],
    }
    posture = solve(0.0, **parameters)
    share = leverage([posture[f"theta{i}"] for i in range(1, 5)], length)[1:3]
    assert share == pytest.approx([1.0 - length[0], 1.0 - length[0] - length[1]], abs=1e-14)
    releases = release_angle(preloads, share, k1)
    assert np.degrees(releases[1]) == pytest.approx(first, abs=6e-4)
    assert releases[1] < releases[0]
    found = solve(releases[1] + np.array([-1e-6, 1e-6]), **parameters)
    assert abs(found["deflection3"][0]) < 1e-12 < found["deflection3"][1]
    assert abs(found["deflection2"][1]) < 1e-12


def test_joints_may_release_at_once_or_never():
    assert release_angle(0.0, 0.5, 1.0) == 0.0
    assert np.isinf(release_angle(0.0, -0.5, 1.0))
    assert np.isinf(release_angle(0.3, [-0.2, 0.0], 1.0)).all()
    # line 1839: linear, at 157.5 degrees: far beyond its 90
    theta = segment_angles({"length": (0.3382, 0.5, 0.5)}, 0.0152, 0.0)
    late = release_angle(0.944, leverage(theta, (0.3382, 0.5, 0.5))[1], 0.5152)
    assert np.degrees(late) == pytest.approx(157.5, abs=0.06)


@pytest.mark.parametrize("line", INITIAL_STIFFNESS)
def test_initial_stiffness_is_the_slope_of_the_moment_at_rest(line):
    row = ROWS[line]
    found = initial_stiffness(rest_angles(row), row["length"], row["stiffness"])
    assert found == pytest.approx(INITIAL_STIFFNESS[line], abs=5.1e-7)
    assert found == pytest.approx(
        slope_by_tip_force(rest_angles(row), row["length"], row["stiffness"]), rel=1e-13, abs=0
    )
    # central difference of step 1e-3: error step^2 times the third derivative, up to 10
    moment = solve([-1e-3, 1e-3], **row_parameters(row))["balancing_moment"]
    assert found == pytest.approx((moment[1] - moment[0]) / 2e-3, abs=1e-5)
    if not row.get("rest_angle"):
        (l1, _, _), (k1, k2, k3) = row["length"], row["stiffness"]
        assert found == pytest.approx(1.0 / (1.0 / k1 + (1.0 - l1) ** 2 / k2), rel=1e-12, abs=0)
        assert found == pytest.approx(
            initial_stiffness(rest_angles(row), row["length"], (k1, k2, 5.0 * k3)), rel=1e-12, abs=0
        )


def test_initial_stiffness_of_four_segments_and_of_a_leaning_start():
    posture = solve(0.0, **FOUR_SEGMENTS, rest_angle=0.3, rest_angle2=-0.2)
    theta = np.array([float(posture[f"theta{i}"]) for i in range(1, 5)])
    lengths, stiffness = (
        [FOUR_SEGMENTS[f"{name}{i}"] for i in range(1, 5)] for name in ("length", "stiffness")
    )
    found = initial_stiffness(theta, lengths, stiffness)
    moment = solve([-1e-3, 1e-3], **FOUR_SEGMENTS, rest_angle=0.3, rest_angle2=-0.2)[
        "balancing_moment"
    ]
    assert found == pytest.approx((moment[1] - moment[0]) / 2e-3, abs=1e-5)  # as above
    assert found == pytest.approx(
        initial_stiffness(theta + 0.7, lengths, stiffness), rel=1e-13, abs=0
    )


def test_a_locked_joint_enters_with_infinite_stiffness():
    row = ROWS[1745]
    locked = initial_stiffness(rest_angles(row), row["length"], (0.9341, np.inf, 0.0927))
    assert locked == pytest.approx(0.9341, rel=1e-13, abs=0)  # turns as one body
    with pytest.raises(ValueError, match="stiffness must be positive, or inf"):
        initial_stiffness(rest_angles(row), row["length"], (0.9341, 0.0, 0.0927))


def test_stiff_outer_springs_leave_spring_1_alone():
    stiff = row_parameters(ROWS[1766]) | {"stiffness2": 1e9, "stiffness3": 1e9}
    # compliance of the other springs divided by that of spring 1
    np.testing.assert_allclose(
        solve(PATH_ANGLES, **stiff)["balancing_moment"], 1.2701 * PATH_ANGLES, rtol=1e-8
    )


@pytest.mark.parametrize("line", [1743, 1766])
def test_without_outer_springs_the_moment_is_zero_until_the_chain_is_taut(line):
    """Spring 1 alone has its least energy at rest, or as close to rest as the tip allows."""
    row = ROWS[line]
    (l1, *outer), k1 = row["length"], row["stiffness"][0]
    start, reach = row.get("rest_angle", 0.0), sum(outer)
    angle = np.radians(np.arange(0, 181, 5))
    theta = np.linspace(start - 1.0, start + np.pi, 20_001)
    distance = np.abs(np.exp(1j * angle[:, None]) - l1 * np.exp(1j * theta))
    nearest = np.where(distance <= reach, np.abs(theta - start), np.inf).min(axis=1)
    found = slack_moment(
        angle, pendulum=1.0, length1=l1, reach=reach, stiffness1=k1, rest_angle=start
    )
    assert 10 < np.sum(found == 0.0) < 30
    np.testing.assert_allclose(found, k1 * nearest, rtol=0, atol=k1 * 2.1e-4)  # step of theta


def test_outer_segments_that_reach_everywhere_are_never_taut():
    assert slack_moment(np.pi, pendulum=1.0, length1=0.5, reach=1.6, stiffness1=1.0) == 0.0


@pytest.mark.parametrize("line", [1745, 1766, 1826])
def test_a_scaled_balancer_has_scaled_curves(line):
    length, moment = 0.37, 21.0
    small, large = row_parameters(ROWS[line]) | {"weight": 0.3}, {}
    large = scaled(small, length=length, moment=moment)
    assert large["length1"] == length * small["length1"]
    assert large["rest_angle"] == small["rest_angle"]
    one, other = (solve(PATH_ANGLES, **each) for each in (small, large))
    # rounding: the same equilibrium in other units
    for name in ("balancing_moment", "holding_moment", "energy"):
        np.testing.assert_allclose(other[name], moment * one[name], rtol=0, atol=1e-12 * moment)
    np.testing.assert_allclose(other["theta3"], one["theta3"], rtol=0, atol=1e-12)
    np.testing.assert_allclose(
        other["force_x"], moment / length * one["force_x"], rtol=0, atol=1e-11 * moment / length
    )
