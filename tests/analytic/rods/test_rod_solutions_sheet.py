"""Parts of the search for all equilibria: chart, mesh, bound of the loads, Newton's matrix."""

import numpy as np
import pytest

from proofmass.analytic.rods import all_equilibria, tip
from proofmass.analytic.rods.all_equilibria import (
    TRIANGLE_MARGIN,
    bending_allowance,
    bound_by_pose,
    make_mesh,
    newton_system,
)
from proofmass.analytic.rods.elastica import rods_of_chart
from proofmass.analytic.rods.equilibrium import state
from tests.analytic.rods.rod_solutions_cases import alphas, find_solutions, make_problem


@pytest.fixture
def random():
    return np.random.default_rng(4)


def test_loads_are_bounded(random):
    """Loads of known equilibria are below the bound; random rods satisfy its inequality."""
    a, arguments = make_problem("rfr2")
    for modes in (1, 2, 3):
        assert alphas(find_solutions("rfr2", modes)).max() < bound_by_pose(
            state(a, **arguments), [modes] * 2
        )
    alpha, q = random.uniform(0.1, 25.0, 4000), random.uniform(-1.0, 1.0, 4000) * 28.0
    r = rods_of_chart(alpha, q)
    along = (r.tip * r.force.conj()).real / np.abs(r.force)
    for mode in (1, 2, 3):
        own = np.floor(r.waves) == mode - 1
        assert own.sum() > 100
        # interpolated between 4001 moduli
        assert np.all(along[own] >= 1.0 - bending_allowance(alpha[own], mode) / alpha[own] - 1e-6)


def random_rods(random, count):
    """Random rods of the chart, psi and k_rel of the document, and whether these are regular."""
    alpha, q = random.uniform(0.2, 15.0, count), random.uniform(-6.0, 6.0, count)
    r = rods_of_chart(alpha, q)
    psi = -np.angle(r.delta) % (2.0 * np.pi)
    least = np.abs(np.cos(psi / 2.0))
    k_rel = np.copysign((np.tanh(np.abs(q)) - least) / (1.0 - least), r.moment)
    plain = (np.abs(k_rel) > 1e-3) & (np.abs(k_rel) < 1.0 - 1e-6) & (psi > 0.05) & (psi < 6.2)
    return alpha, q, r, psi, k_rel, plain


def test_chart_agrees_with_the_form_by_inflections(random):
    """Rods of the chart are those of the closed form by psi, k_rel and mode."""
    _, _, r, psi, k_rel, plain = random_rods(random, 4000)
    assert plain.sum() > 500
    form = tip(psi[plain], k_rel[plain], np.floor(r.waves[plain]) + 1)
    # k_rel within 1e-6 of 1 has ten digits left
    np.testing.assert_allclose(form["x"] + 1j * form["y"], r.tip[plain], rtol=0, atol=1e-8)
    np.testing.assert_allclose(form["R"], np.abs(r.force[plain]), rtol=1e-8)
    np.testing.assert_allclose(form["m0"], r.moment[plain], rtol=0, atol=1e-7)
    np.testing.assert_allclose(form["energy"], r.energy[plain], rtol=0, atol=1e-6)


def test_derivatives_of_the_chart(random):
    """Derivatives of tip, load and angle by alpha and q are differences of fourth order."""
    alpha, q, r, *_ = random_rods(random, 2000)
    h = 1e-3  # errors: h^4 times a fifth derivative, rounding over h

    def difference(part, da, dq):
        one, two = (
            (
                getattr(rods_of_chart(alpha + n * da, q + n * dq), part)
                - getattr(rods_of_chart(alpha - n * da, q - n * dq), part)
            )
            / (2.0 * n * h)
            for n in (1, 2)
        )
        return (4.0 * one - two) / 3.0

    for part, slope in (("tip", r.tip_slope), ("force", r.force_slope)):
        size = 1.0 + np.abs(getattr(r, part))
        for i, step in enumerate([(h, 0.0), (0.0, h)]):
            assert np.max(np.abs(difference(part, *step) - slope[i]) / size) < 3e-8
    turn = (difference("delta", 0.0, h) / r.delta).imag  # d delta/dq = -2 k' y
    np.testing.assert_allclose(turn, -2.0 * r.field / np.cosh(q), rtol=0, atol=3e-8)


@pytest.mark.parametrize("modes", [1, 3])
def test_mesh_covers_all_rods(modes, random):
    """Within a cell of the lattice from the tip of a random rod the mesh has a rod like it.

    At the tip itself this need not be so: next to a fold of the manifold a tip may be outside of
    all triangles.
    """
    alpha, q = random.uniform(0.3, 19.7, 1200), random.uniform(-1.0, 1.0, 1200)
    q *= alpha + 6.0
    r = rods_of_chart(alpha, q)
    mine = np.flatnonzero((r.waves < modes) & (np.abs(r.tip) < 0.98))
    assert mine.size > 300
    around = 0.06 * np.append(0.0, np.exp(2j * np.pi * np.arange(8) / 8))
    mesh = make_mesh(modes, 20.0, 0.08)
    which, triangles, share = mesh.rods_at((r.tip[mine, None] + around).ravel())
    which, own = which // around.size, r.force[mine]
    force = (mesh.force[triangles] * share).sum(axis=1)
    nearest = np.full(mine.size, np.inf)
    np.minimum.at(nearest, which, np.abs(force - own[which]) / (1.0 + np.abs(own[which])))
    assert nearest.max() < 0.6  # [load]: 0.06 L away, between corners 0.08 L apart


def test_a_corner_of_the_mesh_is_computed_once_for_all_its_triangles(monkeypatch):
    """The rods that are computed for a mesh differ, except for those that are their own images."""
    computed = []
    monkeypatch.setattr(
        all_equilibria,
        "rods_of_chart",
        lambda alpha, q: computed.append((alpha, q)) or rods_of_chart(alpha, q),
    )
    mesh = make_mesh.__wrapped__(1, 3.0, 0.3)
    alpha, q = computed[-1]  # after the searches for the places of the corners
    assert alpha.size == len({*zip(alpha.tolist(), q.tolist(), strict=True)}) + (q == 0.0).sum() / 2
    found = rods_of_chart(mesh.chart[..., 0], mesh.chart[..., 1])
    np.testing.assert_array_equal(mesh.tip, found.tip)
    np.testing.assert_array_equal(mesh.force, found.force)


def test_newton_matrix_is_the_derivative(random):
    """Newton's matrix is the central difference of the residuals at random states."""
    a, arguments = make_problem("pfr3")
    s, h = state(a, **arguments), 1e-6
    chart = np.stack([random.uniform(1.0, 8.0, (3, 5)), random.uniform(-4.0, 4.0, (3, 5))], axis=1)
    pose = random.uniform(-0.5, 0.5, (3, 5))
    matrix, x = newton_system(s, chart, pose)[1], np.concatenate([chart.reshape(6, 5), pose])
    for j in range(9):
        up, down = (
            newton_system(s, (x + d).reshape(9, 5)[:6].reshape(3, 2, 5), (x + d)[6:])[0]
            for d in (h * np.eye(9)[:, j : j + 1], -h * np.eye(9)[:, j : j + 1])
        )
        # second order, and rounding over the step, for loads up to 4 N
        np.testing.assert_allclose((up - down) / (2.0 * h), matrix[..., j], rtol=0, atol=1e-8)


def test_all_triangles_around_a_point_are_listed(random):
    """`rods_at` lists all triangles that contain a point, and no others than nearby ones.

    The reference goes through all triangles, without bins.
    """
    mesh = make_mesh(1, 6.0, 0.2)
    point = random.uniform(-0.9, 0.9, 40) + 1j * random.uniform(-0.9, 0.9, 40)
    which, triangle, share = mesh.rods_at(point)
    a, b, c = np.moveaxis(mesh.tip, -1, 0)[..., None]
    size = ((b - a).conj() * (c - a)).imag
    parts = [((v - u).conj() * (point - u)).imag / size for u, v in ((b, c), (c, a), (a, b))]
    inside, inside_or_near = (
        set(zip(*np.nonzero((np.stack(parts) > least).all(axis=0)), strict=True))
        for least in (0.0, -TRIANGLE_MARGIN)
    )
    reached = set(zip(triangle, which, strict=True))
    assert inside < reached <= inside_or_near  # bins do not extend beyond sharp corners
    # thin triangles
    np.testing.assert_allclose(share, np.stack(parts)[:, triangle, which].T, rtol=0, atol=1e-9)
