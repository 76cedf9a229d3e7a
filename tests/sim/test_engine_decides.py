"""Tests that engines decide all outcomes: an idle engine, or one with stiffer springs, differs."""

import re
from dataclasses import replace

import mujoco
import numpy as np
import pymunk
import pytest

from proofmass.base.errors import InputError
from proofmass.case.case import Case
from proofmass.case.drive import check_driven
from proofmass.reference.case_model import compiled_model
from proofmass.reference.evaluate import reference_for
from proofmass.run.solve import call_engine, plan_run
from proofmass.sim.engines import computes_curves
from proofmass.sim.mujoco import engine as mujoco_engine
from proofmass.sim.mujoco import model as mujoco_model
from proofmass.sim.mujoco.linkage import STATIC_STAGES
from proofmass.sim.protocol.failures import BadModel
from proofmass.sim.pymunk import model as pymunk_model
from proofmass.sim.pymunk import space
from proofmass.verdict.compare import compare
from proofmass.verdict.outcome import OUTCOME_OF_EXCEPTION
from tests.shipped import fewer_samples, shipped_case, shipped_files

CASES = {file.stem: shipped_case(file) for file in shipped_files()}
RUNS = [
    (name, kind, solver)
    for name, case in CASES.items()
    for kind, run in case.run.items()
    for solver in run.solvers
    if computes_curves(solver)  # recorded curves are changed in `test_recorded`
]
MUJOCO_FUNCTIONS = (
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
RUN_ERRORS = (InputError, BadModel, *OUTCOME_OF_EXCEPTION)


def outcomes(case: Case, kind: str, solver: str, monkeypatch, **changed) -> set[str]:
    """Outcomes of the channels with a tolerance, or of the run if it gives no curves."""
    run = replace(plan_run(case, kind, solver), **changed)
    try:
        curves = call_engine(solver.partition(":")[0], case.model_path, run)
        check_driven(run, curves)
    except RUN_ERRORS as error:
        return {OUTCOME_OF_EXCEPTION.get(type(error), "bad input")}
    monkeypatch.undo()  # the reference may read the model by the engine's own functions
    return {
        c.outcome for c in compare(case, kind, solver, curves, detectable=False) if c.allowed > 0
    }


def has_tolerance(name: str, kind: str, solver: str) -> bool:
    """Whether any channel of a run has a tolerance for this solver."""
    case = CASES[name]
    return any(case.tolerance_for(kind, solver, c) for c in case.channels_of(kind))


def make_idle(monkeypatch, engine: str) -> None:
    """Make an engine idle: its functions leave all data as they are."""
    if engine == "pymunk":
        monkeypatch.setattr(pymunk.Space, "step", lambda space, dt: None)
    else:
        for name in MUJOCO_FUNCTIONS:
            monkeypatch.setattr(mujoco, name, lambda *_, **__: None)


RUNS_WITH_TOLERANCE = [run for run in RUNS if has_tolerance(*run)]
CASES_WITH_SLOW_REFERENCES = (
    "rod_snap",
    "rod_taut",
    "rod_sheared",
    "rfr2_circles",
    "rfr2_rectangles",
    "rfr3",
)
"""Cases that represent no others, since their references take seconds."""


def first_of_each(runs: list[tuple[str, str, str]]) -> set[tuple[str, str, str]]:
    """The first case of each reference, kind of run and solver, such as the first four-bar."""
    found: dict[tuple[str, str, str], tuple[str, str, str]] = {}
    for name, kind, solver in sorted(
        runs, key=lambda run: (run[0] in CASES_WITH_SLOW_REFERENCES, run)
    ):
        found.setdefault((CASES[name].reference, kind, solver), (name, kind, solver))
    return {run for run in found.values() if run[0] not in CASES_WITH_SLOW_REFERENCES}


REPRESENTATIVES = first_of_each(RUNS_WITH_TOLERANCE)


ERRORS_OF_IDLE_ENGINES = "|".join(
    (
        "a loop came open by",
        "where its drive leads it to",
        "at rest, loops open by",  # pymunk does not follow the drive of a sweep
        r"degree\(s\) of freedom left",  # MuJoCo finds no stiffness
        "could not broadcast input array",  # MuJoCo finds no rows of loops
        "is on its stop before",  # so are all joints whose values stay zero
        "cannot be bent so that it ends at its support",  # MuJoCo finds supports at the origin
    )
)
"""What is wrong with a run whose engine does nothing, if it gives no curves."""
CURVES_OF_CONTROLS = {("axes_controlled", "pymunk"): {"pushing"}}
"""Channels that an engine does not decide: proofmass reads the force of a motor from its control,
by case and solver."""


def assert_idle_engine_fails(name: str, case: Case, kind: str, solver: str, monkeypatch) -> None:
    """An idle engine loses the run for one of the known causes, or all curves that move differ.

    The curves of an idle engine are constant.  One of them may only agree if the reference moves by
    at most twice the tolerance.
    """
    compiled_model(case)
    run = plan_run(case, kind, solver)
    make_idle(monkeypatch, solver.partition(":")[0])
    try:
        curves = call_engine(solver.partition(":")[0], case.model_path, run)
        check_driven(run, curves)
    except RUN_ERRORS as error:
        if not re.search(ERRORS_OF_IDLE_ENGINES, str(error)):
            raise
        return
    monkeypatch.undo()  # the reference may read the model by the engine's own functions
    found = [c for c in compare(case, kind, solver, curves, detectable=False) if c.allowed > 0]
    assert "differs" in {c.outcome for c in found}
    alike = [c for c in found if c.outcome not in ("differs", "unsupported")]
    if alike:
        truth = reference_for(case, kind, curves).channels
        moving = {c.channel for c in alike if np.ptp(truth[c.channel]) > 2.0 * c.allowed}
        assert moving == CURVES_OF_CONTROLS.get((name, solver), set())


NEEDS_WHOLE_MOTION = {"tumbling_box"}
"""Cases with a curve of so small a range in a fifth of its motion that its tolerance is refused."""


def with_shorter_motion(case: Case, kind: str) -> Case:
    """The case with about the first fifth of its motion, if ``dynamics`` has ``n`` and ``until``.

    An engine that does nothing is wrong by then.
    """
    run = case.run[kind]
    if kind != "dynamics" or not (run.n and run.until) or case.name in NEEDS_WHOLE_MOTION:
        return case
    parts = next(k for k in (5, 4, 3, 2, 1) if (run.n - 1) % k == 0)
    brief = {"n": (run.n - 1) // parts + 1, "until": run.until / parts}
    return case.model_copy(update={"run": {kind: run.model_copy(update=brief)}})


@pytest.mark.parametrize(("name", "kind", "solver"), sorted(REPRESENTATIVES))
def test_an_engine_that_does_nothing_never_agrees(name, kind, solver, monkeypatch):
    case = with_shorter_motion(CASES[name], kind)
    assert_idle_engine_fails(name, case, kind, solver, monkeypatch)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "kind", "solver"), sorted(set(RUNS_WITH_TOLERANCE) - REPRESENTATIVES)
)
def test_an_engine_that_does_nothing_never_agrees_in_other_cases(name, kind, solver, monkeypatch):
    assert_idle_engine_fails(name, CASES[name], kind, solver, monkeypatch)


def has_springs(name: str) -> bool:
    """Whether a case has springs."""
    model = compiled_model(CASES[name])
    return bool(CASES[name].rod or model.jnt_stiffness.any() or model.tendon_stiffness.any())


STIFFER = 1.01
COARSE = {("robotiq_2f85", "mujoco"): 1.6}
"""Stiffer springs of a run whose tolerance is wider than the effect of 1 %.

The gripper as its vendor publishes it has joint limits and loops so soft that its curves are known
to 6 % of their ranges; with hard ones, in "mujoco:hard", springs 1 % stiffer differ.
"""


def with_stiffer_spring(joint):
    """A joint of pymunk whose spring and servo are 1 % stiffer."""
    springs = tuple(STIFFER * part for part in joint.stiffness)
    return replace(joint, stiffness=springs, servo=STIFFER * joint.servo)


def stiffen_springs(monkeypatch, name: str, solver: str) -> dict[str, object]:
    """Make all springs of an engine 1 % stiffer; what to change of the run."""
    factor = COARSE.get((name, solver), STIFFER)
    prepare_model, read_links = mujoco_model.prepare_model, pymunk_model.read_links

    def read_stiffer(*args):
        links = read_links(*args)
        own = [replace(spring, stiffness=STIFFER * spring.stiffness) for spring in links.springs]
        return replace(
            links, springs=tuple(own), joints=tuple(map(with_stiffer_spring, links.joints))
        )

    def prepare_stiffer(model, run):
        model.tendon_stiffness *= factor
        model.jnt_stiffness *= factor
        model.jnt_stiffnesspoly *= factor
        return prepare_model(model, run)

    for module in (mujoco_model, mujoco_engine):
        monkeypatch.setattr(module, "prepare_model", prepare_stiffer)
    monkeypatch.setattr(pymunk_model, "read_links", read_stiffer)
    if not solver.endswith(":flex"):
        return {}
    rods = CASES[name].rods
    return {"rods": tuple(replace(rod, stiffness=STIFFER * rod.stiffness) for rod in rods)}


RUNS_WITH_SPRINGS = [run for run in RUNS_WITH_TOLERANCE if has_springs(run[0])]
FAST_CASES_WITH_SPRINGS = (
    "balancer_sine",
    "balancer4_sine",
    "rod_cantilever",
    "rod_pinned",
    "rfr2_natural",
)
SLOW_RUNS_WITH_SPRINGS = {
    run
    for run in RUNS_WITH_SPRINGS
    if run[0] not in FAST_CASES_WITH_SPRINGS
    and (
        run not in first_of_each(RUNS_WITH_SPRINGS)
        or run[0] in ("rfr2_driven", "slider_crank_elastic")
        or run[2] not in ("mujoco", "mujoco:flex")
    )
}
"""Runs that take seconds, with a faster run of the same kind among the others."""


def with_fewer_samples(case: Case, kind: str) -> Case:
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


def assert_stiffer_springs_differ(name: str, kind: str, solver: str, monkeypatch) -> None:
    found = outcomes(
        with_fewer_samples(CASES[name], kind),
        kind,
        solver,
        monkeypatch,
        **stiffen_springs(monkeypatch, name, solver),
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
    make_springs = space._make_springs
    monkeypatch.setattr(
        space, "_make_springs", lambda joint, *to: make_springs(with_stiffer_spring(joint), *to)
    )
    assert "differs" in outcomes(with_fewer_samples(CASES[name], kind), kind, "pymunk", monkeypatch)


@pytest.mark.parametrize(
    ("name", "kind", "solver"), [r for r in RUNS_WITH_SPRINGS if r not in SLOW_RUNS_WITH_SPRINGS]
)
def test_springs_1_percent_stiffer_differ(name, kind, solver, monkeypatch):
    assert_stiffer_springs_differ(name, kind, solver, monkeypatch)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "kind", "solver"), sorted(SLOW_RUNS_WITH_SPRINGS))
def test_springs_1_percent_stiffer_differ_in_long_runs(name, kind, solver, monkeypatch):
    assert_stiffer_springs_differ(name, kind, solver, monkeypatch)
