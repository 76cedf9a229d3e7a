"""The numbers of a compiled MJCF as plain data, which both general solvers read.

`read_compiled` is the only place where the references look into a compiled model: bodies, joints,
tendons, actuators, equalities, sensors and keys become frozen data without an object of MuJoCo,
whatever the model has.  The features of a model (`proofmass.analytic.features`) are found in the
same data.  The solver of planar linkages projects them on the plane of motion; that of mechanisms
in space takes them as they are.

The two formulations check each other's mathematics, but not this reading.  A number that is misread
here differs from those of MuJoCo and of pymunk, whose adapters read the compiled model on their own
(`proofmass.sim.pymunk.model`) or not at all (`proofmass.sim.mujoco`), and from MuJoCo's terms of
the equations of motion (`proofmass.sim.smooth`).
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from proofmass.analytic.mjcf.actuators import (
    ActuatorData,
    ActuatorTarget,
    SiteLoad,
    read_actuator,
    read_site_loads,
)
from proofmass.analytic.mjcf.bodies import (
    JOINT_SIZES,
    BodyData,
    JointData,
    JointKind,
    carried_bodies,
    may_touch,
    read_body,
    read_joint,
)
from proofmass.analytic.mjcf.equalities import (
    EqualityData,
    EqualityKind,
    LoopData,
    TieData,
    read_equalities,
)
from proofmass.analytic.mjcf.options import UNLIMITED, OptionData, read_options
from proofmass.analytic.mjcf.sensors import SensorData, SensorFrame, SensorKind, read_sensor
from proofmass.analytic.mjcf.tendons import TendonData, TendonWay, read_tendon
from proofmass.base.arrays import Array

__all__ = [
    "JOINT_SIZES",
    "UNLIMITED",
    "ActuatorData",
    "ActuatorTarget",
    "BodyData",
    "EqualityData",
    "EqualityKind",
    "JointData",
    "JointKind",
    "KeyData",
    "LoopData",
    "ModelData",
    "OptionData",
    "SensorData",
    "SensorFrame",
    "SensorKind",
    "SiteLoad",
    "TendonData",
    "TendonWay",
    "TieData",
    "carried_bodies",
    "read_compiled",
]


@dataclass(frozen=True, eq=False)
class KeyData:
    """A keyframe, or the reference pose of a model without keys.

    Attributes
    ----------
    name : str
    pose, rates : ndarray (poses,), (rates,)
        A pose and its rates [SI].
    ctrl : ndarray (controls,)
        Controls [SI].
    time : float
        Time [s].
    """

    name: str
    pose: Array
    rates: Array
    ctrl: Array
    time: float


@dataclass(frozen=True, eq=False)
class ModelData:
    """A compiled model as plain data.

    A pose is a row as in ``qpos``, and rates are a row as in ``qvel``: for a ball joint the angular
    velocity in the axes of its body; for a free joint the velocity of its body's origin in the
    world, and then the angular velocity in the axes of the body.

    Attributes
    ----------
    bodies, joints, tendons, actuators, sensors, keys
        All elements of a kind, by their numbers in MuJoCo; body 0 is the ground.
    equalities : tuple of EqualityData
        Those that act from the start.
    site_loads : tuple of SiteLoad
        Loads of the actuators on sites that act and have no feedback.
    options : OptionData
    reference_pose : KeyData
        The pose in which the MJCF gives the bodies, without rates and controls.
    extent : float
        Size of the model [m].
    may_touch : bool
        Whether MuJoCo looks for contacts.
    flexes, plugins : int
        How many there are.
    """

    bodies: tuple[BodyData, ...]
    joints: tuple[JointData, ...]
    tendons: tuple[TendonData, ...]
    actuators: tuple[ActuatorData, ...]
    sensors: tuple[SensorData, ...]
    keys: tuple[KeyData, ...]
    equalities: tuple[EqualityData, ...]
    site_loads: tuple[SiteLoad, ...]
    options: OptionData
    reference_pose: KeyData
    extent: float
    may_touch: bool
    flexes: int
    plugins: int

    def key(self, name: str) -> KeyData:
        """The key of a name; for a model without keys the reference pose.

        Raises
        ------
        ValueError
            There are keys, but none of that name.
        """
        if not self.keys:
            return self.reference_pose
        found = next((key for key in self.keys if key.name == name), None)
        if found is None:
            names = ", ".join(key.name for key in self.keys)
            raise ValueError(f"no key {name!r}; there are: {names}")
        return found

    @property
    def acting(self) -> tuple[ActuatorData, ...]:
        """The actuators that the model does not disable."""
        return tuple(one for one in self.actuators if not one.is_disabled)

    @property
    def loops(self) -> tuple[LoopData, ...]:
        """The equalities of points of bodies."""
        return tuple(one for one in self.equalities if isinstance(one, LoopData))

    @property
    def ties(self) -> tuple[TieData, ...]:
        """The equalities of joints and of tendons."""
        return tuple(one for one in self.equalities if isinstance(one, TieData))

    @cached_property
    def control_places(self) -> dict[str, int]:
        """Indices of the actuators' controls among all controls, by the names of the actuators."""
        return {one.name: one.place for one in self.actuators}


def read_compiled(model: Any) -> ModelData:
    """Read a compiled model, with all that MJCF may have.

    Parameters
    ----------
    model : mujoco.MjModel
        Compiled; only its numbers and names are read.

    Returns
    -------
    ModelData
    """
    actuators = tuple(read_actuator(model, a) for a in range(model.nactuator))
    return ModelData(
        tuple(read_body(model, b) for b in range(model.nbody)),
        tuple(read_joint(model, j) for j in range(model.njnt)),
        tuple(read_tendon(model, t) for t in range(model.ntendon)),
        actuators,
        tuple(read_sensor(model, s) for s in range(model.nsensor)),
        tuple(read_key(model, k) for k in range(model.nkey)),
        read_equalities(model),
        read_site_loads(model, actuators),
        read_options(model),
        KeyData("", np.array(model.qpos0), np.zeros(model.nv), np.zeros(model.nu), 0.0),
        float(model.stat.extent),
        may_touch(model),
        int(model.nflex),
        int(model.nplugin),
    )


def read_key(model: Any, k: int) -> KeyData:
    """Read keyframe number k."""
    return KeyData(
        model.key(k).name,
        np.array(model.key_qpos[k]),
        np.array(model.key_qvel[k]),
        np.array(model.key_ctrl[k]),
        float(model.key_time[k]),
    )
