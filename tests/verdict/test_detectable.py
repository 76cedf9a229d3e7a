"""Statements of a page on parameters are true: smallest noticed change, not checked, not known.

The reference at the true parameters takes the place of an engine without errors.  Its comparison
with the reference at a changed parameter shows how the change affects the outcomes.
"""

import sys

import numpy as np
import pytest

from proofmass.base.errors import InputError
from proofmass.base.recording import Recorded
from proofmass.case.case import Case
from proofmass.reference.evaluate import evaluate
from proofmass.reference.find import load_reference
from proofmass.reference.reference_curves import ReferenceCurves
from proofmass.reference.run_reference import RunReference, changeable_parameters
from proofmass.reference.samples import run_samples
from proofmass.report.tables import (
    format_detectable_changes,
    unknown_parameters,
    unnoticed_parameters,
)
from proofmass.run.sidecar import load_case
from proofmass.run.solve import plan_run
from proofmass.sim.protocol.curves import Curves
from proofmass.verdict.compare import compare, compare_channel
from proofmass.verdict.comparison import Comparison, DetectableChange
from proofmass.verdict.detectable import (
    detectable_changes,
    large_detectable,
    parameter_slopes,
    small_detectable,
)
from tests.shipped import fewer_samples, shipped, shipped_files

QUICK_CASES = (
    "fivebar",
    "rod_cantilever",
    "rod_buckled",
    "balancer_progressive_locked",
    "slider_crank",
    "change_point",
    "pendulum",
)
"""Cases with a parameter that is 0, lengths that can only grow, a stiffness that can only grow, a
parameter whose effect is only rounding, loads that do not affect the channels of dynamics, and a
parameter whose change changes the class of the linkage."""


def exact_curves(case: Case, kind) -> Curves:
    """The curves of an engine without errors."""
    x = run_samples(case, kind)
    state = plan_run(case, kind, case.run[kind].solvers[0]).motion(x) if case.drive else None
    state = None if kind == "equilibrium" else state
    return Curves(x, evaluate(case, kind, x, state).channels, drive=state)


def comparisons_with(
    case: Case, kind, solver: str, curves: Curves, truth: Curves
) -> list[Comparison]:
    """Comparisons of curves with any reference, without detectable changes."""
    return [
        compare_channel(case, kind, solver, name, curves, truth.channels[name], {})
        for name in case.channels_of(kind)
    ]


def differing_channels(
    case: Case, kind, solver: str, curves: Curves, **changed: float
) -> set[str] | None:
    """Channels that differ from the reference at changed parameters; None if it does not exist."""
    try:
        other = evaluate(case, kind, curves.x, curves.drive, **changed)
    except InputError:
        return None
    return {
        c.channel
        for c in comparisons_with(case, kind, solver, curves, other)
        if c.outcome == "differs"
    }


def check_statements(case: Case, kind, solver: str, curves: Curves, all_channels: bool) -> int:
    """Assert that the statements of the page on the parameters are true for curves of a solver.

    Of the channels that notice a parameter, all are tried, or only those that notice the smallest
    and the largest change.  Returns the number of statements that were tried; it is 0 if no channel
    of the solver has a tolerance.
    """
    found = [c for c in compare(case, kind, solver, curves) if np.isfinite(c.allowed)]
    if not found:
        return 0
    count = 0
    assert {c.outcome for c in found} == {"agrees"}
    parameters = changeable_parameters(case)
    largest = max(map(abs, parameters.values()), default=0.0)

    def differ(key: str, by: float) -> list[set[str]]:
        sides = (
            differing_channels(case, kind, solver, curves, **{key: parameters[key] + sign * by})
            for sign in (1, -1)
        )
        return [side for side in sides if side is not None]

    never, unknown = unnoticed_parameters(case, found), unknown_parameters(case, found)
    for key, value in parameters.items():
        scale = abs(value) or largest
        if key in never:
            sides = differ(key, 0.1 * scale)
            assert sides, (key, "has no reference at changed values")
            assert not set().union(*sides), (key, "moves a channel beyond its tolerance")
            count += 1
            continue
        if key in unknown:
            assert not differ(key, 0.1 * scale), (key, "could be known")
            assert not differ(key, 1e-6 * scale), (key, "could be known")
            count += 1
            continue
        noticing = sorted(
            (c for c in found if key in c.detectable and not np.isnan(c.detectable[key].size)),
            key=lambda c: c.detectable[key].size,
        )
        for c in noticing if all_channels else [noticing[0], *noticing[1:][-1:]]:
            change = c.detectable[key]
            assert change.relative == (value != 0)
            by = change.size * (abs(value) if change.relative else 1.0)
            # three times the change, as in `test_mutations`, or less if there is no such mechanism
            sides = next(s for s in (differ(key, n * by) for n in (3.0, 1.5, 1.0)) if s)
            assert c.channel in set().union(*sides), (key, c.channel, change)
            count += 1
    assert count >= len(parameters)
    return count


CASES = sorted(file.stem for file in shipped_files())


def reason_without_statements(case: Case) -> str:
    """Why a page says nothing on parameters, by the sidecar alone; empty if it says something."""
    if isinstance(load_reference(case), Recorded):
        return "a recorded curve has no parameters"
    if not case.parameters:
        return "the reference reads the numbers of the model"
    tolerances = [
        case.tolerance_for(kind, solver, name)
        for kind, run in case.run.items()
        for solver in run.solvers
        for name in case.channels_of(kind)
    ]
    return "" if any(tolerances) else "no channel has a tolerance"


def check_every_run(name: str, all_channels: bool, few: bool = False) -> None:
    """Check all runs of a case; with `few` at a tenth of the samples of a balancer's sweep.

    At least one statement is tried, unless the case has a reason in `reason_without_statements`.
    """
    case, checked = load_case(shipped(f"{name}.toml")), 0
    if few and case.reference == "balancer":
        sweep = case.run["sweep"].model_copy(update={"n": fewer_samples(case.run["sweep"].n)})
        case = case.model_copy(update={"run": {"sweep": sweep}})
    for kind, run in case.run.items():
        curves, seen = exact_curves(case, kind), set()
        for solver in run.solvers:  # solvers with equal tolerances give equal results
            tolerances = str(
                [
                    case.tolerance_for(kind, solver, n)
                    and case.tolerance_for(kind, solver, n).allowed(1.0)
                    for n in case.channels_of(kind)
                ]
            )
            if tolerances not in seen:
                checked += check_statements(case, kind, solver, curves, all_channels)
            seen.add(tolerances)
    reason = reason_without_statements(case)
    assert (checked > 0) == (not reason), (name, checked, reason)


@pytest.mark.parametrize("name", QUICK_CASES)
def test_statements_on_parameters_hold_for_changed_parameters(name):
    check_every_run(name, all_channels=False, few=True)


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("hacksaw_recorded", "a recorded curve has no parameters"),
        ("peaucellier", "the reference reads the numbers of the model"),
        ("balls_touching", "no channel has a tolerance"),
    ],
)
def test_a_case_without_statements_has_a_reason(name, reason):
    assert reason_without_statements(load_case(shipped(f"{name}.toml"))) == reason
    check_every_run(name, all_channels=False)


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_statements_on_parameters_of_all_cases_hold_for_changed_ones(name):
    # an equilibrium of rods at changed parameters takes up to several seconds
    check_every_run(name, all_channels=not load_case(shipped(f"{name}.toml")).rod)


def differences_within(curve, low: float = -np.inf, high: float = np.inf):
    """Differences of one channel as a function of the share of a change, for `large_detectable`.

    There are no differences for shares beyond the two bounds.
    """
    return lambda share: [{"y": np.array([float(curve(share))])}] if low <= share <= high else []


def test_a_slope_is_of_second_order_from_both_sides_or_from_one():
    def curve(share: float) -> float:  # slope 3, and curvature, which cancels from both sides
        return 3.0 * share + 1e4 * share**2

    for low, high in ((-1.0, 1.0), (0.0, 1.0), (-1.0, 0.0)):
        found, asked = small_detectable(differences_within(curve, low, high), {"y": 3e-9})
        # one-sided differences are of second order: of first order they would be off by 3e-3
        assert found == {"y": pytest.approx(1e-9, rel=1e-8, abs=0)}
        assert not asked


def test_slopes_are_not_extrapolated_beyond_ten_per_cent():
    """By the slope of tanh a change by 1.5 would be noticed, but tanh never reaches 1.5."""
    curve = np.tanh
    assert small_detectable(differences_within(curve), {"y": 1.5}) == ({}, {"y": 1.5})
    assert large_detectable(differences_within(curve), {"y": 1.5}) == {}
    assert small_detectable(differences_within(curve), {"y": 0.3})[0] == {}
    assert small_detectable(differences_within(curve), {"y": 0.09})[0] == {
        "y": pytest.approx(0.09, rel=1e-6)
    }


def test_a_single_available_step_gives_a_difference_and_no_slope():
    """If only one step exists, it is the change if its difference exceeds the tolerance."""

    def asked(high: float, most: float):
        return small_detectable(
            differences_within(lambda share: 3.0 * share, 0.0, high), {"y": most}
        )

    # one step gives no curvature, so it counts as a difference, not as a slope
    assert asked(1.5e-6, 2e-6) == ({"y": 1e-6}, {})
    assert asked(1.5e-6, 4e-6) == ({}, {"y": 4e-6})
    assert asked(0.5e-6, 1e-6) == ({}, {"y": 1e-6})  # no step exists


@pytest.mark.parametrize(("bend", "smooth"), [(0.19e6, True), (0.21e6, False)])
@pytest.mark.parametrize("low", [-1.0, 0.0])
def test_a_curve_is_smooth_if_it_bends_by_less_than_a_tenth_of_its_slope(bend, smooth, low):
    """Within the step of 1e-6 the slope changes by half the second derivative times 1e-6."""
    found = parameter_slopes(differences_within(lambda share: share + bend / 2 * share**2, low))[
        "y"
    ]
    assert found[1] is smooth
    most = 1e-6 * (1 if smooth else 1 + bend / 2 * 1e-6)
    assert found[0] == pytest.approx(most, rel=1e-9, abs=0)


def test_channels_are_judged_one_by_one():
    """Rounding hides the slope of one channel, another has a slope, the third does not change."""

    def moved(share: float):
        return [
            {
                "hidden": np.array([1e-15 * (share > 0)]),
                "told": np.array([share]),
                "none": np.array([0.0]),
            }
        ]

    found, asked = small_detectable(moved, {"hidden": 1e-12, "told": 1e-3, "none": 1e-3})
    assert found == {"told": pytest.approx(1e-3)}
    assert asked == {"hidden": 1e-12}
    assert large_detectable(lambda share: [{"y": np.array([share < 0])}], {"y": 0.5}) == {"y": 1e-5}


def test_a_jump_is_detectable_at_the_step_that_shows_it():
    assert small_detectable(differences_within(lambda share: abs(share) > 0), {"y": 0.5}) == (
        {"y": 1e-6},
        {},
    )


def test_a_slope_that_rounding_hides_is_tried_with_large_changes():
    found, asked = small_detectable(
        differences_within(lambda share: 1e-15 * (share > 0)), {"y": 1e-12}
    )
    assert (found, asked) == ({}, {"y": 1e-12})
    assert large_detectable(differences_within(lambda share: 1e-15), {"y": 1e-12}) == {}


@pytest.mark.parametrize(
    ("curve", "low", "high", "found"),
    [
        (lambda share: 0.0, -1.0, 1.0, {}),  # not even 10 % is noticed
        (lambda share: abs(share) > 0.005, -1.0, 1.0, {"y": 0.01}),  # a joint limit that is reached
        (lambda share: abs(share) > 0.005, 0.0, 1.0, {"y": 0.01}),
        (lambda share: 0.0, -0.01, 0.01, {"y": np.nan}),  # 10 % cannot be evaluated
        (lambda share: 1.0, -0.01, 0.01, {"y": 1e-5}),
        (lambda share: 0.0, 1.0, 0.0, {"y": np.nan}),  # no change can be evaluated
        (lambda share: np.nan, -1.0, 1.0, {"y": np.nan}),
    ],
)
def test_the_smallest_detectable_large_change_is_found(curve, low, high, found):
    assert large_detectable(differences_within(curve, low, high), {"y": 0.5}) == pytest.approx(
        found, nan_ok=True
    )


@pytest.mark.parametrize(
    ("name", "key", "begin"),
    [
        ("rod_cantilever", "length", ""),
        ("rod_buckled", "length", ""),
        ("fivebar", "left_x", "0 ± "),
    ],
)
def test_the_page_states_detectable_changes(name, key, begin):
    case = load_case(shipped(f"{name}.toml"))
    kind = next(iter(case.run))
    found = compare(case, kind, "mujoco", exact_curves(case, kind))
    assert key not in unnoticed_parameters(case, found) + unknown_parameters(case, found)
    words = [dict(format_detectable_changes(c)[1])[key] for c in found]
    assert all(word.startswith(begin) for word in words)
    assert all(0.0 < float(word.removeprefix(begin)) < 0.1 for word in words)


def test_the_page_states_which_parameters_are_not_known():
    """The reference accepts a joint limit that carries a preload only at the value 0."""
    case = load_case(shipped("balancer_sine_preload.toml"))
    found = compare(case, "sweep", "mujoco", exact_curves(case, "sweep"))
    assert unknown_parameters(case, found) == ["low2"]
    assert unnoticed_parameters(case, found) == []
    assert all(dict(format_detectable_changes(c)[1])["low2"] == "not known" for c in found)
    assert format_detectable_changes(found[0])[0].split()[1] != "not"


def test_whole_numbers_and_texts_are_not_changeable_parameters():
    assert set(changeable_parameters(load_case(shipped("rfr3.toml")))) == {
        "side",
        "radius",
        "theta1",
        "theta2",
        "theta3",
        "length",
        "stiffness",
        "force_y",
    }
    assert "target" not in changeable_parameters(load_case(shipped("balancer_sine.toml")))


def test_a_mode_is_not_changeable_and_an_undeclared_parameter_is():
    fourbar = load_case(shipped("fourbar.toml"))
    assert "mode" not in changeable_parameters(fourbar)
    more = {**fourbar.parameters, "unknown": 2.0}
    assert changeable_parameters(fourbar.model_copy(update={"parameters": more}))["unknown"] == 2.0


def test_changes_of_a_parameter_that_is_0_are_shares_of_the_largest():
    """Two parameters, 0 and -5: both steps are 5e-6; changes by 1e-3 and 1e-4 use up 1e-3."""
    case = load_case(shipped("fivebar.toml"))
    asked = []

    def evaluated(case, kind, x, state, **changed):
        asked.append(changed)
        key, value = next(iter(changed.items()), ("none", 0.0))
        return ReferenceCurves(
            x, {"y": np.array([value if key == "none" else 2.0 * (value + 5.0)])}
        )

    with pytest.MonkeyPatch.context() as patch:
        module = sys.modules[RunReference.__module__]
        patch.setattr(module, "evaluate", evaluated)
        patch.setattr(module, "changeable_parameters", lambda case: {"none": 0.0, "some": -5.0})
        curves = Curves(np.zeros(1), {"y": np.zeros(1)})
        found = detectable_changes(RunReference(case, "equilibrium", curves), {"y": 1e-3})
        assert asked[0] == {}
        assert asked[1] == {"none": pytest.approx(5e-6)}
        assert asked[3] == {"some": pytest.approx(-5.0 + 5e-6, abs=1e-12)}
        assert found["y"]["none"] == DetectableChange(pytest.approx(1e-3), relative=False)
        assert found["y"]["some"] == DetectableChange(pytest.approx(1e-4), relative=True)
        patch.setattr(module, "changeable_parameters", lambda case: {})
        assert detectable_changes(RunReference(case, "sweep", curves), {"y": 1e-3}) == {"y": {}}
