"""The proven errors of references: proofs by ball arithmetic, and the table that stores them."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from flint import arb

from proofmass.analytic.protocol import Ask, InputMotion
from proofmass.reference import proven
from proofmass.reference.evaluate import evaluate, reference_quantities
from proofmass.reference.find import find_reference
from proofmass.reference.proven import (
    ProvenRun,
    ProvenTable,
    digest_inputs,
    digest_values,
    prescribed_motion,
    proven_errors,
    read_proven_table,
)
from tests.independent.balls.chains import make_chain
from tests.independent.balls.continuity import ProvenPose, is_continuous
from tests.independent.balls.free_motions import FREE_MOTIONS
from tests.independent.balls.hysteresis import ALONG_A_DRIVE
from tests.independent.balls.linkages import FORMS, fourbar
from tests.independent.balls.loops import (
    HALF_WIDTHS,
    IMAGINARY,
    CaseNumbers,
    DryFriction,
    Loops,
    NotProven,
    approximate_pose,
    prove_pose,
    series,
)
from tests.independent.balls.motion import senses_of
from tests.independent.balls.proof import case_numbers, distance, prove_errors
from tests.independent.balls.reactions import check_moments
from tests.independent.balls.rod_shapes import prove_rod, rod_curves, rod_loads
from tests.independent.balls.rods import cantilever, prove_equilibria
from tests.shipped import shipped, shipped_case

WRONG_DIGIT = 1e-12
"""A change [m] that no plot shows and no engine notices, some thousand times the proven errors."""
EPSILON = 2.0**-52
"""Distance of 1 from the next float64."""
ROUNDINGS = 10
"""Roundings of a closed form of the four-bar, of a few dozen operations, that may add up."""


def short_fourbar(n=25):
    """The four-bar with few samples."""
    case = shipped_case(shipped("fourbar.toml"))
    table = case.run["sweep"].model_copy(update={"n": n})
    return case.model_copy(update={"run": {"sweep": table}})


def with_parameters(case, **changed):
    """The case with other parameters."""
    return case.model_copy(update={"parameters": {**case.parameters, **changed}})


def test_the_fourbar_is_right_to_rounding():
    proof = prove_errors(short_fourbar(), "sweep")
    assert set(proof.errors) == set(short_fourbar().channels)
    assert not proof.not_covered
    assert max(proof.errors.values()) < ROUNDINGS * EPSILON


def test_a_wrong_digit_of_one_sample_is_found():
    case = short_fourbar()
    curves = evaluate(case, "sweep", *prescribed_motion(case, "sweep"))
    name = next(name for name, one in case.channels.items() if one.equals == "point_x")
    wrong = curves.channels[name].copy()
    wrong[7] += WRONG_DIGIT
    changed = replace(curves, channels={**curves.channels, name: wrong})
    errors = prove_errors(case, "sweep", changed).errors
    assert errors[name] * np.ptp(wrong) == pytest.approx(WRONG_DIGIT, rel=1e-3)  # 1e-15 of 1e-12
    assert all(error < ROUNDINGS * EPSILON for other, error in errors.items() if other != name)


def test_a_wrong_length_of_the_reference_is_found():
    case = short_fourbar()
    longer = with_parameters(case, coupler=case.parameters["coupler"] + WRONG_DIGIT)
    curves = evaluate(longer, "sweep", *prescribed_motion(case, "sweep"))
    assert max(prove_errors(case, "sweep", curves).errors.values()) > 0.1 * WRONG_DIGIT


def test_the_other_assembly_is_another_pose():
    case = short_fourbar()
    curves = evaluate(with_parameters(case, mode=-1), "sweep", *prescribed_motion(case, "sweep"))
    assert max(prove_errors(case, "sweep", curves).errors.values()) > 0.1


def test_a_parameter_without_a_part_in_the_proof_is_refused(monkeypatch):
    def forgetful(p, u, q, whole):
        inner = CaseNumbers({**p.given, "rocker_mass": 0.0})
        loops = fourbar(inner, u, q, whole)
        p.asked.update(inner.asked - {"rocker_mass"})
        return loops

    monkeypatch.setitem(FORMS, "fourbar", (forgetful, FORMS["fourbar"][1]))
    with pytest.raises(NotProven, match="without a part in the proof: rocker_mass"):
        prove_errors(short_fourbar(3), "sweep")


def square_root(_p, u, q, _whole):
    """One unknown, the square root of the drive, and a second that is zero."""
    return Loops([q[0] * q[0] - u[0] + IMAGINARY * q[1]])


@pytest.mark.parametrize(("drive", "guess"), [(0.0, 0.0), (-1e-3, 0.0), (2.0, 1.3)])
def test_no_pose_a_double_pose_and_a_far_guess_are_not_proven(drive, guess):
    with pytest.raises(NotProven):
        prove_pose(square_root, CaseNumbers({}), [arb(drive)], [guess, 0.0])


def test_a_proven_pose_encloses_the_square_root_of_two():
    pose, half_width = prove_pose(square_root, CaseNumbers({}), [arb(2)], [2**0.5, 0.0])
    assert half_width == HALF_WIDTHS[0]
    assert pose[0].contains(arb(2).sqrt())
    assert pose[0].rad() < 1e-30


def test_a_ball_that_is_not_finite_is_refused():
    channel = next(iter(short_fourbar().channels.values()))
    with pytest.raises(NotProven, match="nan"):
        distance(0.0, arb("nan"), channel)


@pytest.fixture
def table(monkeypatch):
    """A table with the four-bar of few samples alone."""
    case = short_fourbar()
    row = ProvenRun(
        digest_inputs(case, "sweep"), digest_values(case, "sweep"), 25, 1e-4, {"position": 6e-16}
    )
    monkeypatch.setattr(
        proven, "read_proven_table", lambda: ProvenTable(runs={"fourbar sweep": row})
    )


@pytest.mark.usefixtures("table")
def test_a_case_as_it_was_proven_has_its_errors():
    assert proven_errors(short_fourbar(), "sweep") == {"position": 6e-16}


@pytest.mark.usefixtures("table")
def test_another_parameter_run_or_case_has_none():
    case = short_fourbar()
    other = shipped_case(shipped("slider_crank.toml"))
    assert proven_errors(with_parameters(case, coupler=0.5), "sweep") == {}
    assert proven_errors(short_fourbar(26), "sweep") == {}
    assert proven_errors(other, "sweep") == {}


@pytest.mark.usefixtures("table")
def test_a_value_that_differs_in_the_last_bit_has_none(monkeypatch):
    def nearly(*given):
        curves = evaluate(*given)
        name = next(iter(curves.channels))
        moved = np.nextafter(curves.channels[name], np.inf)
        return replace(curves, channels={**curves.channels, name: moved})

    monkeypatch.setattr(proven, "evaluate", nearly)
    assert proven_errors(short_fourbar(), "sweep") == {}


def test_titles_and_tolerances_are_no_inputs_of_a_proof():
    case = short_fourbar()
    other = case.model_copy(update={"title": "another", "tolerance": ()})
    assert digest_inputs(other, "sweep") == digest_inputs(case, "sweep")


def pose_of(mode, angle):
    """The four-bar's pose at a crank angle in an assembly mode, as balls."""
    case = with_parameters(short_fourbar(), mode=mode)
    state = np.full((1, 1), angle), np.zeros((1, 1)), np.zeros((1, 1))
    known = evaluate(case, "sweep", np.array([angle]), state).channels
    names = {one.equals: name for name, one in case.channels.items()}
    guess = [float(known[names[one]][0]) for one in ("coupler_angle", "rocker_angle")]
    unknowns, _ = prove_pose(fourbar, CaseNumbers(case.parameters), [arb(angle)], guess)
    return ProvenPose([arb(angle)], unknowns)


def test_one_branch_leads_from_a_pose_to_the_next_but_not_to_the_other_assembly():
    numbers = CaseNumbers(short_fourbar().parameters)
    assert is_continuous(fourbar, numbers, pose_of(1, 0.5), pose_of(1, 0.7))
    assert not is_continuous(fourbar, numbers, pose_of(1, 0.5), pose_of(-1, 0.7))
    assert not is_continuous(fourbar, numbers, pose_of(1, 0.5), pose_of(-1, 0.5))


def test_the_branches_of_a_square_root_are_not_joined_at_their_fold():
    poses = [ProvenPose([arb(0.25)], [arb(one), arb(0)]) for one in (0.5, -0.5)]
    assert not is_continuous(square_root, CaseNumbers({}), *poses)
    later = ProvenPose([arb(4)], [arb(2), arb(0)])
    assert is_continuous(square_root, CaseNumbers({}), poses[0], later)


def test_balances_of_bodies_and_virtual_power_must_agree():
    check_moments({"holding_moment": arb(2)}, {"holding_moment": arb(2, 1e-30)})
    with pytest.raises(NotProven, match="holding_moment"):
        check_moments({"holding_moment": arb(2)}, {"holding_moment": arb(2 + WRONG_DIGIT)})


@pytest.mark.parametrize(
    ("reference", "given"),
    [
        ("bouncing_ball", {"height": 0.5, "restitution": 0.8, "speed": 1.0, "gravity": 9.81}),
        ("sliding_block", {"friction": 0.3, "angle": 0.5, "speed": 2.0, "mass": 1.5}),
        ("sliding_block", {"friction": 0.7, "angle": 0.5, "speed": -2.0, "mass": 1.5}),
        ("ball_row", {"balls": 3, "radius": 0.02, "gap": 0.01, "speed": 1.0, "restitution": 0.9}),
    ],
)
def test_free_motions_with_other_parameters_than_shipped(reference, given):
    x = np.linspace(0.0, 0.9, 12)
    defaults = {"gravity": 9.81} if reference == "sliding_block" else {}
    exact = list(FREE_MOTIONS[reference](CaseNumbers(given | defaults), x))
    known = find_reference(reference)(**given | defaults).solve(InputMotion(x), Ask())
    for name, curve in known.items():
        size = max(1.0, np.abs(curve).max())
        for k in range(x.size):
            assert abs(arb(float(curve[k])) - exact[k][name]) < ROUNDINGS * EPSILON * size


@pytest.mark.parametrize(("angle", "stopped"), [(0.05, {}), (1.5, {2: arb(0)})])
def test_a_wrong_guess_of_joints_on_stops_is_refused(angle, stopped):
    case = shipped_case(shipped("balancer_third_preload.toml"))
    drive = np.array([[angle]])
    known = reference_quantities(
        case, "sweep", drive[0], (drive, drive, drive), dict(case.parameters)
    )
    p = case_numbers(case)
    chain = make_chain(p, [float(known[f"deflection{k}"][0]) for k in (1, 2, 3)])
    assert bool(chain.stopped) != bool(stopped)  # joint 3 leaves its stop between the two angles
    wrong = replace(chain, stopped=stopped)
    names = ("theta1", "theta2", "theta3", "force_x", "force_y")
    guess = [float(known[name][0]) for name in names[:3]]
    guess += [-float(known[name][0]) for name in names[3:]] + [0.0] * len(stopped)
    guess = approximate_pose(wrong, p, [arb(angle)], guess, steps=20)
    pose, _ = prove_pose(wrong, p, [arb(angle)], guess)
    with pytest.raises(NotProven, match="joint 3"):
        wrong.check_stops(p, pose)


def test_a_rate_that_may_be_rest_or_motion_has_no_sense_of_friction():
    def rubbing(rate):
        return Loops([], frictions=[DryFriction(arb(1), series([arb(0)], [arb(rate)])[0])])

    assert senses_of(rubbing(-2.0), []) == [-1]
    assert senses_of(rubbing(1e-17), [1]) == [1]
    with pytest.raises(NotProven, match="dry friction"):
        senses_of(rubbing(1e-9), [1])


@pytest.mark.parametrize(
    ("reference", "given"),
    [
        ("spring_release", {"stiffness1": 90.0, "preload": 6.3, "connection": "series"}),
        ("spring_release", {"stiffness1": 90.0, "preload": 6.3, "connection": "parallel"}),
        ("shaft_pendulum", {"length": 0.3, "mass": 0.4, "friction": 0.2, "bearing_friction": 0.1}),
    ],
)
def test_references_along_a_drive_with_other_parameters_than_shipped(reference, given):
    rates = np.array([0.0, *np.repeat([1.0, -1.0, 1.0], 4)])  # from rest, as the shipped cases
    places = (0.03 if reference == "spring_release" else 0.1) * np.cumsum(rates)
    more = {"stiffness2": 250.0} if reference == "spring_release" else {"gravity": 9.81}
    state = places, rates, np.zeros_like(rates)
    exact = list(ALONG_A_DRIVE[reference](CaseNumbers(given | more), zip(*state, strict=True)))
    known = find_reference(reference)(**given | more).solve(InputMotion(places, state), Ask())
    for name in exact[0].keys() & known.keys():
        for k, sample in enumerate(exact):
            gap = abs(arb(float(known[name][k])) - sample[name])
            assert gap < ROUNDINGS * EPSILON * max(1.0, np.abs(known[name]).max())


@pytest.mark.slow
def test_series_and_elliptic_functions_enclose_the_same_rod():
    p = case_numbers(shipped_case(shipped("rod_cantilever.toml")))
    x = np.array([0.0, 0.4, 1.0])
    elliptic = list(cantilever(p, x))
    guess = [float(elliptic[0]["m"].mid()), 0.0, p["force_y"]]
    for exact, (curves, _) in zip(elliptic, rod_curves(rod_loads(p), guess, None, x), strict=True):
        for name, ball in exact.items():
            assert curves[name].overlaps(ball)
            assert curves[name].rad() < 1e-30
    with pytest.raises(NotProven):
        prove_rod(rod_loads(p), [guess[0] + 0.01, *guess[1:]], None)


@pytest.mark.slow
def test_the_34_equilibria_of_two_rods_exist_and_each_is_alone_in_a_box():
    proven_pairs = prove_equilibria(shipped_case(shipped("rfr2_natural.toml")).parameters)
    assert len(proven_pairs) == 34
    for (one, width), (two, other) in combinations(proven_pairs, 2):
        apart = max(float(abs(a - b)) for a, b in zip(one, two, strict=True))
        assert apart > width + other  # boxes have no common point: 34 different equilibria


@pytest.mark.slow
@pytest.mark.parametrize("label", read_proven_table().runs)
def test_the_table_is_proven_again(label):
    name, _, kind = label.partition(" ")
    case, row = shipped_case(shipped(f"{name}.toml")), read_proven_table().runs[label]
    assert row.inputs == digest_inputs(case, kind), "run python -m benchmarks.proven_errors"
    found = prove_errors(case, kind).by_kind(case)
    assert found.keys() == row.errors.keys()
    # another processor may have other last bits: two roundings more of a value of the table
    assert all(found[one] <= 4 * error for one, error in row.errors.items())
