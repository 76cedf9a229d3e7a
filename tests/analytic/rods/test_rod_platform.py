"""Three rods on a platform: Table 8, annex II.4, shooting, virtual work, and symmetry."""

import json
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import root

from proofmass.analytic.numerics import TURN
from proofmass.analytic.remember import use_memory
from proofmass.analytic.rods import rod_platform, rod_platform_driven
from proofmass.analytic.rods.assembly import is_mirrored, triangle
from proofmass.analytic.rods.rod_platform import PlatformProblem, equilibrium_of_mode
from tests.analytic.rods.rod_assembly_cases import CORNERS, DATA, EI, three_rod_platform
from tests.independent.rods.chain_assembly import settle

ANNEX = json.loads((Path(__file__).parents[2] / "data" / "rod_platform.json").read_text())
TABLE8 = DATA["rfr3"]
MOTORS8 = tuple(np.radians(TABLE8["inputs_deg"]).tolist())
RFR3 = {
    "side": TABLE8["side"],
    "force_y": 0.5,
    "stiffness": EI,
    "theta1": MOTORS8[0],
    "theta2": MOTORS8[1],
    "theta3": MOTORS8[2],
}
TURNS = np.radians(ANNEX["angle_deg"])
GUIDED = {"stiffness": EI} | {
    f"{key}{k}": turn for key in ("theta", "guide") for k, turn in enumerate(TURNS, 1)
}
PFR3 = {"side": ANNEX["side"], "force_x": 0.3, "force_y": -0.2, **GUIDED}
ENDS = np.array([0.0, 1.0])


def solve_at_inputs(slides, **parameters):
    """Quantities at one triple of inputs, as numbers by name."""
    found = rod_platform_driven.solve(np.asarray(slides, float), **parameters)
    return {name: float(value) for name, value in found.items()}


def table_8_state(load=(0.0, 0.5, 0.0), mode=1, motors=MOTORS8):
    """An equilibrium of the mechanism of Table 8; mode 1 has the least potential."""
    return equilibrium_of_mode(
        PlatformProblem(TABLE8["side"], 1.0, 1.0, EI, motors, None, (0.0,) * 3, load, 1), mode
    )


@pytest.mark.parametrize(("mode", "row"), [(2, 0), (1, 1)])
def test_solutions_of_table_8_are_the_two_lowest_equilibria(mode, row):
    """The two solutions of Table 8 are the two lowest stable equilibria.

    Rods lead from the clamps to the pins and have no moment there.
    """
    wanted = TABLE8["recomputed"][row]
    found = rod_platform.solve(ENDS, **RFR3, mode=mode)
    assert [found["x"][0], found["y"][0]] == pytest.approx(wanted["pose"], abs=1e-8)  # digits
    assert np.degrees(found["phi"][0]) == pytest.approx(wanted["phi_deg"], abs=1e-6)
    assert found["energy"][0] == pytest.approx(wanted["energy"], abs=1e-8)
    holds = [-found[f"hold{k}"][0] for k in (1, 2, 3)]
    assert holds == pytest.approx(wanted["moment"], abs=1e-8)
    arms = triangle(0.2) @ [1.0, 1.0j] * np.exp(1j * found["phi"][0])
    for k, (arm, clamp) in enumerate(zip(arms, CORNERS, strict=True), 1):
        pin = found["x"][0] + 1j * found["y"][0] + arm
        assert abs(found[f"x{k}"][1] + 1j * found[f"y{k}"][1] - pin) <= 1e-10
        assert [found[f"x{k}"][0], found[f"y{k}"][0]] == pytest.approx(clamp, abs=1e-15)
        assert [found[f"t{k}"][0], found[f"m{k}"][0]] == pytest.approx(
            [MOTORS8[k - 1], -found[f"hold{k}"][0]], abs=1e-12
        )
        assert abs(found[f"m{k}"][1]) <= 1e-10


def test_other_stable_equilibria_have_a_looped_rod():
    """Modes 3 to 5, which the table does not have, are stable and each have one looped rod.

    Chains that are seeded with their shapes are stable at the same poses.
    """
    for mode in (1, 2, 3, 4, 5):
        s = table_8_state(mode=mode)
        tips = s.shape([0.0, 1.0])[2]
        looped = np.abs(tips[:, 1] - tips[:, 0]) > np.radians(300.0)
        assert looped.sum() == (mode > 2)
        shapes = [lambda arc, k=k, s=s: s.shape(np.atleast_1d(arc))[2][k] for k in range(3)]
        # the bend of a loop is 1/13 of the length, so a chain needs 40 links at least
        chains = settle(
            three_rod_platform(0.2), MOTORS8, seed=shapes, segments=80, force=(0.0, 0.5)
        )
        assert chains.curvatures[0] > 0.0
        np.testing.assert_allclose(chains.pose, s.pose, atol=6e-3)  # h^2 of that bend
    with pytest.raises(ValueError, match=r"mode 6 is not there; .*; 2 at \(0.0165, 0.0206\) m"):
        table_8_state(mode=6)


@pytest.mark.parametrize("load", [(0.0, 0.5, 0.0), (0.2, 0.1, 0.03)])
def test_shooting_finds_the_same_equilibria(load):
    """Shooting by DOP853, with twelve unknowns and a guess of two digits, finds the same state."""
    s = table_8_state(load, mode=2)

    def residual(z):
        x, y, phi = z[9:]
        arms = triangle(0.2) @ [1.0, 1.0j] * np.exp(1j * phi)
        rows, pull, turn = [], -np.array(load[:2]), -load[2]
        for k, motor in enumerate(MOTORS8):
            moment, *n = z[3 * k : 3 * k + 3]
            end = solve_ivp(
                lambda _, u, n=n: [
                    np.cos(u[2]),
                    np.sin(u[2]),
                    u[3] / EI,
                    n[0] * np.sin(u[2]) - n[1] * np.cos(u[2]),
                ],
                (0.0, 1.0),
                [*CORNERS[k], motor, moment],
                method="DOP853",
                rtol=1e-11,
                atol=1e-12,
            ).y[:, -1]
            rows += [end[0] - x - arms[k].real, end[1] - y - arms[k].imag, end[3]]
            pull, turn = pull + n, turn + arms[k].real * n[1] - arms[k].imag * n[0]
        return [*rows, *pull, turn]

    guess = [float(f"{value:.2g}") for value in s.vector[:12]]
    found = root(residual, guess, tol=1e-12)
    assert np.abs(found.x - guess).max() > 1e-3
    np.testing.assert_allclose(found.x, s.vector[:12], rtol=0, atol=1e-9)  # rods: 1e-11


def test_the_misprinted_angle_is_another_mechanism():
    """With theta2 = 0, as printed, no stable equilibrium is within 0.05 m of those of Table 8."""
    motors = tuple(np.radians([45.0, TABLE8["inputs2_misprint_deg"], -60.0]))
    there = rod_platform.stable_equilibria(
        PlatformProblem(0.2, 1.0, 1.0, EI, motors, None, (0.0,) * 3, (0.0, 0.5, 0.0), 1)
    ).pose
    for row in TABLE8["recomputed"]:
        assert np.hypot(*(there[:, :2] - row["pose"]).T).min() > 0.05


def test_the_mechanism_of_the_annex_has_three_equilibria():
    """The mechanism of the annex has three equilibria, those recomputed, and no fourth one.

    They are the roots of the program's residual that are not mirror images.
    """
    a = three_rod_platform(ANNEX["side"])
    pins = [row["pins"] for row in DATA["pfr3_closures"]["pins"]]
    assert is_mirrored(a, pins).tolist() == [
        row["mirrored"] for row in DATA["pfr3_closures"]["pins"]
    ]
    for mode, row in enumerate(ANNEX["equilibria"], 1):
        found = solve_at_inputs([ANNEX["slide"]] * 3, **PFR3, mode=mode)
        assert [found["x"], found["y"]] == pytest.approx(row["pose"], abs=5.1e-6)  # digits
        assert np.degrees(found["phi"]) == pytest.approx(row["phi_deg"], abs=5.1e-4)
        assert found["energy"] == pytest.approx(row["energy"], abs=5.1e-6)
        arms = triangle(ANNEX["side"]) @ [1.0, 1.0j] * np.exp(1j * found["phi"])
        found_pins = np.stack([found["x"] + arms.real, found["y"] + arms.imag], axis=-1)
        near = np.abs(np.array(pins) - found_pins).max(axis=(1, 2))
        assert near.min() < 2e-6
        assert not DATA["pfr3_closures"]["pins"][near.argmin()]["mirrored"]
    with pytest.raises(ValueError, match="mode 4 is not there"):
        solve_at_inputs([ANNEX["slide"]] * 3, **PFR3, mode=4)


@pytest.mark.parametrize("row", DATA["pfr3"]["recomputed"], ids=["rigid ends", "none"])
@pytest.mark.slow
def test_start_pose_of_the_program(row):
    """At the recomputed slides the unloaded platform is at 60 degrees, with no force on the drives.

    Each rod's force is across its guide.
    """
    side = np.sqrt(3.0) * DATA["pfr3"]["circumradius"]
    found = solve_at_inputs(
        [row["slide"]] * 3, side=side, **GUIDED, rigid_extension=row["rigid_extension"]
    )
    assert np.degrees(found["phi"]) == pytest.approx(60.0, abs=5e-5)  # slide: 5e-8 m over 0.3 m
    holds = np.array([found[f"hold{k}"] for k in (1, 2, 3)])
    assert np.abs(holds).max() <= 2e-8  # 5e-8 m times 0.1 N/m
    assert np.ptp(holds) <= 1e-12
    assert abs(found["x"]) + abs(found["y"]) <= 1e-12


@pytest.mark.parametrize("row", DATA["pfr3_symmetric"]["recomputed"])
def test_symmetric_platform_without_load(row):
    """An unloaded symmetric platform has the recomputed angle, energy and forces along guides."""
    found = solve_at_inputs([0.0] * 3, side=0.5, **GUIDED, mode=1 if row["phi_deg"] > 0 else 2)
    assert np.degrees(found["phi"]) == pytest.approx(row["phi_deg"], abs=1e-5)  # five decimals
    assert found["energy"] == pytest.approx(row["energy"], abs=1e-7)
    assert abs(found["x"]) + abs(found["y"]) <= 1e-12
    along = (
        np.cos(TURNS) * np.array(row["force"])[:, 0] + np.sin(TURNS) * np.array(row["force"])[:, 1]
    )
    assert [found[f"hold{k}"] for k in (1, 2, 3)] == pytest.approx(-along, abs=1e-6)


def test_rotated_load_and_slides_rotate_the_pose():
    """With load and slides rotated by 120 degrees the pose is rotated and the drives exchanged."""
    path, third = np.linspace([0.1] * 3, [0.2, 0.05, -0.1], 3).T, np.exp(2j * np.pi / 3)
    load = (0.3 - 0.2j) * third
    one = rod_platform_driven.solve(path, **PFR3)
    two = rod_platform_driven.solve(
        np.roll(path, 1, axis=0), **PFR3 | {"force_x": load.real, "force_y": load.imag}
    )
    np.testing.assert_allclose(
        two["x"] + 1j * two["y"], (one["x"] + 1j * one["y"]) * third, rtol=0, atol=1e-11
    )
    np.testing.assert_allclose(two["phi"], one["phi"], rtol=0, atol=1e-11)
    for k in (1, 2, 3):
        np.testing.assert_allclose(two[f"hold{k % 3 + 1}"], one[f"hold{k}"], rtol=0, atol=1e-11)


DRIVEN = {
    "guides": ({**PFR3, "mode": 2}, [0.1, 0.1, 0.1], [0.5, 0.2, 0.3]),
    "rigid ends": ({**PFR3, "rigid_extension": 0.1}, [0.1, 0.1, 0.1], [0.3, 0.2, 0.1]),
    "motors": ({**RFR3, "mode": 2}, [0.0, 0.0, 0.0], [0.3, -0.2, 0.1]),
}


@pytest.mark.parametrize(("parameters", "first", "last"), DRIVEN.values(), ids=DRIVEN)
def test_rates_and_virtual_work(parameters, first, last):
    """Rates are derivatives of the pose, and the holding moments do the work of the potential.

    A moment on the platform grows along the path, and the potential changes with it as well.
    """
    h, change, growth = 1e-4, np.subtract(last, first), np.full(5, 0.03)
    share = np.array([0.0, 0.3 - h, 0.3, 0.3 + h, 1.0])
    path = np.asarray(first)[:, None] + change[:, None] * share
    load = {"moment": growth * share, "load_rates": {"moment": growth}}
    found = rod_platform_driven.solve(path, change[:, None], **parameters | load)
    force = [parameters.get("force_x", 0.0), parameters["force_y"], load["moment"]]
    potential = found["energy"] - sum(
        f * found[name] for f, name in zip(force, ("x", "y", "phi"), strict=True)
    )
    work_rate = (
        sum(found[f"hold{k}"][2] * change[k - 1] for k in (1, 2, 3)) - 0.03 * found["phi"][2]
    )
    # h^2 times third derivatives of up to 20, and 1e-11 of the rods over h
    for name in ("x", "y", "phi"):
        slope = (found[name][3] - found[name][1]) / (2 * h)
        assert found[f"{name}_rate"][2] == pytest.approx(slope, abs=5e-7)
    assert work_rate == pytest.approx((potential[3] - potential[1]) / (2 * h), abs=5e-7)
    assert np.ptp(found["phi"]) > 0.05


def test_the_end_of_a_path_is_the_equilibrium_found_there():
    """The last equilibrium of a path is the lowest one that is found at its end alone.

    Along the path the slides return to the symmetric platform and the load falls to zero.
    """
    share = np.linspace(1.0, 0.0, 5)
    load = {"force_x": 0.3 * share, "force_y": -0.2 * share}
    found = rod_platform_driven.solve(np.outer([ANNEX["slide"]] * 3, share), **PFR3 | load)
    there = solve_at_inputs([0.0] * 3, side=ANNEX["side"], **GUIDED)
    assert np.ptp(found["phi"]) > 0.3
    for name in ("x", "y", "phi", "energy", "hold1", "hold2", "hold3"):
        assert found[name][-1] == pytest.approx(there[name], abs=1e-10)


def test_a_path_ends_at_its_fold():
    """As slider 1 is drawn out, the path ends where the slide is largest over the platform's angle.

    Next to the fold the slide is a smooth function of the angle, and its polynomial through the
    last samples has its top between the last sample and the first one beyond, which is NaN.  The
    rate of the angle is the inverse of its slope, so it grows without bound.
    """
    start, ahead, rates = 0.1, 1.5, np.array([[1.0], [0.0], [0.0]])
    for samples in (31, 17, 41):  # each path is of the gap in which the one before ended
        slide = np.append(np.linspace(0.1, start, 5)[:-1], np.linspace(start, ahead, samples))
        path = np.stack([slide, np.full(slide.size, 0.1), np.full(slide.size, 0.1)])
        found = rod_platform_driven.solve(path, rates, **PFR3)
        there = np.isfinite(found["x"])
        count = int(there.sum())
        assert there.tolist() == [True] * count + [False] * (slide.size - count)
        assert 4 < count < slide.size
        for name, curve in found.items():
            np.testing.assert_array_equal(np.isfinite(curve), there, err_msg=name)
        start, ahead = slide[count - 1], slide[count]
    last = slice(count - 8, count)
    fit = np.polynomial.Polynomial.fit(found["phi"][last], slide[last], 4)
    tops = fit.deriv().roots()
    top = tops[np.abs(tops - found["phi"][count - 1]).argmin()]
    assert fit.deriv(2)(top.real) < 0.0
    assert top.imag == 0.0
    assert start <= fit(top.real) <= ahead
    # the next power of the polynomial changes the slope at the ends of its samples most
    np.testing.assert_allclose(
        found["phi_rate"][last][2:] * fit.deriv()(found["phi"][last][2:]), 1.0, rtol=1e-3
    )
    assert abs(found["phi_rate"][count - 1]) > 50.0  # about 1 at the beginning of the path


THIRDS = np.array([0.0, TURN / 3.0, -TURN / 3.0])
INWARDS = np.pi / 6.0 + THIRDS
NO_INPUTS, NO_LOAD = (0.0,) * 3, (0.0,) * 3
SYMMETRIC = {
    # rod 3 is on the axis of symmetry and pushed along it by a growing load
    "mirrored": (
        PlatformProblem(
            0.2, 1.1, 1.0, 1.0, (1.1, np.pi - 1.1, -np.pi / 2.0), None, NO_INPUTS, NO_LOAD, 1
        ),
        np.zeros((4, 3)),
        np.outer([10.0, 20.0, 25.0, 60.0], [0.0, 1.0, 0.0]),
    ),
    # three rods are pushed inwards along their guides
    "three-fold": (
        PlatformProblem(
            0.3, 1.0, 1.0, 1.0, tuple(INWARDS + 0.8), tuple(INWARDS), NO_INPUTS, NO_LOAD, 1
        ),
        np.outer([0.2, 0.55, 0.65, 0.75], np.ones(3)),
        np.zeros((4, 3)),
    ),
}


@pytest.mark.parametrize(("problem", "inputs", "load"), SYMMETRIC.values(), ids=SYMMETRIC)
def test_a_path_of_a_symmetric_platform_ends_where_it_becomes_unstable(problem, inputs, load):
    """A path that does not fold is NaN from the first sample on at which chains are unstable.

    A mirrored platform becomes unstable in one direction, a three-fold one in two at once.
    """
    angles = {f"theta{k}": angle for k, angle in enumerate(problem.theta, 1)}
    angles |= {f"guide{k}": angle for k, angle in enumerate(problem.guide or (), 1)}
    loads = dict(zip(("force_x", "force_y", "moment"), load.T, strict=True))
    found = rod_platform_driven.solve(
        inputs.T, side=problem.side, radius=problem.radius, **angles, **loads
    )
    assert np.isfinite(found["x"]).tolist() == [True, True, False, False]
    first = problem._replace(inputs=tuple(inputs[0]), load=tuple(load[0]))
    seed, stable = equilibrium_of_mode(first, 1).shape((np.arange(20) + 0.5) / 20)[2], []
    for sample in range(3):
        before = max(sample - 1, 0)
        for share in np.linspace(0.0, 1.0, 6):
            chains = settle(
                first.assembly,
                inputs[before] + share * (inputs[sample] - inputs[before]),
                seed=seed,
                force=(load[before] + share * (load[sample] - load[before]))[:2],
            )
            seed = chains.angle
        stable.append(bool(chains.curvatures[0] > 0.0))
        if stable[-1]:
            # h^2 of chains of 20 links, by which they differ from rods
            assert chains.pose[:2] == pytest.approx(
                [found["x"][sample], found["y"][sample]], abs=5e-3
            )
    assert stable == [True, True, False]


def test_rates_of_a_platform_with_a_straight_rod():
    """Rates under a growing moment are differences of poses, also where rod 3 is straight."""
    problem, h = SYMMETRIC["mirrored"][0], 1e-4
    found = rod_platform_driven.solve(
        np.zeros((3, 3)),
        0.0,
        side=problem.side,
        radius=problem.radius,
        **{f"theta{k}": angle for k, angle in enumerate(problem.theta, 1)},
        force_y=10.0,
        moment=np.array([0.0, -h, h]),
        load_rates={"moment": np.ones(3)},
    )
    for name, size in {"x": 7e-3, "y": 0.0, "phi": 0.6}.items():
        slope = (found[name][2] - found[name][1]) / (2 * h)
        # the error of the poses, 1e-11, over h
        assert found[f"{name}_rate"][0] == pytest.approx(slope, abs=1e-6)
        assert abs(slope) == pytest.approx(size, rel=0.1, abs=1e-6)


def test_neighbours_share_a_search(monkeypatch):
    """A parameter changed by 1e-6 uses the search of its neighbour, and has its own equilibrium.

    Differences over 1e-6 and 9e-6 give the same derivative.
    """
    calls = []
    search = partial(rod_platform.solutions, poses=300)  # enough to find mode 1
    monkeypatch.setattr(
        rod_platform, "solutions", lambda *a, **k: calls.append(a) or search(*a, **k)
    )
    numbers = RFR3 | {"radius": 1.01}
    memory = {}
    with use_memory(memory, store_results=True):
        rod_platform.solve(ENDS, **numbers)
    with use_memory(memory, store_results=False):
        up, down, wide, narrow = (
            rod_platform.solve(ENDS, **numbers | {"radius": 1.01 + h})
            for h in (1e-6, -1e-6, 9e-6, -9e-6)
        )
    assert len(calls) == 1
    for name in ("x", "phi", "hold2"):
        fine, coarse = (up[name] - down[name])[0] / 2e-6, (wide[name] - narrow[name])[0] / 18e-6
        assert abs(fine) > 1e-3
        assert fine == pytest.approx(coarse, rel=1e-4)  # 1e-11 of the rods over 1e-6


@pytest.mark.parametrize(
    ("wrong", "word"),
    [
        ({"side": -0.2}, "side must be positive"),
        ({"radius": 0.0}, "radius must be a positive finite length"),
        ({"stiffness": 0.0}, "stiffness must be finite and above 0"),
        ({"length": 0.5}, "clamps 1 and 2 are 1.73205 m apart, and their rods reach 1.2 m"),
        ({"inflections": 0}, "inflections must be a whole number from 1 on"),
        ({"mode": 1.5}, "mode 1.5 is not there"),
        ({"force_y": np.inf}, "force_y must be finite"),
    ],
)
def test_invalid_parameters_of_the_creep_are_refused(wrong, word):
    with pytest.raises(ValueError, match=word):
        rod_platform.solve(ENDS, **RFR3 | wrong)


def test_arc_lengths_beyond_the_rods_are_refused():
    with pytest.raises(ValueError, match=r"s must lie within \[0, .*\] \[m\], got 5.0"):
        rod_platform.solve(5.0, **RFR3)


def test_bad_drives():
    with pytest.raises(ValueError, match="guide1, guide2, guide3 must be given together"):
        solve_at_inputs([0.1] * 3, side=0.5, guide1=0.0)
    with pytest.raises(ValueError, match=r"inputs must be those of three rods, \(3, ...\), got"):
        rod_platform_driven.solve(np.zeros((2, 5)), side=0.5)
    with pytest.raises(ValueError, match="there are: none"):
        solve_at_inputs([0.1] * 3, **PFR3 | {"force_x": 100.0})
