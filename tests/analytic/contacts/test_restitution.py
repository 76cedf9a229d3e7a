"""The restitution of a damped spring near critical damping, against a series."""

from decimal import Decimal

import numpy as np
import pytest

from proofmass.analytic.contacts import restitution


def restitution_by_series(z):
    """Restitution by a series of 28 digits, which converges for 0 <= z <= 1.5.

    With d = 1 - z, acos(z)/(1 - z^2)^(1/2) = 1 + 1/3 d + (1/3) (2/5) d^2 + (1/3) (2/5) (3/7) d^3 ..
    """
    d = 1 - Decimal(z)
    total, term = Decimal(0), Decimal(1)
    for n in range(200):
        total += term
        term *= d * (n + 1) / (2 * n + 3)
    return float((-2 * Decimal(z) * total).exp())


@pytest.mark.parametrize("shift", [0.0, 1e-12, 9e-7, 1e-5, 1e-3, 0.1, 0.5])
def test_restitution_near_critical_damping_is_that_of_a_series(shift):
    for z in (1.0 - shift, 1.0 + shift):
        # rounding of four functions and of an exponent of up to 2.5
        assert restitution(z) == pytest.approx(restitution_by_series(z), rel=2e-15, abs=0)


@pytest.mark.parametrize("ratio", [-0.5, np.nan, np.inf])
def test_a_damping_ratio_that_is_negative_or_not_finite_is_refused(ratio):
    with pytest.raises(ValueError, match="damping_ratio must be zero or positive"):
        restitution(ratio)


def test_restitution_of_large_damping_ratios_tends_to_zero():
    """For large z the restitution is (2 z)^-2, and not 1 where z^2 overflows."""
    assert restitution(1e9) == pytest.approx(0.25e-18, rel=1e-12, abs=0)  # exponent 43 rounded
    assert restitution(1e200) == 0.0
