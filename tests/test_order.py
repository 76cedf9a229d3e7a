"""pymunk converges with the second order of its step on every mechanism, by measurement."""

import numpy as np
import pytest

from benchmarks.order import cases, study

CASES = {case.name: case for case in cases("pymunk", [])}
# A second-order error e = a h^2 halves to order 2; higher terms and a first-order remainder of a
# tenth take at most 0.2 away.
ORDER = 1.8
# Share of range below which accelerations stop improving: the rounding of positions over the step
# squared, 1e-15 m / (0.25 ms)^2 = 2e-8 m/s^2, times the condition of the loop; more iterations do
# not lower it. At the steps of the models all cases are above it.
WALL = 2e-7


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_pymunk_is_second_order(name):
    found = study(CASES[name], "pymunk", levels=2)
    assert found.errors, "no channel was compared"
    for kind, errors in found.errors.items():
        order = found.orders(kind)[0]
        assert np.isfinite(errors).all(), kind
        assert order >= ORDER or errors[0] <= WALL, f"{kind}: order {order:.2f}, errors {errors}"
