"""Chains of rigid segments: energy and its derivatives, exact cases, buckling and bad values."""

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.optimize import brentq
from scipy.special import jv

from tests.analytic.rods.rod_chain_cases import extrapolated
from tests.independent.rods.chain import (
    SCHEMES,
    carried_forces,
    chain,
    energy,
    gradient,
    hessian,
    moments,
    points,
    potential,
    root_moment,
    tip_slopes,
)
from tests.independent.rods.chain_matrix import Bordered
from tests.independent.rods.chain_newton import newton
from tests.independent.rods.chain_rod import free
from tests.independent.rods.stability import count_negative, curvatures

EACH_SCHEME = pytest.mark.parametrize("scheme", SCHEMES)
RNG = np.random.default_rng(5)
COMPLEX_STEP = 1e-30  # complex step of the differentiation; the error is its square


def random_chains(scheme):
    """A batch of random chains: chain, clamps, angles, carried forces and tip moments."""
    c = chain(7, length=[1.3, 0.8], stiffness=[0.7, 1.1], scheme=scheme, rigid_extension=[0.1, 0.0])
    pull = carried_forces(c, RNG.normal(size=(3, 1, 2)), RNG.normal(size=(3, 2, 2)))
    return c, RNG.normal(size=(3, 2, 3)), RNG.normal(size=(3, 2, 7)), pull, RNG.normal(size=(3, 2))


@EACH_SCHEME
def test_slopes_by_complex_steps(scheme):
    """Gradient, Hessian and slopes of the tip are derivatives by complex steps."""
    c, clamp, angle, pull, moment = random_chains(scheme)
    slope, curve = gradient(c, clamp, angle, pull, moment), hessian(c, angle, pull)
    for j in range(c.segments):
        ahead = angle + 1j * COMPLEX_STEP * np.eye(c.segments)[j]
        one = potential(c, clamp, ahead, pull, moment).imag / COMPLEX_STEP
        two = gradient(c, clamp, ahead, pull, moment).imag / COMPLEX_STEP
        tip = points(c, clamp, ahead)[..., -1, :].imag / COMPLEX_STEP
        np.testing.assert_allclose(one, slope[..., j], rtol=0, atol=1e-13)  # rounding of all sums
        np.testing.assert_allclose(two, curve[..., j], rtol=0, atol=1e-13)
        np.testing.assert_allclose(tip, tip_slopes(c, angle)[..., j], rtol=0, atol=1e-15)


@EACH_SCHEME
def test_the_potential_has_the_work_of_dead_loads(scheme):
    """V = U - F.tip - q.(centroid) L - M theta_n, up to a constant of the clamp's position."""
    c, clamp, angle, _, moment = random_chains(scheme)
    force, line = RNG.normal(size=(2, 3, 2, 2))
    at = points(c, clamp, angle)
    middle = 0.5 * (at[..., 1:, :] + at[..., :-1, :])
    weight = (c.length[..., None] * middle).sum(axis=-2)
    work = (force * at[..., -1, :] + line * weight).sum(axis=-1) + moment * angle[..., -1]
    level = potential(c, clamp, angle, carried_forces(c, force, line), moment)
    level -= energy(c, clamp, angle) - work
    again = angle + 1.0  # another shape with the same clamp has the same constant
    at = points(c, clamp, again)
    weight = (c.length[..., None] * 0.5 * (at[..., 1:, :] + at[..., :-1, :])).sum(axis=-2)
    work = (force * at[..., -1, :] + line * weight).sum(axis=-1) + moment * again[..., -1]
    other = potential(c, clamp, again, carried_forces(c, force, line), moment)
    np.testing.assert_allclose(other - energy(c, clamp, again) + work, level, rtol=0, atol=1e-13)


@EACH_SCHEME
def test_the_clamp_moment_is_that_of_the_first_spring_and_of_the_loads(scheme):
    """The moment at the clamp is that of the first spring plus that of the force on the stub.

    Without a line load it is the moment of the tip's loads about the clamp.
    """
    c = chain(9, scheme=scheme)
    clamp, force, line, moment = np.array([0.2, 0.1, 0.4]), [1.0, -2.0], [0.5, 1.0], 0.3
    found = free(c, clamp, force=force, line=line, moment=moment)
    pull = carried_forces(c, np.array(force), np.array(line))
    stub = c.length[0] * (np.cos(0.4) * pull[0, 1] - np.sin(0.4) * pull[0, 0])
    spring = moments(c, clamp, found.angle)[0] + stub
    assert found.root_moment == pytest.approx(spring, abs=1e-12)  # Newton's rounding
    alone = root_moment(
        c, clamp, found.angle, carried_forces(c, np.array(force), np.zeros(2)), moment
    )
    arm = found.tip - clamp[:2]
    assert alone == pytest.approx(arm[0] * force[1] - arm[1] * force[0] + moment, abs=1e-14)


@EACH_SCHEME
@pytest.mark.parametrize("n", [2, 7, 40])
def test_an_end_moment_bends_a_chain_to_a_closed_polygon(scheme, n):
    """M = 2 pi EI/L bends a chain to a closed polygon with n corners of 2 pi/n.

    The middles of the edges ("half") or the corners ("double") lie on a circle that is tangent to
    the clamp; for "naive" it is not.
    """
    c = chain(n, scheme=scheme)
    found = free(c, moment=2.0 * np.pi)
    np.testing.assert_allclose(found.tip, 0.0, atol=1e-14)  # n roundings
    at = points(c, np.zeros(3), found.angle)
    if scheme == "half":
        radius = 0.5 / n / np.tan(np.pi / n)
        middles = np.vstack([at[:1], 0.5 * (at[1:-2] + at[2:-1])])
        distance = np.hypot(middles[:, 0], middles[:, 1] - radius)
    if scheme == "double":
        radius = 0.5 / n / np.sin(np.pi / n)
        distance = np.hypot(at[:, 0], at[:, 1] - radius)
    if scheme != "naive":  # its circle is not tangent to the clamp
        np.testing.assert_allclose(distance, radius, rtol=0, atol=1e-14)


def test_the_error_of_half_a_circle_is_of_second_order():
    """Under M = pi EI/L the tip of a rod is at (0, 2/pi) L, with an error of second order in h.

    The tip of the chain is a corner of a polygon, at (0, 1/(n tan(pi/2n))) L.
    """
    for n in (10, 40):
        tip = free(chain(n), moment=np.pi).tip
        np.testing.assert_allclose(
            tip, [0.0, 1.0 / (n * np.tan(0.5 * np.pi / n))], atol=1e-14, rtol=0
        )
    fine = extrapolated(*(free(chain(n), moment=np.pi).tip for n in (20, 40)))
    # -1/4 of the h^4 term of the cotangent remains: 2/pi (pi/2n)^4/45 / 4 = 1.35e-7 at n = 20
    np.testing.assert_allclose(fine, [0.0, 2.0 / np.pi], rtol=0, atol=1.4e-7)


def critical_factor(c, force, line):
    """Smallest factor of the loads at which the upright chain's Hessian is singular."""
    angle = np.full(c.segments, np.pi / 2)
    bare = hessian(c, angle, carried_forces(c, np.zeros(2), np.zeros(2)))
    pull = carried_forces(c, np.array(force), np.array(line))
    return 1.0 / eigh(bare - hessian(c, angle, pull), bare, eigvals_only=True)[-1]


@pytest.mark.parametrize("scheme", ["half", "double"])
def test_euler_load_of_a_chain(scheme):
    """P = 4 EI/h^2 sin(pi/4n)^2 for both schemes: modes of the difference equation are sines."""
    for n in (2, 5, 40):
        found = critical_factor(chain(n, scheme=scheme), (0.0, -1.0), (0.0, 0.0))
        assert found == pytest.approx(4.0 * n**2 * np.sin(0.25 * np.pi / n) ** 2, rel=1e-11)


def test_naive_clamp_lowers_the_euler_load_by_first_order():
    """The rod is half a cell too long: its load is pi^2/4 (L + h/2)^-2, up to terms of h^2."""
    for n in (20, 40, 80):
        found = critical_factor(chain(n, scheme="naive"), (0.0, -1.0), (0.0, 0.0))
        assert found == pytest.approx(np.pi**2 / 4 / (1.0 + 0.5 / n) ** 2, rel=1.0 / n**2)


@pytest.mark.parametrize("scheme", ["half", "double"])
def test_a_chain_buckles_at_greenhills_weight(scheme):
    """q L^3/EI = 7.837347438943, which is 9/4 of the square of the first zero of J_-1/3."""
    coarse, fine = (
        critical_factor(chain(n, scheme=scheme), (0.0, 0.0), (0.0, -1.0)) for n in (40, 80)
    )
    # 1/4 of the h^4 term at n = 40, q^2 h^4, remains: 6e-6
    zero = brentq(lambda x: jv(-1.0 / 3.0, x), 1.5, 2.5, xtol=1e-14)
    assert extrapolated(coarse, fine) == pytest.approx(9.0 / 4.0 * zero**2, abs=6e-6)


@pytest.mark.parametrize("scheme", ["half", "double"])
def test_clamped_pinned_buckling_by_the_projected_hessian(scheme):
    """The critical load is 20.190728556427 EI/L^2, by tan x = x.

    The projected Hessian is singular there; the tip of a straight rod can only move across it.
    """

    def lowest(load, c):
        angle = np.zeros(c.segments)
        stiff = hessian(c, angle, carried_forces(c, np.array([-load, 0.0]), np.zeros(2)))
        across = tip_slopes(c, angle)[1:]
        return curvatures(np.block([[stiff, across.T], [across, np.zeros((1, 1))]]), 1)[0]

    coarse, fine = (
        brentq(lowest, 15.0, 25.0, args=(chain(n, scheme=scheme),), xtol=1e-12) for n in (40, 80)
    )
    # 1/4 of the h^4 term of 4/h^2 sin(mu h/2)^2 at n = 40 remains, mu^6/360 with mu^2 = 20.19:
    # 2.2e-6; as much again for the ends
    root = brentq(lambda x: np.sin(x) - x * np.cos(x), 4.0, 4.7, xtol=1e-14)
    assert extrapolated(coarse, fine) == pytest.approx(root**2, abs=4.4e-6)


def test_negative_eigenvalues_follow_haynsworths_formula():
    """The saddle matrix has as many negative eigenvalues as its projection, plus the constraints.

    This is Haynsworth's inertia formula.
    """
    stiff = RNG.normal(size=(50, 9, 9))
    stiff = stiff + np.swapaxes(stiff, -1, -2) + 5.0 * RNG.normal(size=(50, 1, 1)) * np.eye(9)
    border = RNG.normal(size=(50, 1, 9, 3))
    matrix = Bordered(stiff[:, None], border, np.zeros((50, 3, 3))).dense()
    counts = count_negative(curvatures(matrix, 3))
    np.testing.assert_array_equal(count_negative(np.linalg.eigvalsh(matrix)), counts + 3)
    assert set(counts) >= {0, 1, 3, 5, 6}


def test_bordered_matrices_are_solved_as_dense_ones():
    block, corner = RNG.normal(size=(4, 3, 6, 6)), RNG.normal(size=(4, 5, 5))
    matrix = Bordered(block, RNG.normal(size=(4, 3, 6, 5)), corner)
    right = RNG.normal(size=(4, 23))
    found = np.linalg.solve(matrix.dense(), right[..., None])[..., 0]
    np.testing.assert_allclose(matrix.solve(right), found, rtol=0, atol=1e-10)  # conditioning


def test_newton_returns_nan_for_members_without_a_zero():
    """Members of a batch without a zero are NaN, and so is one that starts at a zero slope.

    x^2 + 1 has no zero, x^2 - 2 has one.
    """

    def parabola(x):
        slope = Bordered(2.0 * x[..., None, None], np.zeros((3, 1, 1, 0)), np.zeros((3, 0, 0)))
        return x**2 + np.array([[1.0], [-2.0], [-2.0]]), slope

    found = newton(parabola, np.array([[1.0], [1.0], [0.0]]), 1)
    np.testing.assert_allclose(found[:, 0], [np.nan, np.sqrt(2.0), np.nan], rtol=1e-15)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"segments": 1}, "segments must be a whole number from 2, got 1"),
        ({"segments": 2.5}, "segments must be"),
        ({"length": 0.0}, "length must be positive"),
        ({"stiffness": [1.0, -1.0]}, "stiffness must be positive"),
        ({"stiffness": np.nan}, "stiffness must be"),
        ({"rigid_extension": -0.1}, "rigid_extension must be"),
        ({"scheme": "mid"}, r"scheme must be one of \('half', 'double', 'naive'\), got 'mid'"),
    ],
)
def test_bad_values_are_named(change, message):
    with pytest.raises(ValueError, match=message):
        chain(**{"segments": 4} | change)
