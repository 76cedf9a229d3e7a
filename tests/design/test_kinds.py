"""All kinds of balancers as one batch: the same errors as kind by kind, and true derivatives."""

import numpy as np
import pytest

from proofmass.analytic.balancer.measures import TARGETS
from proofmass.analytic.balancer.synthesis import Synthesis, Variant
from proofmass.design.kinds import (
    KindsProblem,
    KindsSearch,
    all_kinds,
    is_narrower,
)
from proofmass.design.search import Effort, scatter_places

SINE = TARGETS["sine"]


def random_rows(problem, each, seed=1):
    """Random rows of each kind."""
    kind = np.repeat(np.arange(len(problem.variants)), each)
    rows = scatter_places(kind.size, problem.low.size, np.random.default_rng(seed))
    rows[:, 0] = problem.codes(kind)
    return rows


def vectors_of(problem, variant, parameters):
    """Vectors of a kind from parameters of its rows."""
    shared = ("stiffness", "quadratic")
    return np.stack([parameters[n + "1" if n in shared else n] for n in variant.usual], -1)


@pytest.mark.parametrize(
    ("segments", "extension"), [(2, (0.0, 0.05)), (3, (0.0, 0.0)), (4, (0, 0))]
)
def test_rows_have_the_errors_of_their_kinds(segments, extension):
    """A batch of all kinds, against each kind alone with its own vector and strides."""
    kinds = all_kinds([segments], extension=extension)[:: 1 if segments == 2 else 7]
    problem = KindsProblem(kinds, SINE, points=6)
    rows = random_rows(problem, 6)
    found, kind = problem.residuals(rows), problem.kind_numbers(rows)
    parameters = problem.parameters(kind, problem.designs(rows))
    compared = 0
    for k, variant in enumerate(kinds):
        own = {name: values[kind == k] for name, values in parameters.items()}
        alone = Synthesis(variant, SINE, points=6).residuals(vectors_of(problem, variant, own))
        both = np.isfinite(alone[:, 0])
        assert np.array_equal(both, np.isfinite(found[kind == k][:, 0]))
        assert found[kind == k][both] == pytest.approx(alone[both], abs=1e-11)  # Newton's tolerance
        compared += both.sum()
    assert compared > len(kinds) / 2


def test_derivatives_are_those_of_central_differences():
    problem = KindsProblem(all_kinds([3], ["each"])[::5], SINE, points=6)
    rows = random_rows(problem, 6)
    rows = rows[np.isfinite(problem.residuals(rows)[:, 0])][:12]
    rows[:, 1:] = np.clip(rows[:, 1:], 1e-3, 1 - 1e-3)
    terms, slopes = problem.linearize(rows, coarse=False)
    assert terms == pytest.approx(problem.residuals(rows), abs=1e-12)
    step, errors = 1e-6, []
    for j in range(1, rows.shape[1]):
        unit = step * np.eye(rows.shape[1])[j]
        rise = problem.residuals(rows + unit) - problem.residuals(rows - unit)
        errors.append(np.abs(rise / (2 * step) - slopes[:, j]))
    # a difference over a stop that switches is no derivative: a few of the rows have one
    assert np.mean(np.array(errors) < 1e-6) > 0.95
    assert np.abs(slopes).max() > 0.1


def test_a_narrower_kind_has_less_freedom():
    wide = Variant("", 3, "each", (2,), True, True, True)
    assert is_narrower(Variant("", 3), wide)
    assert not is_narrower(wide, Variant("", 3))
    assert not is_narrower(wide, wide)
    assert not is_narrower(Variant("", 3, mode=-1), wide)
    assert not is_narrower(Variant("", 4), wide)


def test_a_design_fits_the_kinds_that_have_its_parts():
    kinds = all_kinds([3])
    problem = KindsProblem(kinds, SINE)
    chain = {"length1": 0.4, "length2": 0.4, "length3": 0.4}
    chain |= {"stiffness1": 1.0, "stiffness2": 0.0, "stiffness3": 2.0}
    plain, stopped, curved, long = problem.fits(
        [
            chain,
            chain | {"preload2": 0.1, "low2": 0.0},
            chain | {"quadratic1": 0.1},
            chain | {"length3": 0.6},
        ]
    ).T
    for k, kind in enumerate(kinds):
        up = kind.mode == 1
        assert plain[k] == (up and kind.springs != "nonlinear")
        assert stopped[k] == (plain[k] and kind.preload == (2,))
        assert curved[k] == (up and kind.springs == "each")
        assert long[k] == (plain[k] and kind.relaxed)


def test_bounds_hold_in_the_kinds_that_have_the_parameter():
    kinds = all_kinds(narrowed={"length4": (0.3, 0.31)})
    assert {bool(kind.narrowed) for kind in kinds if kind.segments == 4} == {True}
    assert not any(kind.narrowed for kind in kinds if kind.segments < 4)
    with pytest.raises(ValueError, match="'mass': no kind has such a parameter"):
        all_kinds(narrowed={"mass": (0.0, 1.0)})
    with pytest.raises(ValueError, match="segments must be 2, 3 or 4, got 5"):
        all_kinds([5])


def test_a_wider_kind_is_never_worse():
    """Kinds take over what narrower ones found; without that some would be worse."""
    kinds = [
        k for k in all_kinds([3], ["linear"]) if not k.preload and not k.contact and k.mode == 1
    ]
    search = KindsSearch(KindsProblem(kinds, SINE, 6), Effort(((4, 2), (1, 3)), 1, implicit=True))
    search.run()
    number = search.problem.kind_numbers(search.state.places)
    least = [search.state.values[number == k].min() for k in range(len(kinds))]
    pairs = [(i, j) for i, a in enumerate(kinds) for j, b in enumerate(kinds) if is_narrower(a, b)]
    assert len(pairs) == 5
    assert all(least[j] <= least[i] * (1 + 1e-12) for i, j in pairs)
