"""Forces of actuators in space, limited by their own ranges and those of joints, and sensors."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from proofmass.analytic import spatial
from proofmass.analytic.spatial.mechanism import read_tree
from proofmass.analytic.spatial.terms import own_terms
from proofmass.sim.mujoco.engine import simulate as in_mujoco
from proofmass.sim.protocol.run import Drive, Run
from proofmass.sim.smooth import SmoothTerms

ROBOT_MODEL = """<mujoco><compiler angle="radian"/><option timestep="1e-3" integrator="RK4">
  <flag contact="disable"/></option><worldbody><site name="wall" pos=".5 .5 .5"/>
  <body name="base"><joint name="yaw" axis="0 0 1" damping=".5"/>
    <inertial pos="0 0 .1" mass="2" diaginertia=".02 .02 .02"/>
    <body name="upper" pos="0 0 .2"><joint name="pitch" axis="0 1 0" damping=".3" {pitch}/>
      <inertial pos="0 0 .2" mass="1" diaginertia=".01 .01 .005"/>
      <body name="lower" pos="0 0 .4"><joint name="elbow" axis="0 1 0" damping=".2" {elbow}/>
        <inertial pos="0 0 .15" mass=".7" diaginertia=".005 .005 .002"/>
        <site name="tool" pos="0 0 .3"/></body></body></body></worldbody>
  <tendon><spatial name="cable"><site site="wall"/><site site="tool"/></spatial></tendon>
  <actuator><motor name="turn" joint="yaw" gear="2"/>
    <position name="lift" joint="pitch" kp="60" kv="4"/><motor name="more" joint="pitch" gear="3"/>
    <motor name="pull" tendon="cable" gear="-1.5"/>
    <motor name="push" site="tool" gear="0 1 2 0 0 .1"/></actuator>
  <sensor><jointpos name="yaw" joint="yaw"/><jointpos name="pitch" joint="pitch"/>
    <jointpos name="elbow" joint="elbow"/><actuatorfrc name="turn" actuator="turn"/>
    <actuatorfrc name="lift" actuator="lift"/><actuatorfrc name="pull" actuator="pull"/>
    <actuatorfrc name="push" actuator="push"/><jointactuatorfrc name="all_pitch" joint="pitch"/>
    <jointactuatorfrc name="all_elbow" joint="elbow"/>
    <tendonactuatorfrc name="all_cable" tendon="cable"/></sensor>
  <keyframe><key name="start" qpos=".1 .3 .5" ctrl=".4 .9 .5 2 1.5"/></keyframe></mujoco>"""
RANGES = {"pitch": 'actuatorfrcrange="-8 8"', "elbow": 'actuatorfrcrange="-1 .4"'}
FORCES = ("turn", "lift", "pull", "push", "all_pitch", "all_elbow", "all_cable")


def write_robot(folder: Path, limited: bool = True) -> Path:
    """Write a robot with three joints; ranges limit the total actuator force of two of them."""
    file = folder / f"robot{int(limited)}.xml"
    file.write_text(ROBOT_MODEL.format(**(RANGES if limited else dict.fromkeys(RANGES, ""))))
    return file


@pytest.mark.parametrize("limited", [False, True])
def test_forces_are_those_of_mujoco_at_any_state(tmp_path, limited):
    model = mujoco.MjModel.from_xml_path(str(write_robot(tmp_path, limited)))
    tree, source = read_tree(model, "start"), SmoothTerms(model)
    generator, clipped = np.random.default_rng(3), 0
    for _ in range(20):
        q, v = generator.normal(0.0, 1.0, (2, 3))
        ctrl = generator.normal(0.0, 3.0, 5)
        ours = own_terms(tree, q[None], v[None], ctrl[None]).force[0]
        np.testing.assert_allclose(ours, source.terms(q, v, ctrl).force, rtol=0, atol=1e-12)
        damping = -np.array([0.5, 0.3, 0.2]) * v
        clipped += bool(np.isclose(np.abs(ours - damping)[1], 8.0))
    assert (clipped > 5) == limited


@pytest.mark.parametrize("limited", [False, True])
def test_sensors_of_a_motion_are_those_of_mujoco(tmp_path, limited):
    """This holds also where a joint's force reaches its range, at which the motion has a kink."""
    file, times = write_robot(tmp_path, limited), np.linspace(0.0, 0.5, 26)
    model = mujoco.MjModel.from_xml_path(str(file))
    known = spatial.solve(times, model=model, terms=SmoothTerms(model))
    assert {*FORCES} <= known.keys()
    ends = [known["all_pitch"].max(), known["all_elbow"].max()]
    assert (np.isclose(ends, [8.0, 0.4]).all()) == limited
    assert known["all_cable"] == pytest.approx(known["pull"])
    names = (*FORCES, "yaw", "pitch", "elbow")
    found = in_mujoco(file, Run("dynamics", times, names)).channels
    for name in names:
        error = np.abs(found[name] - known[name]).max()
        assert error < 2e-5 * max(1.0, np.ptp(known[name])), name


def test_in_a_sweep_a_drive_replaces_the_actuator_of_its_joint(tmp_path):
    """A drive provides the moment that other actuators leave.

    The actuator of the driven joint itself does not act, so its control has no effect.
    """
    text = ROBOT_MODEL.format(**RANGES).replace('kp="60" kv="4"', 'kp="60"')
    file = tmp_path / "robot.xml"
    file.write_text(text)
    model, x = mujoco.MjModel.from_xml_path(str(file)), np.linspace(0.0, 1.0, 11)

    def profile(t: np.ndarray, share: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return share * t, np.full_like(t, share), np.zeros_like(t)

    shares = {"yaw": 1.0, "pitch": 0.5, "elbow": -0.7}
    state = [np.array([profile(x, share)[k] for share in shares.values()]) for k in range(3)]
    known = spatial.solve(*state, model=model, joints=tuple(shares))
    drives = tuple(
        Drive(name, lambda t, share=share: profile(t, share)) for name, share in shares.items()
    )
    found = in_mujoco(file, Run("sweep", x, FORCES, drives)).channels
    for name, values in found.items():
        np.testing.assert_allclose(known[name], values, rtol=0, atol=1e-11, err_msg=name)
    assert set(found) == {*FORCES}
    model = mujoco.MjModel.from_xml_path(str(file))
    model.key_ctrl[0, :3] = 5.0, -3.0, 2.0  # actuators whose joints are driven
    other = spatial.solve(*state, model=model, joints=tuple(shares))
    for name in FORCES:
        np.testing.assert_array_equal(other[name], known[name])
