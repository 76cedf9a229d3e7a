"""Flexible mechanisms: printed tables, elliptic integrals, finite differences and virtual work."""

import numpy as np
import pytest

from proofmass.analytic.rods.assembly import assembly, is_mirrored, triangle
from proofmass.analytic.rods.equilibrium import (
    RodState,
    closure,
    derivatives,
    residual_and_state_sizes,
    solve_direct,
    solve_inverse,
    state,
)
from tests.analytic.rods.rod_assembly_cases import (
    CORNERS,
    DATA,
    EI,
    PAIR,
    TABLE_7_NAMES,
    rods_by_elliptic_integrals,
    table_7_state,
    three_rod_platform,
    xy,
)

TABLE7, TABLE8 = DATA["rfr2"], DATA["rfr3"]
MOTORS8 = np.radians(TABLE8["inputs_deg"])


def rods_of_table_7(row, clamp=TABLE7["clamp"]):
    """Tips, forces and clamp moments from the digits of a solution of Table 7."""
    return rods_by_elliptic_integrals(
        [row["psi1_rad"], row["psi2_rad"]],
        [row["kr1"], row["kr2"]],
        clamp,
        np.radians(TABLE7["inputs_deg"]),
    )


def rods_of_table_8(row, motors=MOTORS8):
    """Tips, forces and clamp moments from the digits of a solution of Table 8."""
    return rods_by_elliptic_integrals(row["psi"], row["kr"], CORNERS, motors)


def platform_angle(pins):
    """Angle of the platform's first side."""
    return np.angle(pins[1] - pins[0])


@pytest.mark.parametrize("guide", [None, [0.3, 2.0, -2.2]])
def test_exact_derivatives_against_differences(guide):
    """The Jacobian of the closure equations is that of central differences at a random state."""
    rng = np.random.default_rng(1)
    a = three_rod_platform(
        0.3, angle=[0.1, 2.2, -1.9], guide=guide, rigid_extension=[0.0, 0.1, 0.2]
    )
    s = RodState(a, rng.normal(0.0, 0.1, 18))
    jacobian, h = closure(s)[1], 1e-5
    up, down = (closure(RodState(a, s.vector + sign * h * np.eye(18)))[0] for sign in (1, -1))
    # h^2 f'''/6 with f''' up to 1e3 m/(N m)^3, since EI is 0.05 N m^2
    assert np.abs(jacobian - (up - down).T / (2 * h)).max() <= 1e-6


@pytest.mark.parametrize("which", [0, 1])
def test_printed_digits_of_table_7_satisfy_closure_and_balance(which):
    """The tips of the printed digits are at one pin and their forces add up to +F."""
    row = TABLE7["printed"][which]
    tip, force, moment = rods_of_table_7(row)
    assert abs(tip[0] - tip[1]) <= 2e-5  # six decimals of psi and k_rel, times 5 m
    assert np.abs(xy(force.sum()) - TABLE7["load"]).max() <= 2e-5  # N; eq. 104 has the wrong sign
    s = state(
        PAIR,
        inputs=np.radians(TABLE7["inputs_deg"]),
        pose=xy(tip.mean()),
        load=TABLE7["load"],
        moment=moment,
        force=xy(force),
    )
    assert np.abs(closure(s)[0]).max() <= 2e-5  # the same errors, by shooting
    wanted = TABLE7["recomputed"][TABLE_7_NAMES[which]]
    found = solve_direct(s)
    assert np.abs(found.pose - wanted["pose"]).max() <= 1e-9  # the data have ten digits
    assert found.energy.sum() == pytest.approx(wanted["energy"], abs=1e-7)


def test_misprinted_motor_2_of_table_7_violates_the_closure():
    """With motor 2 at (0, 0.3) m, as printed in the text, the tips are 0.424 m apart.

    The program and the digits of the table have motor 2 at (0.3, 0) m.
    """
    clamp = [TABLE7["clamp"][0], TABLE7["clamp2_misprint"]]
    tip, *_ = rods_of_table_7(TABLE7["printed"][0], clamp)
    assert abs(tip[0] - tip[1]) == pytest.approx(0.3 * np.sqrt(2), abs=1e-5)


@pytest.mark.parametrize("name", TABLE_7_NAMES)
def test_derivatives_of_table_7_are_the_recomputed_ones(name):
    """Jacobians, stiffness and determinants are the recomputed ones of four stable equilibria.

    The direct and the inverse Jacobian are inverse matrices, and the stiffness is symmetric.
    """
    s, row = table_7_state(name), TABLE7["recomputed"][name]
    found = derivatives(s)
    for key in ("direct", "inverse", "stiffness", "direct_determinant", "inverse_determinant"):
        # recomputed by central differences of RK4 shooting with 400 steps, which have seven digits
        assert getattr(found, key) == pytest.approx(np.array(row[key]), rel=1e-5, abs=2e-6)
    assert np.linalg.det(found.direct) == pytest.approx(
        -found.inverse_determinant / found.direct_determinant, rel=1e-10
    )  # rounding
    assert np.abs(found.direct @ found.inverse - np.eye(2)).max() <= 1e-10
    assert np.abs(found.stiffness - found.stiffness.T).max() <= 1e-11  # symplectic steps: rounding
    assert np.linalg.eigvalsh(found.stiffness).min() > 0.0  # all four are stable


@pytest.mark.parametrize("name", TABLE_7_NAMES)
def test_jacobians_are_slopes_of_solutions(name):
    """Central differences of direct and inverse solutions are the Jacobians at the solution."""
    s, h = table_7_state(name), 5e-5
    found = derivatives(s)
    turned = solve_direct(
        s.with_parts(inputs=s.inputs + h * np.array([[1, 0], [0, 1], [-1, 0], [0, -1]]))
    )
    moved = solve_inverse(
        s.with_parts(pose=s.pose + h * np.array([[1, 0], [0, 1], [-1, 0], [0, -1]]))
    )
    # h^2/6 times third derivatives up to 2e5 near the stretched rods of S4; errors of rods over h
    assert (turned.pose[:2] - turned.pose[2:]).T / (2 * h) == pytest.approx(found.direct, abs=2e-5)
    assert (moved.inputs[:2] - moved.inputs[2:]).T / (2 * h) == pytest.approx(
        found.inverse, abs=2e-4
    )


def test_the_determinant_of_three_rods_is_the_positive_ratio():
    """det(dP/dq) is the ratio of both determinants, with a plus sign for three rods.

    The order of the unknowns in eq. 111 is an odd permutation as well, which makes it positive.
    """
    for s in table_8_states():
        found = derivatives(s)
        assert np.linalg.det(found.direct) == pytest.approx(
            found.inverse_determinant / found.direct_determinant, rel=1e-9, abs=0
        )
        assert np.abs(found.stiffness - found.stiffness.T).max() <= 1e-11
        assert found.direct_determinant == pytest.approx(
            np.prod(found.rod_determinants) * np.linalg.det(found.stiffness), rel=1e-9
        )


@pytest.mark.parametrize("name", TABLE_7_NAMES)
def test_work_of_the_load_is_stored_in_the_rods(name):
    """U grows by the integral of t F K^-1 F dt as the load t F grows from t = 0.6 to 1.

    With the sign of F in eq. 104 the energy would decrease.
    """
    full = table_7_state(name)
    load, (nodes, weights) = full.load, np.polynomial.legendre.leggauss(12)
    share = 0.8 + 0.2 * nodes  # from 0.6 to 1 of the load
    states = solve_direct(full.with_parts(load=np.outer([*share, 0.6], load)))
    along = np.linalg.solve(derivatives(states).stiffness[:-1], np.tile(load[:, None], (12, 1, 1)))
    work = 0.2 * weights @ (share * (load @ along)[:, 0])
    stored = full.energy.sum() - states.energy[-1].sum()
    assert stored == pytest.approx(work, abs=1e-9)  # J; 1e-11 of energies of 1 J


@pytest.mark.parametrize("name", TABLE_7_NAMES)
def test_energy_and_moments_along_the_rods(name):
    """The energy is the integral of m^2/(2 EI); the moment is zero at the pin.

    The clamp moment is that of the tip force about the clamp.
    """
    s = table_7_state(name)
    nodes, weights = np.polynomial.legendre.leggauss(40)
    x, y, _, m = s.shape(0.5 * (nodes + 1.0))
    assert (m**2 @ weights / (4 * EI)) == pytest.approx(s.energy, abs=1e-9)
    x, y, _, m = s.shape([0.0, 1.0])
    assert np.abs(m[:, 1]).max() <= 1e-10  # at the pin
    assert np.abs(x[:, 1] - s.pose[0]).max() <= 1e-10
    lever = (x[:, 1] - x[:, 0]) * s.force[:, 1] - (y[:, 1] - y[:, 0]) * s.force[:, 0]
    assert lever == pytest.approx(s.moment, abs=1e-9)


def test_a_symmetric_pair_without_load_has_its_pin_in_the_middle():
    """A symmetric pair without load has its pin on the y axis, at the recomputed positions."""
    for row in DATA["symmetric"]["recomputed"]:
        first, m = np.array(row["force1"]), row["moment1"]
        s = solve_direct(
            state(
                PAIR,
                inputs=np.radians(DATA["symmetric"]["inputs_deg"]),
                pose=[0.01, row["y"]],
                moment=[m, -m],
                force=[first, -first],
            )
        )
        assert abs(s.pose[0]) <= 1e-9
        assert s.pose[1] == pytest.approx(row["y"], abs=1e-6)  # six decimals
        assert s.energy.sum() == pytest.approx(row["energy"], abs=1e-6)
        assert s.moment[0] == pytest.approx(-s.moment[1], abs=1e-9)
        assert s.moment[0] == pytest.approx(m, abs=1e-6)


def table_8_states():
    """The two solutions of Table 8, solved from the printed digits."""
    states = []
    for row in TABLE8["printed"]:
        tip, force, moment = rods_of_table_8(row)
        guess = state(
            three_rod_platform(TABLE8["side"]),
            inputs=MOTORS8,
            load=TABLE8["load"],
            moment=moment,
            pose=[*xy(tip.mean()), platform_angle(tip)],
            force=xy(force),
        )
        states.append(solve_direct(guess))
    return states


@pytest.mark.parametrize("which", [0, 1])
def test_printed_digits_of_table_8_lead_to_its_recomputed_solutions(which):
    """The printed digits have the sides of the platform, and lead to the recomputed solutions."""
    row = TABLE8["printed"][which]
    tip, force, _ = rods_of_table_8(row)
    assert np.abs(np.abs(tip - np.roll(tip, 1)) - TABLE8["side"]).max() <= 2e-4  # four decimals
    assert np.abs(xy(force.sum()) - TABLE8["load"][:2]).max() <= 2e-4
    found, wanted = table_8_states()[which], TABLE8["recomputed"][which]
    assert np.abs(found.pose[:2] - wanted["pose"]).max() <= 1e-8  # eight decimals
    assert np.degrees(found.pose[2]) == pytest.approx(wanted["phi_deg"], abs=1e-5)
    assert np.abs(found.force - wanted["force"]).max() <= 1e-6
    assert found.energy.sum() == pytest.approx(wanted["energy"], abs=1e-7)


def test_misprinted_angle_of_table_8_does_not_close():
    """With 0 degrees for motor 2, as printed in the text, the pins have other distances.

    The digits of the table need 180 degrees.
    """
    motors = MOTORS8 * [1, 0, 1]
    tip, *_ = rods_of_table_8(TABLE8["printed"][0], motors)
    sides = np.abs(tip - np.roll(tip, 1))
    assert sorted(sides) == pytest.approx([0.20, 1.88, 2.07], abs=5e-3)  # as recomputed


@pytest.mark.parametrize("row", DATA["pfr3"]["recomputed"], ids=["rigid ends", "none"])
def test_inverse_pose_of_the_program(row):
    """Slides, moments and forces at the program's start pose are the recomputed ones.

    No force acts along a guide, and the direct problem leads back to the pose.
    """
    turns = np.radians([0.0, 120.0, -120.0])
    side = np.sqrt(3.0) * DATA["pfr3"]["circumradius"]
    a = three_rod_platform(side, angle=turns, guide=turns, rigid_extension=row["rigid_extension"])
    guess = state(
        a,
        pose=[0.0, 0.0, np.radians(DATA["pfr3"]["phi_deg"])],
        moment=DATA["pfr3"]["guess"]["moment"],
        force=CORNERS * DATA["pfr3"]["guess"]["force"],
    )
    found = solve_inverse(guess)
    assert found.inputs == pytest.approx(row["slide"], abs=1e-6)  # data: six to seven decimals
    assert np.ptp(found.inputs) <= 1e-10
    assert found.moment == pytest.approx(row["moment"], abs=1e-6)
    assert np.hypot(*found.force.T) == pytest.approx(row["force"], abs=1e-6)
    *_, angle, _ = found.shape([1.0])
    assert np.degrees(angle[:, 0] - turns) == pytest.approx(row["tip_turn_deg"], abs=1e-4)
    along = np.sum(found.force * np.stack([np.cos(turns), np.sin(turns)], axis=1), axis=1)
    assert np.abs(along).max() <= 1e-10  # no force along a guide
    assert np.abs(solve_direct(found).vector - found.vector).max() <= 1e-8  # direct problem


def test_symmetric_platform_without_load():
    """An unloaded symmetric platform is at the centre, at the recomputed angles and energies."""
    case = DATA["pfr3_symmetric"]
    turns = np.radians(case["angle_deg"])
    for row in case["recomputed"]:
        found = solve_direct(
            state(
                three_rod_platform(case["side"], angle=turns, guide=turns),
                moment=row["moment"],
                pose=[0.01, -0.01, np.radians(row["phi_deg"])],
                force=row["force"],
            )
        )
        assert np.abs(found.pose[:2]).max() <= 1e-9
        assert np.degrees(found.pose[2]) == pytest.approx(row["phi_deg"], abs=1e-4)
        assert np.ptp(found.moment) <= 1e-9
        assert found.energy.sum() == pytest.approx(row["energy"], abs=1e-6)


def test_a_turned_and_scaled_mechanism_is_the_same():
    """With twice the lengths, 16 times EI and a turn by 0.7 rad, the shapes are the same.

    The forces are four times as large, moments and energies eight times.
    """
    s, turn = table_7_state("S2"), np.exp(0.7j)
    clamp = xy(2 * turn * (np.array(TABLE7["clamp"]) @ [1, 1j]))
    a = assembly(clamp, length=2.0, stiffness=16 * EI)
    force = xy(4 * turn * (s.force @ [1, 1j]))
    found = solve_direct(
        state(
            a,
            inputs=s.inputs + 0.7,
            pose=xy(2 * turn * (s.pose @ [1, 1j])) + 1e-3,
            load=force.sum(axis=0),
            moment=8 * s.moment,
            force=force,
        )
    )
    assert found.pose == pytest.approx(xy(2 * turn * (s.pose @ [1, 1j])), abs=1e-9)
    assert found.energy.sum() == pytest.approx(8 * s.energy.sum(), abs=1e-8)


def test_a_batch_has_the_solutions_of_its_members():
    """A batch of direct problems has the solutions of its members alone."""
    s = table_7_state("S1")
    turns = s.inputs + np.linspace(0.0, 0.1, 5)[:, None] * [1, -1]
    together = solve_direct(s.with_parts(inputs=turns))
    for one, turn in zip(together.vector, turns, strict=True):
        alone = solve_direct(s.with_parts(inputs=turn))
        # a batch takes the steps that one of its members needs, so the errors of the rods differ
        assert np.abs((one - alone.vector) / residual_and_state_sizes(PAIR)[1]).max() <= 1e-9


def test_mirrored_platforms_are_recognized():
    """Three of the six roots of the program's residual, which closes distances, are mirrored."""
    a = three_rod_platform(DATA["pfr3_closures"]["side"])
    for row in DATA["pfr3_closures"]["pins"]:
        assert bool(is_mirrored(a, row["pins"])) == row["mirrored"]


@pytest.mark.parametrize(
    ("wrong", "word"),
    [
        ({"clamp": [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]}, "clamp must be finite points"),
        (
            {"clamp": [[0.0, 0.0], [3.0, 0.0]]},
            "clamps 1 and 2 are 3 m apart, and their rods reach 2 m",
        ),
        ({"length": [1.0, 0.0]}, "length must be finite and above 0"),
        ({"stiffness": -0.1}, "stiffness must be finite and above 0"),
        ({"stiffness": [1.0, 1.0, 1.0]}, "stiffness must be one for all or one for each of 2 rods"),
        ({"rigid_extension": -0.1}, "rigid_extension must be finite and not below 0"),
        ({"arm": [[0.0, 0.1]] * 3}, "arm must be one for all or one for each"),
        ({"guide": np.nan}, "guide must be finite"),
    ],
)
def test_bad_mechanisms(wrong, word):
    with pytest.raises(ValueError, match=word):
        assembly(**({"clamp": TABLE7["clamp"]} | wrong))


def test_bad_problems():
    with pytest.raises(ValueError, match=r"out of reach: rod 1 is too short by 0\.3"):
        solve_inverse(table_7_state("S1").with_parts(pose=[1.0, 0.0]))
    with pytest.raises(ValueError, match="no equilibrium is found from the guess at inputs"):
        solve_direct(state(PAIR, inputs=1.0))  # straight rods without load
    with pytest.raises(ValueError, match="as many rods as degrees of freedom"):
        solve_inverse(state(assembly(TABLE7["clamp"], arm=[[0.1, 0.0], [-0.1, 0.0]]), moment=0.1))
    with pytest.raises(ValueError, match=r"load must be finite, \(\.\.\., 2\)"):
        table_7_state("S1").with_parts(load=[1.0, 0.0, 0.0])
    with pytest.raises(ValueError, match="force must hold x, y of 2 rods"):
        state(PAIR, force=[1.0, 0.0])
    with pytest.raises(ValueError, match="side must be positive"):
        triangle(0.0)
    with pytest.raises(ValueError, match="pins must be those of a platform"):
        is_mirrored(PAIR, [[0.0, 0.0], [1.0, 0.0]])
