"""The search for designs: seeds, interruptions, bounds, descents, and designs of the thesis."""

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from docs.make.balancer_fronts import is_on_hull
from proofmass.analytic.balancer.synthesis import DesignMeasures, Synthesis, Variant
from proofmass.base.errors import InputError
from proofmass.base.front import nondominated_points
from proofmass.design.pareto import find_front, write_front
from proofmass.design.search import (
    EDGE_DISTANCE,
    MAX_DAMPING,
    Effort,
    SavedSearch,
    leave_edges,
    residual_norms,
    scatter_places,
    step_descents,
)

TINY_EFFORT = Effort(((12, 2), (4, 3)))
REGULAR_SINE = Synthesis(Variant("sine"), np.sin)


def test_the_same_seed_gives_the_same_design():
    once, twice, other = (
        SavedSearch(REGULAR_SINE, Effort(TINY_EFFORT.heats, seed)).run() for seed in (1, 1, 2)
    )
    assert np.array_equal(once, twice)
    assert not np.array_equal(once, other)


@dataclass(frozen=True)
class CutOff:
    """The square of the distance from 0, with other values where x + y < 0.5."""

    beyond: float  # added to all terms there
    low = np.zeros(2)
    high = np.ones(2)
    fingerprint = "cut off"

    def residuals(self, vectors):
        return vectors + np.where(vectors.sum(axis=-1) < 0.5, self.beyond, 0.0)[:, None]

    coarse = residuals


@pytest.mark.parametrize("beyond", [np.nan, 1.0], ids=["infeasible", "a jump"])
def test_a_design_keeps_a_distance_from_an_edge_that_it_would_lie_on(beyond):
    search = SavedSearch(CutOff(beyond), Effort(((64, 20), (16, 60))))
    x, y = search.run()
    # Changes of both coordinates by EDGE_DISTANCE do not lead over the edge, where x + y = 0.5.
    assert x + y > 0.5 + EDGE_DISTANCE
    # The shortest of the moves off the edge are a few EDGE_DISTANCE long.
    assert x + y < 0.5 + 30 * EDGE_DISTANCE
    assert search.state.values.min() == pytest.approx(np.hypot(x, y), abs=1e-12)


def test_a_design_between_two_edges_is_put_after_all_others():
    class Slit(CutOff):
        def residuals(self, vectors):
            x = vectors[:, :1]
            return np.where(
                np.abs(x - 0.3) < 0.1 * EDGE_DISTANCE, 0.0, np.where(x > 0.5, 1.0, np.nan)
            )

    places, values = leave_edges(
        np.array([[0.3, 0.5], [0.7, 0.5]]), np.array([0.0, 1.0]), Slit(0.0).residuals, 1
    )
    assert values.tolist() == [np.inf, 1.0]
    assert places.tolist() == [[0.3, 0.5], [0.7, 0.5]]


@pytest.mark.parametrize("after", [1, 2, 3])
def test_an_interrupted_search_has_the_result_of_an_uninterrupted_one(tmp_path, after):
    def interrupt(step, steps, value):
        if step == after:
            raise KeyboardInterrupt

    file = tmp_path / "search.npz"
    with pytest.raises(KeyboardInterrupt):
        SavedSearch(REGULAR_SINE, TINY_EFFORT, file).run(interrupt)
    again = SavedSearch(REGULAR_SINE, TINY_EFFORT, file)
    assert again.state.step == after
    assert np.array_equal(again.run(), SavedSearch(REGULAR_SINE, TINY_EFFORT).run())
    assert SavedSearch(REGULAR_SINE, TINY_EFFORT, file).done


def test_the_state_of_another_search_is_refused(tmp_path):
    file = tmp_path / "search.npz"
    SavedSearch(REGULAR_SINE, TINY_EFFORT, file).save()
    others = (
        Synthesis(Variant("sine", preload=(2,)), np.sin),
        Synthesis(Variant("sine"), np.cos),
        Synthesis(Variant("sine"), np.sin, power=1.0),
    )
    for other in others:
        with pytest.raises(InputError, match="state of another search"):
            SavedSearch(other, TINY_EFFORT, file)
    with pytest.raises(InputError, match="state of another search"):
        SavedSearch(REGULAR_SINE, Effort(TINY_EFFORT.heats, 2), file)
    file.write_text("no archive")
    with pytest.raises(InputError, match="not the state of a search"):
        SavedSearch(REGULAR_SINE, TINY_EFFORT, file)


def test_designs_stay_within_their_bounds_and_do_not_get_worse():
    search, worst = SavedSearch(REGULAR_SINE, TINY_EFFORT), np.inf
    while not search.done:
        search.state = search.step()
        for vector in search.vectors(search.state.places):
            assert (REGULAR_SINE.low <= vector).all()
            assert (vector <= REGULAR_SINE.high).all()
        if search.heat == 1:  # the heat before this one evaluates fewer points
            assert search.state.values.min() <= worst
            worst = search.state.values.min()
    assert search.state.values.min() == pytest.approx(
        REGULAR_SINE.figures(search.found[:1]).rmse[0]
    )


def test_a_search_from_given_designs_is_not_worse_than_these():
    first = SavedSearch(REGULAR_SINE, TINY_EFFORT)
    first.run()
    again = SavedSearch(REGULAR_SINE, Effort(((12, 1), (4, 1)), seed=2), start=first.found)
    assert len(again.state.places) == 12  # four are given, the others are random
    assert (
        REGULAR_SINE.figures(again.run()[None]).rmse[0]
        <= REGULAR_SINE.figures(first.found[:1]).rmse[0]
    )


def test_a_given_design_is_used_though_the_coarse_evaluation_refuses_it():
    class Narrow:
        low, high, fingerprint = np.zeros(2), np.ones(2), "narrow"

        def residuals(self, vectors):
            return np.where(vectors[:, :1] > 0.9, vectors - 1.0, vectors + 1.0)

        def coarse(self, vectors):
            return np.where(vectors[:, :1] > 0.9, np.nan, vectors)

    assert SavedSearch(Narrow(), TINY_EFFORT).run() == pytest.approx(
        [0.0, 0.0], abs=1e-6
    )  # the minimum in the other region
    given = np.array([[0.95, 0.5]])
    assert SavedSearch(Narrow(), TINY_EFFORT, start=given).run() == pytest.approx(
        [1.0, 1.0], abs=1e-6
    )


def test_bounds_that_exclude_every_design_are_refused():
    behind = Variant("sine", free_angle=True, narrowed={"rest_angle": (3.0, 3.1)})
    with pytest.raises(ValueError, match="none of 1200 random designs is possible"):
        SavedSearch(Synthesis(behind, np.sin), TINY_EFFORT)


@pytest.mark.slow
def test_a_search_of_ten_seconds_is_better_than_row_1766():
    task = Synthesis(Variant("sine", free_angle=True), np.sin)
    found = task.figures(SavedSearch(task, Effort(((64, 8), (16, 20)))).run()[None])
    assert found.rmse[0] < 0.0059  # printed for row 1766
    assert found.work_reduction[0] > 99.62  # the largest of all sine balancers of the thesis


def test_descents_solve_bounded_linear_least_squares():
    rng = np.random.default_rng(4)
    matrix, right = rng.normal(size=(9, 5)), rng.normal(size=9)
    truth = lsq_linear(matrix, right, (0.0, 1.0), tol=1e-14)
    assert (truth.active_mask != 0).any()

    def terms(places):
        return places @ matrix.T - right

    places = scatter_places(6, 5, rng)
    state = places, residual_norms(terms, places), np.full(6, 1e-2)
    for _ in range(60):
        state = step_descents(*state, terms)
    assert (state[2] > MAX_DAMPING).all()
    # descents end when a step gains less than 1e-7 of the value, so places have about its root
    assert state[0] == pytest.approx(np.tile(truth.x, (6, 1)), abs=1e-3)
    assert state[1] == pytest.approx(np.sqrt(2 * truth.cost), rel=1e-6)


def test_a_descent_does_not_enter_an_infeasible_region():
    def terms(places):
        return np.where(places[:, :1] < 0.3, np.nan, places)

    places = np.array([[0.9, 0.0], [0.1, 0.5]])
    state = places, residual_norms(terms, places), np.full(2, 1e-2)
    for _ in range(40):
        state = step_descents(*state, terms)
    assert 0.3 <= state[0][0, 0] < 0.301
    assert np.array_equal(state[0][1], places[1])  # the start of this descent is infeasible


def test_nondominated_points_meet_their_definition():
    aims = np.random.default_rng(2).integers(0, 12, (60, 2)).astype(float)
    beaten = [any((other <= own).all() and (other < own).any() for other in aims) for own in aims]
    kept = nondominated_points(aims)
    assert {tuple(aims[k]) for k in kept} == {
        tuple(a) for a, b in zip(aims, beaten, strict=True) if not b
    }
    assert (np.diff(aims[kept, 0]) > 0).all()


@dataclass(frozen=True)
class Hollow:
    """Fonseca and Fleming's two aims with a concave front: weighted sums find only its ends."""

    limit: float = np.inf
    low, high, fingerprint = -np.ones(2), np.ones(2), "hollow"

    def aims(self, x):
        """f_1, f_2 = 1 - exp(-|x -+ (1, 1)/sqrt 2|^2)."""
        return [1.0 - np.exp(-((x + s * 0.5**0.5) ** 2).sum(axis=-1)) for s in (-1.0, 1.0)]

    def residuals(self, x):
        error, spread = self.aims(x)
        return np.stack([error, 30.0 * np.maximum(spread - self.limit, 0.0)], axis=-1)

    coarse = residuals

    def figures(self, x):
        return DesignMeasures(self.aims(x)[0], 0.0 * x[:, 0], self.aims(x)[1])


def test_a_front_is_found_beyond_its_convex_part(monkeypatch):
    """On this front x1 = x2, which gives the spread for each error in closed form."""
    monkeypatch.setattr("proofmass.design.pareto.LIMIT_EFFORT", Effort(((8, 4), (4, 12))))
    best = SavedSearch(Hollow(), Effort(((16, 6), (4, 20)))).run()
    found = find_front(Hollow(), best[None], limits=6)
    inner = (found.rmse > 0.05) & (found.rmse < 0.95)
    assert inner.sum() >= 5
    distance = 2.0 - np.sqrt(-np.log1p(-found.rmse[inner]))
    # descents end when a step gains less than 1e-7
    assert found.spread[inner] == pytest.approx(1.0 - np.exp(-(distance**2)), abs=2e-3)
    ends = found.spread[[0, -1]]
    chord = np.interp(found.rmse[inner], found.rmse[[0, -1]], ends)
    assert (found.spread[inner] > chord + 0.02).all()  # no weighted sum has its minimum there
    assert is_on_hull(found.rmse, found.spread)[inner].sum() == 0


def test_points_of_the_lower_hull_are_found():
    x, y = np.array([0.0, 1.0, 2.0, 3.0, 4.0]), np.array([4.0, 1.0, 2.0, 0.2, 0.0])
    assert is_on_hull(x, y).tolist() == [True, True, False, True, True]


@pytest.mark.slow
def test_the_front_trades_error_for_spread(tmp_path, monkeypatch):
    monkeypatch.setattr("proofmass.design.pareto.LIMIT_EFFORT", TINY_EFFORT)
    best = SavedSearch(REGULAR_SINE, TINY_EFFORT).run()
    found = find_front(REGULAR_SINE, best[None], tmp_path, limits=2)
    assert found.rmse.size >= 2
    assert (np.diff(found.rmse) > 0).all()
    assert (np.diff(found.spread) < 0).all()
    again = find_front(REGULAR_SINE, best[None], tmp_path, limits=2)  # from the saved states
    assert np.array_equal(found.vectors, again.vectors)
    files = write_front(found, list(REGULAR_SINE.variant.usual), tmp_path / "pareto")
    assert all(file.stat().st_size > 0 for file in files)
    assert np.loadtxt(files[0], delimiter=",", skiprows=1).shape == (found.rmse.size, 9)
