"""Diets of the shipped models remove nothing; which runs and options of a case a diet uses."""

from functools import partial
from pathlib import Path

import mujoco
import numpy as np
import pytest

from proofmass.reference.evaluate import reference_for
from proofmass.run.sidecar import load_case
from proofmass.run.solve import call_engine, plan_run
from proofmass.studies.diet.edits import set_option, write_model
from proofmass.studies.diet.options import change_integrator, lengthen_step, loosen_tolerance
from proofmass.studies.diet.scene import load_scene
from proofmass.verdict.compare import compare
from tests.shipped import shipped, shipped_files
from tests.studies.test_study_verdicts import RecordingSearch, unkept_study

SHIPPED_MODELS = shipped_files("*.xml")
KEPT = {
    # the mechanism of the reference: a preloaded spring leaves its joint limit at once
    "balancer_third_preload_at_once": ["limit joint3"],
    # the gripper as its vendor publishes it, which closes empty and meets few of its limits
    "robotiq_2f85": [
        "equality alike",
        "limit right_driver",
        "limit 2: right_spring_link, right_follower",
        "limit left_driver",
        "limit 2: left_spring_link, left_follower",
    ],
}
"""What a model keeps although no run of its sidecars needs it."""


def removed_features(file: Path) -> list[str]:
    """The titles of the features that a diet removes from a model."""
    found = RecordingSearch(load_scene(file, 1.0), unkept_study(), rounds=0, tune=False).run()
    return [e.title for e in found.entries if e.outcome == "harmless"]


@pytest.mark.parametrize(
    "file",
    [
        shipped("pendulum.xml"),
        *(pytest.param(f, marks=pytest.mark.slow) for f in SHIPPED_MODELS if f.stem != "pendulum"),
    ],
    ids=lambda file: file.stem,
)
def test_shipped_models_have_nothing_to_remove(file):
    assert removed_features(file) == KEPT.get(file.stem, [])


def test_a_light_added_to_a_shipped_model_is_removed(models, edit):
    edit("pendulum.xml", "<worldbody>", '<worldbody><light name="sun"/>')
    assert removed_features(models / "pendulum.xml") == ["light sun"]


def test_a_longer_step_is_compared_with_the_reference(models, edit, tmp_path):
    """The error is that against the closed form, and not against the model's own fine solution."""
    edit("pendulum.toml", r"until = 10\.0", "until = 1.0")
    edit("pendulum.toml", r"n = 1001", "n = 26")
    edit("pendulum.xml", 'timestep="1e-3"', 'timestep="1.25e-4"')
    file, case = models / "pendulum.xml", load_case(models / "pendulum.toml")
    scene = load_scene(file, 1.0)
    found = RecordingSearch(scene, unkept_study(), rounds=0).run()
    step = mujoco.MjModel.from_xml_path(str(file)).opt.timestep
    longer = found.reduced.compiled().opt.timestep
    assert longer >= 2 * step
    write_model(found.reduced, file)
    run = plan_run(case, "dynamics", "mujoco")
    for c in compare(case, "dynamics", "mujoco", call_engine("mujoco", file, run)):
        before = scene.monitored_runs[0].before.channels[c.channel]
        reference = reference_for(case, "dynamics", scene.monitored_runs[0].before).channels[
            c.channel
        ]
        error = float(np.abs(before - reference).max())
        assert c.outcome == "agrees"
        # an error may grow by a tenth of the difference between tolerance and error, or by rounding
        # (1e-12 of the channel's size) if that is more, as with the tolerance of 1e-10 of the range
        assert c.error_max <= error + max(
            0.1 * (c.allowed - error), 1e-12 * float(np.abs(before).max())
        )
    refused = [e for e in found.entries if e.kind == "option" and e.outcome == "matters"]
    assert any(e.name.startswith("time step") for e in refused)


def test_options_that_a_sidecar_sets_are_not_tried(models, edit):
    with (models / "pendulum.toml").open("a") as sidecar:
        sidecar.write('\n[settings.mujoco]\ntimestep = 1e-3\nintegrator = "RK4"\n')
    scene = load_scene(models / "pendulum.xml", 1.0)
    assert not lengthen_step(scene.edited, scene)
    assert not change_integrator(scene.edited, scene)
    assert loosen_tolerance(
        scene.edited.without(partial(set_option, name="tolerance", value=0.0)), scene
    )


def test_every_setting_of_a_case_is_monitored(models, edit):
    edit("pendulum.toml", r'solvers = \["mujoco", ', 'solvers = ["mujoco", "mujoco:fine", ')
    with (models / "pendulum.toml").open("a") as sidecar:
        sidecar.write('\n[settings."mujoco:fine"]\ntimestep = 5e-4\n')
    scene = load_scene(models / "pendulum.xml", 1.0)
    assert [w.name for w in scene.monitored_runs] == [
        "pendulum dynamics",
        "pendulum dynamics, fine",
    ]
    steps = [w.before.steps for w in scene.monitored_runs]
    assert steps[1] > 1.5 * steps[0]
