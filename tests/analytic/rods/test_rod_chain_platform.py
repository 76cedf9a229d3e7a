"""Three chains on one platform: equations as derivatives, Table 8, guides and rigid ends."""

import numpy as np
import pytest

from proofmass.analytic.rods.assembly import assembly, triangle
from tests.analytic.rods.rod_chain_cases import CASES, extrapolated, tangent_angle
from tests.independent.rods.chain_assembly import assembly_equilibria, settle
from tests.independent.rods.chain_closure import arms, chains, clamps, fit_pose, system
from tests.independent.rods.stability import count_negative

PLATFORM_CASE = CASES["3RFR"]
EACH_EQUILIBRIUM = pytest.mark.parametrize(
    "row", PLATFORM_CASE["equilibria"], ids=lambda row: row["name"]
)
ROUNDING = 2e-12  # rounding errors of some hundred equations


def platform_of_table_8():
    """The mechanism of Table 8."""
    return assembly(
        PLATFORM_CASE["clamp"],
        stiffness=PLATFORM_CASE["stiffness"],
        arm=triangle(PLATFORM_CASE["side"]),
        angle=np.radians(PLATFORM_CASE["angle_deg"]),
    )


def settle_platform(row, segments, scheme="half", moment=0.0):
    """Equilibrium of its chains, seeded with the continuous rods of a row of the data."""
    angles = np.radians(PLATFORM_CASE["angle_deg"])
    seed = [
        tangent_angle(*rod, PLATFORM_CASE["stiffness"])
        for rod in zip(angles, row["force"], row["root_moment"], strict=True)
    ]
    return settle(
        platform_of_table_8(),
        np.zeros(3),
        seed=seed,
        segments=segments,
        scheme=scheme,
        force=PLATFORM_CASE["force"],
        moment=moment,
    )


def pose_in_degrees(pose):
    """The pose with its angle in degrees."""
    return pose * [1.0, 1.0, 180.0 / np.pi]


def test_residual_and_matrix_are_slopes_of_one_function():
    """Residual and matrix are central differences of the Lagrangian and of the residual.

    The Lagrangian is U - F.P - M phi - sum n_i . (tip_i - P - w_i).
    """
    a, rng, load = platform_of_table_8(), np.random.default_rng(3), np.array([0.2, 0.5, -0.1])
    c, place = chains(a, 4), clamps(a, np.zeros(3))
    z = rng.normal(size=3 * 4 + 3 + 6)

    def lagrangian(z):
        found, pairs = assembly_equilibria(a, c, place, load, z), z[15:].reshape(3, 2)
        violation = -system(a, c, place, load, z)[0][15:].reshape(3, 2)
        return found.potential - (pairs * violation).sum()

    residual, matrix = system(a, c, place, load, z)
    matrix = matrix.dense()
    np.testing.assert_array_equal(matrix, matrix.T)
    for j, step in enumerate(1e-5 * np.eye(z.size)):
        # h^2, and rounding over h of functions of about 10
        assert residual[j] == pytest.approx(
            (lagrangian(z + step) - lagrangian(z - step)) / 2e-5, abs=1e-8
        )
        change = system(a, c, place, load, z + step)[0] - system(a, c, place, load, z - step)[0]
        np.testing.assert_allclose(matrix[:, j], change / 2e-5, rtol=0, atol=1e-8)


@EACH_EQUILIBRIUM
def test_chains_have_the_equilibria_of_table_8(row):
    """Chains have the recorded equilibria of Table 8 with theta2 = 180 degrees.

    U1 and U2 have inflections and are unstable.
    """
    for n, printed in row.get("half", {}).items():
        digits = [5.1e-7, 5.1e-7, 5.1e-5]
        found = settle_platform(row, int(n))
        assert np.all(np.abs(pose_in_degrees(found.pose) - printed) < digits)
    one, two = settle_platform(row, 40), settle_platform(row, 80)
    assert count_negative(one.curvatures) == row["negative"]
    fine = pose_in_degrees(extrapolated(one.pose, two.pose))
    # error of order h^4, which is the largest for U2
    np.testing.assert_allclose(fine[:2], row["pose_deg"][:2], rtol=0, atol=4e-8)
    assert fine[2] == pytest.approx(row["pose_deg"][2], abs=3e-6)
    stored = extrapolated(one.energy, two.energy)
    assert stored == pytest.approx(row["energy"], abs=2e-7)


@pytest.mark.parametrize(
    ("row", "off"), [(PLATFORM_CASE["equilibria"][0], 1.95), (PLATFORM_CASE["equilibria"][1], 0.71)]
)
def test_naive_chains_turn_the_platform_by_a_known_error(row, off):
    """With the scheme "naive" the angle of the platform is off by 1.95 or 0.71 degrees."""
    wrong = pose_in_degrees(settle_platform(row, 20, "naive").pose)[2] - row["pose_deg"][2]
    assert abs(wrong) == pytest.approx(off, abs=5.1e-3)


def test_moment_on_a_platform():
    """dV = -phi dM, and the tips' forces balance both the load and the moment."""
    row, h = PLATFORM_CASE["equilibria"][1], 1e-5
    here = settle_platform(row, 10, moment=0.01)
    more, less = (settle_platform(row, 10, moment=0.01 + m).potential for m in (h, -h))
    assert (more - less) / (2 * h) == pytest.approx(-here.pose[2], abs=1e-8)  # h^2
    arm = triangle(PLATFORM_CASE["side"]) @ np.array([1.0, 1.0j]) * np.exp(1j * here.pose[2])
    force = here.force @ np.array([1.0, 1.0j])
    assert (arm.conj() * force).imag.sum() == pytest.approx(0.01, abs=ROUNDING)
    assert force.sum() == pytest.approx(0.5j, abs=ROUNDING)


def test_sliding_clamps_and_rigid_ends():
    """In the 3PFR's start pose recomputed slides hold the unloaded platform at 0, 0, 60 degrees."""
    case = CASES["3PFR"]
    angle = np.radians(case["angle_deg"])
    out = np.radians([-150.0, -30.0, 90.0])
    outward = np.stack([np.cos(out), np.sin(out)], axis=-1)
    a = assembly(
        outward,
        stiffness=case["stiffness"],
        arm=case["circumradius"] * outward,
        angle=angle,
        guide=angle,
        rigid_extension=case["rigid_extension"],
    )
    bend = 2.0 * np.radians(23.6)
    found = [
        settle(
            a,
            [case["slide"]] * 3,
            segments=n,
            seed=[lambda s, t=t: t + bend * (s - 0.5 * s * s) for t in angle],
        )
        for n in (20, 40)
    ]
    pose = pose_in_degrees(extrapolated(*(f.pose for f in found)))
    np.testing.assert_allclose(pose, case["pose_deg"], rtol=0, atol=1e-4)  # slide of seven digits
    moment = extrapolated(*(f.root_moment for f in found))
    np.testing.assert_allclose(moment, case["root_moment"], rtol=0, atol=1e-7)  # printed digits
    force = extrapolated(*(np.linalg.norm(f.force, axis=-1) for f in found))
    np.testing.assert_allclose(force, case["force"], rtol=0, atol=6e-7)


def test_pose_that_fits_the_tips():
    """The fitted pose is that whose pins are the tips, with pins that are not around the origin."""
    a = assembly(
        PLATFORM_CASE["clamp"], arm=[[0.1, 0.3], [0.5, -0.2], [0.4, 0.4]]
    )  # not around the origin
    for pose in ([0.2, -0.1, 2.5], [0.0, 0.4, -1.0]):
        tip = arms(a, np.array(pose))[0] + pose[:2]
        np.testing.assert_allclose(fit_pose(a, tip), pose, rtol=0, atol=1e-15)
