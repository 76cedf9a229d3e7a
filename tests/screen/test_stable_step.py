"""Largest stable steps of a first screen, beside formulas and steps at which bare MuJoCo breaks."""

from math import inf, sqrt
from pathlib import Path

import mujoco
import numpy as np
import pytest

from proofmass.screen.finding import FindingKind, Severity
from proofmass.screen.linear import LinearMotion
from proofmass.screen.pose import RestPose
from proofmass.screen.screen import screen_model
from proofmass.screen.stable_step import INTEGRATORS, StepMatrices
from tests.shipped import shipped

CASES = Path(__file__).parents[1] / "data" / "screen"
INERTIA, GAIN, RATE = 0.01, 100.0, 2.0
HINGE = """
<mujoco><option gravity="0 0 0" timestep="1e-3" integrator="{integrator}"/><worldbody><body>
<joint name="j" axis="0 1 0" {joint}/><inertial pos="0 0 0" mass="1" diaginertia=".01 .01 .01"/>
</body></worldbody><actuator>{actuator}</actuator></mujoco>
"""
POSITION = '<position name="servo" joint="j" kp="{kp}" kv="{kv}"/>'
VELOCITY = '<velocity name="servo" joint="j" kv="{kv}"/>'


def limits_of(model):
    """The largest stable step of each integrator."""
    pose = RestPose(model, model.qpos0, np.zeros(model.nu), np.zeros(model.na))
    matrices = StepMatrices(LinearMotion(pose))
    return {name: matrices.limit(name, model.opt.timestep).step for name in INTEGRATORS}


def test_a_servo_on_one_hinge_has_the_limits_of_theory():
    # docs/stress.md: 2 (zeta + sqrt(1 + zeta^2)) / omega where the damping is implicit, and
    # 2 (sqrt(1 + zeta^2) - zeta) / omega where it is explicit, as a servo's is in Euler
    actuator = POSITION.format(kp=GAIN, kv=RATE)
    model = mujoco.MjModel.from_xml_string(
        HINGE.format(integrator="Euler", joint="", actuator=actuator)
    )
    omega = sqrt(GAIN / INERTIA)
    zeta = RATE / (2 * INERTIA * omega)
    found = limits_of(model)
    implicit = 2 * (zeta + sqrt(1 + zeta**2)) / omega
    assert found["Euler"] == pytest.approx(2 * (sqrt(1 + zeta**2) - zeta) / omega, rel=2e-3)
    assert found["implicit"] == pytest.approx(implicit, rel=2e-3)
    assert found["implicitfast"] == pytest.approx(implicit, rel=2e-3)


def test_a_velocity_servo_has_the_limits_of_theory():
    model = mujoco.MjModel.from_xml_string(
        HINGE.format(integrator="RK4", joint="", actuator=VELOCITY.format(kv=RATE))
    )
    found = limits_of(model)
    # the real interval of stability of RK4: E. Hairer, G. Wanner, Solving ODEs II, sec. IV.2
    assert found["RK4"] == pytest.approx(2.785293563 * INERTIA / RATE, rel=2e-3)
    assert found["Euler"] == pytest.approx(2 * INERTIA / RATE, rel=2e-3)
    assert found["implicit"] == found["implicitfast"] == found["discrete"] == inf


def test_a_sprung_hinge_is_implicit_in_its_own_damping():
    joint = f'stiffness="{GAIN}" damping="{RATE}"'
    model = mujoco.MjModel.from_xml_string(
        HINGE.format(integrator="Euler", joint=joint, actuator="")
    )
    omega = sqrt(GAIN / INERTIA)
    zeta = RATE / (2 * INERTIA * omega)
    assert limits_of(model)["Euler"] == pytest.approx(
        2 * (zeta + sqrt(1 + zeta**2)) / omega, rel=2e-3
    )
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_EULERDAMP)
    assert limits_of(model)["Euler"] == pytest.approx(
        2 * (sqrt(1 + zeta**2) - zeta) / omega, rel=2e-3
    )


def chain(seed):
    """A random arm of 2 to 5 hinges in space, with springs, dampers and servos, at rest."""
    draw = np.random.default_rng(seed)
    count, inner, actuators = int(draw.integers(2, 6)), "", ""
    for k in reversed(range(count)):
        axis, inertia = draw.normal(size=3), draw.uniform(0.002, 0.02, size=3) + 0.01
        stiffness, damping = draw.uniform(0, 50), draw.choice([0.0, 0.2])
        inner = (
            f'<body pos="0.2 0 0"><joint name="j{k}" axis="{axis[0]} {axis[1]} {axis[2]}" '
            f'stiffness="{stiffness}" damping="{damping}"/><inertial pos="0.1 0.02 0" mass="0.5" '
            f'diaginertia="{inertia[0]} {inertia[1]} {inertia[2]}"/>{inner}</body>'
        )
        if draw.random() < 0.7:
            kp, kv = draw.uniform(20, 400), draw.uniform(0.0, 1.0)
            actuators += f'<position joint="j{k}" kp="{kp}" kv="{kv}"/>'
    return mujoco.MjModel.from_xml_string(
        '<mujoco><option gravity="0 0 0"/><worldbody>'
        f"{inner}</worldbody><actuator>{actuators}</actuator></mujoco>"
    )


def breaks(model, integrator, step, disturbance=1e-9, steps=3000):
    """Whether bare MuJoCo leaves its equilibrium from a small disturbance, with a time step."""
    model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}")
    model.opt.timestep = step
    data = mujoco.MjData(model)
    data.qpos[:] = disturbance * np.random.default_rng(0).normal(size=model.nq)
    first = np.abs(data.qpos).max()
    for _ in range(steps):
        mujoco.mj_step(model, data)
        if not np.isfinite(data.qpos).all() or np.abs(data.qpos).max() > 1e4 * first:
            return True
    return False


def measured_limit(model, integrator, near):
    """The step at which bare MuJoCo breaks, by bisection [s]; 0 if not within a factor of 2."""
    holds, fails = near / 2, near * 2
    if breaks(model, integrator, holds) or not breaks(model, integrator, fails):
        return 0.0
    while fails > 1.005 * holds:
        middle = sqrt(holds * fails)
        holds, fails = (holds, middle) if breaks(model, integrator, middle) else (middle, fails)
    return sqrt(holds * fails)


@pytest.mark.parametrize(
    "seed", [pytest.param(k, marks=pytest.mark.slow) if k > 1 else k for k in range(10)]
)
def test_bare_mujoco_breaks_at_the_limits(seed):
    # arms with springs and servos are linear about their equilibrium: 10 arms, four integrators
    model = chain(seed)
    for integrator, limit in limits_of(model).items():
        if limit < inf:
            measured = measured_limit(model, integrator, limit)
            assert measured == pytest.approx(limit, rel=0.02), integrator


@pytest.mark.parametrize(
    ("name", "limit", "cause"),
    [
        # MuJoCo's issues 954 and 3443, and Menagerie's 254: bare MuJoCo breaks at these steps
        ("pd954", 3.46e-3, "damping"),
        ("stiff_contact", 3.642e-3, "stiffness"),
    ],
)
def test_public_models_that_blow_up_are_named_with_their_limit_and_cause(name, limit, cause):
    found = screen_model(CASES / f"{name}.xml")
    [fault] = [finding for finding in found.findings if finding.kind is FindingKind.STABLE_STEP]
    assert fault.severity is Severity.FAULT
    assert found.steps.limit == pytest.approx(limit, rel=0.01)
    assert found.steps.breaking.cause.what == cause
    assert fault.element.kind == "joint"


def test_the_proposed_cures_of_a_model_that_blows_up_work():
    path = CASES / "pd954.xml"
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    found = screen_model(path)
    assert runs(model) is False
    model.opt.timestep = 0.8 * found.steps.limit
    assert runs(model)
    model.opt.timestep = 0.02
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    assert runs(model)
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER
    [fault] = [finding for finding in found.findings if finding.kind is FindingKind.STABLE_STEP]
    armature = float(fault.remedy.split('armature="')[1].split('"')[0])
    joint = model.joint(fault.element.name)
    model.dof_armature[joint.dofadr[0]] = armature
    mujoco.mj_setConst(model, data)
    assert runs(model)


def runs(model):
    """Whether bare MuJoCo runs a model for two seconds."""
    data = mujoco.MjData(model)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    for _ in range(int(2 / model.opt.timestep)):
        mujoco.mj_step(model, data)
    return not data.warning[mujoco.mjtWarning.mjWARN_BADQACC].number and bool(
        np.isfinite(data.qpos).all()
    )


def test_a_model_within_its_limit_has_no_finding_of_its_step():
    model = mujoco.MjModel.from_xml_path(str(CASES / "pd954.xml"))
    model.opt.timestep = 1e-3
    kinds = {finding.kind for finding in screen_model(model).findings}
    assert FindingKind.STABLE_STEP not in kinds


def test_rk4_breaks_where_a_stiff_velocity_feedback_makes_it():
    # Menagerie's issue 254: the Flexiv Rizon runs with RK4 at 12 microseconds and fails at 13
    found = screen_model(CASES / "rizon254.xml")
    assert 12e-6 < found.steps.limits["RK4"] < 13e-6


def test_steps_agree_with_the_derivatives_of_mujoco():
    for seed in range(5):
        model = chain(seed)
        for integrator in ("Euler", "implicitfast", "implicit", "discrete"):
            model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}")
            pose = RestPose(model, model.qpos0, np.zeros(model.nu), np.zeros(model.na))
            step = StepMatrices(LinearMotion(pose)).step(integrator, model.opt.timestep)
            data, exact = mujoco.MjData(model), np.zeros((2 * model.nv, 2 * model.nv))
            # discrete iterates only if forces are large enough: other differences, other errors
            change, share = (1e-3, 1e-5) if integrator == "discrete" else (1e-6, 1e-6)
            mujoco.mjd_transitionFD(model, data, change, True, exact, None, None, None)
            assert np.abs(step - exact).max() < share * np.abs(exact).max(), integrator


def test_discrete_breaks_where_weight_makes_it():
    # it is implicit in servos and springs, and explicit in weight: hanging arms have limits
    for seed in range(3):
        model = hanging(seed)
        limit = limits_of(model)["discrete"]
        assert measured_limit(model, "discrete", limit) == pytest.approx(limit, rel=0.02)


def hanging(seed):
    """A random arm of 2 to 4 hinges that hangs down, with springs and dampers in some of them."""
    draw = np.random.default_rng(seed)
    inner = ""
    for k in range(int(draw.integers(2, 5))):
        stiffness, damping = draw.choice([0.0, 0.3]), draw.choice([0.0, 0.01])
        inner = (
            f'<body pos="0 0 -0.2"><joint name="j{k}" axis="{k % 2} {1 - k % 2} 0" '
            f'stiffness="{stiffness}" damping="{damping}"/><inertial pos="0 0 -0.1" mass="0.5" '
            f'diaginertia="{draw.uniform(0.001, 0.003)} 0.002 0.0015"/>{inner}</body>'
        )
    return mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{inner}</worldbody></mujoco>")


def test_a_step_of_discrete_with_soft_loops_is_that_of_mujoco():
    # the rows are implicit too; the residual's effect on the impedance is left out, hence 1e-3
    for name in ("fourbar", "universal_joint", "balancer_sine"):
        model = mujoco.MjModel.from_xml_path(str(shipped(f"{name}.xml")))
        model.opt.integrator, model.opt.timestep = mujoco.mjtIntegrator.mjINT_DISCRETE, 2e-3
        model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
        data = mujoco.MjData(model)
        mujoco.mj_resetDataKeyframe(model, data, 0)
        pose = RestPose(model, data.qpos, data.ctrl, data.act)
        pose.close()
        data.qpos[:], data.qvel[:] = pose.qpos, 0.0
        step = StepMatrices(LinearMotion(pose)).step("discrete", model.opt.timestep)
        exact = np.zeros((2 * model.nv, 2 * model.nv))
        mujoco.mjd_transitionFD(model, data, 1e-6, True, exact, None, None, None)
        assert np.abs(step - exact).max() < 1e-3 * np.abs(exact).max(), name
