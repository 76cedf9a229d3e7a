"""Rods by shooting: orders, derivatives, the document's Newton method, stability, bad values."""

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from proofmass.analytic.rods import from_tip, integrate, of_load, pinned, rod_pinned, tip
from proofmass.analytic.rods.shooting import stability
from proofmass.reference.charts import compute_chart
from proofmass.run.sidecar import load_case
from tests.shipped import shipped

FILE = Path(__file__).parents[2] / "data" / "rod_elliptic.json"
DATA = json.loads(FILE.read_text())["single_rod"]
EI, PIN = DATA["stiffness"], DATA["pin"]
ROD = {name: dict(zip(DATA["columns"], DATA[name], strict=True)) for name in "ABCD"}
DOCUMENT_SETTINGS = {"nodes": 61, "scheme": "rk4", "exact": False, "tolerance": 1e-7}


def recomputed_unknowns(name):
    """Recomputed tip force and clamp moment of rod A, B, C or D."""
    return [ROD[name][key] for key in ("n_x", "n_y", "m0")]


@cache
def solve_exact(n_x, n_y, m0):
    """The result of Newton's method with exact Jacobians from a guess, on 61 nodes."""
    return pinned(*PIN, (n_x, n_y, m0), stiffness=EI, nodes=61)


def test_bending_stiffnesses_of_the_documents_rods():
    """EI of the document's round rods is E pi r^4/4, in N m^2; its code names the unit Pa.

    This recomputes numbers of the document and of the data with which other tests run the product;
    no code of the product takes part.
    """
    for diameter, stiffness in ((1.5e-3, 0.05218602640), (2e-3, 0.16493361431)):
        assert 210e9 * np.pi * (diameter / 2) ** 4 / 4 == pytest.approx(stiffness, abs=1e-11)
    assert pytest.approx(EI, rel=1e-15, abs=0) == 210e9 * np.pi * 1e-12 / 4


@pytest.mark.parametrize(
    ("scheme", "order", "nodes"), [("rk4", 4, (81, 161)), ("dop853", 8, (17, 33))]
)
def test_integration_has_the_order_of_its_scheme(scheme, order, nodes):
    """The error of the tip is of fourth order for RK4 and of eighth order for DOP853."""
    reference = tip(1.3, -0.4, 2)
    force = reference["R"] * np.array([np.cos(1.3), np.sin(1.3)])
    errors = []
    for count in nodes:
        rod = integrate(*force, reference["m0"], nodes=count, scheme=scheme)
        errors.append(np.hypot(rod.x[-1] - reference["x"], rod.y[-1] - reference["y"]))
    seen = np.log2(errors[0] / errors[1])
    assert seen == pytest.approx(order, rel=0.06)  # terms of the next order


def test_errors_of_the_document_s_scheme():
    """Under the exact load of A the tip has the recomputed errors of RK4, of fourth order."""
    exact = pinned(*PIN, recomputed_unknowns("A"), stiffness=EI, nodes=161).unknowns
    for count, error in DATA["rk4_tip_error_at_A"].items():
        rod = integrate(*exact, stiffness=EI, nodes=int(count), scheme="rk4")
        found = np.hypot(rod.x[-1] - PIN[0], rod.y[-1] - PIN[1])
        assert found == pytest.approx(error, rel=5e-3)  # data: three digits


def test_scipy_s_integrator_agrees_under_weight():
    """`integrate` and `from_tip`, with a dead load along the rod, agree with scipy's DOP853."""
    n, w, length = np.array([0.4, -1.1]), np.array([0.7, -2.0]), 1.3

    def rate(s, z):
        force = n + w * (length - s)
        return [
            z[1] / 0.5,
            force[0] * np.sin(z[0]) - force[1] * np.cos(z[0]),
            np.cos(z[0]),
            np.sin(z[0]),
        ]

    run = solve_ivp(rate, (0.0, length), [0.3, 0.8, 0.1, 0.2], "DOP853", rtol=1e-13, atol=1e-14)
    rod = integrate(
        *n,
        0.8,
        theta0=0.3,
        x0=0.1,
        y0=0.2,
        weight_x=w[0],
        weight_y=w[1],
        length=length,
        stiffness=0.5,
    )
    found = [rod.theta[-1], rod.m[-1], rod.x[-1], rod.y[-1]]
    np.testing.assert_allclose(found, run.y[:, -1], rtol=0, atol=1e-11)  # scipy, summed
    back = from_tip(
        *n, rod.theta[-1], rod.m[-1], weight_x=w[0], weight_y=w[1], length=length, stiffness=0.5
    )
    np.testing.assert_allclose(
        [back.theta[-1], -back.m[-1], back.x[-1], back.y[-1]],
        [0.3, 0.8, rod.x[-1] - 0.1, rod.y[-1] - 0.2],
        rtol=0,
        atol=1e-13,
    )


@pytest.mark.parametrize("scheme", ["rk4", "dop853"])
def test_slopes_agree_with_differences(scheme):
    """Derivatives of the tip are central differences."""
    parameters, step = np.array([-1.2, 0.7, 0.5, 0.3]), 1e-4
    shared = {"weight_x": 0.3, "weight_y": -0.6, "length": 1.2, "stiffness": 0.4, "scheme": scheme}
    exact = integrate(*parameters[:3], theta0=parameters[3], slopes=True, **shared).slope[-1]
    offsets = step * np.concatenate([np.eye(4), -np.eye(4)])
    moved = (parameters + offsets).T
    ends = integrate(*moved[:3], theta0=moved[3], **shared)
    values = np.array([ends.theta[-1], ends.m[-1], ends.x[-1], ends.y[-1]])
    slope = (values[:, :4] - values[:, 4:]) / (2.0 * step)
    np.testing.assert_allclose(exact, slope, rtol=0, atol=1e-7)  # third derivatives times step^2


@pytest.mark.parametrize("name", "ABCD")
def test_newton_finds_the_recomputed_solutions(name):
    """Newton's method from the recomputed digits converges to them, in three steps or fewer.

    The closed form has the recomputed parameters and energy and its tip at the pin.
    """
    row = ROD[name]
    shot = pinned(*PIN, recomputed_unknowns(name), stiffness=EI, nodes=161)
    assert shot.converged
    assert shot.iterations <= 3
    np.testing.assert_allclose(
        shot.unknowns, recomputed_unknowns(name), rtol=0, atol=1e-6
    )  # data: 5e-8
    assert np.degrees(shot.rod.theta[-1]) == pytest.approx(row["tip_deg"], abs=2e-5)
    psi, k_rel, mode = of_load(*shot.unknowns, stiffness=EI)
    assert (round(float(psi), 6), float(mode)) == (round(row["psi"], 6), row["mode"])
    assert k_rel == pytest.approx(row["k_rel"], abs=6e-8)
    closed = tip(psi, k_rel, mode, stiffness=EI)
    assert closed["energy"] == pytest.approx(row["U"], abs=6e-8)
    # k_rel and psi have errors of Newton's tolerance, 1e-12
    assert [closed["x"], closed["y"]] == pytest.approx(PIN, abs=1e-11)


@pytest.mark.parametrize("name", "ABCD")
def test_stability_with_a_pinned_tip(name):
    """The number of negative directions is that of the data and of a discrete Hessian."""
    row = ROD[name]
    found = stability(row["n_x"], row["n_y"], np.radians(row["tip_deg"]), stiffness=EI)
    assert found.pinned == row["negative"]
    assert found.pinned == count_negative_directions(*recomputed_unknowns(name))


def count_negative_directions(n_x, n_y, m0, cells=60):
    """Number of negative eigenvalues of the energy's Hessian for motions with a fixed tip."""
    rod = integrate(n_x, n_y, m0, stiffness=EI, nodes=2 * cells + 1)
    theta, h = rod.theta[1::2], 1.0 / cells  # constant angle in each cell
    along = n_x * np.cos(theta) + n_y * np.sin(theta)
    spring = np.full(cells, EI / h)
    spring[0] *= 2.0  # half a cell to the clamp
    hessian = np.diag(spring + np.append(spring[1:], 0.0) + h * along)
    hessian -= np.diag(spring[1:], 1) + np.diag(spring[1:], -1)
    closed = np.stack([np.sin(theta), np.cos(theta)])
    free = np.linalg.svd(closed)[2][2:]
    return int(np.sum(np.linalg.eigvalsh(free @ hessian @ free.T) < 0.0))


def test_compliance_by_differences():
    """The tip's compliance is the inverse of differences of pin forces, and symmetric."""
    exact = pinned(*PIN, recomputed_unknowns("B"), stiffness=EI, nodes=161)
    found = stability(*exact.unknowns[:2], exact.rod.theta[-1], stiffness=EI).compliance
    step, stiff = 1e-4, np.empty((2, 2))
    for k, move in enumerate(step * np.eye(2)):
        ahead, behind = (
            pinned(*(PIN + sign * move), exact.unknowns, stiffness=EI).unknowns
            for sign in (1.0, -1.0)
        )
        stiff[:, k] = (ahead - behind)[:2] / (2.0 * step)
    # third derivatives times step^2: forces of 4 N change over 0.1 m
    np.testing.assert_allclose(found @ stiff, np.eye(2), rtol=0, atol=1e-4)
    assert abs(found[0, 1] - found[1, 0]) <= 1e-12  # force: gradient of an energy


@pytest.mark.parametrize(("guess", "name"), DATA["guesses"])
@pytest.mark.parametrize("way", ["document", "exact"])
def test_guess_selects_the_branch(guess, name, way):
    """Both Newton methods lead from each guess to the same recomputed equilibrium.

    The document's method takes six iterations from its own guess, 0.1.
    """
    by_document = way == "document"
    shot = (
        pinned(*PIN, guess, stiffness=EI, **DOCUMENT_SETTINGS)
        if by_document
        else solve_exact(*guess)
    )
    assert shot.converged
    # errors of RK4 with 61 nodes, 2e-7 m at A and B, more at C, times stiffnesses of 1 to 20 N/m
    np.testing.assert_allclose(
        shot.unknowns,
        recomputed_unknowns(name),
        rtol=0,
        atol={"A": 1e-5, "B": 1e-5, "C": 1e-4}[name],
    )
    if guess == [0.1, 0.1, 0.1] and by_document:
        assert shot.iterations == 6


@pytest.fixture(scope="module")
def page():
    case = load_case(shipped("rod_pinned.toml"))
    return {
        table.draw: compute_chart(case, table)
        for table in case.chart
        if table.draw.startswith("shooting")
    }


def test_page_draws_the_document_s_shooting_from_its_guess_to_the_solution(page):
    """The page draws the course of the three unknowns from annex II's guess, 0.1, to rod A."""
    for k, (panel, name) in enumerate(
        zip(page["shooting_course"].panels, ("n_x [N]", "n_y [N]", "m_0 [N m]"), strict=True)
    ):
        assert panel.title == name
        exact, document = panel.lines
        assert exact.y[0] == document.y[0] == 0.1
        assert exact.y[-1] == pytest.approx(recomputed_unknowns("A")[k], abs=1e-6)  # data: 5e-8
        assert document.y[-1] == pytest.approx(
            recomputed_unknowns("A")[k], abs=1e-5
        )  # RK4: 2e-7 m of the tip
        assert document.x.tolist() == list(range(7))  # six steps, as in an independent run
    titles = [panel.title for panel in page["shooting_convergence"].panels]
    assert titles[1] == "the document's way: 6 iterations"


def test_every_iterate_is_newton_s_step_from_the_one_before(page):
    """Each step is Newton's by central differences, -J^-1 f, or a half, a quarter, .. of it."""
    log, h = solve_exact(0.1, 0.1, 0.1).log, 1e-5

    def miss(unknowns):
        rod = integrate(*unknowns, stiffness=EI, nodes=61)
        return np.array([rod.x[-1] - PIN[0], rod.y[-1] - PIN[1], rod.m[-1]])

    halvings = []
    for before, after in zip(log.iterates[:-1], log.iterates[1:], strict=True):
        left, *ends = miss(
            before[:, None] + h * np.hstack([np.zeros((3, 1)), np.eye(3), -np.eye(3)])
        ).T
        jacobian = (np.transpose(ends[:3]) - np.transpose(ends[3:])) / 2 / h
        whole = np.linalg.solve(jacobian, -left)
        share = float((after - before) @ whole / (whole @ whole))
        np.testing.assert_allclose(after - before, share * whole, rtol=0, atol=1e-7)  # h^2 in J
        halvings.append(-np.log2(share))
    np.testing.assert_allclose(halvings, np.round(halvings), rtol=0, atol=1e-5)
    assert max(halvings) >= 1  # some step was halved
    assert halvings[-3:] == pytest.approx([0, 0, 0], abs=1e-5)  # none at the end


def error_after_a_step(wrong, distance, direction):
    """Error after one Newton step from next to A, with a Jacobian that is wrong by a share."""
    root = solve_exact(*recomputed_unknowns("A")).unknowns
    rod = integrate(*(root + distance * direction), stiffness=EI, nodes=61, slopes=True)
    f = np.array([rod.x[-1] - PIN[0], rod.y[-1] - PIN[1], rod.m[-1]])
    jacobian = (1.0 + wrong) * rod.slope[-1][[2, 3, 1], :3]

    def system(x):
        return f, jacobian

    log, _ = rod_pinned.newton(lambda x: 0.0 * x, system, root + distance * direction, 1e-12)
    return float(np.linalg.norm(log.iterates[1] - root))


@pytest.mark.parametrize("seed", range(4))
def test_shooting_converges_quadratically(seed):
    """Half the distance leaves a quarter of the error; with a Jacobian wrong by 1 %, half of it."""
    direction = np.random.default_rng(seed).normal(size=3)
    direction /= np.linalg.norm(direction)
    orders = [
        np.log2(
            error_after_a_step(wrong, 4e-3, direction) / error_after_a_step(wrong, 2e-3, direction)
        )
        for wrong in (0.0, 0.01)
    ]
    assert orders[0] == pytest.approx(2.0, abs=0.05)  # the next term, 4e-3 of it
    assert abs(orders[1] - 2.0) > 0.5


def test_last_steps_of_the_page_are_quadratic(page):
    """The last errors are less than three times the square of the error before.

    In a slower iteration, with steps that are wrong by 1 %, they would be larger than that.
    """
    log = solve_exact(0.1, 0.1, 0.1).log
    errors = np.linalg.norm(log.iterates - log.root, axis=1)[-4:-1]
    assert np.all(errors[1:] < 3.0 * errors[:-1] ** 2)
    assert not np.all(errors[1:] + 0.01 * errors[:-1] < 3.0 * errors[:-1] ** 2)
    (exact, _) = page["shooting_convergence"].panels
    size = {line.label: line.y for line in exact.lines}["error: norm of the step"]
    np.testing.assert_allclose(size, log.steps, rtol=1e-4, atol=1e-12)  # the page has 81 nodes


def test_a_guess_next_to_buckling_leads_to_a_fifth_equilibrium():
    """From a guess next to buckling Newton's method with exact slopes finds a fifth equilibrium.

    The guess has n_x = -0.4 N, next to pi^2/4 EI = 0.407 N, where the clamped-free rod buckles, so
    that the first Jacobian is nearly singular.  With forward differences rounding errors determine
    the result: an independent run ended in D.
    """
    guess, ends = (-0.4, 0.1, 0.1), set()
    for nodes in (41, 61):
        exact = pinned(*PIN, guess, stiffness=EI, nodes=nodes)
        assert exact.converged
        assert of_load(*exact.unknowns, stiffness=EI)[2] == 4
        ends.add(round(exact.unknowns[0], 3))
    assert ends == {-20.655}
    first = integrate(*guess, stiffness=EI, slopes=True).slope[-1][[2, 3, 1], :3]
    assert np.linalg.cond(first) > 5e3


def test_bad_values_are_named():
    for change, message in (
        ({"length": -1.0}, "length"),
        ({"stiffness": 0.0}, "stiffness"),
        ({"nodes": 1}, "nodes"),
        ({"scheme": "euler"}, "scheme"),
    ):
        with pytest.raises(ValueError, match=f"^{message} must"):
            integrate(1.0, 0.0, 0.0, **change)
    with pytest.raises(
        ValueError, match=r"^length must reach beyond the pin, 1.11803 m away, got 1"
    ):
        pinned(1.0, 0.5, (0.1, 0.1, 0.1))
    with pytest.raises(ValueError, match=r"^guess must be n_x, n_y and m0, .* array \(2,\)"):
        pinned(0.5, 0.0, (1.0, 1.0))
    with pytest.raises(ValueError, match=r"^guess must be finite"):
        pinned(0.5, 0.0, (1.0, 1.0, np.nan))
    with pytest.raises(ValueError, match=r"^x must be finite"):
        pinned(np.nan, 0.0, (1.0, 1.0, 1.0), axial=10.0)


PINNED = {"pin_x": 0.8, "pin_y": 0.1, "force_x": -20.0, "force_y": -7.0, "moment": -3.7}
S = np.array([0.0, 0.5, 1.0])


@pytest.mark.parametrize("length", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize("stiffness", [1e-12, 1e6])
def test_a_pinned_rod_of_any_size_has_the_shape_of_the_unit_rod(length, stiffness):
    """Places scale with L, moments with EI/L and forces with EI/L^2, in closed and shot rods."""
    moment, force = stiffness / length, stiffness / length**2
    units = {"pin_x": length, "pin_y": length, "moment": moment, "force_x": force, "force_y": force}
    scaled = {name: value * units[name] for name, value in PINNED.items()}
    for weight in (0.0, -5.0):
        one = rod_pinned.solve(S, **PINNED, weight_y=weight)
        other = rod_pinned.solve(
            S * length,
            **scaled,
            length=length,
            stiffness=stiffness,
            weight_y=weight * force / length,
        )
        for name, unit in (("x", length), ("y", length), ("theta", 1.0), ("m", moment)):
            # Newton's tolerance, and rounding of the units
            np.testing.assert_allclose(other[name] / unit, one[name], rtol=0, atol=1e-11)


def test_a_pinned_rod_of_many_half_waves_is_scipy_s():
    """A rod under 3000 EI/L^2 that scipy integrates from its tip is found from its own force."""
    load = 3000.0

    def rate(t, z):  # from the tip, whose tangent has 2.5 rad to the force
        return [-z[1], -load * np.sin(z[0]), -np.cos(z[0]), -np.sin(z[0])]

    start = [2.5, 0.0, 0.0, 0.0]
    run = solve_ivp(
        rate, (0.0, 1.0), start, "DOP853", rtol=1e-13, atol=1e-14, t_eval=[0.0, 0.5, 1.0]
    )
    turn = np.exp(-1j * run.y[0, -1])
    place = (run.y[2] + 1j * run.y[3] - complex(*run.y[2:, -1])) * turn
    found = rod_pinned.solve(
        [1.0, 0.5],
        pin_x=place[0].real,
        pin_y=place[0].imag,
        force_x=load * turn.real,
        force_y=load * turn.imag,
        moment=run.y[1, -1],
    )
    # `integrate_to_tip` has an error of 5e-11; with 81 nodes it was 2e-8, and 3e-4 in the moment
    np.testing.assert_allclose(found["x"] + 1j * found["y"], place[:2], rtol=0, atol=1e-10)
    np.testing.assert_allclose(-found["hold"], run.y[1, -1], rtol=0, atol=1e-6)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"s": 2.0}, r"s must lie within \[0, 1.0\] \[m\], got 2.0"),
        ({"s": np.nan}, "s must lie within .* got nan"),
        ({"theta0": np.nan}, "theta0 must be finite"),
        ({"pin_x": [0.8, 0.7]}, "pin_x must be one number"),
        ({"length": [1.0, 2.0]}, "length must be"),
        ({"stiffness": [1.0, 2.0]}, "stiffness must be"),
        ({"axial": [1.0, 2.0]}, "axial must be"),
        ({"pin_x": 1.0, "pin_y": 0.0}, "length must reach beyond the pin, 1 m away, got 1"),
        ({"force_x": 0.0, "force_y": 0.0, "moment": 0.0}, "= 0, 0, 0 lead to no equilibrium"),
        ({"force_x": 1e39}, "lead to no equilibrium; give a nearer guess"),
    ],
)
def test_bad_values_of_a_pinned_rod_are_named(change, words):
    """Bad values are named; a straight rod is refused, whose force no equation determines.

    Guesses with a singular Jacobian or an overflow lead to no equilibrium.
    """
    with pytest.raises(ValueError, match=words):
        rod_pinned.solve(**{"s": 0.5} | PINNED | change)


@pytest.mark.parametrize(
    "nodes", [[1.0, 0.5, 0.0], [0.5, 1.0], [0.0, 0.5], [0.0, 0.5, 0.5, 1.0], [0.0, np.nan, 1.0]]
)
def test_nodes_that_do_not_rise_from_the_clamp_to_the_tip_are_refused(nodes):
    """Nodes that begin elsewhere had the clamp there."""
    with pytest.raises(ValueError, match="nodes must rise from 0 to the length"):
        integrate(0.0, 0.0, 1.0, nodes=np.array(nodes))


@pytest.mark.parametrize("nodes", [1, 2.5, np.nan, -3, [0.0], [[0.0, 1.0]]])
def test_nodes_that_are_not_two_or_more_in_a_row_are_refused(nodes):
    with pytest.raises(ValueError, match="nodes must be"):
        integrate(0.0, 0.0, 1.0, nodes=nodes)


@pytest.mark.parametrize("nodes", [[0.0, 0.25, 0.5, 0.75, 1.0], np.int64(5)])
def test_nodes_may_be_a_list_or_an_integer_of_numpy(nodes):
    np.testing.assert_array_equal(
        integrate(0.0, 0.0, 1.0, nodes=nodes).y, integrate(0.0, 0.0, 1.0, nodes=5).y
    )
