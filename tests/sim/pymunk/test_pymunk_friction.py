"""Dry friction of joints in pymunk's dynamics: motors and grooves with a limited force."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from proofmass.analytic import planar
from proofmass.sim.protocol.run import ChangingLoad, Drive, Run
from proofmass.sim.pymunk.engine import ENGINE, simulate
from tests.analytic.friction_witness import chain_model, random_chain
from tests.programs import program_curves
from tests.shipped import shipped

HEAD = """<mujoco><compiler angle="radian"/><option timestep="1e-3" gravity="0 -9.81 0">
  <flag contact="disable"/></option>"""
BLOCK = f"""{HEAD}<worldbody><body name="block"><joint name="x" type="slide" axis="1 0 0"
  stiffness="100" frictionloss="3"/><geom size="0.1" mass="2"/></body></worldbody><sensor>
  <jointpos name="x" joint="x"/><jointvel name="rate" joint="x"/></sensor>
  <keyframe><key name="start" qpos="0.5"/></keyframe></mujoco>"""
ARM = f"""{HEAD}<worldbody><body><joint name="shoulder" axis="0 0 -1" frictionloss="8"/>
  <inertial pos="0.2 0 0" mass="1.2" diaginertia="0.02 0.02 0.02"/><body pos="0.4 0 0">
  <joint name="elbow" axis="0 0 -1" frictionloss="2"/><inertial pos="0.15 0 0" mass="0.7"
  diaginertia="0.008 0.008 0.008"/></body></body></worldbody><sensor><jointpos name="shoulder"
  joint="shoulder"/><jointpos name="elbow" joint="elbow"/></sensor></mujoco>"""


def run_of(path: Path, text: str, t: np.ndarray, channels: tuple[str, ...], **more):
    """The curves of a run in pymunk."""
    path.write_text(text, encoding="utf-8")
    return simulate(path, Run("dynamics", t, channels, **more)).channels


def test_a_block_on_a_spring_rests_where_the_closed_form_says(tmp_path):
    """Slides have a groove with a limited force; halts are late by a part of a step.

    In the last step of a swing friction is no larger than what stops the block: no chatter.
    """
    half, n = np.pi * np.sqrt(0.02), 8
    t = np.linspace(0.0, 10 * half, 61)
    cycle = np.minimum(t // half, n)
    known = (-1.0) ** cycle * ((0.47 - 0.06 * cycle) * np.cos(np.pi * (t / half - cycle)) + 0.03)
    known = np.where(t >= n * half, 0.02, known)
    errors = []
    for step in (1e-3, 2.5e-4):
        own = {"settings": {"timestep": step}}
        found = run_of(tmp_path / "block.xml", BLOCK, t, ("x", "rate"), **own)
        errors.append(np.abs(found["x"] - known).max())
        assert np.abs(found["rate"][t > 8.1 * half]).max() < 1e-12
    assert errors[0] < 4e-3
    assert errors[1] < 0.5 * errors[0]
    wrong = run_of(tmp_path / "block.xml", BLOCK.replace('"3"', '"3.03"'), t, ("x",))
    assert np.abs(wrong["x"] - known).max() > 2.0 * errors[1]


def test_an_arm_whose_friction_holds_it_does_not_move(tmp_path):
    """No creep: an engine whose friction is soft sinks by 0.061 rad/s and more."""
    found = run_of(tmp_path / "arm.xml", ARM, np.linspace(0, 2, 5), ("shoulder", "elbow"))
    assert max(np.abs(curve).max() for curve in found.values()) < 1e-13


@pytest.mark.parametrize("seed", [11, 19])
def test_random_chains_converge_to_the_planar_reference(seed, tmp_path):
    """Hinges and slides that stick and slip together; two hundredths of a step remain."""
    chain = random_chain(seed, damped=False)
    text, t = chain_model(chain), np.linspace(0.0, 0.8, 9)
    names = tuple(f"j{k}" for k in range(chain.start.size))
    known = planar.solve(t, model=mujoco.MjModel.from_xml_string(text))
    errors = []
    for step in (1e-3, 1e-4):
        own = {"settings": {"timestep": step}}
        found = run_of(tmp_path / "chain.xml", text, t, names, **own)
        errors.append(max(np.abs(found[name] - known[name]).max() for name in names))
    assert errors[1] < 0.3 * errors[0]
    assert errors[1] < 2e-3


def test_friction_beside_a_drive_loads_the_drive(tmp_path):
    """Drives prescribe the motion of all joints of a four-bar: their friction is in the moment.

    Where the drive leaves degrees of freedom, friction that may stick is not separated.
    """
    text = shipped("fourbar.xml").read_text(encoding="utf-8")
    text = text.replace('<joint name="crank"', '<joint name="crank" frictionloss="2"')
    text = text.replace('<joint name="rocker"', '<joint name="rocker" frictionloss="3"')
    assert text.count("frictionloss") == 2
    turn = (lambda t: (0.3 + 2.0 * t, 2.0 + 0.0 * t, 0.0 * t),)
    t = np.linspace(0.0, 1.0, 11)
    path = tmp_path / "driven.xml"
    drives = (Drive("crank", turn[0]),)
    found = run_of(path, text, t, ("holding_moment",), drives=drives)
    model = mujoco.MjModel.from_xml_string(text)
    state = turn[0](t)
    known = planar.solve(*state, model=model, joints=("crank",), inertia=True)
    plain = planar.solve(
        *state,
        model=mujoco.MjModel.from_xml_path(str(shipped("fourbar.xml"))),
        joints=("crank",),
        inertia=True,
    )
    error = np.abs(found["holding_moment"] - known["holding_moment"]).max()
    assert error < 1e-3 * np.abs(known["holding_moment"] - plain["holding_moment"]).min()


def test_forces_are_not_delivered_where_joints_may_stick(tmp_path):
    """Chipmunk gives an impulse without its direction."""
    path = tmp_path / "block.xml"
    text = BLOCK.replace("</body>", '<site name="hub"/></body>')
    text = text.replace("</sensor>", '<force name="push" site="hub"/></sensor>')
    path.write_text(text, encoding="utf-8")
    found = simulate(path, Run("dynamics", np.linspace(0, 0.1, 3), ("x", "push.x")))
    assert set(found.channels) == {"x"}
    assert "dry friction" in found.missing["push.x"]


def test_a_program_has_the_friction_of_hinges_and_slides(tmp_path):
    chain = random_chain(17)
    assert chain.has_slide
    path, t = tmp_path / "chain.xml", np.linspace(0.0, 0.5, 6)
    path.write_text(chain_model(chain), encoding="utf-8")
    names = tuple(f"j{k}" for k in range(chain.start.size))
    settings = {"timestep": 1e-3, "iterations": 100, "error_bias": 0.0}
    run = Run("dynamics", t, names, settings=settings)
    wanted = simulate(path, run).channels
    found = program_curves(ENGINE.programs.write_program(path, run, "", ""), tmp_path)
    for name in names:
        assert np.abs(found[name] - wanted[name]).max() < 1e-11 * np.ptp(wanted[name]), name


def sine(t):
    """A load of 4 N that swings."""
    return 4.0 * np.sin(3.0 * t), 12.0 * np.cos(3.0 * t), -36.0 * np.sin(3.0 * t)


def test_a_block_moves_only_while_its_load_is_larger_than_its_friction(tmp_path):
    text = BLOCK.replace('stiffness="100"', "").replace('qpos="0.5"', 'qpos="0"')
    text = text.replace("<sensor>", '<actuator><motor name="push" joint="x"/></actuator><sensor>')
    t = np.linspace(0.0, 2.0, 21)
    model = mujoco.MjModel.from_xml_string(text)
    known = planar.solve(t, model=model, control_profiles={"push": sine})["x"]
    loads = (ChangingLoad("push", sine),)
    found = run_of(tmp_path / "block.xml", text, t, ("x",), loads=loads)["x"]
    begins = np.arcsin(0.75) / 3.0
    assert np.abs(found[t < begins]).max() < 1e-15
    assert np.ptp(known) > 0.02
    assert np.abs(found - known).max() < 1e-3 * np.ptp(known)
