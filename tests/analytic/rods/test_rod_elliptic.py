"""The rod by elliptic integrals: Carlson's integrals, shooting, a table, and conservation laws."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import elliprd, elliprf

from proofmass.analytic.rods import (
    bounds,
    integrate,
    modulus,
    of_load,
    of_shape,
    relative,
    shape,
    tip,
)
from proofmass.analytic.rods.elastica import (
    elliptic_integrals,
    incomplete_integrals,
    jacobi_functions,
)

DATA = json.loads((Path(__file__).parents[2] / "data" / "rod_elliptic.json").read_text())
TABLE = dict(
    zip(DATA["unit_table"]["columns"], np.array(DATA["unit_table"]["rows"]).T, strict=True)
)
PSI = st.floats(0.05, 6.2)
K_REL = st.floats(0.02, 0.999).flatmap(lambda k: st.sampled_from([k, -k]))
MODE = st.integers(1, 5)
GAUSS = np.polynomial.legendre.leggauss(300)


def amplitudes(size, count=4000):
    """Sine, cosine, delta and complement of amplitudes in [0, pi), a quarter next to pi/2.

    The complements k' are about `size`.
    """
    rng = np.random.default_rng(0)
    other = size * rng.uniform(0.5, 1.0, count)
    phi = rng.uniform(0.0, np.pi, count)
    phi[: count // 4] = np.pi / 2 - 10.0 ** rng.uniform(-10.0, 0.0, count // 4)
    phi[:3] = 0.0, np.pi / 2, np.pi / 4
    sine, cosine = np.sin(phi), np.cos(phi)
    return sine, cosine, np.hypot(cosine, other * sine), other


@pytest.mark.parametrize("size", [1.0, 1e-3, 1e-6, 1e-9])
def test_legendres_integrals_follow_from_carlsons(size):
    """Legendre's integrals are those by Carlson's, which use duplication instead of means."""
    s, c, d, other = amplitudes(size)
    square = (1.0 - other) * (1.0 + other)
    whole = elliprf(0.0, other**2, 1.0)
    whole_second = whole - square / 3.0 * elliprd(0.0, other**2, 1.0)
    first = s * elliprf(c * c, d * d, 1.0)
    second = first - square * s**3 / 3.0 * elliprd(c * c, d * d, 1.0)
    far = c < 0.0
    expected = (
        np.where(far, 2.0 * whole - first, first),
        np.where(far, 2.0 * whole_second - second, second),
        whole,
        whole_second,
    )
    for found, true in zip(elliptic_integrals(s, c, d, other), expected, strict=True):
        # a few rounding errors of F; E is F less a number of nearly the same size
        np.testing.assert_allclose(found, true, rtol=2e-15, atol=5e-15 * whole.max())


@pytest.mark.parametrize("size", [1.0, 1e-3, 1e-6, 1e-9])
def test_jacobi_inverts_legendre(size):
    """Jacobi's functions of F(phi) are sine, cosine, delta and E of the amplitude phi."""
    s, c, d, other = amplitudes(size)
    first, second, *_ = elliptic_integrals(s, c, d, other)
    sn, cn, dn, epsilon = jacobi_functions(first, other)
    # rounding errors of u, 2e-16 K with K up to 22
    for found, true in ((sn, s), (cn, c), (epsilon, second)):
        np.testing.assert_allclose(found, true, rtol=0, atol=3e-14)
    np.testing.assert_allclose(dn, d, rtol=3e-14)


@pytest.mark.parametrize("k", [0.0, 0.3, -0.9, 1.0 - 1e-12])
def test_incomplete_integrals_have_their_slopes_and_periods(k):
    """Incomplete integrals have their integrands as slopes, and grow by 2 K and 2 E over pi."""
    phi = np.linspace(-9.0, 9.0, 61)
    first, second = incomplete_integrals(phi, k)
    step = 1e-3 * np.sqrt(1.0 - k**2) ** 0.5
    ahead, behind = incomplete_integrals(phi + step, k), incomplete_integrals(phi - step, k)
    root = np.sqrt(1.0 - (k * np.sin(phi)) ** 2)
    regular = root > 0.1  # elsewhere the integrand changes in a step
    for slope, up, down in ((1.0 / root, ahead[0], behind[0]), (root, ahead[1], behind[1])):
        error = np.abs((up - down) / (2.0 * step) / slope - 1.0)[regular]
        assert error.max() <= 40.0 * step**2 + 1e-13 / step  # third derivative; rounding
    later = incomplete_integrals(phi + np.pi, k)
    whole = incomplete_integrals(np.pi / 2, k)
    for now, then, part in zip((first, second), later, whole, strict=True):
        # phi + pi is rounded by 1e-15, times the slope 1/k'
        np.testing.assert_allclose(
            then - now, 2.0 * part, rtol=1e-14, atol=2e-15 / np.sqrt(1.0 - k**2)
        )


def test_tips_are_those_of_an_independent_table():
    """70 rods are those of the table, whose program is independent.

    It computes the arccos of moduli next to 1, so that its angles have errors of 1e-10.
    """
    found = tip(TABLE["psi"], TABLE["kr"], TABLE["mode"])
    allowed = {"R": 1e-12, "x": 1e-12, "y": 1e-12, "m0": 1e-12}  # rounding
    for name, share in allowed.items():
        np.testing.assert_allclose(found[name], TABLE[name], rtol=share, atol=share)
    np.testing.assert_allclose(np.degrees(found["theta"]), TABLE["tip_deg"], rtol=0, atol=1e-8)
    np.testing.assert_allclose(found["energy"], TABLE["U"], rtol=1e-11)  # quadrature


def test_shooting_agrees():
    """Forty random rods of one to five inflections, |k_rel| up to 0.95, agree with shooting."""
    rng = np.random.default_rng(1)
    psi, mode = rng.uniform(0.1, 6.1, 40), rng.integers(1, 6, 40)
    k_rel = rng.uniform(0.02, 0.95, 40) * rng.choice([-1, 1], 40)
    rod = tip(psi, k_rel, mode)
    shot = integrate(
        rod["R"] * np.cos(psi), rod["R"] * np.sin(psi), rod["m0"], nodes=801, slopes=True
    )
    curve = shape(psi, k_rel, mode, shot.s[:, None])
    # rounding errors of R and m0, 1e-15, times the slopes of the rod; error of the steps, 1e-12
    moved = np.abs(shot.slope[:, :, :3]).max(axis=2).max(axis=0)
    allowed = 1e-15 * moved * np.maximum(rod["R"], 1.0) + 1e-12 * np.array([1, 20, 1, 1])[:, None]
    for name, slack in zip(("theta", "m", "x", "y"), allowed, strict=True):
        error = np.abs(getattr(shot, name) - curve[name]).max(axis=0)
        assert np.all(error <= 4.0 * slack), f"{name}: {(error / slack).max():.3g}"


@settings(derandomize=True, max_examples=60, deadline=None)
@given(PSI, K_REL, MODE)
def test_end_of_the_shape_is_the_tip(psi, k_rel, mode):
    """The shape by Jacobi's functions from the tip ends at the tip by Legendre's integrals."""
    rod, curve = tip(psi, k_rel, mode), shape(psi, k_rel, mode, np.array([0.0, 1.0]))
    for name in ("x", "y", "theta"):
        assert abs(curve[name][0]) <= 1e-12  # L sqrt(R) rounding errors
        assert abs(curve[name][1] - rod[name]) <= 1e-13
    assert abs(curve["m"][0] - rod["m0"]) <= 1e-12 * max(np.sqrt(rod["R"]), 1.0)


@settings(derandomize=True, max_examples=100, deadline=None)
@given(PSI, K_REL, MODE)
def test_rods_satisfy_balance_first_integral_and_energy(psi, k_rel, mode):
    """Random rods satisfy the balance of moments about the tip and the first integral.

    Their energy is a quadrature of m^2, and the number of their inflections is that of the mode.
    """
    rod = tip(psi, k_rel, mode, length=0.7, stiffness=0.3)
    n = rod["R"] * np.array([np.cos(psi), np.sin(psi)])
    scale = np.sqrt(rod["R"] * 0.3)
    assert abs(rod["m0"] - (rod["x"] * n[1] - rod["y"] * n[0])) <= 1e-13 * scale * 10
    s, weight = GAUSS
    curve = shape(psi, k_rel, mode, 0.5 * (1.0 + s), length=0.7, stiffness=0.3)
    first = curve["m"] ** 2 / 0.6 + n[0] * np.cos(curve["theta"]) + n[1] * np.sin(curve["theta"])
    np.testing.assert_allclose(
        first, n @ [np.cos(rod["theta"]), np.sin(rod["theta"])], rtol=0, atol=1e-12 * rod["R"]
    )  # rounding
    energy = 0.35 * weight @ curve["m"] ** 2 / 0.6
    assert abs(energy - rod["energy"]) <= 1e-13 * rod["R"] * 0.7 + 1e-12 * rod["energy"]
    inside = np.sum(np.diff(np.sign(curve["m"])) != 0)
    assert inside == mode - 1
    tangents = 0.35 * weight @ np.exp(1j * curve["theta"])
    assert abs(tangents - (rod["x"] + 1j * rod["y"])) <= 1e-12  # Gauss's rule on an entire function


@pytest.mark.parametrize(("psi", "mode"), [(1.0, 1), (2.8, 2), (4.0, 1), (5.5, 3)])
def test_energy_rises_with_the_work_of_the_load(psi, mode):
    """dU = n . dp with a fixed clamp, by central differences along k_rel."""
    step = 1e-5
    before, here, after = (tip(psi, 0.4 + d, mode) for d in (-step, 0.0, step))
    work = here["R"] * (
        np.cos(psi) * (after["x"] - before["x"]) + np.sin(psi) * (after["y"] - before["y"])
    )
    # third derivatives times step^2, and rounding over the step
    assert work == pytest.approx(after["energy"] - before["energy"], rel=1e-7, abs=0)


@settings(derandomize=True, max_examples=60, deadline=None)
@given(PSI, K_REL, MODE)
def test_parameters_of_mirrored_rods_and_of_loads_agree(psi, k_rel, mode):
    """The mirrored rod has 2 pi - psi and -k_rel; the load gives back psi, k_rel and the mode."""
    rod, image = tip(psi, k_rel, mode), tip(2.0 * np.pi - psi, -k_rel, mode)
    for name, sign in (("R", 1), ("x", 1), ("y", -1), ("theta", -1), ("m0", -1), ("energy", 1)):
        # the rounding of 2 pi - psi, 4e-16, which half angles magnify next to k_rel = 0
        np.testing.assert_allclose(image[name], sign * rod[name], rtol=1e-11, atol=1e-12)
    k, other = modulus(psi, k_rel)
    assert abs(np.hypot(k, other) - 1.0) <= 1e-15
    assert relative(psi, k) == pytest.approx(k_rel, rel=1e-13, abs=1e-15 / bounds(psi)[1])
    turn = 0.4
    back = of_load(
        rod["R"] * np.cos(psi + turn), rod["R"] * np.sin(psi + turn), rod["m0"], theta0=turn
    )
    assert back[2] == mode
    # the rounding of m0^2/(4R) and of psi, over 1 - k_min
    assert abs(back[0] - psi) <= 3e-15
    assert abs(back[1] - k_rel) <= 1e-14 / bounds(psi)[1]


def test_parameters_jump_at_zero_moment_and_the_shape_does_not():
    """As m0 passes zero, k_rel > 0 with mode q + 1 becomes k_rel < 0 with mode q, for one shape."""
    for psi, sign in ((2.0, 1.0), (5.0, -1.0)):  # sign of the new wave, cos(psi/2)
        near = [tip(psi, sign * d, q) for d, q in ((1e-9, 2), (-1e-9, 1))]
        for name in ("R", "x", "y", "theta"):
            # m0 is proportional to sqrt(k_rel), 6e-5 here; the others differ in proportion to m0
            assert near[0][name] == pytest.approx(near[1][name], rel=2e-3, abs=2e-3)
        assert near[0]["m0"] * near[1]["m0"] < 0.0


def test_light_and_taut_rods_have_their_limits():
    """Rods under small loads, taut rods and rods pulled along the clamp have their known limits."""
    light = tip(1.0, 1e-9)  # a rod that hardly bends: y = R sin(psi)/3, m0 = R sin(psi)
    assert light["x"] == pytest.approx(1.0, abs=1e-15)
    assert light["y"] == pytest.approx(
        light["R"] * np.sin(1.0) / 3.0, rel=0, abs=5e-16
    )  # rounding of 1
    assert light["m0"] == pytest.approx(light["R"] * np.sin(1.0), rel=1e-8, abs=0)
    taut = tip(1.0, 1.0 - 1e-14)  # m0 -> 2 sqrt(R EI) sin(psi/2), all bending next to the clamp
    assert taut["m0"] == pytest.approx(2.0 * np.sqrt(taut["R"]) * np.sin(0.5), rel=1e-12)
    assert taut["theta"] == pytest.approx(1.0, abs=1e-6)  # sqrt(1 - k)
    along = tip(1e-9, [1e-6, 0.5])
    assert np.all(np.abs(along["theta"]) <= 1e-9)


def test_parameters_are_found_from_a_sampled_shape():
    """`of_shape` finds k_rel of sampled points, with an error of second order in their distance."""
    s = np.linspace(0.0, 2.0, 401)
    rod = shape(2.0, -0.6, 3, s / 2.0, length=2.0, stiffness=0.1)
    errors = []
    for every in (2, 1):
        found = of_shape(
            s[::every], rod["x"][::every], rod["y"][::every], rod["theta"][::every], stiffness=0.1
        )
        errors.append(abs(found[1] + 0.6))
        assert found[2] == 3
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.1)  # second order
    assert errors[1] < 1e-2


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("psi", {"psi": 0.0}),
        ("psi", {"psi": 7.0}),
        ("k_rel", {"k_rel": 1.0}),
        ("k_rel", {"k_rel": 0.0}),
        ("k_rel", {"k_rel": np.nan}),
        ("mode", {"mode": 0}),
        ("mode", {"mode": 1.5}),
        ("length", {"length": 0.0}),
        ("stiffness", {"stiffness": -1.0}),
    ],
)
def test_bad_value_is_named(name, change):
    with pytest.raises(ValueError, match=f"^{name} must"):
        tip(**{"psi": 1.0, "k_rel": 0.5, "mode": 1} | change)


def test_bad_inverse_and_modulus():
    with pytest.raises(ValueError, match="no inflection"):
        of_load(1.0, 0.0, 5.0)
    with pytest.raises(ValueError, match="half wave away"):
        of_load(1.0, 1.0, 0.1)
    with pytest.raises(ValueError, match=r"^fraction must"):
        shape(1.0, 0.5, 1, 1.1)
    with pytest.raises(ValueError, match=r"^k must"):
        incomplete_integrals(1.0, 1.0)
    with pytest.raises(ValueError, match=r"^complement must"):
        jacobi_functions(1.0, 0.0)


@pytest.mark.parametrize("k", [0.5, -0.5, 1.1, np.nan])
def test_a_modulus_that_no_rod_has_has_no_relative_modulus(k):
    """At psi = pi/2 a rod's |k| is from 0.707 to 1; 0.5 had the relative modulus 0.707."""
    with pytest.raises(ValueError, match="must lie within"):
        relative(0.5 * np.pi, [0.8, k])


@pytest.mark.parametrize("psi", [0.0, -1.0, 10.0, np.nan])
def test_moduli_are_refused_for_a_direction_out_of_a_turn(psi):
    for function in (modulus, relative):
        with pytest.raises(ValueError, match="psi must be within"):
            function(psi, 0.9)
    with pytest.raises(ValueError, match="psi must be within"):
        bounds([1.0, psi])


def test_a_relative_modulus_beyond_one_is_refused():
    with pytest.raises(ValueError, match="k_rel must lie within"):
        modulus(1.0, [0.5, -1.5])
