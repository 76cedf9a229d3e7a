r"""Position servos that do not hold their targets, and starts that no control holds.

A position servo is a spring: it pulls with kp (target - length).  Under a load it rests beside its
target, by the load over kp.  A key with a pose and without controls is left at once, since the
targets of all servos are then 0.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import mujoco
import numpy as np

from proofmass.base.wording import number
from proofmass.screen.finding import FindingKind, ModelFinding, NamedElement, Severity
from proofmass.screen.pose import HINGE, SLIDE, RestPose, coordinate_unit, named_element
from proofmass.screen.rest import state_at
from proofmass.screen.short_run import run_from, steps_of_run
from proofmass.sim.dense import moment_arms

TOLD_ANGLE, TOLD_SHARE = 1e-3, 1e-4
"""Distance from the target that is told, of a hinge [rad] and as a share of the model's extent of a
slide: 0.06 degrees."""
SEEN_FACTOR, PULLED_FACTOR = 20.0, 100.0
"""Multiples of these: of a warning, and of a start that servos are said to pull away from."""
CONTROL_SHARE = 1e-10
"""Least singular value for controls, as a share of the largest."""
CONFIRMED_CHANGE = 0.1
"""Largest motion of a run that begins in the rest pose, as a share of the distance that is told."""
NO_CONTROL = 1e-9
"""Controls that are written as 0, as a share of the largest."""
SOLVED = 1e-6
"""Largest force that controls leave, as a share of the load, if they hold the start."""


@dataclass(frozen=True)
class RestingServo:
    """A position servo on a joint, at rest.

    Attributes
    ----------
    actuator, joint : NamedElement
    unit : str
        Of the joint's coordinate, ``rad`` or ``m``.
    coordinate : int
    miss : float
        The distance of the joint from the servo's target [rad or m].
    gain : float
        The stiffness of the servo at the joint [N m/rad or N/m].
    told : float
        The least distance that is told [rad or m].
    """

    actuator: NamedElement
    joint: NamedElement
    unit: str
    coordinate: int
    miss: float
    gain: float
    told: float


def judge_servos(
    model: mujoco.MjModel, key: int, pose: RestPose, rest: RestPose
) -> Iterator[ModelFinding]:
    """A start that the servos pull away from, and the servo that misses its target most."""
    servos = resting_servos(model, rest)
    way = np.abs(pose.change_to(rest.qpos))
    # a control that compensates the load misses its target as well, and holds the start
    held = [servo for servo in servos if way[servo.coordinate] < servo.told]
    missing = [servo for servo in servos if servo.miss > servo.told and servo not in held]
    pulled = [
        servo
        for servo in servos
        if way[servo.coordinate] > max(PULLED_FACTOR * servo.told, 2.0 * servo.miss)
    ]
    if not (missing or pulled) or not stays(model, rest, min(servo.told for servo in servos)):
        return
    controls = holding_controls(pose)
    if pulled:
        most = max(pulled, key=lambda servo: way[servo.coordinate])
        yield leaves_start(model, key, most, float(way[most.coordinate]), controls)
    if missing:
        yield misses_target(missing, len(servos), controls if not pulled else "")


def is_servo(model: mujoco.MjModel, actuator: int) -> bool:
    """Whether an actuator pulls a hinge or slide towards a target."""
    on_joint = model.actuator_trntype[actuator] == mujoco.mjtTrn.mjTRN_JOINT
    return bool(
        on_joint
        and model.actuator_outnum[actuator] == model.actuator_ctrlnum[actuator] == 1
        and model.jnt_type[model.actuator_trnid[actuator][0]] in (HINGE, SLIDE)
        and model.actuator_gaintype[actuator] == mujoco.mjtGain.mjGAIN_FIXED
        and model.actuator_biastype[actuator] == mujoco.mjtBias.mjBIAS_AFFINE
        and model.actuator_biasprm[actuator][1] < 0.0
        and model.actuator_gear[model.actuator_outadr[actuator]][0]
    )


def resting_servos(model: mujoco.MjModel, rest: RestPose) -> list[RestingServo]:
    """The servos of a model in its rest pose, but for joints that dry friction may hold."""
    found = []
    for a in filter(lambda a: is_servo(model, a), range(model.nactuator)):
        output, joint = int(model.actuator_outadr[a]), int(model.actuator_trnid[a][0])
        gear, coordinate = float(model.actuator_gear[output][0]), int(model.jnt_dofadr[joint])
        force = float(rest.data.actuator_force[output])
        gain = -float(model.actuator_biasprm[a][1])
        if abs(force * gear) < model.dof_frictionloss[coordinate]:
            continue
        unit = coordinate_unit(model, coordinate)
        found.append(
            RestingServo(
                named_element(model, "actuator", a),
                named_element(model, "joint", joint),
                unit,
                coordinate,
                abs(force / gain / gear),
                gain * gear**2,
                TOLD_ANGLE if unit == "rad" else TOLD_SHARE * float(model.stat.extent),
            )
        )
    return found


def stays(model: mujoco.MjModel, rest: RestPose, told: float) -> bool:
    """Whether a run of a second that begins in a rest pose stays there, contacts included."""
    _, moved = run_from(model, state_at(model, rest), steps_of_run(model.opt.timestep))
    return bool(np.abs(moved).max(initial=0.0) < CONFIRMED_CHANGE * told)


def holding_controls(pose: RestPose) -> str:
    """The controls that hold a pose, as text; empty if none do, or if they exceed their limits."""
    model, data = pose.model, pose.data
    pose.enter(pose.qpos)
    motions, arms = pose.constraints.motions, moment_arms(model, data)
    load = motions.T @ (pose.forces - arms.T @ data.actuator_force)
    forces = -np.linalg.lstsq(motions.T @ arms.T, load, rcond=CONTROL_SHARE)[0]
    left = motions.T @ arms.T @ forces + load
    gains = np.where(model.actuator_gaintype == mujoco.mjtGain.mjGAIN_FIXED, 1.0, 0.0)
    gains = gains * model.actuator_gainprm[:, 0]
    if np.abs(left).max(initial=0.0) > SOLVED * max(np.abs(load).max(initial=0.0), 1e-300):
        return ""
    if not gains.all() or model.na or not len(gains) == len(forces) == model.nu:
        return ""
    biases = model.actuator_biasprm[:, 0] + model.actuator_biasprm[:, 1] * data.actuator_length
    controls = (forces - biases) / gains
    for values, limited, (low, high) in (
        (controls, model.actuator_ctrllimited, model.actuator_ctrlrange.T),
        (forces, model.actuator_forcelimited, model.actuator_forcerange.T),
    ):
        if (limited.astype(bool) & ((values < low) | (values > high))).any():
            return ""
    tiny = NO_CONTROL * np.abs(controls).max(initial=0.0)
    rounded = np.where(np.abs(controls) > tiny, controls, 0.0)
    return f'ctrl="{" ".join(f"{control:.6g}" for control in rounded)}"'


def leaves_start(
    model: mujoco.MjModel, key: int, servo: RestingServo, way: float, controls: str
) -> ModelFinding:
    """The finding of a start that the servos pull away from."""
    without = key >= 0 and not model.key_ctrl[key].any()
    why = ", since its key gives no controls" if without else ""
    return ModelFinding(
        FindingKind.SERVO,
        Severity.WARNING if without else Severity.NOTE,
        f"servos pull {servo.joint} {number(way)} {servo.unit} away from the start{why}",
        f"{controls} in the key holds the start" if controls else "",
        servo.actuator,
        way,
    )


def misses_target(missing: list[RestingServo], count: int, controls: str) -> ModelFinding:
    """The finding of the servo that misses its target most."""
    worst = max(missing, key=lambda servo: servo.miss / servo.told)
    others = f"; {len(missing)} of {count} servos miss theirs"
    force = "N m" if worst.unit == "rad" else "N"
    remedies = [f"{controls} in the key holds the start" if controls else "", 'gravcomp="1"']
    return ModelFinding(
        FindingKind.SERVO,
        Severity.WARNING if worst.miss > SEEN_FACTOR * worst.told else Severity.NOTE,
        f"{worst.actuator} rests {number(worst.miss)} {worst.unit} beside its target: it is a "
        f"spring of {number(worst.gain)} {force}/{worst.unit} under a load of "
        f"{number(worst.gain * worst.miss)} {force}{others if len(missing) > 1 else ''}",
        ", or ".join(filter(None, [*remedies, "a higher gain"])),
        worst.actuator,
        worst.miss,
    )
