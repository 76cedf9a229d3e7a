"""Equilibria of a mechanism of two slides by hand: a spring, a stop, and a control that rises."""

import numpy as np
import pytest

from proofmass.analytic.equilibrium import EquilibriumSolver
from proofmass.analytic.stops import Stop

SIZE, STIFFNESS = 2.0, 4.0  # m, N/m


class SpringBetweenSlides:
    """A driven slide, and another one that a spring ties to it and a control [N] pushes."""

    sizes = np.array([SIZE, SIZE])
    driven = np.array([0])
    stops = (Stop("b", 1, 1, 0.5, 1.0, 0.0, SIZE),)

    def begin(self, values):
        return np.array([values[0], 0.0])

    def moved(self, q, moves):
        return q + moves

    def pushed(self, q, ctrl):
        pull = STIFFNESS * (q[:, 0] - q[:, 1])
        push = 0.0 if ctrl is None else ctrl[:, 0]
        force = np.column_stack([-pull, pull + push])
        return force, np.zeros((len(q), 0, 2)), np.zeros((len(q), 0))

    def values(self, q):
        return q[:, :1]


@pytest.mark.parametrize(("pull", "kept"), [(1e-13, True), (1e-11, False)])
def test_a_stop_is_left_if_it_pulls_by_more_than_rounding(pull, kept):
    """The largest force is 1 N; the stop is at the upper end, so that its own push is negative."""
    solver, (stop,) = EquilibriumSolver(SpringBetweenSlides()), SpringBetweenSlides.stops
    found = solver.switched(np.array([0.0, 0.5]), np.array([1.0, pull]), (stop,))
    assert (found == (stop,)) == kept


def test_rates_and_forces_of_stops_are_those_of_a_spring_by_hand():
    """The free slide is at a + F / k, with a = t and F = 2 t, until it meets its stop at 0.5 m.

    There the stop pushes back with what is left of the force, k (0.5 - a) - F.
    """
    t = np.linspace(0.0, 1.0, 11)
    drive, push = t[:, None], 2.0 * t[:, None]
    ones = np.ones_like(drive)
    solver = EquilibriumSolver(SpringBetweenSlides())
    q, stops = solver.follow(drive, push)
    free = t + 2.0 * t / STIFFNESS
    assert q[:, 1] == pytest.approx(np.minimum(free, 0.5), abs=1e-12)  # rounding
    rates, forces = solver.beside(q, stops, drive, ones, push, 2.0 * ones)
    rests = free > 0.5
    assert [bool(held) for held in stops] == rests.tolist()
    assert rates[:, 0] == pytest.approx(1.0)
    assert rates[:, 1] == pytest.approx(np.where(rests, 0.0, 1.5), abs=1e-9)  # by differences
    on_stop = STIFFNESS * (0.5 - t) - 2.0 * t
    assert forces[:, 1] == pytest.approx(np.where(rests, on_stop, 0.0), abs=1e-9)
