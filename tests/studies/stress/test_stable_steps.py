"""Largest stable steps by `stress`, from own steps that fail, beside those of first screens."""

import shutil
from dataclasses import replace
from math import inf, isnan, sqrt
from pathlib import Path

import pytest
from typer.testing import CliRunner

from proofmass.commands.cli import app
from proofmass.run.sidecar import load_case
from proofmass.studies.record import Setting
from proofmass.studies.store import Store
from proofmass.studies.stress import stable_steps
from proofmass.studies.stress.boundary import (
    BoundaryKind,
    Failure,
    TrialResult,
    read_boundaries,
)
from proofmass.studies.stress.extremes import search_time_step
from proofmass.studies.stress.limit_search import LimitSearch, NotApplicable, StressedCase
from proofmass.studies.stress.page import describe_boundary
from proofmass.studies.stress.stable_steps import search_stable_step, with_stable_step
from proofmass.studies.stress.stress import cause_lines
from proofmass.studies.study import Study

CASES = Path(__file__).parents[2] / "data" / "screen"
SIDECAR = """
title = "a model that fails with its own step"
source = "a public thread"
reference = "refined"

[run.dynamics]
until = 0.1
n = 11
solvers = ["mujoco"]
"""


def stressed_model(name: str, folder: Path) -> StressedCase:
    shutil.copy(CASES / f"{name}.xml", folder)
    (folder / f"{name}.toml").write_text(SIDECAR)
    study = Study(Store(folder / "runs"), longest=20.0)
    return StressedCase(load_case(folder / f"{name}.toml"), "dynamics", Setting("mujoco"), study)


def find_limit(stressed: StressedCase, integrator: str):
    (search,) = (one for one in search_stable_step(stressed) if one.setting == integrator)
    return search.find()


@pytest.mark.parametrize(
    ("name", "integrator", "limit", "within", "cause"),
    [
        # measured in bare MuJoCo: issues 954 and 3443, and Menagerie's issue 254
        ("pd954", "Euler", 3.46e-3, 0.01, "joint b breaks by the damping of actuator 3"),
        ("stiff_contact", "implicitfast", 3.642e-3, 0.01, "joint j breaks by the stiffness of"),
        # 2.785 I / kv, with the inertia of the last joint's body and what moves with it
        pytest.param(
            "rizon254",
            "RK4",
            2.785294 * 0.0009 / 200,
            0.02,
            "joint joint7 breaks by the damping",
            marks=pytest.mark.slow,
        ),
        # 2 (zeta + sqrt(1 + zeta^2)) / omega
        ("stiff_servo", "implicitfast", 3.884e-3, 0.01, "joint j breaks by the stiffness of"),
    ],
)
def test_the_limit_below_an_own_step_that_fails_is_measured_and_predicted(
    name, integrator, limit, within, cause, tmp_path
):
    found = find_limit(stressed_model(name, tmp_path), integrator)
    assert found.limit == BoundaryKind.UNSTABLE
    assert found.breaks / found.holds <= 1.021
    assert found.measured == pytest.approx(limit, rel=within)
    assert found.ratio == pytest.approx(1.0, abs=0.01)
    assert cause in found.law
    assert found.start < 5e-3


def test_the_mode_that_breaks_and_the_line_to_paste_are_told(tmp_path):
    found = find_limit(stressed_model("stiff_servo", tmp_path), "implicitfast")
    omega = sqrt(3948 / 0.01)
    assert f"ω = {omega:.0f}/s, ζ = {2.5 / (2 * 0.01 * omega):.3f}" in found.law
    for told in (*cause_lines([found]), describe_boundary(found)):
        assert 'timestep="0.0031" or armature=' in told
        # omega falls with the root of kp, and (zeta + sqrt(1 + zeta^2)) rises a little
        assert 'kp="1900" on actuator p' in told


def test_what_is_implicit_in_the_servo_has_no_limit(tmp_path):
    found = find_limit(stressed_model("stiff_servo", tmp_path), "discrete")
    assert found.measured == found.theory == inf
    assert not found.remedy


def test_a_search_begins_below_a_first_value_that_fails():
    def trial(value):
        failed = Failure("gone", BoundaryKind.UNSTABLE)
        return TrialResult(failed if value > 0.2 else None)

    search = LimitSearch("", "", "", "", "s", 1.0, 9.0, trial, least=1e-3)
    found = search.find()
    assert found.holds < 0.2 < found.breaks < 1.011 * found.holds
    assert found.start == 1 / 16
    assert isnan(replace(search, least=0.3).find().measured)
    assert isnan(replace(search, least=float("nan")).find().measured)

    def give_up(value):
        return TrialResult(Failure("timed out", BoundaryKind.OURS))

    assert replace(search, trial=give_up).find().start == 1.0


def test_the_time_step_of_a_case_that_fails_is_searched_below(tmp_path):
    searches = list(search_time_step(stressed_model("pd954", tmp_path)))
    (euler,) = (one for one in searches if one.setting == "Euler")
    assert euler.trial(euler.start).failure
    assert euler.trial(euler.start / 16).failure is None
    assert euler.least < euler.start / 16


def test_limits_of_other_parameters_begin_at_a_stable_step(tmp_path, stressed):
    steady = with_stable_step(stressed_model("pd954", tmp_path))
    assert steady.setting.parameters == {"timestep": 0.0028}  # 0.8 of 3.46 ms
    assert steady.search("gravity", "1", 1.0, 2.0, lambda value: TrialResult()).setting == (
        "as in the model, timestep 2.8 ms"
    )
    assert steady.run(steady.case).outcome == "ran"
    for case in (stressed("pendulum"), stressed("fourbar"), stressed("pendulum", "pymunk")):
        assert with_stable_step(case) is case


def test_a_model_without_a_sidecar_has_stable_steps_alone(tmp_path, monkeypatch):
    every = stable_steps.search_integrators
    monkeypatch.setattr(  # one integrator is enough here
        stable_steps,
        "search_integrators",
        lambda *args: [one for one in every(*args) if one.setting == "implicitfast"],
    )
    shutil.copy(CASES / "stiff_servo.xml", tmp_path)
    fixed = tmp_path / "fixed.xml"
    fixed.write_text("<mujoco><worldbody><geom size='1'/></worldbody></mujoco>")
    answer = CliRunner().invoke(app, ["stress", str(tmp_path), "-o", str(tmp_path / "out")])
    assert answer.exit_code == 0
    said = " ".join(answer.output.split())
    assert "its stable time steps alone are searched" in said
    assert "passed over: " in said
    assert "fixed.xml: it has 0 coordinates" in said
    (found,) = read_boundaries(tmp_path / "out" / "stress.csv")
    assert found.ratio == pytest.approx(1.0, abs=0.01)
    alone = CliRunner().invoke(app, ["stress", str(fixed), "-o", str(tmp_path / "out")])
    assert alone.exit_code == 2
    words = "it has 0 coordinates; stable time steps are searched of models with 1 to 100"
    assert words in " ".join(alone.output.split())


def test_drives_and_other_settings_have_no_predicted_step(stressed):
    with pytest.raises(NotApplicable, match="driven"):
        list(search_stable_step(stressed("fourbar")))
    with pytest.raises(NotApplicable, match="softness"):
        list(search_stable_step(stressed("fourbar_released", solref=[0.01, 1.0])))
    with pytest.raises(NotApplicable, match="MJCF alone"):
        list(search_stable_step(stressed("pendulum", "pymunk")))
