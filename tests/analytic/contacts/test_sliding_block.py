"""The sliding block against an event solver, the work of friction, and limits."""

import numpy as np
import pytest

from proofmass.analytic.contacts import sliding_block
from tests.analytic.contacts.events import solve_phases

CASES = {
    "level": {"friction": 0.5, "speed": 2.0},
    "up, sticks": {"friction": 0.7, "angle": 0.5, "speed": 3.0},
    "up, slides back": {"friction": 0.3, "angle": 0.5, "speed": 3.0},
    "down, stops": {"friction": 0.7, "angle": 0.5, "speed": -1.0},
    "down, goes on": {"friction": 0.3, "angle": 0.5, "speed": -1.0},
    "let go": {"friction": 0.3, "angle": 0.5},
    "without friction": {"friction": 0.0, "angle": 0.5, "speed": 1.0},
}
GRAVITY = 9.81


def solve_by_events(times, *, friction, angle=0.0, speed=0.0):
    """Positions and velocities by the balance of forces of each phase."""

    def sliding(sense):
        normal = np.array([-np.sin(angle), np.cos(angle)])
        up = np.array([np.cos(angle), np.sin(angle)])
        weight = np.array([0.0, -GRAVITY])
        force = weight - normal * (weight @ normal)
        force = force + sense * friction * (weight @ normal) * up
        return (
            lambda y: np.array([y[1], force @ up]),
            lambda y: sense * y[1] if sense * (force @ up) < 0 else 1.0,
            lambda y: (resting() if friction >= np.tan(angle) else sliding(-1), [y[0], 0.0]),
        )

    def resting():
        return lambda y: np.zeros(2), lambda y: 1.0, None

    sense = np.sign(speed) or -1.0
    first = resting() if not speed and friction >= np.tan(angle) else sliding(sense)
    return solve_phases(first, [0.0, speed], times)


def largest_difference(times, closed, **case):
    """Largest difference [m, m/s] between a closed form and the event solver."""
    found = np.stack([closed["position"], closed["velocity"]], axis=-1)
    return np.abs(found - solve_by_events(times, **case)).max()


@pytest.mark.parametrize("name", CASES)
def test_an_event_solver_agrees_and_a_wrong_friction_differs(name):
    case, times = CASES[name], np.linspace(0.0, 1.3, 131)
    assert (
        largest_difference(times, sliding_block.solve(times, **case), **case) < 1e-12
    )  # error of the solver
    wrong = sliding_block.solve(times, **{**case, "friction": case["friction"] + 1e-4})
    assert largest_difference(times, wrong, **case) > 1e-6


@pytest.mark.parametrize("name", CASES)
def test_the_change_of_the_energy_is_the_work_of_friction(name):
    """The change of the energy is the work of friction, by the trapezoidal rule.

    The rule is exact except in the interval in which the block stops, which is left out.
    """
    case, times = CASES[name], np.linspace(0.0, 1.3, 1301)
    at = sliding_block.solve(times, **case, mass=2.0)
    height = at["position"] * np.sin(case.get("angle", 0.0))
    energy = at["velocity"] ** 2 + 2.0 * GRAVITY * height  # for 2 kg
    work = 0.5 * (at["friction_force"][1:] + at["friction_force"][:-1]) * np.diff(at["position"])
    clear = np.diff(at["acceleration"]) == 0.0
    assert np.abs(np.diff(energy) - work)[clear].max() < 1e-13
    assert (work[clear] <= 1e-15).all()
    assert (np.abs(at["friction_force"]) <= case["friction"] * at["normal_force"] + 1e-12).all()
    balance = at["friction_force"] - 2.0 * GRAVITY * np.sin(case.get("angle", 0.0))
    np.testing.assert_allclose(2.0 * at["acceleration"], balance, atol=1e-14, rtol=0)


def test_textbook_distance_and_limits():
    late = sliding_block.solve(9.0, friction=0.5, speed=2.0)
    assert late["position"] == pytest.approx(4.0 / (2 * 0.5 * 9.81), rel=1e-15, abs=0)
    assert sliding_block.stop_time(friction=0.0, speed=1.0, angle=0.0) == np.inf
    edge = np.tan(0.5)
    assert sliding_block.solve(1.0, friction=edge * (1 + 1e-12), angle=0.5)["velocity"] == 0.0
    assert sliding_block.solve(1.0, friction=edge * (1 - 1e-6), angle=0.5)["velocity"] < 0.0


@pytest.mark.parametrize(
    "wrong",
    [{"friction": -0.1}, {"angle": 1.6}, {"mass": 0.0}, {"speed": np.nan}, {"gravity": -1.0}],
)
def test_invalid_parameters_of_the_creep_are_refused(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        sliding_block.solve(0.0, **{"friction": 0.5, **wrong})


@pytest.mark.parametrize("friction", [0.4, 0.52, 0.57, 0.58, 0.9])
def test_the_described_behaviour_at_rest_is_that_of_the_solution(friction):
    """The slope has 30 degrees: its tangent is 0.577, its sine 0.5."""
    case = {"friction": friction, "angle": np.pi / 6, "speed": 1.0}
    described = sliding_block.properties(**case)["at rest"]
    late = sliding_block.solve(5.0, **case)["acceleration"]
    assert described.startswith("sticks" if late == 0.0 else "slides down")
    if late == 0.0:
        assert described.endswith(f"{100.0 / np.sqrt(3.0) / friction:.4g} % of the friction")


def test_times_before_the_start_are_refused():
    with pytest.raises(ValueError, match="time must not be negative"):
        sliding_block.solve([0.0, -1.0], friction=0.5)


def test_a_block_on_level_ground_does_not_slide_down_even_without_friction():
    """On a slope without friction it slides, on the level it does not."""
    assert sliding_block.properties(friction=0.0, speed=1.0)["at rest"].startswith("stays")
    assert sliding_block.properties(friction=0.0, angle=0.1)["at rest"].startswith("slides down")
