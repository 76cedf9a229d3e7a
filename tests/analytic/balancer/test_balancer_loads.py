"""Pin forces and node loads against the thesis's table and printed forms, and on free bodies."""

import numpy as np
import pytest

from proofmass.analytic.balancer import solve
from tests.analytic.balancer.balancer_chain import PATH_ANGLES, ROWS, row_parameters
from tests.independent.balancer.laws import leverage
from tests.independent.balancer.loads import levers, node_loads, pin_force, pivot_force

# Line 1766 of van Nes 2022 at 10, 30 .. 90 degrees; recomputed independently, six decimals:
# angles of the segments, spring moments, force on segment 1.
TABLE = np.array(
    [
        [0.799560, 1.053317, 1.269193, 1.403753, 1.472860],
        [-0.740793, -0.405551, -0.055796, 0.340306, 0.821898],
        [0.526763, 0.946101, 1.390143, 1.881951, 2.381865],
        [0.172048, 0.494344, 0.768529, 0.939433, 1.027206],
        [0.025276, 0.094319, 0.207754, 0.429359, 0.778858],
        [0.158810, 0.504257, 0.891575, 1.284712, 1.359974],
        [-0.082503, 0.316042, 1.377100, 2.684133, 2.971541],
        [0.522891, 1.536089, 2.158767, 1.976668, 1.027206],
    ]
)
LOCKED_DEFLECTION = (
    1e-12  # [rad] rounding of a locked deflection; one degree after the release it is 1e-3
)
EACH_FREE_LINE = pytest.mark.parametrize("line", [1743, 1766, 1789, 1814, 2107])
# Four segments, elbow up, with a spring in the last joint (line 1744) and two preloads (D.1).
FOUR_SEGMENTS = {
    "pendulum": 1.0,
    "length1": 0.3609,
    "length2": 0.3739,
    "length3": 0.3745,
    "length4": 0.3083,
    "stiffness1": 1.3125,
    "stiffness2": 0.9037,
    "stiffness3": 1.1970,
    "stiffness4": 0.1568,
}
TWO_PRELOADS = {
    "pendulum": 1.0,
    "length1": 0.3252,
    "length2": 0.2926,
    "length3": 0.3570,
    "length4": 0.3558,
    "stiffness1": 0.9512,
    "stiffness2": 0.2082,
    "stiffness3": 0.1392,
    "stiffness4": 0.0614,
    "preload2": 0.6055,
    "low2": 0.0,
    "preload3": 0.2502,
    "low3": 0.0,
}


def equilibrium_pose(parameters, angle=PATH_ANGLES):
    """Angles, lengths, spring moments (..., n) of a balancer in equilibrium, and all its curves."""
    found = solve(angle, **parameters)
    count = 4 if "length4" in parameters else 3
    theta, moment = (
        np.stack([found[f"{name}{i}"] for i in range(1, count + 1)], axis=-1)
        for name in ("theta", "moment")
    )
    return theta, np.array([parameters[f"length{i}"] for i in range(1, count + 1)]), moment, found


def test_angles_moments_and_forces_of_line_1766_are_those_recomputed():
    theta, lengths, moment, _ = equilibrium_pose(
        row_parameters(ROWS[1766]), np.radians([10, 30, 50, 70, 90])
    )
    force = pin_force(theta, lengths, moment)
    # half a unit of the last digit
    np.testing.assert_allclose(np.stack([*theta.T, *moment.T, *force]), TABLE, rtol=0, atol=5.1e-7)


def test_pose_of_line_1743_at_50_degrees_is_that_recomputed():
    theta, lengths, moment, found = equilibrium_pose(row_parameters(ROWS[1743]), np.radians(50.0))
    np.testing.assert_allclose(theta, [0.494797, 0.333724, 2.167919], rtol=0, atol=5.1e-7)
    np.testing.assert_allclose(
        pin_force(theta, lengths, moment), [-0.612299, 0.378094], rtol=0, atol=5.1e-7
    )
    assert moment[1] == pytest.approx(0.333497087, abs=5.1e-10)
    assert found["energy"] == pytest.approx(0.297768, abs=5.1e-7)


@EACH_FREE_LINE
def test_printed_forms_give_the_same_force(line):
    """Eqs B.3, B.4 and those of the program, which lose digits where segment 1 or 3 is level."""
    theta, lengths, moment, _ = equilibrium_pose(row_parameters(ROWS[line]))
    (s1, s2, s3), (c1, c2, c3), (l1, l2, l3) = np.sin(theta).T, np.cos(theta).T, lengths
    m1, m2, m3 = moment.T
    across, up = l1 * c1 + l2 * c2, l1 * s1 + l2 * s2
    span = l2 * s2 - l2 * np.tan(theta[:, 0]) * c2
    y_b4 = (m1 - m3) / span + (m2 - m1) * across / (l1 * c1 * span)
    x_b3 = (m2 - m1 + y_b4 * l1 * s1) / (l1 * c1)
    y_code = (m1 - m3 - m3 / (l3 * c3) * across) / (up - np.tan(theta[:, 2]) * across)
    x_code = (-m3 + y_code * l3 * s3) / (l3 * c3)
    force = np.array(pin_force(theta, lengths, moment))
    for printed, level in (((x_b3, y_b4), c1), ((x_code, y_code), c3)):
        # rounding of six terms of up to 3, 1e-14, divided by an elbow's sine, 0.1, and twice by the
        # cosine: in the other component, and then in this one
        assert np.all(np.abs(np.array(printed) - force).max(axis=0) <= 1e-13 / level**2)


@pytest.mark.parametrize(
    "parameters", [*(row_parameters(ROWS[line]) for line in (1743, 1766, 2107)), FOUR_SEGMENTS]
)
def test_springs_of_free_joints_carry_their_load(parameters):
    theta, lengths, moment, found = equilibrium_pose(parameters)
    force = pin_force(theta, lengths, moment)
    # M_1 and M_n are equal by construction, the others only at equilibrium, to its rounding
    np.testing.assert_allclose(node_loads(theta, lengths, *force), moment, rtol=0, atol=1e-13)
    np.testing.assert_allclose(force, [found["force_x"], found["force_y"]], rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    "parameters",
    [row_parameters(ROWS[1745]), row_parameters(ROWS[1766]), FOUR_SEGMENTS, TWO_PRELOADS],
)
def test_node_loads_and_forces_along_segments_are_those_of_the_appendices(parameters):
    """Joints are free or on stops; forces are resolved along and across each segment."""
    theta, lengths, _, found = equilibrium_pose(parameters)
    force = found["force_x"], found["force_y"]
    loads = node_loads(theta, lengths, *force)
    for i in range(theta.shape[-1]):
        s, c = np.sin(theta[:, i]), np.cos(theta[:, i])
        own = [found[f"node{i + 1}_{name}"] for name in ("load", "force_x", "force_y")]
        along, across = s * force[0] + c * force[1], s * force[1] - c * force[0]
        np.testing.assert_allclose(own, [loads[:, i], along, across], rtol=0, atol=1e-14)


def test_a_wrong_spring_moment_differs_from_the_load_of_its_joint():
    theta, lengths, moment, _ = equilibrium_pose(row_parameters(ROWS[1766]))
    moment[:, 1] *= 1.001
    loads = node_loads(theta, lengths, *pin_force(theta, lengths, moment))
    np.testing.assert_allclose(loads[:, 1], moment[:, 1] / 1.001, rtol=0, atol=1e-13)


@pytest.mark.parametrize("parameters", [row_parameters(ROWS[1766]), FOUR_SEGMENTS])
def test_each_segment_is_in_equilibrium(parameters):
    """Moments on segment i about its inner pin sum to zero: two springs and the outer pin force."""
    theta, lengths, moment, _ = equilibrium_pose(parameters)
    fx, fy = (force[:, None] for force in pin_force(theta, lengths, moment))
    outer = np.roll(moment, -1, axis=-1)
    outer[:, -1] = 0.0  # no spring in the tip
    turning = outer - moment + lengths * (np.sin(theta) * fy - np.cos(theta) * fx)
    np.testing.assert_allclose(turning, 0.0, atol=1e-13)  # rounding at equilibrium


@EACH_FREE_LINE
def test_any_free_joint_gives_the_same_force(line):
    theta, lengths, moment, _ = equilibrium_pose(row_parameters(ROWS[line]))
    x, y = levers(theta, lengths)
    area = np.abs(x[:, 1] * y[:, 0] - x[:, 0] * y[:, 1])
    last, middle = (np.array(pin_force(theta, lengths, moment, joint)) for joint in (3, 2))
    assert np.all(np.abs(last - middle) <= 1e-13 / area)  # rounding over the divisor


def test_pendulum_is_in_equilibrium():
    weight = 0.7
    theta, lengths, moment, found = equilibrium_pose(
        row_parameters(ROWS[1766]) | {"weight": weight}
    )
    force = pin_force(theta, lengths, moment)
    pivot = np.array(pivot_force(*force, weight=weight))
    # eps
    np.testing.assert_allclose(
        pivot + force, [0 * PATH_ANGLES, 0 * PATH_ANGLES + weight], atol=1e-15, rtol=0
    )
    about_tip = (
        np.sin(PATH_ANGLES) * pivot[1] - np.cos(PATH_ANGLES) * pivot[0] + found["holding_moment"]
    )
    np.testing.assert_allclose(about_tip, 0.0, atol=1e-13)


@pytest.mark.parametrize("line", [1745, 1768])
def test_a_locked_joint_carries_less_than_its_preload(line):
    row = ROWS[line]
    theta, lengths, moment, found = equilibrium_pose(row_parameters(row))
    load = node_loads(theta, lengths, *pin_force(theta, lengths, moment))[:, 1]
    locked = np.abs(found["deflection2"]) < LOCKED_DEFLECTION
    assert 20 < locked.sum() < 70
    share = leverage(theta[0], lengths)[1]
    np.testing.assert_allclose(load[locked], share * moment[locked, 0], rtol=1e-13)
    assert np.all(load[locked] < row["preload2"])
    np.testing.assert_allclose(moment[locked, 1], row["preload2"], rtol=1e-15)
    np.testing.assert_allclose(load[~locked], moment[~locked, 1], rtol=0, atol=1e-13)


def test_locked_joints_of_two_preloads_carry_less_than_their_preload():
    theta, lengths, moment, found = equilibrium_pose(TWO_PRELOADS)
    loads = node_loads(theta, lengths, *pin_force(theta, lengths, moment))
    for joint in (2, 3):
        locked = np.abs(found[f"deflection{joint}"]) < LOCKED_DEFLECTION
        assert np.all(loads[locked, joint - 1] < TWO_PRELOADS[f"preload{joint}"])
        np.testing.assert_allclose(
            loads[~locked, joint - 1], moment[~locked, joint - 1], rtol=0, atol=1e-13
        )
    np.testing.assert_allclose(
        loads[0] / moment[0, 0], leverage(theta[0], lengths), atol=1e-14, rtol=0
    )


def test_appendix_c_needs_the_opposite_sign_of_its_last_moment():
    """C.1 and C.2 add M_4, the program subtracts it; with M_4 = k_4 e_4 only that is right."""
    theta, lengths, moment, _ = equilibrium_pose(FOUR_SEGMENTS)
    s, c = np.sin(theta), np.cos(theta)
    up, across = (np.sum(lengths[:3] * part[:, :3], axis=-1) for part in (s, c))
    m1, m4 = moment[:, 0], moment[:, 3]

    def loads(last):
        y = (m1 - last - last / (lengths[3] * c[:, 3]) * across) / (up - s[:, 3] / c[:, 3] * across)
        x = (-last + y * lengths[3] * s[:, 3]) / (lengths[3] * c[:, 3])
        return node_loads(theta, lengths, x, y)

    # rounding over cos theta_4, which passes zero on the path
    near = np.abs(c[:, 3]) > 0.05
    np.testing.assert_allclose(loads(m4)[near], moment[near], rtol=0, atol=1e-12)
    printed = loads(-m4)
    np.testing.assert_allclose(printed[near, 0], m1[near], rtol=0, atol=1e-12)  # not affected
    assert np.abs(printed - moment)[near, 1:3].max() > 0.05


def test_force_is_singular_only_if_the_last_segment_points_at_the_pivot():
    upright = pin_force([0.0, -np.pi / 3, np.pi / 3], [0.5] * 3, [1.0, 0.5, 0.2])
    assert np.isfinite(upright).all()
    level = pin_force([np.pi / 2, 0.0, np.pi / 2], [0.5] * 3, [1.0, 0.5, 0.2])
    assert np.isfinite(level).all()  # cos theta_1 = cos theta_3 = 0
    assert not np.isfinite(pin_force([0.0, 0.0, 0.0], [0.5] * 3, [1.0, 0.5, 0.2])).any()


@pytest.mark.parametrize("joint", [0, 1, 4, -1])
def test_unknown_joints_are_refused(joint):
    with pytest.raises(ValueError, match=f"joint must be one of 2 to 3, got {joint}"):
        pin_force([0.0, -1.0, 1.0], [0.5] * 3, [1.0, 0.5, 0.2], joint)


def test_a_batch_gives_the_forces_of_its_members():
    poses = [equilibrium_pose(row_parameters(ROWS[line])) for line in (1743, 1766)]
    theta, lengths, moment = (np.stack(part) for part in list(zip(*poses, strict=True))[:3])
    force = pin_force(theta, lengths[:, None], moment)
    for row, (one_theta, one_length, one_moment, _) in enumerate(poses):
        np.testing.assert_array_equal(
            np.array(force)[:, row], pin_force(one_theta, one_length, one_moment)
        )
