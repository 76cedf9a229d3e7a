"""The gripper 2F-85, whose couplers rest on stops: rigid stops compared with those of MuJoCo."""

import mujoco
import numpy as np
import pytest

from proofmass.analytic.spatial import properties, solve
from proofmass.analytic.spatial.mechanism import read_tree
from proofmass.analytic.spatial.terms import OwnTerms
from proofmass.sim.smooth import SmoothTerms

GRIPPER_FILE = "models/spatial/robotiq_2f85.xml"
TIMES = np.linspace(0.0, 0.1, 51)
JOINTS = "driver", "coupler", "follower", "left_follower"


@pytest.fixture(scope="module")
def gripper() -> tuple[mujoco.MjModel, dict[str, np.ndarray]]:
    """The model, and its motion with rigid stops."""
    model = mujoco.MjModel.from_xml_path(GRIPPER_FILE)
    return model, solve(TIMES, model=model, terms=SmoothTerms(model))


def test_the_couplers_rest_on_their_stops_and_both_fingers_move_alike(gripper):
    model, motion = gripper
    found = properties(
        model=model, start="start", joints=(), terms=SmoothTerms(model), motion=TIMES
    )
    assert found["stops"] == "left_coupler rests on a stop; right_coupler rests on a stop"
    assert found["equalities"].startswith("closed exactly, 5 independent of 7 rows")
    assert np.abs(motion["coupler"]).max() < 1e-14
    assert np.abs(motion["follower"] - motion["left_follower"]).max() < 1e-13
    assert np.abs(motion["right.y"] + motion["left.y"]).max() < 1e-15
    assert motion["driver"][-1] > 0.25


def test_the_second_formulation_alone_gives_the_same_motion(gripper):
    model, motion = gripper
    own = solve(TIMES[:4], model=model, terms=OwnTerms(read_tree(model, "start")))
    assert max(np.abs(own[name] - motion[name][:4]).max() for name in own) < 1e-11


def test_mujoco_with_stiffer_constraints_converges_to_the_rigid_motion(gripper):
    """The error falls at least with about the square of the time constant (factor 3.5 for half).

    With the constraints of the shipped model it is more than 1e-2 rad.
    """
    errors = []
    for tau in (1e-3, 5e-4):
        model = mujoco.MjModel.from_xml_path(GRIPPER_FILE)
        model.opt.integrator, model.opt.timestep = mujoco.mjtIntegrator.mjINT_RK4, tau / 10
        model.eq_solref[:, 0] = model.jnt_solref[:, 0] = tau
        model.eq_solimp[:, :2] = model.jnt_solimp[:, :2] = 0.9999
        errors.append(error_in_mujoco(model, gripper[1], round(0.002 / model.opt.timestep)))
    assert errors[1] < 1e-5
    assert errors[0] / errors[1] > 3.5
    assert error_in_mujoco(gripper[0], gripper[1], 1) > 1e-2


def error_in_mujoco(model: mujoco.MjModel, motion: dict[str, np.ndarray], count: int) -> float:
    """Largest error of the joints in bare MuJoCo [rad], with `count` steps between samples."""
    data, found = mujoco.MjData(model), []
    mujoco.mj_resetDataKeyframe(model, data, 0)
    for _ in TIMES:
        found.append([float(data.qpos[a]) for a in joint_addresses(model)])
        mujoco.mj_step(model, data, count)
    curves = np.array(found).T
    return max(np.abs(c - motion[n]).max() for c, n in zip(curves, JOINTS, strict=True))


def joint_addresses(model: mujoco.MjModel) -> list[int]:
    """Addresses of the joints of `JOINTS` in a pose."""
    names = "right_driver", "right_coupler", "right_follower", "left_follower"
    return [int(model.joint(name).qposadr[0]) for name in names]


def test_a_coupler_without_its_stop_moves_on(gripper):
    """A mutation: the range of the joint is removed."""
    model = mujoco.MjModel.from_xml_path(GRIPPER_FILE)
    model.jnt_limited[model.joint("right_coupler").id] = 0
    other = solve(TIMES[:11], model=model, terms=SmoothTerms(model))
    assert np.abs(other["coupler"]).max() > 1e-2


def test_a_motor_without_its_force_range_moves_differently(gripper):
    """A mutation: without the force range of 5 N the motor pulls nine times as hard at first."""
    model = mujoco.MjModel.from_xml_path(GRIPPER_FILE)
    model.actuator_forcelimited[0] = 0
    other = solve(TIMES[:6], model=model, terms=SmoothTerms(model))
    assert np.abs(other["driver"] - gripper[1]["driver"][:6]).max() > 1e-2
