"""The general planar solver compared with every closed form of linkages, for random lengths."""

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, find, given, settings
from hypothesis import strategies as st

from proofmass.analytic.planar import solve
from proofmass.reference.find import find_reference, reference_names
from tests.analytic.linkages.random_linkages import FAMILIES, Linkage

AS_DRAWN = settings(derandomize=True, phases=[Phase.generate], database=None)
"""Settings for one linkage of a family, whichever it is: looking for the simplest takes seconds."""
RELAXED = settings(deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))


def assert_agreement(linkage: Linkage, inertia: bool) -> None:
    """Compare the general solver with the closed form, at given rates and accelerations.

    Closed forms have moments and forces from balances of bodies and virtual work, and the general
    solver from multipliers of the loops.
    """
    inputs = linkage.way.T
    rate, acceleration = 1.0 + 0.0 * inputs, np.cos(inputs)
    one = len(inputs) == 1
    state = (part[0] if one else part for part in (inputs, rate, acceleration))
    truth = linkage.solve(*state, inertia=inertia)
    found = solve(
        inputs, rate, acceleration, model=linkage.model, joints=linkage.joints, inertia=inertia
    )
    for channel, quantity in linkage.channels.items():
        error = np.abs(found[channel] - truth[quantity])
        if quantity.endswith("angle"):
            error = np.abs(np.exp(1j * found[channel]) - np.exp(1j * truth[quantity]))
        # 1e-12 of the curve's size: rounding times the cube of 1 / CLEAR, at worst 300 eps
        assert error.max() < 1e-12 * max(1.0, np.abs(truth[quantity]).max()), channel


@pytest.mark.parametrize("mechanisms", [8, pytest.param(1000, marks=pytest.mark.slow)])
@pytest.mark.parametrize("family", FAMILIES)
def test_the_general_solver_agrees_with_the_closed_form(family, mechanisms):
    @settings(RELAXED, max_examples=mechanisms)
    @given(FAMILIES[family], st.booleans())
    def run(linkage, inertia):
        assert_agreement(linkage, inertia)

    run()


def test_references_that_claim_this_confirmation_are_confirmed_here():
    """A linkage calls the module of its closed form, which has the name of the reference."""
    claimed = {
        name
        for name in reference_names()
        if (own := find_reference(name).own_error) and "random lengths" in own.confirmed_by
    }
    solvers = (find(one, lambda _: True, settings=AS_DRAWN).solve for one in FAMILIES.values())
    assert claimed == {solve.__code__.co_names[0] for solve in solvers}
