"""Tests of engines that step freely from equilibria of 2RFR.

They stay in stable equilibria and leave the others.
"""

import copy

import numpy as np
import pytest

from benchmarks.rod_settle import ENGINES, mujoco_rest, scene
from tests.analytic.rods.rod_solutions_cases import made

# stable equilibria among those of modes up to 2, in the order of their energies: the natural one
# and three of modes 1
STABLE = [0, 1, 3, 8]
SOFT = 3e-4  # [rad] largest error of angles in MuJoCo, whose loops are soft; Chipmunk's are not


@pytest.fixture(scope="module")
def pair():
    """The pair of Table 7 of Pérez Gámiz 2018, in chains of ten links."""
    a, given = made("rfr2")
    return scene(a, given, 2, 10)


def test_chains_stand_where_rods_do(pair):
    """Chains near equilibria of rods have as many negative curvatures as these.

    The poses of engines are compared with these equilibria of chains.
    """
    assert np.flatnonzero(pair.found.negative == 0).tolist() == STABLE
    stands = ~np.isnan(pair.standing.energy)
    down = (pair.standing.curvatures < 0).sum(axis=-1)
    assert down[stands].tolist() == pair.found.negative[stands].tolist()
    assert stands[STABLE].all()
    assert stands.sum() > 10


def goes(engine, pair, k, seed=0):
    """Index of the stable equilibrium in which an engine settles from a nudged equilibrium k."""
    to, own, off = pair.which(ENGINES[engine](pair, pair.nudged(k, seed)))
    assert own.curvatures[0] > 0
    assert off < SOFT
    return to


@pytest.mark.parametrize("engine", ["mujoco", pytest.param("pymunk", marks=pytest.mark.slow)])
def test_stable_ones_stay_and_unstable_ones_leave(engine, pair):
    for k in np.flatnonzero(~np.isnan(pair.standing.energy)):
        there = goes(engine, pair, int(k))
        assert (there == k) == (k in STABLE), k


@pytest.mark.parametrize(
    ("saddle", "side"),
    [
        (2, 1),
        *(pytest.param(*ways, marks=pytest.mark.slow) for ways in ((2, 0), (4, 0), (4, 3), (7, 1))),
    ],
)
def test_both_engines_fall_to_the_side_that_they_are_pushed_to(saddle, side, pair):
    """From a saddle, both engines settle in the equilibrium towards which the pair is displaced.

    The displacement is a tenth of the distance.  With a smaller one the inertia decides, which
    differs between the engines.
    """
    here, there = pair.standing.angle[[saddle, side]]
    qpos = pair.closed(pair.pose(here + 0.1 * (there - here), np.zeros(3)))
    assert [pair.which(rest(pair, qpos))[0] for rest in ENGINES.values()] == [side, side]


def test_random_shapes_end_in_stable_equilibria(pair):
    for seed in range(10):
        to, own, off = pair.which(mujoco_rest(pair, pair.random(seed)))
        assert to in STABLE or to == -1
        assert own.curvatures[0] > 0
        assert off < SOFT


def test_another_spring_is_found_out(pair):
    """Mutation: with springs that are 5 % stiffer, links rest at other angles than the chain's."""
    changed = copy.copy(pair)
    changed.__dict__["weighed"] = model = copy.copy(pair.weighed)
    model.jnt_stiffness *= 1.05
    _, _, off = pair.which(mujoco_rest(changed, pair.nudged(1, 0)))
    assert off > 5 * SOFT


def test_starts_are_closed_and_far_apart(pair):
    shapes = np.array([pair.angles(pair.random(seed)) for seed in range(5)])
    place = pair.pose(pair.angles(pair.random(0)), np.zeros(3))
    np.testing.assert_allclose(place, pair.random(0), atol=1e-12, rtol=0)
    assert np.abs(shapes[:, None] - shapes).max(axis=(2, 3))[~np.eye(5, dtype=bool)].min() > 1.0
