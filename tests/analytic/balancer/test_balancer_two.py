"""Two segments and the pendulum form a triangle: closed forms by the cosine rule."""

import numpy as np
import pytest

from proofmass.analytic.balancer import solve
from proofmass.analytic.balancer.synthesis import Synthesis, Variant
from proofmass.design.search import Effort, SavedSearch

PAIR = {"length1": 0.6, "length2": 0.7, "stiffness1": 1.1, "stiffness2": 0.4, "quadratic1": -0.2}
ANGLES = np.radians([0.0, 10.0, 45.0, 90.0])


def triangle_angles(r, a, b):
    """Angle of segment 1 before the pendulum, and outer angle of joint 2, of sides r, a, b."""
    return np.arccos((r**2 + a**2 - b**2) / (2 * r * a)), np.pi - np.arccos(
        (a**2 + b**2 - r**2) / (2 * a * b)
    )


def test_a_triangle_turns_as_one_body():
    found = solve(ANGLES, **PAIR)
    assert found["balancing_moment"] == pytest.approx(1.1 * ANGLES - 0.2 * ANGLES**2, abs=1e-14)
    assert found["deflection2"] == pytest.approx(0.0, abs=1e-14)


def test_a_pendulum_that_extends_opens_the_triangle():
    """The moment is the derivative of the energies, by the cosine rule and differences."""
    growth = 0.1

    def energies(angle):
        at, outer = triangle_angles(1.0 + growth * angle, 0.6, 0.7)
        rest_at, rest_outer = triangle_angles(1.0, 0.6, 0.7)
        e1, e2 = angle - (at - rest_at), outer - rest_outer
        return 0.55 * e1**2 - 0.2 / 3 * e1**3 + 0.2 * e2**2

    step = 1e-5
    slope = (energies(ANGLES + step) - energies(ANGLES - step)) / (2 * step)
    found = solve(ANGLES, **PAIR, extension1=growth)["balancing_moment"]
    assert found == pytest.approx(slope, abs=1e-9)  # rounding 1e-16 over the step, and its square
    without = solve(ANGLES, **{**PAIR, "stiffness2": 0.0}, extension1=growth)["balancing_moment"]
    assert np.abs(without - slope).max() > 0.01  # a missing spring is noticed


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"rest_angle": 0.3}, "rest_angle is of a balancer of three segments or more"),
        ({"preload2": 0.1, "low2": 0.0}, "at most 0 of the joints of 2 segments"),
        ({"stiffness3": 1.0}, "unknown parameter 'stiffness3'"),
        ({"length4": 0.3}, "length3 is missing"),
        ({"friction1": 0.1}, "give pendulum_friction"),
    ],
)
def test_what_two_segments_cannot_have_is_refused(wrong, said):
    with pytest.raises(ValueError, match=said):
        solve(ANGLES, **(PAIR | wrong))


def test_the_best_single_spring_is_that_of_linear_least_squares():
    task = Synthesis(Variant("sine", 2, "each"), np.sin)
    assert list(task.variant.usual) == ["stiffness1", "quadratic1"]
    found = SavedSearch(task, Effort(((6, 4), (3, 12)))).run()
    columns = np.stack([task.angles, task.angles**2], axis=-1)
    best = np.linalg.lstsq(columns, np.sin(task.angles), rcond=None)[0]
    assert found == pytest.approx(best, abs=1e-6)  # the descent ends within 1e-7 of its cost


def test_two_segments_have_no_rest_angle_to_choose():
    with pytest.raises(ValueError, match="form a triangle"):
        Variant("sine", 2, free_angle=True)
