"""Loops and stops that give way under load, since MuJoCo's constraints are soft."""

from collections.abc import Iterator

import mujoco
import numpy as np

from proofmass.base.arrays import Array
from proofmass.base.wording import number
from proofmass.screen.finding import FindingKind, ModelFinding, Severity
from proofmass.screen.linear import LinearMotion
from proofmass.screen.mobility import equality_element
from proofmass.screen.pose import HINGE, SLIDE, coordinate_unit, named_element

GIVEN_SHARE = 1e-3
"""Share of the model's extent by which a loop gives way that is told."""
STOP_ITERATIONS = 20
"""Iterations of the depth of a stop, whose stiffness depends on it."""
PAST_RANGE = 1e-6
"""Distance of a servo's target beyond a stop that is told [rad or m]."""


def judge_soft_loops(model: mujoco.MjModel, motion: LinearMotion) -> Iterator[ModelFinding]:
    """The loop that gives way most: a force l on a row opens it by |l| R / (k I)."""
    count = motion.multipliers.size
    if not count:
        return
    stiffness, _, weights = motion.softness(float(model.opt.timestep))
    given = np.abs(motion.multipliers) / (weights * np.maximum(stiffness, 1e-12))[:count]
    worst = int(np.argmax(given))
    if given[worst] > GIVEN_SHARE * model.stat.extent:
        element = equality_element(motion.pose, int(motion.pose.constraints.equalities[worst]))
        yield ModelFinding(
            FindingKind.SOFT_LOOP,
            Severity.WARNING,
            f"{element} gives way by {number(float(given[worst]))} m or rad under the load of the "
            "start: MuJoCo's loops are soft",
            f'solref="{2.0 * model.opt.timestep:.2g} 1" on it, or a shorter step',
            element,
            float(given[worst]),
        )


def judge_stops(model: mujoco.MjModel, data: mujoco.MjData) -> Iterator[ModelFinding]:
    """Position servos whose targets lie beyond the stops of their joints.

    At rest the servo's force g^2 kp (over - r) equals that of the soft stop, which `stop_stiffness`
    gives.
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
        given = over
        for _ in range(STOP_ITERATIONS):
            given = over / (1.0 + stop_stiffness(model, j, given) / (gear**2 * gain))
        actuator, joint = named_element(model, "actuator", a), named_element(model, "joint", j)
        unit = coordinate_unit(model, int(model.jnt_dofadr[j]))
        yield ModelFinding(
            FindingKind.STOP,
            Severity.WARNING,
            f"{actuator} pulls {joint} to a target {number(over)} {unit} past its range: the soft "
            f"stop gives way by about {number(given, 2)} {unit}",
            "a control inside the range",
            actuator,
            over,
        )


def stop_stiffness(model: mujoco.MjModel, joint: int, depth: float) -> float:
    """The force over the depth of a joint's stop [N m/rad or N/m].

    With the time constant T, the damping ratio z, the impedance d at the depth, the largest one D,
    and the inverse inertia w of the joint it is d^2 / (D^2 T^2 z^2 (1 - d) w).
    """
    constant, ratio = (float(number) for number in model.jnt_solref[joint])
    constant = max(constant, 2.0 * model.opt.timestep)  # MuJoCo's refsafe
    d, largest = impedance(model.jnt_solimp[joint], depth), float(model.jnt_solimp[joint][1])
    weight = float(model.dof_invweight0[model.jnt_dofadr[joint]])
    return d**2 / ((largest * constant * ratio) ** 2 * (1.0 - d) * weight)


def impedance(solimp: Array, depth: float) -> float:
    """MuJoCo's impedance at a depth [1], of the five numbers of `solimp`.

    It rises from the first to the second number within the width, as a power on both sides of the
    midpoint.

    >>> round(impedance(np.array([0.9, 0.95, 0.001, 0.5, 2.0]), 0.0005), 9)
    0.925
    """
    low, high, width, middle, power = (float(number) for number in solimp)
    share = min(abs(depth) / width, 1.0)
    if share <= middle:
        rise = middle * (share / middle) ** power
    else:
        rise = 1.0 - (1.0 - middle) * ((1.0 - share) / (1.0 - middle)) ** power
    return low + (high - low) * rise
