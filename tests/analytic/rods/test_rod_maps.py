"""Maps of flexible mechanisms: singularities by differences, stability by shooting, symmetry."""

from functools import cache

import numpy as np
import pytest

from proofmass.analytic.rods import integrate
from proofmass.analytic.rods.continuation import follow
from proofmass.analytic.rods.equilibrium import derivatives, solve_direct, state
from proofmass.analytic.rods.rod_pair import motor_angles, workspace
from proofmass.analytic.rods.rod_platform_driven import constant_orientation
from proofmass.analytic.rods.shooting import stability
from proofmass.analytic.rods.workspace import (
    aspect_nodes,
    border_directions,
    connected_edges,
    determinant_field,
    find_rim,
    find_singularities,
    fit_pose_map,
    map_area,
    map_equilibria,
    mesh_map,
    pose_chart,
)
from tests.analytic.rods.rod_assembly_cases import DATA, EI, PAIR, table_7_state

PAIR_PARAMETERS = {
    "distance": 0.6,
    "theta1": np.radians(40),
    "theta2": np.radians(60),
    "force_x": 0.3,
    "force_y": -0.1,
    "pin_x": 0.19,
    "pin_y": 0.86,
    "moment1": 0.086,
    "moment2": -0.025,
    "push_x": 0.19,
    "push_y": 0.51,
    "stiffness": EI,
}
CLAMPS = PAIR.clamp


@cache
def natural_map():
    """Map of the poses that are reached from S4, over 17 by 17 nodes."""
    return fit_pose_map(table_7_state("S4"), 17)


@cache
def unloaded_state():
    """The equilibrium without load whose pin is that of S2."""
    row = DATA["rfr2"]["recomputed"]["S2"]
    near = table_7_state("S2")
    return solve_direct(
        state(
            PAIR,
            inputs=np.radians(row["unloaded_inputs_deg"]),
            pose=near.pose,
            moment=near.moment,
            force=near.force,
        )
    )


@cache
def map_at_the_fold():
    """Map of poses about the fold of motor 1."""
    return map_equilibria(unloaded_state(), np.linspace(0.2, 0.6, 9), np.linspace(-0.45, -0.2, 6))


@cache
def rim_and_mesh():
    """The rim of that map, and its mesh."""
    m, rims = map_at_the_fold(), find_rim(map_at_the_fold())
    return rims, mesh_map(m, connected_edges(m)[0], rims[0], find_singularities(m, "direct", rims))


@cache
def direct_singularities():
    """Direct singularities on that map."""
    return rim_and_mesh()[1].loci


def residual(x, inputs, load):
    """Eq. 98 of Pérez Gámiz 2018 by another integrator; x (8, n) is in the order of eq. 102."""
    rows = []
    for i, clamp in enumerate(CLAMPS):
        m0, n_x, n_y = x[3 * i : 3 * i + 3]
        rod = integrate(n_x, n_y, m0, theta0=inputs[i], stiffness=EI, nodes=41)
        rows += [rod.m[-1], clamp.real + rod.x[-1] - x[6], clamp.imag + rod.y[-1] - x[7]]
    return np.array([*rows, x[1] + x[4] - load[0], x[2] + x[5] - load[1]])


def singular_values(s):
    """Singular values of the 8 x 8 matrix of the direct problem, by central differences."""
    x, h = s.vector[:8, None], 1e-5 * np.eye(8)
    up, down = (residual(x + step, s.inputs, s.load) for step in (h, -h))
    return np.linalg.svd((up - down) / 2e-5, compute_uv=False)


def test_direct_singularities_by_differences():
    """At direct singularities the matrix of the *direct* problem is singular.

    There the motors no longer constrain the pin.
    """
    found = direct_singularities()
    assert len(found.vector) > 4
    for s in (found[i] for i in range(0, len(found.vector), 3)):
        values = singular_values(s)
        # bisection to 1e-9 of an edge of 0.05 m; differences: 1e-10 of third derivatives up to 1e3
        assert values[-1] < 1e-6 * values[0]
        assert values[-2] > 1e-4 * values[0]
    values = singular_values(unloaded_state())
    assert values[-1] > 1e-4 * values[0]


def test_a_fold_of_a_motor_is_a_direct_singularity_of_the_map():
    """The fold at which a path of motor 1 ends is a direct singularity of the map of poses."""
    start = unloaded_state()
    fold = follow(start, inputs=start.inputs[None] - [1.0, 0.0]).last
    distance = np.linalg.norm(direct_singularities().pose - fold.pose, axis=1).min()
    assert distance < 0.05  # an edge, since points are only on lines of the grid
    assert abs(np.linalg.eigvalsh(derivatives(fold).stiffness)[0]) < 1e-8


@pytest.mark.slow
def test_the_rim_of_a_map_is_an_inverse_singularity():
    """At the rim of a manifold the inverse determinant is small compared with that at S4."""
    ends, directions = find_rim(natural_map())
    slopes = derivatives(ends)
    start = derivatives(table_7_state("S4"))
    # 1e-4 of an edge from the rim the determinant is of the order of its root, 1e-2
    share = np.abs(slopes.inverse_determinant / start.inverse_determinant)
    assert np.median(share) < 0.05
    assert len(ends.vector) == len(directions)
    assert np.all(np.abs(ends.pose[:, 0] + 1j * ends.pose[:, 1] - CLAMPS[:, None]) <= 1.0 + 1e-9)


@pytest.mark.slow
def test_top_of_the_rim_is_the_reach_of_straight_rods():
    """At its top, where the pin pulls, the manifold ends where one rod is straight."""
    ends, directions = find_rim(natural_map())
    top = ends.pose[(directions[:, 1] == 1) & (ends.pose[:, 1] > 0.5)]
    away = np.abs(top @ [1.0, 1.0j] - CLAMPS[:, None]).max(axis=0)
    assert len(top) > 5
    assert np.quantile(np.abs(away - 1.0), 0.8) < 1e-3  # the march ends 1e-4 of an edge inside


def test_the_aspect_of_a_stable_equilibrium_is_stable():
    """In the aspect of S4 all equilibria are stable; beyond it some are unstable.

    Stability follows from Jacobi's field of each rod with its tip pinned and from the stiffness of
    the pin.
    """
    m = fit_pose_map(table_7_state("S4"), 13)
    edges, torn = connected_edges(m)
    own = aspect_nodes(m, edges, table_7_state("S4"))
    states = m.states[own]
    turn = states.shape([1.0])[2][..., 0]
    assert 30 < own.sum() < m.reached.sum()
    for i in range(2):
        rods = stability(states.force[:, i, 0], states.force[:, i, 1], turn[:, i], stiffness=EI)
        assert not rods.pinned.any()
    assert np.linalg.eigvalsh(derivatives(states).stiffness).min() > 0.0
    beyond = derivatives(m.states[m.reached & ~own & ~torn])
    assert (np.linalg.eigvalsh(beyond.stiffness)[:, 0] < 0.0).any()


@pytest.mark.slow
def test_labels_of_singularities_are_those_of_the_text():
    """Labels are those of the document's text; its program has them exchanged.

    A singularity is direct where K and dq/dP are singular.
    """
    chart = pose_chart(table_7_state("S4"), natural_map(), "rad²/m²")
    lines = {line.label: np.stack([line.x, line.y], axis=1) for line in chart.panels[0].lines}
    for label, states in (
        (
            "direct singularity",
            find_singularities(natural_map(), "direct", find_rim(natural_map())),
        ),
        ("inverse singularity", find_rim(natural_map())[0]),
    ):
        points = lines[label][np.isfinite(lines[label][:, 0])]
        assert len(points) > 20
        assert np.abs(points[:, None] - states.pose).sum(axis=-1).min(axis=1).max() < 1e-9
    field = chart.panels[1].field  # within the first direct singularity
    assert field.values[np.unique(field.triangles)].min() >= 0.0


@pytest.mark.slow
def test_the_unloaded_map_is_its_own_mirror_image():
    """Without load the inverse determinant of a symmetric pair is the same at mirrored poses."""
    row = DATA["symmetric"]["recomputed"][1]
    first, moment = np.array(row["force1"]), row["moment1"]
    start = solve_direct(
        state(
            PAIR,
            inputs=np.radians(DATA["symmetric"]["inputs_deg"]),
            pose=[0.0, row["y"]],
            moment=[moment, -moment],
            force=[first, -first],
        )
    )
    m = fit_pose_map(start, 11)
    assert m.first == pytest.approx(-m.first[::-1], abs=1e-12)
    values = np.linalg.det(derivatives(m.states[m.reached & m.reached[::-1]]).inverse)
    mirrored = np.full(m.reached.shape, np.nan)
    mirrored[m.reached & m.reached[::-1]] = values
    gap = np.abs(mirrored / mirrored[::-1] - 1.0)[m.reached & m.reached[::-1]]
    assert gap.size > 0.9 * m.reached.sum()
    assert np.quantile(gap, 0.85) < 1e-6  # elsewhere the manifold lies over itself


@cache
def motor_chart():
    """Charts of the case over its motor angles."""
    return motor_angles(**PAIR_PARAMETERS, span=0.4, nodes=5)


def test_maps_do_not_depend_on_the_unit_of_force():
    """With twice the stiffness and twice the load the maps are the same.

    With twice the stiffness alone they differ.
    """
    stiff = PAIR_PARAMETERS | {
        key: 2 * PAIR_PARAMETERS[key]
        for key in ("force_x", "force_y", "moment1", "moment2", "push_x", "push_y", "stiffness")
    }
    one, two = motor_chart().panels[0], motor_angles(**stiff, span=0.4, nodes=5).panels[0]
    assert one.field.values == pytest.approx(two.field.values, rel=1e-6, nan_ok=True)  # Newton
    light = motor_angles(**PAIR_PARAMETERS | {"stiffness": 2 * EI}, span=0.4, nodes=5).panels[0]
    assert np.nanmax(np.abs(light.field.values / one.field.values - 1.0)) > 0.01


@pytest.mark.slow
def test_the_area_of_a_map_converges():
    """The area of a map converges with the number of its lines.

    The extent of a line is exact; between lines a corner of the rim leaves an error of the square
    of their distance.
    """
    areas = [
        map_area(m, *find_rim(m))
        for m in (fit_pose_map(table_7_state("S4"), n) for n in (17, 29, 57))
    ]
    # each of several corners of the rim takes (1/28)^2 or (1/16)^2 of the window
    assert areas[1] == pytest.approx(areas[2], rel=0.01)
    assert areas[0] == pytest.approx(areas[2], rel=0.03)


def test_motor_angles_show_the_field_at_the_case():
    """The middle node of the charts has the determinant and the pose of the case, S4."""
    chart = motor_chart()
    field = chart.panels[0].field
    here = derivatives(table_7_state("S4")).direct
    most = np.nanmax(field.values)  # four fifths are not clipped
    middle = 12  # of five by five nodes
    assert field.values[middle] == pytest.approx(min(np.linalg.det(here), most), rel=1e-6)
    assert field.x[middle] == pytest.approx(PAIR_PARAMETERS["theta1"])
    for k, panel in enumerate(chart.panels[1:]):
        assert panel.field.values[middle] == pytest.approx(table_7_state("S4").pose[k], abs=1e-9)


@cache
def platform_chart():
    turns = {
        f"{name}{k}": turn
        for name in ("theta", "guide")
        for k, turn in enumerate(np.radians([0.0, 120.0, -120.0]), 1)
    }
    return constant_orientation(side=0.5, **turns, stiffness=EI, nodes=7)


@pytest.mark.slow
def test_platform_without_load_is_stiffest_at_the_centre():
    """The stiffness of three equal rods is largest at the centre.

    A third of a turn does not change it, so that its gradient is zero there.
    """
    field = platform_chart().panels[1].field
    best = np.nanargmax(field.values)
    assert np.hypot(field.x[best], field.y[best]) < 0.1
    assert "80.61" in platform_chart().caption  # degrees, as recomputed


@pytest.mark.parametrize(
    ("wrong", "word"),
    [({"nodes": 4}, "nodes must lie within"), ({"distance": 3.0}, "clamps 1 and 2 are 3 m apart")],
)
def test_bad_maps(wrong, word):
    with pytest.raises(ValueError, match=word):
        workspace(**PAIR_PARAMETERS | wrong)


def test_bad_windows():
    with pytest.raises(ValueError, match="span must be"):
        motor_angles(**PAIR_PARAMETERS, span=0.0)


@cache
def coarse_map():
    """Map of the poses that are reached from S4 on a coarse grid, its rim and its mesh."""
    m = fit_pose_map(table_7_state("S4"), 11)
    rims = find_rim(m)
    return (
        m,
        rims,
        mesh_map(m, connected_edges(m)[0], rims[0], find_singularities(m, "direct", rims)),
    )


def triangle_corners(mesh, triangles):
    """Positions (t, 3) of the corners of triangles, as x + iy."""
    return (mesh.xy @ [1.0, 1.0j])[triangles]


def triangle_areas(corners):
    """Areas (t,) of triangles, positive if counter-clockwise."""
    one, other = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    return 0.5 * np.imag(np.conj(one) * other)


def test_triangles_fill_the_map_to_its_rim():
    """Triangles cover the area of the map, more than its whole cells, up to points at the rim."""
    m, (ends, directions), mesh = coarse_map()
    whole = triangle_corners(mesh, mesh.triangles(m.reached))
    covered = np.abs(triangle_areas(whole)).sum()
    cell = np.mean(np.diff(m.first)) * np.mean(np.diff(m.second))
    full = np.sum(m.reached[:-1, :-1] & m.reached[1:, :-1] & m.reached[1:, 1:] & m.reached[:-1, 1:])
    # cells of tears may be missing; a rim along whole cells would leave far more
    assert covered == pytest.approx(map_area(m, ends, directions), rel=0.08)
    assert covered > 1.1 * full * cell
    last = np.unique(mesh.triangles(m.reached))
    beyond = sum(border_directions(m))
    inside = ((beyond >= 0) & (beyond < m.reached.shape)).all(axis=1)  # not at the window's edge
    assert (last >= m.reached.size).sum() > 0.8 * inside.sum() > 10


def test_triangles_at_a_tear_end_half_way_from_both_sides():
    """Where an edge is removed, as if its ends did not follow from each other, no area is missing.

    The triangles end at the middle of that edge, from both sides.
    """
    m, edges = map_at_the_fold(), connected_edges(map_at_the_fold())[0]
    (ends, _), mesh = rim_and_mesh()
    whole = mesh.triangles(m.reached)
    within = np.isin(edges, np.flatnonzero(inner_nodes(m.reached))).all(axis=1)
    k = int(np.flatnonzero(within)[0])
    cut = mesh_map(m, np.delete(edges, k, axis=0), ends, mesh.loci)
    first, last = m.reached.size + len(mesh.ends.vector), m.reached.size + len(cut.ends.vector)
    assert last - first == 2
    middle = cut.xy[edges[k]].mean(axis=0)
    np.testing.assert_allclose(cut.xy[first:last], [middle, middle], rtol=0, atol=1e-12)
    triangles = cut.triangles(m.reached)
    both = np.isin(triangles, edges[k]).sum(axis=1) == 2
    assert not both.any()
    assert (np.isin(whole, edges[k]).sum(axis=1) == 2).any()
    area_of = [
        np.abs(triangle_areas(triangle_corners(*one))).sum()
        for one in ((mesh, whole), (cut, triangles))
    ]
    assert area_of[1] == pytest.approx(area_of[0], rel=1e-12, abs=0)


def inner_nodes(inside):
    """Nodes all of whose eight neighbours are inside."""
    padded = np.pad(inside, 1)
    rows, columns = inside.shape
    return np.all(
        [padded[i : i + rows, j : j + columns] for i in range(3) for j in range(3)], axis=0
    )


@pytest.mark.slow
def test_triangles_leave_no_cell_of_a_map_empty():
    """Triangles cover a map of which two nodes of 245 are next to tears.

    Without triangles in cells with tears 10 % of the area would be missing.
    """
    m = fit_pose_map(table_7_state("S4"), 24)
    rims = find_rim(m)
    edges, torn = connected_edges(m)
    mesh = mesh_map(m, edges, rims[0], find_singularities(m, "direct", rims))
    covered = np.abs(triangle_areas(triangle_corners(mesh, mesh.triangles(m.reached)))).sum()
    assert covered == pytest.approx(map_area(m, *rims), rel=0.03)  # chords of the rim
    assert torn.sum() < 10


def test_triangles_of_both_signs_meet_at_the_singularity_and_do_not_overlap():
    """Triangles over nodes of either sign of the determinant cover the map without overlap.

    The determinant is zero at direct singularities, and no triangle extends across them.
    """
    m, (_, mesh) = map_at_the_fold(), rim_and_mesh()
    det = np.full(m.reached.shape, np.nan)
    det[m.reached] = np.linalg.det(derivatives(m.states[m.reached]).inverse)
    parts = [
        mesh.triangles(m.reached & (sign * det > 0.0), within=True, beyond=True) for sign in (1, -1)
    ]
    both = np.abs(triangle_areas(triangle_corners(mesh, np.concatenate(parts)))).sum()
    whole = np.abs(triangle_areas(triangle_corners(mesh, mesh.triangles(m.reached)))).sum()
    assert both <= whole * (1.0 + 1e-9)
    assert both > 0.9 * whole
    for part, sign in zip(parts, (1, -1), strict=True):
        nodes = np.unique(part[part < m.reached.size])
        assert (sign * det.ravel()[nodes] > 0.0).all()
    field = determinant_field(
        mesh, derivatives(m.states).inverse, derivatives(mesh.ends).inverse, "", "1"
    )
    corners, first = np.unique(field.triangles), m.reached.size + len(mesh.ends.vector)
    assert (corners >= first).sum() > 3
    assert (field.values[corners[corners >= first]] == 0.0).all()  # loci
    values = field.values[field.triangles]
    assert (values.min(axis=1) * values.max(axis=1) >= 0.0).all()  # no triangle across them
    assert np.abs(triangle_areas(triangle_corners(mesh, field.triangles))).sum() > 0.9 * whole


def test_states_at_the_rim_are_equilibria_by_another_integrator():
    """States at the rim, which charts use as well, are equilibria by another integrator."""
    (ends, _), _ = rim_and_mesh()
    assert len(ends.vector) > 20
    for i in range(0, len(ends.vector), 5):
        s = ends[i]
        # Runge-Kutta with 41 nodes: errors of 1e-6 for bent rods
        assert np.abs(residual(s.vector[:8, None], s.inputs, s.load)).max() < 1e-5
        assert np.abs(residual(s.vector[:8, None], s.inputs + 0.01, s.load)).max() > 1e-4
