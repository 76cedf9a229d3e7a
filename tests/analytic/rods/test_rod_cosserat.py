"""Rods that stretch and shear: a second formulation, limits, buckling, energy and bad input."""

import numpy as np
import pytest
from scipy.optimize import brentq

from proofmass.analytic.rods import equilibria, integrate, solve
from proofmass.analytic.rods.shooting import stability
from tests.independent.rods.cosserat import Section, shoot

ARC_LENGTHS = np.linspace(0.0, 1.2, 7)
LOADS = {
    "force": {"force": (-2.0, 5.0), "moment": 0.3},
    "pull": {"force": (9.0, 2.0), "moment": -0.5},
    "own weight": {"line": (0.0, -6.0)},
    "weight and force": {"line": (-1.5, 2.0), "force": (1.0, -3.0), "moment": 0.2},
}
SECTIONS = {"both": (40.0, 20.0), "soft": (12.0, 9.0), "axial": (15.0, 1e4), "shear": (1e4, 15.0)}


def load_parameters(force=(0.0, 0.0), line=(0.0, 0.0), moment=0.0):
    """The loads by the names of the parameters of `solve`."""
    return {
        "force_x": force[0],
        "force_y": force[1],
        "weight_x": line[0],
        "weight_y": line[1],
        "moment": moment,
    }


@pytest.mark.parametrize(
    ("section", "load"),
    [("both", load) for load in LOADS] + [(section, "force") for section in SECTIONS][1:],
)
def test_shooting_in_the_frame_of_the_sections(load, section):
    """All curves of `solve` are those of a second formulation, to 1e-10.

    The second formulation has other unknowns, another integrator and another search.
    """
    axial, shear = SECTIONS[section]
    reference = shoot(ARC_LENGTHS, Section(0.9, axial, shear), **LOADS[load])
    strained = {"axial": axial, "shear": shear}
    found = solve(
        ARC_LENGTHS, length=1.2, stiffness=0.9, **strained, **load_parameters(**LOADS[load])
    )
    for name, values in reference.items():
        # errors of both: 1e-13 in a step of DOP853, order 8 in 64 steps of `solve`; m is up to 10
        np.testing.assert_allclose(found[name], values, rtol=1e-10, atol=1e-10)
    stiff = solve(ARC_LENGTHS, length=1.2, stiffness=0.9, **load_parameters(**LOADS[load]))
    assert np.abs(stiff["y"] - reference["y"]).max() > 1e-3  # strains have an effect


def test_a_pull_along_the_rod_stretches_it():
    """A force and a weight along a rod stretch it by their integral over EA, and do not bend it."""
    rod = solve(np.array([0.5, 2.0]), length=2.0, force_x=3.0, weight_x=1.0, axial=10.0, shear=4.0)
    s = np.array([0.5, 2.0])
    exact = s + (3.0 * s + 2.0 * s - s**2 / 2.0) / 10.0  # the integral of 1 + (F + w (L - s))/EA
    np.testing.assert_allclose(rod["x"], exact, rtol=0, atol=1e-13)  # rounding
    np.testing.assert_allclose(rod["theta"], 0.0, atol=1e-13)


def test_small_loads_bend_and_shear_as_timoshenko_says():
    """Small deflections are those of Timoshenko's beam.

    They are F L^3/3EI + F L/GA, w L^4/8EI + w L^2/2GA, and M L^2/2EI, since a moment causes no
    shear.
    """
    small, section = 1e-6, {"length": 1.5, "stiffness": 0.7, "axial": 30.0, "shear": 8.0}
    for load, deflection in (
        ("force_y", 1.5**3 / (3.0 * 0.7) + 1.5 / 8.0),
        ("weight_y", 1.5**4 / (8.0 * 0.7) + 1.5**2 / 16.0),
        ("moment", 1.5**2 / (2.0 * 0.7)),
    ):
        rod = solve(1.5, **section, **{load: small})
        # terms of third order in the load, and rounding of a length of 1.5 over the load
        assert rod["y"] / small == pytest.approx(deflection, abs=1e-8)


@pytest.mark.parametrize(("axial", "shear"), [(30.0, np.inf), (np.inf, 9.0), (30.0, 9.0)])
def test_a_column_with_strains_buckles_at_its_critical_load(axial, shear):
    """A column with strains becomes unstable at its critical load, within 1e-4 of it.

    The load follows from the linear equation about the compressed column,
    EI theta'' + P (1 - P/EA + P/GA) theta = 0.
    """

    def beyond(load):
        return load * (1.0 - load / axial + load / shear) - np.pi**2 / 4.0

    load = brentq(beyond, 0.1, 4.0, xtol=1e-14)
    assert abs(load - np.pi**2 / 4.0) > 0.2
    shares = -load * np.array([1.0 - 1e-4, 1.0 + 1e-4])
    straight = stability(shares, 0.0, 0.0, axial=axial, shear=shear)
    assert straight.free.tolist() == [0, 1]


def test_potential_by_virtual_work():
    """The derivative of V by a load is minus its position; that by 1/EA is minus the integral of
    A^2/2, with the axial force A, and that by 1/GA likewise with the shear force.

    Two parameters change at once, the second one by twice the step.
    """
    section, step, load = {"axial": 25.0, "shear": 15.0}, 1e-4, {"force_x": -2.0, "weight_y": -8.0}
    s, weights = np.polynomial.legendre.leggauss(30)
    rod = solve(np.append(0.5 * (1.0 + s), 1.0), **load, **section)
    local = (rod["force_x"] + 1j * rod["force_y"])[:-1] * np.exp(-1j * rod["theta"][:-1])

    def slope(change):
        ahead, behind = (
            equilibria(**load | section | change(sign * step))["potential"][0] for sign in (1, -1)
        )
        return (ahead - behind) / (2.0 * step)

    # step^2, and rounding over the step
    place = 0.5 * weights @ rod["y"][:-1]
    by_load = slope(lambda d: {"force_x": d - 2.0, "weight_y": 2.0 * d - 8.0})
    assert -by_load == pytest.approx(rod["x"][-1] + 2.0 * place, abs=1e-7)
    by_strain = slope(
        lambda d: {
            key: 1.0 / (1.0 / section[key] + share * d)
            for key, share in (("axial", 1.0), ("shear", 2.0))
        }
    )
    squares = 0.25 * weights @ (local.real**2 + 2.0 * local.imag**2)
    assert -by_strain == pytest.approx(squares, rel=1e-5, abs=1e-7)  # as above


def test_slopes_agree_with_differences():
    """Derivatives of the tip of a rod with strains are central differences."""
    parameters, step = np.array([-1.2, 0.7, 0.5, 0.3]), 1e-4
    shared = {"weight_x": 0.3, "weight_y": -0.6, "length": 1.2, "axial": 7.0, "shear": 5.0}
    exact = integrate(*parameters[:3], theta0=parameters[3], slopes=True, **shared).slope[-1]
    offsets = step * np.concatenate([np.eye(4), -np.eye(4)])
    moved = (parameters + offsets).T
    ends = integrate(*moved[:3], theta0=moved[3], **shared)
    values = np.array([ends.theta[-1], ends.m[-1], ends.x[-1], ends.y[-1]])
    slope = (values[:, :4] - values[:, 4:]) / (2.0 * step)
    np.testing.assert_allclose(exact, slope, rtol=0, atol=1e-7)  # third derivatives times step^2


@pytest.mark.parametrize("name", ["axial", "shear"])
@pytest.mark.parametrize("value", [0.0, -3.0, np.nan])
def test_an_invalid_stiffness_is_named(name, value):
    for function in (lambda **k: solve(1.0, **k), lambda **k: integrate(0, 0, 0, **k)):
        with pytest.raises(ValueError, match=f"^{name} must be a positive stiffness of a section"):
            function(**{name: value})


def test_a_rod_compressed_to_zero_length_is_refused():
    with pytest.raises(
        ValueError, match=r"^axial must be more than 5 N: the loads compress the rod"
    ):
        solve(1.0, stiffness=100.0, force_x=-6.0, axial=5.0)
