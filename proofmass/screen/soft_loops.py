"""Loops and stops that give way under the load of the start, since MuJoCo's constraints are soft."""

from collections.abc import Iterator

import mujoco
import numpy as np

from proofmass.base.wording import number
from proofmass.screen.finding import Finding, FindingKind, Severity
from proofmass.screen.linear import LinearMotion
from proofmass.screen.mobility import equality_element
from proofmass.screen.pose import named_element
from proofmass.screen.start_checks import HINGE, SLIDE, joint_unit

GIVEN_SHARE = 1e-3
"""Share of the model's extent by which a loop gives way that is told."""
PAST_RANGE = 1e-6
"""Distance of a servo's target beyond a stop that is told [rad or m]."""


def judge_soft_loops(model: mujoco.MjModel, motion: LinearMotion) -> Iterator[Finding]:
    """The loop that gives way most: a force l on a row opens it by |l| R / (k I)."""
    count = motion.multipliers.size
    if not count:
        return
    stiffness, _, weights = motion.softness(float(model.opt.timestep))
    given = np.abs(motion.multipliers) / (weights * np.maximum(stiffness, 1e-12))[:count]
    worst = int(np.argmax(given))
    if given[worst] > GIVEN_SHARE * model.stat.extent:
        element = equality_element(motion.pose, int(motion.pose.constraints.equalities[worst]))
        yield Finding(
            FindingKind.SOFT_LOOP,
            Severity.WARNING,
            f"{element} gives way by {number(float(given[worst]))} m or rad under the load of the "
            "start: MuJoCo's loops are soft",
            f'a shorter time constant: solref="{2.0 * model.opt.timestep:.2g} 1" on it, or a shorter '
            "step",
            element,
            float(given[worst]),
        )


def judge_stops(model: mujoco.MjModel, data: mujoco.MjData) -> Iterator[Finding]:
    """Position servos whose targets lie beyond the stops of their joints.

    At rest the servo's force g kp (over - r) / g equals that of the soft stop, k r / R, so that the
    stop gives way by r = over / (1 + 1 / ((1 - d) w T^2 zeta^2 g^2 kp)).
    """
    for a in range(model.nu):
        j, gear = int(model.actuator_trnid[a][0]), float(model.actuator_gear[a][0])
        gain = -float(model.actuator_biasprm[a][1])
        is_servo = model.actuator_biastype[a] == mujoco.mjtBias.mjBIAS_AFFINE and gain > 0.0
        on_joint = model.actuator_trntype[a] == mujoco.mjtTrn.mjTRN_JOINT
        if not (is_servo and on_joint and gear and model.jnt_limited[j]):
            continue
        if model.jnt_type[j] not in (HINGE, SLIDE) or model.jnt_solref[j][0] <= 0.0:
            continue
        push = model.actuator_gainprm[a][0] * data.ctrl[a] + model.actuator_biasprm[a][0]
        target, (low, high) = push / gain / gear, model.jnt_range[j]
        over = float(max(low - target, target - high))
        if over <= PAST_RANGE:
            continue
        constant = max(float(model.jnt_solref[j][0]), 2.0 * model.opt.timestep)
        softness = (1.0 - float(model.jnt_solimp[j][1])) * float(model.dof_invweight0[model.jnt_dofadr[j]])
        stop = softness * (constant * float(model.jnt_solref[j][1])) ** 2
        given = over / (1.0 + 1.0 / (stop * gear**2 * gain))
        actuator, joint = named_element(model, "actuator", a), named_element(model, "joint", j)
        yield Finding(
            FindingKind.STOP,
            Severity.WARNING,
            f"{actuator} pulls {joint} to a target {number(over)} {joint_unit(model, j)} past its range: "
            f"the soft stop gives way by about {number(given, 2)} {joint_unit(model, j)}",
            "a control inside the range",
            actuator,
            over,
        )
