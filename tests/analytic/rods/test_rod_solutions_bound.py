"""Completeness of the equilibria of 3RFR and 3PFR: the bound of loads, and loads beyond 20."""

import pickle
from functools import cache

import numpy as np
import pytest

from proofmass.analytic.rods import all_equilibria
from proofmass.analytic.rods.all_equilibria import (
    MAX_LATTICE_ALPHA,
    MIN_DRAWN_ALPHA,
    alpha_limits,
    bending_allowance,
    bound_by_boxes,
    bound_by_pose,
    draw_starts,
    first_boxes,
    solutions,
    solve_starts,
    theoretical_bound,
    tight_poses,
    with_best_motions,
)
from proofmass.analytic.rods.assembly import assembly
from proofmass.analytic.rods.elastica import rods_of_chart
from proofmass.analytic.rods.equilibrium import clamps_and_forces, state
from tests.analytic.rods.rod_galerkin import solve as by_galerkin
from tests.analytic.rods.rod_solutions_cases import EI, find_solutions, make_problem

COUNTS = [("rfr3", 1, 5, 4, 9), ("rfr3", 2, 10, 57, 9), ("pfr3", 1, 3, 0, 3), ("pfr3", 2, 56, 1, 3)]


@pytest.fixture
def random():
    return np.random.default_rng(7)


@cache
def solve_drawn_starts(name, modes):
    """alpha and q (k, 2, n) to which drawn starts lead, from `MIN_DRAWN_ALPHA` to the bound."""
    a, arguments = make_problem(name)
    s = state(a, **arguments)
    most = find_solutions(name, modes).bound
    chart = solve_starts(s, *draw_starts(s, [modes] * a.rods, MIN_DRAWN_ALPHA, most))[0]
    kept = (rods_of_chart(chart[:, 0], chart[:, 1]).waves < modes).all(axis=0)
    return chart[..., kept & (chart[:, 0].max(axis=0) > MIN_DRAWN_ALPHA)]


@pytest.mark.parametrize(
    ("name", "modes", "below", "beyond", "stable"),
    [pytest.param(*row, marks=[pytest.mark.slow] if row[1] == 2 else []) for row in COUNTS],
)
def test_counts_are_those_up_to_the_proven_bound(name, modes, below, beyond, stable):
    """The search goes to the proven bound and finds the known numbers of equilibria.

    These are the numbers below alpha = 20, beyond it, and of stable ones.
    """
    f = find_solutions(name, modes)
    assert f.is_bounded
    assert f.up_to == f.bound < np.inf
    heavy = f.alpha.max(axis=1) > MAX_LATTICE_ALPHA
    assert ((~heavy).sum(), heavy.sum(), (f.negative == 0).sum()) == (below, beyond, stable)
    assert f.alpha.max() < f.bound


def test_a_search_reports_its_limit_and_the_bound():
    """A search up to alpha = 26 reports this limit, and the bound of all loads."""
    a, arguments = make_problem("rfr3")
    f = solutions(a, most_load=26.0, poses=300, **arguments)
    assert (len(f), f.up_to, f.is_bounded) == (8, 26.0, False)
    np.testing.assert_allclose(  # alpha by the loads of the state
        f.alpha, np.sqrt(np.linalg.norm(f.state.force, axis=-1) / EI), rtol=1e-12
    )
    assert (
        f.bound == find_solutions("rfr3", 1).bound
    )  # the whole bound, although the search ended before


@pytest.mark.parametrize("name", ["rfr2", "rfr3", "pfr3"])
def test_a_bound_up_to_a_limit_agrees_with_the_whole_bound(name):
    """A bound that is computed up to a limit is the whole bound if this is below the limit.

    Otherwise both are above the limit.
    """
    a, arguments = make_problem(name)
    s = state(a, **arguments)
    whole = theoretical_bound(s, [1] * a.rods)
    for enough in whole * np.array([0.5, 0.99, 1.01]):
        assert min(enough, theoretical_bound(s, [1] * a.rods, enough)) == min(enough, whole)


@pytest.mark.parametrize("most", [15.0, 20.0])
def test_a_search_goes_to_its_largest_load_or_to_the_bound(most):
    """The bound of this case is between 15 and 20."""
    a, arguments = make_problem("pfr3")
    f = solutions(a, most_load=most, poses=30, **arguments)
    assert f.up_to == min(most, find_solutions("pfr3", 1).bound)
    assert f.is_bounded == (most > 18.2)


def test_a_limit_below_the_bound_takes_a_tenth_of_its_work(monkeypatch):
    """To find that the bound exceeds a load takes less than a tenth of the boxes of the bound."""
    a, arguments = make_problem("rfr3")
    work = []
    monkeypatch.setattr(
        all_equilibria,
        "with_best_motions",
        lambda s, boxes: work.append(boxes.phi.size) or with_best_motions(s, boxes),
    )
    s = state(a, **arguments)
    assert bound_by_boxes(s, [1] * 3, MAX_LATTICE_ALPHA) == np.inf
    part = sum(work)
    assert MAX_LATTICE_ALPHA < bound_by_boxes(s, [1] * 3) < np.inf
    assert sum(work) > 10 * part


@pytest.mark.parametrize(
    ("name", "modes", "degree"),
    [
        ("rfr3", 1, 170),
        ("rfr3", 1, 230),
        *(pytest.param(name, 2, 60, marks=pytest.mark.slow) for name in ("rfr3", "pfr3")),
    ],
)
def test_galerkins_method_finds_the_equilibria_under_large_loads(name, modes, degree):
    """Galerkin's method has the loads, poses and stability of all equilibria beyond alpha = 20.

    It uses no elliptic functions.  Its polynomials converge like exp(-pi degree/(2 alpha)), and
    errors of energies like the square of that.
    """
    f = find_solutions(name, modes)
    heavy = np.flatnonzero(f.alpha.max(axis=1) > MAX_LATTICE_ALPHA)
    assert heavy.size
    for i in heavy:
        order = degree + 6 * int(f.alpha[i].max()) * (modes > 1)
        pose, force, residual, negative = by_galerkin(f, i, order)
        assert residual < 1e-9  # N m, N, m; loads are up to 250 N
        np.testing.assert_allclose(pose, f.state.pose[i], rtol=0, atol=1e-9)
        np.testing.assert_allclose(force, f.state.force[i], rtol=0, atol=1e-9 * np.abs(force).max())
        if f.modes[i].max() == 1 or f.alpha[i].max() < 40.0:
            assert negative == f.negative[i]
        else:  # a stiffness of e^-2K of the load, K about alpha/3, is less than rounding
            assert negative <= f.negative[i]


@pytest.mark.parametrize(
    ("name", "modes"),
    [
        ("rfr3", 1),
        pytest.param("rfr3", 2, marks=pytest.mark.slow),
        pytest.param("pfr3", 2, marks=pytest.mark.slow),
    ],
)
def test_drawn_starts_find_each_equilibrium_ten_times_and_no_other(name, modes):
    """Drawn starts lead to each equilibrium beyond alpha = 12 ten times or more, and to no other.

    Up to alpha = 20 these are found from the lattice as well.
    """
    chart, f = solve_drawn_starts(name, modes), find_solutions(name, modes)
    known = f.alpha[f.alpha.max(axis=1) > MIN_DRAWN_ALPHA]
    off = np.abs(chart[:, 0].T[:, None] - known).max(axis=-1)
    assert off.min(axis=1).max() < 1e-6  # alpha up to 100, last step of Newton's method
    hits = np.bincount(off.argmin(axis=1), minlength=len(known))
    assert hits.min() >= 10, hits


@pytest.mark.slow
@pytest.mark.parametrize(("name", "modes", "below", "beyond", "stable"), COUNTS)
def test_more_starts_with_another_seed_find_as_many_equilibria(
    name, modes, below, beyond, stable, monkeypatch
):
    """Ten times as many starts with another seed find as many equilibria."""
    a, arguments = make_problem(name)
    monkeypatch.setattr(all_equilibria, "STARTS_PER_CHOICE", 10 * all_equilibria.STARTS_PER_CHOICE)
    monkeypatch.setattr(all_equilibria, "MIN_STARTS", 10 * all_equilibria.MIN_STARTS)
    monkeypatch.setattr(all_equilibria, "SEED", 2)
    f = solutions(a, modes=modes, **arguments)
    assert (len(f), (f.negative == 0).sum()) == (below + beyond, stable)


@pytest.mark.parametrize("name", ["rfr2", "rfr3", "pfr3"])
def test_the_inequality_behind_the_bound_holds_for_every_motion(name, random):
    """The inequality of the proof holds for all known equilibria and random motions (v, w)."""
    f = find_solutions(name, 1)
    a, (_, clamp, _) = f.state.assembly, clamps_and_forces(f.state)
    pose = np.column_stack([f.state.pose, np.zeros((len(f), 3 - a.dof))])
    arm = np.exp(1j * pose[:, 2:]) * a.arm
    away = pose[:, :1] + 1j * pose[:, 1:2] + arm - clamp
    bending = f.alpha * bending_allowance(f.alpha, 1)
    load = np.append(f.state.load[0], 0.0)[:3]
    tightest = np.inf
    for motion in random.normal(0.0, 0.3, (300, 3)):
        slack = 1.0 - np.abs(away - motion[0] - 1j * motion[1] - 1j * motion[2] * arm) / a.length
        left = (a.stiffness / a.length * (f.alpha**2 * slack - bending)).sum(axis=1)
        tightest = min(tightest, (motion @ load - left).min())
    assert tightest > 0.0


@pytest.mark.parametrize("name", ["rfr3", "pfr3"])
def test_the_limit_of_a_box_holds_for_the_poses_in_it(name, random):
    """No pose in a box has a higher limit of alpha than the box, for the same motion."""
    a, arguments = make_problem(name)
    s = state(a, **arguments)
    boxes = with_best_motions(s, first_boxes(s).halve(flat=False))
    whole = alpha_limits(s, boxes, [1] * 3)[0]
    bounded = np.isfinite(whole)
    assert bounded.sum() > 100
    inside = 0
    for part in random.uniform(-1.0, 1.0, (12, 3, bounded.sum())):
        own = boxes[bounded]
        there = type(own)(
            own.where + own.half * (part[0] + 1j * part[1]),
            own.phi + own.turn * part[2],
            0.0,
            0.0,
            own.motion,
        )
        alone, reached = alpha_limits(s, there, [1] * 3)
        inside += reached.sum()
        assert np.all(alone[reached] <= whole[bounded][reached] * (1.0 + 1e-12))
    assert inside > 1000


def test_two_bounds_of_rods_on_a_pin_agree():
    """The bound by boxes is within 10 % of the bound by one pose."""
    a, arguments = make_problem("rfr2")
    for modes in (1, 2, 3):
        quick = bound_by_pose(state(a, **arguments), [modes] * 2)
        # it is larger by up to a tenth by its construction, and smaller since motions are chosen
        assert 0.9 * quick < bound_by_boxes(state(a, **arguments), [modes] * 2) < 1.1 * quick


def test_rods_that_are_tight_against_each_other_have_no_bound():
    """Two rods of 1 m with clamps 2 m apart have no bound, with clamps 1.8 m apart they have."""
    a = assembly([[-1.0, 0.0], [1.0, 0.0]], stiffness=EI)
    assert bound_by_boxes(state(a), [1, 1]) == bound_by_pose(state(a), [1, 1]) == np.inf
    near = assembly([[-0.9, 0.0], [0.9, 0.0]], stiffness=EI)
    # with equal loads both rods are shorter than 2 m by 4/alpha each, together 0.2 m
    assert 40.0 < bound_by_boxes(state(near), [1, 1]) < 1.1 * (1.0 + np.sqrt(2.0)) * 20.0 * 1.01


def test_boxes_for_starts_contain_all_poses_of_equilibria():
    """The boxes in which starts are drawn contain all poses of equilibria with large loads."""
    f = find_solutions("rfr3", 1)
    boxes = tight_poses(f.state[0], [1] * 3, MAX_LATTICE_ALPHA, 0.05)
    for x, y, phi in f.state.pose[f.alpha.max(axis=1) > MAX_LATTICE_ALPHA]:
        off = boxes.where - x - 1j * y
        turn = (boxes.phi - phi + np.pi) % (2.0 * np.pi) - np.pi
        assert np.any(
            (np.abs(off.real) <= boxes.half)
            & (np.abs(off.imag) <= boxes.half)
            & (np.abs(turn) <= boxes.turn)
        )


def test_pickled_solutions_keep_their_bound():
    """Pickled solutions have the same bound and the same loads."""
    a, arguments = make_problem("rfr2")
    f = solutions(a, modes=1, most_load=5.0, **arguments)
    there = pickle.loads(pickle.dumps(f))
    assert there.bound == f.bound == theoretical_bound(state(a, **arguments), [1] * a.rods)
    assert np.array_equal(there.alpha, f.alpha)
