"""Pendulum closed form against its differential equation, an integrator, published numbers."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.special import ellipj, ellipk

from proofmass.analytic.linkages import pendulum

DATA = json.loads((Path(__file__).parents[2] / "data" / "pendulum_published.json").read_text())
A01 = {name: DATA["a01"][name] for name in ("length", "mass", "gravity")} | {
    "amplitude": -np.pi / 2
}
BODY = {"length": 0.7, "mass": 1.3, "gravity": 9.81}
AMPLITUDES = st.floats(-3.1, 3.1).filter(lambda amplitude: abs(amplitude) > 1e-3)


def period(amplitude, **body):
    body = {name: value for name, value in (BODY | body).items() if name != "mass"}
    return pendulum.period(**body, amplitude=amplitude)


@settings(derandomize=True, max_examples=50, deadline=None)
@given(AMPLITUDES)
def test_motion_satisfies_derivatives_energy_and_equation_of_motion(amplitude):
    count = 1024
    time = np.arange(count) * period(amplitude) / count
    swing = pendulum.solve(time, **BODY, amplitude=amplitude)
    wave = 2j * np.pi * np.fft.fftfreq(count, period(amplitude) / count)
    wave[count // 2] = 0.0
    for first, second in (("angle", "rate"), ("rate", "acceleration")):
        slope = np.fft.ifft(wave * np.fft.fft(swing[first])).real
        error = np.abs(slope - swing[second]).max() / np.abs(swing[second]).max()
        assert error <= 1e-11  # rounding times the highest wave number: 512 eps = 1.1e-13
    squared = BODY["gravity"] / BODY["length"]
    motion = swing["acceleration"] + squared * np.sin(swing["angle"])
    assert np.abs(motion).max() <= 2e-15 * squared  # equation of motion, rounding
    weight = BODY["mass"] * BODY["gravity"]
    scale = weight * BODY["length"]
    start = 2.0 * scale * np.sin(amplitude / 2.0) ** 2
    assert np.abs(swing["energy"] / start - 1.0).max() <= 2e-14  # rounding
    height = BODY["length"] * (1.0 - np.cos(swing["angle"]))
    # rounding of 1 - cos and of its comparison
    assert np.abs(swing["potential"] - weight * height).max() <= 1e-15 * scale * 4
    pull = weight * np.cos(swing["angle"]) + BODY["mass"] * BODY["length"] * swing["rate"] ** 2
    np.testing.assert_allclose(swing["tension"], pull, rtol=0, atol=1e-14 * weight)  # rounding


@settings(derandomize=True, max_examples=50, deadline=None)
@given(AMPLITUDES)
def test_swing_is_symmetric(amplitude):
    whole = period(amplitude)
    time = np.linspace(0.0, whole, 33)
    swing = pendulum.solve(time, **BODY, amplitude=amplitude)
    mirrored = pendulum.solve(-time, **BODY, amplitude=-amplitude)
    np.testing.assert_array_equal(mirrored["angle"], -swing["angle"])
    np.testing.assert_array_equal(mirrored["rate"], swing["rate"])
    later = pendulum.solve(time + whole / 2.0, **BODY, amplitude=amplitude)
    # rounding of the time, about eps times two periods, times the rate
    tolerance = 4e-16 * 2.0 * whole * np.abs(swing["rate"]).max()
    np.testing.assert_allclose(later["angle"], -swing["angle"], rtol=0, atol=tolerance)
    assert swing["angle"][0] == pytest.approx(amplitude, rel=1e-15, abs=0)
    assert swing["rate"][0] == 0.0
    quarter = pendulum.solve(whole / 4.0, **BODY, amplitude=amplitude)
    assert abs(quarter["angle"]) <= tolerance


@pytest.mark.parametrize("amplitude", [0.01, 1.0, -2.0, 3.0])
def test_integrator_agrees(amplitude):
    squared = BODY["gravity"] / BODY["length"]
    time = np.linspace(0.0, 2.0 * period(amplitude), 101)
    run = solve_ivp(
        lambda _, y: [y[1], -squared * np.sin(y[0])],
        time[[0, -1]],
        [amplitude, 0.0],
        "DOP853",
        time,
        rtol=1e-13,
        atol=1e-14,
    )
    swing = pendulum.solve(time, **BODY, amplitude=amplitude)
    # the integrator's own error: 1e-13, times 1/k' = 14 per near stop at the top (amplitude 3)
    np.testing.assert_allclose(run.y[0], swing["angle"], rtol=0, atol=1e-9)
    np.testing.assert_allclose(run.y[1], swing["rate"], rtol=0, atol=1e-9 * np.sqrt(squared))


@pytest.mark.parametrize("amplitude", [0.1, 1.0, 2.0, -2.9])
def test_scipy_elliptic_functions_agree(amplitude):
    time = np.linspace(-3.0, 3.0, 201)
    frequency = np.sqrt(BODY["gravity"] / BODY["length"])
    k, other = np.sin(amplitude / 2), np.cos(amplitude / 2)
    sn, cn, dn, _ = ellipj(frequency * time, k * k)
    swing = pendulum.solve(time, **BODY, amplitude=amplitude)
    # scipy works from 1 - k^2, which is rounded: eps/other^2 in its period
    np.testing.assert_allclose(swing["angle"], 2 * np.arctan2(k * cn, other), rtol=0, atol=1e-12)
    np.testing.assert_allclose(
        swing["rate"], -2 * frequency * k * other * sn / dn, rtol=0, atol=1e-12 * frequency
    )
    assert period(amplitude) == pytest.approx(4 * ellipk(k * k) / frequency, rel=1e-13, abs=0)


@pytest.mark.parametrize("gap", [1e-2, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12])
def test_period_and_motion_for_amplitudes_close_to_half_a_turn(gap):
    amplitude = np.pi - gap
    gap = np.pi - amplitude + 1.2246467991473532e-16  # digits of pi lost in its double
    modulus = np.sin(gap / 2)  # complementary modulus; K = log(4/k') + O(k'^2 log k')
    limit = 4.0 * np.log(4.0 / modulus) * np.sqrt(BODY["length"] / BODY["gravity"])
    # next term of the expansion of K, relative: k'^2/4
    assert period(amplitude) == pytest.approx(limit, rel=modulus**2 + 1e-15, abs=0)
    quarter = period(amplitude) / 4.0
    swing = pendulum.solve([quarter, 2.0 * quarter], **BODY, amplitude=amplitude)
    assert abs(swing["angle"][0]) <= 1e-13  # eps times w quarter (20) times the rate/w (2)
    assert swing["angle"][1] == pytest.approx(
        -amplitude, rel=1e-15, abs=0
    )  # rounding, at rest there
    time = np.linspace(0.0, 2.0 * quarter, 41)
    swing = pendulum.solve(time, **BODY, amplitude=amplitude)
    assert np.ptp(swing["energy"]) <= 2e-14 * swing["energy"][0]  # rounding
    # separatrix through the bottom at time `quarter`: angle = -2 gd(w (time - quarter)), whose
    # distance from the swing is about k'
    path = -2.0 * np.arctan(np.sinh(np.sqrt(BODY["gravity"] / BODY["length"]) * (time - quarter)))
    np.testing.assert_allclose(swing["angle"], path, rtol=0, atol=5.0 * modulus + 1e-13)


def test_periods_are_those_of_the_table():
    ratios = {float(k): v for k, v in DATA["period_ratio"].items() if k != "source"}
    small = 2.0 * np.pi * np.sqrt(BODY["length"] / BODY["gravity"])
    for degrees, ratio in ratios.items():
        # 22-digit table; the amplitude is rounded in radians: eps/(180 - degrees) of its effect
        assert period(np.radians(degrees)) / small == pytest.approx(ratio, rel=5e-15, abs=0)


def test_rows_of_benchmark_a01_are_met():
    time, x, y = np.array(DATA["a01"]["rows"]).T
    swing = pendulum.solve(time, **A01)
    # rounding of sqrt(gravity) time, 31 eps = 7e-15, times the rate over sqrt(gravity), 1.4
    np.testing.assert_allclose(np.sin(swing["angle"]), x, rtol=0, atol=2e-14)
    np.testing.assert_allclose(-np.cos(swing["angle"]), y, rtol=0, atol=2e-14)
    whole = pendulum.period(length=1.0, gravity=9.81, amplitude=-np.pi / 2)
    assert whole == pytest.approx(DATA["a01"]["period"], rel=1e-15, abs=0)  # rounding
    bottom = pendulum.solve(whole / 4.0, **A01)
    assert bottom["rate"] == pytest.approx(DATA["a01"]["max_speed"], rel=1e-15, abs=0)  # rounding
    pull = bottom["tension"] / 9.81
    assert pull == pytest.approx(
        DATA["a01"]["max_tension_over_weight"], rel=1e-15, abs=0
    )  # rounding


def test_classroom_pendulum_has_its_published_numbers():
    case = DATA["easyjava"]
    body = {name: case[name] for name in ("length", "gravity")}
    amplitude = np.radians(case["amplitude_deg"])
    whole = pendulum.period(**body, amplitude=amplitude)
    assert whole == pytest.approx(case["period"], abs=5.1e-10)  # last digit given
    bottom = pendulum.solve(0.75 * whole, **body, mass=1.0, amplitude=amplitude)
    assert bottom["rate"] == pytest.approx(case["max_rate"], abs=5.1e-10)  # last digit given


def test_zero_amplitude_stays_at_rest():
    swing = pendulum.solve(np.linspace(0.0, 5.0, 11), **BODY, amplitude=0.0)
    for name, curve in swing.items():
        expected = BODY["mass"] * BODY["gravity"] if name == "tension" else 0.0
        np.testing.assert_array_equal(curve, expected)
    small = 2.0 * np.pi * np.sqrt(BODY["length"] / BODY["gravity"])
    assert period(0.0) == pytest.approx(small, rel=1e-15, abs=0)  # rounding


@pytest.mark.parametrize(
    ("name", "value"),
    [(n, v) for n in ("length", "mass", "gravity") for v in (0.0, -1.0, np.nan, np.inf)]
    + [("amplitude", v) for v in (np.pi, -np.pi, 4.0, np.nan)],
)
def test_bad_value_is_named(name, value):
    body = {**BODY, "amplitude": 1.0, name: value}
    with pytest.raises(ValueError, match=f"^{name} must"):
        pendulum.solve(0.0, **body)
    if name != "mass":
        with pytest.raises(ValueError, match=f"^{name} must"):
            period(**body)


def test_shapes():
    for shape in ((), (0,), (2, 3)):
        swing = pendulum.solve(np.zeros(shape), **BODY, amplitude=1.0)
        assert {curve.shape for curve in swing.values()} == {shape}
