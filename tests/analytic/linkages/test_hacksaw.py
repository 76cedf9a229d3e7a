"""Hacksaw closed form and motor against the report's equations, derivatives, published numbers."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import simpson

from proofmass.analytic.linkages import hacksaw
from tests.analytic.linkages.spectral import assert_close, derivative

DATA = json.loads((Path(__file__).parents[2] / "data" / "hacksaw_published.json").read_text())
LINK = {name: DATA["lengths"][name] for name in ("crank", "coupler", "offset")}
TURN = 2.0 * np.pi
MODES = pytest.mark.parametrize("mode", hacksaw.MODES)
GRID = np.arange(512) * TURN / 512
# A periodic crank profile whose derivatives are not zero, for spectral derivatives of the curves.
CRANK_PROFILE = (GRID + 0.3 * np.sin(GRID), 1.0 + 0.3 * np.cos(GRID), -0.3 * np.sin(GRID))
ANGLE_NAMES = ("theta1", "theta3")


@st.composite
def full_turn_links(draw):
    """Lengths with which the crank turns fully, clear of poses that change the assembly mode.

    The slider never crosses above the axis of the crank, and the coupler is never upright.
    """
    crank, scale = draw(st.floats(0.1, 1.0)), draw(st.floats(1e-3, 1e3))
    # below 0.05 the absolute rounding of theta1 near -pi is too large for its small derivative
    offset = crank * draw(st.just(0.0) | st.floats(0.05, 2.0) | st.floats(-2.0, -0.05))
    coupler = (crank + abs(offset)) * draw(st.floats(1.15, 4.0))
    return {"crank": scale * crank, "coupler": scale * coupler, "offset": scale * offset}


def residuals(crank_motion, pose, link):
    """The report's nine loop equations (text lines 300-338, theta3 where it misprints theta2)."""
    theta2, w2, a2 = crank_motion
    r1, v, a = (pose[f"r1{part}"] for part in ("", "_rate", "_acceleration"))
    (w1, a1), (w3, a3) = (
        [pose[f"{bar}_{part}"] for part in ("rate", "acceleration")] for bar in ANGLE_NAMES
    )
    (c1, s1), (c2, s2), (c3, s3) = (
        (np.cos(x), np.sin(x)) for x in (pose["theta1"], theta2, pose["theta3"])
    )
    r2, r3 = link["crank"], link["coupler"]
    return [
        np.array(
            [r2 * c2 + r3 * c3 - r1 * c1, r1 * s1 - r2 * s2 - r3 * s3, r1 * s1 - link["offset"]]
        ),
        np.array(
            [
                w1 * r1 * s1 - v * c1 - w2 * r2 * s2 - w3 * r3 * s3,
                v * s1 + w1 * r1 * c1 - w2 * r2 * c2 - w3 * r3 * c3,
                v * s1 + w1 * r1 * c1,
            ]
        ),
        np.array(
            [
                r1 * c1 * w1**2
                + 2 * v * s1 * w1
                - r2 * c2 * w2**2
                - r3 * c3 * w3**2
                - a * c1
                + a1 * r1 * s1
                - a2 * r2 * s2
                - a3 * r3 * s3,
                -r1 * s1 * w1**2
                + 2 * v * c1 * w1
                + r2 * s2 * w2**2
                + r3 * s3 * w3**2
                + a * s1
                + a1 * r1 * c1
                - a2 * r2 * c2
                - a3 * r3 * c3,
                -r1 * s1 * w1**2 + 2 * v * c1 * w1 + a * s1 + a1 * r1 * c1,
            ]
        ),
    ]


@MODES
def test_the_motor_sweep_satisfies_nine_loop_equations(mode):
    crank_motion = hacksaw.motor(np.linspace(0.0, 2.0 * hacksaw.turn_time(), 1000))
    pose = hacksaw.solve(*crank_motion, **LINK, mode=mode)
    for order, rows in enumerate(residuals(crank_motion, pose, LINK)):
        # rounding of about ten terms of size length, length w, length w^2 with w = 6.5 rad/s
        assert np.abs(rows).max() <= 1e-14 * LINK["coupler"] * 6.5**order


@settings(derandomize=True, max_examples=60, deadline=None)
@given(full_turn_links(), st.sampled_from(hacksaw.MODES))
def test_loop_and_derivatives_of_random_links(link, mode):
    pose = hacksaw.solve(*CRANK_PROFILE, **link, mode=mode)
    size = link["crank"] + link["coupler"]
    assert np.abs(residuals(CRANK_PROFILE, pose, link)[0]).max() <= 1e-14 * size  # rounding
    # 1e-9: rounding times the highest wave number (256 eps = 6e-14), times the ratio of the size
    # of a curve to that of its derivative, up to 1e3 for theta1 at short cranks and small offsets
    for name in ("r1", "theta1", "theta3"):
        if name == "theta1" and link["offset"] == 0.0:
            assert not pose["theta1_rate"].any()
            continue
        assert_close(derivative(pose[name]), pose[f"{name}_rate"], 1e-9)
        assert_close(derivative(pose[f"{name}_rate"]), pose[f"{name}_acceleration"], 1e-9)
    assert_close(derivative(pose["slider_x"]), pose["slider_velocity"], 1e-9)
    assert_close(derivative(pose["slider_velocity"]), pose["slider_acceleration"], 1e-9)
    side = pose["slider_x"] - link["crank"] * np.cos(CRANK_PROFILE[0])
    assert np.all(mode * side < 0)


@MODES
def test_newton_raphson_on_the_report_equations_agrees(mode):
    crank_motion = hacksaw.motor(np.linspace(0.0, 2.0 * hacksaw.turn_time(), 1000))
    pose = hacksaw.solve(*crank_motion, **LINK, mode=mode)
    guess = {name: pose[name] + 1e-3 for name in ("r1", *ANGLE_NAMES)}  # off the solution
    zero = {f"{n}_{p}": 0.0 for n in guess for p in ("rate", "acceleration")}
    for _ in range(6):
        r1, (c1, s1), (c3, s3) = (
            guess["r1"],
            *((np.cos(guess[n]), np.sin(guess[n])) for n in ANGLE_NAMES),
        )
        r3, none = np.full_like(r1, LINK["coupler"]), np.zeros_like(r1)
        matrix = np.stack([-c1, r1 * s1, -r3 * s3, s1, r1 * c1, -r3 * c3, s1, r1 * c1, none], 1)
        matrix = matrix.reshape(-1, 3, 3)
        right = residuals(crank_motion, guess | zero, LINK)[0].T[..., None]
        step = np.linalg.solve(matrix, right)[..., 0].T
        guess = {n: guess[n] - s for n, s in zip(guess, step, strict=True)}
    for order, part in ((1, "rate"), (2, "acceleration")):
        right = residuals(crank_motion, guess | zero, LINK)[order].T[..., None]
        step = np.linalg.solve(matrix, right)[..., 0].T
        zero |= {f"{n}_{part}": -s for n, s in zip(guess, step, strict=True)}
    for name, curve in (guess | zero).items():
        assert_close(curve, pose[name], 1e-13)  # the report's own bound for this comparison


@MODES
def test_modes_are_mirror_images(mode):
    angle, rate, acceleration = CRANK_PROFILE
    pose = hacksaw.solve(*CRANK_PROFILE, **LINK, mode=mode)
    # 4e-15 and 4e-14: rounding of pi - angle, through slopes of up to 10 at this offset
    image = hacksaw.solve(np.pi - angle, -rate, -acceleration, **LINK, mode=-mode)
    for name in ("slider_x", "slider_velocity", "slider_acceleration"):
        np.testing.assert_allclose(image[name], -pose[name], rtol=0, atol=4e-15)
    for name in ("r1", "r1_rate", "r1_acceleration"):
        np.testing.assert_allclose(image[name], pose[name], rtol=0, atol=4e-15)
    for bar in ANGLE_NAMES:
        shift = np.pi if bar == "theta3" else -np.pi
        np.testing.assert_allclose(image[bar], shift - pose[bar], rtol=0, atol=4e-15)
        for part in ("rate", "acceleration"):
            np.testing.assert_allclose(
                image[f"{bar}_{part}"], -pose[f"{bar}_{part}"], rtol=0, atol=4e-14
            )


def test_start_and_its_misprints():
    pose = hacksaw.solve(0.0, 0.0, 0.0, **LINK)
    for name in ("r1", "theta1", "theta3"):
        assert pose[name] == pytest.approx(DATA["start"][name], abs=5.1e-7)  # last printed digit
        assert pose[f"{name}_rate"] == pose[f"{name}_acceleration"] == 0.0
    moving = hacksaw.solve(0.3, 2.0, 0.0, **LINK)
    rate_formula = -2.0 * LINK["crank"] * np.cos(0.3) / (LINK["coupler"] * np.cos(moving["theta3"]))
    assert moving["theta3_rate"] == pytest.approx(rate_formula, rel=1e-14, abs=0)  # rounding
    assert abs(moving["r1"] - rate_formula) > 0.5  # text line 533 prints it as r1
    angle_formula = np.arctan(LINK["offset"] / moving["slider_x"])
    assert moving["theta1"] == pytest.approx(angle_formula, rel=1e-14, abs=0)  # rounding
    assert abs(moving["theta3_rate"] - angle_formula) > 0.5  # text line 534 prints it as theta3'
    as_printed = (LINK["crank"] + LINK["coupler"]) * np.sin(0.3) - LINK["offset"]
    assert abs(as_printed) > 0.01  # text line 302 with theta2 does not close


def test_other_assembly_at_the_start():
    pose, other = hacksaw.solve(0.0, 0.0, 0.0, **LINK, mode=-1), DATA["other_assembly"]
    # rounding: the reference has all digits of a double
    assert -pose["r1"] == pytest.approx(other["r1"], rel=1e-15, abs=0)
    assert pose["theta1"] + np.pi == pytest.approx(other["theta1"], rel=4e-15, abs=0)
    assert pose["theta3"] == pytest.approx(other["theta3"], rel=1e-15, abs=0)


@pytest.mark.parametrize("row", DATA["points"]["rows"], ids=lambda row: str(row["index"]))
def test_reference_points_are_met(row):
    crank_motion = hacksaw.motor(row["time"])
    for found, name in zip(crank_motion, ("angle", "rate", "acceleration"), strict=True):
        assert found == pytest.approx(row[name], rel=1e-14, abs=1e-14)  # rounding of the time
    pose = hacksaw.solve(*crank_motion, **LINK)
    loads = {name for name in pose if name.endswith(("_moment", "_force_x", "_force_y"))}
    assert len(loads) == 9
    assert not any(pose[name] for name in loads)  # no cutting force, and no masses
    for name, curve in ((name, pose[name]) for name in pose.keys() - loads):
        # rounding of an angle of up to 19 rad, 4e-15, through slopes of up to 10
        assert curve == pytest.approx(row[name], rel=4e-14, abs=4e-14), name


@pytest.fixture(scope="module")
def dense_sweep():
    """The sweep at 400,001 samples."""
    return hacksaw.solve(
        *hacksaw.motor(np.linspace(0.0, 2.0 * hacksaw.turn_time(), 400001)), **LINK
    )


@pytest.mark.parametrize("name", [name for name in DATA["extrema"] if name != "source"])
def test_extrema_of_the_sweep_are_those_printed(name, dense_sweep):
    curve = dense_sweep[name]
    if name.startswith(ANGLE_NAMES):
        curve = np.degrees(curve)
    for sign, expected in zip((-1, 1), DATA["extrema"][name], strict=True):
        middle = np.argmax(sign * curve)
        left, top, right = curve[middle - 1 : middle + 2]
        peak = top + (right - left) ** 2 / (8.0 * (2.0 * top - left - right))  # parabola
        # 6 printed decimals, and the grid of the printed values does not contain the peak
        assert peak == pytest.approx(expected, abs=1.1e-6, rel=1e-9)


def test_limits_stroke_and_time_ratio():
    limits, reach = (
        DATA["limits"],
        (LINK["coupler"] + LINK["crank"], LINK["coupler"] - LINK["crank"]),
    )
    outer, inner = np.radians(limits["crank_deg"])
    pose = hacksaw.solve([outer, inner], 1.0, 0.0, **LINK)
    assert np.abs(pose["slider_velocity"]).max() <= 1e-15  # dead points; rounding of the angles
    np.testing.assert_allclose(pose["r1"], -np.array(reach), rtol=1e-14)  # exact, rounding
    np.testing.assert_allclose(pose["slider_x"], limits["slider_x"], rtol=1e-14)  # rounding
    assert np.ptp(pose["slider_x"]) == pytest.approx(limits["stroke"], rel=1e-14, abs=0)  # rounding
    ratio = (TURN - (inner - outer)) / (inner - outer)
    assert ratio == pytest.approx(limits["time_ratio"], rel=1e-14, abs=0)  # rounding
    turn = hacksaw.solve(GRID, 1.0, 0.0, **LINK)
    assert turn["r1"].min() >= -reach[0] - 1e-16  # rounding
    assert turn["r1"].max() <= -reach[1] + 1e-16


@MODES
def test_holding_moment_by_virtual_work(mode):
    table = DATA["moment"]
    angle = np.radians(np.arange(0, 360, 30))
    pose = hacksaw.solve(angle, 1.0, 0.0, **LINK, mode=mode, cutting_force=table["force"])
    if mode == 1:  # the mode of the table; last printed digit
        np.testing.assert_allclose(pose["holding_moment"], table["values"], rtol=0, atol=5.1e-7)
    work = -table["force"] * pose["slider_velocity"]  # at unit rate
    np.testing.assert_allclose(pose["holding_moment"], work, rtol=0, atol=1e-15)  # rounding


def test_theta1_is_continuous_where_the_slider_crosses_above_the_axis():
    angle = np.linspace(np.radians(20), np.radians(60), 4001)
    link = {"crank": 0.1, "coupler": 0.08, "offset": 0.05}
    pose = hacksaw.solve(angle, 1.0, 0.0, **link)
    assert pose["slider_x"][0] > 0 > pose["slider_x"][-1]
    assert np.all(pose["r1"] < 0)
    step = angle[1] - angle[0]
    slope = np.diff(pose["theta1"]) / step
    middle = hacksaw.solve(angle[:-1] + step / 2, 1.0, 0.0, **link)["theta1_rate"]
    assert_close(slope, middle, 1e-5)  # central difference: step^2/24 times the third derivative


def test_motor_numbers_are_those_printed():
    printed = DATA["motor"]
    total = hacksaw.turn_time(printed["peak"])
    assert total == pytest.approx(printed["turn_time"], abs=5.1e-4)  # last printed digit
    assert 2.0 * total == pytest.approx(printed["double_time"], abs=5.1e-4)
    angle, rate, acceleration = hacksaw.motor([total, 2.0 * total])
    np.testing.assert_allclose(angle, [TURN, 3.0 * TURN], rtol=1e-15)  # exact, rounding
    np.testing.assert_allclose(rate, printed["final_rate"], rtol=1e-15)  # rounding
    assert not acceleration.any()
    assert rate[0] * 60.0 / TURN == pytest.approx(printed["final_rpm"], abs=0.5)
    assert abs(rate[0] - printed["final_rate_printed"]) > 0.02  # the misprint


@settings(derandomize=True, max_examples=20, deadline=None)
@given(st.floats(0.01, 1e3))
def test_motor_integrates_its_acceleration(peak):
    total = hacksaw.turn_time(peak)
    time = np.linspace(0.0, 2.0 * total, 6 * 40 + 1)  # knots T/3, 2T/3, T on the grid
    angle, rate, acceleration = hacksaw.motor(time, peak=peak)
    half = hacksaw.motor(time[:-1] + np.diff(time) / 2.0, peak=peak)
    step = np.diff(time)

    def simpson(ends, middles):  # exact for the cubic pieces
        return step / 6.0 * (ends[:-1] + 4.0 * middles + ends[1:])

    # rounding of differences: eps times the final value
    assert np.abs(np.diff(angle) - simpson(rate, half[1])).max() <= 1e-15 * angle[-1]
    assert np.abs(np.diff(rate) - simpson(acceleration, half[2])).max() <= 1e-15 * rate[-1]
    assert angle[120] == pytest.approx(TURN, rel=1e-14, abs=0)  # rounding: one turn in T
    assert angle[0] == rate[0] == acceleration[0] == 0.0
    assert acceleration.max() == pytest.approx(peak, rel=1e-14, abs=0)  # rounding
    late = hacksaw.motor(1000.0 * total, peak=peak)
    assert late[0] == pytest.approx(TURN * 1999.0, rel=1e-14)  # rounding; two turns per T


def test_bad_motor_values_are_refused():
    with pytest.raises(ValueError, match="time must not be negative"):
        hacksaw.motor([0.0, -1e-9])
    for peak in (0.0, -5.0, np.nan, np.inf):
        with pytest.raises(ValueError, match="peak must be"):
            hacksaw.motor(1.0, peak=peak)


@pytest.mark.parametrize(
    ("name", "value"),
    [(n, v) for n in ("crank", "coupler") for v in (0.0, -1.0, np.nan, np.inf)]
    + [("offset", np.nan), ("offset", np.inf), ("mode", 0), ("cutting_force", np.nan)],
)
def test_bad_value_is_named(name, value):
    with pytest.raises(ValueError, match=f"^{name} must be"):
        hacksaw.solve(0.0, 0.0, 0.0, **{**LINK, name: value})


def test_an_unreachable_angle_is_named_with_its_violation():
    short = {"crank": 0.075, "coupler": 0.1, "offset": 0.045}
    limit = np.arcsin((0.045 - 0.1) / 0.075)  # coupler upright
    upright = hacksaw.solve(limit, 1.0, 0.0, **short)
    assert upright["slider_x"] == pytest.approx(0.075 * np.cos(limit), abs=1e-8)  # sqrt(eps) length
    violation = 0.045 + 0.075 - 0.1
    with pytest.raises(ValueError, match=rf"angle {-np.pi / 2:.9g} rad: .* by {violation:.6g} m"):
        hacksaw.solve([0.0, -np.pi / 2, -np.pi / 2], 1.0, 0.0, **short)
    with pytest.raises(ValueError, match=rf"angle {np.pi / 2:.9g} rad: .* by {violation:.6g} m"):
        hacksaw.solve([0.0, np.pi / 2], 1.0, 0.0, **{**short, "offset": -0.045})
    with pytest.raises(ValueError, match=r"by 5\.\d+e-11 m"):
        hacksaw.solve(limit - 1e-9, 1.0, 0.0, **short)
    with pytest.raises(ValueError, match=r"by 5\.\d+e-11 m"):
        hacksaw.solve(limit - 1e-9, 1.0, 0.0, **short, only={"r1"})
    for length in np.linspace(0.1, 0.119, 200):  # coupler upright: some miss the guide by rounding
        hacksaw.solve(np.arcsin((0.045 - length) / 0.075), 0.0, 0.0, **{**short, "coupler": length})


def test_shapes_broadcast():
    pose = hacksaw.solve(np.zeros((3, 1)), np.ones(4), 0.0, **LINK)
    assert {curve.shape for curve in pose.values()} == {(3, 4)}
    assert {curve.shape for curve in hacksaw.solve(0.0, 1.0, 0.0, **LINK).values()} == {()}


MASSES_AND_LOADS = {
    "crank_mass": 0.2,
    "coupler_mass": 0.3,
    "slider_mass": 0.5,
    "gravity": 9.81,
    "cutting_force": 10.0,
}


def motor_motion(mode):
    """Crank profile of the motor, motion and forces from 0.7 to 1.2 s, where the jerk is smooth."""
    crank_motion = hacksaw.motor(np.linspace(0.7, 1.2, 2001))
    return crank_motion, hacksaw.solve(
        *crank_motion, **{**LINK, "mode": mode}, **MASSES_AND_LOADS, inertia=True
    )


@MODES
def test_work_of_the_motor_is_the_change_of_energy(mode):
    """The energies follow from the motion alone, the integral of M dtheta2 by Simpson's rule."""
    (angle, rate, _), found = motor_motion(mode)
    crank, coupler = (LINK[name] for name in ("crank", "coupler"))
    pin = crank * np.exp(1j * angle)
    turn, spin = found["theta3"], found["theta3_rate"]
    middle = pin + 0.5 * coupler * np.exp(1j * turn)
    speed = 1j * pin * rate + 0.5j * coupler * np.exp(1j * turn) * spin
    kinetic = 0.5 * MASSES_AND_LOADS["crank_mass"] * crank**2 / 3.0 * rate**2
    kinetic = kinetic + 0.5 * MASSES_AND_LOADS["coupler_mass"] * (
        np.abs(speed) ** 2 + coupler**2 / 12.0 * spin**2
    )
    kinetic = kinetic + 0.5 * MASSES_AND_LOADS["slider_mass"] * found["slider_velocity"] ** 2
    height = (
        0.5 * MASSES_AND_LOADS["crank_mass"] * pin.imag
        + MASSES_AND_LOADS["coupler_mass"] * middle.imag
    )
    energy = (
        kinetic
        + MASSES_AND_LOADS["gravity"] * height
        - MASSES_AND_LOADS["cutting_force"] * found["slider_x"]
    )
    time = np.linspace(0.7, 1.2, 2001)
    work = simpson(found["holding_moment"] * rate, x=time)
    assert work == pytest.approx(energy[-1] - energy[0], rel=1e-9)  # step^4
    assert abs(work) > 0.1


@MODES
def test_ground_carries_weight_and_inertia_of_all_bodies(mode):
    """Reactions at crank and guide against weights and accelerations of three centres of mass."""
    (angle, rate, acceleration), found = motor_motion(mode)
    crank, coupler = (LINK[name] for name in ("crank", "coupler"))
    turn, spin, bend = (found[f"theta3{part}"] for part in ("", "_rate", "_acceleration"))
    arm = crank * np.exp(1j * angle)
    of_pin = (1j * acceleration - rate**2) * arm
    of_middle = of_pin + (1j * bend - spin**2) * 0.5 * coupler * np.exp(1j * turn)
    masses = [MASSES_AND_LOADS[f"{name}_mass"] for name in ("crank", "coupler", "slider")]
    moved = np.array([0.5 * of_pin, of_middle, found["slider_acceleration"] + 0j])
    needed = np.tensordot(masses, moved + 1j * MASSES_AND_LOADS["gravity"], 1)
    on_crank = (found["crank_force_x"] + 1j * found["crank_force_y"]) * np.exp(1j * angle)
    on_slider = found["guide_force_x"] + 1j * found["guide_force_y"]
    np.testing.assert_allclose(on_crank + on_slider, needed, rtol=0, atol=1e-12)  # rounding
    np.testing.assert_allclose(
        found["guide_force_x"], MASSES_AND_LOADS["cutting_force"], atol=1e-12, rtol=0
    )


@MODES
@pytest.mark.parametrize("offset", [0.045, -0.045])
def test_motion_and_moment_are_smooth_through_a_change_point(offset, mode):
    """The coupler is upright once in a turn, without a reversal, so that the cycle is two turns."""
    link = {**LINK, "coupler": LINK["crank"] + abs(offset), "offset": offset}
    two_turns = 2.0 * GRID, np.full(GRID.size, 2.0), np.zeros(GRID.size)
    found = hacksaw.solve(*two_turns, **link, mode=mode, **MASSES_AND_LOADS)
    for order, rows in enumerate(residuals(two_turns, found, link)):
        # rounding, times the ratio of 4 of a rate of the coupler to that of the crank
        assert np.abs(rows).max() <= 1e-15 * 4.0**order
    names = ("r1", "theta1", "theta3", "slider_x")
    rates = ("r1_rate", "theta1_rate", "theta3_rate", "slider_velocity")
    seconds = (*(f"{name}_acceleration" for name in names[:3]), "slider_acceleration")
    for value, rate, second in zip(names, rates, seconds, strict=True):
        assert_close(derivative(found[value]), found[rate], 1e-9)  # as for random links
        assert_close(derivative(found[rate]), found[second], 1e-9)
    mass, gravity = (
        MASSES_AND_LOADS["crank_mass"] + MASSES_AND_LOADS["coupler_mass"],
        MASSES_AND_LOADS["gravity"],
    )
    potential = 0.5 * mass * gravity * link["crank"] * np.sin(2.0 * GRID)
    potential -= MASSES_AND_LOADS["cutting_force"] * found["slider_x"]
    assert_close(derivative(potential), 2.0 * found["holding_moment"], 1e-9)


def test_masses_change_moments_but_not_the_motion():
    crank_motion = (np.linspace(0.0, 6.0, 7), 1.0, 0.2)
    bare, loaded = (
        hacksaw.solve(*crank_motion, **LINK),
        hacksaw.solve(*crank_motion, **LINK, **MASSES_AND_LOADS),
    )
    for name in ("r1", "theta1_rate", "theta3_acceleration", "slider_x"):
        np.testing.assert_array_equal(bare[name], loaded[name])
    assert not np.allclose(bare["holding_moment"], loaded["holding_moment"])
    assert "holding_moment" not in hacksaw.solve(*crank_motion, **LINK, only={"r1"})
    with pytest.raises(ValueError, match="slider_mass must be zero or positive"):
        hacksaw.solve(*crank_motion, **LINK, slider_mass=-1.0)
