"""All equilibria of general assemblies of rods, against other formulations and limits."""

from dataclasses import replace

import numpy as np
import pytest

from docs.make.rod_assemblies import LIMITS, distance, random_assembly, shot_unknowns
from proofmass.analytic.rods.all_equilibria import solutions
from proofmass.analytic.rods.assembly import assembly
from proofmass.analytic.rods.assembly_chain import chain_equilibria, chain_shapes
from proofmass.analytic.rods.assembly_newton import RodProblem, bend_rods
from proofmass.analytic.rods.assembly_search import (
    SearchLimits,
    bent_guesses,
    describe_equilibria,
    find_equilibria,
    search_equilibria,
)
from proofmass.analytic.rods.equilibrium import state
from proofmass.analytic.rods.tip_wrench import FINE_STEPS, NaturalRods, march_from_tip
from tests.independent.rods.chain_starts import (
    LINKS,
    ChainStates,
    chain_rests,
    random_states,
    shoot,
    shot_equilibrium,
)

ALONE = np.zeros(1)


def mixed() -> RodProblem:
    """Two rods, precurved and with couples, one clamped to the platform and one pinned."""
    return RodProblem(
        assembly(
            [[-0.5, 0.0], [0.5, 0.1]],
            length=[1.0, 1.2],
            stiffness=[1.0, 2.0],
            arm=[[0.1, 0.0], [-0.1, 0.05]],
            clamped=[True, False],
            tip_angle=[0.3, 0.0],
            curvature=[1.0, -0.5],
            couple=[0.5, -1.0],
        ),
        np.zeros(2),
        np.array([0.1, 0.2, 0.3]),
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("inflections", "alpha", "least"), [(2, 7.0, 6), (3, 15.0, 33), (3, 20.0, 34)]
)
def test_random_starts_find_the_equilibria_of_the_closed_form_and_their_stability(
    inflections, alpha, least
):
    pair = assembly([[-0.3, 0.0], [0.3, 0.0]])
    given = {"inputs": np.radians([40.0, 60.0]), "load": [5.7, -1.9]}
    problem = RodProblem(pair, given["inputs"], np.array([*given["load"], 0.0]))
    limits = SearchLimits(inflections, alpha)
    found, nearest = search_equilibria(problem, limits)
    ours = describe_equilibria(problem, found, limits, np.inf, nearest)
    closed = solutions(pair, **given, modes=inflections, most_load=alpha)
    assert len(ours) == len(closed) >= least
    np.testing.assert_allclose(ours.state.pose[:, :2], closed.state.pose, atol=1e-7)
    np.testing.assert_allclose(ours.potential, closed.potential, atol=1e-7)
    np.testing.assert_array_equal(ours.index, closed.negative)
    np.testing.assert_array_equal(ours.inflections, closed.modes)


def test_half_of_the_starts_are_exact_shapes_that_fit_their_clamps():
    problem, limits = mixed(), SearchLimits(alpha=6.0)
    starts = bent_guesses(problem, limits, 50, np.random.default_rng(1))
    place, phi = starts.pose[:, 0] + 1j * starts.pose[:, 1], starts.pose[:, 2]
    a = problem.assembly
    for i in range(a.rods):
        at = place + a.arm[i] * np.exp(1j * phi)
        bent = bend_rods(problem, i, starts.own[:, i], at, phi + a.tip_angle[i], FINE_STEPS)
        assert np.abs(bent.misfit).max() < 1e-6
        assert np.abs(bent.gap[:, 2]).max() < 0.02  # rough steps
        assert np.abs(bent.gap[:, :2]).max() > 0.1  # its place does not fit yet


@pytest.mark.slow
def test_equilibria_of_mixed_rods_are_confirmed_by_shooting_from_the_clamps():
    problem = mixed()
    found = find_equilibria(problem, SearchLimits(alpha=5.0))
    assert len(found) > 1
    assert (found.index == 0).any()
    gaps = [np.abs(shoot(problem, shot_unknowns(found, n))).max() for n in range(len(found))]
    assert max(gaps) < 1e-7  # tolerances of the integration from the clamps


@pytest.mark.slow
@pytest.mark.parametrize("changed", ["curvature", "couple", "tip_angle", "stiffness"])
def test_shooting_notices_a_wrong_rod(changed):
    problem = mixed()
    found = find_equilibria(problem, SearchLimits(alpha=5.0))
    a = problem.assembly
    wrong = replace(problem, assembly=replace(a, **{changed: [*getattr(a, changed), 0.01, 0.0]}))
    assert np.abs(shoot(wrong, shot_unknowns(found, 0))).max() > 1e-4


@pytest.mark.slow
def test_chains_from_random_shapes_lead_to_no_other_equilibrium_with_small_loads():
    problem, limits = mixed(), SearchLimits(alpha=5.0)
    found = find_equilibria(problem, limits)
    ours = [shot_unknowns(found, n) for n in range(len(found))]
    rests = chain_rests(problem, random_states(problem, 100, np.random.default_rng(1)))
    a = problem.assembly
    force = np.hypot(rests.force[..., 0], rests.force[..., 1])
    alpha = np.sqrt(force * a.length**2 / a.stiffness).max(axis=1)
    light = np.flatnonzero(alpha < 4.5)
    first = np.unique(rests.pose[light, :2].round(3), axis=0, return_index=True)[1]
    shot = [shot_equilibrium(problem, rests, int(light[n])) for n in first]
    assert len(shot) == len(ours)
    assert all(min(distance(problem, one, two) for two in ours) < 1e-5 for one in shot)


@pytest.mark.slow
def test_chains_that_start_near_each_equilibrium_return_to_it():
    """In an assembly in which chains from 3000 random shapes reach 12 of 13."""
    problem, random = random_assembly(20), np.random.default_rng(5)
    found = find_equilibria(problem, LIMITS)
    assert len(found) == 13
    state, clamped = chain_equilibria(found, LINKS), problem.assembly.clamped
    rods = [chain_shapes(problem, state, i, LINKS) for i in range(clamped.size)]
    angle = np.stack([rod.angle.T for rod in rods], axis=1)
    angle[:, :, 1:] += random.normal(0.0, 0.1, angle[:, :, 1:].shape)
    for n in range(len(found)):
        one, moment = slice(n, n + 1), np.where(clamped, state.own[n, :, 2], 0.0)
        start = ChainStates(angle[one], state.pose[one], state.own[one, :, :2], moment[None])
        rest = chain_rests(problem, start)
        np.testing.assert_allclose(rest.pose[0], state.pose[n], atol=1e-8)


@pytest.mark.slow
def test_a_precurved_rod_without_load_is_an_arc():
    rod = RodProblem(assembly([[0.0, 0.0]], curvature=1.5), ALONE, np.zeros(3))
    found = find_equilibria(rod, SearchLimits(inflections=1, alpha=2.0))
    tip = (np.exp(1.5j) - 1.0) / 1.5j
    np.testing.assert_allclose(found.state.pose[:, :2], [[tip.real, tip.imag]], atol=1e-9)
    assert found.index.tolist() == [0]
    assert found.energy[0] < 1e-12


@pytest.mark.slow
def test_a_small_couple_bends_a_cantilever_as_beam_theory_says():
    couple = 1e-4
    rod = RodProblem(assembly([[0.0, 0.0]], couple=couple), ALONE, np.zeros(3))
    found = find_equilibria(rod, SearchLimits(inflections=1, alpha=2.0))
    # EI w'' = l (L - s), w(L) = l L^3 / (3 EI); terms left out are of the order of l^3
    assert found.state.pose[0, 1] == pytest.approx(couple / 3.0, rel=1e-6)
    assert found.clamp_moment[0, 0] == pytest.approx(couple, rel=1e-9)


def test_a_couple_alone_bends_a_rod_by_its_sum_of_moments():
    """The bending moment grows from 0 at the tip to q L, so that the rod turns by q L^2/(2 EI)."""
    none, couple = np.zeros(1), np.array([0.6])
    rods = NaturalRods(none, couple, np.zeros(1, complex))
    found = march_from_tip(rods, np.zeros(1, complex), none, none)
    assert found.angle[0, 0] == pytest.approx(-0.3, abs=1e-12)
    other = march_from_tip(NaturalRods(couple, none, np.zeros(1, complex)), 0j * none, none, none)
    assert other.angle[0, 0] == pytest.approx(-0.6, abs=1e-12)  # the same as natural curvature


@pytest.mark.slow
def test_a_column_beyond_its_critical_load_is_straight_and_unstable_or_bent_and_stable():
    column = RodProblem(assembly([[0.0, 0.0]]), ALONE, np.array([-2.8417542587507936, 0.0, 0.0]))
    found = find_equilibria(column, SearchLimits(inflections=2, alpha=4.0))
    assert found.index.tolist() == [0, 0, 1]
    np.testing.assert_allclose(found.state.pose[2, :2], [1.0, 0.0], atol=1e-9)
    # Love: modulus 1/2 at 1.15172 of the critical load
    np.testing.assert_allclose(found.state.pose[:2, 0], 0.741020, atol=1e-6)


@pytest.mark.slow
def test_a_held_pin_has_the_equilibria_of_a_rod_between_clamp_and_pin():
    rod = assembly([[0.0, 0.0]], stiffness=0.16493361431346418, held=[0.8, 0.1, None])
    found = find_equilibria(RodProblem(rod, ALONE, np.zeros(3)), SearchLimits(alpha=6.0))
    # the thesis' rod R1, solutions A and B
    np.testing.assert_allclose(found.energy, [0.5894789, 0.7556662], atol=1e-6)


def test_solvers_of_plain_assemblies_refuse_others():
    with pytest.raises(ValueError, match="assembly_search takes all others"):
        state(mixed().assembly)
