"""Tests of models without a sidecar, which MuJoCo steps as it would by itself."""

import sys

import numpy as np
import pytest

from proofmass.batch.check import check
from proofmass.batch.work import check_model_here
from proofmass.sim.model_source import ModelSource
from proofmass.sim.mujoco import own_motion
from proofmass.sim.mujoco.engine import simulate
from proofmass.sim.protocol.failures import BadModel
from proofmass.sim.protocol.run import Run

BALL = '<body name="b" pos="0 0 1">{}<geom size=".1"/></body>'
OFF_CENTRE = '<geom size=".1" pos=".2 0 0"/>'
HINGE = BALL.format(f'<joint name="b" axis="0 1 0"/>{OFF_CENTRE}')
FREE = BALL.format("<freejoint/>")
TWO_HINGES = HINGE + (
    f'<body name="c" pos="1 0 1"><joint name="c" axis="0 1 0"/>{OFF_CENTRE}<geom size=".1"/></body>'
)
JOINT_SENSOR = '<sensor><jointpos name="b" joint="b"/></sensor>'
TWO_KEYS = '<keyframe><key {} qpos=".3"/><key {} qpos=".6"/></keyframe>'
MODELS = {
    "keys of other names": (HINGE, TWO_KEYS.format('name="squat"', 'name="prone"')),
    "keys without names": (HINGE, TWO_KEYS.format("", "")),
    "a weld": (TWO_HINGES, '<equality><weld body1="b" body2="c"/></equality>'),
    "a loop that is open at first": (
        TWO_HINGES,
        '<equality><connect body1="b" body2="c" '
        'anchor="0 0 .5"/></equality><keyframe><key qpos="1 0"/>'
        "</keyframe>",
    ),
    "an actuator with a state": (
        HINGE,
        '<actuator><general joint="b" dyntype="integrator" gainprm="1"/></actuator>',
    ),
    "an actuator of two inputs": (
        HINGE,
        '<actuator><dcmotor joint="b" motorconst="1" '
        'resistance="1" input="pos vel" controller="10 0 5"/>'
        '<motor joint="b"/></actuator>',
    ),
    "an actuator of three outputs": (
        BALL.format(f'<joint name="b" type="ball"/>{OFF_CENTRE}'),
        '<actuator><orientation joint="b" kp="1"/></actuator>',
    ),
    "a plugin": (
        HINGE,
        '<extension><plugin plugin="mujoco.pid"><instance name="p">'
        '<config key="kp" value="4"/></instance></plugin></extension><actuator>'
        '<plugin joint="b" plugin="mujoco.pid" instance="p"/></actuator>',
    ),
    "a flex": (
        '<flexcomp name="cloth" type="grid" count="3 3 1" spacing=".1 .1 .1" dim="2" mass="1"/>',
        '<equality><flex flex="cloth"/></equality>',
    ),
    "contacts, a tendon, a mocap body": (
        '<geom type="plane" size="5 5 1"/><body mocap="true" name="hand" pos="0 0 .9"><site '
        'name="h"/></body>'
        + FREE.replace("</body>", '<site name="s"/></body>').replace("0 0 1", "0 0 .3"),
        '<tendon><spatial range="0 .8" limited="true"><site site="h"/><site site="s"/></spatial>'
        "</tendon>",
    ),
    "no joints": (BALL.format(""), ""),
}


def write_model(tmp_path, bodies, more):
    file = tmp_path / "foreign.xml"
    file.write_text(f"<mujoco><worldbody>{bodies}</worldbody>{more}</mujoco>")
    return file


@pytest.mark.parametrize("name", MODELS)
def test_a_model_without_a_sidecar_is_self_consistent(name, tmp_path, monkeypatch):
    """Each model is self-consistent for 0.3 s; without joints nothing moves.

    In this time the ball of the model with contacts falls 0.2 m, to the floor and to the limit of
    its tendon.
    """
    monkeypatch.setattr(own_motion, "MAX_HALVINGS", own_motion.MIN_HALVINGS)
    monkeypatch.setattr(sys.modules[check_model_here.__module__], "OWN_MODEL_SECONDS", 0.3)
    found = check_model_here(ModelSource(write_model(tmp_path, *MODELS[name])))
    assert found.outcome == ("nothing moved" if name == "no joints" else "self-consistent")
    assert found.steps == 150  # of 2 ms


@pytest.mark.parametrize(
    ("keys", "first"),
    [
        (TWO_KEYS.format('name="squat"', 'name="prone"'), 0.3),
        (TWO_KEYS.format("", ""), 0.3),
        (TWO_KEYS.format('name="squat"', 'name="start"'), 0.6),
        ("", 0.0),
    ],
)
def test_a_model_starts_from_key_start_or_its_first_key_or_none(keys, first, tmp_path):
    file = write_model(tmp_path, HINGE, JOINT_SENSOR + keys)
    curves = simulate(file, Run("passive", np.linspace(0, 0.1, 2), ()))
    assert curves.channels["b"][0] == first


def test_a_free_ball_falls_as_semi_implicit_euler_steps_it(tmp_path):
    file = write_model(
        tmp_path, FREE, '<sensor><framepos name="p" objtype="body" objname="b"/></sensor>'
    )
    curves = simulate(file, Run("passive", np.linspace(0, 0.1, 2), ()))
    steps = np.arange(1, 51)  # semi-implicit Euler: the velocity is updated before the position
    assert curves.channels["p[2]"][1] == pytest.approx(1 - 9.81 * 0.002**2 * steps.sum(), abs=1e-12)


def test_a_case_without_the_key_start_lists_the_models_keys(tmp_path):
    file = write_model(tmp_path, HINGE, JOINT_SENSOR + MODELS["keys of other names"][1])
    with pytest.raises(BadModel, match="no <key> named 'start'; there are: squat, prone"):
        simulate(file, Run("dynamics", np.linspace(0, 0.1, 2), ("b",)))


def test_a_model_that_mujoco_refuses_is_bad_input_with_its_message(tmp_path):
    result = check([write_model(tmp_path, '<body><joint type="screw"/></body>', "")])
    assert result.exit_code == 2
    assert "foreign.xml: XML Error: invalid keyword: 'screw'" in str(result.errors[0])
