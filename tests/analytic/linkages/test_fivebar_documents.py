"""Printed numbers, misprints and methods of the two five-bar documents, thesis and notebook."""

import json
from pathlib import Path

import numpy as np
import pytest

from proofmass.analytic.linkages import fivebar

DATA = json.loads((Path(__file__).parents[2] / "data" / "fivebar.json").read_text())
THESIS, NOTEBOOK = DATA["thesis"], DATA["notebook"]
LINK = THESIS["lengths"]
SYMMETRIC, ASYMMETRIC, REGULAR = (NOTEBOOK[key] for key in ("symmetric", "asymmetric", "regular"))


def natural_constraints(q, cosine_row, b_row=None):
    """Constraints (8,) of the thesis, their Jacobian, and dJ/dt qp as a function of qp.

    q = [x1, y1, x2, y2, x3, y3, theta, beta]; 1 is the left crank pin, 2 the tip, 3 the right crank
    pin. The row of an angle contains x of its pin if |cos| is below `cosine_row`, otherwise y;
    `b_row` is the same threshold for dJ/dt qp. Text lines 2382-2489.
    """
    bars = [
        (None, 0, "left_crank"),
        (0, 2, "left_coupler"),
        (2, 4, "right_coupler"),
        (None, 4, "right_crank"),
    ]
    bases = {0: np.array([LINK["left_x"], 0.0]), 4: np.array([LINK["right_x"], 0.0])}
    value, slope, rows = np.zeros(8), np.zeros((8, 8)), []
    for row, (start, end, name) in enumerate(bars):
        along = q[end : end + 2] - (bases[end] if start is None else q[start : start + 2])
        value[row] = along @ along - LINK[name] ** 2
        slope[row, end : end + 2] = 2.0 * along
        if start is not None:
            slope[row, start : start + 2] = -2.0 * along
        rows.append((start, end))
    for row, (pin, angle, name) in enumerate([(0, 6, "left_crank"), (4, 7, "right_crank")], 4):
        c, s = LINK[name] * np.cos(q[angle]), LINK[name] * np.sin(q[angle])
        part = 0 if abs(np.cos(q[angle])) < cosine_row else 1
        value[row] = q[pin + part] - bases[pin][part] - (c, s)[part]
        slope[row, pin + part], slope[row, angle] = 1.0, (s, -c)[part]
    slope[[6, 7], [6, 7]] = 1.0

    def jacobian_rate_product(qp):
        b = np.zeros(8)
        for row, (start, end) in enumerate(rows):
            speed = qp[end : end + 2] - (0.0 if start is None else qp[start : start + 2])
            b[row] = 2.0 * speed @ speed
        for row, (angle, name) in enumerate([(6, "left_crank"), (7, "right_crank")], 4):
            level = abs(np.cos(q[angle])) < (cosine_row if b_row is None else b_row)
            b[row] = qp[angle] ** 2 * LINK[name] * (np.cos if level else np.sin)(q[angle])
        return b

    return value, slope, jacobian_rate_product


def natural_motion(q, rate, acceleration, cosine_row, b_row=None):
    _, slope, jacobian_rate_product = natural_constraints(q, cosine_row, b_row)
    qp = np.linalg.solve(slope, [0, 0, 0, 0, 0, 0, *rate])
    return qp, np.linalg.solve(slope, [*-jacobian_rate_product(qp)[:6], *acceleration])


def solve_by_newton(q, cosine_row=0.5):
    """Iterate from `q` as the thesis does, until a step is below 1e-10; solution and step norms."""
    steps = []
    while not steps or (steps[-1] > 1e-10 and len(steps) <= 100):
        value, slope, _ = natural_constraints(q, cosine_row)
        step = np.linalg.solve(slope, -value)
        q, steps = q + step, [*steps, float(np.linalg.norm(step))]
    return q, steps


def tip_by_elimination(right, left, link, sigma, printed_0_9=False):
    """X and y of the tip by the notebook: X3 = f + g Y3, and a quadratic for Y3 (lines 43-123)."""
    l1, l2, l3, l4 = (
        link[name] for name in ("right_crank", "right_coupler", "left_coupler", "left_crank")
    )
    l5, c1, s1 = link["right_x"] - link["left_x"], np.cos(right), np.sin(right)
    c4, s4 = np.cos(left), np.sin(left)
    den = 2.0 * (l5 + l1 * c1 - l4 * c4)
    f = (l1**2 - l2**2 + l3**2 - l4**2 + l1 * l5 * c1 + l4 * l5 * c4) / den
    g = (-2.0 * l1 * s1 + 2.0 * l4 * s4) / den
    a = 1.0 + g**2
    b = -2.0 * f * g + g * l5 + 2.0 * g * l1 * c1 + 2.0 * l1 * s1
    c = f**2 + l1**2 - l2**2 - f * l5 + l5**2 / 4.0 + l1 * (-2.0 * f + l5) * c1
    root = sigma * np.sqrt(b**2 - 4.0 * a * c)
    y = (b + root) / (2.0 * a)
    return f + g * ((-b if printed_0_9 else b) + root) / (2.0 * a), y


def tip_position(pose):
    return np.array([pose["tip_x"], pose["tip_y"]])


def half_angle_quadratic(side, place, link):
    """Coefficients a, b, c of the notebook's quadratic for tan(angle/2) of a crank (173-233)."""
    crank, coupler = link[f"{side}_crank"], link[f"{side}_coupler"]
    x, y = place[0] - link[f"{side}_x"], place[1]
    return (
        (x + crank) ** 2 + y**2 - coupler**2,
        -4.0 * crank * y,
        (x - crank) ** 2 + y**2 - coupler**2,
    )


def test_position_of_the_thesis_is_met():
    pose = fivebar.solve(THESIS["angle"], **LINK, mode=THESIS["mode"])
    printed = THESIS["position_printed"][2:4]
    # last printed digit
    np.testing.assert_allclose(tip_position(pose), printed, rtol=0, atol=5.1e-9)
    other = fivebar.solve(THESIS["angle"], **LINK, mode=-THESIS["mode"])
    np.testing.assert_allclose(tip_position(other), THESIS["other_assembly"], rtol=0, atol=1e-11)
    found, steps = solve_by_newton(np.array([*THESIS["first_guess"], *THESIS["angle"]]))
    assert len(steps) == 12  # as printed from line 6278 on
    # quadratic convergence
    np.testing.assert_allclose(found[2:4], tip_position(pose), rtol=0, atol=1e-14)


def test_velocity_and_acceleration_of_the_thesis_and_their_misprints():
    """E2: the thesis solves both at the first guess. E8: its driven accelerations are always +1."""
    rate, ones = THESIS["rate"], THESIS["acceleration"]
    state = np.array([*THESIS["position_printed"], *THESIS["angle"]])
    solved, _ = solve_by_newton(state)
    truth = fivebar.solve(THESIS["angle"], rate, ones, **LINK, mode=THESIS["mode"])
    velocity, acceleration = ([truth[f"tip_{part}{axis}"] for axis in "xy"] for part in "va")
    at_rest = fivebar.solve(THESIS["angle"], rate, 0.0, **LINK, mode=THESIS["mode"])
    for found, key in (
        (velocity, "velocity"),
        (acceleration, "acceleration_at_ones"),
        ([at_rest["tip_ax"], at_rest["tip_ay"]], "acceleration_at_zero"),
    ):
        np.testing.assert_allclose(found, THESIS[key][2:4], rtol=0, atol=1e-11)  # 12 digits
    qp, qpp = natural_motion(solved, rate, ones, 0.5)
    np.testing.assert_allclose(qp[2:4], velocity, rtol=0, atol=1e-14)  # rounding
    np.testing.assert_allclose(qpp[2:4], acceleration, rtol=0, atol=1e-14)
    guess = np.array([*THESIS["first_guess"], *THESIS["angle"]])
    qp, qpp = natural_motion(guess, rate, ones, 0.7)
    printed = THESIS["velocity_misprint"], THESIS["acceleration_misprint"]
    for found, misprint, true in zip((qp, qpp), printed, (velocity, acceleration), strict=True):
        np.testing.assert_allclose(found[:6], misprint, rtol=5e-9, atol=5.1e-9)  # 9 digits
        assert np.abs(np.array(misprint[2:4]) - true).max() > 0.3
    _, reversed_sign = natural_motion(guess, rate, [-1.0, -1.0], 0.7)  # b = +1 as in the body
    assert np.abs(reversed_sign[:6] - THESIS["acceleration_misprint"]).max() > 1.0


def test_mixed_thresholds_of_the_thesis_spoil_accelerations():
    """E7: the Jacobian changes rows at |cos| = 0.7, its derivative at 1/sqrt(2) (6805, 7096)."""
    angle = np.array([np.arccos(0.705), 0.9])
    truth = fivebar.solve(angle, [1.0, 2.0], 0.0, **LINK)
    pins = [
        base + crank * np.exp(1j * at)
        for base, crank, at in zip((0, 2), (2, 1), angle, strict=True)
    ]
    q = np.array(
        [pins[0].real, pins[0].imag, *tip_position(truth), pins[1].real, pins[1].imag, *angle]
    )
    true = [truth["tip_ax"], truth["tip_ay"]]
    _, consistent = natural_motion(q, [1.0, 2.0], [0.0, 0.0], 0.7)
    np.testing.assert_allclose(consistent[2:4], true, rtol=1e-13)  # rounding
    _, mixed = natural_motion(q, [1.0, 2.0], [0.0, 0.0], 0.7, np.sqrt(0.5))
    assert np.abs(mixed[2:4] - true).max() > 1e-3


@pytest.mark.parametrize("table", DATA["cycles"]["tables"], ids=lambda t: f"x{t['factor']}")
def test_cycles_of_the_thesis_are_met(table):
    rows, factor = np.array(table["rows"]).T, table["factor"]
    pose = fivebar.solve([rows[0], factor * rows[0]], [1.0, factor], **LINK)
    for name, column in zip(DATA["cycles"]["columns"][1:], rows[1:], strict=True):
        # the table and its angles have 12 digits: 5e-13 times slopes of accelerations of up to 1e3
        np.testing.assert_allclose(pose[name], column, rtol=0, atol=1e-9)


def test_pin_distances_and_unassembled_share_are_those_of_the_thesis():
    turn = np.linspace(0.0, 2.0 * np.pi, 3601)
    apart = fivebar.solve([turn, 2.0 * turn], **LINK)["pin_distance"]
    least, largest = THESIS["cycle_pin_distance"]
    assert apart.min() == pytest.approx(least, abs=5.1e-9 + 3e-6)  # digits, grid
    assert apart.max() == pytest.approx(largest, abs=1e-15)  # at half a turn, exact
    share = fivebar.unassembled_share(fivebar.FivebarLengths(**LINK))
    assert share == pytest.approx(THESIS["unassembled_share"], abs=1e-4)  # counted on a grid


def test_symmetric_case_of_the_notebook_is_met():
    link, upright = SYMMETRIC["lengths"], [np.pi / 2, np.pi / 2]
    for mode, expected in ((1, [0.0, 8.0]), (-1, [0.0, 0.0])):
        np.testing.assert_allclose(
            tip_position(fivebar.solve(upright, **link, mode=mode)), expected, rtol=0, atol=1e-14
        )  # exact by hand
    for side, known in SYMMETRIC["quadratics_at_0_8"].items():
        assert half_angle_quadratic(side, (0.0, 8.0), link) == pytest.approx(
            [known[key] for key in "abc"], abs=1e-13
        )  # exact by hand
        for mode, key in ((1, "plus_deg"), (-1, "minus_deg")):
            pose = fivebar.solve_inverse([0.0, 8.0], **link, **{f"{side}_mode": mode})
            assert np.degrees(pose[side]) == pytest.approx(
                known[key], rel=1e-14, abs=0
            )  # 16 digits
    places = {name: link[name] for name in ("left_crank", "right_crank", "left_x", "right_x")}
    A, B = fivebar.jacobians(upright, [0.0, 8.0], **places)
    jacobian = np.linalg.solve(A, B)[:, ::-1]  # the notebook's order: right, left
    np.testing.assert_allclose(jacobian, SYMMETRIC["jacobian_right_left"], rtol=1e-14)


def test_sign_error_in_equation_0_9_of_the_notebook():
    right, left = np.radians(ASYMMETRIC["right_left_deg"])
    link = ASYMMETRIC["lengths"]
    wrong = ASYMMETRIC["x_by_misprinted_0_9"]
    for mode, key, printed in ((1, "tip_plus", wrong[0]), (-1, "tip_minus", wrong[1])):
        truth = tip_position(fivebar.solve([left, right], **link, mode=mode))
        np.testing.assert_allclose(truth, ASYMMETRIC[key], rtol=0, atol=5.1e-10)  # 9 decimals
        np.testing.assert_allclose(
            tip_by_elimination(right, left, link, mode), truth, rtol=0, atol=1e-13
        )
        x, _ = tip_by_elimination(right, left, link, mode, printed_0_9=True)
        assert x == pytest.approx(printed, abs=1.1e-9)
        assert abs(x - truth[0]) > 0.5


def test_elimination_of_the_notebook_over_its_domain():
    """The notebook's sigma is the mode while the right pin is right of the left pin, else -mode."""
    link = SYMMETRIC["lengths"]
    right, left = np.random.default_rng(2).uniform(-np.pi, np.pi, (2, 4000))
    level = 3.0 + 4.0 * np.cos(right) - (-3.0 + 4.0 * np.cos(left))
    apart = np.hypot(level, 4.0 * np.sin(right) - 4.0 * np.sin(left))
    keep = (np.abs(level) > 0.2) & (apart < 9.9) & (apart > 0.1)
    right, left, level = right[keep], left[keep], level[keep]
    for sigma in (1, -1):
        found = np.array(tip_by_elimination(right, left, link, sigma))
        poses = [tip_position(fivebar.solve([left, right], **link, mode=mode)) for mode in (1, -1)]
        truth = np.where(level * sigma > 0, *poses)
        # rounding, times 1/level^2 of up to 25 and the root's slope of up to 10
        np.testing.assert_allclose(found, truth, rtol=0, atol=1e-11)


def test_poses_where_the_notebook_divides_by_zero_are_regular():
    """One crank pin is above the other, or a crank is at half a turn; both poses are regular."""
    link = SYMMETRIC["lengths"]
    right, left = np.pi, np.pi / 3
    for mode in (1, -1):
        found = tip_position(fivebar.solve([left, right], **link, mode=mode))
        exact = [-1.0 + mode * np.sqrt(22.0), np.sqrt(3.0)]
        np.testing.assert_allclose(found, exact, rtol=0, atol=2e-15)  # by hand; rounding
    with np.errstate(all="ignore"):
        x, y = tip_by_elimination(right, left, link, 1)
    assert not (abs(x - exact[0]) < 0.1 and abs(y - exact[1]) < 0.1)
    half_turn = SYMMETRIC["half_turn_root"]
    assert abs(half_angle_quadratic("right", half_turn["tip"], link)[0]) == 0.0
    for mode, expected in zip((1, -1), half_turn["right_deg"], strict=True):
        pose = fivebar.solve_inverse(half_turn["tip"], **link, right_mode=mode)
        assert np.degrees(pose["right"]) % 360.0 == pytest.approx(expected, rel=1e-14, abs=0)


def test_arms_up_mode_of_the_notebook_is_not_continuous():
    e = np.linspace(-1e-3, 1e-3, 2000)  # none of them is zero
    link = SYMMETRIC["lengths"]
    right, left = np.pi + e, np.pi / 3 + 2.0 * e
    x, _ = tip_by_elimination(right, left, link, 1)
    swap = SYMMETRIC["swap"]
    for end, key in ((0, "e_minus_001"), (-1, "e_plus_001")):
        truth = fivebar.solve([left[end], right[end]], **link, mode=-1 if end == 0 else 1)
        # 9 decimals
        np.testing.assert_allclose(tip_position(truth), swap[key], rtol=0, atol=5.1e-10)
        assert x[end] == pytest.approx(swap[key][0], abs=1e-7)  # loses digits like 1/e^2
    assert np.abs(np.diff(x)).max() > 9.0
    pose = fivebar.solve([left, right], **link)
    assert np.abs(np.diff(tip_position(pose))).max() < 1e-4


@pytest.mark.parametrize("row", REGULAR["poses"], ids=lambda r: f"{r['right_left_deg']}{r['mode']}")
def test_poses_of_the_regular_linkage_are_those_of_the_notebook(row):
    link = REGULAR["lengths"]
    left_right = [
        np.radians(row["right_left_deg"][::-1]),
        *(REGULAR[key][::-1] for key in ("right_left_rate", "right_left_acceleration")),
    ]
    pose = fivebar.solve(*left_right, **link, mode=row["mode"])
    for part, key in (("", "tip"), ("v", "velocity"), ("a", "acceleration")):
        found = [pose[f"tip_{part}{axis}"] for axis in "xy"]
        np.testing.assert_allclose(found, row[key], rtol=0, atol=4e-14)  # rounding of both
    bars = link["left_coupler"] * link["right_coupler"]
    assert pose["assembly"] == pytest.approx(
        -row["det_A"] / bars, rel=1e-14, abs=0
    )  # rows: right, left
    places = {name: link[name] for name in ("left_crank", "right_crank", "left_x", "right_x")}
    A, B = fivebar.jacobians(left_right[0], row["tip"], **places)
    np.testing.assert_allclose(np.linalg.solve(A, B)[:, ::-1], row["jacobian"], rtol=0, atol=4e-14)
    for k, expected in enumerate(row["inverse_deg"] or ()):
        right, left = 1 - k // 2 * 2, 1 - k % 2 * 2
        found = fivebar.solve_inverse(row["tip"], **link, left_mode=left, right_mode=right)
        turn = np.degrees([found["right"], found["left"]]) - expected
        # 1e-11: the notebook's tan(angle/2) loses digits near half a turn
        assert np.abs((turn + 180.0) % 360.0 - 180.0).max() <= 1e-11
