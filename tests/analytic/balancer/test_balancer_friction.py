"""Friction loops against the least dissipation of small steps, and where they are widest."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from proofmass.analytic.balancer import solve
from tests.analytic.balancer.balancer_chain import PATH, ROWS, angles, flat, windings
from tests.independent.balancer.friction import Loop, dissipated, loop
from tests.independent.balancer.lagrange import potential

ROW = ROWS[1766]
FOUND = solve(PATH, **flat(ROW))
TURNS = np.stack([FOUND[f"winding{i}_rate"] for i in (1, 2, 3)] + [1.0 - FOUND["theta3_rate"]])
EVEN = np.full(4, 0.005)  # [N m] in each joint and in the tip


def stepped(friction, path):
    """Moment [N m] between the poses of `path`: each minimises energy plus what the step rubs off.

    The incremental problem of rate-independent friction; it knows sticking, and no first order.
    """

    def joints(theta1, alpha):
        return np.append(windings(ROW, theta1, alpha), alpha - angles(ROW, theta1, alpha)[2])

    def energy(theta1, alpha):
        return float(potential(alpha, theta1 - ROW["rest_angle"], **flat(ROW)).energy)

    theta, moments = ROW["rest_angle"], []
    for last, alpha in pairwise(path):
        here = joints(theta, last)

        def cost(t, alpha=alpha, here=here):
            return energy(t, alpha) + friction @ np.abs(joints(t, alpha) - here)

        # as far as friction of this size can keep the chain from its free equilibrium
        found = minimize_scalar(
            cost, bounds=(theta - 0.1, theta + 0.1), method="bounded", options={"xatol": 1e-10}
        )
        moments.append((found.fun - energy(theta, last)) / (alpha - last))
        theta = found.x
    return np.array(moments)


def test_no_friction_no_loop():
    found = loop(FOUND["holding_moment"], TURNS, np.zeros(4))
    np.testing.assert_array_equal(found.out, found.back)
    assert dissipated(PATH, found) == 0.0


@pytest.mark.parametrize("friction", [EVEN, np.array([0.0, 0.005, 0.005, 0.0])])
def test_loop_is_widest_where_the_chain_moves_most(friction):
    """From 60 to 90 degrees, as the thesis's measured band; |dbeta/dalpha| peaks there as well."""
    found = loop(FOUND["holding_moment"], TURNS, friction)
    width, inner = found.out - found.back, np.abs(FOUND["theta1_rate"] - 1.0)
    late = np.arange(1, 91) >= 60  # degrees
    assert width[late].min() > 0.99 * width[~late].max()
    assert width[late].mean() > 1.2 * width[~late].mean()
    assert late[np.argmax(width)]
    assert late[np.argmax(inner)]


def test_how_far_the_chain_moves_against_the_pendulum():
    """Mean |dbeta/dalpha| over ten degrees each, recomputed independently to two decimals."""
    tens = np.radians([0.0, 10.0, 50.0, 60.0, 70.0, 80.0, 90.0])
    beta = solve(tens, **flat(ROW))["theta1"] - tens
    mean = -np.diff(beta)[[0, 2, 3, 4, 5]] / np.radians(10.0)
    np.testing.assert_allclose(mean, [0.22, 0.53, 0.70, 0.84, 0.76], rtol=0, atol=5.1e-3)


def test_area_is_the_work_of_friction():
    found = loop(FOUND["holding_moment"], TURNS, EVEN)
    joints = np.concatenate([windings(ROW, FOUND["theta1"], PATH), [PATH - FOUND["theta3"]]])
    way = np.abs(np.diff(joints, axis=1)).sum(axis=1)  # all that each joint turns, back and forth
    # trapezoids of 1 degree against sums of differences: a twelfth of step^2 times the curvature
    assert dissipated(PATH, found) == pytest.approx(2.0 * EVEN @ way, rel=1e-3)
    both = loop(FOUND["holding_moment"], TURNS, 2.0 * EVEN)
    assert dissipated(PATH, both) == pytest.approx(2.0 * dissipated(PATH, found), rel=1e-14)


def test_loop_is_symmetric_about_the_conservative_curve():
    found = loop(FOUND["holding_moment"], TURNS, EVEN)
    np.testing.assert_allclose((found.out + found.back) / 2, FOUND["holding_moment"], atol=1e-15)
    assert np.all(found.out > found.back)


def test_first_order_of_the_least_dissipation():
    """Error of the loop against small steps with sticking: of second order in the friction."""
    path = np.radians(np.concatenate([np.arange(0.0, 80.1, 0.5), np.arange(79.5, 29.9, -0.5)]))
    way = np.sign(np.diff(path))
    middle = (path[1:] + path[:-1]) / 2.0
    pose = solve(np.sort(middle), **flat(ROW))
    order = np.argsort(np.argsort(middle))
    turns = np.stack([pose[f"winding{i}_rate"] for i in (1, 2, 3)] + [1.0 - pose["theta3_rate"]])
    # sliding: the docstring's span of sticking is 2 degrees at most after the start and the turn
    sliding = ((way > 0) & (middle > np.radians(4))) | ((way < 0) & (middle < np.radians(76)))
    errors = []
    for friction in (2.0 * EVEN, EVEN):
        branches = loop(pose["holding_moment"], turns, friction)
        expected = np.where(way > 0, branches.out[order], branches.back[order])
        errors.append(np.abs(stepped(friction, path) - expected)[sliding].max())
        width = (branches.out - branches.back).min()
    assert errors[1] < 0.02 * width
    assert errors[0] / errors[1] == pytest.approx(4.0, abs=0.5)


@pytest.mark.parametrize(
    ("friction", "message"),
    [
        ([0.1, 0.1, 0.1, -0.1], "friction must be zero or positive"),
        ([0.1, 0.1, 0.1, np.nan], "friction must be zero or positive"),
        ([0.1], "friction must be one moment for each of 4 joints"),
    ],
)
def test_bad_friction(friction, message):
    with pytest.raises(ValueError, match=message):
        loop(FOUND["holding_moment"], TURNS, friction)


def test_a_batch():
    moments = np.stack([FOUND["holding_moment"], 2.0 * FOUND["holding_moment"]])
    found = loop(moments, np.stack([TURNS, 3.0 * TURNS], axis=1), EVEN)
    assert isinstance(found, Loop)
    assert dissipated(PATH, found)[1] == pytest.approx(3.0 * dissipated(PATH, found)[0], rel=1e-14)
