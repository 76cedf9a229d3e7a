"""Creep of joints that dry friction should hold, beside bare MuJoCo and the formula."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from proofmass.screen.creep import creeping_joints
from proofmass.screen.finding import FindingKind
from proofmass.screen.screen import screen_model

DATA = Path(__file__).parents[1] / "data"
HOLD565 = DATA / "screen" / "hold565.xml"
SCREW = DATA / "threads" / "screw2430.xml"
SETTINGS = [  # time constant [s], impedance [1], time step [s], integrator
    (0.02, 0.9, 2e-3, "EULER"),
    (0.02, 0.9, 5e-4, "RK4"),
    (0.01, 0.95, 1e-3, "IMPLICITFAST"),
    (0.05, 0.99, 2e-3, "EULER"),
    (0.004, 0.9999, 2e-3, "EULER"),
    (0.02, 0.8, 1e-3, "IMPLICIT"),
]


def held_arm(constant, impedance, step, integrator):
    """The arm of MuJoCo's issue 565 with other softness of its friction."""
    model = mujoco.MjModel.from_xml_path(str(HOLD565))
    model.dof_solref[:] = constant, 1.0
    model.dof_solimp[:, :2] = impedance
    model.opt.timestep = step
    model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator}")
    return model


def weights_of(model, qpos):
    """Moments (2,) of the weights of both links about their joints, by hand [N m]."""
    upper, fore = qpos[0], qpos[0] + qpos[1]
    elbow = 0.15 * np.cos(fore) * 0.7
    return 9.81 * np.array([1.2 * 0.2 * np.cos(upper) + 0.7 * 0.4 * np.cos(upper) + elbow, elbow])


@pytest.mark.parametrize("setting", SETTINGS)
def test_joints_creep_with_the_speed_of_the_formula_to_four_digits(setting):
    constant, d, *_ = setting
    model = held_arm(*setting)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    # until the start has died out, and before the load changes much while the joints accelerate
    for _ in range(round(7.5 * constant / model.opt.timestep)):
        mujoco.mj_step(model, data)
    # the load is that of the place that the arm has reached; A is MuJoCo's `dof_invweight0`
    load = weights_of(model, data.qpos)
    formula = (1 - d) * load * constant * d * model.dof_invweight0 / (2 * d)
    assert data.qvel == pytest.approx(formula, rel=1e-4)
    model.key_qpos[0] = data.qpos
    found = creeping_joints(model, 0)
    assert [joint.speed for joint in found] == pytest.approx(formula.tolist(), rel=1e-9)
    assert [joint.load for joint in found] == pytest.approx(load.tolist(), rel=1e-9)


def test_a_person_reads_degrees_of_a_hinge():
    found = [one for one in screen_model(HOLD565).findings if one.kind is FindingKind.CREEP]
    assert "creeps with 0.0612 rad/s (3.51°/s), though" in found[0].text
    assert found[0].value == pytest.approx(0.0612, rel=1e-3)


def test_a_nut_that_falls_through_its_thread_is_told_with_its_screw():
    # 0.2 N m holds 2 kg x 9.81 m/s^2 x 5 mm/rad = 0.098 N m; bare MuJoCo drops the nut
    model = mujoco.MjModel.from_xml_path(str(SCREW))
    data = mujoco.MjData(model)
    for _ in range(500):
        mujoco.mj_step(model, data)
    assert data.qpos[0] < -1.0
    kinds = {one.kind: one for one in screen_model(SCREW).findings}
    assert kinds[FindingKind.SOFT_LOOP].value > 1.0
    creep = kinds[FindingKind.CREEP]
    assert creep.element.name == "turn"
    assert "friction of 0.2 N m would hold its load of 0.0981 N m" in creep.text
    assert abs(creep.value) == pytest.approx(abs(data.qvel[1]), rel=0.1)
