"""The reference of a run is evaluated once for all solvers, at the prescribed drive values."""

import os
import sys
from dataclasses import replace

import numpy as np
import pytest

from proofmass.analytic import balancer, rods
from proofmass.analytic.remember import current_memory, kept_evaluations
from proofmass.analytic.rods import rod_pair_driven
from proofmass.analytic.rods.continuation import follow
from proofmass.base.errors import InputError
from proofmass.batch.check import Result
from proofmass.reference.evaluate import evaluate, properties
from proofmass.reference.plot_data import plot_data
from proofmass.reference.run_reference import (
    RunReference,
    reference_identity,
    shared_reference,
    shared_references,
)
from proofmass.reference.samples import run_samples
from proofmass.report import case_page
from proofmass.run.sidecar import load_case
from proofmass.run.solve import plan_run
from proofmass.sim.protocol.curves import Curves
from proofmass.verdict.compare import compare
from proofmass.verdict.refinement import refined_errors, refinement_runs
from tests.shipped import shipped

REFERENCE_MODULE = sys.modules[RunReference.__module__]
FOURBAR = load_case(shipped("fourbar.toml"))
X = plan_run(FOURBAR, "sweep", "mujoco").x[::90]
PRESCRIBED = plan_run(FOURBAR, "sweep", "mujoco").motion(X)
LAGGING = (PRESCRIBED[0] - 1e-3, *PRESCRIBED[1:])


def fourbar_reference(drive=PRESCRIBED) -> RunReference:
    """The reference of a sweep of the four-bar for a solver with these values of the drive."""
    return RunReference(FOURBAR, "sweep", Curves(X, {}, drive=drive))


def equal_curves(one: dict, other: dict) -> bool:
    """Whether two sets of curves have the same names and the same bits."""
    return one.keys() == other.keys() and all(np.array_equal(one[n], other[n]) for n in one)


def test_the_drives_of_a_reference_have_their_prescribed_values():
    """The values that a solver reaches, here lagging ones, do not matter."""
    reference = fourbar_reference(LAGGING)
    assert np.array_equal(reference.state, PRESCRIBED)
    assert equal_curves(reference.unchanged, evaluate(FOURBAR, "sweep", X, PRESCRIBED).channels)


def test_a_run_without_drive_values_is_a_free_motion():
    case = load_case(shipped("pendulum.toml"))
    x = np.linspace(0.0, 0.1, 3)
    reference = RunReference(case, "dynamics", Curves(x, {}))
    assert reference.state is None
    assert reference.x is x
    assert equal_curves(
        reference.as_driven(None).channels, evaluate(case, "sweep", x, None).channels
    )
    driven = load_case(shipped("rfr3.toml"))  # its motors are at rest; no engine reports them
    curves = Curves(np.zeros(2), {})
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            REFERENCE_MODULE, "evaluate", lambda case, kind, x, state, **changed: Curves(x, {})
        )
        assert RunReference(driven, "equilibrium", curves).state is None


def test_a_solver_with_the_prescribed_values_needs_no_other_evaluation(monkeypatch):
    reference = fourbar_reference()
    monkeypatch.setattr(REFERENCE_MODULE, "evaluate", None)
    found = reference.as_driven(tuple(part.copy() for part in PRESCRIBED))
    assert found.channels is reference.unchanged
    assert found.x is X


def test_a_lagging_solver_is_compared_at_its_own_drive_values():
    reference = fourbar_reference()
    found = reference.as_driven(LAGGING)
    assert found.x is X
    assert equal_curves(found.channels, evaluate(FOURBAR, "sweep", X, LAGGING).channels)
    assert not np.array_equal(found.channels["rocker"], reference.unchanged["rocker"])


def test_prescribed_values_out_of_reach_do_not_affect_a_lagging_solver(monkeypatch):
    """A solver that lags may be at drive values for which there is a reference."""

    def up_to_here(case, kind, x, state, **changed):
        if state is PRESCRIBED or np.array_equal(state, PRESCRIBED):
            raise InputError(case.file, "drive", "out of reach")
        return evaluate(case, kind, x, state, **changed)

    monkeypatch.setattr(REFERENCE_MODULE, "evaluate", up_to_here)
    reference = fourbar_reference()
    assert reference.unchanged == {}
    assert reference.differences("crank", 1e-6) == []
    assert equal_curves(
        reference.as_driven(LAGGING).channels, evaluate(FOURBAR, "sweep", X, LAGGING).channels
    )
    with pytest.raises(InputError, match="out of reach"):
        reference.as_driven(PRESCRIBED)


def test_searches_of_the_unchanged_reference_alone_are_stored(monkeypatch):
    """Otherwise last digits would depend on the changes that another solver asked for before."""
    used = []

    def evaluated(case, kind, x, state, **changed):
        used.append((current_memory.get(), changed))
        return Curves(x, {"y": np.zeros(x.size)})

    monkeypatch.setattr(REFERENCE_MODULE, "evaluate", evaluated)
    reference = fourbar_reference()
    reference.differences("crank", 1e-6)
    reference.as_driven(LAGGING)
    memory = reference.memory
    assert [kept is memory and more for (kept, more), _ in used] == [True, False, False]
    assert all(kept is memory for (kept, _), _ in used)
    crank = FOURBAR.parameters["crank"]
    assert [changed for _, changed in used] == [{}, {"crank": crank * (1.0 + 1e-6)}, {}]
    assert current_memory.get(None) is None


def test_an_evaluation_before_a_comparison_costs_it_no_search(monkeypatch):
    """Searches at changed parameters begin from those of the unchanged one, in either order."""
    searches = []
    monkeypatch.setattr(
        rod_pair_driven,
        "follow",
        lambda *given, **more: searches.append(1) or follow(*given, **more),
    )
    plain = load_case(shipped("rfr2_circles.toml"))
    counts = []
    for k, evaluated_before in enumerate((False, True)):
        stiffness = plain.parameters["stiffness"] * (1.0 + 1e-3 * (k + 1))  # searched by no other
        case = plain.model_copy(update={"parameters": plain.parameters | {"stiffness": stiffness}})
        run = plan_run(case, "sweep", "mujoco")
        x = run.x[:4]
        searches.clear()
        if evaluated_before:
            evaluate(case, "sweep", x, run.motion(x))
        reference = RunReference(case, "sweep", Curves(x, {}, drive=run.motion(x)))
        alone = len(searches)
        for key in ("length", "distance", "stiffness"):
            assert reference.differences(key, 1e-6)
        counts.append((alone, len(searches)))
    assert counts == [(1, 1), (1, 1)]


def test_a_changed_parameter_is_evaluated_once(monkeypatch):
    reference = fourbar_reference()
    first = reference.differences("crank", 1e-6)
    monkeypatch.setattr(REFERENCE_MODULE, "evaluate", None)
    assert equal_curves(reference.differences("crank", 1e-6)[0], first[0])
    changed = evaluate(
        FOURBAR, "sweep", X, PRESCRIBED, crank=FOURBAR.parameters["crank"] * (1.0 + 1e-6)
    )
    rocker = changed.channels["rocker"] - reference.unchanged["rocker"]
    assert np.array_equal(first[0]["rocker"], rocker)


def test_solvers_of_a_run_share_its_reference_and_other_runs_do_not():
    curves = Curves(X, {}, drive=PRESCRIBED)
    first = shared_reference(FOURBAR, "sweep", curves)
    assert shared_reference(FOURBAR, "sweep", replace(curves, drive=LAGGING)) is first
    wider = FOURBAR.model_copy(update={"tolerance": (), "settings": {}})
    assert shared_reference(wider, "sweep", curves) is first
    assert shared_reference(FOURBAR, "dynamics", curves) is not first
    shorter = shared_reference(FOURBAR, "sweep", Curves(X[:2], {}, drive=PRESCRIBED))
    assert shorter.x.size == 2
    assert len(shared_references) == 1
    longer = FOURBAR.model_copy(update={"parameters": FOURBAR.parameters | {"crank": 1.01}})
    assert shared_reference(longer, "sweep", curves).parameters["crank"] == 1.01


@pytest.mark.parametrize(
    ("name", "file"),
    [("fourbar", "fourbar.xml"), ("hacksaw_recorded", "hacksaw_recorded.csv")],
)
def test_a_file_that_is_written_anew_changes_the_reference_identity(name, file, models):
    """The file is a model, or a recorded curve, that is written anew under the same name."""
    case = load_case(models / f"{name}.toml")
    before = reference_identity(case)
    assert reference_identity(case) == before
    text, state = (models / file).read_bytes(), (models / file).stat()
    (models / file).write_bytes(text[:-1] + b" ")  # of the same size and time of change
    os.utime(models / file, ns=(state.st_atime_ns, state.st_mtime_ns))
    assert reference_identity(case) != before
    (models / file).write_bytes(text)  # what counts is the content
    assert reference_identity(case) == before


def test_tolerances_and_settings_do_not_change_the_reference_identity():
    update = {"tolerance": (), "settings": {"mujoco": {"timestep": 1e-4}}}
    assert reference_identity(FOURBAR.model_copy(update=update)) == reference_identity(FOURBAR)
    assert reference_identity(FOURBAR.model_copy(update={"start": "other"})) != reference_identity(
        FOURBAR
    )


def test_views_reuse_the_reference_that_was_compared(monkeypatch):
    """Quantities that views show in addition to channels are stored, and not evaluated again."""
    case = load_case(shipped("balancer_weight.toml"))
    x = plan_run(case, "sweep", "mujoco").x[::30]
    state = plan_run(case, "sweep", "mujoco").motion(x)
    truth = evaluate(case, "sweep", x, state)
    assert truth.shown.keys() == {"energy1", "energy2", "energy3", "weight_energy"}
    curves = Curves(x, truth.channels, drive=state)
    calls = []
    solve = balancer.BalancerReference.function
    monkeypatch.setattr(
        balancer.BalancerReference,
        "function",
        staticmethod(lambda *a, **k: calls.append(k) or solve(*a, **k)),
    )
    kept_evaluations.clear()
    found = compare(case, "sweep", "mujoco", curves, detectable=False)
    assert len(calls) == 1
    own = found.join_reference(curves)
    for view in case.view:
        found = plot_data(case, view, own, reference=Curves(x, own.reference)).values
        assert found.keys() == {view.x, *view.y, *view.stack, *view.dashed}
    assert len(calls) == 1


def test_properties_come_with_the_curves_that_were_compared():
    """A motion that was computed for a comparison is not computed again for a page."""
    case = load_case(shipped("heavy_top.toml"))
    x = run_samples(case, "dynamics")
    curves = Curves(x, evaluate(case, "dynamics", x, None).channels)
    found = compare(case, "dynamics", "mujoco", curves, detectable=False)
    assert found.join_reference(curves).properties is None
    own = compare(case, "dynamics", "mujoco", curves).join_reference(curves)
    assert own.properties == properties(case)
    assert "energy" in own.properties
    beyond = True  # no worker evaluates properties then
    for kept, shown in ((curves, {}), (own, own.properties)):
        result = Result([case], curves={(case.name, "dynamics", "mujoco"): kept})
        assert case_page.properties_of(case, result, beyond) == shown


def test_a_refinement_evaluates_its_reference_once(monkeypatch):
    """Its runs differ in numbers of segments, on which a closed form does not depend."""
    case = load_case(shipped("rod_cantilever.toml"))
    x = np.linspace(0.0, case.rods[0].length, 5)
    calls, solve = [], rods.ClampedRod.function
    monkeypatch.setattr(
        rods.ClampedRod,
        "function",
        staticmethod(lambda *a, **k: calls.append(k) or solve(*a, **k)),
    )
    kept_evaluations.clear()
    found = [
        refined_errors(task.case, task.kind, task.solver, Curves(x, {}))
        for task in refinement_runs(case)
    ]
    assert len(found) > 2
    assert len(calls) == 1
