"""Newton-Raphson and the hacksaw's use of it: the report's counts, Jacobian, sweep, branches."""

import json
from pathlib import Path

import numpy as np
import pytest

from proofmass.analytic.linkages import hacksaw
from tests.independent import hacksaw_newton
from tests.independent.newton_raphson import NotConverged, Singular, newton_raphson

FILE = Path(__file__).parents[2] / "data" / "newton_raphson.json"
DATA = json.loads(FILE.read_text())["hacksaw"]
LINK = {"crank": 0.075, "coupler": 0.170, "offset": 0.045}
REST = (0.0, 0.0, 0.0)
POSITION = hacksaw_newton.NAMES[:3]
VARIANTS = pytest.mark.parametrize("reduced", [False, True], ids=["plain", "reduced"])
GRID = hacksaw.motor(np.linspace(0.0, 2.0 * hacksaw.turn_time(), DATA["sweep"]["points"]))


def printed_equations(x, law):
    """The report's nine equations, text lines 300-338, with theta3 where it misprints theta2."""
    (r1, t1, t3, v, w1, w3, a, dw1, dw3), (t2, w2, dw2) = x, law
    r2, r3 = LINK["crank"], LINK["coupler"]
    (c1, s1), (c2, s2), (c3, s3) = ((np.cos(t), np.sin(t)) for t in (t1, t2, t3))
    guide = -r1 * s1 * w1**2 + 2 * v * c1 * w1 + a * s1 + dw1 * r1 * c1
    return np.array(
        [
            r1 * s1 - LINK["offset"],
            -r1 * c1 + r2 * c2 + r3 * c3,
            r1 * s1 - r2 * s2 - r3 * s3,
            v * s1 + w1 * r1 * c1,
            w1 * r1 * s1 - v * c1 - w2 * r2 * s2 - w3 * r3 * s3,
            v * s1 + w1 * r1 * c1 - w2 * r2 * c2 - w3 * r3 * c3,
            guide,
            r1 * c1 * w1**2
            + 2 * v * s1 * w1
            - r2 * c2 * w2**2
            - r3 * c3 * w3**2
            - a * c1
            + dw1 * r1 * s1
            - dw2 * r2 * s2
            - dw3 * r3 * s3,
            guide + r2 * s2 * w2**2 + r3 * s3 * w3**2 - dw2 * r2 * c2 - dw3 * r3 * c3,
        ]
    )


def complex_step(function, x):
    steps = x[:, None] + 1e-30j * np.eye(x.size)
    return np.array([function(step).imag for step in steps.T]).T / 1e-30


@VARIANTS
@pytest.mark.parametrize("start", ["text", "code"])
def test_printed_iterations_and_root_at_the_start(start, reduced):
    counts, first = DATA["iterations"], DATA["starts"][start]
    one, (nine,) = hacksaw_newton.pose(REST, first, **LINK, reduced=reduced)
    each, logs = hacksaw_newton.pose(REST, first, **LINK, reduced=reduced, simultaneous=False)
    assert nine.iterations == counts["simultaneous"]
    assert [s.iterations for s in logs] == [
        counts[n] for n in ("position", "velocity", "acceleration")
    ]
    for root in (one, each):
        np.testing.assert_allclose(root[:3], DATA["root"], rtol=0, atol=5.1e-7)  # last printed
        np.testing.assert_allclose(root[3:], 0.0, rtol=0, atol=1e-12)  # step squared, 1e-6


def test_the_printed_count_for_accelerations_is_that_of_the_positions():
    _, (position, _, acceleration) = hacksaw_newton.pose(
        REST, DATA["starts"]["code"], **LINK, simultaneous=False
    )
    assert acceleration.iterations == 2  # linear: one step solves, the next confirms
    as_printed = 1 + np.argmax(position.steps < DATA["sweep"]["step"])  # line 1420 tests these
    assert as_printed == DATA["iterations"]["acceleration_printed"] != acceleration.iterations


@VARIANTS
def test_all_81_entries_of_the_jacobian_by_complex_step(reduced):
    numbers = np.random.default_rng(3)
    for _ in range(20):
        x, law = numbers.uniform(-2.0, 2.0, 9), numbers.uniform(-2.0, 2.0, 3)

        def equations(x, law=law):
            rows = printed_equations(x, law)
            if reduced:  # lines 1296, 1304: r1 = offset/sin(theta1) in the loop rows of position
                sine = LINK["offset"] / np.sin(x[1])
                rows[1:3] = printed_equations(np.array([sine, *x[1:]]), law)[1:3]
            return rows

        residual, jacobian = hacksaw_newton.system(x, law, **LINK, reduced=reduced)
        scale = np.abs(jacobian).max()  # large in the reduced rows, 1/sin(theta1)^2
        np.testing.assert_allclose(residual, equations(x), rtol=0, atol=1e-14 * scale)  # rounding
        np.testing.assert_allclose(
            jacobian, complex_step(equations, x), rtol=0, atol=1e-14 * scale
        )  # rounding; the step itself has no error


def test_line_1109_prints_two_wrong_entries_of_row_7():
    x, law = (
        hacksaw_newton.pose([2.0, 5.0, 3.0], hacksaw_newton.SWEEP_GUESS, **LINK)[0],
        [2.0, 5.0, 3.0],
    )
    r1, t1, w1 = x[0], x[1], x[4]
    true = complex_step(lambda x: printed_equations(x, law), x)
    assert true[6, 6:8] == pytest.approx([np.sin(t1), r1 * np.cos(t1)], rel=1e-14)  # rounding
    assert np.abs(true[6, 6:8] - [2.0 * w1 * np.cos(t1), np.cos(t1)]).min() > 0.1


@pytest.fixture(scope="module")
def sweeps():
    return {way: hacksaw_newton.solve(*GRID, **LINK, simultaneous=way) for way in (True, False)}


def test_sweep_with_continuation_follows_the_closed_form(sweeps):
    truth = hacksaw.solve(*GRID, **LINK)
    # simultaneous: rounding, 1e-14 (the report's own bound); sequential: it stops at a step of
    # 1e-6, whose square is left, and takes it along into rates and accelerations
    for way, bound in ((True, DATA["sweep"]["simultaneous_against_analytic"]), (False, 2e-12)):
        for name in hacksaw_newton.NAMES:
            assert np.abs(sweeps[way][name] - truth[name]).max() < bound, name
        assert sweeps[way]["last_step"].max() < DATA["sweep"]["step"]
        assert sweeps[way]["iterations"].max() <= 4


def test_simultaneous_against_sequential_as_the_report_compares_them(sweeps):
    together = np.array(
        [[sweeps[way][name] for name in hacksaw_newton.NAMES] for way in (True, False)]
    )
    difference = np.linalg.norm(together[0] - together[1], axis=0)
    # the report: of the order of 1e-12, and the step of the simultaneous way usually the larger
    assert 0.5 < difference.max() / DATA["sweep"]["simultaneous_against_sequential"] < 5.0
    assert np.mean(sweeps[True]["last_step"] > sweeps[False]["last_step"]) > 0.8


def test_four_branches_at_the_start():
    """Two assemblies, each with r1 of either sign; any of them is a root, only one is drawn."""
    found = set()
    for theta1 in (-2.5, -0.5, 0.5, 2.5):
        for theta3 in (0.3, 2.9):
            start = [-0.1, theta1, theta3, *np.zeros(6)]
            root, _ = hacksaw_newton.pose(REST, start, **LINK, simultaneous=False, most=50)
            point = root[0] * np.exp(1j * root[1])
            found.add((bool(root[0] > 0.0), bool(point.real > 0.0)))
            mode = -1 if point.real > 0.0 else 1
            truth = hacksaw.solve(*REST, **LINK, mode=mode)
            assert abs(point - truth["slider_x"] - 1j * LINK["offset"]) < 1e-11  # step^2
            assert np.cos(root[2] - truth["theta3"]) == pytest.approx(1.0, abs=1e-15)  # rounding
    assert len(found) == 4


def test_log_of_a_quadratic_convergence():
    found = newton_raphson(lambda x: (x**2 - 2.0, np.diag(2.0 * x)), [1.5])
    assert found.root[0] == pytest.approx(np.sqrt(2.0), rel=1e-15)  # rounding
    assert found.iterations == found.residuals.size == found.ranks.size == found.conditions.size
    assert np.all(found.ranks == 1)
    assert np.all(found.conditions == 1.0)
    # |dx_k+1| = dx_k^2/(2 x_k+1) for this equation
    assert found.steps[1] == pytest.approx(found.steps[0] ** 2 / (2.0 * 17 / 12), rel=1e-12)
    assert found.residuals[0] == 0.25


def test_failures_are_typed_and_keep_their_log():
    with pytest.raises(NotConverged, match="no root in 7 iterations") as failure:
        newton_raphson(lambda x: (x**2 + 1.0, np.diag(2.0 * x)), [0.3], most=7)
    assert failure.value.solution.iterations == 7
    assert not isinstance(failure.value, Singular)
    with pytest.raises(Singular, match="singular Jacobian at iteration 1"):
        newton_raphson(lambda x: (x**2 + 1.0, np.diag(2.0 * x)), [0.0])
    with pytest.raises(NotConverged, match="no root in 1 iterations: the last step is nan"):
        newton_raphson(lambda x: (x * np.nan, np.eye(1)), [1.0])
    with pytest.raises(Singular):
        newton_raphson(lambda x: (x, np.full((1, 1), np.nan)), [1.0])
    limit = np.arcsin((0.045 - 0.1) / 0.075)  # beyond it the coupler is too short for the guide
    law = np.linspace(0.0, 2.0 * limit, 20)
    with pytest.raises(NotConverged, match=rf"at angle {law[10]:.9g} rad: no root in 50"):
        hacksaw_newton.solve(law, 0.0, 0.0, **{**LINK, "coupler": 0.1})


def test_more_equations_than_unknowns_take_the_step_of_least_squares():
    def circle_and_line(x):  # three curves through (1, 1)
        return (
            np.array([x @ x - 2.0, x[0] - x[1], x[0] * x[1] - 1.0]),
            np.array([2.0 * x, [1.0, -1.0], x[::-1]]),
        )

    found = newton_raphson(circle_and_line, [2.0, 0.5])
    np.testing.assert_allclose(found.root, 1.0, rtol=1e-15)  # rounding
    assert found.ranks[-1] == 2
