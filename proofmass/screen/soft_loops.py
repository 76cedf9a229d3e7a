"""Loops and stops that give way under load, since MuJoCo's constraints are soft."""

from collections.abc import Iterator
from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.optimize import brentq

from proofmass.base.arrays import Array
from proofmass.base.wording import number
from proofmass.screen.finding import FindingKind, ModelFinding, Severity
from proofmass.screen.linear import LinearMotion
from proofmass.screen.mobility import equality_element
from proofmass.screen.pose import RestPose, coordinate_unit, named_element
from proofmass.screen.rest import loop_multipliers, state_at
from proofmass.screen.servos import is_servo
from proofmass.screen.short_run import start_of, steps_of_run
from proofmass.sim.mjcf import failure_warning
from proofmass.sim.openings import WELD, unit_of_coupling

GIVEN_SHARE = 1e-3
"""Share of the model's extent by which a loop gives way that is told."""
UNCLOSED_SHARE = 0.5
"""Share of the model's extent by which a loop gives way that does not close it any more."""
SEEN_SHARE = 0.5
"""Least opening in a run, as a share of the computed one: loads change while a model moves."""
STOP_ITERATIONS = 20
"""Iterations of the depth of a stop, whose stiffness depends on it."""
PAST_RANGE = 1e-6
"""Distance of a servo's target beyond a stop that is told [rad or m]."""


@dataclass(frozen=True)
class SoftLoop:
    """A loop that gives way under load.

    Attributes
    ----------
    equality : int
    opening : float
        How far it gives way [m or rad].
    """

    equality: int
    opening: float


def judge_soft_loops(
    model: mujoco.MjModel, key: int, motion: LinearMotion, rest: RestPose | None
) -> Iterator[ModelFinding]:
    """The loop that gives way most, at rest or else under the load of the start, in a run too."""
    if not motion.multipliers.size:
        return
    if rest is None:
        motion.pose.enter(motion.pose.qpos)
        loops = soft_loops(motion.pose, motion.multipliers)
    else:
        loops = soft_loops(rest, loop_multipliers(rest))
    found = max(loops, key=lambda loop: loop.opening)
    if found.opening < GIVEN_SHARE * model.stat.extent:
        return
    state = start_of(model, key) if rest is None else state_at(model, rest)
    seen = largest_opening(model, state, found.equality)
    if seen < SEEN_SHARE * found.opening:
        return
    element = equality_element(model, found.equality)
    where = "under the load of the start" if rest is None else "where the model comes to rest"
    yield ModelFinding(
        FindingKind.SOFT_LOOP,
        Severity.FAULT if found.opening > UNCLOSED_SHARE * model.stat.extent else Severity.WARNING,
        f"{element} gives way by {number(found.opening)} {opening_unit(model, found.equality)} "
        f"{where}: MuJoCo's loops are soft",
        f'solref="{2.0 * model.opt.timestep:.2g} 1" on it, or a shorter step',
        element,
        found.opening,
    )


def opening_unit(model: mujoco.MjModel, equality: int) -> str:
    """The unit in which an equality opens: m, rad, or both of a weld."""
    is_weld = int(model.eq_type[equality]) == WELD
    return "m or rad" if is_weld else unit_of_coupling(model, equality)


def soft_loops(pose: RestPose, loads: Array) -> Iterator[SoftLoop]:
    r"""How far each equality of a pose gives way under the loads (equations,) of its rows [SI].

    With the impedance d(r), the largest impedance D, the time constant T, the damping ratio z and
    the inverse inertia w of its rows, a force l opens it by r = l w D^2 T^2 z^2 (1 - d) / d^2.
    MuJoCo takes one impedance for all rows of an equality, that of the length of r.
    """
    model, data, constraints = pose.model, pose.data, pose.constraints
    table = np.array(data.efc_KBIP).reshape(-1, 4)[: data.ne]
    start = np.clip(table[:, 2], mujoco.mjMINIMP, mujoco.mjMAXIMP)
    inertias = start / ((1.0 - start) * np.array(data.efc_D[: data.ne]))  # inverse, of each row
    pushes = np.abs(loads) * inertias / np.maximum(table[:, 0], 1e-300)
    for equality in np.unique(constraints.equalities):
        push = float(np.linalg.norm(pushes[constraints.equalities == equality]))
        yield SoftLoop(int(equality), opening_under(push, model.eq_solimp[equality]))


def opening_under(push: float, solimp: Array) -> float:
    """The solution r of r = push (1 - d(r)) / d(r)^2.

    >>> round(opening_under(0.09, np.array([0.9, 0.9, 0.001, 0.5, 2.0])), 9)
    0.011111111
    """

    def excess(opening: float) -> float:
        d = impedance(solimp, opening)
        return push * (1.0 - d) / d**2 - opening

    return float(brentq(excess, 0.0, excess(0.0) * (1.0 + 1e-9))) if excess(0.0) > 0.0 else 0.0


def largest_opening(model: mujoco.MjModel, data: mujoco.MjData, equality: int) -> float:
    """The largest length of the residuals of an equality in a run of a second [m or rad]."""
    largest = 0.0
    for _ in range(steps_of_run(model.opt.timestep)):
        mujoco.mj_step(model, data)
        if failure_warning(data):
            break
        own = np.array(data.efc_id[: data.ne]) == equality
        largest = max(largest, float(np.linalg.norm(np.array(data.efc_pos[: data.ne])[own])))
    return largest


def judge_stops(model: mujoco.MjModel, data: mujoco.MjData) -> Iterator[ModelFinding]:
    """Position servos whose targets lie beyond the stops of their joints.

    At rest the servo's force g^2 kp (over - r) equals that of the soft stop, which `stop_stiffness`
    gives.
    """
    for a in filter(lambda a: is_servo(model, a), range(model.nactuator)):
        j, gain = int(model.actuator_trnid[a][0]), -float(model.actuator_biasprm[a][1])
        gear = float(model.actuator_gear[model.actuator_outadr[a]][0])
        if not model.jnt_limited[j] or model.jnt_solref[j][0] <= 0.0:
            continue
        control = float(data.ctrl[model.actuator_ctrladr[a]])
        push = float(model.actuator_gainprm[a][0]) * control + float(model.actuator_biasprm[a][0])
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
    solimp = model.jnt_solimp[joint]
    d, largest = impedance(solimp, depth), within_bounds(float(solimp[1]))
    weight = float(model.dof_invweight0[model.jnt_dofadr[joint]])
    return d**2 / ((largest * constant * ratio) ** 2 * (1.0 - d) * weight)


def impedance(solimp: Array, depth: float) -> float:
    """MuJoCo's impedance at a depth [1], of the five numbers of `solimp`.

    It rises from the first to the second number within the width, as a power on both sides of the
    midpoint.  Without a width it is their mean.

    >>> round(impedance(np.array([0.9, 0.95, 0.001, 0.5, 2.0]), 0.0005), 9)
    0.925
    >>> round(impedance(np.array([0.9, 0.95, 0.0, 0.5, 2.0]), 0.0005), 9)
    0.925
    """
    low, high, middle = (within_bounds(float(solimp[k])) for k in (0, 1, 3))
    width, power = float(solimp[2]), max(float(solimp[4]), 1.0)
    if low == high or width <= mujoco.mjMINVAL:
        return (low + high) / 2.0
    share = min(abs(depth) / width, 1.0)
    if share <= middle:
        rise = middle * (share / middle) ** power
    else:
        rise = 1.0 - (1.0 - middle) * ((1.0 - share) / (1.0 - middle)) ** power
    return low + (high - low) * rise


def within_bounds(impedance: float) -> float:
    """An impedance, or the place of its midpoint, within the bounds of MuJoCo [1]."""
    return min(max(impedance, mujoco.mjMINIMP), mujoco.mjMAXIMP)
