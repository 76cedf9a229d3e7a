"""The printed log of Newton-Raphson, ranks and condition numbers."""

import re

import numpy as np
import pytest

from proofmass.analytic.newton_raphson import SingularJacobian, newton_raphson
from teaching.newton_log import FoldedLog, condition_numbers, format_log, jacobian_ranks


def test_one_equation_has_rank_and_condition_number_one():
    found = newton_raphson(lambda x: (x**2 - 2.0, np.diag(2.0 * x)), [1.5])
    np.testing.assert_array_equal(jacobian_ranks(found), np.ones(found.iterations))
    np.testing.assert_array_equal(condition_numbers(found), np.ones(found.iterations))


def test_the_log_prints_every_iterate():
    found = newton_raphson(lambda x: (x**2 - 2.0, np.diag(2.0 * x)), [1.0], names=("root",))
    text = format_log(found)
    assert text.count("\n") == 3 * found.iterations
    assert text.startswith("iteration 1: |Phi| = 1.000e+00, rank 1, error |dq| = 5.000e-01\n")
    assert text.endswith("after 5 iterations: root = 1.41421356")


def test_columns_stay_in_line_with_more_equations_than_unknowns():
    """Three curves through (1, 1): the third row of Phi and J has no unknown before it."""
    found = newton_raphson(
        lambda x: (
            np.array([x @ x - 2.0, x[0] - x[1], x[0] * x[1] - 1.0]),
            np.array([2.0 * x, [1.0, -1.0], x[::-1]]),
        ),
        [2.0, 0.5],
    )
    assert jacobian_ranks(found)[-1] == 2
    end = len("  q1   2.00000000") + 1
    rows = format_log(found).splitlines()[2:5]
    assert [row[:end].split() for row in rows] == [["q1", "2.00000000"], ["q2", "0.50000000"], []]
    assert [float(row[end : end + 12]) for row in rows] == [2.25, 1.5, 0.0]


def test_the_log_of_a_failure_is_printed():
    with pytest.raises(SingularJacobian) as failure:
        newton_raphson(lambda x: (x**2 + 1.0, np.diag(2.0 * x)), [0.0])
    assert failure.value.log.iterations == 0
    assert format_log(failure.value.log) == "after 0 iterations: q1 = 0.00000000"


def test_the_rank_falls_at_a_double_root():
    """At a double root of one of two equations the rank falls to one, and convergence is linear."""
    found = newton_raphson(
        lambda x: (np.array([x[0] ** 2, x[1] - 1.0]), np.diag([2.0 * x[0], 1.0])),
        [1.0, 0.0],
        tolerance=1e-7,
    )
    assert jacobian_ranks(found)[0] == 2
    assert jacobian_ranks(found)[-1] == 1
    np.testing.assert_allclose(found.steps[2:] / found.steps[1:-1], 0.5, rtol=1e-14)  # rounding


def test_a_folded_log_shows_each_step_over_the_square_of_the_one_before():
    """For the square root of 2 this tends to 1/(2 sqrt 2), half of F'' over F' at the root."""
    found = newton_raphson(lambda x: (x**2 - 2.0, np.diag(2.0 * x)), [1.0], names=("<root>",))
    html = FoldedLog(found, {"iteration": "iteración"})._repr_html_()
    rows = [re.findall(r"<td>(.*?)</td>", row) for row in html.split("<tr>")[2:]]
    assert [int(row[0]) for row in rows] == [1, 2, 3, 4, 5]
    steps = [float(row[2]) for row in rows]
    np.testing.assert_allclose(steps, found.steps, rtol=1e-3)  # four printed digits
    shares = [float(row[3]) for row in rows[1:4]]
    np.testing.assert_allclose(shares, np.array(steps[1:4]) / np.square(steps[:3]), rtol=5e-3)
    assert shares[-1] == pytest.approx(1.0 / np.sqrt(8.0), rel=0.01)
    assert rows[0][3] == ""
    assert "<th>iteración</th>" in html
    assert "&lt;root&gt;" in html
    assert repr(FoldedLog(found)) == format_log(found)


def test_a_folded_log_without_iterations_has_no_rows():
    with pytest.raises(SingularJacobian) as failure:
        newton_raphson(lambda x: (x**2 + 1.0, np.diag(2.0 * x)), [0.0])
    assert FoldedLog(failure.value.log)._repr_html_().count("<tr>") == 1
