"""Rods in motion: frequencies of beams, chains of links, statics, and energy."""

import numpy as np
import pytest
from scipy.optimize import brentq

from proofmass.analytic.linkages import slider_crank
from proofmass.analytic.remember import use_memory
from proofmass.analytic.rods import rod_motion, rod_released, slider_crank_elastic
from proofmass.analytic.rods import solve as rod_at_rest
from proofmass.analytic.rods.rod_motion import MovingRod
from tests.independent.rods.chain_motion import driven_chain, released_chain

ROD = {"length": 1.0, "stiffness": 0.25, "mass": 0.1, "gravity": 9.81}
LINKS = {"crank": 0.25, "coupler": 1.0, "stiffness": 0.2, "coupler_mass": 0.1, "slider_mass": 0.05}


def roots_near(function, about) -> np.ndarray:
    """Roots of a function within 0.4 of given numbers."""
    return np.array([brentq(function, a - 0.4, a + 0.4) for a in about])


def test_small_oscillations_are_those_of_beams():
    """Frequencies of small oscillations are those of Euler-Bernoulli beams, (beta L)^2.

    beta L is 1.8751, 4.6941, ... for a clamped rod, 3.9266, ... for a pinned rod with a free end,
    and pi, 2 pi, ... for a pinned rod with a slider.
    """
    about = np.pi * (np.arange(3) + 0.5)
    clamped = roots_near(lambda b: np.cos(b) + 1.0 / np.cosh(b), about)
    np.testing.assert_allclose(clamped[:2], [1.8751, 4.6941], atol=1e-4)
    rod = MovingRod(1.0, 1.0, 1.0)
    np.testing.assert_allclose(rod.frequencies(12)[:3], clamped**2, rtol=1e-9)
    pinned = roots_near(lambda b: np.tan(b) - np.tanh(b), about[:2] + 0.75 * np.pi)
    found = MovingRod(1.0, 1.0, 1.0, clamped=False).frequencies(12)
    assert found[0] < 1e-6  # rotation about the pin
    np.testing.assert_allclose(found[1:3], pinned**2, rtol=1e-9)
    both = MovingRod(2.0, 3.0, 5.0, clamped=False, slider=1.0).frequencies(16)[:4]
    waves = np.pi * np.arange(1, 5)
    np.testing.assert_allclose(both, waves**2 * np.sqrt(3.0 / 5.0 / 8.0), rtol=1e-7)


def test_a_small_fall_is_that_of_a_beam():
    """A rod that is released under a small weight moves like a clamped beam, by five modes.

    It oscillates about its deflection at rest.
    """
    beta = np.array([1.87510406871, 4.69409113297, 7.85475743824, 10.9955407349, 14.1371683910])
    share = (np.cosh(beta) + np.cos(beta)) / (np.sinh(beta) + np.sin(beta))
    t = np.linspace(0.0, 3.0, 31)
    fall = 1e-4
    # integral of a mode is 2 share/beta, its tip 2 (-1)^k
    tip = 2.0 * (-1.0) ** np.arange(5)
    wanted = -fall * (2.0 * share / beta**5 * tip) @ (1.0 - np.cos(np.outer(beta**2, t)))
    found = rod_released.solve(t, length=1.0, stiffness=1.0, mass=1.0, gravity=fall)
    # further modes: 4/beta^5, 1e-6 of the fall
    np.testing.assert_allclose(found["tip_y"] / fall, wanted / fall, atol=1e-5)


def test_velocity_moment_and_force_of_a_small_fall_are_those_of_a_beam():
    """Velocity of the tip, moment and force of the clamp are those of a beam with 300 modes."""
    beta = np.pi * (np.arange(300) + 0.5)
    beta[:5] = [1.87510406871, 4.69409113297, 7.85475743824, 10.9955407349, 14.1371683910]
    share = np.ones(beta.size)
    share[:5] = (np.cosh(beta[:5]) + np.cos(beta[:5])) / (np.sinh(beta[:5]) + np.sin(beta[:5]))
    t, fall = np.linspace(0.0, 0.9, 61), 1e-5
    phase = np.outer(beta**2, t)
    bent = -2.0 * share / beta**5 * (1.0 - np.cos(phase)).T
    moving = -2.0 * share / beta**3 * np.sin(phase).T
    found = rod_released.solve(t, length=1.0, stiffness=1.0, mass=1.0, gravity=fall)
    # shares of the notes of `rod_released`: modes above the sixth lose their phase
    for name, exact, error in (
        ("tip_vy", moving @ (2.0 * (-1.0) ** np.arange(beta.size)), 5e-3),
        ("moment", bent @ (-2.0 * beta**2), 3e-3),
        ("force_y", bent @ (-2.0 * share * beta**3), 6e-2),
    ):
        np.testing.assert_allclose(found[name] / fall, exact, rtol=0, atol=error * np.ptp(exact))


@pytest.mark.parametrize("theta0", [0.0, pytest.param(2.2, marks=pytest.mark.slow)])
def test_a_large_motion_is_the_limit_of_chains(theta0):
    """A released rod moves like chains of 5, 10 and 20 links, extrapolated in 1/n^2.

    The chains have other equations of motion.  Each of the rod's energies, of motion, of bending
    and of the weight, is the limit of those of the chains as well.
    """
    t = np.linspace(0.0, 0.45, 10)
    found = rod_released.solve(t, theta0=theta0, **ROD)
    tip = found["tip_x"] + 1j * found["tip_y"]
    rod = {key: value for key, value in ROD.items() if key != "length"}
    motions = [released_chain(t, n, theta0=theta0, **rod) for n in (5, 10, 20)]
    for one in motions:  # tolerance of its integrator, 1e-8, over some hundred steps; m g L is 1
        whole = one.kinetic + one.strain + one.weight
        np.testing.assert_allclose(whole, whole[0], rtol=0, atol=1e-6)
    wanted = {
        "tip": tip,
        "kinetic": found["kinetic"],
        "strain": found["strain"],
        "weight": found["potential"] - found["strain"],
    }
    for name, exact in wanted.items():
        chains = [getattr(one, name) for one in motions]
        errors = [np.abs(one - exact).max() for one in chains]
        # terms of h^4 are larger in the energy of bending, which depends on slopes of the rod
        first, rest = (0.2, 0.05) if name == "tip" else (0.5, 0.3)
        assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=first), name
        assert np.log2(errors[1] / errors[2]) == pytest.approx(2.0, abs=0.2), name
        limit = chains[2] + (chains[2] - chains[1]) / 3.0
        assert np.abs(limit - exact).max() < rest * errors[2], name
    assert np.ptp(tip.imag) > 0.5  # a large motion
    assert np.abs(found["energy"] - found["kinetic"] - found["potential"]).max() < 1e-15


def test_energy_is_constant_and_the_first_clamp_moment_is_zero():
    """The energy of a released rod is constant, and the moment at its clamp is zero at first."""
    t = np.linspace(0.0, 0.6, 13)
    found = rod_released.solve(t, **ROD)
    np.testing.assert_allclose(found["energy"], 0.0, atol=1e-8 * np.ptp(found["kinetic"]))
    assert found["moment"][0] == 0.0  # straight: nothing bends it yet


def test_a_rod_released_in_equilibrium_stays_at_rest():
    """A rod that begins with the shape of the elastica under its own weight stays at rest.

    Its polynomials are fitted to the angles of the elastica.
    """
    weight = 0.1 * 9.81
    s = np.linspace(0.0, 1.0, 41)
    shape = rod_at_rest(s, length=1.0, stiffness=0.25, weight_y=-weight)
    count = 12
    rod = MovingRod(1.0, 0.25, 0.1, gravity=-9.81j)
    x = 2.0 * s - 1.0
    rows = np.eye(count + 1)[1:] + np.eye(count + 1)[:-1]
    table = np.polynomial.legendre.legval(x, rows.T).T
    a = np.linalg.lstsq(table, shape["theta"], rcond=None)[0]
    np.testing.assert_allclose(table @ a, shape["theta"], atol=1e-9, rtol=0)
    t, zero_rates = np.linspace(0.0, 0.5, 6), np.zeros(count)
    curves = rod.curves(t, *rod.integrate(t, a, zero_rates, 2e-3))
    np.testing.assert_allclose(curves["tip_y"], shape["y"][-1], atol=1e-7)
    assert curves["force_y"] == pytest.approx(weight, abs=1e-6)
    moment = weight * np.trapezoid(shape["x"], s)
    assert curves["moment"] == pytest.approx(moment, rel=1e-3)


def test_changes_by_more_polynomials_and_shorter_steps_are_as_stated():
    """Half the step changes a position by 3e-6, more polynomials by up to `POSITION_TOLERANCE`."""
    t = np.linspace(0.0, 0.8, 9)
    rod = MovingRod(1.0, 0.25, 0.1, gravity=-9.81j)
    step = 1.0 / rod.frequencies(10)[rod_motion.RESOLVED_MODES - 1]
    places = [
        rod.curves(t, *rod.integrate(t, np.zeros(n), np.zeros(n), h))["tip_y"]
        for n, h in ((16, step), (16, step / 2), (24, step))
    ]
    assert np.abs(places[1] - places[0]).max() < 5e-6
    assert np.abs(places[2] - places[0]).max() < 2e-5


def test_a_stiff_coupler_moves_like_a_rigid_one():
    """With a coupler ten times as stiff the slider's difference from a rigid linkage is 1/100.

    This difference is of the order of the square of the deflection.
    """
    angle, speed = np.linspace(0.0, 1.5, 7), 3.0
    rigid = slider_crank.solve(
        angle,
        speed + 0.0 * angle,
        0.0 * angle,
        crank=0.25,
        coupler=1.0,
        mode=1,
        coupler_mass=0.1,
        slider_mass=0.05,
        gravity=0.0,
        inertia=True,
    )
    off = []
    for stiffness in (0.5, 5.0):
        links = LINKS | {"stiffness": stiffness}
        bent = slider_crank_elastic.solve(angle, speed + 0.0 * angle, 0.0 * angle, **links)
        off.append(
            [
                np.abs(bent["slider"] - rigid["slide"]).max(),
                np.abs(bent["drive_moment"] - rigid["holding_moment"]).max(),
            ]
        )
    assert off[1][0] < 0.02 * off[0][0]
    assert off[1][1] < 0.5 * off[0][1]  # an oscillation from the start
    assert off[1][1] < 0.01 * np.ptp(rigid["holding_moment"])


def test_an_elastic_coupler_is_the_limit_of_chains():
    """An elastic coupler moves like chains of 4, 8 and 16 links, extrapolated in 1/n^2.

    The chains have other equations of motion.
    """
    angle = np.linspace(0.0, 1.2, 5)
    found = slider_crank_elastic.solve(angle, 6.0 + 0.0 * angle, 0.0 * angle, **LINKS)
    wanted = np.array([found[f"{at}_x"] + 1j * found[f"{at}_y"] for at in ("middle", "tip")])
    links = {key: value for key, value in LINKS.items() if key != "coupler"}
    chains = [driven_chain(angle / 6.0, n, rate=6.0, **links) for n in (4, 8, 16)]
    errors = [np.abs(one - wanted).max() for one in chains]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.2)
    assert np.log2(errors[1] / errors[2]) == pytest.approx(2.0, abs=0.1)
    limit = chains[2] + (chains[2] - chains[1]) / 3.0
    assert np.abs(limit - wanted).max() < 0.02 * errors[2]


def test_the_moment_of_the_drive_is_the_slope_of_the_energy():
    """The integral of the drive's moment over its angle is the increase of the energy.

    The tip stays on its guide, and the velocity of the slider is the derivative of its position.
    """
    angle = np.linspace(0.0, 2.0, 201)
    at = slider_crank_elastic.solve(angle, 6.0 + 0.0 * angle, 0.0 * angle, gravity=2.0, **LINKS)
    gained = at["energy"][-1] - at["energy"][0]
    work = np.trapezoid(at["drive_moment"], angle)
    assert work == pytest.approx(gained, abs=1e-4 * np.ptp(at["energy"]))
    assert np.abs(at["tip_y"]).max() < 1e-12
    speed = np.gradient(at["slider"], angle * (1.0 / 6.0))
    np.testing.assert_allclose(speed[1:-1], at["slider_velocity"][1:-1], atol=1e-3)
    assert np.abs(at["deflection"]).max() > 0.03


def test_drives_that_differ_by_rounding_have_one_motion(monkeypatch):
    """Drives that differ by rounding errors share one integration of the motion.

    A drive with an angle that is larger by 1e-6 has its own: the slider is ahead in proportion.
    """
    integrated, whole = [], rod_motion.motion_curves
    monkeypatch.setattr(
        rod_motion, "motion_curves", lambda *given: integrated.append(1) or whole(*given)
    )
    angle = np.linspace(0.0, 1.0, 5)
    noise = 1e-13 * np.cos(np.arange(5.0))
    links = LINKS | {"coupler_mass": 0.123}
    one = slider_crank_elastic.solve(angle, 6.0 + 0.0 * angle, 0.0 * angle, **links)
    first = len(integrated)
    two = slider_crank_elastic.solve(angle + noise, 6.0 + noise, 0.0 * angle, **links)
    assert first
    assert len(integrated) == first
    assert np.abs(two["slider"] - one["slider"]).max() < 1e-9
    three = slider_crank_elastic.solve(angle * (1 + 1e-6), 6.0 + 0.0 * angle, 0 * angle, **links)
    assert len(integrated) > first
    ahead = (three["slider"] - one["slider"])[-1] / (1e-6 * one["slider_velocity"][-1] / 6.0)
    assert ahead == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"length": 0.0}, "length must be a positive"),
        ({"stiffness": -1.0}, r"stiffness must be positive and finite \[N m\^2\], got -1"),
        ({"mass": np.inf}, "mass must be positive"),
        ({"gravity": np.nan}, "gravity must be finite"),
        ({"stiffness": [1.0, 2.0]}, "stiffness must be positive"),
        ({"mass": 1e300}, r"mass must be from 1e-40 to 1e\+40 \[kg\]"),
        ({"theta0": [0.0, 1.0]}, "theta0 must be one number"),
        ({"time": [-1.0, 0.0]}, "time must not be negative"),
        ({"stiffness": 1e12}, "too stiff to be followed so long"),
    ],
)
def test_bad_input_of_a_released_rod(change, words):
    with pytest.raises(ValueError, match=words):
        rod_released.solve(**({"time": [0.0, 1.0]} | ROD | change))


@pytest.mark.parametrize(
    ("change", "rate", "words"),
    [
        ({"crank": 1.0}, 1.0, "coupler must be longer than the crank, 1 m, got 1 m"),
        ({}, 0.0, "rate must be constant and not zero"),
        ({}, [1.0, 1.1, 1.0], "rate must be constant and not zero"),
        ({"slider_mass": -1.0}, 1.0, "slider_mass"),
        ({"coupler": np.nan}, 1.0, "^coupler must be"),
        ({"coupler_mass": 0.0}, 1.0, "^coupler_mass must be"),
        ({"gravity": [0.0, 1.0]}, 1.0, "gravity must be one number"),
        ({}, -1.0, "angle must follow the rate of -1 rad/s .* got 0.5 rad after 0 rad"),
    ],
)
def test_bad_input_of_an_elastic_coupler(change, rate, words):
    angle = np.linspace(0.0, 1.0, 3)
    with pytest.raises(ValueError, match=words):
        slider_crank_elastic.solve(angle, rate + 0.0 * angle, 0.0 * angle, **(LINKS | change))


@pytest.mark.parametrize(
    ("angle", "words"),
    [
        ([0.0, 1.0, 0.9999], "angle must follow the rate of 6 rad/s .* got 0.9999 rad after 1 rad"),
        ([], r"angle must be one row of angles \(n,\), got an array \(0,\)"),
        ([[0.0, 0.1], [0.2, 0.3]], r"got an array \(2, 2\)"),
        ([0.0, np.nan], "angle must be finite"),
    ],
)
def test_angles_that_are_not_in_the_order_of_time_are_refused(angle, words):
    """A motion in time has no earlier poses after later ones: it had the later one's for them."""
    angle = np.array(angle)
    with pytest.raises(ValueError, match=words):
        slider_crank_elastic.solve(angle, 6.0 + 0.0 * angle, 0.0 * angle, **LINKS)


def test_a_neighbour_uses_the_same_number_of_polynomials(monkeypatch):
    """A rod with a mass changed by 1e-6 uses the number of polynomials that the rod needed."""
    counts, moved = [], rod_motion.motion_curves
    monkeypatch.setattr(
        rod_motion,
        "motion_curves",
        lambda rod, t, a, rate: counts.append(a.size) or moved(rod, t, a, rate),
    )
    t, numbers, memory = np.linspace(0.0, 0.1, 3), ROD | {"mass": 0.101}, {}
    with use_memory(memory, store_results=True):
        own = rod_released.solve(t, **numbers)
    assert counts == list(rod_motion.POLYNOMIAL_COUNTS[: len(counts)])
    needed = counts[-1]
    counts.clear()
    with use_memory(memory, store_results=False):
        near = rod_released.solve(t, **numbers | {"mass": 0.101 * (1.0 + 1e-6)})
    assert counts == [needed]
    assert 0.0 < np.abs(near["tip_y"] - own["tip_y"]).max() < 1e-6
