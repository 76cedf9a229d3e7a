"""Stick and slip of chains of springs and sliders, compared with least energy and dissipation."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.optimize import minimize

from proofmass.analytic import friction
from proofmass.analytic.friction import (
    PathEnds,
    SlipProblem,
    follow_stick_slip,
    minimize_largest_share,
    share_friction,
)


class Sliders:
    """A row of springs from a driven end to a wall, with sliders with dry friction between them."""

    def __init__(self, springs, bounds):
        self.springs, self.bounds = np.asarray(springs, float), np.asarray(bounds, float)
        n = self.bounds.size
        stretch = np.eye(n + 1, n) - np.eye(n + 1, n, k=-1)  # of each spring by each slider
        self.stretch, self.pulled = -stretch, np.eye(n + 1)[0]
        self.place, self.drive = np.zeros(n), 0.0
        self.senses, self.is_at_start = np.zeros(n), True
        self.stiffness = self.stretch.T @ (self.springs[:, None] * self.stretch)
        self.coupling = self.stretch.T @ (self.springs * self.pulled)

    def at(self):
        return np.array([self.drive])

    def kept(self):
        return self.place, self.drive

    def back(self, kept):
        self.place, self.drive = kept

    def go(self, values):
        self.drive, slips = float(values[0]), self.senses != 0
        self.place = self.place.copy()
        held = self.coupling * self.drive + self.stiffness @ np.where(slips, 0.0, self.place)
        pull = -(held + self.senses * self.bounds)[slips]
        self.place[slips] = np.linalg.solve(self.stiffness[np.ix_(slips, slips)], pull)

    def problem(self, way):
        n = self.bounds.size
        force = self.coupling * self.drive + self.stiffness @ self.place
        return SlipProblem(
            force, self.stiffness, self.coupling * way[0], np.eye(n), np.zeros(n), self.bounds
        )

    def enter(self, senses):
        self.senses, self.is_at_start = senses, False

    def energy(self, place, drive):
        return 0.5 * self.springs @ (self.stretch @ place + self.pulled * drive) ** 2


def minimize_along_path(body, path, parts):
    """Positions of the sliders along a path of the drive, by minimization.

    In each of the parts of the path the sliders minimize their energy plus the dissipation since
    the part before.
    """
    place, found = np.zeros(body.bounds.size), [np.zeros(body.bounds.size)]
    for first, last in pairwise(path):
        for drive in np.linspace(first, last, parts + 1)[1:]:
            n, before = place.size, place

            def cost(ways, drive=drive, before=before, n=n):  # forwards and back
                here = before + ways[:n] - ways[n:]
                slope = body.coupling * drive + body.stiffness @ here
                return (
                    body.energy(here, drive) + np.tile(body.bounds, 2) @ ways,
                    np.tile(body.bounds, 2) + np.concatenate([slope, -slope]),
                )

            ways = minimize(
                cost,
                np.zeros(2 * n),
                jac=True,
                bounds=[(0, None)] * (2 * n),
                method="L-BFGS-B",
                options={"ftol": 1e-16, "gtol": 1e-12},
            ).x
            place = before + ways[:n] - ways[n:]
        found.append(place)
    return np.array(found)


def test_a_joint_that_sticks_at_its_dead_point_may_go_on_sticking():
    """No free motion turns the first joint; the second one comes to rest under a force of 0.5 N."""
    problem = SlipProblem(
        np.array([0.5]), np.eye(1), np.zeros(1), np.array([[0.0], [1.0]]), np.zeros(2), np.ones(2)
    )
    assert problem.choose(np.array([0.0, -1.0]), may_stay=False).tolist() == [0.0, 0.0]
    assert problem.choose(np.array([1.0, -1.0]), may_stay=False)[0] != 0.0


DRIVE_PATH = np.array([0.0, 1.0, 2.5, 1.5, -0.5, 0.3, 2.0])


@pytest.mark.parametrize(
    ("springs", "bounds"),
    [([1.0, 0.0], [0.5]), ([2.0, 1.0, 0.5], [0.7, 0.4]), ([3.0, 2.0, 1.0, 0.4], [0.4, 0.6, 0.3])],
)
def test_sliders_minimize_energy_plus_dissipation(springs, bounds):
    body, found = Sliders(springs, bounds), [np.zeros(len(bounds))]
    for drive in DRIVE_PATH[1:]:
        follow_stick_slip(body, np.array([drive]))
        found.append(body.place)
    # in a row of sliders the number of parts of a monotone path makes no difference; the accuracy
    # of the minimization is 1e-6
    np.testing.assert_allclose(found, minimize_along_path(body, DRIVE_PATH, 4), atol=2e-6)


def test_one_slider_is_the_play_operator():
    body = Sliders([2.0, 0.0], [0.5])
    for drive, place in ((0.2, 0.0), (1.0, 0.75), (0.6, 0.75), (0.2, 0.45)):
        follow_stick_slip(body, np.array([drive]))
        assert body.place[0] == pytest.approx(place, abs=1e-12)


def test_each_part_of_a_path_begins_with_the_margins_of_its_state(monkeypatch):
    body, parts, go_on = Sliders([3.0, 2.0, 1.0, 0.4], [0.4, 0.6, 0.3]), [], friction.go_to_event

    def checked(body, begin, way, done, above):
        np.testing.assert_array_equal(above, body.problem(way).margins(body.senses))
        parts.append(done)
        return go_on(body, begin, way, done, above)

    monkeypatch.setattr(friction, "go_to_event", checked)
    for drive in DRIVE_PATH[1:]:
        follow_stick_slip(body, np.array([drive]))
    assert sum(part > 0.0 for part in parts) > 3


def test_joints_that_hold_each_other_share_friction_evenly():
    held, bound = np.array([[1.0], [-2.0], [0.5]]), np.array([1.0, 2.0, 4.0])
    friction = share_friction(held, bound, np.array([3.5]))
    np.testing.assert_allclose(held.T @ friction, [3.5], rtol=1e-14)
    np.testing.assert_allclose(np.abs(friction) / bound, 0.5, rtol=1e-14)


def test_redundant_joints_share_friction_with_the_least_maximum():
    generator = np.random.default_rng(19)
    matrix, shares = generator.normal(size=(2, 4)), generator.normal(size=4)
    found = minimize_largest_share(matrix, shares)
    np.testing.assert_allclose(matrix @ found, matrix @ shares, atol=1e-14, rtol=0)
    # at a least maximum under two equations at least three of four joints have the largest share
    full = np.abs(found) > (1 - 1e-9) * np.abs(found).max()
    assert full.sum() >= 3
    bound = np.array([1.0, 2.0, 0.5, 3.0])
    forces = share_friction(
        matrix.T / bound[:, None], bound, matrix @ shares
    )  # shares of the bounds are the unknowns
    np.testing.assert_allclose(forces / bound, found, rtol=0, atol=1e-13)
    for other in np.linalg.svd(matrix)[2][2:]:
        for way in (1e-3, -1e-3):
            assert np.abs(found + way * other).max() > np.abs(found).max()


def test_a_joint_turns_back_where_only_a_stuck_joint_could_move_it():
    """At its dead point beside a stuck joint, a joint goes on with its friction reversed.

    Both joints move with the first free motion alone, and the second free motion goes on.
    """
    turn = np.array([[1.0, 0.0], [1.0, -1e-10]])
    problem = SlipProblem(
        np.array([0.2, 0.0]), np.eye(2), np.array([0.0, -1.0]), turn, np.zeros(2), np.array([3, 1])
    )
    assert problem.choose(np.array([0.0, 1.0]), False).tolist() == [0.0, -1.0]


def test_a_path_ends_where_no_state_of_stick_and_slip_exists():
    problem = SlipProblem(
        np.array([2.0]), np.eye(1), np.zeros(1), np.eye(1), np.zeros(1), np.array([1.0])
    )
    with pytest.raises(PathEnds, match="no combination of sticking and slipping"):
        problem.choose(np.zeros(1), True)
