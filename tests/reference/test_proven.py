"""The proven errors of references: proofs by ball arithmetic, and the table that stores them."""

from dataclasses import replace

import numpy as np
import pytest
from flint import arb

from proofmass.reference import proven
from proofmass.reference.evaluate import evaluate
from proofmass.reference.proven import (
    ProvenRun,
    ProvenTable,
    digest_inputs,
    digest_values,
    prescribed_motion,
    proven_errors,
    read_proven_table,
)
from tests.independent.balls.loops import (
    HALF_WIDTHS,
    IMAGINARY,
    CaseNumbers,
    Loops,
    NotProven,
    constants,
    prove_pose,
)
from tests.independent.balls.proof import distance, prove_errors
from tests.shipped import shipped, shipped_case

WRONG_DIGIT = 1e-12
"""A change [m] that no plot shows and no engine notices, some thousand times the proven errors."""
EPSILON = 2.0**-52
"""Distance of 1 from the next float64."""
ROUNDINGS = 10
"""Roundings of a closed form of the four-bar, of a few dozen operations, that may add up."""


def short_fourbar(n=25, name="fourbar"):
    """The four-bar, or another case, with few samples."""
    case = shipped_case(shipped(f"{name}.toml"))
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


def test_a_parameter_without_a_part_in_the_proof_is_refused():
    case = short_fourbar(2, "slider_crank")
    curves = evaluate(case, "sweep", *prescribed_motion(case, "sweep"))
    with pytest.raises(NotProven, match="crank_friction"):
        prove_errors(with_parameters(case, crank_friction=0.01), "sweep", curves)


def square_root(_p, u, q, _whole):
    """One unknown, the square root of the drive, and a second that is zero."""
    return Loops([q[0] * q[0] - u[0] + IMAGINARY * q[1]])


@pytest.mark.parametrize(("drive", "guess"), [(0.0, 0.0), (-1e-3, 0.0), (2.0, 1.3)])
def test_no_pose_a_double_pose_and_a_far_guess_are_not_proven(drive, guess):
    with pytest.raises(NotProven):
        prove_pose(square_root, CaseNumbers({}), constants([arb(drive)]), [guess, 0.0])


def test_a_proven_pose_encloses_the_square_root_of_two():
    pose, half_width = prove_pose(square_root, CaseNumbers({}), constants([arb(2)]), [2**0.5, 0.0])
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
