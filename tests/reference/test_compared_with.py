"""The sentences on what a case is compared with."""

import pytest

from proofmass import load_case
from proofmass.analytic.protocol import OwnError, Reference
from proofmass.reference.compared_with import (
    UNKNOWN_ERROR,
    compared_with,
    describe_own_error,
    describe_proof,
)
from proofmass.reference.find import find_reference, reference_names
from proofmass.reference.proven import proven_errors
from tests.shipped import shipped


@pytest.mark.parametrize(
    ("file", "name", "independent"),
    [
        ("fourbar.toml", "the closed form", True),
        ("stewart.toml", "the general solver of mechanisms in space", False),
        ("fourbar_released.toml", "the general solver of planar linkages", False),
        ("tumbling_box.toml", "the model's own equations, solved without time steps", False),
        ("hacksaw_recorded.toml", "recorded curves", True),
        ("rfr2_natural.toml", "the solver of the elastica between a clamp and a common pin", True),
    ],
)
def test_a_case_says_what_it_is_compared_with(file, name, independent):
    case = load_case(shipped(file))
    found = compared_with(case)
    assert (found.name, found.independent) == (name, independent)
    assert found.independent != case.reads_model
    assert case.model_path.name in found.reads
    assert found.sentence.startswith(f"Compared with {name} (")


def test_every_reference_says_how_its_curves_are_found():
    methods = {name: find_reference(name).method for name in reference_names()}
    assert Reference.method not in methods.values()
    assert all(words == words.strip(". ") and len(words) < 70 for words in methods.values())
    assert methods["fourbar"] == "closed form"


def test_a_proven_error_is_told_only_for_the_numbers_of_the_proof(monkeypatch):
    """The table is not used: on another machine a last bit may differ, so that it does not hold."""
    case = load_case(shipped("fourbar.toml"))
    other = case.model_copy(update={"parameters": {**case.parameters, "rocker": 2.6}})
    assert not any(proven_errors(other, kind) for kind in case.run)
    proven = {"sweep": {"position": 6e-16}, "dynamics": {"position": 2e-16, "moment": 3e-16}}
    where = "proofmass.reference.compared_with.proven_errors"
    monkeypatch.setattr(where, lambda of, kind: proven[kind] if of is case else {})
    told = compared_with(case).error
    assert told == (
        "Its own error is at most 6e-16 of a curve's range at every sample (position and moment), "
        "proven by ball arithmetic."
    )
    assert describe_proof(other) == ""
    assert "proven" not in compared_with(other).error
    assert "below 1e-12" in compared_with(other).error
    del proven["sweep"]["position"]  # a run without a proof
    assert describe_proof(case) == ""


def test_an_error_that_nobody_states_is_not_claimed():
    class Bare(Reference):
        """Nothing: at all."""

    assert describe_own_error(Bare, {}) == UNKNOWN_ERROR
    second = describe_own_error(Bare, {"second formulation": "terms agree"})
    assert second == "A second formulation confirms it: terms agree."
    Bare.own_error = OwnError(1e-9, "a limit")
    assert describe_own_error(Bare, {}) == (
        "Its own error is below 1e-9 of a curve's range, confirmed by a limit."
    )
