"""Rods in space: another formulation, closed forms, other programs, conservation laws, limits."""

from functools import cache

import numpy as np
import pytest

from proofmass.analytic.remember import use_memory
from proofmass.analytic.rods import solve as planar_solve
from proofmass.analytic.rods import spatial_rod
from proofmass.analytic.rods.spatial_rod import solve
from tests.independent.rods.spatial import Sections, arc, extrapolated_tip, quadratic

XYZ = "xyz"
BEND_LENGTH = (
    100.0 * np.pi / 4
)  # length of the bend of Bathe and Bolourchi, 45 degrees of a radius of 100
UNLOADED_TIP = 100.0 * np.array(
    [np.sin(np.pi / 4), 1.0 - np.cos(np.pi / 4), 0.0]
)  # its tip without load
BEND_SECTION = {"axial": 1e7, "shear": 41.6667e5}
BEND_STIFFNESS = 8.333e5


@cache
def tip_of_bend(force: float, **others: float):
    """Tip (3,) of the bend of 45 degrees under a force along z."""
    rod = solve(
        BEND_LENGTH,
        length=BEND_LENGTH,
        stiffness=BEND_STIFFNESS,
        torsion=BEND_STIFFNESS,
        curvature=0.01,
        force_z=force,
        **others,
    )
    return stack_components(rod, "")


def stack_components(rod, prefix: str):
    """Three quantities x, y, z of a solution as one array, on its last axis."""
    return np.stack([rod[prefix + name] for name in XYZ], axis=-1)


def vector_parameters(what: str, values):
    """Three components by the names of the parameters of `solve`."""
    return {f"{what}_{name}": value for name, value in zip(XYZ, values, strict=True)}


FORCE, MOMENT = (1.5, -2.0, 2.5), (0.4, 0.3, -0.5)


@pytest.mark.parametrize(
    ("natural", "strains"),
    [
        ((0.0, 0.0, 0.0), (np.inf, np.inf)),
        ((0.0, 0.0, 0.0), (15.0, 9.0)),
        ((1.2, -0.7, 2.0), (np.inf, np.inf)),
        ((1.2, -0.7, 2.0), (15.0, 9.0)),
    ],
)
def test_a_formulation_by_strains_agrees(natural, strains):
    """The tip is that of a formulation by strains, to 1e-10.

    The rod has three different stiffnesses, all loads at its tip, and any natural shape.
    """
    length, stiffnesses = 1.1, (0.6, 0.9, 1.4)
    axial, shear = strains
    line = arc(length, natural)
    reference = extrapolated_tip(line, Sections(stiffnesses, (axial, shear, shear)), FORCE, MOMENT)
    rod = solve(
        length,
        length=length,
        **dict(zip(("torsion", "stiffness_y", "stiffness"), stiffnesses, strict=True)),
        axial=axial,
        shear=shear,
        **dict(zip(("twist", "curvature_y", "curvature"), natural, strict=True)),
        **vector_parameters("force", FORCE),
        **vector_parameters("moment", MOMENT),
    )
    # formulation by strains: order 5 after extrapolation, 2e-10 of order 4 in 200 steps times their
    # 0.02 rad; `solve`: order 8, 1e-12
    np.testing.assert_allclose(stack_components(rod, ""), reference, rtol=0, atol=1e-10)


@pytest.mark.parametrize(("twist", "curvature"), [(1.1, 2.5), (0.4, 3.3), (0.9, 2.9)])
def test_a_helix_under_a_wrench_along_its_axis_is_another_helix(twist, curvature):
    """A helix under a force and a moment along its axis is a helix (Love, sec. 270-272).

    They follow from the twist and the curvature of both helices.
    """
    bending, torsion, natural, turns = 1.3, 0.9, (0.6, 3.0), 2.0
    rate = np.hypot(curvature, twist)
    length, radius = turns * 2.0 * np.pi / rate, curvature / rate**2
    sine, cosine = twist / rate, curvature / rate
    axis, inwards = np.array([sine, 0.0, cosine]), np.array([0.0, 1.0, 0.0])
    about_tangent, about_binormal = (
        torsion * (twist - natural[0]),
        bending * (curvature - natural[1]),
    )
    pull = (about_tangent * cosine - about_binormal * sine) / radius * axis
    wrench = (about_tangent * sine + about_binormal * cosine) * axis
    s = np.linspace(0.0, length, 41)
    turned = rate * s[:, None]
    out = -np.cos(turned) * inwards - np.sin(turned) * np.cross(axis, inwards)
    exact = radius * (inwards + out) + twist / rate * s[:, None] * axis
    moment = wrench + np.cross(radius * inwards - exact[-1], pull)
    rod = solve(
        s,
        length=length,
        stiffness=bending,
        torsion=torsion,
        twist=natural[0],
        curvature=natural[1],
        **vector_parameters("force", pull),
        **vector_parameters("moment", moment),
    )
    np.testing.assert_allclose(stack_components(rod, ""), exact, rtol=0, atol=1e-12)
    np.testing.assert_allclose(rod["twist_moment"], about_tangent, rtol=0, atol=1e-12)
    np.testing.assert_allclose(rod["bend_moment"], about_binormal, rtol=0, atol=1e-12)
    np.testing.assert_allclose(rod["bend_moment_y"], 0.0, rtol=0, atol=1e-12)


def test_the_bend_of_45_degrees_agrees_with_printed_tips():
    """The tip of the bend agrees with printed values, within the errors of their eight elements.

    K.-J. Bathe and S. Bolourchi, Int. J. Numer. Methods Eng. 14 (1979) 961-986, print the
    displacement 23.5, 13.4, 53.4 of elements that shear.  J. C. Simo and L. Vu-Quoc, Comput.
    Methods Appl. Mech. Eng. 58 (1986) 79-116, print the position 15.79, 47.23, 53.37.
    """
    moved = tip_of_bend(600.0, **BEND_SECTION) - UNLOADED_TIP
    assert np.abs(moved - [-23.5, -13.4, 53.4]).max() < 0.25
    assert np.abs(tip_of_bend(600.0, **BEND_SECTION) - [47.23, 15.79, 53.37]).max() < 0.15
    assert np.abs(tip_of_bend(450.0, **BEND_SECTION) - [52.32, 18.62, 48.39]).max() < 0.15
    assert np.abs(tip_of_bend(300.0, **BEND_SECTION) - [58.84, 22.33, 40.08]).max() < 0.15


KYNEMA_DISPLACEMENT = [-23.6459716009048, -13.7208006040058, 53.5776450626989]
"""Tip displacement with 18 nodes, docs/sphinx/testing/curved.rst of github.com/kynema/kynema, whose
test has the same numbers for BeamDyn; here in axes in which the bend turns to the left."""


def test_two_programs_agree_to_ten_digits_on_another_line():
    """The formulation by strains finds the digits of two programs for their line, a parabola.

    The parabola goes through three points of the arc and differs from it by 3 degrees at the clamp.
    For the arc the formulation finds the digits of `solve`.
    """
    points = np.array([[0.0, 0.0], [38.2683, 7.61205], [70.7107, 29.2893]])
    at = points[:, 0] / points[2, 0]
    line = quadratic(points, at)
    slope = np.polynomial.Polynomial.fit(points[:, 0], points[:, 1], 2).deriv()(0.0)
    angle = np.arctan(slope)
    c, s = np.cos(angle), np.sin(angle)
    clamp = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    section = Sections((BEND_STIFFNESS,) * 3, (1e7, 41.6667e5, 41.6667e5))
    load = (0.0, 0.0, 600.0)
    moved = extrapolated_tip(line, section, load, begin=clamp) - np.append(points[2], 0.0)
    # order 5: 4e-9 of order 4, times the step of 0.005 rad; the programs print fourteen digits
    np.testing.assert_allclose(moved, KYNEMA_DISPLACEMENT, rtol=0, atol=5e-10)
    on_arc = extrapolated_tip(arc(BEND_LENGTH, (0.0, 0.0, 0.01)), section, load)
    np.testing.assert_allclose(tip_of_bend(600.0, **BEND_SECTION), on_arc, rtol=0, atol=5e-10)
    assert np.abs(on_arc - UNLOADED_TIP - KYNEMA_DISPLACEMENT).max() > 0.1
    assert angle == pytest.approx(np.radians(-3.15), abs=1e-4)


LOADS = {
    "force": {"force_x": -1.0, "force_y": 3.0},
    "moment": {"force_y": 1.0, "moment": 2.0},
    "weight": {"weight_x": 0.5, "weight_y": -4.0},
}


@pytest.mark.parametrize("load", LOADS)
@pytest.mark.parametrize("strains", [{}, {"axial": 30.0, "shear": 12.0}])
def test_a_rod_under_loads_in_its_plane_is_the_planar_rod(load, strains):
    """Under loads in its plane a rod is the planar rod.

    Torsion and the other bending stiffness have no effect there.
    """
    s = np.linspace(0.0, 1.2, 9)
    flat = planar_solve(s, length=1.2, stiffness=0.8, **strains, **LOADS[load])
    loads = dict(LOADS[load])
    if "moment" in loads:
        loads["moment_z"] = loads.pop("moment")
    rod = solve(s, length=1.2, stiffness=0.8, stiffness_y=50.0, torsion=70.0, **strains, **loads)
    for name, values in {
        "x": flat["x"],
        "y": flat["y"],
        "z": 0.0,
        "normal_x": np.cos(flat["theta"]),
        "normal_y": np.sin(flat["theta"]),
        "bend_moment": flat["m"],
        "bend_moment_y": 0.0,
        "twist_moment": 0.0,
        "force_x": flat["force_x"],
        "force_y": flat["force_y"],
    }.items():
        np.testing.assert_allclose(rod[name], values, rtol=0, atol=1e-11, err_msg=name)


def test_bending_to_either_side_is_the_planar_rod():
    """A load along z bends a rod about y as a load along y bends it about z, with another sign."""
    s = np.linspace(0.0, 1.0, 5)
    flat = planar_solve(s, stiffness=0.7, force_y=3.0)
    rod = solve(s, stiffness=50.0, stiffness_y=0.7, torsion=70.0, force_z=3.0)
    np.testing.assert_allclose(rod["z"], flat["y"], rtol=0, atol=1e-11)
    np.testing.assert_allclose(rod["bend_moment_y"], -flat["m"], rtol=0, atol=1e-11)


NATURAL = {"twist": 0.8, "curvature_y": -0.5, "curvature": 1.5}
STIFFNESSES = {"torsion": 0.6, "stiffness_y": 0.9, "stiffness": 1.4}


def test_force_and_energy_are_constant_along_a_rod():
    """The force and, for constant stiffnesses, n . v + m . (u + u0)/2 are constant along a rod."""
    s = np.linspace(0.0, 1.0, 21)
    rod = solve(
        s,
        **STIFFNESSES,
        **NATURAL,
        axial=12.0,
        shear=8.0,
        **vector_parameters("force", FORCE),
        **vector_parameters("moment", MOMENT),
    )
    n = stack_components(rod, "force_")
    np.testing.assert_allclose(n, np.tile(FORCE, (21, 1)), rtol=1e-15)
    local = np.stack([rod["twist_moment"], rod["bend_moment_y"], rod["bend_moment"]], axis=1)
    along = np.einsum("ij,ij->i", n, stack_components(rod, "normal_"))
    across = np.einsum("ij,ij->i", n, n) - along**2
    u0 = np.array(list(NATURAL.values()))
    bent = local**2 / np.array(list(STIFFNESSES.values())) / 2 + local * u0
    energy = bent.sum(axis=1) + along + along**2 / 24.0 + across / 16.0
    # errors of the steps: 1e-12 of the tip's position, times terms of up to 10
    assert np.ptp(energy) < 1e-10
    assert np.ptp(along) > 0.1


def test_a_moment_alone_is_constant_along_a_rod():
    """Without forces the moment keeps its size and direction, and only its parts change."""
    s = np.linspace(0.0, 1.0, 21)
    rod = solve(s, **STIFFNESSES, **NATURAL, **vector_parameters("moment", MOMENT))
    local = np.stack([rod["twist_moment"], rod["bend_moment_y"], rod["bend_moment"]], axis=1)
    # error of the steps: 1e-12 of the tip's position
    np.testing.assert_allclose(local[0], MOMENT, rtol=0, atol=1e-11)
    np.testing.assert_allclose(
        np.linalg.norm(local, axis=1), np.linalg.norm(MOMENT), rtol=0, atol=1e-11
    )
    along = stack_components(rod, "normal_") @ MOMENT
    np.testing.assert_allclose(rod["twist_moment"], along, rtol=0, atol=1e-11)
    assert (np.ptp(local, axis=0) > 0.1).all()


def test_a_moment_rotates_a_rod_of_equal_stiffnesses_about_itself():
    """With EI = GJ the sections rotate about M by |M|/EI per length; the rod is a helix about M."""
    s, stiffness = np.linspace(0.0, 1.2, 7), 0.8
    rod = solve(
        s, length=1.2, stiffness=stiffness, torsion=stiffness, **vector_parameters("moment", MOMENT)
    )
    rate = np.linalg.norm(MOMENT) / stiffness
    axis, ahead = np.array(MOMENT) / np.linalg.norm(MOMENT), np.array([1.0, 0.0, 0.0])
    along, turned = axis * axis[0], rate * s[:, None]
    exact = s[:, None] * along + np.sin(turned) / rate * (ahead - along)
    exact += (1.0 - np.cos(turned)) / rate * np.cross(axis, ahead)
    np.testing.assert_allclose(stack_components(rod, ""), exact, rtol=0, atol=1e-12)
    for name, part in zip(("twist_moment", "bend_moment_y", "bend_moment"), MOMENT, strict=True):
        np.testing.assert_allclose(rod[name], part, rtol=0, atol=1e-12, err_msg=name)


@pytest.mark.parametrize(
    ("length", "curvature", "force"),
    [(1.0, 0.0, 20.0), (1.0, 0.0, 60.0), (2.0, 5.0, 1.2)],
)
def test_twice_the_steps_move_the_tip_by_the_tolerance_only(length, curvature, force):
    """The steps of a result, and half of them, may be doubled; a quarter of them may not.

    The tip moves by less than 1e-12 L if a number of steps that suffices is doubled, and by more if
    a quarter of the steps of the result is doubled.
    """
    stiffnesses, strains, none = (1.0, 1.0, 1.0), (np.inf, np.inf), (0.0, 0.0, 0.0)
    given = length, stiffnesses, strains, (0.0, 0.0, curvature), (0.0, 0.0, force), none, none
    load = spatial_rod.spatial_load(*given)
    moment, steps = spatial_rod.find_clamp_moment(load, given)
    quarter, half, whole, twice = (
        spatial_rod.solve_from_guess(load, 1.0, moment, n)[1]
        for n in (steps // 4, steps // 2, steps, 2 * steps)
    )
    limit = 1e-12 * length
    # two tips with a rounding error of the steps each
    assert np.abs(twice - whole).max() < limit
    assert np.abs(whole - half).max() < 1.1 * limit
    assert np.abs(half - quarter).max() > limit


def test_moments_of_a_rod_with_weight_follow_from_the_part_beyond():
    """The clamp moment is M + (p(L) - p(0)) x F + int (p - p(0)) x w ds, by Gauss's quadrature."""
    nodes, weights = np.polynomial.legendre.leggauss(30)
    s = np.array([0.0, *(1.0 + nodes) / 2.0, 1.0])
    weight = (0.5, 1.0, -2.0)
    rod = solve(
        s,
        **STIFFNESSES,
        **NATURAL,
        **vector_parameters("force", FORCE),
        **vector_parameters("weight", weight),
    )
    place = stack_components(rod, "")
    arm = weights @ place[1:-1] / 2.0 - place[0]
    root = np.cross(place[-1] - place[0], FORCE) + np.cross(arm, weight)
    clamp = [rod[name][0] for name in ("twist_moment", "bend_moment_y", "bend_moment")]
    np.testing.assert_allclose(clamp, root, rtol=0, atol=1e-11)  # error of the steps
    np.testing.assert_allclose(
        stack_components(rod, "force_")[0], np.add(FORCE, weight), rtol=1e-15
    )


def test_a_round_rod_rotates_with_its_loads():
    """If the loads of a straight rod with equal bending stiffnesses rotate about it, it rotates."""
    turn = 0.7
    c, s = np.cos(turn), np.sin(turn)
    about = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
    loads = [np.array(FORCE), np.array(MOMENT)]
    rod, other = (
        solve(
            1.0,
            torsion=0.7,
            **vector_parameters("force", by @ loads[0]),
            **vector_parameters("moment", by @ loads[1]),
        )
        for by in (np.eye(3), about)
    )
    np.testing.assert_allclose(
        stack_components(other, ""), about @ stack_components(rod, ""), rtol=0, atol=1e-11
    )


def test_small_loads_twist_and_bend_as_in_textbooks():
    """Small loads twist a straight rod, and bend it and a quarter of a circle, as in textbooks."""
    small, length = 1e-6, 1.3
    rod = solve([0.0, length / 2, length], length=length, **STIFFNESSES, moment_x=small)
    np.testing.assert_allclose(rod["normal_x"], 1.0, rtol=0, atol=1e-14)
    np.testing.assert_allclose(rod["twist_moment"], small, rtol=1e-9)
    rod = solve(length, length=length, **STIFFNESSES, force_z=small)
    assert rod["z"] == pytest.approx(small * length**3 / 3.0 / 0.9, rel=1e-9, abs=0)
    quarter = {"length": np.pi / 2, "curvature": 1.0}
    rod, free = (
        solve(np.pi / 2, **quarter, stiffness=2.0, torsion=0.5, force_z=force)
        for force in (small, 0.0)
    )
    # Castigliano, a from the tip: arms sin(a) about the normal and 1 - cos(a) about the tangent
    bent, twisted = np.pi / 4, 3 * np.pi / 4 - 2.0
    assert rod["z"] - free["z"] == pytest.approx(
        small * (bent / 2.0 + twisted / 0.5), rel=1e-8, abs=0
    )


PRANDTL_FACTOR = 4.01259934  # twice the first root of Bessel's function J of order -1/4


@pytest.mark.parametrize(("share", "stands"), [(0.98, True), (1.02, False)])
@pytest.mark.parametrize("y", [False, True])
def test_a_deep_cantilever_buckles_at_prandtls_load(share, stands, y):
    """A deep cantilever is stable below Prandtl's load and refused as buckled above it.

    A. G. M. Michell and L. Prandtl 1899: F L^2 = 4.0126 sqrt(EI GJ) for a rod that is stiff in the
    plane of the load.  Here this stiffness is 1e5 times the other one: the rod bends little.
    """
    stiff = {"stiffness": 1e5, "stiffness_y": 1.0} if y else {"stiffness": 1.0, "stiffness_y": 1e5}
    load = {"force_y" if y else "force_z": share * PRANDTL_FACTOR * np.sqrt(0.7)}
    if stands:
        rod = solve(1.0, torsion=0.7, **stiff, **load)
        assert abs(rod["z" if y else "y"]) < 1e-9
    else:
        with pytest.raises(ValueError, match="buckle"):
            solve(1.0, torsion=0.7, **stiff, **load)


@pytest.mark.parametrize(("share", "stands"), [(0.98, True), (1.02, False), (2.0, False)])
@pytest.mark.parametrize("strains", [{}, {"axial": 1e6, "shear": 25.0}])
def test_a_column_of_equal_stiffnesses_buckles_at_eulers_load(share, stands, strains):
    """A column with equal bending stiffnesses is stable below Euler's load and refused above.

    It buckles in two planes at once, so that the determinant does not change its sign.  With shear
    the load is lower, by Engesser.
    """
    euler = np.pi**2 / 4
    critical = euler / (1.0 + euler / strains["shear"]) if strains else euler
    load = {"force_x": -share * critical}
    if stands:
        assert solve(1.0, torsion=0.7, **strains, **load)["y"] == 0.0
    else:
        with pytest.raises(ValueError, match="buckle"):
            solve(1.0, torsion=0.7, **strains, **load)


def test_a_column_buckles_at_greenhills_weight():
    """The critical weight is w L^3 = 7.8373 EI, A. G. Greenhill 1881."""
    solve(1.0, torsion=0.7, weight_x=-0.98 * 7.8373)
    with pytest.raises(ValueError, match="buckle"):
        solve(1.0, torsion=0.7, weight_x=-1.02 * 7.8373)


def test_a_rod_under_a_large_load_is_the_planar_rod():
    """A rod under a large load is the planar rod, rotated about x, to 1e-13."""
    rod, planar = solve(1.0, force_y=20.0, force_z=10.0), planar_solve(1.0, force_y=np.sqrt(500.0))
    for name, values in {"x": planar["x"], "y": planar["y"] * np.sqrt(0.8)}.items():
        np.testing.assert_allclose(rod[name], values, rtol=0, atol=1e-13)


@pytest.mark.slow
@pytest.mark.parametrize("force", [80.0, 150.0])
def test_a_rod_under_a_load_with_several_equilibria_is_the_planar_rod(force):
    """A rod under a force of many EI/L^2 is the planar rod, whose tip is in closed form.

    A step of the loads leads to another equilibrium, half a length away, which is unstable.
    """
    rod, planar = solve(1.0, force_z=force), planar_solve(1.0, force_y=force)
    # rounding errors grow by e^12 from the clamp to the tip at 150 EI/L^2
    assert [rod["x"], rod["z"]] == pytest.approx([planar["x"], planar["y"]], rel=0, abs=1e-11)


def test_the_share_of_the_loads_at_which_a_rod_buckles_is_named():
    """A column under twice Euler's load has its last stable equilibrium at half of its loads."""
    with pytest.raises(
        ValueError, match=r"no stable .* beyond 0\.(499|5|501) of its loads, .*buckle"
    ):
        solve(1.0, force_x=-(np.pi**2) / 2)


def test_an_unstable_equilibrium_is_refused_after_the_second_search(monkeypatch):
    """An equilibrium that only the whole loads show to be unstable is refused."""
    monkeypatch.setattr(spatial_rod, "negative_directions", lambda *given: len(given) == 3)
    with pytest.raises(ValueError, match=r"no stable equilibrium .* under its whole loads"):
        solve(1.0, force_z=1.0)


def test_a_rod_near_a_known_one_is_not_loaded_from_zero_again(monkeypatch):
    """A rod with a load changed by 1e-6 starts from its neighbour, and from zero if that fails."""
    bow = {"length": 1.1, "curvature": 0.5, "twist": 0.3, "torsion": 0.7, "axial": 80.0}
    force, memory = {"force_z": 1.2 * (1.0 + 1e-6), "force_x": 0.3}, {}
    fresh = solve([0.6, 1.1], **bow, **force)
    with use_memory(memory, store_results=True):
        solve(1.1, **bow, force_z=1.2, force_x=0.3)
    followed, work = spatial_rod.continue_from_zero, []
    monkeypatch.setattr(
        spatial_rod, "continue_from_zero", lambda *a: work.append(a) or followed(*a)
    )
    with use_memory(memory, store_results=False):
        near = solve([0.6, 1.1], **bow, **force)
        assert not work
        monkeypatch.setattr(
            spatial_rod, "cached_clamp_moment", lambda *_: (np.nan,) * 3
        )  # a guess that fails
        lost = solve([0.6, 1.1], **bow, **force)
        assert work
    for name, values in fresh.items():
        np.testing.assert_allclose(near[name], values, rtol=0, atol=1e-12)
        np.testing.assert_array_equal(lost[name], values)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"length": 0.0}, "length"),
        ({"torsion": -1.0}, "torsion"),
        ({"stiffness_y": 0.0}, "stiffness_y"),
        ({"stiffness": np.inf}, "stiffness"),
        ({"shear": 0.0}, "shear"),
        ({"curvature": np.nan}, "curvature"),
        ({"moment_y": np.inf}, "moment_y"),
        ({"weight_z": np.nan}, "weight_z"),
    ],
)
def test_a_parameter_out_of_its_domain_is_named(wrong, words):
    with pytest.raises(ValueError, match=words):
        solve(0.5, **{"length": 1.0, **wrong})


def test_a_rod_without_a_solution_is_not_called_too_sharply_bent():
    """A moment that winds it 159 times is beyond the steps with which its loads are increased."""
    with pytest.raises(ValueError, match="Newton's method finds no equilibrium of the rod"):
        solve(1.0, length=1.0, stiffness=1.0, torsion=1.0, moment_y=1e3)


def test_a_place_beyond_the_rod_is_refused():
    with pytest.raises(ValueError, match="s must lie within"):
        solve([0.5, 1.5])


def test_a_rod_at_other_samples_is_not_solved_again(monkeypatch):
    """Runs with other samples of a rod share the moment at its clamp."""
    loads = {"force_z": 0.37, "moment_x": 0.11}
    tip = solve(1.0, **loads)
    monkeypatch.setattr(spatial_rod, "solve_from_guess", None)
    assert solve([0.5, 1.0], **loads)["z"][1] == pytest.approx(float(tip["z"]), abs=1e-12)
