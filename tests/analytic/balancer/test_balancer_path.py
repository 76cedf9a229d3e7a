"""Paths of a balancer where a stride could hide something: next to stops, next to a fold, at 0."""

import numpy as np
import pytest

from proofmass.analytic.balancer import balancer, events, follow, solve
from proofmass.analytic.balancer.posture import solve as solve_posture

LENGTHS = (0.45, 0.39, 0.52)
CHAIN = {f"length{i}": length for i, length in enumerate(LENGTHS, 1)} | {
    "stiffness1": 1.53,
    "stiffness2": 0.52,
    "stiffness3": 2.51,
    "rest_angle": 0.41,
}


def elbow(beta: float) -> float:
    """Angle of segment 3 from segment 2 [rad] by the law of cosines, beta from the pendulum."""
    l1, l2, l3 = LENGTHS
    square = 1.0 + l1**2 - 2.0 * l1 * np.cos(beta)
    return float(np.arccos((square - l2**2 - l3**2) / (2.0 * l2 * l3)))


@pytest.mark.parametrize("depth", [2e-4, 1e-5])
def test_a_stop_is_met_that_would_be_passed_and_left_within_a_stride(depth: float) -> None:
    """Joint 3 turns farthest where segment 1 crosses the pendulum; a stop before that holds it.

    Then the chain is one body with the pendulum, and spring 1 alone gives the moment.
    """
    high = elbow(0.0) - elbow(CHAIN["rest_angle"]) - depth
    square = 1.0 + LENGTHS[0] ** 2  # of the distance from P1 to the tip, from the held elbow
    bend = elbow(0.0) - depth
    reach = LENGTHS[1] ** 2 + LENGTHS[2] ** 2 + 2.0 * LENGTHS[1] * LENGTHS[2] * np.cos(bend)
    beta = np.arccos((square - reach) / (2.0 * LENGTHS[0]))
    alpha = np.radians([60.0, 75.0, 90.0])
    found = solve(alpha, **CHAIN, high3=high)
    # rounding, over the slope of the elbow by beta, 0.005 rad at the smaller depth
    assert found["deflection3"] == pytest.approx(high, abs=1e-13)
    held = CHAIN["stiffness1"] * (alpha + beta - CHAIN["rest_angle"])
    assert found["balancing_moment"] == pytest.approx(held, abs=1e-11)
    assert list(events(**CHAIN, high3=high)) == ["joint 3 on its stop"]


@pytest.mark.parametrize("excess", [1e-3, 1e-4, 1e-5])
def test_a_joint_that_returns_to_its_stop_within_a_stride_is_free_between(excess: float) -> None:
    """The load of a locked joint 2 is (1 - l1/r) (k1 alpha + A1 alpha^2).

    Where it falls below the preload again, joint 2 is on its stop again, at the other root.
    """
    preload = (1.0 - LENGTHS[0]) * (0.75 - excess)
    chain = CHAIN | {"rest_angle": 0.0, "stiffness1": 1.5, "quadratic1": -0.75}
    found = events(**chain, preload2=preload, low2=0.0)
    half = np.sqrt(excess / 0.75)
    # 1e-13 N m of the load, over its slope of 1.5 half
    assert found == {
        "joint 2 released": pytest.approx(1.0 - half, abs=1e-10),
        "joint 2 back on its stop": pytest.approx(1.0 + half, abs=1e-10),
    }
    within = solve([1.0 - 1.1 * half, 1.0, 1.0 + 1.1 * half], **chain, preload2=preload, low2=0.0)
    assert (within["deflection2"] > 0.1 * excess).tolist() == [False, True, False]


def test_poses_next_to_a_fold_close_the_loop_and_balance_the_springs() -> None:
    """The path's tangent grows without limit there, and tells nothing of the stride before."""
    chain = {"length1": 0.82, "length2": 0.34, "length3": 0.5, "rest_angle": 0.55}
    chain |= {"stiffness1": 2.77, "stiffness2": 1.68, "stiffness3": 0.74}
    fold = follow(balancer(**chain), 2.0).reach[0]
    for share in (1e-3, 1e-5, 3e-7):
        alpha = np.linspace(0.0, fold * (1.0 - share), 200)
        found = solve(alpha, **chain)
        tip = found["node3_x"] + 1j * found["node3_y"] + 0.5j * np.exp(-1j * found["theta3"])
        assert np.abs(tip - 1j * np.exp(-1j * alpha)).max() < 1e-14  # rounding
        for i in (1, 2, 3):
            # rounding, times a condition that grows to 1e4 at the fold
            assert found[f"node{i}_load"] == pytest.approx(found[f"moment{i}"], abs=1e-11)


def test_angles_up_to_zero_need_no_path_beyond_it() -> None:
    """A chain that jumps at once to one side can still be followed to the other."""
    chain = CHAIN | {"stiffness1": 1.5, "rest_angle": 0.0, "extension1": 0.05}
    chain |= {"preload3": -0.2, "high3": 0.0}
    jumps = chain | {"extension1": -0.05}
    solve([0.0, 0.1], **chain)
    with pytest.raises(ValueError, match="fold"):
        solve([-0.1, 0.0], **chain)
    assert solve([-0.1, 0.0], **jumps)["balancing_moment"][0] < 0.0
    with pytest.raises(ValueError, match="fold"):
        solve([0.0], **jumps)


@pytest.mark.parametrize(
    ("angle", "wrong", "said"),
    [
        ([0.0], {"stiffness3": -3.0, "quadratic3": 0.1}, "rest posture is an unstable equilibrium"),
        ([0.1, np.nan], {}, "angle must be finite"),
        ([np.inf], {}, "angle must be finite"),
        ([0.1], {"rate": np.nan}, "rate must be finite"),
        ([0.1], {"target": "sine", "target_moment": np.inf}, "target_moment must be finite"),
        ([0.1], {"stiffness4": 0.3}, "unknown parameter 'stiffness4'"),
        ([0.1], {"preload4": 0.3, "low4": 0.0}, "unknown parameter 'preload4'"),
        ([0.1], {"rest_angle2": 0.3}, "rest_angle2 is of a balancer of four segments"),
    ],
)
def test_what_has_no_answer_is_refused(angle: list[float], wrong: dict, said: str) -> None:
    """An angle that is not finite, a moment of another segment, a rest posture that falls."""
    with pytest.raises(ValueError, match=said):
        solve(angle, **(CHAIN | wrong))


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"angle": [[0.1, np.nan], [0.0, 0.0]]}, "angle must be finite"),
        ({"preload2": np.nan}, "preload2 must be finite"),
        ({"preload3": 9.0, "quadratic3": -0.5}, "preload3 is more than its spring can carry"),
        ({"preload4": 0.1}, "unknown parameter 'preload4'"),
    ],
)
def test_a_prescribed_posture_refuses_what_it_cannot_use(wrong: dict, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        solve_posture(**({"angle": [[0.1], [0.0]]} | CHAIN | wrong))


@pytest.mark.parametrize("rest_angle", [0.0, 0.41])
def test_any_joint_of_a_prescribed_posture_may_be_preloaded(rest_angle: float) -> None:
    """It has no stops: the drives' work is the change of the energy for any two preloads."""
    chain = CHAIN | {"rest_angle": rest_angle, "preload2": -0.2, "preload3": 0.3}
    alpha, e1, h = 0.7, 0.4, 1e-4
    for way in ([h, 0.0], [0.0, h]):
        inputs = np.array([[alpha], [e1]]) + np.outer(way, [-1.0, 0.0, 1.0])
        found = solve_posture(inputs, **chain)
        force = found["holding_moment" if way[0] else "drive_moment1"][1]
        slope = (found["energy"][2] - found["energy"][0]) / (2.0 * h)
        assert slope == pytest.approx(force, abs=1e-7)  # h^2 V'''/6
