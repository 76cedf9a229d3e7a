"""Actuators of a compiled model: what they act on, and the laws of their forces.

A law of force is a class with a method `read`, which returns the law of an actuator that has it,
and a method `force`.  A law in `FORCE_LAWS` acts in both general solvers.
"""

from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Protocol, Self

import mujoco
import numpy as np

from proofmass.analytic.mjcf.bodies import JOINT_KINDS
from proofmass.analytic.mjcf.options import DISABLE, UNLIMITED, is_disabled, read_range
from proofmass.analytic.numerics import rotation_matrix
from proofmass.base.arrays import Array

GAIN, BIAS, TRANSMISSION = mujoco.mjtGain, mujoco.mjtBias, mujoco.mjtTrn
JOINT_TRANSMISSIONS = TRANSMISSION.mjTRN_JOINT, TRANSMISSION.mjTRN_JOINTINPARENT


class ActuatorTarget(StrEnum):
    """What an actuator acts on."""

    SCALAR_JOINT = "hinge or slide"
    TURNING_JOINT = "ball or free joint"
    TENDON = "tendon"
    SITE = "site, in directions of its body or of the ground"
    OTHER = "site in a frame that moves, crank or body"


class ForceLaw(Protocol):
    """Force of an actuator by its control, its length and the rate of its length."""

    @property
    def has_feedback(self) -> bool:
        """Whether the force depends on the length or its rate."""

    def force(self, control: Array, length: Array | float, rate: Array | float) -> Array:
        """Forces (n,) for controls, lengths and rates [N or N m]."""


@dataclass(frozen=True)
class AffineForce:
    """Force that is linear in control, length and rate.

    Attributes
    ----------
    gain : float
        Force per unit of the control [SI].
    offset : float
        Constant part of the force [N or N m].
    per_length, per_rate : float
        Force per unit of length, and per unit of the length's rate [SI].
    """

    gain: float
    offset: float
    per_length: float
    per_rate: float

    @classmethod
    def read(cls, model: Any, a: int) -> Self | None:
        """The law of actuator number a, or None if it has another one."""
        affine = model.actuator_biastype[a] == BIAS.mjBIAS_AFFINE
        if model.actuator_gaintype[a] != GAIN.mjGAIN_FIXED:
            return None
        if not (affine or model.actuator_biastype[a] == BIAS.mjBIAS_NONE):
            return None
        offset, per_length, per_rate = (model.actuator_biasprm[a, :3] * affine).tolist()
        return cls(float(model.actuator_gainprm[a, 0]), offset, per_length, per_rate)

    @property
    def has_feedback(self) -> bool:
        """Whether the force depends on the length or its rate."""
        return bool(self.per_length or self.per_rate)

    def force(self, control: Array, length: Array | float, rate: Array | float) -> Array:
        """Forces (n,) for controls, lengths and rates [N or N m]."""
        own = self.gain * control + self.offset + self.per_length * length + self.per_rate * rate
        return np.asarray(own)


FORCE_LAWS = (AffineForce,)
"""The laws that `read_law` tries, in this order."""


def read_law(model: Any, a: int) -> ForceLaw | None:
    """The law of the force of actuator number a, or None if no law in `FORCE_LAWS` is its own."""
    return next((found for law in FORCE_LAWS if (found := law.read(model, a))), None)


@dataclass(frozen=True, eq=False)
class ActuatorData:
    """An actuator.

    Attributes
    ----------
    name : str
    target : ActuatorTarget
        What it acts on.
    joint, tendon : int
        Number of its joint and of its tendon; -1 if it acts on something else.
    pose, rate : int
        First indices of its joint in a pose and in the rates; -1 if it acts on something else.
    gear : float
        Length of the actuator per unit of its joint's value or of its tendon's length [SI].
    place : int
        Index of its control among all controls.
    law : ForceLaw, optional
        Law of its force; None if `FORCE_LAWS` has not its law.
    range : tuple of float
        Smallest and largest force [N or N m].
    controls : tuple of float
        Smallest and largest control [its unit].
    is_disabled : bool
        Whether a flag of the model, or its group, disables it.
    has_feedback : bool
        Whether its force depends on its length or rate: a servo.
    has_state : bool
        Whether its force depends on an activation, which has its own differential equation.
    delay : float
        Time after which a control acts [s].
    armature : float
        Rotor inertia [SI].
    damping : tuple of float
        Coefficients of its damping, lowest power first [SI].
    """

    name: str
    target: ActuatorTarget
    joint: int
    tendon: int
    pose: int
    rate: int
    gear: float
    place: int
    law: ForceLaw | None
    range: tuple[float, float] = UNLIMITED
    controls: tuple[float, float] = UNLIMITED
    is_disabled: bool = False
    has_feedback: bool = False
    has_state: bool = False
    delay: float = 0.0
    armature: float = 0.0
    damping: tuple[float, ...] = (0.0, 0.0, 0.0)

    @property
    def is_limited(self) -> bool:
        """Whether its force has a lower or upper limit."""
        return bool(np.isfinite(self.range).any())

    @property
    def affine(self) -> AffineForce | None:
        """Its law if that is linear and its force has no limit, else None."""
        return self.law if isinstance(self.law, AffineForce) and not self.is_limited else None

    def clipped(self, control: Array) -> Array:
        """Controls (n,), clipped to their range."""
        return control if self.controls == UNLIMITED else np.clip(control, *self.controls)

    def force(
        self, control: Array, length: Array | float = 0.0, rate: Array | float = 0.0
    ) -> Array:
        """Forces (n,) for given controls, lengths and rates, clipped to their range [N or N m]."""
        assert self.law is not None, "refused before"
        return np.asarray(np.clip(self.law.force(self.clipped(control), length, rate), *self.range))


@dataclass(frozen=True, eq=False)
class SiteLoad:
    """Force and moment that an actuator on a site applies to its body; only the control sets them.

    Attributes
    ----------
    actuator : ActuatorData
        An actuator whose force depends on its control alone.
    body : int
        Number of the body.
    at : ndarray (3,)
        Position of the site in the frame of the body [m].
    force, moment : ndarray (3,)
        Force and moment per unit of the actuator's force [1, m]: in the frame of the body if the
        load `follows` it, otherwise in the frame of the ground.
    follows : bool
        Whether the load turns with the body; otherwise it is a dead load.
    """

    actuator: ActuatorData
    body: int
    at: Array
    force: Array
    moment: Array
    follows: bool


def read_actuator(model: Any, a: int) -> ActuatorData:
    """Read actuator number a."""
    target, number = actuator_target(model, a), int(model.actuator_trnid[a, 0])
    on_joint = target in (ActuatorTarget.SCALAR_JOINT, ActuatorTarget.TURNING_JOINT)
    clamps = not is_disabled(model, DISABLE.mjDSBL_CLAMPCTRL)
    dynamic = model.actuator_dyntype[a] != mujoco.mjtDyn.mjDYN_NONE
    law = read_law(model, a)
    in_group = model.opt.disableactuator >> int(model.actuator_group[a]) & 1
    return ActuatorData(
        model.actuator(a).name,
        target,
        number if on_joint else -1,
        number if target == ActuatorTarget.TENDON else -1,
        int(model.jnt_qposadr[number]) if on_joint else -1,
        int(model.jnt_dofadr[number]) if on_joint else -1,
        float(model.actuator_gear[model.actuator_outadr[a], 0]),
        int(model.actuator_ctrladr[a]),
        law,
        read_range(model.actuator_forcerange[a], bool(model.actuator_forcelimited[a])),
        read_range(model.actuator_ctrlrange[a], clamps and bool(model.actuator_ctrllimited[a])),
        bool(in_group or is_disabled(model, DISABLE.mjDSBL_ACTUATION)),
        bool(model.actuator_biastype[a] == BIAS.mjBIAS_AFFINE or (law and law.has_feedback)),
        bool(dynamic or model.actuator_actnum[a]),
        float(model.actuator_delay[a]),
        float(model.actuator_armature[a]),
        (float(model.actuator_damping[a]), *model.actuator_dampingpoly[a].tolist()),
    )


def actuator_target(model: Any, a: int) -> ActuatorTarget:
    """What actuator number a acts on."""
    kind, (what, frame) = int(model.actuator_trntype[a]), model.actuator_trnid[a].tolist()
    if kind in JOINT_TRANSMISSIONS:
        scalar = JOINT_KINDS[int(model.jnt_type[what])].is_scalar
        return ActuatorTarget.SCALAR_JOINT if scalar else ActuatorTarget.TURNING_JOINT
    if kind == TRANSMISSION.mjTRN_TENDON:
        return ActuatorTarget.TENDON
    if kind == TRANSMISSION.mjTRN_SITE and (
        frame < 0 or model.body_weldid[model.site_bodyid[frame]] == 0
    ):
        return ActuatorTarget.SITE
    return ActuatorTarget.OTHER


def read_site_loads(model: Any, actuators: tuple[ActuatorData, ...]) -> tuple[SiteLoad, ...]:
    """Read the loads of the actuators on sites that act and have no feedback."""
    return tuple(
        read_site_load(model, a, one)
        for a, one in enumerate(actuators)
        if one.target == ActuatorTarget.SITE and not (one.is_disabled or one.has_feedback)
    )


def read_site_load(model: Any, a: int, actuator: ActuatorData) -> SiteLoad:
    """Read the load of actuator number a, which acts on a site."""
    site, frame = map(int, model.actuator_trnid[a])
    turn = rotation_matrix(model.site_quat[site if frame < 0 else frame])
    # a frame of the ground may hang on bodies without joints, whose turns add up
    carrier = 0 if frame < 0 else int(model.site_bodyid[frame])
    while carrier:
        turn, carrier = (
            rotation_matrix(model.body_quat[carrier]) @ turn,
            int(model.body_parentid[carrier]),
        )
    force, moment = model.actuator_gear[model.actuator_outadr[a]].reshape(2, 3) @ turn.T
    return SiteLoad(
        actuator,
        int(model.site_bodyid[site]),
        np.array(model.site_pos[site]),
        force,
        moment,
        frame < 0,
    )
