"""All equilibria of 2RFR, 3RFR and 3PFR: known ones, shooting, and counts by other searches."""

from dataclasses import fields

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from proofmass.analytic.rods import all_equilibria
from proofmass.analytic.rods.all_equilibria import Solutions, solutions, solve_starts
from proofmass.analytic.rods.assembly import assembly, triangle
from proofmass.analytic.rods.elastica import rods_of_chart
from proofmass.analytic.rods.equilibrium import clamps_and_forces, closure, state
from tests.analytic.rods.rod_solutions_cases import (
    CORNERS,
    DATA,
    EI,
    alphas,
    find_solutions,
    make_problem,
)
from tests.independent.rods.chain_assembly import settle
from tests.independent.rods.stability import count_negative

NEW_POSE = [0.663584, -0.190273]  # the 34th equilibrium of the 2RFR; modes (1, 3)


@pytest.fixture
def random():
    return np.random.default_rng(4)


def with_small_loads(f):
    """Equilibria with loads up to alpha = 20; integration from a clamp has errors of e^alpha."""
    kept = alphas(f).max(axis=1) <= 20.0
    parts = {name: getattr(f, name) for name in ("up_to", "load_bound")}
    return Solutions(*(getattr(f, one.name)[kept] for one in fields(f)[:-2]), **parts)


def index_of(f, row):
    """Index of the solution that is a recomputed one."""
    distance = np.abs(f.psi - row["psi"]).max(axis=1) + np.abs(f.k_rel - row["k_rel"]).max(axis=1)
    distance[(f.modes != row["modes"]).any(axis=1)] = np.inf
    assert distance.min() < 1e-8  # digits of the data
    return int(distance.argmin())


@pytest.mark.parametrize(
    ("name", "modes"),
    [
        ("rfr2", 3),
        pytest.param("rfr3", 2, marks=pytest.mark.slow),
        ("pfr3", 1),
        ("pfr3_unloaded", 1),
    ],
)
def test_every_known_equilibrium_is_found_with_its_energy_and_stability(name, modes):
    """Recomputed equilibria are found, with their poses, potentials and negative directions."""
    f, known = (
        find_solutions(name, modes),
        [r for r in DATA[name]["recomputed"] if not r.get("mirrored")],
    )
    which = [index_of(f, row) for row in known]
    assert len(set(which)) == len(known)
    for i, row in zip(which, known, strict=True):
        np.testing.assert_allclose(f.state.pose[i, :2], row["pose"], rtol=0, atol=1e-7)
        # recomputed with k to 1e-16, which is 1e-9 of the energy of the most bent rods
        assert f.potential[i] == pytest.approx(row["potential"], rel=1e-7)
        assert f.negative[i] == row["negative"]
        if "phi_deg" in row:
            turn = np.degrees(f.state.pose[i, 2]) - row["phi_deg"]
            assert abs((turn + 180.0) % 360.0 - 180.0) < 1e-5


def test_two_rods_have_three_equilibria_of_mode_one_and_four_that_are_stable():
    """Two rods have 34 equilibria of modes up to 3; three have mode 1, and four are stable.

    Table 7 prints two of them, and 33 were known.
    """
    f = find_solutions("rfr2", 3)
    assert len(f) == 34
    assert np.sum((f.modes == 1).all(axis=1)) == len(find_solutions("rfr2", 1)) == 3
    stable = f.negative == 0
    assert sorted(map(tuple, f.modes[stable])) == [(1, 1), (1, 1), (1, 1), (1, 2)]
    assert f.modes[0].tolist() == [1, 2]  # the lowest one has not mode 1


@pytest.mark.parametrize(("name", "digits"), [("rfr2", 1.5e-6), ("rfr3", 1e-4)])
def test_printed_solutions_are_found(name, digits):
    """Solutions of Tables 7 and 8 of Pérez Gámiz 2018 are found, to three units of their digits."""
    f = find_solutions(name, 1)
    for row in DATA[name]["printed"]:
        off = np.maximum(np.abs(f.psi - row["psi"]), np.abs(f.k_rel - row["k_rel"])).max(axis=1)
        assert off.min() < 3.0 * digits
    assert len(f) > len(DATA[name]["printed"])  # both tables are incomplete


def test_platform_of_table_8_has_three_more_that_are_stable():
    """Of nine stable equilibria five are below alpha = 20; Table 8 prints two of them.

    The other ones have rods in loops, with |k_rel| within 1e-5 of 1; those below alpha = 20 are
    under 7 to 9 N.
    """
    f = find_solutions("rfr3", 1)
    assert np.all(f.negative == 0)
    largest = alphas(f).max(axis=1)
    assert (largest < 20.0).sum() == 5  # for four others see test_rod_solutions_bound.py
    assert np.all(np.abs(f.k_rel[2:]) > 1.0 - 1e-5)
    assert np.all(largest[2:] > 12.0)


@pytest.mark.slow
def test_mirrored_platforms_are_other_platforms():
    """Of six roots that close distances three are equilibria of the mirrored platform."""
    a, arguments = make_problem("pfr3")
    mirror = assembly(
        CORNERS, stiffness=EI, arm=triangle(0.5) * [1, -1], guide=np.angle(a.guide), angle=a.angle
    )
    others = solutions(mirror, **arguments)
    spurious = [row for row in DATA["pfr3"]["recomputed"] if row["mirrored"]]
    assert len(find_solutions("pfr3", 1)) == len(others) == len(spurious) == 3
    assert len({index_of(others, row) for row in spurious}) == 3


def test_unloaded_symmetric_platform_keeps_its_symmetry():
    """Equilibria of the unloaded platform are at the centre or in threes, 120 degrees apart.

    Two poses at the centre are known.
    """
    f = find_solutions("pfr3_unloaded", 1)
    place = f.state.pose[:, 0] + 1j * f.state.pose[:, 1]
    centred = np.abs(place) < 1e-9
    turns = np.degrees(f.state.pose[centred, 2])
    assert all(np.abs(turns - phi).min() < 5e-4 for phi in (80.610, -68.796))
    for turn in np.exp(2j * np.pi / 3 * np.arange(3)):
        gaps = np.abs(place[:, None] * turn - place)
        assert gaps.min(axis=1).max() < 1e-9  # last step squared, times the condition
    assert (~centred).sum() % 3 == 0


def test_symmetric_pair_has_mirrored_equilibria():
    """Equilibria of a symmetric pair are mirror images of each other; three of them are known."""
    a = assembly([[-0.3, 0.0], [0.3, 0.0]], stiffness=EI)
    f = solutions(a, inputs=np.radians([60.0, 120.0]), modes=2, poses=1000)
    pose = f.state.pose
    gaps = np.abs(pose[:, None] - pose * [-1.0, 1.0]).max(axis=-1)
    assert gaps.min(axis=1).max() < 1e-9
    middle = pose[(np.abs(pose[:, 0]) < 1e-9) & (f.negative == 0), 1]
    for y in (0.948938, -0.501050, -0.184499):  # recomputed, six digits
        assert np.abs(middle - y).min() < 1e-6


@pytest.mark.parametrize(("name", "modes"), [("rfr2", 3), ("rfr3", 1), ("pfr3", 1)])
def test_equilibria_satisfy_the_shooting_equations(name, modes):
    """Equilibria satisfy the equations of another formulation, which integrates from the clamp.

    There an error at the clamp grows by up to e^alpha.
    """
    f = with_small_loads(find_solutions(name, modes))
    growth = 1e-12 * np.exp(alphas(f).max(axis=1))
    assert np.all(np.abs(closure(f.state)[0]).max(axis=1) < 1e-12 + growth)


def test_equilibria_are_confirmed_by_a_general_integrator():
    """Rods by DOP853 from their clamps end at the pin, without a moment."""
    f = find_solutions("rfr2", 3)
    for s, alpha in zip((f.state[i] for i in range(len(f))), alphas(f), strict=True):
        theta, clamp, n = clamps_and_forces(s)
        for i in range(2):
            x, y, _, m = integrate_rod(theta[i], s.moment[i], n[i])
            off = np.hypot(clamp[i].real + x - s.pose[0], clamp[i].imag + y - s.pose[1])
            assert off < 1e-10 + 1e-12 * np.exp(alpha[i])  # rtol with growth as above
            assert abs(m) < 1e-10 + 1e-12 * np.exp(alpha[i])


def integrate_rod(theta, moment, n):
    """x, y [m], angle [rad] and moment [N m] at the end of a rod, from its clamp."""

    def slope(_, z):
        c, s = np.cos(z[2]), np.sin(z[2])
        return [c, s, z[3] / EI, n.real * s - n.imag * c]

    return solve_ivp(
        slope, (0.0, 1.0), [0.0, 0.0, theta, moment], method="DOP853", rtol=1e-12, atol=1e-13
    ).y[:, -1]


@pytest.mark.parametrize(("name", "modes", "segments"), [("rfr2", 3, 40), ("rfr3", 1, 40)])
def test_chains_have_the_same_equilibria_and_stability(name, modes, segments):
    """Chains have equilibria at the same poses, with as many negative directions."""
    f, (a, arguments) = with_small_loads(find_solutions(name, modes)), make_problem(name)
    load = np.append(arguments["load"], 0.0)
    middle = (np.arange(segments) + 0.5) / segments
    chains = settle(
        a,
        arguments["inputs"],
        seed=f.state.shape(middle)[2],
        segments=segments,
        force=load[:2],
        moment=load[2],
        scheme="double",
    )
    # error of second order, (alpha/40)^2: 0.2 for the shortest waves
    near = np.abs(chains.pose - f.state.pose).max(axis=1)
    assert np.all(near < 0.02)
    assert count_negative(chains.curvatures).tolist() == f.negative.tolist()


def test_the_34th_equilibrium_of_two_rods():
    """One equilibrium of two rods is not among those of the data; it has the modes 1 and 3."""
    f = find_solutions("rfr2", 3)
    new = np.abs(f.state.pose - NEW_POSE).max(axis=1).argmin()
    np.testing.assert_allclose(f.state.pose[new], NEW_POSE, rtol=0, atol=1e-6)
    known = [index_of(f, row) for row in DATA["rfr2"]["recomputed"]]
    assert set(range(34)) - set(known) == {int(new)}
    assert f.modes[new].tolist() == [1, 3]
    assert f.negative[new] == 2


@pytest.mark.parametrize(
    ("name", "modes"),
    [
        ("rfr2", 3),
        *(
            pytest.param(name, modes, marks=pytest.mark.slow)
            for name, modes in [("rfr3", 1), ("pfr3", 1), ("rfr3", 2), ("pfr3", 2)]
        ),
    ],
)
def test_random_starts_find_no_other(name, modes, random):
    """The search has all equilibria to which 20,000 random starts lead.

    These starts use no lattice and no mesh.
    """
    a, arguments = make_problem(name)
    s, shape = state(a, **arguments), (a.rods, 20_000)
    alpha = random.uniform(0.1, 20.0, shape)
    chart = np.stack([alpha, random.uniform(-1.0, 1.0, shape) * (alpha + 3.0)], axis=1)
    pose = random.uniform(-1.0, 1.0, (3, shape[1])) * [[1.0], [1.0], [np.pi]]
    arrived, _ = solve_starts(s, chart, pose)
    inside = (rods_of_chart(*np.moveaxis(arrived, 1, 0)).waves < modes) & (arrived[:, 0] <= 20.0)
    force = rods_of_chart(*np.moveaxis(arrived[..., inside.all(axis=0)], 1, 0)).force
    own = find_solutions(name, modes)
    theta, _, n = clamps_and_forces(own.state[alphas(own).max(axis=1) <= 20.0])
    mine = n * np.exp(-1j * theta) / EI  # for rods of 1 m, in frames of the clamps
    gaps = np.array([np.abs(mine - one).max(axis=1) for one in force.T])
    assert gaps.min(axis=1).max() < 1e-5  # loads up to 400, sensitivity e^alpha
    seen = np.unique(gaps.argmin(axis=1))
    assert len(seen) > 0.8 * len(mine)  # random starts may miss some


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "modes", "count"),
    [("rfr2", 3, 34), ("rfr3", 1, 9), ("rfr3", 2, 67), ("pfr3", 1, 3), ("pfr3", 2, 57)],
)
def test_counts_do_not_depend_on_lattice_or_mesh(name, modes, count, monkeypatch):
    """A search with 10,000 poses and one with a mesh of 0.05 L find as many equilibria."""
    a, arguments = make_problem(name)
    assert len(find_solutions(name, modes)) == count
    assert len(solutions(a, modes=modes, poses=10_000, **arguments)) == count
    monkeypatch.setattr(all_equilibria, "MESH_SIZE", 0.05)
    assert len(solutions(a, modes=modes, **arguments)) == count


def test_load_of_the_wrong_sign_has_other_equilibria():
    """With the load -F of the document's eq. 104 no solution of Table 7 is an equilibrium.

    Table 7 is right, the equation is not.
    """
    a, arguments = make_problem("rfr2")
    wrong = solutions(a, inputs=arguments["inputs"], load=-np.array(arguments["load"]))
    for row in DATA["rfr2"]["printed"]:
        assert np.abs(wrong.psi - row["psi"]).max(axis=1).min() > 0.01


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"modes": 0}, "modes must be 1, 2"),
        ({"modes": [1, 2, 3]}, "each of 2 rods"),
        ({"modes": 1.5}, "got 1.5"),
        ({"most_load": 400.0}, r"most_load must lie within \[1, 340\]"),
        ({"poses": 0}, "poses must lie within"),
        ({"load": np.nan}, "load must be finite"),
        ({"inputs": np.zeros((2, 2))}, "those of one problem"),
    ],
)
def test_bad_input(change, words):
    a, arguments = make_problem("rfr2")
    with pytest.raises(ValueError, match=words):
        solutions(a, **arguments | change)


def test_unsupported_mechanisms_are_refused():
    with pytest.raises(ValueError, match="rigid_extension"):
        solutions(assembly([[-0.3, 0.0], [0.3, 0.0]], rigid_extension=0.1))
    sliding = assembly([[0.0, 0.0], [0.5, 0.0]], guide=[np.pi, 0.0])
    with pytest.raises(ValueError, match="further apart"):
        solutions(sliding, inputs=[1.0, 1.0])
