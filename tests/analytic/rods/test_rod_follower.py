"""Loads that turn with the tip: elliptic functions, a second formulation and Beck's column."""

import numpy as np
import pytest
from scipy.special import ellipj

from proofmass.analytic.rods import solve
from tests.independent.rods.cosserat import Section, shoot

ARC_LENGTHS = np.linspace(0.0, 1.2, 7)


@pytest.mark.parametrize(("along", "across"), [(0.0, 1.0), (0.0, 8.0), (-2.0, 8.0), (3.0, -5.0)])
def test_turn_of_the_tip_by_elliptic_functions(along, across):
    """The tip turns by theta_L, which follows from the angle psi of the load to the tip by

        cos((psi + theta_L)/2) = cos(psi/2) cd(L sqrt(R/EI), cos(psi/2))

    psi + theta_L is the angle of the load to the clamp.  The equation holds from any inflection of
    an elastica (Pérez Gámiz 2018, eqs 37 and 39).
    """
    length, stiffness, load = 1.2, 0.9, complex(along, abs(across))
    psi = np.angle(load)
    k = np.cos(psi / 2.0)
    _, cn, dn, _ = ellipj(length * np.sqrt(abs(load) / stiffness), k**2)
    turn = np.sign(across) * (2.0 * np.arccos(k * cn / dn) - psi)
    rod = solve(length, length=length, stiffness=stiffness, follower_x=along, follower_y=across)
    assert rod["theta"] == pytest.approx(turn, abs=1e-12)  # rounding, order 8 in 64 steps
    beyond = complex(along, across) * np.exp(1j * turn)
    assert complex(rod["force_x"], rod["force_y"]) == pytest.approx(beyond, abs=1e-11)


@pytest.mark.parametrize(
    "load",
    [
        {"follower": (-2.0, 6.0)},
        {"follower": (0.5, -3.0), "force": (1.0, 2.0), "moment": 0.2, "line": (0.5, -2.0)},
    ],
)
def test_shooting_in_the_frame_of_the_sections(load):
    """All curves of `solve` with follower forces are those of a second formulation, to 1e-10."""
    reference = shoot(ARC_LENGTHS, Section(0.9, 30.0, 20.0), **load)
    named = {
        f"{name}_{axis}": value
        for key, name in (("follower", "follower"), ("force", "force"), ("line", "weight"))
        for axis, value in zip("xy", load.get(key, (0.0, 0.0)), strict=True)
    }
    parameters = {"moment": load.get("moment", 0.0), "axial": 30.0, "shear": 20.0, **named}
    rod = solve(ARC_LENGTHS, length=1.2, stiffness=0.9, **parameters)
    for name, values in reference.items():
        # errors of both: 1e-13 in a step of DOP853, order 8 in 64 steps of `solve`
        np.testing.assert_allclose(rod[name], values, rtol=1e-10, atol=1e-10)


def test_a_follower_force_along_the_tip_does_not_bend_a_rod():
    """Beck's column flutters at 20.05 EI/L^2, but the straight equilibrium is its only one.

    Under a dead load there are three equilibria beyond Euler's pi^2/4, so that the test would fail
    if one kind of load were taken for the other.
    """
    assert solve(1.0, follower_x=-15.0)["y"] == pytest.approx(0.0, abs=1e-12)
    with pytest.raises(ValueError, match=r"^branch must be from 1 to 1, got 2$"):
        solve(1.0, follower_x=-15.0, branch=2)
    assert abs(solve(1.0, force_x=-15.0)["y"]) > 0.3


def test_a_follower_force_has_no_potential():
    """The compliance of the tip to two follower forces is not symmetric; to dead forces it is."""
    for name, asymmetric in (("follower", True), ("force", False)):
        base, step, compliances = {f"{name}_x": 1.0, f"{name}_y": 4.0}, 1e-4, []
        for axis in "xy":
            key = f"{name}_{axis}"
            ends = (solve(1.0, **base | {key: base[key] + s * step}) for s in (1, -1))
            up, down = (complex(end["x"], end["y"]) for end in ends)
            compliances.append((up - down) / (2.0 * step))
        turn = np.exp(1j * solve(1.0, **base)["theta"]) if asymmetric else 1.0
        found = np.array([[(move / turn).real, (move / turn).imag] for move in compliances])
        # differences of the second order in the step
        assert (abs(found[0, 1] - found[1, 0]) > 1e-2) == asymmetric


@pytest.mark.parametrize("name", ["follower_x", "follower_y", "weight_x"])
def test_a_load_that_is_no_number_is_named(name):
    with pytest.raises(ValueError, match=f"^{name} must be finite"):
        solve(1.0, **{name: np.nan})
