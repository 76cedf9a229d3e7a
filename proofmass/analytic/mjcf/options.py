"""Options and flags of a compiled model that hold for all elements, and ranges of numbers."""

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from proofmass.base.arrays import Array

DISABLE, ENABLE = mujoco.mjtDisableBit, mujoco.mjtEnableBit
SPRING_FLAGS, DAMPER_FLAGS = int(DISABLE.mjDSBL_SPRING), int(DISABLE.mjDSBL_DAMPER)
FRICTION_FLAGS = int(DISABLE.mjDSBL_FRICTIONLOSS | DISABLE.mjDSBL_CONSTRAINT)
LIMIT_FLAGS = int(DISABLE.mjDSBL_LIMIT | DISABLE.mjDSBL_CONSTRAINT)
EQUALITY_FLAGS = int(DISABLE.mjDSBL_EQUALITY | DISABLE.mjDSBL_CONSTRAINT)
CONTACT_FLAGS = int(DISABLE.mjDSBL_CONTACT | DISABLE.mjDSBL_CONSTRAINT)
"""Flags each of which disables all springs, dampers, dry friction, ranges, equalities, contacts."""
UNLIMITED = (-np.inf, np.inf)
"""The range of a number that has no limits."""


def is_disabled(model: Any, flags: int) -> bool:
    """Whether a compiled model sets one of some disable flags."""
    return bool(model.opt.disableflags & int(flags))


def is_enabled(model: Any, flag: int) -> bool:
    """Whether a compiled model sets an enable flag."""
    return bool(model.opt.enableflags & int(flag))


def read_range(values: Array, limited: bool) -> tuple[float, float]:
    """Ends of a range; infinite if there is none."""
    return (float(values[0]), float(values[1])) if limited else UNLIMITED


@dataclass(frozen=True, eq=False)
class OptionData:
    """Options that change forces or steps.

    Attributes
    ----------
    gravity : ndarray (3,)
        Acceleration of gravity, zero if a flag disables it [m/s^2].
    density, viscosity : float
        Of the medium [kg/m^3, Pa s].
    magnetic : ndarray (3,)
        Magnetic field, of sensors only [T].
    inverse_of_steps : bool
        Whether inverse dynamics is that of discrete time steps.
    sleep : bool
        Whether bodies at rest are not stepped.
    """

    gravity: Array
    density: float
    viscosity: float
    magnetic: Array
    inverse_of_steps: bool
    sleep: bool


def read_options(model: Any) -> OptionData:
    """Read the options of a compiled model."""
    return OptionData(
        np.array(model.opt.gravity) * (not is_disabled(model, DISABLE.mjDSBL_GRAVITY)),
        float(model.opt.density),
        float(model.opt.viscosity),
        np.array(model.opt.magnetic),
        is_enabled(model, ENABLE.mjENBL_INVDISCRETE),
        is_enabled(model, ENABLE.mjENBL_SLEEP),
    )
