"""Own models: nothing is left in them that a diet finds; what it watches of a case."""

from pathlib import Path

import pytest

from proofmass.study.diet import Search
from proofmass.study.scene import scene_of
from tests.conftest import MODELS

OWN = sorted(MODELS.glob("*.xml"))


def gone(file: Path) -> list[str]:
    """What a diet takes out of a model."""
    found = Search(scene_of(file, 1.0), rounds=0).run()
    return [e.title for e in found.entries if e.outcome == "harmless"]


@pytest.mark.parametrize("file", [MODELS / "pendulum.xml", *(
    pytest.param(f, marks=pytest.mark.slow) for f in OWN if f.stem != "pendulum")],
    ids=lambda file: file.stem)
def test_own_models_have_nothing_left_to_remove(file):
    assert gone(file) == []


def test_a_light_in_an_own_model_is_found(models, edit):
    edit("pendulum.xml", "<worldbody>", '<worldbody><light name="sun"/>')
    assert gone(models / "pendulum.xml") == ["light sun"]


def test_every_setting_of_a_case_is_watched(models, edit):
    edit("pendulum.toml", r'solvers = \["mujoco", ', 'solvers = ["mujoco", "mujoco:fine", ')
    with (models / "pendulum.toml").open("a") as sidecar:
        sidecar.write('\n[settings."mujoco:fine"]\ntimestep = 5e-4\n')
    scene = scene_of(models / "pendulum.xml", 1.0)
    assert [w.name for w in scene.watches] == ["pendulum duration", "pendulum duration, fine"]
    steps = [w.before.steps for w in scene.watches]
    assert steps[1] > 1.5 * steps[0]
