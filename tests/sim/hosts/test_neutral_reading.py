"""What the reader of neutral mechanisms makes of the elements of a model."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from proofmass.run.solve import prescribed_run
from proofmass.sim.interpreter.mechanism import LinkStates
from proofmass.sim.neutral import ModelReader, NeutralReader, read_mechanism, support_without
from proofmass.sim.protocol.failures import BadModel, Unsupported
from proofmass.sim.protocol.run import Drive, Run
from proofmass.sim.states import StateCurves
from tests.shipped import shipped, shipped_case

LIMITED = """
<mujoco>
  <compiler angle="radian"/>
  <worldbody>
    <body name="arm">
      <joint name="driven" axis="0 1 0" range="-1 1"/>
      <geom type="sphere" size="0.1" pos="0.5 0 0"/>
      <body name="end" pos="0.5 0 0">
        <joint name="slide" type="slide" axis="1 0 0" range="-0.2 0.3"/>
        <geom type="sphere" size="0.2" contype="0" conaffinity="0"/>
      </body>
    </body>
    <body name="other" pos="0 5 0">
      <joint name="hinge" axis="0 1 0"/>
      <geom type="sphere" size="0.1" pos="0.2 0 0" contype="0"/>
    </body>
  </worldbody>
  <keyframe><key name="start"/></keyframe>
</mujoco>
"""


def turn_evenly(time: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A coordinate that grows by 1 rad/s."""
    return time, np.ones_like(time), np.zeros_like(time)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """A model of three joints, two of them with ranges."""
    path = tmp_path / "model.xml"
    path.write_text(LIMITED)
    return path


@pytest.mark.parametrize(
    ("drives", "limits"),
    [
        ((), [(-1.0, 1.0), (-0.2, 0.3), None]),
        ((Drive("driven", turn_evenly),), [None, (-0.2, 0.3), None]),
    ],
)
def test_joints_that_are_not_driven_have_their_ranges_as_limits(file, drives, limits):
    run = Run("dynamics", np.linspace(0.0, 0.1, 3), (), drives)
    joints = read_mechanism(file, run, contacts=True).mechanism().joints
    assert [one.limits for one in joints] == limits


PARTS = """
<mujoco>
  <compiler angle="radian"/>
  <worldbody>
    <body name="arm">
      <joint name="a" axis="0 1 0" stiffness="4" damping="0.1" frictionloss="0.3" springref="0.2"/>
      <geom type="sphere" size="0.1" pos="0.5 0 0"/>
      <site name="tip" pos="0.5 0 0"/>
    </body>
    <site name="post" pos="0 0 1"/>
  </worldbody>
  <tendon><spatial name="ruler"><site site="post"/><site site="tip"/></spatial></tendon>
  <actuator>
    <position name="servo" joint="a" kp="6" kv="0.25" gear="2"/>
    <motor name="push" site="tip" gear="1 0 0 0 0 0"/>
    <motor name="off" joint="a" group="3"/>
  </actuator>
  <keyframe><key name="start" ctrl="0.5 3 100"/></keyframe>
  <option actuatorgroupdisable="3"/>
</mujoco>
"""


def read_parts(driven: tuple[int, ...] = ()) -> ModelReader:
    """The model of one arm with a servo, a load and an actuator that is disabled."""
    return ModelReader(mujoco.MjModel.from_xml_string(PARTS), "start", driven)


def test_a_servo_adds_to_the_spring_of_its_joint():
    (joint,) = read_parts().joints()
    assert joint.spring.tolist() == [4.0, 0.0, 0.0]
    assert joint.servo == 2.0**2 * 6.0
    assert joint.acting.tolist() == [28.0, 0.0, 0.0]
    assert joint.damping == 0.1 + 2.0**2 * 0.25
    assert joint.friction == 0.3
    # the force of the servo where the spring is slack, which the disabled motor does not change
    assert joint.force.tolist() == pytest.approx([2.0 * 6.0 * (0.5 - 2.0 * 0.2)])


def test_actuators_of_a_driven_joint_exert_no_force():
    (joint,) = read_parts((0,)).joints()
    assert (joint.servo, joint.damping, joint.force.tolist()) == (0.0, 0.1, [0.0])


STICKS = """
<mujoco>
  <compiler angle="radian"/>
  <option gravity="0 -9.81 0" timestep="1e-3"><flag contact="disable"/></option>
  <worldbody>
    <body name="rod"><joint name="hinge" frictionloss="{friction}"/>
      <inertial pos="1 0 0" mass="2" diaginertia="0.1 0.1 0.1"/></body>
  </worldbody>
  <keyframe><key name="start" qvel="{rate}"/></keyframe>
</mujoco>
"""


@pytest.mark.parametrize(
    ("friction", "rate", "acceleration"),
    [
        (20.0, 0.0, 0.0),
        (4.62, 0.0, -15.0 / 2.1),
        (4.62, -3.0, -15.0 / 2.1),
        (4.38, 3.0, -24.0 / 2.1),
    ],
    ids=["sticks", "begins to slip", "slips down", "slips up"],
)
def test_rates_of_half_a_step_before_have_the_friction(friction, rate, acceleration, tmp_path):
    path = tmp_path / "sticks.xml"
    path.write_text(STICKS.format(friction=friction, rate=rate))
    run = Run("dynamics", np.linspace(0.0, 0.1, 3), ())
    support = support_without((), friction=True)
    (joint,) = read_mechanism(path, run, support).mechanism(-5e-4).joints
    assert joint.rate == pytest.approx(rate - 5e-4 * acceleration, abs=1e-12)


def test_friction_is_refused_without_it_and_by_kind_of_joint(tmp_path):
    path = tmp_path / "sticks.xml"
    path.write_text(STICKS.format(friction=1.0, rate=0.0))
    run = Run("dynamics", np.linspace(0.0, 0.1, 3), ())
    with pytest.raises(Unsupported, match="frictionloss of joint 'hinge' in dynamics"):
        read_mechanism(path, run)
    path.write_text(
        path.read_text()
        .replace('name="hinge"', 'name="ball" type="ball"')
        .replace(' qvel="0.0"', "")
    )
    with pytest.raises(Unsupported, match="frictionloss of ball joint 'ball'"):
        read_mechanism(path, run, support_without((), friction=True)).mechanism()


def test_other_controls_change_the_forces_of_a_copy_only():
    reader = read_parts()
    other = reader.with_controls(["push"], np.array([7.0]))
    (load,), (changed,) = reader.loads(), other.loads()
    assert (load.share.tolist(), changed.share.tolist()) == ([3.0], [7.0])
    assert (load.body, load.actuator) == (1, 1)


def test_a_tendon_that_only_measures_a_length_is_no_spring_of_a_mechanism():
    reader = read_parts()
    (spring,) = reader.springs()
    assert (spring.name, spring.body_a, spring.body_b) == ("ruler", 0, 1)
    run = Run("dynamics", np.linspace(0.0, 0.1, 3), ())
    assert not NeutralReader(reader.model, run, 0.05).mechanism().springs


def test_a_key_that_is_not_there_is_named():
    with pytest.raises(BadModel, match="no key 'end'; the model has start"):
        ModelReader(mujoco.MjModel.from_xml_string(PARTS), "end", ())


def test_coordinates_of_several_joints_of_a_link_are_not_guessed() -> None:
    """Rotations about two axes do not add: without the engine's coordinates there are none."""
    case = shipped_case(shipped("delta.toml"))
    run = prescribed_run(case, "dynamics")
    reader = read_mechanism(case.model_path, run)
    mechanism = reader.mechanism()
    curves = StateCurves(reader, mechanism, LinkStates.empty(mechanism))
    alone, several = (
        next(
            j for j, one in enumerate(mechanism.joints) if test(len(mechanism.joints_of(one.child)))
        )
        for test in (lambda count: count == 1, lambda count: count > 1)
    )
    assert curves.joint(alone)[0] == pytest.approx(mechanism.joints[alone].value)
    with pytest.raises(Unsupported, match="one of several of its link"):
        curves.joint(several)
