"""Misprints of the source documents that no other test shows.

Each test asserts the true value and that the printed one differs from it.  The register of all
misprints is docs/errata.md.  The last two tests check that all tests that the register names exist,
and that it names all tests of this file.
"""

import ast
import re
from pathlib import Path

import numpy as np
import pytest

from proofmass.analytic import balancer
from proofmass.analytic.balancer.measures import precision_points, rmse
from proofmass.analytic.linkages import fourbar, hacksaw
from proofmass.analytic.newton_raphson import NotConverged
from teaching import natural_coordinates as scheme
from teaching.newton_log import jacobian_ranks
from tests.analytic.balancer.balancer_table import DATA
from tests.shipped import shipped, shipped_case

ROOT = Path(__file__).parent.parent
HACKSAW_LENGTHS = {"crank": 0.075, "coupler": 0.170, "offset": 0.045}
FIVE_BAR_EXAMPLE = scheme.EXAMPLES["five-bar"]


# B. Díaz Lozano, TFG, Universidad de Almería 2019


def test_full_rank_does_not_mean_that_newton_converges():
    with pytest.raises(NotConverged) as failure:
        scheme.assemble(scheme.fourbar(1.0, 2.0, 3.0, 50.0), (0.1, 1.0, 1.0, 0.2, 0.0))
    # the rank is full in each iteration, for which line 1064 says: "it will converge"
    assert set(jacobian_ranks(failure.value.log)) == {5}


def test_the_printed_tolerance_of_1_to_the_minus_10_ends_too_early():
    """Lines 1406-1408 print the tolerance 1^-10, which is 1; the code has 1e-10."""
    linkage, start = scheme.EXAMPLES["four-bar"]
    steps = scheme.assemble(linkage, start).steps
    stopped = np.argmax(steps <= 1.0**-10)
    assert steps[-1] <= 1e-10
    assert steps[stopped + 1 :].sum() > 0.04  # the steps [m] that 1 would leave out


def test_the_cosine_row_is_singular_at_a_crank_angle_of_zero():
    """Lines 4244, 5960, 7819 and 9152 exchange the sine row and the cosine row; the code is right.

    At a crank angle of 0 the Jacobian has full rank with the sine row, and lacks a rank with the
    cosine row.
    """
    q = scheme.assemble(*scheme.EXAMPLES["four-bar"]).root  # crank angle 0
    for threshold, rank in ((0.5**0.5, 5), (2.0, 4)):  # sine row; cosine row at any angle
        linkage = scheme.fourbar(1.0, 2.0, 2.5, 3.0, threshold=threshold)
        assert np.linalg.matrix_rank(linkage.evaluate(q, q)[1], 1e-5) == rank


def test_bias_terms_of_figures_58_and_80_are_misprinted():
    """Figure 58 prints a wrong minus sign, figure 80 a bias for the guide's row, which is zero."""
    linkage, start = scheme.EXAMPLES["four-bar"]
    q = scheme.assemble(linkage, start).root
    v = scheme.velocities(linkage, q, [1.0])
    one, two = v[:2], v[2:4]
    u = two - one
    true = 2.0 * (two @ u - one @ u)
    assert linkage.evaluate(q, v)[2][1] == pytest.approx(true, rel=1e-14, abs=0)  # rounding
    assert abs(true - 4.0 * two[1] * u[1] - true) > 0.5
    linkage, start = scheme.EXAMPLES["slider-crank"]
    q = scheme.assemble(linkage, start).root
    v = scheme.velocities(linkage, q, [1.0])
    assert linkage.evaluate(q, v)[2][2] == 0.0
    assert 2.0 * v[2:4] @ v[2:4] > 0.9


def test_the_collinearity_row_of_figure_89_is_misprinted():
    """Figure 89 prints two wrong derivatives in the row that keeps three points on a line."""
    linkage, start = scheme.EXAMPLES["inverted slider-crank"]
    q = scheme.assemble(linkage, start).root
    (_, y1), (_, y2), (_, y3) = q[:6].reshape(3, 2)
    row = linkage.evaluate(q, q)[1][3]
    assert row[[0, 2]] == pytest.approx([y3 - y2, y1 - y3], rel=1e-14, abs=0)  # rounding
    printed = [-2.0 * (y2 - y1) + y3 - y1, -y3 - y1]
    assert np.abs(row[[0, 2]] - printed).min() > 0.5


def test_the_solver_overwrites_the_input_accelerations():
    """Lines 2843, 7262 and 10629 set the input accelerations (1, 2); the solver uses (1, 1)."""
    linkage, start = FIVE_BAR_EXAMPLE
    q = scheme.assemble(linkage, start).root
    v = scheme.velocities(linkage, q, [1.0, 2.0])
    asked, plotted = (scheme.accelerations(linkage, q, v, [1.0, a]) for a in (2.0, 1.0))
    assert np.abs(asked - plotted)[2:4].min() > 0.1


def test_equal_angles_at_unequal_rates_are_no_motion():
    """Lines 2756, 2839 and 10619 draw curves for beta = theta with the rates beta' = 2 theta'.

    The rates of the points are the derivatives of their positions only if beta = 2 theta.
    """
    angle, linkage = np.linspace(0.3, 0.31, 11), FIVE_BAR_EXAMPLE[0]
    rate_errors = {}
    for ratio in (1.0, 2.0):  # beta / theta; the ratio of the rates is always 2
        angles = np.stack([angle, ratio * angle], 1)
        q, v, _ = scheme.sweep(linkage, FIVE_BAR_EXAMPLE[1], angles, [1.0, 2.0], [0.0, 0.0])
        slope = (q[2:] - q[:-2]) / 2e-3  # central difference, error step^2
        rate_errors[ratio] = np.abs(slope - v[1:-1])[:, :6].max()
    assert rate_errors[2.0] < 1e-4
    assert rate_errors[1.0] > 0.5


def test_pi_of_3_1416_makes_a_turn_too_long():
    """Lines 2079 and 2261 use pi = 3.1416, which makes a turn too long by 1.47e-5 rad.

    The crank of the shipped four-bar makes a whole turn: it ends where it began.
    """
    (drive,) = shipped_case(shipped("fourbar.toml")).drive
    turn = drive.to - drive.start
    assert np.exp(1j * turn) == pytest.approx(1.0, abs=1e-15)  # rounding of 2 pi
    assert 2.0 * 3.1416 - turn == pytest.approx(1.47e-5, rel=1e-3)  # three digits


def test_a_ground_length_with_its_sign_hides_a_non_grashof_linkage():
    """Lines 1275 and 4179 sort XB - XA, with its sign, among the lengths.

    With a ground pin to the left, -3 m, the code gives no warning that this linkage is non-Grashof.
    """
    d, c, b, a = sorted([2.0, 2.0, 2.5, -3.0])
    assert not b + c < a + d  # the condition of the code's warning
    assert fourbar.grashof_margin(crank=2.0, coupler=2.0, rocker=2.5, ground=3.0) < 0.0


# Power hacksaw report, Universidad Nacional de Colombia


def test_error_plots_end_below_the_errors_they_show():
    """The error plots of lines 2297-2339 end at 1e-15, below the errors of the accelerations.

    Line 771 of the text has 1e-14 for the accelerations, which is right.
    """
    law = hacksaw.motor(np.linspace(0.0, 2.0 * hacksaw.turn_time(), 1000))
    found, truth = (
        hacksaw.newton_sweep(*law, **HACKSAW_LENGTHS),
        hacksaw.solve(*law, **HACKSAW_LENGTHS),
    )
    for name in ("theta1_acceleration", "theta3_acceleration"):
        assert 1e-15 < np.abs(found[name] - truth[name]).max() < 1e-13


def test_the_axis_of_v_r_clips_its_peak():
    """The axis of V_r ends at 0.6 m/s in lines 1845 and 2421, below the peak of 0.6048 m/s."""
    law = hacksaw.motor(np.linspace(0.0, 2.0 * hacksaw.turn_time(), 1000))
    peak = hacksaw.solve(*law, **HACKSAW_LENGTHS)["r1_rate"].max()
    assert peak == pytest.approx(0.604780, abs=5.1e-7)  # six decimals, on this grid
    assert peak > 0.6  # the end of the axis


# S. van Nes, MSc thesis TU Delft 2022.074


def test_the_sam_arrays_belong_to_another_balancer():
    """The arrays of lines 10241-10246 belong to another balancer than that of Table F.1.

    Their rms is 0.1005 N m, ten times the residual of the balancer of Table F.1.  With the sine
    added, all of their 14 steps but two are equal.  The moment of the balancer of Table F.1 has
    unequal steps, since two of its preloads are released on the way.
    """
    other = next(o for o in DATA["others"] if o["name"] == "listing N.4")
    angle = precision_points(15)
    residuals = balancer.solve(angle, target="sine", **other["parameters"])["residual"]
    printed = np.array(DATA["sam"]["moments"])
    assert float(rmse(printed, 0.0)) == pytest.approx(0.1005, abs=5e-5)
    assert float(rmse(residuals, 0.0)) == pytest.approx(0.00995, abs=5e-6)
    steps = np.diff(printed + np.sin(angle))
    assert np.ptp(np.sort(steps)[2:]) < 3e-4  # twelve steps are equal to the printed digits
    assert np.ptp(np.diff(residuals + np.sin(angle))) > 0.03


# The register


def test_every_test_that_the_register_names_exists():
    named = re.findall(r"`(\w+)::(\w+)`", (ROOT / "docs" / "errata.md").read_text())
    assert len(named) > 30
    files = sorted((ROOT / "tests").rglob("*.py"))
    for file in {file for file, _ in named}:
        (found,) = (one for one in files if one.stem == file)
        tree = ast.parse(found.read_text())
        names = {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}
        missing = {function for of, function in named if of == file} - names
        assert not missing, f"tests/{file}.py has no {missing}"


def test_the_register_names_every_test_of_this_file():
    text = (ROOT / "docs" / "errata.md").read_text()
    tree = ast.parse(Path(__file__).read_text())
    tests = [
        node.name
        for node in tree.body
        if isinstance(node, ast.FunctionDef) and node.name.startswith("test_")
    ][:-2]
    assert [name for name in tests if f"`test_errata::{name}`" not in text] == []
