"""Tests of engines that step freely from equilibria of 2RFR.

They stay in stable equilibria and leave the others.
"""

import copy

import numpy as np
import pytest

from docs.make.rod_settle import ENGINES, mujoco_rest, scene
from tests.analytic.rods.rod_solutions_cases import make_problem

# stable equilibria among those of modes up to 2, in the order of their energies: the natural one
# and three of modes 1
STABLE_EQUILIBRIA = [0, 1, 3, 8]
SOFTNESS_ERROR = (
    3e-4  # [rad] largest error of angles in MuJoCo, whose loops are soft; Chipmunk's are not
)


@pytest.fixture(scope="module")
def pair():
    """The pair of Table 7 of Pérez Gámiz 2018, in chains of ten links."""
    a, given = make_problem("rfr2")
    return scene(a, given, 2, 10)


def test_chains_have_the_equilibria_and_the_stability_of_rods(pair):
    """Chains near equilibria of rods have as many negative curvatures as these.

    The poses of engines are compared with these equilibria of chains.
    """
    assert np.flatnonzero(pair.found.negative == 0).tolist() == STABLE_EQUILIBRIA
    found_for_chain = ~np.isnan(pair.standing.energy)
    negative_curvatures = (pair.standing.curvatures < 0).sum(axis=-1)
    assert (
        negative_curvatures[found_for_chain].tolist()
        == pair.found.negative[found_for_chain].tolist()
    )
    assert found_for_chain[STABLE_EQUILIBRIA].all()
    assert found_for_chain.sum() > 10


def settled_equilibrium(engine, pair, k, seed=0):
    """Index of the stable equilibrium in which an engine settles from a nudged equilibrium k."""
    to, chain, error = pair.which(ENGINES[engine](pair, pair.nudged(k, seed)))
    assert chain.curvatures[0] > 0
    assert error < SOFTNESS_ERROR
    return to


@pytest.mark.parametrize("engine", ["mujoco", pytest.param("pymunk", marks=pytest.mark.slow)])
def test_engines_stay_in_stable_equilibria_and_leave_unstable_ones(engine, pair):
    for k in np.flatnonzero(~np.isnan(pair.standing.energy)):
        settled = settled_equilibrium(engine, pair, int(k))
        assert (settled == k) == (k in STABLE_EQUILIBRIA), k


@pytest.mark.parametrize(
    ("saddle", "side"),
    [
        (2, 1),
        *(pytest.param(*ways, marks=pytest.mark.slow) for ways in ((2, 0), (4, 0), (4, 3), (7, 1))),
    ],
)
def test_both_engines_leave_a_saddle_to_the_side_of_the_displacement(saddle, side, pair):
    """From a saddle, both engines settle in the equilibrium towards which the pair is displaced.

    The displacement is a tenth of the distance.  With a smaller one the inertia decides, which
    differs between the engines.
    """
    here, there = pair.standing.angle[[saddle, side]]
    qpos = pair.closed(pair.pose(here + 0.1 * (there - here), np.zeros(3)))
    assert [pair.which(rest(pair, qpos))[0] for rest in ENGINES.values()] == [side, side]


def test_random_shapes_end_in_stable_equilibria(pair):
    for seed in range(10):
        to, chain, error = pair.which(mujoco_rest(pair, pair.random(seed)))
        assert to in STABLE_EQUILIBRIA or to == -1
        assert chain.curvatures[0] > 0
        assert error < SOFTNESS_ERROR


def test_stiffer_springs_settle_at_other_angles(pair):
    """Mutation: with springs that are 5 % stiffer, links rest at other angles than the chain's."""
    changed = copy.copy(pair)
    changed.__dict__["weighed"] = model = copy.copy(pair.weighed)
    model.jnt_stiffness *= 1.05
    _, _, error = pair.which(mujoco_rest(changed, pair.nudged(1, 0)))
    assert error > 5 * SOFTNESS_ERROR


def test_random_starts_are_closed_and_far_apart(pair):
    shapes = np.array([pair.angles(pair.random(seed)) for seed in range(5)])
    place = pair.pose(pair.angles(pair.random(0)), np.zeros(3))
    np.testing.assert_allclose(place, pair.random(0), atol=1e-12, rtol=0)
    assert np.abs(shapes[:, None] - shapes).max(axis=(2, 3))[~np.eye(5, dtype=bool)].min() > 1.0
