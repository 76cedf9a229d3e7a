"""The ball that slides and rolls against an event solver, angular momentum, and limits."""

import numpy as np
import pytest

from proofmass.analytic.contacts import rolling_ball
from tests.analytic.contacts.events import solve_phases

CASES = {
    "no spin": {"speed": 2.0},
    "backspin, comes back": {"speed": 1.0, "spin": -60.0},
    "topspin": {"speed": 1.0, "spin": 50.0},
    "backwards": {"speed": -2.0, "spin": 5.0, "inertia_ratio": 0.5},
    "rolls": {"speed": 1.0, "spin": 10.0},
    "a hoop": {"speed": 2.0, "inertia_ratio": 1.0},
}
BALL = {"radius": 0.1, "friction": 0.3}
QUANTITIES = ("position", "velocity", "angle", "spin")


def solve_by_events(times, *, radius, friction, speed, spin=0.0, inertia_ratio=0.4):
    """Positions, velocities, angles and spins by the balances of Newton and Euler, for 1 kg."""

    def moving(sense):
        push = -sense * friction * 9.81
        turn = -radius * push / (inertia_ratio * radius**2)
        return (
            lambda y: np.array([y[1], push, y[3], turn]),
            lambda y: sense * (y[1] - radius * y[3]) if sense else 1.0,
            lambda y: (moving(0), y),
        )

    slip = speed - radius * spin
    start = np.sign(slip) if abs(slip) > 1e-12 else 0
    return solve_phases(moving(start), [0.0, speed, 0.0, spin], times)


def largest_difference(times, closed, **case):
    """Largest difference [m, m/s] from the event solver, with angles and spins times the radius."""
    found = np.stack([closed[name] for name in QUANTITIES], axis=-1)
    return np.abs((found - solve_by_events(times, **case)) * [1, 1, 0.1, 0.1]).max()


@pytest.mark.parametrize("name", CASES)
def test_an_event_solver_agrees_and_wrong_parameters_differ(name):
    case, times = BALL | CASES[name], np.linspace(0.0, 2.0, 101)
    assert (
        largest_difference(times, rolling_ball.solve(times, **case), **case) < 2e-12
    )  # error of the solver
    for wrong in ("friction", "speed", "inertia_ratio"):
        if name == "rolls" and wrong != "speed":
            continue  # friction and inertia have no effect without slip
        other = {**case, wrong: case.get(wrong, 0.4) + 1e-4}
        assert largest_difference(times, rolling_ball.solve(times, **other), **case) > 1e-6, wrong


@pytest.mark.parametrize("name", CASES)
def test_angular_momentum_about_the_floor_is_kept_and_energy_never_grows(name):
    case, times = BALL | CASES[name], np.linspace(0.0, 2.0, 201)
    at = rolling_ball.solve(times, **case)
    k, r = case.get("inertia_ratio", 0.4), 0.1
    moment = r * at["velocity"] + k * r**2 * at["spin"]  # about a point of the floor, 1 kg
    np.testing.assert_allclose(moment, moment[0], atol=1e-15, rtol=0)
    energy = at["velocity"] ** 2 + k * r**2 * at["spin"] ** 2
    assert (np.diff(energy) <= 1e-14).all()
    np.testing.assert_allclose(at["slip"], at["velocity"] - r * at["spin"], atol=1e-14, rtol=0)
    assert abs(at["slip"][-1]) < 1e-15  # the ball rolls
    assert (at["slip"] * at["slip"][0] >= 0).all()


def test_a_sphere_rolls_at_five_sevenths_of_its_speed_and_limits_hold():
    """A solid sphere rolls at 5/7 of its sliding speed, or stops if its backspin was v/(k r).

    Without friction neither speed nor spin changes.
    """
    late = rolling_ball.solve(9.0, **BALL, speed=7.0)
    assert late["velocity"] == pytest.approx(5.0, rel=1e-15, abs=0)
    stop = rolling_ball.solve(9.0, **BALL, speed=2.0, spin=-50.0)  # v = -k r spin
    assert stop["velocity"] == pytest.approx(0.0, abs=1e-15)
    free = rolling_ball.solve(2.0, radius=0.1, friction=0.0, speed=3.0, spin=1.0)
    assert (free["position"], free["spin"]) == (6.0, 1.0)
    assert rolling_ball.properties(radius=0.1, friction=0.0, speed=3.0) == {"rolls": "never"}


@pytest.mark.parametrize(
    "wrong", [{"radius": 0.0}, {"friction": -1.0}, {"inertia_ratio": 0.0}, {"spin": np.inf}]
)
def test_invalid_parameters_of_the_creep_are_refused(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        rolling_ball.solve(0.0, **{**BALL, "speed": 1.0, **wrong})
