"""The bouncing ball against an event solver, the energy after impacts, and limits."""

from fractions import Fraction

import numpy as np
import pytest

from proofmass.analytic.contacts import bouncing_ball
from tests.analytic.contacts.events import solve_phases

CASES = {
    "dropped": {"height": 1.0, "restitution": 0.8},
    "thrown up": {"height": 0.3, "speed": 2.0, "restitution": 0.7},
    "thrown down": {"height": 0.5, "speed": -3.0, "restitution": 0.9},
    "from the floor": {"height": 0.0, "speed": 3.0, "restitution": 0.75},
    "elastic": {"height": 1.0, "restitution": 1.0},
    "plastic": {"height": 1.0, "restitution": 0.0},
}
GRAVITY = 9.81


def solve_by_events(times, *, height, restitution, speed=0.0):
    """Heights and velocities by a solver that stops at each impact."""

    def flying():
        return (
            lambda y: np.array([y[1], -GRAVITY]),
            # 1 while the ball rises, since one long step may cover the whole flight
            lambda y: y[0] if y[1] < 0 else 1.0,
            lambda y: (
                (flying(), [0.0, -restitution * y[1]]) if restitution else (resting(), [0, 0])
            ),
        )

    def resting():
        return lambda y: np.zeros(2), lambda y: 1.0, None

    return solve_phases(flying(), [height, speed], times)


def largest_difference(times, closed, **case):
    """Largest difference [m, m/s] between a closed form and the event solver."""
    found = np.stack([closed["height"], closed["velocity"]], axis=-1)
    return np.abs(found - solve_by_events(times, **case)).max()


@pytest.mark.parametrize("name", CASES)
def test_an_event_solver_agrees_and_a_wrong_restitution_differs(name):
    case, times = CASES[name], np.linspace(0.0, 1.71, 98)
    assert (
        largest_difference(times, bouncing_ball.solve(times, **case), **case) < 1e-11
    )  # error of the solver
    change = {"elastic": -1e-4, "plastic": 1e-2}.get(name, 1e-4)
    wrong = bouncing_ball.solve(times, **{**case, "restitution": case["restitution"] + change})
    assert largest_difference(times, wrong, **case) > 1e-5


@pytest.mark.parametrize("name", CASES)
def test_each_impact_multiplies_energy_by_the_restitution_squared(name):
    """After each impact the energy is that before it times the square of the restitution."""
    case, times = CASES[name], np.linspace(0.0, 1.7, 3401)
    at = bouncing_ball.solve(times, **case)
    energy = 0.5 * at["velocity"] ** 2 + GRAVITY * at["height"]
    start = 0.5 * case.get("speed", 0.0) ** 2 + GRAVITY * case["height"]
    left = start * case["restitution"] ** (2.0 * at["bounces"])
    moving = at["acceleration"] < 0.0
    np.testing.assert_allclose(energy[moving], left[moving], rtol=1e-12, atol=1e-13)
    assert (at["height"] >= 0.0).all()
    assert (np.diff(at["bounces"]) >= 0).all()


def test_bounces_accumulate_and_the_ball_rests():
    case = CASES["dropped"]
    end = bouncing_ball.rest_time(**case)
    first = np.sqrt(2.0 / GRAVITY)
    flights = 2.0 * first * 0.8 ** np.arange(1, 300)
    assert end == pytest.approx(first + flights.sum(), rel=1e-14, abs=0)
    near = bouncing_ball.solve(end - np.logspace(-12, -1, 400), **case)
    # the time that is left is the sum of the flights to come, which limits the height
    assert (near["height"] <= GRAVITY * np.logspace(-12, -1, 400) ** 2).all()
    late = bouncing_ball.solve([end, 2 * end], **case)
    for name in ("height", "velocity", "acceleration"):
        assert not late[name].any()
    resting = bouncing_ball.solve([0.0, 1.0], height=0.0, restitution=1.0)
    for name in ("height", "velocity"):
        assert not resting[name].any()


def test_a_sample_at_an_impact_counts_it_and_has_the_velocity_after_it():
    """The sample at an impact counts this impact and has the velocity after it.

    The impacts are at 1, 2, 2.5, 2.75 and 2.875 s: sums of powers of two, without rounding errors.
    """
    times = np.array([1.0, 2.0, 2.5, 2.75, 2.875])
    at = bouncing_ball.solve(times, height=1.0, restitution=0.5, gravity=2.0)
    assert at["bounces"].tolist() == [1.0, 2.0, 3.0, 4.0, 5.0]
    assert at["velocity"].tolist() == [1.0, 0.5, 0.25, 0.125, 0.0625]
    assert not at["height"].any()


def test_impacts_are_at_the_sums_of_a_geometric_series():
    """The times of the impacts are the sums of a geometric series, to 1e-13 s."""
    times = np.sqrt(2.0 / GRAVITY) * np.cumsum([1.0, *(2.0 * 0.8 ** np.arange(1, 40))])
    for shift, count in ((-1e-13, np.arange(40)), (1e-13, np.arange(1, 41))):
        at = bouncing_ball.solve(times + shift, **CASES["dropped"])
        assert at["bounces"].tolist() == count.tolist()


@pytest.mark.parametrize("loss", [1e-3, 1e-8, 1e-12])
def test_times_of_impacts_have_all_digits_for_a_restitution_near_one(loss):
    """Impacts are at exact sums of fractions, to the relative error of 1e-15 that is stated.

    The first impact is after 1 s and the flights are e, e^2, .. times 2 s.
    """
    e = 1.0 - loss
    times = 1 + 2 * np.cumsum([Fraction(e) ** n for n in range(1, 13)])
    for shift, count in ((-1e-15, np.arange(1, 13)), (1e-15, np.arange(2, 14))):
        near = np.array([float(t * (1 + Fraction(shift))) for t in times])
        at = bouncing_ball.solve(near, height=1.0, restitution=e, gravity=2.0)
        assert at["bounces"].tolist() == count.tolist()


@pytest.mark.parametrize(
    "wrong", [{"height": -1.0}, {"restitution": 1.1}, {"gravity": 0.0}, {"speed": np.nan}]
)
def test_invalid_parameters_of_the_creep_are_refused(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        bouncing_ball.solve(0.0, **{**CASES["dropped"], **wrong})
