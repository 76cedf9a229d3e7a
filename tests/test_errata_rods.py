"""Misprints of Pérez Gámiz 2018 about rods that no other test shows.

Each test asserts the true value and that the printed one differs from it.  The register of all
misprints is docs/errata.md.
"""

import ast
from pathlib import Path

import numpy as np
import pytest

from proofmass.analytic.rods.equilibrium import RodState, closure, solve_direct, state
from tests.analytic.rods.rod_assembly_cases import (
    CORNERS,
    DATA,
    EI,
    TABLE_7_NAMES,
    rods_by_elliptic_integrals,
    table_7_state,
    three_rod_platform,
    xy,
)

ROOT = Path(__file__).parent.parent


def platform_of_table_8(moment=0.0):
    """The second solution of Table 8, under an external moment in addition to its force."""
    row = DATA["rfr3"]["printed"][1]
    motors = np.radians(DATA["rfr3"]["inputs_deg"])
    tip, force, clamp = rods_by_elliptic_integrals(row["psi"], row["kr"], CORNERS, motors)
    guess = state(
        three_rod_platform(DATA["rfr3"]["side"]),
        inputs=motors,
        load=[0.0, 0.5, moment],
        pose=[*xy(tip.mean()), np.angle(tip[1] - tip[0])],
        moment=clamp,
        force=xy(force),
    )
    return solve_direct(guess)


def platform_pins(s: RodState):
    """The pins B_i of the platform as complex numbers x + iy."""
    return s.pose @ [1.0, 1.0j, 0.0] + np.exp(1j * s.pose[2]) * s.assembly.arm


def test_equations_114_and_115_hold_for_tips_whose_loads_add_up_to_the_load():
    """M_i of eq. 115, -r x R, is the moment of rod i on the platform if R is the load of its tip.

    The loads of eq. 113 add up to -F.  With them the residual of eq. 114 is 2 M_ext.
    """
    s = platform_of_table_8(moment=0.01)
    (x, y), load = xy(platform_pins(s) - s.pose @ [1.0, 1.0j, 0.0]).T, s.force
    assert load.sum(axis=0) == pytest.approx(s.load[:2], abs=1e-10)  # solved to 1e-10 EI/L
    for sign, residual in ((1.0, 0.0), (-1.0, 2.0 * s.load[2])):
        moment = sign * (load[:, 0] * y - load[:, 1] * x)
        assert moment.sum() + s.load[2] == pytest.approx(residual, abs=1e-10)  # as above


def test_equation_110_adds_the_moment_of_one_rod_three_times():
    """The moment about the origin is the sum of p_i x n_i, not three times p_1 x n_1."""
    s = platform_of_table_8()
    moments = (platform_pins(s).conj() * (s.force @ [1.0, 1.0j])).imag
    load = (s.pose[:2] @ [1.0, -1.0j] * (s.load[:2] @ [1.0, 1.0j])).imag
    assert moments.sum() == pytest.approx(load, abs=1e-10)  # solved to 1e-10 EI/L
    assert abs(3.0 * moments[0] - load) > 1e-3


@pytest.mark.parametrize("name", TABLE_7_NAMES)
def test_moduli_of_rods_are_outside_the_zone_that_line_451_calls_valid(name):
    """Since k^2 - cos(psi/2)^2 = m0^2/(4 EI R), |k| >= |cos(psi/2)|; line 451 has the reverse.

    Eq. 41 takes the arcsine of cos(psi/2)/k, which is the amplitude at the clamp.  The moment at
    the clamp follows from it.  A modulus below the limit would have an arcsine of more than 1.
    """
    s = table_7_state(name)
    tangent = np.stack([np.cos(s.inputs), np.sin(s.inputs)], axis=-1)
    load = np.linalg.norm(s.force, axis=-1)
    along = np.sum(s.force * tangent, axis=-1)
    end = s.shape([1.0])[2][:, 0]
    # eqs 35, 36 at the pin, where theta' = 0 and theta - psi is the angle to the load
    k = np.sqrt((1.0 + (s.force * np.stack([np.cos(end), np.sin(end)], -1)).sum(-1) / load) / 2.0)
    least = np.sqrt((1.0 + along / load) / 2.0)  # |cos(psi/2)|
    assert np.all(k > least)
    clamp = 2.0 * k * np.sqrt(load * EI) * np.cos(np.arcsin(least / k))
    assert np.abs(s.moment) == pytest.approx(clamp, abs=1e-9)  # solved to 1e-10 EI/L


def test_equation_29_of_a_planar_cosserat_rod_is_misprinted():
    """Eq. 29 prints cos instead of sin in p_y', and omits a factor C2 in m'.

    EA and GA are of the order of EI/L^2 here, so that extension and shear are not small.  Rods of
    the package have neither: only p_y' and m' without stretch are compared with them, and the
    factor C2 is checked for the formula alone.
    """
    theta, n, ea, ga = 0.4, np.array([0.7, -0.3]), 5.0, 3.0
    c, s = np.cos(theta), np.sin(theta)
    axial, shear = n @ [c, s], n @ [-s, c]
    slope = np.array([(1 + axial / ea) * c - shear / ga * s, (1 + axial / ea) * s + shear / ga * c])
    # p' independently: the strains in the rod's frame, rotated to the ground'
    turn = np.array([[c, -s], [s, c]])
    assert slope == pytest.approx(turn @ [1 + axial / ea, shear / ga], rel=1e-14, abs=0)  # rounding
    bend = -(slope[0] * n[1] - slope[1] * n[0])  # m' = -p' x n
    stretch = 1 / ea - 1 / ga
    assert bend == pytest.approx(-(shear + stretch * axial * shear), rel=1e-13, abs=0)  # rounding
    assert abs(bend + shear + stretch * axial) > 0.1  # as printed
    printed = (1 + axial / ea) * c + shear / ga * c
    assert abs(printed - slope[1]) > 0.1
    s, step = table_7_state("S1"), 1.0 / 2000
    _, y, angle, moment = s.shape(np.arange(2001) * step)
    y_slope, moment_slope = ((v[:, 2:] - v[:, :-2]) / (2 * step) for v in (y, moment))
    angle, (n_x, n_y) = angle[:, 1:-1], s.force.T[..., None]
    # central differences with a truncation error of step^2/6 times third derivatives below 100
    assert y_slope == pytest.approx(np.sin(angle), abs=1e-5)
    assert moment_slope == pytest.approx(-(np.cos(angle) * n_y - np.sin(angle) * n_x), abs=1e-5)
    assert np.abs(y_slope - np.cos(angle)).max() > 0.1  # as printed


def test_equation_27_keeps_the_force_of_a_rod_constant():
    """A rod with varying stiffnesses and without distributed load has n' = 0 and m' = -p' x n.

    This is a check of the printed formula alone: rods of the package have no extension or shear.
    """
    theta, v_x, v_z, u = 0.4, 0.3, 1.2, 0.8
    ea, ga, ei, ea_slope, ga_slope, ei_slope = 5.0, 3.0, 2.0, 0.6, -0.4, 0.5

    def balance(lack: float) -> np.ndarray:
        """n' in the frame of the section, and m' + p' x n, which must all be zero.

        `lack` is 0 for the right equations and 1 for the printed ones.
        """
        x = -(ga_slope * (v_x + lack * (1.0 - v_x)) + ea * u * (v_z - 1.0)) / ga
        z = -(ea_slope * (v_z - 1.0) - (1.0 - 2.0 * lack) * ga * u * v_x) / ea
        own = -(ei_slope * u - (ea - ga) * v_x * v_z + (1.0 - lack) * ea * v_x) / ei
        axial, shear = ea * (v_z - 1.0), ga * v_x
        axial_slope = ea_slope * (v_z - 1.0) + ea * z - u * shear
        shear_slope = ga_slope * v_x + ga * x + u * axial
        bend = ei_slope * u + ei * own + v_z * shear - v_x * axial
        return np.array([axial_slope, shear_slope, bend])

    np.testing.assert_allclose(balance(0.0), 0.0, atol=1e-14)  # rounding
    assert np.all(np.abs(balance(1.0)) > 0.1)  # as printed
    turn = np.array([[np.cos(theta), -np.sin(theta)], [np.sin(theta), np.cos(theta)]])
    slope = [v_z * np.cos(theta) - v_x * np.sin(theta), v_x * np.cos(theta) + v_z * np.sin(theta)]
    assert turn @ [v_z, v_x] == pytest.approx(slope, rel=1e-14, abs=0)  # rows 1 and 2 are right


@pytest.mark.parametrize("name", TABLE_7_NAMES)
def test_the_program_computes_twice_the_elastic_energy(name):
    """The program applies Simpson's rule with 41 nodes to m^2/EI; the factor 1/2 is missing."""
    s = table_7_state(name)
    m = s.shape(np.linspace(0.0, 1.0, 41))[3]
    weights = np.r_[1.0, np.tile([4.0, 2.0], 19), 4.0, 1.0] / 120.0
    assert m**2 @ weights / EI == pytest.approx(2.0 * s.energy, rel=1e-3)  # Simpson's rule


def test_a_slide_moves_the_clamp_along_its_guide():
    """The derivative of the clamp's position by its slide is (cos, sin) of the guide's angle.

    The program for the inverse problem takes the clamp's angle, which is right only if both angles
    are equal.
    """
    guide, angle, h = np.array([0.3, 2.0, -2.2]), np.array([0.1, 2.2, -1.9]), 1e-6
    s = state(
        three_rod_platform(0.3, angle=angle, guide=guide), moment=0.02, force=np.full((3, 2), 0.05)
    )
    base = s.vector.size - s.assembly.dof - 3
    for i in range(3):
        step = np.zeros(s.vector.size)
        step[base + i] = h
        up, down = (closure(RodState(s.assembly, s.vector + sign * step))[0] for sign in (1, -1))
        moved = ((up - down) / (2 * h))[3 * i + 1 : 3 * i + 3]
        assert moved == pytest.approx([np.cos(guide[i]), np.sin(guide[i])], abs=1e-9)  # rounding/h
        assert np.abs(moved - [np.cos(angle[i]), np.sin(angle[i])]).max() > 0.1


def test_the_register_names_every_test_of_this_file():
    text = (ROOT / "docs" / "errata.md").read_text()
    tree = ast.parse(Path(__file__).read_text())
    tests = [
        node.name
        for node in tree.body
        if isinstance(node, ast.FunctionDef) and node.name.startswith("test_")
    ][:-1]
    assert [name for name in tests if f"`test_errata_rods::{name}`" not in text] == []
