"""What the reader of neutral mechanisms makes of the elements of a model."""

from pathlib import Path

import numpy as np
import pytest

from proofmass.sim.neutral import read_mechanism
from proofmass.sim.protocol.run import Drive, Run

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
