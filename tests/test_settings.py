"""Settings of engines are checked before anything runs: bad ones are named, with their key."""

import pytest

from proofmass.check import check
from sim.mujoco_model import MujocoSettings
from sim.protocol import BadSetting
from sim.with_mujoco import check_settings as mujoco_settings
from sim.with_pymunk import check_settings as pymunk_settings

WRONG = {
    "solref = [0.002, 1, 1]": "solref: give a time constant",
    'solref = "0.002 one"': "solref: '0.002 one' is no list of numbers",
    "solref = [0.002, -1]": "solref: give a time constant",
    "solimp = [0.9, 1.5]": "solimp: give up to five numbers: dmin and dmax in",
    "iterations = 0": "iterations: Input should be greater than or equal to 1, not 0",
    "iterations = 2.5": "iterations: Input should be a valid integer",
    "timestep = 0": "timestep: Input should be greater than 0",
    "timestep = inf": "timestep: Input should be a finite number",
    'timestep = "1e-3"': "timestep: Input should be a valid number",
    "tolerance = true": "tolerance: Input should be a valid number",
    "settled = 1": "settled: Input should be a valid boolean",
    'integrator = "RK5"': "integrator: known: euler, rk4, ",
}


@pytest.mark.parametrize("wrong", WRONG)
def test_a_wrong_setting_is_bad_input_once_and_nothing_runs(models, edit, wrong):
    file = models / "pendulum.toml"
    file.write_text(f'{file.read_text()}\n[settings.mujoco]\n{wrong}\n')
    result = check([file])
    assert result.exit_code == 2
    assert result.comparisons == []
    [error] = map(str, result.errors)
    assert f'pendulum.toml: settings.mujoco.{WRONG[wrong]}' in error


def test_pymunk_states_its_own():
    pymunk_settings({"timestep": 1e-3, "iterations": 10, "error_bias": 0.0, "defaults": True})
    for wrong in ({"error_bias": 2.0}, {"iterations": 0}, {"iterations": 2**30},
                  {"solref": (0.02, 1.0)}):
        with pytest.raises(BadSetting, match=next(iter(wrong))):
            pymunk_settings(wrong)


def test_numbers_may_be_spelled_as_in_mjcf():
    assert MujocoSettings.read({"solref": "0.002 1"}).solref == (0.002, 1.0)
    mujoco_settings({"solref": [-1000, -10], "solimp": "0.9 0.95", "integrator": "RK4"})


def test_a_drive_parameter_that_the_law_does_not_have_is_named(models, edit):
    edit("threeprr_circle.toml", r"(?m)(\[drive.parameters\]\n)centre_x", r"\1center_x")
    edit("fivebar_circle.toml", r"(?m)(\[drive.parameters\]\n)center_x", r"\1centre_x")
    result = check([models / "threeprr_circle.toml", models / "fivebar_circle.toml"])
    first, second = map(str, result.errors)
    assert "threeprr_circle.toml: drive.0.parameters.center_x: circle() has no such parameter; " \
        "did you mean 'centre_x'? known: centre_x, centre_y, radius" in first
    assert "fivebar_circle.toml: drive.parameters: " in second
    assert "'center_x'" in second
    assert result.comparisons == []


def test_a_slip_in_the_sidecar_is_told_once_and_in_the_sidecar(models, edit):
    edit("fourbar.toml", 'joint = "crank"', 'joint = "cranck"')
    [error] = map(str, check([models / "fourbar.toml"]).errors)
    assert error.endswith("fourbar.toml: drive.joint: fourbar.xml has no joint 'cranck'; did you "
                          "mean 'crank'? there are: crank, coupler, rocker")
