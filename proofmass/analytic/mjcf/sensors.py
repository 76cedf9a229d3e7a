"""Sensors of a compiled model: what they measure, and the frames that they are on."""

from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import mujoco
import numpy as np

from proofmass.analytic.numerics import IDENTITY_QUATERNION, NotCovered
from proofmass.base.arrays import Array

SENSOR, OBJECT = mujoco.mjtSensor, mujoco.mjtObj


class SensorKind(StrEnum):
    """What a sensor measures, in MuJoCo's words; OTHER is whatever no general solver computes."""

    JOINTPOS = "jointpos"
    JOINTVEL = "jointvel"
    JOINTACTFRC = "jointactfrc"
    BALLQUAT = "ballquat"
    BALLANGVEL = "ballangvel"
    TENDONPOS = "tendonpos"
    TENDONVEL = "tendonvel"
    TENDONACTFRC = "tendonactfrc"
    ACTUATORFRC = "actuatorfrc"
    FRAMEPOS = "framepos"
    FRAMELINVEL = "framelinvel"
    FRAMELINACC = "framelinacc"
    FRAMEANGVEL = "frameangvel"
    FRAMEANGACC = "frameangacc"
    FRAMEQUAT = "framequat"
    FRAMEXAXIS = "framexaxis"
    FRAMEYAXIS = "frameyaxis"
    FRAMEZAXIS = "framezaxis"
    GYRO = "gyro"
    VELOCIMETER = "velocimeter"
    ACCELEROMETER = "accelerometer"
    FORCE = "force"
    TORQUE = "torque"
    E_POTENTIAL = "e_potential"
    E_KINETIC = "e_kinetic"
    USER = "user"
    OTHER = "other"


SENSOR_KINDS = {
    int(getattr(SENSOR, f"mjSENS_{kind.name}")): kind
    for kind in SensorKind
    if kind != SensorKind.OTHER
}


@dataclass(frozen=True, eq=False)
class SensorFrame:
    """A frame that is fixed to a body.

    Attributes
    ----------
    body : int
    place : ndarray (3,)
        Its origin in the body's frame [m].
    turn : ndarray (4,)
        Its orientation as a quaternion in the body's frame [1].
    """

    body: int
    place: Array
    turn: Array


@dataclass(frozen=True, eq=False)
class SensorData:
    """A sensor.

    Attributes
    ----------
    name, kind : str, SensorKind
    number : int
        Number of the joint, tendon, actuator or other object that it is on; -1 for none.
    on_joint : bool
        Whether that object is a joint.
    is_relative : bool
        Whether it measures relative to a frame other than the ground.
    fixed_frame : SensorFrame, optional
        The frame of the site, geom, body or camera that it is on.
    moving_camera : str, optional
        Name of the camera that it is on, if the camera moves relative to its body.
    cutoff, delay, noise : float
        Largest absolute value [its unit], time after which a value is shown [s], and standard
        deviation of the noise [its unit].
    interval : tuple of float
        Time between two values, and the time of the first [s].
    """

    name: str
    kind: SensorKind
    number: int
    on_joint: bool
    is_relative: bool
    fixed_frame: SensorFrame | None
    moving_camera: str | None
    cutoff: float
    delay: float
    noise: float
    interval: tuple[float, ...]

    @property
    def frame(self) -> SensorFrame:
        """The frame that it is on.

        Raises
        ------
        NotCovered
            That is a camera that moves relative to its body.
        """
        if self.moving_camera is not None:
            raise NotCovered(
                f"sensor {self.name!r} is on camera {self.moving_camera!r}, which is not fixed to "
                "its body: its mode must be fixed"
            )
        assert self.fixed_frame is not None, "a sensor of a kind without a frame"
        return self.fixed_frame


def read_sensor(model: Any, s: int) -> SensorData:
    """Read sensor number s."""
    kind = OBJECT(int(model.sensor_objtype[s]))
    i = int(model.sensor_objid[s])
    moves = kind == OBJECT.mjOBJ_CAMERA and model.cam_mode[i] != mujoco.mjtCamLight.mjCAMLIGHT_FIXED
    return SensorData(
        model.sensor(s).name,
        SENSOR_KINDS.get(int(model.sensor_type[s]), SensorKind.OTHER),
        i,
        kind == OBJECT.mjOBJ_JOINT,
        bool(model.sensor_reftype[s] != OBJECT.mjOBJ_UNKNOWN),
        None if moves else read_frame(model, kind, i),
        model.camera(i).name if moves else None,
        float(model.sensor_cutoff[s]),
        float(model.sensor_delay[s]),
        float(model.sensor_noise[s]),
        tuple(model.sensor_interval[s].tolist()),
    )


def read_frame(model: Any, kind: mujoco.mjtObj, i: int) -> SensorFrame | None:
    """Read the frame of object number i of a kind; None for a kind without a frame."""
    if kind == OBJECT.mjOBJ_SITE:
        own = model.site_bodyid[i], model.site_pos[i], model.site_quat[i]
    elif kind == OBJECT.mjOBJ_GEOM:
        own = model.geom_bodyid[i], model.geom_pos[i], model.geom_quat[i]
    elif kind == OBJECT.mjOBJ_CAMERA:
        own = model.cam_bodyid[i], model.cam_pos[i], model.cam_quat[i]
    elif kind == OBJECT.mjOBJ_BODY:  # the inertial frame, unlike xbody
        own = i, model.body_ipos[i], model.body_iquat[i]
    elif kind == OBJECT.mjOBJ_XBODY:
        own = i, np.zeros(3), IDENTITY_QUATERNION
    else:
        return None
    body, place, turn = own
    return SensorFrame(int(body), np.array(place), np.array(turn))
