"""The row of balls against an event solver, stiff springs, and the laws of momentum and energy."""

import numpy as np
import pytest

from proofmass.analytic.contacts import ball_row
from tests.analytic.contacts.events import solve_phases

ROW = {"balls": 5, "radius": 0.02, "gap": 0.01, "speed": 1.0}


def stack_states(closed, balls):
    names = range(1, balls + 1)
    return np.stack([closed[f"{part}{k}"] for part in "xv" for k in names], axis=-1)


def solve_by_events(times, *, balls, radius, gap, speed, restitution=1.0):
    """States of the motion by a solver that stops where two balls meet.

    The velocities after an impact are computed in the frame of the pair's centre of mass.
    """

    def moving(touched=None):
        def rooms(y):
            distances = np.diff(y[:balls]) - 2 * radius
            closing = -np.diff(y[balls:])
            # a pair that has just collided, or separates, has no event ahead: its distance is 1
            return np.where(closing > 1e-12, distances, 1.0)

        def after(y):
            k = int(np.argmin(rooms(y)))
            mean = 0.5 * (y[balls + k] + y[balls + k + 1])
            new = y.copy()
            new[balls + k : balls + k + 2] = mean - restitution * (
                y[balls + k : balls + k + 2] - mean
            )
            return moving(k), new

        return (
            lambda y: np.append(y[balls:], np.zeros(balls)),
            lambda y: rooms(y).min(),
            after,
        )

    start = [*((2 * radius + gap) * np.arange(balls)), speed, *([0.0] * (balls - 1))]
    return solve_phases(moving(), start, times)


@pytest.mark.parametrize(
    "change", [{}, {"restitution": 0.9}, {"restitution": 0.5, "balls": 3}, {"balls": 2}]
)
def test_an_event_solver_agrees_and_wrong_parameters_differ(change):
    case, times = ROW | change, np.linspace(0.0, 0.2013, 41)  # no sample is at an impact
    reference = solve_by_events(times, **case)
    found = stack_states(ball_row.solve(times, **case), case["balls"])
    assert np.abs(found - reference).max() < 1e-11  # error of the event solver
    for wrong in ("gap", "radius"):
        other = stack_states(
            ball_row.solve(times, **{**case, wrong: case[wrong] * 1.01}), case["balls"]
        )
        assert np.abs(other - reference).max() > 1e-5
    other = {**case, "restitution": case.get("restitution", 1.0) - 1e-3}
    assert (
        np.abs(stack_states(ball_row.solve(times, **other), case["balls"]) - reference).max() > 1e-5
    )


@pytest.mark.parametrize("restitution", [1.0, 0.9, 0.6])
def test_momentum_and_order_are_kept_and_energy_never_grows(restitution):
    times = np.linspace(0.0, 1.0, 1001)
    at = ball_row.solve(times, **ROW, restitution=restitution)
    x, v = (np.stack([at[f"{part}{k}"] for k in range(1, 6)], axis=-1) for part in "xv")
    np.testing.assert_allclose(v.sum(-1), 1.0, rtol=1e-14)
    np.testing.assert_allclose(x.sum(-1) - x[0].sum(), times, atol=1e-13, rtol=0)
    assert (np.diff(x, axis=-1) >= 0.04 - 1e-14).all()
    energy = (v**2).sum(-1)
    assert (np.diff(energy) <= 1e-14).all()
    if restitution == 1.0:
        np.testing.assert_allclose(energy, 1.0, rtol=1e-14)


def test_stiff_springs_between_balls_with_gaps_lead_to_the_same_velocities():
    """Springs of 1e8 N/m between balls of 1 kg give elastic impacts that do not overlap in time.

    A contact lasts pi sqrt(m/(2 k)) = 2.2e-4 s, 2 % of the 0.01 s between two impacts.
    """
    from scipy.integrate import solve_ivp

    def rates(t, y):
        press = np.maximum(0.04 - np.diff(y[:3]), 0.0) * 1e8
        return np.append(y[3:], [-press[0], press[0] - press[1], press[1]])

    start = [0.0, 0.05, 0.1, 1.0, 0.0, 0.0]
    end = solve_ivp(rates, (0.0, 0.05), start, "DOP853", rtol=1e-11, atol=1e-13, max_step=2e-5)
    at = ball_row.solve(0.05, balls=3, radius=0.02, gap=0.01, speed=1.0)
    np.testing.assert_allclose(end.y[3:, -1], [at["v1"], at["v2"], at["v3"]], atol=1e-6)


def test_touching_balls_are_the_limit_of_small_gaps():
    touching = ball_row.solve(0.1, **{**ROW, "gap": 0.0})
    near = ball_row.solve(0.1, **{**ROW, "gap": 1e-9})
    for name in ("x1", "x5", "v1", "v4", "v5"):
        assert touching[name] == pytest.approx(near[name], abs=1e-8)
    assert (touching["v5"], touching["v1"]) == (1.0, 0.0)


def test_a_sample_at_an_impact_has_the_speeds_after_it():
    """The sample at an impact has the velocities after it, with and without later samples.

    A distance of 1/4 m is covered at 1 m/s in 1/4 s, without rounding errors.
    """
    for times in ([0.0, 0.25], [0.0, 0.25, 0.3]):
        at = ball_row.solve(times, balls=2, radius=0.5, gap=0.25, speed=1.0)
        assert (at["v1"][1], at["v2"][1], at["impacts"][1]) == (0.0, 1.0, 1.0)
        assert (at["v1"][0], at["x1"][1], at["x2"][1]) == (1.0, 0.25, 1.25)


@pytest.mark.parametrize(
    "wrong",
    [
        {"balls": 1},
        {"balls": 2.5},
        {"gap": -1.0},
        {"speed": 0.0},
        {"radius": 0.0},
        {"restitution": 1.5},
        {"gap": 0.0, "restitution": 0.5},
    ],
)
def test_invalid_parameters_of_the_creep_are_refused(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        ball_row.solve(1.0, **{**ROW, **wrong})


def test_balls_that_hit_each_other_without_end_are_an_error():
    """Inelastic collapse occurs in rows of about three balls or more at a low restitution."""
    with pytest.raises(ValueError, match="more than 10000 times"):
        ball_row.solve(10.0, balls=8, radius=0.02, gap=0.01, speed=1.0, restitution=0.3)
