"""Newton-Raphson of the hacksaw against the report: iterations, Jacobian, sweep, branches."""

import json
from pathlib import Path

import numpy as np
import pytest

from proofmass.analytic.linkages import hacksaw
from proofmass.analytic.newton_raphson import NotConverged

FILE = Path(__file__).parents[2] / "data" / "newton_raphson.json"
DATA = json.loads(FILE.read_text())["hacksaw"]
LINK = {"crank": 0.075, "coupler": 0.170, "offset": 0.045}
REST = (0.0, 0.0, 0.0)
POSITION_NAMES = hacksaw.UNKNOWNS[:3]
VARIANTS = pytest.mark.parametrize("reduced", [False, True], ids=["plain", "reduced"])
SWEEP_MOTION = hacksaw.motor(np.linspace(0.0, 2.0 * hacksaw.turn_time(), DATA["sweep"]["points"]))


def printed_equations(x, crank_motion):
    """The report's nine equations, text lines 300-338, with theta3 where it misprints theta2."""
    (r1, t1, t3, v, w1, w3, a, dw1, dw3), (t2, w2, dw2) = x, crank_motion
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
    one, (nine,) = hacksaw.newton_pose(REST, first, **LINK, reduced=reduced)
    each, logs = hacksaw.newton_pose(REST, first, **LINK, reduced=reduced, simultaneous=False)
    assert nine.iterations == counts["simultaneous"]
    assert [s.iterations for s in logs] == [
        counts[n] for n in ("position", "velocity", "acceleration")
    ]
    for root in (one, each):
        np.testing.assert_allclose(root[:3], DATA["root"], rtol=0, atol=5.1e-7)  # last printed
        np.testing.assert_allclose(root[3:], 0.0, rtol=0, atol=1e-12)  # square of the step, 1e-6


def test_the_printed_count_for_accelerations_is_that_of_the_positions():
    _, (position, _, acceleration) = hacksaw.newton_pose(
        REST, DATA["starts"]["code"], **LINK, simultaneous=False
    )
    assert acceleration.iterations == 2  # linear: one step solves, the next confirms
    as_printed = 1 + np.argmax(position.steps < DATA["sweep"]["step"])  # line 1420 tests positions
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

        residual, jacobian = hacksaw.newton_system(x, law, **LINK, reduced=reduced)
        scale = np.abs(jacobian).max()  # large in the reduced rows, 1/sin(theta1)^2
        np.testing.assert_allclose(residual, equations(x), rtol=0, atol=1e-14 * scale)  # rounding
        np.testing.assert_allclose(
            jacobian, complex_step(equations, x), rtol=0, atol=1e-14 * scale
        )  # rounding; the step itself has no error


def test_line_1109_prints_two_wrong_entries_of_row_7():
    x, law = (
        hacksaw.newton_pose([2.0, 5.0, 3.0], hacksaw.SWEEP_GUESS, **LINK)[0],
        [2.0, 5.0, 3.0],
    )
    r1, t1, w1 = x[0], x[1], x[4]
    true = complex_step(lambda x: printed_equations(x, law), x)
    assert true[6, 6:8] == pytest.approx(
        [np.sin(t1), r1 * np.cos(t1)], rel=1e-14, abs=0
    )  # rounding
    assert np.abs(true[6, 6:8] - [2.0 * w1 * np.cos(t1), np.cos(t1)]).min() > 0.1


@pytest.fixture(scope="module")
def sweeps():
    return {
        way: hacksaw.newton_sweep(*SWEEP_MOTION, **LINK, simultaneous=way) for way in (True, False)
    }


def test_sweep_with_continuation_follows_the_closed_form(sweeps):
    truth = hacksaw.solve(*SWEEP_MOTION, **LINK)
    # simultaneous: rounding, 1e-14 (the report's own bound); sequential: it stops at a step of
    # 1e-6, whose square remains as an error, also of the rates and accelerations
    for way, bound in ((True, DATA["sweep"]["simultaneous_against_analytic"]), (False, 2e-12)):
        for name in hacksaw.UNKNOWNS:
            assert np.abs(sweeps[way][name] - truth[name]).max() < bound, name
        assert sweeps[way]["last_step"].max() < DATA["sweep"]["step"]
    assert set(sweeps[True]["iterations"][1:]) <= {2, 3, 4}
    # each linear system takes a step and one to confirm it, or none if nothing moves
    assert set(sweeps[False]["iterations"][1:]) <= {2 + 2 + 2, 3 + 2 + 2, 5}


def test_simultaneous_and_sequential_forms_differ_as_in_the_report(sweeps):
    together = np.array([[sweeps[way][name] for name in hacksaw.UNKNOWNS] for way in (True, False)])
    difference = np.linalg.norm(together[0] - together[1], axis=0)
    # the report: of the order of 1e-12, and the step of the simultaneous form is usually larger
    assert 0.5 < difference.max() / DATA["sweep"]["simultaneous_against_sequential"] < 5.0
    assert np.mean(sweeps[True]["last_step"] > sweeps[False]["last_step"]) > 0.8


def test_four_branches_at_the_start():
    """Two assembly modes, each with r1 of either sign, are roots; the report draws only one."""
    found = set()
    for theta1 in (-2.5, -0.5, 0.5, 2.5):
        for theta3 in (0.3, 2.9):
            start = [-0.1, theta1, theta3, *np.zeros(6)]
            root, _ = hacksaw.newton_pose(
                REST, start, **LINK, simultaneous=False, max_iterations=50
            )
            point = root[0] * np.exp(1j * root[1])
            found.add((bool(root[0] > 0.0), bool(point.real > 0.0)))
            mode = -1 if point.real > 0.0 else 1
            truth = hacksaw.solve(*REST, **LINK, mode=mode)
            assert abs(point - truth["slider_x"] - 1j * LINK["offset"]) < 1e-11  # step^2
            assert np.cos(root[2] - truth["theta3"]) == pytest.approx(1.0, abs=1e-15)  # rounding
    assert len(found) == 4


@pytest.mark.parametrize("name", ["angle", "rate", "acceleration", "crank", "offset"])
def test_a_sweep_refuses_a_number_that_is_not_finite(name):
    arguments = {"angle": [0.0, 0.1], "rate": 0.0, "acceleration": 0.0, **LINK}
    with pytest.raises(ValueError, match=f"^{name} must be finite"):
        hacksaw.newton_sweep(**{**arguments, name: np.nan})


def test_a_sweep_without_poses_has_no_rows():
    sweep = hacksaw.newton_sweep([], 0.0, 0.0, **LINK)
    assert {curve.shape for curve in sweep.values()} == {(0,)}


def test_a_loop_that_cannot_close_names_its_angle():
    limit = np.arcsin((0.045 - 0.1) / 0.075)  # beyond it the coupler does not reach the guide
    law = np.linspace(0.0, 2.0 * limit, 20)
    with pytest.raises(NotConverged, match=rf"at angle {law[10]:.9g} rad: no root in 50"):
        hacksaw.newton_sweep(law, 0.0, 0.0, **{**LINK, "coupler": 0.1})


def printed_inverses(r1, theta1, theta3):
    """Annex C.1 to C.3, text lines 1000-1059, as the report prints them."""
    r3, offset = LINK["coupler"], LINK["offset"]
    c1, s1, c3, s3 = np.cos(theta1), np.sin(theta1), np.cos(theta3), np.sin(theta3)
    square = 1.0 / np.tan(theta1) ** 2 + 1.0  # sigma1 of C.1
    sigma1, sigma2 = r1 * c3 * c1**2 + r1 * c3 * s1**2, c3 * c1**2 + c3 * s1**2
    sigma3, sigma4, sigma5 = s1 * s3, c1 * s3, 1.0 / (r3 * c3)
    unit, each = c1**2 + s1**2, r1 * c1**2 + r1 * s1**2
    position = [
        [1 / s1, -r1 * c1 / (offset * s1 * square), r1 * c1 * s3 / (offset * c3 * s1 * square)],
        [0.0, 1 / (offset * square), -s3 / (offset * c3 * square)],
        [0.0, 0.0, -1 / (r3 * c3)],
    ]
    by_x = [-c1 / unit, s1 / each, 0.0]
    by_y = [sigma4 / sigma2, -sigma3 / sigma1, -sigma5]
    by_guide = [-(sigma4 - c3 * s1) / sigma2, (c1 * c3 + sigma3) / sigma1, sigma5]
    velocity = np.transpose([by_x, by_y, by_guide])  # rows of F: x, y, guide
    acceleration = np.transpose([by_guide, by_x, by_y])  # guide, x, y
    return np.array(position), velocity, acceleration


def test_printed_inverse_jacobians_of_annex_c_are_right():
    """All three are right, that of C.1 only at roots, where r1 = offset/sin(theta1)."""
    numbers = np.random.default_rng(5)
    for _ in range(20):
        law = numbers.uniform(-3.0, 3.0, 3)
        x, _ = hacksaw.newton_pose(law, DATA["starts"]["code"], **LINK, max_iterations=50)
        position, velocity, acceleration = printed_inverses(*x[:3])
        _, plain = hacksaw.newton_system(x, law, *LINK.values())
        _, reduced = hacksaw.newton_system(x, law, *LINK.values(), reduced=True)
        guide, along_x, along_y = plain[:3, :3]
        scale = np.abs(position).max() * np.abs(reduced[:3, :3]).max()
        for inverse, jacobian in (
            (position, reduced[:3, :3]),
            (velocity, np.array([along_x, along_y, guide])),
            (acceleration, plain[:3, :3]),
        ):
            np.testing.assert_allclose(
                inverse @ jacobian, np.eye(3), rtol=0, atol=1e-14 * scale
            )  # rounding
        # each diagonal block of the nine equations equals the block of the positions
        np.testing.assert_array_equal(plain[3:6, 3:6], plain[:3, :3])
        np.testing.assert_array_equal(plain[6:, 6:], plain[:3, :3])
        # a wrong sign of one printed entry would be noticed
        position[1, 2] *= -1.0
        assert np.abs(position @ reduced[:3, :3] - np.eye(3)).max() > 1e-3


def test_determinant_of_the_jacobian_has_its_closed_form():
    """|det J| = |r1 r3 cos(theta3)|: zero with coupler upright or slider above the axis."""
    x, _ = hacksaw.newton_pose(REST, DATA["starts"]["code"], **LINK)
    _, jacobian = hacksaw.newton_system(x, REST, *LINK.values())
    one = x[0] * LINK["coupler"] * np.cos(x[2])
    assert abs(np.linalg.det(jacobian[:3, :3])) == pytest.approx(
        abs(one), rel=1e-13, abs=0
    )  # rounding
    assert abs(np.linalg.det(jacobian)) == pytest.approx(abs(one) ** 3, rel=1e-13, abs=0)


@VARIANTS
def test_equations_of_an_order_depend_on_no_higher_order(reduced):
    """The sequential form solves each order with the results of those before it."""
    x, law = np.random.default_rng(7).uniform(0.5, 2.0, 9), (0.4, 1.1, -0.7)
    whole, slopes = hacksaw.newton_system(x, law, *LINK.values(), reduced=reduced)
    for first in (3, 6):
        other = np.append(x[:first], 2.0 * x[first:])
        values, _ = hacksaw.newton_system(other, law, *LINK.values(), reduced=reduced)
        np.testing.assert_array_equal(values[:first], whole[:first])
        assert not slopes[:first, first:].any()


def test_charts_show_the_printed_counts_and_a_quadratic_convergence():
    counts = DATA["iterations"]
    course, steps = hacksaw.newton_course(**LINK), hacksaw.newton_convergence(**LINK)
    wanted = [counts[n] for n in ("position", "velocity", "acceleration", "simultaneous")]
    for panel, values, count in zip(steps.panels, course.panels, wanted, strict=True):
        assert panel.title.endswith(f": {count} iterations")
        assert {line.x[-1] for line in (*panel.lines, *values.lines)} == {count}
    roots = {line.label: line.y[-1] for line in course.panels[-1].lines}
    np.testing.assert_allclose(
        [roots[n] for n in POSITION_NAMES], DATA["root"], rtol=0, atol=5.1e-7
    )
    size = {line.label: line.y for line in steps.panels[0].lines}["error: norm of the step"]
    x, norms = np.array(DATA["starts"]["code"], float), []

    def position(x):  # the report's equations with r1 = offset/sin(theta1), lines 1296, 1304
        sine = LINK["offset"] / np.sin(x[1])
        whole, loop = (printed_equations(q, REST)[:3] for q in (x, np.array([sine, *x[1:]])))
        return np.array([whole[0], loop[1], loop[2]])

    for _ in size:
        step = np.linalg.solve(complex_step(position, x)[:, :3], position(x))
        x[:3] -= step
        norms.append(np.linalg.norm(step))
    # rounding of the positions, 1e-16 m, times the inverse slopes
    np.testing.assert_allclose(size, norms, rtol=1e-9, atol=1e-14)
    order = np.log(size[3] / size[2]) / np.log(size[2] / size[1])
    assert order == pytest.approx(2.0, abs=0.02)  # the next term, a step of 1e-4
    with pytest.raises(ValueError, match="guess must be 9 numbers, got 3"):
        hacksaw.newton_course(**LINK, guess=(0.0, 0.0, 3.0))


@pytest.mark.parametrize("mode", hacksaw.MODES)
def test_error_figures_are_within_the_bounds_of_the_report(mode):
    """As in the report all errors are below 1e-13, step errors below 1e-6; none is all zeros."""
    errors = hacksaw.newton_errors(**LINK, mode=mode)
    assert [panel.title.split(":")[0] for panel in errors.panels] == list(hacksaw.UNKNOWNS)
    for line in errors.lines:
        assert line.x.size == DATA["sweep"]["points"]
        # the report's bound; in the other mode the slider is slower and further from the axis
        assert 0.0 < line.y.max() < 1e-13
    if mode == 1:
        both = hacksaw.newton_steps(**LINK)
        together, apart, difference = (line.y for line in both.lines)
        assert max(together.max(), apart.max()) < DATA["sweep"]["step"]
        assert 0.5 < difference.max() / DATA["sweep"]["simultaneous_against_sequential"] < 5.0
        assert np.mean(together > apart) > 0.8


def test_the_error_figures_show_a_wrong_equation(monkeypatch):
    """A crank motion that is 1e-9 too large raises all nine errors far above rounding."""
    true = hacksaw.newton_system
    monkeypatch.setattr(
        hacksaw, "newton_system", lambda q, law, *a, **k: true(q, law * (1.0 + 1e-9), *a, **k)
    )
    monkeypatch.setattr(hacksaw, "SWEEP_POSES", 41)
    errors = hacksaw.newton_errors(**LINK)
    assert min(line.y.max() for line in errors.lines) > 1e-10
