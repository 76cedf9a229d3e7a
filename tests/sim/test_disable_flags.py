"""Tests that features which a model's ``<flag>`` disables are as if absent, in every engine."""

import mujoco
import numpy as np
import pytest

from proofmass.analytic import planar
from proofmass.sim.mujoco import engine as with_mujoco
from proofmass.sim.protocol.failures import BadModel, Unsupported
from proofmass.sim.protocol.run import Drive, Run
from proofmass.sim.pymunk import engine as with_pymunk

MODEL = """<mujoco><compiler angle="radian"/>
<option gravity="{gravity}" integrator="RK4"><flag contact="disable" {flag}/></option><worldbody>
  <body name="a"><joint name="a"/><inertial pos=".5 0 0" mass="1" diaginertia=".1 .1 .1"/>
    <site name="a_end" pos="1 0 0"/></body>
  <body name="b" pos="3 0 0"><joint name="b" {joint}/>
    <inertial pos="0 -.5 0" mass="1" diaginertia=".1 .1 .1"/><site name="end" pos="0 -1 0"/></body>
</worldbody><equality>{loop}</equality><actuator><motor name="motor" joint="a"/>
  <motor name="load" joint="b" {load}/></actuator><sensor><jointpos name="b" joint="b"/>
  <framelinacc name="acc" objtype="site" objname="end"/><e_potential name="energy"/>
  <actuatorfrc name="hold" actuator="motor"/></sensor>
<keyframe><key name="start" qpos=".1 .2" ctrl="0 {ctrl}"/></keyframe></mujoco>"""
PLAIN = {
    "gravity": "1 -9 0",
    "joint": 'stiffness="2" springref=".1"',
    "loop": "",
    "load": "",
    "ctrl": ".3",
}
LOOP = '<connect name="loop" site1="a_end" site2="end"/>'
STOP = ' limited="true" range=".19 .21"'
FRICTION = ' frictionloss="3"'
WITH_AND_WITHOUT = {
    "gravity": ({}, {"gravity": "0 0 0"}),
    "spring": ({}, {"joint": ""}),
    "damper": ({"joint": PLAIN["joint"] + ' damping=".5"'}, {}),
    "limit": ({"joint": PLAIN["joint"] + STOP}, {}),
    "frictionloss": ({"joint": PLAIN["joint"] + FRICTION}, {}),
    "equality": ({"loop": LOOP}, {}),
    "constraint": ({"joint": PLAIN["joint"] + STOP + FRICTION, "loop": LOOP}, {}),
    "actuation": ({}, {"ctrl": "0"}),
    "clampctrl": ({"load": 'ctrllimited="true" ctrlrange="-.1 .1"'}, {}),
}
ENGINES = {"mujoco": with_mujoco.simulate, "pymunk": with_pymunk.simulate}
DRIVE = Drive("a", lambda x: (0.1 + x, 1 + 0 * x, 0 * x))
RUNS = {
    "dynamics": Run("dynamics", np.linspace(0, 0.5, 11), ("b", "acc.x", "acc.y", "energy")),
    "sweep": Run("sweep", np.linspace(0, 1, 5), ("b", "energy", "hold"), (DRIVE,)),
    "settled": Run(
        "sweep",
        np.linspace(0, 0.2, 2),
        ("b", "energy", "hold"),
        (DRIVE,),
        settings={"settled": True},
    ),
}


def write_model(tmp_path, name, changed, flag=""):
    file = tmp_path / f"{name}.xml"
    file.write_text(MODEL.format(**{**PLAIN, **changed}, flag=f'{flag}="disable"' if flag else ""))
    return file


EACH_RUN_AND_FLAG = pytest.mark.parametrize(
    ("engine", "kind", "flag"),
    [
        (engine, kind, flag)
        for engine, kind in (
            ("mujoco", "dynamics"),
            ("pymunk", "dynamics"),
            ("mujoco", "sweep"),
            ("pymunk", "sweep"),
            ("mujoco", "settled"),
        )
        for flag in WITH_AND_WITHOUT
        if flag != "damper" or kind == "dynamics"  # at rest a damper has no force
    ],
)


@EACH_RUN_AND_FLAG
def test_disabled_features_are_as_if_absent(engine, kind, flag, tmp_path):
    present, absent = WITH_AND_WITHOUT[flag]
    one, two = (
        ENGINES[engine](file, RUNS[kind])
        for file in (
            write_model(tmp_path, "disabled", present, flag),
            write_model(tmp_path, "absent", absent),
        )
    )
    for name in RUNS[kind].channels:
        np.testing.assert_allclose(
            one.channels[name], two.channels[name], rtol=0, atol=1e-12, err_msg=name
        )  # rounding: sums have another order


@EACH_RUN_AND_FLAG
def test_features_that_are_not_disabled_have_an_effect(engine, kind, flag, tmp_path):
    """Negative control: without the flag a curve changes by over 1e-3, or the model is refused.

    The loop of this model is open in the start pose, and only runs in time can have so much
    friction.
    """
    present, absent = WITH_AND_WITHOUT[flag]
    file = write_model(tmp_path, "present", present)
    if flag in ("equality", "constraint"):
        with pytest.raises(BadModel, match="loop 'loop' is open"):
            ENGINES[engine](file, RUNS[kind])
        return
    if flag == "frictionloss" and kind != "dynamics":
        with pytest.raises((BadModel, Unsupported), match=r"friction(loss)? of joint 'b'"):
            ENGINES[engine](file, RUNS[kind])
        return
    one, two = (
        ENGINES[engine](file, RUNS[kind]).channels
        for file in (file, write_model(tmp_path, "absent", absent))
    )
    assert max(np.abs(one[name] - two[name]).max() for name in RUNS[kind].channels) > 1e-3


@pytest.mark.parametrize("flag", WITH_AND_WITHOUT)
def test_features_that_are_not_disabled_have_an_effect_in_the_planar_reference(flag, tmp_path):
    """Negative control: as in the engines."""
    present, absent = WITH_AND_WITHOUT[flag]
    model = mujoco.MjModel.from_xml_path(str(write_model(tmp_path, "present", present)))
    if flag in ("equality", "constraint"):
        with pytest.raises(ValueError, match="loop 'loop' stays open"):
            planar.solve(RUNS["dynamics"].x, model=model)
        return
    without = mujoco.MjModel.from_xml_path(str(write_model(tmp_path, "absent", absent)))
    one, two = (planar.solve(RUNS["dynamics"].x, model=m) for m in (model, without))
    assert max(np.abs(one[name] - two[name]).max() for name in RUNS["dynamics"].channels) > 1e-3


@pytest.mark.parametrize("flag", WITH_AND_WITHOUT)
def test_the_planar_reference_leaves_out_disabled_features(flag, tmp_path):
    present, absent = WITH_AND_WITHOUT[flag]
    one, two = (
        planar.solve(RUNS["dynamics"].x, model=mujoco.MjModel.from_xml_path(str(file)))
        for file in (
            write_model(tmp_path, "disabled", present, flag),
            write_model(tmp_path, "absent", absent),
        )
    )
    for name in RUNS["dynamics"].channels:
        np.testing.assert_array_equal(one[name], two[name], err_msg=name)


@pytest.mark.parametrize(
    "limits", ['ctrllimited="true" ctrlrange="-.1 .1"', 'forcelimited="true" forcerange="-.1 .1"']
)
def test_the_planar_reference_keeps_a_motor_in_its_ranges(limits, tmp_path):
    one, two = (
        planar.solve(RUNS["dynamics"].x, model=mujoco.MjModel.from_xml_path(str(file)))
        for file in (
            write_model(tmp_path, "limited", {"load": limits}),
            write_model(tmp_path, "less", {"ctrl": ".1"}),
        )
    )
    # rounding: a force with a range is not part of the joint's own load, so sums have another order
    np.testing.assert_allclose(one["b"], two["b"], rtol=0, atol=1e-13)


def test_the_planar_reference_refuses_actuators_other_than_motors(tmp_path):
    file = write_model(tmp_path, "servo", {})
    lagging = '<general name="servo" dyntype="filter" dynprm="1"'
    file.write_text(file.read_text().replace('<motor name="load"', lagging))
    with pytest.raises(ValueError, match="activation of actuator 'servo'"):
        planar.solve(RUNS["dynamics"].x, model=mujoco.MjModel.from_xml_path(str(file)))


def test_models_with_disabled_sensors_are_refused(tmp_path):
    with pytest.raises(Unsupported, match='sensor="disable"'):
        with_mujoco.simulate(write_model(tmp_path, "blind", {}, "sensor"), RUNS["dynamics"])
