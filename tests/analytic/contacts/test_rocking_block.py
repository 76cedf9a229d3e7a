"""Housner's rocking block against an event solver and the angular momentum of its points."""

import numpy as np
import pytest

from proofmass.analytic.contacts import rocking_block
from tests.analytic.contacts.events import solve_phases

CASES = {
    "slender": {"width": 0.1, "height": 0.4, "tilt": 0.15},
    "the other way": {"width": 0.1, "height": 0.4, "tilt": -0.05},
    "nearly over": {"width": 0.1, "height": 0.5, "tilt": 0.197},
    "squat": {"width": 0.3, "height": 0.4, "tilt": 0.3},
}
GRAVITY = 9.81


def rate_after(rate, width, height, side):
    """Rate after an impact, from the angular momentum of a grid of points about the new corner."""
    x, y = (part.ravel() for part in np.meshgrid(*[np.linspace(-0.5, 0.5, 402)[:-1]] * 2))
    x, y = width * (x + 0.5 / 401), height * (y + 0.5 / 401) + 0.5 * height
    old, new = -side * 0.5 * width, side * 0.5 * width
    v_x, v_y = -rate * y, rate * (x - old)
    moment = ((x - new) * v_y - y * v_x).mean()
    return moment / ((x - new) ** 2 + y**2).mean()


def solve_by_events(times, *, width, height, tilt):
    """Angles and rates by a solver that stops at each impact."""

    def turning(side):
        inertia = (width**2 + height**2) / 3.0  # about the corner, of 1 kg

        def rates(y):
            lean = side * y[0]
            arm = 0.5 * width * np.cos(lean) - 0.5 * height * np.sin(lean)
            return np.array([y[1], -side * GRAVITY * arm / inertia])

        def after(y):
            return turning(-side), [0.0, rate_after(y[1], width, height, side)]

        # 1 while the block moves away from its base, since one long step may cover a half cycle
        return rates, lambda y: side * y[0] if side * y[1] < 0 else 1.0, after

    return solve_phases(turning(np.sign(tilt)), [tilt, 0.0], times)


def largest_difference(times, closed, **case):
    """Largest difference [rad, rad/s] between a closed form and the event solver."""
    found = np.stack([closed["angle"], closed["rate"]], axis=-1)
    return np.abs(found - solve_by_events(times, **case)).max()


@pytest.mark.parametrize("name", CASES)
def test_an_event_solver_agrees_and_wrong_parameters_differ(name, monkeypatch):
    case = CASES[name]
    times = np.linspace(0.0, 2.2 * rocking_block.time_to_impact(**case), 91)  # two impacts
    # the second moments of the grid differ from those of the block by a share of 1 / 401^2
    assert largest_difference(times, rocking_block.solve(times, **case), **case) < 3e-5
    before = times[times < rocking_block.time_to_impact(**case)]
    assert largest_difference(before, rocking_block.solve(before, **case), **case) < 1e-11
    for wrong in ("width", "tilt"):
        other = rocking_block.solve(times, **{**case, wrong: case[wrong] * 1.001})
        assert largest_difference(times, other, **case) > 1e-4, wrong
    own = rocking_block.rate_ratio(width=case["width"], height=case["height"])
    monkeypatch.setattr(rocking_block, "rate_ratio", lambda **_: own - 1e-3)
    assert largest_difference(times, rocking_block.solve(times, **case), **case) > 1e-4


@pytest.mark.parametrize("name", CASES)
def test_energy_is_constant_between_impacts_and_falls_by_the_known_share(name):
    case, times = CASES[name], np.linspace(0.0, 1.5, 1501)
    at = rocking_block.solve(times, **case)
    inertia = (case["width"] ** 2 + case["height"] ** 2) / 3.0
    rest = 0.5 * case["height"]
    energy = 0.5 * inertia * at["rate"] ** 2 + GRAVITY * (at["centre_height"] - rest)
    kept = rocking_block.rate_ratio(width=case["width"], height=case["height"]) ** 2
    left, moves = energy[0] * kept ** at["impacts"], at["rate"] != 0.0
    moves[0] = True
    np.testing.assert_allclose(energy[moves], left[moves], rtol=1e-12, atol=1e-12 * energy[0])
    assert (left[~moves] < 1e-8 * energy[0]).all()  # the block rests
    # the centre moves on a circle around the corner on which the block stands
    corner = -np.sign(at["angle"]) * 0.5 * case["width"]
    half = 0.5 * np.hypot(case["width"], case["height"])
    away = np.hypot(at["centre_x"] - corner, at["centre_height"])
    np.testing.assert_allclose(away[at["angle"] != 0], half, rtol=1e-14)


def test_small_amplitudes_fall_like_a_bouncing_ball():
    """A block with a small amplitude A reaches its base after (2 A / (p^2 sin alpha))^.5.

    Then theta'' is nearly -p^2 sin(alpha), a constant like the acceleration of a falling ball.
    """
    width, height, small = 0.1, 0.4, 1e-7
    alpha = np.arctan(0.25)
    squared = 1.5 * GRAVITY / np.hypot(width, height)
    found = rocking_block.time_to_impact(width=width, height=height, tilt=small)
    assert found == pytest.approx(np.sqrt(2 * small / (squared * np.sin(alpha))), rel=1e-6)


@pytest.mark.parametrize("alpha", [0.5, 1e-3, 1e-6])
def test_angles_of_small_amplitudes_have_all_digits(alpha):
    """Against the power series in time of the angle y = alpha - theta, y'' = p^2 sin(y)."""
    width, height, tilt = np.tan(alpha), 1.0, 1e-7 * alpha
    squared = 1.5 * GRAVITY / np.hypot(width, height)
    end = rocking_block.time_to_impact(width=width, height=height, tilt=tilt)
    time = np.linspace(0.0, 0.999 * end, 50)
    found = rocking_block.solve(time, width=width, height=height, tilt=tilt)
    square, start = squared * time**2, np.arctan(width) - tilt
    turned = np.sin(start) * (square / 2.0 + np.cos(start) * square**2 / 24.0)
    # the next term is about the square of tilt/alpha; rounding of the time of impact
    np.testing.assert_allclose(found["angle"], tilt - turned, rtol=0, atol=2e-14 * tilt)


def test_a_block_comes_to_rest():
    late = rocking_block.solve([50.0, 60.0], width=0.1, height=0.4, tilt=0.1)
    for name in ("angle", "rate", "centre_x"):
        assert not late[name].any()
    assert late["centre_height"].tolist() == [0.2, 0.2]
    assert late["impacts"][0] > 50


@pytest.mark.parametrize(
    "wrong", [{"width": 0.6}, {"tilt": 0.3}, {"tilt": 0.0}, {"height": -1.0}, {"gravity": 0.0}]
)
def test_invalid_parameters_of_the_creep_are_refused(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        rocking_block.solve(0.0, **{"width": 0.1, "height": 0.4, "tilt": 0.1, **wrong})
