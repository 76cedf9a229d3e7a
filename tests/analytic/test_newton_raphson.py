"""Newton-Raphson with a log: its order, its failures, and the drawn log."""

import numpy as np
import pytest

from proofmass.analytic.newton_raphson import (
    NotConverged,
    SingularJacobian,
    convergence_chart,
    newton_raphson,
)


def test_the_log_shows_quadratic_convergence():
    found = newton_raphson(lambda x: (x**2 - 2.0, np.diag(2.0 * x)), [1.5])
    assert found.root[0] == pytest.approx(np.sqrt(2.0), rel=1e-15, abs=0)  # rounding
    assert found.iterations == found.residuals.size
    # |dx_k+1| = dx_k^2/(2 x_k+1) for this equation
    assert found.steps[1] == pytest.approx(found.steps[0] ** 2 / (2.0 * 17 / 12), rel=1e-12, abs=0)
    assert found.residuals[0] == 0.25


def test_failures_are_typed_and_keep_their_log():
    with pytest.raises(NotConverged, match="no root in 7 iterations") as failure:
        newton_raphson(lambda x: (x**2 + 1.0, np.diag(2.0 * x)), [0.3], max_iterations=7)
    assert failure.value.log.iterations == 7
    assert not isinstance(failure.value, SingularJacobian)
    with pytest.raises(SingularJacobian, match="singular Jacobian at iteration 1"):
        newton_raphson(lambda x: (x**2 + 1.0, np.diag(2.0 * x)), [0.0])
    with pytest.raises(NotConverged, match="no root in 1 iterations: the last step is nan"):
        newton_raphson(lambda x: (x * np.nan, np.eye(1)), [1.0])
    with pytest.raises(SingularJacobian):
        newton_raphson(lambda x: (x, np.full((1, 1), np.nan)), [1.0])


def test_more_equations_than_unknowns_take_the_step_of_least_squares():
    def circle_and_line(x):  # three curves through (1, 1)
        return (
            np.array([x @ x - 2.0, x[0] - x[1], x[0] * x[1] - 1.0]),
            np.array([2.0 * x, [1.0, -1.0], x[::-1]]),
        )

    found = newton_raphson(circle_and_line, [2.0, 0.5])
    np.testing.assert_allclose(found.root, 1.0, rtol=1e-15)  # rounding


def test_the_log_has_every_iterate():
    found = newton_raphson(lambda x: (x**2 - 2.0, np.diag(2.0 * x)), [1.0])
    np.testing.assert_array_equal(found.values[:, 0], found.iterates[:-1, 0] ** 2 - 2.0)
    np.testing.assert_array_equal(found.jacobians[:, 0, 0], 2.0 * found.iterates[:-1, 0])
    np.testing.assert_array_equal(found.steps, np.abs(np.diff(found.iterates[:, 0])))


def test_the_convergence_chart_shows_the_log():
    found = newton_raphson(lambda x: (x**2 - 2.0, np.diag(2.0 * x)), [1.5], names=("x",))
    (panel,) = convergence_chart({"root of two": found}, "caption").panels
    lines = {line.label: line for line in panel.lines}
    assert list(lines) == ["x", "error: norm of the step", "residual"]
    for label, size in (("error: norm of the step", found.steps), ("residual", found.residuals)):
        kept = size > 1e-17
        np.testing.assert_array_equal(lines[label].y[kept], size[kept])
        assert np.isnan(lines[label].y[~kept]).all()
