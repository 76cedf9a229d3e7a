"""``assert_agrees`` fails with the number first, then the place and the cause."""

import mujoco
import numpy as np
import pytest

from proofmass import InputError, assert_agrees, load_case
from proofmass.analytic.linkages import fourbar
from tests.shipped import shipped
from tests.sim.pymunk.test_own_space import FOURBAR, fourbar_channels, make_fourbar, make_pendulum

TIME = np.linspace(0.0, 2.0, 201)
LENGTHS = {"crank": 1.0, "coupler": 2.0, "rocker": 2.5, "ground": 3.0}
TRUE = fourbar.solve(TIME, **LENGTHS)
COLUMNS = {"time": TIME, "theta": TIME}
COLUMNS |= {name: TRUE[name] for name in ("rocker_angle", "coupler_angle", "pin_vx")}
HOW = {"reference": "fourbar", "drive": ("theta", 1.0, 0.0), "tolerance": 1e-6}


def failure(*given, **how):
    """The lines of the message of a failed assertion."""
    with pytest.raises(AssertionError) as error:
        assert_agrees(*given, **how)
    return str(error.value).splitlines()


def test_arrays_are_asserted_and_a_wrong_length_is_named():
    assert_agrees(COLUMNS, **HOW, parameters=LENGTHS)
    number, cause, *_ = failure(COLUMNS, **HOW, parameters={**LENGTHS, "rocker": 2.55})
    assert float(number.partition(" x the allowed error: ")[0]) > 1e4
    assert number.endswith("curves)")
    assert cause.startswith("judge: rocker is 2.55 m; with 2.5 m all ")


def test_a_wrong_unit_is_named_by_its_factor():
    wrong = {**COLUMNS, "rocker_angle": np.degrees(COLUMNS["rocker_angle"])}
    number, cause, *_ = failure(wrong, **HOW, parameters=LENGTHS)
    assert "rocker_angle is off by" in number
    assert "57.2958" in cause


def test_nothing_judged_is_a_failure():
    how = {**HOW, "tolerance": None}
    assert failure(COLUMNS, **how, parameters=LENGTHS) == ["nothing is judged: give a tolerance"]
    with pytest.raises(InputError, match="missing"):
        assert_agrees(COLUMNS, **HOW, parameters={})


def test_a_space_is_asserted():
    space, bars = make_fourbar()
    assert_agrees(space, channels=fourbar_channels(bars), **FOURBAR)
    space, bob = make_pendulum()
    run = {"duration": 0.1, "step": 1e-3, "every": 10}
    assert_agrees(space, channels={"x": (bob, "position.x")}, **run)
    assert failure(space, channels={"m": (bob, "mass")}, **run) == [
        "nothing moved: m: it does not change"
    ]


def test_cases_and_models_are_asserted():
    case = load_case(shipped("pendulum.toml"))
    case = case.with_run("dynamics", n=11, until=0.1, solvers=("mujoco",))
    assert_agrees(case)
    wrong = case.model_copy(update={"parameters": {**case.parameters, "gravity": 9.7}})
    lines = failure([case, wrong], causes=False)
    assert " x the allowed error: " in lines[0]
    assert lines[1].startswith("✗ pendulum 2 dynamics mujoco differs: ")
    bad = case.model_copy(update={"start": "nowhere"})
    assert "no key 'nowhere'" in failure(bad)[0]
    assert failure([]) == ["nothing is checked"]


def test_a_finding_of_a_first_screen_fails_where_it_is_asked_for():
    """A swing with a servo whose step is too long."""
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><option gravity="0 0 0" timestep="0.015"/><worldbody><body>'
        '<joint name="wheel"/><inertial pos="0 0 0" mass="1" diaginertia="0.01 0.01 0.01"/></body>'
        '</worldbody><actuator><velocity name="servo" joint="wheel" kv="2" ctrlrange="-1 1"/>'
        '</actuator><keyframe><key ctrl="1"/></keyframe></mujoco>'
    )
    lines = failure(model, fail_on=["stable-step"])
    assert any(line.startswith("model: the step of 15 ms is 1.5 times") for line in lines)
