"""Two chains on one pin against continuous rods: equilibria, stiffness and ends of branches."""

import numpy as np
import pytest

from proofmass.analytic.rods.assembly import assembly
from tests.analytic.rods.rod_chain_cases import (
    PAIR_CASE,
    STABLE_ROWS,
    continuum,
    extrapolated,
    observed_orders,
    pair_of_table_7,
    tangents_of_pair,
)
from tests.independent.rods.chain import SCHEMES
from tests.independent.rods.chain_assembly import settle, starting_unknowns
from tests.independent.rods.chain_closure import chains, clamps
from tests.independent.rods.chain_newton import follow_in_steps
from tests.independent.rods.stability import count_negative

EACH_STABLE = pytest.mark.parametrize("name", STABLE_ROWS)
ROUNDING = 2e-12  # rounding errors of some hundred equations


def settle_pair(name, segments, scheme="half", **change):
    """Equilibrium of two chains of Table 7, seeded with continuous rods of a stable equilibrium."""
    call = {"seed": tangents_of_pair(STABLE_ROWS[name]), "force": PAIR_CASE["force"]} | change
    return settle(pair_of_table_7(), [0.0, 0.0], segments=segments, scheme=scheme, **call)


@EACH_STABLE
def test_chains_have_the_four_stable_equilibria_of_two_rods(name):
    """Chains have the recorded poses and energies of four stable equilibria.

    Table 7 prints S1 and S2; S3 is missing there, and S4 has an inflection.
    """
    row = STABLE_ROWS[name]
    for n, printed in row["half"].items():
        found = settle_pair(name, int(n))
        np.testing.assert_allclose(found.pose, printed, rtol=0, atol=5.1e-8)  # digits of the data
        assert found.energy == pytest.approx(row["half_energy"][n], abs=5.1e-8)
        assert count_negative(found.curvatures) == 0
        np.testing.assert_allclose(
            found.force.sum(axis=0), PAIR_CASE["force"], rtol=0, atol=ROUNDING
        )


@EACH_STABLE
@pytest.mark.parametrize("scheme", SCHEMES)
def test_errors_and_orders_of_every_scheme(name, scheme):
    """The error of the pose is that of the data, and of first ("naive") or second order in h."""
    row = STABLE_ROWS[name]
    found = {
        n: np.linalg.norm(settle_pair(name, n, scheme).pose - row["pose"]) for n in (10, 20, 40, 80)
    }
    for n, printed in row["error"].get(scheme, {}).items():
        assert found[int(n)] == pytest.approx(printed, rel=6e-4)  # four digits
    wanted = 1 if scheme == "naive" else 2
    # next term of the series: 2 % of h^2; more in the case of h, whose coefficient may be small
    close = 0.04 if wanted == 2 else 0.2
    assert observed_orders(np.array([found[40], found[80]]))[0] == pytest.approx(wanted, abs=close)


@EACH_STABLE
def test_chains_extrapolate_to_the_continuous_rods(name):
    """Richardson's extrapolation of chains gives the continuous rods, with an error of order h^4.

    Pose, clamp moments and energy are within 1e-6, tip forces within 1.5e-6 N.
    """
    row = STABLE_ROWS[name]
    twenty, forty, eighty = (settle_pair(name, n) for n in (20, 40, 80))
    for field, exact in (
        ("pose", row["pose"]),
        ("root_moment", row["root_moment"]),
        ("energy", row["energy"]),
    ):
        coarse, middle, fine = (getattr(found, field) for found in (twenty, forty, eighty))
        last = extrapolated(middle, fine) - exact
        assert np.abs(last).max() < 1e-6
        first = extrapolated(coarse, middle) - exact
        # the h^6 term, and differences of moments that nearly cancel
        np.testing.assert_allclose(observed_orders(np.array([first, last])), 4.0, rtol=0, atol=0.4)
    force = extrapolated(forty.force[0], eighty.force[0])
    np.testing.assert_allclose(force, row["force1"], rtol=0, atol=1.5e-6)  # stiffness times pose
    work = np.dot(PAIR_CASE["force"], eighty.pose)
    assert eighty.potential == pytest.approx(eighty.energy - work, abs=1e-15)


@EACH_STABLE
def test_the_error_of_the_energy_is_of_second_order(name):
    """The error of the energy is of second order; U = int m^2/(2 EI) ds by Simpson's rule."""
    s = np.linspace(0.0, 1.0, 2001)
    first = np.array(STABLE_ROWS[name]["force1"])
    forces = first, np.array(PAIR_CASE["force"]) - first
    weight = np.r_[1.0, np.tile([4.0, 2.0], 1000)[:-1], 1.0] / 6000.0
    stored = sum(
        weight @ (0.5 * PAIR_CASE["stiffness"] * continuum(*rod, PAIR_CASE["stiffness"])(s)[1] ** 2)
        for rod in zip(
            np.radians(PAIR_CASE["angle_deg"]),
            forces,
            STABLE_ROWS[name]["root_moment"],
            strict=True,
        )
    )
    errors = np.array([settle_pair(name, n).energy for n in (20, 40, 80)]) - stored
    np.testing.assert_allclose(observed_orders(errors), 2.0, rtol=0, atol=0.03)  # the h^4 term


@EACH_STABLE
def test_stiffness_of_the_pose(name):
    """dF/dP is symmetric, agrees with differences of loads, and extrapolates to the data."""
    here, h = settle_pair(name, 40), 1e-6
    np.testing.assert_allclose(here.stiffness, here.stiffness.T, rtol=1e-9)
    for axis in (0, 1):
        push = np.array(PAIR_CASE["force"]) + h * np.array([[1], [-1]]) * np.eye(2)[axis]
        more, less = settle_pair(name, 40, seed=here.angle, force=push).pose
        # h^2, and rounding of poses over h
        np.testing.assert_allclose(
            here.stiffness @ (more - less) / (2 * h), np.eye(2)[axis], rtol=0, atol=1e-6
        )
    exact = np.array(PAIR_CASE["stiffness_of_pose"][name])
    fine = extrapolated(here.stiffness, settle_pair(name, 80).stiffness)
    np.testing.assert_allclose(fine, exact, rtol=0, atol=1e-5 * np.abs(exact).max())  # h^4


def test_all_equilibria_with_up_to_three_inflections():
    """A batch of 33 equilibria has the poses and the numbers of negative directions of the data.

    Four of them have no negative direction: they are stable.
    """
    rows = PAIR_CASE["modes to 3"]
    c = chains(pair_of_table_7(), 40)
    seed = np.array(
        [[f(s) for f, s in zip(tangents_of_pair(row), c.station, strict=True)] for row in rows]
    )
    found = settle(pair_of_table_7(), [0.0, 0.0], seed=seed, segments=40, force=PAIR_CASE["force"])
    distance = np.linalg.norm(found.pose - [row["pose"] for row in rows], axis=-1)
    assert np.all(distance < 2e-3)  # (h/L)^2 times the square of three half waves
    counts = count_negative(found.curvatures)
    np.testing.assert_array_equal(counts, [row["negative"] for row in rows])
    assert (counts == 0).sum() == 4


def test_mirrored_rods_have_the_mirrored_pose():
    """Rods and load mirrored in the y axis have the mirrored pose."""
    a = assembly(
        [[-0.3, 0.0], [0.3, 0.0]],
        stiffness=PAIR_CASE["stiffness"],
        angle=np.radians([120.0, 140.0]),
    )
    plain = settle_pair("S4", 20)
    found = settle(
        a,
        [0.0, 0.0],
        seed=np.pi - plain.angle[::-1] + 0.02,
        segments=20,
        force=np.array(PAIR_CASE["force"]) * [-1, 1],
    )
    np.testing.assert_allclose(found.pose, plain.pose * [-1, 1], rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(found.root_moment, -plain.root_moment[::-1], rtol=0, atol=ROUNDING)


def test_motor_moments_are_slopes_of_the_potential():
    """dV = -m0 dtheta at a constant load: the work of a motor changes the potential."""
    here, h = settle_pair("S3", 20), 1e-6
    for motor in (0, 1):
        turns = h * np.array([[1], [-1]]) * np.eye(2)[motor]
        more, less = settle(
            pair_of_table_7(), turns, seed=here.angle, force=PAIR_CASE["force"]
        ).potential
        # rounding over h
        assert (more - less) / (2 * h) == pytest.approx(-here.root_moment[motor], abs=1e-8)


def test_start_takes_pose_and_forces_from_a_shape():
    """The start that follows from an equilibrium's angles has its pose and its tip forces."""
    a, here = pair_of_table_7(), settle_pair("S2", 20)
    c, load = chains(a, 20), np.array(PAIR_CASE["force"])
    z = starting_unknowns(a, c, clamps(a, np.zeros(2)), load, here.angle)
    np.testing.assert_allclose(z[40:42], here.pose, rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(z[42:].reshape(2, 2), here.force, rtol=0, atol=1e-10)  # conditioning


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"moment": 0.1}, "moment must be 0 on a pin, got 0.1"),
        ({"moment": np.nan}, "moment must be finite"),
        ({"force": [1.0]}, "force must be 2 finite"),
        ({"seed": np.full((2, 10), np.nan)}, "seed must be finite"),
        ({"seed": np.zeros((2, 5))}, r"seed must be angles \(\.\.\., 2, 10\), got \(2, 5\)"),
    ],
)
def test_bad_values_are_named(change, message):
    with pytest.raises(ValueError, match=message):
        settle_pair("S1", 10, **change)
    with pytest.raises(ValueError, match="inputs must be 2 finite numbers"):
        settle(pair_of_table_7(), [0.0], seed=np.zeros((2, 20)))
    with pytest.raises(ValueError, match="segments must be a whole number from 2"):
        settle_pair("S1", 1)


def follow_path(start, n, load, turns):
    """Angles of the two rods at the end of a path with load(share) and turns(share), or NaN.

    The share rises from 0, at the angles `start`, to 1.
    """

    def solve(part, seed):
        return settle(
            pair_of_table_7(), turns(part), seed=seed.reshape(2, n), force=load(part), segments=n
        ).angle.ravel()

    return follow_in_steps(solve, start.ravel(), 2 * n).reshape(2, n)


def test_a_motor_moment_changes_its_sign_during_unloading():
    """As the load of S2 is removed, m0 of rod 1 changes its sign, from -0.01625 to 0.00543 N m."""
    ends = []
    for n in (20, 40):
        start = settle_pair("S2", n)
        unloaded_angles = follow_path(
            start.angle,
            n,
            lambda part: (1.0 - part) * np.array(PAIR_CASE["force"]),
            lambda part: np.zeros(2),
        )
        ends.append(settle_pair("S2", n, seed=unloaded_angles, force=(0.0, 0.0)))
        assert start.root_moment[0] < 0 < ends[-1].root_moment[0]
    pose = extrapolated(ends[0].pose, ends[1].pose)
    np.testing.assert_allclose(pose, PAIR_CASE["S2 unloaded"]["pose"], rtol=0, atol=1e-5)  # h^4
    moment = extrapolated(ends[0].root_moment[0], ends[1].root_moment[0])
    assert moment == pytest.approx(PAIR_CASE["S2 unloaded"]["root_moment1"], abs=1e-5)


def test_a_path_does_not_jump_beyond_a_fold():
    """Motor 1 is turned to a fold at -0.36518 rad; beyond it the path is NaN, on no other branch.

    At the start S2 is unloaded, with motor angles at which its pin is where it was under load.
    """
    case, n = PAIR_CASE["fold"], 40
    begin = np.radians(case["begin_deg"]) - np.radians(PAIR_CASE["angle_deg"])
    start = follow_path(
        settle_pair("S2", n).angle,
        n,
        lambda part: (1.0 - part) * np.array(PAIR_CASE["force"]),
        lambda part: part * begin,
    )

    def turned(turn):
        return follow_path(
            start, n, lambda part: (0.0, 0.0), lambda part: begin + part * np.array([turn, 0.0])
        )

    # the fold of these chains differs by a term of order h^2, at most 1e-3 rad
    assert np.isfinite(turned(case["turn"] + 1e-3)).all()
    assert np.isnan(turned(case["turn"] - 1e-3)).all()
