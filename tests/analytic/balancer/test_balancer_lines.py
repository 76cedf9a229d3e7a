"""Best piecewise linear curves through the origin against a general fitter and the thesis."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from proofmass.analytic.balancer import solve
from proofmass.analytic.balancer.measures import TARGETS, precision_points, rmse, target
from proofmass.analytic.balancer.synthesis import THESIS_FIGURES
from tests.analytic.balancer.balancer_chain import ROWS, row_parameters
from tests.independent.balancer.lines import best_lines

NINETY_POINTS, FIFTEEN_POINTS = precision_points(90), precision_points(15)
# all targets in its column
TABULATED_TARGETS = list(dict.fromkeys(name for name, _ in THESIS_FIGURES))


def piecewise_linear(angle, kinks, slopes):
    corners = np.concatenate([[0.0], kinks, [np.pi / 2]])
    return np.interp(angle, corners, np.concatenate([[0.0], np.cumsum(slopes * np.diff(corners))]))


def best_general_rmse(angle, wanted, pieces):
    """Smallest rmse of a general least-squares fitter from many starts."""

    def error(x):
        kinks = np.sort(np.clip(x[: pieces - 1], 1e-6, np.pi / 2 - 1e-6))
        return (
            piecewise_linear(angle, kinks + 1e-9 * np.arange(pieces - 1), x[pieces - 1 :]) - wanted
        )

    random = np.random.default_rng(3)
    starts = np.hstack(
        [random.uniform(0.1, 1.5, (30, pieces - 1)), random.uniform(-1.0, 2.0, (30, pieces))]
    )
    return min(np.sqrt(2.0 * least_squares(error, start).cost / angle.size) for start in starts)


@pytest.mark.parametrize("pieces", [1, 2, 3])
@pytest.mark.parametrize("name", TABULATED_TARGETS)
def test_general_fitter_finds_nothing_better(name, pieces):
    wanted = target(name, FIFTEEN_POINTS)
    line = best_lines(FIFTEEN_POINTS, wanted, pieces)
    own = piecewise_linear(FIFTEEN_POINTS, line.kinks, line.slopes) - wanted
    assert np.sqrt(np.mean(own**2)) == pytest.approx(line.rmse, rel=1e-9)  # eps over the rmse
    general = best_general_rmse(FIFTEEN_POINTS, wanted, pieces)
    # least_squares stops at 1e-8 of its cost; from thirty starts it misses some minima
    assert line.rmse <= general * (1.0 + 1e-8)
    if pieces < 3:
        assert general == pytest.approx(line.rmse, rel=1e-4)


@pytest.mark.parametrize(
    ("name", "points", "kinks"),
    [
        ("laevo", NINETY_POINTS, (0.29113558, 0.7569241)),
        ("hardening-softening", NINETY_POINTS, (0.32600759, 1.21685418)),
        ("square-root", FIFTEEN_POINTS, (0.13207838, 0.67659907)),
    ],
)
def test_the_least_of_several_minima_is_found(name, points, kinks):
    """No error is larger than with the kinks that differential evolution found.

    The pieces through the values at the kinks are fitted as sums of hat functions.
    """
    wanted, nodes = target(name, points), np.array([0.0, *kinks, points[-1]])
    hats = np.stack([np.interp(points, nodes, row) for row in np.eye(4)[1:]], axis=1)
    values = np.linalg.lstsq(hats, wanted, rcond=None)[0]
    # the kinks have an error of 1e-8 rad, of which the error is the square
    assert best_lines(points, wanted, 3).rmse <= rmse(hats @ values, wanted) * (1.0 + 1e-12)


def test_slope_of_one_line_is_that_of_the_normal_equation():
    for name in TARGETS:
        wanted = target(name, NINETY_POINTS)
        found = best_lines(NINETY_POINTS, wanted)
        assert found.slopes == pytest.approx(
            NINETY_POINTS @ wanted / (NINETY_POINTS @ NINETY_POINTS), rel=1e-14, abs=0
        )
        assert found.kinks.size == 0
    many = precision_points(20_000)
    # continuous limit 3 (2/pi)^3 int a sin a da = 24/pi^3; the points' rule has an error of 1/n
    assert best_lines(many, np.sin(many)).slopes == pytest.approx(24.0 / np.pi**3, abs=5e-5)


@pytest.mark.parametrize("kinks", [(0.7,), (0.31, 1.13)])
def test_a_piecewise_linear_curve_is_recovered(kinks):
    slopes = np.array([1.5, 0.3, 0.9])[: len(kinks) + 1]
    found = best_lines(
        NINETY_POINTS, piecewise_linear(NINETY_POINTS, kinks, slopes), len(kinks) + 1
    )
    # 1e-7 is rounding of the fits; the lattice of kinks ends at 1e-14 rad
    np.testing.assert_allclose(found.kinks, kinks, rtol=0, atol=1e-7)
    np.testing.assert_allclose(found.slopes, slopes, rtol=0, atol=1e-7)
    assert found.rmse <= 1e-8


@pytest.mark.parametrize(
    ("name", "pieces", "points", "printed"),
    [
        ("sine", 2, NINETY_POINTS, 0.01664),
        ("sine", 3, FIFTEEN_POINTS, 0.007022),
        ("progressive", 2, NINETY_POINTS, 0.0176),
        ("progressive", 3, NINETY_POINTS, 0.007),
        ("laevo", 2, NINETY_POINTS, 0.0437),
    ],
)
def test_best_theoretical_approximations_are_those_printed(name, pieces, points, printed):
    found = best_lines(points, target(name, points), pieces).rmse
    assert found == pytest.approx(printed, abs=5.1e-5)  # four decimals, as the rest of the column


@pytest.mark.parametrize(
    ("name", "points", "printed"),
    [
        ("sine", NINETY_POINTS, 0.0861),
        ("progressive", NINETY_POINTS, 0.1016),
        ("laevo", NINETY_POINTS, 0.2755),
        ("laevo", FIFTEEN_POINTS, 0.2790),
    ],
)
def test_straight_lines_are_printed_with_zero_among_the_points(name, points, printed):
    """The print has one more point, angle 0 without error: the same squares over n + 1 points."""
    true = best_lines(points, target(name, points)).rmse
    with_zero = true * np.sqrt(points.size / (points.size + 1.0))
    # half a unit of the last digit, 0.10155 rounded twice, and three digits of 0.279
    assert with_zero == pytest.approx(printed, abs=5.1e-4 if printed == 0.279 else 5.3e-5)
    assert abs(true - printed) > 4e-4  # the column does not use the points of eq. 18


def test_misprints_of_the_column():
    """Sine of four segments 0.0913, progressive 0.1016, Laevo in three pieces 0.0207."""
    with_zero = np.sqrt(15.0 / 16.0)
    sine, progressive = (
        best_lines(FIFTEEN_POINTS, target(name, FIFTEEN_POINTS)).rmse * with_zero
        for name in ("sine", "progressive")
    )
    assert sine == pytest.approx(0.0909, abs=5.1e-5)
    assert progressive == pytest.approx(0.1036, abs=5.1e-5)  # the print repeats three segments
    for points, true in ((NINETY_POINTS, 0.0177), (FIFTEEN_POINTS, 0.0175)):
        laevo = best_lines(points, target("laevo", points), 3).rmse
        assert laevo == pytest.approx(true, abs=5.1e-5)
        assert laevo < 0.9 * 0.0207


def test_the_best_line_is_not_a_bound_for_balancers():
    """The optimum of line 1743, with linear springs only, is closer to the sine than the line."""
    moment = solve(NINETY_POINTS, **row_parameters(ROWS[1743]))["balancing_moment"]
    assert (
        rmse(moment, np.sin(NINETY_POINTS))
        < 0.98 * best_lines(NINETY_POINTS, np.sin(NINETY_POINTS)).rmse
    )


def test_too_few_points_are_refused():
    with pytest.raises(ValueError, match="angle must have more than 5 points, got 5"):
        best_lines(precision_points(5), np.ones(5), pieces=3)
