"""Residuals of measured curves: noise of the stated size passes, and each kind of error is seen."""

from collections.abc import Callable

import numpy as np
import pytest

from proofmass.base.arrays import Array
from proofmass.verdict.noise import (
    FALSE_REFUSALS,
    MIN_ESTIMATED_ROWS,
    MIN_MEASURED_ROWS,
    NUMBERS_SHARE,
    TEST_SHARE,
    ZEROS_SHARE,
    MeasuredCurve,
    TooFewRows,
    correlated_limit,
    estimate_sigma,
    fit_numbers,
    fit_residual,
    largest_limit,
)

ROWS, SIGMA = 401, 0.01
X = np.linspace(0.0, 6.0, ROWS)
SMOOTH = np.sin(X)
SEEDS = 400


def noise(seed: int, rows: int = ROWS) -> Array:
    """Independent normal noise."""
    return SIGMA * np.random.default_rng(seed).standard_normal(rows)


def measured(values: Array) -> MeasuredCurve:
    """A measured curve beside the sine."""
    return MeasuredCurve(X, values, X, SMOOTH)


def failing(values: Array, sigma: float | None = SIGMA) -> set[str]:
    """Names of the tests that a measured curve does not pass."""
    tests = fit_residual(measured(values), sigma).tests(FALSE_REFUSALS)
    return {one.name for one in tests if not one.passes}


def test_the_shares_of_all_tests_make_up_the_false_refusals() -> None:
    assert round(4 * TEST_SHARE + NUMBERS_SHARE + ZEROS_SHARE, 12) == 1.0


@pytest.mark.parametrize("sigma", [SIGMA, None])
def test_noise_of_the_stated_size_is_refused_as_rarely_as_stated(sigma: float | None) -> None:
    """Refused in 0.3 % of measurements by the four tests; more than 6 of 400 has a chance of 1e-4.

    The seeds are fixed, so that the count is always the same.
    """
    refused = sum(bool(failing(SMOOTH + noise(seed), sigma)) for seed in range(SEEDS))
    assert refused <= 6


def one_row_off(values: Array) -> Array:
    """A row that is six standard deviations off: the others are as they were."""
    values = values.copy()
    values[200] = SMOOTH[200] + 6.0 * SIGMA
    return values


ERRORS: dict[str, tuple[Callable[[Array], Array], set[str]]] = {
    "largest": (one_row_off, {"largest"}),
    "mean": (lambda values: values + 0.3 * SIGMA, {"mean"}),
    "rms": (lambda values: SMOOTH + 1.3 * (values - SMOOTH), {"rms"}),
    "neighbours": (
        lambda values: SMOOTH + np.convolve(values - SMOOTH, [0.6, 0.64, 0.48], "same"),
        {"neighbours"},
    ),
}


@pytest.mark.parametrize("name", ERRORS)
def test_each_test_sees_the_error_that_it_is_for(name: str) -> None:
    error, expected = ERRORS[name]
    assert failing(error(SMOOTH + noise(1))) == expected


def test_a_slow_error_below_the_noise_is_seen_by_its_neighbours() -> None:
    """A wave of 0.6 standard deviations, which no single row shows."""
    assert "neighbours" in failing(SMOOTH + noise(2) + 0.6 * SIGMA * np.cos(5.0 * X))


def test_an_estimate_of_the_noise_does_not_hide_a_smooth_error() -> None:
    """Second differences do not see the wave, so that the root mean square does."""
    wave = 2.0 * SIGMA * np.cos(5.0 * X)
    assert estimate_sigma(noise(3) + wave) == pytest.approx(SIGMA, rel=0.15)  # 3 standard errors
    assert {"rms", "neighbours"} <= failing(SMOOTH + noise(3) + wave, sigma=None)


def test_fitted_zero_and_lag_have_the_errors_that_are_stated() -> None:
    """Over 200 seeds they scatter by their standard errors: by 1 with an error of 5 %."""
    ratios = []
    for seed in range(200):
        values = np.sin(X + 0.03) + 0.2 + noise(seed)
        fits = fit_residual(measured(values), SIGMA, ("zero", "lag")).fits
        ratios.append(
            [
                (fits["zero"].value - 0.2) / fits["zero"].error,
                (fits["lag"].value - 0.03) / fits["lag"].error,
            ]
        )
    spread = np.std(ratios, axis=0)
    assert np.abs(spread - 1.0).max() < 0.15
    assert np.abs(np.mean(ratios, axis=0)).max() < 0.3  # four standard errors of the mean


def test_a_lag_that_is_not_fitted_is_no_noise() -> None:
    values = np.sin(X + 0.01) + noise(4)
    assert failing(values)
    residual = fit_residual(measured(values), SIGMA, ("lag",))
    assert residual.is_noise(FALSE_REFUSALS)


def test_rows_between_the_samples_get_the_curve_there() -> None:
    """The sine is known at 61 samples, and measured at 401 uneven rows."""
    samples, rows = np.linspace(0.0, 6.0, 61), 6.0 * np.linspace(0.0, 1.0, ROWS) ** 1.2
    curve = MeasuredCurve(rows, np.sin(rows), samples, np.sin(samples))
    error = fit_residual(curve, SIGMA).values
    assert 0.0 < np.abs(error).max() < 5.0 / 384.0 * 0.1**4  # of a cubic spline of the sine


@pytest.mark.parametrize(
    ("sigma", "least"), [(SIGMA, MIN_MEASURED_ROWS), (None, MIN_ESTIMATED_ROWS)]
)
def test_few_rows_are_not_judged(sigma: float | None, least: int) -> None:
    x = np.linspace(0.0, 1.0, least)
    assert fit_residual(MeasuredCurve(x, x, x, x + noise(5, least)), sigma).count == least
    with pytest.raises(TooFewRows, match=f"{least - 1} rows are too few"):
        fit_residual(MeasuredCurve(x[1:], x[1:], x[1:], x[1:]), sigma)


def test_the_largest_of_some_normal_numbers_passes_the_limit_as_rarely_as_stated() -> None:
    """Ten thousand draws of 40: 500 are expected, with a standard deviation of 22."""
    draws = np.abs(np.random.default_rng(6).standard_normal((10000, 40))).max(axis=1)
    assert abs(int((draws > largest_limit(40, 0.05)).sum()) - 500) < 88


@pytest.mark.parametrize("seed", range(4))
def test_the_limit_of_correlated_numbers_is_a_bound_and_not_a_loose_one(seed: int) -> None:
    """Five numbers of random correlation, 200,000 draws: 2000 are expected at a chance of 1 %."""
    rng = np.random.default_rng(seed)
    rows = rng.standard_normal((5, 3)) + rng.standard_normal(3)
    rows /= np.linalg.norm(rows, axis=1)[:, None]
    limit = correlated_limit(rows @ rows.T, 0.01)
    draws = np.abs(rng.standard_normal((200_000, 3)) @ rows.T).max(axis=1)
    found = int((draws > limit).sum())
    assert 1500 < found < 2000 + 4 * 45
    assert limit < largest_limit(5, 0.01)


def test_a_number_is_fitted_with_its_standard_error() -> None:
    """The slope of the sine's size has the norm sqrt(sum sin^2), so the error is sigma over it."""
    curve = measured(1.004 * SMOOTH + noise(7))
    found = fit_numbers([fit_residual(curve, SIGMA)], {"size": [SMOOTH]}, 0.01)
    change = found.changes["size"]
    assert change.error == pytest.approx(SIGMA / np.linalg.norm(SMOOTH), rel=1e-12)
    assert change.value == pytest.approx(0.004, abs=4.0 * change.error)
    assert not found.passes


def test_a_number_that_the_fits_of_the_recording_explain_is_left_out() -> None:
    residual = fit_residual(measured(SMOOTH + noise(8)), SIGMA, ("zero",))
    slopes = {"offset": [np.full(ROWS, 3.0)], "hidden": [1e-3 * SMOOTH], "size": [SMOOTH]}
    assert list(fit_numbers([residual], slopes, 0.01).changes) == ["size"]
