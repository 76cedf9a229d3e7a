"""One chain at rest: cantilevers and pinned rods against continuous rods, errors and orders."""

import numpy as np
import pytest
from scipy.integrate import solve_bvp

from tests.analytic.rods.rod_chain_cases import (
    CASES,
    continuum,
    extrapolated,
    observed_orders,
    tangent_angle,
)
from tests.independent.rods.chain import SCHEMES, chain
from tests.independent.rods.chain_rod import free, pinned
from tests.independent.rods.stability import count_negative

ROWS = CASES["cantilever"]["rows"]
ALPHA = np.array([row["alpha"] for row in ROWS])
EXACT_TIPS = np.array([[1.0 - row["u_over_L"], row["w_over_L"]] for row in ROWS])
FORCES = np.stack([np.zeros(4), ALPHA], axis=-1)
PINNED_CASE = CASES["pinned"]
ORDER = {"half": 2, "double": 2, "naive": 1}
EACH_SCHEME = pytest.mark.parametrize("scheme", SCHEMES)


def cantilever_tips(scheme, *segments):
    """Tips of cantilevers under four forces across them, for each number of segments."""
    return [free(chain(n, scheme=scheme), force=FORCES).tip for n in segments]


@EACH_SCHEME
def test_cantilever_errors_and_orders(scheme):
    """Errors of the tip are those of the data, and of first ("naive") or second order in h."""
    errors = np.array(
        [
            np.linalg.norm(tip - EXACT_TIPS, axis=-1)
            for tip in cantilever_tips(scheme, 10, 20, 40, 80)
        ]
    )
    printed = CASES["cantilever_chain"]["tip error of 40 segments, alpha 1 2 5 10"][scheme]
    np.testing.assert_allclose(errors[2], printed, rtol=0.05)  # two digits
    # next term of the series for alpha = 10: h^2 after h, or h^4 after h^2
    close = {"half": 0.02, "double": 0.02, "naive": 0.04}[scheme]
    np.testing.assert_allclose(observed_orders(errors), ORDER[scheme], rtol=0, atol=close)


@pytest.mark.parametrize(
    ("scheme", "alpha", "digit"),
    [
        ("naive", 1, [5e-4, 5e-3, 5e-3, 5e-3, 5e-4]),  # half of the last digit that is given
        ("double", 1, [5e-6, 5e-7, 5e-7, 5e-8, 5e-8]),
        ("double", 10, [5e-5, 5e-6, 5e-6, 5e-6, 5e-7]),
    ],
)
def test_deflection_errors_are_those_of_an_independent_computation(scheme, alpha, digit):
    """Errors of the deflection are those of an independent computation, to its digits."""
    table = CASES["cantilever_chain"]
    exact = ROWS[int(np.argmin(np.abs(ALPHA - alpha)))]["w_over_L"]
    found = [
        free(chain(n, scheme=scheme), force=(0.0, alpha)).tip[1] - exact for n in table["segments"]
    ]
    short = np.abs(np.array(found) - table[f"{scheme} alpha {alpha}"])
    assert np.all(short <= 1.02 * np.array(digit))  # its last digit may be cut instead of rounded


@pytest.mark.parametrize("scheme", ["half", "double"])
def test_cantilever_extrapolated_to_the_continuum(scheme):
    """Chains of 20 and 40 segments extrapolate to the tip within 1e-6 L and to the clamp moment."""
    c = [chain(n, scheme=scheme) for n in (20, 40)]
    found = [free(one, force=FORCES) for one in c]
    np.testing.assert_allclose(extrapolated(*(f.tip for f in found)), EXACT_TIPS, rtol=0, atol=1e-6)
    moment = [row["root_moment_ML_over_EI"] for row in ROWS]
    # alpha times the error of the tip
    np.testing.assert_allclose(extrapolated(*(f.root_moment for f in found)), moment, atol=1e-5)


def test_last_segment_of_half_has_the_tip_angle():
    angle = [free(chain(n), force=FORCES).angle[:, -1] for n in (20, 40)]
    exact = [row["theta_tip_rad"] for row in ROWS]
    np.testing.assert_allclose(extrapolated(*angle), exact, rtol=0, atol=2e-6)  # h^4 of alpha = 10


def test_a_seed_and_load_steps_lead_to_the_same_equilibrium():
    """A load in steps and a seed of the continuous rod lead to the same stable equilibrium."""
    c = chain(20)
    slow = free(c, force=(0.0, 10.0))
    bend = continuum(0.0, (0.0, 10.0), ROWS[-1]["root_moment_ML_over_EI"], 1.0)
    quick = free(c, force=(0.0, 10.0), seed=lambda s: bend(s)[0])
    np.testing.assert_allclose(slow.angle, quick.angle, rtol=0, atol=1e-13)  # rounding
    assert count_negative(slow.curvatures) == 0


def test_a_strut_stays_straight_and_unstable():
    """A straight chain under a load along it stays straight.

    It has one negative direction above pi^2/4 EI/L^2 and two above 9 pi^2/4 EI/L^2.
    """
    found = free(chain(40), force=[[-2.0, 0.0], [-3.0, 0.0], [-23.0, 0.0]])
    np.testing.assert_array_equal(found.angle, 0.0)
    np.testing.assert_array_equal(count_negative(found.curvatures), [0, 1, 2])


def test_distributed_load_against_collocation():
    """Chains under a dead load along the rod extrapolate to a boundary-value solution of

    EI theta'' = n_x sin(theta) - n_y cos(theta), n = q (L - s).
    """
    load = np.array([-1.0, -6.0])

    def slope(s, y):
        n = load[:, None] * (1.0 - s)
        return np.stack([y[1], n[0] * np.sin(y[0]) - n[1] * np.cos(y[0])])

    s = np.linspace(0.0, 1.0, 200)
    exact = solve_bvp(slope, lambda a, b: np.array([a[0], b[1]]), s, np.zeros((2, 200)), tol=1e-9)
    found = [free(chain(n), line=load) for n in (20, 40)]
    angle = extrapolated(*(f.angle[-1] for f in found))
    assert angle == pytest.approx(exact.sol(1.0)[0], abs=3e-6)  # h^4 of q
    root = extrapolated(*(f.root_moment for f in found))
    assert root == pytest.approx(exact.sol(0.0)[1], abs=3e-6)


@EACH_SCHEME
def test_turned_and_mirrored_chains_have_turned_and_mirrored_tips(scheme):
    """A chain with rotated clamp and loads is rotated; with mirrored loads it is mirrored."""
    c, turn = chain(12, scheme=scheme), 2.1
    spin = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    load = np.array([0.4, 1.7])
    plain = free(c, force=load, moment=0.3, line=(0.2, 0.1))
    spun = free(
        c, (0.3, -0.2, turn), force=load @ spin, moment=0.3, line=np.array([0.2, 0.1]) @ spin
    )
    np.testing.assert_allclose(spun.tip, [0.3, -0.2] + plain.tip @ spin, rtol=0, atol=1e-13)
    mirror = free(c, force=load * [1, -1], moment=-0.3, line=(0.2, -0.1))
    np.testing.assert_allclose(mirror.tip, plain.tip * [1, -1], rtol=0, atol=1e-14)


def pinned_tangent_angle(row):
    """theta(s) of the continuous rod in an equilibrium of the data."""
    return tangent_angle(0.0, row["force"], row["root_moment"], PINNED_CASE["stiffness"])


def settle_pinned(n, row, scheme="half", tip=PINNED_CASE["tip"], turn=0.0):
    """Equilibrium of a chain with a pinned tip, seeded with that rod."""
    c = chain(n, stiffness=PINNED_CASE["stiffness"], scheme=scheme)
    return pinned(c, (0.0, 0.0, turn), tip, seed=pinned_tangent_angle(row))


@EACH_SCHEME
def test_pinned_chain_of_every_scheme(scheme):
    """Tip force and energy of solution A are those of the data; orders by 20, 40, 80 segments."""
    row = PINNED_CASE["equilibria"][0]
    for n, printed in PINNED_CASE["chain A"][scheme].items():
        found = settle_pinned(int(n), row, scheme)
        np.testing.assert_allclose([*found.force, found.energy], printed, rtol=0, atol=5.1e-6)
    exact = [*row["force"], row["energy"]]
    found = [settle_pinned(n, row, scheme) for n in (20, 40, 80)]
    errors = np.array([[*f.force, f.energy] for f in found]) - exact
    # digits of the continuous rod, 5e-8, over errors of 1e-4; "naive": the h^2 term over h
    close = {"half": 0.03, "double": 0.03, "naive": 0.15}[scheme]
    np.testing.assert_allclose(observed_orders(errors), ORDER[scheme], rtol=0, atol=close)


@pytest.mark.parametrize("row", PINNED_CASE["equilibria"], ids=lambda row: row["name"])
def test_four_shapes_of_a_pinned_rod(row):
    """Continuous rods and chains have the four equilibria of the data.

    With a pinned tip they have 0, 0, 1 and 3 negative directions.
    """
    exact = continuum(0.0, row["force"], row["root_moment"], PINNED_CASE["stiffness"])(1.0)
    # seven digits of force and moment, whose errors grow along the rod's five half waves
    np.testing.assert_allclose(exact[2:], PINNED_CASE["tip"], rtol=0, atol=2e-6)
    found = {n: settle_pinned(n, row) for n in (10, 20, 40, 80)}
    assert {int(count_negative(f.curvatures)) for f in found.values()} == {row["negative"]}
    fine = extrapolated(
        np.append(found[40].force, found[40].root_moment),
        np.append(found[80].force, found[80].root_moment),
    )
    # h^4 of five half waves: the error with 40 segments, 1 %, squared
    np.testing.assert_allclose(fine, [*row["force"], row["root_moment"]], rtol=3e-4)


@EACH_SCHEME
def test_force_and_moment_are_slopes_of_the_energy(scheme):
    """dU = F . dp - m0 dtheta0 along equilibria, by central differences."""
    row, h = PINNED_CASE["equilibria"][1], 1e-5
    here = settle_pinned(16, row, scheme)
    for axis in (0, 1):
        tip = np.array([PINNED_CASE["tip"]] * 2) + h * np.array([[1], [-1]]) * np.eye(2)[axis]
        more, less = settle_pinned(16, row, scheme, tip).energy
        # h^2 times a third derivative of about 1e3, and rounding over h
        assert (more - less) / (2 * h) == pytest.approx(here.force[axis], abs=1e-6)
    more, less = (settle_pinned(16, row, scheme, turn=turn).energy for turn in (h, -h))
    assert (more - less) / (2 * h) == pytest.approx(-here.root_moment, abs=1e-6)


def test_pinned_under_a_tip_moment_and_a_line_load():
    """A chain that is pinned where a free chain has its tip carries the tip force of the latter."""
    c, loads = chain(15), {"moment": 0.4, "line": (0.3, -1.0)}
    one = free(c, force=(-0.5, 1.5), **loads)
    two = pinned(c, (0.0, 0.0, 0.0), one.tip, seed=one.angle + 0.01, **loads)
    np.testing.assert_allclose(two.force, [-0.5, 1.5], rtol=0, atol=1e-11)  # Newton's rounding
    assert two.root_moment == pytest.approx(one.root_moment, abs=1e-12)


def test_newton_fails_from_a_straight_seed_of_a_pinned_chain():
    """Newton's method fails from a straight chain, whose tip cannot move along it."""
    assert np.isnan(pinned(chain(6), (0, 0, 0), (0.8, 0.0), seed=np.zeros(6)).energy)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda c: pinned(c, (0, 0, 0), (0.8, 0.7), seed=c.station),
            "tip must be nearer to the clamp",
        ),
        (lambda c: pinned(c, (0, 0, 0), (0.8,), seed=c.station), "tip must be 2 finite numbers"),
        (lambda c: free(c, (0, 0)), "clamp must be 3 finite numbers"),
        (lambda c: free(c, force=(np.inf, 0)), "force must be 2 finite numbers"),
        (lambda c: free(c, line=(0, 0, 0)), "line must be 2 finite numbers"),
        (lambda c: free(c, seed=np.ones(3)), "seed must be angles"),
        (lambda c: free(c, moment=np.nan), "moment must be finite"),
    ],
)
def test_bad_values_are_named(call, message):
    with pytest.raises(ValueError, match=message):
        call(chain(4))
