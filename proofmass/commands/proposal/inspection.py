"""The properties of a model, and the run and the reference that are proposed for it.

A planar linkage with one degree of freedom is driven by the best of its joints.  A mechanism with
more of them is let go; so is one whose drive would replace a servo or a control of the key, or a
single joint, whose drive sets all that is measured.  With an actuator on one joint only, and
springs that keep the others in equilibrium, that joint is driven in a sweep.

The reference of a motion is the general planar solver if it covers the model, else that for motions
in space, else the model's own equations, solved closely, as far as the motion is known.
"""

from dataclasses import dataclass, replace
from math import floor
from pathlib import Path

import numpy as np
from mujoco import MjModel

from proofmass.analytic import spatial
from proofmass.analytic.planar import Mechanism, read, solve
from proofmass.analytic.planar.kinematics import count_dof, nearest_pose
from proofmass.analytic.planar.support import SUPPORT
from proofmass.analytic.support import RunKind, refuse, refuse_contacts
from proofmass.base.errors import InputError
from proofmass.base.units import MOTION_UNITS, POSITION_UNITS
from proofmass.base.wording import number
from proofmass.batch.work import OWN_MODEL_SAMPLES
from proofmass.commands.proposal.joint_range import (
    JointRange,
    find_best_range,
    has_springs,
    refuse_start_out_of_range,
)
from proofmass.reference.model_run import smooth_terms
from proofmass.reference.self_consistency import (
    AGREEMENT_SHARE,
    Rung,
    format_length,
    why_failed,
)
from proofmass.run.sidecar import DEFAULT_SAMPLES
from proofmass.sim.contents import (
    actuators_on,
    bodies_rotating_in_space,
    channel_names,
    channel_unit,
    is_disabled,
    joint_of,
    joints,
    key_names,
    mechanism_dof,
    moves_by_itself,
    place_sensors,
    pose_of_key,
    sensor_names,
    sensors_of_drive,
    why_not_motor,
)
from proofmass.sim.engines import NATIVE_ENGINE, engine_of
from proofmass.sim.mjcf import compile_model
from proofmass.sim.protocol.failures import NotSolved, Unsupported
from proofmass.sim.protocol.run import STEP_ROUNDING, fitting_samples

FREE_MOTION_SECONDS = 1.0
"""Duration of a free motion [s]."""
KNOWN_SHARE = 0.9
"""Share of the time until which a motion is known, since other samples may give less."""
INSPECTION_WORK = 12.0
"""Counted processor time of the solutions that tell until when a motion is known [s]: a third of
what the reference itself takes, since only the time is needed."""


MAX_REASONS = 2
"""Largest number of reasons for which a run or a reference is left out that are written."""
NAME_THE_KEY = 'its key has no name; write <key name="start" …/>'


class UnnamedKey(InputError):
    """A model has keys, and none has a name, by which a sidecar could choose one."""


@dataclass(frozen=True)
class ModelSummary:
    """The properties of a model, and the run and reference that are proposed for it.

    Attributes
    ----------
    start : str
        The key with the start pose; empty if the model has none.
    dof : int
        The number of degrees of freedom.
    drive : JointRange or None
        The range of the best joint to drive; None if none can be driven, and in a free motion.
    sensors, drive_channels : tuple of str
        Names of the model's sensors, and of those that measure the motion of the drive.
    placed : bool
        Whether a sensor with a name measures a position or an orientation other than that of the
        drive, at which the reference is evaluated, so that nothing is checked by it.
    joints, sites, bodies : tuple of str
        Names of elements that can be measured: hinges and slides, sites, and bodies on ball joints
        and free joints.
    timestep : float
        The model's time step [s].
    moves, controlled : bool
        Whether it moves from its start pose without a drive, and whether actuators act then.
    reference : str
        The reference of the motion.
    known_until : float
        Time until which the motion is known to its reference, at most `FREE_MOTION_SECONDS` [s].
    why : str
        Why the references before this one do not cover the model; empty for the first reference.
    """

    start: str
    dof: int
    drive: JointRange | None
    sensors: tuple[str, ...]
    drive_channels: tuple[str, ...]
    placed: bool
    joints: tuple[str, ...]
    sites: tuple[str, ...]
    bodies: tuple[str, ...]
    timestep: float
    moves: bool
    controlled: bool = False
    reference: str = "planar"
    known_until: float = FREE_MOTION_SECONDS
    why: str = ""

    @property
    def until(self) -> float:
        """Duration of a free motion [s]: whole steps of the model, as many to each sample.

        It is at least one step, and at most a step to each sample less than `known_until`.
        """
        steps = max(1, floor(self.known_until / self.timestep + STEP_ROUNDING))
        steps -= steps % max(1, steps // (DEFAULT_SAMPLES - 1))
        return float(f"{steps * self.timestep:.12g}")

    @property
    def samples(self) -> int:
        """Number of samples of a free motion that whole steps of the model lead to."""
        return fitting_samples(self.until, self.timestep, DEFAULT_SAMPLES)

    @property
    def is_determined(self) -> bool:
        """Whether a drive determines the motion, so that the engines' own tolerances apply."""
        return self.drive is not None and self.dof == 1

    def describe(self) -> str:
        """A sentence on the degrees of freedom, and the run that is proposed."""
        if not self.drive:
            why = f"{self.why[0].upper()}{self.why[1:]}. " if self.why else ""
            known = ""
            if self.known_until < FREE_MOTION_SECONDS:
                known = ", as far as its motion is known"
            controls = " under the controls of its key" if self.controlled else ""
            return (
                f"{why}It has {self.dof} degree{'s' * (self.dof > 1)} of freedom and is let go"
                f"{controls} for {self.until:g} s{known}."
            )
        way = self.drive.describe_way()
        if not self.is_determined:
            return (
                f"It has {self.dof} degrees of freedom; joint {self.drive.joint!r} is driven, as "
                f"its actuator does, and {way}. Springs hold the others at rest."
            )
        return f"It has one degree of freedom; joint {self.drive.joint!r} drives it and {way}."


def inspect_model(path: Path) -> ModelSummary:
    """Find the properties of a model, and a run and a reference for it.

    Raises
    ------
    BadModel
        The model does not compile.
    InputError
        Its motion is not known for any time, no joint can be driven, or none of its keys has a
        name.
    """
    model = compile_model(path)
    if not model.nv:
        raise InputError(path, "", "it has no joint: nothing can move; give its bodies joints")
    names = key_names(model)
    start = "start" if "start" in names else next(filter(None, names), "")
    if names and not start:
        raise UnnamedKey(path, "", NAME_THE_KEY)
    refuse_unusable_start(path, model, start)
    try:
        mechanism, plane = read(model, start)
        pose = nearest_pose(mechanism, mechanism.start)
        dof = count_dof(mechanism, pose)
    except ValueError as error:
        return inspect_in_space(path, model, start, mechanism_dof(model, start), str(error))
    look = summarize_model(model, start, dof)
    if may_be_driven(model, look, mechanism):
        if dof == 1:
            refuse_start_out_of_range(path, mechanism, pose)
        best, why = find_best_range(model, start, mechanism, plane.data, pose, springs_hold=dof > 1)
        replaces = best and look.moves and is_controlled(model, start, best.joint)
        if best and not replaces:
            return summarize_model(model, start, dof, best)
        if dof == 1 and not look.moves:
            words = "no joint with a name can be driven from the start pose"
            raise InputError(path, "", f"{words}: {why}" if why else words)
    if not look.moves:
        return look
    try:
        refuse_contacts(plane.data)
        refuse(plane.data, SUPPORT, RunKind.FREE_MOTION)
        solve(free_times(), model=model, start=start)
    except np.linalg.LinAlgError:
        return inspect_in_space(path, model, start, dof, "its pose at the start is singular")
    except ValueError as error:
        return inspect_in_space(path, model, start, dof, str(error))
    return look


def may_be_driven(model: MjModel, look: ModelSummary, mechanism: Mechanism) -> bool:
    """Whether a drive of a planar mechanism may show more than its free motion.

    A drive of the only joint sets all positions, velocities and accelerations.  With more degrees
    of freedom one drive is enough if the key moves nothing by itself but what springs hold.
    """
    if look.dof > 1:
        motors = {joint_of(model, a) for a in range(model.nactuator)} - {-1}
        rests = not pose_of_key(model, look.start).qvel.any()
        controlled = any(is_controlled(model, look.start, model.joint(j).name) for j in motors)
        return len(motors) == 1 and has_springs(mechanism) and rests and not controlled
    if look.dof == 1 and len(mechanism.joints) == 1:
        alone = set(sensors_of_drive(model, mechanism.joints[0].name)) >= {*look.sensors}
        return not (alone or (look.moves and measures_motion_only(model, look.start)))
    return look.dof == 1


def measures_motion_only(model: MjModel, start: str) -> bool:
    """Whether all sensors measure positions, orientations, velocities or accelerations."""
    kinematic = set(POSITION_UNITS).union(*MOTION_UNITS.values())
    return all(
        channel_unit(model, name) in kinematic
        for names in channel_names(model, start).values()
        for name in names
    )


def is_controlled(model: MjModel, start: str, joint: str) -> bool:
    """Whether a servo, or a motor whose control in the key is not 0, acts on a joint."""
    controls = pose_of_key(model, start).ctrl
    return any(
        why_not_motor(model, a) or controls[model.actuator_ctrladr[a]]
        for a in actuators_on(model, model.joint(joint).id)
    )


def has_controls(model: MjModel, start: str) -> bool:
    """Whether any servo, or any motor whose control in the key is not 0, acts in a free motion."""
    controls = pose_of_key(model, start).ctrl
    return any(
        not is_disabled(model, a)
        and bool(why_not_motor(model, a) or controls[model.actuator_ctrladr[a]])
        for a in range(model.nactuator)
    )


def refuse_unusable_start(path: Path, model: MjModel, start: str) -> None:
    """Raise an `InputError` if a number of the start pose is not finite."""
    data = pose_of_key(model, start)
    for name in ("qpos", "qvel", "ctrl"):
        if not np.isfinite(getattr(data, name)).all():
            raise InputError(
                path, "", f"a number of {name} in key {start!r} is not finite; give another"
            )


def first_reasons(why: str) -> str:
    """The first of many reasons why an engine does not cover a run.

    >>> first_reasons("no a; no b; no c; no d; leave it out")
    'no a; no b; 2 more reasons'
    """
    parts = why.removesuffix("; leave it out").split("; ")
    if len(parts) <= MAX_REASONS:
        return "; ".join(parts)
    return f"{'; '.join(parts[:MAX_REASONS])}; {len(parts) - MAX_REASONS} more reasons"


def free_times() -> np.ndarray:
    """Times (n,) at which a reference must be known to be proposed for a free motion [s]."""
    return np.linspace(0.0, FREE_MOTION_SECONDS, OWN_MODEL_SAMPLES)


def summarize_model(
    model: MjModel, start: str, dof: int, drive: JointRange | None = None
) -> ModelSummary:
    """The properties of a model, with the names of its elements."""
    of_drive = sensors_of_drive(model, drive.joint) if drive else []
    return ModelSummary(
        start,
        dof,
        drive,
        tuple(filter(None, sensor_names(model))),
        tuple(of_drive),
        any(set(place_sensors(model)) - {*of_drive, ""}),
        tuple(name for name, unit in joints(model).items() if name and unit),
        tuple(filter(None, (model.site(s).name for s in range(model.nsite)))),
        tuple(filter(None, bodies_rotating_in_space(model))),
        float(model.opt.timestep),
        moves_by_itself(model, start),
        has_controls(model, start),
    )


def inspect_in_space(path: Path, model: MjModel, start: str, dof: int, planar: str) -> ModelSummary:
    """Find the properties and a reference of a model that is no planar linkage.

    `planar` says why it is none.

    Raises
    ------
    InputError
        The model's own run fails with all steps, or its motion is not known for any time.
    """
    look = summarize_model(model, start, dof)
    if not look.moves:
        return look
    why = f"the general planar solver does not cover it: {first_reasons(planar)}"
    try:
        spatial.solve(free_times(), model=model, start=start, terms=smooth_terms(model, start))
    except ValueError as error:
        why += f"; nor does that for motions in space: {first_reasons(str(error))}"
    else:
        return replace(look, reference="spatial", why=why)
    try:
        motion = engine_of(NATIVE_ENGINE).own_equations.solve_motion(
            path, FREE_MOTION_SECONDS, OWN_MODEL_SAMPLES, INSPECTION_WORK, start
        )
    except (Unsupported, NotSolved) as error:
        raise InputError(path, "", f"{why}; nor can its own equations be solved: {error}") from None
    if motion.runs[0].is_failure:
        failed = why_failed(motion)
        raise InputError(path, "", f"it fails with its own step and with finer ones: {failed}")
    rung = Rung(motion)
    if rung.consistent and rung.moved < AGREEMENT_SHARE * motion.extent:
        raise InputError(
            path,
            "",
            f"nothing moves: until {number(rung.until)} s no body leaves its start by more than "
            f"{format_length(rung.moved)}, and its size is {format_length(motion.extent)}; give a "
            "key with velocities (qvel) or controls (ctrl), or another start pose",
        )
    if not (until := rung.close_agrees_until):
        raise InputError(path, "", f"{why}; and {rung.words()}")
    until = (
        FREE_MOTION_SECONDS if until == FREE_MOTION_SECONDS else float(f"{KNOWN_SHARE * until:.2g}")
    )
    return replace(look, reference="refined", why=why, known_until=until)
