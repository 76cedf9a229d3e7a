"""The reference `rod_assembly`, and the equilibria of its chains, against other formulations."""

from dataclasses import replace

import numpy as np
import pytest

from docs.make.rod_assemblies import shot_unknowns
from proofmass.analytic.protocol import Ask, InputMotion
from proofmass.analytic.rods import rod_pair
from proofmass.analytic.rods.assembly_chain import bending_energy, chain_equilibria, chain_shapes
from proofmass.analytic.rods.rod_assembly import RodAssembly
from tests.independent.rods.chain_starts import LINKS, ChainStates, chain_rests, shoot
from tests.shipped import shipped, shipped_case

ARC = InputMotion(np.linspace(0.0, 0.9, 7))


def shipped_values(**changed):
    return {**shipped_case(shipped("rod_assembly.toml")).parameters, **changed}


def curves(**changed):
    return RodAssembly(**shipped_values(**changed)).solve(ARC, Ask())


def test_two_rods_on_a_pin_have_the_curves_of_the_closed_form():
    parameters = shipped_case(shipped("rfr2_natural.toml")).parameters
    closed = rod_pair.solve(ARC.x, **parameters)
    pair = RodAssembly(
        clamp_x1=-0.3,
        clamp_x2=0.3,
        angle1=parameters["theta1"],
        angle2=parameters["theta2"],
        length1=1.0,
        length2=1.0,
        stiffness1=parameters["stiffness"],
        stiffness2=parameters["stiffness"],
        force_x=0.3,
        force_y=-0.1,
        guess_x=0.19,
        guess_y=0.86,
        guess_force_x1=0.16,
        guess_force_y1=0.51,
        guess_angle1=1.2,
        guess_angle2=2.45,
    ).solve(ARC, Ask())
    for name in ("x1", "y1", "t1", "m1", "x2", "y2", "t2", "m2", "energy"):
        np.testing.assert_allclose(pair[name], closed[name], atol=1e-9, err_msg=name)


def test_shooting_from_the_clamps_confirms_it_and_notices_a_wrong_length():
    found = RodAssembly(**shipped_values()).equilibrium()
    assert found.index.tolist() == [0]
    unknowns, problem = shot_unknowns(found, 0), found.problem
    assert np.abs(shoot(problem, unknowns)).max() < 1e-7  # tolerances of the integration
    a = problem.assembly
    wrong = replace(problem, assembly=replace(a, length=a.length * [1.0, 1.001, 1.0]))
    assert np.abs(shoot(wrong, unknowns)).max() > 1e-4


def test_its_curves_end_where_the_rods_do():
    found = RodAssembly(**shipped_values())
    ends = found.solve(InputMotion(np.array([0.0, 0.9])), Ask())
    assert [ends[f"t{i}"][0] for i in (1, 2, 3)] == pytest.approx([0.6, 2.4, -1.2], abs=1e-9)
    tip = ends["x"][0] + 1j * ends["y"][0] + 0.1j * np.exp(1j * ends["phi"][0])
    assert ends["x3"][1] + 1j * ends["y3"][1] == pytest.approx(tip, abs=1e-9)
    away = ends["t3"][1] - ends["phi"][0] + 1.5
    assert away / (2 * np.pi) == pytest.approx(round(away / (2 * np.pi)), abs=1e-9)


@pytest.mark.parametrize("key", ["curvature1", "couple2", "load_y3", "tip_angle3", "at_x2"])
def test_each_kind_of_parameter_moves_its_curves(key):
    before, after = curves(), curves(**{key: shipped_values()[key] + 0.01})
    assert np.abs(after["x1"] - before["x1"]).max() > 1e-5


def test_a_held_platform_is_where_it_is_held():
    free = curves()
    held = curves(held_x=free["x"][0], held_phi=free["phi"][0], force_x=5.0)
    np.testing.assert_allclose(held["x"], free["x"], atol=1e-12)
    np.testing.assert_allclose(held["y2"], free["y2"], atol=1e-8)  # the hold carries the force


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"clamp_x4": 1.0}, "clamp_x4 is of rod 4: give length4"),
        ({"guess_x": 5.0, "guess_force_x1": 900.0}, "no equilibrium near the guess"),
        ({"clamp_x2": 5.0}, "apart, and their rods reach"),
        ({"end1": "welded"}, "end1 must be one of pinned, clamped"),
        ({"held_x": np.nan}, "held_x"),
    ],
)
def test_bad_assemblies_are_refused(changed, words):
    with pytest.raises(ValueError, match=words):
        curves(**changed)


def test_a_rod_without_a_number_before_it_is_refused():
    with pytest.raises(ValueError, match="length2 is missing"):
        RodAssembly(length1=1.0, stiffness1=1.0, length3=1.0, stiffness3=1.0).solve(ARC, Ask())


def test_a_moment_on_a_pin_is_refused():
    with pytest.raises(ValueError, match="pinned at its origin"):
        RodAssembly(length1=1.0, stiffness1=1.0, moment=1.0).solve(ARC, Ask())


def test_chains_are_those_of_lagrange_multipliers():
    """Places, directions and poses of chains with weights, couples and a clamped tip."""
    found = RodAssembly(**shipped_values()).equilibrium()
    problem, state = found.problem, chain_equilibria(found, LINKS)
    shapes = [chain_shapes(problem, state, i, LINKS) for i in range(3)]
    nudged = np.array([one.angle[:, 0] for one in shapes])[None]
    nudged[:, :, 1:] += 0.01
    start = ChainStates(
        nudged, state.pose, state.own[..., :2], np.where([0, 0, 1], state.own[..., 2], 0.0)
    )
    theirs = chain_rests(problem, start)
    np.testing.assert_allclose(theirs.pose, state.pose, atol=1e-10)
    for i, one in enumerate(shapes):
        np.testing.assert_allclose(theirs.angle[0, i], one.angle[:, 0], atol=1e-10)
    np.testing.assert_allclose(theirs.force[0], state.own[0, :, :2], atol=1e-8)


def test_errors_of_chains_are_of_second_order():
    found = RodAssembly(**shipped_values()).equilibrium()
    errors = []
    for links in (20, 40, 80):
        state = chain_equilibria(found, links)
        energy = sum(
            bending_energy(found.problem, i, chain_shapes(found.problem, state, i, links))[0]
            for i in range(3)
        )
        errors.append([*np.abs(state.pose - found.state.pose)[0], abs(energy - found.energy[0])])
    orders = np.log2(np.array(errors)[:-1] / np.array(errors)[1:])
    np.testing.assert_allclose(orders, 2.0, atol=0.1)


def test_chains_have_a_multiple_of_four_links():
    with pytest.raises(ValueError, match="multiple of 4"):
        chain_equilibria(RodAssembly(**shipped_values()).equilibrium(), 10)
