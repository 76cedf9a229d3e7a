"""Cantilevers under dead loads: published tips, all branches, weight, moments and stability."""

import json
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_bvp
from scipy.optimize import brentq
from scipy.special import ellipk

from proofmass.analytic.rods import (
    cantilever,
    equilibria,
    pseudo_rigid,
    self_buckling,
    solve,
    tip,
)
from proofmass.analytic.rods.cantilever import MIN_SHOOTING_STEPS, roots
from proofmass.analytic.rods.shooting import stability

DATA = json.loads((Path(__file__).parents[2] / "data" / "rod_elliptic.json").read_text())
ROWS = DATA["cantilever"]["rows"]
ENDS = np.array([0.0, 1.0])


@pytest.mark.parametrize("row", ROWS, ids=lambda row: f"alpha={row[0]:g}")
def test_published_tips(row):
    alpha, theta, across, along, moment = row
    rod = solve(0.8 * ENDS, length=0.8, stiffness=0.5, force_y=alpha * 0.5 / 0.64)
    found = [rod["theta"][1], rod["y"][1] / 0.8, 1.0 - rod["x"][1] / 0.8, rod["m"][0] * 1.6]
    expected = [theta, across, along, moment]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13)  # rounding


@pytest.mark.parametrize("force", [(0.0, 10.0), (-9.0, 1.0), (3.0, -4.0)])
def test_closed_form_by_shooting(force):
    """The closed form is the solution by shooting.

    A weight of 1e-300 N/m does not change the load, but makes `solve` use the shooting method.
    """
    s = np.linspace(0.0, 1.0, 11)
    closed = solve(s, force_x=force[0], force_y=force[1])
    shot = solve(s, force_x=force[0], force_y=force[1], weight_y=1e-300)
    for name in closed:
        # error of order 8: (L sqrt(R/EI)/64)^8 = 1e-11, times its constant
        np.testing.assert_allclose(shot[name], closed[name], rtol=0, atol=1e-11)
    assert MIN_SHOOTING_STEPS == 64


@pytest.mark.parametrize(
    "load",
    [
        {"force_x": 1.0, "force_y": -3.0, "moment": 0.7},
        {"weight_x": 2.0, "weight_y": -10.0},
        {"weight_y": -4.0, "force_x": -1.0, "moment": 2.0},
    ],
)
def test_boundary_value_problem_by_collocation(load):
    """`solve` finds the curves of scipy's collocation, which starts from the straight rod.

    Its loads grow in eight steps.
    """

    def rate(s, z, share):
        fx = share * (load.get("force_x", 0.0) + load.get("weight_x", 0.0) * (1.0 - s))
        fy = share * (load.get("force_y", 0.0) + load.get("weight_y", 0.0) * (1.0 - s))
        return np.stack([z[1], fx * np.sin(z[0]) - fy * np.cos(z[0]), np.cos(z[0]), np.sin(z[0])])

    def ends(a, b, share):
        return np.array([a[0], a[2], a[3], b[1] - share * load.get("moment", 0.0)])

    s = np.linspace(0.0, 1.0, 41)
    z = np.stack([0 * s, 0 * s, s, 0 * s])
    for share in np.arange(1, 9) / 8.0:
        found = solve_bvp(
            partial(rate, share=share), partial(ends, share=share), s, z, tol=1e-10, max_nodes=20000
        )
        z = found.sol(s)
    rod = solve(s, **load)
    for name, row in zip(("theta", "m", "x", "y"), z, strict=True):
        np.testing.assert_allclose(rod[name], row, rtol=0, atol=1e-9)  # collocation, summed


def test_end_moment_bends_into_a_circle():
    """A moment of 2 pi EI/L bends a rod to a circle of radius L/(2 pi), one of pi EI/L to half."""
    s = np.linspace(0.0, 2.0, 21)
    rod = solve(s, length=2.0, stiffness=0.3, moment=2.0 * np.pi * 0.3 / 2.0, theta0=0.4, x0=1.0)
    radius = 1.0 / np.pi
    turned = 0.4 + s / radius
    # error of order 8: (2 pi/64)^8 = 1e-8, times its constant 1e-6
    np.testing.assert_allclose(rod["theta"], turned, rtol=0, atol=1e-13)
    np.testing.assert_allclose(
        rod["x"], 1.0 + radius * (np.sin(turned) - np.sin(0.4)), atol=1e-12, rtol=0
    )
    np.testing.assert_allclose(
        rod["y"], radius * (np.cos(0.4) - np.cos(turned)), atol=1e-12, rtol=0
    )
    half = solve(1.0, moment=np.pi)
    assert [half["x"], half["y"]] == pytest.approx([0.0, 2.0 / np.pi], abs=1e-13)


@pytest.mark.parametrize(
    "load",
    [
        {"force_y": 40.0},
        {"force_x": -60.0, "force_y": 2.0},
        {"force_x": -30.0},
        {"weight_x": -60.0, "force_y": 0.3},
    ],
)
def test_every_branch_is_an_equilibrium_and_their_number_is_odd(load):
    """Each branch is an equilibrium, and the number of branches is odd.

    Branches with an even number of negative directions are one more than those with an odd number.
    """
    found = equilibria(**load)
    count = found["theta"].size
    assert count % 2 == 1
    assert np.sum((-1) ** found["unstable"]) == 1  # Morse: the potential grows without bounds
    assert found["unstable"][0] == 0
    assert np.all(np.diff(found["potential"]) > -1e-8)
    for k in range(count):
        rod = solve(ENDS, **load, branch=k + 1)
        assert [rod["theta"][0], rod["x"][0], rod["y"][0]] == pytest.approx([0, 0, 0], abs=1e-11)
        assert abs(rod["m"][1]) <= 1e-12
        assert rod["theta"][1] == pytest.approx(found["theta"][k], abs=1e-12)
    with pytest.raises(ValueError, match=f"^branch must be from 1 to {count}"):
        solve(0.5, **load, branch=count + 1)


def test_a_column_has_a_pair_of_bent_shapes_for_each_critical_load():
    """A column beyond (2 j - 1)^2 P_cr has j pairs of bent shapes; pair q has q inflections."""
    waves = np.pi / 2 * np.array([0.9, 1.1, 2.9, 3.1, 5.1])
    for wave, pairs in zip(waves, (0, 1, 1, 2, 3), strict=True):
        found = equilibria(force_x=-(wave**2))
        assert found["theta"].size == 2 * pairs + 1
        # the straight shape has as many negative directions as there are critical loads below
        assert found["unstable"][np.argmin(np.abs(found["theta"]))] == pairs
        for q in range(1, pairs + 1):
            k = np.sin(0.5 * np.abs(found["theta"]))
            # (2 q - 1) K(k) = wave, with K by scipy
            assert np.sum(np.abs((2 * q - 1) * ellipk(k**2) - wave) < 1e-9) == 2


def test_branches_are_modes_of_the_elliptic_form():
    """The branches of a load across the rod are rods of the closed form in (psi, k_rel, mode)."""
    found = equilibria(force_y=100.0)
    for theta, m0 in zip(found["theta"], found["m0"], strict=True):
        k = np.sqrt(0.5 + m0**2 / 400.0)
        k_rel = np.copysign((k - np.sqrt(0.5)) / (1.0 - np.sqrt(0.5)), m0)
        rods = tip(np.pi / 2, k_rel, np.arange(1, 5))
        # R of a rod under tension grows like log(1 - k), so that k loses digits, the angle does not
        hit = np.argmin(np.abs(rods["R"] - 100.0))
        assert rods["R"][hit] == pytest.approx(100.0, rel=1e-3)
        assert rods["theta"][hit] == pytest.approx(theta, abs=1e-3)


def test_a_pair_of_branches_begins_at_a_fold():
    """A pair of branches begins at a fold, d theta0/d theta_L = 0.

    The second variation has a zero at the fold, so that the compliance next to it is large.
    """
    low, high = 10.0, 11.0
    counts = [equilibria(force_y=force)["theta"].size for force in (low, high, 40.0)]
    assert counts == [1, 3, 3]
    for _ in range(7):
        middle = 0.5 * (low + high)
        few = equilibria(force_y=middle)["theta"].size == 1
        low, high = (middle, high) if few else (low, middle)
    pair = equilibria(force_y=high)
    assert sorted(pair["unstable"].tolist()) == [0, 0, 1]
    softest = stability(0.0, high, pair["theta"]).compliance
    # next to a fold the compliance grows like 1/sqrt(distance); here the distance is 1 N/2^7
    assert np.abs(softest).max() > 1.0
    assert np.ptp(pair["theta"][pair["theta"] < 0]) < 0.05


def test_column_under_its_own_weight():
    """The straight column is unstable above Greenhill's weight, and bent shapes begin there."""
    critical = self_buckling(length=1.5, stiffness=0.2)
    # theta'' + q x theta = 0 from the free end at x = 0: a power series in q x^3, zero at x = 1
    k = np.arange(1.0, 20.0)
    factors = np.cumprod(-1.0 / (3.0 * k * (3.0 * k - 1.0)))
    zero = brentq(lambda q: 1.0 + factors @ q**k, 7.0, 8.0, xtol=1e-14)
    # rounding of terms of up to 1.3 over the slope of 0.1
    assert critical * 1.5**3 / 0.2 == pytest.approx(zero, rel=2e-14, abs=0)
    for share, unstable in ((1.0 - 1e-6, 0), (1.0 + 1e-6, 1)):
        found = stability(0.0, 0.0, 0.0, weight_x=-share * critical, length=1.5, stiffness=0.2)
        assert found.free == unstable
    below, above = (
        equilibria(weight_x=-share * critical, length=1.5, stiffness=0.2)
        for share in (0.995, 1.005)
    )
    assert below["theta"].size == 1
    assert above["unstable"].tolist() == [0, 0, 1]
    assert above["theta"][0] == pytest.approx(-above["theta"][1], abs=1e-9)


@pytest.mark.parametrize(
    "load",
    [
        {"force_y": 6.0},
        {"force_x": -4.0},
        {"weight_y": -8.0},
        {"force_x": 1.0, "weight_y": 3.0, "moment": -1.0},
    ],
)
def test_potential_by_virtual_work(load):
    """The derivative of V by a load is minus the position of the load: x, y, or its integral."""
    step, name = 1e-4, next(iter(load))
    ahead, behind = (
        equilibria(**load | {name: load[name] + d})["potential"][0] for d in (step, -step)
    )
    rod = equilibria(**load)
    s, weight = np.polynomial.legendre.leggauss(60)
    shape = solve(0.5 * (1.0 + s), **load)
    along = name.startswith("weight")
    place = 0.5 * weight @ shape[name[-1]] if along else rod[name[-1]][0]
    assert (behind - ahead) / (2.0 * step) == pytest.approx(place, abs=1e-7)  # step^2, rounding
    energy = 0.25 * weight @ shape["m"] ** 2
    assert rod["energy"][0] == pytest.approx(energy, rel=1e-11)


def test_a_rotated_clamp_and_load_rotate_the_shape():
    """If the clamp and all loads are rotated by 2.3 rad, the shape is rotated as well."""
    s, turn = np.linspace(0.0, 1.2, 7), 2.3
    load = {"force": 2.0 - 1.0j, "weight": -0.4 + 0.9j}
    turned = {name: value * np.exp(1j * turn) for name, value in load.items()}

    def parts(loads):
        return {
            f"{name}_{axis}": getattr(value, part)
            for name, value in loads.items()
            for axis, part in (("x", "real"), ("y", "imag"))
        }

    unrotated = solve(s, length=1.2, stiffness=0.7, **parts(load))
    rod = solve(s, length=1.2, stiffness=0.7, **parts(turned), theta0=turn, x0=0.3, y0=-0.2)
    place = 0.3 - 0.2j + (unrotated["x"] + 1j * unrotated["y"]) * np.exp(1j * turn)
    np.testing.assert_allclose(rod["x"] + 1j * rod["y"], place, rtol=0, atol=1e-12)  # rounding
    np.testing.assert_allclose(rod["theta"], unrotated["theta"] + turn, rtol=0, atol=1e-12)


def test_small_loads_are_those_of_the_beam():
    """Deflections under small loads are those of the linear beam."""
    s = np.linspace(0.0, 1.0, 5)
    for load, curve in (
        ({"force_y": 1e-5}, s**2 / 2 - s**3 / 6),
        ({"weight_y": 1e-5}, s**2 / 4 - s**3 / 6 + s**4 / 24),
        ({"moment": 1e-5}, s**2 / 2),
    ):
        # cubic terms in the load: 1e-10 of it
        np.testing.assert_allclose(solve(s, **load)["y"], 1e-5 * curve, rtol=0, atol=1e-14)


def test_rods_that_are_pulled_have_one_straight_equilibrium():
    """A rod without load, or pulled along its axis, has one equilibrium, the straight one."""
    for load in ({"force_x": 5.0}, {}, {"force_x": 400.0, "force_y": 1e-9}):
        rod = equilibria(**load)
        assert rod["theta"].size == 1
        assert rod["x"] == pytest.approx([1.0], abs=1e-12)


@pytest.mark.parametrize("force", [0.5, 1.0, 2.0, 5.0, 6.5])
def test_the_pseudo_rigid_body_is_within_1_5_percent(force):
    model, reference = pseudo_rigid(force), solve(1.0, force_y=force)
    assert model["turn"] < np.radians(64.0)
    error = np.hypot(model["x"] - reference["x"], model["y"] - reference["y"])
    assert 1e-3 < error < 0.015  # 1.5 %, as its docstring states


def test_roots_close_together_are_found():
    """`roots` finds two roots 2e-5 apart, and none of a function that only comes close to zero."""
    close = 1e-5
    found = roots(lambda x: (x - 0.3) ** 2 - close**2, np.linspace(-1.0, 1.0, 50))
    assert found == pytest.approx([0.3 - close, 0.3 + close], abs=1e-11)  # rounding over slope
    assert roots(lambda x: x**2 + 1e-3, np.linspace(-1.0, 1.0, 50)).size == 0


@pytest.mark.parametrize(
    "change",
    [
        {"length": 0.0},
        {"stiffness": -0.1},
        {"force_x": np.inf},
        {"moment": np.nan},
        {"branch": 0},
        {"s": 1.1},
    ],
)
def test_bad_value_is_named(change):
    (name,) = change
    with pytest.raises(ValueError, match=f"^{name} must"):
        solve(**{"s": 0.5, "force_y": 1.0} | change)


@pytest.mark.parametrize("force", [np.nan, [1.0, np.inf]])
def test_a_pseudo_rigid_body_under_a_load_that_is_not_finite_is_refused(force):
    with pytest.raises(ValueError, match=r"^force must be finite"):
        pseudo_rigid(force)


def test_a_clamp_that_is_not_finite_and_half_a_branch_are_refused():
    for name in ("x0", "y0"):
        with pytest.raises(ValueError, match=f"{name} must be finite"):
            solve(1.0, force_y=1.0, **{name: np.nan})
    for branch in (1.5, np.nan, np.inf):
        with pytest.raises(ValueError, match="branch must be a whole number"):
            solve(1.0, force_x=-3.0, branch=branch)
    assert solve(1.0, force_x=-3.0, branch=2.0) == solve(1.0, force_x=-3.0, branch=2)


def test_a_rod_at_other_samples_is_not_searched_again(monkeypatch):
    """Runs with other samples of a rod share its equilibria, which callers do not change."""
    loads = {"force_x": -9.0, "force_y": 0.37, "weight_y": 0.11}
    before = equilibria(**loads)
    monkeypatch.setattr(cantilever, "roots", None)
    for name, values in equilibria(**loads).items():
        np.testing.assert_array_equal(values, before[name])
    # rounding: other samples are other steps of order 8
    assert solve(ENDS, **loads)["x"][1] == pytest.approx(before["x"][0], abs=1e-12)
