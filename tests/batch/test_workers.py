"""Commands compile models and evaluate references in workers, within the limits of the case."""

import os
from collections.abc import Callable
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import mujoco
import pytest

from proofmass.analytic import planar
from proofmass.base.errors import InputError
from proofmass.base.read_once import KEPT_INPUTS, kept_input
from proofmass.batch.check import Result, check
from proofmass.commands.studies import load_cases
from proofmass.pytest_items import SolverItem
from proofmass.reference import evaluate
from proofmass.reference.mobility import model_dof
from proofmass.report import write_report
from proofmass.run.sidecar import load_case
from proofmass.studies import variants
from proofmass.studies.diet import scene
from proofmass.studies.measure import StudyRun
from proofmass.studies.record import Setting, StudyRow
from proofmass.studies.store import task_key
from proofmass.studies.stress import extremes
from proofmass.studies.stress.extremes import search_energy_error
from proofmass.studies.stress.limit_search import StressedCase
from proofmass.studies.trade.verify import verify
from proofmass.studies.variants import evaluate_reference, with_drive_distance
from proofmass.verdict.comparison import Comparison
from tests.shipped import shipped

LARGE_WORLDBODY = '<worldbody><replicate count="1000000"><geom size="1"/></replicate>'
"""Part of a model that takes MuJoCo minutes to compile."""


@pytest.fixture
def compiled_here(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The files that this process compiles during a test.

    A test fails if this process evaluates a reference.
    """
    files = list[str]()

    def noted(do: Callable, file: str, *more: object) -> object:
        files.append(file)
        return do(file, *more)

    for kind, name in ((mujoco.MjModel, "from_xml_path"), (mujoco.MjSpec, "from_file")):
        monkeypatch.setattr(kind, name, staticmethod(partial(noted, getattr(kind, name))))
    for module, name in ((evaluate, "call_reference"), (planar, "solve")):
        monkeypatch.setattr(module, name, lambda *_, **__: pytest.fail("a reference was evaluated"))
    return files


def test_check_report_and_pytest_items_compile_and_evaluate_in_workers(
    models, edit, keep_solver, compiled_here, tmp_path
):
    """The case has a drive and views."""
    edit("balancer_sine.toml", r"n = \d+", "n = 9")
    result = check([keep_solver("balancer_sine.toml", "mujoco")], causes=False)
    assert "agrees" in {c.outcome for c in result.comparisons}
    page = write_report(result, tmp_path / "r").with_name("balancer_sine.html").read_text("utf-8")
    assert page.count("<svg") > 4  # the mechanism, curves, differences, views
    assert " rad " in page
    SolverItem.runtest(SimpleNamespace(case=result.cases[0], name="mujoco"))
    assert not compiled_here


def test_a_report_of_runs_beyond_their_limits_compiles_nothing_here(
    models, compiled_here, tmp_path
):
    """The case, whose runs timed out, has a drive, a view and parameters to compare with."""
    case = load_case(models / "balancer_sine.toml")
    rows = [
        Comparison(case.name, solver, "sweep", name, channel.unit, outcome="timed out")
        for solver in ("mujoco", "pymunk")
        for name, channel in case.channels.items()
    ]
    page = write_report(Result(cases=[case], comparisons=rows), tmp_path)
    assert "timed out" in page.with_name("balancer_sine.html").read_text("utf-8")
    assert not compiled_here


@pytest.mark.parametrize("name", ["pendulum", "fourbar"])
def test_a_chosen_setting_is_verified_in_workers(name, models, edit, compiled_here):
    """The general solver, which gives the start of the shifted free motion, is a reference too."""
    edit(f"{name}.toml", r"(?s)(run.dynamics.*?\nn = )\d+", r"\g<1>5")
    row = StudyRow("trade", name, "dynamics", "mujoco", "", "timestep", 2e-3, {"timestep": 2e-3})
    done = verify(load_case(models / f"{name}.toml"), "dynamics", row, "position", 1e-3)
    assert done.fresh > 0
    assert done.shifted > 0
    assert not compiled_here


def test_changed_models_are_compiled_and_run_in_workers(models, compiled_here, stressed, tmp_path):
    fourbar: StressedCase = stressed("fourbar", kind="sweep")
    assert (
        fourbar.find_failure(variants.with_scaled_lengths(fourbar.case, fourbar.models, 2.0))
        is None
    )
    links = extremes.last_link(fourbar.case)
    assert extremes.find_closing_failure(fourbar.case, links, "sweep", tmp_path, 1.01) is None
    assert evaluate_reference(with_drive_distance(fourbar.case, 1.0), "sweep").x.size == 361
    assert list(search_energy_error(stressed("fourbar_released")))
    names = {Path(os.fsdecode(file)).parent for file in compiled_here}
    assert names == {models}  # the cases' own models, whose numbers are looked up


def test_rods_with_other_numbers_of_segments_are_built_in_workers(models, compiled_here):
    task = StudyRun(load_case(models / "rod_cantilever.toml"), "equilibrium", Setting("mujoco"))
    keys = {
        task_key(StudyRun(task.case, task.run, task.setting.with_parameters(segments=n)))
        for n in (10, 20)
    }
    assert len(keys) == 2
    assert not compiled_here


def test_a_diet_compiles_its_model_in_a_worker_first(
    models, edit, compiled_here, monkeypatch, tmp_path
):
    edit("watt.xml", "<worldbody>", LARGE_WORLDBODY)
    monkeypatch.setattr(scene, "COMPILE_TIMEOUT", 0.3)
    lone = tmp_path / "lone.xml"
    lone.write_bytes((models / "watt.xml").read_bytes())
    with pytest.raises(InputError, match=r"lone\.xml: cannot be compiled: no answer in 0\.3 s of"):
        scene.load_scene(lone, 1.0)
    assert not compiled_here


def test_a_diet_evaluates_its_references_in_workers(models, edit, compiled_here):
    edit("pendulum.toml", r"until = 10\.0", "until = 0.1")
    found = scene.load_scene(models / "pendulum.xml", 1.0)
    assert "pendulum dynamics" in {monitored.name for monitored in found.monitored_runs}


def test_studies_refuse_a_model_that_is_beyond_the_limits_of_its_runs(models, edit, compiled_here):
    edit("watt.xml", "<worldbody>", LARGE_WORLDBODY)
    edit("watt.toml", r"(?m)^(\[run\.\w+\])$", r"\1\ntimeout = 0.5")
    for study in (
        lambda: load_cases([models / "watt.toml"]),
        lambda: scene.load_scene(models / "watt.xml", 1.0),
    ):
        with pytest.raises(InputError, match=r"its model or its reference: no answer in 0\.5 s of"):
            study()
    assert not compiled_here


def test_only_the_last_compiled_models_are_kept_in_memory():
    """A search for detectable changes compiles thousands of models of 0.1 MB in one worker."""
    text = shipped("fourbar.xml").read_text(encoding="utf-8")
    for _ in range(KEPT_INPUTS + 8):
        assert model_dof(mujoco.MjModel.from_xml_string(text), "start") == 1
    assert kept_input.cache_info().currsize == KEPT_INPUTS
