"""Tests that engines decide all outcomes: an idle engine, or one with stiffer springs, differs."""

from dataclasses import replace

import mujoco
import pymunk
import pytest

from proofmass.case import Case
from proofmass.compare import compare
from proofmass.drive import check_driven
from proofmass.engines import computes_curves
from proofmass.errors import InputError
from proofmass.outcome import OUTCOME_OF_EXCEPTION
from proofmass.reference import compiled_model
from proofmass.sim.mujoco import model as mujoco_model
from proofmass.sim.mujoco.linkage import STATIC_STAGES
from proofmass.sim.protocol import BadModel
from proofmass.sim.pymunk import model as pymunk_model
from proofmass.sim.pymunk import space
from proofmass.solve import call_engine, plan_run
from tests.shipped import fewer_samples, loaded, models_like

CASES = {file.stem: loaded(file) for file in models_like()}
RUNS = [
    (name, kind, solver)
    for name, case in CASES.items()
    for kind, run in case.run.items()
    for solver in run.solvers
    if computes_curves(solver)  # recorded curves are changed in `test_recorded`
]
MUJOCO = (
    "mj_step",
    "mj_step1",
    "mj_step2",
    "mj_forward",
    "mj_fwdPosition",
    "mj_fwdVelocity",
    "mj_fwdActuation",
    "mj_inverse",
    "mj_jacDot",
    "mj_fullM",
    *STATIC_STAGES,
)
"""All functions of MuJoCo by which `sim` computes with a pose, with time steps and without."""
FAILED = (InputError, BadModel, *OUTCOME_OF_EXCEPTION)


def outcomes(case: Case, kind: str, solver: str, monkeypatch, **changed) -> set[str]:
    """Outcomes of the channels with a tolerance, or of the run if it gives no curves."""
    run = replace(plan_run(case, kind, solver), **changed)
    try:
        curves = call_engine(solver.partition(":")[0], case.model_path, run)
        check_driven(run, curves)
    except FAILED as error:
        return {OUTCOME_OF_EXCEPTION.get(type(error), "bad input")}
    monkeypatch.undo()  # the reference may read the model by the engine's own functions
    return {
        c.outcome for c in compare(case, kind, solver, curves, detectable=False) if c.allowed > 0
    }


def checked(name: str, kind: str, solver: str) -> bool:
    """Whether any channel of a run has a tolerance for this solver."""
    case = CASES[name]
    return any(case.tolerance_for(kind, solver, c) for c in case.channels_of(kind))


def stopped(monkeypatch, engine: str) -> None:
    """Make an engine idle: its functions leave all data as they are."""
    if engine == "pymunk":
        monkeypatch.setattr(pymunk.Space, "step", lambda space, dt: None)
    else:
        for name in MUJOCO:
            monkeypatch.setattr(mujoco, name, lambda *_, **__: None)


CHECKED = [run for run in RUNS if checked(*run)]
LONG = ("rod_snap", "rod_taut", "rod_sheared", "rfr2_circles", "rfr2_rectangles", "rfr3")
"""Cases that represent no others, since their references take seconds."""


def first_of_each(runs: list[tuple[str, str, str]]) -> set[tuple[str, str, str]]:
    """The first case of each reference, kind of run and solver, such as the first four-bar."""
    found: dict[tuple[str, str, str], tuple[str, str, str]] = {}
    for name, kind, solver in sorted(runs, key=lambda run: (run[0] in LONG, run)):
        found.setdefault((CASES[name].reference, kind, solver), (name, kind, solver))
    return {run for run in found.values() if run[0] not in LONG}


QUICK = first_of_each(CHECKED)


def nothing_agrees(case: Case, kind: str, solver: str, monkeypatch) -> None:
    compiled_model(case)
    stopped(monkeypatch, solver.partition(":")[0])
    found = outcomes(case, kind, solver, monkeypatch)
    assert found & {"differs", "diverged", "crashed", "unsupported", "bad input"}


def begun(case: Case, kind: str) -> Case:
    """The case with about the first fifth of its motion, if ``dynamics`` has ``n`` and ``until``.

    An engine that does nothing is wrong by then.
    """
    run = case.run[kind]
    if kind != "dynamics" or not (run.n and run.until):
        return case
    parts = next(k for k in (5, 4, 3, 2, 1) if (run.n - 1) % k == 0)
    brief = {"n": (run.n - 1) // parts + 1, "until": run.until / parts}
    return case.model_copy(update={"run": {kind: run.model_copy(update=brief)}})


@pytest.mark.parametrize(("name", "kind", "solver"), sorted(QUICK))
def test_an_engine_that_does_nothing_never_agrees(name, kind, solver, monkeypatch):
    nothing_agrees(begun(CASES[name], kind), kind, solver, monkeypatch)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "kind", "solver"), sorted(set(CHECKED) - QUICK))
def test_an_engine_that_does_nothing_agrees_in_no_case(name, kind, solver, monkeypatch):
    nothing_agrees(CASES[name], kind, solver, monkeypatch)


def springs(name: str) -> bool:
    """Whether a case has springs."""
    model = compiled_model(CASES[name])
    return bool(CASES[name].rod or model.jnt_stiffness.any() or model.tendon_stiffness.any())


STIFFER = 1.01
COARSE = {("robotiq_2f85", "mujoco"): 1.6}
"""Stiffer springs of a run whose tolerance is wider than the effect of 1 %.

The gripper as its vendor publishes it has joint limits and loops so soft that its curves are known
to 6 % of their ranges; with hard ones, in "mujoco:hard", springs 1 % stiffer differ.
"""


def stiffer(joint):
    """A joint of pymunk whose spring and servo are 1 % stiffer."""
    springs = tuple(STIFFER * part for part in joint.stiffness)
    return replace(joint, stiffness=springs, servo=STIFFER * joint.servo)


def stiffened(monkeypatch, name: str, solver: str) -> dict[str, object]:
    """Make all springs of an engine 1 % stiffer; what to change of the run."""
    factor = COARSE.get((name, solver), STIFFER)
    begin, read = mujoco_model.prepare_model, pymunk_model.read_links

    def read_stiffer(*args):
        links = read(*args)
        own = [replace(spring, stiffness=STIFFER * spring.stiffness) for spring in links.springs]
        return replace(links, springs=tuple(own), joints=tuple(map(stiffer, links.joints)))

    def begun(model, run):
        model.tendon_stiffness *= factor
        model.jnt_stiffness *= factor
        model.jnt_stiffnesspoly *= factor
        return begin(model, run)

    monkeypatch.setattr(mujoco_model, "prepare_model", begun)
    monkeypatch.setattr(pymunk_model, "read_links", read_stiffer)
    if not solver.endswith(":flex"):
        return {}
    rods = CASES[name].rods
    return {"rods": tuple(replace(rod, stiffness=STIFFER * rod.stiffness) for rod in rods)}


SPRINGS = [run for run in CHECKED if springs(run[0])]
STIFFENED = ("balancer_sine", "balancer4_sine", "rod_cantilever", "rod_pinned", "rfr2_natural")
SLOW = {
    run
    for run in SPRINGS
    if run[0] not in STIFFENED
    and (
        run not in first_of_each(SPRINGS)
        or run[0] in ("rfr2_driven", "slider_crank_elastic")
        or run[2] not in ("mujoco", "mujoco:flex")
    )
}
"""Runs that take seconds, with a faster run of the same kind among the others."""


def fewer(case: Case, kind: str) -> Case:
    """The case with fewer samples, so that its test is faster.

    A balancer's sweep keeps about a tenth of its samples, with those at which the drive turns back.
    The sweep of a driven platform keeps three.  Of a released rod the first 0.4 s are run; they
    agree unless springs are stiffer.
    """
    run = case.run[kind]
    few: dict[str, dict[str, float]] = {
        "balancer": {"n": fewer_samples(run.n)},
        "rod_platform_driven": {"n": 3},
        "rod_released": {"n": 21, "until": 0.4},
    }
    update = few.get(case.reference, {})
    return case.model_copy(update={"run": {kind: run.model_copy(update=update)}})


def differs(name: str, kind: str, solver: str, monkeypatch) -> None:
    found = outcomes(
        fewer(CASES[name], kind), kind, solver, monkeypatch, **stiffened(monkeypatch, name, solver)
    )
    assert "differs" in found


@pytest.mark.parametrize(
    ("name", "kind"), [("balancer_sine", "sweep"), ("rod_pinned", "equilibrium")]
)
def test_springs_that_are_stiffer_in_chipmunk_alone_differ(name, kind, monkeypatch):
    """Only the springs in Chipmunk's space are 1 % stiffer, and the equilibria differ.

    The energy by which proofmass paces the steps to rest has the right stiffness: the engine
    decides where the equilibrium is.
    """
    made = space._make_springs
    monkeypatch.setattr(space, "_make_springs", lambda joint, *to: made(stiffer(joint), *to))
    assert "differs" in outcomes(fewer(CASES[name], kind), kind, "pymunk", monkeypatch)


@pytest.mark.parametrize(("name", "kind", "solver"), [r for r in SPRINGS if r not in SLOW])
def test_springs_1_percent_stiffer_differ(name, kind, solver, monkeypatch):
    differs(name, kind, solver, monkeypatch)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "kind", "solver"), sorted(SLOW))
def test_springs_1_percent_stiffer_differ_in_long_runs(name, kind, solver, monkeypatch):
    differs(name, kind, solver, monkeypatch)
