"""Tests that programs and snippets have every setting of MuJoCo as the engine's own run has it."""

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from proofmass.case.drive import motion_source
from proofmass.run.sidecar import load_case
from proofmass.run.solve import call_engine
from proofmass.sim.mjcf import compile_model
from proofmass.sim.mujoco.engine import ENGINE as MUJOCO
from proofmass.sim.mujoco.model import load
from proofmass.sim.mujoco.settings import (
    SETTING_PLACES,
    SOFTNESS_SETTINGS,
    MujocoSettings,
    configure,
    option_values,
)
from proofmass.sim.mujoco.snippet import insert_snippet
from proofmass.sim.protocol.run import Run
from proofmass.sim.protocol.settings import first_number
from proofmass.sim.protocol.tuning import Studied
from proofmass.studies.record import ParameterValue, Setting
from proofmass.studies.trade.program import snippet
from tests.programs import program_curves
from tests.shipped import shipped

PROOFMASS_SETTINGS = {
    "settled",
    "flex",
    "defaults",
}  # settings of proofmass, without an attribute in MJCF
WRITTEN_SETTINGS = sorted(MujocoSettings.model_fields.keys() - PROOFMASS_SETTINGS)
SCENE = """<mujoco>
<option><flag contact="disable" warmstart="enable"/></option><option gravity="0 0 -9"/>
<default><equality solref="0.03 1.5"/></default>
<worldbody><body name="a"><joint type="slide" axis="1 0 0"/>
<joint name="ranged" axis="0 1 0" limited="true" range="-90 90" solreflimit="0.04 0.7"/>
<geom size=".1" mass="1" pos=".1 0 0"/></body></worldbody>
<equality><connect name="pin" body1="a" anchor="0 0 0"/></equality></mujoco>"""


def mujoco_default(key: str) -> ParameterValue:
    """MuJoCo's default of a setting."""
    value: ParameterValue = MujocoSettings.model_fields[key].default
    return value


def other_values(key: str) -> list[ParameterValue]:
    """Values of a setting other than MuJoCo's default: all words, or one number or boolean."""
    value = mujoco_default(key)
    if isinstance(value, str):
        return [word for word in option_values(key) if word != value.lower()]
    if isinstance(value, bool):
        return [not value]
    if isinstance(value, int):
        return [value + 3]
    return [0.7 * value] if isinstance(value, float) else [tuple(0.9 * each for each in value)]


SETTINGS_AND_VALUES = [(key, value) for key in WRITTEN_SETTINGS for value in other_values(key)]


def model_options(model: mujoco.MjModel) -> dict[str, object]:
    """All options of a compiled model, and the softness of its equalities and limits."""
    fields = [name for name in dir(model.opt) if not name.startswith("_")]
    found = {name: np.asarray(getattr(model.opt, name)).tolist() for name in fields}
    assert {"timestep", "cone", "disableflags", "noslip_iterations"} <= found.keys()
    soft = {
        f"{of}_{key}": getattr(model, f"{of}_{key}")
        for of in ("eq", "jnt")
        for key in SOFTNESS_SETTINGS
    }
    return {**found, **{name: rows.tolist() for name, rows in soft.items()}}


def run_with_settings(settings: dict) -> Run:
    return Run("dynamics", np.linspace(0.0, 0.1, 2), (), settings=settings)


def model_of_program(file: Path, settings: dict) -> mujoco.MjModel:
    """The compiled model of a program."""
    names: dict = {"__name__": "run"}
    exec(MUJOCO.programs.write_program(file, run_with_settings(settings), "", ""), names)
    return mujoco.MjModel.from_xml_string(names["MODEL"])


def model_of_run(file: Path, settings: dict) -> mujoco.MjModel:
    """The compiled model that a run of the engine steps."""
    model, _ = load(file, run_with_settings(settings))
    model.opt.timestep = run_with_settings(settings).steps(model.opt.timestep)[1]
    return model


def model_of_snippet(file: Path, settings: dict) -> mujoco.MjModel:
    """The compiled model of a file into which a snippet is inserted."""
    return mujoco.MjModel.from_xml_string(
        insert_snippet(file, snippet(Setting("mujoco", settings), 1, file))
    )


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    file = tmp_path / "scene.xml"
    file.write_text(SCENE)
    return file


def test_every_setting_is_written_or_one_of_proofmass() -> None:
    assert SETTING_PLACES.keys() | PROOFMASS_SETTINGS == MujocoSettings.model_fields.keys()


def test_default_settings_are_those_of_mujoco() -> None:
    default_model = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><body name="a"><joint/><geom size="1"/></body></worldbody><equality>'
        '<connect body1="a" anchor="0 0 0"/></equality></mujoco>'
    )
    before = model_options(default_model)
    configure(default_model, {key: mujoco_default(key) for key in WRITTEN_SETTINGS})
    assert model_options(default_model) == before


@pytest.mark.parametrize(("key", "value"), SETTINGS_AND_VALUES)
def test_a_setting_is_written_as_it_is_applied(
    key: str, value: ParameterValue, scene: Path
) -> None:
    """A program, a snippet and a run of the engine have the same options for each setting.

    This holds also if a setting returns to its default in a file that states another value: MuJoCo
    merges option elements, and flags one by one.
    """
    run_model = model_of_run(scene, {key: value})
    assert model_options(run_model) != model_options(model_of_run(scene, {}))
    assert model_options(model_of_program(scene, {key: value})) == model_options(run_model)
    applied = compile_model(scene)
    configure(applied, {key: value})
    assert model_options(model_of_snippet(scene, {key: value})) == model_options(applied)
    scene.write_text(insert_snippet(scene, snippet(Setting("mujoco", {key: value}), 1, scene)))
    assert model_options(compile_model(scene)) == model_options(applied)
    assert (
        model_options(model_of_program(scene, {}))
        == model_options(model_of_run(scene, {}))
        == model_options(run_model)
    )
    back = model_of_run(scene, {key: mujoco_default(key)})
    assert model_options(back) != model_options(run_model)
    assert model_options(model_of_program(scene, {key: mujoco_default(key)})) == model_options(back)
    configure(applied, {key: mujoco_default(key)})
    assert model_options(model_of_snippet(scene, {key: mujoco_default(key)})) == model_options(
        applied
    )


def test_a_snippet_refers_settings_of_proofmass_to_the_sidecar(scene: Path) -> None:
    every: dict[str, ParameterValue] = {key: other_values(key)[0] for key in WRITTEN_SETTINGS}
    assert "sidecar" not in snippet(Setting("mujoco", every), 1, scene)
    assert "settings of the sidecar: settled = true" in snippet(
        Setting("mujoco", {**every, "settled": True}), 1, scene
    )


SLIDING_BODY = """<mujoco><compiler angle="radian"/><option timestep="2e-3"/><worldbody>
<geom type="plane" size="9 9 1"/><body name="a" pos="0 0 .1">
<joint name="x" type="slide" axis="1 0 0" frictionloss=".5"/>
<joint name="z" type="slide" axis="0 0 1"/><joint name="turn" axis="0 1 0"/>
<geom size=".1" mass="1" pos=".1 0 0"/></body></worldbody>
<sensor><jointpos name="x" joint="x"/><jointpos name="turn" joint="turn"/></sensor>
<keyframe><key name="start" qvel="1 0 0"/></keyframe></mujoco>"""


@pytest.mark.parametrize(
    "settings",
    [{"cone": "elliptic"}, {"cone": "elliptic", "impratio": 10.0}, {"noslip_iterations": 3}],
)
def test_a_program_with_contacts_equals_the_engines_run(settings: dict, tmp_path: Path) -> None:
    """A program and a run of the engine are equal bit by bit.

    Warm start is off, since reading a sample changes the start of the next step's solver.
    """
    file = tmp_path / "sliding.xml"
    file.write_text(SLIDING_BODY)

    def run(settings: dict) -> Run:
        return Run(
            "dynamics",
            np.linspace(0.0, 0.3, 16),
            ("x", "turn"),
            settings={"warmstart": False, **settings},
        )

    wanted = call_engine("mujoco", file, run(settings)).channels
    fewer = dict(list(settings.items())[:-1])
    without = call_engine("mujoco", file, run(fewer)).channels
    found = program_curves(MUJOCO.programs.write_program(file, run(settings), "", ""), tmp_path)
    for name, curve in wanted.items():
        assert found[name].tolist() == curve.tolist()
        assert np.abs(curve - without[name]).max() > 1e-9  # the last of the settings acts


@pytest.mark.parametrize(
    ("changed", "unchanged"),
    [
        ({"refsafe": False}, {}),
        ({"solver": "CG", "iterations": 2}, {"solver": "CG", "iterations": 2, "warmstart": True}),
    ],
)
def test_a_program_with_a_loop_equals_the_engines_run(
    changed: dict, unchanged: dict, tmp_path: Path
) -> None:
    """A program and a run of the engine are equal bit by bit.

    The loop has a time constant of one step, or the solver two iterations a step.
    """
    base = {
        "timestep": 4e-3,
        "integrator": "RK4",
        "solref": (0.004, 1.0),
        "solimp": (0.9999, 0.9999, 0.001),
        "warmstart": False,
    }
    case = load_case(shipped("fourbar.toml"))
    table = case.run["dynamics"].model_copy(update={"n": 21})
    case = case.model_copy(update={"run": {"dynamics": table}})
    _, run = Setting("mujoco", {**base, **changed}).apply_to(case, "dynamics")
    _, other = Setting("mujoco", {**base, **unchanged}).apply_to(case, "dynamics")
    motion = motion_source([each.profile for each in run.drives], run.x)
    found = program_curves(
        MUJOCO.programs.write_program(case.model_path, run, motion, ""), tmp_path
    )
    wanted = call_engine("mujoco", case.model_path, run).channels
    without = call_engine("mujoco", case.model_path, other).channels
    for name, curve in wanted.items():
        assert found[name].tolist() == curve.tolist()
    assert max(np.abs(curve - without[name]).max() for name, curve in wanted.items()) > 1e-7


def test_limits_take_the_time_constant_of_loops_and_keep_their_damping_ratio(scene: Path) -> None:
    """The speed after an impact on a limit depends on the damping ratio.

    A ``solref`` of stiffness and damping states neither a time constant nor a damping ratio.
    """
    run_model = model_of_run(scene, {"solref": (0.002, 1.0), "solimp": (0.99, 0.999)})
    assert run_model.jnt_solref[1].tolist() == [0.002, 0.7]
    assert run_model.jnt_solimp[1].tolist() == [0.99, 0.999, 0.001, 0.5, 2.0]
    assert run_model.jnt_solref[0].tolist() == [0.02, 1.0]  # it has no range
    assert model_of_run(scene, {"solref": (-100.0, -10.0)}).jnt_solref[1].tolist() == [0.04, 0.7]
    scene.write_text(SCENE.replace("0.04 0.7", "-500 -20"))
    stiff = model_of_run(scene, {"solref": (0.002, 1.0)})
    assert stiff.jnt_solref[1].tolist() == [-500.0, -20.0]


@pytest.mark.parametrize(("limited", "softest"), [("true", 128), ("false", 8)])
def test_impacts_on_limits_are_tried_with_more_steps(limited: str, softest: int) -> None:
    """An impact lasts about a time constant, and its error depends on the steps in this time."""
    model = mujoco.MjModel.from_xml_string(SCENE.replace('limited="true"', f'limited="{limited}"'))
    about = Studied(model, np.linspace(0.0, 1.0, 11), 1e4, False, False, lambda: False)
    tried = [
        first_number(one.parameters(1.0).get("solref", 0.0)) for one in MUJOCO.tuning.recipes(about)
    ]
    assert max(tried) == softest
    driven = replace(about, driven=True)
    tried = [
        first_number(one.parameters(1.0).get("solref", 0.0))
        for one in MUJOCO.tuning.recipes(driven)
    ]
    assert max(tried) == 8
