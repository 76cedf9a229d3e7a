"""The reference of a run is evaluated once for all solvers, at the prescribed drive values."""

import os
import sys
from dataclasses import replace
from functools import wraps

import numpy as np
import pytest

from proofmass.analytic import balancer, rods
from proofmass.analytic.remember import current_memory, kept_evaluations
from proofmass.check import Result
from proofmass.compare import (
    RunReference,
    attach_reference,
    compare,
    last_references,
    run_reference,
)
from proofmass.errors import InputError
from proofmass.plot_data import plot_data
from proofmass.reference import evaluate, properties, reference_identity, run_samples
from proofmass.refinement import refined_errors, refinement_runs
from proofmass.report import case_page
from proofmass.sidecar import load_case
from proofmass.sim.protocol import Curves
from proofmass.solve import plan_run
from tests.shipped import shipped

MODULE = sys.modules[RunReference.__module__]
FOURBAR = load_case(shipped("fourbar.toml"))
X = plan_run(FOURBAR, "sweep", "mujoco").x[::90]
LED = plan_run(FOURBAR, "sweep", "mujoco").motion(X)
LATE = (LED[0] - 1e-3, *LED[1:])


def of_fourbar(drive=LED) -> RunReference:
    """The reference of a sweep of the four-bar for a solver with these values of the drive."""
    return RunReference(FOURBAR, "sweep", Curves(X, {}, drive=drive))


def same(one: dict, other: dict) -> bool:
    """Whether two sets of curves have the same names and the same bits."""
    return one.keys() == other.keys() and all(np.array_equal(one[n], other[n]) for n in one)


def test_its_drives_are_where_their_laws_lead_them_whatever_a_solver_did():
    """The values that a solver reaches, here lagging ones, do not matter."""
    reference = of_fourbar(LATE)
    assert np.array_equal(reference.state, LED)
    assert same(reference.unchanged, evaluate(FOURBAR, "sweep", X, LED).channels)


def test_a_run_whose_solver_has_no_drive_is_a_free_one():
    case = load_case(shipped("pendulum.toml"))
    x = np.linspace(0.0, 0.1, 3)
    reference = RunReference(case, "dynamics", Curves(x, {}))
    assert reference.state is None
    assert reference.x is x
    assert same(reference.as_driven(None).channels, evaluate(case, "sweep", x, None).channels)
    held = load_case(shipped("rfr3.toml"))  # its motors are at rest; no engine reports them
    curves = Curves(np.zeros(2), {})
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(MODULE, "evaluate", lambda case, kind, x, state, **changed: Curves(x, {}))
        assert RunReference(held, "equilibrium", curves).state is None


def test_a_solver_that_follows_the_laws_is_held_against_what_is_known(monkeypatch):
    reference = of_fourbar()
    monkeypatch.setattr(MODULE, "evaluate", None)
    found = reference.as_driven(tuple(part.copy() for part in LED))
    assert found.channels is reference.unchanged
    assert found.x is X


def test_a_solver_that_does_not_is_held_against_the_reference_where_it_was():
    reference = of_fourbar()
    found = reference.as_driven(LATE)
    assert found.x is X
    assert same(found.channels, evaluate(FOURBAR, "sweep", X, LATE).channels)
    assert not np.array_equal(found.channels["rocker"], reference.unchanged["rocker"])


def test_laws_that_lead_out_of_the_reference_cost_only_what_is_found_there(monkeypatch):
    """A solver that lags may be at drive values for which there is a reference."""

    def up_to_here(case, kind, x, state, **changed):
        if state is LED or np.array_equal(state, LED):
            raise InputError(case.file, "drive", "out of reach")
        return evaluate(case, kind, x, state, **changed)

    monkeypatch.setattr(MODULE, "evaluate", up_to_here)
    reference = of_fourbar()
    assert reference.unchanged == {}
    assert reference.differences("crank", 1e-6) == []
    assert same(reference.as_driven(LATE).channels, evaluate(FOURBAR, "sweep", X, LATE).channels)
    with pytest.raises(InputError, match="out of reach"):
        reference.as_driven(LED)


def test_searches_are_kept_from_the_unchanged_reference_alone(monkeypatch):
    """Otherwise last digits would depend on the changes that another solver asked for before."""
    used = []

    def evaluated(case, kind, x, state, **changed):
        used.append((current_memory.get(), changed))
        return Curves(x, {"y": np.zeros(x.size)})

    monkeypatch.setattr(MODULE, "evaluate", evaluated)
    reference = of_fourbar()
    reference.differences("crank", 1e-6)
    reference.as_driven(LATE)
    memory = reference.memory
    assert [kept is memory and more for (kept, more), _ in used] == [True, False, False]
    assert all(kept is memory for (kept, _), _ in used)
    crank = FOURBAR.parameters["crank"]
    assert [changed for _, changed in used] == [{}, {"crank": crank * (1.0 + 1e-6)}, {}]
    assert current_memory.get(None) is None


def test_a_change_is_evaluated_once(monkeypatch):
    reference = of_fourbar()
    first = reference.differences("crank", 1e-6)
    monkeypatch.setattr(MODULE, "evaluate", None)
    assert same(reference.differences("crank", 1e-6)[0], first[0])
    changed = evaluate(FOURBAR, "sweep", X, LED, crank=FOURBAR.parameters["crank"] * (1.0 + 1e-6))
    rocker = changed.channels["rocker"] - reference.unchanged["rocker"]
    assert np.array_equal(first[0]["rocker"], rocker)


def test_the_solvers_of_a_run_share_it_and_another_run_has_its_own():
    curves = Curves(X, {}, drive=LED)
    first = run_reference(FOURBAR, "sweep", curves)
    assert run_reference(FOURBAR, "sweep", replace(curves, drive=LATE)) is first
    wider = FOURBAR.model_copy(update={"tolerance": (), "settings": {}})
    assert run_reference(wider, "sweep", curves) is first
    assert run_reference(FOURBAR, "dynamics", curves) is not first
    shorter = run_reference(FOURBAR, "sweep", Curves(X[:2], {}, drive=LED))
    assert shorter.x.size == 2
    assert len(last_references) == 1
    longer = FOURBAR.model_copy(update={"parameters": FOURBAR.parameters | {"crank": 1.01}})
    assert run_reference(longer, "sweep", curves).parameters["crank"] == 1.01


@pytest.mark.parametrize(
    ("name", "file"),
    [("fourbar", "fourbar.xml"), ("hacksaw_recorded", "hacksaw_recorded.csv")],
)
def test_a_file_that_is_written_anew_makes_another_case(name, file, models):
    """The file is a model, or a recorded curve, that is written anew under the same name."""
    case = load_case(models / f"{name}.toml")
    before = reference_identity(case)
    assert reference_identity(case) == before
    later = (models / file).stat().st_mtime_ns + 10**9
    os.utime(models / file, ns=(later, later))
    assert reference_identity(case) != before


def test_what_a_reference_does_not_depend_on_makes_no_other_case():
    update = {"tolerance": (), "settings": {"mujoco": {"timestep": 1e-4}}}
    assert reference_identity(FOURBAR.model_copy(update=update)) == reference_identity(FOURBAR)
    assert reference_identity(FOURBAR.model_copy(update={"start": "other"})) != reference_identity(
        FOURBAR
    )


def test_views_show_the_reference_that_was_compared(monkeypatch):
    """Quantities that views show in addition to channels are stored, and not evaluated again."""
    case = load_case(shipped("balancer_weight.toml"))
    x = plan_run(case, "sweep", "mujoco").x[::30]
    state = plan_run(case, "sweep", "mujoco").motion(x)
    truth = evaluate(case, "sweep", x, state)
    assert truth.shown.keys() == {"energy1", "energy2", "energy3", "weight_energy"}
    curves = Curves(x, truth.channels, drive=state)
    asked = []
    solve = balancer.solve
    monkeypatch.setattr(
        balancer, "solve", wraps(solve)(lambda *a, **k: asked.append(k) or solve(*a, **k))
    )
    kept_evaluations.clear()
    compare(case, "sweep", "mujoco", curves, detectable=False)
    assert len(asked) == 1
    own = attach_reference(case, "sweep", curves)
    for view in case.view:
        found = plot_data(case, view, own, reference=Curves(x, own.reference)).values
        assert found.keys() == {view.x, *view.y, *view.stack, *view.dashed}
    assert len(asked) == 1


def test_facts_come_with_the_curves_that_were_compared():
    """A motion that was computed for a comparison is not computed again for a page."""
    case = load_case(shipped("heavy_top.toml"))
    x = run_samples(case, "dynamics")
    curves = Curves(x, evaluate(case, "dynamics", x, None).channels)
    compare(case, "dynamics", "mujoco", curves, detectable=False)
    assert attach_reference(case, "dynamics", curves).properties is None
    compare(case, "dynamics", "mujoco", curves)
    own = attach_reference(case, "dynamics", curves)
    assert own.properties == properties(case)
    assert "energy" in own.properties
    beyond = True  # no worker evaluates properties then
    for kept, shown in ((curves, {}), (own, own.properties)):
        result = Result([case], curves={(case.name, "dynamics", "mujoco"): kept})
        assert case_page.properties_of(case, result, beyond) == shown


def test_a_refinement_asks_for_its_reference_once(monkeypatch):
    """Its runs differ in numbers of segments, on which a closed form does not depend."""
    case = load_case(shipped("rod_cantilever.toml"))
    x = np.linspace(0.0, case.rods[0].length, 5)
    asked, solve = [], rods.solve
    monkeypatch.setattr(
        rods, "solve", wraps(solve)(lambda *a, **k: asked.append(k) or solve(*a, **k))
    )
    kept_evaluations.clear()
    found = [
        refined_errors(task.case, task.kind, task.solver, Curves(x, {}))
        for task in refinement_runs(case)
    ]
    assert len(found) > 2
    assert len(asked) == 1
