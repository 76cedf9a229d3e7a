"""Two rods on one pin, driven by motors: paths of the document, a fold, whole turns of motors."""

import numpy as np
import pytest

from proofmass.analytic.rods.equilibrium import derivatives
from proofmass.analytic.rods.rod_pair_driven import circles, equilibria_at_points, rectangles, solve
from tests.analytic.rods.rod_assembly_cases import DATA, EI, table_7_state
from tests.analytic.rods.rod_chain_cases import continuum

PATHS, LOAD = DATA["trajectories"], np.array(DATA["rfr2"]["load"])
DIMENSIONS = {"distance": 0.6, "stiffness": EI}
LOADED_PAIR = DIMENSIONS | {"force_x": LOAD[0], "force_y": LOAD[1]}
START_GUESS = DIMENSIONS | {
    "pin_x": 0.293,
    "pin_y": -0.341,
    "moment1": 0.28,
    "moment2": 0.29,
    "push_x": -0.83,
    "push_y": 0.95,
}  # the start of the document's trajectories
START_ANGLES = np.radians([[-32.2157989], [20.9113672]])
FIRST_MOTOR = np.array([[1.0], [0.0]])
ROTATION = np.array([0.1, -0.05])  # rotation [rad] of the motors from the guess


def guess_of_table_7(name):
    """Motor angles of an equilibrium of Table 7, and parameters with a guess of three decimals."""
    s = table_7_state(name)
    names = "pin_x", "pin_y", "moment1", "moment2", "push_x", "push_y"
    values = np.array([*s.pose, *s.moment, *s.force[0]])
    return s.inputs, LOADED_PAIR | dict(zip(names, values.round(3), strict=True))


def test_pin_and_moments_along_a_motor_line_are_the_recomputed_ones():
    """Pin and holding moments are the recomputed ones along the document's motor line, unloaded."""
    rows = PATHS["motor"]
    found = solve(START_ANGLES + FIRST_MOTOR * [0.0, *(row["turn"] for row in rows)], **START_GUESS)
    for names, key in ((("pin_x", "pin_y"), "pose"), (("hold1", "hold2"), "moment")):
        sign = -1.0 if key == "moment" else 1.0  # motors act against the rods
        values = sign * np.stack([found[name][1:] for name in names], axis=1)
        # the data have six decimals, those of moments five
        np.testing.assert_allclose(values, [row[key] for row in rows], rtol=0, atol=6e-6)


def test_both_motors_lead_the_pin_round_a_ring():
    """Recomputed motor angles, to 1e-5 degrees, lead the pin round a ring of diameter 0.2 m."""
    rows = PATHS["ring"]
    angles = np.radians([row["inputs_deg"] for row in rows]).T
    found = solve(np.hstack([START_ANGLES, angles]), **START_GUESS)
    turn = np.radians([row["angle_deg"] for row in rows])
    for name, ring in (("pin_x", np.cos(turn)), ("pin_y", np.sin(turn))):
        # 1e-5 degrees times dP/dtheta
        np.testing.assert_allclose(found[name][1:] - found[name][0], 0.1 * ring, atol=2e-7)


def test_a_fold_ends_the_branch():
    """Curves are NaN beyond the fold; the pin's stiffness is proportional to the root of the angle
    to the fold.
    """
    fold = PATHS["fold"]
    offsets = np.array([4e-4, 1e-4, -1e-4])  # the data have 5e-6 rad
    found = solve(START_ANGLES + FIRST_MOTOR * [0.0, *(fold["turn"] + offsets)], **START_GUESS)
    assert np.isfinite(found["pin_x"]).tolist() == [True, True, True, False]
    assert all(np.isnan(curve[3]) for curve in found.values())
    soft = found["pin_stiffness"][1:3]
    assert soft[1] / soft[0] == pytest.approx(0.5, abs=0.02)  # next power; fold to 5e-6
    near = [found["pin_x"][2], found["pin_y"][2]]
    assert near == pytest.approx(fold["pose"], abs=2e-2)  # root of 1e-4 rad


MOTOR_TURNS = {"S1": (1, -1, "S2"), "S4": (0, -1, "S2"), "S3": (-1, 0, "S1")}


@pytest.mark.parametrize(
    "name", ["S3", *(pytest.param(name, marks=pytest.mark.slow) for name in ("S1", "S4"))]
)
def test_turns_of_the_motors_join_the_equilibria_of_table_7(name):
    """Whole turns of the motors lead from one equilibrium of Table 7 to another one.

    The clamps have the same directions again, but the rods are wound in another way.
    """
    *turns, other = MOTOR_TURNS[name]
    begin, parameters = guess_of_table_7(name)
    found = solve(begin[:, None] + 2 * np.pi * np.outer(turns, np.linspace(0, 1, 7)), **parameters)
    goal = table_7_state(other)
    ends = [found[key][-1] for key in ("pin_x", "pin_y", "hold1", "hold2", "energy")]
    reference = [*goal.pose, *-goal.moment, goal.energy.sum()]
    np.testing.assert_allclose(ends, reference, rtol=0, atol=1e-10)  # Newton, over L and EI/L
    assert found["pin_stiffness"].min() > 0.1  # far from any fold


@pytest.mark.parametrize("name", ["S1", "S2", "S3", "S4"])
def test_the_rods_integrated_from_their_clamps_meet_at_the_pin(name):
    """Rods by DOP853, from their clamp moments and tip forces, meet at the pin without a moment.

    Their tangents at the pin and their energy are those of `solve`.
    """
    begin, parameters = guess_of_table_7(name)
    found = {
        key: curve[-1]
        for key, curve in solve(np.stack([begin, begin + ROTATION], axis=1), **parameters).items()
    }
    first, stored = np.array([found["push_x"], found["push_y"]]), 0.0
    s = np.linspace(0.0, 1.0, 2001)
    for k, force in enumerate((first, LOAD - first)):
        angle = begin[k] + ROTATION[k]
        theta, bend, x, y = continuum(angle, force, -found[f"hold{k + 1}"], EI)(s)
        assert theta[-1] == pytest.approx(found[f"tip{k + 1}"], abs=1e-8)  # DOP853 at 1e-11
        assert EI * bend[-1] == pytest.approx(0.0, abs=1e-9)
        pin = [x[-1] + (0.3 if k else -0.3), y[-1]]
        assert pin == pytest.approx([found["pin_x"], found["pin_y"]], abs=1e-8)
        stored += EI / 2 * np.trapezoid(bend**2, s)
    assert stored == pytest.approx(found["energy"], rel=1e-5)  # the trapezoids


def sample_with_neighbours(h):
    """A sample of the document's line (1) and two at +-h (2, 3), for each of the two motors."""
    middle = START_ANGLES + FIRST_MOTOR * 0.4
    return [
        solve(
            np.hstack([START_ANGLES, middle, middle + way, middle - way]),
            np.ones((2, 1)),
            **START_GUESS,
            force_x=0.02,
        )
        for way in h * np.eye(2)[..., None]
    ]


def test_rates_are_slopes_and_moments_are_work():
    """dP/dt = sum dP/dtheta_i at motor rates of 1 rad/s; d(U - F.P) = hold . dtheta."""
    h = 1e-4
    first, second = sample_with_neighbours(h)
    for axis in "xy":
        slopes = [
            (one[f"pin_{axis}"][2] - one[f"pin_{axis}"][3]) / (2 * h) for one in (first, second)
        ]
        assert first[f"pin_v{axis}"][1] == pytest.approx(sum(slopes), abs=1e-7)  # h^2
    for one, hold in ((first, "hold1"), (second, "hold2")):
        potential = one["energy"] - 0.02 * one["pin_x"]
        slope = (potential[2] - potential[3]) / (2 * h)
        assert one[hold][1] == pytest.approx(slope, abs=1e-7)  # h^2


def test_symmetric_motors_keep_the_pin_in_the_middle():
    """Motors that turn symmetrically from 60 and 120 degrees keep the unloaded pin on the y axis.

    The pose at the start is the recomputed one.
    """
    turn = np.linspace(0.0, 0.3, 4)
    found = solve(
        [np.pi / 3 + turn, 2 * np.pi / 3 - turn],
        [[1.0], [-1.0]],
        distance=0.6,
        pin_x=0.0,
        pin_y=0.95,
        moment1=0.5,
        moment2=-0.5,
        push_x=-0.5,
        push_y=0.0,
    )
    assert np.abs(found["pin_x"]).max() <= 1e-9
    assert np.abs(found["pin_vx"]).max() <= 1e-9
    np.testing.assert_allclose(found["hold1"], -found["hold2"], atol=1e-9, rtol=0)
    assert found["pin_y"][0] == pytest.approx(0.948938, abs=5e-7)  # digits of the data


def test_motors_that_differ_in_the_seventh_digit_have_equilibria_of_their_own():
    """Motor angles that differ by 2e-7 rad share the search for a path, but not the equilibrium."""
    step = 2e-7
    one, other = (
        solve(START_ANGLES + FIRST_MOTOR * turn, FIRST_MOTOR, **START_GUESS)
        for turn in (0.5, 0.5 + step)
    )
    slope = (other["pin_x"] - one["pin_x"]) / step
    assert slope == pytest.approx(one["pin_vx"], abs=2e-3)  # twice Newton's 1e-10, over the step


@pytest.mark.slow
def test_equilibria_do_not_depend_on_samples_or_units():
    """The equilibria are the same with more samples, on the way back, and in other units."""
    turn = np.linspace(0.0, 1.0, 3)
    coarse = solve(START_ANGLES + FIRST_MOTOR * turn, FIRST_MOTOR, **START_GUESS)
    there = np.linspace(0.0, 1.0, 9)
    fine = solve(
        START_ANGLES + FIRST_MOTOR * np.append(there, there[-2::-1]), FIRST_MOTOR, **START_GUESS
    )
    big = {
        "distance": 1.2,
        "length": 2.0,
        "stiffness": 4 * EI,
        "pin_x": 0.586,
        "pin_y": -0.682,
        "moment1": 0.56,
        "moment2": 0.58,
        "push_x": -0.83,
        "push_y": 0.95,
    }
    larger = solve(START_ANGLES + FIRST_MOTOR * turn, FIRST_MOTOR, **big)
    size = {
        "pin_x": 2,
        "pin_y": 2,
        "pin_vx": 2,
        "pin_vy": 2,
        "hold1": 2,
        "hold2": 2,
        "energy": 2,
        "pin_stiffness": 0.5,
    }
    for name, curve in coarse.items():
        # Newton's 1e-10, over the softness of the pin
        np.testing.assert_allclose(fine[name][[0, 4, 8, 12, 16]], curve[[0, 1, 2, 1, 0]], atol=1e-8)
        np.testing.assert_allclose(larger[name], size.get(name, 1) * curve, atol=1e-8)


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"angle": [0.1, 0.2]}, r"theta1 and theta2, \(2, n\), got \(2,\)"),
        ({"angle": np.zeros((2, 0))}, r"got \(2, 0\)"),
        ({"angle": np.zeros((3, 4))}, r"got \(3, 4\)"),
        ({"angle": [[0.0, np.nan], [0.0, 0.0]]}, "angle must be finite, got nan"),
        ({"stiffness": -1.0}, "stiffness must be positive and finite"),
        ({"length": 0.0}, "length must be a positive finite length"),
        ({"distance": 3.0}, "clamps 1 and 2 are 3 m apart, and their rods reach 2 m"),
        ({"moment1": 30.0}, "no equilibrium is found from the guess"),
    ],
)
def test_bad_values_are_named(change, word):
    with pytest.raises(ValueError, match=word):
        solve(**{"angle": START_ANGLES + FIRST_MOTOR * [0.0, 0.1]} | START_GUESS | change)


CENTRE = {"theta1": START_ANGLES[0, 0], "theta2": START_ANGLES[1, 0]}
CIRCLES = {"diameter": 0.2, "number": 5, "divisions": 8}
RECTANGLES = {"width": 0.2, "height": 0.2, "number": 4, "divisions": 4}


def pin_path(profile, time, size):
    """Positions x + iy of the pin from its first one, for motor angles of a motion profile."""
    found = solve(*profile(time, **size, **CENTRE, **START_GUESS), **START_GUESS)
    place = found["pin_x"] + 1j * found["pin_y"]
    return place - place[0]


def stiffness_at(places):
    """States at positions of the pin about the centre, and their least stiffness, fixed motors."""
    states = equilibria_at_points(tuple(places.tolist()), **CENTRE, **START_GUESS)
    return states, np.linalg.eigvalsh(derivatives(states).stiffness)[:, 0]


def test_five_circles_of_the_document():
    """The motors lead the pin along the document's five circles, through stable poses.

    The last circle is the ring whose motor angles were recomputed.
    """
    turns = np.exp(0.25j * np.pi * np.arange(8))
    wanted = np.outer(0.02 * np.arange(1.0, 6.0), turns).ravel()
    time = np.array([0, 1, 4, 11, 18, 25, 29, 33, 36, 39])
    places = pin_path(circles, time, CIRCLES)
    np.testing.assert_allclose(places[1:], wanted[time[1:] - 1], rtol=0, atol=1e-9)  # of `solve`
    assert stiffness_at(wanted)[1].min() > 0.1
    angles = circles(np.arange(33.0, 41.0), **CIRCLES, **CENTRE, **START_GUESS)[0]
    rows = [row["inputs_deg"] for row in PATHS["ring"]]
    np.testing.assert_allclose(np.degrees(angles.T), rows, rtol=0, atol=1e-4)  # five decimals


def test_four_rectangles_of_the_document_end_beyond_a_fold():
    """The motors lead the pin along the document's four rectangles, except for the last corner.

    Of all 64 positions this one, a corner of the largest rectangle, is an unstable equilibrium.
    """
    # clockwise from the lower right corner; each side is the one before, rotated
    square = (-1j) ** np.arange(4)[:, None] * (1.0 - 1.0j - 0.5 * np.arange(1, 5))
    wanted = np.outer(0.025 * np.arange(1, 5), square).ravel()
    time = np.array([0, 3, 4, 8, 12, 16, 21, 28, 35, 44, 50, 56, 60])
    places = pin_path(rectangles, time, RECTANGLES)
    np.testing.assert_allclose(places[1:], wanted[time[1:] - 1], rtol=0, atol=1e-9)
    states, least = stiffness_at(wanted)
    assert least[:-1].min() > 0.05
    assert least[-1] < -0.1  # motors do not constrain the pin there
    own = rectangles(np.arange(1.0, 65.0), **RECTANGLES, **CENTRE, **START_GUESS)[0]
    np.testing.assert_allclose(own.T, states.inputs, rtol=0, atol=1e-9)
    # of two shapes at these angles the motors lead to the stable one
    assert (
        abs(pin_path(rectangles, np.array([0.0, 56.0, 60.0, 64.0]), RECTANGLES)[-1] - wanted[-1])
        > 0.05
    )


@pytest.mark.parametrize("law", [circles, rectangles])
def test_a_path_has_the_rates_of_its_angles(law):
    """Rates and accelerations of a motion profile are central differences of its angles."""
    size = CIRCLES if law is circles else RECTANGLES
    t, step = np.array([0.7, 7.3, 22.9]), 1e-4
    angle, rate, acceleration = law(t, **size, **CENTRE, **START_GUESS)
    ahead, behind = (law(t + s, **size, **CENTRE, **START_GUESS)[0] for s in (step, -step))
    np.testing.assert_allclose(rate, (ahead - behind) / (2 * step), rtol=0, atol=1e-7)
    np.testing.assert_allclose(acceleration, (ahead - 2 * angle + behind) / step**2, atol=1e-5)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"number": 0}, "1 or more, got 0.2, 0, 8"),
        ({"diameter": -0.2}, "must be positive and finite"),
        ({"diameter": 4.0}, "out of reach"),
        ({"pins": 1.0}, "unexpected keyword argument 'pins'"),
    ],
)
def test_an_impossible_path_is_refused(change, words):
    with pytest.raises(ValueError, match=words):
        circles(0.0, **{**CIRCLES, **CENTRE, **START_GUESS, **change})
