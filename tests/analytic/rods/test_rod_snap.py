"""A rod between a motor and a pin: shapes, the fold where it snaps, and equilibria beyond it."""

from functools import cache

import numpy as np
import pytest
from scipy.integrate import trapezoid
from scipy.optimize import minimize_scalar

from proofmass.analytic.rods.elastica import rods_of_chart
from proofmass.analytic.rods.equilibrium import integrate_to_tip
from proofmass.analytic.rods.rod_snap import (
    MAX_HALF_WAVES,
    STRIDE,
    branches,
    events,
    family,
    properties,
    shapes,
    solve,
)
from proofmass.analytic.rods.shooting import integrate, stability

DISTANCES = 0.35, 0.5, 0.8, 0.95


def solve_and_shoot(angle, distance=0.8, **more):
    """The quantities of `solve`, and rods that are shot from their clamps with its forces."""
    found = solve(angle, distance=distance, **more)
    rod = integrate(
        found["force_x"],
        found["force_y"],
        -found["holding_moment"],
        theta0=np.asarray(angle),
        nodes=81,
        slopes=True,
    )
    return found, rod


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize("distance", DISTANCES)
def test_shapes_are_rods_from_the_clamp_to_the_pin(distance, side):
    """Rods that are shot from the clamp end at the pin, without a moment.

    Their middle, the direction of their tip and their energy are those of `solve`.
    """
    fold = events(distance=distance)["snaps to the left"]
    sign = {"left": 1, "right": -1}[side]
    angle = sign * np.linspace(1.4, -fold + 1e-6, 12)
    found, rod = solve_and_shoot(angle, distance, side=side)
    assert (found["side"] == sign).all()
    # order 8 with 80 steps; the error grows from the clamp by exp(alpha) if the rod is stretched
    np.testing.assert_allclose(rod.x[-1] + 1j * rod.y[-1], distance, atol=1e-8, rtol=0)
    np.testing.assert_allclose(rod.m[-1], 0.0, atol=1e-7)
    np.testing.assert_allclose(rod.x[40], found["mid_x"], atol=1e-9, rtol=0)
    np.testing.assert_allclose(rod.y[40], found["mid_y"], atol=1e-9, rtol=0)
    np.testing.assert_allclose(rod.theta[-1], found["tip_angle"], atol=1e-7, rtol=0)
    energy = trapezoid(rod.m**2, rod.s, axis=0) / 2.0
    np.testing.assert_allclose(found["energy"], energy, rtol=3e-3)  # 80 trapezoids


def test_moments_are_slopes_of_the_energy():
    """The holding moment is the derivative of the energy, and the moment of the pin's force."""
    angle, step = np.linspace(1.3, -0.9, 12), 1e-5
    found, *near = (solve(angle + d, distance=0.8) for d in (0.0, step, -step))
    slope = (near[0]["energy"] - near[1]["energy"]) / (2.0 * step)
    np.testing.assert_allclose(slope, found["holding_moment"], atol=1e-6)  # step^2, next to a fold
    np.testing.assert_allclose(found["holding_moment"], -0.8 * found["force_y"], atol=1e-12, rtol=0)


def test_lengths_and_stiffness_only_scale():
    """Positions scale with L, moments and energies with EI/L, forces with EI/L^2.

    The rod snaps between two of the samples.
    """
    angle = np.radians([70.0, 0.0, -100.0])
    one, two = (
        solve(angle, distance=0.5 * s, length=s, stiffness=k) for s, k in ((1.0, 1.0), (2.5, 7.0))
    )
    for names, scale in (
        (("mid_x", "mid_y"), 2.5),
        (("tip_angle", "side"), 1.0),
        (("holding_moment", "energy", "lost", "work"), 2.8),
        (("force_x", "force_y"), 1.12),
    ):
        for name in names:
            np.testing.assert_allclose(two[name], scale * one[name], rtol=1e-12)  # rounding
    assert one["side"].tolist() == [1, 1, -1]


@pytest.mark.parametrize("distance", DISTANCES)
def test_the_fold_is_where_shooting_is_singular(distance):
    """At the fold a* the Jacobian of (x, y, m) at the tip by (n_x, n_y, m0) is singular."""
    fold = events(distance=distance)["snaps to the left"]
    _, rod = solve_and_shoot(np.array([-fold, -fold + 1e-4]), distance)
    at, near = np.linalg.det(np.moveaxis(rod.slope[-1][[2, 3, 1], :3], -1, 0))
    # det is proportional to the root of the angle to the fold: 1e-2 of a radian's at 1e-4 rad
    assert abs(at) < 1e-5 * abs(near)


@pytest.mark.parametrize("distance", DISTANCES)
def test_the_branch_has_a_shape_at_every_stride(distance):
    """Shapes of the branch are a stride apart and have the pin at its distance.

    The branch leads from half a turn of the clamp to beyond the second fold.
    """
    of = family(1.0, distance)
    found = rods_of_chart(*np.exp(of.place.T))
    np.testing.assert_allclose(np.abs(found.tip), distance, rtol=1e-13)
    strides = np.linalg.norm(np.diff(of.place, axis=0), axis=1)
    next_to_folds = np.concatenate([of.folds - 1, of.folds])  # a fold divides a stride
    np.testing.assert_allclose(np.delete(strides, next_to_folds), STRIDE, rtol=1e-2)
    np.testing.assert_allclose(strides[of.folds - 1] + strides[of.folds], STRIDE, rtol=1e-2)
    assert abs(of.angle[0]) > np.pi > abs(of.angle[1])
    assert found.waves[-1] > MAX_HALF_WAVES > found.waves[-2]


@pytest.mark.parametrize("distance", DISTANCES)
def test_each_fold_adds_a_negative_direction(distance):
    """Beyond each fold there is one more negative direction, by Jacobi's field, with pinned tip."""
    of = family(1.0, distance)
    clear = np.abs(np.arange(of.angle.size)[:, None] - of.folds).min(axis=1) > 2
    which = np.flatnonzero(clear & (np.abs(of.angle) < 1.5))[::5]
    alpha, q = np.exp(of.place[which].T)
    rod = rods_of_chart(alpha, q)
    _, theta = integrate_to_tip(0.0, rod.moment, rod.force, 1.0, 1.0)
    count = stability(rod.force.real, rod.force.imag, theta[0]).pinned
    np.testing.assert_array_equal(count, (which[:, None] > of.folds).sum(axis=1))
    assert set(count) == {0, 1, 2}


def test_a_shallow_rod_snaps_where_a_beam_does():
    """As the pin is moved towards L, the angle of the fold tends to that of a linear beam.

    The beam is w = A (sin pt - t sin p) with t from the pin; a/sqrt(2 (1 - d)) is least at its
    fold.
    """

    def slope(p):
        size = p * p / 2.0 + p * np.sin(2.0 * p) / 4.0 - np.sin(p) ** 2
        return (np.sin(p) - p * np.cos(p)) / np.sqrt(size)

    least = minimize_scalar(slope, bounds=(5.0, 7.0), method="bounded", options={"xatol": 1e-12})
    off = [
        events(distance=1.0 - e)["snaps to the left"] / np.sqrt(2.0 * e) + least.fun
        for e in (0.2, 0.1, 0.05)
    ]
    ratios = np.divide(off[:-1], off[1:])
    np.testing.assert_allclose(ratios, 2.0, atol=0.1)  # terms of (1 - d)^2
    assert abs(off[-1]) < 0.02


@cache
def random_equilibria(angle: float, distance: float = 0.8, starts: int = 120):
    """Moments, energies and numbers of negative directions of equilibria, from random starts."""
    random = np.random.default_rng(1)
    m, n = (
        random.uniform(-15, 15, starts),
        random.uniform(-90, 60, starts) + 1j * random.uniform(-45, 45, starts),
    )
    for _ in range(25):
        z, _ = integrate_to_tip(angle, m, n, 1.0, 1.0)
        violation = [m + (n.conj() * z[0]).imag, z[0].real - distance, z[0].imag]
        by = np.add((n.conj() * z[1:]).imag, [np.ones_like(m), z[0].imag, -z[0].real])
        matrix = np.moveaxis(np.stack([by, z[1:].real, z[1:].imag]), -1, 0)
        step = np.linalg.solve(matrix, np.stack(violation, axis=-1)[..., None])[..., 0]
        step *= np.minimum(1.0, 5.0 / np.abs(step).max(axis=1))[:, None]
        good = np.abs(n) < 150
        m, n = (
            np.where(good, m - step[:, 0], m),
            np.where(good, n - step[:, 1] - 1j * step[:, 2], n),
        )
    met = np.abs(violation).max(axis=0) < 1e-9
    _, first = np.unique(np.stack([m, n.real, n.imag])[:, met].round(5), axis=1, return_index=True)
    m, n = m[met][first], n[met][first]
    z, theta = integrate_to_tip(angle, m, n, 1.0, 1.0)
    energy = m**2 / 2.0 + (n.conj() * np.exp(1j * angle)).real - (n.conj() * z[0]).real
    return m, energy, stability(n.real, n.imag, theta[0]).pinned


@pytest.mark.parametrize(
    "degrees",
    [54.338, 80.0, *(pytest.param(degrees, marks=pytest.mark.slow) for degrees in (58.0, 65.0))],
)
def test_one_stable_equilibrium_is_left_beyond_the_fold(degrees):
    """Beyond the fold one stable equilibrium has less energy than the fold, by random starts.

    It is the one that the rod snaps to.
    """
    fold = events(distance=0.8)["snaps to the left"]
    most = solve(-fold, distance=0.8)["energy"][0]
    m, energy, negative = random_equilibria(-np.radians(degrees))
    stable = (negative == 0) & (energy < most)
    assert stable.sum() == 1
    assert -m[stable] == pytest.approx(
        solve([-np.radians(degrees)], distance=0.8)["holding_moment"], abs=1e-7
    )  # errors of `integrate_to_tip` and of Newton's method


def test_there_are_two_stable_equilibria_between_the_folds():
    """Between the folds random starts find the stable equilibria of both sides, and saddles."""
    most = solve(-events(distance=0.8)["snaps to the left"], distance=0.8)["energy"][0]
    for degrees in (0.0, 30.0, 54.0):
        m, energy, negative = random_equilibria(-np.radians(degrees))
        stable = np.sort(-m[(negative == 0) & (energy < most)])
        sides = [
            solve([-np.radians(degrees)], distance=0.8, side=s)["holding_moment"][0]
            for s in ("left", "right")
        ]
        np.testing.assert_allclose(stable, np.sort(sides), atol=1e-7, rtol=0)  # as above
    assert (negative == 1).any()


def test_a_cycle_loses_the_work_of_the_motor():
    """In a closed cycle the work of the motor is the integral of its moment.

    All of this work is lost in two snaps.
    """
    t = np.linspace(0.0, 1.0, 20001)
    swing = solve(1.4 * np.cos(2.0 * np.pi * t), distance=0.8)
    angle = 1.4 * np.cos(2.0 * np.pi * t)
    assert np.flatnonzero(np.diff(swing["side"])).size == 2
    assert swing["energy"][-1] == pytest.approx(swing["energy"][0], rel=1e-12)  # rounding
    put_in = trapezoid(swing["holding_moment"], angle)
    # a snap is between two samples: 4e-4 rad times a moment of 1.5
    assert swing["work"][-1] == pytest.approx(put_in, abs=1e-3)
    assert swing["lost"][-1] == pytest.approx(swing["work"][-1], rel=1e-12)
    assert swing["lost"][-1] == pytest.approx(2.0 * 6.257, abs=1e-3)  # as `properties` says


def test_history_chooses_the_side():
    """The side of the rod depends on earlier angles; a mirrored motion has mirrored curves."""
    angle = np.radians([0.0, -60.0, 0.0, 60.0, 0.0])
    left, right = solve(angle, distance=0.8), solve(-angle, distance=0.8, side="right")
    assert left["side"].tolist() == [1, -1, -1, 1, 1]
    for name, sign in (
        ("mid_x", 1),
        ("mid_y", -1),
        ("holding_moment", -1),
        ("energy", 1),
        ("lost", 1),
        ("side", -1),
    ):
        np.testing.assert_array_equal(right[name], sign * left[name])


def test_charts_have_the_moments_of_the_solution():
    """Stable lines of the charts have the moments of `solve`; the snap leads from one to another.

    The drawn shapes have the length 1 and end at the pin.
    """
    lines = branches(distance=0.8).lines
    for side in ("left", "right"):
        line = next(line for line in lines if line.stable and side in line.label)
        order = np.argsort(line.x)
        angle = np.linspace(-0.9, 0.9, 7)
        drawn = np.interp(angle, line.x[order], line.y[order])
        reference = [solve([a], distance=0.8, side=side)["holding_moment"][0] for a in angle]
        np.testing.assert_allclose(drawn, reference, atol=1e-2)  # chords
    snap = next(line for line in lines if line.points)
    swing = solve(np.add(snap.x, [1e-9, -1e-9]), distance=0.8)
    np.testing.assert_allclose(swing["holding_moment"], snap.y, atol=1e-3)  # root of 1e-9
    for line in shapes(distance=0.8).lines:
        assert np.hypot(np.diff(line.x), np.diff(line.y)).sum() == pytest.approx(1.0, abs=1e-3)
        assert (line.x[-1], line.y[-1]) == pytest.approx((0.8, 0.0), abs=1e-12)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"distance": 1.0}, "distance must be from 0.32 to 0.99 of the length, 1 m, got 1"),
        ({"distance": -0.8}, "distance must be a positive"),
        ({"length": 0.0}, "length must be"),
        ({"stiffness": -1.0}, "stiffness must be"),
        ({"side": "up"}, "left, right, got 'up'"),
        ({"angle": [0.0, 4.0]}, r"angle must be within \+-pi \[rad\], got 4"),
        ({"angle": [np.nan]}, "got nan"),
        ({"angle": []}, r"angle must be one row of angles \(n,\), got an array \(0,\)"),
        ({"angle": [[0.5]]}, r"got an array \(1, 1\)"),
        ({"distance": [0.8, 0.9]}, "distance must be a positive finite length"),
    ],
)
def test_bad_rods_in_space_are_refused_with_their_key(change, words):
    with pytest.raises(ValueError, match=words):
        solve(**{"angle": [0.0], "distance": 0.8} | change)


def test_properties_describe_the_snap():
    """The properties have the angle of the snap and the energy that is lost, in SI units."""
    described = properties(distance=0.8, stiffness=0.05218602640386952)
    assert described["snaps at"] == "±54.337°"
    assert described["lost in a snap"].startswith("0.3265 J")
    with pytest.raises(ValueError, match="stiffness must be positive"):
        properties(distance=0.8, stiffness=np.nan)
