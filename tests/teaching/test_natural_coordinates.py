"""The document's scheme in natural coordinates: printed digits, errors and pitfalls.

B. Díaz Lozano, Desarrollo de material de prácticas interactivo para Teoría de Mecanismos,
Universidad de Almería 2019; the figures with their lines are in data/newton_raphson.json.
"""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from proofmass.analytic.linkages import fivebar, fourbar, inverted_slider_crank
from proofmass.analytic.newton_raphson import NotConverged
from teaching import natural_coordinates as scheme
from teaching.newton_log import condition_numbers, jacobian_ranks

DATA = json.loads((Path(__file__).parents[1] / "data" / "newton_raphson.json").read_text())[
    "linkages"
]
NAMES = list(scheme.EXAMPLES)
EACH = pytest.mark.parametrize("name", NAMES)
BAR = {"crank": 1.0, "coupler": 2.0, "rocker": 2.5, "ground": 3.0}
GUESS = (0.1, 1.0, 1.0, 0.2)  # text line 1262
PRINTED = {"rtol": 5e-9, "atol": 5.1e-9}  # nine significant digits or eight decimals


def with_reversed_angle(linkage):
    """Slider-crank whose angle derivative has the wrong sign of its notebook (8356, 8363)."""

    def wrong(q, rates):
        value, gradient, bias = linkage.rows[-1](q, rates)
        gradient[4] *= -1.0
        return value, gradient, bias

    return replace(linkage, rows=(*linkage.rows[:-1], wrong))


def with_bias(linkage, number, value):
    """A linkage whose row `number` has another bias."""
    row = linkage.rows[number]
    rows = list(linkage.rows)
    rows[number] = lambda q, rates: (*row(q, rates)[:2], value(*rates[:6].reshape(3, 2)))
    return replace(linkage, rows=tuple(rows))


def rod_as_printed(one, two, three):
    """Bias of the row of the rod as line 3704 prints it: a product in place of a difference."""
    return -2.0 * one @ (two - one) + 2.0 * (two**2) @ one


def slider_as_printed(one, two, three):
    """Bias of the row of the slider as line 3706 prints it."""
    u, w = two - one, three - one
    return (
        -2.0 * one[0] * (u[1] + w[1])
        + one[1] * (u[0] - w[0])
        - two[0] * (three[1] + one[1])
        + two[1] * w[0]
        + three[0] * u[1]
        - three[1] * u[0]
    )


def solve_example(name):
    linkage, start = scheme.EXAMPLES[name]
    q = scheme.assemble(linkage, start).root
    return linkage, q, scheme.velocities(linkage, q, DATA[name]["velocity"]["inputs"])


def is_mirrored(q, angle):
    """Whether Newton-Raphson found a crank pin of the four-bar that is not at the crank angle."""
    return np.hypot(q[..., 0] - np.cos(angle), q[..., 1] - np.sin(angle)) > 1e-6


@EACH
def test_every_printed_iteration_is_reproduced(name):
    linkage, start = scheme.EXAMPLES[name]
    np.testing.assert_allclose(start, DATA[name]["start"], rtol=1e-11)  # twelve stored digits
    found, printed = scheme.assemble(linkage, start), np.array(DATA[name]["steps"])
    assert found.iterations == printed.size
    # 1e-11: rounding, magnified by steps of up to 50 m; 2e-14: rounding of such coordinates
    np.testing.assert_allclose(found.steps, printed, rtol=1e-11, atol=2e-14)
    np.testing.assert_allclose(found.root, DATA[name]["position"], **PRINTED)
    assert np.all(jacobian_ranks(found) == DATA[name]["rank"])
    if "final_residual" in DATA[name]:
        assert found.residuals[-1] == pytest.approx(
            DATA[name]["final_residual"], rel=1e-3, abs=0
        )  # eps m


def central_differences(function, q):
    """Central differences: exact for quadratic rows, step^2/6 = 2e-9 off for rows of angles."""
    return np.array([(function(q + e) - function(q - e)) / 2e-4 for e in 1e-4 * np.eye(q.size)]).T


@EACH
def test_jacobian_and_bias_are_derivatives(name):
    linkage, start = scheme.EXAMPLES[name]
    q, rates = np.array(start), np.random.default_rng(1).uniform(-1.0, 1.0, len(start))
    _, jacobian, bias = linkage.evaluate(q, rates)
    rows = len(linkage.rows)
    slope = central_differences(lambda x: linkage.evaluate(x, rates)[0][:rows], q)
    turn = central_differences(lambda x: linkage.evaluate(x, rates)[1][:rows] @ rates, q)
    np.testing.assert_allclose(jacobian[:rows], slope, rtol=0, atol=1e-8)
    np.testing.assert_allclose(bias[:rows], turn @ rates, rtol=0, atol=1e-8)
    np.testing.assert_array_equal(jacobian[rows:], np.eye(q.size)[rows:])


@EACH
def test_velocities_and_accelerations_are_the_true_ones(name):
    linkage, q, v = solve_example(name)
    wanted = DATA[name]
    a = scheme.accelerations(linkage, q, v, wanted["acceleration"]["inputs"])
    np.testing.assert_allclose(v, wanted["velocity"]["true"], rtol=0, atol=1e-10)  # stored digits
    np.testing.assert_allclose(a, wanted["acceleration"]["true"], rtol=0, atol=1e-10)


def test_fourbar_follows_the_closed_form():
    linkage, q, _ = solve_example("four-bar")
    angle = np.linspace(0.0, 2.0 * np.pi, 121)
    found = scheme.sweep(linkage, q, angle, [1.0], [0.3])
    truth = fourbar.solve(angle, 1.0, 0.3, **BAR, mode=-1)
    for order, part in enumerate(("", "v", "a")):
        for axis, column in (("x", 2), ("y", 3)):
            # rounding times condition numbers up to 17, and the square of a last step below 1e-10
            np.testing.assert_allclose(
                found[order, :, column], truth[f"pin_{part}{axis}"], rtol=0, atol=1e-13
            )


def test_e1_printed_accelerations_have_the_driven_one_reversed():
    linkage, q, v = solve_example("four-bar")
    a, data = scheme.accelerations(linkage, q, v, [-1.0]), DATA["four-bar"]["acceleration"]
    np.testing.assert_allclose(a, data["printed"], **PRINTED)
    assert abs(np.subtract(data["true"], data["printed"])[2:4]).min() > 1.5
    linkage, q, v = solve_example("inverted slider-crank")
    data = DATA["inverted slider-crank"]["acceleration"]
    a = scheme.accelerations(linkage, q, v, [-1.0, -1.0])
    np.testing.assert_allclose(a, data["true_at_minus_one"], rtol=0, atol=1e-10)  # stored digits
    np.testing.assert_allclose(a[[0, 1, 4, 5]], np.take(data["printed"], [0, 1, 4, 5]), **PRINTED)


def test_e2_five_bar_rates_are_printed_at_the_unsolved_guess():
    linkage, start = (
        scheme.fivebar(2.0, 3.5, 4.0, 1.0, 2.0, threshold=0.7),
        np.array(DATA["five-bar"]["start"]),
    )  # 0.7: text line 6805
    v = scheme.velocities(linkage, start, DATA["five-bar"]["velocity"]["inputs"])
    np.testing.assert_allclose(v, DATA["five-bar"]["velocity"]["printed"], **PRINTED)
    a = scheme.accelerations(linkage, start, v, [1.0, 1.0])
    np.testing.assert_allclose(a, DATA["five-bar"]["acceleration"]["printed"], **PRINTED)
    for what in ("velocity", "acceleration"):
        data = DATA["five-bar"][what]
        assert abs(np.subtract(data["true"], data["printed"])[2:4]).min() > 0.3


def test_e3_e4_slider_crank_rates_have_the_wrong_sign_and_a_stale_angle():
    _, q, true = solve_example("slider-crank")
    data = DATA["slider-crank"]
    wrong = with_reversed_angle(scheme.EXAMPLES["slider-crank"][0])
    assert scheme.assemble(wrong, data["start"]).iterations == 8  # it converges nevertheless
    reversed_ = scheme.velocities(wrong, q, [1.0])
    np.testing.assert_allclose(reversed_[:4], -true[:4], rtol=0, atol=1e-15)  # rounding
    stale = np.array([*q[:4], 0.0])  # the plot function has left 0 in the angle (line 8480)
    printed = data["velocity"]["printed"]
    np.testing.assert_allclose(scheme.velocities(wrong, stale, [1.0]), printed, **PRINTED)
    assert printed[0] == pytest.approx(np.tan(0.5), abs=5.1e-9)  # last printed digit
    assert abs(np.subtract(printed, true)[:3]).min() > 1.0
    a = scheme.accelerations(wrong, q, reversed_, [-1.0])  # with E1 as well: two signs cancel
    np.testing.assert_allclose(a, data["acceleration"]["printed"], **PRINTED)
    np.testing.assert_allclose(a[:4], data["acceleration"]["true"][:4], rtol=0, atol=1e-10)
    assert a[4] == -data["acceleration"]["true"][4]


def test_e5_e6_inverted_slider_crank_has_two_wrong_rows_of_bias():
    linkage, q, v = solve_example("inverted slider-crank")
    data = DATA["inverted slider-crank"]["acceleration"]
    wrong = with_bias(with_bias(linkage, 1, rod_as_printed), 3, slider_as_printed)
    a = scheme.accelerations(wrong, q, v, [-1.0, -1.0])
    np.testing.assert_allclose(a, data["printed"], **PRINTED)
    bias, wrong = linkage.evaluate(q, v)[2], wrong.evaluate(q, v)[2]
    for row, true in ((1, 4.184016279401985), (3, 1.0733992226707985)):
        assert bias[row] == pytest.approx(true, rel=1e-13, abs=0)  # rounding
        assert abs(wrong[row] - true) > 2.0
    # point 2 is off by 4.3 % and 33.5 %
    off = np.abs(np.divide(data["printed"], data["true_at_minus_one"])[2:4] - 1.0)
    np.testing.assert_allclose(off, [0.0434, 0.335], rtol=0.01)  # printed to two or three digits


def test_lengths_that_cannot_close_end_after_101_iterations():
    """Text line 1060. Without convergence only the count, not the last step, is reproducible."""
    with pytest.raises(NotConverged) as failure:
        scheme.assemble(scheme.fourbar(1.0, 2.0, 3.0, 50.0), (*GUESS, 0.0))
    assert failure.value.log.iterations == 101
    assert failure.value.log.steps.min() > 1.0
    with pytest.raises(ValueError, match=r"miss by 44 m"):
        fourbar.solve(0.0, crank=1.0, coupler=2.0, rocker=3.0, ground=50.0)


def test_non_grashof_sweep_fails_at_the_first_frame_past_its_limit():
    linkage, start = scheme.fourbar(2.0, 2.0, 2.5, 3.0), (0.1, 2.0, 1.0, 0.2, 0.0)
    frames = np.arange(100) * 2.0 * np.pi / 100
    limit = np.arccos((4.0 + 9.0 - 20.25) / 12.0)  # in line: 4.5^2 = 2^2 + 3^2 - 12 cos(angle)
    closing = np.sum(frames < limit)
    scheme.sweep(linkage, start, frames[:closing], [1.0], [0.0])
    with pytest.raises(NotConverged):
        scheme.sweep(linkage, start, frames[: closing + 1], [1.0], [0.0])


def test_one_row_of_an_angle_leaves_mirror_images_and_two_do_not():
    """One row at a time leaves a mirror image of the crank pin; both rows leave the right pin only.

    With a threshold the row of x or that of y is used, depending on the crank angle.
    """
    angles = np.arange(72) * 2.0 * np.pi / 72
    for threshold, wrong in ((0.5**0.5, 36), (None, 0)):
        linkage = scheme.fourbar(*BAR.values(), threshold=threshold)
        q = np.array([scheme.assemble(linkage, (*GUESS, angle)).root for angle in angles])
        assert np.sum(is_mirrored(q, angles)) == wrong
        left = (3.0 - q[:, 0]) * (q[:, 3] - q[:, 1]) + q[:, 1] * (q[:, 2] - q[:, 0]) > 0.0
        assert (np.sum(left & ~is_mirrored(q, angles)), np.sum(left & is_mirrored(q, angles))) == (
            (9, 10) if threshold else (0, 0)
        )  # with both rows all poses are also in one assembly mode


@pytest.mark.parametrize(
    ("threshold", "poses", "wrong"),
    [(0.05, 50, 24), (0.05, 100, 0), (0.5**0.5, 20, 0), (0.5**0.5, 50, 0), (0.5**0.5, 200, 0)],
)
def test_long_steps_with_a_low_threshold_stay_on_the_mirror_image(threshold, poses, wrong):
    """Erratum E7: at 0.05 a sweep of 50 poses misses the change of rows, keeps the mirror image."""
    angles = np.linspace(0.0, 2.0 * 3.1416, poses)  # the document's pi, text line 2079
    linkage = scheme.fourbar(*BAR.values(), threshold=threshold)
    q = scheme.sweep(linkage, (*GUESS, 0.0), angles, [1.0], [0.0])[0]
    assert np.sum(is_mirrored(q, angles)) == wrong


def test_newton_raphson_converges_linearly_at_a_change_point():
    linkage = scheme.fourbar(1.0, 2.0, 2.0, 3.0)
    near = scheme.assemble(linkage, (-np.cos(0.1), np.sin(0.1), 0.0, -1.0, np.pi - 0.1)).root
    found = scheme.assemble(linkage, (*near[:4], np.pi))
    assert found.iterations == 25
    ratio = found.steps[5:20] / found.steps[4:19]
    np.testing.assert_allclose(ratio, 0.5, rtol=1e-3)  # a double root halves the step
    close = scheme.assemble(linkage, (*near[:4], np.pi - 1e-3))
    assert condition_numbers(close)[-1] == pytest.approx(4.64 / 1e-3, rel=2e-3)  # three digits


def test_degrees_of_freedom_by_rank_and_by_count():
    for name, links, degrees in zip(
        NAMES, (4, 5, 4, 5), (1, 2, 1, 2), strict=True
    ):  # lines 1180-3453
        linkage, q, v = solve_example(name)
        jacobian = linkage.evaluate(q, v)[1][: len(linkage.rows)]
        assert q.size - np.linalg.matrix_rank(jacobian) == degrees
        assert scheme.degrees_by_rank(linkage.rows, q) == degrees
        assert scheme.degrees_by_count(links, links) == degrees
        free = linkage.rows[1:]  # without the length of the crank
        assert scheme.degrees_by_rank(free, q) == degrees + 1
    assert scheme.degrees_by_count(3, 2, 1) == 1  # two gears: two pins, and teeth that roll
    assert scheme.degrees_by_count(5, 6) == 0  # a platform on three cranks


def test_each_pose_of_a_sweep_has_its_own_driven_angles():
    """The angles of a pose were overwritten by those of the next one."""
    linkage, q, _ = solve_example("inverted slider-crank")
    angles = q[-2:] + np.array([[0.0, 0.0], [0.1, 0.2], [0.3, 0.6]])
    found = scheme.sweep(linkage, q, angles, [1.0, 2.0], [0.0, 0.0])
    np.testing.assert_array_equal(found[0, :, -2:], angles)


def coupler_driven_fourbar():
    """Four-bar whose drive is the angle from crank to coupler; unknowns X1, Y1, X2, Y2, phi."""
    a, b, one, two = (
        scheme.fixed(0, 0, 5),
        scheme.fixed(3.0, 0, 5),
        scheme.moving(0, 5),
        scheme.moving(1, 5),
    )
    return scheme.NaturalLinkage(
        (
            scheme.distance(a, one, 1.0),
            scheme.distance(one, two, 2.0),
            scheme.distance(two, b, 2.5),
            *scheme.relative_angle(one, a, two, (1.0, 2.0), 4),
        ),
        ("X1", "Y1", "X2", "Y2", "phi"),
    )


def test_a_drive_between_two_links_follows_the_closed_form():
    """Figure 42: the four-bar driven by its angle at the crank pin moves as in the closed form."""
    linkage, crank = coupler_driven_fourbar(), np.linspace(0.4, 2.4, 21)
    truth = fourbar.solve(crank, 1.0, 0.3, **BAR)

    def angle(order):
        tail = ("_angle", "_rate", "_acceleration")[order]
        turn = (np.pi, 0.0, 0.0)[order]  # the angle counts from the direction back to A
        return truth[f"coupler{tail}"] - (crank, 1.0, 0.3)[order] - turn

    for k, theta in enumerate(crank):
        start = [np.cos(theta), np.sin(theta), truth["pin_x"][k], truth["pin_y"][k]]
        q = scheme.assemble(linkage, [*np.add(start, 0.01), angle(0)[k]]).root
        v = scheme.velocities(linkage, q, [angle(1)[k]])
        a = scheme.accelerations(linkage, q, v, [angle(2)[k]])
        np.testing.assert_allclose(q[:4], start, rtol=0, atol=1e-13)  # rounding
        speeds = [-np.sin(theta), np.cos(theta), truth["pin_vx"][k], truth["pin_vy"][k]]
        np.testing.assert_allclose(v[:4], speeds, rtol=0, atol=1e-12)  # rounding, condition 30
        np.testing.assert_allclose(
            a[2:4], [truth["pin_ax"][k], truth["pin_ay"][k]], rtol=0, atol=1e-11
        )


@pytest.mark.parametrize(("row", "mirrored_too"), [(0, True), (1, True), (None, False)])
def test_one_row_of_a_relative_angle_has_a_second_root(row, mirrored_too):
    """Figure 42 takes "both, to avoid singularities": either row alone has a second root."""
    linkage, phi = coupler_driven_fourbar(), -2.0
    if row is not None:
        linkage = replace(linkage, rows=(*linkage.rows[:3], linkage.rows[3 + row]))
    found = set()
    for start in np.random.default_rng(2).uniform(-3.0, 3.0, (40, 4)):
        try:
            q = scheme.assemble(linkage, [*start, phi]).root
        except NotConverged:
            continue
        if np.abs(linkage.evaluate(q, 0.0 * q)[0][:3]).max() < 1e-9:  # else a least-squares point
            back, to = -q[:2], q[2:4] - q[:2]
            turn = np.arctan2(back[0] * to[1] - back[1] * to[0], back @ to)
            found.add(round(float(turn), 6))
    assert phi in found
    assert (len(found) > 1) is mirrored_too


def block_at_an_angle(angle):
    """A block on a rod from the crank pin, with a bar at a constant angle to the rod.

    The unknowns are X1, Y1, .. X3, Y3, theta: 1 is the crank pin, 2 the end of the rod, 3 the
    block, whose bar of 1 m turns about (2, 0).
    """
    a, b = scheme.fixed(0, 0, 7), scheme.fixed(2.0, 0, 7)
    one, two, three = (scheme.moving(k, 7) for k in range(3))
    return scheme.NaturalLinkage(
        (
            scheme.distance(a, one, 0.6),
            scheme.distance(one, two, 4.0),
            scheme.distance(b, three, 1.0),
            scheme.collinear(one, three, two),
            scheme.constant_angle(one, two, three, b, 4.0 * 1.0 * np.cos(angle)),
            *scheme.ground_angle(a, one, 0.6, 6),
        ),
        ("X1", "Y1", "X2", "Y2", "X3", "Y3", "theta"),
    )


@pytest.mark.parametrize("angle", [np.pi / 2, 1.2, 2.0])
def test_a_block_at_a_constant_angle_follows_the_law_of_cosines(angle):
    """Figure 41: the triangle of crank pin, block and pivot has the constant angle at the block."""
    linkage, q = block_at_an_angle(angle), None
    for theta in np.linspace(0.0, 2.0 * np.pi, 25):
        pin = 0.6 * np.exp(1j * theta)
        distance_to_pivot = abs(2.0 - pin)
        # law of cosines: far^2 = s^2 + 1 - 2 s cos(pi - angle), s from crank pin to block
        s = -np.cos(angle) + np.sqrt(distance_to_pivot**2 - np.sin(angle) ** 2)
        at_pin = np.arcsin(np.sin(angle) / distance_to_pivot)
        block = pin + s * (2.0 - pin) / distance_to_pivot * np.exp(1j * at_pin)
        end = pin + 4.0 * (block - pin) / s
        truth = np.array([pin.real, pin.imag, end.real, end.imag, block.real, block.imag])
        q = scheme.assemble(linkage, [*(truth + 0.02), theta]).root
        np.testing.assert_allclose(q[:6], truth, rtol=0, atol=1e-12)  # rounding
        step = 1e-5
        v = scheme.velocities(linkage, q, [1.0])
        a = scheme.accelerations(linkage, q, v, [0.0])
        near = [
            scheme.assemble(linkage, [*q[:6], theta + sign * step]).root[:6] for sign in (-1, 1)
        ]
        np.testing.assert_allclose(  # central difference: step^2 times third derivative
            v[:6], (near[1] - near[0]) / (2 * step), rtol=0, atol=1e-8
        )
        np.testing.assert_allclose(  # rounding over step^2
            a[:6], (near[1] - 2.0 * q[:6] + near[0]) / step**2, rtol=0, atol=2e-4
        )


@pytest.mark.parametrize(
    "linkage", [coupler_driven_fourbar(), block_at_an_angle(1.2)], ids=["relative", "constant"]
)
def test_jacobian_and_bias_of_rows_of_angles_are_derivatives(linkage):
    size, rows = len(linkage.names), len(linkage.rows)
    q, rates = np.random.default_rng(3).uniform(-1.0, 1.0, (2, size))
    _, jacobian, bias = linkage.evaluate(q, rates)
    slope = central_differences(lambda x: linkage.evaluate(x, rates)[0][:rows], q)
    turn = central_differences(lambda x: linkage.evaluate(x, rates)[1][:rows] @ rates, q)
    np.testing.assert_allclose(jacobian[:rows], slope, rtol=0, atol=1e-8)
    np.testing.assert_allclose(bias[:rows], turn @ rates, rtol=0, atol=1e-8)


def test_a_sweep_without_poses_has_no_rows():
    found = scheme.sweep(scheme.fourbar(**BAR), (*GUESS, 0.0), [], [1.0], [0.0])
    assert found.shape == (3, 0, 5)


def test_a_start_of_another_length_names_the_coordinates():
    with pytest.raises(ValueError, match=r"start must be X1, Y1, X2, Y2, theta, got .* \(4,\)"):
        scheme.assemble(scheme.EXAMPLES["four-bar"][0], (0.1, 1.0, 1.0, 0.2))


@pytest.mark.parametrize("ratio", [1.0, 1.5])
def test_sweeps_of_figures_69_70_92_93_follow_the_closed_forms(ratio):
    """The second angle is 1 or 1.5 times the first: scheme against closed forms, 50 poses each."""
    crank = np.linspace(0.0, 2.0 * 3.1416, 50)
    angles, rates = np.stack([crank, ratio * crank]), np.array([1.0, ratio])
    lengths = {"left_crank": 2.0, "left_coupler": 3.5, "right_coupler": 4.0, "right_crank": 1.0}
    truth = fivebar.solve(angles, rates[:, None], 0.0, left_x=0.0, right_x=2.0, **lengths)
    start = [2.0, 0.0, truth["tip_x"][0], truth["tip_y"][0], 3.0, 0.0, 0.0, 0.0]
    linkage = scheme.fivebar(*lengths.values(), ground=2.0, threshold=None)
    found = scheme.sweep(linkage, start, angles.T, list(rates), [0.0, 0.0])
    for order, part in enumerate(("", "v", "a")):
        wanted = np.stack([truth[f"tip_{part}x"], truth[f"tip_{part}y"]], axis=1)
        np.testing.assert_allclose(found[order, :, 2:4], wanted, rtol=0, atol=1e-11)  # rounding
    lengths = {"crank": 2.0, "rod": 3.0, "bar": 1.0}
    truth = inverted_slider_crank.solve(angles, rates[:, None], 0.0, ground_x=2.0, **lengths)
    start = [2.0, 0.0, truth["end_x"][0], truth["end_y"][0], 3.0, 0.0, 0.0, 0.0]
    linkage = scheme.inverted_slider_crank(*lengths.values(), ground=2.0, threshold=None)
    found = scheme.sweep(linkage, start, angles.T, list(rates), [0.0, 0.0])
    for order, part in enumerate(("", "v", "a")):
        wanted = np.stack([truth[f"end_{part}x"], truth[f"end_{part}y"]], axis=1)
        np.testing.assert_allclose(found[order, :, 2:4], wanted, rtol=0, atol=1e-11)
