"""Tests of engine settings: bad ones are refused with their key before anything runs."""

from xml.etree import ElementTree

import mujoco
import numpy as np
import pymunk
import pytest

from proofmass.batch.check import check
from proofmass.run.sidecar import load_case
from proofmass.sim.contents import has_dry_friction, may_touch
from proofmass.sim.mujoco.settings import (
    HARD_SOLIMP,
    STAGES,
    MujocoSettings,
    configure,
    limited_joints,
    mjcf_text,
    read_options,
    stepping_settings,
    write_options,
)
from proofmass.sim.protocol.failures import BadSetting
from proofmass.sim.protocol.run import Run
from proofmass.sim.pymunk.engine import ENGINE as PYMUNK
from proofmass.sim.pymunk.settings import PymunkSettings, settings_of_run
from proofmass.sim.recorded.engine import RecordedSettings
from proofmass.studies.trade.varied import list_series

WRONG_SETTINGS = {
    "solref = [0.002, 1, 1]": "solref: give a time constant",
    'solref = "0.002 one"': "solref: '0.002 one' is no list of numbers",
    "solref = [0.002, -1]": "solref: give a time constant",
    "solimp = [0.9, 1.5]": "solimp: give up to five numbers: dmin and dmax in",
    "iterations = 0": "iterations: Input should be greater than or equal to 1, not 0",
    "iterations = 2.5": "iterations: Input should be a valid integer",
    "timestep = 0": "timestep: Input should be greater than 0",
    "timestep = inf": "timestep: Input should be a finite number",
    'timestep = "1e-3"': "timestep: Input should be a valid number",
    'cone = "round"': "cone: known: pyramidal, elliptic, not 'round'",
    "impratio = 0": "impratio: Input should be greater than 0",
    "noslip_iterations = -1": "noslip_iterations: Input should be greater than or equal to 0",
    "refsafe = 0": "refsafe: Input should be a valid boolean",
    "tolerance = true": "tolerance: Input should be a valid number",
    "settled = 1": "settled: Input should be a valid boolean",
    'integrator = "RK5"': "integrator: known: euler, rk4, ",
}


@pytest.mark.parametrize("wrong", WRONG_SETTINGS)
def test_a_wrong_setting_is_reported_once_and_nothing_runs(models, wrong):
    file = models / "pendulum.toml"
    file.write_text(f"{file.read_text()}\n[settings.mujoco]\n{wrong}\n")
    result = check([file])
    assert result.exit_code == 2
    assert result.comparisons == []
    [error] = map(str, result.errors)
    assert f"pendulum.toml: settings.mujoco.{WRONG_SETTINGS[wrong]}" in error


def test_pymunk_checks_its_own_settings():
    PYMUNK.check_settings({"timestep": 1e-3, "iterations": 10, "error_bias": 0.0, "defaults": True})
    for wrong in (
        {"error_bias": 2.0},
        {"iterations": 0},
        {"iterations": 2**30},
        {"solref": (0.02, 1.0)},
    ):
        with pytest.raises(BadSetting, match=next(iter(wrong))):
            PYMUNK.check_settings(wrong)


@pytest.mark.parametrize(
    ("allowed", "refused"),
    [
        ({"timestep": 1e-9}, {"timestep": 0.0}),
        ({"error_bias": 1.0}, {"error_bias": 1.001}),
        ({"error_bias": 0.0}, {"error_bias": -1e-9}),
        ({"collision_bias": 1.0}, {"collision_bias": 1.001}),
        ({"collision_bias": 0.0}, {"collision_bias": -1e-9}),
        ({"collision_slop": 0.0}, {"collision_slop": -1e-9}),
        ({"iterations": 2**31 // 10 - 1}, {"iterations": 2**31 // 10}),
    ],
)
def test_the_edges_of_the_ranges_of_pymunks_settings(allowed, refused):
    PYMUNK.check_settings(allowed)
    with pytest.raises(BadSetting, match=next(iter(refused))):
        PYMUNK.check_settings(refused)


def pymunk_run(**settings: object) -> Run:
    """A run whose only content are settings."""
    return Run("dynamics", np.array([0.0, 1.0]), (), settings=settings)


SINGLE_PRECISION = 4e-6
"""Chipmunk computes 0.9**60 in single precision: 60 times its rounding."""


def test_default_settings_of_pymunk_are_those_of_chipmunk():
    space = pymunk.Space()
    pin = pymunk.PinJoint(space.static_body, pymunk.Body(1.0, 1.0))
    own = {
        "iterations": space.iterations,
        "error_bias": pin.error_bias,
        "collision_slop": space.collision_slop,
        "collision_bias": space.collision_bias,
    }
    fields = PymunkSettings.model_fields
    assert {key: fields[key].default for key in own} == pytest.approx(own, rel=SINGLE_PRECISION)
    model = compiled_scene()
    found = settings_of_run(pymunk_run(defaults=True), model, touching=True)
    assert found == pytest.approx({"timestep": 2e-3, **own}, rel=SINGLE_PRECISION)


@pytest.mark.parametrize("touching", [False, True])
def test_settings_of_pymunk_that_are_not_given_are_those_of_the_documentation(touching):
    """The step is the model's; contacts have settings only where there are contacts."""
    contacts = {"collision_slop": 1e-6, "collision_bias": 0.9**60} if touching else {}
    found = settings_of_run(pymunk_run(), compiled_scene(), touching)
    assert found.pop("iterations") is None  # as many as the poses need
    assert found == pytest.approx({"timestep": 2e-3, "error_bias": 0.0, **contacts}, rel=1e-15)
    given = {"timestep": 1e-4, "iterations": 7, "error_bias": 0.5, "collision_slop": 0.2}
    found = settings_of_run(pymunk_run(**given, defaults=True), compiled_scene(), touching)
    assert {key: found[key] for key in given} == given
    slow = compiled_scene()
    slow.opt.timestep = 3e-3
    assert settings_of_run(pymunk_run(defaults=True), slow, touching)["timestep"] == 3e-3


@pytest.mark.parametrize(
    ("allowed", "refused"),
    [
        ({"solref": [1e-9]}, {"solref": [0.0]}),
        ({"solref": (0.02, 1e-9)}, {"solref": (0.02, 0.0)}),
        ({"solref": (-1.0, 0.0)}, {"solref": (-1.0, 1e-9)}),
        ({"solref": (0.0, 0.0)}, {"solref": [-1.0]}),
        ({"solimp": [1.0]}, {"solimp": [1.001]}),
        ({"solimp": (0.9, 1.0)}, {"solimp": (0.9, 1.001)}),
        ({"solimp": (0.9, 0.9, 0.0)}, {"solimp": (0.9, 0.9, -1e-9)}),
        ({"solimp": (0.0, 1.0, 0.0, 0.0, 1.0)}, {"solimp": (0.0, 1.0, 0.0, 0.0, 0.999)}),
        ({"solimp": (0.9, 0.9, 9e9, 1.0, 9e9)}, {"solimp": (0.9, 0.9, 0.1, 1.001, 2.0)}),
        ({"solimp": (0.9, 0.0)}, {"solimp": (0.9, -0.001)}),
        ({"tolerance": 0.0}, {"tolerance": -1e-12}),
        ({"noslip_iterations": 2**31 - 1}, {"noslip_iterations": 2**31}),
    ],
)
def test_the_edges_of_the_ranges_of_settings(allowed, refused):
    MujocoSettings.read(allowed)
    with pytest.raises(BadSetting, match=next(iter(refused))):
        MujocoSettings.read(refused)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"stepsize": 1}, "unknown setting 'stepsize'; known: timestep, iterations, error_bias, "),
        ({"timestep": "fast"}, "Input should be a valid number, not 'fast'"),
        ({"timestep": {"a": 1}}, "Input should be a valid number"),
    ],
)
def test_the_message_of_a_wrong_setting_begins_with_what_is_wrong(wrong, words):
    with pytest.raises(BadSetting) as error:
        PymunkSettings.read(wrong)
    key, what = error.value.args
    assert key == next(iter(wrong))
    assert what.startswith(words)
    assert "{" not in what


def test_a_setting_that_a_file_has_to_state_is_missing():
    with pytest.raises(BadSetting) as error:
        RecordedSettings.read({})
    assert error.value.args == ("file", "missing; it is required")
    with pytest.raises(BadSetting) as error:
        RecordedSettings.read({"file": "a.csv", "channels": {"pin.x": {"scale": "wide"}}})
    assert error.value.args == ("channels.pin.x.column", "missing; it is required")


@pytest.mark.parametrize(
    ("parameters", "expected"),
    [
        ({"defaults": True}, True),
        ({"defaults": True, "timestep": 1e-4}, True),
        ({"defaults": True, "timestep": 1e-4, "iterations": 10}, True),
        ({"defaults": True, "iterations": 11}, False),
        ({"defaults": False}, False),
        ({"timestep": 2e-3, "iterations": 10}, False),  # with proofmass's own error_bias
    ],
)
def test_an_engine_is_at_its_defaults_whatever_its_step(parameters, expected):
    assert PymunkSettings.is_default(parameters) is expected


def test_the_hardest_solimp_is_the_largest_impedance_of_mujoco():
    """MuJoCo cuts a larger one, so a loop with an impedance of 1 is as hard, and not harder."""
    model = mujoco.MjModel.from_xml_string(LIMITED.replace('anchor="0 0 0"', 'anchor=".1 0 0"'))
    hardest = []
    for solimp in (HARD_SOLIMP, (1.0, 1.0, 0.001)):
        configure(model, {"solimp": solimp})
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        assert data.ne
        hardest.append(data.efc_KBIP[: data.ne, 2].tolist())
    assert hardest[0] == hardest[1]
    assert set(hardest[0]) == set(HARD_SOLIMP[:2])


@pytest.mark.parametrize("name", mujoco.mjtIntegrator.__members__)
def test_the_evaluations_of_a_step_are_those_that_mujoco_makes(name):
    model = mujoco.MjModel.from_xml_string(LIMITED)
    model.opt.integrator = mujoco.mjtIntegrator.__members__[name]
    data, calls = mujoco.MjData(model), []
    mujoco.mj_forward(model, data)
    mujoco.set_mjcb_passive(lambda *_: calls.append(1))
    try:
        mujoco.mj_step(model, data)
    finally:
        mujoco.set_mjcb_passive(None)
    assert len(calls) == STAGES.get(name.removeprefix("mjINT_"), 1)


def test_settings_may_be_written_as_in_mjcf():
    assert MujocoSettings.read({"solref": "0.002 1"}).solref == (0.002, 1.0)
    MujocoSettings.read({"solref": [-1000, -10], "solimp": "0.9 0.95", "integrator": "RK4"})


def test_default_settings_of_mujoco_are_those_of_an_empty_model():
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><body name='a'><freejoint/><geom size='1'/></body></worldbody>"
        "<equality><weld body1='a'/></equality></mujoco>"
    )
    fields = MujocoSettings.model_fields
    own = read_options(model, always=fields)
    assert len(own) == 10
    for key, value in own.items():
        default = fields[key].default
        same = (
            mjcf_text(value) == mjcf_text(default) if isinstance(default, str) else value == default
        )
        assert same, key
    assert fields["solref"].default == tuple(model.eq_solref[0])
    assert fields["solimp"].default == tuple(model.eq_solimp[0])
    # those that are quiet are neither reported nor written
    quiet = {"cone", "impratio", "noslip_iterations", "refsafe", "warmstart"}
    assert own.keys() - read_options(model).keys() == quiet
    assert read_options(model, always=["cone"]).keys() & quiet == {"cone"}


LIMITED = """<mujoco><option timestep="1e-3" integrator="RK4" iterations="7"/><worldbody>
<body name="a"><joint name="free" axis="0 1 0"/><geom size=".1"/>
<body name="b"><joint name="ends" axis="0 1 0" range="-1 1" limited="true"
  solreflimit=".03 .2" solimplimit=".8 .9 .01 .4 3"/><geom size=".1"/>
<body name="c"><joint name="stiff" axis="0 1 0" range="-1 1" limited="true"
  solreflimit="-100 -1"/><geom size=".1"/></body></body></body></worldbody>
<equality><connect body1="c" anchor="0 0 0" solref=".005 1" solimp=".99 .99"/>
<connect body1="b" anchor="0 0 0" solref=".005 1" solimp=".99 .99"/></equality></mujoco>"""


def test_softness_applies_to_loops_and_to_limits_which_keep_their_damping_ratio():
    model = mujoco.MjModel.from_xml_string(LIMITED)
    assert limited_joints(model).tolist() == [1]
    configure(model, {"solref": (0.01, 0.7), "solimp": (0.95, 0.97)})
    assert model.eq_solref.tolist() == [[0.01, 0.7]] * 2
    assert model.eq_solimp[:, :3].tolist() == [[0.95, 0.97, 0.001]] * 2
    assert model.jnt_solref.tolist() == [[0.02, 1.0], [0.01, 0.2], [-100.0, -1.0]]
    assert model.jnt_solimp[1].tolist() == [0.95, 0.97, 0.01, 0.4, 3.0]
    assert model.jnt_solimp[[0, 2], 0].tolist() == [0.9, 0.9]
    configure(model, {"solref": (-500.0, -5.0)})
    assert model.eq_solref.tolist() == [[-500.0, -5.0]] * 2
    assert model.jnt_solref[1].tolist() == [0.01, 0.2]
    configure(model, {"solref": [0.03]})  # the first number alone
    assert model.eq_solref.tolist() == [[0.03, -5.0]] * 2
    assert model.jnt_solref[1].tolist() == [0.03, 0.2]
    model.jnt_solref[1] = 0.0
    assert limited_joints(model).tolist() == []


def test_defaults_are_restored_before_other_settings():
    model = mujoco.MjModel.from_xml_string(LIMITED)
    configure(model, {"defaults": True, "timestep": 5e-3})
    assert (model.opt.timestep, model.opt.iterations) == (5e-3, 7)
    assert model.opt.integrator == mujoco.mjtIntegrator.mjINT_EULER
    assert model.eq_solref.tolist() == [[0.02, 1.0]] * 2
    assert model.eq_solimp.tolist() == [[0.9, 0.95, 0.001, 0.5, 2.0]] * 2
    model = mujoco.MjModel.from_xml_string(LIMITED)
    configure(model, {"defaults": True})
    assert model.opt.timestep == 2e-3
    model = mujoco.MjModel.from_xml_string(LIMITED)
    configure(model, {"defaults": False})
    assert (model.opt.timestep, model.eq_solref[0, 0]) == (1e-3, 0.005)


def test_the_softness_of_active_loops_is_stated_if_it_is_one():
    model = mujoco.MjModel.from_xml_string(LIMITED)
    found = stepping_settings(model)
    assert (found["solref"], found["solimp"][:2]) == ((0.005, 1.0), (0.99, 0.99))
    model.eq_solref[1, 0] = 0.006
    assert stepping_settings(model)["solref"] == "several"
    model.eq_active0[1] = 0
    assert stepping_settings(model)["solref"] == (0.005, 1.0)
    model.eq_active0[:] = 0
    assert not stepping_settings(model).keys() & {"solref", "solimp"}


def test_options_are_written_into_the_last_section():
    root = ElementTree.fromstring("<mujoco><option timestep='1'/><option timestep='2'/></mujoco>")
    write_options(root, {"timestep": 0.5, "refsafe": False, "solref": (0.1, 1.0)})
    assert [one.get("timestep") for one in root] == ["1", "0.5"]
    assert [one.get("refsafe") for one in root.iterfind("option/flag")] == ["disable"]


FALLING_BODY = """<mujoco><compiler angle="radian"/><option timestep="2e-3"{option}>{flag}</option>
<worldbody>{floor}<body name="a" pos="0 0 {height}">
<joint name="x" type="slide" axis="1 0 0" {rub}/><joint name="z" type="slide" axis="0 0 1"/>
<joint name="turn" axis="0 1 0"/>
<geom size=".1" mass="1" pos=".1 0 0"/></body></worldbody>{loop}
<keyframe><key name="start" qvel="1 0 0"/></keyframe></mujoco>"""
FLOOR = '<geom type="plane" size="1 1 1"/>'
SOFT_LOOP = '<equality><connect body1="a" anchor="0 0 0" solref="2e-3 1"/></equality>'


def compiled_scene(option="", flag="", rub="", floor="", loop="", height="0.5"):
    return mujoco.MjModel.from_xml_string(
        FALLING_BODY.format(
            option=option, flag=flag, rub=rub, floor=floor, loop=loop, height=height
        )
    )


def pose_after_300_steps(model):
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_step(model, data, 300)
    return data.qpos.copy()


@pytest.mark.parametrize(
    ("settings", "option", "flag", "there"),
    [
        ({"refsafe": False}, "", '<flag refsafe="disable"/>', {"loop": SOFT_LOOP}),
        (
            {"warmstart": False},
            ' solver="CG" iterations="2"',
            '<flag warmstart="disable"/>',
            {"floor": FLOOR, "height": "0.1"},
        ),
        (
            {"cone": "elliptic", "impratio": 10.0},
            ' cone="elliptic" impratio="10"',
            "",
            {"floor": FLOOR, "height": "0.1"},
        ),
        ({"noslip_iterations": 3}, ' noslip_iterations="3"', "", {"floor": FLOOR, "height": "0.1"}),
    ],
)
def test_settings_act_as_the_attributes_of_an_mjcf(settings, option, flag, there):
    """A setting gives the same motion as the MJCF's attribute, and another one than without it."""
    plain = ' solver="CG" iterations="2"' if "CG" in option else ""
    read, own = compiled_scene(option, flag, **there), compiled_scene(plain, **there)
    before = pose_after_300_steps(own)
    configure(own, settings)
    assert np.array_equal(pose_after_300_steps(own), pose_after_300_steps(read))
    assert not np.array_equal(pose_after_300_steps(own), before)
    assert all(
        stepping_settings(own)[key] == value
        if not isinstance(value, str)
        else str(stepping_settings(own)[key]).lower() == value
        for key, value in settings.items()
    )
    configure(own, dict.fromkeys(settings.keys() & {"refsafe", "warmstart"}, True))
    assert "refsafe" not in stepping_settings(own)


def test_possible_contacts_and_dry_friction_are_recognized():
    assert not may_touch(compiled_scene())
    assert may_touch(compiled_scene(floor=FLOOR))
    assert not may_touch(compiled_scene(floor=FLOOR, flag='<flag contact="disable"/>'))
    assert not has_dry_friction(compiled_scene())
    assert has_dry_friction(compiled_scene(rub='frictionloss="1"'))
    assert not has_dry_friction(
        compiled_scene(rub='frictionloss="1"', flag='<flag frictionloss="disable"/>')
    )


@pytest.mark.parametrize(
    ("change", "axes"),
    [("", set()), ("rub", {"noslip_iterations"}), ("touch", {"noslip_iterations", "impratio"})],
)
def test_a_study_varies_only_settings_that_act(models, edit, change, axes):
    if change == "rub":
        edit("pendulum.xml", '<joint name="pivot"/>', '<joint name="pivot" frictionloss="0.1"/>')
    if change == "touch":
        edit("pendulum.xml", "<worldbody>", '<worldbody><geom type="plane" size="9 9 9"/>')
        edit("pendulum.xml", '<flag contact="disable"/>', "")
        edit("pendulum.xml", "<geom ", '<geom contype="1" conaffinity="1" ')
    found = {
        series.varied for series in list_series(load_case(models / "pendulum.toml"), "dynamics")
    }
    assert found - {"timestep", "iterations", "error_bias"} == axes


def test_a_study_of_loops_varies_refsafe_and_warm_start(models):
    found = {
        series.name: series
        for series in list_series(load_case(models / "fourbar.toml"), "dynamics")
    }
    without_refsafe = next(line for name, line in found.items() if "refsafe off" in name)
    step = without_refsafe.settings[0].parameters["timestep"]
    assert all(
        s.parameters["refsafe"] is False and s.parameters["solref"][0] < 2 * step
        for s in without_refsafe.settings
    )
    cold = next(line for name, line in found.items() if "without warm start" in name)
    assert all(s.parameters["warmstart"] is False for s in cold.settings)


def test_unknown_parameters_of_a_motion_profile_are_refused(models, edit):
    edit("threeprr_circle.toml", r"(?m)(\[drive.parameters\]\n)centre_x", r"\1center_x")
    edit("fivebar_circle.toml", r"(?m)(\[drive.parameters\]\n)center_x", r"\1centre_x")
    result = check([models / "threeprr_circle.toml", models / "fivebar_circle.toml"])
    first, second = map(str, result.errors)
    assert (
        "threeprr_circle.toml: drive.0.parameters.center_x: circle() has no such parameter; "
        "did you mean 'centre_x'? known: centre_x, centre_y, radius" in first
    )
    assert "fivebar_circle.toml: drive.parameters: " in second
    assert "'center_x'" in second
    assert result.comparisons == []


def test_a_misspelled_joint_is_reported_once_with_the_sidecar(models, edit):
    edit("fourbar.toml", 'joint = "crank"', 'joint = "cranck"')
    [error] = map(str, check([models / "fourbar.toml"]).errors)
    assert error.endswith(
        "fourbar.toml: drive.joint: fourbar.xml has no joint 'cranck'; did you "
        "mean 'crank'? there are: crank, coupler, rocker"
    )
