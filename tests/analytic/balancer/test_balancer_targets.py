"""Targets against their energies and printed formulas; measures against plain sums."""

from itertools import combinations

import numpy as np
import pytest
from scipy.integrate import quad

from proofmass.analytic.balancer import measures, solve
from proofmass.analytic.balancer.measures import TARGETS, target, target_from_table
from tests.analytic.balancer.balancer_chain import PATH_ANGLES, ROWS, row_parameters
from tests.independent.balancer.lines import best_lines

EACH_TARGET = pytest.mark.parametrize("name", TARGETS)
QUARTER_TURN = np.linspace(0.0, np.pi / 2, 91)
NINETY_POINTS = measures.precision_points(90)
EQUATION_28 = (-0.25, 1.34, -2.91, 2.82, -0.01)  # van Nes 2022, line 804, as printed
# Energies as in the program, lines 4060-4112, with its six decimals.
PRINTED_ENERGY = {
    "sine": np.cos,
    "progressive": lambda a: np.sin(a) - a,
    "progressive-degressive": lambda a: (
        -0.5 * a
        + (-0.333333 + 0.424413 * a) * np.arctan(2.41421 - 3.07387 * a)
        + 0.0690356 * np.log(9.8696 - 21.4521 * a + 13.6569 * a**2)
    ),
    "degressive-progressive": lambda a: (
        -0.5 * a - 0.0690356 * np.log(1.0 + np.tan(1.1781 - 1.5 * a) ** 2)
    ),
    "laevo": lambda a: (
        0.05022 * a**5 - 0.33575 * a**4 + 0.97 * a**3 - 1.412 * a**2 + 0.006501 * a + 1.0
    ),
    "sine180": lambda a: 0.5 * np.cos(2.0 * a),
    "square-root": lambda a: -(2 / 3) * a ** (3 / 2),
    "quadratic": lambda a: -(1 / 3) * a**3,
    "hardening-softening": lambda a: 0.25 * np.cos(2 * a - np.pi / 2) - 0.5 * a,
    "softening-hardening": lambda a: 0.5 * np.log(np.cos(a - np.pi / 4)) - 0.5 * a,
}
SIX_DIGIT_TARGETS = "progressive-degressive", "degressive-progressive"
# Moments of the four targets that only the program has, not the tables, as in lines 4079 to 4100.
UNTABULATED_MOMENTS = {
    "square-root": np.sqrt,
    "quadratic": lambda a: a**2,
    "hardening-softening": lambda a: (np.sin(2 * a - np.pi / 2) + 1) / 2,
    "softening-hardening": lambda a: 0.5 * np.tan(a - np.pi / 4) + 0.5,
}


def balancing_moment(line, angle=PATH_ANGLES):
    return solve(angle, **row_parameters(ROWS[line]))["balancing_moment"]


@pytest.mark.parametrize("name", UNTABULATED_MOMENTS)
def test_untabulated_targets_are_those_of_the_program(name):
    np.testing.assert_allclose(
        target(name, QUARTER_TURN), UNTABULATED_MOMENTS[name](QUARTER_TURN), rtol=0, atol=5e-16
    )


def test_hardening_and_softening_targets_bend_as_named():
    for name, sign in (("hardening-softening", 1.0), ("softening-hardening", -1.0)):
        np.testing.assert_allclose(
            target(name, QUARTER_TURN) + target(name, QUARTER_TURN[::-1]), 1.0
        )
        assert (sign * np.diff(target(name, QUARTER_TURN), 2)[:40] > 0.0).all()
    assert (np.diff(target("square-root", QUARTER_TURN), 2) < 0.0).all()
    assert (np.diff(target("quadratic", QUARTER_TURN), 2) > 0.0).all()


@EACH_TARGET
def test_target_is_minus_the_slope_of_its_energy(name):
    angle = QUARTER_TURN[1:]  # the square root has a branch point at zero
    by_complex_step = TARGETS[name].height_energy(angle + 1e-30j).imag / 1e-30
    np.testing.assert_allclose(-by_complex_step, target(name, angle), rtol=0, atol=4e-15)  # eps


@EACH_TARGET
def test_energy_is_that_of_the_program(name):
    shift = TARGETS[name].height_energy(QUARTER_TURN) - PRINTED_ENERGY[name](QUARTER_TURN)
    # up to a constant: two targets have coefficients of six digits, the others have all digits
    assert np.ptp(shift) <= (2e-5 if name in SIX_DIGIT_TARGETS else 1e-15)


def test_targets_have_known_values_at_three_angles():
    table = {
        "sine": (0, 0.5**0.5, 1),
        "progressive": (0, 1 - 0.5**0.5, 1),
        "progressive-degressive": (0, 0.5, 1),
        "degressive-progressive": (0, 0.5, 1),
        "sine180": (0, 1, 0),
    }
    for name, values in table.items():
        np.testing.assert_allclose(
            target(name, [0, np.pi / 4, np.pi / 2]), values, atol=1e-15, rtol=0
        )
    np.testing.assert_allclose(
        target("laevo", [0, np.pi / 4, np.pi / 2]), [-0.006501, 0.9715, 0.9258], rtol=0, atol=5.1e-5
    )  # four decimals
    assert target("laevo", 0.0) == -0.006501


@pytest.mark.parametrize("name", ["progressive-degressive", "degressive-progressive"])
def test_targets_are_odd_about_45_degrees(name):
    total = target(name, QUARTER_TURN) + target(name, QUARTER_TURN[::-1])
    np.testing.assert_allclose(total, 1.0, rtol=0, atol=1e-15)
    bend = np.diff(target(name, QUARTER_TURN), 2)[:40]
    assert np.all(bend > 0.0 if name == "progressive-degressive" else bend < 0.0)  # as named


def test_equation_28_is_too_coarse_for_its_table():
    """Line 2107 prints 0.0037, 99.66 %, by the program's coefficients, not by those of eq. 28."""
    moment = balancing_moment(2107)
    for coefficients, error, reduction in ((None, 0.00381, 99.61), (EQUATION_28, 0.01007, 98.96)):
        wanted = (
            target("laevo", PATH_ANGLES)
            if coefficients is None
            else np.polyval(coefficients, PATH_ANGLES)
        )
        # half a unit of the digits given, recomputed by an independent implementation
        assert measures.rmse(moment, wanted) == pytest.approx(error, abs=6e-6)
        assert measures.work_reduction(moment, wanted, PATH_ANGLES) == pytest.approx(
            reduction, abs=6e-3
        )
    # error of the search grid of the thesis: k_1 times half a step of 1.4e-3 rad
    assert measures.rmse(moment, target("laevo", PATH_ANGLES)) == pytest.approx(0.0037, abs=2e-3)


def test_unknown_target_is_refused():
    with pytest.raises(ValueError, match=r"target must be one of sine, .*, got 'cosine'"):
        target("cosine", 0.0)


def test_table_target_meets_its_points_without_overshoot():
    angles, moments = [0.0, 0.2, 0.5, 1.0, 1.5], [0.0, 0.9, 1.0, 1.0, 0.2]
    wanted = target_from_table(angles, moments)
    np.testing.assert_allclose(wanted(angles), moments, rtol=0, atol=1e-16)  # eps
    fine = wanted(np.linspace(0.0, 1.5, 301))
    assert fine.min() == 0.0
    assert fine.max() == 1.0
    lost, _ = quad(lambda a: float(wanted(a)), 0.0, 1.5, points=angles[1:-1])
    assert wanted.height_energy(np.array(1.5)) == pytest.approx(-lost, abs=1e-14)  # rounding


def test_table_target_is_exact_for_lines_and_converges_for_curves():
    line = target_from_table([0.0, 0.4, 1.6], [0.0, 0.2, 0.8])
    np.testing.assert_allclose(line(QUARTER_TURN), 0.5 * QUARTER_TURN, rtol=0, atol=2e-16)
    angle = np.linspace(0.0, np.pi / 2, 5001)
    for curve, order in ((np.exp, 3), (np.sin, 2)):  # the sine has an extreme at the end
        coarse, fine = (
            np.abs(target_from_table(nodes, curve(nodes))(angle) - curve(angle)).max()
            for nodes in (np.linspace(0.0, np.pi / 2, n) for n in (37, 73))
        )
        assert np.log2(coarse / fine) == pytest.approx(order, abs=0.15)  # of higher terms


@pytest.mark.parametrize(
    ("angles", "moments", "message"),
    [
        (
            [0.0, 1.0, 1.0],
            [0.0, 1.0, 2.0],
            "mine: angles must rise strictly, row 2 is 1 rad after 1",
        ),
        (
            [0.0, 2.0, 1.0],
            [0.0, 1.0, 2.0],
            "mine: angles must rise strictly, row 2 is 1 rad after 2",
        ),
        ([0.0, 1.0], [0.0, np.nan], "mine: moments must be finite, row 1 is nan"),
        ([-np.inf, 1.0], [0.0, 1.0], "mine: angles must be finite, row 0 is -inf"),
        ([0.0, 1.0], [0.0], r"mine: .* two columns of one size, at least 2, got \(2,\) and \(1,\)"),
        ([0.0], [0.0], "mine: .* at least 2"),
    ],
)
def test_bad_tables_are_refused(angles, moments, message):
    with pytest.raises(ValueError, match=message):
        target_from_table(angles, moments, name="mine")


@pytest.mark.parametrize("angle", [-0.1, 1.1, np.nan])
def test_angles_outside_a_table_are_refused(angle):
    wanted = target_from_table([0.0, 1.0], [0.0, 1.0])
    for curve in (wanted, wanted.height_energy):
        with pytest.raises(ValueError, match="outside its range 0 to 1 rad"):
            curve(np.array([0.5, angle]))


def test_precision_points_leave_out_zero():
    np.testing.assert_allclose(np.degrees(NINETY_POINTS), np.arange(1, 91), rtol=1e-15)
    with pytest.raises(ValueError, match="count must be at least 1"):
        measures.precision_points(0)


def test_measures_of_line_1766_are_those_recomputed():
    moment = balancing_moment(1766)
    error = moment - np.sin(PATH_ANGLES)
    assert measures.rmse(moment, np.sin(PATH_ANGLES)) == pytest.approx(
        np.linalg.norm(error) / 90**0.5, rel=1e-14, abs=0
    )
    assert measures.rmse(moment, np.sin(PATH_ANGLES)) == pytest.approx(0.006101, abs=1e-6)
    reduction = measures.work_reduction(moment, np.sin(PATH_ANGLES), PATH_ANGLES)
    assert reduction == pytest.approx(99.2994, abs=1e-4)
    # the print has noise of the thesis's grid: k_1 times half a step of 2.4e-3 rad in each moment
    assert reduction == pytest.approx(99.33, abs=0.05)
    with_zero = measures.work_reduction(
        np.insert(moment, 0, 0.0), np.sin(QUARTER_TURN), QUARTER_TURN
    )
    assert with_zero == pytest.approx(reduction, abs=0.02)  # as its docstring states


def test_locked_balancers_of_lines_1839_and_2167_have_printed_measures():
    """Balancers that never release have closed curves; their measures are those printed."""
    line = 0.5152 * PATH_ANGLES
    assert measures.rmse(line, target("progressive", PATH_ANGLES)) == pytest.approx(
        0.1021, abs=5.1e-5
    )
    assert measures.work_reduction(
        line, target("progressive", PATH_ANGLES), PATH_ANGLES
    ) == pytest.approx(75.13, abs=5.1e-3)
    curve = PATH_ANGLES * (2.4953 - 1.6017 * PATH_ANGLES)
    assert measures.rmse(curve, target("sine180", PATH_ANGLES)) == pytest.approx(0.0242, abs=5.1e-5)
    assert measures.work_reduction(
        curve, target("sine180", PATH_ANGLES), PATH_ANGLES
    ) == pytest.approx(96.73, abs=5.1e-3)


def test_work_reduction_has_its_known_limits():
    sine = np.sin(NINETY_POINTS)
    found = measures.work_reduction(np.stack([sine, 0.0 * sine, 3.0 * sine]), sine, NINETY_POINTS)
    np.testing.assert_allclose(found, [100.0, 0.0, -100.0], rtol=0, atol=1e-13)  # rounding
    with pytest.raises(ValueError, match="reference must do positive work"):
        measures.work_reduction(sine, -sine, NINETY_POINTS)


def test_work_reduction_and_scaled_rmse_have_no_units():
    moment, sine = balancing_moment(1766), np.sin(PATH_ANGLES)
    for scale in (1e-3, 58.6):
        assert measures.work_reduction(scale * moment, scale * sine, PATH_ANGLES) == pytest.approx(
            measures.work_reduction(moment, sine, PATH_ANGLES), rel=1e-14, abs=0
        )
        assert measures.rmse(scale * moment, scale * sine, scale=scale) == pytest.approx(
            measures.rmse(moment, sine), rel=1e-12, abs=0
        )  # eps over the error's size, 6e-3


def test_energy_spread_is_the_mean_distance_of_pairs():
    found = solve(PATH_ANGLES, **row_parameters(ROWS[1766]))
    energies = [found[f"energy{i}"] for i in (1, 2, 3)]
    pairs = sum((a - b) ** 2 for a, b in combinations(energies, 2))
    spread = measures.energy_spread(*energies)
    assert spread == pytest.approx(np.mean(np.sqrt(pairs)), rel=1e-14, abs=0)
    assert spread == pytest.approx(0.17331380, abs=5.1e-9)  # independent implementation
    assert measures.energy_spread(*energies, scale=2.0) == pytest.approx(
        spread / 2.0, rel=1e-15, abs=0
    )


def test_measures_take_a_batch():
    moments = np.stack([balancing_moment(line) for line in (1743, 1766, 1789)])
    sine = np.sin(PATH_ANGLES)
    for measure in (
        lambda m: measures.rmse(m, sine),
        lambda m: measures.energy_spread(m, 2 * m),
        lambda m: measures.work_reduction(m, sine, PATH_ANGLES),
    ):
        np.testing.assert_allclose(measure(moments), [measure(m) for m in moments], rtol=1e-14)
    batch = best_lines(PATH_ANGLES, moments, pieces=2)
    for row, moment in enumerate(moments):
        for many, one in zip(batch, best_lines(PATH_ANGLES, moment, pieces=2), strict=True):
            np.testing.assert_allclose(many[row], one, rtol=1e-12)
