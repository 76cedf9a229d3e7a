"""The limits of `proofmass stress`, compared with limits of the engines without proofmass.

`tests/studies/stress/bare/` has a script for each engine that imports nothing of proofmass.  It
bisects each limit to 0.2 %.  The boundary that `stress` measures must be within 2 % of it: the
value 2 % before the limit holds, and the value 2 % beyond it fails.  The tolerance is 2 % because
the samples of an oscillation need not be where its error is largest: as a spring is stiffened, the
error grows, but also goes up and down by 5 %.
"""

import ast
import json
import subprocess
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest

from proofmass.reference.samples import run_samples
from proofmass.sim.protocol.run import Run
from proofmass.studies.measure import Measurement
from proofmass.studies.stress import extremes
from proofmass.studies.stress.boundary import BoundaryKind
from proofmass.studies.stress.limit_search import LimitSearch
from proofmass.studies.stress.problems import list_problems
from proofmass.studies.trade.program import bare_command
from proofmass.studies.variants import with_longer_run, with_whole_steps

SCRIPT_FOLDER = Path(__file__).parent / "bare"
AGREEMENT = 0.02
PROBLEMS = {f"{p.what}, {p.setting}, {p.parameter}": p for p in list_problems()}


@cache
def limit_of_bare_engine(engine: str, name: str) -> float:
    """A limit that a script measures, in another folder and without packages of this one."""
    with TemporaryDirectory() as folder:
        answer = subprocess.run(
            bare_command(SCRIPT_FOLDER / f"with_{engine}.py", name),
            cwd=folder,
            capture_output=True,
            text=True,
            check=True,
        )
    return float(json.loads(answer.stdout)[name])


def assert_boundary_is_near(search: LimitSearch, limit: float) -> None:
    """Fail if the boundary of a search is not within `AGREEMENT` of a limit of the bare engine."""
    assert search.trial(limit * (1 - AGREEMENT)).failure is None
    failure = search.trial(limit * (1 + AGREEMENT)).failure
    assert failure
    assert failure.limit in (BoundaryKind.UNSTABLE, BoundaryKind.INACCURATE)


def test_the_scripts_import_their_engine_and_numpy_alone():
    plain = {"cmath", "functools", "json", "math", "numpy", "pathlib", "sys"}
    for engine in ("mujoco", "pymunk"):
        tree = ast.parse((SCRIPT_FOLDER / f"with_{engine}.py").read_text(encoding="utf-8"))
        names = {
            name.name
            for node in ast.walk(tree)
            if isinstance(node, ast.Import)
            for name in node.names
        } | {node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
        assert engine in names
        assert names <= {*plain, engine}


@pytest.mark.parametrize(
    ("case", "integrator"),
    [
        ("pendulum", "Euler"),
        ("pendulum", "RK4"),
        ("fourbar", "RK4"),
        *(
            pytest.param(case, integrator, marks=pytest.mark.slow)
            for case, integrator in (
                ("pendulum", "implicit"),
                ("pendulum", "implicitfast"),
                ("pendulum", "discrete"),
                ("fourbar", "Euler"),
                *(
                    ("fourbar_released", integrator)
                    for integrator in ("RK4", "Euler", "implicit", "implicitfast", "discrete")
                ),
            )
        ),
    ],
)
def test_time_step_limits_of_mujoco_are_confirmed_without_proofmass(stressed, case, integrator):
    search = next(s for s in extremes.search_time_step(stressed(case)) if s.setting == integrator)
    assert_boundary_is_near(search, limit_of_bare_engine("mujoco", f"{case}, {integrator}"))


@pytest.mark.parametrize(
    "case", ["pendulum", pytest.param("fourbar_released", marks=pytest.mark.slow)]
)
def test_time_step_limits_of_pymunk_are_confirmed_without_proofmass(stressed, case):
    (search,) = extremes.search_time_step(stressed(case, "pymunk"))
    assert_boundary_is_near(search, limit_of_bare_engine("pymunk", f"{case}, step"))


def test_a_point_mass_of_chipmunk_takes_a_shorter_step():
    """proofmass builds a link that is nearly a point mass as another body, with the same motion.

    See docs/stress.md.
    """
    built, plain = (
        limit_of_bare_engine("pymunk", f"pendulum{words}, step")
        for words in ("", " as a point mass")
    )
    assert plain < 0.9 * built


@pytest.mark.slow
@pytest.mark.parametrize("engine", ["mujoco", "pymunk"])
def test_gravity_limits_of_a_pendulum_are_confirmed_without_proofmass(stressed, engine):
    (search,) = extremes.search_gravity(stressed("pendulum", engine))
    assert_boundary_is_near(search, limit_of_bare_engine(engine, "pendulum, gravity"))


@pytest.mark.slow
@pytest.mark.parametrize("engine", ["mujoco", "pymunk"])
def test_spring_limits_of_a_pendulum_are_confirmed_without_proofmass(stressed, engine):
    (search,) = extremes.search_stiffness(stressed("pendulum", engine))
    assert_boundary_is_near(search, limit_of_bare_engine(engine, "pendulum, spring"))


def test_the_speed_limit_of_a_four_bar_is_confirmed_without_proofmass(stressed):
    (search,) = extremes.search_drive_speed(stressed("fourbar"))
    assert_boundary_is_near(search, limit_of_bare_engine("mujoco", "fourbar, drive speed"))


@pytest.mark.slow
@pytest.mark.parametrize("integrator", ["Euler", "implicit"])
def test_energy_limits_of_a_four_bar_are_confirmed_without_proofmass(stressed, integrator):
    found = extremes.search_energy_error(stressed("fourbar_released"))
    search = next(s for s in found if s.setting == integrator)
    assert_boundary_is_near(
        search, limit_of_bare_engine("mujoco", f"fourbar_released, energy, {integrator}")
    )


SMALL_PROBLEMS = {
    "spring, ζ = 0, Euler": "spring on a hinge, ζ = 0, Euler, dt ω",
    "spring, ζ = 0.3, Euler": "spring on a hinge, ζ = 0.3, Euler, dt ω",
    "spring, ζ = 1, Euler": "spring on a hinge, ζ = 1, Euler, dt ω",
    "spring, ζ = 1, explicit damping, Euler": (
        "spring on a hinge, ζ = 1, explicit damping, Euler, dt ω"
    ),
    "spring, ζ = 0.3, implicitfast": "spring on a hinge, ζ = 0.3, implicitfast, dt ω",
    "spring, ζ = 0, RK4": "spring on a hinge, ζ = 0, RK4, dt ω",
    "spring, ζ = 1, RK4": "spring on a hinge, ζ = 1, RK4, dt ω",
    "hung pendulum, Euler": "hung pendulum, Euler, gravity dt²/L",
    "hung pendulum, RK4": "hung pendulum, RK4, gravity dt²/L",
    "velocity servo, Euler": "velocity servo, Euler, dt kv/I",
    "velocity servo, RK4": "velocity servo, RK4, dt kv/I",
    "loop with refsafe off, Euler": "loop with refsafe off, Euler, dt/solref",
    "loop with refsafe off, RK4": "loop with refsafe off, RK4, dt/solref",
    "flat cylinder": "flat cylinders, 0.021 mm above a floor, Euler, r d/(gap tilt)",
    "spring, ζ = 0": "spring on a hinge, ζ = 0, pymunk, dt ω",
    "spring, ζ = 0.1": "spring on a hinge, ζ = 0.1, pymunk, dt ω",
    "row of 5 masses": "5 masses in a row on springs, pymunk, dt √(k/m)",
    "hung pendulum": "hung pendulum, pymunk, gravity dt²/L",
}


QUICK_PROBLEMS = (
    "spring, ζ = 0.3, Euler",
    "hung pendulum, Euler",
    "velocity servo, Euler",
    "loop with refsafe off, RK4",
)


@pytest.mark.parametrize(
    "name",
    [
        name if name in QUICK_PROBLEMS else pytest.param(name, marks=pytest.mark.slow)
        for name in SMALL_PROBLEMS
    ],
)
def test_bare_engines_have_the_limits_of_theory_in_small_models(name):
    search = PROBLEMS[SMALL_PROBLEMS[name]]
    limit = limit_of_bare_engine(search.engine, name)
    assert limit == pytest.approx(search.theory, rel=AGREEMENT)
    assert_boundary_is_near(search, limit)


def test_a_damped_spring_has_no_limit_with_chipmunks_own_dampers():
    assert (
        limit_of_bare_engine("pymunk", "spring, ζ = 0.3")
        == np.inf
        == PROBLEMS["spring on a hinge, ζ = 0.3, Chipmunk's dampers, pymunk, dt ω"].theory
    )


@pytest.mark.parametrize("step", [1e-3, 1.37e-3, 9.99e-3, 0.01, 0.0101, 0.13, 0.77, 2.5])
@pytest.mark.parametrize("name", ["pendulum", "fourbar", "threeprr", "double_rocker", "hacksaw"])
def test_samples_are_whole_steps_apart(stressed, name, step):
    """A stride has as many steps as fit between samples of the case, and at least one.

    The end of the run moves by at most half a stride; the end of a drive or of a motion profile is
    not exceeded.
    """
    case = stressed(name).case
    x = run_samples(case, "dynamics")
    if step > x[-1] / 4:
        pytest.skip("fewer than four steps")
    changed = with_whole_steps(case, float(x[-1]), step)
    found = Run("dynamics", run_samples(changed, "dynamics"), ())
    per, taken = found.steps(step)
    assert taken == pytest.approx(step, rel=1e-12, abs=0)
    assert per == max(1, int((x[1] - x[0]) / step + 1e-9))
    late = found.x[-1] - x[-1]
    if name in ("threeprr", "hacksaw"):  # a drive that ends, and a motion profile
        assert -per * step < late <= 1e-9
    else:
        assert abs(late) <= per * step / 2 + 1e-9


@pytest.mark.parametrize("name", ["pendulum", "fourbar", "threeprr"])
def test_a_long_run_has_the_number_of_steps_that_is_stated(stressed, name):
    """The number of steps is that of the duration, up to the steps between two samples."""
    base = stressed(name)
    case = with_whole_steps(
        with_longer_run(base.case, 7.3, base.seconds), 7.3 * base.seconds, base.step
    )
    per, taken = Run("dynamics", run_samples(case, "dynamics"), ()).steps(base.step)
    assert taken == pytest.approx(base.step, rel=1e-12, abs=0)
    steps = per * (case.run["dynamics"].n - 1)
    assert steps == pytest.approx(7.3 * base.seconds / base.step, abs=per)


@pytest.mark.parametrize("engine", ["mujoco", "pymunk"])
def test_a_step_that_was_not_asked_for_is_an_error(stressed, engine, monkeypatch):
    """With samples 1 % too far apart `Run.steps` takes two steps between them instead of one."""
    base = stressed("pendulum", engine)
    assert base.try_in_steps(base.case, 1.0, timestep=0.0137).step == pytest.approx(
        0.0137, rel=1e-12, abs=0
    )
    whole = with_whole_steps
    monkeypatch.setattr(
        "proofmass.studies.stress.limit_search.with_whole_steps",
        lambda case, seconds, step: whole(case, seconds, 1.01 * step),
    )
    with pytest.raises(RuntimeError, match=r"took steps of 0.0069\d* s where 0.0137 s were asked"):
        base.try_in_steps(base.case, 1.0, timestep=0.0137)


def test_a_failed_run_has_no_time_step(stressed, monkeypatch):
    base = stressed("pendulum")
    monkeypatch.setattr(
        "proofmass.studies.study.Study.measure_one",
        lambda *_: Measurement(outcome="diverged"),
    )
    assert np.isnan(base.try_in_steps(base.case, 1.0, timestep=0.01).step)


def test_the_time_step_of_a_recorded_curve_is_not_varied(stressed):
    _, skipped = extremes.list_extremes(
        stressed("hacksaw_recorded").case, stressed("hacksaw_recorded").study
    )
    assert "time step: a recorded curve has its own samples" in skipped
